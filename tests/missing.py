"""Output of code if a package is not installed."""

import subprocess
import sys

HIDE = """
import sys

class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == {package!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Without())
import numpy as np
import cspace
"""


def output_without(package: str, code: str) -> str:
    """Return the output of code that cannot import a package."""
    run = [sys.executable, "-c", HIDE.format(package=package) + code]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
