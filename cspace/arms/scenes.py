"""Scenes of links and obstacles, packed for kernels, that change without packing all parts again."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Container, Hashable, Iterable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from cspace.arms.chain import Chain
from cspace.arms.hulls import Hulls, join_roots
from cspace.arms.proofs import Scene, Solids
from cspace.arms.solids import PosedShape, Solid
from cspace.arrays import Floats, Ints
from cspace.exact import DISTANCE_ROUNDING
from cspace.exact.triangles import Trees

_SPARE_SHARE: Final = 0.25
"""Rows that a new store has for parts that come later, as a share of the rows in use."""


_MORE_SPARE_SHARE: Final = 1.0
"""The same share for a store that replaces a full one, because its scene changes."""


_MIN_SPARE_ROWS: Final = 256
"""Smallest number of rows reserved."""

_SHARED_SPARE_ROWS: Final = 50_000
"""Rows that the store of an arm's links has for the obstacles of its scenes. They take memory once they are written."""


class _PartRows(NamedTuple):
    """Roots of a part in both trees, -1 for none, and the range of its triangles in the arrays of a store."""

    root: int
    tree_root: int
    start: int
    stop: int


class PartStore:
    """Arrays of parts, filled from the start.

    Rows are never overwritten, so that kernels that read an earlier scene are not disturbed.

    Parameters
    ----------
    counts : ndarray of int64, shape (5,)
        Rows reserved at once: nodes and corners of hulls, nodes and rows of trees, triangles of surfaces.
    spare_share : float
        Further rows, as a share of these.
    spare_rows : int
        Further rows.

    Attributes
    ----------
    hulls : Hulls
    trees : Trees
    triangles : ndarray of float64, shape (n, 3, 3)
    windings : ndarray of int64, shape (n,)
    """

    def __init__(self, counts: Ints, spare_share: float = _SPARE_SHARE, spare_rows: int = _MIN_SPARE_ROWS) -> None:
        self._sizes = (counts * (1.0 + spare_share)).astype(np.int64) + spare_rows
        self._used, self._lock = counts, threading.Lock()
        nodes, corners, tree_nodes, rows, triangles = self._sizes.tolist()
        # Zeros take memory only once they are written, and keep old contents of the memory out of pickles.
        self.hulls = Hulls(np.zeros((nodes, 9)), np.zeros((nodes, 5), dtype=np.int64), np.zeros((3, corners)))
        spans = np.zeros((tree_nodes, 2), dtype=np.int64)
        self.trees = Trees(np.zeros((tree_nodes, 7)), spans, np.zeros((rows, 10)))
        self.triangles, self.windings = np.zeros((triangles, 3, 3)), np.zeros(triangles, dtype=np.int64)

    def reserve(self, counts: Ints) -> Ints | None:
        """Reserve rows; return the first, shape (5,), or None if full."""
        with self._lock:
            first, stop = self._used, self._used + counts
            if (stop > self._sizes).any():
                return None
            self._used = stop
        return first

    @property
    def is_half_full(self) -> bool:
        """Whether some array has less than half its spare rows left."""
        return bool((self._sizes - self._used < _SHARED_SPARE_ROWS // 2).any())

    def write_part(self, part: PosedShape, first: Ints, with_hulls: bool) -> _PartRows:
        """Write a part to reserved rows."""
        node, corner, tree_node, row, triangle = first.tolist()
        root = tree_root = -1
        hulls = part.hulls if with_hulls else None
        if hulls is not None and len(hulls.nodes):
            root, stop = node, node + len(hulls.nodes)
            shift = (hulls.nodes > 0) * np.array([node, corner, corner, 0, node])
            shift[:, 1] = shift[:, 2]
            self.hulls.boxes[node:stop], self.hulls.nodes[node:stop] = hulls.boxes, hulls.nodes + shift
            self.hulls.corners[:, corner : corner + hulls.corners.shape[1]] = hulls.corners
        tree = part.tree
        if len(tree.boxes):
            tree_root, stop = tree_node, tree_node + len(tree.boxes)
            self.trees.boxes[tree_node:stop], self.trees.spans[tree_node:stop] = tree.boxes, tree.spans
            self.trees.spans[tree_node:stop, 0] += row
            self.trees.triangles[row : row + len(tree.triangles)] = tree.triangles
        corners, windings = part.surface
        stop = triangle + len(corners)
        self.triangles[triangle:stop], self.windings[triangle:stop] = corners, windings
        return _PartRows(root, tree_root, triangle, stop)

    def join(self, roots: Ints, start: int) -> None:
        """Write the nodes above several roots to reserved rows."""
        stop = start + len(roots) - 1
        self.hulls.boxes[start:stop], self.hulls.nodes[start:stop] = join_roots(self.hulls.boxes[roots], roots, start)


class PackedSolids(NamedTuple):
    """Solids in a store.

    Attributes
    ----------
    solids : tuple of Solid
    store : PartStore
    rows : dict of PosedShape to _PartRows
        Rows of the outer and inner shapes of all parts.
    roots : dict of tuple of PosedShape to int
        Root of the hulls of each solid, by its parts; -1 if it is empty.
    """

    solids: tuple[Solid, ...]
    store: PartStore
    rows: Mapping[PosedShape, _PartRows]
    roots: Mapping[tuple[PosedShape, ...], int]


def pack_solids(
    solids: Sequence[Solid], before: PackedSolids | None = None, spare_rows: int = _MIN_SPARE_ROWS
) -> PackedSolids:
    """Pack solids.

    Parts that were packed before keep their rows, if the new parts fit behind them. Otherwise all go to a new store.
    """
    pairs = [part.bounds_pair for solid in solids for part in solid.parts]
    outer = dict.fromkeys(pair[0] for pair in pairs)
    parts = [*outer, *(inner for bound, inner in pairs if inner is not bound)]
    joined = dict.fromkeys(solid.parts for solid in solids)
    known, first = before, None
    if known is not None:
        new = [part for part in parts if part not in known.rows]
        counts = _count_rows(new, outer, [each for each in joined if each not in known.roots])
        first = known.store.reserve(counts.sum(axis=0))
    if known is None or first is None:
        counts = _count_rows(parts, outer, joined)
        first = np.array([1, 0, 0, 0, 0])  # no child may be node 0, because that marks leaves
        share = _SPARE_SHARE if before is None else _MORE_SPARE_SHARE
        known = PackedSolids((), PartStore(first + counts.sum(axis=0), share, spare_rows), {}, {})
    rows, roots, store = {}, {}, known.store
    starts = iter(first + np.cumsum(counts, axis=0) - counts)
    for part in parts:
        rows[part] = known.rows[part] if part in known.rows else store.write_part(part, next(starts), part in outer)
    node = int(next(starts)[0])
    for group in joined:
        if group in known.roots:
            roots[group] = known.roots[group]
            continue
        filled = [root for part in group if (root := rows[part.bounds_pair[0]].root) >= 0]
        roots[group] = filled[0] if len(filled) == 1 else node if filled else -1
        if len(filled) > 1:
            store.join(np.array(filled), node)
            node += len(filled) - 1
    return PackedSolids(tuple(solids), store, rows, roots)


class LinkStores:
    """Stores for the links and obstacles of an arm's scenes.

    So a new scene copies no link. An arm gets a new store once its store is half full; scenes keep theirs.
    """

    def __init__(self) -> None:
        self._packed = weakref.WeakKeyDictionary[Hashable, PackedSolids]()
        self._lock = threading.Lock()

    def pack(self, arm: Hashable, links: Sequence[Solid], solids: Sequence[Solid]) -> PackedSolids:
        """Pack the solids of an arm's new scene."""
        with self._lock:
            known = self._packed.get(arm)
            if known is None or known.store.is_half_full:
                known = self._packed[arm] = pack_solids(links, spare_rows=_SHARED_SPARE_ROWS)
        return pack_solids(solids, known)


def _count_rows(
    parts: Sequence[PosedShape], outer: Container[PosedShape], joined: Iterable[tuple[PosedShape, ...]]
) -> Ints:
    """Return how many rows of each array of a store each part needs, shape (n + 1, 5); last the nodes above parts."""
    counts = np.zeros((len(parts) + 1, 5), dtype=np.int64)
    for count, part in zip(counts, parts, strict=False):
        if part in outer:
            count[:2] = len(part.hulls.nodes), part.hulls.corners.shape[1]
        count[2:] = len(part.tree.boxes), len(part.tree.triangles), len(part.surface[0])
    counts[-1, 0] = sum(map(len, joined))
    return counts


def make_scene(chain: Chain, solids: Sequence[Solid], pairs: Sequence[tuple[int, int]], margin: float = 0.0) -> Scene:
    """Return a scene of the outer shapes.

    Solids of a pair, given by their indices, may not touch.
    """
    return make_outer_scene(chain, pack_solids(solids), pairs, np.zeros(len(pairs)), margin)


def make_outer_scene(
    chain: Chain, packed: PackedSolids, pairs: Sequence[tuple[int, int]], padding: Floats, margin: float
) -> Scene:
    """Return the scene of outer shapes, which proves FREE.

    Pairs of solids, given by their indices, must be farther apart than the margin and their padding, shape (p,).
    """
    solids = _select_side(packed, 0)
    max_coordinate = _max_coordinate(chain, solids)
    required = margin + 2.0 * DISTANCE_ROUNDING * max_coordinate
    return Scene(chain, solids, np.array(pairs, dtype=np.int64).reshape(-1, 2), padding, max_coordinate, required)


def make_inner_scene(scene: Scene, packed: PackedSolids) -> Scene:
    """Return the scene with inner shapes, which proves collisions.

    Distances must exceed ``2 DISTANCE_ROUNDING max_coordinate`` for the positions of points, and as much again for the
    rounding of :func:`cspace.kernels.point_triangle`, which is below ``2^-38`` of the largest link or obstacle.
    """
    solids = _select_side(packed, 1, scene.solids)
    is_same = solids.tree_roots is scene.solids.tree_roots
    max_coordinate = scene.max_coordinate if is_same else _max_coordinate(scene.chain, solids)
    required = 4.0 * DISTANCE_ROUNDING * max_coordinate
    return Scene(scene.chain, solids, scene.pairs, np.zeros(len(scene.pairs)), max_coordinate, required)


def _select_side(packed: PackedSolids, side: int, outer: Solids | None = None) -> Solids:
    """Return packed solids as kernels take them.

    ``side`` 0 selects their outer shapes, 1 their inner shapes, both with the hulls of outer shapes. Anchors of outer
    shapes are one point per connected part; anchors of inner shapes are :attr:`PosedShape.probes`. If all shapes are
    exact, the rest is that of ``outer``.
    """
    store, pairs = packed.store, [part.bounds_pair for solid in packed.solids for part in solid.parts]
    rows = [packed.rows[pair[side]] for pair in pairs]
    points = [pair[side].probes if side else pair[side].anchors for pair in pairs]
    counts = [(row.stop > row.start, len(each), 1) for row, each in zip(rows, points, strict=True)]
    first_parts = np.cumsum([0, *(len(solid.parts) for solid in packed.solids)], dtype=np.int64)
    starts = np.cumsum([(0, 0, 0), *counts], axis=0, dtype=np.int64)[first_parts]
    anchors = np.concatenate([np.empty((0, 3)), *(each for each in points if len(each))])
    if outer is not None and all(pair[0] is pair[1] for pair in pairs):
        return outer._replace(anchors=anchors, starts=starts)
    closed = [(row, pair[side].surface_box) for row, pair in zip(rows, pairs, strict=True) if row.stop > row.start]
    filled = [pair[side].is_filled and row.tree_root >= 0 for pair, row in zip(pairs, rows, strict=True)]
    roots = np.array([packed.roots[solid.parts] for solid in packed.solids], dtype=np.int64)
    boxes = store.hulls.boxes[roots] * (roots >= 0)[:, None]
    return Solids(
        bodies=np.array([solid.body for solid in packed.solids], dtype=np.int64),
        hulls=store.hulls,
        roots=roots,
        part_roots=np.array([packed.rows[pair[0]].root for pair in pairs], dtype=np.int64),
        levers=np.linalg.norm(np.abs(boxes[:, :3]) + boxes[:, 3:6], axis=1),
        trees=store.trees,
        tree_roots=np.array([row.tree_root for row in rows], dtype=np.int64),
        triangles=store.triangles,
        windings=store.windings,
        boxes=np.array([box for _, box in closed]).reshape(-1, 6),
        surface_spans=np.array([(row.start, row.stop) for row, _ in closed], dtype=np.int64).reshape(-1, 2),
        anchors=anchors,
        has_solids=np.diff(np.cumsum([False, *filled])[first_parts]) > 0,
        starts=starts,
    )


def _max_coordinate(chain: Chain, solids: Solids) -> float:
    """Return the largest coordinate at any configuration, metres."""
    roots = solids.trees.boxes[solids.tree_roots[solids.tree_roots >= 0]]
    return float((np.abs(roots[:, :3]) + roots[:, 3:6]).max(initial=0.0)) + float(chain.lengths.max())
