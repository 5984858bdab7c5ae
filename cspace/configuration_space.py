"""Queries of configurations and motions, answered by a map of cells or by geometry."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import FREE, Bools, Floats, States
from cspace.check import check_pairs
from cspace.errors import InputError
from cspace.map.batches import Configuration, evaluate, evaluate_edges, evaluate_rows
from cspace.rotations.base import angle_axes
from cspace.shown import SpaceView


class ConfigurationSpace(SpaceView, ABC):
    """The configurations of a robot, with the queries of all maps and arms.

    :class:`cspace.CSpace` and :class:`cspace.TiledCSpace` read cells, :class:`cspace.ArmSpace`
    tests the geometry. Each has its own kernels for batches of configurations.
    """

    @property
    @abstractmethod
    def axes(self) -> tuple[str, ...]:
        """Names of the coordinates of a configuration."""

    @property
    @abstractmethod
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates of a configuration.

        They are "m", "rad", or "1" for a quaternion.
        """

    @cached_property
    def size(self) -> int:
        """Length of a configuration, ``len(axes)``.

        It is 7 in SE(3), because a quaternion has four coordinates.
        """
        return len(self.axes)

    @property
    def dof(self) -> int:
        """Degrees of freedom.

        They are 3 in SE(2), 6 in SE(3), and the number of joints for an arm.
        """
        return self.size

    @property
    def periodic_axes(self) -> tuple[bool, ...]:
        """Whether each coordinate is a continuous joint's angle.

        Such angles have a period of 2 pi.
        """
        return (False,) * self.size

    @cached_property
    def _angles(self) -> dict[int, str]:
        """Index and name of each coordinate that is wrapped."""
        return angle_axes(self.axes, self.periodic_axes)

    @abstractmethod
    def _check_configurations(self, q: ArrayLike, name: str = "q") -> Floats:
        """Check configurations and return them as an array of floats.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.
        name : str
            Name of the argument, for errors.

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
    def classify(self, q: ArrayLike) -> States: ...
    def classify(self, q: ArrayLike) -> int | States:
        """Return the state of configurations: FREE, MIXED or BLOCKED.

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
            If a configuration is outside the limits of an arm's joints.

        Warns
        -----
        AngleWarning
            If an angle of a single configuration exceeds 2 pi, as if it were in degrees.
        """
        if isinstance(q, tuple) and (state := self._state_of_one(q)) is not None:
            return state
        states: int | States = evaluate(q, self.size, self._write_states, np.uint8, self._angles)
        return states

    @overload
    def is_free(self, q: Configuration, *, exact: bool = False) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_free(self, q: ArrayLike, *, exact: bool = False) -> Bools: ...
    def is_free(self, q: ArrayLike, *, exact: bool = False) -> bool | Bools:
        """Return True if configurations are proven collision-free.

        Arguments and errors as :meth:`classify`.

        With ``exact``, geometry decides in MIXED cells of a map; see :mod:`cspace.exact`. For an
        arm it always does.
        """
        if isinstance(q, tuple) and not exact and (state := self._state_of_one(q)) is not None:
            return state == FREE
        write = partial(self._write_free, exact)
        free: bool | Bools = evaluate(q, self.size, write, np.bool_, self._angles)
        return free

    @overload
    def motion_is_free(  # type: ignore[overload-overlap]
        self, q0: Configuration, q1: Configuration, *, exact: bool = False
    ) -> bool: ...
    @overload
    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike, *, exact: bool = False) -> Bools: ...
    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike, *, exact: bool = False) -> bool | Bools:
        """Return True if straight motions are proven collision-free all along.

        On a map, a motion is proven if every closed cell that it touches, even in a corner, is
        FREE. A motion on the boundary of two cells touches both, so a motion that starts on the
        boundary of a cell that is not FREE is not proven. All joints of an arm move in proportion.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,) or (..., size)
            Endpoints of the motions, metres and radians; broadcast against each other.
        exact : bool
            Decide MIXED cells by the geometry; see :mod:`cspace.exact`. For an arm, geometry always
            decides.

        Returns
        -------
        bool or ndarray of bool, shape (...)

        Raises
        ------
        InputError, ConfigurationError
            As :meth:`classify`.
        """
        if isinstance(q0, tuple) and isinstance(q1, tuple) and not exact:
            state = self._state_of_motion(q0, q1)
            if state is not None:
                return state == FREE
        write = partial(self._write_motions, exact)
        free: bool | Bools = evaluate_edges(q0, q1, self.size, write, self._angles)
        return free

    def certify_path(
        self, path: ArrayLike, edges: ArrayLike | None = None, *, exact: bool = False
    ) -> Bools:
        """Return whether each edge is proven collision-free.

        The edges belong to a path, to several paths, or to a roadmap. Edges are straight and rotate
        along the shorter arc, as OMPL interpolates, and answers are as for :meth:`motion_is_free`;
        for arms see :meth:`cspace.ArmSpace.certify_path`. Many edges are tested in threads.

        Parameters
        ----------
        path : array-like, shape (n, size) or (..., n, size)
            Configurations, metres and radians: a path, several paths of equal length, or the
            vertices of a roadmap.
        edges : array-like of int, shape (m, 2), optional
            Indices of the two vertices of each edge; ``path`` must then have shape (n, size). If
            left out, edges join consecutive configurations.
        exact : bool
            As for :meth:`motion_is_free`.

        Returns
        -------
        ndarray of bool, shape (n - 1,), (..., n - 1) or (m,)
            Empty for a path of one configuration, which has no edges.

        Raises
        ------
        InputError
            If a configuration is invalid, even if no edge uses it; if a path is empty; or if an
            edge is not a pair of indices of vertices.
        ConfigurationError
            As :meth:`classify`.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
        >>> corners = [(0.5, 1.5), (0.5, 2.5), (1.5, 2.5), (1.5, 0.5)]
        >>> space.certify_path(corners).tolist()
        [True, True, False]
        >>> space.certify_path(corners, [(0, 2), (2, 3)]).tolist()
        [True, False]
        """
        points = self._check_configurations(path, "path")
        if edges is not None:
            pairs = check_pairs(edges, points)
            starts, ends = points[pairs[:, 0]], points[pairs[:, 1]]
            return evaluate_rows(starts, ends, partial(self._write_motions, exact))
        if points.ndim < 2 or points.shape[-2] == 0:
            rule, hint = (
                "a path has at least one configuration",
                f"pass an array of shape (n, {self.size})",
            )
            raise InputError("path", f"has shape {points.shape}", rule, hint, value=path)
        shape = (*points.shape[:-2], points.shape[-2] - 1)
        starts = points[..., :-1, :].reshape(-1, self.size)
        ends = points[..., 1:, :].reshape(-1, self.size)
        return evaluate_rows(starts, ends, partial(self._write_motions, exact)).reshape(shape)

    def _tile_subproblems(self, q0: ArrayLike, q1: ArrayLike) -> Sequence[TileSubproblem]:
        """Split a planning problem into parts.

        Each part is a problem on a part of the space in memory. Return for each a function that
        opens the part, and two configurations to join in it. Only a tiled map has several parts;
        see :class:`cspace.TiledCSpace`. The configurations have been checked.
        """
        first, last = (np.array(q, dtype=np.float64) for q in (q0, q1))
        return [(lambda: self, first, last)]

    # ---- one configuration, given as a tuple: the same look-ups, without arrays ------------------

    def _state_of_one(self, q: tuple[Any, ...]) -> int | None:
        """Return the state of one configuration, or None if the look-up of arrays decides."""
        return None

    def _state_of_motion(self, q0: tuple[Any, ...], q1: tuple[Any, ...]) -> int | None:
        """Return FREE if a motion is proven free, else MIXED; None as for :meth:`_state_of_one`."""
        return None

    # ---- what differs ----------------------------------------------------------------------------

    @abstractmethod
    def _write_states(self, rows: Floats, out: States) -> int:
        """Write the states of rows; return the index of the first unusable one, or -1."""

    @abstractmethod
    def _write_free(self, exact: bool, rows: Floats, out: Bools) -> int:
        """Write whether rows are proven free; return as :meth:`_write_states`."""

    @abstractmethod
    def _write_motions(self, exact: bool, starts: Floats, ends: Floats, out: Bools) -> int:
        """Write whether motions are proven free; return as :meth:`_write_states`."""


TileSubproblem = tuple[Callable[[], ConfigurationSpace], Floats, Floats]
"""A function that opens a part of a space in memory, and the two configurations to join in it."""
