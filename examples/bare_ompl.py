"""OMPL as it comes, with the map as its validity callback: ``python examples/bare_ompl.py``."""

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

import cspace


def build_map() -> cspace.CSpace:
    """The map of a disc of 0.2 m in a room of 10 m by 6 m with two walls across it."""
    occupied = np.zeros((200, 120), dtype=bool)  # [x, y], 0.05 m each
    occupied[60:66, :90] = True
    occupied[130:136, 40:] = True
    return cspace.build(cspace.Workspace.from_array(occupied, 0.05), cspace.Robot.disc(0.2))


def main() -> None:  # OMPL's objects must be gone before Python ends, so they live in a function
    space = build_map()
    grid = space.grid
    is_free = space.point_checker()

    states = ob.RealVectorStateSpace(2)
    bounds = ob.RealVectorBounds(2)
    for axis in range(2):
        bounds.setLow(axis, grid.lower[axis])
        bounds.setHigh(axis, grid.upper[axis])
    states.setBounds(bounds)

    ou.setLogLevel(ou.LOG_WARN)
    ou.RNG.setSeed(1)
    setup = og.SimpleSetup(states)
    setup.setStateValidityChecker(lambda state: is_free(state[0], state[1]))
    # OMPL checks motions in steps of 1 % of the extent unless told otherwise, which is 0.12 m here: over a thin wall.
    step = 0.5 * grid.spacing / states.getMaximumExtent()
    setup.getSpaceInformation().setStateValidityCheckingResolution(step)

    start, goal = states.allocState(), states.allocState()
    start[0], start[1] = 1.0, 1.0
    goal[0], goal[1] = 9.0, 5.0
    setup.setStartAndGoalStates(start, goal)
    setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
    setup.solve(1.0)
    setup.simplifySolution()

    path = np.array([[state[0], state[1]] for state in setup.getSolutionPath().getStates()])
    print(f"{setup.getLastPlannerStatus().asString()}, {setup.getSolutionPath().length():.2f} m:")
    print(np.array2string(path, precision=2, suppress_small=True))
    # OMPL looked at states half a cell apart. Only the map can tell of the whole edges.
    proven = space.motion_is_free(path[:-1], path[1:])
    print(f"edges proven free all along: {proven.sum()} of {len(proven)}; planners.plan proves them all")


if __name__ == "__main__":
    main()
