"""The packages of the workspace for ROS 2 name what they need, and their files fit each other."""

import ast
import re
import runpy
import sys
from types import ModuleType
from xml.etree import ElementTree

import pytest
import yaml

from tests.helpers.nav2 import ANSWERS, list_needs
from tests.helpers.repository import ROOT

CPP, PYTHON = ROOT / "ros/cspace_nav2", ROOT / "ros/cspace_nav2_py"
PARAMS = yaml.safe_load((CPP / "params/navigation.yaml").read_text())


def test_the_cpp_package_names_what_cmake_finds():
    text = (CPP / "CMakeLists.txt").read_text()
    found = set(re.findall(r"find_package\((\w+) REQUIRED", text))
    found |= set(re.search(r"set\(dependencies (.*)\)", text)[1].split())
    found -= {"${dependency}", "cspace"}  # no keys of rosdep
    assert found <= list_needs(CPP)
    # Maps are compressed unless told otherwise.
    assert "find_package(cspace REQUIRED COMPONENTS zstd" in text
    assert "libzstd-dev" in list_needs(CPP)


def test_the_python_package_names_what_its_node_imports():
    tree = ast.parse((PYTHON / "cspace_nav2_py/planner_node.py").read_text())
    modules = {
        each.module.split(".")[0] for each in ast.walk(tree) if isinstance(each, ast.ImportFrom)
    }
    modules = {"tf2_ros_py" if name == "tf2_ros" else name for name in modules}
    assert {
        name for name in modules if name.endswith(("_msgs", "_interfaces", "_py"))
    } <= list_needs(PYTHON)


def test_each_folder_that_the_launch_file_reads_is_installed():
    text = (CPP / "CMakeLists.txt").read_text()
    (folders,) = re.findall(r"install\(DIRECTORY (.*) DESTINATION share", text)
    assert all((CPP / folder).is_dir() for folder in folders.split())
    assert {"launch", "params", "behavior_trees"} <= set(folders.split())


def test_each_parameter_of_the_params_file_is_declared():
    maker = (CPP / "include/cspace_nav2/map_maker.hpp").read_text()
    for own, file in (
        (PARAMS["planner_server"]["ros__parameters"]["GridBased"], "src/planner.cpp"),
        (PARAMS["cspace_gate"]["ros__parameters"], "src/gate_node.cpp"),
    ):
        text = (CPP / file).read_text() + maker
        assert set(own) <= set(re.findall(r'parameters\.\w+\("(\w+)"', text)) | {"plugin"}
    node = ast.parse((PYTHON / "cspace_nav2_py/planner_node.py").read_text())
    (table,) = (
        each.value
        for each in node.body
        if isinstance(each, ast.Assign) and ast.unparse(each.targets[0]) == "PARAMETERS"
    )
    names = {key.value for key in table.keys}
    assert set(PARAMS["cspace_planner"]["ros__parameters"]) <= names
    own = yaml.safe_load((PYTHON / "params.yaml").read_text())
    assert set(own["cspace_planner"]["ros__parameters"]) <= names


class Recorded:
    """A class of launch that keeps what it is made of."""

    def __init__(self, *arguments, **options):
        self.arguments, self.options = arguments, options


@pytest.fixture
def launch(monkeypatch):
    """Return a function that runs the launch file over stand-ins, with arguments that are true; it returns the nodes."""
    for name in ("launch", "launch.actions", "launch.conditions", "launch.substitutions"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    for name in ("", ".actions", ".parameter_descriptions", ".substitutions"):
        monkeypatch.setitem(sys.modules, "launch_ros" + name, ModuleType("launch_ros" + name))
    for name in ("LaunchDescription",):
        setattr(sys.modules["launch"], name, Recorded)
    for module, names in {
        "launch.actions": ["DeclareLaunchArgument", "OpaqueFunction"],
        "launch.conditions": ["IfCondition"],
        "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
        "launch_ros.actions": ["Node"],
        "launch_ros.parameter_descriptions": ["ParameterValue"],
        "launch_ros.substitutions": ["FindPackageShare"],
    }.items():
        for name in names:
            setattr(sys.modules[module], name, type(name, (Recorded,), {}))
    params = str(CPP / "params/navigation.yaml")
    sys.modules["launch.substitutions"].LaunchConfiguration.perform = lambda *_: params
    found = runpy.run_path(str(CPP / "launch/navigation.launch.py"))
    *_, nodes = found["generate_launch_description"]().arguments[0]

    def start(*true):
        def evaluate(self, _):
            return self.arguments[0].arguments[0] in true

        condition = sys.modules["launch.conditions"].IfCondition
        monkeypatch.setattr(condition, "evaluate", evaluate, raising=False)
        return nodes.options["function"](None)

    return start


def list_managed(nodes):
    """Return the nodes of each lifecycle manager, in their order."""
    return [
        own["node_names"]
        for each in nodes
        for own in each.options["parameters"]
        if isinstance(own, dict) and "node_names" in own
    ]


@pytest.mark.parametrize("drives", ["gate", "navigate", "use_simulator"])
def test_the_launch_file_starts_programs_that_are_installed(launch, drives):
    nodes = launch(drives, "node")
    is_simulated = drives == "use_simulator"
    started = {(each.options["package"], each.options["executable"]) for each in nodes}
    installed = re.search(
        r"install\(TARGETS ([\w ]+) DESTINATION lib/", (CPP / "CMakeLists.txt").read_text()
    )
    for package, program in started:
        if package == "cspace_nav2":
            assert program in installed[1].split()
        elif package == "cspace_nav2_py":
            assert f'f"{program} = ' in (PYTHON / "setup.py").read_text()
        else:
            assert package in list_needs(CPP)
    names = [each for managed in list_managed(nodes) for each in managed]
    names += ["cspace_planner", *(["laser", "loopback_simulator"] if is_simulated else [])]
    managers = {"lifecycle_manager"}
    assert sorted(names) == sorted(
        each.options["name"] or each.options["executable"]
        for each in nodes
        if each.options["executable"] not in managers
    )
    first = {
        each.options["name"] or each.options["executable"]: each.options["parameters"][0]
        for each in nodes
    }
    footprint = "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"
    assert first["cspace_gate"]["robot"].arguments == (f"footprint:{footprint}",)
    assert first["cspace_planner"]["footprint"].arguments == (footprint,)
    assert first["cspace_planner"]["footprint_padding"] == 0.025
    if drives != "gate":
        assert first["controller_server"] == first["cspace_planner"]


def test_nodes_are_brought_up_after_those_they_ask(launch):
    assert list_managed(launch()) == [["map_server"], ["planner_server"]]
    maps, gate, plans = list_managed(launch("gate"))
    assert (maps, gate, plans) == (["map_server"], ["cspace_gate"], ["planner_server"])
    *_, driving = list_managed(launch("navigate"))
    assert driving[-1] == "bt_navigator" and "planner_server" in driving


CHAIN = {
    "controller_server": ({"odom", "speed_limit"}, {"cmd_vel"}),
    "behavior_server": (set(), {"cmd_vel"}),
    "velocity_smoother": ({"cmd_vel"}, {"cmd_vel_smoothed"}),
    "gate_node": ({"cmd_vel_smoothed"}, {"cmd_vel"}),
    "loopback_simulator": ({"cmd_vel", "initialpose"}, {"odom", "scan"}),
}
"""Topics that programs hear and publish before remappings; all but the gate's from the sources of Nav2 1.3.13."""


@pytest.mark.parametrize("drives", ["navigate", "use_simulator"])
def test_commands_reach_the_robot_through_the_gate_alone(launch, drives):
    heard, published = {}, {}
    for node in launch(drives):
        program = node.options["executable"]
        rename = {
            old: getattr(new, "arguments", [new])[0]  # an argument's name
            for old, new in node.options.get("remappings", [])
        }
        for table, topics in zip((heard, published), CHAIN.get(program, ((), ())), strict=True):
            for topic in topics:
                table.setdefault(rename.get(topic, topic), set()).add(program)
    assert published["cmd_vel"] == {"gate_node"}
    assert heard.get("cmd_vel") == ({"loopback_simulator"} if drives == "use_simulator" else None)
    assert published["cmd_vel_smoothed"] == {"velocity_smoother"}
    assert heard["gate_input"] == {"gate_node"}
    assert published["cmd_vel_nav"] == {"controller_server", "behavior_server"}
    assert heard["cmd_vel_nav"] == {"velocity_smoother"}


def list_values(node, path=()):
    """Return the values of a composed file of YAML and their lines, by the names that lead to them."""
    if not isinstance(node, yaml.MappingNode):
        return {path: (yaml.safe_load(yaml.serialize(node)), node.start_mark.line)}
    found = {}
    for key, value in node.value:
        found |= list_values(value, (*path, key.value))
    return found


def test_each_difference_of_the_params_file_from_nav2_bringup_is_said():
    text = (CPP / "params/navigation.yaml").read_text()
    lines, values = text.splitlines(), list_values(yaml.compose(text))
    facts = (ANSWERS / "bringup.yaml").read_text()
    for path, (theirs, _) in list_values(yaml.compose(facts)).items():
        value, line = values[path]
        assert value == theirs or "# " in lines[line], path


def test_each_costmap_forgets_what_has_gone_and_marks_what_is_above_the_floor():
    for name in ("global_costmap", "local_costmap"):
        layer = PARAMS[name][name]["ros__parameters"]["obstacle_layer"]
        assert all(layer[source]["clearing"] for source in layer["observation_sources"].split())
        # Nav2's default is 0 m, in the costmap's frame.
        assert layer["scan"]["max_obstacle_height"] >= 0.5


def test_the_params_file_asks_for_no_more_than_the_gate_allows():
    gate, smoother, controller = (
        PARAMS[name]["ros__parameters"]
        for name in ("cspace_gate", "velocity_smoother", "controller_server")
    )
    for name, limit in (("max_velocity", "max_velocity"), ("max_deceleration", "max_decel")):
        forward, sideways, turn = smoother[limit]
        assert abs(forward) <= gate[name][0] and sideways == 0.0 and abs(turn) <= gate[name][1]
    follow = controller["FollowPath"]
    assert follow["desired_linear_vel"] <= smoother["max_velocity"][0]
    assert follow["rotate_to_heading_angular_vel"] <= smoother["max_velocity"][2]


NODES = {
    "AreErrorCodesPresent": {"error_code", "error_codes_to_check"},
    "BackUp": {"backup_dist", "backup_speed"},
    "ClearEntireCostmap": {"service_name"},
    "ComputePathToPose": {"goal", "path", "planner_id", "error_code_id"},
    "FollowPath": {"path", "controller_id", "error_code_id"},
    "GlobalUpdatedGoal": set(),
    "GoalUpdated": set(),
    "IsPathValid": {"path"},
    "PathExpiringTimer": {"seconds", "path"},
    "PipelineSequence": set(),
    "RateController": {"hz"},
    "RecoveryNode": {"number_of_retries"},
    "RoundRobin": set(),
    "Script": {"code"},
    "Wait": {"wait_duration"},
    **dict.fromkeys(
        ("Fallback", "Inverter", "ReactiveFallback", "ReactiveSequence", "Sequence"), frozenset()
    ),
}
"""Ports of nodes, from nav2_behavior_tree/nav2_tree_nodes.xml of Nav2 1.3.13; the last ones are of BehaviorTree.CPP."""

SINGLE = {"Inverter": 1, "RateController": 1, "RecoveryNode": 2}
"""Numbers of children that nodes must have."""


def test_the_trees_have_nodes_and_ports_of_nav2():
    for file in sorted((CPP / "behavior_trees").glob("*.xml")):
        root = ElementTree.parse(file).getroot()
        (tree,) = root
        assert root.attrib == {"BTCPP_format": "4", "main_tree_to_execute": tree.get("ID")}
        for node in list(tree.iter())[1:]:
            assert set(node.attrib) - {"name"} <= NODES[node.tag], node.tag
            assert len(node) == SINGLE.get(node.tag, len(node))


def test_the_tree_plans_if_the_path_is_not_valid_or_old_and_waits_for_the_map():
    root = ElementTree.parse(CPP / "behavior_trees/replan_if_invalid.xml").getroot()
    keep, plan = root.find(".//Fallback")
    assert [each.tag for each in keep.iter() if len(each) == 0] == [
        "GlobalUpdatedGoal",
        "IsPathValid",
        "PathExpiringTimer",
    ]
    assert (plan.tag, plan.get("planner_id")) == ("ComputePathToPose", "GridBased")
    waiting = root.find(".//RecoveryNode[@name='WaitForMap']")[1]
    recovering = root.find(".//Sequence[@name='Recoveries']/Inverter")
    for present in (waiting[0], recovering[0]):
        assert present.get("error_code") == plan.get("error_code_id")
        assert present.get("error_codes_to_check") == "200"
    clear, *others = root.find(".//RoundRobin")
    assert {each.tag for each in clear} == {"ClearEntireCostmap"}
    assert [each.tag for each in others] == ["Wait", "BackUp"]
    recover = root.find(".//RecoveryNode[@name='Recover']")
    rounds = int(recover.get("number_of_retries")) // 3
    # 1.5 m from a corner, paths begin ahead.
    assert rounds * float(others[1].get("backup_dist")) >= 1.5
    follow = root.find(".//FollowPath").get("error_code_id")
    assert root.find(".//Script").get("code") == f"{follow[1:-1]} := 0"
