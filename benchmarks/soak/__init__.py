"""Every answer that is called a proof, against exact geometry, a million times.

Each run draws new cases; ``--seed`` repeats the cases of an earlier run. ``docs/install.md``, under "Tests", says how a
case that fails becomes a test.
"""

from __future__ import annotations

from functools import partial

from benchmarks.report import Report
from benchmarks.soak import arms, band, curves, exact, examples, files, frequency, maps, use
from benchmarks.soak.plane_cases import draw_case
from benchmarks.soak.space_cases import draw_solid_case

EDGES = 10_000

PLACEMENTS = 100_000
"""Placements of pairs for which frequencies tell whether they collide, in the plane and in space each."""


def run(report: Report, seed: int, checks: int | None = None) -> None:
    """Check random maps of each space until enough answers were checked; then all the rest."""
    report.note(f"--seed {seed} draws the same cases again")
    wanted = checks if checks is not None else 50_000 if report.quick else 1_000_000
    edges = min(EDGES, max(100, wanted // 100))
    maps.check(report, "robots in the plane", draw_case, seed, wanted, edges)
    maps.check(report, "robots that turn", partial(draw_case, turning=True), seed, wanted, edges)
    if report.has("fcl", "robots in space skipped"):
        maps.check(report, "robots in space", draw_solid_case, seed, wanted, edges)
        # Each turned robot is a shape of its own for the oracle, which is slow.
        yawing = partial(draw_solid_case, turning=True)
        maps.check(report, "robots that turn in space", yawing, seed, wanted // 10, edges // 10)
        freely = partial(draw_solid_case, freely=True)
        maps.check(report, "robots that turn freely in space", freely, seed, wanted // 10, edges // 10)
    few = edges // 5 if report.quick else edges
    curves.check(report, seed, few)
    exact.check(report, seed, few)
    arms.check(report, seed, max(1000, wanted // 10), few)
    frequency.check(report, seed, PLACEMENTS // 50 if report.quick else PLACEMENTS)
    band.measure(report, seed, 20 if report.quick else 200)
    files.check(report, seed, 100 if report.quick else files.MUTANTS)
    if not report.quick:
        examples.check(report, seed)
    use.check(report, seed, *((5, 0.05) if report.quick else ()))
