"""Settings and fixtures of all tests."""

import atexit
import gc
import os
import shutil
import tempfile
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol
from hypothesis import settings
from hypothesis.internal.conjecture import providers

WORKER = "PYTEST_XDIST_WORKER" in os.environ

# Use a temporary cache, shared by all workers, so that tests neither read nor modify the user's
# cache. Developers keep compiled code between runs in the folder CSPACE_TEST_CACHE.
if not WORKER:
    cache_folder = os.environ.get("CSPACE_TEST_CACHE")
    os.environ["XDG_CACHE_HOME"] = cache_folder or tempfile.mkdtemp(prefix="cspace-tests-")
    if not cache_folder:
        atexit.register(shutil.rmtree, os.environ["XDG_CACHE_HOME"], ignore_errors=True)

# A worker exits immediately after its exit handlers, because freeing its objects takes four
# seconds.
if WORKER:
    atexit.register(os._exit, 0)

# Each core has a worker; a second thread of numpy's linear algebra would spin while it waits.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Collecting tests makes millions of objects but hardly any garbage, and the garbage of compiling
# fits a worker.
gc.set_threshold(1_000_000, 20, 20)

# Every run draws the same examples; the soak draws new ones, with --hypothesis-profile=new. There
# is no deadline because the first call of a kernel compiles it.
settings.register_profile("cspace", deadline=None, max_examples=50, derandomize=True)
settings.register_profile("new", settings.get_profile("cspace"), derandomize=False, print_blob=True)
settings.load_profile("cspace")

# Hypothesis also draws constants from the source of the modules imported so far, which differ from
# worker to worker.
providers._get_local_constants = lambda: providers._local_constants

UNSHARED = (
    "spectral/test_bump.py",
    "bodies/test_triangles.py",
)  # they compile no functions that map builds use
RUN_FIRST = (
    "cli/test_commands.py",
    *UNSHARED,
    "exact/",
    "spectral/",
    "raster/",
    "planners/",
    "tiles/",
    "view/",
    "test_update.py",
    "test_proofs.py",
)
"""Test files to run first, because they compile or wait longest.

Two workers begin with tests that compile different functions; each finds the other's functions in
the cache later. Tests that wait, for example for a browser, run while other tests remain.
"""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the longest tests first, so that workers end together."""
    items.sort(
        key=lambda item: next(
            (k for k, part in enumerate(RUN_FIRST) if f"/{part}" in item.nodeid), len(RUN_FIRST)
        )
    )


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Report only failures and calls from workers, unless ``--durations`` is set.

    Otherwise half of the time for handing out tests goes into reporting successful fixtures.
    """
    if not WORKER or item.config.getoption("durations"):
        return None
    for report in runtestprotocol(item, log=False, nextitem=nextitem):
        if report.when == "call" or not report.passed:
            item.ihook.pytest_runtest_logreport(report=report)
    return True


def pytest_collection_finish() -> None:
    """Exclude everything loaded so far from garbage collection."""
    gc.freeze()


def pytest_sessionfinish() -> None:
    """Collect only new garbage, once; pytest would collect all garbage five times."""
    gc.collect(0)
    gc.freeze()
    atexit.register(gc.unfreeze)  # otherwise OMPL's bindings report leaks


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the folder of real maps and shapes."""
    name = os.environ.get("CSPACE_TEST_DATA")
    if not name:
        pytest.skip(
            "CSPACE_TEST_DATA is not set; set it to the folder of real maps to run this test"
        )
    folder = Path(name)
    if not folder.is_dir():
        pytest.skip(
            f"CSPACE_TEST_DATA is {name!r}, which is not a folder; set it to the folder of real maps"
        )
    return folder
