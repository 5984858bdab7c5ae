"""Integrals of the product of two radial functions, each around its own centre: what two balls have in common.

The integral is taken in polar coordinates around the first centre, over the part of the first ball that the second one
covers,

    integral f(s / a) s^(dim - 1) integral g(rho / b) dOmega ds,    rho^2 = s^2 + D^2 - 2 s D cos(theta),

with composite Gauss-Legendre rules in s and theta whose panels shrink towards the ends, where the functions are steep,
and towards the second centre. So its error is relative to the integral itself, however thin the lens is. The number of
nodes is raised until two rules agree.
"""

from __future__ import annotations

import itertools
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import CspaceError
from cspace.spectral.descriptors.hankel import Radial, legendre_rule

Floats = NDArray[np.float64]

RULES: Final = ((8, 8), (12, 12), (16, 20), (24, 32), (32, 48))
"""Nodes in a panel, and halvings of panels towards each end, from coarse to fine."""

FLOOR: Final = 1e-60
"""Part of the smaller ball's ``radius^dim`` below which an integral is known to that part of it only: there the result
hangs on the last bits of the radii."""

SMALL_ANGLE: Final = 0.25
"""Below this the series of ``x - sin(x)`` loses less than the difference."""


def product_integral(f: Radial, g: Radial, a: float, b: float, distance: float, dim: int, tolerance: float) -> float:
    """Integral of ``f(|x| / a) g(|x - D e| / b)`` over the plane or space.

    Parameters
    ----------
    f, g : callable
        Values at (0, 1), not below zero.
    a, b : float
        Radii, metres.
    distance : float
        ``D``, metres.
    dim : int
    tolerance : float
        Relative to the integral, or to :data:`FLOOR`.

    Returns
    -------
    float
        Metres to the power ``dim``; 0 from the distance ``a + b`` on.

    Raises
    ------
    CspaceError
        If the finest rules do not agree within the tolerance.
    """
    if distance >= a + b:
        return 0.0
    # Around the smaller ball; in its radius, so that no power of it overflows.
    if a > b:
        f, g, a, b = g, f, b, a
    found = [0.0, 0.0]
    for nodes, halvings in RULES:
        found = [found[1], _polar(f, g, b / a, distance / a, dim, nodes, halvings)]
        if nodes > RULES[0][0] and abs(found[1] - found[0]) <= tolerance * max(found[1], FLOOR):
            return found[1] * a**dim
    raise CspaceError(
        f"the integral over balls of radii {a:g} and {b:g} at {distance:g} is {found[0]:g} or {found[1]:g}, by rules "
        f"of different order; they must agree within {tolerance:g}; pass a larger tolerance"
    )


def _polar(f: Radial, g: Radial, b: float, distance: float, dim: int, nodes: int, halvings: int) -> float:
    """The integral by one rule, with ``a = 1 <= b``."""
    first, last = max(0.0, distance - b), 1.0
    ends = sorted({first, last} | {s for s in (distance, b - distance) if first < s < last})
    s, weights = _graded(ends, nodes, halvings)
    reach = s * s + distance * distance - b * b
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        most = np.arccos(np.clip(reach / (2.0 * s * distance), -1.0, 1.0))
    most = np.where(s + distance <= b, math.pi, most)
    share, share_weights = _graded([0.0, 1.0], nodes, halvings)
    theta = most[:, None] * share
    half = np.sin(0.5 * theta)
    rho = np.sqrt((s[:, None] - distance) ** 2 + 4.0 * s[:, None] * distance * half * half)
    values = np.where(rho < b, g(np.minimum(rho / b, 1.0)), 0.0)
    if dim == 2:
        around = 2.0 * most * (values @ share_weights)
    else:
        around = 2.0 * math.pi * most * ((values * np.sin(theta)) @ share_weights)
    return float((weights * f(s) * s ** (dim - 1)) @ around)


def _graded(ends: list[float], nodes: int, halvings: int) -> tuple[Floats, Floats]:
    """A rule over neighbouring intervals, with panels that halve towards both ends of each."""
    shares = 0.5 ** np.arange(1.0, halvings + 1.0)
    breaks = np.concatenate([[0.0], shares[::-1], 1.0 - shares[1:], [1.0]])
    lows = np.array([low + (high - low) * breaks for low, high in itertools.pairwise(ends)])
    widths, starts = np.diff(lows, axis=1).ravel(), lows[:, :-1].ravel()
    x, weights = legendre_rule(nodes)
    points = starts[:, None] + widths[:, None] * (0.5 + 0.5 * x)
    return points.ravel(), (0.5 * widths[:, None] * weights).ravel()


def lens_measure(a: float, b: float, distance: float, dim: int) -> float:
    """Area or volume that two balls have in common.

    Parameters
    ----------
    a, b : float
        Radii, metres.
    distance : float
        Of the centres, metres.
    dim : int

    Returns
    -------
    float
        Metres to the power ``dim``, with small relative error also for thin lenses.
    """
    if distance >= a + b:
        return 0.0
    least = min(a, b)
    if distance <= abs(a - b):
        return math.pi * least**2 if dim == 2 else 4.0 / 3.0 * math.pi * least**3
    # Differences of like lengths first: they are exact, and what is left of them is all that counts.
    depth = (max(a, b) - distance) + least
    if dim == 3:
        spread = distance * (distance + 2.0 * (a + b)) - 3.0 * (a - b) ** 2
        return math.pi * depth**2 * spread / (12.0 * distance)
    # Halves of quotients, for the product may underflow.
    shares = (b - a) / distance, (a - b) / distance
    return _segment(a, 0.5 * depth * (1.0 + shares[0])) + _segment(b, 0.5 * depth * (1.0 + shares[1]))


def _segment(radius: float, height: float) -> float:
    """Area of the segment of a disc that is ``height`` high."""
    angle = 4.0 * math.asin(math.sqrt(min(1.0, height / (2.0 * radius))))
    return 0.5 * radius**2 * _less_sine(angle)


def _less_sine(x: float) -> float:
    """``x - sin(x)``."""
    if x > SMALL_ANGLE:
        return x - math.sin(x)
    term = total = x**3 / 6.0
    for n in (4, 6, 8, 10, 12):
        term *= -x * x / (n * (n + 1))
        total += term
    return total
