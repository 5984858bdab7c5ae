"""Rotations that errors of plans name, against builds with them."""

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
import planners
from cspace import MIXED, ConfigurationError, CSpace, Robot, Rotations, Workspace
from tests.strategies import seeds

CORRIDOR = (0.8, 0.5, 0.0), (3.2, 0.5, 0.0)
"""Start and goal in the middle of a corridor along x."""


def build_corridor(robot: Robot, rotations: int | Rotations, dim: int = 2) -> CSpace:
    """Build a map of a corridor of 4 m, 0.6 m wide and, in space, 0.6 m high."""
    occupied = np.ones((80, 20, 20)[:dim], dtype=bool)
    occupied[(slice(2, 78), slice(4, 16), slice(4, 16))[:dim]] = False
    return cspace.build(Workspace.from_array(occupied, 0.05), robot, rotations=rotations)


def find_hint(space: CSpace, q: tuple[float, ...]) -> str:
    """Return the rotations that the error of a plan names, or an empty text."""
    with pytest.raises(ConfigurationError) as caught:
        planners.plan(space, q, q)
    found = re.search(r"build the map with rotations=(\S+), which proves the start FREE", caught.value.hint)
    return found[1] if found else ""


def accepts(space: CSpace, q: tuple[float, ...], rotations: int) -> bool:
    """Return True if a plan starts at a configuration of a new map with other rotations."""
    options = {"outside": space.outside, "margin": space.margin}
    again = cspace.build(space.workspace, space.robot, rotations=rotations, **options)
    try:
        return planners.plan(again, q, q).certified
    except ConfigurationError:
        return False


def list_counts(robot: Robot, rotations: int, distance: float) -> list[int]:
    """Return doubled numbers of yaw cells.

    Within one of the last ones, the robot moves by at most a distance.
    """
    lower, upper = robot.shape.outer.bounds
    reach = math.hypot(*np.maximum(-lower, upper))
    counts = [rotations]
    while 2.0 * reach * math.sin(math.pi / counts[-1] / 2.0) > distance:
        counts.append(2 * counts[-1])
    return counts[1:]


@pytest.mark.parametrize("rotations", [1, 2])
def test_too_few_rotations_in_a_corridor_name_how_many_are_needed(rotations: int) -> None:
    robot = Robot.rectangle(0.9, 0.3)
    space = build_corridor(robot, rotations)
    assert space.count()[0] == 0
    needed = int(find_hint(space, CORRIDOR[0]))
    assert not accepts(space, CORRIDOR[0], needed // 2)
    assert planners.plan(build_corridor(robot, needed), *CORRIDOR).certified


def test_too_few_rotations_in_space_name_how_many_are_needed() -> None:
    robot, q = Robot.box((0.9, 0.3, 0.2)), (0.8, 0.5, 0.5)
    needed = int(find_hint(build_corridor(robot, 2, dim=3), (*q, 0.0)))
    assert build_corridor(robot, needed, dim=3).is_free((*q, 0.0))
    robot, q = Robot.box((0.5, 0.15, 0.1)), (*q, 0.0, 0.0, 0.0, 1.0)
    hint = find_hint(build_corridor(robot, Rotations.quaternions(2), 3), q)
    found = re.fullmatch(r"Rotations.quaternions\((\d+)\)", hint)
    assert found and build_corridor(robot, Rotations.quaternions(int(found[1])), 3).is_free(q)


@settings(max_examples=25)
@given(
    seed=seeds,
    rotations=st.integers(1, 12),
    outside=st.sampled_from(["blocked", "free"]),
    margin=st.sampled_from([0.0, 0.04]),
)
def test_named_rotations_are_the_first_that_prove_the_start_free(
    seed: int, rotations: int, outside: str, margin: float
) -> None:
    rng = np.random.default_rng(seed)
    workspace = Workspace.from_array(rng.random((20, 16)) < 0.04, 0.1)
    robot = Robot.rectangle(*rng.uniform(0.1, 0.5, 2), center=rng.uniform(-0.1, 0.1, 2))
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside, margin=margin)
    places = rng.integers(0, (40, 32), (200, 2)) * 0.05  # also on borders of cells
    q = np.column_stack([places, rng.uniform(-math.pi, math.pi, 200)])
    q = q[space.classify(q) == MIXED]
    collides = ~np.asarray(space.is_free(q, exact=True))
    q = q[np.argsort(collides, kind="stable")]  # first those that more rotations may prove
    counts = list_counts(robot, rotations, 0.5 * space.grid.spacing)
    for point in map(tuple, q[[*range(3), -1][: len(q)]].tolist()):
        first = next((str(count) for count in counts if accepts(space, point, count)), "")
        assert find_hint(space, point) == first


def test_no_rotations_are_named_if_they_cannot_help() -> None:
    turning = build_corridor(Robot.rectangle(0.9, 0.7), 2)  # too wide
    assert find_hint(turning, CORRIDOR[0]) == ""
    slim = build_corridor(Robot.rectangle(0.9, 0.3), 2)
    assert find_hint(slim, (2.0, 0.5, math.pi / 2)) == ""  # across the corridor
    assert find_hint(build_corridor(Robot.disc(0.29), 2), CORRIDOR[0]) == ""  # round


def test_a_map_without_free_cells_names_rotations_in_which_the_robot_hardly_moves() -> None:
    space = build_corridor(Robot.rectangle(0.9, 0.3), 2)
    with pytest.raises(ConfigurationError) as caught:
        space.nearest_free(CORRIDOR[0])
    count = list_counts(space.robot, 2, space.grid.spacing)[-1]
    assert f"a finer spacing, rotations={count}, or" in caught.value.hint
    with pytest.raises(ConfigurationError) as plain:
        build_corridor(Robot.disc(0.5), 2).nearest_free(CORRIDOR[0])
    assert "rotations" not in plain.value.hint
