"""The README's command-line block runs word for word in an empty folder."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import cspace

ROOT = Path(cspace.__file__).parents[1]


def block() -> list[str]:
    """The commands of the README's section on the command line."""
    section = (ROOT / "README.md").read_text(encoding="utf-8").split("## Command line", 1)[1]
    lines = section.split("```console\n", 1)[1].split("```", 1)[0].splitlines()
    return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]


def test_the_block_runs_in_an_empty_folder(tmp_path: Path) -> None:
    programs, room = tmp_path / "bin", tmp_path / "room"
    programs.mkdir()
    room.mkdir()
    command = programs / "cspace"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m cspace "$@"\n')
    command.chmod(0o755)
    environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    commands = block()
    assert len(commands) > 10
    script = "set -e\n" + "\n".join(f"echo '+ {line}' >&2\n{line}" for line in commands)
    process = subprocess.Popen(
        ["bash", "-c", script],
        cwd=room,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        told, errors = process.communicate(timeout=240)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 0, errors
    written = {name for line in commands for name in line.split() if name.endswith((".csv", ".png", ".gif", ".vti"))}
    made = {file.name for file in (room / "cspace-demo").iterdir()}
    assert written | {"cart.zarr", "house.zarr", "cart.pgm"} <= made
    assert "certified" in told
