"""Zarr arrays, read like the zarr package does or refused."""

import json
import os
import pickle
import shutil
import signal
import struct
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from numcodecs import Zstd
from zarr.codecs import BloscCodec, ZstdCodec

import cspace
from cspace import CspaceError, FileError, Workspace
from cspace.files.zarr_folders import MAX_CHUNK_BYTES, ZarrArray
from tests.helpers.refusals import refusals
from tests.soak import files as soak

FILLED = {"write_empty_chunks": True}

HUGE = 2**26
ENOUGH = 2**23


@contextmanager
def limit_usage(memory: int = ENOUGH, seconds: int = 20) -> Iterator[None]:
    """Fail if a block takes more bytes or seconds."""

    def late(*about: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < memory
    finally:
        tracemalloc.stop()
        signal.alarm(0)


def check_refused(open_it: Callable[[], object], message: str) -> None:
    """Fail unless a call is refused quickly in one line."""
    zarr.create_array({}, shape=1, dtype="bool")  # do not count imports of the first call
    with limit_usage(), pytest.raises(CspaceError, match=message) as caught:
        open_it()
    assert "\n" not in str(caught.value)


def make_cells(path: Path) -> Any:
    return Workspace.from_array(path, 0.1).outer


@pytest.fixture
def array(tmp_path: Path) -> Path:
    """Write an array of four chunks, all occupied."""
    path = tmp_path / "cells.zarr"
    zarr.create_array(
        str(path),
        data=np.ones((20, 20), bool),
        chunks=(10, 10),
        compressors=ZstdCodec(),
        config=FILLED,
    )
    return path


@pytest.fixture
def space() -> cspace.CSpace:
    return cspace.build(Workspace.from_array(np.eye(30, dtype=bool), 0.1), cspace.Robot.disc(0.2))


def change_json(file: Path, **values: Any) -> None:
    """Change values of a JSON file."""
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


# ---- reading -------------------------------------------------------------------------------------


@given(data=st.data(), dim=st.integers(1, 3), compressed=st.booleans())
@settings(max_examples=60)
def test_boxes_agree_with_zarr(
    data: st.DataObject, dim: int, compressed: bool, tmp_path_factory: Any
) -> None:
    shape, chunks = (
        tuple(data.draw(st.lists(st.integers(1, 9), min_size=dim, max_size=dim))) for _ in range(2)
    )
    dtype = data.draw(st.sampled_from(["?", "i1", "u1", "<i4", "<u2", "f4", "f8", "i8"]))
    values = np.random.default_rng(0).integers(0, 2, shape).astype(dtype)
    path = tmp_path_factory.mktemp("array") / "a.zarr"
    options: dict[str, Any] = {} if compressed else {"compressors": None}  # by default zstd
    zarr.create_array(str(path), data=values, chunks=chunks, config=FILLED, **options)
    array = ZarrArray(path)
    box = tuple(
        slice(low, data.draw(st.integers(low + 1, n)))
        for n in shape
        for low in [data.draw(st.integers(0, n - 1))]
    )
    assert (array.shape, array.ndim) == (shape, dim)
    np.testing.assert_array_equal(array[box], zarr.open_array(str(path), mode="r")[box])
    np.testing.assert_array_equal(np.asarray(array), values)


@pytest.mark.parametrize(
    "options",
    [{"zarr_format": 2}, {"compressors": BloscCodec()}, {"shards": (20, 20)}, {"dtype": ">i2"}],
    ids=["version 2", "blosc", "shards", "big-endian"],
)
def test_other_encodings_are_left_to_zarr(tmp_path: Path, options: dict[str, Any]) -> None:
    made = zarr.create_array(
        tmp_path / "a.zarr", shape=(20, 20), chunks=(10, 10), **{"dtype": "bool", **options}
    )
    made[...] = np.ones((20, 20), dtype=made.dtype)
    if "dtype" not in options:
        with pytest.raises(FileError, match="open it with zarr and pass the array"):
            make_cells(tmp_path / "a.zarr")
    assert make_cells(zarr.open_array(tmp_path / "a.zarr", mode="r")).all()


def test_zstd_frames_without_a_size_are_read(array: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = bytearray(Zstd().encode(bytes(100)))
    # 100 zeros as one block of repeated bytes, in a frame that declares a window and no size.
    (array / "c/0/0").write_bytes(
        b"\x28\xb5\x2f\xfd\x00\x00" + struct.pack("<I", 1 | 1 << 1 | 100 << 3)[:3] + b"\1"
    )
    assert bytes(frame[:4]) == b"\x28\xb5\x2f\xfd"
    assert make_cells(array).all()


def test_a_pickled_array_is_found_from_another_folder(
    array: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(array.parent)
    content = pickle.dumps(ZarrArray(array.name))
    monkeypatch.chdir("/")
    np.testing.assert_array_equal(pickle.loads(content), np.ones((20, 20)))
    shutil.rmtree(array)
    with pytest.raises(FileError, match="no array"):
        pickle.loads(content)


# ---- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize("size", [99, 101, HUGE])
@pytest.mark.parametrize("compressed", [False, True])
def test_a_chunk_unpacks_to_the_size_of_its_array_or_is_refused(
    tmp_path: Path, compressed: bool, size: int
) -> None:
    path = tmp_path / "cells.zarr"
    compressors = ZstdCodec() if compressed else None
    zarr.create_array(
        str(path), data=np.ones((10, 10), bool), chunks=(10, 10), compressors=compressors
    )
    (path / "c/0/0").write_bytes(
        Zstd(1).encode(bytes(size)) if compressed else bytes(min(size, 2**20))
    )
    check_refused(lambda: make_cells(path), "unpacks to")


@pytest.mark.parametrize("size", [99, 101, HUGE])
def test_zstd_frames_without_a_size_unpack_to_the_size_of_the_array(array: Path, size: int) -> None:
    blocks = [min(2**17, size - start) for start in range(0, size, 2**17)]
    headers = [
        struct.pack("<I", (start == len(blocks) - 1) | 1 << 1 | n << 3)[:3]
        for start, n in enumerate(blocks)
    ]
    (array / "c/0/0").write_bytes(
        b"\x28\xb5\x2f\xfd\x00\x58" + b"".join(header + b"\1" for header in headers)
    )
    check_refused(lambda: make_cells(array), "cannot be read as a Zarr array")


@pytest.mark.parametrize("content", [b"", b"\0", b"no such thing", Zstd().encode(bytes(100))[:-1]])
def test_a_damaged_chunk_is_refused(array: Path, content: bytes) -> None:
    (array / "c/1/0").write_bytes(content)
    check_refused(lambda: make_cells(array), r"cells\.zarr: ")
    with pytest.raises(FileError, match=r"cannot be read|missing or damaged"):
        _ = Workspace.from_array(zarr.open_array(str(array), mode="r"), 0.1).outer


def test_a_missing_chunk_is_refused_unless_declared(array: Path) -> None:
    (array / "c/1/0").unlink()
    check_refused(lambda: make_cells(array), "lacks its chunk c/1/0")
    opened = zarr.open_array(str(array), mode="r+")
    with pytest.raises(FileError, match="lacks 1 of 4 chunks"):
        Workspace.from_array(opened, 0.1)
    opened.attrs["missing_chunks"] = "fill_value"
    expected = np.ones((20, 20), bool)
    expected[10:, :10] = False
    for source in (array, zarr.open_array(str(array), mode="r")):
        np.testing.assert_array_equal(Workspace.from_array(source, 0.1).outer, expected)


@refusals(
    "values, message",
    ({"codecs": [{"name": "bytes"}, {"name": "of_a_plug_in"}]}, "encoded with bytes, of_a_plug_in"),
    (
        {"codecs": [{"name": "bytes"}, {"name": "zstd"}, {"name": "gzip"}]},
        "encoded with bytes, zstd, gzip",
    ),
    ({"codecs": [{"name": "of_a_plug_in"}]}, "encoded with of_a_plug_in"),
    (
        {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [2**14, 2**14 + 1]}}},
        "at most",
    ),
    ({"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [0, 1]}}}, "above zero"),
    ({"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [1]}}}, "chunks of"),
    ({"shape": [20, -1]}, "above zero"),
    ({"shape": 7}, "cannot be read"),
    ({"data_type": "O"}, "cannot be read"),
    ({"data_type": {"name": "of_a_plug_in"}}, "cannot be read"),
    ({"node_type": "group"}, "holds no array"),
    ({"zarr_format": 4}, "holds no array"),
    ({"codecs": []}, "cannot be read"),
)
def test_metadata_of_other_arrays_are_refused(
    array: Path, values: dict[str, Any], message: str
) -> None:
    change_json(array / "zarr.json", **values)
    check_refused(lambda: make_cells(array), message)


def test_chunks_of_the_maximum_size_are_accepted(array: Path) -> None:
    side = int(MAX_CHUNK_BYTES**0.5)
    change_json(
        array / "zarr.json",
        chunk_grid={"name": "regular", "configuration": {"chunk_shape": [side, side]}},
    )
    check_refused(lambda: make_cells(array), "unpacks to 100 bytes but 268435456 are needed")


@pytest.mark.parametrize("link", [False, True], ids=["pipe", "device"])
@pytest.mark.parametrize(
    "name", ["cells/zarr.json", "cells/c/0/0", "saved/zarr.json", "saved/cell_states/c/0/0/0"]
)
def test_pipes_and_devices_in_a_folder_are_refused(
    tmp_path: Path, array: Path, space: cspace.CSpace, name: str, link: bool
) -> None:
    space.save(tmp_path / "saved.zarr")
    path = tmp_path / f"{name.partition('/')[0]}.zarr"
    file = path / name.partition("/")[2]
    file.unlink()
    file.symlink_to("/dev/zero") if link else os.mkfifo(file)
    check_refused(
        lambda: make_cells(path) if path == array else cspace.open(path),
        "a device, a pipe or a socket",
    )


def test_a_forged_chunk_of_a_saved_map_is_refused_before_it_is_unpacked(
    tmp_path: Path, space: cspace.CSpace
) -> None:
    path = tmp_path / "map"
    space.save(path)
    soak.forge_store(path, {}, "cell_states/c/0/0/0", Zstd(1).encode(bytes(HUGE)))
    check_refused(lambda: cspace.open(path), "unpacks to 67108864 bytes but 900 are needed")


@pytest.mark.parametrize("content", [b"{", b"", b"[]", b"[" * 10**5, b"\xff"])
def test_a_folder_with_damaged_metadata_is_refused(
    tmp_path: Path, space: cspace.CSpace, content: bytes
) -> None:
    space.save(tmp_path / "m")
    (tmp_path / "m/zarr.json").write_bytes(content)
    check_refused(lambda: cspace.open(tmp_path / "m"), "usable map")
