"""ROS maps: a YAML file and the image beside it, read and written."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Bools, Floats
from cspace.errors import FileError, InputError, warn_user
from cspace.grid import SLACK, Grid, check_word
from cspace.io.files import UNKNOWNS, Fault, decoding, replacing, suffix_of
from cspace.io.image import Shades, read_shades
from cspace.io.limits import check_cells
from cspace.io.plain import read_yaml
from cspace.raster.bitmaps import boundary_segments
from cspace.states import BLOCKED, FREE, MIXED

SUFFIXES: Final = (".yaml", ".yml")
QUARTERS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cosine and sine of 0 to 3 quarter turns."""

_FAR: Final = 1e15
"""Metres beyond which nothing is placed; resolutions are no smaller than one part of it."""
_KEYS: Final = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
"""What the YAML file must say."""

LEVELS: Final = {FREE: 254, MIXED: 205, BLOCKED: 0}
"""Grey of each state in a written map, as the ROS tools write free, unknown and occupied."""


def read_ros_map(path: str | os.PathLike[str], unknown: str = "occupied") -> tuple[Grid, Bools, Bools, Bools]:
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

    A map that is turned by a whole number of quarter turns stays exact. By any other ``yaw`` its cells become squares
    turned about the origin's corner; they are rasterised onto an upright grid of the same spacing that covers them,
    whose cells beyond the turned map are unknown.

    Parameters
    ----------
    path : path-like
        The YAML file. Its ``image`` is looked up beside it.
    unknown : {"occupied", "free"}
        What unknown cells are.

    Returns
    -------
    grid : Grid
    outer, inner : ndarray of bool, shape grid.shape
        Cells that meet an obstacle and cells that lie in obstacles; the same array unless the map is turned.
    unknown : ndarray of bool, shape grid.shape
        Cells that the map says nothing of; of a turned map, those whose middle lies in such a cell or beyond the map.

    Raises
    ------
    InputError
        If ``unknown`` is neither word.
    FileError
        If the YAML or its image is missing or malformed; the message names the key and its value.
    """
    check_word(unknown, "unknown", UNKNOWNS)
    with decoding(path, "ROS map"):
        header = _read_header(path)
    free, occupied = MODES[header.mode](header, read_shades(header.image, "ROS map's image"))
    try:
        return on_grid(header.info, free, occupied, unknown)
    except InputError as error:
        fault = f"{error.argument} {error.fault}"
        raise FileError(header.info.source, fault, error.rule, error.mend, value=error.value) from error


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


def on_grid(info: MapInfo, free: Bools, occupied: Bools, unknown: str) -> tuple[Grid, Bools, Bools, Bools]:
    """The cells of a map on an upright grid, as :func:`read_ros_map` returns them.

    What is neither free nor occupied is unknown. ``free`` and ``occupied`` may be overwritten.

    Raises InputError if no grid can lie there, and FileError if it has more cells than are read, or than fit into
    memory.
    """
    unsure = free | occupied
    np.logical_not(unsure, out=unsure)
    solid = np.logical_not(free, out=free) if unknown == "occupied" else occupied
    turns = _quarter_turns(info.yaw, solid.shape)
    if turns is None:
        return _turned(info, solid, unsure, solid_around=unknown == "occupied")
    lower, _ = _extent(info, solid.shape, *QUARTERS[turns])
    cells = np.rot90(solid, turns)
    return Grid(lower, info.resolution, cells.shape), cells, cells, np.rot90(unsure, turns)


def write_ros_map(state: ArrayLike, grid: Grid, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map of the states FREE, MIXED and BLOCKED, shape (nx, ny), as a ROS map: free, unknown and occupied.

    The path is that of the YAML file, ending in ``.yaml`` or ``.yml``; the image goes beside it, ending in ``.pgm``.
    Where one cannot be written, neither is changed. Reading it back with ``unknown="occupied"`` gives the cells that
    are not FREE, with ``unknown="free"`` those that are BLOCKED, on the same grid to the last bit.
    """
    import yaml

    suffix_of(path, SUFFIXES, "a ROS map ends in .yaml")
    target = Path(path)
    cells = np.asarray(state)
    if cells.shape != grid.shape[:2]:
        fault = f"has shape {cells.shape} on a grid of {grid.shape}, and {target} names a ROS map"
        raise InputError(
            "state", fault, "it is that of a grid in the plane", "pass CSpace.state, or one slice of it", value=state
        )
    if cells.dtype.kind not in "iu" or cells.min() < FREE or cells.max() > BLOCKED:
        raise InputError(
            "state",
            "holds other values than FREE, MIXED and BLOCKED",
            "it is a state",
            "pass CSpace.state",
            value=state,
        )
    image = target.with_suffix(".pgm")
    header = {
        "image": image.name,
        "mode": "trinary",
        "resolution": grid.spacing,
        "origin": [*grid.lower, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.1,
    }
    levels = np.array([LEVELS[value] for value in sorted(LEVELS)], dtype=np.uint8)
    pixels = levels[cells].T[::-1]
    # The YAML refers to the image, so that it gets its name last.
    with replacing(target, overwrite) as yaml_file, replacing(image, overwrite) as image_file:
        image_file.write_bytes(b"P5\n%d %d\n255\n" % (grid.shape[0], grid.shape[1]) + pixels.tobytes())
        yaml_file.write_text(yaml.safe_dump(header, sort_keys=False, default_flow_style=None), encoding="utf-8")


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


def _quarter_turns(yaw: float, shape: tuple[int, ...]) -> int | None:
    """Number of quarter turns, 0 to 3, where ``yaw`` is a multiple of them up to rounding; else None."""
    if abs(yaw) > 4.0 * math.pi:  # so far out, multiples of pi / 2 are off by more than the yaw that is asked for
        return None
    turns = round(yaw / (math.pi / 2))
    error = abs(yaw - turns * (math.pi / 2))
    return turns % 4 if error * math.hypot(*shape) <= SLACK / 64 else None


def _extent(info: MapInfo, shape: tuple[int, ...], cos: float, sin: float) -> tuple[Floats, Floats]:
    """Lower and upper corner of the box around the turned map, in metres."""
    corners = np.array([(0, 0), (shape[0], 0), shape, (0, shape[1])]) @ np.array([(cos, sin), (-sin, cos)])
    return (
        np.asarray(info.origin + info.resolution * corners.min(axis=0)),
        np.asarray(info.origin + info.resolution * corners.max(axis=0)),
    )


def _turned(info: MapInfo, solid: Bools, unknown: Bools, solid_around: bool) -> tuple[Grid, Bools, Bools, Bools]:
    """The map turned by its yaw, on an upright grid; ``solid_around``: whether the ground around it is solid."""
    from cspace.raster.segments import outline_cells

    cos, sin = math.cos(info.yaw), math.sin(info.yaw)
    lower, upper = _extent(info, solid.shape, cos, sin)
    # The corners are rounded, so that the grid is wider than their box by more than that.
    counts = np.ceil((upper - lower) / info.resolution + 2.0 * SLACK)
    middle = 0.5 * (lower + upper)
    shape = tuple(int(n) for n in counts)
    check_cells(info.source, shape, memory=8.0)
    grid = Grid(middle - 0.5 * info.resolution * counts, info.resolution, shape)
    # The border of whichever set lies within the turned map: the ground around it then needs no border of its own.
    bounded = ~solid if solid_around else solid
    segments = boundary_segments(bounded, 1.0, (0.0, 0.0)).reshape(-1, 2)
    turned = info.origin + info.resolution * (segments @ np.array([(cos, sin), (-sin, cos)]))
    outer, inner = outline_cells([(turned.reshape(-1, 4), True)] if len(segments) else [], grid)
    if solid_around:
        outer, inner = ~inner, ~outer
    return grid, outer, inner, _sampled(info, unknown, grid)


def _sampled(info: MapInfo, cells: Bools, grid: Grid) -> Bools:
    """Cells of a grid whose middle lies in a given cell of the turned map, or beyond it."""
    cos, sin = math.cos(info.yaw), math.sin(info.yaw)
    x, y = (grid.centers(axis) - info.origin[axis] for axis in range(2))
    sampled = np.ones(grid.shape, dtype=np.bool_)
    for column, along in enumerate(x):  # a column at a time: places of all cells would take 32 bytes each
        places = np.stack([cos * along + sin * y, cos * y - sin * along], axis=-1) / info.resolution
        cell = np.floor(places).astype(np.int64)
        within = ((cell >= 0) & (cell < cells.shape)).all(axis=-1)
        sampled[column, within] = cells[tuple(cell[within].T)]
    return sampled
