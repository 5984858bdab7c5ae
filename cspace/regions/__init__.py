"""Convex regions of FREE configurations: one, along a path, or over a map (experimental)."""

from __future__ import annotations

from cspace.regions._convex_region import ConvexRegion
from cspace.regions._corridor import Corridor
from cspace.regions._corridor import make_corridor as make_corridor  # for planners
from cspace.regions._cover import FreeRegions

__all__ = ["ConvexRegion", "Corridor", "FreeRegions"]
