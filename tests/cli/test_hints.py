"""Refusals and hints of the command line: each hint is followed, as typed."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from PIL import Image

from tests.helpers.commands import document, run
from tests.helpers.refusals import refusals

MAP = "build floor.npy --robot disc:0.05 --spacing 0.1 -o new.zarr"
MAP_CUBE = "build cube.obj --robot ball:0.1 -o new.zarr"
MAP_WALL = "build wall.wkt --robot disc:0.05 --spacing 0.1"
PLAN = "plan plane.zarr --start 0.35,0.65 --goal 2.15,0.95"
PLAN_TURNING = "plan turning.zarr --start 0.35,0.65,0 --goal 2.15,0.95,90deg"
PLOT = "plot plane.zarr -o new.png"
MOTION = "--trajectory t.csv --max-velocity 0.5 --max-acceleration 0.5"
TURNS = "--max-angular-velocity 1 --max-angular-acceleration 1"


FILES = {
    "notes.txt": "nothing of use",
    "notes.csv": "x,y\nhere,there\n",
    "empty.csv": "x,y\n",
    "list.json": "[1, 2]",
    "swapped.csv": "y,x\n1,1\n",
    "wide.json": '{"path": [[1, 1, 0, 0, 0]]}',
    "old.png": "nothing of use",
    "old.pgm": "nothing of use",
    "precious/thesis.txt": "years of work",
    "precious/path.csv": "years of work",
    "broken.zarr/zarr.json": "{ nothing of use",
}
"""Texts of files that are in the way, or are no paths."""


@refusals(
    "command, message",
    (f"{MAP} --rotations 0", "or a kind and a count, yaw:8 or quaternions:8"),
    (f"{MAP_WALL} --bounds here", "XMIN,YMIN,XMAX,YMAX"),
    (f"{MAP} --tile 0", "--tile is 0"),
    (f"{MAP} --overwrite -o new.xyz", ".zarr"),
    (f"{PLAN} --start 5", "configurations are x,y"),
    (
        f"{PLAN_TURNING} --goal 2.15,0.95,-90",
        "write -90deg for -90 degrees, or -90rad",
    ),
    (f"{PLAN} -o a.csv -o ./a.csv", "name a file twice"),
    (f"{PLAN} --planner gird", "did you mean"),
    (f"{PLAN} --planner A*", "did you mean 'Grid'?"),
    (f"{PLAN} --planner 'Hybrid A*'", "did you mean 'Lattice'?"),
    (f"{PLAN} --start 1.145,0.2 --planner RRTConnect", "--exact proves it free"),
    (
        f"{PLAN_TURNING} --drive dubins",
        "a car has a tightest curve",
    ),
    (
        f"{PLAN} --objective clearance --planner RRT",
        "RRT takes objective: length",
    ),
    (f"{PLAN} --max-velocity 1", "no --trajectory is"),
    (f"{PLAN} --speed-zones zones.json", "--speed-zones is given, but no --trajectory is"),
    (f"{PLAN} --objective time --speed-zones zones.json", "--max-velocity is missing"),
    (f"{PLAN} {MOTION} --speed-zones none.json", "none.json: does not exist"),
    (f"{PLAN} {MOTION} --speed-zones list.json#top", "holds a JSON list"),
    (f"{PLAN} {MOTION} --speed-zones notes.txt", "with suffix '.txt'"),
    (
        f"{PLAN} --trajectory t.csv --max-velocity 1",
        "--max-acceleration lacks x, y",
    ),
    (
        f"{PLAN_TURNING} {MOTION}",
        "--max-angular-velocity is missing",
    ),
    (f"{PLAN} {MOTION} --max-angular-velocity 1", "does not turn"),
    (
        "plot plane.zarr -o p.png --rotation 1",
        "the map has no rotations",
    ),
    (
        "plot plane.zarr -o p.png --center 1,1",
        "--center is given with view plane; it needs view sections",
    ),
    ("export turning.zarr a.tif", "holds one slice"),
    ("export plane.zarr a.ply", ".ply holds maps in space only"),
    ("info plane.zarr --spacing 1", "is read as map"),
    ("config", "one of --include and --cmake-dir must be given"),
    (
        "plot plane.zarr -o p.png --path wall.wkt",
        "wall.wkt: has POLYGON",
    ),
    # Options of the library's arguments
    (f"{MAP_CUBE}", "--spacing is missing for cube.obj"),
    (f"{MAP} --spacing -0.1", "--spacing is -0.1"),
    (f"{MAP} --robot disk:0.3", "disk:0.3"),
    (f"{MAP} --robot ball:0.1", "--robot has 3 dimensions but the workspace has 2"),
    (f"{MAP} --rotations quaternions:2", "a robot in the plane turns by its yaw"),
    (f"{PLAN} --goal nan,1", "--goal[1][0] is nan"),
    (
        f"{PLAN} --any-yaw",
        "--any-yaw is set, and the axes are x, y; the map has no rotations",
    ),
    (f"{PLAN} --goal-tolerance 0.1,190deg", "an angle is at most pi radians"),
    (f"{PLAN} --goal-tolerance wide", "--goal-tolerance is 'wide'"),
    (f"{PLAN} --start 1.25,0.05", "BLOCKED"),
    (
        "plot space.zarr -o n.png --center 1,1,1 --view 3d",
        "--center is given with view 3d; it needs view sections",
    ),
    # Options of another kind of file
    (f"{MAP} --robot-solid fill", "it is for meshes"),
    (f"{MAP} --package-dir .", "--package-dir is [PosixPath('.')] for disc:0.05"),
    ("view plane.zarr --frame tool", "--frame is given, but plane.zarr is not a URDF"),
    (
        "export plane.zarr new.npz --window 0,0,1,1",
        "--window is given; export writes parts of tiled",
    ),
    # Texts of options
    (f"{MAP} --rotations 7.5", "--rotations is '7.5'"),
    (f"{MAP_CUBE} --bounds 0,0,0,1,-1,1", "it must be XMIN,YMIN,XMAX,YMAX"),
    # Outputs
    (
        f"{MAP} -o plane.zarr",
        "plane.zarr: exists; existing outputs are kept by default; pass --overwrite",
    ),
    (f"{MAP} -o absent/new.zarr", "absent is not a folder"),
    (f"{MAP} -o precious --overwrite", "precious"),
    (f"{MAP} --tile 9 -o precious.zarr/m", "precious.zarr"),
    ("export plane.zarr old.yaml", "old.pgm: exists"),
    ("demo --output notes.txt", "folder"),
    ("demo --output precious --overwrite", "path.csv: exists, and the demo's other files do not"),
    ("demo --output notes.txt/demo", "folder"),
    # Inputs
    ("build absent.yaml --robot disc:1 -o new.zarr", "absent.yaml"),
    ("plan broken.zarr --start 0,0 --goal 1,1", "broken.zarr"),
    (f"{PLOT} --path notes.csv", "notes.csv: has no path"),
    (f"{PLOT} --path empty.csv", "empty.csv: has no configuration"),
    (f"{PLOT} --path list.json", "list.json: has no path"),
    (f"{PLOT} --path old.png", "old.png"),
    (f"{PLOT} --path swapped.csv", "swapped.csv: has y, x; the map's axes are x, y"),
    (f"{PLOT} --path wide.json", "wide.json: has an array (1, 5)"),
    # Usage
    ("fly", "No such command 'fly'; see "),
    ("build", "Missing argument 'WORKSPACE'; see "),
    (f"{MAP} --outside wet", "'wet'"),
)
def test_invalid_input_is_refused_in_one_line(command, message, room):
    for name, text in FILES.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)
    before = sorted(room.rglob("*"))
    refused = run(command)
    assert refused.exit_code == 2, refused.exception or refused.output
    assert refused.stdout == ""
    assert refused.stderr.startswith("cspace: ") and refused.stderr.count("\n") == 1
    assert message in refused.stderr
    assert sorted(room.rglob("*")) == before


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
            "build small.glb --robot ball:0.01 --spacing 0.02",
            "pass --up='y' to turn it upright",
            "build small.glb --robot ball:0.01 --spacing 0.02 --up='y'",
        ),
        (
            "build rooms.npy --robot small.glb --spacing 0.1",
            "or --robot-up='z' to keep them",
            "build rooms.npy --robot small.glb --spacing 0.1 --robot-up='z'",
        ),
        (
            "build rooms.npy --robot robot.urdf --spacing 0.1",
            "pass --visuals to use <visual> there",
            "build rooms.npy --robot robot.urdf --spacing 0.1 --visuals --package-dir=far",
        ),
        (
            "build map.yaml --robot disc:0.01",
            "unless you pass --unknown='free'",
            "build map.yaml --robot disc:0.01 --unknown='free'",
        ),
        (
            "build rooms.npy --robot open.obj --spacing 0.1",
            "or --robot-solid='fill' to fill",
            "build rooms.npy --robot open.obj --spacing 0.1 --robot-solid='fill'",
        ),
        (
            "info robot.urdf",
            "pass --visuals to use <visual> there",
            "info robot.urdf --visuals --package-dir=far",
        ),
    ],
)
def test_messages_about_files_name_options_that_are_typed(command, hint, followed, files):
    told = run(f"{command} -o a.zarr" if command.startswith("build") else command)
    assert hint in told.stderr, told.stderr
    result = run(f"{followed} -o b.zarr" if command.startswith("build") else followed)
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
        assert run(f"build {name}.wkt --robot rect:0.5x0.5 {box}").exit_code == 0
    ends = "--start 1,2 --goal 5,2"
    failed = run(f"plan narrow.zarr {ends}")
    assert failed.exit_code == 1 and "; try --exact, which finds a path" in failed.stderr
    assert run(f"plan narrow.zarr {ends} --exact").exit_code == 0
    failed = run(f"plan tight.zarr {ends}")
    assert "; try what cspace explain names" in failed.stderr
    low, _ = document(f"explain tight.zarr {ends}")["margin_m"]
    side = 0.5 + 2.0 * low
    run(f"build tight.wkt --robot rect:{side}x{side} {box} --overwrite")
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


def test_zones_of_speed_slow_a_trajectory_and_turn_a_way(room):
    area = shapely.geometry.mapping(shapely.box(0.6, 0.5, 0.9, 2.0))
    feature = {"type": "Feature", "properties": {"top": 0.02}, "geometry": area}
    (room / "zones.geojson").write_text(json.dumps(feature))
    plain = document(f"{PLAN} {MOTION} --overwrite")
    slow = document(f"{PLAN} {MOTION} --speed-zones zones.geojson#top --overwrite")
    assert slow["path"] == plain["path"]
    assert slow["duration_s"] > plain["duration_s"] + 0.3 / 0.02 - 0.3 / 0.5
    quick = f"{PLAN} {MOTION} --objective time --overwrite"
    around = document(f"{quick} --speed-zones zones.geojson#top")
    assert around["length_m"] > plain["length_m"]
    assert around["duration_s"] < slow["duration_s"]
    assert document(quick)["length_m"] == pytest.approx(plain["length_m"], rel=1e-3)
    vertices = [{"x": x, "y": y} for x, y in shapely.get_coordinates(shapely.box(0.6, 0.5, 0.9, 2))]
    zone = {"zoneId": "a", "zoneType": "SPEED_LIMIT", "vertices": vertices, "maximumSpeed": 0.02}
    (room / "zones.json").write_text(json.dumps({"zoneSet": {"zones": [zone]}}))
    same = document(f"{PLAN} {MOTION} --speed-zones zones.json --overwrite")
    assert same["duration_s"] == pytest.approx(slow["duration_s"])
