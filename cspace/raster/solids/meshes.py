"""Rasters of meshes: obstacles on a grid, and robots on the lattice.

The surface is marked exactly (see :mod:`cspace.raster.solids.surface`). A connected set of boxes that no triangle
touches lies on one side of every body, so that one inside test at the middle of one of its boxes, half a cell or more
from the surface, tells for all. Where that one leaves open whether the set is enclosed, others are asked.

What is ambiguous (see :mod:`cspace.raster.solids.inside.tester`) is in the outer raster and not in the inner one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import MAX_COORDINATE, SLACK, Grid
from cspace.raster.raster import Raster, blank
from cspace.raster.solids.components import Components
from cspace.raster.solids.inside import AMBIGUOUS, INSIDE, InsideTester
from cspace.raster.solids.near import mark_within
from cspace.raster.solids.surface import mark_touched

if TYPE_CHECKING:
    from cspace.shapes.mesh import Mesh

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_MOST_SAMPLES: Final = 2**14
"""Boxes that are asked in all, where one of each component does not tell."""

_MOST_FILLED: Final = 2**30
"""Cells of the bounding box of a mesh up to which it is filled."""


def rasterize_mesh(mesh: Mesh, grid: Grid) -> tuple[Bools, Bools]:
    """Cells of a mesh.

    Parameters
    ----------
    mesh : Mesh
        In metres. What lies beyond the grid is clipped; with ``solid="fill"`` the enclosed cells are found on the
        cells of the whole mesh.
    grid : Grid
        In space.

    Returns
    -------
    outer, inner : ndarray of bool, shape grid.shape
        The cells that the mesh meets, and those that lie in it.

    Raises
    ------
    InputError
        If a vertex is so far from the grid that rounding could reach the certificate's slack, or a mesh to be filled
        reaches far beyond the grid.
    """
    local = (mesh.triangles - np.asarray(grid.lower)) / grid.spacing
    # Rounding keeps the order, so that these are the bounds of the triangles to the bit.
    bounds = (np.stack(mesh.bounds) - np.asarray(grid.lower)) / grid.spacing
    far = float(np.abs(bounds).max())
    if far > MAX_COORDINATE:
        raise InputError(
            f"the mesh {mesh.source} reaches {far:.3g} cells from the map's corner; at most {MAX_COORDINATE:.0f} keep "
            "the answers proven against rounding; check its units (metres), cut it to the map, or use a larger spacing"
        )
    first = np.floor(bounds[0]).astype(np.int64) - 1
    stop = np.floor(bounds[1]).astype(np.int64) + 2
    shape = np.asarray(grid.shape)
    if mesh.solid != "fill":
        first, stop = np.maximum(first, 0), np.minimum(stop, shape)
    elif float(np.prod((stop - first).astype(float))) > _MOST_FILLED:
        across = " x ".join(str(n) for n in stop - first)
        raise InputError(
            f"the mesh {mesh.source} is {across} cells large; filling looks at all of them, and at most {_MOST_FILLED} "
            "are looked at; use a larger spacing, cut the mesh to the map, or pass solid='surface'"
        )
    if (first >= stop).any() or (first >= shape).any() or (stop <= 0).any():
        return np.zeros(grid.shape, dtype=np.bool_), np.zeros(grid.shape, dtype=np.bool_)
    outer, inner = _touched_and_inside(mesh, local - first, tuple((stop - first).tolist()))
    return _onto(outer, first, grid.shape), _onto(inner, first, grid.shape)


def mesh_rasters(mesh: Mesh, spacing: float, margin: float = 0.0) -> tuple[Raster, Raster]:
    """Rasters of a robot that is a mesh.

    With ``h`` the spacing and ``A`` the mesh,

    * outer = { m : A comes within the margin of h * (m + [-1, 1]^3) },
    * inner = { m : h * m lies in A }.

    With ``solid="fill"``, ``A`` is the surface and the cubes ``h * (m + [-1/2, 1/2]^3)`` that it encloses without
    touching them.

    Parameters
    ----------
    mesh : Mesh
        In metres, in the robot's frame.
    spacing, margin : float
        Metres.

    Returns
    -------
    outer, inner : Raster

    Raises
    ------
    InputError
        If the mesh has too many cells at this spacing, or lies so far from its origin that rounding could reach the
        certificate's slack.
    """
    bounds, radius = np.stack(mesh.bounds) / spacing, margin / spacing
    far = float(np.abs(bounds).max())
    if far + radius > MAX_COORDINATE:
        raise InputError(
            f"the robot {mesh.source} reaches {far:.3g} cells from its origin; at most {MAX_COORDINATE:.0f} keep the "
            "answers proven against rounding; check its units (metres), move it to its origin, or use a larger spacing"
        )
    reach = radius + 1.0
    outer, lower = blank(bounds[0] - reach, bounds[1] + reach)
    local = mesh.triangles / spacing - np.asarray(lower, dtype=np.float64)
    mark_touched(outer, local, -1.0, 1.0)
    if radius > 0.0:
        mark_within(outer, local, 1.0, radius)
    inner = np.zeros_like(outer)
    if mesh.solid == "fill" or mesh.encloses:
        near = np.zeros_like(outer)
        mark_touched(near, local, -0.5, 0.5)
        components = Components.of(near)
        if mesh.solid == "fill":
            components.fill(inner, ~components.at_border())
            outer |= _grown(inner, radius)
        else:
            _add_lattice_points_inside(mesh, local, near, components, outer, inner)
    return Raster.trimmed(outer, lower), Raster.trimmed(inner, lower)


def _onto(cells: Bools, first: NDArray[np.int64], shape: tuple[int, ...]) -> Bools:
    """Cells, the first of which is cell ``first`` of a grid, as an array over that grid."""
    if cells.shape == shape and not first.any():
        return cells
    out = np.zeros(shape, dtype=np.bool_)
    low, high = np.maximum(first, 0), np.minimum(first + cells.shape, shape)
    there = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    here = tuple(slice(int(a), int(b)) for a, b in zip(low - first, high - first, strict=True))
    out[there] = cells[here]
    return out


def _touched_and_inside(mesh: Mesh, local: Floats, shape: tuple[int, ...]) -> tuple[Bools, Bools]:
    """Outer and inner cells in a window; for a mesh to be filled, one cell of the window around it is clear."""
    outer = np.zeros(shape, dtype=np.bool_)
    inner = np.zeros(shape, dtype=np.bool_)
    mark_touched(outer, local, 0.0, 1.0)
    if mesh.solid == "fill":
        components = Components.of(outer)
        enclosed = ~components.at_border()
        components.fill(inner, enclosed)
        components.fill(outer, enclosed)
    elif mesh.encloses:
        components = Components.of(outer)
        codes = _codes(mesh.inside_tester(local), components, 0.5)
        components.fill(inner, codes == INSIDE)
        components.fill(outer, (codes == INSIDE) | (codes == AMBIGUOUS))
    return outer, inner


def _add_lattice_points_inside(
    mesh: Mesh, local: Floats, near: Bools, components: Components, outer: Bools, inner: Bools
) -> None:
    """Add the lattice points that lie inside a mesh, given those within half a cell of it and components of the rest.

    Boxes of half a cell to each side touch their neighbours, so that untouched ones lie on one side of the surface
    together. The others are tested one by one, but for those so near to the surface that rounding could matter.
    """
    tester = mesh.inside_tester(local)
    codes = _codes(tester, components, 0.0)
    components.fill(inner, codes == INSIDE)
    components.fill(outer, (codes == INSIDE) | (codes == AMBIGUOUS))
    border = np.zeros_like(near)
    mark_touched(border, local, 0.0, 0.0, 2.0 * SLACK)
    points = np.argwhere(near & ~border)
    inner[tuple(points[tester.inside(points.astype(np.float64))].T)] = True


def _codes(tester: InsideTester, components: Components, shift: float) -> NDArray[np.uint8]:
    """The code of each component, asked at one of its boxes, moved by ``shift`` along each axis.

    Where that leaves it ambiguous, because no ray from there is free, others may tell more: what is proven of one point
    of a component holds for all.
    """
    codes = tester.codes(np.asarray(components.members() + shift))
    left = codes == AMBIGUOUS
    if left.any():
        boxes, component = components.samples(left, _MOST_SAMPLES)
        found = tester.codes(np.asarray(boxes + shift))
        told = found != AMBIGUOUS
        codes[component[told]] = found[told]
    return codes


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
