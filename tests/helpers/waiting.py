"""Waiting for other threads and programs."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor


def until(true, seconds=20.0):
    """Wait for a true value, and return it."""
    end = time.monotonic() + seconds
    while not (value := true()):
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(0.05)
    return value


def write_while_querying(query, writers):
    """Run writers in threads while two threads call ``query``; raise any error."""
    done = threading.Event()

    def go_on():
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
