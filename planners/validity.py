"""Whether a state is free: one look-up in the map."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ompl import base as ob

if TYPE_CHECKING:
    from cspace.space import CSpace


class StateValidityChecker(ob.StateValidityChecker):
    """OMPL's question "is this state valid?", answered by a certified map.

    Valid means FREE; a MIXED cell is not valid.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
    """

    def __init__(self, si: Any, space: CSpace) -> None:
        super().__init__(si)
        self._is_free = space.point_checker()
        self._space = space
        self._clearance: Callable[[float, float], float] | None = None

    def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
        """Whether the state is FREE."""
        return self._is_free(state[0], state[1])

    def clearance(self, state: Any) -> float:
        """Lower bound of the distance to the nearest configuration that is not FREE, in metres."""
        if self._clearance is None:
            # Distances cost a pass over the whole map, and few planners ask for them.
            self._clearance = self._space.clearance_checker()
        return self._clearance(state[0], state[1])
