"""Commands that plan on a saved map, and that demonstrate the library."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias, cast

import typer

from cspace._cli.files import check_folder, check_outputs
from cspace._cli.info import describe_map
from cspace._cli.options import (
    AS_JSON,
    CONFIGURATION,
    MAP_FILE,
    OVERWRITE,
    drop_unset,
    flag,
    option,
    parse_configuration,
    read_marks,
    refuse_options,
)
from cspace._cli.report import Stopwatch, list_option_names, name_options, show, with_unit
from cspace.errors import FileError, InputError

if TYPE_CHECKING:
    from cspace import CSpace, TiledCSpace
    from cspace.inside import ConfigurationMap
    from planners import Car, Differential, Plan, SpeedZones

DriveName: TypeAlias = Literal[
    "holonomic", "differential", "differential-reverse", "dubins", "reeds-shepp"
]
"""How a robot moves; a car is named for its curves."""

_REVERSING: Final[Mapping[str, DriveName]] = {
    "differential": "differential-reverse",
    "dubins": "reeds-shepp",
}
"""The drive that also reverses, for each that does not."""

_START: Final = option(
    CONFIGURATION,
    "Where the robot is, metres; e.g. --start=-1,2, with rotations -1,2,90deg, in space -1,2,0.5; "
    "on a map of joints 90deg,-0.5,0.2, each in radians, degrees or metres.",
    default=...,
)
_GOAL: Final = option(
    CONFIGURATION,
    "Where it goes; ROTATION is a yaw, e.g. 90deg, or QX,QY,QZ,QW.",
    default=...,
)
_GOALS: Final = option(
    CONFIGURATION,
    "Where it goes; ROTATION is a yaw, e.g. 90deg, or QX,QY,QZ,QW. May be given again: the goal "
    "with the shortest path is taken.",
    "--goal",
    default=...,
)


def plan(
    context: typer.Context,
    file: Path = MAP_FILE,
    start: str = _START,
    goal: list[str] = _GOALS,
    any_yaw: bool = flag("--any-yaw", "At the goal, which is a position."),
    goal_tolerance: str | None = option(
        "METRES[,ANGLE]", "How far from the goal the path may end; e.g. 0.3,10deg."
    ),
    start_tolerance: float | None = option(
        "METRES", "How far a start that is not free may be moved."
    ),
    output: list[Path] | None = option(
        "PATH", "The path: .csv or .json; may be given again.", "--output", "-o"
    ),
    planner: str | None = option(
        None,
        "Grid, Lattice, or a planner of OMPL; a wrong name lists them all  [default: "
        "Grid, or Lattice for other drives than holonomic].",
    ),
    time_limit: float | None = option(
        "SECONDS", "When to give up; by default after the work of about a second."
    ),
    seed: int | None = option(None, "Makes the run repeatable."),
    simplify: bool = option(None, "Shorten the path.", "--simplify/--no-simplify", default=True),
    objective: str = option(
        None,
        "What to optimise: length, clearance, or the time by --max-velocity and --speed-zones.",
        default="length",
    ),
    speed_zones: str | None = option(
        "FILE[#PROPERTY]",
        "Zones with a largest speed: a zone set of VDA 5050, or GeoJSON with a property in m/s.",
    ),
    exact: bool = flag("--exact", "Ask the geometry itself where the grid cannot decide."),
    drive: DriveName = option(None, "How a robot with a yaw moves.", default="holonomic"),
    turning_radius: float | None = option(
        "METRES", "Of the tightest curve, at the reference point."
    ),
    trajectory: Path | None = option(
        "CSV", "The path with times and velocities, within the limits that follow."
    ),
    max_velocity: float | None = option("M/S"),
    max_acceleration: float | None = option("M/S2"),
    max_angular_velocity: float | None = option("RAD/S"),
    max_angular_acceleration: float | None = option("RAD/S2"),
    max_lateral_acceleration: float | None = option("M/S2"),
    max_jerk: float | None = option("M/S3"),
    max_angular_jerk: float | None = option("RAD/S3"),
    picture: Path | None = option("PNG", "Draw map and path."),
    animate: Path | None = option("GIF", "Draw the robot on its way, as a moving picture."),
    overwrite: bool = OVERWRITE,
    as_json: bool = AS_JSON,
) -> None:
    """Plan a path on a saved map; exit with 1 if there is none."""
    import planners
    from cspace import open as open_map
    from cspace.plot import PICTURE_SUFFIXES, save_plot

    # Check all outputs before the search, so that no result is lost.
    check_outputs(output or [], (".csv", ".json"), overwrite)
    check_outputs([picture], PICTURE_SUFFIXES, overwrite)
    check_outputs([animate], (".gif",), overwrite)
    check_outputs([trajectory], (".csv",), overwrite)
    limits: dict[str, Any] = drop_unset(
        max_velocity=max_velocity,
        max_acceleration=max_acceleration,
        max_angular_velocity=max_angular_velocity,
        max_angular_acceleration=max_angular_acceleration,
        max_lateral_acceleration=max_lateral_acceleration,
        max_jerk=max_jerk,
        max_angular_jerk=max_angular_jerk,
    )
    speeds = _list_speeds(objective, max_velocity)
    if trajectory is None:
        given = limits | drop_unset(speed_zones=speed_zones)
        refuse_options(given, speeds, "no --trajectory is")
    zones = _open_zones(speed_zones)
    moves = _read_drive(drive, turning_radius, limits.pop("max_lateral_acceleration", None))
    clock = Stopwatch()
    with clock.step("read"):
        space: Any = open_map(file)
    goals = _parse_goals(goal, space, any_yaw, goal_tolerance)
    here = parse_configuration(start, "start", space.axes, space.units)
    options: dict[str, Any] = {"start": planners.Near(here, start_tolerance or 0.0), "goal": goals}
    search = planners.Search(cast("Any", planner), simplify=simplify)
    options |= {"planner": search, "objective": objective, "seed": seed}
    if speeds:
        options["speed"] = [*zones, max_velocity]
    options |= {"drive": moves, "time_limit": time_limit}
    with clock.step("plan"):
        planned = planners.plan(space.exact if exact else space, **options)
    # The proven distance to obstacles may take as long as the search.
    with clock.step("measure"):
        described = _describe(planned)
        if planned:
            described |= _describe_distance(planned)
    if planned:
        with clock.step("write"):
            _write_path(planned, output or [], overwrite)
            if trajectory:
                motion = planned.trajectory(**{"max_acceleration": None, **limits}, speed=zones)
                motion.to_csv(trajectory, overwrite)
                described["duration_s"] = motion.duration
    if picture:
        with clock.step("draw"):
            save_plot(space, picture, overwrite, path=planned)
    if animate and planned:
        with clock.step("animate") as progress:
            _draw_film(space, planned, animate, overwrite, progress)
    show({**described, "seconds": clock.seconds}, as_json)
    if not planned:
        hint = _word_hint(planned.hint, drive)
        hint = name_options(hint, list_option_names(context.command, context.meta))
        advice = f"; try {hint}" if hint else ""
        typer.echo(
            f"cspace: from {start} to {' or '.join(goal)}: {planned.status}{advice}", err=True
        )
        raise typer.Exit(1)


def _draw_film(
    space: CSpace | TiledCSpace,
    planned: Plan,
    file: Path,
    overwrite: bool,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Draw the robot on its way; a map in tiles is drawn coarsely."""
    from cspace import TiledCSpace
    from cspace.plot import animate

    drawn = space.overview() if isinstance(space, TiledCSpace) else space
    animate(drawn, planned, file, overwrite, progress=progress)


def _list_speeds(objective: str, max_velocity: float | None) -> tuple[str, ...]:
    """Return the names of the options of speeds that the search takes."""
    if objective != "time":
        return ()
    if max_velocity is None:
        raise InputError("max_velocity", "is missing", "the quickest way needs a largest speed")
    return "max_velocity", "speed_zones"


def _open_zones(text: str | None) -> list[SpeedZones]:
    """Read the file of ``--speed-zones``, with the property that it names."""
    from planners import SpeedZones

    if text is None:
        return []
    file, mark, name = text.rpartition("#")
    if not mark or Path(text).suffix in (".json", ".geojson"):  # the mark is part of its name
        return [SpeedZones.open(text)]
    return [SpeedZones.open(file, name)]


def _read_drive(
    name: DriveName, turning_radius: float | None, max_lateral_acceleration: float | None
) -> Car | Differential | None:
    """Make the drive of ``--drive`` and its options; raise InputError if they do not fit."""
    from planners import Car, Differential

    fields = drop_unset(
        turning_radius=turning_radius, max_lateral_acceleration=max_lateral_acceleration
    )
    reverse = name in _REVERSING.values()
    if name in ("dubins", "reeds-shepp"):
        if turning_radius is None:
            raise InputError("turning_radius", "is missing", "a car has a tightest curve")
        return Car(reverse=reverse, **fields)
    taken = () if name == "holonomic" else ("max_lateral_acceleration",)
    refuse_options(fields, taken, f"--drive is {name}")
    return None if name == "holonomic" else Differential(reverse=reverse, **fields)


def _parse_goal(text: str, space: ConfigurationMap, any_yaw: bool) -> tuple[float | None, ...]:
    """Parse ``--goal``, which has no rotation if it may be any; raise InputError otherwise."""
    if not any_yaw:
        return parse_configuration(text, "goal", space.axes, space.units)
    dim = space.dim
    if not space.rotations.names:
        rule = "the map has no rotations"
        raise InputError("any_yaw", f"is set, and the axes are {', '.join(space.axes)}", rule)
    return (*parse_configuration(text, "goal", space.axes[:dim], space.units[:dim]), None)


def _parse_goals(
    texts: list[str], space: ConfigurationMap, any_yaw: bool, tolerance: str | None
) -> list[Any]:
    """Parse each ``--goal``, and ``--goal-tolerance``, metres and perhaps an angle."""
    from planners import Near

    goals = [_parse_goal(text, space, any_yaw) for text in texts]
    if tolerance is None:
        return goals
    units = ("m", "rad")[: 1 + tolerance.count(",")]
    names = ("metres", "angle")[: len(units)]
    room = parse_configuration(tolerance, "goal_tolerance", names, units)
    return [Near(goal, *room) for goal in goals]


def explain(
    file: Path = MAP_FILE,
    start: str = _START,
    goal: str = _GOAL,
    refine: bool = flag("--refine", "Build finer maps, for narrower margins."),
    picture: Path | None = option("PNG", "Draw what is in the way."),
    overwrite: bool = OVERWRITE,
    as_json: bool = AS_JSON,
) -> None:
    """Explain why a path on a saved map exists, or does not."""
    from cspace import open as open_map
    from cspace.plot import PICTURE_SUFFIXES, save_figure

    check_outputs([picture], PICTURE_SUFFIXES, overwrite)
    clock = Stopwatch()
    with clock.step("read"):
        space: Any = open_map(file)
    ends = read_marks(start, goal, space.axes, space.units)
    with clock.step("explain"):
        explanation = space.explain(**ends, refine=refine)
    if picture:
        with clock.step("draw"):
            save_figure(lambda: explanation.plot().figure, picture, overwrite=overwrite, dpi=150.0)
    margin = with_unit("margin", space.grid.unit)
    described = {
        "verdict": explanation.verdict,
        "reason": str(explanation),
        "obstacles": list(explanation.obstacles),
        "bottleneck": explanation.bottleneck.tolist(),
        margin: [x if math.isfinite(x) else None for x in explanation.margin],
        "barrier_cells": len(explanation.barrier),
    }
    show({**described, "seconds": clock.seconds}, as_json)


def demo(
    output: Path = option(
        "FOLDER", "Where to write.", "--output", "-o", default=Path("cspace-demo")
    ),
    overwrite: bool = OVERWRITE,
    as_json: bool = AS_JSON,
) -> None:
    """Map a floor plan, prove what can be reached, and plan.

    Map, path and picture are written, and files to go on with.
    """
    import cspace._cli.demo as flat
    import planners
    from cspace import build
    from cspace.plot import save_plot

    # Nothing is written before everything is computed, so that a failure leaves no files.
    check_folder(output)
    files = {
        "map": output / "map.zarr",
        "path": output / "path.csv",
        "picture": output / "picture.png",
        "floor_plan": output / "flat.geojson",
        "house": output / "house.stl",
        "arm": output / "arm.urdf",
    }
    if output.exists():
        check_outputs(files.values(), {file.suffix for file in files.values()}, overwrite)
        found = [file for file in files.values() if file.exists()]
        if 0 < len(found) < len(files):
            problem = "exists, and the demo's other files do not"
            raise FileError(str(found[0]), problem, "only a whole demo is replaced")
    clock = Stopwatch()
    with clock.step("draw_floor_plan"):
        workspace = flat.demo_workspace()
    with clock.step("build_map") as progress:
        space = build(workspace, flat.demo_robot(), progress=progress)
    with clock.step("prove"):
        start = flat.START_POSITION
        goal = flat.GOAL_POSITION
        store = flat.STORE_POSITION
        proofs = {
            "start_is_connected_to_goal": space.is_connected(start, goal),
            "start_is_disconnected_from_store_room": space.is_disconnected(start, store),
        }
    with clock.step("plan"):
        planned = planners.plan(space, start, goal, seed=1)
    output.mkdir(parents=True, exist_ok=True)
    with clock.step("save_map"):
        space.save(files["map"], overwrite=overwrite)
    with clock.step("save_inputs"):
        flat.write_inputs(output)
    with clock.step("save_path"):
        planned.to_csv(files["path"], overwrite=overwrite)
    with clock.step("draw_picture"):
        save_plot(space, files["picture"], overwrite, path=planned)
    document = {"map": describe_map(space), "proofs": proofs, "plan": _describe(planned)}
    document["files"] = {name: str(file) for name, file in files.items()}
    show({**document, "seconds": clock.seconds}, as_json)


def _write_path(plan: Plan, files: list[Path], overwrite: bool) -> None:
    """Write a path as tables and records."""
    for file in files:
        write = plan.to_csv if file.suffix.lower() == ".csv" else plan.to_json
        write(file, overwrite=overwrite)


def _word_hint(hint: str, drive: DriveName) -> str:
    """Word the hint of a failed plan for the command line, but for names of options."""
    hint = hint.replace("plan.explain()", "cspace explain")
    return re.sub(r"planners\.\w+\(.*?\)", _REVERSING.get(drive, drive), hint)


def _describe_distance(plan: Plan) -> dict[str, float]:
    """Describe the obstacle distance of a path, or its clearance if it has none."""
    if math.isnan(plan.obstacle_distance):
        return {with_unit("clearance", plan.length_unit): plan.clearance}
    return {with_unit("obstacle_distance", "m"): plan.obstacle_distance}


def _describe(plan: Plan) -> dict[str, Any]:
    """Describe a plan: its outcome, its proofs and its path."""
    names = ["status", "is_connected", "is_disconnected"]
    described: dict[str, Any] = {"planner": plan.planner, "solved": bool(plan)}
    described |= {name: getattr(plan, name) for name in names}
    if plan:
        described["configurations"] = len(plan.path)
        described[with_unit("length", plan.length_unit)] = plan.length
        if plan.total_rotation:
            described["total_rotation_rad"] = plan.total_rotation
        described |= {"certified": plan.certified, "path": plan.path.tolist()}
    return described
