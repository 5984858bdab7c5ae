"""Best placements, against brute force, areas of shapely and sampled descriptors."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace import InputError, Rotations
from cspace.spectral import Bump, FourierOverlap, Placements, best_placements
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

pytest.importorskip("finufft")

Balls = tuple[np.ndarray, np.ndarray]


def draw_balls(rng: np.random.Generator, number: int, dim: int, side: float) -> Balls:
    return rng.uniform(0.0, side, (number, dim)), rng.choice([0.15, 0.2, 0.3], number)


def rotation_of(angle: float) -> np.ndarray:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def move(balls: Balls, t: np.ndarray, matrix: np.ndarray) -> Balls:
    return balls[0] @ matrix.T + t, balls[1]


def sum_areas(a: Balls, b: Balls) -> float:
    """Sum the areas common to two discs, by polygons of shapely."""
    first, second = (
        shapely.buffer(shapely.points(centers), radii, quad_segs=64) for centers, radii in (a, b)
    )
    return float(shapely.area(shapely.intersection(first[:, None], second)).sum())


def sum_samples(a: Balls, b: Balls, cells: int) -> float:
    """Integrate the product of two descriptors of ``Bump(2.0)``, by samples."""
    lower, upper = (a[0] - a[1][:, None]).min(axis=0), (a[0] + a[1][:, None]).max(axis=0)
    side = (upper - lower) / cells
    axes = (low + step * (np.arange(cells) + 0.5) for low, step in zip(lower, side, strict=True))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, a[0].shape[1])

    def sample(balls: Balls) -> np.ndarray:
        squares = ((points[:, None] - balls[0]) ** 2).sum(axis=2) / balls[1] ** 2
        return np.where(
            squares < 1.0, np.exp(-squares / np.maximum(1.0 - squares, 1e-300)), 0.0
        ).sum(axis=1)

    return float((sample(a) * sample(b)).sum() * side.prod())


@settings(max_examples=8)
@given(seeds, st.integers(1, 5), st.integers(1, 8))
def test_no_placement_of_brute_force_is_better_in_the_plane(seed: int, few: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = draw_balls(rng, few, 2, 0.6), draw_balls(rng, more, 2, 1.2)
    best = best_placements(a, b, 24, n=3, bump=Bump(math.inf))
    assert len(best.scores) and (np.diff(best.scores) <= 0.0).all()
    for score, bound, t, matrix in zip(*best, strict=True):
        area = sum_areas(move(a, t, matrix), b)
        assert score == pytest.approx(area, rel=2e-3, abs=bound)
    highest = 0.0
    for angle in 2.0 * math.pi * np.arange(12) / 12:
        turned = a[0] @ rotation_of(angle).T
        # Shapes meet most where some centers nearly coincide.
        for i, j in itertools.product(range(few), range(more)):
            highest = max(highest, sum_areas((turned + b[0][j] - turned[i], a[1]), b))
    assert best.scores[0] >= highest * (1.0 - 5e-3)


@pytest.mark.parametrize("dim", [2, 3])
@settings(max_examples=4)
@given(seeds)
def test_a_copy_finds_its_own_pose(dim: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = draw_balls(rng, 6, dim, 1.0)
    if dim == 2:
        matrix = rotation_of(rng.uniform(-3.0, 3.0))
        rotations: Any = matrix @ rotation_of(0.1)
    else:
        matrix = Rotation.random(random_state=seed).as_matrix()
        rotations = Rotation.from_matrix(matrix) * Rotation.from_rotvec(
            0.1 * rng.dirichlet(np.ones(3))
        )
    t = rng.uniform(-5.0, 5.0, dim)
    b = move(a, t, matrix)
    decoys = t + rng.uniform(-4.0 if dim == 2 else -2.5, 4.0 if dim == 2 else 2.5, (40, dim))
    apart = np.linalg.norm(decoys[:, None] - b[0], axis=2).min(axis=1) > 0.8
    among = (
        np.concatenate([b[0], decoys[apart]]),
        np.concatenate([b[1], np.full(apart.sum(), 0.15)]),
    )
    best = best_placements(a, among, rotations, n=1)
    # By Cauchy and Schwarz no score of a copy is above the integral of the squared descriptor.
    whole = sum_samples(b, b, 300 if dim == 2 else 60)
    assert best.scores[0] == pytest.approx(whole, rel=5e-3)
    assert move(a, best.translations[0], best.rotations[0])[0] == pytest.approx(b[0], abs=0.01)


@settings(max_examples=4)
@given(seeds, st.sampled_from([2, 3]), st.floats(0.0, 20.0))
def test_scores_are_overlaps_less_the_penalty(seed: int, dim: int, penalty: float) -> None:
    rng = np.random.default_rng(seed)
    a, b, avoid = (draw_balls(rng, 5, dim, side) for side in (0.5, 1.5, 1.5))
    rotations = 8 if dim == 2 else Rotation.random(4, random_state=seed)
    best = best_placements(a, b, rotations, n=4, avoid=avoid, penalty=penalty)
    wanted, unwanted = (
        FourierOverlap(a, balls, band=12.0 if dim == 2 else 6.0) for balls in (b, avoid)
    )
    for score, bound, t, matrix in zip(*best, strict=True):
        overlaps = wanted.rotated(matrix), unwanted.rotated(matrix)
        expected = overlaps[0].value(t) - penalty * overlaps[1].value(t)
        assert abs(score - expected) <= bound + overlaps[0].bound + penalty * overlaps[1].bound
        moved = move(a, t, matrix)
        sampled = sum_samples(moved, b, 40) - penalty * sum_samples(moved, avoid, 40)
        assert score == pytest.approx(sampled, rel=0.02, abs=0.01)


@pytest.mark.parametrize("dim", [2, 3])
def test_refined_placements_are_peaks_of_the_overlap(dim: int) -> None:
    rng = np.random.default_rng(5)
    a, b = draw_balls(rng, 5, dim, 0.6), draw_balls(rng, 9, dim, 1.5)
    rotations: Any = 6 if dim == 2 else Rotation.random(6, random_state=1)
    best, rough = (
        best_placements(a, b, rotations, n=3, refine_rotations=turn) for turn in (True, False)
    )
    assert best.scores[0] > rough.scores[0]
    overlap = FourierOverlap(a, b, band=12.0 if dim == 2 else 6.0)
    for t, matrix in zip(best.translations, best.rotations, strict=True):
        rotated = overlap.rotated(matrix)
        far = np.linalg.norm(rotated.gradient(t + 0.05))
        assert np.linalg.norm(rotated.gradient(t)) < 0.05 * far
        assert np.linalg.norm(rotated.rotation_gradient(t)) < 0.05 * np.linalg.norm(
            rotated.rotation_gradient(t + 0.05)
        )
    given_ones = Rotations.of(6).centers[:, 0] if dim == 2 else rotations.as_matrix()
    given_ones = [rotation_of(angle) for angle in given_ones] if dim == 2 else given_ones
    assert all(
        np.abs(np.array(given_ones) - matrix).max(axis=(1, 2)).min() < 1e-12
        for matrix in rough.rotations
    )


@settings(max_examples=5)
@given(seeds, st.floats(0.05, 1.0))
def test_placements_are_distinct(seed: int, separation: float) -> None:
    rng = np.random.default_rng(seed)
    a, b = draw_balls(rng, 4, 2, 0.5), draw_balls(rng, 8, 2, 2.0)
    best = best_placements(a, b, 12, n=6, separation=separation, bump=Bump(4.0))
    moved = [
        move(a, t, matrix)[0] for t, matrix in zip(best.translations, best.rotations, strict=True)
    ]
    for one, other in itertools.combinations(moved, 2):
        assert math.sqrt(((one - other) ** 2).sum(axis=1).mean()) >= separation * (1.0 - 1e-9)


def test_more_placements_continue_fewer() -> None:
    rng = np.random.default_rng(2)
    a, b = draw_balls(rng, 4, 2, 0.5), draw_balls(rng, 12, 2, 3.0)
    few, many = (best_placements(a, b, 12, n=n) for n in (1, 5))
    assert len(many.scores) == 5
    assert few.scores[0] == pytest.approx(many.scores[0], rel=1e-3)


def test_configurations_hold_a_yaw_or_a_quaternion() -> None:
    rng = np.random.default_rng(3)
    for dim, rotations in ((2, 7), (3, Rotations.quaternions(1))):
        a, b = draw_balls(rng, 3, dim, 0.5), draw_balls(rng, 3, dim, 1.0)
        best = best_placements(a, b, rotations, n=2)
        q = best.configurations
        assert q[:, :dim] == pytest.approx(best.translations)
        again = (
            [rotation_of(yaw) for yaw in q[:, 2]]
            if dim == 2
            else Rotation.from_quat(q[:, 3:]).as_matrix()
        )
        assert np.array(again) == pytest.approx(best.rotations)


def test_nothing_is_returned_if_no_score_is_positive() -> None:
    disc = ([[0.0, 0.0]], [0.3])
    best = best_placements(disc, disc, [0.0, 1.0], avoid=disc)
    assert isinstance(best, Placements)
    assert best.scores.shape == best.bounds.shape == (0,)
    assert best.configurations.shape == (0, 3)


DISC, BALL = ([[0.0, 0.0]], [0.3]), ([[0.0, 0.0, 0.0]], [0.3])


@refusals(
    "arguments, options, message",
    ((DISC, DISC, 8, 0), {}, "n"),
    ((DISC, BALL, 8), {}, "b has 3 dimensions"),
    ((DISC, DISC, 8), {"avoid": BALL}, "avoid has 3 dimensions"),
    ((DISC, DISC, 8), {"penalty": -1.0}, "penalty"),
    ((DISC, DISC, 8), {"separation": 0.0}, "separation"),
    ((DISC, DISC, 8), {"refine_rotations": 1}, "refine_rotations"),
    ((DISC, DISC, 8), {"band": -1.0}, "band"),
    ((DISC, DISC, 8), {"tolerance": 0.0}, "tolerance"),
    ((DISC, DISC, []), {}, "rotations is empty"),
    ((DISC, DISC, np.diag([1.0, -1.0])), {}, "rotation matrix"),
    ((DISC, DISC, Rotations.quaternions(2)), {}, "in the plane turns"),
    ((BALL, BALL, [0.0, 1.0]), {}, "a Rotation"),
)
def test_best_placements_refuses_invalid_arguments(
    arguments: Any, options: Any, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        best_placements(*arguments, **options)
