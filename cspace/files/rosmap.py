"""ROS maps: a YAML file and the image beside it."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats
from cspace.errors import warn_user
from cspace.files.access import Fault, decoding
from cspace.files.image import Shades, read_shades
from cspace.files.plain import read_yaml

SUFFIXES: Final = (".yaml", ".yml")

_FAR: Final = 1e15
"""Metres beyond which nothing is placed; resolutions are no smaller than one part of it."""
_KEYS: Final = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
"""What the YAML file must say."""


def read_ros_map(path: str | os.PathLike[str]) -> tuple[MapInfo, Bools, Bools]:
    """Read a ROS map.

    The image becomes cells as in map_server of ROS 1 and Navigation2. With *shade* the mean of the colour channels
    from 0 (black) to 1 (white), and ``p = 1 - shade``, or ``p = shade`` where ``negate`` is 1:

    * ``trinary`` (also where ``mode`` is absent): ``p >= occupied_thresh`` is occupied, ``p < free_thresh`` is free,
      the rest is unknown;
    * ``scale``: ``p < free_thresh`` is free, the rest is occupied: a cell that is occupied with some probability is
      not proven free;
    * ``raw``: ``round(255 * shade)`` is the occupancy in per cent; below ``100 * free_thresh`` is free, up to 100 is
      occupied, above is unknown.

    In ``trinary`` and ``scale`` a pixel that is not fully opaque is unknown, as in Navigation2 since 2025. Releases
    disagree about ``p`` equal to a threshold; here it is never free.

    Parameters
    ----------
    path : path-like
        The YAML file. Its ``image`` is looked up beside it.

    Returns
    -------
    info : MapInfo
        Where the cells lie.
    free, occupied : ndarray of bool, shape (nx, ny)
        Cells that are neither are unknown.

    Raises
    ------
    FileError
        If the YAML or its image is missing or malformed; the message names the key and its value.
    """
    with decoding(path, "ROS map"):
        header = _read_header(path)
    return header.info, *MODES[header.mode](header, read_shades(header.image, "ROS map's image"))


class MapInfo(NamedTuple):
    """Where the cells of a map lie.

    Attributes
    ----------
    source : str
        What the map is, for messages.
    resolution : float
        Side of a cell, metres.
    origin : tuple of float
        Lower left corner of the first cell, metres.
    yaw : float
        By which the map is turned about that corner, radians.
    """

    source: str
    resolution: float
    origin: tuple[float, float]
    yaw: float


@dataclass(frozen=True, slots=True)
class _Header:
    """What the YAML file says."""

    info: MapInfo
    image: Path
    mode: str
    negate: bool
    occupied_thresh: float
    free_thresh: float


def _read_header(path: str | os.PathLike[str]) -> _Header:
    document = read_yaml(path, "ROS map")
    if not isinstance(document, dict):
        raise _fault(f"holds {type(document).__name__}", "keys and values", "write e.g. 'resolution: 0.05'")
    missing = [key for key in _KEYS if key not in document]
    if missing:
        beside = ", ".join(document) or "nothing"
        raise _fault(f"{missing[0]} is missing", f"there, beside {beside:.200}", f"add '{missing[0]}:'")
    image, mode, negate = document["image"], document.get("mode", "trinary"), document["negate"]
    if not isinstance(image, str) or not image or "\0" in image:
        raise _fault(f"image is {image!r:.60}", "the name of the image", "write e.g. 'image: map.pgm'")
    if not isinstance(mode, str) or mode not in MODES:
        raise _fault(f"mode is {mode!r:.60}", f"one of {', '.join(MODES)}", "correct it")
    resolution = _number(document["resolution"], "resolution")
    if not 1.0 / _FAR <= resolution <= _FAR:
        rule = f"metres per cell, above zero, from {1.0 / _FAR:g} to {_FAR:g}"
        raise _fault(f"resolution is {resolution}", rule, "write e.g. 'resolution: 0.05'")
    origin = document["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise _fault(f"origin is {origin!r:.60}", "x, y and yaw", "write e.g. 'origin: [0.0, 0.0, 0.0]'")
    x, y, yaw = (_number(value, f"origin[{i}]") for i, value in enumerate(origin))
    if max(abs(x), abs(y)) > _FAR:
        raise _fault(f"origin is {origin!r:.60}", f"metres, at most {_FAR:g}", "check its units")
    if isinstance(negate, list | dict) or negate not in (0, 1):
        raise _fault(f"negate is {negate!r:.60}", "0 or 1", "write 'negate: 0' where dark pixels are obstacles")
    if negate and mode == "raw":
        raise _fault("negate is 1 in raw mode", "0 there: ROS 1 and ROS 2 disagree on what it does", "remove it")
    occupied, free = (_number(document[key], key) for key in ("occupied_thresh", "free_thresh"))
    for key, value in (("occupied_thresh", occupied), ("free_thresh", free)):
        if not 0.0 <= value <= 1.0:
            raise _fault(f"{key} is {value}", "between 0 and 1", "correct it")
    if free >= occupied:
        raise _fault(f"free_thresh is {free} and occupied_thresh is {occupied}", "free below occupied", "exchange them")
    info = MapInfo(os.fspath(path), resolution, (x, y), yaw)
    return _Header(info, _beside(path, image), mode, bool(negate), occupied, free)


def _beside(path: str | os.PathLike[str], image: str) -> Path:
    """The image's file; said where it is a link out of the folder of the map, or named so."""
    folder = Path(path).parent
    file = folder / image
    try:
        outside = not file.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError) as error:
        fault = f"image is {image!r:.60}, which cannot be looked up"
        raise _fault(fault, "the name of a file", "correct it") from error
    if outside:
        warn_user(f"{os.fspath(path)}: image is {image!r}, which lies outside of its folder")
    return file


def _number(value: Any, key: str) -> float:
    """A finite number."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise _fault(f"{key} is {value!r:.60}", "a finite number", "correct it")
    return number


def _fault(fault: str, rule: str, mend: str) -> Fault:
    return Fault(fault, f"in a ROS map it must be {rule}", mend)


def _trinary(header: _Header, image: Shades) -> tuple[Bools, Bools]:
    free, occupied = (
        image.where(lambda shade: _probability(header, shade) < header.free_thresh),
        image.where(lambda shade: _probability(header, shade) >= header.occupied_thresh),
    )
    return image.among_opaque(free), image.among_opaque(occupied)


def _scale(header: _Header, image: Shades) -> tuple[Bools, Bools]:
    free = image.where(lambda shade: _probability(header, shade) < header.free_thresh)
    return image.among_opaque(free), image.among_opaque(~free)


def _raw(header: _Header, image: Shades) -> tuple[Bools, Bools]:
    def percent(shade: Floats) -> Floats:
        return np.floor(255.0 * shade + 0.5)

    free = image.where(lambda shade: percent(shade) < 100.0 * header.free_thresh)
    return free, ~free & image.where(lambda shade: percent(shade) <= 100.0)


def _probability(header: _Header, shade: Floats) -> Floats:
    return shade if header.negate else 1.0 - shade


MODES: Final[Mapping[str, Callable[[_Header, Shades], tuple[Bools, Bools]]]] = {
    "trinary": _trinary,
    "scale": _scale,
    "raw": _raw,
}
"""From a shade to free and occupied cells, by the ``mode`` of the YAML; the remaining cells are unknown."""
