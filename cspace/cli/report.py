"""What a command tells: a table for people or one JSON document for machines, and a progress bar while it works."""

from __future__ import annotations

import json
import logging
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import typer

_UNITS: Final = {"_m3": " m³", "_m2": " m²", "_m": " m", "_deg": "°", "_bytes": " bytes"}
"""Units, by the end of a name."""

_MANY_BYTES: Final = 10**6
"""From here on people are told of MB and GB."""


class Clock:
    """Seconds that each named step took, in order."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[Callable[[int, int], None] | None]:
        """Time the block, and show on a terminal that it is under way; gives what :func:`progress_line` does."""
        began = time.perf_counter()
        with progress_line(name.replace("_", " ")) as progress:
            yield progress
        self.seconds[name] = round(time.perf_counter() - began, 4)


@contextmanager
def progress_line(words: str) -> Iterator[Callable[[int, int], None] | None]:
    """A bar on the error stream, where that is a terminal: the callback to pass to the library, else None.

    It says so where functions are being compiled.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    from cspace.compiling import LOGGER

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(words, total=None)

        class Listener(logging.Handler):
            def emit(self, record: logging.LogRecord) -> None:
                bar.update(task, description=f"{words} (compiling, once per machine)")

        def advance(done: int, total: int) -> None:
            bar.update(task, description=words, completed=done, total=total)

        level, listener = LOGGER.level, Listener()
        LOGGER.addHandler(listener)
        LOGGER.setLevel(logging.INFO)
        try:
            yield advance
        finally:
            LOGGER.setLevel(level)
            LOGGER.removeHandler(listener)


def show(document: dict[str, Any], as_json: bool) -> None:
    """Print a document on the standard output.

    Parameters
    ----------
    document : dict
        Names to values, nested at will; the end of a name tells the unit, as ``_m`` does metres. Lists of lists are for
        machines only.
    as_json : bool
        One JSON document, where what is not finite is null, in place of a table.
    """
    if as_json:
        typer.echo(json.dumps(_finite(document), indent=2, allow_nan=False))
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in _rows(document):
        table.add_row(name if value else Text(name, style="bold"), value)
    console = Console(highlight=False, markup=False, emoji=False)
    if console.is_terminal:
        console.print(table)
        return
    # Nothing is folded or padded where the text goes to a file or another program.
    console.width = 100_000
    with console.capture() as captured:
        console.print(table)
    typer.echo("\n".join(line.rstrip() for line in captured.get().splitlines()))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _rows(document: dict[str, Any], indent: str = "") -> Iterator[tuple[str, str]]:
    """Names and values; a nested document becomes a heading, whose value is empty, and what it holds."""
    for name, value in document.items():
        end, unit = next(((end, unit) for end, unit in _UNITS.items() if name.endswith(end)), ("", ""))
        label = name.removesuffix(end).replace("_", " ")
        if isinstance(value, dict):
            yield indent + label, ""
            yield from _rows(value, indent + "  ")
        elif not (isinstance(value, list) and value and isinstance(value[0], list)):
            yield indent + label, _text(value, unit)


def _text(value: Any, unit: str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "undecided"
    if isinstance(value, list):
        return f"({', '.join(_text(item, '') for item in value)}){unit}"
    if isinstance(value, int):
        if unit == _UNITS["_bytes"] and value >= _MANY_BYTES:
            from cspace.memory import in_words

            return in_words(value)
        return f"{value:,}{unit}"
    return f"{value:.6g}{unit}" if isinstance(value, float) else f"{value}{unit}"
