"""Commands that make, tell of, draw and export maps."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cspace.cli.options import (
    Json,
    MapFile,
    Overwrite,
    angle,
    check_configuration,
    check_outputs,
    check_turning,
    configuration,
    given,
)
from cspace.cli.paths import read_path
from cspace.cli.report import Clock, describe_map, describe_robot, describe_workspace, progress_bar, show
from cspace.errors import InputError


class Unknown(StrEnum):
    """What unknown cells of a sensor map count as."""

    OCCUPIED = "occupied"
    FREE = "free"


class Outside(StrEnum):
    """What lies beyond the map."""

    BLOCKED = "blocked"
    FREE = "free"


class Kind(StrEnum):
    """What a file holds."""

    MAP = "map"
    WORKSPACE = "workspace"
    ROBOT = "robot"


Spacing = Annotated[
    float | None, typer.Option(metavar="METRES", help="Side of a cell, for files that do not say: images, polygons.")
]


def make(
    workspace: Annotated[
        Path,
        typer.Argument(
            metavar="WORKSPACE", readable=False, help="A ROS map (.yaml), image, MovingAI .map, .geojson or .wkt."
        ),
    ],
    robot: Annotated[str, typer.Option(metavar="SPEC", help="disc:0.3, rect:0.9x0.6 or a file with a polygon.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT", readable=False, help="The map: .zarr or .npz.")
    ],
    spacing: Spacing = None,
    rotations: Annotated[
        int | None, typer.Option(metavar="COUNT", help="For a robot that turns: how many yaw cells, e.g. 72.")
    ] = None,
    unknown: Annotated[Unknown | None, typer.Option(help="What unknown cells count as  [default: occupied].")] = None,
    outside: Annotated[Outside, typer.Option(help="What lies beyond the workspace.")] = Outside.BLOCKED,
    margin: Annotated[float, typer.Option(metavar="METRES", help="Grow the robot by this much.")] = 0.0,
    inner: Annotated[
        bool, typer.Option("--inner/--no-inner", help="Tell BLOCKED from MIXED; without, both are MIXED.")
    ] = True,
    overlap: Annotated[bool, typer.Option("--overlap", help="Keep the overlap counts in the map.")] = False,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Build the map of a robot in a workspace, and save it."""
    from cspace import build
    from cspace.io.files import SAVES
    from cspace.robot import Robot
    from cspace.rotations import check_rotations
    from cspace.workspace import Workspace

    check_rotations(rotations)
    check_outputs([output], SAVES, overwrite)
    clock = Clock()
    with clock.step("read"):
        shape = Robot.open(robot)
        obstacles = Workspace.open(workspace, **given(spacing=spacing, unknown=unknown and unknown.value))
    with clock.step("build"), progress_bar("building") as progress:
        space = build(
            obstacles,
            shape,
            rotations=rotations,
            inner=inner,
            overlap=overlap,
            outside=outside.value,
            margin=margin,
            progress=progress,
        )
    with clock.step("save"):
        space.save(output, overwrite=overwrite)
    show({"map": str(output), **describe_map(space), "seconds": clock.seconds}, as_json)


def info(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A saved map, a workspace, or a robot (file or spec).")],
    kind: Annotated[
        Kind | None, typer.Option("--as", help="What FILE holds, where its name does not tell  [default: by its name].")
    ] = None,
    spacing: Spacing = None,
    unknown: Annotated[Unknown | None, typer.Option(help="What unknown cells count as  [default: occupied].")] = None,
    as_json: Json = False,
) -> None:
    """Tell what a saved map, a workspace or a robot holds."""
    from cspace.io.files import open_map
    from cspace.robot import Robot
    from cspace.workspace import Workspace

    kind = kind or _kind(file)
    if kind is Kind.MAP:
        document = describe_map(open_map(file))
    elif kind is Kind.ROBOT:
        document = describe_robot(Robot.open(file))
    else:
        document = describe_workspace(Workspace.open(file, **given(spacing=spacing, unknown=unknown and unknown.value)))
    show({"kind": kind.value, **document}, as_json)


def picture(
    file: MapFile,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="PNG", readable=False, help="The picture: .png, .pdf or .svg.")
    ],
    path: Annotated[
        Path | None, typer.Option(metavar="FILE", readable=False, help="A path to draw: .csv or .json.")
    ] = None,
    start: Annotated[str | None, typer.Option(metavar="X,Y[,YAW]", help="A configuration to mark, metres.")] = None,
    goal: Annotated[str | None, typer.Option(metavar="X,Y[,YAW]", help="A configuration to mark, metres.")] = None,
    robot_every: Annotated[
        float | None, typer.Option(metavar="METRES", help="Path between two drawn robots  [default: chosen].")
    ] = None,
    yaw: Annotated[
        str | None, typer.Option(metavar="ANGLE", help="Show the slice at this yaw, e.g. 90deg  [default: all yaws].")
    ] = None,
    strip: Annotated[bool, typer.Option("--strip", help="Show slices at several yaws, side by side.")] = False,
    dpi: Annotated[float, typer.Option(help="Pixels per inch; a picture is about 8 inches wide.")] = 150.0,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Draw a map, and a path on it, into a picture."""
    from cspace.io.files import open_map
    from cspace.plot import SUFFIXES, save_plot, save_strip

    if strip and (yaw is not None or robot_every is not None):
        raise InputError("--strip shows several yaws and no robots; it goes without --yaw and --robot-every; drop them")
    check_outputs([output], SUFFIXES, overwrite)
    turn = None if yaw is None else angle(yaw, "--yaw")
    marks = {name: configuration(text, f"--{name}") for name, text in given(start=start, goal=goal).items()}
    clock = Clock()
    with clock.step("read"):
        points = None if path is None else read_path(path)
        space = open_map(file)
    for name, mark in marks.items():
        check_configuration(space, mark, f"--{name}")
    if turn is not None or strip:
        check_turning(space, "--strip" if strip else "--yaw")
    with clock.step("draw"):
        options = given(path=points, **marks)
        if strip:
            save_strip(space, output, overwrite, dpi=dpi, **options)
        else:
            save_plot(space, output, overwrite, dpi=dpi, robot_every=robot_every, yaw=turn, **options)
    show({"picture": str(output), "seconds": clock.seconds}, as_json)


def export(
    file: MapFile,
    output: Annotated[Path, typer.Argument(metavar="OUT", readable=False, help=".npz, .zarr, or .yaml for a ROS map.")],
    yaw: Annotated[
        str | None, typer.Option(metavar="ANGLE", help="Only the slice at this yaw, e.g. 90deg or 1.57.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write a saved map for other software."""
    from cspace.io import files

    check_outputs([output], files.EXPORTS, overwrite)
    turn = None if yaw is None else angle(yaw, "--yaw")
    clock = Clock()
    with clock.step("read"):
        space = files.open_map(file)
    if turn is not None:
        check_turning(space, "--yaw")
    with clock.step("write"):
        files.export(space, output, overwrite=overwrite, **given(yaw=turn))
    show({"output": str(output), **describe_map(space), "seconds": clock.seconds}, as_json)


def _kind(file: str) -> Kind:
    """What a file holds, by its name."""
    path = Path(file)
    if path.suffix.lower() in (".zarr", ".npz") or path.is_dir():
        return Kind.MAP
    return Kind.ROBOT if ":" in file and not path.exists() else Kind.WORKSPACE
