"""Pictures of balls and the shape that they describe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.shapes.mesh import Mesh
    from cspace.spectral.spheres.result import Spheres

Floats = NDArray[np.float64]

COLORS: Final = {"inner": "#0072b2", "outer": "#d55e00"}
"""Of balls, from Okabe and Ito (2008)."""

SHAPE: Final = "#262626"

INCHES: Final = 6.5
"""Longer side of the axes."""

TRIANGLES: Final = 50_000
"""Triangles that balls are drawn with, about."""

_SHARP: Final = np.cos(np.radians(25.0))
"""Cosine of the angle between faces from which on their edge is drawn."""

_LIGHT: Final = np.array([0.35, -0.55, 0.76])


def draw(spheres: Spheres, ax: Axes | None, shape: Any, title: str | None) -> Axes:
    """Draw balls; as :meth:`Spheres.plot` tells."""
    found = spheres.shape if shape is None else shape
    axes = _draw_flat(spheres, ax, found) if spheres.dim == 2 else _draw_solid(spheres, ax, found)
    axes.set_title(_title(spheres) if title is None else title, fontsize=10)
    return axes


def _title(spheres: Spheres) -> str:
    what = ("disc", "ball")[spheres.dim - 2]
    name = f"{len(spheres)} {spheres.kind} {what}{'s' * (len(spheres) > 1)}"
    ratio = spheres.volume_ratio
    share = f", {100.0 * ratio:.1f} % of its {('area', 'volume')[spheres.dim - 2]}" if np.isfinite(ratio) else ""
    far = "every point within" if spheres.kind == "inner" else "sticking out by at most"
    return f"{name}{share}, {far} {spheres.hausdorff.upper:.3g} m"


def _draw_flat(spheres: Spheres, ax: Axes | None, shape: Any) -> Axes:
    import shapely
    from matplotlib.collections import EllipseCollection, PathCollection

    color = COLORS[spheres.kind]
    lower = (spheres.centers - spheres.radii[:, None]).min(axis=0)
    upper = (spheres.centers + spheres.radii[:, None]).max(axis=0)
    if shape is not None:
        if not isinstance(shape, shapely.Geometry):
            raise InputError(
                f"shape is {shape!r:.60}; with discs it must be a shapely geometry; pass one or leave it out"
            )
        box = np.array(shape.bounds)
        lower, upper = np.minimum(lower, box[:2]), np.maximum(upper, box[2:])
    axes = ax if ax is not None else _new_axes(upper - lower)
    if shape is not None:
        paths = [_path_of(part) for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
        lines = [_path_of(part) for part in shapely.get_parts(shape) if part.geom_type != "Polygon"]
        axes.add_collection(PathCollection(paths, facecolor="#e8e8e8", edgecolor="none", zorder=1))
        axes.add_collection(PathCollection(paths + lines, facecolor="none", edgecolor=SHAPE, linewidth=1.2, zorder=3))
    sizes = 2.0 * spheres.radii
    discs = EllipseCollection(
        sizes, sizes, np.zeros(len(sizes)), units="xy", offsets=spheres.centers, offset_transform=axes.transData
    )
    # So many discs lie over each other that their colours must be thin.
    discs.set(facecolor=(*_rgb(color), 0.16), edgecolor=(*_rgb(color), 0.75), linewidth=0.6, zorder=2)
    axes.add_collection(discs)
    room = 0.03 * float((upper - lower).max())
    axes.set(xlim=(lower[0] - room, upper[0] + room), ylim=(lower[1] - room, upper[1] + room))
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    return axes


def _path_of(part: Any) -> Any:
    """A polygon with its holes, a line or a point, as a path."""
    from matplotlib.path import Path

    if part.geom_type != "Polygon":
        return Path(np.asarray(part.coords)[:, :2])
    rings = [Path(np.asarray(ring.coords)[:, :2], closed=True) for ring in (part.exterior, *part.interiors)]
    return Path.make_compound_path(*rings)


def _draw_solid(spheres: Spheres, ax: Axes | None, shape: Any) -> Axes:
    from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # type: ignore[import-untyped]

    from cspace.shapes.mesh import Mesh

    if shape is not None and not isinstance(shape, Mesh):
        shape = Mesh.of(shape)
    axes: Any = ax
    if axes is None:
        from cspace.plot.artists import new_figure

        axes = new_figure(INCHES, INCHES).add_subplot(projection="3d")
    if not isinstance(axes, Axes3D):
        raise InputError("ax is of the plane, and the balls are in space; pass axes with projection='3d', or none")
    lower = (spheres.centers - spheres.radii[:, None]).min(axis=0)
    upper = (spheres.centers + spheres.radii[:, None]).max(axis=0)
    if shape is not None:
        lower, upper = np.minimum(lower, shape.bounds[0]), np.maximum(upper, shape.bounds[1])
    axes.view_init(elev=28.0, azim=-60.0)
    axes.set_proj_type("ortho")
    faces, shades = _seen(spheres, _towards(28.0, -60.0))
    light = shades[:, None]
    colors = np.array(_rgb(COLORS[spheres.kind])) * (0.4 + 0.6 * light)
    colors += (1.0 - colors) * 0.45 * light**3
    axes.add_collection3d(Poly3DCollection(faces, facecolors=colors, edgecolors=colors, linewidths=0.15))
    if shape is not None:
        edges = _sharp_edges(shape)
        if len(edges):
            axes.add_collection3d(Line3DCollection(edges, colors=SHAPE, linewidths=0.8, alpha=0.8))
    axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), zlim=(lower[2], upper[2]))
    axes.set_box_aspect(np.maximum(upper - lower, 1e-3 * float((upper - lower).max())))
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    return axes  # type: ignore[no-any-return]


def _seen(spheres: Spheres, towards: Floats) -> tuple[Floats, Floats]:
    """Triangles of the balls that look at the camera and lie in no other ball, and the light on them, from 0 to 1."""
    import trimesh

    wanted = TRIANGLES / len(spheres)
    ball = trimesh.creation.icosphere(subdivisions=int(np.clip(np.log(wanted / 20.0) / np.log(4.0), 1.0, 4.0)))
    corners, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    normals = corners[faces].mean(axis=1)
    # What lies so deep in a ball lies in its triangles too.
    deep = float(np.sqrt((normals**2).sum(axis=1)).min())
    normals /= np.sqrt((normals**2).sum(axis=1))[:, None]
    faces, normals = faces[normals @ towards > -0.05], normals[normals @ towards > -0.05]
    light = 0.5 + 0.5 * normals @ (_LIGHT / np.linalg.norm(_LIGHT))
    found, shades = [], []
    for center, radius in zip(spheres.centers, spheres.radii.tolist(), strict=True):
        points = center + radius * corners
        near = np.linalg.norm(spheres.centers - center, axis=1) < spheres.radii + radius
        near &= (spheres.centers != center).any(axis=1)
        way = np.linalg.norm(points[:, None] - spheres.centers[near], axis=2)
        hidden = (way < deep * spheres.radii[near]).any(axis=1) if near.any() else np.zeros(len(points), dtype=np.bool_)
        kept = ~hidden[faces].all(axis=1)
        found.append(points[faces[kept]])
        shades.append(light[kept])
    return np.concatenate(found), np.concatenate(shades)


def _sharp_edges(mesh: Mesh) -> Floats:
    """Edges between faces that are not nearly in one plane, and open ones, shape (n, 2, 3)."""
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.sqrt((normals**2).sum(axis=1)), 1e-300)[:, None]
    points, which = np.unique(mesh.triangles.reshape(-1, 3), axis=0, return_inverse=True)
    corners = which.reshape(-1, 3)
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    face = np.repeat(np.arange(len(corners)), 3)
    edges, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    number = number.ravel()
    order = np.argsort(number, kind="stable")
    first = np.append(0, np.cumsum(count)[:-1])
    last = first + count - 1
    flat = (normals[face[order[first]]] * normals[face[order[last]]]).sum(axis=1) > _SHARP
    return np.asarray(points[edges[(count != 2) | ~flat]])


def _towards(elevation: float, azimuth: float) -> Floats:
    """Unit vector to a camera, angles in degrees."""
    e, a = np.radians(elevation), np.radians(azimuth)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def _rgb(color: str) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    return to_rgb(color)


def _new_axes(extent: Floats) -> Axes:
    from cspace.plot.artists import new_figure

    width, height = extent * INCHES / float(extent.max())
    return new_figure(max(float(width) + 0.9, 5.2), max(float(height) + 0.9, 1.8)).add_subplot()
