"""Arms: links and joints, read from URDF files."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, permutations
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspace.arms._checks import check_mapping, check_names, check_rigid
from cspace.arms._inverse import DEFAULT_TOLERANCE, Branch, PoseGoal, branch_to, solve_pose
from cspace.arms._link_speeds import bound_speeds
from cspace.arms._reading.moveit_messages import read_joint_state
from cspace.errors import ConfigurationError, InputError
from cspace.inside import (
    FIXED,
    MAX_BODIES,
    PRISMATIC,
    REVOLUTE,
    ArmScene,
    Bools,
    Chain,
    Floats,
    Frame,
    Ledger,
    PackedParts,
    Part,
    ShapeLike,
    Solid,
    are_free,
    as_shape,
    check_count,
    check_finite,
    check_known,
    check_points,
    check_text,
    check_word,
    compute_poses,
    frozen,
    keep,
    make_scene,
    names_options,
    pack_parts,
    tell_apart,
    warn_of_large,
    warn_of_size,
    warn_user,
)

if TYPE_CHECKING:
    from cspace.arms._reading.link_shapes import SolidMode
    from cspace.arms._reading.urdf import JointDescription, PackageDirs, RobotDescription, Srdf
    from cspace.arms._sphere_models import SphereModel

Names = tuple[str, str]
"""Two link names in alphabetical order."""

_JOINT_KINDS: Final = {
    "fixed": FIXED,
    "revolute": REVOLUTE,
    "continuous": REVOLUTE,
    "prismatic": PRISMATIC,
}
"""How a joint of each URDF type moves."""


CONTACT_SAMPLES: Final = 1000
"""Random configurations from which a pair counts as touching never or always."""


LIMIT_SLACK: Final = 1e-5
"""Largest accepted excess over a joint limit, radians or metres, because files round limits and
configurations differently."""


class JointValues(dict[str, float]):
    """Values of a robot's joints by name, radians or metres.

    :meth:`cspace.Arm.configuration` takes those of joints that move, and
    ``Arm.from_urdf(held_joints=)`` those of others. Both refuse unknown joints, and warn of joints
    elsewhere than the joints that they mimic put them.
    """


class Joint(NamedTuple):
    """A joint of a URDF.

    Attributes
    ----------
    name : str
    kind : int
        FIXED, REVOLUTE or PRISMATIC.
    parent, child : str
        Links.
    frame : ndarray of float64, shape (4, 4)
        Frame of the joint in the frame of the parent link.
    axis : ndarray of float64, shape (3,)
        Unit vector, in the joint's frame.
    lower, upper : float
        Limits, radians or metres; infinite for a continuous joint.
    leader : str
        The joint that it mimics; its own name if none.
    factor, offset : float
        Its position is ``factor * leader + offset``.
    max_velocity : float
        Limit of its speed, rad/s or m/s; infinite if the URDF has none, or zero.
    """

    name: str
    kind: int
    parent: str
    child: str
    frame: Floats
    axis: Floats
    lower: float
    upper: float
    leader: str
    factor: float
    offset: float
    max_velocity: float


@dataclass(frozen=True, eq=False, repr=False)
class Arm:
    """A robot with joints: a tree of links, moved by configurations.

    Read one with :meth:`from_urdf`. A configuration has one number for each of :attr:`joints`,
    radians or metres.

    Attributes
    ----------
    name : str
    joints : tuple of str
        The joints of a configuration, in its order: depth-first from the base, and by name where
        the tree branches, as MoveIt and pinocchio order them.
    lower, upper : ndarray of float64, shape (dof,)
        Their limits; infinite for continuous joints.
    links : tuple of Solid
        Links with a collision geometry, each on the body that it moves with.
    allowed_collisions : dict of pairs of str to str
        Alphabetical pairs of links that may touch, and the reason: ``"adjacent"``, ``"one body"``,
        ``"always"`` if they touch in each of 100 random configurations, ``"held"``, or the reason
        of the SRDF. No proof tests these pairs.
    chain : Chain
    units : tuple of str
        Units of the joints: "rad", or "m" for prismatic ones.
    max_velocity : ndarray of float64, shape (dof,)
        Largest speed of each joint, rad/s or m/s, at which neither it nor a joint that mimics it
        exceeds the velocity limit of the URDF; infinite if the URDF has none, or zero.
    groups : dict of str to tuple of str
        Joints of each group of the SRDF, in the order of a configuration.
    held_joints : dict of str to float
        Values of joints that do not move, radians or metres, without joints that mimic others.
    placements : dict of str to Frame
        Body of each of :attr:`frames`, and the pose on it.
    carriers : dict of str to str
        Frame that carries each attached object.
    """

    name: str
    joints: tuple[str, ...]
    lower: Floats
    upper: Floats
    links: tuple[Solid, ...]
    allowed_collisions: dict[Names, str]
    chain: Chain
    units: tuple[str, ...]
    max_velocity: Floats
    groups: dict[str, tuple[str, ...]]
    held_joints: dict[str, float]
    placements: dict[str, Frame]
    carriers: dict[str, str]
    _base_is_root: bool
    _followers: tuple[Joint, ...]
    _passive: frozenset[str]
    _never: Set[Names]
    _states: dict[str, dict[str, float]]

    @classmethod
    @names_options
    def from_urdf(
        cls,
        path: str | os.PathLike[str],
        srdf: str | os.PathLike[str] | None = None,
        tip: str | None = None,
        base: str | None = None,
        *,
        joints: str | Iterable[str] | None = None,
        held_joints: Mapping[str, float] | None = None,
        solid: SolidMode = "auto",
        package_dirs: PackageDirs = (),
        visuals: bool = False,
        spheres: str | os.PathLike[str] | None = None,
    ) -> Arm:
        """Read an arm from URDF, with collision geometry.

        Revolute, continuous and prismatic joints move, together with the joints that mimic them.
        Fixed joints merge their links into one body. Soft limits of ``<safety_controller>`` replace
        wider limits. A limit that ``<limit>`` leaves out is zero, by the format.

        Parameters
        ----------
        path : path-like
            The URDF, or its text, with meshes as for :meth:`cspace.Robot.from_urdf`.
        srdf : path-like, optional
            An SRDF file, or its text, with groups, group states, and the links that may touch:
            pairs of ``disable_collisions``, and all of a link of ``disable_default_collisions``
            except those of ``enable_collisions``. Pairs with ``reason="Never"`` are tested, since
            MoveIt's assistant only sampled them. Links and joints missing from the URDF are
            skipped with one warning. Without an SRDF, links may touch if they belong to one body,
            if a joint connects them, directly or over links without geometry, or if they touch in
            each of 100 fixed random configurations.
        tip : str, optional
            Only the joints between the base and this link move; by default all move.
        base : str, optional
            The link whose frame is that of obstacles; only links below it are read. The root, by
            default.
        joints : str or iterable of str, optional
            Only these joints move: a group of the SRDF, or names of joints. Not together with
            ``tip``.
        held_joints : mapping of str to float, optional
            Values of joints that do not move, radians or metres. By default they are at zero, or at
            their nearest limit. Of :class:`cspace.arms.JointValues`, those of other joints are
            skipped.
        solid : {"auto", "surface"}
            Parts of the meshes that are solid: their closed bodies, or none. ``"fill"`` needs a
            spacing, which arms do not have.
        package_dirs : path-like or sequence of path-like, optional
            Folders that contain the folders of ROS packages.
        visuals : bool
            Use the visual geometry of links without collision geometry. By default a warning names
            such links, and no proof covers them.
        spheres : path-like, optional
            A file of spheres, as for :meth:`cspace.Robot.from_urdf`. Proofs are about the spheres.

        Raises
        ------
        FileError
            If a file is missing or malformed, or a mesh name matches several files.
        InputError
            If a folder, link, joint or group does not exist, no joint moves, limits are missing,
            reversed or exceeded by a held joint, a joint below the base has another type, or no
            link has a collision geometry.
        """
        from cspace.arms._reading.urdf import (
            Srdf,
            load_urdf,
            name_description,
            package_folders,
            read_srdf,
            root_link,
        )

        check_word(solid, "solid", ("auto", "surface"))
        folders = package_folders(package_dirs)
        urdf = load_urdf(path, visuals, spheres)
        file = name_description(path)
        for argument, link in (("tip", tip), ("base", base)):
            if link is not None:
                check_known(link, argument, urdf.links)
        if tip is not None and joints is not None:
            raise InputError(
                "joints",
                "is given with tip",
                "both say which joints move",
            )
        base = base or root_link(urdf)
        sorted_joints = _sort_joints(urdf.joints.values(), base)
        read_joints = [_read_joint(joint, file) for joint in sorted_joints]
        joints_below = {joint.name: joint for joint in read_joints}
        semantics = Srdf({}, set(), {}, {}, set()) if srdf is None else read_srdf(srdf, urdf)
        chosen = None if joints is None else _choose_joints(joints, semantics.groups, joints_below)
        builder = _ArmBuilder(file, urdf, joints_below, base, tip, chosen)
        builder.hold_joints({} if held_joints is None else held_joints)
        arm = builder.build_arm(semantics, folders, solid)
        # Only an SRDF says which links may touch; without one, the geometry does.
        if srdf is None:
            arm = replace(arm, allowed_collisions=builder.find_allowed_pairs(arm))
        source = "" if srdf is None else name_description(srdf)
        arm._warn_of_contacts(source)
        passive = [joint for joint in arm.joints if joint in semantics.passive_joints]
        if isinstance(held_joints, JointValues):
            arm._warn_of_followers(held_joints, "held_joints")
        if passive:
            warn_user(
                f"{source}: says that {', '.join(passive)} have no motor, and plans move them"
            )
        return arm

    @property
    def dof(self) -> int:
        """Number of joints of a configuration."""
        return len(self.joints)

    def __repr__(self) -> str:
        """Return name, joints, links with geometry, and pairs that no proof tests."""
        size = f"{self.name}: {self.dof} joints, {len(self.links)} links with geometry"
        return f"Arm({'; '.join(filter(None, (size, tell_untested(self._untested))))})"

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames of links and attached objects."""
        return tuple(self.placements)

    def pose(self, q: ArrayLike, frame: str) -> Floats:
        """Return the pose of a frame at configurations: its forward kinematics.

        Parameters
        ----------
        q : array-like, shape (..., dof)
            Radians and metres.
        frame : str
            One of :attr:`frames`: a link, with geometry or without, or an attached object.

        Returns
        -------
        ndarray of float64, shape (..., 4, 4)
            From the frame to that of the base, metres.

        Raises
        ------
        InputError
            If the frame is unknown, or q is not of finite numbers, one for each joint.
        """
        points = self._check_configurations(q, "q")
        body, pose = self.placements[check_known(frame, "frame", self.placements)]
        return np.asarray(compute_poses(self.chain, points, [body])[..., 0, :, :] @ pose)

    def poses(self, q: ArrayLike) -> dict[str, Floats]:
        """Return all frames' poses by name; see :meth:`pose`.

        Parameters
        ----------
        q : array-like, shape (..., dof)

        Returns
        -------
        dict of str to ndarray of float64, shape (..., 4, 4)
        """
        poses = compute_poses(self.chain, self._check_configurations(q, "q"))
        return {
            name: poses[..., body, :, :] @ pose for name, (body, pose) in self.placements.items()
        }

    def link_speed(
        self,
        link: str,
        q: ArrayLike,
        velocity: ArrayLike,
        within: ArrayLike = 0.0,
        max_velocity: ArrayLike | None = None,
        max_acceleration: ArrayLike | None = None,
    ) -> Floats:
        """Return the largest speed of a point of a link, or a bound for a while.

        Parameters
        ----------
        link : str
            One of :attr:`frames`. Its points are those of its geometry, and the origin of its
            frame.
        q, velocity : array-like, shape (..., dof)
            Configurations, and the velocities of the joints there, rad/s and m/s.
        within : array-like, shape () or (...)
            Seconds before and after for which the bound holds, while the joints keep their limits.
        max_velocity, max_acceleration : array-like, shape (..., dof), optional
            Largest ones of the joints in that time; by default those of ``velocity``, and none.

        Returns
        -------
        ndarray of float64, shape (...)
            m/s, in the frame of the base.

        Raises
        ------
        InputError
            If the link is unknown, or a number is not finite or has another shape.
        """
        check_known(link, "link", self.placements)
        names = "q", "velocity", "max_velocity", "max_acceleration"
        given = (
            q,
            velocity,
            velocity if max_velocity is None else max_velocity,
            np.zeros(self.dof) if max_acceleration is None else max_acceleration,
        )
        rows = [check_points(*each, self.joints) for each in zip(given, names, strict=True)]
        turns = np.array(self.units) == "rad"
        warn_of_large(rows[1][..., turns], "rad/s", "velocity")
        seconds = check_finite(within, "within")
        shapes = [*(each.shape for each in rows), (*seconds.shape, 1)]
        try:
            shape = np.broadcast_shapes(*shapes)
        except ValueError as error:
            rule = f"those of {', '.join(names[1:])} and within must fit: {shapes[1:]}"
            raise InputError("q", f"has shape {shapes[0]}", rule) from error
        motion = np.array([np.broadcast_to(each, shape) for each in rows])
        solids = [solid for solid in self.links if solid.name == link]
        times = np.broadcast_to(seconds, shape[:-1])
        return bound_speeds(self.chain, self.placements[link], solids, motion, times)

    @names_options
    def inverse(
        self,
        frame: str,
        pose: ArrayLike,
        *,
        tolerance: tuple[float, float] = DEFAULT_TOLERANCE,
        near: ArrayLike | None = None,
        max_solutions: int = 16,
        seed: int = 0,
    ) -> Floats:
        """Return configurations that bring a frame to a pose: its inverse kinematics.

        Damped least squares from ``near``, then from random starts, until 64 starts in a row find
        nothing new, at most 256. Collisions are not tested; see :meth:`ArmSpace.is_free`.

        The result is not complete. A branch that few starts lead to may be missing. If the joints
        can move without moving the frame, the configurations are a sample of infinitely many. If
        several whole turns of a joint lie within its limits, only the nearest to ``near`` counts.
        So a pose that no start reaches is not proven out of reach. Larger ``max_solutions`` and
        other seeds find more.

        Of many poses, the result has one configuration each, or NaN if none was found. NaN proves
        nothing, except farther from the base than the links together are long: such poses are not
        searched.

        Parameters
        ----------
        frame : str
            One of :attr:`frames`.
        pose : array-like, shape (4, 4) or (n, 4, 4)
            From the frame to that of the base, metres, as :meth:`pose` returns it; or many.
        tolerance : pair of float
            Largest distance in metres, and largest angle in radians, from the pose. One may be
            infinite: ``(1e-3, math.inf)`` asks for the position alone.
        near : array-like, shape (dof,), optional
            Configuration that gives the values of all joints that do not move the frame. By default
            they are at zero, or at their nearest limit.
        max_solutions : int
            Largest number of configurations. A 6-joint arm has up to 16 for each pose, a ur5 up to
            8, a 7-joint arm infinitely many.
        seed : int
            Seed of the random starts.

        Returns
        -------
        ndarray of float64, shape (n, dof)
            Distinct configurations within the limits, n from 1 to ``max_solutions``; the nearest to
            ``near`` in the joints is the first. Of n poses, that one each, or a row of NaN. Joints
            of which a whole turn changes nothing are within half a turn of ``near``, or as near as
            their limits allow.

        Raises
        ------
        ConfigurationError
            If no start reaches the only pose. The message names the distance and angle of the
            nearest pose reached, and ``nearest`` is its configuration. Also if ``near`` is more
            than 1e-5 rad (m) beyond the limits.
        InputError
            If the frame is unknown or no joint moves it, the pose is no rigid motion, or a number
            is out of range.
        """
        poses = check_finite(pose, "pose")
        if poses.ndim != 3:
            goal = PoseGoal(frame, poses, tolerance)
            return self._solve_pose(goal, "pose", near, max_solutions, seed)
        _, tool = self._branch_to(frame)
        body, _ = self.placements[frame]
        near = self._rest if near is None else self._check_configuration(near, "near")
        rows = np.full((len(poses), self.dof), np.nan)
        # The links are together that long; a share for rounding.
        reach = (1.0 + 1e-9) * (self.chain.lengths[0, body] + np.linalg.norm(tool[:3, 3]))
        for k, each in enumerate(poses):
            goal = PoseGoal(frame, check_rigid(each, f"pose[{k}]"), tolerance)
            if np.linalg.norm(each[:3, 3]) > reach + goal.tolerance[0]:
                continue
            with suppress(ConfigurationError):
                rows[k] = self._solve_pose(goal, "pose", near, max_solutions, seed)[0]
        return rows

    def _solve_pose(
        self, goal: PoseGoal, name: str, near: ArrayLike | None, max_solutions: int, seed: int
    ) -> Floats:
        """Find configurations, shape (n, dof), that reach a pose goal; see :meth:`inverse`.

        ``name`` is the argument that errors name. Raises ConfigurationError without a solution.
        """
        branch, tool = self._branch_to(goal.frame)
        q = self._rest if near is None else self._check_configuration(near, "near")
        q = self._clamp(q)
        # Only the joints between the base and the frame are solved for; q gives all others.
        joints = branch.joints
        lowest, highest = self._ranges(q)
        result = solve_pose(
            branch,
            tool,
            goal,
            limits=(self.lower[joints], self.upper[joints]),
            ranges=(lowest[joints], highest[joints]),
            near=q[joints],
            whole_turns=self._whole_turns[joints],
            max_solutions=check_count(max_solutions, "max_solutions", 1),
            rng=np.random.default_rng(check_count(seed, "seed")),
        )
        if not len(result.joints):
            q[joints] = result.nearest
            max_distance, max_angle = goal.tolerance
            gap = f"{tell_apart(result.distance, max_distance, 3)[0]} m"
            tolerance = f"{max_distance:g} m"
            if math.isfinite(max_angle):
                gap += f" and {tell_apart(result.angle, max_angle, 3)[0]} rad"
                tolerance += f" and {max_angle:g} rad"
            raise ConfigurationError(
                name,
                f"is out of reach of {goal.frame}: the nearest pose that it reached is {gap} away",
                f"it must be within {tolerance}",
                nearest=tuple(q.tolist()),
            )
        solutions = np.tile(q, (len(result.joints), 1))
        solutions[:, joints] = result.joints
        distances = np.linalg.norm(solutions - q, axis=1)
        nearest_first = np.argsort(distances, kind="stable")
        return solutions[nearest_first]

    def _branch_to(self, frame: str) -> tuple[Branch, Floats]:
        """Return the bodies to a frame, and its pose on the last.

        Raises InputError if the frame is unknown or no joint moves it.
        """
        body, tool = self.placements[check_known(frame, "frame", self.placements)]
        is_fixed_to_base = body == 0
        if is_fixed_to_base:
            raise InputError(
                "frame",
                f"is {frame!r}",
                "no joint of the arm moves it",
            )
        return branch_to(self.chain, body), tool

    @property
    def _whole_turns(self) -> Bools:
        """Whether whole turns of each joint, shape (dof,), change no pose.

        A joint that moves another joint by a fraction of its angle is excluded.
        """
        chain = self.chain
        # A body turns wholly with its joint if it follows by a whole multiple of the angle.
        turns_wholly = (chain.kinds == REVOLUTE) & (chain.factors % 1.0 == 0.0)
        differs_after_turn = (chain.kinds != FIXED) & ~turns_wholly
        repeats = np.ones(self.dof, dtype=np.bool_)
        repeats[chain.joint_indices[differs_after_turn]] = False
        return repeats

    @cached_property
    def _angles(self) -> dict[int, str]:
        """Names of continuous joints that repeat after a turn, by index."""
        is_continuous = np.isinf(self.upper) & self._whole_turns
        return {k: self.joints[k] for k in np.flatnonzero(is_continuous).tolist()}

    @cached_property
    def named_configurations(self) -> dict[str, Floats]:
        """Group states of the SRDF, each shape (dof,), read-only.

        They are named ``"GROUP/STATE"``, such as ``"panda_arm/ready"``; ``"STATE"`` if one has no
        group. Joints missing from a state are at zero, or at their nearest limit.
        """
        return {
            name: frozen(self._move_joints(self._rest, self._find_group_state(name, "name")))
            for name in self._states
        }

    @names_options
    def configuration(
        self,
        values: Mapping[str, float] | str | object | None = None,
        base: ArrayLike | str | None = None,
    ) -> Floats:
        """Return the configuration with given joint values, by name.

        Parameters
        ----------
        values : mapping of str to float, message, or str, optional
            Values of joints, radians or metres, such as ``{"elbow": 1.0}``; or a group state of the
            SRDF, such as ``"panda_arm/ready"``, or ``"ready"`` if only one group has a state of
            that name. Of :class:`cspace.arms.JointValues`, and of a ``sensor_msgs/JointState``,
            those of other joints are skipped.
        base : array-like, shape (dof,), or str, optional
            Configuration that gives the values of all other joints; or a group state. By default
            they are at zero, or at their nearest limit.

        Returns
        -------
        ndarray of float64, shape (dof,)

        Raises
        ------
        InputError
            If a joint or state is unknown, or a value is not one finite number. If
            :class:`cspace.arms.JointValues` have a joint elsewhere than the arm holds it, or lack
            one of :attr:`joints` without a ``base``.
        ConfigurationError
            If a value is more than 1e-5 rad (m) beyond the joint's limits.
        """
        # The base gives the values of all joints that are not named.
        if isinstance(base, str):
            state = self._find_group_state(base, "base")
            q = self._move_joints(self._rest, state)
            self._check_limits(q, "base")
            self._warn_of_followers(state, "base", q)
        else:
            q = self._rest if base is None else self._check_configuration(base, "base")
        is_empty = values is None or (isinstance(values, dict) and not values)
        given: Any = {} if is_empty else values
        if hasattr(given, "to_dict"):  # a Series of pandas
            given = given.to_dict()
        named: Mapping[str, float] = {}
        if isinstance(values, str):
            named = self._find_group_state(values, "values")
            given = {joint: value for joint, value in named.items() if joint in self.joints}
        fields = Ledger.list_fields(given, ("name", "position")) or {}
        if {"name", "position"} <= fields.keys():
            given = JointValues(read_joint_state(fields, "values"))
        if isinstance(given, JointValues):
            named = given
            given = self._select_moving_joints(given, needs_all=base is None)
        moved = self._move_joints(q, check_joint_values(given, "values", self.joints))
        self._check_limits(moved, "values")
        warn_of_large(moved, "rad", "values", self._angles)
        self._warn_of_followers(named, "values", moved)
        return moved

    def _warn_of_followers(
        self, values: Mapping[str, float], argument: str, q: Floats | None = None
    ) -> None:
        """Warn of values of joints elsewhere than the joints that they mimic put them.

        These are where a configuration ``q`` puts them, or else at their own values.
        """
        leaders = {} if q is None else dict(zip(self.joints, q.tolist(), strict=True))
        values = {**values, **leaders}
        for joint in self._followers:
            leader = values.get(joint.leader, math.nan) if joint.factor else 0.0
            place = joint.factor * leader + joint.offset
            gap = values.get(joint.name, math.nan) - place
            if joint.kind == REVOLUTE:
                gap = math.remainder(gap, math.tau)
            if abs(gap) > LIMIT_SLACK:
                warn_user(
                    f"{argument}: {joint.name} is at {values[joint.name]:.6g}, but it mimics "
                    f"{joint.leader}, which puts it at {place:.6g}; proofs are for that place"
                )

    def _select_moving_joints(self, values: JointValues, needs_all: bool) -> dict[str, float]:
        """Select the arm's joint values from a whole robot's.

        Raise InputError if another joint is unknown or held elsewhere, or if ``needs_all`` and one
        of the arm's joints has no value.
        """
        known = *self.joints, *self.held_joints, *sorted(self._passive)
        checked = check_joint_values(values, "values", known)
        for joint, held_value in self.held_joints.items():
            value = checked.get(joint, held_value)
            if abs(value - held_value) > LIMIT_SLACK:
                raise InputError(
                    "values",
                    f"has {joint} at {value:.12g}",
                    f"the arm holds it at {held_value:.12g}",
                )
        missing = [joint for joint in self.joints if joint not in checked]
        if missing and needs_all:
            raise InputError(
                "values",
                f"lack {', '.join(missing)}",
                "they are values of all joints of a robot",
            )
        return {joint: checked[joint] for joint in self.joints if joint in checked}

    @property
    def _rest(self) -> Floats:
        """Configuration of all joints at zero, or at their nearest limit."""
        return self._clamp(np.zeros(self.dof))

    def _move_joints(self, q: Floats, values: Mapping[str, float]) -> Floats:
        """Return a configuration, shape (dof,), with some joints at given values."""
        before = dict(zip(self.joints, q.tolist(), strict=True))
        return np.array([values.get(joint, before[joint]) for joint in self.joints])

    def _find_group_state(self, name: str, argument: str) -> dict[str, float]:
        """Find an SRDF group state's values of joints.

        The name is ``"GROUP/STATE"``, or ``"STATE"`` if only one group of the arm has it. Raises
        InputError that blames ``argument`` if no state has the name, or several have.
        """
        if not self._states:
            raise InputError(
                argument,
                f"is {name!r}",
                "the arm has none",
            )
        # States of other groups do not compete for the short name.
        full_names = []
        for full_name, state in self._states.items():
            _, _, state_name = full_name.partition("/")
            if state_name == name and not state.keys().isdisjoint(self.joints):
                full_names.append(full_name)
        if name in self._states:
            full_names = [name]
        if len(full_names) != 1:
            check_known(name, argument, full_names or self._states)  # raises InputError
        return self._states[full_names[0]]

    @names_options
    def spheres(
        self,
        *,
        number: int | Mapping[str, int] | None = None,
        tolerance: float | None = None,
        kind: Literal["inner", "outer"] = "outer",
        progress: Callable[[int, int], None] | None = None,
    ) -> SphereModel:
        """Find balls that cover each link, or lie inside it.

        What the balls cover is proven, not sampled; see :func:`cspace.spectral.decompose`.

        Parameters
        ----------
        number : int or mapping of str to int, optional
            Largest number of balls of each link, or numbers by the names of the links.
        tolerance : float, optional
            Metres. Largest length by which outer balls stick out of the link; for "inner", largest
            distance of a point of the link from the balls. Pass either this or ``number``.
        kind : {"outer", "inner"}
            Whether the balls cover the link, or each lies inside it. A link without an inside gets
            no inner balls, and a warning names it.
        progress : callable, optional
            Called with (links done, all links).

        Returns
        -------
        SphereModel
            The balls of each link, in its frame.

        Raises
        ------
        GeometryError
            If no link has an inside for inner balls.
        InputError
            If both or neither of ``number`` and ``tolerance`` are passed, an argument is not
            usable, an attached object consists of balls, or balls cannot meet the tolerance.
        """
        from cspace.arms._sphere_models import find_spheres

        links = [(link, self.placements[link.name].pose) for link in self.links]
        return find_spheres(self.name, links, number, tolerance, kind, progress)

    @names_options
    def attach(
        self,
        name: str,
        shape: ShapeLike,
        link: str,
        pose: ArrayLike | None = None,
        touch_links: Iterable[str] = (),
    ) -> Arm:
        """Return the arm with an attached object, such as a tool.

        Parameters
        ----------
        name : str
            A name that no frame has. It becomes that of the object's own frame.
        shape : Shape, trimesh.Trimesh, path-like, or anything else that
        :meth:`cspace.CSpace.add_obstacle` takes
            In space, metres, e.g. ``trimesh.creation.box((0.1, 0.1, 0.2))``.
        link : str
            The link that carries the object and may touch it; any of :attr:`frames`, such as
            ``"tool0"``.
        pose : array-like, shape (4, 4), optional
            From the object's frame to that of the link; the identity by default.
        touch_links : str or iterable of str
            Other links that may touch it.

        Raises
        ------
        InputError
            If the name is taken, a link is unknown, the shape is invalid or in the plane, or the
            pose is no rigid motion.
        """
        solid_shape = as_shape(shape)
        if solid_shape.dim != 3:
            raise InputError("shape", "is in the plane", "arms are in space")
        check_text(name, "name")
        touching = [link, *check_names(touch_links, "touch_links")]
        if name in self.placements:
            raise InputError("name", f"is {name!r}", "a link has it")
        for other in touching:
            check_known(other, "link", self.placements)
        # The object moves with the body of its link, so its pose is one on that body.
        body, pose_on_body = self.placements[link]
        if pose is not None:
            pose_on_body = pose_on_body @ check_rigid(pose, "pose")
        solid = Solid(name, body, (Part(solid_shape, pose_on_body),))
        # Frames without geometry touch nothing, so only links count.
        with_geometry = [other.name for other in self.links]
        allowed = {sort_pair(name, other): "held" for other in touching if other in with_geometry}
        return replace(
            self,
            links=(*self.links, solid),
            allowed_collisions=self.allowed_collisions | allowed,
            placements=self.placements | {name: Frame(body, pose_on_body)},
            carriers=self.carriers | {name: link},
        )

    def detach(self, name: str) -> Arm:
        """Return the arm without an attached object.

        Raises
        ------
        InputError
            If no attached object has the name, or another one is attached to it.
        """
        check_known(name, "name", self.carriers)
        # Nothing may hang on an object that is gone.
        for other, carrier in self.carriers.items():
            if carrier == name:
                raise InputError(
                    "name",
                    f"is {name!r}",
                    f"it carries {other!r}",
                )
        return replace(
            self,
            links=tuple(link for link in self.links if link.name != name),
            allowed_collisions={
                pair: reason for pair, reason in self.allowed_collisions.items() if name not in pair
            },
            placements={frame: pose for frame, pose in self.placements.items() if frame != name},
            carriers={item: carrier for item, carrier in self.carriers.items() if item != name},
        )

    @cached_property
    def pairs(self) -> dict[Names, str]:
        """Every two links with geometry, and whether they may or do touch.

        The value is the reason why they may touch, as in :attr:`allowed_collisions`. Otherwise it
        says how often they touch in 1000 fixed random configurations: ``"never"``, ``"sometimes"``
        or ``"always"``. Every proof checks all other pairs, because sampling proves nothing.
        """
        # Links that do not move against each other keep the first reason.
        reasons = {sort_pair(a.name, b.name): "one body" for a, b in combinations(self.links, 2)}
        for pair, scene in self._moving_pairs().items():
            is_apart = are_free(scene, self._contact_samples, self._contact_samples)
            reasons[pair] = "sometimes" if is_apart.any() else "always"
            if is_apart.all():
                reasons[pair] = "never"
        for pair, reason in self.allowed_collisions.items():
            if pair in reasons:
                reasons[pair] = reason
        return reasons

    @property
    def _untested(self) -> list[Names]:
        """Pairs of links that may touch, and that joints move."""
        bodies = {link.name: link.body for link in self.links}
        return list_untested(bodies, self.allowed_collisions)

    def _warn_of_contacts(self, source: str) -> None:
        """Warn of pairs that often touch although the SRDF ``source`` says that they never do."""
        samples = self._contact_samples[:100]
        counts = {}
        for pair, scene in self._moving_pairs().items() if self._never else ():
            if pair in self._never:
                counts[pair] = np.count_nonzero(~are_free(scene, samples, samples))
        touching = [pair for pair, count in counts.items() if count > 10]
        if touching:
            warn_user(
                f"{source}: gives the reason Never to {touching}, and they touch in up to "
                f"{max(counts.values())} of {len(samples)} random configurations, which are not "
                "FREE; allowed_collisions= of build_arm_space lets them touch"
            )

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the arm without the packed trees of its links, which are large."""
        return {name: value for name, value in vars(self).items() if name != "_packed"}

    @cached_property
    def _packed(self) -> PackedParts:
        """The outer parts of all links, for scenes."""
        return pack_parts([outer for link in self.links for outer, _ in link.bounds_pairs])

    def _moving_pairs(self) -> dict[Names, ArmScene]:
        """Return a scene of each two links that move mutually, by name."""
        links = self.links
        # Kernels expect that the second body of a pair comes first in the chain.
        pairs = [
            (i, j) for i, j in permutations(range(len(links)), 2) if links[i].body > links[j].body
        ]
        scene = make_scene(self.chain, links, pairs, self._packed)
        scenes = {}
        for number, (i, j) in enumerate(pairs):
            names = sort_pair(links[i].name, links[j].name)
            scenes[names] = scene.select_pairs(slice(number, number + 1))
        return scenes

    @cached_property
    def _contact_samples(self) -> Floats:
        """Random configurations to find constant contacts."""
        return np.random.default_rng(0).uniform(*self._ranges(), (CONTACT_SAMPLES, self.dof))

    def _ranges(self, around: ArrayLike = 0.0) -> tuple[Floats, Floats]:
        """Return lowest and highest finite joint values, shapes (dof,).

        They are the limits. A joint without limits gets half a turn to each side of the
        configurations ``around``, shape (n, dof) or a number for all joints.
        """
        q = np.atleast_2d(around)
        lowest = np.where(np.isinf(self.lower), q.min(axis=0) - math.pi, self.lower)
        highest = np.where(np.isinf(self.upper), q.max(axis=0) + math.pi, self.upper)
        return lowest, highest

    def _check_limits(self, q: Floats, name: str) -> None:
        """Raise ConfigurationError if a joint exceeds a limit by more than :data:`LIMIT_SLACK`.

        ``q`` are configurations, shape (..., dof).
        """
        excess = np.maximum(self.lower - q, q - self.upper)
        # The error names the first joint that exceeds a limit.
        for *row, joint in np.argwhere(excess > LIMIT_SLACK)[:1].tolist():
            value = float(q[*row, joint])
            raise ConfigurationError(
                name,
                f"has {self.joints[joint]} at {value:.12g}",
                f"its limits are {self.lower[joint]:.12g} and {self.upper[joint]:.12g}",
            )

    def _clamp(self, q: Floats) -> Floats:
        """Clamp configurations, shape (..., dof), to the limits."""
        return np.asarray(q.clip(self.lower, self.upper))

    def _check_configurations(self, q: ArrayLike, name: str) -> Floats:
        """Return configurations, shape (..., dof), as floats.

        Raises
        ------
        InputError
            If the last axis is not dof long, labels are not the joints, or a value is not finite.
        """
        points = check_points(q, name, self.joints)
        warn_of_large(points, "rad", name, self._angles)
        return points

    def _check_configuration(self, q: ArrayLike | None, name: str) -> Floats:
        """Return one configuration, shape (dof,), as floats.

        Raises InputError if it is missing or has another shape, and ConfigurationError if it is
        beyond the limits.
        """
        point = np.empty((0, 0)) if q is None else self._check_configurations(q, name)
        if point.ndim != 1:
            raise InputError(
                name,
                "is missing" if q is None else f"has shape {point.shape}",
                f"it must be one configuration: {', '.join(self.joints)}",
            )
        self._check_limits(point, name)
        return point


def sort_pair(one: str, other: str) -> Names:
    """Return two names in alphabetical order."""
    return (one, other) if one < other else (other, one)


def list_untested(bodies: Mapping[str, int], pairs: Iterable[Names]) -> list[Names]:
    """Return those of the ``pairs`` that are on two of the ``bodies``."""
    known = [pair for pair in pairs if bodies.keys() >= {*pair}]
    return [(one, other) for one, other in known if bodies[one] != bodies[other]]


def tell_untested(pairs: Sequence[Names]) -> str:
    """Return a text with the number and the first of pairs that no proof tests, if any."""
    named = [f"{one} and {other}" for one, other in pairs[:3]]
    if len(pairs) > len(named):
        named.append("...")
    return f"pairs not tested ({len(pairs)}): {', '.join(named)}" if pairs else ""


def check_joint_values(values: object, argument: str, joints: Collection[str]) -> dict[str, float]:
    """Return values of joints by name as floats, after checking them.

    Raises InputError if they are no mapping, name a joint not in ``joints``, or are not finite
    numbers.
    """
    checked = {}
    for joint, value in check_mapping(values, argument, joints).items():
        place = f"{argument}[{joint!r}]"
        number = check_finite(value, place)
        if number.ndim:
            raise InputError(
                place,
                f"has shape {number.shape}",
                "a joint has one number",
            )
        checked[joint] = float(number)
    return checked


def _choose_joints(
    joints: str | Iterable[str], groups: Mapping[str, Set[str]], all_joints: Mapping[str, Joint]
) -> Set[str]:
    """Return the names of moving joints, of an SRDF group or given.

    Raise InputError if the group is unknown, or a named joint cannot move by itself.
    """
    if isinstance(joints, str):
        if not groups:
            raise InputError(
                "joints",
                f"is {joints!r}",
                "no SRDF gives groups",
            )
        return groups[check_known(joints, "joints", groups)]
    names = check_names(joints, "joints")
    movable = [name for name, joint in all_joints.items() if is_independent(joint)]
    return {check_known(name, "joints", movable, "names") for name in names}


def is_independent(joint: Joint) -> bool:
    """Return True if a joint can move by itself."""
    return joint.kind != FIXED and joint.leader == joint.name


def _read_joint(joint: JointDescription, file: str) -> Joint:
    """Convert and check a joint; errors name it."""
    where = f"{file}: joint {joint.name!r}"
    if joint.type not in _JOINT_KINDS:
        raise InputError(
            where,
            f"is of type {joint.type!r}",
            f"below the base, joints are {', '.join(_JOINT_KINDS)}",
            f"pass base={joint.child!r}",
        )
    kind = _JOINT_KINDS[joint.type]
    ends = np.stack([np.zeros(3), joint.frame[:3, 3]])
    warn_of_size(f"{where}: the way from its parent", ends)
    velocity = (joint.limits or {}).get("velocity", 0.0)
    if velocity < 0.0:
        raise InputError(f"{where}: velocity", f"is {velocity:g}", "a speed has no sign")
    # Continuous joints have no limits.
    lower = -math.inf
    upper = math.inf
    if joint.type == "continuous":
        _warn_of_unused_limits(joint, where)
    if joint.type in ("revolute", "prismatic"):
        lower, upper = _read_limits(joint, where)
    # A joint that mimics no other is its own leader.
    leader = joint.name
    factor = 1.0
    offset = 0.0
    if joint.mimic is not None and kind != FIXED:
        leader, factor, offset = joint.mimic
    return Joint(
        name=joint.name,
        kind=kind,
        parent=joint.parent,
        child=joint.child,
        frame=joint.frame,
        axis=joint.axis if kind == FIXED else joint.axis / np.linalg.norm(joint.axis),
        lower=lower,
        upper=upper,
        leader=leader,
        factor=factor,
        offset=offset,
        max_velocity=velocity if velocity > 0.0 else math.inf,
    )


def _warn_of_unused_limits(joint: JointDescription, where: str) -> None:
    """Warn of limits of a continuous joint, which do not count."""
    hard = joint.limits or {}
    soft = joint.soft_limits or {}
    for lower, upper in (
        (hard.get("lower", 0.0), hard.get("upper", 0.0)),
        (soft.get("soft_lower_limit", 0.0), soft.get("soft_upper_limit", 0.0)),
    ):
        # Often both are zero, or far enough apart for every angle.
        if 0.0 < upper - lower < math.tau - LIMIT_SLACK:
            warn_user(
                f"{where}: a continuous joint has no limits, so {lower} and {upper} do not count, "
                "by the format"
            )


def _read_limits(joint: JointDescription, where: str) -> tuple[float, float]:
    """Return a joint's limits, radians or metres.

    Raise InputError, which begins with ``where``, if limits are missing or reversed.
    """
    limits = joint.limits
    if limits is None:
        raise InputError(
            where,
            "has no limits",
            "revolute and prismatic joints have",
        )
    if limits.keys().isdisjoint(("lower", "upper")):
        warn_user(
            f"{where}: <limit> has neither lower nor upper, which are zero then, by the format, so "
            "the joint does not move"
        )
    # Soft limits count if they are narrower, as for MoveIt.
    soft = joint.soft_limits or {}
    lower = max(limits.get("lower", 0.0), soft.get("soft_lower_limit", -math.inf))
    upper = min(limits.get("upper", 0.0), soft.get("soft_upper_limit", math.inf))
    if lower > upper:
        raise InputError(
            f"{where}: limits",
            f"are {lower:.12g} and {upper:.12g}",
            "the lower one must not be above the upper one",
        )
    return lower, upper


class _ArmBuilder:
    """Builder of an :class:`Arm` from the links and joints of a URDF.

    First choose the joints that move (the constructor), then hold the others
    (:meth:`hold_joints`), then build (:meth:`build_arm`).
    """

    def __init__(
        self,
        file: str,
        urdf: RobotDescription,
        joints: Mapping[str, Joint],
        base: str,
        tip: str | None,
        chosen: Set[str] | None,
    ) -> None:
        """Choose the joints between ``base`` and ``tip``, or those ``chosen``.

        ``joints`` are those below the base, by name and in order. Without a tip, all branches
        count. Raises InputError if no joint moves.
        """
        self._file = file
        self._urdf = urdf
        self._joints = joints
        self._base = base
        self._held: dict[str, float] = {}
        self._order = list(joints.values())
        joint_above = {joint.child: joint for joint in self._order}
        branch = set(joint_above) if tip is None else _list_links_to(tip, base, joint_above)
        # The index of each joint that moves, in a configuration.
        self._moving_names: dict[str, int] = {}
        for joint in self._order:
            is_chosen = chosen is None or joint.name in chosen
            if is_independent(joint) and joint.child in branch and is_chosen:
                self._moving_names[joint.name] = len(self._moving_names)
        # Leaders are checked last, because that needs the names of all joints that move.
        leaders = {joint.name for joint in self._order if joint.leader == joint.name}
        for joint in self._order:
            self._check_leader(joint, leaders)
        if not self._moving_names:
            raise InputError(
                file,
                "has no joint that moves there",
                "an arm has at least one",
            )

    def _check_leader(self, joint: Joint, leaders: Set[str]) -> None:
        """Raise InputError for an unknown leader, or endless sliding."""
        where = f"{self._file}: joint {joint.name!r}"
        leader = self._joints[check_known(joint.leader, where, leaders, "mimics")]
        if joint.kind == PRISMATIC and self._is_moved(joint) and math.isinf(leader.upper):
            raise InputError(
                where,
                f"mimics {leader.name!r}",
                "a prismatic joint would slide without end",
            )

    def _is_moved(self, joint: Joint) -> bool:
        """Return True if the arm's configuration moves a joint."""
        return joint.kind != FIXED and joint.leader in self._moving_names and joint.factor != 0.0

    def hold_joints(self, values: Mapping[str, float]) -> None:
        """Hold joints that do not move, at given values or rest.

        ``values`` are radians or metres by name. Raises InputError if one exceeds a limit.
        """
        still_names = [
            joint.name
            for joint in self._order
            if is_independent(joint) and joint.name not in self._moving_names
        ]
        # JointValues are those of a whole robot, so they may also name joints that move.
        if isinstance(values, JointValues):
            check_joint_values(values, "held_joints", self._urdf.joints)
            values = {name: values[name] for name in still_names if name in values}
        given = check_joint_values(values, "held_joints", still_names)
        for name in still_names:
            self._held[name] = given.get(name, _find_rest_value(self._joints[name]))
        for name, value in given.items():
            joint = self._joints[name]
            if not joint.lower - LIMIT_SLACK <= value <= joint.upper + LIMIT_SLACK:
                raise InputError(
                    "held_joints",
                    f"has {name} at {value:.12g}",
                    f"its limits are {joint.lower:.12g} and {joint.upper:.12g}",
                )
            if joint.kind == REVOLUTE:
                warn_of_large(value, "rad", f"held_joints: {name}")

    def build_arm(self, srdf: Srdf, package_dirs: Sequence[Path], inside: SolidMode) -> Arm:
        """Build the arm from joints, links and SRDF groups.

        ``inside`` says which parts of the meshes are solid.
        """
        # A joint that moves begins a new body, with the child link's frame as its own. Any other
        # joint fixes its child link to the body of its parent link.
        placements = {self._base: Frame(0, np.eye(4))}
        parents = [0]
        frames = [np.eye(4)]
        joints = list[Joint]()
        for joint in self._order:
            body, pose = placements[joint.parent]
            frame = pose @ joint.frame
            if self._is_moved(joint):
                parents.append(body)
                frames.append(frame)
                joints.append(joint)
                placements[joint.child] = Frame(len(joints), np.eye(4))
            else:
                placements[joint.child] = Frame(body, frame @ self._compute_fixed_pose(joint))
        if len(parents) > MAX_BODIES:
            raise InputError(
                self._file,
                f"has {len(parents)} bodies that move against each other",
                f"at most {MAX_BODIES} are allowed",
            )
        links = tuple(self._read_links(placements, package_dirs, inside))
        if not links:
            raise InputError(
                self._file,
                "has no collision geometry",
                "an arm's links need some",
            )
        # A joint that moves may move several bodies, because other joints mimic it.
        moving = [self._joints[name] for name in self._moving_names]
        groups = {}
        for group, members in srdf.groups.items():
            groups[group] = tuple(name for name in self._moving_names if name in members)
        return Arm(
            name=self._urdf.name,
            joints=tuple(self._moving_names),
            lower=np.array([joint.lower for joint in moving]),
            upper=np.array([joint.upper for joint in moving]),
            links=links,
            allowed_collisions=srdf.allowed,
            chain=self._build_chain(parents, frames, joints),
            units=tuple("m" if joint.kind == PRISMATIC else "rad" for joint in moving),
            max_velocity=np.array([self._limit_velocity(name) for name in self._moving_names]),
            groups=groups,
            held_joints=self._held,
            placements=placements,
            carriers={},
            _base_is_root=len(placements) == len(self._urdf.links),
            _followers=tuple(self._list_followers()),
            _passive=frozenset(self._urdf.joints.keys() - {*self._moving_names, *self._held}),
            _never=srdf.never,
            _states=srdf.states,
        )

    def find_allowed_pairs(self, arm: Arm) -> dict[Names, str]:
        """Find pairs that may touch without an SRDF, and reasons.

        These are links of one body, neighbours, and links that always touch.
        """
        allowed = {
            sort_pair(a.name, b.name): "one body"
            for a, b in combinations(arm.links, 2)
            if a.body == b.body
        }
        # The neighbour of a link is the nearest link with geometry above it. Parents come first, so
        # each link takes it from its parent.
        with_geometry = {link.name for link in arm.links}
        nearest = {self._base: self._base if self._base in with_geometry else None}
        for joint in self._order:
            neighbour = nearest[joint.parent]
            nearest[joint.child] = joint.child if joint.child in with_geometry else neighbour
            if neighbour is not None and joint.child in with_geometry:
                allowed.setdefault(sort_pair(joint.child, neighbour), "adjacent")
        # Two links that touch in all of these random configurations may touch without an SRDF.
        samples = arm._contact_samples[:100]
        for pair, scene in arm._moving_pairs().items():
            if pair not in allowed and always_touch(scene, samples):
                allowed[pair] = "always"
        return allowed

    def _limit_velocity(self, leader: str) -> float:
        """Return the largest speed that a joint and its mimics allow."""
        moved = [joint for joint in self._order if joint.leader == leader and self._is_moved(joint)]
        return min(joint.max_velocity / abs(joint.factor) for joint in moved)

    def _list_followers(self) -> Iterator[Joint]:
        """Yield the joints that mimic others; those that stand still have no factor."""
        for joint in self._order:
            if self._is_moved(joint) and joint.leader != joint.name:
                yield joint
            elif joint.leader != joint.name:
                yield joint._replace(factor=0.0, offset=self._find_fixed_value(joint))

    def _find_fixed_value(self, joint: Joint) -> float:
        """Return the position of a joint that the arm's configuration does not move."""
        leader = self._joints[joint.leader]
        position = self._held.get(leader.name, _find_rest_value(leader))
        return joint.factor * position + joint.offset

    def _compute_fixed_pose(self, joint: Joint) -> Floats:
        """Compute the pose (4, 4) of a still joint's child link."""
        from cspace.arms._reading.urdf import make_motion

        if joint.kind == FIXED:
            return np.eye(4)
        value = self._find_fixed_value(joint)
        return make_motion(value * joint.axis, slides=joint.kind == PRISMATIC)

    def _read_links(
        self,
        placements: Mapping[str, Frame],
        package_dirs: Sequence[Path],
        inside: SolidMode,
    ) -> Iterable[Solid]:
        """Read links with collision geometry, on their bodies."""
        from cspace.arms._reading.link_shapes import link_shapes
        from cspace.arms._reading.urdf import find_meshes, warn_of_visuals

        warn_of_visuals(self._urdf, placements, self._file)
        meshes = find_meshes(self._urdf, placements, self._file, package_dirs)
        for name, (body, pose) in placements.items():
            shapes = link_shapes(self._urdf, name, self._file, meshes, inside)
            parts = [Part(shape, pose @ shape_pose) for shape, shape_pose in shapes]
            if parts:
                yield Solid(name, body, tuple(parts))

    def _build_chain(self, parents: list[int], poses: list[Floats], joints: list[Joint]) -> Chain:
        """Build the chain of bodies for kernels.

        ``parents`` and ``poses``, shape (4, 4), of joints on their parents are one for each body,
        with the base first. ``joints`` are those of the other bodies, because the base has none.
        """
        # Kernels are compiled for contiguous arrays.
        frames = np.ascontiguousarray(np.stack(poses)[:, :3])
        link_lengths = np.linalg.norm(frames[..., 3], axis=1)
        # Which joints (columns) carry which bodies (rows).
        carries = np.zeros((len(parents), len(parents)), dtype=np.bool_)
        for body, joint in enumerate(joints, start=1):
            carries[body] = carries[parents[body]]
            carries[body, body] = True
            if joint.kind == PRISMATIC:
                # A joint that slides makes its link longer by its farthest position.
                leader = self._joints[joint.leader]
                ends = np.array([leader.lower - LIMIT_SLACK, leader.upper + LIMIT_SLACK])
                link_lengths[body] += np.abs(joint.factor * ends + joint.offset).max()
        # A joint moves two bodies against each other if it carries one and not the other.
        between = carries[:, np.newaxis] != carries[np.newaxis]
        indices = [self._moving_names[joint.leader] for joint in joints]
        chain = Chain(
            parents=np.array(parents, dtype=np.int64),
            frames=frames,
            axes=np.stack([np.zeros(3), *(joint.axis for joint in joints)]),
            kinds=np.array([FIXED, *(joint.kind for joint in joints)]),
            joint_indices=np.array([0, *indices]),
            factors=np.array([0.0, *(joint.factor for joint in joints)]),
            offsets=np.array([0.0, *(joint.offset for joint in joints)]),
            between=between,
            lengths=(between * link_lengths).sum(axis=2),
        )
        return keep(chain)


def _sort_joints(joints: Iterable[JointDescription], base: str) -> list[JointDescription]:
    """Return the joints below a link, depth first, then by name.

    So every body comes after its parent, in the order of urdfdom for MoveIt.
    """
    # The stack is read from its end, so the names are sorted in reverse.
    joints_below: dict[str, list[JointDescription]] = {}
    for joint in sorted(joints, key=lambda joint: joint.name, reverse=True):
        joints_below.setdefault(joint.parent, []).append(joint)
    order: list[JointDescription] = []
    pending = list(joints_below.get(base, ()))
    while pending:
        joint = pending.pop()
        order.append(joint)
        pending += joints_below.get(joint.child, ())
    return order


def _list_links_to(tip: str, base: str, joint_above: Mapping[str, Joint]) -> set[str]:
    """Return the links between a tip and the base.

    ``joint_above`` has the joint from which each link hangs. Raises InputError if the tip is not
    below the base.
    """
    links = set[str]()
    link = tip
    while link != base:
        if link not in joint_above:
            raise InputError("tip", f"is {tip!r}", f"it is not below {base!r}")
        links.add(link)
        link = joint_above[link].parent
    return links


def _find_rest_value(joint: Joint) -> float:
    """Return the value nearest zero within limits."""
    return min(max(0.0, joint.lower), joint.upper)


def always_touch(scene: ArmScene, points: Floats) -> bool:
    """Return True if no configuration (n, dof) is proven free."""
    # Most pairs are apart in an early configuration, which saves testing the others.
    # Random configurations tested first: most pairs of links are apart in at least one.
    first, others = np.split(points, [4])
    return not (are_free(scene, first, first).any() or are_free(scene, others, others).any())
