"""Overlap fields on maps and in plans."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import planners
from cspace import FREE, CSpace, Grid, InputError, Robot, Workspace, build
from cspace.arrays import FIELD_NAME
from cspace.rotations import Rotations
from cspace.spectral import BallDescriptor, Bump, FourierOverlap, OverlapField
from cspace.spectral.overlap import _CellValues, rotation_matrix
from tests.handmade import map_in
from tests.maps import same
from tests.planning import make_state
from tests.refusals import refusals
from tests.spectral.test_overlap import compute_ideals
from tests.strategies import seeds

pytest.importorskip("finufft")

OBSTACLE, RADIUS = (1.0, 0.32, 0.5), 0.3
FIELD_KINDS = ["plane", "shared", "space"]
OBSTACLES = np.array([[1.5, 1.0], [1.5, 1.4], [3.0, 2.6], [3.3, 2.4]]), np.full(4, 0.3)
ROBOT = np.array([[-0.2, 0.0], [0.2, 0.0], [0.3, 0.1]]), np.array([0.15, 0.15, 0.1])


def compute_overlap(robot: Any, obstacles: Any, **options: Any) -> FourierOverlap:
    return FourierOverlap.of_shapes(robot, obstacles, swell=0.15, tolerance=1e-3, **options)


def build_scene(kind: str, **options: Any) -> tuple[CSpace, FourierOverlap]:
    """Build a map with a ball 0.14 m off a course."""
    dim = 3 if kind == "space" else 2
    centers, radii = np.array([OBSTACLE[:dim]]), np.array([RADIUS])
    balls = np.zeros((1 if kind in ("plane", "space") else 2, dim))
    balls[1:, 0] = 0.15
    if kind == "shared":
        balls[0, 0] = -0.15
    robot = balls, np.full(len(balls), 0.12)
    workspace = Workspace.from_balls(centers, radii, 0.05, bounds=(*[0.0] * dim, *(2.0, 1.6, 1.0)[:dim]))
    turns = 12 if kind in ("turning", "shared") else None
    overlap = FourierOverlap.of_shapes(robot, (centers, radii), swell=0.2)
    return build(workspace, Robot.from_balls(*robot), rotations=turns, **options), overlap


@pytest.fixture(scope="module", params=["plane", "turning", "space"])
def case(request: pytest.FixtureRequest) -> tuple[CSpace, FourierOverlap]:
    if request.param == "space":
        centers = np.array([[0.5, 0.5, 0.6], [1.2, 1.0, 0.5]])
        workspace = Workspace.from_balls(centers, 0.25, 0.1, bounds=(0, 0, 0, 1.6, 1.5, 1.2))
        robot = Robot.from_balls([[0.0, 0.0, 0.0], [0.15, 0.0, 0.0]], 0.12)
        return build(workspace, robot), compute_overlap(robot, (centers, 0.25))
    workspace = Workspace.from_balls(*OBSTACLES, 0.1, bounds=(0, 0, 4.6, 3.7))
    turns = 5 if request.param == "turning" else None
    return build(workspace, Robot.from_balls(*ROBOT), rotations=turns), compute_overlap(ROBOT, OBSTACLES)


@pytest.fixture(scope="module")
def field(case: tuple[CSpace, FourierOverlap]) -> OverlapField:
    return OverlapField.of(*case)


def test_field_has_the_overlap_at_cell_centers(case: tuple[CSpace, FourierOverlap], field: OverlapField) -> None:
    space, overlap = case
    largest, cells = field.values.max(), np.argwhere(field.values > -1.0)
    assert largest > 1e-3
    for index in np.random.default_rng(0).choice(cells, 20):
        number, cell = (index[0], index[1:]) if space.rotations.names else (0, index)
        placed = overlap
        if space.rotations.names:
            placed = overlap.rotated(float(space.rotations.centers[:, 0][number]))
        # Field and overlap have other periods, so that each leaves out other frequencies.
        assert field.values[tuple(index)] == pytest.approx(
            placed.value(space.grid.center_of(cell)), abs=2.1 * overlap.bound
        )


@settings(max_examples=30)
@given(dim=st.sampled_from([2, 3]), seed=seeds)
def test_values_of_cells_are_sums_over_pairs_of_balls_within_the_bound(dim: int, seed: int) -> None:
    # The lattice may be coarser or finer than the band, and the grid may lie anywhere.
    rng = np.random.default_rng(seed)
    robot, obstacles = (
        (rng.uniform(-0.4, 0.4, (n, dim)) + rng.uniform(-2.0, 2.0, dim), rng.choice([0.15, 0.25], n)) for n in (3, 4)
    )
    turn = Rotation.random(random_state=seed).as_matrix() if dim == 3 else rng.uniform(-3.0, 3.0)
    overlap = FourierOverlap(robot, obstacles, band=rng.choice([1.5, 6.0 if dim == 3 else 20.0])).rotated(turn)
    spacing, shape = rng.choice([0.03, 0.1, 0.4] if dim == 2 else [0.1, 0.4]), rng.integers(1, 24, dim)
    low, high = overlap.domain
    grid = Grid(rng.uniform(low, high) - spacing * shape * rng.uniform(0.0, 1.0, dim), spacing, shape)
    made, values = _CellValues(overlap, grid), np.zeros(grid.shape)
    made.write(None, values)
    cells = np.stack([rng.integers(n, size=30) for n in grid.shape], axis=1)
    moved = (robot[0] @ rotation_matrix(turn, dim).T, robot[1])
    ideal, error = compute_ideals(moved, obstacles, Bump(2.0), grid.center_of(cells))
    assert np.abs(values[tuple(cells.T)] - ideal).max() <= made.overlap.bound * (1.0 + 2.0**-5) + error
    # Sums over the band, ring by ring, agree to rounding.
    series = made.overlap.value(grid.center_of(cells))
    scale = math.prod(BallDescriptor(*balls).integral for balls in (robot, obstacles)) / math.prod(made.overlap.lengths)
    assert np.abs(values[tuple(cells.T)] - series).max() <= 1e-8 * scale


def test_field_is_linear_between_cell_centers(case: tuple[CSpace, FourierOverlap], field: OverlapField) -> None:
    space, _ = case
    dim, rng = space.grid.dim, np.random.default_rng(1)
    low, high = np.array(space.grid.lower), np.array(space.grid.upper)
    q = rng.uniform(low, high, (200, dim))
    middles = space.grid.center_of(space.grid.cell_of(q))
    if space.rotations.names:
        yaw = rng.uniform(-7.0, 7.0, 200)
        q, middles = np.column_stack([q, yaw]), np.column_stack([middles, yaw])
    from scipy.interpolate import RegularGridInterpolator

    stack = field.values.reshape(-1, *space.grid.shape)
    axes = [space.grid.centers(axis) for axis in range(dim)]
    numbers = space.rotations.cell_of(q[:, 2]) if space.rotations.names else np.zeros(200, dtype=int)
    positions = np.clip(q[:, :dim], [axis[0] for axis in axes], [axis[-1] for axis in axes])
    expected = [RegularGridInterpolator(axes, stack[n])(p)[0] for n, p in zip(numbers, positions, strict=True)]
    assert field.at(q) == pytest.approx(np.maximum(expected, 0.0), abs=1e-12)
    check = field.checker()
    assert [check(*row) for row in q] == field.at(q).tolist()
    cells = tuple(space.grid.cell_of(q[:, :dim]).T)
    assert field.at(middles) == pytest.approx(np.maximum(stack[(numbers, *cells)], 0.0), abs=1e-12)
    assert field.at(q[0]) == field.at(q)[0]
    with pytest.raises(InputError, match="nan"):
        field.at(np.where(np.arange(space.size) == 1, np.nan, 0.0))


def test_objective_weights_length_by_the_overlap(case: tuple[CSpace, FourierOverlap], field: OverlapField) -> None:
    space, _ = case
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.OverlapObjective(si, space, field, weight=4.0, saturation=0.01)
    turning = len(space.rotations.names)
    rng = np.random.default_rng(2)
    low, high = np.array(space.grid.lower), np.array(space.grid.upper)
    q = rng.uniform(low, high, (12, space.grid.dim))
    if turning:
        q = np.column_stack([q, rng.uniform(-3.0, 3.0, 12)])
    states = [make_state(space, si, row) for row in q]
    at_states = [objective.stateCost(state).value() for state in states]
    assert at_states == pytest.approx(1.0 + 4.0 * (field.at(q) / 0.01) ** 2)
    assert max(at_states) > 1.0
    for k in range(11):
        cost = objective.motionCost(states[k], states[k + 1]).value()
        length = float(np.linalg.norm(q[k + 1, : space.grid.dim] - q[k, : space.grid.dim]))
        assert objective.motionCostHeuristic(states[k], states[k + 1]).value() == pytest.approx(length)
        assert cost >= length * (1.0 - 1e-12)
        if not turning:
            share = (np.arange(4000) + 0.5)[:, None] / 4000
            along = field.at(q[k] + share * (q[k + 1] - q[k]))
            assert cost == pytest.approx(
                length * (1.0 + 4.0 * np.mean((along / 0.01) ** 2)), rel=0.05, abs=0.05 * length
            )


@refusals(
    "options, message",
    ({"weight": -1.0}, "weight is -1"),
    ({"saturation": 0.0}, "saturation is 0"),
    ({"turning_radius": 1.0}, "turning_radius"),
)
def test_overlap_objective_refuses_invalid_options(
    case: tuple[CSpace, FourierOverlap], field: OverlapField, options: dict[str, float], message: str
) -> None:
    space, _ = case
    with pytest.raises(InputError, match=message):
        planners.OverlapObjective(planners.simple_setup(space).getSpaceInformation(), space, field, **options)


def test_overlap_objective_refuses_the_field_of_another_map(case: tuple[CSpace, FourierOverlap]) -> None:
    space, overlap = case
    other = OverlapField.of(build(space.workspace, space.robot, rotations=None), overlap)
    with pytest.raises(InputError, match="another map"):
        planners.OverlapObjective(planners.simple_setup(space).getSpaceInformation(), space, other)


def test_fields_refuse_invalid_overlaps(case: tuple[CSpace, FourierOverlap]) -> None:
    space, _ = case
    flat = ([[0.0] * (5 - space.grid.dim)], 0.2)
    with pytest.raises(InputError, match="must agree"):
        OverlapField.of(space, FourierOverlap(flat, flat, band=5.0))
    for wrong in (None, 3, "x", [1, 2]):
        with pytest.raises(InputError, match=r"overlap is a .*FourierOverlap"):
            space.with_overlap_field(wrong)


def test_objective_without_overlap_is_the_length() -> None:
    space = build(Workspace.from_array(np.zeros((10, 10), dtype=bool), 0.1), Robot.disc(0.05))
    far = FourierOverlap(([[0.0, 0.0]], 0.05), ([[9.0, 9.0]], 0.1), band=20.0)
    field = OverlapField.of(space, far)
    assert (field.values == 0.0).all() and (space.cell_states == FREE).any()
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.OverlapObjective(si, space, field)
    states = [make_state(space, si, np.array(q)) for q in ((0.2, 0.2), (0.5, 0.6))]
    assert objective.motionCost(*states).value() == pytest.approx(0.5)


# ---- the field that a map carries ------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=FIELD_KINDS)
def carried(request: pytest.FixtureRequest) -> CSpace:
    space, overlap = build_scene(request.param)
    return space.with_overlap_field(overlap)


def replace_field(space: CSpace, field: Any = None) -> CSpace:
    """Return the same map with another field, or none."""
    options = {name: getattr(space, name) for name in ("outside", "margin")} | {"proves_blocked": True}
    states, counts = space._kernel_map.states.copy(), space.overlap_counts
    overlap_counts = None if counts is None else counts.reshape(states.shape)
    return map_in(
        space.workspace,
        space.robot,
        states,
        space.rotations,
        overlap_counts=overlap_counts,
        field=field,
        **options,
    )


@pytest.mark.parametrize("kind", [*FIELD_KINDS, "turning"])
def test_with_overlap_field_changes_only_the_field(kind: str) -> None:
    space, overlap = build_scene(kind, counts=True, margin=0.01)
    clearance = space.clearance(space.nearest_free([0.0] * space.size))
    with_field, expected = space.with_overlap_field(overlap), OverlapField.of(space, overlap)
    same(space, replace_field(with_field))
    assert space.overlap_field is None and with_field.overlap_field is not None
    assert with_field.overlap_field.space is with_field and with_field.overlap_field.values.max() > 0.0
    np.testing.assert_array_equal(with_field.overlap_field.values, expected.values)
    with pytest.raises(ValueError):
        with_field.overlap_field.values[...] = 0.0
    assert with_field.clearance(with_field.nearest_free([0.0] * space.size)) == clearance
    assert (kind == "shared") == (len(space.rotations.names) and len(space._kernel_map.states) < len(space.rotations))
    again = build(with_field.workspace, with_field.robot, rotations=with_field.rotations)
    assert again.overlap_field is None and FIELD_NAME not in again.to_xarray()


@pytest.mark.parametrize("kind", [*FIELD_KINDS, "turning"])
def test_update_drops_the_field_and_leaves_other_maps(kind: str) -> None:
    space, overlap = build_scene(kind)
    with_field = space.with_overlap_field(overlap)
    box, corner = np.ones((3,) * space.grid.dim, bool), (4,) * space.grid.dim
    before = space.cell_states.copy()
    with_field.update(box, corner)
    assert with_field.overlap_field is None and (space.cell_states == before).all()
    again = with_field.with_overlap_field(overlap)  # the updated map no longer shares its workspace
    after, cells = again.cell_states.copy(), again.workspace.outer.copy()
    with_field.update(~box, corner)
    assert (again.cell_states == after).all() and (again.workspace.outer == cells).all()
    assert again.overlap_field is not None


def make_values(shape: tuple[int, ...] = (3, 2), bad: float = 0.0, kind: type = np.float64) -> Any:
    """Return zeros, except the last value."""
    values = np.zeros(shape, kind)
    values.flat[-1] = bad
    return values


@refusals(
    "values, message",
    (make_values((2, 3)), r"penetration has shape \(2, 3\) .* the map's shape \(3, 2\)"),
    (make_values((1, 3, 2)), r"penetration has shape \(1, 3, 2\)"),
    (make_values(bad=np.nan), r"penetration\[2, 1\] is nan"),
    (make_values(bad=np.inf), r"penetration\[2, 1\] is inf"),
    (make_values(bad=-np.inf), r"penetration\[2, 1\] is -inf"),
    (make_values(kind=np.float32), "type float32"),
)
def test_field_refuses_invalid_values(values: Any, message: str) -> None:
    space = build(Workspace.from_array(np.zeros((3, 2), dtype=bool), 0.1), Robot.disc(0.01))
    for make in (lambda: replace_field(space, values), lambda: OverlapField(space, values)):
        with pytest.raises(InputError, match=message):
            make()


def test_field_refuses_to_exceed_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    space, overlap = build_scene("plane")
    needed = 8 * space.grid.size
    monkeypatch.setattr("cspace.limits.free_bytes", lambda: needed)
    with pytest.raises(InputError, match=r"the overlap field has 40 x 32 cells .* may be used.* use a spacing of"):
        space.with_overlap_field(overlap)
    monkeypatch.setattr("cspace.limits.free_bytes", lambda: 2 * needed)
    with pytest.raises(InputError, match="the lattice of the overlap field"):
        space.with_overlap_field(overlap)


def test_second_field_replaces_the_first() -> None:
    space, overlap = build_scene("plane")
    first = space.with_overlap_field(overlap)
    wide = FourierOverlap.of_shapes(([[0.0, 0.0]], 0.12), ([[1.0, 0.32]], 0.3), swell=0.4)
    second = first.with_overlap_field(wide)
    assert first.overlap_field is not None and second.overlap_field is not None
    same(second, space.with_overlap_field(wide))
    np.testing.assert_array_equal(second.overlap_field.values, OverlapField.of(space, wide).values)
    assert (second.overlap_field.values > first.overlap_field.values).any()
    np.testing.assert_array_equal(first.overlap_field.values, OverlapField.of(space, overlap).values)


def find_endpoints(space: CSpace) -> tuple[tuple[float, ...], tuple[float, ...]]:
    more = (0.0,) if space.rotations.names else (0.51,) * (space.size - 2)
    return (0.43, 0.88, *more), (1.57, 0.88, *more)


def measure_smallest_distance(space: CSpace, plan: planners.Plan) -> float:
    """Return the distance to the obstacle along a path."""
    share, dim, distances = np.linspace(0.0, 1.0, 60)[:, None], space.grid.dim, []
    for first, second in zip(plan.waypoints[:-1], plan.waypoints[1:], strict=True):
        step = second - first
        if space.rotations.names:
            step[2] = (step[2] + np.pi) % (2.0 * np.pi) - np.pi
        q = first + share * step
        placed = np.repeat(space.robot.shape.centers[None], len(q), axis=0)
        if space.rotations.names:
            turn = np.array([[np.cos(q[:, 2]), -np.sin(q[:, 2])], [np.sin(q[:, 2]), np.cos(q[:, 2])]])
            placed = np.einsum("ijn,bj->nbi", turn, space.robot.shape.centers)
        away = np.linalg.norm(placed + q[:, None, :dim] - OBSTACLE[:dim], axis=-1)
        distances.append((away - space.robot.shape.radii).min() - RADIUS)
    return float(min(distances))


@pytest.mark.parametrize("kind", ["plane", "turning"])
def test_overlap_objective_keeps_paths_farther_from_obstacles(kind: str) -> None:
    """Compare with the straight line, found without weight."""
    space, overlap = build_scene(kind)
    carried = space.with_overlap_field(overlap)
    options: dict[str, Any] = {"planner": "RRTstar", "time_limit": 120.0, "iterations": 200, "seed": 1}
    plans = [
        planners.plan(carried, *find_endpoints(space), objective=objective, **options)
        for objective in (
            "length",
            lambda si: planners.OverlapObjective(si, carried, weight=0.0),
            lambda si: planners.OverlapObjective(si, carried, weight=100.0),
        )
    ]
    assert all(plan.solved and plan.certified for plan in plans)
    short, straight, far = (measure_smallest_distance(space, plan) for plan in plans)
    assert short == pytest.approx(0.14, abs=0.001) and straight == pytest.approx(0.14, abs=0.01)
    assert far > 0.19
    assert plans[2].length > plans[1].length


def test_objective_by_name_uses_the_field_of_the_map(carried: CSpace) -> None:
    options: dict[str, Any] = {"planner": "RRTstar", "time_limit": 120.0, "iterations": 60, "seed": 3}
    plans = [
        planners.plan(carried, *find_endpoints(carried), objective=objective, **options)
        for objective in (
            "overlap",
            lambda si: planners.OverlapObjective(si, carried),
            lambda si: planners.OverlapObjective(si, carried, carried.overlap_field),
        )
    ]
    assert plans[0].objective == "overlap"
    for plan in plans[1:]:
        np.testing.assert_array_equal(plan.waypoints, plans[0].waypoints)


def test_overlap_objective_refuses_a_map_without_field() -> None:
    plain, overlap = build_scene("plane")
    carried = plain.with_overlap_field(overlap)
    start, goal = find_endpoints(plain)
    si = planners.simple_setup(plain).getSpaceInformation()
    with pytest.raises(InputError, match=r"the map carries none; .* plan on space\.with_overlap_field"):
        planners.OverlapObjective(si, plain)
    for end in (goal, start):  # also if start and goal are equal
        with pytest.raises(InputError, match="the map carries none"):
            planners.plan(plain, start, end, planner="RRTstar", objective="overlap")
    with pytest.raises(InputError, match="another map"):
        planners.OverlapObjective(si, plain, carried.overlap_field)
    with pytest.raises(InputError, match="RRT ignores objectives"):
        planners.plan(carried, start, goal, planner="RRT", objective="overlap")


def test_field_supports_rotations_in_space() -> None:
    """Compare with rotated balls at cell centers."""
    balls = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]), np.full(2, 0.08)
    obstacles = np.array([[0.5, 0.5, 0.5]]), np.array([0.15])
    workspace = Workspace.from_balls(*obstacles, 0.1, bounds=(0, 0, 0, 1, 1, 1))
    space = build(workspace, Robot.from_balls(*balls), rotations=Rotations.quaternions(1))
    overlap = FourierOverlap.of_shapes(balls, obstacles, swell=0.1)
    field = OverlapField.of(space, overlap)
    turns = Rotation.random(5, random_state=1)
    q = np.column_stack([np.tile([0.45, 0.45, 0.35], (5, 1)), turns.as_quat()])
    matrices = [turn.matrix for turn in space.rotations._shape_cells(3)]
    expected = [overlap.rotated(matrices[k]).value(q[0, :3]) for k in space.rotations.cell_of(turns.as_quat())]
    assert field.at(q) == pytest.approx(expected, rel=1e-6) and min(expected) > 0.0
    assert [field.checker()(*row) for row in q.tolist()] == field.at(q).tolist()
