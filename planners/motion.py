"""Whether a motion is free: the whole edge in one compiled call."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from ompl import base as ob

from planners.curves import Curve
from planners.states import PLANE, SPACE, TURNING, Kind, class_for
from planners.ways import way_of

if TYPE_CHECKING:
    from cspace.space import CSpace


class MotionValidator(ob.MotionValidator):
    """OMPL's question "is this motion valid?", answered exactly: every cell that the edge touches is FREE.

    Nothing is stepped over, at any length, so OMPL's checking resolution plays no part in it. With a curve, the edge is
    the real curve, not a chain of samples on it. For a map of a robot in space a :class:`SpatialMotionValidator` is
    made, and for one with rotations a :class:`TurningMotionValidator`; what shall serve such maps derives from those.

    OMPL can also ask for the last valid state of a motion. Its Python bindings have no way to answer that, so
    ``ompl.base.ObstacleBasedValidStateSampler``, which relies on it, returns invalid states next to any motion
    validator written in Python: do not pair them. :func:`planners.simple_setup` refuses the pair.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`. It is not kept: a validator that holds it would never be freed.
    space : CSpace
    exact : bool
        Whether the geometry itself is asked where the map cannot decide.
    curve : {"dubins", "reeds-shepp"}, optional
    turning_radius : float, optional
        Metres; for curves, which need it.

    Raises
    ------
    InputError
        As :func:`planners.state_space`.
    """

    def __new__(cls, si: Any, space: CSpace, **options: Any) -> MotionValidator:
        made: MotionValidator = super().__new__(class_for(cls, _CLASSES, space))
        return made

    def __init__(
        self,
        si: Any,
        space: CSpace,
        *,
        exact: bool = False,
        curve: str | None = None,
        turning_radius: float | None = None,
    ) -> None:
        super().__init__(si)
        way = way_of(space, exact, curve, turning_radius)
        self._is_free = way.edge_checker()
        self._curve = (way.length_prover(), way.states(), 1e-6 * way.radius) if isinstance(way, Curve) else None

    def checkMotion(self, first: Any, second: Any) -> bool:  # noqa: N802 - OMPL's name
        """Whether the edge between two states is free all along."""
        return self._is_free(first[0], first[1], second[0], second[1])


class SpatialMotionValidator(MotionValidator):
    """The same for states ``(x, y, z)``."""

    def checkMotion(self, first: Any, second: Any) -> bool:  # noqa: N802 - OMPL's name
        """Whether the edge between two states is free all along."""
        return self._is_free(first[0], first[1], first[2], second[0], second[1], second[2])


class TurningMotionValidator(MotionValidator):
    """The same for states ``(x, y, yaw)``."""

    def checkMotion(self, first: Any, second: Any) -> bool:  # noqa: N802 - OMPL's name
        """Whether the edge between two states is free all along.

        OMPL now and then takes a curve for the shortest that is not. Such an edge is not proven, and is refused.
        """
        ends = first.getX(), first.getY(), first.getYaw(), second.getX(), second.getY(), second.getYaw()
        if self._curve is None:
            return self._is_free(*ends)
        prove, states, tolerance = self._curve
        length = prove(*ends)
        return bool(length >= 0.0 and states.distance(first, second) <= length + tolerance)


_CLASSES: Final[dict[Kind, type]] = {
    PLANE: MotionValidator,
    SPACE: SpatialMotionValidator,
    TURNING: TurningMotionValidator,
}
