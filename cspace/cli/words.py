"""What the library says, in the words of the command line."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from cspace.errors import CspaceError

_NAMES: Final = (
    "bounds",
    "curve",
    "exact",
    "margin",
    "method",
    "objective",
    "outside",
    "overwrite",
    "planner",
    "radius",
    "robot_solid",
    "rotations",
    "seed",
    "solid",
    "spacing",
    "time_limit",
    "turning_radius",
    "unknown",
    "yaw",
)
"""Parameters of the library that are options here."""

_VALUE: Final = r"'[^']*'|\([^()]*\)|True|-?\d+(?:\.\d+)?(?:e-?\d+)?"
_ARGUMENT: Final = re.compile(rf"(?<![\w/\\.-])({'|'.join(_NAMES)})=({_VALUE})(?![\w/\\]|[.+-]\w)")
"""An argument, and no part of a file's name."""

_CALLS: Final = {
    "Workspace.from_points": "a file of points (.xyz, .pcd, .npy)",
    "Workspace.from_array": "a file of cells (.npy)",
    "cspace.build": "cspace map",
}
"""Names of the library, and what they are here."""


def in_options(text: str) -> str:
    """A message of the library with its arguments as options: ``spacing=0.05`` as ``--spacing 0.05``."""
    for name, words in _CALLS.items():
        text = text.replace(name, words)
    return _ARGUMENT.sub(_option, text)


def _option(found: re.Match[str]) -> str:
    name, value = f"--{found[1].replace('_', '-')}", found[2].strip("'")
    if value == "True":
        return name
    return f"{name}={value[1:-1].replace(' ', '')}" if value.startswith("(") else f"{name} {value}"


@contextmanager
def about_robot() -> Iterator[None]:
    """Within the block, what is said of ``solid`` is meant for ``--robot-solid``."""

    def turned(message: object) -> str:
        return re.sub(r"\bsolid=", "robot_solid=", str(message))

    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always", UserWarning)
        try:
            yield
        except CspaceError as error:
            raise type(error)(turned(error)) from error
    for warning in heard:
        warnings.warn(turned(warning.message), warning.category, stacklevel=3)
