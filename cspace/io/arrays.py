"""The arrays that a map is made of, whatever the format: their names, dimensions, types and meanings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import finite
from cspace.io.geometry import DIMENSIONS, geometry_arrays
from cspace.rotations import Rotations
from cspace.states import NAMES

if TYPE_CHECKING:
    from cspace.space import CSpace

AXES: Final = ("x", "y", "z")

FIELDS: Final = ("penetration", "penetration_x", "penetration_y", "penetration_z")
"""Overlap of descriptors, and its derivatives along the axes, where the map carries them."""

STACKED: Final = ("state", "overlap", *FIELDS)
"""Arrays that hold one slice after the other where the robot turns."""

TURNS: Final = ("yaw", "yaw_bounds", "covering_angle", "slice_of")
"""Arrays that tell of the rotation cells; there only where the robot turns."""

ATTRIBUTES: Final[dict[str, dict[str, Any]]] = {
    "state": {
        "long_name": "state of the configurations in a cell",
        "flag_values": list(range(len(NAMES))),
        "flag_meanings": " ".join(NAMES),
    },
    "outer": {"long_name": "workspace cells that meet an obstacle"},
    "inner": {"long_name": "workspace cells that lie in obstacles"},
    "overlap": {"long_name": "number of coinciding pairs of obstacle cell and robot offset", "units": "1"},
    "penetration": {"long_name": "overlap of the descriptors of robot and obstacles"},
    **{f"penetration_{axis}": {"long_name": f"derivative of penetration along {axis}"} for axis in AXES},
    "yaw": {"long_name": "representative of a rotation cell: its middle", "units": "rad", "bounds": "yaw_bounds"},
    "yaw_bounds": {"long_name": "borders of a rotation cell", "units": "rad"},
    "covering_angle": {
        "long_name": "largest angle between a yaw of a rotation cell and its representative",
        "units": "rad",
    },
    "slice_of": {
        "long_name": "slice of the stack that serves a rotation cell",
        "comment": "where state has the dimension slice, state.isel(slice=slice_of) has the dimension rotation",
    },
    "geometry": {"long_name": "obstacles as a GeometryCollection in well-known binary (WKB)"},
    "shapes": {"long_name": "obstacles as a JSON list: the kind of each, and its rows in the arrays that hold them"},
    "vertices": {"long_name": "vertices of the meshes, one mesh after the other", "units": "m"},
    "faces": {"long_name": "triangles of the meshes, counting the vertices of their own mesh"},
    "centers": {"long_name": "middles of balls", "units": "m"},
    "radii": {"long_name": "radii of balls", "units": "m"},
    **{axis: {"long_name": f"{axis} of the middle of a cell", "units": "m", "axis": axis.upper()} for axis in AXES},
}
"""Attributes of each array, after the CF conventions; see :func:`attributes_of`."""

FILLS: Final[dict[str, Any]] = {
    "state": 255,
    "outer": True,
    "inner": True,
    "overlap": -1,
    **dict.fromkeys(FIELDS, math.inf),
    "slice_of": np.iinfo(np.int64).max,
    "geometry": -1,
    "shapes": -1,
    "faces": -1,
}
"""What stands in for entries that were lost: never a value that would call a cell free."""

DTYPES: Final = {
    "state": "uint8",
    "outer": "bool",
    "inner": "bool",
    "overlap": "int32",
    "slice_of": "int64",
    "geometry": "int8",
    "shapes": "int8",
    "faces": "int64",
    **dict.fromkeys(("yaw", "yaw_bounds", "covering_angle", "vertices", "centers", "radii", *AXES), "float64"),
    **dict.fromkeys(FIELDS, "float64"),
}


def attributes_of(name: str, dim: int) -> dict[str, Any]:
    """The attributes of an array on a grid of ``dim`` axes, with its unit where that depends on them."""
    if name not in FIELDS:
        return ATTRIBUTES[name]
    power = dim - (name != FIELDS[0])
    return {**ATTRIBUTES[name], "units": "m" if power == 1 else f"m{power}"}


def arrays_of(space: CSpace) -> dict[str, NDArray[Any]]:
    """The arrays of a map over its cells, then what labels them.

    ``inner`` is there only if it differs from ``outer``, ``overlap`` only if the map was built with it, :data:`FIELDS`
    only if it carries an overlap field, and the arrays of :func:`cspace.io.geometry.geometry_arrays` only if the
    obstacles are known as shapes. No cells are copied.

    Parameters
    ----------
    space : CSpace

    Returns
    -------
    dict of str to ndarray
        Cells are indexed [x, y] or [x, y, z]; :data:`STACKED` ones of a robot that turns [slice, x, y]. The
        coordinates ``x``, ``y`` and in space ``z``, in metres, have one axis; :data:`TURNS` are as
        :func:`rotation_arrays` makes them.
    """
    workspace, grid = space.workspace, space.grid
    arrays: dict[str, NDArray[Any]] = {
        "state": space.state if space.rotations is None else space.stack,
        "outer": workspace.outer,
    }
    if workspace.inner is not workspace.outer:
        arrays["inner"] = workspace.inner
    if space.overlaps is not None:
        arrays["overlap"] = space.overlaps
    arrays |= space.fields
    arrays |= {axis: grid.centers(i) for i, axis in enumerate(AXES[: grid.dim])}
    if space.rotations is not None:
        arrays |= rotation_arrays(space.rotations, space.slice_of)
    if workspace.shapes is not None:
        arrays |= geometry_arrays(workspace.shapes)
    return arrays


def dimensions_of(dim: int, turns: bool) -> dict[str, tuple[str, ...]]:
    """The name of each axis of the arrays of :func:`arrays_of`, on a grid of ``dim`` axes."""
    cells = AXES[:dim]
    return {
        **dict.fromkeys(STACKED, ("slice", *cells) if turns else cells),
        **dict.fromkeys(("outer", "inner"), cells),
        **dict.fromkeys(TURNS, ("rotation",)),
        "yaw_bounds": ("rotation", "bound"),
        **DIMENSIONS,
        **{axis: (axis,) for axis in cells},
    }


def expected_shape(
    name: str, cells: tuple[int, ...], rotations: int, slices: int, found: tuple[int, ...]
) -> tuple[int, ...]:
    """The shape that an array must have.

    Parameters
    ----------
    name : str
    cells : tuple of int
        Shape of the grid.
    rotations, slices : int
        Rotation cells, none for a robot that only translates, and slices.
    found : tuple of int
        Its shape, which is accepted where the map does not tell it.
    """
    if name in STACKED:
        return (slices, *cells) if rotations else cells
    if name in TURNS:
        return (rotations, 2) if name == "yaw_bounds" else (rotations,)
    if name in AXES:
        return (cells[AXES.index(name)],)
    if name in DIMENSIONS:
        rows = {"coordinate": len(cells), "corner": 3}
        return (*found[:1], *(rows[axis] for axis in DIMENSIONS[name][1:]))
    return cells if name in ("outer", "inner") else found


def rotation_arrays(rotations: Rotations, slice_of: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    """Rotation cells as arrays.

    Returns
    -------
    dict of str to ndarray
        ``yaw``, ``covering_angle``, shape (rotations,), and ``yaw_bounds``, shape (rotations, 2), in radians;
        ``slice_of``, shape (rotations,).
    """
    borders = np.asarray(rotations.borders)
    return {
        "yaw": rotations.representatives,
        "yaw_bounds": np.stack([borders[:-1], borders[1:]], axis=1),
        "covering_angle": rotations.covering_angles,
        "slice_of": slice_of,
    }


def rotations_from(bounds: NDArray[np.float64]) -> Rotations:
    """The rotation cells whose ``yaw_bounds`` are given, to the last bit."""
    return Rotations.of([*bounds[:, 0].tolist(), float(bounds[-1, 1])])


def one_yaw(yaw: float) -> float:
    """``yaw`` where it is one finite number.

    Raises
    ------
    InputError
        If it is not.
    """
    angle = finite(yaw, "yaw")
    if angle.ndim != 0:
        raise InputError(f"yaw has shape {angle.shape}; there is one slice at a time; pass one number, in radians")
    return float(angle)
