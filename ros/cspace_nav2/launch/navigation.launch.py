"""Start Nav2's servers of maps and plans with the planner of cspace; if asked what drives, the gate, a node, a simulator."""

from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

SHARE = FindPackageShare("cspace_nav2")
PARAMETERS = PathJoinSubstitution([SHARE, "params", "navigation.yaml"])
TREE = PathJoinSubstitution([SHARE, "behavior_trees", "replan_if_invalid.xml"])
ARGUMENTS = [
    ("map", "", "The yaml file of the map."),
    ("params_file", PARAMETERS, "Parameters of all nodes."),
    ("builder", "cspace", "The command that builds maps, in the environment of the library."),
    (
        "navigate",
        "false",
        "true starts what drives a robot: controller to smoother, then the gate.",
    ),
    ("gate", "false", "true starts the gate, between gate_input and cmd_vel."),
    ("gate_input", "cmd_vel_smoothed", "Commands of whatever is last before the gate."),
    ("node", "false", "true starts the planner node in Python, on the costmap."),
    ("use_simulator", "false", "true starts Nav2's loopback simulator, and what drives it."),
    ("use_sim_time", "false", "true for a simulator's clock."),
]


def read_robot(file):
    """Return the costmap's robot in a file of parameters, as the gate and the node have it."""
    nodes = yaml.safe_load(Path(file).read_text(encoding="utf-8"))
    costmap = nodes["global_costmap"]["global_costmap"]["ros__parameters"]
    # With the defaults of Nav2.
    footprint, radius = costmap.get("footprint", "[]"), costmap.get("robot_radius", 0.1)
    robot = f"disc:{radius}" if footprint == "[]" else f"footprint:{footprint}"
    padding = costmap.get("footprint_padding", 0.01)
    # Else the footprint would be read as a list.
    gate = {"robot": ParameterValue(robot, value_type=str)}
    node = {"footprint": ParameterValue(footprint, value_type=str)}
    return gate, {**node, "robot_radius": radius, "footprint_padding": padding}


def generate_launch_description():
    """Return what `ros2 launch` starts."""
    arguments = [
        DeclareLaunchArgument(name, default_value=value, description=about)
        for name, value, about in ARGUMENTS
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=start_nodes)])


def start_nodes(context):
    """Return the nodes, once the arguments are known."""
    argument = {name: LaunchConfiguration(name) for name, _, _ in ARGUMENTS}
    common = [argument["params_file"], {"use_sim_time": argument["use_sim_time"]}]

    def is_on(name):
        return IfCondition(argument[name]).evaluate(context)

    def start(package, executable, name, own=None, robot=None, **options):
        options = {"output": "screen", **options}
        # The robot comes first, so that a gate or node may have its own in the file.
        parameters = [*filter(None, [robot]), *common, *filter(None, [own])]
        return Node(
            package=package, executable=executable, name=name, parameters=parameters, **options
        )

    def manage(name, nodes, **options):
        own = {"autostart": True, "node_names": nodes, "bond_timeout": options.pop("bond", 4.0)}
        return start("nav2_lifecycle_manager", "lifecycle_manager", name, own, **options)

    gate_robot, node_robot = read_robot(argument["params_file"].perform(context))
    builder = argument["builder"]
    is_simulated = is_on("use_simulator")
    drives = is_simulated or is_on("navigate")
    nodes = [
        start("nav2_map_server", "map_server", "map_server", {"yaml_filename": argument["map"]}),
        # Without a name, which would also name the costmap's node in this process.
        start("nav2_planner", "planner_server", None, {"GridBased.builder": builder}),
        # For itself, as the simulator asks once for the map.
        manage("lifecycle_manager_map_server", ["map_server"]),
    ]
    if drives or is_on("gate"):
        hears = {"remappings": [("cmd_vel_smoothed", argument["gate_input"])]}
        own = {"builder": builder}
        nodes += [
            start("cspace_nav2", "gate_node", "cspace_gate", own, gate_robot, **hears),
            # The gate has no bond with its manager.
            manage("lifecycle_manager_gate", ["cspace_gate"], bond=0.0),
        ]
    if is_on("node"):
        hears = {"remappings": [("map", "/global_costmap/costmap")]}
        nodes.append(
            start("cspace_nav2_py", "planner_node", "cspace_planner", robot=node_robot, **hears)
        )
    if not drives:
        return [*nodes, manage("lifecycle_manager_navigation", ["planner_server"])]
    # As in nav2_bringup, with the gate as its collision_monitor.
    to_smoother = {"remappings": [("cmd_vel", "cmd_vel_nav")]}
    drivers = [
        start("nav2_controller", "controller_server", None, robot=node_robot, **to_smoother),
        start("nav2_behaviors", "behavior_server", "behavior_server", **to_smoother),
        start("nav2_velocity_smoother", "velocity_smoother", "velocity_smoother", **to_smoother),
        start(
            "nav2_bt_navigator",
            "bt_navigator",
            "bt_navigator",
            {"default_nav_to_pose_bt_xml": TREE},
        ),
    ]
    if is_simulated:
        # The gate takes no laser in the plane of the floor.
        place = ["--z", "0.2", "--frame-id", "base_link", "--child-frame-id", "base_scan"]
        drivers += [
            start("nav2_loopback_sim", "loopback_simulator", "loopback_simulator"),
            start("tf2_ros", "static_transform_publisher", "laser", arguments=place),
        ]
    # bt_navigator comes last, because its tree asks for the actions of the others.
    managed = [
        "controller_server",
        "planner_server",
        "behavior_server",
        "velocity_smoother",
        "bt_navigator",
    ]
    return [*nodes, *drivers, manage("lifecycle_manager_navigation", managed)]
