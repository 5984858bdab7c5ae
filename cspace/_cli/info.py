"""Command that describes a saved map, workspace, robot or arm."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from cspace._cli.options import (
    AS_JSON,
    DROP_MISSING,
    PACKAGE_DIRS,
    SOLID,
    SRDF,
    VISUALS,
    Solid,
    argument,
    drop_unset,
    open_robot,
    option,
    refuse_options,
)
from cspace._cli.report import ByName, show, with_unit

if TYPE_CHECKING:
    from cspace import Robot, Workspace
    from cspace.arms import Arm
    from cspace.inside import ConfigurationMap

FileKind = Literal["map", "workspace", "robot", "arm"]
"""Kind of object in a file."""

_OPTIONS_BY_KIND: Final[dict[FileKind, tuple[str, ...]]] = {
    "map": (),
    "workspace": ("spacing", "solid", "drop_missing"),
    "robot": ("spacing", "solid", "package_dirs", "visuals"),
    "arm": ("solid", "srdf", "package_dirs", "visuals"),
}
"""Options that apply to each kind of file."""


def info(
    file: str = argument("FILE", "A saved map, a workspace, a robot (file or spec), or an arm."),
    kind: FileKind | None = option(
        None, "What FILE holds, where its name does not tell  [default: by its name].", "--as"
    ),
    spacing: float | None = option("METRES", "Side of a cell, to count cells."),
    solid: Solid | None = SOLID,
    package_dirs: list[Path] | None = PACKAGE_DIRS,
    visuals: bool = VISUALS,
    srdf: Path | None = SRDF,
    drop_missing: bool = DROP_MISSING,
    as_json: bool = AS_JSON,
) -> None:
    """Show what a map, a workspace, a robot or an arm holds.

    A URDF with joints that move is an arm; --as robot shows its fixed part.
    """
    from cspace import open as open_map
    from cspace.inside import check_positive

    kind = kind or _guess_kind(file)
    for_shapes = drop_unset(solid=solid, package_dirs=package_dirs, visuals=visuals, srdf=srdf)
    options = {**for_shapes, **drop_unset(spacing=spacing, drop_missing=drop_missing)}
    refuse_options(options, _OPTIONS_BY_KIND[kind], f"{file} is read as {kind}")
    if spacing is not None:
        check_positive(spacing, "spacing")
    if kind == "map":
        document = describe_map(open_map(file))
    elif kind == "arm":
        from cspace.arms import Arm

        document = describe_arm(Arm.from_urdf(file, **for_shapes))
    elif kind == "robot":
        document = describe_robot(open_robot(file, **for_shapes), spacing)
    else:
        document = describe_workspace(Path(file), options)
    show({"kind": kind, **document}, as_json)


def _guess_kind(file: str) -> FileKind:
    """Guess the kind of object in a file from its name.

    A URDF is read, because its joints decide between an arm and a robot.
    """
    # A Path refuses texts that are too long for a name.
    if ":" in file and not os.path.exists(file):  # noqa: PTH110
        return "robot"
    path = Path(file)
    suffix = path.suffix.lower()
    if suffix in (".zarr", ".npz") or os.path.isdir(file):  # noqa: PTH112
        return "map"
    if suffix == ".urdf":
        return "arm" if _has_moving_joints(path) else "robot"
    file_name, _, _ = file.partition("#")  # file.urdf#link names a link of a URDF
    is_link = Path(file_name).suffix.lower() == ".urdf"
    return "robot" if is_link else "workspace"


def _has_moving_joints(path: Path) -> bool:
    """Return True if a URDF has moving joints."""
    from cspace.inside import read_xml

    return any(
        joint.get("type", "fixed") != "fixed" for joint in read_xml(path, "URDF").iter("joint")
    )


def describe_arm(arm: Arm) -> dict[str, Any]:
    """Describe an arm's joints, links and pairs."""
    import numpy as np

    joints = ByName()
    limits = np.stack([arm.lower, arm.upper], axis=1).tolist()
    for joint, unit, (low, high) in zip(arm.joints, arm.units, limits, strict=True):
        if math.isinf(high):
            joints[joint] = "continuous"
        else:
            joints[with_unit(joint, unit)] = [low, high]
    triangles = ByName()
    for link in arm.links:
        surfaces = [posed.shape.outer.surface for posed in link.parts]
        triangles[link.name] = sum(len(faces) for _, faces in surfaces)
    allowed = sum(triangles.keys() >= set(pair) for pair in arm.allowed_collisions)
    forbidden = math.comb(len(triangles), 2) - allowed
    document = {
        "arm": arm.name,
        "dof": arm.dof,
        "joints": joints,
        "triangles_of_links": triangles,
        "pairs_of_links": {"may_touch": allowed, "may_not_touch": forbidden},
    }
    if arm.groups:
        document["groups"] = ByName({name: list(group) for name, group in arm.groups.items()})
    if arm.named_configurations:
        named = {name: q.tolist() for name, q in arm.named_configurations.items()}
        document["named_configurations"] = ByName(named)
    return document


def describe_map(space: ConfigurationMap) -> dict[str, Any]:
    """Describe a map: its robot, grid, rotations and counts."""
    grid = space.grid
    joints = {} if set(grid.axes) <= set("xyz") else {"joints": list(grid.axes)}
    return {
        "robot": space.robot.name,
        **joints,
        with_unit("lower", grid.unit): list(grid.lower),
        with_unit("upper", grid.unit): list(grid.upper),
        with_unit("spacing", grid.unit): grid.spacing,
        "shape": list(grid.shape),
        "outside": space.outside,
        with_unit("margin", grid.unit): space.margin,
        **space.facts,
    }


def describe_robot(robot: Robot, spacing: float | None = None) -> dict[str, Any]:
    """Describe a robot; with a spacing, metres, also its size in cells.

    If its outer and inner shape differ, both are described.
    """
    import numpy as np

    # An exact shape is its own inner and outer shape.
    outer = robot.shape.outer
    inner = robot.shape.inner
    box = np.array(outer.bounds)
    described = {**describe_box(box), **outer.facts}
    if inner is not outer:
        inner_described = {**describe_box(np.array(inner.bounds)), **inner.facts}
        described = {"outer": described, "inner": inner_described}
    document: dict[str, Any] = {"robot": robot.name, **described}
    if spacing is not None:
        document["cells_across"] = count_cells(box, spacing)
    return document


def describe_box(corners: Any) -> dict[str, Any]:
    """Describe a box by corners, shape (2, d), metres."""
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
    from cspace import Workspace
    from cspace.inside import measure_shapes

    measured = measure_shapes(path, **options)
    if measured is None:
        return {"workspace": str(path), **_describe_cells(Workspace.open(path, **options))}
    corners, facts = measured
    spacing = options.get("spacing")
    document = {"workspace": str(path), **describe_box(corners), **facts}
    if spacing is not None:
        shape = count_cells(corners, spacing)
        document |= {"spacing_m": spacing, "shape": shape, "cells": {"total": math.prod(shape)}}
    return document


def count_cells(corners: Any, spacing: float) -> list[int]:
    """Return the cells along each axis of the grid between corners, shape (2, d)."""
    import numpy as np

    lower, upper = corners
    # As when a workspace is made, rounding adds no cell.
    counts = np.maximum(1.0, np.ceil((upper - lower) / spacing - 1e-9))
    return [int(count) for count in counts]


def _describe_cells(workspace: Workspace) -> dict[str, Any]:
    """Describe a workspace of cells; count unknown ones separately."""
    import numpy as np

    grid = workspace.grid
    occupied = workspace.outer
    counts = {}
    if workspace.unknown is not None:
        counts["unknown"] = int(np.count_nonzero(workspace.unknown))
        occupied = occupied & ~workspace.unknown
    # Each cell counts once, so the counts add up to the total.
    counts["occupied"] = int(np.count_nonzero(occupied))
    counts["free"] = grid.size - sum(counts.values())
    counts["total"] = grid.size
    return {
        **describe_box(np.array([grid.lower, grid.upper])),
        "spacing_m": grid.spacing,
        "shape": list(grid.shape),
        "cells": counts,
    }
