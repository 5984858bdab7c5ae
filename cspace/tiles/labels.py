"""Connected components of a tiled map.

The *region* of a tile is its interior and, along each axis, one more layer of cells: the first layer
of the next tile. A *node* is a component of a region over all rotation cells. A cell of a shared
layer has a node in two regions, which join there. So cells are joined as in one map: two neighbors
lie in a common region, and a component that leaves a region passes a shared layer.

FREE cells and open cells, which are FREE or MIXED, have nodes of their own. Open cells at the border
of the grid also join the exterior, which is a node for each rotation cell that is open there.

Here a cell is ``(rotation cell, x, y)`` or ``(rotation cell, x, y, z)``.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import FREE, MIXED, Bools, Ints
from cspace.files.access import replacing
from cspace.limits import check_bytes
from cspace.map.contents import Contents
from cspace.save import map_error
from cspace.tiles.folder import ONE_MORE, Index, TileFolder, as_box
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


class Region:
    """Nodes of one kind of a region.

    Its cells are numbered in a row. A *run* is a row of neighboring cells of the kind, along the last
    axis. Runs that overlap when one is moved to the next row, or to the next rotation cell, join.

    Attributes
    ----------
    count : int
        Number of nodes.
    """

    def __init__(self, folder: TileFolder, index: Index, tile: Contents, kind: int) -> None:
        corners = folder.clip(folder.interior(index) + ONE_MORE)
        own, neighbors = as_box(corners - folder.cells(index)[0]), folder.rotations._neighbors
        shape = (corners[1] - corners[0]).tolist()
        self._first_cell = np.array([0, *corners[0]])
        self._shape, size = (len(folder.rotations), *shape), math.prod(shape)
        runs = [find_runs(states[own] <= kind) for states in tile.states]
        places = [runs[k] + turn * size for turn, k in enumerate(folder.slice_of.tolist())]
        self._first, self._stop = first, stop = np.concatenate(places, axis=1)
        turn, place = first // size, first % size
        moves, stride = [], shape[-1]
        for side in reversed(shape[:-1]):
            moves.append(np.where(place // stride % side < side - 1, stride, 0))
            stride *= side
        beside = (column[turn] for column in neighbors.T)
        moves += [np.where(other >= 0, (other - turn) * size, 0) for other in beside]
        pairs = [np.empty((0, 2), dtype=np.int64)]
        for move in moves:
            moved = np.flatnonzero(move)
            low = np.searchsorted(stop, (first + move)[moved], side="right")
            count = np.searchsorted(first, (stop + move)[moved], side="left") - low
            other = np.arange(count.sum()) + np.repeat(low - np.cumsum(count) + count, count)
            pairs.append(np.stack([np.repeat(moved, count), other], axis=1))
        self._nodes = join_nodes(len(first), np.concatenate(pairs))
        self.count = int(self._nodes.max(initial=-1)) + 1

    def find(self, cells: Ints) -> Ints:
        """Return the nodes of cells of the whole map in this region, shape (n, 1 + d), or -1."""
        place = np.ravel_multi_index(tuple((cells - self._first_cell).T), self._shape)
        run = np.searchsorted(self._stop, place, side="right")
        is_in = np.append(self._first, place.max(initial=0) + 1)[run] <= place
        return np.asarray(np.where(is_in, np.append(self._nodes, -1)[run], -1))


def find_runs(cells: Bools) -> Ints:
    """Return the first cell of each run of set cells, and the cell after its last, shape (2, n)."""
    length = cells.shape[-1]
    padded = np.pad(cells.reshape(-1, length), [(0, 0), (0, 1)]).view(np.int8)
    change = np.diff(padded.reshape(-1), prepend=np.int8(0))
    first, stop = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return np.asarray(np.stack([first, stop]) - first // (length + 1))


def join_nodes(count: int, pairs: Ints) -> Ints:
    """Return the component of each node, given pairs of joined nodes, shape (n, 2)."""
    from scipy.sparse.csgraph import connected_components

    labels = connected_components(make_graph(count, pairs), directed=False)[1]
    return np.asarray(labels, dtype=np.int64)


def make_graph(count: int, pairs: Ints) -> Any:
    """Return pairs of joined nodes as a sparse matrix."""
    from scipy.sparse import coo_matrix

    return coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))


def list_layers(folder: TileFolder, index: Index) -> Iterator[Ints]:
    """Yield the cells of the first and the last layer of a region along each axis, shape (n, 1 + d).

    Along the other axes they are those of the interior.
    """
    for axis, n in enumerate(folder.grid.shape):
        spans = [range(*ends) for ends in folder.interior(index).T]
        for cell in (spans[axis][0], min(spans[axis][-1] + 1, n - 1)):
            layer = [range(len(folder.rotations)), *spans]
            layer[1 + axis] = range(cell, cell + 1)
            mesh = np.meshgrid(*layer, indexing="ij")
            yield np.stack(mesh, axis=-1).reshape(-1, len(layer))


# ---- all tiles -----------------------------------------------------------------------------------

Labels = tuple[int, list[Ints]]
"""Number of nodes of a region, and the nodes of the cells of each layer."""


def label_tile(folder: TileFolder, index: Index) -> list[Labels]:
    """Label the region of a tile for both kinds, as a task."""
    tile, found = folder.read_tile(index), []
    for kind in KINDS:
        region = Region(folder, index, tile, kind)
        found.append((region.count, [region.find(layer) for layer in list_layers(folder, index)]))
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
        offsets = np.cumsum([0, *(labels[kind][0] for labels in found)], dtype=np.int64)
        nodes = {
            index: [np.where(layer >= 0, layer + first, -1) for layer in labels[kind][1]]
            for index, labels, first in zip(folder, found, offsets, strict=False)
        }
        exterior = np.where(find_open_exteriors(folder), np.arange(len(folder.rotations)), -1)
        exterior = np.where(exterior >= 0, exterior + offsets[-1], -1)
        pairs = list(_join_tiles(folder, nodes, exterior if kind == MIXED else -1 + 0 * exterior))
        joined |= {f"offsets_{kind}": offsets, f"pairs_{kind}": np.concatenate(pairs)}
    return joined


def _join_tiles(folder: TileFolder, nodes: Mapping[Index, list[Ints]], exterior: Ints) -> Iterator[Ints]:
    """Yield pairs of joined nodes, shape (n, 2); ``exterior`` has a node for each rotation cell."""
    for index, layers in nodes.items():
        for side, layer in enumerate(layers):
            beside = list(index)
            beside[side // 2] += side % 2 * 2 - 1
            if tuple(beside) in nodes:
                yield join_nodes_of(layer, nodes[tuple(beside)][side ^ 1])
            else:
                yield join_nodes_of(layer.reshape(len(exterior), -1), exterior[:, None])
    for others in folder.rotations._neighbors.T:
        yield join_nodes_of(exterior, np.where(others >= 0, exterior[others], -1))


def join_nodes_of(nodes: Ints, others: Ints) -> Ints:
    """Return the distinct pairs of nodes at one place, shape (n, 2), without those of -1."""
    both = np.stack(np.broadcast_arrays(nodes, others), axis=-1)
    return np.unique(both[(both >= 0).all(axis=-1)], axis=0)


def find_open_exteriors(folder: TileFolder) -> Bools:
    """Return whether each rotation cell has a cell outside the grid that is not BLOCKED."""
    return ~folder.exterior.is_all_blocked(folder.grid.shape)[folder.slice_of]


def check_saved(folder: TileFolder, saved: Mapping[str, Any]) -> None:
    """Raise ValueError, or any other error, if saved components are of another map or damaged."""
    if str(saved["key"]) != folder.attributes["digest"]:
        raise ValueError("they are of another state of the map")
    for kind in KINDS:
        offsets, pairs = saved[f"offsets_{kind}"], saved[f"pairs_{kind}"]
        shapes = offsets.shape, pairs.shape
        if shapes != ((len(folder) + 1,), (len(pairs), 2)) or {offsets.dtype, pairs.dtype} != {np.dtype(np.int64)}:
            raise ValueError("they have other sizes")
        count = offsets[-1] + len(folder.rotations)
        if offsets[0] != 0 or (np.diff(offsets) < 0).any() or ((pairs < 0) | (pairs >= count)).any():
            raise ValueError("they join other nodes")


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
            with replacing(self._folder.path / LABEL_FILE, overwrite=True) as temporary:
                np.savez_compressed(temporary, **saved)
        self._offsets = [saved[f"offsets_{kind}"] for kind in KINDS]
        self._pairs = [saved[f"pairs_{kind}"] for kind in KINDS]
        self._counts = [int(each[-1]) + len(self._folder.rotations) for each in self._offsets]
        self._roots = [join_nodes(self._counts[kind], self._pairs[kind]) for kind in KINDS]

    def _load(self) -> Mapping[str, Any]:
        """Return what is saved in the folder, if it belongs to this state of the map."""
        path = self._folder.path / LABEL_FILE
        try:
            with np.load(path, allow_pickle=False) as opened:
                check_bytes(path, sum(part.file_size for part in opened.zip.infolist()), "unpacks to")
                saved = dict(opened)
            check_saved(self._folder, saved)
        except Exception:  # missing or damaged in any way; then it is computed again
            return {}
        return saved

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the components of cells, inside the grid or not, or -1.

        Cells are FREE, or with ``mixed`` not BLOCKED.
        """
        nodes = self._find_nodes(cells, MIXED if mixed else FREE)
        return np.where(nodes >= 0, self._roots[int(mixed)][nodes], -1)

    def _find_nodes(self, cells: Ints, kind: int) -> Ints:
        """Return the nodes of cells, or -1."""
        folder, places = self._folder, cells[:, 1:]
        inside = ((places >= 0) & (places < folder.grid.shape)).all(axis=1)
        nodes = np.full(len(cells), -1, dtype=np.int64)
        if kind == MIXED:
            outside = ~inside & find_open_exteriors(folder)[cells[:, 0]]
            nodes[outside] = self._offsets[kind][-1] + cells[outside, 0]
        for index, rows in group_rows(places // folder.tile, np.flatnonzero(inside)):
            found = self._region(index, kind).find(cells[rows])
            first = self._offsets[kind][np.ravel_multi_index(index, folder.counts)]
            nodes[rows] = np.where(found >= 0, first + found, -1)
        return nodes

    def _region(self, index: Index, kind: int) -> Region:
        """Return the labelled region of a tile."""
        key, number = (index, kind), np.ravel_multi_index(index, self._folder.counts)
        if key not in self._regions:
            self._regions[key] = Region(self._folder, index, self._tiles.contents(index), kind)
            first, stop = self._offsets[kind][number : number + 2]
            if stop - first != self._regions[key].count:
                raise map_error(self._folder.path / LABEL_FILE, "it is of another map")
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
        if -1 in (first, nodes[0]):
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
        axis = int(np.flatnonzero(np.diff(tiles, axis=0))[0])
        cells = list(list_layers(self._folder, upper))[2 * axis]
        one, other = (self._region(tile, FREE).find(cells) for tile in tiles)
        sides = np.delete(np.diff(self._folder.interior(upper), axis=0), axis)
        common = ((one == labels[0]) & (other == labels[1])).reshape(-1, *sides)
        inner = (slice(1, -1),) * common.ndim
        depth = distance_transform_edt(np.pad(common, 1))[inner].ravel()
        found = cells[depth >= min(MAX_CROSSING_DEPTH_CELLS, depth.max())]
        way = sum(np.linalg.norm((found - end)[:, 1:].astype(float), axis=1) for end in (start, goal))
        best: Ints = found[int(np.argmin(way))]
        return best
