"""Snapshots of an arm among obstacles, which never change.

A living :class:`cspace.ArmSpace` replaces its own.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, combinations
from typing import Any, Final, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cspace.arms._inner_balls import InnerBalls, find_inner_balls
from cspace.arms._model import CONTACT_SAMPLES, Arm, Names, always_touch, sort_pair
from cspace.arms._posed_shapes import PosedShape
from cspace.errors import ConfigurationError
from cspace.inside import (
    ADVANCE_FACTOR,
    DISTANCE_ROUNDING,
    FIXED,
    REVOLUTE,
    Address,
    ArmScene,
    Bools,
    Cones,
    Floats,
    Ints,
    SceneScratch,
    Solid,
    StaticShape,
    Upright,
    are_blocked,
    as_contiguous,
    bound_distances,
    box_trees,
    check_known,
    compute_poses,
    count_free_motions,
    find_proof,
    keep,
    make_inner_scene,
    make_scene,
    make_scene_scratch,
    motions_are_free,
    move_into_cones,
    node_corners,
    run_in_chunks,
)

MIN_MOTIONS_PER_THREAD: Final = 100
"""Motions per thread below which a further thread costs more time than it saves."""


_spare_scratch: Final = WeakKeyDictionary[ArmScene, list[SceneScratch]]()
"""Scratch memory that no thread uses now, of scenes that are kept for several calls."""


class Contact(NamedTuple):
    """The two solids that are nearest to touching.

    Attributes
    ----------
    link, other : str
        A link, and the obstacle or link that it may not touch.
    distance : float
        Lower bound of the distance between them, metres; zero if the configuration is not proven
        free.
    points : ndarray of float64, shape (2, 3)
        Nearest points of link and other, in the frame of the base, metres, within rounding.
    """

    link: str
    other: str
    distance: float
    points: Floats


class Group(NamedTuple):
    """Links or obstacles with the same allowed collisions.

    Links of a group belong to one body. All members have the same padding.
    """

    solid: Solid
    members: tuple[Solid, ...]
    padding: float
    is_obstacle: bool


@dataclass(frozen=True, eq=False)
class Snapshot:
    """An arm among obstacles at one moment.

    Attributes
    ----------
    arm : Arm
    obstacles : mapping of str to PosedShape or None
        Obstacles in the frame of the base; None for a workspace without occupied cells.
    allowed : frozenset of pairs of str
        Alphabetical pairs that may touch, in addition to :attr:`Arm.allowed_collisions`.
    padding : mapping of str to float
        Metres that links and obstacles add to the margin between links and obstacles; zero if
        missing.
    margin : float
        Metres by which FREE keeps links away from obstacles and from each other.
    reach : float
        Size of the largest part of a link, metres.
    static : mapping of str to Solid
        The obstacles as solids.
    groups : tuple of Group
        Of links, then of obstacles.
    outer : Scene
        It proves FREE by outer shapes.
    uprights : tuple of Upright
        What FREE keeps in addition; ``outer`` has their cones.
    """

    arm: Arm
    obstacles: Mapping[str, PosedShape | None]
    allowed: frozenset[Names]
    padding: Mapping[str, float]
    margin: float
    reach: float
    static: Mapping[str, Solid]
    groups: tuple[Group, ...]
    outer: ArmScene
    uprights: tuple[Upright, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments of :func:`make_snapshot`."""
        scene = self.arm, self.obstacles, self.allowed, self.padding, self.margin
        return make_snapshot, (*scene, None, self.uprights)

    def keep(self, uprights: Sequence[Upright]) -> Snapshot:
        """Return a snapshot whose FREE also keeps axes upright.

        Raises InputError if the arm does not have a frame.
        """
        for upright in uprights:
            check_known(upright.frame, "frame", self.arm.placements)
        outer = keep(self.outer._replace(cones=_make_cones(self.arm, uprights)))
        return replace(self, outer=outer, uprights=tuple(uprights))

    def move_upright(self, points: Floats) -> Floats:
        """Move configurations, shape (n, dof), to be upright; return them.

        Some may fail.
        """
        moved = points.copy()
        scratch = make_scene_scratch(self.outer)
        for row in moved if self.uprights else ():
            move_into_cones(self.outer.chain, self.outer.cones, row, scratch.slopes, scratch.poses)
        return moved

    def find_tilt(self, q: Floats) -> tuple[Upright, float] | None:
        """Find an angle that a configuration, shape (dof,), does not keep; None if it keeps all."""
        for upright in self.uprights:
            axis = self.arm.pose(q, upright.frame)[:3, :3] @ np.asarray(upright.axis)
            direction = np.asarray(upright.direction)
            across = np.linalg.norm(np.cross(axis, direction))
            angle = math.atan2(across, float(axis @ direction))
            # Proofs take rounding from the tolerance.
            # Radians by which a configuration must be within a tolerance to count as upright; more
            # than proofs take from it for rounding.
            if not abs(angle - upright.angle) <= upright.tolerance - 1e-9:
                return upright, angle
        return None

    @property
    def names(self) -> list[str]:
        """Names of links with geometry, attached objects and obstacles."""
        return [*(link.name for link in self.arm.links), *self.obstacles]

    @cached_property
    def proof(self) -> Address:
        """Address of the proof of a motion."""
        return find_proof(self.outer)

    @cached_property
    def inner(self) -> ArmScene:
        """Scene of inner shapes, which proves BLOCKED."""
        return keep(make_inner_scene(self.outer, [group.solid for group in self.groups]))

    @cached_property
    def inner_balls(self) -> InnerBalls:
        """Balls inside the solids of the inner scene."""
        return find_inner_balls(self.inner.solids)

    def are_free(self, firsts: Floats, lasts: Floats, scene: ArmScene | None = None) -> Bools:
        """Return whether motions, shapes (n, dof), are proven free, shape (n,).

        ``scene`` is the outer scene, or one with more padding.
        """
        out = np.empty(len(firsts), dtype=np.bool_)
        rows = [as_contiguous(each) for each in (firsts, lasts)]
        _run_in_threads(partial(motions_are_free, self.proof), scene or self.outer, *rows, out)
        return out

    def count_free(self, starts: Floats, ends: Floats, deviations: Floats, counts: Ints) -> None:
        """Lower counts to the number of motions that are free with any deviation.

        Arguments are as for :meth:`cspace.Gate.check_rows`; ``deviations``, shape (b, dof),
        bound that of each joint at each time. A motion proves it if all pairs stay apart by as much
        as such joint motions move them, in addition, and links keep their angles within the
        tolerances less as much as they turn.
        """
        min_chunks = max(1, MIN_MOTIONS_PER_THREAD // ends.shape[1])
        paddings = self.outer.padding + self.bound_displacements(deviations)
        tolerances = self.outer.cones.tolerances - self._bound_turns(deviations)

        def count(scene: ArmScene, *arguments: Any) -> None:
            """Count motions with a copy of the scene, to which the kernel writes."""
            cones = scene.cones._replace(tolerances=scene.cones.tolerances.copy())
            own = keep(scene._replace(padding=scene.padding.copy(), cones=cones))
            count_free_motions(self.proof, own, *arguments)

        rows = starts, ends, paddings, tolerances, counts
        _run_in_threads(count, self.outer, *rows, min_items=min_chunks)

    def _bound_turns(self, joint_motions: Floats) -> Floats:
        """Bound how far joint motions, shape (n, dof), turn the body of each cone, shape (n, c)."""
        chain = self.outer.chain
        rates = np.abs(chain.factors * joint_motions[:, chain.joint_indices])
        turns = chain.between[self.outer.cones.bodies, 0] & (chain.kinds == REVOLUTE)
        return np.asarray(rates @ turns.T / ADVANCE_FACTOR)

    def bound_displacements(self, joint_motions: Floats) -> Floats:
        """Bound how far joint motions, shape (n, dof), move each pair, shape (n, p); metres.

        The bounds include rounding.
        """
        chain = self.outer.chain
        solids = self.outer.solids
        first, second = self.outer.pairs.T
        bodies = solids.bodies[first]
        rates = np.abs(chain.factors * joint_motions[:, chain.joint_indices])
        reaches = chain.lengths[bodies] + solids.levers[first, np.newaxis]
        levers = np.where(chain.kinds == REVOLUTE, reaches, 1.0)
        moves = chain.between[bodies, solids.bodies[second]] & (chain.kinds != FIXED)
        with np.errstate(over="ignore"):  # bounds may be infinite
            displacements = rates @ (moves * levers).T
        rounding = DISTANCE_ROUNDING * self.outer.max_coordinate * rates.sum(axis=1, keepdims=True)
        return np.asarray(displacements / ADVANCE_FACTOR + rounding)

    def are_blocked(self, points: Floats) -> Bools:
        """Return whether configurations, shape (n, dof), are proven BLOCKED, shape (n,)."""
        blocked = np.empty(len(points), dtype=np.bool_)
        _run_in_threads(are_blocked, self.inner, as_contiguous(points), blocked)
        return blocked

    def distances(self, points: Floats, scene: ArmScene | None = None) -> tuple[Floats, Ints]:
        """Return the smallest distance at each configuration, shape (n, dof), and its pair.

        The distances, shape (n,), are in metres, zero if not proven positive. The second array,
        shape (n, 3), has the index of the pair of solids and the nearest node of the hull tree of
        each. ``scene`` is the outer scene, or one with some of its pairs.
        """
        out = np.empty(len(points))
        nearest = np.zeros((len(points), 3), dtype=np.int64)
        _run_in_threads(bound_distances, scene or self.outer, as_contiguous(points), out, nearest)
        return np.where(out > 0.0, out + self.margin, 0.0), nearest

    def contact(self, scene: ArmScene, points: Floats) -> Contact:
        """Find the two solids nearest to touching at one configuration, shape (1, dof).

        ``scene`` is the outer scene, or one with some of its pairs.
        """
        distances, nearest = self.distances(points, scene)
        solids = scene.solids
        ((number, *nodes),) = nearest.tolist()
        pair = scene.pairs[number]
        # Place the nearest hulls of both solids in the frame of the base.
        poses = compute_poses(self.arm.chain, points[0])
        hulls = []
        radii = []
        for solid, nearest_node in zip(pair.tolist(), nodes, strict=True):
            node = nearest_node if nearest_node >= 0 else int(solids.roots[solid])
            corners, radius = node_corners(solids.hulls, node)
            pose = poses[solids.bodies[solid]]
            hulls.append(corners @ pose[:3, :3].T + pose[:3, 3])
            radii.append(radius)
        link, other = self._name_parts(pair, nodes)
        return Contact(link, other, float(distances[0]), box_trees.find_nearest(*hulls, *radii))

    def _name_parts(self, pair: Ints, nodes: Sequence[int]) -> tuple[str, str]:
        """Return the names of the links or obstacles at hull nodes of a pair of solids.

        ``pair`` has the two solids, ``nodes`` a node of each.
        """
        # The member to which each part of all solids belongs.
        names = list[str]()
        for group in self.groups:
            for member in group.members:
                names += [member.name] * len(member.parts)
        link_part, other_part = map(self.outer.solids.part_at, pair.tolist(), nodes)
        return names[link_part], names[other_part]

    def always_touching(self, scene: ArmScene) -> Iterator[tuple[str, str]]:
        """Yield the names of a scene's pairs that touch in all random configurations."""
        points = self.arm._contact_samples
        for number in range(len(scene.pairs)):
            pair_scene = scene.select_pairs(slice(number, number + 1))
            if always_touch(pair_scene, points):
                contact = self.contact(pair_scene, points[:1])
                yield contact.link, contact.other


def make_snapshot(
    arm: Arm,
    obstacles: Mapping[str, PosedShape | None],
    allowed: Collection[Names],
    padding: Mapping[str, float],
    margin: float,
    before: Snapshot | None = None,
    uprights: tuple[Upright, ...] = (),
) -> Snapshot:
    """Make a snapshot; see :class:`Snapshot` for the arguments.

    Obstacles that did not change are taken from the snapshot ``before``, which saves their
    preparation and changes nothing else.

    Raises
    ------
    ConfigurationError
        As :func:`build_arm_space`.
    """
    reach = _measure_reach(arm)
    static = {
        name: _place_static(name, placed, reach, before)
        for name, placed in obstacles.items()
        if placed is not None
    }
    may_touch = arm.allowed_collisions.keys() | frozenset(allowed)
    groups = _group_solids(arm.links, may_touch, padding, is_obstacle=False)
    groups += _group_solids(list(static.values()), may_touch, padding, is_obstacle=True)
    # One scene of all pairs; pairs that no joint moves are tested now, and never again.
    moved_pairs, fixed_pairs = _pair_groups(groups, may_touch)
    pairs = moved_pairs + fixed_pairs
    solids = [group.solid for group in groups]
    scene = make_scene(arm.chain, solids, pairs, arm._packed, _pad_pairs(groups, pairs), margin)
    outer = keep(scene.select_pairs(slice(len(moved_pairs))))
    fixed = scene.select_pairs(slice(len(moved_pairs), None))
    snapshot = Snapshot(
        arm,
        obstacles,
        frozenset(allowed),
        padding,
        margin,
        reach,
        static,
        tuple(groups),
        outer,
    )
    _refuse_fixed(snapshot, fixed)
    _refuse_always(snapshot)
    return snapshot.keep(uprights) if uprights else snapshot


def _make_cones(arm: Arm, uprights: Sequence[Upright]) -> Cones:
    """Make the cones of an arm's frames, which it must have."""
    placed = [arm.placements[upright.frame] for upright in uprights]
    axes = [
        frame.pose[:3, :3] @ np.asarray(upright.axis)
        for frame, upright in zip(placed, uprights, strict=True)
    ]
    return Cones(
        bodies=np.array([frame.body for frame in placed], dtype=np.int64),
        axes=np.array(axes).reshape(-1, 3),
        directions=np.array([upright.direction for upright in uprights]).reshape(-1, 3),
        angles=np.array([upright.angle for upright in uprights]),
        tolerances=np.array([upright.tolerance for upright in uprights]),
        lower=arm.lower,
        upper=arm.upper,
    )


def _measure_reach(arm: Arm) -> float:
    """Return the size of the largest part of a link, metres."""
    reach = 0.0
    for link in arm.links:
        for part in link.parts:
            lower, upper = part.shape.outer.bounds
            reach = max(reach, float(np.linalg.norm(upper - lower)))
    return reach


def _place_static(name: str, placed: PosedShape, reach: float, before: Snapshot | None) -> Solid:
    """Return an obstacle as a solid of the base, from the snapshot ``before`` if it has it.

    ``reach`` is the size of the largest part of a link, metres.
    """
    if before is not None and before.obstacles.get(name) is placed and before.reach == reach:
        return before.static[name]
    return Solid(name, 0, (StaticShape(placed.shape, placed.pose, reach),))


def _find_partners(may_touch: Set[Names]) -> dict[str, set[str]]:
    """Return the names that each name may touch."""
    partners = defaultdict[str, set[str]](set)
    for a, b in may_touch:
        partners[a].add(b)
        partners[b].add(a)
    return partners


def _group_solids(
    solids: Sequence[Solid], may_touch: Set[Names], padding: Mapping[str, float], is_obstacle: bool
) -> list[Group]:
    """Group links, or obstacles, of one body that one test can prove apart together.

    Members of a group may touch the same others, and have the same padding.
    """
    partners = _find_partners(may_touch)
    names_of_body = defaultdict[int, set[str]](set)
    for solid in solids:
        names_of_body[solid.body].add(solid.name)
    # Body, names that it may touch and padding of a solid decide its group. Links of its own body
    # do not count, because they never move against it.
    members_of_key = defaultdict[tuple[int, frozenset[str], float], list[Solid]](list)
    for solid in solids:
        others = frozenset(partners[solid.name] - names_of_body[solid.body])
        members_of_key[solid.body, others, padding.get(solid.name, 0.0)].append(solid)
    groups = []
    for (body, _, group_padding), members in members_of_key.items():
        parts = tuple(chain.from_iterable(member.parts for member in members))
        joined = Solid(", ".join(member.name for member in members), body, parts)
        groups.append(Group(joined, tuple(members), group_padding, is_obstacle))
    return groups


def _pair_groups(
    groups: Sequence[Group], may_touch: Set[Names]
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Return the pairs of groups that may not touch, as their indices, in two lists.

    Joints move the pairs of the first list; the others are fixed links and obstacles. The second of
    a pair is an obstacle, or the body nearer to the base.
    """
    moved_pairs = list[tuple[int, int]]()
    fixed_pairs = list[tuple[int, int]]()
    # Groups of obstacles come last, so a pair of two obstacles begins with one.
    for (i, a), (j, b) in combinations(enumerate(groups), 2):
        if a.is_obstacle or sort_pair(a.members[0].name, b.members[0].name) in may_touch:
            continue
        if a.solid.body == b.solid.body:
            if b.is_obstacle:
                fixed_pairs.append((i, j))
        elif b.is_obstacle or a.solid.body > b.solid.body:
            moved_pairs.append((i, j))
        else:
            moved_pairs.append((j, i))

    def rank(pair: tuple[int, int]) -> tuple[bool, int]:
        """Put an obstacle and a link near the tip first, because most collisions are these."""
        first, second = (groups[number].solid.body for number in pair)
        return second != 0, -first

    moved_pairs.sort(key=rank)
    return moved_pairs, fixed_pairs


def _pad_pairs(groups: Sequence[Group], pairs: Sequence[tuple[int, int]]) -> Floats:
    """Return the padding of pairs, shape (p,): the sum of both, or zero between links."""
    total = np.zeros(len(pairs))
    for number, (i, j) in enumerate(pairs):
        if groups[j].is_obstacle:
            total[number] = groups[i].padding + groups[j].padding
    return total


def _refuse_fixed(snapshot: Snapshot, scene: ArmScene) -> None:
    """Raise ConfigurationError if a fixed link touches an obstacle.

    ``scene`` has the pairs of such links, which no joint moves.
    """
    q = np.zeros((1, snapshot.arm.dof))
    if not snapshot.are_free(q, q, scene)[0]:
        link, obstacle, *_ = snapshot.contact(scene, q)
        raise ConfigurationError(
            link,
            f"touches obstacle {obstacle!r}, or comes nearer than the margin, at every "
            "configuration",
            "no joint moves it",
        )


def find_bodies_between(snapshot: Snapshot) -> Bools:
    """Find the bodies whose joints move a pair of solids apart, shape (pairs, bodies)."""
    chain = snapshot.arm.chain
    first_bodies, second_bodies = snapshot.outer.solids.bodies[snapshot.outer.pairs].T
    between: Bools = chain.between[first_bodies, second_bodies] & (chain.kinds != FIXED)
    return between


def _refuse_always(snapshot: Snapshot) -> None:
    """Raise ConfigurationError if a pair touches in all random configurations.

    Tests only pairs that at most two joints move, because others hardly ever touch always.
    """
    scene = snapshot.outer
    has_few_joints = np.zeros(len(scene.pairs), dtype=np.bool_)
    for number, moving_bodies in enumerate(find_bodies_between(snapshot)):
        joints = np.unique(snapshot.arm.chain.joint_indices[moving_bodies])
        has_few_joints[number] = len(joints) <= 2
    for link, other in snapshot.always_touching(scene.select_pairs(has_few_joints)):
        raise ConfigurationError(
            link,
            f"touches {other!r}, or comes nearer than the margin, in {CONTACT_SAMPLES} random "
            "configurations",
            "they may not touch, so no configuration would be free",
            f"build_arm_space(allowed_collisions=[{(link, other)}]) lets them touch",
        )


def _run_in_threads(
    kernel: Callable[..., None],
    scene: ArmScene,
    *arrays: NDArray[Any],
    min_items: int = MIN_MOTIONS_PER_THREAD,
) -> None:
    """Call ``kernel(scene, *arrays, scratch)`` on slices of contiguous arrays, in threads."""
    scene = keep(scene)
    spare = _spare_scratch.setdefault(scene, [])

    def run_slice(first: int, stop: int) -> int:
        """Run the kernel on some rows with its own scratch; -1 means that nothing failed."""
        try:
            scratch = spare.pop()
        except IndexError:
            scratch = make_scene_scratch(scene)
        kernel(scene, *(array[first:stop] for array in arrays), scratch)
        spare.append(scratch)
        return -1

    run_in_chunks(run_slice, len(arrays[0]), min_items)
