"""Kernels that compute the shortest curves of cars and prove them free.

A *word* is a curve of at most five segments. Each has a steering, 1 (left), -1 (right) or 0
(straight on), and a length in turning radii, negative in reverse. The *gap* of a word is the
distance between its end and its goal, in turning radii and in radians. It is about 1e-15, or 1e-8
after a root near zero. Words are rows of two arrays, shapes (n, 5).

References
----------
L. E. Dubins, "On curves of minimal length with a constraint on average curvature", 1957;
J. A. Reeds and L. A. Shepp, "Optimal paths for a car that goes both forwards and backwards", 1990.
"""

from __future__ import annotations

import math

import numpy as np

from cspace.arrays import Floats, Ints
from cspace.compiling import allocating, kernel
from cspace.map.points import around_is_free, position_in_plane
from cspace.map.record import Map
from cspace.rotations.base import TWO_PI
from planners.integrals import MAX_RADIANS_PER_STEP, CostDensity, Values, cost_at

Pose = tuple[float, float, float]
Steering = tuple[int, int, int, int, int]
Lengths = tuple[float, float, float, float, float]

DUBINS = 0
"""Kind of curves that only go forwards."""

REEDS_SHEPP = 1
"""Kind of curves that also reverse."""

MAX_GAP = 1e-6
"""Largest gap of a word that reaches its goal, in turning radii and in radians. The proof covers
it."""

SNAP_RADIANS = 1e-6
"""Arcs within that many radians below 2 pi are tried as 0, because rounding turns empty arcs into
loops."""

TOUCH_TOLERANCE = 1e-7
"""Largest distance, in turning radii, between the circles of two adjoining arcs, which touch but
for rounding."""

WORD_FORMS = 9
"""Number of forms of words, see :func:`_solve_form`."""

MAX_WORDS = 48
"""Words to one goal: nine forms, mirrored and reversed, and three of them backwards, as (9 + 3) *
4."""

TIE_TOLERANCE = 1e-6
"""Largest difference in length, in turning radii, between curves that count as equally short."""

POINT_ERROR = 1e-9
"""Allowance for the rounding of a curve's points, in turning radii and in radians."""

MAX_PIECE_CELLS = 4.0
"""Length of the longest piece of a curve that is proven at once, in cells."""

MIN_PIECE_CELLS = 1.0 / 16.0
"""Length of the shortest piece of a curve that is proven at once, in cells."""


@allocating
def prove_length(
    map_: Map,
    kind: int,
    radius: float,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
) -> float:
    """Return the length of the shortest curve; -1 if unproven.

    The length is in metres; -1 means that the curve does not lie in FREE cells of the grid. If the
    lengths of several curves differ by at most ``TIE_TOLERANCE``, all must lie in FREE cells,
    because the robot may drive any one.
    """
    q0, q1 = (x0, y0, yaw0), (x1, y1, yaw1)
    steering, lengths = np.zeros((2 * MAX_WORDS, 5), np.int64), np.zeros((2 * MAX_WORDS, 5))
    count, gap = find_shortest_words(kind, radius, (q0, q1), TIE_TOLERANCE, steering, lengths)
    if not gap <= MAX_GAP:
        return -1.0
    shortest = total_length(lengths[0])
    if kind == REEDS_SHEPP:
        # OMPL may compute its curve from the other end, where rounding can prefer another of the
        # tied curves.
        others, _ = find_shortest_words(
            kind, radius, (q1, q0), TIE_TOLERANCE, steering[count:], lengths[count:]
        )
        for row in range(count, count + others):
            for k in range(5):
                steering[count, k], lengths[count, k] = steering[row, k], lengths[row, k]
            reverse(steering[count], lengths[count])
            count += is_new(steering, lengths, count)
    # The driven curve stays this close to ours, however the gap spreads along it and from whichever
    # end it starts.
    spare = (gap if count == 1 else MAX_GAP) * (1.0 + shortest + TIE_TOLERANCE) + POINT_ERROR
    for end in (q0, q1):
        if not pose_is_free(map_, end, spare * radius, spare):
            return -1.0
    for row in range(count):
        if not word_is_free(map_, radius, q0, steering[row], lengths[row], spare):
            return -1.0
    return radius * shortest


@allocating
def curve_cost(
    map_: Map,
    field: Values,
    density: CostDensity,
    curve: tuple[int, float],
    both: tuple[float, ...],
) -> float:
    """Integrate the cost along the shortest curve between ``both`` configurations.

    The midpoint rule has steps of at most one cell and 5 degrees.
    """
    (kind, radius), (x0, y0, yaw0, x1, y1, yaw1) = curve, both
    steering, lengths, _ = shortest_word(kind, radius, (x0, y0, yaw0), (x1, y1, yaw1))
    pose, total = (0.0, 0.0, yaw0), 0.0
    for k in range(5):
        length = lengths[k]
        longest = (
            map_.spacing if steering[k] == 0 else min(map_.spacing, MAX_RADIANS_PER_STEP * radius)
        )
        steps = math.ceil(radius * abs(length) / longest)
        for step in range(steps):
            u, v, yaw = advance(pose, steering[k], length * (step + 0.5) / steps)
            position = position_in_plane(map_, x0 + radius * u, y0 + radius * v)
            cost = cost_at(map_, field, density, position, (yaw,))
            total += cost * radius * abs(length) / steps
        pose = advance(pose, steering[k], length)
    return total


@kernel
def pose_is_free(map_: Map, pose: Pose, distance: float, angle: float) -> bool:
    """Return True if all poses within ``distance`` and ``angle`` of another are proven free."""
    return around_is_free(
        map_, position_in_plane(map_, pose[0], pose[1]), (pose[2],), distance, angle
    )


@kernel
def word_is_free(
    map_: Map, radius: float, q0: Pose, steering: Ints, lengths: Floats, spare: float
) -> bool:
    """Return True if a word lies in FREE cells.

    All configurations within ``spare`` of the word, except its ends, must be FREE. A piece of
    length l lies within l / 2 of its center and turns by at most l / (2 radius) from there. So a
    box of that size around the center contains it. If the box is not free, the piece is halved,
    until its center is not free or the piece is shorter than ``MIN_PIECE_CELLS``.
    """
    longest, shortest = (
        MAX_PIECE_CELLS * map_.spacing / radius,
        MIN_PIECE_CELLS * map_.spacing / radius,
    )
    pose = (0.0, 0.0, q0[2])
    for k in range(5):
        total, sign, steer = abs(lengths[k]), math.copysign(1.0, lengths[k]), steering[k]
        done, step = 0.0, longest
        while done < total:
            last = step >= total - done
            piece = total - done if last else step
            half = 0.5 * piece
            u, v, yaw = advance(pose, steer, sign * (done + half))
            center = (q0[0] + radius * u, q0[1] + radius * v, yaw)
            if pose_is_free(
                map_, center, (half + spare) * radius, (half if steer != 0 else 0.0) + spare
            ):
                if last:
                    break
                done, step = done + piece, min(2.0 * step, longest)
            elif piece <= shortest or not pose_is_free(map_, center, spare * radius, spare):
                return False
            else:
                step = half
        pose = advance(pose, steer, lengths[k])
    return True


@allocating
def shortest_word(kind: int, radius: float, q0: Pose, q1: Pose) -> tuple[Ints, Floats, float]:
    """Return the shortest word's steering, lengths and gap."""
    steering, lengths = np.zeros((MAX_WORDS, 5), np.int64), np.zeros((MAX_WORDS, 5))
    _, gap = find_shortest_words(kind, radius, (q0, q1), -math.inf, steering, lengths)
    return steering[0], lengths[0], gap


@kernel
def reverse(steering: Ints, lengths: Floats) -> None:
    """Reverse a word in place: its end becomes its start."""
    for k in range(3):
        steering[k], steering[4 - k] = steering[4 - k], steering[k]
        lengths[k], lengths[4 - k] = -lengths[4 - k], -lengths[k]


@allocating
def find_shortest_words(
    kind: int,
    radius: float,
    endpoints: tuple[Pose, Pose],
    tie: float,
    steering: Ints,
    lengths: Floats,
) -> tuple[int, float]:
    """Write the shortest words between two configurations.

    The shortest one comes first, then all words longer by at most ``tie``. Each form gives words by
    symmetry: mirrored (left for right), reversed (ahead for back) and backwards (from the end to
    the start). Each word is driven and counts only if it reaches the goal, so that no form needs a
    separate proof.

    Returns the number of words, without duplicates, and the gap of the shortest.
    """
    (x0, y0, yaw0), (x1, y1, yaw1) = endpoints
    dx, dy, c, s = (x1 - x0) / radius, (y1 - y0) / radius, math.cos(yaw0), math.sin(yaw0)
    x, y, phi = dx * c + dy * s, dy * c - dx * s, _around(yaw1 - yaw0)
    all_steering, all_lengths = np.zeros((MAX_WORDS, 5), np.int64), np.zeros((MAX_WORDS, 5))
    candidates = _write_candidates(kind, (x, y, phi), all_steering, all_lengths)
    best, shortest, gap = 0, math.inf, math.inf
    for row in range(candidates):
        # Driving a word takes longer than making it, so only words shorter than the best are
        # driven.
        total = total_length(all_lengths[row])
        if total < shortest:
            missed = _gap(all_steering[row], all_lengths[row], (x, y, phi))
            if missed <= MAX_GAP:
                best, shortest, gap = row, total, missed
    count = 0
    for rank in range(candidates + 1):
        row = best if rank == 0 else rank - 1
        if rank > 0 and (row == best or total_length(all_lengths[row]) > shortest + tie):
            continue
        if rank > 0 and _gap(all_steering[row], all_lengths[row], (x, y, phi)) > MAX_GAP:
            continue
        for k in range(5):
            steering[count, k], lengths[count, k] = all_steering[row, k], all_lengths[row, k]
        count += is_new(steering, lengths, count)
    return count, gap


@kernel
def total_length(lengths: Floats) -> float:
    """Return the length of a word, in turning radii."""
    total: float = (
        abs(lengths[0]) + abs(lengths[1]) + abs(lengths[2]) + abs(lengths[3]) + abs(lengths[4])
    )
    return total


@kernel
def advance(pose: Pose, turn: int, length: float) -> Pose:
    """Return the pose, in turning radii, after a segment."""
    x, y, yaw = pose
    if turn == 0:
        return x + length * math.cos(yaw), y + length * math.sin(yaw), yaw
    after = yaw + turn * length
    return (
        x + turn * (math.sin(after) - math.sin(yaw)),
        y + turn * (math.cos(yaw) - math.cos(after)),
        after,
    )


@allocating
def _around(angle: float) -> float:
    """Wrap an angle into [-pi, pi)."""
    return angle - TWO_PI * math.floor((angle + math.pi) / TWO_PI)


@allocating
def _forward_arc(angle: float, snap: float) -> float:
    """Wrap an arc into [0, 2 pi).

    Arcs within ``snap`` below 2 pi become 0.
    """
    angle -= TWO_PI * math.floor(angle / TWO_PI)
    return 0.0 if angle > TWO_PI - snap else angle


@kernel
def _gap(steering: Ints, lengths: Floats, goal: Pose) -> float:
    """Return a word's gap, the larger of distance and angle."""
    pose = (0.0, 0.0, 0.0)
    for k in range(5):
        if lengths[k] != 0.0:
            pose = advance(pose, steering[k], lengths[k])
    missed: float = max(
        math.hypot(pose[0] - goal[0], pose[1] - goal[1]), abs(_around(pose[2] - goal[2]))
    )
    return missed


@kernel
def is_new(steering: Ints, lengths: Floats, count: int) -> int:
    """Return 1 if row ``count`` differs from all earlier words."""
    for row in range(count):
        difference = 0.0
        for k in range(5):
            same = (
                steering[row, k] == steering[count, k]
                or max(abs(lengths[row, k]), abs(lengths[count, k])) < 1e-12
            )
            difference = max(
                difference, abs(lengths[row, k] - lengths[count, k]) if same else math.inf
            )
        if difference <= 1e-12:
            return 0
    return 1


@kernel
def _write_candidates(kind: int, goal: Pose, steering: Ints, lengths: Floats) -> int:
    """Write all candidate words from the origin; return their number."""
    x, y, phi = goal
    count = 0
    for symmetry in range(4):
        mirror, sign = 1 - 2 * (symmetry // 2), 1 - 2 * (symmetry % 2)
        if kind == DUBINS and sign < 0:
            continue
        u, v, angle = sign * x, mirror * y, sign * mirror * phi
        c, s = math.cos(angle), math.sin(angle)
        back_u, back_v = u * c + v * s, u * s - v * c
        for form in range(WORD_FORMS):
            if kind == DUBINS and form > 3:
                break
            word = _solve_form(form, u, v, angle)
            if kind == DUBINS:
                for snap in (SNAP_RADIANS, 0.0):  # arcs just below 2 pi are tried as 0 and as given
                    _write_word(word, -1, mirror, sign, steering[count], lengths[count])
                    _wrap_arcs(form, snap, lengths[count])
                    count += 1
                continue
            _write_word(word, -1, mirror, sign, steering[count], lengths[count])
            count += 1
            if form in (3, 6, 7):  # the others are the same from the end to the start
                word = _solve_form(form, back_u, back_v, angle)
                last = 2 if form == 3 else 3
                _write_word(word, last, mirror, sign, steering[count], lengths[count])
                count += 1
    return count


@kernel
def _write_word(
    word: tuple[Steering, Lengths],
    last: int,
    mirror: int,
    sign: int,
    steering: Ints,
    lengths: Floats,
) -> None:
    """Write a word with its segments up to ``last`` in reverse order; none if ``last`` is -1."""
    for k in range(5):
        source = last - k if k <= last else k
        steering[k] = mirror * word[0][source]
        lengths[k] = sign * word[1][source]


@kernel
def _wrap_arcs(form: int, snap: float, lengths: Floats) -> None:
    """Wrap the arcs of a word, so that they are driven forwards."""
    for k in range(5):
        if k != 1 or form == 3:
            lengths[k] = _forward_arc(lengths[k], snap)


@kernel
def _tau_omega(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    """Return outer arcs of four-arc words (Reeds and Shepp)."""
    delta = _around(u - v)
    a, b = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    t = math.atan2(eta * a - xi * b, xi * a + eta * b)
    if 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0:
        t += math.pi
    t = _around(t)
    return t, _around(t - u + v - phi)


@kernel
def _solve_form(form: int, x: float, y: float, phi: float) -> tuple[Steering, Lengths]:
    """Return a form's word to (x, y, phi); zeros if unreachable."""
    if form == 0:
        return (1, 0, 0, 0, 0), (phi, 0.0, 0.0, 0.0, 0.0)
    # Center of the last circle, which turns left or right, relative to the center of the first
    # circle.
    left = form in (1, 3, 6)
    xi = x - math.sin(phi) if left else x + math.sin(phi)
    eta = y - 1.0 + math.cos(phi) if left else y - 1.0 - math.cos(phi)
    if form <= 3:
        return _solve_three_segments(form, xi, eta, phi)
    if form <= 5:
        return _solve_four_arcs(form, xi, eta, phi)
    return _solve_with_quarter_turn(form, xi, eta, phi)


@kernel
def _solve_three_segments(form: int, xi: float, eta: float, phi: float) -> tuple[Steering, Lengths]:
    """Return a word of two arcs with a straight or an arc between; zeros if unreachable."""
    apart, bearing = math.hypot(xi, eta), math.atan2(eta, xi)
    if form == 1:
        return (1, 0, 1, 0, 0), (bearing, apart, _around(phi - bearing), 0.0, 0.0)
    if form == 2 and apart >= 2.0 - TOUCH_TOLERANCE:
        u = math.sqrt(max(apart * apart - 4.0, 0.0))
        t = _around(bearing + math.atan2(2.0, u))
        return (1, 0, -1, 0, 0), (t, u, _around(t - phi), 0.0, 0.0)
    if form == 3 and apart <= 4.0 + TOUCH_TOLERANCE:
        u = -2.0 * math.asin(min(0.25 * apart, 1.0))
        t = _around(bearing + 0.5 * u + math.pi)
        return (1, -1, 1, 0, 0), (t, u, _around(phi - t + u), 0.0, 0.0)
    return (0, 0, 0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def _solve_four_arcs(form: int, xi: float, eta: float, phi: float) -> tuple[Steering, Lengths]:
    """Return a word of four arcs, the inner two of equal length; zeros if unreachable."""
    apart = math.hypot(xi, eta)
    if form == 4 and apart <= 2.0 + TOUCH_TOLERANCE:
        u = math.acos(min(0.25 * (2.0 + apart), 1.0))
        t, v = _tau_omega(u, -u, xi, eta, phi)
        return (1, -1, 1, -1, 0), (t, u, -u, v, 0.0)
    if form == 5 and 2.0 - TOUCH_TOLERANCE <= apart <= math.sqrt(20.0):
        u = -math.acos(min((20.0 - apart * apart) / 16.0, 1.0))
        t, v = _tau_omega(u, u, xi, eta, phi)
        return (1, -1, 1, -1, 0), (t, u, u, v, 0.0)
    return (0, 0, 0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def _solve_with_quarter_turn(
    form: int, xi: float, eta: float, phi: float
) -> tuple[Steering, Lengths]:
    """Return a word with an arc of a quarter turn beside a straight; zeros if unreachable."""
    half, apart = 0.5 * math.pi, math.hypot(xi, eta)
    if apart < 2.0 - TOUCH_TOLERANCE:
        return (0, 0, 0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0)
    if form == 7:
        t = math.atan2(xi, -eta)
        return (1, -1, 0, -1, 0), (t, -half, 2.0 - apart, _around(t + half - phi), 0.0)
    straight = math.sqrt(max(apart * apart - 4.0, 0.0))
    if form == 6:
        t = _around(math.atan2(eta, xi) + math.atan2(straight, -2.0))
        return (1, -1, 0, 1, 0), (t, -half, 2.0 - straight, _around(phi - half - t), 0.0)
    u = 4.0 - straight
    t = _around(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
    return (1, -1, 0, 1, -1), (t, -half, u, -half, _around(t - phi))


@allocating
def curve_lengths(kind: int, radius: float, starts: Floats, ends: Floats) -> Floats:
    """Return the metres of the shortest curves between rows of configurations."""
    metres = np.empty(len(starts))
    for k in range(len(starts)):
        first, last = (
            (starts[k, 0], starts[k, 1], starts[k, 2]),
            (ends[k, 0], ends[k, 1], ends[k, 2]),
        )
        metres[k] = radius * total_length(shortest_word(kind, radius, first, last)[1])
    return metres
