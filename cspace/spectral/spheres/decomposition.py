"""decompose: balls that fill a shape from inside, or cover it."""

from __future__ import annotations

import operator
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import GeometryError, InputError
from cspace.grid import positive
from cspace.spectral.spheres.choice import equal, variable
from cspace.spectral.spheres.choice.candidates import METHODS
from cspace.spectral.spheres.fields import Lattice, Region, region_of
from cspace.spectral.spheres.fields.lattice import MOST, grid_of
from cspace.spectral.spheres.measures import balls_to_shape, measure_of_balls, shape_to_balls
from cspace.spectral.spheres.result import KINDS, Bounds, Kind, Spheres

Floats = NDArray[np.float64]

FINEST: Final = {2: 12.0, 3: 6.0}
"""Cells of the lattice that a tolerance is long, at most."""

COARSEST: Final = 2.6
"""Cells of the lattice that a tolerance is long, at least: a cell's diagonal must be well below it."""

FINER: Final = {2: (1, 4), 3: (1, 4)}
"""How much finer a lattice is tried, in cells, if so few balls do that fewer than :data:`USED` of them are taken."""

USED: Final = 0.9

_USUAL: Final = {2: 150_000, 3: 120_000}
"""Cells of the box round a shape up to which a tolerance may be as many cells as :data:`FINEST` long."""


def decompose(
    shape: Any,
    *,
    kind: Kind = "inner",
    number: int | None = None,
    tolerance: float | None = None,
    method: Literal["greedy", "medial"] = "greedy",
    radius: float | Literal["equal"] | None = None,
    spacing: float | None = None,
    lower: ArrayLike | None = None,
) -> Spheres:
    """Balls that fill a shape from inside, or that cover it.

    Each ball is taken, one after the other, for the cells of a lattice that it adds. What is promised does not rest on
    samples: a ball of kind "inner" is no larger than the distance of its center from the border; for "outer", cells
    whose union covers the shape each lie wholly in one ball.

    Parameters
    ----------
    shape : shapely geometry, Mesh, trimesh.Trimesh, array-like, path-like, mapping or str
        In the plane: polygons (a list of them is their union; lines and points count for "outer"), GeoJSON, WKT, a file
        of these, or vertices (n, 2). In space: whatever :meth:`cspace.Mesh.of` takes. A bitmap of two or three axes,
        indexed in the order of the coordinates, if ``spacing`` is given. Metres.
    kind : {"inner", "outer"}
        Whether every ball lies in the shape, or the union of the balls covers it.
    number : int, optional
        How many balls, at most; fewer where more would add nothing that the lattice shows.
    tolerance : float, optional
        Metres. For "inner", every point of the shape is so near to a ball; for "outer", every point of a ball is so
        near to the shape. Either this or ``number`` is passed.
    method : {"greedy", "medial"}
        Where centers are looked for: where the signed distance, sampled on the lattice, has balls that no other holds,
        from where they are moved; or at the corners of Voronoi cells of points on the border, which lie along the
        medial axis.
    radius : float or "equal", optional
        Of all balls, metres; "equal" finds one. By default each has its own.
    spacing : float, optional
        Side of the cells of a bitmap, metres.
    lower : array-like, shape (d,), optional
        Lower corner of a bitmap, metres; the origin if left out.

    Returns
    -------
    Spheres

    Raises
    ------
    GeometryError
        If the shape is empty or malformed, or has no inside to put balls into.
    InputError
        If both or none of ``number`` and ``tolerance`` are passed, a word or number is not usable, balls cannot meet
        the tolerance or have the radius, or the lattice does not fit into memory.
    FileError
        If a file is missing or malformed.

    Notes
    -----
    The greedy choice is that of V. Chvatal, "A greedy heuristic for the set-covering problem", 1979; the medial axis
    that of N. Amenta, S. Choi and R. K. Kolluri, "The power crust, unions of balls, and the medial axis transform",
    2001. Decompositions of this kind serve M. Behandish and H. Ilies, "Analytic methods for geometric modeling via
    spherical decomposition", 2016.
    """
    _check_word("kind", kind, KINDS)
    _check_word("method", method, METHODS)
    if (number is None) == (tolerance is None):
        both = "both are" if number is not None else "neither is"
        raise InputError(
            f"number is {number!r} and tolerance {tolerance!r}: {both} given; balls are chosen by one of them; pass "
            "e.g. number=64, or tolerance=0.01 in metres"
        )
    length = None if tolerance is None else positive(tolerance, "tolerance")
    size = None if radius is None or isinstance(radius, str) else positive(radius, "radius")
    if isinstance(radius, str):
        _check_word("radius", radius, ("equal",))
    count = None if number is None else _check_number(number)
    region = region_of(shape, spacing, lower)
    if kind == "inner" and not region.measure()[1] > 0.0:
        raise GeometryError(
            "the shape has no inside, and inner balls lie inside; pass kind='outer', or a shape with an area"
        )
    if count is not None and not 0.0 < region.size < np.inf:
        raise InputError(
            f"the shape is {region.size:g} m across; balls are chosen by the cells of a lattice, which it must have; "
            "pass a tolerance in place of a number"
        )
    choose = _inner if kind == "inner" else _outer
    for finer in FINER[region.dim]:
        lattice = Lattice.fine(region, count, finer) if count is not None else _lattice_for(region, length or 0.0)
        sought = size / lattice.side if size is not None else None
        centers, radii = choose(lattice, method, count, length, sought, radius is not None)
        if count is None or radius is not None or len(radii) >= USED * count:
            break
    return _result(lattice, kind, method, centers, radii)


def _inner(
    lattice: Lattice, method: str, number: int | None, tolerance: float | None, radius: float | None, same: bool
) -> tuple[Floats, Floats]:
    """Centers and radii in metres."""
    region, side = lattice.region, lattice.side
    if number is not None:
        found = (
            equal.inner_number(lattice, method, number, radius)
            if same
            else variable.inner_number(lattice, method, number)
        )
        open_cells = 0
    else:
        length = (tolerance or 0.0) / side
        cover, found = (
            equal.inner_tolerance(lattice, method, length, radius)
            if same
            else variable.inner_tolerance(lattice, method, length)
        )
        open_cells = len(cover.open_cells)
    centers, radii = lattice.metres(found[0]), found[1] * side
    depths = region.depths(centers)
    if same:
        radii = np.full(len(radii), min(float(np.min(depths, initial=np.inf)), float(np.max(radii, initial=0.0))))
    else:
        radii = depths
    kept = radii > 0.0
    centers, radii = centers[kept], radii[kept]
    if not len(radii):
        what = f" of radius {radius * side:g} m" if radius is not None else ""
        deepest = max(0.0, float(lattice.depths.max())) * side
        raise InputError(
            f"no ball{what} was found that fits into the shape; inner balls lie inside, and the largest has a "
            f"radius of about {deepest:g} m; pass a smaller radius, kind='outer', or a shape that is less thin"
        )
    if open_cells:
        reached = shape_to_balls(lattice, centers, radii)[1]
        if reached > (tolerance or 0.0):
            raise _unreachable(tolerance or 0.0, reached, len(radii))
    return centers, radii


def _outer(
    lattice: Lattice, method: str, number: int | None, tolerance: float | None, radius: float | None, same: bool
) -> tuple[Floats, Floats]:
    """Centers and radii in metres."""
    side = lattice.side
    if number is not None:
        found = (
            equal.outer_number(lattice, method, number, radius)
            if same
            else variable.outer_number(lattice, method, number)
        )
        if found is None:
            what = f" of radius {radius * side:g} m" if radius is not None else ""
            raise InputError(
                f"{number} ball{'s' * (number > 1)}{what} that cover the shape were not found; their union must hold "
                "all of it; pass a larger number or radius"
            )
    else:
        length = (tolerance or 0.0) / side
        found = (
            equal.outer_tolerance(lattice, method, length, radius)
            if same
            else variable.outer_tolerance(lattice, method, length)
        )
        if found is None:
            raise InputError(
                f"tolerance is {tolerance:g} m, and balls of radius {(radius or 0.0) * side:g} m that cover the shape "
                "and stick out by no more were not found; "
                f"{_reached_by(lattice, method, radius or 0.0)}; pass another radius, or a larger tolerance"
            )
    return lattice.metres(found[0]), found[1] * side


def _reached_by(lattice: Lattice, method: str, radius: float) -> str:
    """How far balls of a radius in sides, that cover the shape, stick out."""
    found = equal.outer_number(lattice, method, 2**40, radius)
    if found is None:
        return "with this radius the shape is not covered at all"
    high = balls_to_shape(lattice.region, lattice.metres(found[0]), found[1] * lattice.side)[1]
    return f"those found stick out by up to {high:g} m"


def _result(lattice: Lattice, kind: Kind, method: str, centers: Floats, radii: Floats) -> Spheres:
    region = lattice.region
    order = np.argsort(-radii, kind="stable")
    centers, radii = centers[order], radii[order]
    far = shape_to_balls(lattice, centers, radii) if kind == "inner" else balls_to_shape(region, centers, radii)
    return Spheres(
        centers=centers,
        radii=radii,
        kind=kind,
        method=method,
        measure=Bounds(*measure_of_balls(centers, radii)),
        shape_measure=Bounds(*region.measure()),
        hausdorff=Bounds(*far),
        shape=region.shape,
    )


def _lattice_for(region: Region, tolerance: float) -> Lattice:
    """A lattice on which a tolerance can be proven."""
    sides = np.maximum(region.bounds[1] - region.bounds[0], 1e-3 * region.size)
    usual = float((np.prod(sides) / _USUAL[region.dim]) ** (1.0 / region.dim))
    spacing = min(max(usual, tolerance / FINEST[region.dim]), tolerance / COARSEST)
    least = COARSEST * float((np.prod(sides) / MOST[region.dim]) ** (1.0 / region.dim))
    if tolerance < least:
        raise InputError(
            f"tolerance is {tolerance:g} m, and the shape {region.size:g} m across; to prove it, too many cells would "
            f"have to be looked at; pass at least about {1.2 * least:.2g} m"
        )
    return Lattice(region, grid_of(region, spacing))


def _unreachable(tolerance: float, reached: float, number: int) -> InputError:
    return InputError(
        f"tolerance is {tolerance:g} m, and the shape is proven to be within {reached:g} m of {number} balls found; "
        "what is thinner than the lattice, or than balls of one radius, has none near; pass a larger tolerance, a "
        "smaller radius, or kind='outer'"
    )


def _check_word(name: str, value: Any, words: Any) -> None:
    if not isinstance(value, str) or value not in words:
        raise InputError(f"{name} is {value!r}; it must be one of {', '.join(map(repr, words))}; pass one of them")


def _check_number(number: Any) -> int:
    try:
        count = operator.index(number)
    except TypeError as error:
        raise InputError(f"number is {number!r}; it must be a whole number; pass e.g. 64") from error
    if count < 1 or isinstance(number, bool):
        raise InputError(f"number is {number!r}; at least one ball is needed; pass e.g. 64")
    return count
