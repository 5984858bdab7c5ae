"""What there is to say about a saved map and about a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cspace.robot import Robot
    from cspace.shapes.mesh import Mesh
    from cspace.space import CSpace

_MEASURES = {2: "area_m2", 3: "volume_m3"}
"""What the cells of a map, or a body, fill, by the number of dimensions."""


def describe_map(space: CSpace) -> dict[str, Any]:
    """What there is to say about a map."""
    import numpy as np

    from cspace.states import FREE, NAMES

    counts = space.count()
    grid, rotations = space.grid, space.rotations
    kept = [space.stack, *space.fields.values()] + ([] if space.overlaps is None else [space.overlaps])
    turning: dict[str, Any] = {}
    if rotations is None:
        measure = {f"free_{_MEASURES[grid.dim]}": counts[0] * grid.spacing**grid.dim}
    else:
        widths = np.diff(rotations.borders)
        free = np.array([np.count_nonzero(part == FREE) for part in space.stack])[space.slice_of]
        # Each rotation cell counts by its width.
        measure = {"mean_free_area_m2": float(free @ widths / widths.sum()) * grid.spacing**grid.dim}
        turning = {
            "rotations": rotations.count,
            "rotation_cell_deg": round(float(np.degrees(widths.max())), 9),
            "slices": len(space.stack),
        }
    return {
        "robot": space.robot.name,
        "workspace": space.workspace.source,
        "lower_m": list(grid.lower),
        "upper_m": list(grid.upper),
        "spacing_m": grid.spacing,
        "shape": list(grid.shape),
        **turning,
        "cells": dict(zip(NAMES, counts, strict=True)),
        **measure,
        "outside": space.outside,
        "margin_m": space.margin,
        "precision": space.precision,
        "overlaps": space.overlaps is not None,
        **({"overlap_field": True} if space.fields else {}),
        "memory_bytes": sum(array.nbytes for array in kept),
    }


def describe_robot(robot: Robot, spacing: float | None = None) -> dict[str, Any]:
    """What there is to say about a robot, and how many cells it is across where a spacing is known (metres)."""
    import numpy as np

    from cspace.covering import covering_shape
    from cspace.shapes import Mesh

    body = robot.shape
    corners = np.array(body.bounds)
    return {
        "robot": robot.name,
        **describe_box(corners),
        **(describe_mesh(body) if isinstance(body, Mesh) else {_MEASURES[robot.dim]: body.measure}),
        **({} if spacing is None else {"cells_across": covering_shape(corners, spacing)}),
    }


def describe_mesh(mesh: Mesh) -> dict[str, Any]:
    """What there is to say about a mesh; its volume, where it has one."""
    closed = sum(body.closed for body in mesh.bodies)
    return {
        "triangles": len(mesh.faces),
        "bodies": {"closed": closed, "open": len(mesh.bodies) - closed},
        "watertight": mesh.is_watertight,
        **({"volume_m3": float(mesh.volume)} if mesh.is_watertight else {}),
    }


def describe_box(corners: Any) -> dict[str, Any]:
    """A box, by its lower and upper corner, shape (2, d), metres."""
    lower, upper = corners
    return {"lower_m": lower.tolist(), "upper_m": upper.tolist(), "extents_m": (upper - lower).tolist()}
