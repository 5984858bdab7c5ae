"""Robots in text: what is drawn is where the robot is."""

import io

import numpy as np
import pytest
import shapely
import trimesh

import cspace
from commands import run
from cspace import Robot, Workspace
from cspace.cli.sketch import sketch
from cspace.shapes import Point

RING = shapely.box(-2, -1, 2, 2).difference(shapely.box(-1, 0, 0, 1)).difference(shapely.box(1, 1, 2, 2))


def pixels(text: str) -> tuple[np.ndarray, tuple[int, int]]:
    """The last drawing of a text, as [x, y] from below, and where its + is; that counts as two pixels of nothing."""
    lines = text.split("\n\n")[-1].split("\n")
    lines = [line for line in lines if " wide; " not in line]
    width = max(map(len, lines)) - 2
    rows = [line[2:].ljust(width) for line in lines]
    fine = [[c in which for c in row] for row in rows for which in ("█▀#'", "█▄#.")]
    [(column, row)] = [(row.index("+"), k) for k, row in enumerate(rows) if "+" in row]
    return np.array(fine)[::-1].T, (column, 2 * (len(rows) - 1 - row))


@pytest.mark.parametrize(
    ("robot", "inside"),
    [
        (Robot.polygon(RING), lambda x, y: shapely.contains_xy(RING, x, y)),
        (Robot.disc(0.7, (0.9, 0.2)), lambda x, y: np.hypot(x - 0.9, y - 0.2) < 0.7),
        (Robot.cylinder(0.3, 1.2), lambda x, z: (abs(x) < 0.3) & (abs(z) < 0.6)),
        (Robot.box((2, 9, 1), (0.5, 0, 0.7)), lambda x, z: (abs(x - 0.5) < 1) & (abs(z - 0.7) < 0.5)),
    ],
)
def test_the_drawing_is_the_robot(robot, inside):
    text = sketch(robot)
    drawn, at = pixels(text)
    side = float(text.rpartition("a character is ")[2].split(" m")[0])
    x, y = ((np.arange(count) - k + 0.5) * side for count, k in zip(drawn.shape, at, strict=True))
    true = np.array(inside(*np.meshgrid(x, y, indexing="ij")))
    true[at[0], at[1] : at[1] + 2] = drawn[at[0], at[1] : at[1] + 2]
    # The frame is shifted by less than a pixel and a half against the reference point, so borders may differ.
    assert (drawn != true).mean() < 0.13
    assert 0.85 < drawn.sum() / true.sum() < 1.2
    assert text.count(" wide; ") == robot.dim - 1


def test_thin_robots_are_seen_and_far_ones_said():
    drawn, _ = pixels(sketch(Robot.rectangle(10, 0.01)))
    assert drawn.any(axis=1).sum() >= 43
    assert "the reference point lies far outside" in sketch(Robot.disc(0.1, (5, 5)))


def test_terminals_without_blocks_get_plain_characters(monkeypatch):
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(io.BytesIO(), encoding="ascii"))
    assert set(sketch(Robot.disc(0.3)).split("from above")[0]) == set(" #'.+\n")


def test_info_draws_the_robot_unless_a_machine_asks(tmp_path):
    printed = run("info", "rect:4.5x1.9@1.3,0")
    assert "+ is the reference point" in printed.stdout
    assert "from above" not in run("info", "disc:0.3", "--json").stdout
    (tmp_path / "robot.urdf").write_text(
        '<robot name="r"><link name="l"><collision><geometry><sphere radius="1"/></geometry></collision></link></robot>'
    )
    assert "from the side" in run("info", tmp_path / "robot.urdf").stdout
    assert "from the side" in run("info", f"{tmp_path / 'robot.urdf'}#l").stdout


def test_meshes_of_packages_are_found_in_given_folders(tmp_path):
    (tmp_path / "ws" / "arm").mkdir(parents=True)
    (tmp_path / "urdf").mkdir()
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "ws" / "arm" / "link.stl")
    urdf = tmp_path / "urdf" / "robot.urdf"
    urdf.write_text(
        '<robot name="r"><link name="l"><collision><geometry><mesh filename="package://arm/link.stl"/></geometry>'
        "</collision></link></robot>"
    )
    assert "pass --package-dir FOLDER" in run("info", urdf).stderr
    assert "from the side" in run("info", urdf, "--package-dir", tmp_path, "--package-dir", tmp_path / "ws").stdout


def test_info_of_a_map_without_a_robot_draws_none(tmp_path):
    """In the space of its joints an arm is a point."""
    point = Robot("arm", Point.at_origin(2))
    cspace.build(Workspace.from_array(np.zeros((4, 3), dtype=bool), 0.1), point).save(tmp_path / "joints.npz")
    assert "from above" not in run("info", tmp_path / "joints.npz").stdout
