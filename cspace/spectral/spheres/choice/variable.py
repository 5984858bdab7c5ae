"""Balls of different radii."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.spectral.spheres.choice.candidates import METHODS, Candidates, within
from cspace.spectral.spheres.choice.cover import Cover, covered
from cspace.spectral.spheres.fields import Lattice

Floats = NDArray[np.float64]
Balls = tuple[Floats, Floats]

ROUNDS: Final = 6
"""How often every ball is moved, at most."""

HALVINGS: Final = 12
"""Steps in which the length is found by which balls stick out."""

_MANY: Final = 2**40


def inner_number(lattice: Lattice, method: str, number: int) -> Balls:
    """Balls in a shape, each as large as it allows, so many that add most; centers and radii in sides."""
    from cspace.spectral.spheres.choice import _kernels

    some = _inside(lattice, method)
    cover = Cover(lattice, whole=False)
    chosen = cover.choose(some, some.depths, number)
    if not len(chosen) and len(some.depths):  # so thin a shape that no middle lies in it
        chosen = np.argsort(-some.depths)[:number]
    centers, radii = some.centers[chosen].copy(), some.depths[chosen].copy()
    border = lattice.region.border
    if method == "greedy":
        _kernels.polish(cover.times, border.tree, centers, radii, lattice.corner, lattice.side, border.slack, ROUNDS)
    return centers, radii


def inner_tolerance(lattice: Lattice, method: str, tolerance: float) -> tuple[Cover, Balls]:
    """Few balls in a shape that, grown by a length in sides, cover it; the cover tells what they did not reach."""
    cover, balls, reaches = covered(lattice, _inside(lattice, method), tolerance, 0.0, grown=True, most=_MANY)
    left = cover.trim(balls.centers, reaches, balls.depths)
    return cover, (balls.centers[left > 0.0], balls.depths[left > 0.0])


def outer_tolerance(lattice: Lattice, method: str, tolerance: float) -> Balls:
    """Few balls that cover a shape and stick out by no more than a length in sides."""
    found = _outer(lattice, METHODS[method](lattice), tolerance, _MANY)
    return found if found is not None else (np.empty((0, 3)), np.empty(0))


def outer_number(lattice: Lattice, method: str, number: int) -> Balls | None:
    """At most so many balls that cover a shape and stick out little; None where there are none."""
    candidates = METHODS[method](lattice)
    low, high = 1.001 * lattice.diagonal, 2.0 * lattice.region.size / lattice.side
    found = _outer(lattice, candidates, high, number)
    for _ in range(HALVINGS):
        if high < 1.02 * low:
            break
        middle = float(np.sqrt(low * high))
        better = _outer(lattice, candidates, middle, number)
        if better is None:
            low = middle
        else:
            found, high = better, middle
    return found


def _outer(lattice: Lattice, candidates: Candidates, grown: float, most: int) -> Balls | None:
    """Balls that cover a shape and stick out by a length in sides at most; None where more are needed than so many."""
    cover, balls, reaches = covered(lattice, candidates, grown, -np.inf, grown=True, most=most)
    if len(cover.open_cells):
        return None
    left = cover.trim(balls.centers, reaches, balls.depths)
    return balls.centers[left > 0.0], left[left > 0.0]


def _inside(lattice: Lattice, method: str) -> Candidates:
    """Candidates whose centers are inside the shape."""
    some = METHODS[method](lattice)
    some = some.where(some.depths > 0.0)
    return some if len(some.depths) else within(lattice, lattice.middles, inside=True)
