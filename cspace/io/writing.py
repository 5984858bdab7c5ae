"""Maps, written: by the suffix of the name, or as labelled arrays for analysis.

Some formats are written only. Cells for ParaView go into VTK image data (Kitware, VTK file formats): an XML header,
then the arrays raw, each after its length in bytes. Of the border of the free space as a mesh, PLY and OBJ keep every
bit of the coordinates and the shared vertices. STL holds single precision, about seven digits, and three corners of its
own for each triangle.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Floats, Ints, StrPath, frozen
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.io.files import replacing, suffix_of
from cspace.io.geotiff import write_geotiff
from cspace.io.rosmap import write_ros_map
from cspace.io.store import AXES, STACKED, arrays_of, attributes_of, axes_of, metadata_of, write_npz, write_store
from cspace.map.contents import Contents
from cspace.memory import check_memory
from cspace.raster.bitmaps import cell_squares
from cspace.states import BLOCKED, FREE, MIXED

if TYPE_CHECKING:
    import xarray


_BYTES: Final = 160
"""For each square of the border: its corners, its triangles, and its share of the vertices."""

MOST: Final = 2**31 - 1
"""Triangles that every format can count."""

BLOCK: Final = 2**16
"""Rows that are encoded at once."""

_TYPES: Final = {
    "uint8": ("UInt8", "|u1"),
    "bool": ("UInt8", "|u1"),
    "int32": ("Int32", "<i4"),
    "float64": ("Float64", "<f8"),
}
"""How VTK names a type, and how it is stored."""

_SLAB: Final = 2**24
"""Cells that are turned from [x, y, z] into VTK's order at once."""


def write_vti(
    arrays: Mapping[str, NDArray[Any]],
    grid: Grid,
    path: str | os.PathLike[str],
    overwrite: bool = False,
    about: Mapping[str, Floats] | None = None,
) -> None:
    """Write arrays over the cells of a grid, by name, as a ``.vti`` file.

    They become cell data, the first of which is shown; the origin is the lower corner of the grid. A plane grid becomes
    an image at z = 0. Arrays are of uint8, bool, which is stored as uint8, 0 and 1, int32 or float64. ``about``, arrays
    of float64, shape (n,), become field data: numbers about the whole.

    Raises InputError if an array has another shape or type, and FileError as :func:`cspace.io.files.replacing`.
    """
    for name, array in arrays.items():
        if array.shape != grid.shape or str(array.dtype) not in _TYPES:
            raise InputError(
                name,
                f"has shape {array.shape} and type {array.dtype}",
                f"it must have the grid's shape {grid.shape} and be {', '.join(_TYPES)}",
                "convert it",
                value=array,
            )
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        file.write(_vti_header(arrays, grid, about or {}).encode())
        for numbers in (about or {}).values():
            file.write(np.array(8 * numbers.size, dtype="<u8").tobytes() + numbers.astype("<f8").tobytes())
        for array in arrays.values():
            kind = np.dtype(_TYPES[str(array.dtype)][1])
            file.write(np.array(array.size * kind.itemsize, dtype="<u8").tobytes())
            for slab in _slabs(array, kind):
                file.write(slab.data)
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")


def _vti_header(arrays: Mapping[str, NDArray[Any]], grid: Grid, about: Mapping[str, Floats]) -> str:
    """Everything before the first array."""
    missing = 3 - grid.dim
    extent = " ".join(f"0 {count}" for count in (*grid.shape, *[0] * missing))
    origin = " ".join(map(repr, (*grid.lower, *[0.0] * missing)))
    offset = 0

    def declared(parts: Mapping[str, NDArray[Any]], counted: bool) -> str:
        nonlocal offset
        lines = []
        for name, array in parts.items():
            kind, stored = _TYPES[str(array.dtype)]
            count = f' NumberOfTuples="{array.size}"' * counted
            place = f'{count} format="appended" offset="{offset}"'
            lines.append(f'        <DataArray type="{kind}" Name={quoteattr(name)}{place}/>\n')
            offset += 8 + array.size * np.dtype(stored).itemsize
        return "".join(lines)

    fields = f"      <FieldData>\n{declared(about, True)}      </FieldData>\n" if about else ""
    return (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'  <ImageData WholeExtent="{extent}" Origin="{origin}" '
        f'Spacing="{" ".join([repr(grid.spacing)] * 3)}">\n'
        f'{fields}    <Piece Extent="{extent}">\n'
        f"      <CellData Scalars={quoteattr(next(iter(arrays)))}>\n{declared(arrays, False)}      </CellData>\n"
        '    </Piece>\n  </ImageData>\n  <AppendedData encoding="raw">\n   _'
    )


def _slabs(array: NDArray[Any], kind: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    """The values of an array in VTK's order, x fastest, a slab of the last axis at a time."""
    layers = array.reshape(array.shape[0], -1, array.shape[-1])
    step = max(1, _SLAB * layers.shape[-1] // layers.size)
    for start in range(0, layers.shape[-1], step):
        part = layers[..., start : start + step]
        turned = np.empty(part.shape[::-1], dtype=kind)
        for j in range(part.shape[1]):
            # Gathered first: to turn it where its rows lie far apart takes five times as long.
            turned[:, j] = np.ascontiguousarray(part[:, j]).T
        yield turned


def free_border(state: NDArray[np.uint8], grid: Grid) -> tuple[Floats, Ints]:
    """The border of the union of the closed FREE cells of a slice in space: vertices (V, 3), metres, and faces (F, 3).

    Every cell face between a FREE cell and one that is not, or the outside of the grid, becomes two triangles, whose
    normals point out of the free space: counterclockwise where seen from outside it. Triangles share their vertices,
    each ``lower + spacing * index`` and none twice: every edge belongs to an even number of them, two, or four where
    FREE cells touch in an edge only.

    Raises InputError if there is no FREE cell, or the border does not fit into memory.
    """
    free = np.pad(state == FREE, 1)
    count = sum(int(np.count_nonzero(np.diff(free, axis=axis))) for axis in range(3))
    if not count:
        raise InputError(
            "the map",
            "has no FREE cell",
            "a border needs at least one",
            "build it with a smaller spacing, robot or margin",
        )
    check_memory(_BYTES * count, "the border of the free space", grid)
    vertices, faces, turns = cell_squares(free[1:-1, 1:-1, 1:-1], grid.spacing, grid.lower)
    return vertices, np.where(turns[:, None] < 0, faces[:, ::-1], faces)


def write_border(state: NDArray[np.uint8], grid: Grid, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write :func:`free_border` as a mesh file that ends in ``.ply``, ``.obj`` or ``.stl``.

    Raises InputError as :func:`free_border`, or where the format cannot hold the mesh, and FileError as
    :func:`cspace.io.files.replacing`.
    """
    with replacing(path, overwrite) as temporary:
        vertices, faces = free_border(state, grid)
        suffix = Path(path).suffix.lower()
        if len(faces) > MOST:
            raise InputError(
                "path",
                f"is {path} for a mesh of {len(faces)} triangles",
                f"a {suffix} file holds at most {MOST}",
                "build the map with a larger spacing or smaller bounds",
                value=path,
            )
        with temporary.open("wb") as file:
            WRITERS[suffix](file, vertices, faces)


def _write_ply(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    file.write(header.encode())
    for block in _blocks(vertices):
        file.write(block.astype("<f8").tobytes())
    for block in _blocks(faces):
        rows = np.empty(len(block), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        rows["count"], rows["corners"] = 3, block
        file.write(rows.tobytes())


def _write_obj(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
    # The shortest text of a float that reads back as the same one is its repr.
    for start, table, form in ((0, vertices, "v %r %r %r\n"), (1, faces, "f %r %r %r\n")):
        for block in _blocks(table):
            file.write((form * len(block) % tuple((block + start).ravel().tolist())).encode())


def _write_stl(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
    with np.errstate(over="ignore", under="ignore"):
        single = vertices.astype("<f4")
    file.write(b"binary STL, metres".ljust(80) + np.uint32(len(faces)).astype("<u4").tobytes())
    scale = np.ptp(vertices, axis=0).max()
    for block in _blocks(faces):
        corners = single[block]
        edges = np.diff(vertices[block], axis=1)
        if not np.isfinite(corners).all() or ((edges != 0.0) & (np.diff(corners, axis=1) == 0.0)).any():
            raise InputError(
                "path",
                f"names an STL file for coordinates from {vertices.min()} to {vertices.max()}",
                "they do not keep apart in single precision, and such a file holds no other",
                "write .ply or .obj instead",
            )
        normals = np.cross(edges[:, 0] / scale, edges[:, 1] / scale)
        rows = np.zeros(len(block), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        rows["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        rows["corners"] = corners
        file.write(rows.tobytes())


def _blocks(table: NDArray[Any]) -> Iterator[NDArray[Any]]:
    return (table[start : start + BLOCK] for start in range(0, len(table), BLOCK))


WRITERS: Final[Mapping[str, Callable[[IO[bytes], Floats, Ints], None]]] = {
    ".ply": _write_ply,
    ".obj": _write_obj,
    ".stl": _write_stl,
}
"""Mesh formats, by suffix."""

SAVES: Final[Mapping[str, Callable[[Contents, StrPath, bool], None]]] = {
    ".zarr": write_store,
    "": write_store,
    ".npz": write_npz,
}
"""Formats that :func:`cspace.open` reads again, by suffix."""


class _Layers(Mapping[str, NDArray[Any]]):
    """The arrays of some rotation cells of a map, each taken from its stack when it is read.

    Those of one cell keep their names; those of several have the number of the cell behind them.
    """

    def __init__(self, contents: Contents, cells: Sequence[int]) -> None:
        self._arrays = arrays_of(contents)
        last = "" if len(cells) == 1 else f"_{{:0{len(str(cells[-1]))}d}}"
        self._places: dict[str, tuple[str, int | None]] = {}
        for name in STACKED:
            if name in self._arrays:
                self._places |= {name + last.format(k): (name, int(contents.slice_of[k])) for k in cells}
        self._places |= {name: (name, None) for name in ("outer", "inner", "unknown") if name in self._arrays}

    def __getitem__(self, key: str) -> NDArray[Any]:
        name, number = self._places[key]
        array: NDArray[Any] = self._arrays[name] if number is None else self._arrays[name][number]
        return array

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


Write = Callable[[Contents, Sequence[int], StrPath, bool], None]


def _slice(write: Callable[[NDArray[np.uint8], Grid, StrPath, bool], None]) -> Write:
    """What writes the slice of one rotation cell by a function of its states."""
    return lambda contents, cells, path, overwrite: write(
        contents.states[int(contents.slice_of[cells[0]])], contents.grid, path, overwrite
    )


def _vti(contents: Contents, cells: Sequence[int], path: StrPath, overwrite: bool) -> None:
    rotations = contents.rotations
    about = dict(zip(rotations.names, rotations.centers[cells].T, strict=True))
    write_vti(_Layers(contents, cells), contents.grid, path, overwrite, about)


def _netcdf(contents: Contents, cells: Sequence[int], path: StrPath, overwrite: bool) -> None:
    """Write a map, or one rotation cell of it, as netCDF-3, whose arrays are indexed ``[rotation, z, y, x]``."""
    dataset = to_xarray(contents).drop_vars(["shapes", "slice_of"], errors="ignore")
    if "rotation" in dataset.dims and len(cells) == 1:
        dataset = dataset.isel(rotation=cells[0])
    dataset = dataset.transpose(..., *reversed(contents.grid.axes))
    dataset["state"].attrs["flag_values"] = np.array([FREE, MIXED, BLOCKED], dtype=np.int8)
    with replacing(path, overwrite) as temporary:
        dataset.to_netcdf(temporary, engine="scipy", format="NETCDF3_64BIT")


_ONLY_PLANE: Final = {3: "a GeoTIFF is plane, and the map is one in space"}

_SLICES: Final[Mapping[str, tuple[Write, Mapping[int, str]]]] = {
    ".vti": (_vti, {}),
    ".nc": (_netcdf, {}),
    **dict.fromkeys((".tif", ".tiff"), (_slice(write_geotiff), _ONLY_PLANE)),
    **dict.fromkeys((".yaml", ".yml"), (_slice(write_ros_map), {3: "a ROS map is plane, and the map is one in space"})),
    **dict.fromkeys(
        WRITERS, (_slice(write_border), {2: "a border is a mesh in space, and the map is one of the plane"})
    ),
}
"""What writes rotation cells of a map, by suffix; and why it does not in one of the dimensions."""

_MANY: Final = (".vti", ".nc")
"""Formats that hold more than one rotation cell."""

EXPORTS: Final = (*SAVES, *_SLICES)
"""All formats, by suffix."""

_RULE: Final = "the suffix says which format to write"


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
    SAVES[suffix_of(path, SAVES, _RULE)](contents, path, overwrite)


def export(
    contents: Contents, path: str | os.PathLike[str], overwrite: bool = False, *, rotation: ArrayLike | None = None
) -> None:
    """Write a map for other software.

    Parameters
    ----------
    contents : Contents
    path : path-like
        ``.npz``: one NumPy file. ``.zarr`` or no suffix: a Zarr folder. ``.vti``: cells for ParaView, with the arrays
        ``state``, ``outer``, and where the map has them ``inner``, ``unknown``, ``overlap`` and those of its overlap
        field (``penetration`` and its derivatives); of a robot that turns one for each rotation cell, ``state_00`` and
        so on, whose rotations are the field data ``yaw``, or ``qx`` to ``qw``. ``.nc``: netCDF-3 with the variables of
        :func:`to_xarray`, indexed ``[rotation, z, y, x]``. ``.tif``, ``.tiff``: a map of the plane as a GeoTIFF in its
        own metres, 0 FREE, 1 MIXED, 2 BLOCKED. ``.yaml``: a map of the plane as a ROS map, with its image beside it.
        ``.ply``, ``.obj``, ``.stl``: the border of the free space, of a map in space; STL in single precision.
    overwrite : bool
        Whether an existing output may be replaced.
    rotation : array-like, shape (k,), optional
        Of a robot that turns, the rotation to write, as in a configuration: needed for formats of one slice, and for
        ``.vti`` and ``.nc`` unless all are wanted. What the map calls free is proven for all of the rotation cell that
        holds it, and for no other.

    Raises
    ------
    InputError
        If the suffix is another one, the format cannot hold the map, or ``rotation`` is missing or has no place.
    FileError
        If the output exists and may not be replaced, or cannot be written.
    """
    suffix = check_export(path, contents.grid.dim)
    if suffix in _SLICES:
        cells: Sequence[int] = range(contents.rotations.count)
        if rotation is not None or suffix not in _MANY:
            cells = [contents.rotations.one_cell(rotation, "rotation", f"{Path(path)} holds one slice")]
        _SLICES[suffix][0](contents, cells, path, overwrite)
        return
    if rotation is not None:
        rule = f"a {suffix or 'Zarr'} map holds every slice"
        raise InputError("rotation", f"is {rotation!r}", rule, "leave it out", value=rotation)
    SAVES[suffix](contents, path, overwrite)


def check_export(path: StrPath, dim: int) -> str:
    """The suffix of a file that can hold maps of a dimension.

    Raises InputError if no format has it, or that one holds maps of the other dimension.
    """
    suffix = suffix_of(path, EXPORTS, _RULE)
    refused = _SLICES[suffix][1] if suffix in _SLICES else {}
    if dim in refused:
        mend = "write another format, e.g. .vti"
        raise InputError("path", f"is {Path(path)}", refused[dim], mend, value=path)
    return suffix


def to_xarray(contents: Contents) -> xarray.Dataset:
    """A map as an xarray Dataset, with everything that is needed to rebuild it.

    Parameters
    ----------
    contents : Contents

    Returns
    -------
    xarray.Dataset
        Dimensions ``x``, ``y`` and in space ``z``, or the joints of an arm, with the middles of the cells, in metres or
        radians. Variables ``state`` (uint8, flags free, mixed and blocked), ``outer`` and ``inner`` (bool, the
        workspace) and, where the map has them, ``overlap`` (int32), ``penetration`` and its derivatives
        ``penetration_x`` and so on (float64), and ``shapes`` (bytes of JSON text, which makes the obstacles again). The
        arrays are read-only; copy the Dataset to change it. Attributes are text, numbers and lists of numbers:
        ``lower``, ``spacing``, ``outside``, ``margin``, ``precision``, ``rotations`` (their number), ``robot`` (JSON
        text for ``Robot.from_spec``), ``workspace_source`` and the versions.

        For a robot that turns, ``state``, ``overlap`` and the field have the dimension ``rotation`` before those of the
        cells, with the coordinates ``yaw`` (the representative, radians), ``yaw_bounds`` (its borders),
        ``covering_angle`` and ``slice_of``. A state holds for all yaw angles between the bounds.

    Notes
    -----
    Arrays are those of the map, not copies, with one exception: where a symmetry of the robot makes some, but not all,
    rotation cells share slices (a rectangle about its middle), these are copied out, a slice for each rotation cell.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.rectangle(0.4, 0.2), rotations=8)
    >>> dataset = space.to_xarray()
    >>> free = (dataset.state == cspace.FREE).mean("y")
    >>> free.sizes
    Frozen({'rotation': 8, 'x': 30})
    >>> one = dataset.state.isel(rotation=int(space.rotations.cell_of(0.3)))
    >>> float(one.yaw)
    0.0
    """
    import xarray

    dim, cells = contents.grid.dim, contents.rotations.leading(contents.rotations.count)
    variables: dict[str, Any] = {}
    labels: dict[str, Any] = {}
    contents = replace(contents, exterior=None)  # it labels no cells
    for name, array in ({"inner": contents.workspace.inner} | arrays_of(contents)).items():
        axes = axes_of(name, dim)
        if axes[0] == "slice":
            array = _by_rotation(np.asarray(array), contents.slice_of).reshape(*cells, *contents.grid.shape)
            axes = ("rotation", *axes[1:])[-array.ndim :]
        if "rotation" in axes and not cells:
            continue
        place = labels if name in (*AXES, *contents.rotations.COORDINATES, "slice_of") else variables
        place[name] = (axes, array, attributes_of(name, contents.grid))
    dataset = xarray.Dataset(variables, coords=labels, attrs=metadata_of(contents))
    return dataset.rename(dict(zip(AXES, contents.grid.axes, strict=False)))


def _by_rotation(stack: NDArray[Any], slice_of: Ints) -> NDArray[Any]:
    """A slice for each rotation cell, copied only where some, but not all, share one."""
    if len(stack) == len(slice_of):
        return stack
    if len(stack) == 1:
        return np.broadcast_to(stack, (len(slice_of), *stack.shape[1:]))
    return frozen(stack[slice_of])
