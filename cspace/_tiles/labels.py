"""Connected components of a tiled map.

A *node* is a component of a tile with its halo, over all rotation cells. Two adjacent tiles share
the first layer of the second tile's interior. A cell of that layer has a node in each tile, and the
two nodes are joined. So cells are joined as in one map: two neighbors lie in a common tile, and a
component that leaves the interior of a tile passes such a layer.

FREE cells and open cells, which are FREE or MIXED, have nodes of their own. Open cells at the
border of the grid also join the exterior, one node for all rotation cells that are open there.

Here a cell is ``(rotation cell, x, y)`` or ``(rotation cell, x, y, z)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, csgraph

from cspace._tiles.folder import TileFolder
from cspace._tiles.open_tiles import OpenTiles, open_tile
from cspace._tiles.work import Progress, run_tasks
from cspace.inside import Ints

if TYPE_CHECKING:
    from distributed import Client

TileNodes = tuple[int, list[Ints]]
"""Number of nodes of a tile, and labels of the cells of each array of :func:`list_layers`.

The label of a cell is the index of its node in the tile, or -1 for a cell without a node.
"""


def list_layers(folder: TileFolder, tile: int) -> list[Ints]:
    """Return the layers of cells that a tile shares with its neighbours.

    There is an array for each axis, shape (2, rotations, other axes, 1 + d). It has the first layer
    of the interior, then the first layer beyond the interior. At the end of the grid, where no
    layer is beyond, it has the last layer of the interior instead.
    """
    first, stop = folder.locate_interior(tile)
    rotations = np.arange(len(folder.frame.slice_of))
    layers = []
    for axis, n in enumerate(folder.grid.shape):
        ranges = [rotations, *map(np.arange, first, stop)]
        ranges[1 + axis] = np.array([first[axis], min(stop[axis], n - 1)])
        cells = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1)
        layers.append(np.moveaxis(cells, 1 + axis, 0))
    return layers


def label_tile(folder: TileFolder, tile: int) -> list[TileNodes]:
    """Label the FREE cells, then the open cells, of shared layers."""
    opened = open_tile(folder, tile)
    layers = list_layers(folder, tile)
    nodes = []
    for mixed in (False, True):
        labels = [opened.find_labels(cells, mixed) for cells in layers]
        nodes.append((opened.components.count(mixed), labels))
    return nodes


class MapNodes:
    """The graph of all nodes of FREE cells, or of open cells.

    The nodes of a tile have consecutive numbers. The last node is the exterior, as if it were a
    tile with one node, label 0.

    Parameters
    ----------
    folder : TileFolder
    tiles : sequence of TileNodes
        Labels of each tile.
    mixed : bool
        True for open cells, which may join the exterior, False for FREE cells.

    Attributes
    ----------
    offsets : ndarray of int64, shape (tiles + 1,)
        First node of each tile, and the exterior.
    outside : ndarray of int64, shape (rotations,)
        Label of the exterior, 0, at each rotation cell; -1 if it is closed.
    graph : sparse array
        Joined nodes.
    roots : ndarray of int32, shape (nodes + 1,)
        Component of each node; the last entry, -1, is for cells without a node, whose index is -1.
    """

    def __init__(self, folder: TileFolder, tiles: Sequence[TileNodes], mixed: bool) -> None:
        """Join nodes of adjacent tiles that share a cell."""
        sizes, layers = zip(*tiles, strict=True)
        self.offsets = np.cumsum([0, *sizes])
        exterior = folder.frame.exterior
        is_closed = np.ones(folder.slices, dtype=np.bool_)
        if mixed and exterior is not None:
            is_closed = exterior.is_all_blocked(folder.grid.shape)
        self.outside = -is_closed[folder.frame.slice_of].astype(np.int64)
        dim = folder.grid.dim
        layer_outside = self.outside.reshape(-1, *[1] * (dim - 1))
        layers = (*layers, [(layer_outside, layer_outside)] * dim)
        links = []
        for axis in range(dim):
            # Tiles along the axis, with the exterior, which is the last "tile", -1, at both ends.
            rows = np.moveaxis(folder.numbers, axis, 0).reshape(folder.counts[axis], -1)
            padded = np.pad(rows, ((1, 1), (0, 0)), constant_values=-1)
            for before, after in zip(padded[:-1].flat, padded[1:].flat, strict=True):
                _, last_layer = layers[before][axis]
                first_layer, _ = layers[after][axis]
                labels = _pair_up(last_layer, first_layer)
                links.append(labels + self.offsets[[before, after]])
        first, second = np.concatenate(links).T
        count = self.offsets[-1] + 1
        self.graph = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
        _, roots = csgraph.connected_components(self.graph, directed=False)
        self.roots = np.append(roots, -1)


def _pair_up(first: Ints, second: Ints) -> Ints:
    """Return the distinct pairs of labels of two arrays, shape (n, 2).

    Pairs with -1, which means no label, are omitted.
    """
    pairs = np.stack(np.broadcast_arrays(first, second), axis=-1)
    return np.unique(pairs[(pairs >= 0).all(axis=-1)], axis=0)


class TiledComponents:
    """Connected components of a tiled map."""

    def __init__(
        self, tiles: OpenTiles, client: Client | None = None, progress: Progress | None = None
    ) -> None:
        """Label all tiles, and join their nodes."""
        self._tiles = tiles
        self._folder = folder = tiles.folder
        # Memory for each state while a tile is labelled, in bytes, in the worst case: FREE cells
        # alternate with others.
        needed = float(24 * folder.slices * folder.cells_of_tile)
        task = partial(label_tile, folder)
        labels = run_tasks(task, range(len(folder)), needed, folder.grid, client, None, progress)
        free, passable = zip(*labels, strict=True)
        self._nodes = [
            MapNodes(folder, free, mixed=False),
            MapNodes(folder, passable, mixed=True),
        ]

    def find(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return each cell's component, or -1.

        Cells have shape (n, 1 + d). Components consist of FREE cells, or with ``mixed`` of cells
        that are not BLOCKED.
        """
        return self._nodes[mixed].roots[self._find_nodes(cells, mixed)]

    def _find_nodes(self, cells: Ints, mixed: bool) -> Ints:
        """Return each cell's node, or -1.

        Cells have shape (n, 1 + d).
        """
        folder = self._folder
        positions = cells[:, 1:]
        all_nodes = self._nodes[mixed]
        # Outside the grid, a cell has the node of the exterior.
        labels = all_nodes.outside[cells[:, 0]]
        offsets = np.full_like(labels, all_nodes.offsets[-1])
        inside = ((positions >= 0) & (positions < folder.grid.shape)).all(axis=1)
        for tile, rows in folder.group_by_tile(positions, np.flatnonzero(inside)):
            labels[rows] = self._tiles.tile(tile).find_labels(cells[rows], mixed)
            offsets[rows] = all_nodes.offsets[tile]
        return np.where(labels >= 0, labels + offsets, -1)

    def chain(self, start: Ints, goal: Ints) -> tuple[list[int], list[Ints]]:
        """Return a shortest chain of tiles between two cells, and its crossings.

        FREE cells join consecutive tiles of the chain, which is empty if FREE cells do not join the
        two cells. The crossings, one fewer than tiles, are FREE cells that a tile and the next one
        share.
        """
        free = self._nodes[False]
        first, last = self._find_nodes(np.stack([start, goal]), mixed=False).tolist()
        if first < 0 or free.roots[first] != free.roots[last]:
            return [], []
        # A search from the last node gives the next node of each on a shortest way there.
        _, next_to_last = csgraph.breadth_first_order(free.graph, last, directed=False)
        nodes = [first]
        while nodes[-1] != last:
            nodes.append(next_to_last[nodes[-1]])
        tiles = np.searchsorted(free.offsets, nodes, side="right") - 1
        labels = nodes - free.offsets[tiles]
        crossings = [start]
        for k in range(len(tiles) - 1):
            pair = slice(k, k + 2)
            crossings.append(self._find_crossing(tiles[pair], labels[pair], crossings[-1], goal))
        return tiles.tolist(), crossings[1:]

    def _find_crossing(self, tiles: Ints, labels: Ints, start: Ints, goal: Ints) -> Ints:
        """Choose the cell where a path crosses between tiles.

        ``tiles``, shape (2,), are adjacent, and the cell has the given label in each. Among cells
        far from the boundary of that area, the one with the shortest way from ``start`` to ``goal``
        is chosen.
        """
        corners = [self._folder.locate_interior(tile)[0] for tile in tiles]
        axis = np.argmax(corners[0] != corners[1])
        cells, _ = list_layers(self._folder, tiles.max())[axis]
        common = np.ones(cells.shape[:-1], dtype=np.bool_)
        for tile, label in zip(tiles, labels, strict=True):
            common &= self._tiles.tile(tile).find_labels(cells) == label
        # Depth is the distance to cells outside the common area; padding adds those beyond the
        # layer.
        depths = distance_transform_edt(np.pad(common, 1))[(slice(1, -1),) * common.ndim]
        # Crossings eight cells from the boundary, or more, are equally good.
        candidates = cells[depths >= min(8.0, depths.max())]
        # Distances of positions; column 0, the rotation cell, does not count.
        from_start = np.linalg.norm((candidates - start)[:, 1:], axis=1)
        to_goal = np.linalg.norm((candidates - goal)[:, 1:], axis=1)
        best: Ints = candidates[np.argmin(from_start + to_goal)]
        return best
