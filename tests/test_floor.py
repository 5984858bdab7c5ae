"""Robots with a shape in space that drive on a floor, against exact geometry of their parts.

The oracle takes the robot as pieces whose part between two heights, seen from above, has a formula,
and the obstacles as prisms.
"""

import math
import re
import warnings

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import example, given
from hypothesis import strategies as st

import cspace
import planners
from cspace import BLOCKED, FREE, MIXED, Robot, Workspace
from cspace._queries.edges import edges_are_free
from cspace._queries.overlaps import count_overlaps
from cspace._queries.points import classify_blocks
from tests.helpers.floors import ROUNDING, cut_ball, cut_cylinder, cut_prism, cut_pyramid, touches
from tests.helpers.handmade import build_empty
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.strategies import examples, exteriors, few, seeds

# Low boxes of a random scene may look like the ground of a scan.
pytestmark = pytest.mark.filterwarnings("ignore:the robot stands in layers:UserWarning")

BASE = shapely.box(-0.4, -0.25, 0.5, 0.25)


def extrude(outline, bottom, top):
    """Return a closed mesh of a prism."""
    mesh = trimesh.creation.extrude_polygon(outline, top - bottom)
    return mesh.apply_translation((0.0, 0.0, bottom))


def make_pyramid(bottom, top):
    corners = shapely.get_coordinates(BASE.exterior)[:4]
    points = [*[(*corner, bottom) for corner in corners], (0.0, 0.0, top)]
    return trimesh.Trimesh(points, trimesh.convex.convex_hull(points).faces, process=False)


RING = (
    shapely.Point(0.1, 0.0).buffer(0.4, quad_segs=3).difference(shapely.Point(0.1, 0.0).buffer(0.3))
)


def make_robots(bottom):
    """Return a robot of every kind by name, with its pieces; they stand at a height."""
    mast = shapely.box(0.1, -0.1, 0.3, 0.1)
    top = bottom + 0.2
    bits = np.zeros((6, 4, 5), dtype=bool)
    bits[:, :, :2] = bits[2, 1, 2:] = True
    side = 0.13
    cells = [
        cut_prism(
            shapely.box(*(side * np.array([i - 3, j - 2, i - 2, j - 1]))),
            bottom + side * k,
            bottom + side * (k + 1),
        )
        for i, j, k in np.argwhere(bits).tolist()
    ]
    balls = [(0.0, 0.0, bottom + 0.25), (0.3, 0.1, bottom + 0.55)]
    pyramid = make_pyramid(bottom, bottom + 0.73)
    low_box, high_box = extrude(BASE, bottom, top), extrude(mast, top - 0.05, bottom + 0.8)
    return {
        "box": (
            Robot.box((0.9, 0.5, 0.37), (0.05, 0.0, bottom + 0.185)),
            [cut_prism(BASE, bottom, bottom + 0.37)],
        ),
        "balls": (
            Robot.from_balls(balls, [0.25, 0.15]),
            [cut_ball(center, radius) for center, radius in zip(balls, [0.25, 0.15], strict=True)],
        ),
        "cylinder": (
            Robot.cylinder(0.3, 0.5, (0.0, 0.0, bottom + 0.25)),
            [cut_cylinder((0.0, 0.0, bottom + 0.25), 0.3, 0.5)],
        ),
        "capsule": (
            Robot.capsule(0.2, 0.3, (0.1, 0.0, bottom + 0.351)),
            [
                cut_cylinder((0.1, 0.0, bottom + 0.351), 0.2, 0.3),
                cut_ball((0.1, 0.0, bottom + 0.201), 0.2),
                cut_ball((0.1, 0.0, bottom + 0.501), 0.2),
            ],
        ),
        "cells": (Robot.from_bitmap(bits, side, (-3 * side, -2 * side, bottom)), cells),
        "mast": (
            Robot.from_mesh(trimesh.util.concatenate([low_box, high_box])),
            [cut_prism(BASE, bottom, top), cut_prism(mast, top - 0.05, bottom + 0.8)],
        ),
        "pyramid": (Robot.from_mesh(pyramid), [cut_pyramid(BASE, bottom, bottom + 0.73)]),
        "ring": (
            Robot.from_mesh(extrude(RING, bottom, bottom + 0.45)),
            [cut_prism(RING, bottom, bottom + 0.45)],
        ),
        "sheet": (
            Robot.from_mesh(pyramid, solid="surface"),
            [cut_pyramid(BASE, bottom, bottom + 0.73)],  # its surface hits what it contains or less
        ),
    }


KINDS = tuple(make_robots(0.0))
TURNING = ("box", "balls", "mast", "pyramid", "sheet")
"""Robots whose parts are round no more than they are themselves."""


def list_prisms(workspace, outside="free"):
    """Return the occupied cells of each layer as prisms: outline, lowest and highest point."""
    grid, prisms = workspace.grid, []
    if outside == "blocked":
        hall = shapely.box(*grid.lower[:2], *grid.upper[:2])
        prisms.append((hall.buffer(10.0).difference(hall), -100.0, 100.0))
    (x, y, z), h = grid.lower, grid.spacing
    for k in range(grid.shape[2]):
        i, j = np.nonzero(workspace.outer[:, :, k])
        squares = shapely.box(x + h * i, y + h * j, x + h * (i + 1), y + h * (j + 1))
        if len(squares):
            prisms.append((shapely.union_all(squares), z + h * k, z + h * (k + 1)))
    return prisms


def draw_scene(rng, spacing=0.1, lower=0.0, shape=(30, 26, 12)):
    """Draw boxes of cells at all heights, as of tables, shelves and beams."""
    cells = np.zeros(shape, dtype=bool)
    for _ in range(7):
        first = rng.integers(0, shape)
        stop = first + rng.integers(1, (9, 9, 3))
        cells[tuple(map(slice, first, stop))] = True
    return Workspace.from_array(cells, spacing, (-0.7, 0.4, lower))


def draw_rows(rng, space, count):
    lower, upper = space.bounds
    return rng.uniform((*lower, -math.pi), (*upper, math.pi), (count, 3))[:, : space.size]


def check_states(space, pieces, prisms, rows, states):
    """Compare states with the oracle, and return how many of each it confirmed."""
    counts = [0, 0, 0]
    for q, state in zip(rows, states, strict=True):
        pose = q if len(q) == 3 else (*q, 0.0)
        counts[state] += 1
        if state == FREE:
            assert not touches(pieces, prisms, pose, space.floor, ROUNDING)
        elif state == BLOCKED:
            assert touches(pieces, prisms, pose, space.floor, -ROUNDING)
    return counts


@pytest.mark.parametrize("spacing, outside", few([(0.1, "free"), (0.07, "blocked")]))
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rotations", few([12, None]))
def test_states_hold_for_the_parts_of_robots_of_every_kind(kind, rotations, spacing, outside):
    rng = np.random.default_rng(7)
    robot, pieces = make_robots(0.05)[kind]
    workspace = draw_scene(rng, spacing, shape=(44, 38, 16))
    space = cspace.build(workspace, robot, rotations=rotations, floor=0.1, outside=outside)
    prisms, rows = list_prisms(workspace, outside), draw_rows(rng, space, 150)
    counts = check_states(space, pieces, prisms, rows, space.classify(rows))
    assert counts[FREE] > 20
    exact = space.exact.classify(rows)
    if kind != "sheet":  # geometry knows that a surface may stand around an obstacle
        check_states(space, pieces, prisms, rows, exact)
    assert (exact == FREE).sum() >= counts[FREE]


@example(68, 0, -0.7, 0.01)
@example(68, 0, 0.1, 0.01)
@examples(40)
@given(st.integers(3, 70), st.integers(-1, 1), st.floats(-3.0, 3.0), st.sampled_from([0.01, 0.1]))
def test_contact_with_a_layer_is_undecided_within_rounding_alone(layer, ulps, lower, spacing):
    """The top of a robot lies on the lower border of a beam, or one ulp beside it."""
    floor = lower + spacing
    top = float(np.nextafter(lower + spacing * layer - floor, ulps * math.inf if ulps else 0.0))
    cells = np.zeros((12, 10, layer + 2), dtype=bool)
    cells[4:6, :, layer:] = True
    workspace = Workspace.from_array(cells, spacing, (0.0, 0.0, lower))
    bottom, room = 0.5 * spacing, 3e-8 * spacing

    def classify(top):
        sides = (3.0 * spacing, 2.0 * spacing, top - bottom)
        robot = Robot.box(sides, (0.0, 0.0, (top + bottom) / 2.0))
        space = cspace.build(workspace, robot, floor=floor)
        return space.classify((5.0 * spacing, 5.0 * spacing))

    # What touches a layer, up to rounding, counts for FREE, and not for BLOCKED.
    assert [classify(top + step) for step in (-room, 0.0, room)] == [FREE, MIXED, BLOCKED]


@examples(16)
@given(seeds, exteriors, st.sampled_from(TURNING), st.sampled_from([None, 7]), st.booleans())
def test_a_map_on_a_floor_is_the_worst_of_its_layers(seed, outside, kind, rotations, margin):
    rng = np.random.default_rng(seed)
    workspace = draw_scene(rng)
    robot, _ = make_robots(0.05)[kind]
    options = {"rotations": rotations, "outside": outside, "margin": 0.07 * margin}
    space = cspace.build(workspace, robot, floor=0.1, **options)
    worst = np.zeros_like(space.cell_states)
    grid = workspace.grid
    for k in range(grid.shape[2]):
        low = grid.lower[2] + grid.spacing * k - 0.1
        outer, inner = robot.shape.slab(low, low + grid.spacing, 2.0**-26 * grid.spacing)
        cells = np.ascontiguousarray(workspace.outer[:, :, k])
        plane = Workspace.from_array(cells, grid.spacing, grid.lower[:2])
        if outer is None:
            continue
        first = cspace.build(plane, Robot("outer", outer), inner=False, **options).cell_states
        worst = np.maximum(worst, first)
        if inner is not None:
            states = cspace.build(plane, Robot("inner", inner), **options).cell_states
            worst[states == BLOCKED] = BLOCKED
    # Slices that are mirror images have rasters that are, too, unlike those of rounded parts.
    assert (worst != space.cell_states).mean() < 0.001
    for method in ("fft", "direct"):
        again = cspace.build(workspace, robot, floor=0.1, method=method, **options)
        assert (again.cell_states == space.cell_states).all()


def make_shelf(rng):
    center = (*rng.uniform((-0.5, 0.6), (2.0, 2.6)), rng.uniform(0.2, 1.1))
    return extrude(shapely.box(-0.3, -0.2, 0.3, 0.2), 0.0, 0.15).apply_translation(center)


@examples(8)
@given(seeds, exteriors, st.sampled_from([None, 6]), st.booleans())
def test_a_map_on_a_floor_follows_its_scene(tmp_path_factory, seed, outside, rotations, saved):
    """Solids at any height, boxes of cells and whole workspaces, also after a map is opened."""
    rng = np.random.default_rng(seed)
    robot, _ = make_robots(0.05)["mast"]
    options = {"rotations": rotations, "floor": 0.1, "outside": outside}
    scene = draw_scene(rng)
    if saved:
        shapes = [cspace.make_mesh(make_shelf(rng)) for _ in range(3)]
        scene = Workspace.from_shapes(shapes, 0.1, bounds=(-0.7, 0.4, 0.0, 2.3, 3.0, 1.2))
    space = cspace.build(scene, robot, **options)

    def check():
        again = cspace.build(space.workspace, robot, **options)
        assert (again.cell_states == space.cell_states).all()
        rows = draw_rows(rng, space, 300)
        wide = 3.0 * rows
        assert (again.classify(wide) == space.classify(wide)).all()
        assert (again.exact.classify(rows) == space.exact.classify(rows)).all()
        assert (again.obstacle_distance(rows) == space.obstacle_distance(rows)).all()

    if saved:
        path = tmp_path_factory.mktemp("saved") / "map.zarr"
        space.save(path)
        opened = cspace.open(path)
        assert (opened.floor, opened.grid) == (space.floor, space.grid)
        assert opened.workspace.grid == scene.grid and len(opened.workspace.shapes) == 3
        space = opened
        check()

    update = space.add_obstacle("shelf", make_shelf(rng))
    assert len(update.lower) == len(update.upper) == 2
    check()
    space.update({"shelf": make_shelf(rng), "ball": Robot.ball(0.2, (1.0, 1.0, 0.7))})
    check()
    zone = shapely.Point(rng.uniform((0.0, 0.0), (2.0, 2.0))).buffer(0.4, quad_segs=2)
    space.add_obstacle("zone", zone)
    check()
    space.update(
        {"zone": Robot.disc(0.3, (1.1, 1.4)), "fence": shapely.LineString([(0, 1), (2, 2)])}
    )
    check()
    space.update({"fence": None})
    check()
    first = rng.integers(0, (24, 20, 9))
    space.update(rng.random((5, 5, 3)) < 0.4, first.tolist())
    check()
    space.remove_obstacle("shelf")
    space.update(draw_scene(rng))
    check()


@examples(10)
@given(seeds, exteriors, st.sampled_from(TURNING), st.sampled_from([None, 6]))
def test_overlaps_are_counted_over_all_layers(seed, outside, kind, rotations):
    rng = np.random.default_rng(seed)
    robot, _ = make_robots(0.05)[kind]
    options = {"rotations": rotations, "outside": outside, "floor": 0.1}
    space = cspace.build(draw_scene(rng), robot, counts=True, **options)
    counts = np.asarray(space.overlap_counts).reshape(-1, *space.grid.shape)
    by_rotation = counts[space.slice_of].reshape(space.cell_states.shape)
    assert ((by_rotation == 0) == (space.cell_states == FREE)).all()
    rows = draw_rows(rng, space, 60)
    cells = space.grid.cell_of(rows[:, :2])
    slices = space.slice_of[np.ravel(space.rotations.cell_of(rows[:, 2:]))] if rotations else 0
    found = counts[slices, cells[:, 0], cells[:, 1]]
    assert (space.overlap_count(rows) == found).all()
    space.update(draw_scene(rng))
    again = cspace.build(space.workspace, robot, counts=True, **options)
    assert (space.overlap_count(rows) == again.overlap_count(rows)).all()


@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_robots_are_contained_only_with_all_of_their_heights(outside):
    cells = np.zeros((30, 30, 10), dtype=bool)
    cells[5:25, 5:25] = True
    middle, aside = (1.5, 1.5, 0.3), (0.72, 1.5, 0.3)

    def build(bottom, top):
        box = Robot.box((0.4, 0.4, top - bottom), (0.0, 0.0, (bottom + top) / 2.0))
        scene = Workspace.from_array(cells, 0.1)
        return cspace.build(scene, box, rotations=8, floor=0.0, outside=outside)

    space = build(0.05, 0.95)
    assert space.contains_robot([middle, aside]).tolist() == [True, False]
    cells[15, 15, 4] = False  # a hole at one height
    assert not build(0.05, 0.95).contains_robot(middle)
    assert build(0.55, 0.95).contains_robot(middle)
    assert not build(0.55, 1.0).contains_robot(middle)  # it touches the ceiling
    if outside == "free":
        assert not build(0.55, 1.5).contains_robot(middle)


def test_distances_are_those_in_space():
    cells = np.zeros((40, 30, 10), dtype=bool)
    cells[20:, :, 7:] = True  # a ceiling at 0.7 m
    workspace = Workspace.from_array(cells, 0.1)
    robot = Robot.box((0.4, 0.4, 0.3), (0.0, 0.0, 0.15))
    space = cspace.build(workspace, robot, rotations=8, floor=0.2, outside="free")
    under = (3.0, 1.5, 0.0)
    assert space.is_free(under)
    assert space.obstacle_distance(under) == pytest.approx(0.2, abs=1e-6)
    assert space.obstacle_distance((1.5, 1.5, 0.0)) == pytest.approx(math.hypot(0.3, 0.2), abs=1e-6)
    # A robot that keeps its heights comes no nearer to ground or ceiling of the grid.
    walled = cspace.build(Workspace.from_array(np.zeros_like(cells), 0.1), robot, floor=0.0)
    assert walled.obstacle_distance((2.0, 1.5)) == pytest.approx(1.3, abs=1e-6)


@pytest.mark.parametrize("drive", [None, planners.Differential(), planners.Car(0.4)])
def test_distances_above_and_below_may_be_less_than_the_margin(drive):
    cells = np.zeros((40, 30, 10), dtype=bool)
    cells[:, :, 7:] = True  # a ceiling at 0.7 m
    scene = Workspace.from_array(cells, 0.1)
    robot = Robot.box((0.4, 0.4, 0.48), (0.0, 0.0, 0.44))
    space = cspace.build(scene, robot, rotations=8, floor=0.0, margin=0.15)
    start, goal = (1.05, 1.45, 0.0), (2.95, 1.45, 0.0)
    assert space.obstacle_distance(start) == pytest.approx(0.02, abs=1e-6)
    assert 0.0 <= space.obstacle_distance(start, 0.01, 0.01) <= 0.02
    assert space.path_obstacle_distance([start, goal]) <= 0.02 + 1e-6
    plan = planners.plan(space, start, goal, drive=drive)
    assert plan.certified and plan.obstacle_distance <= 0.02 + 1e-6
    assert planners.plan(space.exact, start, goal).obstacle_distance <= 0.02 + 1e-6
    # Sideways, the margin is kept.
    low = Robot.box((0.4, 0.4, 0.3), (0.0, 0.0, 0.35))
    assert cspace.build(scene, low, rotations=8, floor=0.0, margin=0.15).obstacle_distance(
        start
    ) == pytest.approx(0.2, abs=1e-6)


def make_posts(rng, bottom, top):
    """Return the outlines of some posts, and the posts as meshes between two heights."""
    centers, sides = rng.uniform((0.0, 0.0), (4.0, 3.0), (12, 2)), rng.uniform(0.05, 0.4, (12, 2))
    outlines = shapely.box(*(centers - sides).T, *(centers + sides).T)
    return outlines, [cspace.make_mesh(extrude(outline, bottom, top)) for outline in outlines]


@examples(6)
@given(seeds, st.sampled_from([(0.0, 0.8), (0.05, 0.8), (-0.2, 1.0)]))
def test_obstacles_that_leave_the_heights_of_a_scene_decide_as_in_the_plane(seed, heights):
    rng = np.random.default_rng(seed)
    outlines, posts = make_posts(rng, -0.5, 2.0)
    outside = "free" if heights[0] < 0.0 else ["free", "blocked"][seed % 2]
    options = {"rotations": 6, "outside": outside}
    flat = Workspace.from_shapes(list(outlines), 0.1, bounds=(0.0, 0.0, 4.0, 3.0))
    plane = cspace.build(flat, Robot.rectangle(0.6, 0.4), **options).exact
    bottom, top = heights
    box = Robot.box((0.6, 0.4, top - bottom), (0.0, 0.0, (bottom + top) / 2.0))
    scene = Workspace.from_shapes(posts, 0.1, bounds=(0.0, 0.0, 0.0, 4.0, 3.0, 0.8))
    space = cspace.build(scene, box, floor=0.0, **options).exact
    rows = rng.uniform((0.5, 0.5, -3.0), (3.5, 2.5, 3.0), (300, 3))
    # Posts that leave the sides are capped by cells.
    assert (space.classify(rows) != plane.classify(rows)).mean() < 0.03
    assert not (space.is_free(rows) & ~plane.is_free(rows)).any()


@pytest.mark.parametrize("outside", few(["free", "blocked"]))
@pytest.mark.parametrize("room", [0.0, 1e-16, 1e-11])
@pytest.mark.parametrize("kind", ["box", "mesh"])
def test_thin_robots_inside_an_obstacle_are_never_free(kind, room, outside):
    """An obstacle leaves the heights of the scene, and the robot does so within rounding."""
    block = cspace.make_mesh(trimesh.creation.box(bounds=[(0.5, 0.5, -1.0), (2.5, 2.5, 3.0)]))
    scene = Workspace.from_shapes([block], 0.1, bounds=(0.0, 0.0, 0.0, 3.0, 3.0, 0.6))
    rows = np.random.default_rng(0).uniform((0.55, 0.55, -3.0), (2.45, 2.45, 3.0), (200, 3))
    for bottom, top in ((-room, 0.6 + room), (0.1, 0.6 + room), (-room, 0.5)):
        robot = Robot.box((0.03, 0.02, top - bottom), (0.0, 0.0, (bottom + top) / 2.0))
        if kind == "mesh":
            corners = [(-0.015, -0.01, bottom), (0.015, 0.01, top)]
            robot = Robot.from_mesh(trimesh.creation.box(bounds=corners))
        space = cspace.build(scene, robot, rotations=4, floor=0.0, outside=outside)
        assert not space.exact.is_free(rows).any()


ZONES = {
    "box": shapely.box(1.0, 0.5, 1.2, 1.0),
    "disc": Robot.disc(0.4, (1.4, 0.75)),
    "fence": shapely.LineString([(1.0, 0.5), (1.0, 1.0)]),
}


@pytest.mark.parametrize("lower, room", [(0.0, 1e-9), (-1e4, 6e-8), (1e4, 6e-8)])
@pytest.mark.parametrize("rotations", [None, 4])
@pytest.mark.parametrize("zone", [None, *ZONES])
def test_contact_sideways_is_decided_near_and_far_from_the_origin(lower, room, rotations, zone):
    """A robot, high above the floor, comes up to a beam or a zone at x = 1 m."""
    cells = np.zeros((40, 30, 12), dtype=bool)
    cells[20:24, 10:20, 4:] = zone is None
    scene = Workspace.from_array(cells, 0.05, (0.0, 0.0, lower))
    robot = Robot.box((0.3, 0.2, 0.3), (0.0, 0.0, 0.35))
    space = cspace.build(scene, robot, floor=lower, rotations=rotations)
    if zone:
        space.add_obstacle("zone", ZONES[zone])
    near = np.array([(0.85 - room, 0.75, 0.0), (0.85 + 1e-12, 0.75, 0.0)])[:, : space.size]
    assert space.exact.is_free(near).tolist() == [True, False]
    assert not space.is_free(near).any()


@pytest.mark.parametrize("lower, room", few([(1e4, 6e-8), (0.0, 1e-9)]))
def test_heights_below_a_mesh_are_decided_by_its_geometry(lower, room):
    """Its bottom touches the layer below, which cells alone leave undecided."""
    beam = trimesh.creation.box(bounds=[(1.0, 0.5, lower + 0.75), (1.2, 1.0, lower + 0.95)])
    scene = Workspace.from_mesh(beam, 0.05, (0.0, 0.0, lower, 2.0, 1.5, lower + 1.2))
    for height, is_free in ((0.75 - room, True), (0.75 + 1e-12, False)):
        robot = Robot.box((0.3, 0.2, height), (0.0, 0.0, height / 2.0))
        space = cspace.build(scene, robot, floor=lower)
        assert space.classify((1.1, 0.75)) == MIXED
        assert space.exact.is_free((1.1, 0.75)) == is_free


# ---- plane shapes at all heights -----------------------------------------------------------------


def draw_zones(rng):
    """Draw plane obstacles of every kind, each with its parts as outlines and radii."""
    x, y = rng.uniform((-0.2, 0.85), (1.4, 2.4), (8, 2)).T
    square = shapely.box(x[0], y[0], x[0] + 0.8, y[0] + 0.5)
    ring = square.difference(square.buffer(-0.1, join_style="mitre"))
    triangle = shapely.Polygon([(x[1], y[1]), (x[1] + 0.5, y[1]), (x[1], y[1] + 0.4)])
    fence = shapely.LineString([(x[2], y[2]), (x[3], y[3])])
    post = shapely.Point(x[7], y[7])
    radii = rng.uniform(0.05, 0.4, 2)
    discs = shapely.points(np.column_stack([x[4:6], y[4:6]]))
    mask = cspace.ros.OccupancyGrid()
    mask.info.resolution, mask.info.width, mask.info.height = 0.17, 3, 2
    mask.info.origin.position.x, mask.info.origin.position.y = x[6], y[6]
    mask.data.extend([100, 0, 100, 100, 100, 0])
    area = cspace.ros.read_mask(mask).areas[100]
    zone = shapely.geometry.mapping(triangle)
    return {
        "polygons": ([ring, triangle], [(ring, 0.0), (triangle, 0.0)]),
        "mapping": (zone, [(triangle, 0.0)]),
        "fence and post": ([fence, post], [(fence, 0.0), (post, 0.0)]),
        "discs": (
            Robot.from_balls(np.column_stack([x[4:6], y[4:6]]), radii),
            list(zip(discs, radii, strict=True)),
        ),
        "mask": (area, [(area, 0.0)]),
    }


@pytest.mark.parametrize("kind", few(["mast", "balls", "cells", "pyramid", "ring"]))
def test_plane_shapes_count_at_all_heights(kind):
    """FREE keeps every part of the robot off the prisms of zones, at any height."""
    rng = np.random.default_rng(17)
    robot, pieces = make_robots(0.05)[kind]
    free = 0
    for outside in ("free", "blocked"):
        workspace = draw_scene(rng, shape=(30, 26, 11))
        space = cspace.build(workspace, robot, rotations=12, floor=0.1, outside=outside)
        for shape, parts in draw_zones(rng).values():
            prisms = list_prisms(workspace, outside)
            prisms += [(part.buffer(radius, quad_segs=2000), -9.0, 9.0) for part, radius in parts]
            space.add_obstacle("zone", shape)
            rows = draw_rows(rng, space, 150)
            free += check_states(space, pieces, prisms, rows, space.classify(rows))[FREE]
            exact = space.exact.classify(rows)
            check_states(space, pieces, prisms, rows, exact)
            # Straight ways to near places are free at both ends and on the way.
            ends = rows + rng.normal(0.0, 0.05, rows.shape)
            ways = [space.motion_is_free(rows, ends), space.exact.motion_is_free(rows, ends)]
            for q in 0.5 * (rows + ends)[ways[0] | ways[1]]:
                assert not touches(pieces, prisms, q, space.floor, ROUNDING)
            space.remove_obstacle("zone")
        assert free > 50
        again = cspace.build(workspace, robot, rotations=12, floor=0.1, outside=outside)
        assert (space.cell_states == again.cell_states).all()


@examples(10)
@given(seeds, exteriors, st.sampled_from([None, 6]), st.sampled_from([0.0, 0.07]))
def test_zones_alone_make_the_map_of_the_plane(seed, outside, rotations, margin):
    """A robot that is a prism, in a hall without anything, is the plane robot."""
    rng = np.random.default_rng(seed)
    corner = (-0.7, 0.4, float(rng.uniform(-5.0, 5.0)))
    hall = Workspace.from_array(np.zeros((30, 26, 7), dtype=bool), 0.1, corner)
    flat = Workspace.from_array(np.zeros((30, 26), dtype=bool), 0.1, corner[:2])
    options = {"rotations": rotations, "outside": outside, "margin": margin}
    top = 0.7 if outside == "free" else float(rng.uniform(0.1, 0.7))
    box = Robot.box((0.5, 0.3, top), (0.05, 0.0, top / 2.0))
    space = cspace.build(hall, box, floor=corner[2], **options)
    plane = cspace.build(flat, Robot.rectangle(0.5, 0.3, (0.05, 0.0)), **options)
    zones = {name: shape for name, (shape, _) in draw_zones(rng).items()}
    zones |= {"ellipse": "ellipse:0.4,0.2@1.3,1.9"}
    ends = draw_rows(rng, plane, 200)
    for name, zone in zones.items():
        for each in (space, plane):
            each.add_obstacle(name, zone)
        assert (space.cell_states == plane.cell_states).all()
        assert (space.exact.is_free(ends) == plane.exact.is_free(ends)).all()
        ways = ends[:-1], ends[1:]
        assert (space.exact.motion_is_free(*ways) == plane.exact.motion_is_free(*ways)).all()
        found, known = space.obstacle_distance(ends), plane.obstacle_distance(ends)
        np.testing.assert_allclose(found, known, atol=margin + 1e-9)
        assert ((found > 0.0) == (known > 0.0)).all()


def test_zones_are_told_kept_and_given_to_other_halls(tmp_path):
    scene = Workspace.from_array(np.zeros((40, 30, 7), dtype=bool), 0.1)
    robot = Robot.box((0.4, 0.4, 0.5), (0.0, 0.0, 0.25))
    space = cspace.build(scene, robot, rotations=8, floor=0.0)
    start, goal = (0.55, 1.45, 0.0), (3.45, 1.45, 0.0)
    space.add_obstacle("keepout", shapely.box(1.8, -1.0, 2.2, 5.0))
    assert space.is_disconnected(start, goal)
    assert space.explain(start, goal).obstacles == ("'keepout'",)
    assert space.removals(start, goal)[0] == "keepout"
    space.save(tmp_path / "map.zarr")
    opened = cspace.open(tmp_path / "map.zarr")
    rows = draw_rows(np.random.default_rng(0), space, 300)
    assert (opened.exact.classify(rows) == space.exact.classify(rows)).all()
    # A higher hall, in which the robot stands above the heights of the first one.
    higher = Workspace.from_array(np.zeros((40, 30, 30), dtype=bool), 0.1)
    for name, shape in space.obstacles.items():
        for floor in (0.0, 2.0):
            other = cspace.build(higher, robot, rotations=8, floor=floor)
            other.add_obstacle(name, shape)
            assert (other.cell_states == space.cell_states).all()
            assert (other.exact.classify(rows) == space.exact.classify(rows)).all()
    # Without a floor, it keeps its heights, which reach a cell beyond those of the first hall.
    box = trimesh.creation.box(bounds=[(1.8, -1.0, -0.1), (2.2, 5.0, 0.8)])
    halls = [build_empty((28, 20, 14), Robot.ball(0.01), 0.15) for _ in range(2)]
    for hall, shape in zip(halls, (*space.obstacles.values(), box), strict=True):
        hall.add_obstacle("keepout", shape)
    assert (halls[0].cell_states == halls[1].cell_states).all()


def make_scans():
    """Return scans of one hall: points with a radius, cells of a sensor, and a mesh."""
    rng = np.random.default_rng(1)
    ground = np.column_stack([rng.uniform((0.0, 0.0), (4.0, 3.0), (20000, 2)), np.zeros(20000)])
    wall = np.column_stack([np.full(8000, 2.0), rng.uniform((0.0, 0.0), (1.5, 1.0), (8000, 2))])
    bounds = (0.0, 0.0, -0.25, 8.0, 3.0, 1.15)
    plate = trimesh.creation.box(bounds=[(0.0, 0.0, -0.03), (4.0, 3.0, 0.02)])
    wall_mesh = trimesh.creation.box(bounds=[(2.0, 0.0, 0.0), (2.05, 1.5, 1.0)])
    hall = trimesh.util.concatenate([plate, wall_mesh])
    points = Workspace.from_points(np.vstack([ground, wall]), 0.1, bounds, radius=0.02)
    cells = Workspace.from_array(points.outer, 0.1, points.grid.lower)
    return points, cells, Workspace.from_mesh(hall, 0.1, bounds)


LAYERS = r"stands in layers .*from -0\.\d+ m to .* occupied; floor=([0-9.]+) clears them"


def test_scans_of_every_kind_name_the_ground_also_if_something_is_free():
    robot = Robot.box((0.3, 0.3, 0.5), (0.0, 0.0, 0.25))
    for scene in make_scans():
        with pytest.warns(UserWarning, match=LAYERS) as caught:
            low = cspace.build(scene, robot, floor=0.0, outside="free")
        assert low.count()[0]  # beside the hall
        (found,) = re.findall(LAYERS, str(caught[0].message))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            high = cspace.build(scene, robot, floor=float(found), outside="free")
        assert high.count()[0] > 1.5 * low.count()[0]


SCENE = Workspace.from_array(np.zeros((20, 20, 10), dtype=bool), 0.1)
CRATE = Robot.box((0.4, 0.4, 0.5), (0.0, 0.0, 0.25))
PLANE = Workspace.from_array(np.zeros((20, 20), dtype=bool), 0.1)
HIGH = "floor is 0.6 m, so the robot reaches from 0.6 m to 1.1 m; the workspace has only heights"


def build_on(workspace=SCENE, robot=CRATE, **options):
    """Build a map on a floor, whose scene is empty."""
    return cspace.build(workspace, robot, **{"floor": 0.0, **options})


def build_high():
    """Build a map of a robot that sticks out of its scene."""
    return build_on(floor=0.8, outside="free")


@refusals(
    "call, message",
    (lambda: build_on(PLANE, Robot.disc(0.2)), "floor is given for a plane workspace"),
    (lambda: build_on(robot=Robot.disc(0.2)), "robot has 2 dimensions but the workspace has 3"),
    (lambda: build_on(floor=math.nan), "floor"),
    (lambda: build_on(floor=0.6), HIGH),
    (lambda: build_on(floor=-0.1), "reaches from -0.1 m to 0.4 m"),
    (
        lambda: build_on(rotations=cspace.Rotations.quaternions(2)),
        "rotations are those of space ... floor",
    ),
    (lambda: build_on(store="tiles"), "store is given with a floor"),
    # What knows no heights.
    (lambda: build_on().update(PLANE), "is a workspace of"),
    (lambda: build_on().update(np.ones((2, 2), bool), (0, 0)), "lower is [0, 0] ... 3 integers"),
    (
        lambda: build_high().add_obstacle("zone", shapely.box(0, 0, 1, 1)),
        "shape is in the plane, and the robot reaches from 0.8 m to 1.3 m ... heights",
    ),
)
def test_bad_floors_and_what_knows_no_heights_are_refused(call, message):
    check_refused(call, message)


def test_a_map_is_the_same_in_any_unit():
    # Shadows of far corners round by more than a micrometre.
    states = []
    for unit in (1.0, 1e10):
        cone = trimesh.creation.cone(unit, 2.0 * unit).apply_translation((0.0, 0.0, -unit))
        occupied = np.zeros((12, 12, 6), dtype=bool)
        occupied[6, 6] = True
        workspace = Workspace.from_array(occupied, 0.5 * unit)
        space = cspace.build(workspace, Robot.from_mesh(cone), floor=1.6 * unit, rotations=8)
        rows = np.random.default_rng(0).uniform(1.0, 5.0, (1000, 3))
        states.append(space.classify(rows * (unit, unit, 1.0)))
    assert (states[0] == BLOCKED).any() and (states[0] == states[1]).all()


def test_a_robot_may_stick_out_of_a_free_outside():
    space = build_high()
    assert space.is_free((1.0, 1.0)) and space.exact.is_free((1.0, 1.0))


def test_drives_pictures_and_messages_take_a_floor():
    cells = np.zeros((40, 30, 10), dtype=bool)
    cells[18:22, :, 6:] = True  # a beam across the hall
    space = cspace.build(Workspace.from_array(cells, 0.1), CRATE, rotations=16, floor=0.0)
    start, goal = (0.55, 1.45, 0.0), (3.45, 1.45, 0.0)
    plan = planners.plan(space, start, goal, drive=planners.Differential(), seed=1)
    assert plan.certified and plan.recheck().all()
    assert cspace.Gate(space, dt=0.5).check_twists(start, [(0.5, 0.2)] * 2).chunk.proven == 2
    assert space.drawn_workspace.grid == space.grid and not space.drawn_workspace.outer.any()
    assert space.drawn_robot.dim == 2 and space.floor == space.facts["floor_m"] == 0.0
    assert space.plot(path=plan.path) is not None
    assert (np.array(space.to_costmap().data) < 254).all()
    beam = cspace.build(Workspace.from_array(cells, 0.1), CRATE, rotations=16, floor=0.3)
    assert beam.drawn_workspace.outer[20].all() and beam.is_disconnected(start, goal)


def test_a_map_on_a_floor_is_asked_by_the_code_of_the_plane():
    """Arrays of another order, or that are not read-only, would compile everything again."""
    cells = np.zeros((30, 20, 6), dtype=bool)
    cells[14:16, :8] = True
    box = Robot.box((0.5, 0.3, 0.4), (0.0, 0.0, 0.2))
    plane = Workspace.from_array(cells[:, :, 0], 0.1), box.footprint(), None
    rows = np.random.default_rng(0).uniform((0.0, 0.0, -3.0), (3.0, 2.0, 3.0), (2, 500, 3))
    for workspace, robot, floor in (plane, (Workspace.from_array(cells, 0.1), box, 0.0)):
        space = cspace.build(workspace, robot, rotations=6, floor=floor)
        space.classify(rows[0])
        space.overlap_count(rows[0])
        space.exact.motion_is_free(*rows)
    for kernel in (classify_blocks, edges_are_free, count_overlaps):
        # Maps without rotations, with a yaw, and with all rotations differ in type.
        kinds = [re.findall(r"RotationTable\(array\(\w+, .d", str(key)) for key in kernel.overloads]
        assert 1 <= len(kinds) == len(set(map(tuple, kinds)))
