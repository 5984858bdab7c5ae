"""Whether a straight motion is free: the whole edge in one compiled call."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ompl import base as ob

if TYPE_CHECKING:
    from cspace.space import CSpace


class MotionValidator(ob.MotionValidator):
    """OMPL's question "is this motion valid?", answered exactly: every cell that the edge touches is FREE.

    Nothing is stepped over, at any length, so OMPL's checking resolution plays no part in it.

    OMPL can also ask for the last valid state of a motion. Its Python bindings have no way to answer that, so
    ``ompl.base.ObstacleBasedValidStateSampler``, which relies on it, returns invalid states next to any motion
    validator written in Python: do not pair them. :func:`planners.simple_setup` refuses the pair.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`. It is not kept: a validator that holds it would never be freed.
    space : CSpace
    """

    def __init__(self, si: Any, space: CSpace) -> None:
        super().__init__(si)
        self._is_free = space.edge_checker()

    def checkMotion(self, first: Any, second: Any) -> bool:  # noqa: N802 - OMPL's name
        """Whether the straight edge between two states is FREE all along."""
        return self._is_free(first[0], first[1], second[0], second[1])
