"""Scenes of links and obstacles, packed for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from cspace.arms._chain import DISTANCE_ROUNDING, Chain
from cspace.arms._crossings import NO_TREE, PartTree, SurfaceTree, join_trees
from cspace.arms._hulls import FIRST_CORNER, STOP_CORNER, Hulls, join_roots
from cspace.arms._motion_proofs import ArmScene, Solids
from cspace.arms._solids import Part, Solid
from cspace.inside import Floats, Ints

_NO_SURFACE: Final = SurfaceTree(
    np.empty((0, 6)), NO_TREE.spans, np.empty((0, 3, 3)), np.empty(0, dtype=np.int64)
)
"""A tree without triangles."""


def make_scene(
    chain: Chain,
    solids: Sequence[Solid],
    pairs: Sequence[tuple[int, int]],
    padding: Floats | None = None,
    margin: float = 0.0,
) -> ArmScene:
    """Make the scene of outer shapes, which proves FREE.

    Pairs of solids, given by their indices, must be farther apart than the margin and their
    padding, shape (p,), both in metres.
    """
    parts = [outer for solid in solids for outer, _ in solid.bounds_pairs]
    # Hulls prove parts apart, and nothing apart from a part's only hull can lie in the part.
    trees = [part.tree if part.is_filled else NO_TREE for part in parts]
    surfaces = [part.surface_tree if len(part.hulls.nodes) > 1 else _NO_SURFACE for part in parts]
    anchors = [part.anchors for part in parts]
    packed = _pack(solids, parts, trees, surfaces, anchors, *_pack_hulls(solids))
    max_coordinate = _find_max_coordinate(chain, packed)
    required = margin + 2.0 * DISTANCE_ROUNDING * max_coordinate
    pair_indices = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    extra = np.zeros(len(pair_indices)) if padding is None else padding
    return ArmScene(chain, packed, pair_indices, extra, max_coordinate, required)


def make_inner_scene(scene: ArmScene, solids: Sequence[Solid]) -> ArmScene:
    """Make the inner scene, which proves BLOCKED, from the outer one.

    Distances must exceed ``2 DISTANCE_ROUNDING max_coordinate`` for the positions of points, and as
    much again for the rounding of :func:`cspace._support.vectors.triangle_distance`, which is below
    ``2^-38`` of the largest link or obstacle.
    """
    parts = [inner for solid in solids for _, inner in solid.bounds_pairs]
    trees = [part.tree for part in parts]
    surfaces = [part.surface_tree for part in parts]
    probes = [part.probes for part in parts]
    outer = scene.solids
    hulls = outer.hulls, outer.roots, outer.part_roots
    packed = _pack(solids, parts, trees, surfaces, probes, *hulls)
    required = 4.0 * DISTANCE_ROUNDING * scene.max_coordinate
    no_padding = np.zeros(len(scene.pairs))
    return ArmScene(scene.chain, packed, scene.pairs, no_padding, scene.max_coordinate, required)


def _pack(
    solids: Sequence[Solid],
    parts: Sequence[Part],
    trees: Sequence[PartTree],
    surfaces: Sequence[SurfaceTree],
    points: Sequence[Floats],
    hulls: Hulls,
    roots: Ints,
    part_roots: Ints,
) -> Solids:
    """Pack solids for kernels, with a tree, a surface and points (n, 3) of each part.

    ``parts`` are the outer or the inner parts of all solids. ``hulls``, the root of each solid and
    the root of each part there are given; see :class:`Solids`.
    """
    joined_trees, tree_roots = join_trees(trees, NO_TREE)
    closed = [surface for surface in surfaces if len(surface.boxes)]
    joined_surfaces, surface_roots = join_trees(closed, _NO_SURFACE)
    # Surfaces, points, parts, and parts of boxes or balls, before each part.
    counts = [
        (len(surface.boxes) > 0, len(rows), 1, part.is_filled)
        for part, surface, rows in zip(parts, surfaces, points, strict=True)
    ]
    before_parts = np.cumsum([(0, 0, 0, 0), *counts], axis=0, dtype=np.int64)
    first_parts = np.cumsum([0, *(len(solid.parts) for solid in solids)])
    *starts, filled_before = before_parts[first_parts].T
    # An empty solid has no root, and reaches nowhere.
    boxes = np.where(roots[:, np.newaxis] >= 0, hulls.boxes[roots], 0.0)
    return Solids(
        bodies=np.array([solid.body for solid in solids], dtype=np.int64),
        hulls=hulls,
        roots=roots,
        part_roots=part_roots,
        levers=np.linalg.norm(np.abs(boxes[:, :3]) + boxes[:, 3:6], axis=1),
        trees=joined_trees,
        tree_roots=tree_roots,
        surfaces=joined_surfaces,
        surface_roots=surface_roots,
        anchors=np.concatenate([np.empty((0, 3)), *points]),
        has_solids=np.diff(filled_before) > 0,
        starts=np.stack(starts, axis=1),
    )


def _pack_hulls(solids: Sequence[Solid]) -> tuple[Hulls, Ints, Ints]:
    """Join the hulls of all parts' outer shapes in one record.

    Also returns the root of each solid, above its parts, and the root of each part; -1 for none.
    """
    # No child may be node 0, because that marks leaves.
    boxes = [np.zeros((1, 9))]
    nodes = [np.zeros((1, 5), dtype=np.int64)]
    corners = [np.empty((3, 0))]
    roots = list[int]()
    part_roots = list[int]()
    next_node = 1
    next_corner = 0
    for solid in solids:
        solid_roots = list[int]()
        solid_boxes = list[Floats]()
        for outer, _ in solid.bounds_pairs:
            hulls = outer.hulls
            part_roots.append(next_node if len(hulls.nodes) else -1)
            if not len(hulls.nodes):
                continue
            # Children and corners move up; a zero means that there are none.
            columns = next_node, next_corner, next_corner, 0, next_node
            shifts = np.where(hulls.nodes > 0, columns, 0)
            # The range of a hull's corners may start at 0, so its end decides.
            shifts[:, FIRST_CORNER] = shifts[:, STOP_CORNER]
            solid_roots.append(next_node)
            solid_boxes.append(hulls.boxes[0])
            boxes.append(hulls.boxes)
            nodes.append(hulls.nodes + shifts)
            corners.append(hulls.corners)
            next_node += len(hulls.nodes)
            next_corner += hulls.corners.shape[1]
        # A solid of several parts gets further nodes above their roots.
        root = solid_roots[0] if solid_roots else -1
        if len(solid_roots) > 1:
            root = next_node
            upper_boxes, upper_nodes = join_roots(
                np.array(solid_boxes), np.array(solid_roots), next_node
            )
            boxes.append(upper_boxes)
            nodes.append(upper_nodes)
            next_node += len(upper_nodes)
        roots.append(root)
    joined = Hulls(np.concatenate(boxes), np.concatenate(nodes), np.concatenate(corners, axis=1))
    return joined, np.array(roots, dtype=np.int64), np.array(part_roots, dtype=np.int64)


def _find_max_coordinate(chain: Chain, solids: Solids) -> float:
    """Bound all coordinates at any configuration, metres."""
    boxes = solids.hulls.boxes[solids.roots[solids.roots >= 0]]
    centers, half_sides = boxes[:, :3], boxes[:, 3:6]
    largest_in_body = (np.abs(centers) + half_sides).max(initial=0.0)
    return float(largest_in_body + chain.lengths.max())
