"""The proofs from frequencies that shapes are apart or collide, against exact geometry; part of the soak."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.soak.frequency_cases import Oracle, PairCase, Rng, draw_pair
from benchmarks.soak.tally import Tally
from cspace.arrays import Bools, Floats
from cspace.spectral import FourierOverlap, Verdict

POSES = 4
"""Rotations of each pair."""

PLACEMENTS = 500
"""Placements of each rotation; a third of them around contact."""

STEPS = 45
"""Halvings until a contact is found."""

NEAR = (-11.0, -0.7)
"""Powers of ten, in sizes of the domain, by which placements lie off a contact."""

WITHOUT = 20
"""Every so many placements, frequencies alone are asked, without swollen balls."""


def check(report: Report, seed: int, wanted: int) -> None:
    """Random pairs, in the plane and in space, until enough placements were checked."""
    if not report.has("finufft", "verdicts from frequencies skipped"):
        return
    for dim, where in ((2, "in the plane"), (3, "in space")):
        if dim == 3 and not report.has("fcl", "verdicts from frequencies in space skipped"):
            continue
        tally, began, number = Tally(), time.perf_counter(), 0
        while sum(tally.verdicts.values()) < wanted:
            case = draw_pair(seed, number, dim)
            rng = np.random.default_rng([seed, number, 40 + dim])
            for _ in range(POSES):
                _check_pose(tally, case, rng)
            number += 1
        report.section(
            f"verdicts from frequencies {where}: {number} random pairs, {POSES} rotations each, "
            f"{sum(tally.verdicts.values())} placements, seed {seed}, {time.perf_counter() - began:.0f} s"
        )
        tally.tell(report)


def _check_pose(tally: Tally, case: PairCase, rng: Rng) -> None:
    """No MISS where the shapes meet, and no HIT where they do not."""
    rotation, overlap, collide = case.turned(rng)
    low, high = overlap.domain
    ts = rng.uniform(low, high, (PLACEMENTS, case.overlap.dim))
    ts[:: PLACEMENTS // 10] += rng.choice([-1.0, 1.0]) * (high - low)
    contacts = _contacts(overlap, collide, ts, rng)
    ts[len(ts) - len(contacts) :] = contacts
    meets = collide(ts)
    _judge(tally, case, rotation, ts, meets, overlap.separated(ts).verdict)
    part = slice(None, None, WITHOUT)
    _judge(tally, case, rotation, ts[part], meets[part], overlap.separated(ts[part], swelling=False).verdict)


def _judge(
    tally: Tally, case: PairCase, rotation: Floats, ts: Floats, meets: Bools, verdicts: NDArray[np.uint8]
) -> None:
    q = np.column_stack([ts, np.broadcast_to(rotation, (len(ts), len(rotation)))])
    for verdict, wrong in ((Verdict.MISS, meets), (Verdict.HIT, ~meets)):
        said = verdicts == verdict
        tally.add(verdict.name, case, q[said], wrong[said], np.zeros(int(said.sum()), dtype=np.bool_))
    for verdict in Verdict:
        said = verdicts == verdict
        tally.verdicts["colliding", verdict.name] += int((said & meets).sum())
        tally.verdicts["clear", verdict.name] += int((said & ~meets).sum())


def _contacts(overlap: FourierOverlap, collide: Oracle, ts: Floats, rng: Rng) -> Floats:
    """Placements around where shapes begin to touch, on straight ways from collisions outwards; a third of ``ts``."""
    touching = ts[collide(ts)]
    if not len(touching):
        return ts[:0]
    low, high = overlap.domain
    size = float(np.linalg.norm(high - low))
    number = len(ts) // 3
    starts = touching[rng.integers(len(touching), size=number // 5)]
    directions = rng.normal(size=starts.shape)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    near, far = np.zeros(len(starts)), np.full(len(starts), 2.0 * size)
    for _ in range(STEPS):
        middle = 0.5 * (near + far)
        meets = collide(starts + middle[:, None] * directions)
        near, far = np.where(meets, middle, near), np.where(meets, far, middle)
    picked = rng.integers(len(starts), size=number)
    off = size * rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(*NEAR, number)
    return np.asarray(starts[picked] + (far[picked] + off)[:, None] * directions[picked])
