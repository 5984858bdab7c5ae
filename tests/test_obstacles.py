"""Named obstacles: equality with new builds, exact queries, copies and threads."""

import copy
import pickle

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import cspace
from cspace import Robot, Workspace
from cspace._shapes import Shape, as_shape
from tests.helpers.strategies import examples
from tests.helpers.updates import (
    OBSTACLE,
    SPACING,
    build_empty_room,
    check,
    check_agreement,
    checkers,
    worlds,
)

CART_BOX = shapely.box(1.83, 1.33, 2.21, 1.72)


class Stage:
    """A workspace with named obstacles, separate from the map that follows it."""

    def __init__(self, world):
        self.world, self.placed = world, dict[str, Shape]()
        self.low, self.size = np.array(world.lower), np.array(world.outer.shape) * SPACING

    def obstacle(self):
        """Draw a shape, and the radius of its points."""
        rng, dim = self.world.rng, len(self.size)
        center = (
            self.low + self.size * rng.uniform(-0.2, 1.2, dim) + rng.choice([0.0, 0.0, 0.0, 60.0])
        )
        sides = rng.uniform(0.1, 0.2 + 0.5 * self.size.max(), dim)
        if rng.random() < 0.3:  # points on cell boundaries too
            points = center + rng.normal(0.0, 1.0, (int(rng.integers(1, 5)), dim))
            return np.round(points / SPACING) * SPACING, rng.choice([0.0, 0.4])
        turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
        if dim == 2:
            corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * sides / 2
            return shapely.MultiPoint(corners @ turn[:2, :2] + center).convex_hull, None
        box = trimesh.creation.box(sides)
        return (box.vertices @ turn + center, box.faces), None

    def step(self, space):
        """Change an obstacle or cells; check what changed, and return a new build."""
        rng, before = self.world.rng, space.cell_states.copy()
        name, action = str(rng.choice(["cart", "dog", "door"])), rng.random()
        if action < 0.25 and name in self.placed:
            change = space.remove_obstacle(name)
            del self.placed[name]
        elif action < 0.5:
            cells, lower, inner = self.world.patch()
            change = space.update(cells, lower, inner=inner)
        elif action < 0.75:
            shapes = {each: as_shape(*self.obstacle()) for each in ("cart", "dog", "cat")}
            gone = list(self.placed)[:1]
            change = space.update(shapes | dict.fromkeys(gone))
            self.placed |= shapes
            for each in gone:
                del self.placed[each]
        else:
            obstacle, radius = self.obstacle()
            change = space.add_obstacle(name, obstacle, radius=radius)
            self.placed[name] = as_shape(obstacle, radius)
        assert set(space.obstacles) == set(self.placed)
        changed = np.argwhere(space.cell_states != before)[:, -len(self.size) :]
        assert change.changed == len(changed)
        assert (changed >= change.lower).all() and (changed < change.upper).all()
        return self.build()

    def build(self):
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
@examples(20)
@given(worlds(), st.booleans())
def test_added_moved_and_removed_obstacles_equal_a_rebuild(world, queried):
    stage, space = Stage(world), world.build()
    if queried:
        check(space, stage.build(), world)
    for _ in range(4):
        check(space, stage.step(space), world)
    for name in list(space.obstacles):
        space.remove_obstacle(name)
    check(space, world.build(), world)


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
@examples(6)
@given(worlds())
def test_checkers_and_exact_queries_follow_obstacles(world):
    stage, space = Stage(world), world.build()
    ours, exactly = checkers(space), checkers(space.exact)
    for _ in range(2):
        fresh = stage.step(space)
        check_agreement(ours, checkers(fresh), world)
        check_agreement(exactly, checkers(fresh.exact), world)
        q = world.points(20)
        np.testing.assert_array_equal(space.exact.is_free(q), fresh.exact.is_free(q))


def test_obstacles_and_updates_make_unknown_cells_known():
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


def test_refused_names_of_obstacles_change_nothing():
    space = build_empty_room()
    states = space.cell_states.copy()
    for shapes, lower, message in (
        ({"cart": CART_BOX, "dog": None}, None, "name is 'dog'; there is none"),
        ({"cart": CART_BOX, "box": trimesh.creation.box()}, None, "must be in the plane"),
        ({"cart": CART_BOX}, (0, 0), "lower is for names of obstacles; .*"),
    ):
        with pytest.raises(cspace.InputError, match=message):
            space.update(shapes, lower)
    np.testing.assert_array_equal(space.cell_states, states)
    assert not space.obstacles


# ---- copies, files, threads ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda space: pickle.loads(pickle.dumps(space))]
)
def test_copies_keep_names_and_change_independently(again):
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
