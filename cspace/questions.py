"""What can be asked of a map, configuration by configuration and edge by edge."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.batches import Kernel, answer, answer_edges, answer_pairs, as_points
from cspace.errors import ConfigurationError, InputError
from cspace.exact.queries import Exact
from cspace.grid import finite, unmasked
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

        With ``exact``, the geometry itself decides in MIXED cells; see :mod:`cspace.exact`.
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
            Where cells are MIXED, let the geometry itself prove the edge; see :mod:`cspace.exact`.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        return answer_edges(q0, q1, self.dof, lambda number: self._edges(number, exact))

    def certify_path(self, path: ArrayLike, edges: ArrayLike | None = None, *, exact: bool = False) -> Any:
        """Whether each edge of a path, of paths, or of a roadmap is proven collision-free all along.

        The edges are those of :meth:`motion_is_free`, answered alike: straight, with yaw along the shorter arc, as
        OMPL interpolates. Where there are many, they are proven in threads and with a coarse map that passes over free
        space in larger steps; the answers are the same.

        Parameters
        ----------
        path : array-like, shape (n, dof) or (..., n, dof)
            Configurations, metres and radians: a path's in turn, those of paths of one length, or a roadmap's vertices.
        edges : array-like of int, shape (m, 2), optional
            Indices, from 0, of the two vertices of each edge; ``path`` must then have shape (n, dof). Left out, each
            configuration is joined to the next.
        exact : bool
            As for :meth:`motion_is_free`.

        Returns
        -------
        ndarray of bool, shape (n - 1,), (..., n - 1) or (m,)
            A path of one configuration has no edges, and nothing is proven of it.

        Raises
        ------
        InputError
            If a configuration is not as for :meth:`motion_is_free`, be it on an edge or not; a path has none; or an
            edge is not a pair of indices of vertices.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
        >>> corners = [(0.5, 1.5), (0.5, 2.5), (1.5, 2.5), (1.5, 0.5)]
        >>> space.certify_path(corners)
        array([ True,  True, False])
        >>> space.certify_path(corners, [(0, 2), (2, 3)])
        array([ True, False])
        """
        points = self._checked(path, "path")
        if edges is not None:
            pairs = _pairs(edges, points)
            return answer_pairs(np.ascontiguousarray(points), pairs, self._edges(len(pairs), exact))
        if points.ndim < 2 or points.shape[-2] == 0:
            raise InputError(
                f"path has shape {points.shape}; it must hold at least one configuration in a row; "
                f"pass an array of shape (n, {self.dof})"
            )
        return self.motion_is_free(points[..., :-1, :], points[..., 1:, :], exact=exact)

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
    def _exact(self) -> Exact:
        return self._once("exact", lambda: Exact(self, self._outsides))

    def _edges(self, number: int, exact: bool) -> Kernel:
        return self._exact.edges() if exact else self._lookups.edges(number)

    def _checked(self, q: ArrayLike, name: str) -> Floats:
        """Configurations as float64, all finite and of the right length."""
        points = as_points(q, name, self.dof)
        answer(points, self.dof, self._lookups.classify(), np.uint8, int, name)  # raises where one is not finite
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


def _pairs(edges: ArrayLike, vertices: Floats) -> NDArray[np.int64]:
    """Edges as pairs of indices of vertices, checked."""
    unmasked(edges, "edges")
    try:
        pairs = np.asarray(edges)
    except ValueError as error:
        raise InputError(f"edges is {edges!r}; it must be pairs of vertices; pass indices of shape (m, 2)") from error
    pairs = pairs.astype(np.int64).reshape(0, 2) if pairs.size == 0 else pairs
    if pairs.dtype.kind not in "iu" or pairs.ndim != 2 or pairs.shape[1] != 2 or vertices.ndim != 2:
        raise InputError(
            f"edges has shape {pairs.shape} and type {pairs.dtype}, for vertices of shape {vertices.shape}; each edge "
            "must be two whole numbers, and vertices a list of configurations; pass shapes (m, 2) and (n, dof)"
        )
    wrong = (pairs < 0) | (pairs >= len(vertices))
    if wrong.any():
        number = int(np.argwhere(wrong)[0, 0])
        raise InputError(
            f"edge number {number} is {tuple(pairs[number].tolist())}; there are {len(vertices)} vertices, counted "
            f"from 0; pass indices from 0 to {len(vertices) - 1}"
        )
    return pairs.astype(np.int64, copy=False)
