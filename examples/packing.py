"""
Fit a part into a sheet
=======================

Here the sheet of material is the obstacle, and the part must lie wholly inside it.
``contains_robot`` proves this, and ``overlap_count`` counts the cells inside.
"""

import matplotlib.pyplot as plt
import numpy as np
from shapely import Point, Polygon, box

import cspace

# %%
# A sheet of 1 m by 0.6 m with holes of earlier parts, and a bracket that may be rotated.

sheet = (
    box(0, 0, 1, 0.6)
    - Point(0.25, 0.35).buffer(0.17)
    - Point(0.8, 0.1).buffer(0.15)
    - box(0.5, 0.45, 0.75, 0.6)
)
bracket = cspace.Robot.polygon(
    Polygon([(0, 0), (0.25, 0), (0.25, 0.06), (0.06, 0.06), (0.06, 0.2), (0, 0.2)])
)
workspace = cspace.Workspace.from_polygons([sheet], spacing=0.005)
space = cspace.build(workspace, bracket, rotations=36, outside="free")

# %%
# All positions on a lattice, at all yaws, in one call.

x, y = np.meshgrid(np.arange(0, 1, 0.01), np.arange(0, 0.6, 0.01))
yaws = np.radians(np.arange(0, 360, 10))
q = np.stack(np.broadcast_arrays(x[..., None], y[..., None], yaws), axis=-1)
fits = space.contains_robot(q)
print(
    f"it fits at {fits.sum()} of {fits.size} placements, and at every yaw at {fits.all(axis=-1).sum()} positions"
)

# %% The bracket, with its corner at a position, lies wholly in the sheet at more yaws where the
# position is darker.

figure, ax = plt.subplots(figsize=(8, 4.6), layout="constrained")
image = ax.imshow(fits.sum(axis=-1), origin="lower", extent=(0, 1, 0, 0.6), cmap="Blues")
figure.colorbar(image, label="yaws of 36")
for ring in (sheet.exterior, *sheet.interiors):
    ax.plot(*ring.xy, color="#262626")
ax.set(xlabel="x (m)", ylabel="y (m)")
figure.savefig("packing.png")
plt.close(figure)
print("wrote packing.png")

# %% ``overlap_count`` counts coinciding pairs of cells of sheet and part. The count decreases as
# the part leaves the sheet to the left.

print(space.overlap_count([(x, 0.02, 0.0) for x in (0.05, 0.0, -0.1, -0.2, -0.3)]))
