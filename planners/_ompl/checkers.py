"""OMPL's callbacks: validity of states and motions, FREE samples and costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import util as ou

from cspace import CSpace, Rotations, Space
from cspace.errors import ConfigurationError, InputError
from cspace.inside import Drive, Floats, check_rng, names_options
from planners._edges.drives import local_planner
from planners._edges.local_planner import LocalPlanner, wrap_yaw
from planners._ompl.states import check_information, find_state_kind, make_states


class StateValidityChecker(ob.StateValidityChecker):
    """Checker of OMPL's states, valid if proven free.

    A certified map, or the geometry of an arm, gives the proof. States in MIXED cells of a map are
    invalid, unless the space is ``space.exact`` and the geometry proves them free.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : Space

    Attributes
    ----------
    is_free : callable
        Test of a state; a plan replaces it by a test that ends at its time limit.
    """

    @names_options
    def __init__(self, si: ob.SpaceInformation, space: Space) -> None:
        """Make the test of states from the space's test."""
        check_information(si, space)
        super().__init__(si)
        kind = find_state_kind(space)
        self.is_free = kind.of_states(space.point_checker())

        def clearance(*q: float) -> float:
            """Return a configuration's clearance; 0 beyond joints' limits."""
            try:
                return float(space.clearance(q))
            except ConfigurationError:
                return 0.0

        self._clearance = kind.of_states(clearance)

    def isValid(self, state: ob.State) -> bool:  # noqa: N802 - OMPL's name
        """Return True if the state is proven free."""
        return self.is_free(state)

    def clearance(self, state: ob.State) -> float:
        """Bound a state's clearance from below, metres.

        It is :meth:`cspace.Space.clearance`; for an arm, the obstacle distance.
        """
        return self._clearance(state)


class MotionValidator(ob.MotionValidator):
    """Validator of OMPL's motions on a certified map.

    A motion is valid if every cell that its edge touches is FREE. The test is exact at any length
    and does not use OMPL's checking resolution. With a drive, the edge is the driven motion itself
    (turn, line and turn, or the curve), not a chain of samples on it. OMPL now and then uses a
    curve that is not the shortest; such a motion is invalid.

    OMPL can also ask for the last valid state of a motion, which its Python bindings cannot return.
    So ``ompl.base.ObstacleBasedValidStateSampler``, which relies on it, returns invalid states with
    any motion validator in Python; :func:`planners.simple_setup` refuses the pair.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`. The validator does not store it, because it would never
        be freed.
    space : Space
    drive
        As for :func:`planners.plan`.
    bidirectional : bool
        Whether an edge must also be free from its end to its start. Planners that follow edges both
        ways, such as BKPIECE1 and PRM, need it if the robot does not drive backwards.

    Attributes
    ----------
    is_free : callable
        Proof of the edge between two states; a plan replaces it by a proof that ends at its time
        limit.

    Raises
    ------
    InputError
        As :func:`planners.state_space`.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> from ompl import base as ob
    >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
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

    @names_options
    def __init__(
        self,
        si: ob.SpaceInformation,
        space: Space,
        *,
        drive: Drive | None = None,
        bidirectional: bool = False,
    ) -> None:
        """Make an edge's proof by the robot's drive."""
        check_information(si, space)
        super().__init__(si)
        edges = local_planner(space, drive, bidirectional)
        self.is_free = make_motion_checker(edges)

    def checkMotion(self, first: ob.State, second: ob.State) -> bool:  # noqa: N802 - OMPL's name
        """Return True if a whole motion is proven free."""
        return self.is_free(first, second)


def make_motion_checker(edges: LocalPlanner) -> Callable[[ob.State, ob.State], bool]:
    """Make ``check(first, second)``, which proves motions between states free.

    OMPL's curve must be as short as ours, because only the shortest curves are proven.
    """
    kind = find_state_kind(edges.space)
    prover = edges.curve_prover()
    curves = edges.curve_states
    if prover is None or curves is None:
        check = kind.of_states(edges.edge_checker())
        if not edges.bidirectional:
            return check
        return lambda first, second: check(first, second) and check(second, first)
    prove = kind.of_states(prover)
    states = make_states(edges)
    tolerance = 1e-6 * curves[1]  # in proportion to the turning radius

    def check_curve(first: ob.State, second: ob.State) -> bool:
        """Prove the shortest curves free, and OMPL's curve as short."""
        length = prove(first, second)
        return length >= 0.0 and bool(states.distance(first, second) <= length + tolerance)

    return check_curve


class FreeStateSampler(ob.ValidStateSampler):
    """Uniform sampler of the FREE area or volume, without rejection.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
        A map in memory.
    rng : numpy.random.Generator, optional
        Source of randomness. The default is a generator seeded by OMPL's, so that
        ``ompl.util.RNG.setSeed`` makes the draws repeatable.

    Raises
    ------
    InputError
        If ``space`` is not a map in memory, or ``rng`` is not a Generator.
    """

    def __init__(
        self, si: ob.SpaceInformation, space: CSpace, rng: np.random.Generator | None = None
    ) -> None:
        """Seed the draws; require a map in memory."""
        check_information(si, space)
        if not isinstance(space, CSpace):
            raise InputError(
                "space",
                f"is a {type(space).__name__}",
                "it must be a CSpace",
            )
        super().__init__(si)
        if rng is None:
            rng = np.random.default_rng(ou.RNG().getLocalSeed())
        check_rng(rng)
        self._kind = find_state_kind(space)
        self._rotations = space.rotations
        # Batches, because a single draw would spend its time in the overhead of a call.
        self._points = _draw_batches(lambda n: space.sample_free(n, rng))
        self._numbers = _draw_batches(rng.random)
        self._is_free = space.point_checker()
        self._box = tuple(zip(space.grid.lower, space.grid.upper, strict=True))

    def sample(self, state: ob.State) -> bool:
        """Set ``state`` to a FREE configuration.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        """
        # Test each point again, because the map may have been updated since the draw.
        q = next(point for point in self._points if self._is_free(*point))
        self._kind.write(state, *q)
        return True

    def sampleNear(self, state: ob.State, near: ob.State, distance: float) -> bool:  # noqa: N802 - OMPL's name
        """Set ``state`` to a FREE configuration near another.

        ``distance`` holds along each axis, in metres and radians. Returns False if no draw of
        ``getNrAttempts`` is FREE; ``state`` is then unchanged.
        """
        center = self._kind.read(near)
        center_rotation = center[len(self._box) :]
        max_turn = min(distance, math.pi)
        numbers = self._numbers
        # Positions within the distance and the grid.
        box = [
            (max(low, x - distance), min(high, x + distance))
            for (low, high), x in zip(self._box, center, strict=False)
        ]
        if any(low > high for low, high in box):
            return False
        for _ in range(max(1, self.getNrAttempts())):
            position = [min(low + next(numbers) * (high - low), high) for low, high in box]
            rotation = sample_rotation(self._rotations, center_rotation, max_turn, numbers)
            q = (*position, *rotation)
            if self._is_free(*q):
                self._kind.write(state, *q)
                return True
        return False


def sample_rotation(
    rotations: Rotations, center: Sequence[float], angle: float, numbers: Iterator[float]
) -> Sequence[float]:
    """Sample a rotation within an angle of another.

    ``numbers`` are uniform from 0 to 1.
    """
    if len(center) < 2:  # one yaw, or no rotation, in plain floats: samples come one by one
        return [wrap_yaw(yaw + (2.0 * next(numbers) - 1.0) * angle) for yaw in center]
    # Draw from the largest cube of rotation vectors in the ball of radius ``angle``.
    half_side = angle / math.sqrt(3.0)
    vector = [(2.0 * next(numbers) - 1.0) * half_side for _ in range(3)]
    rotated: list[float] = rotations.add_steps(np.array(center), np.array(vector)).tolist()
    return rotated


def _draw_batches(draw: Callable[[int], Floats]) -> Iterator[Any]:
    """Yield random rows or numbers without end, from batches."""
    while True:
        # Random draws per call of numpy.
        yield from draw(256).tolist()


class EdgeCosts(ob.OptimizationObjective):
    """Costs of edges, for planners of OMPL.

    OMPL calls it through Python at every step. PRM and PRMstar would call it from a second thread,
    and wait for ever.

    Attributes
    ----------
    edge_cost : callable
        Cost of the edge between two states; a plan replaces it by a function that ends at its time
        limit.
    is_length : bool
        Whether the cost of each edge is its length.
    """

    # A StateCostIntegralObjective would do the integral, but the bindings never call its Python
    # subclasses.

    def __init__(self, si: ob.SpaceInformation, edges: LocalPlanner) -> None:
        """Make an edge's cost by the robot's drive."""
        super().__init__(si)
        self._edges = edges
        self._kind = find_state_kind(edges.space)
        self.is_length = edges.weights is None
        self.edge_cost = self._kind.of_states(edges.cost())
        # Positions of both ends among their numbers.
        dim, size = edges.space.dim, edges.space.size
        self._measure_line = self._kind.of_states(
            lambda *ends: math.dist(ends[:dim], ends[size : size + dim])
        )

    def stateCost(self, state: ob.State) -> ob.Cost:  # noqa: N802 - OMPL's name
        """Return the cost of a metre in a state's cell."""
        weights = self._edges.weights
        if weights is None:
            return ob.Cost(1.0)
        from planners._searches.chains import find_cells

        cells = self._edges.cells
        rotation, *position = find_cells(cells, np.array(self._kind.read(state)))
        return ob.Cost(float(weights.factors[cells.slice_of[rotation], *position]))

    def motionCost(self, first: ob.State, second: ob.State) -> ob.Cost:  # noqa: N802 - OMPL's name
        """Return the cost of an edge."""
        return ob.Cost(self.edge_cost(first, second))

    def motionCostHeuristic(self, first: ob.State, second: ob.State) -> ob.Cost:  # noqa: N802 - OMPL's name
        """Return the straight length, which bounds the cost."""
        return ob.Cost(self._measure_line(first, second))
