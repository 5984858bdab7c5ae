"""ArmSpace: proofs of the configurations and motions of an arm among obstacles."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np
import scipy  # its parts are read when they are first used
from numpy.typing import ArrayLike

from cspace.arms.chain import FIXED, body_poses
from cspace.arms.hulls import node_corners
from cspace.arms.model import CONTACT_SAMPLES, LIMIT_SLACK, Arm, always_touch, draw_configurations, sort_pair
from cspace.arms.proofs import Scene, are_blocked, are_free, make_scene_scratch, motions_are_free, pair_distances
from cspace.arms.solids import (
    PosedShape,
    Solid,
    StaticShape,
    check_rigid,
    make_inner_scene,
    make_scene,
    named_obstacles,
    place_obstacle,
)
from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Floats, Ints, States
from cspace.check import check_count, check_not_negative, check_pairs, check_positive, check_rng
from cspace.configuration_space import ConfigurationSpace
from cspace.errors import ConfigurationError, InputError
from cspace.map.batches import Query, as_contiguous
from cspace.rotations.base import TWO_PI, beside
from cspace.shapes import ShapeLike
from cspace.shown import ArmPlot
from cspace.threads import in_chunks
from cspace.workspace import Workspace

MIN_MOTIONS_PER_THREAD: Final = 20
"""Motions per thread below which a further thread costs more time than it saves."""


MAX_DOUBLED_JOINTS: Final = 8
"""Largest number of continuous joints that :meth:`ArmSpace.find_path` tries both ways; others go the shorter way."""


_MAX_FAILED_SAMPLES: Final = 100_000
"""Samples after which sampling fails if none is free."""


_DISTANCE_SHARES: Final = (0.95, 0.8, 0.6, 0.4, 0.2, 0.1, 0.03, 0.0)
"""Fractions of (smallest distance at points of a path - margin) tried for the whole path; 0 tries the margin itself."""


_HALF_TURN_ROUNDING: Final = 1e-9
"""Rounding error, radians, by which a joint may exceed half a turn."""


class Contact(NamedTuple):
    """The two solids that are nearest to touching.

    Attributes
    ----------
    link, other : str
        A link, and the obstacle or link that it may not touch.
    distance : float
        Lower bound of the distance between them, metres; zero if the configuration is not proven free.
    points : ndarray of float64, shape (2, 3)
        Nearest points of link and other, in the frame of the base, metres, within rounding.
    """

    link: str
    other: str
    distance: float
    points: Floats


class Group(NamedTuple):
    """Links or obstacles that have the same allowed collisions.

    Links of a group belong to one rigid body.
    """

    members: list[Solid]
    is_obstacle: bool

    @property
    def solid(self) -> Solid:
        """Union of the members, named after all of them."""
        parts = tuple(part for member in self.members for part in member.parts)
        return Solid(", ".join(member.name for member in self.members), self.members[0].body, parts)


class ArmSpace(ConfigurationSpace, ArmPlot):
    """Configurations of an arm among obstacles.

    :func:`build_arm_space` makes one. A configuration is FREE if no link touches an obstacle, or another link that it
    may not touch, according to the given collision geometry. Touching is a collision. A configuration is BLOCKED if a
    link and such an obstacle or link have a proven common point, and MIXED if neither is proven. A motion moves all
    joints along the straight line between two configurations, and is proven as a whole.

    Configurations up to 1e-5 rad (m) beyond a limit are accepted, because files round limits and configurations
    differently. States and proofs hold for the configuration as given. Paths stay within the limits: :meth:`find_path`
    and :func:`planners.plan` move a start or goal onto a limit that it exceeds.

    Attributes
    ----------
    arm : Arm
    obstacles : dict of str to PosedShape
    margin : float
        Metres by which FREE keeps links away from obstacles and from each other.
    """

    def __init__(
        self, arm: Arm, obstacles: Mapping[str, PosedShape], allowed: Iterable[tuple[str, str]], margin: float
    ) -> None:
        self.arm, self.obstacles, self.margin = arm, dict(obstacles), margin
        may_touch = arm.allowed_collisions.keys() | {sort_pair(*pair) for pair in allowed}
        sizes = [np.subtract(*part.shape.outer.bounds) for link in arm.links for part in link.parts]
        reach = max(float(np.linalg.norm(size)) for size in sizes)
        placed = [Solid(name, 0, (StaticShape(each.shape, each.pose, reach),)) for name, each in obstacles.items()]
        self._groups = _group_solids(arm.links, placed, may_touch)
        solids = [group.solid for group in self._groups]
        pairs, fixed = [], []
        for (i, one), (j, other) in combinations(enumerate(self._groups), 2):
            if sort_pair(one.members[0].name, other.members[0].name) not in may_touch:
                if one.solid.body != other.solid.body:
                    pairs.append((i, j) if one.solid.body > other.solid.body else (j, i))
                elif one.is_obstacle != other.is_obstacle:
                    fixed.append((i, j))
        # Most collisions are between an obstacle and a link near the tip, so these pairs come first.
        pairs.sort(key=lambda pair: (solids[pair[1]].body != 0, -solids[pair[0]].body))
        # The outer scene proves FREE by outer shapes; the inner scene proves BLOCKED by inner shapes.
        self._outer_scene = make_scene(arm.chain, solids, pairs, margin)
        self._inner_scene = make_inner_scene(self._outer_scene, solids)
        for pair in fixed:
            self._refuse_fixed(np.array([pair]))
        self._refuse_always()

    def _refuse_fixed(self, pair: Ints) -> None:
        """Raise ConfigurationError if a fixed link touches an obstacle.

        No joint moves either solid of `pair`, two indices of groups, shape (1, 2).
        """
        scene, q = self._outer_scene._replace(pairs=pair), np.zeros((1, self.arm.dof))
        if not are_free(scene, q, q)[0]:
            link, obstacle, *_ = self._contact(scene, q)
            raise ConfigurationError(
                link,
                f"touches obstacle {obstacle!r}, or comes nearer than the margin, at every configuration",
                "no joint moves it",
                f"move the obstacle, or pass allowed_collisions=[({link!r}, {obstacle!r})]",
            )

    def _refuse_always(self) -> None:
        """Raise ConfigurationError if a pair always touches.

        It tests pairs that at most two joints move, in :data:`CONTACT_SAMPLES` random configurations.
        """
        chain, bodies = self.arm.chain, self._outer_scene.solids.bodies
        between = chain.between[tuple(bodies[self._outer_scene.pairs].T)] & (chain.kinds != FIXED)
        moved_by_few = [len(np.unique(chain.joint_indices[row])) <= 2 for row in between]
        for link, other in self._always_touch(self._outer_scene.pairs[moved_by_few]):
            raise ConfigurationError(
                link,
                f"touches {other!r}, or comes nearer than the margin, in {CONTACT_SAMPLES} random configurations",
                "they may not touch, so no configuration would be free",
                f"correct the robot or its SRDF, move the obstacle, or pass allowed_collisions=[({link!r}, {other!r})]",
            )

    def _always_touch(self, pairs: Ints) -> Iterator[tuple[str, str]]:
        """Yield the pairs that touch in all random configurations.

        `pairs` has shape (n, 2): indices of groups.
        """
        scene, points = (
            self._outer_scene._replace(pairs=pairs),
            draw_configurations(self.arm._ranges(), CONTACT_SAMPLES),
        )
        for pair in pairs[always_touch(scene, points)]:
            yield self._contact(scene._replace(pairs=pair[np.newaxis]), points[:1])[:2]

    def __repr__(self) -> str:
        """Return the arm and the number of joints and obstacles."""
        return f"ArmSpace({self.arm.name}: {self.arm.dof} joints, {len(self.obstacles)} obstacles)"

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the joints of a configuration."""
        return self.arm.joints

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the joints: "rad", or "m" for prismatic ones."""
        return self.arm.units

    @property
    def periodic_axes(self) -> tuple[bool, ...]:
        """Whether each joint is continuous.

        A whole turn of a continuous joint leads to the same configuration. A joint that moves another joint by a
        fraction of its own angle is not periodic.
        """
        return tuple((np.isinf(self.arm.upper) & self.arm._whole_turns).tolist())

    def point_checker(self, *, exact: bool = False) -> Callable[..., bool]:
        """Return a fast ``is_free`` that takes floats.

        Call it as ``check(*q)``; see :meth:`cspace.CSpace.point_checker`. Beyond the limits it returns False.
        """
        check = self.edge_checker()
        return lambda *q: check(*q, *q)

    def edge_checker(self, *, exact: bool = False) -> Callable[..., bool]:
        """Return a fast ``motion_is_free`` that takes floats.

        Call it as ``check(*q0, *q1)``; see :meth:`cspace.CSpace.edge_checker`. Beyond the limits it returns False.
        """
        scene, size, local = self._outer_scene, self.size, threading.local()
        lower, upper = ((self.arm.lower - LIMIT_SLACK).tolist() * 2, (self.arm.upper + LIMIT_SLACK).tolist() * 2)

        def check(*endpoints: float) -> bool:
            if not all(low <= x <= high for low, x, high in zip(lower, endpoints, upper, strict=True)):
                return False
            try:
                scratch, out = local.scratch
            except AttributeError:  # the first call of a thread
                scratch, out = local.scratch = make_scene_scratch(scene), np.empty(1, dtype=np.bool_)
            rows = np.array(endpoints).reshape(2, 1, size)
            motions_are_free(scene, rows[0], rows[1], out, scratch)
            return bool(out[0])

        return check

    def obstacle_distance(self, q: ArrayLike) -> float | Floats:
        """Compute a lower bound of the distance from collision.

        The bound is in metres, between links and obstacles and between links, without the margin. It is zero if a
        configuration is not proven free, and infinite if there is nothing to touch.

        Parameters
        ----------
        q : array-like, shape (..., dof)

        Returns
        -------
        float, or ndarray of float64, shape (...)

        Raises
        ------
        ConfigurationError, InputError
            As :meth:`is_free`.
        """
        points = self._check_configurations(q, "q")
        out, _ = self._distances(self._outer_scene, points.reshape(-1, self.arm.dof))
        return out.reshape(points.shape[:-1]) if points.ndim > 1 else float(out[0])

    def path_obstacle_distance(self, path: ArrayLike) -> float:
        """Compute a lower bound of the distance along a path.

        It bounds :meth:`obstacle_distance`, in metres, along all motions of the path. It is 0 if the path is not proven
        free. Fractions of the smallest distance at waypoints and halfway between them are tried, largest first.

        Parameters
        ----------
        path : array-like, shape (n, dof)

        Raises
        ------
        ConfigurationError, InputError
            As :meth:`certify_path`.
        """
        path = self._check_configurations(path, "path").reshape(-1, self.size)
        self._check_spans(path[:-1], path[1:])
        midpoints = 0.5 * (path[:-1] + path[1:])
        limit = float(np.min(self.obstacle_distance(np.concatenate([path, midpoints]))))
        if len(path) < 2 or math.isinf(limit) or limit == 0.0:
            return limit
        for share in _DISTANCE_SHARES:
            extra = share * (limit - self.margin)
            wider = self._outer_scene._replace(required=self._outer_scene.required + extra)
            if are_free(wider, as_contiguous(path[:-1]), as_contiguous(path[1:])).all():
                return self.margin + extra
        return 0.0

    def closest(self, q: ArrayLike) -> Contact:
        """Return the link and obstacle nearest to touching.

        Instead of an obstacle, it may be another link. ``q`` has shape (dof,).

        Raises
        ------
        ConfigurationError, InputError
            As :meth:`is_free`; also if there is nothing to touch.
        """
        point = self._check_configurations(q, "q")
        if point.ndim != 1:
            raise InputError("q", f"has shape {point.shape}", "it must be one configuration", "pass one", value=q)
        if not len(self._outer_scene.pairs):
            raise InputError("obstacles", "are none", "there is nothing to touch", "add an obstacle")
        return self._contact(self._outer_scene, point[np.newaxis])

    def _contact(self, scene: Scene, points: Floats) -> Contact:
        """Return the pair nearest to touching.

        ``points`` is one configuration, shape (1, dof).
        """
        distances, nearest = self._distances(scene, points)
        solids, (pair, *nodes) = scene.solids, nearest[0].tolist()
        # Each part of a solid is a tree of hulls; the part that has a node is the last one whose root is not above it.
        part_names = [each.name for group in self._groups for each in group.members for _ in each.parts]
        names, hulls, radii, poses = [], [], [], body_poses(self.arm.chain, points[0])
        for number, nearest_node in zip(scene.pairs[pair].tolist(), nodes, strict=True):
            node = max(nearest_node, int(solids.roots[number]))
            names.append(part_names[int(np.where(solids.part_roots <= node, solids.part_roots, -1).argmax())])
            corners, radius = node_corners(solids.hulls, node)
            pose = poses[solids.bodies[number]]
            hulls.append(corners @ pose[:3, :3].T + pose[:3, 3])
            radii.append([radius])
        return Contact(names[0], names[1], float(distances[0]), _nearest_points(hulls[0], hulls[1], radii))

    def _distances(self, scene: Scene, points: Floats) -> tuple[Floats, Ints]:
        """Return the smallest distance at each configuration, and its pair.

        ``points`` has shape (n, dof). The distances, shape (n,), are in metres, zero if not proven positive. The second
        array, shape (n, 3), has the index of the pair of solids and the nearest node of the hull tree of each.
        """
        rows = as_contiguous(points)
        out, nearest = np.empty(len(rows)), np.zeros((len(rows), 3), dtype=np.int64)

        def measure(first: int, stop: int) -> int:
            pair_distances(scene, rows[first:stop], out[first:stop], nearest[first:stop], make_scene_scratch(scene))
            return -1

        in_chunks(measure, len(rows), MIN_MOTIONS_PER_THREAD)
        return np.where(out > 0.0, out + self.margin, 0.0), nearest

    def sample_free(self, n: int | None = None, rng: np.random.Generator | None = None) -> Floats:
        """Sample free configurations uniformly within the joint limits.

        Continuous joints are sampled within a turn.

        Parameters
        ----------
        n : int, optional
            How many; by default one, without a batch axis.
        rng : numpy.random.Generator, optional
            Source of randomness; by default a new ``numpy.random.default_rng()`` at each call.

        Returns
        -------
        ndarray of float64, shape (n, dof), or (dof,)

        Raises
        ------
        ConfigurationError
            If none of very many samples is free.
        InputError
            If ``n`` is negative or ``rng`` is neither None nor a Generator.
        """
        count = 1 if n is None else check_count(n, "n")
        generator, ranges = check_rng(rng), self.arm._ranges()
        batches, tried = [np.empty((0, self.arm.dof))], 0
        while (count_drawn := sum(map(len, batches))) < count:
            points = generator.uniform(*ranges, (min(max(2 * (count - count_drawn), 16), 10_000), self.arm.dof))
            batches.append(points[np.asarray(self.is_free(points))])
            tried += len(points)
            if tried >= _MAX_FAILED_SAMPLES and not count_drawn:
                always = [f"{link} touches {other}" for link, other in self._always_touch(self._outer_scene.pairs)]
                raise ConfigurationError(
                    self.arm.name,
                    f"was free in none of {tried} configurations",
                    f"in each of {CONTACT_SAMPLES} of them {', '.join(always)}"
                    if always
                    else "sampling needs some that are",
                    "check space.closest(q), and the pairs that may touch",
                )
        samples = np.concatenate(batches)[:count]
        return samples[0] if n is None else samples

    def find_path(
        self,
        q0: ArrayLike,
        q1: ArrayLike,
        *,
        straight: bool = True,
        iterations: int | None = 0,
        seed: int | None = None,
        time_limit: float = 5.0,
    ) -> Floats:
        """Find a path that is proven collision-free.

        All its motions are proven as a whole. Two trees of motions grow towards each other. The first path is not the
        shortest. Further searches only sample where a shorter path may lead (Gammell and others, 2014), and parts of
        the path are pulled towards straight motions, as far as these are proven free. The path is the same every time
        for a seed, unless the time limit ends the search.

        Continuous joints may turn either way: the path ends at the goal, or whole turns from it. It begins and ends
        within the limits: if q0 or q1 exceeds a limit by at most 1e-5 rad (m), it begins or ends at the limit.

        Parameters
        ----------
        q0 : array-like, shape (dof,)
            A FREE configuration.
        q1 : array-like, shape (dof,) or (n, dof)
            A FREE configuration, or several, of which any FREE one may be reached.
        straight : bool
            Whether to leave out waypoints that straight motions do not need.
        iterations : int, optional
            Largest number of further searches for a shorter path. None: until ten searches in a row shorten it by less
            than 1 %. They also stop if the path is at most 1 % longer than the straight motion to the nearest goal.
        seed : int, optional
        time_limit : float
            Seconds after which the search returns the shortest path so far.

        Returns
        -------
        ndarray of float64, shape (n, dof)
            Waypoints, each motion between two proven free. Continuous joints count whole turns, and turn by at most
            half a turn from row to row, so that the straight motions between the rows are the proven ones. Of length 0
            if no path was found in time.

        Raises
        ------
        ConfigurationError
            If the start, or each goal, is not FREE, or more than 1e-5 rad (m) beyond the limits of a joint.
        InputError
            If a configuration is not one of finite numbers, the time limit is not above zero, or ``iterations`` is
            negative.
        """
        from cspace.arms.search import PathSearch

        start, goals = self._check_configurations(q0, "q0"), np.atleast_2d(self._check_configurations(q1, "q1"))
        for name, q, dims in (("q0", start, (1,)), ("q1", goals, (2,))):
            if q.ndim not in dims or not len(q):
                rule = f"it must be one configuration of {self.size} numbers" + " or rows of them" * (name == "q1")
                raise InputError(name, f"has shape {q.shape}", rule, f"pass ({', '.join(self.axes)})", value=q)
        seconds = check_positive(time_limit, "time_limit", "seconds")
        searches = None if iterations is None else check_count(iterations, "iterations")
        start, goals = self.arm._clamp(start), self.arm._clamp(goals)
        images = self._images(start, goals)
        endpoints = np.vstack([start, images])
        free = are_free(self._outer_scene, endpoints, endpoints)  # of motions that stay at a configuration
        for name, q, good in (("q0", start, free[0]), ("q1", goals[0], free[1:].any())):
            if not good:
                raise collision_error(self, q, name)
        images, rng = images[free[1:]], np.random.default_rng(seed)
        ranges = self.arm._ranges(np.vstack([start, images]))
        search = PathSearch(self._outer_scene, ranges, start, images, self._spans, rng, seconds)
        path = search.find(straight)
        return search.shorten(path, searches) if len(path) and searches != 0 else path

    @property
    def _spans(self) -> Floats:
        """Largest motion of each joint between path rows.

        Its shape is (dof,). It is half a turn for continuous joints, otherwise infinite.
        """
        return np.where(self.periodic_axes, math.pi + _HALF_TURN_ROUNDING, math.inf)

    def _check_spans(self, q0: Floats, q1: Floats, pairs: Ints | None = None) -> None:
        """Raise InputError if a continuous joint turns too far.

        Along an edge it may turn by half a turn. Edges lead from ``q0`` to ``q1``, shape (..., n, dof). ``pairs``,
        shape (n, 2), are the rows that each edge joins; by default each row and the next.
        """
        steps = np.abs(q1 - q0)
        for *path, edge, joint in np.argwhere(steps > self._spans)[:1].tolist():
            first, last = (edge, edge + 1) if pairs is None else pairs[edge].tolist()
            raise InputError(
                "path",
                f"turns {self.axes[joint]} by {steps[*path, edge, joint]:.6g} rad from row {first} to row {last}",
                "a continuous joint turns by at most half a turn along an edge, so that its motion is the shorter way",
                "add whole turns to the rows (numpy.unwrap), or rows between them",
                value=(first, last),
            )

    def certify_path(self, path: ArrayLike, edges: ArrayLike | None = None, *, exact: bool = False) -> Bools:
        """Return whether each edge is proven collision-free.

        The edges join the rows of a path, of several paths, or of a roadmap. Along an edge, all joints move together,
        each from its value to the next, as in :meth:`motion_is_free`. An edge that turns a continuous joint by more
        than half a turn is refused, because planners and controllers that wrap angles would take the shorter way, a
        different motion. For all other edges both motions are the same.

        Parameters
        ----------
        path : array-like, shape (n, dof) or (..., n, dof)
            Configurations, radians and metres: those of a path in order, of several paths of equal length, or the
            vertices of a roadmap. Continuous joints count whole turns: 3.1 is followed by 3.2, not by 3.2 - 2 pi.
        edges : array-like of int, shape (m, 2), optional
            Indices, from 0, of the two vertices of each edge; ``path`` must then have shape (n, dof). By default each
            configuration is joined to the next.
        exact : bool
            Ignored, because the geometry of an arm always decides.

        Returns
        -------
        ndarray of bool, shape (n - 1,), (..., n - 1) or (m,)
            A path of one configuration has no edges, so nothing is proven about it.

        Raises
        ------
        InputError
            If an edge turns a continuous joint by more than half a turn; or as :meth:`cspace.CSpace.certify_path`.
        ConfigurationError
            If a configuration is more than 1e-5 rad (m) beyond a limit.
        """
        points = self._check_configurations(path, "path")
        if edges is not None:
            pairs = check_pairs(edges, points)
            self._check_spans(points[pairs[:, 0]], points[pairs[:, 1]], pairs)
        elif points.ndim > 1:
            self._check_spans(points[..., :-1, :], points[..., 1:, :])
        return super().certify_path(path, edges, exact=exact)

    def _images(self, start: Floats, goals: Floats) -> Floats:
        """Return the goals both ways around each continuous joint.

        ``start`` has shape (dof,), ``goals`` (n, dof), the result (m, dof). Its first n rows are the goals the shorter
        way round; a goal that already is, is unchanged to the last bit.
        """
        images = np.where(self.periodic_axes, beside(goals, start), goals)
        for joint in np.flatnonzero(self.periodic_axes)[:MAX_DOUBLED_JOINTS]:
            others = images.copy()
            others[:, joint] += np.where(images[:, joint] > start[joint], -TWO_PI, TWO_PI)
            images = np.concatenate([images, others])
        return images

    def _classify(self) -> Query:
        """Return the query that writes the state of each configuration."""

        def query(parts: Sequence[Any], out: States) -> int:
            # BLOCKED is sought only where FREE is not proven.
            (rows,) = self._rows(parts, ("q",))
            free = np.empty(len(out), dtype=np.bool_)
            self._prove([rows], free)
            out[:] = np.where(free, np.uint8(FREE), np.uint8(MIXED))
            undecided = np.flatnonzero(~free)

            def find_blocked(first: int, stop: int) -> int:
                blocked, chunk = np.empty(stop - first, dtype=np.bool_), undecided[first:stop]
                are_blocked(self._inner_scene, rows[chunk], blocked, make_scene_scratch(self._inner_scene))
                out[chunk[blocked]] = BLOCKED
                return -1

            return in_chunks(find_blocked, len(undecided), MIN_MOTIONS_PER_THREAD)

        return query

    def _frees(self, exact: bool) -> Query:
        """Return the query that proves configurations free."""
        return lambda parts, out: self._prove(self._rows(parts, ("q",)), out)

    def _edges(self, number: int, exact: bool) -> Query:
        """Return the query that proves motions free."""
        return lambda parts, out: self._prove(self._rows(parts, ("q0", "q1")), out)

    def _prove(self, rows: Sequence[Floats], out: Bools) -> int:
        """Write whether each motion is proven free.

        Motions lead from the first batch to the last. ``rows`` has one batch, for motions that stay in place, or two;
        each has shape (n, dof), and ``out`` shape (n,). Returns -1.
        """

        def prove(first: int, stop: int) -> int:
            out[first:stop] = are_free(self._outer_scene, rows[0][first:stop], rows[-1][first:stop])
            return -1

        return in_chunks(prove, len(out), MIN_MOTIONS_PER_THREAD)

    def _rows(self, parts: Sequence[Any], names: Sequence[str]) -> list[Floats]:
        """Check batches of configurations, and return them as contiguous arrays.

        Each has shape (n, dof). ``names`` are the arguments that messages name.
        """
        return [as_contiguous(self._check_configurations(part, name)) for part, name in zip(parts, names, strict=True)]

    def _check_configurations(self, q: ArrayLike, name: str = "q") -> Floats:
        """Check configurations, and return them as an array.

        Raises ConfigurationError beyond the limits of a joint.
        """
        points = self.arm._check_configurations(q, name)
        self.arm._check_limits(points, name)
        return points


def collision_error(space: ArmSpace, q: Floats, name: str) -> ConfigurationError:
    """Return the error for a start or goal in collision.

    ``q`` has shape (dof,); `name` is the argument. The message names the link and the obstacle that touch.
    """
    link, other, *_ = space.closest(q)
    problem = f"is not proven free: {link} is in collision with {other}, or nearly so"
    hint = f"choose another, or pass allowed_collisions=[({link!r}, {other!r})] if they may touch"
    point = f"({', '.join(f'{x:.6g}' for x in q)})"
    return ConfigurationError(name, f"{point} {problem}", "a path must start and end in FREE", hint, value=q)


def build_arm_space(
    obstacles: Workspace | Mapping[str, Workspace | PosedShape | ShapeLike],
    arm: Arm,
    *,
    allowed_collisions: Iterable[tuple[str, str]] = (),
    margin: float = 0.0,
    base_pose: ArrayLike | None = None,
) -> ArmSpace:
    """Build the space of an arm among obstacles.

    Parameters
    ----------
    obstacles : Workspace, or mapping of str to Workspace, PosedShape or shape
        Obstacles in space by name, metres. A shape is a ``trimesh.Trimesh``, a file of one, or anything else that
        :meth:`CSpace.add_obstacle` takes. A single workspace is called ``"workspace"``. A workspace made from a mesh or
        point cloud is used exactly, any other by its cells; everything beyond the grid is free. Unknown cells are
        obstacles where ``outer`` is set, and never prove a configuration BLOCKED.
    arm : Arm
    allowed_collisions : iterable of pairs of str
        A link, and an obstacle or link that it may touch, in addition to :attr:`Arm.allowed_collisions`.
    margin : float
        Metres by which FREE stays clear.
    base_pose : array-like, shape (4, 4), optional
        Pose of the arm's base in the frame of the obstacles; the identity by default.

    Raises
    ------
    InputError
        If a name is taken by a link or unknown, an obstacle is in the plane, a pose is no rigid motion, the margin is
        negative, or cells do not fit into memory.
    ConfigurationError
        If an obstacle touches a link that no joint moves, or if a pair that at most two joints move touches in all 1000
        random configurations.
    """
    named = named_obstacles(obstacles)
    links = {link.name for link in arm.links}
    for name in named:
        if name in links:
            problem = f"name one {name!r}"
            raise InputError("obstacles", problem, "a link has that name", "choose another name", value=name)
    pairs = list(allowed_collisions)
    for pair in pairs:
        for name in pair:
            if name not in links and name not in named:
                rule = f"there are {', '.join((*links, *named))}"
                raise InputError("allowed_collisions", f"names {name!r}", rule, "name two of these", value=name)
    min_distance = check_not_negative(margin, "margin")
    base = np.linalg.inv(np.eye(4) if base_pose is None else check_rigid(base_pose, "base_pose")).astype(np.float64)
    placed = {name: place_obstacle(each, name, base) for name, each in named.items()}
    return ArmSpace(arm, {name: each for name, each in placed.items() if each is not None}, pairs, min_distance)


def _group_solids(links: Sequence[Solid], obstacles: Sequence[Solid], may_touch: Set[tuple[str, str]]) -> list[Group]:
    """Group links and obstacles by their allowed collisions.

    Links of a group belong to one body. Members of a group have the same partners in ``may_touch``, so that one test
    proves all of them apart from another group.
    """
    partners: dict[str, set[str]] = {}
    for one, other in may_touch:
        partners.setdefault(one, set()).add(other)
        partners.setdefault(other, set()).add(one)
    groups: dict[tuple[int, frozenset[str]], list[Solid]] = {}
    for link in links:
        same_body = {each.name for each in links if each.body == link.body}
        key = link.body, frozenset(partners.get(link.name, set()) - same_body)
        groups.setdefault(key, []).append(link)
    for obstacle in obstacles:
        groups.setdefault((-1, frozenset(partners.get(obstacle.name, ()))), []).append(obstacle)
    return [Group(each, body < 0) for (body, _), each in groups.items()]


def _nearest_points(points_a: Floats, points_b: Floats, radii: ArrayLike) -> Floats:
    """Return the nearest points of two convex hulls.

    The result has shape (2, 3). The hulls are those of two point sets, shapes (n, 3) and (m, 3), each grown by a
    radius; ``radii`` has shape (2, 1); all in metres. The nearest points follow from the point nearest to zero in the
    hull of all differences (C. L. Lawson and R. J. Hanson, "Solving Least Squares Problems", 1974, chapter 23).
    """
    differences = (points_a[:, np.newaxis] - points_b).reshape(-1, 3)
    weights, _ = scipy.optimize.nnls(np.vstack([differences.T, np.ones(len(differences))]), [0.0, 0.0, 0.0, 1.0])
    shares = weights.reshape(len(points_a), len(points_b)) / weights.sum()
    points = np.stack([shares.sum(axis=1) @ points_a, shares.sum(axis=0) @ points_b])
    offset = points[1] - points[0]
    return np.asarray(
        points + np.multiply(radii, [[1.0], [-1.0]]) * offset / max(float(np.linalg.norm(offset)), np.finfo(float).tiny)
    )
