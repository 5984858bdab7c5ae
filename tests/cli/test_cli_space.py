"""The command line in space: meshes, voxels and points, what they would take, and one clear line for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cspace.cli.forms import Form, configuration, form_of
from typer.testing import CliRunner

import cspace
import planners
from cspace.cli import app
from cspace.cli.options import box
from cspace.cli.words import in_options
from cspace.errors import InputError
from cspace.memory import MESH_BYTES, map_bytes

# Two rooms of 1.2 m by 1.2 m by 0.8 m with a window between them, and a cupboard that is shut; cells of 0.1 m.
START, GOAL, SHUT = "0.35,0.65,0.45", "2.15,0.65,0.45", "2.35,0.15,0.15"

CUBE = """v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 1 3 2
f 1 4 3
f 5 6 7
f 5 7 8
f 1 2 6
f 1 6 5
f 2 3 7
f 2 7 6
f 3 4 8
f 3 8 7
f 4 1 5
f 4 5 8
"""


def run(*arguments: object) -> Any:
    """What the command line answers, in this process."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def document(*arguments: object, warning: str = "") -> dict[str, Any]:
    """The JSON document of a command that succeeds, with one warning or none."""
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.stderr or result.exception
    assert result.stderr.count("\n") == bool(warning), result.stderr
    assert result.stderr.startswith("cspace: warning: " if warning else "")
    assert warning in result.stderr
    found: dict[str, Any] = json.loads(result.stdout)
    return found


def rooms() -> np.ndarray[Any, Any]:
    occupied = np.zeros((25, 12, 8), dtype=bool)
    occupied[12] = True
    occupied[12, 4:8, 2:6] = False
    occupied[21:, :4, :4] = True
    occupied[22:, :3, :3] = False
    return occupied


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of every kind, and maps of space and of the plane."""
    folder = tmp_path_factory.mktemp("space")
    occupied = rooms()
    np.save(folder / "rooms.npy", occupied)
    np.save(folder / "floor.npy", occupied[:, :, 4])
    rows = ["voxel 25 12 8", *(" ".join(map(str, index)) for index in np.argwhere(occupied).tolist())]
    (folder / "rooms.3dmap").write_text("\n".join(rows) + "\n")
    (folder / "cube.obj").write_text(CUBE)
    (folder / "open.obj").write_text(CUBE.rpartition("f ")[0])
    (folder / "cloud.xyz").write_text("0 0 0\n1 0 0\n1 2 0.5\n")
    common = ["--robot", "box:0.1x0.1x0.1", "--spacing", 0.1, "-o"]
    assert run("map", folder / "rooms.npy", *common, folder / "space.zarr").exit_code == 0
    assert run("map", folder / "rooms.npy", *common, folder / "space.npz").exit_code == 0
    flat = ["map", folder / "floor.npy", "--robot", "rect:0.2x0.1", "--spacing", 0.1]
    assert run(*flat, "-o", folder / "flat.zarr").exit_code == 0
    assert run(*flat, "--rotations", 8, "-o", folder / "turning.npz").exit_code == 0
    return folder


@pytest.fixture
def room(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for file in folder.iterdir():
        (tmp_path / file.name).symlink_to(file)
    return tmp_path


# ----------------------------------------------------------------------------------------------- configurations


@pytest.mark.parametrize(
    ("file", "form"),
    [
        ("space.zarr", Form.SPACE),
        ("space.npz", Form.SPACE),
        ("flat.zarr", Form.PLANE),
        ("turning.npz", Form.TURNING),
    ],
)
def test_form_of_a_map_is_told_without_reading_it(
    room: Path, monkeypatch: pytest.MonkeyPatch, file: str, form: Form
) -> None:
    monkeypatch.setattr("cspace.io.reading.open_map", None)
    assert form_of(Path(file)) is form


def test_configurations() -> None:
    assert configuration("1,-2", "--start", Form.PLANE) == (1.0, -2.0)
    assert configuration("1,-2, 90", "--start", Form.SPACE) == (1.0, -2.0, 90.0)
    assert configuration("1,-2,90deg", "--start", Form.TURNING) == (1.0, -2.0, np.pi / 2)


@pytest.mark.parametrize("text", ["1,2", "1", "1,2,3,4", "1,2,90deg", "1,2,", "a,b,c", ""])
def test_no_configurations_of_space(text: str) -> None:
    with pytest.raises(InputError, match=r"--start is .* of space.* x, y and z.*--start="):
        configuration(text, "--start", Form.SPACE)


def test_boxes() -> None:
    assert box("-1,0, 2,3", "--bounds") == (-1.0, 0.0, 2.0, 3.0)
    assert box("-1,0,0,2,3,1e1", "--bounds") == (-1.0, 0.0, 0.0, 2.0, 3.0, 10.0)


# ----------------------------------------------------------------------------------------------- map


def test_map(room: Path) -> None:
    told = document("map", "rooms.npy", "--robot", "box:0.2x0.2x0.2", "--spacing", 0.1, "-o", "new.zarr")
    space = cspace.open("new.zarr")
    assert told["shape"] == [25, 12, 8]
    assert tuple(told["cells"].values()) == space.count()
    assert told["free_volume_m3"] == pytest.approx(space.count()[0] * 1e-3)
    assert "free_area_m2" not in told
    lines = run("info", "new.zarr").stdout.splitlines()
    assert f"free volume  {told['free_volume_m3']:.6g} m³" in lines


@pytest.mark.parametrize("robot", ["ball:0.1", "box:0.2x0.1x0.3", "cube.obj"])
def test_every_kind_of_robot(room: Path, robot: str) -> None:
    told = document("map", "rooms.3dmap", "--robot", robot, "-o", "new.npz", "--outside", "free")
    assert told["shape"] == [25, 12, 8]
    assert 0 < told["cells"]["free"] < 2400
    assert cspace.open("new.npz").robot.dim == 3


def test_map_of_a_mesh(room: Path) -> None:
    common = ["map", "cube.obj", "--robot", "ball:0.1", "--spacing", 0.25, "--bounds=-1,-1,-1,2,2,2"]
    told = document(*common, "-o", "a.zarr")
    assert (told["lower_m"], told["shape"]) == ([-1.0] * 3, [12] * 3)
    assert cspace.open("a.zarr").classify([0.5, 0.5, 0.5]) == cspace.BLOCKED
    document(*common, "--solid", "surface", "-o", "b.zarr")
    assert cspace.open("b.zarr").classify([0.5, 0.5, 0.5]) != cspace.BLOCKED


def test_an_open_mesh_is_a_warning_of_one_line(room: Path) -> None:
    common = ["map", "open.obj", "--robot", "ball:0.1", "--spacing", 0.25]
    document(*common, "-o", "a.zarr", warning="1 of 1 bodies of open.obj are open")
    document(*common, "--solid", "fill", "-o", "b.zarr")
    occupied = [np.count_nonzero(cspace.open(name).workspace.inner) for name in ("a.zarr", "b.zarr")]
    assert occupied[0] < occupied[1]
    told = run("map", "rooms.3dmap", "--robot", "open.obj", "-o", "c.zarr")
    assert (told.exit_code, told.stderr.count("\n")) == (0, 1)
    assert document("map", "rooms.3dmap", "--robot", "open.obj", "--robot-solid", "surface", "-o", "d.zarr")
    assert cspace.open("d.zarr").robot.spec["solid"] == "surface"


def test_map_of_points(room: Path) -> None:
    common = ["map", "cloud.xyz", "--robot", "ball:0.05", "--spacing", 0.1, "--bounds", "-1,-1,-1,2,3,1"]
    thin = document(*common, "-o", "a.zarr")["cells"]
    thick = document(*common, "--radius", 0.4, "-o", "b.zarr")["cells"]
    assert thick["free"] < thin["free"]
    assert thin["blocked"] < thick["blocked"]


def test_bounds_in_the_plane(room: Path) -> None:
    Path("wall.wkt").write_text("POLYGON ((0 0, 1 0, 0 1, 0 0))")
    told = document(
        *("map", "wall.wkt", "--robot", "disc:0.1", "--spacing", 0.5, "--bounds=-1,-1,2,3", "-o", "new.zarr")
    )
    assert (told["lower_m"], told["shape"]) == ([-1.0, -1.0], [6, 8])


def test_real_building(room: Path, data: Path) -> None:
    common = ["map", data / "voxels/geb079.bt", "--robot", "box:0.6x0.6x0.2"]
    known = document(*common, "-o", "known.zarr")
    loose = document(*common, "--unknown", "free", "-o", "loose.zarr")
    assert known["shape"] == loose["shape"] == [487, 187, 39]
    assert 0 < known["cells"]["free"] < loose["cells"]["free"]


# ----------------------------------------------------------------------------------------------- info


def test_info_of_a_mesh(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("work began")

    monkeypatch.setattr("cspace.raster.solids.rasterize_mesh", work)
    told = document("info", "cube.obj")
    assert (told["kind"], told["extents_m"], told["triangles"]) == ("workspace", [1.0] * 3, 12)
    assert (told["watertight"], told["bodies"], told["volume_m3"]) == (True, {"closed": 1, "open": 0}, 1.0)
    assert not {"cells", "memory", "spacing_m"} & set(told)
    told = document("info", "cube.obj", "--spacing", 0.01, "--bounds=0,0,0,2,1,1", "--robot", "box:0.1x0.2x0.3")
    assert (told["shape"], told["cells"]) == ([200, 100, 100], {"total": 2_000_000})
    assert told["memory"]["needed_bytes"] == max(MESH_BYTES * 2_000_000, 4_000_000 + map_bytes((200, 100, 100)))
    assert told["memory"]["fits"] is True
    assert (told["robot"]["name"], told["robot"]["cells_across"]) == ("box 0.1 m x 0.2 m x 0.3 m", [10, 20, 30])
    told = document("info", "open.obj", warning="open")
    assert (told["watertight"], told["bodies"]) == (False, {"closed": 0, "open": 1})
    assert "volume_m3" not in told


def test_info_tells_what_does_not_fit(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = document("info", "cube.obj", "--spacing", 1e-7)
    assert told["cells"]["total"] == 10**21
    assert told["memory"]["fits"] is False
    assert "use a spacing of at least" in told["memory"]["problem"]
    # The building agrees.
    result = run("map", "cube.obj", "--spacing", 1e-7, "--robot", "ball:0.1", "-o", "new.zarr")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "use a spacing of at least" in result.stderr
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 1_000_000)
    assert document("info", "rooms.3dmap")["memory"]["fits"] is False


def test_info_of_voxels(room: Path) -> None:
    taken = int(rooms().sum())
    for arguments, side in ((["rooms.3dmap"], 1.0), (["rooms.npy", "--spacing", 0.5], 0.5)):
        told = document("info", *arguments)
        assert told["cells"] == {"occupied": taken, "free": 2400 - taken, "total": 2400}
        assert told["extents_m"] == [25 * side, 12 * side, 8 * side]
        assert told["memory"]["fits"] is True
    assert "  needed  " in run("info", "rooms.3dmap").stdout


def test_info_of_points(room: Path) -> None:
    told = document("info", "cloud.xyz", "--radius", 0.25)
    assert (told["points"], told["lower_m"], told["upper_m"]) == (3, [-0.25] * 3, [1.25, 2.25, 0.75])
    assert document("info", "cloud.xyz", "--spacing", 0.5)["shape"] == [2, 4, 1]


def test_info_of_robots(room: Path) -> None:
    told = document("info", "cube.obj", "--as", "robot", "--spacing", 0.3)
    assert (told["robot"], told["watertight"], told["volume_m3"]) == ("mesh cube.obj", True, 1.0)
    assert (told["extents_m"], told["cells_across"]) == ([1.0] * 3, [4] * 3)
    assert document("info", "box:1x2x3")["volume_m3"] == 6.0
    told = document("info", "open.obj", "--as", "robot", "--solid", "surface")
    assert (told["watertight"], told["bodies"]["open"]) == (False, 1)


def test_info_of_real_files(data: Path) -> None:
    told = document("info", data / "voxels/geb079.bt", "--robot", "box:0.6x0.6x0.2")
    assert (told["spacing_m"], told["shape"]) == (0.08, [487, 187, 39])
    cells = told["cells"]
    assert cells["total"] == 487 * 187 * 39 == cells["occupied"] + cells["unknown"] + cells["free"]
    assert cells["unknown"] / cells["total"] == pytest.approx(0.68, abs=0.005)
    assert document("info", data / "solids/ZTunnel/obstacles.obj")["watertight"] is True
    cells = document("info", data / "maps/tb3_sandbox.yaml")["cells"]
    assert cells["unknown"] > cells["total"] / 2


# ----------------------------------------------------------------------------------------------- plan, plot, export


def test_plan(room: Path) -> None:
    told = document(
        *("plan", "space.zarr", "--start", START, "--goal", GOAL, "--seed", 1, "--time-limit", 5),
        *("-o", "path.csv", "-o", "path.json", "--picture", "path.png"),
    )
    assert told["solved"] and told["certified"]
    path = np.array(told["path"])
    np.testing.assert_array_equal(path[[0, -1]], [[0.35, 0.65, 0.45], [2.15, 0.65, 0.45]])
    np.testing.assert_array_equal(np.loadtxt("path.csv", delimiter=",", skiprows=1), path)
    assert Path("path.csv").read_text().splitlines()[0] == "x,y,z"
    assert Path("path.png").read_bytes().startswith(b"\x89PNG")
    for file in ("path.csv", "path.json"):
        assert document("plot", "space.zarr", "--path", file, "-o", f"{file}.png")["picture"] == f"{file}.png"


def test_no_path(room: Path) -> None:
    result = run("plan", "space.zarr", "--start", START, "--goal", SHUT, "-o", "path.csv")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1), result.exception
    assert "proven" in result.stderr
    assert not Path("path.csv").exists()


def test_exact(room: Path) -> None:
    pytest.importorskip("fcl")
    assert document("plan", "space.zarr", "--start", START, "--goal", GOAL, "--exact", "--seed", 1)["certified"]


def test_options_go_to_the_planner(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heard: dict[str, Any] = {}

    def plan(space: Any, start: Any, goal: Any, **options: Any) -> Any:
        heard.update(options, start=start, goal=goal)
        raise InputError("enough")

    monkeypatch.setattr(planners, "plan", plan)
    run("plan", "space.zarr", "--start", "0.1,0.2,90", "--goal=-1,-2,-3", "--exact")
    assert (heard["start"], heard["goal"], heard["exact"]) == ((0.1, 0.2, 90.0), (-1.0, -2.0, -3.0), True)


def test_plot(room: Path) -> None:
    options = [[], ["--at", "0.3,0.6,0.4"], ["--start", START], ["--view", "3d"]]
    for number, more in enumerate([*options, ["--view", "3d", "--surface", "free"]]):
        assert document("plot", "space.zarr", "-o", f"{number}.png", "--dpi", 60, *more)
    assert len({Path(f"{number}.png").read_bytes() for number in range(5)}) == 5


def test_export(room: Path) -> None:
    for file in ("out.vti", "free.stl", "free.ply", "free.obj", "copy.npz"):
        assert document("export", "space.zarr", file)["output"] == file
    np.testing.assert_array_equal(cspace.open("copy.npz").state, cspace.open("space.zarr").state)
    assert document("info", "free.stl", "--spacing", 0.1)["watertight"] is True


# ----------------------------------------------------------------------------------------------- bad input

_MAP = ["map", "rooms.npy", "--robot", "ball:0.1", "--spacing", "0.1", "-o", "new.zarr"]
_MESH = ["map", "cube.obj", "--robot", "ball:0.1", "--spacing", "0.1", "-o", "new.zarr"]
_PLAN = ["plan", "space.zarr", "--start", START, "--goal", GOAL]
_PLOT = ["plot", "space.zarr", "-o", "new.png"]

BAD: dict[str, tuple[list[str], list[str]]] = {
    "words of the command line": (_MESH[:4] + _MESH[6:], ["--spacing 0.05"]),
    "robot of the plane, mesh": ([*_MESH, "--robot", "disc:0.1"], ["cube.obj has 3 dimensions", "robot 2"]),
    "rotations": ([*_MAP, "--rotations", "8"], ["rotations is 8", "in space"]),
    "robot of the plane": ([*_MAP, "--robot", "disc:0.1"], ["3 dimensions", "robot 2"]),
    "box of two": ([*_MAP, "--robot", "box:0.1x0.2"], ["box:0.1x0.2", "XxYxZ"]),
    "robot's solid, no mesh": ([*_MAP, "--robot-solid", "fill"], ["solid", "ball:0.1", ".stl"]),
    "solid, no mesh": ([*_MAP, "--solid", "fill"], ["solid", "rooms.npy", "leave it out"]),
    "radius, no points": ([*_MESH, "--radius", "1"], ["radius", "cube.obj", "leave it out"]),
    "radius below zero": (["map", "cloud.xyz", *_MESH[2:], "--radius", "-1"], ["-1"]),
    "unknown, no sensor": ([*_MESH, "--unknown", "free"], ["unknown", "cube.obj", "leave it out"]),
    "bounds of words": ([*_MESH, "--bounds", "here"], ["--bounds is 'here'", "four numbers", "six"]),
    "bounds of five": ([*_MESH, "--bounds", "0,0,0,1,1"], ["--bounds", "four numbers", "six"]),
    "bounds reversed": ([*_MESH, "--bounds", "0,0,0,1,-1,1"], ["bounds", "must be above"]),
    "bounds of the plane": ([*_MESH, "--bounds", "0,0,1,1"], ["bounds", "six numbers"]),
    "bounds not finite": ([*_MESH, "--bounds", "0,0,0,1,1,nan"], ["bounds", "nan"]),
    "bounds of voxels": ([*_MAP, "--bounds", "0,0,0,1,1,1"], ["bounds", "rooms.npy", "leave it out"]),
    "mesh without a spacing": (_MESH[:4] + _MESH[6:], ["spacing is missing", "cube.obj"]),
    "no mesh": (["map", "empty.stl", *_MESH[2:]], ["empty.stl"]),
    "no octomap": (["map", "empty.bt", "--robot", "ball:0.1", "-o", "new.zarr"], ["empty.bt"]),
    "absurd units": ([*_MESH, "--spacing", "1e-6"], ["memory", "spacing of at least"]),
    "start of two": ([*_PLAN, "--start", "1,1"], ["--start", "without z", "x, y and z", "--start=1,1,0.5"]),
    "start of four": ([*_PLAN, "--start", "1,1,1,1"], ["--start", "three numbers", "of space"]),
    "goal with a yaw": ([*_PLAN, "--goal", "1,1,90deg"], ["--goal", "90deg", "three numbers"]),
    "goal not finite": ([*_PLAN, "--goal", "1,1,inf"], ["goal", "inf"]),
    "goal in collision": ([*_PLAN, "--goal", "1.25,0.1,0.4"], ["goal", "BLOCKED"]),
    "curve": ([*_PLAN, "--curve", "dubins", "--turning-radius", "1"], ["--curve", "of space"]),
    "animation": ([*_PLAN, "--animate", "new.gif"], ["--animate", "of space"]),
    "z in the plane": (["plan", "flat.zarr", "--start", "1,1,5", "--goal", "1,1"], ["--start", "z", "two numbers"]),
    "yaw in space": ([*_PLOT, "--yaw", "1"], ["--yaw", "of space"]),
    "strip in space": ([*_PLOT, "--strip"], ["--strip", "of space"]),
    "point beyond": ([*_PLOT, "--at", "9,9.2,9"], ["at is (9, 9.2, 9) m", "in the grid, from (0, 0, 0) m to (2.5, "]),
    "point of two": ([*_PLOT, "--at", "1,1"], ["--at", "without z"]),
    "point of a scene": ([*_PLOT, "--at", "1,1,1", "--view", "3d"], ["--at", "--view", "drop"]),
    "surface of sections": ([*_PLOT, "--surface", "free"], ["--surface", "--view 3d"]),
    "view of the plane": (["plot", "flat.zarr", "-o", "new.png", "--view", "3d"], ["--view", "of the plane"]),
    "point of the plane": (["plot", "turning.npz", "-o", "new.png", "--at", "1,1,1"], ["--at", "of the plane"]),
    "path with yaws": ([*_PLOT, "--path", "yaws.csv"], ["yaws.csv holds x, y, yaw", "x, y, z"]),
    "path of the plane": ([*_PLOT, "--path", "flat.csv"], ["path has shape (2, 2)"]),
    "export to the plane": (["export", "space.zarr", "new.yaml"], ["new.yaml", "plane"]),
    "export of the plane": (["export", "flat.zarr", "new.stl"], ["in the plane", ".vti"]),
    "export at a yaw": (["export", "space.zarr", "new.npz", "--yaw", "1"], ["--yaw", "of space"]),
    "info of a robot of the plane": (["info", "cube.obj", "--robot", "disc:0.1"], ["cube.obj", "disc", "agree"]),
    "info of a map with a spacing": (["info", "space.zarr", "--spacing", "1"], ["--spacing", "saved map"]),
    "info of a robot with bounds": (["info", "ball:1", "--bounds", "0,0,1,1"], ["--bounds", "robot", "workspaces"]),
    "info of a mesh with a radius": (["info", "cube.obj", "--radius", "1"], ["radius", "cube.obj", "leave it out"]),
    "info far away": (["info", "far.obj", "--spacing", "0.1"], ["cells from the origin"]),
    "info of a solid without a robot": (["info", "cube.obj", "--robot-solid", "fill"], ["--robot-solid", "--robot"]),
    "info of voxels without a spacing": (["info", "rooms.npy"], ["spacing is missing"]),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name: str, room: Path) -> None:
    Path("yaws.csv").write_text("x,y,yaw\n1,1,0\n2,1,1\n")
    Path("flat.csv").write_text("x,y\n1,1\n2,1\n")
    Path("far.obj").write_text(CUBE.replace("v 0", "v 1e9").replace("v 1 ", "v 1000000001 "))
    for file in ("empty.stl", "empty.bt"):
        Path(file).write_bytes(b"")
    before = {file.name for file in room.iterdir()}
    arguments, words = BAD[name]
    for more in ([], ["--json"]):
        result = run(*arguments, *more)
        assert result.exit_code == 2, result.exception or result.output
        assert result.stdout == ""
        assert result.stderr.count("\n") == 1, result.stderr
        assert result.stderr.startswith("cspace: ")
        for word in words:
            assert word in result.stderr
    assert {file.name for file in room.iterdir()} == before


def test_options_are_checked_before_any_work(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("work began")

    monkeypatch.setattr("cspace.io.reading.open_map", work)
    monkeypatch.setattr("cspace.workspace.Workspace.open", work)
    monkeypatch.setattr("cspace.Mesh.of", work)
    for arguments in (
        [*_MESH, "--bounds", "0,0,0,1,-1,1"],
        [*_MESH, "--spacing", "-1"],
        [*_MESH, "--robot-solid", "fill"],
        [*_MAP, "-o", "space.zarr"],
        [*_PLAN, "--start", "1,1"],
        [*_PLAN, "--curve", "dubins", "--turning-radius", "1"],
        [*_PLAN, "--animate", "new.gif"],
        [*_PLOT, "--strip"],
        [*_PLOT, "--at", "1,1"],
        ["plot", "flat.zarr", "-o", "new.png", "--view", "3d"],
        ["export", "space.zarr", "new.npz", "--yaw", "1"],
        ["info", "space.zarr", "--bounds", "0,0,1,1"],
        ["info", "cube.obj", "--bounds", "0,0,0,1,1"],
    ):
        assert run(*arguments).exit_code == 2, arguments


def test_dimensions_are_checked_before_a_workspace_is_read(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("work began")

    monkeypatch.setattr("cspace.workspace.Workspace.open", work)
    monkeypatch.setattr("cspace.Mesh.of", work)
    for file in ("cube.obj", "rooms.3dmap", "rooms.npy", "cloud.xyz"):
        for command in (["map", file, "-o", "new.zarr"], ["info", file]):
            more = [] if file.endswith("3dmap") else ["--spacing", "0.1"]
            result = run(*command, "--robot", "disc:0.1", *more)
            assert (result.exit_code, result.stdout) == (2, ""), result.exception
            assert f"the workspace {file} has 3 dimensions and the robot 2, a disc 0.1 m" in result.stderr
    result = run("map", "floor.npy", "--spacing", 0.1, "--robot", "ball:0.1", "-o", "new.zarr")
    assert "floor.npy has 2 dimensions and the robot 3" in result.stderr


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("pass solid='surface' if", "pass --solid surface if"),
        ("e.g. spacing=0.05 (metres)", "e.g. --spacing 0.05 (metres)"),
        ("pass robot_solid='fill'.", "pass --robot-solid fill."),
        ("ask without exact=True; or", "ask without --exact; or"),
        ("bounds=(-1, 0, 1, 2), yes", "--bounds=-1,0,1,2, yes"),
        ("e.g. rotations=72", "e.g. --rotations 72"),
        ("use Workspace.from_points, or", "use a file of points (.xyz, .pcd, .npy), or"),
        ("points[np.isfinite(points).all(axis=1)]", "points[np.isfinite(points).all(axis=1)]"),
        *((text, text) for text in ("runs/spacing=0.05/a.npy is", "spacing=0.05.npy is", "spacing=0.05/a.npy is")),
        ("e.g. yaw=0.0. Or spacing=1e-3, if", "e.g. --yaw 0.0. Or --spacing 1e-3, if"),
    ],
)
def test_what_the_library_says_in_options(said: str, told: str) -> None:
    assert in_options(said) == told


def test_warnings_name_the_option_of_the_robot_or_of_the_workspace(room: Path) -> None:
    common = ["--spacing", 0.25, "-o", "a.zarr"]
    of_map = run("map", "open.obj", "--robot", "ball:0.1", *common).stderr
    assert "--solid surface" in of_map
    assert "=" not in of_map
    told = run("map", "rooms.3dmap", "--robot", "open.obj", "-o", "b.zarr").stderr
    assert "--robot-solid surface" in told
    assert "=" not in told
    assert told.count("\n") == 1
    assert "--robot-solid" in run("info", "rooms.3dmap", "--robot", "open.obj").stderr


def test_units_that_are_probably_wrong_are_a_warning_of_one_line(room: Path) -> None:
    common = ["cube.obj", "--robot", "ball:0.1", "--spacing", 2.0]
    document("map", *common, "-o", "a.zarr", warning="fits into one cell of 2 m")
    document("info", *common, warning="fits into one cell of 2 m")
    common[-1] = 0.25
    document("map", *common, "--bounds", "5,5,5,6,6,6", "-o", "b.zarr", warning="no obstacle at all")


def test_info_of_a_grid_that_does_not_fit(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 1_000_000)
    told = document("info", "rooms.3dmap")["memory"]
    assert "a machine with more memory, or cut the file" in told["problem"]
    assert "no spacing helps" in document("info", "cube.obj", "--spacing", 0.1)["memory"]["problem"]
