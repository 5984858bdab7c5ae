"""CSpace: the map of a robot's configurations, and everything that can be asked of it."""

from __future__ import annotations

import operator
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.batches import answer, answer_edges
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.outside import Outside
from cspace.robot import Robot
from cspace.states import BLOCKED, FREE
from cspace.workspace import Workspace

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

    from cspace.clearance import ClearanceField

T = TypeVar("T")
Floats = NDArray[np.float64]


class CSpace:
    """Certified map of the configurations ``(x, y)`` of a robot that translates in the plane.

    :func:`cspace.build` makes it and :func:`cspace.open` reads a saved one. Every look-up takes one configuration,
    shape (2,), and answers with a Python number, or a batch, shape (..., 2), and answers with an array of shape (...).
    Look-ups are compiled and may be called from several threads at once. What they need beyond the map itself
    (distances, labels, sums) is computed at the first call and kept.

    A configuration outside the grid is BLOCKED under ``outside="blocked"`` where the robot is proven to stick out of
    the workspace, FREE under ``outside="free"`` where it is proven to reach no obstacle, and otherwise MIXED.

    Parameters
    ----------
    workspace : Workspace
    robot : Robot
    state : ndarray of uint8, shape workspace.grid.shape
        FREE, MIXED or BLOCKED, of each cell of positions of the robot's reference point. It is taken over, not copied.
    outside : {"blocked", "free"}
    margin : float
        Metres by which the robot was grown for FREE.
    precision : {"float32", "float64"}
        In which the transforms were run.
    overlaps : ndarray of int32, shape workspace.grid.shape, optional
        Overlap of each cell.
    """

    rotations = None
    dof = 2

    def __init__(
        self,
        workspace: Workspace,
        robot: Robot,
        state: NDArray[np.uint8],
        *,
        outside: str,
        margin: float,
        precision: str,
        overlaps: NDArray[np.int32] | None = None,
    ) -> None:
        for name, array, kind in (("state", state, np.uint8), ("overlaps", overlaps, np.int32)):
            if array is not None and (array.shape != workspace.grid.shape or array.dtype != kind):
                raise InputError(
                    f"{name} has shape {array.shape} and type {array.dtype}; it must have the grid's shape "
                    f"{workspace.grid.shape} and type {np.dtype(kind)}; use cspace.build"
                )
        if outside not in ("blocked", "free"):
            raise InputError(f"outside is {outside!r}; it must be 'blocked' or 'free'")
        if state.size and state.max() > BLOCKED:
            raise InputError(f"state holds {state.max()}; it must be FREE, MIXED or BLOCKED, 0 to 2; use cspace.build")
        self.workspace = workspace
        self.robot = robot
        self.outside = outside
        self.margin = margin
        self.precision = precision
        self.state = _read_only(state)
        self.overlaps = None if overlaps is None else _read_only(overlaps)
        grid = workspace.grid
        self._frame = _read_only(np.array([*grid.lower, grid.spacing, *grid.upper]))
        self._rasters = robot.rasters(grid.spacing, margin)
        self._beyond = Outside.of(workspace.outer, *self._rasters, outside)
        self._map = (self.state, self._frame, self._beyond.box, self._beyond.state)
        self._walls = self._beyond.walls(grid.shape)
        self._made: dict[str, Any] = {}
        self._lock = threading.RLock()

    @property
    def grid(self) -> Grid:
        """Cells of positions of the robot's reference point; the workspace's grid."""
        return self.workspace.grid

    def __repr__(self) -> str:
        free, mixed, blocked = (int(n) for n in np.bincount(self.state.ravel(), minlength=3))
        cells = " x ".join(map(str, self.grid.shape))
        return f"CSpace({cells} cells of {self.grid.spacing:g} m, {self.robot.name}: {free=}, {mixed=}, {blocked=})"

    # ---- one cell ----------------------------------------------------------------------------------------------------

    def classify(self, q: ArrayLike) -> Any:
        """State of configurations.

        Parameters
        ----------
        q : array-like, shape (2,) or (..., 2)
            Metres.

        Returns
        -------
        int or ndarray of uint8, shape (...)
            FREE (0), MIXED (1) or BLOCKED (2).

        Raises
        ------
        InputError
            If the last axis is not 2 long, or a value is NaN or infinite.
        """
        from cspace import _kernels

        return answer(q, partial(_kernels.classify, *self._map), np.uint8, int)

    def is_free(self, q: ArrayLike) -> Any:
        """Whether configurations are proven collision-free; as :meth:`classify`, with bool for an answer."""
        return operator.eq(self.classify(q), FREE)

    def overlap(self, q: ArrayLike) -> Any:
        """Number of (obstacle cell, robot offset) pairs that coincide at configurations.

        The count is that of the outer rasters: in the grid it is zero exactly where a configuration is FREE, and grows
        with the depth of the collision; times ``spacing**2`` an area. Cells beyond the workspace count under
        ``outside="blocked"``. Nothing needs to be stored: the robot's rows are summed at each configuration.

        Parameters
        ----------
        q : array-like, shape (2,) or (..., 2)
            Metres.

        Returns
        -------
        int or ndarray of int64, shape (...)
        """
        return self._sum("outer", q)

    def contains_robot(self, q: ArrayLike) -> Any:
        """Whether the robot is proven to lie wholly inside the obstacles at configurations.

        This is the packing question: with the obstacles a container's cavity or a sheet of material, True means that
        the robot fits in there, margin included. False means that it is not proven at this resolution.

        Parameters
        ----------
        q : array-like, shape (2,) or (..., 2)
            Metres.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        return operator.eq(self._sum("inner", q), self._rasters[0].count)

    # ---- stretches ---------------------------------------------------------------------------------------------------

    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike) -> Any:
        """Whether straight edges are proven collision-free all along.

        True where every closed cell that the edge touches, be it in a corner, is FREE. An edge that lies on the border
        of two cells touches both; so an edge that starts on the border of a cell that is not FREE is not proven.

        Parameters
        ----------
        q0, q1 : array-like, shape (2,) or (..., 2)
            Ends of the edges, metres; broadcast against each other.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        from cspace import _kernels

        return answer_edges(q0, q1, partial(_kernels.edges_are_free, *self._map))

    def clearance(self, q: ArrayLike) -> Any:
        """Lower bound of the distance, in the plane of translations, to the nearest configuration that is not FREE.

        The bound is proven, and less than one and a half cells below the distance itself. Zero where a configuration is
        not FREE; infinite where every configuration is.

        Parameters
        ----------
        q : array-like, shape (2,) or (..., 2)
            Metres.

        Returns
        -------
        float or ndarray of float64, shape (...)
            Metres.
        """
        from cspace import _kernels

        field = self._clearance
        fixed = (field.squares, *self._map, self._walls, field.some)
        return answer(q, partial(_kernels.clearances, *fixed), np.float64, float)

    def path_exists(self, q0: ArrayLike, q1: ArrayLike) -> Any:
        """Whether a collision-free path joins configurations.

        Parameters
        ----------
        q0, q1 : array-like, shape (2,) or (..., 2)
            Metres; broadcast against each other.

        Returns
        -------
        True, False or None, or ndarray of object, shape (...)
            True: a chain of FREE cells joins them. False: no chain of FREE and MIXED cells does, which proves that no
            collision-free path exists. None: undecided at this resolution.
        """
        from cspace.connectivity import components, path_exists

        rim_is_open = not self._beyond.is_all_blocked(self.grid.shape)
        labels = self._once("components", lambda: components(self.state, rim_is_open))
        ends = (self.grid.coordinates(q0, "q0"), self.grid.coordinates(q1, "q1"))
        return path_exists(labels, *((self.grid.cell_of(q), np.asarray(self.classify(q))) for q in ends))

    # ---- the set of FREE configurations ------------------------------------------------------------------------------

    def sample_free(self, n: int | None = None, rng: np.random.Generator | None = None) -> Floats:
        """Configurations drawn uniformly from the FREE cells.

        Parameters
        ----------
        n : int, optional
            How many; one, without a batch axis, if left out.
        rng : numpy.random.Generator
            Source of randomness; required, so that a run can be repeated.

        Returns
        -------
        ndarray of float64, shape (n, 2), or (2,)
            Metres.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        InputError
            If ``n`` is negative or ``rng`` is not a Generator.
        """
        from cspace.sampling import check_rng, refuse_empty, sample_cells

        generator = check_rng(rng)
        if n is not None and (not isinstance(n, int | np.integer) or n < 0):
            raise InputError(f"n is {n!r}; it must be a whole number, zero or above, or None for one sample")
        refuse_empty(self._free_cells)
        samples = sample_cells(self._free_cells, self.grid, 1 if n is None else int(n), generator)
        return samples[0] if n is None else samples

    def nearest_free(self, q: ArrayLike) -> Floats:
        """Middle of the FREE cell nearest to a configuration.

        Parameters
        ----------
        q : array-like, shape (2,)
            Metres; may lie anywhere.

        Returns
        -------
        ndarray of float64, shape (2,)
            Metres.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        """
        from cspace.sampling import nearest_center, refuse_empty

        refuse_empty(self._free_cells)
        return nearest_center(self._free_cells, self.grid, self.grid.coordinates(q, "q"))

    # ---- for callbacks -----------------------------------------------------------------------------------------------

    def point_checker(self) -> Callable[[float, float], bool]:
        """A quick ``is_free`` of two floats, for callbacks that are called a million times.

        Returns
        -------
        callable
            ``check(x, y) -> bool``; the numbers must be floats and are not checked.
        """
        # The last row and column stand twice, for points on the grid's upper border.
        rows = self._once("rows", lambda: [row.tobytes() for row in np.pad(self.state, ((0, 1), (0, 1)), mode="edge")])
        (lower_x, lower_y), (upper_x, upper_y) = self.grid.lower, self.grid.upper
        spacing, outside = self.grid.spacing, self.is_free

        def check(x: float, y: float) -> bool:
            if lower_x <= x <= upper_x and lower_y <= y <= upper_y:
                return not rows[int((x - lower_x) / spacing)][int((y - lower_y) / spacing)]
            return bool(outside((x, y)))

        return check

    def edge_checker(self) -> Callable[[float, float, float, float], bool]:
        """A quick ``motion_is_free`` of four floats, in one compiled call.

        Returns
        -------
        callable
            ``check(x0, y0, x1, y1) -> bool``; the numbers must be finite floats and are not checked.
        """
        from cspace import _kernels

        return self._once("edges", lambda: _entry(_kernels.edge_is_free, self._map, 4))

    def clearance_checker(self) -> Callable[[float, float], float]:
        """A quick ``clearance`` of two floats, in one compiled call.

        Returns
        -------
        callable
            ``check(x, y) -> float``; the numbers must be finite floats and are not checked.
        """
        from cspace import _kernels

        field = self._clearance
        fixed = (field.squares, *self._map, self._walls, field.some)
        return self._once("clearances", lambda: _entry(_kernels.clearance_at, fixed, 2))

    # ---- files and pictures ------------------------------------------------------------------------------------------

    def to_xarray(self) -> xarray.Dataset:
        """The map with named dimensions, coordinates and units; see :func:`cspace.io.labelled.to_xarray`."""
        from cspace.io.labelled import to_xarray

        return to_xarray(self)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Save as a Zarr folder, which :func:`cspace.open` reads; see :func:`cspace.io.files.save`."""
        from cspace.io.files import save

        save(self, path, overwrite=overwrite)

    def export(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write for other programs, by suffix; see :func:`cspace.io.files.export`."""
        from cspace.io.files import export

        export(self, path, overwrite=overwrite)

    def plot(self, **options: Any) -> Axes:
        """Draw the map; see :func:`cspace.plot.plot`. No window is opened."""
        from cspace.plot import plot

        return plot(self, **options)

    # ---- what is computed once ---------------------------------------------------------------------------------------

    @property
    def _clearance(self) -> ClearanceField:
        from cspace.clearance import clearance_field

        return self._once("clearance", lambda: clearance_field(self.state))

    @property
    def _free_cells(self) -> NDArray[np.int64]:
        return self._once("free cells", lambda: np.flatnonzero(self.state == FREE))

    def _sum(self, side: str, q: ArrayLike) -> Any:
        from cspace import _kernels
        from cspace.overlap import column_sums, raster_runs

        cells = self.workspace.outer if side == "outer" else self.workspace.inner
        key = "outer" if cells is self.workspace.outer else "inner"
        sums = self._once(f"{key} sums", lambda: column_sums(cells))
        runs = self._once("runs", lambda: raster_runs(self._rasters[0]))
        fixed = (sums, self._frame, runs, int(self.outside == "blocked"))
        return answer(q, partial(_kernels.overlaps_at, *fixed), np.int64, int)

    def _once(self, key: str, make: Callable[[], T]) -> T:
        """What ``make`` gives, made at the first call, by one thread."""
        if key not in self._made:
            with self._lock:
                if key not in self._made:
                    self._made[key] = make()
        value: T = self._made[key]
        return value


def _entry(kernel: Any, fixed: tuple[Any, ...], floats: int) -> Callable[..., Any]:
    """A kernel with its first arguments bound and some floats to come, without numba's dispatch on every call."""
    import numba

    types = (*map(numba.typeof, fixed), *[numba.float64] * floats)
    kernel.compile(types)
    return partial(kernel.get_overload(types), *fixed)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
