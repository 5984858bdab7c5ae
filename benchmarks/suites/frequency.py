"""Spectra, Minkowski sums, overlaps and early misses, against direct methods."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.timing import interleave, once
from cspace import Grid
from cspace.arrays import Bools, Floats, Ints
from cspace.spectral import (
    BallDescriptor,
    Bump,
    Descriptor,
    Verdict,
    ball_spectrum,
    indicator,
    minkowski_sum,
    superlevel,
)
from tests.soak.frequency import POOL, Body, compute_overlap, draw_pool_body, draw_rotation_matrix, oracle

Complexes = NDArray[np.complex128]

BALL_COUNT = 10_000
FREQUENCIES_PER_AXIS = {2: 256, 3: 128}
"""Frequencies along each axis, by dimension."""

PERIOD_IN_SIDES = 1.2
"""Period over the side of the square or cube that contains the centers."""

BALL_RADII = (0.01, 0.04)
TOLERANCE = 1e-9
MIN_SPECTRUM_RATIO = 50.0

MAX_DIRECT_PAIRS = 2**30
"""Maximum number of pairs of a ball and a frequency in a direct sum."""

TABLE_STEP = 2.0**-10
"""Step of the table of a bump's spectrum; cubic interpolation errs by less than 1e-10 of F(0)."""

DESCRIPTOR_CELLS = 1024
KERNEL_CELLS = (9, 33)
"""Cells along each side of the smaller descriptors of Minkowski sums."""

MIN_MINKOWSKI_RATIO = 100.0

PLACEMENT_COUNT = 100_000
MIN_VALUES_RATIO = 20.0
SINGLE_PLACEMENTS = {2: 20_000, 3: 200}
"""Placements evaluated one by one, by dimension."""

SCENE_COUNT = {2: 10, 3: 3}
"""Random scenes with nine of ten placements clear, by dimension."""

SCENE_PLACEMENTS = 2000
PLACEMENT_SIDES = {2: 12.0, 3: 7.0}
"""Side of the square or cube of the placements, in sizes of the bodies."""

GROWTH_FACTORS = (1.0, 2.0)
"""Growth of balls, over the smaller median radius of the two bodies."""

MAX_FREQUENCY_SHARE = 0.05
"""Target: share of the frequencies used for a miss."""


def run(report: Report, seed: int) -> None:
    """Compare Minkowski sums, spectra, values at placements, and early misses."""
    rng = np.random.default_rng(seed)
    for name, make in (("indicators", _flags), ("bumps of balls", _bumps)):
        _minkowski(report, name, make, rng)
    for dim in (2, 3):
        _spectra(report, dim, rng)
        _values(report, seed, dim, rng)
        _misses(report, seed, dim)


# ---- spectra ---------------------------------------------------------------------------------------------------------


@njit(cache=True, parallel=True)
def _direct(
    centers: Floats, starts: Ints, radii: Floats, weights: Floats, table: Floats, frequencies: Floats
) -> Complexes:
    """Sum term by term on all cores, with one factor for each radius of sorted balls."""
    out = np.zeros(len(frequencies), np.complex128)
    for n in prange(len(frequencies)):
        u, v, w = frequencies[n]
        modulus = math.sqrt(u * u + v * v + w * w)
        for part in range(len(radii)):
            real, imag = 0.0, 0.0
            for ball in range(starts[part], starts[part + 1]):
                angle = 2.0 * math.pi * (u * centers[ball, 0] + v * centers[ball, 1] + w * centers[ball, 2])
                real += math.cos(angle)
                imag -= math.sin(angle)
            at = radii[part] * modulus / TABLE_STEP
            cell = int(at)
            x = at - cell
            near = (table[cell + 1] * (1.0 - x) + table[cell + 2] * x) * (1.0 + x) * (2.0 - x) / 2.0
            far = (table[cell] * (2.0 - x) + table[cell + 3] * (1.0 + x)) * x * (1.0 - x) / 6.0
            out[n] += weights[part] * (near - far) * complex(real, imag)
    return out


def _direct_sum(centers: Floats, radii: Floats, count: int) -> Callable[[Ints], Complexes]:
    """Return a function that sums over all balls at lattice indices."""
    dim = centers.shape[1]
    order = np.argsort(radii, kind="stable")
    sizes, starts = np.unique(radii[order], return_index=True)
    waves = np.fft.fftfreq(count, 1.0 / count) / PERIOD_IN_SIDES
    nodes = TABLE_STEP * np.abs(
        np.arange(-1.0, float(sizes[-1]) * math.sqrt(dim) * (count // 2) / PERIOD_IN_SIDES / TABLE_STEP + 4.0)
    )
    table = Bump(2.0).table(dim, float(nodes.max()), 1e-13)(nodes)
    balls = np.pad(centers[order], ((0, 0), (0, 3 - dim))), np.append(starts, len(order)), sizes, sizes**dim, table

    def at(places: Ints) -> Complexes:
        indices = np.stack(np.unravel_index(places, (count,) * dim), axis=1)
        return np.asarray(_direct(*balls, np.pad(waves[indices], ((0, 0), (0, 3 - dim)))))

    at(np.zeros(1, np.int64))  # compiles it
    return at


def _spectra(report: Report, dim: int, rng: np.random.Generator) -> None:
    """Compare spectra of balls with one, several, and all different radii."""
    number = BALL_COUNT // 10 if report.quick else BALL_COUNT
    count = FREQUENCIES_PER_AXIS[dim] // (4 if report.quick else 1)
    centers = rng.uniform(0.0, 1.0, (number, dim))
    several = np.linspace(*BALL_RADII, 8)
    for name, radii in (
        ("one radius", np.full(number, several[3])),
        ("8 radii", rng.choice(several, number)),
        ("all radii different", rng.uniform(*BALL_RADII, number)),
    ):
        report.section(f"{number} balls, {name}, {' x '.join([str(count)] * dim)} frequencies, {Bump(2.0)}")
        call = partial(ball_spectrum, centers, radii, Bump(2.0), PERIOD_IN_SIDES, count, TOLERANCE)
        ours = interleave({"ours": call}, 3 if report.quick else 5)["ours"]
        report.timing(f"ours, tolerance {TOLERANCE:g}", ours)
        whole = count**dim
        asked = min(whole, max(1, MAX_DIRECT_PAIRS // number))
        places = np.arange(whole) if asked == whole else rng.choice(whole, asked, replace=False)
        direct = once(partial(_direct_sum(centers, radii, count), places)).per(asked / whole)
        report.timing(f"direct sum, extrapolated from 1 / {whole / asked:.4g}", direct)
        report.ratio("direct sum / ours", direct, ours, least=MIN_SPECTRUM_RATIO)
        off = float(np.abs(direct.value - ours.value.ravel()[places]).max()) / float(ours.value.flat[0].real)
        report.check(off <= TOLERANCE, f"direct sum: within {off:.1g} of F(0)")


# ---- Minkowski sums --------------------------------------------------------------------------------------------------


@njit(cache=True, parallel=True)
def _convolution(f: Floats, g: Floats) -> Floats:
    """Convolve two arrays of the plane, product by product."""
    out = np.zeros((f.shape[0] + g.shape[0] - 1, f.shape[1] + g.shape[1] - 1))
    for row in prange(len(out)):
        for i in range(max(0, row - len(f) + 1), min(len(g), row + 1)):
            for j in range(g.shape[1]):
                times = g[i, j]
                for k in range(f.shape[1]):
                    out[row, j + k] += times * f[row - i, k]
    return out


def _flags(cells: int, rng: np.random.Generator) -> Descriptor:
    return indicator(rng.random((cells, cells)) < 0.06, Grid((0.0, 0.0), 1.0, (cells, cells)))


def _bumps(cells: int, rng: np.random.Generator) -> Descriptor:
    number = max(1, cells // 8)
    centers, radii = rng.uniform(0.2, 0.8, (number, 2)) * cells, rng.uniform(0.02, 0.2, number) * cells
    return BallDescriptor(centers, radii, Bump(2.0)).sample(Grid((0.0, 0.0), 1.0, (cells, cells)))


def _minkowski(report: Report, name: str, make: Callable[..., Descriptor], rng: np.random.Generator) -> None:
    """Compare sums by FFT with direct sums, extrapolated for equal sizes."""
    cells = DESCRIPTOR_CELLS // 4 if report.quick else DESCRIPTOR_CELLS
    f = make(cells, rng)
    _convolution(f.values[:2], f.values[:2])  # compiles it
    for across in KERNEL_CELLS:
        g = make(across, rng)
        report.section(f"Minkowski sum of {name}: {cells} x {cells} and {across} x {across} cells")
        fft = interleave({"": partial(minkowski_sum, f, g, "fft")}, 3)[""]
        report.timing("ours, fft", fft)
        direct = {
            "ours, direct": once(partial(minkowski_sum, f, g, "direct")),
            "compiled sums": once(partial(_convolution, f.values, g.values)),
        }
        for call, timing in direct.items():
            report.timing(call, timing)
            report.ratio(f"{call} / ours, fft", timing, fft)
        sums = direct["ours, direct"].value, direct["compiled sums"].value
        largest = float(sums[1].max())
        off = max(float(np.abs(fft.value.values - each).max()) for each in (sums[0].values, sums[1]))
        report.check(off <= 1e-12 * largest, f"all sums: equal within {off / largest:.1g} of the largest")
        # Products of tiny values near the boundary of a bump may underflow; products of booleans do not.
        shape = _convolution(superlevel(f).astype(np.float64), superlevel(g).astype(np.float64)) > 0.5
        same = all(bool((superlevel(each) == shape).all()) for each in (fft.value, sums[0]))
        report.check(same, "fft and direct: above zero just where some product is")
    g = make(cells, rng)
    report.section(f"Minkowski sum of {name}: {cells} x {cells} cells both")
    fft = interleave({"": partial(minkowski_sum, f, g, "fft")}, 3)[""]
    report.timing("ours, fft", fft)
    for call, timing in direct.items():
        more = timing.per((across / cells) ** 2)
        report.timing(f"{call}, extrapolated from {across} x {across} cells", more)
        report.ratio(f"{call} / ours, fft", more, fft, least=MIN_MINKOWSKI_RATIO)


# ---- overlaps --------------------------------------------------------------------------------------------------------


def _values(report: Report, seed: int, dim: int, rng: np.random.Generator) -> None:
    """Compare overlaps and gradients in a batch with single calls."""
    tolerance = 0.1 if report.quick else 1e-3
    overlap = compute_overlap(
        draw_pool_body(seed, 0, dim), [draw_pool_body(seed, 1, dim)], 0.5, 8, Bump(2.0), tolerance, inner=False
    )
    number = PLACEMENT_COUNT // 10 if report.quick else PLACEMENT_COUNT
    single = min(number, SINGLE_PLACEMENTS[dim] // 20 if report.quick else SINGLE_PLACEMENTS[dim])
    where = "in the plane" if dim == 2 else "in space"
    report.section(f"{number} placements {where}, {overlap.frequencies} frequencies (opposite ones counted once)")
    ts = rng.uniform(*overlap.domain, (number, dim))
    for name, one, least in (
        ("value", overlap.value, MIN_VALUES_RATIO),
        ("gradient", overlap.gradient, None),
    ):
        together = interleave({name: partial(one, ts)}, 3)[name]
        one(ts[0])  # compiles it
        alone = once(lambda one=one: np.array([one(t) for t in ts[:single]])).per(single / number)
        report.timing(f"{name}(ts)", together)
        report.timing(f"{name}(t), one by one, extrapolated from {single}", alone)
        report.ratio(f"{name}(t), one by one / {name}(ts)", alone, together, least=least)
        largest = float(np.abs(together.value).max())
        off = float(np.abs(together.value[:single] - alone.value).max())
        report.check(off <= 1e-8 * largest, f"{name}(ts): within {off / largest:.1g} of one by one, of the largest")


def _misses(report: Report, seed: int, dim: int) -> None:
    """Measure the frequencies that a miss needs, with and without swollen balls."""
    numbers = range(1 if report.quick else SCENE_COUNT[dim])
    scenes = [_scene(seed, dim, np.random.default_rng([seed, number, 50 + dim])) for number in numbers]
    for share in GROWTH_FACTORS[-1:] if report.quick else GROWTH_FACTORS:
        parts: dict[bool, list[Floats]] = {True: [], False: []}
        clear, sizes, wrong = 0, [], 0
        for body, others, ts, meets in scenes:
            overlap = compute_overlap(body, others, share, 8, Bump(2.0), 1e-3, inner=False)
            sizes.append(overlap.frequencies)
            low, high = overlap.domain
            # Beyond this distance the bodies cannot overlap, and no frequency is used.
            inside = ((ts >= low) & (ts <= high)).all(axis=1)
            clear += int((~meets & inside).sum())
            for swelling, shares in parts.items():
                answer = overlap.separated(ts, swelling=swelling)
                missed = answer.verdict == Verdict.MISS
                wrong += int((missed & meets).sum())
                shares.append(answer.frequencies[missed & inside] / overlap.frequencies)
        report.section(
            f"early misses {'in the plane' if dim == 2 else 'in space'}: {len(scenes)} random scenes of "
            f"{SCENE_PLACEMENTS} placements, balls grown by {share:g} of the median radius, {np.median(sizes):.0f} "
            "frequencies"
        )
        report.check(not wrong, f"{wrong} misses collide")
        for swelling, name in ((True, "swollen balls first"), (False, "frequencies alone")):
            every = np.concatenate(parts[swelling])
            report.figure(f"{name}: clear placements told", 100.0 * len(every) / clear, "%")
            report.figure(
                "    median part of the frequencies",
                100.0 * float(np.median(every)),
                "%",
                most=100.0 * MAX_FREQUENCY_SHARE,
            )
            report.figure("    mean", 100.0 * float(every.mean()), "%")


def _scene(seed: int, dim: int, rng: np.random.Generator) -> tuple[Body, list[Body], Floats, Bools]:
    """Draw a body, obstacles at 10 % of the placements, placements, and collisions."""
    body = draw_pool_body(seed, int(rng.integers(POOL)), dim).place(1.0, draw_rotation_matrix(rng, dim), np.zeros(dim))
    ts = rng.uniform(0.0, PLACEMENT_SIDES[dim], (SCENE_PLACEMENTS, dim))
    others: list[Body] = []
    meets = np.zeros(len(ts), dtype=np.bool_)
    while meets.mean() < 0.1:
        another = draw_pool_body(seed, int(rng.integers(POOL)), dim)
        away = float(rng.uniform(0.5, 1.2)), draw_rotation_matrix(rng, dim), rng.uniform(0.0, PLACEMENT_SIDES[dim], dim)
        others.append(another.place(*away))
        meets |= oracle(body, others[-1:], np.eye(dim))(ts)
    return body, others, ts, meets
