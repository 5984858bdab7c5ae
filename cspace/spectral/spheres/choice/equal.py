"""Balls of one radius."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from cspace.spectral.spheres.choice.candidates import CANDIDATES, Candidates, medial, on_lattice, within
from cspace.spectral.spheres.choice.cover import Cover, covered
from cspace.spectral.spheres.fields import Lattice

Floats = NDArray[np.float64]
Balls = tuple[Floats, Floats]
Found = TypeVar("Found")

RADII: Final = 12
"""Radii that are tried, at most, once it is known between which."""

LEAST: Final = 0.002
"""Least radius that is tried, in tolerances."""

SHORTER: Final = 0.75
"""By this factor radii become smaller until there are balls."""

_MANY: Final = 2**40


def inner_number(lattice: Lattice, method: str, number: int, radius: float | None) -> Balls:
    """At most so many balls in a shape that hold most of it; without a radius, the best of some."""
    some = _inside(lattice, method)
    most = float(some.depths.max(initial=0.0))
    best: tuple[int, float, Floats] = (-1, 0.0, np.empty((0, 3)))
    for length in [radius] if radius is not None else _falling(most, _fair(lattice, number)):
        fits = some.where(some.depths >= length)
        cover = Cover(lattice, whole=False)
        centers = fits.centers[cover.choose(fits, np.full(len(fits.depths), length), number)]
        if not len(centers):
            centers = fits.centers[np.argsort(-fits.depths)[:1]]
        if cover.held > best[0]:
            best = cover.held, length, centers
    return best[2], np.full(len(best[2]), best[1])


def inner_tolerance(lattice: Lattice, method: str, tolerance: float, radius: float | None) -> tuple[Cover, Balls]:
    """Balls in a shape that, grown by a length in sides, cover it; without a radius, with the largest that does.

    The cover tells what they did not reach.
    """
    some = _inside(lattice, method)

    def at(length: float) -> tuple[Cover, Balls]:
        cover, balls, _ = covered(lattice, some, length + tolerance, length, grown=False, most=_MANY)
        return cover, (balls.centers, np.full(len(balls.depths), length))

    def whole(length: float) -> tuple[Cover, Balls] | None:
        found = at(length)
        return None if len(found[0].open_cells) else found

    if radius is not None:
        return at(radius)
    most, least = float(some.depths.max(initial=0.0)), LEAST * tolerance
    return _largest(whole, most, least) or at(min(most, least))


def outer_number(lattice: Lattice, method: str, number: int, radius: float | None) -> Balls | None:
    """At most so many balls that cover a shape, without a radius, of the least; None where there are none."""
    some = _all(lattice, method)

    def at(length: float) -> Balls | None:
        return _outer(lattice, some, length, -np.inf, number)

    if radius is not None:
        return at(radius)
    low, high = 0.501 * lattice.diagonal, lattice.region.size / lattice.side
    found = at(high)
    for _ in range(RADII):
        if high < 1.02 * low:
            break
        middle = float(np.sqrt(low * high))
        better = at(middle)
        if better is None:
            low = middle
        else:
            found, high = better, middle
    return found


def outer_tolerance(lattice: Lattice, method: str, tolerance: float, radius: float | None) -> Balls | None:
    """Balls that cover a shape and stick out by no more than a length in sides; without a radius, of the largest."""
    some = _all(lattice, method)

    def at(length: float) -> Balls | None:
        return _outer(lattice, some, length, length - tolerance, _MANY)

    if radius is not None:
        return at(radius)
    return _largest(at, max(float(some.depths.max()), 0.0) + tolerance, 0.5 * tolerance)


def _largest(at: Callable[[float], Found | None], most: float, least: float) -> Found | None:
    """What is found at the largest length between two at which something is."""
    high, low = most, most
    found = at(low)
    while found is None and low > least:
        high, low = low, max(SHORTER * low, least)
        found = at(low)
    for _ in range(RADII):
        if found is None or high < 1.03 * low:
            break
        middle = float(np.sqrt(low * high))
        better = at(middle)
        if better is None:
            high = middle
        else:
            found, low = better, middle
    return found


def _outer(lattice: Lattice, some: Candidates, length: float, least: float, most: int) -> Balls | None:
    cover, balls, reaches = covered(lattice, some, length, least, grown=False, most=most)
    return None if len(cover.open_cells) else (balls.centers, reaches)


def _falling(most: float, least: float) -> list[float]:
    """Radii to try, from the largest on."""
    if not most > 0.0:
        return []
    return [float(length) for length in np.geomspace(most, min(least, 0.25 * most), RADII)]


def _fair(lattice: Lattice, number: int) -> float:
    """Half the radius at which so many balls would fill the shape, in sides."""
    inside = int(np.count_nonzero(lattice.depths > 0.0))
    return float(0.5 * (max(inside, 1) / number / np.pi) ** (1.0 / lattice.grid.dim))


def _all(lattice: Lattice, method: str) -> Candidates:
    """Centers anywhere in the cells, or on the medial axis."""
    if method == "medial":
        found = medial(lattice)
        if len(found.depths):
            return found.thinned(CANDIDATES)
    return on_lattice(lattice).thinned(CANDIDATES)


def _inside(lattice: Lattice, method: str) -> Candidates:
    """Centers inside the shape."""
    some = medial(lattice) if method == "medial" else on_lattice(lattice)
    some = some.where(some.depths > 0.0)
    return (some if len(some.depths) else within(lattice, lattice.middles, inside=True)).thinned(CANDIDATES)
