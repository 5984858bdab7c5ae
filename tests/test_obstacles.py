"""Named obstacles: equality with new builds, exact queries, copies and threads."""

import copy
import pickle
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import cspace
from cspace import BLOCKED, FREE, ConfigurationError, InputError, Robot, Workspace
from cspace.record import update
from cspace.shapes import Box, Shape, as_shape
from tests.helpers import solids
from tests.helpers.maps import proven_paths
from tests.helpers.refusals import refusals
from tests.helpers.updates import (
    OBSTACLE,
    SPACING,
    World,
    build_empty_room,
    check,
    check_agreement,
    checkers,
    worlds,
)
from tests.helpers.waiting import write_while_querying
from tests.soak.plane import place_polygon

CART_BOX = shapely.box(1.83, 1.33, 2.21, 1.72)


class Stage:
    """A workspace with named obstacles, separate from the map that follows it."""

    def __init__(self, world: World) -> None:
        self.world, self.placed = world, dict[str, Shape]()
        self.low, self.size = np.array(world.lower), np.array(world.outer.shape) * SPACING

    def obstacle(self) -> tuple[Any, Any]:
        """Draw a shape, and the radius of its points."""
        rng, dim = self.world.rng, len(self.size)
        center = (
            self.low + self.size * rng.uniform(-0.2, 1.2, dim) + rng.choice([0.0, 0.0, 0.0, 60.0])
        )
        sides = rng.uniform(0.1, 0.2 + 0.5 * self.size.max(), dim)
        kind = int(rng.integers(3))
        if kind == 0:  # also on cell boundaries
            points = (
                np.round((center + rng.normal(0.0, 1.0, (int(rng.integers(1, 5)), dim))) / SPACING)
                * SPACING
            )
            return points, rng.choice([0.0, 0.4])
        turn = (
            Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
            if kind == 1
            else np.eye(3)
        )
        if dim == 2:
            corners = (np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * sides / 2) @ turn[
                :2, :2
            ] + center
            return (shapely.MultiPoint(corners).convex_hull if kind == 1 else corners), None
        box = trimesh.creation.box(sides)
        return (box.vertices @ turn + center, box.faces), None

    def step(self, space: cspace.CSpace) -> cspace.CSpace:
        """Change an obstacle or cells; return a new build."""
        rng = self.world.rng
        name, action = str(rng.choice(["cart", "dog", "door"])), rng.random()
        if action < 0.25 and name in self.placed:
            space.remove_obstacle(name)
            del self.placed[name]
        elif action < 0.4:
            cells, lower, inner = self.world.patch()
            space.update(cells, lower, inner=inner)
        else:
            obstacle, radius = self.obstacle()
            space.add_obstacle(name, obstacle, radius=radius)
            self.placed[name] = as_shape(obstacle, radius)
        assert list(space.obstacles) == list(self.placed)
        return self.build()

    def build(self) -> cspace.CSpace:
        world, static = self.world, self.world.workspace()
        outer, inner = static.outer.copy(), static.inner.copy()
        for shape in self.placed.values():
            for mine, theirs in zip((outer, inner), shape.cells(static.grid), strict=True):
                mine |= theirs
        shapes = (*static.obstacles, *self.placed.values()) if self.placed else None
        return cspace.build(
            Workspace(static.grid, outer, inner, shapes=shapes), world.robot, **world.options
        )


# ---- equal to a rebuild --------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
@settings(max_examples=30)
@given(worlds(), st.booleans())
def test_added_moved_and_removed_obstacles_equal_a_rebuild(world: World, queried: bool) -> None:
    stage, space = Stage(world), world.build()
    if queried:
        check(space, stage.build(), world)
    for _ in range(4):
        check(space, stage.step(space), world)
    for name in list(space.obstacles):
        space.remove_obstacle(name)
    check(space, world.build(), world)


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
@settings(max_examples=16)
@given(worlds())
def test_checkers_and_exact_queries_follow_obstacles(world: World) -> None:
    stage, space = Stage(world), world.build()
    ours, exactly = checkers(space), checkers(space, exact=True)
    for _ in range(2):
        fresh = stage.step(space)
        check_agreement(ours, checkers(fresh), world)
        check_agreement(exactly, checkers(fresh, exact=True), world)
        q = world.points(20)
        np.testing.assert_array_equal(space.is_free(q, exact=True), fresh.is_free(q, exact=True))


def test_exact_queries_see_moves_within_a_cell() -> None:
    space = build_empty_room()
    free = space.point_checker(exact=True)
    space.add_obstacle("cart", shapely.box(1.83, 1.33, 2.17, 1.67))
    assert free(2.0, 1.98) and not free(2.0, 1.96)
    assert space.add_obstacle("cart", shapely.box(1.83, 1.33, 2.17, 1.69)).changed == 0
    assert not free(2.0, 1.98) and free(2.0, 2.0)


def test_obstacles_and_updates_make_unknown_cells_known() -> None:
    unknown = np.zeros((40, 30), dtype=bool)
    unknown[:, 10:] = True
    workspace = Workspace(cspace.Grid((0, 0), 0.1, (40, 30)), unknown, unknown, unknown=unknown)
    space = cspace.build(workspace, Robot.disc(0.1))
    space.add_obstacle("cart", CART_BOX)
    cart = as_shape(CART_BOX).cells(workspace.grid)[0]
    np.testing.assert_array_equal(space.workspace.unknown, unknown & ~cart)
    space.update(OBSTACLE, (0, 20))
    unknown[:4, 20:24] = False
    np.testing.assert_array_equal(space.workspace.unknown, unknown & ~cart)
    space.remove_obstacle("cart")
    np.testing.assert_array_equal(space.workspace.unknown, unknown)
    assert workspace.unknown is not None and workspace.unknown[:4, 20:24].all()


# ---- against shapely and FCL ---------------------------------------------------------------------


@pytest.mark.parametrize("rotations", [None, 12])
def test_exact_queries_agree_with_shapely(rotations: int | None) -> None:
    rng, walls = np.random.default_rng(3), np.zeros((30, 30), dtype=bool)
    walls[3:6, 4:20] = True
    static = shapely.union_all(
        [shapely.box(*(0.1 * c), *(0.1 * c + 0.1)) for c in np.argwhere(walls).astype(float)]
        + [shapely.box(-9, -9, 9, 9).difference(shapely.box(0, 0, 3, 3))]
    )
    body = shapely.box(-0.25, -0.15, 0.25, 0.15)
    space = cspace.build(Workspace.from_array(walls, 0.1), Robot.polygon(body), rotations=rotations)
    for _ in range(4):
        corner, spots = rng.uniform(0.0, 2.6, 2), rng.uniform(0.0, 3.0, (4, 2))
        cart = shapely.affinity.rotate(
            shapely.box(*corner, *np.add(corner, (0.7, 0.4))), float(rng.uniform(0, 90))
        )
        space.add_obstacle("cart", cart)
        space.add_obstacle("legs", spots, radius=0.08)
        blocked = shapely.union_all([static, cart])
        q = np.column_stack([rng.uniform(0.0, 3.0, (400, 2)), rng.uniform(-3.0, 3.0, 400)])[
            :, : space.size
        ]
        shapely.prepare(blocked)
        bodies = place_polygon(body, q)
        from_spots = shapely.distance(bodies[:, None], shapely.points(spots)).min(axis=1) - 0.08
        gap = np.minimum(shapely.distance(blocked, bodies), from_spots)
        sure = (np.abs(gap) > 1e-6) | (gap == 0.0)
        free, states, apart = (
            space.is_free(q, exact=True)[sure],
            space.classify(q)[sure],
            gap[sure] > 0.0,
        )
        np.testing.assert_array_equal(free, apart & (states != BLOCKED))
        assert apart[states == FREE].all() and not apart[states == BLOCKED].any()


@pytest.mark.parametrize("rotations", [None, 6, cspace.Rotations.quaternions(2)])
def test_exact_queries_agree_with_fcl(rotations: Any) -> None:
    rng, size, sides = (
        np.random.default_rng(1),
        np.array([0.5, 0.2, 0.3]),
        np.array([0.8, 0.4, 0.6]),
    )
    space = cspace.build(
        Workspace.from_array(np.zeros((16, 16, 16), dtype=bool), 0.15),
        Robot.box(size),
        rotations=rotations,
    )
    for _ in range(3):
        turn, center, spots = (
            Rotation.random(random_state=rng),
            rng.uniform(0.6, 1.8, 3),
            rng.uniform(0.4, 2.0, (5, 3)),
        )
        box = trimesh.creation.box(sides)
        space.add_obstacle("box", (box.vertices @ turn.as_matrix().T + center, box.faces))
        space.add_obstacle("balls", spots, radius=0.1)
        there = [
            solids.box(sides, center, turn.as_matrix()),
            *(solids.ball(0.1, spot) for spot in spots),
        ]
        turns = (
            Rotation.from_rotvec(rng.uniform(-3.0, 3.0, (300, 1)) * (0, 0, 1))
            if space.size == 4
            else Rotation.random(300, rng)
        )
        numbers = {3: np.empty((300, 0)), 4: turns.as_rotvec()[:, 2:], 7: turns.as_quat()}[
            space.size
        ]
        q = np.hstack([rng.uniform(0.5, 1.9, (300, 3)), numbers])
        for one, free in zip(q, space.is_free(q, exact=True), strict=True):
            placed = one[:3], solids.rotation_of(one).as_matrix()
            gap = solids.apart(solids.box(size, *placed), there)
            gap = min(gap or -np.inf, solids.within(0.0, 2.4, size, *placed))
            if abs(gap) > 1e-4:
                assert free == (gap > 0.0)


# ---- accepted and rejected shapes ----------------------------------------------------------------


# ---- copies, files, threads ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda space: pickle.loads(pickle.dumps(space))]
)
def test_copies_keep_names_and_change_independently(again: Any) -> None:
    space, empty = build_empty_room(), build_empty_room()
    space.add_obstacle("cart", CART_BOX)
    other = again(space)
    assert list(other.obstacles) == ["cart"]
    other.remove_obstacle("cart")
    np.testing.assert_array_equal(other.cell_states, empty.cell_states)
    assert list(space.obstacles) == ["cart"] and not space.is_free((2.0, 1.5))
    space.add_obstacle("cart", shapely.box(0.5, 0.5, 0.6, 0.6))
    np.testing.assert_array_equal(other.cell_states, empty.cell_states)
    space.remove_obstacle("cart")
    np.testing.assert_array_equal(space.cell_states, empty.cell_states)


def test_obstacles_from_threads_wait_for_each_other() -> None:
    space = build_empty_room("free")

    def query_map() -> None:
        q = np.random.default_rng(1).uniform(-1.0, 5.0, (50, 2))
        space.clearance(q)
        space.is_connected(q[:25], q[25:])
        space.is_free(q, exact=True)
        copy.copy(space)
        list(space.obstacles)

    def move(name: str) -> None:
        rng = np.random.default_rng(ord(name))
        for _ in range(15):
            space.add_obstacle(name, [rng.uniform(0.0, 4.0, 2)], radius=0.2)
        space.remove_obstacle(name) if name == "a" else None

    write_while_querying(query_map, [partial(move, name) for name in "abc"])
    assert set(space.obstacles) == {"b", "c"}
    fresh = cspace.build(space.workspace, space.robot, outside="free")
    again = build_empty_room("free")
    for name, shape in space.obstacles.items():
        again.add_obstacle(name, shape)
    q = np.random.default_rng(0).uniform(-1.0, 5.0, (300, 2))
    for other in (fresh, again):
        np.testing.assert_array_equal(space.cell_states, other.cell_states)
        np.testing.assert_array_equal(space.clearance(q), other.clearance(q))
        np.testing.assert_array_equal(space.is_free(q, exact=True), other.is_free(q, exact=True))
        np.testing.assert_array_equal(
            proven_paths(space, q[:150], q[150:]), proven_paths(other, q[:150], q[150:])
        )


def test_interrupted_move_leaves_a_correct_map(monkeypatch: pytest.MonkeyPatch) -> None:
    space, calls, real = build_empty_room(), [], update._overwrite
    space.add_obstacle("cart", shapely.box(0.5, 0.5, 0.9, 0.9))
    space.clearance((1.0, 1.0))

    def interrupt(*change: Any) -> None:
        calls.append(change)
        if len(calls) == 2:
            raise KeyboardInterrupt
        real(*change)

    monkeypatch.setattr(update, "_overwrite", interrupt)
    with pytest.raises(KeyboardInterrupt):
        space.add_obstacle("cart", shapely.box(3.0, 2.0, 3.4, 2.4))  # two changes
    fresh = build_empty_room()
    fresh.add_obstacle("cart", shapely.box(3.0, 2.0, 3.4, 2.4))
    np.testing.assert_array_equal(space.cell_states, fresh.cell_states)
    q = np.random.default_rng(0).uniform(0.0, 3.0, (100, 2))
    np.testing.assert_array_equal(
        proven_paths(space, q[:50], q[50:]), proven_paths(fresh, q[:50], q[50:])
    )
    np.testing.assert_array_equal(space.is_free(q, exact=True), fresh.is_free(q, exact=True))
