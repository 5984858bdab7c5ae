"""Blocks, which show the most important class of their cells."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cspace
from cspace.plot.artists import OPEN, classify_cells
from cspace.view import blocks
from cspace.view.blocks import Cells

WHOLE = {2: (23, 17), 3: (11, 9, 7)}


@pytest.fixture(
    params=[(2, None), (2, 6), (3, None), (3, cspace.Rotations.quaternions(1))],
    ids=["R2", "SE2", "R3", "SE3"],
)
def parts(request: pytest.FixtureRequest) -> tuple[cspace.Workspace, cspace.Robot, Any]:
    dim, rotations = request.param
    occupied = np.random.default_rng(dim).random(WHOLE[dim]) < 0.04
    robot = cspace.Robot.rectangle(0.3, 0.1) if dim == 2 else cspace.Robot.box((0.2, 0.1, 0.1))
    return cspace.Workspace.from_array(occupied, 0.1), robot, rotations


def reduce_by_brute_force(classes: Any, side: int) -> Any:
    """Return the largest class in each block."""
    starts = [range(0, n, side) for n in classes.shape]
    largest = np.empty([len(axis) for axis in starts], dtype=np.uint8)
    for index, corner in zip(np.ndindex(largest.shape), itertools.product(*starts), strict=True):
        largest[index] = classes[tuple(slice(low, low + side) for low in corner)].max()
    return largest


@pytest.mark.parametrize("side", [1, 3])
def test_blocks_show_the_largest_class(
    parts: Any, side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace, robot, rotations = parts
    space = cspace.build(workspace, robot, rotations=rotations)
    monkeypatch.setattr(blocks, "MAX_BLOCKS", space.grid.size // (side**space.grid.dim) + 1)
    held, last = Cells(space), len(space.rotations) - 1
    rotation = space.rotations.centers[last]
    for seen, classes in ((last, classify_cells(space, rotation)), (None, 7 * workspace.outer)):
        assert held.at(seen).side == side
        np.testing.assert_array_equal(held.at(seen).classes, reduce_by_brute_force(classes, side))


def test_invalidate_refreshes_blocks(parts: Any) -> None:
    workspace, robot, rotations = parts
    space = cspace.build(workspace, robot, rotations=rotations)
    held = Cells(space)
    before = held.at(0).classes
    space.update(
        np.ones((1,) * space.grid.dim, dtype=bool), np.argwhere(before == OPEN)[0].tolist()
    )
    assert held.at(0).classes is before
    held.invalidate()
    assert (held.at(0).classes != before).any()


def test_tiled_map_is_drawn_as_an_overview(
    parts: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace, robot, rotations = parts
    stored = cspace.build(
        workspace, robot, rotations=rotations, store=tmp_path / "map.zarr", tile=8
    )
    held = Cells(cspace.build(workspace, robot, rotations=rotations))
    last = len(stored.rotations) - 1
    for seen in (last, None):
        np.testing.assert_array_equal(Cells(stored).at(seen).classes, held.at(seen).classes)
    monkeypatch.setattr(blocks, "MAX_BLOCKS", stored.grid.size // 2**stored.grid.dim)
    far = Cells(stored)
    side = round(far.drawn.grid.spacing / stored.grid.spacing)
    assert side > 1
    exact = reduce_by_brute_force(held.at(last).classes, side)
    assert (far.at(last).classes[exact != OPEN] != OPEN).all()  # only free blocks look free
