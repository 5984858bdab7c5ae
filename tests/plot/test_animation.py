"""Animations of robots, slices and files."""

import numpy as np
import pytest
from scipy.ndimage import label

import planners
from cspace import Robot, Workspace, build
from cspace.plot import animate
from tests.helpers.pictures import TURNING_PATH

Image = pytest.importorskip("PIL.Image")
ROBOT = (0x3F, 0xB7, 0x95)
PURPLE = (0x6A, 0x1B, 0x9A)


def read_frames(file):
    """Return pixels, milliseconds and number of loops."""
    pixels = []
    times = []
    with Image.open(file) as image:
        for number in range(image.n_frames):
            image.seek(number)
            pixels.append(np.asarray(image.convert("RGB")))
            times.append(image.info["duration"])
        return pixels, times, image.info["loop"]


def mask_color(frame, color):
    """Return a mask of the pixels of a colour."""
    return np.asarray(np.abs(frame.astype(int) - color).max(axis=-1) < 16)


def find_patch(frame):
    """Return the center of the largest patch in the robot's colour, a column and a row from below."""
    patches, _ = label(mask_color(frame, ROBOT))
    rows, columns = np.nonzero(patches == 1 + np.bincount(patches.ravel())[1:].argmax())
    return np.array([columns.mean(), -rows.mean()])


def mask_green(frame):
    """Return a mask of the green pixels above the legend; a robot is green in any light."""
    red, green, blue = np.moveaxis(frame.astype(int), -1, 0)
    found = (green > red + 40) & (green > blue + 10)
    found[int(0.9 * len(found)) :] = False
    return found


def test_the_robot_drives_from_start_to_goal(turning, tmp_path):
    calls = []
    options = {"seconds": 0.5, "progress": lambda *call: calls.append(call)}
    file = animate(turning, TURNING_PATH, tmp_path / "drive.gif", **options)
    pixels, times, loop = read_frames(file)
    assert times == [100] * 5 + [1100]
    assert loop == 0
    assert calls == [(number, 6) for number in range(1, 7)]
    assert [entry.name for entry in tmp_path.iterdir()] == ["drive.gif"]
    centers = np.array([find_patch(frame) for frame in pixels])
    # The robot moves up, then right; both axes have the same scale.
    scale = (centers[-1] - centers[0]) / np.subtract(TURNING_PATH[-1], TURNING_PATH[0])[:2]
    assert scale[0] == pytest.approx(scale[1], rel=0.03)
    assert scale[0] > 20
    assert centers[2, 1] - centers[0, 1] > 0.6 * (centers[-1, 1] - centers[0, 1])
    assert (np.diff(centers[:, 0]) > -1.0).all()


def test_a_short_way_on_a_large_map_fills_the_frame(tmp_path):
    """The robot has its size beside the length of its way, and cells are where they were."""
    cells = np.zeros((800, 600), dtype=bool)
    cells[23:27, 20:40] = True  # 0.4 m by 2 m, 0.8 m to the right of the start
    space = build(Workspace.from_array(cells, 0.1), Robot.rectangle(0.6, 0.4), rotations=8)
    path = [(1.5, 3.0, 0.0), (1.5, 5.0, 0.0)]
    pixels, _, _ = read_frames(animate(space, path, tmp_path / "room.gif", seconds=0.3))
    centers = np.array([find_patch(frame) for frame in pixels])
    metre = (centers[-1, 1] - centers[0, 1]) / 2.0
    assert metre > 60
    _, columns = np.nonzero(mask_color(pixels[0][: int(0.8 * len(pixels[0]))], (0x26,) * 3))
    wall = np.abs(columns - centers[0, 0] - 1.0 * metre) <= 0.25 * metre
    assert wall.sum() == pytest.approx(0.4 * 2.0 * metre**2, rel=0.1)


@pytest.fixture(scope="module")
def tunnel():
    """Build a hall with a wall below a gap."""
    cells = np.zeros((40, 20, 20), dtype=bool)
    cells[:, :, 0] = True
    cells[19:21, :, :10] = True
    return build(Workspace.from_array(cells, 0.1), Robot.box((0.4, 0.3, 0.2)), rotations=8)


def test_robot_in_space_moves_along_its_path(tunnel, tmp_path):
    """Look from the side, where the robot moves up, then right."""
    path = [(0.6, 1.0, 0.4, 0.0), (0.6, 1.0, 1.5, 1.0), (3.4, 1.0, 1.5, 1.0)]
    options = {"camera": (0.0, -90.0), "seconds": 0.4}
    pixels, _, _ = read_frames(animate(tunnel, path, tmp_path / "fly.gif", **options))
    rows, columns = np.array([np.argwhere(mask_green(frame)).mean(axis=0) for frame in pixels]).T
    up = rows[0] - rows[-1]
    right = columns[-1] - columns[0]
    assert right > 100
    assert up / 1.1 == pytest.approx(right / 2.8, rel=0.05)
    assert (np.diff(rows) < 1.0).all()
    assert mask_color(pixels[0], PURPLE).sum() > 20


def test_trajectories_are_animated_at_true_speed(flat, tmp_path):
    plan = planners.plan(flat, (1.0, 2.5), (7.0, 2.5))
    trajectory = plan.trajectory(max_velocity=100.0, max_acceleration=24.0)
    pixels, times, _ = read_frames(animate(flat, trajectory, tmp_path / "drive.gif"))
    assert times == [100] * 10 + [1100]
    columns = np.array([find_patch(frame)[0] for frame in pixels])
    shares = (columns - columns[0]) / (columns[-1] - columns[0])
    # The first half accelerates.
    positions, *_ = trajectory.sample(0.1 * np.arange(11))
    np.testing.assert_allclose(shares, (positions[:, 0] - 1.0) / 6.0, atol=0.02)
