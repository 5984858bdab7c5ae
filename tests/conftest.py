"""What several test files share."""

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

# Use a temporary cache, shared by all workers, so that tests neither read nor modify the user's cache. Developers keep
# compiled code between runs in the folder CSPACE_TEST_CACHE.
if not WORKER:
    kept = os.environ.get("CSPACE_TEST_CACHE")
    os.environ["XDG_CACHE_HOME"] = kept or tempfile.mkdtemp(prefix="cspace-tests-")
    if not kept:
        atexit.register(shutil.rmtree, os.environ["XDG_CACHE_HOME"], ignore_errors=True)

# After all that is to be done at the end, a worker goes at once: taking apart what it holds takes four seconds.
if WORKER:
    atexit.register(os._exit, 0)

# There is a worker on each core. A second thread of numpy's linear algebra would wait there for work, and not sleep.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Collecting tests makes millions of objects, and hardly any garbage; what compiling leaves fits a worker.
gc.set_threshold(1_000_000, 20, 20)

# Every run draws the same examples; the soak draws new ones, with --hypothesis-profile=new. There is no deadline
# because the first call of a kernel compiles it.
settings.register_profile("cspace", deadline=None, max_examples=50, derandomize=True)
settings.register_profile("new", settings.get_profile("cspace"), derandomize=False, print_blob=True)
settings.load_profile("cspace")

# Hypothesis also draws constants from the source of the modules imported so far, which differ from worker to worker.
providers._get_local_constants = lambda: providers._local_constants

APART = ("spectral/test_bump.py", "exact/test_triangles.py")  # which compile nothing that builds of maps do
FIRST = (
    "cli/test_commands.py",
    *APART,
    "exact/",
    "planners/test_passages.py",  # of which test_plan.py takes much
    "spectral/",
    "raster/",
    "planners/",
    "tiles/",
    "view/",
    "test_update.py",
    "test_proofs.py",
)
"""Two workers begin where they compile different things; what one has compiled, the other finds in the cache later.

What waits for others, such as a browser, does so while there is more to do."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run what takes longest first, so that no worker ends long after the other."""
    items.sort(key=lambda item: next((k for k, part in enumerate(FIRST) if f"/{part}" in item.nodeid), len(FIRST)))


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Have workers tell what came of a test, and of its fixtures only where they fail, or how long they took is asked.

    Else half of the time that it takes to hand tests out goes into telling that all is well.
    """
    if not WORKER or item.config.getoption("durations"):
        return None
    for report in runtestprotocol(item, log=False, nextitem=nextitem):
        if report.when == "call" or not report.passed:
            item.ihook.pytest_runtest_logreport(report=report)
    return True


def pytest_collection_finish() -> None:
    """Look for no garbage among what stays to the end: modules, kernels and thousands of tests."""
    gc.freeze()


def pytest_sessionfinish() -> None:
    """Garbage may hold what was left open: look for what is new here, and not five times, as pytest does, in all."""
    gc.collect(0)
    gc.freeze()
    atexit.register(gc.unfreeze)  # or OMPL's bindings complain of what is left


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real maps and shapes."""
    name = os.environ.get("CSPACE_TEST_DATA")
    if not name:
        pytest.skip("CSPACE_TEST_DATA is not set; set it to the folder of real maps to run this test")
    folder = Path(name)
    if not folder.is_dir():
        pytest.skip(f"CSPACE_TEST_DATA is {name!r}, which is not a folder; set it to the folder of real maps")
    return folder
