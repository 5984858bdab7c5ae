"""Compiled functions: the cache, its privacy, the line about a long wait, and the clock."""

import errno
import gc
import hashlib
import importlib
import os
import pickle
import runpy
import signal
import subprocess
import sys
import time
import zlib
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from numba.core import event
from numba.core.registry import cpu_target

from cspace._support import shipped
from cspace._support.compiling import cache_folder, clock, internal, is_private, kernel
from tests.helpers.missing import output_without
from tests.helpers.scripts import run_script, start_script

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


@pytest.fixture
def probe(tmp_path):
    """Return a function that runs the probe; it returns what the probe prints."""
    (tmp_path / "probe.py").write_text(PROBE)

    def run_probe(before="", **environment):
        return run_script(tmp_path, RUN_PROBE.format(before=before), **environment)

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
    together = [start_script(tmp_path, code) for _ in range(4)]
    answers = [process.communicate()[0].strip() for process in together]
    assert sorted(answers) == ["4.0 0", *["4.0 1"] * 3]


USER = """
import {neighbour}
from cspace.inside import internal, kernel
from {neighbour} import FACTOR, PAIR, STEPS, Gear, Pose, constant, count, scale

@internal
def inner(x, gain=FACTOR):
    return gain * scale(x)

@kernel
def f(x):
    pose = Pose(x, 10.0 * x)
    sum = inner(x) + PAIR[0] + STEPS[1] + Gear.USED.value + pose.first + count(x)
    return sum + {neighbour}.MORE + constant(x)
"""

NEIGHBOUR = """
from enum import IntEnum
from typing import NamedTuple
import numpy as np
from cspace.inside import internal
from numba.core import types
from numba.extending import intrinsic
FACTOR = 2.0
PAIR = 3, 4
STEPS = np.array([1.0, 2.0])
MORE = 7
class Gear(IntEnum):
    LOW = 4
    HIGH = 5
    USED = HIGH
class Pose(NamedTuple):
    first: float
    second: float
@internal
def deepest(x):
    return 100.0 * x
@internal
def scale(x):
    return deepest(x)
def make(k):
    @internal
    def count(x):
        return x + k
    return count
count = make(1.0)
LEVEL = 8.0
@intrinsic
def constant(_, x):
    def generate(context, builder, *_):
        return context.get_constant(types.float64, LEVEL + 0.0)
    return types.float64(x), generate
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return an empty folder of compiled code for this process."""
    folder = tmp_path / "code"
    folder.mkdir()
    monkeypatch.setattr("cspace._support.compiling.cache_folder", lambda: folder)
    monkeypatch.setattr("cspace._support.compiling._open_lock_file", lambda: None)
    monkeypatch.setattr("cspace._support.compiling._warnings", set())
    return folder


@pytest.fixture
def call_user(folder, tmp_path, monkeypatch):
    """Return a function that imports modules of given texts, and calls `f` of the first.

    It returns the answer, and whether its code was kept before.
    """
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("sys.dont_write_bytecode", True)

    def call(texts):
        for name, text in texts.items():
            file = tmp_path.joinpath(*name.split(".")).with_suffix(".py")
            file.parent.mkdir(exist_ok=True)
            file.write_text(text)
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        f = importlib.import_module(next(iter(texts))).f
        return f(1.0), bool(f.stats.cache_hits)

    yield call
    for name in ("alone", "beside", "whole", "part", "one", "two", "profile"):
        for module in [each for each in sys.modules if each.partition(".")[0] == name]:
            del sys.modules[module]


@pytest.mark.parametrize(
    "name, neighbour", [("alone", "beside"), ("whole.main", "whole.part"), ("one.a", "two.b")]
)
def test_a_function_is_compiled_anew_if_a_file_that_it_imports_changes(call_user, name, neighbour):
    check_change(call_user, name, neighbour, ("100.0 * x", "101.0 * x", 2.0))


@pytest.mark.parametrize(
    "change",
    [
        ("FACTOR = 2.0", "FACTOR = 3.0", 100.0),
        ("PAIR = 3", "PAIR = 4", 1.0),
        ("[1.0, 2.0]", "[1.0, 3.0]", 1.0),
        ("MORE = 7", "MORE = 8", 1.0),
        ("HIGH = 5", "HIGH = 6", 1.0),
        ("USED = HIGH", "USED = LOW", -1.0),
        ("LEVEL = 8.0", "LEVEL = 9.0", 1.0),
        ("LEVEL + 0.0", "LEVEL + 1.0", 1.0),
        ("first: float\n    second: float", "second: float\n    first: float", 9.0),
        ("make(1.0)", "make(2.0)", 1.0),
    ],
)
def test_a_function_is_compiled_anew_if_a_value_that_it_takes_in_changes(call_user, change):
    check_change(call_user, "alone", "beside", change)


def test_a_module_that_hides_one_of_python_is_read(call_user):
    check_change(call_user, "alone", "profile", ("MORE = 7", "MORE = 8", 1.0))


def check_change(call_user, name, neighbour, change):
    """Check answers and kept code before and after a change of a neighbour's text."""
    old, new, more = change
    texts = {name: USER.format(neighbour=neighbour), neighbour: NEIGHBOUR}
    assert call_user(texts) == (228.0, False)
    edited = texts | {neighbour: NEIGHBOUR.replace(old, new)}
    assert call_user(edited) == (228.0 + more, False)
    assert call_user(texts) == (228.0, True)
    assert call_user(edited) == (228.0 + more, True)


def test_code_is_kept_under_the_text_that_was_imported(call_user, tmp_path):
    texts = {"alone": PROBE.replace("answer", "f")}
    edited = {"alone": texts["alone"].replace("2.0", "3.0")}
    (tmp_path / "alone.py").write_text(texts["alone"])
    imported = importlib.import_module("alone")
    (tmp_path / "alone.py").write_text(edited["alone"])
    assert imported.f(1.0) == 4.0
    assert call_user(edited) == (5.0, False)
    assert call_user(texts) == (4.0, True)


def test_code_is_not_kept_after_a_change_of_a_value_that_it_reads(call_user, folder, caplog):
    texts = {"alone": "GAIN = 2.0\n" + PROBE.replace("answer", "f").replace("2.0", "GAIN")}
    assert call_user(texts) == (4.0, False)
    kept = set(folder.iterdir())
    alone = sys.modules["alone"]
    alone.GAIN = 5.0
    assert alone.f(1) == 7.0  # an integer, for which it is compiled again
    alone.GAIN = 2.0
    assert alone.f(True) == 4.0
    assert set(folder.iterdir()) == kept
    (line,) = caplog.messages
    assert "helper reads a value that has changed" in line


@pytest.mark.parametrize("value", ["object()", "{1: 2}.get", "lambda x: x"])
def test_code_that_reads_something_unknown_is_not_kept(call_user, folder, caplog, value):
    text = f"GAIN = {value}\n" + PROBE.replace("answer", "f").replace(
        "2.0", "(2.0 if True else GAIN)"
    )
    assert call_user({"alone": text}) == (4.0, False)
    assert not list(folder.iterdir())
    assert "a function reads <" in caplog.text


CLOSURES = """
import sys
from cspace.inside import internal, kernel

def make(k):
    @internal
    def add(x):
        return x + k
    return add

one, two = map(make, map(float, {}))

@kernel
def both(x):
    return 100.0 * one(x) + two(x)

print(both(0.0))
"""


@pytest.mark.thorough
def test_closures_with_one_name_are_told_apart_in_code_of_several_processes(tmp_path):
    for numbers in ((1, 1), (1, 2), (3, 1)):
        (tmp_path / "closures.py").write_text(CLOSURES.format(numbers))
        answer, _ = run_script(tmp_path, "import closures")
        assert float(answer) == 100.0 * numbers[0] + numbers[1]


# ---- other processes, and full disks -------------------------------------------------------------

HOLD_TURN = """
import fcntl, os, sys
file = os.open(sys.argv[1], os.O_RDWR)
fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, int(sys.argv[2]))
print("locked", flush=True)
sys.stdin.read()
"""
"""Script that keeps a turn, a byte of a lock file, as a process that was stopped does."""


def double(value):
    return 2 * value


def triple(value):
    return 3 * value


def test_a_process_that_keeps_others_waiting_is_named_and_then_left(monkeypatch, caplog):
    now = [0.0]
    told = []

    def sleep(_):
        now[0] += 1.0
        told.append(len(caplog.messages))
        assert now[0] < 100.0

    fake = SimpleNamespace(monotonic=lambda: now[0], sleep=sleep, time=time.time)
    monkeypatch.setattr("cspace._support.compiling.time", fake)
    monkeypatch.setattr("cspace._support.compiling._warnings", set())
    place = str(zlib.crc32(f"{__name__}.double".encode()))
    command = [sys.executable, "-c", HOLD_TURN, str(cache_folder() / "lock"), place]
    assert kernel(double)(1) == 2  # which ends its turn
    with subprocess.Popen(command, stdin=-1, stdout=-1, text=True) as other:
        assert other.stdout.readline() == "locked\n"
        made = kernel(double)
        assert made(2.5) == 5.0
        assert told.index(1) == 6 and now == [61.0]  # it is named after 5 s, and left after 60
        assert made(3) == 6 and now == [61.0]  # without another wait
    (line,) = caplog.messages
    assert f"waiting for process {other.pid}, which compiles {__name__}.double;" in line


def test_only_code_that_nobody_has_used_for_a_week_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    own = cache_folder.__wrapped__()
    old = [own.with_name("numba-0.1.dev2+a-llvmlite-0.1-numpy-1.0-cpython-39")]
    others = ["robots", "numba-notes", own.name[:-4], f"{own.name}-0", f"{own.name}.mine"]
    kept = [own, own.with_name(f"{own.name}0"), *map(own.with_name, others)]
    for folder in old + kept:
        folder.mkdir(exist_ok=True)
        for name in ("lock", "work"):
            (folder / name).touch()
    for folder in old + kept[2:]:
        os.utime(folder / "lock", (0, 0))
    assert cache_folder.__wrapped__() == own
    assert all((folder / "work").exists() for folder in kept)
    assert not any(folder.exists() for folder in old)


def test_code_is_kept_in_memory_if_the_disk_is_full(monkeypatch, caplog):
    def fail(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("cspace._support.compiling._warnings", set())
    monkeypatch.setattr("pathlib.Path.replace", fail)
    values = [kernel(lambda x, k=k: x + k)(1.5) for k in range(2)]
    assert values == [1.5, 2.5]
    (line,) = caplog.messages
    assert "(No space left on device); it is compiled in each process" in line


@pytest.mark.parametrize("place", [0.0, 0.001, 0.01, 0.2, 0.5, 0.7, 0.9, 0.999])
@pytest.mark.parametrize("is_cut", [False, True])
def test_code_whose_file_is_damaged_is_compiled_anew(folder, caplog, place, is_cut):
    assert kernel(triple)(1.5) == 4.5
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    at = int(place * len(whole))
    rest = b"" if is_cut else bytes([whole[at] ^ 4]) + whole[at + 1 :]
    file.write_bytes(whole[:at] + rest)
    again = kernel(triple)
    assert again(1.5) == 4.5 and not again.stats.cache_hits
    again = kernel(triple)
    assert again(1.5) == 4.5 and again.stats.cache_hits
    assert not caplog.messages


def test_code_of_another_function_is_not_taken(folder):
    assert kernel(double)(1.5) == 3.0
    (first,) = folder.iterdir()
    code = first.read_bytes()
    assert kernel(triple)(1.5) == 4.5
    (second,) = set(folder.iterdir()) - {first}
    second.write_bytes(code)
    assert kernel(triple)(1.5) == 4.5


def test_code_unused_for_a_week_goes_when_other_code_of_the_function_is_kept(folder):
    def count():
        return len(list(folder.iterdir()))

    assert kernel(double)(1.5) == 3.0
    assert kernel(triple)(1.5) == 4.5
    for file in folder.iterdir():
        os.utime(file, (0, 0))
    assert kernel(triple)(1.5) == 4.5  # which uses its code
    assert kernel(triple)(2) == 6 and count() == 3
    for file in folder.iterdir():
        os.utime(file, (0, 0))
    assert kernel(triple)(2j) == 6j and count() == 2


@pytest.mark.thorough
def test_a_full_disk_is_told_once(probe):
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))"
    answer, line = probe(full)
    assert answer == "4.0 0" and line.count("\n") == 1  # and one of the long wait
    assert "(File too large); it is compiled in each process" in line


@pytest.mark.thorough
def test_processes_go_on_beside_one_that_is_stopped_while_it_compiles(tmp_path):
    (tmp_path / "probe.py").write_text(PROBE)
    stop = """
from numba.core import event
from numba.core.registry import cpu_target
class Stop(event.Listener):
    def on_start(self, event):
        os.kill(os.getpid(), 19)
    def on_end(self, event):
        pass
event.register("numba:compile", Stop())
"""
    patient = "cspace._support.compiling.TURN_SECONDS = 0.0, 0.2"
    stopped = start_script(tmp_path, RUN_PROBE.format(before=stop))
    os.waitid(os.P_PID, stopped.pid, os.WSTOPPED | os.WNOWAIT)
    for hits in range(2):
        answer, said = run_script(tmp_path, RUN_PROBE.format(before=patient))
        assert answer == f"4.0 {hits}" and f"waiting for process {stopped.pid}, " in said
    while stopped.poll() is None:
        stopped.send_signal(signal.SIGCONT)
        time.sleep(0.05)
    assert stopped.stdout.read().strip() == "4.0 0"
    assert run_script(tmp_path, RUN_PROBE.format(before=patient)) == ("4.0 1", "")


@pytest.mark.usefixtures("folder")
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


# ---- code that comes with the package ------------------------------------------------------------

HALVES = """
from cspace._support.compiling import kernel

@kernel
def halve(value):
    return value / 2.0
"""


@pytest.fixture
def run_shipped(tmp_path, monkeypatch):
    """Return a function that runs code which came with the package; it returns its hits."""

    def run(text, cache):
        (tmp_path / cache).mkdir()
        (tmp_path / "halves.py").write_text(text)
        monkeypatch.setattr("cspace._support.compiling.cache_folder", lambda: tmp_path / cache)
        monkeypatch.setattr("cspace._support.compiling._open_lock_file", lambda: None)
        halve = runpy.run_path(str(tmp_path / "halves.py"), run_name="halves")["halve"]
        assert halve(3.0) == 1.5
        return sum(halve.stats.cache_hits.values())

    for name in ("name_code", "find_code_misfit"):  # they are cached
        monkeypatch.setattr(shipped, name, getattr(shipped, name).__wrapped__)
    own_target = cpu_target.target_context.codegen().magic_tuple()[1:]
    monkeypatch.setattr(shipped, "TARGET", own_target)
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "package")
    assert shipped.find_code_misfit() == "none came with the package"
    assert run(HALVES, "first") == 0
    place = shipped.FOLDER / shipped.name_code()
    place.mkdir(parents=True)
    for file in (tmp_path / "first").iterdir():
        file.rename(place / file.name)
    return run


def test_code_of_the_package_is_used_if_the_function_is_the_same(run_shipped):
    assert run_shipped(HALVES, "second") == 1 and shipped.find_code_misfit() == ""
    assert run_shipped(HALVES.replace("/ 2.0", "* 0.5"), "third") == 0
    assert run_shipped(HALVES, "fourth") == 1


@pytest.mark.parametrize(
    "name, value, reason",
    [
        ("numpy.__version__", "2.0.0", "; this is numba-"),
        ("llvmlite.__version__", "0.40.0", "; this is numba-"),
        ("numba.__version__", "0.60.0", "; this is numba-0.60.0-"),
        ("sys.implementation.cache_tag", "cpython-310", "-cpython-310"),
        (
            "numba.core.codegen.CPUCodegen.magic_tuple",
            lambda self: (self._llvm_module.triple, "an old one", "+sse2"),
            "the processor lacks +",
        ),
    ],
)
def test_code_of_the_package_is_refused_if_it_is_for_something_else(
    run_shipped, monkeypatch, name, value, reason
):
    monkeypatch.setattr(name, value)
    assert reason in shipped.find_code_misfit()
    assert run_shipped(HALVES, "second") == 0


def test_code_of_the_package_needs_what_its_processor_has():
    # The levels of the x86-64 psABI, as LLVM names them; each level has the features of the one before.
    levels = (
        "cmov cx8 fxsr mmx sse sse2 cx16 sahf popcnt sse3 sse4.1 sse4.2 ssse3 avx avx2 bmi bmi2"
    )
    processor, features = shipped.TARGET
    assert processor == "x86-64-v3"
    assert set(features.split(",")) == {
        f"+{name}" for name in f"{levels} f16c fma lzcnt movbe xsave".split()
    }


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
    for file in cache.rglob("*.nbc"):
        data = pickle.dumps(Harm(harm))
        file.write_bytes(hashlib.sha256(file.name.encode() + data).digest() + data)
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
    assert all(file.is_relative_to(tmp_path / "cache") for file in tmp_path.rglob("*.nb?"))


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


@pytest.mark.usefixtures("folder")
def test_the_clock_stops_while_a_function_is_compiled_or_refused():
    from numba import TypingError

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


def test_the_clock_stops_while_code_is_loaded(monkeypatch):
    now = [0.0]

    def load_slowly(*_):
        now[0] += 10.0

    made = kernel(lambda value: value - 1)
    monkeypatch.setattr(type(clock), "read", staticmethod(lambda: now[0]))
    monkeypatch.setattr(made._cache, "load_overload", load_slowly)
    monkeypatch.setattr(made._cache, "save_overload", load_slowly)
    before = clock()
    assert made(1.5) == 0.5
    assert now[0] == 20.0 and clock() == pytest.approx(before)
