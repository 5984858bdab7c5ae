"""Planning scenes and motion plan requests of MoveIt, for arms."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspace.arms.inverse import PoseGoal
from cspace.arms.model import LIMIT_SLACK, Arm, JointValues, Names, sort_pair
from cspace.arms.solids import PosedShape, check_rigid
from cspace.arrays import Floats, StrPath
from cspace.check import check_known
from cspace.errors import GeometryError, InputError
from cspace.files.access import ContentError, decoding
from cspace.files.moveit import (
    WORLD,
    Contacts,
    check_list,
    check_table,
    parse_contacts,
    parse_frame,
    parse_name,
    parse_number,
    parse_numbers,
    parse_pose,
    parse_robot_state,
)
from cspace.files.plain import read_yaml
from cspace.files.urdf import PackageDirs

_REQUEST_KIND: Final = "motion plan request"

MAX_GOALS: Final = 1000
"""Maximum number of goals in a request."""


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
    source : str
        The file.
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

    source: str
    frame: str
    obstacles: dict[str, PosedShape]
    attached: dict[str, AttachedObject]
    robot_state: JointValues
    _contacts: Contacts | None
    _ids: dict[str, str]

    def __repr__(self) -> str:
        """Return the file and the number of objects."""
        counts = f"{len(self.obstacles)} obstacles, {len(self.attached)} attached"
        return f"PlanningScene({self.source}: {counts})"

    def may_touch(self, one: str, other: str) -> bool:
        """Return True if the matrix lets two links or objects touch.

        Versions of MoveIt differ in what counts if an entry and a default of the matrix disagree.
        The pair may touch only if they agree. Without a matrix, no pair may.
        """
        return self._contacts is not None and self._contacts.may_touch(
            self._ids.get(one, one), self._ids.get(other, other)
        )

    def _place(self, arm: Arm, base_pose: Floats) -> tuple[Arm, set[Names]]:
        """Return the arm with its objects, and the pairs that may touch.

        ``base_pose`` is the pose of the arm's base in the frame of the scene, shape (4, 4). If
        there is a matrix, it replaces the pairs of links that the SRDF lets touch, as in MoveIt.
        """
        self._check_arm(arm)
        bare, links = arm, [frame for frame in arm.frames if frame not in arm._carriers]
        for name, each in self.attached.items():
            check_known(each.link, f"{self.source}: link_name of {name!r}", links)
            touching = [link for link in each.touch_links if link in links]
            pose = self._pose_on_link(bare, each, base_pose)
            arm = arm.attach(name, each.shape.shape, each.link, pose, touching)
        if self._contacts is None:
            return arm, set()
        names = [link.name for link in arm.links]
        kept = {
            pair: why for pair, why in arm.allowed_collisions.items() if why in ("held", "one body")
        }
        pairs = (sort_pair(*pair) for pair in combinations(names, 2) if self.may_touch(*pair))
        arm = replace(arm, allowed_collisions=dict.fromkeys(pairs, "scene") | kept)
        return arm, {
            sort_pair(*pair) for pair in product(names, self.obstacles) if self.may_touch(*pair)
        }

    def _check_arm(self, arm: Arm) -> None:
        """Raise InputError if names collide or the arm holds a joint elsewhere.

        An object may not have the name of a frame.
        """
        for name in dict.fromkeys([*self._ids.values(), *self._ids]):
            if name in arm.frames:
                problem, rule = f"has the object {name!r}", "the arm has a frame of that name"
                raise InputError(self.source, problem, rule, "rename the object", value=name)
        for joint, held in arm.held_joints.items():
            value = self.robot_state.get(joint, held)
            if abs(value - held) > LIMIT_SLACK:
                problem, rule = f"has {joint} at {value:.12g}", f"the arm holds it at {held:.12g}"
                hint = "pass held_joints=scene.robot_state to Arm.from_urdf, or remove robot_state"
                raise InputError(self.source, problem, rule, hint, value=value)

    def _pose_on_link(self, arm: Arm, each: AttachedObject, base_pose: Floats) -> Floats:
        """Return an attached object's pose in its link's frame."""
        pose = each.shape.pose
        if each.frame == each.link:
            return pose
        # Only links that joints move need the robot's state.
        q = arm.configuration(self.robot_state) if arm._frames[each.link].body else arm._rest
        on_base = np.linalg.solve(base_pose, pose)
        return np.asarray(np.linalg.solve(arm.pose(q, each.link), on_base), dtype=np.float64)


def find_base_pose(frame: str, arm: Arm, source: str) -> Floats:
    """Return the pose of an arm's base in a frame, shape (4, 4).

    Raises
    ------
    InputError
        If it is neither ``"world"``, which is the root of the URDF, nor a frame of the arm that no
        joint moves; or if it is ``"world"``, and the base is not the root.
    """
    hint = "pass base_pose=, the pose of the arm's base in that frame"
    problem = f"has poses in the frame {frame!r}"
    if frame in arm.frames:
        body, pose = arm._frames[frame]
        if body:
            raise InputError(source, problem, "a joint of the arm moves it", hint, value=frame)
        return np.linalg.inv(pose).astype(np.float64)
    # MoveIt takes the root for the world.
    if frame != WORLD or arm._left_out:
        rule = f"the arm has no such frame; its base is {arm.frames[0]!r}"
        raise InputError(source, problem, rule, hint, value=frame)
    return np.eye(4)


def read_moveit_scene(path: StrPath, *, package_dirs: PackageDirs = ()) -> PlanningScene:
    """Read a MoveIt planning scene, for :func:`cspace.build_arm_space`.

    Collision objects are read in one frame, the planning frame, and attached objects in that frame
    or in the frame of the link that carries them.

    Parameters
    ----------
    path : path-like
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
    from cspace.shapes.scenes import SCENE_KIND, read_scene

    source, content = str(path), read_scene(path, package_dirs)
    table = content.table
    if not content.shapes and not content.attached:
        raise GeometryError(source, "holds no shape", "a scene needs one", "pass another file")
    obstacles = {each.name: PosedShape(each.shape, each.pose) for each in content.shapes}
    ids = {each.name: each.object_id for each in content.shapes}
    attached = {}
    for link, frame, touch_links, shapes in content.attached:
        for each in shapes:
            ids[each.name] = each.object_id
            shape = PosedShape(each.shape, each.pose)
            attached[each.name] = AttachedObject(shape, link, frame, tuple(touch_links))
    with decoding(path, SCENE_KIND):
        state = parse_robot_state(table.get("robot_state"), "robot_state")
        if state.is_diff:
            problem, rule = "has is_diff: true at robot_state", "it only changes another state"
            raise ContentError(problem, rule, "write the whole state")
        contacts = parse_contacts(table.get("allowed_collision_matrix"))
    return PlanningScene(
        source, content.frame, obstacles, attached, JointValues(state.joints), contacts, ids
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
    source : str
        The file.
    group : str
        Group of the SRDF that moves, for ``Arm.from_urdf(joints=)``; empty if the file names none.
    start_state : JointValues
        Values of the robot's joints at the start; empty if the file has none.
    goals : tuple of JointGoal and PoseGoal
        A plan reaches one of them. Poses are in :attr:`frame`.
    frame : str
        Frame of the poses; ``"world"`` if the file names none.
    time_limit : float or None
        Seconds; None if the file has none.
    """

    source: str
    group: str
    start_state: JointValues
    goals: tuple[JointGoal | PoseGoal, ...]
    frame: str
    time_limit: float | None

    def __repr__(self) -> str:
        """Return the file, the group and the number of goals."""
        return f"MotionPlanRequest({self.source}: {self.group}, {len(self.goals)} goals)"

    def make_goals(
        self, arm: Arm, *, base_pose: ArrayLike | None = None
    ) -> list[Floats | PoseGoal]:
        """Return the goals for an arm, as :func:`planners.plan` takes them.

        A joint that a goal does not constrain stays where it is at the start. A value beyond a
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
        return [
            self._configuration(arm, goal, f"goal_constraints[{number}]")
            if isinstance(goal, JointGoal)
            else self._pose_goal(arm, goal, base_pose)
            for number, goal in enumerate(self.goals)
        ]

    def _configuration(self, arm: Arm, goal: JointGoal, place: str) -> Floats:
        """Return the configuration of a joint goal."""
        values = {}
        for joint, value in goal.values.items():
            lower, upper = goal.lower[joint], goal.upper[joint]
            argument = f"{self.source}: {place}"
            if joint in arm.held_joints:
                held = arm.held_joints[joint]
                if not lower - LIMIT_SLACK <= held <= upper + LIMIT_SLACK:
                    problem = f"has {joint} at {value:.12g}"
                    rule = f"the arm holds it at {held:.12g}"
                    hint = "pass other joints= to Arm.from_urdf"
                    raise InputError(argument, problem, rule, hint, value=value)
                continue
            index = arm.joints.index(check_known(joint, argument, arm.joints, "names"))
            limit = float(np.clip(value, arm.lower[index], arm.upper[index]))
            values[joint] = limit if lower <= limit <= upper else value
        base = None if len(values) == arm.dof else arm.configuration(self.start_state)
        return arm.configuration(values, base)

    def _pose_goal(self, arm: Arm, goal: PoseGoal, base_pose: ArrayLike | None) -> PoseGoal:
        """Return a pose goal in the frame of the arm's base."""
        check_known(goal.frame, f"{self.source}: link_name", arm.frames)
        if base_pose is None:
            base = find_base_pose(self.frame, arm, self.source)
        else:
            base = check_rigid(base_pose, "base_pose")
        return replace(goal, pose=np.linalg.solve(base, np.asarray(goal.pose)))


def read_moveit_request(path: StrPath) -> MotionPlanRequest:
    """Read a MoveIt motion plan request.

    Goals may be joint constraints with tolerances, or a position constraint, an orientation
    constraint, or both, of one link. Several goals, and several shapes of a position, are a choice.
    A pose goal is a ball within the shape of the position, and an angle within the tolerances of
    the orientation, so that what reaches it satisfies the constraints.

    The planner, the number of attempts, the bounds of the workspace, which concern mobile bases,
    and factors of speed are not used.

    Parameters
    ----------
    path : path-like
        YAML of a ``moveit_msgs/MotionPlanRequest``: as ROS prints it, or as MotionBenchMaker and
        robowflex write it. It may be the field ``request`` or ``motion_plan_request`` of a larger
        message.

    Raises
    ------
    FileError
        If the file is missing or malformed, has no goal or an unknown field, changes the scene in
        ``planning_options``, or constrains paths, visibility, or joints and poses in one goal; if
        objects are attached, which belong to the scene; or if a region of positions is a cone or a
        mesh.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from cspace.arms import read_moveit_request
    >>> path = pathlib.Path(tempfile.mkdtemp(), "request.yaml")
    >>> goal = "{joint_constraints: [{joint_name: elbow, position: 1.0, tolerance_above: 0.01}]}"
    >>> start = "{joint_state: {name: [elbow], position: [0.5]}}"
    >>> text = f"group_name: arm, start_state: {start}, goal_constraints: [{goal}]"
    >>> _ = path.write_text(f"{{{text}}}")
    >>> request = read_moveit_request(path)
    >>> request.group, request.start_state, request.goals[0].upper
    ('arm', {'elbow': 0.5}, {'elbow': 1.01})
    """
    content = read_yaml(path, _REQUEST_KIND)
    with decoding(path, _REQUEST_KIND):
        message = check_table(content, "the file")
        options = check_table(message.get("planning_options"), "planning_options")
        if _holds_entries(options.get("planning_scene_diff")):
            problem, rule = (
                "has changes in planning_options.planning_scene_diff",
                "a scene is read from its own file",
            )
            raise ContentError(problem, rule, "write them into the scene")
        for name in ("request", "motion_plan_request"):
            message = message.get(name, message)
        table = check_table(message, "the request", _REQUEST_FIELDS)
        for name in ("path_constraints", "trajectory_constraints", "reference_trajectories"):
            if _holds_entries(table.get(name)):
                raise ContentError(f"has {name}", "plans would not obey them", f"remove {name}")
        group = table.get("group_name") and parse_name(table["group_name"], "group_name")
        seconds = table.get("allowed_planning_time")
        state = parse_robot_state(table.get("start_state"), "start_state")
        if state.attached:
            hint = "write them as attached_collision_objects of the scene's robot_state"
            raise ContentError(
                "has attached objects in start_state", "an arm space holds them", hint
            )
        goals, frames = list[JointGoal | PoseGoal](), dict[str, None]()
        for number, item in enumerate(
            check_list(table.get("goal_constraints"), "goal_constraints")
        ):
            goals += _parse_goal(item, f"goal_constraints[{number}]", frames)
            if len(goals) > MAX_GOALS:
                raise ContentError(
                    f"has more than {MAX_GOALS} goals", "the rest is not read", "remove some"
                )
        if not goals:
            raise ContentError("has no goal_constraints", "a request has at least one", "add them")
        if len(frames) > 1:
            problem = f"has goals in the frames {', '.join(map(repr, sorted(frames)))}"
            raise ContentError(problem, "they must be in one frame", "write all in one frame")
        limit = parse_number(seconds, "allowed_planning_time", 0.0)
        values = JointValues(state.joints)
        return MotionPlanRequest(
            str(path), group or "", values, tuple(goals), next(iter(frames), WORLD), limit or None
        )


_REQUEST_FIELDS: Final = (
    *(
        "workspace_parameters",
        "start_state",
        "goal_constraints",
        "path_constraints",
        "trajectory_constraints",
    ),
    *("reference_trajectories", "pipeline_id", "planner_id", "group_name", "num_planning_attempts"),
    *("allowed_planning_time", "max_velocity_scaling_factor", "max_acceleration_scaling_factor"),
    *("cartesian_speed_end_effector_link", "cartesian_speed_limited_link", "max_cartesian_speed"),
)
"""Fields of a moveit_msgs/MotionPlanRequest, in all versions."""


_NEUTRAL_FIELDS: Final = ("name", "header", "is_diff", "w")
"""Fields that messages without content may have; w is that of the quaternion of no rotation."""


def _holds_entries(value: Any) -> bool:
    """Return True if a message holds more than neutral fields and empty lists."""
    if isinstance(value, Mapping):
        return any(
            _holds_entries(each) for name, each in value.items() if name not in _NEUTRAL_FIELDS
        )
    return bool(value)


def _parse_goal(item: Any, place: str, frames: dict[str, None]) -> Sequence[JointGoal | PoseGoal]:
    """Return a goal; or several, of which one must be reached.

    Frames of poses are added to ``frames``.
    """
    kinds = (
        "joint_constraints",
        "position_constraints",
        "orientation_constraints",
        "visibility_constraints",
    )
    table = check_table(item, place, ("name", *kinds))
    joints, positions, orientations, views = (
        check_list(table.get(kind), f"{kind} of {place}") for kind in kinds
    )
    if views:
        problem = f"has visibility_constraints at {place}"
        raise ContentError(problem, "a goal is a pose or values of joints", "remove them")
    if joints and (positions or orientations):
        problem = f"constrains joints and poses at {place}"
        raise ContentError(problem, "a goal is a pose or values of joints", "remove one kind")
    if joints:
        return [_parse_joint_goal(joints, place)]
    counts = len(positions), len(orientations)
    if max(counts) != 1:
        problem = (
            f"has {counts[0]} position_constraints and {counts[1]} orientation_constraints at "
            f"{place}"
        )
        raise ContentError(problem, "a goal must have one, or one of each", "add or remove some")
    return _parse_pose_goals(positions, orientations, place, frames)


def _parse_joint_goal(items: Sequence[Any], place: str) -> JointGoal:
    """Return the goal of joint constraints."""
    goal = JointGoal({}, {}, {})
    for number, item in enumerate(items):
        here = f"joint_constraints[{number}] of {place}"
        fields = "joint_name", "position", "tolerance_above", "tolerance_below", "weight"
        entry = check_table(item, here, fields)
        name = parse_name(entry.get("joint_name"), f"joint_name of {here}")
        if name in goal.values:
            raise ContentError(
                f"has {name[:40]!r} twice at {place}", "names must differ", "remove one"
            )
        if entry.get("position") is None:
            raise ContentError(f"has no position at {here}", "it must be there", "add it")
        value = parse_number(entry["position"], f"position of {here}", 0.0)
        above, below = (
            parse_number(entry.get(side), f"{side} of {here}", 0.0) for side in fields[2:4]
        )
        if min(above, below) < 0.0:
            problem = f"has the tolerances {below:g} and {above:g} at {here}"
            raise ContentError(problem, "they may not be negative", "correct them")
        goal.values[name], goal.lower[name], goal.upper[name] = value, value - below, value + above
    return goal


def _parse_pose_goals(
    positions: Sequence[Any], orientations: Sequence[Any], place: str, frames: dict[str, None]
) -> list[PoseGoal]:
    """Return the goals of a position and an orientation constraint."""
    links, rotation, angle = list[str](), np.eye(3), math.inf
    for item in orientations:
        link, rotation, angle = _parse_orientation(
            item, f"orientation_constraints of {place}", frames
        )
        links.append(link)
    centers = [(np.zeros(3), math.inf)]
    for item in positions:
        link, centers = _parse_position(item, f"position_constraints of {place}", frames)
        links.append(link)
    if len(set(links)) > 1:
        problem = f"constrains {' and '.join(map(repr, links))} at {place}"
        raise ContentError(problem, "a goal is for one link", "remove one")
    if math.isinf(angle) and math.isinf(centers[0][1]):
        raise ContentError(
            f"has tolerances beyond half a turn at {place}",
            "then any pose would do",
            "tighten them",
        )
    goals = []
    for center, radius in centers:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, center
        goals.append(PoseGoal(links[0], pose, (radius, angle)))
    return goals


def _parse_orientation(item: Any, place: str, frames: dict[str, None]) -> tuple[str, Floats, float]:
    """Return the link, the rotation and the largest angle of an orientation constraint."""
    names = [f"absolute_{axis}_axis_tolerance" for axis in "xyz"]
    entry = check_table(
        item, place, ("header", "orientation", "link_name", *names, "parameterization", "weight")
    )
    frames[parse_frame(entry, place)] = None
    link = parse_name(entry.get("link_name"), f"link_name of {place}")
    rotation = parse_pose({"orientation": entry.get("orientation")}, place)[:3, :3]
    # MoveIt takes the tolerances as absolute.
    tolerance = min(abs(parse_number(entry.get(name), f"{name} of {place}", 0.0)) for name in names)
    if not tolerance > 0.0:
        problem = f"has a tolerance of zero at {place}"
        raise ContentError(
            problem, "no computed pose would be within it", "make it larger, e.g. 1e-3"
        )
    return (
        link,
        rotation,
        math.inf if tolerance >= math.pi else min(tolerance, _MAX_EULER_TOLERANCE),
    )


def _parse_position(
    item: Any, place: str, frames: dict[str, None]
) -> tuple[str, list[tuple[Floats, float]]]:
    """Return the link of a position constraint, and the balls of its region.

    They are a center and a radius for each shape.
    """
    entry = check_table(
        item, place, ("header", "link_name", "target_point_offset", "constraint_region", "weight")
    )
    frames[parse_frame(entry, place)] = None
    link = parse_name(entry.get("link_name"), f"link_name of {place}")
    offset = entry.get("target_point_offset")
    if offset is not None and parse_numbers(offset, 3, f"target_point_offset of {place}").any():
        problem = f"has a target_point_offset at {place}"
        hint = "constrain the position of the origin"
        raise ContentError(problem, "a pose goal is for the origin of a link", hint)
    fields = "primitives", "primitive_poses", "meshes", "mesh_poses"
    region = check_table(entry.get("constraint_region"), f"constraint_region of {place}", fields)
    return link, _parse_region(region, f"region of {place}")


_MAX_EULER_TOLERANCE: Final = 0.5 * math.pi
"""Largest angle, radians, up to which each Euler angle of a rotation is at most the rotation's
angle."""


def _parse_region(region: Mapping[str, Any], place: str) -> list[tuple[Floats, float]]:
    """Return the center and radius of a ball in each shape of a region, metres.

    It is the largest one around the center of the shape.
    """
    from cspace.shapes.scenes import parse_primitive

    if region.get("meshes"):
        raise ContentError(
            f"has meshes at {place}",
            "it may hold boxes, spheres and cylinders",
            "write such a region",
        )
    items = check_list(region.get("primitives"), f"primitives of {place}")
    poses = check_list(region.get("primitive_poses"), f"primitive_poses of {place}")
    if not items or len(items) != len(poses):
        problem = f"has {len(items)} primitives and {len(poses)} primitive_poses at {place}"
        raise ContentError(
            problem, "each needs a pose, and there must be one", "add or remove some"
        )
    balls = []
    for number, (item, pose) in enumerate(zip(items, poses, strict=True)):
        here = f"primitives[{number}] of {place}"
        kind, sizes = parse_primitive(item, here)
        if kind not in _BALL_RADII:
            rule = f"it must be one of {', '.join(_BALL_RADII)}"
            raise ContentError(f"has a {kind} at {here}", rule, "write one of them")
        balls.append(
            (
                parse_pose(pose, f"primitive_poses[{number}] of {place}")[:3, 3],
                _BALL_RADII[kind](*sizes),
            )
        )
    return balls


_BALL_RADII: Final[Mapping[str, Callable[..., float]]] = {
    "box": lambda *sides: 0.5 * min(sides),
    "sphere": lambda radius: radius,
    "cylinder": lambda height, radius: min(0.5 * height, radius),
}
"""Radius of the largest ball around the center of a primitive, from its dimensions, metres."""
