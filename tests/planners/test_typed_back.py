"""Printed configurations, which a user may type back."""

import math
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import planners
from cspace import FREE, MIXED, ConfigurationError, CSpace, Robot, Workspace, build
from cspace.arms import Arm, build_arm_space
from planners.local_planner import local_planner
from tests.commands import run
from tests.handmade import MAP_KINDS, configurations, make_map, random_states
from tests.strategies import exteriors, seeds
from tests.urdfs import joint, link, write_urdf

CONFIGURATION = re.compile(r"\(([-+.e\d]+(?:, [-+.e\d]+)+)\)")


def read_configurations(text: str) -> list[tuple[float, ...]]:
    """Return the configurations in a text."""
    return [tuple(map(float, found.split(", "))) for found in CONFIGURATION.findall(text)]


def cells_of(space: CSpace, q: Any) -> list[int]:
    """Return the cell and rotation cell of a configuration."""
    q = space.rotations.make_canonical(np.array(q))
    return [*space.grid.cell_of(q[: space.grid.dim]).tolist(), int(space.rotations.find_cells(q))]


def draw_near_borders(space: CSpace, rng: np.random.Generator, count: int) -> Any:
    """Draw configurations in the grid, most of them just beside or on borders of cells."""
    grid, dim = space.grid, space.grid.dim
    corners = grid.lower + grid.spacing * rng.integers(0, np.array(grid.shape) + 1, (count, dim))
    signs = rng.choice([-1.0, 1.0], (count, dim))
    offsets = grid.spacing * signs * 10.0 ** rng.uniform(-12, 0, (count, dim))
    offsets[rng.random((count, dim)) < 0.1] = 0.0
    positions = np.clip(corners + offsets, grid.lower, grid.upper)
    turns = rng.normal(size=(count, len(space.rotations.names)))
    if len(space.rotations.names) == 1:
        borders = rng.choice(np.ravel(space.rotations.borders), (count, 1))
        turns = np.where(rng.random((count, 1)) < 0.7, borders + 1e-7 * turns, turns)
    return configurations(space, np.concatenate([positions, turns], axis=1))


@settings(max_examples=40)
@given(seeds, st.sampled_from(MAP_KINDS), st.sampled_from([1e-3, 0.05, 0.3]), exteriors)
def test_a_printed_configuration_lies_in_the_same_cell(
    seed: int,
    kind: str,
    spacing: float,
    outside: str,
) -> None:
    rng = np.random.default_rng(seed)
    states = random_states(rng, kind, mixture=(FREE, FREE, MIXED))
    lower = rng.uniform(-3.0, 3.0, states.ndim - 1)
    space = make_map(states, kind, outside, spacing, lower=lower)
    edges = local_planner(space)
    for q in draw_near_borders(space, rng, 12):
        (typed,) = read_configurations(edges.format_configuration(q))
        assert cells_of(space, typed) == cells_of(space, q)
        assert space.motion_is_free(typed, typed) == space.motion_is_free(q, q)


def build_strip(spacing: float) -> CSpace:
    """Build a map of a point with a MIXED column in its middle."""
    states = np.full((1, 41, 9), FREE, dtype=np.uint8)
    states[0, 20] = MIXED
    return make_map(states, "plane", "blocked", spacing)


@pytest.mark.parametrize("spacing", [0.01, 0.1])
def test_start_and_goal_of_a_printed_plan_are_taken_when_typed_back(spacing: float) -> None:
    space = build_strip(spacing)
    start, goal = (20.0 * spacing - 1e-6, 4.5 * spacing), (21.0 * spacing + 1e-7, 4.5 * spacing)
    for end in (goal, (spacing, spacing)):
        plan = planners.plan(space, start, end)
        first, last = read_configurations(repr(plan))
        assert planners.plan(space, first, last).solved == plan.solved
        without_map = pickle.loads(pickle.dumps(plan))
        assert read_configurations(repr(without_map)) == [tuple(plan.start), tuple(plan.goal)]


def test_few_digits_are_printed_where_they_suffice() -> None:
    workspace = Workspace.from_array(np.zeros((60, 60), dtype=bool), 0.1)
    space = build(workspace, Robot.rectangle(0.3, 0.2), rotations=8)
    text = local_planner(space).format_configuration((1.0 / 3.0, 2.25, math.pi / 7.0))
    assert text == "(0.3333, 2.25, 0.4488)"


def test_the_nearest_configuration_of_an_error_is_taken_when_typed_back() -> None:
    states = np.full((1, 2000, 3), MIXED, dtype=np.uint8)
    states[0, 1250, 1] = states[0, 1999] = FREE  # the center of the first is at 12.505 m
    space = make_map(states, "plane", "blocked", 0.01, lower=(1000.0, 0.0))
    with pytest.raises(ConfigurationError) as refused:
        planners.plan(space, (1012.0, 0.015), (1012.0, 0.015))
    (nearest,) = read_configurations(refused.value.hint)
    assert nearest == pytest.approx(refused.value.nearest)
    assert planners.plan(space, nearest, nearest).solved


def test_a_command_takes_the_nearest_configuration_that_it_printed(tmp_path: Path) -> None:
    occupied = np.zeros((50, 50), dtype=bool)
    occupied[20:30] = True
    workspace = Workspace.from_array(occupied, 0.01, lower=(12000.0, -7.0))
    space = build(workspace, Robot.rectangle(0.04, 0.02), rotations=12)
    space.save(tmp_path / "m.zarr")
    goal = "--goal=12000.1,-6.9,0"
    refused = run("plan", tmp_path / "m.zarr", "--start=12000.24,-6.7,0.3", goal)
    assert refused.exit_code == 2
    nearest = read_configurations(refused.stderr)[-1]
    again = run("plan", tmp_path / "m.zarr", f"--start={','.join(map(str, nearest))}", goal)
    assert again.exit_code == 0, again.stderr


def test_joints_at_their_limits_are_taken_when_typed_back(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    links = link("base"), link("mast"), link("head", ((0.1, 0.1, 0.1), (0.5, 0, 0)))
    spin = joint("spin", "base", "mast", limits=(-math.pi, math.pi))
    lift = joint("lift", "mast", "head", limits=(-1, 1))
    space = build_arm_space({}, Arm.from_urdf(write_urdf(tmp_path, *links, spin, lift)))
    plan = planners.plan(space, (-math.pi, 0.123456), (math.pi, 0.5), seed=0)
    start, goal = read_configurations(repr(plan))
    assert plan.solved and planners.plan(space, start, goal, seed=0).solved
    assert start == pytest.approx(plan.start, abs=1e-3)
    assert goal == pytest.approx(plan.goal, abs=1e-3)
