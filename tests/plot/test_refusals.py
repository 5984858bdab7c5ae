"""Pictures refuse invalid arguments."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from cspace import CSpace, FileError, InputError, Robot, Rotations, Workspace, build
from cspace.plot import animate, plot, save_plot
from tests.helpers.pictures import TURNING_PATH
from tests.helpers.refusals import refusals

SOLID: dict[str, Any] = {"view": "3d"}


@pytest.fixture(scope="module")
def maps(flat: CSpace, turning: CSpace, hall: CSpace) -> dict[str, CSpace]:
    workspace = Workspace.from_array(np.zeros((4, 4, 4), bool), 0.2)
    tumbling = build(workspace, Robot.box((0.3, 0.1, 0.1)), rotations=Rotations.quaternions(1))
    return {"flat": flat, "turning": turning, "hall": hall, "tumbling": tumbling}


@refusals(
    "name, options, message",
    ("flat", {"path": [1.0, 2.0]}, "path has shape (2,)"),
    ("flat", {"path": [(1.0, 2.0, 3.0)]}, "path has shape (1, 3)"),
    ("flat", {"path": [(1.0, float("nan"))]}, "path[0, 1] is nan"),
    ("flat", {"start": [(1.0, 2.0)]}, "start has shape (1, 2)"),
    ("flat", {"goal": (1.0, float("inf"))}, "goal[1] is inf"),
    ("flat", {"path": [(1, 1), (2, 2)], "robot_every": 0.0}, "robot_every is 0.0"),
    ("flat", {"robot_every": float("nan")}, "robot_every is nan"),
    ("flat", {"dpi": 0}, "dpi is 0"),
    ("flat", {"ax": None}, "ax is given"),
    ("flat", {"rotation": 0.5}, "rotation has shape (1,); the robot does not turn"),
    ("flat", {"view": "3d"}, "view is '3d'"),
    ("flat", {"view": "panels"}, "it must be plane"),
    ("flat", {"view": "rotations"}, "view is 'rotations'"),
    ("flat", {"center": (1, 1, 1), "zoom": 2.0}, "center has shape (3,); it must be (2,)"),
    (
        "flat",
        {"center": (1, 1)},
        "center is given without zoom; the whole map is drawn; add e.g. zoom=8",
    ),
    ("flat", {"zoom": 0.5}, "zoom is 0.5; it must be at least 1 (the whole map)"),
    ("flat", {"zoom": math.nan}, "zoom is nan"),
    (
        "flat",
        {"zoom": 2.0, "center": (9.0, 1.0)},
        "center is [9.0, 1.0]; the grid is from [0.0, 0.0]",
    ),
    ("flat", {"cut": 1.0}, "cut is given with view plane; it needs view 3d"),
    (
        "flat",
        {"file": "map.xyz"},
        "with suffix '.xyz'; the suffix says what to write; use one of .png, .pdf, .svg, .jpg",
    ),
    ("turning", {"path": [(1.0, 2.0)]}, "path has shape (1, 2); it must be (n, 3)"),
    ("turning", {"start": (1.0, 2.0)}, "start has shape (2,); it must be (3,); pass (x, y, yaw)"),
    ("turning", {"goal": (1.0, 2.0, float("inf"))}, "goal[2] is inf"),
    ("turning", {"rotation": float("nan")}, "rotation is nan"),
    (
        "turning",
        {
            "rotation": [0.0, 1.0],
        },
        "rotation has shape (2,); a rotation is given by yaw",
    ),
    ("turning", {"rotation": 1e9}, "rotation has a yaw of 1e+09 rad"),
    ("turning", {"rotation": "north"}, "rotation is 'north'"),
    ("turning", {"view": "panels"}, "loop over plot(rotation=)"),
    ("turning", {"rotation": []}, "rotation has shape (0,)"),
    ("tumbling", {"rotation": (0.0, 0.0, 1.0)}, "given by qx, qy, qz, qw"),
    ("hall", {"path": [(1.0, 2.0)]}, "path has shape (1, 2); it must be (n, 3)"),
    ("hall", {"start": (1.0, 2.0)}, "pass (x, y, z)"),
    ("hall", {"center": (1.0, 2.0)}, "center has shape (2,)"),
    (
        "hall",
        {"center": (1.0, 2.0, 9.0)},
        "center is [1.0, 2.0, 9.0]; the grid is from [0.0, 0.0, 0.0] to [6.0, 4.0, 2.4]",
    ),
    ("hall", {"center": (1.0, float("nan"), 0.0)}, "center[1] is nan"),
    ("hall", {"view": "plane"}, "it must be sections or 3d"),
    ("hall", {"rotation": 0.0}, "the robot does not turn"),
    ("hall", {"camera": (1, 2)}, "it needs view 3d"),
    ("hall", {**SOLID, "surface": "walls"}, "surface is 'walls'; it must be 'obstacles' or 'free'"),
    ("hall", {**SOLID, "camera": (91.0, 0.0)}, "camera is (91.0, 0.0)"),
    ("hall", {**SOLID, "camera": 30.0}, "an elevation from -90 to 90"),
    ("hall", {**SOLID, "cut": math.nan}, "cut is nan"),
    ("hall", {**SOLID, "center": (1, 1, 1)}, "center is given without zoom"),
)
def test_save_plot_refuses_invalid_options(
    maps: dict[str, CSpace], tmp_path: Path, name: str, options: dict[str, Any], message: str
) -> None:
    rest = {key: value for key, value in options.items() if key != "file"}
    with pytest.raises(InputError) as caught:
        save_plot(maps[name], tmp_path / options.get("file", "map.png"), **rest)
    assert message in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@refusals(
    "name, options, message",
    *[("flat", {"ax": wrong}, r"ax is a .*matplotlib axes") for wrong in (3, "x", [1, 2])],
    ("hall", {**SOLID, "ax": Figure().add_subplot()}, "ax has two dimensions"),
)
def test_plot_refuses_axes(
    maps: dict[str, CSpace], name: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        plot(maps[name], **options)


@refusals(
    "name, path, options, message",
    ("turning", None, {}, "path is empty"),
    ("turning", [], {}, "path is empty"),
    ("turning", [(1, 1)], {}, "path has shape (1, 2); it must be (n, 3)"),
    ("turning", [(1, 1, float("nan"))], {}, "path[0, 2] is nan"),
    ("turning", TURNING_PATH, {"seconds": 0}, "seconds is 0"),
    ("turning", TURNING_PATH, {"seconds": -1.0}, "seconds is -1.0"),
    ("turning", TURNING_PATH, {"rate": 0.0}, "rate is 0.0"),
    ("turning", TURNING_PATH, {"rate": 60}, "at most 50"),
    ("turning", TURNING_PATH, {"rate": float("nan")}, "rate is nan"),
    ("turning", TURNING_PATH, {"seconds": 1e4}, "at most 1000"),
    ("turning", TURNING_PATH, {"file": "drive.mp4"}, ".gif"),
    ("turning", TURNING_PATH, {"file": "drive"}, ".gif"),
    ("turning", TURNING_PATH, {"camera": (30, 30)}, "camera is given for a plane map"),
    ("hall", [(1, 1, 1)], {"camera": (120, 0)}, "camera is"),
)
def test_animate_refuses(
    maps: dict[str, CSpace],
    tmp_path: Path,
    name: str,
    path: Any,
    options: dict[str, Any],
    message: str,
) -> None:
    rest = {key: value for key, value in options.items() if key != "file"}
    with pytest.raises(InputError) as caught:
        animate(maps[name], path, tmp_path / options.get("file", "drive.gif"), **rest)
    assert message in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg", ".jpg", ".gif"])
def test_pictures_replace_no_file_unasked_and_make_no_folder(
    flat: CSpace, tmp_path: Path, suffix: str
) -> None:
    def write(file: Path, **options: Any) -> None:
        if suffix == ".gif":
            animate(flat, [(1, 1), (1, 2)], file, seconds=0.2, **options)
        else:
            save_plot(flat, file, path=[(1, 1), (1, 4)], **options)

    file = tmp_path / f"map{suffix}"
    file.write_text("precious")
    with pytest.raises(FileError, match="exists"):
        write(file)
    assert file.read_text() == "precious"
    write(file, overwrite=True)
    begin = {
        ".png": b"\x89PNG",
        ".pdf": b"%PDF",
        ".svg": b"<?xml",
        ".jpg": b"\xff\xd8",
        ".gif": b"GIF89a",
    }[suffix]
    assert file.read_bytes().startswith(begin)
    assert [entry.name for entry in tmp_path.iterdir()] == [file.name]
    with pytest.raises(FileError, match="folder"):
        write(tmp_path / "absent" / file.name)
