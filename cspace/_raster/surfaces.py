"""Rasters of surfaces in space and of the solids that they enclose: robots and obstacles.

The surface is marked exactly (see :mod:`cspace._raster.triangles`). A box that no triangle touches
lies on one side of it, so its center, half a cell or more from the surface, decides if it lies
inside. The winding number of the surface decides, or, for a surface to be filled, whether
untouched boxes connect it to the exterior.

*Rotation.* A rotation cell contains the rotations within an angle a of its representative R. A
point p of the robot A stays within ``2 |p| sin(a / 2)`` of ``R p`` (about the z axis, ``|p|`` is
the distance from the axis). Cut the surface into pieces, and let ``g`` be the largest displacement
on a piece, attained at a corner. Pieces are so small that it varies by at most about a third of a
cell along a side, or a quarter of itself. A point also keeps its distance from the origin: it stays
in the spherical shell S between the nearest and the farthest point of its piece. A point that
arrives at a position q was at most ``2 |q| sin(a / 2)`` away, so g may be replaced by that
displacement of q if it is smaller.

* *Outer.* Let q lie in R' A for a rotation R' of the cell, and not in R A. On the path from R to
  R', which stays in the cell, q passes from the exterior of the robot to its interior; so at some
  rotation R'' on the path it lies on the boundary: ``q = R'' b``, within g of ``R b`` for the piece
  of b, and in its S. So R A together with all points within g of a piece of R's boundary, and in
  the piece's S, contains the robot at every rotation of the cell.
* *Inner.* Let q lie in R A and, for each piece, be farther from it than g or outside its S. Then q
  is on no boundary along any path, and so lies in the robot at every rotation of the cell.

*Winding numbers* count how often closed surfaces enclose a point. A ray runs from the point along
z, and the sum of its crossings is the winding number: 1 if the ray leaves through the front of a
triangle, -1 if it enters. Half-open intervals decide if an edge is crossed, at a point that all
triangles of the edge compute alike. So the crossings of closed bodies are those of closed surfaces
that differ by the rounding of one interpolation; another interpolation gives the height. Each has
an error below 3 * 2^-30 cells at coordinates of 2^22 cells (see :mod:`cspace._raster.triangles`).
So the winding number is right for a point farther than 2^-27 cells from the surface, even if the
ray meets edges, vertices, or triangles parallel to it: the sum is an integer, without rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy  # loads its submodules on first use

from cspace._grid import SLACK, Grid, check_reach
from cspace._raster import Raster, allocate_bitmap, run_in_slabs
from cspace._raster.triangles import (
    SweptTriangles,
    mark_touched,
    mark_within,
    sweep_triangles,
)
from cspace._rotations import RotationCell
from cspace._support.arrays import Bools, Floats, Ints
from cspace._support.compiling import kernel
from cspace._support.vectors import cut_triangle, interpolate_at, signed_crossing
from cspace.errors import InputError

"""Hint of the errors for surfaces that reach too far."""

# ---- winding numbers -----------------------------------------------------------------------------


class WindingNumber:
    """Winding number of closed surfaces at any point.

    Triangles, shape (n, 3, 3), face outward if their corners run counterclockwise; neighbours share
    corners to the last bit. ``windings``, shape (n,), is the weight of each triangle; -1 reverses
    it.
    """

    def __init__(self, triangles: Floats, windings: Ints) -> None:
        """Keep the triangles with their intervals along x."""
        self._triangles = np.ascontiguousarray(triangles)
        self._windings = windings
        x = self._triangles[..., 0]
        self._low = x.min(axis=1)
        self._high = x.max(axis=1)

    def evaluate(self, points: Floats) -> Ints:
        """Return the winding numbers at points, shape (n,).

        ``points``, shape (n, 3), must be farther from the surfaces than rounding.
        """
        # Sorted along x, the points that may be above or below a triangle are consecutive.
        order = np.argsort(points[:, 0])
        ascending = points[order]
        first = np.searchsorted(ascending[:, 0], self._low, side="left")
        stop = np.searchsorted(ascending[:, 0], self._high, side="right")
        sums = np.zeros(len(points), dtype=np.int64)
        _sum_crossings(sums, ascending, self._triangles, self._windings, first, stop)
        numbers = np.empty_like(sums)
        numbers[order] = sums
        return numbers


def mark_enclosed(out: Bools, triangles: Floats, windings: Ints) -> None:
    """Set ``out[i]`` if closed surfaces enclose lattice point ``i``.

    A point is enclosed if the winding number is not zero. The triangles, shape (n, 3, 3), are in
    cells, in the index frame of ``out``, and may reach beyond it; ``windings`` as for
    :class:`WindingNumber`.
    """
    changes = np.zeros((*out.shape[:2], out.shape[2] + 1), dtype=np.int32)
    run_in_slabs(_mark_enclosed, out, np.ascontiguousarray(triangles), windings, changes)


@kernel
def _sum_crossings(
    sums: Ints,
    points: Floats,
    triangles: Floats,
    windings: Ints,
    first: Ints,
    stop: Ints,
) -> None:
    """Sum signed crossings of upward rays, times ``windings``.

    ``points`` have the shape (n, 3), ``triangles`` (m, 3, 3), ``sums`` (n,), and the rest (m,).
    Points ``first[t]`` to ``stop[t]`` have an x-coordinate within that of triangle ``t``.
    """
    for t in range(len(triangles)):
        y0, y1, y2 = triangles[t, :, 1]
        low_y = min(y0, y1, y2)
        high_y = max(y0, y1, y2)
        for p in range(first[t], stop[t]):
            x, y, z = points[p]
            if low_y <= y <= high_y:
                sums[p] += signed_crossing(triangles[t], x, y, z) * windings[t]


@kernel
def _mark_enclosed(
    out: Bools, triangles: Floats, windings: Ints, changes: Ints, start: int, stop: int
) -> None:
    """Set ``out[i]`` if surfaces enclose lattice point ``i``.

    Covers first indices in ``range(start, stop)``. ``changes``, shape (nx, ny, nz + 1), has room
    for the changes of the winding number along z.
    """
    _, ny, nz = out.shape
    for t in range(len(triangles)):
        if windings[t] == 0:
            continue
        x0, x1, x2 = triangles[t, :, 0]
        first_x = max(start, math.ceil(min(x0, x1, x2)))
        stop_x = min(stop, math.ceil(max(x0, x1, x2)))
        for i in range(first_x, stop_x):
            facing, low_y, low_z, high_y, high_z = cut_triangle(triangles[t], float(i))
            first_y = max(0, math.ceil(low_y))
            stop_y = min(ny, math.ceil(high_y))
            for j in range(first_y, stop_y):
                z = interpolate_at(float(j), low_y, high_y, low_z, high_z)
                first_above = min(max(math.ceil(z), 0), nz)
                # From below, a ray enters through triangles that face down.
                changes[i, j, first_above] -= facing * windings[t]
    for i in range(start, stop):
        for j in range(ny):
            winding = 0
            for k in range(nz):
                winding += changes[i, j, k]
                if winding != 0:
                    out[i, j, k] = True


# ---- surfaces and solids -------------------------------------------------------------------------


class SolidSurface(NamedTuple):
    """A surface with its interior.

    Attributes
    ----------
    triangles : ndarray of float64, shape (n, 3, 3)
        Metres.
    shell : ndarray of float64, shape (m, 3, 3)
        Triangles of closed surfaces, which share whole edges, and corners to the last bit. Points
        of non-zero winding number lie in the interior.
    windings : ndarray of int64, shape (m,)
        Weight of each triangle of the shell; -1 reverses it, and 0 leaves it out.
    on_empty : callable or None
        If given, the surface is filled: its interior is whatever its raster encloses. It is called
        with the spacing if the raster encloses nothing.
    source : str
        Name of the shape in messages.
    """

    triangles: Floats
    shell: Floats
    windings: Ints
    on_empty: Callable[[float], None] | None = None
    source: str = "robot"


def surface_cells(solid: SolidSurface, grid: Grid) -> tuple[Bools, Bools]:
    """Rasterise a solid obstacle.

    Returns the cells that it meets and the cells that lie in it. The solid is clipped to the grid,
    but filling uses the cells of the whole surface.

    Raises InputError if a vertex is so far from the grid that rounding could exceed ``SLACK``, or
    if a surface to be filled has too many cells.
    """
    triangles = (solid.triangles - np.asarray(grid.lower)) / grid.spacing
    check_reach(float(np.abs(triangles).max()), solid.source, "the map's corner")
    first = np.floor(triangles.min(axis=(0, 1))).astype(np.int64) - 1
    stop = np.floor(triangles.max(axis=(0, 1))).astype(np.int64) + 2
    first_in_grid = np.maximum(first, 0)
    stop_in_grid = np.minimum(stop, grid.shape)
    # The window may reach out of the grid if the surface is filled.
    if solid.on_empty:
        _check_filled_size(stop - first, solid.source)
    else:
        first = first_in_grid
        stop = stop_in_grid
    outer = np.zeros(grid.shape, dtype=np.bool_)
    inner = np.zeros(grid.shape, dtype=np.bool_)
    if (first_in_grid >= stop_in_grid).any():
        return outer, inner
    touched = np.zeros((stop - first).tolist(), dtype=np.bool_)
    mark_touched(touched, triangles - first, 0.0, 1.0)
    if solid.on_empty:
        enclosed = _find_enclosed(touched, grid.spacing, solid.on_empty)
    else:
        enclosed = np.zeros_like(touched)
        shell = (solid.shell - np.asarray(grid.lower)) / grid.spacing - first - 0.5
        mark_enclosed(enclosed, shell, solid.windings)
        enclosed &= ~touched
    in_grid = tuple(map(slice, first_in_grid, stop_in_grid))
    in_window = tuple(map(slice, first_in_grid - first, stop_in_grid - first))
    inner[in_grid] = enclosed[in_window]
    touched |= enclosed
    outer[in_grid] = touched[in_window]
    return outer, inner


def surface_rasters(
    solid: SolidSurface,
    spacing: float,
    margin: float,
    rotation: RotationCell,
) -> tuple[Raster, Raster]:
    """Rasterise a solid robot; see :meth:`cspace._shapes.Shape.rasters`.

    Returns the outer and the inner raster. A surface to be filled counts as itself and the enclosed
    cubes ``h * (m + [-1/2, 1/2]^3)`` that do not touch it, at the representative rotation.

    Raises InputError if the robot has too many cells at this spacing, or lies so far from its
    origin that rounding could exceed ``SLACK``.
    """
    triangles = rotation.apply(solid.triangles) / spacing
    corners = triangles.reshape(-1, 3)
    radius = margin / spacing
    is_turned = rotation.matrix is not None
    distances = np.linalg.norm(corners, axis=1) if is_turned else np.abs(corners)
    check_reach(float(distances.max()) + radius, solid.source, "its origin")
    unit_displacement = float(rotation.displacement(np.array([1.0, 0.0, 0.0])))
    swept = sweep_triangles(triangles, unit_displacement, rotation.about_z)
    growth = unit_displacement * float(swept.farthest.max())
    room = radius + growth + 1.0
    outer, lower = allocate_bitmap(corners.min(axis=0) - room, corners.max(axis=0) + room)
    origin = np.asarray(lower, dtype=np.float64)
    local = triangles - origin
    # Cells first: the cube m + [-1, 1]^3 consists of the eight cells that share its center.
    mark_touched(outer, local, 0.0, 1.0)
    if radius + growth > 0.0:
        mark_within(outer, swept.translate(-origin - 0.5), 0.5, radius)
    _unite_with_previous_cells(outer)
    inner = np.zeros_like(outer)
    if solid.on_empty is None:
        shell = rotation.apply(solid.shell) / spacing - origin
        mark_enclosed(inner, shell, solid.windings)
        outer |= inner
        return Raster.from_bitmap(outer, lower), _find_always_enclosed(inner, lower, local, swept)
    mark_touched(inner, local, -0.5, 0.5)
    inner = _find_enclosed(inner, spacing, solid.on_empty)
    outer |= _dilate(inner, radius + growth)
    inner &= growth == 0.0
    return Raster.from_bitmap(outer, lower), Raster.from_bitmap(inner, lower)


def _unite_with_previous_cells(cells: Bools) -> None:
    """Unite cells with previous neighbours along all axes."""
    for axis in range(3):
        layers = np.moveaxis(cells, axis, 0)
        # From the last layer down, so that a layer is read before it changes.
        layers_from_last = layers[::-1]
        np.logical_or(layers_from_last[:-1], layers_from_last[1:], out=layers_from_last[:-1])


def _check_filled_size(shape: Ints, source: str) -> None:
    """Refuse to fill a surface of too many cells."""
    # Maximum number of cells in the bounding box of a surface to be filled.
    max_filled_cells = 2**30
    if np.prod(shape.astype(float)) > max_filled_cells:
        size = " x ".join(map(str, shape))
        raise InputError(
            source,
            f"is {size} cells large",
            f"at most {max_filled_cells} can be filled",
        )


def _find_always_enclosed(
    inner: Bools,
    lower: tuple[int, ...],
    triangles: Floats,
    swept: SweptTriangles,
) -> Raster:
    """Return the raster of the points that are enclosed at all rotations.

    ``inner`` marks the points enclosed at the representative rotation, from the offset ``lower``
    on. ``triangles`` are in the frame of ``inner``; ``swept`` are the same, about the origin.
    """
    # Leave out points so near to the surface that rounding could matter.
    near_surface = np.zeros_like(inner)
    mark_touched(near_surface, triangles, 0.0, 0.0, 2.0 * SLACK)
    within = Raster.from_bitmap(inner & ~near_surface, lower)
    if swept.unit_displacement == 0.0 or not within.cells.size:
        return within
    near_surface = ~within.cells  # so that other points are skipped
    local_swept = swept.translate(-np.array(within.lower, dtype=np.float64))
    mark_within(near_surface, local_swept, 0.0, 0.0)
    return Raster.from_bitmap(~near_surface, within.lower)


def _find_enclosed(touched: Bools, spacing: float, on_empty: Callable[[float], None]) -> Bools:
    """Return a mask of boxes enclosed by touched ones.

    No chain of untouched boxes connects these to the boundary of the array. Calls ``on_empty`` with
    the spacing if there are none.
    """
    labels, count = scipy.ndimage.label(~touched)
    is_enclosed = np.ones(count + 1, dtype=np.bool_)
    is_enclosed[0] = False  # the label of touched boxes
    for axis in range(3):
        border_labels = labels.take((0, -1), axis)
        is_enclosed[border_labels] = False
    if not is_enclosed.any():
        on_empty(spacing)
    return np.asarray(is_enclosed[labels])


def _dilate(cells: Bools, radius: float) -> Bools:
    """Return a mask of lattice points with cubes near set cells.

    These are the points m whose ``m + [-1, 1]^3`` is within the radius of ``n + [-1/2, 1/2]^3`` for
    a cell n. Along each axis, the gap is half a cell less than the distance from the cells grown by
    one, less than one cell in total. So the result is complete and has no point more than one cell
    too far.
    """
    # The lattice points of a cube and its neighbours touch it in any case.
    grown = np.asarray(scipy.ndimage.binary_dilation(cells, np.ones((3, 3, 3))))
    if radius == 0.0 or not grown.any():
        return grown
    distances = np.asarray(scipy.ndimage.distance_transform_edt(~grown))
    half_diagonal = math.sqrt(3.0) / 2.0
    # The last term covers the rounding of the distances.
    return distances <= radius + half_diagonal + 2.0**-20
