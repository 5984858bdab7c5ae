"""Convex regions that cover the FREE configurations of a map."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage
from scipy.optimize import nnls

from cspace import FREE
from cspace.errors import ConfigurationError, InputError
from cspace.inside import (
    Bools,
    DistanceTable,
    Effort,
    Fields,
    Floats,
    Ints,
    Ledger,
    check_count,
    check_memory,
    check_number,
    check_suffix,
    decoding,
    find_components,
    is_over,
    names_options,
    now,
    read_document,
    replacing,
    show_png,
)
from cspace.regions._convex_region import YAW, ConvexRegion, plot_regions
from cspace.regions._free_region import RegionSource
from cspace.regions._growth import find_deepest

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace import Space

FORMAT: Final = "cspace-regions"
"""Name of the format of saved regions."""

SUFFIX: Final = ".json"
"""Suffix of files of regions."""

KIND: Final = "file of regions"
"""Kind of files of regions, for messages."""

FIELDS: Final = (
    Fields(
        "`.json` of `FreeRegions.save`",
        honoured="`format`, `axes`, `coverage`; `regions`, `A`, `b`; `pairs`, `points`",
        refused="unknown fields",
    ),
)

TOLERANCE: Final = 1e-6
"""Relative error of points that linear programs find."""

BYTES_PER_CELL: Final = 16
"""Approximate memory per cell of each rotation cell, bytes."""


@dataclass(frozen=True, eq=False, repr=False)
class FreeRegions:
    """Convex regions that cover FREE configurations, and where they overlap.

    Attributes
    ----------
    regions : tuple of ConvexRegion
    graph : mapping of (int, int) to ndarray of float64, shape (size,)
        A configuration in both regions, for each pair of regions that overlap; the lower index is
        first. Its yaw is unwrapped around the center of the first region.
    coverage : float
        Share of the volume of FREE cells, or of those around a configuration, whose centers lie in
        a region.
    """

    regions: tuple[ConvexRegion, ...]
    graph: Mapping[tuple[int, int], Floats]
    coverage: float

    def __repr__(self) -> str:
        """Return numbers of regions and overlaps, and coverage."""
        numbers = f"{len(self.regions)} regions, {len(self.graph)} overlaps"
        return f"FreeRegions({numbers}, coverage={self.coverage:.3f})"

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw all regions, as :meth:`ConvexRegion.plot` draws one."""
        return plot_regions(self.regions, ax, style)

    _repr_png_ = show_png

    @names_options
    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the regions as JSON.

        Parameters
        ----------
        path : path-like
            A name that ends in ``.json``.
        overwrite : bool
            Whether an existing file may be replaced.

        Raises
        ------
        InputError
            If the suffix is another one.
        FileError
            If the file exists and may not be replaced, or cannot be written.
        """
        check_suffix(path, (SUFFIX,), "regions are saved as JSON", is_output=True)
        record = {
            "format": FORMAT,
            "axes": list(self.regions[0].axes),
            "coverage": self.coverage,
            "regions": [{"A": each.A.tolist(), "b": each.b.tolist()} for each in self.regions],
            "pairs": list(self.graph),
            "points": [point.tolist() for point in self.graph.values()],
        }
        with replacing(path, overwrite) as temporary:
            text = json.dumps(record, allow_nan=False) + "\n"
            temporary.write_text(text, "utf-8", newline="")

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> FreeRegions:
        """Read regions that :meth:`save` wrote, to the last bit.

        They are proven for the map that they were found in; no map is asked again.

        Parameters
        ----------
        path : path-like
            A name that ends in ``.json``.

        Raises
        ------
        InputError
            If the suffix is another one.
        FileError
            If the file is missing or too large, or holds no regions.
        """
        check_suffix(path, (SUFFIX,), "regions are saved as JSON")
        record = read_document(path, KIND)
        with decoding(path, KIND, "FreeRegions.save writes such files"):
            document = Ledger(record, "the file", FIELDS[0])
            if document.need("format") != FORMAT:
                raise ValueError(f"the format is {record['format']!r}")
            for name in ("pairs", "points"):
                document.need(name)  # no overlaps are an empty list
            axes = _read_axes(document.entries("axes"))
            parts = document.children("regions", "region")
            regions = tuple(_read_region(part, axes) for part in parts)
            if not regions:
                raise ValueError("there are no regions")
            graph = _read_graph(document, regions)
            coverage = document.number("coverage", lowest=0.0, highest=1.0)
            document.close(os.fspath(path))
            return cls(regions, graph, coverage)


def _read_axes(names: list[Any]) -> tuple[str, ...]:
    """Return the names of two or three coordinates, and perhaps the yaw."""
    positions = names[:-1] if names[-1:] == [YAW] else names
    are_names = all(isinstance(name, str) and name for name in names)
    if not are_names or len(positions) not in (2, 3) or len({*positions, YAW}) <= len(positions):
        raise ValueError(f"the axes are {names}")
    return tuple(names)


def _read_region(record: Ledger, axes: tuple[str, ...]) -> ConvexRegion:
    """Return a region of JSON; raise an error unless it is bounded and not empty."""
    normals = _read_rows(record.need("A"), len(axes))
    offsets = _read_rows(record.need("b"), 1).reshape(len(normals))
    if len(normals) <= len(axes) or not np.allclose(np.linalg.norm(normals, axis=1), 1.0):
        raise ValueError("half-spaces need normals of length 1, more than there are axes")
    region = ConvexRegion(normals, offsets, axes)
    if region._has_yaw:
        arc = np.eye(len(axes))[-1]
        is_arc = np.array_equal(normals[-2:], [arc, -arc]) and not normals[:-2, -1].any()
        if not is_arc or region._arc[0] > region._arc[1]:
            raise ValueError("the last two half-spaces do not bound an arc of yaws")
    positions = region._position_half_spaces
    # A polytope is bounded if positive multiples of its normals add up to zero, and span all axes.
    _, rest = nnls(positions.normals.T, -positions.normals.sum(axis=0))
    is_spanned = np.linalg.matrix_rank(positions.normals) == positions.normals.shape[1]
    if rest > TOLERANCE or not is_spanned or find_deepest(positions)[1] < -_allow(offsets):
        raise ValueError("a region is empty or has no end")
    return region


def _read_graph(document: Ledger, regions: Sequence[ConvexRegion]) -> dict[tuple[int, int], Floats]:
    """Return the overlaps of JSON; raise an error unless points lie in their regions."""
    points = _read_rows(document.entries("points"), len(regions[0].axes))
    graph = dict[tuple[int, int], Floats]()
    for pair, point in zip(document.entries("pairs"), points, strict=True):
        first, second = pair
        if not 0 <= first < second < len(regions) or (first, second) in graph:
            raise ValueError(f"the pair {pair} names no two regions, or is there twice")
        for region in (regions[first], regions[second]):
            heights = region.A @ region.unwrap(point)
            if (heights > region.b + _allow(region.b)).any():
                raise ValueError(f"the point of the pair {pair} is not in both regions")
        graph[first, second] = point
    return graph


def _allow(offsets: Floats) -> float:
    """Return how far a point of a linear program may lie outside half-spaces."""
    return TOLERANCE * (1.0 + float(np.abs(offsets).max()))


def _read_rows(numbers: Any, size: int) -> Floats:
    """Return numbers of JSON as rows, shape (n, size).

    Raises an error unless they are finite, and not too large.
    """
    rows = np.array(numbers)
    if rows.size and (rows.dtype.kind not in "if" or not np.abs(rows).max() <= 1e100):
        raise ValueError("an entry is no number, or not finite")
    return rows.astype(np.float64).reshape(-1, size)


def free_regions(
    space: Space,
    share: float = 0.9,
    *,
    around: ArrayLike | None = None,
    reach: float = 5.0,
    margin: float = 0.0,
    max_regions: int = 1000,
    time_limit: float | None = None,
    seed: int = 0,
    progress: Callable[[int, float], None] | None = None,
) -> FreeRegions:
    """Find convex regions that cover the FREE configurations of the map.

    Each region grows around a cell that is among the farthest from all covered ones, until a
    share of the volume of FREE cells is covered, or a limit ends it. The cells of a region are
    those whose centers it contains. See :meth:`cspace.CSpace.free_region`.

    Parameters
    ----------
    share : float
        Share of the FREE volume to cover, above 0 and at most 1.
    around : array-like, shape (size,), optional
        A FREE configuration; then only the cells that FREE cells join to it count.
    reach, margin : float
        As for :meth:`cspace.CSpace.free_region`.
    max_regions : int
        Largest number of regions.
    time_limit : float, optional
        Seconds after which no further region is found.
    seed : int
        Seed of the random choice among the farthest cells.
    progress : callable, optional
        Called with (regions so far, share covered).

    Returns
    -------
    cspace.regions.FreeRegions
        The regions, the graph of their overlaps, and the share covered, which is below
        ``share`` if a limit ended the search.

    Raises
    ------
    InputError
        If the space is no such map, or a number is out of range.
    ConfigurationError
        If the map has no FREE cell, ``around`` is not FREE, or no region was found.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> occupied = np.zeros((60, 40), dtype=bool)
    >>> occupied[30, :25] = True
    >>> space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.3))
    >>> regions = space.free_regions(0.9)
    >>> regions.coverage >= 0.9, len(regions.regions) < 5
    (True, True)
    """
    source = RegionSource.of(space, reach, margin)
    wanted = check_number(share, "share")
    if not 0.0 < wanted <= 1.0:
        rule = "it must be above 0 and at most 1"
        raise InputError("share", f"is {share!r}", rule)
    most = check_count(max_regions, "max_regions", 1)
    rng = np.random.default_rng(check_count(seed, "seed"))
    until = now() + Effort.within(time_limit)
    bare = BareCells(source, around)
    regions = list[ConvexRegion]()
    while bare.coverage < wanted and len(regions) < most and not is_over(until):
        q = bare.draw(rng)
        if q is None:
            break
        bare.skip(q)
        region = source.grow_around(q, None)
        if region is None:
            continue
        regions.append(region)
        bare.cover(region)
        if progress is not None:
            progress(len(regions), bare.coverage)
    if not regions:
        problem = "ended before the first region"
        raise ConfigurationError("free_regions", problem, "a cover has a region")
    return FreeRegions(tuple(regions), find_overlaps(regions), bare.coverage)


class BareCells:
    """FREE cells that no region covers yet, with distances from others."""

    def __init__(self, source: RegionSource, around: ArrayLike | None) -> None:
        """Start with FREE cells, of a component if given."""
        space = source.space
        self._space = space
        count = len(space.rotations)
        check_memory(BYTES_PER_CELL * space.grid.size * count, "the cover", space.grid)
        shape = (count, *space.grid.shape)
        self._is_bare = space.cell_states.reshape(shape) == FREE
        if around is not None:
            self._is_bare &= find_component(space, self._is_bare, around)
        self._volumes = np.asarray(space.rotations._volumes, dtype=np.float64)
        self._total = self._measure(self._is_bare)
        if not self._total:
            raise ConfigurationError("the map", "has no FREE cell", "a region grows around one")
        self._left = self._total
        # The border of the grid counts as covered.
        self._distances = np.zeros(self._is_bare.shape, dtype=np.float32)
        inner = (slice(1, -1),) * space.grid.dim
        for k in range(count):
            padded = np.pad(self._is_bare[k], 1)
            self._distances[k] = ndimage.distance_transform_edt(padded)[inner]
        if source.margin:
            self._skip_near(source.margin)

    def _measure(self, cells: Bools) -> float:
        """Return the volume of cells, shape (rotations, ...), weighted by rotations."""
        counts = cells.reshape(len(cells), -1).sum(axis=1)
        return float(counts @ self._volumes)

    @property
    def coverage(self) -> float:
        """Share of the volume that is covered."""
        return 1.0 - max(self._left, 0.0) / self._total

    def draw(self, rng: np.random.Generator) -> Floats | None:
        """Draw the center of a cell among the farthest from others.

        Returns None if all cells are covered.
        """
        largest = float(self._distances.max())
        if not largest:
            return None
        # Share of the largest distance from covered cells from which on cells are drawn as next
        # ones.
        flat = rng.choice(np.flatnonzero(self._distances >= 0.9 * largest))
        rotation, *cell = np.unravel_index(int(flat), self._distances.shape)
        center = self._space.grid.center_of(cell)
        return np.concatenate([center, self._space.rotations.centers[rotation]])

    def _skip_near(self, margin: float) -> None:
        """Draw no cell whose center is within a margin of cells that are not FREE.

        Raises InputError if there is no other.
        """
        space = self._space
        spacing = space.grid.spacing
        clearances = DistanceTable.of(space).cells.reshape(-1, *space.grid.shape)[space.slice_of]
        # Regions of almost no room are not worth their time.
        self._distances[clearances <= (1.0 + 1e-6) * margin / spacing + 1e-6] = 0.0
        if self._distances.any():
            return
        most = spacing * float(clearances[self._is_bare].max())
        problem = f"is {margin:g}, and no cell's center is farther from cells that are not FREE"
        rule = f"regions grow around centers, and the farthest is {most:.4g} m away"
        raise InputError("margin", problem, rule)

    def skip(self, q: Floats) -> None:
        """Draw the cell of a configuration never again."""
        space = self._space
        rotation = space.rotations.cell_of(q[space.grid.dim :]).item()
        cell = space.grid.cell_of(q[: space.grid.dim])
        self._distances[rotation, *cell] = 0.0

    def cover(self, region: ConvexRegion) -> None:
        """Count the cells whose centers are in a region as covered."""
        space = self._space
        dim = space.grid.dim
        low, high = (space.grid.cell_of(corner[:dim]) for corner in region.bounds)
        # Cells farther from the region than any cell is from others stay as far from these.
        reach = math.ceil(float(self._distances.max())) + 1
        first = np.maximum(low - reach, 0)
        stop = np.minimum(high + reach + 1, space.grid.shape)
        window = tuple(map(slice, first, stop))
        is_inside = find_cells_inside(space, region, first, stop)
        if not is_inside.any():
            return
        distances: Floats = ndimage.distance_transform_edt(~is_inside)
        rotations = np.zeros(1, dtype=np.int64)
        if region._has_yaw:
            yaws = np.zeros((len(space.rotations), space.size))
            yaws[:, :dim] = region.center[:dim]
            yaws[:, dim:] = space.rotations.centers
            rotations = np.flatnonzero(region.contains(yaws))
        for k in rotations.tolist():
            part = self._is_bare[k][window]
            self._left -= float((part & is_inside).sum() * self._volumes[k])
            part &= ~is_inside
            np.minimum(self._distances[k][window], distances, out=self._distances[k][window])


def find_component(space: Any, is_free: Bools, around: ArrayLike) -> Bools:
    """Return a mask of a configuration's FREE component.

    It has shape (rotations, ...), as the mask ``is_free`` of all FREE cells.
    """
    q = space.check_configuration(around, "around")
    if not space.grid.contains(q[: space.grid.dim]) or not space.is_free(q):
        rule = "it must be one FREE configuration in the grid"
        raise ConfigurationError("around", f"is {around!r}", rule)
    rotations, *cells = np.nonzero(is_free)
    centers = space.grid.center_of(np.stack(cells, axis=-1))
    centers = np.concatenate([centers, space.rotations.centers[rotations]], axis=-1)
    with space.lock:  # an update changes the components
        is_member = find_components(space, centers) == find_components(space, q[np.newaxis])
    mask = np.zeros_like(is_free)
    mask[is_free] = is_member
    return mask


def find_cells_inside(space: Any, region: ConvexRegion, first: Ints, stop: Ints) -> Bools:
    """Return which cells of a box have centers in a region.

    Only positions count.
    """
    grid = space.grid
    dim = grid.dim
    centers = [grid.centers(axis)[first[axis] : stop[axis]] for axis in range(dim)]
    mesh = np.meshgrid(*centers, indexing="ij", sparse=True)
    is_inside = np.ones(stop - first, dtype=np.bool_)
    for normal, offset in zip(*region._position_half_spaces, strict=True):
        values = sum(normal[axis] * mesh[axis] for axis in range(dim))
        is_inside &= np.asarray(values <= offset)
    return is_inside


def find_overlaps(regions: list[ConvexRegion]) -> dict[tuple[int, int], Floats]:
    """Find the pairs of regions that overlap, with their deepest positions."""
    boxes = [region.bounds for region in regions]
    graph = dict[tuple[int, int], Floats]()
    for (i, first), (j, second) in combinations(enumerate(regions), 2):
        (low, high), (other_low, other_high) = boxes[i], boxes[j]
        yaws = np.empty(0)
        positions = slice(None)
        if first._has_yaw:
            # Yaws of the second region, unwrapped around the first one.
            shift = first.unwrap(second.center)[-1] - second._middle_yaw
            lowest = max(first._arc[0], second._arc[0] + shift)
            highest = min(first._arc[1], second._arc[1] + shift)
            if lowest > highest:
                continue
            yaws = np.array([0.5 * (lowest + highest)])
            positions = slice(-1)
        if (low > other_high)[positions].any() or (other_low > high)[positions].any():
            continue
        joint = first._position_half_spaces.join(second._position_half_spaces)
        deepest, radius = find_deepest(joint)
        if radius > 0.0:
            graph[i, j] = np.concatenate([deepest, yaws])
    return graph
