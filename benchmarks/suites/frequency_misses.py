"""How many frequencies an early miss takes, over random scenes in which nine of ten placements are clear."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.soak.space_pairs import NO_FCL
from benchmarks.suites.frequency_cases import (
    POOL,
    Body,
    Oracle,
    flat_oracle,
    overlap_of,
    pool_body,
    random_turn,
    solid_oracle,
)
from cspace.spectral import Bump, Verdict

Floats = NDArray[np.float64]
Scene = tuple[Body, list[Body], Floats, NDArray[np.bool_]]

SCENES = {2: 10, 3: 3}
PLACEMENTS = 2000
CLEAR = 0.9
ROOM = {2: 12.0, 3: 7.0}
"""Side of the square or cube of the placements, in sizes of the bodies."""

SHARES = (1.0, 2.0)
"""What balls grow by, in the smaller median radius of the two."""

MOST = 0.05
"""Part of the frequencies."""


def measure(report: Report, seed: int, dim: int) -> None:
    """Medians over the misses of all scenes, by each swell; swollen balls first, and by frequencies alone."""
    if dim == 3:
        try:
            import fcl  # noqa: F401 - whether it is there at all
        except ImportError:
            report.note(f"early misses in space skipped: {NO_FCL}")
            return
    numbers = range(1 if report.quick else SCENES[dim])
    scenes = [_scene(seed, dim, np.random.default_rng([seed, number, 50 + dim])) for number in numbers]
    for share in SHARES[-1:] if report.quick else SHARES:
        _measure(report, scenes, share, "in the plane" if dim == 2 else "in space")


def _measure(report: Report, scenes: list[Scene], share: float, where: str) -> None:
    began = time.perf_counter()
    parts: dict[bool, list[Floats]] = {True: [], False: []}
    clear, sizes, wrong = [], [], 0
    for body, others, ts, meets in scenes:
        overlap = overlap_of(body, others, share, 8, Bump(2.0), 1e-3, inner=False)
        sizes.append(overlap.frequencies)
        low, high = overlap.domain
        # Beyond, nothing is near anything, and no frequency is asked.
        inside = ((ts >= low) & (ts <= high)).all(axis=1)
        clear.append(~meets & inside)
        for swelling, found in parts.items():
            verdicts, counts = overlap.verdicts(ts, swelling=swelling)
            missed = verdicts == Verdict.MISS
            wrong += int((missed & meets).sum())
            found.append(counts[missed & inside] / overlap.frequencies)
    share_clear = np.mean([1.0 - meets.mean() for _, _, _, meets in scenes])
    report.section(
        f"early misses {where}: {len(scenes)} random scenes, {share_clear:.0%} of {PLACEMENTS} placements clear, balls "
        f"grown by {share:g} of the median radius, {np.median(sizes):.0f} frequencies, "
        f"{time.perf_counter() - began:.0f} s"
    )
    report.check(not wrong, f"{wrong} misses collide")
    several = int(np.sum(clear))
    for swelling, name in ((True, "swollen balls first"), (False, "frequencies alone")):
        every = np.concatenate(parts[swelling])
        report.figure(f"{name}: clear placements told", 100.0 * len(every) / several, "%")
        report.figure("    median part of the frequencies", 100.0 * float(np.median(every)), "%", most=100.0 * MOST)
        report.figure("    mean", 100.0 * float(every.mean()), "%")


def _scene(seed: int, dim: int, rng: np.random.Generator) -> Scene:
    """A body, others among which nine of ten placements are clear, placements, and which of them collide."""
    body = pool_body(seed, int(rng.integers(POOL)), dim).placed(1.0, random_turn(rng, dim), np.zeros(dim))
    ts = rng.uniform(0.0, ROOM[dim], (PLACEMENTS, dim))
    others: list[Body] = []
    meets = np.zeros(PLACEMENTS, dtype=np.bool_)
    while meets.mean() < 1.0 - CLEAR:
        another = pool_body(seed, int(rng.integers(POOL)), dim).placed(
            float(rng.uniform(0.5, 1.2)), random_turn(rng, dim), rng.uniform(0.0, ROOM[dim], dim)
        )
        others.append(another)
        meets |= _oracle(body, another)(ts)
    return body, others, ts, meets


def _oracle(body: Body, other: Body) -> Oracle:
    if body.outer[0].shape[1] == 2:
        return flat_oracle(body, [other], 0.0)
    return solid_oracle(body, [other], np.eye(3))
