"""Compiled shortest curves of cars, as words.

A *word* is a curve of at most five pieces: ``turns``, each 1 (left), -1 (right) or 0 (straight on), and ``lengths``, in
turning radii, below zero where the car reverses. ``gap`` says by how much the end of the word misses the configuration
that it is meant for, in turning radii and in radians: some 1e-15, or 1e-8 where a root was taken near zero.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.rotations import TURN

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Turns = tuple[int, int, int, int, int]
Lengths = tuple[float, float, float, float, float]
Pieces = tuple[Turns, Lengths]
Word = tuple[Turns, Lengths, float]

DUBINS = 0
REEDS_SHEPP = 1

GAP = 1e-6
"""Largest gap, in turning radii and in radians, of a word that counts. The proof covers it."""

SNAP = 1e-6
"""Arcs that are a whole turn but for that many radians are tried as none: that is how rounding makes loops."""

TOUCH = 1e-7
"""By how much circles may miss each other, in turning radii, where they should touch: they do between two arcs."""

FORMS = 9


@njit(cache=True, nogil=True)
def _around(angle: float) -> float:
    """An angle in [-pi, pi)."""
    return angle - TURN * math.floor((angle + math.pi) / TURN)


@njit(cache=True, nogil=True)
def _onwards(angle: float, snap: float) -> float:
    """An angle in [0, 2 pi), and 0 where it is a whole turn but for ``snap``."""
    angle -= TURN * math.floor(angle / TURN)
    return 0.0 if angle > TURN - snap else angle


@njit(cache=True, nogil=True)
def _tau_omega(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    """First and last arc of the words of four arcs."""
    delta = _around(u - v)
    a, b = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    t = math.atan2(eta * a - xi * b, xi * a + eta * b)
    if 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0:
        t += math.pi
    t = _around(t)
    return t, _around(t - u + v - phi)


@njit(cache=True, nogil=True)
def _form(form: int, x: float, y: float, phi: float) -> Pieces:
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


@njit(cache=True, nogil=True)
def _ahead(form: int, snap: float, x: float, y: float, phi: float) -> Pieces:
    """One of the first four forms driven forwards alone: every arc goes on around its circle."""
    turns, lengths = _form(form, x, y, phi)
    middle = _onwards(lengths[1], snap) if form == 3 else lengths[1]
    return turns, (_onwards(lengths[0], snap), middle, _onwards(lengths[2], snap), 0.0, 0.0)


@njit(cache=True, nogil=True)
def _backwards(form: int, x: float, y: float, phi: float) -> Pieces:
    """A form of three or four pieces, driven from the end to the start."""
    c, s = math.cos(phi), math.sin(phi)
    (i, j, k, m, _), (a, b, d, e, _) = _form(form, x * c + y * s, x * s - y * c, phi)
    if form == 3:
        return (k, j, i, 0, 0), (d, b, a, 0.0, 0.0)
    return (m, k, j, i, 0), (e, d, b, a, 0.0)


@njit(cache=True, nogil=True)
def _flipped(pieces: Pieces, mirror: int, way: int) -> Pieces:
    """Pieces with left for right, and ahead for back, where these are -1."""
    (i, j, k, m, n), (a, b, d, e, f) = pieces
    return (
        (mirror * i, mirror * j, mirror * k, mirror * m, mirror * n),
        (way * a, way * b, way * d, way * e, way * f),
    )


@njit(cache=True, nogil=True)
def _shorter(best: Word, pieces: Pieces, x: float, y: float, phi: float) -> Word:
    """The shorter of the best word so far and another, if that gets to (x, y, phi)."""
    turns, lengths = pieces
    if best[2] <= GAP and total_length(lengths) >= total_length(best[1]):
        return best
    px, py, yaw = 0.0, 0.0, 0.0
    for k in range(5):
        px, py, yaw = onwards(px, py, yaw, turns[k], lengths[k])
    gap = max(math.hypot(px - x, py - y), abs(_around(yaw - phi)))
    return (turns, lengths, gap) if gap <= GAP else best


@njit(cache=True, nogil=True)
def total_length(lengths: Lengths) -> float:
    return abs(lengths[0]) + abs(lengths[1]) + abs(lengths[2]) + abs(lengths[3]) + abs(lengths[4])


@njit(cache=True, nogil=True)
def onwards(x: float, y: float, yaw: float, turn: int, length: float) -> tuple[float, float, float]:
    """The end of a piece; everything in turning radii."""
    if turn == 0:
        return x + length * math.cos(yaw), y + length * math.sin(yaw), yaw
    after = yaw + turn * length
    return x + turn * (math.sin(after) - math.sin(yaw)), y + turn * (math.cos(yaw) - math.cos(after)), after


@njit(cache=True, nogil=True)
def search(kind: int, radius: float, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> Word:
    """The shortest word from one configuration to another."""
    dx, dy, c, s = (x1 - x0) / radius, (y1 - y0) / radius, math.cos(yaw0), math.sin(yaw0)
    x, y, phi = dx * c + dy * s, dy * c - dx * s, _around(yaw1 - yaw0)
    best: Word = ((0, 0, 0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0), math.inf)
    for mirror in (1, -1):
        if kind == DUBINS:
            for form in range(4):
                for snap in (SNAP, 0.0):
                    pieces = _ahead(form, snap, x, mirror * y, mirror * phi)
                    best = _shorter(best, _flipped(pieces, mirror, 1), x, y, phi)
            continue
        for way in (1, -1):
            u, v, angle = way * x, mirror * y, way * mirror * phi
            for form in range(FORMS):
                best = _shorter(best, _flipped(_form(form, u, v, angle), mirror, way), x, y, phi)
                if form in (3, 6, 7):
                    best = _shorter(best, _flipped(_backwards(form, u, v, angle), mirror, way), x, y, phi)
    return best


@njit(cache=True, nogil=True)
def _reversed(word: Word) -> Word:
    """A word driven from its end to its start."""
    (i, j, k, m, n), (a, b, d, e, f), gap = word
    return (n, m, k, j, i), (-f, -e, -d, -b, -a), gap


@njit(cache=True, nogil=True)
def swaps(kind: int, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> bool:
    """Whether a curve is that from the second configuration to the first, reversed.

    Curves of a car that reverses are then the same both ways, also where several are equally short.
    """
    if kind == DUBINS or x0 < x1:
        return False
    return x1 < x0 or y1 < y0 or (y1 == y0 and yaw1 < yaw0)


@njit(cache=True, nogil=True)
def shortest(kind: int, radius: float, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> Word:
    """The shortest word between two configurations, and its gap; infinite where there is none, which cannot happen.

    Each form gives words by symmetry: mirrored (left for right), reversed (ahead for back) and backwards (from the end
    to the start). A word counts only if it gets there, which is tried, so that no case needs an argument of its own.
    """
    if swaps(kind, x0, y0, yaw0, x1, y1, yaw1):
        return _reversed(search(kind, radius, x1, y1, yaw1, x0, y0, yaw0))
    return search(kind, radius, x0, y0, yaw0, x1, y1, yaw1)


@njit(cache=True, nogil=True)
def tied_words(
    kind: int,
    radius: float,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
    longest: float,
    turns: Ints,
    lengths: Floats,
    count: int,
    back: bool,
) -> int:
    """Add the words that are no longer than ``longest`` to the ``count`` rows of turns and lengths, each once.

    With ``back`` they are added as driven from the second configuration to the first. Gives the new count.
    """
    dx, dy, c, s = (x1 - x0) / radius, (y1 - y0) / radius, math.cos(yaw0), math.sin(yaw0)
    x, y, phi = dx * c + dy * s, dy * c - dx * s, _around(yaw1 - yaw0)
    for number in range(8 * FORMS):
        form, mirror, way, other = number % FORMS, 1 - 2 * (number // FORMS % 2), 1, number // (2 * FORMS)
        if kind == DUBINS:
            if form > 3 or other > 1:
                continue
            pieces = _flipped(_ahead(form, SNAP if other == 0 else 0.0, x, mirror * y, mirror * phi), mirror, 1)
        else:
            way = 1 - 2 * (other % 2)
            u, v, angle = way * x, mirror * y, way * mirror * phi
            if other < 2:
                pieces = _flipped(_form(form, u, v, angle), mirror, way)
            elif form in (3, 6, 7):
                pieces = _flipped(_backwards(form, u, v, angle), mirror, way)
            else:
                continue
        if total_length(pieces[1]) > longest:
            continue
        word = _shorter(((0, 0, 0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0), math.inf), pieces, x, y, phi)
        if not word[2] <= GAP:
            continue
        if back:
            word = _reversed(word)
        for k in range(5):
            turns[count, k], lengths[count, k] = word[0][k], word[1][k]
        new = True
        for row in range(count):
            apart = 0.0
            for k in range(5):
                same = turns[row, k] == turns[count, k] or max(abs(lengths[row, k]), abs(lengths[count, k])) < 1e-12
                apart = max(apart, abs(lengths[row, k] - lengths[count, k]) if same else math.inf)
            new = new and apart > 1e-12
        count += new
    return count
