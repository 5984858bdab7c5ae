"""Times at which a motion passes places on its way.

Parts of the way are cut until each is short beside its distance from the place. A part may hold the
place if its middle is not farther from it than the rates of the part allow the robot to move.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace import Rotations
from cspace.inside import Floats, Ints
from planners._motion.segments import Segments, bound_derivatives, place_along
from planners._motion.timing import Phases

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
    segments: Segments, rotations: Rotations, phases: Phases, places: Floats, tolerance: float
) -> tuple[Floats, Floats]:
    """Return when a motion passes places in order, and their distances from its way, shape (n,).

    Each is passed at or after the place before, as early as possible within the tolerance. The
    first place without such an approach ends the search; its distance is the least one.
    """
    lengths = segments.lengths.copy()
    lengths[-1] = phases.positions[-1]
    way = segments._replace(lengths=lengths)
    found = [Approach(0, float(phases.positions[0]), 0.0)]
    for place in places:
        found.append(_find_place(way, rotations, place, found[-1], tolerance))
        if found[-1].gap > tolerance:
            break
    numbers, along, gaps = (np.array(column) for column in zip(*found[1:], strict=True))
    firsts = np.cumsum(segments.lengths) - segments.lengths
    return find_arrivals(phases, segments.lengths, firsts[numbers] + along), gaps


def _find_place(
    way: Segments, rotations: Rotations, place: Floats, after: Approach, tolerance: float
) -> Approach:
    """Return the first approach to a place within a tolerance, or the nearest one."""
    first, count = after.segment, FIRST_COUNT
    nearest = after._replace(gap=np.inf)
    while first < len(way.lengths) and nearest.gap > tolerance:
        numbers = np.arange(first, min(first + count, len(way.lengths)))
        found = _approach(way, rotations, place, numbers, after, tolerance)
        nearest = min(nearest, found, key=lambda each: each.gap)
        first, count = first + count, 2 * count
    return nearest


def _approach(
    way: Segments,
    rotations: Rotations,
    place: Floats,
    owners: Ints,
    after: Approach,
    tolerance: float,
) -> Approach:
    """Return the first approach of some segments within a tolerance, or the nearest one."""
    dim = len(place) - len(rotations.names)
    begins = np.where(owners == after.segment, after.length, 0.0)
    widths = way.lengths[owners] - begins
    for _ in range(MAX_ROUNDS):
        parts = way.select(owners)
        along = begins + 0.5 * widths
        gaps = _measure(_steps_to(parts, rotations, place, along), dim)
        rates, _ = bound_derivatives(parts, begins, widths)
        reaches = 0.5 * widths * np.linalg.norm(rates, axis=1)
        nearest = float(gaps.min())
        least = gaps - reaches
        is_near = (least <= max((1.0 - PRECISION) * nearest, tolerance)) | (gaps == nearest)
        owners, begins, widths = owners[is_near], begins[is_near], widths[is_near]
        if reaches[is_near].max() <= PRECISION * max(nearest, tolerance):
            break
        owners, widths = np.repeat(owners, CUTS), np.repeat(widths, CUTS) / CUTS
        begins = np.repeat(begins, CUTS) + np.arange(len(owners)) % CUTS * widths
    parts = way.select(owners)
    along = begins + 0.5 * widths
    lowest = np.where(owners == after.segment, after.length, 0.0)
    steps = _steps_to(parts, rotations, place, along)
    for _ in range(STEPS):
        rates = place_along(parts, rotations, along)[1]
        squares = np.maximum((rates * rates).sum(axis=1), np.finfo(np.float64).tiny)
        nearer = np.clip(along + (rates * steps).sum(axis=1) / squares, lowest, parts.lengths)
        nearer_steps = _steps_to(parts, rotations, place, nearer)
        is_nearer = _measure(nearer_steps, dim) <= _measure(steps, dim)
        along = np.where(is_nearer, nearer, along)
        steps = np.where(is_nearer[:, np.newaxis], nearer_steps, steps)
    gaps = _measure(steps, dim)
    first = int(np.argmax(gaps <= max(float(gaps.min()), tolerance)))
    return Approach(int(owners[first]), float(along[first]), float(gaps[first]))


def _steps_to(parts: Segments, rotations: Rotations, place: Floats, along: Floats) -> Floats:
    """Return the steps from lengths along segments to a place, shape (n, k)."""
    return rotations.steps_between(place_along(parts, rotations, along)[0], place[np.newaxis])


def _measure(steps: Floats, dim: int) -> Floats:
    """Return the largest move of an axis, or turn, of steps, shape (n,)."""
    moves = np.abs(steps[:, :dim]).max(axis=1, initial=0.0)
    return np.asarray(np.maximum(moves, np.linalg.norm(steps[:, dim:], axis=1)))
