"""Overlaps from spectra, against pairs, quadrature and geometry."""

import math
import pickle
import sys
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace import Grid, InputError, MissingPackageError, Robot
from cspace.spectral import (
    BallDecomposition,
    BallDescriptor,
    Bounds,
    Bump,
    FourierOverlap,
    Separation,
    Verdict,
    intersection,
)
from cspace.spectral.bump import pair_integrals
from cspace.spectral.pairs import norm_square
from tests.helpers import solids
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

pytest.importorskip("finufft")

SIDE = {2: 2.0, 3: 0.9}


def draw_ball_sets(dim: int, seed: int, most: int = 8) -> tuple[Any, Any, np.random.Generator]:
    """Draw balls with few radii and arbitrary frames."""
    rng = np.random.default_rng(seed)

    def balls(number: int, side: float, largest: float) -> tuple[np.ndarray, np.ndarray]:
        radii = rng.choice(rng.uniform(0.08, largest, 3), number)
        return rng.uniform(0.0, side, (number, dim)) + rng.choice([0.0, 1.0, -20.0]), radii

    return (
        balls(rng.integers(1, most), 0.5, 0.2),
        balls(rng.integers(1, 3 * most), SIDE[dim], 0.3),
        rng,
    )


def compute_ideals(a: Any, b: Any, bump: Bump, ts: np.ndarray) -> tuple[np.ndarray, float]:
    """Sum pair integrals by a measured rule."""
    gaps = np.linalg.norm(b[0][None, None] - a[0][:, None] - ts[:, None, None], axis=3)
    firsts, seconds = np.broadcast_to(a[1][:, None], gaps.shape), np.broadcast_to(b[1], gaps.shape)
    close = gaps < firsts + seconds
    values, errors = np.zeros(gaps.shape), np.zeros(gaps.shape)
    values[close], errors[close] = pair_integrals(
        bump, firsts[close], seconds[close], gaps[close], a[0].shape[1]
    )
    return values.sum(axis=(1, 2)), float(errors.sum(axis=(1, 2)).max())


def compute_depth(a: Any, b: Any, ts: np.ndarray) -> np.ndarray:
    """Return the largest penetration of two balls."""
    gaps = np.linalg.norm(b[0][None, None] - a[0][:, None] - ts[:, None, None], axis=3)
    return (a[1][:, None] + b[1] - gaps).max(axis=(1, 2))


def draw_placements(overlap: FourierOverlap, rng: np.random.Generator, number: int) -> np.ndarray:
    return rng.uniform(*overlap.domain, (number, overlap.dim))


# ---- values --------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("alpha", [2.0, math.inf])
def test_value_agrees_with_pairs_of_balls_within_the_bound(dim: int, alpha: float) -> None:
    a, b, rng = draw_ball_sets(dim, 3)
    overlap = FourierOverlap(a, b, bump=Bump(alpha), band=60.0 if dim == 2 else 20.0)
    ts = b[0][rng.integers(len(b[0]), size=12)] - a[0][0] + rng.normal(0.0, 0.1, (12, dim))
    expected, _ = compute_ideals(a, b, Bump(alpha), ts)
    off = np.abs(overlap.value(ts) - expected).max()
    assert off <= overlap.bound + 1e-8 * expected.max()
    assert expected.max() > 1e-3
    if alpha == 2.0:
        assert overlap.bound < (1e-2 if dim == 2 else 0.1) * expected.max()


@pytest.mark.parametrize("dim", [2, 3])
def test_value_is_the_integral_of_the_product_of_descriptors(dim: int) -> None:
    a, b, _ = draw_ball_sets(dim, 5)
    overlap = FourierOverlap(
        BallDescriptor(*a), BallDescriptor(*b), band=None if dim == 2 else 10.0
    )
    t = b[0][0] - a[0][0] + 0.05
    lower, upper = BallDescriptor(*b).bounds
    side = float((upper - lower).max()) / (600 if dim == 2 else 60)
    grid = Grid(lower, side, np.ceil((upper - lower) / side).astype(int))
    product = intersection(
        BallDescriptor(*b).sample(grid), BallDescriptor(a[0] + t, a[1]).sample(grid)
    )
    assert overlap.value(t) == pytest.approx(product.integral, rel=8e-3, abs=overlap.bound)
    assert product.integral > 0.0


@pytest.mark.parametrize("dim", [2, 3])
def test_values_on_a_lattice_agree_with_an_fft_correlation(dim: int) -> None:
    a, b, _ = draw_ball_sets(dim, 7)
    bump = Bump()
    overlap = FourierOverlap(a, b, bump=bump, band=12.0 if dim == 2 else 5.0)
    lengths, counts = np.array(overlap.lengths), overlap.counts
    waves = (
        np.stack(np.meshgrid(*(np.fft.fftfreq(m, 1 / m) for m in counts), indexing="ij"), axis=-1)
        / lengths
    )

    def spectrum(balls: Any) -> np.ndarray:
        moduli = np.linalg.norm(waves, axis=-1)
        factors = {
            r: r**dim * bump.radial_spectrum(r * moduli, dim) for r in set(balls[1].tolist())
        }
        return sum(
            factors[r] * np.exp(-2j * np.pi * (waves @ p))
            for p, r in zip(balls[0], balls[1].tolist(), strict=True)
        )

    volume = float(np.prod(lengths))
    lattice = np.fft.ifftn(spectrum(b) * spectrum(a).conj()).real * math.prod(counts) / volume
    steps = np.stack(np.meshgrid(*(np.arange(m) for m in counts), indexing="ij"), axis=-1) * (
        lengths / counts
    )
    lower, _ = overlap.domain
    ts = lower + np.mod(steps - lower, lengths)
    inside = (ts <= overlap.domain[1]).all(axis=-1)
    assert inside.mean() > 0.9
    assert overlap.value(ts)[inside] == pytest.approx(lattice[inside], abs=1e-9 * lattice.max())
    chosen = np.argwhere(inside)[:: max(1, inside.sum() // 20)]
    one_by_one = [overlap.value(ts[tuple(i)]) for i in chosen]
    assert one_by_one == pytest.approx(
        [lattice[tuple(i)] for i in chosen], abs=1e-9 * lattice.max()
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_gradient_agrees_with_finite_differences(dim: int) -> None:
    a, b, rng = draw_ball_sets(dim, 11)
    overlap = FourierOverlap(a, b, band=20.0)
    ts = draw_placements(overlap, rng, 40) * 0.98
    h = 1e-5
    steps = h * np.eye(dim)
    slopes = [[(overlap.value(t + s) - overlap.value(t - s)) / (2 * h) for s in steps] for t in ts]
    gradients = np.array([overlap.gradient(t) for t in ts])
    assert gradients == pytest.approx(np.array(slopes), abs=1e-6 * np.abs(gradients).max())
    assert overlap.gradient(ts) == pytest.approx(gradients, abs=1e-7 * np.abs(gradients).max())
    assert np.abs(gradients).max() > 1e-3
    for positions in (ts, ts[0]):
        value, gradient = overlap.value_and_gradient(positions)
        assert value == pytest.approx(
            overlap.value(positions), abs=1e-8 * np.abs(overlap.value(ts)).max()
        )
        assert gradient == pytest.approx(
            overlap.gradient(positions), abs=1e-7 * np.abs(gradients).max()
        )


@settings(max_examples=8)
@given(seeds, st.sampled_from([2, 3]))
def test_rotation_gradient_agrees_with_finite_differences(seed: int, dim: int) -> None:
    a, b, rng = draw_ball_sets(dim, seed)
    start = FourierOverlap(a, b, band=8.0)
    overlap = start.rotated(0.4 if dim == 2 else Rotation.from_rotvec([0.3, -0.2, 0.5]))
    ts = draw_placements(overlap, rng, 6)
    h = 1e-5
    axes: list[Any] = [1.0] if dim == 2 else list(np.eye(3))

    def turn(vector: Any) -> Any:
        return overlap.rotated(vector if dim == 2 else Rotation.from_rotvec(vector))

    slopes = [(turn(h * axis).value(ts) - turn(-h * axis).value(ts)) / (2.0 * h) for axis in axes]
    expected = np.stack(slopes, axis=-1) if dim == 3 else slopes[0]
    found = overlap.rotation_gradient(ts)
    scale = np.abs(overlap.gradient(ts)).max() * (1.0 + np.abs(a[0]).max())
    assert found == pytest.approx(expected, abs=1e-4 * scale + 1e-9)
    assert overlap.rotation_gradient(ts[0]) == pytest.approx(found[0], abs=1e-9 * scale)
    many = np.tile(ts, (8, 1))
    assert overlap.rotation_gradient(many) == pytest.approx(
        np.concatenate([found] * 8), abs=1e-6 * scale
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_batches_of_any_shape_agree_with_single_values(dim: int) -> None:
    a, b, rng = draw_ball_sets(dim, 13)
    overlap = FourierOverlap(a, b, band=15.0)
    ts = draw_placements(overlap, rng, 48).reshape(2, 3, 8, dim)
    ts[1, 2, 3] = overlap.domain[1] + 0.5 * np.array(overlap.lengths)
    ts[1, 2, 2] = overlap.domain[0] - 1e6
    values = overlap.value(ts)
    assert values.shape == (2, 3, 8)
    assert values.ravel() == pytest.approx(
        [overlap.value(t) for t in ts.reshape(-1, dim)], abs=1e-8 * values.max()
    )
    assert values[1, 2, 2] == values[1, 2, 3] == overlap.value(ts[1, 2, 3]) == 0.0
    assert (overlap.gradient(ts)[1, 2, 2:4] == 0.0).all()
    assert (overlap.gradient(ts[1, 2, 3]) == 0.0).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_rotated_agrees_with_rotated_balls(dim: int) -> None:
    a, b, rng = draw_ball_sets(dim, 17)
    rotation: Any = 0.7 if dim == 2 else Rotation.from_rotvec([0.3, -0.5, 0.9])
    matrix = (
        np.array([[math.cos(0.7), -math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]])
        if dim == 2
        else rotation.as_matrix()
    )
    overlap = FourierOverlap(a, b, band=15.0)
    turned, anew = overlap.rotated(rotation), FourierOverlap((a[0] @ matrix.T, a[1]), b, band=15.0)
    ts = draw_placements(turned, rng, 40)
    expected, _ = compute_ideals((a[0] @ matrix.T, a[1]), b, Bump(), ts)
    assert np.abs(turned.value(ts) - expected).max() <= turned.bound + 1e-12
    assert np.abs(turned.value(ts) - anew.value(ts)).max() <= turned.bound + anew.bound
    assert (turned.lengths, turned.counts, turned.threshold) == (
        overlap.lengths,
        overlap.counts,
        overlap.threshold,
    )
    back = turned.rotated(matrix.T)
    assert back.value(ts) == pytest.approx(overlap.value(ts), abs=1e-9 * expected.max() + 1e-12)


# ---- what verdicts prove -------------------------------------------------------------------------


@pytest.mark.parametrize("max_pairs", [-1, 2**22], ids=["bands", "pairs"])
@settings(max_examples=4)
@given(
    seeds,
    st.sampled_from([2, 3]),
    st.sampled_from([1.0, 2.0, 4.0, math.inf]),
    st.sampled_from([0.5, 0.05]),
)
def test_verdicts_are_right_about_the_ideal_overlap(
    max_pairs: int, seed: int, dim: int, alpha: float, share: float
) -> None:
    a, b, rng = draw_ball_sets(dim, seed)
    bump = Bump(alpha)
    near = b[0][rng.integers(len(b[0]), size=12)] - a[0][rng.integers(len(a[0]), size=12)]
    ts = near + rng.normal(0.0, 0.15, near.shape)
    expected, error = compute_ideals(a, b, bump, ts)
    threshold = float(np.median(expected))
    overlap = FourierOverlap(a, b, bump=bump, threshold=threshold, tolerance=share)
    with patch("cspace.spectral.overlap.MAX_SUMMED_PAIRS", max_pairs):
        answers = overlap.separated(ts)
        singles = [overlap.separated(t) for t in ts]
    assert (expected[answers.verdict == Verdict.MISS] < threshold + error).all()
    assert (expected[answers.verdict == Verdict.HIT] > threshold - error).all()
    assert (np.abs(answers.overlap - expected) <= answers.bound + error).all()
    assert ((answers.frequencies >= 0) & (answers.frequencies <= 1.2 * overlap.frequencies)).all()
    for k, alone in enumerate(singles):
        assert isinstance(alone.verdict, Verdict)
        assert alone.overlap == pytest.approx(
            answers.overlap[k], abs=alone.bound + answers.bound[k]
        )
        if max_pairs < 0:
            assert alone == Separation(
                *(
                    each[k]
                    for each in (
                        answers.verdict,
                        answers.frequencies,
                        answers.overlap,
                        answers.bound,
                    )
                )
            )


@settings(max_examples=6)
@given(seeds, st.sampled_from([2, 3]))
def test_overlaps_near_the_threshold_are_decided(seed: int, dim: int) -> None:
    """Sample the product of the descriptors; the small band alone does not decide."""
    a, b, rng = draw_ball_sets(dim, seed)
    t = b[0][0] - a[0][0] + rng.normal(0.0, 0.03, dim)
    moved = BallDescriptor(a[0] + t, a[1])
    lower, upper = moved.bounds
    side = float((upper - lower).max()) / (400 if dim == 2 else 80)
    grid = Grid(lower, side, np.ceil((upper - lower) / side).astype(int))
    whole = intersection(BallDescriptor(*b).sample(grid), moved.sample(grid)).integral
    for share, verdict in ((1.02, Verdict.MISS), (0.98, Verdict.HIT)):
        overlap = FourierOverlap(a, b, threshold=share * whole, band=2.0)
        answer = overlap.separated(t)
        assert answer.verdict is verdict
        assert answer.overlap == pytest.approx(whole, rel=0.02, abs=answer.bound)
        assert 0.0 < answer.bound < 1e-4 * whole


@settings(max_examples=5)
@given(seeds, st.sampled_from([2, 3]), st.floats(0.0, 0.2), st.integers(1, 4))
def test_verdicts_about_balls_are_right_near_contact(
    seed: int, dim: int, swell: float, classes: int
) -> None:
    a, b, rng = draw_ball_sets(dim, seed)
    result = FourierOverlap.of_shapes(a, b, a, b, swell=swell, classes=classes, tolerance=0.3)
    rotation = (
        Rotation.random(random_state=seed).as_matrix() if dim == 3 else rng.uniform(-3.0, 3.0)
    )
    overlap = result.rotated(rotation)
    matrix = (
        rotation
        if dim == 3
        else np.array(
            [[math.cos(rotation), -math.sin(rotation)], [math.sin(rotation), math.cos(rotation)]]
        )
    )
    turned = (a[0] @ matrix.T, a[1])
    # Place two balls along the line through their centers: just before and after they touch, and
    # farther away.
    i, j = rng.integers(len(a[1]), size=30), rng.integers(len(b[1]), size=30)
    directions = rng.normal(size=(30, dim))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    gaps = rng.choice([-1.0, 1.0], 30) * 10.0 ** rng.uniform(-9.0, 0.0, 30)
    ts = b[0][j] - turned[0][i] + (a[1][i] + b[1][j] + gaps)[:, None] * directions
    deep = compute_depth(turned, b, ts)
    verdicts = overlap.separated(ts).verdict
    assert (deep[verdicts == Verdict.MISS] < 1e-12).all()
    assert (deep[verdicts == Verdict.HIT] > -1e-12).all()
    assert (verdicts[deep < -1e-12] == Verdict.MISS).all()
    assert (verdicts[deep > 1e-12] == Verdict.HIT).all()


def cover_polygon(shape: Any, side: float) -> tuple[Any, Any]:
    """Return discs around and inside a polygon."""
    lower, upper = np.array(shape.bounds[:2]) - side, np.array(shape.bounds[2:]) + side
    axes = (np.arange(low, high, side) for low, high in zip(lower, upper, strict=True))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    positions = shapely.points(points)
    outer = points[shapely.distance(positions, shape) <= 0.708 * side]
    inside = shapely.contains(shape, positions)
    far = shapely.distance(positions[inside], shape.boundary)
    return (outer, np.full(len(outer), 0.708 * side)), (
        points[inside][far > side],
        far[far > side] * (1.0 - 1e-9),
    )


def test_verdicts_about_polygons_agree_with_shapely() -> None:
    robot = shapely.Polygon([(-0.4, -0.3), (0.5, -0.2), (0.1, 0.0), (0.4, 0.4)])
    hollow = shapely.Polygon(
        [(0, 0), (2, 0), (2, 1.6), (0, 1.6)], [[(0.2, 0.2), (1.7, 0.3), (1.8, 1.4), (0.2, 1.3)]]
    )
    (outer_a, inner_a), (outer_b, inner_b) = cover_polygon(robot, 0.06), cover_polygon(hollow, 0.06)
    result = FourierOverlap.of_shapes(
        outer_a, outer_b, inner_a, inner_b, swell=0.05, tolerance=0.02
    )
    rng = np.random.default_rng(0)
    seen = np.zeros(3, dtype=int)
    for angle in (0.0, 1.0, -2.5):
        overlap = result.rotated(angle)
        ts = draw_placements(overlap, rng, 200)
        turned = shapely.affinity.rotate(robot, angle, origin=(0, 0), use_radians=True)
        collides = np.array(
            [shapely.intersects(hollow, shapely.affinity.translate(turned, *t)) for t in ts]
        )
        verdicts = overlap.separated(ts).verdict
        assert not collides[verdicts == Verdict.MISS].any()
        assert collides[verdicts == Verdict.HIT].all()
        seen += np.bincount(verdicts, minlength=3)
    assert (seen > 50).all()


def test_verdicts_about_meshes_agree_with_fcl() -> None:
    sides = np.array([[0.5, 0.3, 0.2], [0.4, 0.4, 0.6]])
    rng = np.random.default_rng(1)

    def balls_of(box: np.ndarray) -> tuple[Any, Any]:
        side = 0.1
        axes = (np.arange(-s / 2 + side / 2, s / 2, side) for s in box)
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        inner = (box / 2 - np.abs(points)).min(axis=1)
        return (points, np.full(len(points), 0.0867)), (points, inner)

    (outer_a, inner_a), (outer_b, inner_b) = (balls_of(box) for box in sides)
    result = FourierOverlap.of_shapes(
        outer_a, outer_b, inner_a, inner_b, swell=0.06, classes=3, tolerance=0.2
    )
    fixed = solids.box(sides[1])
    seen = np.zeros(3, dtype=int)
    for seed in range(2):
        matrix = Rotation.random(random_state=seed).as_matrix()
        overlap = result.rotated(matrix)
        ts = draw_placements(overlap, rng, 200) * 0.7
        verdicts = overlap.separated(ts).verdict
        for t, verdict in zip(ts, verdicts, strict=True):
            collides = solids.meet(solids.box(sides[0], t, matrix), fixed)
            assert verdict == Verdict.UNDECIDED or collides == (verdict == Verdict.HIT)
        seen += np.bincount(verdicts, minlength=3)
    assert (seen > 20).all()


def test_separated_never_hits_without_inner_balls() -> None:
    a, b, rng = draw_ball_sets(2, 23)
    overlap = FourierOverlap.of_shapes(a, b, swell=0.1, tolerance=0.1)
    verdicts = overlap.separated(draw_placements(overlap, rng, 200)).verdict
    assert set(verdicts.tolist()) == {Verdict.MISS, Verdict.UNDECIDED}


# ---- how few it takes ----------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_most_verdicts_about_overlaps_need_few_frequencies(dim: int) -> None:
    """Expect a median below 10 % for overlaps away from the threshold."""
    rng = np.random.default_rng(2)
    shares: list[float] = []
    for _ in range(4):
        a = rng.uniform(-0.2, 0.2, (6, dim)), np.full(6, 0.2)
        b = rng.uniform(0.0, 4.0 if dim == 2 else 1.6, (8, dim)), np.full(8, 0.2)
        scale = Bump().pair_integral(0.2, 0.2, 0.2, dim)
        overlap = FourierOverlap(a, b, threshold=scale, tolerance=1e-2)
        answers = overlap.separated(draw_placements(overlap, rng, 400))
        decided = (answers.verdict != Verdict.UNDECIDED) & (answers.frequencies > 0)
        assert decided.sum() > 20 and set(answers.verdict[decided].tolist()) == {
            Verdict.MISS,
            Verdict.HIT,
        }
        shares += (answers.frequencies[decided] / overlap.frequencies).tolist()
    assert np.median(shares) < 0.1


def test_verdicts_about_touching_need_no_frequency() -> None:
    a, b = ([[0.0, 0.0], [0.2, 0.0]], 0.1), ([[0.0, 0.0], [3.0, 3.0]], [0.2, 0.3])
    overlap = FourierOverlap(a, b, band=8.0)
    for t in ([1.5, 1.5], [100.0, 0.0], [0.0, -0.45]):
        assert overlap.separated(t) == Separation(Verdict.MISS, 0, 0.0, 0.0)
    assert (
        overlap.separated([0.0, 0.0])
        == overlap.separated([0.0, 0.1])
        == Separation(Verdict.HIT, 0, 0.0, math.inf)
    )
    assert overlap.separated([0.0, 0.3]).verdict is Verdict.UNDECIDED
    assert (
        FourierOverlap(a, b, band=8.0, threshold=1e-3).separated([1.5, 1.5]).verdict is Verdict.MISS
    )


@settings(max_examples=10)
@given(seeds, st.sampled_from([2, 3]))
def test_single_placements_agree_with_batches_for_any_type_and_after_pickling(
    seed: int, dim: int
) -> None:
    a, b, rng = draw_ball_sets(dim, seed)
    overlap = FourierOverlap(a, b, band=4.0).rotated(
        0.3 if dim == 2 else Rotation.from_rotvec([0.1, 0.2, 0.3])
    )
    ts = np.concatenate(
        [draw_placements(overlap, rng, 9), np.round(draw_placements(overlap, rng, 9))]
    )
    expected = overlap.separated(ts)
    for copied in (overlap, pickle.loads(pickle.dumps(overlap))):
        for t, verdict, bound in zip(ts, expected.verdict, expected.bound, strict=True):
            kinds = (
                t,
                t.tolist(),
                tuple(t),
                t.astype(np.longdouble),
                (t.astype(int) if (t == np.round(t)).all() else t),
            )
            for same in kinds:
                assert copied.separated(same) == Separation(Verdict(int(verdict)), 0, 0.0, bound)


@pytest.mark.parametrize("verdict", list(Verdict))
def test_verdicts_are_neither_true_nor_false(verdict: Verdict) -> None:
    with pytest.raises(InputError, match="neither true nor false; compare it"):
        bool(verdict)
    with pytest.raises(InputError):
        assert not FourierOverlap(ONE, ONE, band=9.0).separated([0.0, 0.0]).verdict


# ---- at the edges, and what is refused -----------------------------------------------------------


@pytest.mark.parametrize("alpha", [2.0, math.inf])
def test_nearly_coincident_balls_count_twice(alpha: float) -> None:
    near = [[0.0, 0.0], [1e-17, 0.0]], 0.3
    overlap = FourierOverlap(([[0.0, 0.0]], 0.2), near, bump=Bump(alpha), band=6.0)
    for t in ([0.0, 0.0], [0.3, 0.1], [0.2, -0.3]):
        truth = 2.0 * Bump(alpha).pair_integral(0.2, 0.3, math.hypot(*t), 2)
        assert abs(overlap.value(t) - truth) <= overlap.bound
    value, _ = norm_square(BallDescriptor(*near, Bump(alpha)))
    assert value == pytest.approx(4.0 * Bump(alpha).pair_integral(0.3, 0.3, 0.0, 2), rel=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_bounds_scale_with_tiny_lengths(dim: int) -> None:
    def bound(size: float) -> float:
        balls = np.zeros((1, dim)), 0.2 * size
        return FourierOverlap(balls, balls, band=3.0 / size).bound / size**dim

    assert bound(1e-30) == pytest.approx(bound(1.0), rel=1e-6)
    for size in (1e-60, 1e-90):
        assert bound(size) >= 0.999 * bound(1.0)


def test_long_corridor_limits_the_band() -> None:
    walls = np.column_stack([np.arange(0.0, 1500.0, 0.5), np.zeros(3000)])
    overlap = FourierOverlap(([[0.0, 0.0]], 0.1), (walls, 0.2))
    assert max(overlap.counts) == 2**16 - 1
    assert overlap.separated([700.0, 0.0]).verdict is not Verdict.MISS
    assert overlap.separated([700.0, 0.4]).verdict is not Verdict.HIT


@pytest.mark.parametrize("dim", [2, 3])
def test_repeated_rotations_keep_the_shape(dim: int) -> None:
    rng = np.random.default_rng(0)
    centers = rng.uniform(1.0, 2.0, (6, dim))
    result = overlap = FourierOverlap((centers, 0.2), (np.zeros((1, dim)), 0.3), band=1.0)
    rotation: Any = 0.1 if dim == 2 else Rotation.from_rotvec([0.0, 0.0, 0.1])
    for _ in range(500):
        overlap = overlap.rotated(rotation)
    turned = result.rotated(50.0 if dim == 2 else Rotation.from_rotvec([0.0, 0.0, 50.0]))
    ts = draw_placements(turned, rng, 100)
    assert overlap.value(ts) == pytest.approx(turned.value(ts), abs=1e-11)
    back = overlap.rotated(-50.0 if dim == 2 else Rotation.from_rotvec([0.0, 0.0, -50.0]))
    assert back.value(ts) == pytest.approx(result.value(ts), abs=1e-11)


def test_bound_holds_far_from_the_origin() -> None:
    """Test placements that have fewer digits."""
    far = 2.0**19
    b = [[far, -far], [far + 0.4, -far]], 0.3
    overlap = FourierOverlap(([[far, far]], 0.3), b, tolerance=1e-12)
    near = FourierOverlap(([[0.0, 0.0]], 0.3), (np.array(b[0]) - [far, -far], 0.3), tolerance=1e-12)
    rng = np.random.default_rng(0)
    ts = rng.uniform(-0.4, 0.4, (200, 2))
    step = np.array([0.0, -2.0 * far])
    placed = ts + step
    exact = placed - step
    off = max(abs(overlap.value(p) - near.value(t)) for p, t in zip(placed, exact, strict=True))
    assert off <= overlap.bound + near.bound
    assert overlap.bound > 1e3 * near.bound


def test_repr_tells_balls_frequencies_and_threshold() -> None:
    a, b = ([[0.0, 0.0]], 1.0), ([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.25])
    overlap = FourierOverlap(a, b, band=2.0)
    shown = f"1 and 2 balls in the plane, {overlap.frequencies:,} frequencies"
    assert repr(overlap) == f"FourierOverlap({shown})"
    assert (
        repr(FourierOverlap(a, b, band=2.0, threshold=0.125))
        == f"FourierOverlap({shown}, threshold 0.125)"
    )
    ball = ([[0.0, 0.0, 0.0]], 1.0)
    assert "in space" in repr(FourierOverlap(ball, ball, band=1.0))


def test_empty_batches_return_empty_arrays() -> None:
    overlap = FourierOverlap(([[0.0, 0.0]], 0.2), ([[0.0, 0.0]], 0.2), band=9.0)
    assert overlap.value(np.zeros((0, 2))).shape == (0,)
    assert overlap.gradient(np.zeros((3, 0, 2))).shape == (3, 0, 2)
    assert overlap.separated(np.zeros((0, 2))).verdict.shape == (0,)


def test_overlap_accepts_only_robots_of_balls() -> None:
    overlap = FourierOverlap(Robot.from_balls([[0.0, 0.0]], 0.3), ([[1.0, 1.0]], 0.2), band=10.0)
    assert overlap.value([1.0, 1.0]) > 0.0
    for robot in (Robot.rectangle(1.0, 1.0), 3.0):
        with pytest.raises(InputError, match="decompose"):
            FourierOverlap(robot, ([[1.0, 1.0]], 0.2))


ONE = ([[0.0, 0.0]], 0.2)


SPACE = ([[0.0, 0.0, 0.0]], 0.2)


INNER, OUTER = (
    BallDecomposition([[0.0, 0.0]], 0.2, kind, Bounds(0, 1), Bounds(0, 1), Bounds(0, 1))
    for kind in ("inner", "outer")
)


@refusals(
    "call, message",
    (lambda: FourierOverlap(ONE, SPACE), "all in space"),
    (lambda: FourierOverlap(ONE, ([[0.0, 0.0]], 0.0)), "above zero"),
    (lambda: FourierOverlap(ONE, ([[0.0, math.nan]], 0.1)), "must be finite"),
    (lambda: FourierOverlap(ONE, ONE, threshold=-1.0), "threshold"),
    (lambda: FourierOverlap(ONE, ONE, band=0.0), "band"),
    (lambda: FourierOverlap(ONE, ONE, band=1e5), "lower one"),
    (lambda: FourierOverlap(ONE, ONE, tolerance=0.0), "tolerance"),
    (lambda: FourierOverlap(ONE, ONE, bump=2.0), "Bump"),  # type: ignore[arg-type]
    (lambda: FourierOverlap(ONE, ([[1e9, 0.0]], 0.1)), "nearer"),
    (lambda: FourierOverlap(([[0.0, 0.0]], 1e-120), ([[0.0, 0.0]], 1e-120)), "underflow"),
    (
        lambda: FourierOverlap(BallDescriptor(*ONE, Bump(2.0)), BallDescriptor(*ONE, Bump(3.0))),
        "pass bump=",
    ),
    (lambda: FourierOverlap.of_shapes(ONE, ONE, swell=-0.1), "swell"),
    (lambda: FourierOverlap.of_shapes(ONE, ONE, swell=0.1, classes=0), "classes"),
    (lambda: FourierOverlap.of_shapes(ONE, ONE, ONE, swell=0.1), "both"),
    (lambda: FourierOverlap.of_shapes(ONE, ONE, SPACE, SPACE, swell=0.1), "all in space"),
    (lambda: FourierOverlap.of_shapes(INNER, ONE, swell=0.1), "outer_a is of kind 'inner'"),
    (
        lambda: FourierOverlap.of_shapes(ONE, ONE, INNER, OUTER, swell=0.1),
        "inner_b is of kind 'outer'",
    ),
    (lambda: FourierOverlap((1.0, 2.0), ONE), "shape"),
    (lambda: FourierOverlap((None, None), ONE), "missing"),
    (lambda: FourierOverlap(([[0.0, 0.0]], 1e50), ONE), "reach"),
    (lambda: FourierOverlap(ONE, ONE, band=9.0).value([0.0, 0.0, 0.0]), "last axis"),
    (lambda: FourierOverlap(ONE, ONE, band=9.0).separated([math.inf, 0.0]), "must be finite"),
    (lambda: FourierOverlap(ONE, ONE, band=9.0).rotated(np.diag([1.0, -1.0])), "rotation matrix"),
    (lambda: FourierOverlap(ONE, ONE, band=9.0).rotated(2.0 * np.eye(2)), "rotation matrix"),
    (lambda: FourierOverlap(SPACE, SPACE, band=9.0).rotated(0.5), "Rotation"),
)
def test_overlap_refuses_invalid_arguments(call: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


def test_missing_finufft_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    overlap = FourierOverlap(ONE, ONE, band=9.0)
    monkeypatch.setitem(sys.modules, "finufft", None)
    assert overlap.value([0.1, 0.0]) > 0.0
    with pytest.raises(MissingPackageError, match=r"cspace\[spectral\]"):
        overlap.value(np.zeros((40, 2)))
