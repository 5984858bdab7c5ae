"""Geometry of the page: borders, sections and robots."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh

import cspace
from cspace.plot.artists import CLASSES, OBSTACLE
from cspace.view.blocks import Cells
from cspace.view.scene import (
    KINDS,
    Stage,
    extract_border,
    make_robot_surface,
    rgb,
)


def split_rectangles(corners: np.ndarray) -> list[tuple[int, ...]]:
    """Return unit squares as (axis, sign, position)."""
    unit_squares = []
    for one in corners:
        normal = np.cross(one[1] - one[0], one[2] - one[1])
        (axis,) = np.flatnonzero(normal)
        low, high = one.min(axis=0), one.max(axis=0)
        high[axis] += 1
        unit_squares += [
            (int(axis), int(np.sign(normal[axis])), *position)
            for position in np.ndindex(*(high - low))
            for position in [tuple((low + position).tolist())]
        ]
    return unit_squares


def find_border(solid: np.ndarray, has_boundary: bool, lid: bool) -> list[tuple[int, ...]]:
    """Return the unit squares of borders of cells."""
    faces = []
    for cell in np.argwhere(solid):
        for axis in range(3):
            for sign in (-1, 1):
                other = cell.copy()
                other[axis] += sign
                inside = 0 <= other[axis] < solid.shape[axis]
                if (
                    solid[tuple(other)]
                    if inside
                    else not (has_boundary and (lid or (axis, sign) != (2, 1)))
                ):
                    continue
                position = cell.copy()
                position[axis] += sign > 0
                faces.append((axis, sign, *position.tolist()))
    return faces


@pytest.mark.parametrize(("has_boundary", "lid"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.8, 1.0])
def test_rectangles_cover_the_border(share: float, has_boundary: bool, lid: bool) -> None:
    solid = np.random.default_rng(0).random((7, 5, 6)) < share
    rectangles = split_rectangles(extract_border(solid, has_boundary, lid))
    assert sorted(rectangles) == sorted(find_border(solid, has_boundary, lid))


def test_a_box_has_six_rectangles() -> None:
    solid = np.zeros((9, 8, 7), dtype=bool)
    solid[2:6, 1:7, 3:5] = True
    assert len(extract_border(solid)) == 6


@pytest.fixture(scope="module")
def room() -> cspace.CSpace:
    occupied = np.zeros((12, 10, 8), dtype=bool)
    occupied[:, :, 0] = occupied[3, 4:6, :] = True
    return cspace.build(
        cspace.Workspace.from_array(occupied, 0.5, lower=(-1.0, 2.0, 0.5)), cspace.Robot.ball(0.4)
    )


def test_solids_end_at_the_cut(room: cspace.CSpace) -> None:
    stage, blocks = Stage(room.grid, 1.0), Cells(room).at(None)
    for cut in (0.6, 1.75, 4.5, 9.0):
        mesh = trimesh.Trimesh(*stage.solid(blocks, KINDS["obstacles"], cut))
        assert mesh.bounds[1, 2] == pytest.approx(min(cut, 4.5))
        low = room.workspace.outer * np.clip((cut - 0.5) / 0.5 - np.arange(8), 0.0, 1.0)
        assert mesh.volume == pytest.approx(0.125 * low.sum())
        assert stage.section(blocks, cut).height == cut


def read_pixel(section: object, x: float, y: float) -> tuple[int, ...]:
    image, lower, upper, _ = section  # type: ignore[misc]
    column, row = (
        (np.array([x, y]) - lower) / (upper - lower) * [image.shape[1], -image.shape[0]]
    ).astype(int)
    return tuple(image[row - 1, column].tolist())


def test_section_shows_cells_at_their_positions() -> None:
    occupied = np.zeros((9, 6), dtype=bool)
    occupied[7, 1] = True
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.05))
    section = Stage(space.grid, 0.2).section(Cells(space).at(0), 0.2)
    assert section.height == 0.0
    assert read_pixel(section, 0.75, 0.15) == (*rgb(CLASSES[OBSTACLE][1]), 255)
    assert read_pixel(section, 0.15, 0.45) == (255, 255, 255, 255)
    high = np.zeros((9, 6, 4), dtype=bool)
    high[7, 1, 2] = True
    space = cspace.build(
        cspace.Workspace.from_array(high, 0.1), cspace.Robot.ball(0.05), outside="free"
    )
    stage, blocks = Stage(space.grid, 0.2), Cells(space).at(0)
    assert read_pixel(stage.section(blocks, 0.25), 0.75, 0.15) == (*rgb(CLASSES[OBSTACLE][1]), 255)
    assert read_pixel(stage.section(blocks, 0.05), 0.75, 0.15)[3] == 0  # free cells are transparent


@pytest.mark.parametrize(
    "robot",
    [
        cspace.Robot.disc(0.3),
        cspace.Robot.polygon(shapely.box(0, 0, 2, 1) - shapely.box(0.5, 0.25, 1.0, 0.75)),
        cspace.Robot.polygon([(0, 0), (2, 0), (2, 1), (1, 0.2), (0, 1)]),
        cspace.Robot.box((0.5, 0.4, 0.3)),
    ],
    ids=["disc", "hole", "notch", "box"],
)
def test_robot_surface_has_the_volume_of_the_robot(robot: cspace.Robot) -> None:
    mesh = trimesh.Trimesh(*make_robot_surface(robot, 0.5))
    size = 0.06 if robot.dim == 3 else 0.5 * robot.geometry.area
    mesh.merge_vertices()
    assert mesh.volume == pytest.approx(size, rel=1e-6)
    assert mesh.is_watertight
