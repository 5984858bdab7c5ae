"""Free yaws against single look-ups and exact geometry."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace import InputError, Robot, Workspace
from tests.helpers.handmade import build_empty
from tests.helpers.placements import collides
from tests.helpers.strategies import examples, seeds

SPACING = 0.1
TURN = 2.0 * math.pi


def build_with_yaw(rng, **options):
    """Build a map of few obstacles and a bar, with even or uneven yaw cells."""
    occupied = rng.random((16, 14)) < rng.choice([0.01, 0.03, 0.1])
    borders = np.sort(rng.uniform(-math.pi, math.pi, 60))
    rotations = int(rng.integers(1, 60)) if rng.random() < 0.5 else [*borders, borders[0] + TURN]
    bar = Robot.rectangle(rng.uniform(0.5, 1.2), 0.05)
    workspace = Workspace.from_array(occupied, SPACING)
    return cspace.build(workspace, bar, rotations=rotations, **options)


@given(seed=seeds, on_border=st.booleans())
@examples(30)
def test_free_yaws_are_those_of_single_look_ups(seed, on_border):
    rng = np.random.default_rng(seed)
    space = build_with_yaw(rng, outside="free")
    for position in rng.uniform(-0.2, 1.7, (8, 2)):
        place = SPACING * np.rint(position / SPACING) if on_border else position
        check_yaws(space, place, rng)


def check_yaws(space, position, rng):
    """Compare the free yaws at a position with look-ups and with the geometry."""
    intervals = space.free_yaws(position)
    assert ((-math.pi <= intervals[:, 0]) & (intervals[:, 0] < math.pi)).all()
    assert (np.diff(intervals.ravel()) > 0.0).all() and np.ptp(intervals, axis=1).sum() <= TURN
    yaws = np.append(rng.uniform(-math.pi, math.pi, 200), intervals.mean(axis=1))
    past_lower = (yaws[:, None] - intervals[:, 0]) % TURN
    is_listed = (past_lower <= np.ptp(intervals, axis=1)).any(axis=1)
    borders = np.append(intervals.ravel(), math.inf)
    from_border = np.abs((yaws[:, None] - borders[None, :-1] + math.pi) % TURN - math.pi)
    is_clear = from_border.min(axis=1, initial=math.inf) > 1e-6
    rows = np.column_stack([np.tile(position, (len(yaws), 1)), yaws])
    assert np.array_equal(is_listed[is_clear], space.is_free(rows)[is_clear])
    assert not collides(space, rows[is_listed]).any()


def test_tiled_maps_give_the_same_yaws(tmp_path):
    rng = np.random.default_rng(3)
    space = build_with_yaw(rng)
    tiled = cspace.build(
        space.workspace, space.robot, rotations=space.rotations, store=tmp_path / "map", tile=8
    )
    for position in rng.uniform(0.0, 1.4, (40, 2)):
        assert np.array_equal(tiled.free_yaws(position), space.free_yaws(position))


@pytest.mark.parametrize(
    "rotations, position, message",
    [
        (None, (1.0, 1.0), "space has the axes x, y; only a robot with a yaw has free yaws"),
        (8, (1.0, 1.0, 0.0), "position has shape"),
        (8, (1.0, math.nan), "position"),
    ],
    ids=["no yaw", "three numbers", "nan"],
)
def test_free_yaws_refuse(rotations, position, message):
    space = build_empty((9, 9), Robot.rectangle(0.3, 0.1), spacing=SPACING, rotations=rotations)
    with pytest.raises(InputError, match=message):
        space.free_yaws(position)
