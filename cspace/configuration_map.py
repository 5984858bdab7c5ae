"""ConfigurationMap: the queries of every certified map, be it in memory or in a store."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import FREE, MIXED, Bools, Floats, Ints, Words
from cspace.check import not_negative
from cspace.configuration_space import ConfigurationSpace
from cspace.grid import Grid
from cspace.map.backend import Backend
from cspace.map.batches import EDGES_A_THREAD, Configuration, ConfigurationBatch, Query, answer, as_points
from cspace.map.storage import read_only
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.rotations.base import warn_of_degrees
from cspace.shown import MapPlot

if TYPE_CHECKING:
    from cspace.exact.proofs import ExactQueries
    from cspace.map.contents import Contents
    from cspace.store import Store


class Joined(Protocol):
    """Components of cells, joined side to side."""

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Numbers of the components of FREE cells, or of all that are not BLOCKED; -1 where there is none."""


class ConfigurationMap(ConfigurationSpace, MapPlot):
    """A certified map of a robot's configurations, with the look-ups that all maps share.

    :class:`cspace.CSpace` keeps its cells in memory, :class:`cspace.TiledCSpace` reads them from a store. Look-ups run
    compiled kernels over the cells by a :class:`cspace.map.backend.Backend`.
    """

    # ---- what the map is ---------------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def _kept(self) -> Contents | Store:
        """What keeps the map: its contents in memory, or its store."""

    @property
    def grid(self) -> Grid:
        """Cells of positions of the robot's reference point; the workspace's grid."""
        return self._kept.grid

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self._kept.robot

    @property
    def rotations(self) -> Rotations:
        """The rotation cells; a single one where the robot only translates."""
        return self._kept.rotations

    @property
    def slice_of(self) -> Ints:
        """The slice of each rotation cell, shape (rotation cells,); read-only.

        Rotation cells that a symmetry of the robot maps to each other share a slice.
        """
        return read_only(self._kept.slice_of)

    @property
    def slice_rotations(self) -> Floats:
        """One rotation for each slice, as it stands in a configuration, shape (slices, k); k is 0, 1 or 4.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.rectangle(0.4, 0.2), rotations=8)
        >>> space.slice_of
        array([0, 1, 2, 3, 0, 1, 2, 3])
        >>> len(space.slice_rotations)
        4
        """
        return self.rotations.centers[np.unique(self.slice_of, return_index=True)[1]]

    @property
    @abstractmethod
    def outside(self) -> str:
        """What lies outside the workspace: "blocked" or "free", and around a part of a larger map "unknown"."""

    @property
    @abstractmethod
    def margin(self) -> float:
        """Metres by which the robot was grown where FREE was proven."""

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the numbers in a configuration: x and y, in space z, then yaw or qx, qy, qz and qw."""
        return (*self.grid.axes, *self.rotations.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the numbers in a configuration: "m", "rad", or "1" for those of a quaternion."""
        return (*self.grid.units, *self.rotations.units)

    @property
    def dof(self) -> int:
        return self.size - ("qw" in self.rotations.names)  # a quaternion has norm 1

    @abstractmethod
    def count(self) -> tuple[int, int, int]:
        """Number of FREE, MIXED and BLOCKED cells, over all rotation cells."""

    def __repr__(self) -> str:
        cells = " x ".join(map(str, self.grid.shape))
        turns = f" x {self.rotations}" if self.rotations.names else ""
        size = f"{cells} cells of {self.grid.spacing:g} {self.grid.unit}{turns}"
        return f"{type(self).__name__}({size}, {self.robot.name}: {self._summary})"

    # ---- look-ups ----------------------------------------------------------------------------------------------------

    def _check_configurations(self, q: ArrayLike, name: str = "q") -> Floats:
        points = as_points(q, name, self.size)
        answer(points, self.size, self._classify(), np.uint8, int, name, self._angles)  # raises where one is not finite
        return points

    @overload
    def is_connected(self, q0: Configuration, q1: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_connected(self, q0: ConfigurationBatch, q1: ArrayLike) -> Bools: ...
    @overload
    def is_connected(self, q0: ArrayLike, q1: ConfigurationBatch) -> Bools: ...
    def is_connected(self, q0: ArrayLike, q1: ArrayLike) -> bool | Bools:
        """Return True if a collision-free path is proven to exist between configurations.

        A chain of FREE cells joins them. False is no proof of the opposite: see :meth:`is_disconnected`. Components of
        cells are computed at the first call and cached; those of a map in a store, in the store.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,) or (..., size)
            Metres, and radians; broadcast against each other.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        return _bool_or_array(self._connectivity(q0, q1)[0])

    @overload
    def is_disconnected(self, q0: Configuration, q1: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_disconnected(self, q0: ConfigurationBatch, q1: ArrayLike) -> Bools: ...
    @overload
    def is_disconnected(self, q0: ArrayLike, q1: ConfigurationBatch) -> Bools: ...
    def is_disconnected(self, q0: ArrayLike, q1: ArrayLike) -> bool | Bools:
        """Return True if it is proven that no collision-free path exists between configurations.

        No chain of FREE and MIXED cells joins them. If neither this nor :meth:`is_connected` is True, the map is too
        coarse to decide; plan with ``exact=True``, or build with a finer spacing. Both share cached components.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,) or (..., size)
            Metres, and radians; broadcast against each other.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        return _bool_or_array(self._connectivity(q0, q1)[1])

    def _connectivity(self, q0: ArrayLike, q1: ArrayLike) -> tuple[Bools, Bools]:
        """Return which pairs are proven connected, and which are proven disconnected, of shape (...) each."""
        return self._backend.at_one_moment(lambda: self._compute_connectivity(q0, q1))

    def _compute_connectivity(self, q0: ArrayLike, q1: ArrayLike) -> tuple[Bools, Bools]:
        endpoints = [as_points(q, name, self.size) for q, name in ((q0, "q0"), (q1, "q1"))]
        both = np.concatenate([points.reshape(-1, self.size) for points in endpoints])
        states = np.empty(len(both), dtype=np.uint8)
        if self._classify()([both], states) >= 0:
            self._check_configurations(q0, "q0"), self._check_configurations(q1, "q1")  # one of them raises
        for points, name in zip(endpoints, ("q0", "q1"), strict=True):
            if points.ndim == 1:
                warn_of_degrees(points, self._angles, name)
        cells, count = self._cells_of(both), endpoints[0].size // self.size

        def pairs(values: NDArray[Any]) -> list[NDArray[Any]]:
            halves = values[:count], values[count:]
            return [half.reshape(points.shape[:-1]) for half, points in zip(halves, endpoints, strict=True)]

        def joined(among: Bools, mixed: bool) -> Bools:
            """Those of some pairs that cells of a kind join; nothing is read where there are none."""
            if not among.any():
                return among
            one, other = pairs(self._components.of(cells, mixed))
            return np.asarray(among & (one == other) & (one != -1))

        highest = np.maximum(*pairs(states))
        passable = np.asarray(highest <= MIXED)
        apart, few_join = False, _unknown
        if count == 1 and len(cells) == 2 and passable.all():
            apart, few_join = self._hint(cells)
        if apart:
            passable = joined(passable, mixed=True)
        free = joined(passable & (highest == FREE), mixed=False)
        left = passable & ~free
        passable = free | (left if left.all() and few_join() else joined(left, mixed=True))
        return np.asarray(free), np.asarray(~passable)

    @overload
    def is_free_around(self, q: Configuration, distance: float, angle: float = 0.0) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_free_around(self, q: ConfigurationBatch, distance: float, angle: float = 0.0) -> Bools: ...
    def is_free_around(self, q: ArrayLike, distance: float, angle: float = 0.0) -> bool | Bools:
        """Whether all configurations around configurations are proven collision-free.

        True where every closed cell is FREE that meets the box of all configurations within ``distance`` along each
        axis, whose rotation is within ``angle``. Curves are proven with it, piece by piece.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.
        distance : float
            Metres, zero or above.
        angle : float
            Radians, zero or above; plays no part where the robot does not turn.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        from cspace.map.points import boxes_are_free

        reach = not_negative(distance, "distance"), not_negative(angle, "angle", "pass it in radians")
        query = self._backend.query(boxes_are_free, *reach, passed=True)
        return answer(q, self.size, query, np.bool_, bool, angles=self._angles)

    @overload
    def clearance(self, q: Configuration) -> float: ...  # type: ignore[overload-overlap]
    @overload
    def clearance(self, q: ConfigurationBatch) -> Floats: ...
    def clearance(self, q: ArrayLike) -> float | Floats:
        """Lower bound of the distance, in the translation, to the nearest configuration that is not FREE.

        The bound is proven, and but for rounding it is that distance, in the grid and outside. Zero where a
        configuration is not FREE; infinite where every configuration is. Nothing of the size of the map is computed.

        Of a map in a store it is computed up to 64 cells in the plane, and 16 in space: windows are opened around the
        configurations, one after the other, and where all is FREE up to there, that is the bound.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        float or ndarray of float64, shape (...)
            Metres.
        """
        return answer(q, self.size, self._clearances(), np.float64, float, angles=self._angles)

    # ---- what differs ------------------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def _summary(self) -> str:
        """What the repr ends with."""

    @property
    @abstractmethod
    def _facts(self) -> dict[str, object]:
        """Facts about the map besides its grid, for people: plain values by name."""

    @property
    @abstractmethod
    def _backend(self) -> Backend:
        """The cells, over which kernels are run."""

    @cached_property
    def _states_query(self) -> Query:
        from cspace.map.points import classify

        return self._backend.query(classify, passed=FREE)

    def _classify(self) -> Query:
        return self._states_query

    def _frees(self, exact: bool) -> Query:
        return self._backend.query(self._exact.points) if exact else partial(_are_free, self._classify())

    def _edges(self, number: int, exact: bool) -> Query:
        from cspace.map.edges import edges_are_free

        if exact:
            return self._backend.query(self._exact.edges, least=EDGES_A_THREAD)
        return self._backend.query(edges_are_free, self._blocks(number), passed=True, least=EDGES_A_THREAD)

    def _blocks(self, number: int) -> Words | None:
        """Marks of blocks of cells that are not FREE, if they are worth it for a number of edges."""
        return None

    @abstractmethod
    def _clearances(self) -> Query:
        """The kernel of clearances."""

    @property
    @abstractmethod
    def _exact(self) -> ExactQueries:
        """Exact look-ups, by the geometry itself."""

    @property
    @abstractmethod
    def _components(self) -> Joined:
        """Components of cells, joined side to side."""

    def _hint(self, cells: Ints) -> tuple[bool, Callable[[], bool]]:
        """Whether to ask first what MIXED cells join, for two cells, shape (2, 1 + d): most likely no path does.

        Besides, what tells, where it is soon known, that MIXED cells join them.
        """
        return False, _unknown

    def _cells_of(self, points: Floats) -> Ints:
        """Cells ``(rotation, x, y)`` or ``(rotation, x, y, z)`` of configurations, in the grid or not."""
        cells = self.grid.cell_of(points[..., : self.grid.dim])
        return np.concatenate([self.rotations.cells_of(points)[..., None], cells], axis=-1)


def _bool_or_array(proven: Bools) -> bool | Bools:
    return proven if proven.ndim else bool(proven)


def _unknown() -> bool:
    """Nothing is known soon."""
    return False


def _are_free(classify: Query, parts: Sequence[Any], out: NDArray[Any]) -> int:
    """Fill ``out`` with whether configurations are FREE, by a kernel of states; the index of a bad one, or -1."""
    states = out.view(np.uint8)
    bad = classify(parts, states)
    np.equal(states, FREE, out=out)
    return bad
