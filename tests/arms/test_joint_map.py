"""Maps of two and three joints, against shapely and FCL."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cspace
import planners
from cspace import BLOCKED, FREE, MIXED
from cspace.arms import Arm, build_arm_space, build_joint_map
from cspace.errors import ConfigurationError, InputError
from tests.helpers.arm_oracle import draw_scene
from tests.helpers.refusals import check_refused
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import (
    CONTINUOUS,
    POSTS,
    build_plane_arm,
    joint,
    link,
    planar_arm_gaps,
    planar_arm_meets,
    posed_box,
    space_of,
    write_urdf,
)

LIMITED = {"limits": (-3.0, 3.0)}


def draw_border_points(joint_map, state, rng, count):
    """Draw points of cells next to cells of other states, often at corners of the cells."""
    states = np.asarray(joint_map.cell_states)
    window = np.lib.stride_tricks.sliding_window_view(
        np.pad(states, 1, mode="edge"), (3,) * states.ndim
    )
    differs = (window != state).any(axis=tuple(range(states.ndim, 2 * states.ndim)))
    cells = rng.permutation(np.argwhere((states == state) & differs))[:count]
    within = np.where(
        rng.random(cells.shape) < 0.5, rng.integers(0, 2, cells.shape), rng.random(cells.shape)
    )
    return joint_map.grid.lower + joint_map.grid.spacing * (cells + within)


@examples(6)
@given(seed=seeds, shoulder=st.sampled_from([CONTINUOUS, LIMITED]), spacing=st.floats(0.07, 0.2))
def test_joint_maps_agree_with_shapely(seed, shoulder, spacing):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-np.pi, np.pi, 4)
    reach = rng.uniform(0.5, 1.8, 4)
    sides = rng.uniform(0.1, 0.3, 4)
    posts = np.stack([reach * np.cos(angle), reach * np.sin(angle), sides], axis=1)
    space = build_plane_arm(posts, **shoulder)
    joint_map = build_joint_map(space, spacing)
    assert not planar_arm_meets(draw_border_points(joint_map, FREE, rng, 80), posts).any()
    assert planar_arm_meets(draw_border_points(joint_map, BLOCKED, rng, 80), posts).all()
    states = np.asarray(joint_map.cell_states)
    assert (states == MIXED).mean() < 2.5 * spacing


@examples(6)
@given(seed=seeds, count=st.integers(2, 3))
def test_joint_maps_agree_with_fcl(tmp_path_factory, seed, count):
    """Draw boxes on all kinds of joints, and hold the other joints."""
    space, oracle, rng = draw_scene(tmp_path_factory.mktemp("arm"), seed % 1000)
    held = space.sample_free(rng=rng)
    chosen = np.sort(rng.permutation(3)[:count])
    names = [space.arm.joints[k] for k in chosen]
    low = np.maximum(held - 1.0, space.arm.lower)[chosen]
    high = np.minimum(held + 1.0, space.arm.upper)[chosen]
    limits = dict(zip(names, zip(low, high, strict=True), strict=True))
    spacing = rng.uniform(0.05, 0.15)
    joint_map = build_joint_map(space, spacing, names, held_joints=held, limits=limits)
    for state in (FREE, BLOCKED):
        for point in draw_border_points(joint_map, state, rng, 40):
            q = held.copy()
            q[chosen] = point
            assert (oracle.apart(q) > 0.0) == (state == FREE)


def test_only_the_space_of_an_arm_has_a_map_of_joints():
    class Proxy:
        snapshot = build_plane_arm().snapshot

    with pytest.raises(InputError, match="space is a Proxy; it must be the space of an arm"):
        build_joint_map(Proxy(), 0.2)


def test_progress_begins_at_once_and_ends_with_all_steps():
    space = build_plane_arm()
    told = []

    def note(done, total):
        told.append((done, total))

    build_joint_map(space, 0.2, progress=note)
    space.arm.spheres(number=1, progress=note)
    ends = [k for k, (done, total) in enumerate(told) if done == total]
    begins = [0, *(k + 1 for k in ends[:-1])]
    assert len(ends) == 2 and all(told[k][0] == 0 for k in begins)


def measure_distances(q):
    """Return the distances of two bars of 1 m from posts and the foot below, by shapely."""
    foot = planar_arm_gaps(q, [(0.0, 0.0, 0.05)], ("fore",))[0, :, 0]
    return np.minimum(planar_arm_gaps(q, POSTS).min(axis=(0, 2)), np.hypot(foot, 0.125))


def test_obstacle_distances_are_those_of_the_bars():
    """Distances are metres of the workspace, at configurations and all along paths."""
    joint_map = build_joint_map(build_plane_arm(), 0.1)
    q = joint_map.sample_free(20, rng=np.random.default_rng(3))
    expected = measure_distances(q)
    found = joint_map.obstacle_distance(q)
    assert (found <= expected + 1e-9).all() and (found >= 0.999 * expected - 1e-6).all()
    assert joint_map.obstacle_distance(tuple(q[0])) == found[0]
    for start, goal in zip(q[::2], q[1::2], strict=True):
        path = planners.plan(joint_map, start, goal).waypoints
        if not len(path):
            continue
        between = np.linspace(path[:-1], path[1:], 200).reshape(-1, 2)
        true = measure_distances(between).min()
        bound = joint_map.path_obstacle_distance(path)
        # Within a quarter of a cell, both joints move the tip by at most 3 m a radian.
        assert true - 0.025 * 3.0 - 1e-3 <= bound <= true + 1e-9
        middle = 0.5 * (path[0] + path[1])
        length = float(np.linalg.norm(path[1] - path[0]))
        piece = measure_distances(np.linspace(path[0], path[1], 200)).min()
        assert joint_map.obstacle_distance(middle, length) <= piece + 1e-9


def test_a_map_of_joints_without_its_arm_refuses_distances(tmp_path):
    joint_map = build_joint_map(build_plane_arm(), 0.2)
    q0, q1 = joint_map.nearest_free((2.0, 0.0)), joint_map.nearest_free((2.5, 0.0))
    joint_map.save(tmp_path / "joints.zarr")
    changed = build_joint_map(build_plane_arm(), 0.2)
    changed.update(np.ones((1, 1), dtype=bool), (0, 0))
    for other in (cspace.open(tmp_path / "joints.zarr"), changed):
        check_refused(
            lambda other=other: other.obstacle_distance(q0),
            "the map is one of joints, without the geometry of its arm ... distances",
        )
        assert np.isnan(other.path_obstacle_distance([q0, q1]))
        plan = planners.plan(other, q0, q1)
        assert np.isnan(plan.obstacle_distance)
        assert plan.length_unit == "rad"
    plan = planners.plan(joint_map, q0, q1)
    assert plan.obstacle_distance >= 0.0
    assert plan.obstacle_distance <= measure_distances(np.linspace(q0, q1, 99)).min() + 1e-9


def test_a_map_of_joints_is_no_picture_of_the_workspace(tmp_path):
    joint_map = build_joint_map(build_plane_arm(), 0.2)
    for call in (joint_map.to_costmap, joint_map.to_occupancy_grid):
        check_refused(call, "the map is one of joints ... metres")
    check_refused(
        lambda: joint_map.export(tmp_path / "joints.yaml"),
        ".yaml holds places in metres, and the cells are in rad",
    )
    q = joint_map.nearest_free((2.0, 0.0))
    check_refused(
        lambda: joint_map.contains_robot(q),
        "the map is one of joints ... rigid",
    )


def test_joints_named_as_axes_are_no_poses(tmp_path):
    """Two joints that slide along x and y, and are called so, move an arm and no rigid body."""
    box = ((0.1, 0.1, 0.1), (0, 0, 0))
    slide = {"kind": "prismatic", "limits": (0.0, 1.0)}
    file = write_urdf(
        tmp_path,
        link("base"),
        link("carriage", box),
        link("tool", ((0.5, 0.1, 0.1), (0.25, 0, 0.5))),
        joint("x", "base", "carriage", axis=(1, 0, 0), **slide),
        joint("y", "carriage", "tool", axis=(0, 1, 0), **slide),
    )
    space = build_arm_space({"post": posed_box((0.1, 0.1, 3.0), 1.6, 0.5)}, Arm.from_urdf(file))
    joint_map = build_joint_map(space, 0.1)
    joint_map.save(tmp_path / "gantry.zarr")
    for each in (joint_map, cspace.open(tmp_path / "gantry.zarr")):
        assert not each.has_poses and each.units == ("m", "m")
        with pytest.raises(InputError, match="is one of joints"):
            each.to_costmap()
    # The tool is 0.5 m long, so that its tip is nearer to the post than the joints are.
    assert joint_map.obstacle_distance((0.5, 0.5)) == pytest.approx(0.55, abs=1e-3)


@pytest.mark.parametrize("shoulder", [CONTINUOUS, LIMITED], ids=["continuous", "limited"])
def test_exact_queries_agree_with_the_arm(shoulder):
    """Include turns beyond the map, copies, plans and changed cells."""
    rng = np.random.default_rng(6)
    space = build_plane_arm(**shoulder)
    joint_map = build_joint_map(space, 0.3, limits={"elbow": (-2.0, 2.0)})
    most = (9.0, 2.0) if shoulder is CONTINUOUS else (3.0, 2.0)
    q = rng.uniform(-1.0, 1.0, (300, 2)) * most
    targets = np.clip(q + rng.normal(scale=0.6, size=q.shape), np.negative(most), most)
    free = np.asarray(space.is_free(q))
    moves = np.asarray(space.motion_is_free(q, targets))
    assert planar_arm_meets(q, POSTS).tolist() == (~free).tolist()
    for same in (joint_map, pickle.loads(pickle.dumps(joint_map))):
        np.testing.assert_array_equal(same.exact.is_free(q), free)
        np.testing.assert_array_equal(same.exact.motion_is_free(q, targets), moves)
        walk = same.exact.edge_checker()
        motions = zip(q[:40], targets[:40], strict=True)
        assert [walk(*a, *b) for a, b in motions] == moves[:40].tolist()
    beyond_map = 1.5, 2.5
    beyond_joint = 1.5, 3.1
    for outside, is_free in ((beyond_map, True), (beyond_joint, False)):
        assert joint_map.classify(outside) == MIXED
        assert joint_map.exact.is_free(outside) == is_free
        assert joint_map.exact.motion_is_free((1.5, 1.9), outside) == is_free
    undecided = free & (joint_map.classify(q) == MIXED) & joint_map.grid.contains(q)
    assert undecided.sum() > 10
    center = q[undecided][0]
    check = joint_map.exact.point_checker()
    assert check(*center)
    joint_map.add_obstacle("closed", [center], radius=0.01)
    assert not check(*center) and not joint_map.exact.is_free(center)
    assert not (joint_map.exact.is_free(q) & ~free).any()


@pytest.mark.parametrize("limits", [(-np.pi, np.pi), (-3.0, 9.0), (-9.0, 3.0)])
def test_a_way_around_a_continuous_joint_is_undecided(limits):
    """The arm can turn past the ends of the map, so that no map that ends there excludes a path."""
    space = build_plane_arm(POSTS[:1], **CONTINUOUS)
    given = None if limits[1] == np.pi else {"shoulder": limits}
    joint_map = build_joint_map(space, 0.1, limits=given)
    left = -1.0, 0.3
    right = 1.0, -0.3
    assert joint_map.grid.lower[0] == limits[0]
    assert not joint_map.is_connected(left, right)
    assert not joint_map.is_disconnected(left, right)
    low, high = limits
    outside = [(low - 1e-6, 0.3), (high + 0.2, 0.3), (-1e9, 0.3), (1e9, 0.3)]
    assert (joint_map.classify(outside) == MIXED).all()
    assert joint_map.classify([(0.5, -3.5), (0.5, 3.5)]).tolist() == [BLOCKED, BLOCKED]


def test_prismatic_joints_and_limits_between_cells_are_mapped(tmp_path):
    path = write_urdf(
        tmp_path,
        link("foot"),
        link("bar", ((1.0, 0.1, 0.1), (0.5, 0, 0))),
        link("quill", ((0.1, 0.1, 1.0), (0, 0, 0))),
        joint("turn", "foot", "bar", **CONTINUOUS),
        joint("lift", "bar", "quill", at=(1, 0, 0), kind="prismatic", limits=(0.0, 0.42)),
    )
    table = {"table": posed_box((1.0, 1.0, 0.2), 1.0, 0.0, -0.5)}
    space = build_arm_space(table, Arm.from_urdf(path))
    joint_map = build_joint_map(space, 0.05, limits={"turn": (-3.0, 3.0)})
    assert joint_map.grid.units == ("rad", "m")
    assert joint_map.grid.shape == (120, 9)
    assert joint_map.classify([(0.0, 0.3), (0.0, 0.01), (2.0, 0.01)]).tolist() == [
        FREE,
        BLOCKED,
        FREE,
    ]
    # The last cells end at 0.45 m, beyond the limit.
    states = np.asarray(joint_map.cell_states)
    assert (states[:, -1] != FREE).all() and (states[:, -2] == FREE).any()


def test_a_joint_at_its_limit_is_in_the_map_in_spite_of_rounding():
    lower = -3.2
    upper = 0.05
    # Rounding ends 65 cells before the limit.
    assert lower + 65 * 0.05 < upper
    space = build_plane_arm(((9.0, 9.0, 0.1),), limits=(lower, upper))
    joint_map = build_joint_map(space, 0.05)
    at_limit = upper, 0.01
    assert space.motion_is_free((0.01, 0.01), at_limit)
    assert joint_map.classify(at_limit) != BLOCKED
    assert not joint_map.is_disconnected((0.01, 0.01), at_limit)


def test_joints_mimicked_by_whole_turns_need_no_limits(tmp_path):
    """A turn of a joint restores an arm that follows it by two."""
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    path = write_urdf(
        tmp_path,
        *(link(name, bar) for name in "abcd"),
        joint("one", "a", "b", at=(1, 0, 0), **CONTINUOUS),
        joint("two", "b", "c", at=(1, 0, 0), extra='<mimic joint="one" multiplier="-2"/>'),
        joint("three", "c", "d", at=(1, 0, 0)),
    )
    space = build_arm_space({}, Arm.from_urdf(path))
    assert build_joint_map(space, 0.5).grid.lower[0] == -np.pi


def test_held_joints_must_keep_links_apart(tmp_path):
    bar = ((0.8, 0.1, 0.1), (0.5, 0, 0))
    joints = [joint(f"{k}", "abcde"[k], "abcde"[k + 1], at=(1, 0, 0)) for k in range(4)]
    path = write_urdf(tmp_path, *(link(name, bar) for name in "abcde"), *joints)
    space = build_arm_space({}, Arm.from_urdf(path))
    with pytest.raises(ConfigurationError, match="has 3 at 5"):
        build_joint_map(space, 0.5, ("0", "1"), held_joints=(0, 0, 0, 5))
    with pytest.raises(ConfigurationError, match=r"has c touch 'a'.*2, 3 do not move them apart"):
        build_joint_map(space, 0.5, ("2", "3"), held_joints=(2.2, 2.2, 0, 0))


def test_cells_of_which_none_is_free_are_named():
    space = space_of()
    with pytest.warns(UserWarning, match="no cell of the joint map is FREE"):
        build_joint_map(space, 5.0)
    assert (build_joint_map(space, 0.1).cell_states == FREE).any()
