"""Random rotations, and sums of the overlaps of pairs of balls."""

import numpy as np
from scipy.spatial.transform import Rotation

from cspace.spectral._bump import pair_integrals


def draw_rotations(rng, number, dim):
    """Draw rotations as matrices (number, d, d)."""
    vectors = rng.normal(size=(number, 3)) * (1.0 if dim == 3 else (0.0, 0.0, 1.0))
    return Rotation.from_rotvec(vectors).as_matrix()[:, :dim, :dim]


def move(balls, t, matrix):
    """Rotate balls about the origin, then translate them."""
    return balls[0] @ matrix.T + t, balls[1]


def sum_pairs(a, b, bump, placements):
    """Sum the overlaps of pairs of balls at placements (n, d); return the error of a sum too."""
    steps = b[0] - a[0][:, None] - placements[:, None, None]
    distances = np.linalg.norm(steps, axis=3)
    first = np.broadcast_to(a[1][:, None], distances.shape)
    second = np.broadcast_to(b[1], distances.shape)
    close = distances < first + second
    values, errors = np.zeros((2, *distances.shape))
    pairs = first[close], second[close], distances[close]
    values[close], errors[close] = pair_integrals(bump, *pairs, a[0].shape[1])
    return values.sum(axis=(1, 2)), float(errors.sum(axis=(1, 2)).max())
