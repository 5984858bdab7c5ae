"""Zarr arrays, read like the zarr package does or refused."""

import json
import os
import struct
import time
import tracemalloc

import numpy as np
import pytest
import zarr
from hypothesis import given
from hypothesis import strategies as st
from numcodecs import Zstd
from zarr.codecs import BloscCodec

import cspace
from cspace import CspaceError, FileError, Workspace
from cspace._files.zarr_folders import MAX_CHUNK_BYTES, ZarrArray
from tests.fuzz import files as fuzz
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

FILLED = {"write_empty_chunks": True}
HUGE = 2**26
MAX_BYTES = 2**23


def check_refused(open_it, message):
    """Fail unless a call is refused in one line and takes little memory."""
    zarr.create_array({}, shape=1, dtype="bool")  # do not count imports of the first call
    tracemalloc.start()
    with pytest.raises(CspaceError, match=message) as caught:
        open_it()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < MAX_BYTES
    assert "\n" not in str(caught.value)


def read_cells(source):
    return Workspace.from_array(source, 0.1).outer


@pytest.fixture
def array(tmp_path):
    """Write an array of four chunks, all occupied."""
    path = tmp_path / "cells.zarr"
    zarr.create_array(str(path), data=np.ones((20, 20), bool), chunks=(10, 10), config=FILLED)
    return path


@pytest.fixture
def saved(tmp_path):
    """Save a map."""
    workspace = Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    cspace.build(workspace, cspace.Robot.disc(0.2)).save(tmp_path / "saved.zarr")
    return tmp_path / "saved.zarr"


@given(dim=st.integers(1, 3), compressed=st.booleans(), seed=seeds)
def test_boxes_agree_with_zarr(tmp_path_factory, dim, compressed, seed):
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 10, dim)
    values = rng.integers(0, 2, shape).astype(rng.choice(["?", "u1", "<i4", "f8"]))
    chunks = tuple(rng.integers(1, 10, dim).tolist())
    path = tmp_path_factory.mktemp("array") / "a.zarr"
    names = {"name": "default", "separator": str(rng.choice(["/", "."]))}
    options = {"chunk_key_encoding": names}
    if not compressed:  # by default zstd
        options["compressors"] = None
    zarr.create_array(str(path), data=values, chunks=chunks, config=FILLED, **options)
    array = ZarrArray(path)
    assert array.shape == values.shape
    np.testing.assert_array_equal(np.asarray(array), values)
    low = rng.integers(0, shape)
    high = rng.integers(low, shape) + 1
    box = tuple(map(slice, low.tolist(), high.tolist()))
    np.testing.assert_array_equal(array[box], values[box])


@pytest.mark.parametrize(
    "options",
    [{"zarr_format": 2}, {"compressors": BloscCodec()}, {"shards": (20, 20)}],
)
def test_other_encodings_are_left_to_zarr(tmp_path, options):
    path = tmp_path / "a.zarr"
    array = zarr.create_array(path, shape=(20, 20), chunks=(10, 10), dtype="bool", **options)
    array[...] = True
    with pytest.raises(FileError, match=r"of Zarr version 3|is encoded with"):
        read_cells(path)
    assert read_cells(zarr.open_array(path, mode="r")).all()


def test_other_types_are_refused(tmp_path):
    values = np.ones((3, 4), dtype="complex64")
    zarr.create_array(tmp_path / "a.zarr", data=values)
    with pytest.raises(FileError, match="of type complex64; cells are booleans"):
        read_cells(tmp_path / "a.zarr")
    zarr.create_array(tmp_path / "b.zarr", data=values.astype(bool))
    assert read_cells(tmp_path / "b.zarr").all()


def make_frame(size):
    """Return zeros as a zstd frame of repeated bytes that declares a window and no size."""
    starts = range(0, size, 2**17)
    frame = b"\x28\xb5\x2f\xfd\x00\x58"
    for start in starts:
        is_last = start == starts[-1]
        count = min(2**17, size - start)
        frame += struct.pack("<I", is_last | 1 << 1 | count << 3)[:3] + b"\0"
    return frame


def test_a_chunk_unpacks_to_the_size_of_its_array_or_is_refused(array):
    chunk = array / "c/0/0"
    chunk.write_bytes(make_frame(100))
    assert not read_cells(array)[:10, :10].any()
    for size in (99, 101, HUGE):
        chunk.write_bytes(make_frame(size))
        check_refused(lambda: read_cells(array), "cannot be read as a Zarr array")
        chunk.write_bytes(Zstd(1).encode(bytes(size)))
        check_refused(lambda: read_cells(array), "unpacks to")
    for content in (b"", b"no such thing", Zstd().encode(bytes(100))[:-1]):
        chunk.write_bytes(content)
        check_refused(lambda: read_cells(array), r"cells\.zarr: ")


def test_a_forged_chunk_of_a_saved_map_is_refused_before_it_is_unpacked(saved):
    fuzz.forge_store(saved, {}, "cell_states/c.0.0.0", Zstd(1).encode(bytes(HUGE)))
    check_refused(lambda: cspace.open(saved), "unpacks to 67108864 bytes but 900 are needed")
    (saved / "zarr.json").write_bytes(b"[" * 10**5)
    check_refused(lambda: cspace.open(saved), "usable map")


@pytest.mark.parametrize("name", ["distances", "of_a_later_release"])
@pytest.mark.parametrize(
    "shape, chunks",
    [
        ([2**31], [1]),
        ([2**61], [1]),
        ([2**62], [2**26]),
        ([2**40, 2**40], [1, 1]),
        ([10**400], [1]),
        ([1] * 40, [1] * 40),
        ([0], [1]),
        ([-1], [1]),
        ([1.5], [1]),
        ([True], [1]),
        (None, None),
        ("2", "1"),
        ({}, {}),
        ([1], [0]),
        ([2, 2], [1]),
    ],
    ids=str,
)
def test_forged_shapes_of_arrays_that_are_skipped_are_refused(saved, name, shape, chunks):
    attributes = json.loads((saved / "zarr.json").read_bytes())["attributes"]
    metadata = json.loads((saved / "cell_states" / "zarr.json").read_bytes())
    metadata |= {"shape": shape, **make_grid()}
    metadata["chunk_grid"]["configuration"]["chunk_shape"] = chunks
    (saved / name).mkdir()
    (saved / name / "c.0").write_bytes(b"there")
    (saved / name / "zarr.json").write_text(json.dumps(metadata))
    fuzz.reseal(saved, arrays=f"{attributes['arrays']} {name}")
    start = time.process_time()
    check_refused(lambda: cspace.open(saved), r"saved\.zarr")
    assert time.process_time() - start < 1.0


def test_a_missing_chunk_is_refused_unless_declared(array):
    (array / "c/1/0").unlink()
    check_refused(lambda: read_cells(array), "lacks its chunk c/1/0")
    opened = zarr.open_array(str(array), mode="r+")
    hint = "unless the attribute missing_chunks is 'fill_value'"
    with pytest.raises(FileError, match=f"lacks 1 of 4 chunks; .*{hint}"):
        read_cells(opened)
    opened.attrs["missing_chunks"] = "fill_value"
    expected = np.ones((20, 20), bool)
    expected[10:, :10] = False
    for source in (array, zarr.open_array(str(array), mode="r")):
        np.testing.assert_array_equal(read_cells(source), expected)


def make_grid(*sides):
    return {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": sides}}}


SIDE = int(MAX_CHUNK_BYTES**0.5)


@refusals(
    "values, message",
    ({"codecs": [{"name": "bytes"}, {"name": "of_a_plug_in"}]}, "encoded with bytes, of_a_plug_in"),
    (make_grid(SIDE, SIDE + 1), "at most"),
    (make_grid(SIDE, SIDE), "unpacks to 100 bytes but 268435456 are needed"),
    ({"node_type": "group"}, "holds no array"),
)
def test_metadata_of_other_arrays_are_refused(array, values, message):
    metadata = json.loads((array / "zarr.json").read_text())
    (array / "zarr.json").write_text(json.dumps(metadata | values))
    check_refused(lambda: read_cells(array), message)


@pytest.mark.parametrize("name", ["zarr.json", "c/0/0"])
def test_pipes_and_devices_in_a_folder_are_refused(array, name):
    (array / name).unlink()
    os.mkfifo(array / name)
    check_refused(lambda: read_cells(array), "a device, a pipe or a socket")
    (array / name).unlink()
    (array / name).symlink_to("/dev/zero")
    check_refused(lambda: read_cells(array), "a device, a pipe or a socket")
