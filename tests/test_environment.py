"""Processes without a home folder, and with switches of Python and numba."""

import subprocess
import sys
import zipfile

import pytest

from cspace._support.compiling import cache_folder
from tests.helpers.repository import ROOT

PATH = f"import sys; sys.path.insert(0, {str(ROOT)!r})\n"  # -I ignores PYTHONPATH

WITHOUT_HOME = """
import os, pwd, runpy

def find_nobody(*names):
    raise KeyError(*names)

pwd.getpwuid = pwd.getpwnam = find_nobody  # as in a container whose user has no entry
os.umask(0o077)
sys.argv = ["cspace", "demo", "--json", "--output", sys.argv[1]]
runpy.run_module("cspace", run_name="__main__", alter_sys=True)
"""

WORK = """
import hashlib, tempfile
import numpy as np
import cspace, planners

def main():
    cells = np.zeros((40, 30), dtype=bool)
    cells[20, :18] = True
    workspace = cspace.Workspace.from_array(cells, 0.1)
    space = cspace.build(workspace, cspace.Robot.disc(0.2))
    with tempfile.TemporaryDirectory() as folder:
        space.save(f"{folder}/map.zarr")
        print(hashlib.sha256(cspace.open(f"{folder}/map.zarr").cell_states).hexdigest())
    for planner in (None, "RRTConnect"):
        plan = planners.plan(space, (1, 1), (3, 1), planner=planner, seed=1)
        print(plan.certified, plan.path.tolist(), plan.recheck().all())

main()
"""


def run(code, *options, argument="", cwd=None, **environment):
    """Run code in a process with no other variables than the given ones."""
    command = [sys.executable, *options, "-c", PATH + code, argument]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)


def work(*options, **environment):
    """Run the work with the compiled code of these tests."""
    folder = cache_folder()
    assert folder is not None
    return run(WORK, *options, NUMBA_CACHE_DIR=str(folder.parents[1]), **environment)


@pytest.fixture(scope="module")
def printed():
    """Return what the work prints without any switch."""
    done = work()
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("True") == 4
    return done.stdout


@pytest.mark.thorough
@pytest.mark.parametrize(
    "options, environment",
    [
        ((), {"PYTHONDEVMODE": "1"}),  # finds memory that is used after it is freed
        ((), {"PYTHONOPTIMIZE": "2", "PYTHONHASHSEED": "7"}),
        (("-W", "error", "-bb"), {}),
        (("-I", "-X", "utf8=0"), {"LC_ALL": "C"}),
        ((), {"NUMBA_NUM_THREADS": "1", "NUMBA_DEVELOPER_MODE": "1", "OMP_NUM_THREADS": "1"}),
    ],
    ids=["dev", "optimize", "errors", "isolated", "numba"],
)
def test_switches_change_no_result(options, environment, printed):
    done = work(*options, **environment)
    assert (done.returncode, done.stdout) == (0, printed), done.stderr


@pytest.mark.thorough
def test_uncompiled_proofs_are_refused():
    done = work(NUMBA_DISABLE_JIT="1")
    *_, message = done.stderr.splitlines()
    assert message.startswith("cspace.errors.InputError: NUMBA_DISABLE_JIT is")
    assert message.endswith("proofs rely on the arithmetic of compiled code")
    assert work(NUMBA_DISABLE_JIT="0").returncode == 0


@pytest.mark.thorough
def test_the_demo_runs_without_a_home_folder_and_leaves_private_files(tmp_path):
    """Only the folders for temporary files and for the output can be written."""
    (tmp_path / "file").touch()
    unusable = str(tmp_path / "file" / "no folder")
    for name in ("temporary", "locked"):
        (tmp_path / name).mkdir()
    (tmp_path / "locked").chmod(0o500)
    places = {"TMPDIR": str(tmp_path / "temporary"), "XDG_CACHE_HOME": unusable}
    output = tmp_path / "demo"
    done = run(WITHOUT_HOME, argument=str(output), cwd=tmp_path / "locked", **places)
    assert done.returncode == 0, done.stderr
    written = [output, *output.rglob("*")]
    assert {file.name for file in written} >= {"map.zarr", "path.csv", "picture.png"}
    assert all(file.stat().st_mode & 0o077 == 0 for file in written)
    assert not any((tmp_path / "locked").iterdir())


def test_packages_are_imported_without_any_folder_for_compiled_code(tmp_path):
    code = """
import os, tempfile
tempfile._candidate_tempdir_list = lambda: [sys.argv[1]]
os.environ["HOME"] = sys.argv[1]
import cspace._support.compiling, cspace._queries.edges  # which has kernels
print(cspace._support.compiling.cache_folder())
"""
    (tmp_path / "file").touch()
    done = run(code, argument=str(tmp_path / "file" / "no folder"))
    assert done.stdout == "None\n", done.stderr


def test_another_package_named_planners_is_refused_in_one_line(tmp_path):
    for name in ("planners_of_routes-1.0.dist-info", "planners-0.13.4.dist-info"):
        assert run("import cspace", cwd=tmp_path, PYTHONPATH=str(tmp_path)).returncode == 0
        (tmp_path / name).mkdir()
    done = run("import cspace", cwd=tmp_path, PYTHONPATH=str(tmp_path))
    last = done.stderr.strip().rpartition("\n")[2]
    assert last.startswith(f"ImportError: {tmp_path} has another package named planners")


def test_an_archive_is_refused_in_one_line(tmp_path):
    archive = tmp_path / "site.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for name in ("__init__.py", "__init__.pyi", "_support/__init__.py"):
            file.write(ROOT / "cspace" / name, f"cspace/{name}")
    command = [
        sys.executable,
        "-c",
        f"import sys; sys.path.insert(0, {str(archive)!r})\nimport cspace",
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    last = done.stderr.strip().rpartition("\n")[2]
    assert last.startswith("ImportError: ") and "cspace runs only from a folder" in last
