"""
Put a part into a pocket
========================

``spectral.best_placements`` searches all positions at a grid of rotations, one FFT each, and moves
the best placements along the gradient. It needs the extra ``spectral``.
"""

import matplotlib.pyplot as plt
import shapely
from shapely import affinity

from cspace.spectral import best_placements, decompose

# %% A bracket, and a sheet with a pocket that is 5 mm wider than the bracket on all sides,
# somewhere and rotated.

bracket = shapely.Polygon([(0, 0), (0.25, 0), (0.25, 0.06), (0.06, 0.06), (0.06, 0.2), (0, 0.2)])
pocket = affinity.translate(
    affinity.rotate(bracket.buffer(0.005, join_style="mitre"), 37, origin=(0, 0)), 0.4, 0.2
)
hole = shapely.Point(0.75, 0.2).buffer(0.12)
sheet = shapely.box(0, 0, 1, 0.6) - pocket - hole

# %% The score is the overlap with what is free, less a hundred times the overlap with the material,
# both in discs.

free = shapely.union_all([pocket, hole])
part, open_space, material = (
    decompose(shape, kind="inner", number=number)
    for shape, number in ((bracket, 48), (free, 96), (sheet, 256))
)
best = best_placements(part, open_space, 36, n=3, avoid=material)

# %%
# The scores order the placements; shapely tells what they are worth.

figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
for ring in (sheet.exterior, *sheet.interiors):
    ax.plot(*ring.xy, color="#262626")
for k in range(len(best.scores)):
    placed = affinity.affine_transform(bracket, [*best.rotations[k].ravel(), *best.translations[k]])
    inside = placed.intersection(free).area / bracket.area
    x, y, yaw = best.configurations[k]
    print(
        f"({x:.4f}, {y:.4f}, {yaw:.4f}): score {best.scores[k]:.4f} m², {inside:.1%} in free space"
    )
    ax.fill(*placed.exterior.xy, alpha=0.5, label=f"{k + 1}: {inside:.1%} in free space")
ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
ax.legend(loc="upper right")
figure.savefig("best_placements.png")
plt.close(figure)
print("wrote best_placements.png")
