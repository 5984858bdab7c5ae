"""What several test files share."""

import atexit
import gc
import os
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

# What is kept about this machine in the user's cache folder shall not change what the tests do, nor they it. Workers
# share one folder, where what one has made, such as matplotlib's list of fonts, the other finds.
if "PYTEST_XDIST_WORKER" not in os.environ:
    os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="cspace-tests-")

# There is a worker on each core. A second thread of numpy's linear algebra would wait there for work, and not sleep.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Collecting tests makes millions of objects, and hardly any garbage.
gc.set_threshold(100_000, 20, 20)

# A test that meets a compiled kernel for the first time waits for the compiler.
settings.register_profile("cspace", deadline=None, max_examples=50, derandomize="CI" in os.environ)
settings.load_profile("cspace")

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


def pytest_collection_finish() -> None:
    """Look for no garbage among what stays to the end: modules, kernels and thousands of tests."""
    gc.freeze()


def pytest_sessionfinish() -> None:
    """Garbage may hold what was left open: look for it here, and not five times, as pytest does, in all that stays."""
    gc.collect()
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
