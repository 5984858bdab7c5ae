"""Clearance against brute force over all cells."""

import math
from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from checks import draw_configurations
from cspace import FREE, Robot, Workspace
from cspace.clearance import clearance_field
from strategies import bitmaps, robots, seeds


@settings(max_examples=80)
@given(bitmaps(14))
def test_the_transform_is_exact(closed):
    field = clearance_field(closed.astype(np.uint8))
    assert field.some == closed.any()
    if not closed.any():
        return
    cells = np.argwhere(closed)
    for k in np.ndindex(closed.shape):
        gaps = np.maximum(2 * np.abs(cells - k) - 1, 0)
        assert field.squares[k] == np.square(gaps).sum(axis=1).min()


def test_a_large_map_runs_in_threads():
    closed = np.random.default_rng(0).random((300, 280)) < 0.001
    from scipy import ndimage

    doubled = np.repeat(np.repeat(~closed, 3, axis=0), 3, axis=1)  # middles of cells against thirds of cells
    nearest = ndimage.distance_transform_edt(doubled)[1::3, 1::3] / 3
    mine = np.sqrt(clearance_field(closed.astype(np.uint8)).squares) / 2
    assert np.abs(mine - nearest).max() < 1 / 3


@settings(max_examples=40)
@given(robots(0.3), seeds, st.sampled_from(["blocked", "free"]))
def test_clearance_is_a_close_lower_bound(robot, seed, outside):
    rng = np.random.default_rng(seed)
    occupied = rng.random((25, 20)) < rng.choice([0.0, 0.01])
    h = 0.1
    space = cspace.build(Workspace.from_array(occupied, h), robot, outside=outside)
    wide = 60
    k = np.stack(np.meshgrid(*(np.arange(-wide, wide + 20),) * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    closed = k[space.classify(space.grid.center_of(k)) != FREE] * h
    q = draw_configurations(space, rng, 60)
    clearance = space.clearance(q)
    for point, bound, state in zip(q, clearance, space.classify(q), strict=True):
        if state != FREE:
            assert bound == 0.0
        elif len(closed):
            gap = np.maximum(np.maximum(closed - point, point - closed - h), 0)
            distance = np.hypot(*gap.T).min()
            assert bound <= distance + 1e-9
            if space.grid.contains(point):
                assert bound > distance - 1.5 * h
        else:
            assert bound == math.inf


def test_far_outside_the_bound_still_holds():
    occupied = np.zeros((1, 1), bool)
    occupied[0, 0] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1, (0.3, 0.7)), Robot.disc(0.1), outside="free")
    q = (-18660724.11262548, 27488679.34025253)
    outer, _ = space.robot.rasters(0.1)
    h, x, y = Fraction(0.1), Fraction(q[0]), Fraction(q[1])
    box_x = Fraction(0.3) - h * outer.upper[0]
    box_y = Fraction(0.7) + h * (1 - outer.lower[1])
    assert Fraction(space.clearance(q)) ** 2 <= (box_x - x) ** 2 + (y - box_y) ** 2


def test_an_empty_plane_has_no_bound():
    space = cspace.build(Workspace.from_array(np.zeros((3, 3), bool), 0.1), Robot.disc(0.5), outside="free")
    assert space.clearance([(0.1, 0.1), (50.0, 2.0)]).tolist() == [math.inf, math.inf]
