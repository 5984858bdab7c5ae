"""Runs of the command line in this process."""

import json
import shlex
from functools import cache

from typer import testing
from typer.main import get_command

testing._get_command = cache(get_command)  # otherwise each run builds all commands again


def commands():
    """Return the commands of the command line by their names."""
    from cspace._cli import app

    return testing._get_command(app).commands


def run(command, *arguments):
    """Run a command, as typed, with more arguments in this process."""
    from cspace._cli import app

    words = [*shlex.split(command), *map(str, arguments)]
    return testing.CliRunner().invoke(app, words)


def flatten(text):
    """Return a text in one line, because the layout of help depends on typer."""
    return " ".join(text.split())


def document(command, *arguments, warning=""):
    """Return the JSON that a successful command prints.

    The command must print nothing else, except for a ``warning``.
    """
    result = run(command, *arguments, "--json")
    assert result.exit_code == 0, result.stderr or result.exception
    assert result.stderr.count("\n") == bool(warning), result.stderr
    assert result.stderr.startswith("cspace: warning: " if warning else "")
    assert warning in result.stderr
    return json.loads(result.stdout)
