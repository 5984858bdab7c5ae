"""decompose: balls that fill a shape from inside, or cover it, by a greedy choice among balls by the cells they add.

Lengths are in sides of a lattice's cell. A ball holds a cell where ``sum (|middle - center| + half)^2 <= reach^2`` over
the axes: its middle, with ``half`` zero, or all of it.
"""

from __future__ import annotations

import heapq
import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Floats, Ints, frozen
from cspace.check import check_word, finite, positive, whole
from cspace.compiling import jit, kernel
from cspace.errors import FileError, GeometryError, InputError
from cspace.files.access import check_suffix, replacing
from cspace.files.plain import read_json, read_yaml
from cspace.shapes import Balls, ExactShape, Shape, ShapeLike, shape_of
from cspace.spectral.bump import VOLUME
from cspace.spectral.descriptors import check_solid_balls
from cspace.spectral.regions import (
    Lattice,
    Region,
    Tree,
    balls_to_shape,
    distance,
    measure_of_balls,
    shape_to_balls,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Kind = Literal["inner", "outer"]

KINDS: Final = ("inner", "outer")
FORMAT: Final = "cspace-spheres"
VERSION: Final = 2

COLORS: Final = {"inner": "#0072b2", "outer": "#d55e00"}
"""Of balls, from Okabe and Ito (2008)."""

READERS: Final[dict[str, Callable[[Any, str], Any]]] = {".json": read_json, ".yaml": read_yaml, ".yml": read_yaml}
RULE: Final = "balls go into .yaml, .yml or .json"

_BOUNDS: Final = ("measure", "shape_measure", "hausdorff")


class Bounds(NamedTuple):
    """A number that lies between two."""

    lower: float
    upper: float


@dataclass(frozen=True, slots=True, eq=False)
class Spheres:
    """Balls in space, or discs in the plane, that lie in a shape or cover it.

    Made by :func:`cspace.spectral.decompose`, or read with :meth:`open`.

    Attributes
    ----------
    centers : ndarray, shape (n, d)
        Metres; read-only, the largest ball first.
    radii : ndarray, shape (n,)
        Metres; read-only.
    kind : {"inner", "outer"}
        Whether each ball lies in the shape, or the union covers it.
    measure, shape_measure : Bounds
        Of the area or volume of the union, and of the shape, square or cubic metres.
    hausdorff : Bounds
        Of the one-sided Hausdorff distance that is not zero, metres: for "inner", the farthest that a point of the
        shape is from the balls; for "outer", the farthest that a point of the balls is from the shape.
    shape : Shape, or None
        The shape, for pictures; it is not written to files.

    Raises InputError if there is no ball, arrays do not fit, or a value is not usable.
    """

    centers: Floats = field(repr=False)
    radii: Floats = field(repr=False)
    kind: Kind
    measure: Bounds
    shape_measure: Bounds
    hausdorff: Bounds
    shape: Shape | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        centers, radii = check_solid_balls(self.centers, self.radii)
        check_word(self.kind, "kind", KINDS)
        for name in _BOUNDS:
            pair = finite(getattr(self, name), name)
            if pair.shape != (2,) or not 0.0 <= pair[0] <= pair[1]:
                rule = "it must be two numbers, zero or above, the lower one first"
                raise InputError(
                    name, f"is {getattr(self, name)!r}", rule, "pass Bounds(lower, upper)", value=getattr(self, name)
                )
            object.__setattr__(self, name, Bounds(*pair.tolist()))
        object.__setattr__(self, "centers", frozen(centers))
        object.__setattr__(self, "radii", frozen(radii))

    def __len__(self) -> int:
        """Number of balls."""
        return len(self.radii)

    @property
    def dim(self) -> int:
        """Number of axes, 2 or 3."""
        return int(self.centers.shape[1])

    @property
    def volume_bounds(self) -> Bounds:
        """Bounds of the area or volume of the union, over that of the shape; without end if the shape has none."""
        low, high = self.shape_measure
        return Bounds(
            self.measure.lower / high if high > 0.0 else float("inf"),
            self.measure.upper / low if low > 0.0 else float("inf"),
        )

    @property
    def volume_ratio(self) -> float:
        """The middle of :attr:`volume_bounds`; in the plane, these are some 1e-5 apart."""
        return sum(self.volume_bounds) / 2.0

    def plot(self, ax: Axes | None = None, *, title: str | None = None) -> Axes:
        """Draw the balls, and their shape where it is known, on axes or else in a new figure that belongs to no window.

        The title gives number, kind and how well they describe the shape, unless one is passed. Raises InputError if
        axes are of the plane and balls are in space, or the other way around.
        """
        from matplotlib.collections import LineCollection, PatchCollection
        from matplotlib.figure import Figure
        from matplotlib.patches import Circle

        solid, color = self.dim == 3, COLORS[self.kind]
        axes: Any = ax or Figure((6.5, 6.5), layout="constrained").add_subplot(projection="3d" if solid else None)
        if solid != hasattr(axes, "get_zlim"):
            where = ("in the plane", "in space")
            hint = "add_subplot(projection='3d') makes axes for balls, and one without a projection for discs"
            raise InputError("ax", f"is {where[not solid]}", f"the balls are {where[solid]}", hint, value=ax)
        if solid:
            shapes: list[tuple[ExactShape, dict[str, Any]]] = [(Balls(self.centers, self.radii), {"color": color})]
            if self.shape is not None:
                shapes.append((self.shape.outer, {"color": (0, 0, 0, 0), "edgecolor": "#26262680", "linewidth": 0.5}))
            for (vertices, faces), style in ((shape.surface, style) for shape, style in shapes):
                axes.plot_trisurf(*vertices.T, triangles=faces, **style)
        else:
            # So many discs lie over each other that their colours must be thin.
            discs = PatchCollection(list(map(Circle, self.centers, self.radii)), facecolor=(color, 0.16), linewidth=0.6)
            discs.set_edgecolor((color, 0.75))
            axes.add_collection(discs)
            if self.shape is not None:
                axes.add_collection(LineCollection(list(self.shape.outer.boundary().simplices), colors="#262626"))
            axes.autoscale_view()
        axes.set(aspect="equal", **{f"{name}label": f"{name} [m]" for name in "xyz"[: self.dim]})
        text = f"{len(self)} {self.kind} {'balls' if solid else 'discs'}, within {self.hausdorff.upper:.3g} m"
        axes.set_title(text if title is None else title, fontsize=10)
        return axes  # type: ignore[no-any-return]

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> Path:
        """Write all but the shape to a file, to the last bit; its name ends in ``.yaml``, ``.yml`` or ``.json``.

        Raises InputError if it ends otherwise, and FileError if the file exists and ``overwrite`` is not set, or cannot
        be written.
        """
        check_suffix(path, READERS, RULE)
        record: dict[str, Any] = {"format": FORMAT, "version": VERSION, "kind": self.kind}
        record |= {name: list(getattr(self, name)) for name in _BOUNDS}
        record |= {"centers": self.centers.tolist(), "radii": self.radii.tolist()}
        with replacing(path, overwrite) as temporary:
            temporary.write_text(json.dumps(record), encoding="utf-8")  # which is YAML as well
        return Path(path)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Spheres:
        """Read what :meth:`save` wrote.

        Raises InputError if the name ends otherwise, and FileError if the file is missing, malformed, or of another
        version.
        """
        load = READERS[check_suffix(path, READERS, RULE)]
        record, name = load(path, "file of balls"), os.fspath(path)
        if not isinstance(record, Mapping) or record.get("format") != FORMAT:
            raise FileError(name, "holds no balls", f"its format must be {FORMAT!r}", "pass a file of Spheres.save")
        if record.get("version") != VERSION:
            version = f"has version {record.get('version')!r}"
            raise FileError(name, version, f"this library reads {VERSION}", "use the library that wrote it")
        try:
            bounds = {key: record[key] for key in _BOUNDS}
            return cls(record["centers"], record["radii"], record["kind"], **bounds)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            what = f"lacks {error}" if isinstance(error, KeyError) else f"is malformed: {error}"
            raise FileError(name, what, "it must be as Spheres.save writes it", "mend or write it again") from error


FINER: Final = (1, 4)  # how much finer a lattice is tried, in cells, if of the balls fewer than USED are taken
USED: Final = 0.9
STEPS: Final = 12  # lengths by which balls may stick out that are tried, at most
CANDIDATES: Final = 6_000  # centers that are looked at first, at most
NEIGHBOURS: Final = 2  # how far, in cells, a ball is looked for that holds another
LOST: Final = 0.02  # part of the way between two middles that a ball may stick out of another one that holds it
CUTS: Final = (1, 2, 4, 8, 16)  # into how many parts a cell's sides are cut where no ball lies near
ANY: Final = 2**40  # more balls than there are
EPS: Final = 2.0**-20  # rounding allowance, in sides of a cell: by this, a ball that holds a cell reaches out of it
ROUNDS: Final = 6  # how often every ball is moved, at most


def decompose(
    shape: ShapeLike, *, kind: Kind = "inner", number: int | None = None, tolerance: float | None = None
) -> Spheres:
    """LatticeBalls that fill a shape from inside, or that cover it.

    Each ball is taken, one after the other, for the cells of a lattice that it adds (V. Chvatal, "A greedy heuristic
    for the set-covering problem", 1979), with its center along the medial axis. What is promised does not rest on
    samples: a ball of kind "inner" is no larger than the distance of its center from the border; for "outer", cells
    whose union covers the shape each lie wholly in one ball.

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

    Raises GeometryError if the shape is empty or malformed, or has no inside to put balls into; FileError if a file is
    missing or malformed; and InputError if both or none of ``number`` and ``tolerance`` are passed, a word or number is
    not usable, balls cannot meet the tolerance, or the lattice does not fit into memory.

    Examples
    --------
    >>> import shapely
    >>> from cspace.spectral import decompose
    >>> discs = decompose(shapely.box(0, 0, 2, 1), kind="outer", number=8)
    >>> len(discs.radii) <= 8
    True
    """
    check_word(kind, "kind", KINDS)
    if (number is None) == (tolerance is None):
        problem = f"is {number!r} and tolerance {tolerance!r}: {'neither is' if number is None else 'both are'} given"
        hint = "pass e.g. number=64, or tolerance=0.01 in metres"
        raise InputError("number", problem, "balls are chosen by one of them", hint, value=number)
    length = None if tolerance is None else positive(tolerance, "tolerance")
    count = None if number is None else whole(number, "number", 1, hint="pass e.g. 64")
    region = Region(shape_of(shape))
    if kind == "inner" and not region.inner.measure[1] > 0.0:
        hint = "pass kind='outer', or a shape with an area or volume"
        raise GeometryError("shape", "has no inside", "inner balls lie inside", hint, value=shape)
    if count is not None and not 0.0 < region.size < np.inf:
        rule = "balls are counted by the cells of a lattice, which it must have"
        problem = f"is {number}, and the shape {region.size:g} m across"
        raise InputError("number", problem, rule, "pass a tolerance in place of a number", value=number)
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
        problem, rule = "has room for no ball that was found", "inner balls lie inside"
        raise InputError("shape", problem, rule, "pass kind='outer', or a shape that is less thin")
    if reached and (reached := shape_to_balls(lattice, centers, radii)[1]) > (tolerance or 0.0):
        problem = f"is {tolerance:g} m, and the shape is proven to be within {reached:g} m of {len(radii)} balls"
        rule, hint = "what is thinner than the lattice has none near", "pass a larger tolerance, or kind='outer'"
        raise InputError("tolerance", problem, rule, hint, value=tolerance)
    return centers, radii


def _outer(lattice: Lattice, number: int | None, tolerance: float | None) -> tuple[Floats, Floats]:
    """Centers and radii of balls that cover a shape, in metres: at most so many, or that stick out by a tolerance."""
    candidates = _maximal(lattice)

    def at(length: float) -> LatticeBalls | None:
        """LatticeBalls that stick out by no more; None where more are needed than so many."""
        cover, balls = _covered(lattice, candidates, length, inside=False, most=number or ANY)
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
        problem = f"is {value:g}, and balls that cover the shape within it were not found"
        raise InputError(name, problem, "their union must hold all of it", "pass a larger one", value=value)
    return lattice.metres(balls.centers), balls.reaches * lattice.side


def _covered(
    lattice: Lattice, candidates: LatticeBalls, reach: float, *, inside: bool, most: int = ANY
) -> tuple[Cover, LatticeBalls]:
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
        offered = _finer(lattice, left) if stage == 2 else (candidates, _on_lattice(lattice))[stage]
        offered = offered._replace(reaches=offered.depths + reach)
        offered = offered.where(offered.depths >= (0.0 if inside else -np.inf))
        if len(left) < len(lattice.middles):  # those that reach none add nothing
            bound = max(float(offered.reaches.max(initial=0.0)), 1.0)
            offered = offered.where(
                KDTree(left).query(offered.centers, distance_upper_bound=bound)[0] <= offered.reaches
            )
        balls = balls.joined(offered.where(cover.choose(offered, most - len(balls.reaches))))
    return cover, balls


def _least(at: Callable[[float], LatticeBalls | None], bad: float, good: float) -> LatticeBalls | None:
    """What there is at the least length, between two, at which there is something; None where there is at none."""
    best = at(good)
    for _ in range(STEPS):
        if best is None or good < 1.02 * bad:
            break
        middle = float(np.sqrt(good * bad))
        balls = at(middle)
        best, bad, good = (best, middle, good) if balls is None else (balls, bad, middle)
    return best


# ---- where they are looked for ---------------------------------------------------------------------------------------


def _on_lattice(lattice: Lattice) -> LatticeBalls:
    """As large as they fit round every middle of a cell."""
    return LatticeBalls(lattice.middles, lattice.depths, lattice.depths)


def _maximal(lattice: Lattice) -> LatticeBalls:
    """Those of the lattice that no other near by holds, but for a sliver.

    They lie along the medial axis. LatticeBalls that are grown by one length hold each other just as before.
    """
    from scipy.ndimage import grey_dilation

    depths = np.full(lattice.cells.shape, -np.inf)
    depths[lattice.cells] = lattice.depths
    steps = (np.arange(-NEIGHBOURS, NEIGHBOURS + 1) if half else np.zeros(1) for half in lattice.half)
    distances = np.linalg.norm(np.meshgrid(*steps, indexing="ij"), axis=0)
    reach = -(1.0 - LOST) * distances
    held = grey_dilation(depths, footprint=distances > 0.0, structure=reach, mode="constant", cval=-np.inf) >= depths
    balls = _on_lattice(lattice).where(~held[lattice.cells])
    few = np.arange(len(balls.depths)) % max(1, -(-len(balls.depths) // CANDIDATES)) == 0
    if len(few):
        few[np.argmax(balls.depths)] = True
    return balls.where(few)


def _finer(lattice: Lattice, cells: Floats) -> LatticeBalls:
    """Those round a point in each of some cells, given by their middles, that lies in the shape; none without one."""
    points = _on_lattice(lattice).where(np.zeros(0, dtype=np.int64))
    for cuts in CUTS:
        if not len(cells):
            break
        ticks = [(np.arange(cuts) + 0.5) / cuts - 0.5 if half else np.zeros(1) for half in lattice.half]
        trials = cells[:, None] + np.array(list(product(*ticks)))
        depths = lattice.depths_at(trials.reshape(-1, 3)).reshape(len(cells), -1)
        rows, best = np.arange(len(cells)), depths.argmax(axis=1)
        deepest = LatticeBalls(trials[rows, best], depths[rows, best], depths[rows, best])
        points = points.joined(deepest.where(deepest.depths > 0.0))
        cells = cells[deepest.depths <= 0.0]
    return points


class LatticeBalls(NamedTuple):
    """Balls of the lattice, in sides of a cell: centers, shape (n, 3), lower bounds of their depths, and radii."""

    centers: Floats
    depths: Floats
    reaches: Floats

    def where(self, chosen: NDArray[Any]) -> LatticeBalls:
        """Those of a mask, or of some numbers."""
        return LatticeBalls(*(column[chosen] for column in self))

    def joined(self, other: LatticeBalls) -> LatticeBalls:
        """Both together."""
        return LatticeBalls(*map(np.concatenate, zip(self, other, strict=True)))


class Cells(NamedTuple):
    """The cells; compiled functions take them as they are.

    ``times`` (nx, ny, nz) is how many of the chosen balls hold a cell, or -1 for cells that do not matter, and ``sums``
    (nx, ny, nz + 1) how many cells of its row that none holds come before it; ``opens`` (nx, ny) is how many of these
    there are in a row. ``rows`` (nx * ny, 4) is room for the rows of cells that a ball holds: i, j, and the first k and
    the one after the last; and ``squares`` (nx * ny,) for the part of the squared distance that the first two axes make
    up.
    """

    times: NDArray[np.int32]
    sums: NDArray[np.int32]
    opens: NDArray[np.int32]
    half: Floats
    rows: Ints
    squares: Floats


class Cover:
    """The cells of a lattice, and balls chosen to hold them.

    Where ``whole``, a ball holds a cell if all of the cell lies in it, and every cell is to be held; or else, if its
    middle does, and only those in the shape are.
    """

    def __init__(self, lattice: Lattice, *, whole: bool) -> None:
        self._lattice = lattice
        times = np.full(lattice.cells.shape, -1, dtype=np.int32)
        times[lattice.cells] = 0 if whole else np.where(lattice.depths > 0.0, 0, -1)
        sums = np.cumsum(np.pad(times == 0, ((0, 0), (0, 0), (1, 0))), axis=2, dtype=np.int32)
        rows, half = math.prod(times.shape[:2]), lattice.half if whole else np.zeros(3)
        opens = np.ascontiguousarray(sums[:, :, -1])
        self._cells = Cells(times, sums, opens, half, np.empty((rows, 4), dtype=np.int64), np.empty(rows))

    @property
    def open_cells(self) -> Floats:
        """Middles of the cells that no ball holds, shape (n, 3)."""
        return np.argwhere(self._cells.times == 0) + np.float64(0.5)

    def choose(self, balls: LatticeBalls, most: int) -> Ints:
        """Numbers of those among balls that a greedy choice takes, in their order."""
        lattice, dim = self._lattice, self._lattice.region.dim
        large = np.maximum(balls.reaches, 0.0) + 0.5 * lattice.diagonal
        bounds = np.minimum(VOLUME[dim] * large**dim, float(len(lattice.middles)))
        chosen, left = np.empty(min(most, len(bounds)), dtype=np.int64), int(self._cells.opens.sum())
        return chosen[: choose(self._cells, balls.centers, balls.reaches, bounds, left, chosen)]

    def trim(self, balls: LatticeBalls) -> Floats:
        """Drop balls that hold no cell alone, then cut the others to what they hold alone: reaches, 0 if dropped.

        Those that stick out most are first.
        """
        left = balls.reaches.copy()
        trim(self._cells, balls.centers, left, np.argsort(left, kind="stable"), only_drop=True)
        trim(self._cells, balls.centers, left, np.argsort(balls.depths - left, kind="stable"), only_drop=False)
        return left

    def polish(self, centers: Floats, radii: Floats) -> None:
        """Move balls that lie in the shape, as large as it allows, to where they hold more cells; in place."""
        lattice, border = self._lattice, self._lattice.region.inner
        placing = lattice.corner, lattice.side, border.slack
        polish(self._cells, border.tree, centers, radii, placing, np.empty((2, 3)))


@kernel
def _span(center: float, length: float, count: int) -> tuple[int, int]:
    """The middles within a length of a center along an axis: the first, and the one after the last."""
    return max(0, math.ceil(center - length - 0.5)), min(count, math.floor(center + length + 0.5))


@kernel
def _find_rows(cells: Cells, center: Floats, reach: float) -> int:
    """Fill ``cells.rows`` with the rows of cells that a ball holds; how many there are."""
    nx, ny, nz = cells.times.shape
    half = cells.half
    r = reach - EPS
    count = 0
    for i in range(*_span(center[0], r - half[0], nx)):
        x = (abs(i + 0.5 - center[0]) + half[0]) ** 2
        if x > r * r:
            continue
        for j in range(*_span(center[1], math.sqrt(r * r - x) - half[1], ny)):
            xy = x + (abs(j + 0.5 - center[1]) + half[1]) ** 2
            if xy > r * r:
                continue
            first, stop = _span(center[2], math.sqrt(r * r - xy) - half[2], nz)
            if first < stop:
                cells.rows[count, 0], cells.rows[count, 1] = i, j
                cells.rows[count, 2], cells.rows[count, 3] = first, stop
                cells.squares[count] = xy
                count += 1
    return count


@kernel
def _add(cells: Cells, rows: int, step: int) -> None:
    """Count a ball, whose rows were found, in (``step`` 1) or out (-1)."""
    times, sums = cells.times, cells.sums
    for n in range(rows):
        i, j, first, stop = cells.rows[n]
        for k in range(first, stop):
            if times[i, j, k] >= 0:
                times[i, j, k] += step
        for k in range(first, times.shape[2]):
            sums[i, j, k + 1] = sums[i, j, k] + (times[i, j, k] == 0)
        cells.opens[i, j] = sums[i, j, times.shape[2]]


@kernel
def _gain(cells: Cells, center: Floats, reach: float) -> int:
    """How many cells a ball holds that none holds so far; quick in rows of which few are left."""
    nx, ny, nz = cells.times.shape
    half = cells.half
    r = reach - EPS
    gain = 0
    for i in range(*_span(center[0], r - half[0], nx)):
        x = (abs(i + 0.5 - center[0]) + half[0]) ** 2
        if x > r * r:
            continue
        for j in range(*_span(center[1], math.sqrt(r * r - x) - half[1], ny)):
            if cells.opens[i, j] == 0:
                continue
            xy = x + (abs(j + 0.5 - center[1]) + half[1]) ** 2
            if xy > r * r:
                continue
            first, stop = _span(center[2], math.sqrt(r * r - xy) - half[2], nz)
            if first < stop:
                gain += cells.sums[i, j, stop] - cells.sums[i, j, first]
    return gain


@jit
def choose(cells: Cells, centers: Floats, reaches: Floats, bounds: Floats, left: int, chosen: Ints) -> int:
    """Fill ``chosen`` with the balls that a greedy choice takes, each for the cells that it adds; how many they are.

    A ball adds no more cells than it did before others were taken (M. Minoux, "Accelerated greedy algorithms for
    maximizing submodular set functions", 1978), nor than ``bounds``. It ends when none of the cells ``left`` is added.
    """
    count = 0
    queue = [(-bounds[n], n) for n in range(len(centers))]
    heapq.heapify(queue)
    while len(queue) > 0 and count < len(chosen) and left > 0:
        _, n = heapq.heappop(queue)
        gain = _gain(cells, centers[n], reaches[n])
        if gain == 0:
            continue
        # The gain is up to date; if it no longer leads, the ball waits with it.
        if len(queue) > 0 and gain < -queue[0][0]:
            heapq.heappush(queue, (-float(gain), n))
            continue
        _add(cells, _find_rows(cells, centers[n], reaches[n]), 1)
        chosen[count] = n
        count += 1
        left -= gain
    return count


@kernel
def trim(cells: Cells, centers: Floats, reaches: Floats, order: Ints, only_drop: bool) -> None:
    """Cut balls, in an order, to the cells that only they hold; ``reaches`` become zero where there are none."""
    for n in order:
        rows = _find_rows(cells, centers[n], reaches[n])
        square = -1.0
        for row in range(rows):
            i, j, first, stop = cells.rows[row]
            for k in range(first, stop):
                if cells.times[i, j, k] == 1:
                    square = max(square, cells.squares[row] + (abs(k + 0.5 - centers[n, 2]) + cells.half[2]) ** 2)
        # Two allowances: one that the ball reaches out of its cells, and one for the root.
        least = math.sqrt(square) + 2.0 * EPS if square >= 0.0 else 0.0
        if least < reaches[n] and not (only_drop and least > 0.0):
            _add(cells, rows, -1)
            if least > 0.0:
                _add(cells, _find_rows(cells, centers[n], least), 1)
            reaches[n] = least


@kernel
def polish(
    cells: Cells, tree: Tree, centers: Floats, radii: Floats, placing: tuple[Floats, float, float], room: Floats
) -> None:
    """Move balls that lie in a shape, as large as it allows, to where they hold more cells; in place.

    A step that stays in the ball stays in the shape, so that the distance from the border is the new radius. Steps go
    along the axes, and halve where none helps. ``placing`` is the corner of the lattice in the space of the tree, its
    side, and the slack of distances; ``room``, shape (2, 3), is for a point in both.
    """
    corner, side, slack = placing
    trial, place = room[0], room[1]
    for turn in range(ROUNDS):
        moved = False
        for n in range(len(centers)):
            _add(cells, _find_rows(cells, centers[n], radii[n]), -1)
            best = _gain(cells, centers[n], radii[n])
            step = 2.0 / (1 << turn)
            for _ in range(4):
                better = False
                for direction in range(6):
                    axis = direction // 2
                    if cells.times.shape[axis] == 1 or step >= 0.9 * radii[n]:
                        continue
                    for along in range(3):
                        trial[along] = centers[n, along]
                    trial[axis] += step if direction % 2 else -step
                    for along in range(3):
                        place[along] = corner[along] + side * trial[along]
                    radius = (distance(tree, place, 2.0 * side * (radii[n] + step))[0] - slack) / side
                    if radius <= 0.0:
                        continue
                    gain = _gain(cells, trial, radius)
                    if gain > best or (gain == best and radius > radii[n]):
                        better = moved = True
                        best = gain
                        centers[n, axis], radii[n] = trial[axis], radius
                if not better:
                    step *= 0.5
            _add(cells, _find_rows(cells, centers[n], radii[n]), 1)
        if not moved:
            break
