"""Paths as pictures show them: even steps along the way, yaw the shorter way round."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import Robot
from cspace.plot.artists import degrees
from cspace.plot.route import Figurine, along, placed, shorter, travelled

DISC, BOX = Figurine(Robot.disc(0.7)), Figurine(Robot.box((0.4, 0.2, 0.6)))
number = st.floats(-5, 5)


@pytest.mark.parametrize("figurine", [DISC, BOX], ids=["plane", "space"])
@pytest.mark.parametrize("turns", [False, True])
@given(data=st.data())
def test_along_is_on_the_path(figurine: Figurine, turns: bool, data: st.DataObject) -> None:
    dim = figurine.dim
    one = st.tuples(*[number] * dim, *[st.floats(-20, 20)] * turns)
    path = np.array(data.draw(st.lists(one, min_size=1, max_size=6)))
    way = travelled(path, figurine)
    assert (np.diff(way) >= 0).all()
    found = along(path, np.linspace(0.0, 1.0, 7), figurine)
    np.testing.assert_allclose(found[[0, -1], :dim], path[[0, -1], :dim], atol=1e-9)
    np.testing.assert_allclose(shorter(found[[0, -1], dim:] - path[[0, -1], dim:]), 0.0, atol=1e-9)
    # An even speed: as much way lies between any two.
    assert (np.diff(travelled(found, figurine)) <= way[-1] / 6 + 1e-9).all()


def test_yaw_runs_the_shorter_way() -> None:
    way = along(np.array([(0.0, 0.0, 3.0), (0.0, 0.0, -3.0), (0.0, 0.0, 3.0)]), np.linspace(0, 1, 9), DISC)
    assert (np.cos(way[:, 2]) <= np.cos(3.0) + 1e-12).all()
    np.testing.assert_allclose(np.exp(1j * way[[0, 4, 8], 2]), np.exp([3j, -3j, 3j]))


def test_robots_are_placed_and_turned_about_the_vertical() -> None:
    points = np.array([(1.0, 0.0, 0.5)])
    np.testing.assert_allclose(placed(points, np.array([2.0, 3.0, 4.0])), [(3.0, 3.0, 4.5)])
    np.testing.assert_allclose(placed(points, np.array([2.0, 3.0, 4.0, math.pi / 2])), [(2.0, 4.0, 4.5)])
    np.testing.assert_allclose(placed(points[:, :2], np.array([2.0, 3.0, math.pi])), [(1.0, 3.0)])
    np.testing.assert_allclose(BOX.extent(np.array([1.0, 1.0, 1.0, math.pi / 2])), [(0.9, 0.8, 0.7), (1.1, 1.2, 1.3)])
    side = BOX.outlines(np.array([0.0, 0.0, 0.0, math.pi / 2]), (0, 2))
    np.testing.assert_allclose([side[0].min(axis=0), side[0].max(axis=0)], [(-0.1, -0.3), (0.1, 0.3)], atol=1e-6)


def test_large_meshes_are_drawn_with_few_triangles() -> None:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    figurine = Figurine(Robot.mesh(ball))
    assert 200 < len(figurine.triangles) <= 2000
    np.testing.assert_allclose(figurine.extent(np.zeros(3)), ball.bounds, atol=0.02)


@given(st.floats(-50, 50))
def test_degrees_are_wrapped(yaw: float) -> None:
    value = float(degrees(yaw).removesuffix("°"))
    assert -180.0 <= value <= 180.0
    assert math.cos(math.radians(value) - yaw) > 1 - 1e-5
    assert degrees(-1e-9) == "0°"
    assert degrees(-math.pi) == degrees(math.pi) == "180°"
