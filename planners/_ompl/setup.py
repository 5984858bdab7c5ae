"""OMPL's state space and SimpleSetup for a map or an arm."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from ompl import base as ob
from ompl import geometric as og

from cspace import Space
from cspace.errors import InputError
from cspace.inside import Drive, check_rng, names_options, tell_apart
from planners._edges.drives import local_planner
from planners._edges.local_planner import LocalPlanner
from planners._edges.own_space import read_bounds
from planners._ompl.checkers import (
    EdgeCosts,
    FreeStateSampler,
    MotionValidator,
    StateValidityChecker,
)
from planners._ompl.states import find_state_kind, make_states
from planners._searches.objectives import (
    ClearanceObjective,
    MakeObjective,
    WeightedLength,
    read_objective,
)

"""Smallest distance between states that OMPL itself checks along a motion, as a share of the
space's extent."""


@names_options
def state_space(space: Space, *, drive: Drive | None = None) -> ob.StateSpace:
    """Make OMPL's bounded state space of a space.

    Parameters
    ----------
    space : Space
    drive
        As for :func:`planners.plan`.

    Returns
    -------
    ompl.base.StateSpace
        By the axes of a map, in metres, bounded by the box of its grid:

        - x, y and x, y, z: ``RealVectorStateSpace``;
        - x, y, yaw: ``SE2StateSpace``; with a drive ``DubinsStateSpace``, or
          ``ReedsSheppStateSpace`` if it reverses;
        - x, y, z, yaw: ``CompoundStateSpace`` of a ``RealVectorStateSpace``, weight 1, and an
          ``SO2StateSpace``, weight 0.5;
        - x, y, z and a quaternion: ``SE3StateSpace``.

        A radian counts as half a metre, except with a drive. State spaces of a differential drive
        have a turning radius of almost zero, so their distance is in metres alone. Their
        interpolation stays within 1e-8 of the map's side of the edge that is proven.

        For an arm, ``RealVectorStateSpace``; with continuous joints, a ``CompoundStateSpace`` of
        this space and an ``SO2StateSpace`` for each continuous joint, all of weight 1. Its bounds
        are the limits of the joints.

    Raises
    ------
    InputError
        If ``drive`` is no drive, or given for a space without the axes x, y, yaw; or its turning
        radius is too small or large for the cells; or the space is so small that OMPL takes its
        steps for zero.
    """
    return make_bounded_states(local_planner(space, drive))


def make_bounded_states(edges: LocalPlanner) -> ob.StateSpace:
    """Create OMPL's state space with bounds.

    Raises InputError if the space is so large that OMPL rounds its steps to zero.
    """
    space = edges.space
    states = make_states(edges)
    lower, upper = read_bounds(space)
    find_state_kind(space).set_bounds(states, lower, upper)
    _check_extent(space, states)
    if not states.getType():
        states.setup()  # otherwise OMPL crashes when it prints the projection of a compound space
    return states


def _choose_checking_share(space: Space, states: ob.StateSpace) -> float:
    """Choose OMPL's checking step, as a share of the extent."""
    extent = max(states.getMaximumExtent(), sys.float_info.epsilon)
    share: float = space.resolution / extent
    # At least every half, and at most every millionth of the extent.
    return min(max(share, 1e-6), 0.5)


def _check_extent(space: Space, states: ob.StateSpace) -> None:
    """Raise InputError if OMPL takes a checking step for zero."""
    subspaces = [states]
    if states.isCompound():
        subspaces = [states.getSubspace(k) for k in range(states.getSubspaceCount())]
    extent = min(subspace.getMaximumExtent() for subspace in subspaces)
    # Until the share is set, OMPL uses its own, for example when it prints a space.
    share = min(_choose_checking_share(space, states), states.getLongestValidSegmentFraction())
    if extent * share < sys.float_info.epsilon:
        unit = space.units[0]
        spans, least = tell_apart(extent, sys.float_info.epsilon / share, 3)
        raise InputError(
            "space",
            f"spans {spans} {unit}",
            f"OMPL's planners need at least {least} {unit}",
        )


@names_options
def simple_setup(
    space: Space,
    *,
    objective: MakeObjective | WeightedLength | ClearanceObjective | None = None,
    rng: np.random.Generator | None = None,
    drive: Drive | None = None,
) -> og.SimpleSetup:
    """Create OMPL's SimpleSetup for a map, an arm or another space.

    It has the states, the proofs of motions and the sampler. Choose a planner, set start and goal,
    and solve::

        setup = planners.simple_setup(space)
        setup.setPlanner(ompl.geometric.RRTConnect(setup.getSpaceInformation()))

    Parameters
    ----------
    space : Space
    objective : callable, WeightedLength or ClearanceObjective, optional
        A callable takes the space information and returns an ``ompl.base.OptimizationObjective``.
        OMPL's default is the length. The others weigh the cells of a map in memory.
    rng : numpy.random.Generator, optional
        Source of randomness of the valid state sampler; see :class:`FreeStateSampler`.
    drive
        As for :func:`planners.plan`.

    Returns
    -------
    ompl.geometric.SimpleSetup
        When OMPL steps along a motion by itself, it checks a state every half cell, or every 0.01
        rad of an arm (:attr:`cspace.Space.resolution`), but at least every half and at most every
        millionth of the space's extent.

    Raises
    ------
    InputError
        If ``objective`` is not of OMPL's type, or ``rng`` comes with ``space.exact``; and as
        :func:`state_space`.
    """
    edges = local_planner(space, drive)
    if objective is not None and not callable(objective):
        weigh = read_objective(objective, None, space).weigh
        edges = replace(edges, weights=weigh(edges.cells))
        objective = partial(EdgeCosts, edges=edges)
    return make_setup(edges, objective, rng)


def make_setup(
    edges: LocalPlanner,
    objective: MakeObjective | None,
    rng: np.random.Generator | None = None,
) -> og.SimpleSetup:
    """Make OMPL's SimpleSetup for a local planner; see :func:`simple_setup`."""
    space = edges.space
    setup = _Setup(make_bounded_states(edges))
    si = setup.getSpaceInformation()
    checker = StateValidityChecker(si, space)
    checker.is_free = find_state_kind(space).of_states(edges.point_checker())
    setup.setStateValidityChecker(checker)
    si.setMotionValidator(
        MotionValidator(
            si,
            space,
            drive=edges.drive,
            bidirectional=edges.bidirectional,
        )
    )
    # Distance of the states that OMPL checks when it steps along a motion by itself.
    share = _choose_checking_share(space, si.getStateSpace())
    si.setStateValidityCheckingResolution(share)
    si.setValidStateSamplerAllocator(_choose_sampler(edges, rng))
    if objective is not None:
        checked = _make_objective(objective, si)
        setup.setOptimizationObjective(checked)
    elif not setup.getStateSpace().getType():
        # OMPL's length draws informed samples and fails in a state space of unknown type. A sum of
        # one objective does not draw them.
        length = ob.MultiOptimizationObjective(si)
        length.addObjective(ob.PathLengthOptimizationObjective(si), 1.0)
        setup.setOptimizationObjective(length)
    return setup


class _Setup(og.SimpleSetup):
    """A SimpleSetup that survives Python's garbage collector."""

    def __init__(self, states: ob.StateSpace) -> None:
        """Hold objects that OMPL frees unless Python does."""
        super().__init__(states)
        self._held = self.getSpaceInformation(), self.getProblemDefinition()


def _choose_sampler(
    edges: LocalPlanner, rng: np.random.Generator | None
) -> Callable[[ob.SpaceInformation], ob.ValidStateSampler]:
    """Check the source of randomness; choose the valid state sampler."""
    space = edges.space
    if rng is not None:
        check_rng(rng)
        if edges.exact:
            rule = "it is for FreeStateSampler"
            raise InputError("rng", f"is given and space is {space!r}", rule)
    # FREE cells give samples without rejection, unless geometry decides other cells too.
    if edges.in_memory and not edges.exact:
        return lambda info: FreeStateSampler(info, edges.cells, rng)
    return lambda info: ob.UniformValidStateSampler(info)


def _make_objective(make: MakeObjective, si: ob.SpaceInformation) -> ob.OptimizationObjective:
    """Call a user's function; check that it returns an objective."""
    result: object = make(si)
    if not isinstance(result, ob.OptimizationObjective):
        rule = "it must return an ompl.base.OptimizationObjective"
        raise InputError("objective", f"returned {result!r}", rule)
    return result
