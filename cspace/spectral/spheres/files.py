"""Balls in YAML and JSON files."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from cspace.errors import FileError, InputError
from cspace.io.input import read_text
from cspace.io.output import replacing
from cspace.spectral.spheres.result import Spheres

FORMAT: Final = "cspace-spheres"
VERSION: Final = 1

_BOUNDS: Final = ("measure", "shape_measure", "hausdorff")


def write_spheres(spheres: Spheres, path: str | os.PathLike[str], overwrite: bool) -> Path:
    """Write balls; as :meth:`Spheres.save` tells."""
    dump = _kind_of(path, _DUMP)
    record = {
        "format": FORMAT,
        "version": VERSION,
        "kind": spheres.kind,
        "method": spheres.method,
        **{name: list(getattr(spheres, name)) for name in _BOUNDS},
        "centers": spheres.centers.tolist(),
        "radii": spheres.radii.tolist(),
    }
    with replacing(path, overwrite) as temporary:
        temporary.write_text(dump(record), encoding="utf-8")
    return Path(path)


def read_spheres(path: str | os.PathLike[str]) -> Spheres:
    """Read balls; as :meth:`Spheres.open` tells."""
    load = _kind_of(path, _LOAD)
    text, name = read_text(path, "file of balls"), os.fspath(path)
    try:
        record = load(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{name} cannot be parsed: {error}; it must be as Spheres.save writes it; mend it") from error
    if not isinstance(record, Mapping) or record.get("format") != FORMAT:
        raise FileError(f"{name} holds no balls; its format must be {FORMAT!r}; pass a file that Spheres.save wrote")
    if record.get("version") != VERSION:
        raise FileError(
            f"{name} has version {record.get('version')!r}; this library reads {VERSION}; use the library that wrote it"
        )
    try:
        bounds = {key: record[key] for key in _BOUNDS}
        return Spheres(record["centers"], record["radii"], record["kind"], str(record["method"]), **bounds)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        what = f"lacks {error}" if isinstance(error, KeyError) else f"is malformed: {error}"
        raise FileError(f"{name} {what}; it must be as Spheres.save writes it; mend or write it again") from error


def _kind_of(path: str | os.PathLike[str], table: Mapping[str, Callable[..., Any]]) -> Callable[..., Any]:
    try:
        suffix = Path(path).suffix.lower()
    except TypeError as error:
        raise InputError(f"path is {path!r}; it must be a file name; pass a string or a pathlib.Path") from error
    if suffix not in table:
        raise InputError(
            f"{os.fspath(path)} has the suffix {suffix!r}; balls go into {', '.join(table)}; name it e.g. balls.json"
        )
    return table[suffix]


def _to_json(record: Mapping[str, Any]) -> str:
    return json.dumps(record, indent=1) + "\n"


def _to_yaml(record: Mapping[str, Any]) -> str:
    import yaml

    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return str(yaml.dump(record, Dumper=dumper, sort_keys=False, default_flow_style=None, width=120))


def _from_yaml(text: str) -> Any:
    import yaml

    try:
        return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error


_DUMP: Final[dict[str, Callable[..., str]]] = {".yaml": _to_yaml, ".yml": _to_yaml, ".json": _to_json}
_LOAD: Final[dict[str, Callable[..., Any]]] = {".yaml": _from_yaml, ".yml": _from_yaml, ".json": json.loads}
