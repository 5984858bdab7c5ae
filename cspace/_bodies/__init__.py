"""Bodies as trees of triangles, and proofs that they stay apart.

The geometry of :mod:`cspace._exact`, with constants of all proofs of motions.
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
