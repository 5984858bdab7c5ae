"""Robot rasters: what they cost as the robot grows, and whether they are the sets that they should be."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.timing import interleave
from cspace import Robot
from cspace.raster.raster import Raster

Bools = NDArray[np.bool_]

ACROSS = (65, 125, 250, 500)
NEAR = 1e-7
"""Cells within which a raster may decide either way, to be safe against rounding."""


def run(report: Report, seed: int) -> None:
    """A star of 400 corners with a hole, from 65 to 500 cells across; then small ones against shapely."""
    rng = np.random.default_rng(seed)
    star = _star(200, rng)
    report.section(f"polygon of {len(star.outlines[0])} corners with a hole, outer and inner raster")
    calls = {f"{across} cells across": partial(star.rasters, 1.0 / across) for across in ACROSS}
    calls["500 cells across, margin 10 cells"] = partial(star.rasters, 1.0 / 500, 10.0 / 500)
    calls["disc 500 cells across"] = partial(Robot.disc(0.5).rasters, 1.0 / 500)
    timings = interleave(calls, 3 if report.quick else 11)
    for name, timing in timings.items():
        outer, inner = timing.value
        report.timing(name, timing, outer_cells=outer.count, inner_cells=inner.count)
    report.figure("500 cells across", timings["500 cells across"].median, "s", most=1.0)
    slope = np.polyfit(np.log(ACROSS), np.log([timings[f"{n} cells across"].median for n in ACROSS]), 1)[0]
    report.figure("cost grows as cells across to the power (2 would be the area)", float(slope), "", most=2.0)

    report.section("small robots against shapely, offset by offset")
    for name, robot in (
        ("star with a hole", _star(12, rng)),
        ("rectangle on the lattice", Robot.rectangle(0.5, 0.3)),
        ("triangle", Robot.polygon(rng.uniform(-0.5, 0.5, (3, 2)))),
        ("bitmap", Robot.cells(rng.random((7, 5)) < 0.6, 0.07, (-0.2, -0.1))),
    ):
        for margin in (0.0, 0.11):
            _compare(report, f"{name}, margin {margin:g} m", robot, 1 / 24, margin)
    for margin in (0.0, 0.11):
        _compare_discs(report, rng.uniform(-0.5, 0.5, (4, 2)), rng.uniform(0.05, 0.3, 4), 1 / 24, margin)


def _star(points: int, rng: np.random.Generator) -> Robot:
    """A star 1 m across, around a hole."""
    import shapely

    turns = np.linspace(0, 2 * np.pi, 2 * points, endpoint=False)
    reach = np.where(np.arange(2 * points) % 2, rng.uniform(0.3, 0.4, 2 * points), 0.5)
    hole = 0.15 * np.column_stack([np.cos(turns), np.sin(turns)])
    return Robot.polygon(shapely.Polygon(reach[:, None] * np.column_stack([np.cos(turns), np.sin(turns)]), [hole]))


def _compare(report: Report, name: str, robot: Robot, spacing: float, margin: float) -> None:
    """Both rasters against shapely's distances; offsets within ``NEAR`` of the decision may be either way."""
    import shapely

    outer, inner = robot.rasters(spacing, margin)
    shape = robot.geometry
    lattice = _lattice(outer)
    boxes = shapely.box(*((lattice - 1.0) * spacing).T, *((lattice + 1.0) * spacing).T)
    apart = shapely.distance(boxes, shape) - margin
    points = shapely.points(lattice * spacing)
    deep = np.where(shapely.intersects(shape, points), 1.0, -1.0) * shapely.distance(shape.boundary, points)
    _judge(report, name, spacing, _members(outer, lattice), _members(inner, lattice), apart, deep)


def _compare_discs(
    report: Report, centers: NDArray[np.float64], radii: NDArray[np.float64], spacing: float, margin: float
) -> None:
    """The same for discs, by distances to their exact middles."""
    outer, inner = Robot.balls(centers, radii).rasters(spacing, margin)
    lattice = _lattice(outer)
    beyond = np.maximum(np.abs(lattice[:, None] * spacing - centers) - spacing, 0.0)
    apart = (np.hypot(*np.moveaxis(beyond, -1, 0)) - radii).min(axis=1) - margin
    deep = (radii - np.hypot(*np.moveaxis(lattice[:, None] * spacing - centers, -1, 0))).max(axis=1)
    name = f"{len(radii)} discs, margin {margin:g} m"
    _judge(report, name, spacing, _members(outer, lattice), _members(inner, lattice), apart, deep)


def _judge(
    report: Report,
    name: str,
    spacing: float,
    outer: Bools,
    inner: Bools,
    apart: NDArray[np.float64],
    deep: NDArray[np.float64],
) -> None:
    """``apart`` is the distance of the grown robot from each box, ``deep`` how deep each point lies in the robot."""
    near = NEAR * spacing
    holds = (outer[apart <= 0.0]).all() and not (outer & (apart > near)).any()
    report.check(bool(holds), f"{name}: outer raster, {outer.sum()} offsets")
    holds = not (inner & (deep < 0.0)).any() and bool(inner[deep > near].all())
    report.check(bool(holds), f"{name}: inner raster, {inner.sum()} offsets")


def _lattice(outer: Raster) -> NDArray[np.int64]:
    """All offsets in the raster's box and three cells around it, shape (n, 2)."""
    axes = [np.arange(low - 3, high + 4) for low, high in zip(outer.lower, outer.upper, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)


def _members(raster: Raster, lattice: NDArray[np.int64]) -> Bools:
    """Whether offsets belong to a raster."""
    if not raster.count:
        return np.zeros(len(lattice), dtype=np.bool_)
    places = lattice - raster.lower
    inside = np.asarray(((places >= 0) & (places < raster.cells.shape)).all(axis=1))
    return np.asarray(inside & raster.cells[tuple(np.where(inside[:, None], places, 0).T)])
