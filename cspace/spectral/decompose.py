"""decompose: balls that fill a shape from inside, or cover it."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import GeometryError, InputError
from cspace.grid import positive
from cspace.spectral.cover import Cover
from cspace.spectral.inputs import check_kind
from cspace.spectral.measures import balls_to_shape, measure_of_balls, shape_to_balls
from cspace.spectral.regions import Lattice, region_of
from cspace.spectral.spheres import KINDS, Bounds, Kind, Spheres

Floats = NDArray[np.float64]
Balls = tuple[Floats, Floats]
"""Centers, shape (n, 3), and radii, shape (n,), in sides of a lattice's cell."""

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
        raise InputError(
            "number",
            f"is {number!r} and tolerance {tolerance!r}: {'neither is' if number is None else 'both are'} given",
            "balls are chosen by one of them",
            "pass e.g. number=64, or tolerance=0.01 in metres",
        )
    length = None if tolerance is None else positive(tolerance, "tolerance")
    count = None if number is None else _check_number(number)
    region = region_of(shape)
    if kind == "inner" and not region.measure[1] > 0.0:
        raise GeometryError(
            "shape", "has no inside", "inner balls lie inside", "pass kind='outer', or a shape with an area or volume"
        )
    if count is not None and not 0.0 < region.size < np.inf:
        raise InputError(
            "number",
            f"is {number}, and the shape {region.size:g} m across",
            "balls are counted by the cells of a lattice, which it must have",
            "pass a tolerance in place of a number",
        )
    for finer in FINER:
        lattice = Lattice.within(region, length) if length is not None else Lattice.fine(region, count or 0, finer)
        balls = (_inner if kind == "inner" else _outer)(lattice, count, length)
        if count is None or len(balls[1]) >= USED * count:
            break
    order = np.argsort(-balls[1], kind="stable")
    centers, radii = balls[0][order], balls[1][order]
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


def _inner(lattice: Lattice, number: int | None, tolerance: float | None) -> Balls:
    """Balls in a shape, in metres: so many that add most, or that, grown by a tolerance, cover it."""
    inside = _maximal(lattice)
    inside = inside.where(inside.depths > 0.0)
    if not len(inside.depths):
        inside = _within(lattice, lattice.middles, inside=True)
    whole = True
    if number is None:
        cover, balls, reaches = _covered(lattice, inside, (tolerance or 0.0) / lattice.side, inside=True)
        whole = not len(cover.open_cells)
        centers = balls.centers[cover.trim(balls.centers, reaches, balls.depths) > 0.0]
    else:
        cover = Cover(lattice, whole=False)
        chosen = cover.choose(inside.centers, inside.depths, number)
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
    if not whole and (reached := shape_to_balls(lattice, centers, radii)[1]) > (tolerance or 0.0):
        found = f"is {tolerance:g} m, and the shape is proven to be within {reached:g} m of {len(radii)} balls"
        rule, mend = "what is thinner than the lattice has none near", "pass a larger tolerance, or kind='outer'"
        raise InputError("tolerance", found, rule, mend)
    return centers, radii


def _outer(lattice: Lattice, number: int | None, tolerance: float | None) -> Balls:
    """Balls that cover a shape, in metres: at most so many, or that stick out by no more than a tolerance."""
    candidates = _maximal(lattice)

    def at(length: float) -> Balls | None:
        """Balls that stick out by no more; None where more are needed than so many."""
        cover, balls, reaches = _covered(lattice, candidates, length, inside=False, most=number or _ANY)
        if len(cover.open_cells):
            return None
        reaches = cover.trim(balls.centers, reaches, balls.depths)
        return balls.centers[reaches > 0.0], reaches[reaches > 0.0]

    if tolerance is not None:
        balls = at(tolerance / lattice.side)
    else:
        balls = _least(at, 1.001 * lattice.diagonal, 2.0 * lattice.region.size / lattice.side)
    if balls is None:
        name, value = ("number", number) if tolerance is None else ("tolerance", tolerance)
        found = f"is {value:g}, and balls that cover the shape within it were not found"
        raise InputError(name, found, "their union must hold all of it", "pass a larger one")
    return lattice.metres(balls[0]), balls[1] * lattice.side


def _covered(
    lattice: Lattice, candidates: _Candidates, reach: float, *, inside: bool, most: int = _ANY
) -> tuple[Cover, _Candidates, Floats]:
    """Choose balls, as large as their depths and ``reach``, in sides, until every cell lies in one, or there are so
    many.

    With the cover, which has open cells if so many balls did not do, come the balls and their reaches.
    """
    from scipy.spatial import KDTree

    cover = Cover(lattice, whole=True)
    balls, reaches = _Candidates.none(), np.empty(0)
    # What candidates leave open, middles of cells near by may hold, and else finer points.
    for stage in ("candidates", "lattice", "finer"):
        left = cover.open_cells
        if not len(left) or len(reaches) == most:
            break
        if stage == "candidates":
            some = candidates
        else:
            some = _on_lattice(lattice) if stage == "lattice" else _within(lattice, left, inside=inside)
        some = some.where(some.depths >= (0.0 if inside else -np.inf))
        lengths = some.depths + reach
        if stage == "lattice":
            bound = max(float(lengths.max(initial=0.0)), 1.0)
            near = KDTree(left).query(some.centers, distance_upper_bound=bound)[0] <= lengths
            some, lengths = some.where(near), lengths[near]
        chosen = cover.choose(some.centers, lengths, most - len(reaches))
        balls = balls.joined(some.where(chosen))
        reaches = np.append(reaches, lengths[chosen])
    return cover, balls, reaches


def _least(at: Callable[[float], Balls | None], bad: float, good: float) -> Balls | None:
    """What there is at the least length, between two, at which there is something; None where there is at none."""
    best = at(good)
    for _ in range(STEPS):
        if best is None or good < 1.02 * bad:
            break
        middle = float(np.sqrt(good * bad))
        found = at(middle)
        if found is None:
            bad = middle
        else:
            best, good = found, middle
    return best


# ---- where they are looked for ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Candidates:
    """Centers, shape (n, 3), and lower bounds of their depths, shape (n,), both in sides of a lattice's cell."""

    centers: Floats
    depths: Floats

    @classmethod
    def none(cls) -> _Candidates:
        """Not one."""
        return cls(np.empty((0, 3)), np.empty(0))

    def where(self, kept: NDArray[Any]) -> _Candidates:
        """Those of a mask, or of some numbers."""
        return _Candidates(self.centers[kept], self.depths[kept])

    def joined(self, other: _Candidates) -> _Candidates:
        """Both together."""
        return _Candidates(np.vstack([self.centers, other.centers]), np.append(self.depths, other.depths))


def _on_lattice(lattice: Lattice) -> _Candidates:
    """Every middle of a cell."""
    return _Candidates(lattice.middles, lattice.depths)


def _maximal(lattice: Lattice) -> _Candidates:
    """Middles of cells whose balls no ball round a middle near by holds, but for a sliver.

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


def _within(lattice: Lattice, cells: Floats, *, inside: bool) -> _Candidates:
    """Points in cells, given by their middles: the middles, and where ``inside``, finer ones that lie in the shape."""
    if not inside:
        return _Candidates(cells, lattice.region.depths(lattice.metres(cells)) / lattice.side)
    points, left = _Candidates.none(), cells
    for cuts in _CUTS:
        if not len(left):
            break
        ticks = [(np.arange(cuts) + 0.5) / cuts - 0.5 if half else np.zeros(1) for half in lattice.half]
        trials = left[:, None] + np.array(list(product(*ticks)))
        depths = (lattice.region.depths(lattice.metres(trials.reshape(-1, 3))) / lattice.side).reshape(len(left), -1)
        rows, best = np.arange(len(left)), depths.argmax(axis=1)
        deepest = _Candidates(trials[rows, best], depths[rows, best])
        points = points.joined(deepest.where(deepest.depths > 0.0))
        left = left[deepest.depths <= 0.0]
    return points
