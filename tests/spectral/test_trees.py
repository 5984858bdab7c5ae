"""Contacts of ball sets by trees, against exact arithmetic over all pairs."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace.spectral import FourierOverlap, Verdict
from cspace.spectral.trees import build_tree
from tests.helpers.strategies import seeds

Sets = tuple[np.ndarray, np.ndarray]


def compute_exact_depth(a: Sets, b: Sets, t: np.ndarray) -> Fraction:
    """Return the largest ``(r + s)^2 - distance^2`` over all pairs of balls, without rounding."""

    def exact(values: np.ndarray) -> list[Fraction]:
        return [Fraction(value) for value in values.tolist()]

    move = exact(t)
    return max(
        (Fraction(r) + Fraction(s)) ** 2
        - sum((x + m - y) ** 2 for x, m, y in zip(exact(p), move, exact(q), strict=True))
        for p, r in zip(*a, strict=True)
        for q, s in zip(*b, strict=True)
    )


def draw_sets(rng: np.random.Generator, dim: int) -> tuple[Sets, Sets]:
    """Draw balls of radii that differ by orders of magnitude; some coincide."""
    sets = []
    for _ in range(2):
        number = int(rng.integers(1, 9))
        centers = rng.normal(size=(number, dim)) + rng.choice([0.0, 5.0])
        centers[rng.random(number) < 0.2] = centers[0]
        sets.append((centers, 10.0 ** rng.uniform(-3.0, 0.0, number)))
    return sets[0], sets[1]


def draw_contacts(rng: np.random.Generator, a: Sets, b: Sets, number: int) -> np.ndarray:
    """Draw placements at which two balls just touch, or nearly, or not."""
    i, j = rng.integers(len(a[1]), size=number), rng.integers(len(b[1]), size=number)
    directions = rng.normal(size=(number, a[0].shape[1]))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    gaps = rng.choice([-1.0, 0.0, 1.0], number) * 10.0 ** rng.uniform(-17.0, 0.0, number)
    return np.asarray(b[0][j] - a[0][i] + (a[1][i] + b[1][j] + gaps)[:, None] * directions)


@settings(max_examples=40)
@given(seeds, st.sampled_from([2, 3]))
def test_verdicts_about_balls_are_proofs(seed: int, dim: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = draw_sets(rng, dim)
    overlap = FourierOverlap(a, b, band=1.0)
    ts = draw_contacts(rng, a, b, 12)
    for t, verdict in zip(ts, overlap.separated(ts).verdict, strict=True):
        depth = compute_exact_depth(a, b, t)
        assert verdict != Verdict.MISS or depth < 0
        assert verdict != Verdict.HIT or depth > 0
        assert verdict != Verdict.UNDECIDED or abs(depth) < 1e-11


@settings(max_examples=25)
@given(seeds, st.sampled_from([2, 3]))
def test_verdicts_about_shapes_take_outer_balls_for_misses_and_inner_ones_for_hits(
    seed: int, dim: int
) -> None:
    rng = np.random.default_rng(seed)
    a, b = draw_sets(rng, dim)
    inside = (a[0], 0.5 * a[1]), (b[0], 0.5 * b[1])
    overlap = FourierOverlap.of_shapes(a, b, *inside, swell=0.1, classes=2)
    blind = FourierOverlap.of_shapes(a, b, swell=0.1, classes=2)
    ts = np.concatenate([draw_contacts(rng, a, b, 6), draw_contacts(rng, *inside, 6)])
    for t, verdict, less in zip(
        ts, overlap.separated(ts).verdict, blind.separated(ts).verdict, strict=True
    ):
        apart, meets = (
            compute_exact_depth(a, b, t) < 1e-11,
            compute_exact_depth(*inside, t) > -1e-11,
        )
        assert verdict != Verdict.MISS or apart
        assert verdict != Verdict.HIT or meets
        # Fewer balls round less, so that a contact may be decided without the inner ones.
        assert less == Verdict.MISS or verdict != Verdict.MISS
        assert less == Verdict.UNDECIDED or (less == Verdict.MISS and apart)
        assert verdict != Verdict.UNDECIDED or (
            compute_exact_depth(a, b, t) > -1e-11 and compute_exact_depth(*inside, t) < 1e-11
        )


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("number", [1, 2, 3, 7, 100])
def test_nodes_contain_their_balls(dim: int, number: int) -> None:
    rng = np.random.default_rng(number)
    centers, radii = rng.normal(size=(number, dim)), rng.uniform(0.01, 1.0, number)
    tree = build_tree(centers, radii)
    leaves = tree[tree[:, 4] == 1]
    expected = np.column_stack([np.pad(centers, ((0, 0), (0, 3 - dim))), radii])
    assert sorted(map(tuple, leaves[:, :4].tolist())) == sorted(map(tuple, expected.tolist()))
    for k, size in enumerate(tree[:, 4].astype(int).tolist()):
        below = tree[k : k + 2 * size - 1]
        held = below[below[:, 4] == 1]
        assert len(held) == size
        gaps = np.linalg.norm(held[:, :3] - tree[k, :3], axis=1) + held[:, 3]
        assert gaps.max() <= tree[k, 3]
