"""Connected components of a tiled map.

The *region* of a tile is its interior and, along each axis, one more layer of cells: the first layer
of the next tile. A *node* is a component of a region over all rotation cells. A cell of a shared
layer has a node in two regions, which join there. So cells are joined as in one map: two neighbors
lie in a common region, and a component that leaves a region passes a shared layer.

FREE cells and open cells, which are FREE or MIXED, have nodes of their own. Open cells at the border
of the grid also join the exterior, which is a node for each rotation cell that is open there.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import FREE, MIXED, Bools, Ints
from cspace.map.contents import Contents
from cspace.tiles.folder import ONE_MORE, Index, TileFolder, as_box, fresh_name
from cspace.tiles.parts import OpenTiles, group_rows
from cspace.tiles.work import run_tasks

if TYPE_CHECKING:
    from distributed import Client

KINDS: Final = (FREE, MIXED)
"""Kinds of components, by the highest state of their cells."""

LABEL_FILE: Final = "components.npz"
"""Name of the file with the joined nodes of all tiles, in the folder of the map."""

LABEL_BYTES_PER_STATE: Final = 24
"""Memory for each state while a tile is labelled, in bytes, if every other cell is FREE."""

MAX_CROSSING_DEPTH_CELLS: Final = 8.0
"""Crossings this far from the boundary of a common face are equally good, in cells."""

MAX_REGIONS: Final = 8
"""Number of labelled regions that stay in memory between queries."""


# ---- one region ----------------------------------------------------------------------------------


class Runs(NamedTuple):
    """Runs of cells along the last axis of one slice, ascending.

    Attributes
    ----------
    first, stop : ndarray of int64, shape (n,)
        First cell of a run, and the cell after its last one, as indices in the flat slice.
    labels : ndarray of int64, shape (n,)
        Component of a run in its slice.
    """

    first: Ints
    stop: Ints
    labels: Ints


def find_runs(cells: Bools) -> Runs:
    """Find and label the runs of set cells; cells of a component share sides."""
    length = cells.shape[-1]
    padded = np.pad(cells.reshape(-1, length), [(0, 0), (0, 1)]).view(np.int8)
    change = np.diff(padded.reshape(-1), prepend=np.int8(0))
    first, stop = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    first, stop = (ends - first // (length + 1) for ends in (first, stop))
    pairs, stride = [], length
    for side in reversed(cells.shape[:-1]):
        # Runs meet runs of the next row along the axis if they overlap when moved there.
        moved = np.flatnonzero(first // stride % side < side - 1)
        one, other = find_overlaps(first[moved] + stride, stop[moved] + stride, first, stop)
        pairs.append(np.stack([moved[one], other], axis=1))
        stride *= side
    return Runs(first, stop, join_nodes(len(first), np.concatenate(pairs)))


def find_overlaps(first: Ints, stop: Ints, other_first: Ints, other_stop: Ints) -> tuple[Ints, Ints]:
    """Return the pairs of runs that overlap; the runs of each list are ascending and disjoint."""
    low = np.searchsorted(other_stop, first, side="right")
    count = np.maximum(np.searchsorted(other_first, stop, side="left") - low, 0)
    one = np.repeat(np.arange(len(first)), count)
    other = np.arange(len(one)) + np.repeat(low - np.cumsum(count) + count, count)
    return one, other


def join_nodes(count: int, pairs: Ints) -> Ints:
    """Return the component of each node, given pairs of joined nodes, shape (n, 2)."""
    from scipy.sparse.csgraph import connected_components

    labels: NDArray[Any] = connected_components(make_graph(count, pairs), directed=False)[1]
    return labels.astype(np.int64)


def make_graph(count: int, pairs: Ints) -> Any:
    """Return pairs of joined nodes as a sparse matrix."""
    from scipy.sparse import coo_matrix

    return coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))


class Region:
    """Nodes of one kind of a region.

    Attributes
    ----------
    count : int
        Number of nodes.
    """

    def __init__(self, folder: TileFolder, index: Index, tile: Contents, kind: int) -> None:
        corners = folder.clip(folder.interior(index) + ONE_MORE)
        own = as_box(corners - folder.cells(index)[0])
        self._first, self._slice_of = corners[0], folder.slice_of
        self._shape = tuple(corners[1] - corners[0])
        self._runs = [find_runs(states[own] <= kind) for states in tile.states]
        counts = np.array([runs.labels.max(initial=-1) + 1 for runs in self._runs])
        self._offsets = np.cumsum([0, *counts[self._slice_of]])
        joined = [np.empty((0, 2), dtype=np.int64)]
        for turn, others in enumerate(folder.rotations._neighbors.tolist()):
            runs = self._runs[self._slice_of[turn]]
            for other in others:
                if other > turn:
                    beside = self._runs[self._slice_of[other]]
                    a, b = find_overlaps(runs.first, runs.stop, beside.first, beside.stop)
                    both = runs.labels[a], beside.labels[b], *self._offsets[[turn, other]]
                    joined.append(join_labels(*both))
        self._nodes = join_nodes(int(self._offsets[-1]), np.concatenate(joined))
        self.count = int(self._nodes.max(initial=-1)) + 1

    def find(self, turn: int, cells: Ints) -> Ints:
        """Return the nodes of cells of the whole grid, shape (n, d), at a rotation cell, or -1."""
        runs = self._runs[self._slice_of[turn]]
        flat = np.ravel_multi_index(tuple((cells - self._first).T), self._shape)
        run = np.searchsorted(runs.first, flat, side="right") - 1
        inside = np.flatnonzero((run >= 0) & (flat < np.append(runs.stop, 0)[run]))
        nodes = np.full(len(cells), -1, dtype=np.int64)
        nodes[inside] = self._nodes[self._offsets[turn] + runs.labels[run[inside]]]
        return nodes

    def find_all(self, cells: Ints) -> Ints:
        """Return the nodes of cells at all rotation cells, shape (rotations, n)."""
        return np.stack([self.find(turn, cells) for turn in range(len(self._slice_of))])


def join_labels(labels: Ints, others: Ints, first: int, other_first: int) -> Ints:
    """Return the distinct pairs of nodes at one place, shape (n, 2); labels may be -1."""
    both = np.stack(np.broadcast_arrays(labels, others), axis=-1)
    return np.unique(both[(both >= 0).all(axis=-1)], axis=0) + np.array([first, other_first])


def list_layers(folder: TileFolder, index: Index) -> list[Ints]:
    """Return the cells of the first and the last layer of a region along each axis, shape (n, d).

    Along the other axes they are those of the interior.
    """
    layers = []
    for axis, n in enumerate(folder.grid.shape):
        spans = [range(*ends) for ends in folder.interior(index).T]
        for cell in (spans[axis][0], min(spans[axis][-1] + 1, n - 1)):
            layer = [*spans[:axis], [cell], *spans[axis + 1 :]]
            mesh = np.meshgrid(*layer, indexing="ij")
            layers.append(np.stack(mesh, axis=-1).reshape(-1, len(spans)))
    return layers


# ---- all tiles -----------------------------------------------------------------------------------

Labels = tuple[int, list[Ints]]
"""Number of nodes of a region, and those of the cells of each layer, shape (rotations, n)."""


def label_tile(folder: TileFolder, index: Index) -> list[Labels]:
    """Label the region of a tile for both kinds, as a task."""
    tile, found = folder.read_tile(index), list[Labels]()
    for kind in KINDS:
        region = Region(folder, index, tile, kind)
        found.append((region.count, list(map(region.find_all, list_layers(folder, index)))))
    return found


def compute_components(
    folder: TileFolder, client: Client | None, progress: Callable[[int, int], None] | None
) -> dict[str, Any]:
    """Label all tiles; return the first node of each tile, and the pairs of joined nodes."""

    def advance(done: int) -> None:
        if progress is not None:
            progress(done, len(folder))

    needed = LABEL_BYTES_PER_STATE * folder.slices * float(np.prod(folder.tile))
    found = run_tasks(label_tile, folder, list(folder), needed, client, None, advance)
    joined: dict[str, Any] = {"key": folder.attributes["digest"]}
    for kind in KINDS:
        offsets = np.cumsum([0, *(labels[kind][0] for labels in found)])
        layers = {index: labels[kind][1] for index, labels in zip(folder, found, strict=True)}
        pairs = _join_tiles(folder, layers, offsets, with_exterior=kind == MIXED)
        joined[f"offsets_{kind}"] = offsets
        joined[f"pairs_{kind}"] = np.concatenate([np.empty((0, 2), dtype=np.int64), *pairs])
    return joined


def _join_tiles(
    folder: TileFolder, layers: Mapping[Index, list[Ints]], offsets: Ints, with_exterior: bool
) -> Iterator[Ints]:
    """Yield pairs of joined nodes, shape (n, 2); those of the exterior are the last."""
    numbers = {index: number for number, index in enumerate(folder)}
    exterior = np.where(find_open_exteriors(folder), np.arange(len(folder.rotations)), -1)
    for index, number in numbers.items():
        for side, layer in enumerate(layers[index]):
            axis, step = side // 2, side % 2 * 2 - 1
            beside = tuple(i + step * (k == axis) for k, i in enumerate(index))
            if beside not in numbers and with_exterior:
                yield join_labels(layer, exterior[:, None], offsets[number], offsets[-1])
            elif beside in numbers and step == 1:
                other = layers[beside][2 * axis]
                yield join_labels(layer, other, offsets[number], offsets[numbers[beside]])
    for others in folder.rotations._neighbors.T * with_exterior:
        known = np.where(others >= 0, exterior[others], -1)
        yield join_labels(exterior, known, offsets[-1], offsets[-1])


def find_open_exteriors(folder: TileFolder) -> Bools:
    """Return whether each rotation cell has a cell outside the grid that is not BLOCKED."""
    exterior = folder.frame.exterior
    is_blocked = exterior is None or exterior.is_all_blocked(folder.grid.shape)
    return ~np.asarray(is_blocked)[folder.slice_of]


class TiledComponents:
    """Connected components of a tiled map, read from its folder, or computed and saved there.

    The nodes of a tile have consecutive numbers. The last nodes are the exterior, one for each
    rotation cell.
    """

    def __init__(
        self,
        tiles: OpenTiles,
        client: Client | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        self._tiles, self._folder = tiles, tiles.folder
        self._regions: OrderedDict[tuple[Index, int], Region] = OrderedDict()
        saved = self._load()
        if not saved:
            saved = compute_components(self._folder, client, progress)
            temporary = self._folder.path / f"{fresh_name('.cspace')}.npz"
            np.savez_compressed(temporary, **saved)
            temporary.replace(self._folder.path / LABEL_FILE)
        self._offsets = [saved[f"offsets_{kind}"] for kind in KINDS]
        self._pairs = [saved[f"pairs_{kind}"] for kind in KINDS]
        self._counts = [int(each[-1]) + len(self._folder.rotations) for each in self._offsets]
        self._roots = [join_nodes(self._counts[kind], self._pairs[kind]) for kind in KINDS]

    def _load(self) -> Mapping[str, Any]:
        """Return what is saved in the folder, if it belongs to this state of the map."""
        try:
            with np.load(self._folder.path / LABEL_FILE, allow_pickle=False) as opened:
                saved = dict(opened)
        except Exception:  # missing or damaged in any way; then it is computed again
            return {}
        return saved if str(saved.get("key")) == self._folder.attributes["digest"] else {}

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the components of cells ``(rotation, x, y(, z))``, or -1.

        Cells are FREE, or with ``mixed`` not BLOCKED; they may lie outside the grid.
        """
        nodes = self._find_nodes(cells, MIXED if mixed else FREE)
        return np.where(nodes >= 0, self._roots[int(mixed)][nodes], -1)

    def _find_nodes(self, cells: Ints, kind: int) -> Ints:
        """Return the nodes of cells, or -1."""
        folder, offsets = self._folder, self._offsets[kind]
        turns, places = cells[:, 0], cells[:, 1:]
        inside = ((places >= 0) & (places < folder.grid.shape)).all(axis=1)
        nodes = np.full(len(cells), -1, dtype=np.int64)
        if kind == MIXED:
            outside = ~inside & find_open_exteriors(folder)[turns]
            nodes[outside] = offsets[-1] + turns[outside]
        keys = np.column_stack([places // folder.tile, turns])
        for (*index, turn), rows in group_rows(keys, np.flatnonzero(inside)):
            found = self._region(tuple(index), kind).find(turn, places[rows])
            first = offsets[np.ravel_multi_index(index, folder.counts)]
            nodes[rows] = np.where(found >= 0, first + found, -1)
        return nodes

    def _region(self, index: Index, kind: int) -> Region:
        """Return the labelled region of a tile."""
        key = index, kind
        if key not in self._regions:
            self._regions[key] = Region(self._folder, index, self._tiles.contents(index), kind)
            if len(self._regions) > MAX_REGIONS:
                self._regions.popitem(last=False)
        self._regions.move_to_end(key)
        return self._regions[key]

    def chain(self, start: Ints, goal: Ints) -> tuple[list[Index], Ints]:
        """Return a shortest chain of tiles between two cells of the grid, and its crossings.

        It passes through FREE cells only, and is empty if none join the two. The crossings, shape
        (len(tiles) - 1, 1 + d), are FREE cells in the shared layer of a tile and the next one.
        """
        from scipy.sparse.csgraph import dijkstra

        offsets, crossings = self._offsets[FREE], [start]
        first, last = self._find_nodes(np.stack([start, goal]), FREE).tolist()
        graph = make_graph(self._counts[FREE], self._pairs[FREE])
        options = {"directed": False, "unweighted": True, "return_predecessors": True}
        before = dijkstra(graph, indices=max(first, 0), **options)[1]
        nodes = [last]
        while nodes[0] not in (first, -1):
            nodes.insert(0, max(int(before[nodes[0]]), -1))
        if nodes[0] == -1 or first == -1:
            nodes = []
        numbers = np.searchsorted(offsets, nodes, side="right") - 1
        tiles = [tuple(map(int, np.unravel_index(k, self._folder.counts))) for k in numbers]
        labels = np.array(nodes, dtype=np.int64) - offsets[numbers]
        for k in range(len(tiles) - 1):
            pair = slice(k, k + 2)
            crossings.append(self._find_crossing(tiles[pair], labels[pair], crossings[-1], goal))
        return tiles, np.array(crossings[1:], dtype=np.int64).reshape(-1, len(start))

    def _find_crossing(self, tiles: list[Index], labels: Ints, start: Ints, goal: Ints) -> Ints:
        """Return a cell of the layer that two tiles share, with a given label in each.

        Of the cells far from the boundary of the common area, it is the one with the shortest way
        from ``start`` and to ``goal``.
        """
        from scipy.ndimage import distance_transform_edt

        upper = max(tiles)  # the two differ along one axis
        axis = int(np.flatnonzero(np.subtract(*tiles))[0])
        cells = list_layers(self._folder, upper)[2 * axis]
        one, other = (self._region(tile, FREE).find_all(cells) for tile in tiles)
        common = (one == labels[0]) & (other == labels[1])
        sides = np.delete(np.diff(self._folder.interior(upper), axis=0), axis)
        area = np.pad(common.reshape(-1, *sides), 1)
        depth = distance_transform_edt(area)[(slice(1, -1),) * area.ndim].reshape(common.shape)
        turns, places = np.nonzero(common & (depth >= min(MAX_CROSSING_DEPTH_CELLS, depth.max())))
        found = np.column_stack([turns, cells[places]])
        way = sum(np.linalg.norm((found - end)[:, 1:].astype(float), axis=1) for end in (start, goal))
        best: Ints = found[int(np.argmin(way))]
        return best
