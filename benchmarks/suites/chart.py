"""The plot of a run against peers: cost over the size of the map and of the robot."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

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

GAP = 0.052
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
    """One sweep: a line for each way, named where it ends."""
    x = "size" if len({row["size"] for row in rows}) > 1 else "across"
    dim = rows[0]["dim"]
    last_points: list[tuple[float, float, str, str]] = []
    for way, style in STYLES.items():
        line = sorted(_place(row, x) for row in rows if row["way"] == way)
        if line:
            sampled = any("extrapolated_from" in row for row in rows if row["way"] == way)
            _draw(panel, line, {"linewidth": 1.3, "markersize": 5.0, **style})
            last_points.append((*line[-1][:2], f"{way} (extrapolated)" if sampled else way, style["color"]))
    places, seconds, _ = zip(*(_place(row, x) for row in rows if row["way"] == CHOSEN), strict=True)
    panel.plot(places, seconds, linestyle="none", marker="o", markersize=12.0, fillstyle="none", color=GREY)
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
    note = f"rings: {CHOSEN}"
    if any(row.get("left_out") for row in rows):
        note += "\ndashed, hollow: not run, expected"
    panel.text(0.02, 0.98, note, transform=panel.transAxes, va="top", fontsize=9, color=GREY)
    _label(panel, last_points)


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
        faint = {**style, "linestyle": "--", "linewidth": 0.8, "alpha": 0.7}
        whole = [*run[-1:], *rest]
        panel.plot([x for x, _, _ in whole], [y for _, y, _ in whole], **faint, fillstyle="none")


def _label(panel: Any, last_points: Sequence[tuple[float, float, str, str]]) -> None:
    """Names beside the ends of lines, moved apart where they would overlap."""
    low, high = np.log10(panel.get_ylim())
    heights = [(float(np.log10(seconds)) - low) / (high - low) for _, seconds, _, _ in last_points]
    for index, height in zip(np.argsort(heights), _apart(sorted(heights)), strict=True):
        place, seconds, name, color = last_points[index]
        panel.annotate(
            name,
            (place, seconds),
            xytext=(1.04, height),
            textcoords="axes fraction",
            va="center",
            fontsize=9,
            color=color,
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.6, "alpha": 0.6},
        )


def _apart(heights: Sequence[float]) -> list[float]:
    """Ascending heights, moved as little as need be to keep their distance."""
    groups = [[height, 1.0] for height in heights]
    merged: list[list[float]] = []
    for middle, number in groups:
        merged.append([middle, number])
        while len(merged) > 1 and merged[-1][0] - merged[-2][0] < GAP * (merged[-1][1] + merged[-2][1]) / 2.0:
            (b, n), (a, m) = merged.pop(), merged.pop()
            merged.append([(a * m + b * n) / (m + n), m + n])
    return [middle + GAP * (k - (number - 1.0) / 2.0) for middle, number in merged for k in range(int(number))]
