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
from typing import NamedTuple

import numpy as np

from cspace.inside import (
    Floats,
    Geometry,
    Ints,
    Map,
    Row,
    allocating,
    internal,
    kernel,
    poses_are_free,
)
from planners._edges.integrals import MAX_RADIANS_PER_STEP, CostDensity, Numbers, Values, cost_at

Pose = tuple[float, float, float]
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

MAX_UNPROVEN = 10_000
"""Pieces of a curve that fail before it counts as not proven, because it grazes an obstacle."""

TOUCH_TOLERANCE = 1e-7
"""Largest distance, in turning radii, between the circles of two adjoining arcs, which touch but
for rounding."""

TOUCHING = 2.0 - TOUCH_TOLERANCE
"""Smallest distance between the centers of two circles, in turning radii, that do not overlap."""


ROUNDING_LENGTH = 1e-9
"""Length, in turning radii, up to which a segment of a curve is only a rounding error."""


class Curves(NamedTuple):
    """The curves that a car can drive, and what they cost."""

    kind: int
    radius: float  # turning radius, metres
    reverse_cost: float  # of a metre in reverse, in metres ahead
    switch_cost: float  # of a change of direction, turning radii


class Form(NamedTuple):
    """A form of words; :func:`solve_form` gives the lengths of the segments.

    The circles of the first and last arc have centers ``closest`` to ``farthest`` apart, in turning
    radii.
    """

    steering: tuple[int, int, int, int, int]
    segments: int
    closest: float
    farthest: float
    has_way_back: bool  # whether it differs from its way back, from the end to the start


FORMS = (
    Form((1, 0, 0, 0, 0), 1, 0.0, math.inf, False),
    Form((1, 0, 1, 0, 0), 3, 0.0, math.inf, False),
    Form((1, 0, -1, 0, 0), 3, TOUCHING, math.inf, False),
    Form((1, -1, 1, 0, 0), 3, 0.0, 4.0 + TOUCH_TOLERANCE, True),
    Form((1, -1, 1, -1, 0), 4, 0.0, 2.0 + TOUCH_TOLERANCE, False),
    Form((1, -1, 1, -1, 0), 4, TOUCHING, math.sqrt(20.0), False),
    Form((1, -1, 0, 1, 0), 4, TOUCHING, math.inf, True),
    Form((1, -1, 0, -1, 0), 4, TOUCHING, math.inf, True),
    Form((1, -1, 0, 1, -1), 5, TOUCHING, math.inf, False),
)
STEERING = np.array([form.steering for form in FORMS])
SEGMENTS = np.array([form.segments for form in FORMS])
CLOSEST = np.array([form.closest for form in FORMS])
FARTHEST = np.array([form.farthest for form in FORMS])
HAS_WAY_BACK = np.array([form.has_way_back for form in FORMS])

DUBINS_FORMS = 4
"""Number of forms, the first ones, that a car without reverse can drive."""

MAX_SEGMENTS = 5
"""Segments of a word; unused ones have no length."""

MAX_WORDS = 80
"""Words to one goal: nine forms, mirrored and reversed, and three of them backwards, as (9 + 3) *
4; with costs also four forms of Dubins, mirrored and reversed, in two ways."""

TIE_TOLERANCE = 1e-6
"""Largest difference in length, in turning radii, between curves that count as equally short."""

EQUAL_LENGTHS = 1e-12
"""Largest difference, in turning radii, between the lengths of equal segments."""

POINT_ERROR = 1e-9
"""Allowance for the rounding of a curve's points, in turning radii and in radians."""

MAX_PIECE_CELLS = 4.0
"""Length of the longest piece of a curve that is proven at once, in cells."""

MIN_PIECE_CELLS = 1.0 / 16.0
"""Length of the shortest piece of a curve that is proven at once, in cells."""


class Words(NamedTuple):
    """The shortest words to a goal; the arrays have room for twice ``MAX_WORDS``."""

    steering: Ints  # (2 * MAX_WORDS, 5)
    lengths: Floats  # (2 * MAX_WORDS, 5), turning radii
    number: int  # of words
    gap: float  # of the shortest word
    shortest: float  # length of the shortest word with its costs, turning radii


@allocating
def prove_length(
    map_: Map,
    curves: Curves,
    geometry: Geometry,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
) -> float:
    """Prove a shortest curve free; return its metres with costs, or -1.

    A curve is proven if it lies in FREE cells of the grid. With a geometry, the boundaries of robot
    and obstacles may also stay apart; then the curve is free if its start is. If the lengths of
    several curves differ by at most ``TIE_TOLERANCE``, all must be proven, because the robot may
    drive any one.
    """
    radius = curves.radius
    start = (x0, y0, yaw0)
    goal = (x1, y1, yaw1)
    words = find_shortest_words(curves, start, goal, TIE_TOLERANCE)
    if not words.gap <= MAX_GAP:
        return -1.0
    # Most curves that fail do so before those of the way back are computed.
    reach = 1.0 + words.shortest + TIE_TOLERANCE
    spare = words.gap * reach + POINT_ERROR
    if not words_are_free(map_, geometry, radius, start, goal, words, 1, spare):
        return -1.0
    count = words.number
    if curves.kind == REEDS_SHEPP and not has_costs(curves):
        # OMPL, which takes no costs, may compute its curve from the goal, and rounding can prefer
        # another of the tied curves. Driven back, such a curve has its segments in reverse order
        # and direction.
        back = find_shortest_words(curves, goal, start, TIE_TOLERANCE)
        for row in range(back.number):
            for k in range(MAX_SEGMENTS):
                words.steering[count, k] = back.steering[row, MAX_SEGMENTS - 1 - k]
                words.lengths[count, k] = -back.lengths[row, MAX_SEGMENTS - 1 - k]
            count += is_new(words.steering, words.lengths, count)
    spare = MAX_GAP * reach + POINT_ERROR
    if count > 1 and not words_are_free(map_, geometry, radius, start, goal, words, count, spare):
        return -1.0
    return radius * words.shortest


@kernel
def words_are_free(
    map_: Map,
    geometry: Geometry,
    radius: float,
    start: Pose,
    goal: Pose,
    words: Words,
    count: int,
    spare: float,
) -> bool:
    """Prove the first words free, segment by segment.

    The driven curve stays within ``spare`` of ours, turning radii, however the gap spreads along it
    and from whichever end it starts.
    """
    for end in (start, goal):
        if not piece_is_free(map_, geometry, radius, end, 0.0, 0.0, spare):
            return False
    for row in range(count):
        pose = (0.0, 0.0, start[2])
        for k in range(MAX_SEGMENTS):
            steer = words.steering[row, k]
            length = words.lengths[row, k]
            if not segment_is_free(map_, geometry, radius, start, pose, steer, length, spare):
                return False
            pose = advance(pose, steer, length)
    return True


@allocating
def curve_cost(
    map_: Map,
    field: Values,
    density: CostDensity,
    curves: Curves,
    numbers: Numbers,
) -> float:
    """Integrate the cost along the shortest curve.

    The last six ``numbers`` are (x, y, yaw) of both
    ends. The midpoint rule has steps of at most one cell and 5 degrees.
    """
    radius = curves.radius
    x0, y0, yaw0, x1, y1, yaw1 = numbers[-6:]
    words = find_shortest_words(curves, (x0, y0, yaw0), (x1, y1, yaw1), 0.0)
    # Poses are in turning radii from the start; row 0 has the shortest word.
    pose = (0.0, 0.0, yaw0)
    total = radius * curves.switch_cost * count_switches(words.lengths, 0)
    for k in range(MAX_SEGMENTS):
        steer = words.steering[0, k]
        length = words.lengths[0, k]
        metres = radius * abs(length)
        price = curves.reverse_cost if length < 0.0 else 1.0
        longest_step = map_.spacing
        if steer != 0:
            longest_step = min(map_.spacing, MAX_RADIANS_PER_STEP * radius)
        steps = math.ceil(metres / longest_step)
        # Sum the cost at the middle of each step.
        for step in range(steps):
            u, v, yaw = advance(pose, steer, length * (step + 0.5) / steps)
            position = position_in_plane(map_, x0 + radius * u, y0 + radius * v)
            cost = cost_at(map_, field, density, position, (yaw,))
            total += price * cost * metres / steps
        pose = advance(pose, steer, length)
    return total


@internal
def piece_is_free(
    map_: Map,
    geometry: Geometry,
    radius: float,
    center: Pose,
    half: float,
    turn: float,
    spare: float,
) -> bool:
    """Return True if a piece and ``spare`` are free.

    From its center, the piece of a segment extends by ``half`` to both sides, in turning radii, and
    turns by ``turn``.
    """
    # An arc of an angle a leaves its tangent by at most a^2 / 2 turning radii.
    drift = radius * (0.5 * turn * turn + spare)
    reach = (half + spare) * radius
    return poses_are_free(map_, geometry, center, reach, radius * half, drift, turn + spare)


@internal
def position_in_plane(map_: Map, x: float, y: float) -> Row:
    """Return a position of the plane in the middle of the layer."""
    return 0.5 * map_.spacing, x, y


@internal
def segment_is_free(
    map_: Map,
    geometry: Geometry,
    radius: float,
    origin: Pose,
    begin: Pose,
    steer: int,
    length: float,
    spare: float,
) -> bool:
    """Return True if a segment and ``spare`` are free.

    It starts at ``begin``, in turning radii from the position of ``origin``. A piece of length l
    lies within l / 2 of its center and turns by at most l / (2 radius) from there. If that is not
    proven free, the piece is halved, until its center is not free or the piece is too short.
    """
    # Lengths are in turning radii, in which an arc is as long as its angle.
    longest = MAX_PIECE_CELLS * map_.spacing / radius
    shortest = MIN_PIECE_CELLS * map_.spacing / radius
    if geometry is not None:
        shortest = POINT_ERROR
    total = abs(length)
    sign = math.copysign(1.0, length)
    proven = 0.0
    step = longest
    unproven = 0
    while proven < total:
        rest = total - proven
        is_last = step >= rest
        piece = min(step, rest)
        half = 0.5 * piece
        turn = half if steer != 0 else 0.0
        u, v, yaw = advance(begin, steer, sign * (proven + half))
        center = (origin[0] + radius * u, origin[1] + radius * v, yaw)
        if piece_is_free(map_, geometry, radius, center, half, turn, spare):
            # Go on with a longer piece.
            if is_last:
                return True
            proven += piece
            step = min(2.0 * step, longest)
            continue
        unproven += 1
        is_too_near = piece <= shortest or unproven == MAX_UNPROVEN
        if is_too_near or not piece_is_free(map_, geometry, radius, center, 0.0, 0.0, spare):
            return False
        step = half
    return True


@allocating
def find_shortest_words(curves: Curves, q0: Pose, q1: Pose, tie: float) -> Words:
    """Find the shortest words between two configurations.

    Lengths include the costs of curves. The shortest word comes first, then all words longer by at
    most ``tie``, without duplicates. Each word is driven and counts only if it reaches the goal, so
    that no form needs a separate proof.
    """
    # The goal as seen from the start, in turning radii.
    x0, y0, yaw0 = q0
    x1, y1, yaw1 = q1
    dx = (x1 - x0) / curves.radius
    dy = (y1 - y0) / curves.radius
    cos = math.cos(yaw0)
    sin = math.sin(yaw0)
    goal = (dx * cos + dy * sin, dy * cos - dx * sin, yaw1 - yaw0)
    all_steering = np.zeros((MAX_WORDS, MAX_SEGMENTS), np.int64)
    all_lengths = np.zeros((MAX_WORDS, MAX_SEGMENTS))
    candidates = write_candidates(curves, curves.kind, goal, all_steering, all_lengths, 0)
    if has_costs(curves):
        # These keep one direction on arcs of more than half a turn, which would be shorter in the
        # other one.
        candidates = write_candidates(curves, DUBINS, goal, all_steering, all_lengths, candidates)
    totals = np.empty(candidates)  # of the words that reach the goal and may be shortest
    best = 0
    shortest = math.inf
    shortest_gap = math.inf
    for row in range(candidates):
        totals[row] = math.inf
        total = curves.switch_cost * count_switches(all_lengths, row)
        for k in range(MAX_SEGMENTS):
            length = all_lengths[row, k]
            total += abs(length) * (curves.reverse_cost if length < 0.0 else 1.0)
        # Driving a word takes longer than making it, so only the shortest ones are driven.
        if not total <= shortest + tie:
            continue
        gap = measure_gap(goal, all_steering, all_lengths, row)
        if gap <= MAX_GAP:
            totals[row] = total
            if total < shortest:
                best = row
                shortest = total
                shortest_gap = gap
    # Copy the shortest word, then all other tied words.
    steering = np.zeros((2 * MAX_WORDS, MAX_SEGMENTS), np.int64)
    lengths = np.zeros((2 * MAX_WORDS, MAX_SEGMENTS))
    for k in range(MAX_SEGMENTS):
        steering[0, k] = all_steering[best, k]
        lengths[0, k] = all_lengths[best, k]
    count = int(shortest < math.inf)
    for row in range(candidates):
        if count > 0 and totals[row] <= shortest + tie:
            for k in range(MAX_SEGMENTS):
                steering[count, k] = all_steering[row, k]
                lengths[count, k] = all_lengths[row, k]
            count += is_new(steering, lengths, count)
    return Words(steering, lengths, count, shortest_gap, shortest)


@internal
def has_costs(curves: Curves) -> bool:
    """Return True if a curve may cost more than its length."""
    return curves.reverse_cost != 1.0 or curves.switch_cost > 0.0


@internal
def count_switches(lengths: Floats, row: int) -> int:
    """Count the changes of direction along a word."""
    count = 0
    last = 0.0
    for k in range(MAX_SEGMENTS):
        length = lengths[row, k]
        if abs(length) > ROUNDING_LENGTH:
            count += last * length < 0.0
            last = length
    return count


@internal
def measure_gap(goal: Pose, steering: Ints, lengths: Floats, row: int) -> float:
    """Return the gap of a word from the origin.

    The gap is the larger of the distance, in turning radii, and the angle, in radians.
    """
    pose = (0.0, 0.0, 0.0)
    for k in range(MAX_SEGMENTS):
        pose = advance(pose, steering[row, k], lengths[row, k])
    x, y, yaw = pose
    goal_x, goal_y, goal_yaw = goal
    turn = yaw - goal_yaw
    turn -= math.tau * math.floor((turn + math.pi) / math.tau)
    return max(math.hypot(x - goal_x, y - goal_y), abs(turn))


@kernel
def advance(pose: Pose, steer: int, length: float) -> Pose:
    """Return the pose, in radii, after driving a segment."""
    x, y, yaw = pose
    if steer == 0:
        return x + length * math.cos(yaw), y + length * math.sin(yaw), yaw
    yaw_after = yaw + steer * length
    x_after = x + steer * (math.sin(yaw_after) - math.sin(yaw))
    y_after = y + steer * (math.cos(yaw) - math.cos(yaw_after))
    return x_after, y_after, yaw_after


@internal
def is_new(steering: Ints, lengths: Floats, count: int) -> int:
    """Return 1 if word ``count`` differs from all earlier ones, or 0.

    The steering of a segment without length makes no difference.
    """
    for row in range(count):
        is_equal = True
        for k in range(MAX_SEGMENTS):
            known = lengths[row, k]
            length = lengths[count, k]
            is_empty = max(abs(known), abs(length)) < EQUAL_LENGTHS
            steers_alike = is_empty or steering[row, k] == steering[count, k]
            is_equal = is_equal and steers_alike and abs(known - length) <= EQUAL_LENGTHS
        if is_equal:
            return 0
    return 1


@internal
def write_candidates(
    curves: Curves, kind: int, goal: Pose, steering: Ints, lengths: Floats, count: int
) -> int:
    """Write candidate words from the origin after ``count`` others; return their number.

    Each form gives words by symmetry: mirrored (left for right), reversed (ahead for back) and
    backwards (from the end to the start). Words of Dubins are not backwards, and reversed only if
    the car reverses; their arcs just below 2 pi are tried as 0 and as given.
    """
    forms = DUBINS_FORMS if kind == DUBINS else len(SEGMENTS)
    for mirror in (1, -1):
        for sign in (1, -1):
            if curves.kind == DUBINS and sign < 0:
                continue
            # The goal of the word that, mirrored or reversed, reaches the given goal.
            x = sign * goal[0]
            y = mirror * goal[1]
            phi = sign * mirror * goal[2]
            # The start, seen from the goal by a car that drives to it backwards.
            back_x = x * math.cos(phi) + y * math.sin(phi)
            back_y = x * math.sin(phi) - y * math.cos(phi)
            for form in range(forms):
                arcs = solve_form(form, x, y, phi)
                # The second word goes backwards; for Dubins it has other arcs just below 2 pi.
                for is_first in (True, False):
                    if kind == REEDS_SHEPP and not is_first:
                        if not HAS_WAY_BACK[form]:
                            continue
                        arcs = solve_form(form, back_x, back_y, phi)
                    write_word(kind, form, arcs, mirror, sign, is_first, steering, lengths, count)
                    count += 1
    return count


@internal
def write_word(
    kind: int,
    form: int,
    arcs: Lengths,
    mirror: int,
    sign: int,
    is_first: bool,
    steering: Ints,
    lengths: Floats,
    row: int,
) -> None:
    """Write a mirrored or reversed word to a row.

    Arcs are wrapped into [-pi, pi), or for Dubins into [0, 2 pi). The second word of a form goes
    backwards for Reeds-Shepp, so its segments are in reverse order. For Dubins, it keeps the arcs
    just below 2 pi, which are 0 in the first word.
    """
    segments = SEGMENTS[form]
    goes_back = kind == REEDS_SHEPP and not is_first
    lowest = -math.pi if kind == REEDS_SHEPP else 0.0
    for k in range(MAX_SEGMENTS):
        source = k
        if goes_back and k < segments:
            source = segments - 1 - k
        steer = STEERING[form, source]
        length = arcs[source]
        # A straight segment has one length, an arc is the same after a whole turn.
        if steer != 0:
            length -= math.tau * math.floor((length - lowest) / math.tau)
            if kind == DUBINS and is_first and length > math.tau - SNAP_RADIANS:
                length = 0.0
        steering[row, k] = mirror * steer
        lengths[row, k] = sign * length


@internal
def solve_form(form: int, x: float, y: float, phi: float) -> Lengths:
    """Return the segments' lengths of a form's word, or zeros.

    The word leads from the origin to (x, y, phi). Arcs are not wrapped. Source of the forms 3 to 8:
    Reeds and Shepp (1990), section 8, whose names t, u and v stand for the lengths of the first,
    second and third segment.
    """
    unreachable = (0.0, 0.0, 0.0, 0.0, 0.0)
    quarter = 0.5 * math.pi
    if form == 0:
        return (phi, 0.0, 0.0, 0.0, 0.0)
    # Center of the last circle relative to the center of the first circle.
    side = STEERING[form, SEGMENTS[form] - 1]
    xi = x - side * math.sin(phi)
    eta = y - 1.0 + side * math.cos(phi)
    apart = math.hypot(xi, eta)
    bearing = math.atan2(eta, xi)
    if not CLOSEST[form] <= apart <= FARTHEST[form]:
        return unreachable
    straight = math.sqrt(max(apart * apart - 4.0, 0.0))  # the tangent between the two circles
    if form == 1:
        return (bearing, apart, phi - bearing, 0.0, 0.0)
    if form == 2:
        t = bearing + math.atan2(2.0, straight)
        return (t, straight, t - phi, 0.0, 0.0)
    if form == 3:
        u = -2.0 * math.asin(min(0.25 * apart, 1.0))
        t = bearing + 0.5 * u + math.pi
        return (t, u, phi - t + u, 0.0, 0.0)
    if form <= 5:
        u = math.acos(min(0.25 * (2.0 + apart), 1.0))
        if form == 5:
            u = -math.acos(min((20.0 - apart * apart) / 16.0, 1.0))
        v = -u if form == 4 else u
        a = math.sin(u) - math.sin(u - v)
        b = math.cos(u) - math.cos(u - v) - 1.0
        t = math.atan2(eta * a - xi * b, xi * a + eta * b)
        if 2.0 * (math.cos(u - v) - math.cos(v) - math.cos(u)) + 3.0 < 0.0:
            t += math.pi
        return (t, u, v, t - u + v - phi, 0.0)
    if form == 6:
        t = bearing + math.atan2(straight, -2.0)
        return (t, -quarter, 2.0 - straight, phi - quarter - t, 0.0)
    if form == 7:
        t = math.atan2(xi, -eta)
        return (t, -quarter, 2.0 - apart, t + quarter - phi, 0.0)
    u = 4.0 - straight
    t = math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta)
    return (t, -quarter, u, -quarter, t - phi)
