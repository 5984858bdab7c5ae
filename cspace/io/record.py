"""What a saved map holds, whatever the format: one table of its arrays, plain metadata, and digests of all of it."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from itertools import compress
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError
from cspace.grid import Grid
from cspace.io.input import decoding
from cspace.map.contents import Contents
from cspace.map.storage import read_only, read_only_of
from cspace.rotations import Rotations
from cspace.shapes import Shape, shape_from_spec
from cspace.states import BLOCKED, FIELDS, NAMES
from cspace.version import __version__

FORMAT: Final = "cspace-map"
VERSION: Final = 2
"""Version of the format; a reader refuses every other one."""

AXES: Final = ("x", "y", "z")

STACKED: Final = ("state", "overlap", *FIELDS)
"""Arrays that hold one slice after the other."""

TURNS: Final = tuple({name for kind in Rotations.KINDS.values() for name in kind.COORDINATES})
"""Arrays that tell of the rotation cells; those of one kind are there where the robot turns."""

_WHOLE: Final = (
    "a saved map is opened only if it is complete and unchanged",
    "copy it again from where it is whole, or build it again",
)
_REQUIRED: Final = ("state", "outer", "slice_of")
_KEYS: Final = (
    *("format", "format_version", "library_version", "lower", "spacing", "shape", "outside", "margin", "precision"),
    *("rotations", "slices", "robot", "workspace_source"),
)


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
    """

    axes: tuple[str, ...]
    dtype: str
    lost: Any
    about: Mapping[str, Any]


def _stored(axes: str, dtype: str, lost: Any, name: str, **about: Any) -> Stored:
    return Stored(tuple(axes.split()), dtype, lost, {"long_name": name, **about})


def _floats(axes: str, name: str, units: str, **about: str) -> Stored:
    return _stored(axes, "float64", math.nan, name, units=units, **about)


_FIELD_NAMES: Final = (
    "overlap of the descriptors of robot and obstacles",
    *(f"its derivative along {axis}" for axis in AXES),
)

ARRAYS: Final[dict[str, Stored]] = {
    "state": _stored(
        "slice cells",
        "uint8",
        255,
        "state of the configurations in a cell",
        flag_values=list(range(len(NAMES))),
        flag_meanings=" ".join(NAMES),
    ),
    "outer": _stored("cells", "bool", True, "workspace cells that meet an obstacle"),
    "inner": _stored("cells", "bool", True, "workspace cells that lie in obstacles"),
    "unknown": _stored("cells", "bool", True, "workspace cells that nothing is known of"),
    "overlap": _stored(
        "slice cells", "int32", -1, "number of coinciding pairs of obstacle cell and robot offset", units="1"
    ),
    **{
        name: _stored("slice cells", "float64", math.inf, what) for name, what in zip(FIELDS, _FIELD_NAMES, strict=True)
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
    "yaw": _floats("rotation", "representative of a rotation cell: its middle", "rad", bounds="yaw_bounds"),
    "yaw_bounds": _floats("rotation bound", "borders of a rotation cell", "rad"),
    "quaternion": _floats("rotation component", "representative of a rotation cell, as (x, y, z, w)", "1"),
    "covering_angle": _floats(
        "rotation", "largest angle between a rotation of a rotation cell and its representative", "rad"
    ),
    "shapes": _stored("byte", "int8", -1, "obstacles as a JSON list of what makes each shape again"),
    **{axis: _floats(axis, f"{axis} of the middle of a cell", "m", axis=axis.upper()) for axis in AXES},
}
"""Every array that a map may hold."""


def axes_of(name: str, dim: int) -> tuple[str, ...]:
    """The name of each axis of an array, on a grid of ``dim`` axes."""
    return tuple(part for axis in ARRAYS[name].axes for part in (AXES[:dim] if axis == "cells" else (axis,)))


def grid_of(metadata: Mapping[str, Any]) -> Grid:
    """The grid of a map, from its metadata; without units, in metres."""
    shape = tuple(metadata["shape"])
    axes, units = metadata.get("axes", "").split()[: len(shape)], metadata.get("units", "").split()
    return Grid(metadata["lower"], metadata["spacing"], shape, axes or None, units or None)


def attributes_of(name: str, grid: Grid) -> dict[str, Any]:
    """The attributes of an array on a grid, with its unit where that depends on its axes."""
    about, dim = dict(ARRAYS[name].about), grid.dim
    if name in AXES:
        number = AXES.index(name)
        about |= {"long_name": f"{grid.axes[number]} of the middle of a cell", "units": grid.units[number]}
    if name in FIELDS:
        power = dim - (name != FIELDS[0])
        about["units"] = "m" if power == 1 else f"m{power}"
    return about


def zarr_options(name: str, grid: Grid) -> dict[str, Any]:
    """What an array of a map is created with in a Zarr group, beside its shape, type and encoding."""
    return {
        "fill_value": ARRAYS[name].lost,
        "attributes": attributes_of(name, grid),
        "dimension_names": axes_of(name, grid.dim),
        "config": {"write_empty_chunks": True},
    }


def metadata_of(contents: Contents) -> dict[str, Any]:
    """All of a map but its arrays, as plain values: text, numbers and lists of numbers.

    ``lower`` and ``spacing`` in metres; ``axes`` the names of the numbers of a configuration and ``units`` of those of
    the cells; ``endless`` the axes that close in a circle, if there are any; ``rotations`` the number of rotation
    cells; ``robot`` as JSON text for ``Robot.from_spec``.
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
        "rotations": contents.rotations.count,
        "slices": len(contents.states),
        "robot": contents.robot.definition,
        "workspace_source": contents.workspace.source,
    }


def arrays_of(contents: Contents) -> dict[str, Any]:
    """The arrays of a map, by the names of :data:`ARRAYS`. No cells are copied; states may be in two bits each.

    ``inner`` is there only if it differs from ``outer``, ``unknown`` only if there are such cells, ``overlap`` only if
    the map was built with it, :data:`FIELDS` only if it carries an overlap field, :data:`TURNS` only if the robot
    turns, and ``shapes`` only if the obstacles are known as such.
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
    kinds = (kind.COORDINATES for kind in Rotations.KINDS.values())
    return next((kind for kind in kinds if there.intersection(kind[:1])), ())


def check_names(names: Sequence[str], metadata: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Raise FileError unless the arrays of a map are those that it needs, and known ones."""
    required = (*_REQUIRED, *AXES[: len(metadata["shape"])], *turns_of(names))
    lacking = [name for name in required if name not in names]
    if lacking:
        raise unusable(path, f"it holds no {' and no '.join(lacking)}")
    strange = [name for name in names if name not in ARRAYS]
    if strange:
        raise unusable(path, f"it holds {', '.join(strange)}, which no map does")


def check_kind(name: str, array: Any, metadata: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Raise FileError for an array, or its header, of another shape or type than the map needs."""
    dim = len(metadata["shape"])
    sizes = dict(zip(AXES, metadata["shape"], strict=False)) | {"bound": 2, "component": 4, "slice": metadata["slices"]}
    sizes |= {
        "corner": 2 * dim + 1,
        "rotation": metadata["rotations"] or 1,
        "byte": array.shape[0] if array.shape else 0,
    }
    shape = tuple(sizes[axis] for axis in axes_of(name, dim))
    if tuple(array.shape) != shape or array.dtype != ARRAYS[name].dtype:
        given = f"{array.dtype} {tuple(array.shape)}"
        raise unusable(path, f"its array {name!r} is {given} where {ARRAYS[name].dtype} {shape} is needed")


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
