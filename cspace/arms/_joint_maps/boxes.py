"""Proofs about boxes of configurations, in which each joint varies within an interval.

*FREE.* A box is a tube: the motion of one joint through its interval, from which the other joints
deviate by at most half of theirs; see :func:`cspace._bodies.motion_proofs.motion_is_free`.

*BLOCKED.* A ball inside one solid moves by at most :func:`joint_displacement`. If the ball is
shrunk by the bound, the remaining ball, where it is, lies in the solid at every configuration of
the box. If the other solid meets the remaining ball, both collide in the whole box. If nothing
remains, the center of the ball must lie in the other solid deeper than the missing radius.

*Blocks.* All cells are tested together first. A block that is not proven is halved along the joint
that moves the arm farthest, down to single cells, which are then MIXED unless all their parts are
proven. So the work grows with the boundary of the C-obstacle, not with the number of cells.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from cspace import BLOCKED, FREE, MIXED, Grid
from cspace.arms._inner_balls import InnerBalls
from cspace.arms._snapshots import Snapshot
from cspace.inside import (
    CENTER,
    FIRST_PART,
    FIRST_SURFACE,
    HALF_SIDES,
    NO_MOTION,
    PIECE_STACK,
    SLACK,
    Address,
    ArmScene,
    Bools,
    Floats,
    Ints,
    Row,
    SceneScratch,
    Solids,
    States,
    bound_slack,
    boundaries_cross,
    call,
    find_near_piece,
    find_required_distance,
    forward_kinematics,
    internal,
    joint_displacement,
    keep,
    kernel,
    lies_deep,
    make_scene_scratch,
    piece_depth,
    relative_pose,
    vectors,
    write_axes,
)


@dataclass(frozen=True, eq=False)
class CellProofs:
    """Proofs of blocks of map cells, as configurations of an arm.

    Attributes
    ----------
    snapshot : Snapshot
    inner : ArmScene
        That of the snapshot, which proves BLOCKED.
    balls : InnerBalls
        Those of its inner shapes.
    grid : Grid
    joint_indices : ndarray of int64, shape (d,)
        Index of the joint of each axis.
    held : ndarray of float64, shape (dof,)
        Values of the other joints.
    """

    snapshot: Snapshot
    inner: ArmScene
    balls: InnerBalls
    grid: Grid
    joint_indices: Ints
    held: Floats

    @cached_property
    def levers(self) -> Floats:
        """How far a unit of each axis may move a pair of solids, shape (d,)."""
        moves = self.snapshot.bound_displacements(np.eye(len(self.held)))
        return np.asarray(moves.max(axis=1, initial=0.0)[self.joint_indices])

    def select_pairs(self, which: Bools | slice) -> CellProofs:
        """Return the proofs of some pairs of solids."""
        scenes = self.snapshot.outer, self.inner
        outer, inner = (keep(scene.select_pairs(which)) for scene in scenes)
        return replace(self, snapshot=replace(self.snapshot, outer=outer), inner=inner)

    def find_tubes(
        self, starts: Floats | Ints, stops: Floats | Ints
    ) -> tuple[Floats, Floats, Floats]:
        """Return tubes that fill blocks of cells: both ends, and deviations, shapes (n, dof).

        The blocks reach from ``starts`` to ``stops``, shapes (n, d), in cells. The joint that moves
        the arm farthest moves along a tube. The tubes include the rounding of queries.
        """
        sides = stops - starts
        spacing = self.grid.spacing
        centers = np.tile(self.held, (len(starts), 1))
        halves = np.zeros_like(centers)
        centers[:, self.joint_indices] = self.grid.lower + 0.5 * spacing * (starts + stops)
        halves[:, self.joint_indices] = spacing * (0.5 * sides + SLACK)
        farthest = self.joint_indices[(self.levers * sides).argmax(axis=1)]
        along = np.where(farthest[:, np.newaxis] == np.arange(len(self.held)), halves, 0.0)
        return centers - along, centers + along, halves - along

    def find_states(
        self,
        starts: Floats | Ints,
        stops: Floats | Ints,
        with_crossings: bool,
        scratch: SceneScratch,
    ) -> States:
        """Return the states of blocks of cells as a whole, shape (n,), MIXED if unproven.

        They reach from ``starts`` to ``stops``, shapes (n, d), in cells. Triangles that cross are
        sought only ``with_crossings``.
        """
        states = np.empty(len(starts), dtype=np.uint8)
        tubes = self.find_tubes(starts, stops)
        # The thread's own scene, to which the kernel writes.
        outer = keep(self.snapshot.outer._replace(deviations=np.empty(len(self.held))))
        prove = self.snapshot.proof
        classify_tubes(
            prove, outer, self.inner, self.balls, *tubes, with_crossings, states, scratch
        )
        return states

    def classify(self, start: Ints, stop: Ints, parts: Ints, out: States) -> None:
        """Write the states of the cells of a block, which reaches from ``start`` to ``stop``.

        A cell may still be proven by its parts, ``parts`` along each axis, all
        of shape (d,).
        """
        scratch = make_scene_scratch(self.snapshot.outer)
        starts, stops = start[np.newaxis], stop[np.newaxis]
        mixed = [starts[:0]]
        while len(starts):
            states = self.find_states(starts, stops, False, scratch)
            for state, first, last in zip(states.tolist(), starts, stops, strict=True):
                out[tuple(map(slice, first, last))] = state
            sides = stops - starts
            is_open = states == MIXED
            is_cell = (sides == 1).all(axis=1)
            mixed.append(starts[is_open & is_cell])
            # Halve the others across the axis along which they move the arm farthest.
            halved = is_open & ~is_cell
            cuts = np.where(sides > 1, self.levers * sides, -1.0)[halved].argmax(axis=1)
            starts, stops = starts[halved], stops[halved]
            is_cut = cuts[:, np.newaxis] == np.arange(len(start))
            middles = (starts + stops) // 2
            starts, stops = (
                np.concatenate([starts, np.where(is_cut, middles, starts)]),
                np.concatenate([np.where(is_cut, middles, stops), stops]),
            )
        self._refine(np.concatenate(mixed), parts, out, scratch)

    def _refine(self, cells: Ints, parts: Ints, out: States, scratch: SceneScratch) -> None:
        """Write the states of MIXED cells, shape (n, d), all of whose parts have one state."""
        states: States | None = None
        for part in product(*map(range, parts.tolist())) if parts.max() > 1 else ():
            starts = cells + part / parts
            found = self.find_states(starts, starts + 1.0 / parts, True, scratch)
            is_kept = (found != MIXED) & (found == (found if states is None else states))
            cells, states = cells[is_kept], found[is_kept]
        if states is not None:
            out[tuple(cells.T)] = states


@kernel
def classify_tubes(
    prove: Address,
    scene: ArmScene,
    inner: ArmScene,
    balls: InnerBalls,
    firsts: Floats,
    lasts: Floats,
    deviations: Floats,
    with_crossings: bool,
    out: States,
    scratch: SceneScratch,
) -> None:
    """Write the states of tubes as a whole, shape (n,), MIXED if unproven.

    A tube leads from a row of ``firsts`` to a row of ``lasts``, and has a row of ``deviations``,
    shapes (n, dof). Triangles that cross are sought only ``with_crossings``: only small tubes leave
    them crossed, and the search is slow. ``prove`` belongs to ``scene``, and proves FREE.
    """
    for k in range(len(firsts)):
        for joint in range(len(scene.deviations)):
            scene.deviations[joint] = deviations[k, joint]
        if call(prove, (scene, firsts[k], lasts[k], scratch)):
            out[k] = FREE
            continue
        out[k] = MIXED
        required = find_required_distance(inner, firsts[k], lasts[k])
        forward_kinematics(inner.chain, firsts[k], lasts[k], 0.5, scratch.poses)
        # From now on, all joints move away from the center of the tube.
        for joint in range(firsts.shape[1]):
            deviations[k, joint] += 0.5 * (lasts[k, joint] - firsts[k, joint])
        for pair in range(len(inner.pairs)):
            # Solids with separate hulls do not collide.
            scratch.directions[pair, :] = 0.0  # the state may not depend on earlier tubes
            no_axes = scratch.axes[:0]
            slack = bound_slack(inner, pair, NO_MOTION, no_axes, required, 0.0, scratch)
            if slack < 0.0 and pair_is_blocked(
                inner, balls, pair, deviations[k], with_crossings, required, scratch
            ):
                out[k] = BLOCKED
                break


@internal
def pair_is_blocked(
    scene: ArmScene,
    balls: InnerBalls,
    pair: int,
    deviations: Floats,
    with_crossings: bool,
    required: float,
    scratch: SceneScratch,
) -> bool:
    """Return True if a pair provably collides with any ``deviations`` of the joints, shape (dof,).

    The poses of ``scratch`` are those without deviation; see :func:`classify_tubes`.
    """
    i, j = scene.pairs[pair]
    a, b = scene.solids.bodies[i], scene.solids.bodies[j]
    # First a ball in solid j, as seen from solid i, then one in solid i.
    count = write_axes(scene.chain, b, a, deviations, required, scratch)
    if ball_collides(scene, balls, j, i, scratch.axes[:count], required, scratch):
        return True
    count = write_axes(scene.chain, a, b, deviations, required, scratch)
    axes = scratch.axes[:count]
    return ball_collides(scene, balls, i, j, axes, required, scratch) or (
        with_crossings and boundaries_cross(scene, pair, axes, required, scratch)
    )


@internal
def ball_collides(
    scene: ArmScene,
    balls: InnerBalls,
    i: int,
    j: int,
    axes: Floats,
    required: float,
    scratch: SceneScratch,
) -> bool:
    """Return True if a ball in solid i provably meets solid j.

    The proof holds in a whole box of configurations, in which ``axes``, shape (k, 8), move solid i
    as seen from solid j.
    """
    solids = scene.solids
    starts = solids.starts
    matrix, shift = relative_pose(scratch.poses[solids.bodies[i]], scratch.poses[solids.bodies[j]])
    for n in range(balls.starts[i], balls.starts[i + 1]):
        point = vectors.apply_pose(matrix, shift, vectors.row_at(balls.centers[n], 0))
        displacement = joint_displacement(axes, point, 0.0) + required
        # A ball of this radius stays in solid i; if negative, the center must lie that deep in j.
        rest = balls.radii[n] - displacement
        if solids.has_solids[j] and reaches_piece(solids, j, point, rest, scratch):
            return True
        for surface in range(starts[j, FIRST_SURFACE], starts[j + 1, FIRST_SURFACE]):
            root = solids.surface_roots[surface]
            surface_box = solids.surfaces.boxes[root]
            offset = vectors.minus(point, vectors.row_at(surface_box, CENTER))
            # A point is no deeper in a surface than in its box, which decides for most balls.
            if vectors.boxes_are_apart(
                offset, (rest, rest, rest), vectors.row_at(surface_box, HALF_SIDES)
            ):
                continue
            if lies_deep(solids.surfaces, root, point, -rest, scratch.nodes):
                return True
    return False


@internal
def reaches_piece(solids: Solids, j: int, point: Row, rest: float, scratch: SceneScratch) -> bool:
    """Return True if a point is within ``rest`` of solid j's piece.

    A negative ``rest`` requires that the point lies deeper than that in the box or ball.
    """
    trees = solids.trees
    starts = solids.starts
    nodes = scratch.nodes
    reach = max(rest, 0.0)
    extent = reach, reach, reach
    for part in range(starts[j, FIRST_PART], starts[j + 1, FIRST_PART]):
        nodes[1, PIECE_STACK] = solids.tree_roots[part]
        top, row = find_near_piece(trees, point, extent, False, nodes, 2)
        while row >= 0:
            if piece_depth(trees.triangles[row], point) + rest > 0.0:
                return True
            top, row = find_near_piece(trees, point, extent, False, nodes, top)
    return False
