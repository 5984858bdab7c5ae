"""Scenes of bodies and obstacles, packed for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from cspace._bodies import DISTANCE_ROUNDING, box_trees
from cspace._bodies.chain import Chain
from cspace._bodies.hulls import FIRST_CORNER, STOP_CORNER, Hulls, join_roots
from cspace._bodies.motion_proofs import ArmScene, Solids
from cspace._bodies.part_trees import NO_TREE, PartTree, SurfaceTree
from cspace._bodies.solids import Part, Solid
from cspace._support.arrays import Floats, Ints

NO_SURFACE: Final = SurfaceTree(
    np.empty((0, 6)), NO_TREE.spans, np.empty((0, 3, 3)), np.empty(0, dtype=np.int64)
)
"""A tree without triangles."""


_NO_HULLS: Final = Hulls(np.zeros((1, 9)), np.zeros((1, 5), dtype=np.int64), np.empty((3, 0)))
"""A node that belongs to no part, because node 0 marks leaves."""


class PackedParts(NamedTuple):
    """Outer parts of links, joined for kernels.

    Attributes
    ----------
    hulls : Hulls
        Hulls of all parts. Node 0 is none of theirs, because it marks leaves.
    surfaces : SurfaceTree
        Closed surfaces of all parts.
    roots : dict
        Root of each part in ``hulls`` and in ``surfaces``; -1 for none.
    """

    hulls: Hulls
    surfaces: SurfaceTree
    roots: dict[Part, tuple[int, int]]


class _HullList:
    """Hulls that are joined after others, ``before``."""

    def __init__(self, before: Hulls) -> None:
        """Begin with the hulls ``before``."""
        self._all = [before]
        self._next_node = len(before.nodes)
        self._next_corner = before.corners.shape[1]

    def add(self, hulls: Hulls) -> int:
        """Add the hulls of a part, and return their root; -1 if there are none."""
        # Children and corners move up; a zero means that there are none.
        node, corner = self._next_node, self._next_corner
        shifts = np.where(hulls.nodes > 0, (node, corner, corner, 0, node), 0)
        # The range of a hull's corners may start at 0, so its end decides.
        shifts[:, FIRST_CORNER] = shifts[:, STOP_CORNER]
        return self._append(hulls._replace(nodes=hulls.nodes + shifts))

    def add_solid(self, rooted_parts: Sequence[tuple[Part, int]]) -> int:
        """Add nodes above parts with their roots, and return the root of all; -1 for none."""
        filled = [(part, root) for part, root in rooted_parts if root >= 0]
        if len(filled) < 2:
            return filled[0][1] if filled else -1
        boxes = np.array([part.hulls.boxes[0] for part, _ in filled])
        upper = join_roots(boxes, np.array([root for _, root in filled]), self._next_node)
        return self._append(Hulls(*upper, np.empty((3, 0))))

    def _append(self, hulls: Hulls) -> int:
        """Append hulls whose nodes are numbered already, and return their root."""
        root = self._next_node
        self._all.append(hulls)
        self._next_node += len(hulls.nodes)
        self._next_corner += hulls.corners.shape[1]
        return root if len(hulls.nodes) else -1

    def join(self) -> Hulls:
        """Return all hulls."""
        boxes, nodes, corners = zip(*self._all, strict=True)
        return Hulls(np.concatenate(boxes), np.concatenate(nodes), np.concatenate(corners, axis=1))


def pack_parts(parts: Sequence[Part]) -> PackedParts:
    """Pack the outer parts of links."""
    hulls = _HullList(_NO_HULLS)
    roots = [hulls.add(part.hulls) for part in parts]
    surfaces, surface_roots = box_trees.join_trees(_list_surfaces(parts), NO_SURFACE)
    pairs = zip(roots, surface_roots.tolist(), strict=True)
    return PackedParts(hulls.join(), surfaces, dict(zip(parts, pairs, strict=True)))


def _list_surfaces(parts: Sequence[Part]) -> list[SurfaceTree]:
    """Return the closed surfaces of outer parts; nothing apart from an only hull lies in a part."""
    return [part.surface_tree if len(part.hulls.nodes) > 1 else NO_SURFACE for part in parts]


def make_scene(
    chain: Chain,
    solids: Sequence[Solid],
    pairs: Sequence[tuple[int, int]],
    packed: PackedParts,
    padding: Floats | None = None,
    margin: float = 0.0,
) -> ArmScene:
    """Make the scene of outer shapes, which proves FREE.

    Pairs of solids, given by their indices, must be farther apart than the margin and their
    padding, shape (p,), both in metres. ``packed`` are the parts of the arm's links.
    """
    bodies = [[outer for outer, _ in solid.bounds_pairs] for solid in solids]
    parts = [part for body in bodies for part in body]
    hulls = _HullList(packed.hulls)
    surfaces, roots = _add_parts(hulls, parts, packed)
    solid_roots = [hulls.add_solid([(part, roots[part][0]) for part in body]) for body in bodies]
    root_pairs = np.array([roots[part] for part in parts], dtype=np.int64).reshape(-1, 2)
    part_roots, surface_roots = np.ascontiguousarray(root_pairs.T)
    scene = _pack(
        solids,
        parts,
        # Hulls prove parts apart.
        [part.tree if part.is_filled else NO_TREE for part in parts],
        surfaces,
        surface_roots,
        [part.anchors for part in parts],
        hulls.join(),
        np.array(solid_roots, dtype=np.int64),
        part_roots,
    )
    max_coordinate = _find_max_coordinate(chain, scene)
    required = margin + 2.0 * DISTANCE_ROUNDING * max_coordinate
    pair_indices = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    extra = np.zeros(len(pair_indices)) if padding is None else padding
    return ArmScene(chain, scene, pair_indices, extra, max_coordinate, required)


def make_hull_scene(chain: Chain, first: Sequence[Part], second: Sequence[Part]) -> ArmScene:
    """Make a scene whose first two bodies are the world, ``second``, and a body that moves.

    It has hulls alone, so that containment is not tested. The caller sets what is required.
    """
    hulls = _HullList(_NO_HULLS)
    bodies = [[(part, hulls.add(part.hulls)) for part in parts] for parts in (first, second)]
    roots = np.array([hulls.add_solid(body) for body in bodies], dtype=np.int64)
    solids = [Solid("robot", 1, ()), Solid("obstacles", 0, ())]
    none = np.empty(0, dtype=np.int64)
    packed = _pack(solids, [], [], NO_SURFACE, none, [], hulls.join(), roots, none)
    return ArmScene(chain, packed, np.array([[0, 1]]), np.zeros(1), np.inf, np.inf)


def _add_parts(
    hulls: _HullList, parts: Sequence[Part], packed: PackedParts
) -> tuple[SurfaceTree, dict[Part, tuple[int, int]]]:
    """Add parts that are not packed yet; return all surfaces, and the roots of all parts."""
    others = [part for part in parts if part not in packed.roots]
    surfaces, surface_roots = box_trees.join_trees(_list_surfaces(others), packed.surfaces)
    added = (
        (hulls.add(part.hulls), root)
        for part, root in zip(others, surface_roots.tolist(), strict=True)
    )
    return surfaces, packed.roots | dict(zip(others, added, strict=True))


def make_inner_scene(scene: ArmScene, solids: Sequence[Solid]) -> ArmScene:
    """Make the inner scene, which proves BLOCKED, from the outer one.

    Distances must exceed ``2 DISTANCE_ROUNDING max_coordinate`` for the positions of points, and as
    much again for the rounding of :func:`cspace._support.vectors.triangle_distance`, which is below
    ``2^-38`` of the largest link or obstacle.
    """
    parts = [inner for solid in solids for _, inner in solid.bounds_pairs]
    trees = [part.tree for part in parts]
    surfaces, roots = box_trees.join_trees([part.surface_tree for part in parts], NO_SURFACE)
    probes = [part.probes for part in parts]
    outer = scene.solids
    hulls = outer.hulls, outer.roots, outer.part_roots
    packed = _pack(solids, parts, trees, surfaces, roots, probes, *hulls)
    required = 4.0 * DISTANCE_ROUNDING * scene.max_coordinate
    no_padding = np.zeros(len(scene.pairs))
    return ArmScene(scene.chain, packed, scene.pairs, no_padding, scene.max_coordinate, required)


def _pack(
    solids: Sequence[Solid],
    parts: Sequence[Part],
    trees: Sequence[PartTree],
    surfaces: SurfaceTree,
    surface_roots: Ints,
    points: Sequence[Floats],
    hulls: Hulls,
    roots: Ints,
    part_roots: Ints,
) -> Solids:
    """Pack solids for kernels, with a tree, a surface and points (n, 3) of each part.

    ``parts`` are the outer or the inner parts of all solids. Given are ``surfaces`` with the root
    of each part there, -1 for none, and ``hulls`` with the root of each solid and of each part
    there; see :class:`Solids`.
    """
    joined_trees, tree_roots = box_trees.join_trees(trees, NO_TREE)
    # Surfaces, points, parts, and parts of boxes or balls, before each part.
    counts = [
        (root >= 0, len(rows), 1, part.is_filled)
        for part, root, rows in zip(parts, surface_roots.tolist(), points, strict=True)
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
        surfaces=surfaces,
        surface_roots=surface_roots[surface_roots >= 0],
        anchors=np.concatenate([np.empty((0, 3)), *points]),
        has_solids=np.diff(filled_before) > 0,
        starts=np.stack(starts, axis=1),
    )


def _find_max_coordinate(chain: Chain, solids: Solids) -> float:
    """Bound all coordinates at any configuration, metres."""
    boxes = solids.hulls.boxes[solids.roots[solids.roots >= 0]]
    centers, half_sides = boxes[:, :3], boxes[:, 3:6]
    largest_in_body = (np.abs(centers) + half_sides).max(initial=0.0)
    return float(largest_in_body + chain.lengths.max())
