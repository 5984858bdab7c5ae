"""A small floor plan for demonstrations and tests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

    from shapely.geometry.base import BaseGeometry

    from cspace import Robot, Workspace

START_POSITION: Final = (1.4, 8.6)
"""A position in the room at the upper left, metres."""

GOAL_POSITION: Final = (14.6, 1.2)
"""A position in the room at the lower right, metres."""

STORE_POSITION: Final = (13.5, 8.4)
"""A position in the store room, whose door is narrower than the robot, metres."""

SPACING_METRES: Final = 0.02
"""Default side of a cell, metres."""


def demo_robot() -> Robot:
    """Return a rectangular robot of 0.7 m by 0.5 m."""
    from cspace import Robot

    return Robot.rectangle(0.7, 0.5)


def demo_workspace(spacing: float = SPACING_METRES) -> Workspace:
    """Return the floor plan, 16 m by 10 m, as a workspace.

    Raises InputError unless the spacing, metres, is positive.
    """
    from cspace import Workspace

    return Workspace.from_polygons(floor_plan(), spacing)


def floor_plan() -> list[BaseGeometry]:
    """Return walls and furniture of a flat as shapely geometries, metres."""
    from shapely import LineString, Point, box

    outside = box(0.0, 0.0, 16.0, 10.0) - box(0.2, 0.2, 15.8, 9.8)
    walls = [
        # x, y, width, height; a gap between two walls is a door.
        (0.2, 5.0, 3.0, 0.15),
        (4.3, 5.0, 0.9, 0.15),
        (5.05, 0.2, 0.15, 1.4),
        (5.05, 2.8, 0.15, 7.0),
        (11.0, 0.2, 0.15, 4.4),
        (11.0, 5.7, 0.15, 4.1),
        (11.15, 6.5, 1.6, 0.15),
        (13.2, 6.5, 2.6, 0.15),
    ]
    chairs = [(7.1, 7.8), (8.5, 7.8), (7.1, 5.0), (8.5, 5.0)]
    furniture = [
        Point(8.0, 6.6).buffer(0.9),
        *(box(x, y, x + 0.4, y + 0.4) for x, y in chairs),
        LineString([(6.4, 1.2), (9.6, 3.6)]).buffer(0.08, cap_style="flat"),
        box(0.2, 0.2, 2.4, 1.8),
        Point(13.2, 3.4).buffer(0.7),
        box(14.2, 4.6, 15.8, 5.4),
    ]
    return [
        outside,
        *(box(x, y, x + width, y + height) for x, y, width, height in walls),
        *furniture,
    ]


def write_inputs(folder: Path) -> dict[str, Path]:
    """Write the floor plan, a house and an arm as files; return their paths.

    The folder must exist; existing files are replaced. ``floor_plan`` is GeoJSON, 16 m by 10 m,
    ``house`` is STL, 6 m by 4 m by 2.5 m, and ``arm`` is URDF, 1.25 m high.
    """
    import shapely
    import trimesh

    names = {"floor_plan": "flat.geojson", "house": "house.stl", "arm": "arm.urdf"}
    files = {kind: folder / name for kind, name in names.items()}
    shapes = shapely.GeometryCollection(floor_plan())
    files["floor_plan"].write_text(shapely.to_geojson(shapes), encoding="utf-8")
    boxes = [trimesh.creation.box(bounds=corners) for corners in _HOUSE_BOXES]
    trimesh.util.concatenate(boxes).export(files["house"])  # type: ignore[no-untyped-call]
    files["arm"].write_text(_ARM, encoding="utf-8")
    return files


_HOUSE_BOXES: Final = (
    # The floor; there is no roof, so that pictures show the inside.
    ((0.0, 0.0, 0.0), (6.0, 4.0, 0.15)),
    ((0.0, 0.0, 0.15), (0.25, 4.0, 2.5)),
    ((5.75, 0.0, 0.15), (6.0, 4.0, 2.5)),
    ((0.25, 0.0, 0.15), (5.75, 0.25, 2.5)),
    ((0.25, 3.75, 0.15), (5.75, 4.0, 2.5)),
    # The wall between the rooms, around its window.
    ((2.85, 0.25, 0.15), (3.15, 3.75, 1.05)),
    ((2.85, 0.25, 2.15), (3.15, 3.75, 2.5)),
    ((2.85, 0.25, 1.05), (3.15, 1.25, 2.15)),
    ((2.85, 2.75, 1.05), (3.15, 3.75, 2.15)),
    ((4.2, 0.25, 0.15), (5.75, 1.15, 0.95)),  # a table
)
"""Lower and upper corners of boxes, metres. Walls are thicker than cells of 0.1 m, so they have
interior cells."""

_ARM: Final = """<robot name="arm">
  <link name="base"/>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="column"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <link name="column">
    <collision>
      <origin xyz="0 0 0.15"/><geometry><cylinder radius="0.08" length="0.3"/></geometry>
    </collision>
  </link>
  <joint name="shoulder" type="revolute">
    <origin xyz="0 0 0.35"/><parent link="column"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <link name="upper">
    <collision>
      <origin xyz="0 0 0.25"/><geometry><box size="0.1 0.1 0.5"/></geometry>
    </collision>
  </link>
  <joint name="elbow" type="revolute">
    <origin xyz="0 0 0.5"/><parent link="upper"/><child link="fore"/>
    <axis xyz="0 1 0"/><limit lower="-2.5" upper="2.5" effort="1" velocity="1"/>
  </joint>
  <link name="fore">
    <collision>
      <origin xyz="0 0 0.2"/><geometry><box size="0.08 0.08 0.4"/></geometry>
    </collision>
  </link>
</robot>
"""
"""An arm of three joints, as URDF."""
