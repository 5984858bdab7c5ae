"""Commands on maps of each space."""

import json
import math
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.ndimage import distance_transform_edt

import cspace
import planners
from cspace.cli import app
from cspace.cli.jobs import plan_in_plane
from cspace.cli.report import option_names, progress_line
from cspace.errors import InputError
from cspace.plot import animate
from cspace.plot.artists import PATH_COLOR
from cspace.support.compiling import cache_folder
from cspace.view.scene import rgb
from tests.helpers import urdfs
from tests.helpers.commands import COMMANDS, document, run
from tests.helpers.refusals import refusals
from tests.helpers.repository import ROOT

MAP_ENDPOINTS = {
    "plane.zarr": ("0.35,0.65", "2.15,0.95"),
    "turning.zarr": ("0.35,0.65,0", "2.15,0.95,90deg"),
    "space.zarr": ("0.35,0.65,0.45", "2.15,0.65,0.45"),
    "both.zarr": ("0.35,0.65,0.45,0", "2.15,0.65,0.45,90deg"),
    "free.zarr": ("0.35,0.65,0.45,0,0,0,1", "2.15,0.65,0.45,0,0,0.6,0.8"),
}
Drawn = tuple[Any, str, dict[str, Any]]

UNREACHABLE = {
    "plane.zarr": "2.35,0.15",
    "turning.zarr": "2.35,0.15,0",
    "space.zarr": "2.35,0.15,0.15",
}


def spawn(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command line in a separate process."""
    environment = {**os.environ, "PYTHONPATH": str(Path(cspace.__file__).parents[1])}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=60
    )


# ----------------------------------------------------------------------------------------------- help


def test_help_imports_no_heavy_module(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "from cspace.cli import app\n"
        "try:\n    app(['map', '--help'], prog_name='cspace')\n"
        "except SystemExit:\n    pass\n"
        "heavy = {'numpy', 'numba', 'scipy', 'shapely', 'trimesh', 'matplotlib', 'zarr', 'ompl'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = spawn("-c", code, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "--rotations" in done.stdout


def test_help_and_version_are_printed() -> None:
    for name, command in COMMANDS.items():
        printed = run(name, "-h")
        assert printed.exit_code == 0
        options = option_names(command).values()
        assert options and [option for option in options if option not in printed.stdout] == []
    assert run("--version").stdout == f"cspace {cspace.__version__}\n"
    assert app.info.epilog is not None


def test_compile_fills_the_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cspace.cli.jobs.JOBS", {"plan in the plane": plan_in_plane})
    printed = document("compile")
    assert printed["folder"] == str(cache_folder()) and printed["compiled_functions"] > 0
    assert printed["seconds"].keys() == {"plan in the plane"}
    monkeypatch.setattr("cspace.support.compiling.cache_folder", lambda: None)
    result = run("compile")
    assert result.exit_code == 2 and "NUMBA_CACHE_DIR" in result.stderr


# ----------------------------------------------------------------------------------------------- demo


def find_path_pixels(picture: Path) -> Any:
    """Return a mask of the pixels of a picture in the colour of paths."""
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    return np.abs(pixels - rgb(PATH_COLOR)).max(axis=2) < 24


def test_the_picture_of_the_readme_shows_the_path_of_the_demo(tmp_path: Path) -> None:
    """Compare the paths; if they differ, copy the new ``picture.png`` to ``docs/demo.png``."""
    assert run("demo", "--output", tmp_path / "demo").exit_code == 0
    shown, drawn = map(
        find_path_pixels, (ROOT / "docs" / "demo.png", tmp_path / "demo" / "picture.png")
    )
    assert shown.shape == drawn.shape and shown.any()
    for one, other in ((shown, drawn), (drawn, shown)):
        assert (
            distance_transform_edt(~other)[one].max() <= 3.0
        )  # in pixels, for other versions of the renderer


# ----------------------------------------------------------------------------------------------- map


def test_map_writes_and_describes_a_map(room: Path) -> None:
    printed = document("map", "rooms.npy", "--robot", "box:0.2x0.2x0.2", "--spacing", 0.1)
    space = cspace.open("rooms.zarr")  # named after the workspace
    assert (printed["map"], printed["shape"], printed["robot"]) == (
        "rooms.zarr",
        [25, 12, 8],
        "box 0.2 m x 0.2 m x 0.2 m",
    )
    assert tuple(printed["cells"].values()) == space.count()
    assert printed["free_volume_m3"] == pytest.approx(space.count()[0] * 1e-3)
    lines = run("info", "rooms.zarr").stdout.splitlines()
    assert f"free volume     {printed['free_volume_m3']:.6g} m³" in lines
    assert "robot           box 0.2 m x 0.2 m x 0.2 m" in lines
    assert f"  free          {space.count()[0]}" in lines


def test_options_of_map_reach_the_build(room: Path) -> None:
    common = ["map", "floor.npy", "--robot", "disc:0.15", "--spacing", 0.1]
    plain = document(*common, "-o", "plain.zarr")
    assert document(*common, "-o", "o.zarr", "--rotations", 8)["rotations"] == 8
    assert document(*common, "-o", "f.zarr", "--outside", "free")["outside"] == "free"
    grown = document(*common, "-o", "m.zarr", "--margin", 0.2)
    assert grown["margin_m"] == 0.2
    assert grown["cells"]["free"] < plain["cells"]["free"]
    np.savetxt("sensor.pgm", np.full((4, 6), 205), fmt="%d", header="P2\n6 4\n255", comments="")
    Path("sensor.yaml").write_text(
        "image: sensor.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    common = ["map", "sensor.yaml", "--robot", "disc:0.01", "--outside", "free"]
    assert document(*common, "-o", "a.zarr")["cells"]["free"] == 0
    assert document(*common, "-o", "b.zarr", "--unknown", "free")["cells"]["free"] == 24


@pytest.mark.parametrize("robot", ["ball:0.1", "box:0.2x0.1x0.3", "cube.obj"])
def test_map_accepts_every_kind_of_robot_in_space(room: Path, robot: str) -> None:
    printed = document("map", "rooms.3dmap", "--robot", robot, "-o", "new", "--outside", "free")
    assert printed["shape"] == [25, 12, 8]
    assert 0 < printed["cells"]["free"] < 2400
    assert cspace.open("new").robot.dim == 3


def test_options_set_the_grid_of_shapes(room: Path) -> None:
    common = [
        "map",
        "cube.obj",
        "--robot",
        "ball:0.1",
        "--spacing",
        0.25,
        "--bounds=-1,-1,-1,2,2,2",
    ]
    printed = document(*common, "-o", "a.zarr")
    assert (printed["lower_m"], printed["shape"]) == ([-1.0] * 3, [12] * 3)
    assert cspace.open("a.zarr").classify([0.5, 0.5, 0.5]) == cspace.BLOCKED
    document(*common, "--solid", "surface", "-o", "b.zarr")
    assert cspace.open("b.zarr").classify([0.5, 0.5, 0.5]) != cspace.BLOCKED
    points = [
        "map",
        "cloud.xyz",
        "--robot",
        "ball:0.05",
        "--spacing",
        0.1,
        "--bounds",
        "-1,-1,-1,2,3,1",
    ]
    thin, thick = (
        document(*points, *more)["cells"]
        for more in (["-o", "c.zarr"], ["--radius", 0.4, "-o", "d.zarr"])
    )
    assert thick["free"] < thin["free"]
    flat = [
        "map",
        "wall.wkt",
        "--robot",
        "disc:0.1",
        "--spacing",
        0.5,
        "--bounds=-1,-1,2,3",
        "-o",
        "e.zarr",
    ]
    printed = document(*flat)
    assert (printed["lower_m"], printed["shape"]) == ([-1.0, -1.0], [6, 8])


def test_warnings_are_printed_in_one_line(room: Path) -> None:
    common = ["map", "open.obj", "--robot", "ball:0.1", "--spacing", 0.25]
    document(*common, "-o", "a.zarr", warning="solid='surface'")
    document(*common, "--solid", "fill", "-o", "b.zarr")
    occupied = [
        np.count_nonzero(cspace.open(name).workspace.inner) for name in ("a.zarr", "b.zarr")
    ]
    assert occupied[0] < occupied[1]
    document("map", "rooms.3dmap", "--robot", "open.obj", "-o", "c.zarr", warning="solid='surface'")
    document(
        "map", "rooms.3dmap", "--robot", "open.obj", "--robot-solid", "surface", "-o", "d.zarr"
    )
    assert cspace.open("d.zarr").robot.spec["solid"] == "surface"
    cube = ["cube.obj", "--robot", "ball:0.1", "--spacing", 2.0]
    document(
        "map",
        *cube[:-1],
        0.25,
        "--bounds",
        "5,5,5,6,6,6",
        "-o",
        "e.zarr",
        warning="has no obstacle",
    )


# ----------------------------------------------------------------------------------------------- info


def test_info_describes_maps(room: Path) -> None:
    space, printed = cspace.open("turning.zarr"), document("info", "turning.zarr")
    # The rotations of a centered rectangle share slices in pairs.
    assert (printed["rotations"], printed["slices"], printed["rotation_cell_deg"]) == (8, 4, 45.0)
    assert printed["memory_bytes"] == 4 * 300
    assert tuple(printed["cells"].values()) == tuple(
        np.bincount(space.cell_states.ravel(), minlength=3).tolist()
    )
    assert printed["mean_free_area_m2"] == pytest.approx(
        (space.cell_states == cspace.FREE).mean() * 3.0
    )
    assert not {"rotations", "slices", "mean_free_area_m2"} & set(document("info", "plane.zarr"))
    lines = run("info", "turning.zarr").stdout.splitlines()
    assert "rotation cell   45°" in lines
    assert "memory          1,200 bytes" in lines


def test_info_describes_a_mesh_without_rasterizing_it(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cspace.shapes.mesh.Mesh.cells", None)
    printed = document("info", "cube.obj")
    assert (printed["kind"], printed["extents_m"], printed["triangles"]) == (
        "workspace",
        [1.0] * 3,
        12,
    )
    assert (printed["watertight"], printed["bodies"], round(printed["volume_m3"], 9)) == (
        True,
        {"closed": 1, "open": 0},
        1.0,
    )
    assert not {"cells", "spacing_m"} & set(printed)
    printed = document("info", "cube.obj", "--spacing", 0.01)
    assert (printed["shape"], printed["cells"]) == ([100, 100, 100], {"total": 1_000_000})
    printed = document("info", "open.obj", warning="open")
    assert (printed["watertight"], printed["bodies"]) == (False, {"closed": 0, "open": 1})
    assert "volume_m3" not in printed


@pytest.mark.parametrize(
    ("name", "lines", "key", "upper"),
    [
        ("cut.wkt", ["LINESTRING (0 0, 1 1)", "LINESTRING (0 0, 2 2, 0 2)"], "points", [1.0, 1.0]),
        (
            "cut.obj",
            ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 2", "f 1 2 3", "f 1 2 4"],
            "triangles",
            [1.0, 1.0, 0.0],
        ),
        *[
            (f"cut{suffix}", ["0,0,0", "1,1,1"], "points", [0.0] * 3)
            for suffix in (".xyz", ".txt", ".csv")
        ],
    ],
)
def test_info_shows_smaller_counts_of_a_truncated_text(
    room: Path, name: str, lines: list[str], key: str, upper: list[float]
) -> None:
    # A text cut between two lines looks complete; only its counts differ.
    Path(name).write_text("\n".join(lines))
    whole = document("info", name, warning="open" if name == "cut.obj" else "")
    Path(name).write_text("\n".join(lines[:-1]))
    cut = document("info", name, warning="open" if name == "cut.obj" else "")
    assert cut[key] < whole[key] and cut["upper_m"] == upper


def test_info_describes_cells_points_and_robots(room: Path) -> None:
    occupied = int(np.load("rooms.npy").sum())
    for arguments, side in ((["rooms.3dmap"], 1.0), (["rooms.npy", "--spacing", 0.5], 0.5)):
        printed = document("info", *arguments)
        assert printed["cells"] == {"occupied": occupied, "free": 2400 - occupied, "total": 2400}
        assert printed["extents_m"] == [25 * side, 12 * side, 8 * side]
    printed = document("info", "cloud.xyz")
    assert (printed["points"], printed["lower_m"], printed["upper_m"]) == (
        3,
        [0.0] * 3,
        [1.0, 2.0, 0.5],
    )
    assert document("info", "cloud.xyz", "--spacing", 0.5)["shape"] == [2, 4, 1]
    printed = document("info", "cube.obj", "--as", "robot", "--spacing", 0.3)
    assert (printed["robot"], printed["cells_across"]) == ("mesh cube.obj", [4] * 3)
    assert printed["volume_m3"] == pytest.approx(1.0)
    assert document("info", "rect:0.9x0.6")["area_m2"] == pytest.approx(0.54)
    assert document("info", "wall.wkt", "--as", "robot")["upper_m"] == [1.0, 1.0]


def test_info_describes_real_files(data: Path) -> None:
    printed = document("info", data / "voxels/geb079.bt")
    assert (printed["spacing_m"], printed["shape"]) == (0.08, [487, 187, 39])
    cells = printed["cells"]
    assert cells["total"] == 487 * 187 * 39 == cells["occupied"] + cells["unknown"] + cells["free"]
    assert cells["unknown"] / cells["total"] == pytest.approx(0.68, abs=0.005)
    assert document("info", data / "solids/ZTunnel/obstacles.obj")["watertight"] is True


@pytest.fixture(scope="module")
def joints(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build maps of two revolute joints, and of a revolute and a prismatic joint."""
    pytest.importorskip("yourdfpy")
    folder = tmp_path_factory.mktemp("joints")
    sliding = urdfs.joint(
        "slide", "upper", "fore", at=(1, 0, 0), kind="prismatic", limits=(-0.4, 0.7)
    )
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    links = (
        urdfs.link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.2))),
        urdfs.link("upper", bar),
        urdfs.link("fore", bar),
    )
    for name, make in (
        ("turning", lambda: urdfs.planar(folder)),
        (
            "mixed",
            lambda: urdfs.write_urdf(
                folder, *links, urdfs.joint("shoulder", "foot", "upper"), sliding
            ),
        ),
    ):
        post = trimesh.creation.box((0.2, 0.2, 4.0)).apply_translation((1.4, 1.2, 0.0))
        space = cspace.build_arm_space({"post": post}, cspace.Arm.from_urdf(make()))
        cspace.build_joint_map(space, 0.1).save(folder / f"{name}.zarr")
    return folder


def test_info_uses_the_units_of_joint_maps(joints: Path) -> None:
    turning, mixed = (document("info", joints / f"{name}.zarr") for name in ("turning", "mixed"))
    assert turning["joints"] == ["shoulder", "elbow"]
    assert (turning["lower_rad"], turning["upper_rad"], turning["spacing_rad"]) == (
        [-3.0] * 2,
        [3.0] * 2,
        0.1,
    )
    assert turning["free_area_rad2"] == pytest.approx(turning["cells"]["free"] * 0.01)
    assert mixed["lower_rad_or_m"] == [-3.0, -0.4] and mixed["spacing_rad_or_m"] == 0.1
    assert mixed["free_area_rad_m"] == pytest.approx(mixed["cells"]["free"] * 0.01)
    for name in ("lower_m", "upper_m", "spacing_m", "free_area_m2"):
        assert name not in turning and name not in mixed
    # Widths of columns depend on the longest label.
    lines = [
        " ".join(line.split()) for line in run("info", joints / "turning.zarr").stdout.splitlines()
    ]
    assert {
        "lower (-3, -3) rad",
        "spacing 0.1 rad",
        f"free area {turning['free_area_rad2']:.6g} rad²",
    } <= set(lines)
    lines = [
        " ".join(line.split()) for line in run("info", joints / "mixed.zarr").stdout.splitlines()
    ]
    assert {"lower (-3, -0.4) rad or m", "spacing 0.1 rad or m"} <= set(lines)


@pytest.fixture
def arm_file(tmp_path: Path) -> Path:
    pytest.importorskip("yourdfpy")
    bar, foot = ((1.0, 0.1, 0.1), (0.5, 0, 0)), ((0.05, 0.05, 0.05), (0, 0, -0.2))
    links = (
        urdfs.link("foot", foot),
        urdfs.link("upper", bar),
        urdfs.link("fore", bar),
        urdfs.link("tool", bar, bar),
    )
    joints = (
        urdfs.joint("shoulder", "foot", "upper", limits=(-1.0, 2.0)),
        urdfs.joint("elbow", "upper", "fore", at=(1, 0, 0), kind="continuous", limits=None),
        urdfs.joint("slide_out", "fore", "tool", at=(1, 0, 0), kind="prismatic", limits=(0.0, 0.3)),
    )
    return urdfs.write_urdf(tmp_path, *links, *joints)


def test_info_describes_joints_links_and_pairs_of_an_arm(arm_file: Path, tmp_path: Path) -> None:
    printed = document("info", arm_file)
    assert (printed["kind"], printed["arm"], printed["dof"]) == ("arm", "small", 3)
    assert printed["joints"] == {
        "shoulder_rad": [-1.0, 2.0],
        "elbow": "continuous",
        "slide_out_m": [0.0, 0.3],
    }
    assert printed["triangles_of_links"] == {"foot": 12, "upper": 12, "fore": 12, "tool": 24}
    assert sum(printed["pairs_of_links"].values()) == 6
    (tmp_path / "arm.srdf").write_text(
        '<robot name="small"><group name="arm"><joint name="shoulder"/><joint name="elbow"/></group>'
        '<group_state name="home" group="arm"><joint name="shoulder" value="0.5"/><joint name="elbow" value="1"/>'
        '</group_state><disable_collisions link1="foot" link2="upper" reason="Adjacent"/></robot>'
    )
    printed = document("info", arm_file, "--srdf", tmp_path / "arm.srdf")
    assert printed["pairs_of_links"] == {"may_touch": 1, "may_not_touch": 5}
    assert printed["groups"] == {"arm": ["shoulder", "elbow"]}
    assert printed["named_configurations"]["arm/home"][:2] == [0.5, 1.0]
    lines = run("info", arm_file).stdout.splitlines()
    shown = {
        "  shoulder          (-1, 2) rad",
        "  elbow             continuous",
        "  slide_out         (0, 0.3) m",
    }
    assert shown <= set(lines)
    fixed = run("info", arm_file, "--as", "robot", "--json")
    assert "move against foot" in fixed.stderr and json.loads(fixed.stdout)["kind"] == "robot"


def test_info_warns_of_open_meshes_of_an_arm(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.2, 0.2, 0.2))
    box.update_faces(np.arange(10))
    box.export(tmp_path / "open.stl")
    mesh = '<collision><geometry><mesh filename="open.stl"/></geometry></collision>'
    links = urdfs.link("foot", extra=mesh), urdfs.link("upper", ((1.0, 0.1, 0.1), (0, 0, 0)))
    path = urdfs.write_urdf(
        tmp_path, *links, urdfs.joint("shoulder", "foot", "upper", at=(2, 0, 0))
    )
    assert "solid='surface'" in run("info", path).stderr
    assert not run("info", path, "--solid", "surface").stderr


def test_package_dirs_locate_meshes_of_ros_packages(tmp_path: Path) -> None:
    (tmp_path / "ws" / "arm").mkdir(parents=True)
    (tmp_path / "urdf").mkdir()
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "ws" / "arm" / "link.stl")
    urdf = tmp_path / "urdf" / "robot.urdf"
    mesh = '<collision><geometry><mesh filename="package://arm/link.stl"/></geometry></collision>'
    urdf.write_text(f'<robot name="r"><link name="l">{mesh}</link></robot>')
    assert "package" in run("info", urdf).stderr
    printed = document("info", urdf, "--package-dir", tmp_path, "--package-dir", tmp_path / "ws")
    assert printed["extents_m"] == pytest.approx([1.0, 2.0, 3.0])


def test_help_uses_one_placeholder_for_configurations() -> None:
    for name in ("plan", "plot", "view"):
        placeholders = {parameter.name: parameter.metavar for parameter in COMMANDS[name].params}
        assert placeholders["start"] == placeholders["goal"] == "X,Y[,Z][,ROTATION]"
        assert "X,Y[,Z][,ROTATION]" in run(name, "--help").stdout


def test_view_passes_marks_and_path_of_an_arm(
    arm_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, Any] = {}
    monkeypatch.setattr(
        cspace.ArmSpace, "view", lambda space, **options: seen.update(options, space=space)
    )
    (tmp_path / "path.csv").write_text("shoulder,elbow,slide_out\n0,0,0\n0.5,1,0.1\n")
    options = [
        "--start=-45deg,0,0.1",
        "--path",
        tmp_path / "path.csv",
        "--port",
        0,
        "--frame",
        "tool",
    ]
    assert run("view", arm_file, *options).exit_code == 0
    assert (
        seen["frame"] == "tool"
        and seen["space"].axes == ("shoulder", "elbow", "slide_out")
        and seen["port"] == 0
    )
    assert seen["start"] == pytest.approx((-math.pi / 4, 0.0, 0.1)) and seen["path"] == [
        [0, 0, 0],
        [0.5, 1, 0.1],
    ]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            ["info", "arm.urdf", "--spacing", "0.1"],
            "--spacing is given, but arm.urdf is read as arm",
        ),
        (
            ["info", "disc:0.3", "--srdf", "a.srdf"],
            "--srdf is given, but disc:0.3 is read as robot",
        ),
        (["view", "map.zarr", "--srdf", "a.srdf"], "--srdf is given, but map.zarr is not a URDF"),
        (
            ["view", "map.zarr", "--solid", "surface"],
            "--solid is given, but map.zarr is not a URDF",
        ),
        (["view", "map.zarr", "--frame", "tool"], "--frame is given, but map.zarr is not a URDF"),
        (["info", "arm.urdf", "--solid", "fill"], "--solid is 'fill'"),
        (["view", "arm.urdf", "--start", "1,2"], "--start is '1,2'"),
        (["view", "absent.urdf"], "absent.urdf"),
    ],
    ids=[
        "spacing",
        "srdf of a robot",
        "srdf of a map",
        "solid of a map",
        "frame of a map",
        "solid of an arm",
        "start",
        "absent",
    ],
)
def test_arm_commands_refuse_invalid_options(
    arm_file: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], expected: str
) -> None:
    monkeypatch.chdir(arm_file.parent)
    result = run(*arguments)
    assert result.exit_code == 2 and expected in result.stderr and result.stderr.count("\n") == 1


def test_plan_reads_degrees_and_reports_joint_units(joints: Path) -> None:
    file = joints / "turning.zarr"
    printed = document("plan", file, "--start=-90deg,0.5", "--goal", "60deg,45deg", "--seed", 1)
    ends = [[-math.pi / 2, 0.5], [math.pi / 3, math.pi / 4]]
    np.testing.assert_allclose(np.array(printed["path"])[[0, -1]], ends, atol=1e-12)
    path = np.array(printed["path"])
    assert printed["length_rad"] == pytest.approx(
        np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    )
    assert "obstacle_distance_rad" in printed and not {"length_m", "obstacle_distance_m"} & set(
        printed
    )
    assert (
        " rad\n"
        in run("plan", file, "--start=-90deg,0.5", "--goal", "60deg,45deg", "--seed", 1).stdout
    )
    printed = document(
        "plan", joints / "mixed.zarr", "--start=-90deg,0.5", "--goal", "-60deg,-0.2", "--seed", 1
    )
    assert "length_rad_or_m" in printed and "obstacle_distance_rad_or_m" in printed
    ends = [[-math.pi / 2, 0.5], [-math.pi / 3, -0.2]]
    np.testing.assert_allclose(np.array(printed["path"])[[0, -1]], ends, atol=1e-12)


@refusals(
    "file, start, message",
    ("turning", "90,0", "--start has the shoulder '90'; an angle without a unit is in radians"),
    (
        "turning",
        "1",
        "configurations are shoulder,elbow, in radians or degrees; write e.g. --start=90deg,90deg",
    ),
    ("mixed", "1", "shoulder,slide, in metres, shoulder an angle; write e.g. --start=90deg,0.5"),
    ("mixed", "0,20deg", "write e.g. --start=90deg,0.5"),
)
def test_plan_refuses_invalid_joint_values(
    joints: Path, file: str, start: str, message: str
) -> None:
    result = run("plan", joints / f"{file}.zarr", f"--start={start}", "--goal=0,0")
    assert result.exit_code == 2 and message in result.stderr


# ----------------------------------------------------------------------------------------------- plan


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Drawn]:
    """Collect map, name and options of each picture instead of drawing it."""
    drawn: list[Drawn] = []

    def save(space: Any, file: Path, overwrite: bool = False, **options: Any) -> None:
        drawn.append((space, str(file), options))

    monkeypatch.setattr("cspace.plot.save_plot", save)
    return drawn


def numbers(text: str) -> list[float]:
    """Parse a configuration from the command line."""
    return [math.radians(float(x[:-3])) if x.endswith("deg") else float(x) for x in text.split(",")]


@pytest.mark.parametrize("file", MAP_ENDPOINTS)
def test_plan_writes_a_path_that_plot_draws(room: Path, file: str, drawn: list[Drawn]) -> None:
    start, goal = MAP_ENDPOINTS[file]
    printed = document(
        *("plan", file, "--start", start, "--goal", goal, "--seed", 1, "--time-limit", 5),
        *("-o", "path.csv", "-o", "path.json", "--picture", "path.png"),
    )
    assert printed["solved"] and printed["certified"]
    path = np.array(printed["path"])
    np.testing.assert_allclose(path[[0, -1]], [numbers(start), numbers(goal)], atol=1e-12)
    np.testing.assert_allclose(np.loadtxt("path.csv", delimiter=",", skiprows=1), path)
    axes = {
        "plane.zarr": "x,y",
        "turning.zarr": "x,y,yaw",
        "space.zarr": "x,y,z",
        "both.zarr": "x,y,z,yaw",
    }
    axes["free.zarr"] = "x,y,z,qx,qy,qz,qw"
    assert Path("path.csv").read_text().splitlines()[0] == axes[file]
    assert json.loads(Path("path.json").read_text())["path"] == printed["path"]
    assert list(printed["seconds"]) == [
        "read",
        "plan",
        "measure",
        "write",
        "draw",
    ]
    space, picture, options = drawn.pop()
    assert space.plot(**options).figure.axes  # the figure is made but not rendered
    assert picture == "path.png"
    np.testing.assert_array_equal(options["path"].path, path)
    for name in ("path.csv", "path.json"):
        assert document("plot", file, "--path", name, "-o", "again.png")["picture"] == "again.png"
        _, picture, options = drawn.pop()
        assert picture == "again.png"
        np.testing.assert_array_equal(options["path"], path)


@pytest.mark.parametrize("file", UNREACHABLE)
def test_plan_reports_that_no_path_exists(room: Path, file: str, drawn: list[Drawn]) -> None:
    start, goal = MAP_ENDPOINTS[file][0], UNREACHABLE[file]
    result = run(
        "plan",
        file,
        "--start",
        start,
        "--goal",
        goal,
        "-o",
        "p.csv",
        "--picture",
        "p.png",
        "--json",
    )
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1), result.exception
    printed = json.loads(result.stdout)
    assert (printed["solved"], printed["is_connected"], printed["is_disconnected"]) == (
        False,
        False,
        True,
    )
    assert "no path exists: proven" in result.stderr
    assert "try" not in result.stderr
    assert not Path("p.csv").exists()
    [(_, picture, options)] = drawn
    assert picture == "p.png"
    plan = options["path"]
    np.testing.assert_allclose([plan.start, plan.goal], [numbers(start), numbers(goal)])


def test_plan_suggests_options_if_time_runs_out(room: Path) -> None:
    common = [
        "plan",
        "turning.zarr",
        "--start",
        MAP_ENDPOINTS["turning.zarr"][0],
        "--goal",
        MAP_ENDPOINTS["turning.zarr"][1],
    ]
    result = run(*common, "--time-limit", 1e-9, "--animate", "p.gif", "--planner", "RRTstar")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1), result.exception
    assert "a path exists; try " in result.stderr
    assert "--time-limit=1e-08" in result.stderr
    assert "pproximate" not in result.output
    assert not Path("p.gif").exists()


def test_plan_passes_options_to_the_planner(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given_options: dict[str, Any] = {}

    def plan(space: Any, start: Any, goal: Any, **options: Any) -> Any:
        given_options.update(options, start=start, goal=goal)
        raise InputError("enough")

    monkeypatch.setattr(planners, "plan", plan)
    arguments = ["plan", "turning.zarr", "--start", "1,1,90deg", "--goal=-1,1,-1.5"]
    assert (
        run(*arguments, "--drive", "reeds-shepp", "--turning-radius", "0.5").stderr
        == "cspace: enough\n"
    )
    assert (given_options["drive"], given_options["turning_radius"]) == ("reeds-shepp", 0.5)
    run(*arguments, "--exact")
    assert given_options["exact"] is True
    assert (given_options["start"], given_options["goal"]) == (
        (1.0, 1.0, math.pi / 2),
        (-1.0, 1.0, -1.5),
    )
    given_options.clear()
    run(*arguments, "--objective", "clearance", "--planner", "PRM", "--no-simplify", "--seed", 3)
    assert given_options["exact"] is False and given_options["turning_radius"] is None
    assert [given_options[name] for name in ("objective", "planner", "simplify", "seed")] == [
        "clearance",
        "PRM",
        False,
        3,
    ]
    for start in (["--start=-0.5,-0.25"], ["--start", "-0.5,-0.25"]):
        run("plan", "plane.zarr", *start, "--goal", "0.5,-.5")
        assert (given_options["start"], given_options["goal"]) == ((-0.5, -0.25), (0.5, -0.5))


def test_plot_draws_car_paths(
    room: Path, drawn: list[Drawn], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cspace.plot.animate", partial(animate, seconds=0.2))
    printed = document(
        *(
            "plan",
            "turning.zarr",
            "--start",
            "0.35,0.55,0",
            "--goal",
            "0.95,0.6,0.1",
            "--seed",
            1,
            "--time-limit",
            5,
        ),
        *(
            "--drive",
            "reeds-shepp",
            "--turning-radius",
            0.2,
            "-o",
            "path.csv",
            "--animate",
            "path.gif",
        ),
    )
    assert printed["solved"]
    # The table has an additional column, the direction of driving.
    assert Path("path.csv").read_text().startswith("x,y,yaw,direction\n")
    space, rows = cspace.open("turning.zarr"), np.loadtxt("path.csv", delimiter=",", skiprows=1)
    assert (
        document("plot", "turning.zarr", "--path", "path.csv", "-o", "path.png")["picture"]
        == "path.png"
    )
    np.testing.assert_array_equal(drawn.pop()[-1]["path"], rows[:, :3])
    animate(space, rows[:, :3], "own.gif", seconds=0.2)
    assert Path("path.gif").read_bytes() == Path("own.gif").read_bytes()


# ----------------------------------------------------------------------------------------------- plot and export


def test_plot_passes_options_to_the_picture(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given_options: dict[str, Any] = {}
    monkeypatch.setattr(
        "cspace.plot.save_plot", lambda *_, **options: given_options.update(options)
    )

    def passed(file: str, *options: str) -> dict[str, Any]:
        given_options.clear()
        document("plot", file, "-o", "map.png", *options)
        return {
            name: value
            for name, value in given_options.items()
            if name != "dpi" and value is not None
        }

    assert passed("plane.zarr") == {}
    assert passed("turning.zarr", "--rotation", "90deg") == {"rotation": (math.pi / 2,)}
    assert passed("turning.zarr", "--view", "plane") == {"view": "plane"}
    assert passed("turning.zarr", "--start", "1,1,90deg", "--goal=1,1,0") == {
        "start": (1.0, 1.0, math.pi / 2),
        "goal": (1.0, 1.0, 0.0),
    }
    assert passed("space.zarr", "--center", "0.3,0.6,0.4") == {"center": (0.3, 0.6, 0.4)}
    assert passed("space.zarr", "--view", "3d", "--cut", "0.5") == {"view": "3d", "cut": 0.5}
    document("plot", "plane.zarr", "-o", "map.png", "--dpi", 60)
    assert given_options["dpi"] == 60


def test_export_writes_every_format(room: Path) -> None:
    for file in ("out.vti", "free.stl", "free.ply", "free.obj", "copy.zarr", "copy.npz"):
        assert document("export", "space.zarr", file)["output"] == file
    states = cspace.open("space.zarr").cell_states
    np.testing.assert_array_equal(cspace.open("copy.zarr").cell_states, states)
    with np.load("copy.npz") as held:
        np.testing.assert_array_equal(held["cell_states"][0], states)
    document("export", "turning.zarr", "slice.yaml", "--rotation", "90deg")
    image = cspace.Workspace.from_ros_map("slice.yaml", unknown="occupied")
    np.testing.assert_array_equal(
        ~image.outer, cspace.open("turning.zarr").states_at(math.pi / 2) == cspace.FREE
    )


# ----------------------------------------------------------------------------------------------- progress, Ctrl-C


def test_progress_line_needs_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
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


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_ctrl_c_ends_planning(room: Path) -> None:
    # The search would take a minute.
    code = (
        "import os, signal, sys, threading, time, planners\n"
        "from cspace.cli import main\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent in the background may ignore it\n"
        "search = planners.plan\n"
        "def plan(*arguments, **options):\n"
        "    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "    return search(*arguments, **options)\n"
        "planners.plan = plan\n"
        "sys.argv[0] = 'cspace'\n"
        "main()\n"
    )
    endpoints = [
        "--start",
        MAP_ENDPOINTS["turning.zarr"][0],
        "--goal",
        MAP_ENDPOINTS["turning.zarr"][1],
    ]
    arguments = [
        "plan",
        "turning.zarr",
        *endpoints,
        "--planner",
        "RRTstar",
        "--time-limit",
        "60",
        "-o",
        "path.csv",
    ]
    done = spawn("-c", code, *arguments, cwd=room)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "cspace: interrupted\n")
    assert not Path("path.csv").exists()
