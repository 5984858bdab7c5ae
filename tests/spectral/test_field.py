"""Overlap fields on maps and in plans."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

import planners
from cspace import InputError, Robot, Rotations, Workspace, build
from cspace.spectral import FourierOverlap, OverlapField
from tests.helpers.planning import make_state
from tests.helpers.refusals import refusals

pytest.importorskip("finufft")

OBSTACLE = np.array([[1.0, 0.32, 0.5]]), 0.3
"""Center and radius of the ball in the way."""
ROTATIONS = {
    "plane": None,
    "turning": 5,
    "shared slices": 12,
    "space": None,
    "tumbling": Rotations.quaternions(1),
}


def build_scene(kind):
    """Build a map around a ball for a robot of balls, and their overlap."""
    dim = 3 if kind in ("space", "tumbling") else 2
    offsets = {"plane": [0.0], "shared slices": [-0.15, 0.15]}.get(kind, [0.0, 0.15])
    centers = np.zeros((len(offsets), dim))
    centers[:, 0] = offsets
    obstacle = OBSTACLE[0][:, :dim], OBSTACLE[1]
    bounds = *[0.0] * dim, *(2.0, 1.6, 1.0)[:dim]
    workspace = Workspace.from_balls(*obstacle, 0.1, bounds=bounds)
    space = build(workspace, Robot.from_balls(centers, 0.12), rotations=ROTATIONS[kind])
    return space, FourierOverlap.of_shapes((centers, 0.12), obstacle, swell=0.2)


def draw_configurations(space, rng, number):
    """Draw positions near the grid, its border included, and yaws if the robot turns."""
    lower = np.array(space.grid.lower)
    upper = np.array(space.grid.upper)
    margin = 0.04 * space.grid.spacing
    positions = rng.uniform(
        lower - 2.0 * space.grid.spacing, upper + 2.0 * space.grid.spacing, (number, len(lower))
    )
    positions = positions.clip(lower + margin, upper - margin)
    yaws = rng.uniform(-7.0, 7.0, (number, len(space.rotations.names)))
    return np.column_stack([positions, yaws])


@pytest.mark.parametrize("kind", ROTATIONS)
def test_field_has_the_overlap_at_cell_centers(kind):
    space, overlap = build_scene(kind)
    field = OverlapField.of(space, overlap)
    rng = np.random.default_rng(0)
    rotation_cells = space.rotations._make_shape_cells(space.grid.dim)
    largest = field.values.max()
    assert largest > 1e-3
    for number, cell in enumerate(rotation_cells):
        placed = overlap if cell.matrix is None else overlap.rotated(cell.matrix)
        indices = rng.integers(0, space.grid.shape, (20, space.grid.dim))
        centers = space.grid.center_of(indices)
        rotation = np.broadcast_to(
            space.rotations.centers[number], (20, space.size - space.grid.dim)
        )
        values = field.at(np.column_stack([centers, rotation]))
        expected = np.maximum(placed.value(centers), 0.0)
        assert values == pytest.approx(expected, abs=1e-7 * largest)


@pytest.mark.parametrize("kind", ["plane", "turning", "space"])
def test_fields_are_linear_between_cell_centers_also_in_objectives(kind):
    """Draw the values of a field, some of them below zero."""
    space, _ = build_scene(kind)
    rng = np.random.default_rng(1)
    dim = space.grid.dim
    slices = len(space.slice_of)
    values = rng.uniform(-0.2, 1.0, (slices, *space.grid.shape))
    field = OverlapField(space, values if kind == "turning" else values[0])
    q = draw_configurations(space, rng, 100)
    axes = [space.grid.centers(axis) for axis in range(dim)]
    inside = q[:, :dim].clip([axis[0] for axis in axes], [axis[-1] for axis in axes])
    cells = space.rotations._find_cells(q)
    expected = [
        RegularGridInterpolator(axes, values[cell])(position)[0]
        for cell, position in zip(cells, inside, strict=True)
    ]
    expected = np.maximum(expected, 0.0)
    assert field.at(q) == pytest.approx(expected, abs=1e-12)
    assert field.at(q[0]) == field.at(q)[0]
    with pytest.raises(InputError, match="nan"):
        field.at(np.full(space.size, np.nan))

    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.OverlapObjective(si, space, field, weight=4.0, saturation=0.5)
    states = [make_state(space, si, row) for row in q]
    costs = [objective.stateCost(state).value() for state in states]
    assert costs == pytest.approx(1.0 + 4.0 * (expected / 0.5) ** 2)
    if kind == "turning":
        return
    shares = (np.arange(2000) + 0.5)[:, None] / 2000
    for k in range(6):
        step = q[k + 1] - q[k]
        length = float(np.linalg.norm(step))
        factor = 1.0 + 4.0 * np.mean((field.at(q[k] + shares * step) / 0.5) ** 2)
        motion = states[k], states[k + 1]
        assert objective.motionCost(*motion).value() == pytest.approx(length * factor, rel=0.1)
        assert objective.motionCostHeuristic(*motion).value() == pytest.approx(length)


@pytest.fixture(scope="module")
def small():
    return build(Workspace.from_array(np.zeros((3, 2), dtype=bool), 0.1), Robot.disc(0.01))


FAR = FourierOverlap(([[0.0, 0.0]], 0.05), ([[9.0, 9.0]], 0.1), band=20.0)
BALL = ([[0.0, 0.0, 0.0]], 0.2)


def make_objective(space, field, **options):
    """Make an overlap objective on a map."""
    si = planners.simple_setup(space).getSpaceInformation()
    return planners.OverlapObjective(si, space, field, **options)


@refusals(
    "ask, message",
    (lambda space: OverlapField(space, np.zeros((2, 3))), r"values has shape \(2, 3\)"),
    (lambda space: OverlapField.of(space, FourierOverlap(BALL, BALL, band=5.0)), "must agree"),
    (
        lambda space: make_objective(space, OverlapField.of(build_scene("plane")[0], FAR)),
        "field and objective must share a map",
    ),
)
def test_fields_and_objectives_refuse_invalid_arguments(small, ask, message):
    with pytest.raises(InputError, match=message):
        ask(small)
