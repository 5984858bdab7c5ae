"""Stored maps: Zarr folders with the states of a map, tile by tile.

A saved map is a store of one tile. ``cell_states`` has chunks of one tile and some slices; ``outer`` and, if it
differs, ``inner`` have chunks of one tile. ``record`` has one row of numbers per tile: the counts of its states, the
box around its obstacles, the SHA-256 digests of its other chunks, and that of the row with the tile and the settings of
the map, so that it fits no other tile and no other map. The row is written last, so a tile is done once its row exists.
All other arrays are written at once. The metadata of the folder hold a digest of each of their files, of all rows
together, and of themselves.

Zarr reads a missing chunk as the fill value, without an error. So no fill value is a state or a free cell, every chunk
is written, and a chunk is used only if it matches its digest.

Each file is written under a temporary name beside its own, and renamed. An update writes its files into a separate
folder, names that folder in the metadata, which commits it, and then moves the files over the old ones. A reader looks
into that folder first, so that it finds the old map or the new one at any moment.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
import shutil
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace import __version__
from cspace.arrays import BLOCKED, MIXED, Bools, Box, Ints, States, StrPath, intersect_boxes
from cspace.compiling import kernel
from cspace.errors import CspaceError, FileError
from cspace.files.access import check_suffix, decoding, read_bytes, read_member, replacing
from cspace.files.chunks import MAX_CHUNK_BYTES, Layout, unpack
from cspace.files.plain import read_json
from cspace.grid import Grid
from cspace.limits import check_bytes
from cspace.map.contents import Contents
from cspace.map.description import (
    AXES,
    FORMAT,
    VERSION,
    arrays_of,
    attributes_of,
    axes_of,
    grid_of,
    metadata_of,
    shapes_from,
    stored,
    turns_of,
)
from cspace.map.exterior import Exterior
from cspace.map.storage import PackedStates, Stack
from cspace.obstacles import CellsInMemory
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.shapes import Shape
from cspace.workspace import Workspace

_OLD_FORMATS: Final = (FORMAT, "cspace-tiles")
"""Names of the format, in this version and earlier ones."""

ROOT_FILE: Final = "zarr.json"
"""Name of the file with the metadata of a folder or an array."""

DIGESTED: Final = ("cell_states", "outer", "inner")
"""Arrays whose chunk digests are in the records of tiles."""

TILED: Final = (*DIGESTED, "record")
"""Arrays with one or several chunks per tile."""

UNTILED: Final = ("overlap_counts",)
"""Arrays that only maps in memory hold."""

MAP_SUFFIXES: Final = (".zarr", "")
"""Suffixes of stored maps."""

CHUNK_CELLS: Final = 2**24
"""Maximum number of states in a chunk of a map built tile by tile, unless one slice of a tile has more."""

SAVED_CHUNK_CELLS: Final = 2**20
"""Maximum number of states in a chunk of a saved map, unless one slice has more; small for quick reads of one slice."""

ZSTD_LEVEL: Final = 1
"""Level of zstd; higher levels take more time and save little, or even enlarge slices of rotated robots."""

LABEL_HEADER_LENGTH: Final = 8
"""Number of int32 before the labels of a tile: the digest of the data that they were computed from."""

_DIGEST_LENGTH: Final = 4
"""Number of int64 in a digest."""

_ASIDE_PREFIX: Final = ".cspace-"
"""Prefix of the names of files that are not in place yet."""

_ROTATION_ROUNDING: Final = 1e-12
"""Maximum difference of rotation cells between machines; proofs have far more slack."""

_DAMAGE_ADVICE: Final = (
    "a stored map must be complete and unchanged",
    "copy it again from an intact copy, or build it again",
)
_LABELS_COMMENT: Final = (
    "eight numbers that tell what it was made from; then, for each axis, the near face and the far one, over the "
    "rotation cells; -1 where a cell has none"
)
_METADATA_KEYS: Final = (
    *("format", "format_version", "library_version", "lower", "spacing", "shape", "outside", "margin", "precision"),
    *("rotations", "slices", "robot", "workspace_source"),
    *("tile", "depth", "same", "method", "stamp", "version", "aside", "box", "counts", "records"),
)

NOT_DONE: Final[Mapping[str, Any]] = {"version": 0, "aside": "", "box": None, "counts": None, "records": None}
"""Metadata of a store without tiles."""

_ONE_PER_BYTE: Final = np.uint64(0x0101010101010101)

Index = tuple[int, ...]
"""Index of a tile along each axis."""


# ---- digests and errors ----------------------------------------------------------------------------------------------


def map_error(path: StrPath, what: str) -> FileError:
    """Return the error for a stored map that cannot be trusted."""
    return FileError(str(Path(path)), f"is not a usable map: {what}", *_DAMAGE_ADVICE)


def unfinished_map_error(path: StrPath, share: float) -> FileError:
    """Return the error for a map with unfinished tiles.

    `share` of its tiles are done.
    """
    rule, hint = "a map must be complete to be read", "run the same build again to finish it"
    return FileError(str(path), f"is {share:.1%} done", rule, hint)


def decoding_map(path: StrPath) -> AbstractContextManager[None]:
    """Turn any decoder exception into one error for the map."""
    return decoding(path, "usable map", *_DAMAGE_ADVICE)


@contextmanager
def making_map(path: StrPath) -> Iterator[None]:
    """Turn any exception from intact files into one error for the map.

    Intact files can still describe no map.
    """
    try:
        yield
    except (FileError, MemoryError, UserWarning):  # callers may turn our warnings into errors
        raise
    except Exception as error:  # files that match their digests can still hold anything, and reach several libraries
        reason = f"{type(error).__name__}: {' '.join(str(error).split()):.200}"
        raise map_error(path, f"its parts make no map ({reason})") from error


def hex_digest(content: bytes | memoryview) -> str:
    """Return the SHA-256 digest of bytes, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def binary_digest(content: bytes) -> bytes:
    """Return the SHA-256 digest of bytes."""
    return hashlib.sha256(content).digest()


def seal(metadata: Mapping[str, Any], digests: Mapping[str, str]) -> dict[str, Any]:
    """Add the digests of the files, and a digest of everything."""
    sealed = {**metadata, "digests": " ".join(f"{name}:{digest}" for name, digest in digests.items())}
    return {**sealed, "digest": hex_digest(_digest_text(sealed))}


def _digest_text(metadata: Mapping[str, Any]) -> bytes:
    """Return the text for the digest of the metadata."""
    return json.dumps({key: value for key, value in metadata.items() if key != "digest"}, sort_keys=True).encode()


def _unseal(metadata: Any, path: StrPath) -> dict[str, str]:
    """Return the digest of each file, from metadata made by :func:`seal`.

    Raises FileError if the metadata were changed, or have another version of the format.
    """
    if not isinstance(metadata, Mapping) or metadata.get("format") not in _OLD_FORMATS:
        raise map_error(path, f"its metadata do not say format {FORMAT!r}")
    if (metadata["format"], metadata.get("format_version")) != (FORMAT, VERSION):
        problem = f"has format version {metadata.get('format_version')!r}"
        rule = f"cspace {__version__} reads only version {VERSION}"
        writer = metadata.get("library_version", "unknown")
        raise FileError(os.fspath(path), problem, rule, f"build it again, or open it with version {writer}")
    missing = [key for key in (*_METADATA_KEYS, "digests", "digest") if key not in metadata]
    if missing:
        raise map_error(path, f"its metadata lack {', '.join(missing)}")
    if metadata["digest"] != hex_digest(_digest_text(metadata)):
        raise map_error(path, "its metadata differ from their digest")
    return dict(entry.rsplit(":", 1) for entry in metadata["digests"].split())


def root_text(metadata: Mapping[str, Any]) -> bytes:
    """Return the content of the root file.

    It is unique for given metadata.
    """
    return json.dumps({"attributes": metadata, "zarr_format": 3, "node_type": "group"}, indent=2).encode()


def read_metadata(path: StrPath) -> dict[str, Any]:
    """Read the metadata of a stored map without checking them.

    Raises FileError if the file is missing or malformed.
    """
    # The robot's mesh is a part of it, so it may be as large as a mesh.
    return dict(read_json(Path(path, ROOT_FILE), "saved map", limit="max_bytes")["attributes"])


def is_store(path: StrPath) -> bool:
    """Return True if a folder is a stored map.

    It may be of any version, and incomplete.
    """
    try:
        return read_metadata(path)["format"] in _OLD_FORMATS
    except (CspaceError, KeyError, TypeError, ValueError):
        return False


def _is_map_folder(folder: Path) -> bool:
    """Return True if a folder holds nothing but a map.

    The map may be damaged, or of an earlier version.
    """
    parts = {ROOT_FILE, "c"}
    known = {*stored(), "labels_0", "labels_1", "geometry", "vertices", "faces", "centers", "radii"}
    return all(
        (entry.name == ROOT_FILE and entry.is_file())
        or (entry.name in known and entry.is_dir() and {part.name for part in entry.iterdir()} <= parts)
        or entry.name.startswith(_ASIDE_PREFIX)
        for entry in folder.iterdir()
    )


# ---- tiles -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Record:
    """Summary of a finished tile.

    Attributes
    ----------
    counts : ndarray of int64, shape (slices, 3)
        Number of FREE, MIXED and BLOCKED cells of each slice.
    box : ndarray of int64, shape (2, d)
        First and last cell, in the whole map, of the box around the outer cells; the first is beyond the last if there
        are none. The box is the whole tile unless the exterior is free.
    digests : tuple of bytes
        Digests of its chunks of states, of outer cells, and of inner cells (or again of outer cells).
    own_digest : bytes
        Digest of its chunk of ``record``.
    """

    counts: Ints
    box: Ints
    digests: tuple[bytes, ...]
    own_digest: bytes

    @property
    def mark(self) -> bytes:
        """Digest of all chunks of the tile."""
        return binary_digest(b"".join(self.digests))


RecordReader = Callable[[Index], Record]
"""Function that returns the record of a finished tile."""


@kernel
def count_states(states: NDArray[np.uint8]) -> tuple[int, int]:
    """Count the MIXED and BLOCKED states."""
    mixed, blocked = 0, 0
    eights = states[: len(states) // 8 * 8].view(np.uint64)
    for first in range(0, len(eights), 255):  # each byte counts to at most 255
        ones, twos = np.uint64(0), np.uint64(0)
        for word in eights[first : first + 255]:
            ones += word & _ONE_PER_BYTE
            twos += (word >> np.uint64(1)) & _ONE_PER_BYTE
        for shift in range(0, 64, 8):
            mixed += int((ones >> np.uint64(shift)) & np.uint64(255))
            blocked += int((twos >> np.uint64(shift)) & np.uint64(255))
    for k in range(8 * len(eights), len(states)):
        mixed += states[k] == MIXED
        blocked += states[k] == BLOCKED
    return mixed, blocked


def _bounding_box(cells: Bools) -> Ints:
    """Return the bounding box of set cells, shape (2, d).

    It holds the first and last cell, far inverted if no cell is set.
    """
    used = [
        np.flatnonzero(cells.any(axis=tuple(a for a in range(cells.ndim) if a != axis))) for axis in range(cells.ndim)
    ]
    if not len(used[0]):
        return np.array([[2**62] * cells.ndim, [-(2**62)] * cells.ndim]) // 2
    return np.array([[part[0] for part in used], [part[-1] for part in used]])


# ---- the store -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Store:
    """A stored map at one moment.

    Several processes may read and write it at once.

    Attributes
    ----------
    path : Path
    metadata : dict
        Metadata of :func:`metadata_of`, and ``tile``, the cells of a tile along each axis; ``depth``, the slices per
        chunk; ``same``, true if inner and outer cells are equal; ``method``, the engine of the build; ``stamp`` of the
        workspace; ``version``, the number of updates; ``aside``, a folder of newer files. Once all tiles are done, also
        ``counts`` of each slice, ``box`` around all obstacles, and ``records``, the digest of all records.
    digests : dict
        Digest of each file of the arrays without tiles, and of each description of an array.
    moment : tuple
        Changes with every change of the map.
    """

    path: Path
    metadata: Mapping[str, Any]
    digests: Mapping[str, str]
    moment: tuple[int, int, int]

    # ---- what it holds -----------------------------------------------------------------------------------------------

    @cached_property
    def grid(self) -> Grid:
        """Grid of the whole map."""
        return grid_of(self.metadata)

    @property
    def outside(self) -> str:
        """State of space outside the workspace."""
        return str(self.metadata["outside"])

    @property
    def margin(self) -> float:
        """Metres by which the robot was grown to prove FREE."""
        return float(self.metadata["margin"])

    @cached_property
    def robot(self) -> Robot:
        """Robot of the map."""
        return Robot.from_spec(json.loads(self.metadata["robot"]))

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of the arrays."""
        return frozenset(file.split("/")[0] for file in self.digests)

    @cached_property
    def rotations(self) -> Rotations:
        """Rotation cells of the map."""
        return Rotations.from_stored_arrays({name: self.array(name) for name in turns_of(self.names)})

    @cached_property
    def slice_of(self) -> Ints:
        """Slice of each rotation cell.

        Raises ValueError if the rotation cells, or the cells that share a slice, differ from the robot's.
        """
        slice_of = self.rotations.assign_slices(self.robot.shape)
        for name, needed in ({"slice_of": slice_of} | self.rotations.stored_arrays).items():
            if not np.allclose(self.array(name), needed, rtol=0.0, atol=_ROTATION_ROUNDING):
                raise ValueError(f"its array {name!r} does not match its rotation cells and its robot")
        return slice_of

    @cached_property
    def shapes(self) -> tuple[Shape, ...] | None:
        """Obstacles as shapes, if known; an update forgets them."""
        with decoding_map(self.path):
            return shapes_from(self.array("shapes")) if "shapes" in self.names else None

    @property
    def proves_blocked(self) -> bool | None:
        """True if BLOCKED is proven; None if unknown."""
        return bool(self.metadata["inner"]) if "inner" in self.metadata else None

    @property
    def is_done(self) -> bool:
        """True if all tiles are done."""
        return self.metadata["box"] is not None

    @property
    def tile(self) -> tuple[int, ...]:
        """Number of cells of a tile along each axis."""
        return tuple(self.metadata["tile"])

    @property
    def slices(self) -> int:
        """Number of slices."""
        return int(self.metadata["slices"])

    @property
    def depth(self) -> int:
        """Number of slices in a chunk of states."""
        return int(self.metadata["depth"])

    @cached_property
    def layers(self) -> int:
        """Number of chunks of states in a tile."""
        return -(-self.slices // self.depth)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of tiles along each axis."""
        return tuple(-(-n // t) for n, t in zip(self.grid.shape, self.tile, strict=True))

    def __iter__(self) -> Iterator[Index]:
        """Iterate over the indices of all tiles."""
        return itertools.product(*map(range, self.counts))

    def __len__(self) -> int:
        """Return the number of tiles."""
        return math.prod(self.counts)

    def cells(self, index: Index) -> tuple[slice, ...]:
        """Return the cells of a tile."""
        return tuple(
            slice(i * t, min((i + 1) * t, n)) for i, t, n in zip(index, self.tile, self.grid.shape, strict=True)
        )

    def numbers(self, layer: int) -> range:
        """Return the slices of a chunk of states."""
        return range(layer * self.depth, min((layer + 1) * self.depth, self.slices))

    def tiles_in(self, box: Sequence[slice]) -> Iterator[Index]:
        """Iterate over the tiles that intersect a box.

        The box may extend beyond the grid.
        """
        cut = [
            (max(part.start, 0), min(part.stop, n), t)
            for part, n, t in zip(box, self.grid.shape, self.tile, strict=True)
        ]
        spans = [range(first // t, -(-stop // t)) if first < stop else range(0) for first, stop, t in cut]
        return itertools.product(*spans)

    # ---- made and opened ---------------------------------------------------------------------------------------------

    @classmethod
    def create(cls, folder: StrPath, metadata: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Store:
        """Write a store without tiles; `arrays` holds the arrays without tiles.

        Raises FileError if writing fails.
        """
        # The global attribute "coordinates" tells readers of the CF conventions which arrays label others.
        metadata = {**metadata, **NOT_DONE, "coordinates": " ".join((*turns_of(arrays), "slice_of"))}
        digests = {}
        for name, content in _iterate_files(metadata, arrays):
            digests[name] = hex_digest(content)
            file = Path(folder, name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        Path(folder, ROOT_FILE).write_bytes(root_text(seal(metadata, digests)))
        return cls.open(folder)

    @classmethod
    def open(cls, path: StrPath) -> Store:
        """Open a store, complete or not.

        Only its rotation cells are read and checked.

        Raises FileError if it is missing, was changed, or is of an earlier version.
        """
        root = Path(path) / ROOT_FILE
        root = Path(path) / ROOT_FILE
        if not root.exists():
            raise map_error(path, f"it holds no {ROOT_FILE}")
        with making_map(path):
            moment = _fingerprint(root)
            content = read_bytes(root, "saved map", memory=8.0)
            metadata = json.loads(content)["attributes"]
            store = cls(Path(path), metadata, _unseal(metadata, path), moment)
            if content != root_text(metadata):
                raise map_error(path, f"its {ROOT_FILE} was changed")
            aside = metadata["aside"]
            if aside and (aside.strip("/.") != aside[1:] or "/" in aside):
                raise map_error(path, f"its newer files are in {aside!r}")
            if min(*store.tile, store.depth, store.slices) < 1:
                raise map_error(path, "its tiles hold nothing")
            _check_names(store)
            _ = store.slice_of
            return store

    def check_files(self) -> None:
        """Check every file with a digest in the metadata.

        Raises FileError if one is missing or damaged.
        """
        for file in self.digests:
            self._read_proven(file)

    def reseal(self, forget: Sequence[str] = (), **changes: Any) -> None:
        """Write the metadata again, with `changes`, and without the arrays in `forget`."""
        digests = {file: digest for file, digest in self.digests.items() if file.split("/")[0] not in forget}
        _write_atomically(self.path / ROOT_FILE, root_text(seal({**self.metadata, **changes}, digests)))

    @property
    def is_past(self) -> bool:
        """True if the map has changed since it was opened."""
        return self.moment != _fingerprint(self.path / ROOT_FILE)

    # ---- files -------------------------------------------------------------------------------------------------------

    def array(self, name: str) -> NDArray[Any]:
        """Read an array without tiles.

        Raises FileError if it is missing, damaged, or has a wrong shape or type.
        """
        layout = Layout.parse(json.loads(self._read_proven(f"{name}/{ROOT_FILE}")))
        # Check before reading, because a forged shape could request more memory than there is.
        self._check_kind(name, layout.shape, layout.dtype)
        with decoding_map(self.path / name):
            check_bytes(self.path / name, math.prod(layout.shape) * layout.dtype.itemsize, "unpacks to")
            whole = tuple(slice(0, n) for n in layout.shape)
            return layout.read(whole, lambda key: self._read_proven(f"{name}/{key}"))

    def _read_proven(self, file: str) -> bytes:
        """Read a file and check its digest from the metadata."""
        content = read_member(self.path, file, "part of a saved map")
        if content is None or file not in self.digests:
            raise map_error(self.path, f"its file {file!r} is missing")
        if hex_digest(content) != self.digests[file]:
            raise map_error(self.path, f"its file {file!r} differs from its digest")
        return content

    def _check_kind(self, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        """Refuse an array of a wrong shape or type."""
        dim, number = self.grid.dim, _chunk_shapes(self.metadata)["record"][-1]
        sizes = dict(zip(AXES, self.grid.shape, strict=False)) | {"slice": self.slices, "number": number}
        sizes |= {f"tile_{axis}": n for axis, n in zip(AXES, self.counts, strict=False)}
        sizes |= stored()[name].sizes
        sizes |= {"corner": 2 * dim + 1, "rotation": self.metadata["rotations"] or 1, "byte": shape[0] if shape else 0}
        needed = tuple(sizes[axis] for axis in axes_of(name, dim))
        if tuple(shape) != needed or dtype != stored()[name].dtype:
            problem = f"its array {name!r} is {dtype} {tuple(shape)}, not {stored()[name].dtype} {needed}"
            raise map_error(self.path, problem)

    def _check_layout(self, name: str) -> None:
        """Raise FileError if other software would read an array of tiles differently."""
        with decoding_map(self.path / name):
            layout = Layout.parse(json.loads(self._read_proven(f"{name}/{ROOT_FILE}")))
        self._check_kind(name, layout.shape, layout.dtype)
        shape, _, _ = self._chunk(name)
        if (layout.chunks, layout.compressor, layout.checksums) != (shape, "zstd", 0):
            raise map_error(self.path, f"its array {name!r} has other chunks than its tiles")

    def write(self, name: str, index: Sequence[int], block: NDArray[Any], aside: str = "") -> bytes:
        """Write a chunk and return its digest.

        A chunk at the end of the array may be smaller.

        Raises FileError if writing fails, for example on a full disk.
        """
        content = _encode(name, block, *self._chunk(name))
        _write_atomically(self.path / aside / _chunk_file(name, index), content)
        return binary_digest(content)

    def read(
        self, name: str, index: Sequence[int], digest: bytes | None, out: NDArray[Any] | None = None
    ) -> NDArray[Any]:
        """Read a whole chunk, and check its digest, if given.

        The chunk is read into `out` if it fits.

        Raises FileError if the chunk is missing or damaged.
        """
        file = _chunk_file(name, index)
        content = self._read_newest(file)
        if content is None:
            raise map_error(self.path, f"its file {file!r} is missing")
        if digest is not None and binary_digest(content) != digest:
            raise map_error(self.path, f"its file {file!r} differs from its digest")
        return self._decode(name, index, content, out)

    def _decode(self, name: str, index: Sequence[int], content: bytes, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Decompress a chunk of an array.

        It is written to ``out``, if the array fits.
        """
        file, (shape, dtype, _) = self.path / _chunk_file(name, index), self._chunk(name)
        with decoding_map(file):
            size = math.prod(shape) * dtype.itemsize
            check_bytes(file, size, "unpacks to")
            if out is not None and out.shape == shape and out.flags.c_contiguous:
                unpack(content, "zstd", size, out.reshape(-1).view(np.uint8))
                return out
            return unpack(content, "zstd", size).view(dtype).reshape(shape)

    def optional(self, name: str, index: Sequence[int]) -> NDArray[Any] | None:
        """Read a chunk that can be computed again.

        Returns None if it is missing or damaged.
        """
        try:
            return self.read(name, index, None)
        except FileError:
            return None

    def _read_newest(self, file: str) -> bytes | None:
        """Read the newest file of a name, or return None."""
        for folder in (self.metadata["aside"], "") if self.metadata["aside"] else ("",):
            if (content := read_member(self.path / folder, file, "part of a store of tiles")) is not None:
                return content
        return None

    def _chunk(self, name: str) -> tuple[tuple[int, ...], np.dtype[Any], Any]:
        """Return the shape, type and fill value of an array's chunks."""
        if name.startswith("labels"):
            return (*(1,) * self.grid.dim, self._label_width), np.dtype("<i4"), -1
        return _chunk_shapes(self.metadata)[name], np.dtype(stored()[name].dtype).newbyteorder("<"), stored()[name].lost

    @property
    def label_count(self) -> int:
        """Number of rotation cells with labels.

        It is one if there is a single slice.
        """
        return len(self.rotations) if self.slices > 1 else 1

    @property
    def _label_width(self) -> int:
        """Length of a chunk of labels.

        It holds a digest, then the cells on all faces of a tile for each rotation cell.
        """
        return LABEL_HEADER_LENGTH + self.label_count * sum(2 * math.prod(self.tile) // side for side in self.tile)

    # ---- tiles -------------------------------------------------------------------------------------------------------

    def write_tile(self, index: Index, blocks: Iterable[States], cells: Iterable[Bools], aside: str = "") -> Record:
        """Write a tile, its record last.

        `blocks` yields the states of each chunk. `cells` yields the outer cells and, unless they are equal, the inner
        cells. All arrays are clipped to the map, and each is used before the next is requested.
        """
        counts, digests = np.empty((self.slices, 3), dtype=np.int64), []
        for layer, block in enumerate(blocks):
            for number, states in zip(self.numbers(layer), block, strict=True):
                mixed, blocked = count_states(states.reshape(-1))
                counts[number] = states.size - mixed - blocked, mixed, blocked
            digests.append(self.write("cell_states", (layer, *index), block, aside))
        extent = np.array([[0, part.stop - part.start - 1] for part in self.cells(index)]).T
        for name, part in zip(("outer", "inner"), cells, strict=False):
            if name == "outer" and self.metadata["outside"] == "free":  # only a free exterior needs the box
                extent = _bounding_box(part)
            digests.append(self.write(name, index, part, aside))
        digests += digests[-1:] * (self.layers + 2 - len(digests))
        extent = extent + [part.start for part in self.cells(index)]
        row = np.concatenate([counts.ravel(), extent.ravel(), np.frombuffer(b"".join(digests), dtype="<i8")])
        row = np.concatenate([row, self._digest_row(index, row)])
        own_digest = self.write("record", (*index, 0), row.reshape(*(1,) * self.grid.dim, -1), aside)
        return Record(counts, extent, tuple(digests), own_digest)

    def known(self, index: Index) -> Record:
        """Read the record of a tile.

        Raises FileError if the tile is not done, or the record is damaged or that of another tile or map.
        """
        content = self._read_newest(_chunk_file("record", (*index, 0)))
        if content is None:
            raise map_error(self.path, f"its tile {index} is missing")
        row, digest = np.split(self._decode("record", (*index, 0), content).reshape(-1), [-_DIGEST_LENGTH])
        if not np.array_equal(digest, self._digest_row(index, row)):
            raise map_error(self.path, f"its record of tile {index} is damaged, or of another tile or map")
        counts, box, digests = np.split(row, [3 * self.slices, 3 * self.slices + 2 * self.grid.dim])
        parts = [part.tobytes() for part in digests.reshape(-1, _DIGEST_LENGTH)]
        return Record(counts.reshape(-1, 3), box.reshape(2, -1), tuple(parts), binary_digest(content))

    def _digest_row(self, index: Index, row: Ints) -> Ints:
        """Return the digest of a record with its tile and the settings of the map, as int64."""
        content = f"{self._settings_digest} {[int(i) for i in index]} ".encode() + row.astype("<i8").tobytes()
        return np.frombuffer(binary_digest(content), dtype="<i8")

    @cached_property
    def _settings_digest(self) -> str:
        """Digest of the metadata that no build and no update changes."""
        changing = {*NOT_DONE, "precision", "digests", "digest"}
        return hex_digest(_digest_text({key: value for key, value in self.metadata.items() if key not in changing}))

    def states(self, index: Index, layer: int, record: Record, out: States | None = None) -> States:
        """Read a chunk of states, shape (depth, *tile).

        Cells beyond the map are BLOCKED. Read into `out`, and return it, if it has that shape and is
        contiguous.
        """
        states: States = self.read("cell_states", (layer, *index), record.digests[layer], out)
        used = states[tuple(slice(0, len(part)) for part in (self.numbers(layer), *map(_range, self.cells(index))))]
        if used.max(initial=0) > BLOCKED:
            raise map_error(self.path, f"its tile {index} holds {used.max()}, but states are 0 to 2")
        return states if used.size == states.size else np.minimum(states, BLOCKED)

    def obstacles(self, index: Index, record: Record, out: Bools | None = None) -> tuple[Bools, Bools]:
        """Read the outer and inner cells of a tile.

        They are clipped to the map; outer cells are read into `out` if it fits.
        """
        own = tuple(slice(0, part.stop - part.start) for part in self.cells(index))
        outer = self.read("outer", index, record.digests[self.layers], out)[own]
        if self.metadata["same"]:
            return outer, outer
        return outer, self.read("inner", index, record.digests[self.layers + 1])[own]

    def obstacles_in(self, box: Box, known: RecordReader | None = None) -> tuple[Bools, Bools]:
        """Read the outer and inner cells in a box.

        The box may extend beyond the map; `known` may cache records.
        """
        outside = self.metadata["outside"] == "blocked"
        outer = np.full(tuple(part.stop - part.start for part in box), outside, dtype=np.bool_)
        inner = outer if self.metadata["same"] else outer.copy()
        for index in self.tiles_in(box):
            here, there = intersect_boxes(box, self.cells(index))
            own = self.obstacles(index, (known or self.known)(index), outer[here])
            outer[here] = own[0][there]
            if inner is not outer:
                inner[here] = own[1][there]
        return outer, inner

    def states_in(
        self, box: Box, known: RecordReader | None = None, table: Ints | None = None, packed: bool | None = None
    ) -> Stack:
        """Read the states of all slices in a box.

        Beyond the map they follow the `table` of an Exterior.
        """
        shape = tuple(part.stop - part.start for part in box)
        bits = PackedStates((self.slices, *shape)) if packed else None
        states = np.empty((0 if packed else self.slices, *shape), dtype=np.uint8)
        for layer in range(self.layers):
            numbers = self.numbers(layer)
            block = np.empty((len(numbers), *shape), dtype=np.uint8) if packed else states[numbers.start : numbers.stop]
            for row, part in zip([] if table is None else table[numbers.start : numbers.stop], block, strict=False):
                low, high = row[:-1].reshape(2, -1)
                part[...] = row[-1]
                if (low <= high).all():
                    mixed = zip(low, high, box, strict=True)
                    part[tuple(slice(max(0, a - b.start), max(0, z + 1 - b.start)) for a, z, b in mixed)] = MIXED
            for index in self.tiles_in(box):
                here, there = intersect_boxes(box, self.cells(index))
                place = block[(slice(None), *here)]
                own = self.states(index, layer, (known or self.known)(index), place)
                if own is not place:
                    place[...] = own[(slice(0, len(numbers)), *there)]
            if bits is not None:
                for number, part in zip(numbers, block, strict=True):
                    bits.write(number, part)
        return bits or states

    def states_at(self, number: int) -> States:
        """Read the states of one slice."""
        states, layer = np.empty(self.grid.shape, dtype=np.uint8), number // self.depth
        for index in self:
            chunk = self.states(index, layer, self.known(index))
            box = self.cells(index)
            states[box] = chunk[number % self.depth][tuple(slice(0, part.stop - part.start) for part in box)]
        return states

    def contents(self) -> Contents:
        """Read the whole map.

        Raises FileError if a tile is not done, a file is missing or damaged, or the files describe no map.
        """
        with making_map(self.path):
            return self._contents()

    def _contents(self) -> Contents:
        """Read the whole map into memory.

        Raises an error if it is unfinished or damaged.
        """
        if not self.is_done:
            raise unfinished_map_error(self.path, self.share_done)
        for name in TILED:
            if name in self.names:
                self._check_layout(name)
        records = {index: self.known(index) for index in self}
        if any(self.metadata[key] != value for key, value in self.totals(records.__getitem__).items()):
            raise map_error(self.path, "its records differ from their digest")
        arrays = {name: self.array(name) for name in self.names.difference(TILED, ("shapes",))}
        box = tuple(slice(0, n) for n in self.grid.shape)
        check_bytes(self.path / "cell_states", self.slices * math.prod(self.grid.shape) // 1, "unpacks to")
        outer, inner = self.obstacles_in(box, records.__getitem__)
        source, unknown = self.metadata["workspace_source"], arrays.get("unknown")
        return Contents(
            Workspace(self.grid, outer, inner, source=source, unknown=unknown, shapes=self.shapes),
            self.robot,
            self.rotations,
            self.slice_of,
            np.asarray(self.states_in(box, records.__getitem__, packed=False)),
            str(self.metadata["outside"]),
            float(self.metadata["margin"]),
            str(self.metadata["precision"]),
            arrays.get("overlap_counts"),
            Exterior(arrays["exterior"]) if "exterior" in arrays else None,
            self.proves_blocked,
        )

    def done(self) -> list[Index]:
        """Return the indices of the tiles that are done."""
        folder = self.path / "record" / "c"
        return [index for index in self if (folder / "/".join(map(str, (*index, 0)))).exists()]

    @property
    def share_done(self) -> float:
        """Share of finished tiles, below 1 until all are done."""
        return 1.0 if self.is_done else min(len(self.done()) / len(self), 1.0 - 2.0**-20)

    def totals(self, known: RecordReader | None = None) -> dict[str, Any]:
        """Combine the records of all tiles.

        Returns the counts of each slice, the box of all obstacles, and one digest.

        Raises FileError if a tile is not done.
        """
        counts, digest = np.zeros((self.slices, 3), dtype=np.int64), hashlib.sha256()
        low, high = np.full(self.grid.dim, 2**61), np.full(self.grid.dim, -(2**61))
        for index in self:
            record = (known or self.known)(index)
            counts += record.counts
            low, high = np.minimum(low, record.box[0]), np.maximum(high, record.box[1])
            digest.update(record.own_digest)
        box = [low, high] if (low <= high).all() else [low * 0, low * 0 - 1]
        return {
            "counts": counts.tolist(),
            "box": [corner.tolist() for corner in box],
            "records": digest.hexdigest(),
        }

    def add_labels(self) -> None:
        """Describe the arrays of component labels to software that reads Zarr."""
        shape = (*self.counts, self._label_width)
        for kind, what in enumerate(("FREE cells", "cells that are not BLOCKED")):
            name, about = f"labels_{kind}", f"components of {what} within a tile, of the cells on its faces"
            if not (self.path / name / ROOT_FILE).exists():
                attributes = {"long_name": about, "comment": _LABELS_COMMENT}
                _write_atomically(
                    self.path / name / ROOT_FILE, _describe_array(name, shape, *self._chunk(name), attributes)
                )

    # ---- changes -----------------------------------------------------------------------------------------------------

    def commit(self, aside: str, **changes: Any) -> Store:
        """Commit the files in the folder `aside`; return the new store.

        They replace files of the same names. Data that the change invalidates are removed, such as the
        obstacles as shapes and the exterior.
        """
        invalid = ("shapes", "unknown", "exterior", *UNTILED)
        self.reseal(invalid, version=self.metadata["version"] + 1, aside=aside, **changes)
        for name in invalid:
            shutil.rmtree(self.path / name, ignore_errors=True)
        return Store.open(self.path).settled()

    def settled(self) -> Store:
        """Move the files of a committed change into place.

        Returns the resulting store.
        """
        aside = self.metadata["aside"]
        if not aside:
            return self
        for file in sorted((self.path / aside).rglob("*")):
            if file.is_file():
                target = self.path / file.relative_to(self.path / aside)
                target.parent.mkdir(parents=True, exist_ok=True)
                with suppress(FileNotFoundError):  # another process has moved the file
                    file.replace(target)
        self.reseal(aside="")
        shutil.rmtree(self.path / aside, ignore_errors=True)
        return Store.open(self.path)

    def tidy(self) -> None:
        """Remove temporary files of killed processes; no other process may be writing."""
        for file in self.path.rglob(f"{_ASIDE_PREFIX}*"):
            if file.name != self.metadata["aside"]:
                shutil.rmtree(file, ignore_errors=True) if file.is_dir() else file.unlink(missing_ok=True)


def _check_names(store: Store) -> None:
    """Refuse a store that lacks an array or holds an unknown one."""
    inner = () if store.metadata["same"] else ("inner",)
    required = ("cell_states", "outer", *inner, "record", "slice_of", *AXES[: store.grid.dim], *turns_of(store.names))
    missing = [name for name in required if name not in store.names]
    if missing:
        raise map_error(store.path, f"it holds no {' and no '.join(missing)}")
    unknown = sorted(store.names.difference(stored()))
    if unknown:
        raise map_error(store.path, f"it holds {', '.join(unknown)}, which no map does")


def aside_name() -> str:
    """Return a fresh name for a file or folder in progress."""
    return f"{_ASIDE_PREFIX}{uuid.uuid4().hex[:12]}"


def _fingerprint(root: Path) -> tuple[int, int, int]:
    status = root.stat()
    return status.st_ino, status.st_mtime_ns, status.st_size


def _range(part: slice) -> range:
    return range(part.start, part.stop)


def _chunk_file(array: str, index: Sequence[int]) -> str:
    """Return the path of a chunk's file in the store."""
    return f"{array}/c/{'/'.join(map(str, index))}"


def _encode(name: str, block: NDArray[Any], shape: tuple[int, ...], dtype: np.dtype[Any], lost: Any) -> bytes:
    """Encode a chunk, padded at the end of an array.

    Chunks with a digest in a record get no checksum, which would double the time.
    """
    from numcodecs import Zstd

    if block.shape != shape:
        whole = np.full(shape, lost, dtype=dtype)
        whole[tuple(slice(0, n) for n in block.shape)] = block
        block = whole
    return bytes(Zstd(ZSTD_LEVEL, checksum=name not in DIGESTED).encode(np.ascontiguousarray(block, dtype=dtype)))


def _describe_array(
    name: str,
    shape: tuple[int, ...],
    chunks: tuple[int, ...],
    dtype: np.dtype[Any],
    lost: Any,
    about: Mapping[str, Any],
    axes: Sequence[str] | None = None,
) -> bytes:
    """Return the metadata of an array in Zarr version 3."""
    special = {"nan": "NaN", "inf": "Infinity"}
    document = {
        "zarr_format": 3,
        "node_type": "array",
        "shape": shape,
        "data_type": dtype.name,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunks}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": special.get(str(lost), lost),
        "codecs": [
            {"name": "bytes", "configuration": {"endian": "little"}},
            {"name": "zstd", "configuration": {"level": ZSTD_LEVEL, "checksum": name not in DIGESTED}},
        ],
        "attributes": about,
        **({"dimension_names": axes} if axes else {}),
    }
    return json.dumps(document, indent=2).encode()


def _write_atomically(file: Path, content: bytes) -> None:
    """Write a file atomically."""
    temporary = file.with_name(aside_name())
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(content)
        temporary.replace(file)
    except OSError as error:
        problem = f"cannot be written: {error.strerror or error}"
        rule, hint = "a store needs a writable folder and free space", "free some space, then run the same again"
        raise FileError(str(file), problem, rule, hint) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _chunk_shapes(metadata: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """Return the chunk shape of each array with tiles."""
    tile, slices, depth = tuple(metadata["tile"]), metadata["slices"], metadata["depth"]
    columns = 3 * slices + 2 * len(tile) + _DIGEST_LENGTH * (-(-slices // depth) + 3)
    return {"cell_states": (depth, *tile), "outer": tile, "inner": tile, "record": (*(1,) * len(tile), columns)}


def _iterate_files(metadata: Mapping[str, Any], arrays: Mapping[str, Any]) -> Iterator[tuple[str, bytes]]:
    """Yield the files of a store without tiles.

    Yields name and content of each file except the root file.
    """
    grid = grid_of(metadata)
    chunks = {name: side for name, side in _chunk_shapes(metadata).items() if name != "inner" or not metadata["same"]}
    counts = (-(-n // t) for n, t in zip(grid.shape, metadata["tile"], strict=True))
    shapes = dict.fromkeys(chunks, grid.shape)
    shapes |= {"cell_states": (metadata["slices"], *grid.shape), "record": (*counts, chunks["record"][-1])}
    for name, array in arrays.items():
        size, is_stack = array.itemsize, stored()[name].axes[0] == "slice" and array.ndim > 2
        shapes[name] = array.shape
        chunks[name] = (1, *fit_tile(array.shape[1:], size)) if is_stack else fit_tile(array.shape, size)
    for name, shape in shapes.items():
        dtype, lost = np.dtype(stored()[name].dtype).newbyteorder("<"), stored()[name].lost
        about, axes = attributes_of(name, grid), axes_of(name, grid.dim)
        yield f"{name}/{ROOT_FILE}", _describe_array(name, shape, chunks[name], dtype, lost, about, axes)
        if name in arrays:
            for index in itertools.product(*(range(-(-n // c)) for n, c in zip(shape, chunks[name], strict=True))):
                box = tuple(slice(i * c, (i + 1) * c) for i, c in zip(index, chunks[name], strict=True))
                yield _chunk_file(name, index), _encode(name, arrays[name][box], chunks[name], dtype, lost)


# ---- whole maps ------------------------------------------------------------------------------------------------------


def save(contents: Contents, path: StrPath, overwrite: bool = False) -> None:
    """Save a map as a store of one tile.

    :func:`cspace.open` and ``xarray.open_zarr`` can read it. Slices of more than 2^28 cells are split into several
    tiles.

    Parameters
    ----------
    contents : Contents
    path : path-like
        A Zarr folder; the name ends in ``.zarr`` or has no suffix.
    overwrite : bool
        True to replace an existing map; other folders are never replaced.

    Raises
    ------
    InputError
        If the name has another suffix.
    FileError
        If the output exists and may not be replaced, or cannot be written.
    """
    check_suffix(path, MAP_SUFFIXES, "a map is saved as a Zarr folder; space.export writes other formats")
    arrays, workspace = arrays_of(contents), contents.workspace
    tile = fit_tile(contents.grid.shape)
    settings = {
        "tile": list(tile),
        "depth": max(1, min(len(contents.states), SAVED_CHUNK_CELLS // math.prod(tile))),
        "same": workspace.inner is workspace.outer,
        "method": "auto",
        "stamp": CellsInMemory(workspace.outer, workspace.inner).stamp,
    }
    states, cells = arrays["cell_states"], [arrays[name] for name in ("outer", "inner") if name in arrays]
    untiled = {name: array for name, array in arrays.items() if name not in TILED}
    with replacing(path, overwrite, folder=_is_map_folder) as temporary:
        store = Store.create(temporary, metadata_of(contents) | settings, untiled)
        for index in store:
            box = store.cells(index)
            blocks = (_copy_block(states, store.numbers(layer), box) for layer in range(store.layers))
            store.write_tile(index, blocks, (part[box] for part in cells))
        store.reseal(**store.totals())


def _copy_block(states: Stack, numbers: range, box: Box) -> States:
    """Return the states of some slices in a box.

    Cells are copied only if several slices are packed.
    """
    if len(numbers) == 1:
        return states[numbers[0]][box][None]
    return states[numbers.start : numbers.stop][(slice(None), *box)]


def fit_tile(sides: Sequence[int], itemsize: int = 1) -> tuple[int, ...]:
    """Halve the longest side until a chunk fits the limit."""
    tile = list(sides)
    while itemsize * math.prod(tile) > MAX_CHUNK_BYTES:
        longest = int(np.argmax(tile))
        tile[longest] = -(-tile[longest] // 2)
    return tuple(tile)
