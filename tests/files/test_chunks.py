"""Zarr arrays, read like zarr or refused."""

import gzip
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
from numcodecs import Blosc, GZip, Zstd
from zarr.codecs import BloscCodec, Crc32cCodec, GzipCodec, ZstdCodec

import cspace
from cspace import CspaceError, FileError, Workspace, store
from cspace.files.chunks import MAX_CHUNK_BYTES, ZarrArray
from tests.refusals import refusals
from tests.soak import files as soak

FILLED = {"write_empty_chunks": True}
CODECS_V3 = [[], [ZstdCodec()], [GzipCodec()], [BloscCodec()], [ZstdCodec(), Crc32cCodec()], [Crc32cCodec()]]
CODECS_V2 = [None, Zstd(), GZip(), Blosc()]

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
    zarr.create_array(str(path), data=np.ones((20, 20), bool), chunks=(10, 10), compressors=ZstdCodec(), config=FILLED)
    return path


@pytest.fixture
def space() -> cspace.CSpace:
    return cspace.build(Workspace.from_array(np.eye(30, dtype=bool), 0.1), cspace.Robot.disc(0.2))


def change_json(file: Path, **values: Any) -> None:
    """Change values of a JSON file."""
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


# ---- reading -----------------------------------------------------------------------------------------------------


@given(data=st.data(), dim=st.integers(1, 3), version=st.sampled_from([2, 3]))
@settings(max_examples=60)
def test_boxes_agree_with_zarr(data: st.DataObject, dim: int, version: int, tmp_path_factory: Any) -> None:
    shape, chunks = (tuple(data.draw(st.lists(st.integers(1, 9), min_size=dim, max_size=dim))) for _ in range(2))
    dtype = data.draw(st.sampled_from(["?", "i1", "u1", "<i4", ">u2", "f4", ">f8", "i8"]))
    values = np.random.default_rng(0).integers(0, 2, shape).astype(dtype)
    options: dict[str, Any] = {"compressors": data.draw(st.sampled_from(CODECS_V3 if version == 3 else CODECS_V2))}
    if version == 2:
        options |= {"order": data.draw(st.sampled_from("CF")), "zarr_format": 2}
    encoding = {"name": data.draw(st.sampled_from(["default", "v2"])), "separator": data.draw(st.sampled_from("./"))}
    options |= {"chunk_key_encoding": {"name": "v2", "separator": encoding["separator"]} if version == 2 else encoding}
    path = tmp_path_factory.mktemp("array") / "a.zarr"
    written = zarr.create_array(str(path), shape=shape, chunks=chunks, dtype=dtype, config=FILLED, **options)
    written[...] = values
    array = ZarrArray(path)
    box = tuple(
        slice(low, data.draw(st.integers(low + 1, n))) for n in shape for low in [data.draw(st.integers(0, n - 1))]
    )
    assert (array.shape, array.ndim) == (shape, dim)
    np.testing.assert_array_equal(array[box], zarr.open_array(str(path), mode="r")[box])
    np.testing.assert_array_equal(np.asarray(array), values)


def test_zstd_frames_without_a_size_are_read(array: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = bytearray(Zstd().encode(bytes(100)))
    # 100 zeros as one block of repeated bytes, in a frame that declares a window and no size.
    (array / "c/0/0").write_bytes(b"\x28\xb5\x2f\xfd\x00\x00" + struct.pack("<I", 1 | 1 << 1 | 100 << 3)[:3] + b"\1")
    assert bytes(frame[:4]) == b"\x28\xb5\x2f\xfd"
    assert make_cells(array).all()


def test_a_pickled_array_is_found_from_another_folder(array: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(array.parent)
    content = pickle.dumps(ZarrArray(array.name))
    monkeypatch.chdir("/")
    np.testing.assert_array_equal(pickle.loads(content), np.ones((20, 20)))
    shutil.rmtree(array)
    with pytest.raises(FileError, match="holds no array"):
        pickle.loads(content)


# ---- what is refused ---------------------------------------------------------------------------------------------

ENCODERS: dict[str, tuple[Any, Callable[[bytes], bytes]]] = {
    "zstd": (ZstdCodec(), Zstd(1).encode),
    "gzip": (GzipCodec(), lambda content: gzip.compress(content, 1)),
    "blosc": (BloscCodec(), Blosc("zstd").encode),
}


@pytest.mark.parametrize("size", [99, 101, HUGE])
@pytest.mark.parametrize("codec", ENCODERS)
def test_a_chunk_unpacks_to_the_size_of_its_array_or_is_refused(tmp_path: Path, codec: str, size: int) -> None:
    path, (compressor, encode) = tmp_path / "cells.zarr", ENCODERS[codec]
    zarr.create_array(str(path), data=np.ones((10, 10), bool), chunks=(10, 10), compressors=compressor)
    (path / "c/0/0").write_bytes(encode(bytes(size)))
    check_refused(lambda: make_cells(path), "unpacks to")


@pytest.mark.parametrize("size", [99, 101, HUGE])
def test_zstd_frames_without_a_size_unpack_to_the_size_of_the_array(array: Path, size: int) -> None:
    blocks = [min(2**17, size - start) for start in range(0, size, 2**17)]
    headers = [struct.pack("<I", (start == len(blocks) - 1) | 1 << 1 | n << 3)[:3] for start, n in enumerate(blocks)]
    (array / "c/0/0").write_bytes(b"\x28\xb5\x2f\xfd\x00\x58" + b"".join(header + b"\1" for header in headers))
    check_refused(lambda: make_cells(array), "cannot be read as a Zarr array")


def test_a_blosc_chunk_that_declares_more_bytes_than_there_are_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cells.zarr"
    zarr.create_array(str(path), data=np.ones((10, 10), bool), chunks=(10, 10), compressors=BloscCodec())
    content = bytearray((path / "c/0/0").read_bytes())
    content[12:16] = struct.pack("<I", 2**30)
    (path / "c/0/0").write_bytes(content)
    check_refused(lambda: make_cells(path), "declares 1073741824")


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
    ({"codecs": [{"name": "bytes"}, {"name": "of_a_plug_in"}]}, "encoded with of_a_plug_in"),
    ({"codecs": [{"name": "bytes"}, {"name": "zstd"}, {"name": "gzip"}]}, "encoded with zstd, gzip"),
    ({"codecs": [{"name": "of_a_plug_in"}]}, "encoded with of_a_plug_in"),
    ({"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [2**14, 2**14 + 1]}}}, "at most"),
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
def test_metadata_of_other_arrays_are_refused(array: Path, values: dict[str, Any], message: str) -> None:
    change_json(array / "zarr.json", **values)
    check_refused(lambda: make_cells(array), message)


def test_chunks_of_the_maximum_size_are_accepted(array: Path) -> None:
    side = int(MAX_CHUNK_BYTES**0.5)
    change_json(array / "zarr.json", chunk_grid={"name": "regular", "configuration": {"chunk_shape": [side, side]}})
    check_refused(lambda: make_cells(array), "unpacks to 100 bytes but 268435456 are needed")


@pytest.mark.parametrize("link", [False, True], ids=["pipe", "device"])
@pytest.mark.parametrize("name", ["cells/zarr.json", "cells/c/0/0", "saved/zarr.json", "saved/cell_states/c/0/0/0"])
def test_pipes_and_devices_in_a_folder_are_refused(
    tmp_path: Path, array: Path, space: cspace.CSpace, name: str, link: bool
) -> None:
    space.save(tmp_path / "saved.zarr")
    path = tmp_path / f"{name.partition('/')[0]}.zarr"
    file = path / name.partition("/")[2]
    file.unlink()
    file.symlink_to("/dev/zero") if link else os.mkfifo(file)
    check_refused(lambda: make_cells(path) if path == array else cspace.open(path), "a device, a pipe or a socket")


@pytest.mark.parametrize("link", [False, True], ids=["pipe", "device"])
@pytest.mark.parametrize("name", ["zarr.json", "slice_of/c/0", "record/c/0/0/0", "cell_states/c/0/0/0"])
def test_pipes_and_devices_in_a_store_of_tiles_are_refused(tmp_path: Path, name: str, link: bool) -> None:
    tiled = build_in_tiles(tmp_path)
    (tmp_path / "m" / name).unlink()
    (tmp_path / "m" / name).symlink_to("/dev/zero") if link else os.mkfifo(tmp_path / "m" / name)
    q, _ = [0.5, 2.5], tiled

    def look_up() -> None:
        cspace.open(tmp_path / "m").is_free(q)

    check_refused(look_up, "a device, a pipe or a socket|slice_of")


def build_in_tiles(folder: Path) -> cspace.TiledCSpace:
    workspace = Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    return cspace.build(workspace, cspace.Robot.disc(0.2), store=folder / "m", tile=30)


def test_a_forged_chunk_of_a_saved_map_is_refused_before_it_is_unpacked(tmp_path: Path, space: cspace.CSpace) -> None:
    path = tmp_path / "map"
    space.save(path)
    soak.forge_store(path, {}, "cell_states/c/0/0/0", Zstd(1).encode(bytes(HUGE)))
    check_refused(lambda: cspace.open(path), "unpacks to 67108864 bytes but 900 are needed")


@pytest.mark.parametrize("name", ["record/c/0/0/0", "cell_states/c/0/0/0", "outer/c/0/0"])
def test_a_forged_chunk_of_a_store_of_tiles_is_refused_before_it_is_unpacked(tmp_path: Path, name: str) -> None:
    tiled = build_in_tiles(tmp_path)
    (tmp_path / "m" / name).write_bytes(Zstd(1).encode(bytes(HUGE)))

    def look_up() -> None:
        opened = cspace.open(tmp_path / "m")
        opened.is_free([0.5, 2.5])
        opened.window(tiled.grid.lower, tiled.grid.upper)

    check_refused(look_up, "unpacks to 67108864 bytes|differs from its digest")


@pytest.mark.parametrize("name", ["/etc/passwd", "../outside", "x/../../outside"])
def test_a_saved_map_reads_no_file_outside_its_folder(tmp_path: Path, space: cspace.CSpace, name: str) -> None:
    path = tmp_path / "map"
    space.save(path)
    root = json.loads((path / "zarr.json").read_text())["attributes"]
    digests = dict(entry.rsplit(":", 1) for entry in root["digests"].split()) | {name: "0"}
    (path / "zarr.json").write_bytes(store.root_text(store.seal(root, digests)))
    check_refused(lambda: cspace.open(path, in_memory=False), "names a file|which no map does")


@pytest.mark.parametrize("content", [b"{", b"", b'{"shape": [1, 1, 1000000000000]}', b"[" * 10**5])
def test_damaged_descriptions_of_labels_are_ignored(tmp_path: Path, content: bytes) -> None:
    build_in_tiles(tmp_path).compute_components()
    (tmp_path / "m/labels_0/zarr.json").write_bytes(content)
    assert cspace.open(tmp_path / "m").is_connected([0.5, 2.5], [0.6, 2.5])


@pytest.mark.parametrize("content", [b"{", b"", b"[]", b"[" * 10**5, b"\xff"])
def test_a_folder_with_damaged_metadata_is_refused(tmp_path: Path, content: bytes) -> None:
    build_in_tiles(tmp_path)
    (tmp_path / "m/zarr.json").write_bytes(content)
    check_refused(lambda: cspace.open(tmp_path / "m"), "usable map")
    shutil.rmtree(tmp_path / "m")
