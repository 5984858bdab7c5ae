"""OMPL's state space and set-up for a map."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og

from cspace.errors import InputError
from cspace.sampling import check_rng
from planners.motion import MotionValidator
from planners.sampling import FreeStateSampler
from planners.validity import StateValidityChecker

if TYPE_CHECKING:
    from cspace.space import CSpace


def state_space(space: CSpace) -> Any:
    """OMPL's state space of a map: the closed box of its grid.

    Parameters
    ----------
    space : CSpace

    Returns
    -------
    ompl.base.RealVectorStateSpace
        Coordinates x and y, in metres.
    """
    grid = space.grid
    states = ob.RealVectorStateSpace(grid.dim)
    bounds = ob.RealVectorBounds(grid.dim)
    for axis, (low, high) in enumerate(zip(grid.lower, grid.upper, strict=True)):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    states.setBounds(bounds)
    return states


def simple_setup(
    space: CSpace,
    *,
    objective: Callable[[Any], Any] | None = None,
    rng: np.random.Generator | None = None,
    valid_state_sampler: Callable[[Any], Any] | None = None,
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

    Returns
    -------
    ompl.geometric.SimpleSetup
        States are checked at half a cell where OMPL steps along a motion by itself.

    Raises
    ------
    InputError
        If the sampler is OMPL's ObstacleBasedValidStateSampler, which needs the last valid state of a motion: a motion
        validator in Python cannot tell it, and invalid states would come out. Or if ``objective`` or the sampler is
        of another type than OMPL's, or both ``rng`` and a sampler are given.
    """
    states = state_space(space)
    setup = og.SimpleSetup(states)
    si = setup.getSpaceInformation()
    setup.setStateValidityChecker(StateValidityChecker(si, space))
    si.setMotionValidator(MotionValidator(si, space))
    si.setStateValidityCheckingResolution(0.5 * space.grid.spacing / states.getMaximumExtent())
    si.setValidStateSamplerAllocator(_allocator(si, space, rng, valid_state_sampler))
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
    si: Any, space: CSpace, rng: np.random.Generator | None, sampler: Callable[[Any], Any] | None
) -> Callable[[Any], Any]:
    """What makes the valid state samplers. It must not hold ``si``, which holds it."""
    if sampler is None:
        if rng is not None:
            check_rng(rng)
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
