"""Output of code if a package is not installed."""

import os
import subprocess
import sys
import tempfile

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


def output_without(package, code):
    """Return the output of code that cannot import a package."""
    run = [sys.executable, "-c", HIDE.format(package=package) + code]
    # Code that other tests have compiled for their own classes could not be read without the
    # package.
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        done = subprocess.run(run, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
