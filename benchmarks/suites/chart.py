"""The plot of a run against peers: cost over the size of the map and of the robot."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.suites.outer_maps import named

Row = Mapping[str, Any]

# Colours that are told apart by those who see few (Okabe and Ito, 2008), each with a marker of its own.
STYLES: dict[str, dict[str, Any]] = {
    named("fft"): {"color": "#0072B2", "marker": "o", "linewidth": 2.6},
    named("direct"): {"color": "#D55E00", "marker": "s", "linewidth": 2.6},
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

CHOSEN = named("auto")
GREY = "#333333"

"""Least distance of labels, as a share of a panel's height."""


def drawn(rows: Sequence[Row]) -> bytes:
    """The plot as a PNG file.

    Parameters
    ----------
    rows : sequence of mapping
        Of a report.

    Returns
    -------
    bytes
    """
    from matplotlib.figure import Figure

    points = [row for row in rows if "sweep" in row and "way" in row]
    sweeps = list(dict.fromkeys(row["sweep"] for row in points))
    figure = Figure(figsize=(13.0, 4.6 * -(-len(sweeps) // 2)), layout="constrained")
    panels = figure.subplots(-(-len(sweeps) // 2), 2, squeeze=False).ravel()
    for panel, sweep in zip(panels, sweeps, strict=False):
        _panel(panel, sweep, [row for row in points if row["sweep"] == sweep])
    for panel in panels[len(sweeps) :]:
        panel.remove()
    out = io.BytesIO()
    figure.savefig(out, dpi=130, format="png")
    return out.getvalue()


def _panel(panel: Any, sweep: str, rows: Sequence[Row]) -> None:
    """One sweep: a line for each way."""
    x = "size" if len({row["size"] for row in rows}) > 1 else "across"
    dim = rows[0]["dim"]
    for way, style in STYLES.items():
        line = sorted(_place(row, x) for row in rows if row["way"] == way)
        if line:
            sampled = any("extrapolated_from" in row for row in rows if row["way"] == way)
            name = f"{way} (extrapolated)" if sampled else way
            _draw(panel, line, {"linewidth": 1.3, "markersize": 5.0, "label": name, **style})
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
        panel.set(title=f"{sweep}: {shape} {other} cells across", xlabel="cells along each side of the map")
    else:
        panel.set(title=f"{sweep}: {other} cells", xlabel=f"cells across the {shape}")
    panel.title.set_size(11)
    expected = "dashed, hollow: not run, expected" if any(row.get("left_out") for row in rows) else None
    panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=9, frameon=False, title=expected)


def _place(row: Row, x: str) -> tuple[float, float, bool]:
    """Where a row lies in a panel, and whether it was run."""
    run = "median_s" in row
    return row[x], row["median_s"] if run else row["value"], run


def _draw(panel: Any, line: Sequence[tuple[float, float, bool]], style: Mapping[str, Any]) -> None:
    """A line, dashed and with hollow marks where it was not run."""
    run = [point for point in line if point[2]]
    panel.plot([x for x, _, _ in run], [y for _, y, _ in run], **style)
    rest = [point for point in line if not point[2]]
    if rest:
        faint = {**style, "linestyle": "--", "linewidth": 0.8, "alpha": 0.7, "label": None}
        whole = [*run[-1:], *rest]
        panel.plot([x for x, _, _ in whole], [y for _, y, _ in whole], **faint, fillstyle="none")
