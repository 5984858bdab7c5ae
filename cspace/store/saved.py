"""Saved maps: a folder in the Zarr format, chunked, with a digest of every file in it, or one compressed NumPy file.

Zarr reads a chunk that is missing as the fill value, without a word; were that 0, a lost chunk would be called FREE. So
the fill value is no state, every chunk is written, and a map is opened only if every file is there and agrees, to the
byte, with its digest. States are stored slice by slice, each in chunks of its own, so that one is read and proven
without the rest.

What a map holds is one table of arrays, plain metadata, and digests of all of it, whatever the format.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import cache
from itertools import compress
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace import __version__
from cspace.arrays import BLOCKED, FIELD_NAMES, STATE_NAMES
from cspace.errors import FileError
from cspace.files.access import decoding, existing, look_up, read_bytes, read_part, replacing, suffix_of
from cspace.files.chunks import Layout
from cspace.files.plain import read_json
from cspace.grid import Grid
from cspace.limits import check_bytes, is_packed
from cspace.map.contents import Contents
from cspace.map.storage import PackedStates, read_only, read_only_of
from cspace.rotations import Rotations
from cspace.shapes import Shape, shape_from_spec

FORMAT: Final = "cspace-map"
VERSION: Final = 2
"""Version of the format; a reader refuses every other one."""

AXES: Final = ("x", "y", "z")

STACKED: Final = ("state", "overlap", *FIELD_NAMES)
"""Arrays that hold one slice after the other."""

_WHOLE: Final = (
    "a saved map is opened only if it is complete and unchanged",
    "copy it again from where it is whole, or build it again",
)
_REQUIRED: Final = ("state", "outer", "slice_of")
_KEYS: Final = (
    *("format", "format_version", "library_version", "lower", "spacing", "shape", "outside", "margin", "precision"),
    *("rotations", "slices", "robot", "workspace_source"),
)

_ROOT: Final = "zarr.json"

CHUNK: Final = {1: 2**20, 2: 1024, 3: 128}
"""Cells of a chunk along each axis, by the number of axes: about a million cells."""

SLICE_CHUNK: Final = {2: 4096, 3: 256}
"""The same for a chunk of a slice: all of a slice in the plane, but for huge ones."""

TOGETHER: Final = 2**20
"""Cells of an array, in layers of chunks, that are encoded together: each time takes milliseconds."""

_NUMBERS: Final = ("lower", "spacing")
"""Members that repeat the metadata, for those who read the file without this library."""

_LONGEST: Final = 2**28
"""Bytes of the metadata, at most."""


class Stored(NamedTuple):
    """How an array is stored.

    Attributes
    ----------
    axes : tuple of str
        Names of its axes; "cells" stands for those of the grid.
    dtype : str
    lost : number
        What stands in for entries that were lost: never a value that would call a cell free.
    about : mapping
        Attributes, after the CF conventions.
    sizes : mapping of str to int
        Lengths of those axes that are the same for every map.
    """

    axes: tuple[str, ...]
    dtype: str
    lost: Any
    about: Mapping[str, Any]
    sizes: Mapping[str, int] = {}


def _stored(axes: str, dtype: str, lost: Any, name: str, **about: Any) -> Stored:
    return Stored(tuple(axes.split()), dtype, lost, {"long_name": name, **about})


def _floats(axes: str, name: str, units: str, **about: str) -> Stored:
    return _stored(axes, "float64", math.nan, name, units=units, **about)


_FIELD_NOTES: Final = (
    "overlap of the descriptors of robot and obstacles",
    *(f"its derivative along {axis}" for axis in AXES),
)

ARRAYS: Final[dict[str, Stored]] = {
    "state": _stored(
        "slice cells",
        "uint8",
        255,
        "state of the configurations in a cell",
        flag_values=list(range(len(STATE_NAMES))),
        flag_meanings=" ".join(STATE_NAMES),
    ),
    "outer": _stored("cells", "bool", True, "workspace cells that meet an obstacle"),
    "inner": _stored("cells", "bool", True, "workspace cells that lie in obstacles"),
    "unknown": _stored("cells", "bool", True, "workspace cells that nothing is known of"),
    "overlap": _stored(
        "slice cells", "int32", -1, "number of coinciding pairs of obstacle cell and robot offset", units="1"
    ),
    **{
        name: _stored("slice cells", "float64", math.inf, what)
        for name, what in zip(FIELD_NAMES, _FIELD_NOTES, strict=True)
    },
    "slice_of": _stored(
        "rotation",
        "int64",
        np.iinfo(np.int64).max,
        "slice that serves a rotation cell",
        comment="where state has the dimension slice, state.isel(slice=slice_of) has the dimension rotation",
    ),
    "exterior": _stored(
        "slice corner",
        "int64",
        np.iinfo(np.int64).max,
        "first and last cell of the box of cells that are MIXED outside the grid, and the state of those beyond it",
    ),
    "shapes": _stored("byte", "int8", -1, "obstacles as a JSON list of what makes each shape again"),
    **{axis: _floats(axis, f"{axis} of the middle of a cell", "m", axis=axis.upper()) for axis in AXES},
}
"""Every array that a map may hold, but those that describe its rotation cells."""


def stored() -> Mapping[str, Stored]:
    """Every array that a map may hold."""
    return _stored_of(tuple(Rotations.KINDS.values()))


@cache
def _stored_of(kinds: tuple[type[Rotations], ...]) -> Mapping[str, Stored]:
    arrays = dict(ARRAYS)
    for name, each in (item for kind in kinds for item in kind.COORDINATES.items()):
        bounds = {"bounds": each.bounds} if each.bounds else {}
        array = _floats(" ".join(["rotation", *each.axes]), each.about, each.units, **bounds)
        arrays[name] = array._replace(sizes=each.axes)
    return arrays


def axes_of(name: str, dim: int) -> tuple[str, ...]:
    """The name of each axis of an array, on a grid of ``dim`` axes."""
    return tuple(part for axis in stored()[name].axes for part in (AXES[:dim] if axis == "cells" else (axis,)))


def grid_of(metadata: Mapping[str, Any]) -> Grid:
    """The grid of a map, from its metadata; without units, in metres."""
    shape = tuple(metadata["shape"])
    axes, units = metadata.get("axes", "").split()[: len(shape)], metadata.get("units", "").split()
    return Grid(metadata["lower"], metadata["spacing"], shape, axes or None, units or None)


def attributes_of(name: str, grid: Grid) -> dict[str, Any]:
    """The attributes of an array on a grid, with its unit where that depends on its axes."""
    about, dim = dict(stored()[name].about), grid.dim
    if name in AXES:
        number = AXES.index(name)
        about |= {"long_name": f"{grid.axes[number]} of the middle of a cell", "units": grid.units[number]}
    if name in FIELD_NAMES:
        power = dim - (name != FIELD_NAMES[0])
        about["units"] = "m" if power == 1 else f"m{power}"
    return about


def zarr_options(name: str, grid: Grid) -> dict[str, Any]:
    """What an array of a map is created with in a Zarr group, beside its shape, type and encoding."""
    return {
        "fill_value": stored()[name].lost,
        "attributes": attributes_of(name, grid),
        "dimension_names": axes_of(name, grid.dim),
        "config": {"write_empty_chunks": True},
    }


def metadata_of(contents: Contents) -> dict[str, Any]:
    """All of a map but its arrays, as plain values: text, numbers and lists of numbers.

    ``lower`` and ``spacing`` in metres; ``axes`` the names of the numbers of a configuration and ``units`` of those of
    the cells; ``endless`` the axes that close in a circle, if there are any; ``inner`` 1 if BLOCKED is proven and 0 if
    not, left out if that is unknown; ``rotations`` the number of rotation cells; ``robot`` as JSON text for
    ``Robot.from_spec``.
    """
    grid = contents.grid
    return {
        "format": FORMAT,
        "format_version": VERSION,
        "library_version": __version__,
        "lower": list(grid.lower),
        "spacing": grid.spacing,
        "shape": list(grid.shape),
        "axes": " ".join(contents.axes),
        "units": " ".join(grid.units),
        **({"endless": " ".join(compress(grid.axes, contents.endless))} if any(contents.endless) else {}),
        "outside": contents.outside,
        "margin": float(contents.margin),
        "precision": contents.precision,
        **({} if contents.proves_blocked is None else {"inner": int(contents.proves_blocked)}),
        "rotations": contents.rotations.count,
        "slices": len(contents.states),
        "robot": contents.robot.definition,
        "workspace_source": contents.workspace.source,
    }


def arrays_of(contents: Contents) -> dict[str, Any]:
    """The arrays of a map, by the names of :func:`stored`. No cells are copied; states may be in two bits each.

    ``inner`` is there only if it differs from ``outer``, ``unknown`` only if there are such cells, ``overlap`` only if
    the map was built with it, :data:`FIELD_NAMES` only if it carries an overlap field, those of the
    rotation cells only if the robot turns, and ``shapes`` only if the obstacles are known as such.
    """
    workspace, grid = contents.workspace, contents.grid
    arrays: dict[str, Any] = {
        "state": read_only_of(contents.states),
        "outer": workspace.outer,
        "slice_of": contents.slice_of,
    }
    if workspace.inner is not workspace.outer:
        arrays["inner"] = workspace.inner
    if workspace.unknown is not None:
        arrays["unknown"] = workspace.unknown
    if contents.exterior is not None:
        arrays["exterior"] = contents.exterior.table
    stacked: dict[str, NDArray[Any]] = dict(contents.fields)
    if contents.overlaps is not None:
        stacked["overlap"] = read_only(contents.overlaps)
    arrays |= {name: array.reshape(contents.states.shape) for name, array in stacked.items()}
    arrays |= {axis: grid.centers(i) for i, axis in enumerate(AXES[: grid.dim])}
    return {**arrays, **contents.rotations.coordinates, **shapes_array(workspace.shapes)}


def shapes_array(shapes: Sequence[Shape] | None) -> dict[str, NDArray[Any]]:
    """The array ``shapes``, where obstacles are known as such."""
    if shapes is None:
        return {}
    specs = json.dumps([shape.spec for shape in shapes])
    return {"shapes": np.frombuffer(specs.encode(), dtype=np.int8)}  # netCDF 3 knows no unsigned bytes


def shapes_from(arrays: Mapping[str, NDArray[Any]]) -> tuple[Shape, ...] | None:
    """The obstacles of a map that knows them, from its array ``shapes``.

    Raises ValueError if the array holds no obstacles.
    """
    if "shapes" not in arrays:
        return None
    try:
        return tuple(shape_from_spec(spec) for spec in json.loads(arrays["shapes"].tobytes()))
    except Exception as error:  # shapely and the shapes raise what they like on what is none
        raise ValueError(f"'shapes' tells of no obstacles ({type(error).__name__}: {error})") from error


def seal(metadata: Mapping[str, Any], digests: Mapping[str, str]) -> dict[str, Any]:
    """``metadata`` with the digest of each part of a map, and a digest of all of this."""
    sealed = {**metadata, "digests": " ".join(f"{name}:{digest}" for name, digest in digests.items())}
    return {**sealed, "digest": digest_of(_text(sealed))}


def unseal(metadata: Any, path: str | os.PathLike[str], kind: str = FORMAT) -> dict[str, str]:
    """The digest of each part of a map, from its metadata as they were read; ``kind`` is the format that they name.

    Raises FileError if they are not as :func:`seal` made them, or of another format version.
    """
    if not isinstance(metadata, Mapping) or metadata.get("format") != kind:
        raise unusable(path, f"its metadata do not say format {kind!r}")
    if metadata.get("format_version") != VERSION:
        raise FileError(
            os.fspath(path),
            f"has format version {metadata.get('format_version')!r}",
            f"cspace {__version__} reads version {VERSION} only",
            f"open it with the version of cspace that wrote it ({metadata.get('library_version', 'unknown')}), or "
            "build it again",
        )
    missing = [key for key in (*_KEYS, "digests", "digest") if key not in metadata]
    if missing:
        raise unusable(path, f"its metadata lack {', '.join(missing)}")
    if metadata["digest"] != digest_of(_text(metadata)):
        raise unusable(path, "its metadata differ from their digest")
    return dict(entry.rsplit(":", 1) for entry in metadata["digests"].split())


def turns_of(names: Iterable[str]) -> tuple[str, ...]:
    """Those of some names that tell of rotation cells, and what lacks to them; none where the robot does not turn."""
    there = set(names)
    kinds = (tuple(kind.COORDINATES) for kind in Rotations.KINDS.values())
    return next((kind for kind in kinds if there.intersection(kind[:1])), ())


def check_names(names: Sequence[str], metadata: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Raise FileError unless the arrays of a map are those that it needs, and known ones."""
    required = (*_REQUIRED, *AXES[: len(metadata["shape"])], *turns_of(names))
    lacking = [name for name in required if name not in names]
    if lacking:
        raise unusable(path, f"it holds no {' and no '.join(lacking)}")
    strange = [name for name in names if name not in stored()]
    if strange:
        raise unusable(path, f"it holds {', '.join(strange)}, which no map does")


def check_kind(name: str, array: Any, metadata: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Raise FileError for an array, or its header, of another shape or type than the map needs."""
    dim = len(metadata["shape"])
    sizes = dict(zip(AXES, metadata["shape"], strict=False)) | {"slice": metadata["slices"]}
    sizes |= stored()[name].sizes
    sizes |= {
        "corner": 2 * dim + 1,
        "rotation": metadata["rotations"] or 1,
        "byte": array.shape[0] if array.shape else 0,
    }
    shape = tuple(sizes[axis] for axis in axes_of(name, dim))
    if tuple(array.shape) != shape or array.dtype != stored()[name].dtype:
        given = f"{array.dtype} {tuple(array.shape)}"
        raise unusable(path, f"its array {name!r} is {given} where {stored()[name].dtype} {shape} is needed")


def check_states(state: NDArray[np.uint8], path: str | os.PathLike[str]) -> None:
    """Raise FileError for states that are none."""
    if state.size and state.max() > BLOCKED:
        raise unusable(path, f"its array 'state' holds {state.max()}, which is none of the states 0 to {BLOCKED}")


def unusable(path: str | os.PathLike[str], what: str) -> FileError:
    """The error for a saved map that cannot be trusted, and so is not opened at all."""
    return FileError(str(Path(path)), f"is not a usable map: {what}", *_WHOLE)


def decoding_map(path: str | os.PathLike[str]) -> AbstractContextManager[None]:
    """Turn whatever a damaged map makes the decoders in a block raise into one error for the map."""
    return decoding(path, "usable map", *_WHOLE)


def digest_of(content: bytes | memoryview) -> str:
    """Digest of bytes (SHA-256)."""
    return hashlib.sha256(content).hexdigest()


def digest_of_array(array: NDArray[Any]) -> str:
    """Digest of an array's type, shape and values, the same on every machine."""
    portable = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    digest = hashlib.sha256(f"{portable.dtype.str}{array.shape}".encode())
    digest.update(portable.data)
    return digest.hexdigest()


def _text(metadata: Mapping[str, Any]) -> bytes:
    """What the digest of the metadata is of."""
    return json.dumps({key: value for key, value in metadata.items() if key != "digest"}, sort_keys=True).encode()


def write_store(contents: Contents, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map as a Zarr folder, which ``xarray.open_zarr`` reads too; it replaces no folder of anything else.

    Raises FileError as :func:`cspace.files.access.replacing`.
    """
    with replacing(path, overwrite, folder=_is_ours) as temporary:
        for name, content in _encoded(metadata_of(contents), arrays_of(contents)):
            file = temporary / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)


def read_store(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Metadata and arrays of a map that :func:`write_store` wrote; very many states in two bits each.

    Raises FileError if the folder cannot be read, is not such a map, or any part of it is missing, truncated or
    changed.
    """
    with decoding_map(path):
        metadata, digests = _opened(path)
        names = [name.removesuffix(f"/{_ROOT}") for name in digests if name.endswith(f"/{_ROOT}")]
        check_names(names, metadata, path)
        files = {name: _proven(path, name, digests) for name in digests}
        return metadata, {name: _array(path, name, metadata, files) for name in names}


def read_slice(
    path: str | os.PathLike[str], number_of: Callable[[Mapping[str, NDArray[Any]]], int]
) -> NDArray[np.uint8]:
    """Read the states of one slice of a map that :func:`write_store` wrote.

    `number_of` gives the number of the slice from the arrays of the rotation cells. Nothing else is read; what is read
    is checked as :func:`read_store` does.

    Raises FileError as :func:`read_store`, and what `number_of` raises.
    """
    with decoding_map(path):
        metadata, digests = _opened(path)

        def read(names: Sequence[str], chunks: str = "c/", number: int | None = None) -> dict[str, NDArray[Any]]:
            wanted = tuple(f"{name}/{part}" for name in names for part in (_ROOT, chunks))
            files = {file: _proven(path, file, digests) for file in digests if file.startswith(wanted)}
            return {name: _array(path, name, metadata, files, number) for name in names}

        table = read(("slice_of", *turns_of(file.split("/")[0] for file in digests)))
        number = number_of(table)
        return read(("state",), f"c/{number}/", number)["state"]


def _encoded(metadata: dict[str, Any], arrays: Mapping[str, Any]) -> Iterator[tuple[str, bytes]]:
    """The files of a Zarr folder with their names, some layers of chunks at a time; last the one that seals them.

    They are encoded in memory, because Zarr writes from threads that go on after an interruption.
    """
    import zarr
    from zarr.codecs import Crc32cCodec, ZstdCodec
    from zarr.storage import MemoryStore

    files: dict[str, Any] = {}
    digests: dict[str, str] = {}
    grid = grid_of(metadata)

    def finished(ending: str) -> Iterator[tuple[str, bytes]]:
        for name in sorted(name for name in files if ending in name):  # not as they happen to be ready
            content = files.pop(name).to_bytes()
            digests[name] = digest_of(content)
            yield name, content

    group = zarr.create_group(MemoryStore(files), zarr_format=3)
    for name, array in arrays.items():
        chunks = _chunks(array.shape, axes_of(name, grid.dim))
        codecs, options = [ZstdCodec(level=3), Crc32cCodec()], zarr_options(name, grid)
        stored = group.create_array(
            name, shape=array.shape, dtype=array.dtype, chunks=chunks, compressors=codecs, **options
        )
        step = chunks[0] * max(1, TOGETHER // (chunks[0] * math.prod(array.shape[1:])))
        for start in range(0, len(array), step):
            stored[start : start + step] = array[start : start + step]
            yield from finished("/c/")
    yield from finished(f"/{_ROOT}")
    document = json.loads(files[_ROOT].to_bytes())
    # Global "coordinates" tell readers of the CF conventions which arrays label others.
    labels = {"coordinates": " ".join((*turns_of(arrays), "slice_of"))}
    document["attributes"] = seal(metadata | labels, digests)
    yield _ROOT, _written(document)


def _written(document: Mapping[str, Any]) -> bytes:
    """The one way in which the root's text is written."""
    return json.dumps(document, indent=2).encode()


def _chunks(shape: tuple[int, ...], axes: tuple[str, ...]) -> tuple[int, ...]:
    """Shape of the chunks of an array."""
    longest = [CHUNK.get(len(shape), 1)] * len(shape)
    if axes[0] == "slice" and len(shape) > 2:
        longest = [1] + [SLICE_CHUNK[len(shape) - 1]] * (len(shape) - 1)
    return tuple(max(1, min(pair)) for pair in zip(shape, longest, strict=True))


def _opened(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Metadata, checked, and the digest of each file."""
    if not Path(path, _ROOT).exists():
        raise unusable(path, f"it holds no {_ROOT}")
    content = read_bytes(Path(path, _ROOT), "saved map", memory=8.0)
    document = json.loads(content)
    metadata: dict[str, Any] = document["attributes"]
    digests = unseal(metadata, path)
    if content != _written(document) or set(document) != {"attributes", "zarr_format", "node_type"}:
        raise unusable(path, f"its {_ROOT} was changed")
    if (document["zarr_format"], document["node_type"]) != (3, "group"):
        raise unusable(path, f"its {_ROOT} was changed")
    return metadata, digests


def _proven(path: str | os.PathLike[str], name: str, digests: Mapping[str, str]) -> bytes:
    """The content of a file of the folder, which agrees with its digest."""
    content = read_part(path, name, "part of a saved map")
    if content is None:
        raise unusable(path, f"its file {name!r} is missing")
    if digest_of(content) != digests[name]:
        raise unusable(path, f"its file {name!r} differs from its digest")
    return content


def _array(
    path: str | os.PathLike[str],
    name: str,
    metadata: Mapping[str, Any],
    files: Mapping[str, bytes],
    number: int | None = None,
) -> Any:
    """Decode one array, or slice `number` of it, from the files of a map."""
    with decoding_map(Path(path) / name):
        array = Layout.parse(json.loads(files[f"{name}/{_ROOT}"]))
    # Before reading: a forged shape could ask for more memory than there is.
    check_kind(name, array, metadata, path)
    has_overlap = "overlap" in {file.split("/")[0] for file in files}
    packed = name == "state" and number is None and is_packed(array.shape[1:], array.shape[0], has_overlap)
    size = math.prod(array.shape) * array.dtype.itemsize
    size = size // 4 if packed else size if number is None else size // array.shape[0]
    check_bytes(Path(path) / name, size, "unpacks to")

    def part(first: int, stop: int) -> NDArray[Any]:
        box = slice(first, stop), *(slice(0, n) for n in array.shape[1:])
        with decoding_map(Path(path) / name):
            values = array.read(box, lambda key: files.get(f"{name}/{key}"))
        if name == "state":
            check_states(values, path)
        return values

    if packed:
        states = PackedStates(array.shape)
        for k in range(len(states)):
            states.write(k, part(k, k + 1)[0])
        return states
    return part(0, array.shape[0]) if number is None else part(number, number + 1)[0]


def _is_ours(folder: Path) -> bool:
    """Whether a folder holds nothing but a map, whole or damaged, of this version or an earlier one."""
    parts = {_ROOT, "c"}
    known = {*stored(), "geometry", "vertices", "faces", "centers", "radii"}
    return all(
        (entry.name == _ROOT and entry.is_file())
        or (entry.name in known and entry.is_dir() and {part.name for part in entry.iterdir()} <= parts)
        for entry in folder.iterdir()
    )


def write_npz(contents: Contents, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map as an ``.npz`` file.

    ``numpy.load`` finds the arrays of :func:`cspace.store.saved.stored`: ``state`` (uint8 [slice, x, y] or
    [slice, x, y, z]: 0 free, 1 mixed, 2 blocked), ``slice_of`` (the slice of each rotation cell: the states by rotation
    are ``state[slice_of]``), ``x``, ``y`` and in space ``z`` (middles of the cells, metres), ``outer``, where they are
    needed ``inner``, ``overlap``, those of the overlap field, those of the rotation cells and ``shapes``; besides,
    ``lower``, ``spacing`` and ``metadata`` (JSON text).

    Raises FileError as :func:`cspace.files.access.replacing`.
    """
    members: dict[str, Any] = {
        **{name: np.asarray(array) for name, array in arrays_of(contents).items()},
        "lower": np.array(contents.grid.lower),
        "spacing": np.array(contents.grid.spacing),
    }
    sealed = seal(metadata_of(contents), {name: digest_of_array(array) for name, array in members.items()})
    members["metadata"] = json.dumps(sealed, sort_keys=True)
    # An open file, because np.savez would add a suffix to any name that does not end in lower-case ".npz".
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **members)


def read_npz(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Metadata and arrays of a map that :func:`write_npz` wrote.

    Raises FileError if the file cannot be read, is not such a map, or is truncated or changed.
    """
    file = existing(path, "saved map")
    with decoding_map(path), file.open("rb") as stream, zipfile.ZipFile(stream) as archive:
        names = archive.namelist()
        if len(set(names)) < len(names) or any(part in name for name in names for part in ("/", "\\", ":", "..")):
            raise unusable(path, "it has members whose names climb out of it, or twice the same")
        if "metadata.npy" not in names:
            raise unusable(path, "it holds no metadata")
        metadata = _metadata(archive, path)
        digests = unseal(metadata, path)
        check_names([name for name in digests if name not in _NUMBERS], metadata, path)
        arrays = {}
        for name, digest in digests.items():
            if f"{name}.npy" not in names:
                raise unusable(path, f"its array {name!r} is missing")
            arrays[name] = _member(archive, name, metadata, path)
            if digest_of_array(arrays[name]) != digest:
                raise unusable(path, f"its array {name!r} differs from its digest")
    check_states(arrays["state"], path)
    return metadata, arrays


def read_metadata(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the metadata of a saved map or a store of tiles, unchecked.

    Raises FileError if they cannot be read.
    """
    if look_up(path, "saved map")[1] == "a folder":
        document = read_json(Path(path, _ROOT), "saved map")
        return dict(document["attributes"])
    with decoding_map(path), existing(path, "saved map").open("rb") as stream, zipfile.ZipFile(stream) as archive:
        return _metadata(archive, path)


def _metadata(archive: zipfile.ZipFile, path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the metadata of an archive."""
    if archive.getinfo("metadata.npy").file_size > _LONGEST:
        raise unusable(path, f"its metadata are over {_LONGEST} bytes long")
    metadata: dict[str, Any] = json.loads(str(_member(archive, "metadata", {}, path)[()]))
    return metadata


class _Header(NamedTuple):
    """What a member of an archive says of its array."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]


def _member(
    archive: zipfile.ZipFile, name: str, metadata: Mapping[str, Any], path: str | os.PathLike[str]
) -> NDArray[Any]:
    """An array of an archive, of the kind that the map needs; what it takes is known before it is unpacked."""
    size = archive.getinfo(f"{name}.npy").file_size
    with archive.open(f"{name}.npy") as stream:
        if np.lib.format.read_magic(stream) != (1, 0):
            raise ValueError(f"{name} is of another version of the format of NumPy")
        header = _Header(*np.lib.format.read_array_header_1_0(stream))
        if size != stream.tell() + header.dtype.itemsize * math.prod(header.shape):
            raise ValueError(f"{name} is longer or shorter than its header says")
        if name not in ("metadata", *_NUMBERS):
            check_kind(name, header, metadata, path)
        check_bytes(path, size, f"has an array {name!r} that unpacks to")
        stream.seek(0)
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))


SAVES: Final[Mapping[str, Callable[[Contents, str | os.PathLike[str], bool], None]]] = {
    ".zarr": write_store,
    "": write_store,
    ".npz": write_npz,
}
"""Formats that :func:`cspace.open` reads again, by suffix."""

SUFFIX_RULE: Final = "the suffix says which format to write"


def save(contents: Contents, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Save a map, complete, so that :func:`cspace.open` gives it back.

    Parameters
    ----------
    contents : Contents
    path : path-like
        ``.zarr`` or no suffix: a Zarr folder. ``.npz``: one NumPy file.
    overwrite : bool
        Whether an existing map may be replaced.

    Raises
    ------
    InputError
        If the suffix is another one.
    FileError
        If the output exists and may not be replaced, or cannot be written.
    """
    SAVES[suffix_of(path, SAVES, SUFFIX_RULE)](contents, path, overwrite)
