"""Blocks, which show the most important class of their cells."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cspace
from cspace.plot.artists import OPEN, classify_cells
from cspace.view import level_of_detail
from cspace.view.level_of_detail import Blocks, CellsInMemory, CellsInStore, Part, choose_part

WHOLE = {2: (23, 17), 3: (11, 9, 7)}


@pytest.fixture(
    params=[(2, None), (2, 6), (3, None), (3, cspace.Rotations.quaternions(1))], ids=["R2", "SE2", "R3", "SE3"]
)
def parts(request: pytest.FixtureRequest) -> tuple[cspace.Workspace, cspace.Robot, Any]:
    dim, rotations = request.param
    occupied = np.random.default_rng(dim).random(WHOLE[dim]) < 0.04
    robot = cspace.Robot.rectangle(0.3, 0.1) if dim == 2 else cspace.Robot.box((0.2, 0.1, 0.1))
    return cspace.Workspace.from_array(occupied, 0.1), robot, rotations


def reduce_by_brute_force(classes: Any, part: Part) -> Any:
    """Return the largest class in each block."""
    starts = [range(low, high, part.side) for low, high in zip(part.first, part.stop, strict=True)]
    largest = np.empty([len(axis) for axis in starts], dtype=np.uint8)
    for index, corner in zip(np.ndindex(largest.shape), itertools.product(*starts), strict=True):
        box = tuple(slice(low, min(low + part.side, stop)) for low, stop in zip(corner, part.stop, strict=True))
        largest[index] = classes[box].max()
    return largest


@pytest.mark.parametrize("side", [1, 3])
def test_blocks_show_the_largest_class(parts: Any, side: int, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace, robot, rotations = parts
    space = cspace.build(workspace, robot, rotations=rotations)
    monkeypatch.setattr(level_of_detail, "MAX_BLOCKS", space.grid.size // (side**space.grid.dim) + 1)
    monkeypatch.setattr(level_of_detail, "MAX_CELLS_PER_SLAB", 40)
    held = CellsInMemory(space)
    assert held.side == side
    rotation = space.rotations.centers[-1]
    everything = Part((0,) * space.grid.dim, space.grid.shape, side)
    part = Part((2,) * space.grid.dim, tuple(n - 1 for n in space.grid.shape), 2)
    for seen, classes in ((rotation, classify_cells(space, rotation)), (None, 7 * workspace.outer)):
        np.testing.assert_array_equal(held.map_blocks(seen).classes, reduce_by_brute_force(classes, everything))
        np.testing.assert_array_equal(held.part_blocks(seen, part).classes, reduce_by_brute_force(classes, part))


def test_invalidate_refreshes_blocks(parts: Any) -> None:
    workspace, robot, rotations = parts
    space = cspace.build(workspace, robot, rotations=rotations)
    held, rotation = CellsInMemory(space), space.rotations.centers[0]
    before = held.map_blocks(rotation).classes
    space.update(np.ones((1,) * space.grid.dim, dtype=bool), np.argwhere(before == OPEN)[0].tolist())
    assert held.map_blocks(rotation).classes is before
    held.invalidate()
    assert (held.map_blocks(rotation).classes != before).any()


def test_tiled_map_has_the_same_blocks(parts: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace, robot, rotations = parts
    stored = cspace.build(workspace, robot, rotations=rotations, store=tmp_path / "map.zarr", tile=8)
    held = CellsInMemory(cspace.build(workspace, robot, rotations=rotations))
    rotation, part = stored.rotations.centers[-1], Part((3,) * stored.grid.dim, stored.grid.shape, 2)
    whole = CellsInStore(stored)
    assert whole.side == 1
    for seen in (rotation, None):
        np.testing.assert_array_equal(whole.map_blocks(seen).classes, held.map_blocks(seen).classes)
        np.testing.assert_array_equal(whole.part_blocks(seen, part).classes, held.part_blocks(seen, part).classes)
    monkeypatch.setattr(level_of_detail, "MAX_BLOCKS", stored.grid.size // 2**stored.grid.dim)
    far = CellsInStore(stored).map_blocks(rotation)
    exact = reduce_by_brute_force(
        held.map_blocks(rotation).classes, Part((0,) * stored.grid.dim, stored.grid.shape, far.side)
    )
    assert far.side > 1
    assert (far.classes[exact != OPEN] != OPEN).all()  # only free blocks look free


@pytest.mark.parametrize(("shape", "reach", "coarsest"), [((10_000, 8_000), 3.0, 8), ((464,) * 3, 4.0, 4)])
def test_choose_part_covers_the_view(shape: tuple[int, ...], reach: float, coarsest: int) -> None:
    grid = cspace.Grid([-1.0] * len(shape), 0.05, shape)
    rng = np.random.default_rng(0)
    for point in rng.uniform(grid.lower, grid.upper, (20, grid.dim)):
        part = choose_part(grid, point, reach, coarsest)
        assert part is not None
        first, stop, cell = np.array(part.first), np.array(part.stop), grid.cell_of(point)
        assert part.side < coarsest
        assert not (first % coarsest).any()
        assert not ((stop % coarsest) * (stop != grid.shape)).any()
        assert ((first <= cell) & (cell < stop)).all()
        assert np.prod(-(-(stop - first) // part.side)) <= 2 * level_of_detail.MAX_BLOCKS
        close = (np.maximum(first, 0) == 0) | (cell - first >= 0.5 * reach / grid.spacing)
        assert close.all()
    near = grid.lower + 0.4 * np.subtract(grid.upper, grid.lower)
    parts = {choose_part(grid, near + 0.01 * k, reach * 1.001**k, coarsest) for k in range(8)}
    assert len(parts) <= 2  # small movements of the camera keep the part
    assert choose_part(grid, near, 1e4, coarsest) is None
    assert choose_part(grid, near, reach, 1) is None
    assert choose_part(grid, near + 1e5, reach, coarsest) is None


def test_blocks_have_position_and_side() -> None:
    held = CellsInMemory(cspace.build(cspace.Workspace.from_array(np.eye(9, dtype=bool), 0.1), cspace.Robot.disc(0.1)))
    part = held.part_blocks(None, Part((3, 0), (9, 5), 2))
    assert isinstance(part, Blocks)
    assert (part.first.tolist(), part.side, part.classes.shape) == ([3, 0], 2, (3, 3))
