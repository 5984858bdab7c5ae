"""Workers merge requests during a run and survive errors."""

from __future__ import annotations

import threading

from cspace.view.page import Worker
from tests.helpers.waiting import until


def test_a_worker_merges_requests_survives_errors_and_ends():
    others = set(threading.enumerate())
    go = threading.Event()
    runs = []
    errors = []

    def work():
        go.wait(10.0)
        runs.append(len(runs))
        if len(runs) == 2:
            raise ValueError("once")

    worker = Worker(work, errors.append)
    worker.request()
    until(lambda: worker._busy)
    for _ in range(50):
        worker.request()
    assert not worker.wait(0.01)
    go.set()
    assert worker.wait(10.0)
    assert runs == [0, 1]
    worker.request()
    assert worker.wait(10.0)
    assert runs == [0, 1, 2]
    assert [str(error) for error in errors] == ["once"]
    worker.close()
    until(lambda: others.issuperset(threading.enumerate()))
