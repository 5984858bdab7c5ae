"""Compiled functions: what is kept on disk is used only as long as all that it was made from is as it was."""

import subprocess
import sys

CALLEE = """
from cspace.compiling import jit

@jit
def helper(value: float) -> float:
    return value + {added}
"""

CALLER = """
from cspace.compiling import jit
from cspace.probe_callee import helper

@jit
def answer(value: float) -> float:
    return later(value)

@jit
def later(value: float) -> float:
    return helper(value)
"""

RUN = """
import importlib.util, sys
for name in ("callee", "caller"):
    spec = importlib.util.spec_from_file_location(f"cspace.probe_{name}", f"{folder}/{name}.py")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
print(module.answer(1.0), sum(module.answer.stats.cache_hits.values()))
"""


def test_a_function_is_compiled_anew_when_one_that_it_calls_has_changed(tmp_path):
    """Also where it calls it by another one, which stands below it."""

    def run(added=None):
        if added is not None:
            (tmp_path / "callee.py").write_text(CALLEE.format(added=added))
        code = f"folder = {str(tmp_path)!r}\n{RUN}"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        result, hits = done.stdout.split()
        return float(result), int(hits)

    (tmp_path / "caller.py").write_text(CALLER)
    assert run("2.0") == (3.0, 0)
    assert run("4.0") == (5.0, 0)
    assert run() == (5.0, 1)
