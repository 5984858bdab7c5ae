"""Read a variable of costs of a netCDF file, with xarray.

xarray applies ``scale_factor`` and turns ``_FillValue`` into NaN; what lies beyond ``valid_range``
is missing, too. Missing costs count as occupied. The axes are in metres: scale others as a whole,
``array.assign_coords(x=0.001 * array.x, y=0.001 * array.y)``.
"""

import numpy as np
import xarray

import cspace
from cspace.errors import FileError


def read_netcdf(
    path: str, name: str = "cost", free_below: float = 50.0, spacing: float = 0.1
) -> cspace.Workspace:
    """Read the costs of a name: cells below a cost are free."""
    costs = xarray.open_dataset(path)[name].squeeze(drop=True)
    scale = costs.encoding.get("scale_factor", 1)
    shift = costs.encoding.get("add_offset", 0)
    least, most = costs.attrs.get("valid_range", (-np.inf, np.inf))
    least, most = costs.attrs.get("valid_min", least), costs.attrs.get("valid_max", most)
    costs = costs.where((costs >= scale * least + shift) & (costs <= scale * most + shift))
    if not costs.max() >= free_below:
        problem = f"has no cost from {free_below:g} on"
        raise FileError(path, problem, "each cell would be free", "pass free_below=, e.g. 0.5")
    return cspace.Workspace.from_array(~(costs < free_below), spacing)


if __name__ == "__main__":
    import sys

    print(read_netcdf(*sys.argv[1:]))
