"""MoveIt's planning scenes and motion plan requests, applied to arms."""

import dataclasses
import math
import re
from array import array
from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import planners
from cspace import Arm, PoseGoal, Robot, Workspace, build_arm_space
from cspace.arms import JointValues, read_moveit_request, read_moveit_scene
from cspace.errors import AngleWarning, ConfigurationError, FileError, InputError
from planners import Upright
from tests.helpers.refusals import refusals, write
from tests.helpers.strategies import examples
from tests.helpers.urdfs import joint, link, planar_arm, pose_at, write_urdf

BAR = ((1.0, 0.1, 0.1), (0.5, 0, 0))
STATE = {"lift": 0.25, "shoulder": 0.5, "elbow": -0.5, "finger": 0.05, "follower": 0.05}
"""A state of all joints, as robots report it."""


def read_arm(folder, **options):
    """Read a lift that carries two bars in the plane and a gripper; the bars move."""
    slides = {"kind": "prismatic", "limits": (0.03, 0.1)}
    path = write_urdf(
        folder,
        link("base_link", ((0.2, 0.2, 0.2), (0, 0, -0.3))),
        *(link(name, BAR) for name in ("upper", "fore")),
        *(link(name) for name in ("column", "stand", "tool")),
        *(link(name, ((0.04, 0.04, 0.04), (1.05, 0, 0))) for name in ("left", "right")),
        joint("lift", "base_link", "column", kind="prismatic", limits=(0.0, 1.0)),
        joint("mount", "column", "stand", at=(0, 0, 0.5), kind="fixed"),
        joint("shoulder", "stand", "upper"),
        joint("elbow", "upper", "fore", at=(1, 0, 0), kind="continuous", limits=None),
        joint("wrist", "fore", "tool", at=(1, 0, 0), kind="fixed"),
        joint("finger", "fore", "left", axis=(0, 1, 0), **slides),
        joint(
            "follower", "fore", "right", axis=(0, -1, 0), extra='<mimic joint="finger"/>', **slides
        ),
    )
    srdf = folder / "arm.srdf"
    srdf.write_text(
        '<robot name="small"><group name="bars"><joint name="shoulder"/><joint name="elbow"/></group>'
        '<disable_collisions link1="upper" link2="fore"/><disable_default_collisions link="left"/>'
        '<disable_default_collisions link="right"/></robot>'
    )
    given_options = {"joints": "bars", "held_joints": JointValues(STATE), **options}
    return Arm.from_urdf(path, srdf, **given_options)


def joint_state(values):
    return {"joint_state": {"name": list(values), "position": list(values.values())}}


def make_object(name, at=(0, 0, 0), frame="world", **more):
    """Make a cube with a side of 0.2 m as a collision object."""
    pose = {"position": list(map(float, at)), "orientation": [0, 0, 0, 1]}
    box = {"type": "box", "dimensions": [0.2] * 3}
    header = {"frame_id": frame}
    return {"id": name, "header": header, "primitives": [box], "primitive_poses": [pose], **more}


def carry(link_name, *objects, **more):
    """Make a state of the robot with attached objects."""
    attached = [{"link_name": link_name, "object": each, **more} for each in objects]
    return {"attached_collision_objects": attached}


def write_scene(folder, *objects, **more):
    return write(folder, "scene.yaml", {"world": {"collision_objects": objects}, **more})


# ---- states and scenes ---------------------------------------------------------------------------


def test_joint_values_give_the_held_joints_and_the_configuration(tmp_path):
    arm = read_arm(tmp_path)
    assert arm.joints == ("shoulder", "elbow")
    assert arm.held_joints == {"lift": 0.25, "finger": 0.05}
    assert arm.configuration(JointValues(STATE)).tolist() == [0.5, -0.5]
    assert arm.configuration(JointValues(elbow=0.1), (0.3, 0.4)).tolist() == [0.3, 0.1]
    assert read_arm(tmp_path, held_joints=None).held_joints == {"lift": 0.0, "finger": 0.03}
    with pytest.raises(InputError, match="names 'wheel'; there are shoulder, elbow, lift, finger"):
        arm.configuration(JointValues(wheel=0.0))


def test_the_matrix_replaces_the_pairs_that_may_touch(tmp_path):
    """Both entries of a pair must agree."""
    arm = read_arm(tmp_path)
    names = ["upper", "fore", "table", "camera"]
    entries = np.zeros((4, 4), dtype=bool)
    entries[0, 1] = entries[1, 0] = entries[1, 2] = entries[2, 1] = entries[0, 2] = True
    matrix = {"entry_names": names, "entry_values": entries.tolist()}
    table = make_object("table", (1.5, 0.3, 0.75))
    scene = read_moveit_scene(write_scene(tmp_path, table, allowed_collision_matrix=matrix))
    with pytest.warns(UserWarning, match="names camera, which neither the arm nor the scene has"):
        space = build_arm_space(scene, arm)
    assert space.allowed_collisions == [("fore", "table")]
    one_body = {pair for pair, why in arm.allowed_collisions.items() if why == "one body"}
    assert set(space.arm.allowed_collisions) == {("fore", "upper")} | one_body
    without = read_moveit_scene(write_scene(tmp_path, table))
    assert build_arm_space(without, arm).arm.allowed_collisions == arm.allowed_collisions


@refusals(
    "objects, state, message",
    ([], carry("old", make_object("mug", frame="old")), "link_name of 'mug' is 'old'"),
    ([make_object("a", frame="tool")], {}, "in the frame 'tool'; a joint of the arm moves it"),
    (
        [make_object("a", frame="map")],
        {},
        "has poses in the frame 'map'; .*base_link",
    ),
    ([make_object("fore", (9, 9, 9))], {}, "has the object 'fore'; .*frame"),
    ([make_object("a", (9, 9, 9))], joint_state(STATE | {"lift": 0.5}), "has lift at 0.5; .*holds"),
)
def test_scenes_of_another_arm_are_refused(tmp_path, objects, state, message):
    scene = read_moveit_scene(write_scene(tmp_path, *objects, robot_state=state))
    with pytest.raises(InputError, match=message):
        build_arm_space(scene, read_arm(tmp_path).attach("old", Robot.ball(0.1), "tool"))


PAIR = {"entry_names": ["upper", "fore"], "entry_values": [[True, True]] * 2}
"""A matrix of links that touch."""


@pytest.mark.parametrize(
    "slip",
    [
        {
            "allowed_collision_matrix": {
                "entry_names": ["upper", "fore", "foer"],
                "entry_values": [[True] * 3] * 3,
            }
        },
        {
            "allowed_collision_matrix": {
                **PAIR,
                "default_entry_names": ["foer"],
                "default_entry_values": [True],
            }
        },
        {"robot_state": {"joint_state": {"name": ["foer"], "position": [0.0]}}},
        {"robot_state": carry("tool", make_object("mug", frame="tool"), touch_links=["foer"])},
    ],
    ids=["matrix", "defaults", "joint", "touch"],
)
def test_names_of_a_scene_that_nobody_has_are_warned_of(tmp_path, slip):
    scene = read_moveit_scene(write_scene(tmp_path, make_object("box", (1.5, 0, 1)), **slip))
    with pytest.warns(UserWarning, match="names foer, which neither the arm nor the scene has"):
        build_arm_space(scene, read_arm(tmp_path))


def test_a_base_below_the_world_of_a_urdf_is_not_taken_for_it(tmp_path):
    path = write_urdf(
        tmp_path,
        *(link("world"), link("base"), link("bar", BAR)),
        joint("mount", "world", "base", at=(0, 0, 1), kind="fixed"),
        joint("turn", "base", "bar"),
    )
    scene = read_moveit_scene(write_scene(tmp_path, make_object("box", (0.5, 0, 1))))
    assert not build_arm_space(scene, Arm.from_urdf(path)).is_free((0.0,))
    arm = Arm.from_urdf(path, base="base")
    with pytest.raises(InputError, match="'world'; the arm has no such frame; its base is 'base'"):
        build_arm_space(scene, arm)
    assert not build_arm_space(scene, arm, base_pose=pose_at(0, 0, 1)).is_free((0.0,))


@refusals(
    "more, message",
    (
        {"robot_state": {"joint_state": {"name": ["a"], "position": []}}},
        "has 1 joints but 0 positions at scene.robot_state",
    ),
    ({"robot_state": carry("tool", make_object("box"))}, "has 'box' twice"),
    (
        {"robot_state": carry("tool", make_object("b", frame="fore"))},
        "has poses in the frames 'fore', 'world'",
    ),
    (
        {"robot_state": {"multi_dof_joint_state": {"transforms": [{"translation": [0, 0, 1]}]}}},
        r"has a motion as scene.robot_state.multi_dof_joint_state.transforms\[0\]; poses are in",
    ),
)
def test_what_cannot_be_kept_of_a_scene_is_refused(tmp_path, more, message):
    path = write_scene(tmp_path, make_object("box"), **more)
    with pytest.raises(FileError, match=message) as caught:
        read_moveit_scene(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


class Header:
    """A message of ROS 1, which lists its fields as slots."""

    __slots__ = ("frame_id",)

    def __init__(self):
        self.frame_id = "world"


@dataclasses.dataclass
class Point:
    """A message as rosbags makes it, or a copy of it."""

    x: float
    y: float
    z: float


class Message:
    """A message of ROS 2, which says what its fields are."""

    __slots__ = ("_fields",)

    def __init__(self, **fields):
        self._fields = fields

    def get_fields_and_field_types(self):
        return dict.fromkeys(self._fields, "any")

    def __getattr__(self, name):
        if name not in self._fields:
            raise AttributeError(name)
        return self._fields[name]


def make_message(at):
    """Make the message of a scene with a box and a mesh."""
    turn = Message(x=0.0, y=0.0, z=0.0, w=1.0)
    box = Message(type=1, dimensions=array("d", [0.2, 0.2, 0.2]), polygon=Message(points=[]))
    corners = [Point(*row) for row in np.eye(4, 3, -1)]
    faces = [
        Message(vertex_indices=np.array(row))
        for row in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    ]
    thing = Message(
        id="box",
        header=Header(),
        operation=b"\0",
        primitives=[box],
        primitive_poses=(Message(position=Point(*at), orientation=turn),),
        meshes=[Message(triangles=faces, vertices=corners)],
        mesh_poses=[Message(position=Point(9.0, 9.0, 9.0), orientation=turn)],
    )
    octomap = Message(octomap=Message(data=array("b"), resolution=0.0))
    state = Message(joint_state=Message(name=["lift"], position=array("d", [0.25])))
    return Message(
        name="",
        world=Message(collision_objects=[thing], octomap=octomap),
        robot_state=state,
        is_diff=False,
    )


def test_scenes_are_read_from_messages_and_mappings_as_from_files(tmp_path):
    arm = read_arm(tmp_path)
    made = make_object("box", (1.5, 0.3, 0.75))
    mapping = {"world": {"collision_objects": [made]}}
    message = make_message((1.5, 0.3, 0.75))
    by_file = build_arm_space(read_moveit_scene(write_scene(tmp_path, made)), arm)
    rows = np.random.default_rng(0).uniform(-2.0, 2.0, (200, 2))
    expected = by_file.is_free(rows)
    assert 100 < expected.sum() <= 190
    for source in (mapping, mapping["world"], message):
        scene = read_moveit_scene(source)
        assert repr(scene).startswith("PlanningScene(planning scene: ")
        assert (build_arm_space(scene, arm).is_free(rows) == expected).all()
    assert read_moveit_scene(message).robot_state == {"lift": 0.25}
    cells = Workspace.from_moveit_scene(message, 0.1)
    assert len(cells.shapes) == 2 and cells.shapes[0].bounds[0] == pytest.approx([1.4, 0.2, 0.65])


@refusals(
    "source, message",
    (
        {"world": {"colision_objects": []}},
        r"^scene\.world has the unknown field 'colision_objects'",
    ),
    (
        make_message((math.nan, 0.0, 0.0)),
        r"^scene\.world.*position\.x has the value nan; it must be a finite number",
    ),
    (7, "^scene is 7; it must hold fields and values, not a int"),
    ({}, "holds no shape"),
)
def test_messages_that_are_no_scene_are_refused_as_arguments(source, message):
    with pytest.raises(InputError, match=message):
        read_moveit_scene(source)


def test_requests_are_read_from_mappings(tmp_path):
    goal = joint_goal(shoulder=1.0, elbow=0.5)
    path = write_request(tmp_path, goal)
    given = {"group_name": "bars", "start_state": joint_state(STATE), "goal_constraints": [goal]}
    arm = read_arm(tmp_path)
    by_file, by_mapping = read_moveit_request(path), read_moveit_request(given)
    assert repr(by_mapping).startswith("MotionPlanRequest(motion plan request: ")
    assert by_mapping.start_state == by_file.start_state
    np.testing.assert_array_equal(by_mapping.make_goals(arm), by_file.make_goals(arm))


# ---- requests ------------------------------------------------------------------------------------


def write_request(folder, *goals, **more):
    given = {"group_name": "bars", "start_state": joint_state(STATE), "goal_constraints": goals}
    return write(folder, "request.yaml", given | more)


def joint_goal(**values):
    rows = [{"joint_name": name, "position": value} for name, value in values.items()]
    return {"joint_constraints": rows}


def pose_goal(region=None, orientation=None, link="tool", frame="world", **more):
    """Make a goal from (type, dimensions, position), and from (quaternion, tolerances)."""
    head = {"header": {"frame_id": frame}, "link_name": link}
    goal = {}
    if region is not None:
        kind, dimensions, position = region
        pose = {"position": list(map(float, position)), "orientation": [0, 0, 1, 1]}
        shape = {"type": kind, "dimensions": list(dimensions)}
        volume = {"primitives": [shape], "primitive_poses": [pose]}
        goal["position_constraints"] = [head | {"constraint_region": volume} | more]
    if orientation is not None:
        quaternion, tolerances = orientation
        constraint = head | {"orientation": list(map(float, quaternion))}
        for axis, tolerance in zip("xyz", tolerances, strict=True):
            constraint[f"absolute_{axis}_axis_tolerance"] = tolerance
        goal["orientation_constraints"] = [constraint | more]
    return goal


ROBOWFLEX = """
start_state:
  joint_state:
    name: [shoulder, lift, elbow]
    position: [0, 0.25, 0.1]
workspace_parameters:
  header:
    frame_id: ""
  min_corner: [-1, -1, -1]
allowed_planning_time: 60
goal_constraints:
  - joint_constraints:
      - joint_name: shoulder
        position: -1.553916788418684
      - position: 0.04659921947761923
        joint_name: elbow
planner_id: BKPIECEGood
group_name: bars
num_planning_attempts: 2
"""
"""The layout of robowflex and MotionBenchMaker, as in robowflex's fetch_box/request0003.yaml."""


def test_requests_of_motion_bench_maker_are_planned(tmp_path):
    path = tmp_path / "request.yaml"
    path.write_text(ROBOWFLEX)
    request = read_moveit_request(path)
    assert request.time_limit == 60.0
    arm = read_arm(tmp_path, joints=request.group, held_joints=request.start_state)
    scene = read_moveit_scene(write_scene(tmp_path, make_object("box", (0.5, 1.5, 0.75))))
    start = arm.configuration(request.start_state)
    plan = planners.plan(build_arm_space(scene, arm), start, request.make_goals(arm), seed=0)
    assert plan.certified and plan.start.tolist() == [0.0, 0.1]
    assert plan.goal.tolist() == [-1.553916788418684, 0.04659921947761923]


def test_joint_goals_keep_other_joints_and_move_onto_limits(tmp_path):
    arm = read_arm(tmp_path)
    near = {"joint_name": "shoulder", "position": 3.05, "tolerance_below": 0.1}
    goals = joint_goal(elbow=9.0), {"joint_constraints": [near]}, joint_goal(lift=0.25, shoulder=1)
    made = read_moveit_request(write_request(tmp_path, *goals)).make_goals(arm)
    assert np.array(made).tolist() == [[0.5, 9.0], [3.0, -0.5], [1.0, -0.5]]


@refusals(
    "goal, message",
    (pose_goal(("sphere", (1,), (0, 2, 0)), link="hand"), "link_name is 'hand'"),
    (joint_goal(lift=0.5), r"goal_constraints\[0\] has lift at 0.5; .*holds"),
)
def test_goals_of_another_arm_are_refused(tmp_path, goal, message):
    request = read_moveit_request(write_request(tmp_path, goal))
    with pytest.raises((InputError, ConfigurationError), match=message):
        request.make_goals(read_arm(tmp_path))


@pytest.mark.parametrize(
    "frame, at, base_pose",
    [
        ("world", (1, 1, 0.75), None),
        ("map", (4, 1, 0.75), pose_at(5, 0, 0, (0, 0, np.pi / 2))),
    ],
)
def test_frames_of_pose_goals_are_those_of_the_arm(tmp_path, frame, at, base_pose):
    path = write_request(tmp_path, pose_goal(("box", (0.1, 0.2, 0.3), at), frame=frame))
    (goal,) = read_moveit_request(path).make_goals(read_arm(tmp_path), base_pose=base_pose)
    assert isinstance(goal, PoseGoal)
    np.testing.assert_allclose(np.asarray(goal.pose)[:3, 3], (1, 1, 0.75), atol=1e-12)
    assert goal.tolerance == (0.05, math.inf)


def satisfies(goal, pose):
    """Return True if a pose satisfies the constraints, as in MoveIt's kinematic_constraint.cpp."""
    for constraint in goal.get("position_constraints", ()):
        (shape,) = constraint["constraint_region"]["primitives"]
        (placed,) = constraint["constraint_region"]["primitive_poses"]
        turn = Rotation.from_quat(placed["orientation"]).inv()
        x, y, z = turn.apply(pose[:3, 3] - placed["position"])
        sizes = shape["dimensions"]
        inside = {
            "box": (2.0 * np.abs((x, y, z)) <= np.resize(sizes, 3)).all(),
            "sphere": math.hypot(x, y, z) <= sizes[0],
            "cylinder": abs(z) <= sizes[0] / 2 and math.hypot(x, y) <= sizes[-1],
        }
        if not inside[shape["type"]]:
            return False
    for constraint in goal.get("orientation_constraints", ()):
        turn = Rotation.from_quat(constraint["orientation"]).inv()
        apart = turn * Rotation.from_matrix(pose[:3, :3])
        is_vector = constraint["parameterization"] == 1
        angles = np.abs(apart.as_rotvec() if is_vector else apart.as_euler("XYZ"))
        if (angles > [constraint[f"absolute_{axis}_axis_tolerance"] for axis in "xyz"]).any():
            return False
    return True


TURNS = st.tuples(*[st.floats(-3, 3)] * 3)


@examples(25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kind=st.sampled_from([None, "box", "sphere", "cylinder"]),
    sizes=st.tuples(*[st.floats(0.05, 1.0)] * 3),
    at=TURNS,
    turn=TURNS,
    tolerances=st.none() | st.tuples(*[st.floats(0.01, 4.0)] * 3),
    parameterization=st.integers(0, 1),
    seed=st.integers(0, 2**20),
)
def test_pose_goals_satisfy_the_constraints(
    tmp_path,
    kind,
    sizes,
    at,
    turn,
    tolerances,
    parameterization,
    seed,
):
    """Draw poses up to the tolerance of the goal."""
    rng = np.random.default_rng(seed)
    region = None if kind is None else (kind, sizes[: {"sphere": 1, "box": 3}.get(kind, 2)], at)
    quaternion = Rotation.from_euler("xyz", turn).as_quat()
    goal = pose_goal(region, None if tolerances is None else (quaternion, tolerances))
    for constraint in goal.get("orientation_constraints", ()):
        constraint["parameterization"] = parameterization
    try:
        request = read_moveit_request(write_request(tmp_path, goal))
        (made,) = request.make_goals(read_arm(tmp_path))
    except FileError as error:
        assert any(reason in str(error) for reason in ("any pose", "0 pose constraints"))
        return
    assert isinstance(made, PoseGoal)
    most = np.where(np.isinf(made.tolerance), (9.0, math.pi), made.tolerance)
    for _ in range(30):
        directions = rng.normal(size=(2, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        distance, angle = rng.choice([0.5, 1 - 1e-9], size=2) * most
        pose = np.array(made.pose)
        pose[:3, 3] += distance * directions[0]
        pose[:3, :3] = Rotation.from_rotvec(angle * directions[1]).as_matrix() @ pose[:3, :3]
        assert satisfies(goal, pose)


@pytest.mark.filterwarnings("ignore:motion plan request. .* about its y axis")
@examples(40)
@given(
    tolerances=st.tuples(*[st.sampled_from([0.05, 0.4, 1.5, 1.7, 3.0, 3.14, 4.0])] * 3),
    turn=TURNS,
    seed=st.integers(0, 2**20),
)
def test_what_is_kept_satisfies_the_constraints_of_paths(tmp_path_factory, tolerances, turn, seed):
    rng = np.random.default_rng(seed)
    wanted = Rotation.from_euler("xyz", turn)
    kept = pose_goal(None, (wanted.as_quat(), tolerances), link="fore")
    (constraint,) = kept["orientation_constraints"]
    constraint["parameterization"] = 0
    request = {"goal_constraints": [joint_goal(elbow=1.0)], "path_constraints": kept}
    uprights = read_moveit_request(request).make_keep(read_arm(tmp_path_factory.mktemp("arm")))
    angles = rng.uniform(-1.0, 1.0, (200, 3)) * np.minimum(1.1 * np.array(tolerances), math.pi)
    apart = Rotation.from_euler("XYZ", [(0.0, 0.0, 0.0), *angles, *(0.2 * angles)])
    is_kept = np.ones(len(apart), dtype=bool)
    for upright in uprights:
        assert upright.frame == "fore"
        cosines = (wanted * apart).apply(upright.axis) @ upright.direction
        is_kept &= np.abs(np.arccos(np.clip(cosines, -1, 1)) - upright.angle) <= upright.tolerance
    x, y, z = tolerances
    is_free = min(x, z) > math.pi and y > math.pi / 2
    assert is_kept[0] and bool(uprights) != is_free
    for rotation in (wanted * apart)[is_kept]:
        pose = np.eye(4)
        pose[:3, :3] = rotation.as_matrix()
        assert satisfies(kept, pose)
    # A tilt alone is kept as far as MoveIt allows it, except beside a free y axis.
    tilt = 0.99 * min(x, y, 1.5) if y < math.pi or is_free else 0.0
    axis = rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(2)]
    tilted = wanted * Rotation.from_rotvec(tilt * axis)
    for upright in uprights[:1]:
        cosine = float(tilted.apply(upright.axis) @ upright.direction)
        deviation = abs(math.acos(min(cosine, 1.0)) - upright.angle)
        assert deviation <= upright.tolerance + 1e-7


@pytest.mark.parametrize("free", [0, 1, 2])
def test_a_goal_turned_about_a_free_axis_is_reached_or_the_request_warns(free, tmp_path):
    """Euler angles of x and z are ambiguous where y, the middle one, is a right angle."""
    tolerances = np.full(3, 0.3)
    tolerances[free] = 2.0 * math.pi
    kept = pose_goal(None, ((0, 0, 0, 1), tolerances), link="fore")
    request = {"goal_constraints": [joint_goal(elbow=1.0)], "path_constraints": kept}
    turn = Rotation.from_rotvec(1.2 * np.eye(3)[free])
    pattern = r"path_constraints lets fore turn freely about its y axis; keep= allows (\S+) rad"
    with pytest.warns(UserWarning, match=pattern) if free == 1 else nullcontext() as caught:
        uprights = read_moveit_request(request).make_keep(read_arm(tmp_path))
    is_kept = True
    for upright in uprights:
        angle = math.acos(turn.apply(upright.axis) @ upright.direction)
        is_kept &= abs(angle - upright.angle) <= upright.tolerance
    assert is_kept == (free != 1)
    if free == 1:
        (limit,) = re.findall(pattern, str(caught[0].message))
        assert float(limit) == pytest.approx(max(each.tolerance for each in uprights), abs=1e-5)


def test_a_request_keeps_a_link_upright_in_the_frame_of_the_base(tmp_path):
    arm = read_arm(tmp_path)
    flat = pose_goal(None, ((0, 0, 0, 1), (0.1, 0.1, math.pi)), link="tool")
    request = read_moveit_request(
        write_request(tmp_path, joint_goal(shoulder=1.0, elbow=0.5), path_constraints=flat)
    )
    (kept,) = request.make_keep(arm)
    assert kept == Upright("tool", tolerance=0.1)
    space = build_arm_space({}, arm)
    start = arm.configuration(request.start_state)
    plan = planners.plan(space, start, request.make_goals(arm)[0], keep=request.make_keep(arm))
    assert plan.certified and plan.keep == (kept,)
    (turned,) = request.make_keep(arm, base_pose=pose_at(0, 0, 1, (math.pi / 2, 0, 0)))
    assert turned.direction == pytest.approx((0, 1, 0))
    with pytest.raises(InputError, match="link_name is 'tool'"):
        request.make_keep(planar_arm())
    assert read_moveit_request(write_request(tmp_path, joint_goal(elbow=1))).make_keep(arm) == []


SPHERE = ("sphere", (0.1,), (1, 0, 0))
ELBOW = joint_goal(elbow=1)
MESH = {"link_name": "fore", "constraint_region": {"meshes": [1]}}
LEVEL = (0, 0, 0, 1)


@refusals(
    "goals, more, message",
    (
        [{"joint_constraints": [{"joint_name": "a", "position": 1, "tolerance_below": -1}]}],
        {},
        "has -1 as .*tolerance_below; it may not be negative",
    ),
    (
        [pose_goal(SPHERE) | pose_goal(None, ((0, 0, 0, 1), (1, 1, 1)), link="fore")],
        {},
        "has 2 constraints of fore, tool at request.goal",
    ),
    ([], {}, "has no goal_constraints"),
    ([ELBOW | pose_goal(SPHERE)], {}, "has 1 joint and 1 pose constraints at .*kinds"),
    ([pose_goal(None, (LEVEL, (7, 7, 7)))], {}, "has tolerances beyond half a turn at .*pose"),
    ([pose_goal(None, (LEVEL, (0, 0, 0)))], {}, "has a tolerance of zero at .*computed"),
    ([pose_goal(SPHERE, target_point_offset=[1, 0, 0])], {}, "target_point_offset; .*not read"),
    ([{"position_constraints": [MESH]}], {}, "meshes; .*not read"),
    ([ELBOW], {"path_constraints": ELBOW}, "joint_constraints; .*not read"),
    (
        [ELBOW],
        {"start_state": carry("fore", make_object("a", frame="fore"))},
        "attached_collision_objects; .*not read",
    ),
    (
        [ELBOW],
        {"path_constraints": pose_goal(None, ((0, 0, 0, 1), (0.1, 0.0, 4)))},
        "has a tolerance of zero at request.path_constraints",
    ),
    (
        [ELBOW],
        {"path_constraints": pose_goal(None, ((0, 0, 0, 1), (1, 1, 4)), parameterization=1)},
        r"has 1 as request.path_constraints.orientation_constraints\[0\].parameterization",
    ),
)
def test_what_a_plan_would_not_obey_is_refused(tmp_path, goals, more, message):
    path = write_request(tmp_path, *goals, **more)
    with pytest.raises(FileError, match=message) as caught:
        read_moveit_request(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_a_tolerance_in_degrees_warns(tmp_path):
    path = write_request(tmp_path, pose_goal(SPHERE, ((0, 0, 0, 1), (10.0, 10.0, 10.0))))
    with pytest.warns(
        AngleWarning, match="axis_tolerance is beyond .* 10 degrees are 0.174533 rad"
    ):
        read_moveit_request(path)
    path = write_request(tmp_path, pose_goal(SPHERE, ((0, 0, 0, 1), (0.174533,) * 3)))
    (goal,) = read_moveit_request(path).make_goals(read_arm(tmp_path))
    assert goal.tolerance[1] < 0.2
