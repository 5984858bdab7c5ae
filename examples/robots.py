"""
Robots of many kinds
====================

A robot is a shorthand (``Robot.parse``), a file (``Robot.open``), or a shape in code. The command
line takes both.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from shapely.plotting import plot_polygon

import cspace

# %% A URDF of a cart with a mast. Only its collision geometry counts. Wheels move, so they are
# omitted with a warning unless you name links.

URDF = """<robot name="cart">
  <link name="base"><collision><geometry><box size="0.8 0.5 0.3"/></geometry></collision></link>
  <link name="mast"><collision><geometry><cylinder radius="0.1" length="1.0"/></geometry></collision></link>
  <joint name="fixed" type="fixed"><parent link="base"/><child link="mast"/><origin xyz="-0.45 0 0.5"/></joint>
</robot>"""
folder = tempfile.TemporaryDirectory()
urdf = Path(folder.name, "cart.urdf")
urdf.write_text(URDF)

# %%
# On a plane map, a robot in space is represented by its projection, ``footprint``.

texts = [
    "disc:0.3",
    "rect:0.9x0.5@0.2,0",
    "ellipse:0.5,0.3",
    "footprint:[[0.4,0.3],[0.4,-0.3],[-0.2,-0.2],[-0.2,0.2]]",
]
texts += ["cylinder:0.3x1.2", "capsule:0.2x0.8"]
robots = [*(cspace.Robot.parse(text) for text in texts), cspace.Robot.open(urdf)]
robots.append(cspace.Robot.from_bitmap(np.tri(5, dtype=bool), spacing=0.1, lower=(-0.2, -0.2)))
folder.cleanup()

figure, axes = plt.subplots(4, 2, figsize=(6.5, 8), layout="constrained", sharex=True, sharey=True)
for ax, robot in zip(axes.flat, robots, strict=False):
    print(robot)
    flat = robot if robot.dim == 2 else robot.footprint()
    plot_polygon(flat.geometry, ax, add_points=False, color="#009e73")
    ax.plot(0, 0, "k+", markersize=10)
    ax.set_aspect("equal")
    ax.set_title(robot.name.replace(folder.name, "")[:28], fontsize=9)
figure.savefig("robots.png")
plt.close(figure)
print("wrote robots.png")

# %%
# Robots and their shorthands can be obstacles as well.

print(
    cspace.Workspace.from_shapes(
        ["ellipse:0.5,0.3@1,1", cspace.Robot.disc(0.4, (3, 1)), "rect:4x0.1@2,2"], 0.05
    )
)
