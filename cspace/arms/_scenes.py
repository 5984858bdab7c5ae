"""Scenes of links and obstacles, packed for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from cspace.arms._chain import DISTANCE_ROUNDING, Chain
from cspace.arms._crossings import NO_TREE, SurfaceTree, join_trees
from cspace.arms._hulls import FIRST_CORNER, STOP_CORNER, Hulls, join_roots
from cspace.arms._motion_proofs import FIRST_PART, ArmScene, Solids
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
    anchors = [part.anchors for part in parts]
    packed = _pack(solids, parts, anchors, *_pack_hulls(solids))
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
    bounds_pairs = [bounds for solid in solids for bounds in solid.bounds_pairs]
    parts = [inner for _, inner in bounds_pairs]
    probes = [part.probes for part in parts]
    outer_solids = scene.solids
    # Exact shapes are their own inner shapes, so only the points differ.
    if all(inner is outer for outer, inner in bounds_pairs):
        anchors, starts = _pack_points(solids, parts, probes)
        packed = outer_solids._replace(anchors=anchors, starts=starts)
    else:
        hulls, roots, part_roots = outer_solids.hulls, outer_solids.roots, outer_solids.part_roots
        packed = _pack(solids, parts, probes, hulls, roots, part_roots)
    max_coordinate = _find_max_coordinate(scene.chain, packed)
    required = 4.0 * DISTANCE_ROUNDING * max_coordinate
    return ArmScene(
        scene.chain, packed, scene.pairs, np.zeros(len(scene.pairs)), max_coordinate, required
    )


def _pack(
    solids: Sequence[Solid],
    parts: Sequence[Part],
    points: Sequence[Floats],
    hulls: Hulls,
    roots: Ints,
    part_roots: Ints,
) -> Solids:
    """Pack solids for kernels, with anchors (n, 3) of each part.

    ``parts`` are the outer or the inner parts of all solids. ``hulls``, the root of each solid and
    the root of each part there are given; see :class:`Solids`.
    """
    trees, tree_roots = join_trees([part.tree for part in parts], NO_TREE)
    closed_parts = [part for part in parts if _has_surface(part)]
    surfaces, surface_roots = join_trees([part.surface_tree for part in closed_parts], _NO_SURFACE)
    anchors, starts = _pack_points(solids, parts, points)
    # Count the parts of boxes or balls that each solid has.
    has_solid = [part.is_filled and len(part.tree.boxes) > 0 for part in parts]
    solids_before = np.cumsum([0, *has_solid])
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
        has_solids=np.diff(solids_before[starts[:, FIRST_PART]]) > 0,
        starts=starts,
    )


def _has_surface(part: Part) -> bool:
    """Return True if a part has closed surfaces."""
    triangles, _ = part.surface
    return len(triangles) > 0


def _pack_points(
    solids: Sequence[Solid], parts: Sequence[Part], points: Sequence[Floats]
) -> tuple[Floats, Ints]:
    """Pack points (m, 3) of all parts, and where solids begin.

    The second result has the first surface, point and part of each solid, shape (s + 1, 3); the
    last row has their numbers.
    """
    # Surfaces, points and parts before each part.
    counts = [(0, 0, 0)]
    for part, part_points in zip(parts, points, strict=True):
        counts.append((_has_surface(part), len(part_points), 1))
    before_parts = np.cumsum(counts, axis=0, dtype=np.int64)
    first_parts = np.cumsum([0, *(len(solid.parts) for solid in solids)])
    return np.concatenate([np.empty((0, 3)), *points]), before_parts[first_parts]


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
    roots = solids.tree_roots[solids.tree_roots >= 0]
    boxes = solids.trees.boxes[roots]
    centers, half_sides = boxes[:, :3], boxes[:, 3:6]
    largest_in_body = (np.abs(centers) + half_sides).max(initial=0.0)
    return float(largest_in_body + chain.lengths.max())
