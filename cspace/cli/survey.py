"""What a workspace's file holds, and what a map of it would take: told before any work."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cspace.cli.describe import describe_box, describe_mesh, describe_robot
from cspace.cli.options import check_dimensions
from cspace.cli.words import in_options
from cspace.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cspace.robot import Robot
    from cspace.shapes.mesh import Solid


def survey(path: Path, options: dict[str, Any], robot: Robot | None = None) -> dict[str, Any]:
    """What there is to say about the file of a workspace; shapes are not turned into cells.

    Parameters
    ----------
    path : pathlib.Path
    options : dict
        What the user gave for its reader: see :meth:`cspace.Workspace.open`. Without a spacing, nothing is said of the
        cells of shapes.
    robot : Robot, optional
        Told of as well, in cells.

    Raises
    ------
    InputError
        If the suffix is not known, an option does not apply to it, or the robot is of another dimension.
    FileError
        If the file is missing or malformed.
    """
    from cspace.io.formats import dimension_of
    from cspace.workspace import Workspace, reader_of

    surveys: dict[Callable[..., Workspace], Callable[..., dict[str, Any]]] = {
        Workspace.from_mesh: _mesh,
        Workspace.from_points: _points,
        Workspace.from_polygons: _polygons,
    }
    reader = reader_of(path, options)
    if robot is not None:
        check_dimensions(path, dimension_of(path), robot)
    if reader in surveys:
        document = surveys[reader](path, **options)
    else:
        document = _grid(path, lambda **more: Workspace.open(path, **{**options, **more}), reader)
    if robot is not None:
        described = describe_robot(robot, document.get("spacing_m"))
        document["robot"] = {"name": described.pop("robot"), **described}
    return {"workspace": str(path), **document}


def _mesh(path: Path, spacing: float | None = None, bounds: Any = None, solid: Solid = "auto") -> dict[str, Any]:
    import numpy as np

    from cspace.covering import check_bounds
    from cspace.memory import MESH_BYTES
    from cspace.shapes.mesh import Mesh

    if bounds is not None:
        check_bounds(bounds, 3)
    mesh = Mesh.of(path, solid)
    corners = np.stack(mesh.bounds)
    return {
        **describe_box(corners),
        **describe_mesh(mesh),
        **_cells(corners, spacing, bounds, MESH_BYTES, "mesh"),
    }


def _points(path: Path, spacing: float | None = None, bounds: Any = None, radius: float = 0.0) -> dict[str, Any]:
    import numpy as np

    from cspace.io.points import read_points
    from cspace.memory import WORKSPACE_BYTES
    from cspace.shapes import Balls, check_balls

    balls = Balls(*check_balls(read_points(path), radius))
    corners = np.stack(balls.bounds)
    return {
        **describe_box(corners),
        "points": len(balls.radii),
        "radius_m": float(radius),
        **_cells(corners, spacing, bounds, WORKSPACE_BYTES, "cloud"),
    }


def _polygons(path: Path, spacing: float | None = None, bounds: Any = None) -> dict[str, Any]:
    import shapely

    from cspace.io.vector import read_shapes
    from cspace.memory import WORKSPACE_BYTES

    shapes = read_shapes(path)
    corners = shapely.total_bounds(shapes).reshape(2, 2)
    return {
        **describe_box(corners),
        "shapes": len(shapes),
        **_cells(corners, spacing, bounds, WORKSPACE_BYTES, "set of polygons"),
    }


def _grid(path: Path, read: Callable[..., Any], reader: Callable[..., Any]) -> dict[str, Any]:
    """A file that is itself a grid; of a sensor map, what is unknown is what the two ways to take it differ in."""
    import numpy as np

    from cspace.memory import FIXED_CELLS, WORKSPACE_BYTES

    found: dict[str, int] = {}
    if "unknown" in inspect.signature(reader).parameters:
        taken = int(np.count_nonzero(read(unknown="occupied").outer))
        workspace = read(unknown="free")
        occupied = int(np.count_nonzero(workspace.outer))
        found["unknown"] = taken - occupied
    else:
        workspace = read()
        taken = occupied = int(np.count_nonzero(workspace.outer))
    grid = workspace.grid
    return {
        **describe_box(np.array([grid.lower, grid.upper])),
        "spacing_m": grid.spacing,
        "shape": list(grid.shape),
        "cells": {"occupied": occupied, **found, "free": grid.size - taken, "total": grid.size},
        "memory": _memory(grid.shape, grid.spacing, WORKSPACE_BYTES, mend=FIXED_CELLS),
    }


def _cells(
    corners: NDArray[np.float64], spacing: float | None, bounds: Any, bytes_a_cell: int, what: str
) -> dict[str, Any]:
    """The grid that shapes would be put on, and its memory."""
    from cspace.covering import check_bounds, covering_shape, warn_of_units
    from cspace.grid import Grid
    from cspace.memory import cells_of

    box = corners if bounds is None else check_bounds(bounds, corners.shape[1])
    if spacing is None:
        return {}
    warn_of_units(corners, spacing, what, bounds is not None)
    shape = covering_shape(box, spacing)
    told = _memory(shape, spacing, bytes_a_cell, corners=box)
    if told["fits"]:
        Grid(box[0], spacing, shape)  # raises where the map lies too far from its origin
    return {
        **({} if bounds is None else {"map_lower_m": box[0].tolist(), "map_upper_m": box[1].tolist()}),
        "spacing_m": spacing,
        "shape": shape,
        "cells": {"total": cells_of(shape)},
        "memory": told,
    }


def _memory(shape: Any, spacing: float, bytes_a_cell: int, **advice: Any) -> dict[str, Any]:
    """What a map of so many cells needs at most, and whether it is there; ``advice`` as for ``check_memory``."""
    from cspace.memory import TRANSFORM_BYTES, WORKSPACE_BYTES, cells_of, check_memory, free_bytes, map_bytes

    cells = cells_of(shape)
    built = WORKSPACE_BYTES * cells + map_bytes(shape)
    free = free_bytes()
    told: dict[str, Any] = {
        "needed_bytes": max(bytes_a_cell * cells, built),
        **({} if free is None else {"free_bytes": free}),
        "fits": True,
    }
    try:
        check_memory(bytes_a_cell * cells, "the map", shape, spacing, **advice)
        check_memory(built, "the map", shape, spacing, fixed=TRANSFORM_BYTES, **advice)
    except InputError as error:
        told |= {"fits": False, "problem": in_options(str(error))}
    return told
