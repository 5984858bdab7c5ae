"""OMPL's state space and set-up for a map."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from ompl import base as ob
from ompl import geometric as og

from cspace.arms.space import ArmSpace
from cspace.check import check_rng
from cspace.errors import InputError
from cspace.space import CSpace
from planners.callbacks import FreeStateSampler, MotionValidator, StateValidityChecker
from planners.local_planner import HOLONOMIC, LocalPlanner, local_planner
from planners.states import Configuration, kind_of

MakeObjective = Callable[[ob.SpaceInformation], ob.OptimizationObjective]
MakeSampler = Callable[[ob.SpaceInformation], ob.ValidStateSampler]


def state_space(
    space: CSpace | ArmSpace, *, drive: str = HOLONOMIC, turning_radius: float | None = None
) -> ob.StateSpace:
    """OMPL's state space of a map, R^2, R^3, SE(2), R^3 x SO(2) or SE(3): the box of its grid, and every rotation.

    Of an arm, all joints within their limits.

    Parameters
    ----------
    space : CSpace or ArmSpace
    drive : {"holonomic", "differential", "differential-reverse", "dubins", "reeds-shepp"}
        As for :func:`planners.plan`.
    turning_radius : float, optional
        Metres; for curves, which need it.

    Returns
    -------
    ompl.base.StateSpace
        ``RealVectorStateSpace`` of x and y, and in space z, in metres. For a robot that turns in the plane,
        ``SE2StateSpace``; for one that turns freely in space ``SE3StateSpace``, and about z alone a
        ``CompoundStateSpace`` of a ``RealVectorStateSpace``, of weight 1, and an ``SO2StateSpace``, of weight 0.5. In
        each of these a radian counts as half a metre. For a drive ``DubinsStateSpace``, or, where it reverses,
        ``ReedsSheppStateSpace``. Those of a differential drive turn on a point: what they interpolate lies on the edge
        that is proven, but for a hundred-millionth of the map's side, and their distance is in metres alone.

        Of an arm ``RealVectorStateSpace``, or, with continuous joints, a ``CompoundStateSpace`` of one of the others
        and an ``SO2StateSpace`` for each of them, all of weight 1.

    Raises
    ------
    InputError
        If a drive is unknown, or set on a map that is not one of x, y and yaw, or the turning radius is missing,
        unwanted, or not above zero.
    """
    return _bounded(local_planner(space, False, drive, turning_radius))


def _bounded(edges: LocalPlanner) -> ob.StateSpace:
    states = edges.states()
    lower, upper = edges.bounds
    kind_of(edges.space).set_bounds(states, lower.tolist(), upper.tolist())
    if not states.getType():
        states.setup()  # else OMPL crashes where it prints the projection of a space that is composed of others
    return states


def _set_resolution(si: ob.SpaceInformation, edges: LocalPlanner) -> None:
    """Say how far apart OMPL looks at states, where it steps along a motion by itself."""
    si.setStateValidityCheckingResolution(edges.step / si.getStateSpace().getMaximumExtent())


def narrow(setup: og.SimpleSetup, edges: LocalPlanner, start: Configuration) -> None:
    """Keep the states of a set-up to the box around all that FREE cells join to the start.

    Nothing is lost: a path through FREE cells of the grid does not leave it.
    """
    space = edges.space
    lower, upper = space.reachable_bounds(start)
    place = start[: len(lower)]
    # The rounding of a cell's corner must not put the start outside.
    box = np.minimum(lower, place).tolist(), np.maximum(upper, place).tolist()
    kind_of(space).set_bounds(setup.getStateSpace(), *box)
    _set_resolution(setup.getSpaceInformation(), edges)


def simple_setup(
    space: CSpace | ArmSpace,
    *,
    objective: MakeObjective | None = None,
    rng: np.random.Generator | None = None,
    valid_state_sampler: MakeSampler | None = None,
    exact: bool = False,
    drive: str = HOLONOMIC,
    turning_radius: float | None = None,
    bidirectional: bool = False,
) -> og.SimpleSetup:
    """OMPL's set-up with everything that a map, or an arm, provides: states, motions, samples, checking resolution.

    Choose a planner, set start and goal, and solve::

        setup = planners.simple_setup(space)
        setup.setPlanner(ompl.geometric.RRTConnect(setup.getSpaceInformation()))

    Parameters
    ----------
    space : CSpace or ArmSpace
    objective : callable, optional
        Given the space information, returns an ``ompl.base.OptimizationObjective``. OMPL's default is the length.
    rng : numpy.random.Generator, optional
        Source of randomness of the valid state sampler; see :class:`FreeStateSampler`.
    valid_state_sampler : callable, optional
        Given the space information, returns an ``ompl.base.ValidStateSampler``, to be used in place of
        :class:`FreeStateSampler`.
    exact : bool
        Whether the geometry itself decides where the map cannot. Valid states are then drawn from the whole map and
        tested, since they need not lie in FREE cells.
    drive : {"holonomic", "differential", "differential-reverse", "dubins", "reeds-shepp"}
        As for :func:`planners.plan`.
    turning_radius : float, optional
        Metres; for curves, which need it.
    bidirectional : bool
        As for :class:`MotionValidator`.

    Returns
    -------
    ompl.geometric.SimpleSetup
        States are checked at half a cell, or a hundredth of a radian, where OMPL steps along a motion by itself.

    Raises
    ------
    InputError
        If the sampler is OMPL's ObstacleBasedValidStateSampler, which needs the last valid state of a motion: a motion
        validator in Python cannot return it, and invalid states would come out. Or if ``objective`` or the sampler is
        of another type than OMPL's, or both ``rng`` and a sampler are given, or ``rng`` and ``exact``. And as
        :func:`state_space`.
    """
    edges = local_planner(space, exact, drive, turning_radius, bidirectional)
    return set_up(edges, objective, rng, valid_state_sampler)


def set_up(
    edges: LocalPlanner,
    objective: MakeObjective | None = None,
    rng: np.random.Generator | None = None,
    sampler: MakeSampler | None = None,
) -> og.SimpleSetup:
    """As :func:`simple_setup`, for edges that are known."""
    space, setup = edges.space, og.SimpleSetup(_bounded(edges))
    si = setup.getSpaceInformation()
    setup.setStateValidityChecker(StateValidityChecker(si, space, exact=edges.exact))
    si.setMotionValidator(MotionValidator(si, space, **edges.options))
    _set_resolution(si, edges)
    si.setValidStateSamplerAllocator(_sampler_maker(si, edges, rng, sampler))
    if objective is not None:
        setup.setOptimizationObjective(_made(objective, si, ob.OptimizationObjective, "objective"))
    elif not setup.getStateSpace().getType():
        # OMPL's length draws informed samples, and refuses to in a space of no known type; a sum of one does not.
        length = ob.MultiOptimizationObjective(si)
        length.addObjective(ob.PathLengthOptimizationObjective(si), 1.0)
        setup.setOptimizationObjective(length)
    return setup


def _sampler_maker(
    si: ob.SpaceInformation, edges: LocalPlanner, rng: np.random.Generator | None, sampler: MakeSampler | None
) -> MakeSampler:
    """What makes the valid state samplers. It must not hold ``si``, which holds it."""
    space, exact = edges.space, edges.exact
    if rng is not None:
        check_rng(rng)
        if sampler is not None or exact:
            other = "exact is True" if exact else "valid_state_sampler is given"
            rule = "it is for FreeStateSampler, which keeps to FREE cells"
            raise InputError("rng", f"is given and {other}", rule, "leave one of the two out", value=rng)
    if sampler is None:
        return ob.UniformValidStateSampler if exact else lambda info: FreeStateSampler(info, space, rng)
    made = _made(sampler, si, ob.ValidStateSampler, "valid_state_sampler")
    if isinstance(made, ob.ObstacleBasedValidStateSampler):
        rule = (
            "it needs the last valid state of a motion, which OMPL's Python bindings cannot pass on, and would return "
            "invalid states"
        )
        hint = "leave it out to sample the free cells, or use e.g. ompl.base.UniformValidStateSampler"
        raise InputError("valid_state_sampler", "makes an ObstacleBasedValidStateSampler", rule, hint, value=made)
    return sampler


def _made(make: Callable[[ob.SpaceInformation], object], si: ob.SpaceInformation, kind: type, name: str) -> object:
    """What a function of the user's makes for a space information, checked."""
    made = make(si)
    if not isinstance(made, kind):
        rule = f"it must return an ompl.base.{kind.__name__}"
        hint = "pass a class or function that takes the space information and returns one"
        raise InputError(name, f"returned {made!r}", rule, hint, value=made)
    return made
