"""CSpace: the map of a robot's configurations, and everything that can be asked of it."""

from __future__ import annotations

import operator
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.batches import answer, answer_edges, as_points
from cspace.errors import InputError
from cspace.exact.lookups import ExactLookups
from cspace.grid import finite
from cspace.plane import PlaneLookups
from cspace.stack import Stack, read_only
from cspace.states import FREE
from cspace.turning.lookups import TurningLookups

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]


class CSpace(Stack):
    """Certified map of the configurations of a robot in the plane: ``(x, y)``, or ``(x, y, yaw)`` for one that turns.

    :func:`cspace.build` makes it and :func:`cspace.open` reads a saved one. Every look-up takes one configuration,
    shape (dof,), and answers with a Python number, or a batch, shape (..., dof), and answers with an array of shape
    (...). Look-ups are compiled and may be called from several threads at once. What they need beyond the map itself
    (distances, labels, sums) is computed at the first call and kept. Yaw is in radians, and wrapped.

    A configuration outside the grid is BLOCKED under ``outside="blocked"`` where the robot is proven to stick out of
    the workspace, FREE under ``outside="free"`` where it is proven to reach no obstacle, and otherwise MIXED.
    """

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

    def is_free(self, q: ArrayLike, *, exact: bool = False) -> Any:
        """Whether configurations are proven collision-free; as :meth:`classify`, with bool for an answer.

        With ``exact``, the geometry itself decides in MIXED cells; see :mod:`cspace.exact.lookups`.
        """
        if exact:
            return answer(q, self.dof, self._exact.points(), np.bool_, bool)
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

    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike, *, exact: bool = False) -> Any:
        """Whether straight edges are proven collision-free all along.

        True where every closed cell that the edge touches, be it in a corner, is FREE. An edge that lies on the border
        of two cells touches both; so an edge that starts on the border of a cell that is not FREE is not proven.

        Parameters
        ----------
        q0, q1 : array-like, shape (dof,) or (..., dof)
            Ends of the edges, metres and radians; broadcast against each other.
        exact : bool
            Where cells are MIXED, let the geometry itself prove the edge; see :mod:`cspace.exact.lookups`.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        return answer_edges(q0, q1, self.dof, (self._exact if exact else self._lookups).edges())

    @property
    def exact_counts(self) -> dict[str, int]:
        """How many ``"point"`` and ``"edge"`` the geometry was asked for, and for how many ``"distance"`` in all."""
        return self._exact.counts

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

    def open_chain(self, q0: ArrayLike, q1: ArrayLike, closed: NDArray[np.bool_] | None = None) -> NDArray[np.int64]:
        """A chain of FREE and MIXED cells between two configurations, with as few MIXED ones as can be.

        Where :meth:`path_exists` is None, this is where a path has to be looked for with ``exact=True``.

        Parameters
        ----------
        q0, q1 : array-like, shape (dof,)
            Metres, and radians; in the grid.
        closed : ndarray of bool, shape (rotations, nx, ny), optional
            Cells that are left out; one rotation where the robot does not turn.

        Returns
        -------
        ndarray of int64, shape (n, 3)
            Cells ``(rotation, x, y)``, each sharing a side with the next; of length 0 where there is no chain.

        Raises
        ------
        InputError
            If a configuration is not one of the grid.
        """
        from cspace.connectivity import chain

        ends = [self._cells_of(self._checked(q, name)) for q, name in ((q0, "q0"), (q1, "q1"))]
        if any(end.shape != (3,) or (end[1:] < 0).any() or (end[1:] >= self.grid.shape).any() for end in ends):
            raise InputError(f"q0 and q1 are {q0!r} and {q1!r}; each must be one configuration in the grid")
        shut = np.zeros((len(self.slice_of), *self.grid.shape), dtype=np.bool_) if closed is None else closed
        return chain(self.stack, self.slice_of, shut, *ends)

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

    def point_checker(self, *, exact: bool = False) -> Callable[..., bool]:
        """A quick ``is_free`` of floats, for callbacks that are called a million times.

        Parameters
        ----------
        exact : bool
            As for :meth:`is_free`.

        Returns
        -------
        callable
            ``check(x, y) -> bool`` or ``check(x, y, yaw) -> bool``; the numbers must be finite floats, and are not
            checked.
        """
        quick = self._lookups.point_checker()
        return self._exact.point_checker(quick) if exact else quick

    def edge_checker(self, *, exact: bool = False) -> Callable[..., bool]:
        """A quick ``motion_is_free`` of the floats of two configurations, in one compiled call.

        Parameters
        ----------
        exact : bool
            As for :meth:`motion_is_free`.

        Returns
        -------
        callable
            ``check(x0, y0, x1, y1) -> bool`` or ``check(x0, y0, yaw0, x1, y1, yaw1) -> bool``; the numbers must be
            finite floats, and are not checked.
        """
        return (self._exact if exact else self._lookups).edge_checker()

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

    def export(self, path: str | Path, *, overwrite: bool = False, yaw: float | None = None) -> None:
        """Write for other programs, by suffix; see :func:`cspace.io.files.export`.

        The ROS map of a robot that turns holds the slice at ``yaw``, in radians.
        """
        from cspace.io.files import export

        export(self, path, overwrite=overwrite, yaw=yaw)

    def plot(self, **options: Any) -> Axes:
        """Draw the map; see :func:`cspace.plot.plot`. No window is opened."""
        from cspace.plot import plot

        return plot(self, **options)

    # ---- what is computed once ---------------------------------------------------------------------------------------

    @property
    def _lookups(self) -> PlaneLookups | TurningLookups:
        return self._once("look-ups", self._make_lookups)

    def _make_lookups(self) -> PlaneLookups | TurningLookups:
        frame = read_only(np.array([*self.grid.lower, self.grid.spacing, *self.grid.upper]))
        if self.rotations is None:
            return PlaneLookups(self.stack[0], frame, self._outsides[0])
        return TurningLookups(self.stack, self.slice_of, self.rotations, frame, self._outsides)

    @property
    def _exact(self) -> ExactLookups:
        return self._once("exact", lambda: ExactLookups(self, self._outsides))

    def _checked(self, q: ArrayLike, name: str) -> Floats:
        """Configurations as float64, all finite and of the right length."""
        points = as_points(q, name, self.dof)
        self.classify(points)  # raises where one is not finite
        return points

    def _sum(self, side: str, q: ArrayLike) -> Any:
        from cspace.overlap import column_sums

        cells = self.workspace.outer if side == "outer" else self.workspace.inner
        key = "outer sums" if cells is self.workspace.outer else "inner sums"
        sums = self._once(key, lambda: column_sums(cells))
        rasters = [outer for outer, _ in self._rasters]
        kernel = self._lookups.overlaps(sums, rasters, int(self.outside == "blocked"))
        return answer(q, self.dof, kernel, np.int64, int)
