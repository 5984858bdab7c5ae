"""Rigid robots in space as bodies that slide and turn, among obstacles.

The robot hangs on one floating joint. Before each arc, the rotation at its start becomes the frame
of that joint, and the axis of the arc the joint's axis; so an arc is a straight motion of an angle
and a position (:mod:`cspace._bodies.chain`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cspace._bodies import DISTANCE_ROUNDING, MIN_ADVANCE
from cspace._bodies.chain import forward_kinematics, make_floating_chain
from cspace._bodies.motion_proofs import (
    NO_MOTION,
    ArmScene,
    SceneScratch,
    bound_slack,
    find_required_distance,
    make_scene_scratch,
)
from cspace._bodies.parts import as_triangles
from cspace._bodies.scenes import make_hull_scene
from cspace._bodies.solids import Part, StaticShape
from cspace._exact.arcs import (
    MAX_PENDING_PARTS,
    EdgeArc,
    arc_state,
    cells_are_free,
    reference_point,
)
from cspace._queries.edges import position_along
from cspace._record.cells import Map
from cspace._rotations.lookup import arc_axis, matrix_rows
from cspace._shapes import ExactShape, RoundedSimplices
from cspace._support.addresses import Address, call
from cspace._support.arrays import FREE, Floats, Ints
from cspace._support.compiling import internal, kernel
from cspace._support.records import keep


class Bodies(NamedTuple):
    """Robot and obstacles as trees of hulls.

    Attributes
    ----------
    scene : ArmScene
        It requires the rounding of points, and the padding of its pair what else is required.
    max_lever : float
        As in :class:`cspace._exact.plane.BoundaryTrees`.
    scale : float
        Factor from metres to the scene's lengths, 1.
    required : float
        Distance that proves a configuration free, metres.
    """

    scene: ArmScene
    max_lever: float
    scale: float
    required: float


class RigidScratch(NamedTuple):
    """Scratch memory of one thread.

    Attributes
    ----------
    scene : ArmScene
        The thread's own, because each arc writes the frame and the axis of its joint there, and
        the padding.
    memory : SceneScratch
    ends : ndarray of float64, shape (2, 4)
        Both ends of a motion: angle and position.
    parts : ndarray of float64, shape (MAX_PENDING_PARTS, 2)
        Stack of unproven parts: where each begins and ends, from 0 to 1.
    """

    scene: ArmScene
    memory: SceneScratch
    ends: Floats
    parts: Floats


@dataclass(frozen=True, eq=False)
class BoundaryPart(Part):
    """A part with the boundary that is left of a shape.

    Attributes
    ----------
    pieces : RoundedSimplices
    """

    pieces: RoundedSimplices

    @cached_property
    def boundary(self) -> RoundedSimplices:
        """The pieces as triangles."""
        return as_triangles([self.pieces])

    @cached_property
    def surface(self) -> tuple[Floats, Ints]:
        """No triangles, because pieces may enclose nothing."""
        return np.empty((0, 3, 3)), np.empty(0, dtype=np.int64)


def make_part(shape: ExactShape, pieces: RoundedSimplices, is_whole: bool) -> Part:
    """Make the part of an obstacle, whose boundary is whole or clipped to ``pieces``."""
    if is_whole:
        return StaticShape(shape, np.eye(4), 0.0)
    return BoundaryPart(shape, np.eye(4), pieces)


def make_bodies(
    robot: Part,
    obstacles: Sequence[Part],
    max_coordinate: float,
    max_lever: float,
    required: float,
) -> Bodies:
    """Make the scene of a robot among obstacles."""
    scene = make_hull_scene(make_floating_chain(), [robot], obstacles)
    rounding = DISTANCE_ROUNDING * max_coordinate  # which ``required`` includes
    scene = scene._replace(max_coordinate=max_coordinate, required=rounding)
    return Bodies(scene, max_lever, 1.0, required)


def make_rigid_scratch(bodies: Bodies) -> RigidScratch:
    """Allocate scratch memory for one thread."""
    scene = bodies.scene
    chain = scene.chain._replace(frames=scene.chain.frames.copy(), axes=scene.chain.axes.copy())
    scratch = RigidScratch(
        scene=scene._replace(chain=chain, padding=np.empty(1)),
        memory=make_scene_scratch(scene),
        ends=np.zeros((2, 4)),
        parts=np.empty((MAX_PENDING_PARTS, 2)),
    )
    return keep(scratch)


@internal
def rigid_arc_is_free(map_: Map, prove: Address, arc: EdgeArc, scratch: RigidScratch) -> bool:
    """Return True if an arc is proven free.

    If the bodies are not proven apart at a place in a FREE cell, cells may prove some parts and
    the bodies the others. ``prove`` is :func:`cspace._bodies.motion_proofs.find_proof`.
    """
    scene = scratch.scene
    axis = arc_axis(arc.r0, arc.r1, arc.number)
    rows = matrix_rows(arc.r0)
    for i in range(3):
        scene.chain.axes[1, i] = axis[i]
        for j in range(3):
            scene.chain.frames[1, i, j] = rows[i][j]
    scene.padding[0] = arc.required - scene.required
    parts = scratch.parts
    parts[0, 0] = 0.0
    parts[0, 1] = 1.0
    pending = 1
    is_whole = True
    while pending > 0:
        pending -= 1
        first = parts[pending, 0]
        last = parts[pending, 1]
        if not is_whole and cells_are_free(map_, arc, first, last):
            continue
        for end in range(2):
            t = last if end else first
            position = reference_point(map_, position_along(arc.p0, arc.p1, t), 1.0)
            scratch.ends[end, 0] = t * arc.angle
            for i in range(3):
                scratch.ends[end, 1 + i] = position[i]
        if call(prove, (scene, scratch.ends[0], scratch.ends[1], scratch.memory)):
            continue
        failed = first + scratch.memory.parts[0, 0] * (last - first)
        is_short = last - first < MIN_ADVANCE
        if is_short or arc.angle_error > 0.0 or arc_state(map_, arc, failed) != FREE:
            return False
        is_whole = False
        center = 0.5 * (first + last)
        parts[pending, 0] = center
        parts[pending, 1] = last
        parts[pending + 1, 0] = first
        parts[pending + 1, 1] = center
        pending += 2
    return True


@kernel
def rigid_slack(
    required: float, positions: Floats, matrices: Floats, spans: Floats, scratch: RigidScratch
) -> float:
    """Return a lower bound of (distance - required distance) along a path.

    As :func:`cspace._exact.plane.path_slack`, in metres. The first row of the scratch ``nodes``
    becomes the pair of nodes that set the last bound, -1 for none.
    """
    memory = scratch.memory
    scene = scratch.scene
    scene.padding[0] = required - scene.required
    ends = scratch.ends[0]
    best = math.inf
    ends[0] = 0.0
    memory.nearest_nodes[0, 0] = -1
    for k in range(len(positions)):
        for i in range(3):
            ends[1 + i] = positions[k, i]
            for j in range(3):
                scene.chain.frames[1, i, j] = matrices[k, i, j]
        forward_kinematics(scene.chain, ends, ends, 0.0, memory.poses)
        rounding = find_required_distance(scene, ends, ends)
        memory.directions[0, :] = 0.0
        enough = best + spans[k]
        slack = bound_slack(scene, 0, NO_MOTION, memory.axes[:0], rounding, enough, memory)
        best = min(best, slack - spans[k])
        if best <= 0.0:
            return 0.0
    return best
