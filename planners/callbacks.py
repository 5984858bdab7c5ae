"""What OMPL calls most: is a state free, one look-up; is a motion, one compiled call; and samples of free states."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
from ompl import base as ob
from ompl import util as ou

from cspace.check import check_rng
from cspace.space import CSpace
from planners.local_planner import HOLONOMIC, local_planner
from planners.states import check_information, kind_of

_BATCH: Final = 256
"""Draws made at once; one at a time would spend all the time on the way in and out of numpy."""


class StateValidityChecker(ob.StateValidityChecker):
    """Validity of OMPL's states, looked up in a certified map of any space.

    Valid means FREE; a MIXED cell is not valid, unless ``exact`` is set and the geometry proves the state free.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
    exact : bool
        Whether the geometry itself decides where the map cannot.
    """

    def __init__(self, si: ob.SpaceInformation, space: CSpace, *, exact: bool = False) -> None:
        check_information(si, space)
        super().__init__(si)
        self._kind = kind_of(space)
        self._space = space
        self._query_map = self._kind.of_state(space.point_checker(exact=exact))
        self._clearance: Callable[[ob.State], float] | None = None
        self._override(None)

    def isValid(self, state: ob.State) -> bool:  # noqa: N802 - OMPL's name
        """Whether the state is FREE."""
        return self._is_free(state)

    def clearance(self, state: ob.State) -> float:
        """Lower bound of the distance to the nearest position that is not FREE, at the state's rotation, in metres."""
        if self._clearance is None:
            # Distances cost a pass over the map, and few planners ask for them.
            self._clearance = self._kind.of_state(self._space.clearance_checker())
        return self._clearance(state)

    def _override(self, answer: Callable[[ob.State], bool] | None) -> None:
        """Answer by a function from now on, or by the map again if None; the deadline of a plan sets it."""
        self._is_free = answer or self._query_map
        if type(self) is StateValidityChecker:  # OMPL then asks the function itself, a tenth quicker
            self.__dict__["isValid"] = self._is_free


class MotionValidator(ob.MotionValidator):
    """Validity of OMPL's motions, decided exactly: a motion is valid if every cell that its edge touches is FREE.

    Nothing is stepped over, at any length, so OMPL's checking resolution plays no part in it. With a drive, the edge is
    what is driven, turn, line and turn, or the real curve, not a chain of samples on it. OMPL now and then takes a
    curve for the shortest that is not; such an edge is not proven, and is refused.

    OMPL can also ask for the last valid state of a motion. Its Python bindings have no way to answer that, so
    ``ompl.base.ObstacleBasedValidStateSampler``, which relies on it, returns invalid states next to any motion
    validator written in Python: do not pair them. :func:`planners.simple_setup` refuses the pair.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`. It is not kept: a validator that holds it would never be freed.
    space : CSpace
    exact : bool
        Whether the geometry itself decides where the map cannot.
    drive : {"holonomic", "differential", "differential-reverse", "dubins", "reeds-shepp"}
        As for :func:`planners.plan`.
    turning_radius : float, optional
        Metres; for curves, which need it.
    bidirectional : bool
        Whether an edge must also be free from its end to its start. The planners need it that take edges both ways
        (BFMT, BKPIECE1, LBKPIECE1, PRM, PRMstar), where the robot does not drive backwards.

    Raises
    ------
    InputError
        As :func:`planners.state_space`.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> from ompl import base as ob
    >>> space = cspace.build(cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1), cspace.Robot.disc(0.2))
    >>> def is_free(space, q0, q1):  # OMPL's objects are gone when it ends
    ...     si = ob.SpaceInformation(planners.state_space(space))
    ...     si.setStateValidityChecker(planners.StateValidityChecker(si, space))
    ...     si.setMotionValidator(planners.MotionValidator(si, space))
    ...     endpoints = si.allocState(), si.allocState()
    ...     for state, q in zip(endpoints, (q0, q1)):
    ...         state[0], state[1] = q
    ...     return si.checkMotion(*endpoints)
    >>> is_free(space, (1.0, 1.0), (3.0, 2.0)), is_free(space, (1.0, 1.0), (3.95, 2.0))
    (True, False)
    """

    def __init__(
        self,
        si: ob.SpaceInformation,
        space: CSpace,
        *,
        exact: bool = False,
        drive: str = HOLONOMIC,
        turning_radius: float | None = None,
        bidirectional: bool = False,
    ) -> None:
        check_information(si, space)
        super().__init__(si)
        edges = local_planner(space, exact, drive, turning_radius, bidirectional)
        self._query_map = edges.motion_checker()
        self._override(None)

    def checkMotion(self, first: ob.State, second: ob.State) -> bool:  # noqa: N802 - OMPL's name
        """Whether the edge between two states is free all along."""
        return self._is_free(first, second)

    def _override(self, answer: Callable[[ob.State, ob.State], bool] | None) -> None:
        """Answer by a function from now on, or by the map again if None; the deadline of a plan sets it."""
        self._is_free = answer or self._query_map
        if type(self) is MotionValidator:  # OMPL then asks the function itself, a tenth quicker
            self.__dict__["checkMotion"] = self._is_free


class FreeStateSampler(ob.ValidStateSampler):
    """Draws states that are FREE, uniformly over the free area or volume, without trial and error.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
    rng : numpy.random.Generator, optional
        Source of randomness. If left out, one seeded by OMPL's seed generator, so that ``ompl.util.RNG.setSeed`` makes
        the draws repeatable.

    Raises
    ------
    InputError
        If ``rng`` is not a Generator.
    """

    def __init__(self, si: ob.SpaceInformation, space: CSpace, rng: np.random.Generator | None = None) -> None:
        check_information(si, space)
        super().__init__(si)
        rng = np.random.default_rng(ou.RNG().getLocalSeed()) if rng is None else check_rng(rng)
        self._kind, self._rotations = kind_of(space), space.rotations
        self._points = _points(space, rng)
        self._numbers = _numbers(rng)
        self._is_free = space.point_checker()
        self._box = tuple(zip(space.grid.lower, space.grid.upper, strict=True))

    def sample(self, state: ob.State) -> bool:
        """Set ``state`` to a FREE configuration.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        """
        # The map may have been updated since a point was drawn.
        self._kind.write(state, *next(point for point in self._points if self._is_free(*point)))
        return True

    def sampleNear(self, state: ob.State, near: ob.State, distance: float) -> bool:  # noqa: N802 - OMPL's name
        """Set ``state`` to a FREE configuration within ``distance`` of ``near`` along each axis, and in radians.

        Returns
        -------
        bool
            False, and ``state`` as it was, if none was found in ``getNrAttempts`` draws.
        """
        middle, dim = self._kind.read(near), len(self._box)
        rotations, numbers = self._rotations, self._numbers
        box = [
            (max(low, x - distance), min(high, x + distance)) for (low, high), x in zip(self._box, middle, strict=False)
        ]
        if any(low > high for low, high in box):
            return False
        for _ in range(max(1, self.getNrAttempts())):
            place = [min(low + next(numbers) * (high - low), high) for low, high in box]
            place += rotations.sample_near(middle[dim:], min(distance, math.pi), numbers)
            if self._is_free(*place):
                self._kind.write(state, *place)
                return True
        return False


def _points(space: CSpace, rng: np.random.Generator) -> Iterator[list[float]]:
    """FREE configurations without end."""
    while True:
        yield from space.sample_free(_BATCH, rng).tolist()


def _numbers(rng: np.random.Generator) -> Iterator[float]:
    """Uniform numbers from [0, 1) without end."""
    while True:
        yield from rng.random(_BATCH).tolist()
