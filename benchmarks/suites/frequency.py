"""Spectra of balls, Minkowski sums, overlaps at many placements and early misses, each against the direct way."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.soak.frequency import NO_FINUFFT
from benchmarks.suites import frequency_misses
from benchmarks.suites.frequency_cases import overlap_of, pool_body
from benchmarks.suites.frequency_direct import DirectSum, convolution
from benchmarks.timing import Timing, interleave
from cspace import Grid
from cspace.spectral import BallDescriptor, Bump, Descriptor, ball_spectrum, indicator, minkowski_sum, superlevel

Floats = NDArray[np.float64]

BALLS = 10_000
FREQUENCIES = {2: 256, 3: 128}
"""Along each axis."""

LENGTH = 1.2
"""Period, in sides of the square or cube that holds the centers."""

RADII = (0.01, 0.04)
TOLERANCE = 1e-9
LEAST_SPECTRUM = 50.0

PAIRS = 2**30
"""Pairs of a ball and a frequency that the direct sum over all pairs is measured on, at most."""

PLANES = 4
"""Of the frequencies in space, on which the direct sum by products for each axis is measured."""

CELLS = 1024
KERNELS = (9, 33)
"""Cells along each side of the descriptors that are added to one of 1024 x 1024 cells, by each method."""

LEAST_MINKOWSKI = 100.0

PLACEMENTS = 100_000
LEAST_VALUES = 20.0
DIFFERENCES = 100
"""Placements at which gradients are compared with finite differences."""

SINGLE = {2: 20_000, 3: 200}
"""Placements that are asked for one by one."""


def run(report: Report, seed: int) -> None:
    """Minkowski sums; then, where finufft is there, spectra, values at placements, and early misses."""
    rng = np.random.default_rng(seed)
    _minkowski(report, rng)
    try:
        import finufft  # noqa: F401 - whether it is there at all
    except ImportError:
        report.note(f"skipped all but Minkowski sums: {NO_FINUFFT}")
        return
    for dim in (2, 3):
        _spectra(report, dim, rng)
    for dim in (2, 3):
        _values(report, seed, dim, rng)
    for dim in (2, 3):
        frequency_misses.measure(report, seed, dim)


def _once(call: Callable[[], Any]) -> Timing:
    """One timed run of what takes long."""
    began, cpu = time.perf_counter(), time.process_time()
    timing = Timing(call())
    timing.seconds.append(time.perf_counter() - began)
    timing.cpu.append(time.process_time() - cpu)
    return timing


# ---- spectra ---------------------------------------------------------------------------------------------------------


def _spectra(report: Report, dim: int, rng: np.random.Generator) -> None:
    """The spectrum of many balls with one radius, several, and all different ones."""
    number = BALLS // 10 if report.quick else BALLS
    count = FREQUENCIES[dim] // (4 if report.quick else 1)
    centers = rng.uniform(0.0, 1.0, (number, dim))
    some = np.linspace(*RADII, 8)
    for name, radii in (
        ("one radius", np.full(number, some[3])),
        ("8 radii", rng.choice(some, number)),
        ("all radii different", rng.uniform(*RADII, number)),
    ):
        report.section(f"{number} balls, {name}, {' x '.join([str(count)] * dim)} frequencies, {Bump(2.0)}")
        _spectrum(report, centers, radii, count, rng)


def _spectrum(report: Report, centers: Floats, radii: Floats, count: int, rng: np.random.Generator) -> None:
    number, dim = centers.shape
    call = partial(ball_spectrum, centers, radii, Bump(2.0), LENGTH, count, TOLERANCE)
    ours = interleave({"ours": call}, 3 if report.quick else 5)["ours"]
    report.timing(f"ours, tolerance {TOLERANCE:g}", ours)
    direct, whole = DirectSum.of(centers, radii, Bump(2.0), LENGTH, count), count**dim
    largest = float(ours.value.flat[0].real)

    def compare(name: str, peer: Timing, known: NDArray[np.complex128], factor: float, least: float | None) -> None:
        part = "" if factor == 1.0 else f", extrapolated from 1 / {factor:.4g}"
        timing = _times(peer, factor)
        report.timing(f"{name}{part}", timing)
        report.ratio(f"{name} / ours", timing, ours, least=None if report.quick else least)
        off = float(np.abs(peer.value - known).max()) / largest
        report.check(off <= TOLERANCE, f"{name}: within {off:.1g} of F(0)")

    asked = min(whole, max(1, PAIRS // number))
    places = np.arange(whole) if asked == whole else rng.choice(whole, asked, replace=False)
    direct.plain(places[:1])  # compiles it
    plain = _once(partial(direct.plain, places))
    compare("direct, all pairs", plain, ours.value.ravel()[places], whole / asked, LEAST_SPECTRUM)
    if len(direct.radii) == number:
        report.note("no two balls share a radial factor, so that none share products of factors for each axis")
        return
    planes = count if dim == 2 else PLANES
    compare("direct, products", _once(partial(direct.by_products, planes)), ours.value[:planes], count / planes, None)


def _times(timing: Timing, factor: float) -> Timing:
    """The same for more, or fewer, things than were done."""
    return Timing(timing.value, [taken * factor for taken in timing.seconds], [taken * factor for taken in timing.cpu])


# ---- Minkowski sums --------------------------------------------------------------------------------------------------


def _minkowski(report: Report, rng: np.random.Generator) -> None:
    """By FFT and directly: booleans, whose sums are exact, and smooth descriptors."""
    from scipy import signal

    cells = CELLS // 4 if report.quick else CELLS
    for name, make in (("indicators", _flags), ("bumps of balls", _bumps)):
        f = make(cells, rng)
        for across in KERNELS:
            g = make(across, rng)
            report.section(f"Minkowski sum of {name}: {cells} x {cells} and {across} x {across} cells")
            timings = interleave(
                {
                    "ours, fft": partial(minkowski_sum, f, g, "fft"),
                    "scipy.signal.fftconvolve": partial(signal.fftconvolve, f.values, g.values),
                },
                3,
            )
            timings["ours, direct"] = _once(partial(minkowski_sum, f, g, "direct"))
            convolution(f.values[:2], g.values[:2])  # compiles it
            timings["compiled sums"] = _once(partial(convolution, f.values, g.values))
            for call, timing in timings.items():
                report.timing(call, timing)
            fft, direct = timings["ours, fft"], timings["ours, direct"]
            report.ratio("ours, direct / ours, fft", direct, fft)
            report.ratio("compiled sums / ours, fft", timings["compiled sums"], fft)
            _same_sums(report, f, g, fft.value, direct.value, timings["compiled sums"].value)
        _of_two_large(report, name, f, make(cells, rng), timings, KERNELS[-1])


def _of_two_large(
    report: Report, name: str, f: Descriptor, g: Descriptor, known: dict[str, Timing], across: int
) -> None:
    """Both as large, where what the direct sums take is told from the number of their products."""
    cells = f.grid.shape[0]
    report.section(f"Minkowski sum of {name}: {cells} x {cells} cells both")
    fft = interleave({"fft": partial(minkowski_sum, f, g, "fft")}, 3)["fft"]
    report.timing("ours, fft", fft)
    more = (cells / across) ** 2
    for call in ("ours, direct", "compiled sums"):
        told = f"{call}, extrapolated from {across} x {across} cells"
        timing = _times(known[call], more)
        report.timing(told, timing)
        report.ratio(f"{call} / ours, fft", timing, fft, least=None if report.quick else LEAST_MINKOWSKI)


def _same_sums(
    report: Report, f: Descriptor, g: Descriptor, fft: Descriptor, direct: Descriptor, compiled: Floats
) -> None:
    """On a grid whose cells measure one."""
    largest = float(direct.values.max())
    off = max(float(np.abs(fft.values - other).max()) for other in (direct.values, compiled))
    report.check(
        off <= 1e-12 * largest, f"fft, direct and compiled sums: equal within {off / largest:.1g} of the largest"
    )
    # Values near the rim of a bump are so small that products of two may vanish; those of booleans do not.
    shape = convolution(superlevel(f).astype(np.float64), superlevel(g).astype(np.float64)) > 0.5
    same = all(bool((superlevel(each) == shape).all()) for each in (fft, direct))
    report.check(same, "fft and direct: above zero just where some product is")


def _flags(cells: int, rng: np.random.Generator) -> Descriptor:
    return indicator(rng.random((cells, cells)) < 0.06, Grid((0.0, 0.0), 1.0, (cells, cells)))


def _bumps(cells: int, rng: np.random.Generator) -> Descriptor:
    number = max(1, cells // 8)
    balls = BallDescriptor(
        rng.uniform(0.2, 0.8, (number, 2)) * cells, rng.uniform(0.02, 0.2, number) * cells, Bump(2.0)
    )
    return balls.sample(Grid((0.0, 0.0), 1.0, (cells, cells)))


# ---- values at placements --------------------------------------------------------------------------------------------


def _values(report: Report, seed: int, dim: int, rng: np.random.Generator) -> None:
    """Overlaps and gradients at many placements together, against one by one; and against finite differences."""
    body, other = pool_body(seed, 0, dim), pool_body(seed, 1, dim)
    overlap = overlap_of(body, [other], 0.5, 8, Bump(2.0), 0.1 if report.quick else 1e-3, inner=False)
    number = PLACEMENTS // 10 if report.quick else PLACEMENTS
    single = min(number, SINGLE[dim] // 20 if report.quick else SINGLE[dim])
    where = "in the plane" if dim == 2 else "in space"
    report.section(f"{number} placements {where}, {overlap.frequencies} frequencies (opposite ones counted once)")
    ts = rng.uniform(*overlap.domain, (number, dim))
    for name, many, one in (
        ("value", overlap.values, overlap.value),
        ("gradient", overlap.gradients, overlap.gradient),
    ):
        together = interleave({name: partial(many, ts)}, 3)[name]
        one(ts[0])  # compiles it
        alone = _once(partial(_each, one, ts[:single]))
        part = "" if single == number else f", extrapolated from {single}"
        alone = _times(alone, number / single)
        report.timing(f"{name}s(ts)", together)
        report.timing(f"{name}(t), one by one{part}", alone)
        report.ratio(
            f"{name}(t), one by one / {name}s(ts)",
            alone,
            together,
            least=LEAST_VALUES if name == "value" and not report.quick else None,
        )
        largest = float(np.abs(together.value).max())
        off = float(np.abs(together.value[:single] - alone.value).max())
        report.check(off <= 1e-8 * largest, f"{name}s(ts): within {off / largest:.1g} of one by one, of the largest")
    step = 1e-3 * float(other.outer[1].min())
    some, slopes = ts[: min(single, DIFFERENCES)], []
    for h in step * np.eye(dim):
        near, far = (_each(overlap.value, some + n * h) - _each(overlap.value, some - n * h) for n in (1, 2))
        slopes.append((8.0 * near - far) / (12.0 * step))
    gradients = together.value[: len(some)]
    off = float(np.abs(gradients - np.stack(slopes, axis=-1)).max() / np.abs(gradients).max())
    report.check(off <= 1e-6, f"gradients: within {off:.1g} of finite differences, of the largest")


def _each(call: Callable[[Floats], Any], ts: Floats) -> Floats:
    return np.array([call(t) for t in ts])
