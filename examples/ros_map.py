"""
Plan on a ROS map
=================

A ROS map is a YAML file with an image beside it. The script writes a small one; for your own map,
change the name.
"""

import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import cspace
import planners
from cspace.plot import save_plot

# %%
# A room of 8 m by 6 m with a wall across it and unknown corners.

folder = tempfile.TemporaryDirectory()
pixels = np.full(
    (120, 160), 254, np.uint8
)  # rows from the top, 0.05 m each: 254 is free, 0 occupied, 205 unknown
pixels[:20, 120:] = 205
pixels[[0, -1], :] = pixels[:, [0, -1]] = 0
pixels[30:, 78:82] = 0
Image.fromarray(pixels).save(Path(folder.name, "room.pgm"))
file = Path(folder.name, "room.yaml")
file.write_text(
    "image: room.pgm\nmode: trinary\nresolution: 0.05\norigin: [-4.0, -3.0, 0.0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
)

# %%
# Unknown cells count as occupied unless you say ``unknown="free"``.

workspace = cspace.Workspace.open(file)
folder.cleanup()
space = cspace.build(workspace, cspace.Robot.disc(0.25))
plan = planners.plan(space, (-3.0, -2.0), (3.0, -2.0), seed=1)
print(plan)
save_plot(space, "ros_map.png", True, path=plan)
