"""The command line, run in this process."""

from __future__ import annotations

import json
from functools import cache, partial
from typing import Any

import typer.main
from typer.testing import CliRunner

from cspace.cli import app

# Typer's own runner would make all commands anew at each call, which takes longer than many of them.
command = cache(partial(typer.main.get_command, app))


def run(*arguments: object) -> Any:
    """What the command line answers."""
    return super(CliRunner, CliRunner()).invoke(command(), [str(argument) for argument in arguments])


def document(*arguments: object, warning: str = "") -> dict[str, Any]:
    """The JSON document of a command that succeeds, with one warning or none; it is all that it prints."""
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.stderr or result.exception
    assert result.stderr.count("\n") == bool(warning), result.stderr
    assert result.stderr.startswith("cspace: warning: " if warning else "")
    assert warning in result.stderr
    printed: dict[str, Any] = json.loads(result.stdout)
    return printed
