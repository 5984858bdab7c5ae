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
def floating():
    """Build the map of a ball that turns in space."""
    return build(ROOM, Robot.ball(0.05), rotations=Rotations.quaternions(2))


HERE = (2.5, 0.5)
CELLS = np.eye(3, dtype=bool)
WIDE = np.eye(9, dtype=bool)


def cells(values, **options):
    """Make a workspace of an array."""
    return Workspace.from_array(values, 0.1, **options)


@pytest.fixture(autouse=True)
def memory(monkeypatch):
    """Let every machine have the same memory."""
    monkeypatch.setattr("cspace._support.limits.free_bytes", lambda: 2**36)


@pytest.mark.filterwarnings("ignore::UserWarning")
@refusals(
    "call, hint",
    # Numbers.
    (lambda: Robot.disc("0.3"), "radius is '0.3' ... numeric"),
    (lambda: Robot.disc(10**400), "radius has too large an integer ... fit a float"),
    (
        lambda: space().is_free((1j, 0)),
        "q has complex values ... real",
    ),
    (
        lambda: Robot.polygon([(0, 0), (1, 0), (np.nan, 1), (0, 1)]),
        "polygon[2, 0] is nan ... finite",
    ),
    (lambda: Robot.disc(1e200), "radius is 1e+200 ... 1e-100"),
    (
        lambda: build(FLOOR, "disc:0.1", margin=-1),
        "metres",
    ),
    (
        lambda: space().sample_free(-1),
        "n is -1 ... whole",
    ),
    (
        lambda: space().sample_free(10**13),
        "95% of the free memory",
    ),
    # Words.
    (
        lambda: build(FLOOR, "disc:0.1", outside="x"),
        "outside is 'x' ... 'blocked' or 'free'",
    ),
    (
        lambda: Workspace.from_mesh(trimesh.creation.box(), 0.1, solid="all"),
        "solid is 'all' ... 'auto', 'surface' or 'fill'",
    ),
    (
        lambda: space().add_obstacle("", [HERE], radius=0.1),
        "name is '' ... non-empty string",
    ),
    (
        lambda: space().sample_free(3, rng=0),
        "rng is 0 ... numpy.random.Generator or None",
    ),
    # Points and boxes.
    (lambda: space().is_free((1, 2, 3)), "q has shape (3,) ... long"),
    (lambda: Robot.disc(0.1, 3), "center has shape () ... 2 numbers in metres"),
    (
        lambda: Workspace.from_polygons([shapely.Point(0, 0)], 0.1, bounds=(0, 1)),
        "bounds is (0, 1) ... corner",
    ),
    (
        lambda: space().certify_path([HERE], [0]),
        "edges has shape (1,) and type int64, for vertices of shape ... configurations",
    ),
    (
        lambda: space().certify_path([HERE], [(0, 1)]),
        "edge number 0 is (0, 1) ... counted",
    ),
    (
        lambda: space().certify_path(np.zeros((0, 2))),
        "path has shape (0, 2)",
    ),
    (
        lambda: space().motion_is_free([HERE] * 2, [HERE] * 3),
        "q0 has shape (2, 2) and q1 (3, 2) ... broadcast",
    ),
    # Cells.
    (lambda: cells(0.9 * WIDE), "occupied has dtype float64 ... boolean"),
    (
        lambda: cells(CELLS, inner=CELLS[:2]),
        "inner has shape (2, 3) but the grid has (3, 3) ... equal",
    ),
    (
        lambda: cells(CELLS, inner=~CELLS),
        "inner has cell (0, 1), which is not in outer ... subset of outer",
    ),
    # Grids.
    (lambda: Grid(0.0, 0.1, (3, 3)), "lower is 0.0 ... length 2 or 3"),
    (
        lambda: Grid((0, 0), 0.1, 9),
        "shape is (9,) ... along",
    ),
    (lambda: Grid((0, 0), 1, (3, 3), "xx"), "axes are x, x ... differ"),
    (lambda: Grid((0, 0), 1, (3, 3), None, "m"), "units are m ... differ"),
    # Maps.
    (
        lambda: named().remove_obstacle("People"),
        "did you mean 'people'?",
    ),
    (
        lambda: Robot.polygon([HERE]),
        "polygon has shape (1, 2) ... least",
    ),
    (
        lambda: Robot.polygon(shapely.Point(0, 0)),
        "polygon is a Point ... part",
    ),
    (
        lambda: Robot.polygon([shapely.Polygon()]),
        "polygon is empty ... cover some ground",
    ),
    (
        lambda: copy().add_obstacle("a", [(0, 0), (1, 1)]),
        "shape is points ... corners",
    ),
    (
        lambda: copy().add_obstacle("a", CELLS),
        "shape is an array of cells ... size",
    ),
    (
        lambda: copy().add_obstacle("a", 3),
        "shape is 3 ... polygon",
    ),
    (
        lambda: Robot.parse("footprint:x"),
        "robot is 'footprint:x' ... shorthand",
    ),
    (
        lambda: Robot.parse("rect:1"),
        "robot is 'rect:1' ... LENGTHxWIDTH",
    ),
    # Balls.
    (
        lambda: Robot.from_balls([(0, 0)], None),
        "radii is missing ... center",
    ),
    (
        lambda: Robot.from_balls((0, 0), 0.1),
        "centers has shape (2,) ... least",
    ),
    (
        lambda: Robot.from_balls([(0, 0)], [0.1, 0.2]),
        "radii has shape (2,) ... one number or (1,)",
    ),
    (
        lambda: Robot.from_bitmap(~CELLS & CELLS, 0.1),
        "occupied holds no True cell",
    ),
    (
        lambda: Robot.open("disc.json", solid="fill") or Robot.open("a.png"),
        "solid is 'fill' for disc.json ... applies",
    ),
    (
        lambda: Workspace.from_mesh(trimesh.creation.box(), 0.1, solid="fill", lazy=True),
        "lazy is True with solid='fill' ... filling",
    ),
    (
        lambda: Workspace.from_mesh(BEAM, 1e-3, solid="fill"),
        "mesh is 2003 x 1003 x 1003 cells large ... 1073741824",
    ),
    (
        lambda: Workspace.from_polygons([], 0.1),
        "polygons holds no geometry ... ground",
    ),
    (
        lambda: cspace.make_mesh(flat()).project_to_plane(),
        "mesh is flat, seen from above ... area there",
    ),
    (
        lambda: Workspace.from_shapes({"a": shapely.box(0, 0, 1, 1)}, 0.1),
        "POLYGON ((1 0, 1 1, 0 1, 0 0, 1 0))>}; it must be a list of shapes",
    ),
    (
        lambda: copy().add_obstacle("a", [(0, 0)], radius=-1.0),
        "radius holds -1 ... none",
    ),
    # Shapes and messages.
    (
        lambda: Robot.polygon(shapely.box(0, 0, 1e-170, 1e-170)),
        "polygon has area 0 ... above zero",
    ),
    (
        lambda: make_mesh(CUBE, "fill").contains((0, 0, 0)),
        "mesh has solid='fill' ... depends",
    ),
    (
        lambda: make_mesh(CUBE).boxes,
        "shape is not a union of boxes ... space",
    ),
    # Limits of files.
    (
        lambda: raised_limits(max_cell=3).__enter__(),
        "limits name 'max_cell' ... max_description_bytes ... did you mean 'max_cells'?",
    ),
)
def test_wrong_arguments_are_refused_in_one_line(call, hint):
    check_refused(call, hint)


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


def test_a_missing_package_is_installed_by_an_extra_that_exists():
    extras = tomllib.loads(Path("pyproject.toml").read_text())["project"]["optional-dependencies"]
    for package, extra in (("viser", "view"), ("finufft", "spectral")):
        with pytest.raises(MissingPackageError) as caught:
            import_optional(f"missing_{package}", "it is needed", extra)
        (named,) = re.findall(
            r"type: pip install -c constraints.txt \"\.\[(\w+)\]\"", caught.value.rule
        )
        assert any(requirement.startswith(package) for requirement in extras[named])
