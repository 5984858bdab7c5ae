"""Overlap of an arm's balls with obstacles, and its derivatives by the joints."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import Arm, InputError
from cspace.arms import ArmPenetration
from cspace.spectral import BallPenetration, Bump
from cspace.spectral.bump import pair_integrals
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds
from tests.helpers.urdfs import joint, link, write_urdf

FIXED = np.array([[1.0, 0.3, 0.1], [1.3, -0.2, 0.0], [0.4, 0.5, -0.2]]), np.array([0.3, 0.2, 0.25])
BALLS = np.array([[0.1, 0.0, 0.0], [0.4, 0.05, 0.0]]), np.array([0.15, 0.1])


def sum_pairs(
    centers: np.ndarray, radii: np.ndarray, fixed: tuple[np.ndarray, np.ndarray]
) -> float:
    """Sum the overlaps of all pairs of balls."""
    gaps = np.linalg.norm(centers[:, None] - fixed[0], axis=2)
    i, j = np.nonzero(gaps < radii[:, None] + fixed[1])
    return float(
        pair_integrals(Bump(2.0), radii[i], fixed[1][j], gaps[i, j], centers.shape[1])[0].sum()
    )


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """Return an arm with a joint of each kind, a mimicking joint, and a branch."""
    bar = ((0.5, 0.1, 0.1), (0.25, 0, 0))
    return Arm.from_urdf(
        write_urdf(
            tmp_path_factory.mktemp("arm"),
            link("base", ((0.1, 0.1, 0.1), (0, 0, -0.5))),
            *[link(name, bar) for name in ("upper", "fore", "hand", "finger", "other")],
            joint("shoulder", "base", "upper", axis=(0, 0, 1), rpy=(0.2, 0.1, 0)),
            joint("elbow", "upper", "fore", at=(0.5, 0, 0), axis=(0, 1, 0)),
            joint(
                "slide",
                "fore",
                "hand",
                at=(0.5, 0, 0),
                axis=(1, 0, 0),
                kind="prismatic",
                limits=(0, 0.3),
            ),
            joint(
                "mimic",
                "hand",
                "finger",
                axis=(0, 0, 1),
                extra='<mimic joint="elbow" multiplier="-0.5"/>',
            ),
            joint("branch", "upper", "other", at=(0.5, 0, 0), axis=(1, 0, 1)),
        )
    )


@pytest.fixture(scope="module")
def penetration(arm: Arm) -> ArmPenetration:
    return ArmPenetration(
        arm, dict.fromkeys(("upper", "hand", "finger", "other"), BALLS), FIXED, tolerance=1e-3
    )


def test_penetration_of_an_arm_is_the_sum_over_its_balls(
    arm: Arm, penetration: ArmPenetration
) -> None:
    q = np.random.default_rng(0).uniform(0.0, 0.3, (2, 20, arm.dof))
    values, _ = penetration.value_and_gradient(q)
    assert values.shape == (2, 20) and values.max() > 1e-3
    for configuration, value in zip(q.reshape(-1, arm.dof), values.ravel(), strict=True):
        expected = 0.0
        for name in ("upper", "hand", "finger", "other"):
            pose = arm.pose(configuration, name)
            expected += sum_pairs(BALLS[0] @ pose[:3, :3].T + pose[:3, 3], BALLS[1], FIXED)
        assert value == pytest.approx(expected, abs=0.01 * values.max())


def test_gradient_by_the_joints_agrees_with_differences(
    arm: Arm, penetration: ArmPenetration
) -> None:
    q = np.random.default_rng(1).uniform(0.0, 0.3, (30, arm.dof))
    _, gradient = penetration.value_and_gradient(q)
    for n, step in enumerate(1e-5 * np.eye(arm.dof)):
        higher, lower = (penetration.value_and_gradient(q + sign * step)[0] for sign in (1.0, -1.0))
        assert gradient[:, n] == pytest.approx(
            (higher - lower) / 2e-5, abs=1e-6 * np.abs(gradient).max()
        )
    assert (np.abs(gradient).max(axis=0) > 1e-4).all()
    single, slopes = penetration.value_and_gradient(q[0])
    assert single.shape == () and slopes == pytest.approx(gradient[0])


@given(dim=st.sampled_from([2, 3]), seed=seeds)
def test_penetration_of_balls_is_the_sum_over_pairs(dim: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    fixed = rng.uniform(-1.0, 1.0, (4, dim)) + 5.0, rng.uniform(0.2, 0.5, 4)
    radii = rng.choice([0.2, 0.3], 3)
    field = BallPenetration(radii, fixed, tolerance=1e-3)
    centers = rng.uniform(-1.5, 1.5, (5, 3, dim)) + 5.0
    values, gradient = field.value_and_gradient(centers)
    ideal = [sum_pairs(each, radii, fixed) for each in centers]
    assert values == pytest.approx(ideal, abs=0.01 * (0.2**dim))
    step = 1e-5 * rng.normal(size=centers.shape)
    change = (
        field.value_and_gradient(centers + step)[0] - field.value_and_gradient(centers - step)[0]
    )
    assert change == pytest.approx(2.0 * (gradient * step).sum(axis=(1, 2)), abs=1e-8)
    far, zeros = field.value_and_gradient(centers + 100.0 * np.ones(dim))
    assert not far.any() and not zeros.any()


@refusals(
    "links, obstacles, message",
    ({}, FIXED, "links is empty"),
    ({"knee": BALLS}, FIXED, "knee"),
    ({"hand": (BALLS[0][:, :2], BALLS[1])}, FIXED, "hand has 2 dimensions"),
    ({"hand": BALLS}, ([[0.0, 0.0]], 0.2), "obstacles has 2 dimensions"),
    ({"hand": BALLS}, ([[0.0, 0.0, 0.0]], -1.0), "radii"),
    ({"hand": 3}, FIXED, "hand is a int"),
)
def test_arm_penetration_refuses_invalid_balls(
    arm: Arm, links: object, obstacles: object, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        ArmPenetration(arm, links, obstacles)  # type: ignore[arg-type]


def test_ball_penetration_refuses_other_shapes() -> None:
    field = BallPenetration([0.1, 0.2], ([[0.0, 0.0]], 0.5))
    for wrong in (np.zeros((2, 3)), np.zeros((3, 2)), np.zeros(2), np.full((2, 2), np.nan)):
        with pytest.raises(InputError, match="centers"):
            field.value_and_gradient(wrong)
    with pytest.raises(InputError, match="radii"):
        BallPenetration([0.0], ([[0.0, 0.0]], 0.5))
