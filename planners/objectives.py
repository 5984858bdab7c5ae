"""What makes one path better than another."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from ompl import base as ob

from cspace.errors import InputError
from cspace.grid import finite, positive
from cspace.states import FREE
from planners.states import PLANE, SPACE, TURNING, Kind, class_for
from planners.straight import DENSE_TURN, Floats
from planners.ways import way_of

if TYPE_CHECKING:
    from cspace.space import CSpace
    from cspace.spectral import OverlapField

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

    def __new__(cls, si: Any, space: CSpace, *more: Any, **options: Any) -> ClearanceObjective:
        made: ClearanceObjective = super().__new__(class_for(cls, cls._classes(), space))
        return made

    @staticmethod
    def _classes() -> dict[Kind, type]:
        """The class for each kind of states."""
        return _CLASSES

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
        self._set_way(space, weight, curve, turning_radius)
        grid = space.grid
        reach = COMFORT * grid.spacing * max(grid.shape) if comfort is None else positive(comfort, "comfort")
        self._scale = 1.0 / reach
        self._clearance = space.clearance_checker()
        self._clearances: Callable[[Floats], Any] = space.clearance

    def _set_way(self, space: CSpace, weight: float, curve: str | None, turning_radius: float | None) -> None:
        self._way = way_of(space, False, curve, turning_radius)
        self._turn_weight = 0.5 if curve is None else 0.0
        if finite(weight, "weight").ndim or weight < 0.0:
            raise InputError(f"weight is {weight!r}; it must be one number, zero or above; pass e.g. 10.0")
        self._weight = float(weight)
        self._step = space.grid.spacing

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


class OverlapObjective(ClearanceObjective):
    """Length, weighted by how much the descriptors of robot and obstacles overlap: a smooth push away from obstacles.

    A metre of path at overlap c costs ``1 + weight * (c / full)**2``, integrated as by :class:`ClearanceObjective`.
    Where the balls of the field are grown, the overlap begins before the shapes touch, by the growth of both.

    For a map of a robot in space a :class:`SpatialOverlapObjective` is made, and for one with rotations a
    :class:`TurningOverlapObjective`.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
    field : cspace.spectral.OverlapField, optional
        Of the same map; the one that the map carries (:meth:`cspace.CSpace.with_overlap_field`), if left out.
    weight : float
        How many extra metres a metre at overlap ``full`` is worth.
    full : float, optional
        Overlap, square or cubic metres; the largest in a FREE cell, if left out.
    curve : {"dubins", "reeds-shepp"}, optional
    turning_radius : float, optional
        Metres; for curves, which need it.

    Raises
    ------
    InputError
        If the field is that of another map, or left out and the map carries none, ``weight`` is negative or not finite,
        or ``full`` is not above zero; and as :func:`planners.state_space`.
    """

    @staticmethod
    def _classes() -> dict[Kind, type]:
        return _OVERLAP_CLASSES

    def __init__(
        self,
        si: Any,
        space: CSpace,
        field: OverlapField | None = None,
        *,
        weight: float = 10.0,
        full: float | None = None,
        curve: str | None = None,
        turning_radius: float | None = None,
    ) -> None:
        ob.OptimizationObjective.__init__(self, si)
        self._set_way(space, weight, curve, turning_radius)
        known = field_of(space, field)
        whole = _largest_free(space, known) if full is None else positive(full, "full", "metres to the power of d")
        overlap, overlaps = known.checker(), known.at
        # What clearance lacks of the comfortable one is, here, the overlap as a share of the full one.
        self._scale = 1.0
        self._clearance = lambda *q: 1.0 - overlap(*q) / whole
        self._clearances = lambda points: 1.0 - overlaps(points) / whole


class SpatialOverlapObjective(OverlapObjective):
    """The same for states ``(x, y, z)``."""

    # The bindings allow a class one base only.
    stateCost = SpatialClearanceObjective.stateCost  # noqa: N815 - OMPL's name
    motionCost = SpatialClearanceObjective.motionCost  # noqa: N815 - OMPL's name
    motionCostHeuristic = SpatialClearanceObjective.motionCostHeuristic  # noqa: N815 - OMPL's name


class TurningOverlapObjective(OverlapObjective):
    """The same for states ``(x, y, yaw)``."""

    stateCost = TurningClearanceObjective.stateCost  # noqa: N815 - OMPL's name
    motionCost = TurningClearanceObjective.motionCost  # noqa: N815 - OMPL's name
    motionCostHeuristic = TurningClearanceObjective.motionCostHeuristic  # noqa: N815 - OMPL's name


def field_of(space: CSpace, field: OverlapField | None = None) -> OverlapField:
    """The field that was passed, or else the one that the map carries.

    Raises
    ------
    InputError
        If there is neither, or the field is that of another map.
    """
    found = space.overlap_field if field is None else field
    if found is None:
        raise InputError(
            "the map carries no overlap field and none was passed; the objective needs one; pass field, or plan on "
            "space.with_overlap_field(overlap)"
        )
    if found.space is not space:
        raise InputError("field is that of another map; both must be of the same; use OverlapField.of(space, ...)")
    return found


def _largest_free(space: CSpace, field: OverlapField) -> float:
    """Largest overlap in a FREE cell, or one where there is none above zero."""
    largest = float(field.values.reshape(space.stack.shape)[space.stack == FREE].max(initial=0.0))
    return largest if largest > 0.0 else 1.0


_OVERLAP_CLASSES: Final[dict[Kind, type]] = {
    PLANE: OverlapObjective,
    SPACE: SpatialOverlapObjective,
    TURNING: TurningOverlapObjective,
}
