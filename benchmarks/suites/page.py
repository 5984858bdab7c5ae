"""Page of a run against peers: tables in Markdown and a plot of cost over sizes."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from benchmarks.report import number_text, time_text
from benchmarks.suites.outer_maps import engine_label

Row = Mapping[str, Any]

# Colours safe for the colour-blind (Okabe and Ito, 2008), each with its own marker.
STYLES: dict[str, dict[str, Any]] = {
    engine_label("fft"): {"color": "#0072B2", "marker": "o", "linewidth": 2.6},
    engine_label("direct"): {"color": "#D55E00", "marker": "s", "linewidth": 2.6},
    "fftconvolve float64": {"color": "#CC79A7", "marker": "^"},
    "oaconvolve float32": {"color": "#009E73", "marker": "v"},
    "ndimage.binary_dilation": {"color": "#56B4E9", "marker": "D"},
    "stamping, compiled": {"color": "#E69F00", "marker": "P"},
    "cv2.dilate": {"color": "#000000", "marker": "X"},
    "cv2.filter2D": {"color": "#7F7F7F", "marker": "*"},
    "shapely": {"color": "#7A4B00", "marker": ".", "linestyle": ":"},
    "FCL": {"color": "#7A4B00", "marker": ".", "linestyle": ":"},
    "coal": {"color": "#4B0082", "marker": ".", "linestyle": ":"},
}

CHOSEN = engine_label("auto")
GREY = "#333333"

OURS = (
    'Ours is `cspace.build(..., inner=False, outside="free")` with the method in quotes, starting from the robot\'s '
    "shape. Peers run with their defaults. Their input is the robot's cells, and the map in the type that they need."
)


def write(whole: Mapping[str, Any], plot: str) -> str:
    """Write the page of a report in Markdown, with the path of its plot."""
    rows: Sequence[Row] = whole["rows"]
    checks = [row["holds"] for row in rows if "holds" in row]
    versions = ", ".join(
        f"{key} {value}"
        for key, value in whole["machine"].items()
        if key not in ("cores", "system")
    )
    parts = [
        "# Benchmarks",
        f"Made by `{whole['command']}`{', at sizes for a quick look' if whole['quick'] else ''}.",
        f"{whole['machine']['cores']} cores, {whole['machine']['system']}; {versions}.",
        OURS,
        "The methods ran in turns in one process. Times are medians by the clock. A ratio in CPU time stands beside "
        "the ratio by the clock, because ours uses every core and most peers one. "
        f"{sum(checks)} of {len(checks)} checks of results held.",
        "## Against targets",
        _table(*_promises(rows)),
        f"![Cost over the size of the map and of the robot]({plot})",
        *(
            part
            for sweep in _unique(row["sweep"] for row in rows if "size" in row)
            for part in _sweep(rows, sweep)
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _promises(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Return the table of figures with targets."""
    head = ["work", "compared", "times", "ratio or figure", "in CPU time", "target", ""]
    body, before = [], ""
    for row in rows:
        if row.get("met") is None:
            continue
        took = (
            f"{time_text(row['over_s'])} / {time_text(row['under_s'])}" if "over_s" in row else ""
        )
        cpu = f"{number_text(row['cpu_value'])} {row['unit']}" if "cpu_value" in row else ""
        bound = (
            f"at least {row['least']:g}" if row["least"] is not None else f"at most {row['most']:g}"
        )
        case = "the same" if row["case"] == before else row["case"]
        verdict = "met" if row["met"] else "missed"
        body.append(
            [
                case,
                row["name"],
                took,
                f"{number_text(row['value'])} {row['unit']}".strip(),
                cpu,
                bound,
                verdict,
            ]
        )
        before = row["case"]
    return head, body


def _sweep(rows: Sequence[Row], sweep: str) -> list[str]:
    """Return heading, table and remarks of one sweep."""
    of_sweep = [row for row in rows if row.get("sweep") == sweep]
    points = [row for row in of_sweep if "size" in row]
    sizes = _unique((row["size"], row["across"]) for row in points)
    methods = _unique(row["way"] for row in points if "way" in row)
    of_map = len({size for size, _ in sizes}) > 1
    # The robot is fixed in sweeps over maps, and the map in sweeps over robots.
    fixed = sizes[0][1] if of_map else sizes[0][0]
    dim, shape = points[0]["dim"], "disc" if points[0]["dim"] == 2 else "ball"
    sampled = {row["way"]: row["extrapolated_from"] for row in points if "extrapolated_from" in row}
    labels = [f"{way}, extrapolated" if way in sampled else way for way in methods]
    first = "map" if of_map else f"{shape}, cells across"
    body = []
    for size, across in sizes:
        here = [row for row in points if (row["size"], row["across"]) == (size, across)]
        label = " x ".join([str(size)] * dim) if of_map else str(across)
        body.append([label, *(_cell(here, way) for way in methods), _choice(here)])
    for over in _unique(row["over"] for row in of_sweep if "exponent_of" in row):
        slopes = {
            row["exponent_of"]: f"{row['value']:.2f}" for row in of_sweep if row.get("over") == over
        }
        body.append([f"exponent, {over}", *(slopes.get(way, "") for way in methods), ""])
    what = (
        f"{shape} {fixed} cells across"
        if of_map
        else f"map of {' x '.join([str(fixed)] * dim)} cells"
    )
    place = "the plane" if dim == 2 else "space"
    parts = [
        f"## Cost in {place} over the size of the {'map' if of_map else 'robot'}",
        f"Obstacles in boxes, {what}.",
        _table([first, *labels, '"auto" took'], body),
    ]
    if any(row.get("left_out") for row in points):
        parts.append("In brackets: not run; the time is an estimate.")
    for way, number in sampled.items():
        parts.append(
            f"{way} tests one configuration at a time. It ran in each of {number} cells, and the time is "
            "extrapolated to all cells. Its tree was built beforehand."
        )
    return parts


def _cell(rows: Sequence[Row], way: str) -> str:
    """Return the time of a method at one size."""
    for row in rows:
        if row.get("way") == way:
            return (
                f"({time_text(row['value'])})"
                if row.get("left_out")
                else time_text(row["median_s"])
            )
    return ""


def _choice(rows: Sequence[Row]) -> str:
    """Return the chosen engine, with its slowdown if it is not the fastest."""
    for row in rows:
        if "chosen" in row:
            regret = row["taken"][row["chosen"]] / min(row["taken"].values())
            return row["chosen"] if regret == 1.0 else f"{row['chosen']}, {regret:.2f} x the other"
    return ""


def _table(head: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *body]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _unique(values: Any) -> list[Any]:
    """Return the unique values in order."""
    return list(dict.fromkeys(values))


# ---- the plot ------------------------------------------------------------------------------------


def draw(rows: Sequence[Row]) -> bytes:
    """Return the plot as a PNG file."""
    points = [row for row in rows if "sweep" in row and "way" in row]
    sweeps = list(dict.fromkeys(row["sweep"] for row in points))
    figure = Figure(figsize=(13.0, 4.6 * -(-len(sweeps) // 2)), layout="constrained")
    panels = figure.subplots(-(-len(sweeps) // 2), 2, squeeze=False).ravel()
    for panel, sweep in zip(panels, sweeps, strict=False):
        _draw_panel(panel, sweep, [row for row in points if row["sweep"] == sweep])
    for panel in panels[len(sweeps) :]:
        panel.remove()
    out = io.BytesIO()
    figure.savefig(out, dpi=130, format="png")
    return out.getvalue()


def _draw_panel(panel: Any, sweep: str, rows: Sequence[Row]) -> None:
    """Draw one sweep with a line for each method."""
    x = "size" if len({row["size"] for row in rows}) > 1 else "across"
    dim = rows[0]["dim"]
    for way, style in STYLES.items():
        line = sorted(_place(row, x) for row in rows if row["way"] == way)
        if line:
            sampled = any("extrapolated_from" in row for row in rows if row["way"] == way)
            name = f"{way} (extrapolated)" if sampled else way
            _draw_line(panel, line, {"linewidth": 1.3, "markersize": 5.0, "label": name, **style})
    places, seconds, _ = zip(*(_place(row, x) for row in rows if row["way"] == CHOSEN), strict=True)
    ring: dict[str, Any] = {"marker": "o", "markersize": 12.0, "fillstyle": "none", "color": GREY}
    panel.plot(places, seconds, linestyle="none", label=CHOSEN, **ring)
    panel.set(xscale="log", yscale="log", ylabel="seconds")
    ticks = sorted({row[x] for row in rows})
    panel.set_xticks(ticks, [str(tick) for tick in ticks])
    panel.set_xticks([], minor=True)
    panel.grid(alpha=0.25, which="major")
    panel.spines[["top", "right"]].set_visible(False)
    shape = "disc" if dim == 2 else "ball"
    other = rows[0]["across"] if x == "size" else " x ".join([str(rows[0]["size"])] * dim)
    if x == "size":
        panel.set(
            title=f"{sweep}: {shape} {other} cells across",
            xlabel="cells along each side of the map",
        )
    else:
        panel.set(title=f"{sweep}: {other} cells", xlabel=f"cells across the {shape}")
    panel.title.set_size(11)
    expected = (
        "dashed, hollow: not run, expected" if any(row.get("left_out") for row in rows) else None
    )
    panel.legend(
        loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=9, frameon=False, title=expected
    )


def _place(row: Row, x: str) -> tuple[float, float, bool]:
    """Return the position of a row in a panel, and True if it was run."""
    run = "median_s" in row
    return row[x], row["median_s"] if run else row["value"], run


def _draw_line(
    panel: Any, line: Sequence[tuple[float, float, bool]], style: Mapping[str, Any]
) -> None:
    """Draw a line, dashed with hollow marks for estimates."""
    run = [point for point in line if point[2]]
    panel.plot([x for x, _, _ in run], [y for _, y, _ in run], **style)
    rest = [point for point in line if not point[2]]
    if rest:
        faint = {**style, "linestyle": "--", "linewidth": 0.8, "alpha": 0.7, "label": None}
        whole = [*run[-1:], *rest]
        panel.plot([x for x, _, _ in whole], [y for _, y, _ in whole], **faint, fillstyle="none")
