"""The page of a run against peers, in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.report import number_text, time_text

Row = Mapping[str, Any]

OURS = (
    'Ours is `cspace.build(..., inner=False, outside="free")` with the method that is named, from the robot\'s shape '
    "on. Peers run with their defaults; they are given the robot's cells, and the map in the type that they ask for."
)


def written(whole: Mapping[str, Any], plot: str) -> str:
    """The page.

    Parameters
    ----------
    whole : mapping of str
        What :meth:`benchmarks.report.Report.whole` gives.
    plot : str
        Path of the plot, from the page.

    Returns
    -------
    str
    """
    rows: Sequence[Row] = whole["rows"]
    checks = [row["holds"] for row in rows if "holds" in row]
    versions = ", ".join(f"{key} {value}" for key, value in whole["machine"].items() if key not in ("cores", "system"))
    parts = [
        "# Benchmarks",
        f"Made by `{whole['command']}`{', at sizes for a quick look' if whole['quick'] else ''}.",
        f"{whole['machine']['cores']} cores, {whole['machine']['system']}; {versions}.",
        OURS,
        "What is compared ran in turns in one process. Times are medians by the clock; a ratio in CPU time stands "
        "beside that by the clock, since ours takes every core and most peers one. Of "
        f"{len(checks)} checks of results, {sum(checks)} held.",
        "## Against targets",
        _table(*_promises(rows)),
        f"![Cost over the size of the map and of the robot]({plot})",
        *(part for sweep in _unique(row["sweep"] for row in rows if "size" in row) for part in _sweep(rows, sweep)),
    ]
    return "\n\n".join(parts) + "\n"


def _promises(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Every figure that has a target."""
    head = ["work", "compared", "times", "ratio or figure", "in CPU time", "target", ""]
    body, before = [], ""
    for row in rows:
        if row.get("met") is None:
            continue
        took = f"{time_text(row['over_s'])} / {time_text(row['under_s'])}" if "over_s" in row else ""
        cpu = f"{number_text(row['cpu_value'])} {row['unit']}" if "cpu_value" in row else ""
        bound = f"at least {row['least']:g}" if row["least"] is not None else f"at most {row['most']:g}"
        case = "the same" if row["case"] == before else row["case"]
        verdict = "met" if row["met"] else "missed"
        body.append(
            [case, row["name"], took, f"{number_text(row['value'])} {row['unit']}".strip(), cpu, bound, verdict]
        )
        before = row["case"]
    return head, body


def _sweep(rows: Sequence[Row], sweep: str) -> list[str]:
    """Heading, table and remarks of one sweep."""
    own = [row for row in rows if row.get("sweep") == sweep]
    points = [row for row in own if "size" in row]
    sizes = _unique((row["size"], row["across"]) for row in points)
    methods = _unique(row["way"] for row in points if "way" in row)
    of_map = len({size for size, _ in sizes}) > 1
    # What stays the same: the robot, or the map.
    fixed = sizes[0][1] if of_map else sizes[0][0]
    dim, shape = points[0]["dim"], "disc" if points[0]["dim"] == 2 else "ball"
    sampled = {row["way"]: row["extrapolated_from"] for row in points if "extrapolated_from" in row}
    named = [f"{way}, extrapolated" if way in sampled else way for way in methods]
    first = "map" if of_map else f"{shape}, cells across"
    body = []
    for size, across in sizes:
        here = [row for row in points if (row["size"], row["across"]) == (size, across)]
        label = " x ".join([str(size)] * dim) if of_map else str(across)
        body.append([label, *(_cell(here, way) for way in methods), _choice(here)])
    for over in _unique(row["over"] for row in own if "exponent_of" in row):
        slopes = {row["exponent_of"]: f"{row['value']:.2f}" for row in own if row.get("over") == over}
        body.append([f"exponent, {over}", *(slopes.get(way, "") for way in methods), ""])
    what = f"{shape} {fixed} cells across" if of_map else f"map of {' x '.join([str(fixed)] * dim)} cells"
    place = "the plane" if dim == 2 else "space"
    parts = [
        f"## Cost in {place} over the size of the {'map' if of_map else 'robot'}",
        f"Obstacles in boxes, {what}.",
        _table([first, *named, '"auto" took'], body),
    ]
    if any(row.get("left_out") for row in points):
        parts.append("In brackets: not run, and what it was expected to take.")
    for way, number in sampled.items():
        parts.append(
            f"{way} looks at one configuration at a time: one in each of {number} cells, and the time is extrapolated "
            "to all cells; its tree was made beforehand."
        )
    return parts


def _cell(rows: Sequence[Row], way: str) -> str:
    """What a way took at one size."""
    for row in rows:
        if row.get("way") == way:
            return f"({time_text(row['value'])})" if row.get("left_out") else time_text(row["median_s"])
    return ""


def _choice(rows: Sequence[Row]) -> str:
    """Which engine was chosen, and how much slower it is where the other one is quicker."""
    for row in rows:
        if "chosen" in row:
            regret = row["taken"][row["chosen"]] / min(row["taken"].values())
            return row["chosen"] if regret == 1.0 else f"{row['chosen']}, {regret:.2f} x the other"
    return ""


def _table(head: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *body]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _unique(values: Any) -> list[Any]:
    """Each value once, in the order in which they come."""
    return list(dict.fromkeys(values))
