"""Pictures of balls and the shape that they describe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.spectral.regions import region_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.shapes import Shape

Floats = NDArray[np.float64]

COLORS: Final = {"inner": "#0072b2", "outer": "#d55e00"}
"""Of balls, from Okabe and Ito (2008)."""

SHAPE: Final = "#262626"

INCHES: Final = 6.5
"""Longer side of the axes."""

TRIANGLES: Final = 20_000
"""Triangles that balls are drawn with, about."""


class Balls(Protocol):
    """What is asked of a :class:`cspace.Spheres`."""

    @property
    def centers(self) -> Floats: ...
    @property
    def radii(self) -> Floats: ...
    @property
    def dim(self) -> int: ...
    @property
    def kind(self) -> str: ...
    @property
    def shape(self) -> Shape | None: ...
    @property
    def volume_ratio(self) -> float: ...
    @property
    def hausdorff(self) -> tuple[float, float]: ...
    def __len__(self) -> int: ...


def draw(spheres: Balls, ax: Axes | None, shape: Any, title: str | None) -> Axes:
    """Draw balls; as :meth:`Spheres.plot` tells."""
    from matplotlib.figure import Figure

    drawn = spheres.shape if shape is None else region_of(shape, None, None).shape
    if drawn is not None and drawn.dim != spheres.dim:
        raise InputError("shape", f"has {drawn.dim} coordinates, the balls {spheres.dim}", "both must have as many")
    solid = spheres.dim == 3
    axes: Any = ax
    if axes is None:
        figure = Figure(figsize=(INCHES, INCHES), layout="constrained")
        axes = figure.add_subplot(projection="3d" if solid else None)
    if solid != hasattr(axes, "get_zlim"):
        raise InputError("ax", "is not of the balls' dimension", "balls in space need axes with projection='3d'")
    reach = spheres.radii[:, None]
    corners = [(spheres.centers - reach).min(axis=0), (spheres.centers + reach).max(axis=0)]
    corners += [] if drawn is None else list(drawn.bounds)
    lower, upper = np.min(corners, axis=0), np.max(corners, axis=0)
    (_draw_balls if solid else _draw_discs)(spheres, axes)
    if drawn is not None:
        (_draw_surface if solid else _draw_outline)(drawn, axes)
    room = 0.03 * float((upper - lower).max())
    for name, low, high in zip("xyz", lower - room, upper + room, strict=False):
        axes.set(**{f"{name}lim": (low, high), f"{name}label": f"{name} [m]"})
    axes.set_aspect("equal")
    axes.set_title(_title(spheres) if title is None else title, fontsize=10)
    return axes  # type: ignore[no-any-return]


def _title(spheres: Balls) -> str:
    what = ("disc", "ball")[spheres.dim - 2]
    name = f"{len(spheres)} {spheres.kind} {what}{'s' * (len(spheres) > 1)}"
    ratio = spheres.volume_ratio
    share = f", {100.0 * ratio:.1f} % of its {('area', 'volume')[spheres.dim - 2]}" if np.isfinite(ratio) else ""
    far = "every point within" if spheres.kind == "inner" else "sticking out by at most"
    return f"{name}{share}, {far} {spheres.hausdorff[1]:.3g} m"


def _draw_discs(spheres: Balls, axes: Any) -> None:
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import to_rgba

    sizes, color = 2.0 * spheres.radii, COLORS[spheres.kind]
    options = {"units": "xy", "offsets": spheres.centers, "offset_transform": axes.transData}
    discs = EllipseCollection(sizes, sizes, np.zeros(len(sizes)), **options)
    # So many discs lie over each other that their colours must be thin.
    discs.set(facecolor=to_rgba(color, 0.16), edgecolor=to_rgba(color, 0.75), linewidth=0.6, zorder=2)
    axes.add_collection(discs)


def _draw_outline(shape: Shape, axes: Any) -> None:
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(shape.boundary().simplices), colors=SHAPE, linewidths=1.2, zorder=3))


def _draw_balls(spheres: Balls, axes: Any) -> None:
    import trimesh
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    wanted = TRIANGLES / len(spheres)
    ball = trimesh.creation.icosphere(subdivisions=int(np.clip(np.log(wanted / 20.0) / np.log(4.0), 1.0, 4.0)))
    corners = np.asarray(ball.vertices)[np.asarray(ball.faces)]
    faces = (spheres.centers[:, None, None] + spheres.radii[:, None, None, None] * corners).reshape(-1, 3, 3)
    axes.add_collection3d(Poly3DCollection(faces, facecolors=COLORS[spheres.kind], shade=True, alpha=0.9))


def _draw_surface(shape: Shape, axes: Any) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    vertices, faces = shape.surface
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    axes.add_collection3d(Line3DCollection(vertices[edges], colors=SHAPE, linewidths=0.5, alpha=0.5))
