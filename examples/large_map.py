"""
A map larger than memory
========================

A map is built tile by tile into a folder, where look-ups and plans use it. This map is
small; a city needs the same calls.
"""

import tempfile

import numpy as np

import cspace
import planners
from cspace.plot import save_plot

# %% Streets of 7 m between blocks of houses, 150 m by 150 m. An array of zarr or dask, or a
# ``numpy.memmap``, would stay on disk.

houses = np.ones((750, 750), dtype=bool)  # [x, y], 0.2 m each
for street in range(0, 750, 143):
    houses[street : street + 35] = houses[:, street : street + 35] = False
city = cspace.Workspace.from_array(houses, 0.2)

# %%
# With ``store=`` the map is a folder. The same call again continues a stopped build.

folder = tempfile.TemporaryDirectory()
space = cspace.build(city, cspace.Robot.disc(1.0), store=f"{folder.name}/city.zarr", tile=256)
print(space)
print("a path exists:", space.is_connected((3.0, 3.0), (145.0, 118.0)))

# %%
# A path through several tiles, drawn on an overview with larger cells, has the same proofs.

plan = planners.plan(space, (3.0, 3.0), (145.0, 118.0), seed=1)
print(plan)
save_plot(space.overview(256), "large_map.png", True, path=plan)

# %%
# A window of the map is a map in memory, which has all other queries.

part = space.window((100, 90), (150, 140))
print(part.clearance((118.0, 117.5)))
save_plot(part, "large_map_part.png", True)
folder.cleanup()
