"""Robots from what describes them: short texts, files, and the specs that saved maps hold."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.bodies import Solid
from cspace.errors import FileError, InputError
from cspace.io.meshes import SUFFIXES as MESHES
from cspace.robot import Robot
from cspace.shapes import check_origin

if TYPE_CHECKING:
    from cspace.mesh import Solid as Solidity


def robot_from_spec(spec: dict[str, Any]) -> Robot:
    """The robot that ``Robot.spec`` describes.

    Raises
    ------
    InputError
        If ``spec`` describes no robot.
    """
    try:
        made = _FROM_SPEC[spec["kind"]](spec)
        return replace(made, name=str(spec["name"]), definition=json.dumps(spec, sort_keys=True))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"robot spec {str(spec)[:80]} is not one that Robot.spec makes: {error}") from error


def open_robot(source: str | Path, solid: Solidity | None = None) -> Robot:
    """The robot of a short text or a file, as :meth:`Robot.open` tells."""
    try:
        path = Path(source)
    except TypeError as error:
        raise InputError(
            f"robot is {source!r}; it must be a short text such as 'ball:0.3' (metres), or a file name; pass a string "
            "or a pathlib.Path"
        ) from error
    suffix = path.suffix.lower()
    if suffix in MESHES:
        return Robot.mesh(path, solid=solid or "auto", name=f"mesh {path.name}")
    if solid is not None:
        raise InputError(f"solid is {solid!r} for {source}; it is for meshes: {', '.join(MESHES)}; leave it out")
    kind, colon, sizes = str(source).partition(":")
    if colon and kind in _SHORT:
        names, make = _SHORT[kind]
        return make(*_numbers(str(source), sizes, names))
    if suffix in _POLYGONS:
        return _polygon_file(path)
    forms = ", ".join(f"{key}:{'x'.join(name.upper() for name in names)}" for key, (names, _) in _SHORT.items())
    files = ", ".join((*_POLYGONS, *MESHES))
    if path.exists():
        raise FileError(f"{path}: suffix {path.suffix!r} is not a robot's; pass {forms} (metres), {files}")
    raise InputError(f"robot is {str(source)!r}; it must be one of {forms} (metres) or a file: {files}")


def _numbers(source: str, sizes: str, names: tuple[str, ...]) -> list[float]:
    """The numbers of a short text such as ``rect:0.9x0.6``."""
    words = sizes.split("x")
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != len(names) or not all(math.isfinite(value) and value > 0.0 for value in values):
        form = "x".join(name.upper() for name in names)
        raise InputError(
            f"robot is {source!r}; after the colon must stand {form}, each above zero, in metres; "
            f"write e.g. {source.partition(':')[0]}:{'x'.join(['0.3'] * len(names))}"
        )
    return values


def _polygon_file(path: Path) -> Robot:
    from cspace.io.vector import read_shapes

    return Robot.polygon(read_shapes(path), name=f"polygon {path.name}")


def _cells_from_spec(spec: dict[str, Any]) -> Robot:
    shape = tuple(int(n) for n in spec["shape"])
    bits = np.frombuffer(base64.b64decode(spec["bits"], validate=True), dtype=np.uint8)
    bitmap = np.unpackbits(bits, count=math.prod(shape)).astype(np.bool_).reshape(shape)
    return Robot.cells(bitmap, spec["spacing"], spec["lower"])


def _polygon_from_spec(spec: dict[str, Any]) -> Robot:
    import shapely

    return Robot.polygon([shapely.from_wkb(base64.b64decode(text, validate=True)) for text in spec["wkb"]])


def _mesh_from_spec(spec: dict[str, Any]) -> Robot:
    from cspace.mesh import Mesh

    mesh = Mesh.from_spec(spec)
    check_origin(*mesh.bounds)
    # What there was to warn of was said when the mesh was first taken.
    return Robot(str(spec["name"]), json.dumps(spec, sort_keys=True), Solid(mesh))


_FROM_SPEC: Final[dict[str, Callable[[dict[str, Any]], Robot]]] = {
    "balls": lambda spec: Robot.balls(spec["centers"], spec["radii"]),
    "box": lambda spec: Robot.box(spec["extents"], spec["center"]),
    "cells": _cells_from_spec,
    "mesh": _mesh_from_spec,
    "polygon": _polygon_from_spec,
}

_SHORT: Final[dict[str, tuple[tuple[str, ...], Callable[..., Robot]]]] = {
    "disc": (("radius",), Robot.disc),
    "rect": (("length", "width"), Robot.rectangle),
    "ball": (("radius",), Robot.ball),
    "box": (("x", "y", "z"), lambda x, y, z: Robot.box((x, y, z))),
}

_POLYGONS: Final = (".geojson", ".json", ".wkt")
