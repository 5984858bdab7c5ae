"""Distances by shapely of a robot that drives, from points."""

import math

import numpy as np
import shapely

CELL = 0.1
"""Side of a cell of the maps, metres."""


def drive(pose, twist, seconds):
    """Return the poses on the arc of a twist after some seconds; its third number is its side."""
    v, omega, side = (*twist, 0.0)[:3]
    half = 0.5 * omega * seconds
    chord = (v + 1j * side) * seconds * np.sinc(half / math.pi)
    place = complex(*pose[:2]) + chord * np.exp(1j * (pose[2] + half))
    return np.stack([place.real, place.imag, pose[2] + 2.0 * half], axis=-1)


def place_along(pose, commands, dt, instants=25):
    """Return poses along twists, each driven for ``dt``."""
    poses = [np.asarray(pose, dtype=float)]
    for twist in np.asarray(commands):
        poses.extend(drive(poses[-1], twist, np.linspace(0.0, dt, instants)[1:]))
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
