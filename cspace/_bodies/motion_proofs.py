"""Compiled proofs that the links of an arm touch neither obstacles nor each other during a motion.

A motion is halved recursively. At the midpoint of a part, each pair of solids is either far enough
apart for the whole part, or tested again in both halves; distant pairs are tested once (F.
Schwarzer, M. Saha and J.-C. Latombe, "Adaptive dynamic collision checking for single and multiple
articulated robots in complex environments", 2005). At first, longer parts come first, so that a
collision is found early, and in each part the pair that last was not proven.

Links and obstacles are trees of convex hulls, grown by radii (:mod:`cspace._bodies.hulls`). If
no boundaries meet, a connected part lies entirely inside or outside a closed surface, so a single
point of it decides, once for a whole motion. If hulls of whole parts are apart, this test is not
needed.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace._bodies import ADVANCE_FACTOR, DISTANCE_ROUNDING, MAX_DISTANCES_PER_EDGE, box_trees
from cspace._bodies.chain import (
    FIXED,
    FLOATING,
    POSITION,
    PRISMATIC,
    REVOLUTE,
    SPIN,
    VELOCITY,
    Chain,
    column_at,
    forward_kinematics,
    motion_bounds,
    relative_pose,
    rotation_columns,
    rotation_rows,
)
from cspace._bodies.cones import NO_CONES, Cones, stays_in_cones
from cspace._bodies.crossings import (
    AXIS_POINT,
    CHORD,
    DIRECTION,
    TRANSLATION,
    crosses,
    find_near_leaves,
    joint_displacement,
    pierces,
)
from cspace._bodies.hulls import BALL_RADIUS, Hulls, RelativeMotion, tree_slack
from cspace._bodies.part_trees import CENTER, HALF_SIDES, LEVER, RADIUS, PartTree, SurfaceTree
from cspace._support import vectors
from cspace._support.addresses import Address, call, find_address
from cspace._support.arrays import BLOCKED, FREE, MIXED, Bools, Floats, Ints, Row
from cspace._support.compiling import internal, kernel
from cspace._support.records import keep

TREE_ROUNDING: Final = 2.0**-40
"""Growth of boxes of a tree against rounding, relative to the size of the surface."""


MAX_BROAD_STEPS: Final = 32
"""Parts of a motion tested before the newest come first instead of the longest: a crossing of a
thin obstacle is short, and so is the way down to it."""


MAX_HALVINGS: Final = 44
"""Largest number of times that a motion is halved."""


MAX_MOTION_PARTS: Final = 2 * MAX_BROAD_STEPS + MAX_HALVINGS + 3
"""Largest number of rows of unproven parts: each broad step adds two, and each level below one."""


NO_MOTION: Final = (0.0, 0.0, math.inf, True)
"""Bounds of a pair that does not move."""


NO_DEVIATIONS: Final = np.empty(0)
"""Deviations of joints that follow a motion exactly."""


FIRST_SURFACE, FIRST_ANCHOR, FIRST_PART = range(3)
"""Columns of :attr:`Solids.starts`."""


DISPLACEMENT, CURVATURE, ROTATION = range(3)
"""Columns of :attr:`SceneScratch.bounds`."""


PIECE_STACK, SURFACE_STACK = range(2)
"""Columns of the scratch ``nodes`` that hold a stack of nodes: of a tree of pieces, of a surface.
"""


PAIR, FIRST_NODE, SECOND_NODE = range(3)
"""Columns of the nearest pair of each configuration: the pair, and a node of each of its solids."""


class Solids(NamedTuple):
    """Links and obstacles: their bodies, trees, closed surfaces and anchors.

    Attributes
    ----------
    bodies : ndarray of int64, shape (s,)
    hulls : Hulls
        Trees of all solids, each in the frame of its body.
    roots : ndarray of int64, shape (s,)
        Root of each solid, -1 if it is empty.
    part_roots : ndarray of int64, shape (k,)
        Root of each part in ``hulls``, solid by solid; -1 for none.
    levers : ndarray of float64, shape (s,)
        Reach of each solid from the origin of its body.
    trees : PartTree
        Triangles, boxes and balls that prove BLOCKED, each in the frame of its body.
    tree_roots : ndarray of int64, shape (k,)
        Root of each part in ``trees``; -1 for none.
    surfaces : SurfaceTree
        Trees of the closed surfaces, each in the frame of its body.
    surface_roots : ndarray of int64, shape (h,)
        Root of each surface.
    anchors : ndarray of float64, shape (m, 3)
        A point of each connected part.
    has_solids : ndarray of bool, shape (s,)
        True if the tree has boxes or balls, which are solid. Their levers are 1 if they could lie
        entirely inside others, else 0.
    starts : ndarray of int64, shape (s + 1, 3)
        First surface, first anchor and first part of each solid.
    """

    bodies: Ints
    hulls: Hulls
    roots: Ints
    part_roots: Ints
    levers: Floats
    trees: PartTree
    tree_roots: Ints
    surfaces: SurfaceTree
    surface_roots: Ints
    anchors: Floats
    has_solids: Bools
    starts: Ints

    def part_at(self, solid: int, node: int) -> int:
        """Return the part to which a node of a solid's hulls belongs; node -1 means the root."""
        first_part, stop_part = self.starts[solid : solid + 2, FIRST_PART].tolist()
        roots = self.part_roots[first_part:stop_part]
        wanted_node = node if node >= 0 else int(self.roots[solid])
        # The nodes of a part follow its root, so the last root up to the node decides the part.
        roots_before = np.where(roots <= wanted_node, roots, -1)
        return int(first_part + roots_before.argmax())


class ArmScene(NamedTuple):
    """An arm among obstacles.

    Attributes
    ----------
    chain : Chain
    solids : Solids
    pairs : ndarray of int64, shape (p, 2)
        Solids that may not touch; the body of the second is the world, or moves too.
    padding : ndarray of float64, shape (p,)
        Distance that each pair must keep in addition, metres.
    max_coordinate : float
        Largest coordinate at any configuration, metres.
    required : float
        Distance that proves a pair apart.
    cones : Cones
        Angles that links keep in addition.
    deviations : ndarray of float64, shape (dof,) or (0,)
        Deviations of the joints from a motion with which pairs stay apart, too.
    """

    chain: Chain
    solids: Solids
    pairs: Ints
    padding: Floats
    max_coordinate: float
    required: float
    cones: Cones = NO_CONES
    deviations: Floats = NO_DEVIATIONS

    def select_pairs(self, which: Ints | Bools | slice) -> ArmScene:
        """Return the scene with some of its pairs, and no cones."""
        padding = self.padding[which]
        return self._replace(pairs=self.pairs[which], padding=padding, cones=NO_CONES)


class SceneScratch(NamedTuple):
    """Scratch memory of one thread.

    Attributes
    ----------
    parts : ndarray of float64, shape (MAX_MOTION_PARTS, 2)
        Parts of a motion, tested in their order at first, later the last one first. The first row
        begins with the time of the last part tested, from 0 to 1, where a proof may have failed.
    open_pairs : ndarray of bool, shape (MAX_MOTION_PARTS, p)
        Unproven pairs of each part.
    poses : ndarray of float64, shape (b, 3, 6)
    bounds : ndarray of float64, shape (p, 3)
        Bounds of each pair along the whole motion: displacement, half the acceleration, rotation of
        the joints.
    not_nested : ndarray of bool, shape (p,)
        Pairs known not to contain each other.
    nearest_nodes : ndarray of int64, shape (p, 2)
        Nodes of each pair that last were not proven apart, -1 for none. They are tested early,
        because the same nodes often decide again.
    directions : ndarray of float64, shape (p, 3)
        Direction along which hulls of each pair were last farthest apart, zero at the start of a
        motion, so that no answer depends on an earlier motion. It is tried first, because it often
        proves the next part too.
    first_pair : ndarray of int64, shape (1,)
        Pair that last was not apart, which is tested first.
    axes : ndarray of float64, shape (b, 8)
        Joints that move a pair away from a motion; see
        :func:`cspace._bodies.crossings.joint_displacement`.
    nodes : ndarray of int64, shape (MAX_PENDING_PAIRS, 2)
    slopes : ndarray of float64, shape (dof,)
        Derivatives of an angle by the joints.
    """

    parts: Floats
    open_pairs: Bools
    poses: Floats
    bounds: Floats
    not_nested: Bools
    nearest_nodes: Ints
    directions: Floats
    first_pair: Ints
    axes: Floats
    nodes: Ints
    slopes: Floats


def make_scene_scratch(scene: ArmScene) -> SceneScratch:
    """Allocate scratch memory for one thread."""
    bodies = len(scene.chain.parents)
    pairs = len(scene.pairs)
    scratch = SceneScratch(
        parts=np.empty((MAX_MOTION_PARTS, 2)),
        open_pairs=np.empty((MAX_MOTION_PARTS, pairs), dtype=np.bool_),
        poses=np.empty((bodies, 3, 6)),
        bounds=np.empty((pairs, 3)),
        not_nested=np.empty(pairs, dtype=np.bool_),
        nearest_nodes=np.full((pairs, 2), -1),
        directions=np.zeros((pairs, 3)),
        first_pair=np.zeros(1, dtype=np.int64),
        axes=np.empty((bodies, 8)),
        nodes=np.empty((box_trees.MAX_PENDING_PAIRS, 2), dtype=np.int64),
        slopes=np.empty(len(scene.cones.lower)),
    )
    return keep(scratch)


def are_free(scene: ArmScene, firsts: Floats, lasts: Floats) -> Bools:
    """Return whether each motion is proven free.

    Motions lead from ``firsts`` to ``lasts``, shapes (n, dof). One thread computes the result,
    shape (n,).
    """
    out = np.empty(len(firsts), dtype=np.bool_)
    scratch = make_scene_scratch(scene)
    motions_are_free(find_proof(scene), keep(scene), firsts, lasts, out, scratch)
    return out


def find_proof(scene: ArmScene) -> Address:
    """Return the address of :func:`motion_is_free`, which compiles once for all of its callers."""
    q = np.zeros(0)
    return find_address(motion_is_free, keep(scene), q, q, make_scene_scratch(scene))


@kernel
def motions_are_free(
    prove: Address,
    scene: ArmScene,
    firsts: Floats,
    lasts: Floats,
    out: Bools,
    scratch: SceneScratch,
) -> None:
    """Fill ``out`` with whether motions, shapes (n, dof), are proven free.

    Equal endpoints mean a point. ``prove`` is :func:`find_proof`.
    """
    for k in range(len(firsts)):
        out[k] = call(prove, (scene, firsts[k], lasts[k], scratch))


@kernel
def count_free_motions(
    prove: Address,
    scene: ArmScene,
    starts: Floats,
    ends: Floats,
    paddings: Floats,
    tolerances: Floats,
    counts: Ints,
    scratch: SceneScratch,
) -> None:
    """Lower the counts to the numbers of motions that are proven free, from the first on.

    In each of b chunks, motions lead from a row of ``starts``, shape (b, dof), to each of ``ends``,
    shape (b, n, dof), in turn. Only as many as ``counts``, shape (b,), are tested. The chunk's
    ``paddings`` of the p pairs, shape (b, p), and ``tolerances`` of the c cones, shape (b, c), are
    written to the scene, which must be the thread's own.
    """
    for chunk in range(len(starts)):
        for pair in range(len(scene.padding)):
            scene.padding[pair] = paddings[chunk, pair]
        for cone in range(len(scene.cones.tolerances)):
            scene.cones.tolerances[cone] = tolerances[chunk, cone]
        wanted = counts[chunk]
        counts[chunk] = 0
        start = starts[chunk]
        for row in range(wanted):
            if not call(prove, (scene, start, ends[chunk, row], scratch)):
                break
            start = ends[chunk, row]
            counts[chunk] = row + 1


@internal
def find_required_distance(scene: ArmScene, q0: Floats, q1: Floats) -> float:
    """Return the distance that proves a pair apart on a motion from ``q0`` to ``q1``.

    It includes the rounding of joint values, shapes (dof,); metres.
    """
    chain = scene.chain
    slides = angles = 0.0
    for b in range(1, len(chain.parents)):
        index = chain.joint_indices[b]
        largest = abs(q0[index]) + abs(q1[index])
        value = abs(chain.factors[b]) * largest + abs(chain.offsets[b])
        if chain.kinds[b] == PRISMATIC:
            slides += value
        else:
            angles += value
        if chain.kinds[b] == FLOATING:
            for k in range(index + 1, index + 4):
                slides += abs(q0[k]) + abs(q1[k])
    # An angle is off by a few units in its last digit, far below 2^-9 of the allowance, and moves
    # a point by that angle times its distance from the axis.
    lever = 2.0**-9 * angles * scene.max_coordinate
    return scene.required + DISTANCE_ROUNDING * (2.0 * slides + lever)


@kernel
def motion_is_free(scene: ArmScene, q0: Floats, q1: Floats, scratch: SceneScratch) -> bool:
    """Return True if a motion from ``q0`` to ``q1``, shapes (dof,), is proven free.

    It must also stay in the cones. Equal endpoints mean a point. The motion is halved until all
    pairs are proven apart in each part, or one is not apart halfway through a part.
    """
    parts = scratch.parts
    open_pairs = scratch.open_pairs
    required = find_required_distance(scene, q0, q1)
    # NaN in a configuration makes it NaN, which proves nothing.
    if not required < np.inf:
        return False
    if not stays_in_cones(scene.chain, scene.cones, q0, q1, scratch.poses):
        return False
    bound_pairs(scene, q0, q1, scratch)
    for n in range(len(scene.pairs)):
        open_pairs[0, n] = True
    # Rows of unproven parts, from ``first`` up to ``count``, begin with the whole motion.
    parts[0, 0] = 0.0
    parts[0, 1] = 1.0
    first = 0
    count = 1
    for step in range(MAX_DISTANCES_PER_EDGE):
        if first == count:
            return True
        is_broad = step < MAX_BROAD_STEPS
        if is_broad:
            row = first
            first += 1
        else:
            count -= 1
            row = count
        start = parts[row, 0]
        stop = parts[row, 1]
        half = 0.5 * (stop - start)
        center = 0.5 * (start + stop)
        parts[0, 0] = center
        if half < 2.0**-MAX_HALVINGS:
            return False
        forward_kinematics(scene.chain, q0, q1, center, scratch.poses)
        state = test_part(scene, open_pairs[row], half, required, is_broad, scratch)
        if state == BLOCKED:
            return False
        if state == MIXED and step == 0:
            # Most colliding motions end in a collision, so the endpoint is tested next.
            for n in range(len(scene.pairs)):
                open_pairs[1, n] = open_pairs[0, n]
            forward_kinematics(scene.chain, q1, q1, 0.0, scratch.poses)
            if test_part(scene, open_pairs[1], 0.0, required, True, scratch) != FREE:
                parts[0, 0] = 1.0
                return False
        if state == MIXED:
            # Both halves are added, with the pairs that are still open.
            parts[count, 0] = center
            parts[count, 1] = stop
            parts[count + 1, 0] = start
            parts[count + 1, 1] = center
            for n in range(len(scene.pairs)):
                is_open = open_pairs[row, n]  # may be in the row ``count``
                open_pairs[count, n] = is_open
                open_pairs[count + 1, n] = is_open
            count += 2
    return False


@internal
def bound_pairs(scene: ArmScene, q0: Floats, q1: Floats, scratch: SceneScratch) -> None:
    """Write the bounds of all pairs on a motion."""
    solids = scene.solids
    for n in range(len(scene.pairs)):
        i, j = scene.pairs[n]
        displacement, curvature, rotation = motion_bounds(
            scene.chain, solids.bodies[i], solids.bodies[j], solids.levers[i], q0, q1
        )
        scratch.bounds[n, DISPLACEMENT] = displacement
        scratch.bounds[n, CURVATURE] = curvature
        scratch.bounds[n, ROTATION] = rotation
        scratch.not_nested[n] = False
        scratch.directions[n, :] = 0.0


@internal
def test_part(
    scene: ArmScene,
    is_open: Bools,
    half: float,
    required: float,
    seeks_contact: bool,
    scratch: SceneScratch,
) -> int:
    """Return FREE if all open pairs of a part of a motion are proven apart, and close them.

    ``is_open``, shape (p,), marks these pairs. The poses are those of the center of the part, which
    extends to ``half`` of the motion before and after. Returns BLOCKED if a pair is found not to be
    apart there, which ``seeks_contact`` asks for, else MIXED.
    """
    state = FREE
    first = scratch.first_pair[0]
    for k in range(len(scene.pairs)):
        n = (first + k) % len(scene.pairs)
        if not is_open[n]:
            continue
        displacement = half * scratch.bounds[n, DISPLACEMENT]
        curvature = half * scratch.bounds[n, CURVATURE]
        rotation = scratch.bounds[n, ROTATION]
        # The second term bounds the motion of the rounding, a small part of the whole motion.
        deviation = half * (curvature + required * rotation)
        bounds = (
            half / ADVANCE_FACTOR,
            deviation / ADVANCE_FACTOR,
            displacement / ADVANCE_FACTOR,
            seeks_contact,
        )
        i, j = scene.pairs[n]
        a, b = scene.solids.bodies[i], scene.solids.bodies[j]
        count = write_axes(scene.chain, a, b, scene.deviations, required, scratch)
        slack = bound_slack(scene, n, bounds, scratch.axes[:count], required, 0.0, scratch)
        is_open[n] = slack < 0.0
        if slack == -np.inf:
            scratch.first_pair[0] = n
            return BLOCKED
        if slack < 0.0:
            state = MIXED
        hulls_meet = scratch.nodes[1, 0] != 0  # as tree_slack says
        if hulls_meet and not scratch.not_nested[n]:
            # While no boundaries meet, containment cannot change, so it is tested once.
            if is_nested(scene, n, scratch, 0.0):
                return BLOCKED
            scratch.not_nested[n] = True
    return state


@internal
def write_axes(
    chain: Chain, a: int, b: int, deviations: Floats, required: float, scratch: SceneScratch
) -> int:
    """Write the axes about which deviations of joints move body a, as seen from body b.

    Each joint deviates by at most its entry of ``deviations``, shape (dof,); there are none if that
    has shape (0,). Returns the number of rows written to ``scratch.axes``. They are those of
    :func:`cspace._bodies.crossings.joint_displacement`, in the frame of b, and include the
    rounding of points, ``required``.
    """
    if len(deviations) == 0:
        return 0
    between = chain.between[a, b]
    base_pose = scratch.poses[b]
    base_rotation = rotation_rows(base_pose)
    count = 0
    for j in range(1, len(between)):
        travel = abs(chain.factors[j]) * deviations[chain.joint_indices[j]] / ADVANCE_FACTOR
        if not between[j] or travel == 0.0 or chain.kinds[j] == FIXED:
            continue
        # The axis passes through the origin of the joint's body.
        joint_pose = scratch.poses[j]
        world_axis = vectors.rotate(rotation_rows(joint_pose), vectors.row_at(chain.axes[j], 0))
        axis = vectors.rotate_back(base_rotation, world_axis)
        offset = vectors.minus(column_at(joint_pose, POSITION), column_at(base_pose, POSITION))
        origin = vectors.rotate_back(base_rotation, offset)
        row = scratch.axes[count]
        for k in range(3):
            row[DIRECTION + k] = axis[k]
            row[AXIS_POINT + k] = origin[k]
        if chain.kinds[j] == REVOLUTE:
            # A turn moves a point at distance 1 by the chord of its angle.
            chord = 2.0 * math.sin(0.5 * min(travel, math.pi)) / ADVANCE_FACTOR
            row[CHORD] = chord
            row[TRANSLATION] = chord * required
        else:
            row[CHORD] = 0.0
            row[TRANSLATION] = travel
        count += 1
    return count


@internal
def bound_slack(
    scene: ArmScene,
    n: int,
    bounds: tuple[float, float, float, bool],
    axes: Floats,
    required: float,
    enough: float,
    scratch: SceneScratch,
) -> float:
    """Bound (distance - required distance) of pair n from below, up to ``enough``.

    It is inf if one solid is empty; see :func:`cspace._bodies.hulls.tree_slack`. The pair's
    padding is required in addition. ``bounds`` are the time to either side, the largest deviation
    from the linear motion, the largest displacement, and whether to seek a contact. ``axes``, shape
    (k, 8), are those of joints that deviate.
    """
    solids = scene.solids
    half, deviation, displacement, seeks_contact = bounds
    i, j = scene.pairs[n]
    if solids.roots[i] < 0 or solids.roots[j] < 0:
        scratch.nodes[1, 0] = 0  # no hulls meet
        return np.inf
    # Describe the motion of solid i as seen from the body of solid j.
    pose = scratch.poses[solids.bodies[i]]
    base_pose = scratch.poses[solids.bodies[j]]
    box, base_box = solids.hulls.boxes[solids.roots[i]], solids.hulls.boxes[solids.roots[j]]
    required += scene.padding[n]
    # The balls around most pairs are far apart.
    if len(axes) == 0:
        offset = vectors.minus(center_of(pose, box), center_of(base_pose, base_box))
        radii = box[BALL_RADIUS] + base_box[BALL_RADIUS] + displacement + required
        if math.sqrt(vectors.dot(offset, offset)) - radii > enough:
            scratch.nodes[1, 0] = 0  # no hulls meet
            return enough
    to_base = rotation_columns(base_pose)
    matrix, position = relative_pose(pose, base_pose)
    spin = vectors.minus(column_at(pose, SPIN), column_at(base_pose, SPIN))
    velocity = vectors.minus(column_at(pose, VELOCITY), column_at(base_pose, VELOCITY))
    # Move the velocity from the point at the origin of the arm's base to the origin of body j.
    velocity_at_base = vectors.add_scaled(
        vectors.cross(spin, column_at(base_pose, POSITION)), velocity, 1.0
    )
    motion = RelativeMotion(
        matrix,
        position,
        vectors.rotate(to_base, spin),
        vectors.rotate(to_base, velocity_at_base),
        half,
        deviation,
        displacement,
        required,
        seeks_contact,
    )
    nodes = scratch.nodes
    nearest = scratch.nearest_nodes[n]
    nodes[0, 0] = nearest[0]
    nodes[0, 1] = nearest[1]
    direction = scratch.directions[n]
    slack = tree_slack(
        solids.hulls, solids.roots[i], solids.roots[j], motion, axes, enough, nodes, direction
    )
    nearest[0] = nodes[0, 0]
    nearest[1] = nodes[0, 1]
    return slack


@internal
def center_of(pose: Floats, box: Floats) -> Row:
    """Return the center of a box, a row of :attr:`Hulls.boxes`, on a body with a pose, (3, 6)."""
    center = vectors.row_at(box, CENTER)
    return vectors.apply_pose(rotation_rows(pose), column_at(pose, POSITION), center)


@internal
def is_nested(scene: ArmScene, n: int, scratch: SceneScratch, min_depth: float) -> bool:
    """Return True if one solid of pair n provably contains a part of the other.

    If no boundaries meet, a connected part lies entirely inside or outside a closed surface. So one
    point of each part decides, its anchor. The anchor must lie deeper than ``min_depth`` in the
    surface, in metres; 0 suffices if no boundaries meet.
    """
    i, j = scene.pairs[n]
    solids = scene.solids
    starts = solids.starts
    poses = scratch.poses
    nodes = scratch.nodes
    for inner, outer in ((i, j), (j, i)):
        # Solid k has the surfaces from starts[k, FIRST_SURFACE] up to those of solid k + 1, and its
        # anchors likewise. Anchors are moved into the frame of the surfaces.
        matrix, shift = relative_pose(poses[solids.bodies[inner]], poses[solids.bodies[outer]])
        for surface in range(starts[outer, FIRST_SURFACE], starts[outer + 1, FIRST_SURFACE]):
            root = solids.surface_roots[surface]
            for anchor in range(starts[inner, FIRST_ANCHOR], starts[inner + 1, FIRST_ANCHOR]):
                point = vectors.apply_pose(matrix, shift, vectors.row_at(solids.anchors[anchor], 0))
                if lies_deep(solids.surfaces, root, point, min_depth, nodes):
                    return True
    # Boxes and balls have no anchors; only the second solid of a pair may have them.
    return bool(solids.has_solids[j] and piece_lies_in(solids, j, i, poses, nodes, min_depth))


@internal
def piece_lies_in(
    solids: Solids, i: int, j: int, poses: Floats, nodes: Ints, min_depth: float
) -> bool:
    """Return True if a box or ball of solid i lies in a closed surface of solid j.

    Its center must lie deeper than ``min_depth``. Skips pieces too large to lie inside. ``poses``,
    shape (b, 3, 6), are those of all bodies; ``nodes`` is scratch, shape (MAX_PENDING_PAIRS, 2).
    """
    trees = solids.trees
    starts = solids.starts
    pose = poses[solids.bodies[i]]
    outer_pose = poses[solids.bodies[j]]
    matrix, shift = relative_pose(pose, outer_pose)
    back, shift_back = relative_pose(outer_pose, pose)
    for surface in range(starts[j, FIRST_SURFACE], starts[j + 1, FIRST_SURFACE]):
        root = solids.surface_roots[surface]
        surface_box = solids.surfaces.boxes[root]
        # Search the tree for pieces near the box of the surface, in the frame of solid i.
        center = vectors.apply_pose(back, shift_back, vectors.row_at(surface_box, CENTER))
        extent = vectors.box_extent(back, vectors.row_at(surface_box, HALF_SIDES))
        for part in range(starts[i, FIRST_PART], starts[i + 1, FIRST_PART]):
            nodes[1, PIECE_STACK] = solids.tree_roots[part]
            top, row = find_near_piece(trees, center, extent, True, nodes, 2)
            while row >= 0:
                # The row of a box or ball begins with its center.
                point = vectors.apply_pose(matrix, shift, vectors.row_at(trees.triangles[row], 0))
                if lies_deep(solids.surfaces, root, point, min_depth, nodes):
                    return True
                top, row = find_near_piece(trees, center, extent, True, nodes, top)
    return False


@internal
def find_near_piece(
    trees: PartTree, center: Row, extent: Row, only_inner: bool, nodes: Ints, top: int
) -> tuple[int, int]:
    """Return the row of the next piece near a box, or -1, after the new top of the stack.

    Rows of the stack, a column of ``nodes``, are filled from 1 to ``top - 1``; at first, row 1 has
    the root of a part, which is negative if the part is empty. With ``only_inner``, pieces too
    large to lie inside a surface are skipped; see :attr:`Solids.has_solids`.
    """
    while top > 1:
        top -= 1
        node = nodes[top, PIECE_STACK]
        if node < 0:
            continue
        box = trees.boxes[node]
        if only_inner and box[LEVER] == 0.0:
            continue
        offset = vectors.minus(center, vectors.row_at(box, CENTER))
        if vectors.boxes_are_apart(offset, extent, vectors.row_at(box, HALF_SIDES)):
            continue
        row, count = trees.spans[node]
        if count == 1:
            return top, row
        top = push_children(nodes, PIECE_STACK, top, node, count)
    return top, -1


@internal
def push_children(nodes: Ints, column: int, top: int, node: int, count: int) -> int:
    """Push the two children of a tree's node onto a stack; return its new top.

    The stack is a column of ``nodes``. The node has ``count`` leaves; its first child follows it,
    and the second child follows the nodes of the first.
    """
    nodes[top, column] = node + 1
    nodes[top + 1, column] = node + 2 * (count // 2)
    return top + 2


@internal
def lies_deep(surfaces: SurfaceTree, root: int, point: Row, min_depth: float, nodes: Ints) -> bool:
    """Return True if a point is deeper than ``min_depth`` in a closed surface.

    A negative ``min_depth`` allows a point outside, nearer to the surface than that. Zero asks for
    the winding number alone. ``nodes`` is scratch, shape (MAX_PENDING_PAIRS, 2).
    """
    limit = abs(min_depth)
    if min_depth < 0.0:
        _, far = bound_point_distance(surfaces, root, point, limit, limit, nodes)
        if far < limit:
            return True
    if winding_number(surfaces, root, point, nodes) == 0:
        return False
    if min_depth <= 0.0:
        return True
    near, _ = bound_point_distance(surfaces, root, point, limit, limit, nodes)
    return near >= limit


@kernel
def winding_number(surfaces: SurfaceTree, root: int, point: Row, nodes: Ints) -> int:
    """Count how often a closed surface winds around a point.

    It counts the signed crossings of an upward ray. The second column of ``nodes`` is scratch,
    shape (MAX_PENDING_PAIRS, 2).
    """
    x, y, z = point
    half_x, half_y, half_z = vectors.row_at(surfaces.boxes[root], HALF_SIDES)
    winding = 0
    rounding = TREE_ROUNDING * (half_x + half_y + half_z)
    # Rows of the stack from 1 to top - 1 are filled.
    nodes[1, SURFACE_STACK] = root
    top = 2
    while top > 1:
        top -= 1
        node = nodes[top, SURFACE_STACK]
        node_box = surfaces.boxes[node]
        start, count = surfaces.spans[node]
        center_x, center_y, center_z = vectors.row_at(node_box, CENTER)
        # The ray crosses no triangle beside it or below its start.
        offset = x - center_x, y - center_y, max(z - center_z, 0.0)
        if vectors.boxes_are_apart(
            offset, (rounding, rounding, rounding), vectors.row_at(node_box, HALF_SIDES)
        ):
            continue
        if count > 1:
            top = push_children(nodes, SURFACE_STACK, top, node, count)
        else:
            crossing = vectors.signed_crossing(surfaces.triangles[start], x, y, z)
            winding += crossing * surfaces.windings[start]
    return winding


@kernel
def bound_point_distance(
    surfaces: SurfaceTree, root: int, point: Row, cap: float, enough: float, nodes: Ints
) -> tuple[float, float]:
    """Bound a point's distance from the triangles of a tree from below and above, to ``cap``.

    The search ends at a triangle nearer than ``enough``, or at the nearest one. The second column
    of ``nodes`` is scratch, shape (MAX_PENDING_PAIRS, 2).
    """
    near = far = cap
    # Rows of the stack from 1 to top - 1 are filled.
    nodes[1, SURFACE_STACK] = root
    top = 2
    while top > 1:
        top -= 1
        node = nodes[top, SURFACE_STACK]
        # The larger bound covers the rounding of boxes and distances.
        if vectors.box_distance(surfaces.boxes[node], point) > far * (1.0 + TREE_ROUNDING):
            continue
        start, count = surfaces.spans[node]
        # Triangles of a node that are measured at once, because further boxes would take longer.
        if count <= 6:
            for k in range(start, start + count):
                nearer, farther = vectors.bound_triangle_distance(point, surfaces.triangles[k])
                near = min(near, nearer)
                far = min(far, farther)
            if far < enough:
                break
            continue
        lower = top
        upper = top + 1
        top = push_children(nodes, SURFACE_STACK, top, node, count)
        # The nearer child lies on top of the stack, so that it is searched first.
        first_child = nodes[lower, SURFACE_STACK]
        second_child = nodes[upper, SURFACE_STACK]
        first_distance = vectors.box_distance(surfaces.boxes[first_child], point)
        if first_distance < vectors.box_distance(surfaces.boxes[second_child], point):
            nodes[lower, SURFACE_STACK] = second_child
            nodes[upper, SURFACE_STACK] = first_child
    return near, far


@internal
def boundaries_cross(
    scene: ArmScene, n: int, axes: Floats, required: float, scratch: SceneScratch
) -> bool:
    """Return True if in pair n, the first boundary provably crosses the second solid.

    It crosses a triangle, or enters a box or ball. ``required`` must be at least four times the
    rounding of a point. With ``axes``, shape (k, 8), the proof holds in a whole box of
    configurations; see :func:`cspace._bodies.crossings.joint_displacement`.
    """
    solids = scene.solids
    starts = solids.starts
    i, j = scene.pairs[n]
    # The search takes longer if each step reads where the arrays lie.
    trees = PartTree(solids.trees.boxes, solids.trees.spans, solids.trees.triangles)
    matrix, shift = relative_pose(scratch.poses[solids.bodies[i]], scratch.poses[solids.bodies[j]])
    for part in range(starts[i, FIRST_PART], starts[i + 1, FIRST_PART]):
        for other_part in range(starts[j, FIRST_PART], starts[j + 1, FIRST_PART]):
            root = solids.tree_roots[part]
            other_root = solids.tree_roots[other_part]
            # A part without a boundary has no tree.
            if root < 0 or other_root < 0:
                continue
            scratch.nodes[1, 0] = root
            scratch.nodes[1, 1] = other_root
            if parts_cross(trees, matrix, shift, axes, required, scratch.nodes):
                return True
    return False


@internal
def parts_cross(
    trees: PartTree, matrix: vectors.Matrix, shift: Row, axes: Floats, required: float, nodes: Ints
) -> bool:
    """Return True if the boundary of one part provably crosses another part.

    Row 1 of ``nodes``, shape (MAX_PENDING_PAIRS, 2), has the roots of their trees. The pose of the
    first part, ``matrix`` and ``shift``, and the ``axes``, shape (k, 8), are as seen from the
    second. With axes, the proof must hold while the joints move the first part.
    """
    displacement = 0.0
    # The search returns the row of two leaves whose boxes meet, or 0 at its end.
    top = find_near_leaves(trees, matrix, shift, axes, nodes, 2)
    while top > 0:
        leaf = nodes[top, 0]
        other_leaf = nodes[top, 1]
        piece = trees.triangles[trees.spans[leaf, box_trees.FIRST_ITEM]]
        other = trees.triangles[trees.spans[other_leaf, box_trees.FIRST_ITEM]]
        top = find_near_leaves(trees, matrix, shift, axes, nodes, top)
        if len(axes) > 0:
            half = vectors.row_at(trees.boxes[leaf], HALF_SIDES)
            center = vectors.apply_pose(matrix, shift, vectors.row_at(trees.boxes[leaf], CENTER))
            displacement = joint_displacement(axes, center, math.sqrt(vectors.dot(half, half)))
        # A row begins with three corners; its radius is not zero for balls and boxes.
        corners = (
            vectors.apply_pose(matrix, shift, vectors.row_at(piece, 0)),
            vectors.apply_pose(matrix, shift, vectors.row_at(piece, 3)),
            vectors.apply_pose(matrix, shift, vectors.row_at(piece, 6)),
        )
        is_solid = other[RADIUS] != 0.0
        if is_solid and pierces(corners, other, required + displacement):
            return True
        if not is_solid and piece[RADIUS] == 0.0:
            other_corners = (
                vectors.row_at(other, 0),
                vectors.row_at(other, 3),
                vectors.row_at(other, 6),
            )
            if crosses(corners, other_corners, required, displacement):
                return True
    return False


@kernel
def bound_distances(
    scene: ArmScene, points: Floats, out: Floats, nearest: Ints, scratch: SceneScratch
) -> None:
    """Write lower bounds of the smallest distance of any pair at configurations, shape (n, dof).

    The bounds ``out``, shape (n,), are beyond the required distance of the scene, padding included.
    Negative values prove nothing. ``nearest``, shape (n, 3), receives the pair and the two nodes
    that set each bound.
    """
    nodes = scratch.nodes
    for k in range(len(points)):
        required = find_required_distance(scene, points[k], points[k])
        forward_kinematics(scene.chain, points[k], points[k], 0.0, scratch.poses)
        out[k] = np.inf
        for n in range(len(scene.pairs)):
            # The bound may not depend on earlier queries.
            scratch.nearest_nodes[n, 0] = -1
            scratch.directions[n, :] = 0.0
            # A pair that is too near counts, even beside a nearer pair with less padding.
            enough = out[k] if out[k] < 0.0 else max(out[k] - scene.padding[n], 0.0)
            slack = bound_slack(scene, n, NO_MOTION, scratch.axes[:0], required, enough, scratch)
            hulls_meet = nodes[1, 0] != 0  # as tree_slack says
            if slack >= 0.0 and hulls_meet and is_nested(scene, n, scratch, 0.0):
                slack = -1.0
            # Compare without the padding: (out - padding) + padding may round to less than out.
            if slack < enough:
                out[k] = slack
                if slack >= 0.0:
                    out[k] += scene.padding[n]
                nearest[k, PAIR] = n
                nearest[k, FIRST_NODE] = nodes[0, 0]
                nearest[k, SECOND_NODE] = nodes[0, 1]


@kernel
def are_blocked(scene: ArmScene, points: Floats, out: Bools, scratch: SceneScratch) -> None:
    """Write whether configurations, shape (n, dof), are proven BLOCKED, beyond rounding.

    The proof is a pair whose boundaries cross, or a pair in which one shape encloses a point of the
    other. ``out`` has shape (n,).
    """
    no_axes = scratch.axes[:0]
    for k in range(len(points)):
        required = find_required_distance(scene, points[k], points[k])
        forward_kinematics(scene.chain, points[k], points[k], 0.0, scratch.poses)
        out[k] = False
        first = scratch.first_pair[0]
        for offset in range(len(scene.pairs)):
            n = (first + offset) % len(scene.pairs)
            # Solids with separate hulls do not cross, and they have far fewer hulls than triangles.
            slack = bound_slack(scene, n, NO_MOTION, no_axes, required, 0.0, scratch)
            hulls_meet = scratch.nodes[1, 0] != 0  # as tree_slack says
            scratch.not_nested[n] = slack >= 0.0 and not hulls_meet
            out[k] = slack < 0.0 and boundaries_cross(scene, n, no_axes, required, scratch)
            if out[k]:
                scratch.first_pair[0] = n
                break
        # Containment comes last, because most collisions are crossings.
        for n in range(len(scene.pairs)):
            if not (out[k] or scratch.not_nested[n]):
                out[k] = is_nested(scene, n, scratch, required)
