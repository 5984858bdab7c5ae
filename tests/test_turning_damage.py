"""A damaged file of a robot that turns does not open, and none of its slices that is damaged does."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import shapely
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace.errors import FileError
from cspace.io.reading import open_map, open_slice
from cspace.io.writing import save
from cspace.rotations import TURN, Rotations
from maps import SUFFIXES, files, forged, interrupted, refused, same


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stack in which all is FREE but for one cell of each slice: a fill value of 0 would pass for most of it."""
    folder = tmp_path_factory.mktemp("saved") / "map"
    outer = np.ones((6, 5), bool)
    stack = np.zeros((4, 6, 5), np.uint8)
    for number, part in enumerate(stack):
        part[number, 0] = cspace.BLOCKED
    workspace = cspace.Workspace(
        grid=cspace.Grid((0.0, 0.0), 0.5, (6, 5)),
        outer=outer,
        inner=np.zeros_like(outer),
        source="a test",
        shapes=(shapely.box(0, 0, 1, 1), shapely.MultiPoint([(0, 1), (2, 3)])),
    )
    about: dict[str, Any] = {"outside": "blocked", "margin": 0.0, "precision": "float32"}
    robot = cspace.Robot.rectangle(0.8, 0.4)
    save(
        cspace.CSpace(workspace, robot, stack, rotations=Rotations.of(8), overlaps=stack.astype("i4"), **about), folder
    )
    return folder


@pytest.fixture
def copy(tmp_path: Path, saved: Path) -> Path:
    return Path(shutil.copytree(saved, tmp_path / "map"))


def chunk(path: Path, number: int, name: str = "state") -> Path:
    return path / name / "c" / str(number) / "0" / "0"


def slice_refused(path: Path, number: int, *words: str) -> None:
    """Fail unless reading a slice of the saved stack is an error; its other slices may open, if they are right."""
    with pytest.raises(FileError) as caught:
        open_slice(path, number * TURN / 8)
    for word in (str(path), *words):
        assert word in str(caught.value)


def test_every_file_is_needed(copy: Path) -> None:
    every = list(files(copy))
    assert len(every) == (1 + 11) + (4 + 4) + 2 + 2 + 4 + 1
    for file in every:
        content = file.read_bytes()
        file.unlink()
        refused(copy, "copy it again from where it is whole, or build it again")
        file.write_bytes(content)
    open_map(copy)


def test_a_lost_slice_reads_as_no_state_in_other_software_too(copy: Path) -> None:
    chunk(copy, 2).unlink()
    state = np.asarray(zarr.open_array(copy / "state", mode="r")[...])
    assert np.unique(state[2]).tolist() == [255]
    slice_refused(copy, 2, "its array 'state' lacks 1 chunks")
    slice_refused(copy, 6, "its array 'state' lacks 1 chunks")
    assert open_slice(copy, TURN / 8)[1, 0] == cspace.BLOCKED


def test_a_lost_slice_is_refused_whatever_the_fill_value(copy: Path) -> None:
    file = copy / "state" / "zarr.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"fill_value": 0}))
    same(open_map(copy), open_map(copy))
    chunk(copy, 1).unlink()
    refused(copy, "lacks 1 chunks")
    slice_refused(copy, 1, "lacks 1 chunks")


@pytest.mark.parametrize("name", ["state", "overlap"])
def test_swapped_slices_are_refused(copy: Path, name: str) -> None:
    first, second = chunk(copy, 1, name), chunk(copy, 3, name)
    one, other = first.read_bytes(), second.read_bytes()
    assert one != other
    first.write_bytes(other)
    second.write_bytes(one)
    refused(copy, f"slice 1 of its array '{name}' differs from its digest")
    if name == "state":
        slice_refused(copy, 1, "slice 1 of its array 'state' differs from its digest")
        slice_refused(copy, 3, "slice 3 of its array 'state' differs from its digest")
        assert open_slice(copy, 0.0)[0, 0] == cspace.BLOCKED


def test_a_flipped_bit_of_any_slice_is_refused(copy: Path) -> None:
    for file, number in [(chunk(copy, 0), 0), (chunk(copy, 3), 3)]:
        content = bytearray(file.read_bytes())
        for bit in range(8 * len(content)):
            content[bit // 8] ^= 1 << bit % 8
            file.write_bytes(content)
            refused(copy)
            slice_refused(copy, number)
            content[bit // 8] ^= 1 << bit % 8
        file.write_bytes(content)
    open_map(copy)


@pytest.mark.parametrize("keep", [0.0, 0.5, 0.95])
def test_every_truncated_file_is_refused(copy: Path, keep: float) -> None:
    for file in files(copy):
        content = file.read_bytes()
        file.write_bytes(content[: int(len(content) * keep)])
        refused(copy)
        file.write_bytes(content)
    open_map(copy)


@pytest.mark.parametrize("name", ["yaw_bounds", "slice_of"])
def test_changed_rotation_cells_are_refused(copy: Path, name: str) -> None:
    array = zarr.open_array(copy / name)
    array[...] = np.roll(np.asarray(array[...]), 1, axis=0)
    refused(copy, f"its array '{name}' differs from its digest")
    slice_refused(copy, 0, f"its array '{name}' differs from its digest")


@pytest.mark.parametrize("name", ["yaw", "covering_angle", "geometry"])
def test_changed_labels_are_refused(copy: Path, name: str) -> None:
    array = zarr.open_array(copy / name)
    array[0] = 0.5 if name != "geometry" else 0
    refused(copy, f"its array '{name}' differs from its digest")


def test_another_number_of_rotations_is_refused(copy: Path) -> None:
    for count in (0, 4, 7):
        zarr.open_group(copy).attrs["rotations"] = count
        refused(copy, "its metadata differ from their digest")
        slice_refused(copy, 0, "its metadata differ from their digest")


@pytest.mark.parametrize("shape", [[4, 6, 5, 1], [8, 6, 5], [3, 6, 5], [2**40, 6, 5], [6, 5]])
def test_a_stack_of_another_shape_is_refused_before_it_is_read(copy: Path, shape: list[int]) -> None:
    file = copy / "state" / "zarr.json"
    document = json.loads(file.read_text())
    document["shape"] = shape
    document["chunk_grid"]["configuration"]["chunk_shape"] = [1] * len(shape)
    document["dimension_names"] = None
    file.write_text(json.dumps(document))
    words = f"its array 'state' is uint8 {tuple(shape)} where uint8 (4, 6, 5) is needed"
    refused(copy, words)
    slice_refused(copy, 0, words)


def test_an_absurdly_long_geometry_is_refused(copy: Path) -> None:
    file = copy / "geometry" / "zarr.json"
    document = json.loads(file.read_text())
    for chunk_shape in ([10], [2**60]):
        document["shape"] = [2**60]
        document["chunk_grid"]["configuration"]["chunk_shape"] = chunk_shape
        file.write_text(json.dumps(document))
        refused(copy)


@given(data=st.data())
@settings(max_examples=60)
def test_no_change_of_the_metadata_changes_the_map(saved: Path, data: st.DataObject) -> None:
    with TemporaryDirectory() as folder:
        path = Path(shutil.copytree(saved, Path(folder) / "map"))
        file = data.draw(st.sampled_from(sorted(path.rglob("zarr.json"))))
        content = bytearray(file.read_bytes())
        at = data.draw(st.integers(0, len(content) - 1))
        content[at] ^= 1 << data.draw(st.integers(0, 6))
        file.write_bytes(content)
        number = data.draw(st.integers(0, 7))
        try:
            found = open_slice(path, number * TURN / 8)
        except FileError:
            pass
        else:
            np.testing.assert_array_equal(found, open_slice(saved, number * TURN / 8))
        try:
            opened = open_map(path)
        except FileError:
            return
        same(opened, open_map(saved))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"state": np.zeros((8, 6, 5), np.uint8)}, "its parts make no map: state has shape (8, 6, 5)"),
        ({"state": np.full((4, 6, 5), 3, np.uint8)}, "slice 0 of its array 'state' holds 3"),
        ({"slice_of": np.arange(8)}, "its array 'slice_of' is not that of its rotation cells and its robot"),
        ({"yaw": np.zeros(8)}, "its array 'yaw' is not that of its rotation cells"),
        ({"covering_angle": np.zeros(8)}, "its array 'covering_angle' is not that of its rotation cells"),
        ({"yaw_bounds": np.zeros((8, 2))}, "its parts make no map: rotations are borders that do not ascend"),
        ({"yaw_bounds": np.full((8, 2), np.nan)}, "its parts make no map"),
        ({"yaw_bounds": None}, "it holds no yaw_bounds"),
        ({"geometry": np.zeros(9, np.int8)}, "its parts make no map: 'geometry' is not WKB"),
        ({"geometry": np.frombuffer(shapely.Point(0, 1).wkb, np.int8)}, "'geometry' is a Point"),
    ],
)
def test_what_makes_no_map_is_refused(
    tmp_path: Path, saved: Path, suffix: str, change: dict[str, Any], words: str
) -> None:
    path = tmp_path / f"forged{suffix}"
    forged(path, open_map(saved), {}, change)
    refused(path, words)


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("stop", [KeyboardInterrupt, MemoryError])
def test_an_interrupted_save_leaves_no_half_map(
    tmp_path: Path, saved: Path, old: bool, stop: type[BaseException]
) -> None:
    space = open_map(saved)
    earlier = cspace.build(space.workspace, cspace.Robot.disc(0.1))
    interrupted(tmp_path / "map", space, stop, earlier if old else None)
    save(earlier, tmp_path / "map", overwrite=True)
    same(earlier, open_map(tmp_path / "map"))
