"""Differential drives: edges that turn, drive straight and turn, and their plans."""

import itertools
import math

import numpy as np
import pytest

import planners
from cspace import MIXED, CSpace, InputError, Robot, Workspace, build
from planners.local_planner import TurnDriveTurn, local_planner
from tests.helpers.handmade import fill_boxes
from tests.helpers.maps import proven_paths
from tests.helpers.placements import collides
from tests.helpers.planning import (
    ENDPOINTS,
    build_from_states,
    build_open_map,
    build_room,
    check,
    make_state,
    plan_patiently,
    turn_between,
)

DRIVES = ("differential", "differential-reverse")


def turns(first: np.ndarray, last: np.ndarray, drive: str) -> np.ndarray:
    """Return the yaw of the straight part and both rotations, shape (3, ...).

    Of two directions, the least rotation wins. Shares no arithmetic with the planners.
    """
    way = (last - first)[..., 0] + 1j * (last - first)[..., 1]
    begin, end = np.exp(1j * first[..., 2]), np.exp(1j * last[..., 2])
    candidates = []
    for sign in (1.0, -1.0) if drive == "differential-reverse" else (1.0,):
        heading = np.where(way == 0.0, begin, sign * way)
        candidates.append(
            np.stack([np.angle(heading), np.angle(heading / begin), np.angle(end / heading)])
        )
    least = [np.abs(way[1:]).sum(axis=0) for way in candidates]
    return np.where(least[-1] < least[0] - 1e-12, candidates[-1], candidates[0])


def driven(first: np.ndarray, last: np.ndarray, drive: str, each: int = 60) -> np.ndarray:
    """Return configurations along an edge of a differential drive."""
    (heading, begin, end), t = turns(first, last, drive), np.linspace(0.0, 1.0, each)[:, None]
    rows = [
        np.hstack([np.repeat(first[None, :2], each, axis=0), first[2] + t * begin]),
        np.hstack([first[:2] + t * (last - first)[:2], np.full((each, 1), heading)]),
        np.hstack([np.repeat(last[None, :2], each, axis=0), heading + t * end]),
    ]
    return np.concatenate(rows)


def pairs(space: CSpace, n: int, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Draw pairs of FREE configurations, mostly near each other."""
    rng = np.random.default_rng(seed)
    first, last = space.sample_free(n, rng), space.sample_free(n, rng)
    near = rng.random(n) < 0.8
    last[near, :2] = first[near, :2] + rng.uniform(-0.7, 0.7, (near.sum(), 2))
    last[::7, :2] = first[::7, :2]
    last[3::7, 2] = first[3::7, 2]
    return list(zip(first, last, strict=True))


def check_driven(plan: planners.Plan, drive: str) -> None:
    """Check that a path never moves sideways or rotates while it moves."""
    path = plan.path
    steps, turns = np.diff(path[:, :2], axis=0), turn_between(path[:-1, 2], path[1:, 2])
    metres = np.linalg.norm(steps, axis=1)
    heading = np.stack([np.cos(path[:-1, 2]), np.sin(path[:-1, 2])], axis=-1)
    along, across = (
        (steps * heading).sum(axis=1),
        steps[:, 0] * heading[:, 1] - steps[:, 1] * heading[:, 0],
    )
    assert np.abs(across).max() < 1e-9 and (np.minimum(metres, np.abs(turns)) == 0.0).all()
    assert plan.direction is not None and plan.drive == drive
    assert np.array_equal(plan.direction[1:], np.sign(np.round(along, 12)))
    assert drive == "differential-reverse" or along.min() >= 0.0
    assert plan.length == pytest.approx(metres.sum())


# ---- edges ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("drive", DRIVES)
def test_an_edge_is_proven_only_if_its_configurations_are_free(drive: str) -> None:
    space = build_room("turning")
    check_edge, answers = local_planner(space, drive=drive).edge_checker(), set()
    for first, last in pairs(space, 400, 0):
        points = driven(first, last, drive)
        proven, free = check_edge(*first, *last), bool(space.is_free(points).all())
        assert free or not proven
        # Edges with some clearance are proven.
        assert proven or not space.is_free_around(points, 0.04, 0.06).all()
        answers.add(proven)
    assert answers == {True, False}


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("drive", DRIVES)
def test_an_edge_and_its_breakpoints_are_proven_alike(drive: str, exact: bool) -> None:
    space = build_room("turning")
    edges = local_planner(space, exact, drive)
    assert isinstance(edges, TurnDriveTurn)
    for first, last in pairs(space, 60, 1):
        corners = edges.insert_breakpoints(np.array([first, last]))
        assert (
            corners[0].tolist() == first.tolist()
            and corners[-1].tolist() == last.tolist()
            and len(corners) <= 4
        )
        assert np.array_equal(edges.insert_breakpoints(corners), corners)
        proven = bool(space.certify_path(corners, exact=exact).all())
        assert proven == edges.are_free(corners) == edges.edge_checker()(*first, *last)
        dense = edges.resample(corners)
        direction = edges.find_directions(dense)
        assert direction is not None and len(direction) == len(dense)
        steps = edges.split_path(corners, math.inf, math.inf)
        turned = np.abs(np.diff(driven(first, last, drive)[:, 2])).reshape(-1)
        assert steps.lengths.sum() == pytest.approx(np.hypot(*(last - first)[:2]))
        inside = np.r_[turned[:59], turned[60:119], turned[120:]]
        assert steps.rotations.sum() == pytest.approx(inside.sum(), abs=1e-9)
        length = edges.edge_lengths(first[None], last[None])[0]
        assert length == pytest.approx(steps.lengths.sum() + 0.5 * inside.sum(), abs=1e-9)


@pytest.mark.parametrize("drive", DRIVES)
def test_ompls_interpolation_lies_on_the_edge(drive: str) -> None:
    space = build_room("turning")
    states = planners.state_space(space, drive=drive)
    si = planners.simple_setup(space, drive=drive).getSpaceInformation()
    out = states.allocState()
    for first, last in pairs(space, 200, 2):
        a, b = make_state(space, si, first), make_state(space, si, last)
        assert states.distance(a, b) == pytest.approx(math.dist(first[:2], last[:2]), abs=1e-6)
        if math.dist(first[:2], last[:2]) == 0.0:
            continue
        heading = driven(first, last, drive)[90, 2]
        for share in (0.01, 0.3, 0.99):
            states.interpolate(a, b, share, out)
            position = first[:2] + share * (last - first)[:2]
            assert (out.getX(), out.getY()) == pytest.approx(position, abs=1e-6)
            assert abs(turn_between(out.getYaw(), heading)) < 1e-6


def test_a_reversing_robot_backs_out_of_a_narrow_corridor() -> None:
    occupied = np.ones((60, 60), dtype=bool)
    occupied[5:55, 26:34] = False  # a corridor of 0.8 m
    space = build(Workspace.from_array(occupied, 0.1), Robot.rectangle(1.2, 0.4), rotations=72)
    endpoints = (4.0, 3.0, 0.0), (2.0, 3.0, 0.0)
    assert not local_planner(space, drive="differential").edge_checker()(
        *endpoints[0], *endpoints[1]
    )
    plan = planners.plan(space, *endpoints, drive="differential-reverse")
    check(space, plan, *endpoints)
    assert plan.length == 2.0 and set(plan.direction.tolist()) == {-1}  # type: ignore[union-attr]
    for drive, back, free in (("differential", False, True), ("differential", True, False)):
        validator = planners.MotionValidator(
            planners.simple_setup(space, drive=drive).getSpaceInformation(),
            space,
            drive=drive,
            bidirectional=back,
        )
        si = planners.simple_setup(space, drive=drive).getSpaceInformation()
        assert validator.checkMotion(*(make_state(space, si, q) for q in endpoints[::-1])) == free


def test_a_rotation_takes_only_the_shorter_direction() -> None:
    # A post blocks the rotation to the left; the longer rotation to the right is not tried.
    state = np.zeros((36, 5, 5), np.uint8)
    state[int(build_from_states(state, 36).rotations.cell_of(0.5))] = MIXED
    check_edge = local_planner(build_from_states(state, 36), drive="differential").edge_checker()
    assert not check_edge(2.5, 2.5, 0.1, 2.5, 2.5, 1.0)
    assert check_edge(2.5, 2.5, 0.1, 2.5, 2.5, -1.5) and check_edge(2.5, 2.5, -2.8, 2.5, 2.5, 1.0)


# ---- plans ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("planner", planners.planner_names())
def test_every_planner_finds_a_drivable_path(planner: str) -> None:
    space = build_room("turning")
    for drive in (
        DRIVES if planner in {"PRM", "RRTConnect"} else DRIVES[:1]
    ):  # other planners take seconds
        plan = plan_patiently(
            space, ENDPOINTS["turning"], (0.1, 0.5, 20.0), planner=planner, drive=drive
        )
        check(space, plan, *ENDPOINTS["turning"])
        check_driven(plan, drive)


@pytest.mark.parametrize("drive", DRIVES)
def test_no_point_of_a_path_collides(drive: str) -> None:
    # Rectangles along the path avoid every obstacle, by shapely.
    space = build_room("turning")
    lengths = []
    for seed, planner in enumerate((None, "RRTConnect", "RRTConnect", "RRTConnect")):
        options = {"drive": drive, "planner": planner, "seed": seed, "time_limit": 20.0}
        plan = planners.plan(space, *ENDPOINTS["turning"], **options)
        check(space, plan, *ENDPOINTS["turning"])
        check_driven(plan, drive)
        assert space.certify_path(plan.path).all() and space.certify_path(plan.waypoints).all()
        for first, last in itertools.pairwise(plan.waypoints):
            assert not collides(space, driven(first, last, drive, 20)).any()
        rough = planners.plan(space, *ENDPOINTS["turning"], simplify=False, **options)
        check(space, rough, *ENDPOINTS["turning"])
        lengths.append(rough.length / plan.length)
    assert min(lengths) >= 1 - 1e-9 and max(lengths) > 1.02


@pytest.mark.parametrize("drive", DRIVES)
def test_remove_turns_keeps_the_yaw_of_arrival(drive: str) -> None:
    edges = local_planner(build_open_map("turning"), drive=drive)
    path = np.array([(1.0, 1.0, 0.5), (3.0, 1.5, -2.0), (5.0, 4.0, 1.0), (5.0, 6.0, 0.0)])
    settled = edges.remove_turns(path)
    assert np.array_equal(settled[[0, -1]], path[[0, -1]]) and np.array_equal(
        settled[:, :2], path[:, :2]
    )
    turns = [edges.split_path(rows, math.inf, math.inf).rotations.sum() for rows in (settled, path)]
    assert turns[0] < turns[1] - 1.0
    corners = edges.insert_breakpoints(settled)
    assert len(corners) == 8 and edges.are_free(
        settled
    )  # three lines, and a rotation at each of four positions


def test_exact_geometry_proves_a_path_through_mixed_cells() -> None:
    occupied = fill_boxes(
        (40, 40), np.s_[18:22], but=[np.s_[18:22, 18:22]]
    )  # a gap of 0.4 m in a wall
    space = build(Workspace.from_array(occupied, 0.1), Robot.rectangle(0.5, 0.36), rotations=72)
    endpoints = (1.0, 2.0, 0.0), (3.0, 2.0, 0.0)
    assert proven_paths(space, *endpoints) is None
    plan = planners.plan(space, *endpoints, drive="differential", exact=True)
    assert (
        plan.solved
        and plan.certified
        and plan.exact
        and space.certify_path(plan.path, exact=True).all()
    )
    check_driven(plan, "differential")


def test_an_unknown_drive_is_refused() -> None:
    with pytest.raises(InputError, match=r"drive is 'sideways'.*'holonomic', 'differential'"):
        planners.state_space(build_room("turning"), drive="sideways")
