"""Arms among obstacles that change, against scenes that are built anew."""

from __future__ import annotations

import copy
import pickle
import threading
import time
import tracemalloc
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import trimesh
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from cspace import BLOCKED, Robot, Workspace
from cspace._shapes import Balls
from cspace.arms import Arm, PosedShape, build_arm_space
from cspace.errors import ConfigurationError, InputError
from tests.helpers.arm_oracle import sample_configurations
from tests.helpers.strategies import examples
from tests.helpers.urdfs import planar_arm, pose_at, random_arm

NAMES = ("table", "cup", "cloud")
LENGTH = st.floats(0.05, 0.4)
TRIPLE = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
POSES = st.builds(lambda at, turn: pose_at(*at, rotvec=turn), TRIPLE, TRIPLE)


def draw_cells(seed):
    """Return a grid of cells, some of them only possibly occupied, or none."""
    rng = np.random.default_rng(seed)
    outer = rng.random((8, 8, 8)) < 0.02 * (seed % 3)
    inner = outer & (rng.random(outer.shape) < 0.5)
    return Workspace.from_array(outer, 0.2, (-0.8,) * 3, inner=inner)


def draw_cloud(seed):
    return Balls.of(np.random.default_rng(seed).uniform(-0.3, 0.3, (40, 3)), 0.02)


def make_ring(radius):
    return trimesh.creation.annulus(0.5 * radius, radius, 0.1, sections=8)


SHAPES = st.one_of(
    st.builds(lambda *sides: Robot.box(sides).shape, LENGTH, LENGTH, LENGTH | st.just(3.0)),
    st.builds(lambda radius: Robot.ball(radius).shape, LENGTH),
    st.builds(make_ring, LENGTH),
    st.builds(draw_cloud, st.integers(0, 9)),
)
CELLS = st.builds(draw_cells, st.integers(0, 9))
NAME = st.sampled_from(NAMES)
FRAME = st.sampled_from(("l0", "l2", "l4", *NAMES))
PAIR = st.tuples(st.sampled_from(("l1", "l4", *NAMES)), NAME).filter(
    lambda pair: pair[0] != pair[1]
)
PADDED = st.sampled_from(("l2", *NAMES))
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("add"), NAME, SHAPES | CELLS, POSES),
        st.tuples(st.just("remove"), NAME),
        st.tuples(st.just("attach"), NAME, SHAPES, FRAME, POSES),
        st.tuples(st.just("pick up"), NAME, FRAME),
        st.tuples(st.just("detach"), NAME),
        st.tuples(st.just("put down"), NAME),
        st.tuples(st.just("pad"), PADDED, st.sampled_from((0.0, 0.02, 0.3))),
        st.tuples(st.just("allow"), PAIR),
        st.tuples(st.just("forbid"), PAIR),
    ),
    min_size=1,
    max_size=8,
)


@dataclass(frozen=True)
class Cell:
    """All that a new scene is built from."""

    arm: Arm
    obstacles: dict[str, Any] = field(default_factory=dict)
    held: dict[str, Any] = field(default_factory=dict)
    allowed: frozenset[Any] = frozenset()
    padding: dict[str, float] = field(default_factory=dict)

    def build(self):
        """Build the scene anew."""
        arm = self.arm
        for name, (shape, link, pose) in self.held.items():
            arm = arm.attach(name, shape, link, pose)
        placed = {}
        for name, (shape, pose) in self.obstacles.items():
            placed[name] = shape if isinstance(shape, Workspace) else PosedShape(shape, pose)
        return build_arm_space(
            placed, arm, allowed_collisions=self.allowed, margin=0.01, padding=self.padding
        )

    def change(self, space, q, step):
        """Return the cell after a step; the space is that before the step."""
        kind, name, *more = step
        obstacles = dict(self.obstacles)
        held = dict(self.held)
        padding = dict(self.padding)
        allowed = self.allowed
        match kind:
            case "add":
                obstacles[name] = more
            case "remove" | "detach":
                (obstacles if kind == "remove" else held).pop(name)
                padding.pop(name, None)
                allowed = frozenset(pair for pair in allowed if name not in pair)
            case "attach":
                held[name] = more
            case "pick up":
                placed = space.obstacles[name]
                pose = np.linalg.inv(space.arm.pose(q, more[0])) @ placed.pose
                held[name] = placed.shape, more[0], pose
                del obstacles[name]
            case "put down":
                obstacles[name] = held.pop(name)[0], space.arm.pose(q, name)
            case "pad":
                padding[name] = more[0]
            case "allow":
                allowed |= {tuple(sorted(name))}
            case "forbid":
                allowed -= {tuple(sorted(name))}
        return replace(self, obstacles=obstacles, held=held, padding=padding, allowed=allowed)


def apply_step(space, q, step):
    """Change a space by one step."""
    kind, name, *more = step
    match kind:
        case "add":
            space.add_obstacle(name, *(more[:1] if isinstance(more[0], Workspace) else more))
        case "remove":
            space.remove_obstacle(name)
        case "attach":
            space.attach(name, *more)
        case "pick up":
            space.attach(name, link=more[0], q=q)
        case "detach":
            space.detach(name)
        case "put down":
            space.detach(name, q)
        case "pad":
            space.set_padding(name, *more)
        case "allow":
            space.allow_collisions([name])
        case "forbid":
            space.forbid_collisions([name])


def describe(space):
    """Return what a space is made from."""
    obstacles = {
        name: (placed.shape, placed.pose.tolist()) for name, placed in space.obstacles.items()
    }
    return space.arm, obstacles, space.padding, space.allowed_collisions


def catch(call, *arguments):
    """Return the type of the error that a call raises, or None."""
    try:
        call(*arguments)
    except (InputError, ConfigurationError) as error:
        return type(error)
    return None


def assert_equal_answers(space, new):
    """Compare the queries of two spaces, also within obstacles."""
    rng = np.random.default_rng(0)
    points = sample_configurations(new.arm, rng, 40)
    np.testing.assert_array_equal(space.classify(points), new.classify(points))
    np.testing.assert_allclose(
        space.obstacle_distance(points), new.obstacle_distance(points), rtol=1e-9
    )
    starts, ends = np.split(points, 2)
    np.testing.assert_array_equal(
        space.motion_is_free(starts, ends), new.motion_is_free(starts, ends)
    )
    assert repr(space) == repr(new) and list(space.obstacles) == list(new.obstacles)
    check = space.edge_checker()
    assert [check(*q, *q) for q in points[:10]] == np.asarray(new.is_free(points[:10])).tolist()
    outcomes = [catch(each.closest, points[0]) for each in (space, new)]
    assert outcomes[0] is outcomes[1]
    if outcomes[0] is None:
        contact = space.closest(points[0])
        expected = new.closest(points[0])
        assert (contact.link, contact.other) == (expected.link, expected.other)


@given(seed=st.integers(0, 2), steps=STEPS)
@examples(8, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_changed_scenes_answer_as_new_ones(tmp_path, seed, steps):
    """A refused change is one that a new scene refuses, or has a wrong name; it changes nothing."""
    path = random_arm(tmp_path, seed)
    arm = Arm.from_urdf(path)
    q = sample_configurations(arm, np.random.default_rng(seed), 1)[0]
    cell = Cell(arm)
    space = build_arm_space({}, arm, margin=0.01)
    for step in steps:
        before = copy.copy(space)
        error = catch(apply_step, space, q, step)
        assert catch(apply_step, cell.build(), q, step) is error
        if error is ConfigurationError:
            assert catch(cell.change(before, q, step).build) is error
        if error:
            assert describe(space) == describe(before)
        else:
            cell = cell.change(before, q, step)
        assert_equal_answers(space, cell.build())
    new_arm = Arm.from_urdf(path)  # which is in no scene yet
    assert_equal_answers(pickle.loads(pickle.dumps(space)), replace(cell, arm=new_arm).build())


def test_an_attached_hull_encloses_cells_that_no_link_could():
    cells = Workspace.from_array(np.ones((15, 15, 15), dtype=bool), 0.1, (5.25, -0.75, -0.75))
    space = build_arm_space({"cells": cells}, planar_arm())
    assert space.is_free((0.0, 0.0))
    space.attach("hull", Robot.box((4.0, 4.0, 4.0)), "fore", pose_at(5.0, 0.0))
    assert space.classify((0.0, 0.0)) == BLOCKED
    assert space.is_free((2.0, 0.0))


def test_moves_are_seen_before_or_after_by_other_threads():
    """Move a post between two places that block one configuration each."""
    shape = Robot.box((0.2, 0.2, 1.0))
    places = [pose_at(1.5, 0.0), pose_at(0.0, 1.5)]
    space = build_arm_space({}, planar_arm())
    space.add_obstacle("post", shape, places[0])
    q = np.tile([(0.0, 0.0), (np.pi / 2, 0.0)], (100, 1))
    check = space.edge_checker()
    done = threading.Event()
    wrong = []
    seen = set()

    def look():
        while not done.is_set():
            states = np.asarray(space.classify(q)).reshape(-1, 2)
            seen.add(int(states[0, 0]))
            if (states != states[0]).any() or (states[0] == BLOCKED).sum() != 1:
                wrong.append(states)
            check(*q[0], *q[0])

    threads = [threading.Thread(target=look) for _ in range(3)]
    for thread in threads:
        thread.start()
    until = time.monotonic() + 600.0
    for count in range(100_000):
        space.add_obstacle("post", shape, places[count % 2])
        if count >= 60 and (len(seen) == 2 or time.monotonic() > until):
            break
    done.set()
    for thread in threads:
        thread.join()
    assert not wrong and len(seen) == 2


def test_replaced_clouds_leave_no_memory():
    space = build_arm_space({}, planar_arm())
    rng = np.random.default_rng(1)
    tracemalloc.start()
    sizes = []
    for _ in range(20):
        space.add_obstacle("cloud", rng.uniform(3.0, 4.0, (1000, 3)), radius=0.01)
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert max(sizes[12:]) < 1.5 * sizes[10]
