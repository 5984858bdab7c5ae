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

from cspace.queries.points import around_is_free, position_in_plane
from cspace.record.cells import Map
from cspace.rotations.base import TWO_PI
from cspace.support.arrays import Floats, Ints, Numbers
from cspace.support.compiling import allocating, kernel
from planners.integrals import MAX_RADIANS_PER_STEP, CostDensity, Values, cost_at

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

TOUCH_TOLERANCE = 1e-7
"""Largest distance, in turning radii, between the circles of two adjoining arcs, which touch but
for rounding."""

TOUCHING = 2.0 - TOUCH_TOLERANCE
"""Smallest distance between the centers of two circles, in turning radii, that do not overlap."""

FORMS = (
    # steering of the segments, number of segments, smallest and largest distance of the circles
    ((1, 0, 0, 0, 0), 1, 0.0, math.inf),
    ((1, 0, 1, 0, 0), 3, 0.0, math.inf),
    ((1, 0, -1, 0, 0), 3, TOUCHING, math.inf),
    ((1, -1, 1, 0, 0), 3, 0.0, 4.0 + TOUCH_TOLERANCE),
    ((1, -1, 1, -1, 0), 4, 0.0, 2.0 + TOUCH_TOLERANCE),
    ((1, -1, 1, -1, 0), 4, TOUCHING, math.sqrt(20.0)),
    ((1, -1, 0, 1, 0), 4, TOUCHING, math.inf),
    ((1, -1, 0, -1, 0), 4, TOUCHING, math.inf),
    ((1, -1, 0, 1, -1), 5, TOUCHING, math.inf),
)
"""Forms of words: the lengths of their segments are those of :func:`solve_form`. The circles are
those of the first and of the last arc; the distance of their centers is in turning radii."""

STEERING = np.array([steering for steering, *_ in FORMS])
SEGMENTS = np.array([number for _, number, *_ in FORMS])
CLOSEST = np.array([closest for *_, closest, _ in FORMS])
FARTHEST = np.array([farthest for *_, farthest in FORMS])

DUBINS_FORMS = 4
"""Number of forms, the first ones, that a car without reverse can drive."""

HAS_WAY_BACK = np.array([False, False, False, True, False, False, True, True, False])
"""Whether each form differs from its way back, from the end to the start."""

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
    steering, lengths, count, gap, shortest = find_shortest_words(
        kind, radius, q0, q1, TIE_TOLERANCE
    )
    if not gap <= MAX_GAP:
        return -1.0
    if kind == REEDS_SHEPP:
        # OMPL may compute its curve from the other end, where rounding can prefer another of the
        # tied curves.
        back_steering, back_lengths, back_count, _, _ = find_shortest_words(
            kind, radius, q1, q0, TIE_TOLERANCE
        )
        for row in range(back_count):
            steering[count] = back_steering[row, ::-1]
            lengths[count] = -back_lengths[row, ::-1]
            count += is_new(steering, lengths, count)
    # The driven curve stays this close to ours, however the gap spreads along it and from whichever
    # end it starts.
    spare = (gap if count == 1 else MAX_GAP) * (1.0 + shortest + TIE_TOLERANCE) + POINT_ERROR
    for end in (q0, q1):
        if not pose_is_free(map_, end, spare * radius, spare):
            return -1.0
    for row in range(count):
        pose = (0.0, 0.0, yaw0)
        for k in range(5):
            steer = steering[row, k]
            length = lengths[row, k]
            if not segment_is_free(map_, radius, q0, pose, steer, length, spare):
                return -1.0
            pose = advance(pose, steer, length)
    return radius * shortest


@allocating
def curve_cost(
    map_: Map,
    field: Values,
    density: CostDensity,
    curve: tuple[int, float],
    both: Numbers,
) -> float:
    """Integrate the cost along the shortest curve between ``both`` configurations.

    They are numbers after zeros, as of :func:`integrate_straight_edge`. The midpoint rule has steps
    of at most one cell and 5 degrees.
    """
    kind, radius = curve
    x0, y0, yaw0, x1, y1, yaw1 = both[-6:]
    q0, q1 = (x0, y0, yaw0), (x1, y1, yaw1)
    steering, lengths, _, _, _ = find_shortest_words(kind, radius, q0, q1, 0.0)
    pose = (0.0, 0.0, yaw0)
    total = 0.0
    for k in range(5):
        steer = steering[0, k]
        length = lengths[0, k]
        longest = map_.spacing
        if steer != 0:
            longest = min(map_.spacing, MAX_RADIANS_PER_STEP * radius)
        steps = math.ceil(radius * abs(length) / longest)
        for step in range(steps):
            u, v, yaw = advance(pose, steer, length * (step + 0.5) / steps)
            position = position_in_plane(map_, x0 + radius * u, y0 + radius * v)
            cost = cost_at(map_, field, density, position, (yaw,))
            total += cost * radius * abs(length) / steps
        pose = advance(pose, steer, length)
    return total


@kernel
def pose_is_free(map_: Map, pose: Pose, distance: float, angle: float) -> bool:
    """Return True if all poses within ``distance`` and ``angle`` of another are proven free."""
    return around_is_free(
        map_, position_in_plane(map_, pose[0], pose[1]), (pose[2],), distance, angle
    )


@kernel
def segment_is_free(
    map_: Map, radius: float, q0: Pose, begin: Pose, steer: int, length: float, spare: float
) -> bool:
    """Return True if a segment lies in FREE cells, with all within ``spare`` except its ends.

    It starts at ``begin``, in turning radii from the position of ``q0``. A piece of length l lies
    within l / 2 of its center and turns by at most l / (2 radius) from there. So a box of that size
    around the center contains it. If the box is not free, the piece is halved, until its center is
    not free or the piece is shorter than ``MIN_PIECE_CELLS``.
    """
    longest = MAX_PIECE_CELLS * map_.spacing / radius
    shortest = MIN_PIECE_CELLS * map_.spacing / radius
    total = abs(length)
    sign = math.copysign(1.0, length)
    done = 0.0
    step = longest
    while done < total:
        last = step >= total - done
        piece = total - done if last else step
        half = 0.5 * piece
        turned = half if steer != 0 else 0.0
        u, v, yaw = advance(begin, steer, sign * (done + half))
        center = (q0[0] + radius * u, q0[1] + radius * v, yaw)
        if pose_is_free(map_, center, (half + spare) * radius, turned + spare):
            if last:
                return True
            done = done + piece
            step = min(2.0 * step, longest)
        elif piece <= shortest or not pose_is_free(map_, center, spare * radius, spare):
            return False
        else:
            step = half
    return True


def shortest_word(kind: int, radius: float, q0: Pose, q1: Pose) -> tuple[Ints, Floats, float]:
    """Return the shortest word's steering, lengths and gap."""
    steering, lengths, _, gap, _ = find_shortest_words(kind, radius, q0, q1, 0.0)
    return steering[0], lengths[0], gap


@allocating
def find_shortest_words(
    kind: int, radius: float, q0: Pose, q1: Pose, tie: float
) -> tuple[Ints, Floats, int, float, float]:
    """Find the shortest words between two configurations.

    The shortest one comes first, then all words longer by at most ``tie``; none is given twice.
    Each word is driven and counts only if it reaches the goal, so that no form needs a separate
    proof.

    Returns the words' steering and lengths, with room for as many again, the number of words, the
    gap of the shortest, and its length in turning radii.
    """
    dx, dy = (q1[0] - q0[0]) / radius, (q1[1] - q0[1]) / radius
    c, s = math.cos(q0[2]), math.sin(q0[2])
    goal = (dx * c + dy * s, dy * c - dx * s, q1[2] - q0[2])
    made_steering = np.zeros((MAX_WORDS, 5), np.int64)
    made_lengths = np.zeros((MAX_WORDS, 5))
    candidates = write_candidates(kind, goal, made_steering, made_lengths)
    totals = np.full(candidates, np.inf)  # of the words that reach the goal and may be shortest
    best = 0
    shortest = math.inf
    shortest_gap = math.inf
    for row in range(candidates):
        total = 0.0
        for k in range(5):
            total += abs(made_lengths[row, k])
        # Driving a word takes longer than making it, so only the shortest ones are driven.
        if not total <= shortest + tie:
            continue
        pose = (0.0, 0.0, 0.0)
        for k in range(5):
            pose = advance(pose, made_steering[row, k], made_lengths[row, k])
        turn = pose[2] - goal[2]
        turn -= TWO_PI * math.floor((turn + math.pi) / TWO_PI)
        gap = max(math.hypot(pose[0] - goal[0], pose[1] - goal[1]), abs(turn))
        if gap <= MAX_GAP:
            totals[row] = total
            if total < shortest:
                best = row
                shortest = total
                shortest_gap = gap
    steering = np.zeros((2 * MAX_WORDS, 5), np.int64)
    lengths = np.zeros((2 * MAX_WORDS, 5))
    count = 0
    if shortest == math.inf:
        return steering, lengths, count, shortest_gap, shortest
    for rank in range(-1, candidates):
        row = best if rank < 0 else rank
        if rank == best or totals[row] > shortest + tie:
            continue
        steering[count] = made_steering[row]
        lengths[count] = made_lengths[row]
        count += is_new(steering, lengths, count)
    return steering, lengths, count, shortest_gap, shortest


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
def write_candidates(kind: int, goal: Pose, steering: Ints, lengths: Floats) -> int:
    """Write all candidate words from the origin; return their number.

    Each form gives words by symmetry: mirrored (left for right), reversed (ahead for back) and
    backwards (from the end to the start). Words of Dubins are neither reversed nor backwards; their
    arcs just below 2 pi are tried as 0 and as given.
    """
    count = 0
    for symmetry in range(4):
        mirror = 1 - 2 * (symmetry // 2)
        sign = 1 - 2 * (symmetry % 2)
        if kind == DUBINS and sign < 0:
            continue
        x = sign * goal[0]
        y = mirror * goal[1]
        phi = sign * mirror * goal[2]
        c, s = math.cos(phi), math.sin(phi)
        for form in range(DUBINS_FORMS if kind == DUBINS else len(SEGMENTS)):
            arcs = solve_form(form, x, y, phi)
            for variant in range(2 if kind == DUBINS or HAS_WAY_BACK[form] else 1):
                way_back = variant == 1 and kind == REEDS_SHEPP
                if way_back:
                    arcs = solve_form(form, x * c + y * s, x * s - y * c, phi)
                for k in range(5):
                    source = SEGMENTS[form] - 1 - k if way_back and k < SEGMENTS[form] else k
                    steer = STEERING[form, source]
                    length = arcs[source]
                    if steer != 0:
                        length = wrap_arc(kind, length, variant == 0)
                    steering[count, k] = mirror * steer
                    lengths[count, k] = sign * length
                count += 1
    return count


@kernel
def wrap_arc(kind: int, length: float, snaps: bool) -> float:
    """Wrap an arc into [-pi, pi), or for Dubins into [0, 2 pi).

    If Dubins ``snaps``, an arc just below 2 pi becomes 0.
    """
    if kind == REEDS_SHEPP:
        return length - TWO_PI * math.floor((length + math.pi) / TWO_PI)
    length -= TWO_PI * math.floor(length / TWO_PI)
    return 0.0 if snaps and length > TWO_PI - SNAP_RADIANS else length


@kernel
def solve_form(form: int, x: float, y: float, phi: float) -> Lengths:
    """Return the lengths of a form's word to (x, y, phi); zeros if unreachable.

    Arcs are not wrapped. Source of the forms 3 to 8: Reeds and Shepp (1990), section 8.
    """
    nothing = (0.0, 0.0, 0.0, 0.0, 0.0)
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
        return nothing
    straight = math.sqrt(max(apart * apart - 4.0, 0.0))
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
