"""Connected components of a tiled map.

A *node* is a component of a tile with its halo, over all rotation cells. Two tiles side by side
both have the first layer of the second one's interior, where a cell has a node in each, which join
there. So cells are joined as in one map: two neighbors lie in a common tile, and a component that
leaves the interior of a tile passes such a layer.

FREE cells and open cells, which are FREE or MIXED, have nodes of their own. Open cells at the
border of the grid also join the exterior, which is a node for each rotation cell that is open
there.

Here a cell is ``(rotation cell, x, y)`` or ``(rotation cell, x, y, z)``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, csgraph

from cspace.support.arrays import Ints
from cspace.tiles.folder import Index, TileFolder
from cspace.tiles.parts import OpenTiles, open_tile
from cspace.tiles.work import Progress, run_tasks

if TYPE_CHECKING:
    from distributed import Client

LABEL_BYTES_PER_STATE: Final = 24
"""Memory for each state while a tile is labelled, in bytes, if every other cell is FREE."""

MAX_CROSSING_DEPTH_CELLS: Final = 8.0
"""Crossings this far from the boundary of a common face are equally good, in cells."""


class TileLabels(NamedTuple):
    """Nodes of a tile.

    Attributes
    ----------
    size : int
        Number of nodes.
    layers : list of ndarray of int64, shape (2, rotations, ...)
        Node of each cell of :func:`list_layers`, or -1.
    """

    size: int
    layers: list[Ints]


def list_layers(folder: TileFolder, index: Index) -> list[Ints]:
    """List the cells that a tile shares with the tiles beside it, or with the exterior.

    Along each axis, they are the first layer of the interior, and the first layer beyond it, or the
    last one at the end of the grid. Their shape is (2, rotations, other axes, 1 + d).
    """
    first, stop = folder.locate_interior(index)
    rotations = np.arange(len(folder.frame.slice_of))
    layers = []
    for axis, n in enumerate(folder.grid.shape):
        ranges = [rotations, *map(np.arange, first, stop)]
        ranges[1 + axis] = np.array([first[axis], min(stop[axis], n - 1)])
        cells = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1)
        layers.append(np.moveaxis(cells, 1 + axis, 0))
    return layers


def label_tile(folder: TileFolder, index: Index) -> list[TileLabels]:
    """Label the FREE cells and the open cells of a tile, as a task."""
    tile = open_tile(folder, index)
    layers = list_layers(folder, index)
    labels = []
    for mixed in (False, True):
        nodes = [tile.find_nodes(cells, mixed) for cells in layers]
        labels.append(TileLabels(tile.components.count(mixed), nodes))
    return labels


class Nodes:
    """Nodes of all tiles, for FREE cells or for open cells.

    The nodes of a tile have consecutive numbers. The last nodes are the exterior, one for each
    rotation cell.

    Parameters
    ----------
    folder : TileFolder
    labels : sequence of TileLabels
        Nodes of each tile.
    mixed : bool
        Whether cells are open, so that they join the exterior too.

    Attributes
    ----------
    offsets : ndarray of int64, shape (tiles + 1,)
        First node of each tile, and of the exterior.
    exterior : ndarray of int64, shape (rotations,)
        Node of the exterior at each rotation cell, or -1 if it is closed.
    graph : sparse array
        Joined nodes.
    roots : ndarray of int32, shape (nodes + 1,)
        Component of each node, and -1.
    """

    def __init__(self, folder: TileFolder, labels: Sequence[TileLabels], mixed: bool) -> None:
        self.offsets = np.cumsum([0, *(tile.size for tile in labels)], dtype=np.int64)
        slice_of = folder.frame.slice_of
        self.exterior = np.full(len(slice_of), -1)
        if mixed and folder.frame.exterior is not None:
            is_open = ~folder.frame.exterior.is_all_blocked(folder.grid.shape)[slice_of]
            self.exterior[is_open] = self.offsets[-1] + np.flatnonzero(is_open)
        links = [_pair_up(*nodes) for nodes in self._match_layers(folder, labels)]
        first, second = np.concatenate(links).T
        count = int(self.offsets[-1]) + len(slice_of)
        self.graph = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
        roots = csgraph.connected_components(self.graph, directed=False)[1]
        self.roots = np.append(roots, -1)

    def _match_layers(
        self, folder: TileFolder, labels: Sequence[TileLabels]
    ) -> Iterator[tuple[Ints, Ints]]:
        """Yield pairs of arrays with the nodes that the same cells have twice."""
        nodes = {}
        for index, offset, tile in zip(folder, self.offsets, labels, strict=False):
            nodes[index] = [np.where(layer >= 0, layer + offset, -1) for layer in tile.layers]
        outside = self.exterior.reshape(-1, *[1] * (folder.grid.dim - 1))
        for index, layers in nodes.items():
            for axis, (first, last) in enumerate(layers):
                beyond = (*index[:axis], index[axis] + 1, *index[axis + 1 :])
                yield last, nodes[beyond][axis][0] if beyond in nodes else outside
                if index[axis] == 0:
                    yield first, outside
        padded = np.append(self.exterior, -1)  # a missing neighbor is -1
        for neighbors in folder.frame.rotations.neighbors.T:
            yield self.exterior, padded[neighbors]


def _pair_up(first: Ints, second: Ints) -> Ints:
    """Return the distinct pairs of two arrays of nodes, shape (n, 2), without -1."""
    pairs = np.stack(np.broadcast_arrays(first, second), axis=-1)
    return np.unique(pairs[(pairs >= 0).all(axis=-1)], axis=0)


class TiledComponents:
    """Connected components of a tiled map."""

    def __init__(
        self, tiles: OpenTiles, client: Client | None = None, progress: Progress | None = None
    ) -> None:
        self._tiles = tiles
        self._folder = folder = tiles.folder
        sides = np.add(folder.tile, 2 * folder.halo)
        needed = LABEL_BYTES_PER_STATE * folder.slices * float(np.prod(sides))
        task = partial(label_tile, folder)
        labels = run_tasks(task, list(folder), len(folder), needed, client, None, progress)
        free, passable = zip(*labels, strict=True)
        self._nodes = [Nodes(folder, free, mixed=False), Nodes(folder, passable, mixed=True)]

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the components of cells, inside the grid or not, or -1.

        Cells are FREE, or with ``mixed`` not BLOCKED.
        """
        return self._nodes[mixed].roots[self._find_nodes(cells, mixed)]

    def _find_nodes(self, cells: Ints, mixed: bool) -> Ints:
        """Return the nodes of cells, or -1."""
        folder = self._folder
        positions = cells[:, 1:]
        known = self._nodes[mixed]
        nodes = known.exterior[cells[:, 0]]
        inside = ((positions >= 0) & (positions < folder.grid.shape)).all(axis=1)
        for index, rows in folder.group_by_tile(positions, np.flatnonzero(inside)):
            labels = self._tiles.tile(index).find_nodes(cells[rows], mixed)
            offset = known.offsets[folder.find_number(index)]
            nodes[rows] = np.where(labels >= 0, labels + offset, -1)
        return nodes

    def chain(self, start: Ints, goal: Ints) -> tuple[list[Index], list[Ints]]:
        """Return a shortest chain of tiles between two cells of the grid, and its crossings.

        It passes through FREE cells only, and is empty if none join the two. The crossings, one
        fewer than tiles, are FREE cells that a tile and the next one share.
        """
        free = self._nodes[False]
        first, last = self._find_nodes(np.stack([start, goal]), mixed=False).tolist()
        if first < 0 or free.roots[first] != free.roots[last]:
            return [], []
        next_to_last = csgraph.breadth_first_order(free.graph, last, directed=False)[1]
        nodes = [first]
        while nodes[-1] != last:
            nodes.append(int(next_to_last[nodes[-1]]))
        numbers = np.searchsorted(free.offsets, nodes, side="right") - 1
        tiles = [self._folder.find_index(number) for number in numbers]
        labels = nodes - free.offsets[numbers]
        crossings = [start]
        for k in range(len(tiles) - 1):
            pair = slice(k, k + 2)
            crossings.append(self._find_crossing(tiles[pair], labels[pair], crossings[-1], goal))
        return tiles, crossings[1:]

    def _find_crossing(self, tiles: list[Index], labels: Ints, start: Ints, goal: Ints) -> Ints:
        """Return a cell of the layer that two tiles share, with a given label in each.

        Of the cells far from the boundary of the common area, it is the one with the shortest way
        from ``start`` and to ``goal``.
        """
        upper = max(tiles)  # the two differ along one axis
        axis = int(np.flatnonzero(np.diff(tiles, axis=0))[0])
        cells = list_layers(self._folder, upper)[axis][0]
        common = np.ones(cells.shape[:-1], dtype=np.bool_)
        for tile, label in zip(tiles, labels, strict=True):
            common &= self._tiles.tile(tile).find_nodes(cells) == label
        depths = distance_transform_edt(np.pad(common, 1))
        deep = np.argwhere(depths >= min(MAX_CROSSING_DEPTH_CELLS, depths.max())) - 1
        candidates = cells[tuple(deep.T)]
        from_start = np.linalg.norm((candidates - start)[:, 1:], axis=1)
        to_goal = np.linalg.norm((candidates - goal)[:, 1:], axis=1)
        best: Ints = candidates[np.argmin(from_start + to_goal)]
        return best
