"""The map against its definition on tiny grids, against shapely and pyclipper, and under the laws it must obey."""

import math

import numpy as np
import pyclipper
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import cspace
import oracles
from checks import collides, draw_configurations
from cspace import BLOCKED, FREE, MIXED, InputError, Robot, Workspace
from strategies import bitmaps, robots, seeds, stars


def by_definition(workspace, robot, outside):
    """States of all cells from overlaps summed one by one in pure Python."""
    outer, inner = (oracles.raster_offsets(raster) for raster in robot.rasters(workspace.grid.spacing))
    touches = oracles.overlap(workspace.outer, outer, outside)
    collisions = oracles.overlap(workspace.inner, inner, outside)
    return {k: BLOCKED if collisions[k] else MIXED if touches[k] else FREE for k in touches}


@settings(max_examples=30)
@given(bitmaps(9), robots(0.25), st.sampled_from(["blocked", "free"]), st.booleans())
def test_states_by_definition(occupied, robot, outside, overlap):
    workspace = Workspace.from_array(occupied, 0.15)
    space = cspace.build(workspace, robot, outside=outside, overlap=overlap)
    assert {k: space.state[k] for k in np.ndindex(space.state.shape)} == by_definition(
        workspace, robot, outside == "blocked"
    )
    without = cspace.build(workspace, robot, outside=outside, inner=False).state
    assert (without == np.minimum(space.state, MIXED)).all()
    if overlap:
        assert ((space.overlaps == 0) == (space.state == FREE)).all()


@settings(max_examples=15)
@given(stars(1.0), stars(1.5), st.sampled_from(["blocked", "free"]))
def test_polygon_obstacles_by_definition(vertices, obstacle, outside):
    workspace = Workspace.from_polygons(shapely.Polygon(obstacle), 0.5, bounds=(-2, -2, 2.5, 2))
    space = cspace.build(workspace, Robot.polygon(vertices), outside=outside)
    assert workspace.inner is not workspace.outer
    assert {k: space.state[k] for k in np.ndindex(space.state.shape)} == by_definition(
        workspace, Robot.polygon(vertices), outside == "blocked"
    )


@settings(max_examples=40)
@given(robots(0.5), seeds, st.sampled_from(["blocked", "free"]), st.sampled_from([0.0, 0.1]))
def test_no_false_answer_over_grid_maps(robot, seed, outside, margin):
    """Configurations inside cells and on their borders, against the geometry itself."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((30, 24)) < rng.choice([0.01, 0.05])
    space = cspace.build(Workspace.from_array(occupied, 0.1, (-1.0, 2.0)), robot, outside=outside, margin=margin)
    q = draw_configurations(space, rng, 600)
    states = space.classify(q)
    assert not (collides(space, q, margin - 1e-9) & (states == FREE)).any()
    assert not (~collides(space, q, 1e-9) & (states == BLOCKED)).any()


@settings(max_examples=30)
@given(robots(0.5), stars(1.0), stars(0.7), seeds)
def test_no_false_answer_over_polygons(robot, first, second, seed):
    rng = np.random.default_rng(seed)
    obstacles = [shapely.Polygon(first), shapely.Polygon(second + 0.8), shapely.LineString([(-1, 2), (2, 1.5)])]
    workspace = Workspace.from_polygons(obstacles, 0.13, bounds=(-3, -3, 3, 3))
    space = cspace.build(workspace, robot, outside="free")
    q = draw_configurations(space, rng, 600)
    states = space.classify(q)
    hit = collides(space, q, 0.0, obstacles)
    near = collides(space, q, 1e-9, obstacles)
    assert not (hit & (states == FREE) & ~(near & ~hit)).any()
    assert not (~near & (states == BLOCKED)).any()


@settings(max_examples=25)
@given(stars(0.5), stars(1.0))
def test_agrees_with_the_exact_minkowski_sum(robot, obstacle):
    """pyclipper adds the obstacle and the reflected robot in integers; FREE lies outside the sum, BLOCKED inside."""
    scale = 2**20
    space = cspace.build(
        Workspace.from_polygons(shapely.Polygon(obstacle), 0.11, bounds=(-4, -4, 4, 4)),
        Robot.polygon(robot),
        outside="free",
    )
    paths = [np.rint(part * scale).astype(int).tolist() for part in (-np.asarray(robot), np.asarray(obstacle))]
    pieces = [shapely.Polygon(np.divide(path, scale)) for path in pyclipper.MinkowskiSum(paths[0], paths[1], True)]
    # MinkowskiSum sweeps the border; the interiors join where one vertex of the robot covers the whole obstacle.
    whole = [shapely.Polygon(np.asarray(obstacle) - vertex) for vertex in np.asarray(robot)]
    exact = shapely.union_all([piece.buffer(0) for piece in pieces] + whole)
    exact = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(exact)])
    lower = np.stack(np.meshgrid(*map(np.arange, space.grid.shape), indexing="ij"), -1) * 0.11 + space.grid.lower
    cells = shapely.box(lower[..., 0], lower[..., 1], lower[..., 0] + 0.11, lower[..., 1] + 0.11)
    rounding = 4.0 / scale
    assert not shapely.intersects(cells[space.state == FREE], exact.buffer(-rounding)).any()
    assert shapely.covers(exact.buffer(rounding), cells[space.state == BLOCKED]).all()
    assert (space.state == BLOCKED).any() or not space.workspace.inner.any()  # a sliver holds no cell


@settings(max_examples=20)
@given(bitmaps(), bitmaps(), robots(0.3), st.tuples(st.integers(-3, 3), st.integers(-3, 3)))
def test_laws(first, second, robot, shift):
    """More obstacles or margin: never more FREE, never less BLOCKED. Union of obstacles: the worse of the maps."""
    shape = tuple(min(a, b) for a, b in zip(first.shape, second.shape, strict=True))
    first, second = (part[: shape[0], : shape[1]] for part in (first, second))

    def states(occupied, robot=robot, **options):
        return cspace.build(Workspace.from_array(occupied, 0.1), robot, outside="free", **options).state

    either = np.maximum(states(first), states(second))
    assert (states(first | second) == either).all()
    grown = states(first, margin=0.13)
    assert (grown >= states(first)).all()
    assert ((grown == BLOCKED) == (states(first) == BLOCKED)).all()
    # The map of a shifted workspace is the shifted map.
    wide = np.pad(first, 12)
    moved = np.roll(wide, shift, axis=(0, 1))
    window = (slice(4, -4),) * 2
    assert (np.roll(states(wide), shift, axis=(0, 1))[window] == states(moved)[window]).all()


@settings(max_examples=20)
@given(bitmaps(), st.floats(0.05, 0.4), st.integers(0, 3))
def test_quarter_turns_permute_the_map(occupied, radius, turns):
    offset = np.array([0.21, 0.08])
    turned = np.round([[0, -1], [1, 0]]) if turns % 2 else np.eye(2)
    turned = turned if turns < 2 else -turned
    before = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(radius, offset)).state
    # A turn maps cell k = [k, k + 1] to the cell on the other side of the axis, so the outer sets must correspond.
    after = cspace.build(
        Workspace.from_array(np.rot90(occupied, turns), 0.1), Robot.disc(radius, turned @ offset)
    ).state
    assert (np.rot90(before, turns) == after).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1)])
@pytest.mark.parametrize("fill", [0, 1])
@pytest.mark.parametrize("radius", [0.03, 0.3, 30.0])
@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_thin_empty_and_full_maps_and_giant_robots(shape, fill, radius, outside):
    workspace = Workspace.from_array(np.full(shape, bool(fill)), 0.1)
    space = cspace.build(workspace, Robot.disc(radius), outside=outside)
    if fill:
        assert (space.state == BLOCKED).all()
    elif outside == "free":
        assert (space.state == FREE).all()
    else:
        assert (space.state != FREE).all()  # nowhere does the robot fit within a map one cell wide
        assert (space.state == BLOCKED).any() == (radius > 0.1)


def test_the_example_of_a_wall():
    """A disc of radius 0.3 on cells of 0.1: FREE from four cells off the wall, BLOCKED up to two."""
    occupied = np.zeros((21, 3), dtype=bool)
    occupied[10] = True
    row = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.29), outside="free").state[:, 1]
    assert row.tolist() == [FREE] * 7 + [MIXED] + [BLOCKED] * 5 + [MIXED] + [FREE] * 7


@pytest.mark.parametrize(
    "robot", [Robot.disc(0.5), Robot.rectangle(0.9, 0.6), Robot.polygon([(-0.5, -0.4), (0.6, -0.3), (0.0, 0.7)])]
)
def test_the_mixed_band_is_thin(robot):
    """Grid maps, convex robots: no MIXED cell is more than three king's moves from a BLOCKED one."""
    rng = np.random.default_rng(3)
    occupied = np.zeros((200, 160), dtype=bool)
    for x, y in rng.integers(0, 150, (30, 2)):
        occupied[x : x + 9, y : y + 5] = True
    state = cspace.build(Workspace.from_array(occupied, 0.05), robot, outside="free").state
    steps = ndimage.distance_transform_cdt(state != BLOCKED, metric="chessboard")
    assert 1 <= steps[state == MIXED].max() <= 3


def test_progress_reaches_the_end():
    seen = []
    cspace.build(
        Workspace.from_polygons(shapely.box(0, 0, 1, 1), 0.1, bounds=(-1, -1, 2, 2)),
        Robot.disc(0.2),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen and seen[-1][0] == seen[-1][1]
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


WORKSPACE = Workspace.from_array(np.eye(4, dtype=bool), 0.1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"rotations": 0}, "rotations is 0"),
        ({"rotations": -4}, "rotations is -4"),
        ({"rotations": [0.0, 1.0, 3.0]}, "whole circle"),
        ({"method": "guess"}, "method is 'guess'"),
        ({"outside": "unknown"}, "outside is 'unknown'"),
        ({"margin": -0.1}, "margin is -0.1"),
        ({"margin": math.nan}, "margin is nan"),
        ({"workers": 0}, "workers is 0"),
        ({"robot": shapely.box(0, 0, 1, 1)}, "robot is a Polygon"),
        ({"workspace": np.eye(3)}, "workspace is a ndarray"),
        ({"workspace": Workspace.from_array(np.zeros((2, 2, 2), bool), 0.1)}, "3 dimensions"),
    ],
)
def test_refuses(arguments, words):
    options = {"workspace": WORKSPACE, "robot": Robot.disc(0.1), **arguments}
    with pytest.raises(InputError, match=words):
        cspace.build(options.pop("workspace"), options.pop("robot"), **options)
