"""Start a map server, Nav2's planner server with the planner of cspace, and if asked the gate and the planner node."""

from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PARAMETERS = PathJoinSubstitution([FindPackageShare("cspace_nav2"), "params", "navigation.yaml"])
ARGUMENTS = [
    ("map", "", "The yaml file of the map."),
    ("params_file", PARAMETERS, "Parameters of all nodes."),
    ("builder", "cspace", "The command that builds maps, in the environment of the library."),
    ("gate", "false", "true starts the gate, between cmd_vel_smoothed and cmd_vel."),
    ("node", "false", "true starts the planner node in Python, on the costmap."),
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
    has_gate = IfCondition(argument["gate"])

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
    return [
        start("nav2_map_server", "map_server", "map_server", {"yaml_filename": argument["map"]}),
        # Without a name, which would also name the costmap's node in this process.
        start("nav2_planner", "planner_server", None, {"GridBased.builder": builder}),
        manage("lifecycle_manager_navigation", ["map_server", "planner_server"]),
        start(
            "cspace_nav2",
            "gate_node",
            "cspace_gate",
            {"builder": builder},
            gate_robot,
            condition=has_gate,
        ),
        # The gate has no bond with its manager.
        manage("lifecycle_manager_gate", ["cspace_gate"], bond=0.0, condition=has_gate),
        start(
            "cspace_nav2_py",
            "planner_node",
            "cspace_planner",
            robot=node_robot,
            remappings=[("map", "/global_costmap/costmap")],
            condition=IfCondition(argument["node"]),
        ),
    ]
