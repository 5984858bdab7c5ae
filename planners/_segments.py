"""Segments: straight lines, arcs and cubic curves of a path, with their proofs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from cspace._interface import Space
from cspace._rotations import Rotations
from cspace._rotations.base import shorter, wrapped
from cspace._support.arrays import Bools, Floats, Ints
from planners._local_planner import LocalPlanner

MAX_BOX_CELLS: Final = 0.5
"""Half sides of the largest boxes that prove a curve on a map, in cells."""

MAX_BOX_RADIANS: Final = math.radians(5.0)
"""Largest rotation of the largest boxes to either side, radians."""

CUTS_ON_MAPS: Final = 8
CUTS_OF_ARMS: Final = 4
"""Number of pieces into which an unproven piece is cut."""

CUT_LEVELS: Final = 3
"""Number of sizes of pieces."""

BOX_SLACK_CELLS: Final = 1e-9
"""Distance in cells by which boxes grow, for rounding."""

ROUNDING: Final = 1e-12
"""Radians, metres of joints, or relative rates by which bounds grow, for rounding."""

MAX_EDGE_TURN: Final = 3.0
"""Largest turn of an edge that is proven as a whole, radians; at pi rounding decides its side."""


class Segments(NamedTuple):
    """The m parts of a path: straight lines, arcs, and cubic curves.

    A curve is a polynomial in each coordinate. The yaw of a robot that drives is the direction of
    its curve instead.
    """

    starts: Floats  # (m, size), configurations
    rates: Floats  # (m, k), translation and rotation vector, or joints, per unit of length
    bends: Floats  # (m, k), second derivatives at the start
    twists: Floats  # (m, k), third derivatives
    curvatures: Floats  # (m,), radians per unit of length by which arcs turn left
    drives: Ints  # (m,), 1 if the yaw is the direction of a curve, -1 in reverse, otherwise 0
    lengths: Floats  # (m,)
    ends: Floats  # (m, size), configurations

    def select(self, index: Ints | Bools) -> Segments:
        """Return some of the segments."""
        return Segments._make(column[index] for column in self)

    @property
    def is_curve(self) -> Bools:
        """Whether each segment is a cubic curve, shape (m,)."""
        return np.asarray(self.bends.any(axis=1) | self.twists.any(axis=1) | (self.drives != 0))


def make_lines(starts: Floats, rates: Floats, lengths: Floats, ends: Floats) -> Segments:
    """Make straight segments."""
    none = np.zeros(len(lengths))
    zeros = np.zeros(rates.shape)
    drives = np.zeros(len(lengths), dtype=np.int64)
    return Segments(starts, rates, zeros, zeros, none, drives, lengths, ends)


def join_segments(parts: list[Segments]) -> Segments:
    """Join segments that follow each other."""
    return Segments._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


def align_quaternions(rows: Floats, rotations: Rotations) -> Floats:
    """Return configurations whose quaternions continue the ones before, for any rotations."""
    if "qw" not in rotations.names:
        return rows
    # Rotations take the shorter way, at whose end the next quaternion or its negative lies.
    aligned = rows.copy()
    quaternions = aligned[:, -4:]
    cosines = (quaternions[:-1] * quaternions[1:]).sum(axis=1)
    signs = np.where(cosines < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(signs)[:, np.newaxis]
    return aligned


def place_along(
    segments: Segments, rotations: Rotations, s: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return configurations at lengths along segments, and their derivatives by the length.

    ``s`` has shape (m,). The derivatives are translations and rotation vectors, shape (m, k).
    """
    length = s[:, np.newaxis]
    bends = segments.bends
    twists = segments.twists
    steps = length * (segments.rates + length * (bends / 2.0 + length * twists / 6.0))
    first = segments.rates + length * (bends + length * twists / 2.0)
    second = bends + length * twists
    arcs = np.flatnonzero(segments.curvatures)
    if len(arcs):
        curvatures = segments.curvatures[arcs]
        half = 0.5 * curvatures * s[arcs]
        # The chord of an arc, over the arc, is the sinc of half its angle.
        steps[arcs, :2] = turn_left(steps[arcs, :2], half) * np.sinc(half / np.pi)[:, np.newaxis]
        first[arcs, :2] = turn_left(first[arcs, :2], 2.0 * half)
        sideways = np.column_stack([-first[arcs, 1], first[arcs, 0]])
        second[arcs, :2] = curvatures[:, np.newaxis] * sideways
    q = rotations._add_steps(segments.starts, steps)
    driven = np.flatnonzero(segments.drives)
    if len(driven):
        signs = segments.drives[driven, np.newaxis]
        x, y = first[driven, :2].T
        ahead = signs * first[driven, :2]
        q[driven, 2] = np.arctan2(ahead[:, 1], ahead[:, 0])
        # Derivatives of the angle of (x, y), from its first, second and third derivatives.
        squares = x**2 + y**2
        ddx, ddy = second[driven, :2].T
        dddx, dddy = twists[driven, :2].T
        turn_rates = (x * ddy - y * ddx) / squares
        first[driven, 2] = turn_rates
        second[driven, 2] = (x * dddy - y * dddx) / squares
        second[driven, 2] -= 2.0 * turn_rates * (x * ddx + y * ddy) / squares
    return q, first, second


def turn_left(vectors: Floats, angles: Floats) -> Floats:
    """Turn plane vectors, shape (n, 2), left by angles."""
    cos = np.cos(angles)
    sin = np.sin(angles)
    x, y = vectors.T
    return np.column_stack([cos * x - sin * y, sin * x + cos * y])


def can_prove_curves(space: Space) -> bool:
    """Return True if a space has a proof for curves: cells, or hulls of an arm."""
    return hasattr(space, "is_free_around") or hasattr(space, "motions_are_free_around")


def prove_segments(space: Space, exact: bool, segments: Segments) -> Bools:
    """Return whether segments are proven free: straight ones as edges, curves piece by piece.

    With ``exact``, the geometry decides straight ones in MIXED cells.
    """
    is_curve = segments.is_curve
    proven = np.zeros(len(is_curve), dtype=np.bool_)
    if not is_curve.all():
        proven[~is_curve] = _prove_lines(space, exact, segments.select(~is_curve))
    if is_curve.any() and can_prove_curves(space):
        proven[is_curve] = _prove_curves(space, segments.select(is_curve))
    return proven


def _prove_lines(space: Space, exact: bool, lines: Segments) -> Bools:
    """Return whether straight segments are proven free, shape (m,)."""
    steps = lines.rates * lines.lengths[:, np.newaxis]
    first_angle = space.dim if space.has_poses else steps.shape[1]
    turned = np.abs(steps[:, first_angle:]).max(axis=1, initial=0.0)
    middles = place_along(lines, space.rotations, 0.5 * lines.lengths)[0]
    check = LocalPlanner(space, exact).edge_checker()
    proven = np.zeros(len(turned), dtype=np.bool_)
    for k, turn in enumerate(turned.tolist()):
        rows = [lines.starts[k].tolist(), lines.ends[k].tolist()]
        if turn > MAX_EDGE_TURN:
            # Edges turn the shorter way, so a large turn is proven in two parts.
            rows.insert(1, middles[k].tolist())
        proven[k] = all(check(*first, *last) for first, last in itertools.pairwise(rows))
    return proven


def _prove_curves(space: Any, curves: Segments) -> Bools:
    """Return whether curves are proven free, shape (m,).

    Each is cut into pieces. Unproven pieces are cut again, until the last level, except those of
    curves that contain a point which is not free. The proof of a curve does not depend on the
    others.
    """
    test: Callable[..., Bools] = _test_boxes
    test_points: Callable[[Floats], Bools] = space.is_free
    cuts = CUTS_ON_MAPS
    counts = np.ones(len(curves.lengths), dtype=np.int64)
    if hasattr(space, "is_free_around"):
        # The test of boxes is compiled anyway, and tests points, too.
        test_points = partial(space.is_free_around, distance=0.0)
        reach = 2.0 * MAX_BOX_CELLS * 2.0 * space.resolution
        metres = np.linalg.norm(curves.rates[:, : space.dim], axis=1) * curves.lengths
        counts += (metres / reach).astype(np.int64)
    else:
        test = _test_motions
        cuts = CUTS_OF_ARMS
    owners = np.repeat(np.arange(len(counts)), counts)
    firsts = np.cumsum(counts) - counts
    widths = (curves.lengths / counts)[owners]
    begins = (np.arange(len(owners)) - firsts[owners]) * widths
    proven = np.ones(len(counts), dtype=np.bool_)
    for level in range(CUT_LEVELS):
        if level:
            points = place_along(curves.select(owners), space.rotations, begins + 0.5 * widths)[0]
            proven[owners[~test_points(points)]] = False
            left = proven[owners]
            owners = np.repeat(owners[left], cuts)
            widths = np.repeat(widths[left], cuts) / cuts
            begins = np.repeat(begins[left], cuts)
            begins += np.arange(len(begins)) % cuts * widths
        free = test(space, curves.select(owners), begins, widths, level)
        owners = owners[~free]
        widths = widths[~free]
        begins = begins[~free]
        if not len(owners):
            break
    proven[owners] = False
    return proven


def _test_boxes(space: Any, curves: Segments, begins: Floats, widths: Floats, level: int) -> Bools:
    """Return whether pieces lie in boxes of FREE cells, shape (n,).

    On a piece of width w, the derivative is a quadratic Bezier curve, in the convex hull of three
    vectors. So each coordinate stays within w / 2 times the largest of these of the middle. The
    direction of driving stays in the cone of the three vectors.
    """
    rotations = space.rotations
    dim = space.dim
    half = 0.5 * widths[:, np.newaxis]
    begin = begins[:, np.newaxis]
    begin_bends = curves.bends + begin * curves.twists
    begin_rates = curves.rates + 0.5 * begin * (curves.bends + begin_bends)
    control_rates = begin_rates + half * begin_bends
    end_rates = control_rates + half * (begin_bends + 2.0 * half * curves.twists)
    hull = np.stack([begin_rates, control_rates, end_rates])
    spreads = half * np.abs(hull).max(axis=0)
    middles, _, _ = place_along(curves, rotations, begins + 0.5 * widths)
    turns = np.linalg.norm(spreads[:, dim:], axis=1)
    driven = np.flatnonzero(curves.drives)
    if len(driven):
        yaws = np.arctan2(hull[:, driven, 1], hull[:, driven, 0])
        in_reverse = curves.drives[driven] < 0
        headings = middles[driven, 2] + np.where(in_reverse, np.pi, 0.0)
        angles = np.abs(shorter(yaws - headings)).max(axis=0)
        is_zero = ~hull[:, driven, :2].any(axis=2).all(axis=0)
        turns[driven] = np.where(is_zero, np.inf, angles)
    cell = 2.0 * space.resolution
    size = float(CUTS_ON_MAPS) ** -level
    distance = MAX_BOX_CELLS * cell * size
    angle = MAX_BOX_RADIANS * size
    fits = (spreads[:, :dim].max(axis=1) <= distance) & (turns <= angle)
    if rotations.names == ("yaw",):
        middles[:, -1] = wrapped(middles[:, -1])
    distance += BOX_SLACK_CELLS * cell
    fits[fits] = space.is_free_around(middles[fits], distance, angle + ROUNDING)
    return np.asarray(fits)


def _test_motions(
    space: Any, curves: Segments, begins: Floats, widths: Floats, level: int
) -> Bools:
    """Return whether pieces are near motions that are free with that deviation, shape (n,).

    On a piece of width w, each joint deviates from its even motion by at most w^2 / 8 times its
    largest second derivative, which is at an end because it is linear.
    """
    rotations = space.rotations
    firsts, _, begin_bends = place_along(curves, rotations, begins)
    lasts, _, end_bends = place_along(curves, rotations, begins + widths)
    bends = np.maximum(np.abs(begin_bends), np.abs(end_bends))
    deviations = bends * widths[:, np.newaxis] ** 2 / 8.0
    # A few sizes are quicker than many, and do not depend on the other pieces.
    sizes = np.exp2(np.ceil(np.log2(deviations.max(axis=1) + ROUNDING)))
    free = np.zeros(len(sizes), dtype=np.bool_)
    for size in np.unique(sizes).tolist():
        same = sizes == size
        reach = np.full_like(deviations[0], size)
        free[same] = space.motions_are_free_around(firsts[same], lasts[same], reach)
    return free
