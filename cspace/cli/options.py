"""What options mean, and the checks that come before any work."""

from __future__ import annotations

import math
import os
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cspace.errors import FileError, InputError

if TYPE_CHECKING:
    from cspace.space import CSpace

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document, for machines.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace existing outputs.")]
# Typer looks at files before any command runs and tells of them in its own way; the library does it better.
MapFile = Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="A saved map: .zarr or .npz.")]


def configuration(text: str, option: str) -> tuple[float, ...]:
    """The configuration that an option such as ``--start`` gives: two numbers in metres, and perhaps a yaw.

    Raises
    ------
    InputError
        If the text is not two numbers, or two numbers and a yaw, with commas between them.
    """
    words = text.split(",")
    try:
        if len(words) not in (2, 3):
            raise ValueError
        x, y = map(float, words[:2])
    except ValueError:
        raise InputError(
            f"{option} is {text!r}; it must be two numbers in metres with a comma between them, and for a map with "
            f"rotations a yaw behind another; write e.g. {option}=-1.5,2 or {option}=-1.5,2,90deg"
        ) from None
    return (x, y, *(angle(word, option) for word in words[2:]))


def angle(text: str, option: str) -> float:
    """The angle that a word gives, in radians: ``90deg``, or a number of radians.

    Raises
    ------
    InputError
        If the text is neither, or more than a turn without a unit, which is taken for degrees that lack theirs.
    """
    word = text.strip()
    number, unit = next(((word.removesuffix(unit), unit) for unit in ("deg", "rad") if word.endswith(unit)), (word, ""))
    try:
        value = float(number)
    except ValueError:
        raise InputError(
            f"{option} has the yaw {text!r}; it must be a number of degrees or of radians; write e.g. 90deg or 1.57"
        ) from None
    if not unit and math.isfinite(value) and abs(value) > 2.0 * math.pi:
        raise InputError(
            f"{option} has the yaw {text!r}; a yaw without a unit is in radians, and {value:g} rad is more than a "
            f"turn; write {number}deg for degrees, or {number}rad if you mean it"
        )
    return math.radians(value) if unit == "deg" else value


def check_configuration(space: CSpace, q: tuple[float, ...], option: str) -> None:
    """Check that a configuration has a yaw where the map has rotations, and none where it has none.

    Raises
    ------
    InputError
        If not.
    """
    text = ",".join(f"{value:g}" for value in q)
    if len(q) < space.dof:
        raise InputError(
            f"{option} is {text!r}, without a yaw; the map has rotations, and a configuration is x, y and yaw; write "
            f"e.g. {option}={text},90deg"
        )
    if len(q) > space.dof:
        raise InputError(
            f"{option} has a yaw, {q[2]:g} rad; the map has no rotations, and a configuration is x and y: two numbers; "
            f"write {option}={q[0]:g},{q[1]:g}, or build the map with --rotations"
        )


def check_turning(space: CSpace, option: str) -> None:
    """Check that a map has rotations, as an option needs them.

    Raises
    ------
    InputError
        If not.
    """
    if space.rotations is None:
        raise InputError(
            f"{option} is for robots that turn, and the map has no rotations; build it with cspace map --rotations 72, "
            "or leave the option out"
        )


def check_outputs(paths: Collection[Path], suffixes: Collection[str], overwrite: bool) -> None:
    """Check that files can be written, before work that would be lost.

    Parameters
    ----------
    paths : collection of pathlib.Path
        The outputs; those that are written beside them are checked with them.
    suffixes : collection of str
        The suffixes that are known, in lower case.
    overwrite : bool
        Whether existing outputs may be replaced.

    Raises
    ------
    InputError
        If a suffix is not known, or two outputs have the same name.
    FileError
        If a folder is missing or may not be written, or if an output exists and may not be replaced.
    """
    for path in paths:
        if path.suffix.lower() not in suffixes:
            known = ", ".join(suffix for suffix in suffixes if suffix)
            raise InputError(f"{path} ends in {path.suffix!r}; the suffix says what to write; use one of {known}")
        image = [path.with_suffix(".pgm")] if path.suffix.lower() in (".yaml", ".yml") else []
        for target in (path, *image):
            _check_target(target, overwrite)
    if len({path.resolve() for path in paths}) < len(paths):
        raise InputError(f"{', '.join(map(str, paths))} name one file twice; outputs differ; choose another name")


def check_folder(folder: Path) -> None:
    """Check that a folder is there or can be made, and can be written.

    Raises
    ------
    FileError
        If not.
    """
    there = folder
    while not there.exists() and there != there.parent:
        there = there.parent
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        raise FileError(
            f"{folder} cannot be written: {there.resolve()} is not a folder that may be written; outputs need one; "
            "choose another"
        )


def _check_target(target: Path, overwrite: bool) -> None:
    if not target.parent.is_dir():
        raise FileError(f"{target.parent} is not a folder; outputs go into an existing one; create it first")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise FileError(f"{target.parent} may not be written; outputs need a writable folder; choose another")
    if target.exists() and not overwrite:
        raise FileError(f"{target} exists; existing outputs are kept; pass --overwrite or choose another name")


def given(**options: Any) -> dict[str, Any]:
    """The options that the user gave: those that are not None."""
    return {name: value for name, value in options.items() if value is not None}
