"""Queries of all certified maps, in memory or in tiles."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import FREE, MIXED, Bools, Floats, Ints
from cspace.check import check_not_negative
from cspace.configuration_space import ConfigurationSpace
from cspace.grid import Grid
from cspace.map.batches import (
    MIN_EDGES_PER_THREAD,
    Configuration,
    ConfigurationBatch,
    Kernel,
    Query,
    as_points,
    evaluate_batch,
)
from cspace.map.storage import read_only
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.rotations.base import warn_of_degrees
from cspace.shown import MapPlot
from cspace.threads import MIN_ITEMS_PER_THREAD

if TYPE_CHECKING:
    from cspace.exact.proofs import ExactQueries
    from cspace.map.contents import Contents


Result = TypeVar("Result")


class Backend(Protocol):
    """Cells of a map, over which compiled kernels run."""

    def query(self, kernel: Kernel, *arguments: Any, least: int = MIN_ITEMS_PER_THREAD) -> Query:
        """Return a query that runs a kernel.

        It runs over the rows of a batch. The kernel is called as ``kernel(map_, *arguments, *rows,
        out)`` with the record of the map. Each thread gets at least ``least`` rows.
        """

    def at_one_moment(self, work: Callable[[], Result]) -> Result:
        """Run ``work`` on a consistent state of the map."""


class Components(Protocol):
    """Connected components of cells that share sides."""

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the component of each cell.

        Components consist of FREE cells, or of FREE and MIXED cells; -1 outside these.
        """


class ConfigurationMap(ConfigurationSpace, MapPlot):
    """A certified map of a robot's configurations.

    :class:`cspace.CSpace` has its cells in memory, :class:`cspace.TiledCSpace` reads them from a
    store. Queries run compiled kernels over the cells through a :class:`Backend`.
    """

    # ---- what the map is -------------------------------------------------------------------------

    @property
    @abstractmethod
    def _kept(self) -> Contents:
        """Contents of the map in memory, or what all tiles of a map share."""

    @property
    def grid(self) -> Grid:
        """Grid of the robot's positions.

        It is the grid of the positions of the reference point, and equals the workspace's grid.
        """
        return self._kept.grid

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self._kept.robot

    @property
    def rotations(self) -> Rotations:
        """Rotation cells; a single one if the robot does not rotate."""
        return self._kept.rotations

    @property
    def slice_of(self) -> Ints:
        """Slice of each rotation cell, shape (rotation cells,); read-only.

        Rotation cells share a slice if a symmetry of the robot maps one to the other.
        """
        return read_only(self._kept.slice_of)

    @property
    def slice_rotations(self) -> Floats:
        """One rotation of each slice.

        It has the form that it has in a configuration: shape (slices, k), where k is 0, 1 or 4.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.rectangle(0.4, 0.2), rotations=8)
        >>> space.slice_of.tolist()
        [0, 1, 2, 3, 0, 1, 2, 3]
        >>> len(space.slice_rotations)
        4
        """
        return self.rotations.centers[np.unique(self.slice_of, return_index=True)[1]]

    @property
    def outside(self) -> str:
        """State of space outside the workspace.

        It is "blocked", "free", or "unknown" around a part of a larger map.
        """
        return self._kept.outside

    @property
    def margin(self) -> float:
        """Metres by which the robot was grown to prove FREE."""
        return self._kept.margin

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the coordinates of a configuration.

        They are x, y, in space z, then yaw or qx, qy, qz, qw.
        """
        return (*self.grid.axes, *self.rotations.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates of a configuration.

        They are "m", "rad", or "1" for a quaternion.
        """
        return (*self.grid.units, *self.rotations.units)

    @property
    def dof(self) -> int:
        """Degrees of freedom.

        They are 2 or 3 for positions, plus 1 for a yaw or 3 for a rotation in space.
        """
        return self.size - ("qw" in self.rotations.names)  # a quaternion has norm 1

    @abstractmethod
    def count(self) -> tuple[int, int, int]:
        """Count the FREE, MIXED and BLOCKED cells over all rotation cells."""

    def __repr__(self) -> str:
        """Return the cells, the robot and a summary of the states."""
        cells = " x ".join(map(str, self.grid.shape))
        turns = f" x {self.rotations}" if self.rotations.names else ""
        size = f"{cells} cells of {self.grid.spacing:g} {self.grid.unit}{turns}"
        return f"{type(self).__name__}({size}, {self.robot.name}: {self._summary})"

    # ---- look-ups --------------------------------------------------------------------------------

    def _check_configurations(self, q: ArrayLike, name: str = "q") -> Floats:
        """Return configurations as an array, shape (..., size).

        Raises InputError if one is not usable.
        """
        points = as_points(q, name, self.size)
        evaluate_batch(
            points, self.size, self._classify(), np.uint8, int, name, self._angles
        )  # raises if one is not finite
        return points

    @overload
    def is_connected(self, q0: Configuration, q1: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_connected(self, q0: ConfigurationBatch, q1: ArrayLike) -> Bools: ...
    @overload
    def is_connected(self, q0: ArrayLike, q1: ConfigurationBatch) -> Bools: ...
    def is_connected(self, q0: ArrayLike, q1: ArrayLike) -> bool | Bools:
        """Return True if a collision-free path is proven to exist between configurations.

        The proof is a chain of FREE cells. False proves nothing: see :meth:`is_disconnected`.
        Components of cells are computed at the first call and cached; a tiled map caches them in
        its folder.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,) or (..., size)
            Metres, and radians; broadcast against each other.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        if isinstance(q0, tuple) and isinstance(q1, tuple):
            known = self._connection_of_one(q0, q1)
            if known is not None:
                return known[0]
        return _bool_or_array(self._connectivity(q0, q1)[0])

    @overload
    def is_disconnected(self, q0: Configuration, q1: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_disconnected(self, q0: ConfigurationBatch, q1: ArrayLike) -> Bools: ...
    @overload
    def is_disconnected(self, q0: ArrayLike, q1: ConfigurationBatch) -> Bools: ...
    def is_disconnected(self, q0: ArrayLike, q1: ArrayLike) -> bool | Bools:
        """Return True if configurations are proven disconnected.

        No collision-free path between them exists then. The proof is that no chain of FREE and
        MIXED cells joins them. If this and :meth:`is_connected` are both False, the map is too
        coarse to decide; plan with ``exact=True``, or build with a finer spacing.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,) or (..., size)
            Metres, and radians; broadcast against each other.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        if isinstance(q0, tuple) and isinstance(q1, tuple):
            known = self._connection_of_one(q0, q1)
            if known is not None:
                return known[1]
        return _bool_or_array(self._connectivity(q0, q1)[1])

    def _connection_of_one(
        self, q0: tuple[Any, ...], q1: tuple[Any, ...]
    ) -> tuple[bool, bool] | None:
        """Return whether two configurations are proven connected, or disconnected.

        None if only the look-up of arrays can answer or refuse.
        """
        return None

    def _connectivity(self, q0: ArrayLike, q1: ArrayLike) -> tuple[Bools, Bools]:
        """Return which pairs are proven connected or disconnected.

        The two masks have shape (...).
        """
        return self._at_one_moment(lambda: self._compute_connectivity(q0, q1))

    def _compute_connectivity(self, q0: ArrayLike, q1: ArrayLike) -> tuple[Bools, Bools]:
        """Compute :meth:`_connectivity` while no update changes the cells."""
        endpoints = [as_points(q, name, self.size) for q, name in ((q0, "q0"), (q1, "q1"))]
        both = np.concatenate([points.reshape(-1, self.size) for points in endpoints])
        states = np.empty(len(both), dtype=np.uint8)
        if self._classify()([both], states) >= 0:
            (
                self._check_configurations(q0, "q0"),
                self._check_configurations(q1, "q1"),
            )  # one of them raises
        for points, name in zip(endpoints, ("q0", "q1"), strict=True):
            if points.ndim == 1:
                warn_of_degrees(points, self._angles, name)
        cells, count = self._cells_of(both), endpoints[0].size // self.size

        def pairs(values: NDArray[Any]) -> list[NDArray[Any]]:
            halves = values[:count], values[count:]
            return [
                half.reshape(points.shape[:-1])
                for half, points in zip(halves, endpoints, strict=True)
            ]

        def find_joined(candidates: Bools, mixed: bool) -> Bools:
            """Return which candidate pairs share a component.

            Without candidates, no component is computed.
            """
            if not candidates.any():
                return candidates
            first, second = pairs(self._components.of(cells, mixed))
            return np.asarray(candidates & (first == second) & (first != -1))

        highest = np.maximum(*pairs(states))
        possible = np.asarray(highest <= MIXED)
        joined = find_joined(possible & (highest == FREE), mixed=False)
        open_pairs = find_joined(possible & ~joined, mixed=True)
        return np.asarray(joined), np.asarray(~(joined | open_pairs))

    @overload
    def is_free_around(self, q: Configuration, distance: float, angle: float = 0.0) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_free_around(
        self, q: ConfigurationBatch, distance: float, angle: float = 0.0
    ) -> Bools: ...
    def is_free_around(self, q: ArrayLike, distance: float, angle: float = 0.0) -> bool | Bools:
        """Return True if all near configurations are proven free.

        They are within ``distance`` and ``angle`` of q. The configurations are those in a box: at
        most ``distance`` away along each axis, and rotated by at most ``angle``. They are proven if
        every closed cell that meets the box is FREE. Use it to prove curves piece by piece.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.
        distance : float
            Metres, zero or above.
        angle : float
            Radians, zero or above; ignored if the robot does not rotate.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        from cspace.map.points import boxes_are_free

        reach = (
            check_not_negative(distance, "distance"),
            check_not_negative(angle, "angle", "pass it in radians"),
        )
        query = self._backend.query(boxes_are_free, *reach)
        return evaluate_batch(q, self.size, query, np.bool_, bool, angles=self._angles)

    @overload
    def clearance(self, q: Configuration) -> float: ...  # type: ignore[overload-overlap]
    @overload
    def clearance(self, q: ConfigurationBatch) -> Floats: ...
    def clearance(self, q: ArrayLike) -> float | Floats:
        """Return a lower bound of the distance to configurations that are not FREE.

        The distance is in the translation, to the nearest one. The bound is proven. At the center
        of a cell, it is the distance but for rounding. Elsewhere in the grid, it is less than 1.42
        cells below in the plane and 1.74 in space; a few hundredths of a cell on average, a tenth
        where all is near obstacles. Outside the grid, it is at least the distance to the box around
        the grid and all cells that are not FREE. It is zero if the configuration is not FREE, and
        infinite if every configuration at its rotation is FREE.

        The first query at a rotation computes the distances of all cells there, 4 bytes each, and
        so does the first one after an update: some 20 ms for a million cells.

        Clearances in a tiled map are at most the width of the halo of a tile, less two cells,
        because all farther away is unknown there.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        float or ndarray of float64, shape (...)
            Metres.
        """
        return evaluate_batch(
            q, self.size, self._clearances(), np.float64, float, angles=self._angles
        )

    # ---- what differs ----------------------------------------------------------------------------

    @property
    @abstractmethod
    def _summary(self) -> str:
        """End of the repr."""

    @property
    @abstractmethod
    def _facts(self) -> dict[str, object]:
        """Plain values by name that describe the map, except its grid."""

    @property
    def _backend(self) -> Backend:
        """The cells as input of kernels, of a map in memory."""
        raise NotImplementedError

    def _at_one_moment(self, work: Callable[[], Result]) -> Result:
        """Run ``work`` on a consistent state of the map."""
        return self._backend.at_one_moment(work)

    @cached_property
    def _states_query(self) -> Query:
        """Return the query that writes the state of each configuration."""
        from cspace.map.points import classify

        return self._backend.query(classify)

    def _classify(self) -> Query:
        return self._states_query

    def _frees(self, exact: bool) -> Query:
        return (
            self._backend.query(self._exact.points)
            if exact
            else partial(_are_free, self._classify())
        )

    def _edges(self, exact: bool) -> Query:
        """Return the query that tests edges; with ``exact``, geometry decides."""
        from cspace.map.edges import edges_are_free

        if exact:
            return self._backend.query(self._exact.edges, least=MIN_EDGES_PER_THREAD)
        return self._backend.query(edges_are_free, least=MIN_EDGES_PER_THREAD)

    @abstractmethod
    def _clearances(self) -> Query:
        """Return the kernel of clearances."""

    @property
    @abstractmethod
    def _exact(self) -> ExactQueries:
        """Queries that decide MIXED cells by the geometry."""

    @property
    @abstractmethod
    def _components(self) -> Components:
        """Connected components of cells that share sides."""

    def _cells_of(self, points: Floats) -> Ints:
        """Return the cells of configurations.

        They are ``(rotation, x, y)`` or ``(rotation, x, y, z)``, and may lie outside the grid.
        """
        cells = self.grid.cell_of(points[..., : self.grid.dim])
        return np.concatenate([self.rotations.find_cells(points)[..., None], cells], axis=-1)


def _bool_or_array(proven: Bools) -> bool | Bools:
    return proven if proven.ndim else bool(proven)


def _are_free(classify: Query, parts: Sequence[Any], out: NDArray[Any]) -> int:
    """Write whether configurations are FREE.

    Returns the index of an invalid one, or -1.
    """
    states = out.view(np.uint8)
    bad = classify(parts, states)
    np.equal(states, FREE, out=out)
    return bad
