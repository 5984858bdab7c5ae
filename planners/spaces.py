"""OMPL's state space and set-up for a map."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og

from cspace.errors import InputError
from cspace.sampling import check_rng
from planners.motion import MotionValidator
from planners.sampling import FreeStateSampler
from planners.validity import StateValidityChecker
from planners.ways import Way, way_of

if TYPE_CHECKING:
    from cspace.space import CSpace


def state_space(space: CSpace, *, curve: str | None = None, turning_radius: float | None = None) -> Any:
    """OMPL's state space of a map: the closed box of its grid, and every yaw where the map has rotations.

    Parameters
    ----------
    space : CSpace
    curve : {"dubins", "reeds-shepp"}, optional
        Curves of a car that drives forwards alone, or in both directions; straight edges, if left out.
    turning_radius : float, optional
        Metres; for curves, which need it.

    Returns
    -------
    ompl.base.RealVectorStateSpace, SE2StateSpace, DubinsStateSpace or ReedsSheppStateSpace
        Coordinates x and y, and in space z, in metres; ``getX``, ``getY`` and ``getYaw``, in radians, of a robot that
        turns.

    Raises
    ------
    InputError
        If a curve is unknown, or asked for on a map without rotations, or the turning radius is missing, unwanted, or
        not above zero.
    """
    return _bounded(way_of(space, False, curve, turning_radius))


def _bounded(way: Way) -> Any:
    states = way.states()
    states.setBounds(_bounds(way.space.grid.lower, way.space.grid.upper))
    return states


def _bounds(lower: Iterable[float], upper: Iterable[float]) -> Any:
    box = list(zip(lower, upper, strict=True))
    bounds = ob.RealVectorBounds(len(box))
    for axis, (low, high) in enumerate(box):
        bounds.setLow(axis, float(low))
        bounds.setHigh(axis, float(high))
    return bounds


def narrow(setup: Any, space: CSpace, start: tuple[float, ...]) -> None:
    """Keep the states of a set-up to the box around all that FREE cells join to the start.

    Nothing is lost: a path through FREE cells of the grid does not leave it.
    """
    states = setup.getStateSpace()
    lower, upper = space.free_reach(start)
    # The rounding of a cell's corner must not put the start outside.
    states.setBounds(_bounds(np.minimum(lower, start[: len(lower)]), np.maximum(upper, start[: len(upper)])))
    resolution = 0.5 * space.grid.spacing / states.getMaximumExtent()
    setup.getSpaceInformation().setStateValidityCheckingResolution(resolution)


def simple_setup(
    space: CSpace,
    *,
    objective: Callable[[Any], Any] | None = None,
    rng: np.random.Generator | None = None,
    valid_state_sampler: Callable[[Any], Any] | None = None,
    exact: bool = False,
    curve: str | None = None,
    turning_radius: float | None = None,
) -> Any:
    """OMPL's set-up with everything that the map can answer: states, motions, samples and checking resolution.

    Choose a planner, set start and goal, and solve::

        setup = planners.simple_setup(space)
        setup.setPlanner(ompl.geometric.RRTConnect(setup.getSpaceInformation()))

    Parameters
    ----------
    space : CSpace
    objective : callable, optional
        Given the space information, returns an ``ompl.base.OptimizationObjective``. OMPL's default is the length.
    rng : numpy.random.Generator, optional
        Source of randomness of the valid state sampler; see :class:`FreeStateSampler`.
    valid_state_sampler : callable, optional
        Given the space information, returns an ``ompl.base.ValidStateSampler``, to be used in place of
        :class:`FreeStateSampler`.
    exact : bool
        Whether the geometry itself is asked where the map cannot decide. Valid states are then drawn from the whole
        map and tried, since they need not lie in FREE cells.
    curve : {"dubins", "reeds-shepp"}, optional
        Curves of a car that drives forwards alone, or in both directions; straight edges, if left out.
    turning_radius : float, optional
        Metres; for curves, which need it.

    Returns
    -------
    ompl.geometric.SimpleSetup
        States are checked at half a cell where OMPL steps along a motion by itself.

    Raises
    ------
    InputError
        If the sampler is OMPL's ObstacleBasedValidStateSampler, which needs the last valid state of a motion: a motion
        validator in Python cannot tell it, and invalid states would come out. Or if ``objective`` or the sampler is
        of another type than OMPL's, or both ``rng`` and a sampler are given, or ``rng`` and ``exact``. And as
        :func:`state_space`.
    """
    states = _bounded(way_of(space, exact, curve, turning_radius))
    setup = og.SimpleSetup(states)
    si = setup.getSpaceInformation()
    setup.setStateValidityChecker(StateValidityChecker(si, space, exact=exact))
    validator = MotionValidator(si, space, exact=exact, curve=curve, turning_radius=turning_radius)
    si.setMotionValidator(validator)
    si.setStateValidityCheckingResolution(0.5 * space.grid.spacing / states.getMaximumExtent())
    si.setValidStateSamplerAllocator(_allocator(si, space, rng, valid_state_sampler, exact))
    if objective is not None:
        made = objective(si)
        if not isinstance(made, ob.OptimizationObjective):
            raise InputError(
                f"objective returned {made!r}; it must return an ompl.base.OptimizationObjective; pass a function that "
                "takes the space information and returns one"
            )
        setup.setOptimizationObjective(made)
    return setup


def _allocator(
    si: Any, space: CSpace, rng: np.random.Generator | None, sampler: Callable[[Any], Any] | None, exact: bool
) -> Callable[[Any], Any]:
    """What makes the valid state samplers. It must not hold ``si``, which holds it."""
    if sampler is None:
        if rng is not None:
            check_rng(rng)
        if exact and rng is not None:
            raise InputError(
                "rng is given and exact is True; rng is for FreeStateSampler, which keeps to FREE cells; drop one"
            )
        if exact:
            return lambda info: ob.UniformValidStateSampler(info)
        return lambda info: FreeStateSampler(info, space, rng)
    if rng is not None:
        raise InputError("rng and valid_state_sampler are both given; rng is only for FreeStateSampler; drop one")
    example = sampler(si)
    if isinstance(example, ob.ObstacleBasedValidStateSampler):
        raise InputError(
            "valid_state_sampler makes an ObstacleBasedValidStateSampler; it needs the last valid state of a motion, "
            "which OMPL's Python bindings cannot pass on, and would return invalid states; leave it out to sample the "
            "free cells, or use e.g. ompl.base.UniformValidStateSampler"
        )
    if not isinstance(example, ob.ValidStateSampler):
        raise InputError(
            f"valid_state_sampler returned {example!r}; it must return an ompl.base.ValidStateSampler; pass a class or "
            "function that takes the space information and returns one"
        )
    return sampler
