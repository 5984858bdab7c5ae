"""Stored maps: a folder in the Zarr format with the states of a map, tile by tile; a saved map is a store of one tile.

``cell_states`` has chunks of one tile and some slices, ``outer`` and, if it differs, ``inner`` chunks of one tile.
``record``
has a row of numbers for each tile: the counts of its states, the box around its obstacles, and the digests (SHA-256) of
its other chunks. A row is written last: a tile is done once its row is there. All other arrays are written at once, and
the metadata of the folder hold a digest of each of their files, of all rows together, and of themselves.

Zarr reads a missing chunk as the fill value, without an error. So no fill value is a state or a free cell, every chunk
is written, and a chunk is used only if it agrees with its digest.

Each file is written under another name beside its own, and renamed. An update writes its files into a folder of their
own and names that folder in the metadata, which is when it takes place; then it moves them over the files that they
replace. A reader looks into that folder first, so that it finds the old map or the new one at any moment.
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
from cspace.arrays import BLOCKED, FIELD_NAMES, MIXED, Bools, Box, Ints, States, StrPath, intersect_boxes
from cspace.compiling import kernel
from cspace.errors import CspaceError, FileError
from cspace.files.access import check_suffix, decoding, read_bytes, read_member, replacing
from cspace.files.chunks import MAX_CHUNK_BYTES, Layout, unpack
from cspace.files.plain import read_json
from cspace.grid import Grid
from cspace.limits import check_bytes, is_packed
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
from cspace.obstacles import Held
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.shapes import Shape
from cspace.workspace import Workspace

_OLD_FORMATS: Final = (FORMAT, "cspace-tiles")
"""Names of the format in this version and earlier ones."""

ROOT: Final = "zarr.json"

DIGESTED: Final = ("cell_states", "outer", "inner")
"""Arrays whose chunks have their digests in the records of tiles."""

TILED: Final = (*DIGESTED, "record")
"""Arrays with one chunk, or several, for each tile."""

UNTILED: Final = ("overlap_counts", *FIELD_NAMES)
"""Arrays that only a map in memory holds."""

MAP_SUFFIXES: Final = (".zarr", "")
"""Suffixes of stored maps."""

CHUNK_CELLS: Final = 2**24
"""States in a chunk of a map that is built tile by tile, at most, unless one slice of a tile has more."""

SAVED_CHUNK_CELLS: Final = 2**20
"""States in a chunk of a saved map, at most, unless one slice has more; fewer, so that one slice is read quickly."""

LEVEL: Final = 1
"""Level of zstd: higher ones take more time and save little; slices of turned robots even grow."""

LABEL_MARK: Final = 8
"""Numbers of 32 bits before the labels of a tile: the digest of what they were made from."""

_DIGEST: Final = 4
"""Numbers of 64 bits in a digest."""

_ASIDE: Final = ".cspace-"
"""Beginning of the names of files that are not in their places yet."""

_ROUNDING: Final = 1e-12
"""Difference of rotation cells between machines, at most; proofs have far more to spare."""

_WHOLE: Final = (
    "a stored map is read only if it is complete and unchanged",
    "copy it again from where it is whole, or build it again",
)
_LABELS: Final = (
    "eight numbers that tell what it was made from; then, for each axis, the near face and the far one, over the "
    "rotation cells; -1 where a cell has none"
)
_KEYS: Final = (
    *("format", "format_version", "library_version", "lower", "spacing", "shape", "outside", "margin", "precision"),
    *("rotations", "slices", "robot", "workspace_source"),
    *("tile", "depth", "same", "method", "stamp", "version", "aside", "box", "counts", "records"),
)

NOT_DONE: Final[Mapping[str, Any]] = {"version": 0, "aside": "", "box": None, "counts": None, "records": None}
"""Metadata of a store without any tile."""

_ONES: Final = np.uint64(0x0101010101010101)

Index = tuple[int, ...]
"""Index of a tile along each axis."""


# ---- digests and errors ----------------------------------------------------------------------------------------------


def unusable(path: StrPath, what: str) -> FileError:
    """Return the error for a stored map that cannot be trusted."""
    return FileError(str(Path(path)), f"is not a usable map: {what}", *_WHOLE)


def not_done(path: StrPath, share: float) -> FileError:
    """Return the error for a map of which not all tiles are done."""
    rule, hint = "a map is read once all of it is there", "run the same build again: only what is missing is done"
    return FileError(str(path), f"is {share:.1%} done", rule, hint)


def decoding_map(path: StrPath) -> AbstractContextManager[None]:
    """Turn every exception of the decoders of a damaged map into one error for the map."""
    return decoding(path, "usable map", *_WHOLE)


@contextmanager
def making_map(path: StrPath) -> Iterator[None]:
    """Turn every exception that files raise which are whole, but describe no map, into one error for the map."""
    try:
        yield
    except (FileError, MemoryError, UserWarning):  # a warning of ours may be an error to its caller
        raise
    except Exception as error:  # what agrees with its digests may still be anything, and meets several libraries
        reason = f"{type(error).__name__}: {' '.join(str(error).split()):.200}"
        raise unusable(path, f"its parts make no map ({reason})") from error


def digest_of(content: bytes | memoryview) -> str:
    """Digest of bytes (SHA-256)."""
    return hashlib.sha256(content).hexdigest()


def digest_of_bytes(content: bytes) -> bytes:
    """Digest of a chunk (SHA-256)."""
    return hashlib.sha256(content).digest()


def seal(metadata: Mapping[str, Any], digests: Mapping[str, str]) -> dict[str, Any]:
    """Return metadata with the digest of each file, and a digest of all of this."""
    sealed = {**metadata, "digests": " ".join(f"{name}:{digest}" for name, digest in digests.items())}
    return {**sealed, "digest": digest_of(_text(sealed))}


def _text(metadata: Mapping[str, Any]) -> bytes:
    """Return the text that the digest of the metadata is made from."""
    return json.dumps({key: value for key, value in metadata.items() if key != "digest"}, sort_keys=True).encode()


def _unseal(metadata: Any, path: StrPath) -> dict[str, str]:
    """Return the digest of each file, from metadata that :func:`seal` made.

    Raises FileError if the metadata were changed, or are of another version of the format.
    """
    if not isinstance(metadata, Mapping) or metadata.get("format") not in _OLD_FORMATS:
        raise unusable(path, f"its metadata do not say format {FORMAT!r}")
    if (metadata["format"], metadata.get("format_version")) != (FORMAT, VERSION):
        raise FileError(
            os.fspath(path),
            f"has format version {metadata.get('format_version')!r}",
            f"cspace {__version__} reads version {VERSION} only",
            f"build it again, or open it with the version that wrote it ({metadata.get('library_version', 'unknown')})",
        )
    missing = [key for key in (*_KEYS, "digests", "digest") if key not in metadata]
    if missing:
        raise unusable(path, f"its metadata lack {', '.join(missing)}")
    if metadata["digest"] != digest_of(_text(metadata)):
        raise unusable(path, "its metadata differ from their digest")
    return dict(entry.rsplit(":", 1) for entry in metadata["digests"].split())


def root_text(metadata: Mapping[str, Any]) -> bytes:
    """Return the content of the root's file, which has one form only."""
    return json.dumps({"attributes": metadata, "zarr_format": 3, "node_type": "group"}, indent=2).encode()


def read_metadata(path: StrPath) -> dict[str, Any]:
    """Read the metadata of a stored map, unchecked.

    Raises FileError if they cannot be read.
    """
    return dict(read_json(Path(path, ROOT), "saved map")["attributes"])


def is_store(path: StrPath) -> bool:
    """Return whether a folder is a stored map, whole or half done, of any version."""
    try:
        return read_metadata(path)["format"] in _OLD_FORMATS
    except (CspaceError, KeyError, TypeError, ValueError):
        return False


def _is_ours(folder: Path) -> bool:
    """Return whether a folder holds only a map, whole or damaged, of this version or an earlier one."""
    parts = {ROOT, "c"}
    known = {*stored(), "labels_0", "labels_1", "geometry", "vertices", "faces", "centers", "radii"}
    return all(
        (entry.name == ROOT and entry.is_file())
        or (entry.name in known and entry.is_dir() and {part.name for part in entry.iterdir()} <= parts)
        or entry.name.startswith(_ASIDE)
        for entry in folder.iterdir()
    )


# ---- tiles -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Record:
    """What is known of a tile that is done.

    Attributes
    ----------
    counts : ndarray of int64, shape (slices, 3)
        Number of FREE, MIXED and BLOCKED cells.
    box : ndarray of int64, shape (2, d)
        First and last cell, of the whole map, of the box around the outer cells; the first is beyond the last if there
        are none. All of the tile unless outside of the map is free.
    digests : tuple of bytes
        Digests of its chunks of states, of the outer cells, and of the inner ones, or again of the outer ones.
    own_digest : bytes
        Digest of the chunk of ``record`` that holds all of this.
    """

    counts: Ints
    box: Ints
    digests: tuple[bytes, ...]
    own_digest: bytes

    @property
    def mark(self) -> bytes:
        """A digest of the chunks of the tile: different chunks have different marks."""
        return digest_of_bytes(b"".join(self.digests))


Known = Callable[[Index], Record]
"""Gives the record of a tile that is done."""


@kernel
def tally(states: NDArray[np.uint8]) -> tuple[int, int]:
    """Count the MIXED and the BLOCKED states."""
    mixed, blocked = 0, 0
    eights = states[: len(states) // 8 * 8].view(np.uint64)
    for first in range(0, len(eights), 255):  # as often as a byte can count
        ones, twos = np.uint64(0), np.uint64(0)
        for word in eights[first : first + 255]:
            ones += word & _ONES
            twos += (word >> np.uint64(1)) & _ONES
        for shift in range(0, 64, 8):
            mixed += int((ones >> np.uint64(shift)) & np.uint64(255))
            blocked += int((twos >> np.uint64(shift)) & np.uint64(255))
    for k in range(8 * len(eights), len(states)):
        mixed += states[k] == MIXED
        blocked += states[k] == BLOCKED
    return mixed, blocked


def _extent(cells: Bools) -> Ints:
    """Return the first and last cell, shape (2, d), of the box around set cells; far apart the wrong way if none is."""
    used = [
        np.flatnonzero(cells.any(axis=tuple(a for a in range(cells.ndim) if a != axis))) for axis in range(cells.ndim)
    ]
    if not len(used[0]):
        return np.array([[2**62] * cells.ndim, [-(2**62)] * cells.ndim]) // 2
    return np.array([[part[0] for part in used], [part[-1] for part in used]])


# ---- the store -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Store:
    """A stored map, as of one moment; several processes read and write it at once.

    Attributes
    ----------
    path : Path
    metadata : dict
        Those of :func:`metadata_of`, and ``tile``, the cells of a tile along each axis, ``depth``, the slices of a
        chunk, ``same``, whether inner cells are the outer ones, ``method``, the engine of the build, ``stamp``, of the
        workspace, ``version``, the number of updates, ``aside``, a folder of newer files, and, once all tiles are done,
        ``counts`` of each slice, ``box`` around all obstacles, and ``records``, the digest of all records.
    digests : dict
        Digest of each file of the arrays without tiles, and of each description of an array.
    moment : tuple
        Differs after any change of the map.
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

    @cached_property
    def robot(self) -> Robot:
        """Robot that the map was built for."""
        return Robot.from_spec(json.loads(self.metadata["robot"]))

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of its arrays."""
        return frozenset(file.split("/")[0] for file in self.digests)

    @cached_property
    def rotations(self) -> Rotations:
        """Rotation cells of the map."""
        return Rotations.from_coordinates({name: self.array(name) for name in turns_of(self.names)})

    @cached_property
    def slice_of(self) -> Ints:
        """The slice of each rotation cell.

        Raises ValueError if the store holds other rotation cells, or others that share a slice.
        """
        slice_of = self.rotations.slices_for(self.robot.shape)
        for name, needed in ({"slice_of": slice_of} | self.rotations.coordinates).items():
            if not np.allclose(self.array(name), needed, rtol=0.0, atol=_ROUNDING):
                raise ValueError(f"its array {name!r} is not that of its rotation cells and its robot")
        return slice_of

    @cached_property
    def shapes(self) -> tuple[Shape, ...] | None:
        """The obstacles, if they are known as shapes; no longer after an update."""
        with decoding_map(self.path):
            return shapes_from(self.array("shapes")) if "shapes" in self.names else None

    @property
    def proves_blocked(self) -> bool | None:
        """Whether BLOCKED is proven; None if that is not known."""
        return bool(self.metadata["inner"]) if "inner" in self.metadata else None

    @property
    def is_done(self) -> bool:
        """Whether all tiles are done."""
        return self.metadata["box"] is not None

    @property
    def tile(self) -> tuple[int, ...]:
        """Cells of a tile along each axis."""
        return tuple(self.metadata["tile"])

    @property
    def slices(self) -> int:
        """Number of slices."""
        return int(self.metadata["slices"])

    @property
    def depth(self) -> int:
        """Slices in a chunk of states."""
        return int(self.metadata["depth"])

    @cached_property
    def layers(self) -> int:
        """Chunks of states that a tile has."""
        return -(-self.slices // self.depth)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of tiles along each axis."""
        return tuple(-(-n // t) for n, t in zip(self.grid.shape, self.tile, strict=True))

    def __iter__(self) -> Iterator[Index]:
        """Iterate over the indices of all tiles."""
        return itertools.product(*map(range, self.counts))

    def __len__(self) -> int:
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
        """Iterate over the tiles that share a cell with a box, which may reach beyond the grid."""
        cut = [
            (max(part.start, 0), min(part.stop, n), t)
            for part, n, t in zip(box, self.grid.shape, self.tile, strict=True)
        ]
        spans = [range(first // t, -(-stop // t)) if first < stop else range(0) for first, stop, t in cut]
        return itertools.product(*spans)

    # ---- made and opened ---------------------------------------------------------------------------------------------

    @classmethod
    def create(cls, folder: StrPath, metadata: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Store:
        """Write a store without any tile; ``arrays`` are those without tiles.

        Raises FileError if nothing can be written.
        """
        # Global "coordinates" tell readers of the CF conventions which arrays label others.
        metadata = {**metadata, **NOT_DONE, "coordinates": " ".join((*turns_of(arrays), "slice_of"))}
        digests = {}
        for name, content in _files_of(metadata, arrays):
            digests[name] = digest_of(content)
            file = Path(folder, name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        Path(folder, ROOT).write_bytes(root_text(seal(metadata, digests)))
        return cls.open(folder)

    @classmethod
    def open(cls, path: StrPath) -> Store:
        """Open the store at a path, whatever is done of it; only its rotation cells are read and checked.

        Raises FileError if there is none, or it was changed, or is of an earlier version.
        """
        root = Path(path) / ROOT
        if not root.exists():
            raise unusable(path, f"it holds no {ROOT}")
        with making_map(path):
            moment = _moment(root)
            content = read_bytes(root, "saved map", memory=8.0)
            metadata = json.loads(content)["attributes"]
            store = cls(Path(path), metadata, _unseal(metadata, path), moment)
            if content != root_text(metadata):
                raise unusable(path, f"its {ROOT} was changed")
            aside = metadata["aside"]
            if aside and (aside.strip("/.") != aside[1:] or "/" in aside):
                raise unusable(path, f"its newer files are in {aside!r}")
            if min(*store.tile, store.depth, store.slices) < 1:
                raise unusable(path, "its tiles hold nothing")
            _check_names(store)
            _ = store.slice_of
            return store

    def check_files(self) -> None:
        """Check every file that has a digest in the metadata.

        Raises FileError if one is missing or damaged.
        """
        for file in self.digests:
            self._proven(file)

    def reseal(self, forget: Sequence[str] = (), **changes: Any) -> None:
        """Write the metadata anew, with some changed, and without the arrays to ``forget``."""
        digests = {file: digest for file, digest in self.digests.items() if file.split("/")[0] not in forget}
        _write(self.path / ROOT, root_text(seal({**self.metadata, **changes}, digests)))

    @property
    def is_past(self) -> bool:
        """Whether the map has changed since it was opened."""
        return self.moment != _moment(self.path / ROOT)

    # ---- files -------------------------------------------------------------------------------------------------------

    def array(self, name: str) -> NDArray[Any]:
        """Read an array without tiles.

        Raises FileError if it is missing, damaged, or not what a map holds.
        """
        layout = Layout.parse(json.loads(self._proven(f"{name}/{ROOT}")))
        # Before reading: a forged shape could ask for more memory than there is.
        self._check_kind(name, layout.shape, layout.dtype)
        with decoding_map(self.path / name):
            check_bytes(self.path / name, math.prod(layout.shape) * layout.dtype.itemsize, "unpacks to")
            whole = tuple(slice(0, n) for n in layout.shape)
            return layout.read(whole, lambda key: self._proven(f"{name}/{key}"))

    def _proven(self, file: str) -> bytes:
        """Read a file that has its digest in the metadata."""
        content = read_member(self.path, file, "part of a saved map")
        if content is None or file not in self.digests:
            raise unusable(self.path, f"its file {file!r} is missing")
        if digest_of(content) != self.digests[file]:
            raise unusable(self.path, f"its file {file!r} differs from its digest")
        return content

    def _check_kind(self, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        """Raise FileError for an array of another shape or type than the map needs."""
        dim, number = self.grid.dim, self._columns
        sizes = dict(zip(AXES, self.grid.shape, strict=False)) | {"slice": self.slices, "number": number}
        sizes |= {f"tile_{axis}": n for axis, n in zip(AXES, self.counts, strict=False)}
        sizes |= stored()[name].sizes
        sizes |= {"corner": 2 * dim + 1, "rotation": self.metadata["rotations"] or 1, "byte": shape[0] if shape else 0}
        needed = tuple(sizes[axis] for axis in axes_of(name, dim))
        if tuple(shape) != needed or dtype != stored()[name].dtype:
            given = f"{dtype} {tuple(shape)}"
            raise unusable(self.path, f"its array {name!r} is {given} where {stored()[name].dtype} {needed} is needed")

    def _check_layout(self, name: str) -> None:
        """Raise FileError if other software would find another array of tiles than this store."""
        with decoding_map(self.path / name):
            layout = Layout.parse(json.loads(self._proven(f"{name}/{ROOT}")))
        self._check_kind(name, layout.shape, layout.dtype)
        shape, _, _ = self._chunk(name)
        if (layout.chunks, layout.compressor, layout.checksums) != (shape, "zstd", 0):
            raise unusable(self.path, f"its array {name!r} has other chunks than its tiles")

    def write(self, name: str, index: Sequence[int], block: NDArray[Any], aside: str = "") -> bytes:
        """Write a chunk, without the part beyond the array, and return its digest.

        Raises FileError if it cannot be written, for example on a full disk.
        """
        content = _encoded(name, block, *self._chunk(name))
        _write(self.path / aside / _name(name, index), content)
        return digest_of_bytes(content)

    def read(
        self, name: str, index: Sequence[int], digest: bytes | None, out: NDArray[Any] | None = None
    ) -> NDArray[Any]:
        """Read a whole chunk, which must have a digest if one is given; into ``out``, if that can hold it.

        Raises FileError if it is missing or damaged.
        """
        file = _name(name, index)
        content = self._content(file)
        if content is None:
            raise unusable(self.path, f"its file {file!r} is missing")
        if digest is not None and digest_of_bytes(content) != digest:
            raise unusable(self.path, f"its file {file!r} differs from its digest")
        return self._decoded(name, index, content, out)

    def _decoded(
        self, name: str, index: Sequence[int], content: bytes, out: NDArray[Any] | None = None
    ) -> NDArray[Any]:
        file, (shape, dtype, _) = self.path / _name(name, index), self._chunk(name)
        with decoding_map(file):
            size = math.prod(shape) * dtype.itemsize
            check_bytes(file, size, "unpacks to")
            if out is not None and out.shape == shape and out.flags.c_contiguous:
                unpack(content, "zstd", size, out.reshape(-1).view(np.uint8))
                return out
            return unpack(content, "zstd", size).view(dtype).reshape(shape)

    def optional(self, name: str, index: Sequence[int]) -> NDArray[Any] | None:
        """Read a chunk of what is made again if it is missing or damaged."""
        try:
            return self.read(name, index, None)
        except FileError:
            return None

    def _content(self, file: str) -> bytes | None:
        """Read the newest file of a name; None if there is none."""
        for folder in (self.metadata["aside"], "") if self.metadata["aside"] else ("",):
            if (content := read_member(self.path / folder, file, "part of a store of tiles")) is not None:
                return content
        return None

    def _chunk(self, name: str) -> tuple[tuple[int, ...], np.dtype[Any], Any]:
        """Shape, type and filling of an array's chunks."""
        if name.startswith("labels"):
            return (*(1,) * self.grid.dim, self._label_width), np.dtype("<i4"), -1
        return _chunks_of(self.metadata)[name], np.dtype(stored()[name].dtype).newbyteorder("<"), stored()[name].lost

    @property
    def _columns(self) -> int:
        """Numbers in a record."""
        return 3 * self.slices + 2 * self.grid.dim + _DIGEST * (self.layers + 2)

    @property
    def label_count(self) -> int:
        """Rotation cells that are labelled: one if there is a single slice."""
        return self.rotations.count if self.slices > 1 else 1

    @property
    def _label_width(self) -> int:
        """Numbers in a chunk of labels: a digest, and those of the cells on all faces of a tile, over rotations."""
        return LABEL_MARK + self.label_count * sum(2 * math.prod(self.tile) // side for side in self.tile)

    # ---- tiles -------------------------------------------------------------------------------------------------------

    def write_tile(self, index: Index, blocks: Iterable[States], cells: Iterable[Bools], aside: str = "") -> Record:
        """Write a tile, its record last; all arrays are cut to the map.

        ``blocks`` gives the states of each chunk, and ``cells`` the outer cells and, unless they are the same, the
        inner ones; each array is used before the next one is asked for.
        """
        counts, digests = np.empty((self.slices, 3), dtype=np.int64), []
        for layer, block in enumerate(blocks):
            for number, states in zip(self.numbers(layer), block, strict=True):
                mixed, blocked = tally(states.reshape(-1))
                counts[number] = states.size - mixed - blocked, mixed, blocked
            digests.append(self.write("cell_states", (layer, *index), block, aside))
        extent = np.array([[0, part.stop - part.start - 1] for part in self.cells(index)]).T
        for name, part in zip(("outer", "inner"), cells, strict=False):
            if name == "outer" and self.metadata["outside"] == "free":  # the only one that asks for it
                extent = _extent(part)
            digests.append(self.write(name, index, part, aside))
        digests += digests[-1:] * (self.layers + 2 - len(digests))
        extent = extent + [part.start for part in self.cells(index)]
        row = np.concatenate([counts.ravel(), extent.ravel(), np.frombuffer(b"".join(digests), dtype="<i8")])
        own_digest = self.write("record", (*index, 0), row.reshape(*(1,) * self.grid.dim, -1), aside)
        return Record(counts, extent, tuple(digests), own_digest)

    def known(self, index: Index) -> Record:
        """Return the record of a tile.

        Raises FileError if the tile is not done.
        """
        content = self._content(_name("record", (*index, 0)))
        if content is None:
            raise unusable(self.path, f"its tile {index} is missing")
        row = self._decoded("record", (*index, 0), content).reshape(-1)
        counts, box, digests = np.split(row, [3 * self.slices, 3 * self.slices + 2 * self.grid.dim])
        parts = [part.tobytes() for part in digests.reshape(-1, _DIGEST)]
        return Record(counts.reshape(-1, 3), box.reshape(2, -1), tuple(parts), digest_of_bytes(content))

    def states(self, index: Index, layer: int, record: Record, out: States | None = None) -> States:
        """Read a chunk of states, shape (depth, *tile); cells beyond the map are BLOCKED.

        Read into ``out``, and return it, if it has that shape and is contiguous.
        """
        states: States = self.read("cell_states", (layer, *index), record.digests[layer], out)
        used = states[tuple(slice(0, len(part)) for part in (self.numbers(layer), *map(_range, self.cells(index))))]
        if used.max(initial=0) > BLOCKED:
            raise unusable(self.path, f"its tile {index} holds {used.max()}, which is none of the states 0 to 2")
        return states if used.size == states.size else np.minimum(states, BLOCKED)

    def obstacles(self, index: Index, record: Record, out: Bools | None = None) -> tuple[Bools, Bools]:
        """Read the outer and inner cells of a tile, cut to the map; the outer ones into ``out``, if it is the tile."""
        own = tuple(slice(0, part.stop - part.start) for part in self.cells(index))
        outer = self.read("outer", index, record.digests[self.layers], out)[own]
        if self.metadata["same"]:
            return outer, outer
        return outer, self.read("inner", index, record.digests[self.layers + 1])[own]

    def obstacles_in(self, box: Box, known: Known | None = None) -> tuple[Bools, Bools]:
        """Read the outer and inner cells in a box, which may reach beyond the map; ``known`` may cache records."""
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
        self, box: Box, known: Known | None = None, table: Ints | None = None, packed: bool | None = None
    ) -> Stack:
        """Read the states of all slices in a box; beyond the map, they are those of ``table``, as of an Exterior."""
        shape = tuple(part.stop - part.start for part in box)
        packed = is_packed(shape, self.slices) if packed is None else packed
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

        Raises FileError if not all tiles are done, or a file is missing or damaged, or the files describe no map.
        """
        with making_map(self.path):
            return self._contents()

    def _contents(self) -> Contents:
        if not self.is_done:
            raise not_done(self.path, self.share_done)
        for name in TILED:
            if name in self.names:
                self._check_layout(name)
        records = {index: self.known(index) for index in self}
        if any(self.metadata[key] != value for key, value in self.totals(records.__getitem__).items()):
            raise unusable(self.path, "its records differ from their digest")
        arrays = {name: self.array(name) for name in self.names.difference(TILED, ("shapes",))}
        box = tuple(slice(0, n) for n in self.grid.shape)
        packed = is_packed(self.grid.shape, self.slices, "overlap_counts" in arrays)
        check_bytes(
            self.path / "cell_states", self.slices * math.prod(self.grid.shape) // (4 if packed else 1), "unpacks to"
        )
        outer, inner = self.obstacles_in(box, records.__getitem__)
        source, unknown = self.metadata["workspace_source"], arrays.get("unknown")
        leading = (*self.rotations.leading(self.slices), *self.grid.shape)
        periodic_axes = self.metadata.get("periodic_axes", "").split()
        return Contents(
            Workspace(self.grid, outer, inner, source=source, unknown=unknown, shapes=self.shapes),
            self.robot,
            self.rotations,
            self.slice_of,
            self.states_in(box, records.__getitem__, packed=packed),
            str(self.metadata["outside"]),
            float(self.metadata["margin"]),
            str(self.metadata["precision"]),
            arrays.get("overlap_counts"),
            {name: arrays[name].reshape(leading) for name in FIELD_NAMES if name in arrays},
            Exterior(arrays["exterior"]) if "exterior" in arrays else None,
            self.proves_blocked,
            periodic_axes=tuple(axis in periodic_axes for axis in self.grid.axes) if periodic_axes else (),
        )

    def done(self) -> list[Index]:
        """Return the tiles that are done."""
        folder = self.path / "record" / "c"
        return [index for index in self if (folder / "/".join(map(str, (*index, 0)))).exists()]

    @property
    def share_done(self) -> float:
        """Share of the tiles that are done; below 1 until all are."""
        return 1.0 if self.is_done else min(len(self.done()) / len(self), 1.0 - 2.0**-20)

    def totals(self, known: Known | None = None) -> dict[str, Any]:
        """Return what the records of all tiles come to: counts of each slice, box of all obstacles, digest of all.

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
        """Describe the arrays of labels of components to software that reads Zarr."""
        shape = (*self.counts, self._label_width)
        for kind, what in enumerate(("FREE cells", "cells that are not BLOCKED")):
            name, about = f"labels_{kind}", f"components of {what} within a tile, of the cells on its faces"
            if not (self.path / name / ROOT).exists():
                description = _description(name, shape, *self._chunk(name), {"long_name": about, "comment": _LABELS})
                _write(self.path / name / ROOT, description)

    # ---- changes -----------------------------------------------------------------------------------------------------

    def commit(self, aside: str, **changes: Any) -> Store:
        """Replace the files of the same names as those in a folder, at one moment; return the store since then.

        What the change makes untrue is forgotten: the obstacles as shapes, for example, and what is known outside.
        """
        untrue = ("shapes", "unknown", "exterior", *UNTILED)
        self.reseal(untrue, version=self.metadata["version"] + 1, aside=aside, **changes)
        for name in untrue:
            shutil.rmtree(self.path / name, ignore_errors=True)
        return Store.open(self.path).settled()

    def settled(self) -> Store:
        """Return the store once nothing is left of a change that took place."""
        aside = self.metadata["aside"]
        if not aside:
            return self
        for file in sorted((self.path / aside).rglob("*")):
            if file.is_file():
                target = self.path / file.relative_to(self.path / aside)
                target.parent.mkdir(parents=True, exist_ok=True)
                with suppress(FileNotFoundError):  # another process does the same
                    file.replace(target)
        self.reseal(aside="")
        shutil.rmtree(self.path / aside, ignore_errors=True)
        return Store.open(self.path)

    def tidy(self) -> None:
        """Remove the remains of processes that were killed; nobody else may be writing."""
        for file in self.path.rglob(f"{_ASIDE}*"):
            if file.name != self.metadata["aside"]:
                shutil.rmtree(file, ignore_errors=True) if file.is_dir() else file.unlink(missing_ok=True)


def _check_names(store: Store) -> None:
    """Raise FileError unless a store has all arrays that it needs, and only known ones."""
    inner = () if store.metadata["same"] else ("inner",)
    required = ("cell_states", "outer", *inner, "record", "slice_of", *AXES[: store.grid.dim], *turns_of(store.names))
    lacking = [name for name in required if name not in store.names]
    if lacking:
        raise unusable(store.path, f"it holds no {' and no '.join(lacking)}")
    strange = sorted(store.names.difference(stored()))
    if strange:
        raise unusable(store.path, f"it holds {', '.join(strange)}, which no map does")


def aside_name() -> str:
    """Return a fresh name for a file, or a folder of files, not in their places yet."""
    return f"{_ASIDE}{uuid.uuid4().hex[:12]}"


def _moment(root: Path) -> tuple[int, int, int]:
    status = root.stat()
    return status.st_ino, status.st_mtime_ns, status.st_size


def _range(part: slice) -> range:
    return range(part.start, part.stop)


def _name(array: str, index: Sequence[int]) -> str:
    """Return the file of a chunk."""
    return f"{array}/c/{'/'.join(map(str, index))}"


def _encoded(name: str, block: NDArray[Any], shape: tuple[int, ...], dtype: np.dtype[Any], lost: Any) -> bytes:
    """Encode a chunk of a shape; a smaller block, at the end of an array, is filled up.

    A chunk with a digest in a record needs no checksum, which takes as long as everything else.
    """
    from numcodecs import Zstd

    if block.shape != shape:
        whole = np.full(shape, lost, dtype=dtype)
        whole[tuple(slice(0, n) for n in block.shape)] = block
        block = whole
    return bytes(Zstd(LEVEL, checksum=name not in DIGESTED).encode(np.ascontiguousarray(block, dtype=dtype)))


def _description(
    name: str,
    shape: tuple[int, ...],
    chunks: tuple[int, ...],
    dtype: np.dtype[Any],
    lost: Any,
    about: Mapping[str, Any],
    axes: Sequence[str] | None = None,
) -> bytes:
    """Return the metadata of an array in version 3 of the Zarr format."""
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
            {"name": "zstd", "configuration": {"level": LEVEL, "checksum": name not in DIGESTED}},
        ],
        "attributes": about,
        **({"dimension_names": axes} if axes else {}),
    }
    return json.dumps(document, indent=2).encode()


def _write(file: Path, content: bytes) -> None:
    """Write a file that is there whole or not at all."""
    temporary = file.with_name(aside_name())
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(content)
        temporary.replace(file)
    except OSError as error:
        raise FileError(
            str(file),
            f"cannot be written: {error.strerror or error}",
            "a store needs a writable folder with free space",
            "free some, and run the same again: what is done is kept",
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _chunks_of(metadata: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """Return the shape of the chunks of each array with tiles."""
    tile, slices, depth = tuple(metadata["tile"]), metadata["slices"], metadata["depth"]
    columns = 3 * slices + 2 * len(tile) + _DIGEST * (-(-slices // depth) + 2)
    return {"cell_states": (depth, *tile), "outer": tile, "inner": tile, "record": (*(1,) * len(tile), columns)}


def _files_of(metadata: Mapping[str, Any], arrays: Mapping[str, Any]) -> Iterator[tuple[str, bytes]]:
    """Yield the files of a store without tiles, by name, except the root: metadata of arrays, and ``arrays``."""
    grid = grid_of(metadata)
    chunks = {name: side for name, side in _chunks_of(metadata).items() if name != "inner" or not metadata["same"]}
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
        yield f"{name}/{ROOT}", _description(name, shape, chunks[name], dtype, lost, about, axes)
        if name in arrays:
            for index in itertools.product(*(range(-(-n // c)) for n, c in zip(shape, chunks[name], strict=True))):
                box = tuple(slice(i * c, (i + 1) * c) for i, c in zip(index, chunks[name], strict=True))
                yield _name(name, index), _encoded(name, arrays[name][box], chunks[name], dtype, lost)


# ---- whole maps ------------------------------------------------------------------------------------------------------


def save(contents: Contents, path: StrPath, overwrite: bool = False) -> None:
    """Save a map as a store of one tile, which :func:`cspace.open` reads and ``xarray.open_zarr`` too.

    A slice of more than 2^28 cells is saved in several tiles.

    Parameters
    ----------
    contents : Contents
    path : path-like
        A Zarr folder, whose name ends in ``.zarr`` or has no suffix.
    overwrite : bool
        Whether an existing map may be replaced; no folder of anything else is.

    Raises
    ------
    InputError
        If the suffix is another one.
    FileError
        If the output exists and may not be replaced, or cannot be written.
    """
    check_suffix(path, MAP_SUFFIXES, "a map is saved as a Zarr folder, and exported to other formats by space.export")
    arrays, workspace = arrays_of(contents), contents.workspace
    tile = fit_tile(contents.grid.shape)
    settings = {
        "tile": list(tile),
        "depth": max(1, min(len(contents.states), SAVED_CHUNK_CELLS // math.prod(tile))),
        "same": workspace.inner is workspace.outer,
        "method": "auto",
        "stamp": Held(workspace.outer, workspace.inner).stamp,
    }
    states, cells = arrays["cell_states"], [arrays[name] for name in ("outer", "inner") if name in arrays]
    untiled = {name: array for name, array in arrays.items() if name not in TILED}
    with replacing(path, overwrite, folder=_is_ours) as temporary:
        store = Store.create(temporary, metadata_of(contents) | settings, untiled)
        for index in store:
            box = store.cells(index)
            blocks = (_block(states, store.numbers(layer), box) for layer in range(store.layers))
            store.write_tile(index, blocks, (part[box] for part in cells))
        store.reseal(**store.totals())


def _block(states: Stack, numbers: range, box: Box) -> States:
    """Return the states of some slices in a box; no cells are copied if one slice, or a stack of bytes, has them."""
    if len(numbers) == 1:
        return states[numbers[0]][box][None]
    return states[numbers.start : numbers.stop][(slice(None), *box)]


def fit_tile(sides: Sequence[int], itemsize: int = 1) -> tuple[int, ...]:
    """Return the cells of a tile along each axis: ``sides``, the longest of them halved until a chunk may hold it."""
    tile = list(sides)
    while itemsize * math.prod(tile) > MAX_CHUNK_BYTES:
        longest = int(np.argmax(tile))
        tile[longest] = -(-tile[longest] // 2)
    return tuple(tile)
