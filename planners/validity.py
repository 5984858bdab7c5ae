"""Whether a state is free: one look-up in the map."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from ompl import base as ob

from planners.states import PLANE, SPACE, TURNING, Kind, class_for
from planners.straight import exactly

if TYPE_CHECKING:
    from cspace.space import CSpace


class StateValidityChecker(ob.StateValidityChecker):
    """OMPL's question "is this state valid?", answered by a certified map.

    Valid means FREE; a MIXED cell is not valid, unless ``exact`` is wanted and the geometry itself is free there. For a
    map of a robot in space a :class:`SpatialStateValidityChecker` is made, and for one with rotations a
    :class:`TurningStateValidityChecker`; what shall serve such maps derives from those.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
    exact : bool
        Whether the geometry itself is asked where the map cannot decide.
    """

    def __new__(cls, si: Any, space: CSpace, **options: Any) -> StateValidityChecker:
        made: StateValidityChecker = super().__new__(class_for(cls, _CLASSES, space))
        return made

    def __init__(self, si: Any, space: CSpace, *, exact: bool = False) -> None:
        super().__init__(si)
        self._is_free = space.point_checker(**exactly(exact))
        self._space = space
        self._clearance: Callable[..., float] | None = None

    def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
        """Whether the state is FREE."""
        return self._is_free(state[0], state[1])

    def clearance(self, state: Any) -> float:
        """Lower bound of the distance to the nearest configuration that is not FREE, in metres."""
        return self._clearances()(state[0], state[1])

    def _clearances(self) -> Callable[..., float]:
        if self._clearance is None:
            # Distances cost a pass over the whole map, and few planners ask for them.
            self._clearance = self._space.clearance_checker()
        return self._clearance


class SpatialStateValidityChecker(StateValidityChecker):
    """The same for states ``(x, y, z)``."""

    def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
        """Whether the state is FREE."""
        return self._is_free(state[0], state[1], state[2])

    def clearance(self, state: Any) -> float:
        """Lower bound of the distance to the nearest configuration that is not FREE, in metres."""
        return self._clearances()(state[0], state[1], state[2])


class TurningStateValidityChecker(StateValidityChecker):
    """The same for states ``(x, y, yaw)``; the clearance is that of the translation."""

    def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
        """Whether the state is FREE."""
        return self._is_free(state.getX(), state.getY(), state.getYaw())

    def clearance(self, state: Any) -> float:
        """Lower bound of the distance, at this yaw, to the nearest position that is not FREE, in metres."""
        return self._clearances()(state.getX(), state.getY(), state.getYaw())


_CLASSES: Final[dict[Kind, type]] = {
    PLANE: StateValidityChecker,
    SPACE: SpatialStateValidityChecker,
    TURNING: TurningStateValidityChecker,
}
