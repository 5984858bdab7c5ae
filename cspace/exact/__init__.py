"""Exact answers: the geometry itself decides where the map cannot.

FREE and BLOCKED cells answer at once. In MIXED ones, and outside the grid, the distance between the borders of the
placed robot and of the obstacles decides; where they are apart, one point of each connected part decides
whether it lies within the other side. A distance proves a whole neighbourhood: on a motion that moves the reference
point by dx and turns the robot by an angle, no point moves by more than ``|dx| + rho * angle``, where rho is how far
the robot reaches (conservative advancement: B. Mirtich, "Impulse-based dynamic simulation of rigid body systems",
1996), and along a line by less. The plane is proven as a part of space.

*Rounding.* All sets are closed: touching is a collision. A distance counts only where it exceeds the margin by
``ANGLE_SLACK`` (1e-9) times the robot's span, if it turns, and ``ROUNDING`` (1e-12) times the largest coordinates of
the map, the robot and the configurations. The first covers yaws that are off by the rounding of their wrapping; the
second the few roundings of placing a point (relative 2^-53) and of a distance, with a factor of fifty to spare.
Distances are proven by projections onto lines (``cspace/exact/triangles.py``).
"""

from typing import Final

__all__ = ["ADVANCE", "MOST_DISTANCES", "ROUNDING", "SHORTEST"]

ROUNDING: Final = 1e-12
"""Rounding allowance of a distance, relative to the coordinates; more than fifty times what is needed."""

ADVANCE: Final = 0.999
"""Part of a proven distance that is used, so that its end is proven too."""

MOST_DISTANCES: Final = 10_000
"""Distances after which an edge is given up as not proven: it grazes an obstacle."""

SHORTEST: Final = 2.0**-44
"""Least part of an edge to advance by; below it the edge grazes an obstacle."""
