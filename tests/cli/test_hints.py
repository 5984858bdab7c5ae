"""Hints of the command line: each is followed, as typed."""

import csv
import re

import numpy as np
import pytest
import shapely
import trimesh
from PIL import Image

from tests.helpers.commands import document, run

MAP = "map floor.npy --robot disc:0.05 --spacing 0.1 -o new.zarr"
MAP_WALL = "map wall.wkt --robot disc:0.05 --spacing 0.1"
PLAN = "plan plane.zarr --start 0.35,0.65 --goal 2.15,0.95"
PLAN_TURNING = "plan turning.zarr --start 0.35,0.65,0 --goal 2.15,0.95,90deg"
MOTION = "--trajectory t.csv --max-velocity 0.5 --max-acceleration 0.5"
TURNS = "--max-angular-velocity 1 --max-angular-acceleration 1"


@pytest.mark.parametrize(
    "command, hint, followed",
    [
        (
            f"{MAP} --rotations 0",
            "write e.g. 72, yaw:8 or quaternions:8",
            f"{MAP} --rotations yaw:8",
        ),
        (f"{MAP_WALL} --bounds here", "--bounds=-1,-1,4,3", f"{MAP_WALL} --bounds=-1,-1,4,3"),
        (f"{MAP} --tile 0", "pass e.g. 4096", f"{MAP} --tile 4096"),
        (f"{MAP} --overwrite -o new.xyz", "use one of .zarr", f"{MAP} --overwrite -o new.zarr"),
        (f"{PLAN} --start 5", "write e.g. --start=0.5,0.5", f"{PLAN} --start=0.5,0.5"),
        (
            f"{PLAN_TURNING} --goal 2.15,0.95,-90",
            "write -90deg for degrees, or -90rad for radians",
            f"{PLAN_TURNING} --goal 2.15,0.95,-90deg",
        ),
        (f"{PLAN} -o a.csv -o ./a.csv", "choose another name", f"{PLAN} -o a.csv -o b.csv"),
        (f"{PLAN} --planner gird", "did you mean", f"{PLAN} --planner Grid"),
        (
            f"{PLAN_TURNING} --drive dubins",
            "pass it in metres, e.g. 0.5",
            f"{PLAN_TURNING} --drive dubins --turning-radius 0.5 --time-limit 0.1",
        ),
        (
            f"{PLAN} --objective clearance --planner RRT",
            "use --planner='RRTstar'",
            f"{PLAN} --objective clearance --planner='RRTstar' --time-limit 0.2",
        ),
        (f"{PLAN} --max-velocity 1", "no --trajectory is; omit it", PLAN),
        (
            f"{PLAN} --trajectory t.csv --max-velocity 1",
            "pass --max-acceleration=1.0",
            f"{PLAN} --trajectory t.csv --max-velocity 1 --max-acceleration=1.0",
        ),
        (
            f"{PLAN_TURNING} {MOTION}",
            "pass it in radians and seconds, e.g. 1.0",
            f"{PLAN_TURNING} {MOTION} {TURNS}",
        ),
        (f"{PLAN} {MOTION} --max-angular-velocity 1", "leave it out", f"{PLAN} {MOTION}"),
        (
            "plot plane.zarr -o p.png --rotation 1",
            "omit it, or build the map with --rotations 72",
            "plot turning.zarr -o p.png --rotation 1",
        ),
        (
            "plot plane.zarr -o p.png --center 1,1",
            "add e.g. --zoom=8, or omit it",
            "plot plane.zarr -o p.png --center 1,1 --zoom=8",
        ),
        ("export turning.zarr a.tif", "pass the one", "export turning.zarr a.tif --rotation 0"),
        ("export plane.zarr a.stl", "e.g. .vti", "export plane.zarr a.vti"),
        ("info plane.zarr --spacing 1", "omit it", "info plane.zarr"),
        ("config", "pass --cmake-dir for CMake", "config --cmake-dir"),
        (
            "plot plane.zarr -o p.png --path wall.wkt",
            "write a path on this map with cspace plan",
            f"{PLAN} -o path.csv",
        ),
    ],
)
def test_following_a_hint_as_typed_avoids_the_error(command, hint, followed, room):
    refused = run(command)
    assert refused.exit_code == 2 and hint in refused.stderr, refused.stderr
    result = run(followed)
    assert result.exit_code != 2, result.stderr


URDF = (
    '<robot name="r"><link name="base"><visual><geometry><mesh filename="package://p/tube.obj"/>'
    "</geometry></visual></link></robot>"
)


@pytest.fixture
def files(room):
    """Write files that call for an option."""
    cube = trimesh.creation.box((0.1, 0.2, 0.1))
    cube.export(room / "small.glb")
    (room / "far" / "p").mkdir(parents=True)
    cube.export(room / "far" / "p" / "tube.obj")
    (room / "robot.urdf").write_text(URDF)
    header = "image: grey.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
    (room / "map.yaml").write_text(f"{header}occupied_thresh: 0.65\nfree_thresh: 0.25\n")
    Image.fromarray(np.full((9, 9), 205, dtype=np.uint8)).save(room / "grey.png")
    return room


@pytest.mark.parametrize(
    "command, hint, followed",
    [
        (
            "map small.glb --robot ball:0.01 --spacing 0.02",
            "pass --up='y' to turn it upright",
            "map small.glb --robot ball:0.01 --spacing 0.02 --up='y'",
        ),
        (
            "map rooms.npy --robot small.glb --spacing 0.1",
            "or --robot-up='z' to keep its axes",
            "map rooms.npy --robot small.glb --spacing 0.1 --robot-up='z'",
        ),
        (
            "map rooms.npy --robot robot.urdf --spacing 0.1",
            "or pass --visuals to use <visual> there",
            "map rooms.npy --robot robot.urdf --spacing 0.1 --visuals --package-dir=far",
        ),
        (
            "map rooms.npy --robot robot.urdf --spacing 0.1 --visuals",
            "or pass --package-dir=FOLDER",
            "map rooms.npy --robot robot.urdf --spacing 0.1 --visuals --package-dir=far",
        ),
        (
            "map map.yaml --robot disc:0.01",
            "or pass --unknown='free'",
            "map map.yaml --robot disc:0.01 --unknown='free'",
        ),
        (
            "map rooms.npy --robot open.obj --spacing 0.1",
            "or --robot-solid='fill' to fill",
            "map rooms.npy --robot open.obj --spacing 0.1 --robot-solid='fill'",
        ),
        (
            "info robot.urdf",
            "add <collision>, or pass --visuals",
            "info robot.urdf --visuals --package-dir=far",
        ),
    ],
)
def test_messages_about_files_name_options_that_are_typed(command, hint, followed, files):
    told = run(f"{command} -o a.zarr" if command.startswith("map") else command)
    assert hint in told.stderr, told.stderr
    result = run(f"{followed} -o b.zarr" if command.startswith("map") else followed)
    assert result.exit_code == 0, result.stderr
    assert hint not in result.stderr


def test_the_configuration_of_a_message_is_a_start(room):
    refused = run(f"{PLAN_TURNING} --start 1.25,0.05,0")
    (nearest,) = re.findall(r"the nearest is (\(.*?\))", refused.stderr)
    assert document(f"{PLAN_TURNING} --start", nearest)["solved"]


@pytest.mark.parametrize("text", ["(0.35,0.65)", "( 0.35, 0.65 )", "[0.35, 0.65]", " 0.35 ,0.65"])
def test_configurations_may_be_in_brackets(text, room):
    assert document(f"{PLAN} --start", text)["path"] == document(PLAN)["path"]


def test_the_hint_of_a_failed_plan_is_typed(room):
    # A corridor as wide as the robot, and one a little wider.
    for gap, name in ((0.5, "tight"), (0.52, "narrow")):
        walls = [(2.0, 0.0, 3.0, 2.0 - gap / 2.0), (2.0, 2.0 + gap / 2.0, 3.0, 4.0)]
        shape = shapely.MultiPolygon([shapely.box(*wall) for wall in walls])
        (room / f"{name}.wkt").write_text(shape.wkt)
        box = "--bounds '(0, 0, 6, 4)' --spacing 0.1"
        assert run(f"map {name}.wkt --robot rect:0.5x0.5 {box}").exit_code == 0
    ends = "--start 1,2 --goal 5,2"
    failed = run(f"plan narrow.zarr {ends}")
    assert failed.exit_code == 1 and "; try --exact, which finds a path" in failed.stderr
    assert run(f"plan narrow.zarr {ends} --exact").exit_code == 0
    failed = run(f"plan tight.zarr {ends}")
    assert "; try a smaller robot (see cspace explain), or a finer spacing" in failed.stderr
    low, _ = document(f"explain tight.zarr {ends}")["margin_m"]
    side = 0.5 + 2.0 * low
    run(f"map tight.wkt --robot rect:{side}x{side} {box} --overwrite")
    assert run(f"plan tight.zarr {ends}").exit_code == 0


def test_a_trajectory_is_written_within_its_limits(room):
    printed = document(f"{PLAN_TURNING} {MOTION} {TURNS} --drive differential --seed 1")
    with (room / "t.csv").open() as file:
        names, *rows = csv.reader(file)
    table = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    assert names == [
        *("time", "x", "y", "yaw", "x_velocity", "y_velocity", "yaw_velocity", "v", "omega")
    ]
    assert table["time"][-1] == printed["duration_s"] > 0.0
    first, *_, last = printed["path"]
    for row, q in ((0, first), (-1, last)):
        assert [table[axis][row] for axis in ("x", "y", "yaw")] == pytest.approx(q)
        assert table["v"][row] == table["omega"][row] == 0.0
    assert np.abs(table["v"]).max() <= 0.5 + 1e-9 and np.abs(table["omega"]).max() <= 1.0 + 1e-9
    assert re.search(r"\nduration +[\d.]+ s\n", run(f"{PLAN} {MOTION} --overwrite").stdout)
    smooth = document(f"{PLAN} {MOTION} --max-jerk 0.5 --overwrite")
    assert smooth["duration_s"] > document(f"{PLAN} {MOTION} --overwrite")["duration_s"]
