"""decompose: balls that fill a shape from inside, or cover it."""

from __future__ import annotations

import operator
from collections.abc import Callable
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import GeometryError, InputError
from cspace.grid import positive
from cspace.spectral.cover import Balls, Cover
from cspace.spectral.inputs import check_kind
from cspace.spectral.measures import balls_to_shape, measure_of_balls, shape_to_balls
from cspace.spectral.regions import Lattice, Region, shape_of
from cspace.spectral.spheres import KINDS, Bounds, Kind, Spheres

Floats = NDArray[np.float64]

FINER: Final = (1, 4)
"""How much finer a lattice is tried, in cells, if so few balls do that fewer than :data:`USED` of them are taken."""

USED: Final = 0.9

STEPS: Final = 12
"""Lengths by which balls may stick out that are tried, at most."""

CANDIDATES: Final = 6_000
"""Centers that are looked at first, at most."""

NEIGHBOURS: Final = 2
"""How far, in cells, a ball is looked for that holds another."""

_LOST: Final = 0.02
"""Part of the way between two middles that a ball may stick out of another one and still count as held by it."""

_CUTS: Final = (1, 2, 4, 8, 16)
"""Into how many parts a cell's sides are cut where no ball lies near."""

_ANY: Final = 2**40
"""More balls than there are."""


def decompose(
    shape: Any,
    *,
    kind: Kind = "inner",
    number: int | None = None,
    tolerance: float | None = None,
) -> Spheres:
    """Balls that fill a shape from inside, or that cover it.

    Each ball is taken, one after the other, for the cells of a lattice that it adds (V. Chvatal, "A greedy heuristic
    for the set-covering problem", 1979). Its center is looked for where the signed distance, sampled on the lattice,
    has a ball that no other holds, along the medial axis. What is promised does not rest on samples: a ball of kind
    "inner" is no larger than the distance of its center from the border; for "outer", cells whose union covers the
    shape each lie wholly in one ball.

    Parameters
    ----------
    shape : Shape, shapely geometry, trimesh.Trimesh, array-like, path-like, mapping or str
        In the plane: polygons (a list of them is their union; lines and points count for "outer"), GeoJSON, WKT, a file
        of these, or vertices (n, 2). In space: whatever :meth:`cspace.Mesh.of` takes. For cells, pass the shape
        ``cspace.shapes.Voxels.of(cells, spacing)``. Metres.
    kind : {"inner", "outer"}
        Whether every ball lies in the shape, or the union of the balls covers it.
    number : int, optional
        How many balls, at most; fewer where more would add nothing that the lattice shows.
    tolerance : float, optional
        Metres. For "inner", every point of the shape is so near to a ball; for "outer", every point of a ball is so
        near to the shape. Either this or ``number`` is passed.

    Raises
    ------
    GeometryError
        If the shape is empty or malformed, or has no inside to put balls into.
    InputError
        If both or none of ``number`` and ``tolerance`` are passed, a word or number is not usable, balls cannot meet
        the tolerance, or the lattice does not fit into memory.
    FileError
        If a file is missing or malformed.
    """
    check_kind(kind, "kind", KINDS)
    if (number is None) == (tolerance is None):
        found = f"is {number!r} and tolerance {tolerance!r}: {'neither is' if number is None else 'both are'} given"
        mend = "pass e.g. number=64, or tolerance=0.01 in metres"
        raise InputError("number", found, "balls are chosen by one of them", mend)
    length = None if tolerance is None else positive(tolerance, "tolerance")
    count = None if number is None else _check_number(number)
    region = Region(shape_of(shape))
    if kind == "inner" and not region.measure[1] > 0.0:
        mend = "pass kind='outer', or a shape with an area or volume"
        raise GeometryError("shape", "has no inside", "inner balls lie inside", mend)
    if count is not None and not 0.0 < region.size < np.inf:
        rule = "balls are counted by the cells of a lattice, which it must have"
        found = f"is {number}, and the shape {region.size:g} m across"
        raise InputError("number", found, rule, "pass a tolerance in place of a number")
    for finer in FINER:
        lattice = Lattice.fine(region, count, finer) if count else Lattice.within(region, length or 0.0)
        centers, radii = (_inner if kind == "inner" else _outer)(lattice, count, length)
        if not count or len(radii) >= USED * count:
            break
    order = np.argsort(-radii, kind="stable")
    centers, radii = centers[order], radii[order]
    gap = shape_to_balls(lattice, centers, radii) if kind == "inner" else balls_to_shape(region, centers, radii)
    measures = Bounds(*measure_of_balls(centers, radii)), Bounds(*region.measure)
    return Spheres(centers, radii, kind, *measures, Bounds(*gap), region.shape)


def _check_number(number: Any) -> int:
    try:
        count = 0 if isinstance(number, bool) else operator.index(number)
    except TypeError:
        count = 0
    if count < 1:
        raise InputError("number", f"is {number!r}", "it must be a whole number, one at least", "pass e.g. 64")
    return count


# ---- which balls -----------------------------------------------------------------------------------------------------


def _inner(lattice: Lattice, number: int | None, tolerance: float | None) -> tuple[Floats, Floats]:
    """Centers and radii of balls in a shape, metres: so many that add most, or that cover it with a tolerance added."""
    inside = _maximal(lattice)
    inside = inside.where(inside.depths > 0.0)
    if not len(inside.depths):
        inside = _finer(lattice, lattice.middles)
    reached = 0.0
    if number is None:
        cover, balls = _covered(lattice, inside, (tolerance or 0.0) / lattice.side, inside=True)
        reached = np.inf if len(cover.open_cells) else 0.0
        centers = balls.centers[cover.trim(balls) > 0.0]
    else:
        cover = Cover(lattice, whole=False)
        chosen = cover.choose(inside, number)
        if not len(chosen):  # so thin a shape that no middle lies in it
            chosen = np.argsort(-inside.depths)[:number]
        centers = inside.centers[chosen]
        cover.polish(centers, inside.depths[chosen])
    centers = lattice.metres(centers)
    radii = lattice.region.depths(centers)  # found anew, a proof
    centers, radii = centers[radii > 0.0], radii[radii > 0.0]
    if not len(radii):
        found, rule = "has room for no ball that was found", "inner balls lie inside"
        raise InputError("shape", found, rule, "pass kind='outer', or a shape that is less thin")
    if reached and (reached := shape_to_balls(lattice, centers, radii)[1]) > (tolerance or 0.0):
        found = f"is {tolerance:g} m, and the shape is proven to be within {reached:g} m of {len(radii)} balls"
        rule, mend = "what is thinner than the lattice has none near", "pass a larger tolerance, or kind='outer'"
        raise InputError("tolerance", found, rule, mend)
    return centers, radii


def _outer(lattice: Lattice, number: int | None, tolerance: float | None) -> tuple[Floats, Floats]:
    """Centers and radii of balls that cover a shape, in metres: at most so many, or that stick out by a tolerance."""
    candidates = _maximal(lattice)

    def at(length: float) -> Balls | None:
        """Balls that stick out by no more; None where more are needed than so many."""
        cover, balls = _covered(lattice, candidates, length, inside=False, most=number or _ANY)
        if len(cover.open_cells):
            return None
        balls = balls._replace(reaches=cover.trim(balls))
        return balls.where(balls.reaches > 0.0)

    if tolerance is not None:
        balls = at(tolerance / lattice.side)
    else:
        balls = _least(at, 1.001 * lattice.diagonal, 2.0 * lattice.region.size / lattice.side)
    if balls is None:
        name, value = ("number", number) if tolerance is None else ("tolerance", tolerance)
        found = f"is {value:g}, and balls that cover the shape within it were not found"
        raise InputError(name, found, "their union must hold all of it", "pass a larger one")
    return lattice.metres(balls.centers), balls.reaches * lattice.side


def _covered(
    lattice: Lattice, candidates: Balls, reach: float, *, inside: bool, most: int = _ANY
) -> tuple[Cover, Balls]:
    """Choose balls, as large as their depths and ``reach``, in sides, until every cell lies in one, or there are so
    many: then the cover has open cells."""
    from scipy.spatial import KDTree

    cover = Cover(lattice, whole=True)
    balls = candidates.where(np.zeros(0, dtype=np.int64))
    # What candidates leave open, middles of cells near by may hold, and else finer points of a shape.
    for stage in range(3):
        left = cover.open_cells
        if not len(left) or len(balls.reaches) == most:
            break
        some = _finer(lattice, left) if stage == 2 else (candidates, _on_lattice(lattice))[stage]
        some = some._replace(reaches=some.depths + reach)
        some = some.where(some.depths >= (0.0 if inside else -np.inf))
        if len(left) < len(lattice.middles):  # those that reach none add nothing
            bound = max(float(some.reaches.max(initial=0.0)), 1.0)
            some = some.where(KDTree(left).query(some.centers, distance_upper_bound=bound)[0] <= some.reaches)
        balls = balls.joined(some.where(cover.choose(some, most - len(balls.reaches))))
    return cover, balls


def _least(at: Callable[[float], Balls | None], bad: float, good: float) -> Balls | None:
    """What there is at the least length, between two, at which there is something; None where there is at none."""
    best = at(good)
    for _ in range(STEPS):
        if best is None or good < 1.02 * bad:
            break
        middle = float(np.sqrt(good * bad))
        found = at(middle)
        best, bad, good = (best, middle, good) if found is None else (found, bad, middle)
    return best


# ---- where they are looked for ---------------------------------------------------------------------------------------


def _on_lattice(lattice: Lattice) -> Balls:
    """As large as they fit round every middle of a cell."""
    return Balls(lattice.middles, lattice.depths, lattice.depths)


def _maximal(lattice: Lattice) -> Balls:
    """Those of the lattice that no other near by holds, but for a sliver.

    They lie along the medial axis. Balls that are grown by one length hold each other just as before.
    """
    shape = lattice.cells.shape
    depths = np.full(shape, -np.inf)
    depths[lattice.cells] = lattice.depths
    around = np.pad(depths, NEIGHBOURS, constant_values=-np.inf)
    held = np.zeros(shape, dtype=np.bool_)
    steps = range(-NEIGHBOURS, NEIGHBOURS + 1)
    for offset in product(*(steps if half else (0,) for half in lattice.half.tolist())):
        way = float(np.linalg.norm(offset))
        if way > 0.0:
            window = tuple(slice(NEIGHBOURS + o, NEIGHBOURS + o + n) for o, n in zip(offset, shape, strict=True))
            held |= around[window] >= depths + (1.0 - _LOST) * way
    found = _on_lattice(lattice).where(~held[lattice.cells])
    few = np.arange(len(found.depths)) % max(1, -(-len(found.depths) // CANDIDATES)) == 0
    if len(few):
        few[np.argmax(found.depths)] = True
    return found.where(few)


def _finer(lattice: Lattice, cells: Floats) -> Balls:
    """Those round a point in each of some cells, told by their middles, that lies in the shape: where one was found."""
    points = _on_lattice(lattice).where(np.zeros(0, dtype=np.int64))
    for cuts in _CUTS:
        if not len(cells):
            break
        ticks = [(np.arange(cuts) + 0.5) / cuts - 0.5 if half else np.zeros(1) for half in lattice.half]
        trials = cells[:, None] + np.array(list(product(*ticks)))
        depths = lattice.depths_at(trials.reshape(-1, 3)).reshape(len(cells), -1)
        rows, best = np.arange(len(cells)), depths.argmax(axis=1)
        deepest = Balls(trials[rows, best], depths[rows, best], depths[rows, best])
        points = points.joined(deepest.where(deepest.depths > 0.0))
        cells = cells[deepest.depths <= 0.0]
    return points
