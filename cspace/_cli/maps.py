"""Commands that build, draw, export and show maps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from cspace._cli.files import (
    check_outputs,
    lazy_option,
    prepare_store,
    read_path,
    select_window,
)
from cspace._cli.info import describe_map
from cspace._cli.options import (
    Json,
    MapFile,
    Mark,
    Overwrite,
    PackageDirs,
    PathFile,
    Solid,
    SolidMesh,
    Srdf,
    Unknown,
    Up,
    Visuals,
    drop_none,
    open_robot,
    parse_box,
    parse_configuration,
    parse_offset,
    parse_rotation,
    parse_rotation_cells,
    read_arm,
    read_marks,
    refuse_options,
)
from cspace._cli.report import Clock, show
from cspace._support.words import Outside

if TYPE_CHECKING:
    from cspace._space import CSpace
    from cspace._tiles.space import TiledCSpace
    from cspace.arms import ArmSpace


def make(
    workspace: Annotated[
        Path,
        typer.Argument(
            metavar="WORKSPACE",
            readable=False,
            help="In the plane: a ROS map (.yaml), image, MovingAI .map, .geojson or .wkt. In "
            "space: a mesh (.stl, .obj, .ply, .glb ...), OctoMap (.bt, .ot), MovingAI .3dmap or "
            "points (.xyz, .csv, .pcd, .ply). Either: .npy.",
        ),
    ],
    robot: Annotated[
        str,
        typer.Option(
            metavar="SPEC",
            help="A short text such as disc:0.3, rect:0.9x0.6 or box:0.6x0.6x0.2 (all: --robot "
            "help), or a file with a polygon, a mesh or a URDF.",
        ),
    ],
    spacing: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Side of a cell, where the file does not say: images, polygons, meshes, points.",
        ),
    ] = None,
    rotations: Annotated[
        str | None,
        typer.Option(
            metavar="COUNT",
            help="For a robot that turns: how many cells of yaw, e.g. 72; or quaternions:8, in "
            "space, for all.",
        ),
    ] = None,
    bounds: Annotated[
        str | None,
        typer.Option(
            metavar="LOWER,UPPER",
            help="Box to map, metres, for polygons, meshes, points, OctoMaps: XMIN,YMIN,XMAX,YMAX, "
            "or in space XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX  [default: that of the file].",
        ),
    ] = None,
    unknown: Annotated[
        Unknown | None,
        typer.Option(
            help="What unknown cells of a ROS map or an OctoMap count as  [default: occupied]."
        ),
    ] = None,
    solid: SolidMesh = None,
    robot_solid: Annotated[
        Solid | None, typer.Option(help="The same for a robot that is a mesh  [default: auto].")
    ] = None,
    up: Annotated[
        Up | None, typer.Option(help="Axis of a mesh of obstacles that points up and becomes z.")
    ] = None,
    robot_up: Annotated[
        Up | None, typer.Option(help="The same for a robot that is a mesh.")
    ] = None,
    visuals: Visuals = False,
    package_dirs: PackageDirs = None,
    radius: Annotated[
        float | None,
        typer.Option(metavar="METRES", help="Of the ball around each point of a point cloud."),
    ] = None,
    drop_missing: Annotated[
        bool, typer.Option(help="Leave out points of a cloud that are not finite.")
    ] = False,
    offset: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y[,Z]",
            help="Metres to add to the coordinates of polygons, meshes and points, before the "
            "bounds apply, e.g. for files in UTM.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="OUT",
            readable=False,
            help="The map: .zarr  [default: the workspace's name with .zarr, in this folder].",
        ),
    ] = None,
    outside: Annotated[Outside, typer.Option(help="What lies beyond the workspace.")] = "blocked",
    margin: Annotated[
        float, typer.Option(metavar="METRES", help="Grow the robot by this much.")
    ] = 0.0,
    tile: Annotated[
        int | None,
        typer.Option(
            metavar="CELLS",
            help="Build tile by tile, each so many cells along an axis, for maps larger than "
            "memory; the same command goes on where it was stopped.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Build the map of a robot in a workspace, and save it."""
    from cspace._builder import build
    from cspace._record.save import MAP_SUFFIXES
    from cspace._workspace import Workspace

    # Check the options and the output before the long work of reading and building.
    cells = parse_rotation_cells(rotations)
    output = Path(workspace.with_suffix(".zarr").name) if output is None else output
    if tile is None:
        check_outputs([output], MAP_SUFFIXES, overwrite)
    else:
        prepare_store(output, overwrite)
    box = None if bounds is None else parse_box(bounds, "bounds")
    step = None if offset is None else parse_offset(offset)
    options = drop_none(
        spacing=spacing,
        unknown=unknown,
        bounds=box,
        solid=solid,
        up=up,
        radius=radius,
        drop_missing=drop_missing or None,
        offset=step,
    )
    clock = Clock()
    with clock.step("read"):
        shape = open_robot(
            robot,
            solid=robot_solid,
            up=robot_up,
            package_dirs=package_dirs or None,
            visuals=visuals or None,
        )
        lazy = {} if tile is None else lazy_option(workspace, options)
        obstacles = Workspace.open(workspace, **options, **lazy)
    settings: dict[str, Any] = {"rotations": cells, "outside": outside, "margin": margin}
    if tile is not None:
        settings |= {"store": output, "tile": tile}
    with clock.step("build") as progress:
        space: Any = build(obstacles, shape, progress=progress, **settings)
    if tile is None:
        with clock.step("save"):
            space.save(output, overwrite=overwrite)
    show({"map": str(output), **describe_map(space), "seconds": clock.seconds}, as_json)


def picture(
    file: MapFile,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="PNG", readable=False, help="The picture: .png, .pdf or .svg."
        ),
    ],
    path: PathFile = None,
    start: Mark = None,
    goal: Mark = None,
    rotation: Annotated[
        str | None,
        typer.Option(
            metavar="ROTATION",
            help="Show the slice at this rotation, e.g. 90deg or 0,0,0,1  [default: all of them].",
        ),
    ] = None,
    view: Annotated[
        Literal["plane", "sections", "3d"] | None,
        typer.Option(help="Of a map in space: sections or 3d  [default: sections]."),
    ] = None,
    center: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y[,Z]", help="The point of sections or of --zoom, metres  [default: chosen]."
        ),
    ] = None,
    zoom: Annotated[
        float | None,
        typer.Option(
            metavar="TIMES", help="Show a part only, so many times larger, around --center."
        ),
    ] = None,
    cut: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Height, or angle of the third joint, above which 3d leaves cells out  "
            "[default: above the path].",
        ),
    ] = None,
    dpi: Annotated[
        float, typer.Option(help="Pixels per inch; a picture is about 8 inches wide.")
    ] = 150.0,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Draw a picture of a map, and of a path on it."""
    from cspace._opening import open_map
    from cspace.plot import save_plot
    from cspace.plot._picture import PICTURE_SUFFIXES

    check_outputs([output], PICTURE_SUFFIXES, overwrite)
    clock = Clock()
    with clock.step("read"):
        space = open_map(file)
        axes = space.axes
        units = space.units
        dim = space.grid.dim
        # Parse what depends on the axes of the map.
        options = drop_none(view=view, zoom=zoom, cut=cut)
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
    file: MapFile,
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            readable=False,
            help=".zarr; .npz (NumPy); .nc (netCDF); .vti for ParaView; in the plane .yaml for a "
            "ROS map, .tif for a "
            "GeoTIFF; in space .stl, .ply or .obj for the border of the free space.",
        ),
    ],
    rotation: Annotated[
        str | None,
        typer.Option(
            metavar="ROTATION", help="Only the slice at this rotation, e.g. 90deg or 0,0,0,1."
        ),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            metavar="LOWER,UPPER",
            help="Only this box, metres: XMIN,YMIN,XMAX,YMAX, or in space "
            "XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX; of a map in "
            "tiles, with as much around it as the robot reaches.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write a saved map for other software."""
    from cspace._opening import open_map
    from cspace.export._maps import EXPORT_FORMATS

    check_outputs([output], EXPORT_FORMATS, overwrite)
    clock = Clock()
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
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", readable=False, help="A saved map: .zarr; or an arm: .urdf."
        ),
    ],
    path: PathFile = None,
    start: Mark = None,
    goal: Mark = None,
    srdf: Srdf = None,
    solid: SolidMesh = None,
    package_dirs: PackageDirs = None,
    visuals: Visuals = False,
    frame: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Frame of an arm to drag  [default: the one most joints move]."
        ),
    ] = None,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS", help="Where to serve the page; 0.0.0.0 lets all of the network in."
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER", help="0 takes any  [default: the first free one from 8080 on]."
        ),
    ] = None,
) -> None:
    """Show a map or an arm on a page in the browser, and plan there.

    Ctrl-C closes it.
    """
    from cspace._opening import open_map
    from cspace.arms import build_arm_space

    # A URDF is an arm; other options than a map's are refused for a map.
    space: CSpace | TiledCSpace | ArmSpace
    if file.suffix.lower() == ".urdf":
        space = build_arm_space({}, read_arm(file, srdf, solid, package_dirs, visuals))
        units = space.arm.units
    else:
        options = drop_none(
            srdf=srdf,
            solid=solid,
            package_dirs=package_dirs or None,
            visuals=visuals or None,
            frame=frame,
        )
        refuse_options(options, (), f"{file} is not a URDF")
        space = open_map(file)
        units = space.units
    shown: dict[str, Any] = drop_none(host=host, port=port, frame=frame)
    shown |= read_marks(start, goal, space.axes, units)
    if path is not None:
        shown["path"] = read_path(path, space.axes)
    space.view(**shown)
