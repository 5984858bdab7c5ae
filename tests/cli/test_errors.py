"""Refusals of the command line: exit code 2, one line with options, no files."""

import os
from pathlib import Path

import pytest

from tests.helpers.commands import run

_MAP_FLOOR = ["map", "floor.npy", "--robot", "disc:0.05", "--spacing", "0.1", "-o", "new.zarr"]
_MAP_ROOMS = ["map", "rooms.npy", "--robot", "ball:0.1", "--spacing", "0.1", "-o", "new.zarr"]
_MAP_CUBE = ["map", "cube.obj", "--robot", "ball:0.1", "--spacing", "0.1", "-o", "new.zarr"]
_PLAN_PLANE = ["plan", "plane.zarr", "--start", "0.35,0.65", "--goal", "2.15,0.95"]
_PLAN_TURNING = ["plan", "turning.zarr", "--start", "0.35,0.65,0", "--goal", "2.15,0.95,90deg"]
_PLAN_SPACE = ["plan", "space.zarr", "--start", "0.35,0.65,0.45", "--goal", "2.15,0.65,0.45"]
_PLOT_PLANE = ["plot", "plane.zarr", "-o", "new.png"]

REFUSED_COMMANDS: dict[str, tuple[list[str], list[str]]] = {
    # map
    "missing workspace": (
        ["map", "absent.yaml", "--robot", "disc:1", "-o", "new.zarr"],
        ["absent.yaml"],
    ),
    "unknown kind of workspace": (
        ["map", "notes.doc", "--robot", "disc:1", "-o", "new.zarr"],
        [".doc", ".yaml"],
    ),
    "missing spacing": ([*_MAP_FLOOR[:4], *_MAP_FLOOR[6:]], ["--spacing", "missing", "floor.npy"]),
    "missing spacing of a mesh": (
        [*_MAP_CUBE[:4], *_MAP_CUBE[6:]],
        ["--spacing", "missing", "cube.obj", "--spacing=0.05"],
    ),
    "negative spacing": ([*_MAP_FLOOR, "--spacing", "-0.1"], ["--spacing is -0.1", "above zero"]),
    "spacing that is not finite": ([*_MAP_FLOOR, "--spacing", "nan"], ["--spacing is nan"]),
    "negative margin": ([*_MAP_FLOOR, "--margin", "-1"], ["--margin is -1"]),
    "bad robot": ([*_MAP_FLOOR, "--robot", "disk:0.3"], ["disk:0.3", "disc:RADIUS"]),
    "bad radius": ([*_MAP_FLOOR, "--robot", "disc:-1"], ["-1"]),
    "box of two": ([*_MAP_ROOMS, "--robot", "box:0.1x0.2"], ["box:0.1x0.2", "XxYxZ"]),
    "missing robot file": ([*_MAP_FLOOR, "--robot", "absent.wkt"], ["absent.wkt"]),
    "robot without area": ([*_MAP_FLOOR, "--robot", "line.wkt"], ["LineString", "Polygon"]),
    "plane robot": (
        [*_MAP_ROOMS, "--robot", "disc:0.1"],
        ["--robot", "2 dimensions", "workspace has 3"],
    ),
    "plane robot among meshes": (
        [*_MAP_CUBE, "--robot", "disc:0.1"],
        ["--robot has 2 dimensions", "workspace has 3"],
    ),
    "solid robot in the plane": (
        [*_MAP_FLOOR, "--robot", "ball:0.1"],
        ["--robot has 3 dimensions", "workspace has 2", "footprint"],
    ),
    "no rotations": ([*_MAP_FLOOR, "--rotations", "0"], ["--rotations is '0'", "above zero", "72"]),
    "quaternions in the plane": (
        [*_MAP_FLOOR, "--rotations", "quaternions:2"],
        ["by its yaw", "rotations=72"],
    ),
    "robot solid without mesh": (
        [*_MAP_ROOMS, "--robot-solid", "fill"],
        ["solid", "ball:0.1", ".stl"],
    ),
    "packages without URDF": (
        [*_MAP_ROOMS, "--package-dir", "."],
        ["--package-dir", "ball:0.1", ".urdf"],
    ),
    "solid without mesh": (
        [*_MAP_ROOMS, "--solid", "fill"],
        ["solid", "rooms.npy", "leave it out"],
    ),
    "radius without points": (
        [*_MAP_CUBE, "--radius", "1"],
        ["radius", "cube.obj", "leave it out"],
    ),
    "radius below zero": (["map", "cloud.xyz", *_MAP_CUBE[2:], "--radius", "-1"], ["-1"]),
    "unknown without sensor map": (
        [*_MAP_CUBE, "--unknown", "free"],
        ["unknown", "cube.obj", "leave it out"],
    ),
    "bounds of words": ([*_MAP_CUBE, "--bounds", "here"], ["--bounds is 'here'", "or six"]),
    "bounds reversed": ([*_MAP_CUBE, "--bounds", "0,0,0,1,-1,1"], ["bounds", "must be above"]),
    "bounds of the plane": ([*_MAP_CUBE, "--bounds", "0,0,1,1"], ["bounds", "six numbers"]),
    "bounds of voxels": (
        [*_MAP_ROOMS, "--bounds", "0,0,0,1,1,1"],
        ["bounds", "rooms.npy", "leave it out"],
    ),
    "empty mesh": (["map", "empty.stl", *_MAP_CUBE[2:]], ["empty.stl"]),
    "empty octomap": (["map", "empty.bt", "--robot", "ball:0.1", "-o", "new.zarr"], ["empty.bt"]),
    "far too small spacing": ([*_MAP_CUBE, "--spacing", "1e-6"], ["memory", "spacing of at least"]),
    "map as a workspace": (
        ["map", "space.zarr", *_MAP_ROOMS[2:]],
        ["space.zarr: holds no array", "not a saved map"],
    ),
    "map suffix": ([*_MAP_FLOOR, "-o", "new.xyz"], ["new.xyz", ".zarr"]),
    "map into an export": ([*_MAP_FLOOR, "-o", "new.npz"], ["new.npz", ".zarr"]),
    "map exists": ([*_MAP_FLOOR, "-o", "plane.zarr"], ["plane.zarr: exists", "--overwrite"]),
    "map in a missing folder": ([*_MAP_FLOOR, "-o", "absent/new.zarr"], ["absent", "folder"]),
    "map over something else": (
        [*_MAP_FLOOR, "-o", "precious", "--overwrite"],
        ["precious", "another name"],
    ),
    # plan
    "missing map": (["plan", "absent.zarr", *_PLAN_PLANE[2:]], ["absent.zarr", "does not exist"]),
    "corrupt map": (["plan", "broken.zarr", *_PLAN_PLANE[2:]], ["broken.zarr"]),
    "not a map": (["plan", "wall.wkt", *_PLAN_PLANE[2:]], ["wall.wkt", "not a saved map"]),
    "unknown planner": ([*_PLAN_PLANE, "--planner", "Dijkstra"], ["Dijkstra", "RRTConnect"]),
    "start in collision": ([*_PLAN_PLANE, "--start", "1.25,0.05"], ["start", "1.25", "BLOCKED"]),
    "goal in collision": ([*_PLAN_SPACE, "--goal", "1.25,0.1,0.4"], ["goal", "BLOCKED"]),
    "start outside": ([*_PLAN_PLANE, "--start", "-5,0"], ["start", "-5", "outside"]),
    "start of one number": (
        [*_PLAN_PLANE, "--start", "5"],
        ["--start is '5'", "x,y, in metres", "e.g. --start=0.5,0.5"],
    ),
    "start of three numbers": (
        [*_PLAN_PLANE, "--start", "5,6,1"],
        ["--start is '5,6,1'", "configurations are x,y"],
    ),
    "start without a yaw": (
        [*_PLAN_TURNING, "--start", "1,1"],
        ["--start is '1,1'", "x,y,yaw", "--start=0.5,0.5,90deg"],
    ),
    "start without z": (
        [*_PLAN_SPACE, "--start", "1,1"],
        ["--start is '1,1'", "x,y,z", "--start=0.5,0.5,0.5"],
    ),
    "goal with a yaw": ([*_PLAN_SPACE, "--goal", "1,1,90deg"], ["--goal is '1,1,90deg'", "x,y,z"]),
    "goal that is not finite": ([*_PLAN_PLANE, "--goal", "nan,1"], ["--goal[0] is nan"]),
    "degrees without a unit": (
        [*_PLAN_TURNING, "--start", "1,1,90"],
        ["--start has the yaw '90'", "90deg"],
    ),
    "yaw of words": (
        [*_PLAN_TURNING, "--goal", "1,1,north"],
        ["--goal has the yaw 'north'", "90deg"],
    ),
    "yaw that is infinite": ([*_PLAN_TURNING, "--start", "1,1,infdeg"], ["start", "inf"]),
    "time limit": ([*_PLAN_PLANE, "--time-limit", "-1"], ["--time-limit is -1"]),
    "objective": ([*_PLAN_PLANE, "--objective", "beauty"], ["--objective", "beauty", "length"]),
    "negative radius of a curve": (
        [*_PLAN_TURNING, "--drive", "dubins", "--turning-radius", "-1"],
        ["turning-radius is -1"],
    ),
    "curve without a radius": (
        [*_PLAN_TURNING, "--drive", "dubins"],
        ["--turning-radius is missing", "dubins"],
    ),
    "radius without a curve": (
        [*_PLAN_TURNING, "--turning-radius", "1"],
        ["--turning-radius is 1", "dubins"],
    ),
    "curve without rotations": (
        [*_PLAN_PLANE, "--drive", "dubins", "--turning-radius", "1"],
        ["--drive is 'dubins'", "(x, y)", "with rotations=72"],
    ),
    "animation suffix": ([*_PLAN_TURNING, "--animate", "path.mp4"], ["path.mp4", ".gif"]),
    "path suffix": ([*_PLAN_PLANE, "-o", "path.txt"], ["path.txt", ".csv", ".json"]),
    "path exists": ([*_PLAN_PLANE, "-o", "notes.csv"], ["notes.csv: exists", "--overwrite"]),
    "path twice": ([*_PLAN_PLANE, "-o", "a.csv", "-o", "./a.csv"], ["twice"]),
    "picture suffix": ([*_PLAN_PLANE, "--picture", "path.gif"], ["path.gif", ".png"]),
    # plot and export
    "picture exists": (["plot", "plane.zarr", "-o", "old.png"], ["old.png: exists", "--overwrite"]),
    "missing path": ([*_PLOT_PLANE, "--path", "absent.csv"], ["absent.csv"]),
    "not a path": ([*_PLOT_PLANE, "--path", "notes.csv"], ["notes.csv: has no path", "x, y"]),
    "empty path": ([*_PLOT_PLANE, "--path", "empty.csv"], ["empty.csv", "at least one"]),
    "not a JSON path": ([*_PLOT_PLANE, "--path", "list.json"], ["list.json", "path"]),
    "binary path": ([*_PLOT_PLANE, "--path", "old.png"], ["old.png"]),
    "ragged path": ([*_PLOT_PLANE, "--path", "ragged.csv"], ["ragged.csv"]),
    "path with yaws": (
        [*_PLOT_PLANE, "--path", "yaws.csv"],
        ["yaws.csv: has x, y, yaw", "axes are x, y;"],
    ),
    "path of five": ([*_PLOT_PLANE, "--path", "wide.json"], ["wide.json", "x, y"]),
    "path of four": ([*_PLOT_PLANE, "--path", "four.json"], ["four.json", "x, y"]),
    "resolution": ([*_PLOT_PLANE, "--dpi", "0"], ["--dpi is 0", "in pixels per inch\n"]),
    "resolution beyond memory": (
        [*_PLOT_PLANE, "--dpi", "100000"],
        ["--dpi is 100000", "at most 2,400"],
    ),
    "yaw in degrees": (
        ["plot", "turning.zarr", "-o", "new.png", "--rotation", "90"],
        ["--rotation has the yaw", "90deg"],
    ),
    "yaw without rotations": (
        [*_PLOT_PLANE, "--rotation", "1"],
        ["--rotation is '1'", "the map has no rotations"],
    ),
    "view of the plane": ([*_PLOT_PLANE, "--view", "3d"], ["--view is '3d'", "(x, y)"]),
    "point of the plane": (
        ["plot", "turning.zarr", "-o", "new.png", "--center", "1,1,1"],
        ["--center is '1,1,1'", "configurations are x,y"],
    ),
    "point beyond": (
        ["plot", "space.zarr", "-o", "new.png", "--center", "9,9.2,9"],
        ["--center is [9.0, 9.2, 9.0]", "the grid is from"],
    ),
    "point of two": (
        ["plot", "space.zarr", "-o", "new.png", "--center", "1,1"],
        ["--center is '1,1'", "x,y,z"],
    ),
    "point of 3d": (
        ["plot", "space.zarr", "-o", "n.png", "--center", "1,1,1", "--view", "3d"],
        ["--center is given without zoom", "--zoom=8"],
    ),
    "cut of sections": (
        ["plot", "space.zarr", "-o", "n.png", "--cut", "1"],
        ["--cut", "view 3d"],
    ),
    "export suffix": (["export", "plane.zarr", "new.bmp"], ["new.bmp", ".npz", ".yaml"]),
    "export exists": (["export", "plane.zarr", "old.npz"], ["old.npz: exists", "--overwrite"]),
    "export's image exists": (
        ["export", "plane.zarr", "old.yaml"],
        ["old.pgm: exists", "--overwrite"],
    ),
    "export to the plane": (["export", "space.zarr", "new.yaml"], ["new.yaml", "plane"]),
    "export of both to the plane": (
        ["export", "both.zarr", "new.yaml"],
        ["new.yaml", ".yaml holds maps of the plane only"],
    ),
    "export of the plane": (
        ["export", "plane.zarr", "new.stl"],
        [".stl holds maps in space only", ".vti"],
    ),
    "export at a yaw": (
        ["export", "plane.zarr", "new.npz", "--rotation", "1"],
        ["--rotation", "the map has no rotations"],
    ),
    # demo and info
    "demo into a file": (["demo", "--output", "notes.txt"], ["notes.txt", "folder"]),
    "demo below a file": (["demo", "--output", "notes.txt/demo"], ["notes.txt", "folder"]),
    "info of nothing": (["info", "absent.zarr"], ["absent.zarr"]),
    "map in an export": (["info", "broken.npz"], ["broken.npz", "numpy.load", "space.save"]),
    "info of a bad robot": (["info", "disc:wide"], ["disc:wide"]),
    "info of a map with a spacing": (
        ["info", "space.zarr", "--spacing", "1"],
        ["--spacing is given, but space.zarr is read as map; omit it"],
    ),
    "info of packages without a robot": (
        ["info", "cube.obj", "--package-dir", "."],
        ["--package-dir is given, but cube.obj is read as workspace"],
    ),
    "info of voxels without a spacing": (["info", "rooms.npy"], ["--spacing", "missing"]),
}


@pytest.mark.parametrize("name", REFUSED_COMMANDS)
def test_invalid_input_is_refused_in_one_line(name: str, room: Path) -> None:
    for file, text in {
        "notes.txt": "nothing of use",
        "notes.csv": "x,y\nhere,there\n",
        "empty.csv": "x,y\n",
        "list.json": "[1, 2]",
        "line.wkt": "LINESTRING (0 0, 1 1)",
        "yaws.csv": "x,y,yaw\n1,1,0\n2,1,1\n",
        "ragged.csv": "x,y\n1,1\n2\n",
        "wide.json": '{"path": [[1, 1, 0, 0, 0]]}',
        "four.json": '{"path": [[1, 1, 0, 0]]}',
        "empty.stl": "",
        "empty.bt": "",
    }.items():
        Path(file).write_text(text)
    for file in ("old.png", "old.npz", "old.pgm", "broken.npz"):
        Path(file).write_bytes(b"\x89\xff\x00 nothing of use")
    for folder in ("precious", "broken.zarr"):
        Path(folder).mkdir()
        (Path(folder) / "zarr.json").write_text("{ nothing of use")
        (Path(folder) / "thesis.txt").write_text("years of work")
    before = {file.name for file in room.iterdir()}
    arguments, parts = REFUSED_COMMANDS[name]
    result = run(*arguments, *(["--json"] if len(name) % 2 else []))
    assert result.exit_code == 2, result.exception or result.output
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1, result.stderr
    assert result.stderr.startswith("cspace: ")
    for part in parts:
        assert part in result.stderr
    assert {file.name for file in room.iterdir()} == before
    assert (room / "precious" / "thesis.txt").exists()


def test_options_are_checked_before_any_work(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("work began")

    for name in ("opening.open_map", "workspace.Workspace.open", "shapes.mesh.Mesh.of"):
        monkeypatch.setattr(f"cspace.{name}", work)
    for name in (
        "no rotations",
        "bounds of words",
        "bounds reversed",
        "map exists",
        "animation suffix",
        "path twice",
        "info of a map with a spacing",
    ):
        result = run(*REFUSED_COMMANDS[name][0])
        assert result.exit_code == 2, (name, result.exception)


def test_unwritable_folder_is_refused(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # os.access is patched, because the superuser may write everywhere.
    monkeypatch.setattr("os.access", lambda _, mode: not mode & os.W_OK)
    for arguments in (
        _MAP_FLOOR,
        [*_PLAN_PLANE, "-o", "path.csv"],
        ["demo"],
        ["demo", "-o", "new/demo"],
    ):
        result = run(*arguments)
        assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
        assert "written" in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        *(
            ["fly"],
            ["map"],
            ["map", "a.yaml", "--robt", "disc:1"],
            [*_MAP_FLOOR, "--outside", "wet"],
            [*_MAP_FLOOR, "-x"],
        ),
        *([*_MAP_FLOOR, "--rotations", "7.5"], [*_PLAN_TURNING, "--drive", "spline"]),
    ],
)
def test_invalid_usage_is_refused_in_one_line(arguments: list[str]) -> None:
    result = run(*arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.startswith("cspace: ") and result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError("cannot allocate"), 2, "out of memory: cannot allocate"),
        (OSError(28, "No space left on device"), 2, "No space left on device"),
        (ZeroDivisionError(), 1, ""),  # defects stay visible
    ],
)
def test_interruptions_and_system_errors_end_in_one_line(
    room: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, message: str
) -> None:
    def fail(_: object) -> None:
        raise error

    monkeypatch.setattr("cspace.opening.open_map", fail)
    result = run("info", "plane.zarr")
    assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (code, "", bool(message))
    assert message in result.stderr
    assert isinstance(result.exception, SystemExit if message else ZeroDivisionError)
