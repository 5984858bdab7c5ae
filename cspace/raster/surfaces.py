"""Surfaces in space, and what they enclose: robots and obstacles, outer and inner.

The surface is marked exactly (see :mod:`cspace.raster.triangles`). A box that no triangle touches lies on one side of
it, so that its middle, half a cell or more from the surface, decides whether it lies inside: by the winding number
(see :mod:`cspace.raster.winding`), or, of a surface to be filled, by whether untouched boxes join it to those around
the surface.

*Turning.* A rotation cell holds the rotations within an angle a of its representative R. A point p of the robot A is
at most ``2 |p| sin(a / 2)`` from ``R p`` at all of them (about the z axis, ``|p|`` is the distance from it). Cut the
surface into pieces, and let ``g`` be the largest such displacement on a piece, which is that of a corner. Pieces are
small enough for it to vary by no more than about a third of a cell along a side, or a quarter of itself. A point keeps
its distance from the origin as well: it stays in the shell S between the nearest and the farthest point of its piece,
and what comes to a place q was at most ``2 |q| sin(a / 2)`` away, so that g may be that for q, if it is less.

* *Outer.* Let q lie in R' A for a rotation R' of the cell, and not in R A. On the way from R to R', which stays within
  the cell, q passes from the outside of the robot to its inside; so at some rotation R'' on the way it lies on the
  border: ``q = R'' b``, within g of ``R b`` for the piece of b, and in its S. So R A together with all that is within g
  of each piece of R's border, and in the piece's S, holds the robot at every rotation of the cell.
* *Inner.* A point that lies in R A and, for each piece, farther from it than g or not in its S, is on no border on the
  way, and so lies in the robot at every rotation of the cell.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats, Ints
from cspace.errors import InputError
from cspace.grid import SLACK, Grid, check_reach
from cspace.raster import Raster, blank
from cspace.raster.components import Components
from cspace.raster.triangles import mark_touched, mark_within, swept
from cspace.raster.winding import mark_enclosed
from cspace.rotations import STILL, Turn

_MEND: Final = "check its units (metres), {}, or use a larger spacing"

_MOST_FILLED: Final = 2**30
"""Cells of the bounding box of a surface up to which it is filled."""


class Shell(NamedTuple):
    """Closed surfaces that go round an inside: wherever their winding number is not zero.

    Attributes
    ----------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
        They share edges whole, and vertices to the last bit.
    turns : ndarray of int64, shape (F,)
        How often each counts; -1 against its own direction.
    """

    vertices: Floats
    faces: Ints
    turns: Ints


class Skin(NamedTuple):
    """A surface, and what it encloses.

    Attributes
    ----------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
    shell : Shell or None
        What has the same inside, and lies on the surface; None for a surface without an inside.
    fill : callable or None
        Given where its inside is instead whatever its raster encloses; called with the spacing where that is nothing.
    source : str
        For messages.
    """

    vertices: Floats
    faces: Ints
    shell: Shell | None = None
    fill: Callable[[float], None] | None = None
    source: str = "robot"


def surface_cells(skin: Skin, bounds: tuple[Floats, Floats], grid: Grid) -> tuple[Bools, Bools]:
    """Cells that a solid meets, and cells that lie in it.

    What lies outside the grid is clipped; what is filled is decided on the cells of the whole surface. Otherwise
    triangles that do not meet the grid may be missing. ``bounds`` are the lower and upper corner of the whole
    surface's bounding box, metres.

    Raises InputError if a vertex is so far from the grid that rounding could reach the certificate's slack, or a
    surface to be filled reaches far out of the grid.
    """
    lower, upper = ((corner - np.asarray(grid.lower)) / grid.spacing for corner in bounds)
    far = float(max(np.abs(lower).max(), np.abs(upper).max()))
    check_reach(far, skin.source, "the map's corner", _MEND.format("cut it to the map"))
    first, stop = np.floor(lower).astype(np.int64) - 1, np.floor(upper).astype(np.int64) + 2
    shape = np.asarray(grid.shape)
    if not skin.fill:
        first, stop = np.maximum(first, 0), np.minimum(stop, shape)
    elif float(np.prod((stop - first).astype(float))) > _MOST_FILLED:
        raise InputError(
            skin.source,
            f"is {' x '.join(str(n) for n in stop - first)} cells large",
            f"filling looks at all of them, and at most {_MOST_FILLED} are looked at",
            "use a larger spacing, cut the mesh to the map, or pass solid='surface'",
        )
    outer, inner = np.zeros(grid.shape, dtype=np.bool_), np.zeros(grid.shape, dtype=np.bool_)
    if (first >= stop).any() or (first >= shape).any() or (stop <= 0).any():
        return outer, inner
    touched = np.zeros(tuple((stop - first).tolist()), dtype=np.bool_)
    mark_touched(touched, (skin.vertices[skin.faces] - np.asarray(grid.lower)) / grid.spacing - first, 0.0, 1.0)
    enclosed = np.zeros_like(touched)
    if skin.shell is not None:
        points = (skin.shell.vertices - np.asarray(grid.lower)) / grid.spacing - first - 0.5
        mark_enclosed(enclosed, points[skin.shell.faces], skin.shell.turns)
        enclosed &= ~touched
    elif skin.fill:
        _fill(enclosed, touched)
        if not enclosed.any():
            skin.fill(grid.spacing)
    touched |= enclosed
    # The window may reach out of the grid where the surface is filled.
    low, high = np.maximum(first, 0), np.minimum(stop, shape)
    there, here = tuple(map(slice, low, high)), tuple(map(slice, low - first, high - first))
    outer[there], inner[there] = touched[here], enclosed[here]
    return outer, inner


def surface_rasters(skin: Skin, spacing: float, margin: float = 0.0, turn: Turn = STILL) -> tuple[Raster, Raster]:
    """Outer and inner raster of a robot that is a solid; see :meth:`cspace.shapes.Shape.rasters`.

    A surface to be filled counts as itself and the cubes ``h * (m + [-1/2, 1/2]^3)`` that it encloses, turned by the
    representative rotation, without touching them.

    Raises InputError if the robot has too many cells at this spacing, or lies so far from its origin that rounding
    could reach the certificate's slack.
    """
    vertices = turn.apply(skin.vertices) / spacing
    triangles = vertices[skin.faces]
    corners = triangles.reshape(-1, 3)
    radius = margin / spacing
    far = float(np.abs(corners).max() if turn.matrix is None else np.linalg.norm(corners, axis=1).max())
    check_reach(far + radius, skin.source, "its origin", _MEND.format("move it to its origin"))
    swing = float(turn.displacement(np.array([1.0, 0.0, 0.0])))
    parts = swept(triangles, swing, turn.about_z)
    widest = float(parts.growth.max())
    outer, lower = blank(corners.min(axis=0) - radius - widest - 1.0, corners.max(axis=0) + radius + widest + 1.0)
    inner = np.zeros_like(outer)
    shift = np.asarray(lower, dtype=np.float64)
    local = triangles - shift
    # Cells first: the cube m + [-1, 1]^3 is the eight cells that share its middle.
    mark_touched(outer, local, 0.0, 1.0)
    if radius + widest > 0.0:
        mark_within(outer, parts.moved(-shift - 0.5), 0.5, radius)
    for axis in range(3):
        upper, below = np.moveaxis(outer, axis, 0)[:0:-1], np.moveaxis(outer, axis, 0)[-2::-1]
        upper |= below
    if skin.shell is not None:
        mark_enclosed(inner, turn.apply(skin.shell.vertices)[skin.shell.faces] / spacing - shift, skin.shell.turns)
        outer |= inner
        # Where a point is so near to the surface that rounding could matter, nothing is said.
        border = np.zeros_like(inner)
        mark_touched(border, local, 0.0, 0.0, 2.0 * SLACK)
        inner &= ~border
        within = Raster.trimmed(inner, lower)
        if widest > 0.0 and within.cells.size:
            border = ~within.cells  # no other point is looked at
            mark_within(border, parts.moved(-np.array(within.lower, dtype=np.float64)), 0.0, 0.0)
            within = Raster.trimmed(~border, within.lower)
        return Raster.trimmed(outer, lower), within
    if skin.fill:
        near = np.zeros_like(outer)
        mark_touched(near, local, -0.5, 0.5)
        _fill(inner, near)
        if not inner.any():
            skin.fill(spacing)
        outer |= _grown(inner, radius + widest)
        inner &= widest == 0.0
    return Raster.trimmed(outer, lower), Raster.trimmed(inner, lower)


def _fill(inside: Bools, touched: Bools) -> None:
    """Set ``inside`` on the untouched boxes that no untouched ones join to the border of the array."""
    components = Components.of(touched)
    components.fill(inside, ~components.at_border())


def _grown(cells: Bools, radius: float) -> Bools:
    """Lattice points m whose ``m + [-1, 1]^3`` comes within a radius of ``n + [-1/2, 1/2]^3`` for one of the cells n.

    The gap along an axis is less by one half than the distance from the cells grown by one, which adds up to less than
    one; so the result is complete and holds no point farther than one cell too far.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt

    grown = np.asarray(binary_dilation(cells, np.ones((3, 3, 3))))
    if radius > 0.0 and grown.any():
        grown = np.asarray(distance_transform_edt(~grown)) <= radius + math.sqrt(3.0) / 2.0 + 2.0**-20
    return grown
