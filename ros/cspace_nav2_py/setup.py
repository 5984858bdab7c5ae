"""How colcon installs the planner node."""

from setuptools import setup

NAME = "cspace_nav2_py"

setup(
    name=NAME,
    version="1.0.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml", "params.yaml"]),
    ],
    entry_points={"console_scripts": [f"planner_node = {NAME}.planner_node:main"]},
)
