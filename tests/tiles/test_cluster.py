"""Tiles made on the workers of a cluster, some of which are killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time

import numpy as np
import pytest

import cspace
from cspace.errors import CspaceError, InputError
from tiles.test_build import CAR, check_half_done, random_workspace, same_states

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def client():
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0", "memory_limit": "2GB"}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as made:
        yield made


def test_on_a_cluster(client, tmp_path):
    workspace, told = random_workspace((200, 150)), []
    cspace.build(
        workspace, CAR, rotations=6, store=tmp_path / "m", tile=40, client=client, progress=lambda *s: told.append(s)
    )
    same_states(tmp_path / "m", cspace.build(workspace, CAR, rotations=6))
    assert told[-1] == (20, 20)
    np.save(tmp_path / "a.npy", workspace.outer)
    lazy = cspace.Workspace.from_array(np.load(tmp_path / "a.npy", mmap_mode="r"), 0.1)
    cspace.build(lazy, CAR, store=tmp_path / "lazy", tile=40, client=client)
    same_states(tmp_path / "lazy", cspace.build(cspace.Workspace.from_array(workspace.outer, 0.1), CAR))


def test_a_worker_is_killed(client, tmp_path):
    workspace = random_workspace((1000, 900))
    pids = list(client.run(os.getpid).values())

    def kill():
        time.sleep(0.3)
        os.kill(pids[0], signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    cspace.build(workspace, CAR, rotations=8, store=tmp_path / "m", tile=100, client=client)
    thread.join()
    same_states(tmp_path / "m", cspace.build(workspace, CAR, rotations=8))


def test_other_versions_and_too_little_memory(client, tmp_path, monkeypatch):
    workspace = random_workspace((90, 90))
    large = cspace.Workspace.from_array(pytest.importorskip("dask.array").zeros((20_000, 20_000), dtype=bool), 0.1)
    with pytest.raises(InputError, match="use a smaller tile"):
        cspace.build(large, CAR, store=tmp_path / "b", tile=20_000, client=client)
    monkeypatch.setattr("cspace.tiles.work.__version__", "0.0.9")
    with pytest.raises(InputError, match=r"workers with cspace 0\.1\.0; all must have cspace 0\.0\.9"):
        cspace.build(workspace, CAR, store=tmp_path / "m", client=client)


def run_cluster(addresses):
    """A scheduler and a worker in this process, until it is killed."""
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None, "processes": False}
    with distributed.LocalCluster(**options, protocol="tcp") as cluster:
        addresses.put(cluster.scheduler_address)
        threading.Event().wait()


def test_the_scheduler_is_killed(tmp_path):
    """The cluster goes while tiles are made: one clear error, and the rest is made without it."""
    workspace = random_workspace((600, 500))
    context = multiprocessing.get_context("spawn")
    addresses = context.Queue()
    process = context.Process(target=run_cluster, args=(addresses,), daemon=True)
    process.start()

    def kill(done, total):
        if done == 2:
            process.kill()

    with dask.config.set({"distributed.comm.timeouts.connect": "2s"}):
        client = distributed.Client(addresses.get(timeout=60))
        with pytest.raises(CspaceError, match="run the same again"):
            cspace.build(workspace, CAR, rotations=8, store=tmp_path / "m", tile=30, client=client, progress=kill)
        client.close()
    process.join()
    assert 0.0 < cspace.open(tmp_path / "m").done < 1.0
    space = cspace.build(workspace, CAR, rotations=8)
    check_half_done(tmp_path / "m", space)
    cspace.build(workspace, CAR, rotations=8, store=tmp_path / "m", tile=30)
    same_states(tmp_path / "m", space)
