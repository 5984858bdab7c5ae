"""Run the core's tests on the core alone: ``python -m tests.core [options of pytest]``.

A copy of the core, without its wings and without planners, is tested in a temporary folder. Tests
that need one of these are skipped.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.helpers.repository import ROOT
from tests.lint.test_wings import WINGS

FOLDERS = (
    *("bodies", "engines", "exact", "files", "gates", "laws", "queries", "raster", "record"),
    *("rotations", "shapes", "support"),
)
"""Folders of the core's tests."""

FILES = (
    *("test_builder.py", "test_convergence.py", "test_grid.py", "test_obstacles.py"),
    *("test_proofs.py", "test_replaced.py", "test_robot.py", "test_space.py"),
    *("test_unit_warning.py", "test_workspace.py"),
)
"""Files of the core's tests beside the folders."""

SHARED = ("tests/conftest.py", "tests/fuzz", "tests/helpers", "docs/reference/format.md")
"""What these tests use."""

NO_PLANNERS = 'raise ModuleNotFoundError("No module named \'planners\'", name="planners")\n'
"""Content of a package that hides an installed one."""


def copy_core(folder: Path) -> None:
    """Copy the core and its tests into an empty folder."""

    def is_left_out(parent: str, names: list[str]) -> list[str]:
        """Return the names of wings and of compiled modules."""
        is_root = Path(parent) == ROOT / "cspace"
        return [name for name in names if name == "__pycache__" or (is_root and name in WINGS)]

    for name in ("cspace", *SHARED, *(f"tests/{each}" for each in (*FOLDERS, *FILES))):
        source, place = ROOT / name, folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, place, ignore=is_left_out)
        else:
            shutil.copy(source, place)
    shutil.copy(ROOT / "pyproject.toml", folder)
    (folder / "planners").mkdir()
    (folder / "planners/__init__.py").write_text(NO_PLANNERS)


def main() -> int:
    """Run the tests; return pytest's exit code."""
    with tempfile.TemporaryDirectory() as name:
        copy_core(Path(name))
        command = [sys.executable, "-m", "pytest", "-p", "tests.helpers.alone", "-q"]
        environment = os.environ | {"PYTHONPATH": name}
        command += ["--ignore=tests/fuzz", *sys.argv[1:], "tests"]
        return subprocess.run(command, cwd=name, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main())
