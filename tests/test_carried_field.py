"""A map that carries an overlap field is the same map, and is planned on with it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import cspace
from cspace import CSpace, InputError, Robot, Workspace, build
from cspace.cli import app
from cspace.spectral import FourierOverlap, OverlapField
from cspace.states import FIELDS
from maps import same

OBSTACLE, RADIUS = (1.0, 0.32, 0.5), 0.3
KINDS = ["plane", "turning", "shared", "space"]


def names_of(space: CSpace) -> tuple[str, ...]:
    return FIELDS[: 1 + space.grid.dim]


def shape_of(space: CSpace) -> tuple[int, ...]:
    return space.grid.shape if space.rotations is None else space._map.states.shape


def carrying(space: CSpace, fields: Any) -> CSpace:
    """The same map with arrays for a field."""
    return CSpace(
        space.workspace,
        space.robot,
        space._map.states[0] if space.rotations is None else space._map.states,
        outside=space.outside,
        margin=space.margin,
        precision=space.precision,
        overlaps=space.overlaps,
        rotations=space.rotations,
        fields=fields,
    )


def same_field(a: CSpace, b: CSpace) -> None:
    """Fail unless two maps and the fields that they carry are equal, to the last bit."""
    same(a, b)
    for name, array in a._fields.items():
        assert b._fields[name].dtype == np.float64
        assert not b._fields[name].flags.writeable
        assert b._fields[name].tobytes() == array.tobytes()
        assert b._fields[name].shape == array.shape


def scene(kind: str, **options: Any) -> tuple[CSpace, FourierOverlap]:
    """A ball, below a straight way along x, and a robot of balls that passes it at a distance of 0.14 m."""
    pytest.importorskip("finufft")
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
    return build(workspace, Robot.balls(*robot), rotations=turns, **options), overlap


@pytest.fixture(scope="module", params=KINDS)
def carried(request: pytest.FixtureRequest) -> CSpace:
    space, overlap = scene(request.param, overlap=True, margin=0.01)
    return space.with_overlap_field(overlap)


# ---- the map -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_the_map_is_the_same_and_the_field_that_of_the_overlap(kind: str) -> None:
    space, overlap = scene(kind)
    clearance = space.clearance(space.nearest_free([0.0] * space.dof))
    made = space.with_overlap_field(overlap)
    same(space, carrying(made, None))
    assert space.overlap_field is None and not space._fields
    field, expected = made.overlap_field, OverlapField.of(space, overlap)
    assert field is not None and field.space is made
    assert list(made._fields) == list(names_of(space))
    assert field.values.max() > 0.0
    for name, array in made._fields.items():
        np.testing.assert_array_equal(array, expected.arrays[name])
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
    assert made._rasters[0][0] is space._rasters[0][0]  # it is not made again
    assert made.clearance(made.nearest_free([0.0] * space.dof)) == clearance
    assert (kind == "shared") == (space.rotations is not None and len(space._map.states) < space.rotations.count)


@pytest.mark.parametrize("kind", KINDS)
def test_an_update_lets_the_field_go_and_leaves_other_maps(kind: str) -> None:
    space, overlap = scene(kind)
    made = space.with_overlap_field(overlap)
    assert made.overlap_field is not None
    box, corner = np.ones((3,) * space.grid.dim, bool), (4,) * space.grid.dim
    before = space.state.copy()
    made.update(box, corner)
    assert made.overlap_field is None and not made._fields
    assert (space.state == before).all()
    again = made.with_overlap_field(overlap)  # of a map that has a workspace of its own by now
    after, cells = again.state.copy(), again.workspace.outer.copy()
    made.update(~box, corner)
    assert (again.state == after).all() and (again.workspace.outer == cells).all()
    assert again.overlap_field is not None


def test_another_field_takes_the_place_of_the_first() -> None:
    space, overlap = scene("plane")
    first = space.with_overlap_field(overlap)
    wide = FourierOverlap.of_shapes(([[0.0, 0.0]], 0.12), ([[1.0, 0.32]], 0.3), swell=0.4)
    second = first.with_overlap_field(wide)
    same_field(second, space.with_overlap_field(wide))
    assert first.overlap_field is not None and second.overlap_field is not None
    assert (second.overlap_field.values > first.overlap_field.values).any()
    np.testing.assert_array_equal(first.overlap_field.values, OverlapField.of(space, overlap).values)


def test_a_build_makes_maps_without_a_field(carried: CSpace) -> None:
    """Nothing but the map itself carries it: what is built anew, of the same workspace and robot, has none."""
    again = build(carried.workspace, carried.robot, rotations=carried.rotations and carried.rotations.count)
    assert again.overlap_field is None
    assert not set(FIELDS) & set(again.to_xarray())


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"penetration": (3, 2)}, "fields are penetration; .* must be penetration, penetration_x, penetration_y"),
        (dict.fromkeys(FIELDS, (3, 2)), "penetration_z; of a map of 2 axes they must be"),
        (dict.fromkeys([*FIELDS[:2], "depth"], (3, 2)), "fields are penetration, penetration_x, depth"),
        (dict.fromkeys(FIELDS[:3], (2, 3)), r"penetration has shape \(2, 3\) .* the map's shape \(3, 2\)"),
        (dict.fromkeys(FIELDS[:3], (1, 3, 2)), r"penetration has shape \(1, 3, 2\)"),
    ],
)
def test_half_a_field_is_refused(fields: dict[str, tuple[int, ...]], words: str) -> None:
    space = build(Workspace.from_array(np.zeros((3, 2), dtype=bool), 0.1), Robot.disc(0.01))
    arrays = {name: np.zeros(shape) for name, shape in fields.items()}
    for make in (lambda: carrying(space, arrays), lambda: OverlapField(space, arrays)):
        with pytest.raises(InputError, match=words):
            make()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_no_numbers_are_refused(value: float) -> None:
    space = build(Workspace.from_array(np.zeros((3, 2), dtype=bool), 0.1), Robot.disc(0.01))
    arrays = {name: np.zeros((3, 2)) for name in FIELDS[:3]}
    arrays["penetration_y"][2, 1] = value
    with pytest.raises(InputError, match=r"penetration_y\[2, 1\] is (nan|-?inf)"):
        carrying(space, arrays)
    with pytest.raises(InputError, match="type float32"):
        carrying(space, {name: np.zeros((3, 2), np.float32) for name in FIELDS[:3]})


def test_a_field_that_does_not_fit_into_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    space, overlap = scene("plane")
    needed = 3 * 8 * space.grid.size
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: needed)
    with pytest.raises(InputError, match=r"the overlap field has 40 x 32 cells .* may be taken.* use a spacing of"):
        space.with_overlap_field(overlap)
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 2 * needed)
    space.with_overlap_field(overlap)


# ---- the command line --------------------------------------------------------------------------------------------


def document(*arguments: object) -> dict[str, Any]:
    result = CliRunner().invoke(app, [str(argument) for argument in (*arguments, "--json")])
    assert result.exit_code == 0, result.stderr
    found: dict[str, Any] = json.loads(result.stdout)
    return found


def test_the_command_line_tells_of_it(tmp_path: Path, carried: CSpace) -> None:
    carried.save(tmp_path / "map.zarr")
    carrying(carried, None).save(tmp_path / "plain.zarr")
    found, plain = (document("info", tmp_path / name) for name in ("map.zarr", "plain.zarr"))
    assert found.pop("overlap_field") is True and "overlap_field" not in plain
    more = sum(array.nbytes for array in carried._fields.values())
    assert found.pop("memory_bytes") - plain.pop("memory_bytes") == more
    assert found == plain
    told = CliRunner().invoke(app, ["info", str(tmp_path / "map.zarr")]).stdout
    assert any(line.split() == ["overlap", "field", "yes"] for line in told.splitlines())
    document("export", tmp_path / "map.zarr", tmp_path / "map.npz")
    same_field(carried, cspace.open(tmp_path / "map.npz"))


def test_the_command_line_plans_by_it(tmp_path: Path) -> None:
    space, overlap = scene("plane")
    space.with_overlap_field(overlap).save(tmp_path / "map.zarr")
    space.save(tmp_path / "plain.zarr")
    asked = ["--start", "0.43,0.88", "--goal", "1.57,0.88", "--planner", "RRTstar", "--objective", "overlap"]
    assert document("plan", tmp_path / "map.zarr", *asked, "--seed", 1)["certified"]
    result = CliRunner().invoke(app, ["plan", str(tmp_path / "plain.zarr"), *asked])
    assert result.exit_code == 2 and "the map carries none" in result.stderr
