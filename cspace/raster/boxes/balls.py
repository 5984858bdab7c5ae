"""Balls and points, as obstacles and as robots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import MAX_COORDINATE, Grid
from cspace.raster.boxes.rounded import mark_inside, mark_touched
from cspace.raster.raster import Raster, blank

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]


def rasterize_balls(centers: Floats, radii: Floats, grid: Grid) -> tuple[Bools, Bools]:
    """Cells of a union of balls; discs in the plane; points where the radius is zero.

    Parameters
    ----------
    centers : ndarray, shape (n, d)
        Metres.
    radii : ndarray, shape (n,)
        Metres, zero or above.
    grid : Grid
        Of d axes, 2 or 3. What lies beyond it is clipped.

    Returns
    -------
    outer : ndarray of bool, shape grid.shape
        Cells that meet a ball. A point on a border is in all the cells that share it.
    inner : ndarray of bool, shape grid.shape
        Cells that lie wholly in one ball; none for points. Both are safe against rounding as
        :mod:`cspace.raster.boxes.rounded` tells.

    Raises
    ------
    InputError
        If a ball reaches so far from the grid that rounding could reach the certificate's slack.
    """
    outer = np.zeros(grid.shape, dtype=np.bool_)
    inner = np.zeros(grid.shape, dtype=np.bool_)
    local = (np.asarray(centers, dtype=np.float64) - grid.lower) / grid.spacing
    sizes = np.asarray(radii, dtype=np.float64) / grid.spacing
    _check_reach(local, sizes)
    # A ball that stays a cell clear of the grid meets none of its cells.
    near = ((local + sizes[:, None] > -1.0) & (local - sizes[:, None] < np.add(grid.shape, 1.0))).all(axis=1)
    local, sizes = local[near], sizes[near]
    if grid.dim == 2:
        # A disc is a ball pulled out along a middle axis of one cell, which lies deep inside it.
        lows, highs = np.insert(local, 1, -1.0, axis=1), np.insert(local, 1, 2.0, axis=1)
        outer_cells, inner_cells = outer[:, None], inner[:, None]
    else:
        lows, highs, outer_cells, inner_cells = local, local, outer, inner
    mark_touched(outer_cells, lows, highs, sizes, 0.0, 1.0)
    # The diameter of a ball that holds a cell is at least the cell's diagonal.
    solid = 4.0 * sizes**2 >= grid.dim
    mark_inside(inner_cells, lows[solid], highs[solid], sizes[solid], 0.0, 1.0)
    return outer, inner


def solid_ball_rasters(centers: Floats, radii: Floats, spacing: float, margin: float = 0.0) -> tuple[Raster, Raster]:
    """Rasters of a robot that is a union of balls in R^3.

    With ``h`` the spacing and ``A`` the robot, grown by the margin on the outer side,

    * outer = { m : A meets h * (m + [-1, 1]^3) },
    * inner = { m : h * m lies in A }.

    Parameters
    ----------
    centers : ndarray, shape (n, 3)
        In the robot's frame, metres.
    radii : ndarray, shape (n,)
        Metres, above zero.
    spacing, margin : float
        Metres.

    Returns
    -------
    outer, inner : Raster

    Raises
    ------
    InputError
        If the robot is too many cells large.
    """
    points = np.asarray(centers, dtype=np.float64) / spacing
    inner_radii, outer_radii = np.asarray(radii) / spacing, (np.asarray(radii) + margin) / spacing
    reach = outer_radii[:, None] + 1.0
    outer, lower = blank((points - reach).min(axis=0), (points + reach).max(axis=0))
    inner = np.zeros_like(outer)
    local = points - np.asarray(lower, dtype=np.float64)
    mark_touched(outer, local, local, outer_radii, -1.0, 1.0)
    mark_inside(inner, local, local, inner_radii, 0.0, 0.0)
    return Raster.trimmed(outer, lower), Raster.trimmed(inner, lower)


def _check_reach(local: Floats, sizes: Floats) -> None:
    """Refuse balls, in cells from the grid's corner, that are too far or too large for the slack."""
    far = float((np.abs(local).max(axis=1, initial=0.0) + sizes).max(initial=0.0))
    if far > MAX_COORDINATE:
        raise InputError(
            f"an obstacle reaches {far:.3g} cells from the map's corner; at most {MAX_COORDINATE:.0f} keep the answers "
            "proven against rounding; clip the obstacles to the map, or check their units (metres)"
        )
