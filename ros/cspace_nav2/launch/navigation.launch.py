"""Start a map server, Nav2's planner server with the planner of cspace, and if asked the gate and the planner node."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
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


def generate_launch_description():
    """Return what `ros2 launch` starts."""
    argument = {name: LaunchConfiguration(name) for name, _, _ in ARGUMENTS}
    common = [argument["params_file"], {"use_sim_time": argument["use_sim_time"]}]
    has_gate = IfCondition(argument["gate"])

    def start(package, executable, name, own=None, **options):
        options = {"output": "screen", **options}
        own = [own] if own else []
        return Node(
            package=package, executable=executable, name=name, parameters=[*common, *own], **options
        )

    def manage(name, nodes, **options):
        own = {"autostart": True, "node_names": nodes, "bond_timeout": options.pop("bond", 4.0)}
        return start("nav2_lifecycle_manager", "lifecycle_manager", name, own, **options)

    server = {"yaml_filename": argument["map"]}
    planner = {"GridBased.builder": argument["builder"]}
    gate = {"builder": argument["builder"]}
    costmap = [("map", "/global_costmap/costmap")]
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=about)
                for name, value, about in ARGUMENTS
            ),
            start("nav2_map_server", "map_server", "map_server", server),
            # Without a name, which would also name the costmap's node in this process.
            start("nav2_planner", "planner_server", None, planner),
            manage("lifecycle_manager_navigation", ["map_server", "planner_server"]),
            start("cspace_nav2", "gate_node", "cspace_gate", gate, condition=has_gate),
            # The gate has no bond with its manager.
            manage("lifecycle_manager_gate", ["cspace_gate"], bond=0.0, condition=has_gate),
            start(
                "cspace_nav2_py",
                "planner_node",
                "cspace_planner",
                remappings=costmap,
                condition=IfCondition(argument["node"]),
            ),
        ]
    )
