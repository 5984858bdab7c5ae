"""CSpace: the map of a robot's configurations, and everything that can be asked of it."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.batches import answer, answer_edges, as_points
from cspace.errors import InputError
from cspace.grid import Grid, finite
from cspace.once import Once
from cspace.outside import Outside
from cspace.plane import PlaneLookups
from cspace.raster.raster import Raster
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.slices import slice_of_rotation, slice_rasters
from cspace.states import BLOCKED, FREE
from cspace.turning.lookups import TurningLookups
from cspace.workspace import Workspace

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]


class CSpace:
    """Certified map of the configurations of a robot in the plane: ``(x, y)``, or ``(x, y, yaw)`` for one that turns.

    :func:`cspace.build` makes it and :func:`cspace.open` reads a saved one. Every look-up takes one configuration,
    shape (dof,), and answers with a Python number, or a batch, shape (..., dof), and answers with an array of shape
    (...). Look-ups are compiled and may be called from several threads at once. What they need beyond the map itself
    (distances, labels, sums) is computed at the first call and kept. Yaw is in radians, and wrapped.

    A configuration outside the grid is BLOCKED under ``outside="blocked"`` where the robot is proven to stick out of
    the workspace, FREE under ``outside="free"`` where it is proven to reach no obstacle, and otherwise MIXED.

    Parameters
    ----------
    workspace : Workspace
    robot : Robot
    state : ndarray of uint8, shape (nx, ny) or (slices, nx, ny)
        FREE, MIXED or BLOCKED, of each cell of positions of the robot's reference point; with rotations, of each slice.
        It is taken over, not copied.
    outside : {"blocked", "free"}
    margin : float
        Metres by which the robot was grown for FREE.
    precision : {"float32", "float64"}
        In which the transforms were run.
    overlaps : ndarray of int32, the shape of state, optional
        Overlap of each cell.
    rotations : Rotations, optional
        Rotation cells of a robot that turns.
    rasters : sequence of (outer, inner) Raster, optional
        The robot's, for each slice; made again if left out.

    Attributes
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny)
        The slices, as they are stored: one where the robot only translates.
    slice_of : ndarray of int64, shape (rotations,)
        Which slice each rotation cell has; turns that map the robot to itself share theirs.
    """

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
        rotations: Rotations | None = None,
        rasters: Sequence[tuple[Raster, Raster]] | None = None,
    ) -> None:
        self.slice_of = slice_of_rotation(robot, rotations)
        shape = workspace.grid.shape if rotations is None else (int(self.slice_of.max()) + 1, *workspace.grid.shape)
        for name, array, kind in (("state", state, np.uint8), ("overlaps", overlaps, np.int32)):
            if array is not None and (array.shape != shape or array.dtype != kind):
                raise InputError(
                    f"{name} has shape {array.shape} and type {array.dtype}; it must have the map's shape "
                    f"{shape} and type {np.dtype(kind)}; use cspace.build"
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
        self.rotations = rotations
        self.stack = _read_only(state).reshape(-1, *workspace.grid.shape)
        self.overlaps = None if overlaps is None else _read_only(overlaps)
        self._once = Once()
        if rasters is not None:
            self._once("rasters", lambda: list(rasters))

    @property
    def grid(self) -> Grid:
        """Cells of positions of the robot's reference point; the workspace's grid."""
        return self.workspace.grid

    @property
    def dof(self) -> int:
        """Numbers in a configuration: 2, or 3 for a robot that turns."""
        return 2 if self.rotations is None else 3

    @property
    def state(self) -> NDArray[np.uint8]:
        """State of each cell, shape (nx, ny) or (rotations, nx, ny).

        Read-only. A new array at each call where slices are shared; :attr:`stack` and :attr:`slice_of` cost nothing.
        """
        if self.rotations is None:
            plane: NDArray[np.uint8] = self.stack[0]
            return plane
        shared = len(self.stack) < len(self.slice_of)
        every: NDArray[np.uint8] = _read_only(self.stack[self.slice_of]) if shared else self.stack
        return every

    def slice_at(self, yaw: float = 0.0) -> NDArray[np.uint8]:
        """State of each cell in the rotation cell of a yaw (radians), shape (nx, ny)."""
        cell = 0 if self.rotations is None else int(self.rotations.cell_of(yaw))
        part: NDArray[np.uint8] = self.stack[self.slice_of[cell]]
        return part

    def count(self) -> tuple[int, int, int]:
        """Number of FREE, MIXED and BLOCKED cells, over all rotation cells."""
        shares = np.bincount(self.slice_of, minlength=len(self.stack))
        each = np.array([np.bincount(part.ravel(), minlength=3) for part in self.stack])
        free, mixed, blocked = (shares @ each).tolist()
        return free, mixed, blocked

    def __repr__(self) -> str:
        free, mixed, blocked = self.count()
        cells = " x ".join(map(str, self.grid.shape))
        turns = "" if self.rotations is None else f" x {self.rotations.count} rotations"
        return (
            f"CSpace({cells} cells of {self.grid.spacing:g} m{turns}, {self.robot.name}: {free=}, {mixed=}, {blocked=})"
        )

    # ---- one cell ----------------------------------------------------------------------------------------------------

    def classify(self, q: ArrayLike) -> Any:
        """State of configurations.

        Parameters
        ----------
        q : array-like, shape (dof,) or (..., dof)
            Metres, and radians.

        Returns
        -------
        int or ndarray of uint8, shape (...)
            FREE (0), MIXED (1) or BLOCKED (2).

        Raises
        ------
        InputError
            If the last axis is not 2 long, or a value is NaN or infinite.
        """
        return answer(q, self.dof, self._lookups.classify(), np.uint8, int)

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
        q : array-like, shape (dof,) or (..., dof)
            Metres, and radians.

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
        q : array-like, shape (dof,) or (..., dof)
            Metres, and radians.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        counts = np.array([outer.count for outer, _ in self._rasters])
        inside = operator.eq(self._sum("inner", q), counts[self._slices_of(q)])
        return inside if np.ndim(inside) else bool(inside)

    # ---- stretches ---------------------------------------------------------------------------------------------------

    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike) -> Any:
        """Whether straight edges are proven collision-free all along.

        True where every closed cell that the edge touches, be it in a corner, is FREE. An edge that lies on the border
        of two cells touches both; so an edge that starts on the border of a cell that is not FREE is not proven.

        Parameters
        ----------
        q0, q1 : array-like, shape (dof,) or (..., dof)
            Ends of the edges, metres and radians; broadcast against each other.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        return answer_edges(q0, q1, self.dof, self._lookups.edges())

    def is_free_around(self, q: ArrayLike, distance: float, angle: float = 0.0) -> Any:
        """Whether all configurations around configurations are proven collision-free.

        True where every closed cell is FREE that meets the box of all configurations within ``distance`` along x and
        along y, and within ``angle`` in yaw. Curves are proven with it, piece by piece.

        Parameters
        ----------
        q : array-like, shape (dof,) or (..., dof)
            Metres, and radians.
        distance : float
            Metres, zero or above.
        angle : float
            Radians, zero or above; plays no part where the robot does not turn.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        reach = [float(value) for value in finite([distance, angle], "distance and angle")]
        if min(reach) < 0.0:
            raise InputError(f"distance and angle are {reach}; both must be zero or above, in metres and radians")
        return answer(q, self.dof, self._lookups.boxes(*reach), np.bool_, bool)

    def clearance(self, q: ArrayLike) -> Any:
        """Lower bound of the distance, in the plane of translations, to the nearest configuration that is not FREE.

        The bound is proven, and less than one and a half cells below the distance itself. Zero where a configuration is
        not FREE; infinite where every configuration is.

        Parameters
        ----------
        q : array-like, shape (dof,) or (..., dof)
            Metres, and radians.

        Returns
        -------
        float or ndarray of float64, shape (...)
            Metres.
        """
        return answer(q, self.dof, self._lookups.clearances(), np.float64, float)

    def path_exists(self, q0: ArrayLike, q1: ArrayLike) -> Any:
        """Whether a collision-free path joins configurations.

        Parameters
        ----------
        q0, q1 : array-like, shape (dof,) or (..., dof)
            Metres, and radians; broadcast against each other.

        Returns
        -------
        True, False or None, or ndarray of object, shape (...)
            True: a chain of FREE cells joins them. False: no chain of FREE and MIXED cells does, which proves that no
            collision-free path exists. None: undecided at this resolution.
        """
        from cspace.connectivity import components, path_exists

        labels = self._once("components", lambda: components(self.stack, self.slice_of, self._rim_is_open()))
        ends = (self._checked(q0, "q0"), self._checked(q1, "q1"))
        return path_exists(labels, *((self._cells_of(q), np.asarray(self.classify(q))) for q in ends))

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
        ndarray of float64, shape (n, dof), or (dof,)
            Metres, and radians.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        InputError
            If ``n`` is negative or ``rng`` is not a Generator.
        """
        from cspace.sampling import check_rng, refuse_empty, sample_cells, sample_stack

        generator = check_rng(rng)
        if n is not None and (not isinstance(n, int | np.integer) or n < 0):
            raise InputError(f"n is {n!r}; it must be a whole number, zero or above, or None for one sample")
        refuse_empty(self._free_cells)
        count = 1 if n is None else int(n)
        if self.rotations is None:
            samples = sample_cells(self._free_cells[0], self.grid, count, generator)
        else:
            samples = sample_stack(self._free_cells, self.slice_of, self.rotations, self.grid, count, generator)
        return samples[0] if n is None else samples

    def nearest_free(self, q: ArrayLike) -> Floats:
        """Middle of the FREE cell nearest to a configuration.

        Parameters
        ----------
        q : array-like, shape (dof,)
            Metres and radians; may lie anywhere. Half a metre counts as much as a radian, as in OMPL's SE(2).

        Returns
        -------
        ndarray of float64, shape (dof,)

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        """
        from cspace.sampling import nearest_center, nearest_turned, refuse_empty

        refuse_empty(self._free_cells)
        point = self._checked(q, "q")
        if self.rotations is None:
            return nearest_center(self._free_cells[0], self.grid, point)
        return nearest_turned(self._free_cells, self.slice_of, self.rotations, self.grid, point)

    # ---- for callbacks -----------------------------------------------------------------------------------------------

    def point_checker(self) -> Callable[..., bool]:
        """A quick ``is_free`` of floats, for callbacks that are called a million times.

        Returns
        -------
        callable
            ``check(x, y) -> bool`` or ``check(x, y, yaw) -> bool``; the numbers must be finite floats, and are not
            checked.
        """
        return self._lookups.point_checker()

    def edge_checker(self) -> Callable[..., bool]:
        """A quick ``motion_is_free`` of the floats of two configurations, in one compiled call.

        Returns
        -------
        callable
            ``check(x0, y0, x1, y1) -> bool`` or ``check(x0, y0, yaw0, x1, y1, yaw1) -> bool``; the numbers must be
            finite floats, and are not checked.
        """
        return self._lookups.edge_checker()

    def clearance_checker(self) -> Callable[..., float]:
        """A quick ``clearance`` of floats, in one compiled call.

        Returns
        -------
        callable
            ``check(x, y) -> float`` or ``check(x, y, yaw) -> float``; the numbers must be finite floats, and are not
            checked.
        """
        return self._lookups.clearance_checker()

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
    def _rasters(self) -> list[tuple[Raster, Raster]]:
        return self._once("rasters", lambda: slice_rasters(self.robot, self.grid.spacing, self.margin, self.rotations))

    @property
    def _outsides(self) -> list[Outside]:
        outer = self.workspace.outer
        return self._once("outsides", lambda: [Outside.of(outer, *pair, self.outside) for pair in self._rasters])

    @property
    def _lookups(self) -> PlaneLookups | TurningLookups:
        return self._once("look-ups", self._make_lookups)

    def _make_lookups(self) -> PlaneLookups | TurningLookups:
        frame = _read_only(np.array([*self.grid.lower, self.grid.spacing, *self.grid.upper]))
        if self.rotations is None:
            return PlaneLookups(self.stack[0], frame, self._outsides[0])
        return TurningLookups(self.stack, self.slice_of, self.rotations, frame, self._outsides)

    @property
    def _free_cells(self) -> list[NDArray[np.int64]]:
        """Flat indices of the FREE cells of each slice."""
        return self._once("free cells", lambda: [np.flatnonzero(part == FREE) for part in self.stack])

    def _rim_is_open(self) -> NDArray[np.bool_]:
        """Whether some configuration outside the grid is not BLOCKED, for each slice."""
        return np.array([not outside.is_all_blocked(self.grid.shape) for outside in self._outsides])

    def _checked(self, q: ArrayLike, name: str) -> Floats:
        """Configurations as float64, all finite and of the right length."""
        points = as_points(q, name, self.dof)
        self.classify(points)  # raises where one is not finite
        return points

    def _slices_of(self, q: ArrayLike) -> NDArray[np.int64]:
        """Slice of each of a batch of configurations."""
        if self.rotations is None:
            return np.zeros(np.shape(q)[:-1], dtype=np.int64)
        part: NDArray[np.int64] = self.slice_of[self.rotations.cell_of(np.asarray(q, dtype=np.float64)[..., 2])]
        return part

    def _cells_of(self, points: Floats) -> NDArray[np.int64]:
        """Cells ``(rotation, x, y)`` of configurations, in the grid or not."""
        cells = self.grid.cell_of(points[..., :2])
        turn = (
            np.zeros(points.shape[:-1], np.int64) if self.rotations is None else self.rotations.cell_of(points[..., 2])
        )
        return np.concatenate([turn[..., None], cells], axis=-1)

    def _sum(self, side: str, q: ArrayLike) -> Any:
        from cspace.overlap import column_sums

        cells = self.workspace.outer if side == "outer" else self.workspace.inner
        key = "outer sums" if cells is self.workspace.outer else "inner sums"
        sums = self._once(key, lambda: column_sums(cells))
        rasters = [outer for outer, _ in self._rasters]
        kernel = self._lookups.overlaps(sums, rasters, int(self.outside == "blocked"))
        return answer(q, self.dof, kernel, np.int64, int)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
