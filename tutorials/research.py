"""
First hour: research
====================

Maps become labelled arrays of xarray, for analysis with its tools. FREE cells are a lower bound of
the room that is left, and cells that are not BLOCKED an upper one.
"""

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from shapely import Point, box

import cspace

walls = [box(5.0, 0.0, 5.15, 7.0), box(11.0, 0.0, 11.15, 4.4), box(11.0, 5.7, 11.15, 10.0)]
tables = [Point(8.0, 6.6).buffer(0.9), Point(13.2, 3.4).buffer(0.7)]
workspace = cspace.Workspace.from_polygons([*walls, *tables], 0.05, bounds=(0, 0, 16, 10))
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
# Left: the largest of these robots that is proven free at each place. Right: the room of each; the
# truth lies within the band.

fits = (state == cspace.FREE).any("radius") * radii.where(state == cspace.FREE).max("radius")
figure, (place, band) = plt.subplots(
    1, 2, figsize=(12, 4.2), layout="constrained", width_ratios=(1.5, 1)
)
fits.where(fits > 0).T.plot.imshow(
    ax=place, cmap="viridis", cbar_kwargs={"label": "largest proven radius (m)"}
)
place.set(aspect="equal", title="where a robot fits", facecolor="#262626")
band.fill_between(radii, room["at least"], room["at most"], color="#d55e00", alpha=0.4)
for name, color in (("at most", "#d55e00"), ("at least", "#6a1b9a")):
    band.plot(radii, room[name], "o-", color=color, label=name)
band.set(xlabel="radius of the robot (m)", ylabel="room (m²)", title="how much room is left")
band.legend(frameon=False)
figure.savefig("research.png")
plt.close(figure)
print("wrote research.png")
