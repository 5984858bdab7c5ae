"""Speeds of the points of a link.

The velocity of a point is linear in it, so the speed is largest at a corner of the link's convex
hull. Over a time it changes at most by the largest acceleration of the body's points times the
time: that by the rates of the joints, and that by their accelerations, each by the distances from
their axes (:mod:`cspace._bodies.chain`).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cspace.inside import (
    SPIN,
    VELOCITY,
    Chain,
    Floats,
    Frame,
    Solid,
    forward_kinematics,
    motion_bounds,
)


def bound_speeds(
    chain: Chain, frame: Frame, solids: Iterable[Solid], motion: Floats, seconds: Floats
) -> Floats:
    """Bound the speed of the points of a link, which are its origin and solids, shape (...).

    ``motion``, shape (4, ..., dof), are configurations, velocities there, and the largest
    velocities and accelerations for ``seconds``, shape (...), around.
    """
    corners, radius = _gather_corners(frame.pose, solids)
    rows, rates, largest, gains = motion.reshape(4, -1, motion.shape[-1])
    speeds = _find_speeds(chain, frame.body, corners, radius, rows, rates)
    if seconds.any():
        reach = float(np.linalg.norm(corners, axis=1).max()) + radius
        slopes = np.empty(len(rows))
        rest = np.zeros_like(rows[0])
        for k in range(len(rows)):
            _, half, _ = motion_bounds(chain, frame.body, 0, reach, rest, largest[k])
            slopes[k], _, _ = motion_bounds(chain, frame.body, 0, reach, rest, gains[k])
            slopes[k] += 2.0 * half
        speeds += np.abs(seconds).ravel() * slopes
    return speeds.reshape(seconds.shape)


def _gather_corners(pose: Floats, solids: Iterable[Solid]) -> tuple[Floats, float]:
    """Return the corners of a link on its body, shape (n, 3), and their radius."""
    corners = [pose[np.newaxis, :3, 3]]
    radius = 0.0
    for solid in solids:
        for outer, _ in solid.bounds_pairs:
            corners.append(outer.extremes)
            radius = max(radius, float(outer.boundary.radii.max(initial=0.0)))
    return np.concatenate(corners), radius


def _find_speeds(
    chain: Chain, body: int, corners: Floats, radius: float, rows: Floats, rates: Floats
) -> Floats:
    """Return the largest speeds of corners on a body, shape (n,)."""
    # Rates are added to configurations, so they should not be much smaller.
    sizes = np.maximum(np.abs(rates).max(axis=1), np.finfo(np.float64).tiny)
    ahead = rows + rates / sizes[:, np.newaxis]
    poses = np.empty((len(chain.parents), 3, 6))
    frames = np.empty((len(rows), 3, 6))
    for k in range(len(rows)):
        forward_kinematics(chain, rows[k], ahead[k], 0.0, poses)
        frames[k] = poses[body]
    spins = frames[:, np.newaxis, :, SPIN]
    points = corners @ frames[:, :, :3].swapaxes(1, 2) + frames[:, np.newaxis, :, 3]
    velocities = frames[:, np.newaxis, :, VELOCITY] + np.cross(spins, points)
    speeds = np.linalg.norm(velocities, axis=2).max(axis=1)
    speeds += radius * np.linalg.norm(spins[:, 0], axis=1)
    return np.asarray(sizes * speeds)
