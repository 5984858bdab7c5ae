"""Connected components of a tiled map.

The *region* of a tile is its interior and, along each axis, one more layer of cells: the first
layer of the next tile. A *node* is a component of a region over all rotation cells. A cell of a
shared layer has a node in two regions, which join there. So cells are joined as in one map: two
neighbors lie in a common region, and a component that leaves a region passes a shared layer.

FREE cells and open cells, which are FREE or MIXED, have nodes of their own. Open cells at the
border of the grid also join the exterior, which is a node for each rotation cell that is open
there.

Here a cell is ``(rotation cell, x, y)`` or ``(rotation cell, x, y, z)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, csgraph

from cspace.queries.components import Components
from cspace.record.contents import Contents
from cspace.support.arrays import Ints
from cspace.tiles.folder import ONE_MORE, Index, TileFolder, as_box
from cspace.tiles.parts import OpenTiles
from cspace.tiles.work import Progress, run_tasks

if TYPE_CHECKING:
    from distributed import Client

LABEL_BYTES_PER_STATE: Final = 24
"""Memory for each state while a tile is labelled, in bytes, if every other cell is FREE."""

MAX_CROSSING_DEPTH_CELLS: Final = 8.0
"""Crossings this far from the boundary of a common face are equally good, in cells."""

MAX_REGIONS: Final = 8
"""Number of labelled regions that stay in memory between queries."""

Layers = list[Ints]
"""Nodes of the cells of the first and the last layer of a region along each axis, or -1."""


def label_region(folder: TileFolder, index: Index, tile: Contents) -> Components:
    """Return the components of a tile's region, whose first cell is that of the interior."""
    region = folder.clip(folder.interior(index) + ONE_MORE)
    own = as_box(region - folder.cells(index)[0])
    closed = np.zeros(folder.slices, dtype=np.bool_)
    return Components(
        tile.states[(slice(None), *own)], tile.slice_of, tile.rotations.neighbors, closed
    )


def find_in_region(
    folder: TileFolder, index: Index, region: Components, cells: Ints, mixed: bool
) -> Ints:
    """Return the components in a region of cells of the whole map, shape (n, 1 + d), or -1."""
    return region.of(cells - np.array([0, *folder.interior(index)[0]]), mixed)


def list_layers(folder: TileFolder, index: Index) -> list[Ints]:
    """Return the cells of the first and the last layer of a region along each axis.

    Each array has the shape (n, 1 + d). Along the other axes, the cells are those of the interior.
    """
    corners, layers = folder.interior(index), []
    for axis, n in enumerate(folder.grid.shape):
        for cell in (corners[0, axis], min(corners[1, axis], n - 1)):
            first, stop = corners.copy()
            first[axis], stop[axis] = cell, cell + 1
            cells = np.indices((len(folder.frame.slice_of), *(stop - first)))
            layers.append(cells.reshape(len(cells), -1).T + np.array([0, *first]))
    return layers


def label_tile(folder: TileFolder, index: Index) -> list[tuple[int, Layers]]:
    """Label the FREE cells and the open cells of a region, as a task.

    Return, for each, the number of nodes and the nodes of the layers.
    """
    region = label_region(folder, index, folder.read_tile(index))
    layers = list_layers(folder, index)

    def label(mixed: bool) -> tuple[int, Layers]:
        nodes = [find_in_region(folder, index, region, layer, mixed) for layer in layers]
        return region.count(mixed), nodes

    return [label(False), label(True)]


def join_tiles(folder: TileFolder, nodes: Mapping[Index, Layers], exterior: Ints) -> Ints:
    """Return the distinct pairs of joined nodes, shape (n, 2)."""
    pairs = [np.empty((0, 2), dtype=np.int64)]

    def join(first: Ints, second: Ints) -> None:
        both = np.stack(np.broadcast_arrays(first, second), axis=-1)
        pairs.append(np.unique(both[(both >= 0).all(axis=-1)], axis=0))

    for index, layers in nodes.items():
        for side, layer in enumerate(layers):
            axis, is_last = divmod(side, 2)
            beside = list(index)
            beside[axis] += 1 if is_last else -1
            if tuple(beside) not in nodes:
                join(layer.reshape(len(exterior), -1), exterior[:, None])
            elif is_last:
                join(layer, nodes[tuple(beside)][side - 1])
    for others in folder.frame.rotations.neighbors.T:
        join(exterior, np.where(others >= 0, exterior[others], -1))
    return np.concatenate(pairs)


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of all tiles, for FREE cells or for open cells.

    The nodes of a tile have consecutive numbers. The last nodes are the exterior, one for each
    rotation cell.

    Attributes
    ----------
    offsets : ndarray of int64, shape (tiles + 1,)
        First node of each tile, and of the exterior.
    exterior : ndarray of int64, shape (rotations,)
        Node of the exterior at each rotation cell, or -1 if it is closed.
    graph : sparse array
        Joined nodes.
    roots : ndarray of int32, shape (nodes,)
        Component of each node.
    """

    offsets: Ints
    exterior: Ints
    graph: Any
    roots: Any

    @classmethod
    def join(cls, folder: TileFolder, labels: Sequence[tuple[int, Layers]], mixed: bool) -> Nodes:
        """Join the nodes of all tiles; open cells join the exterior too."""
        offsets = np.cumsum([0, *(count for count, _ in labels)], dtype=np.int64)
        nodes = {
            index: [np.where(layer >= 0, layer + first, -1) for layer in layers]
            for index, first, (_, layers) in zip(folder, offsets, labels, strict=False)
        }
        slice_of = folder.frame.slice_of
        is_open = ~folder.exterior.is_all_blocked(folder.grid.shape)[slice_of]
        exterior = np.where(is_open & mixed, offsets[-1] + np.arange(len(slice_of)), -1)
        first, second = join_tiles(folder, nodes, exterior).T
        count = int(offsets[-1]) + len(slice_of)
        graph = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
        roots = csgraph.connected_components(graph, directed=False)[1]
        return cls(offsets, exterior, graph, roots)


class TiledComponents:
    """Connected components of a tiled map."""

    def __init__(
        self, tiles: OpenTiles, client: Client | None = None, progress: Progress | None = None
    ) -> None:
        self._tiles, self._folder = tiles, tiles.folder
        self._region = lru_cache(MAX_REGIONS)(self._label_region)
        folder, task = tiles.folder, partial(label_tile, tiles.folder)
        needed = LABEL_BYTES_PER_STATE * folder.slices * float(np.prod(folder.tile))
        found = run_tasks(task, list(folder), len(folder), needed, client, None, progress)
        self._nodes = [
            Nodes.join(folder, [each[mixed] for each in found], bool(mixed)) for mixed in (0, 1)
        ]

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the components of cells, inside the grid or not, or -1.

        Cells are FREE, or with ``mixed`` not BLOCKED.
        """
        nodes = self._find_nodes(cells, mixed)
        return np.where(nodes >= 0, self._nodes[mixed].roots[nodes], -1)

    def _find_nodes(self, cells: Ints, mixed: bool) -> Ints:
        """Return the nodes of cells, or -1."""
        folder, places, known = self._folder, cells[:, 1:], self._nodes[mixed]
        nodes = known.exterior[cells[:, 0]]
        inside = ((places >= 0) & (places < folder.grid.shape)).all(axis=1)
        for index, rows in folder.group_by_tile(places, np.flatnonzero(inside)):
            found = find_in_region(folder, index, self._region(index), cells[rows], mixed)
            nodes[rows] = np.where(found >= 0, known.offsets[folder.number(index)] + found, -1)
        return nodes

    def _label_region(self, index: Index) -> Components:
        """Label the region of a tile."""
        return label_region(self._folder, index, self._tiles.tile(index)[0])

    def chain(self, start: Ints, goal: Ints) -> tuple[list[Index], Ints]:
        """Return a shortest chain of tiles between two cells of the grid, and its crossings.

        It passes through FREE cells only, and is empty if none join the two. The crossings, shape
        (len(tiles) - 1, 1 + d), are FREE cells in the shared layer of a tile and the next one.
        """
        known, crossings = self._nodes[False], [start]
        first, last = self._find_nodes(np.stack([start, goal]), mixed=False).tolist()
        if min(first, last) < 0 or known.roots[first] != known.roots[last]:
            return [], np.empty((0, len(start)), dtype=np.int64)
        before = csgraph.breadth_first_order(known.graph, first, directed=False)[1]
        nodes = [last]
        while nodes[-1] != first:
            nodes.append(int(before[nodes[-1]]))
        nodes.reverse()
        numbers = np.searchsorted(known.offsets, nodes, side="right") - 1
        tiles = [tuple(map(int, np.unravel_index(k, self._folder.counts))) for k in numbers]
        labels = nodes - known.offsets[numbers]
        for k in range(len(tiles) - 1):
            pair = slice(k, k + 2)
            crossings.append(self._find_crossing(tiles[pair], labels[pair], crossings[-1], goal))
        return tiles, np.stack(crossings)[1:]

    def _find_crossing(self, tiles: list[Index], labels: Ints, start: Ints, goal: Ints) -> Ints:
        """Return a cell of the layer that two tiles share, with a given label in each.

        Of the cells far from the boundary of the common area, it is the one with the shortest way
        from ``start`` and to ``goal``.
        """
        upper = max(tiles)  # the two differ along one axis
        axis = int(np.flatnonzero(np.diff(tiles, axis=0))[0])
        cells = list_layers(self._folder, upper)[2 * axis]
        here, there = (
            find_in_region(self._folder, tile, self._region(tile), cells, mixed=False)
            for tile in tiles
        )
        sides = np.delete(np.diff(self._folder.interior(upper), axis=0), axis)
        common = ((here == labels[0]) & (there == labels[1])).reshape(-1, *sides)
        padded = distance_transform_edt(np.pad(common, 1))
        depth = padded[(slice(1, -1),) * common.ndim].ravel()
        found = cells[depth >= min(MAX_CROSSING_DEPTH_CELLS, depth.max())]
        ways = [np.linalg.norm((found - end)[:, 1:], axis=1) for end in (start, goal)]
        best: Ints = found[int(np.argmin(sum(ways)))]
        return best
