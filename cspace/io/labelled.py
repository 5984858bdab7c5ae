"""Maps as labelled arrays, for analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cspace.io.record import ATTRIBUTES, AXES, arrays_of, metadata_of

if TYPE_CHECKING:
    import xarray

    from cspace.space import CSpace


def to_xarray(space: CSpace) -> xarray.Dataset:
    """A map as an xarray Dataset, with everything that is needed to rebuild it.

    Parameters
    ----------
    space : CSpace

    Returns
    -------
    xarray.Dataset
        Dimensions ``x`` and ``y`` with the middles of the cells, in metres. Variables ``state`` (uint8, flags free,
        mixed and blocked), ``outer`` and ``inner`` (bool, the workspace) and, where the map was built with it,
        ``overlap`` (int32). The arrays are those of the map, read-only; copy the Dataset to change it. Attributes are
        text, numbers and lists of numbers: ``lower``, ``spacing``, ``outside``, ``margin``, ``precision``, ``robot``
        (JSON text for ``Robot.from_spec``), ``workspace_source`` and the versions.

    Examples
    --------
    >>> free = (space.to_xarray().state == cspace.FREE).mean("y")  # doctest: +SKIP
    """
    import xarray

    arrays = {"inner": space.workspace.inner} | arrays_of(space)
    axes = AXES[: space.grid.dim]
    return xarray.Dataset(
        {name: (axes, array, ATTRIBUTES[name]) for name, array in arrays.items() if name not in axes},
        coords={name: ((name,), arrays[name], ATTRIBUTES[name]) for name in axes},
        attrs=metadata_of(space),
    )
