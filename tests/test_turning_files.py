"""Files of robots that turn: complete, and a slice can be read without the rest."""

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
from cspace.io.reading import open_map, open_slice
from cspace.io.writing import export, save
from cspace.rotations import TURN, Rotations
from maps import SUFFIXES, rebuilt, refused, same, spaces

ROBOTS = {
    "no slice shared": cspace.Robot.polygon([(-0.3, -0.2), (0.5, -0.2), (0.5, 0.2), (-0.3, 0.3)]),
    "half of them": cspace.Robot.rectangle(0.8, 0.4),
    "all one": cspace.Robot.disc(0.3),
}
BORDERS = [-0.5, 0.3, 1.9, 2.2, 4.0, TURN - 0.5]


@pytest.fixture(params=ROBOTS)
def space(request: pytest.FixtureRequest) -> cspace.CSpace:
    room = shapely.box(0, 0, 4, 3) - shapely.box(0.31, 0.32, 3.7, 2.68)
    workspace = cspace.Workspace.from_polygons([room, shapely.Point(2, 1.5).buffer(0.4)], 0.1)
    return cspace.build(workspace, ROBOTS[request.param], rotations=8, overlap=True, margin=0.03)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_map_comes_back_as_it_was(tmp_path: Path, space: cspace.CSpace, suffix: str) -> None:
    path = tmp_path / f"map{suffix}"
    space.save(path)
    opened = cspace.open(path)
    same(space, opened)
    assert opened.rotations == Rotations.of(8)
    assert opened.workspace.shapes is not None
    assert opened.workspace.shapes == space.workspace.shapes


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_unequal_rotation_cells_come_back_to_the_last_bit(tmp_path: Path, suffix: str) -> None:
    workspace = cspace.Workspace.from_array(np.eye(9, 7, dtype=bool), 0.1)
    space = cspace.build(workspace, ROBOTS["half of them"], rotations=BORDERS)
    path = tmp_path / f"map{suffix}"
    save(space, path)
    same(space, open_map(path))


def test_a_map_that_is_read_is_as_exact(tmp_path: Path, space: cspace.CSpace) -> None:
    save(space, tmp_path / "map")
    opened = open_map(tmp_path / "map")
    q = np.random.default_rng(5).uniform([0.0, 0.0, -4.0], [4.0, 3.0, 4.0], (300, 3))
    answers = space.is_free(q, exact=True)
    assert answers.sum() > space.is_free(q).sum()
    np.testing.assert_array_equal(opened.is_free(q, exact=True), answers)


# One slice.


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(space=spaces(), yaw=st.floats(-9.0, 9.0))
@settings(max_examples=30)
def test_a_slice_is_that_of_the_map(suffix: str, space: cspace.CSpace, yaw: float) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"map{suffix}"
        save(space, path)
        np.testing.assert_array_equal(open_slice(path, yaw), space.slice_at(yaw))
        np.testing.assert_array_equal(open_slice(path), space.slice_at())


def test_a_slice_at_a_border_is_that_of_the_cell_above(tmp_path: Path) -> None:
    workspace = cspace.Workspace.from_array(np.eye(9, 7, dtype=bool), 0.1)
    space = cspace.build(workspace, ROBOTS["no slice shared"], rotations=BORDERS)
    save(space, tmp_path / "map")
    for number, border in enumerate(BORDERS[:-1]):
        for turns in (-1, 0, 1):
            found = open_slice(tmp_path / "map", border + 1e-12 + turns * TURN)
            np.testing.assert_array_equal(found, space.stack[number])
        np.testing.assert_array_equal(open_slice(tmp_path / "map", border), space.stack[number])


def test_a_slice_is_one_chunk_and_read_without_the_rest(tmp_path: Path, space: cspace.CSpace) -> None:
    path = tmp_path / "map"
    save(space, path)
    assert zarr.open_array(path / "state", mode="r").chunks == (1, *space.grid.shape)
    assert zarr.open_array(path / "overlap", mode="r").chunks == (1, *space.grid.shape)
    for name in ("overlap", "outer", "inner", "geometry", "x", "y", "yaw"):
        shutil.rmtree(path / name)
    chunks = [path / "state" / "c" / str(number) / "0" / "0" for number in range(len(space.stack))]
    contents = [chunk.read_bytes() for chunk in chunks]
    assert len(list((path / "state" / "c").iterdir())) == len(chunks)
    assert space.rotations is not None
    for number, content in enumerate(contents):
        for chunk in chunks:
            chunk.write_bytes(b"damage, which cannot be decoded")
        chunks[number].write_bytes(content)
        cell = int(np.flatnonzero(space.slice_of == number)[-1])
        yaw = float(space.rotations.representatives[cell])
        np.testing.assert_array_equal(open_slice(path, yaw), space.stack[number])
    refused(path)


def test_slices_of_several_chunks_come_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, space: cspace.CSpace
) -> None:
    monkeypatch.setattr(store, "_SLICE_CHUNK", 16)
    save(space, tmp_path / "map")
    assert len([file for file in (tmp_path / "map" / "state" / "c").rglob("?") if file.is_file()]) > len(space.stack)
    same(space, open_map(tmp_path / "map"))
    np.testing.assert_array_equal(open_slice(tmp_path / "map", 2.0), space.slice_at(2.0))
    (tmp_path / "map" / "state" / "c" / "0" / "1" / "1").unlink()
    with pytest.raises(FileError, match="'state' lacks 1 chunks"):
        open_slice(tmp_path / "map", 0.0)


@pytest.mark.parametrize("suffix", ["", ".npz"])
@pytest.mark.parametrize(
    ("yaw", "words"),
    [
        (float("nan"), "yaw"),
        (float("inf"), "yaw"),
        (1e9, "wrap it first"),
        ([0.0, 1.0], "one number"),
        ("90deg", "yaw"),
    ],
)
def test_a_yaw_must_be_one_angle(tmp_path: Path, suffix: str, yaw: Any, words: str) -> None:
    workspace = cspace.Workspace.from_array(np.eye(3, dtype=bool), 0.1)
    save(cspace.build(workspace, ROBOTS["no slice shared"], rotations=2), tmp_path / f"map{suffix}")
    with pytest.raises(InputError, match=words):
        open_slice(tmp_path / f"map{suffix}", yaw)


def test_no_slice_of_what_is_no_map(tmp_path: Path) -> None:
    for path, words in [(tmp_path / "nothing", "does not exist"), (tmp_path, "it holds no zarr.json")]:
        with pytest.raises(FileError, match=words):
            open_slice(path)
    with pytest.raises(InputError, match="it must be a file name"):
        open_slice(None)  # type: ignore[arg-type]


# Other software.


def test_a_dataset_is_labelled(space: cspace.CSpace) -> None:
    dataset, rotations = space.to_xarray(), space.rotations
    assert rotations is not None
    assert dataset.state.dims == dataset.overlap.dims == ("rotation", "x", "y")
    assert dataset.outer.dims == dataset.inner.dims == ("x", "y")
    assert set(dataset.coords) == {"x", "y", "yaw", "yaw_bounds", "covering_angle", "slice_of"}
    np.testing.assert_array_equal(dataset.yaw, rotations.representatives)
    np.testing.assert_array_equal(dataset.covering_angle, rotations.covering_angles)
    np.testing.assert_array_equal(dataset.yaw_bounds, np.stack([rotations.borders[:-1], rotations.borders[1:]], axis=1))
    np.testing.assert_array_equal(dataset.slice_of, space.slice_of)
    assert dataset.yaw.attrs["units"] == dataset.yaw_bounds.attrs["units"] == "rad"
    assert dataset.covering_angle.attrs["units"] == "rad"
    assert dataset.yaw.attrs["bounds"] == "yaw_bounds"
    assert all(dataset[name].attrs["long_name"] for name in dataset.variables)
    x, y = np.meshgrid(dataset.x, dataset.y, indexing="ij")
    for number, yaw in enumerate(dataset.yaw.values):
        q = np.stack([x, y, np.full_like(x, yaw)], axis=-1)
        np.testing.assert_array_equal(dataset.state.isel(rotation=number), space.classify(q))
        np.testing.assert_array_equal(dataset.overlap.isel(rotation=number), space.overlap(q))


def test_a_dataset_copies_only_where_some_slices_are_shared(space: cspace.CSpace) -> None:
    dataset = space.to_xarray()
    some = 1 < len(space.stack) < len(space.slice_of)
    assert np.shares_memory(dataset.state.values, space.stack) == (not some)
    assert space.overlaps is not None
    assert np.shares_memory(dataset.overlap.values, space.overlaps) == (not some)
    with pytest.raises(ValueError, match="read-only"):
        dataset.state.values[0, 0, 0] = 0


def test_a_dataset_is_enough_to_rebuild_the_map(space: cspace.CSpace) -> None:
    same(space, rebuilt(space.to_xarray()))


def test_a_dataset_survives_zarr_and_netcdf(tmp_path: Path, space: cspace.CSpace) -> None:
    dataset = space.to_xarray()
    dataset.to_zarr(tmp_path / "set.zarr", zarr_format=3, consolidated=False)
    with xarray.open_zarr(tmp_path / "set.zarr", consolidated=False) as opened:
        assert opened.identical(dataset)
        same(space, rebuilt(opened.load()))
    dataset.to_netcdf(tmp_path / "set.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "set.nc", engine="scipy") as opened:
        same(space, rebuilt(opened.load()))


def test_xarray_opens_the_folder(tmp_path: Path, space: cspace.CSpace) -> None:
    space.save(tmp_path / "map.zarr")
    expected = space.to_xarray()
    with xarray.open_zarr(tmp_path / "map.zarr", consolidated=False) as opened:
        assert opened.state.dims == opened.overlap.dims == ("slice", "x", "y")
        assert set(opened.coords) == set(expected.coords)
        by_rotation = opened.isel(slice=opened.slice_of)
        assert by_rotation.state.transpose("rotation", "x", "y").identical(expected.state)
        assert by_rotation.overlap.transpose("rotation", "x", "y").identical(expected.overlap)
        assert {key: opened.attrs[key] for key in expected.attrs} == expected.attrs


def test_numpy_reads_an_npz_without_this_library(tmp_path: Path, space: cspace.CSpace) -> None:
    space.export(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz", allow_pickle=False) as held:
        np.testing.assert_array_equal(held["state"][held["slice_of"]], space.state)
        np.testing.assert_array_equal(held["yaw_bounds"][0], [-TURN / 16, TURN / 16])
        assert held["yaw"].tolist() == (np.arange(8) * TURN / 8).tolist()
        assert json.loads(str(held["metadata"]))["rotations"] == 8


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5, 7.0])
def test_a_ros_map_holds_the_slice_at_a_yaw(tmp_path: Path, space: cspace.CSpace, yaw: float) -> None:
    export(space, tmp_path / "map.yaml", yaw=yaw)
    workspace = cspace.Workspace.from_ros_map(tmp_path / "map.yaml")
    np.testing.assert_array_equal(workspace.outer, space.slice_at(yaw) != cspace.FREE)


def test_a_ros_map_needs_a_yaw_and_nothing_else_takes_one(tmp_path: Path, space: cspace.CSpace) -> None:
    with pytest.raises(InputError, match=r"yaw is missing for .*map.yaml; .* has 8 rotation cells; pass .*yaw=0.0"):
        space.export(tmp_path / "map.yaml")
    for suffix in SUFFIXES:
        with pytest.raises(InputError, match=r"yaw is 0.5 for .*holds every slice; leave it out"):
            export(space, tmp_path / f"map{suffix}", yaw=0.5)
    plane = cspace.build(space.workspace, space.robot)
    with pytest.raises(InputError, match=r"yaw is 0.5 for a robot that only translates; .*leave it out"):
        export(plane, tmp_path / "map.yaml", yaw=0.5)
    with pytest.raises(InputError, match="yaw"):
        export(space, tmp_path / "map.yaml", yaw=float("nan"))
    assert not list(tmp_path.iterdir())
