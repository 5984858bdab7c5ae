"""Compiled: the shortest curves of cars, as words, and the proof that one is free all along.

A *word* is a curve of at most five pieces: ``turns``, each 1 (left), -1 (right) or 0 (straight on), and ``lengths``, in
turning radii, below zero where the car reverses. Its *gap* says by how much the end of the word misses the
configuration that it is meant for, in turning radii and in radians: some 1e-15, or 1e-8 where a root was taken near
zero. Words are rows of two arrays, shapes (n, 5).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cspace.arrays import MIXED, Floats, Ints
from cspace.compiling import bind_kernel, jit, kernel
from cspace.map.points import around_is_free
from cspace.map.storage import Map
from cspace.rotations.base import TWO_PI
from cspace.space import CSpace
from planners.integrals import LONGEST_TURN, CostDensity, Field, cost_at

Pose = tuple[float, float, float]
Turns = tuple[int, int, int, int, int]
Lengths = tuple[float, float, float, float, float]

DUBINS = 0
REEDS_SHEPP = 1

GAP = 1e-6
"""Largest gap, in turning radii and in radians, of a word that counts. The proof covers it."""

SNAP = 1e-6
"""Arcs that are a whole turn but for that many radians are tried as none: that is how rounding makes loops."""

TOUCH = 1e-7
"""By how much circles may miss each other, in turning radii, where they should touch: they do between two arcs."""

FORMS = 9

MOST = 48
"""Words to one configuration: forms, mirrored, reversed, and three of them backwards."""


TIE = 1e-6
"""By how much curves may differ in length, in turning radii, to count as equally short."""

ROUNDING = 1e-9
"""Allowance for the rounding of a curve's points, in turning radii and in radians."""

LONGEST = 4.0
"""Longest piece of a curve that is proven at once, in cells."""

SHORTEST = 1.0 / 16.0
"""Shortest one."""


def prover(space: CSpace, kind: int, radius: float) -> Callable[..., float]:
    """:func:`proven_length` of the floats of two configurations."""
    map_ = space._kernel_map
    # A curve that leaves the grid is not proven, whatever is known out there.
    map_ = map_._replace(exterior=np.full_like(map_.exterior, MIXED))
    return bind_kernel(proven_length, (map_, kind, radius), 6)


def cost(space: CSpace, kind: int, radius: float, field: Field, law: CostDensity) -> Callable[..., float]:
    """:func:`curve_cost` of the floats of two configurations."""
    fixed = (space._kernel_map, field, law, (kind, radius))
    query = bind_kernel(curve_cost, (*fixed, (0.0,) * 6), 0).func  # type: ignore[attr-defined]
    return lambda *endpoints: query(*fixed, endpoints)


@jit
def proven_length(
    map_: Map, kind: int, radius: float, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float
) -> float:
    """Metres of the shortest curve where every configuration of it lies in FREE cells of the grid, otherwise -1.

    Where several curves are equally short but for ``TIE``, that holds for every one of them, whichever is driven.
    """
    q0, q1 = (x0, y0, yaw0), (x1, y1, yaw1)
    if swaps(kind, q0, q1):
        q0, q1 = q1, q0
    turns, lengths = np.zeros((2 * MOST, 5), np.int64), np.zeros((2 * MOST, 5))
    count, gap = tied_words(kind, radius, (q0, q1), TIE, turns, lengths)
    if not gap <= GAP:
        return -1.0
    shortest = total_length(lengths[0])
    if kind == REEDS_SHEPP:
        # OMPL may have found its curve from the other end, where rounding prefers another of those that tie.
        others, _ = tied_words(kind, radius, (q1, q0), TIE, turns[count:], lengths[count:])
        for row in range(count, count + others):
            for k in range(5):
                turns[count, k], lengths[count, k] = turns[row, k], lengths[row, k]
            reverse(turns[count], lengths[count])
            count += is_new(turns, lengths, count)
    # However the gap is spread along the curve, and whichever end it is drawn from, it stays this close.
    spare = (gap if count == 1 else GAP) * (1.0 + shortest + TIE) + ROUNDING
    for end in (q0, q1):
        if not around_is_free(map_, end, spare * radius, spare):
            return -1.0
    for row in range(count):
        if not _word_is_free(map_, radius, q0, turns[row], lengths[row], spare):
            return -1.0
    return radius * shortest


@jit
def curve_cost(map_: Map, field: Field, law: CostDensity, curve: tuple[int, float], both: tuple[float, ...]) -> float:
    """Cost of the shortest curve between two configurations, given one after the other in ``both``.

    The integral takes the middles of steps of at most one cell and 5 degrees.
    """
    (kind, radius), (x0, y0, yaw0, x1, y1, yaw1) = curve, both
    turns, lengths, _ = shortest(kind, radius, (x0, y0, yaw0), (x1, y1, yaw1))
    pose, total = (0.0, 0.0, yaw0), 0.0
    for k in range(5):
        length = lengths[k]
        longest = map_.spacing if turns[k] == 0 else min(map_.spacing, LONGEST_TURN * radius)
        steps = math.ceil(radius * abs(length) / longest)
        for number in range(steps):
            u, v, yaw = onwards(pose, turns[k], length * (number + 0.5) / steps)
            cost = cost_at(map_, field, law, (x0 + radius * u, y0 + radius * v, yaw))
            total += cost * radius * abs(length) / steps
        pose = onwards(pose, turns[k], length)
    return total


@kernel
def _word_is_free(map_: Map, radius: float, q0: Pose, turns: Ints, lengths: Floats, spare: float) -> bool:
    """Whether every configuration within ``spare`` of a word, but for its ends, lies in FREE cells of the grid.

    A piece of the curve of length l lies within l / 2 of its middle, and turns by at most l / (2 radius) from there; so
    a box of that size around the middle holds all of it. Where a box is not free, the piece is halved, until the middle
    itself is not free or the piece is a sixteenth of a cell.
    """
    longest, least = LONGEST * map_.spacing / radius, SHORTEST * map_.spacing / radius
    pose = (0.0, 0.0, q0[2])
    for k in range(5):
        total, sign, turn = abs(lengths[k]), math.copysign(1.0, lengths[k]), turns[k]
        done, step = 0.0, longest
        while done < total:
            last = step >= total - done
            part = total - done if last else step
            half = 0.5 * part
            u, v, yaw = onwards(pose, turn, sign * (done + half))
            middle = (q0[0] + radius * u, q0[1] + radius * v, yaw)
            if around_is_free(map_, middle, (half + spare) * radius, (half if turn != 0 else 0.0) + spare):
                if last:
                    break
                done, step = done + part, min(2.0 * step, longest)
            elif part <= least or not around_is_free(map_, middle, spare * radius, spare):
                return False
            else:
                step = half
        pose = onwards(pose, turn, lengths[k])
    return True


@jit
def shortest(kind: int, radius: float, q0: Pose, q1: Pose) -> tuple[Ints, Floats, float]:
    """Turns, lengths and gap of the shortest word between two configurations.

    The gap is infinite where there is none, which cannot happen.
    """
    turns, lengths = np.zeros((MOST, 5), np.int64), np.zeros((MOST, 5))
    swapped = swaps(kind, q0, q1)
    _, gap = tied_words(kind, radius, (q1, q0) if swapped else (q0, q1), -math.inf, turns, lengths)
    if swapped:
        reverse(turns[0], lengths[0])
    return turns[0], lengths[0], gap


@kernel
def reverse(turns: Ints, lengths: Floats) -> None:
    """Drive a word from its end to its start."""
    for k in range(3):
        turns[k], turns[4 - k] = turns[4 - k], turns[k]
        lengths[k], lengths[4 - k] = -lengths[4 - k], -lengths[k]


@kernel
def swaps(kind: int, q0: Pose, q1: Pose) -> bool:
    """Whether a curve is that from the second configuration to the first, reversed.

    Curves of a car that reverses are then the same both ways, also where several are equally short.
    """
    if kind == DUBINS or q0[0] < q1[0]:
        return False
    return q1[0] < q0[0] or q1[1] < q0[1] or (q1[1] == q0[1] and q1[2] < q0[2])


@jit  # it makes arrays
def tied_words(
    kind: int, radius: float, endpoints: tuple[Pose, Pose], tie: float, turns: Ints, lengths: Floats
) -> tuple[int, float]:
    """Write the shortest word from one configuration to another, then all others longer by at most ``tie``.

    Each form gives words by symmetry: mirrored (left for right), reversed (ahead for back) and backwards (from the end
    to the start). A word counts only if it gets there, which is tried, so that no case needs an argument of its own.

    Returns the number of words, without duplicates, and the gap of the shortest.
    """
    (x0, y0, yaw0), (x1, y1, yaw1) = endpoints
    dx, dy, c, s = (x1 - x0) / radius, (y1 - y0) / radius, math.cos(yaw0), math.sin(yaw0)
    x, y, phi = dx * c + dy * s, dy * c - dx * s, _around(yaw1 - yaw0)
    all_turns, all_lengths = np.zeros((MOST, 5), np.int64), np.zeros((MOST, 5))
    number = _candidates(kind, (x, y, phi), all_turns, all_lengths)
    best, least, gap = 0, math.inf, math.inf
    for row in range(number):
        # To see where a word ends takes longer than to make it, so only what is shorter is looked at.
        total = total_length(all_lengths[row])
        if total < least:
            missed = _gap(all_turns[row], all_lengths[row], (x, y, phi))
            if missed <= GAP:
                best, least, gap = row, total, missed
    count = 0
    for place in range(number + 1):
        row = best if place == 0 else place - 1
        if place > 0 and (row == best or total_length(all_lengths[row]) > least + tie):
            continue
        if place > 0 and _gap(all_turns[row], all_lengths[row], (x, y, phi)) > GAP:
            continue
        for k in range(5):
            turns[count, k], lengths[count, k] = all_turns[row, k], all_lengths[row, k]
        count += is_new(turns, lengths, count)
    return count, gap


@kernel
def total_length(lengths: Floats) -> float:
    total: float = abs(lengths[0]) + abs(lengths[1]) + abs(lengths[2]) + abs(lengths[3]) + abs(lengths[4])
    return total


@kernel
def onwards(pose: Pose, turn: int, length: float) -> Pose:
    """The end of a piece; everything in turning radii."""
    x, y, yaw = pose
    if turn == 0:
        return x + length * math.cos(yaw), y + length * math.sin(yaw), yaw
    after = yaw + turn * length
    return x + turn * (math.sin(after) - math.sin(yaw)), y + turn * (math.cos(yaw) - math.cos(after)), after


@jit
def _around(angle: float) -> float:
    """An angle in [-pi, pi)."""
    return angle - TWO_PI * math.floor((angle + math.pi) / TWO_PI)


@jit  # it makes arrays
def _ahead(angle: float, snap: float) -> float:
    """An arc driven forwards, in [0, 2 pi), and 0 where it is a whole turn but for ``snap``."""
    angle -= TWO_PI * math.floor(angle / TWO_PI)
    return 0.0 if angle > TWO_PI - snap else angle


@kernel
def _gap(turns: Ints, lengths: Floats, goal: Pose) -> float:
    """By how much the end of a word misses a configuration."""
    pose = (0.0, 0.0, 0.0)
    for k in range(5):
        if lengths[k] != 0.0:
            pose = onwards(pose, turns[k], lengths[k])
    missed: float = max(math.hypot(pose[0] - goal[0], pose[1] - goal[1]), abs(_around(pose[2] - goal[2])))
    return missed


@kernel
def is_new(turns: Ints, lengths: Floats, count: int) -> int:
    """1 where the word in row ``count`` is none of those before it, otherwise 0."""
    for row in range(count):
        apart = 0.0
        for k in range(5):
            same = turns[row, k] == turns[count, k] or max(abs(lengths[row, k]), abs(lengths[count, k])) < 1e-12
            apart = max(apart, abs(lengths[row, k] - lengths[count, k]) if same else math.inf)
        if apart <= 1e-12:
            return 0
    return 1


@kernel
def _candidates(kind: int, goal: Pose, turns: Ints, lengths: Floats) -> int:
    """Write all words that might lead from the origin to a configuration, and give their number."""
    x, y, phi = goal
    count = 0
    for symmetry in range(4):
        mirror, sign = 1 - 2 * (symmetry // 2), 1 - 2 * (symmetry % 2)
        if kind == DUBINS and sign < 0:
            continue
        u, v, angle = sign * x, mirror * y, sign * mirror * phi
        c, s = math.cos(angle), math.sin(angle)
        for number in range(2 * FORMS):
            form, second = number // 2, number % 2 == 1
            if (kind == DUBINS and form > 3) or (kind != DUBINS and second and form not in (3, 6, 7)):
                continue
            # The second time around, a form is driven from its end to its start; Dubins' is not snapped.
            back = second and kind != DUBINS
            pieces = _form(form, u * c + v * s if back else u, u * s - v * c if back else v, angle)
            last = 2 if form == 3 else 3
            for k in range(5):
                other = last - k if back and k <= last else k
                length = pieces[1][other]
                if kind == DUBINS and (k != 1 or form == 3):
                    length = _ahead(length, 0.0 if second else SNAP)
                turns[count, k], lengths[count, k] = mirror * pieces[0][other], sign * length
            count += 1
    return count


@kernel
def _tau_omega(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    """First and last arc of the words of four arcs."""
    delta = _around(u - v)
    a, b = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    t = math.atan2(eta * a - xi * b, xi * a + eta * b)
    if 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0:
        t += math.pi
    t = _around(t)
    return t, _around(t - u + v - phi)


@kernel
def _form(form: int, x: float, y: float, phi: float) -> tuple[Turns, Lengths]:
    """Turns and lengths of a word to (x, y, phi) of one form; all zeros where the form does not get there."""
    half, none = 0.5 * math.pi, ((0, 0, 0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0))
    if form == 0:
        return (1, 0, 0, 0, 0), (phi, 0.0, 0.0, 0.0, 0.0)
    # The middle of the last circle, where that turns left or right, seen from that of the first.
    left = form in (1, 3, 6)
    xi = x - math.sin(phi) if left else x + math.sin(phi)
    eta = y - 1.0 + math.cos(phi) if left else y - 1.0 - math.cos(phi)
    apart, bearing = math.hypot(xi, eta), math.atan2(eta, xi)
    if form == 1:
        return (1, 0, 1, 0, 0), (bearing, apart, _around(phi - bearing), 0.0, 0.0)
    if form == 2 and apart >= 2.0 - TOUCH:
        u = math.sqrt(max(apart * apart - 4.0, 0.0))
        t = _around(bearing + math.atan2(2.0, u))
        return (1, 0, -1, 0, 0), (t, u, _around(t - phi), 0.0, 0.0)
    if form == 3 and apart <= 4.0 + TOUCH:
        u = -2.0 * math.asin(min(0.25 * apart, 1.0))
        t = _around(bearing + 0.5 * u + math.pi)
        return (1, -1, 1, 0, 0), (t, u, _around(phi - t + u), 0.0, 0.0)
    if form == 4 and apart <= 2.0 + TOUCH:
        u = math.acos(min(0.25 * (2.0 + apart), 1.0))
        t, v = _tau_omega(u, -u, xi, eta, phi)
        return (1, -1, 1, -1, 0), (t, u, -u, v, 0.0)
    if form == 5 and 2.0 - TOUCH <= apart <= math.sqrt(20.0):
        u = -math.acos(min((20.0 - apart * apart) / 16.0, 1.0))
        t, v = _tau_omega(u, u, xi, eta, phi)
        return (1, -1, 1, -1, 0), (t, u, u, v, 0.0)
    if form == 6 and apart >= 2.0 - TOUCH:
        u = math.sqrt(max(apart * apart - 4.0, 0.0))
        t = _around(bearing + math.atan2(u, -2.0))
        return (1, -1, 0, 1, 0), (t, -half, 2.0 - u, _around(phi - half - t), 0.0)
    if form == 7 and apart >= 2.0 - TOUCH:
        t = math.atan2(xi, -eta)
        return (1, -1, 0, -1, 0), (t, -half, 2.0 - apart, _around(t + half - phi), 0.0)
    if form == 8 and apart >= 2.0 - TOUCH:
        u = 4.0 - math.sqrt(max(apart * apart - 4.0, 0.0))
        t = _around(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
        return (1, -1, 0, 1, -1), (t, -half, u, -half, _around(t - phi))
    return none
