"""decompose: balls that fill a shape from inside, or cover it."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any, Final, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import GeometryError, InputError
from cspace.grid import positive
from cspace.raster.triangles import cut_to
from cspace.spectral.cover import Cover
from cspace.spectral.inputs import check_kind
from cspace.spectral.measures import balls_to_shape, measure_of_balls, shape_to_balls
from cspace.spectral.regions import MOST, Lattice, Region, box_volume, region_of
from cspace.spectral.spheres import KINDS, Bounds, Kind, Spheres

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Balls = tuple[Floats, Floats]
"""Centers, shape (n, 3), and radii, shape (n,), in sides of a lattice's cell."""
Found = TypeVar("Found")

FINEST: Final = {2: 12.0, 3: 6.0}
"""Cells of the lattice that a tolerance is long, at most."""

COARSEST: Final = 2.6
"""Cells of the lattice that a tolerance is long, at least: a cell's diagonal must be well below it."""

FINER: Final = (1, 4)
"""How much finer a lattice is tried, in cells, if so few balls do that fewer than :data:`USED` of them are taken."""

USED: Final = 0.9

STEPS: Final = 12
"""Lengths that are tried, at most, once it is known between which."""

LEAST: Final = 0.002
"""Least radius that is tried, in tolerances."""

SHORTER: Final = 0.75
"""By this factor radii become smaller until there are balls."""

CANDIDATES: Final = 6_000
"""Centers that are looked at first, at most."""

NEIGHBOURS: Final = 2
"""How far, in cells, a ball is looked for that holds another."""

_USUAL: Final = {2: 150_000, 3: 120_000}
"""Cells of the box round a shape up to which a tolerance may be as many cells as :data:`FINEST` long."""

_LOST: Final = 0.02
"""Part of the way between two middles that a ball may stick out of another one and still count as held by it."""

_MOVED: Final = 1e-6
"""Part of a shape's size by which points of its border are moved where only candidates come of them."""

_CUTS: Final = (1, 2, 4, 8, 16)
"""Into how many parts a cell's sides are cut where no ball lies near."""

_SAMPLES: Final = {2: 6_000, 3: 8_000}
"""Points of a border whose Voronoi cells give the medial axis."""

_ANY: Final = 2**40
"""More balls than there are."""


def decompose(
    shape: Any,
    *,
    kind: Kind = "inner",
    number: int | None = None,
    tolerance: float | None = None,
    method: Literal["greedy", "medial"] = "greedy",
    radius: Literal["equal"] | None = None,
    spacing: float | None = None,
    lower: ArrayLike | None = None,
) -> Spheres:
    """Balls that fill a shape from inside, or that cover it.

    Each ball is taken, one after the other, for the cells of a lattice that it adds (V. Chvatal, "A greedy heuristic
    for the set-covering problem", 1979). What is promised does not rest on samples: a ball of kind "inner" is no larger
    than the distance of its center from the border; for "outer", cells whose union covers the shape each lie wholly in
    one ball.

    Parameters
    ----------
    shape : Shape, shapely geometry, trimesh.Trimesh, array-like, path-like, mapping or str
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
        medial axis (N. Amenta, S. Choi and R. K. Kolluri, "The power crust", 2001).
    radius : "equal", optional
        All balls have one radius, which is found. By default each has its own.
    spacing : float, optional
        Side of the cells of a bitmap, metres.
    lower : array-like, shape (d,), optional
        Lower corner of a bitmap, metres; the origin if left out.

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
    check_kind(method, "method", ("greedy", "medial"))
    if radius is not None:
        check_kind(radius, "radius", ("equal",))
    if (number is None) == (tolerance is None):
        raise InputError(
            "number",
            f"is {number!r} and tolerance {tolerance!r}: {'neither is' if number is None else 'both are'} given",
            "balls are chosen by one of them",
            "pass e.g. number=64, or tolerance=0.01 in metres",
        )
    length = None if tolerance is None else positive(tolerance, "tolerance")
    count = None if number is None else _check_number(number)
    region = region_of(shape, spacing, lower)
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
    choice = _Choice(method, count, length, radius is not None)
    for finer in FINER:
        lattice = Lattice.fine(region, count, finer) if count is not None else _lattice_for(region, length or 0.0)
        centers, radii = (_inner if kind == "inner" else _outer)(lattice, choice)
        if count is None or choice.same or len(radii) >= USED * count:
            break
    order = np.argsort(-radii, kind="stable")
    centers, radii = centers[order], radii[order]
    gap = shape_to_balls(lattice, centers, radii) if kind == "inner" else balls_to_shape(region, centers, radii)
    measures = Bounds(*measure_of_balls(centers, radii)), Bounds(*region.measure)
    return Spheres(centers, radii, kind, method, *measures, Bounds(*gap), region.shape)


def _check_number(number: Any) -> int:
    try:
        count = 0 if isinstance(number, bool) else operator.index(number)
    except TypeError:
        count = 0
    if count < 1:
        raise InputError("number", f"is {number!r}", "it must be a whole number, one at least", "pass e.g. 64")
    return count


class _Choice(NamedTuple):
    """What balls are asked for: so many, or within a tolerance, metres; and whether all have one radius."""

    method: str
    number: int | None
    tolerance: float | None
    same: bool


def _lattice_for(region: Region, tolerance: float) -> Lattice:
    """A lattice on which a tolerance can be proven."""
    volume = box_volume(region)
    usual = float((volume / _USUAL[region.dim]) ** (1.0 / region.dim))
    least = COARSEST * float((volume / MOST) ** (1.0 / region.dim))
    if tolerance < least:
        found, rule = f"is {tolerance:g} m, and the shape {region.size:g} m across", "to prove it takes too many cells"
        raise InputError("tolerance", found, rule, f"pass at least about {1.2 * least:.2g} m")
    return Lattice(region, min(max(usual, tolerance / FINEST[region.dim]), tolerance / COARSEST))


# ---- which balls -----------------------------------------------------------------------------------------------------


def _inner(lattice: Lattice, choice: _Choice) -> Balls:
    """Balls in a shape, in metres."""
    side, tolerance = lattice.side, choice.tolerance or 0.0
    inside = _candidates(lattice, choice)
    inside = inside.where(inside.depths > 0.0)
    if not len(inside.depths):
        inside = _within(lattice, lattice.middles, inside=True)
    if choice.same:
        inside = inside.thinned(CANDIDATES)
    whole = True
    if choice.number is None:
        centers, radii, whole = _inner_tolerance(lattice, inside, tolerance / side, choice.same)
    elif choice.same:
        centers, radii = _inner_equal(lattice, inside, choice.number)
    else:
        centers, radii = _inner_number(lattice, inside, choice.number, polished=choice.method == "greedy")
    centers, radii = lattice.metres(centers), radii * side
    depths = lattice.region.depths(centers)
    # A depth found anew is a proof; of balls of one radius, the least counts for all.
    radii = np.full(len(radii), min([*depths, *radii])) if choice.same and len(radii) else depths
    centers, radii = centers[radii > 0.0], radii[radii > 0.0]
    if not len(radii):
        raise InputError(
            "shape",
            "has room for no ball that was found",
            "inner balls lie inside",
            "pass kind='outer', or a shape that is less thin",
        )
    if not whole:
        reached = shape_to_balls(lattice, centers, radii)[1]
        if reached > tolerance:
            raise InputError(
                "tolerance",
                f"is {tolerance:g} m, and the shape is proven to be within {reached:g} m of {len(radii)} balls",
                "what is thinner than the lattice, or than balls of one radius, has none near",
                "pass a larger tolerance, or kind='outer'",
            )
    return centers, radii


def _inner_number(lattice: Lattice, inside: _Candidates, number: int, *, polished: bool) -> Balls:
    """So many balls that add most, each as large as the shape allows."""
    cover = Cover(lattice, whole=False)
    chosen = cover.choose(inside.centers, inside.depths, number)
    if not len(chosen):  # so thin a shape that no middle lies in it
        chosen = np.argsort(-inside.depths)[:number]
    centers, radii = inside.centers[chosen].copy(), inside.depths[chosen].copy()
    if polished:
        cover.polish(centers, radii)
    return centers, radii


def _inner_equal(lattice: Lattice, inside: _Candidates, number: int) -> Balls:
    """At most so many balls of one radius that hold most of a shape, the best of some radii."""
    largest = float(inside.depths.max(initial=0.0))
    # Half the radius at which so many balls would fill the shape.
    cells = max(int(np.count_nonzero(lattice.depths > 0.0)), 1)
    fair = 0.5 * (cells / number / np.pi) ** (1.0 / lattice.region.dim)
    lengths = np.geomspace(largest, min(fair, 0.25 * largest), STEPS).tolist() if largest > 0.0 else []
    best: tuple[int, float, Floats] = (-1, 0.0, np.empty((0, 3)))
    for length in lengths:
        fits = inside.where(inside.depths >= length)
        cover = Cover(lattice, whole=False)
        centers = fits.centers[cover.choose(fits.centers, np.full(len(fits.depths), length), number)]
        if not len(centers):
            centers = fits.centers[np.argsort(-fits.depths)[:1]]
        if cover.held > best[0]:
            best = cover.held, length, centers
    return best[2], np.full(len(best[2]), best[1])


def _inner_tolerance(
    lattice: Lattice, inside: _Candidates, tolerance: float, same: bool
) -> tuple[Floats, Floats, bool]:
    """Balls in a shape that, grown by a length in sides, cover it, few or as large as may be; and whether they do."""
    if not same:
        cover, balls, reaches = _covered(lattice, inside, tolerance, 0.0, grown=True, most=_ANY)
        whole = not len(cover.open_cells)
        used = cover.trim(balls.centers, reaches, balls.depths) > 0.0
        return balls.centers[used], balls.depths[used], whole

    def at(length: float) -> tuple[Floats, Floats, bool]:
        cover, balls, _ = _covered(lattice, inside, length + tolerance, length, grown=False, most=_ANY)
        return balls.centers, np.full(len(balls.depths), length), not len(cover.open_cells)

    def whole_at(length: float) -> tuple[Floats, Floats, bool] | None:
        attempt = at(length)
        return attempt if attempt[2] else None

    most, least = float(inside.depths.max(initial=0.0)), LEAST * tolerance
    return _largest(whole_at, most, least) or at(min(most, least))


def _outer(lattice: Lattice, choice: _Choice) -> Balls:
    """Balls that cover a shape, in metres."""
    side, across = lattice.side, lattice.region.size / lattice.side
    candidates = _candidates(lattice, choice)
    if choice.same:
        candidates = (candidates if len(candidates.depths) else _on_lattice(lattice)).thinned(CANDIDATES)
    most = _ANY if choice.number is None else choice.number
    tolerance = (choice.tolerance or 0.0) / side

    def at(length: float, least: float = -np.inf) -> Balls | None:
        """Balls of this radius, or that stick out by no more; None where more are needed than so many."""
        cover, balls, reaches = _covered(lattice, candidates, length, least, grown=not choice.same, most=most)
        if len(cover.open_cells):
            return None
        if not choice.same:
            reaches = cover.trim(balls.centers, reaches, balls.depths)
        return balls.centers[reaches > 0.0], reaches[reaches > 0.0]

    if choice.number is not None:
        low, high = (0.501, across) if choice.same else (1.001, 2.0 * across)
        balls = _between(at, high, low * lattice.diagonal, at(high))
    elif choice.same:
        deepest = max(float(candidates.depths.max()), 0.0)
        balls = _largest(lambda length: at(length, length - tolerance), deepest + tolerance, 0.5 * tolerance)
    else:
        balls = at(tolerance)
    if balls is None:
        name, value = ("tolerance", choice.tolerance) if choice.number is None else ("number", choice.number)
        raise InputError(
            name,
            f"is {value:g}, and balls that cover the shape within it were not found",
            "their union must hold all of it",
            "pass a larger one",
        )
    return lattice.metres(balls[0]), balls[1] * side


def _covered(
    lattice: Lattice, candidates: _Candidates, reach: float, least: float, *, grown: bool, most: int
) -> tuple[Cover, _Candidates, Floats]:
    """Choose balls until every cell lies in one, or there are so many.

    ``reach`` is that of the balls in sides, where ``grown`` beyond their depths; ``least`` the depth that their centers
    must have. With the cover, which has open cells if so many balls did not do, come the balls and their reaches.
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
            some = _on_lattice(lattice) if stage == "lattice" else _within(lattice, left, inside=least >= 0.0)
        some = some.where(some.depths >= least)
        lengths = some.depths + reach if grown else np.full(len(some.depths), reach)
        if stage == "lattice":
            bound = max(float(lengths.max(initial=0.0)), 1.0)
            near = KDTree(left).query(some.centers, distance_upper_bound=bound)[0] <= lengths
            some, lengths = some.where(near), lengths[near]
        chosen = cover.choose(some.centers, lengths, most - len(reaches))
        balls = balls.joined(some.where(chosen))
        reaches = np.append(reaches, lengths[chosen])
    return cover, balls, reaches


def _largest(at: Callable[[float], Found | None], most: float, least: float) -> Found | None:
    """What there is at the largest length between two at which there is something."""
    high, low = most, most
    best = at(low)
    while best is None and low > least:
        high, low = low, max(SHORTER * low, least)
        best = at(low)
    return _between(at, low, high, best)


def _between(at: Callable[[float], Found | None], good: float, bad: float, best: Found | None) -> Found | None:
    """What there is at the last length on the way from a good one, where ``best`` is, to one where is nothing."""
    for _ in range(STEPS):
        if best is None or max(good, bad) < 1.02 * min(good, bad):
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

    def thinned(self, most: int) -> _Candidates:
        """Every few of them, so that at most so many are left, always with the deepest."""
        kept = np.arange(len(self.depths)) % max(1, -(-len(self.depths) // most)) == 0
        if len(kept):
            kept[np.argmax(self.depths)] = True
        return self.where(kept)


def _candidates(lattice: Lattice, choice: _Choice) -> _Candidates:
    """Where balls are looked for at first."""
    if choice.method == "medial":
        return _medial(lattice)
    return _on_lattice(lattice) if choice.same else _maximal(lattice)


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
    return _on_lattice(lattice).where(~held[lattice.cells]).thinned(CANDIDATES)


def _medial(lattice: Lattice) -> _Candidates:
    """Corners of the Voronoi cells of points on the border that lie inside, which lie along the medial axis."""
    from scipy.spatial import QhullError, Voronoi

    region = lattice.region
    samples = border_samples(region.pieces, _SAMPLES[region.dim])
    # Points of a lattice lie on common spheres, over which Voronoi cells take long: they are moved a little.
    samples = samples + _MOVED * region.size * np.random.default_rng(0).uniform(-1.0, 1.0, samples.shape)
    try:
        corners = Voronoi((samples - region.bounds[0]) / region.size).vertices * region.size + region.bounds[0]
    except QhullError:  # the border is flat, or has too few points
        return _Candidates.none()
    corners = corners[((corners > region.bounds[0]) & (corners < region.bounds[1])).all(axis=1)]
    # Several points on one circle give one corner many times.
    cells = np.floor(2.0 * (corners - region.bounds[0]) / lattice.side)
    corners = corners[np.unique(cells, axis=0, return_index=True)[1]]
    some = _Candidates(lattice.sides(corners), region.depths(corners) / lattice.side)
    return some.where(some.depths > 0.0).thinned(3 * CANDIDATES)


def border_samples(pieces: Floats, number: int) -> Floats:
    """About so many points of a border, segments or triangles, spread over each piece, with all corners."""
    import shapely

    if pieces.shape[1] == 2:
        step = float(np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).sum()) / number
        lines = shapely.segmentize(shapely.linestrings(pieces), max(step, 1e-300))
        return np.unique(shapely.get_coordinates(lines), axis=0)
    a, b, c = np.moveaxis(pieces, 1, 0)
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    # Parts have sides from half of the longest one on, and an area A about 2.5 A / longest^2 corners.
    step = max(float(np.sqrt(2.5 * area / number)), 1e-300)
    parts = cut_to(pieces, step)
    return np.unique(parts.reshape(-1, 3), axis=0)


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
