"""Spectra, Minkowski sums, overlaps and verdicts, against direct methods."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import fcl
import numpy as np
import shapely
import trimesh
from numba import njit, prange
from numpy.typing import NDArray
from scipy.fft import irfftn, next_fast_len, rfftn
from scipy.signal import convolve2d, fftconvolve
from scipy.spatial import Voronoi
from scipy.spatial.transform import Rotation

from benchmarks.report import Report
from benchmarks.timing import interleave, once
from cspace import Grid, Workspace, suggest
from cspace._engines import ENGINES
from cspace._raster import Raster
from cspace._shapes.mesh import Mesh
from cspace._support.arrays import Floats, Ints
from cspace.spectral import (
    Bump,
    ContactTest,
    FourierOverlap,
    Verdict,
    ball_spectrum,
    best_placements,
    decompose,
)
from cspace.spectral._bump import radial_table
from tests.helpers import solids

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

PLACEMENT_COUNT = 100_000
MIN_VALUES_RATIO = 20.0
SINGLE_PLACEMENTS = {2: 20_000, 3: 200}
"""Placements evaluated one by one, by dimension."""

SUBDIVISIONS = 5
"""Subdivisions of the icosahedron behind the bodies of verdicts: 20,480 triangles."""

VERDICT_BALLS = 300
"""Outer and inner balls of each body."""

VERDICT_PLACEMENTS = 3000
VERDICT_SIDE = 5.7
"""Side of the cube of placements, metres; nine of ten are clear."""

MIN_DECIDED_PERCENT = 98.0
MAX_COLLIDE_RATIO = 3.0
"""Largest time of a verdict over FCL's time to test the meshes for collision."""

UPDATED_BALLS = 2000
"""Balls of a set, of which one of a hundred move."""

SEARCH_BALLS = 40, 200
"""Balls of the body that moves and of the other one, for best placements."""

SEARCH_ROTATIONS = {2: 72, 3: 24}
"""Rotations of best placements, by dimension."""

RASTER_CELLS_PER_RADIUS = 4.0
"""Cells of rasters per smallest radius."""

MAX_SCORE_DIFFERENCE = 0.02
"""Largest relative difference of the best score of the rasters from ours, at the same rotations."""

CROSSOVER_CELLS = 4, 6, 8, 12, 16, 24, 32, 48, 64
"""Cells along each side of two bitmaps whose Minkowski sum by FFT overtakes the direct one."""

EQUAL_ERRORS = 1e-2, 1e-3, 1e-5
"""Errors of spectra, over the largest value, at which transforms are compared."""

SAMPLED_BALLS = 1, 3, 10, 30, 100, 1000, 10_000
"""Numbers of balls whose spectra are computed by several methods."""

SAMPLED_FREQUENCIES = 64
"""Frequencies along each axis of these spectra."""

ENGINE_CELLS = {(1000, 1000): (100, 200, 300), (128, 128, 128): (40, 50, 60)}
"""Cells along each side of robots, by the shape of the map."""

MEMORY_CELLS = 64
"""Cells along each axis of the maps whose memory is compared."""


def run(report: Report, seed: int) -> None:
    """Compare Minkowski sums, spectra, values at placements, best placements, and verdicts."""
    rng = np.random.default_rng(seed)
    for dim in (2, 3):
        _spectra(report, dim, rng)
        _values(report, seed, dim, rng)
        _updates(report, dim, np.random.default_rng(seed))
        _placements(report, dim, rng)
    _verdicts(report, rng)
    _minkowski_crossover(report, rng)
    for tolerance in EQUAL_ERRORS:
        _sampling(report, tolerance, rng)
    for height in (1.0, 0.25):
        _bounds(report, height, np.random.default_rng(seed))
    _engines(report, rng)
    _radii(report, rng)
    _medial_balls(report)
    _memory(report)


# ---- spectra -------------------------------------------------------------------------------------


@njit(cache=True, parallel=True)
def _direct(
    centers: Floats,
    starts: Ints,
    radii: Floats,
    weights: Floats,
    table: Floats,
    frequencies: Floats,
) -> Complexes:
    """Sum term by term on all cores, with one factor for each radius of sorted balls."""
    out = np.zeros(len(frequencies), np.complex128)
    for n in prange(len(frequencies)):
        u, v, w = frequencies[n]
        modulus = math.sqrt(u * u + v * v + w * w)
        for part in range(len(radii)):
            real, imag = 0.0, 0.0
            for ball in range(starts[part], starts[part + 1]):
                angle = (
                    2.0
                    * math.pi
                    * (u * centers[ball, 0] + v * centers[ball, 1] + w * centers[ball, 2])
                )
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
        np.arange(
            -1.0,
            float(sizes[-1]) * math.sqrt(dim) * (count // 2) / PERIOD_IN_SIDES / TABLE_STEP + 4.0,
        )
    )
    table = radial_table(Bump(2.0), dim, 1 + int(nodes.max()))(nodes)
    balls = (
        np.pad(centers[order], ((0, 0), (0, 3 - dim))),
        np.append(starts, len(order)),
        sizes,
        sizes**dim,
        table,
    )

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
        report.section(
            f"{number} balls, {name}, {' x '.join([str(count)] * dim)} frequencies, {Bump(2.0)}"
        )
        call = partial(ball_spectrum, centers, radii, Bump(2.0), PERIOD_IN_SIDES, count, TOLERANCE)
        ours = interleave({"ours": call}, 3 if report.quick else 5)["ours"]
        report.timing(f"ours, tolerance {TOLERANCE:g}", ours)
        whole = count**dim
        asked = min(whole, max(1, MAX_DIRECT_PAIRS // number))
        places = np.arange(whole) if asked == whole else rng.choice(whole, asked, replace=False)
        direct = once(partial(_direct_sum(centers, radii, count), places)).per(asked / whole)
        report.timing(f"direct sum, extrapolated from 1 / {whole / asked:.4g}", direct)
        report.ratio("direct sum / ours", direct, ours, least=MIN_SPECTRUM_RATIO)
        off = float(np.abs(direct.value - ours.value.ravel()[places]).max()) / float(
            ours.value.flat[0].real
        )
        report.check(off <= TOLERANCE, f"direct sum: within {off:.1g} of F(0)")


# ---- Minkowski sums ------------------------------------------------------------------------------


def _minkowski_crossover(report: Report, rng: np.random.Generator) -> None:
    """Report the size of bitmaps from which sums by FFT take less CPU time than direct sums."""
    report.section("Minkowski sums of bitmaps, n x n and n x n cells: CPU times")
    sizes = CROSSOVER_CELLS[::2] if report.quick else CROSSOVER_CELLS
    times = []
    for cells in sizes:
        f, g = ((rng.random((cells, cells)) < 0.06).astype(np.float64) for _ in range(2))
        calls = {
            "direct": partial(convolve2d, f, g),
            "FFT": lambda f=f, g=g: np.rint(fftconvolve(f, g)),
        }
        times.append(_cpu_times(report, f"{cells} x {cells} cells", calls))
    _report_crossover(report, "direct", "FFT", sizes, times)


def _sampling(report: Report, tolerance: float, rng: np.random.Generator) -> None:
    """Compare spectra of discs from samples, from sums over discs, and by a non-uniform FFT.

    The uniform samples are the coarsest powers of two whose spectrum is within the tolerance.
    """
    count = SAMPLED_FREQUENCIES
    radius = 4.0 / count
    bump = Bump(2.0)
    k = np.fft.fftfreq(count, 1.0 / count)
    radial = radius**2 * bump.radial_spectrum(radius * np.hypot(k[:, None], k), 2)

    waves = np.stack(np.meshgrid(k, k, indexing="ij"), axis=-1).reshape(-1, 2)

    def sum_waves(centers: Floats) -> Complexes:
        sums = sum(np.exp(-2j * math.pi * (waves @ center)) for center in centers)
        return np.asarray(radial * np.reshape(sums, (count, count)))

    def sum_discs(centers: Floats) -> Complexes:
        x, y = (np.exp(-2j * math.pi * k[:, None] * column) for column in centers.T)
        return np.asarray(radial * (x @ y.T))

    def sample(cells: int, centers: Floats) -> Complexes:
        grid = Grid((0.0, 0.0), 1.0 / cells, (cells, cells))
        values = _sample(centers, np.full(len(centers), radius), bump, grid)
        kept = k.astype(int) % cells
        shift = np.exp(-1j * math.pi * k / cells) / cells
        spectrum = np.fft.fft2(values)[np.ix_(kept, kept)]
        return np.asarray(spectrum * shift[:, None] * shift)

    def transform(centers: Floats) -> Complexes:
        return ball_spectrum(centers, radius, bump, 1.0, count, tolerance)

    few = rng.uniform(radius, 1.0 - radius, (30, 2))
    exact = sum_discs(few)
    largest = float(np.abs(exact).max())
    cells = count
    while float(np.abs(sample(cells, few) - exact).max()) > tolerance * largest:
        cells *= 2
    report.section(
        f"spectra of discs, {count} x {count} frequencies, within {tolerance:g}: CPU times"
    )
    numbers = SAMPLED_BALLS[::3] if report.quick else SAMPLED_BALLS
    times = []
    names = (
        "sums",
        "sums, a factor for each axis",
        f"{cells} x {cells} samples, FFT",
        "ball_spectrum, NUFFT",
    )
    for number in numbers:
        centers = rng.uniform(radius, 1.0 - radius, (number, 2))
        methods = sum_waves, sum_discs, partial(sample, cells), transform
        calls = {
            name: partial(method, centers) for name, method in zip(names, methods, strict=True)
        }
        times.append(_cpu_times(report, f"{number} discs", calls))
        exact = sum_discs(centers)
        error = float(np.abs(transform(centers) - exact).max() / np.abs(exact).max())
        report.check(error <= tolerance, f"NUFFT: within {error:.1g}")
    sums, factors, samples, transforms = names
    for slow, fast in (
        (sums, samples),
        (sums, transforms),
        (factors, transforms),
        (samples, transforms),
    ):
        _report_crossover(report, slow, fast, numbers, times)


def _sample(centers: Floats, radii: Floats, bump: Bump, grid: Grid) -> Floats:
    """Sum the bumps of balls at the centers of cells, each in a window around the ball."""
    values = np.zeros(grid.shape)
    axes = [grid.centers(axis) for axis in range(grid.dim)]
    for center, radius in zip(centers, radii, strict=True):
        near = [np.flatnonzero(np.abs(x - c) < radius) for x, c in zip(axes, center, strict=True)]
        steps = [(x[n] - c) / radius for x, n, c in zip(axes, near, center, strict=True)]
        squares = sum(step**2 for step in np.meshgrid(*steps, indexing="ij", sparse=True))
        values[np.ix_(*near)] += bump.profile(np.sqrt(squares))
    return values


def _cpu_times(report: Report, case: str, calls: dict[str, Callable[[], Any]]) -> dict[str, float]:
    """Report and return the CPU times of calls, seconds, each repeated for some milliseconds."""
    times = {}
    for name, call in calls.items():
        call()
        repeats = max(1, math.ceil((1e-3 if report.quick else 2e-2) / max(once(call).cpu[0], 1e-6)))

        def repeat(call: Callable[[], Any] = call, repeats: int = repeats) -> None:
            for _ in range(repeats):
                call()

        times[name] = interleave({name: repeat}, 5)[name].per(repeats).median_cpu
        report.figure(f"{case}: {name}", 1e6 * times[name], "us")
    return times


def _report_crossover(
    report: Report, slow: str, fast: str, sizes: Sequence[int], times: list[dict[str, float]]
) -> None:
    """Report the size from which one method stays slower than another, on logarithmic axes."""
    ratio = np.log([each[slow] / each[fast] for each in times])
    behind = np.flatnonzero(ratio <= 0.0)
    if not len(behind):
        report.note(f"{slow}: slower than {fast} at all sizes")
    elif behind[-1] == len(ratio) - 1:
        report.note(f"{slow}: faster than {fast} at the largest size")
    else:
        i = int(behind[-1])
        size = math.exp(np.interp(0.0, ratio[i : i + 2], np.log(sizes[i : i + 2])))
        report.figure(f"{slow}: slower than {fast} from", size, "")


def _bounds(report: Report, height: float, rng: np.random.Generator) -> None:
    """Count the frequencies that decide with Lysenko's bound of the rest, and with ours.

    Of the frequencies that are not summed yet, Lysenko (2013) multiplies the two norms; ours sums
    the products of the moduli. Frequencies beyond the band count for neither. They are summed in
    circles, in ellipses as long as the sets are wide and ``height`` times as high, or from the
    largest on.
    """
    stretch = np.array([1.0, height])
    a, b = (
        (rng.uniform(-0.5, 0.5, (40, 2)) * side * stretch, rng.choice([0.08, 0.1, 0.15], 40))
        for side in (0.8, 2.0)
    )
    period, count = 4.0, 128
    k = np.fft.fftfreq(count, 1.0 / count) / period
    waves = np.stack(np.meshgrid(k, k, indexing="ij"), axis=-1).reshape(-1, 2)
    order = np.argsort(np.linalg.norm(waves, axis=1), kind="stable")
    spectra = [
        ball_spectrum(*each, Bump(2.0), period, count, 1e-9).ravel()[order] for each in (a, b)
    ]
    products = np.abs(spectra[0]) * np.abs(spectra[1]) / period**2
    ours = products.sum() - np.cumsum(products)
    energies = [np.abs(spectrum) ** 2 / period**2 for spectrum in spectra]
    norms = [np.sqrt(np.maximum(e.sum() - np.cumsum(e), 0.0)) for e in energies]
    theirs = norms[0] * norms[1]
    places = rng.uniform(-1.8, 1.8, (200 if report.quick else 2000, 2)) * stretch
    needed: dict[str, list[float]] = {"Lysenko's bound": [], "our bound": []}
    needed["our bound, ellipses"] = []
    needed["our bound, largest first"] = []
    in_ellipses = np.argsort(np.linalg.norm(waves[order] * stretch, axis=1), kind="stable")
    largest_first = np.argsort(-products, kind="stable")
    left, outside = (
        products.sum() - np.cumsum(products[rank]) for rank in (largest_first, in_ellipses)
    )
    threshold = 1e-3
    for place in places:
        phases = np.exp(2j * math.pi * (waves[order] @ place))
        terms = (spectra[1] * np.conj(spectra[0]) * phases).real / period**2
        sums = np.cumsum(terms)
        others = np.cumsum(terms[largest_first])
        ellipses = np.cumsum(terms[in_ellipses])
        cases = (sums, theirs), (sums, ours), (ellipses, outside), (others, left)
        for name, (total, rest) in zip(needed, cases, strict=True):
            decided = np.flatnonzero(np.abs(total - threshold) > rest)
            needed[name].append(float(decided[0]) + 1.0 if len(decided) else math.inf)
    report.section(
        f"frequencies that decide about an overlap of {threshold:g} m2, {count**2} in all, "
        f"sets {height:g} times as high as wide"
    )
    for name, numbers in needed.items():
        for percent in (25, 50, 75):
            report.figure(f"{name}, {percent} % of placements", np.percentile(numbers, percent), "")


def _engines(report: Report, rng: np.random.Generator) -> None:
    """Compare transforms with words of bits, for balls and for noise, on one thread."""
    for shape, sizes in ENGINE_CELLS.items():
        occupied = np.zeros(shape, dtype=bool)
        for corner in rng.integers(0, shape, (40, len(shape))):
            sides = rng.integers(2, shape[0] // 10, len(shape))
            occupied[tuple(map(slice, corner, corner + sides))] = True
        report.section(f"C-obstacles of a map of {shape} cells: CPU times")
        for size in sizes[:1] if report.quick else sizes:
            axes = [np.arange(size) - 0.5 * (size - 1)] * len(shape)
            squares = sum(x**2 for x in np.meshgrid(*axes, indexing="ij", sparse=True))
            robots = {
                "a ball": squares <= 0.25 * size**2,
                "noise": rng.random((size,) * len(shape)) < 0.5,
            }
            for name, cells in robots.items():
                rasters = [Raster.from_bitmap(cells, (-(size // 2),) * len(shape))]
                out = [np.empty(shape, dtype=bool)]
                calls = {
                    method: partial(
                        engine.write_overlaps, occupied, rasters, out, outside=True, workers=1
                    )
                    for method, engine in ENGINES.items()
                }
                _cpu_times(report, f"{name} of {size} cells", calls)


def _radii(report: Report, rng: np.random.Generator) -> None:
    """Compare spectra of balls with few and many different radii."""
    number, count = (100, 64) if report.quick else (2000, 256)
    report.section(f"{number} discs of several radii, {count} x {count} frequencies: CPU times")
    centers = rng.uniform(0.0, 1.0, (number, 2))
    calls = {}
    for sizes in (1, 8, 64):
        radii = rng.choice(np.linspace(*BALL_RADII, sizes), number)
        call = partial(ball_spectrum, centers, radii, Bump(2.0), PERIOD_IN_SIDES, count, TOLERANCE)
        calls[f"{sizes} radii"] = call
    _cpu_times(report, "spectrum", calls)


def _medial_balls(report: Report) -> None:
    """Compare inner discs from signed distances with those of the medial axis.

    Discs of the medial axis lie around the Voronoi vertices of points on the border.
    """
    shape = shapely.Polygon([(3, 3), (17, 3), (17, 8), (12, 7), (9, 17), (3, 15)])
    report.section("inner discs that fill a share of a polygon")
    ring = shape.exterior
    for share in (0.9, 0.97, 0.99):
        ours = 1
        while decompose(shape, kind="inner", number=ours).volume_ratio < share:
            ours = math.ceil(1.2 * ours)
        report.figure(f"{share:.0%}: from signed distances, at most", ours, "")
        points = 6
        while True:
            places = np.arange(points) / points
            border = shapely.get_coordinates(ring.interpolate(places, normalized=True))
            vertices = shapely.points(Voronoi(border).vertices)
            inside = vertices[shapely.contains(shape, vertices)]
            discs = shapely.buffer(inside, shapely.distance(inside, ring), quad_segs=64)
            if shapely.union_all(discs).area >= share * shape.area:
                break
            points = math.ceil(1.1 * points)
        report.figure(f"{share:.0%}: of the medial axis", len(discs), "")


def _memory(report: Report) -> None:
    """Report the memory of maps over the dimension, at equal counts and for an equal passage."""
    report.section(f"memory of a map, {MEMORY_CELLS} cells along each axis, a byte each")
    for dim in range(2, 8):
        report.figure(f"{dim} dimensions", MEMORY_CELLS**dim / 2.0**20, "MiB")
    report.section("memory of a map as cspace.suggest gives it, 10 m wide, for a gap of 0.9 m")
    plane = Workspace.from_array(np.zeros((100, 100), dtype=bool), 0.1)
    space = Workspace.from_array(np.zeros((100, 100, 20), dtype=bool), 0.1)
    cases = (
        ("R^2, 2 dimensions", plane, "disc:0.3", "fixed"),
        ("SE(2), 3 dimensions", plane, "rect:0.9x0.6", "yaw"),
        ("R^3, 3 dimensions", space, "ball:0.3", "fixed"),
        ("R^3 x SO(2), 4 dimensions", space, "box:0.9x0.6x0.6", "yaw"),
        ("SE(3), 6 dimensions", space, "box:0.9x0.6x0.6", "all"),
    )
    for name, workspace, robot, rotations in cases:
        suggestion = suggest(workspace, robot, gap=0.9, rotations=rotations)
        report.figure(name, suggestion.memory / 2.0**20, "MiB")
        report.note(f"{name}: {suggestion}")


# ---- overlaps ------------------------------------------------------------------------------------


def _values(report: Report, seed: int, dim: int, rng: np.random.Generator) -> None:
    """Compare overlaps and gradients in a batch with single calls."""
    tolerance = 0.1 if report.quick else 1e-3
    a, b = ((rng.uniform(-0.5, 0.5, (30, dim)), rng.choice([0.15, 0.2, 0.3], 30)) for _ in range(2))
    overlap = FourierOverlap(a, b, tolerance=tolerance)
    number = PLACEMENT_COUNT // 10 if report.quick else PLACEMENT_COUNT
    single = min(number, SINGLE_PLACEMENTS[dim] // 20 if report.quick else SINGLE_PLACEMENTS[dim])
    where = "in the plane" if dim == 2 else "in space"
    report.section(
        f"{number} placements {where}, {overlap.frequencies} frequencies (opposite ones counted once)"
    )
    ts = rng.uniform(*overlap.domain, (number, dim))
    for name, one, least in (
        ("value", overlap.value, MIN_VALUES_RATIO),
        ("gradient", lambda t: overlap.value_and_gradient(t)[1], None),
    ):
        together = interleave({name: partial(one, ts)}, 3)[name]
        one(ts[0])  # compiles it
        alone = once(lambda one=one: np.array([one(t) for t in ts[:single]])).per(single / number)
        report.timing(f"{name}(ts)", together)
        report.timing(f"{name}(t), one by one, extrapolated from {single}", alone)
        report.ratio(f"{name}(t), one by one / {name}(ts)", alone, together, least=least)
        largest = float(np.abs(together.value).max())
        off = float(np.abs(together.value[:single] - alone.value).max())
        report.check(
            off <= 1e-8 * largest,
            f"{name}(ts): within {off / largest:.1g} of one by one, of the largest",
        )


def _updates(report: Report, dim: int, rng: np.random.Generator) -> None:
    """Compare steps of a few balls of a set with new overlaps."""
    count = UPDATED_BALLS // (10 if report.quick else 1)
    a = rng.uniform(-0.3, 0.3, (20, dim)), rng.choice([0.08, 0.1, 0.15], 20)
    centers, radii = rng.uniform(-1.0, 1.0, (count, dim)), rng.choice([0.08, 0.1, 0.15], count)
    overlap = FourierOverlap(a, (centers, radii), tolerance=0.01)
    inner = np.argsort(np.abs(centers).max(axis=1))[: count // 100]
    step = np.full(dim, 0.3)
    stepped = centers.copy()
    stepped[inner] += step
    report.section(
        f"{len(inner)} of {count} balls move, {'plane' if dim == 2 else 'space'}, "
        f"{overlap.frequencies} frequencies"
    )
    calls: dict[str, Callable[[], Any]] = {
        "a new overlap": lambda: FourierOverlap(a, (stepped, radii), tolerance=0.01).spectrum_b,
        "moved": lambda: overlap.moved(inner, step).spectrum_b,
    }
    timings = interleave(calls, 3)
    report.timings(timings)
    anew, moved = timings.values()
    report.ratio("a new overlap / moved", anew, moved, least=10.0)
    off = float(np.abs(anew.value - moved.value).max()) / float(anew.value.flat[0].real)
    report.check(off <= 1e-11, f"moved: within {off:.1g} of F(0) of a new one")


def _placements(report: Report, dim: int, rng: np.random.Generator) -> None:
    """Compare best placements with correlations of rasters by scipy, at the same rotations."""
    few, many = (number // (4 if report.quick else 1) for number in SEARCH_BALLS)
    count = SEARCH_ROTATIONS[dim] // (6 if report.quick else 1)
    a, b = (
        (rng.uniform(-0.5, 0.5, (number, dim)) * side, rng.choice([0.08, 0.1, 0.15], number))
        for number, side in ((few, 0.8), (many, 2.0))
    )
    angles = 2.0 * math.pi * np.arange(count) / count
    turns = (
        Rotation.from_euler("z", angles[:, None])
        if dim == 2
        else Rotation.random(count, random_state=0)
    )
    matrices = turns.as_matrix()[:, :dim, :dim]
    spacing = float(a[1].min()) / RASTER_CELLS_PER_RADIUS

    def raster(centers: Floats, radii: Floats) -> Floats:
        lower = (centers - radii[:, None]).min(axis=0)
        upper = (centers + radii[:, None]).max(axis=0)
        grid = Grid(lower, spacing, np.ceil((upper - lower) / spacing).astype(int))
        return _sample(centers, radii, Bump(2.0), grid)

    def correlate() -> float:
        """Correlate at each rotation; the spectrum of the fixed raster is kept."""
        fixed = raster(*b)
        moved = [raster(a[0] @ matrix.T, a[1]) for matrix in matrices]
        largest = np.max([each.shape for each in moved], axis=0)
        shape = [next_fast_len(int(n), real=True) for n in np.add(fixed.shape, largest) - 1]
        spectrum = rfftn(fixed, shape)
        sums = (irfftn(spectrum * rfftn(np.flip(each), shape), shape) for each in moved)
        return max(float(each.max()) for each in sums) * spacing**dim

    report.section(
        f"best of all positions at {count} rotations, {few} and {many} balls, {'plane' if dim == 2 else 'space'}"
    )
    calls: dict[str, Callable[[], Any]] = {
        "best_placements, rotations as given": lambda: best_placements(
            a, b, matrices, 10, refine_rotations=False
        ),
        "best_placements, rotations refined": lambda: best_placements(a, b, matrices, 10),
        f"rasters of {spacing:g} m, scipy's FFTs": correlate,
    }
    timings = interleave(calls, 1 if report.quick else 3)
    report.timings(timings)
    given, refined, rasters = timings.values()
    report.ratio("rasters / rotations as given", rasters, given)
    score, best = float(given.value.scores[0]), float(refined.value.scores[0])
    off = abs(rasters.value - score) / score
    report.check(
        off <= MAX_SCORE_DIFFERENCE, f"best score of the rasters: within {off:.2g} of ours"
    )
    report.figure(
        "rise of the best score if rotations are refined",
        100.0 * (best / score - 1.0),
        "%",
        least=0.0,
    )


def _verdicts(report: Report, rng: np.random.Generator) -> None:
    """Compare verdicts from balls, singly and in a batch, with FCL on the meshes."""
    bodies = [_draw_body(rng, 3 if report.quick else SUBDIVISIONS) for _ in range(2)]
    sets = [
        decompose(Mesh(*body), kind=kind, number=VERDICT_BALLS // (10 if report.quick else 1))
        for kind in ("outer", "inner")
        for body in bodies
    ]
    overlap = ContactTest(*sets)
    ts = rng.uniform(-0.5, 0.5, (VERDICT_PLACEMENTS, 3)) * VERDICT_SIDE
    moved, fixed = (solids.surface(*body) for body in bodies)

    def meets(t: Floats) -> bool:
        moved.setTranslation(t)
        return solids.meet(moved, fixed)

    def distance(t: Floats) -> float:
        moved.setTranslation(t)
        return float(fcl.distance(moved, fixed))

    report.section(
        f"verdicts about two meshes of {len(bodies[0][1])} triangles, {VERDICT_BALLS} balls each"
    )
    overlap.separated(ts[:2])  # compiles it
    calls: dict[str, Callable[[], Any]] = {
        "separated(ts)": partial(overlap.separated, ts),
        "separated(t), one by one": lambda: [overlap.separated(t) for t in ts],
        "FCL collide": lambda: np.array([meets(t) for t in ts]),
    }
    timings = {name: each.per(len(ts)) for name, each in interleave(calls, 3).items()}
    few = ts[: len(ts) // 30]
    timings["FCL distance"] = once(lambda: [distance(t) for t in few]).per(len(few))
    report.timings(timings)
    for name in ("separated(ts)", "separated(t), one by one"):
        report.ratio(
            f"{name} / FCL collide", timings[name], timings["FCL collide"], most=MAX_COLLIDE_RATIO
        )
        report.ratio(f"FCL distance / {name}", timings["FCL distance"], timings[name], least=1.0)
    verdicts, collides = timings["separated(ts)"].value, timings["FCL collide"].value
    report.figure("clear placements", 100.0 * float((~collides).mean()), "%")
    decided = 100.0 * float((verdicts != Verdict.UNDECIDED).mean())
    report.figure("decided", decided, "%", least=None if report.quick else MIN_DECIDED_PERCENT)
    wrong = (collides & (verdicts == Verdict.MISS)) | (~collides & (verdicts == Verdict.HIT))
    report.check(not wrong.any(), f"{int(wrong.sum())} verdicts are wrong")


def _draw_body(rng: np.random.Generator, subdivisions: int) -> tuple[Floats, Ints]:
    """Draw a dented ellipsoid, up to 2 m across, as vertices and faces."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    points, factors = np.asarray(sphere.vertices), np.ones(len(sphere.vertices))
    for _ in range(6):
        direction = rng.normal(size=3)
        cosines = points @ (direction / np.linalg.norm(direction))
        factors -= rng.uniform(0.2, 0.5) * np.exp(-8.0 * (1.0 - cosines))
    return points * np.maximum(factors, 0.25)[:, None] * rng.uniform(0.6, 1.0, 3), np.asarray(
        sphere.faces
    )
