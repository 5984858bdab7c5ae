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

from cspace.errors import InputError
from cspace.grid import Grid
from cspace.raster.raster import Raster
from cspace.robot import Robot
from cspace.states import BLOCKED, FREE, MIXED
from cspace.threads import in_chunks
from cspace.workspace import Workspace

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

    from cspace.clearance import ClearanceField
    from cspace.connectivity import Components

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
        FREE, MIXED or BLOCKED, of each cell of positions of the robot's reference point.
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
        self._box, self._beyond = self._beyond_the_grid()
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

        return self._answer(q, np.uint8, int, partial(_kernels.classify, *self._map))

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

        starts, ends = self._points(q0, "q0"), self._points(q1, "q1")
        try:
            starts, ends = np.broadcast_arrays(starts, ends)
        except ValueError as error:
            raise InputError(
                f"q0 has shape {starts.shape} and q1 {ends.shape}; they must broadcast; pass batches of equal shape"
            ) from error
        shape = starts.shape[:-1]
        first, second = (np.ascontiguousarray(part.reshape(-1, 2)) for part in (starts, ends))
        out = np.empty(len(first), dtype=np.bool_)

        def work(start: int, stop: int) -> int:
            chunk = slice(start, stop)
            return int(_kernels.edges_are_free(*self._map, first[chunk], second[chunk], out[chunk]))

        bad = in_chunks(work, len(out), least=2_000)
        if bad >= 0:
            raise _not_finite(np.concatenate([first[bad], second[bad]]), "edge", bad)
        return out.reshape(shape) if shape else bool(out[0])

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
        fixed = (field.squares, *self._map, field.walls, field.some)
        return self._answer(q, np.float64, float, partial(_kernels.clearances, *fixed))

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
        (free0, open0), (free1, open1) = self._labels_at(q0, "q0"), self._labels_at(q1, "q1")
        joined = (free0 == free1) & (free0 > 0)
        apart = (open0 != open1) | (open0 == 0) | (open1 == 0)
        answer = np.full(joined.shape, None, dtype=object)
        answer[joined] = True
        answer[apart] = False
        return answer if answer.ndim else answer[()]

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
        table = self._once("table", lambda: np.pad(self.state, ((0, 1), (0, 1)), mode="edge").tobytes())
        (lower_x, lower_y), (upper_x, upper_y) = self.grid.lower, self.grid.upper
        spacing, row, outside = self.grid.spacing, self.grid.shape[1] + 1, self.is_free

        def check(x: float, y: float) -> bool:
            # The table's last row and column repeat the last cells, for points on the grid's upper border.
            if lower_x <= x <= upper_x and lower_y <= y <= upper_y:
                return not table[int((x - lower_x) / spacing) * row + int((y - lower_y) / spacing)]
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

        return partial(_kernels.edge_is_free, *self._map)

    def clearance_checker(self) -> Callable[[float, float], float]:
        """A quick ``clearance`` of two floats, in one compiled call.

        Returns
        -------
        callable
            ``check(x, y) -> float``; the numbers must be finite floats and are not checked.
        """
        from cspace import _kernels

        field = self._clearance
        return partial(_kernels.clearance_at, field.squares, *self._map, field.walls, field.some)

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
    def _map(self) -> tuple[NDArray[np.uint8], Floats, NDArray[np.int64], int]:
        return self.state, self._frame, self._box, self._beyond

    @property
    def _clearance(self) -> ClearanceField:
        from cspace.clearance import clearance_field

        return self._once("clearance", lambda: clearance_field(self.state, self._box, self._beyond))

    @property
    def _components(self) -> Components:
        from cspace.connectivity import components

        def make() -> Components:
            # The rim is BLOCKED only where every cell outside the grid is: where the box of others lies in the grid.
            box, last = self._box, np.asarray(self.grid.shape) - 1
            in_grid = (box[:2] >= 0).all() and (box[2:] <= last).all()
            empty = (box[:2] > box[2:]).any()
            return components(self.state, rim_is_open=not (self._beyond == BLOCKED and (in_grid or empty)))

        return self._once("components", make)

    @property
    def _free_cells(self) -> NDArray[np.int64]:
        return self._once("free cells", lambda: np.flatnonzero(self.state == FREE))

    def _labels_at(self, q: ArrayLike, name: str) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Component labels of configurations, FREE and open; 0 where they belong to none."""
        points = self.grid.coordinates(q, name)
        cells = self.grid.cell_of(points)
        on_rim = np.clip(cells, -1, self.grid.shape) + 1
        inside = ((cells >= 0) & (cells < self.grid.shape)).all(axis=-1)
        free = self._components.free[tuple(np.moveaxis(np.where(inside[..., None], cells, 0), -1, 0))]
        passable = self._components.open[tuple(np.moveaxis(on_rim, -1, 0))]
        blocked = np.asarray(self.classify(points)) == BLOCKED
        return np.where(inside, free, 0), np.where(blocked, 0, passable)

    def _sum(self, side: str, q: ArrayLike) -> Any:
        from cspace import _kernels
        from cspace.overlap import column_sums, raster_runs

        cells = self.workspace.outer if side == "outer" else self.workspace.inner
        key = "outer" if cells is self.workspace.outer else "inner"
        sums = self._once(f"{key} sums", lambda: column_sums(cells))
        runs = self._once("runs", lambda: raster_runs(self._rasters[0]))
        fixed = (sums, self._frame, runs, int(self.outside == "blocked"))
        return self._answer(q, np.int64, int, partial(_kernels.overlaps_at, *fixed))

    def _once(self, key: str, make: Callable[[], T]) -> T:
        """What ``make`` gives, made at the first call, by one thread."""
        if key not in self._made:
            with self._lock:
                if key not in self._made:
                    self._made[key] = make()
        value: T = self._made[key]
        return value

    def _points(self, q: ArrayLike, name: str) -> Floats:
        """``q`` as float64 with its last axis checked; whether it is finite is left to the kernels."""
        try:
            points = np.asarray(q, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"{name} is {q!r}; it must be numeric; pass coordinates in metres") from error
        return points if points.ndim and points.shape[-1] == self.dof else self.grid.coordinates(points, name)

    def _answer(self, q: ArrayLike, dtype: type[Any], scalar: Callable[[Any], T], kernel: Callable[..., int]) -> Any:
        """Run a kernel over configurations and answer in kind."""
        points = self._points(q, "q")
        flat = np.ascontiguousarray(points.reshape(-1, self.dof))
        out = np.empty(len(flat), dtype=dtype)
        bad = in_chunks(lambda start, stop: int(kernel(flat[start:stop], out[start:stop])), len(flat))
        if bad >= 0:
            raise _not_finite(flat[bad], "q", bad)
        return out.reshape(points.shape[:-1]) if points.ndim > 1 else scalar(out[0])

    def _beyond_the_grid(self) -> tuple[NDArray[np.int64], int]:
        """What lies outside the grid, as :mod:`cspace._kernels` has it."""
        outer, inner = self._rasters
        if self.outside == "blocked":
            # BLOCKED is proven where an inner offset falls beyond the workspace.
            return _box((0, 0), self.grid.shape, inner), BLOCKED if inner.count else MIXED
        obstacles = Raster.trimmed(self.workspace.outer, (0, 0))
        if not obstacles.count:
            return np.array([0, 0, -1, -1]), FREE
        # FREE is proven where no outer offset can fall on the bounding box of the obstacles.
        low, high = np.asarray(obstacles.lower), np.asarray(obstacles.upper)
        return np.array([*(low - outer.upper), *(high - outer.lower)]), FREE


def _box(low: tuple[int, ...], shape: tuple[int, ...], inner: Raster) -> NDArray[np.int64]:
    """Cells at which all inner offsets fall on the grid."""
    first = np.asarray(low) - inner.lower
    last = np.asarray(shape) - 1 - inner.upper
    return np.array([*first, *last])


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array


def _not_finite(values: Floats, name: str, index: int) -> InputError:
    return InputError(
        f"{name} number {index} is {tuple(values.tolist())}; NaN and infinities are refused; drop or replace them first"
    )
