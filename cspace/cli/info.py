"""Command that describes a saved map, workspace, robot or arm.

It also estimates the memory of a map before it is built.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from cspace.cli.options import (
    Inputs,
    Json,
    Srdf,
    check_dimensions,
    drop_none,
    open_robot,
    parse_rotation_cells,
    read_arm,
    refuse_options,
    spread_inputs,
)
from cspace.cli.report import ByName, Options, format_error, option_names, show, with_unit
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace.arms import Arm
    from cspace.configuration_map import ConfigurationMap
    from cspace.grid import Grid
    from cspace.limits import PlannedGrid
    from cspace.robot import Robot
    from cspace.rotations import Rotations
    from cspace.shapes.mesh import Solid

FileKind = Literal["map", "workspace", "robot", "arm"]
"""Kind of object in a file."""

_KIND_NAMES: Final = {
    "map": "a saved map",
    "workspace": "a workspace",
    "robot": "a robot",
    "arm": "an arm",
}
"""Text for each kind."""

_OPTIONS_BY_KIND: Final[dict[FileKind, tuple[str, ...]]] = {
    "map": (),
    "workspace": ("spacing", "unknown", "bounds", "solid", "radius", "robot", "rotations"),
    "robot": ("spacing", "solid", "package_dirs"),
    "arm": ("solid", "srdf", "package_dirs"),
}
"""Options of each kind; a workspace with a robot also takes the robot's options."""


@spread_inputs
def info(
    context: typer.Context,
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE", help="A saved map, a workspace, a robot (file or spec), or an arm."
        ),
    ],
    inputs: Inputs,
    kind: Annotated[
        FileKind | None,
        typer.Option(
            "--as", help="What FILE holds, where its name does not tell  [default: by its name]."
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="SPEC", help="A robot to describe beside a workspace, as for cspace map."
        ),
    ] = None,
    srdf: Srdf = None,
    as_json: Json = False,
) -> None:
    """Show what a map, a workspace, a robot or an arm holds.

    Of a workspace also what a map of it would need, before any work. A URDF with joints that move
    is an arm; --as robot shows its fixed part.
    """
    from cspace.opening import open_map

    kind = kind or _guess_kind(file)
    options, solid, package_dirs = inputs.workspace_options(), inputs.solid, inputs.package_dirs
    others = drop_none(
        robot=robot,
        rotations=inputs.rotations,
        robot_solid=inputs.robot_solid,
        srdf=srdf,
        package_dirs=package_dirs or None,
    )
    taken = (
        _OPTIONS_BY_KIND[kind]
        if robot is None
        else (*_OPTIONS_BY_KIND[kind], "robot_solid", "package_dirs")
    )
    refuse_options({**options, **others}, taken, f"{file} is {_KIND_NAMES[kind]}")
    if kind == "map":
        document = describe_map(open_map(file))
    elif kind == "arm":
        document = describe_arm(read_arm(Path(file), srdf, solid, package_dirs))
    elif kind == "robot":
        document = describe_robot(open_robot(file, solid, package_dirs), inputs.spacing)
    else:
        other = None if robot is None else inputs.read_robot(robot)
        document = describe_workspace(
            Path(file), options, option_names(context.command), other, inputs.rotations
        )
    show({"kind": kind, **document}, as_json)


def _guess_kind(file: str) -> FileKind:
    """Guess the kind of object in a file by its name.

    Read a URDF to tell arms from robots.
    """
    path = Path(file)
    if path.suffix.lower() in (".zarr", ".npz") or path.is_dir():
        return "map"
    if path.suffix.lower() == ".urdf" and _has_moving_joints(path):
        return "arm"
    described = Path(file.partition("#")[0]).suffix.lower() == ".urdf"
    return "robot" if described or (":" in file and not path.exists()) else "workspace"


def _has_moving_joints(path: Path) -> bool:
    """Return True if a URDF has a joint that moves."""
    from cspace.files.urdf import load_urdf

    return any(joint.type != "fixed" for joint in load_urdf(path).robot.joints)


def describe_arm(arm: Arm) -> dict[str, Any]:
    """Describe an arm: its joints, links and pairs of links."""
    joints = ByName()
    for joint, unit, low, high in zip(
        arm.joints, arm.units, arm.lower.tolist(), arm.upper.tolist(), strict=True
    ):
        if math.isinf(high):
            joints[joint] = "continuous"
        else:
            joints[with_unit(joint, unit)] = [low, high]
    triangles = {
        link.name: sum(len(part.shape.outer.surface[1]) for part in link.parts)
        for link in arm.links
    }
    pairs = list(combinations(sorted(triangles), 2))
    allowed = sum(pair in arm.allowed_collisions for pair in pairs)
    named = ByName({name: q.tolist() for name, q in arm.named_configurations.items()})
    return {
        "arm": arm.name,
        "dof": arm.dof,
        "joints": joints,
        "triangles_of_links": ByName(triangles),
        "pairs_of_links": {"may_touch": allowed, "may_not_touch": len(pairs) - allowed},
        **(
            {"groups": ByName({name: list(members) for name, members in arm.groups.items()})}
            if arm.groups
            else {}
        ),
        **({"named_configurations": named} if named else {}),
    }


def describe_map(space: ConfigurationMap) -> dict[str, Any]:
    """Describe a map: its robot, grid, rotations and cheap counts."""
    grid = space.grid

    def corner(name: str, numbers: Sequence[float]) -> dict[str, Any]:
        """Return a corner as a list, or by axis if units differ."""
        if len(set(grid.units)) == 1:
            return {with_unit(name, grid.unit): list(numbers)}
        names = [with_unit(axis, unit) for axis, unit in zip(grid.axes, grid.units, strict=True)]
        return {name: dict(zip(names, numbers, strict=True))}

    return {
        "robot": space.robot.name,
        **({} if set(grid.axes) <= set("xyz") else {"joints": list(grid.axes)}),
        **corner("lower", grid.lower),
        **corner("upper", grid.upper),
        with_unit("spacing", grid.unit): grid.spacing,
        "shape": list(grid.shape),
        "outside": space.outside,
        "margin_m": space.margin,
        **space.rotations.facts,
        **space._facts,
    }


def describe_robot(robot: Robot, spacing: float | None = None) -> dict[str, Any]:
    """Describe a robot; with a spacing, metres, also its size in cells.

    If its outer and inner shapes differ, both are described.
    """
    import numpy as np

    from cspace.workspace import covering_shape

    shapes = {"outer": robot.shape.outer, "inner": robot.shape.inner}
    corners = np.array(shapes["outer"].bounds)
    facts = {
        name: {**describe_box(np.array(shape.bounds)), **shape._facts}
        for name, shape in shapes.items()
    }
    return {
        "robot": robot.name,
        **(facts["outer"] if shapes["inner"] is shapes["outer"] else facts),
        **({} if spacing is None else {"cells_across": covering_shape(corners, spacing)}),
    }


def describe_box(corners: Any) -> dict[str, Any]:
    """Describe a box by its corners, shape (2, d), metres."""
    lower, upper = corners
    return {
        "lower_m": lower.tolist(),
        "upper_m": upper.tolist(),
        "extents_m": (upper - lower).tolist(),
    }


def describe_workspace(
    path: Path,
    options: dict[str, Any],
    names: Options,
    robot: Robot | None = None,
    rotations: str | None = None,
) -> dict[str, Any]:
    """Describe a workspace file and estimate a map of it.

    Shapes are not rasterized. Without a spacing, the cells of shapes are not described.

    Parameters
    ----------
    path : Path
    options : dict
        Options of its reader, see :meth:`cspace.Workspace.open`.
    names : mapping of str to str
        Names of these options on the command line.
    robot : Robot, optional
        A robot to describe too.
    rotations : str, optional
        Rotation cells of the map, as given to ``--rotations``.

    Raises
    ------
    InputError
        If the suffix is unknown, an option does not apply, or the robot has another dimension.
    FileError
        If the file is missing or malformed.
    """
    from cspace.files.formats import read_dimension
    from cspace.workspace import Workspace, reader_of

    reader = reader_of(path, options)
    rotation_cells = parse_rotation_cells(rotations)
    check_dimensions(path, read_dimension(path), robot, rotation_cells)
    estimate = _MapEstimate(names, robot, rotation_cells)
    if reader.__name__ in _SHAPE_READERS:
        document = _describe_shapes(estimate, path, reader.__name__, **options)
    else:
        document = _describe_grid(
            estimate, lambda **more: Workspace.open(path, **{**options, **more}), reader
        )
    if robot is not None:
        described = describe_robot(robot, document.get("spacing_m"))
        document["robot"] = {"name": described.pop("robot"), **described}
    return {"workspace": str(path), **document}


def _describe_shapes(
    estimate: _MapEstimate,
    path: Path,
    kind: str,
    *,
    spacing: float | None = None,
    bounds: Any = None,
    **options: Any,
) -> dict[str, Any]:
    """Describe a file of shapes and the grid of a map of it."""
    from cspace.check import check_bounds
    from cspace.limits import MESH_CELL_BYTES, WORKSPACE_CELL_BYTES

    if bounds is not None:
        check_bounds(bounds, 2 if kind == "from_polygons" else 3)
    noun, read = _SHAPE_READERS[kind]
    corners, properties = read(path, **options)
    bytes_per_cell = MESH_CELL_BYTES if noun == "mesh" else WORKSPACE_CELL_BYTES
    grid = estimate.describe_grid(corners, spacing, bounds, bytes_per_cell, noun)
    return {**describe_box(corners), **properties, **grid}


def _read_mesh(path: Path, solid: Solid = "auto") -> tuple[Any, dict[str, Any]]:
    from cspace.shapes import Mesh

    mesh = Mesh.of(path, solid)
    return mesh.bounds, mesh._facts


def _read_points(path: Path, radius: float = 0.0) -> tuple[Any, dict[str, Any]]:
    from cspace.files.points import read_points
    from cspace.shapes import Balls

    balls = Balls.of(read_points(path), radius)
    return balls.bounds, {"points": len(balls.radii), "radius_m": float(radius)}


def _read_polygons(path: Path) -> tuple[Any, dict[str, Any]]:
    import shapely

    from cspace.files.vector import read_shapes

    shapes = read_shapes(path)
    points = int(shapely.get_num_coordinates(shapes).sum())
    return shapely.total_bounds(shapes).reshape(2, 2), {"shapes": len(shapes), "points": points}


_SHAPE_READERS: Final[dict[str, tuple[str, Callable[..., tuple[Any, dict[str, Any]]]]]] = {
    "from_mesh": ("mesh", _read_mesh),
    "from_points": ("cloud", _read_points),
    "from_polygons": ("set of polygons", _read_polygons),
}
"""Noun and reader of files of shapes, by the constructor of a workspace."""


def _describe_grid(
    estimate: _MapEstimate, read: Callable[..., Any], reader: Callable[..., Any]
) -> dict[str, Any]:
    """Describe a file of cells.

    In sensor maps, unknown cells are counted separately.
    """
    import numpy as np

    from cspace.limits import FIXED_CELLS_HINT, WORKSPACE_CELL_BYTES

    is_sensor_map = "unknown" in inspect.signature(reader).parameters
    workspace = read(unknown="free") if is_sensor_map else read()
    occupied, unseen = int(np.count_nonzero(workspace.outer)), workspace.unknown
    unknown = (
        {"unknown": 0 if unseen is None else int(np.count_nonzero(unseen))} if is_sensor_map else {}
    )
    grid = workspace.grid
    return {
        **describe_box(np.array([grid.lower, grid.upper])),
        "spacing_m": grid.spacing,
        "shape": list(grid.shape),
        "cells": {
            "occupied": occupied,
            **unknown,
            "free": grid.size - occupied - sum(unknown.values()),
            "total": grid.size,
        },
        **estimate.memory(grid, WORKSPACE_CELL_BYTES, hint=FIXED_CELLS_HINT),
    }


class _MapEstimate:
    """Estimate of the cells, memory and build time of a map."""

    def __init__(self, names: Options, robot: Robot | None, rotations: Rotations) -> None:
        self._names, self.slices, self._robot, self._rotations = names, 1, robot, rotations
        self._facts: dict[str, Any] = {}
        if rotations.facts:
            # A symmetric robot needs fewer slices than rotation cells.
            self.slices = (
                len(rotations)
                if robot is None
                else int(rotations.assign_slices(robot.shape).max()) + 1
            )
            self._facts = {"rotations": len(rotations), "slices": self.slices}

    def describe_grid(
        self, corners: Any, spacing: float | None, bounds: Any, bytes_per_cell: int, what: str
    ) -> dict[str, Any]:
        """Describe the grid of shapes and estimate its memory.

        Return {} without a spacing.
        """
        import numpy as np

        from cspace.check import check_bounds
        from cspace.grid import Grid
        from cspace.limits import PlannedGrid, count_cells
        from cspace.workspace import covering_shape, warn_of_units

        corners = np.stack(corners)
        box = corners if bounds is None else check_bounds(bounds, corners.shape[1])
        if spacing is None:
            return {}
        warn_of_units(corners, spacing, what, bounds is not None)
        shape = covering_shape(box, spacing)
        memory = self.memory(PlannedGrid(shape, spacing), bytes_per_cell)
        if memory["memory"]["fits"]:
            Grid(box[0], spacing, shape)  # raises InputError if the map is too far from the origin
        return {
            **(
                {}
                if bounds is None
                else {"map_lower_m": box[0].tolist(), "map_upper_m": box[1].tolist()}
            ),
            "spacing_m": spacing,
            "shape": shape,
            "cells": {"total": count_cells(shape)},
            **memory,
        }

    def memory(
        self, grid: Grid | PlannedGrid, bytes_per_cell: int, hint: str = ""
    ) -> dict[str, Any]:
        """Estimate the memory and build time of a map.

        ``hint`` is that of ``check_memory``.
        """
        from cspace.engines.slices import raster_bytes
        from cspace.limits import (
            WORKSPACE_CELL_BYTES,
            build_seconds,
            check_memory,
            count_cells,
            free_bytes,
            map_bytes,
        )

        shape = grid.shape
        cells = count_cells(shape)
        read, workspace, rasters = bytes_per_cell * cells, WORKSPACE_CELL_BYTES * cells, 0.0
        if self._robot is not None:
            rasters = raster_bytes(self._robot, grid.spacing, 0.0, self._rotations, self.slices)
        states = map_bytes(shape, self.slices) + rasters
        needed = int(max(read, workspace + states))
        memory: dict[str, Any] = {
            "map_bytes": cells * self.slices,
            "needed_bytes": needed,
            "free_bytes": free_bytes(),
            "fits": True,
        }
        seconds = build_seconds(shape, self.slices)

        try:
            check_memory(needed, "the map", grid, hint=hint, slices=self.slices)
        except InputError as error:
            memory |= {"fits": False, "problem": format_error(error, self._names)}
        return {**self._facts, "memory": memory, "build_cpu_s": float(f"{seconds:.1g}")}
