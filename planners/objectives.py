"""What makes one path better than another."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from ompl import base as ob

from cspace.errors import InputError
from cspace.grid import finite, positive
from planners.states import PLANE, SPACE, TURNING, Kind, class_for
from planners.straight import DENSE_TURN, Floats
from planners.ways import way_of

if TYPE_CHECKING:
    from cspace.space import CSpace

COMFORT: Final = 0.1
"""Clearance beyond which more is not worth a detour, as a share of the map's longer side, where none is given."""

_FEW: Final = 20
"""Steps up to which one look-up at a time is quicker than the way in and out of numpy."""


class ClearanceObjective(ob.OptimizationObjective):
    """Length, weighted by how close it comes to what is not FREE.

    A metre of path at clearance c costs ``1 + weight * max(0, 1 - c / comfort)**2``, integrated along each edge in
    steps of at most one cell. So the cost is never below the length, which OMPL may use as a bound.

    For a map of a robot in space a :class:`SpatialClearanceObjective` is made, and for one with rotations a
    :class:`TurningClearanceObjective`, whose metres are those of OMPL's SE(2): a radian of turn counts as half a metre,
    but for curves, whose length is that of the curve. What shall serve such maps derives from those.

    OMPL asks this objective through Python at every step, which rules out the planners that ask from a second thread:
    PRM and PRMstar would wait for each other without end. :func:`planners.plan` refuses those.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
    weight : float
        How many extra metres a metre at clearance zero is worth.
    comfort : float, optional
        Clearance in metres from which on a path costs its length. A tenth of the map's longer side, if left out.
    curve : {"dubins", "reeds-shepp"}, optional
    turning_radius : float, optional
        Metres; for curves, which need it.

    Raises
    ------
    InputError
        If ``weight`` is negative or not finite, or ``comfort`` is not above zero; and as :func:`planners.state_space`.
    """

    # A StateCostIntegralObjective would do the integral, but the bindings never call a Python subclass of it.

    def __new__(cls, si: Any, space: CSpace, **options: Any) -> ClearanceObjective:
        made: ClearanceObjective = super().__new__(class_for(cls, _CLASSES, space))
        return made

    def __init__(
        self,
        si: Any,
        space: CSpace,
        *,
        weight: float = 10.0,
        comfort: float | None = None,
        curve: str | None = None,
        turning_radius: float | None = None,
    ) -> None:
        super().__init__(si)
        self._way = way_of(space, False, curve, turning_radius)
        self._turn_weight = 0.5 if curve is None else 0.0
        if finite(weight, "weight").ndim or weight < 0.0:
            raise InputError(f"weight is {weight!r}; it must be one number, zero or above; pass e.g. 10.0")
        grid = space.grid
        reach = COMFORT * grid.spacing * max(grid.shape) if comfort is None else positive(comfort, "comfort")
        self._weight = float(weight)
        self._scale = 1.0 / reach
        self._step = grid.spacing
        self._clearance = space.clearance_checker()
        self._clearances = space.clearance

    def stateCost(self, state: Any) -> Any:  # noqa: N802 - OMPL's name
        """Cost of a metre of path at a state."""
        short = max(0.0, 1.0 - self._scale * self._clearance(state[0], state[1]))
        return ob.Cost(1.0 + self._weight * short * short)

    def motionCost(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
        """Cost of a straight edge: its length times the mean cost at the middles of equal steps."""
        x, y = first[0], first[1]
        dx, dy = second[0] - x, second[1] - y
        length = math.hypot(dx, dy)
        steps = math.ceil(length / self._step)
        if not steps:
            return ob.Cost(0.0)
        lack = (self._lack if steps <= _FEW else self._lack_of_many)(x, y, dx / steps, dy / steps, steps)
        return ob.Cost(length * (1.0 + self._weight * lack / steps))

    def motionCostHeuristic(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
        """Length of the edge, which its cost is never below."""
        return ob.Cost(math.hypot(second[0] - first[0], second[1] - first[1]))

    def _lack(self, x: float, y: float, dx: float, dy: float, steps: int) -> float:
        """Sum of the squared lack of clearance, as a share of the comfortable one, at the middles of steps."""
        clearance, scale, total = self._clearance, self._scale, 0.0
        for k in range(steps):
            short = 1.0 - scale * clearance(x + (k + 0.5) * dx, y + (k + 0.5) * dy)
            if short > 0.0:
                total += short * short
        return total

    def _lack_of_many(self, x: float, y: float, dx: float, dy: float, steps: int) -> float:
        """The same in one look-up."""
        k = np.arange(0.5, steps)
        return self._lack_at(np.stack([x + k * dx, y + k * dy], axis=-1))

    def _lack_at(self, points: Floats) -> float:
        short = np.maximum(0.0, 1.0 - self._scale * self._clearances(points))
        return float(short @ short)


class SpatialClearanceObjective(ClearanceObjective):
    """The same for states ``(x, y, z)``."""

    def stateCost(self, state: Any) -> Any:  # noqa: N802 - OMPL's name
        """Cost of a metre of path at a state."""
        short = max(0.0, 1.0 - self._scale * self._clearance(state[0], state[1], state[2]))
        return ob.Cost(1.0 + self._weight * short * short)

    def motionCost(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
        """Cost of a straight edge: its length times the mean cost at the middles of equal steps."""
        x, y, z = first[0], first[1], first[2]
        dx, dy, dz = second[0] - x, second[1] - y, second[2] - z
        length = math.hypot(dx, dy, dz)
        steps = math.ceil(length / self._step)
        if not steps:
            return ob.Cost(0.0)
        if steps > _FEW:
            share = np.arange(0.5, steps) / steps
            lack = self._lack_at(np.stack([x + share * dx, y + share * dy, z + share * dz], axis=-1))
        else:
            clearance, scale, lack = self._clearance, self._scale, 0.0
            for k in range(steps):
                part = (k + 0.5) / steps
                short = 1.0 - scale * clearance(x + part * dx, y + part * dy, z + part * dz)
                if short > 0.0:
                    lack += short * short
        return ob.Cost(length * (1.0 + self._weight * lack / steps))

    def motionCostHeuristic(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
        """Length of the edge, which its cost is never below."""
        return ob.Cost(math.hypot(second[0] - first[0], second[1] - first[1], second[2] - first[2]))


class TurningClearanceObjective(ClearanceObjective):
    """The same for states ``(x, y, yaw)``, with the clearance of the translation."""

    def stateCost(self, state: Any) -> Any:  # noqa: N802 - OMPL's name
        """Cost of a metre of path at a state."""
        short = max(0.0, 1.0 - self._scale * self._clearance(*TURNING.read(state)))
        return ob.Cost(1.0 + self._weight * short * short)

    def motionCost(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
        """Cost of an edge: the cost at the middles of its pieces times their lengths."""
        pieces = self._way.pieces(_ends(first, second), self._step, DENSE_TURN)
        short = np.maximum(0.0, 1.0 - self._scale * self._clearances(pieces.middles))
        lengths = pieces.lengths + self._turn_weight * pieces.turns
        return ob.Cost(float(lengths.sum() + self._weight * (lengths @ (short * short))))

    def motionCostHeuristic(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
        """Length of the edge as the straight line, which its cost is never below."""
        return ob.Cost(math.hypot(second.getX() - first.getX(), second.getY() - first.getY()))


def _ends(first: Any, second: Any) -> Floats:
    return np.array([TURNING.read(first), TURNING.read(second)])


_CLASSES: Final[dict[Kind, type]] = {
    PLANE: ClearanceObjective,
    SPACE: SpatialClearanceObjective,
    TURNING: TurningClearanceObjective,
}
