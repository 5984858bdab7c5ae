"""Waiting for other threads and programs."""

import time


def until(true, seconds=600.0):
    """Wait for a true value, and return it."""
    end = time.monotonic() + seconds
    while not (value := true()):
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(0.05)
    return value
