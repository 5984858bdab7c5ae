"""Paths that were saved as CSV or JSON."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from cspace.cli.forms import Form
from cspace.errors import FileError


def read_path(file: Path, form: Form) -> list[list[float]]:
    """The configurations of a path, as ``cspace plan`` writes it.

    Parameters
    ----------
    file : pathlib.Path
        CSV, one configuration in a row below one row of names; or JSON with the configurations under ``path``.
    form : Form
        Of the map that the path is for.

    Returns
    -------
    list of list of float
        x and y of each configuration, in metres, and its z, or its yaw, in radians, where there is one.

    Raises
    ------
    FileError
        If the file cannot be read or holds no path.
    """
    try:
        names, rows = _table(file)
        points = [[float(value) for value in row] for row in rows]
        if any(len(point) not in (2, 3) or len(point) != len(points[0]) for point in points):
            raise ValueError
    except OSError as error:
        raise FileError(f"{file} cannot be read: {error.strerror}; a path is a CSV or JSON file") from error
    except (ValueError, TypeError, KeyError) as error:
        raise FileError(
            f"{file} holds no path; a path is a CSV file with the columns x and y, and perhaps yaw or z, or a JSON "
            "file with the configurations under path; let cspace plan write one"
        ) from error
    if len(names) == len(form.value) and names != form.value:
        raise FileError(
            f"{file} holds {', '.join(names)}; the configurations of the map are {', '.join(form.value)}; let cspace "
            "plan write a path on this map"
        )
    if not points:
        raise FileError(f"{file} holds no configuration; a path has at least one; let cspace plan write one")
    return points


def _table(file: Path) -> tuple[tuple[str, ...], Any]:
    """What the numbers of a path are called, where the file says so, and its configurations."""
    text = file.read_text(encoding="utf-8")
    if file.suffix.lower() == ".json":
        record = json.loads(text)
        if not isinstance(record, dict):
            raise ValueError
        return tuple(record.get("axes", ())), record["path"]
    rows = list(csv.reader(text.splitlines()))
    # A car's path also tells which way it drives.
    kept = [number for number, name in enumerate(rows[0] if rows else ()) if name != "direction"]
    names = tuple(rows[0][number] for number in kept)
    return names, [[row[number] for number in kept] if len(row) == len(rows[0]) else row for row in rows[1:]]
