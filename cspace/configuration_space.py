"""ConfigurationSpace: look-ups of configurations and motions, in a map of cells or by the geometry itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats
from cspace.check import check_pairs
from cspace.errors import InputError
from cspace.map.batches import Configuration, ConfigurationBatch, Query, answer, answer_pairs, evaluate_edges
from cspace.rotations.base import angle_axes
from cspace.shown import SpaceView


class ConfigurationSpace(SpaceView, ABC):
    """The configurations of a robot, and the look-ups that are the same for all robots.

    :class:`cspace.CSpace` and :class:`cspace.TiledCSpace` read cells, :class:`cspace.ArmSpace` tests the geometry. Each
    brings its own kernels for batches of configurations.
    """

    @property
    @abstractmethod
    def axes(self) -> tuple[str, ...]:
        """Names of the numbers in a configuration."""

    @property
    @abstractmethod
    def units(self) -> tuple[str, ...]:
        """Units of the numbers in a configuration: "m", "rad", or "1" for those of a quaternion."""

    @cached_property
    def size(self) -> int:
        """Length of a configuration, ``len(axes)``: 7 in SE(3), whose rotation is a quaternion of four numbers."""
        return len(self.axes)

    @property
    def dof(self) -> int:
        """Degrees of freedom: 3 in SE(2), 6 in SE(3), and of an arm the number of its joints."""
        return self.size

    @property
    def periodic_axes(self) -> tuple[bool, ...]:
        """Which numbers are angles of continuous joints, where a whole turn more is the same configuration."""
        return (False,) * self.size

    @cached_property
    def _angles(self) -> dict[int, str]:
        """Index and name of the numbers of a configuration that are wrapped."""
        return angle_axes(self.axes, self.periodic_axes)

    @abstractmethod
    def _check_configurations(self, q: ArrayLike, name: str = "q") -> Floats:
        """Configurations as an array of floats, once they are checked.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.
        name : str
            What the error is to call them.

        Returns
        -------
        ndarray of float64, the shape of q

        Raises
        ------
        InputError, ConfigurationError
            As :meth:`classify`.
        """

    @overload
    def classify(self, q: Configuration) -> int: ...  # type: ignore[overload-overlap]
    @overload
    def classify(self, q: ConfigurationBatch) -> NDArray[np.uint8]: ...
    def classify(self, q: ArrayLike) -> int | NDArray[np.uint8]:
        """State of configurations: FREE, MIXED or BLOCKED.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        int or ndarray of uint8, shape (...)
            FREE (0), MIXED (1) or BLOCKED (2).

        Raises
        ------
        InputError
            If the last axis is not :attr:`size` long, or a value is NaN or infinite.
        ConfigurationError
            If one is outside the limits of an arm's joint.

        Warns
        -----
        AngleWarning
            If the yaw, or the angle of a continuous joint, of a single configuration is beyond a whole turn.
        """
        return answer(q, self.size, self._classify(), np.uint8, int, angles=self._angles)

    @overload
    def is_free(self, q: Configuration, *, exact: bool = False) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_free(self, q: ConfigurationBatch, *, exact: bool = False) -> Bools: ...
    def is_free(self, q: ArrayLike, *, exact: bool = False) -> bool | Bools:
        """Whether configurations are proven collision-free; as :meth:`classify`, with bool for an answer.

        With ``exact``, the geometry itself decides in MIXED cells of a map; see :mod:`cspace.exact`. For an arm it
        always does.
        """
        return answer(q, self.size, self._frees(exact), np.bool_, bool, angles=self._angles)

    @overload
    def motion_is_free(self, q0: Configuration, q1: Configuration, *, exact: bool = False) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def motion_is_free(self, q0: ConfigurationBatch, q1: ArrayLike, *, exact: bool = False) -> Bools: ...
    @overload
    def motion_is_free(self, q0: ArrayLike, q1: ConfigurationBatch, *, exact: bool = False) -> Bools: ...
    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike, *, exact: bool = False) -> bool | Bools:
        """Whether straight edges are proven collision-free all along.

        On a map, True where every closed cell that the edge touches, be it in a corner, is FREE. An edge that lies on
        the border of two cells touches both; so an edge that starts on the border of a cell that is not FREE is not
        proven. The joints of an arm move in step, each from its number to the other.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,) or (..., size)
            Endpoints of the edges, metres and radians; broadcast against each other.
        exact : bool
            Where cells are MIXED, let the geometry itself prove the edge; see :mod:`cspace.exact`. For an arm it
            always does.

        Returns
        -------
        bool or ndarray of bool, shape (...)

        Raises
        ------
        InputError, ConfigurationError
            As :meth:`classify`.
        """
        return evaluate_edges(q0, q1, self.size, lambda number: self._edges(number, exact), self._angles)

    def certify_path(self, path: ArrayLike, edges: ArrayLike | None = None, *, exact: bool = False) -> Bools:
        """Whether each edge of a path, of paths, or of a roadmap is proven collision-free all along.

        The edges are those of :meth:`motion_is_free`, answered alike: straight, and the robot turns along the shorter
        arc, as OMPL interpolates; for arms see :meth:`cspace.ArmSpace.certify_path`. Many edges are proven in threads,
        and on a map by blocks of cells, which cross free space in larger steps; the answers are the same.

        Parameters
        ----------
        path : array-like, shape (n, size) or (..., n, size)
            Configurations, metres and radians: those of a path in order, of several paths of equal length, or the
            vertices of a roadmap.
        edges : array-like of int, shape (m, 2), optional
            Indices, from 0, of the two vertices of each edge; ``path`` must then have shape (n, size). Left out, each
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
        ConfigurationError
            As :meth:`classify`.

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
        points = self._check_configurations(path, "path")
        if edges is not None:
            pairs = check_pairs(edges, points)
            return answer_pairs(np.ascontiguousarray(points), pairs, self._edges(len(pairs), exact))
        if points.ndim < 2 or points.shape[-2] == 0:
            rule = "it must hold at least one configuration in a row"
            raise InputError(
                "path", f"has shape {points.shape}", rule, f"pass an array of shape (n, {self.size})", value=path
            )
        q0, q1 = points[..., :-1, :], points[..., 1:, :]
        return np.asarray(evaluate_edges(q0, q1, self.size, lambda number: self._edges(number, exact)))

    def _tile_subproblems(self, q0: ArrayLike, q1: ArrayLike) -> Sequence[Leg]:
        """Return the parts of the space, in memory, that a path leads through, for a planner of your own.

        Each is a function that opens it, with the configurations that the path joins in it. Only a map in a store has
        several; see :class:`cspace.TiledCSpace`.
        """
        return [(lambda: self, self._check_configurations(q0, "q0"), self._check_configurations(q1, "q1"))]

    # ---- what differs ------------------------------------------------------------------------------------------------

    @abstractmethod
    def _classify(self) -> Query:
        """The kernel of states."""

    @abstractmethod
    def _frees(self, exact: bool) -> Query:
        """The kernel of whether configurations are free."""

    @abstractmethod
    def _edges(self, number: int, exact: bool) -> Query:
        """The kernel of whether edges are free, chosen for a ``number`` of them."""


Leg = tuple[Callable[[], ConfigurationSpace], Floats, Floats]
"""A function that opens a part of a space in memory, and two configurations in it."""
