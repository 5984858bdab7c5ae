"""Output of commands: a table or a JSON document, a progress bar, and errors that name options.

Error messages are composed of the fields of errors, never of their text.
"""

from __future__ import annotations

import json
import math
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

import typer

from cspace.errors import CspaceError, FileError

_UNIT: Final = re.compile(r"_(m[23]?|rad[23]?|rad2?_m2?|rad_or_m|m_or_rad|deg|s|bytes)$")
"""Pattern of the unit at the end of a name such as ``length_m``."""

_UNIT_CHARACTERS: Final = str.maketrans("_23", " ²³")
"""Replacements of characters in units for tables."""

_LOWER_BOUND_LABELS: Final = ("obstacle distance", "clearance")
"""Labels of proven lower bounds; zero means only that nothing was proven."""


class Stopwatch:
    """Durations of named steps, seconds."""

    def __init__(self) -> None:
        """Create a stopwatch without steps."""
        self.seconds: dict[str, float] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[Callable[[int, int], None] | None]:
        """Time the block as a step; yield the callback of :func:`progress_line`."""
        began = time.perf_counter()
        with progress_line(name.replace("_", " ")) as progress:
            yield progress
        self.seconds[name] = round(time.perf_counter() - began, 4)


@contextmanager
def progress_line(label: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a progress bar meanwhile; yield its callback.

    The callback takes the numbers of finished and of all steps. Without a terminal, yield None.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def with_unit(name: str, unit: str) -> str:
    """Return the name of a value with its unit, e.g. ``length_rad_or_m``."""
    return f"{name}_{unit.replace(' ', '_')}"


def show(document: dict[str, Any], as_json: bool) -> None:
    """Print a document on standard output as a table or as JSON.

    The document maps names to values or to nested documents. The end of a name is its unit, e.g.
    ``_m`` for metres. JSON has null for numbers that are not finite. Tables omit lists of lists.
    """
    if as_json:
        typer.echo(json.dumps(_replace_infinite(document), indent=2, allow_nan=False))
        return
    rows = list(_list_rows(document))
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        typer.echo(f"{name:{width}}  {value}".rstrip())


class ByName(dict[str, Any]):
    """A part of a document whose names are from a file, e.g. joints.

    :func:`show` prints these names unchanged.
    """


def _replace_infinite(value: Any) -> Any:
    """Replace numbers that are not finite by None, in nested values too."""
    if isinstance(value, dict):
        return {name: _replace_infinite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_replace_infinite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _list_rows(document: dict[str, Any], indent: str = "") -> Iterator[tuple[str, str]]:
    """Yield the labels and values of the rows of a table.

    A nested document has a row without a value as its heading.
    """
    for name, value in document.items():
        # A name such as ``length_m`` becomes a label and, after the value, a unit.
        unit = _UNIT.search(name)
        label = name[: unit.start()] if unit else name
        if not isinstance(document, ByName):
            label = label.replace("_", " ")
        has_rows = isinstance(value, list) and value and isinstance(value[0], list)
        if isinstance(value, dict):
            yield indent + label, ""
            yield from _list_rows(value, indent + "  ")
        elif label in _LOWER_BOUND_LABELS and value == 0.0:
            yield indent + label, "not proven to be more than 0"
        elif not has_rows:
            unit_text = _format_unit(unit[1]) if unit else ""
            yield indent + label, _format_value(value) + unit_text


def _format_unit(unit: str) -> str:
    """Format the unit of a name for a table.

    The unit follows a number, e.g. " rad² m" for "rad2_m".
    """
    if unit == "deg":
        return "°"
    return " " + unit.translate(_UNIT_CHARACTERS)


def _format_value(value: Any) -> str:
    """Format a value for a table."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "undecided"
    if isinstance(value, list):
        return f"({', '.join(map(_format_value, value))})"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, int):
        return f"{value:,}"
    return str(value)


Options = Mapping[str, str]
"""Names of options by the library's argument that they set, e.g. ``{"spacing": "--spacing"}``."""


_PREFIX: Final = "cspace.prefix"
"""Key, in the ``meta`` of a context, of the prefix that :func:`using_prefix` sets."""


@contextmanager
def using_prefix(context: typer.Context, prefix: str) -> Iterator[None]:
    """Make error messages of the block name options with a prefix.

    With the prefix ``robot_``, an error about ``up`` names ``--robot-up``.
    """
    context.meta[_PREFIX] = prefix
    yield
    # After an error the prefix stays, because its message is composed outside the block.
    del context.meta[_PREFIX]


def list_option_names(command: Any, meta: Mapping[str, Any]) -> Options:
    """Return the names of a command's options by the library's arguments.

    ``meta`` is that of the command's context, in which :func:`using_prefix` sets a prefix.
    """
    prefix = meta.get(_PREFIX, "")
    names = {}
    for parameter in command.params if command else []:
        long_names = [name for name in parameter.opts if name.startswith("--")]
        if long_names:
            names[str(parameter.name)] = long_names[0]
    with_prefix = [name for name in names if name.startswith(prefix)]
    return names | {name.removeprefix(prefix): names[name] for name in with_prefix}


def format_error(error: CspaceError, options: Options) -> str:
    """Format an error as one line that names options instead of arguments."""
    if error.problem is None:
        return join_lines(str(error))
    name, bracket, index = error.argument.partition("[")  # e.g. goal[0]
    option = options.get(name, name)
    gap = ": " if isinstance(error, FileError) else " "
    subject = f"{option}{bracket}{index}{gap}{error.problem}"
    clauses = subject, error.rule, name_options(error.hint, options)
    return join_lines("; ".join(filter(None, clauses)))


def format_warning(message: str, options: Options) -> str:
    """Format a warning as one line that names options, not arguments."""
    problem, semicolon, advice = message.partition(";")
    return join_lines(f"{problem}{semicolon}{name_options(advice, options)}")


def name_options(hint: str, options: Options) -> str:
    """Replace arguments in a hint by options, e.g. ``spacing=0.05`` by ``--spacing=0.05``."""
    if not options:
        return hint

    def name_option(argument: re.Match[str]) -> str:
        """Return the option for a matched argument; ``=True`` becomes a flag."""
        option = options[argument["name"]]
        return option if argument["true"] else f"{option}="

    names = "|".join(options)
    hint = hint.replace("space.exact", options.get("exact", "space.exact"))
    return re.sub(rf"\b(?P<name>{names})=(?P<true>True\b)?", name_option, hint)


def join_lines(text: str) -> str:
    """Join the lines of a text into one, with single spaces."""
    return " ".join(text.split())
