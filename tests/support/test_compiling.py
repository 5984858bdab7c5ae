"""Compiled functions: the cache, its privacy, the line about a long wait, and the clock."""

import errno
import gc
import os
import pickle
import runpy
import shutil
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

import cspace
from cspace._support import shipped
from cspace._support.compiling import cache_folder, clock, internal, is_private, kernel
from tests.helpers.missing import output_without
from tests.helpers.scripts import run_script, start_script

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


@pytest.mark.thorough
def test_a_change_of_kernels_their_constants_or_records_changes_the_folder(tmp_path):
    def folder():
        return run_script(
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
    support = tmp_path / "cspace" / "_support"
    (support / "first.py").write_text("SIDE = 1\n")
    # A kernel may be compiled with what a file of constants makes of another one's.
    (support / "second.py").write_text("from cspace._support.first import SIDE\n")
    with (support / "vectors.py").open("a") as opened:
        opened.write("\nfrom cspace._support.second import AREA, measure\n")
    for file, text, is_compiled in (
        ("cspace/_support/vectors.py", "MORE = 1", True),
        ("cspace/_grid.py", "MORE = 1", True),
        ("cspace/_record/cells.py", "MORE = 1", True),
        ("planners/_searches/frontier.py", "MORE = 1", True),
        ("cspace/_support/second.py", "AREA = SIDE**2", True),
        ("cspace/_support/first.py", "SIDE = 2", True),
        ("cspace/__init__.py", "__version__ = '9.9.9'", True),
        ("cspace/errors.py", "MORE = 1", False),
        ("cspace/_space.py", "MORE = 1", False),
        ("cspace/_support/check.py", "MORE = 1", False),
    ):
        with (tmp_path / file).open("a") as opened:
            opened.write(f"\n{text}\n")
        seen.append(folder())
        assert (seen[-1] != seen[-2]) is is_compiled, (file, text)


@pytest.mark.thorough
def test_a_package_beside_the_core_never_runs_old_code_of_its_other_files(tmp_path):
    package = tmp_path / "wing"
    package.mkdir()
    (package / "__init__.py").touch()
    part = "from cspace.inside import internal\n\n@internal\ndef part():\n    return {}\n"
    whole = (
        "from cspace.inside import kernel\nfrom wing.part import part\n\n@kernel\ndef whole():\n"
        "    return part()\n"
    )
    (package / "whole.py").write_text(whole)
    code = "from wing.whole import whole; print(whole(), sum(whole.stats.cache_hits.values()))"
    answers = []
    for number in (1, 1, 2):
        (package / "part.py").write_text(part.format(number))
        answers.append(run_script(tmp_path, code)[0])
    assert answers == ["1 0", "1 1", "2 0"]


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


def list_code():
    """List the files of compiled code of this module."""
    return {file.name for file in cache_folder().rglob("test_compiling*")}


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
    before = list_code()
    with subprocess.Popen(command, stdin=-1, stdout=-1, text=True) as other:
        assert other.stdout.readline() == "locked\n"
        made = kernel(double)
        assert made(2.5) == 5.0
        assert told.index(1) == 6 and now == [61.0]  # it is named after 5 s, and left after 60
        assert made(3) == 6 and now == [61.0]  # without another wait
    # What is compiled without a turn is not saved, because the other process may save, too.
    assert list_code() == before
    (line,) = caplog.messages
    assert f"waiting for process {other.pid}, which compiles {__name__}.double;" in line


def test_only_code_that_nobody_has_used_for_a_week_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    own = cache_folder.__wrapped__()
    digest = own.name[-16:]
    old = [own.with_name(f"numba-0.1.dev2+a-cpython-39-{digest}")]
    others = ["robots", "numba-notes", own.name[:-1], f"{own.name}0", f"{own.name}.mine"]
    kept = [own, own.with_name(f"{own.name[:-16]}{digest[::-1]}"), *map(own.with_name, others)]
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
    monkeypatch.setattr("os.replace", fail)  # numba writes another file, and renames it
    values = [kernel(lambda x, k=k: x + k)(1.5) for k in range(2)]
    assert values == [1.5, 2.5]
    (line,) = caplog.messages
    assert "(No space left on device); it is kept in memory alone" in line


def test_code_is_kept_in_memory_if_no_file_can_be_made(monkeypatch, caplog):
    def fail(_):
        raise OSError

    monkeypatch.setattr("cspace._support.compiling._warnings", set())
    monkeypatch.setattr("numba.core.caching._CacheLocator.ensure_cache_path", fail)
    values = [kernel(lambda x, k=k: x * k)(1.5) for k in range(2)]
    assert values == [0.0, 1.5]
    (line,) = caplog.messages
    assert "fails (no file can be made); it is kept in memory alone" in line


@pytest.mark.parametrize("share, reason", [(0.0, "Ran out of input"), (0.5, "truncated")])
def test_code_is_compiled_anew_if_its_files_are_cut_off(share, reason, monkeypatch, caplog):
    monkeypatch.setattr("cspace._support.compiling._warnings", set())
    before = list_code()
    assert kernel(triple)(1.5) == 4.5
    for name in list_code() - before:
        (file,) = cache_folder().rglob(name)
        os.truncate(file, int(share * file.stat().st_size))
    assert kernel(triple)(1.5) == 4.5
    (line,) = caplog.messages
    assert reason in line and line.endswith("; it is kept in memory alone")
    for name in list_code() - before:
        next(cache_folder().rglob(name)).unlink()


@pytest.mark.thorough
def test_a_full_disk_is_told_once(probe):
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))"
    answer, line = probe(full)
    assert answer == "4.0 0" and line.count("\n") == 1  # and one of the long wait
    assert "fails (File too large); it is kept in memory alone" in line


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
    for _ in range(2):
        answer, said = run_script(tmp_path, RUN_PROBE.format(before=patient))
        assert answer == "4.0 0" and f"waiting for process {stopped.pid}, " in said
    while stopped.poll() is None:
        stopped.send_signal(signal.SIGCONT)
        time.sleep(0.05)
    assert stopped.stdout.read().strip() == "4.0 0"
    assert run_script(tmp_path, RUN_PROBE.format(before=patient)) == ("4.0 1", "")


def test_only_kernels_become_machine_code_and_no_garbage_is_collected_meanwhile(monkeypatch):
    # An earlier run may have kept the code.
    monkeypatch.setattr("cspace._support.compiling._code_folder", lambda package: None)

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
        monkeypatch.setattr("cspace._support.compiling._code_folder", lambda _: tmp_path / cache)
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
    for file in (tmp_path / "first").rglob("*.nb?"):
        file.rename(place / file.name)
    return run


def test_code_of_the_package_is_used_if_the_text_of_its_file_is_the_same(run_shipped):
    assert run_shipped(HALVES, "second") == 1 and shipped.find_code_misfit() == ""
    assert run_shipped(f"{HALVES}\n# another text\n", "third") == 0
    assert run_shipped(HALVES, "fourth") == 1


@pytest.mark.parametrize(
    "name, value, reason",
    [
        ("numpy.__version__", "2.0.0", "; this is numba-"),
        ("llvmlite.__version__", "0.40.0", "; this is numba-"),
        ("numba.__version__", "0.60.0", "; this is numba-0.60.0-"),
        ("sys.implementation.cache_tag", "cpython-310", "-cpython-310-"),
        ("cspace._support.shipped.digest_sources", lambda: "0" * 16, "-0000000000000000"),
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


def test_the_clock_stops_while_a_function_is_compiled_or_refused(
    monkeypatch,
):
    from numba import TypingError

    # Nothing is compiled yet.
    monkeypatch.setattr("cspace._support.compiling._code_folder", lambda package: None)

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
