"""Workers merge requests during a run and survive errors."""

from __future__ import annotations

import threading

from cspace.view.page import Worker
from tests.helpers.waiting import until


def test_worker_merges_requests_and_survives_errors() -> None:
    done, go, others = [], threading.Event(), set(threading.enumerate())

    def work() -> None:
        go.wait(10.0)
        done.append(len(done))
        if len(done) == 2:
            raise ValueError("once")

    failed: list[Exception] = []
    worker = Worker(work, failed.append)
    own = set(threading.enumerate()) - others
    assert own
    worker.request()
    for _ in range(50):
        worker.request()
    assert not worker.wait(0.01)
    go.set()
    assert worker.wait(10.0)
    assert 1 <= len(done) <= 2
    while not failed:
        worker.request()
        assert worker.wait(10.0)
    count = len(done)
    worker.request()
    assert worker.wait(10.0)
    assert len(done) == count + 1
    assert [str(error) for error in failed] == ["once"]
    worker.close()
    until(lambda: own.isdisjoint(threading.enumerate()))
