"""Memory checks before any work."""

import tracemalloc

import numpy as np
import psutil
import pytest
import shapely
import trimesh
from PIL import Image

import cspace
from cspace import Robot, Workspace
from cspace._engines.slices import estimate_raster_bytes, slice_rasters
from cspace._support.limits import (
    RASTER_CELL_BYTES,
    SLICE_BYTES,
    check_memory,
)
from tests.helpers.mesh_files import BINARY, CHAIN
from tests.helpers.refusals import write


def test_work_beyond_memory_is_refused_with_a_spacing_that_fits(monkeypatch):
    monkeypatch.setattr("cspace._support.limits.free_bytes", lambda: 10**9)
    check_memory(0.95e9, "the map", cspace.Grid((0.0,) * 3, 0.1, (1000,) * 3))
    with pytest.raises(cspace.InputError, match="at most 950 MB may be used, 95%"):
        check_memory(1e9, "the map", cspace.Grid((0.0,) * 3, 0.1, (1000,) * 3))


@pytest.mark.parametrize(
    "robot, rotations, spacing",
    [
        (cspace.Robot.rectangle(3.0, 1.5, (0.3, 0.05)), cspace.Rotations.of(500), 0.1),
        (cspace.Robot.rectangle(4.0, 0.1), cspace.Rotations.of(501), 0.1),
        (
            cspace.Robot.box((0.3, 0.18, 0.15), (0.03, 0.02, 0.01)),
            cspace.Rotations.quaternions(4),
            0.1,
        ),
        (cspace.Robot.box((1.0, 0.6, 0.5), (0.03, 0.02, 0.01)), cspace.Rotations.of(40), 0.1),
    ],
    ids=["car", "bar", "small box", "box"],
)
def test_the_memory_estimate_of_rasters_is_near_the_measurement(robot, rotations, spacing):
    pairs = slice_rasters(robot, spacing, 0.0, rotations)
    cells = sum(raster.cells.size for pair in pairs for raster in pair)
    needed = SLICE_BYTES * len(pairs) + RASTER_CELL_BYTES[robot.dim] * cells
    assert (
        0.9 * needed
        < estimate_raster_bytes(robot, spacing, 0.0, rotations, len(pairs))
        < 3.0 * needed
    )


def test_a_limit_of_the_process_counts(monkeypatch):
    """As ``ulimit -v`` sets it, which batch systems do."""
    used = psutil.Process().memory_info().vms
    monkeypatch.setattr(psutil.Process, "rlimit", lambda process, kind: (used + 2**30, -1))
    bounds = ((-50.0, -50.0, -50.0), (50.0, 50.0, 50.0))
    with pytest.raises(cspace.InputError, match=r"1000 x 1000 x 1000 cells.*cells of 0.2\d m fit"):
        Workspace.from_mesh(trimesh.creation.box((1.0, 1.0, 1.0)), 0.1, bounds=bounds)


# ---- every door that makes cells -----------------------------------------------------------------

SIDE, SIDE_IN_SPACE = 1500, 130
"""Cells along each axis of large maps, some two million."""

PLANE, SPACE = (
    0.1 * np.array([[0] * dim, [n] * dim]) for dim, n in ((2, SIDE), (3, SIDE_IN_SPACE))
)
"""Bounds of large maps."""


def make_cells(dim):
    """Return the cells of a large map with a wall."""
    cells = np.zeros((SIDE,) * 2 if dim == 2 else (SIDE_IN_SPACE,) * 3, dtype=bool)
    cells[len(cells) // 2, : len(cells) // 2] = True
    return cells


def build_large(dim, robot="disc:0.3", rotations=None, side=SIDE):
    """Build the map of a small robot, in the plane or in space."""
    if dim == 3:
        robot = Robot.box((0.4, 0.4, 0.2))
    cells = np.ascontiguousarray(make_cells(dim)[:side, :side])
    return cspace.build(Workspace.from_array(cells, 0.1), robot, rotations=rotations)


def write_pgm(folder, yaw):
    """Write a ROS map, and return its path."""
    Image.fromarray(np.full((SIDE, SIDE), 254, np.uint8)).save(folder / "map.pgm")
    lines = ["image: map.pgm", "resolution: 0.05", f"origin: [0.0, 0.0, {yaw}]", "negate: 0"]
    text = "\n".join([*lines, "occupied_thresh: 0.65", "free_thresh: 0.196"])
    (folder / "map.yaml").write_text(text)
    return folder / "map.yaml"


def make_message():
    """Return a large occupancy grid."""
    message = cspace.ros.OccupancyGrid()
    message.info.resolution, message.info.width, message.info.height = 0.1, SIDE, SIDE
    message.data = np.zeros(SIDE * SIDE, np.int8)
    message.data[: SIDE * SIDE // 3] = 100
    return message


def use(dim, call, *options, **others):
    """Return a call with a large map."""
    space = build_large(dim, *options, **others)
    return lambda: call(space)


def read(path, **options):
    """Return a call that opens a file."""
    return lambda: Workspace.open(path, **options)


BOX = trimesh.creation.box((1.0, 1.0, 1.0))
CUBE = BOX.copy().apply_scale(20.0)
SQUARE = shapely.box(5.0, 5.0, 100.0, 100.0)

DOORS = {
    "a mesh": lambda _: lambda: Workspace.from_mesh(BOX, 0.1, bounds=SPACE),
    "points": lambda _: lambda: Workspace.from_points([(1.0, 2.0)], 0.1, bounds=PLANE, radius=9.0),
    "points in space": lambda _: lambda: Workspace.from_points([(1.0,) * 3], 0.1, bounds=SPACE),
    "polygons": lambda _: lambda: Workspace.from_polygons(SQUARE, 0.1, bounds=PLANE),
    "shapes": lambda _: lambda: Workspace.from_shapes([SQUARE, "disc:5"], 0.1, bounds=PLANE),
    "voxels": lambda _: (
        lambda: Workspace.from_shapes(
            [Robot.from_bitmap(np.ones((3, 3, 3), dtype=bool), 0.5)], 0.1, bounds=SPACE
        )
    ),
    "lazy polygons": lambda _: (
        lambda: Workspace.from_polygons(SQUARE, 0.1, bounds=PLANE, lazy=True).outer
    ),
    "a turned ROS map": lambda folder: read(write_pgm(folder, 0.3)),
    "a message": lambda _: lambda: Workspace.from_occupancy_grid(make_message()),
    "a mask": lambda _: lambda: cspace.ros.read_mask(make_message()),
    "a map of MovingAI": lambda folder: read(
        write(
            folder,
            "a.map",
            f"type octile\nheight {SIDE}\nwidth {SIDE}\nmap\n" + ("." * SIDE + "\n") * SIDE,
        )
    ),
    "voxels of MovingAI": lambda folder: read(
        write(folder, "a.3dmap", f"voxel{f' {SIDE_IN_SPACE}' * 3}\n1 1 1\n"), spacing=0.1
    ),
    "an OctoMap": lambda folder: read(
        write(folder, "a.bt", BINARY.format(17) + CHAIN.decode()), bounds=SPACE
    ),
    "a bitmap": lambda _: (
        lambda: (
            Robot.from_bitmap(
                np.random.default_rng(0).random((48, 48, 48)) < 0.5, 0.1
            ).shape.symmetries
        )
    ),
    "a large robot": lambda _: (
        lambda: cspace.build(
            Workspace.from_array(np.zeros((9, 9, 9), bool), 0.1), Robot.from_mesh(CUBE)
        )
    ),
    "a build": lambda _: lambda: build_large(2),
    "a build in space": lambda _: lambda: build_large(3),
    "an obstacle": lambda _: use(2, lambda space: space.add_obstacle("a", SQUARE)),
    "an obstacle in space": lambda _: use(3, lambda space: space.add_obstacle("a", CUBE)),
    "a change": lambda _: use(2, lambda space: space.update(~make_cells(2), (0, 0))),
    "clearance": lambda _: use(2, lambda space: space.clearance((1.0, 1.0))),
    "overlaps": lambda _: use(2, lambda space: space.overlap_count((1.0, 1.0))),
    "states": lambda _: use(2, lambda space: space.cell_states, "rect:0.2x0.2", 8, side=500),
    "VTI": lambda folder: use(3, lambda space: space.export(folder / "a.vti", overwrite=True)),
    "a ROS map": lambda folder: use(
        2, lambda space: space.export(folder / "a.yaml", overwrite=True)
    ),
    "PLY": lambda folder: use(3, lambda space: space.export(folder / "a.ply", overwrite=True)),
    "GeoTIFF": lambda folder: use(2, lambda space: space.export(folder / "a.tif", overwrite=True)),
    "a costmap": lambda _: use(2, lambda space: space.to_costmap()),
    "an occupancy grid": lambda _: use(2, lambda space: space.to_occupancy_grid()),
}
"""Functions of a folder that return calls which make many cells."""


def measure_peak(call):
    """Return the bytes that a call takes at most, numpy's arrays included."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.filterwarnings("ignore:the robot is:cspace.UnitWarning")
@pytest.mark.parametrize("door", DOORS)
def test_work_that_does_not_fit_is_refused_before_it_is_done(door, tmp_path, monkeypatch):
    """With less memory than the call was measured to take, it is refused in our words."""
    call = DOORS[door](tmp_path)
    call()  # code is loaded
    peak = measure_peak(DOORS[door](tmp_path))
    again = DOORS[door](tmp_path)
    monkeypatch.setattr("cspace._support.limits.free_bytes", lambda: int(0.9 * peak))
    with pytest.raises(cspace.CspaceError, match="of memory; at most"):
        again()
