"""Samples and nearest cells of the free configurations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.errors import ConfigurationError, InputError
from cspace.grid import Grid
from cspace.rotations import TURN, Rotations

Cells = NDArray[np.unsignedinteger[Any]]
"""Flat indices of cells."""

EDGE = 2.0**-20
"""Part of a cell, along its border, that samples keep off, so that rounding never puts one into the next cell."""


def sample_cells(cells: Cells, grid: Grid, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Points uniform over a set of cells.

    Parameters
    ----------
    cells : ndarray of unsigned int, shape (k,)
        Flat indices, at least one.
    grid : Grid
    n : int
    rng : numpy.random.Generator

    Returns
    -------
    ndarray of float64, shape (n, d)
        Metres.
    """
    chosen = cells[rng.integers(len(cells), size=n)]
    corner = np.stack(np.unravel_index(chosen, grid.shape), axis=-1)
    within = rng.uniform(EDGE, 1.0 - EDGE, size=(n, grid.dim))
    return np.asarray(grid.lower + grid.spacing * (corner + within))


def nearest_center(cells: Cells, grid: Grid, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Middle of the cell nearest to a point, of a set of cells given by flat indices; shape (d,), metres."""
    middle = (np.asarray(grid.lower) + grid.upper) / 2
    away = point - middle
    scale = max(1.0, float(np.abs(away).max()))
    found, least = [], []
    for chunk in np.array_split(cells, len(cells) // 2**20 + 1):
        centers = grid.center_of(np.stack(np.unravel_index(chunk, grid.shape), axis=-1))
        # Squared distances less what they share, scaled: those of points very far off would overflow.
        from_middle = centers - middle
        costs = np.square(from_middle).sum(axis=-1) / scale - 2.0 * (from_middle @ (away / scale))
        nearest = int(np.argmin(costs))
        found.append(centers[nearest])
        least.append(costs[nearest])
    return np.asarray(found[int(np.argmin(least))])


def sample_stack(
    cells: Sequence[Cells],
    slice_of: NDArray[np.int64],
    rotations: Rotations,
    grid: Grid,
    n: int,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Configurations ``(x, y, yaw)`` uniform over the volume of the cells of all rotations; shape (n, 3).

    ``cells`` holds flat indices of each slice.
    """
    borders = np.asarray(rotations.borders)
    sizes = np.array([len(part) for part in cells])[slice_of] * np.diff(borders)
    turns = rng.choice(rotations.count, size=n, p=sizes / sizes.sum())
    samples = np.empty((n, 3))
    for number in np.unique(slice_of[turns]):
        chosen = slice_of[turns] == number
        samples[chosen, :2] = sample_cells(cells[number], grid, int(chosen.sum()), rng)
    samples[:, 2] = borders[turns] + np.diff(borders)[turns] * rng.uniform(EDGE, 1.0 - EDGE, n)
    return samples


def nearest_turned(
    cells: Sequence[Cells],
    slice_of: NDArray[np.int64],
    rotations: Rotations,
    grid: Grid,
    q: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Middle ``(x, y, yaw)`` of the nearest cell, half a metre counting as much as a radian."""
    representatives = rotations.representatives
    apart = np.abs((representatives - q[2] + np.pi) % TURN - np.pi) / 2.0
    best, best_distance = q, np.inf
    for k in np.argsort(apart, kind="stable"):
        if apart[k] >= best_distance:
            break
        if len(cells[slice_of[k]]):
            center = nearest_center(cells[slice_of[k]], grid, q[:2])
            distance = float(np.hypot(*(center - q[:2])) + apart[k])
            if distance < best_distance:
                best, best_distance = np.array([*center, representatives[k]]), distance
    return best


def check_rng(rng: object) -> np.random.Generator:
    """``rng`` itself, if it is a Generator."""
    if not isinstance(rng, np.random.Generator):
        raise InputError(
            f"rng is {rng!r}; it must be a numpy.random.Generator, so that a run can be repeated; "
            "pass numpy.random.default_rng(0)"
        )
    return rng


def refuse_empty(cells: Sequence[Cells]) -> None:
    """Raise where no slice has a FREE cell."""
    if not any(len(part) for part in cells):
        raise ConfigurationError(
            "the map has no FREE cell; nothing can be drawn from it; use a smaller robot, a finer spacing, or "
            "unknown='free' where the workspace is a sensor map"
        )
