"""Proofs that bodies stay apart from obstacles, and from each other, in a motion.

They take shapes with poses, and joints as arrays, and give compiled tests of configurations and of
motions. Words that the modules share:

- *body*: links held together by fixed joints; *solid*: a body's surface, or an obstacle.
- *chain*: the bodies of an arm, each after its parent.
- *part*: a connected piece of a body's boundary.
- *tube*: the motion of the joints between two configurations, from which each may deviate.
- *slack*: the excess of a distance over the required distance.
- *cone*: the directions within an angle of a direction, in which a link keeps an axis.
- *inner ball*: a ball inside a solid, which proves collisions.
"""

from typing import Final

from cspace._bodies import box_trees as box_trees  # for the inner door

__all__ = ["ADVANCE_FACTOR", "DISTANCE_ROUNDING", "MAX_DISTANCES_PER_EDGE", "MIN_ADVANCE"]

DISTANCE_ROUNDING: Final = 1e-12
"""Rounding allowance of a distance, relative to the largest coordinate; more than fifty times the
true bound."""


ADVANCE_FACTOR: Final = 0.999
"""Fraction of a proven distance by which a proof advances, so that the end of the step is proven
too."""


MAX_DISTANCES_PER_EDGE: Final = 10_000
"""Distances measured before an edge counts as not proven, because it grazes an obstacle."""


MIN_ADVANCE: Final = 2.0**-44
"""Smallest step along an edge, as a fraction of the edge; a proof that needs smaller steps fails.
"""
