"""What other software finds in a map."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import xarray
from hypothesis import given, settings

import cspace
from cspace.errors import FileError
from cspace.io.reading import open_map
from cspace.io.writing import export
from maps import SUFFIXES, rebuilt, refused, same, spaces


@pytest.fixture
def space() -> cspace.CSpace:
    """A map of a robot that only translates; ``test_turning_files`` has those that turn."""
    workspace = cspace.Workspace.from_array(np.eye(9, 7, dtype=bool), 0.1, lower=(-0.3, 0.7))
    return cspace.build(workspace, cspace.Robot.rectangle(0.25, 0.15), overlap=True, outside="free")


def test_a_dataset_is_labelled(space: cspace.CSpace) -> None:
    dataset = space.to_xarray()
    assert dict(dataset.sizes) == {"x": 9, "y": 7}
    np.testing.assert_array_equal(dataset.x, space.grid.centers(0))
    np.testing.assert_array_equal(dataset.y, space.grid.centers(1))
    assert dataset.x.attrs["units"] == dataset.y.attrs["units"] == "m"
    assert all(dataset[name].attrs["long_name"] for name in dataset.variables)
    meanings = dataset.state.attrs["flag_meanings"].split()
    flags = dict(zip(meanings, dataset.state.attrs["flag_values"], strict=True))
    assert flags == {"free": cspace.FREE, "mixed": cspace.MIXED, "blocked": cspace.BLOCKED}
    q = np.stack(np.meshgrid(dataset.x, dataset.y, indexing="ij"), axis=-1)
    np.testing.assert_array_equal(dataset.state, space.classify(q))
    np.testing.assert_array_equal(dataset.overlap, space.overlaps)


@given(space=spaces())
@settings(max_examples=20)
def test_a_dataset_holds_every_map(space: cspace.CSpace) -> None:
    dataset = space.to_xarray()
    about = dataset.attrs
    assert cspace.Grid(about["lower"], about["spacing"], about["shape"]) == space.grid
    assert cspace.Robot.from_spec(json.loads(about["robot"])).spec == space.robot.spec
    assert (about["outside"], about["margin"], about["precision"]) == (space.outside, space.margin, space.precision)
    assert ("overlap" in dataset) == (space.overlaps is not None)
    for name, array in [("state", space.state), ("outer", space.workspace.outer), ("inner", space.workspace.inner)]:
        assert dataset[name].dtype == array.dtype
        np.testing.assert_array_equal(dataset[name], array)


def test_a_dataset_is_enough_to_rebuild_the_map(space: cspace.CSpace) -> None:
    same(space, rebuilt(space.to_xarray()))


def test_a_dataset_does_not_open_the_map_to_change(space: cspace.CSpace) -> None:
    dataset = space.to_xarray()
    with pytest.raises(ValueError, match="read-only"):
        dataset.state.values[0, 0] = 0
    dataset.copy(deep=True).state[0, 0] = 0


def test_a_dataset_survives_zarr(tmp_path: Path, space: cspace.CSpace) -> None:
    space.to_xarray().to_zarr(tmp_path / "set.zarr", zarr_format=3, consolidated=False)
    with xarray.open_zarr(tmp_path / "set.zarr", consolidated=False) as opened:
        assert opened.identical(space.to_xarray())
        same(space, rebuilt(opened.load()))


def test_a_dataset_survives_netcdf(tmp_path: Path, space: cspace.CSpace) -> None:
    space.to_xarray().to_netcdf(tmp_path / "set.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "set.nc", engine="scipy") as opened:
        same(space, rebuilt(opened.load()))


def test_numpy_reads_an_npz_without_this_library(tmp_path: Path, space: cspace.CSpace) -> None:
    space.export(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz", allow_pickle=False) as held:
        assert {"state", "outer", "overlap", "x", "y", "lower", "spacing", "metadata"} == set(held.files)
        np.testing.assert_array_equal(held["state"], space.state)
        np.testing.assert_array_equal(held["x"], space.grid.centers(0))
        np.testing.assert_array_equal(held["y"], space.grid.centers(1))
        assert tuple(held["lower"]) == space.grid.lower
        assert held["spacing"] == space.grid.spacing
        assert json.loads(str(held["metadata"]))["outside"] == "free"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_exported_map_opens(tmp_path: Path, space: cspace.CSpace, suffix: str) -> None:
    space.export(tmp_path / f"map{suffix}")
    same(space, cspace.open(tmp_path / f"map{suffix}"))


def test_a_suffix_may_be_in_capitals(tmp_path: Path, space: cspace.CSpace) -> None:
    space.save(tmp_path / "MAP.NPZ")
    assert [entry.name for entry in tmp_path.iterdir()] == ["MAP.NPZ"]
    same(space, cspace.open(tmp_path / "MAP.NPZ"))


@pytest.mark.parametrize("suffix", [".yaml", ".yml"])
def test_a_ros_map_reads_back(tmp_path: Path, space: cspace.CSpace, suffix: str) -> None:
    export(space, tmp_path / f"map{suffix}")
    workspace = cspace.Workspace.from_ros_map(tmp_path / f"map{suffix}")
    assert workspace.grid.shape == space.grid.shape
    np.testing.assert_array_equal(workspace.outer, space.state != cspace.FREE)


@pytest.fixture
def archive(tmp_path: Path, space: cspace.CSpace) -> Path:
    space.save(tmp_path / "map.npz")
    return tmp_path / "map.npz"


def test_every_truncation_of_an_npz_is_refused(archive: Path) -> None:
    content = archive.read_bytes()
    for length in range(0, len(content), 23):
        archive.write_bytes(content[:length])
        refused(archive, "copy it again from where it is whole, or build it again")


def test_no_flipped_byte_of_an_npz_changes_the_map(archive: Path, space: cspace.CSpace) -> None:
    content = bytearray(archive.read_bytes())
    caught = 0
    for at in range(0, len(content), 3):
        content[at] ^= 0x55
        archive.write_bytes(content)
        content[at] ^= 0x55
        try:
            opened = open_map(archive)
        except FileError:
            caught += 1
        else:  # Some bytes, such as the time of a member, mean nothing.
            same(space, opened)
    assert caught > len(content) // 6


def rewritten(path: Path, **changes: object) -> None:
    """Save an npz again with some members replaced, or removed where None."""
    with np.load(path) as held:
        members = {name: held[name] for name in held.files} | changes
    np.savez(path, **{name: value for name, value in members.items() if value is not None})


@pytest.mark.parametrize("name", ["state", "outer", "overlap", "x", "lower", "spacing", "metadata"])
def test_every_member_of_an_npz_is_needed(archive: Path, name: str) -> None:
    rewritten(archive, **{name: None})
    refused(archive, "it holds no metadata" if name == "metadata" else f"its array '{name}' is missing")


@pytest.mark.parametrize("name", ["state", "outer", "overlap", "y", "lower", "spacing"])
def test_every_changed_member_of_an_npz_is_refused(archive: Path, name: str) -> None:
    with np.load(archive) as held:
        changed = np.array(held[name])
    changed.flat[0] = not changed.flat[0]
    rewritten(archive, **{name: changed})
    refused(archive, f"its array '{name}' differs from its digest")


def test_changed_metadata_of_an_npz_are_refused(archive: Path) -> None:
    with np.load(archive) as held:
        metadata = json.loads(str(held["metadata"]))
    rewritten(archive, metadata=json.dumps(metadata | {"margin": 9.0}))
    refused(archive, "its metadata differ from their digest")
    rewritten(archive, metadata="[]")
    refused(archive)
    rewritten(archive, metadata=np.arange(3))
    refused(archive)


def test_an_npz_is_never_unpickled(archive: Path) -> None:
    rewritten(archive, state=np.array([{"a": 1}], dtype=object))
    refused(archive, "allow_pickle=False")


def test_other_files_by_that_name_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    path.write_text("no archive")
    refused(path)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("readme.txt", "hello")
    refused(path, "it holds no metadata")
    np.savez(path, state=np.zeros((3, 3), np.uint8))
    refused(path, "it holds no metadata")
    with path.open("wb") as single:
        np.save(single, np.zeros(3))
    refused(path)


def test_an_interrupted_export_leaves_no_half_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, space: cspace.CSpace
) -> None:
    def stub(file: object, **_: object) -> None:
        file.write(b"PK half")  # type: ignore[attr-defined]
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", stub)
    with pytest.raises(KeyboardInterrupt):
        space.export(tmp_path / "map.npz")
    assert not list(tmp_path.iterdir())
