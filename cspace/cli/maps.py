"""Commands that make, tell of, draw and export maps."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cspace.cli.describe import describe_map, describe_robot
from cspace.cli.forms import check_space, check_turning, configuration, form_of
from cspace.cli.options import (
    Bounds,
    Json,
    MapFile,
    Overwrite,
    Radius,
    SolidMesh,
    SolidRobot,
    Spacing,
    UnknownCells,
    angle,
    check_dimensions,
    given,
    read_robot,
    workspace_options,
)
from cspace.cli.outputs import check_outputs
from cspace.cli.paths import read_path
from cspace.cli.report import Clock, progress_bar, show
from cspace.cli.survey import survey
from cspace.errors import InputError


class Outside(StrEnum):
    """What lies beyond the map."""

    BLOCKED = "blocked"
    FREE = "free"


class Method(StrEnum):
    """Engines."""

    AUTO = "auto"
    FFT = "fft"
    DIRECT = "direct"


class Kind(StrEnum):
    """What a file holds."""

    MAP = "map"
    WORKSPACE = "workspace"
    ROBOT = "robot"


class View(StrEnum):
    """Which picture of a map in space."""

    SECTIONS = "sections"
    SCENE = "3d"


class Surface(StrEnum):
    """What a scene shows."""

    OBSTACLES = "obstacles"
    FREE = "free"


def make(
    workspace: Annotated[
        Path,
        typer.Argument(
            metavar="WORKSPACE",
            readable=False,
            help="In the plane: a ROS map (.yaml), image, MovingAI .map, .geojson or .wkt. In space: a mesh (.stl, "
            ".obj, .ply, .glb ...), OctoMap (.bt, .ot), MovingAI .3dmap or points (.xyz, .csv, .pcd, .ply). "
            "Either: .npy.",
        ),
    ],
    robot: Annotated[
        str,
        typer.Option(
            metavar="SPEC",
            help="In the plane: disc:0.3, rect:0.9x0.6 or a file with a polygon. In space: ball:0.3, box:0.6x0.6x0.2 "
            "or a mesh.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="OUT",
            readable=False,
            help="The map: .zarr or .npz  [default: the workspace's name with .zarr, in this folder].",
        ),
    ] = None,
    spacing: Spacing = None,
    rotations: Annotated[
        int | None,
        typer.Option(metavar="COUNT", help="For a robot that turns, in the plane: how many yaw cells, e.g. 72."),
    ] = None,
    bounds: Bounds = None,
    unknown: UnknownCells = None,
    solid: SolidMesh = None,
    robot_solid: SolidRobot = None,
    radius: Radius = None,
    outside: Annotated[Outside, typer.Option(help="What lies beyond the workspace.")] = Outside.BLOCKED,
    margin: Annotated[float, typer.Option(metavar="METRES", help="Grow the robot by this much.")] = 0.0,
    inner: Annotated[
        bool, typer.Option("--inner/--no-inner", help="Tell BLOCKED from MIXED; without, both are MIXED.")
    ] = True,
    overlap: Annotated[bool, typer.Option("--overlap", help="Keep the overlap counts in the map.")] = False,
    method: Annotated[Method, typer.Option(help="The engine; the map is the same.")] = Method.AUTO,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Build the map of a robot in a workspace, and save it."""
    from cspace import build
    from cspace.io.formats import dimension_of
    from cspace.io.writing import SAVES
    from cspace.rotations import check_rotations
    from cspace.workspace import Workspace, reader_of

    check_rotations(rotations)
    output = Path(workspace.with_suffix(".zarr").name) if output is None else output
    check_outputs([output], SAVES, overwrite)
    options = workspace_options(spacing, unknown, bounds, solid, radius)
    clock = Clock()
    with clock.step("read"):
        shape = read_robot(robot, robot_solid)
        reader_of(workspace, options)
        check_dimensions(workspace, dimension_of(workspace), shape)
        obstacles = Workspace.open(workspace, **options)
    with clock.step("build"), progress_bar("building") as progress:
        space = build(
            obstacles,
            shape,
            rotations=rotations,
            inner=inner,
            overlap=overlap,
            method=method.value,
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
    robot: Annotated[
        str | None, typer.Option(metavar="SPEC", help="A robot to tell of beside a workspace, as for cspace map.")
    ] = None,
    bounds: Bounds = None,
    unknown: UnknownCells = None,
    solid: SolidMesh = None,
    robot_solid: SolidRobot = None,
    radius: Radius = None,
    as_json: Json = False,
) -> None:
    """Tell what a saved map, a workspace or a robot holds, and what a map would take, before any work."""
    from cspace.io.reading import open_map
    from cspace.robot import Robot

    kind = kind or _kind(file)
    options = workspace_options(spacing, unknown, bounds, solid, radius)
    if robot_solid is not None and robot is None:
        raise InputError(f"--robot-solid is {robot_solid.value} and there is no --robot; add one, or leave it out")
    others = given(robot=robot)
    if kind is Kind.MAP:
        _refuse({**options, **others}, (), f"{file} is a saved map")
        document = describe_map(open_map(file))
    elif kind is Kind.ROBOT:
        _refuse({**options, **others}, ("spacing", "solid"), f"{file} is a robot")
        document = describe_robot(Robot.open(file, **given(solid=solid and solid.value)), spacing)
    else:
        beside = None if robot is None else read_robot(robot, robot_solid)
        document = survey(Path(file), options, beside)
    show({"kind": kind.value, **document}, as_json)


def _refuse(options: dict[str, object], taken: tuple[str, ...], what: str) -> None:
    """Refuse options that have no place."""
    for name in options:
        if name not in taken:
            raise InputError(f"--{name} is given and {what}; it is for workspaces; leave it out")


def picture(
    file: MapFile,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="PNG", readable=False, help="The picture: .png, .pdf or .svg.")
    ],
    path: Annotated[
        Path | None, typer.Option(metavar="FILE", readable=False, help="A path to draw: .csv or .json.")
    ] = None,
    start: Annotated[str | None, typer.Option(metavar="X,Y[,YAW|,Z]", help="A configuration to mark, metres.")] = None,
    goal: Annotated[str | None, typer.Option(metavar="X,Y[,YAW|,Z]", help="A configuration to mark, metres.")] = None,
    robot_every: Annotated[
        float | None, typer.Option(metavar="METRES", help="Path between two drawn robots  [default: chosen].")
    ] = None,
    yaw: Annotated[
        str | None, typer.Option(metavar="ANGLE", help="Show the slice at this yaw, e.g. 90deg  [default: all yaws].")
    ] = None,
    strip: Annotated[bool, typer.Option("--strip", help="Show slices at several yaws, side by side.")] = False,
    view: Annotated[
        View | None, typer.Option(help="Of a map in space: three sections, or a scene  [default: sections].")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="The point that the sections go through, metres  [default: chosen]."),
    ] = None,
    surface: Annotated[
        Surface | None,
        typer.Option(help="What the scene shows: obstacles, or the border of the free space  [default: obstacles]."),
    ] = None,
    dpi: Annotated[float, typer.Option(help="Pixels per inch; a picture is about 8 inches wide.")] = 150.0,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Draw a map, and a path on it, into a picture."""
    from cspace.io.reading import open_map
    from cspace.plot import SUFFIXES, save_plot

    if strip and (yaw is not None or robot_every is not None):
        raise InputError("--strip shows several yaws and no robots; it goes without --yaw and --robot-every; drop them")
    if at is not None and view is View.SCENE:
        raise InputError("--at is for sections, and --view is 3d; drop one of them")
    if surface is not None and view is not View.SCENE:
        raise InputError(f"--surface is {surface.value} and there is no --view 3d; sections show both; add --view 3d")
    check_outputs([output], SUFFIXES, overwrite)
    turn = None if yaw is None else angle(yaw, "--yaw")
    form = form_of(file)
    marks = {name: configuration(text, f"--{name}", form) for name, text in given(start=start, goal=goal).items()}
    if turn is not None or strip:
        check_turning(form, "--strip" if strip else "--yaw")
    if at is not None or view is not None:
        check_space(form, "--at" if view is None else "--view")
    point = None if at is None else configuration(at, "--at", form)
    clock = Clock()
    with clock.step("read"):
        points = None if path is None else read_path(path, form)
        space = open_map(file)
    with clock.step("draw"):
        options = given(path=points, **marks)
        shown = "yaw_panels" if strip else view and view.value
        options |= given(yaw=turn, view=shown, at=point, surface=surface and surface.value)
        save_plot(space, output, overwrite, dpi=dpi, robot_every=robot_every, **options)
    show({"picture": str(output), "seconds": clock.seconds}, as_json)


def export(
    file: MapFile,
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            readable=False,
            help=".npz, .zarr; .vti for ParaView; .yaml for a ROS map; in space .stl, .ply or .obj for the border of "
            "the free space.",
        ),
    ],
    yaw: Annotated[
        str | None, typer.Option(metavar="ANGLE", help="Only the slice at this yaw, e.g. 90deg or 1.57.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write a saved map for other software."""
    from cspace.io.reading import open_map
    from cspace.io.writing import EXPORTS, export

    check_outputs([output], EXPORTS, overwrite)
    turn = None if yaw is None else angle(yaw, "--yaw")
    if turn is not None:
        check_turning(form_of(file), "--yaw")
    clock = Clock()
    with clock.step("read"):
        space = open_map(file)
    with clock.step("write"):
        export(space, output, overwrite=overwrite, **given(yaw=turn))
    show({"output": str(output), **describe_map(space), "seconds": clock.seconds}, as_json)


def _kind(file: str) -> Kind:
    """What a file holds, by its name."""
    path = Path(file)
    if path.suffix.lower() in (".zarr", ".npz") or path.is_dir():
        return Kind.MAP
    return Kind.ROBOT if ":" in file and not path.exists() else Kind.WORKSPACE
