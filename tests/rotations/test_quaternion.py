"""Quaternion cells: covering, volumes, neighbours and symmetry."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspace import InputError, Robot
from cspace._rotations import Rotations
from cspace._rotations.lookup import QUOTIENT_SLACK
from tests.helpers.handmade import half_turns
from tests.helpers.placements import draw_quaternions
from tests.helpers.refusals import refusals

CUTS = [1, 2, 3, 8]


def find_cell(n, q):
    """Return cells and distances to boundaries, by angles."""
    largest = int(np.abs(q).argmax())
    angles = [math.atan(q[k] / q[largest]) for k in range(4) if k != largest]
    parts = [(angle + math.pi / 4) / (math.pi / 2 / n) for angle in angles]
    i, j, k = (min(max(math.floor(part), 0), n - 1) for part in parts)
    return ((largest * n + i) * n + j) * n + k, min(abs(part - round(part)) for part in parts)


@pytest.mark.parametrize("n", CUTS)
def test_quaternions_belong_to_the_cell_of_their_quotients(n):
    cells = Rotations.quaternions(n)
    rng = np.random.default_rng(n)
    assert len(cells) == 4 * n**3 == len(cells.centers)
    q = rng.normal(size=(3000, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    expected, near = map(np.array, zip(*(find_cell(n, one) for one in q), strict=True))
    assert (cells.cell_of(q) == expected)[near > 1e-9].all()
    q = draw_quaternions(cells, rng, 3000)
    first_of_equals = np.abs(q).argmax(axis=1)
    np.testing.assert_array_equal(cells.cell_of(q) // n**3, first_of_equals)
    np.testing.assert_array_equal(cells.cell_of(q), cells.cell_of(-q))
    np.testing.assert_array_equal(cells.cell_of(cells.centers), np.arange(len(cells)))


@pytest.mark.parametrize("n", CUTS)
def test_a_cell_lies_within_its_covering_angle_and_no_smaller_one(n):
    """Compute angles of corners and other points by scipy."""
    cells = Rotations.quaternions(n)
    rng = np.random.default_rng(n)
    widest = np.zeros(len(cells))
    boundaries = np.asarray(cells.borders)
    charts = np.indices((4, n, n, n)).reshape(4, -1)
    centers = Rotation.from_quat(cells.centers)
    for number in range(60):
        position = (
            np.array(np.unravel_index(number, (2, 2, 2)))
            if number < 8
            else rng.choice([0, 0.5, 1], 3) * rng.random()
        )
        low = boundaries[charts[1:]] - QUOTIENT_SLACK
        high = boundaries[charts[1:] + 1] + QUOTIENT_SLACK
        quotients = low + np.broadcast_to(position, (len(cells), 3)).T * (high - low)
        q = np.ones((len(cells), 4))
        for axis in range(4):
            of_chart = charts[0] == axis
            q[np.ix_(of_chart, [k for k in range(4) if k != axis])] = quotients.T[of_chart]
        angles = (centers.inv() * Rotation.from_quat(q)).magnitude()
        assert (angles <= cells.covering_angles).all()
        widest = np.maximum(widest, angles)
    assert widest == pytest.approx(cells.covering_angles, abs=1e-7)


def test_volumes_and_samples_agree_with_uniform_rotations():
    """Test chi-squared at five standard deviations."""
    cells = Rotations.quaternions(3)
    rng = np.random.default_rng(0)
    drawn = Rotation.random(100_000, random_state=1).as_quat()
    from_few_cells = Rotations.quaternions(1)._sample(
        np.repeat(np.arange(4), 25_000), 2.0**-20, rng
    )
    assert cells._volumes.sum() == pytest.approx(1.0)
    for q in (drawn, from_few_cells):
        expected = len(q) * cells._volumes
        bins = np.bincount(cells.cell_of(q), minlength=len(cells))
        assert (np.square(bins - expected) / expected).sum() < len(cells) + 5.0 * math.sqrt(
            2.0 * len(cells)
        )
    chosen = rng.integers(0, len(cells), 5000)
    np.testing.assert_array_equal(cells.cell_of(cells._sample(chosen, 2.0**-20, rng)), chosen)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_neighbors_are_the_cells_across_a_boundary(n):
    """Compare with the cells that small random steps reach."""
    cells = Rotations.quaternions(n)
    rng = np.random.default_rng(n)
    q = Rotation.random(300_000, random_state=n).as_quat()
    steps = q + 2e-2 * rng.normal(size=q.shape)
    here = cells.cell_of(q)
    there = cells.cell_of(steps / np.linalg.norm(steps, axis=1, keepdims=True))
    pairs, often = np.unique(np.stack([here, there])[:, here != there], axis=1, return_counts=True)
    met = dict(zip(zip(*pairs.tolist(), strict=True), often.tolist(), strict=True))
    near = {(cell, other) for cell, row in enumerate(cells.neighbors.tolist()) for other in row}
    assert near <= set(met)
    # Short steps rarely pass through an edge or a corner.
    assert sum(count for pair, count in met.items() if pair not in near) < 0.1 * sum(met.values())


@pytest.mark.parametrize(
    "robot, axes, slices",
    [
        (Robot.box((0.3, 0.2, 0.1)), (0, 1, 2), 4 * 3**3 // 4),
        (Robot.box((0.3, 0.2, 0.1), (0.0, 0.1, 0.0)), (1,), 4 * 3**3 // 2),
        (Robot.from_balls([(0.1, 0.0, 0.0), (0.0, 0.1, 0.0)], 0.1), (), 4 * 3**3),
        (Robot.ball(0.1), (0, 1, 2), 1),
    ],
)
def test_cells_share_slices_if_a_half_turn_maps_the_robot_to_itself(robot, axes, slices):
    cells = Rotations.quaternions(3)
    slice_of = cells._assign_slices(robot.shape)
    assert half_turns(robot.shape) == axes and len(np.unique(slice_of)) == slices
    np.testing.assert_array_equal(np.unique(slice_of), np.arange(slices))
    q = Rotation.random(500, random_state=2)
    for axis in axes:
        turned = q * Rotation.from_rotvec(math.pi * np.eye(3)[axis])
        np.testing.assert_array_equal(
            slice_of[cells.cell_of(q.as_quat())], slice_of[cells.cell_of(turned.as_quat())]
        )


@refusals(
    "call, message",
    (lambda: Rotations.quaternions(65), "must be a whole number from 1 to 64"),
    (lambda: Rotations.quaternions(2.0), "must be a whole number from 1 to 64"),
    (lambda: Rotations.quaternions(2).cell_of((0, 0, 1)), "last axis must be 4 long"),
)
def test_invalid_quaternion_cells_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
