"""Motions in closed form: cubic pieces, arcs, turns on the spot, and headings along a curve."""

import math
from typing import NamedTuple

import numpy as np


class Pieces(NamedTuple):
    """The n pieces of a motion; each one goes from t = 0 to 1.

    Coordinates are cubic polynomials: positions, then a yaw or a rotation vector from ``spin``, or
    joints. The position of an arc turns with its yaw, so that its path is a circle. A heading of 1
    replaces the yaw by the direction of the curve, and one of -1 by its opposite.
    """

    start: np.ndarray  # (n, k)
    rates: np.ndarray  # (n, 3, k), first to third derivatives at t = 0
    is_arc: np.ndarray  # (n,), bool
    heading: np.ndarray  # (n,), 1, -1 or 0
    spin: np.ndarray | None = None  # (n, 4), quaternions at t = 0 in space, scalar last

    def at(self, rows, t):
        """Return the coordinates of pieces at times, shape (n, k)."""
        s = t[:, None]
        first, second, third = np.moveaxis(self.rates[rows], 1, 0)
        steps = s * (first + s * (second / 2.0 + s * third / 6.0))
        if self.is_arc.any():
            arcs = np.flatnonzero(self.is_arc[rows])
            half = 0.5 * t[arcs] * first[arcs, 2]
            steps[arcs, :2] = turn(steps[arcs, :2], half) * np.sinc(half / np.pi)[:, None]
        q = self.start[rows] + steps
        ahead = self.heading[rows]
        if ahead.any():
            slope = (first + s * (second + s * third / 2.0))[:, :2] * ahead[:, None]
            q[ahead != 0, 2] = np.arctan2(slope[:, 1], slope[:, 0])[ahead != 0]
        return q

    def bound(self, rows, t0, t1, dim):
        """Bound the positions' and the angles' first and second derivatives, four times (n,)."""
        middle, half = (0.5 * (t0 + t1))[:, None], (0.5 * (t1 - t0))[:, None]
        first, second, third = np.moveaxis(self.rates[rows], 1, 0)
        bend = np.maximum(abs(second + t0[:, None] * third), abs(second + t1[:, None] * third))
        rate = first + middle * (second + middle * third / 2.0)
        size = np.linalg.norm
        move, moves = size(rate[:, :dim], axis=1), size(bend[:, :dim], axis=1)
        fastest, slowest = move + half[:, 0] * moves, move - half[:, 0] * moves
        spin = size(abs(rate[:, dim:]) + half * bend[:, dim:], axis=1)
        spins = size(bend[:, dim:], axis=1)
        moves = np.where(self.is_arc[rows], fastest * spin, moves)
        driven = self.heading[rows] != 0
        if driven.any():
            # The yaw's rate is (p' x p'') / |p'|^2.
            least = np.where(slowest > 0.0, slowest, np.nan)
            jerk = size(third[:, :dim], axis=1)
            spins = np.where(driven, jerk / least + 2.0 * (moves / least) ** 2, spins)
            spin = np.where(driven, moves / least, spin)
        return fastest, moves, np.nan_to_num(spin, nan=np.inf), np.nan_to_num(spins, nan=np.inf)


def turn(vectors, angles):
    """Turn plane vectors left by angles."""
    c, s = np.cos(angles)[..., None], np.sin(angles)[..., None]
    x, y = vectors[..., :1], vectors[..., 1:2]
    return np.concatenate([c * x - s * y, s * x + c * y], axis=-1)


def make_lines(rows, angles=(), spin=None):
    """Make straight pieces between rows; each of the columns ``angles`` turns the shorter way.

    Rows of quaternions ``spin`` have a rotation vector of zero in their last three columns.
    """
    rows = np.asarray(rows, float)
    if len(rows) == 1:
        rows, spin = np.repeat(rows, 2, axis=0), None if spin is None else np.repeat(spin, 2, 0)
    steps = np.diff(rows, axis=0)
    for column in angles:
        steps[:, column] = (steps[:, column] + np.pi) % (2.0 * np.pi) - np.pi
    if spin is not None:
        spin = np.asarray(spin, float) / np.linalg.norm(spin, axis=1, keepdims=True)
        steps[:, -3:] = list(map(find_rotation, spin[:-1], spin[1:]))
        spin = spin[:-1]
    rates = np.zeros((len(steps), 3, rows.shape[1]))
    rates[:, 0] = steps
    still = np.zeros(len(steps), int)
    return Pieces(rows[:-1], rates, still > 0, still, spin)


def make_arcs(poses, steps):
    """Make lines and arcs from poses (x, y, yaw), and steps along the first heading with turns."""
    rates = np.zeros((len(poses), 3, 3))
    rates[:, 0] = steps
    return Pieces(poses, rates, rates[:, 0, 2] != 0.0, np.zeros(len(poses), int))


def find_gap(pieces, rows, which, times, angles=()):
    """Return how far pieces are from joining each other, and from rows that they pass at times.

    The first and the last row are the ends of the motion. Angles count modulo a turn.
    """
    every = np.arange(len(pieces.start))
    starts, ends = (pieces.at(every, np.full(len(every), t)) for t in (0.0, 1.0))
    steps = [ends[:-1] - starts[1:], rows[:1] - starts[:1], rows[-1:] - ends[-1:]]
    steps = np.concatenate([*steps, rows - pieces.at(which, times)])
    for column in angles:
        steps[:, column] = (steps[:, column] + np.pi) % (2.0 * np.pi) - np.pi
    backwards = (np.diff(which + times) < -1e-6).any()
    return np.inf if backwards else float(np.abs(steps).max())


def find_rotation(first, last):
    """Return the rotation vector of the shorter way between quaternions, in the world's frame."""
    v, w = -first[:3], last[:3]
    vector = last[3] * v + first[3] * w + np.cross(w, v)
    scalar = last[3] * first[3] - w @ v
    size = np.linalg.norm(vector)
    angle = 2.0 * np.arctan2(size, abs(scalar)) * (1.0 if scalar >= 0.0 else -1.0)
    return vector * (angle / size) if size > 0.0 else 2.0 * vector


def matrix_of(vector):
    """Return the rotation matrix of a rotation vector (Rodrigues)."""
    x, y, z = vector
    angle = math.hypot(x, y, z)
    if angle == 0.0:
        return np.eye(3)
    cross = np.array([(0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)]) / angle
    return np.eye(3) + math.sin(angle) * cross + 2.0 * math.sin(angle / 2.0) ** 2 * cross @ cross


def matrix_of_quaternion(q):
    """Return the rotation matrix of a unit quaternion, scalar last."""
    x, y, z, w = q
    cross = np.array([(0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
