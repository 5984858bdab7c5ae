"""Maps in space against their definition on tiny grids, exact distances, manifold3d, and the laws they must obey."""

import itertools

import manifold3d
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage
from scipy.spatial import ConvexHull

import cspace
from cspace import BLOCKED, FREE, MIXED, InputError, Robot, Workspace
from cspace.fourier import correlate
from cspace.raster import Raster
from strategies import seeds

H = 0.15


def blocks(side):
    return hnp.arrays(np.bool_, st.tuples(*[st.integers(1, side)] * 3))


@st.composite
def bodies(draw, size=0.4):
    """Robots of every kind but meshes, with their exact shape as boxes and balls: (lower, upper, radius) each."""
    kind = draw(st.sampled_from(["ball", "box", "balls", "cells"]))
    rng = np.random.default_rng(draw(seeds))
    center = rng.uniform(-1, 1, 3) * size
    if draw(st.booleans()):
        center = np.round(center / H) * H
    if kind == "box":
        extents = size * rng.uniform(0.1, 2.0, 3)
        return Robot.box(extents, center), [(center - extents / 2, center + extents / 2, 0.0)]
    if kind == "cells":
        occupied = rng.random(rng.integers(1, 5, 3)) < 0.5
        occupied[0, 0, 0] = True
        side = draw(st.sampled_from([H, 0.11]))
        lows = center + side * np.argwhere(occupied)
        return Robot.cells(occupied, side, center), [(low, low + side, 0.0) for low in lows]
    n = 1 if kind == "ball" else int(rng.integers(2, 5))
    centers, radii = center + rng.uniform(-size, size, (n, 3)) * (n > 1), size * rng.uniform(0.1, 0.9, n)
    robot = Robot.ball(radii[0], centers[0]) if n == 1 else Robot.balls(centers, radii)
    return robot, [(c, c, r) for c, r in zip(centers, radii, strict=True)]


def by_shifts(occupied, raster, outside):
    """Overlaps by adding up shifted copies of the map."""
    pad = [(max(0, -low), max(0, high)) for low, high in zip(raster.lower, raster.upper, strict=True)]
    wide = np.pad(occupied, pad, constant_values=outside)
    total = np.zeros(occupied.shape, dtype=np.int64)
    for offset in np.argwhere(raster.cells) + raster.lower:
        place = tuple(slice(p[0] + m, p[0] + m + n) for p, m, n in zip(pad, offset, occupied.shape, strict=True))
        total += wide[place]
    return total


def gaps(parts, q, lows, side):
    """Distances between the robot at configurations (n, 3) and the nearest of some cubes; (n,)."""
    found = np.full(len(q), np.inf)
    for (lower, upper, radius), low in itertools.product(parts, lows):
        apart = np.maximum(np.maximum(low - (q + upper), (q + lower) - (low + side)), 0.0)
        found = np.minimum(found, np.linalg.norm(apart, axis=1) - radius)
    return found


@given(blocks(7), blocks(5), st.tuples(*[st.integers(-9, 5)] * 3), st.booleans())
@example(np.ones((1, 9, 2), bool), np.ones((5, 1, 1), bool), (-2, 0, 1), True)
@example(np.zeros((4, 4, 4), bool), np.ones((9, 9, 9), bool), (-4, -4, -4), True)
def test_overlaps_equal_the_sum(occupied, cells, lower, outside):
    raster = Raster.trimmed(cells, lower)
    counts = correlate(occupied, [raster], outside=outside, counts=True).results[0]
    assert (counts == by_shifts(occupied, raster, outside)).all()


@settings(max_examples=6)
@given(seeds)
def test_many_tiles_and_many_rasters(seed):
    rng = np.random.default_rng(seed)
    occupied = rng.random(rng.integers(30, 130, 3)) < rng.choice([0.001, 0.05])
    occupied[: rng.integers(0, 30)] = rng.random() < 0.5
    rasters = [
        Raster.trimmed(rng.random(rng.integers(1, 9, 3)) < 0.7, tuple(rng.integers(-9, 5, 3).tolist()))
        for _ in range(rng.integers(1, 4))
    ]
    outside = bool(rng.integers(2))
    hits = correlate(occupied, rasters, outside=outside, workers=2)
    counts = correlate(occupied, rasters, outside=outside, counts=True, workers=1)
    for raster, hit, count in zip(rasters, hits.results, counts.results, strict=True):
        expected = by_shifts(occupied, raster, outside)
        assert (hit == (expected > 0)).all()
        assert (count == expected).all()


@settings(max_examples=30)
@given(blocks(7), blocks(7), bodies(), st.sampled_from(["blocked", "free"]))
def test_states_by_definition(first, second, body, outside):
    shape = tuple(map(min, first.shape, second.shape))
    outer = first[tuple(map(slice, shape))]
    inner = outer & second[tuple(map(slice, shape))]
    workspace = Workspace.from_array(outer, H, inner=inner)
    big, small = body[0].rasters(H)
    touches = by_shifts(outer, big, outside == "blocked")
    collides = by_shifts(inner, small, outside == "blocked")
    wanted = np.where(collides > 0, BLOCKED, np.where(touches > 0, MIXED, FREE))
    space = cspace.build(workspace, body[0], outside=outside, overlap=True)
    assert (space.state == wanted).all()
    assert (space.overlaps == touches).all()
    assert (cspace.build(workspace, body[0], outside=outside).state == wanted).all()
    assert (cspace.build(workspace, body[0], outside=outside, inner=False).state == np.minimum(wanted, MIXED)).all()


@settings(max_examples=40)
@given(bodies(), seeds, st.sampled_from(["blocked", "free"]), st.sampled_from([0.0, 0.1]))
def test_no_false_answer_over_voxels(body, seed, outside, margin):
    """Configurations anywhere, on borders of cells and close to them, against exact distances between boxes."""
    robot, parts = body
    rng = np.random.default_rng(seed)
    lower = np.array([-1.0, 2.0, 0.3])
    occupied = rng.random((12, 10, 8)) < rng.choice([0.005, 0.03])
    space = cspace.build(Workspace.from_array(occupied, H, lower), robot, outside=outside, margin=margin)
    upper = np.asarray(space.grid.upper)
    q = rng.uniform(lower - 0.4, upper + 0.4, (800, 3))
    q = np.where(rng.random(q.shape) < 0.3, lower + H * np.rint((q - lower) / H), q)
    q += np.where(rng.random(q.shape) < 0.1, rng.uniform(-1e-8, 1e-8, q.shape), 0.0)
    gap = gaps(parts, q, lower + H * np.argwhere(occupied), H)
    if outside == "blocked":
        for low, high, radius in parts:
            gap = np.minimum(gap, np.min([q + low - lower, upper - (q + high)], axis=(0, 2)) - radius)
    states = space.classify(q)
    assert not ((states == FREE) & (gap < margin - 1e-9)).any()
    assert not ((states == BLOCKED) & (gap > 1e-9)).any()
    assert (space.is_free(q) == (states == FREE)).all()


@settings(max_examples=25)
@given(seeds, seeds)
def test_convex_pairs_agree_with_the_exact_minkowski_sum(first, second):
    """FREE cells lie outside manifold3d's sum of the obstacle and the reflected robot, BLOCKED cells inside."""
    rng = np.random.default_rng([first, second])
    h = 0.2
    robot, obstacle = (rng.uniform(-1, 1, (int(rng.integers(4, 12)), 3)) * rng.uniform(0.4, 1.3, 3) for _ in range(2))
    hulls = [manifold3d.Manifold.hull_points(points) for points in (-robot, obstacle)]
    made = [cspace_mesh(hull) for hull in (manifold3d.Manifold.hull_points(robot), hulls[1])]
    workspace = Workspace.from_mesh(made[1], h, (-4, -4, -4, 4, 4, 4))
    space = cspace.build(workspace, Robot.mesh(made[0]), outside="free")
    total = minkowski_sum(*hulls)
    # A cell whose lower corner is p meets the sum where p lies in the sum and the reflected cell together.
    reach = minkowski_sum(total, manifold3d.Manifold.cube((h, h, h)).translate((-h, -h, -h)))
    lower = np.stack(np.meshgrid(*map(np.arange, space.grid.shape), indexing="ij"), -1) * h + space.grid.lower
    assert depth(reach, lower[space.state == FREE]).max(initial=-np.inf) <= 1e-5
    corners = lower[space.state == BLOCKED][:, None] + h * np.array(list(itertools.product((0, 1), repeat=3)))
    assert depth(total, corners.reshape(-1, 3)).min(initial=np.inf) >= -1e-5
    # What is undecided is a band along the border of the sum.
    middles = lower[space.state == MIXED] + h / 2
    assert np.abs(depth(total, middles)).max(initial=0.0) <= 2.5 * np.sqrt(3) * h + thin(robot) + thin(obstacle)


def cspace_mesh(solid):
    mesh = solid.to_mesh()
    return np.asarray(mesh.vert_properties[:, :3], np.float64), np.asarray(mesh.tri_verts, np.int64)


def minkowski_sum(first, second):
    """The sum of two convex solids; manifold3d 3.5 has some of them wrong in one order, which qhull's volume tells."""
    points = [cspace_mesh(solid)[0] for solid in (first, second)]
    volume = ConvexHull((points[0][:, None] + points[1]).reshape(-1, 3)).volume
    sums = [first.minkowski_sum(second), second.minkowski_sum(first)]
    right = [solid for solid in sums if abs(solid.volume() - volume) < 1e-5 * volume]
    assume(right)
    return right[0]


def depth(solid, points):
    """How far points lie within a convex solid, along the normal of the nearest face; below zero outside."""
    planes = ConvexHull(cspace_mesh(solid)[0]).equations
    return -(points @ planes[:, :3].T + planes[:, 3]).max(axis=1)


def thin(points):
    """How far the deepest point of a convex hull can be from having a whole cell around it: its inner radius."""
    hull = ConvexHull(points)
    return 3.0 * hull.volume / hull.area


@settings(max_examples=15)
@given(blocks(7), blocks(7), bodies(0.3), st.tuples(*[st.integers(-3, 3)] * 3))
def test_laws(first, second, body, shift):
    """More obstacles or margin: never more FREE, never less BLOCKED. Union of obstacles: the worse of the maps."""
    shape = tuple(map(min, first.shape, second.shape))
    first, second = (part[tuple(map(slice, shape))] for part in (first, second))

    def states(occupied, lower=(0.0, 0.0, 0.0), **options):
        return cspace.build(Workspace.from_array(occupied, 0.125, lower), body[0], outside="free", **options).state

    assert (states(first | second) == np.maximum(states(first), states(second))).all()
    grown = states(first, margin=0.13)
    assert (grown >= states(first)).all()
    assert ((grown == BLOCKED) == (states(first) == BLOCKED)).all()
    assert (states(first, 0.125 * np.asarray(shift)) == states(first)).all()
    pad = [(3, 3)] * 3
    moved = states(np.roll(np.pad(first, pad), shift, axis=(0, 1, 2)))
    middle = tuple(slice(3 + s, 3 + s + n) for s, n in zip(shift, shape, strict=True))
    assert (moved[middle] == states(first)).all()


def test_equals_a_dilation():
    rng = np.random.default_rng(5)
    occupied = rng.random((40, 30, 20)) < 0.02
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.ball(0.35), outside="free")
    outer = space.robot.rasters(0.1)[0]
    dilated = ndimage.binary_dilation(occupied, outer.cells[::-1, ::-1, ::-1])
    assert (dilated == (space.state != FREE)).all()


def test_a_robot_larger_than_the_map():
    occupied = np.zeros((4, 5, 6), bool)
    occupied[1, 2, 3] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.ball(3.0))
    assert (space.state == BLOCKED).all()
    assert space.classify((50.0, 0.0, 0.0)) == BLOCKED
    assert cspace.build(Workspace.from_array(occupied, 0.1), Robot.ball(3.0), outside="free").is_free((50.0, 0, 0))


def test_turning_in_space_is_refused():
    workspace = Workspace.from_array(np.zeros((3, 3, 3), bool), 0.1)
    with pytest.raises(InputError, match="only translates"):
        cspace.build(workspace, Robot.ball(0.1), rotations=4)


def test_dimensions_must_agree():
    with pytest.raises(InputError, match="3 dimensions and the robot 2"):
        cspace.build(Workspace.from_array(np.zeros((3, 3, 3), bool), 0.1), Robot.disc(0.1))


def test_a_map_that_does_not_fit_is_refused_before_any_work(monkeypatch):
    workspace = Workspace.from_array(np.zeros((30, 20, 10), bool), 0.1)
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 10**8)
    with pytest.raises(InputError, match=r"30 x 20 x 10 cells .* about 134 MB .* 100 MB are free.*no spacing helps"):
        cspace.build(workspace, Robot.ball(0.1))
    with pytest.raises(InputError, match=r"1001 x 1001 x 1001 .* 8.02 GB .* spacing of at least 0.4"):
        Workspace.from_mesh(([(0, 0, 0), (100.1, 100.1, 0), (0, 0, 100.1)], [(0, 1, 2)]), 0.1, solid="surface")
