"""Command that describes a saved map, workspace, robot or arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from cspace.cli.options import (
    Json,
    PackageDirs,
    SolidMesh,
    Srdf,
    drop_none,
    open_robot,
    read_arm,
    refuse_options,
)
from cspace.cli.report import ByName, show, with_unit

if TYPE_CHECKING:
    from cspace.arms import Arm
    from cspace.maps import ConfigurationMap
    from cspace.robot import Robot
    from cspace.shapes.mesh import Solid
    from cspace.workspace import Workspace

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
    "workspace": ("spacing", "solid"),
    "robot": ("spacing", "solid", "package_dirs"),
    "arm": ("solid", "srdf", "package_dirs"),
}
"""Options of each kind."""


def info(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE", help="A saved map, a workspace, a robot (file or spec), or an arm."
        ),
    ],
    kind: Annotated[
        FileKind | None,
        typer.Option(
            "--as", help="What FILE holds, where its name does not tell  [default: by its name]."
        ),
    ] = None,
    spacing: Annotated[
        float | None, typer.Option(metavar="METRES", help="Side of a cell, to count cells.")
    ] = None,
    solid: SolidMesh = None,
    package_dirs: PackageDirs = None,
    srdf: Srdf = None,
    as_json: Json = False,
) -> None:
    """Show what a map, a workspace, a robot or an arm holds.

    A URDF with joints that move is an arm; --as robot shows its fixed part.
    """
    from cspace.opening import open_map
    from cspace.support.check import check_positive

    kind = kind or _guess_kind(file)
    options = drop_none(spacing=spacing, solid=solid, srdf=srdf, package_dirs=package_dirs or None)
    refuse_options(options, _OPTIONS_BY_KIND[kind], f"{file} is {_KIND_NAMES[kind]}")
    if spacing is not None:
        check_positive(spacing, "spacing")
    if kind == "map":
        document = describe_map(open_map(file))
    elif kind == "arm":
        document = describe_arm(read_arm(Path(file), srdf, solid, package_dirs))
    elif kind == "robot":
        document = describe_robot(open_robot(file, solid, package_dirs), spacing)
    else:
        document = describe_workspace(Path(file), options)
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
        name: {**describe_box(np.array(shape.bounds)), **shape.facts}
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


def describe_workspace(path: Path, options: dict[str, Any]) -> dict[str, Any]:
    """Describe a workspace file; ``options`` are those of its reader.

    Shapes are not rasterized. Raises CspaceError like :meth:`cspace.Workspace.open`.
    """
    from cspace.workspace import Workspace, covering_shape, reader_of

    kind = reader_of(path, options).__name__
    if kind not in _SHAPE_READERS:
        return {"workspace": str(path), **_describe_cells(Workspace.open(path, **options))}
    spacing = options.pop("spacing", None)
    corners, facts = _SHAPE_READERS[kind](path, **options)
    document = {"workspace": str(path), **describe_box(corners), **facts}
    if spacing is not None:
        shape = covering_shape(corners, spacing)
        document |= {"spacing_m": spacing, "shape": shape, "cells": {"total": math.prod(shape)}}
    return document


def _read_mesh(path: Path, solid: Solid = "auto") -> tuple[Any, dict[str, Any]]:
    import numpy as np

    from cspace.shapes import Mesh

    mesh = Mesh.of(path, solid)
    return np.array(mesh.bounds), mesh.facts


def _read_points(path: Path) -> tuple[Any, dict[str, Any]]:
    import numpy as np

    from cspace.files.points import read_points

    points = read_points(path)
    return np.array([points.min(axis=0), points.max(axis=0)]), {"points": len(points)}


def _read_polygons(path: Path) -> tuple[Any, dict[str, Any]]:
    import shapely

    from cspace.files.vector import read_shapes

    shapes = read_shapes(path)
    points = int(shapely.get_num_coordinates(shapes).sum())
    return shapely.total_bounds(shapes).reshape(2, 2), {"shapes": len(shapes), "points": points}


_SHAPE_READERS: Final[dict[str, Callable[..., tuple[Any, dict[str, Any]]]]] = {
    "from_mesh": _read_mesh,
    "from_points": _read_points,
    "from_polygons": _read_polygons,
}
"""Readers of files of shapes, by the constructor of a workspace."""


def _describe_cells(workspace: Workspace) -> dict[str, Any]:
    """Describe a workspace of cells.

    In sensor maps, unknown cells are counted separately.
    """
    import numpy as np

    grid = workspace.grid
    occupied, unknown = workspace.outer, workspace.unknown
    cells = {}
    if unknown is not None:
        cells["unknown"] = int(np.count_nonzero(unknown))
        occupied = occupied & ~unknown
    cells["occupied"] = int(np.count_nonzero(occupied))
    return {
        **describe_box(np.array([grid.lower, grid.upper])),
        "spacing_m": grid.spacing,
        "shape": list(grid.shape),
        "cells": {**cells, "free": grid.size - sum(cells.values()), "total": grid.size},
    }
