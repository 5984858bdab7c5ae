"""Objectives of OMPL that weight length by clearance, or by any values on the cells of a map."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from ompl import base as ob

from cspace import CSpace, Space
from cspace.errors import InputError
from cspace.inside import (
    ConfigurationMap,
    Effort,
    Floats,
    as_contiguous,
    check_finite,
    check_known,
    check_not_negative,
    check_number,
    check_positive,
)
from planners._drives import local_planner
from planners._integrals import CostDensity, Field
from planners._local_planner import Drive, LocalPlanner
from planners._ompl_states import check_information, find_state_kind

if TYPE_CHECKING:
    from planners._estimate import Costs

DEFAULT_WEIGHT: Final = 10.0
"""Extra metres that a metre of path costs by default where the penalty is one."""


class WeightedLength(ob.OptimizationObjective):
    """Length with a cost of each metre.

    A metre costs ``1 + weight * max(0, penalty)**2``, integrated along each edge. The penalty of a
    configuration is ``offset + slope * value``, for the value of a field. The integral uses the
    midpoint rule in steps of at most one cell and 5 degrees. The cost is never below the length,
    which OMPL may use as a bound. A radian of rotation counts as half a metre, as in OMPL's SE(2)
    and SE(3); along curves it counts nothing.

    OMPL calls this objective through Python at every step. PRM and PRMstar would call it from a
    second thread, and wait for ever.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        From a :func:`planners.state_space`.
    space : CSpace
    field : "clearance" or ndarray of float64, optional
        Source of the value. An array has a value for each cell of each slice, shape (slices, x, y)
        or (slices, x, y, z), without the first axis for a robot that does not turn. The default is
        the plain length.
    offset, slope : float
        Penalty at value zero, and its change per unit of the value.
    weight : float
        Extra metres that a metre of path costs at penalty one.
    drive
        As for :func:`planners.plan`.

    Attributes
    ----------
    edge_cost : callable
        Cost of the edge between two states; a plan replaces it by one that ends at its time limit.

    Raises
    ------
    InputError
        If ``weight`` is negative, a number is not finite, the array has another shape, or ``si``
        has states of another space; and as :func:`planners.state_space`.
    """

    # A StateCostIntegralObjective would do the integral, but the bindings never call its Python
    # subclasses.

    def __init__(
        self,
        si: ob.SpaceInformation,
        space: CSpace,
        field: Field = None,
        *,
        offset: float = 0.0,
        slope: float = 1.0,
        weight: float = DEFAULT_WEIGHT,
        drive: Drive | None = None,
    ) -> None:
        """Make an edge's cost by the robot's drive."""
        check_information(si, space)
        super().__init__(si)
        weight = check_not_negative(weight, "weight", "")
        offset = check_number(offset, "offset")
        slope = check_number(slope, "slope")
        check_has_cells(space)
        if isinstance(field, str):
            check_known(field, "field", ["clearance"])
        elif field is not None:
            field = _check_costs(field, space)
        edges = local_planner(space, drive)
        self._field = field
        self._density = CostDensity(offset, slope, weight, edges.rotation_weight)
        self._kind = find_state_kind(space)
        self._space = space
        # Positions of both ends among their numbers.
        dim = space.dim
        size = space.size
        self._measure_line = self._kind.of_states(
            lambda *ends: math.dist(ends[:dim], ends[size : size + dim])
        )
        self.edge_cost = self._kind.of_states(edges.edge_cost(field, self._density))

    @property
    def _is_length(self) -> bool:
        """Whether a metre costs the same at every configuration."""
        return self._field is None or self._density.weight == 0.0

    def stateCost(self, state: ob.State) -> ob.Cost:  # noqa: N802 - OMPL's name
        """Return the cost per metre at a state."""
        q = self._kind.read(state)
        return ob.Cost(self._cost_per_metre(*q, *q))

    def motionCost(self, first: ob.State, second: ob.State) -> ob.Cost:  # noqa: N802 - OMPL's name
        """Return the cost of an edge."""
        return ob.Cost(self.edge_cost(first, second))

    def motionCostHeuristic(self, first: ob.State, second: ob.State) -> ob.Cost:  # noqa: N802 - OMPL's name
        """Return the straight length, which bounds the cost."""
        return ob.Cost(self._measure_line(first, second))

    @cached_property
    def _cost_per_metre(self) -> Callable[..., float]:
        """Cost per metre at a configuration, as a function."""
        density = self._density._replace(mean_per_metre=True)
        return LocalPlanner(self._space).edge_cost(self._field, density)


class ClearanceObjective(WeightedLength):
    """Length whose metres cost more near obstacles.

    A metre of path at clearance c costs ``1 + weight * max(0, 1 - c / clearance_threshold)**2``.
    The clearance is the distance, in the translation alone, to the nearest configuration that is
    not FREE.

    Parameters
    ----------
    si, space, weight, drive
        As for :class:`WeightedLength`; the penalty is one at clearance zero.
    clearance_threshold : float, optional
        Clearance, in metres, above which a path costs its length. The default is the longest side
        of the robot's bounding box.

    Raises
    ------
    InputError
        If ``clearance_threshold`` is not above zero; and as :class:`WeightedLength`.
    """

    def __init__(
        self,
        si: ob.SpaceInformation,
        space: CSpace,
        *,
        weight: float = DEFAULT_WEIGHT,
        clearance_threshold: float | None = None,
        drive: Drive | None = None,
    ) -> None:
        """Choose the threshold, where the penalty becomes zero."""
        check_information(si, space)
        if clearance_threshold is None:
            clearance_threshold = default_clearance_threshold(space)
        threshold = check_positive(clearance_threshold, "clearance_threshold")
        super().__init__(
            si,
            space,
            "clearance",
            offset=1.0,
            slope=-1.0 / threshold,
            weight=weight,
            drive=drive,
        )


def _check_costs(field: Floats, space: CSpace) -> Floats:
    """Return a value for each cell, shape (slices, ...)."""
    costs = check_finite(field, "field")
    shape = len(space.slice_rotations), *space.grid.shape
    if costs.shape != shape and (1, *costs.shape) != shape:
        raise InputError(
            "field",
            f"has shape {costs.shape}",
            f"the map has slices and cells of shape {shape}",
        )
    return as_contiguous(costs)


def default_clearance_threshold(space: CSpace) -> float:
    """Return the default clearance threshold, the robot's longest side.

    It is in metres, and at least one cell.
    """
    lower, upper = space.drawn_robot.shape.outer.bounds
    return max(float((upper - lower).max()), space.grid.spacing)


def find_clear_path(
    edges: LocalPlanner, endpoints: Floats, straight: bool, limit: Effort
) -> Floats:
    """Find a path through FREE cells, cheap by :class:`ClearanceObjective`.

    Arguments, result and errors are those of :func:`planners._grid_search.find_short_path`.
    """
    from planners._grid_search import find_cheap_path

    space = edges.cells
    threshold = default_clearance_threshold(space)
    density = CostDensity(1.0, -1.0 / threshold, DEFAULT_WEIGHT, edges.rotation_weight)

    def find_factors(clearances: Costs) -> Costs:
        """Return the cost of a metre at each clearance."""
        penalties = np.maximum(np.float32(0.0), 1.0 - clearances / threshold)
        return np.asarray(1.0 + DEFAULT_WEIGHT * penalties * penalties)

    cost = edges.edge_cost("clearance", density)
    return find_cheap_path(space, endpoints, find_factors, cost, straight, limit)


def check_has_cells(space: Space) -> None:
    """Raise InputError for an objective in a space that is no map."""
    if not isinstance(space, ConfigurationMap):
        raise InputError(
            "objective",
            f"is for maps, and space is {space!r}",
            "it weighs cells",
        )
