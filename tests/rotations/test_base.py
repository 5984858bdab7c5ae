"""Arithmetic of rotations of every kind, against scipy."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspace import InputError
from cspace._rotations import Rotations
from cspace._rotations.base import wrap_angles
from tests.helpers.refusals import refusals

NONE = Rotations.of(None)
YAW = Rotations.of(1)
QUATERNION = Rotations.quaternions(1)
RNG = np.random.default_rng(5)
ROTATION_SPACES = {
    "R^2": (NONE, 2),
    "R^3": (NONE, 3),
    "SE(2)": (YAW, 2),
    "R^3 x SO(2)": (YAW, 3),
    "SE(3)": (QUATERNION, 3),
}
EVERY = pytest.mark.parametrize("name", ROTATION_SPACES)


def find_kind(name):
    return ROTATION_SPACES[name][0]


def draw(name, *shape):
    """Draw configurations whose rotations are not canonical."""
    kind, dim = ROTATION_SPACES[name]
    q = RNG.normal(0.0, 4.0, (*shape, dim + len(kind.names)))
    if kind is QUATERNION:
        q[..., 3:] /= np.linalg.norm(q[..., 3:], axis=-1, keepdims=True)
    return q


def to_scipy(name, q):
    """Convert the rotations of configurations to scipy."""
    (kind, dim), flat = ROTATION_SPACES[name], q.reshape(-1, q.shape[-1])
    if kind is QUATERNION:
        return Rotation.from_quat(flat[:, 3:])
    yaw = flat[:, dim] if kind is YAW else np.zeros(len(flat))
    return Rotation.from_rotvec(yaw[:, None] * [0.0, 0.0, 1.0])


@EVERY
def test_matrices_agree_with_scipy(name):
    _, dim = ROTATION_SPACES[name]
    q = draw(name, 3, 5)
    result = find_kind(name).make_matrices(q[..., dim:], dim)
    assert result.shape == (3, 5, dim, dim)
    np.testing.assert_allclose(
        result.reshape(-1, dim, dim), to_scipy(name, q).as_matrix()[:, :dim, :dim], atol=1e-13
    )


@EVERY
def test_steps_rotate_the_shorter_way_at_constant_speed(name):
    kind, (_, dim) = find_kind(name), ROTATION_SPACES[name]
    q0 = draw(name, 40)
    q1 = draw(name, 40)
    steps = kind.steps_between(q0, q1)
    np.testing.assert_allclose(steps[:, :dim], q1[:, :dim] - q0[:, :dim])
    angles = (to_scipy(name, q0).inv() * to_scipy(name, q1)).magnitude()
    np.testing.assert_allclose(np.linalg.norm(steps[:, dim:], axis=1), angles, atol=1e-9)
    for share in (0.0, 0.3, 1.0):
        there = kind.add_steps(q0, share * steps)
        np.testing.assert_allclose(
            there[:, :dim], q0[:, :dim] + share * (q1 - q0)[:, :dim], atol=1e-12
        )
        # A share of the angle is from one end, and the rest from the other.
        for end, part in ((q0, share), (q1, 1.0 - share)):
            apart = (to_scipy(name, end).inv() * to_scipy(name, there)).magnitude()
            np.testing.assert_allclose(apart, part * angles, atol=1e-7)
    assert kind.steps_between(q0[:0], q1[:0]).shape == (0, steps.shape[1])


def test_steps_of_half_a_turn_and_none_are_exact():
    kind = QUATERNION
    still = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    assert (
        not kind.steps_between(still, -still).any() and not kind.steps_between(still, still).any()
    )
    half = kind.steps_between(still, np.array([0.0, 0.0, 0.0, 0.0, 0.6, 0.8, 0.0]))
    np.testing.assert_allclose(np.abs(half), [0.0, 0.0, 0.0, 0.0, 0.6 * math.pi, 0.8 * math.pi])
    tiny = kind.add_steps(still, np.array([0.0, 0.0, 0.0, 1e-12, 0.0, 0.0]))
    np.testing.assert_allclose(kind.steps_between(still, tiny)[3], 1e-12)


@EVERY
def test_canonical_numbers_give_the_same_rotation_and_are_stable(name):
    kind, (_, dim) = find_kind(name), ROTATION_SPACES[name]
    q = draw(name, 50)
    result = kind.make_canonical(
        q * np.where(np.arange(q.shape[1]) < dim, 1.0, 1.0 + 4e-7 * (name == "SE(3)"))
    )
    assert np.array_equal(kind.make_canonical(result), result) and np.array_equal(
        result[:, :dim], q[:, :dim]
    )
    assert ((to_scipy(name, q).inv() * to_scipy(name, result)).magnitude() < 1e-9).all()
    if name == "SE(3)":
        np.testing.assert_allclose(np.linalg.norm(result[:, 3:], axis=1), 1.0, atol=4e-16)


def test_wrapped_yaws_are_unchanged_and_others_are_wrapped():
    angles = np.concatenate(
        [np.linspace(-20.0, 20.0, 997), [-math.pi, math.pi, np.nextafter(math.pi, 0.0)]]
    )
    yaws = wrap_angles(angles)
    assert ((yaws >= -math.pi) & (yaws < math.pi)).all()
    inside = (angles >= -math.pi) & (angles < math.pi)
    assert np.array_equal(yaws[inside], angles[inside])
    np.testing.assert_allclose(np.exp(1j * yaws), np.exp(1j * angles), atol=1e-12)


@refusals(
    "kind, rotation, message",
    (NONE, 0.0, "does not turn"),
    (YAW, math.nan, "rotation"),
    (QUATERNION, 0.3, "given by qx, qy, qz, qw"),
)
def test_invalid_rotations_are_refused(kind, rotation, message):
    with pytest.raises(InputError, match=message):
        kind.check_rotation(rotation)
