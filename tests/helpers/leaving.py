"""Distances by shapely of a robot that drives, from points."""

import math

import numpy as np
import shapely

CELL = 0.1
"""Side of a cell of the maps, metres."""


def place_along(pose, commands, dt, instants=25):
    """Return poses along twists, each driven for ``dt``, by integrals of the unicycle."""
    x, y, yaw = pose
    poses = [(x, y, yaw)]
    for v, omega in np.asarray(commands).tolist():
        for seconds in np.linspace(0.0, dt, instants)[1:]:
            after = yaw + omega * seconds
            if abs(omega) < 1e-9:
                along, aside = v * seconds, 0.0
                place = x + along * math.cos(yaw), y + along * math.sin(yaw) + aside
            else:
                radius = v / omega
                place = (
                    x + radius * (math.sin(after) - math.sin(yaw)),
                    y - radius * (math.cos(after) - math.cos(yaw)),
                )
            poses.append((*place, after))
        x, y, yaw = poses[-1]
    return np.array(poses)


def bound_distances(cores, poses, points):
    """Return the distances of points from convex cores at poses, negative inside.

    The shape is (number of poses, number of cores times number of points).
    """
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    offsets = points[np.newaxis] - poses[:, np.newaxis, :2]
    seen = shapely.points(
        cos * offsets[..., 0] + sin * offsets[..., 1], cos * offsets[..., 1] - sin * offsets[..., 0]
    )
    distances = []
    for core in cores:
        depths = shapely.distance(core.boundary, seen) if core.area else 0.0
        distances.append(
            np.where(shapely.covers(core, seen), -depths, shapely.distance(core, seen))
        )
    return np.concatenate(distances, axis=1)
