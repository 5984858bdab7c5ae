"""
Why is there no path?
=====================

A barricaded door, and a warehouse whose aisles are full of crates: what is in the way, by how much
the robot is too large, and which obstacles must leave.
"""

import numpy as np
import shapely

import cspace


def barricade_door() -> cspace.CSpace:
    """Build two rooms whose door is narrower than it looks, with a crate behind it."""
    walls = [shapely.box(3.9, 0, 4.1, 2.6), shapely.box(3.9, 3.4, 4.1, 6)]
    workspace = cspace.Workspace.from_polygons(walls, 0.05, (0, 0, 8, 6))
    space = cspace.build(workspace, cspace.Robot.rectangle(0.8, 0.5), rotations=36)
    space.add_obstacle("crate", shapely.box(4.3, 2.5, 4.9, 3.5))
    return space


def fill_warehouse() -> cspace.CSpace:
    """Build a warehouse of five shelves, with crates in its aisles."""
    shelves = [shapely.box(x, 1.5, x + 1.0, 8.5) for x in np.arange(2.0, 16.0, 3.0)]
    workspace = cspace.Workspace.from_polygons(shelves, 0.1, (0, 0, 18, 10))
    space = cspace.build(workspace, cspace.Robot.disc(0.4))
    for number, x in enumerate(np.arange(2.0, 16.0, 3.0)):
        space.add_obstacle(f"crate {2 * number}", shapely.box(x, 0.3, x + 0.8, 1.2))
        space.add_obstacle(f"crate {2 * number + 1}", shapely.box(x, 8.8, x + 0.8, 9.7))
    return space


def main() -> None:
    """Explain both scenes, and draw the first one."""
    door = barricade_door()
    explanation = door.explain((1.5, 3.0, 0.0), (6.5, 3.0, 0.0))
    print(explanation)
    print("Remove:", door.removals((1.5, 3.0, 0.0), (6.5, 3.0, 0.0)))
    explanation.plot().figure.savefig("why_not.png", dpi=120, bbox_inches="tight")

    warehouse = fill_warehouse()
    start, goal = (1.0, 5.0), (17.0, 5.0)
    print(warehouse.explain(start, goal))
    removals = warehouse.removals(start, goal)
    print(f"Remove {len(removals)} of {len(warehouse.obstacles)} crates: {removals}")


if __name__ == "__main__":
    main()
