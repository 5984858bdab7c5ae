"""The checks of outputs that come before any work."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path

from cspace.errors import FileError, InputError


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
