"""What OMPL asks most: whether a state is free, one look-up, and whether a motion is, one compiled call."""

from __future__ import annotations

from collections.abc import Callable

from ompl import base as ob

from cspace.space import CSpace
from planners.car_curves import CarCurves
from planners.local_planner import local_planner
from planners.states import check_information, kind_of


class StateValidityChecker(ob.StateValidityChecker):
    """OMPL's question "is this state valid?", answered by a certified map of any space.

    Valid means FREE; a MIXED cell is not valid, unless ``exact`` is wanted and the geometry itself is free there.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
    exact : bool
        Whether the geometry itself is asked where the map cannot decide.
    """

    def __init__(self, si: ob.SpaceInformation, space: CSpace, *, exact: bool = False) -> None:
        check_information(si, space)
        super().__init__(si)
        self._kind = kind_of(space)
        self._space = space
        self._is_free = self._ask_map = self._kind.of_state(space.point_checker(exact=exact))
        self._clearance: Callable[[ob.State], float] | None = None

    def isValid(self, state: ob.State) -> bool:  # noqa: N802 - OMPL's name
        """Whether the state is FREE."""
        return self._is_free(state)

    def clearance(self, state: ob.State) -> float:
        """Lower bound of the distance to the nearest position that is not FREE, at the state's rotation, in metres."""
        if self._clearance is None:
            # Distances cost a pass over the map, and few planners ask for them.
            self._clearance = self._kind.of_state(self._space.clearance_checker())
        return self._clearance(state)

    def answer_with(self, answer: Callable[[ob.State], bool] | None) -> None:
        """Answer by a function from now on, or by the map again; so a plan that is out of time ends a search."""
        self._is_free = answer or self._ask_map


class MotionValidator(ob.MotionValidator):
    """OMPL's question "is this motion valid?", answered exactly: every cell that the edge touches is FREE.

    Nothing is stepped over, at any length, so OMPL's checking resolution plays no part in it. With a curve, the edge is
    the real curve, not a chain of samples on it. OMPL now and then takes a curve for the shortest that is not; such an
    edge is not proven, and is refused.

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

    def __init__(
        self,
        si: ob.SpaceInformation,
        space: CSpace,
        *,
        exact: bool = False,
        curve: str | None = None,
        turning_radius: float | None = None,
    ) -> None:
        check_information(si, space)
        super().__init__(si)
        edges = local_planner(space, exact, curve, turning_radius)
        of_states = kind_of(space).of_states
        self._ask_map = _curve_check(edges) if isinstance(edges, CarCurves) else of_states(edges.edge_checker())
        self._is_free = self._ask_map

    def checkMotion(self, first: ob.State, second: ob.State) -> bool:  # noqa: N802 - OMPL's name
        """Whether the edge between two states is free all along."""
        return self._is_free(first, second)

    def answer_with(self, answer: Callable[[ob.State, ob.State], bool] | None) -> None:
        """Answer by a function from now on, or by the map again; so a plan that is out of time ends a search."""
        self._is_free = answer or self._ask_map


def _curve_check(curves: CarCurves) -> Callable[[ob.State, ob.State], bool]:
    """Whether a curve is proven free, and is no longer than OMPL's, so that it is the one that OMPL means."""
    prove, states = kind_of(curves.space).of_states(curves.length_prover()), curves.states()
    tolerance = 1e-6 * curves.radius

    def check(first: ob.State, second: ob.State) -> bool:
        length = prove(first, second)
        return length >= 0.0 and bool(states.distance(first, second) <= length + tolerance)

    return check
