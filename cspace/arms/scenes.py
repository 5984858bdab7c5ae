"""Scenes of links and obstacles, packed for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from cspace.arms.chain import Chain
from cspace.arms.proofs import Scene, Solids
from cspace.arms.solids import PosedShape, Solid
from cspace.bodies import DISTANCE_ROUNDING
from cspace.bodies.hulls import Hulls, join_roots
from cspace.bodies.triangles import NO_TREE, SurfaceTree, join_trees
from cspace.support.arrays import Floats, Ints

_NO_SURFACE: Final = SurfaceTree(
    np.empty((0, 6)), NO_TREE.spans, np.empty((0, 3, 3)), np.empty(0, dtype=np.int64)
)


def make_scene(
    chain: Chain,
    solids: Sequence[Solid],
    pairs: Sequence[tuple[int, int]],
    padding: Floats | None = None,
    margin: float = 0.0,
) -> Scene:
    """Return the scene of outer shapes, which proves FREE.

    Pairs of solids, given by their indices, must be farther apart than the margin and their
    padding, shape (p,).
    """
    parts = [part.bounds_pair[0] for solid in solids for part in solid.parts]
    packed = _pack(solids, parts, [part.anchors for part in parts], *_pack_hulls(solids))
    max_coordinate = _find_max_coordinate(chain, packed)
    required = margin + 2.0 * DISTANCE_ROUNDING * max_coordinate
    numbers = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    extra = np.zeros(len(numbers)) if padding is None else padding
    return Scene(chain, packed, numbers, extra, max_coordinate, required)


def make_inner_scene(scene: Scene, solids: Sequence[Solid]) -> Scene:
    """Return the scene of inner shapes, which proves BLOCKED, from that of outer shapes.

    Distances must exceed ``2 DISTANCE_ROUNDING max_coordinate`` for the positions of points, and as
    much again for the rounding of :func:`cspace.support.vectors.point_triangle`, which is below
    ``2^-38`` of the largest link or obstacle.
    """
    pairs = [part.bounds_pair for solid in solids for part in solid.parts]
    parts = [inner for _, inner in pairs]
    points = [part.probes for part in parts]
    outer = scene.solids
    if all(inner is bound for bound, inner in pairs):
        anchors, starts = _pack_points(solids, parts, points)
        packed = outer._replace(anchors=anchors, starts=starts)
    else:
        packed = _pack(solids, parts, points, outer.hulls, outer.roots, outer.part_roots)
    max_coordinate = _find_max_coordinate(scene.chain, packed)
    required = 4.0 * DISTANCE_ROUNDING * max_coordinate
    return Scene(
        scene.chain, packed, scene.pairs, np.zeros(len(scene.pairs)), max_coordinate, required
    )


def _pack(
    solids: Sequence[Solid],
    parts: Sequence[PosedShape],
    points: Sequence[Floats],
    hulls: Hulls,
    roots: Ints,
    part_roots: Ints,
) -> Solids:
    """Return solids whose parts are ``parts``, with the anchors ``points`` of each part."""
    trees, tree_roots = join_trees([part.tree for part in parts], NO_TREE)
    closed = [part.surface_tree for part in parts if len(part.surface[0])]
    surfaces, surface_roots = join_trees(closed, _NO_SURFACE)
    anchors, starts = _pack_points(solids, parts, points)
    filled = [part.is_filled and len(part.tree.boxes) > 0 for part in parts]
    filled_before = np.cumsum([0, *filled])
    # An empty solid has no root, and reaches nowhere.
    boxes = np.where(roots[:, np.newaxis] >= 0, hulls.boxes[roots], 0.0)
    return Solids(
        bodies=np.array([solid.body for solid in solids], dtype=np.int64),
        hulls=hulls,
        roots=roots,
        part_roots=part_roots,
        levers=np.linalg.norm(np.abs(boxes[:, :3]) + boxes[:, 3:6], axis=1),
        trees=trees,
        tree_roots=tree_roots,
        surfaces=surfaces,
        surface_roots=surface_roots,
        anchors=anchors,
        has_solids=np.diff(filled_before[starts[:, 2]]) > 0,
        starts=starts,
    )


def _pack_points(
    solids: Sequence[Solid], parts: Sequence[PosedShape], points: Sequence[Floats]
) -> tuple[Floats, Ints]:
    """Return the points of all parts, and the first entries of each solid.

    These are its first surface, point and part, shape (s + 1, 3).
    """
    counts = [(0, 0, 0)]
    for part, part_points in zip(parts, points, strict=True):
        corners, _ = part.surface
        counts.append((len(corners) > 0, len(part_points), 1))
    before_parts = np.cumsum(counts, axis=0, dtype=np.int64)
    first_parts = np.cumsum([0, *(len(solid.parts) for solid in solids)])
    return np.concatenate([np.empty((0, 3)), *points]), before_parts[first_parts]


def _pack_hulls(solids: Sequence[Solid]) -> tuple[Hulls, Ints, Ints]:
    """Join the hulls of the outer shapes of all parts in one record.

    Also returns the root of each solid, above its parts, and the root of each part; -1 for none.
    """
    # No child may be node 0, because that marks leaves.
    boxes = [np.zeros((1, 9))]
    nodes = [np.zeros((1, 5), dtype=np.int64)]
    corners = [np.empty((3, 0))]
    roots = list[int]()
    part_roots = list[int]()
    count = 1
    corner = 0
    for solid in solids:
        solid_roots = list[int]()
        solid_boxes = list[Floats]()
        for part in solid.parts:
            hulls = part.bounds_pair[0].hulls
            size = len(hulls.nodes)
            part_roots.append(count if size else -1)
            if not size:
                continue
            shifts = np.where(hulls.nodes > 0, (count, corner, corner, 0, count), 0)
            shifts[:, 1] = shifts[:, 2]  # the range of a hull's corners may start at 0
            solid_roots.append(count)
            solid_boxes.append(hulls.boxes[0])
            boxes.append(hulls.boxes)
            nodes.append(hulls.nodes + shifts)
            corners.append(hulls.corners)
            count += size
            corner += hulls.corners.shape[1]
        root = solid_roots[0] if solid_roots else -1
        if len(solid_roots) > 1:
            root = count
            upper_boxes, upper_nodes = join_roots(
                np.array(solid_boxes), np.array(solid_roots), count
            )
            boxes.append(upper_boxes)
            nodes.append(upper_nodes)
            count += len(upper_nodes)
        roots.append(root)
    joined = Hulls(np.concatenate(boxes), np.concatenate(nodes), np.concatenate(corners, axis=1))
    return joined, np.array(roots, dtype=np.int64), np.array(part_roots, dtype=np.int64)


def _find_max_coordinate(chain: Chain, solids: Solids) -> float:
    """Return the largest coordinate at any configuration, metres."""
    boxes = solids.trees.boxes[solids.tree_roots[solids.tree_roots >= 0]]
    in_bodies = (np.abs(boxes[:, :3]) + boxes[:, 3:6]).max(initial=0.0)
    return float(in_bodies + chain.lengths.max())
