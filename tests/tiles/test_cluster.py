"""Tiled builds on the workers of a cluster."""

import os
import signal
from types import SimpleNamespace

import pytest

import cspace
from cspace.errors import InputError
from tests.tiles.worlds import CAR, check_states, check_tiles, random_workspace

distributed = pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.thorough,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
WORKSPACE = random_workspace((200, 150))


def connect(workers, processes=False):
    """Start a cluster, by default with workers that are threads of this process."""
    options = {"threads_per_worker": 1, "dashboard_address": None}
    return distributed.Client(n_workers=workers, processes=processes, **options)


def test_a_cluster_builds_and_labels_a_map_though_a_worker_is_killed(tmp_path):
    steps = []
    finished = {}

    def kill_a_worker(done, total):
        steps.append((done, total))
        if done == 5:
            tiles = (tmp_path / "m").glob("[0-9]*.[0-9]*")
            finished.update({tile: tile.stat().st_ino for tile in tiles})
            victim = min(client.run(os.getpid).values())
            os.kill(victim, signal.SIGKILL)

    options = {"rotations": 6, "store": tmp_path / "m", "tile": 40, "progress": kill_a_worker}
    with connect(2, processes=True) as client:
        tiled = cspace.build(WORKSPACE, CAR, **options, client=client)
        tiled.compute_components(client)
    assert steps == [(done, 20) for done in range(1, 21)]
    # The scheduler repeats tasks whose results were lost, but no complete tile is written again.
    assert len(finished) >= 5
    assert {tile: tile.stat().st_ino for tile in finished} == finished
    space = cspace.build(WORKSPACE, CAR, rotations=6)
    check_states(tmp_path / "m", space)
    q = space.sample_free(200)
    assert (tiled.is_connected(q[:100], q[100:]) == space.is_connected(q[:100], q[100:])).all()


def test_builds_resume_after_a_cluster_is_lost(tmp_path):
    options = {"rotations": 6, "store": tmp_path / "m", "tile": 40}
    with connect(1) as client:

        def close_cluster(done, total):
            if done == 2:
                client.cluster.close()

        with pytest.raises(InputError, match="the cluster must be running"):
            cspace.build(WORKSPACE, CAR, **options, client=client, progress=close_cluster)
    assert 0.0 < cspace.open(tmp_path / "m").progress < 1.0
    space = cspace.build(WORKSPACE, CAR, rotations=6)
    check_tiles(tmp_path / "m", space)
    cspace.build(WORKSPACE, CAR, **options)
    check_states(tmp_path / "m", space)


@pytest.mark.parametrize("workers", [0, 1])
def test_a_cluster_needs_workers_of_this_version(tmp_path, monkeypatch, workers):
    monkeypatch.setattr("cspace._tiles.work.cspace", SimpleNamespace(__version__="0.0.9"))
    problem = f"workers with cspace {cspace.__version__}" if workers else "no workers"
    with connect(workers) as client:
        with pytest.raises(InputError, match=f"client has {problem}; .* 0.0.9, like this process"):
            cspace.build(WORKSPACE, CAR, store=tmp_path / "m", client=client)
        # As the hint says: workers are started, and have this version.
        monkeypatch.undo()
        client.cluster.scale(1)
        client.wait_for_workers(1)
        assert cspace.build(WORKSPACE, CAR, store=tmp_path / "m", client=client).progress == 1.0
