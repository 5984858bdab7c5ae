"""Conversions between configurations, dial values and poses in space."""

from __future__ import annotations

import numpy as np
import pytest

from cspace.rotations import Rotations
from cspace.view.map_canvas import Poses

POSE_SPACES = [(2, None), (2, 8), (3, None), (3, 8), (3, Rotations.quaternions(2))]


@pytest.mark.parametrize(("dim", "cells"), POSE_SPACES, ids=["R2", "SE2", "R3", "R3xSO2", "SE3"])
def test_poses_and_configurations_round_trip(dim: int, cells: object) -> None:
    rotations, rng = Rotations.of(cells), np.random.default_rng(0)  # type: ignore[arg-type]
    poses = Poses(dim, rotations)
    assert poses.angles == {0: (), 1: ("yaw",), 4: ("roll", "pitch", "yaw")}[len(rotations.names)]
    for _ in range(20):
        q = np.concatenate([rng.normal(size=dim), rotations.sample(np.array([0]), 0.0, rng)[0]])
        values = poses.dial_values(q)
        assert len(values) == dim + len(poses.angles)
        place, wxyz = poses.pose(q)
        assert place.tolist() == [*q[:dim], 0.0][:3]
        for again in (
            poses.configuration_of(values),
            poses.nearest_configuration(place, wxyz),
        ):
            np.testing.assert_allclose(rotations.steps_between(q, again), 0.0, atol=1e-7)


@pytest.mark.parametrize(
    ("degrees", "point", "turned"),
    [
        ((90, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((0, 90, 0), (1, 0, 0), (0, 0, -1)),
        ((0, 0, 90), (1, 0, 0), (0, 1, 0)),
    ],
)
def test_angles_rotate_about_fixed_axes(
    degrees: tuple[float, ...], point: object, turned: object
) -> None:
    rotations = Rotations.quaternions(1)
    q = Poses(3, rotations).configuration_of((0.0, 0.0, 0.0, *degrees))
    np.testing.assert_allclose(rotations.rotation_matrices(q) @ point, turned, atol=1e-12)


def test_yaw_robot_keeps_only_the_yaw_of_a_pose() -> None:
    poses = Poses(3, Rotations.of(8))
    tilted = Poses(3, Rotations.quaternions(1)).configuration_of((1.0, 2.0, 3.0, 20.0, 10.0, 30.0))
    position, wxyz = Poses(3, Rotations.quaternions(1)).pose(tilted)
    np.testing.assert_allclose(
        poses.dial_values(poses.nearest_configuration(position, wxyz))[3:], [30.0], atol=1e-6
    )
