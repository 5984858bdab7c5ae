"""The oracles of these tests notice a robot that is 3 % larger, or a motion that is faster."""

import numpy as np
import pytest
import shapely
import trimesh

import cspace
from cspace import FREE, Robot, Workspace, build_arm_space
from tests.helpers import solids
from tests.helpers.any_map import WEDGE
from tests.helpers.arm_oracle import ArmOracle, sample_configurations
from tests.helpers.balls import sum_pairs
from tests.helpers.floors import cut_prism, touches
from tests.helpers.handmade import components
from tests.helpers.leaving import bound_distances, drive
from tests.helpers.motions import LIMITS, build_plan, check_limits
from tests.helpers.oracles import cheapest_chain
from tests.helpers.placements import collides, obstacles_of, sample_edges
from tests.helpers.regions import Body
from tests.helpers.urdfs import planar, planar_arm, planar_arm_meets, pose_of, posed_box

LARGER = 1.03

CELLS = np.zeros((30, 24), bool)
CELLS[12:15, :9] = CELLS[5:9, 15:18] = CELLS[22:, 12:14] = True

SIDES = np.array([0.5, 0.2, 0.3])
PILLAR = (0.7, 0.7, 0.0), (1.1, 1.0, 1.2)
"""Lower and upper corner of a box in space, metres."""

SIDE, POST = 0.2, (1.3, 0.6)
"""Side and center of a cube beside the planar arm, metres."""


def build_wedge(factor):
    """Build the map of a wedge of a relative size."""
    room = Workspace.from_array(CELLS, 0.1)
    return cspace.build(room, Robot.polygon(factor * WEDGE), rotations=12)


def approach(is_free, draws):
    """Return free configurations near contact, between draws that are free and their neighbours."""
    free = draws[np.asarray(is_free(draws))]
    others = np.roll(draws, 1, axis=0)[: len(free)]
    for _ in range(20):
        middle = 0.5 * (free + others)
        goes_on = np.asarray(is_free(middle))[:, np.newaxis]
        free, others = np.where(goes_on, middle, free), np.where(goes_on, others, middle)
    return free


def draw(low, high, n=200):
    """Draw rows between bounds."""
    return np.random.default_rng(1).uniform(low, high, (n, len(low)))


@pytest.fixture(scope="module")
def contacts():
    """Return configurations of the wedge, proven free, near contact."""
    return approach(build_wedge(1.0).exact.is_free, draw((0.8, 0.8, -3.0), (2.2, 1.6, 3.0)))


def test_bodies_in_the_plane_collide(contacts):
    assert not collides(build_wedge(1.0), contacts).any()
    assert collides(build_wedge(LARGER), contacts).any()


def test_discs_collide():
    space = cspace.build(Workspace.from_array(CELLS, 0.1), Robot.disc(0.2))
    q = approach(space.exact.is_free, draw((0.2, 0.2), (2.8, 2.2)))
    assert not collides(space, q).any()
    assert collides(space, q, grow=0.2 * (LARGER - 1.0)).any()


def test_balls_and_cores_overlap():
    """Overlaps of balls are summed, and depths of points in cores measured."""
    pose = np.array([(1.0, 0.5, 0.7)])
    point = pose[:, :2] + 0.305 * np.array([np.cos(0.7), np.sin(0.7)])
    for factor in (1.0, LARGER):
        balls = np.zeros((1, 2)), np.array([0.3 * factor])
        beside = np.array([(0.505, 0.0)]), np.array([0.2])
        core = shapely.box(-0.3 * factor, -0.2, 0.3 * factor, 0.2)
        assert (sum_pairs(balls, beside, 2.0, np.zeros((1, 2)))[0] > 0.0) == (factor > 1.0)
        assert (bound_distances([core], pose, point)[0, 0] < 0.0) == (factor > 1.0)


def test_robots_on_a_floor_touch():
    cells = np.repeat(CELLS[:, :, np.newaxis], 4, axis=2)
    sides = np.array([0.5, 0.3, 0.2])
    robot = Robot.box(sides, (0.0, 0.0, 0.15))
    space = cspace.build(Workspace.from_array(cells, 0.1), robot, rotations=12, floor=0.0)
    q = approach(space.exact.is_free, draw((0.4, 0.4, -3.0), (2.6, 2.0, 3.0), 60))
    prisms = [(obstacles_of(cspace.build(Workspace.from_array(CELLS, 0.1), "disc:0.1")), 0.0, 0.4)]
    for factor in (1.0, LARGER):
        x, y = 0.5 * factor * sides[:2]
        cut = cut_prism(shapely.box(-x, -y, x, y), 0.05, 0.25)
        assert any(touches([cut], prisms, row, 0.0) for row in q) == (factor > 1.0)


def test_motions_exceed_limits():
    plan = build_plan(1, "holonomic", None)
    check_limits(plan.trajectory(**LIMITS))
    for name in LIMITS:
        with pytest.raises(AssertionError):
            check_limits(plan.trajectory(**LIMITS | {name: LARGER * LIMITS[name]}))


def test_arcs_end_elsewhere():
    steps = np.full((20_000, 2), (0.8, 0.6)) / 20_000
    yaws = 0.3 + np.cumsum(steps[:, 1])
    end = np.sum(steps[:, :1] * np.column_stack([np.cos(yaws), np.sin(yaws)]), axis=0)
    for factor in (1.0, LARGER):
        reached = drive((0.0, 0.0, 0.3), factor * np.array((0.8, 0.6)), 1.0)
        assert (np.abs(reached[:2] - end).max() < 1e-4) == (factor == 1.0)


def test_dense_samples_of_motions_collide(contacts):
    space, lasts = build_wedge(1.0), np.roll(contacts, 1, axis=0)
    proven = np.asarray(space.exact.motion_is_free(contacts, lasts))
    assert proven.any()
    rows, _ = sample_edges(space, contacts[proven], lasts[proven], np.linspace(0.0, 1.0, 41))
    assert not collides(space, rows.reshape(-1, 3)).any()
    assert collides(build_wedge(LARGER), rows.reshape(-1, 3)).any()


def test_bodies_in_space_collide():
    room = Workspace.from_mesh(trimesh.creation.box(bounds=PILLAR), 0.1, (-1, -1, -1, 3, 3, 3))
    space = cspace.build(room, Robot.box(SIDES))
    q = approach(space.exact.is_free, draw((0.2, 0.2, 0.0), (1.6, 1.6, 1.6)))
    pillar = Body.boxes([PILLAR])
    for factor in (1.0, LARGER):
        half = 0.5 * factor * SIDES
        hits = Body.boxes([(-half, half)]).within(pillar, q, np.zeros(len(q)))
        assert hits.any() == (factor > 1.0)
        boxes = (solids.box(factor * SIDES, row) for row in q)
        (low, high) = np.array(PILLAR)
        other = solids.box(high - low, 0.5 * (low + high))
        assert any(solids.meet(box, other) for box in boxes) == (factor > 1.0)


def test_arms_collide(tmp_path):
    arm = planar_arm()
    space = build_arm_space({"post": posed_box((SIDE,) * 3, *POST)}, arm)
    q = approach(space.is_free, sample_configurations(arm, np.random.default_rng(1), 60))
    for factor in (1.0, LARGER):
        assert planar_arm_meets(q, [(*POST, factor * SIDE)]).any() == (factor > 1.0)
    path = planar(tmp_path)
    text = path.read_text()
    for factor in (1.0, LARGER):
        path.write_text(text.replace("0.1 0.1", f"{0.1 * factor} {0.1 * factor}"))
        cube = solids.box((SIDE,) * 3, (*POST, 0.0))
        oracle = ArmOracle(path, arm, {"post": [cube]}, [("foot", "upper"), ("upper", "fore")])
        assert (min(map(oracle.apart, q)) == 0.0) == (factor > 1.0)


def test_own_kinematics_tell_lengths(tmp_path):
    path, arm, q = planar(tmp_path), planar_arm(), (0.4, -0.9)
    values = dict(zip(arm.joints, q, strict=True))
    assert pose_of(path, "fore", values) == pytest.approx(arm.pose(q, "fore"), abs=1e-12)
    path.write_text(path.read_text().replace('"1.0 0.0 0.0"', f'"{LARGER} 0.0 0.0"'))
    assert pose_of(path, "fore", values) != pytest.approx(arm.pose(q, "fore"), abs=1e-2)


def test_floods_and_chains_of_cells_end_at_a_door():
    cells = np.zeros((40, 24), bool)
    cells[20] = True
    cells[20, 6:19] = False
    space, larger = (
        cspace.build(Workspace.from_array(cells, 0.05), Robot.disc(factor * 0.295))
        for factor in (1.0, LARGER)
    )
    ends = (0.5, 0.6), (1.5, 0.6)
    for each, is_open in ((space, True), (larger, False)):
        free = np.asarray(each.cell_states) == FREE
        labels = components(free[np.newaxis])
        assert (labels.max() == labels[free[np.newaxis]].min()) == is_open
        centers = 0.05 * (0.5 + np.argwhere(free))
        assert np.isfinite(cheapest_chain(each, centers, 0.08, *ends)) == is_open
