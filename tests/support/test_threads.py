"""Threads of nested chunks."""

import threading

from cspace.support import threads


def test_nested_chunks_start_no_threads(monkeypatch):
    monkeypatch.setattr(threads, "cores", lambda: 2)
    seen = []

    def inner(start, stop):
        seen.append((threading.current_thread(), start, stop))
        return -1

    assert (
        threads.in_chunks(lambda start, stop: threads.in_chunks(inner, stop - start, 1), 20, 1)
        == -1
    )
    assert sorted(part[1:] for part in seen) == [(0, 5), (0, 5), (5, 10), (5, 10)]
    assert len({part[0] for part in seen}) <= 2
