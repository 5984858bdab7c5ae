"""Parts of robots on a floor between two heights, seen from above, and their contacts with prisms.

A part is an outline and the radius by which it is grown.
"""

import math

import shapely
from shapely import affinity

ROUNDING = 1e-12
"""Metres by which the oracle's heights may be rounded; far below the slack of rasters."""


def cut_prism(outline, bottom, top):
    """Return the part of a prism between two heights, seen from above."""
    return lambda low, high: [(outline, 0.0)] if bottom <= high and top >= low else []


def cut_pyramid(outline, bottom, top):
    """Return the part of a pyramid, whose apex is above the origin."""

    def cut(low, high):
        if bottom > high or top < low:
            return []
        factor = (top - max(low, bottom)) / (top - bottom)
        return [(affinity.scale(outline, factor, factor, origin=(0.0, 0.0)), 0.0)]

    return cut


def cut_ball(center, radius):
    """Return the part of a ball, as a point and a radius."""

    def cut(low, high):
        gap = max(low - center[2], center[2] - high, 0.0)
        if gap > radius:
            return []
        return [(shapely.Point(center[:2]), math.sqrt(radius**2 - gap**2))]

    return cut


def cut_cylinder(center, radius, height):
    """Return the part of an upright cylinder."""
    bottom, top = center[2] - height / 2.0, center[2] + height / 2.0
    point = shapely.Point(center[:2])
    return lambda low, high: [(point, radius)] if bottom <= high and top >= low else []


def touches(pieces, prisms, q, floor, room=0.0):
    """Return True if a robot on a floor touches a prism; heights are grown by ``room``."""
    x, y, yaw = q
    for outline, low, high in prisms:
        for cut in pieces:
            for part, radius in cut(low - floor - room, high - floor + room):
                turned = affinity.rotate(part, yaw, origin=(0.0, 0.0), use_radians=True)
                if shapely.distance(affinity.translate(turned, x, y), outline) <= radius + ROUNDING:
                    return True
    return False
