"""Thumbnails are small and show cells, outlines and paths correctly."""

import io
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import planners
from cspace import CSpace, Robot, Workspace, build
from cspace.plot import artists, thumbnail
from tests.pictures import COLORS, class_of

OCCUPIED = np.zeros((40, 30), bool)
OCCUPIED[18:22, :16] = True


def read_thumbnail(subject: Any) -> Any:
    """Return pixels, the first row at the bottom."""
    image = Image.open(io.BytesIO(thumbnail(subject)))
    assert image.format == "PNG"
    assert 100 <= max(image.size) <= 250
    return np.asarray(image.convert("RGB"))[::-1]


def build_space(kind: str) -> CSpace:
    if kind == "space":
        return build(
            Workspace.from_array(np.repeat(OCCUPIED[..., None], 5, axis=2), 0.1), Robot.ball(0.12)
        )
    workspace = Workspace.from_array(OCCUPIED, 0.1)
    if kind == "plane":
        return build(workspace, Robot.disc(0.12))
    return build(workspace, Robot.rectangle(0.4, 0.1), rotations=8)


@pytest.mark.parametrize("kind", ["plane", "turning", "space"])
def test_maps_and_workspaces_show_their_cells(kind: str) -> None:
    space = build_space(kind)
    layer = (slice(None),) * (space.grid.dim - (kind == "space")) + (
        (2,) if kind == "space" else ()
    )
    states = space.cell_states.reshape(-1, *space.grid.shape)[(slice(None), *layer)]
    for subject in (space, space.workspace):
        pixels = read_thumbnail(subject)
        for i, j in np.ndindex(40, 30):
            row, column = (
                int((k + 0.5) / n * size)
                for k, n, size in zip((j, i), (30, 40), pixels.shape, strict=False)
            )
            name = class_of(space, set(states[:, i, j].tolist()), bool(OCCUPIED[i, j]))
            if subject is space.workspace:
                name = "obstacle" if OCCUPIED[i, j] else "free"
            assert tuple(pixels[row, column]) == COLORS[name]


def test_robots_show_their_outline() -> None:
    for robot, wide in (
        (Robot.rectangle(1.0, 0.4), 2.5),
        (Robot.box((1.0, 0.4, 0.1)), 2.5),
        (Robot.disc(0.3), 1.0),
    ):
        pixels = read_thumbnail(robot).astype(int)
        rows, columns = np.nonzero(pixels[..., 0] < pixels[..., 1] - 8)
        assert np.ptp(columns) / np.ptp(rows) == pytest.approx(wide, rel=0.1)


def mask_near(pixels: Any, color: str) -> Any:
    """Return a mask of pixels near a colour."""
    return np.abs(pixels.astype(int) - np.round(255 * np.array(to_rgb(color)))).max(axis=2) < 30


def test_plans_show_their_path() -> None:
    space = build_space("plane")
    plan = planners.plan(space, (0.5, 0.5), (3.5, 0.5), seed=1)
    assert mask_near(read_thumbnail(plan), artists.PATH_COLOR).sum() > 100


def test_plans_that_failed_show_start_and_goal_alone() -> None:
    space = build(build_space("plane").workspace, Robot.disc(0.75))
    none = planners.plan(space, (0.9, 1.0), (3.1, 1.0), time_limit=0.1)
    assert not none.solved
    pixels = read_thumbnail(none)
    width = pixels.shape[1]
    assert not mask_near(pixels, artists.PATH_COLOR).any()
    columns = np.nonzero(mask_near(pixels, artists.GOAL_COLOR).any(axis=0))[0]
    assert len(columns)
    assert columns.min() > 0.8 * width
    assert mask_near(pixels, "black")[:, : width // 5].any()
    assert (pixels[:, width // 5 : 4 * width // 5] == 255).all()
