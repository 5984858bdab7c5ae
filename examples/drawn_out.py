"""
Can a part be drawn out of its housing?
=======================================

A key with a wide head sits in a T-shaped slot. It cannot be lifted out; it can be slid out, unless
the slot's end is capped. Whether it comes out is a question of connectivity: the map answers it
with a proof, and no planner is run.
"""

import trimesh

import cspace
from cspace.plot import save_plot


def solid(*corners: tuple[tuple[float, ...], tuple[float, ...]]) -> trimesh.Trimesh:
    """Return the union of boxes, which may overlap, from lower and upper corners in millimetres."""
    return trimesh.util.concatenate(
        [
            trimesh.creation.box(bounds=[[c / 1000 for c in low], [c / 1000 for c in high]])
            for low, high in corners
        ]
    )


# %% The key has a head of 20 x 24 x 6 mm with a stem of 10 mm. The housing is a block with a slot
# along x.

key = cspace.Robot.from_mesh(
    solid(((-10, -12, 0), (10, 12, 6)), ((-10, -5, 5), (10, 5, 20))), name="key"
)
block = [
    ((-30, -24, -10), (30, 24, -2)),  # floor
    ((-30, -24, -4), (30, -14, 14)),  # walls
    ((-30, 14, -4), (30, 24, 14)),
    ((-30, -16, 9), (30, -7, 14)),  # lips over the head
    ((-30, 7, 9), (30, 16, 14)),
    ((-30, -24, -4), (-22, 24, 14)),  # end
]
cap = ((22, -24, -4), (30, 24, 14))

# %%
# Seated, the key is at the origin; outside means above the housing. Cells are half a millimetre.

seated, outside = (0.0, 0.0, 0.0), (0.0, 0.0, 0.045)
for name, parts in (("open", block), ("capped", [*block, cap])):
    workspace = cspace.Workspace.from_mesh(
        solid(*parts), 0.0005, (-0.06, -0.05, -0.03, 0.08, 0.05, 0.06)
    )
    space = cspace.build(workspace, key, outside="free")
    print(f"slot {name}: the key")
    print(f"  comes out, proven: {space.is_connected(seated, outside)}")
    print(f"  cannot come out, proven: {space.is_disconnected(seated, outside)}")
    print(f"  straight up: {space.motion_is_free(seated, outside)}")
    print(f"  room of the seated key: {1000 * space.clearance(seated):.1f} mm in every direction")
    save_plot(space, f"drawn_out_{name}.png", True, start=seated, goal=outside, center=seated)
