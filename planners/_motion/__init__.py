"""Motion: the times of a path, within limits of velocity, acceleration and jerk.

:func:`planners._motion.trajectory.make_trajectory` takes a path with its edges and limits, and
gives a :class:`planners.Trajectory`, whose motion is proven free.

Words that the modules of this package share:

- *segment*: an edge of a path, or a curve in place of a corner.
- *interval*: a part of a segment within which the bounds of its derivatives are constant.
- *phase*: a stretch of time with one acceleration, or with one jerk.
- *leg*: the part of a path between two local minima of the robot's speed.
- *ramp*: a change of speed on a leg, whose acceleration rises evenly, stays, and falls evenly.
- *junction*: the state of a moving robot at which a motion begins.
- *stretch*: a part of a path within which limits of speed by places are constant.
"""
