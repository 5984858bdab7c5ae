"""NURBS trajectories, cut into straight legs whose deviation is bounded.

A positive weight keeps a rational Bezier piece in the convex hull of its control points. Its
tangent lies in the convex cone of their differences, because ``B_i B_j' - B_i' B_j`` is not
negative for i < j, where B are Bernstein polynomials. So the control polygon bounds how far a piece
leaves its chord, and its directions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from scipy.interpolate import BPoly, BSpline, PPoly

from cspace.inside import Floats

MAX_DEVIATION: Final = 0.001
"""Largest distance of a leg from its chord, metres."""

MAX_HALVINGS: Final = 20
"""Number of times that a piece of a curve is halved at most."""


class Leg(NamedTuple):
    """A piece of a lane.

    Attributes
    ----------
    start, end : tuple of float
        Ends of its chord, metres; points of the lane.
    first, last : float
        Directions of travel at both ends, radians.
    drift : float
        Largest distance of the lane from the chord, metres.
    spread : float
        Largest angle between its directions, radians.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    first: float
    last: float
    drift: float = 0.0
    spread: float = 0.0


def reverse_legs(legs: tuple[Leg, ...]) -> tuple[Leg, ...]:
    """Return a lane's legs, driven from its end to its start."""
    return tuple(
        Leg(
            leg.end,
            leg.start,
            leg.last + math.pi,
            leg.first + math.pi,
            leg.drift,
            leg.spread,
        )
        for leg in reversed(legs)
    )


def cut_nurbs(degree: int, knots: Floats, points: Floats, weights: Floats) -> tuple[Leg, ...]:
    """Cut a NURBS curve into legs.

    ``points`` are the control points, shape (n, 2). Raises ValueError, with the reason, if the
    numbers are no such curve, or the curve turns too sharply. The directions of legs jump where the
    curve has a corner, or turns back.
    """
    if len(knots) != len(points) + degree + 1:
        count = len(points) + degree + 1
        raise ValueError(
            f"has {len(knots)} knots; {len(points)} control points of degree {degree} need {count}"
        )
    # Largest degree of a curve; work grows with its square.
    max_degree = 16
    if degree > max_degree:
        raise ValueError(f"has the degree {degree}; it may be {max_degree} at most")
    if degree < 1 or len(points) <= degree:
        raise ValueError(f"has {len(points)} control points of degree {degree}; too few")
    if (np.diff(knots) < 0.0).any() or knots[degree] >= knots[-degree - 1]:
        raise ValueError("has knots that do not rise")
    if not (weights > 0.0).all():
        raise ValueError("has a weight that is not above zero")
    homogeneous = np.column_stack([points * weights[:, None], weights])
    spline = BSpline(knots, homogeneous, degree)
    widths = np.diff(knots)
    is_inside = widths > 0.0
    is_inside[:degree] = is_inside[len(knots) - 1 - degree :] = False
    starts = np.flatnonzero(is_inside)
    # Cut at the knots only, because a knot may occur several times.
    breaks = np.append(knots[starts], knots[starts[-1] + 1])
    powers = [spline(breaks[:-1], nu) / math.factorial(nu) for nu in range(degree, -1, -1)]
    pieces = BPoly.from_power_basis(PPoly(np.array(powers), breaks)).c
    legs: list[Leg] = []
    for k in range(pieces.shape[1]):
        for leg in _cut_piece(pieces[:, k]):
            gap = math.dist(legs[-1].end, leg.start) if legs else 0.0
            x, y = leg.start
            # Distance between pieces of a curve, metres, up to which they join; it adds to their
            # drift.
            if gap > 1e-6:
                raise ValueError(f"jumps {gap:.3g} m to ({x:.6g}, {y:.6g}); its pieces must join")
            # Largest number of legs of a curve.
            if len(legs) == 4096:
                raise ValueError(f"is too long or bent at ({x:.6g}, {y:.6g}); units are metres")
            legs.append(leg._replace(drift=leg.drift + gap))
    return tuple(legs)


def clamp_knots(degree: int, points: int) -> Floats:
    """Return uniform knots that clamp both ends of a curve."""
    inner = np.linspace(0.0, 1.0, max(0, points - degree) + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


def _cut_piece(controls: Floats) -> Iterator[Leg]:
    """Cut a rational Bezier piece (n, 3) into legs."""
    pending = [(controls, 0)]
    while pending:
        controls, halvings = pending.pop()
        leg = _make_leg(controls)
        if leg is None:
            continue
        # Largest angle between the directions of a leg, radians.
        if leg.drift <= MAX_DEVIATION and leg.spread <= math.radians(0.5):
            yield leg
        elif halvings < MAX_HALVINGS:
            first, second = _halve(controls)
            pending += [(second, halvings + 1), (first, halvings + 1)]
        else:
            x, y = leg.start
            raise ValueError(f"turns too sharply at ({x:.6g}, {y:.6g}); units are metres")


def _make_leg(controls: Floats) -> Leg | None:
    """Return a Bezier piece's chord with bounds, or None without length."""
    points = controls[:, :2] / controls[:, 2:]
    # Rounding of the points of a curve, as a share of its coordinates.
    rounding = 1e-9 * (1.0 + float(np.abs(points).max()))
    sides = np.diff(points, axis=0)
    # Length of a side of a control polygon, metres, up to which it has no direction.
    min_leg = 1e-9
    sides = sides[np.hypot(*sides.T) > min_leg]
    if not len(sides):
        return None
    angles = np.unwrap(np.arctan2(sides[:, 1], sides[:, 0]))
    spread = float(np.ptp(angles))
    start, end = points[0], points[-1]
    chord = end - start
    length2 = float(chord @ chord)
    # The farthest point of a convex hull from a segment is one of its corners.
    shares = np.clip((points - start) @ chord / max(length2, min_leg**2), 0.0, 1.0)
    drift = float(np.hypot(*(points - start - shares[:, None] * chord).T).max())
    return Leg(
        (float(start[0]), float(start[1])),
        (float(end[0]), float(end[1])),
        float(angles[0]),
        float(angles[-1]),
        drift if drift <= rounding and len(points) == 2 else drift + rounding,
        spread,
    )


def _halve(controls: Floats) -> tuple[Floats, Floats]:
    """Halve a Bezier piece, by de Casteljau's algorithm."""
    firsts, lasts = [controls[0]], [controls[-1]]
    while len(controls) > 1:
        controls = 0.5 * (controls[:-1] + controls[1:])
        firsts.append(controls[0])
        lasts.append(controls[-1])
    return np.array(firsts), np.array(lasts[::-1])
