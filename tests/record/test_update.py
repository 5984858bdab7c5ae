"""Updates of maps: equality with new builds, results, refusals and threads."""

import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace import FREE, InputError, Robot, Workspace
from cspace._record import update
from tests.helpers.handmade import fill_boxes
from tests.helpers.maps import proven_paths
from tests.helpers.refusals import refusals
from tests.helpers.strategies import examples
from tests.helpers.updates import (
    OBSTACLE,
    World,
    build_empty_room,
    check,
    check_agreement,
    checkers,
    worlds,
)

# ---- equal to a rebuild --------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
@examples(30)
@given(worlds(), st.booleans(), st.sampled_from([0, update.CELLS_PER_BOX]))
def test_a_map_that_follows_a_workspace_equals_a_rebuild(world, named, cost_per_box):
    space = world.build()
    obstacle = world.robot if named else None
    if named:
        space.add_obstacle("it", obstacle)
    for step in range(4):
        for _ in range(step):  # in the first step, nothing changes
            world.patch()
        unknown = (world.rng.random(world.outer.shape) < 0.2) & world.outer
        target = replace(world.workspace(), unknown=unknown if world.rng.random() < 0.6 else None)
        before = space.cell_states.copy()
        with patch.object(update, "CELLS_PER_BOX", cost_per_box):
            change = space.update(target)
        fresh = cspace.build(target, world.robot, **world.options)
        if named:
            fresh.add_obstacle("it", obstacle)
        check(space, fresh, world)
        assert_same_unknown(space.workspace, fresh.workspace)
        assert change.changed == np.count_nonzero(space.cell_states != before)


def assert_same_unknown(workspace, other):
    """Compare unknown cells; no array means no cell."""
    ours, theirs = (
        np.zeros(each.grid.shape, dtype=bool) if each.unknown is None else each.unknown
        for each in (workspace, other)
    )
    np.testing.assert_array_equal(ours, theirs)


def test_a_map_takes_over_the_shapes_of_a_workspace():
    first, second = (
        Workspace.from_polygons([shapely.box(1, 1, 2, x)], 0.1, (0, 0, 5, 4)) for x in (3, 2.93)
    )
    space = cspace.build(first, Robot.disc(0.3))
    space.update(second)
    beside = (1.5, 3.24)
    assert space.exact.is_free(beside) and not space.is_free(beside)
    assert space.workspace.shapes is second.shapes
    labels = space.is_connected(beside, (4.0, 3.0))
    assert space.update(second).occupied == 0
    assert labels == space.is_connected(beside, (4.0, 3.0))


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 30),
    st.integers(1, 25),
    st.sampled_from([0, 100, 50_000]),
)
def test_changes_are_split_into_boxes_that_cost_little(seed, count, reach, cost_per_box):
    rng = np.random.default_rng(seed)
    changed = np.zeros(rng.integers(1, 200, 2), dtype=bool)
    cells = np.column_stack([rng.integers(0, n, count) for n in changed.shape])
    changed[tuple(cells.T)] = True
    size = np.array([reach, rng.integers(1, 25)])
    with patch.object(update, "CELLS_PER_BOX", cost_per_box):
        boxes = update.split_changes(changed, size)
    covered = np.zeros_like(changed)
    for first, stop in boxes:
        covered[tuple(map(slice, first, stop))] = True
    assert (covered >= changed).all()
    cost = sum(np.prod(stop - first + size - 1) + cost_per_box for first, stop in boxes)
    assert cost <= 2 * len(np.unique(cells, axis=0)) * (np.prod(size) + cost_per_box)
    assert cost <= 2 * (np.prod(np.ptp(cells, axis=0) + size) + cost_per_box)


# ---- other maps and shapes -----------------------------------------------------------------------


def test_update_leaves_the_workspace_and_its_other_maps_unchanged():
    workspace = Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
    space, other = (cspace.build(workspace, Robot.disc(0.3)) for _ in range(2))
    state = other.cell_states.copy()
    space.update(OBSTACLE, (18, 13))
    assert not workspace.outer.any() and other.workspace is workspace
    np.testing.assert_array_equal(other.cell_states, state)
    assert space.workspace.outer.sum() == 16 and not space.workspace.outer.flags.writeable
    assert space.workspace.source == workspace.source and not space.cell_states.flags.writeable


def test_update_replaces_shapes_by_cells():
    workspace = Workspace.from_polygons(
        shapely.Point(1.0, 1.0).buffer(0.32), 0.1, (0.0, 0.0, 4.0, 3.0)
    )
    space = cspace.build(workspace, Robot.disc(0.3))
    is_free = space.exact.point_checker()
    assert is_free(1.0, 1.63)  # free of the exact disc of 0.32 m
    space.update(OBSTACLE, (30, 20))
    assert workspace.shapes is not None and space.workspace.shapes is None
    cells = cspace.build(
        Workspace.from_array(space.workspace.outer, 0.1, inner=space.workspace.inner),
        Robot.disc(0.3),
    )
    q = np.random.default_rng(0).uniform((0.3, 0.3), (3.7, 2.7), (400, 2))
    np.testing.assert_array_equal([is_free(*one) for one in q.tolist()], cells.exact.is_free(q))


# ---- planning ------------------------------------------------------------------------------------


@pytest.mark.parametrize("rotations", [None, 8])
def test_prefetched_samples_are_checked_after_an_update(rotations):
    import planners  # the core's tests run without it

    space = build_empty_room(robot=Robot.rectangle(0.6, 0.4), rotations=rotations)
    si = planners.simple_setup(space).getSpaceInformation()
    sampler, state = planners.FreeStateSampler(si, space, np.random.default_rng(3)), si.allocState()
    assert sampler.sample(state)
    space.update(np.ones((30, 30), dtype=bool), (0, 0))
    for _ in range(300):
        assert sampler.sample(state) and si.isValid(state)


# ---- refusals ------------------------------------------------------------------------------------


@refusals(
    "cells, lower, inner, message",
    (OBSTACLE, (38, 0), None, "must lie in the grid"),
    (OBSTACLE, (-1, 0), None, "must lie in the grid "),
    (OBSTACLE, (1.0, 2.0), None, "must be 2 integers"),
    (OBSTACLE[np.newaxis], (0, 0), None, "3 axes"),
    (np.full((2, 2), 2), (0, 0), None, "must be 0 or 1"),
    (OBSTACLE, (0, 0), np.ones((4, 3), dtype=bool), "they must be equal"),
    (~OBSTACLE, (0, 0), OBSTACLE, "which is not in cells"),
)
def test_rejected_updates_change_nothing(cells, lower, inner, message):
    space = build_empty_room()
    space.update(OBSTACLE, (18, 13))
    states = space.cell_states.copy()
    with pytest.raises(InputError, match=message.strip()):
        space.update(cells, lower, inner=inner)
    assert space.workspace.outer.sum() == 16
    np.testing.assert_array_equal(space.cell_states, states)


def test_refused_workspaces_change_nothing():
    space = build_empty_room()
    states = space.cell_states.copy()
    other = Workspace.from_array(np.ones((40, 31), dtype=bool), 0.1)
    with pytest.raises(InputError, match="cells is a workspace of"):
        space.update(other)
    with pytest.raises(InputError, match=r"cells is a workspace of Grid\(lower=\(0\.0,.*inner"):
        space.update(replace(space.workspace, unknown=None), (0, 0))
    with pytest.raises(InputError, match=r"lower is missing; it is the index"):
        space.update(OBSTACLE)
    np.testing.assert_array_equal(space.cell_states, states)


@pytest.mark.parametrize("number", range(3))
def test_interrupted_update_leaves_a_correct_map(number, monkeypatch):
    """Interrupt one of the steps that write into the map or drop its data."""
    outer, rng = np.zeros((20, 18), dtype=bool), np.random.default_rng(0)
    options = {"outside": "free", "margin": 0.0, "rotations": 4}
    world = World(outer, outer.copy(), Robot.rectangle(2.0, 1.0), options, rng)
    space = world.build()
    check(space, world.build(), world)
    ours, calls = checkers(space), []

    def interrupted(step):
        def run(*args):
            calls.append(step)
            if len(calls) == number + 1:
                raise KeyboardInterrupt
            return step(*args)

        return run

    monkeypatch.setattr(space._updates, "_drop_derived", interrupted(space._drop_derived))
    monkeypatch.setattr(update, "_overwrite", interrupted(update._overwrite))
    cells = np.ones((3, 3), dtype=bool)
    world.outer[4:7, 5:8] = world.inner[4:7, 5:8] = True
    with suppress(KeyboardInterrupt):
        space.update(cells, (4, 5))
    assert len(calls) > number
    check(space, world.build(), world)
    check_agreement(ours, checkers(world.build()), world)


# ---- threads -------------------------------------------------------------------------------------


def test_updates_from_threads_wait_for_each_other():
    space, rng = build_empty_room("free"), np.random.default_rng(0)
    places = [(int(x), int(y)) for x, y in rng.integers(0, (36, 26), (40, 2))]
    q = rng.uniform(-1.0, 5.0, (300, 2))

    def update_and_query(position):
        space.update(OBSTACLE, position)
        for query in (space.clearance, space.overlap_count, space.is_free):
            query(q)
        space.is_connected(q[:150], q[150:])

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(update_and_query, places))
    occupied = fill_boxes((40, 30), *(np.s_[x : x + 4, y : y + 4] for x, y in places))
    fresh = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.3), outside="free")
    np.testing.assert_array_equal(space.cell_states, fresh.cell_states)
    np.testing.assert_array_equal(space.clearance(q), fresh.clearance(q))
    np.testing.assert_array_equal(
        proven_paths(space, q[:150], q[150:]), proven_paths(fresh, q[:150], q[150:])
    )


def test_a_saved_map_has_one_version(tmp_path, monkeypatch):
    # Updates wait for saves, so states and obstacles in a file agree.
    space = build_empty_room()
    changing = threading.Thread(target=lambda: space.update(OBSTACLE, (10, 10)))
    from cspace.export import _plane_images as images

    begun = images.replacing

    def in_the_midst(*args, **members):
        if changing.ident is not None:
            return begun(*args, **members)
        before = space.cell_states.copy()
        changing.start()
        changing.join(0.2)
        assert changing.is_alive() and (space.cell_states == before).all()
        return begun(*args, **members)

    monkeypatch.setattr(images, "replacing", in_the_midst)
    space.export(tmp_path / "map.yaml")
    changing.join()
    assert (space.cell_states != FREE).sum() > (build_empty_room().cell_states != FREE).sum()
