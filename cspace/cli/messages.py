"""What the library says, in the words of the command line: made of an error's fields, never of its text."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from cspace.errors import CspaceError

Options = Mapping[str, str]
"""Options of a command, by the name of the argument of the library that they set: ``{"spacing": "--spacing"}``."""


def options_of(command: Any) -> Options:
    """Options of a command; their parameters have the names of the library's arguments."""
    parameters = command.params if command else []
    names = {str(each.name): [name for name in each.opts if name.startswith("--")] for each in parameters}
    return {name: options[0] for name, options in names.items() if options}


def worded(error: CspaceError, options: Options) -> str:
    """An error in one line, with its argument, and one that its mend names, as options of the command."""
    if error.found is None:
        return _line(str(error))
    found = f"{options.get(error.argument, error.argument)}{error.gap}{error.found}"
    return _line("; ".join(part for part in (found, error.rule, in_options(error.mend, options)) if part))


def in_options(text: str, options: Options) -> str:
    """A text with arguments as options: ``spacing=0.05`` as ``--spacing 0.05``, ``exact=True`` as ``--exact``."""
    return " ".join(_option(word, options) for word in text.split(" "))


@contextmanager
def about_robot() -> Iterator[None]:
    """Within the block, what is said of ``solid`` is meant for the robot: ``robot_solid``."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always", UserWarning)
        try:
            yield
        except CspaceError as error:
            if error.found is None:
                raise
            name = "robot_solid" if error.argument == "solid" else error.argument
            mend = error.mend.replace("solid=", "robot_solid=")
            raise type(error)(name, error.found, error.rule, mend, value=error.value) from error
    for warning in heard:
        warnings.warn(str(warning.message).replace("solid=", "robot_solid="), warning.category, stacklevel=3)


def _option(word: str, options: Options) -> str:
    """A word that sets an argument, as an option; any other word as it is."""
    name, equals, value = word.partition("=")
    bracket = name[: len(name) - len(name.lstrip("("))]
    name = name.removeprefix(bracket)
    if not equals or name not in options:
        return word
    value = value.replace('"', "").replace("'", "")
    plain = value.rstrip(",;.)")
    return bracket + (options[name] + value[len(plain) :] if plain == "True" else f"{options[name]} {value}")


def _line(text: str) -> str:
    return " ".join(text.split())
