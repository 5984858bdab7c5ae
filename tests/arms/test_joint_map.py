"""Maps of two and three joints, against shapely and FCL."""

import copy
import itertools
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import label

import cspace
import planners
from benchmarks.suites.arm_peers import Meshes, coal_solids, our_solids
from cspace import BLOCKED, FREE, MIXED, CSpace
from cspace.arms import Arm, ArmSpace, build_arm_space, build_joint_map, undecided_pairs
from cspace.errors import ConfigurationError, InputError
from tests.arms.test_space import draw_scene
from tests.helpers.maps import proven_paths
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import joint, link, planar, pose_at, posed_box, write_urdf
from tests.soak.plane import place_polygon

POSTS = ((1.3, 0.9, 0.5), (-0.9, 1.2, 0.4), (0.2, -1.5, 0.7))
"""Centers of square posts, and their sides, metres."""


def build_plane_arm(
    folder: Path, limits: tuple[float, float] = (-3.0, 3.0), posts: Any = POSTS
) -> ArmSpace:
    """Build two bars among posts."""
    shapes = {
        f"post{k}": posed_box((side, side, 2.0), x, y, 0) for k, (x, y, side) in enumerate(posts)
    }
    return build_arm_space(shapes, Arm.from_urdf(planar(folder, limits=limits)))


def meets_posts(q: Any, posts: Any = POSTS, bars: Any = ("upper", "fore")) -> Any:
    """Return True where the bars meet a post, by shapely."""
    (first, second), bar = np.transpose(q), shapely.box(0.0, -0.05, 1.0, 0.05)
    upper = place_polygon(
        bar, np.stack([np.zeros_like(first), np.zeros_like(first), first], axis=1)
    )
    fore = place_polygon(bar, np.stack([np.cos(first), np.sin(first), first + second], axis=1))
    squares = [shapely.box(x - s / 2, y - s / 2, x + s / 2, y + s / 2) for x, y, s in posts]
    chosen = np.array([{"upper": upper, "fore": fore}[name] for name in bars])
    return shapely.intersects(chosen[:, None], np.array(squares)[:, None]).any(axis=(0, 1))


def test_joint_map_of_a_plane_arm_agrees_with_shapely(tmp_path: Path) -> None:
    """Test configurations in cells, also at their corners."""
    space = build_plane_arm(tmp_path)
    joint_map = build_joint_map(space, 6.0 / 150)
    assert isinstance(joint_map, CSpace)
    assert (joint_map.axes, joint_map.grid.units, joint_map.grid.shape) == (
        ("shoulder", "elbow"),
        ("rad", "rad"),
        (150, 150),
    )
    rng = np.random.default_rng(3)
    wrong = []
    for state, collides in ((FREE, True), (BLOCKED, False)):
        cells = np.argwhere(joint_map.cell_states == state)
        # Cells next to other states reveal bounds that are too weak.
        near = np.array(
            [
                (joint_map.cell_states[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] != state).any()
                for i, j in cells
            ]
        )
        sample = cells[near][rng.permutation(near.sum())[:250]]
        within = np.where(
            rng.random((len(sample), 2)) < 0.5,
            rng.integers(0, 2, (len(sample), 2)),
            rng.random((len(sample), 2)),
        )
        points = joint_map.grid.lower + joint_map.grid.spacing * (sample + within)
        wrong += points[meets_posts(points) == collides].tolist()
    assert not wrong
    free, mixed, blocked = joint_map.count()
    truth = meets_posts(rng.uniform(-3.0, 3.0, (400, 2))).mean()
    assert mixed < 0.1 * joint_map.grid.size
    assert (
        free / joint_map.grid.size - 0.05
        < 1.0 - truth
        < (free + mixed) / joint_map.grid.size + 0.05
    )
    assert blocked > 0.5 * truth * joint_map.grid.size


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_joint_map_of_three_joints_agrees_with_fcl(tmp_path: Path, seed: int) -> None:
    """Draw boxes on all kinds of joints; hold others."""
    space, oracle, rng = draw_scene(tmp_path, seed)
    configurations = space.sample_free(50, rng)
    held = configurations[np.argmax(space.obstacle_distance(configurations))]
    names = space.arm.joints[:3]
    intervals = np.stack(
        [np.maximum(held - 1.0, space.arm.lower), np.minimum(held + 1.0, space.arm.upper)], axis=1
    )
    limits = dict(zip(names, map(tuple, intervals.tolist()), strict=False))
    joint_map = build_joint_map(space, 0.05, names, held_joints=held, limits=limits)
    states = np.asarray(joint_map.cell_states)
    assert all((states == state).any() for state in (FREE, BLOCKED))
    for state, apart in ((FREE, True), (BLOCKED, False)):
        cells = np.argwhere(states == state)
        for cell in cells[rng.permutation(len(cells))[:25]]:
            q = held.copy()
            q[: len(names)] = joint_map.grid.lower + joint_map.grid.spacing * (
                cell + rng.integers(0, 2, len(names))
            )
            assert (oracle.apart(q) > 0.0) == apart


@settings(max_examples=4)
@given(seed=st.integers(0, 2**32 - 1))
def test_maps_of_two_joints_agree_with_fcl(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    """Draw boxes on all kinds of joints, and cells whose neighbours have another state."""
    space, oracle, rng = draw_scene(tmp_path_factory.mktemp("arm"), seed)
    held = space.sample_free(None, rng)
    chosen = np.sort(rng.permutation(3)[:2])
    names = [space.arm.joints[k] for k in chosen]
    low, high = np.maximum(held - 1.5, space.arm.lower), np.minimum(held + 1.5, space.arm.upper)
    limits = {name: (float(low[k]), float(high[k])) for name, k in zip(names, chosen, strict=True)}
    spacing = float(rng.uniform(0.05, 0.15))
    joint_map = build_joint_map(space, spacing, names, held_joints=held, limits=limits)
    states = np.asarray(joint_map.cell_states)
    for state, apart in ((FREE, True), (BLOCKED, False)):
        cells = np.argwhere(states == state)
        near = [
            (states[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] != state).any() for i, j in cells
        ]
        cells = cells[np.array(near, dtype=np.bool_)]
        for cell in cells[rng.permutation(len(cells))[:60]]:
            within = np.where(rng.random(2) < 0.6, rng.integers(0, 2, 2), rng.random(2))
            q = held.copy()
            q[chosen] = joint_map.grid.lower + joint_map.grid.spacing * (cell + within)
            assert (oracle.apart(q) > 0.0) == apart


def test_undecided_pairs_are_those_that_touch_in_the_cell(tmp_path: Path) -> None:
    """Compare with the bars and posts that touch or nearly touch somewhere in a cell."""
    space = build_plane_arm(tmp_path)
    joint_map = build_joint_map(space, 0.1)
    pairs, mixed = undecided_pairs(joint_map), np.argwhere(joint_map.cell_states == MIXED)
    assert sum(pairs.values()) == len(mixed)
    assert list(pairs.values()) == sorted(pairs.values(), reverse=True)
    within = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 5)] * 2), axis=-1).reshape(-1, 2)
    for cell in mixed[:: len(mixed) // 40]:
        ((pair, count),) = undecided_pairs(
            joint_map, joint_map.grid.lower + joint_map.grid.spacing * (cell + 0.5)
        ).items()
        assert count == 1 and pair[0] in ("upper", "fore")
        x, y, side = POSTS[int(pair[1][-1])]
        wider = ((x, y, side + 0.04),)  # the nearest pair at the center may touch only just outside
        points = joint_map.grid.lower + joint_map.grid.spacing * (cell + within)
        touching = [meets_posts(points, wider, bars=(pair[0],)).any()]
        assert touching == [True]
    assert undecided_pairs(joint_map, joint_map.sample_free(20, np.random.default_rng(1))) == {}
    assert (
        undecided_pairs(build_joint_map(space, 0.1, limits={"elbow": (2.8, 2.95)}), (0.0, 2.97))
        == {}
    )


def test_undecided_pairs_need_the_geometry(tmp_path: Path) -> None:
    joint_map = build_joint_map(build_plane_arm(tmp_path), 0.3)
    joint_map.save(tmp_path / "map.zarr")
    opened = cspace.open(tmp_path / "map.zarr")
    assert isinstance(opened, CSpace)
    for changed in (copy.deepcopy(joint_map), pickle.loads(pickle.dumps(joint_map))):
        assert undecided_pairs(changed) == undecided_pairs(joint_map)
        changed.add_obstacle("closed", [(2.5, 0.5)], radius=0.1)
        with pytest.raises(InputError, match="joint_map has no geometry of an arm"):
            undecided_pairs(changed)
    with pytest.raises(InputError, match="joint_map has no geometry of an arm"):
        undecided_pairs(opened)
    with pytest.raises(InputError, match="q"):
        undecided_pairs(joint_map, (0.0, 0.0, 0.0))


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning", "ignore:.*without collision geometry")
@pytest.mark.parametrize(
    "robot, names, spacing, min_free, max_mixed",
    [
        ("panda", ("panda_joint1", "panda_joint2"), 0.08, 0.7, 0.3),
        ("ur5", ("shoulder_pan_joint", "elbow_joint"), 0.06, 0.7, 0.1),
    ],
)
def test_maps_of_real_arms_agree_with_coal(
    data: Path,
    robot: str,
    names: tuple[str, str],
    spacing: float,
    min_free: float,
    max_mixed: float,
) -> None:
    """Place a box beside the arm; include the pairs of links that few joints move."""
    pytest.importorskip("pinocchio")
    folder, rng = data / "arms" / robot, np.random.default_rng(2)
    arm = Arm.from_urdf(folder / f"{robot}.urdf", folder / f"{robot}.srdf")
    solids = [("box", "box", pose_at(0.5, 0.3, 0.5), (0.2, 0.2, 0.4))]
    space = build_arm_space(our_solids(solids), arm)
    meshes = Meshes(
        folder / f"{robot}.urdf", arm.joints, coal_solids(solids), folder / f"{robot}.srdf"
    )
    held = (
        np.array([0.0, 0.3, 0.0, -1.8, 0.0, 1.9, 0.6])
        if robot == "panda"
        else np.array([0.0, -1.2, 1.4, -1.0, -1.5, 0.0])
    )
    joint_map = build_joint_map(space, spacing, names, held_joints=held)
    states, indices = np.asarray(joint_map.cell_states), [arm.joints.index(name) for name in names]
    free, mixed, _ = np.array(joint_map.count()) / states.size
    assert free > min_free and mixed < max_mixed
    for state in (FREE, BLOCKED):
        cells = np.argwhere(states == state)
        near = np.array(
            [
                (states[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] != state).any()
                for i, j in cells
            ]
        )
        for cell in rng.permutation(cells[near])[:60]:
            q = held.copy()
            q[indices] = joint_map.grid.lower + joint_map.grid.spacing * (
                cell + rng.integers(0, 2, 2)
            )
            if state == FREE:
                assert not meshes.is_wrong(q)
            else:
                assert meshes.collides(q)


def test_disconnected_configurations_have_no_path(tmp_path: Path) -> None:
    """Split the range of the upper arm by a post."""
    posts = ((0.7, 0.0, 0.3),)
    space = build_plane_arm(tmp_path, (-1.5, 1.5), posts)
    joint_map = build_joint_map(space, 0.05)
    left, right = (-1.0, 0.3), (1.0, -0.3)
    assert joint_map.is_disconnected(left, right)
    assert joint_map.is_connected(left, (-0.9, -1.0))
    q = np.stack(
        np.meshgrid(np.linspace(-1.5, 1.5, 61), np.linspace(-3.0, 3.0, 61), indexing="ij"), axis=-1
    )
    free = ~meets_posts(q.reshape(-1, 2), posts).reshape(61, 61)
    parts, _ = label(free, np.ones((3, 3)))
    near = [
        tuple(np.abs(q - end).sum(axis=-1).argmin() // np.array([61, 1]) % 61)
        for end in (left, right)
    ]
    assert parts[near[0]] != parts[near[1]]


def test_joint_map_supports_all_queries(tmp_path: Path) -> None:
    """Prove edges and paths of the map by the arm."""
    space = build_plane_arm(tmp_path)
    joint_map = build_joint_map(space, 0.05)
    rng = np.random.default_rng(5)
    q = joint_map.sample_free(100, rng)
    edges = joint_map.motion_is_free(q[:-1], q[1:])
    assert 0 < edges.sum() < len(edges)
    assert np.all(space.motion_is_free(q[:-1][edges], q[1:][edges]))
    start, goal = joint_map.nearest_free((-2.5, 1.0)), joint_map.nearest_free((2.5, 0.5))
    for path in (
        joint_map.find_path(start, goal),
        joint_map.find_widest_path(start, goal),
        planners.plan(joint_map, start, goal, seed=1).path,
    ):
        assert len(path) > 1
        assert joint_map.certify_path(path).all()
        assert np.all(space.certify_path(path))
    assert joint_map.clearance(start) > 0.0
    assert joint_map.classify((3.1, 0.0)) == BLOCKED  # beyond the limits
    assert joint_map.robot.name == "small"
    joint_map.save(tmp_path / "map.zarr")
    again = cspace.open(tmp_path / "map.zarr")
    assert type(again) is CSpace  # files do not store the geometry of the arm
    assert again.grid == joint_map.grid
    assert repr(joint_map) == repr(again).replace("CSpace", "JointMap")
    np.testing.assert_array_equal(again.cell_states, joint_map.cell_states)
    dataset = joint_map.to_xarray()
    assert dataset.cell_states.dims == ("shoulder", "elbow")
    assert dataset.elbow.attrs["units"] == "rad"
    ax = joint_map.plot(path=joint_map.find_path(start, goal))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("shoulder (rad)", "elbow (rad)")
    # Obstacles may also be added in joint space.
    assert (
        joint_map.add_obstacle("keep out", [(2.4, 0.4), (2.6, 0.4), (2.6, 0.6), (2.4, 0.6)]).changed
        > 0
    )
    assert not joint_map.is_free((2.5, 0.5))


def test_prismatic_joints_and_limits_between_cells_are_mapped(tmp_path: Path) -> None:
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    path = write_urdf(
        tmp_path,
        link("foot"),
        link("bar", bar),
        link("quill", ((0.1, 0.1, 1.0), (0, 0, 0))),
        joint("turn", "foot", "bar", limits=None, kind="continuous"),
        joint("lift", "bar", "quill", at=(1, 0, 0), kind="prismatic", limits=(0.0, 0.42)),
    )
    wall = {"table": posed_box((1.0, 1.0, 0.2), 1.0, 0.0, -0.5)}
    space = build_arm_space(wall, Arm.from_urdf(path))
    assert build_joint_map(space, 0.05).grid.lower == (-np.pi, 0.0)
    joint_map = build_joint_map(space, 0.05, limits={"turn": (-3.0, 3.0)})
    assert joint_map.grid.units == ("rad", "m")
    assert joint_map.grid.shape == (120, 9)
    assert (joint_map.cell_states[:, -1] != FREE).all()
    assert joint_map.classify((0.0, 0.3)) == FREE
    assert joint_map.classify((0.0, 0.01)) == BLOCKED
    assert joint_map.classify((2.0, 0.01)) == FREE
    assert joint_map.grid.unit == "rad or m"


def build_turning_arm(folder: Path, posts: Any, **elbow: Any) -> ArmSpace:
    """Build two bars on a continuous shoulder among posts."""
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    path = write_urdf(
        folder,
        *(link(name, bar) for name in ("upper", "fore")),
        link("foot", ((0.02, 0.02, 0.02), (0, 0, -1.0))),
        joint("shoulder", "foot", "upper", limits=None, kind="continuous"),
        joint("elbow", "upper", "fore", at=(1, 0, 0), **elbow),
    )
    shapes = {f"post{k}": posed_box((s, s, 2.0), x, y, 0) for k, (x, y, s) in enumerate(posts)}
    return build_arm_space(shapes, Arm.from_urdf(path))


@pytest.mark.parametrize("circle", [True, False])
def test_exact_queries_agree_with_the_arm(tmp_path: Path, circle: bool) -> None:
    """Include turns beyond the map, copies, plans and changed cells."""
    posts, rng = ((0.7, 0.0, 0.3), (-0.9, 1.2, 0.4)), np.random.default_rng(6)
    space = build_turning_arm(tmp_path, posts) if circle else build_plane_arm(tmp_path, posts=posts)
    joint_map = build_joint_map(space, 0.3, limits={"elbow": (-2.0, 2.0)})
    low, high = np.array([(-9.0, 9.0) if circle else (-3.0, 3.0), (-2.0, 2.0)]).T
    q = rng.uniform(low, high, (300, 2))
    targets = np.clip(q + rng.normal(scale=0.6, size=q.shape), low, high)
    free, moves = np.asarray(space.is_free(q)), np.asarray(space.motion_is_free(q, targets))
    for each in (joint_map, copy.deepcopy(joint_map), pickle.loads(pickle.dumps(joint_map))):
        np.testing.assert_array_equal(each.is_free(q, exact=True), free)
        np.testing.assert_array_equal(each.motion_is_free(q, targets, exact=True), moves)
        check, walk = each.point_checker(exact=True), each.edge_checker(exact=True)
        assert [check(*a) for a in q[:40]] == free[:40].tolist()
        assert [walk(*a, *b) for a, b in zip(q[:40], targets[:40], strict=True)] == moves[
            :40
        ].tolist()
    assert meets_posts(q, posts).tolist() == (~free).tolist()
    mixed = free & (joint_map.classify(q) == MIXED)
    assert mixed.sum() > 30
    beyond_map, beyond_joint = (1.5, 2.5), (1.5, 3.1)
    assert joint_map.classify(beyond_map) == MIXED and joint_map.is_free(beyond_map, exact=True)
    assert joint_map.classify(beyond_joint) == MIXED and not joint_map.is_free(
        beyond_joint, exact=True
    )
    on_map = q[mixed & joint_map.grid.contains(q)]
    plans = [
        planners.plan(joint_map, a, b, exact=True, seed=1) for a, b in on_map[:6].reshape(-1, 2, 2)
    ]
    assert any(plan.certified for plan in plans)
    assert not any(plan.certified and plan.is_disconnected for plan in plans)
    assert not any(meets_posts(plan.path, posts).any() for plan in plans)
    center = on_map[0]
    check, walk = joint_map.point_checker(exact=True), joint_map.edge_checker(exact=True)
    assert check(*center) and walk(*center, *center)
    joint_map.add_obstacle("closed", [center], radius=0.01)  # its cells stay MIXED
    assert not (check(*center) or walk(*center, *center) or joint_map.is_free(center, exact=True))
    assert not (joint_map.is_free(q, exact=True) & ~free).any()


POST: Any = ((0.7, 0.0, 0.3),)
"""A post on the right, which stops the bar at an angle of zero but not of pi."""


@pytest.mark.parametrize(
    "limits",
    [None, {"shoulder": (-2.0, 2.0)}, {"shoulder": (-3.0, 9.0)}, {"shoulder": (-9.0, 3.0)}],
)
def test_a_way_around_a_continuous_joint_is_undecided(tmp_path: Path, limits: Any) -> None:
    """The arm can turn past the ends of the map, so that no map that ends there excludes a path."""
    space = build_turning_arm(tmp_path, POST)
    joint_map = build_joint_map(space, 0.05, limits=limits)
    left, right = (-1.0, 0.3), (1.0, -0.3)
    assert not joint_map.is_connected(left, right)
    assert not joint_map.is_disconnected(left, right)
    low, high = (limits or {"shoulder": (-np.pi, np.pi)})["shoulder"]
    outside = np.array([(low - 1.0, 0.3), (high + 1.0, 0.3), (-1e9, 0.3), (1e9, 0.3)])
    assert (joint_map.classify(outside) == MIXED).all()
    assert joint_map.classify([(0.5, -3.5), (0.5, 3.5)]).tolist() == [BLOCKED, BLOCKED]


def test_only_the_mapped_part_of_a_range_leaves_a_way_around(tmp_path: Path) -> None:
    """A joint cannot go beyond its own limits."""
    space = build_plane_arm(tmp_path, posts=POST)
    left, right = (-1.0, 0.3), (1.0, -0.3)
    assert build_joint_map(space, 0.05).is_disconnected(left, right)
    assert not build_joint_map(space, 0.05, limits={"shoulder": (-2.0, 2.0)}).is_disconnected(
        left, right
    )


OBSTACLES = ((1.6, 0.0, 0.3), (0.7, 1.1, 0.3))
"""Posts in front of the arm; the shorter way round is behind it."""

STRETCHED = (3.0, 0.4), (-3.0, 0.4), (-0.7, 1.0)
FOLDED = (2.2, 2.9), (-2.4, -2.9), (2.0, 2.5), (-1.5, -2.5)


@pytest.mark.parametrize("elbow", [{"limits": None, "kind": "continuous"}, {"limits": (-3.0, 3.0)}])
@pytest.mark.parametrize("spacing", [0.3, 2.2])
@pytest.mark.parametrize("planner", [None, "Grid", "RRTConnect"])
def test_certified_trajectories_meet_no_obstacle(
    tmp_path: Path, elbow: dict[str, Any], spacing: float, planner: str | None
) -> None:
    space = build_turning_arm(tmp_path, OBSTACLES, **elbow)
    joint_map, found = build_joint_map(space, spacing), 0
    options: dict[str, Any] = {"planner": planner, "exact": True, "seed": 1, "time_limit": 5.0}
    for start, goal in itertools.permutations(STRETCHED + FOLDED, 2):
        plan = planners.plan(joint_map, start, goal, **options)
        if plan.certified:
            trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=1.0)
            positions = trajectory.sample(np.linspace(0.0, trajectory.duration, 500))[0]
            assert not meets_posts(positions, OBSTACLES).any()
            found += 1
    assert found


@settings(max_examples=3)
@given(
    seed=st.integers(0, 2**32 - 1),
    elbow=st.sampled_from([{"limits": None, "kind": "continuous"}, {"limits": (-2, 2)}]),
)
def test_joint_maps_agree_with_shapely(
    tmp_path_factory: pytest.TempPathFactory, seed: int, elbow: dict[str, Any]
) -> None:
    """Test states and connectivity among random posts."""
    rng = np.random.default_rng(seed)
    angle, reach = rng.uniform(-np.pi, np.pi, 4), rng.uniform(0.5, 1.8, 4)
    posts = tuple(
        zip(reach * np.cos(angle), reach * np.sin(angle), rng.uniform(0.1, 0.3, 4), strict=True)
    )
    space = build_turning_arm(tmp_path_factory.mktemp("arm"), posts, **elbow)
    joint_map = build_joint_map(space, 0.12)
    states = np.asarray(joint_map.cell_states)
    for state, collides in ((FREE, True), (BLOCKED, False)):
        cells = np.argwhere(states == state)
        near = np.array(
            [
                (np.take(states, [k - 1, k, k + 1], 0, mode="clip")[:, j] != state).any()
                for k, j in cells
            ]
        )
        sample = rng.permutation(cells[near])[:40]
        points = joint_map.grid.lower + joint_map.grid.spacing * (
            sample + rng.integers(0, 2, sample.shape)
        )
        assert not (meets_posts(points, posts) == collides).any()
    q = np.stack(
        np.meshgrid(*(joint_map.grid.centers(axis) for axis in range(2)), indexing="ij"), axis=-1
    ).reshape(-1, 2)
    for max_state, answer in ((FREE, True), (MIXED, False)):
        # Whatever is not BLOCKED at the rim may be joined around a continuous joint.
        open_cells = np.pad(states <= max_state, 1, constant_values=max_state == MIXED)
        parts = label(open_cells)[0][1:-1, 1:-1]
        parts, pairs = parts.reshape(-1), rng.integers(0, len(q), (300, 2))
        pairs = pairs[(states.reshape(-1)[pairs] == FREE).all(axis=1)]
        same = (parts[pairs[:, 0]] == parts[pairs[:, 1]]) & (parts[pairs[:, 0]] > 0)
        exists = proven_paths(joint_map, q[pairs[:, 0]], q[pairs[:, 1]])
        np.testing.assert_array_equal(exists == answer, same == answer)


def test_joints_mimicked_by_a_fraction_need_limits(tmp_path: Path) -> None:
    """Mimic a continuous joint by half its angle.

    A turn of the joint does not restore the arm.
    """
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    follows = '<mimic joint="one" multiplier="{}"/>'
    for factor, good in (("0.5", False), ("-2", True)):
        path = write_urdf(
            tmp_path,
            *(link(name, bar) for name in "abcd"),
            joint("one", "a", "b", at=(1, 0, 0), limits=None, kind="continuous"),
            joint("two", "b", "c", at=(1, 0, 0), extra=follows.format(factor)),
            joint("three", "c", "d", at=(1, 0, 0)),
        )
        space = build_arm_space({}, Arm.from_urdf(path))
        if good:
            assert build_joint_map(space, 0.5).grid.lower[0] == -np.pi
        else:
            with pytest.raises(
                InputError, match=r"limits are missing for 'one'.*moves others by another angle"
            ):
                build_joint_map(space, 0.5)


@refusals(
    "options, message",
    ({"joints": ("shoulder", "wrist")}, "name 'wrist'; there are shoulder, elbow"),
    ({"joints": ("elbow",), "held_joints": (0.0, 0.0)}, "two or three different joints"),
    ({"joints": ("elbow", "elbow")}, "two or three different joints"),
    ({"spacing": 0.0}, "spacing is 0.0"),
    ({"limits": {"elbow": (-4.0, 1.0)}}, "within -3 and 3"),
    ({"limits": {"elbow": (1.0, 1.0)}}, "two ascending numbers"),
    ({"spacing": 1e-5}, r"cells of 1e-05 rad and needs"),
)
def test_build_joint_map_refuses_invalid_arguments(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        build_joint_map(build_plane_arm(tmp_path), **{"spacing": 0.1, **options})


def test_held_joints_must_keep_links_apart(tmp_path: Path) -> None:
    bar = ((0.8, 0.1, 0.1), (0.5, 0, 0))
    path = write_urdf(
        tmp_path,
        *(link(name, bar) for name in "abcde"),
        *(joint(f"{k}", "abcde"[k], "abcde"[k + 1], at=(1, 0, 0)) for k in range(4)),
    )
    space = build_arm_space({}, Arm.from_urdf(path))
    with pytest.raises(InputError, match="held_joints is missing; the map holds 2, 3 still"):
        build_joint_map(space, 0.5, ("0", "1"))
    with pytest.raises(InputError, match="has 3 at 5"):
        build_joint_map(space, 0.5, ("0", "1"), held_joints=(0, 0, 0, 5))
    with pytest.raises(ConfigurationError, match=r"has c touch 'a'.*2, 3 do not move them apart"):
        build_joint_map(space, 0.5, ("2", "3"), held_joints=(2.2, 2.2, 0, 0))
    assert (
        build_joint_map(space, 0.1, ("1", "2"), held_joints=(0, 0, 0, 0)).cell_states == MIXED
    ).any()


@pytest.mark.parametrize(
    "posts", [(), POSTS[:1]], ids=["no obstacle", "an obstacle that may be touched"]
)
def test_map_of_joints_that_move_no_pair_is_free(tmp_path: Path, posts: Any) -> None:
    space = build_plane_arm(tmp_path, posts=posts)
    space.allow_collisions(
        [(one, other) for one in ("foot", "upper", "fore") for other in (*space.obstacles, "fore")]
    )
    joint_map = build_joint_map(space, 0.5)
    assert joint_map.count() == (joint_map.grid.size, 0, 0)
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (2, 20, 2))
    for exact in (False, True):
        assert np.asarray(joint_map.motion_is_free(*q, exact=exact)).all()
    assert undecided_pairs(joint_map) == {}


def test_joint_with_equal_limits_is_held(tmp_path: Path) -> None:
    """Keep the joint at its value; maps omit it."""
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    path = write_urdf(
        tmp_path,
        *(link(name, bar) for name in "abc"),
        joint("one", "a", "b", at=(1, 0, 0), limits=(0.3, 0.3)),
        joint("two", "b", "c", at=(1, 0, 0)),
    )
    space = build_arm_space({}, Arm.from_urdf(path))
    assert space.sample_free(2, np.random.default_rng(0))[:, 0].tolist() == [0.3, 0.3]
    assert len(space.find_path((0.3, -1.0), (0.3, 1.0))) == 2
    with pytest.raises(
        InputError, match=r"name 'one', which stays at 0.3.*held_joints= says where it is held"
    ):
        build_joint_map(space, 0.1)


def test_a_joint_at_its_limit_is_in_the_map_in_spite_of_rounding(tmp_path: Path) -> None:
    lower, upper, spacing = -3.2, 0.05, 0.05
    assert lower + 65 * spacing < upper  # rounding ends 65 cells before the limit
    limits = (lower, upper)
    bar = ((0.8, 0.1, 0.1), (0.5, 0, 0))
    file = write_urdf(
        tmp_path,
        link("base"),
        link("upper", bar),
        link("fore", bar),
        joint("shoulder", "base", "upper", limits=limits),
        joint("elbow", "upper", "fore", at=(1, 0, 0), limits=limits),
    )
    space = build_arm_space({"post": posed_box((0.1, 0.1, 0.1), 9.0, 9.0)}, Arm.from_urdf(file))
    joint_map = build_joint_map(space, spacing)
    at_limit = (upper, 0.01)
    assert space.motion_is_free((0.01, 0.01), at_limit)
    assert joint_map.classify(at_limit) != BLOCKED
    assert not joint_map.is_disconnected((0.01, 0.01), at_limit)


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning")  # its sides cancel
def test_a_flat_closed_link_has_no_inside(tmp_path: Path) -> None:
    corners = [(0, 0, 0), (0.4, 0, 0), (0, 0.4, 0), (0.3, 0.3, 0)]
    flat = trimesh.Trimesh(corners, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)], process=False)
    flat.export(tmp_path / "flat.obj")
    sheet = '<geometry><mesh filename="flat.obj"/></geometry>'
    file = write_urdf(
        tmp_path,
        link("base"),
        f'<link name="upper"><collision>{sheet}</collision></link>',
        f'<link name="fore"><collision>{sheet}</collision></link>',
        joint("shoulder", "base", "upper"),
        joint("elbow", "upper", "fore", at=(1, 0, 0)),
    )
    space = build_arm_space({"post": posed_box((0.1, 0.1, 0.1), 1.2, 0.3)}, Arm.from_urdf(file))
    free, mixed, blocked = build_joint_map(space, 0.4).count()
    assert free and mixed and not blocked
