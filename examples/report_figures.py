"""
Collision in the frequency domain, in seven figures
===================================================

The figures follow Lysenko (2013) and Behandish and Ilies (2016), with data of our own runs.
``docs/explanation/frequency.md`` explains them. CPU times are medians of a few runs on the machine that
built this page. The figures are written into the working folder, as ``report_figures_1.png`` and so
on. It needs the extra ``spectral``.
"""

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson
from scipy.signal import convolve2d, fftconvolve

import cspace
from cspace.spectral import (
    Bump,
    ContactTest,
    EarlyTest,
    FourierOverlap,
    Verdict,
    ball_spectrum,
    decompose,
)

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

COLORS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#262626",
)  # Okabe and Ito (2008), and black
SHAPE = shapely.Polygon(
    [(0.3, 0.3), (1.7, 0.3), (1.7, 0.8), (1.2, 0.7), (0.9, 1.7), (0.3, 1.5)]
)  # metres
PERIOD = 4.0  # metres; no shape here is longer
FREQUENCIES = 128  # along an axis, so up to 16 cycles per metre


def cell_centers(grid: cspace.Grid) -> Floats:
    """Return the centers of cells, shape (nx, ny, 2)."""
    return np.stack(np.meshgrid(grid.centers(0), grid.centers(1), indexing="ij"), axis=-1)


def sample_indicator(grid: cspace.Grid) -> Floats:
    """Return the indicator of the shape at cell centers: the descriptor 1 inside, 0 outside."""
    return np.asarray(shapely.contains_xy(SHAPE, *cell_centers(grid).T).T.astype(np.float64))


def sample_balls(centers: Floats, radii: Floats, bump: Bump, grid: cspace.Grid) -> Floats:
    """Return the descriptor of discs at cell centers: the sum of their bumps."""
    values = np.zeros(grid.shape)
    x, y = grid.centers(0), grid.centers(1)
    for center, radius in zip(centers, np.broadcast_to(radii, len(centers)), strict=True):
        # Only cells near the disc.
        i, j = (np.flatnonzero(np.abs(a - c) < radius) for a, c in zip((x, y), center, strict=True))
        distances = np.hypot(x[i, None] - center[0], y[j] - center[1]) / radius
        values[np.ix_(i, j)] += bump.profile(distances)
    return values


def plain(ax: Axes, title: str, x: str, y: str) -> None:
    """Set the style of axes."""
    ax.set_title(title, fontsize=10)
    ax.set(xlabel=x, ylabel=y)


def save(figure: Figure, number: int) -> None:
    """Write a figure into the working folder, and print its path."""
    file = Path(f"report_figures_{number}.png")
    figure.savefig(file)
    plt.close(figure)
    print(f"figure {number}: {file}")


# %%
# 1. An obstacle and its spectrum
# -------------------------------
#
# The modulus of the spectrum of its indicator, with a logarithmic scale.


def draw_modulus(ax: Axes, spectrum: Complexes, title: str) -> Any:
    """Draw the modulus of a spectrum over its largest value, on a logarithmic scale."""
    levels = np.log10(np.maximum(np.abs(np.fft.fftshift(spectrum)) / np.abs(spectrum).max(), 1e-30))
    reach = (FREQUENCIES // 2 + 0.5) / PERIOD
    extent = (-reach, reach - 1.0 / PERIOD, -reach, reach - 1.0 / PERIOD)
    plain(ax, title, "frequency along x (cycles/m)", "frequency along y (cycles/m)")
    return ax.imshow(levels.T, origin="lower", extent=extent, cmap="cividis", vmin=-5.0, vmax=0.0)


def add_scale(image: Any, axes: Any) -> None:
    scale = plt.colorbar(image, ax=axes, shrink=0.8, extend="min", ticks=range(-5, 1))
    scale.ax.set_yticklabels([f"$10^{{{level}}}$" for level in range(-5, 1)])
    scale.set_label("modulus over its largest value")


def sampled_spectrum(values: Floats, grid: cspace.Grid, period: float, count: int) -> Complexes:
    """Return the spectrum by FFT of values at cell centers; the period is a whole number of cells."""
    k = np.fft.fftfreq(count, 1.0 / count).astype(int)
    cells = round(period / grid.spacing)
    spectrum = np.fft.fft2(values * grid.spacing**2, (cells, cells))[np.ix_(k % cells, k % cells)]
    x, y = (np.exp(-2j * math.pi * k * (low + 0.5 * grid.spacing) / period) for low in grid.lower)
    return np.asarray(spectrum * x[:, None] * y)


figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
grid = cspace.Grid((0.0, 0.0), 2.0 / 512, (512, 512))
obstacle = sample_indicator(grid)
left.imshow(obstacle.T, origin="lower", extent=(0.0, 2.0, 0.0, 2.0), cmap="Greys", vmax=1.3)
left.set(xticks=np.arange(0.0, 2.1, 0.5), yticks=np.arange(0.0, 2.1, 0.5))
plain(left, "an obstacle", "x (m)", "y (m)")
spectrum = sampled_spectrum(obstacle, grid, PERIOD, FREQUENCIES)
image = draw_modulus(right, spectrum, "spectrum of its indicator")
energies = np.abs(spectrum) ** 2
waves = np.fft.fftfreq(FREQUENCIES, PERIOD / FREQUENCIES)
is_low = np.hypot(waves[:, None], waves) <= 2.0
share = float(energies[is_low].sum() / energies.sum())
print(f"{is_low.sum()} of {is_low.size} frequencies have {100.0 * share:.1f} % of the energy")
add_scale(image, right)
save(figure, 1)

# %%
# 2. The bump
# -----------
#
# For several alpha, and the share of its energy beyond a frequency, in the plane.

figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4.0), layout="constrained")
s, k = np.linspace(-1.2, 1.2, 961), np.linspace(0.0, 32.0, 6401)
for alpha, color in zip((0.5, 1.0, 2.0, 4.0, 16.0, math.inf), COLORS, strict=True):
    bump = Bump(alpha)
    label = (
        rf"$\alpha$ = {alpha:g}" if math.isfinite(alpha) else r"$\alpha = \infty$: the indicator"
    )
    left.plot(s, bump.profile(s), color=color, label=label)
    density = 2.0 * math.pi * k * bump.radial_spectrum(k, 2) ** 2
    below = cumulative_simpson(density, x=k, initial=0.0)
    beyond = 1.0 - below / bump.energy(2)
    right.loglog(k, beyond, color=color)
    share = float(np.interp(1.0, k, beyond))
    print(f"alpha = {alpha:g}: {share:.2g} of the energy beyond 1 cycle per radius")
left.set(ylim=(-0.03, 1.08))
right.set(xlim=(0.1, 30.0), ylim=(1e-6, 1.5))
plain(left, "the bump", "distance from the centre (radii)", r"$\psi$")
plain(
    right,
    "how much lies in high frequencies",
    "frequency (cycles/radius)",
    "share of the energy beyond it",
)
figure.legend(loc="outside right center", frameon=False)
save(figure, 2)

# %%
# 3. Balls inside a shape
# -----------------------
#
# And their descriptor, the sum of their bumps.

figure, (left, right) = plt.subplots(
    1, 2, figsize=(9.5, 4.4), layout="constrained", sharex=True, sharey=True
)
balls = decompose(SHAPE, kind="inner", number=48)
discs = PatchCollection(list(map(Circle, balls.centers, balls.radii)), alpha=0.16, ec=COLORS[0])
left.add_collection(discs)
print(f"48 inner discs: {100.0 * balls.volume_ratio:.1f} % of the area")
left.plot(*SHAPE.exterior.xy, color="#262626", linewidth=1.2)
left.set_aspect("equal")
plain(left, f"48 inner discs, {100.0 * balls.volume_ratio:.1f} % of the area", "x (m)", "y (m)")
grid = cspace.Grid((0.2, 0.2), 0.004, (400, 400))
values = sample_balls(balls.centers, balls.radii, Bump(2.0), grid)
extent = (grid.lower[0], grid.upper[0], grid.lower[1], grid.upper[1])
image = right.imshow(
    np.where(values > 0.0, values, np.nan).T, origin="lower", extent=extent, cmap="cividis"
)
right.plot(*SHAPE.exterior.xy, color="#262626", linewidth=1.2)
plain(right, r"the sum of their bumps, $\alpha$ = 2", "x (m)", "y (m)")
plt.colorbar(image, ax=right, shrink=0.8, label="descriptor")
save(figure, 3)

# %%
# 4. One ball, and a shape of such balls
# --------------------------------------
#
# Their spectra as images and along an axis.

figure, axes = plt.subplots(
    1, 3, figsize=(13.0, 4.0), layout="constrained", width_ratios=(1.0, 1.0, 1.1)
)
radius, bump = 0.08, Bump(2.0)
ticks = np.arange(0.0, 2.0, 1.25 * radius)
centers = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
centers = centers[shapely.contains_xy(SHAPE.buffer(-radius), *centers.T)]
ball = ball_spectrum([[0.0, 0.0]], radius, bump, PERIOD, FREQUENCIES)
shape = ball_spectrum(centers, radius, bump, PERIOD, FREQUENCIES)
draw_modulus(axes[0], ball, f"one disc B0 of {100.0 * radius:g} cm")
image = draw_modulus(axes[1], shape, f"{len(centers)} such discs in a shape")
axes[1].set_ylabel("")
add_scale(image, axes[:2])
k = np.arange(FREQUENCIES // 2)
for spectrum, color, label in ((ball, COLORS[1], "one disc"), (shape, COLORS[0], "shape")):
    axes[2].semilogy(
        k / PERIOD, np.abs(spectrum[k, 0]) / abs(spectrum[0, 0]), color=color, label=label
    )
plain(axes[2], "both along x", "frequency along x (cycles/m)", "modulus over its value at 0")
axes[2].legend(frameon=False)
save(figure, 4)

# %%
# 5. Minkowski sums of bitmaps
# ----------------------------
#
# The Minkowski sum of two bitmaps is the set where their convolution is above zero. Sums of whole
# numbers are exact once rounded, because the error of the transforms is far below one half.
#
# Direct sums and sums by FFT, and the sizes from which the FFT is faster. Both run alternately, so
# a busy machine slows both equally. The first run of each, which imports and compiles, is not
# counted.


def in_turns(
    works: Sequence[Callable[[], Any]], most: float = 0.2
) -> tuple[list[float], list[Any]]:
    """Return median CPU times, seconds, over up to 31 rounds and ``most`` seconds, and the results."""
    for work in works:
        work()
    rounds: list[list[float]] = []
    while len(rounds) < 31 and sum(map(sum, rounds)) < most:
        results, clocks = [], [time.process_time()]
        for work in works:
            results.append(work())
            clocks.append(time.process_time())
        rounds.append(np.diff(clocks).tolist())
    return np.median(rounds, axis=0).tolist(), results


def crossover(sizes: list[int], slow: Floats, fast: Floats) -> float | None:
    """Return the size from which ``slow`` stays above ``fast``, on log axes; None if always or
    never."""
    ratio = np.log(slow / fast)
    if (ratio > 0.0).all() or ratio[-1] <= 0.0:
        return None
    i = int(np.flatnonzero(ratio <= 0.0)[-1])
    return float(np.exp(np.interp(0.0, ratio[i : i + 2], np.log(sizes[i : i + 2]))))


def sum_by_fft(f: Floats, g: Floats) -> Floats:
    """Return the number of pairs of cells of two bitmaps that add up to each cell."""
    return np.asarray(np.rint(fftconvolve(f, g)))


figure, both = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
rng = np.random.default_rng(5)
small, large = [2, 3, 4, 6, 8, 12, 16, 24, 32, 48], [2, 3, 4, 6, 8, 12, 16]
panels = (
    ("n x n cells and n x n cells", small, small),
    ("256 x 256 cells and n x n cells", [256] * 7, large),
)
for ax, (title, firsts, sizes) in zip(both, panels, strict=True):
    rounds = []
    for sides in zip(firsts, sizes, strict=True):
        f, g = ((rng.random((n, n)) < 0.5).astype(np.float64) for n in sides)
        calls = partial(convolve2d, f, g), partial(sum_by_fft, f, g)
        seconds, _ = in_turns(calls)
        rounds.append(seconds)
    direct, fft = np.transpose(rounds)
    n = crossover(sizes, direct, fft)
    faster = "slower" if direct[-1] > fft[-1] else "faster"
    label = f"direct: slower from n = {n:.0f} on" if n else f"direct: {faster} here"
    print(f"{title}: {label}")
    ax.axvline(n or math.nan, color=COLORS[0], linestyle=":")
    ax.loglog(sizes, direct, "o-", color=COLORS[0], markersize=4.0, label=label)
    ax.loglog(sizes, fft, "o-", color=COLORS[1], markersize=4.0, label="FFT")
    plain(ax, title, "n", "CPU time (s)")
    ax.set_xticks([n for n in (2, 4, 8, 16, 32) if n <= sizes[-1]])
    ax.xaxis.set_major_formatter("{x:g}")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.legend(fontsize=9, loc="upper left", framealpha=1.0)
    ax.set_ylim(top=10.0 * ax.get_ylim()[1])
save(figure, 5)

# %%
# 6. Ways to the spectrum of discs
# --------------------------------
#
# The CPU time over the number of discs: summed, and at equal errors sampled or by a non-uniform FFT.

count, bump, rng = 64, Bump(2.0), np.random.default_rng(6)
period, radius = 1.0, 4.0 / count
k = np.fft.fftfreq(count, 1.0 / count) / period
waves = np.stack(np.meshgrid(k, k, indexing="ij"), axis=-1).reshape(-1, 2)
radial = radius**2 * bump.radial_spectrum(radius * np.linalg.norm(waves, axis=1), 2).reshape(
    count, count
)


def summed(points: Floats) -> Complexes:
    parts = np.array_split(waves, math.ceil(len(waves) * len(points) / 2**20))
    sums = np.concatenate([np.exp(-2j * math.pi * (part @ points.T)).sum(axis=1) for part in parts])
    return np.asarray(radial * sums.reshape(count, count))


def factored(points: Floats) -> Complexes:
    x, y = (np.exp(-2j * math.pi * k[:, None] * column) for column in points.T)
    return np.asarray(radial * (x @ y.T))


def sampled(cells: int, points: Floats) -> Complexes:
    grid = cspace.Grid((0.0, 0.0), period / cells, (cells, cells))
    values = sample_balls(points, np.full(len(points), radius), bump, grid)
    return sampled_spectrum(values, grid, period, count)


def transformed(tolerance: float, points: Floats) -> Complexes:
    return ball_spectrum(points, radius, bump, period, count, tolerance)


methods: dict[str, Callable[[Floats], Complexes]] = {
    "direct sum": summed,
    "direct sum, a factor for each axis": factored,
    f"within 1e-3: {2 * count} x {2 * count} samples, FFT": partial(sampled, 2 * count),
    "within 1e-3: NUFFT, or sums of few": partial(transformed, 1e-3),
    f"within 1e-5: {4 * count} x {4 * count} samples, FFT": partial(sampled, 4 * count),
    "within 1e-5: NUFFT, or sums of few": partial(transformed, 1e-5),
}
numbers = [1, 10, 100, 1000, 10_000]
sets = [rng.uniform(radius, period - radius, (number, 2)) for number in numbers]
rounds = [in_turns([partial(method, points) for method in methods.values()]) for points in sets]
times = np.transpose([each for each, _ in rounds])
errors = [
    max(np.abs(results[i] - results[1]).max() / np.abs(results[1]).max() for _, results in rounds)
    for i in range(len(methods))
]
figure, ax = plt.subplots(figsize=(9.5, 4.4), layout="constrained")
for name, each, error, color in zip(methods, times, errors, COLORS, strict=False):
    tells = f"\n  (error up to {error:.0e})" if error > 0.0 else ""
    print(f"{name}: {1e3 * each[-1]:.3g} ms for {numbers[-1]} discs")
    ax.loglog(numbers, each, "o-", color=color, markersize=4.0, label=name + tells)
plain(
    ax, f"the spectrum of discs at {count} x {count} frequencies", "number of discs", "CPU time (s)"
)
figure.legend(loc="outside right center", frameon=False)
save(figure, 6)

# %%
# 7. Early answers about the depth
# --------------------------------
#
# The number of frequencies that prove an overlap below or above a threshold, over their ratio, where
# trees of the balls have not answered already that the balls are apart.

LEVEL = 1e-3  # square metres


def draw_answers(ax: Axes, tests: dict[str, EarlyTest], places: Floats) -> None:
    """Plot the frequencies of each placement over its overlap, with the legend."""
    for (name, test), color in zip(tests.items(), COLORS, strict=False):
        answer = test.compare(places)
        ratios = test.overlap.value(places) / test.threshold
        is_open = answer.verdict == Verdict.UNDECIDED
        taken = answer.frequencies
        median = f"median {np.median(taken[~is_open]):.0f} of {test.overlap.frequencies}"
        label = f"{name}: {median}"
        ax.loglog(ratios[~is_open], taken[~is_open], ".", color=color, markersize=4.0, label=label)
        ax.loglog(ratios[is_open], taken[is_open], "x", color=color, markersize=4.0, alpha=0.3)
        print(f"{name}: {median} frequencies; {np.mean(is_open):.1%} are undecided")
    ax.plot([], [], "x", color="0.4", label="undecided")
    plain(ax, "proofs about the depth", "overlap / threshold", "frequencies summed")
    ax.set(xlim=(1e-2, 1e3), ylim=(1.0, 5e7))
    ax.legend(fontsize=9, loc="upper right", markerscale=1.5, framealpha=1.0)


part = shapely.Polygon([(-0.3, -0.2), (0.3, -0.2), (0.3, 0.0), (0.0, 0.0), (0.0, 0.3), (-0.3, 0.3)])
a, b = (decompose(shape, kind="outer", number=32) for shape in (part, SHAPE))
places = np.random.default_rng(7).uniform(-0.4, 2.4, (1500, 2))
is_apart = np.asarray(ContactTest(a, b).separated(places)) == Verdict.MISS
print(f"trees of balls: {np.mean(is_apart):.0%} are apart, without any frequency")
overlaps = {
    alpha: FourierOverlap(a, b, bump=Bump(alpha), tolerance=1e-5) for alpha in (2.0, 8.0, math.inf)
}
figure, (left, right) = plt.subplots(
    1, 2, figsize=(11.0, 4.6), layout="constrained", sharex=True, sharey=True
)
levels = {f"{level:g} m²": EarlyTest(overlaps[2.0], level) for level in (1e-4, LEVEL, 1e-2)}
draw_answers(left, levels, places[~is_apart])
alphas = {f"alpha = {alpha:g}": EarlyTest(each, LEVEL) for alpha, each in overlaps.items()}
draw_answers(right, alphas, places[~is_apart])
left.set_title("several thresholds, alpha = 2", fontsize=10)
right.set_title("bumps of several alpha, threshold 0.001 m²", fontsize=10)
save(figure, 7)
