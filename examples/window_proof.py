"""
Bodies that pass a window, and one that cannot
==============================================

A plank across a window passes once it is rotated about any axis. A cube passes at no rotation: no
chain of cells that might be free leads through the window. No planner can give such a proof.
"""

import trimesh

import cspace
import planners
from cspace.plot import save_plot

# %% Two rooms of 4 m by 4 m, and a wall of 0.46 m between them with a window of 0.9 m by 0.9 m in
# its middle.

parts = [
    ((2.77, 0.0, 0.0), (3.23, 1.55, 4.0)),
    ((2.77, 2.45, 0.0), (3.23, 4.0, 4.0)),
    ((2.77, 1.55, 0.0), (3.23, 2.45, 1.55)),
    ((2.77, 1.55, 2.45), (3.23, 2.45, 4.0)),
]
wall = trimesh.util.concatenate([trimesh.creation.box(bounds=part) for part in parts])
workspace = cspace.Workspace.from_mesh(wall, 0.1, bounds=(0, 0, 0, 6, 4, 4))
start, goal = (1.2, 2.0, 2.0), (4.8, 2.0, 2.0)

# %%
# The plank is along y and does not rotate:

still = cspace.build(workspace, cspace.Robot.box((0.3, 1.4, 0.3)))
print("no path exists, proven:", still.is_disconnected(start, goal))

# %% The same plank, along y at both ends, and a cube, both at any rotation in between. If the cells
# cannot decide, an exact check of the geometry can.

along_y = (0.0, 0.0, 0.5**0.5, 0.5**0.5)
for name, sides in (("plank", (1.4, 0.3, 0.3)), ("cube", (1.2, 1.2, 1.2))):
    space = cspace.build(
        workspace, cspace.Robot.box(sides), rotations=cspace.Rotations.quaternions(8)
    )
    plan = planners.plan(space.exact, (*start, *along_y), (*goal, *along_y), time_limit=20, seed=1)
    print(f"{name}: {plan.status}; certified: {plan.certified}")
    path = plan if plan else None
    save_plot(
        space,
        f"window_{name}.png",
        True,
        path=path,
        start=(*start, *along_y),
        goal=(*goal, *along_y),
        view="3d",
    )
