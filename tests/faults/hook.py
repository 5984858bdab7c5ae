"""Imports of modules with faults asleep, in tests and in processes that they start."""

from __future__ import annotations

import builtins
import importlib.machinery
import json
import os
from pathlib import Path
from types import CodeType

from tests.faults.sites import WAKE, build_faults

PLAN = "CSPACE_FAULTS"
"""Environment variable that names a file: the faults' numbers by file and index of the site."""

AWAKE = "CSPACE_FAULT_AWAKE"
"""Environment variable with the number of the fault that is awake."""

REACHED = "CSPACE_FAULTS_REACHED"
"""Environment variable that names a file to which processes add the faults that they reach."""


_awake = os.environ.get(AWAKE)
_reached: set[int] = set()


def wake(number: int) -> None:
    """Wake a fault, here and in processes that start later."""
    global _awake
    os.environ[AWAKE] = _awake = str(number)


def take_reached() -> list[int]:
    """Return the faults reached since the last call, in child processes, too."""
    file = Path(os.environ[REACHED])
    found = set(map(int, file.read_text(encoding="utf-8").split())) if file.exists() else set()
    file.unlink(missing_ok=True)
    _reached.clear()
    return sorted(found)


def _is_awake(number: int) -> bool:
    """Note that a fault is reached; return True if it is awake."""
    if number not in _reached:
        _reached.add(number)
        with Path(os.environ[REACHED]).open("a", encoding="utf-8") as file:
            file.write(f"{number}\n")
    return str(number) == _awake


def install() -> None:
    """Build the planned faults into modules as Python loads them."""
    plan = json.loads(Path(os.environ[PLAN]).read_text(encoding="utf-8"))
    numbers = {path: {int(k): n for k, n in each.items()} for path, each in plan.items()}
    load = importlib.machinery.SourceFileLoader.get_code

    def get_code(self: importlib.machinery.SourceFileLoader, name: str) -> CodeType | None:
        """Compile a module with its faults."""
        path = self.get_filename(name)
        if path not in numbers:
            return load(self, name)
        source = Path(path).read_text(encoding="utf-8")
        return compile(build_faults(source, numbers[path])[0], path, "exec", dont_inherit=True)

    setattr(builtins, WAKE, _is_awake)
    importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign]


install()
