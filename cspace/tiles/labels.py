"""Which cells of a stored map chains join: components of each tile, and what joins them over their faces.

A task labels the components of one tile, over all of its rotation cells, and keeps the labels of the cells on its
faces. Where two tiles share a face, labels that lie on either side of it are one component; one reduction over these
pairs joins all of them. What lies outside the map is one more component of each rotation cell, as in memory.
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
from cspace.map.storage import read_only_of
from cspace.store import LABEL_HEADER_LENGTH, Index, Store
from cspace.tiles.work import Job, run

if TYPE_CHECKING:
    from distributed import Client

Labels = NDArray[np.int32]

FREE_ONES, OPEN_ONES = 0, 1
"""The two kinds of components: of FREE cells, and of cells that are not BLOCKED."""

DEEP: Final = 8.0
"""Cells from the border of a common face beyond which a crossing lies well enough."""

HELD: Final = 4
"""Tiles whose components are kept for further look-ups."""


def faces_of(dim: int) -> list[tuple[int, bool]]:
    """The faces of a tile, in the order in which their labels are kept: their axes, and whether they are the far ones.

    That across an axis is number ``2 * axis``, and the far one comes next.
    """
    return [(axis, far) for axis in range(dim) for far in (False, True)]


class Tile:
    """The components of one tile."""

    def __init__(self, store: Store, index: Index) -> None:
        self.store, self.cells = store, store.cells(index)
        self.shape = tuple(part.stop - part.start for part in self.cells)
        closed = np.zeros(store.slices, dtype=np.bool_)
        states = read_only_of(store.states_in(self.cells))
        self.components = Components(states, store.slice_of, store.rotations.neighbors, closed)

    def roots(self) -> tuple[Ints, Ints]:
        """Components of both kinds on all faces, one face after the other; -1 where a cell has none.

        Those of a face are in the order of an array of shape (rotations, *cells of the face).
        """
        sides = self.store.label_count, *self.shape
        faces = []
        for across, far in faces_of(len(self.shape)):
            spans = list(map(range, sides))
            spans[1 + across] = spans[1 + across][-1:] if far else spans[1 + across][:1]
            faces.append(np.stack(np.meshgrid(*spans, indexing="ij"), axis=-1).reshape(-1, len(sides)))
        cells = np.concatenate(faces).astype(np.int64)
        return self.components.of(cells), self.components.of(cells, mixed=True)


def label(job: Job, index: Index) -> None:
    """The task: label a tile, and write what lies on its faces."""
    store = job.store
    for kind, flat in enumerate(Tile(store, index).roots()):
        _, numbers = np.unique(flat, return_inverse=True)
        labels = numbers - numbers[flat < 0].max(initial=-1) - 1  # -1 comes first
        labels[flat < 0] = -1
        store.write(f"labels_{kind}", (*index, 0), _row(store, index, labels))


def _row(store: Store, index: Index, labels: Ints) -> NDArray[np.int32]:
    """What is written of a tile: the digest of what it was made from, then its labels."""
    made_from = np.frombuffer(store.known(index).mark, dtype="<i4")
    return np.concatenate([made_from, labels]).astype(np.int32).reshape(*(1,) * store.grid.dim, -1)


def read_labels(store: Store, index: Index) -> list[list[Labels]] | None:
    """Labels on the faces of a tile, of both kinds; None where they are not there.

    One array for each face, shape (rotations, *cells).
    """
    mark, kinds = store.known(index).mark, list[list[Labels]]()
    shape = [part.stop - part.start for part in store.cells(index)]
    for kind in (FREE_ONES, OPEN_ONES):
        row = store.optional(f"labels_{kind}", (*index, 0))
        if row is None or row.reshape(-1)[:LABEL_HEADER_LENGTH].astype("<i4").tobytes() != mark:
            return None
        rest, made = row.reshape(-1)[LABEL_HEADER_LENGTH:], []
        for across, _ in faces_of(store.grid.dim):
            sides = (store.label_count, *(n for axis, n in enumerate(shape) if axis != across))
            count = math.prod(sides)
            made.append(rest[:count].reshape(sides))
            rest = rest[count:]
        kinds.append(made)
    return kinds


class TiledLabels:
    """The components of a whole map.

    All tiles of its store are labelled.
    """

    def __init__(self, store: Store, exterior: Exterior) -> None:
        self.store = store
        self._slice_of = store.slice_of[: store.label_count]
        self._open = ~exterior.is_all_blocked(store.grid.shape)[self._slice_of]
        self._tiles: OrderedDict[Index, tuple[Tile, list[tuple[Ints, Ints]]]] = OrderedDict()
        none = np.empty((0, 1 + store.grid.dim), dtype=np.int64)
        self._last = none, np.empty((2, 0), dtype=np.int64)  # who asks for one kind often asks for the other next
        self.first = [np.zeros(len(store) + 1, dtype=np.int64) for _ in (FREE_ONES, OPEN_ONES)]
        self.pairs = self._pairs()
        self.roots = [
            _united(int(first[-1]) + len(self._slice_of), pairs)
            for first, pairs in zip(self.first, self.pairs, strict=True)
        ]

    def labels(self, index: Index) -> list[list[Labels]]:
        """Those on the faces of a tile, of both kinds."""
        labels = read_labels(self.store, index)
        if labels is None:
            raise LookupError(index)
        return labels

    def number(self, index: Index) -> int:
        """Number of a tile."""
        return int(np.ravel_multi_index(index, self.store.counts))

    def _pairs(self) -> list[Ints]:
        """Pairs of nodes that are one component, of both kinds; notes the first node of each tile.

        The last nodes are outside the map.
        """
        store, faces, turns = self.store, faces_of(self.store.grid.dim), np.arange(len(self._slice_of))
        joined: list[list[Ints]] = [[np.empty((0, 2), dtype=np.int64)] for _ in self.first]
        outside = list[Ints]()
        behind: dict[tuple[int, int, int], Labels] = {}  # labels on far faces, until the tile behind them comes
        for number, index in enumerate(store):
            for kind, own in enumerate(self.labels(index)):
                first, begin = self.first[kind], self.first[kind][number]
                first[number + 1] = begin + max(int(face.max(initial=-1)) for face in own) + 1
                for (across, far), labels in zip(faces, own, strict=True):
                    beside = [n + (1 if far else -1) * (axis == across) for axis, n in enumerate(index)]
                    if not 0 <= beside[across] < store.counts[across]:
                        if kind == OPEN_ONES:
                            along = np.broadcast_to(turns.reshape(-1, *(1,) * (labels.ndim - 1)), labels.shape)
                            touch = (labels >= 0) & self._open[along]
                            outside.append(_unique(labels[touch] + begin, along[touch]))
                    elif far:
                        behind[kind, across, number] = labels.copy()  # and not all of its tile
                    else:
                        before = self.number(tuple(beside))
                        other = behind.pop((kind, across, before))
                        touch = (labels >= 0) & (other >= 0)
                        joined[kind].append(_unique(other[touch] + first[before], labels[touch] + begin))
        last = self.first[OPEN_ONES][-1]
        joined[OPEN_ONES] += [np.add(pairs, (0, last)) for pairs in outside]
        if len(turns) > 1:
            near = store.rotations.neighbors
            one, other = np.nonzero(near >= 0)[0], near[near >= 0].astype(np.int64)
            both = self._open[one] & self._open[other]
            joined[OPEN_ONES].append(last + _unique(one[both], other[both]))
        return [np.concatenate(pairs) for pairs in joined]

    def nodes_of(self, cells: Ints) -> Ints:
        """Nodes of cells ``(rotation, x, y(, z))``, shape (n, 1 + d), in the map or not, of both kinds, shape (2, n).

        -1 where a cell has none. A component that reaches no face of its tile has a node of its own, below that.
        """
        store, nodes = self.store, np.full((2, len(cells)), -1, dtype=np.int64)
        turns = np.minimum(cells[:, 0], len(self._slice_of) - 1)
        inside = ((cells[:, 1:] >= 0) & (cells[:, 1:] < store.grid.shape)).all(axis=1)
        outside = ~inside & self._open[turns]
        nodes[OPEN_ONES, outside] = self.first[OPEN_ONES][-1] + turns[outside]
        tiles = cells[:, 1:] // store.tile
        for index in np.unique(tiles[inside], axis=0):
            own = np.flatnonzero(inside & (tiles == index).all(axis=1))
            tile, faces = self._tile(tuple(index.tolist()))
            local = cells[own] - [0, *(part.start for part in tile.cells)]
            local[:, 0] = turns[own]
            number = self.number(tuple(index.tolist()))
            for kind in (FREE_ONES, OPEN_ONES):
                roots, (known, labels) = tile.components.of(local, kind == OPEN_ONES), faces[kind]
                place = np.minimum(np.searchsorted(known, roots), max(len(known) - 1, 0))
                there = known[place] == roots if len(known) else np.zeros(len(roots), dtype=np.bool_)
                own_nodes = -2 - (number * 2**32 + roots)  # its own, unless it reaches a face
                own_nodes[there] = self.first[kind][number] + labels[place[there]]
                nodes[kind, own] = np.where(roots < 0, -1, own_nodes)
        return nodes

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Components of FREE cells, or of all that are not BLOCKED; -1 where a cell has none."""
        asked, nodes = self._last
        if not np.array_equal(asked, cells):
            self._last = cells.copy(), (nodes := self.nodes_of(cells))
        components: Ints = nodes[int(mixed)].copy()
        components[components >= 0] = self.roots[int(mixed)][components[components >= 0]]
        return components

    def chain(self, start: Ints, goal: Ints) -> tuple[list[Index], Ints]:
        """The fewest tiles that lead from a cell to another through FREE ones, and where one crosses into the next.

        Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)``, in the map. The tiles are none where nothing leads
        there; the crossings, shape (len(tiles) - 1, 1 + d), are the first cell of each tile but the first one, beside a
        FREE one of the tile before.
        """
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import dijkstra

        first, pairs = self.first[FREE_ONES], self.pairs[FREE_ONES]
        nodes = self.nodes_of(np.stack([start, goal]))[FREE_ONES]
        tiles = [tuple((cell[1:] // self.store.tile).tolist()) for cell in (start, goal)]
        if nodes[0] == nodes[1] != -1:
            return tiles[:1], np.empty((0, len(start)), dtype=np.int64)
        if (nodes < 0).any():
            return [], np.empty((0, len(start)), dtype=np.int64)
        count = int(first[-1]) + len(self._slice_of)
        graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
        before = dijkstra(graph, directed=False, indices=nodes[0], unweighted=True, return_predecessors=True)[1]
        chain = [int(nodes[1])]
        while chain[-1] != nodes[0] and before[chain[-1]] >= 0:
            chain.append(int(before[chain[-1]]))
        if chain[-1] != nodes[0]:
            return [], np.empty((0, len(start)), dtype=np.int64)
        chain.reverse()
        numbers = np.searchsorted(first, chain, side="right") - 1
        tiles = [tuple(int(i) for i in np.unravel_index(number, self.store.counts)) for number in numbers]
        crossings, at = [], start
        for k in range(len(tiles) - 1):
            labels = [chain[k] - int(first[numbers[k]]), chain[k + 1] - int(first[numbers[k + 1]])]
            at = self._crossing(tiles[k], tiles[k + 1], labels, at, goal)
            crossings.append(at)
        return tiles, np.array(crossings).reshape(-1, len(start))

    def _crossing(self, one: Index, other: Index, labels: list[int], at: Ints, goal: Ints) -> Ints:
        """The first cell behind the face of two tiles, in the middle of those of two components, on a short way."""
        from scipy.ndimage import distance_transform_edt

        axis = next(k for k in range(len(one)) if one[k] != other[k])
        far = other[axis] > one[axis]
        here = self.labels(one)[FREE_ONES][2 * axis + far] == labels[0]
        there = self.labels(other)[FREE_ONES][2 * axis + (not far)] == labels[1]
        deep = distance_transform_edt(np.pad(here & there, 1))[(slice(1, -1),) * here.ndim]
        places = np.argwhere(deep >= min(DEEP, deep.max()))
        cells = self.store.cells(one)
        border = cells[axis].stop - 1 if far else cells[axis].start
        cells_here = np.insert(places, 1 + axis, border, axis=1)
        for k, part in enumerate(cells):
            if k != axis:
                cells_here[:, 1 + k] += part.start
        detour = sum(np.linalg.norm((cells_here - end)[:, 1:].astype(float), axis=1) for end in (at, goal))
        best: Ints = cells_here[int(np.argmin(detour))]
        best[1 + axis] += 1 if far else -1
        return best

    def _tile(self, index: Index) -> tuple[Tile, list[tuple[Ints, Ints]]]:
        """A tile, and of each kind the components on its faces, ascending, with the label of each."""
        if index not in self._tiles:
            tile, pairs = Tile(self.store, index), []
            for flat, faces in zip(tile.roots(), self.labels(index), strict=True):
                labels = np.concatenate([face.ravel() for face in faces])
                known, place = np.unique(flat, return_index=True)
                pairs.append((known[known >= 0], labels[place][known >= 0].astype(np.int64)))
            self._tiles[index] = tile, pairs
            if len(self._tiles) > HELD:
                self._tiles.popitem(last=False)
        self._tiles.move_to_end(index)
        return self._tiles[index]


def label_all(job: Job, client: Client | None, progress: Callable[[int], None] | None = None) -> None:
    """Label the tiles that are not labelled, or not as they are now."""
    store = job.store
    store.add_labels()
    todo = [index for index in store if read_labels(store, index) is None]
    run(label, job, todo, client, None, progress)


def _unique(one: NDArray[Any], other: NDArray[Any]) -> Ints:
    """Pairs, each once, shape (n, 2)."""
    pairs = np.stack([one, other], axis=-1).astype(np.int64).reshape(-1, 2)
    return np.unique(pairs, axis=0)


def _united(count: int, pairs: Ints) -> Ints:
    """Component of each of some nodes that pairs join."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    ones = np.ones(len(pairs), dtype=np.bool_)
    graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    roots: Ints = connected_components(graph, directed=False)[1].astype(np.int64)
    return roots
