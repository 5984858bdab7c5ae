"""Commands on maps of each space."""

import io
import json
import logging
import math
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.ndimage import distance_transform_edt

import cspace
import planners
from cspace._cli import app, jobs
from cspace._cli.report import progress_line
from cspace._support.compiling import LOGGER, cache_folder
from cspace.errors import InputError
from cspace.plot import animate
from cspace.plot.scene import PATH_COLOR
from cspace.view._blocks import hex_to_rgb
from tests.helpers import urdfs
from tests.helpers.commands import document, flatten, run
from tests.helpers.repository import ROOT
from tests.helpers.strategies import few

ENDPOINTS = {
    "plane": "--start 0.35,0.65 --goal 2.15,0.95",
    "turning": "--start 0.35,0.65,0 --goal 2.15,0.95,90deg",
    "free": "--start 0.35,0.65,0.45,0,0,0,1 --goal 2.15,0.65,0.45,0,0,0.6,0.8",
}
"""Start and goal in the two rooms."""
IN_CUPBOARD = "--goal 2.35,0.15"


def spawn(code, *arguments, cwd):
    """Run Python code in a separate process."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)


def read_lines(command, *arguments):
    """Return the lines of a table with single spaces."""
    return [" ".join(line.split()) for line in run(command, *arguments).stdout.splitlines()]


# ---- help, compile and demo ----------------------------------------------------------------------


def test_help_imports_no_heavy_module(tmp_path):
    code = """
import sys
from cspace._cli import app
app(['build', '--help'], prog_name='cspace', standalone_mode=False)
print({'numpy', 'numba', 'scipy', 'shapely', 'matplotlib', 'zarr', 'ompl'} & set(sys.modules))
"""
    done = spawn(code, cwd=tmp_path)
    assert "--rotations" in done.stdout
    assert done.stdout.endswith("set()\n"), done.stderr


COMPLETE = """
import os
os.environ |= {'_CSPACE_COMPLETE': 'complete_bash', 'COMP_WORDS': 'cspace plan --st', 'COMP_CWORD': '2'}
from cspace._cli import app
app(prog_name='cspace')
"""


def test_a_shell_completes_options(tmp_path):
    assert spawn(COMPLETE, cwd=tmp_path).stdout.split() == ["--start", "--start-tolerance"]


def test_compile_fills_the_cache(monkeypatch):
    monkeypatch.setattr(jobs, "JOBS", {"plan in the plane": jobs.plan_in_plane})
    printed = document("compile")
    assert printed["folder"] == str(cache_folder()) and printed["compiled_functions"] > 0
    assert printed["code_of_package"] == "none came with the package"
    assert printed["seconds"].keys() == {"plan in the plane"}
    assert run("compile").stderr == "cspace: compiling: plan in the plane\n"
    monkeypatch.setattr("cspace._support.compiling.cache_folder", lambda: None)
    result = run("compile")
    assert result.exit_code == 2 and "NUMBA_CACHE_DIR" in result.stderr


MOTIONS = """
import gc, sys
from pathlib import Path
import numpy as np, cspace, planners
from numba.core.dispatcher import Dispatcher
from cspace._cli.demo import write_inputs
from cspace._cli.jobs import JOBS, build_arm

folder = Path(sys.argv[1])
write_inputs(folder)
for job in JOBS.values():
    str(job(folder))

def list_compiled():
    compiled = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {(each.py_func.__module__, each.py_func.__name__, *map(str, each.signatures))
            for each in compiled if each.py_func.__module__.startswith(("cspace.", "planners."))}

before = list_compiled()
assert len(before) > 50
workspace = cspace.Workspace.from_array(np.eye(60, dtype=bool), 0.1)
space = cspace.build(workspace, cspace.Robot.rectangle(0.5, 0.3), rotations=24)
start, goal = (1.0, 4.0, 0.0), (2.0, 5.0, 1.0)
speeds = {"max_velocity": 0.8, "max_acceleration": 0.6}
turns = {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.0}
car = {"drive": planners.Car(turning_radius=0.4)}
arm = build_arm(folder)
keep = planners.Upright("upper", axis=(1, 0, 0), direction=(1, 0.3, 0), tolerance=1.4)
ends = (-0.5, 0.2), (1.0, 0.3)
for plan, limits in (
    (planners.plan(space, start, goal), speeds | turns),
    (planners.plan(space, start, goal, drive=planners.Differential()), speeds | turns),
    (planners.plan(space, start, goal, **car), speeds),
    (planners.plan(arm, *ends, seed=2), {"max_acceleration": 1.0}),
    (planners.plan(arm, *ends, seed=2, keep=keep), {"max_acceleration": 1.0}),
):
    for jerk in ({}, {"max_jerk": 2.0}):
        motion = plan.trajectory(**limits, **jerk)
        motion.braked(0.3 * motion.duration)
        motion.recheck(plan.space)
gate = cspace.Gate(space, dt=0.1, max_deceleration=(1.0, 1.0))
gate.check_twists(start, [(0.2, 0.0)] * 4)
gate.slow_down(start, (0.3, 0.0))
cspace.Gate(space, dt=0.1, max_velocity=1.0, max_jerk=20.0).check_rows(start, [start] * 4)
arm.follow_line(ends[0], "fore", [arm.arm.pose((-0.4, 0.2), "fore")], tolerance=(0.01, 0.3))
print(*list_compiled() - before, sep="\\n")
"""
"""Script that runs the jobs, then prints what motions of a script compile besides."""


@pytest.mark.thorough
def test_compile_leaves_nothing_of_motions_and_gates_to_compile(tmp_path):
    done = spawn(MOTIONS, str(tmp_path), cwd=tmp_path)
    assert done.returncode == 0 and not done.stdout.strip(), done.stdout + done.stderr


def note_steps(monkeypatch):
    """Return a list for the numbers of finished and of all steps that a terminal shows."""
    steps = []

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    def note(bar, task, *, completed, total):
        steps.append((completed, total))

    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr("rich.progress.Progress.update", note)
    return steps


def test_compile_shows_its_jobs_and_hides_the_line_about_a_long_wait(monkeypatch):
    told = note_steps(monkeypatch)
    hears = []

    def fail(folder):
        hears.append(LOGGER.isEnabledFor(logging.WARNING))
        raise ZeroDivisionError

    monkeypatch.setattr(jobs, "JOBS", {"first": str, "second": fail})
    with pytest.raises(ZeroDivisionError):
        app(["compile"], standalone_mode=False)
    assert told == [(0, 2), (1, 2)]
    assert hears == [False] and LOGGER.isEnabledFor(logging.WARNING)


def test_spheres_shows_the_links_that_are_done(tmp_path, monkeypatch):
    told = note_steps(monkeypatch)
    app(["spheres", str(urdfs.planar(tmp_path)), "--number", "1"], standalone_mode=False)
    links = len(cspace.Arm.from_urdf(urdfs.planar(tmp_path)).links)
    assert told == [(done, links) for done in range(links + 1)]


def find_path_pixels(picture):
    """Return a mask of the pixels of a picture in the colour of paths."""
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    return np.abs(pixels - hex_to_rgb(PATH_COLOR)).max(axis=2) < 24


def test_the_picture_of_the_readme_shows_the_path_of_the_demo(tmp_path):
    """Compare the paths; if they differ, copy the new ``picture.png`` to ``docs/demo.png``."""
    printed = document("demo --output", tmp_path / "demo")
    assert list(printed["proofs"].values()) == [True, True]
    shown = find_path_pixels(ROOT / "docs" / "demo.png")
    drawn = find_path_pixels(tmp_path / "demo" / "picture.png")
    assert shown.shape == drawn.shape and shown.any()
    # Versions of the renderer differ by a few pixels.
    assert distance_transform_edt(~drawn)[shown].max() <= 3.0
    assert distance_transform_edt(~shown)[drawn].max() <= 3.0


# ---- map -----------------------------------------------------------------------------------------


def test_map_writes_and_describes_a_map(room):
    printed = document("build rooms.npy --robot box:0.2x0.2x0.2 --spacing 0.1")
    space = cspace.open("rooms.zarr")  # named after the workspace
    free, mixed, blocked = space.count()
    assert (printed["map"], printed["shape"]) == ("rooms.zarr", [25, 12, 8])
    assert printed["cells"] == {"free": free, "mixed": mixed, "blocked": blocked}
    assert printed["free_volume_m3"] == pytest.approx(free * 1e-3)
    lines = read_lines("info rooms.zarr")
    assert "robot box 0.2 m x 0.2 m x 0.2 m" in lines
    assert f"free volume {printed['free_volume_m3']:.6g} m³" in lines
    assert f"free {free}" in lines


def test_commands_take_a_robot_that_drives_on_a_floor(room):
    """The window between the rooms lies from 0.2 m to 0.6 m, and a low robot does not reach it."""
    command = "build rooms.npy --robot box:0.1x0.1x0.1 --spacing 0.1 --rotations 8 --floor"
    ends = "--start 0.35,0.65,0 --goal 2.05,0.65,0"
    printed = document(f"{command} 0.35 -o high.zarr")
    assert (printed["floor_m"], printed["shape"]) == (0.35, [25, 12])
    space = cspace.open("high.zarr")
    assert space.floor == 0.35 and space.workspace.grid.dim == 3
    again = cspace.build(space.workspace, "box:0.1x0.1x0.1", rotations=8, floor=0.35)
    assert (again.cell_states == space.cell_states).all()
    assert document("info high.zarr")["floor_m"] == 0.35
    assert document(f"plan high.zarr {ends}")["certified"]
    document(f"plot high.zarr {ends} -o high.png")
    document("export high.zarr high.yaml --rotation 0")
    document(f"{command} 0.1 -o low.zarr")
    assert document(f"explain low.zarr {ends}")["verdict"] == "disconnected"
    refused = run(f"{command} 0.9 -o none.zarr")
    assert refused.exit_code == 2 and "--floor is 0.9 m" in refused.stderr


def test_options_of_map_reach_the_build(room):
    def build(options):
        printed = document(f"build floor.npy --robot disc:0.15 --spacing 0.1 -o m.zarr {options}")
        return printed, cspace.open("m.zarr")

    plain, space = build("")
    assert (space.outside, space.margin, len(space.rotations)) == ("blocked", 0.0, 1)
    options = "--overwrite --rotations 8 --outside free --margin 0.2"
    _, space = build(options)
    assert (space.outside, space.margin, len(space.rotations)) == ("free", 0.2, 8)
    grown, _ = build("--overwrite --margin 0.2")
    assert grown["cells"]["free"] < plain["cells"]["free"]


def test_options_of_workspaces_reach_their_readers(room):
    np.savetxt("sensor.pgm", np.full((4, 6), 205), "%d", header="P2\n6 4\n255", comments="")
    thresholds = "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    Path("sensor.yaml").write_text(
        f"image: sensor.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n{thresholds}"
    )

    def count_free(workspace, warning=""):
        command = f"build {workspace} --outside free --overwrite -o m.zarr"
        return int(document(command, warning=warning)["cells"]["free"])

    unseen = "24 of 24 cells are unknown"
    assert count_free("sensor.yaml --robot disc:0.01", unseen) == 0
    assert count_free("sensor.yaml --robot disc:0.01 --unknown free") == 24
    cloud = "cloud.xyz --robot ball:0.05 --spacing 0.1 --bounds -1,-1,-1,2,3,1"
    assert count_free(f"{cloud} --radius 0.4") < count_free(cloud)
    Path("gaps.csv").write_text("id,x,y,z\n7,0,0,0\n8,nan,0,0\n9,1,1,0\n")
    command = f"{cloud.replace('cloud.xyz', 'gaps.csv')} --drop-missing"
    assert count_free(command) == count_free(f"{command} --offset=0,0,0")
    assert count_free(command) < count_free(f"{command} --offset=(90,0,0)", "no obstacle")
    count_free("cube.obj --robot ball:0.1 --spacing 0.25 --bounds=-1,-1,-1,2,2,2")
    space = cspace.open("m.zarr")
    assert (space.grid.lower, space.grid.shape) == ((-1.0,) * 3, (12,) * 3)
    assert space.classify([0.5, 0.5, 0.5]) == cspace.BLOCKED
    count_free("cube.obj --robot ball:0.1 --spacing 0.25 --solid surface", "are MIXED")
    assert cspace.open("m.zarr").classify([0.5, 0.5, 0.5]) != cspace.BLOCKED


def test_axes_of_meshes_and_drawn_links_have_options(room):
    turned = "cube.obj --robot cube.obj --spacing 0.25 --bounds=-2,-2,-2,2,2,2"
    document(f"build {turned} --up y --robot-up y -o m.zarr --overwrite")
    lower, upper = cspace.open("m.zarr").robot.shape.outer.bounds
    assert lower.tolist() == [0, -1, 0] and upper.tolist() == [1, 0, 1]
    box = '<{0}><geometry><box size="{1} 0.2 0.2"/></geometry></{0}>'
    Path("drawn.urdf").write_text(
        f'<robot name="a"><link name="a">{box.format("collision", 0.2)}</link>'
        f'<link name="b">{box.format("visual", 0.6)}</link><joint name="j" type="fixed">'
        '<parent link="a"/><child link="b"/></joint></robot>'
    )
    document("info drawn.urdf --as robot", warning="no <collision>")
    assert document("info drawn.urdf --as robot --visuals")["upper_m"][0] == 0.3


def test_warnings_are_printed_in_one_line(room):
    common = "build rooms.3dmap --robot open.obj -o m.zarr --overwrite"
    document(common, warning="solid='surface'")
    document(f"{common} --robot-solid surface")
    assert cspace.open("m.zarr").robot.spec["solid"] == "surface"


# ---- info ----------------------------------------------------------------------------------------


def test_info_describes_maps(room):
    printed = document("info turning.zarr")
    states = cspace.open("turning.zarr").cell_states
    # The rotations of a centered rectangle share slices in pairs.
    assert (printed["rotations"], printed["slices"], printed["rotation_cell_deg"]) == (8, 4, 45.0)
    assert printed["memory_bytes"] == 4 * 300
    assert list(printed["cells"].values()) == np.bincount(states.ravel(), minlength=3).tolist()
    assert printed["mean_free_area_m2"] == pytest.approx((states == cspace.FREE).mean() * 3.0)
    assert not {"rotations", "mean_free_area_m2"} & set(document("info plane.zarr"))
    assert {"rotation cell 45°", "memory 1,200 bytes"} <= set(read_lines("info turning.zarr"))


def test_info_describes_meshes_without_rasterizing_them(room, monkeypatch):
    monkeypatch.setattr("cspace._shapes.mesh.Mesh.cells", None)
    printed = document("info cube.obj")
    assert (printed["kind"], printed["extents_m"]) == ("workspace", [1.0] * 3)
    assert (printed["triangles"], printed["bodies"]) == (12, {"closed": 1, "open": 0})
    assert printed["volume_m3"] == pytest.approx(1.0)
    printed = document("info cube.obj --spacing 0.01")
    assert (printed["shape"], printed["cells"]) == ([100, 100, 100], {"total": 1_000_000})
    printed = document("info open.obj", warning="open")
    assert (printed["watertight"], printed["triangles"]) == (False, 11)
    assert "volume_m3" not in printed


def test_info_describes_cells_points_and_robots(room):
    occupied = int(np.load("rooms.npy").sum())
    printed = document("info rooms.npy --spacing 0.5")
    assert printed["cells"] == {"occupied": occupied, "free": 2400 - occupied, "total": 2400}
    assert printed["extents_m"] == [12.5, 6.0, 4.0]
    printed = document("info cloud.xyz --spacing 0.5")
    assert (printed["points"], printed["upper_m"], printed["shape"]) == (
        3,
        [1.0, 2.0, 0.5],
        [2, 4, 1],
    )
    printed = document("info cube.obj --as robot --spacing 0.3")
    assert (printed["robot"], printed["cells_across"]) == ("mesh cube.obj", [4] * 3)
    assert document("info rect:0.9x0.6")["area_m2"] == pytest.approx(0.54)


@pytest.fixture(scope="module")
def arm_file(tmp_path_factory):
    """Write an arm with a revolute, a continuous and a prismatic joint."""
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    return urdfs.write_urdf(
        tmp_path_factory.mktemp("arm"),
        urdfs.link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.2))),
        *[urdfs.link(name, bar) for name in ("upper", "fore", "tool")],
        urdfs.joint("shoulder", "foot", "upper", limits=(-1.0, 2.0)),
        urdfs.joint("elbow", "upper", "fore", at=(1, 0, 0), kind="continuous", limits=None),
        urdfs.joint("slide_out", "fore", "tool", at=(1, 0, 0), kind="prismatic", limits=(0.0, 0.3)),
    )


SRDF = """<robot name="small">
  <group name="arm"><joint name="shoulder"/><joint name="elbow"/></group>
  <group_state name="home" group="arm">
    <joint name="shoulder" value="0.5"/><joint name="elbow" value="1"/>
  </group_state>
  <disable_collisions link1="foot" link2="upper" reason="Adjacent"/>
</robot>"""


def test_info_names_its_option_for_missing_points(tmp_path):
    path = tmp_path / "cloud.xyz"
    path.write_text("0 0 0\n1 nan 2\n3 4 5\n")
    assert "pass --drop-missing to leave them out" in flatten(run("info", path).output)
    assert document("info --drop-missing", path)["points"] == 2


def test_info_describes_arms(arm_file, tmp_path):
    (tmp_path / "arm.srdf").write_text(SRDF)
    printed = document("info", arm_file, "--srdf", tmp_path / "arm.srdf")
    limits = {"shoulder_rad": [-1.0, 2.0], "elbow": "continuous", "slide_out_m": [0.0, 0.3]}
    assert (printed["kind"], printed["dof"], printed["joints"]) == ("arm", 3, limits)
    assert printed["triangles_of_links"] == dict.fromkeys(("foot", "upper", "fore", "tool"), 12)
    assert printed["pairs_of_links"] == {"may_touch": 1, "may_not_touch": 5}
    assert printed["groups"] == {"arm": ["shoulder", "elbow"]}
    assert printed["named_configurations"]["arm/home"][:2] == [0.5, 1.0]
    lines = read_lines("info", arm_file)
    assert {"shoulder (-1, 2) rad", "elbow continuous", "slide_out (0, 0.3) m"} <= set(lines)
    fixed = run("info --as robot --json", arm_file)
    assert "move against foot" in fixed.stderr and json.loads(fixed.stdout)["kind"] == "robot"


def test_package_dirs_locate_meshes_of_ros_packages(tmp_path):
    (tmp_path / "ws" / "arm").mkdir(parents=True)
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "ws" / "arm" / "link.stl")
    urdf = tmp_path / "robot.urdf"
    mesh = '<collision><geometry><mesh filename="package://arm/link.stl"/></geometry></collision>'
    urdf.write_text(f'<robot name="r"><link name="l">{mesh}</link></robot>')
    folders = ["--package-dir", tmp_path, "--package-dir", tmp_path / "ws"]
    assert document("info", urdf, *folders)["extents_m"] == pytest.approx([1.0, 2.0, 3.0])


def test_view_passes_marks_and_path_of_an_arm(arm_file, tmp_path, monkeypatch):
    seen = {}
    monkeypatch.setattr(cspace.ArmSpace, "view", lambda _, **options: seen.update(options))
    path = tmp_path / "path.csv"
    path.write_text("shoulder,elbow,slide_out\n0,0,0\n0.5,1,0.1\n")
    run("view --start=-45deg,0,0.1 --port 0 --frame tool", arm_file, "--path", path)
    assert seen.pop("start") == pytest.approx((-math.pi / 4, 0.0, 0.1))
    rows = [[0.0, 0.0, 0.0], [0.5, 1.0, 0.1]]
    assert seen == {"host": "127.0.0.1", "port": 0, "frame": "tool", "path": rows}


# ---- plan ----------------------------------------------------------------------------------------


def test_plans_of_joints_have_the_units_of_their_axes(arm_file, tmp_path):
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(arm_file))
    joints = ["shoulder", "slide_out"]
    cspace.build_joint_map(space, 0.1, joints, held_joints=(0, 0, 0)).save(tmp_path / "joints.zarr")
    printed = document("info", tmp_path / "joints.zarr")
    assert (printed["joints"], printed["spacing_rad_or_m"]) == (joints, 0.1)
    assert printed["free_area_rad_m"] == pytest.approx(printed["cells"]["free"] * 0.01)
    assert not {"lower_m", "spacing_m", "free_area_m2", "margin_m"} & set(printed)
    printed = document("explain --start=45deg,0.25 --goal=60deg,0.1", tmp_path / "joints.zarr")
    assert printed["verdict"] == "connected" and len(printed["margin_rad_or_m"]) == 2
    assert "margin_m" not in printed
    printed = document("plan --start=45deg,0.25 --goal=60deg,0.1", tmp_path / "joints.zarr")
    ends = [printed["path"][0], printed["path"][-1]]
    np.testing.assert_allclose(ends, [[math.pi / 4, 0.25], [math.pi / 3, 0.1]], atol=1e-12)
    assert {"length_rad_or_m", "clearance_rad_or_m"} <= set(printed)


@pytest.fixture
def drawn(monkeypatch):
    """Collect the options of each picture instead of drawing it."""
    drawn = []

    def save(space, file, overwrite=False, **options):
        drawn.append({"file": str(file), **options})

    monkeypatch.setattr("cspace.plot.save_plot", save)
    return drawn


@pytest.mark.parametrize("name", ENDPOINTS)
def test_plan_writes_a_path_that_plot_draws(room, name, drawn):
    files = "-o path.csv -o path.json --picture path.png"
    printed = document(f"plan {name}.zarr {ENDPOINTS[name]} --seed 1 --time-limit 5 {files}")
    assert printed["solved"] and printed["certified"]
    path = np.array(printed["path"])
    assert path[0, :2].tolist() == [0.35, 0.65]
    header, *rows = Path("path.csv").read_text().splitlines()
    assert tuple(header.split(",")) == cspace.open(f"{name}.zarr").axes
    np.testing.assert_allclose(np.loadtxt(rows, delimiter=","), path)
    assert json.loads(Path("path.json").read_text())["path"] == printed["path"]
    assert list(printed["seconds"]) == ["read", "plan", "measure", "write", "draw"]
    assert drawn[0]["file"] == "path.png"
    np.testing.assert_array_equal(drawn[0]["path"].path, path)
    for number, file in enumerate(("path.csv", "path.json"), start=1):
        document(f"plot {name}.zarr -o again.png --path {file}")
        np.testing.assert_array_equal(drawn[number]["path"], path)


def test_plan_reports_that_no_path_exists(room, drawn):
    files = "-o p.csv --picture p.png"
    result = run(f"plan plane.zarr --start 0.35,0.65 {IN_CUPBOARD} {files} --json")
    assert result.exit_code == 1
    printed = json.loads(result.stdout)
    assert (printed["solved"], printed["is_disconnected"]) == (False, True)
    assert result.stderr == "cspace: from 0.35,0.65 to 2.35,0.15: no path exists: proven\n"
    assert not Path("p.csv").exists()
    assert tuple(drawn[0]["path"].goal) == (2.35, 0.15)


def test_plan_suggests_options_if_time_runs_out(room):
    limit = "--time-limit 1e-9 --planner RRTstar --animate p.gif"
    result = run(f"plan turning.zarr {ENDPOINTS['turning']} {limit}")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert "a path exists; try " in result.stderr and "--time-limit=1e-08" in result.stderr
    assert not Path("p.gif").exists()


def test_plan_passes_options_to_the_planner(room, monkeypatch):
    seen = {}

    def plan(space, start, goal, **options):
        seen.update(options, start=start.configuration, goal=goal, is_exact=space is space.exact)
        raise InputError("enough")

    monkeypatch.setattr(planners, "plan", plan)
    given = "--drive reeds-shepp --turning-radius 0.5 --exact --objective clearance"
    given += " --planner KPIECE1 --no-simplify --seed 3 --time-limit 2"
    result = run(f"plan turning.zarr --start 1,1,90deg --goal -1,-.5,-1.5 {given}")
    assert result.stderr == "cspace: enough\n"
    assert seen == {
        "start": (1.0, 1.0, math.pi / 2),
        "goal": [(-1.0, -0.5, -1.5)],
        "drive": planners.Car(turning_radius=0.5, reverse=True),
        "is_exact": True,
        "objective": "clearance",
        "planner": planners.Search("KPIECE1", simplify=False),
        "seed": 3,
        "time_limit": 2.0,
    }


def test_goals_may_be_repeated_and_have_room(room):
    start = "--start 0.35,0.65,0"
    near, far = "--goal 0.6,0.65,0.5", "--goal 2.15,0.95,90deg"
    printed = document(f"plan turning.zarr {start} {far} {near}")
    assert printed["path"][-1] == [0.6, 0.65, 0.5]
    printed = document(f"plan turning.zarr {start} --goal 0.6,0.65 --any-yaw")
    assert printed["path"][-1] == [0.6, 0.65, 0.0]
    printed = document(f"plan turning.zarr {start} {near} --goal-tolerance 0.1,10deg")
    x, y, yaw = printed["path"][-1]
    assert math.hypot(x - 0.6, y - 0.65) <= 0.1 and abs(yaw - 0.5) <= math.radians(10.0)
    printed = document("plan plane.zarr --start 0.02,0.02 --goal 0.6,0.65 --start-tolerance 0.5")
    assert printed["solved"] and "start moved by" in printed["status"]


def test_paths_of_cars_are_written_animated_and_drawn(room, drawn, monkeypatch):
    monkeypatch.setattr("cspace.plot.animate", partial(animate, seconds=0.2))
    car = "--drive reeds-shepp --turning-radius 0.2 --seed 1 --time-limit 5"
    ends = "--start 0.35,0.55,0 --goal 0.95,0.6,0.1"
    document(f"plan turning.zarr {ends} {car} -o path.csv --animate path.gif")
    # The table has an additional column, the direction of driving.
    assert Path("path.csv").read_text().startswith("x,y,yaw,direction\n")
    path = np.loadtxt("path.csv", delimiter=",", skiprows=1)[:, :3]
    document("plot turning.zarr --path path.csv -o path.png")
    np.testing.assert_array_equal(drawn[0]["path"], path)
    animate(cspace.open("turning.zarr"), path, "own.gif", seconds=0.2)
    assert Path("path.gif").read_bytes() == Path("own.gif").read_bytes()


# ---- plot, export, progress and Ctrl-C -----------------------------------------------------------


@pytest.mark.parametrize(
    "command, options",
    [
        ("plane.zarr", {}),
        (
            "turning.zarr --rotation 90deg --view plane",
            {"rotation": (math.pi / 2,), "view": "plane"},
        ),
        ("turning.zarr --start 1,1,90deg", {"start": (1.0, 1.0, math.pi / 2)}),
        ("space.zarr --center 0.3,0.6,0.4", {"center": (0.3, 0.6, 0.4)}),
        ("space.zarr --view 3d --dpi 60", {"view": "3d", "dpi": 60.0}),
    ],
)
def test_plot_passes_options_to_the_picture(room, drawn, command, options):
    document(f"plot {command} -o map.png")
    assert drawn == [{"file": "map.png", "dpi": 150.0, **options}]


def test_export_writes_every_format(room):
    for file in ("out.vti", "free.ply", "copy.zarr", "copy.npz"):
        assert document("export space.zarr", file)["output"] == file
    states = cspace.open("space.zarr").cell_states
    np.testing.assert_array_equal(cspace.open("copy.zarr").cell_states, states)
    with np.load("copy.npz") as arrays:
        np.testing.assert_array_equal(arrays["cell_states"][0], states)
    document("export turning.zarr slice.yaml --rotation 90deg")
    image = cspace.Workspace.open("slice.yaml", unknown="occupied")
    is_free = cspace.open("turning.zarr").states_at(math.pi / 2) == cspace.FREE
    np.testing.assert_array_equal(~image.outer, is_free)


def test_progress_lines_need_a_terminal(monkeypatch, capsys):
    with progress_line("working") as callback:
        assert callback is None
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_line("working") as callback:
        assert callback is not None
        callback(2, 2)
    captured = capsys.readouterr()
    assert captured.out == "" and "working" in captured.err


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_ctrl_c_ends_planning(room):
    # A parent in the background may ignore SIGINT.
    code = """
import signal, planners
from cspace._cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)
search = planners.plan
def plan(*arguments, **options):
    return search(*arguments, stop=lambda: signal.raise_signal(signal.SIGINT), **options)
planners.plan = plan
main()
"""
    limit = "--planner RRTstar --time-limit 600 -o path.csv"
    command = f"plan turning.zarr {ENDPOINTS['turning']} {limit}"
    done = spawn(code, *command.split(), cwd=room)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "cspace: interrupted\n")
    assert not Path("path.csv").exists()


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_ctrl_c_while_the_compiler_calls_back_ends_planning(room):
    # LLVM's own call of Python drops what is raised, and crashes.
    code = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from numba.core.codegen import CPUCodeLibrary
look_up = CPUCodeLibrary.__dict__["_object_getbuffer_hook"].__func__
waiting = [signal.SIGINT]
def interrupted(*arguments):
    while waiting:  # one signal: a second may come before the first has been told
        signal.raise_signal(waiting.pop())
    return look_up(*arguments)
CPUCodeLibrary._object_getbuffer_hook = classmethod(interrupted)
from cspace._cli import main
main()
"""
    done = spawn(code, *f"plan turning.zarr {ENDPOINTS['turning']} -o path.csv".split(), cwd=room)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "cspace: interrupted\n")
    assert not Path("path.csv").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX pipes")
@pytest.mark.parametrize(
    "words", few([["info", "turning.zarr"], ["--help"], ["--version"], ["plan", "--help"]])
)
def test_a_reader_that_ends_is_no_path_not_found(room, words):
    # As of `cspace info map.zarr | head -0`.
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-c", "from cspace._cli import main; main()", *words]
    done = subprocess.run(command, cwd=room, stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")
