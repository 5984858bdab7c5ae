"""The C++ header answers as Python does, and refuses damaged files."""

import json
import shutil
import subprocess

import numpy as np
import pytest
import trimesh

import cspace
from tests.fuzz.cpp import build_tiles, write_damaged
from tests.fuzz.files import reseal
from tests.helpers.cpp import (
    SPACES,
    answers_of,
    build_space,
    count_differences,
    count_prefixes,
    draw_queries,
    open_in_cpp,
    why_no_compiler,
)
from tests.helpers.gates import certify_chunk
from tests.helpers.refusals import refusals
from tests.record.test_format import FROZEN

pytestmark = pytest.mark.skipif(bool(why_no_compiler()), reason=why_no_compiler())

N = 2000
"""Number of queries of each map; fuzzing has 10^6 states and 10^5 motions."""


def saved(folder, **options):
    build_space("SE2 shared", "free").save(folder / "map", **options)
    return folder / "map"


def build_on_floor(rotations, outside):
    """Build a map of a robot on a floor, at whose heights the robot differs."""
    cells = np.random.default_rng(0).random((60, 50, 9)) < 0.004
    workspace = cspace.Workspace.from_array(cells, 0.1, lower=(-1.3, 0.7, 0.2))
    corners = [(0, 0, 0), (0.4, 0, 0), (0, 0.2, 0), (0, 0, 0.5)]
    robot = cspace.Robot.from_mesh(trimesh.convex.convex_hull(np.array(corners)))
    return cspace.build(workspace, robot, rotations=rotations, outside=outside, floor=0.33)


ON_FLOORS = {"floor": None, "floor with a yaw": 16}


@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("name", [*SPACES, *ON_FLOORS])
def test_states_motions_and_clearances_equal_those_of_python(tmp_path, program, name, outside):
    if name in ON_FLOORS:
        space = build_on_floor(ON_FLOORS[name], outside)
    else:
        space = build_space(name, outside)
    space.save(tmp_path / "map", compress=outside == "free", clearance=True)
    queries = draw_queries(space, N, np.random.default_rng(1))
    found = count_differences(space, program, tmp_path / "map", queries)
    free = found.pop("motions that are free")
    assert free > 0 or name == "SE3 coarse"
    assert found == {"states": 0, "motions": 0, "clearances": 0}


def test_a_window_with_an_unknown_outside_answers_equally(tmp_path, program):
    build_tiles("SE2", "free", tmp_path / "tiles")
    tiles = cspace.open(tmp_path / "tiles")
    assert isinstance(tiles, cspace.TiledCSpace)
    window = tiles.window((0.0, 1.5), (2.0, 4.0))
    assert window.outside == "unknown"
    window.save(tmp_path / "map")
    queries = draw_queries(window, N, np.random.default_rng(1))
    found = count_differences(window, program, tmp_path / "map", queries, "unchecked")
    assert (found["states"], found["motions"]) == (0, 0)


@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("name", ["R2", "SE2 shared", "R3 yaw"])
def test_tiled_maps_answer_as_the_map_in_memory(tmp_path, program, name, outside):
    space = build_tiles(name, outside, tmp_path / "tiles")
    queries = draw_queries(space, N, np.random.default_rng(3))
    found = count_differences(space, program, tmp_path / "tiles", queries)
    assert (found["states"], found["motions"]) == (0, 0)


@pytest.mark.parametrize("name", ["flat", "solid"])
def test_frozen_maps_give_the_answers_of_their_day(program, tmp_path, name):
    answers = json.loads((FROZEN / "answers.json").read_text(encoding="utf-8"))[name]
    shutil.copytree(FROZEN / name, tmp_path / name)
    states, motions, _ = answers_of(program, tmp_path / name, np.array(answers["queries"]))
    assert states.tolist() == answers["states"]
    assert motions.tolist() == answers["motions"]


@pytest.mark.parametrize("name", ["R2", "SE2 uneven", "SE2 one cell", "R3", "R3 yaw", "SE3"])
def test_proven_prefixes_of_chunks_equal_those_of_python(tmp_path, program, name):
    outside = "free" if "R3" in name else "blocked"
    space = build_space(name, outside)
    space.save(tmp_path / "map")
    rng = np.random.default_rng(4)
    queries = draw_queries(space, 3 * N, rng).reshape(-1, 6, space.size)
    starts = space.sample_free(len(queries), rng)
    queries[:, :2] = starts[:, np.newaxis]
    queries[:, 2, : space.dim] = starts[:, : space.dim] + rng.uniform(
        -0.3, 0.3, (len(queries), space.dim)
    )
    if name != "SE3":
        everywhere = np.full(space.dim + bool(space.rotations.names), np.inf)
        assert set(count_prefixes(program, tmp_path / "map", queries, everywhere)) == {"0"}
    for size in (0.0, 0.03, 0.2, 4.0, 1e6, 1e300):
        tracking = size * rng.random(space.dim + bool(space.rotations.names))
        if size == 1e300:  # of the rotation alone
            tracking[: space.dim] = 0.0
        if name == "SE3":
            tracking[-1] = 0.0
        found = count_prefixes(program, tmp_path / "map", queries, tracking)
        expected = certify_chunk(space, queries[:, 0], queries[:, 1:], tracking).proven
        assert list(map(int, found)) == expected.tolist()
        assert size > 1.0 or 0 < expected.sum() < 5 * len(queries)


def test_wrong_tracking_is_refused(tmp_path, program):
    space = build_space("SE3", "free")
    space.save(tmp_path / "map")
    rows = draw_queries(space, 1, np.random.default_rng(0)).reshape(1, 2, 7)
    for tracking in ((0.0,) * 3, (0.1, 0.1, -0.1, 0.0), (np.nan,) * 4):
        (answer,) = count_prefixes(program, tmp_path / "map", rows, tracking)
        assert "zero or above" in answer
    (answer,) = count_prefixes(program, tmp_path / "map", rows, (0.0, 0.0, 0.0, 0.1))
    assert "use cspace.Gate in Python" in answer
    assert certify_chunk(space, rows[0, 0], rows[0, 1:], (0.0, 0.0, 0.0, 0.1)).proven in (0, 1)


# ---- files that are no map -----------------------------------------------------------------------


def test_damaged_files_are_refused(tmp_path, program):
    build_space("SE2 shared", "free").save(tmp_path / "map", clearance=True)
    maps = write_damaged(tmp_path / "map", tmp_path / "damaged", 40, np.random.default_rng(5))
    for path, answer in zip(maps, open_in_cpp(program, *maps), strict=True):
        assert answer.startswith(str(path)), answer


def test_arrays_of_later_releases_are_skipped_and_digested(tmp_path, program):
    path = saved(tmp_path)
    shutil.copytree(path / "slice_of", path / "added_later")
    names = json.loads((path / "zarr.json").read_bytes())["attributes"]["arrays"]
    reseal(path, arrays=f"{names} added_later", new_attribute=[1, {"a": None}])
    assert open_in_cpp(program, path) == ["opened"]
    assert isinstance(cspace.open(path), cspace.CSpace)
    chunk = path / "added_later" / "c.0"
    chunk.write_bytes(chunk.read_bytes()[::-1])
    assert "digest" in open_in_cpp(program, path)[0]
    with pytest.raises(cspace.FileError, match="digest"):
        cspace.open(path)


@refusals(
    "changes, message",
    ({"format": "zarr"}, "another format"),
    ({"format_version": 6}, "format version 6"),
    ({"arrays": "cell_states slice_of exterior yaw ../map"}, "an array '../map'"),
    ({"arrays": "cell_states outer slice_of exterior x y"}, "lacks the array 'yaw_bounds'"),
    ({"slices": 10**14}, "another shape"),
    ({"slices": 10**400}, "it has 1000"),
    ({"rotations": 0}, "it has 0"),
    ({"spacing": -1.0}, "its grid is none"),
    ({"spacing": float("nan")}, "it has NaN"),
    ({"lower": [1e9, 0.0]}, "too far from the origin"),
    ({"outside": "blocked"}, "contradicts the space outside"),
    ({"units": "m ft"}, "units"),
    ({"axes": "x y"}, "too many rotation cells"),
    ({"axes": "x y roll pitch"}, "axes do not match"),
    ({"compressed": False}, "another shape, type, chunks or codec"),
    ({"lower": "[" * 9999}, "instead of numbers"),
)
def test_forged_attributes_are_refused_despite_a_valid_digest(tmp_path, program, changes, message):
    path = saved(tmp_path)
    reseal(path, **changes)
    answer = open_in_cpp(program, path)[0]
    assert answer.startswith(str(path)) and message in answer, answer


def test_incomplete_tiled_maps_are_refused(tmp_path, program):
    build_tiles("R2", "blocked", tmp_path / "tiles")
    shutil.rmtree(tmp_path / "tiles" / "0.1")
    assert "0.1/zarr.json" in open_in_cpp(program, tmp_path / "tiles")[0]
    reseal(tmp_path / "tiles" / "whole", arrays="")
    assert "lacks the array 'exterior'" in open_in_cpp(program, tmp_path / "tiles")[0]
    shutil.rmtree(tmp_path / "tiles" / "whole")
    assert "not complete" in open_in_cpp(program, tmp_path / "tiles")[0]


def test_tiles_of_another_map_or_size_are_refused(tmp_path, program):
    build_tiles("R2", "blocked", tmp_path / "tiles")
    tile, border_tile = tmp_path / "tiles" / "0.1", tmp_path / "tiles" / "3.2"
    stamp = json.loads((tile / "zarr.json").read_bytes())["attributes"]["stamp"]
    shutil.rmtree(tile)
    shutil.copytree(border_tile, tile)
    assert (
        "0.1: is not a usable map: it is a tile of another map"
        in open_in_cpp(program, tmp_path / "tiles")[0]
    )
    reseal(tile, stamp=stamp)
    assert "0.1: is a tile of another size" in open_in_cpp(program, tmp_path / "tiles")[0]


@pytest.mark.skipif(shutil.which("cmake") is None, reason="no cmake is here")
@pytest.mark.parametrize("component, is_refused", [("COMPONENTS zstd", True), ("", False)])
def test_cmake_refuses_a_machine_without_zstd_if_it_is_asked_for(tmp_path, component, is_refused):
    hidden = ("CMAKE_SYSTEM_PATH", "SYSTEM_ENVIRONMENT_PATH")
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.18)\nproject(robot CXX)\n"
        + "".join(f"set(CMAKE_FIND_USE_{name} OFF)\n" for name in hidden)
        + f"find_package(cspace REQUIRED {component})\n"
    )
    command = ["cmake", "-S", tmp_path, "-B", tmp_path / "build"]
    command += [f"-Dcspace_DIR={cspace.get_cmake_dir()}"]
    done = subprocess.run(command, text=True, capture_output=True, check=False)
    assert (done.returncode != 0) == is_refused, done.stderr
    assert ("install libzstd-dev" in done.stderr) == is_refused
