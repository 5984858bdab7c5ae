"""Commands that build, draw, export and show maps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from cspace._cli.files import (
    check_outputs,
    open_lazily,
    prepare_store,
    read_path,
    select_window,
)
from cspace._cli.info import describe_map
from cspace._cli.options import (
    AS_JSON,
    DROP_MISSING,
    MAP_FILE,
    MARK,
    OVERWRITE,
    PACKAGE_DIRS,
    PATH_FILE,
    SOLID,
    SRDF,
    VISUALS,
    Solid,
    Up,
    argument,
    drop_unset,
    open_robot,
    option,
    parse_box,
    parse_configuration,
    parse_offset,
    parse_rotation,
    parse_rotation_cells,
    read_marks,
    refuse_options,
)
from cspace._cli.report import Stopwatch, show, using_prefix

if TYPE_CHECKING:
    from cspace import CSpace, TiledCSpace
    from cspace.arms import ArmSpace


def make(
    context: typer.Context,
    workspace: Path = argument(
        "WORKSPACE",
        "In the plane: a ROS map, an image, a MovingAI map or polygons. In space: a mesh, an "
        "OctoMap, voxels or points. Either: an array. The message of an unknown suffix lists all.",
    ),
    robot: str = option(
        "SPEC",
        "A shorthand such as disc:0.3, rect:0.9x0.6 or box:0.6x0.6x0.2 (all: --robot help), or a "
        "file with a polygon, a mesh or a URDF.",
        default=...,
    ),
    spacing: float | None = option(
        "METRES",
        "Side of a cell, where the file does not say: images, polygons, meshes, points.",
    ),
    rotations: str | None = option(
        "COUNT",
        "For a robot that turns: how many cells of yaw, e.g. 72; or quaternions:8, in space, for "
        "all.",
    ),
    bounds: str | None = option(
        "LOWER,UPPER",
        "Box to map, metres, for polygons, meshes, points, OctoMaps: XMIN,YMIN,XMAX,YMAX, or in "
        "space XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX  [default: that of the file].",
    ),
    unknown: Literal["occupied", "free"] | None = option(
        None, "What unknown cells of a ROS map or an OctoMap count as  [default: occupied]."
    ),
    solid: Solid | None = SOLID,
    robot_solid: Solid | None = option(
        None, "The same for a robot that is a mesh  [default: auto]."
    ),
    up: Up | None = option(None, "Axis of a mesh of obstacles that points up and becomes z."),
    robot_up: Up | None = option(None, "The same for a robot that is a mesh."),
    visuals: bool = VISUALS,
    package_dirs: list[Path] | None = PACKAGE_DIRS,
    radius: float | None = option("METRES", "Of the ball around each point of a point cloud."),
    drop_missing: bool = DROP_MISSING,
    offset: str | None = option(
        "X,Y[,Z]",
        "Metres to add to the coordinates of polygons, meshes and points, before the bounds apply, "
        "e.g. for files in UTM.",
    ),
    output: Path | None = option(
        "OUT",
        "The map: .zarr  [default: the workspace's name with .zarr, in this folder].",
        "--output",
        "-o",
    ),
    outside: Literal["blocked", "free"] = option(
        None, "What lies beyond the workspace.", default="blocked"
    ),
    margin: float = option("METRES", "Grow the robot by this much.", default=0.0),
    floor: float | None = option(
        "METRES", "Height at which a robot in space drives through a workspace in space."
    ),
    tile: int | None = option(
        "CELLS",
        "Build tile by tile, each so many cells along an axis, for maps larger than memory; the "
        "same command goes on where it was stopped.",
    ),
    overwrite: bool = OVERWRITE,
    as_json: bool = AS_JSON,
) -> None:
    """Build the map of a robot in a workspace, and save it."""
    from cspace import Workspace, build
    from cspace.inside import MapFolder

    # Check the options and the output before the long work of reading and building.
    cells = parse_rotation_cells(rotations)
    output = Path(workspace.with_suffix(".zarr").name) if output is None else output
    if tile is None:
        check_outputs([output], MapFolder.SUFFIXES, overwrite)
    else:
        prepare_store(output, overwrite)
    box = None if bounds is None else parse_box(bounds, "bounds")
    step = None if offset is None else parse_offset(offset)
    options = drop_unset(
        spacing=spacing,
        unknown=unknown,
        bounds=box,
        solid=solid,
        up=up,
        radius=radius,
        drop_missing=drop_missing,
        offset=step,
    )
    clock = Stopwatch()
    with clock.step("read"):
        with using_prefix(context, "robot_"):
            shape = open_robot(
                robot, solid=robot_solid, up=robot_up, package_dirs=package_dirs, visuals=visuals
            )
        read = Workspace.open if tile is None else open_lazily
        obstacles = read(workspace, **options)
    settings: dict[str, Any] = {
        "rotations": cells,
        "outside": outside,
        "margin": margin,
        "floor": floor,
    }
    if tile is not None:
        settings |= {"store": output, "tile": tile}
    with clock.step("build") as progress:
        space: Any = build(obstacles, shape, progress=progress, **settings)
    if tile is None:
        with clock.step("save"):
            space.save(output, overwrite=overwrite)
    show({"map": str(output), **describe_map(space), "seconds": clock.seconds}, as_json)


def picture(
    file: Path = MAP_FILE,
    output: Path = option("PNG", "The picture: .png, .pdf or .svg.", "--output", "-o", default=...),
    path: Path | None = PATH_FILE,
    start: str | None = MARK,
    goal: str | None = MARK,
    rotation: str | None = option(
        "ROTATION",
        "Show the slice at this rotation, e.g. 90deg or 0,0,0,1  [default: all of them].",
    ),
    view: Literal["plane", "sections", "3d"] | None = option(
        None, "Of a map in space: sections or 3d  [default: sections]."
    ),
    center: str | None = option("X,Y[,Z]", "The point of sections, metres  [default: chosen]."),
    dpi: float = option(None, "Pixels per inch; a picture is about 8 inches wide.", default=150.0),
    overwrite: bool = OVERWRITE,
    as_json: bool = AS_JSON,
) -> None:
    """Draw a picture of a map, and of a path on it."""
    from cspace import open as open_map
    from cspace.plot import PICTURE_SUFFIXES, save_plot

    check_outputs([output], PICTURE_SUFFIXES, overwrite)
    clock = Stopwatch()
    with clock.step("read"):
        space = open_map(file)
        axes = space.axes
        units = space.units
        dim = space.grid.dim
        # These options depend on the axes of the map.
        options = drop_unset(view=view)
        options |= read_marks(start, goal, axes, units)
        if rotation is not None:
            options["rotation"] = parse_rotation(rotation, "rotation", space)
        if center is not None:
            options["center"] = parse_configuration(center, "center", axes[:dim], units[:dim])
        if path is not None:
            options["path"] = read_path(path, axes)
    with clock.step("draw"):
        save_plot(space, output, overwrite, dpi=dpi, **options)
    show({"picture": str(output), "seconds": clock.seconds}, as_json)


def export(
    file: Path = MAP_FILE,
    output: Path = argument(
        "OUT",
        ".zarr; .npz (NumPy); .nc (netCDF); .vti for ParaView; in the plane .yaml for a ROS map, "
        ".tif for a GeoTIFF; in space .ply for the border of the free space.",
    ),
    rotation: str | None = option(
        "ROTATION", "Only the slice at this rotation, e.g. 90deg or 0,0,0,1."
    ),
    window: str | None = option(
        "LOWER,UPPER",
        "Only this box, metres: XMIN,YMIN,XMAX,YMAX, or in space XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX; of "
        "a map in tiles, with as much around it as the robot reaches.",
    ),
    overwrite: bool = OVERWRITE,
    as_json: bool = AS_JSON,
) -> None:
    """Write a saved map for other software."""
    from cspace import open as open_map
    from cspace.export import EXPORT_FORMATS

    check_outputs([output], EXPORT_FORMATS, overwrite)
    clock = Stopwatch()
    with clock.step("read"):
        box = None if window is None else parse_box(window, "window")
        space = select_window(open_map(file), box)
        options = {}
        if rotation is not None:
            options["rotation"] = parse_rotation(rotation, "rotation", space)
    with clock.step("write"):
        space.export(output, overwrite=overwrite, **options)
    show({"output": str(output), **describe_map(space), "seconds": clock.seconds}, as_json)


def view(
    file: Path = argument("FILE", "A saved map: .zarr; or an arm: .urdf."),
    path: Path | None = PATH_FILE,
    start: str | None = MARK,
    goal: str | None = MARK,
    srdf: Path | None = SRDF,
    solid: Solid | None = SOLID,
    package_dirs: list[Path] | None = PACKAGE_DIRS,
    visuals: bool = VISUALS,
    frame: str | None = option(
        "NAME", "Frame of an arm to drag  [default: the one most joints move]."
    ),
    host: str = option(
        "ADDRESS",
        "Where to serve the page; 0.0.0.0 lets all of the network in.",
        default="127.0.0.1",
    ),
    port: int | None = option("NUMBER", "0 takes any  [default: the first free one from 8080 on]."),
) -> None:
    """Show a map or an arm in the browser, and plan there.

    Ctrl-C closes it.
    """
    from cspace import open as open_map
    from cspace.arms import Arm, build_arm_space

    # A URDF is an arm. A map has no options of arms.
    space: CSpace | TiledCSpace | ArmSpace
    options = drop_unset(srdf=srdf, solid=solid, package_dirs=package_dirs, visuals=visuals)
    if file.suffix.lower() == ".urdf":
        space = build_arm_space({}, Arm.from_urdf(file, **options))
        units = space.arm.units
    else:
        refuse_options({**options, **drop_unset(frame=frame)}, (), f"{file} is not a URDF")
        space = open_map(file)
        units = space.units
    shown: dict[str, Any] = drop_unset(host=host, port=port, frame=frame)
    shown |= read_marks(start, goal, space.axes, units)
    if path is not None:
        shown["path"] = read_path(path, space.axes)
    space.view(**shown)
