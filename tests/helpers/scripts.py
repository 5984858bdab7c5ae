"""Scripts that run in processes and folders of their own."""

import os
import subprocess
import sys

from tests.helpers.repository import ROOT


def start_script(folder, code, **environment):
    """Start a script in a folder, with a cache folder of its own."""
    others = {
        name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "XDG_"))
    }
    paths = os.pathsep.join([str(folder), str(ROOT)])
    env = others | {"PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(folder / "cache")} | environment
    command = [sys.executable, "-c", code]
    return subprocess.Popen(command, cwd=folder, env=env, stdout=-1, stderr=-1, text=True)


def run_script(folder, code, **environment):
    """Run a script in a folder; return what it prints."""
    process = start_script(folder, code, **environment)
    out, err = process.communicate()
    assert process.returncode == 0, err
    return out.strip(), err.strip()
