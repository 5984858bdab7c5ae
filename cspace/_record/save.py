"""Saved maps: Zarr folders of version 3 that any reader of Zarr opens.

The attributes of the folder describe the grid, the robot and the rest of the map; see
:func:`cspace._record.description.make_metadata`. Four more serve the reader: ``arrays`` names the
arrays, ``compressed`` is true if their chunks are compressed by zstd, ``shapes_bytes`` is the
length of the array ``shapes``, and ``digest`` is a SHA-256 digest. It
covers the attributes and every file of the arrays, in the order of ``arrays``.

The attributes determine the shape, type and chunks of each array. So a reader knows every size
before it unpacks anything, and refuses arrays that differ. Fill values are no state and no free
cell, so that a chunk that is lost to other software never reads as free space.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace import __version__
from cspace._files.access import (
    TEMPORARY_NAME,
    check_suffix,
    discard,
    read_bytes,
    read_member,
    replacing,
)
from cspace._files.zarr_folders import ROOT_FILE, Layout
from cspace._grid import Grid, check_reach
from cspace._record.contents import Contents
from cspace._record.description import (
    DERIVED,
    FORMAT,
    VERSION,
    NamedArray,
    collect_arrays,
    decode_shapes,
    describe_array,
    describe_arrays,
    find_rotation_arrays,
    list_axes,
    make_grid,
    make_metadata,
    make_scene_grid,
)
from cspace._record.exterior import Exterior
from cspace._robot import Robot
from cspace._rotations import Rotations
from cspace._support.arrays import AXES, BLOCKED, Ints, StrPath
from cspace._support.check import check_not_negative
from cspace._support.limits import check_bytes
from cspace._workspace import Workspace
from cspace.errors import FileError

NO_DIGEST: Final = "0" * 64
"""Placeholder of the digest in the attributes while the digest is computed."""

_KIND: Final = "saved map"

_UNITS: Final = {"m", "rad"}

_LATER_ARRAY: Final = re.compile(r"[a-z][a-z0-9_]*")
"""Names of arrays; unknown ones are skipped, because later releases may add arrays."""

_PART: Final = re.compile(r"whole|\d+(\.\d+)+")
"""Names of folders with maps in tiled maps."""

_ARRAY_ENTRY: Final = re.compile(r"(zarr\.json|c(\.\d+)+)?")
"""Files in the folder of an array."""


# ---- folders and their digest --------------------------------------------------------------------


def write_folder(
    folder: Path, attributes: Mapping[str, Any], files: Iterable[tuple[str, bytes]] = ()
) -> None:
    """Write a Zarr group with a digest of all its files.

    ``files`` are names, relative to the folder, and contents. The attributes are written last, so a
    folder that has them is complete.
    """
    # The digest is part of the attributes, so it is computed with zeros in its own place.
    document = {
        "zarr_format": 3,
        "node_type": "group",
        "attributes": {"digest": NO_DIGEST, **attributes},
    }
    root = json.dumps(document, indent=2).encode()
    digest = hashlib.sha256(root)
    folder.mkdir(exist_ok=True)
    for name, content in files:
        _add_file(digest, name, content)
        file = folder / name
        # Make the folder of an array, but not the map's: if another process has removed it, writing
        # must fail.
        if file.name == ROOT_FILE:
            file.parent.mkdir(exist_ok=True)
        file.write_bytes(content)
    (folder / ROOT_FILE).write_bytes(_replace_digest(root, NO_DIGEST, digest.hexdigest()))


def _replace_digest(root: bytes, old: str, new: str) -> bytes:
    """Replace the digest in the text of the attributes."""
    return root.replace(old.encode(), new.encode(), 1)  # the digest is the first attribute


def _add_file(digest: Any, name: str, content: bytes) -> None:
    """Update a digest with the name, size and content of a file."""
    digest.update(f"\n{name} {len(content)}\n".encode())
    digest.update(content)


def is_map_folder(folder: Path) -> bool:
    """Return True if a folder is a saved map, whole or damaged, and holds nothing else."""
    saved = MapFolder(folder)
    return (saved.exists() or MapFolder(folder, tiles=True).exists()) and saved.holds_only_map()


def _is_entry(path: str) -> bool:
    """Return True if a saved map, in tiles or not, may have a file or folder of this name."""
    first, _, rest = path.partition("/")
    if _PART.fullmatch(first):
        first, _, rest = rest.partition("/")
    if re.fullmatch(TEMPORARY_NAME, first):
        return True
    if first in describe_arrays():
        return bool(_ARRAY_ENTRY.fullmatch(rest))
    return first in ("", ROOT_FILE) and not rest


# ---- maps ----------------------------------------------------------------------------------------


class MapFolder:
    """The folder of a saved map, or of a map in tiles.

    Attributes
    ----------
    path : Path
    form : str
        Format that the attributes declare.
    """

    SUFFIXES: Final[tuple[str, str]] = (".zarr", "")
    """Suffixes of saved maps."""

    def __init__(self, path: StrPath, tiles: bool = False) -> None:
        """Name a folder that may be missing."""
        self.path = Path(path)
        self.form = "cspace-tiles" if tiles else FORMAT

    def exists(self) -> bool:
        """Return True if the folder declares the format."""
        try:
            root = json.loads(read_bytes(self.path / ROOT_FILE, _KIND, memory=8.0))
            return bool(root["attributes"]["format"] == self.form)
        except (FileError, KeyError, TypeError, ValueError, RecursionError):
            return False

    def holds_only_map(self) -> bool:
        """Return True if it is a folder, and all below have names as in a map."""
        if not self.path.is_dir():
            return False
        below = (each.relative_to(self.path).as_posix() for each in self.path.rglob("*"))
        return all(map(_is_entry, below))

    def remove(self) -> None:
        """Remove the folder; raise FileError if it holds more than a map."""
        if not self.holds_only_map():
            raise FileError(str(self.path), "holds more than a saved map", "only maps are removed")
        discard(Path(os.path.realpath(self.path)))

    def remove_leftovers(self) -> None:
        """Remove files of killed or late processes from the folder."""
        for leftover in self.path.glob(".cspace-*"):
            if re.fullmatch(TEMPORARY_NAME, leftover.name):
                discard(leftover)

    def fail(self, what: str) -> FileError:
        """Return a FileError for a saved map that is damaged or forged."""
        return FileError(
            str(self.path),
            f"is not a usable map: {what}",
            "a saved map must be complete and unchanged",
        )

    @contextmanager
    def reporting_damage(self) -> Iterator[None]:
        """Turn any exception in the block into a FileError for the map.

        A file with a valid digest can still be forged, and make any library raise any error.
        """
        try:
            yield
        except (FileError, MemoryError, UserWarning):  # UserWarning if the caller makes it an error
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {' '.join(str(error).split()):.200}"
            raise self.fail(f"its parts make no map ({reason})") from error

    def write(
        self,
        contents: Contents,
        compress: bool = True,
        derived: Mapping[str, NDArray[Any]] | None = None,
        only: Collection[str] = (),
        **extra: Any,
    ) -> None:
        """Write a map into the folder, which is new; ``extra`` are additional attributes.

        ``only`` names the arrays to write; the default are all.
        """
        arrays = collect_arrays(contents)
        for name, values in (derived or {}).items():
            arrays[name] = describe_array(name, values, contents.grid)
        if only:
            arrays = {name: array for name, array in arrays.items() if name in only}
        shapes = arrays.get("shapes")
        # The metadata describe the map; a reader needs the others to check and unpack its arrays.
        attributes = {
            **make_metadata(contents),
            "arrays": " ".join(arrays),
            "compressed": compress,
            "shapes_bytes": 0 if shapes is None else len(shapes.values),
            # The CF conventions name coordinate arrays here.
            "coordinates": " ".join((*find_rotation_arrays(arrays), "slice_of")),
            "format": self.form,
            **extra,
        }
        write_folder(self.path, attributes, _iterate_files(arrays, compress))

    def read(self) -> tuple[Contents, dict[str, Any]]:
        """Read a saved map and all its attributes, and check its digest.

        Raises FileError if the map is missing, truncated, changed, too large for memory, of another
        format or version, or invalid.
        """
        attributes, arrays = self.read_arrays()
        with self.reporting_damage():
            contents = _make_contents(attributes, make_grid(attributes), arrays)
            self.check_metadata(attributes, contents)
            return contents, attributes

    def read_arrays(
        self, required: Sequence[str] = ()
    ) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Read the attributes and arrays, and check the digest and the states.

        ``required`` names the arrays that must be there; the default are those of a whole map.
        Raises FileError as :meth:`read`.
        """
        attributes, digest = self._read_root()
        with self.reporting_damage():
            if not required and "stamp" in attributes:
                raise self.fail("it is one tile; open the folder of the whole map")
            layouts = _expect_layouts(attributes, make_grid(attributes), required)
            check_bytes(self.path, sum(layout.nbytes for layout in layouts.values()), "unpacks to")
            arrays = _read_arrays(self, attributes["arrays"].split(), layouts, digest)
            if digest.hexdigest() != attributes["digest"]:
                raise self.fail("its files differ from their digest")
            # The digest is right, but the files may be forged.
            highest = arrays["cell_states"].max() if "cell_states" in arrays else BLOCKED
            if highest > BLOCKED:
                raise ValueError(f"it holds the state {highest}, but states are 0 to 2")
            return attributes, arrays

    def check_metadata(self, attributes: Mapping[str, Any], contents: Contents) -> None:
        """Raise FileError unless attributes describe the map that was made."""
        for name, expected in make_metadata(contents).items():
            value = attributes.get(name)
            # Attributes whose values a reader cannot check against the rest of a map.
            if name not in ("format", "library_version", "robot") and value != expected:
                raise self.fail(f"its attribute {name!r} is {value!r:.40}, not {expected!r:.40}")

    def read_attributes(self) -> dict[str, Any]:
        """Read a saved map's attributes, unchecked.

        Raises FileError if the file is missing or malformed, or of another format or version.
        """
        return self._read_root()[0]

    def _read_root(self) -> tuple[dict[str, Any], Any]:
        """Read the attributes, and begin the digest.

        Returns the attributes, unchecked, and a ``hashlib`` object to which the caller adds the
        other files.
        """
        content = read_bytes(self.path / ROOT_FILE, _KIND, memory=8.0)
        with self.reporting_damage():
            attributes = json.loads(content)["attributes"]
            if attributes["format"] != self.form:
                raise self.fail(f"its attributes do not say format {self.form!r}")
            version = attributes["format_version"]
            if type(version) is not int or version != VERSION:
                rule = f"cspace {__version__} reads only version {VERSION}"
                raise FileError(str(self.path), f"has format version {version!r:.40}", rule)
            digest = attributes["digest"]
            if not re.fullmatch("[0-9a-f]{64}", digest):
                raise self.fail("its digest is none")
            return attributes, hashlib.sha256(_replace_digest(content, digest, NO_DIGEST))


# ---- writing -------------------------------------------------------------------------------------


def save(
    contents: Contents,
    path: StrPath,
    overwrite: bool = False,
    compress: bool = True,
    derived: Mapping[str, NDArray[Any]] | None = None,
    **extra: str,
) -> None:
    """Save a map as a whole Zarr folder; see :meth:`cspace.CSpace.save`.

    ``derived`` are additional arrays, with names in ``DERIVED``, and ``extra`` attributes.
    """
    rule = "a map is saved as a Zarr folder; space.export writes other formats"
    check_suffix(path, MapFolder.SUFFIXES, rule, is_output=True)
    with replacing(path, overwrite, folder=is_map_folder) as temporary:
        MapFolder(temporary).write(contents, compress, derived, **extra)


def _iterate_files(arrays: Mapping[str, NamedArray], compress: bool) -> Iterator[tuple[str, bytes]]:
    """Yield the name and content of each file of the arrays."""
    for name, (axes, values, attributes) in arrays.items():
        stored = describe_arrays()[name]
        layout = Layout.of(values.shape, stored.dtype, compress)
        fill_value = stored.fill_value
        yield f"{name}/{ROOT_FILE}", layout.describe(fill_value, attributes, axes)
        for file, cells in layout.iterate_chunks():
            yield f"{name}/{file}", layout.encode(values[cells], fill_value)


# ---- reading -------------------------------------------------------------------------------------


def _expect_layouts(
    attributes: Mapping[str, Any], grid: Grid, required: Sequence[str]
) -> dict[str, Layout]:
    """Return the layout that the attributes require of each array, by name.

    ``required`` are as for :meth:`MapFolder.read_arrays`. Arrays that a reader skips have no
    layout. Raises ValueError if an array is missing or has no valid name, or a size is not
    positive.
    """
    names = attributes["arrays"].split()
    known = describe_arrays()
    arrays = {name: known[name] for name in names if name in known and name not in DERIVED}
    scene = make_scene_grid(attributes, grid)
    if not required:
        required = [
            *("cell_states", "outer", "slice_of"),
            *AXES[: scene.dim],
            *find_rotation_arrays(names),
            *(["scene_outer"] if scene is not grid else []),
        ]
    missing = [name for name in required if name not in names]
    unknown = sorted(name for name in names if not _LATER_ARRAY.fullmatch(name))
    if missing or unknown or len(set(names)) < len(names):
        raise ValueError(f"it lacks {missing} and has {unknown or names}")
    # Lengths of the axes by name; arrays of rotation cells have additional axes.
    sizes = {
        "slice": attributes["slices"],
        "rotation": attributes["rotations"],
        "corner": 2 * grid.dim + 1,
        "byte": attributes["shapes_bytes"],
        **dict(zip(AXES, scene.shape, strict=False)),
    }
    layouts = {}
    for name, expected in arrays.items():
        all_sizes = {**sizes, **expected.sizes}
        shape = [all_sizes[axis] for axis in list_axes(name, grid.dim)]
        if min(shape) < 1:
            raise ValueError(f"its array {name!r} would have the shape {shape}")
        layouts[name] = Layout.of(shape, expected.dtype, attributes["compressed"])
    return layouts


def _read_arrays(
    saved: MapFolder, names: Sequence[str], layouts: Mapping[str, Layout], digest: Any
) -> dict[str, NDArray[Any]]:
    """Read arrays, and update the digest with their files.

    Arrays without a layout only update the digest.
    """

    def read(name: str) -> bytes:
        """Read a file of the map, and update the digest with it."""
        content = read_member(saved.path, name, "part of a saved map")
        if content is None:
            raise saved.fail(f"its file {name!r} is missing")
        _add_file(digest, name, content)
        return content

    arrays = {}
    for name in names:
        given = Layout.parse(json.loads(read(f"{name}/{ROOT_FILE}")))
        layout = layouts.get(name)
        if layout is None:
            for file, _ in given.iterate_chunks():
                read(f"{name}/{file}")
            continue
        if given != layout:
            problem = f"is {given.dtype} {given.shape}, not {layout.dtype} {layout.shape}"
            raise ValueError(f"its array {name!r} {problem}, or has other chunks")
        values = np.empty(layout.shape, dtype=layout.dtype)
        for file, cells in layout.iterate_chunks():
            chunk = layout.decode(read(f"{name}/{file}"))
            # Chunks at the border of the array are stored whole, and cut here.
            inside = tuple(slice(0, side.stop - side.start) for side in cells)
            values[cells] = chunk[inside]
        arrays[name] = values
    return arrays


def _make_contents(
    attributes: Mapping[str, Any], grid: Grid, arrays: Mapping[str, NDArray[Any]]
) -> Contents:
    """Return the map that attributes and arrays describe.

    Raises any error if they are invalid.
    """
    # The digest is right, but the files may be forged, so each part is checked before its use.
    if not _UNITS.issuperset(grid.units):
        raise ValueError(f"its units are {grid.units}")
    robot = _read_robot(attributes["robot"])
    scene = make_scene_grid(attributes, grid)
    rotations, slice_of = _check_rotations(attributes, scene, robot, arrays)
    shapes = decode_shapes(arrays["shapes"]) if "shapes" in arrays else None
    if robot.dim != scene.dim or any(shape.dim != scene.dim for shape in shapes or ()):
        raise ValueError("its robot, obstacles and grid differ in dimension")
    outside = attributes["outside"]
    floor = attributes.get("floor_m")
    prefix = "" if floor is None else "scene_"
    outer = arrays[f"{prefix}outer"]
    inner = arrays.get(f"{prefix}inner", outer)
    source = str(attributes["workspace_source"])
    margin = check_not_negative(attributes["margin_m"], "margin_m")
    check_reach(margin / grid.spacing, "margin_m", "the robot")
    exterior = None
    if "exterior" in arrays:
        exterior = Exterior.checked(arrays["exterior"], outside)
    return Contents(
        Workspace(scene, outer, inner, source, arrays.get(f"{prefix}unknown"), shapes),
        robot,
        rotations,
        slice_of,
        arrays["cell_states"],
        outside,
        margin=margin,
        overlap_counts=arrays.get("overlap_counts"),
        exterior=exterior,
        proves_blocked=attributes["inner"] == 1,
        floor=floor,
    )


@lru_cache(maxsize=4)
def _read_robot(text: str) -> Robot:
    """Return the robot of a JSON text, cached for all tiles."""
    return Robot.from_spec(json.loads(text))


def _check_rotations(
    attributes: Mapping[str, Any], grid: Grid, robot: Robot, arrays: Mapping[str, NDArray[Any]]
) -> tuple[Rotations, Ints]:
    """Return a map's rotation cells and slices.

    Raises ValueError if a stored array differs from what grid, rotation cells and robot determine.
    """
    names = find_rotation_arrays(arrays)
    rotations = Rotations._from_stored_arrays({name: arrays[name] for name in names})
    rotations._check_dimension(robot.dim)
    slice_of = rotations._assign_slices(robot.shape)
    if slice_of.max() + 1 != attributes["slices"]:
        raise ValueError("its number of slices differs from that of its robot")
    expected = {"slice_of": slice_of, **rotations._stored_arrays}
    expected |= {axis: grid.centers(k) for k, axis in enumerate(AXES[: grid.dim])}
    for name, values in expected.items():
        # Maximum difference of coordinates between machines; proofs have far more slack.
        rounding = 1e-12 * max(1.0, float(np.abs(values).max()))
        if not np.allclose(arrays[name], values, rtol=0.0, atol=rounding):
            raise ValueError(f"its array {name!r} does not match its grid, rotations and robot")
    return rotations, slice_of
