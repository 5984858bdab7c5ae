"""The command line (experimental).

Heavy modules are imported only when a command runs, so that ``--help`` is fast.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Callable
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from cspace._cli.compile import compile_ahead
from cspace._cli.config import config
from cspace._cli.info import info
from cspace._cli.maps import export, make, picture, view
from cspace._cli.planning import demo, explain, plan
from cspace._cli.report import Options, format_error, format_warning, join_lines, list_option_names
from cspace._cli.route_audit import audit
from cspace._cli.spheres import spheres
from cspace.errors import CspaceError

_USAGE_ERRORS: tuple[Any, ...] = typer.BadParameter.__mro__[1:2]
"""The base class of typer's usage errors, taken from a subclass because its module depends on the
version of typer."""


class _Commands(TyperGroup):
    """A group of commands that prints each error and warning as one line."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Parse the arguments; ``--help`` and ``--version`` print already now."""
        if isinstance(sys.stdout, TextIOWrapper):
            sys.stdout.reconfigure(errors="replace")  # names may have letters it cannot encode
        try:
            return super().make_context(*arguments, **options)
        except BrokenPipeError:
            raise _end_for_reader() from None

    def invoke(self, ctx: Any) -> Any:
        """Run a command; exit with code 2, 130 or 141 on errors."""

        def list_options() -> Options:
            """Return the options of the running command."""
            return list_option_names(self.commands.get(ctx.invoked_subcommand or ""), ctx.meta)

        def print_warning(message: Warning | str, *_: Any, **__: Any) -> None:
            """Print a warning as one line, in place of ``warnings.showwarning``."""
            text = format_warning(str(message), list_options())
            typer.echo(f"cspace: warning: {text}", err=True)

        try:
            with warnings.catch_warnings():
                warnings.simplefilter("default", UserWarning)
                warnings.showwarning = print_warning
                return super().invoke(ctx)
        except BrokenPipeError:
            raise _end_for_reader() from None
        except CspaceError as error:
            problem = format_error(error, list_options())
        except _USAGE_ERRORS as error:  # e.g. an option without its value
            path = error.ctx.command_path if error.ctx else "cspace"
            from cspace.inside import suggest_name

            error.possibilities = None  # typer's own, which knows no words
            message = join_lines(error.format_message()).removesuffix(".")
            name = getattr(error, "option_name", "")
            known = list_option_names(error.ctx.command if error.ctx else None, {}).values()
            hint = suggest_name(name, known) if name.startswith("--") else ""
            problem = "; ".join(filter(None, (message, hint, f"see {path} --help")))
        except OSError as error:
            problem = join_lines(str(error))
        except MemoryError as error:
            problem = f"out of memory: {error}; a map must fit in memory"
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second one would end the message
            typer.echo("cspace: interrupted", err=True)
            raise typer.Exit(130) from None
        typer.echo(f"cspace: {problem}", err=True)
        raise typer.Exit(2)


def _end_for_reader() -> typer.Exit:
    """End a command whose output nobody reads any more, as before ``| head``."""
    sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115 - Python flushes it at its end
    # Exit code of shells for a program whose output nobody reads, 128 + SIGPIPE.
    return typer.Exit(141)


app = typer.Typer(
    cls=_Commands,
    help="Certified configuration-space maps: build them, look at them, plan on them, export them.",
    epilog="Exit codes: 0 done, 1 no path found, 2 bad input, 130 interrupted.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    """Print the version and exit, if ``--version`` is given."""
    if wanted:
        import cspace

        typer.echo(f"cspace {cspace.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False,
        "--version",
        callback=_print_version,
        is_eager=True,
        help="Print the version and stop.",
    ),
) -> None:
    pass


_COMMANDS: dict[str, Callable[..., None]] = {
    "demo": demo,
    "build": make,
    "plan": plan,
    "explain": explain,
    "audit": audit,
    "info": info,
    "plot": picture,
    "view": view,
    "export": export,
    "spheres": spheres,
    "compile": compile_ahead,
    "config": config,
}
for _name, _command in _COMMANDS.items():
    app.command(_name)(_command)


def main() -> None:
    """Run the command line and exit with its code."""
    try:
        app(prog_name="cspace")
    except KeyboardInterrupt:
        # Ctrl-C before or after a command is not handled by the group of commands.
        sys.exit(130)
