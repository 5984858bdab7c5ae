"""Refusals of the command line: exit code 2, one line with options, no files."""

import os

import pytest
from typer.testing import CliRunner

from tests.helpers.commands import run

MAP = "build floor.npy --robot disc:0.05 --spacing 0.1 -o new.zarr"
PLAN = "plan plane.zarr --start 0.35,0.65 --goal 2.15,0.95"


@pytest.mark.parametrize(
    "command",
    [f"{MAP} --rotations 0", f"{MAP} --bounds here", f"{MAP} -o plane.zarr", f"{PLAN} -o p.txt"],
)
def test_options_are_checked_before_any_work(room, monkeypatch, command):
    for function in ("open", "_workspace.Workspace.open"):
        monkeypatch.setattr(f"cspace.{function}", None)
    assert run(command).exit_code == 2


@pytest.mark.parametrize("command", [MAP, f"{PLAN} -o path.csv", "demo", "demo -o new/demo"])
def test_folders_without_permission_are_refused(room, monkeypatch, command):
    # os.access is patched, because the superuser may write everywhere.
    monkeypatch.setattr("os.access", lambda _, mode: not mode & os.W_OK)
    result = run(command)
    assert result.exit_code == 2
    assert "cannot be written" in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "error, code, message",
    [
        (KeyboardInterrupt(), 130, "cspace: interrupted\n"),
        (MemoryError("cannot allocate"), 2, "cspace: out of memory: cannot allocate"),
        (OSError("No space left on device"), 2, "cspace: No space left on device\n"),
    ],
)
def test_interruptions_and_system_errors_end_in_one_line(room, monkeypatch, error, code, message):
    def fail(_):
        raise error

    monkeypatch.setattr("cspace.open", fail)
    result = run("info plane.zarr")
    assert (result.exit_code, result.stdout) == (code, "")
    assert result.stderr.startswith(message) and result.stderr.count("\n") == 1


def test_an_unknown_option_names_a_similar_one(room):
    for option, similar in (("--resolution", "--spacing"), ("--rotation", "--rotations")):
        result = run(f"build floor.npy --robot disc:0.05 {option} 0.1")
        assert result.exit_code == 2 and f"did you mean '{similar}'?" in result.stderr
    assert "did you mean" not in run("info plane.zarr --unlike 1").stderr


def test_defects_stay_visible(room, monkeypatch):
    monkeypatch.setattr("cspace.open", lambda _: 1 / 0)
    assert isinstance(run("info plane.zarr").exception, ZeroDivisionError)


@pytest.mark.parametrize("charset", ["utf-8", "ascii", "cp1251"])
def test_a_command_prints_letters_that_the_terminal_lacks(room, charset):
    """Only UTF-8 of these has the sign of square metres."""
    from cspace._cli import app

    result = CliRunner(charset=charset).invoke(app, ["info", "plane.zarr"])
    assert result.exit_code == 0 and "free area" in result.stdout, result.exception
