"""Paths that were saved as CSV or JSON."""

from __future__ import annotations

import csv
import json
from pathlib import Path

from cspace.errors import FileError


def read_path(file: Path) -> list[list[float]]:
    """The configurations of a path, as ``cspace plan`` writes it.

    Parameters
    ----------
    file : pathlib.Path
        CSV, one configuration in a row below one row of names; or JSON with the configurations under ``path``.

    Returns
    -------
    list of list of float
        x and y of each configuration, in metres, and its yaw, in radians, where there is one.

    Raises
    ------
    FileError
        If the file cannot be read or holds no path.
    """
    try:
        text = file.read_text(encoding="utf-8")
        rows = json.loads(text)["path"] if file.suffix.lower() == ".json" else list(csv.reader(text.splitlines()))[1:]
        points = [[float(value) for value in row] for row in rows]
        if any(len(point) not in (2, 3) or len(point) != len(points[0]) for point in points):
            raise ValueError
    except OSError as error:
        raise FileError(f"{file} cannot be read: {error.strerror}; a path is a CSV or JSON file") from error
    except (ValueError, TypeError, KeyError) as error:
        raise FileError(
            f"{file} holds no path; a path is a CSV file with the columns x and y, and perhaps yaw, or a JSON file "
            "with the configurations under path; let cspace plan write one"
        ) from error
    if not points:
        raise FileError(f"{file} holds no configuration; a path has at least one; let cspace plan write one")
    return points
