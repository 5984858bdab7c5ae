"""Blocks, which show the most important class of their cells."""

from __future__ import annotations

import numpy as np
import pytest

import cspace
from cspace.plot.scene import CellClass, classify_cells
from cspace.view import _blocks
from cspace.view._blocks import Cells


@pytest.fixture(
    params=[
        ((23, 17), cspace.Robot.rectangle(0.3, 0.1), 6),
        ((11, 9, 7), cspace.Robot.box((0.2, 0.1, 0.1)), cspace.Rotations.quaternions(1)),
    ],
    ids=["SE2", "SE3"],
)
def parts(request):
    shape, robot, rotations = request.param
    occupied = np.random.default_rng(0).random(shape) < 0.04
    return cspace.Workspace.from_array(occupied, 0.1), robot, rotations


def reduce_by_brute_force(classes, side):
    """Return the largest class in each block."""
    sides = np.broadcast_to(side, classes.ndim)
    largest = np.empty(-(-np.array(classes.shape) // sides), dtype=np.uint8)
    for index in np.ndindex(largest.shape):
        first = sides * np.array(index)
        largest[index] = classes[*map(slice, first, first + sides)].max()
    return largest


@pytest.mark.parametrize("side", [1, 3])
def test_blocks_show_the_largest_class_until_they_are_invalidated(parts, side, monkeypatch):
    workspace, robot, rotations = parts
    space = cspace.build(workspace, robot, rotations=rotations)
    monkeypatch.setattr(_blocks, "MAX_BLOCKS", space.grid.size // side**space.grid.dim + 1)
    cells = Cells(space, 1.0)
    last = len(space.rotations) - 1
    at_last = classify_cells(space, space.rotations.centers[last])
    for cell, classes in ((last, at_last), (None, 7 * workspace.outer)):
        assert cells.scene.side == side
        expected = np.atleast_3d(reduce_by_brute_force(classes, side))
        np.testing.assert_array_equal(cells.make_blocks(cell), expected)
    before = cells.make_blocks(last)
    space.update(
        np.ones((1,) * space.grid.dim, dtype=bool), np.argwhere(at_last == CellClass.OPEN)[0]
    )
    assert cells.make_blocks(last) is before
    cells.invalidate()
    assert (cells.make_blocks(last) != before).any()


def test_a_tiled_map_is_drawn_as_an_overview(parts, tmp_path, monkeypatch):
    workspace, robot, rotations = parts
    space = cspace.build(workspace, robot, rotations=rotations)
    tiled = cspace.build(workspace, robot, rotations=rotations, store=tmp_path / "m", tile=8)
    exact = Cells(space, 1.0).make_blocks(0)
    np.testing.assert_array_equal(Cells(tiled, 1.0).make_blocks(0), exact)
    monkeypatch.setattr(_blocks, "MAX_BLOCKS", space.grid.size // 2**space.grid.dim)
    coarse = Cells(tiled, 1.0)
    side = round(coarse.drawn.grid.spacing / space.grid.spacing)
    assert side > 1
    is_open = (
        reduce_by_brute_force(exact, np.where(np.array(exact.shape) > 1, side, 1)) == CellClass.OPEN
    )
    assert (coarse.make_blocks(0)[~is_open] != CellClass.OPEN).all()
