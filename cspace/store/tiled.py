"""The store of a tiled map: a folder in the Zarr format, a chunk for each tile, which appears whole or not at all.

The arrays are those of a saved map, and read by anything that reads Zarr: ``state``, in chunks of a tile and some
slices, ``outer`` and, unless both are always the same, ``inner``, in chunks of a tile. ``record`` has a row of numbers
for each tile: how many of its cells are FREE, MIXED and BLOCKED, the box around its obstacles, and the digests
(SHA-256) of its other chunks. It is written last: a tile is done where its row is there. What is done once all are is
the map.

A file is written under another name beside its own, and renamed. An update writes its files into a folder of their own,
names that folder in the metadata, which is when it takes place, and then moves them over those that they replace; a
reader looks into that folder first, so that it finds one map or the other whatever the moment.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import shutil
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace import __version__
from cspace.arrays import BLOCKED, MIXED, Bools, Box, Ints, shared
from cspace.errors import CspaceError, FileError
from cspace.files.access import read_part, replacing
from cspace.files.chunks import Layout, unpack
from cspace.files.plain import read_json
from cspace.grid import Grid
from cspace.limits import check_bytes, is_packed
from cspace.map.storage import PackedStates, Stack
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.shapes import Shape
from cspace.store.saved import (
    AXES,
    CHUNK,
    VERSION,
    decoding_map,
    digest_of,
    grid_of,
    seal,
    shapes_from,
    stored,
    turns_of,
    unseal,
    unusable,
    zarr_options,
)

FORMAT: Final = "cspace-tiles"
ROOT: Final = "zarr.json"
CHUNK_CELLS: Final = 2**24
"""States that a chunk holds at most, unless a single slice of a tile has more."""

LEVEL: Final = 1
"""Of zstd: higher ones take more time and save little; slices of turned robots even grow."""

DIGESTED: Final = ("state", "outer", "inner")
"""Arrays whose chunks have digests in the records of their tiles."""

LABEL_MARK: Final = 8
"""Numbers of 32 bits before the labels of a tile: the digest of what they were made from."""

_DIGEST: Final = 4
"""Whole numbers of 64 bits in a digest."""

_ASIDE: Final = ".cspace-"
"""What names begin with that are not final."""

Index = tuple[int, ...]
"""Of a tile, along each axis."""


@dataclass(frozen=True)
class Store:
    """A tiled map on disk, as of one moment; several processes read and write it at once.

    Attributes
    ----------
    path : Path
    metadata : dict
        Plain values: those of saved maps, and ``tile``, the cells of a tile along each axis, ``depth``, the slices of
        a chunk, ``inner`` and ``same``, whether BLOCKED is proven and whether inner cells are the outer ones,
        ``method``, ``stamp``, of the workspace, ``shapes``, the digest of its obstacles where they are those of the
        array of that name, ``version``, how many changes it has seen, and ``aside``, a folder of newer files.
    rotations : Rotations
    moment : tuple
        What is another after any change of the map.
    """

    path: Path
    metadata: Mapping[str, Any]
    rotations: Rotations
    moment: tuple[int, int, int]

    # ---- what it is of -----------------------------------------------------------------------------------------------

    @cached_property
    def grid(self) -> Grid:
        """Of the whole map."""
        return grid_of(self.metadata)

    @cached_property
    def robot(self) -> Robot:
        """As it was given to the build."""
        return Robot.from_spec(json.loads(self.metadata["robot"]))

    @cached_property
    def shapes(self) -> tuple[Shape, ...] | None:
        """The obstacles, where they are known otherwise than by their cells; not after an update."""
        if not self.metadata.get("shapes"):
            return None
        with decoding_map(self.path):
            return shapes_from({"shapes": _small(self.path, "shapes")})

    @cached_property
    def slice_of(self) -> Ints:
        """The slice of each rotation cell."""
        return self.rotations.slices_for(self.robot.shape)

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
        """All tiles."""
        return itertools.product(*map(range, self.counts))

    def __len__(self) -> int:
        return math.prod(self.counts)

    def cells(self, index: Index) -> tuple[slice, ...]:
        """Those of a tile."""
        return tuple(
            slice(i * t, min((i + 1) * t, n)) for i, t, n in zip(index, self.tile, self.grid.shape, strict=True)
        )

    def numbers(self, layer: int) -> range:
        """Slices of a chunk of states."""
        return range(layer * self.depth, min((layer + 1) * self.depth, self.slices))

    def tiles_in(self, box: Sequence[slice]) -> Iterator[Index]:
        """Those that share a cell with a box of cells, which may reach beyond the grid."""
        cut = [
            (max(part.start, 0), min(part.stop, n), t)
            for part, n, t in zip(box, self.grid.shape, self.tile, strict=True)
        ]
        spans = [range(first // t, -(-stop // t)) if first < stop else range(0) for first, stop, t in cut]
        return itertools.product(*spans)

    # ---- made and opened ---------------------------------------------------------------------------------------------

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        metadata: Mapping[str, Any],
        robot: Robot,
        rotations: Rotations,
        shapes: Mapping[str, NDArray[Any]],
    ) -> Store:
        """A store in which nothing is done yet; ``shapes`` is the array of obstacles that are known as such, if any.

        Raises FileError if there is something, or nothing can be written.
        """
        with replacing(path, folder=is_tiled) as temporary:
            _write_frame(
                temporary, metadata, {"slice_of": rotations.slices_for(robot.shape), **rotations.coordinates, **shapes}
            )
        return cls.open(path)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Store:
        """The store at a path, whatever is done of it.

        Raises FileError if there is none, or it was changed.
        """
        root = Path(path) / ROOT
        with decoding_map(path):
            moment = _moment(root)
            metadata = read_json(root, "store of tiles")["attributes"]
            digests = unseal(metadata, path, FORMAT)
            if metadata["aside"] and (
                metadata["aside"].strip("/.") != metadata["aside"][1:] or "/" in metadata["aside"]
            ):
                raise unusable(path, f"its newer files are in {metadata['aside']!r}")
            if min(*metadata["tile"], metadata["depth"], metadata["slices"]) < 1:
                raise unusable(path, "its tiles hold nothing")
            for file, digest in digests.items():
                content = read_part(path, file, "part of a store of tiles")
                if content is None or digest_of(content) != digest:
                    raise unusable(path, f"its file {file!r} differs from its digest")
            turns = {name: _small(path, name) for name in turns_of(file.split("/")[0] for file in digests)}
            return cls(Path(path), metadata, Rotations.from_coordinates(turns), moment)

    def sealed(self, **changes: Any) -> None:
        """Write the metadata anew, with some of it changed."""
        document = read_json(self.path / ROOT, "store of tiles")
        digests = unseal(document["attributes"], self.path, FORMAT)
        document["attributes"] = seal({**self.metadata, **changes}, digests)
        _write(self.path / ROOT, json.dumps(document, indent=2).encode())

    @property
    def is_past(self) -> bool:
        """Whether the map has changed since."""
        return self.moment != _moment(self.path / ROOT)

    # ---- chunks ------------------------------------------------------------------------------------------------------

    def write(self, name: str, index: Sequence[int], block: NDArray[Any], aside: str = "") -> bytes:
        """Write a chunk, of which what lies beyond the array may be missing; its digest.

        Raises FileError if it cannot be written, as where the disk is full.
        """
        shape, dtype, lost = self._chunk(name)
        if block.shape != shape:
            whole = np.full(shape, lost, dtype=dtype)
            whole[tuple(slice(0, n) for n in block.shape)] = block
            block = whole
        content = _codec(name).encode(np.ascontiguousarray(block, dtype=dtype))
        _write(self.path / aside / _name(name, index), content)
        return digest_of_bytes(content)

    def read(self, name: str, index: Sequence[int], digest: bytes | None) -> NDArray[Any]:
        """A chunk, whole; it must have a digest, if one is given.

        Raises FileError if it is missing or damaged.
        """
        file = _name(name, index)
        content = self._content(file)
        if content is None:
            raise unusable(self.path, f"its file {file!r} is missing")
        if digest is not None and digest_of_bytes(content) != digest:
            raise unusable(self.path, f"its file {file!r} differs from its digest")
        return self._decoded(name, index, content)

    def _decoded(self, name: str, index: Sequence[int], content: bytes) -> NDArray[Any]:
        file, (shape, dtype, _) = self.path / _name(name, index), self._chunk(name)
        with decoding_map(file):
            size = math.prod(shape) * dtype.itemsize
            check_bytes(file, size, "unpacks to")
            return unpack(content, "zstd", size).view(dtype).reshape(shape)

    def optional(self, name: str, index: Sequence[int]) -> NDArray[Any] | None:
        """A chunk of what may be missing, or damaged, and is made again then."""
        try:
            return self.read(name, index, None)
        except FileError:
            return None

    def _content(self, file: str) -> bytes | None:
        """That of a file; None where there is none."""
        for folder in (self.metadata["aside"], "") if self.metadata["aside"] else ("",):
            if (content := read_part(self.path / folder, file, "part of a store of tiles")) is not None:
                return content
        return None

    def _chunk(self, name: str) -> tuple[tuple[int, ...], np.dtype[Any], Any]:
        """Shape, type and filling of an array's chunks."""
        shapes = {"state": (self.depth, *self.tile), "record": (*(1,) * self.grid.dim, self._columns)}
        if name == "record":
            return shapes[name], np.dtype("<i8"), -1
        if name.startswith("labels"):
            return (*(1,) * self.grid.dim, self._label_width), np.dtype("<i4"), -1
        return shapes.get(name, self.tile), np.dtype(stored()[name].dtype), stored()[name].lost

    @property
    def label_count(self) -> int:
        """Rotation cells that are labelled: one if there is a single slice."""
        return self.rotations.count if self.slices > 1 else 1

    @property
    def _label_width(self) -> int:
        """Numbers in a chunk of labels: a digest, and those of the cells on all faces of a tile, over rotations."""
        return LABEL_MARK + self.label_count * sum(2 * math.prod(self.tile) // side for side in self.tile)

    # ---- tiles -------------------------------------------------------------------------------------------------------

    @property
    def _columns(self) -> int:
        return columns(self.slices, self.grid.dim, self.layers)

    def record(self, index: Index) -> Record | None:
        """What is known of a tile that is done; None of one that is not."""
        content = self._content(_name("record", (*index, 0)))
        if content is None:
            return None
        row = self._decoded("record", (*index, 0), content).reshape(-1)
        counts, box, digests = np.split(row, [3 * self.slices, 3 * self.slices + 2 * self.grid.dim])
        parts = [part.tobytes() for part in digests.reshape(-1, _DIGEST)]
        return Record(counts.reshape(-1, 3), box.reshape(2, -1), tuple(parts))

    def known(self, index: Index) -> Record:
        """The same of a tile that must be done.

        Raises FileError if it is not.
        """
        record = self.record(index)
        if record is None:
            raise unusable(self.path, f"its tile {index} is missing")
        return record

    def finish(self, index: Index, record: Record, aside: str = "") -> None:
        """Write down that a tile is done."""
        digests = np.frombuffer(b"".join(record.digests), dtype="<i8")
        row = np.concatenate([record.counts.ravel(), record.box.ravel(), digests])
        self.write("record", (*index, 0), row.reshape(*(1,) * self.grid.dim, -1), aside)

    def states(self, index: Index, layer: int, record: Record) -> NDArray[np.uint8]:
        """A chunk of states, shape (depth, *tile), whose cells beyond the map are BLOCKED."""
        states: NDArray[np.uint8] = self.read("state", (layer, *index), record.digests[layer])
        used = states[tuple(slice(0, len(part)) for part in (self.numbers(layer), *map(_range, self.cells(index))))]
        if used.max(initial=0) > BLOCKED:
            raise unusable(self.path, f"its tile {index} holds {used.max()}, which is no state")
        return states if used.size == states.size else np.minimum(states, BLOCKED)

    def obstacles(self, index: Index, record: Record) -> tuple[Bools, Bools]:
        """Outer and inner cells of a tile, cut to the map."""
        own = tuple(slice(0, part.stop - part.start) for part in self.cells(index))
        outer = self.read("outer", index, record.digests[self.layers])[own]
        if record.digests[self.layers + 1] == record.digests[self.layers]:
            return outer, outer
        return outer, self.read("inner", index, record.digests[self.layers + 1])[own]

    def obstacles_in(self, box: Box, known: Known | None = None) -> tuple[Bools, Bools]:
        """Outer and inner cells in a box, which may reach beyond the map; ``known`` may know its tiles already."""
        outside = self.metadata["outside"] == "blocked"
        outer = np.full(tuple(part.stop - part.start for part in box), outside, dtype=np.bool_)
        inner = outer if self.metadata["same"] else outer.copy()
        for index in self.tiles_in(box):
            here, there = shared(box, self.cells(index))
            own = self.obstacles(index, (known or self.known)(index))
            outer[here] = own[0][there]
            if inner is not outer:
                inner[here] = own[1][there]
        return outer, inner

    def states_in(self, box: Box, known: Known | None = None, table: Ints | None = None) -> Stack:
        """States of all slices in a box; where it reaches beyond the map, those of ``table``, as of an Exterior."""
        shape = tuple(part.stop - part.start for part in box)
        packed = PackedStates((self.slices, *shape)) if is_packed(shape, self.slices) else None
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
                here, there = shared(box, self.cells(index))
                own = self.states(index, layer, (known or self.known)(index))
                block[(slice(None), *here)] = own[(slice(0, len(numbers)), *there)]
            if packed is not None:
                for number, part in zip(numbers, block, strict=True):
                    packed.write(number, part)
        return packed or states

    def done(self) -> list[Index]:
        """The tiles that are done."""
        folder = self.path / "record" / "c"
        return [index for index in self if (folder / "/".join(map(str, (*index, 0)))).exists()]

    def totals(self) -> dict[str, Any]:
        """What the records of all tiles come to: counts of each slice, and the box around all obstacles.

        Raises FileError if a tile is not done.
        """
        counts = np.zeros((self.slices, 3), dtype=np.int64)
        low, high = np.full(self.grid.dim, 2**61), np.full(self.grid.dim, -(2**61))
        for index in self:
            record = self.known(index)
            counts += record.counts
            low, high = np.minimum(low, record.box[0]), np.maximum(high, record.box[1])
        box = [low, high] if (low <= high).all() else [low * 0, low * 0 - 1]
        return {"counts": counts.tolist(), "box": [corner.tolist() for corner in box]}

    def add_labels(self) -> None:
        """Describe the arrays of labels of components to software that reads Zarr."""
        import zarr

        width = self._label_width

        for kind, what in enumerate(("FREE cells", "cells that are not BLOCKED")):
            if not (self.path / f"labels_{kind}" / ROOT).exists():
                zarr.create_array(
                    str(self.path),
                    name=f"labels_{kind}",
                    shape=(*self.counts, width),
                    dtype="int32",
                    chunks=(*(1,) * self.grid.dim, width),
                    compressors=[_zarr_codec(f"labels_{kind}")],
                    fill_value=-1,
                    attributes={
                        "long_name": f"components of {what} within a tile, of the cells on its faces",
                        "comment": "eight numbers that tell what it was made from; then, for each axis, the near face "
                        "and the far one, over the rotation cells; -1 where a cell has none",
                    },
                )

    # ---- changes -----------------------------------------------------------------------------------------------------

    def commit(self, aside: str, **changes: Any) -> Store:
        """Have the files in a folder take the place of those of the same names, at one moment; the store since then."""
        self.sealed(version=self.metadata["version"] + 1, aside=aside, **changes)
        return Store.open(self.path).settled()

    def settled(self) -> Store:
        """The store once nothing is left of a change that took place."""
        aside = self.metadata["aside"]
        if not aside:
            return self
        for file in sorted((self.path / aside).rglob("*")):
            if file.is_file():
                target = self.path / file.relative_to(self.path / aside)
                target.parent.mkdir(parents=True, exist_ok=True)
                with suppress(FileNotFoundError):  # another process does the same
                    file.replace(target)
        self.sealed(aside="")
        shutil.rmtree(self.path / aside, ignore_errors=True)
        return Store.open(self.path)

    def tidy(self) -> None:
        """Remove what processes that were killed left behind; nobody else may be writing."""
        for file in self.path.rglob(f"{_ASIDE}*"):
            if file.name != self.metadata["aside"]:
                shutil.rmtree(file, ignore_errors=True) if file.is_dir() else file.unlink(missing_ok=True)


@dataclass(frozen=True)
class Record:
    """What is known of a tile that is done.

    Attributes
    ----------
    counts : ndarray of int64, shape (slices, 3)
        Number of FREE, MIXED and BLOCKED cells.
    box : ndarray of int64, shape (2, d)
        First and last cell, of the whole map, of the box around the outer cells; the first is beyond the last where
        there are none. All of the tile where the map does not ask for it.
    digests : tuple of bytes
        Of its chunks of states, of the outer cells, and of the inner ones, or again of the outer ones.
    """

    counts: Ints
    box: Ints
    digests: tuple[bytes, ...]

    @property
    def mark(self) -> bytes:
        """A digest of all that is known of it: what was made from another tile has another one."""
        return digest_of_bytes(b"".join(self.digests))


Known = Callable[[Index], Record]
"""Gives the record of a tile that is done."""


def columns(slices: int, dim: int, layers: int) -> int:
    """Numbers in a row of the array of records."""
    return 3 * slices + 2 * dim + _DIGEST * (layers + 2)


def is_tiled(path: str | os.PathLike[str]) -> bool:
    """Whether a folder is the store of a tiled map, whole or not."""
    try:
        return bool(read_json(Path(path) / ROOT, "saved map")["attributes"]["format"] == FORMAT)
    except (CspaceError, KeyError, TypeError):
        return False


def digest_of_bytes(content: bytes) -> bytes:
    """Digest of a chunk (SHA-256)."""
    return bytes.fromhex(digest_of(content))


def aside_name() -> str:
    """A fresh name for a file, or a folder of files, not in their places yet."""
    return f"{_ASIDE}{uuid.uuid4().hex[:12]}"


def _moment(root: Path) -> tuple[int, int, int]:
    status = root.stat()
    return status.st_ino, status.st_mtime_ns, status.st_size


def _range(part: slice) -> range:
    return range(part.start, part.stop)


def _name(array: str, index: Sequence[int]) -> str:
    """File of a chunk."""
    return f"{array}/c/{'/'.join(map(str, index))}"


def _codec(name: str) -> Any:
    """What chunks of an array are encoded with: as Zarr does it, which takes several times as long to come to it.

    A checksum takes as long as all else. What has a digest in a record needs none.
    """
    from numcodecs import Zstd

    return Zstd(LEVEL, checksum=name not in DIGESTED)


def _zarr_codec(name: str) -> Any:
    """The same, for Zarr."""
    from zarr.codecs import ZstdCodec

    return ZstdCodec(level=LEVEL, checksum=name not in DIGESTED)


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


def _write_frame(folder: Path, metadata: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """All of a store but what is done of its tiles; ``arrays`` are the small ones, which are written at once."""
    import zarr

    grid = grid_of(metadata)
    dim, slices, depth, tile = grid.dim, metadata["slices"], metadata["depth"], tuple(metadata["tile"])
    counts = tuple(-(-n // t) for n, t in zip(grid.shape, tile, strict=True))
    width = columns(slices, dim, -(-slices // depth))
    arrays = {**arrays, **{axis: grid.centers(k) for k, axis in enumerate(AXES[:dim])}}
    group = zarr.create_group(str(folder), zarr_format=3)
    large = {"state": ((slices, *grid.shape), (depth, *tile)), "outer": (grid.shape, tile)}
    large |= {} if metadata["same"] else {"inner": (grid.shape, tile)}
    small = {name: (array.shape, (min(len(array), CHUNK[1]), *array.shape[1:])) for name, array in arrays.items()}
    for name, (shape, chunks) in {**large, **small}.items():
        dtype, codecs, options = stored()[name].dtype, [_zarr_codec(name)], zarr_options(name, grid)
        made = group.create_array(name, shape=shape, dtype=dtype, chunks=chunks, compressors=codecs, **options)
        if name in arrays:
            made[...] = arrays[name]
    group.create_array(
        "record",
        shape=(*counts, width),
        dtype="int64",
        chunks=(*(1,) * dim, width),
        compressors=[_zarr_codec("record")],
        fill_value=-1,
        attributes={
            "long_name": "what is known of a tile that is done",
            "comment": "FREE, MIXED and BLOCKED cells of each slice; first and last cell of its obstacles; SHA-256 of "
            "its chunks of state, of outer, and of inner or outer again",
        },
        dimension_names=[*(f"tile_{axis}" for axis in AXES[:dim]), "number"],
    )
    document = json.loads((folder / ROOT).read_bytes())
    files = sorted(file for name in arrays for file in (folder / name).rglob("*") if file.is_file())
    digests = {file.relative_to(folder).as_posix(): digest_of(file.read_bytes()) for file in files}
    about = {"format": FORMAT, "format_version": VERSION, "library_version": __version__}
    document["attributes"] = seal({**about, **metadata}, digests)
    (folder / ROOT).write_bytes(json.dumps(document, indent=2).encode())


def _small(path: str | os.PathLike[str], name: str) -> NDArray[Any]:
    """Read a small array.

    Raises errors as :meth:`cspace.files.chunks.Layout.read`.
    """
    layout = Layout.parse(read_json(Path(path, name, ROOT), "part of a store of tiles"))
    if layout.dtype != stored()[name].dtype:
        raise unusable(path, f"its array {name!r} is {layout.dtype}")
    whole = tuple(slice(0, n) for n in layout.shape)
    return layout.read(whole, lambda key: read_part(path, f"{name}/{key}", "part of a store of tiles"))
