"""
How much room is left as a robot grows
======================================

Maps become labelled arrays of xarray, for analysis with its tools. FREE cells are a lower bound of
the room that is left, and cells that are not BLOCKED an upper one.
"""

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import cspace
from cspace._cli.demo import demo_workspace

workspace = demo_workspace(spacing=0.05)
radii = xr.DataArray(np.arange(0.1, 0.8, 0.1), dims="radius", name="radius")
maps = [cspace.build(workspace, cspace.Robot.disc(radius)).to_xarray() for radius in radii.values]
state = xr.concat([each["cell_states"] for each in maps], radii)
cell = workspace.grid.spacing**2
room = xr.Dataset(
    {
        "at least": cell * (state == cspace.FREE).sum(["x", "y"]),
        "at most": cell * (state != cspace.BLOCKED).sum(["x", "y"]),
    }
)
print(room.to_dataframe().round(2).to_string())

# %%
# The clearance is between the two curves.

figure, ax = plt.subplots(figsize=(6, 3.5), layout="constrained")
ax.fill_between(radii, room["at least"], room["at most"], color="#d55e00", alpha=0.6)
ax.set(xlabel="radius of the robot (m)", ylabel="room (m²)", ylim=(0, None))
figure.savefig("export_analysis.png")
plt.close(figure)
print("wrote export_analysis.png")
