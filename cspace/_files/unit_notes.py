"""Units, axes and shifts that comments of files without a field for them name."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final

import numpy as np

from cspace._support.arrays import Floats, StrPath
from cspace._support.check import MAX_NUMBER
from cspace._support.kinds import BRING_YOUR_FILE
from cspace._support.reporting import format_sides, warn_user
from cspace.errors import UnitWarning

_END_OF_HEADER: Final = re.compile(rb"\n(?:end_header|data)\b")
"""Last line, in lower case, of the headers of PLY and PCD files; binary data may follow."""

_UNIT_NOTE: Final = re.compile(
    rb"^(?:#|//|comment|obj_info)[^\n]*?"
    rb"(?:\b|(?<=_)(?=[cm]m))"
    rb"((?:milli|centi|kilo|micro|deci)met\w+|inch(?:es)?|feet|(?<!\d)(?<!\d[ _])[cm]m"
    rb"|units?\s*(?:[:=]|\bin\b|\bis\b|\bare\b)?\W{0,3}(?:in|ft)"
    rb"|[cm]m\s*=\s*1?\s*units?"
    rb"|\bunits?\s*(?:=|\bis\b|\bequals\b)\s*(?!1(?:\.0*)?\s*m(?:et\w+)?\b)[\d.]+\s*[a-z]+"
    rb"|units?\s*(?:[:=]|\bin\b|\bis\b|\bare\b)\W{0,3}(?!met(?:re|er)s?\b|m\b)[a-z]+"
    rb"|(?:(?:unit|global)[ _]?)?scal(?:e|ing)(?:[ _-]?factor)?\s*(?:[:=]|\bis\b|\bof\b)?\s*"
    rb"(?!1(?:\.0*)?(?::1)?(?![\d.:e]))[\d.]+[\d.:e-]*"
    rb"|met(?:re|er)s?[ _]?per[ _]?unit\s*[:=]?\s*(?!1(?:\.0*)?(?![\d.e]))[\d.]+)(?![a-z\d])",
    re.MULTILINE,
)
"""A comment, in lower case, with a unit other than the metre; a length such as 2 mm is none."""


_AXIS_NOTE: Final = re.compile(
    rb"^(?:#|//|comment|obj_info)[^\n]*?"
    rb"\b([xy][ _-]?(?:axis[ _-]?)?(?:is[ _-])?up|up[ _-]?(?:axis)?\s*[:=]\s*\+?[xy])\b",
    re.MULTILINE,
)
"""A comment, in lower case, by which another axis than z points up."""

_SHIFT_NOTE: Final = re.compile(
    rb"^(?:#|//|comment|obj_info)[^\n]*?"
    rb"((?:global[ _-]?)?(?:shift|offset|translation)\w*[^\n\d.-]{0,9}"
    rb"(?=[^\n]*[1-9])-?[\d.][^\n]*)",
    re.MULTILINE,
)
"""A comment, in lower case, by which a program moved the points before it wrote them."""


def warn_of_notes(path: StrPath) -> None:
    """Warn if a comment names another unit than metres, or says that points were moved."""
    name = os.fspath(path)
    note = _find_note(path, _UNIT_NOTE)
    if note:
        warn_of_units(name, note)
    shift = _find_note(path, _SHIFT_NOTE)
    if shift:
        warn_user(f"{name}: says {shift.strip()!r:.80}, and its points stay as they are")


def warn_of_axis(path: StrPath) -> None:
    """Warn if a comment names another axis than z that points up."""
    note = _find_note(path, _AXIS_NOTE)
    if note:
        name = os.fspath(path)
        warn_user(f"{name}: says {note!r}, and its axes stay as they are")


def _find_note(path: StrPath, pattern: re.Pattern[bytes]) -> str:
    """Return what a comment at the start of a file says, or ""."""
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in (".stl", ".obj", ".ply", ".pcd", ".xyz", ".txt", ".csv"):
        return ""
    with file.open("rb") as stream:
        # Number of bytes at the start of a file in which a comment may name a unit.
        text = stream.read(4096).lower()
    if suffix == ".stl":
        # The file begins with a comment, behind which binary data may follow.
        # Number of bytes of the comment of a binary STL file.
        text = b"#" + text[:80]
    note = pattern.search(_END_OF_HEADER.split(text)[0])
    return "" if note is None else note[1].decode("latin-1")


def warn_of_size(place: str, points: Floats, factors: Floats | None = None) -> None:
    """Warn of a part of a robot that is too large for metres, or too small once it was scaled.

    ``points``, shape (n, d), are its corners, and ``factors`` those by which a mesh was scaled.
    """
    sides = np.ptp(points, axis=0)
    # Largest side, metres, of a part of a robot whose unit is not suspected.
    if 20.0 < sides.max() <= MAX_NUMBER:  # larger ones are refused
        warn_user(
            f"{place} is {format_sides(sides)} large; units are metres; in centimetres it would be "
            f"{format_sides(sides / 100.0)} large, in millimetres {format_sides(sides / 1000.0)}",
            UnitWarning,
        )
    # Largest side, metres, of a mesh that may have been scaled from millimetres twice.
    if factors is not None and 0.0 < sides.max() < 1e-3:  # no unit makes a point larger
        warn_user(
            f"{place} is {format_sides(sides)} large, scaled by {factors.max():g}; units are "
            "metres",
            UnitWarning,
        )


def warn_of_units(name: str, units: str) -> None:
    """Warn that coordinates in other units count as metres."""
    warn_user(
        f"{name}: says {units!r}, and its coordinates are taken as metres; {BRING_YOUR_FILE}",
        UnitWarning,
    )
