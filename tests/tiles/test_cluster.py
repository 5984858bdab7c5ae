"""Tiled builds on the workers of a cluster."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import psutil
import pytest

import cspace
from cspace.errors import CspaceError, InputError
from tests.helpers.repository import ROOT
from tests.helpers.waiting import until
from tests.laws.any_map import CAR
from tests.tiles.test_build import check_states, check_tile, random_workspace, tiles_of

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


FORK_SERVER = """
import json, os, signal, sys
import numba, scipy, shapely, zarr
from distributed.cli import dask_scheduler, dask_worker

signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # ended children leave no zombies
for line in sys.stdin:
    name, options, code, log = json.loads(line)
    if process := os.fork():
        print(process, flush=True)
        continue
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    os.chdir("/")
    sys.path.insert(0, code)
    os.environ["PYTHONPATH"] = code
    null, out = os.open(os.devnull, os.O_RDONLY), os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    for here, there in ((null, 0), (out, 1), (out, 2)):
        os.dup2(here, there)
    {"scheduler": dask_scheduler, "worker": dask_worker}[name].main(options)
"""
"""Fork schedulers and workers from a process that has imported dask but not cspace."""


class Process:
    """A scheduler or a worker."""

    def __init__(self, number):
        self.number = number

    def kill(self):
        with suppress(ProcessLookupError):
            os.kill(self.number, signal.SIGKILL)

    def wait(self):
        until(lambda: not psutil.pid_exists(self.number))


class Live:
    """A scheduler and workers, each in its own process."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self.forks = subprocess.Popen(
            [sys.executable, "-c", FORK_SERVER], cwd="/", text=True, **pipes
        )
        self.start(
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--scheduler-file",
            str(folder / "scheduler"),
        )
        while not (folder / "scheduler").exists():
            time.sleep(0.05)
        self.address = json.loads((folder / "scheduler").read_text())["address"]

    def start(self, name, *options, code=ROOT):
        """Start a scheduler or a worker with the folder of its code."""
        request = [name, [*options, "--no-dashboard"], str(code), str(self.folder / "log")]
        print(json.dumps(request), file=self.forks.stdin, flush=True)
        self.processes.append(Process(int(self.forks.stdout.readline())))
        return self.processes[-1]

    def worker(self, *more, code=ROOT):
        options = (
            "--nthreads",
            "1",
            "--memory-limit",
            "2GB",
            "--no-nanny",
            "--local-directory",
            str(self.folder),
        )
        return self.start("worker", self.address, *options, *more, code=code)

    def client(self, workers):
        made = distributed.Client(self.address)
        made.wait_for_workers(workers, timeout=60)
        return made


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    made = Live(tmp_path_factory.mktemp("live"))
    yield made
    for process in made.processes:
        process.kill()
    made.forks.communicate()


@pytest.mark.parametrize(
    ("code", "version"),
    [('__version__ = "0.0.9"', r"0\.0\.9"), ("raise ImportError", "none")],
    ids=["older", "none"],
)
def test_workers_with_another_version_are_rejected(live, code, version, tmp_path):
    (tmp_path / "cspace").mkdir()
    (tmp_path / "cspace" / "__init__.py").write_text(code)
    message = (
        rf"workers with cspace {version}; all must have cspace {re.escape(cspace.__version__)}"
    )
    other = live.worker(code=tmp_path)
    with live.client(1) as client:
        with pytest.raises(InputError, match=message):
            cspace.build(random_workspace((90, 90)), CAR, store=tmp_path / "m", client=client)
        assert client.scheduler_info()["workers"]  # the worker survived
        other.kill()
        other.wait()


def test_a_cluster_without_workers_is_rejected(live, tmp_path):
    with distributed.Client(live.address) as client:
        until(lambda: not client.scheduler_info()["workers"])
        with pytest.raises(InputError, match="has no workers"):
            cspace.build(random_workspace((90, 90)), CAR, store=tmp_path / "m", client=client)


def test_cluster_build_equals_the_map_in_memory(live, tmp_path):
    workspace, steps = random_workspace((200, 150)), []
    live.worker()
    live.worker()
    with live.client(2) as client:
        options = {"client": client, "tile": 40, "progress": lambda *step: steps.append(step)}
        cspace.build(workspace, CAR, rotations=6, store=tmp_path / "m", **options)
        np.save(tmp_path / "a.npy", workspace.outer)
        lazy = cspace.Workspace.from_array(np.load(tmp_path / "a.npy", mmap_mode="r"), 0.1)
        cspace.build(lazy, CAR, store=tmp_path / "lazy", tile=40, client=client)
    check_states(tmp_path / "m", cspace.build(workspace, CAR, rotations=6))
    assert steps[-1] == (20, 20)
    check_states(
        tmp_path / "lazy", cspace.build(cspace.Workspace.from_array(workspace.outer, 0.1), CAR)
    )


def test_workers_forget_a_map_that_another_one_replaces(live, tmp_path):
    # The stores of all maps have one path, and the workspace of the first three is the same.
    workspace, wall = random_workspace((60, 50)), np.zeros((64, 64), dtype=bool)
    wall[5, :54] = True
    maps = [
        (workspace, cspace.Robot.disc(radius), margin)
        for radius, margin in ((0.1, 0.0), (0.4, 0.0), (0.1, 0.5))
    ]
    with live.client(1) as client:
        for cells, robot, margin in maps:
            shutil.rmtree(tmp_path / "m", ignore_errors=True)
            cspace.build(cells, robot, margin=margin, store=tmp_path / "m", tile=32, client=client)
            check_states(tmp_path / "m", cspace.build(cells, robot, margin=margin))
        for side in (33, 64):
            shutil.rmtree(tmp_path / "m")
            cells = cspace.Workspace.from_array(wall[:side, :side], 0.1)
            tiled = cspace.build(cells, maps[0][1], store=tmp_path / "m", tile=32)
            tiled.compute_components(client=client)
            space = cspace.build(cells, maps[0][1])
            starts, goals = np.random.default_rng(0).uniform(0.0, 0.1 * side, (2, 500, 2))
            np.testing.assert_array_equal(
                tiled.is_disconnected(starts, goals), space.is_disconnected(starts, goals)
            )
            np.testing.assert_array_equal(
                tiled.is_connected(starts, goals), space.is_connected(starts, goals)
            )


def test_remaining_workers_finish_the_build(live, tmp_path):
    workspace = random_workspace((300, 250))

    def kill(done, total):
        if done == 5:
            live.processes[-1].kill()

    with live.client(2) as client:
        cspace.build(
            workspace, CAR, rotations=8, store=tmp_path / "m", tile=25, client=client, progress=kill
        )
        assert len(client.scheduler_info()["workers"]) == 1
    check_states(tmp_path / "m", cspace.build(workspace, CAR, rotations=8))


def test_build_resumes_after_the_scheduler_is_killed(live, tmp_path):
    # The next call builds the rest without the cluster.
    workspace = random_workspace((300, 250))

    def kill(done, total):
        if done == 2:
            live.processes[0].kill()

    with dask.config.set({"distributed.comm.timeouts.connect": "2s"}):
        client = live.client(1)
        with pytest.raises(CspaceError, match="repeat the call"):
            cspace.build(
                workspace,
                CAR,
                rotations=8,
                store=tmp_path / "m",
                tile=30,
                client=client,
                progress=kill,
            )
        client.close()
    assert 0.0 < cspace.open(tmp_path / "m").progress < 1.0
    space = cspace.build(workspace, CAR, rotations=8)
    for part in tiles_of(tmp_path / "m").values():
        check_tile(part, space)
    cspace.build(workspace, CAR, rotations=8, store=tmp_path / "m", tile=30)
    check_states(tmp_path / "m", space)
