"""Times at which a motion passes places on its way.

Parts of the way are cut until each is short beside its distance from the place. A part may come
near the place if its middle is not farther from it than the rates let the robot move in half the
part.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace import Rotations
from cspace.inside import Floats, Ints, number_parts
from planners._motion.segments import Segments, bound_derivatives, place_along
from planners._motion.timing import Phases

TOLERANCE: Final = 1e-4
"""Largest distance of a passed place from the way, metres or radians.

Rows with four decimals, and rows that a straight motion joins, lie nearer.
"""

PLACE_SHARE: Final = 1e-9
"""Largest distance of equal places, as a share of the length of the way."""

TIME_STEPS: Final = 50
"""Number of halvings that find a time."""

CUTS: Final = 8
"""Number of pieces into which a part of the way is cut."""

MAX_ROUNDS: Final = 20
"""Largest number of times that parts are cut; no number tells shorter ones apart."""

PRECISION: Final = 0.1
"""Largest length of half a part of the way, as a share of its distance from the place."""

FIRST_COUNT: Final = 16
"""Number of segments that are searched first; it doubles while none holds the place."""

ROUNDING: Final = 1e-9
"""Largest difference of equal distances from a place, metres or radians."""

STEPS: Final = 3
"""Number of Newton's steps to the nearest length; each doubles the digits."""


class Approach(NamedTuple):
    """A length of the way near a place."""

    segment: int
    length: float  # along the segment
    gap: float  # distance of the place, metres or radians


def find_times(phases: Phases, lengths: Floats, targets: Floats) -> Floats:
    """Return the seconds at which a motion reaches lengths of its way, of any shape.

    ``lengths`` are those of the segments.
    """
    firsts = np.cumsum(lengths) - lengths
    low, high = np.zeros(targets.shape), np.full(targets.shape, phases.times[-1])
    for _ in range(TIME_STEPS):
        middle = 0.5 * (low + high)
        numbers = np.maximum(np.searchsorted(phases.times, middle, side="right") - 1, 0)
        along = phases.at(numbers, middle - phases.times[numbers])[0]
        is_before = firsts[phases.segments[numbers]] + along < targets
        low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
    return np.asarray(high)


def find_arrivals(phases: Phases, lengths: Floats, targets: Floats) -> Floats:
    """Return the seconds at which a motion first reaches lengths of its way, shape (n,).

    If it rests there, rounding must not add the rest, so a phase begins at the length.
    """
    firsts = np.cumsum(lengths) - lengths
    reached = firsts[phases.segments] + phases.positions
    slack = PLACE_SHARE * max(float(reached[-1]), 1.0)
    borders = np.minimum(np.searchsorted(reached, targets - slack), len(reached) - 1)
    is_border = np.abs(reached[borders] - targets) <= slack
    return np.where(is_border, phases.times[borders], find_times(phases, lengths, targets))


def follow_places(
    segments: Segments, rotations: Rotations, phases: Phases, places: Floats
) -> tuple[Floats, Floats]:
    """Return when a motion passes places in order, and their distances from its way, shape (n,).

    Places are configurations, or positions at any rotation. Each is passed at or after the one
    before, where the way is nearest as it is first within the tolerance. A place without such an
    approach ends the search; its distance is the least one.
    """
    lengths = segments.lengths.copy()
    lengths[-1] = phases.positions[-1]
    way = segments._replace(lengths=lengths)
    found = [Approach(0, float(phases.positions[0]), 0.0)]
    for place in places:
        found.append(_find_place(way, rotations, place, found[-1]))
        if found[-1].gap > TOLERANCE:
            break
    firsts = np.cumsum(segments.lengths) - segments.lengths
    targets = np.array([firsts[each.segment] + each.length for each in found[1:]])
    gaps = np.array([each.gap for each in found[1:]])
    return find_arrivals(phases, segments.lengths, targets), gaps


def _find_place(way: Segments, rotations: Rotations, place: Floats, after: Approach) -> Approach:
    """Return the first approach to a place within the tolerance, or the nearest one."""
    first, count = after.segment, FIRST_COUNT
    nearest = after._replace(gap=np.inf)
    while first < len(way.lengths) and nearest.gap > TOLERANCE:
        numbers = np.arange(first, min(first + count, len(way.lengths)))
        found = _approach(way, rotations, place, numbers, after)
        nearest = min(nearest, found, key=lambda each: each.gap)
        first, count = first + count, 2 * count
    return nearest


def _approach(
    way: Segments, rotations: Rotations, place: Floats, numbers: Ints, after: Approach
) -> Approach:
    """Return the first approach of some segments within the tolerance, or the nearest one."""
    dim = way.starts.shape[1] - len(rotations.names)
    owners = numbers
    begins = np.where(owners == after.segment, after.length, 0.0)
    widths = way.lengths[owners] - begins
    for _ in range(MAX_ROUNDS):
        parts = way.select(owners)
        steps = _steps_to(parts, rotations, place, begins + 0.5 * widths)
        gaps = _measure(steps, dim)
        rates = bound_derivatives(parts, begins, widths)[0][:, : steps.shape[1]]
        reaches = 0.5 * widths * np.linalg.norm(rates, axis=1)
        nearest = float(gaps.min())
        least = gaps - reaches
        is_near = (least <= max((1.0 - PRECISION) * nearest, TOLERANCE)) | (gaps == nearest)
        is_long = reaches[is_near] > PRECISION * max(nearest, TOLERANCE)
        owners, begins, widths = owners[is_near], begins[is_near], widths[is_near]
        if not is_long.any():
            break
        counts = np.where(is_long, CUTS, 1)
        rows, places = number_parts(counts)
        owners, widths = owners[rows], (widths / counts)[rows]
        begins = begins[rows] + places * widths
    parts = way.select(owners)
    lowest = np.where(owners == after.segment, after.length, 0.0)
    along = begins
    steps = _steps_to(parts, rotations, place, along)
    for _ in range(STEPS):
        rates = place_along(parts, rotations, along)[1][:, : steps.shape[1]]
        squares = np.maximum((rates * rates).sum(axis=1), np.finfo(np.float64).tiny)
        nearer = np.clip(along + (rates * steps).sum(axis=1) / squares, lowest, parts.lengths)
        nearer_steps = _steps_to(parts, rotations, place, nearer)
        is_nearer = _measure(nearer_steps, dim) <= _measure(steps, dim)
        along = np.where(is_nearer, nearer, along)
        steps = np.where(is_nearer[:, np.newaxis], nearer_steps, steps)
    gaps = _measure(steps, dim)
    first = int(np.argmax(gaps <= max(float(gaps.min()), TOLERANCE)))
    # The approach is as long as parts follow each other, also from one segment to the next.
    firsts = np.cumsum(way.lengths[numbers]) - way.lengths[numbers]
    begins = begins + firsts[owners - numbers[0]]
    ends = begins[first:-1] + widths[first:-1] + PLACE_SHARE * max(float(firsts[-1]), 1.0)
    breaks = np.flatnonzero(begins[first + 1 :] > ends)
    last = first + int(breaks[0] if len(breaks) else len(ends))
    group = gaps[first : last + 1]
    first += int(np.argmax(group <= group.min() + ROUNDING))
    return Approach(int(owners[first]), float(along[first]), float(gaps[first]))


def _steps_to(parts: Segments, rotations: Rotations, place: Floats, along: Floats) -> Floats:
    """Return the steps from lengths along segments to a place, shape (n, k)."""
    q = place_along(parts, rotations, along)[0]
    if len(place) < q.shape[1]:  # at any rotation
        return np.asarray(place - q[:, : len(place)])
    return rotations.steps_between(q, place[np.newaxis])


def _measure(steps: Floats, dim: int) -> Floats:
    """Return the largest move of an axis, or turn, of steps, shape (n,)."""
    moves = np.abs(steps[:, :dim]).max(axis=1, initial=0.0)
    return np.asarray(np.maximum(moves, np.linalg.norm(steps[:, dim:], axis=1)))
