"""Animations: the robot where it is, the slice of its yaw, and nothing half-written."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import label

from cspace import BLOCKED, FREE, MIXED, CSpace, Robot, Workspace, build
from cspace.errors import FileError, InputError
from cspace.plot import animate
from cspace.plot.animation import Stage
from cspace.plot.artists import CLASSES
from cspace.plot.route import Route
from pictures import yard

Image = pytest.importorskip("PIL.Image")
ROBOT = (0x3F, 0xB7, 0x95)
PATH = [(1.0, 1.0, 0.0), (1.5, 3.5, 1.5), (6.5, 4.0, 0.0)]


@pytest.fixture(scope="module")
def space() -> CSpace:
    return yard(Robot.rectangle(1.0, 0.4))


@pytest.fixture(scope="module")
def flat(space: CSpace) -> CSpace:
    return build(space.workspace, Robot.disc(0.3))


def frames(file: Path) -> tuple[list[NDArray[np.uint8]], list[int], Any]:
    """Pixels and milliseconds of each frame, and whether the animation repeats."""
    pixels, times = [], []
    with Image.open(file) as image:
        for number in range(image.n_frames):
            image.seek(number)
            pixels.append(np.asarray(image.convert("RGB")))
            times.append(image.info["duration"])
        return pixels, times, image.info["loop"]


def middle(frame: NDArray[np.uint8], color: tuple[int, ...] = ROBOT) -> NDArray[np.float64]:
    """Mean column, and row from the bottom, of the largest patch of a colour."""
    patches, _ = label((np.abs(frame.astype(int) - color) < 12).all(axis=-1))
    rows, columns = np.nonzero(patches == 1 + np.bincount(patches.ravel())[1:].argmax())
    return np.array([columns.mean(), -rows.mean()])


def test_the_robot_drives_from_start_to_goal(space: CSpace, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    file = animate(space, PATH, tmp_path / "drive.gif", seconds=2, rate=5, progress=lambda *call: calls.append(call))
    pixels, times, loop = frames(file)
    assert len(pixels) == 11
    assert times == [200] * 10 + [1200]
    assert loop == 0
    assert calls == [(number, 11) for number in range(1, 12)]
    assert len({frame.shape for frame in pixels}) == 1
    assert [entry.name for entry in tmp_path.iterdir()] == ["drive.gif"]
    way = np.array([middle(frame) for frame in pixels])
    # Up first, then to the right, as in metres; the scale is the same along both axes.
    scale = (way[-1] - way[0]) / np.subtract(PATH[-1], PATH[0])[:2]
    assert scale[0] == pytest.approx(scale[1], rel=0.03)
    assert scale[0] > 20
    assert way[4, 1] - way[0, 1] > 0.6 * (way[-1, 1] - way[0, 1])
    assert (np.diff(way[:, 0]) > -1.0).all()


def test_the_drawing_is_true(space: CSpace) -> None:
    """The robot covers what it covers, and the other panel shows the slice of its yaw, asked cell by cell."""
    stage = Stage(space, Route.of(space, PATH, None, None), None)
    world, plane = stage.figure.axes
    from matplotlib.colors import to_rgb

    table = {name: np.rint(255 * np.array(to_rgb(color))).astype(int).tolist() for name, color in CLASSES}
    names = {FREE: "free", MIXED: "undecided (MIXED)", BLOCKED: "C-obstacle (BLOCKED)"}
    for q in ((2.0, 4.0, 0.0), (3.0, 3.9, math.pi / 2), (2.5, 4.2, 4.0)):
        image = stage.frame(np.array(q))[::-1]

        def pixel(ax: Any, x: float, y: float, image: NDArray[np.uint8] = image) -> list[int]:
            column, row = ax.transData.transform((x, y))
            return image[int(row), int(column)].tolist()

        ahead, aside = np.array([math.cos(q[2]), math.sin(q[2])]), np.array([-math.sin(q[2]), math.cos(q[2])])
        for sign in (1, -1):
            assert pixel(world, *(np.array(q[:2]) + sign * 0.13 * aside - 0.3 * ahead)) == list(ROBOT)
            assert pixel(world, *(np.array(q[:2]) + sign * 0.30 * aside - 0.3 * ahead)) != list(ROBOT)
        assert pixel(world, *(np.array(q[:2]) + 0.42 * ahead)) == [0, 0x61, 0x4A]
        shown = set()
        for x, y in space.grid.center_of(np.random.default_rng(3).integers(0, space.grid.shape, (300, 2))):
            near = np.hypot(*np.subtract(plane.transData.transform((x, y)), plane.transData.transform(q[:2]))) < 9
            if near or (y > 0.8 and x < 1.8) or y > 3.2:
                continue  # the point and the path are drawn there
            state = space.classify((x, y, q[2]))
            hit = space.workspace.outer[tuple(space.grid.cell_of((x, y)))]
            assert pixel(plane, x, y) == table["obstacle" if hit else names[state]]
            shown.add(state)
        assert shown == {FREE, MIXED, BLOCKED}


def test_the_slice_changes_with_the_yaw_alone(space: CSpace, tmp_path: Path) -> None:
    def blue(path: Any) -> list[int]:
        pixels, _, _ = frames(animate(space, path, tmp_path / "drive.gif", True, seconds=1, rate=7))
        return [int((np.abs(frame.astype(int) - (0xA6, 0xD3, 0xEE)) < 3).all(axis=-1).sum()) for frame in pixels]

    turning = blue([(3.0, 3.0, 0.0), (3.0, 3.0, 1.5)])
    straight = blue([(2.0, 3.0, 0.0), (4.0, 3.0, 0.0)])
    assert len(set(turning)) > 5
    assert max(straight) - min(straight) < 5


def test_a_map_that_does_not_turn(flat: CSpace, tmp_path: Path) -> None:
    pixels, _, _ = frames(animate(flat, [(1, 1), (1, 4), (7, 4)], tmp_path / "drive.gif", seconds=1, rate=2))
    way = np.array([middle(frame) for frame in pixels])
    assert (way[-1] - way[0] > 50).all()


def test_a_plan_is_taken_for_its_path(flat: CSpace, tmp_path: Path) -> None:
    class WithPath:
        path = np.array([(1.0, 1.0), (2.0, 3.0)])

    assert len(frames(animate(flat, WithPath(), tmp_path / "a.gif", seconds=0.5, rate=10))[0]) == 6


def test_a_robot_that_stays(space: CSpace, tmp_path: Path) -> None:
    for number, path in enumerate([[(2, 3, 1)], [(2, 3, 1), (2, 3, 1)]]):
        assert len(frames(animate(space, path, tmp_path / f"{number}.gif"))[0]) == 1


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (60, 50)])
def test_any_shape_draws(shape: tuple[int, int], tmp_path: Path) -> None:
    space = build(
        Workspace.from_array(np.zeros(shape, bool), 0.1), Robot.rectangle(0.02, 0.01), rotations=4, outside="free"
    )
    file = animate(space, [(0, 0, 0), (*np.multiply(shape, 0.1), 3)], tmp_path / "a.gif", seconds=0.3)
    pixels, _, _ = frames(file)
    assert max(pixels[0].shape) < 1200
    assert min(pixels[0].shape[:2]) > 150


# ----------------------------------------------------------------------------------------------- files and bad input


def test_existing_file(flat: CSpace, tmp_path: Path) -> None:
    file = tmp_path / "a.gif"
    file.write_text("precious")
    with pytest.raises(FileError, match="exists"):
        animate(flat, [(1, 1), (2, 2)], file, seconds=0.2)
    assert file.read_text() == "precious"
    animate(flat, [(1, 1), (2, 2)], file, overwrite=True, seconds=0.2)
    assert file.read_bytes().startswith(b"GIF89a")


def test_interrupted(flat: CSpace, tmp_path: Path) -> None:
    file = tmp_path / "a.gif"
    file.write_text("precious")

    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        animate(flat, [(1, 1), (2, 2)], file, overwrite=True, progress=stop)
    assert file.read_text() == "precious"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.gif"]


def test_no_folder(flat: CSpace, tmp_path: Path) -> None:
    with pytest.raises(FileError, match="folder"):
        animate(flat, [(1, 1), (2, 2)], tmp_path / "absent" / "a.gif")


@pytest.mark.parametrize(
    ("path", "options", "message"),
    [
        (None, {}, "path is empty"),
        ([], {}, "path is empty"),
        ([(1, 1)], {}, "path has shape (1, 2); it must be (n, 3)"),
        ([(1, 1, float("nan"))], {}, "path[0, 2] is nan"),
        (PATH, {"seconds": 0}, "seconds is 0"),
        (PATH, {"seconds": -1.0}, "seconds is -1.0"),
        (PATH, {"rate": 0.0}, "rate is 0.0"),
        (PATH, {"rate": 60}, "at most 50"),
        (PATH, {"rate": float("nan")}, "rate is nan"),
        (PATH, {"seconds": 1e4}, "at most 1000"),
        (PATH, {"file": "drive.mp4"}, ".gif"),
        (PATH, {"file": "drive"}, ".gif"),
    ],
)
def test_bad_input(space: CSpace, tmp_path: Path, path: Any, options: dict[str, Any], message: str) -> None:
    file = tmp_path / options.pop("file", "drive.gif")
    with pytest.raises(InputError) as caught:
        animate(space, path, file, **options)
    assert message in str(caught.value)
    assert list(tmp_path.iterdir()) == []
