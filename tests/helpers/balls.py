"""Random balls and rotations, and sums of the overlaps of pairs of balls by plain quadrature."""

import math

import numpy as np
from scipy.spatial.transform import Rotation


def draw_rotations(rng, number, dim):
    """Draw rotations as matrices (number, d, d)."""
    vectors = rng.normal(size=(number, 3)) * (1.0 if dim == 3 else (0.0, 0.0, 1.0))
    return Rotation.from_rotvec(vectors).as_matrix()[:, :dim, :dim]


def move(balls, t, matrix):
    """Rotate balls about the origin, then translate them."""
    return balls[0] @ matrix.T + t, balls[1]


def draw_directions(rng, number, dim):
    """Draw unit vectors (number, d)."""
    directions = rng.normal(size=(number, dim))
    return directions / np.linalg.norm(directions, axis=1)[:, None]


def draw_pairs(rng, a, b, number):
    """Draw placements of a at which centers coincide, and the sums of both radii."""
    i = rng.integers(len(a[1]), size=number)
    j = rng.integers(len(b[1]), size=number)
    return b[0][j] - a[0][i], a[1][i] + b[1][j]


def evaluate_bump(s, alpha):
    """Evaluate the definition of a bump at distances below 1, in radii."""
    if math.isinf(alpha):
        return np.ones_like(s)
    with np.errstate(all="ignore"):
        return np.exp(1.0 / (1.0 - np.clip(s, 1e-12, 1.0 - 1e-12) ** -alpha))


def integrate_pairs(alpha, a, b, distance, dim):
    """Integrate products of two bumps over the lens of their balls, for pairs (n,).

    Slices across the common axis end at the border of the lens; their places are denser at both
    ends, and the slices on either side of the circle in which the balls meet are apart.
    """
    nodes, weights = np.polynomial.legendre.leggauss(48)
    u = 0.5 * (nodes + 1.0)
    a, b, distance = (values[:, None, None] for values in (a, b, np.maximum(distance, 1e-12)))
    low = np.maximum(-a, distance - b)
    high = np.minimum(a, distance + b)
    middle = np.clip((distance**2 + a**2 - b**2) / (2.0 * distance), low, high)
    total = 0.0
    for start, stop in ((low, middle), (middle, high)):
        x = start + (stop - start) * 0.5 * (1.0 - np.cos(math.pi * u))[:, None]
        x_weights = (stop - start) * (0.25 * math.pi * np.sin(math.pi * u) * weights)[:, None]
        square = np.minimum(a**2 - x**2, b**2 - (distance - x) ** 2)
        widest = np.sqrt(np.maximum(square, 0.0))
        y = widest * u
        first = evaluate_bump(np.hypot(x, y) / a, alpha)
        second = evaluate_bump(np.hypot(x - distance, y) / b, alpha)
        circle = 2.0 * math.pi * y if dim == 3 else 2.0
        total += (x_weights * first * second * circle * (0.5 * widest * weights)).sum(axis=(1, 2))
    return total


def sum_pairs(a, b, alpha, placements):
    """Sum the overlaps of pairs of balls at placements (n, d)."""
    steps = b[0] - a[0][:, None] - placements[:, None, None]
    distances = np.linalg.norm(steps, axis=3)
    first = np.broadcast_to(a[1][:, None], distances.shape)
    second = np.broadcast_to(b[1], distances.shape)
    close = distances < first + second
    values = np.zeros(distances.shape)
    pairs = first[close], second[close], distances[close]
    values[close] = integrate_pairs(alpha, *pairs, a[0].shape[1])
    return values.sum(axis=(1, 2))
