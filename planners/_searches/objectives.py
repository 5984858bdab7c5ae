"""Objectives: the cost of a metre by clearance, values of cells, or time.

Each becomes a cost on the cells of a map, 1 or above for a metre, which searches over cells take,
and the same cost along edges.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from cspace import CSpace, Space
from cspace.errors import InputError
from cspace.inside import (
    ConfigurationMap,
    Floats,
    as_contiguous,
    check_dims,
    check_finite,
    check_not_negative,
    check_positive,
    kept_values,
    names_options,
)

if TYPE_CHECKING:
    from ompl import base as ob

    from planners._edges.integrals import CellCost, Weigh
    from planners._motion.speed_limits import SpeedLike

MakeObjective: TypeAlias = "Callable[[ob.SpaceInformation], ob.OptimizationObjective]"

LENGTH: Final = "length"
CLEARANCE: Final = "clearance"
TIME: Final = "time"
COSTS: Final = "WeightedLength"
FUNCTION: Final = "a function"
"""Kinds of objectives of :func:`planners.plan`."""

DEFAULT_WEIGHT: Final = 10.0
"""Extra metres that a metre of path costs by default if the penalty is one."""


@names_options
@dataclass(frozen=True, slots=True, eq=False)
class WeightedLength:
    """Length with costs of your own, as the ``objective`` of :func:`planners.plan`.

    A metre costs ``1 + cost``, integrated along each edge by the midpoint rule in steps of at most
    one cell and 5 degrees. A radian of rotation counts as half a metre; along curves it counts
    nothing.

    Attributes
    ----------
    costs : array-like
        Extra metres that a metre of path costs in each cell of each slice, shape (slices, x, y) or
        (slices, x, y, z), without the first axis for a robot that does not turn. Values below zero
        count as zero. Between the centers of cells the cost is linear.

    Raises
    ------
    InputError
        If a number is not finite, or dimensions with names are not x, y (and z); by a plan, if the
        array has another shape than its map.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.zeros((60, 40), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
    >>> slippery = np.zeros(space.grid.shape)
    >>> slippery[20:40, :25] = 10.0
    >>> dry = planners.WeightedLength(slippery)
    >>> plan = planners.plan(space, (1.0, 1.5), (5.0, 1.5), objective=dry)
    >>> bool(plan.path[:, 1].max() > 2.4), plan.objective
    (True, 'WeightedLength')
    """

    costs: ArrayLike

    def __post_init__(self) -> None:
        """Convert the costs to an array of floats."""
        check_dims(self.costs, "costs")
        costs = as_contiguous(check_finite(self.costs, "costs"))
        object.__setattr__(self, "costs", costs)


@names_options
@dataclass(frozen=True, slots=True)
class ClearanceObjective:
    """Length whose metres cost more near obstacles, as the ``objective`` of :func:`planners.plan`.

    A metre of path at clearance c costs ``1 + weight * max(0, 1 - c / clearance_threshold)**2``.
    The clearance is the distance, in the translation alone, to the nearest configuration that is
    not FREE.

    Attributes
    ----------
    weight : float
        Extra metres that a metre of path costs at clearance zero.
    clearance_threshold : float, optional
        Clearance, in metres, above which a path costs its length. The default is the longest side
        of the robot's bounding box.

    Raises
    ------
    InputError
        If ``weight`` is negative, or ``clearance_threshold`` is not above zero.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.eye(60, dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
    >>> far = planners.ClearanceObjective(clearance_threshold=1.0)
    >>> shortest = planners.plan(space, (2.0, 1.0), (5.0, 4.0)).length
    >>> planners.plan(space, (2.0, 1.0), (5.0, 4.0), objective=far).length > 1.05 * shortest
    True
    """

    weight: float = DEFAULT_WEIGHT
    clearance_threshold: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        object.__setattr__(self, "weight", check_not_negative(self.weight, "weight", ""))
        if self.clearance_threshold is not None:
            threshold = check_positive(self.clearance_threshold, "clearance_threshold")
            object.__setattr__(self, "clearance_threshold", threshold)


ObjectiveLike: TypeAlias = "str | WeightedLength | ClearanceObjective | MakeObjective"
"""Objectives of :func:`planners.plan`."""


class Objective(NamedTuple):
    """A checked objective of a plan."""

    given: object  # by the user
    kind: str  # as planners declare it
    weigh: Weigh = lambda _: None
    make: MakeObjective | None = None  # of OMPL's objective, a function of the user's

    @property
    def name(self) -> str:
        """Name of the kind, as :attr:`planners.Plan.objective`."""
        return "custom" if self.kind == FUNCTION else self.kind


def read_objective(
    given: object, speed: SpeedLike | Sequence[SpeedLike] | None, space: Space
) -> Objective:
    """Check an objective of a plan.

    Raises InputError if the objective is unknown, or does not go with the space or the speed.
    """
    kind = given if isinstance(given, str) else ""
    if speed is not None and kind != TIME:
        problem = f"is {speed!r}, and objective is {given!r}"
        raise InputError("speed", problem, f"it is for objective={TIME!r}")
    if callable(given):
        return Objective(given, FUNCTION, make=given)
    if kind == LENGTH:
        return Objective(given, LENGTH)
    objective = ClearanceObjective() if kind == CLEARANCE else given
    if kind != TIME and not isinstance(objective, WeightedLength | ClearanceObjective):
        rule = (
            f"it must be {LENGTH!r}, {CLEARANCE!r}, {TIME!r}, a WeightedLength, a "
            "ClearanceObjective, or a function that makes OMPL's objective"
        )
        raise InputError("objective", f"is {objective!r}", rule)
    if not isinstance(space, ConfigurationMap):
        problem = f"is {objective!r}, and space is {space!r}"
        raise InputError("objective", problem, "it weighs the cells of a map")
    if isinstance(objective, ClearanceObjective):
        return Objective(given, CLEARANCE, partial(_weigh_clearance, objective))
    if isinstance(objective, WeightedLength):
        _check_shape(np.asarray(objective.costs), space)
        return Objective(given, COSTS, partial(_weigh_length, objective))
    from planners._searches.travel_time import read_speeds

    return Objective(given, TIME, read_speeds(speed, space))


def _check_shape(costs: Floats, space: ConfigurationMap) -> None:
    """Raise InputError unless each cell of each slice has a cost."""
    if not isinstance(space, CSpace):
        rule = "costs of cells are for maps in memory"
        raise InputError("objective", f"has costs, and space is {space!r}", rule)
    shape = len(space.slice_rotations), *space.grid.shape
    if costs.shape != shape and (1, *costs.shape) != shape:
        problem = f"has shape {costs.shape}"
        raise InputError("costs", problem, f"the map has slices and cells of shape {shape}")


def _weigh_clearance(objective: ClearanceObjective, space: CSpace) -> CellCost:
    """Return the cost of a metre by clearance."""
    from cspace.inside import DistanceTable
    from planners._edges.integrals import CellCost, CostDensity, check_costs_fit

    check_costs_fit(space)
    threshold = objective.clearance_threshold
    if threshold is None:
        threshold = default_clearance_threshold(space)
    density = CostDensity(1.0, -1.0 / threshold, objective.weight)
    distances = DistanceTable.of(space).cells
    kept = kept_values(space)
    known = kept.get("clearance costs")
    # Distances are new after each change of the map.
    if known is None or known[0] is not distances or known[1] != density:
        shares = distances.reshape(-1, *space.grid.shape) * (space.grid.spacing / threshold)
        penalties = np.clip(1.0 - shares, 0.0, 1.0)
        factors = 1.0 + objective.weight * penalties * penalties
        known = distances, density, factors.astype(np.float32, copy=False)
        kept["clearance costs"] = known
    return CellCost(known[2], density)


def _weigh_length(objective: WeightedLength, space: CSpace) -> CellCost:
    """Return the cost of a metre by the user's values."""
    from planners._edges.integrals import CellCost, check_costs_fit

    check_costs_fit(space)
    costs = np.asarray(objective.costs, dtype=np.float32).reshape(-1, *space.grid.shape)
    return CellCost(np.float32(1.0) + np.maximum(costs, np.float32(0.0)), None)


def default_clearance_threshold(space: CSpace) -> float:
    """Return the default clearance threshold, the robot's longest side.

    It is in metres, and at least one cell.
    """
    lower, upper = space.drawn_robot.shape.outer.bounds
    return max(float((upper - lower).max()), space.grid.spacing)
