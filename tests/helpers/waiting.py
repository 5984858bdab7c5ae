"""Waiting for other threads and programs."""

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any


def until(true: Callable[[], Any], seconds: float = 20.0) -> Any:
    """Wait for a true value, and return it."""
    end = time.monotonic() + seconds
    while not (value := true()):
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(0.05)
    return value


def write_while_querying(
    query: Callable[[], object], writers: Sequence[Callable[[], object]]
) -> None:
    """Run writers in threads while two threads call ``query``; raise any error."""
    done = threading.Event()

    def go_on() -> None:
        while not done.is_set():
            query()

    with ThreadPoolExecutor(len(writers) + 2) as threads:
        readers = [threads.submit(go_on) for _ in range(2)]
        writing = [threads.submit(write) for write in writers]
        try:
            for each in writing:
                each.result()
        finally:
            done.set()
    for each in readers:
        each.result()
