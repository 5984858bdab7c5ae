"""Memory is told before any work, from what the machine, a container or a process's limit leaves."""

import math
import subprocess
import sys

import pytest

import cspace
from cspace.memory import WORKSPACE_BYTES, build_seconds, bytes_text, check_memory, map_bytes, time_text

LIMITED = """
import resource, psutil, cspace
room = psutil.Process().memory_info().vms + 2**29
resource.setrlimit(resource.RLIMIT_AS, (room, room))
try:
    cspace.Workspace.from_points([(0.0, 0.0), (40.0, 40.0)], 0.001)
except cspace.InputError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits of addresses are kept on Linux")
def test_a_limit_of_the_process_counts():
    done = subprocess.run([sys.executable, "-c", LIMITED], capture_output=True, text=True, check=True)
    assert "40000 x 40000 cells" in done.stdout and "needs about 3.2 GB" in done.stdout


def test_what_does_not_fit_is_refused_with_figures_and_a_spacing_that_would(monkeypatch):
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 10**9)
    check_memory(0.95e9, "the map", cspace.Grid((0.0,) * 3, 0.1, (1000,) * 3))
    with pytest.raises(cspace.InputError, match=r"at most 950 MB may be taken, which is 95% .* at least 0.11 m"):
        check_memory(1e9, "the map", cspace.Grid((0.0,) * 3, 0.1, (1000,) * 3))
    with pytest.raises(cspace.InputError, match="no spacing helps"):
        check_memory(1.1e9, "the map", cspace.Grid((0.0, 0.0), 0.1, (10, 10)), fixed=1e9)


def test_the_spacing_that_a_workspace_is_advised_fits_its_map(monkeypatch):
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 10**9)
    with pytest.raises(cspace.InputError, match="use a spacing of at least") as error:
        cspace.Workspace.from_points([(0.0, 0.0), (40.0, 40.0)], 0.001)
    spacing = float(error.value.mend.split("at least ")[1].split()[0])
    shape = [math.ceil(40.0 / spacing)] * 2
    check_memory(WORKSPACE_BYTES * math.prod(shape) + map_bytes(shape), "the map", cspace.Grid((0, 0), spacing, shape))


def test_joining_cells_is_refused_before_it_begins(monkeypatch):
    space = cspace.build(cspace.Workspace.from_array([[False] * 99] * 99, 0.1), cspace.Robot.disc(0.1), rotations=8)
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 100)
    with pytest.raises(cspace.InputError, match=r"the map, to join its cells, .* use a spacing of at least"):
        space.path_exists((1.0, 1.0, 0.0), (2.0, 2.0, 0.0))
    monkeypatch.undo()
    assert space.path_exists((1.0, 1.0, 0.0), (2.0, 2.0, 0.0)) is True


def test_times_as_text():
    assert [time_text(n) for n in (0.034, 7.0, 130.0, 8000.0, 1e6)] == [
        "0.03 s", "7 s", "2 minutes", "2 hours", "10 days",
    ]  # fmt: skip
    assert build_seconds((64, 64, 46), 6912) > build_seconds((64, 64, 46), 100) > build_seconds((64, 64), 100)


def test_bytes_as_text():
    assert [bytes_text(n) for n in (12, 1500, 2.5e9)] == ["12 bytes", "1.5 kB", "2.5 GB"]
