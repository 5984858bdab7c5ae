"""What options mean that several commands have."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cspace.cli.words import about_robot
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace.robot import Robot


class Unknown(StrEnum):
    """What unknown cells of a sensor map count as."""

    OCCUPIED = "occupied"
    FREE = "free"


class Solid(StrEnum):
    """What of a mesh has an inside."""

    AUTO = "auto"
    SURFACE = "surface"
    FILL = "fill"


Json = Annotated[bool, typer.Option("--json", help="Print one JSON document, for machines.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace existing outputs.")]
# Typer looks at files before any command runs and tells of them in its own way; the library does it better.
MapFile = Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="A saved map: .zarr or .npz.")]

Spacing = Annotated[
    float | None,
    typer.Option(metavar="METRES", help="Side of a cell, for files that do not say: images, polygons, meshes, points."),
]
UnknownCells = Annotated[
    Unknown | None,
    typer.Option("--unknown", help="What unknown cells of a ROS map or an OctoMap count as  [default: occupied]."),
]
Bounds = Annotated[
    str | None,
    typer.Option(
        metavar="LOWER,UPPER",
        help="Box to map, metres, for polygons, meshes, points: XMIN,YMIN,XMAX,YMAX, or in space "
        "XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX  [default: that of the file].",
    ),
]
SolidMesh = Annotated[
    Solid | None,
    typer.Option(
        "--solid",
        help="What has an inside in a mesh of obstacles: closed parts, nothing, or what it "
        "encloses at this spacing  [default: auto].",
    ),
]
SolidRobot = Annotated[
    Solid | None, typer.Option("--robot-solid", help="The same for a robot that is a mesh  [default: auto].")
]
Radius = Annotated[
    float | None, typer.Option("--radius", metavar="METRES", help="Of the ball around each point of a point cloud.")
]


def workspace_options(
    spacing: float | None, unknown: Unknown | None, bounds: str | None, solid: Solid | None, radius: float | None
) -> dict[str, Any]:
    """What the user gave for the reader of a workspace, checked as far as it can be without the file.

    Raises
    ------
    InputError
        If ``bounds`` is not a box, or a number is out of range.
    """
    from cspace.grid import positive

    if spacing is not None:
        positive(spacing, "spacing")
    return given(
        spacing=spacing,
        unknown=unknown and unknown.value,
        bounds=None if bounds is None else box(bounds, "--bounds"),
        solid=solid and solid.value,
        radius=radius,
    )


def read_robot(text: str, solid: Solid | None) -> Robot:
    """The robot that ``--robot`` and ``--robot-solid`` give.

    Raises
    ------
    CspaceError
        As :meth:`cspace.Robot.open`.
    """
    from cspace.robot import Robot

    with about_robot():
        return Robot.open(text, **given(solid=solid and solid.value))


def check_dimensions(path: Path, dim: int, robot: Robot) -> None:
    """Refuse a robot of the plane in a workspace of space, or the other way round.

    Raises
    ------
    InputError
        If they do not agree.
    """
    if robot.dim != dim:
        raise InputError(
            f"the workspace {path} has {dim} dimensions and the robot {robot.dim}, a {robot.name}; they must agree; "
            "take both in the plane or both in space"
        )


def box(text: str, option: str) -> tuple[float, ...]:
    """The box that an option such as ``--bounds`` gives: the lower corner, then the upper one, in metres.

    Raises
    ------
    InputError
        If the text is not four numbers, or six in space, with commas between them, or the box has no inside.
    """
    from cspace.covering import check_bounds

    try:
        values = tuple(map(float, text.split(",")))
        if len(values) not in (4, 6):
            raise ValueError
    except ValueError:
        raise InputError(
            f"{option} is {text!r}; it must be four numbers in metres with commas between them, XMIN,YMIN,XMAX,YMAX, "
            f"or six in space; write e.g. {option}=-1,-1,0,4,3,2.5"
        ) from None
    check_bounds(values, len(values) // 2)
    return values


def angle(text: str, option: str) -> float:
    """The angle that a word gives, in radians: ``90deg``, or a number of radians.

    Raises
    ------
    InputError
        If the text is neither, or more than a turn without a unit, which is taken for degrees that lack theirs.
    """
    word = text.strip()
    number, unit = next(((word.removesuffix(unit), unit) for unit in ("deg", "rad") if word.endswith(unit)), (word, ""))
    try:
        value = float(number)
    except ValueError:
        raise InputError(
            f"{option} has the yaw {text!r}; it must be a number of degrees or of radians; write e.g. 90deg or 1.57"
        ) from None
    if not unit and math.isfinite(value) and abs(value) > 2.0 * math.pi:
        raise InputError(
            f"{option} has the yaw {text!r}; a yaw without a unit is in radians, and {value:g} rad is more than a "
            f"turn; write {number}deg for degrees, or {number}rad if you mean it"
        )
    return math.radians(value) if unit == "deg" else value


def given(**options: Any) -> dict[str, Any]:
    """The options that the user gave: those that are not None."""
    return {name: value for name, value in options.items() if value is not None}
