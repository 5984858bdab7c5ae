"""Explanations against doors of known width, and against searches of their own."""

import itertools
import math
import pickle
import re
import threading
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import shapely
import shapely.affinity
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

import cspace
import planners
from cspace import FREE
from cspace.reasons._margins import grow_cells
from tests.helpers.commands import document
from tests.helpers.handmade import build_empty, components
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.slits import build_slit, draw_only_exact
from tests.helpers.strategies import examples, few, seeds

SIDE = 4.0


def build_door(width, robot, spacing, rotations=None, **options):
    """Build the map of a room that a wall at x = 2 divides, with a door in the middle."""
    low, high = SIDE / 2.0 - width / 2.0, SIDE / 2.0 + width / 2.0
    walls = [shapely.box(1.85, -1.0, 2.15, low), shapely.box(1.85, high, 2.15, SIDE + 1.0)]
    workspace = cspace.Workspace.from_polygons(walls, spacing, (0.0, 0.0, SIDE, SIDE))
    return cspace.build(workspace, robot, rotations=rotations, **options)


def joins(space, cells, start, goal):
    """Return whether FREE cells and some other cells join two configurations, by scipy."""
    is_open = space.cell_states.reshape(-1, *space.grid.shape) == FREE
    is_open[tuple(cells.T)] = True
    labels = components(is_open, "")
    first, last = (
        labels[(space.rotations._find_cells(q), *space.grid.cell_of(q[: space.dim]))]
        for q in np.array([start, goal])
    )
    return bool(first == last >= 0)


@examples(30)
@given(
    width=st.floats(0.25, 1.4),
    radius=st.floats(0.08, 0.6),
    spacing=st.sampled_from([0.05, 0.08, 0.1]),
    margin=st.sampled_from([0.0, 0.07]),
)
def test_the_margin_of_a_disc_in_a_door_is_between_its_bounds(width, radius, spacing, margin):
    space = build_door(width, cspace.Robot.disc(radius), spacing, margin=margin)
    explanation = space.explain((0.8, 2.0), (3.2, 2.0))
    low, high = explanation.margin
    assert low <= width / 2.0 - radius <= high
    if explanation.verdict == "disconnected":
        assert high <= 0.0
    if explanation.verdict == "connected":
        assert low >= margin
        assert not len(explanation.barrier)


def test_the_margin_holds_at_all_yaws_of_coarse_cells():
    # Offsets of the inner raster lie less deep in the robot at other yaws of their cell.
    walls = [shapely.box(3.8, -1.0, 4.2, 3.85), shapely.box(3.8, 4.15, 4.2, 9.0)]
    workspace = cspace.Workspace.from_polygons(walls, 0.05, (0.0, 0.0, 8.0, 8.0))
    space = cspace.build(workspace, cspace.Robot.rectangle(0.8, 1.4), rotations=6)
    explanation = space.explain((2.0, 4.0, 0.0), (6.0, 4.0, 0.0))
    assert explanation.verdict == "disconnected"
    assert (0.3 - 0.8) / 2.0 <= explanation.margin[1] < 0.0


@examples(20)
@given(seed=seeds, rotations=st.sampled_from([None, 8]))
def test_the_cells_of_a_barrier_would_join_start_and_goal(seed, rotations):
    rng = np.random.default_rng(seed)
    occupied = rng.random((24, 20)) < 0.06
    space = cspace.build(
        cspace.Workspace.from_array(occupied, 0.1),
        cspace.Robot.rectangle(0.3, 0.12),
        rotations=rotations,
    )
    angles = () if rotations is None else (float(rng.uniform(-3.0, 3.0)),)
    ends = [(*rng.uniform((0.0, 0.0), (2.4, 2.0)).tolist(), *angles) for _ in range(2)]
    explanation = space.explain(*ends)
    assert joins(space, explanation.barrier, *ends)
    if len(explanation.barrier):
        assert not joins(space, explanation.barrier[:0], *ends)
    centers = space.grid.center_of(explanation.barrier[:, 1:])
    for cell, center in zip(explanation.barrier, centers, strict=True):
        q = np.concatenate([center, space.rotations.centers[cell[0]]])
        assert not space.is_free(q)
    low, high = explanation.margin
    assert low <= high
    assert (explanation.verdict == "connected") == bool(space.is_connected(*ends))
    if explanation.verdict == "disconnected":
        assert space.is_disconnected(*ends)


@pytest.mark.parametrize("rotations, angles", [(None, ()), (8, (0.4,))])
def test_a_way_passes_a_wall_by_as_few_cells_as_possible(rotations, angles):
    occupied = np.zeros((40, 30), dtype=bool)
    occupied[20] = True
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.5, 0.3), rotations=rotations)
    explanation = space.explain((0.8, 0.8, *angles), (3.2, 2.2, *angles))
    rows = (space.cell_states != FREE).reshape(-1, 40, 30)[:, 10:30, 15].sum(axis=1)
    assert len(explanation.barrier) == rows.min()


def test_windows_decide_a_door_that_the_map_leaves_undecided():
    for width, decided in ((0.5, "open"), (0.34, "shut")):
        space = build_door(width, cspace.Robot.disc(0.19), 0.1)
        ends = (0.8, 2.0), (3.2, 2.0)
        explanation = space.explain(*ends, refine=True)
        assert explanation.verdict == "undecided"
        assert explanation.trial.decided == decided
        finer = build_door(width, cspace.Robot.disc(0.19), explanation.trial.spacing)
        assert finer.is_connected(*ends) == (decided == "open")
        assert finer.is_disconnected(*ends) == (decided == "shut")
        assert space.explain(*ends).trial.decided == "untried"


def test_an_explanation_names_the_obstacle_in_the_door():
    space = build_door(1.2, cspace.Robot.disc(0.3), 0.05)
    space.add_obstacle("crate", shapely.box(1.8, 1.4, 2.2, 2.6))
    space.add_obstacle("plant", shapely.box(0.1, 3.5, 0.4, 3.9))
    explanation = space.explain((0.8, 2.0), (3.2, 2.0))
    assert "'crate'" in explanation.obstacles
    assert "'plant'" not in explanation.obstacles
    assert explanation.passes_without == ("crate",)
    assert "The robot passes without 'crate'." in str(explanation)
    assert abs(explanation.bottleneck[0] - 2.0) < 0.5
    assert str(explanation).startswith("No path: at (")
    assert len(explanation.sentences) <= 3


def test_a_start_in_an_obstacle_is_named():
    space = build_door(1.2, cspace.Robot.disc(0.3), 0.05)
    explanation = space.explain((2.0, 0.5), (3.2, 2.0))
    assert explanation.verdict == "start BLOCKED"
    assert str(explanation).startswith("The start lies in a BLOCKED cell: the robot touches")
    assert space.explain((0.8, 2.0), (2.0, 0.5)).verdict == "goal BLOCKED"
    assert cspace.reasons._explain.BORDER in space.explain((0.1, 2.0), (0.8, 2.0)).obstacles


def test_free_yaws_contain_the_yaws_that_are_free():
    space = build_door(0.6, cspace.Robot.rectangle(1.2, 0.3), 0.05, 36)
    explanation = space.explain((2.0, 2.0, 0.0), (3.0, 2.0, 0.0))
    (start_yaws, goal_yaws) = explanation.free_yaws
    assert goal_yaws.tolist() == [[-math.pi, math.pi]]
    for yaw in np.linspace(-3.1, 3.1, 401):
        listed = any(
            low <= yaw + turn <= high for low, high in start_yaws for turn in (0.0, 2.0 * math.pi)
        )
        if listed != bool(space.is_free((2.0, 2.0, float(yaw)))):
            assert np.abs(start_yaws - yaw).min() < 1e-6


def test_a_robot_that_cannot_turn_would_pass_if_it_could():
    crossing = np.ones((70, 70), dtype=bool)
    crossing[32:39] = crossing[:, 32:39] = False
    space = cspace.build(
        cspace.Workspace.from_array(crossing, 0.1), cspace.Robot.rectangle(2.5, 0.3), rotations=36
    )
    explanation = space.explain((1.5, 3.55, 0.0), (3.55, 5.5, math.pi / 2.0))
    assert explanation.verdict in ("disconnected", "undecided")
    assert explanation.passes_if_turning
    assert "The robot would pass if it could turn anywhere." in explanation.sentences


def test_equal_start_and_goal_and_empty_workspaces_are_explained():
    space = build_empty((20, 20), cspace.Robot.disc(0.2))
    explanation = space.explain((1.0, 1.0), (1.0, 1.0))
    assert explanation.verdict == "connected"
    assert str(explanation).startswith("A path exists")
    free_outside = cspace.build(space.workspace, space.robot, outside="free")
    assert free_outside.explain((1.0, 1.0), (0.5, 1.5)).margin[1] == math.inf


@pytest.mark.parametrize(
    "changes, sentence",
    [
        ({"margin": (0.0, 0.3)}, "The robot may grow by 0 m all around, but not by 0.3 m."),
        ({"margin": (0.1, math.inf)}, "The robot may grow by 0.1 m all around."),
        ({"margin": (-0.2, -0.1)}, "passes if it shrinks by 0.2 m all around, but not by 0.1 m."),
        ({"margin": (-0.2, 0.0)}, "The robot passes if it shrinks by 0.2 m all around."),
        ({"margin": (-math.inf, 0.1)}, "No shrinking of the robot is known to give a path."),
        ({"obstacles": ()}, "the robot does not pass an obstacle."),
        ({"obstacles": ("a", "b")}, "the robot does not pass a and b."),
        ({"obstacles": tuple("abcd")}, "the robot does not pass a, b, c and others."),
    ],
)
def test_sentences_say_what_the_fields_hold(changes, sentence):
    space = build_door(0.4, cspace.Robot.disc(0.3), 0.05)
    explanation = replace(space.explain((0.8, 2.0), (3.2, 2.0)), **changes)
    assert any(each.endswith(sentence) for each in explanation.sentences)
    assert "turn anywhere" not in str(replace(explanation, passes_if_turning=True))


def test_a_plan_without_a_path_prints_the_reason():
    space = build_door(0.4, cspace.Robot.disc(0.3), 0.05)
    plan = planners.plan(space, (0.8, 2.0), (3.2, 2.0))
    assert plan.explain().sentences[0] in repr(plan)
    assert plan.explain().verdict == "disconnected"


def test_the_command_explains_and_draws(tmp_path):
    space = build_door(0.1, cspace.Robot.disc(0.3), 0.1)
    space.save(tmp_path / "door.zarr")
    picture = tmp_path / "why.png"
    explained = document(
        f"explain {tmp_path / 'door.zarr'} --start 0.8,2 --goal 3.2,2", "--picture", picture
    )
    assert explained["verdict"] == "disconnected"
    assert explained["reason"].startswith("No path")
    assert picture.stat().st_size > 0


def test_windows_of_tiled_maps_know_nothing_of_obstacles_beyond(tmp_path):
    # A wall just beyond the window shuts the corridor that the window sees half of.
    occupied = np.zeros((200, 60), dtype=bool)
    occupied[100:104, :28] = occupied[100:104, 31:] = True
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    robot = cspace.Robot.disc(0.45)
    tiled = cspace.build(workspace, robot, store=tmp_path / "map", tile=48)
    ends = (8.0, 2.95), (12.4, 2.95)
    whole = cspace.build(workspace, robot).explain(*ends)
    part = tiled.window((7.0, 2.0), (13.0, 4.0))
    assert part.outside == "unknown"
    explanation = part.explain(*ends)
    assert explanation.margin[0] <= whole.margin[1]
    narrow = tiled.window((7.0, 0.0), (9.0, 6.0))
    side = float(narrow.grid.upper[0]) - 0.05
    start, goal = (7.5, 0.1), (side, 0.1)
    low = narrow.explain(start, goal).margin[0]
    # Proven of the window: a path of the robot that shrinks so is also one of the whole map.
    assert low <= cspace.build(workspace, robot).explain(start, goal).margin[1]


@given(seeds, st.sampled_from([None, 8]))
@examples(6)
def test_windows_explain_each_pair_of_their_free_samples(tmp_path_factory, seed, rotations):
    rng = np.random.default_rng(seed)
    workspace = cspace.Workspace.from_array(rng.random((60, 60)) < 0.02, 0.1)
    robot = cspace.Robot.rectangle(0.7, 0.3)
    folder = tmp_path_factory.mktemp("tiles") / "map"
    tiled = cspace.build(workspace, robot, store=folder, tile=32, rotations=rotations)
    window = tiled.window((1.0, 1.0), (4.5, 4.0))
    whole = cspace.build(workspace, robot, rotations=rotations)
    for start, goal in window.sample_free(10, rng).reshape(5, 2, -1):
        low, high = window.explain(start, goal).margin
        assert (low >= 0.0) == window.is_connected(start, goal)
        assert low <= whole.explain(start, goal).margin[1]
        assert (high <= 0.0) == window.is_disconnected(start, goal)


def test_cells_that_may_be_empty_prove_no_way_shut():
    occupied = np.zeros((40, 40), dtype=bool)
    occupied[18:22] = True
    occupied[18:22, 18:22] = False
    workspace = cspace.Workspace.from_array(occupied, 0.1, inner=np.zeros_like(occupied))
    space = cspace.build(workspace, cspace.Robot.disc(0.22))
    explanation = space.explain((0.8, 2.0), (3.2, 2.0), refine=True)
    assert explanation.verdict == "undecided"
    assert explanation.trial.decided == "nothing"


def test_filled_meshes_are_explained():
    occupied = np.ones((20, 20, 20), dtype=bool)
    occupied[:9] = occupied[11:] = False
    occupied[9:11, 8:12, 8:12] = False
    box = trimesh.creation.box((0.6, 0.6, 0.6))
    robot = cspace.Robot.from_mesh(box, solid="fill")
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), robot)
    explanation = space.explain((0.4, 1.0, 1.0), (1.6, 1.0, 1.0))
    assert explanation.verdict != "connected"
    assert explanation.margin[1] >= 0.0


def test_margins_of_many_cells_are_true_between_two_corners():
    corners = shapely.box(0, 0, 4, 4), shapely.box(8, 8, 12, 12)
    workspace = cspace.Workspace.from_polygons(corners, 0.1, bounds=(0, 0, 12, 12))
    space = cspace.build(workspace, cspace.Robot.disc(0.1))
    low, high = space.explain((4, 8), (8, 4)).margin
    # The corners are 4 m apart along both axes.
    assert low <= math.sqrt(8.0) - 0.1 <= high <= low + 0.7


@examples(40)
@given(seeds, st.sampled_from([0.0, 0.5, 1.0, math.sqrt(2.0), 2.0, 2.7]), st.booleans())
def test_grown_cells_hold_and_lie_in_the_grown_region(seed, distance, outside):
    cells = np.random.default_rng(seed).random((7, 6)) < 0.06
    boxes = [shapely.box(x, y, x + 1, y + 1) for x, y in np.argwhere(cells).tolist()]
    if outside:
        boxes.append(shapely.box(-9, -9, 16, 15) - shapely.box(0, 0, 7, 6))
    region = shapely.union_all(boxes)
    outer, inner = (
        grow_cells(cells, distance, outside, 2, outwards=each) for each in (True, False)
    )
    inside = np.linspace(0.0, 1.0, 6)
    for x, y in np.ndindex(cells.shape):
        gap = shapely.distance(shapely.box(x, y, x + 1, y + 1), region)
        assert outer[x, y] == (gap <= distance + 1e-9)  # NaN, without any cell, is never near
        points = shapely.points(*np.meshgrid(x + inside, y + inside))
        assert not inner[x, y] or (shapely.distance(points, region) <= distance + 1e-9).all()
    assert inner[cells].all()


@pytest.mark.parametrize("spacing", few([0.05, 0.02]))
def test_refining_narrows_margins(spacing):
    space = build_door(0.55, cspace.Robot.disc(0.3), spacing)
    coarse, fine = (
        space.explain((0.8, 2.0), (3.2, 2.0), refine=refine) for refine in (False, True)
    )
    assert coarse.margin[0] < fine.margin[0] <= -0.025 <= fine.margin[1] <= coarse.margin[1]
    assert np.ptp(fine.margin) < 0.4 * np.ptp(coarse.margin)


@pytest.mark.parametrize("growth", [0.0, 1.7])
def test_margins_hold_for_boxes_in_space(growth):
    # A square window of 0.8 m in a wall; margins far above a cell grow the obstacles too.
    occupied = np.zeros((40, 40, 40), dtype=bool)
    occupied[19:21] = True
    half = 4 + round(growth * 4)
    occupied[19:21, 20 - half : 20 + half, 20 - half : 20 + half] = False
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.box((0.3,) * 3))
    low, high = space.explain((0.9, 2.0, 2.0), (3.1, 2.0, 2.0)).margin
    true = min(0.1 * half - 0.15, 0.9 - 0.15)
    assert low <= true <= high <= low + 0.25


def test_no_path_is_promised_to_a_robot_that_vanishes():
    for robot, rotations in (
        (cspace.Robot.rectangle(0.4, 0.1), 12),
        (cspace.Robot.disc(0.05), None),
    ):
        space = build_door(0.02, robot, 0.05, rotations)
        turn = () if rotations is None else (0.0,)
        explanation = space.explain((0.8, 2.0, *turn), (3.2, 2.0, *turn))
        assert explanation.margin[0] == -math.inf
        assert "passes if" not in str(explanation)


def test_only_obstacles_that_touch_a_blocked_start_are_named():
    space = build_door(0.4, cspace.Robot.disc(0.3), 0.05)
    shapes = {
        "crate": shapely.box(0.3, 0.3, 0.9, 0.9),
        "far": shapely.box(2.6, 0.2, 3.6, 1.0),
        "near": shapely.box(0.95, 0.5, 1.1, 0.7),
    }
    for name, shape in shapes.items():
        space.add_obstacle(name, shape)
    robot = shapely.Point(0.6, 0.6).buffer(0.3)
    explanation = space.explain((0.6, 0.6), (3.2, 2.0))
    assert explanation.verdict == "start BLOCKED"
    assert explanation.obstacles == ("'crate'",)
    assert robot.intersects(shapes["crate"]) and not robot.intersects(shapes["near"])
    assert "'crate'" in space.explain((3.2, 2.0), (0.6, 0.6)).obstacles


def test_the_near_wall_of_a_mixed_start_is_named():
    space = build_door(0.4, cspace.Robot.disc(0.3), 0.05)
    start = (1.52, 3.2)
    explanation = space.explain(start, (3.2, 2.0))
    assert explanation.verdict == "start MIXED"
    (named,) = explanation.obstacles
    place = [float(number) for number in re.findall(r"-?\d+\.\d+", named)]
    assert math.dist(place, start) < 0.3 + 3 * 0.05
    beside_border = space.explain((0.31, 2.0), (3.2, 2.0))
    assert beside_border.verdict == "start MIXED"
    assert beside_border.obstacles == (cspace.reasons._explain.BORDER,)


@pytest.mark.parametrize("count", few([8, 25]))
def test_updates_of_another_thread_change_no_explanation(count):
    space = build_door(0.4, cspace.Robot.disc(0.3), 0.05)
    is_done = threading.Event()

    def move():
        for step in itertools.count():
            if is_done.is_set():
                return
            x = 0.3 + 0.1 * (step % 25)
            space.add_obstacle(f"cart {step % 3}", shapely.box(x, 0.2, x + 0.3, 0.6))
            space.remove_obstacle(f"cart {step % 3}")

    mover = threading.Thread(target=move)
    mover.start()
    try:
        for _ in range(count):
            explanation = space.explain((0.8, 2.0), (3.2, 2.0))
            assert explanation.verdict == "disconnected"
            assert explanation.space.is_disconnected((0.8, 2.0), (3.2, 2.0))
            space.removals((0.8, 2.0), (3.2, 2.0))
    finally:
        is_done.set()
        mover.join()


def test_plans_of_drives_say_that_a_path_is_for_robots_that_move_sideways():
    space = build_door(1.2, cspace.Robot.rectangle(0.4, 0.3), 0.1, rotations=24)
    ends = (0.8, 2.0, 0.0), (3.2, 2.0, 0.0)
    plan = planners.plan(space, *ends, drive=planners.Car(turning_radius=0.4))
    words = "for a robot that also moves sideways"
    assert str(plan.explain()).startswith(f"A path exists {words}")
    assert words not in str(space.explain(*ends))
    assert words not in str(planners.plan(space, *ends).explain())


@pytest.mark.parametrize("spatial", [False, True], ids=["plane", "space"])
def test_the_picture_names_what_is_red_and_shows_its_title(spatial):
    space = build_door(0.4, cspace.Robot.disc(0.3), 0.1)
    ends = (0.8, 2.0), (3.2, 2.0)
    if spatial:
        occupied = np.zeros((20, 20, 20), dtype=bool)
        occupied[9:11] = True
        workspace = cspace.Workspace.from_array(occupied, 0.2)
        space = cspace.build(workspace, cspace.Robot.box((0.4,) * 3))
        ends = (0.8, 2.0, 2.0), (3.2, 2.0, 2.0)
    explanation = space.explain(*ends)
    figure = explanation.plot().figure
    figure.canvas.draw()
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert {"cells in the way", "narrowest place", "start", "goal"} <= set(labels)
    assert "path" not in labels
    (title,) = (
        text for text in figure.texts if text.get_text()[:7] == explanation.sentences[0][:7]
    )
    box = title.get_window_extent()
    assert box.x0 >= 0.0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1


@pytest.mark.parametrize("corner", [(0.0, 0.0), (0.5, 0.4), (-1.4, 0.3)])
def test_a_reference_point_outside_the_robot_is_named_and_moving_it_decides(corner):
    """A wall from border to border, in a map around which an eccentric robot may reach."""
    wall = shapely.box(1.8, -1.0, 2.2, SIDE + 1.0)
    workspace = cspace.Workspace.from_polygons([wall], 0.1, (0.0, 0.0, SIDE, SIDE))
    size = np.array([0.8, 0.6])
    middle = np.array(corner) + size / 2.0
    ends = np.array([(0.8, 2.0), (3.2, 2.0)])  # of the robot's middle
    robot = cspace.Robot.rectangle(*size, center=middle)
    start, goal = ends - middle
    # Widen the map, so that both ends are in it.
    wide = cspace.Workspace.from_polygons([wall], 0.1, (-2.0, 0.0, SIDE + 1.0, SIDE))
    eccentric = cspace.build(wide, robot)
    assert eccentric.classify([start, goal]).tolist() == [FREE, FREE]
    assert not eccentric.is_disconnected(start, goal)
    sentence = "move its shape so that the origin is in its middle"
    assert sentence in str(eccentric.explain(start, goal))
    moved = cspace.build(workspace, cspace.Robot.rectangle(*size))
    assert moved.is_disconnected(*ends)
    assert sentence not in str(moved.explain(*ends))


def test_a_way_outside_is_not_named_if_the_outside_is_free_or_the_robot_is_central():
    sentence = "outside the map"
    undecided = build_door(0.6, cspace.Robot.disc(0.29), 0.1).explain((0.8, 2.0), (3.2, 2.0))
    assert undecided.verdict == "undecided" and sentence not in str(undecided)
    robot = cspace.Robot.disc(0.29, center=(0.5, 0.0))
    free = build_door(0.6, robot, 0.1, outside="free").explain((0.3, 2.0), (2.7, 2.0))
    assert sentence not in str(free)


# ---- obstacles without an inside -----------------------------------------------------------------

LINE = shapely.LineString([(2.0, -1.0), (2.1, SIDE + 1.0)])
POSTS = shapely.MultiPoint([(2.03, y) for y in np.arange(0.0, SIDE, 0.09)])
HOUSE = shapely.box(1.5, 0.0, 2.5, 1.0)
DOOR = shapely.difference(LINE, shapely.box(0.0, 1.8, SIDE, 2.2))

FENCES = {
    "line": [LINE],
    "posts": [POSTS],
    "ring": [shapely.box(1.2, -1.0, 2.8, SIDE + 1.0).exterior],
    "house": [HOUSE, LINE],
    "sliver": [LINE.buffer(1e-4)],
    "door": [DOOR],
}
"""Fences across a room, of which one has a door narrower than the robot."""


def build_fence(polygons, spacing):
    """Build the map of a disc in a room that a fence divides."""
    workspace = cspace.Workspace.from_polygons(polygons, spacing, (0.0, 0.0, SIDE, SIDE))
    return cspace.build(workspace, cspace.Robot.disc(0.3))


@refusals(
    "start, message",
    ((9.0, 9.0), "in the grid"),
    ((math.nan, 0.0), "nan"),
    ([(1.0, 1.0), (2.0, 2.0)], "one configuration"),
)
def test_explain_refuses_what_is_no_start(start, message):
    space = build_door(0.4, cspace.Robot.disc(0.3), 0.1)
    check_refused(lambda: space.explain(start, (0.8, 2.0)), message)


@pytest.mark.parametrize("name", few(FENCES, 2))
def test_a_fence_without_an_inside_is_to_be_thickened(name):
    ends = (0.6, 2.0), (3.4, 2.0)
    explanation = build_fence(FENCES[name], 0.1).explain(*ends)
    (growth,) = map(
        float, re.findall(r"thicken the obstacle there: buffer\((.*?)\)", str(explanation))
    )
    assert growth == explanation.thickening == 0.2
    # A finer map decides nothing, and a thicker fence is proven.
    finer = build_fence(FENCES[name], explanation.trial.spacing)
    assert not finer.is_connected(*ends) and not finer.is_disconnected(*ends)
    thick = build_fence(shapely.buffer(FENCES[name], growth), 0.1)
    assert thick.is_disconnected(*ends) and thick.explain(*ends).thickening == 0.0
    wall = build_fence([LINE.buffer(0.02)], 0.1).explain(*ends)
    assert wall.verdict == "undecided" and "thicken" not in str(wall)


@pytest.mark.parametrize("polygon", few([LINE.buffer(0.02), LINE]))
def test_cells_far_from_the_origin_are_not_refined(polygon):
    far = shapely.affinity.translate(polygon, 4e5)
    workspace = cspace.Workspace.from_polygons([far], 0.1, (4e5, 0.0, 4e5 + SIDE, SIDE))
    space = cspace.build(workspace, cspace.Robot.disc(0.3))
    for refine in (False, True):
        explanation = space.explain((4e5 + 0.6, 2.0), (4e5 + 3.4, 2.0), refine=refine)
        assert explanation.verdict == "undecided"


@pytest.mark.parametrize("floor", [None, 0.0])
def test_an_open_mesh_in_the_way_is_to_be_thickened(floor):
    corners = [(1.5, -1.0, -1.0), (1.5, 4.0, -1.0), (1.5, 4.0, 4.0), (1.5, -1.0, 4.0)]
    sheet = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)])
    wall = trimesh.creation.box((0.8, 6.0, 6.0))
    wall.apply_translation((1.5, 1.5, 1.5))
    robot = cspace.Robot.box((0.5, 0.5, 0.5), center=(0.0, 0.0, 0.0 if floor is None else 0.25))
    ends = (0.6, 1.5, 1.5), (2.4, 1.5, 1.5)
    for mesh, is_thin in ((sheet, True), (wall, False)):
        workspace = cspace.Workspace.from_mesh(
            mesh, 0.2, bounds=(0.0, 0.0, 0.0, 3.0, 3.0, 3.0), solid="surface" if is_thin else "auto"
        )
        space = cspace.build(workspace, robot, floor=floor)
        explanation = space.explain(*(end[: space.dim] for end in ends))
        assert ("thicken the obstacle there: 0.4 m on all sides" in str(explanation)) == is_thin


# ---- joints --------------------------------------------------------------------------------------


def build_joint_maps(spacing, folder):
    """Build the map of two joints among posts, and open it from a file."""
    from tests.helpers.urdfs import CONTINUOUS, build_plane_arm

    made = cspace.build_joint_map(build_plane_arm(**CONTINUOUS), spacing)
    made.save(folder / "joints.zarr")
    return made, cspace.open(folder / "joints.zarr")


def find_widest(is_open, first, last):
    """Return the largest distance, in cells, that a chain of cells keeps from the others."""
    distances = ndimage.distance_transform_edt(np.pad(is_open, 1))[1:-1, 1:-1]
    for width in np.unique(distances)[::-1]:
        labels, _ = ndimage.label(distances >= width)
        if labels[first] == labels[last] != 0:
            return width
    return 0.0


def test_margins_of_joints_are_distances_in_the_joints(tmp_path):
    """They are told in radians, and lie between those of FREE cells and of unblocked ones."""
    maps = build_joint_maps(0.1, tmp_path)
    q = maps[0].sample_free(16, rng=np.random.default_rng(4))
    told = 0
    for start, goal in zip(q[::2], q[1::2], strict=True):
        first, last = explanations = [each.explain(start, goal) for each in maps]
        assert first.verdict == last.verdict and first.margin == last.margin
        assert not any(re.search(r"\d m\b", str(each)) for each in explanations)
        assert "keeps" not in str(replace(first, margin=(-0.1, 0.2)))
        if first.verdict != "connected":
            continue
        told += 1
        low, high = first.margin
        assert "rad from all cells that are not FREE" in str(first)
        states = maps[0].cell_states
        ends = [tuple(maps[0].grid.cell_of(each)) for each in (start, goal)]
        # A cell reaches 0.7 cells from its center; moves may be two cells long.
        assert low <= 0.1 * (find_widest(states == FREE, *ends) + 2.0)
        assert high >= 0.1 * (find_widest(states != cspace.BLOCKED, *ends) - 2.0)
    assert told


def test_a_way_around_the_seam_of_a_joint_is_not_denied(tmp_path):
    """The arm may pass pi, beyond which the map does not reach."""
    from tests.helpers.urdfs import POSTS, planar_arm_meets

    steps = np.linspace(-0.3, 0.3, 13)
    around = np.stack(np.meshgrid(math.pi + np.linspace(-0.5, 0.5, 21), steps), axis=-1)
    assert not planar_arm_meets(around.reshape(-1, 2), POSTS).any()
    for joint_map in build_joint_maps(0.1, tmp_path):
        explanation = joint_map.explain((math.pi - 0.2, 0.0), (-math.pi + 0.2, 0.0))
        assert explanation.verdict == "undecided" and explanation.margin[1] >= 0.3
        assert "spacing of 0.05 rad" in str(explanation)
        assert "move its shape" not in str(explanation)


def test_the_solids_in_the_way_of_joints_are_named(tmp_path):
    made, opened = build_joint_maps(0.1, tmp_path)
    start, goal = (0.0, 0.0), made.nearest_free((2.0, 1.0))
    assert str(made.explain(start, goal)).startswith(
        "The start lies in a BLOCKED cell: the robot touches 'upper' and 'post0'."
    )
    assert opened.explain(start, goal).obstacles[0].startswith("the cells at (0.0")
    check_refused(
        lambda: made.explain(start, goal, refine=True),
        "refine is True for a map of joints ... finer",
    )


@pytest.mark.parametrize("count", few([2, 20]))
def test_the_exact_map_is_explained_by_whole_cells(count):
    space = build_slit()
    start, goal = (0.5, 1.2, 0.0), (1.9, 1.2, 0.0)
    only_exact = draw_only_exact(space)
    exact = pickle.loads(pickle.dumps(space.exact))
    for view, row in product((space.exact, exact), only_exact[:count]):
        assert view.explain(row, goal).verdict == "start MIXED"
    assert exact.explain(start, goal).verdict == space.explain(start, goal).verdict


# ---- robots on a floor ---------------------------------------------------------------------------


def stand(low, high):
    """Return a box from its lower to its upper corner."""
    low, high = np.array(low), np.array(high)
    return cspace.Robot.box(high - low, (low + high) / 2.0).shape


def build_gate(low_width, high_width, spacing, **options):
    """Build the map of a hall with a door for the base, one for the mast, and a beam above."""
    walls = [stand((1.85, -1.0, 1.0), (2.15, SIDE + 1.0, 1.2))]
    for width, bottom, top in ((low_width, -0.5, 0.3), (high_width, 0.55, 0.9)):
        walls.append(stand((1.85, -1.0, bottom), (2.15, (SIDE - width) / 2.0, top)))
        walls.append(stand((1.85, (SIDE + width) / 2.0, bottom), (2.15, SIDE + 1.0, top)))
    bounds = (0.0, 0.0, 0.0, SIDE, SIDE, 1.2)
    workspace = cspace.Workspace.from_shapes(walls, spacing, bounds)
    base = trimesh.creation.box((0.4, 0.6, 0.4))
    mast = trimesh.creation.box((0.1, 0.2, 0.5))
    mast.apply_translation((0.0, 0.0, 0.4))
    robot = cspace.Robot.from_mesh(trimesh.util.concatenate([base, mast]))
    return cspace.build(workspace, robot, floor=0.2, **options)


@examples(12)
@given(
    low_width=st.floats(0.15, 1.4),
    high_width=st.floats(0.06, 1.2),
    spacing=st.sampled_from([0.05, 0.08]),
    margin=st.sampled_from([0.0, 0.07]),
)
def test_margins_on_a_floor_are_those_of_each_height(low_width, high_width, spacing, margin):
    space = build_gate(low_width, high_width, spacing, margin=margin)
    explanation = space.explain((0.8, 2.0), (3.2, 2.0))
    low, high = explanation.margin
    true = min(low_width / 2.0 - 0.3, high_width / 2.0 - 0.1)
    assert low <= true <= high
    if true > 2.0 * spacing + margin:
        assert true - 2.2 * spacing < low and high < true + 2.2 * spacing
        assert "sideways" in str(explanation)
    else:
        assert low == -math.inf or true - 3.0 * spacing < low
    assert joins(space, explanation.barrier, (0.8, 2.0), (3.2, 2.0))


def test_robots_on_a_floor_grow_and_shrink_sideways_alone():
    """A flat robot shrinks by more than its height, and one below a ceiling grows far."""
    occupied = np.zeros((100, 100, 8), dtype=bool)
    occupied[:, :, 6:] = True
    occupied[49:51] = True
    for half, height, side in ((2, 0.06, 0.8), (25, 0.26, 0.4)):
        occupied[49:51, 50 - half : 50 + half, :6] = False
        robot = cspace.Robot.box((side, side, height), (0.0, 0.0, 0.17))
        space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), robot, floor=0.1)
        low, high = space.explain((2.5, 5.0), (7.5, 5.0)).margin
        true = 0.1 * half - side / 2.0
        assert low <= true <= high and true - low < 0.25


def test_obstacles_on_a_floor_are_named_with_their_height():
    space = build_gate(1.2, 0.04, 0.07)
    explanation = space.explain((0.8, 2.0), (3.2, 2.0))
    assert explanation.verdict == "disconnected"
    heights = [float(re.findall(r"-?\d+\.\d+", text)[2]) for text in explanation.obstacles]
    assert heights and all(0.5 <= height <= 0.9 for height in heights)
    assert explanation.plot() is not None
    open_gate = build_gate(1.2, 0.9, 0.07)
    for name, bottom in (("lamp", 0.95), ("crate", 0.0)):
        box = trimesh.creation.box(bounds=[(1.8, 0.1, bottom), (2.2, 3.9, bottom + 0.2)])
        open_gate.add_obstacle(name, box)
    named = open_gate.explain((0.8, 2.0), (3.2, 2.0))
    assert "'crate'" in named.obstacles and "'lamp'" not in named.obstacles
    assert named.passes_without == ("crate",)
    blocked = open_gate.explain((2.0, 2.0), (3.2, 2.0))
    assert blocked.verdict == "start BLOCKED" and blocked.obstacles == ("'crate'",)


@pytest.mark.parametrize(
    "width, spacing, decided", few([(0.15, 0.1, "shut"), (0.31, 0.08, "open")])
)
def test_finer_maps_decide_on_a_floor(width, spacing, decided):
    space = build_gate(1.2, width, spacing)
    explanation = space.explain((0.8, 2.0), (3.2, 2.0), refine=True)
    assert explanation.verdict == "undecided"
    assert explanation.trial.decided == decided
    finer = build_gate(1.2, width, explanation.trial.spacing)
    assert finer.is_connected((0.8, 2.0), (3.2, 2.0)) == (decided == "open")
