"""A saved map opens as it was, or does not open at all."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import shapely
import xarray
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace.errors import FileError, InputError
from cspace.io import store
from cspace.io.reading import open_map
from cspace.io.writing import export, save
from maps import SUFFIXES, files, forged, interrupted, refused, same, spaces


@pytest.fixture
def space() -> cspace.CSpace:
    """A map with everything: inner differs from outer, and overlaps and geometries are there."""
    room = shapely.box(0, 0, 4, 3) - shapely.box(0.31, 0.32, 3.7, 2.68)
    workspace = cspace.Workspace.from_polygons([room, shapely.Point(2, 1.5).buffer(0.4)], 0.1)
    return cspace.build(workspace, cspace.Robot.disc(0.2), overlap=True, margin=0.03)


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(space=spaces())
@settings(max_examples=30)
def test_a_map_comes_back_as_it_was(suffix: str, space: cspace.CSpace) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"map{suffix}"
        save(space, path)
        same(space, open_map(path))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_built_map_comes_back_as_it_was(tmp_path: Path, space: cspace.CSpace, suffix: str) -> None:
    path = tmp_path / f"map{suffix}"
    space.save(path)
    opened = cspace.open(str(path))
    same(space, opened)
    assert space.overlaps is not None
    assert space.workspace.shapes is not None
    assert not np.array_equal(opened.workspace.inner, opened.workspace.outer)
    again = cspace.build(opened.workspace, opened.robot, overlap=True, margin=opened.margin, outside=opened.outside)
    np.testing.assert_array_equal(again.state, space.state)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_inner_is_stored_only_if_it_differs(tmp_path: Path, suffix: str) -> None:
    workspace = cspace.Workspace.from_array(np.eye(9, dtype=bool), 0.5)
    path = tmp_path / f"map{suffix}"
    save(cspace.build(workspace, cspace.Robot.disc(0.3)), path)
    opened = open_map(path)
    assert opened.workspace.inner is opened.workspace.outer
    held = np.load(path).files if suffix == ".npz" else [entry.name for entry in path.iterdir()]
    assert "inner" not in held
    assert "overlap" not in held
    assert "geometry" not in held


def test_several_chunks_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, space: cspace.CSpace) -> None:
    monkeypatch.setattr(store, "_CHUNK", {1: 7, 2: 16, 3: 4})
    space.save(tmp_path / "map")
    assert len(list((tmp_path / "map" / "state" / "c").rglob("?"))) > 4
    same(space, open_map(tmp_path / "map"))


def test_xarray_opens_the_folder(tmp_path: Path, space: cspace.CSpace) -> None:
    space.save(tmp_path / "map.zarr")
    with xarray.open_zarr(tmp_path / "map.zarr", consolidated=False) as opened:
        expected = space.to_xarray()
        assert opened.equals(expected)
        assert opened.state.dtype == np.uint8
        assert {key: opened.attrs[key] for key in expected.attrs} == expected.attrs
        assert opened.state.attrs["flag_meanings"] == "free mixed blocked"


# What may go wrong with a saved map. All of it must be an error: a lost chunk that reads as FREE is a collision.


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of all-equal arrays, several chunks each: the case in which a fill value could pass for data."""
    folder = tmp_path_factory.mktemp("saved") / "map"
    outer = np.ones((20, 20), bool)
    workspace = cspace.Workspace(
        grid=cspace.Grid((0.0, 0.0), 0.5, (20, 20)), outer=outer, inner=np.zeros_like(outer), source="a test"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "_CHUNK", {1: 10, 2: 10, 3: 10})
        save(
            cspace.CSpace(
                workspace,
                cspace.Robot.disc(0.3),
                np.zeros((20, 20), np.uint8),
                outside="blocked",
                margin=0.0,
                precision="float32",
                overlaps=np.zeros((20, 20), np.int32),
            ),
            folder,
        )
    return folder


@pytest.fixture
def copy(tmp_path: Path, saved: Path) -> Path:
    return Path(shutil.copytree(saved, tmp_path / "map"))


def test_a_lost_chunk_reads_as_no_state_in_other_software_too(copy: Path) -> None:
    (copy / "state" / "c" / "1" / "0").unlink()
    state = zarr.open_array(copy / "state", mode="r")[...]
    assert np.unique(np.asarray(state)[10:, :10]).tolist() == [255]


def test_every_file_is_needed(copy: Path) -> None:
    every = list(files(copy))
    assert len(every) == 1 + 6 + 4 * 4 + 2 * 2
    for file in every:
        content = file.read_bytes()
        file.unlink()
        refused(copy, "copy it again from where it is whole, or build it again")
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


def test_a_flipped_bit_of_a_chunk_is_refused(copy: Path) -> None:
    for file in (
        copy / "state" / "c" / "0" / "0",
        copy / "outer" / "c" / "1" / "1",
        copy / "overlap" / "c" / "0" / "1",
    ):
        content = bytearray(file.read_bytes())
        for bit in range(0, 8 * len(content), 3):
            content[bit // 8] ^= 1 << bit % 8
            file.write_bytes(content)
            refused(copy)
            content[bit // 8] ^= 1 << bit % 8
        file.write_bytes(content)
    open_map(copy)


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
        try:
            opened = open_map(path)
        except FileError:
            return
        same(opened, open_map(saved))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("spacing", 0.25),
        ("lower", [1.0, 0.0]),
        ("outside", "free"),
        ("robot", "{}"),
        ("margin", 1.0),
        ("shape", [20, 19]),
    ],
)
def test_changed_metadata_are_refused(copy: Path, key: str, value: Any) -> None:
    zarr.open_group(copy).attrs[key] = value
    refused(copy, "its metadata differ from their digest")


@pytest.mark.parametrize("key", ["spacing", "robot", "digests", "digest", "outside"])
def test_missing_metadata_are_refused(copy: Path, key: str) -> None:
    del zarr.open_group(copy).attrs[key]
    refused(copy, "its metadata lack", key)


def test_another_format_version_is_refused(copy: Path) -> None:
    zarr.open_group(copy).attrs["format_version"] = 2
    refused(copy, "has format version 2", "reads version 1 only", "open it with the version of cspace that wrote it")


def test_a_missing_array_is_refused(copy: Path) -> None:
    shutil.rmtree(copy / "overlap")
    refused(copy, "its array 'overlap' is missing")


def test_a_map_cannot_lose_an_array_unseen(copy: Path) -> None:
    attributes = zarr.open_group(copy).attrs
    attributes["digests"] = " ".join(
        entry for entry in str(attributes["digests"]).split() if not entry.startswith("inner")
    )
    refused(copy, "its metadata differ from their digest")


def test_a_swapped_array_is_refused(copy: Path) -> None:
    shutil.rmtree(copy / "inner")
    shutil.copytree(copy / "outer", copy / "inner")
    refused(copy, "its array 'inner' differs from its digest")


def test_an_array_of_another_shape_is_refused_before_it_is_read(copy: Path) -> None:
    file = copy / "state" / "zarr.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"shape": [2**40, 2**40]}))
    refused(copy, "its array 'state' is uint8 (1099511627776, 1099511627776) where uint8 (20, 20) is needed")


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("metadata", "content", "words"),
    [
        ({}, {"state": np.full((5, 5), 3, np.uint8)}, "its array 'state' holds 3, which is none of the states 0 to 2"),
        ({}, {"state": np.full((5, 5), 255, np.uint8)}, "holds 255"),
        ({}, {"state": np.zeros((5, 5), np.uint16)}, "its array 'state' is uint16 (5, 5) where uint8 (5, 5) is needed"),
        ({}, {"state": None}, "it holds no state"),
        ({}, {"outer": None}, "it holds no outer"),
        ({"robot": "{}"}, {}, "its parts make no map"),
        ({"robot": "{"}, {}, "its parts make no map"),
        ({"robot": "[]"}, {}, "its parts make no map"),
        ({"spacing": -1.0}, {}, "its parts make no map: spacing is -1.0"),
        ({"format": "other"}, {}, "its metadata say format 'other'"),
        ({"format_version": 99}, {}, "has format version 99"),
    ],
)
def test_what_makes_no_map_is_refused(
    tmp_path: Path, suffix: str, metadata: dict[str, Any], content: dict[str, Any], words: str
) -> None:
    space = cspace.build(cspace.Workspace.from_array(np.eye(5, dtype=bool), 0.5), cspace.Robot.disc(0.3))
    path = tmp_path / f"map{suffix}"
    forged(path, space, metadata, content)
    refused(path, words)


def test_a_state_of_another_shape_is_refused(tmp_path: Path) -> None:
    space = cspace.build(cspace.Workspace.from_array(np.eye(5, dtype=bool), 0.5), cspace.Robot.disc(0.3))
    forged(tmp_path / "map.npz", space, {}, {"state": np.zeros((5, 4), np.uint8)})
    refused(tmp_path / "map.npz", "its array 'state' is uint8 (5, 4) where uint8 (5, 5) is needed")


def test_a_missing_path_is_refused(tmp_path: Path) -> None:
    refused(tmp_path / "nothing", "does not exist", "check the name")


def test_a_folder_that_is_no_map_is_refused(tmp_path: Path) -> None:
    refused(tmp_path, "it holds no zarr.json")
    zarr.create_group(tmp_path / "other.zarr")
    refused(tmp_path / "other.zarr", "its metadata say format None, not 'cspace-map'")
    zarr.create_array(tmp_path / "array.zarr", shape=(2, 2), dtype="uint8")
    refused(tmp_path / "array.zarr")


@pytest.mark.parametrize("name", ["map.yaml", "map.png", "map"])
def test_a_file_that_is_no_map_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("no map")
    refused(tmp_path / name, "is not a saved map", "cspace.build")


@pytest.mark.parametrize("path", [None, 3])
def test_a_path_must_be_a_path(path: Any, saved: Path) -> None:
    with pytest.raises(InputError, match="it must be a file name"):
        open_map(path)
    with pytest.raises(InputError, match="it must be a file name"):
        save(open_map(saved), path)


# What a save leaves behind.


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("stop", [KeyboardInterrupt, MemoryError])
def test_an_interrupted_save_leaves_no_half_map(
    tmp_path: Path, space: cspace.CSpace, old: bool, stop: type[BaseException]
) -> None:
    interrupted(tmp_path / "map", space, stop, cspace.build(space.workspace, cspace.Robot.disc(0.1)) if old else None)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_saved_map_is_kept_unless_told_otherwise(tmp_path: Path, space: cspace.CSpace, suffix: str) -> None:
    path = tmp_path / f"map{suffix}"
    earlier = cspace.build(space.workspace, cspace.Robot.disc(0.1))
    save(earlier, path)
    with pytest.raises(FileError, match=r"exists; .*--overwrite"):
        save(space, path)
    same(earlier, open_map(path))
    save(space, path, overwrite=True)
    same(space, open_map(path))
    assert len(list(tmp_path.iterdir())) == 1


def test_overwriting_removes_nothing_but_a_map(tmp_path: Path, space: cspace.CSpace) -> None:
    for name in ("home/thesis.tex", "mixed/zarr.json", "mixed/notes.txt", "deep/state/notes.txt", "inside/x/c.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("years of work")
    for name in ("home", "mixed", "deep", "inside"):
        before = list(files(tmp_path))
        with pytest.raises(FileError, match="holds more than an earlier output"):
            save(space, tmp_path / name, overwrite=True)
        assert list(files(tmp_path)) == before


def test_a_damaged_map_may_be_overwritten(copy: Path, space: cspace.CSpace) -> None:
    (copy / "zarr.json").unlink()
    save(space, copy, overwrite=True)
    same(space, open_map(copy))


@pytest.mark.parametrize("writer", [save, export])
def test_an_unknown_suffix_is_refused(tmp_path: Path, space: cspace.CSpace, writer: Any) -> None:
    with pytest.raises(InputError, match=r"map.png ends in '.png'; .*use one of .zarr, .npz"):
        writer(space, tmp_path / "map.png")
    with pytest.raises(InputError, match="use one of"):
        writer(space, tmp_path / "map_0.05")
    assert not list(tmp_path.iterdir())
