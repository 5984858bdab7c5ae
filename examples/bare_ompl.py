"""
OMPL as it comes, with the map as its validity callback
=======================================================

To keep your own OMPL script, hand it one function of the map. OMPL then looks at states a step
apart; only the map can prove the edges between them.
"""

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

import cspace
import planners
from cspace.plot import save_plot

# %% The map of a disc of 0.2 m in a room of 10 m by 6 m with two walls across it; cells are indexed
# ``[x, y]``.

occupied = np.zeros((200, 120), dtype=bool)
occupied[60:66, :90] = True
occupied[130:136, 40:] = True
space = cspace.build(cspace.Workspace.from_array(occupied, spacing=0.05), cspace.Robot.disc(0.2))

# %%
# OMPL's objects must be deleted before Python exits, so they are local to a function.


def solve(space: cspace.CSpace) -> np.ndarray:
    """Return a path by RRTConnect from (1, 1) to (9, 5)."""
    is_free = space.point_checker()
    states = ob.RealVectorStateSpace(2)
    bounds = ob.RealVectorBounds(2)
    for axis in range(2):
        bounds.setLow(axis, space.grid.lower[axis])
        bounds.setHigh(axis, space.grid.upper[axis])
    states.setBounds(bounds)

    setup = og.SimpleSetup(states)
    setup.setStateValidityChecker(lambda state: is_free(state[0], state[1]))
    # By default OMPL checks motions in steps of 1 % of the extent, here 0.12 m, which can skip a
    # thin wall.
    step = 0.5 * space.grid.spacing / states.getMaximumExtent()
    setup.getSpaceInformation().setStateValidityCheckingResolution(step)

    start, goal = states.allocState(), states.allocState()
    start[0], start[1] = 1.0, 1.0
    goal[0], goal[1] = 9.0, 5.0
    setup.setStartAndGoalStates(start, goal)
    setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
    setup.solve(1.0)
    setup.simplifySolution()
    return np.array([[state[0], state[1]] for state in setup.getSolutionPath().getStates()])


ou.setLogLevel(ou.LOG_WARN)
path = solve(space)
print(np.array2string(path, precision=2, suppress_small=True))

# %% The map proves only some of these edges. :func:`planners.plan` and
# :class:`planners.MotionValidator` prove all edges.

proven = space.certify_path(path)
print(f"edges proven free all along: {proven.sum()} of {len(proven)}")
save_plot(space, "bare_ompl.png", True, path=path)

# %% The same with all parts of the map: ``simple_setup`` brings states and their bounds, a checker
# of whole motions, a sampler of FREE states, and a resolution that fits the cells.


def solve_with_parts(space: cspace.CSpace) -> np.ndarray:
    """Return a path with :class:`planners.MotionValidator` and the other parts."""
    setup = planners.simple_setup(space)
    start, goal = setup.getStateSpace().allocState(), setup.getStateSpace().allocState()
    start[0], start[1], goal[0], goal[1] = 1.0, 1.0, 9.0, 5.0
    setup.setStartAndGoalStates(start, goal)
    setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
    setup.solve(1.0)
    return np.array([[state[0], state[1]] for state in setup.getSolutionPath().getStates()])


print("every edge proven:", space.certify_path(solve_with_parts(space)).all())
