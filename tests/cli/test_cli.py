"""The command line: every command, its JSON, and one clear line for whatever is wrong."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import cspace
from cspace.cli import app
from cspace.cli.report import progress_line

# The goal's room is closed, the rest is one piece; cells of 0.1 m, the first row at the top.
PLAN = """type octile
height 12
width 20
map
@@@@@@@@@@@@@@@@@@@@
@............@.....@
@............@.....@
@............@.....@
@............@.....@
@......@@....@.....@
@......@@....@.....@
@............@.....@
@............@.....@
@............@.....@
@............@.....@
@@@@@@@@@@@@@@@@@@@@
"""
START, GOAL, CLOSED = "0.35,0.35", "1.05,0.85", "1.65,0.65"


def run(*arguments: object) -> Any:
    """What the command line answers, in this process."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def spawn(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """What the command line answers, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(Path(cspace.__file__).parents[1])}
    command = [sys.executable, "-m", "cspace", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300)


def document(*arguments: object) -> dict[str, Any]:
    """The JSON document of a command that succeeds; it is all that the standard output holds."""
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    found: dict[str, Any] = json.loads(result.stdout)
    return found


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("workspace") / "plan.map"
    file.write_text(PLAN)
    return file


@pytest.fixture(scope="module")
def saved(plan_file: Path) -> Path:
    file = plan_file.parent / "plan.zarr"
    assert run("map", plan_file, "--robot", "disc:0.05", "--spacing", 0.1, "-o", file).exit_code == 0
    return file


@pytest.fixture
def room(tmp_path: Path, saved: Path, plan_file: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with links to the map and the workspace."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.zarr").symlink_to(saved)
    (tmp_path / "plan.map").symlink_to(plan_file)
    return tmp_path


# ----------------------------------------------------------------------------------------------- help and version


def test_help_is_light(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "sys.argv = ['cspace', '--help']\n"
        "from cspace.cli import main\n"
        "try:\n"
        "    main()\n"
        "finally:\n"
        "    heavy = {'numpy', 'scipy', 'numba', 'shapely', 'matplotlib', 'zarr', 'xarray', 'yaml', 'ompl', 'PIL'}\n"
        "    assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(cspace.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    for command in ("demo", "map", "plan", "info", "plot", "export"):
        assert f"\n  {command} " in done.stdout


@pytest.mark.parametrize("command", ["demo", "map", "plan", "info", "plot", "export"])
def test_help_of_each_command(command: str) -> None:
    result = run(command, "--help")
    assert result.exit_code == 0
    assert "--json" in result.stdout


def test_version(tmp_path: Path) -> None:
    done = spawn("--version", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"cspace {cspace.__version__}\n", "")


# ----------------------------------------------------------------------------------------------- commands


def test_demo(tmp_path: Path) -> None:
    done = spawn("demo", "--output", "new/demo", "--json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    told = json.loads(done.stdout)
    assert told["path_exists"] == {"start_to_goal": True, "start_to_store_room": False}
    assert told["plan"]["certified"] is True
    assert told["plan"]["length_m"] > 15.0
    assert told["plan"]["clearance_m"] >= 0.0
    assert sum(told["map"]["cells"].values()) == np.prod(told["map"]["shape"])
    assert list(told["seconds"])[:2] == ["import", "draw_floor_plan"]
    for file in told["files"].values():
        assert (tmp_path / file).exists()
    space = cspace.open(tmp_path / told["files"]["map"])
    path = np.loadtxt(tmp_path / told["files"]["path_csv"], delimiter=",", skiprows=1)
    np.testing.assert_allclose(path, told["plan"]["path"])
    assert np.asarray(space.motion_is_free(path[:-1], path[1:])).all()

    again = spawn("demo", "--output", "new/demo", cwd=tmp_path)
    assert (again.returncode, again.stdout) == (2, "")
    assert again.stderr.count("\n") == 1
    assert "exists" in again.stderr
    assert "--overwrite" in again.stderr

    over = run("demo", "--output", tmp_path / "new/demo", "--overwrite")
    assert over.exit_code == 0
    for words in ("cells", "precision", "length", "clearance", "certified", "seconds", "build map"):
        assert words in over.stdout


def test_map(room: Path) -> None:
    told = document("map", "plan.map", "--robot", "rect:0.2x0.1", "--spacing", 0.1, "-o", "rect.npz")
    assert told["shape"] == [20, 12]
    assert told["spacing_m"] == 0.1
    assert told["outside"] == "blocked"
    assert sum(told["cells"].values()) == 240
    space = cspace.open(room / "rect.npz")
    assert np.bincount(space.state.ravel(), minlength=3).tolist() == list(told["cells"].values())


def test_a_map_without_a_name_has_that_of_the_workspace(room: Path) -> None:
    (room / "below").mkdir()
    shutil.copy("plan.map", room / "below" / "other.map")
    command = ("map", "below/other.map", "--robot", "disc:0.05", "--spacing", 0.1)
    assert document(*command)["map"] == "other.zarr" and (room / "other.zarr").is_dir()
    assert run(*command).exit_code == 2


def test_map_options(room: Path) -> None:
    common = ["map", "plan.map", "--robot", "disc:0.05", "--spacing", 0.1]
    plain = document(*common, "-o", "plain.zarr")
    assert not plain["overlaps"]
    assert document(*common, "-o", "o.zarr", "--overlap")["overlaps"]
    assert document(*common, "-o", "n.zarr", "--no-inner")["cells"]["blocked"] == 0
    assert document(*common, "-o", "f.zarr", "--outside", "free")["outside"] == "free"
    grown = document(*common, "-o", "m.zarr", "--margin", 0.2)
    assert grown["margin_m"] == 0.2
    assert grown["cells"]["free"] < plain["cells"]["free"]


def test_map_unknown(room: Path) -> None:
    np.savetxt("sensor.pgm", np.full((4, 6), 205), fmt="%d", header="P2\n6 4\n255", comments="")
    Path("sensor.yaml").write_text(
        "image: sensor.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    common = ["map", "sensor.yaml", "--robot", "disc:0.01", "--outside", "free"]
    assert document(*common, "-o", "a.zarr")["cells"]["free"] == 0
    assert document(*common, "-o", "b.zarr", "--unknown", "free")["cells"]["free"] == 24


def test_plan(room: Path) -> None:
    told = document(
        *("plan", "plan.zarr", f"--start={START}", "--goal", GOAL, "--seed", 3, "--time-limit", 2),
        *("-o", "path.csv", "-o", "path.json", "--picture", "path.png", "--planner", "rrtconnect"),
    )
    assert told["solved"]
    assert told["certified"]
    assert told["path"][0] == [0.35, 0.35]
    assert told["path"][-1] == [1.05, 0.85]
    np.testing.assert_allclose(np.loadtxt("path.csv", delimiter=",", skiprows=1), told["path"])
    assert json.loads(Path("path.json").read_text())["path"] == told["path"]
    assert Path("path.png").read_bytes().startswith(b"\x89PNG")
    for path in ("path.csv", "path.json"):
        assert document("plot", "plan.zarr", "--path", path, "-o", f"{path}.png")["picture"] == f"{path}.png"


def test_plan_options(room: Path) -> None:
    common = ["plan", "plan.zarr", "--start", START, "--goal", GOAL, "--seed", 1]
    for options in (["--no-simplify"], ["--objective", "length"], ["--objective", "clearance", "--planner", "RRTstar"]):
        assert document(*common, *options, "--time-limit", 0.5)["solved"]
    assert run(*common).exit_code == 0


def test_negative_coordinates(room: Path) -> None:
    np.save("centred.npy", np.zeros((6, 6), bool))
    space = cspace.build(
        cspace.Workspace.from_array(np.zeros((20, 20), bool), 0.1, lower=(-1.0, -1.0)), cspace.Robot.disc(0.05)
    )
    space.save(room / "centred.zarr")
    for start in (["--start=-0.5,-0.25"], ["--start", "-0.5,-0.25"]):
        assert document("plan", "centred.zarr", *start, "--goal", "0.5,-.5")["path"][0] == [-0.5, -0.25]


def test_no_path(room: Path) -> None:
    arguments = ("plan", "plan.zarr", "--start", START, "--goal", CLOSED, "-o", "path.csv", "--picture", "map.png")
    result = run(*arguments, "--json")
    assert result.exit_code == 1
    told = json.loads(result.stdout)
    assert (told["solved"], told["path_exists"]) == (False, False)
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith(f"cspace: no path from {START} to {CLOSED}: ")
    assert "proven" in result.stderr
    assert not Path("path.csv").exists()
    assert Path("map.png").exists()


def test_out_of_time(room: Path) -> None:
    # No straight edge joins the two, and the search is stopped before it begins.
    result = run("plan", "plan.zarr", "--start", "0.35,0.55", "--goal", "1.05,0.55", "--time-limit", 1e-9)
    assert result.exit_code == 1
    assert result.stderr.startswith("cspace: no path from 0.35,0.55 to 1.05,0.55: ")
    assert "proven" not in result.stderr


def test_info(room: Path) -> None:
    assert document("info", "plan.zarr")["robot"] == "disc 0.05 m"
    told = document("info", "plan.map", "--spacing", 0.1)
    assert (told["kind"], told["shape"], told["cells"]["total"]) == ("workspace", [20, 12], 240)
    assert told["cells"]["occupied"] == PLAN.count("@")
    assert document("info", "rect:0.9x0.6")["area_m2"] == pytest.approx(0.54)
    Path("robot.wkt").write_text("POLYGON ((0 0, 1 0, 0 1, 0 0))")
    assert document("info", "robot.wkt", "--as", "robot")["upper_m"] == [1.0, 1.0]
    assert document("info", "robot.wkt", "--spacing", 0.5)["shape"] == [2, 2]


def test_plot(room: Path) -> None:
    told = document("plot", "plan.zarr", "-o", "map.png", "--start", START, "--goal=1.05,0.85", "--dpi", 50)
    assert told["picture"] == "map.png"
    small = Path("map.png").stat().st_size
    assert run("plot", "plan.zarr", "-o", "map.png", "--overwrite").exit_code == 0
    assert Path("map.png").stat().st_size > small


def test_export(room: Path) -> None:
    assert document("export", "plan.zarr", "copy.npz")["output"] == "copy.npz"
    np.testing.assert_array_equal(cspace.open("copy.npz").state, cspace.open("plan.zarr").state)
    assert run("export", "plan.zarr", "ros.yaml").exit_code == 0
    assert document("info", "ros.yaml")["shape"] == [20, 12]


def test_text_is_a_table(room: Path) -> None:
    result = run("info", "plan.zarr")
    assert result.exit_code == 0
    assert "robot      disc 0.05 m\n" in result.stdout
    assert "\n  free     88\n" in result.stdout


# ----------------------------------------------------------------------------------------------- bad input

_MAP = ["map", "plan.map", "--robot", "disc:0.05", "--spacing", "0.1", "-o", "new.zarr"]
_PLAN = ["plan", "plan.zarr", "--start", START, "--goal", GOAL]

BAD: dict[str, tuple[list[str], list[str]]] = {
    "missing workspace": (["map", "absent.yaml", "--robot", "disc:1", "-o", "new.zarr"], ["absent.yaml"]),
    "unknown kind of workspace": (["map", "notes.doc", "--robot", "disc:1", "-o", "new.zarr"], [".doc", ".yaml"]),
    "missing spacing": (["map", "grid.npy", "--robot", "disc:1", "-o", "new.zarr"], ["spacing", "missing"]),
    "negative spacing": ([*_MAP, "--spacing", "-0.1"], ["spacing", "-0.1", "above zero"]),
    "spacing that is not finite": ([*_MAP, "--spacing", "nan"], ["spacing", "nan"]),
    "negative margin": ([*_MAP, "--margin", "-1"], ["margin", "-1"]),
    "bad robot": ([*_MAP, "--robot", "disk:0.3"], ["disk:0.3", "disc:RADIUS"]),
    "bad radius": ([*_MAP, "--robot", "disc:-1"], ["-1"]),
    "missing robot file": ([*_MAP, "--robot", "absent.wkt"], ["absent.wkt"]),
    "robot without area": ([*_MAP, "--robot", "line.wkt"], ["LineString", "Polygon"]),
    "map suffix": ([*_MAP, "-o", "new.xyz"], ["new.xyz", ".zarr", ".npz"]),
    "map exists": ([*_MAP, "-o", "plan.zarr"], ["plan.zarr exists", "--overwrite"]),
    "map in no folder": ([*_MAP, "-o", "absent/new.zarr"], ["absent", "folder"]),
    "map over something else": ([*_MAP, "-o", "precious", "--overwrite"], ["precious", "another name"]),
    "missing map": (["plan", "absent.zarr", *_PLAN[2:]], ["absent.zarr", "does not exist"]),
    "corrupt map": (["plan", "broken.zarr", *_PLAN[2:]], ["broken.zarr"]),
    "corrupt archive": (["info", "broken.npz"], ["broken.npz"]),
    "not a map": (["plan", "plan.map", *_PLAN[2:]], ["plan.map", "not a saved map"]),
    "unknown planner": ([*_PLAN, "--planner", "Dijkstra"], ["Dijkstra", "RRTConnect"]),
    "start in collision": ([*_PLAN, "--start", "0.05,0.05"], ["start", "0.05", "BLOCKED"]),
    "goal in collision": ([*_PLAN, "--goal", "0.75,0.55"], ["goal", "0.75", "BLOCKED"]),
    "start outside": ([*_PLAN, "--start", "-5,0"], ["start", "-5", "outside"]),
    "start of one number": ([*_PLAN, "--start", "5"], ["--start", "'5'", "two numbers"]),
    "start of three numbers": ([*_PLAN, "--start", "5,6,1"], ["--start", "yaw, 1 rad", "no rotations", "--start=5,6"]),
    "start of four numbers": ([*_PLAN, "--start", "5,6,1,2"], ["--start", "'5,6,1,2'", "two numbers"]),
    "goal of words": ([*_PLAN, "--goal", "here,there"], ["--goal", "'here,there'", "two numbers"]),
    "goal that is not finite": ([*_PLAN, "--goal", "nan,1"], ["goal", "nan"]),
    "time limit": ([*_PLAN, "--time-limit", "-1"], ["time_limit", "-1"]),
    "objective": ([*_PLAN, "--objective", "beauty"], ["beauty", "length"]),
    "path suffix": ([*_PLAN, "-o", "path.txt"], ["path.txt", ".csv", ".json"]),
    "path exists": ([*_PLAN, "-o", "notes.csv"], ["notes.csv exists", "--overwrite"]),
    "path twice": ([*_PLAN, "-o", "a.csv", "-o", "./a.csv"], ["twice"]),
    "picture suffix": ([*_PLAN, "--picture", "path.gif"], ["path.gif", ".png"]),
    "picture exists": (["plot", "plan.zarr", "-o", "old.png"], ["old.png exists", "--overwrite"]),
    "missing path": (["plot", "plan.zarr", "-o", "new.png", "--path", "absent.csv"], ["absent.csv"]),
    "not a path": (["plot", "plan.zarr", "-o", "new.png", "--path", "notes.csv"], ["notes.csv", "x and y"]),
    "empty path": (["plot", "plan.zarr", "-o", "new.png", "--path", "empty.csv"], ["empty.csv", "at least one"]),
    "not a JSON path": (["plot", "plan.zarr", "-o", "new.png", "--path", "list.json"], ["list.json", "path"]),
    "binary path": (["plot", "plan.zarr", "-o", "new.png", "--path", "old.png"], ["old.png"]),
    "resolution": (["plot", "plan.zarr", "-o", "new.png", "--dpi", "0"], ["dpi", "0"]),
    "robots": (["plot", "plan.zarr", "-o", "new.png", "--robot-every", "-1"], ["robot_every", "-1"]),
    "export suffix": (["export", "plan.zarr", "new.bmp"], ["new.bmp", ".npz", ".yaml"]),
    "export exists": (["export", "plan.zarr", "old.npz"], ["old.npz exists", "--overwrite"]),
    "export's image exists": (["export", "plan.zarr", "old.yaml"], ["old.pgm exists", "--overwrite"]),
    "demo into a file": (["demo", "--output", "notes.txt"], ["notes.txt", "folder"]),
    "demo below a file": (["demo", "--output", "notes.txt/demo"], ["notes.txt", "folder"]),
    "info of nothing": (["info", "absent.zarr"], ["absent.zarr"]),
    "info of a bad robot": (["info", "disc:wide"], ["disc:wide"]),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name: str, room: Path) -> None:
    Path("notes.txt").write_text("nothing of use")
    Path("notes.csv").write_text("x,y\nhere,there\n")
    Path("empty.csv").write_text("x,y\n")
    Path("list.json").write_text("[1, 2]")
    Path("line.wkt").write_text("LINESTRING (0 0, 1 1)")
    for file in ("old.png", "old.npz", "old.pgm", "broken.npz"):
        Path(file).write_bytes(b"\x89\xff\x00 nothing of use")
    for folder in ("precious", "broken.zarr"):
        Path(folder).mkdir()
        (Path(folder) / "zarr.json").write_text("{ nothing of use")
        (Path(folder) / "thesis.txt").write_text("years of work")
    np.save("grid.npy", np.zeros((3, 3), bool))
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
    assert (room / "precious" / "thesis.txt").exists()


def test_folder_that_may_not_be_written(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Asked of the system rather than set up, since the superuser may write everywhere.
    monkeypatch.setattr("os.access", lambda _, mode: not mode & os.W_OK)
    for arguments in (_MAP, [*_PLAN, "-o", "path.csv"], ["demo"], ["demo", "-o", "new/demo"]):
        result = run(*arguments)
        assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
        assert "written" in result.stderr


def test_outputs_are_checked_before_any_work(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("work began")

    monkeypatch.setattr("cspace.io.reading.open_map", work)
    monkeypatch.setattr("cspace.build", work, raising=False)
    monkeypatch.setattr("cspace.workspace.Workspace.open", work)
    Path("old.pgm").write_text("an image that the export would replace")
    for arguments in (
        ["export", "plan.zarr", "old.yaml"],
        [*_MAP, "-o", "plan.zarr"],
        [*_PLAN, "-o", "absent/path.csv"],
        [*_PLAN, "--picture", "absent/map.png"],
        ["plot", "plan.zarr", "-o", "absent/map.png"],
        ["export", "plan.zarr", "plan.zarr"],
        ["demo", "-o", "plan.map"],
    ):
        assert run(*arguments).exit_code == 2


@pytest.mark.parametrize(
    "arguments", [["fly"], ["map"], ["map", "a.yaml", "--robt", "disc:1"], [*_MAP, "--outside", "wet"], [*_MAP, "-x"]]
)
def test_usage_errors(arguments: list[str]) -> None:
    result = run(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "Error" in result.stderr
    assert "Traceback" not in result.stderr


def test_bad_input_in_a_process_of_its_own(room: Path) -> None:
    done = spawn(*_PLAN, "--start", "-0.5,1", cwd=room)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("cspace: start ")


# ----------------------------------------------------------------------------------------------- interruptions


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError("cannot allocate"), 2, "out of memory: cannot allocate"),
        (OSError(28, "No space left on device"), 2, "No space left on device"),
    ],
)
def test_what_comes_from_outside(
    room: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, words: str
) -> None:
    def fail(_: object) -> None:
        raise error

    monkeypatch.setattr("cspace.io.reading.open_map", fail)
    result = run("info", "plan.zarr")
    assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (code, "", 1)
    assert words in result.stderr


def test_our_own_defects_are_not_hidden(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("cspace.io.reading.open_map", fail)
    assert isinstance(run("info", "plan.zarr").exception, ZeroDivisionError)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_ctrl_c_while_planning(room: Path) -> None:
    """Interrupted in the middle of a search that would go on for a minute."""
    code = (
        "import os, signal, sys, threading, time, planners\n"
        "from cspace.cli import main\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent in the background may ignore it\n"
        "search = planners.plan\n"
        "def plan(*arguments, **options):\n"
        "    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "    return search(*arguments, **options)\n"
        "planners.plan = plan\n"
        "sys.argv[0] = 'cspace'\n"
        "main()\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(cspace.__file__).parents[1])}
    arguments = [*_PLAN, "--planner", "RRTstar", "--time-limit", "60", "-o", "path.csv"]
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=room, env=environment, capture_output=True, text=True, timeout=50
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "cspace: interrupted\n")
    assert not Path("path.csv").exists()


def test_progress_line_only_on_a_terminal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    with progress_line("working") as callback:
        assert callback is None
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_line("working") as callback:
        assert callback is not None
        callback(1, 2)
        callback(2, 2)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "working" in captured.err
