"""Areas and volumes of unions of balls."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROUNDING: Final = 2.0**-40
"""Rounding of an area, in the area of the bounding box."""

UNIT: Final = 2.0**-50
"""Rounding of a length, in the size of the whole, with room to spare."""

CHANGES: Final = (0.0, 2.0**-32, 2.0**-27)
"""Parts of the radii by which they are changed where bounds of an area are apart by more than :data:`CLOSE`."""

CLOSE: Final = 1e-9
"""Part of an area."""

HELD: Final = 2.0**-26
"""Thickness of the film, in radii, that a disc may stick out of another one and still count as held by it."""

LEVELS: Final = (7, 8, 9, 10)
"""How often the box round balls in space is halved: on, while bounds are apart by more than :data:`APART`."""

APART: Final = 0.01
"""Part of a volume by which its bounds may be apart."""


def measure_of_balls(centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bounds of the area (d = 2) or volume (d = 3) of a union of balls, centers (n, d) and radii (n,) in metres."""
    reach = radii[:, None]
    lower, upper = (centers - reach).min(axis=0), (centers + reach).max(axis=0)
    if centers.shape[1] == 2:
        size, rounding = float(np.hypot(*(upper - lower))), ROUNDING * float(np.prod(upper - lower))
        low, high = 0.0, np.inf
        # A union grows with its radii, and circles that nearly touch soon do so no more.
        for change in CHANGES:
            area, off = _area(centers - lower, radii * (1.0 - change), size)
            low = max(low, area - off - rounding)
            area, off = _area(centers - lower, radii * (1.0 + change), size) if change else (area, off)
            high = min(high, area + off + rounding)
            if high - low <= CLOSE * high:
                break
        return float(low), float(high)
    return _volume(centers - lower, radii, float((upper - lower).max()))


def _area(centers: Floats, radii: Floats, size: float) -> tuple[float, float]:
    """Area of a union of discs, by Green's theorem along the arcs that lie in no other disc; and how far it may be off.

    Where circles nearly touch, the angles at which they meet are known to half as many digits.
    """
    centers, radii, error = _without_held(centers, radii)
    total = 0.0
    for n, (center, radius) in enumerate(zip(centers, radii.tolist(), strict=True)):
        way = np.hypot(*(centers - center).T)
        cuts = np.flatnonzero((way < radii + radius) & (np.arange(len(radii)) != n))
        far, others = way[cuts], radii[cuts]
        towards = np.arctan2(*(centers[cuts] - center).T[::-1])
        cosine = np.clip((far**2 + (radius - others) * (radius + others)) / (2.0 * far * radius), -1.0, 1.0)
        half = np.arccos(cosine)
        unsure = UNIT * (size * others + far**2 + radius**2 + others**2) / (far * radius)
        angles = np.minimum(unsure / np.maximum(np.sin(half), 1e-300), 2.0 * np.sqrt(unsure)) + UNIT * size / far
        error += radius * size * float(np.minimum(angles, np.pi).sum())
        for start, stop in _open_arcs(towards - half, towards + half):
            turned = center[0] * (np.sin(stop) - np.sin(start)) - center[1] * (np.cos(stop) - np.cos(start))
            total += 0.5 * radius * (radius * (stop - start) + float(turned))
    return total, error


def _without_held(centers: Floats, radii: Floats) -> tuple[Floats, Floats, float]:
    """The discs, from the largest on, without those that another one holds but for a film; and the films' area."""
    order = np.argsort(-radii, kind="stable")
    centers, radii = centers[order], radii[order]
    kept, films = np.ones(len(radii), dtype=np.bool_), 0.0
    for n in range(1, len(radii)):
        before = np.flatnonzero(kept[:n])
        out = np.hypot(*(centers[before] - centers[n]).T) + radii[n] - radii[before]
        if (out <= HELD * radii[n]).any():
            kept[n] = False
            films += 2.0 * math.pi * radii[n] * max(0.0, float(out.min()))
    return centers[kept], radii[kept], films


def _open_arcs(starts: Floats, stops: Floats) -> list[tuple[float, float]]:
    """What arcs, from angles to larger ones, leave of a circle."""
    turn = 2.0 * np.pi
    first = starts % turn
    last = first + (stops - starts)
    # An arc over the end of the turn is there at its beginning too.
    first, last = np.append(first, first[last > turn] - turn), np.append(last, last[last > turn] - turn)
    order = np.argsort(first)
    left, at = [], 0.0
    for start, stop in zip(first[order].tolist(), last[order].tolist(), strict=True):
        if start > at:
            left.append((at, start))
        at = max(at, stop)
    return [*left, (at, turn)] if at < turn else left


def _volume(centers: Floats, radii: Floats, side: float) -> tuple[float, float]:
    from cspace.spectral.spheres.measures import _kernels

    centers = np.ascontiguousarray(centers)
    for levels in LEVELS:
        found = _kernels.split_volume(np.zeros(3), side, levels, centers, radii, ROUNDING * side)
        if found[1] - found[0] <= APART * found[0]:
            break
    return float(found[0]), float(found[1])
