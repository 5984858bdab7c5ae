"""Panels of slices and parts of paths."""

import math
from typing import Any

import numpy as np
import pytest

from cspace import CSpace, Robot, Rotations, Workspace, build
from cspace.plot import plot
from tests.pictures import check_cells, heading, labels, rendered


def read_yaws(ax: Any) -> list[str]:
    return [panel.get_title(loc="left") for panel in ax.figure.axes]


def test_each_panel_shows_its_slice(turning: CSpace) -> None:
    yaws = [0.0, 0.7, math.pi / 2, -2.0]
    first = plot(turning, rotation=yaws)
    image, panels = rendered(first), first.figure.axes
    assert first is panels[0]
    assert (len(panels), len(first.figure.legends)) == (4, 1)
    for ax, yaw in zip(panels, yaws, strict=True):
        assert (ax.get_xlim(), ax.get_ylim(), ax.get_aspect()) == ((0.0, 8.0), (0.0, 5.0), 1.0)
        cells = np.random.default_rng(1).integers(0, turning.grid.shape, (100, 2))
        check_cells(turning, ax, image, cells, [(yaw,)])


def test_panels_choose_yaws(turning: CSpace) -> None:
    assert read_yaws(plot(turning, view="panels")) == [f"yaw {yaw}°" for yaw in (0, 60, 120, -180, -120, -60)]
    assert read_yaws(plot(turning, rotation=np.radians([10, 350]))) == ["yaw 10°", "yaw -10°"]
    assert read_yaws(plot(turning, rotation=0.0, view="panels")) == ["yaw 0°"]
    # A centered rectangle has one slice for two rotation cells; a disc has one for all.
    around = build(turning.workspace, Robot.rectangle(1.0, 0.4), rotations=24)
    assert read_yaws(plot(around, view="panels")) == [f"yaw {yaw}°" for yaw in (0, 30, 60, 90, 120, 150)]
    assert len(read_yaws(plot(build(turning.workspace, Robot.disc(0.3), rotations=24), view="panels"))) == 1


def collect_lines(ax: Any) -> dict[str, Any]:
    """Return points of lines by label, without gaps."""
    drawn = {line.get_label(): np.asarray(line.get_xydata()) for line in ax.lines if line.get_label()[0] != "_"}
    return {label: points[np.isfinite(points).all(axis=1)] for label, points in drawn.items()}


def test_panel_draws_the_part_of_the_path_nearest_to_its_yaw(turning: CSpace) -> None:
    # The robot rotates by a radian for each metre along x, so x determines the yaw.
    path = np.array([(x, 2.0, x - 1.0) for x in (1.0, 2.5, 4.0, 5.5, 7.0)])
    yaws, length = np.radians(np.arange(6) * 60.0), 0.0
    first = plot(turning, rotation=yaws, path=path)
    for ax, yaw in zip(first.figure.axes, yaws.tolist(), strict=True):
        drawn = collect_lines(ax)
        (part,) = (points for label, points in drawn.items() if label.startswith("path"))
        off = (part[:, 0] - 1.0 - yaw + math.pi) % (2.0 * math.pi) - math.pi
        assert (np.abs(off) <= math.radians(32.0)).all() and (part[:, 1] == 2.0).all()
        steps = np.diff(np.sort(part[:, 0]))
        length += steps[steps < 0.05].sum()
        assert ("start" in drawn, "goal" in drawn) == (yaw == 0.0, yaw == 0.0)  # the goal is at 6 rad, or -16 degrees
    assert length == pytest.approx(6.0)  # each part in one panel
    assert labels(first)[4:] == ["path, in the panel of the nearest rotation", "start", "goal"]


def test_yaws_that_share_a_slice_share_a_panel(turning: CSpace) -> None:
    around = build(turning.workspace, Robot.rectangle(1.0, 0.4), rotations=24)  # symmetric under half a turn
    path = [(1.0, 4.0, math.pi), (3.0, 4.0, math.pi), (4.0, 4.0, -math.pi / 2)]
    panels = {ax.get_title(loc="left"): collect_lines(ax) for ax in plot(around, view="panels", path=path).figure.axes}
    name = "path, in the panel of the nearest rotation"
    assert panels["yaw 0°"][name][0].tolist() == [1.0, 4.0] and "start" in panels["yaw 0°"]
    assert panels["yaw 90°"][name][-1].tolist() == [4.0, 4.0] and "goal" in panels["yaw 90°"]
    one = plot(around, rotation=0.0, view="panels", path=path)
    np.testing.assert_allclose(collect_lines(one)["path"][[0, -1]], [(1.0, 4.0), (4.0, 4.0)])


def test_panels_show_rotations_about_any_axis() -> None:
    occupied = np.zeros((12, 9, 8), bool)
    occupied[5, :5] = True
    space = build(Workspace.from_array(occupied, 0.1), Robot.box((0.3, 0.1, 0.1)), rotations=Rotations.quaternions(2))
    half = math.sqrt(0.5)
    turns = [(0.0, 0.0, 0.0, 1.0), (half, 0.0, 0.0, half), (0.0, -half, 0.0, half)]
    first = plot(
        space, rotation=turns, center=(0.5, 0.5, 0.45), path=[(0.2, 0.2, 0.4, *turns[0]), (0.2, 0.7, 0.4, *turns[1])]
    )
    assert read_yaws(first) == ["not turned", "turned 90° about (1, 0, 0)", "turned 90° about (0, -1, 0)"]
    assert len(read_yaws(plot(space, view="panels"))) == 6
    assert "turned 90° about (1, 0, 0), in a rotation cell of " in heading(plot(space, rotation=turns[1]))
