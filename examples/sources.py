"""
Obstacles from files and arrays
===============================

Images, game maps, point clouds and arrays: ``Workspace.open`` reads files by their suffix, and each
format has its own method.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image, ImageDraw

import cspace

folder = tempfile.TemporaryDirectory()
here = Path(folder.name)

# %% An image with dark pixels as obstacles; a map in the MovingAI format; laser points with a
# radius; and a saved array.

image = Image.new("L", (160, 120), 255)
ImageDraw.Draw(image).ellipse((40, 30, 120, 90), fill=0)
image.save(here / "floor.png")
rows = ["." * 16, ".@@@@@@@@@@@@@@.", *6 * ["." * 16], ".@@@@@@..@@@@@@.", *3 * ["." * 16]]
(here / "arena.map").write_text("type octile\nheight 12\nwidth 16\nmap\n" + "\n".join(rows) + "\n")
angle = np.linspace(0, np.pi, 90)
np.save(here / "scan.npy", np.column_stack([4 + 3 * np.cos(angle), 1 + 3 * np.sin(angle)]))
np.save(here / "cells.npy", np.indices((80, 60)).sum(axis=0) % 40 == 0)

workspaces = [
    cspace.Workspace.open(here / "floor.png", spacing=0.05),
    cspace.Workspace.open(here / "arena.map", spacing=0.5),
    cspace.Workspace.from_points(
        np.load(here / "scan.npy"), radius=0.1, spacing=0.05, bounds=(0, 0, 8, 6)
    ),
    cspace.Workspace.from_array(here / "cells.npy", spacing=0.1),
]
folder.cleanup()

# %%
# Each workspace has the same contents: cells that touch an obstacle, and cells inside one.

figure, axes = plt.subplots(2, 2, figsize=(9, 7), layout="constrained", sharex=True, sharey=True)
for ax, workspace in zip(axes.flat, workspaces, strict=True):
    workspace.plot(ax=ax, legend=False, title=Path(workspace.source).name)
    print(repr(workspace).replace(folder.name + "/", ""))
figure.savefig("sources.png")
plt.close(figure)
print("wrote sources.png")
