"""Planning scenes and motion plan requests of MoveIt, for arms."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, product
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspace.arms._checks import check_distinct, check_rigid
from cspace.arms._inverse import PoseGoal
from cspace.arms._model import LIMIT_SLACK, Arm, JointValues, Names, sort_pair
from cspace.arms._posed_shapes import PosedShape
from cspace.arms._reading.moveit_messages import (
    FIELDS,
    HEADER,
    STATE,
    WORLD,
    Contacts,
    Schema,
    accept_only,
    allow_missing,
    find_frame,
    pair_poses,
    parse,
    parse_frame,
    parse_name,
    parse_number,
    parse_pose,
    parse_primitive,
    parse_rotation,
    refuse,
    wrong_value,
)
from cspace.arms._reading.urdf import PackageDirs
from cspace.errors import InputError
from cspace.inside import (
    ContentError,
    Floats,
    Ledger,
    Upright,
    check_known,
    warn_of_large,
    warn_user,
)

_MAX_EULER_TOLERANCE: Final = 0.5 * math.pi
"""Largest angle, radians, up to which each Euler angle of a rotation is at most the rotation's
angle."""

_MAX_FREE_TURN: Final = math.pi / 3.0
"""Largest turn of a link, radians, about a y axis about which it may turn freely."""

_BALL_RADII: Final[Mapping[str, Callable[..., float]]] = {
    "box": lambda *sides: 0.5 * min(sides),
    "sphere": lambda radius: radius,
    "cylinder": lambda height, radius: min(0.5 * height, radius),
}
"""Radius of the largest ball around the center of a primitive, from its dimensions, metres."""


class AttachedObject(NamedTuple):
    """A shape that a link carries.

    Attributes
    ----------
    shape : PosedShape
        At its pose in the frame.
    link : str
        Link that carries it.
    frame : str
        That link, or the frame of the scene.
    touch_links : tuple of str
        Further links that may touch it.
    """

    shape: PosedShape
    link: str
    frame: str
    touch_links: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class PlanningScene:
    """A MoveIt planning scene; :func:`cspace.arms.read_moveit_scene` reads one.

    Pass it to :func:`cspace.build_arm_space` as the obstacles.

    Attributes
    ----------
    frame : str
        Frame of the obstacles; ``"world"`` if the file names none.
    obstacles : dict of str to PosedShape
        Shapes by the id of their collision object, in the frame of the scene. Several shapes of one
        object are named ``id/0``, ``id/1`` and so on.
    attached : dict of str to AttachedObject
        Shapes that links carry, named as the obstacles.
    robot_state : JointValues
        Values of the robot's joints; empty if the file has none.
    """

    _source: str
    frame: str
    obstacles: dict[str, PosedShape]
    attached: dict[str, AttachedObject]
    robot_state: JointValues
    _contacts: Contacts | None
    _ids: dict[str, str]

    def __repr__(self) -> str:
        """Return the file and the number of objects."""
        counts = f"{len(self.obstacles)} obstacles, {len(self.attached)} attached"
        return f"PlanningScene({self._source}: {counts})"

    def may_touch(self, one: str, other: str) -> bool:
        """Return True if the matrix lets two links or objects touch.

        If an entry and a default of the matrix disagree, versions of MoveIt differ.
        The pair may touch only if they agree. Without a matrix, no pair may.
        """
        contacts = self._contacts or {}
        # The matrix names objects; an obstacle may be one of an object's shapes.
        a = self._ids.get(one, one)
        b = self._ids.get(other, other)
        entries = [contacts.get(key) for key in ((a, b), (b, a), (a,), (b,))]
        return True in entries and False not in entries

    def _place(self, arm: Arm, base_pose: Floats) -> tuple[Arm, set[Names]]:
        """Return the arm with its objects, and the pairs that may touch.

        ``base_pose`` is the pose of the arm's base in the frame of the scene, shape (4, 4). If
        there is a matrix, it replaces the pairs of links that the SRDF lets touch, as in MoveIt,
        which adds those of the reason Never; these are tested.
        """
        self._check_arm(arm)
        bare_arm = arm
        links = [frame for frame in arm.frames if frame not in arm.carriers]
        for name, carried in self.attached.items():
            check_known(carried.link, f"{self._source}: link_name of {name!r}", links)
            touching = [link for link in carried.touch_links if link in links]
            pose = self._find_pose_on_link(bare_arm, carried, base_pose)
            arm = arm.attach(name, carried.shape.shape, carried.link, pose, touching)
        if self._contacts is None:
            return arm, set()
        names = [link.name for link in arm.links]
        allowed = {
            sort_pair(a, b): "scene" for a, b in combinations(names, 2) if self.may_touch(a, b)
        }
        for pair in arm._never:
            allowed.pop(pair, None)
        # These reasons hold whatever the matrix says.
        before = arm.allowed_collisions.items()
        allowed |= {pair: reason for pair, reason in before if reason in ("held", "one body")}
        with_obstacles = {
            sort_pair(a, b) for a, b in product(names, self.obstacles) if self.may_touch(a, b)
        }
        return replace(arm, allowed_collisions=allowed), with_obstacles

    def _check_arm(self, arm: Arm) -> None:
        """Raise InputError unless the scene fits the arm.

        An object may not have the name of a frame, and the arm must hold its still joints where the
        scene has them.
        """
        for name in dict.fromkeys([*self._ids.values(), *self._ids]):
            if name in arm.frames:
                raise InputError(
                    self._source,
                    f"has the object {name!r}",
                    "the arm has a frame of that name",
                )
        for joint, held in arm.held_joints.items():
            value = self.robot_state.get(joint, held)
            if abs(value - held) > LIMIT_SLACK:
                raise InputError(
                    self._source,
                    f"has {joint} at {value:.12g}",
                    f"the arm holds it at {held:.12g}",
                )
        arm._warn_of_followers(self.robot_state, self._source)

        named = set(chain(*(self._contacts or {}), self.robot_state))
        named.update(*(carried.touch_links for carried in self.attached.values()))
        known = {*arm.frames, *arm.joints, *arm.held_joints, *arm._passive, "<octomap>"}
        unknown = named.difference(known, self._ids.values(), self.obstacles, self.attached)
        if unknown:
            listed = ", ".join(sorted(unknown))
            problem = f"names {listed:.200}, which neither the arm nor the scene has"
            warn_user(f"{self._source}: {problem}; such entries are skipped")

    def _find_pose_on_link(self, arm: Arm, carried: AttachedObject, base_pose: Floats) -> Floats:
        """Return an attached object's pose in its link's frame, shape (4, 4)."""
        pose = carried.shape.pose
        if carried.frame == carried.link:
            return pose
        # Only links that joints move need the robot's state.
        is_moved = arm.placements[carried.link].body > 0
        q = arm.configuration(self.robot_state) if is_moved else arm._rest
        link_pose = arm.pose(q, carried.link)
        # From the frame of the scene to the base, then to the link.
        on_base = np.linalg.solve(base_pose, pose)
        return np.asarray(np.linalg.solve(link_pose, on_base), dtype=np.float64)


def find_base_pose(frame: str, arm: Arm, source: str) -> Floats:
    """Return the pose of an arm's base in a frame (4, 4).

    Raises
    ------
    InputError
        If it is neither ``"world"``, which is the root of the URDF, nor a frame of the arm that no
        joint moves; or if it is ``"world"``, and the base is not the root.
    """
    problem = f"has poses in the frame {frame!r}"
    if frame in arm.frames:
        body, pose = arm.placements[frame]
        if body:
            raise InputError(source, problem, "a joint of the arm moves it")
        return np.linalg.inv(pose).astype(np.float64)
    # MoveIt takes the root for the world.
    if frame != WORLD or not arm._base_is_root:
        raise InputError(
            source,
            problem,
            f"the arm has no such frame; its base is {arm.frames[0]!r}",
        )
    return np.eye(4)


def read_moveit_scene(source: object, *, package_dirs: PackageDirs = ()) -> PlanningScene:
    """Read a MoveIt planning scene, for :func:`cspace.build_arm_space`.

    Collision objects are read in one frame, the planning frame, and attached objects in that frame
    or in the frame of the link that carries them.

    Parameters
    ----------
    source : path-like, mapping, or message
        As for :meth:`cspace.Workspace.from_moveit_scene`, which reads the same shapes.
    package_dirs : path-like, or sequence of path-like
        Folders that contain the folders of packages, for meshes, as for
        :meth:`cspace.Robot.from_urdf`.

    Raises
    ------
    FileError, GeometryError
        As :meth:`cspace.Workspace.from_moveit_scene`. Also if the state of the robot moves its
        base, or only changes another state.
    """
    from cspace.arms._reading.link_shapes import read_scene

    content = read_scene(source, package_dirs)
    obstacles = {}
    attached = {}
    for each in content.shapes:
        shape = PosedShape(each.shape, each.pose)
        if each.link:
            attached[each.name] = AttachedObject(shape, each.link, each.frame, each.touch_links)
        else:
            obstacles[each.name] = shape
    return PlanningScene(
        _source=content.source,
        frame=content.frame,
        obstacles=obstacles,
        attached=attached,
        robot_state=JointValues(content.joints),
        _contacts=content.contacts,
        _ids={each.name: each.object_id for each in content.shapes},
    )


class JointGoal(NamedTuple):
    """Values of joints that a plan must reach, radians or metres.

    Attributes
    ----------
    values : dict of str to float
    lower, upper : dict of str to float
        The range of each joint that counts as reached.
    """

    values: dict[str, float]
    lower: dict[str, float]
    upper: dict[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class MotionPlanRequest:
    """A MoveIt motion plan request; :func:`cspace.arms.read_moveit_request` reads one.

    Attributes
    ----------
    group : str
        Group of the SRDF that moves, for ``Arm.from_urdf(joints=)``; empty if the file names none.
    start_state : JointValues
        Values of the robot's joints at the start; empty if the file has none.
    frame : str
        Frame of the poses; ``"world"`` if the file names none.
    time_limit : float or None
        Seconds; None if the file has none.
    """

    _source: str
    group: str
    start_state: JointValues
    _goals: tuple[JointGoal | PoseGoal, ...]
    frame: str
    time_limit: float | None
    _keep: tuple[Upright, ...]

    def __repr__(self) -> str:
        """Return file, group and number of goals."""
        return f"MotionPlanRequest({self._source}: {self.group}, {len(self._goals)} goals)"

    def make_goals(
        self, arm: Arm, *, base_pose: ArrayLike | None = None
    ) -> list[Floats | PoseGoal]:
        """Make an arm's goals, for :func:`planners.plan`.

        A joint that a goal does not constrain keeps its value at the start. A value beyond a
        limit, within its tolerance, is moved onto the limit.

        Parameters
        ----------
        arm : Arm
        base_pose : array-like, shape (4, 4), optional
            Pose of the arm's base in the frame of the poses. By default the arm knows the frame, or
            it is ``"world"`` and that of the base.

        Returns
        -------
        list of ndarray of float64, shape (dof,), and PoseGoal

        Raises
        ------
        InputError
            If the arm has no such joint, link or frame, or holds a joint elsewhere.
        ConfigurationError
            If a value is beyond the limits of its joint by more than its tolerance.
        """
        goals: list[Floats | PoseGoal] = []
        for number, goal in enumerate(self._goals):
            if isinstance(goal, JointGoal):
                argument = f"{self._source}: goal_constraints[{number}]"
                goals.append(self._make_configuration(arm, goal, argument))
            else:
                goals.append(self._place_pose_goal(arm, goal, base_pose))
        return goals

    def make_keep(self, arm: Arm, *, base_pose: ArrayLike | None = None) -> list[Upright]:
        """Return the axes that an arm keeps upright, for ``keep=`` of :func:`planners.plan`.

        Arguments and errors are as for :meth:`make_goals`.

        Returns
        -------
        list of Upright
            Empty if the request constrains no path.
        """
        kept = []
        for upright in self._keep:
            check_known(upright.frame, f"{self._source}: link_name", arm.frames)
            to_base = np.linalg.inv(self._find_base(arm, base_pose))[:3, :3]
            direction = to_base @ np.asarray(upright.direction)
            kept.append(replace(upright, direction=tuple(direction.tolist())))
        return kept

    def _find_base(self, arm: Arm, base_pose: ArrayLike | None) -> Floats:
        """Return the arm's base in the request's frame."""
        if base_pose is None:
            return find_base_pose(self.frame, arm, self._source)
        return check_rigid(base_pose, "base_pose")

    def _make_configuration(self, arm: Arm, goal: JointGoal, argument: str) -> Floats:
        """Return the configuration of a joint goal, shape (dof,).

        Errors name ``argument``. Raises InputError if the arm lacks a joint, or holds it outside
        its range.
        """
        values = {}
        for joint, value in goal.values.items():
            lower = goal.lower[joint]
            upper = goal.upper[joint]
            # A joint that does not move must be within its range already.
            if joint in arm.held_joints:
                held = arm.held_joints[joint]
                if not lower - LIMIT_SLACK <= held <= upper + LIMIT_SLACK:
                    raise InputError(
                        argument,
                        f"has {joint} at {value:.12g}",
                        f"the arm holds it at {held:.12g}",
                    )
                continue
            index = arm.joints.index(check_known(joint, argument, arm.joints, "names"))
            # A value beyond the limit stays, to be refused, unless the limit is near enough.
            clamped = float(np.clip(value, arm.lower[index], arm.upper[index]))
            values[joint] = clamped if lower <= clamped <= upper else value
        base = None if len(values) == arm.dof else arm.configuration(self.start_state)
        return arm.configuration(values, base)

    def _place_pose_goal(self, arm: Arm, goal: PoseGoal, base_pose: ArrayLike | None) -> PoseGoal:
        """Return a pose goal in the frame of the arm's base.

        ``base_pose`` is the pose of the base in the frame of the request; None if the arm knows it.
        """
        check_known(goal.frame, f"{self._source}: link_name", arm.frames)
        base = self._find_base(arm, base_pose)
        return replace(goal, pose=np.linalg.solve(base, np.asarray(goal.pose)))


def read_moveit_request(source: object) -> MotionPlanRequest:
    """Read a MoveIt motion plan request.

    Goals may be joint constraints with tolerances, or a position constraint, an orientation
    constraint, or both, of one link. Several goals are a choice; a position has one shape.
    A pose goal is a ball within the shape of the position, and an angle within the tolerances of
    the orientation, so that what reaches it satisfies the constraints. Orientations that
    ``path_constraints`` keep become cones of the link's axes, likewise within the tolerances.

    The planner, the number of attempts, the bounds of the workspace, which concern mobile bases,
    and factors of speed are not used.

    Parameters
    ----------
    source : path-like, mapping, or message
        A ``moveit_msgs/MotionPlanRequest``, a mapping with its fields, or a file of it in YAML: as
        ROS prints it, or as MotionBenchMaker and robowflex write it.

    Raises
    ------
    FileError, or InputError for a mapping or a message
        If a file is missing or malformed, has no goal or an unknown field, or constrains
        visibility, joints or positions of paths, or joints and poses in one goal; if objects are
        attached, which belong to the scene; or if a region of positions is no box, sphere or
        cylinder.

    Examples
    --------
    >>> from cspace.arms import read_moveit_request
    >>> constraint = {"joint_name": "elbow", "position": 1.0, "tolerance_above": 0.01}
    >>> start = {"joint_state": {"name": ["elbow"], "position": [0.5]}}
    >>> goal = {"joint_constraints": [constraint]}
    >>> request = read_moveit_request(
    ...     {"group_name": "arm", "start_state": start, "goal_constraints": [goal]}
    ... )
    >>> request.group, request.start_state
    ('arm', {'elbow': 0.5})
    """
    with Ledger.reading(source, "motion plan request", "request", FIELDS[1]) as (name, document):
        document.skip()  # each of its tables has its ledger
        fields = parse(_REQUEST, document.fields, "request")
        goals = fields.goal_constraints
        if not goals:
            raise ContentError("has no goal_constraints", "a request has at least one")
        kept, path_frames = fields.path_constraints
        frames = path_frames.union(*(goal_frames for _, goal_frames in goals))
        return MotionPlanRequest(
            _source=name,
            group=fields.group_name,
            start_state=JointValues(fields.start_state.joint_state),
            _goals=tuple(goal for goal, _ in goals),
            frame=find_frame(frames),
            time_limit=fields.allowed_planning_time or None,
            _keep=tuple(kept),
        )


def _parse_tolerance(value: Any, place: str) -> float:
    """Parse a number that is not negative; a missing one is zero."""
    tolerance: float = _parse_optional(value, place)
    if tolerance < 0.0:
        raise wrong_value(value, place, "it may not be negative")
    return tolerance


def _parse_angle(value: Any, place: str) -> float:
    """Parse an angle, radians, by default zero; warn beyond a turn."""
    angle: float = _parse_optional(value, place)
    warn_of_large(angle, "rad", f"motion plan request: {place}")
    return angle


def _parse_ball(value: Any, place: str) -> tuple[Floats, float]:
    """Parse a region's largest central ball: center and radius, metres.

    The region is one box, sphere or cylinder.
    """
    solids = pair_poses(parse(_REGION, value, place), "primitives", "primitive_poses", place)
    kinds = [kind for (kind, _), _ in solids]
    if len(kinds) != 1 or kinds[0] not in _BALL_RADII:
        rule = f"it must be one of {', '.join(_BALL_RADII)}"
        raise wrong_value(", ".join(kinds) or "nothing", place, rule)
    (((kind, sizes), pose),) = solids
    return pose[:3, 3], _BALL_RADII[kind](*sizes)


def _parse_goal(value: Any, place: str) -> tuple[JointGoal | PoseGoal, set[str]]:
    """Parse a goal, and return it with the frames of its poses."""
    fields = parse(_GOAL, value, place)
    joints = fields.joint_constraints
    positions = fields.position_constraints
    orientations = fields.orientation_constraints
    poses = positions + orientations
    if bool(joints) == bool(poses):
        raise ContentError(
            f"has {len(joints)} joint and {len(poses)} pose constraints at {place}",
            "a goal has one of the two kinds",
        )
    if joints:
        return _make_joint_goal(joints, place), set()
    links = sorted({constraint.link_name for constraint in poses})
    if len(links) > 1 or max(len(positions), len(orientations)) > 1:
        raise ContentError(
            f"has {len(poses)} constraints of {', '.join(links)} at {place}",
            "a goal has at most one of each, for one link",
        )
    # What is not constrained may be anything. Each list has one constraint at most.
    pose = np.eye(4)
    radius = math.inf
    angle = math.inf
    for constraint in positions:
        pose[:3, 3], radius = constraint.constraint_region
    for constraint in orientations:
        pose[:3, :3] = constraint.orientation
        angle = _find_angle(constraint, place)
    if math.isinf(radius) and math.isinf(angle):
        raise ContentError(
            f"has tolerances beyond half a turn at {place}",
            "then any pose would do",
        )
    frames = {constraint.header.frame_id or WORLD for constraint in poses}
    return PoseGoal(links[0], pose, (radius, angle)), frames


def _make_joint_goal(constraints: Sequence[Any], place: str) -> JointGoal:
    """Make the goal of joint constraints; errors name ``place``."""
    check_distinct((constraint.joint_name for constraint in constraints), f" at {place}")
    goal = JointGoal({}, {}, {})
    for constraint in constraints:
        name = constraint.joint_name
        value = constraint.position
        goal.values[name] = value
        goal.lower[name] = value - constraint.tolerance_below
        goal.upper[name] = value + constraint.tolerance_above
    return goal


def _find_angle(constraint: Any, place: str) -> float:
    """Return an orientation constraint's largest angle about any axis, radians.

    It is infinite if the constraint allows any rotation. Errors name the ``place`` of the goal.
    """
    # MoveIt takes the tolerances as absolute.
    tolerance = min(abs(getattr(constraint, f"absolute_{axis}_axis_tolerance")) for axis in "xyz")
    if tolerance == 0.0:
        raise ContentError(
            f"has a tolerance of zero at {place}",
            "no computed pose would be within it",
        )
    return math.inf if tolerance >= math.pi else min(tolerance, _MAX_EULER_TOLERANCE)


def _parse_path(value: Any, place: str) -> tuple[list[Upright], set[str]]:
    """Parse a path's constraints, with the frames of their orientations."""
    kept = list[Upright]()
    frames = set[str]()
    for constraint in parse(_PATH, value, place).orientation_constraints:
        frames.add(constraint.header.frame_id or WORLD)
        kept += _make_uprights(constraint, place)
    return kept, frames


def _make_uprights(constraint: Any, place: str) -> list[Upright]:
    """Make cones of a link's axes within an orientation's tolerances.

    Let the rotation from the wanted orientation to the link be ``Rx(a) Ry(b) Rz(c)``. It takes the
    z axis to ``(sin b, -sin a cos b, cos a cos b)``: if that turns by t, at most a right angle, a
    and b are at most t. If a and c are free, b alone is the angle from the plane across the x axis.
    The x axis turns by the angle with the cosine ``cos b cos c``, which bounds c, and b if a is
    free.

    If b is free, the cosine of the turn t of the y axis is ``cos a cos c - sin a sin b sin c``. It
    is at most ``sqrt(1 - cos^2 b sin^2 a)`` for any c, so ``sin |a| <= sin t / cos b``, and so for
    c. Euler angles have no b beyond a right angle. So the z axis turns by at most
    :data:`_MAX_FREE_TURN`, which bounds b, and a away from pi; a warning says so. Errors name the
    ``place`` in the file.
    """
    _find_angle(constraint, place)  # refuses zero
    x, y, z = (abs(getattr(constraint, f"absolute_{axis}_axis_tolerance")) for axis in "xyz")
    first, second, last = constraint.orientation.T
    link = constraint.link_name
    if min(x, y, z) >= math.pi:
        return []
    if min(x, z) >= math.pi:
        across = Upright(link, direction=first, tolerance=y, angle=0.5 * math.pi)
        return [across] if y < _MAX_EULER_TOLERANCE else []
    if x >= math.pi:
        tilt = min(y, z, _MAX_EULER_TOLERANCE)
        return [Upright(link, (1.0, 0.0, 0.0), direction=first, tolerance=tilt)]
    if y >= math.pi > z:
        sine = math.cos(_MAX_FREE_TURN) * math.sin(min(x, z, _MAX_EULER_TOLERANCE))
        tilt = math.asin(sine)
        warn_user(
            f"motion plan request: {place} lets {link} turn freely about its y axis; keep= allows "
            f"{_MAX_FREE_TURN:.6g} rad, because Euler angles are ambiguous at a right angle"
        )
        return [
            Upright(link, (0.0, 1.0, 0.0), direction=second, tolerance=tilt),
            Upright(link, direction=last, tolerance=_MAX_FREE_TURN),
        ]
    tilt = min(x, y, _MAX_EULER_TOLERANCE)
    kept = [Upright(link, direction=last, tolerance=tilt)]
    if z < math.pi:
        turn = z if z <= 0.5 * math.pi else math.acos(math.cos(z) * math.cos(tilt))
        kept.append(Upright(link, (1.0, 0.0, 0.0), direction=first, tolerance=turn))
    return kept


# ---- tables of the fields of requests ------------------------------------------------------------

_parse_optional: Final = allow_missing(parse_number, 0.0)

_REGION: Final[Schema] = {
    "primitives": [parse_primitive],
    "primitive_poses": [parse_pose],
    "meshes": refuse,
    "mesh_poses": refuse,
}

_JOINT_CONSTRAINT: Final[Schema] = {
    "joint_name": parse_name,
    "position": parse_number,
    "tolerance_above": _parse_tolerance,
    "tolerance_below": _parse_tolerance,
}

_POSITION_CONSTRAINT: Final[Schema] = {
    "header": HEADER,
    "link_name": parse_name,
    "target_point_offset": refuse,
    "constraint_region": _parse_ball,
}

_ORIENTATION_CONSTRAINT: Final[dict[str, Schema]] = {
    "header": HEADER,
    "orientation": parse_rotation,
    "link_name": parse_name,
    **{f"absolute_{axis}_axis_tolerance": _parse_angle for axis in "xyz"},
}

_GOAL: Final[Schema] = {
    "joint_constraints": [_JOINT_CONSTRAINT],
    "position_constraints": [_POSITION_CONSTRAINT],
    "orientation_constraints": [_ORIENTATION_CONSTRAINT],
    "visibility_constraints": refuse,
}

_PATH: Final[Schema] = {
    "joint_constraints": refuse,
    "position_constraints": refuse,
    "orientation_constraints": [
        {
            **_ORIENTATION_CONSTRAINT,
            "parameterization": accept_only(0),
        }
    ],
    "visibility_constraints": refuse,
}

_REQUEST: Final[Schema] = {
    "group_name": parse_frame,
    "start_state": {
        **STATE,
        "attached_collision_objects": refuse,
        "is_diff": accept_only(False, True),
    },
    "goal_constraints": [_parse_goal],
    "path_constraints": _parse_path,
    "trajectory_constraints": refuse,
    "reference_trajectories": refuse,
    "allowed_planning_time": _parse_optional,
}
