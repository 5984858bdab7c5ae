"""Maps, plans, motions and movers of the library as the plain values that tests/checker takes."""

import functools
from typing import NamedTuple

import numpy as np
import shapely
from scipy import ndimage

import cspace
import planners
from cspace.inside import Balls, Mesh, Voxels, list_alternatives
from planners._edges.drives import local_planner
from planners._motion.segments import cut_segments
from tests.checker import bodies, no_path, pieces, plane
from tests.helpers.regions import CORNERS, Body

MOST_CELLS = 60_000
MOST_SHAPES = 1500
MOST_TRIANGLES = 3000
MOST_PARTS = 24
"""Largest inputs of the checks that each test makes."""

HANDMADE = 1e-5
"""Size of robots below which the states of a map are made by hand, and belong to no robot."""


class LeftOut(Exception):  # noqa: N818 - no error
    """An input is larger, or of another kind, than the checker takes in each test."""


def need(true, what):
    """Raise LeftOut unless true."""
    if not true:
        raise LeftOut(what)


# ---- shapes --------------------------------------------------------------------------------------


def list_boxes(cells, lower, side):
    """Return the corners of runs of occupied cells along the last axis."""
    steps = np.diff(np.pad(cells, [*[(0, 0)] * (cells.ndim - 1), (1, 1)]).astype(np.int8), axis=-1)
    first, last = np.argwhere(steps > 0), np.argwhere(steps < 0)
    last[:, :-1] += 1
    return lower + side * first, lower + side * last


def list_geometries(shape):
    """Return a plane shape as geometries of shapely, each with a radius."""
    if isinstance(shape, Balls):
        return [(shapely.Point(c), r) for c, r in zip(shape.centers, shape.radii, strict=True)]
    if isinstance(shape, Voxels):
        low, high = list_boxes(shape.occupied, shape.lower, shape.side)
        return [(each, 0.0) for each in shapely.box(*low.T, *high.T)]
    need(hasattr(shape, "geometries"), f"a {type(shape).__name__} in the plane")
    return [(each, 0.0) for each in shape.geometries]


@functools.lru_cache(maxsize=64)
def parts_of(shape):
    """Return a plane shape as convex parts."""
    parts = []
    for geometry, radius in list_geometries(shape):
        for each in shapely.get_parts(geometry):
            if each.geom_type == "Polygon" and not each.equals(each.convex_hull):
                each = shapely.constrained_delaunay_triangles(each)
            for piece in shapely.get_parts(each):
                corners = shapely.get_coordinates(piece)
                parts.append(plane.Part(corners[: len(corners) - (len(corners) > 1)], radius))
    need(len(parts) <= MOST_PARTS, f"{len(parts)} parts")
    return parts


@functools.lru_cache(maxsize=64)
def body_of(shape):
    """Return a shape in space as a body."""
    if isinstance(shape, Balls):
        return bodies.Body(centers=shape.centers, radii=shape.radii)
    if isinstance(shape, Voxels):
        need(np.count_nonzero(shape.occupied) <= MOST_TRIANGLES, "many voxels")
        low, high = list_boxes(shape.occupied, shape.lower, shape.side)
        return bodies.Body(Body.boxes(np.stack([low, high], axis=1)).triangles)
    if hasattr(shape, "extents"):
        return bodies.Body(Body.boxes([shape.lower, shape.upper]).triangles)
    need(isinstance(shape, Mesh), f"a {type(shape).__name__} in space")
    vertices, faces = shape.surface
    need(len(faces) <= MOST_TRIANGLES, "many triangles")
    return bodies.Body(np.asarray(vertices)[faces], is_solid=shape.is_watertight)


def convex_of(space):
    """Return the parts of a robot, grown by the margin, in which witnesses are found."""
    shape = space.robot.shape.inner
    if shape.dim == 2:
        parts = parts_of(shape)
    elif isinstance(shape, Balls):
        balls = zip(shape.centers, shape.radii, strict=True)
        parts = [plane.Part(center[None], radius) for center, radius in balls]
    else:
        need(hasattr(shape, "extents"), "a robot in space without boxes")
        parts = [plane.Part(np.where(CORNERS, shape.upper, shape.lower))]
    return [part._replace(radius=part.radius + space.margin) for part in parts]


# ---- worlds --------------------------------------------------------------------------------------


def shapes_of(space):
    """Return the obstacles of a map."""
    need(space.has_poses and isinstance(space, cspace.CSpace), "no map of poses in memory")
    need(space.floor is None, "a robot on a floor")
    workspace = space.workspace
    need(space.robot.shape.lever > HANDMADE, "a handmade map")
    need(workspace.grid.size <= MOST_CELLS, f"{workspace.grid.size} cells")
    return (*workspace.obstacles, *space.obstacles.values())


_kept = {}


def world_of(space, side="outer", exact=False):
    """Return the obstacles of a map, and the room that its robot stays in, or None."""
    key = id(space.workspace), side, exact, space.outside, *map(id, space.obstacles.values())
    if key in _kept:
        return _kept[key][1]
    shapes = [getattr(each, side) for each in shapes_of(space)]
    grid = space.grid
    room = None if space.outside == "free" else np.array([grid.lower, grid.upper])
    if space.dim == 2:
        parts = [each for shape in shapes for each in list_geometries(shape)]
        need(len(parts) <= MOST_SHAPES, f"{len(parts)} obstacles")
        geometries = np.array([each for each, _ in parts], object)
        if room is None and not exact:  # the map has what lies in its grid
            box = shapely.box(*grid.lower, *grid.upper)
            geometries = shapely.intersection(geometries, box)
        made = plane.Plane(geometries, np.array([r for _, r in parts]), room)
    else:
        need(room is not None or all(isinstance(each, Voxels) for each in shapes), "is open")
        made = Solids(shapes, room)
    if len(_kept) > 40:
        _kept.clear()
    _kept[key] = space.workspace, made, space.obstacles
    return made


class Solids(NamedTuple):
    """Shapes in space, and a room."""

    shapes: list
    room: object

    def cover(self, low, high):
        """Return which boxes lie in an obstacle, or outside."""
        covered = np.zeros(len(low), bool)
        if self.room is not None:
            covered |= ((high <= self.room[0]) | (low >= self.room[1])).any(axis=1)
        for shape in self.shapes:
            need(isinstance(shape, Voxels), "no bitmap in space")
            cells = np.floor((0.5 * (low + high) - shape.lower) / shape.side).astype(int)
            corner = shape.lower + shape.side * cells
            inside = ((low >= corner) & (high <= corner + shape.side)).all(axis=1)
            inside &= ((cells >= 0) & (cells < shape.occupied.shape)).all(axis=1)
            inside[inside] = shape.occupied[tuple(cells[inside].T)]
            covered |= inside
        return covered


# ---- motions -------------------------------------------------------------------------------------


def pieces_of_rows(space, rows):
    """Return straight pieces between rows."""
    if not space.has_poses:
        return pieces.make_lines(rows)
    if space.size == 7:
        turns = np.zeros((len(rows), 3))
        return pieces.make_lines(np.column_stack([rows[:, :3], turns]), (), rows[:, 3:])
    return pieces.make_lines(rows, range(space.dim, space.size))


def pieces_of_plan(plan):
    """Return the motion of a plan in closed form, and how far it is from the plan's rows."""
    space = plan.space
    angles = range(space.dim, space.size) if space.has_poses and space.size < 7 else ()
    if not isinstance(plan.drive, planners.Car):
        made = pieces_of_rows(space, plan.path)
        gap = 0.0
        if plan.drive is not None:  # it turns on the spot, or drives along its heading
            steps, yaws = made.rates[:, 0], made.start[:, 2]
            across = steps[:, 1] * np.cos(yaws) - steps[:, 0] * np.sin(yaws)
            turned = np.abs(steps[:, 2]) * np.linalg.norm(steps[:, :2], axis=1)
            gap = max(np.abs(across).max(), turned.max())
        return made, gap
    edges = local_planner(space, plan.drive, exact=plan.exact)
    starts, steps, turns = edges.list_segments(plan.waypoints, space.rotations)
    if not len(steps):
        return pieces.make_lines(plan.path), 0.0
    made = pieces.make_arcs(starts[:-1], np.column_stack([steps[:, :2], turns]))
    radius = plan.drive.turning_radius
    tight = np.abs(turns) * radius - np.linalg.norm(steps[:, :2], axis=1)
    some = np.unique(np.linspace(0, len(plan.path) - 1, 25).astype(int))
    rows = plan.path[some]
    gap = pieces.find_gap(made, rows, *place_on_arcs(made, rows), angles)
    return made, max(gap, float(tight.max(initial=0.0)))


def place_on_arcs(made, rows):
    """Return the piece that passes each row, and when, in the order of the rows."""
    which, times = [], []
    last = 0.0  # the piece of the row before, and the time there
    size = np.maximum((made.rates[:, 0, :2] ** 2).sum(axis=1), 1e-300)
    for row in rows:
        later = np.arange(int(last), min(int(last) + 20, len(size)))
        steps = row - made.start[later]
        steps[:, 2] = (steps[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        rates = made.rates[later, 0]
        turned = np.where(made.is_arc[later], rates[:, 2], 1.0)
        t = (steps[:, :2] * rates[:, :2]).sum(axis=1) / size[later]
        around = steps[:, 2] % (2.0 * np.pi * np.sign(turned)) / turned
        around = np.where(around > 2.0 * np.pi / np.abs(turned) - 1e-6, 0.0, around)
        t = np.where(made.is_arc[later], around, t).clip(0.0, 1.0)
        gaps = np.abs(made.at(later, t) - row)[:, :2].max(axis=1)
        # A car may go back along the arc on which it came.
        gaps[later + t < last - 1e-6] = np.inf
        best = int(np.flatnonzero(gaps <= gaps.min() + 1e-9)[0])
        which.append(later[best])
        times.append(t[best])
        last = min(float(later[best] + t[best]), len(size) - 1.0)
    return np.array(which), np.array(times)


def pieces_of_trajectory(motion, space):
    """Return the motion of a trajectory in closed form, and how far it is from its samples."""
    segments, phases = motion._segments, motion._phases
    begin, end = phases.positions[[0, -1]].tolist()
    segments = cut_segments(segments, motion._rotations, begin, end)
    size = segments.lengths[:, None]
    curved = segments.curvatures != 0.0
    rates = np.stack(
        [segments.rates * size, segments.bends * size**2, segments.twists * size**3], 1
    )
    arc_turns = (segments.curvatures * segments.lengths)[curved]
    need(np.allclose(rates[curved, 0, 2:3].ravel(), arc_turns), "arcs of another yaw")
    start, spin = segments.starts, None
    if space.has_poses and space.size == 7:
        start, spin = np.pad(start[:, :3], [(0, 0), (0, 3)]), start[:, 3:]
        need(not rates[:, 1:, 3:].any(), "curves of quaternions")
    made = pieces.Pieces(start, rates, curved, segments.drives, spin)
    numbers = np.searchsorted(phases.times, motion.times, side="right") - 1
    lengths = phases.at(numbers, motion.times - phases.times[numbers])[0]
    which = phases.segments[numbers]
    lengths = np.where(which == 0, lengths - begin, lengths)
    times = (lengths / np.maximum(segments.lengths[which], 1e-300)).clip(0.0, 1.0)
    angles = range(space.dim, space.size) if space.has_poses and space.size < 7 else ()
    return made, pieces.find_gap(
        made, motion.positions, which, times, angles
    ) if spin is None else 0.0


# ---- places --------------------------------------------------------------------------------------


def places_of(space, place, name):
    """Return the alternatives of a place as the user gave them."""
    return [_read_place(space, each) for each in list_alternatives(place, name, space.axes)]


def _read_place(space, place):
    if isinstance(place, planners.Near):
        (inner,) = list_alternatives(place.configuration, "place", space.axes)
        made = _read_place(space, inner)
        angle = made.angle + place.angle
        return made._replace(distance=made.distance + place.distance, angle=angle)
    items = place if isinstance(place, list | tuple) else (place,)
    turns = space.rotations.names if space.has_poses else ()
    if isinstance(items[0], shapely.Geometry):
        yaw = items[1] if len(items) > 1 else None
        while isinstance(yaw, list | tuple | np.ndarray):
            (yaw,) = yaw
        return no_path.Place(items[0], 0.0, yaw)
    if items[-1] is None:
        return no_path.Place(tuple(map(float, items[: space.dim])))
    try:
        row = np.asarray(place, float)
    except (TypeError, ValueError):
        raise LeftOut("a message or a goal") from None
    need(row.shape == (space.size,) and space.has_poses, "a place of joints")
    yaw = float(row[-1]) if turns == ("yaw",) else None
    return no_path.Place(tuple(row[: space.dim]), 0.0, yaw)


# ---- bars ----------------------------------------------------------------------------------------


def find_bars(space, places):
    """Find cells that bar the way from the first place, each with a witness.

    Returns
    -------
    borders, barred, offsets : as of :func:`no_path.check_no_path`
    """
    shapes_of(space)  # refuses large maps
    grid, lower = space.grid, np.asarray(space.grid.lower)
    names = space.rotations.names
    need(names in ((), ("yaw",)), "rotations of other kinds")
    borders = np.asarray(space.rotations.borders) if names else np.zeros(0)
    turns, positions = max(len(borders) - 1, 1), grid.size
    need(turns * positions <= 10 * MOST_CELLS, "many cells")
    states = space.cell_states.reshape(turns, *grid.shape)
    labels = label(states != cspace.BLOCKED, space.outside == "free")
    is_blocked = (states == cspace.BLOCKED).ravel()
    ends, at_end = [], np.zeros(states.size, bool)
    for place in (places[0], places[-1]):
        cells = [each.find_cells(lower, grid.spacing, grid.shape, borders) for each in place]
        at_end[np.concatenate(cells)] = True
        kept = [
            c
            for c, each in zip(cells, place, strict=True)
            if not (each.is_one and is_blocked[c].any())
        ]
        ends.append(np.unique(np.concatenate([*kept, np.zeros(0, int)]).astype(int)))
    found = [np.unique(labels.ravel()[cells]) for cells in ends]
    sizes = [np.isin(labels, each[each > 0]) for each in found]
    which = min(0, 1, key=lambda k: np.count_nonzero(sizes[k]))
    inside = sizes[which]
    cross = ndimage.generate_binary_structure(inside.ndim, 1)
    padded = np.concatenate([inside[-1:], inside, inside[:1]])
    rim = ndimage.binary_dilation(padded, cross)[1:-1] & (states == cspace.BLOCKED)
    if turns == 1:
        rim = ndimage.binary_dilation(inside[0], cross[1])[None] & (states == cspace.BLOCKED)
    rim |= at_end.reshape(states.shape) & (states == cspace.BLOCKED)
    if (
        space.outside == "free" and inside.any()
    ):  # a motion that leaves the grid may come back at any border
        edge = np.ones(grid.shape, bool)
        edge[tuple(slice(1, -1) for _ in grid.shape)] = False
        rim |= edge[None] & (states == cspace.BLOCKED)
    return borders, *find_witnesses(space, np.argwhere(rim), borders)


def measure_nearest(space, starts, wanted):
    """Return how near to a point the FREE cells come that are joined to a start by FREE cells."""
    shapes_of(space)
    grid, lower = space.grid, np.asarray(space.grid.lower)
    borders = np.asarray(space.rotations.borders) if space.rotations.names else np.zeros(0)
    states = space.cell_states.reshape(max(len(borders) - 1, 1), *grid.shape)
    labels = label(states == cspace.FREE, space.outside == "free")
    reached = np.zeros(labels.max() + 1, bool)
    for place in starts:
        if hasattr(place.where, "buffer"):  # the inside of a region
            place = place._replace(where=place.where.buffer(-1e-3 * grid.spacing))
        cells = place.find_cells(lower, grid.spacing, grid.shape, borders)
        numbers = labels.ravel()[cells]
        # A configuration on a border is free if all cells that it touches are.
        if len(cells) and (hasattr(place.where, "buffer") or place.yaw is None or numbers.all()):
            reached[numbers] = True
    reached[0] = False
    near = wanted._replace(distance=1e9, angle=max(wanted.angle - 1e-6, 0.0))
    turned = np.zeros(labels.size, bool)
    turned[near.find_cells(lower, grid.spacing, grid.shape, borders)] = True
    cells = np.argwhere(reached[labels] & turned.reshape(labels.shape))[:, 1:]
    low = lower + grid.spacing * cells
    away = np.maximum(np.maximum(low - wanted.where, wanted.where - low - grid.spacing), 0.0)
    return float(np.linalg.norm(away, axis=1).min(initial=np.inf))


def label(mask, is_open):
    """Number the components of cells (yaw, x, y(, z)); yaws repeat, and an open outside joins."""
    labels, count = ndimage.label(mask)
    root = np.arange(count + 1)
    pairs = (
        np.stack([labels[0].ravel(), labels[-1].ravel()])
        if len(mask) > 1
        else np.zeros((2, 0), int)
    )
    pairs = np.unique(pairs[:, (pairs > 0).all(axis=0)], axis=1)
    if is_open:
        edge = np.ones(mask.shape[1:], bool)
        edge[tuple(slice(1, -1) for _ in mask.shape[1:])] = False
        rim = np.unique(labels[:, edge])
        rim = rim[rim > 0]
        pairs = (
            np.concatenate([pairs, np.stack([rim, np.full(len(rim), rim[:1])])], 1)
            if len(rim)
            else pairs
        )
    for _ in range(count):
        before = root.copy()
        least = np.minimum(root[pairs[0]], root[pairs[1]])
        for side in pairs:
            np.minimum.at(root, root[side], least)
            np.minimum.at(root, side, least)
        if (root == before).all():
            break
    return root[labels]


def find_witnesses(space, cells, borders):
    """Return cells, and for each an offset to a point of the robot that stays in an obstacle."""
    grid = space.grid
    inner = np.asarray(space.workspace.inner)
    for shape in space.obstacles.values():
        inner = inner | shape.cells(grid)[1]
    shape, dim = np.array(grid.shape), space.dim
    parts = convex_of(space)
    corners = np.concatenate([p.corners for p in parts])
    reach = int(
        np.ceil(
            (np.linalg.norm(corners, axis=1).max() + max(p.radius for p in parts)) / grid.spacing
        )
    )
    side = np.arange(-reach, reach + 1)
    steps = np.stack(np.meshgrid(*[side] * dim, indexing="ij"), -1).reshape(-1, dim)
    need(len(steps) <= 20_000, "a large robot")
    fill = space.outside != "free"
    offsets, found = np.zeros((len(cells), dim)), np.zeros(len(cells), bool)
    padded = np.pad(inner, reach, constant_values=fill)
    for k in np.unique(cells[:, 0]):
        middle, half = 0.0, 0.0
        if len(borders):
            middle, half = 0.5 * (borders[k] + borders[k + 1]), 0.5 * (borders[k + 1] - borders[k])
        points = grid.spacing * steps
        body = np.column_stack(
            [pieces.turn(points[:, :2], np.full(len(points), -middle)), points[:, 2:]]
        )
        depth = np.max([no_path._find_depths(part, body) for part in parts], axis=0)
        moved = 2.0 * np.linalg.norm(points[:, :2], axis=1) * np.sin(0.5 * half)
        inside = steps[depth >= moved]
        mine = np.flatnonzero(cells[:, 0] == k)
        # Offsets far apart first, so that few decide most cells.
        for step in inside[np.random.default_rng(0).permutation(len(inside))]:
            if not len(mine):
                break
            at = cells[mine, 1:] + step + reach
            within = ((at >= 0) & (at < padded.shape)).all(axis=1)
            hit = np.full(len(mine), fill)
            hit[within] = padded[tuple(at[within].T)]
            offsets[mine[hit]], found[mine[hit]] = grid.spacing * step, True
            mine = mine[~hit]
    return cells[found], offsets[found]


# ---- arms ----------------------------------------------------------------------------------------


def arm_of(space):
    """Return the joints, bodies and pairs of an arm among its obstacles."""
    arm, chain = space.arm, space.arm.chain
    frames = np.tile(np.eye(4), (len(chain.parents), 1, 1))
    frames[:, :3] = chain.frames
    fixed = chain.kinds == chain.kinds[0]
    index = np.where(fixed, -1, chain.joint_indices)
    slides = np.array([bool(_is_sliding(kind)) for kind in chain.kinds])
    joints = bodies.Chain(
        np.asarray(chain.parents), frames, chain.axes, slides, index, chain.factors, chain.offsets
    )
    solids = [(link.name, link.body, link.parts) for link in arm.links]
    solids += [(name, 0, (shape,)) for name, shape in space._placed_obstacles.items()]
    made, owners = [], []
    for name, link, parts in solids:
        for part in parts:
            body = body_of(part.shape.outer)
            moved = bodies.Body(
                body.triangles @ part.pose[:3, :3].T + part.pose[:3, 3],
                body.centers @ part.pose[:3, :3].T + part.pose[:3, 3],
                body.radii,
                body.is_solid,
            )
            made.append((link, moved))
            owners.append(name)
    names = {link.name for link in arm.links}
    allowed = {frozenset(pair) for pair in (*arm.allowed_collisions, *space.allowed_collisions)}
    pairs = []
    for a in range(len(made)):
        for b in range(a):
            both = {owners[a], owners[b]}
            if made[a][0] == made[b][0] or len(both) == 1 or both in allowed:
                continue
            if not both & names:
                continue
            padding = 0.0 if both <= names else sum(space.padding.get(name, 0.0) for name in both)
            pairs.append((b, a, space.margin + padding))
    need(len(pairs) <= 60, f"{len(pairs)} pairs of bodies")
    return joints, made, pairs


def _is_sliding(kind):
    from cspace._bodies.chain import PRISMATIC

    return kind == PRISMATIC
