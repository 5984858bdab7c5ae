"""Compiled functions: log, cache, invalidation and privacy."""

import ast
import json
import os
import pickle
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import cspace
import planners
from cspace import compiling
from cspace.compiling import clock, digest_sources, is_private, jit

LOOK_UP_SCRIPT = """
import logging
import sys
import numpy as np
import cspace
from cspace.map.contents import Contents
logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s", stream=sys.stdout)
workspace = cspace.Workspace.from_array(np.zeros((4, 3), dtype=bool), 0.1)
state = np.zeros((4, 3), dtype=np.uint8)
state[0] = cspace.BLOCKED
cells = cspace.Rotations.of(None)
contents = Contents(workspace, cspace.Robot.disc(0.05), cells, np.zeros(1, dtype=int), state[None], "free")
space = cspace.CSpace(contents)
answers = space.is_free((0.2, 0.15)), space.is_free((0.01, 0.15))
if "numba.np.linalg" in sys.modules:
    print("numba has imported all that it could compile")
print(cspace.__file__, *answers)
"""
POINTS_LINE = "INFO cspace.compiling: compiling cspace.map.points, once per machine"
NUMBA_LINE = "numba has imported all that it could compile"


def run_look_up(folder: Path, **environment: str) -> list[str]:
    """Query a map with the package in a folder; return its output."""
    others = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    env = {**others, "PYTHONPATH": str(folder), **environment}
    done = subprocess.run(
        [sys.executable, "-c", LOOK_UP_SCRIPT], env=env, cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert lines[-1] == f"{folder / 'cspace' / '__init__.py'} True False"
    return lines[:-1]


def test_the_log_names_compiled_modules_but_not_cached_ones(tmp_path: Path) -> None:
    root = Path(cspace.__file__).parents[1]
    first, second = (run_look_up(root, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2))
    assert POINTS_LINE in first and len(set(first)) == len(first)
    assert first.pop() == NUMBA_LINE
    assert all(line.startswith("INFO cspace.compiling: compiling cspace.") for line in first)
    assert second == []


def test_a_read_only_installation_works_without_a_cache(tmp_path: Path) -> None:
    # Files named __pycache__ keep even the superuser from making cache folders.
    package = tmp_path / "cspace"
    shutil.copytree(Path(cspace.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in (package, *(entry for entry in package.rglob("*") if entry.is_dir())):
        (folder / "__pycache__").write_text("in the way")
    homeless = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR", "IPYTHONDIR"), os.devnull)
    assert POINTS_LINE in run_look_up(tmp_path, **homeless)


WAIT_SCRIPT = """
import time
from types import SimpleNamespace
import numba.core.event as event
import planners, cspace.compiling as compiling
{setting}
compiling._announce_compiling()
for module in ("planners.plan", "cspace.one", "cspace.two", "cspace.three", "numba.other"):
    function = SimpleNamespace(__module__=module)
    with event.trigger_event("numba:compile", {{"dispatcher": SimpleNamespace(py_func=function)}}):
        time.sleep({seconds})
"""


@pytest.mark.parametrize(
    ("setting", "seconds", "lines"),
    [
        ("", 1.1, 1),
        ("", 0.0, 0),
        ("import logging; logging.getLogger('cspace.compiling').disabled = True", 1.1, 0),
    ],
    ids=["long wait", "short wait", "hidden"],
)
def test_a_long_wait_for_the_compiler_is_told_once(setting: str, seconds: float, lines: int) -> None:
    script = WAIT_SCRIPT.format(setting=setting, seconds=seconds)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    told = [line for line in done.stderr.splitlines() if "compiling for this machine" in line]
    assert len(told) == len(done.stderr.splitlines()) == lines
    assert done.stdout == ""


# ---- invalidation ----------------------------------------------------------------------------------------------------

CALLEE = """
from typing import NamedTuple
from cspace.compiling import compilable, jit

@jit
def helper(value: float) -> float:
    return value + {added}

@compilable
class Record(NamedTuple):
    value: float

    def raised(self) -> float:
        return helper(self.value)
"""

CALLER = """
from cspace.compiling import jit
from cspace.probe_callee import Record

@jit
def answer(record: Record) -> float:
    return later(record)

@jit
def later(record: Record) -> float:
    return record.raised()
"""

RUN_PROBES = """
import importlib.util, sys
for name in ("callee", "caller"):
    spec = importlib.util.spec_from_file_location(f"cspace.probe_{name}", f"{folder}/{name}.py")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
print(module.answer(module.Record(1.0)), sum(module.answer.stats.cache_hits.values()), flush=True)
"""

PROBE_SERVER = f"""
import json, os, sys
import numba
import cspace.compiling
numba.njit(lambda value: value)(1.0)  # it sets itself up
for line in sys.stdin:
    folder, environment = json.loads(line)
    if os.fork():
        os.wait()
        continue
    os.environ.update(environment)
    numba.core.config.reload_config()
    exec({RUN_PROBES!r})
    os._exit(0)
"""
"""Run the probes in forks of a process that has imported numba but compiled none of our functions."""


@pytest.fixture(scope="module")
def forks() -> Iterator[subprocess.Popen[str]]:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen([sys.executable, "-c", PROBE_SERVER], text=True, **pipes) as process:
        yield process
        assert process.communicate()[0] == ""


@pytest.fixture
def run(tmp_path: Path, forks: subprocess.Popen[str]) -> Callable[..., tuple[float, int]]:
    """Return a function that runs the probes: result and cache hits."""

    def answered(added: str | None = None, **environment: str) -> tuple[float, int]:
        if added is not None:
            (tmp_path / "callee.py").write_text(CALLEE.format(added=added))
        assert forks.stdin is not None and forks.stdout is not None
        print(json.dumps([str(tmp_path), environment]), file=forks.stdin, flush=True)
        result, hits = forks.stdout.readline().split()
        return float(result), int(hits)

    (tmp_path / "caller.py").write_text(CALLER)
    return answered


def test_a_function_is_recompiled_when_a_callee_changes(run: Callable[..., tuple[float, int]]) -> None:
    # The callee may be indirect, defined below its caller, or a method of a record.
    assert run("2.0") == (3.0, 0)
    assert run("40.0") == (41.0, 0)
    assert run() == (41.0, 1)


def double(value: float) -> float:
    return 2 * value


def test_the_clock_stops_while_a_function_is_compiled_or_refused() -> None:
    from numba import TypingError

    def good(x: float) -> float:
        return 2.0 * x + 1.0

    def bad(x: float) -> object:
        return x + "no number"  # type: ignore[operator]

    for function in (double, good, bad):
        made: Any = jit(function)
        made._cache.flush()
        began = clock(), time.perf_counter()
        with suppress(TypingError):
            made(1.5)
        assert clock() - began[0] < 0.5 * (time.perf_counter() - began[1])
    assert clock() < clock()


def test_a_digest_covers_every_module_that_a_module_imports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # An edit changes the digests of the module and its importers only.

    def digests() -> list[str]:
        compiling._source.cache_clear()
        return [digest_sources([f"cspace.probe_{name}"]) for name in "abc"]

    texts = {"a": "from cspace.probe_b import x", "b": "from cspace import (\n    probe_c,\n)", "c": "y = 1"}
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text)
        module = ModuleType(f"cspace.probe_{name}")
        module.__file__ = str(tmp_path / f"{name}.py")
        monkeypatch.setitem(sys.modules, module.__name__, module)
    before = digests()
    (tmp_path / "b.py").write_text(texts["b"] + "\n")
    after = digests()
    assert [one == other for one, other in zip(before, after, strict=True)] == [False, False, True]
    (tmp_path / "c.py").write_text("y = 2")
    assert not set(digests()) & {*before, *after}
    compiling._source.cache_clear()


def test_no_field_of_a_record_has_the_name_of_a_compiled_method() -> None:
    # Compiled code would use the field instead of the method.
    fields, methods = set[str](), set[str]()
    for file in [each for package in (cspace, planners) for each in Path(package.__file__).parent.rglob("*.py")]:
        for record in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(record, ast.ClassDef) and "NamedTuple" in map(ast.unparse, record.bases):
                fields |= {ast.unparse(each.target) for each in record.body if isinstance(each, ast.AnnAssign)}
                if "compilable" in map(ast.unparse, record.decorator_list):
                    methods |= {each.name for each in record.body if isinstance(each, ast.FunctionDef)}
    assert len(methods) > 10 and len(fields) > 100
    assert not fields & methods


# ---- privacy ---------------------------------------------------------------------------------------------------------


class Harm:
    """Payload that creates a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


@pytest.mark.skipif(sys.platform == "win32", reason="closed to others there by itself")
def test_cache_folders_that_others_may_write_are_not_read(
    tmp_path: Path, run: Callable[..., tuple[float, int]]
) -> None:
    cache, harm = tmp_path / "kept", tmp_path / "harm"
    environment = {"NUMBA_CACHE_DIR": str(cache), "HOME": os.devnull, "XDG_CACHE_HOME": os.devnull}
    (tmp_path / "__pycache__").write_text("in the way")
    assert run("2.0", **environment) == (3.0, 0)
    assert run(**environment) == (3.0, 1)
    (folder,) = cache.iterdir()
    for index in cache.rglob("*.nbi"):
        index.write_bytes(pickle.dumps(Harm(harm)))
    for path, mode in ((folder, 0o1757), (cache, 0o777)):
        before = path.stat().st_mode
        path.chmod(mode)
        assert run(**environment) == (3.0, 0)
        assert not harm.exists()
        path.chmod(before)
    assert run(**environment) == (3.0, 0)
    assert harm.exists()  # private files are read, and unusable files compiled again
    assert run(**environment) == (3.0, 1)


@pytest.mark.skipif(sys.platform == "win32", reason="closed to others there by itself")
def test_a_folder_of_another_user_is_not_private(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    assert is_private(inner)
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    is_private.cache_clear()
    assert not is_private(inner)
    is_private.cache_clear()


def test_damaged_or_exchanged_cache_files_are_compiled_again(
    tmp_path: Path, run: Callable[..., tuple[float, int]]
) -> None:
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    assert run("2.0", **environment) == (3.0, 0)
    for ending in ("nbi", "nbc"):
        for file in (tmp_path / "kept").rglob(f"*.{ending}"):
            file.write_bytes(file.read_bytes()[:99])
        assert run(**environment) == (3.0, 0)
    codes = sorted((tmp_path / "kept").rglob("*answer*.nbc")) + sorted((tmp_path / "kept").rglob("*helper*.nbc"))
    shutil.copy(codes[1], codes[0])
    assert run(**environment) == (3.0, 0)
    assert run(**environment) == (3.0, 1)
