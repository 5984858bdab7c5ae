"""Kept parts: made once however many threads ask, renewed, dropped, and left behind by copies."""

import copy
import pickle
import threading
import time

import pytest

from cspace.map.kept import Kept, Lock


class Counter:
    def __init__(self):
        self.changes = []

    def renew(self, change):
        self.changes.append(change)


def test_one_thread_makes_the_part_and_all_get_it():
    kept, made, got = Kept(Lock()), [], []

    def make():
        time.sleep(0.01)
        made.append(Counter())
        return made[-1]

    threads = [threading.Thread(target=lambda: got.append(kept.get(make))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 1
    assert all(part is made[0] for part in got)
    assert len(got) == 8


def test_a_part_follows_changes_once_it_is_made():
    kept = Kept(Lock())
    kept.renew("before")  # nothing is there to follow
    part = kept.get(Counter)
    kept.renew("after")
    assert part.changes == ["after"]
    assert kept.made is part
    kept.drop()
    assert kept.made is None
    assert kept.get(Counter) is not part


def test_a_part_that_could_not_be_made_is_made_at_the_next_call():
    kept = Kept(Lock())

    def fails():
        raise MemoryError

    with pytest.raises(MemoryError):
        kept.get(fails)
    assert isinstance(kept.get(Counter), Counter)


@pytest.mark.parametrize("of", [copy.copy, copy.deepcopy, lambda pair: pickle.loads(pickle.dumps(pair))])
def test_copies_leave_the_lock_and_the_part_behind(of):
    lock = Lock()
    kept = Kept(lock)
    kept.get(lambda: threading.Lock())  # cannot be pickled
    with lock, lock:
        other = of(kept)
        assert other.made is None
    assert isinstance(other.get(Counter), Counter)
    assert not isinstance(kept.made, Counter)


def test_parts_of_one_copied_map_share_its_new_lock():
    lock = Lock()
    first, second = copy.deepcopy([Kept(lock), Kept(lock)])
    assert first._lock is second._lock
    assert first._lock is not lock
