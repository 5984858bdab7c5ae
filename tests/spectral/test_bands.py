"""Ring sums, pair integrals and norms with bounds."""

import math

import numpy as np
import pytest

from cspace.spectral import BallDescriptor, Bump, Verdict
from cspace.spectral.bands import Rings, Spectrum, Terms, separate_all
from cspace.spectral.bump import pair_integrals
from cspace.spectral.pairs import norm_square

pytest.importorskip("finufft")


@pytest.mark.parametrize(
    ("threshold", "verdict", "count"),
    [
        (9.0, Verdict.UNDECIDED, 2),
        (10.01, Verdict.MISS, 1),
        (2.01, Verdict.MISS, 2),
        (1.99, Verdict.UNDECIDED, 2),
        (1.01, Verdict.UNDECIDED, 2),
        (0.99, Verdict.HIT, 2),
    ],
)
def test_separate_decides_within_its_bounds(threshold: float, verdict: Verdict, count: int) -> None:
    """Sum two frequencies, with terms 1 and 0.5."""
    bounds = np.array([9.0, 9.0, 8.25 if verdict is Verdict.UNDECIDED and threshold > 2.0 else 0.5])
    indices = np.array([[0, 0], [1, 0]], dtype=np.int16)
    rings = Rings(np.ones(2), (1, 0), indices, np.arange(2.0), np.ones(2), np.arange(3))
    known = Terms(np.array([1.0, 0.5], dtype=np.complex128), bounds, rings)
    verdicts, counts, sums = separate_all(np.zeros((1, 2)), known, threshold)
    assert (verdicts.tolist(), counts.tolist()) == ([verdict], [count])
    assert sums.tolist() == [[1.0 if count == 1 else 1.5, bounds[count]]]


@pytest.mark.parametrize("dim", [2, 3])
def test_bounds_include_the_full_errors_of_spectra(dim: int) -> None:
    """Reduce every modulus by its full error."""
    rings = Rings.of(np.linspace(1.0, 1.5, dim), (4,) * dim)
    rng = np.random.default_rng(0)
    true = rng.uniform(1.0, 2.0, (2, len(rings.indices))) * np.exp(
        2j * np.pi * rng.random((2, len(rings.indices)))
    )
    errors = 0.3, 0.7
    known = [
        Spectrum(values * (1.0 - error / np.abs(values)), error)
        for values, error in zip(true, errors, strict=True)
    ]
    near, far = (Terms.of(*known, rings, way, 1.5) for way in (0.0, 2.0))
    products = rings.twice / float(np.prod(rings.lengths)) * np.abs(true[0] * true[1])
    off = np.concatenate([[0.0], np.cumsum(rings.sums(products - np.abs(near.products)))])
    left = np.append(np.cumsum(rings.sums(products)[::-1])[::-1], 0.0) + 1.5
    assert (near.bounds >= off + left).all()
    assert near.bounds == pytest.approx(off + left, rel=1e-6)
    steps = np.concatenate([[0.0], np.cumsum(rings.sums(2.0 * np.pi * rings.moduli * products))])
    assert (far.bounds - near.bounds >= 2.0 * steps * (1.0 - 1e-12)).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_bounds_decrease_and_rings_contain_each_frequency_once(dim: int) -> None:
    rng = np.random.default_rng(29)
    balls = [BallDescriptor(rng.uniform(0.0, 1.0, (6, dim)), np.full(6, 0.2)) for _ in range(2)]
    rings = Rings.of(np.linspace(3.0, 4.0, dim), (20, 24, 28)[:dim])
    spectra = [Spectrum.of(each, each.center, rings, 1e-12) for each in balls]
    tails = [made.tail(rings, norm_square(each)) for made, each in zip(spectra, balls, strict=True)]
    bounds = Terms.of(*spectra, rings, 1e-12, math.sqrt(tails[0] * tails[1])).bounds
    assert (np.diff(bounds) <= 1e-9 * bounds[0]).all()
    both = {tuple(k) for k in np.concatenate([rings.indices, -rings.indices]).tolist()}
    assert len(both) == math.prod(rings.counts) == 2 * len(rings.indices) - 1
    ring = np.repeat(np.arange(len(rings.starts) - 1), np.diff(rings.starts))
    last = np.maximum.accumulate([rings.moduli[ring == r].max() for r in range(ring.max() + 1)])
    first = np.array([rings.moduli[ring == r].min() for r in range(ring.max() + 1)])
    assert (first[1:] >= last[:-1] - 1e-9).all()


def test_tail_bounds_the_energy_outside_the_band() -> None:
    """Use few frequencies, and an inaccurate spectrum."""
    balls = BallDescriptor(np.random.default_rng(0).uniform(0.0, 1.0, (6, 2)), np.full(6, 0.1))
    rings = Rings.of(np.full(2, 3.0), (6, 6))
    norm = norm_square(balls)
    best = Spectrum.of(balls, balls.center, rings, 1e-12)
    for accuracy in (1e-2, 1e-4):
        rough = Spectrum.of(balls, balls.center, rings, accuracy)
        tail = rough.tail(rings, (norm[0], 0.125))
        assert rough.error >= 2.0 * accuracy * 0.99 * float(np.abs(best.values[0]))
        moduli, less = np.abs(rough.values), rings.twice / 9.0
        smallest = float((less * np.maximum(moduli - rough.error, 0.0) ** 2).sum())
        assert tail >= best.tail(rings, norm) + 0.125
        assert tail >= norm[0] - float((less * moduli**2).sum()) + 0.125
        assert tail <= norm[0] - smallest + 0.125 + 4.0 * rough.error**2 * len(rings.indices)
    far = BallDescriptor(balls.centers + 1e6, balls.radii)
    assert Spectrum.of(far, far.center, rings, 1e-12).error > 100.0 * best.error


def sum_all_pairs(balls: BallDescriptor) -> tuple[float, float]:
    """Sum the integrals of all pairs, and their error."""
    gaps = np.linalg.norm(balls.centers[:, None] - balls.centers, axis=2)
    first, second = np.meshgrid(balls.radii, balls.radii, indexing="ij")
    close = gaps < first + second
    values, errors = pair_integrals(balls.bump, first[close], second[close], gaps[close], balls.dim)
    return float(values.sum()), float(errors.sum())


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("alpha", [1.0, 2.0, 8.0, math.inf])
def test_pair_integrals_agree_with_adaptive_quadrature(dim: int, alpha: float) -> None:
    bump = Bump(alpha)
    rows = np.array(
        [
            [1.0, 1.0, 0.0],
            [1.0, 1.0, 1.0],
            [0.3, 1.0, 0.1],
            [1.0, 0.4, 0.9],
            [2.0, 0.5, 2.3],
            [1.0, 1.0, 1.8],
        ]
    )
    values, errors = pair_integrals(bump, *rows.T, dim)
    error = errors.max()
    expected = np.array([bump.pair_integral(*row, dim) for row in rows])
    assert np.abs(values - expected).max() <= error + 1e-9 * expected.max()
    assert error < 1e-3 * expected.max()


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("alpha", [2.0, math.inf])
@pytest.mark.parametrize("number", [5, 60])
def test_norm_square_sums_all_pairs(dim: int, alpha: float, number: int) -> None:
    rng = np.random.default_rng(number)
    balls = BallDescriptor(
        rng.uniform(0.0, 1.0, (number, dim)), rng.choice([0.1, 0.25], number), Bump(alpha)
    )
    value, error = norm_square(balls)
    expected, off = sum_all_pairs(balls)
    assert abs(value - expected) <= error + off
    assert error < 1e-6 * value


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("alpha", [0.03, 0.5, 40.0, 976.0, math.inf])
def test_norm_square_bounds_its_error_for_extreme_bumps(dim: int, alpha: float) -> None:
    bump = Bump(alpha)
    for other in (0.2447, 1.7):
        balls = BallDescriptor(np.zeros((2, dim)), np.array([1.0, other]), bump)
        value, error = norm_square(balls)
        pairs = [
            bump.pair_integral(*pair, 0.0, dim)
            for pair in ((1.0, 1.0), (1.0, other), (other, other))
        ]
        expected = pairs[0] + 2.0 * pairs[1] + pairs[2]
        assert abs(value - expected) <= error + 1e-8 * expected
        assert error <= 1e-6 * expected


@pytest.mark.parametrize("dim", [2, 3])
def test_norm_square_handles_many_radii_and_coincident_balls(dim: int) -> None:
    rng = np.random.default_rng(1)
    centers = rng.uniform(0.0, 1.0, (40, dim))
    centers[35:] = centers[34]
    balls = BallDescriptor(centers, np.append(rng.uniform(0.01, 0.3, 30), np.full(10, 0.2)))
    value, error = norm_square(balls)
    expected, off = sum_all_pairs(balls)
    assert abs(value - expected) <= error + off
    assert error < 1e-4 * value


def test_norm_square_does_not_depend_on_the_batch_size(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    balls = BallDescriptor(rng.uniform(0.0, 1.0, (90, 2)), rng.choice([0.1, 0.2, 0.33], 90))
    value, error = norm_square(balls)
    monkeypatch.setattr("cspace.spectral.pairs.MAX_PAIRS_PER_BLOCK", 700)
    again, off = norm_square(balls)
    assert again == pytest.approx(value, rel=1e-9, abs=error + off)


def test_round_radii_only_grows() -> None:
    radii = np.random.default_rng(0).uniform(0.1, 2.0, 50)
    balls = BallDescriptor(np.zeros((50, 2)), radii)
    for number in (1, 2, 3, 8):
        rounded = balls.round_radii(number).radii
        assert (rounded >= radii).all()
        assert len(np.unique(rounded)) <= number
        assert rounded.max() == radii.max()
    assert balls.round_radii(50) is balls


def test_norm_square_adds_the_table_error_of_every_pair() -> None:
    """Use many pairs, interpolated between few distances."""
    rng = np.random.default_rng(0)
    balls = BallDescriptor(rng.uniform(0.0, 0.6, (14, 2)), np.full(14, 0.4), Bump(300.0))
    value, error = norm_square(balls)
    distances = np.linalg.norm(balls.centers[:, None] - balls.centers, axis=2)[
        np.triu_indices(14, 1)
    ]
    near = distances[distances < 0.8]
    alone = Bump(300.0).pair_integral(0.4, 0.4, 0.0, 2)
    expected = 14.0 * alone + 2.0 * sum(
        Bump(300.0).pair_integral(0.4, 0.4, gap, 2) for gap in near.tolist()
    )
    assert len(near) > 64
    assert abs(value - expected) <= error <= 0.02 * expected
    assert error > 1e-7 * expected
