"""A compile cache of its own, the settings of hypothesis, and the folder of real maps."""

import atexit
import os
import shutil
import tempfile
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

# There is no deadline because the first call of a kernel compiles it. The seed of a run is an
# option of pytest: pyproject.toml gives 0, and fuzzing new ones.
settings.register_profile("cspace", deadline=None, max_examples=50, database=None, print_blob=True)
settings.load_profile("cspace")


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
