"""The engines make the same maps, and the choice between them is told."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import InputError, Robot, Workspace, choose_method, costs
from cspace.costs import SIZES, TYPICAL, Costs, Figures
from cspace.fourier import least_seconds, transform_seconds
from cspace.raster import Raster
from strategies import robots, seeds


def both_maps(workspace, robot, **options):
    """The map, by both engines."""
    fft, direct = (cspace.build(workspace, robot, method=method, **options) for method in ("fft", "direct"))
    assert (fft.stack == direct.stack).all()
    assert fft.precision in ("float32", "float64") and direct.precision == "integer"
    return direct


@settings(max_examples=60)
@given(
    seeds,
    robots(),
    st.sampled_from([None, 1, 3, 8, 12]),
    st.sampled_from(["blocked", "free"]),
    st.booleans(),
    st.sampled_from([0.0, 0.13]),
)
def test_engines_agree_in_the_plane(seed, robot, rotations, outside, inner, margin):
    rng = np.random.default_rng(seed)
    outer = rng.random(rng.integers(1, 90, 2)) < rng.choice([0.0, 0.01, 0.3, 1.0])
    within = outer & (rng.random(outer.shape) < 0.8) if rng.random() < 0.5 else None
    workspace = Workspace.from_array(outer, rng.choice([0.05, 0.1, 0.5]), inner=within)
    both_maps(workspace, robot, rotations=rotations, outside=outside, inner=inner, margin=margin)


@settings(max_examples=25)
@given(seeds, st.sampled_from(["blocked", "free"]))
def test_engines_agree_in_space(seed, outside):
    rng = np.random.default_rng(seed)
    workspace = Workspace.from_array(rng.random(rng.integers(1, 40, 3)) < rng.choice([0.0, 0.01, 0.3, 1.0]), 0.1)
    size = rng.uniform(0.05, 1.2, 3)
    robot = rng.choice([Robot.box(size, rng.uniform(-1, 1, 3)), Robot.ball(size[0], rng.uniform(-1, 1, 3))])
    both_maps(workspace, robot, outside=outside)


def test_engines_agree_where_the_robot_is_larger_than_the_map():
    workspace = Workspace.from_array(np.eye(7, dtype=bool), 0.1)
    for outside in ("blocked", "free"):
        both_maps(workspace, Robot.disc(3.0), outside=outside)
        both_maps(workspace, Robot.disc(0.2, (50.0, 0.0)), outside=outside)


def test_auto_takes_what_is_told():
    workspace = Workspace.from_array(np.random.default_rng(1).random((300, 300)) < 0.01, 0.1)
    robot = Robot.rectangle(0.9, 0.5)
    choice = choose_method(workspace, robot, rotations=36, workers=1)
    assert choice.method == "direct" and set(choice.seconds) == {"fft", "direct"}
    assert 0.0 < choice.seconds["direct"] < choice.seconds["fft"]
    assert cspace.build(workspace, robot, rotations=36).precision == "integer"
    half = choose_method(workspace, robot, rotations=36, inner=False, workers=1)
    assert half.seconds["direct"] == pytest.approx(choice.seconds["direct"] / 2, rel=0.2)
    assert cspace.build(workspace, robot, overlap=True).precision in ("float32", "float64")


@settings(max_examples=50)
@given(seeds, st.integers(2, 3))
def test_the_quick_bound_is_below_what_the_search_tells(seed, dim):
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 900 if dim == 2 else 90, dim).tolist()
    size = rng.integers(1, 60 if dim == 2 else 12, dim)
    rasters = [Raster.trimmed(rng.random(size) < 0.6, (0,) * dim) for _ in range(rng.integers(1, 40))]
    workers = int(rng.integers(1, 3))
    # Offsets that cannot fall on the map count in the bound, and not in the search.
    rasters = [each for each in rasters if (np.array(each.cells.shape) <= shape).all()]
    assert least_seconds(shape, rasters, workers) <= transform_seconds(shape, rasters, workers) * (1.0 + 1e-9)


def test_a_robot_of_very_many_rows_is_left_to_the_transforms():
    """Every other cell of a bitmap is a row of its own."""
    occupied = np.zeros((1500, 1500), dtype=bool)
    occupied[700, 700] = True
    workspace = Workspace.from_array(occupied, 1.0)
    robot = Robot.cells(np.indices((501, 501)).sum(axis=0) % 7 == 0, 0.2)
    choice = choose_method(workspace, robot)
    assert (choice.method == "direct") == (choice.seconds["direct"] < choice.seconds["fft"])
    sieve = Robot.cells(np.indices((301, 301))[1] % 6 == 0, 1.0)
    assert choose_method(workspace, sieve).method == "fft"
    assert both_maps(workspace, sieve).count()[0] > 0


@pytest.mark.parametrize(
    "options, words",
    [
        ({"method": "fast"}, "'fft', 'direct', 'auto'"),
        ({"method": "direct", "overlap": True}, "use method='fft' or method='auto'"),
        ({"method": None}, "method is None"),
    ],
)
def test_methods_that_are_refused(options, words):
    workspace = Workspace.from_array(np.zeros((5, 5), bool), 1.0)
    with pytest.raises(InputError, match=words.replace("(", r"\(")):
        cspace.build(workspace, Robot.disc(1.0), **options)


def test_arguments_of_the_choice_are_checked():
    workspace = Workspace.from_array(np.zeros((5, 5), bool), 1.0)
    with pytest.raises(InputError, match="workers is 0"):
        choose_method(workspace, Robot.disc(1.0), workers=0)
    with pytest.raises(InputError, match="dimensions"):
        choose_method(workspace, Robot.ball(1.0))
    with pytest.raises(InputError, match="margin"):
        choose_method(workspace, Robot.disc(1.0), margin=-1.0)


# ---- what the machine takes ------------------------------------------------------------------------------------------


def test_costs_are_measured_once_and_kept(tmp_path, monkeypatch):
    file = tmp_path / "folder" / "costs.json"
    first = Figures(file)
    assert first.now == TYPICAL and not first.are_measured
    found = first.measure()
    assert first.are_measured and first.now == found
    every = [*found.float32, *found.float64, found.tile, found.run, found.cell]
    assert len(every) == 2 * len(SIZES) + 3 and all(0.0 < each < 1e-3 for each in every)
    monkeypatch.setattr(costs, "measured_costs", lambda: pytest.fail("measured again"))
    assert Figures(file).now == found
    assert Figures(file).measure() == found
    assert [path.name for path in file.parent.iterdir()] == ["costs.json"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"format": 1, "machine": {}, "costs": {}}',
        b"\xff\xfe",
    ],
)
def test_files_that_are_no_costs_are_measured_anew(tmp_path, monkeypatch, text):
    file = tmp_path / "costs.json"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert not Figures(file).are_measured
    monkeypatch.setattr(costs, "measured_costs", lambda: TYPICAL)
    Figures(file).measure()
    assert Figures(file).are_measured


@pytest.mark.parametrize("change", [{"machine": {"node": "another"}}, {"format": 0}, {"costs": {"run": -1.0}}])
def test_costs_of_another_machine_are_not_taken(tmp_path, monkeypatch, change):
    file = tmp_path / "costs.json"
    monkeypatch.setattr(costs, "measured_costs", lambda: TYPICAL)
    Figures(file).measure()
    record = json.loads(file.read_text())
    for key, value in change.items():
        record[key] = {**record[key], **value} if isinstance(value, dict) else value
    file.write_text(json.dumps(record))
    assert not Figures(file).are_measured


def test_a_folder_that_cannot_be_written_to_does_no_harm(tmp_path, monkeypatch):
    (tmp_path / "taken").write_text("")
    monkeypatch.setattr(costs, "measured_costs", lambda: TYPICAL)
    there = Figures(tmp_path / "taken" / "costs.json")
    assert there.measure() == TYPICAL and there.are_measured


def test_long_work_measures_first(monkeypatch, tmp_path):
    there = Figures(tmp_path / "costs.json")
    slow = Costs(TYPICAL.float32, TYPICAL.float64, TYPICAL.tile, 1e-3, TYPICAL.cell)
    monkeypatch.setattr(costs, "measured_costs", lambda: slow)
    monkeypatch.setattr("cspace.choice.figures", lambda: there)
    monkeypatch.setattr("cspace.bits.dilation.figures", lambda: there)
    small = Workspace.from_array(np.zeros((20, 20), bool), 1.0)
    assert not choose_method(small, Robot.disc(2.0)).measured
    monkeypatch.setattr("cspace.choice.LONG", 1e-9)
    choice = choose_method(small, Robot.disc(2.0))
    assert choice.measured and choice.method == "fft"


def test_transforms_cost_more_the_larger_they_are():
    sizes = [2**k for k in range(8, 26)]
    for precision in ("float32", "float64"):
        seconds = [TYPICAL.transform(size, precision) for size in sizes]
        assert (np.diff(seconds) > 0).all()
    falling = Costs((1e-9,) * 5 + (5e-10,), TYPICAL.float64, TYPICAL.tile, TYPICAL.run, TYPICAL.cell)
    assert falling.transform(2**34, "float32") == pytest.approx(2**34 * 5e-10, rel=1e-4)
    assert TYPICAL.transform(SIZES[2], "float64") == pytest.approx(SIZES[2] * TYPICAL.float64[2] + TYPICAL.tile / 2)
