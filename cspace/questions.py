"""What can be asked of a map, configuration by configuration and edge by edge."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.batches import answer, answer_edges, as_points
from cspace.errors import ConfigurationError, InputError
from cspace.exact.lookups import ExactLookups
from cspace.exact.solids import SolidLookups
from cspace.grid import finite
from cspace.plane import PlaneLookups
from cspace.spatial.lookups import SpatialLookups
from cspace.stack import Stack, read_only
from cspace.states import FREE
from cspace.turning.lookups import TurningLookups

Floats = NDArray[np.float64]


class Questions(Stack):
    """Look-ups in a map; each takes one configuration, shape (dof,), or a batch, shape (..., dof).

    They are compiled and may be called from several threads at once.
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
            If the last axis is not dof long, or a value is NaN or infinite.
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
        with the depth of the collision; times ``spacing**d`` an area or a volume. Cells beyond the workspace count
        under ``outside="blocked"``. Nothing needs to be stored: the robot's rows are summed at each configuration.

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

        True where every closed cell is FREE that meets the box of all configurations within ``distance`` along each
        axis, and within ``angle`` in yaw. Curves are proven with it, piece by piece.

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
        """Lower bound of the distance, in the translation, to the nearest configuration that is not FREE.

        The bound is proven, and less than one and a half cells below the distance itself (1.8 in space). Zero where a
        configuration is not FREE; infinite where every configuration is.

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
            ``check(*q) -> bool``, of the dof numbers of a configuration; the numbers must be finite floats, and are not
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
            ``check(*q0, *q1) -> bool``, of the numbers of two configurations; they must be finite floats, and are not
            checked.
        """
        return (self._exact if exact else self._lookups).edge_checker()

    def clearance_checker(self) -> Callable[..., float]:
        """A quick ``clearance`` of floats, in one compiled call.

        Returns
        -------
        callable
            ``check(*q) -> float``, of the dof numbers of a configuration; they must be finite floats, and are not
            checked.
        """
        return self._lookups.clearance_checker()

    # ---- what is computed once ---------------------------------------------------------------------------------------

    @property
    def _lookups(self) -> PlaneLookups | TurningLookups | SpatialLookups:
        return self._once("look-ups", self._make_lookups)

    def _make_lookups(self) -> PlaneLookups | TurningLookups | SpatialLookups:
        frame = read_only(np.array([*self.grid.lower, self.grid.spacing, *self.grid.upper]))
        if self.grid.dim == 3:
            return SpatialLookups(self.stack[0], frame, self._outsides[0])
        if self.rotations is None:
            return PlaneLookups(self.stack[0], frame, self._outsides[0])
        return TurningLookups(self.stack, self.slice_of, self.rotations, frame, self._outsides)

    @property
    def _exact(self) -> ExactLookups | SolidLookups:
        kind = SolidLookups if self.grid.dim == 3 else ExactLookups
        return self._once("exact", lambda: kind(self, self._outsides))

    def _checked(self, q: ArrayLike, name: str) -> Floats:
        """Configurations as float64, all finite and of the right length."""
        points = as_points(q, name, self.dof)
        self.classify(points)  # raises where one is not finite
        return points

    def _one_free(self, q: ArrayLike, name: str) -> Floats:
        """One FREE configuration in the grid."""
        point = self._checked(q, name)
        if point.ndim != 1 or not self.grid.contains(point[: self.grid.dim]) or not self.is_free(point):
            raise ConfigurationError(
                f"{name} is {q!r}; it must be one FREE configuration in the grid; ask nearest_free for one"
            )
        return point

    def _sum(self, side: str, q: ArrayLike) -> Any:
        from cspace.overlap import column_sums

        cells = self.workspace.outer if side == "outer" else self.workspace.inner
        key = "outer sums" if cells is self.workspace.outer else "inner sums"
        sums = self._once(key, lambda: column_sums(cells))
        rasters = [outer for outer, _ in self._rasters]
        kernel = self._lookups.overlaps(sums, rasters, int(self.outside == "blocked"))
        return answer(q, self.dof, kernel, np.int64, int)
