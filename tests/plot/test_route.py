"""Bodies of robots in pictures."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import Robot
from cspace._rotations import Rotations
from cspace.plot.scene import DrawnRobot
from tests.helpers.regions import rotations_of
from tests.helpers.strategies import seeds

BOX = Robot.box((0.4, 0.2, 0.6))


@pytest.mark.parametrize("rotations", [None, 1, Rotations.quaternions(1)], ids=["R3", "yaw", "SE3"])
@given(seeds, st.sampled_from([(0, 1), (0, 2), (1, 2)]))
def test_bodies_are_placed_as_scipy_rotates_them(rotations, seed, pair):
    cells = Rotations.of(rotations)
    q = np.random.default_rng(seed).uniform(-5.0, 5.0, 3 + len(cells.names))
    if len(cells.names) == 4:
        q[3:] /= np.linalg.norm(q[3:])
    body = DrawnRobot(BOX, cells)
    corners = rotations_of(q[np.newaxis], 3).apply(body.points) + q[:3]
    np.testing.assert_allclose(body.transform(body.points, q), corners, atol=1e-12)
    extents = [corners.min(axis=0), corners.max(axis=0)]
    np.testing.assert_allclose(body.extents(q), extents, atol=1e-12)
    (outline,) = body.outlines(q, pair)
    ends = [outline.min(axis=0), outline.max(axis=0)]
    np.testing.assert_allclose(ends, np.array(extents)[:, pair], atol=1e-6)
