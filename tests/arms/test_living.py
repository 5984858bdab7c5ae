"""Arms among obstacles that change, against scenes that are built anew."""

from __future__ import annotations

import copy
import pickle
import threading
import time
import tracemalloc
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cspace import FREE, Robot, Workspace
from cspace.arms import Arm, ArmSpace, PosedShape, build_arm_space
from cspace.errors import ConfigurationError, InputError
from cspace.shapes import Balls
from tests.helpers.refusals import refusals
from tests.helpers.solids import ArmOracle, box, sample_configurations
from tests.helpers.urdfs import planar, pose_at, posed_box, random_arm

NAMES = ("table", "cup", "cloud")
LENGTH, COORDINATE = st.floats(0.05, 0.4), st.floats(-1.0, 1.0)
POSES = st.builds(
    pose_at, COORDINATE, COORDINATE, COORDINATE, st.tuples(COORDINATE, COORDINATE, COORDINATE)
)


def draw_cells(seed: int) -> Workspace:
    """Return a grid of cells, some of them only possibly occupied, or none."""
    rng = np.random.default_rng(seed)
    outer = rng.random((8, 8, 8)) < 0.02 * (seed % 3)
    return Workspace.from_array(
        outer, 0.2, (-0.8,) * 3, inner=outer & (rng.random(outer.shape) < 0.5)
    )


SHAPES = st.one_of(
    st.builds(lambda *sides: Robot.box(sides).shape, LENGTH, LENGTH, LENGTH),
    st.builds(lambda radius: Robot.ball(radius).shape, LENGTH),
    st.builds(
        lambda radius: trimesh.creation.annulus(0.5 * radius, radius, 0.1, sections=8), LENGTH
    ),
    st.builds(
        lambda seed: Balls.of(np.random.default_rng(seed).uniform(-0.3, 0.3, (40, 3)), 0.02),
        st.integers(0, 9),
    ),
)
NAME = st.sampled_from(NAMES)
FRAME = st.sampled_from(("l0", "l2", "l4", *NAMES))
PAIR = st.tuples(st.sampled_from(("l1", "l4", *NAMES)), NAME).filter(
    lambda pair: pair[0] != pair[1]
)
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("add"), NAME, SHAPES, POSES),
        st.tuples(st.just("add"), NAME, st.builds(draw_cells, st.integers(0, 9)), POSES),
        st.tuples(st.just("remove"), NAME),
        st.tuples(st.just("attach"), NAME, SHAPES, FRAME, POSES),
        st.tuples(st.just("pick up"), NAME, FRAME),
        st.tuples(st.just("detach"), NAME),
        st.tuples(st.just("put down"), NAME),
        st.tuples(
            st.just("pad"), st.sampled_from(("l2", *NAMES)), st.sampled_from((0.0, 0.02, 0.3))
        ),
        st.tuples(st.just("allow"), PAIR),
        st.tuples(st.just("forbid"), PAIR),
    ),
    min_size=1,
    max_size=8,
)


@dataclass
class Cell:
    """All that a new scene is built from."""

    arm: Arm
    obstacles: dict[str, Any] = field(default_factory=dict)
    held: dict[str, Any] = field(default_factory=dict)
    allowed: set[Any] = field(default_factory=set)
    padding: dict[str, float] = field(default_factory=dict)

    def build(self) -> ArmSpace:
        """Build the scene anew."""
        arm = self.arm
        for name, (shape, link, pose) in self.held.items():
            arm = arm.attach(name, shape, link, pose)
        placed = {
            name: shape if isinstance(shape, Workspace) else PosedShape(shape, pose)
            for name, (shape, pose) in self.obstacles.items()
        }
        return build_arm_space(
            placed, arm, allowed_collisions=self.allowed, margin=0.01, padding=self.padding
        )

    def refuses(self, step: Any) -> bool:
        """Return whether a step has a wrong name."""
        kind, name, *more = step
        known = {*self.obstacles, *self.held, *(each.name for each in self.arm.links)}
        is_empty = (
            isinstance(self.obstacles.get(name, [None])[0], Workspace)
            and not self.obstacles[name][0].outer.any()
        )
        match kind:
            case "add":
                return name in self.held
            case "remove":
                return name not in self.obstacles
            case "attach":
                return name in known or more[1] not in {*self.arm.frames, *self.held}
            case "pick up":
                return (
                    name not in self.obstacles
                    or is_empty
                    or more[0] not in {*self.arm.frames, *self.held}
                )
            case "detach" | "put down":
                return name not in self.held or any(
                    name == link for _, link, _ in self.held.values()
                )
            case "forbid":
                return tuple(sorted(name)) not in self.allowed
        return not ({name} if kind == "pad" else set(name)) <= known

    def changed(self, space: ArmSpace, q: Any, step: Any) -> Cell:
        """Return the cell after a step; the space is that before the step."""
        kind, name, *more = step
        new = Cell(
            self.arm, dict(self.obstacles), dict(self.held), set(self.allowed), dict(self.padding)
        )
        match kind:
            case "add":
                new.obstacles[name] = more
            case "remove" | "detach":
                (new.obstacles if kind == "remove" else new.held).pop(name)
                new.padding.pop(name, None)
                new.allowed = {pair for pair in new.allowed if name not in pair}
            case "attach":
                new.held[name] = more
            case "pick up":
                placed = space.obstacles[name]
                new.held[name] = (
                    placed.shape,
                    more[0],
                    np.linalg.inv(space.arm.pose(q, more[0])) @ placed.pose,
                )
                del new.obstacles[name]
            case "put down":
                new.obstacles[name] = new.held.pop(name)[0], space.arm.pose(q, name)
            case "pad":
                new.padding[name] = more[0]
            case "allow":
                new.allowed.add(tuple(sorted(name)))
            case "forbid":
                new.allowed.remove(tuple(sorted(name)))
        return new


def describe(space: ArmSpace) -> Any:
    """Return what a space is made from."""
    return space.arm, space.obstacles, space.padding, space.allowed_collisions


def change(space: ArmSpace, q: Any, step: Any) -> None:
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


def outcome(call: Any, *arguments: Any) -> type[Exception] | None:
    """Return the type of the error that a call raises, or None."""
    try:
        call(*arguments)
    except (InputError, ConfigurationError) as error:
        return type(error)
    return None


def assert_equal_answers(space: ArmSpace, new: ArmSpace, seed: int = 0) -> None:
    """Compare all queries of two spaces."""
    rng = np.random.default_rng(seed)
    points = sample_configurations(new.arm, rng, 40)
    states = np.asarray(new.classify(points))
    np.testing.assert_array_equal(space.classify(points), states)
    np.testing.assert_array_equal(space.is_free(points), states == FREE)
    np.testing.assert_allclose(
        space.obstacle_distance(points), new.obstacle_distance(points), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_array_equal(
        space.motion_is_free(points[:20], points[20:]), new.motion_is_free(points[:20], points[20:])
    )
    assert repr(space) == repr(new) and list(space.obstacles) == list(new.obstacles)
    for q in points[:3]:
        assert space.obstacle_distance(q) == new.obstacle_distance(q)
        if len(new.snapshot.outer.pairs):
            one, other = space.closest(q), new.closest(q)
            assert one[:3] == other[:3]
            np.testing.assert_array_equal(one.points, other.points)
    path = points[0] + 0.1 * (points[:4] - points[0])
    assert space.path_obstacle_distance(path) == pytest.approx(
        new.path_obstacle_distance(path), rel=1e-9
    )
    free = points[states == FREE][:2]
    if len(free) == 2 and new.motion_is_free(*free):
        np.testing.assert_array_equal(space.find_path(*free, seed=1), new.find_path(*free, seed=1))


@given(seed=st.integers(0, 2), steps=STEPS)
@settings(
    max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
def test_changed_scenes_answer_as_new_ones(tmp_path: Path, seed: int, steps: Any) -> None:
    """Refused changes are those that a new scene or a wrong name refuses, and change nothing."""
    arm = Arm.from_urdf(random_arm(tmp_path, seed))
    q = sample_configurations(arm, np.random.default_rng(seed), 1)[0]
    cell, space = Cell(arm), build_arm_space({}, arm, margin=0.01)
    check, points = space.edge_checker(), sample_configurations(arm, np.random.default_rng(1), 10)
    for step in steps:
        before, is_wrong = copy.copy(space), cell.refuses(step)
        error = outcome(change, space, q, step)
        assert (error is InputError) == is_wrong, step
        if not is_wrong:
            wanted = cell.changed(before, q, step)
            assert outcome(wanted.build) is error, step
            cell = cell if error else wanted
        if error:
            assert describe(space) == describe(before)
        assert_equal_answers(space, cell.build())
        assert [check(*q, *q) for q in points] == np.asarray(space.is_free(points)).tolist()
    assert_equal_answers(pickle.loads(pickle.dumps(space)), cell.build())


def test_moves_are_seen_before_or_after_by_other_threads(tmp_path: Path) -> None:
    """Move a post between two places that block one configuration each, and pick it up."""
    space = build_arm_space(
        {"post": posed_box((0.2, 0.2, 1.0), 1.5, 0.0)}, Arm.from_urdf(planar(tmp_path))
    )
    moved = posed_box((0.2, 0.2, 1.0), 0.0, 1.5).pose
    q = np.array([(0.0, 0.0), (np.pi / 2, 0.0)])
    batch, done = np.tile(q, (100, 1)), threading.Event()
    check, wrong, seen = space.edge_checker(), list[Any](), set[Any]()

    def look() -> None:
        while not done.is_set():
            free = tuple(np.asarray(space.is_free(q)).tolist())
            states = tuple(np.asarray(space.classify(batch)).tolist())
            moves = tuple(np.asarray(space.motion_is_free(batch, batch)).tolist())
            distances = tuple(np.asarray(space.obstacle_distance(q)) > 0.0)
            seen.add(free)
            if (
                free.count(True) != 1
                or states[:2] not in ((0, 2), (2, 0))
                or states != states[:2] * 100
            ):
                wrong.append((free, states))
            if (
                moves != moves[:2] * 100
                or sum(distances) != 1
                or space.closest(q[0]).other not in ("post", "foot")
            ):
                wrong.append((moves, distances))
            check(*q[0], *q[0])

    threads = [threading.Thread(target=look) for _ in range(3)]
    for thread in threads:
        thread.start()
    shape = Robot.box((0.2, 0.2, 1.0))
    count, until = 0, time.monotonic() + 60.0
    while count < 60 or (len(seen) < 2 and time.monotonic() < until):
        space.add_obstacle("post", shape, moved)
        space.add_obstacle("post", posed_box((0.2, 0.2, 1.0), 1.5, 0.0))
        count += 1
    done.set()
    for thread in threads:
        thread.join()
    assert not wrong, wrong[:3]
    assert seen == {(False, True), (True, False)}


def test_objects_are_picked_up_and_put_down(tmp_path: Path) -> None:
    """Carry a box over a table; it may touch the table while it is taken."""
    arm = Arm.from_urdf(planar(tmp_path))
    space = build_arm_space({"table": posed_box((1.0, 0.1, 0.5), 2.0, -0.3)}, arm)
    space.add_obstacle("box", Robot.box((0.1, 0.2, 0.1)), pose_at(1.9, -0.15), touch_links="fore")
    grasp, away = (0.0, 0.0), (0.5, 0.0)
    assert space.is_free(grasp) and space.is_free(away)
    space.attach("box", link="fore", q=grasp)
    assert list(space.obstacles) == ["table"] and "box" in space.arm.frames
    np.testing.assert_allclose(space.arm.pose(grasp, "box"), pose_at(1.9, -0.15), atol=1e-12)
    assert space.is_free(away) and not space.is_free(grasp)
    space.allow_collisions([("table", "box")])
    assert space.is_free(grasp) and not space.is_free((-0.2, 0.0))
    assert space.allowed_collisions == [("box", "fore"), ("box", "table")]
    space.detach("box", away)
    np.testing.assert_allclose(
        space.obstacles["box"].pose, arm.pose(away, "fore") @ pose_at(0.9, -0.15), atol=1e-12
    )
    assert space.is_free(away) and ("box", "table") in space.allowed_collisions
    space.forbid_collisions([("fore", "box")])
    assert not space.is_free(away)
    space.remove_obstacle("box")
    assert not space.allowed_collisions
    assert space.arm.links == arm.links and space.arm.allowed_collisions == arm.allowed_collisions


@pytest.mark.parametrize("seed", range(2))
def test_padding_agrees_with_fcl(tmp_path: Path, seed: int) -> None:
    """A link and an obstacle are FREE if they are farther apart than both paddings."""
    path, rng = random_arm(tmp_path, seed), np.random.default_rng(seed)
    arm = Arm.from_urdf(path)
    poses = {
        name: pose_at(*(rng.choice([-1, 1], 3) * rng.uniform(0.3, 0.6, 3)))
        for name in ("near", "far")
    }
    links = [each.name for each in arm.links]
    inner = [(one, other) for one in links for other in links if one < other]
    space = build_arm_space(
        {name: PosedShape(Robot.box((0.5,) * 3).shape, pose) for name, pose in poses.items()},
        arm,
        allowed_collisions=[*inner, ("l0", "near"), ("l0", "far")],
        padding={"near": 0.1},
    )
    space.set_padding("l4", 0.2)
    assert space.padding == {"near": 0.1, "l4": 0.2}
    points = sample_configurations(arm, rng, 60)
    solids = {name: [box((0.5,) * 3, pose[:3, 3], pose[:3, :3])] for name, pose in poses.items()}

    def measure(name: str, link: str) -> np.ndarray:
        """Return distances of one link and one obstacle."""
        others = [(each, name) for each in links if each != link]
        oracle = ArmOracle(path, arm, {name: solids[name]}, [*inner, *others])
        return np.array([oracle.apart(q) for q in points])

    apart = {(name, link): measure(name, link) for name in poses for link in links[1:]}
    slack = np.min(
        [
            value - 0.1 * (name == "near") - 0.2 * (link == "l4")
            for (name, link), value in apart.items()
        ],
        axis=0,
    )
    free = np.asarray(space.is_free(points))
    assert 5 < free.sum() < 55
    np.testing.assert_array_equal(free, slack > 1e-6)
    least = np.min(list(apart.values()), axis=0)
    distances = np.asarray(space.obstacle_distance(points))
    assert (distances[~free] == 0.0).all()
    np.testing.assert_allclose(distances[free], least[free], rtol=1e-3, atol=1e-5)
    assert (np.asarray(space.classify(points)) != 2)[
        least > 1e-6
    ].all()  # padding proves no collision


def test_obstacles_follow_the_base_pose(tmp_path: Path) -> None:
    arm, base = Arm.from_urdf(planar(tmp_path)), pose_at(0.3, -0.2, 0.1, (0.0, 0.0, 0.7))
    shape, pose = Robot.box((0.2, 0.3, 1.0)).shape, pose_at(1.2, 0.9, 0.0, (0.0, 0.0, 0.2))
    new = build_arm_space({"post": PosedShape(shape, pose)}, arm, base_pose=base)
    space = build_arm_space({}, arm, base_pose=base)
    space.add_obstacle("post", shape, pose)
    assert_equal_answers(space, new)
    space.add_obstacle("post", PosedShape(shape, pose_at(5.0, 5.0)))
    space.add_obstacle("post", PosedShape(shape, pose))
    assert_equal_answers(space, new)


def test_copies_change_on_their_own(tmp_path: Path) -> None:
    arm = Arm.from_urdf(planar(tmp_path))
    first, second = posed_box((0.2, 0.2, 1.0), 1.5, 0.3), posed_box((0.2, 0.2, 1.0), -1.5, 0.3)
    space = build_arm_space({}, arm)
    copies = [copy.copy(space), copy.deepcopy(space), pickle.loads(pickle.dumps(space))]
    space.add_obstacle("first", first)
    for each in copies:
        assert not each.obstacles
        each.add_obstacle("second", second)
        assert_equal_answers(each, build_arm_space({"second": second}, arm))
    assert_equal_answers(space, build_arm_space({"first": first}, arm))


def test_replaced_clouds_leave_no_memory(tmp_path: Path) -> None:
    space, rng = build_arm_space({}, Arm.from_urdf(planar(tmp_path))), np.random.default_rng(1)
    tracemalloc.start()
    sizes = []
    for _ in range(20):
        space.add_obstacle("cloud", rng.uniform(3.0, 4.0, (3000, 3)), radius=0.01)
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert max(sizes[12:]) < 1.5 * sizes[10]


def test_empty_workspaces_keep_their_name(tmp_path: Path) -> None:
    space = build_arm_space({}, Arm.from_urdf(planar(tmp_path)))
    cells = np.zeros((2, 2, 2), dtype=bool)
    space.add_obstacle("scan", Workspace.from_array(~cells, 0.2, (1.4, 0.0, -0.2)))
    assert not space.is_free((0.0, 0.0))
    space.add_obstacle("scan", Workspace.from_array(cells, 0.2))
    assert space.is_free((0.0, 0.0)) and not space.obstacles
    space.remove_obstacle("scan")


BALL = Robot.ball(0.1)


@refusals(
    "call, message",
    (lambda s: s.add_obstacle("", BALL), "name is ''; it must be a non-empty string"),
    (lambda s: s.add_obstacle("fore", BALL), "name is 'fore'; a link or an attached object has it"),
    (lambda s: s.add_obstacle("tool", BALL), "choose another name, or detach it"),
    (lambda s: s.add_obstacle("a", Robot.disc(0.1)), "arms are in space"),
    (lambda s: s.add_obstacle("a", [(0.0, 0.0, 0.0)] * 4), "points need a radius"),
    (lambda s: s.add_obstacle("a", BALL, 2.0 * np.eye(4)), "it must be a rigid motion"),
    (lambda s: s.add_obstacle("a", BALL, padding=-1.0), "padding is -1.0"),
    (
        lambda s: s.add_obstacle("a", BALL, touch_links=["fort"]),
        "touch_links names 'fort'; .*did you mean 'fore'",
    ),
    (
        lambda s: s.add_obstacle("a", BALL, touch_links=3),
        "touch_links is 3; it must be a list of names",
    ),
    (
        lambda s: s.add_obstacle("a", s.obstacles["post"], radius=0.1),
        "radius is given with a PosedShape",
    ),
    (lambda s: s.remove_obstacle("pots"), "name is 'pots'; there are post; did you mean 'post'"),
    (lambda s: s.attach("cup", BALL, "for"), "link is 'for'; .*did you mean 'fore'"),
    (lambda s: s.attach("cup", BALL), "link is None; there are foot, upper, fore, tool"),
    (
        lambda s: s.attach("post", BALL, "fore"),
        "name is 'post'; an obstacle has it; leave out the shape",
    ),
    (lambda s: s.attach("tool", BALL, "fore"), "name is 'tool'; a link has it"),
    (lambda s: s.attach("cup", BALL, "fore", q=(0.0, 0.0)), "q is given for a new object"),
    (lambda s: s.attach("cup", link="fore", q=(0.0, 0.0)), "name is 'cup'; there are post"),
    (lambda s: s.attach("post", link="fore"), r"q is missing; .*pass \(shoulder, elbow\)"),
    (lambda s: s.attach("post", link="fore", q=(0.0,)), r"q has shape \(1,\)"),
    (lambda s: s.attach("post", link="fore", q=[(0.0, 0.0)]), "it must be one configuration"),
    (
        lambda s: s.attach("post", None, "fore", np.eye(4), q=(0.0, 0.0)),
        "pose is given for an obstacle",
    ),
    (lambda s: s.detach("post"), "name is 'post'; there are tool, bit"),
    (lambda s: s.detach("tool"), "name is 'tool'; it carries 'bit'; detach 'bit' first"),
    (lambda s: s.detach("bit", touch_links=["fore"]), "touch_links are given without q"),
    (lambda s: s.detach("bit", (0.0, 9.0)), "has elbow at 9"),
    (lambda s: s.set_padding("four", 0.1), "name is 'four'; .*did you mean 'fore'"),
    (lambda s: s.set_padding("fore", -0.1), "padding is -0.1"),
    (lambda s: s.allow_collisions([("fore", "sky")]), "pairs names 'sky'"),
    (lambda s: s.allow_collisions(["fore"]), "it must hold pairs of names"),
    (
        lambda s: s.forbid_collisions([("fore", "post")]),
        "pairs hold .*only allowed pairs are taken back",
    ),
    (lambda s: build_arm_space({}, s.arm, padding={"sky": 0.1}), "padding names 'sky'"),
    (
        lambda s: s.add_obstacle("a", Robot.box((0.1,) * 3), pose_at(0, 0, -0.2)),
        "foot touches obstacle 'a'",
    ),
    (lambda s: s.set_padding("post", 9.0), "foot touches obstacle 'post', or comes nearer"),
)
def test_refused_changes_change_nothing(tmp_path: Path, call: Any, message: str) -> None:
    arm = Arm.from_urdf(planar(tmp_path)).attach("tool", BALL.shape, "fore", pose_at(1.1, 0.0))
    arm = arm.attach("bit", Robot.ball(0.05).shape, "tool", pose_at(0.1, 0.0))
    space = build_arm_space({"post": posed_box((0.2, 0.2, 1.0), 1.5, 1.5)}, arm)
    before = describe(space)
    with pytest.raises((InputError, ConfigurationError), match=message):
        call(space)
    assert describe(space) == before
