"""Builds of maps: definition, independent geometry, laws, options and refusals."""

import warnings

import numpy as np
import pyclipper
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import cspace
from cspace import BLOCKED, FREE, MIXED, Robot, Rotations, UnitWarning, Workspace
from cspace._engines.slices import slice_rasters
from tests.helpers.oracles import overlaps_by_shifts
from tests.helpers.strategies import examples, exteriors, robots, stars

CELL_SIDE = 0.15
"""Spacing of the maps, in metres."""


@st.composite
def problems(draw, size=0.25, side=(9, 7)):
    """Draw outer cells, inner cells and a robot in the plane or in space."""
    dim = draw(st.integers(2, 3))
    shape = draw(st.tuples(*[st.integers(1, side[dim - 2])] * dim))
    outer, part = (draw(hnp.arrays(np.bool_, shape)) for _ in range(2))
    robot = draw(robots(size, dim))
    return outer, outer & part, robot


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
@examples(40)
@given(
    problems(),
    st.sampled_from([None, None, 1, 3, 4, 6, "any way"]),
    exteriors,
    st.sampled_from([0.0, 0.03]),
)
def test_states_match_the_definition(problem, rotations, outside, margin):
    # Engines and options change no state.
    outer, inner, robot = problem
    if rotations == "any way":
        rotations = Rotations.quaternions(2) if outer.ndim == 3 else None
    workspace = Workspace.from_array(outer, CELL_SIDE, inner=inner)
    options = {"rotations": rotations, "outside": outside, "margin": margin}
    counted = cspace.build(workspace, robot, counts=True, **options)
    cells, expected = np.argwhere(np.ones_like(outer)), np.empty_like(counted._states)
    rasters = slice_rasters(robot, CELL_SIDE, margin, counted.rotations)
    for number, cell in zip(*np.unique(counted.slice_of, return_index=True), strict=True):
        far, near = rasters[number]
        touches = overlaps_by_shifts(outer, far, outside == "blocked")
        lies_in = overlaps_by_shifts(inner, near, outside == "blocked")
        expected[number] = np.where(lies_in > 0, BLOCKED, np.where(touches > 0, MIXED, FREE))
        assert (counted.overlap_counts.reshape(expected.shape)[number] == touches).all()
        center = np.broadcast_to(
            counted.rotations.centers[cell], (len(cells), len(counted.rotations.names))
        )
        q = np.column_stack([counted.grid.center_of(cells), center])
        assert counted.overlap_count(q).tolist() == touches.ravel().tolist()
    assert (counted._states == expected).all()
    for method in ("fft", "direct"):
        assert (cspace.build(workspace, robot, method=method, **options)._states == expected).all()
    bare = cspace.build(workspace, robot, inner=False, **options)
    assert (bare._states == np.minimum(expected, MIXED)).all()


@examples(15)
@example(  # The robot is so thin that it contains no lattice point, so an inner cell blocks no cell.
    np.array([(0.1, 0.1), (-0.3, 0.3), (0.2, 0.0)]),
    np.array([(-0.308, -0.044), (0.412, -0.765), (0.939, 0.0)]),
)
@given(stars(0.5), stars(1.0))
def test_states_agree_with_the_exact_minkowski_sum(robot, obstacle):
    """Compare FREE and BLOCKED cells with the Minkowski sum of pyclipper in integers.

    A cell k must be BLOCKED if the robot contains the lattice point of an offset m and cell k + m
    lies in the obstacle.
    """
    scale, h = 2**20, 0.11
    space = cspace.build(
        Workspace.from_polygons(shapely.Polygon(obstacle), h, bounds=(-4, -4, 4, 4)),
        Robot.polygon(robot),
        outside="free",
    )
    paths = [
        np.rint(part * scale).astype(int).tolist()
        for part in (-np.asarray(robot), np.asarray(obstacle))
    ]
    pieces = [
        shapely.Polygon(np.divide(path, scale))
        for path in pyclipper.MinkowskiSum(paths[0], paths[1], True)
    ]
    # MinkowskiSum sweeps only the border; adding the obstacle at each robot vertex fills the
    # interior.
    whole = [shapely.Polygon(np.asarray(obstacle) - vertex) for vertex in np.asarray(robot)]
    exact = shapely.union_all([piece.buffer(0) for piece in pieces] + whole)
    exact = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(exact)])
    lower = (
        np.stack(np.meshgrid(*map(np.arange, space.grid.shape), indexing="ij"), -1) * h
        + space.grid.lower
    )
    cells = shapely.box(lower[..., 0], lower[..., 1], lower[..., 0] + h, lower[..., 1] + h)
    rounding = 4.0 / scale
    assert not shapely.intersects(cells[space.cell_states == FREE], exact.buffer(-rounding)).any()
    assert shapely.covers(exact.buffer(rounding), cells[space.cell_states == BLOCKED]).all()
    inner = np.argwhere(shapely.covers(shapely.Polygon(obstacle).buffer(-1e-6), cells))
    offsets = np.stack(np.meshgrid(*[np.arange(-20, 21)] * 2), -1).reshape(-1, 2)
    offsets = offsets[shapely.contains_xy(shapely.Polygon(robot).buffer(-1e-6), *(h * offsets).T)]
    assert (space.cell_states[tuple((inner[:, None] - offsets).reshape(-1, 2).T)] == BLOCKED).all()


@examples(20)
@given(problems(0.3), st.sampled_from([None, 5, "any way"]), st.integers(-3, 3), st.data())
def test_maps_obey_monotony_union_and_translation(problem, rotations, shift, data):

    first, second, robot = problem
    second = np.roll(second, 1, axis=0)
    if rotations == "any way":
        rotations = Rotations.quaternions(1) if first.ndim == 3 else 1
    options = {"rotations": rotations, "outside": "free"}

    def states(occupied, margin=0.0):
        return cspace.build(
            Workspace.from_array(occupied, 0.125), robot, margin=margin, **options
        ).cell_states

    assert (states(first | second) == np.maximum(states(first), states(second))).all()
    grown = states(first, margin=0.13)
    assert (grown >= states(first)).all()
    assert ((grown == BLOCKED) == (states(first) == BLOCKED)).all()
    # The map of a moved workspace is the moved map.
    axis = data.draw(st.integers(0, first.ndim - 1))
    moved = states(np.roll(np.pad(first, 3), shift, axis=axis))
    middle = [slice(3, 3 + n) for n in first.shape]
    middle[axis] = slice(3 + shift, 3 + shift + first.shape[axis])
    assert (moved[(..., *middle)] == states(first)).all()


# ---- maps without a FREE cell --------------------------------------------------------------------


def test_a_map_without_a_free_cell_warns_and_says_why(tmp_path):
    full = Workspace.from_array(np.ones((9, 8), dtype=bool), 0.1)
    corridor = np.ones((30, 20), dtype=bool)
    corridor[:, 8:12] = False
    narrow = Workspace.from_array(corridor, 0.1)
    unseen = np.ones((9, 8), dtype=bool)
    unseen[0] = False
    grid = cspace.Grid((0, 0), 0.1, (9, 8))
    dark = Workspace(grid, np.ones((9, 8), bool), np.ones((9, 8), bool), unknown=unseen)
    cases = [
        (full, Robot.disc(0.05), "every cell of the workspace is occupied"),
        (
            dark,
            Robot.disc(0.05),
            "64 of 72 cells are unknown, and count as occupied",
        ),
        (narrow, Robot.disc(0.25), "radius of 0.2 m, and the robot with its margin needs 0.25 m"),
        (narrow, Robot.rectangle(0.38, 0.38), "cells are MIXED, undecided at this spacing"),
    ]
    for workspace, robot, message in cases:
        with pytest.warns(UserWarning, match=f"no cell of the map is FREE: .*{message}"):
            space = cspace.build(workspace, robot)
        assert space.count()[0] == 0
        with pytest.warns(UserWarning, match="no cell of the map is FREE"):
            cspace.build(workspace, robot, store=tmp_path / f"{len(list(tmp_path.iterdir()))}.zarr")


def test_the_hints_of_a_map_without_a_free_cell_are_followed():
    corridor = np.ones((60, 40), dtype=bool)
    corridor[:, 16:24] = False
    for factor in (1, 4):
        cells = corridor.repeat(factor, axis=0).repeat(factor, axis=1)
        workspace = Workspace.from_array(cells, 0.05 / factor)
        with warnings.catch_warnings(record=True, action="always") as caught:
            space = cspace.build(workspace, Robot.rectangle(0.36, 0.36))
        told = [str(warning.message) for warning in caught]
        if factor == 1:
            assert "MIXED" in told[0]
        else:
            assert told == []
            assert space.count()[0]


def test_a_map_with_free_cells_or_one_that_was_explained_has_no_such_warning():
    open_field = Workspace.from_array(np.zeros((9, 8), dtype=bool), 0.1)
    with warnings.catch_warnings(record=True, action="always") as caught:
        cspace.build(open_field, Robot.disc(0.1))
        cspace.build(open_field, Robot.disc(5.0))
    assert [warning.category for warning in caught] == [UnitWarning]
