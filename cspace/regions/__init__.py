"""Convex regions of FREE configurations: one, along a path, or over a whole map."""

from __future__ import annotations

from cspace.regions._convex_region import ConvexRegion

__all__ = ["ConvexRegion"]
