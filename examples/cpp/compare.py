"""Build a map, plan on it in C++ with OMPL, and certify the paths in Python.

Run it in an empty folder, with cmake, a compiler, libompl-dev and libzstd-dev installed.
"""

import subprocess
from pathlib import Path

import numpy as np

import cspace

cells = np.zeros((80, 60), dtype=bool)
cells[38:42, :40] = True
workspace = cspace.Workspace.from_array(cells, 0.1)
space = cspace.build(workspace, cspace.Robot.rectangle(0.7, 0.4), rotations=36)
space.save("map.zarr", overwrite=True, compress=False, clearance=True)

source = Path(__file__).parent
configure = ["cmake", "-S", str(source), "-B", "build", f"-Dcspace_DIR={cspace.get_cmake_dir()}"]
subprocess.run(configure, check=True, stdout=subprocess.DEVNULL)
subprocess.run(["cmake", "--build", "build"], check=True, stdout=subprocess.DEVNULL)

ends = ["1", "1", "0", "7", "1", "3"]
subprocess.run(["build/plan", "map.zarr", "path", *ends], check=True)
for planner in ("RRTConnect", "BITstar"):
    path = np.loadtxt(f"path-{planner}.csv", delimiter=",")
    print(f"{planner}: certify_path is {space.certify_path(path).all()}")
