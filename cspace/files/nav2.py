"""Robots as Nav2 describes them: footprints as text, and the YAML files of its parameters."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from numpy.typing import ArrayLike

from cspace.arrays import Floats
from cspace.check import finite, not_negative, positive
from cspace.errors import FileError, GeometryError
from cspace.files.plain import read_yaml

PADDING: Final = 0.01
"""Metres of ``footprint_padding`` where a file does not say."""

_NONE: Final[tuple[object, ...]] = (None, "", "[]", [])
"""Footprints that are none, for which the radius counts."""


class Base(NamedTuple):
    """What a costmap says of a robot: the corners of its footprint, or else its radius; and by how much to pad it."""

    corners: tuple[tuple[float, float], ...]
    radius: float
    padding: float

    def __str__(self) -> str:
        size = f"a footprint of {len(self.corners)} corners" if self.corners else f"a robot_radius of {self.radius:g} m"
        return f"{size}, footprint_padding {self.padding:g} m"


def corners_of(footprint: str | ArrayLike, name: str = "footprint") -> Floats:
    """The corners of a footprint, shape (n, 2), metres.

    A text is Nav2's, ``"[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"``. Raises GeometryError if it is not a
    list of three points or more, and InputError, with its ``name``, if a number is not finite.
    """
    rule = "it must be three points or more, each of two numbers, x and y in metres"
    fault, mend = f"is {footprint!r:.80}", "write e.g. [[0.3, 0.2], [0.3, -0.2], [-0.3, 0]]"
    try:
        value = ast.literal_eval(footprint.strip()) if isinstance(footprint, str) else footprint
        corners = finite(value, name)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError) as error:
        raise GeometryError(name, fault, rule, mend, value=footprint) from error
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise GeometryError(name, fault, rule, mend, value=footprint)
    return corners


def read_nav2(path: str | os.PathLike[str], costmap: str | None = None) -> Base:
    """What a file of parameters says of the robot.

    Every table that holds ``footprint`` or ``robot_radius`` is looked at, at whatever depth: those of the local and of
    the global costmap in a file of Nav2, or the top of a ``costmap_common_params.yaml`` of ROS 1. Where the costmaps of
    a file differ in it, one has to be named, such as "local_costmap".

    Raises FileError if the file is missing or malformed, describes no robot, or several, or not that costmap.
    """
    file = os.fspath(path)
    tables = dict(_tables(read_yaml(path, "file of Nav2's parameters"), ()))
    if not tables:
        mend = "write e.g. 'robot_radius: 0.22' in its local_costmap and global_costmap"
        raise FileError(file, "holds neither footprint nor robot_radius", "a costmap has one of them", mend)
    bases = {name: _base(table, f"{file}: {name or 'the file'}") for name, table in tables.items()}
    chosen = {name: base for name, base in bases.items() if costmap is None or name.endswith(costmap)}
    if not chosen:
        raise FileError(file, f"has no costmap {costmap!r}", f"it has {', '.join(bases)}", "name one of these")
    if len(set(chosen.values())) > 1:
        names = "; ".join(f"{name} has {base}" for name, base in chosen.items())
        first = next(iter(chosen))
        mend = f"pass e.g. costmap={first!r}, or {Path(file).name}#{first}"
        raise FileError(file, f"tells of more than one robot: {names}", "one is mapped at a time", mend)
    return next(iter(chosen.values()))


def _tables(value: Any, path: tuple[str, ...]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Tables that tell of a robot, each with the names of those that it is in; a repeated name is said once."""
    if not isinstance(value, dict):
        return
    if value.get("footprint") not in _NONE or "robot_radius" in value:
        names = [name for name in path if name != "ros__parameters"]
        yield "/".join(name for k, name in enumerate(names) if name not in names[k - 1 : k]), value
    for name, part in value.items():
        yield from _tables(part, (*path, name))


def _base(table: Mapping[str, Any], place: str) -> Base:
    footprint: Any = table.get("footprint")
    padding = not_negative(table.get("footprint_padding", PADDING), f"{place}: footprint_padding")
    if footprint in _NONE:
        return Base((), positive(table["robot_radius"], f"{place}: robot_radius"), padding)
    corners: Sequence[Sequence[float]] = corners_of(footprint, f"{place}: footprint").tolist()
    return Base(tuple((x, y) for x, y in corners), 0.0, padding)
