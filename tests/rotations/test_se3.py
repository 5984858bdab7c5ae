"""Edges of SE(3), against samples of their cells, and a proof that no path exists."""

import itertools
import math

import numpy as np
import pytest

import cspace
from cspace import FREE, MIXED, Robot, Rotations, Workspace
from tests.helpers.handmade import ALL_FREE, map_of
from tests.helpers.maps import proven_paths
from tests.helpers.placements import draw_quaternions


def interpolate(q0, q1, number):
    """Interpolate an edge like OMPL, shape (number, 7).

    At half a turn, the signs choose the arc.
    """
    t = np.linspace(0.0, 1.0, number)[:, None]
    cosine = q0[3:] @ q1[3:]
    turned = np.repeat(q0[None, 3:], number, axis=0)
    if abs(cosine) <= 1.0 - 1e-9:
        angle = math.acos(abs(cosine))
        there = q1[3:] if cosine >= 0.0 else -q1[3:]
        turned = (np.sin((1.0 - t) * angle) * turned + np.sin(t * angle) * there) / math.sin(angle)
    return np.column_stack([q0[:3] + t * (q1[:3] - q0[:3]), turned])


def drop_near_boundaries(cells, q):
    """Return the configurations away from boundaries of rotation cells."""
    around = q[:, None, 3:] + 1e-8 * np.array(list(itertools.product((-1, 1), repeat=4)))
    around /= np.linalg.norm(around, axis=2, keepdims=True)
    return q[(cells.cell_of(around) == cells.cell_of(q[:, 3:])[:, None]).all(axis=1)]


@pytest.mark.parametrize("n", [1, 2, 5])
def test_edges_find_every_cell_on_their_way(n):
    """Block single cells, however short the way through them."""
    rng = np.random.default_rng(n)
    cells = Rotations.quaternions(n)
    states = np.zeros((len(cells), 1, 1, 1), dtype=np.uint8)
    for _ in range(15):
        a, b = draw_quaternions(cells, rng, 2)
        q0 = np.array([0.5, 0.5, 0.5, *a])
        q1 = np.array([0.5, 0.5, 0.5, *b])
        passed = np.unique(
            cells.cell_of(drop_near_boundaries(cells, interpolate(q0, q1, 2000))[:, 3:])
        )
        beside = np.repeat(interpolate(q0, q1, 300), 30, axis=0)
        beside[:, 3:] += 5e-3 * rng.normal(size=(len(beside), 4))
        beside = cells.cell_of(beside[:, 3:] / np.linalg.norm(beside[:, 3:], axis=1)[:, None])
        states[...] = MIXED
        states[np.union1d(passed, beside)] = FREE
        assert map_of(states, cells, ALL_FREE, 1.0).motion_is_free(q0, q1)
        for cell in passed[:: max(1, len(passed) // 4)]:
            states[...] = FREE
            states[cell] = MIXED
            assert not map_of(states, cells, ALL_FREE, 1.0).motion_is_free(q0, q1)


@pytest.mark.parametrize("norm", [1.0, 1.0 + 0.99e-9])
def test_edges_cover_rotations_at_which_ompl_stays(norm, angle=4e-5):
    """Test nearly equal quaternions, between which OMPL does not rotate."""
    cells = Rotations.quaternions(1)
    states = np.zeros((len(cells), 4, 1, 1), dtype=np.uint8)
    angles = (
        math.pi / 4 + np.array([-0.5, 0.5]) * angle
    )  # to either side of the boundary at a yaw of 90 degrees
    q0, q1 = (
        np.array([x, 0.5, 0.5, 0.0, 0.0, norm * math.sin(a), norm * math.cos(a)])
        for x, a in zip((0.5, 3.5), angles, strict=True)
    )
    states[cells.cell_of(q0[3:]), 3] = MIXED
    space = map_of(states, cells, ALL_FREE, 1.0)
    assert space.motion_is_free(q0, q1) <= space.is_free(interpolate(q0, q1, 300)).all()


def test_disconnection_is_proven_in_six_dimensions():
    """Test cubes that fit through a window or not."""
    occupied = np.zeros((20, 11, 11), dtype=bool)
    occupied[9:11] = True
    occupied[9:11, 3:8, 3:8] = False
    workspace, (left, right) = (
        Workspace.from_array(occupied, 0.1),
        ((0.45, 0.55, 0.55), (1.55, 0.55, 0.55)),
    )
    for side, answer in ((0.7, False), (0.1, True)):
        space = cspace.build(
            workspace, Robot.box((side, side, side)), rotations=Rotations.quaternions(4)
        )
        turn = (0.0, 0.0, 0.0, 1.0)
        assert proven_paths(space, (*left, *turn), (*right, *turn)) is answer
