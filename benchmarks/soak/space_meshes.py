"""Random meshes for the soak, as files may hold them, each with what it stands for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.soak.plane_cases import Scale
from benchmarks.soak.space_geometry import SIDES, Blocks, Shape, Skin, directions
from cspace.arrays import Floats
from cspace.shapes.mesh import Mesh, Solid

Rng = np.random.Generator


Drawn = tuple[Mesh, Shape]


def _disturbed(rng: Rng, triangles: Floats, flips: str, solid: Solid = "auto") -> Mesh:
    """Triangles as files hold them: in any order, turned any way, some twice, some without area.

    ``flips`` is "none", "all" or "some".
    """
    turned = rng.random(len(triangles)) < {"none": 0.0, "all": 1.0, "some": 0.5}[flips]
    triangles = np.where(turned[:, None, None], triangles[:, ::-1], triangles)
    if rng.random() < 0.3:
        twice = triangles[rng.integers(0, len(triangles), 2)]
        flat = triangles[rng.integers(0, len(triangles), 2)][:, [0, 0, 1]]
        triangles = np.concatenate([triangles, twice, flat])
    triangles = rng.permutation(triangles)
    corners = triangles.reshape(-1, 3)
    if rng.random() < 0.5:
        return Mesh(corners, np.arange(len(corners)).reshape(-1, 3), solid)
    vertices, faces = np.unique(corners, axis=0, return_inverse=True)
    return Mesh(vertices, faces.reshape(-1, 3), solid)


def _boxes_mesh(rng: Rng, middle: Floats, reach: float, scale: Scale) -> Drawn:
    """Some boxes, snapped and turned alike, or anywhere and turned anyhow."""
    number = int(rng.integers(1, 5))
    alike = bool(rng.random() < 0.6)
    if alike:
        low = middle + scale.place(rng.uniform(-1.0, 1.0, (number, 3)) * reach / scale.spacing)
        sides = [
            [scale.length(length) for length in row]
            for row in rng.uniform(0.1, 1.5, (number, 3)) * reach / scale.spacing
        ]
        corners = np.stack([low, low + sides], axis=1)
    else:
        low = middle + rng.uniform(-1.0, 1.0, (number, 3)) * reach
        corners = np.stack([low, low + rng.uniform(0.1, 1.5, (number, 3)) * reach], axis=1)
    blocks = Blocks.boxes(corners)
    return _disturbed(rng, blocks.skin().triangles, str(rng.choice(["none", "all"])) if alike else "some"), blocks


def _opposed_mesh(rng: Rng, middle: Floats, reach: float, scale: Scale) -> Drawn:
    """Two boxes that face opposite ways: a hollow one, or two that are solid, as one in the box of no other is."""
    low = middle + rng.uniform(-1.0, 0.0, (2, 3)) * reach
    corners = np.stack([low, low + rng.uniform(0.2, 2.0, (2, 3)) * reach], axis=1)
    if rng.random() < 0.5:
        t = np.sort(rng.uniform(0.02, 0.98, (2, 3)), axis=0)
        corners[1] = corners[0, 0] + t * (corners[0, 1] - corners[0, 0])
    skin = Blocks.boxes(corners).skin().triangles
    flips = str(rng.choice(["none", "all"]))
    mesh = _disturbed(rng, np.concatenate([skin[:12], skin[12:, ::-1]]), flips)
    outward, inward = corners if flips == "none" else corners[::-1]
    hollow = bool((outward[0] < inward[0]).all() and (inward[1] < outward[1]).all())
    return mesh, Blocks.boxes(np.array(_without(outward, inward)) if hollow else corners)


def _without(box: Floats, hole: Floats) -> list[Floats]:
    """Boxes whose union is the closure of a box without another."""
    if (hole[0] >= box[1]).any() or (hole[1] <= box[0]).any():
        return [box]
    pieces, left = [], box.copy()
    for axis in range(3):
        for end in (0, 1):
            inside = hole[end, axis] > left[0, axis] if end == 0 else hole[end, axis] < left[1, axis]
            if inside:
                piece = left.copy()
                piece[1 - end, axis] = hole[end, axis]
                pieces.append(piece)
                left[end, axis] = hole[end, axis]
    return pieces


def _hulls_mesh(rng: Rng, middle: Floats, reach: float, scale: Scale) -> Drawn:
    """Convex bodies, apart or overlapping, flat ones among them."""
    flat = rng.choice([1.0, 1.0, 0.1, 1e-3])
    single = bool(rng.random() < 0.4)
    bodies = [
        _hull(rng, middle + rng.uniform(-1.0, 1.0, 3) * reach * (not single), reach, scale, flat)
        for _ in range(1 if single else int(rng.integers(2, 4)))
    ]
    skin = _skin(bodies)
    solid: Solid = "fill" if single and flat == 1.0 and rng.random() < 0.3 else "auto"
    return _disturbed(rng, skin.triangles, str(rng.choice(["none", "all", "some"])), solid), skin


def _hull(rng: Rng, middle: Floats, reach: float, scale: Scale, flat: float) -> Floats:
    from scipy.spatial import ConvexHull

    points = directions(int(rng.integers(4, 20)), rng) * reach * rng.uniform(0.5, 1.0)
    points[:, int(rng.integers(3))] *= flat
    if scale.snap and flat == 1.0 and reach > 3.0 * scale.spacing:
        points = scale.place(points / scale.spacing)
    points = middle + points
    hull = ConvexHull(points - middle, qhull_options="Qt QJ" if flat < 1.0 else "Qt")
    triangles = points[hull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    outward = (normals * hull.equations[:, :3]).sum(axis=1) > 0.0
    return np.asarray(np.where(outward[:, None, None], triangles, triangles[:, ::-1]))


def _stars_mesh(rng: Rng, middle: Floats, reach: float, scale: Scale) -> Drawn:
    """Bodies with dents and spikes, around their middles."""
    import trimesh

    bodies = []
    for _ in range(int(rng.integers(1, 3))):
        ball = trimesh.creation.icosphere(int(rng.integers(0, 3)), 1.0)
        vertices = np.asarray(ball.vertices) * rng.uniform(0.3, 1.0, (len(ball.vertices), 1))
        vertices = vertices @ (directions(3, rng).T * rng.choice([1.0, 1.0, 0.1], 3)) * reach
        triangles = (middle + rng.uniform(-0.5, 0.5, 3) * reach + vertices)[np.asarray(ball.faces)]
        bodies.append(triangles)
    skin = _skin(bodies)
    return _disturbed(rng, skin.triangles, str(rng.choice(["none", "all", "some"]))), skin


def _open_mesh(rng: Rng, middle: Floats, reach: float, scale: Scale) -> Drawn:
    """Triangles that enclose nothing: anywhere, slivers, a crumpled sheet, sides of a box."""
    style = rng.choice(["soup", "slivers", "sheet", "sides"])
    if style in ("soup", "slivers"):
        corners = rng.uniform(-1.0, 1.0, (int(rng.integers(1, 12)), 3, 3)) * reach
        if style == "slivers":
            t = rng.uniform(-0.2, 1.2, (len(corners), 1))
            off = directions(len(corners), rng) * reach * 10.0 ** rng.uniform(-16.0, -2.0, (len(corners), 1))
            corners[:, 2] = corners[:, 0] + t * (corners[:, 1] - corners[:, 0]) + off
        triangles = middle + corners
    elif style == "sheet":
        n = int(rng.integers(2, 7))
        grid = np.stack(
            [*np.meshgrid(*[np.linspace(-1.0, 1.0, n)] * 2, indexing="ij"), rng.uniform(-0.3, 0.3, (n, n))], axis=-1
        )
        grid = middle + reach * np.roll(grid, int(rng.integers(3)), axis=2)
        a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
        triangles = np.concatenate([np.stack(each, axis=2).reshape(-1, 3, 3) for each in ((a, b, c), (a, c, d))])
    else:
        low = middle + scale.place(rng.uniform(-1.0, 0.0, 3) * reach / scale.spacing)
        sides = [scale.length(length) for length in rng.uniform(0.2, 2.0, 3) * reach / scale.spacing]
        box = Blocks.boxes([low, low + sides]).skin().triangles
        triangles = box[rng.permutation(len(SIDES))[: int(rng.integers(2, 8))]]
    skin = Skin(triangles, np.full(len(triangles), -1))
    return _disturbed(rng, triangles, "some", "surface"), skin


def _skin(bodies: list[Floats]) -> Skin:
    return Skin(np.concatenate(bodies), np.repeat(np.arange(len(bodies)), [len(body) for body in bodies]))


MESHES: dict[str, Callable[[Rng, Floats, float, Scale], Drawn]] = {
    "boxes": _boxes_mesh,
    "opposed boxes": _opposed_mesh,
    "hulls": _hulls_mesh,
    "stars": _stars_mesh,
    "open surface": _open_mesh,
}
