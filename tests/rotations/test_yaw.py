"""Yaw cells: covering, boundaries and symmetry."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import InputError, Robot
from cspace._rotations import Rotations
from cspace._rotations.base import ANGLE_SLACK, MAX_ANGLE, TWO_PI, wrap_angles
from tests.helpers.handmade import build_empty
from tests.helpers.refusals import refusals
from tests.helpers.strategies import rotation_cells, seeds


@pytest.mark.parametrize("count", [1, 2, 7, 360])
def test_a_count_cuts_the_circle_evenly_around_zero(count):
    cells = Rotations.of(count)
    assert len(cells) == count == len(cells.centers[:, 0])
    assert wrap_angles(cells.centers[:, 0] - TWO_PI / count * np.arange(count)) == pytest.approx(
        np.zeros(count), abs=1e-12
    )
    assert (cells.centers[:, 0] >= -math.pi).all() and (cells.centers[:, 0] < math.pi).all()
    assert cells.covering_angles == pytest.approx(
        np.full(count, math.pi / count), abs=2 * ANGLE_SLACK
    )
    assert cells.is_uniform()


def test_cells_share_a_slice_only_if_their_boundaries_are_a_symmetry_apart():
    square = Robot.rectangle(1.0, 1.0).shape
    even = np.linspace(0.0, TWO_PI, 9)
    for off, slices in ((1e-15, 2), (5e-12, 2), (2e-11, 8), (1e-6, 8)):
        jittered = even + off * np.array([0, 1, 0, 0, 0, 0, 0, 0, 0])
        assert len(np.unique(Rotations.of(jittered)._assign_slices(square))) == slices


@given(rotation_cells(20))
def test_cells_cover_the_circle_without_overlap(value):
    cells = Rotations.of(value)
    boundaries = np.asarray(cells.borders)
    assert (np.diff(boundaries) > 0).all() and boundaries[-1] == boundaries[0] + TWO_PI
    if np.ndim(value):
        assert boundaries == pytest.approx(value, abs=1e-9)
    middles = cells.centers[:, 0] + TWO_PI * np.floor(
        (boundaries[1:] - cells.centers[:, 0]) / TWO_PI
    )
    assert (boundaries[:-1] < middles).all() and (middles < boundaries[1:]).all()
    reach = np.stack([boundaries[1:] - middles, middles - boundaries[:-1]])
    assert (cells.covering_angles >= reach).all()


@given(rotation_cells(20), seeds, st.integers(-3, 3))
def test_a_yaw_belongs_to_the_cell_between_its_boundaries(value, seed, wraps):
    cells = Rotations.of(value)
    boundaries = np.asarray(cells.borders)
    yaw = np.random.default_rng(seed).uniform(boundaries[0], boundaries[-1], 50)
    expected = [max(k for k in range(len(cells)) if boundaries[k] <= one) for one in yaw]
    away = np.abs(yaw[:, None] - boundaries).min(axis=1) > 1e-9
    assert (cells.cell_of(yaw + wraps * TWO_PI) == expected)[away].all()
    # A boundary belongs to the cell above it, but wrapping may round it into either cell.
    above = np.arange(len(cells))
    np.testing.assert_array_equal(cells.cell_of(boundaries[:-1]), above)
    numbers = cells.cell_of(boundaries[:-1] + wraps * TWO_PI)
    assert ((numbers == above) | (numbers == (above - 1) % len(cells))).all()


@refusals(
    "value, message",
    (7.5, "rotations is 7.5"),
    ([0.0], "from 2 to 65537 borders"),
    ([0.0, 1.0, TWO_PI - 1e-6], "must ascend over 6.283185307"),
    ([0.0, 2.0, 1.0, TWO_PI], "do not ascend"),
    ([100.0, 101.0, 100.0 + TWO_PI], "between -2 pi and 2 pi"),
)
def test_boundaries_that_do_not_cover_the_circle_are_refused(value, message):
    with pytest.raises(InputError, match=message):
        build_empty((3, 3), Robot.rectangle(0.1, 0.2), rotations=value)


def test_yaws_too_large_to_be_wrapped_are_refused():
    cells = Rotations.of(8)
    assert 0 <= cells.cell_of(MAX_ANGLE) < 8
    for yaw in (MAX_ANGLE * 1.001, math.nan, -math.inf):
        with pytest.raises(InputError, match="yaw"):
            cells.cell_of(yaw)
