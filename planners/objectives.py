"""What makes one path better than another."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Final

from ompl import base as ob

from cspace.arrays import FREE
from cspace.check import check_not_negative, check_positive
from cspace.errors import InputError
from cspace.map.periodic import with_wrapped_angles
from cspace.space import CSpace
from cspace.spectral import OverlapField
from planners.integrals import CostDensity, Field, edge_cost
from planners.local_planner import HOLONOMIC, EdgesOnMap, local_planner
from planners.states import check_information, kind_of

COMFORT: Final = 0.1
"""Clearance beyond which more is not worth a detour, as a share of the map's longer side, where none is given."""


class WeightedLength(ob.OptimizationObjective):
    """Length, in which a metre of path costs ``1 + weight * max(0, penalty)**2``, integrated along each edge.

    The penalty of a configuration is ``offset + slope * value``, of a value that a field has there.

    The integral takes the middles of steps of at most one cell and 5 degrees. The cost is never below the length, which
    OMPL may use as a bound. A radian of turn counts as half a metre, as in OMPL's SE(2) and SE(3); but for curves,
    whose length is that of the curve.

    OMPL calls this objective through Python at every step, which rules out the planners that call it from a second
    thread: PRM and PRMstar would deadlock. :func:`planners.plan` refuses those.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
    field : Marks or ndarray of float64, optional
        Source of the value: the clearance, by the marks of the map, or an array of the shape of the map's states. If
        left out, the bare length is taken.
    offset, slope : float
    weight : float
    drive : {"holonomic", "differential", "differential-reverse", "dubins", "reeds-shepp"}
        As for :func:`planners.plan`.
    turning_radius : float, optional
        Metres; for curves, which need it.

    Raises
    ------
    InputError
        If ``weight`` is negative or not finite; and as :func:`planners.state_space`.
    """

    # A StateCostIntegralObjective would do the integral, but the bindings never call a Python subclass of it.

    def __init__(
        self,
        si: ob.SpaceInformation,
        space: CSpace,
        field: Field = None,
        *,
        offset: float = 0.0,
        slope: float = 1.0,
        weight: float = 10.0,
        drive: str = HOLONOMIC,
        turning_radius: float | None = None,
    ) -> None:
        check_information(si, space)
        super().__init__(si)
        weight = check_not_negative(weight, "weight", "pass 10.0")
        edges = edges_on_map(space, drive, turning_radius)
        self._field, self._law = field, CostDensity(offset, slope, weight, edges.turn_weight)
        self._kind, self._space, dim, size = kind_of(space), space, space.grid.dim, space.size
        line = with_wrapped_angles(
            lambda *endpoints: math.dist(endpoints[:dim], endpoints[size : size + dim]), space.periodic_axes
        )
        self._line = self._kind.of_states(line)
        self._cost = self._own_cost = self._kind.of_states(edges.edge_cost(field, self._law))

    @property
    def is_length(self) -> bool:
        """Whether a metre costs the same everywhere."""
        return self._field is None or self._law.weight == 0.0

    def stateCost(self, state: ob.State) -> ob.Cost:  # noqa: N802 - OMPL's name
        """Cost of a metre of path at a state."""
        q = self._kind.read(state)
        return ob.Cost(self._by_metre(*q, *q))

    def motionCost(self, first: ob.State, second: ob.State) -> ob.Cost:  # noqa: N802 - OMPL's name
        """Cost of an edge: the costs of a metre at the middles of its steps times their lengths."""
        return ob.Cost(self._cost(first, second))

    def motionCostHeuristic(self, first: ob.State, second: ob.State) -> ob.Cost:  # noqa: N802 - OMPL's name
        """Length of the straight line, which the cost is never below."""
        return ob.Cost(self._line(first, second))

    @cached_property
    def _by_metre(self) -> Callable[..., float]:
        return edge_cost(self._space, self._field, self._law._replace(by_metre=True))

    def _override(self, answer: Callable[[ob.State, ob.State], float] | None) -> None:
        """Give the cost of edges by a function from now on, or as before; so a plan out of time ends a search."""
        self._cost = answer or self._own_cost


class ClearanceObjective(WeightedLength):
    """Length, weighted by how near the path comes to configurations that are not FREE.

    A metre of path at clearance c costs ``1 + weight * max(0, 1 - c / clearance_threshold)**2``; see
    :class:`WeightedLength`. Of a robot that turns, the clearance is that of the translation.

    Parameters
    ----------
    si, space, drive, turning_radius
        As for :class:`WeightedLength`.
    weight : float
        How many extra metres a metre at clearance zero is worth.
    clearance_threshold : float, optional
        Clearance in metres from which on a path costs its length. A tenth of the map's longer side, if left out.

    Raises
    ------
    InputError
        If ``weight`` is negative or not finite, or ``clearance_threshold`` is not above zero; and as
        :func:`planners.state_space`.
    """

    def __init__(
        self,
        si: ob.SpaceInformation,
        space: CSpace,
        *,
        weight: float = 10.0,
        clearance_threshold: float | None = None,
        drive: str = HOLONOMIC,
        turning_radius: float | None = None,
    ) -> None:
        check_information(si, space)
        grid = space.grid
        scale = 1.0 / (
            COMFORT * grid.spacing * max(grid.shape)
            if clearance_threshold is None
            else check_positive(clearance_threshold, "clearance_threshold")
        )
        super().__init__(
            si,
            space,
            space._live_marks,
            offset=1.0,
            slope=-scale,
            weight=weight,
            drive=drive,
            turning_radius=turning_radius,
        )


class OverlapObjective(WeightedLength):
    """Length, weighted by how much the descriptors of robot and obstacles overlap: a smooth push away from obstacles.

    A metre of path at overlap c costs ``1 + weight * (c / saturation)**2``; see :class:`WeightedLength`. If the balls
    of the field are grown, the overlap begins before the shapes touch, by the growth of both.

    Parameters
    ----------
    si, space, drive, turning_radius
        As for :class:`WeightedLength`.
    field : cspace.spectral.OverlapField, optional
        Of the same map; the one that the map carries (:meth:`cspace.CSpace.with_overlap_field`), if left out.
    weight : float
        How many extra metres a metre at overlap ``saturation`` is worth.
    saturation : float, optional
        Overlap, square or cubic metres; the largest in a FREE cell, if left out.

    Raises
    ------
    InputError
        If the field is that of another map, or left out and the map carries none, ``weight`` is negative or not finite,
        or ``saturation`` is not above zero; and as :func:`planners.state_space`.
    """

    def __init__(
        self,
        si: ob.SpaceInformation,
        space: CSpace,
        field: OverlapField | None = None,
        *,
        weight: float = 10.0,
        saturation: float | None = None,
        drive: str = HOLONOMIC,
        turning_radius: float | None = None,
    ) -> None:
        check_information(si, space)
        known = overlap_field(space, field)
        if saturation is None:
            saturation = _largest_free(space, known)
        else:
            saturation = check_positive(saturation, "saturation", "metres to the power of d")
        super().__init__(
            si,
            space,
            known.cells,
            slope=1.0 / saturation,
            weight=weight,
            drive=drive,
            turning_radius=turning_radius,
        )


def edges_on_map(space: CSpace, drive: str, turning_radius: float | None) -> EdgesOnMap:
    """How configurations of a map are joined, where cells have costs.

    Raises InputError if there are no cells; and as :func:`planners.state_space`.
    """
    edges = local_planner(space, False, drive, turning_radius)
    if not isinstance(edges, EdgesOnMap):
        rule, hint = "the objective weighs the cells of a map", "optimise the length of an arm's path, or a function"
        raise InputError("objective", f"is for maps, and space is {space!r}", rule, hint, value=space)
    return edges


def overlap_field(space: CSpace, field: OverlapField | None = None) -> OverlapField:
    """The field that was passed, or else the one that the map carries.

    Raises InputError if there is neither, or the field is that of another map.
    """
    known: OverlapField | None = space.overlap_field if field is None else field
    if known is None:
        rule, hint = "the objective needs a field", "pass one, or plan on space.with_overlap_field(overlap)"
        raise InputError("field", "is missing, and the map carries none", rule, hint)
    if known.space is not space:
        hint = "use OverlapField.of(space, ...)"
        raise InputError("field", "is that of another map", "both must be of the same", hint, value=field)
    return known


def _largest_free(space: CSpace, field: OverlapField) -> float:
    """Largest overlap in a FREE cell, or one where there is none above zero."""
    parts = zip(field.cells, space.slice_rotations, strict=True)
    largest = max(float(values[space.states_at(rotation) == FREE].max(initial=0.0)) for values, rotation in parts)
    return largest if largest > 0.0 else 1.0
