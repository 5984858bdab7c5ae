"""Read rows of 0 and 1 in JSON, the first row at the top; 1 is a wall.

Cells of 0 to 100 and -1 are those of an occupancy grid: ``Workspace.from_occupancy_grid``.
"""

import json
from pathlib import Path

import numpy as np

import cspace
from cspace.errors import FileError


def read_json_rows(path: str, spacing: float = 0.1) -> cspace.Workspace:
    """Read rows of cells with ``spacing`` metres a side."""
    rows = json.loads(Path(path).read_text(encoding="utf-8"))
    is_rows = isinstance(rows, list) and all(isinstance(row, list) for row in rows)
    if not is_rows or len({len(row) for row in rows}) != 1:
        raise FileError(path, "holds no rows of one length", "a list has a list for each row")
    if not {cell for row in rows for cell in row} <= {0, 1}:
        raise FileError(path, "has other cells than 0 and 1", "0 is free, and 1 is a wall")
    return cspace.Workspace.from_array(np.array(rows, dtype=bool)[::-1].T, spacing)


if __name__ == "__main__":
    import sys

    print(read_json_rows(sys.argv[1]))
