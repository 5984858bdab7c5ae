"""Printed configurations, which a user may type back."""

import math
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import planners
from cspace import FREE, MIXED, ConfigurationError, Robot, Workspace, build
from cspace.arms import Arm, build_arm_space
from tests.helpers.commands import run
from tests.helpers.handmade import make_map
from tests.helpers.urdfs import joint, link, write_urdf

CONFIGURATION = re.compile(r"\(([-+.e\d]+(?:, [-+.e\d]+)+)\)")


def read_configurations(text: str) -> list[tuple[float, ...]]:
    """Return the configurations in a text."""
    return [tuple(map(float, numbers.split(", "))) for numbers in CONFIGURATION.findall(text)]


@pytest.mark.parametrize("spacing", [0.01, 0.1])
def test_start_and_goal_of_a_printed_plan_are_taken_when_typed_back(spacing: float) -> None:
    states = np.full((1, 41, 9), FREE, dtype=np.uint8)
    states[0, 20] = MIXED
    space = make_map(states, "plane", "blocked", spacing)
    start = (20.0 * spacing - 1e-6, 4.5 * spacing)
    for goal in ((21.0 * spacing + 1e-7, 4.5 * spacing), (spacing, spacing)):
        plan = planners.plan(space, start, goal)
        first, last = read_configurations(repr(plan))
        assert planners.plan(space, first, last).solved == plan.solved
        without_map = pickle.loads(pickle.dumps(plan))
        assert read_configurations(repr(without_map)) == [tuple(plan.start), tuple(plan.goal)]


def test_the_nearest_configuration_of_an_error_is_taken_when_typed_back(tmp_path: Path) -> None:
    states = np.full((1, 2000, 3), MIXED, dtype=np.uint8)
    states[0, 1250, 1] = states[0, 1999] = FREE  # the center of the first is at 12.505 m
    space = make_map(states, "plane", "blocked", 0.01, lower=(1000.0, 0.0))
    with pytest.raises(ConfigurationError) as refused:
        planners.plan(space, (1012.0, 0.015), (1012.0, 0.015))
    (nearest,) = read_configurations(refused.value.hint)
    assert nearest == pytest.approx(refused.value.nearest)
    assert planners.plan(space, nearest, nearest).solved
    # A command prints it, too.
    occupied = np.zeros((50, 50), dtype=bool)
    occupied[20:30] = True
    workspace = Workspace.from_array(occupied, 0.01, lower=(12000.0, -7.0))
    store = tmp_path / "m.zarr"
    build(workspace, Robot.rectangle(0.04, 0.02), rotations=12).save(store)
    goal = "--goal=12000.1,-6.9,0"
    printed = run("plan", store, "--start=12000.24,-6.7,0.3", goal)
    assert printed.exit_code == 2
    start = ",".join(map(str, read_configurations(printed.stderr)[-1]))
    again = run("plan", store, f"--start={start}", goal)
    assert again.exit_code == 0, again.stderr


def test_joints_at_their_limits_are_taken_when_typed_back(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    links = link("base"), link("mast"), link("head", ((0.1, 0.1, 0.1), (0.5, 0, 0)))
    spin = joint("spin", "base", "mast", limits=(-math.pi, math.pi))
    lift = joint("lift", "mast", "head", limits=(-1, 1))
    space = build_arm_space({}, Arm.from_urdf(write_urdf(tmp_path, *links, spin, lift)))
    plan = planners.plan(space, (-math.pi, 0.123456), (math.pi, 0.5), seed=0)
    ends = read_configurations(repr(plan))
    assert plan.solved and planners.plan(space, *ends, seed=0).solved
    np.testing.assert_allclose(ends, [plan.start, plan.goal], atol=1e-3)
