"""The command line for robots that turn: angles, slices, curves, animations, and one clear line for what is wrong."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cspace.cli.forms import Form, configuration
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import cspace
import planners
from cspace.cli import app
from cspace.cli.options import angle
from cspace.errors import InputError

START, GOAL = "0.5,0.5,0deg", "2.5,1.5,90deg"


def run(*arguments: object) -> Any:
    """What the command line answers, in this process."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def document(*arguments: object) -> dict[str, Any]:
    """The JSON document of a command that succeeds."""
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    found: dict[str, Any] = json.loads(result.stdout)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace of 4 m by 2 m with a wall across half of it, and its maps with and without rotations."""
    folder = tmp_path_factory.mktemp("turning")
    rows = ["." * 40] * 10 + ["." * 20 + "@" + "." * 19] * 10
    (folder / "room.map").write_text("\n".join(["type octile", "height 20", "width 40", "map", *rows]) + "\n")
    common = ["map", folder / "room.map", "--robot", "rect:0.4x0.2", "--spacing", 0.1]
    assert run(*common, "-o", folder / "turning.zarr", "--rotations", 24).exit_code == 0
    assert run(*common, "-o", folder / "flat.zarr").exit_code == 0
    return folder


@pytest.fixture
def room(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("room.map", "turning.zarr", "flat.zarr"):
        (tmp_path / name).symlink_to(folder / name)
    return tmp_path


# ----------------------------------------------------------------------------------------------- angles


@pytest.mark.parametrize(
    ("text", "radians"),
    [
        ("0", 0.0),
        ("90deg", math.pi / 2),
        ("-90deg", -math.pi / 2),
        (" 450deg ", 2.5 * math.pi),
        ("1.57", 1.57),
        ("-6.28", -6.28),
        (str(2 * math.pi), 2 * math.pi),
        ("1e-3", 1e-3),
        ("1.5rad", 1.5),
        ("90rad", 90.0),
    ],
)
def test_angles(text: str, radians: float) -> None:
    assert angle(text, "--yaw") == pytest.approx(radians, abs=1e-15)
    assert configuration(f"1,-2,{text}", "--start", Form.TURNING) == pytest.approx((1.0, -2.0, radians))


@given(st.floats(-1e6, 1e6))
def test_degrees_are_degrees(value: float) -> None:
    assert angle(f"{value!r}deg", "--yaw") == math.radians(value)


@pytest.mark.parametrize("text", ["90", "-180", "6.3", "360"])
def test_degrees_without_their_unit(text: str) -> None:
    with pytest.raises(InputError, match=rf"'{text}'.*write {text}deg for degrees"):
        angle(text, "--yaw")


@pytest.mark.parametrize("text", ["", "deg", "north", "90°", "1.57 deg deg", "90 degrees", "pi"])
def test_no_angles(text: str) -> None:
    with pytest.raises(InputError, match=r"--yaw has the yaw .* write e\.g\. 90deg or 1\.57"):
        angle(text, "--yaw")


# ----------------------------------------------------------------------------------------------- commands


def test_map_and_info(room: Path) -> None:
    told = document("info", "turning.zarr")
    space = cspace.open("turning.zarr")
    # A rectangle around its middle has half of its slices twice.
    assert (told["rotations"], told["slices"], told["rotation_cell_deg"]) == (24, 12, 15.0)
    assert told["memory_bytes"] == 12 * 40 * 20
    assert tuple(told["cells"].values()) == tuple(np.bincount(space.state.ravel(), minlength=3).tolist())
    assert told["mean_free_area_m2"] == pytest.approx((space.state == cspace.FREE).mean() * 8.0)
    flat = document("info", "flat.zarr")
    assert not {"rotations", "slices", "mean_free_area_m2"} & set(flat)
    assert flat["memory_bytes"] == 800
    lines = run("info", "turning.zarr").stdout.splitlines()
    assert "rotations       24" in lines
    assert "rotation cell   15°" in lines
    assert "memory          9,600 bytes" in lines


def test_overlaps_count_as_memory(room: Path) -> None:
    told = document(
        *("map", "room.map", "--robot", "disc:0.1", "--spacing", 0.1, "--rotations", 8, "--overlap", "-o", "o.zarr")
    )
    assert (told["rotations"], told["slices"], told["memory_bytes"]) == (8, 1, 5 * 800)


def test_plan(room: Path) -> None:
    told = document(
        *("plan", "turning.zarr", "--start", START, "--goal", GOAL, "--seed", 1, "--time-limit", 5),
        *("-o", "path.csv", "-o", "path.json", "--picture", "path.png", "--animate", "path.gif"),
    )
    assert told["solved"] and told["certified"]
    path = np.array(told["path"])
    np.testing.assert_allclose(path[[0, -1]], [[0.5, 0.5, 0.0], [2.5, 1.5, math.pi / 2]], atol=1e-12)
    np.testing.assert_allclose(np.loadtxt("path.csv", delimiter=",", skiprows=1), path)
    assert Path("path.csv").read_text().splitlines()[0] == "x,y,yaw"
    assert Path("path.gif").read_bytes().startswith(b"GIF89a")
    assert Path("path.png").read_bytes().startswith(b"\x89PNG")
    assert list(told["seconds"]) == ["read", "plan", "write", "draw", "animate"]
    for file in ("path.csv", "path.json"):
        document("plot", "turning.zarr", "--path", file, "-o", f"{file}.png")
        document("plot", "turning.zarr", "--path", file, "--strip", "-o", f"{file}.strip.png")


@pytest.mark.parametrize("curve", ["dubins", "reeds-shepp"])
def test_plan_on_curves(room: Path, curve: str) -> None:
    told = document(
        *("plan", "turning.zarr", "--start", "0.5,0.5,0", "--goal", "1.4,0.6,0.1", "--seed", 1, "--time-limit", 5),
        *("--curve", curve, "--turning-radius", 0.2, "-o", "path.csv", "-o", "path.json"),
    )
    # The table has a column more, which tells the way that the car drives.
    for file in ("path.csv", "path.json"):
        document("plot", "turning.zarr", "--path", file, "-o", f"{file}.png")
    assert told["solved"]
    path = np.array(told["path"])
    steps, turns = np.hypot(*np.diff(path[:, :2], axis=0).T), (np.diff(path[:, 2]) + math.pi) % (2 * math.pi) - math.pi
    # No piece turns tighter than the radius: a chord is shorter than its arc by a share of the turn's square.
    assert (np.abs(turns) <= steps / 0.2 * (1 + turns**2 / 12) + 1e-6).all()


def test_options_go_to_the_planner(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heard: dict[str, Any] = {}

    def plan(space: Any, start: Any, goal: Any, **options: Any) -> Any:
        heard.update(options, start=start, goal=goal)
        raise InputError("enough")

    monkeypatch.setattr(planners, "plan", plan)
    ends = ["plan", "turning.zarr", "--start", "1,1,90deg", "--goal=-1,1,-1.5"]
    assert run(*ends, "--exact", "--curve", "reeds-shepp", "--turning-radius", "0.5").stderr == "cspace: enough\n"
    assert (heard["exact"], heard["curve"], heard["turning_radius"]) == (True, "reeds-shepp", 0.5)
    assert (heard["start"], heard["goal"]) == ((1.0, 1.0, math.pi / 2), (-1.0, 1.0, -1.5))
    heard.clear()
    run(*ends)
    assert not {"exact", "curve", "turning_radius"} & set(heard)


def test_exact(room: Path) -> None:
    for file, start, goal in (("turning.zarr", START, GOAL), ("flat.zarr", "0.5,0.5", "2.5,1.5")):
        assert document("plan", file, "--start", start, "--goal", goal, "--exact", "--seed", 1)["solved"]


def test_no_path_makes_no_animation(room: Path) -> None:
    arguments = ["--start", "0.5,0.5,0", "--goal", "3.5,0.5,0", "--animate", "path.gif", "--time-limit", 1e-9]
    assert run("plan", "turning.zarr", *arguments).exit_code == 1
    assert not Path("path.gif").exists()


def test_plot(room: Path) -> None:
    for number, options in enumerate((["--yaw", "90deg"], ["--yaw=-1.5"], ["--strip"], ["--start", "1,1,90deg"], [])):
        assert document("plot", "turning.zarr", "-o", f"{number}.png", *options)["picture"] == f"{number}.png"
    assert len({Path(f"{number}.png").read_bytes() for number in range(5)}) == 5


def test_export_of_a_slice(room: Path) -> None:
    document("export", "turning.zarr", "slice.yaml", "--yaw", "90deg")
    image = cspace.Workspace.from_ros_map("slice.yaml", unknown="occupied")
    np.testing.assert_array_equal(~image.outer, cspace.open("turning.zarr").slice_at(math.pi / 2) == cspace.FREE)


# ----------------------------------------------------------------------------------------------- bad input

_MAP = ["map", "room.map", "--robot", "disc:0.1", "--spacing", "0.1", "-o", "new.zarr"]
_PLAN = ["plan", "turning.zarr", "--start", START, "--goal", GOAL]
_FLAT = ["plan", "flat.zarr", "--start", "0.5,0.5", "--goal", "2.5,1.5"]
_PLOT = ["plot", "turning.zarr", "-o", "new.png"]

BAD: dict[str, tuple[list[str], list[str]]] = {
    "no rotations": ([*_MAP, "--rotations", "0"], ["rotations is 0", "above zero", "72"]),
    "negative rotations": ([*_MAP, "--rotations", "-4"], ["rotations is -4", "above zero"]),
    "degrees without a unit": ([*_PLAN, "--start", "1,1,90"], ["--start", "'90'", "90deg"]),
    "negative degrees without a unit": ([*_PLAN, "--goal", "1,1,-90"], ["--goal", "'-90'", "-90deg"]),
    "yaw of words": ([*_PLAN, "--goal", "1,1,north"], ["--goal", "'north'", "90deg"]),
    "yaw that is not finite": ([*_PLAN, "--start", "1,1,nan"], ["start", "nan"]),
    "yaw that is infinite": ([*_PLAN, "--start", "1,1,infdeg"], ["start", "inf"]),
    "start without a yaw": ([*_PLAN, "--start", "1,1"], ["--start", "without a yaw", "--start=1,1,90deg"]),
    "goal without a yaw": ([*_PLAN, "--goal", "1,1"], ["--goal", "without a yaw", "--goal=1,1,90deg"]),
    "four numbers": ([*_PLAN, "--goal", "1,1,1,1"], ["--goal", "'1,1,1,1'"]),
    "yaw on a flat map": ([*_FLAT, "--start", "1,1,90deg"], ["--start", "no rotations", "--start=1,1"]),
    "start in collision": ([*_PLAN, "--start", "2.05,0.5,0"], ["start", "2.05", "BLOCKED"]),
    "negative radius": (
        [*_PLAN, "--curve", "dubins", "--turning-radius", "-1"],
        ["turning-radius", "-1", "above zero"],
    ),
    "no radius": ([*_PLAN, "--curve", "dubins", "--turning-radius", "0"], ["turning-radius", "0", "above zero"]),
    "radius that is not finite": ([*_PLAN, "--curve", "dubins", "--turning-radius", "nan"], ["turning-radius", "nan"]),
    "curve without a radius": ([*_PLAN, "--curve", "dubins"], ["--curve is dubins", "--turning-radius 0.5"]),
    "radius without a curve": ([*_PLAN, "--turning-radius", "1"], ["--turning-radius is 1", "--curve dubins"]),
    "curve on a flat map": ([*_FLAT, "--curve", "dubins", "--turning-radius", "1"], ["--curve", "no rotations"]),
    "animation suffix": ([*_PLAN, "--animate", "path.mp4"], ["path.mp4", ".gif"]),
    "animation exists": ([*_PLAN, "--animate", "old.gif"], ["old.gif exists", "--overwrite"]),
    "animation in no folder": ([*_PLAN, "--animate", "absent/a.gif"], ["absent", "folder"]),
    "picture's yaw in degrees": ([*_PLOT, "--yaw", "90"], ["--yaw", "90deg"]),
    "picture's yaw of words": ([*_PLOT, "--yaw", "up"], ["--yaw", "'up'"]),
    "picture's yaw not finite": ([*_PLOT, "--yaw", "nan"], ["yaw", "nan"]),
    "picture's yaw on a flat map": (["plot", "flat.zarr", "-o", "new.png", "--yaw", "1"], ["--yaw", "no rotations"]),
    "strip of a flat map": (["plot", "flat.zarr", "-o", "new.png", "--strip"], ["--strip", "no rotations"]),
    "strip at a yaw": ([*_PLOT, "--strip", "--yaw", "1"], ["--strip", "--yaw", "drop"]),
    "strip with robots": ([*_PLOT, "--strip", "--robot-every", "1"], ["--strip", "--robot-every"]),
    "mark without a yaw": ([*_PLOT, "--start", "1,1"], ["--start", "without a yaw"]),
    "mark with a yaw": (["plot", "flat.zarr", "-o", "new.png", "--goal", "1,1,1"], ["--goal", "no rotations"]),
    "path without yaws": ([*_PLOT, "--path", "flat.csv"], ["path has shape (2, 2)", "(x, y, yaw)"]),
    "path with yaws": (["plot", "flat.zarr", "-o", "new.png", "--path", "turning.csv"], ["path has shape (2, 3)"]),
    "ragged path": ([*_PLOT, "--path", "ragged.csv"], ["ragged.csv", "x and y, and perhaps yaw"]),
    "path of four columns": ([*_PLOT, "--path", "wide.json"], ["wide.json", "yaw"]),
    "export at degrees": (["export", "turning.zarr", "new.npz", "--yaw", "90"], ["--yaw", "90deg"]),
    "export of a flat map": (["export", "flat.zarr", "new.npz", "--yaw", "1"], ["--yaw", "no rotations"]),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name: str, room: Path) -> None:
    Path("flat.csv").write_text("x,y\n1,1\n2,1\n")
    Path("turning.csv").write_text("x,y,yaw\n1,1,0\n2,1,1\n")
    Path("ragged.csv").write_text("x,y,yaw\n1,1,0\n2,1\n")
    Path("wide.json").write_text('{"path": [[1, 1, 0, 0]]}')
    Path("old.gif").write_text("precious")
    before = {file.name for file in room.iterdir()}
    arguments, words = BAD[name]
    for more in ([], ["--json"]):
        result = run(*arguments, *more)
        assert result.exit_code == 2, result.output
        assert result.stdout == ""
        assert result.stderr.count("\n") == 1, result.stderr
        assert result.stderr.startswith("cspace: ")
        for word in words:
            assert word in result.stderr
    assert {file.name for file in room.iterdir()} == before


@pytest.mark.parametrize("arguments", [[*_MAP, "--rotations", "7.5"], [*_PLAN, "--curve", "spline"]])
def test_usage_errors(arguments: list[str]) -> None:
    result = run(*arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "Error" in result.stderr
    assert "Traceback" not in result.stderr


def test_options_are_checked_before_any_work(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("work began")

    monkeypatch.setattr("cspace.io.reading.open_map", work)
    monkeypatch.setattr("cspace.workspace.Workspace.open", work)
    for arguments in (
        [*_MAP, "--rotations", "0"],
        [*_PLAN, "--start", "1,1,90"],
        [*_PLAN, "--curve", "dubins", "--turning-radius", "-1"],
        [*_PLAN, "--animate", "absent/a.gif"],
        [*_PLOT, "--yaw", "90"],
        [*_PLOT, "--strip", "--yaw", "1"],
        ["export", "turning.zarr", "new.npz", "--yaw", "90"],
    ):
        assert run(*arguments).exit_code == 2
