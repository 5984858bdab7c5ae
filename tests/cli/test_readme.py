"""The README's command-line block runs word for word in an empty folder."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

import cspace
from commands import run

ROOT = Path(cspace.__file__).parents[1]


def block() -> list[str]:
    """The commands of the README's section on the command line."""
    section = (ROOT / "README.md").read_text(encoding="utf-8").split("## Command line", 1)[1]
    lines = section.split("```console\n", 1)[1].split("```", 1)[0].splitlines()
    return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]


def test_the_block_runs_in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    commands, told = block(), ""
    assert len(commands) > 10
    for command in " && ".join(commands).split(" && "):
        program, *arguments = shlex.split(command)
        if program == "cd":
            monkeypatch.chdir(*arguments)
            continue
        assert program == "cspace"
        result = run(*arguments)
        assert result.exit_code == 0, f"{command}: {result.stderr or result.exception}"
        told += result.stdout
    written = {name for line in commands for name in line.split() if name.endswith((".csv", ".png", ".gif", ".vti"))}
    made = {file.name for file in (tmp_path / "cspace-demo").iterdir()}
    assert written | {"cart.zarr", "house.zarr", "cart.pgm"} <= made
    assert "certified" in told
