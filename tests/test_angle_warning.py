"""Warnings about angles, rates and speeds that look like another unit, at the user's line."""

import inspect
import math
import re
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely

import cspace
import planners
from cspace import AngleWarning, Robot, UnitWarning, Workspace
from cspace.errors import CspaceError
from cspace.lanes import Mover, RouteGraph, apart
from tests.helpers.calls import CALLS, make_objects, prepare
from tests.helpers.urdfs import joint, link, write_urdf

FREE_Q = 1.0, 1.0, 0.5


@cache
def turning():
    workspace = Workspace.from_array(np.eye(30, dtype=bool)[::-1], 0.1)
    return cspace.build(workspace, Robot.rectangle(0.2, 0.1), rotations=12)


def list_warnings(call):
    """Return all warnings of a call."""
    with warnings.catch_warnings(record=True, action="always") as caught:
        call()
    return caught


TURNING = [
    call
    for call in CALLS
    if call[0] in ("CSpace", "TiledCSpace", "Gate", "planners")
    and call[1] not in ("distance", "find_goals", "interpolate", "steps_between")
    and call[2] in ("q", "q0", "q1", "start", "goal", "path", "rows", "via")
]
"""Calls that take a configuration with a yaw, or rows of these, and say so if it is in degrees."""

SINGLE = {
    *("check_configuration", "check_endpoint", "closest", "explain", "free_region", "plan"),
    *("min_path_length", "nearest_free", "path_exists", "removals"),
}
"""Calls of one configuration, whose warning has its radians; those of rows say the same of all."""


def check_heard(label, call, is_single):
    """Check that a yaw in degrees is heard in one sentence, at the line of the caller."""
    for yaw in (2.0 * math.pi, -2.0 * math.pi, 4.0):
        assert not list_warnings(lambda yaw=yaw: call(yaw))
    for yaw in (90.0, -180.0, 7.0):
        heard = list_warnings(lambda yaw=yaw: call(yaw))
        # Some calls go through tests/helpers/answers.py.
        assert all(Path(__file__).parent in Path(each.filename).parents for each in heard)
        assert [each.category for each in heard] == [AngleWarning]
        text = str(heard[0].message)
        assert text.startswith(f"{label}: yaw is beyond a whole turn; it is in rad, and ")
        example = yaw if is_single else 90.0
        assert f"and {example:g} degrees are {math.radians(example):g}" in text


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    return make_objects(tmp_path_factory.mktemp("objects"))


@pytest.mark.parametrize("owner, name, argument", TURNING)
def test_a_yaw_in_degrees_is_named_by_the_call_that_takes_it(objects, owner, name, argument):
    call, arguments, _ = prepare(objects, owner, name, argument)
    given = arguments[argument]

    def turn(yaw):
        if isinstance(given, list):
            call(**{**arguments, argument: [given[0], (*given[1][:2], yaw)]})
        else:
            call(**{**arguments, argument: (*given[:2], yaw)})

    is_mark = name == "plot" and argument != "path"
    label = "via[1]" if argument == "via" else argument
    check_heard(label, turn, name in SINGLE or is_mark)


MORE_CALLS = {
    "q of rows": lambda space, q: space.is_free([FREE_Q] * 3 + [q]),
    "q of few rows": lambda space, q: space.clearance([FREE_Q, q]),
    "q0 of motions": lambda space, q: space.motion_is_free([q, FREE_Q], FREE_Q),
    "goal[1]": lambda space, q: planners.plan(space, FREE_Q, [FREE_Q, q]),
    "goal near": lambda space, q: planners.plan(space, FREE_Q, planners.Near(q, 0.2, 0.1)),
    "rotation": lambda space, q: space.states_at(q[2:]),
}
"""Calls that take other numbers of configurations, by the argument that is named."""


@pytest.mark.parametrize("call", MORE_CALLS)
def test_a_yaw_in_degrees_is_named_among_others(call):
    is_single = "goal" in call or call == "rotation"
    label = call.split()[0]
    check_heard(label, lambda yaw: MORE_CALLS[call](turning(), (1.0, 1.0, yaw)), is_single)


def test_a_loop_prints_one_warning():
    def repeat():
        for yaw in (90.0, -180.0, 7.0):
            turning().is_free((1.0, 1.0, yaw))

    repeat()  # compiling at the first call resets Python's registry of warnings
    with warnings.catch_warnings(record=True, action="default") as caught:
        repeat()
    assert len(caught) == 1


@pytest.mark.parametrize(
    "call",
    [
        lambda: turning().path_obstacle_distance([FREE_Q, (1.0, 1.0, 90.0)]),
        lambda: turning().plot(path=[FREE_Q, (1.0, 1.0, 90.0)]),
        lambda: gate().check_twists(FREE_Q, [(0.1, 90.0)]),
        lambda: gate().slow_down(FREE_Q, (0.1, 90.0)),
        lambda: gate().slow_down((1.0, 1.0, 90.0), (0.1, 0.0), leaving=True),
        lambda: gate().slow_down(FREE_Q, (0.0, 0.0), twist_now=(0.0, -90.0)),
    ],
)
def test_a_call_warns_once_of_what_it_asks_twice(call):
    assert len(list_warnings(call)) == 1


# ---- every call that takes an angle, a rate or a speed -------------------------------------------

BAR = ((0.5, 0.1, 0.1), (0.25, 0.0, 0.0))
GRAPH = [(1.0, 1.0), (2.0, 1.0)], [(0, 1)]
LIMITS = {
    "max_velocity": 1.0,
    "max_acceleration": 1.0,
    "max_angular_velocity": 1.0,
    "max_angular_acceleration": 1.0,
}
TILTED = {
    "header": {"frame_id": "map"},
    "pose": {
        "position": {"x": 1.0, "y": 1.0, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.5, "z": 0.0, "w": math.sqrt(0.75)},
    },
}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """An arm of two joints, of which the second is continuous; 1.5 rad/s at most."""
    turns = joint("elbow", "upper", "fore", (0.5, 0, 0), kind="continuous", limits=None)
    parts = link("foot"), link("upper", BAR), link("fore", BAR), turns
    first = joint("shoulder", "foot", "upper")
    return cspace.Arm.from_urdf(write_urdf(tmp_path_factory.mktemp("arm"), *parts, first))


@cache
def drive():
    """Plan a turn on the spot between two straights."""
    return planners.plan(turning(), (0.5, 1.0, 0.0), (0.5, 2.0, 1.5), drive=planners.Differential())


def gate(**limits):
    return cspace.Gate(turning(), dt=0.1, max_deceleration=(1.0, 1.0), **limits)


def zones(speed=0.3):
    return planners.SpeedZones([(shapely.box(0.5, 0.5, 1.0, 1.0), speed)])


def near_goal(angle=0.1, yaw=0.0):
    return planners.plan(turning(), FREE_Q, planners.Near((0.5, 1.0, yaw), 0.2, angle))


def travel(**limits):
    return drive().trajectory(**LIMITS | limits)


def reach(arm, **limits):
    space = cspace.build_arm_space({}, arm)
    plan = planners.plan(space, (0.0, 0.0), (0.5, 0.5))
    return plan.trajectory(**{"max_velocity": 1.0, "max_acceleration": 1.0} | limits)


YAW = {
    "obstacle_distance turns": lambda q, _: turning().obstacle_distance(FREE_Q, 0.0, q[2]),
    "plot rotation": lambda q, _: turning().plot(rotation=q[2]),
    "free_region yaw_width": lambda q, _: turning().free_region(FREE_Q, yaw_width=q[2]),
    "Gate tracking": lambda q, _: gate(tracking=(0.01, 0.01, q[2])),
    "Mover motion": lambda q, _: apart(Mover("disc:0.1", q), Mover("disc:0.1", (2.0, 2.0))),
    "Near angle": lambda q, _: near_goal(angle=q[2]),
    "Near configuration": lambda q, _: near_goal(yaw=q[2]),
    "RouteGraph.from_arrays headings": lambda q, _: RouteGraph.from_arrays(*GRAPH, headings=q[2]),
    "RouteGraph.from_arrays yaws": lambda q, _: RouteGraph.from_arrays(*GRAPH, yaws=[q[2], np.nan]),
    "SpeedZones.largest_speed q": lambda q, _: zones().largest_speed(turning(), [q]),
    "SpeedZones.largest_speed turns": lambda q, _: zones().largest_speed(
        turning(), FREE_Q, 0.1, q[2]
    ),
    "SlowNear.largest_speed q": lambda q, _: planners.SlowNear(turning(), 0.1, 0.5).largest_speed(
        turning(), [q]
    ),
    "Upright angle": lambda q, _: planners.Upright("fore", angle=q[2]),
    "Upright tolerance": lambda q, _: planners.Upright("fore", tolerance=q[2]),
    "PoseGoal tolerance": lambda q, _: cspace.PoseGoal("fore", np.eye(4), (0.1, q[2])),
    "configuration_of tilt_tolerance": lambda q, _: cspace.ros.configuration_of(
        TILTED, turning(), tilt_tolerance=q[2]
    ),
    "Arm.configuration values": lambda q, arm: arm.configuration({"elbow": q[2]}),
    "Arm.inverse tolerance": lambda q, arm: arm.inverse("fore", np.eye(4), tolerance=(0.1, q[2])),
    "Arm.link_speed q": lambda q, arm: arm.pose((0.0, q[2]), "fore"),
    "ArmSpace.classify q": lambda q, arm: cspace.build_arm_space({}, arm).classify((0.0, q[2])),
    "build_joint_map spacing": lambda q, arm: cspace.build_joint_map(
        cspace.build_arm_space({}, arm), q[2]
    ),
    "Trajectory.along path": lambda q, arm: planners.Trajectory.along(
        cspace.build_arm_space({}, arm), [(0.0, 0.0), (0.0, q[2])], max_acceleration=1.0
    ),
}
"""Call with a configuration whose yaw is in degrees, or with this angle, by name and parameter."""

RATES = {
    "Arm.link_speed velocity": lambda arm: arm.link_speed("fore", (0.0, 0.0), (0.0, 90.0)),
    "Gate max_deceleration": lambda _: cspace.Gate(turning(), dt=0.1, max_deceleration=(1.0, 90.0)),
    "Gate max_velocity": lambda _: gate(max_velocity=(1.0, 90.0)),
    "Gate max_velocity of rows": lambda _: gate(max_velocity=(1.0, 1.0, 90.0)),
    "Gate max_velocity of joints": lambda arm: cspace.Gate(
        cspace.build_arm_space({}, arm), dt=0.1, max_velocity=90.0
    ),
    "Gate max_velocity over the URDF's": lambda arm: cspace.Gate(
        cspace.build_arm_space({}, arm), dt=0.1, max_velocity=(30.0, 1.0)
    ),
    "Gate.check_twists twists": lambda _: gate().check_twists(FREE_Q, [(0.1, 90.0)]),
    "Gate.check_twists before": lambda _: cspace.Gate(turning(), dt=0.1, max_jerk=9.0).check_twists(
        FREE_Q, [(0.1, 0.0)], before=[(0.1, 90.0)]
    ),
    "Gate.slow_down twist": lambda _: gate().slow_down(FREE_Q, (0.1, 90.0)),
    "Gate.slow_down twist_now": lambda _: gate().slow_down(FREE_Q, (0, 0), twist_now=(0, -90.0)),
    "Gate.stop_distance twist": lambda _: gate().stop_distance((0.1, 90.0)),
    "Plan.trajectory max_angular_velocity": lambda _: travel(max_angular_velocity=90.0),
    "Plan.trajectory max_angular_acceleration": lambda _: travel(max_angular_acceleration=90),
    "Plan.trajectory max_velocity": lambda arm: reach(arm, max_velocity=90.0),
    "Plan.trajectory max_velocity by name": lambda arm: reach(arm, max_velocity={"elbow": 90}),
    "Plan.trajectory max_velocity over the URDF's": lambda arm: reach(arm, max_velocity=45.0),
    "Plan.trajectory max_acceleration": lambda arm: reach(arm, max_acceleration=90.0),
}
"""Call with 90 degrees a second, or a second squared, as radians."""

SPEEDS = {
    "Gate max_velocity": lambda _: gate(max_velocity=(400.0, 1.0)),
    "Gate.check_twists twists": lambda _: gate().check_twists(FREE_Q, [(400.0, 0.0)]),
    "Mover velocity": lambda _: apart(
        Mover("disc:0.1", (1.0, 1.0), velocity=(400.0, 0.0)),
        Mover("disc:0.1", (2.0, 2.0)),
        until=1.0,
    ),
    "Mover growth": lambda _: apart(
        Mover("disc:0.1", (1.0, 1.0), growth=400.0), Mover("disc:0.1", (2.0, 2.0)), until=1.0
    ),
    "Plan.trajectory max_velocity": lambda _: travel(max_velocity=400.0),
    "Plan.trajectory speed": lambda _: travel(speed=400.0),
    "plan speed": lambda _: planners.plan(
        turning(), FREE_Q, (0.5, 1.0, 0.0), objective="time", speed=400.0
    ),
    "SlowNear speed": lambda _: planners.SlowNear(turning(), 400.0, 0.5),
    "SpeedZones zones": lambda _: zones(400.0),
    "SpeedZones.from_mask max_velocity": lambda _: planners.SpeedZones.from_mask(
        make_mask(), "percent", max_velocity=400.0
    ),
    "ToolSpeed speed": lambda _: planners.ToolSpeed("fore", 400.0),
}
"""Call with 400 mm/s as m/s."""

NOT_ASKED = {
    *("Grid units", "plan objective", "RouteGraph.open heading", "SpeedZones.open speed"),  # words
    *("Arm.from_urdf held_joints", "overlap_count q", "ConvexRegion.contains q"),  # elsewhere
    "ConvexRegion.unwrap q",
    *("obstacle_distance lengths", "SpeedZones.largest_speed lengths", "Search range"),  # lengths
    *("Car max_lateral_acceleration", "Differential max_lateral_acceleration"),
    *("Plan.trajectory max_jerk", "Plan.trajectory max_angular_jerk"),  # any number is usual
    "follow_line tolerance",  # as of PoseGoal
    *("Rotations.of value", "build rotations"),  # borders of a whole turn
}
"""Parameters with numbers of other quantities, or whose calls other tests ask."""

SPACES = ("Workspace", "Space", "CSpace", "TiledCSpace", "ArmSpace")
RESULTS = ("Arm", "Closest", "NodeVerdict", "Plan", "RouteGraph")
"""Classes whose attributes are answers."""


def make_mask():
    mask = cspace.ros.OccupancyGrid()
    mask.info.width, mask.info.height, mask.info.resolution = 2, 1, 0.1
    mask.data.extend([0, 50])
    return mask


def list_parameters():
    """Return the documented parameters of all public calls that are angles, rates or speeds."""
    found = set()
    modules = cspace, planners, cspace.lanes, cspace.ros
    pairs = [(name, getattr(module, name)) for module in modules for name in dir(module)]
    calls = [(name, each) for name, each in pairs if callable(each) and not name.startswith("_")]
    for name, kind in calls:
        found |= {f"{name} {each}" for each in list_units(kind) if name not in RESULTS}
        for method in vars(kind) if inspect.isclass(kind) else ():
            if not method.startswith("_") and callable(getattr(kind, method)):
                prefix = "" if name in SPACES else f"{name}."
                found |= {f"{prefix}{method} {each}" for each in list_units(getattr(kind, method))}
    return found


def list_units(call):
    """Return the parameters of a call whose description names a unit of angles or speeds."""
    parts = re.split(r"\n([A-Z]\w+)\n-+\n", "\n" + (inspect.getdoc(call) or ""))
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    text = sections.get("Parameters", sections.get("Attributes", ""))
    entries = re.findall(r"^(\S[^\n:]*?) *: [^\n]*\n((?:[ ]+[^\n]*\n?|\n)*)", text, re.MULTILINE)
    known = inspect.signature(call).parameters if entries else ()
    named = [names for names, words in entries if re.search(r"\b(radians?|rad|m/s)\b", words)]
    return {name for names in named for name in names.split(", ") if name in known}


def hear(call):
    """Return the categories of a call's warnings; a refusal that names degrees is one, too."""
    with warnings.catch_warnings(record=True, action="always") as heard:
        try:
            call()
        except CspaceError as error:
            if "degrees" in str(error):
                return {AngleWarning}
    return {each.category for each in heard}


def test_every_parameter_with_an_angle_or_a_speed_is_asked():
    asked = {" ".join(name.split()[:2]) for table in (YAW, RATES, SPEEDS) for name in table}
    asked |= {f"{'Gate.' * (owner == 'Gate')}{name} {each}" for owner, name, each in TURNING}
    assert list_parameters() - asked - NOT_ASKED == set()


@pytest.mark.parametrize("name", YAW)
def test_90_degrees_are_heard_and_a_quarter_turn_is_not(name, arm):
    assert AngleWarning in hear(lambda: YAW[name]((1.0, 1.0, 90.0), arm))
    assert AngleWarning not in hear(lambda: YAW[name]((1.0, 1.0, 0.5), arm))


@pytest.mark.parametrize("name", RATES)
def test_90_degrees_a_second_are_heard(name, arm):
    assert AngleWarning in hear(lambda: RATES[name](arm))


@pytest.mark.parametrize("name", SPEEDS)
def test_400_millimetres_a_second_are_heard(name, arm):
    assert UnitWarning in hear(lambda: SPEEDS[name](arm))


def test_usual_limits_are_not_heard(arm):
    assert hear(lambda: gate(max_velocity=(2.0, 3.0), tracking=(0.05, 0.05, 0.1))) == set()
    assert hear(lambda: travel(max_velocity=30.0, max_angular_velocity=12.0)) == set()
    assert hear(lambda: reach(arm, max_velocity=3.0, max_acceleration=40.0)) == set()
