"""Overlap fields on maps and in plans."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import planners
from cspace import FREE, CSpace, InputError, Robot, Workspace, build
from cspace.rotations import Rotations
from cspace.spectral import FourierOverlap, OverlapField
from tests.helpers.planning import make_state
from tests.helpers.refusals import refusals

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
    workspace = Workspace.from_balls(
        centers, radii, 0.05, bounds=(*[0.0] * dim, *(2.0, 1.6, 1.0)[:dim])
    )
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
    return build(workspace, Robot.from_balls(*ROBOT), rotations=turns), compute_overlap(
        ROBOT, OBSTACLES
    )


@pytest.fixture(scope="module")
def field(case: tuple[CSpace, FourierOverlap]) -> OverlapField:
    return OverlapField.of(*case)


def test_field_has_the_overlap_at_cell_centers(
    case: tuple[CSpace, FourierOverlap], field: OverlapField
) -> None:
    space, overlap = case
    largest, cells = field.values.max(), np.argwhere(field.values > -1.0)
    assert largest > 1e-3
    for index in np.random.default_rng(0).choice(cells, 20):
        number, cell = (index[0], index[1:]) if space.rotations.names else (0, index)
        placed = overlap
        if space.rotations.names:
            placed = overlap.rotated(float(space.rotations.centers[:, 0][number]))
        value = placed.value(space.grid.center_of(cell))
        assert field.values[tuple(index)] == pytest.approx(value, abs=1e-7 * largest)


def test_field_is_linear_between_cell_centers(
    case: tuple[CSpace, FourierOverlap], field: OverlapField
) -> None:
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
    numbers = (
        space.rotations.cell_of(q[:, 2]) if space.rotations.names else np.zeros(200, dtype=int)
    )
    positions = np.clip(q[:, :dim], [axis[0] for axis in axes], [axis[-1] for axis in axes])
    expected = [
        RegularGridInterpolator(axes, stack[n])(p)[0]
        for n, p in zip(numbers, positions, strict=True)
    ]
    assert field.at(q) == pytest.approx(np.maximum(expected, 0.0), abs=1e-12)
    cells = tuple(space.grid.cell_of(q[:, :dim]).T)
    assert field.at(middles) == pytest.approx(np.maximum(stack[(numbers, *cells)], 0.0), abs=1e-12)
    assert field.at(q[0]) == field.at(q)[0]
    with pytest.raises(InputError, match="nan"):
        field.at(np.where(np.arange(space.size) == 1, np.nan, 0.0))


def test_objective_weights_length_by_the_overlap(
    case: tuple[CSpace, FourierOverlap], field: OverlapField
) -> None:
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
        assert objective.motionCostHeuristic(states[k], states[k + 1]).value() == pytest.approx(
            length
        )
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
    case: tuple[CSpace, FourierOverlap],
    field: OverlapField,
    options: dict[str, float],
    message: str,
) -> None:
    space, _ = case
    with pytest.raises(InputError, match=message):
        planners.OverlapObjective(
            planners.simple_setup(space).getSpaceInformation(), space, field, **options
        )


def test_overlap_objective_refuses_the_field_of_another_map(
    case: tuple[CSpace, FourierOverlap],
) -> None:
    space, overlap = case
    other = OverlapField.of(build(space.workspace, space.robot, rotations=None), overlap)
    with pytest.raises(InputError, match="no overlap field of this map"):
        planners.OverlapObjective(planners.simple_setup(space).getSpaceInformation(), space, other)


def test_fields_refuse_invalid_overlaps(case: tuple[CSpace, FourierOverlap]) -> None:
    space, _ = case
    flat = ([[0.0] * (5 - space.grid.dim)], 0.2)
    with pytest.raises(InputError, match="must agree"):
        OverlapField.of(space, FourierOverlap(flat, flat, band=5.0))
    for wrong in (None, 3, "x", [1, 2]):
        with pytest.raises(InputError, match=r"overlap is a .*FourierOverlap"):
            OverlapField.of(space, wrong)


def test_objective_without_overlap_is_the_length() -> None:
    space = build(Workspace.from_array(np.zeros((10, 10), dtype=bool), 0.1), Robot.disc(0.05))
    far = FourierOverlap(([[0.0, 0.0]], 0.05), ([[9.0, 9.0]], 0.1), band=20.0)
    field = OverlapField.of(space, far)
    assert (field.values == 0.0).all() and (space.cell_states == FREE).any()
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.OverlapObjective(si, space, field)
    states = [make_state(space, si, np.array(q)) for q in ((0.2, 0.2), (0.5, 0.6))]
    assert objective.motionCost(*states).value() == pytest.approx(0.5)


def test_field_stands_beside_the_map() -> None:
    space, overlap = build_scene("plane")
    field = OverlapField.of(space, overlap)
    before = field.values.copy()
    with pytest.raises(ValueError):
        field.values[...] = 0.0
    space.update(np.ones((3, 3), bool), (4, 4))
    assert (field.values == before).all()
    again = OverlapField(space, before)
    assert again.at((0.7, 0.5)) == field.at((0.7, 0.5)) > 0.0


def make_values(shape: tuple[int, ...] = (3, 2), bad: float = 0.0, kind: type = np.float64) -> Any:
    """Return zeros, except the last value."""
    values = np.zeros(shape, kind)
    values.flat[-1] = bad
    return values


@refusals(
    "values, message",
    (make_values((2, 3)), r"values has shape \(2, 3\) .* the map's shape \(3, 2\)"),
    (make_values((1, 3, 2)), r"values has shape \(1, 3, 2\)"),
    (make_values(bad=np.nan), r"values\[2, 1\] is nan"),
    (make_values(bad=np.inf), r"values\[2, 1\] is inf"),
    (make_values(bad=-np.inf), r"values\[2, 1\] is -inf"),
    (make_values(kind=np.float32), "type float32"),
)
def test_field_refuses_invalid_values(values: Any, message: str) -> None:
    space = build(Workspace.from_array(np.zeros((3, 2), dtype=bool), 0.1), Robot.disc(0.01))
    with pytest.raises(InputError, match=message):
        OverlapField(space, values)


def test_field_refuses_to_exceed_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    space, overlap = build_scene("plane")
    needed = 8 * space.grid.size
    monkeypatch.setattr("cspace.limits.free_bytes", lambda: needed)
    with pytest.raises(
        InputError, match=r"the overlap field has 40 x 32 cells .* may be used.* use a spacing of"
    ):
        OverlapField.of(space, overlap)


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
            turn = np.array(
                [[np.cos(q[:, 2]), -np.sin(q[:, 2])], [np.sin(q[:, 2]), np.cos(q[:, 2])]]
            )
            placed = np.einsum("ijn,bj->nbi", turn, space.robot.shape.centers)
        away = np.linalg.norm(placed + q[:, None, :dim] - OBSTACLE[:dim], axis=-1)
        distances.append((away - space.robot.shape.radii).min() - RADIUS)
    return float(min(distances))


@pytest.mark.parametrize("kind", ["plane", "turning"])
def test_overlap_objective_keeps_paths_farther_from_obstacles(kind: str) -> None:
    """Compare with the straight line, found without weight."""
    space, overlap = build_scene(kind)
    field = OverlapField.of(space, overlap)
    options: dict[str, Any] = {
        "planner": "RRTstar",
        "time_limit": 120.0,
        "iterations": 200,
        "seed": 1,
    }
    plans = [
        planners.plan(space, *find_endpoints(space), objective=objective, **options)
        for objective in (
            "length",
            lambda si: planners.OverlapObjective(si, space, field, weight=0.0),
            lambda si: planners.OverlapObjective(si, space, field, weight=100.0),
        )
    ]
    assert all(plan.solved and plan.certified for plan in plans)
    short, straight, far = (measure_smallest_distance(space, plan) for plan in plans)
    assert short == pytest.approx(0.14, abs=0.001) and straight == pytest.approx(0.14, abs=0.01)
    assert far > 0.19
    assert plans[2].length > plans[1].length


def test_overlap_objective_refuses_what_is_no_field() -> None:
    space, overlap = build_scene("plane")
    si = planners.simple_setup(space).getSpaceInformation()
    for wrong in (None, overlap, np.zeros(space.grid.shape)):
        with pytest.raises(
            InputError, match=r"no overlap field of .*OverlapField\.of\(space, overlap\)"
        ):
            planners.OverlapObjective(si, space, wrong)  # type: ignore[arg-type]


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
    matrices = [turn.matrix for turn in space.rotations.make_shape_cells(3)]
    expected = [
        overlap.rotated(matrices[k]).value(q[0, :3])
        for k in space.rotations.cell_of(turns.as_quat())
    ]
    assert field.at(q) == pytest.approx(expected, rel=1e-6) and min(expected) > 0.0
