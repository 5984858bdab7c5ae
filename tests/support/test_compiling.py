"""Compiled functions: the cache, its privacy, the line about a long wait, and the clock."""

import gc
import os
import pickle
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from numba.core import event

import cspace
from cspace._support.compiling import clock, internal, is_private, kernel
from tests.helpers.missing import output_without

ROOT = Path(cspace.__file__).parents[1]

PROBE = """
from cspace._support.compiling import kernel

@kernel
def helper(value):
    return value + 2.0

@kernel
def answer(value):
    return helper(value) + 1.0
"""

RUN_PROBE = """
import cspace, cspace._support.compiling, os
cspace.__path__.append(os.getcwd())
cspace._support.compiling.LONG_WAIT_SECONDS = 0.0
{before}
from cspace.probe import answer
print(answer(1.0), sum(answer.stats.cache_hits.values()))
"""
"""Script that prints the result of a compiled function of the package, and its hits of the cache.
"""


def start(folder, code, **environment):
    """Start a script in a folder, with a cache folder of its own."""
    others = {
        name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "XDG_"))
    }
    paths = os.pathsep.join([str(folder), str(ROOT)])
    env = others | {"PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(folder / "cache")} | environment
    command = [sys.executable, "-c", code]
    return subprocess.Popen(command, cwd=folder, env=env, stdout=-1, stderr=-1, text=True)


def run(folder, code, **environment):
    """Run a script in a folder; return what it prints."""
    process = start(folder, code, **environment)
    out, err = process.communicate()
    assert process.returncode == 0, err
    return out.strip(), err.strip()


@pytest.fixture
def probe(tmp_path):
    """Return a function that runs the probe; it returns what the probe prints."""
    (tmp_path / "probe.py").write_text(PROBE)

    def run_probe(before="", **environment):
        return run(tmp_path, RUN_PROBE.format(before=before), **environment)

    return run_probe


# ---- the cache, and the line about a long wait ---------------------------------------------------


@pytest.mark.thorough
def test_a_long_wait_is_told_once_unless_silenced(probe, tmp_path):
    silence = "import logging; logging.getLogger('cspace.compiling').disabled = True"
    silent = str(tmp_path / "silent")
    assert probe(silence, NUMBA_CACHE_DIR=silent) == ("4.0 0", "")
    cold, warm = probe(), probe()
    assert cold[0] == "4.0 0" and warm == ("4.0 1", "")
    (line,) = cold[1].splitlines()
    assert line.startswith("cspace: ") and silence.split("; ")[1] in line


@pytest.mark.thorough
def test_processes_that_start_together_compile_once(tmp_path):
    (tmp_path / "probe.py").write_text(PROBE)
    code = RUN_PROBE.format(before="")
    together = [start(tmp_path, code) for _ in range(4)]
    answers = [process.communicate()[0].strip() for process in together]
    assert sorted(answers) == ["4.0 0", *["4.0 1"] * 3]


@pytest.mark.thorough
def test_a_change_of_kernels_or_their_constants_changes_the_folder(tmp_path):
    def folder():
        return run(
            tmp_path,
            "import cspace._support.compiling as c; print(c.cache_folder())",
            PYTHONPATH=str(tmp_path),
        )[0]

    for package in ("cspace", "planners"):
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    seen = [folder(), folder()]
    assert seen[0] == seen[1] and seen[0].startswith(str(tmp_path / "cache" / "cspace"))
    for file, is_compiled in (
        ("cspace/_grid.py", True),
        ("cspace/_support/vectors.py", True),
        ("cspace/errors.py", False),
    ):
        with (tmp_path / file).open("a") as opened:
            opened.write("\nMORE = 1\n")
        seen.append(folder())
        assert (seen[-1] != seen[-2]) is is_compiled, file


# ---- calls by address ----------------------------------------------------------------------------

CALLS = """
import math
from typing import NamedTuple
import numpy as np
from cspace._support.compiling import call, find_address, internal, kernel

class Body(NamedTuple):
    corners: object
    inner: tuple

@kernel
def weigh(body, factors):
    if factors[0] < 0.0:
        raise ValueError("negative")
    return body.corners[1, 0] * factors[0] + body.inner[0]

@internal
def weigh_rows(weigh, body, rows, out):
    for k in range(len(rows)):
        out[k] = call(weigh, (body, rows[k]))

@kernel
def weigh_all(weigh, body, rows, out):
    weigh_rows(weigh, body, rows, out)

def make_arguments(order="C"):
    body = Body(np.array([[1.0, 2.0], [3.0, 4.0]]), (0.5, 7))
    rows = np.asarray(np.arange(8.0).reshape(4, 2), order=order)
    return find_address(weigh, body, np.zeros(2)), body, rows, np.empty(4)
"""

RUN_CALLS = """
import cspace, os, threading
cspace.__path__.append(os.getcwd())
{before}
from numba.core import event
from numba.core.errors import TypingError
with event.install_recorder("numba:compile") as recorder:
    from cspace.calls import make_arguments, weigh, weigh_all
    arguments = make_arguments()
    threads = [threading.Thread(target=weigh_all, args=arguments) for _ in range(4)]
    [each.start() for each in threads]
    [each.join() for each in threads]
    weigh_all(*arguments)
_, body, rows, out = arguments
assert out.tolist() == [weigh.py_func(body, row) for row in rows] == [0.5, 6.5, 12.5, 18.5]
print(sum(each.is_start for _, each in recorder.buffer), end=" ")
rows[2] = -1.0
for wrong in (arguments, make_arguments("F")):
    try:
        weigh_all(*wrong)
    except (ValueError, TypingError) as error:
        print(type(error).__name__, end=" ")
"""


@pytest.mark.thorough
def test_calls_by_address_stay_valid_in_other_processes(tmp_path):
    (tmp_path / "calls.py").write_text(CALLS)
    code = RUN_CALLS.format(before="")
    without_cache = RUN_CALLS.format(before="del os.geteuid")
    answers = [run(tmp_path, each)[0] for each in (code, code, without_cache, without_cache)]
    # A kernel is compiled once; arrays of another order are refused.
    assert answers == [f"{n} ValueError TypingError" for n in (3, 0, 3, 3)]


def test_only_kernels_become_machine_code_and_no_garbage_is_collected_meanwhile():
    @internal
    def add_one(x):
        return x + 1.0

    @kernel
    def add_two(x):
        return add_one(add_one(x))

    class Listener(event.Listener):
        def on_start(self, event):
            is_collecting.append(gc.isenabled())

        def on_end(self, event):
            pass

    is_collecting = []
    with event.install_listener("numba:compile", Listener()):
        assert add_two(1.0) == 3.0
    assert is_collecting == [False, False]
    assert gc.isenabled()
    for function, has_code in ((add_two, True), (add_one, False)):
        (compiled,) = function.overloads.values()
        name = compiled.fndesc.llvm_func_name
        assert bool(compiled.library.get_pointer_to_function(name)) == has_code


# ---- privacy -------------------------------------------------------------------------------------


class Harm:
    """Payload that creates a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@pytest.mark.thorough
def test_cache_folders_that_others_may_write_are_not_read(probe, tmp_path):
    cache, harm = tmp_path / "cache", tmp_path / "harm"
    elsewhere = {"XDG_CACHE_HOME": str(tmp_path / "elsewhere")}
    assert probe(**elsewhere)[0] == "4.0 0"
    assert probe(**elsewhere)[0] == "4.0 1"
    for index in cache.rglob("*.nbi"):
        index.write_bytes(pickle.dumps("version") + pickle.dumps(Harm(harm)))
    (folder,) = (cache / "cspace").iterdir()
    for hits, (path, mode) in enumerate([(folder, 0o1757), (folder, 0o770), (cache, 0o777)]):
        before = path.stat().st_mode
        path.chmod(mode)
        assert (
            probe(**elsewhere)[0] == f"4.0 {min(hits, 1)}"
        )  # in the other folder, which is used from then on
        assert not harm.exists()
        path.chmod(before)


@pytest.mark.thorough
def test_code_is_kept_in_the_checked_folder_alone(probe, tmp_path):
    assert probe(NUMBA_CACHE_LOCATOR_CLASSES="InTreeCacheLocator")[0] == "4.0 0"
    assert probe(NUMBA_CACHE_LOCATOR_CLASSES="ZipCacheLocator")[0] == "4.0 1"
    assert all(file.is_relative_to(tmp_path / "cache") for file in tmp_path.rglob("*.nbi"))


def test_a_folder_of_another_user_is_not_private(tmp_path, monkeypatch):
    inner = tmp_path / "inner"
    inner.mkdir(mode=0o700)
    assert is_private(inner)
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    assert not is_private(inner)


def test_code_is_not_kept_where_folders_have_no_owner():
    code = """
import os
del os.geteuid  # Windows has neither
import cspace._support.compiling
print(cspace._support.compiling.cache_folder(), cspace.build.__name__)
"""
    assert output_without("fcntl", code) == "None build\n"


# ---- the clock -----------------------------------------------------------------------------------


def double(value):
    return 2 * value


def test_the_clock_stops_while_a_function_is_compiled_or_refused(
    monkeypatch,
):
    from numba import TypingError

    monkeypatch.setattr(
        "cspace._support.compiling.cache_folder", lambda: None
    )  # nothing is compiled yet

    def good(x):
        return 2.0 * x + 1.0

    def bad(x):
        return x + "no number"  # type: ignore[operator]

    kernel(double)(1)  # numba imports all that it can compile
    for number, function in enumerate((double, good, bad)):
        made = kernel(function)
        began = clock(), time.perf_counter()
        with suppress(TypingError):
            made(number * 1.5)
        assert clock() - began[0] < 0.5 * (time.perf_counter() - began[1])
    assert clock() < clock()
