"""Export for analysis: maps as labelled xarray arrays, to see how much room is left as a robot grows."""

import numpy as np
import xarray as xr

import cspace
from cspace.demo import demo_workspace


def main() -> None:
    workspace = demo_workspace(spacing=0.05)
    radii = np.arange(0.1, 0.8, 0.1)
    maps = [cspace.build(workspace, cspace.Robot.disc(radius)).to_xarray() for radius in radii]
    state = xr.concat([each["state"] for each in maps], xr.DataArray(radii, dims="radius", name="radius"))
    cell = workspace.grid.spacing**2
    table = xr.Dataset(
        {
            "at least": cell * (state == cspace.FREE).sum(["x", "y"]),
            "at most": cell * (state != cspace.BLOCKED).sum(["x", "y"]),
        }
    )
    print("Room that is left, in square metres, by the radius of a disc in metres:")
    print(table.to_dataframe().round(2).to_string())


if __name__ == "__main__":
    main()
