"""Convex regions of FREE configurations: one, along a path, or over a map (experimental).

Words that the modules of this package share:

- *core*: a point or segment that a polytope must contain.
- *taken* cells: those that a region must not meet.
- *arc*: an interval of yaws over which a region extends.
"""

from __future__ import annotations

from cspace.regions._convex_region import ConvexRegion
from cspace.regions._corridor import Corridor
from cspace.regions._corridor import make_corridor as make_corridor  # for planners
from cspace.regions._cover import FreeRegions

__all__ = ["ConvexRegion", "Corridor", "FreeRegions"]
