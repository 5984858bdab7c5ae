"""Random drives behind a gate, beside the fastest drive that shapely allows."""

import math

import numpy as np
import pytest
import shapely

import cspace
from tests.helpers.leaving import drive
from tests.helpers.regions import place_polygon

DT, BRAKES, TRACKING = 0.05, np.array([1.0, 2.0]), 0.02
"""Seconds of a cycle, m/s^2 and rad/s^2 of the brakes, and the gate's margin in metres and radians."""

CYCLES = 100
BODY, GROWN = shapely.box(-0.3, -0.2, 0.3, 0.2), shapely.box(-0.305, -0.205, 0.305, 0.205)
"""The robot, and with 5 mm more, half the distance between poses."""

CRATES = [(1.0, 3.0), (4.6, 2.8), (4.0, 0.5)]
POSTS = np.array([(1.5, 2.2), (4.5, 1.9), (2.2, 1.0)])
OBSTACLES = shapely.union_all(
    [
        shapely.box(0, 0, 6, 4).exterior.buffer(0.05),
        shapely.box(2.9, 0.0, 3.1, 2.6),
        *(shapely.box(x, y, x + 0.3, y + 0.3) for x, y in CRATES),
        *shapely.buffer(shapely.points(POSTS), 0.05),
    ]
)
shapely.prepare(OBSTACLES)


def make_cells():
    """Return the cells of walls and crates, 5 cm wide."""
    cells = np.zeros((120, 80), dtype=bool)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[58:62, :52] = True
    for x, y in CRATES:
        cells[round(20 * x) : round(20 * x) + 6, round(20 * y) : round(20 * y) + 6] = True
    return cells


@pytest.fixture(scope="module")
def gate():
    """Return a gate on a map of walls and crates, to which posts come as points of a scan."""
    workspace = cspace.Workspace.from_array(make_cells(), DT)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.6, 0.4), rotations=72)
    space.add_obstacle("scan", POSTS, radius=0.05)
    return cspace.Gate(space, dt=DT, tracking=TRACKING, max_deceleration=BRAKES)


def find_ramp(twist):
    """Return the share of a twist in each cycle until the robot rests."""
    steps = math.ceil(float((np.abs(twist) / (DT * BRAKES)).max()) - 1e-9)
    return 1.0 - np.arange(steps) / max(steps, 1)


def touches(pose, twist, seconds, body=BODY):
    """Return whether a body touches anything on an arc, at poses at most 1 cm apart."""
    way = seconds * (abs(twist[0]) + 0.4 * abs(twist[1]))
    poses = drive(pose, twist, np.linspace(0.0, seconds, 2 + int(100 * way)))
    return bool(shapely.intersects(OBSTACLES, place_polygon(body, poses)).any())


def find_fastest(pose, wanted, now):
    """Return the fastest twist by bisection, after which the robot can stop without a touch."""

    def is_safe(share):
        twist = share * wanted
        return not touches(pose, twist, DT * find_ramp(twist).sum(), GROWN)

    # Brakes reach no slower twist in one cycle; a slower one drives less of the same arc.
    least, along = np.abs(now) - DT * BRAKES, wanted * np.sign(now)
    low = np.divide(least, along, out=np.zeros(2), where=(least > 0.0) & (along > 0.0)).max()
    if ((least > 0.0) & (along <= 0.0)).any() or low >= 1.0 or not is_safe(low):
        return now * (*find_ramp(now), 0.0, 0.0)[1]
    high = 1.0
    if is_safe(high):
        return wanted
    for _ in range(8):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_safe(middle) else (low, middle)
    return low * wanted


def run_drive(choose_slower, space, may_stand, seed):
    """Drive behind a gate, and as fast as is safe, by the same commands; return both ways, metres.

    The gate chooses from a pose, the wanted twist and the present one.
    """
    rng = np.random.default_rng(seed)
    starts = space.sample_free(100, rng)  # of which it may stand at some, with its margin
    start = next(filter(may_stand, starts))
    commands = rng.normal((0.5, 0.0), (0.4, 1.0), (CYCLES // 10, 2)).repeat(10, axis=0)
    ways = []
    for choose in (choose_slower, find_fastest):
        pose, now, way = start, np.zeros(2), 0.0
        for wanted in commands:
            now = choose(pose, wanted, now)
            assert not touches(pose, now, DT)
            way += DT * abs(now[0])
            pose = drive(pose, now, np.array([DT]))[0]
            pose[2] = math.remainder(pose[2], 2.0 * math.pi)
        ways.append(way)
    return ways


@pytest.mark.parametrize("leaving, share", [(False, 0.5), (True, 0.75)], ids=["free", "leaving"])
@pytest.mark.parametrize(
    "seeds",
    [
        pytest.param(range(2), id="2 drives"),
        pytest.param(range(200), id="200 drives", marks=pytest.mark.thorough),
    ],
)
def test_drives_touch_nothing_and_go_far_beside_the_fastest_safe_ones(gate, seeds, leaving, share):
    def choose(pose, wanted, now):
        slowed = gate.slow_down(pose, wanted, twist_now=now, leaving=leaving)
        # The rest of a ramp was proven before.
        assert leaving or slowed.chunk.is_proven or not slowed.share
        if slowed.share:
            np.testing.assert_allclose(slowed.commands[0], slowed.share * wanted)
        steps = np.abs(np.diff(slowed.commands, axis=0, append=[(0.0, 0.0)]))
        assert (steps <= DT * BRAKES * (1.0 + 1e-9)).all()
        return slowed.commands[0]

    def may_stand(pose):
        return gate.check_twists(pose, [(0.0, 0.0)]).state == "go"

    ways = [run_drive(choose, gate.space, may_stand, seed) for seed in seeds]
    slowed, fastest = np.sum(ways, axis=0)
    assert slowed > (share + 0.1 * (len(seeds) > 4)) * fastest
