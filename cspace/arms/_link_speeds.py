"""Speeds of the points of a link.

The velocity of a point is linear in it, so the speed is largest at a corner of the link's convex
hull. Over a time it changes at most by the largest acceleration of the body's points times the
time: that by the rates of the joints, and that by their accelerations, each by the distances from
their axes (:mod:`cspace.arms._proofs.chain`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cspace.arms._proofs.chain import SPIN, VELOCITY, forward_kinematics, motion_bounds
from cspace.inside import Floats

if TYPE_CHECKING:
    from cspace.arms._model import Arm


def bound_speeds(arm: Arm, link: str, motion: Floats, seconds: Floats) -> Floats:
    """Bound the speed of a link's points, shape (...).

    ``motion``, shape (4, ..., dof), are configurations, velocities there, and the largest
    velocities and accelerations for ``seconds``, shape (...), around.
    """
    body, corners, radius = _gather_corners(arm, link)
    rows, rates, largest, gains = motion.reshape(4, -1, arm.dof)
    speeds = _find_speeds(arm, body, corners, radius, rows, rates)
    if seconds.any():
        reach = float(np.linalg.norm(corners, axis=1).max()) + radius
        slopes = np.empty(len(rows))
        rest = np.zeros(arm.dof)
        for k in range(len(rows)):
            _, half, _ = motion_bounds(arm.chain, body, 0, reach, rest, largest[k])
            slopes[k], _, _ = motion_bounds(arm.chain, body, 0, reach, rest, gains[k])
            slopes[k] += 2.0 * half
        speeds += np.abs(seconds).ravel() * slopes
    return speeds.reshape(seconds.shape)


def _gather_corners(arm: Arm, link: str) -> tuple[int, Floats, float]:
    """Return the body of a link, its corners on that, shape (n, 3), and their radius."""
    body, pose = arm.placements[link]
    corners = [pose[np.newaxis, :3, 3]]
    radius = 0.0
    for solid in arm.links:
        if solid.name == link:
            for outer, _ in solid.bounds_pairs:
                corners.append(outer.extremes)
                radius = max(radius, float(outer.boundary.radii.max(initial=0.0)))
    return body, np.concatenate(corners), radius


def _find_speeds(
    arm: Arm, body: int, corners: Floats, radius: float, rows: Floats, rates: Floats
) -> Floats:
    """Return the largest speeds of corners on a body, shape (n,)."""
    # Rates are added to configurations, so they should not be much smaller.
    sizes = np.maximum(np.abs(rates).max(axis=1), np.finfo(np.float64).tiny)
    ahead = rows + rates / sizes[:, np.newaxis]
    poses = np.empty((len(arm.chain.parents), 3, 6))
    frames = np.empty((len(rows), 3, 6))
    for k in range(len(rows)):
        forward_kinematics(arm.chain, rows[k], ahead[k], 0.0, poses)
        frames[k] = poses[body]
    spins = frames[:, np.newaxis, :, SPIN]
    points = corners @ frames[:, :, :3].swapaxes(1, 2) + frames[:, np.newaxis, :, 3]
    velocities = frames[:, np.newaxis, :, VELOCITY] + np.cross(spins, points)
    speeds = np.linalg.norm(velocities, axis=2).max(axis=1)
    speeds += radius * np.linalg.norm(spins[:, 0], axis=1)
    return np.asarray(sizes * speeds)
