"""What a plan says of its path, and what it writes."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

import planners
from cspace import BLOCKED, CSpace, FileError, Robot, Workspace, build
from planners.result import least_clearance
from planning import GOAL, START, distances, halves, room


@pytest.fixture(scope="module")
def space() -> CSpace:
    return room()


# ---- clearance along a path ------------------------------------------------------------------------------------------


def test_the_clearance_of_a_path_is_a_bound_for_each_of_its_points(space: CSpace) -> None:
    rng = np.random.default_rng(0)
    along = np.linspace(0.0, 1.0, 201)[:, None, None]
    some = 0
    for a in space.sample_free(60, rng):
        path = np.array([a, a + rng.uniform(-1.0, 1.0, 2), a + rng.uniform(-1.0, 1.0, 2)])
        bound = least_clearance(space, path)
        if not space.grid.contains(path).all():
            assert bound == 0.0
            continue
        least = distances(space, (path[:-1] + along * (path[1:] - path[:-1])).reshape(-1, 2)).min()
        assert max(0.0, least - 2 * space.grid.spacing) <= bound <= least
        some += bound > 0.0
    assert some > 10


def test_clearance_is_infinite_where_every_configuration_is_free(tmp_path: Path) -> None:
    space = build(Workspace.from_array(np.zeros((9, 9), dtype=bool), 1.0), Robot.disc(0.1), outside="free")
    found = planners.plan(space, (1.5, 1.5), (7.5, 7.5))
    assert found.solved and found.clearance == math.inf
    found.to_json(tmp_path / "plan.json")
    assert json.loads((tmp_path / "plan.json").read_text())["clearance"] is None


# ---- files -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def found(space: CSpace) -> planners.Plan:
    return planners.plan(space, START, GOAL, seed=4)


def test_a_path_is_read_back_from_csv_to_the_last_bit(found: planners.Plan, tmp_path: Path) -> None:
    found.to_csv(tmp_path / "path.csv")
    with (tmp_path / "path.csv").open(newline="") as file:
        names, *rows = csv.reader(file)
    assert names == ["x", "y"]
    assert np.array_equal(np.array(rows, dtype=float), found.path)
    assert np.array_equal(np.loadtxt(tmp_path / "path.csv", delimiter=",", skiprows=1), found.path)


def test_a_plan_is_read_back_from_json(found: planners.Plan, tmp_path: Path) -> None:
    found.to_json(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    assert set(record) == {field.name for field in dataclasses.fields(planners.Plan)}
    times = planners.Times(**record.pop("times"))
    arrays = {name: np.array(record.pop(name)) for name in ("path", "waypoints")}
    axes = tuple(record.pop("axes"))
    again = planners.Plan(**arrays, axes=axes, times=times, **record)
    assert np.array_equal(again.path, found.path) and np.array_equal(again.waypoints, found.path)
    assert times == found.times and axes == found.axes == ("x", "y")
    for name in record:
        assert getattr(again, name) == getattr(found, name)


def test_an_unsolved_plan_is_written_without_nan(tmp_path: Path) -> None:
    found = planners.plan(halves(BLOCKED), (2.5, 4.5), (16.5, 4.5))
    found.to_json(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    assert record["path"] == [] and record["length"] is None and record["path_exists"] is False
    found.to_csv(tmp_path / "path.csv")
    assert (tmp_path / "path.csv").read_text() == "x,y\n"


@pytest.mark.parametrize("write", ["to_csv", "to_json"])
def test_an_existing_file_is_kept_unless_told_otherwise(found: planners.Plan, tmp_path: Path, write: str) -> None:
    file = tmp_path / "plan"
    file.write_text("mine")
    with pytest.raises(FileError, match="overwrite=True"):
        getattr(found, write)(file)
    assert file.read_text() == "mine"
    getattr(found, write)(file, overwrite=True)
    assert file.read_text() != "mine"
    with pytest.raises(FileError, match="not a folder"):
        getattr(found, write)(tmp_path / "missing" / "plan")
    assert [each.name for each in tmp_path.iterdir()] == ["plan"]


def test_a_plan_cannot_be_changed(found: planners.Plan) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.solved = False  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        found.path[0, 0] = 3.0
