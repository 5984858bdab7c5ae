"""Hints about arguments, grids, batches, limits and memory: each is followed by code."""

import re
import tomllib
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

import cspace
from cspace import Grid, MeshWarning, Robot, Rotations, Workspace, build, make_mesh
from cspace._support.limits import raised_limits
from cspace._support.reporting import import_optional
from cspace.errors import MissingPackageError
from tests.helpers.refusals import check_refused, refusals

FLOOR = Workspace.from_array(np.eye(30, 20, dtype=bool), 0.1)
ROOM = Workspace.from_array(np.zeros((6, 5, 4), dtype=bool), 0.1)


@cache
def space():
    """Build the map of a robot that does not turn."""
    return build(FLOOR, Robot.rectangle(0.2, 0.1))


@cache
def turning():
    """Build the map of a robot that turns."""
    return build(FLOOR, Robot.rectangle(0.2, 0.1), rotations=8)


@cache
def floating():
    """Build the map of a ball that turns in space."""
    return build(ROOM, Robot.ball(0.05), rotations=Rotations.quaternions(2))


HERE = (2.5, 0.5)
TURN = Rotation.from_euler("z", 0.1)
MASKED = np.ma.masked_array(np.eye(3, dtype=bool), np.eye(3, dtype=bool))
CELLS = np.eye(3, dtype=bool)
WIDE = np.eye(9, dtype=bool)


def cells(values, **options):
    """Make a workspace of an array."""
    return Workspace.from_array(values, 0.1, **options)


@pytest.mark.filterwarnings("ignore::UserWarning")
@refusals(
    "call, hint",
    # Numbers.
    (lambda: Robot.disc(None), "it must be numeric"),
    (lambda: Robot.disc("0.3"), "it must be numeric"),
    (
        lambda: floating().rotations.check_rotation(TURN, "rotation"),
        "it must be numeric",
    ),
    (lambda: Robot.disc(10**400), "it must fit a float"),
    (
        lambda: space().is_free((1j, 0)),
        "it must be real",
    ),
    (
        lambda: Robot.polygon([(0, 0), (1, 0), (np.nan, 1), (0, 1)]),
        "it must be finite",
    ),
    (
        lambda: cells(MASKED),
        "occupied has 3 masked entries; each must have a value",
    ),
    (lambda: Robot.disc(0), "it must be one number above zero, in metres"),
    (lambda: Robot.disc(1e200), "it must be in [1e-100, 1e100] metres"),
    (
        lambda: build(FLOOR, "disc:0.1", margin=-1),
        "metres",
    ),
    (
        lambda: space().sample_free(-1),
        "n is -1; it must be a whole number from 0 on",
    ),
    (
        lambda: space().sample_free(10**13),
        "95% of the free memory",
    ),
    # Words.
    (
        lambda: build(FLOOR, "disc:0.1", outside="x"),
        "outside is 'x'; it must be 'blocked' or 'free'",
    ),
    (
        lambda: Workspace.from_mesh(trimesh.creation.box(), 0.1, solid="all"),
        "solid is 'all'; it must be 'auto', 'surface' or 'fill'",
    ),
    (
        lambda: space().add_obstacle("", [HERE], radius=0.1),
        "it must be a non-empty string",
    ),
    (
        lambda: space().sample_free(3, rng=0),
        "rng is 0; it must be a numpy.random.Generator or None",
    ),
    # Points and boxes.
    (lambda: space().is_free((1, 2, 3)), "its last axis must be 2 long, for x, y"),
    (lambda: Robot.disc(0.1, 3), "it must be 2 numbers in metres"),
    (
        lambda: Workspace.from_polygons([shapely.Point(0, 0)], 0.1, bounds=(0, 1)),
        "it must be xmin, ymin, xmax, ymax in metres, or the lower and the upper corner",
    ),
    (
        lambda: space().certify_path([HERE], [0]),
        "each edge must be two whole numbers, and vertices a list of configurations",
    ),
    (
        lambda: space().certify_path([HERE], [(0, 1)]),
        "edge number 0 is (0, 1); there are 1 vertices, counted from 0",
    ),
    (
        lambda: space().certify_path(np.zeros((0, 2))),
        "path has shape (0, 2)",
    ),
    (
        lambda: space().motion_is_free([HERE] * 2, [HERE] * 3),
        "q0 has shape (2, 2) and q1 (3, 2); they must broadcast",
    ),
    # Cells.
    (lambda: cells([[1], [1, 0]]), "it must have a value for each cell"),
    (
        lambda: cells([1, 0]),
        "it must have the axes x, y (and z), and at least one cell",
    ),
    (lambda: cells(0.9 * WIDE), "cells must be boolean"),
    (
        lambda: cells(np.array([(0.2, 3.0, 4.0, 0.1), (1.0, 2.0, 5.0, 0.9)])),
        "cells must be boolean",
    ),
    (lambda: cells(100 * WIDE), "whole numbers must be 0 or 1"),
    (
        lambda: cells(CELLS, inner=CELLS[:2]),
        "they must be equal",
    ),
    (
        lambda: cells(CELLS, inner=~CELLS),
        "inner has cell (0, 1), which is not in outer; it must be a subset of outer",
    ),
    # Grids.
    (lambda: Grid(0.0, 0.1, (3, 3)), "it must have length 2 or 3"),
    (
        lambda: Grid((0, 0), 0.1, 9),
        "it must have 2 whole numbers above zero, the cells along each axis",
    ),
    (lambda: Grid((0, 0), 1, (3, 3), "xx"), "there must be 2, and axes must differ"),
    (lambda: Grid((0, 0), 1, (3, 3), None, "m"), "there must be 2, and axes must differ"),
    (
        lambda: Workspace.from_polygons([FAR], 1e-2),
        "beyond 4194304 cells rounding invalidates proofs",
    ),
    (
        lambda: Workspace.from_polygons([FAR], 1e-2),
        "beyond 4194304 cells rounding invalidates proofs",
    ),
    # Maps.
    (
        lambda: space().update(CELLS[None], (0, 0)),
        "they must agree",
    ),
    (
        lambda: space().update(CELLS, (0, 0), inner=~CELLS),
        "it must be a subset of cells",
    ),
    (
        lambda: named().remove_obstacle("People"),
        "did you mean 'people'?",
    ),
    (
        lambda: Robot.polygon([HERE]),
        "it must be (n, 2) with n at least 3",
    ),
    (
        lambda: Robot.polygon(shapely.Point(0, 0)),
        "each part must be a Polygon",
    ),
    (
        lambda: Robot.polygon([shapely.Polygon()]),
        "it must cover some ground",
    ),
    (
        lambda: copy().add_obstacle("a", [(0, 0), (1, 1)]),
        "points need a radius, and a polygon 3 corners",
    ),
    (
        lambda: copy().add_obstacle("a", [(0, 0), (1, 1)]),
        "points need a radius, and a polygon 3 corners",
    ),
    (
        lambda: copy().add_obstacle("a", CELLS),
        "their size must be given",
    ),
    (
        lambda: copy().add_obstacle("a", 3),
        "a polygon or a mesh is needed",
    ),
    (
        lambda: copy().add_obstacle("a", "disk:0.3"),
        "it must be a shorthand, WKT, or a file that ends in .geojson, .json, .wkt, .stl, .obj, .ply, .glb, .gltf, .dae",
    ),
    (
        lambda: Robot.parse("footprint:x"),
        "corners or a shorthand must follow the colon",
    ),
    (
        lambda: Robot.parse("rect:1"),
        "LENGTHxWIDTH must follow the colon, each above zero, in metres, and @X,Y or @X,Y,Z for a center",
    ),
    # Balls.
    (
        lambda: Robot.from_balls([(0, 0)], None),
        "radii is missing; balls need one number, or one per center",
    ),
    (
        lambda: Robot.from_balls((0, 0), 0.1),
        "it must be (n, 2) or (n, 3) with n at least 1",
    ),
    (
        lambda: Robot.from_balls([(0, 0)], [0.1, 0.2]),
        "it must be one number or (1,)",
    ),
    (
        lambda: Robot.from_bitmap(~CELLS & CELLS, 0.1),
        "occupied holds no True cell; at least one cell must be occupied",
    ),
    (
        lambda: Robot.open("disc.json", solid="fill") or Robot.open("a.png"),
        "it applies to .stl, .obj, .ply, .glb, .gltf, .dae, .urdf",
    ),
    (
        lambda: Workspace.from_mesh(trimesh.creation.box(), 0.1, solid="fill", lazy=True),
        "filling needs all cells at once",
    ),
    (
        lambda: Workspace.from_mesh(BEAM, 1e-3, solid="fill"),
        "at most 1073741824 can be filled",
    ),
    (
        lambda: Workspace.from_polygons([], 0.1),
        "obstacles must cover some ground",
    ),
    (
        lambda: cspace.make_mesh(flat()).project_to_plane(),
        "it must have an area there",
    ),
    (
        lambda: Robot.from_mesh(trimesh.creation.box().apply_translation((1e3, 0, 0))),
        "move its center there first, by (-1000, -0, -0) m",
    ),
    (
        lambda: Workspace.from_shapes({"a": shapely.box(0, 0, 1, 1)}, 0.1),
        "POLYGON ((1 0, 1 1, 0 1, 0 0, 1 0))>}; it must be a list of shapes",
    ),
    (
        lambda: copy().add_obstacle("a", [(0, 0)], radius=-1.0),
        "none may be below zero",
    ),
    # Shapes and messages.
    (
        lambda: Robot.polygon(shapely.box(0, 0, 1e-170, 1e-170)),
        "it must be above zero",
    ),
    (
        lambda: make_mesh(CUBE, "fill").contains((0, 0, 0)),
        "the filled part depends on the spacing, and exact answers must not",
    ),
    (
        lambda: make_mesh(CUBE).boxes,
        "only boxes and cells in space are",
    ),
    # Limits of files.
    (
        lambda: raised_limits(max_cell=3).__enter__(),
        "limits name 'max_cell'; there are max_bytes, max_cells, max_text_bytes, max_description_bytes; did you mean 'max_cells'?",
    ),
)
def test_wrong_arguments_are_refused_in_one_line(call, hint):
    check_refused(call, hint)


FAR = shapely.box(1e5, 0, 1e5 + 8, 8)


CUBE = trimesh.creation.box((0.2, 0.2, 0.2))


def copy():
    """Build a map that may be changed."""
    return build(FLOOR, Robot.disc(0.05))


def named():
    """Build a map with a named obstacle."""
    space = copy()
    space.add_obstacle("people", [(1.0, 0.5)], radius=0.1)
    return space


def flat(axes=(0, 1, 2)):
    """Return a triangle that stands upright, with its axes in an order."""
    corners = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)])
    return corners[:, axes], [(0, 1, 2)]


BEAM = trimesh.creation.box((2, 1, 1))


def open_box(size):
    """Return a box without its lid."""
    box = trimesh.creation.box((size, size, size))
    box.update_faces(box.face_normals[:, 2] < 0.5)
    return box


def test_an_open_mesh_that_fills_nothing_warns():
    with pytest.warns(MeshWarning, match="it counts as a surface without an inside"):
        Workspace.from_mesh(open_box(1.0), 0.1, solid="fill")
    with warnings.catch_warnings(action="error"):
        Workspace.from_mesh(trimesh.creation.box((1, 1, 1)), 0.1, solid="fill")
        Workspace.from_mesh(open_box(1.0), 0.1, solid="surface")


def test_a_map_of_unknown_cells_says_so(tmp_path):
    message = cspace.ros.OccupancyGrid()
    message.info.resolution = 0.1
    message.info.width = message.info.height = 20
    message.data = [-1] * 400
    image = Image.new("RGBA", (20, 20), (255, 255, 255, 0))
    image.save(tmp_path / "clear.png")
    white = Image.new("RGBA", image.size, "white")
    white.alpha_composite(image)
    white.save(tmp_path / "white.png")
    hint = "400 of 400 cells are unknown"
    for unknown, known in (
        (
            Workspace.from_occupancy_grid(message),
            Workspace.from_occupancy_grid(message, unknown="free"),
        ),
        (
            Workspace.open(tmp_path / "clear.png", spacing=0.1),
            Workspace.open(tmp_path / "white.png", spacing=0.1),
        ),
    ):
        with pytest.warns(UserWarning, match=hint):
            build(unknown, Robot.disc(0.1))
        with warnings.catch_warnings(action="error"):
            assert build(known, Robot.disc(0.1)).count()[0]


def test_a_missing_package_is_installed_by_an_extra_that_exists():
    extras = tomllib.loads(Path("pyproject.toml").read_text())["project"]["optional-dependencies"]
    for package, extra in (("yourdfpy", "urdf"), ("viser", "view"), ("finufft", "spectral")):
        with pytest.raises(MissingPackageError) as caught:
            import_optional(f"missing_{package}", "it is needed", extra)
        (named,) = re.findall(
            r"type: pip install -c constraints.txt \"\.\[(\w+)\]\"", caught.value.rule
        )
        assert any(requirement.startswith(package) for requirement in extras[named])
