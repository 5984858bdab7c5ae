"""Overlap of an arm's balls with obstacles, and its derivatives by the joints."""

import numpy as np
import pytest

from cspace import Arm, InputError
from cspace.arms import ArmPenetration
from tests.helpers.balls import integrate_pairs
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import random_arm

FIXED = np.random.default_rng(1).uniform(-0.6, 0.6, (12, 3)), np.full(12, 0.25)
BALLS = np.array([[0.1, 0.0, 0.0], [0.4, 0.05, 0.0]]), np.array([0.15, 0.1])
CARRIERS = ("l1", "l2", "l3", "l4")


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return Arm.from_urdf(random_arm(tmp_path_factory.mktemp("arm"), 1))


def test_penetration_is_the_sum_over_pairs_and_its_gradient_that_of_differences(arm):
    penetration = ArmPenetration(arm, dict.fromkeys(CARRIERS, BALLS), FIXED, tolerance=2e-3)
    q = np.random.default_rng(0).uniform(0.0, 0.3, (2, 3, arm.dof))
    values, gradient = penetration.value_and_gradient(q)
    expected = np.zeros(values.shape)
    for row in np.ndindex(values.shape):
        for name in CARRIERS:
            pose = arm.pose(q[row], name)
            centers = BALLS[0] @ pose[:3, :3].T + pose[:3, 3]
            gaps = np.linalg.norm(centers[:, None] - FIXED[0], axis=2)
            i, j = np.nonzero(gaps < BALLS[1][:, None] + FIXED[1])
            expected[row] += integrate_pairs(2.0, BALLS[1][i], FIXED[1][j], gaps[i, j], 3).sum()
    assert values.max() > 1e-3
    np.testing.assert_allclose(values, expected, atol=0.01 * values.max())
    assert (np.abs(gradient).max(axis=(0, 1)) > 1e-4).all()
    for n, step in enumerate(1e-5 * np.eye(arm.dof)):
        higher, _ = penetration.value_and_gradient(q + step)
        lower, _ = penetration.value_and_gradient(q - step)
        tolerance = 1e-6 * np.abs(gradient).max()
        np.testing.assert_allclose(gradient[..., n], (higher - lower) / 2e-5, atol=tolerance)
    apart, no_slopes = ArmPenetration(
        arm, dict.fromkeys(CARRIERS, BALLS), (FIXED[0] + 5.0, FIXED[1])
    ).value_and_gradient(q)
    assert not apart.any() and not no_slopes.any()
    single, slopes = penetration.value_and_gradient(q[0, 0])
    assert single.shape == () and slopes == pytest.approx(gradient[0, 0])


@refusals(
    "links, obstacles, message",
    ({}, FIXED, "links is empty; there must be one"),
    ({"knee": BALLS}, FIXED, "knee"),
    ({"l3": BALLS}, ([[0.0, 0.0]], 0.2), "obstacles has 2 dimensions"),
)
def test_arm_penetration_refuses_invalid_balls(arm, links, obstacles, message):
    with pytest.raises(InputError, match=message):
        ArmPenetration(arm, links, obstacles)
