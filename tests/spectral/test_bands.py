"""Overlaps of ball sets at the edges: far away, tiny, coincident, long, often turned; and what is refused."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspace import InputError, MissingPackageError, Robot
from cspace.spectral import BallDescriptor, Bounds, Bump, FourierOverlap, Spheres, Verdict
from cspace.spectral.bands import Rings, Spectrum, Terms, norm_square, separate

pytest.importorskip("finufft")

DIMS = [2, 3]


@pytest.mark.parametrize("alpha", [2.0, math.inf])
def test_balls_that_all_but_coincide_are_two(alpha: float) -> None:
    near = [[0.0, 0.0], [1e-17, 0.0]], 0.3
    overlap = FourierOverlap(([[0.0, 0.0]], 0.2), near, bump=Bump(alpha), band=6.0)
    for t in ([0.0, 0.0], [0.3, 0.1], [0.2, -0.3]):
        truth = 2.0 * Bump(alpha).pair_integral(0.2, 0.3, math.hypot(*t), 2)
        assert abs(overlap.value(t) - truth) <= overlap.bound
    value, _ = norm_square(BallDescriptor(*near, Bump(alpha)))
    assert value == pytest.approx(4.0 * Bump(alpha).pair_integral(0.3, 0.3, 0.0, 2), rel=1e-9)


@pytest.mark.parametrize("dim", DIMS)
def test_bounds_scale_with_the_lengths_however_small(dim: int) -> None:
    def bound(size: float) -> float:
        balls = np.zeros((1, dim)), 0.2 * size
        return FourierOverlap(balls, balls, band=3.0 / size).bound / size**dim

    assert bound(1e-30) == pytest.approx(bound(1.0), rel=1e-6)
    for size in (1e-60, 1e-90):
        assert bound(size) >= 0.999 * bound(1.0)


def test_a_long_corridor_gets_a_band_of_its_own() -> None:
    walls = np.column_stack([np.arange(0.0, 1500.0, 0.5), np.zeros(3000)])
    overlap = FourierOverlap(([[0.0, 0.0]], 0.1), (walls, 0.2))
    assert max(overlap.counts) == 2**16 - 1
    assert overlap.separated([700.0, 0.0]).verdict is not Verdict.MISS
    assert overlap.separated([700.0, 0.4]).verdict is not Verdict.HIT


@pytest.mark.parametrize("dim", DIMS)
def test_turns_of_turns_keep_the_shape(dim: int) -> None:
    rng = np.random.default_rng(0)
    centers = rng.uniform(1.0, 2.0, (6, dim))
    made = overlap = FourierOverlap((centers, 0.2), (np.zeros((1, dim)), 0.3), band=1.0)
    turn: Any = 0.1 if dim == 2 else Rotation.from_rotvec([0.0, 0.0, 0.1])
    for _ in range(500):
        overlap = overlap.rotated(turn)
    ways = [np.linalg.norm(o._a.centers[:, None] - o._a.centers, axis=2) for o in (made, overlap)]
    assert np.abs(ways[1] - ways[0]).max() <= 2.0**-50 * 4.0
    once = made.rotated(50.0 if dim == 2 else Rotation.from_rotvec([0.0, 0.0, 50.0]))
    assert overlap._a.centers == pytest.approx(once._a.centers, abs=1e-11)


def test_the_stated_bound_holds_far_from_the_origin() -> None:
    """Where the balls lie far from the origin, a placement itself is known to fewer digits."""
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


def test_no_placements_have_no_values() -> None:
    overlap = FourierOverlap(([[0.0, 0.0]], 0.2), ([[0.0, 0.0]], 0.2), band=9.0)
    assert overlap.value(np.zeros((0, 2))).shape == (0,)
    assert overlap.gradient(np.zeros((3, 0, 2))).shape == (3, 0, 2)
    assert overlap.separated(np.zeros((0, 2))).verdict.shape == (0,)


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
def test_sums_decide_beyond_all_that_is_not_known(threshold: float, verdict: Verdict, count: int) -> None:
    """One frequency with the term 1, one with 0.5; and bounds of what is left, rounding included."""
    bounds = np.array([9.0, 9.0, 8.25 if verdict is Verdict.UNDECIDED and threshold > 2.0 else 0.5])
    rings = np.array([[0, 0], [1, 0]], dtype=np.int16), np.array([0, 1, 2]), np.array([[0, 0], [1, 0]]), np.ones(2)
    known = Terms(np.array([1.0, 0.5], dtype=np.complex128), bounds, *rings)
    found = separate(np.zeros(2), known, threshold, np.empty((2, 3), dtype=np.complex128))
    assert found == (verdict, count, 1.0 if count == 1 else 1.5, bounds[count])


@pytest.mark.parametrize("dim", DIMS)
def test_errors_of_spectra_are_in_the_bounds_to_the_full(dim: int) -> None:
    """Where every modulus is too small, by as much as may be, what is known of sums and of the rest is just right."""
    rings = Rings.of(np.linspace(1.0, 1.5, dim), (4,) * dim)
    rng = np.random.default_rng(0)
    true = rng.uniform(1.0, 2.0, (2, len(rings.indices))) * np.exp(2j * np.pi * rng.random((2, len(rings.indices))))
    errors = 0.3, 0.7
    known = [
        Spectrum(values * (1.0 - error / np.abs(values)), error, beyond)
        for values, error, beyond in zip(true, errors, (0.25, 9.0), strict=True)
    ]
    near, far = (Terms.of(*known, rings, way) for way in (0.0, 2.0))
    products = rings.twice / float(np.prod(rings.lengths)) * np.abs(true[0] * true[1])
    off = np.concatenate([[0.0], np.cumsum(rings.sums(products - np.abs(near.products)))])
    left = np.append(np.cumsum(rings.sums(products)[::-1])[::-1], 0.0) + 1.5
    assert (near.bounds >= off + left).all()
    assert near.bounds == pytest.approx(off + left, rel=1e-6)
    steps = np.concatenate([[0.0], np.cumsum(rings.sums(2.0 * np.pi * rings.moduli * products))])
    assert (far.bounds - near.bounds >= 2.0 * steps * (1.0 - 1e-12)).all()


def test_what_is_beyond_the_band_is_never_understated() -> None:
    """A band of a few frequencies, and a spectrum whose accuracy leaves its energy unsure."""
    balls = BallDescriptor(np.random.default_rng(0).uniform(0.0, 1.0, (6, 2)), np.full(6, 0.1))
    rings = Rings.of(np.full(2, 3.0), (6, 6))
    norm = norm_square(balls)
    best = Spectrum.of(balls, balls.middle, rings, 1e-12, norm)
    for accuracy in (1e-2, 1e-4):
        rough = Spectrum.of(balls, balls.middle, rings, accuracy, (norm[0], 0.125))
        assert rough.error >= 2.0 * accuracy * 0.99 * float(np.abs(best.values[0]))
        moduli, less = np.abs(rough.values), rings.twice / 9.0
        least = float((less * np.maximum(moduli - rough.error, 0.0) ** 2).sum())
        assert rough.beyond >= best.beyond + 0.125
        assert rough.beyond >= norm[0] - float((less * moduli**2).sum()) + 0.125
        assert rough.beyond <= norm[0] - least + 0.125 + 4.0 * rough.error**2 * len(rings.indices)
    far = BallDescriptor(balls.centers + 1e6, balls.radii)
    assert Spectrum.of(far, far.middle, rings, 1e-12, norm).error > 100.0 * best.error


# ---- what is refused -------------------------------------------------------------------------------------------------


def test_robots_of_balls_serve_and_others_are_refused() -> None:
    overlap = FourierOverlap(Robot.balls([[0.0, 0.0]], 0.3), ([[1.0, 1.0]], 0.2), band=10.0)
    assert overlap.value([1.0, 1.0]) > 0.0
    for robot in (Robot.rectangle(1.0, 1.0), 3.0):
        with pytest.raises(InputError, match="decompose"):
            FourierOverlap(robot, ([[1.0, 1.0]], 0.2))


ONE = ([[0.0, 0.0]], 0.2)
SPACE = ([[0.0, 0.0, 0.0]], 0.2)
INNER, OUTER = (
    Spheres([[0.0, 0.0]], 0.2, kind, Bounds(0, 1), Bounds(0, 1), Bounds(0, 1)) for kind in ("inner", "outer")
)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: FourierOverlap(ONE, SPACE), "all in space"),
        (lambda: FourierOverlap(ONE, ([[0.0, 0.0]], 0.0)), "above zero"),
        (lambda: FourierOverlap(ONE, ([[0.0, math.nan]], 0.1)), "NaN"),
        (lambda: FourierOverlap(ONE, ONE, threshold=-1.0), "threshold"),
        (lambda: FourierOverlap(ONE, ONE, band=0.0), "band"),
        (lambda: FourierOverlap(ONE, ONE, band=1e5), "lower one"),
        (lambda: FourierOverlap(ONE, ONE, tolerance=0.0), "tolerance"),
        (lambda: FourierOverlap(ONE, ONE, accuracy=1e-30), "tolerance"),
        (lambda: FourierOverlap(ONE, ONE, bump=2.0), "Bump"),  # type: ignore[arg-type]
        (lambda: FourierOverlap(ONE, ([[1e9, 0.0]], 0.1)), "nearer"),
        (lambda: FourierOverlap(BallDescriptor(*ONE, Bump(2.0)), BallDescriptor(*ONE, Bump(3.0))), "pass bump="),
        (lambda: FourierOverlap.of_shapes(ONE, ONE, swell=0.0), "swell"),
        (lambda: FourierOverlap.of_shapes(ONE, ONE, swell=1e-7), "larger swell"),
        (lambda: FourierOverlap.of_shapes(ONE, ONE, swell=0.1, classes=0), "classes"),
        (lambda: FourierOverlap.of_shapes(ONE, ONE, ONE, swell=0.1), "both"),
        (lambda: FourierOverlap.of_shapes(ONE, ONE, SPACE, SPACE, swell=0.1), "all in space"),
        (lambda: FourierOverlap.of_shapes(INNER, ONE, swell=0.1), "outer_a is of kind 'inner'"),
        (lambda: FourierOverlap.of_shapes(ONE, ONE, INNER, OUTER, swell=0.1), "inner_b is of kind 'outer'"),
        (lambda: FourierOverlap((1.0, 2.0), ONE), "shape"),
        (lambda: FourierOverlap((None, None), ONE), "missing"),
        (lambda: FourierOverlap(([[0.0, 0.0]], 1e50), ONE), "reach"),
        (lambda: FourierOverlap(ONE, ONE, band=9.0).value([0.0, 0.0, 0.0]), "last axis"),
        (lambda: FourierOverlap(ONE, ONE, band=9.0).separated([math.inf, 0.0]), "infinities"),
        (lambda: FourierOverlap(ONE, ONE, band=9.0).rotated(np.diag([1.0, -1.0])), "mirrors"),
        (lambda: FourierOverlap(ONE, ONE, band=9.0).rotated(2.0 * np.eye(2)), "stretches"),
        (lambda: FourierOverlap(SPACE, SPACE, band=9.0).rotated(0.5), "Rotation"),
    ],
)
def test_other_values_are_refused(call: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()


def test_without_finufft_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    overlap = FourierOverlap(ONE, ONE, band=9.0)
    monkeypatch.setitem(sys.modules, "finufft", None)
    assert overlap.value([0.1, 0.0]) > 0.0
    with pytest.raises(MissingPackageError, match=r"cspace\[spectral\]"):
        overlap.value(np.zeros((40, 2)))
