"""Interpolation of paths, and bodies of robots in pictures."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace import Robot
from cspace.plot.route import Body, interpolate_path, path_lengths
from cspace.rotations import Rotations
from tests.helpers.strategies import seeds

NONE = Rotations.of(None)
YAW = Rotations.of(1)
QUATERNION = Rotations.quaternions(1)
BOX = Robot.box((0.4, 0.2, 0.6))


def draw_configurations(rng, number, dim, rotations):
    """Draw positions with a yaw, a quaternion or nothing."""
    rows = rng.uniform(-5.0, 5.0, (number, dim + len(rotations.names)))
    if rotations is QUATERNION:
        rows[:, dim:] /= np.linalg.norm(rows[:, dim:], axis=1)[:, None]
    return rows


@given(
    st.sampled_from([(2, NONE), (3, NONE), (2, YAW), (3, YAW), (3, QUATERNION)]),
    st.integers(1, 6),
    seeds,
)
def test_interpolation_has_even_speed_along_the_path(space, number, seed):
    dim, rotations = space
    path = draw_configurations(np.random.default_rng(seed), number, dim, rotations)
    lengths = path_lengths(rotations, path, 0.7)
    assert (np.diff(lengths) >= 0.0).all()
    stations = interpolate_path(rotations, path, np.linspace(0.0, 1.0, 7), 0.7)
    ends = rotations.steps_between(stations[[0, -1]], path[[0, -1]])
    np.testing.assert_allclose(ends, 0.0, atol=1e-7)
    # The path between two stations is at most as long as a straight line of the same share.
    between = np.diff(path_lengths(rotations, stations, 0.7))
    assert (between <= lengths[-1] / 6 + 1e-7).all()


@given(seeds, st.sampled_from([(0, 1), (0, 2), (1, 2)]), st.sampled_from([NONE, YAW, QUATERNION]))
def test_bodies_are_placed_as_scipy_rotates_them(seed, pair, rotations):
    (q,) = draw_configurations(np.random.default_rng(seed), 1, 3, rotations)
    turn = Rotation.identity()
    if rotations is YAW:
        turn = Rotation.from_rotvec([0.0, 0.0, q[3]])
    elif rotations is QUATERNION:
        turn = Rotation.from_quat(q[3:])
    body = Body(BOX, rotations)
    corners = turn.apply(body.points) + q[:3]
    np.testing.assert_allclose(body.transform(body.points, q), corners, atol=1e-12)
    extents = [corners.min(axis=0), corners.max(axis=0)]
    np.testing.assert_allclose(body.extents(q), extents, atol=1e-12)
    (outline,) = body.outlines(q, pair)
    ends = [outline.min(axis=0), outline.max(axis=0)]
    np.testing.assert_allclose(ends, np.array(extents)[:, pair], atol=1e-6)
