"""Maps for other software, by suffix, or as labelled arrays."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace import BLOCKED, FREE, MIXED, Rotations
from cspace.errors import InputError
from cspace.export._free_boundary import write_boundary
from cspace.export._plane_images import write_geotiff, write_ros_map
from cspace.export._vti import write_vti
from cspace.inside import (
    AXES,
    Contents,
    Ints,
    MapFolder,
    StrPath,
    check_memory,
    check_suffix,
    collect_arrays,
    contents_of,
    frozen,
    import_optional,
    make_metadata,
    replacing,
)

if TYPE_CHECKING:
    import xarray

    from cspace import CSpace


def _select_layers(contents: Contents, cells: Sequence[int]) -> dict[str, NDArray[Any]]:
    """Return a map's arrays, one per rotation cell.

    ``cells`` are the indices of the rotation cells. The arrays of a single cell keep their names;
    otherwise the index of the cell is appended.
    """
    # All indices have as many digits as the last one, so that names sort in the order of the cells.
    arrays = {name: array.values for name, array in collect_arrays(contents).items()}
    digits = len(str(cells[-1]))
    layers: dict[str, NDArray[Any]] = {}
    for name in ("cell_states", "overlap_counts"):
        if name not in arrays:
            continue
        for cell in cells:
            label = name if len(cells) == 1 else f"{name}_{cell:0{digits}d}"
            layers[label] = arrays[name][int(contents.slice_of[cell])]
    for name in ("outer", "inner", "unknown"):
        if name in arrays:
            layers[name] = arrays[name]
    return layers


def _write_vti(contents: Contents, cells: Sequence[int], path: StrPath, overwrite: bool) -> None:
    """Write the states at rotation cells as VTI."""
    rotations = contents.rotations
    centers = dict(zip(rotations.names, rotations.centers[cells].T, strict=True))
    write_vti(_select_layers(contents, cells), contents.grid, path, overwrite, centers)


def _write_netcdf(contents: Contents, cells: Sequence[int], path: StrPath, overwrite: bool) -> None:
    """Write a map, or one rotation cell of it, as netCDF-3.

    Arrays are indexed ``[rotation, z, y, x]``.
    """
    dataset = make_dataset(contents).drop_vars(["shapes", "slice_of"], errors="ignore")
    if "rotation" in dataset.dims and len(cells) == 1:
        place = _sort_rotations(contents).tolist().index(cells[0])
        dataset = dataset.isel(rotation=place)
    dataset = dataset.transpose(..., *reversed(contents.grid.axes))
    dataset["cell_states"].attrs["flag_values"] = np.array([FREE, MIXED, BLOCKED], dtype=np.int8)
    with replacing(path, overwrite) as temporary:
        dataset.to_netcdf(temporary, engine="scipy", format="NETCDF3_64BIT")


def _save(space: CSpace, path: StrPath, overwrite: bool) -> None:
    """Save a map as a Zarr folder."""
    space.save(Path(path), overwrite=overwrite)


def write_npz(space: CSpace, path: StrPath, overwrite: bool) -> None:
    """Write a map as a compressed NumPy archive.

    See :func:`export` for its arrays.

    Raises FileError if the file exists and may not be replaced, or cannot be written.
    """
    contents = contents_of(space)
    arrays = collect_arrays(replace(contents, exterior=None))
    members: dict[str, Any] = {name: np.asarray(array.values) for name, array in arrays.items()}
    members["lower"] = np.array(contents.grid.lower)
    members["spacing"] = np.array(contents.grid.spacing)
    members["metadata"] = json.dumps(make_metadata(contents), sort_keys=True)
    # Pass an open file, because np.savez appends a suffix to names that do not end in lower-case
    # ".npz".
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **members)


class ExportFormat(NamedTuple):
    """A format of exported files.

    Attributes
    ----------
    write : callable
        Its arguments depend on ``rotations``. For "all", ``write(space, path, overwrite)``
        writes the map. For "all or one", ``write(contents, cells, path, overwrite)`` writes these
        rotation cells. For "one", ``write(state, grid, path, overwrite)`` writes a slice.
    rotations : {"all", "all or one", "one"}
        Rotations that a file holds.
    dimension : int or None
        2 if files hold only maps of the plane, 3 if only maps in space.
    memory : int
        Bytes for each cell that is written, measured.
    summary : str
        Content of such a file, for the documentation.
    """

    write: Callable[..., None]
    rotations: Literal["all", "all or one", "one"]
    dimension: int | None
    memory: int
    summary: str


EXPORT_FORMATS: Final[dict[str, ExportFormat]] = {
    **dict.fromkeys(
        MapFolder.SUFFIXES,
        ExportFormat(_save, "all", None, 2, "a saved map, which `cspace.open` reads"),
    ),
    ".npz": ExportFormat(write_npz, "all", None, 2, "arrays for `numpy.load`"),
    ".vti": ExportFormat(
        _write_vti,
        "all or one",
        None,
        4,
        "image data for ParaView; if the robot turns, one array for each rotation, "
        "`cell_states_00` and on",
    ),
    ".nc": ExportFormat(
        _write_netcdf, "all or one", None, 10, "netCDF, indexed `[rotation, z, y, x]`"
    ),
    **dict.fromkeys(
        (".tif", ".tiff"), ExportFormat(write_geotiff, "one", 2, 4, "a GeoTIFF of a plane map")
    ),
    **dict.fromkeys(
        (".yaml", ".yml"), ExportFormat(write_ros_map, "one", 2, 4, "a ROS map with its image")
    ),
    ".ply": ExportFormat(
        write_boundary, "one", 3, 20, "the border of the free cells in space, as a closed mesh"
    ),
}
"""Formats of exports, by suffix."""


def export(
    space: CSpace,
    path: StrPath,
    *,
    overwrite: bool = False,
    rotation: ArrayLike | None = None,
) -> None:
    """Write the map for other programs, in the format of the suffix.

    Parameters
    ----------
    path : path-like
        ``.zarr`` or no suffix: a Zarr folder, as ``space.save`` writes it. ``.npz``: a compressed
        archive for ``numpy.load``, with ``cell_states`` (uint8 [slice, x, y] or [slice, x, y, z]: 0
        free, 1 mixed, 2 blocked), ``slice_of`` (``cell_states[slice_of]`` are the states by
        rotation), ``x``, ``y`` and in space ``z`` (centers of the cells, metres), ``outer``, the
        other arrays of the map, ``lower``, ``spacing`` and ``metadata`` (JSON). ``.vti``: cells for
        ParaView, with the arrays ``cell_states``, ``outer``, and, if the map has them, ``inner``,
        ``unknown`` and ``overlap_counts``. For a robot that turns, each rotation cell has its own
        arrays, ``cell_states_00`` and so on; the field data ``yaw``, or ``qx`` to ``qw``, hold the
        rotations. ``.nc``: netCDF-3, by xarray, with the variables of ``space.to_xarray()``,
        indexed ``[rotation, z, y, x]``. ``.tif``, ``.tiff``: a plane map as a GeoTIFF in its own
        metres, 0 FREE, 1 MIXED, 2 BLOCKED. ``.yaml``, ``.yml``: a plane map as a ROS map, with its
        image beside it. ``.ply``: the boundary of the free space of a map in space.
    overwrite : bool
        True to replace an existing output.
    rotation : array-like, shape (k,), optional
        Rotation to write, as in a configuration, for a robot that turns. It is required for
        formats of one slice, and selects one rotation cell for ``.vti`` and ``.nc``. Its free
        cells are proven for the whole rotation cell that contains it, and for no other.

    Raises
    ------
    InputError
        If the suffix is unknown, the format cannot hold the map, or ``rotation`` is missing or
        not applicable.
    FileError
        If the output exists and may not be replaced, or cannot be written.
    MissingPackageError
        If netCDF is asked for, and xarray is not installed.
    """
    with space.lock:  # an update waits
        _write(space, path, overwrite, rotation)


def _write(space: CSpace, path: StrPath, overwrite: bool, rotation: ArrayLike | None) -> None:
    """Write a map in the format of a path's suffix."""
    contents = contents_of(space)
    suffix = check_suffix(path, EXPORT_FORMATS, "the suffix selects the format", is_output=True)
    form = EXPORT_FORMATS[suffix]
    if form.dimension not in (None, contents.grid.dim):
        scope = "of the plane" if form.dimension == 2 else "in space"
        rule = f"{suffix} holds maps {scope} only"
        raise InputError("path", f"is {Path(path)}", rule)
    if form.rotations == "one" and contents.grid.unit != "m":
        rule = f"{suffix} holds places in metres, and the cells are in {contents.grid.unit}"
        raise InputError("path", f"is {Path(path)}", rule)
    cells: Sequence[int] = range(len(contents.states))
    if form.rotations == "all":
        if rotation is not None:
            rule = f"a {suffix or 'Zarr'} map holds every slice"
            raise InputError("rotation", f"is {rotation!r}", rule)
    elif rotation is not None or form.rotations == "one":
        cells = [_find_cell(contents.rotations, rotation, path)]
    else:
        cells = range(len(contents.rotations))
    check_memory(form.memory * len(cells) * contents.grid.size, "the export", contents.grid)
    if form.rotations == "all":
        form.write(space, path, overwrite)
    elif form.rotations == "one":
        number = int(contents.slice_of[cells[0]])
        form.write(contents.states[number], contents.grid, path, overwrite)
    else:
        form.write(contents, cells, path, overwrite)


def _find_cell(rotations: Rotations, rotation: ArrayLike | None, path: StrPath) -> int:
    """Return the rotation cell of the slice that a file shall hold.

    Raises InputError if it is not one rotation, or missing although there are several cells.
    """
    if rotation is not None:
        return rotations.cell_of(rotations.check_rotation(rotation)).item()
    if len(rotations) > 1:
        rule = f"{Path(path)} holds one slice, and this map has {len(rotations)} rotation cells"
        raise InputError("rotation", "is missing", rule)
    return 0


def to_xarray(space: CSpace) -> xarray.Dataset:
    """Return the map as an xarray Dataset that can rebuild it.

    It has named dimensions, coordinates and units. It needs the extra ``xarray``.

    Returns
    -------
    xarray.Dataset
        Dimensions ``x``, ``y`` and in space ``z``, or the joints of an arm, with the centers of
        the cells, in metres or radians. Variables ``cell_states`` (uint8, flags free, mixed and
        blocked), ``outer`` and ``inner`` (bool, the workspace) and, if the map has them,
        ``overlap_counts`` (int32) and ``shapes`` (bytes of JSON text from which the obstacles
        are made). The arrays are read-only; copy the Dataset to change it. Attributes are text,
        numbers and lists of numbers: ``lower``, ``spacing``, ``outside``, ``margin_m``,
        ``inner``, ``rotations`` (their number), ``robot`` (JSON text for ``Robot.from_spec``),
        ``workspace_source``, ``frame_id`` if it is known, and the versions.

        For a robot that turns, ``cell_states`` and ``overlap_counts`` have the leading
        dimension ``rotation``, with the coordinates ``yaw`` (the representative, radians),
        ``yaw_bounds`` (the ends of the interval), ``covering_angle`` and ``slice_of``. A state
        holds for all yaw angles between the bounds. Yaws lie in [-pi, pi) and ascend, so that
        ``.sel(yaw=0.3, method="nearest")`` and slices of yaws work; the map itself, and other
        files, count rotation cells from that of yaw 0 on. Above the last yaw, the cell around
        -pi may be nearer.

    Raises
    ------
    MissingPackageError
        If xarray is not installed.

    Notes
    -----
    Arrays are shared with the map, with one exception: if the robot turns and is not round
    about its reference point, its slices are copied in the order of the yaws.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.rectangle(0.4, 0.2), rotations=8)
    >>> dataset = space.to_xarray()
    >>> free = (dataset.cell_states == cspace.FREE).mean("y")
    >>> dict(free.sizes)
    {'rotation': 8, 'x': 30}
    >>> float(dataset.cell_states.sel(yaw=0.3, method="nearest").yaw)
    0.0
    """
    return make_dataset(contents_of(space))


def make_dataset(contents: Contents) -> xarray.Dataset:
    """Return the contents of a map as a labelled Dataset."""
    package = import_optional("xarray", "it holds arrays with named axes", "xarray")
    rotation_shape = (len(contents.rotations),) if contents.rotations.names else ()
    coordinate_names = (*AXES, *contents.rotations._COORDINATES, "slice_of")
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    order = _sort_rotations(contents)
    contents = replace(contents, exterior=None)  # a Dataset holds only cells of the grid
    arrays = collect_arrays(contents, with_inner=True)
    for name, (axes, array, attributes) in arrays.items():
        if "rotation" in axes:
            array = frozen(np.asarray(array)[order])
        if axes[0] == "slice":
            stack = _expand_slices(np.asarray(array), contents.slice_of[order])
            array = stack.reshape(*rotation_shape, *contents.grid.shape)
            # Without rotations, the array has no leading axis, and "rotation" is cut off.
            axes = ("rotation", *axes[1:])[-array.ndim :]
        if "rotation" in axes and not rotation_shape:
            continue
        group = coordinates if name in coordinate_names else variables
        group[name] = (axes, array, attributes)
    axis_names = dict(zip(AXES, contents.grid.axes, strict=False))
    dataset: xarray.Dataset = package.Dataset(
        variables, coords=coordinates, attrs=make_metadata(contents)
    )
    dataset = dataset.rename(axis_names)
    if "yaw" not in dataset.coords:
        return dataset
    turns = np.round((dataset.yaw_bounds.mean("bound") - dataset.yaw) / math.tau)
    bounds = dataset.yaw_bounds
    dataset = dataset.assign_coords(
        yaw_bounds=(bounds.dims, frozen((bounds - math.tau * turns).values), bounds.attrs)
    )
    return dataset.set_xindex("yaw")


def _sort_rotations(contents: Contents) -> Ints:
    """Return the rotation cells in the order of their yaws, if they have any."""
    rotations = contents.rotations
    if rotations.names != ("yaw",):
        return np.arange(len(rotations))
    return np.argsort(rotations.centers[:, 0], kind="stable")


def _expand_slices(stack: NDArray[Any], slice_of: Ints) -> NDArray[Any]:
    """Return each rotation cell's slice, shape (cells, ...).

    `stack` has shape (slices, ...). Slices are copied unless cells have them in order or share one.
    """
    if np.array_equal(slice_of, np.arange(len(stack))):
        return stack
    if len(stack) == 1:
        return np.broadcast_to(stack, (len(slice_of), *stack.shape[1:]))
    return frozen(stack[slice_of])
