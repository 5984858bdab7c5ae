"""Read a ``LaserScan`` as ``ros2 topic echo --once --full-length`` prints it.

The world is in the frame of the scanner. A beam out of its range met nothing, and is no point.
"""

from pathlib import Path

import numpy as np
import yaml

import cspace
from cspace.errors import FileError


def read_laser_scan(path: str, spacing: float = 0.1, radius: float = 0.05) -> cspace.Workspace:
    """Read the ends of beams as discs of a radius, metres."""
    scan = next(yaml.safe_load_all(Path(path).read_text(encoding="utf-8")))
    if "..." in scan["ranges"]:
        raise FileError(
            path, "lacks beams", "all are needed", "pass --full-length to ros2 topic echo"
        )
    ranges = np.array(scan["ranges"], dtype=float)
    beams = np.flatnonzero((ranges >= scan["range_min"]) & (ranges <= scan["range_max"]))
    angles = scan["angle_min"] + scan["angle_increment"] * beams
    points = (ranges[beams] * (np.cos(angles), np.sin(angles))).T
    return cspace.Workspace.from_points(points, spacing, radius=radius)


if __name__ == "__main__":
    import sys

    print(read_laser_scan(sys.argv[1]))
