"""The command that audits a route graph."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer

import cspace
from cspace._cli.files import check_outputs
from cspace._cli.options import (
    AS_JSON,
    OVERWRITE,
    argument,
    drop_unset,
    flag,
    open_robot,
    option,
    parse_angle,
)
from cspace._cli.report import Stopwatch, show
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace.lanes import Audit, Conflicts, RouteGraph

_REPORTS: Final = (".csv", ".geojson", ".xml", ".png")
"""Suffixes of reports."""

CONFLICTS: Final = "conflicts"
"""Name of the report of conflicts."""

_NAME: Final = re.compile(r"([\w-]+)=(.+)")
"""Robot with a name: ``NAME=SPEC``."""


def audit(
    file: Path = argument("MAP", "A workspace in the plane, or a saved map: .zarr."),
    graph: Path = argument(
        "GRAPH", "Lanes: .geojson of Nav2, .yaml of Open-RMF, .json of LIF or VDA 5050."
    ),
    robot: list[str] | None = option(
        "[NAME=]SPEC",
        "A robot, as of cspace build, or corners such as [[0.4,0.3],...]; may be given again, each "
        "with a name.",
        "--robot",
        "--footprint",
    ),
    rotations: int = option("COUNT", "Cells of yaw.", default=72),
    spacing: float | None = option("METRES", "Side of a cell, where the file does not say."),
    unknown: str | None = option(None, "What unknown cells count as: occupied or free."),
    margin: float = option("METRES", "Grow the robot by this much.", default=0.0),
    heading: str | None = option(
        None,
        "Yaw on lanes for which the file gives none: forward, backward, both, any, or an angle.",
    ),
    level: str | None = option("NAME", "Level, layout or map of the graph, if it has several."),
    vehicle: str | None = option("NAME", "Type of vehicle of a LIF file, if it has several."),
    output: list[Path] | None = option(
        "PATH",
        "A report: .csv, .geojson, .xml (JUnit) or .png; may be given again. Of several robots, "
        "each has files with its name; conflicts have files with theirs.",
        "--output",
        "-o",
    ),
    conflicts: bool = flag(
        "--conflicts", "Also prove which lanes and nodes two robots can use at once."
    ),
    conflicts_margin: float = option(
        "METRES", "Distance that two robots must keep, with --conflicts.", default=0.0
    ),
    strict: bool = flag("--strict", "Undecided lanes give the exit code 2, and fail in JUnit."),
    overwrite: bool = OVERWRITE,
    as_json: bool = AS_JSON,
) -> None:
    """Prove lanes of a route graph free or blocked.

    Exit codes: 0 if no lane is blocked, 1 if one is, 2 with --strict if one is undecided. With
    --conflicts, the same for pairs of lanes and nodes that touch: if the file has mutex groups, and
    two have neither one nor a node in common.
    """
    from cspace.lanes import RouteGraph

    options = drop_unset(spacing=spacing, unknown=unknown)
    makers = _list_maps(file, robot or [], rotations, margin, options)
    _check_conflicts(conflicts, conflicts_margin, makers)
    names = [*makers, *([CONFLICTS] if conflicts else [])]
    outputs = _list_outputs(output or [], names)
    check_outputs([path for paths in outputs.values() for path in paths], _REPORTS, overwrite)
    clock = Stopwatch()
    with clock.step("read"):
        lanes = RouteGraph.open(
            graph, heading=_parse_heading(heading), level=level, vehicle=vehicle
        )
    if not lanes.lanes:
        rule = "an audit of nothing would say that no lane is blocked"
        raise InputError(str(graph), "has no lanes", rule)
    reports: dict[str, Any] = _audit_maps(makers, lanes, clock)
    codes = [_choose_exit_code([audit.counts for audit in reports.values()], strict)]
    if conflicts:
        with clock.step(CONFLICTS):
            reports[CONFLICTS] = found = _find_conflicts(reports, conflicts_margin)
        codes.append(1 if found.failing() else 2 * bool(found.failing(strict)))
    for name, paths in outputs.items():
        for path in paths:
            _write(reports[name], path, strict, overwrite)
    _show_reports(reports, clock, as_json)
    raise typer.Exit(1 if 1 in codes else max(codes))


def _check_conflicts(conflicts: bool, margin: float, robots: Collection[str]) -> None:
    """Raise InputError for a margin without conflicts, or a clashing name."""
    if margin and not conflicts:
        rule = "robots keep it where they are in conflict"
        raise InputError("conflicts_margin", f"is {margin:g}", rule)
    if conflicts and CONFLICTS in robots:
        rule = "the report of conflicts has that name"
        raise InputError("robot", f"has the name {CONFLICTS!r}", rule)


def _audit_maps(
    makers: dict[str, Callable[[], Any]], lanes: RouteGraph, clock: Stopwatch
) -> dict[str, Audit]:
    """Audit the lanes for each robot."""
    audits = {}
    for name, make in makers.items():
        with clock.step(f"build {name}".strip()):
            space = make()
        with clock.step(f"audit {name}".strip()):
            audits[name] = cspace.lanes.audit(space, lanes)
    return audits


def _show_reports(reports: dict[str, Any], clock: Stopwatch, as_json: bool) -> None:
    """Print reports as tables or as one document."""
    if not as_json:
        typer.echo("\n\n".join(map(str, reports.values())))
        return
    counts = {name or "lanes": report.counts for name, report in reports.items()}
    documents = {name or "graph": report.to_geojson() for name, report in reports.items()}
    show({**counts, "reports": documents, "seconds": clock.seconds}, as_json)


def _find_conflicts(audits: dict[str, Audit], margin: float) -> Conflicts:
    """Find the conflicts of all audited robots."""
    (name, first), *others = audits.items()
    robots = {other: (audit.space, audit.graph) for other, audit in others}
    return cspace.lanes.conflicts(first.space, first.graph, others=robots, margin=margin, name=name)


def _choose_exit_code(counts: list[dict[str, int]], strict: bool) -> int:
    """Return 1 if a lane is blocked, 2 if ``strict`` and one is undecided, otherwise 0."""
    if any(count["blocked"] for count in counts):
        return 1
    return 2 if strict and any(count["undecided"] for count in counts) else 0


def _parse_heading(text: str | None) -> Any:
    """Return a heading as of :meth:`cspace.lanes.RouteGraph.open`."""
    if text in (None, "forward", "backward", "both", "any"):
        return text
    return parse_angle(str(text), "heading", "yaw")


def _list_outputs(paths: list[Path], robots: Collection[str]) -> dict[str, list[Path]]:
    """Return the outputs of each robot, named after it."""
    return {
        name: [path.with_stem(f"{path.stem}-{name}") if name else path for path in paths]
        for name in robots
    }


def _list_maps(
    file: Path, robots: list[str], rotations: int, margin: float, options: dict[str, Any]
) -> dict[str, Callable[[], Any]]:
    """Return functions that make the map of each robot, by its name; "" for the only one."""
    from cspace import Workspace, build
    from cspace import open as open_map

    if file.suffix.lower() == ".zarr":
        if robots:
            rule = "a saved map has one"
            raise InputError("robot", f"is given for {file}", rule)
        return {"": partial(open_map, file)}
    specs: dict[str, str] = {}
    for text in robots:
        found = _NAME.fullmatch(text)
        name, spec = found.groups() if found else ("", text)
        if name in specs or (specs and "" in (name, *specs)):
            rule = "each of several robots needs a name of its own, as in NAME=SPEC"
            raise InputError("robot", f"is {text!r}", rule)
        specs[name] = f"footprint:{spec}" if spec.startswith("[") else spec
    if not specs:
        raise InputError("robot", "is missing", f"{file} is no saved map")
    shapes = {name: open_robot(spec) for name, spec in specs.items()}
    workspace = Workspace.open(file, **options)

    def make(name: str) -> Any:
        """Build the map of a robot, with yaw unless it is round."""
        shape = shapes[name]
        cells = None if shape.shape.is_round else rotations
        return build(workspace, shape, rotations=cells, margin=margin)

    return {name: partial(make, name) for name in shapes}


def _write(report: Audit | Conflicts, path: Path, strict: bool, overwrite: bool) -> None:
    """Write a report in the format of its suffix."""
    from cspace.plot import save_figure

    suffix = path.suffix.lower()
    if suffix == ".csv":
        report.to_csv(path, overwrite)
    elif suffix == ".geojson":
        report.to_geojson(path, overwrite)
    elif suffix == ".xml":
        report.to_junit(path, overwrite, strict=strict)
    else:
        save_figure(lambda: report.plot().figure, path, overwrite=overwrite, dpi=150.0)
