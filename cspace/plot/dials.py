"""Dials: the rotations at one position, as a ring of yaws, or as discs of tilts, one for each of some headings."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats
from cspace.plot import artists
from cspace.plot.route import Look, MapLike, Route, section_point
from cspace.states import MIXED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PIXELS: Final = 360
"""Pixels across a dial."""

_HOLE: Final = 0.6
"""Inner radius of a ring; the outer one is 1."""

_HEADINGS: Final = (0, 60, 120, 180, 240, 300)
"""Degrees about z, one for each disc."""

_COLUMNS: Final = 3
"""Discs in a row."""

_APART: Final = np.array([[-1e-6], [1e-6]])
"""Radians about z between the two rotations that a pixel is looked up at: they may lie in two cells with one border."""


class Dial(NamedTuple):
    """One dial, of radius 1.

    Attributes
    ----------
    title : str
    inside : ndarray of bool, shape (n, n)
        Which pixels belong to it.
    rotations : ndarray of float64, shape (2, m, dof)
        Two of each of these, all but the same, as in configurations.
    marks : tuple of (str, float, float)
        Texts, and where they stand.
    """

    title: str
    inside: Bools
    rotations: Floats
    marks: tuple[tuple[str, float, float], ...]


def draw_dials(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw the rotations at one position; as :func:`cspace.plot.plot`. Gives the axes of the first dial."""
    from matplotlib.colors import ListedColormap

    point, grid = section_point(space, look.at, route), space.grid
    cell = tuple(grid.cell_of(point).tolist())
    rotations, shape = space.rotations, space.robot.shape
    states = np.array([space.slice_at(each)[cell] for each in rotations.of_slices(shape)])[rotations.slice_of(shape)]
    ground, shown = artists.ground_of(space.workspace, cell), []
    dials = _DIALS[space.rotations.names]()
    rows = -(-len(dials) // _COLUMNS)
    columns = -(-len(dials) // rows)
    panels = artists.new_figure(2.6 * columns + 0.8, 2.9 * rows + 1.0).subplots(rows, columns, squeeze=False)
    colors = ListedColormap([color for _, color in artists.CLASSES])
    for ax, dial in zip(panels.flat, dials, strict=True):
        one, other = states[space.rotations.cells_of(dial.rotations)]
        shown.append(artists.classes_at(ground, np.where(one == MIXED, other, one)))
        picture = np.zeros(dial.inside.shape, np.uint8)
        picture[dial.inside] = shown[-1]
        most, seen = len(artists.CLASSES) - 1, dial.inside.astype(float)
        ax.imshow(
            picture,
            colors,
            vmin=0,
            vmax=most,
            alpha=seen,
            extent=(-1, 1, -1, 1),
            origin="lower",
            interpolation="nearest",
        )
        ax.set_title(dial.title, fontsize=9)
        ax.set_axis_off()
        ax.contour(*_places(), dial.inside, [0.5], colors="black", linewidths=0.7)
        for label, x, y in dial.marks:
            ax.text(x, y, label, fontsize=8, ha="center", va="center", path_effects=[artists.halo(1.6)])
    first: Axes = panels.flat[0]
    place = ", ".join(f"{value + 0.0:.4g}" for value in point)
    box = np.array([grid.lower, grid.upper])
    artists.annotate(
        first,
        space,
        look,
        np.ones(grid.dim),
        f"all rotations at ({place}) m",
        artists.cell_legend(shown, space, box),
    )
    return first


def _places() -> Floats:
    """x and y of the middles of the pixels of a dial, shape (2, n, n)."""
    across = (np.arange(_PIXELS) + 0.5) * 2.0 / _PIXELS - 1.0
    return np.array(np.meshgrid(across, across))


def _ring() -> list[Dial]:
    """Yaws, from the x axis on, to the left."""
    x, y = _places()
    inside = (np.hypot(x, y) <= 1.0) & (np.hypot(x, y) >= _HOLE)
    marks = [(f"{k * 45}°", k * np.pi / 4.0) for k in range(8)]
    around = tuple((label, 1.14 * float(np.cos(angle)), 1.14 * float(np.sin(angle))) for label, angle in marks)
    return [Dial("", inside, (np.arctan2(y, x)[inside] + _APART)[..., None], (("yaw", 0.0, 0.0), *around))]


def _discs() -> list[Dial]:
    """All rotations: after a turn about z, the robot is tipped over, by no turn in the middle up to half a one."""
    from scipy.spatial.transform import Rotation

    x, y = _places()
    inside = np.hypot(x, y) <= 1.0
    tips = Rotation.from_rotvec(np.pi * np.column_stack([-y[inside], x[inside], np.zeros(inside.sum())]))
    marks = (("upright", 0.0, 0.0), ("over x", 0.72, 0.0), ("over y", 0.0, 0.72))
    dials = []
    for degrees in _HEADINGS:
        turns = Rotation.from_euler("z", np.radians(degrees) + _APART)
        rotations = np.array([(tips * turn).as_quat() for turn in turns])
        dials.append(Dial(f"heading {degrees}°", inside, rotations, () if degrees else marks))
    return dials


_DIALS: Final[dict[tuple[str, ...], Callable[[], list[Dial]]]] = {
    ("yaw",): _ring,
    ("qx", "qy", "qz", "qw"): _discs,
}
"""By the names of the numbers of a rotation."""
