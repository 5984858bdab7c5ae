"""Interpolation of paths and bodys of robots in pictures."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import Robot
from cspace.plot.route import Body, interpolate_path, path_lengths
from cspace.rotations import Rotations

ROBOTS = {2: Robot.disc(0.7), 3: Robot.box((0.4, 0.2, 0.6))}
NONE, YAW, QUATERNION = Rotations.of(None), Rotations.of(1), Rotations.quaternions(1)
number = st.floats(-5, 5)


@pytest.mark.parametrize(
    ("dim", "rotations"),
    [(2, NONE), (3, NONE), (2, YAW), (3, YAW), (3, QUATERNION)],
    ids=lambda each: str(each),
)
@given(data=st.data())
def test_interpolation_has_even_speed_along_the_path(
    dim: int, rotations: Rotations, data: st.DataObject
) -> None:
    body = Body(ROBOTS[dim], rotations)
    turn = (
        st.tuples(*[number] * 3, st.floats(1, 5))
        if rotations is QUATERNION
        else st.tuples(*[number] * len(rotations.names))
    )
    drawn = data.draw(st.lists(st.tuples(st.tuples(*[number] * dim), turn), min_size=1, max_size=6))
    path = np.array(
        [
            (*position, *np.divide(rest, np.linalg.norm(rest) if len(rest) > 1 else 1.0))
            for position, rest in drawn
        ]
    )
    lengths = path_lengths(rotations, path, body.reach)
    assert (np.diff(lengths) >= 0).all()
    stations = interpolate_path(rotations, path, np.linspace(0.0, 1.0, 7), body.reach)
    np.testing.assert_allclose(
        rotations.steps_between(stations[[0, -1]], path[[0, -1]]), 0.0, atol=1e-7
    )
    # The speed is even, so the path between two stations has the same length.
    between = np.diff(path_lengths(rotations, stations, body.reach))
    assert (between <= lengths[-1] / 6 + 1e-7).all()


def test_interpolation_rotates_the_shorter_way() -> None:
    path = np.array([(0.0, 0.0, 3.0), (0.0, 0.0, -3.0), (0.0, 0.0, 3.0)])
    q = interpolate_path(YAW, path, np.linspace(0, 1, 9), 0.7)
    assert (np.cos(q[:, 2]) <= np.cos(3.0) + 1e-12).all()
    np.testing.assert_allclose(np.exp(1j * q[[0, 4, 8], 2]), np.exp([3j, -3j, 3j]))


def test_body_transforms_points_and_outlines() -> None:
    points, half = np.array([(1.0, 0.0, 0.5)]), math.sqrt(0.5)
    box, turning, free = (Body(ROBOTS[3], kind) for kind in (NONE, YAW, QUATERNION))
    np.testing.assert_allclose(box.transform(points, np.array([2.0, 3.0, 4.0])), [(3.0, 3.0, 4.5)])
    np.testing.assert_allclose(
        turning.transform(points, np.array([2.0, 3.0, 4.0, math.pi / 2])), [(2.0, 4.0, 4.5)]
    )
    np.testing.assert_allclose(
        free.transform(points, np.array([2.0, 3.0, 4.0, 0.0, half, 0.0, half])), [(2.5, 3.0, 3.0)]
    )
    flat = Body(ROBOTS[2], YAW)
    np.testing.assert_allclose(
        flat.transform(points[:, :2], np.array([2.0, 3.0, math.pi])), [(1.0, 3.0)]
    )
    np.testing.assert_allclose(
        turning.extents(np.array([1.0, 1.0, 1.0, math.pi / 2])), [(0.9, 0.8, 0.7), (1.1, 1.2, 1.3)]
    )
    side = turning.outlines(np.array([0.0, 0.0, 0.0, math.pi / 2]), (0, 2))
    np.testing.assert_allclose(
        [side[0].min(axis=0), side[0].max(axis=0)], [(-0.1, -0.3), (0.1, 0.3)], atol=1e-6
    )
    on_its_side = free.outlines(np.array([0.0, 0.0, 0.0, half, 0.0, 0.0, half]), (0, 1))
    np.testing.assert_allclose([np.ptp(on_its_side[0], axis=0)], [(0.4, 0.6)], atol=1e-6)


def test_large_meshes_are_drawn_with_few_triangles() -> None:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    body = Body(Robot.from_mesh(ball), NONE)
    assert 200 < len(body.triangles) <= 4000
    np.testing.assert_allclose(body.extents(np.zeros(3)), ball.bounds, atol=0.03)


@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize(
    "robot", [Robot.ball(0.3), Robot.capsule(0.3, 0.5)], ids=lambda robot: robot.name
)
def test_a_body_without_a_hole_has_one_outline(robot: Robot, pair: tuple[int, int]) -> None:
    assert len(Body(robot, NONE).outlines(np.zeros(3), pair)) == 1
