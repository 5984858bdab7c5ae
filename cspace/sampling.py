"""Samples and nearest cells of the free configurations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspace.errors import ConfigurationError, InputError
from cspace.grid import Grid

EDGE = 2.0**-20
"""Part of a cell, along its border, that samples keep off, so that rounding never puts one into the next cell."""


def sample_cells(cells: NDArray[np.int64], grid: Grid, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Points uniform over a set of cells.

    Parameters
    ----------
    cells : ndarray of int64, shape (k,)
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


def nearest_center(cells: NDArray[np.int64], grid: Grid, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Middle of the cell nearest to a point, of a set of cells given by flat indices; shape (d,), metres."""
    best, best_distance = point, np.inf
    for chunk in np.array_split(cells, len(cells) // 2**20 + 1):
        centers = grid.center_of(np.stack(np.unravel_index(chunk, grid.shape), axis=-1))
        distances = np.square(centers - point).sum(axis=-1)
        nearest = int(np.argmin(distances))
        if distances[nearest] < best_distance:
            best, best_distance = centers[nearest], distances[nearest]
    return best


def check_rng(rng: object) -> np.random.Generator:
    """``rng`` itself, if it is a Generator."""
    if not isinstance(rng, np.random.Generator):
        raise InputError(
            f"rng is {rng!r}; it must be a numpy.random.Generator, so that a run can be repeated; "
            "pass numpy.random.default_rng(0)"
        )
    return rng


def refuse_empty(cells: NDArray[np.int64]) -> None:
    """Raise where there is no FREE cell."""
    if not len(cells):
        raise ConfigurationError(
            "the map has no FREE cell; nothing can be drawn from it; use a smaller robot, a finer spacing, or "
            "unknown='free' where the workspace is a sensor map"
        )
