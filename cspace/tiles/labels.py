"""Connected components of a stored map.

A task labels the components of one tile over all rotation cells and stores the labels on its faces. Two labels that
touch across a face common to two tiles belong to one component; the graph of these pairs gives the components of the
map. The exterior is one more component for each rotation cell, like in maps in memory.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Ints
from cspace.map.components import Components
from cspace.map.exterior import Exterior
from cspace.store import LABEL_HEADER_LENGTH, Index, Store
from cspace.tiles.work import Job, run_tasks

if TYPE_CHECKING:
    from distributed import Client

Labels = NDArray[np.int32]

FREE_KIND, OPEN_KIND = 0, 1
"""Kinds of components: of FREE cells, and of open cells, which are FREE or MIXED."""

MAX_CROSSING_DEPTH_CELLS: Final = 8.0
"""Crossings this far from the boundary of a common face are equally good, in cells."""

MAX_CACHED_TILES: Final = 4
"""Number of tiles whose components are cached between queries."""


def tile_faces(dim: int) -> list[tuple[int, bool]]:
    """Return (axis, is upper face) in label order.

    The lower face across an axis has index ``2 * axis``, and the upper face the next one.
    """
    return [(axis, far) for axis in range(dim) for far in (False, True)]


class TileComponents:
    """Connected components of one tile."""

    def __init__(self, store: Store, index: Index) -> None:
        self.store, self.cells = store, store.cells(index)
        self.shape = tuple(part.stop - part.start for part in self.cells)
        closed = np.zeros(store.slices, dtype=np.bool_)
        states = np.asarray(store.states_in(self.cells))
        self.components = Components(states, store.slice_of, store.rotations.neighbors, closed)

    def roots(self) -> tuple[Ints, Ints]:
        """Return components of cells on faces, or -1.

        Faces follow each other; the cells of a face are in the order of an array of shape (rotations, *cells).
        """
        sides = self.store.label_count, *self.shape
        faces = []
        for axis, far in tile_faces(len(self.shape)):
            spans = list(map(range, sides))
            spans[1 + axis] = spans[1 + axis][-1:] if far else spans[1 + axis][:1]
            faces.append(np.stack(np.meshgrid(*spans, indexing="ij"), axis=-1).reshape(-1, len(sides)))
        cells = np.concatenate(faces).astype(np.int64)
        return self.components.of(cells), self.components.of(cells, mixed=True)


def label_tile(job: Job, index: Index) -> None:
    """Label a tile, and write its faces, as a task."""
    store = job.store
    for kind, roots in enumerate(TileComponents(store, index).roots()):
        _, ranks = np.unique(roots, return_inverse=True)
        labels = ranks - ranks[roots < 0].max(initial=-1) - 1  # -1 has rank 0, if it is there
        labels[roots < 0] = -1
        store.write(f"labels_{kind}", (*index, 0), _row(store, index, labels))


def _row(store: Store, index: Index, labels: Ints) -> NDArray[np.int32]:
    """Return the stored row: digest of states, then labels."""
    digest = np.frombuffer(store.known(index).mark, dtype="<i4")
    return np.concatenate([digest, labels]).astype(np.int32).reshape(*(1,) * store.grid.dim, -1)


def read_labels(store: Store, index: Index) -> list[list[Labels]] | None:
    """Return face labels of a tile, or None if outdated.

    There is one array for each face, shape (rotations, *cells).
    """
    digest, kinds = store.known(index).mark, list[list[Labels]]()
    shape = [part.stop - part.start for part in store.cells(index)]
    for kind in (FREE_KIND, OPEN_KIND):
        row = store.optional(f"labels_{kind}", (*index, 0))
        if row is None or row.reshape(-1)[:LABEL_HEADER_LENGTH].astype("<i4").tobytes() != digest:
            return None
        rest, faces = row.reshape(-1)[LABEL_HEADER_LENGTH:], []
        for across, _ in tile_faces(store.grid.dim):
            sides = (store.label_count, *(n for axis, n in enumerate(shape) if axis != across))
            count = math.prod(sides)
            faces.append(rest[:count].reshape(sides))
            rest = rest[count:]
        kinds.append(faces)
    return kinds


class TiledLabels:
    """Connected components of a stored, labelled map.

    A node is a component of one tile that reaches a face; nodes of a tile have consecutive numbers. The last nodes are
    the exterior, one for each rotation cell.
    """

    def __init__(self, store: Store, exterior: Exterior) -> None:
        self.store = store
        self._slice_of = store.slice_of[: store.label_count]
        self._open = ~exterior.is_all_blocked(store.grid.shape)[self._slice_of]
        self._tiles: OrderedDict[Index, tuple[TileComponents, list[tuple[Ints, Ints]]]] = OrderedDict()
        none = np.empty((0, 1 + store.grid.dim), dtype=np.int64)
        # Callers often query both kinds of the same cells, one after the other.
        self._last = none, np.empty((2, 0), dtype=np.int64)
        self.offsets = [np.zeros(len(store) + 1, dtype=np.int64) for _ in (FREE_KIND, OPEN_KIND)]
        self.pairs = self._pairs()
        self.roots = [
            _label_nodes(int(offsets[-1]) + len(self._slice_of), pairs)
            for offsets, pairs in zip(self.offsets, self.pairs, strict=True)
        ]

    def labels(self, index: Index) -> list[list[Labels]]:
        """Return face labels of a tile, for both kinds.

        Raises LookupError if the tile is not labelled.
        """
        labels = read_labels(self.store, index)
        if labels is None:
            raise LookupError(index)
        return labels

    def tile_number(self, index: Index) -> int:
        """Return the number of a tile in C order."""
        return int(np.ravel_multi_index(index, self.store.counts))

    def _pairs(self) -> list[Ints]:
        """Return touching nodes of both kinds, and fill ``offsets``."""
        store, faces, rotations = self.store, tile_faces(self.store.grid.dim), np.arange(len(self._slice_of))
        pairs: list[list[Ints]] = [[np.empty((0, 2), dtype=np.int64)] for _ in self.offsets]
        exterior_pairs = list[Ints]()
        upper_faces: dict[tuple[int, int, int], Labels] = {}  # labels, until the tile on the other side comes
        for number, index in enumerate(store):
            for kind, tile_labels in enumerate(self.labels(index)):
                offsets, offset = self.offsets[kind], self.offsets[kind][number]
                offsets[number + 1] = offset + max(int(face.max(initial=-1)) for face in tile_labels) + 1
                for (across, far), labels in zip(faces, tile_labels, strict=True):
                    neighbor = [n + (1 if far else -1) * (axis == across) for axis, n in enumerate(index)]
                    if not 0 <= neighbor[across] < store.counts[across]:
                        # Only open components include the exterior.
                        if kind == OPEN_KIND:
                            rotation = np.broadcast_to(rotations.reshape(-1, *(1,) * (labels.ndim - 1)), labels.shape)
                            touch = (labels >= 0) & self._open[rotation]
                            exterior_pairs.append(_unique_pairs(labels[touch] + offset, rotation[touch]))
                    elif far:
                        upper_faces[kind, across, number] = labels.copy()  # a view would keep all labels of the tile
                    else:
                        before = self.tile_number(tuple(neighbor))
                        other = upper_faces.pop((kind, across, before))
                        touch = (labels >= 0) & (other >= 0)
                        pairs[kind].append(_unique_pairs(other[touch] + offsets[before], labels[touch] + offset))
        # The exterior's nodes follow the nodes of all tiles, which are counted only now.
        exterior = self.offsets[OPEN_KIND][-1]
        pairs[OPEN_KIND] += [np.add(touching, (0, exterior)) for touching in exterior_pairs]
        if len(rotations) > 1:
            neighbors = store.rotations.neighbors
            one, other = np.nonzero(neighbors >= 0)[0], neighbors[neighbors >= 0].astype(np.int64)
            both = self._open[one] & self._open[other]
            pairs[OPEN_KIND].append(exterior + _unique_pairs(one[both], other[both]))
        return [np.concatenate(touching) for touching in pairs]

    def nodes_of(self, cells: Ints) -> Ints:
        """Return nodes (2, n) of cells, or -1.

        Cells are ``(rotation, x, y(, z))``, shape (n, 1 + d), inside or outside the map. A component that reaches no
        face of its tile gets a unique number below -1.
        """
        store, nodes = self.store, np.full((2, len(cells)), -1, dtype=np.int64)
        rotations = np.minimum(cells[:, 0], len(self._slice_of) - 1)
        inside = ((cells[:, 1:] >= 0) & (cells[:, 1:] < store.grid.shape)).all(axis=1)
        outside = ~inside & self._open[rotations]
        nodes[OPEN_KIND, outside] = self.offsets[OPEN_KIND][-1] + rotations[outside]
        tiles = cells[:, 1:] // store.tile
        for index in np.unique(tiles[inside], axis=0):
            rows = np.flatnonzero(inside & (tiles == index).all(axis=1))
            tile, faces = self._tile(tuple(index.tolist()))
            local = cells[rows] - [0, *(part.start for part in tile.cells)]
            local[:, 0] = rotations[rows]
            number = self.tile_number(tuple(index.tolist()))
            for kind in (FREE_KIND, OPEN_KIND):
                roots, (face_roots, labels) = tile.components.of(local, kind == OPEN_KIND), faces[kind]
                position = np.minimum(np.searchsorted(face_roots, roots), max(len(face_roots) - 1, 0))
                on_face = face_roots[position] == roots if len(face_roots) else np.zeros(len(roots), dtype=np.bool_)
                tile_nodes = -2 - (number * 2**32 + roots)  # for components that reach no face
                tile_nodes[on_face] = self.offsets[kind][number] + labels[position[on_face]]
                nodes[kind, rows] = np.where(roots < 0, -1, tile_nodes)
        return nodes

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return components of cells, or -1.

        Cells are FREE, or with ``mixed`` not BLOCKED.
        """
        last_cells, nodes = self._last
        if not np.array_equal(last_cells, cells):
            self._last = cells.copy(), (nodes := self.nodes_of(cells))
        components: Ints = nodes[int(mixed)].copy()
        components[components >= 0] = self.roots[int(mixed)][components[components >= 0]]
        return components

    def chain(self, start: Ints, goal: Ints) -> tuple[list[Index], Ints]:
        """Return the shortest chain of tiles between cells.

        Return its crossings too; it passes only FREE cells. Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)``,
        in the map. The chain is empty if no FREE cells connect them. The crossings, shape (len(tiles) - 1, 1 + d), are
        the first cell in each tile except the first tile; a crossing is FREE, and so is the cell across the face, in
        the tile before.
        """
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import dijkstra

        offsets, pairs = self.offsets[FREE_KIND], self.pairs[FREE_KIND]
        nodes = self.nodes_of(np.stack([start, goal]))[FREE_KIND]
        tiles = [tuple((cell[1:] // self.store.tile).tolist()) for cell in (start, goal)]
        if nodes[0] == nodes[1] != -1:
            return tiles[:1], np.empty((0, len(start)), dtype=np.int64)
        if (nodes < 0).any():
            return [], np.empty((0, len(start)), dtype=np.int64)
        count = int(offsets[-1]) + len(self._slice_of)
        graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
        before = dijkstra(graph, directed=False, indices=nodes[0], unweighted=True, return_predecessors=True)[1]
        chain = [int(nodes[1])]
        while chain[-1] != nodes[0] and before[chain[-1]] >= 0:
            chain.append(int(before[chain[-1]]))
        if chain[-1] != nodes[0]:
            return [], np.empty((0, len(start)), dtype=np.int64)
        chain.reverse()
        numbers = np.searchsorted(offsets, chain, side="right") - 1
        tiles = [tuple(int(i) for i in np.unravel_index(number, self.store.counts)) for number in numbers]
        crossings, crossing = [], start
        for k in range(len(tiles) - 1):
            labels = [chain[k] - int(offsets[numbers[k]]), chain[k + 1] - int(offsets[numbers[k + 1]])]
            crossing = self._find_crossing(tiles[k], tiles[k + 1], labels, crossing, goal)
            crossings.append(crossing)
        return tiles, np.array(crossings).reshape(-1, len(start))

    def _find_crossing(self, tile: Index, next_tile: Index, labels: list[int], start: Ints, goal: Ints) -> Ints:
        """Return the cell at which to cross a face.

        It is in ``next_tile``, given the label on each side. Minimizes the distance to ``start`` and ``goal`` over the
        cells far from the boundary of the common area.
        """
        from scipy.ndimage import distance_transform_edt

        axis = next(k for k in range(len(tile)) if tile[k] != next_tile[k])
        far = next_tile[axis] > tile[axis]
        before = self.labels(tile)[FREE_KIND][2 * axis + far] == labels[0]
        after = self.labels(next_tile)[FREE_KIND][2 * axis + (not far)] == labels[1]
        depth = distance_transform_edt(np.pad(before & after, 1))[(slice(1, -1),) * before.ndim]
        face_cells = np.argwhere(depth >= min(MAX_CROSSING_DEPTH_CELLS, depth.max()))
        box = self.store.cells(tile)
        boundary = box[axis].stop - 1 if far else box[axis].start
        cells = np.insert(face_cells, 1 + axis, boundary, axis=1)
        for k, part in enumerate(box):
            if k != axis:
                cells[:, 1 + k] += part.start
        detour = sum(np.linalg.norm((cells - end)[:, 1:].astype(float), axis=1) for end in (start, goal))
        best: Ints = cells[int(np.argmin(detour))]
        best[1 + axis] += 1 if far else -1
        return best

    def _tile(self, index: Index) -> tuple[TileComponents, list[tuple[Ints, Ints]]]:
        """Return a tile, its components on faces, and their labels.

        There are components and labels for each kind, ascending.
        """
        if index not in self._tiles:
            tile, pairs = TileComponents(self.store, index), []
            for roots, faces in zip(tile.roots(), self.labels(index), strict=True):
                labels = np.concatenate([face.ravel() for face in faces])
                face_roots, positions = np.unique(roots, return_index=True)
                pairs.append((face_roots[face_roots >= 0], labels[positions][face_roots >= 0].astype(np.int64)))
            self._tiles[index] = tile, pairs
            if len(self._tiles) > MAX_CACHED_TILES:
                self._tiles.popitem(last=False)
        self._tiles.move_to_end(index)
        return self._tiles[index]


def label_tiles(job: Job, client: Client | None, progress: Callable[[int], None] | None = None) -> None:
    """Label all tiles without labels or with outdated ones."""
    store = job.store
    store.add_labels()
    unlabelled = [index for index in store if read_labels(store, index) is None]
    run_tasks(label_tile, job, unlabelled, client, None, progress)


def _unique_pairs(one: NDArray[Any], other: NDArray[Any]) -> Ints:
    """Return distinct pairs, shape (n, 2)."""
    pairs = np.stack([one, other], axis=-1).astype(np.int64).reshape(-1, 2)
    return np.unique(pairs, axis=0)


def _label_nodes(count: int, pairs: Ints) -> Ints:
    """Return components of ``count`` nodes from adjacent pairs."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    ones = np.ones(len(pairs), dtype=np.bool_)
    graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    roots: Ints = connected_components(graph, directed=False)[1].astype(np.int64)
    return roots
