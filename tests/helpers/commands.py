"""Runs of the command line in this process."""

import json
import shlex
from functools import cache
from typing import Any

from typer import testing
from typer.main import get_command

from cspace.cli import app

testing._get_command = cache(get_command)  # otherwise each run builds all commands again
COMMANDS: dict[str, Any] = testing._get_command(app).commands
"""Commands of the command line by their names."""


def run(command: str, *arguments: object) -> Any:
    """Run a command, as typed, with more arguments in this process."""
    words = [*shlex.split(command), *map(str, arguments)]
    return testing.CliRunner().invoke(app, words)


def flatten(text: str) -> str:
    """Return a text in one line, because the layout of help depends on typer."""
    return " ".join(text.split())


def document(command: str, *arguments: object, warning: str = "") -> dict[str, Any]:
    """Return the JSON that a successful command prints.

    The command must print nothing else, except for a ``warning``.
    """
    result = run(command, *arguments, "--json")
    assert result.exit_code == 0, result.stderr or result.exception
    assert result.stderr.count("\n") == bool(warning), result.stderr
    assert result.stderr.startswith("cspace: warning: " if warning else "")
    assert warning in result.stderr
    printed: dict[str, Any] = json.loads(result.stdout)
    return printed
