"""A compile cache of its own, settings of hypothesis, the two sets, CPU by file, and real maps."""

import atexit
import contextlib
import gc
import math
import os
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

# Tests neither read nor write the user's compile cache; all workers share a temporary one.
# Developers keep compiled code between runs in the folder CSPACE_TEST_CACHE.
if "PYTEST_XDIST_WORKER" not in os.environ:
    cache_folder = os.environ.get("CSPACE_TEST_CACHE")
    if not cache_folder:
        cache_folder = tempfile.mkdtemp(prefix="cspace-tests-")
        atexit.register(shutil.rmtree, cache_folder, ignore_errors=True)
    os.environ["XDG_CACHE_HOME"] = cache_folder

# Tests run on each core already. Threads of BLAS and of OpenMP would wait for each other, busily.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

# There is no deadline because the first call of a kernel compiles it. The seed of a run is an
# option of pytest: pyproject.toml gives 0, and fuzzing new ones.
settings.register_profile("all", deadline=None, max_examples=50, database=None, print_blob=True)
for profile, count in {"quick": 5, "fuzz": 100, "soak": 2000}.items():
    settings.register_profile(profile, settings.get_profile("all"), max_examples=count)
settings.load_profile("all")

# ---- the two sets --------------------------------------------------------------------------------


def pytest_configure(config):
    """Draw fewer examples in the quick set, and refuse unknown markers of the option -m."""
    if config.getoption("-m") == "not thorough":
        settings.load_profile("quick")
    known = {re.split(r"[:(]", line)[0] for line in config.getini("markers")}
    words = set(re.findall(r"\w+", config.getoption("-m"))) - {"and", "or", "not"}
    if unknown := sorted(words - known):
        raise pytest.UsageError(f"-m names {unknown[0]!r}, which is no marker of pyproject.toml")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark the tests on real maps, which are large, as thorough."""
    for item in items:
        if "data" in item.fixturenames:
            item.add_marker("thorough")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Collect tests, and let the garbage collector skip what is loaded, now and later.

    It would take a third of the time of collecting, and a tenth of that of the tests.
    """
    with contextlib.suppress(ImportError):  # the core's tests run without planners
        from tests.helpers import answers

        answers.watch()
    # Disabled, it would stay so: dask, loaded here, restores what it found.
    gc.set_threshold(0)
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.set_threshold(100_000)


# ---- CPU -----------------------------------------------------------------------------------------


def used_cpu():
    """Return the CPU seconds of this process and of its children that have ended."""
    return sum(os.times()[:4])


def pytest_addoption(parser):
    parser.addoption("--cpu", action="store_true", help="print the CPU of the run and by file")
    parser.addoption("--complete", action="store_true", help="fail if a test is skipped")


def pytest_sessionfinish(session):
    """Fail a run that had to have each package, browser and map, if a test was skipped."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if session.config.getoption("--complete") and reporter and "skipped" in reporter.stats:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    item.cpu_before = used_cpu()
    if answers := sys.modules.get("tests.helpers.answers"):
        answers.tally.start(item.get_closest_marker("unchecked") is None)
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    if call.when == "teardown":
        item.user_properties.append(("cpu", used_cpu() - item.cpu_before))
        if answers := sys.modules.get("tests.helpers.answers"):
            seen = dict(answers.tally.seen) | {"CPU of the checker, s": answers.tally.cpu}
            item.user_properties.append(("answers", seen))
    return (yield)


def pytest_terminal_summary(terminalreporter):
    """Print the CPU of the run, with its workers and children, and its ten dearest files."""
    if not terminalreporter.config.getoption("--cpu"):
        return
    files, answers = Counter(), Counter()
    for report in (each for each in terminalreporter.getreports("") if each.when == "teardown"):
        properties = dict(report.user_properties)
        files[report.nodeid.partition("::")[0]] += properties["cpu"]
        answers.update(properties.get("answers", {}))
    terminalreporter.section(f"{used_cpu():.0f} s of CPU")
    for file, seconds in files.most_common(10):
        terminalreporter.write_line(f"{seconds:6.1f} s  {file}")
    for answer, count in answers.most_common(30):
        terminalreporter.write_line(f"{count:8.6g}  {answer}")


# ---- hints ---------------------------------------------------------------------------------------


@pytest.fixture(autouse=True, scope="session")
def check_hints():
    """Check each hint of each error that a test provokes."""
    from cspace.errors import CspaceError
    from tests.helpers.hints import check_hint

    initialize = CspaceError.__init__

    def initialize_and_check(self, *values, **options):
        initialize(self, *values, **options)
        check_hint(self.hint)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CspaceError, "__init__", initialize_and_check)
        yield


# ---- real maps -----------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def count_work(monkeypatch):
    """Let time limits count the CPU time of a test, which a busy machine does not change.

    It is read each millisecond, because searches ask for it millions of times.
    """
    from cspace._support.compiling import clock

    read_at, seconds = -math.inf, 0.0

    def read():
        nonlocal read_at, seconds
        seconds += 1e-7  # each reading is later than the one before
        if (moment := time.perf_counter()) > read_at + 1e-3:
            read_at, seconds = moment, max(seconds, time.process_time())
        return seconds

    monkeypatch.setattr(type(clock), "read", staticmethod(read))


@pytest.fixture(scope="session")
def data():
    """Return the folder of real maps and shapes."""
    name = os.environ.get("CSPACE_TEST_DATA")
    if not name:
        pytest.skip("set CSPACE_TEST_DATA to the folder of real maps to run this test")
    folder = Path(name)
    if not folder.is_dir():
        pytest.skip(f"CSPACE_TEST_DATA is {name!r}, which is not a folder")
    return folder
