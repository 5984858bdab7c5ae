"""What the configurations of a map are made of, and the options that say one."""

from __future__ import annotations

import json
from enum import Enum
from pathlib import Path
from typing import Any

from cspace.cli.options import angle
from cspace.errors import InputError


class Form(Enum):
    """The numbers of a configuration, in order."""

    PLANE = ("x", "y")
    TURNING = ("x", "y", "yaw")
    SPACE = ("x", "y", "z")

    @classmethod
    def of(cls, dim: int, turns: bool) -> Form:
        """Form of a map of so many dimensions, whose robot turns or not."""
        if dim == 3:
            return cls.SPACE
        return cls.TURNING if turns else cls.PLANE


def form_of(file: Path) -> Form:
    """Form of a saved map, told by its metadata alone: a map in space is large, and a wrong option is told at once.

    Raises
    ------
    FileError
        If the file is not a map that can be opened.
    """
    from cspace.io.reading import open_map

    try:
        metadata = _metadata(file)
        return Form.of(len(metadata["shape"]), bool(metadata["rotations"]))
    except Exception:  # Whatever is wrong with the map, those who open it tell of it better.
        space = open_map(file)
        return Form.of(space.grid.dim, space.rotations is not None)


def configuration(text: str, option: str, form: Form) -> tuple[float, ...]:
    """The configuration that an option such as ``--start`` gives, in metres and radians.

    Raises
    ------
    InputError
        If the text is not as many numbers as the map's configurations have, with commas between them; the message says
        what is expected.
    """
    words = [word.strip() for word in text.split(",")]
    numbers = {2: "two", 3: "three"}[len(form.value)]
    names = " and ".join((", ".join(form.value[:-1]), form.value[-1]))
    kind = _KINDS[form]
    try:
        if len(words) not in (2, 3):
            raise ValueError
        x, y = map(float, words[:2])
        if form is Form.SPACE and len(words) == 3:
            return (x, y, float(words[2]))
    except ValueError:
        unit = "two numbers in metres and a yaw" if form is Form.TURNING else f"{numbers} numbers in metres"
        raise InputError(
            f"{option} is {text!r}; the map is {kind}, and a configuration is {names}: {unit}, with commas between "
            f"them; write e.g. {option}={_EXAMPLES[form]}"
        ) from None
    if form is Form.PLANE and len(words) == 3:
        raise InputError(
            f"{option} is {text!r}, with a third number (a yaw, {_yaw(words[2])}, or z); the map is {kind}, it has no "
            f"rotations, and a configuration is x and y: two numbers; write {option}={words[0]},{words[1]}, or build "
            "the map with --rotations, or from a workspace in space"
        )
    if form is not Form.PLANE and len(words) == 2:
        last = "a yaw" if form is Form.TURNING else "z"
        more = "90deg" if form is Form.TURNING else "0.5"
        raise InputError(
            f"{option} is {text!r}, without {last}; the map is {kind}, and a configuration is {names}; write e.g. "
            f"{option}={text},{more}"
        )
    return (x, y) if form is Form.PLANE else (x, y, angle(words[2], option))


def check_turning(form: Form, option: str) -> None:
    """Check that a map has rotations, as an option needs them.

    Raises
    ------
    InputError
        If not.
    """
    if form is Form.SPACE:
        raise InputError(
            f"{option} is for robots that turn in the plane, and the map is {_KINDS[form]}; leave the option out"
        )
    if form is Form.PLANE:
        raise InputError(
            f"{option} is for robots that turn, and the map has no rotations; build it with cspace map --rotations 72, "
            "or leave the option out"
        )


def check_space(form: Form, option: str) -> None:
    """Check that a map is of space, as an option needs it.

    Raises
    ------
    InputError
        If not.
    """
    if form is not Form.SPACE:
        raise InputError(f"{option} is for maps of space, and the map is {_KINDS[form]}; leave the option out")


def check_plane(form: Form, option: str) -> None:
    """Check that a map is of the plane, as an option needs it.

    Raises
    ------
    InputError
        If not.
    """
    if form is Form.SPACE:
        raise InputError(f"{option} is for maps of the plane, and the map is {_KINDS[form]}; leave the option out")


_KINDS = {
    Form.PLANE: "of the plane, for a robot that does not turn",
    Form.TURNING: "of the plane, with rotations",
    Form.SPACE: "of space, where robots do not turn",
}

_EXAMPLES = {Form.PLANE: "-1.5,2", Form.TURNING: "-1.5,2,90deg", Form.SPACE: "-1.5,2,0.5"}


def _yaw(word: str) -> str:
    """A word that may be a yaw, with its unit."""
    try:
        return f"{float(word):g} rad"
    except ValueError:
        return word


def _metadata(file: Path) -> Any:
    """The metadata of a saved map, unchecked."""
    if file.is_dir():
        return json.loads((file / "zarr.json").read_text(encoding="utf-8"))["attributes"]
    import numpy as np

    # Opened here: np.load would leave a damaged file open.
    with file.open("rb") as stream, np.load(stream, allow_pickle=False) as members:
        return json.loads(str(members["metadata"][()]))
