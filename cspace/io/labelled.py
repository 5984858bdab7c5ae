"""Maps as labelled arrays, for analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cspace.io.record import AXES, TURNS, arrays_of, attributes_of, axes_of, metadata_of

if TYPE_CHECKING:
    import xarray

    from cspace.map.contents import Contents


def to_xarray(contents: Contents) -> xarray.Dataset:
    """A map as an xarray Dataset, with everything that is needed to rebuild it.

    Parameters
    ----------
    contents : Contents

    Returns
    -------
    xarray.Dataset
        Dimensions ``x``, ``y`` and in space ``z`` with the middles of the cells, in metres. Variables ``state`` (uint8,
        flags free, mixed and blocked), ``outer`` and ``inner`` (bool, the workspace) and, where the map has them,
        ``overlap`` (int32), ``penetration`` and its derivatives ``penetration_x`` and so on (float64), and ``shapes``
        (bytes of JSON text, which makes the obstacles again). The arrays are read-only; copy the Dataset to change it.
        Attributes are text, numbers and lists of numbers: ``lower``, ``spacing``, ``outside``, ``margin``,
        ``precision``, ``rotations`` (their number), ``robot`` (JSON text for ``Robot.from_spec``),
        ``workspace_source`` and the versions.

        For a robot that turns, ``state``, ``overlap`` and the field have the dimension ``rotation`` before those of the
        cells, with the coordinates ``yaw`` (the representative, radians), ``yaw_bounds`` (its borders),
        ``covering_angle`` and ``slice_of``. A state holds for all yaw angles between the bounds.

    Notes
    -----
    Arrays are those of the map, not copies, with one exception: where a symmetry of the robot makes some, but not all,
    rotation cells share slices (a rectangle about its middle), these are copied out, a slice for each rotation cell.

    Examples
    --------
    >>> free = (space.to_xarray().state == cspace.FREE).mean("y")  # doctest: +SKIP
    >>> dataset = space.to_xarray()  # doctest: +SKIP
    >>> dataset.state.isel(rotation=int(space.rotations.cell_of(0.3)))  # doctest: +SKIP
    >>> borders = [*dataset.yaw_bounds.values[:, 0], dataset.yaw_bounds.values[-1, 1]]  # doctest: +SKIP
    """
    import xarray

    dim, cells = contents.grid.dim, contents.rotations.leading(contents.rotations.count)
    variables: dict[str, Any] = {}
    labels: dict[str, Any] = {}
    for name, array in ({"inner": contents.workspace.inner} | arrays_of(contents)).items():
        axes = axes_of(name, dim)
        if axes[0] == "slice":
            array = _by_rotation(np.asarray(array), contents.slice_of).reshape(*cells, *contents.grid.shape)
            axes = ("rotation", *axes[1:])[-array.ndim :]
        if "rotation" in axes and not cells:
            continue
        place = labels if name in (*AXES, *TURNS, "slice_of") else variables
        place[name] = (axes, array, attributes_of(name, dim))
    return xarray.Dataset(variables, coords=labels, attrs=metadata_of(contents))


def _by_rotation(stack: NDArray[Any], slice_of: NDArray[np.int64]) -> NDArray[Any]:
    """A slice for each rotation cell, copied only where some, but not all, share one."""
    if len(stack) == len(slice_of):
        return stack
    if len(stack) == 1:
        return np.broadcast_to(stack, (len(slice_of), *stack.shape[1:]))
    every: NDArray[Any] = stack[slice_of]
    every.setflags(write=False)
    return every
