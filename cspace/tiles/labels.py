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

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

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

Layers = list[Ints]
"""Nodes of the cells of the layers of a tile, or -1; see :func:`list_layers`."""


def list_layers(folder: TileFolder, index: Index) -> list[Ints]:
    """Return the cells that a tile shares with the tiles beside it, or with the exterior.

    Along each axis, they are the first layer of the interior, and the first layer beyond it, or the
    last one at the end of the grid. Each has the shape
    (rotations, nx, ny(, nz), 1 + d), where n is 1 along the axis.
    """
    corners = folder.interior(index)
    layers = []
    rotations = len(folder.frame.slice_of)
    for axis, n in enumerate(folder.grid.shape):
        for cell in (corners[0, axis], min(corners[1, axis], n - 1)):
            first, stop = corners.copy()
            first[axis] = cell
            stop[axis] = cell + 1
            cells = np.moveaxis(np.indices((rotations, *(stop - first))), 0, -1)
            layers.append(cells + np.array([0, *first]))
    return layers


def label_tile(folder: TileFolder, index: Index) -> list[tuple[int, Layers]]:
    """Label the FREE cells and the open cells of a tile, as a task.

    Return, for each, the number of nodes and the nodes of the layers.
    """
    tile = open_tile(folder, index)
    layers = list_layers(folder, index)

    def label(mixed: bool) -> tuple[int, Layers]:
        return tile.components.count(mixed), [tile.find_nodes(layer, mixed) for layer in layers]

    return [label(False), label(True)]


class Nodes:
    """Nodes of all tiles, for FREE cells or for open cells.

    The nodes of a tile have consecutive numbers. The last nodes are the exterior, one for each
    rotation cell.

    Parameters
    ----------
    labels : sequence of (int, list of ndarray)
        Number of nodes of each tile, and nodes of its layers.
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

    def __init__(
        self, folder: TileFolder, labels: Sequence[tuple[int, Layers]], mixed: bool
    ) -> None:
        self.offsets = np.cumsum([0, *(count for count, _ in labels)], dtype=np.int64)
        frame = folder.frame
        count = int(self.offsets[-1]) + len(frame.slice_of)
        self.exterior = np.full(len(frame.slice_of), -1)
        if mixed and frame.exterior is not None:
            is_open = ~frame.exterior.is_all_blocked(folder.grid.shape)[frame.slice_of]
            self.exterior[is_open] = self.offsets[-1] + np.flatnonzero(is_open)
        first, second = self._join(folder, labels)
        self.graph = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
        roots = csgraph.connected_components(self.graph, directed=False)[1]
        self.roots = np.append(roots, -1)

    def _join(self, folder: TileFolder, labels: Sequence[tuple[int, Layers]]) -> Ints:
        """Return the distinct pairs of joined nodes, shape (2, n)."""
        pairs = []

        def join(first: Ints, second: Ints) -> None:
            both = np.stack(np.broadcast_arrays(first, second), axis=-1)
            pairs.append(np.unique(both[(both >= 0).all(axis=-1)], axis=0))

        nodes = {
            index: [np.where(layer >= 0, layer + first, -1) for layer in layers]
            for index, first, (_, layers) in zip(folder, self.offsets, labels, strict=False)
        }
        outside = self.exterior.reshape(-1, *[1] * folder.grid.dim)
        for index, layers in nodes.items():
            for axis, (first, last) in enumerate(zip(layers[::2], layers[1::2], strict=True)):
                beyond = (*index[:axis], index[axis] + 1, *index[axis + 1 :])
                join(last, nodes[beyond][2 * axis] if beyond in nodes else outside)
                if index[axis] == 0:
                    join(first, outside)
        for others in folder.frame.rotations.neighbors.T:
            join(self.exterior, np.where(others >= 0, self.exterior[others], -1))
        return np.concatenate(pairs).T


class TiledComponents:
    """Connected components of a tiled map."""

    def __init__(
        self, tiles: OpenTiles, client: Client | None = None, progress: Progress | None = None
    ) -> None:
        self._tiles = tiles
        self._folder = tiles.folder
        folder = tiles.folder
        task = partial(label_tile, tiles.folder)
        sides = np.add(folder.tile, 2 * folder.halo)
        needed = LABEL_BYTES_PER_STATE * folder.slices * float(np.prod(sides))
        found = run_tasks(task, list(folder), len(folder), needed, client, None, progress)
        self._nodes = [
            Nodes(folder, [each[mixed] for each in found], bool(mixed)) for mixed in (0, 1)
        ]

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the components of cells, inside the grid or not, or -1.

        Cells are FREE, or with ``mixed`` not BLOCKED.
        """
        return self._nodes[mixed].roots[self._find_nodes(cells, mixed)]

    def _find_nodes(self, cells: Ints, mixed: bool) -> Ints:
        """Return the nodes of cells, or -1."""
        folder = self._folder
        places = cells[:, 1:]
        known = self._nodes[mixed]
        nodes = known.exterior[cells[:, 0]]
        inside = ((places >= 0) & (places < folder.grid.shape)).all(axis=1)
        for index, rows in folder.group_by_tile(places, np.flatnonzero(inside)):
            found = self._tiles.tile(index).find_nodes(cells[rows], mixed)
            nodes[rows] = np.where(found >= 0, known.offsets[folder.number(index)] + found, -1)
        return nodes

    def chain(self, start: Ints, goal: Ints) -> tuple[list[Index], list[Ints]]:
        """Return a shortest chain of tiles between two cells of the grid, and its crossings.

        It passes through FREE cells only, and is empty if none join the two. The crossings, one
        fewer than tiles, are FREE cells that a tile and the next one share.
        """
        known = self._nodes[False]
        first, last = self._find_nodes(np.stack([start, goal]), mixed=False).tolist()
        if first < 0 or known.roots[first] != known.roots[last]:
            return [], []
        after = csgraph.breadth_first_order(known.graph, last, directed=False)[1]
        nodes = [first]
        while nodes[-1] != last:
            nodes.append(int(after[nodes[-1]]))
        numbers = np.searchsorted(known.offsets, nodes, side="right") - 1
        tiles = [self._folder.index(number) for number in numbers]
        labels = nodes - known.offsets[numbers]
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
        cells = list_layers(self._folder, upper)[2 * axis]
        common = np.ones(cells.shape[:-1], dtype=np.bool_)
        for tile, label in zip(tiles, labels, strict=True):
            common &= self._tiles.tile(tile).find_nodes(cells) == label
        padded = distance_transform_edt(np.pad(common.squeeze(1 + axis), 1))
        depth = padded[(slice(1, -1),) * padded.ndim].reshape(common.shape)
        found = cells[depth >= min(MAX_CROSSING_DEPTH_CELLS, depth.max())]
        ways = [np.linalg.norm((found - end)[:, 1:], axis=1) for end in (start, goal)]
        best: Ints = found[int(np.argmin(sum(ways)))]
        return best
