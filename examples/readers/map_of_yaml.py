"""Plan on a ROS map: a YAML file with an image beside it.

Its thresholds, mode, resolution, and origin with a yaw are read. Unknown cells count as occupied
unless you pass ``unknown="free"``.
"""

from collections.abc import Sequence

import cspace
import planners


def plan_on_map(
    path: str, start: Sequence[float], goal: Sequence[float], unknown: str = "occupied"
) -> planners.Plan:
    """Plan for a disc between two places in the frame of the map, metres."""
    workspace = cspace.Workspace.open(path, unknown=unknown)
    print(workspace)
    # The robot, in metres, with its reference point at the origin.
    robot = cspace.Robot.disc(0.25)
    # Where the map of its configurations says FREE, the robot touches nothing, with a margin.
    space = cspace.build(workspace, robot, margin=0.05)
    if space.is_disconnected(start, goal):
        raise SystemExit("no path exists: proven")
    return planners.plan(space, start, goal, seed=1)


if __name__ == "__main__":
    import sys

    x, y, goal_x, goal_y = map(float, sys.argv[2:])
    print(plan_on_map(sys.argv[1], (x, y), (goal_x, goal_y)))
