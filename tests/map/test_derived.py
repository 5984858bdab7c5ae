"""Derived parts: made once however many threads ask, renewed, dropped, and left behind by copies."""

import copy
import pickle
import threading
import time

import pytest

from cspace.map.derived import Derived, Lock


class Counter:
    def __init__(self):
        self.changes = []

    def renew(self, change):
        self.changes.append(change)


def test_one_thread_makes_the_part_and_all_get_it():
    derived, made, got = Derived(Lock()), [], []

    def make():
        time.sleep(0.01)
        made.append(Counter())
        return made[-1]

    threads = [threading.Thread(target=lambda: got.append(derived.get(make))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 1
    assert all(part is made[0] for part in got)
    assert len(got) == 8


def test_a_part_follows_changes_after_it_is_made():
    derived = Derived(Lock())
    derived.renew("before")  # nothing is there to follow
    part = derived.get(Counter)
    derived.renew("after")
    assert part.changes == ["after"]
    assert derived.made is part
    derived.drop()
    assert derived.made is None
    assert derived.get(Counter) is not part


def test_a_part_that_could_not_be_made_is_made_at_the_next_call():
    derived = Derived(Lock())

    def fails():
        raise MemoryError

    with pytest.raises(MemoryError):
        derived.get(fails)
    assert isinstance(derived.get(Counter), Counter)


@pytest.mark.parametrize("of", [copy.copy, copy.deepcopy, lambda pair: pickle.loads(pickle.dumps(pair))])
def test_copies_leave_the_lock_and_the_part_behind(of):
    lock = Lock()
    derived = Derived(lock)
    derived.get(lambda: threading.Lock())  # cannot be pickled
    with lock, lock:
        other = of(derived)
        assert other.made is None
    assert isinstance(other.get(Counter), Counter)
    assert not isinstance(derived.made, Counter)


def test_parts_of_one_copied_map_share_its_new_lock():
    original = Derived(Lock())
    parts = original, *copy.deepcopy([original, original])
    others = [threading.Thread(target=part.get, args=(Counter,)) for part in parts[::2]]

    def make():
        for thread in others:
            thread.start()
        others[0].join(10.0)
        others[1].join(0.1)
        assert [thread.is_alive() for thread in others] == [False, True]
        return Counter()

    parts[1].get(make)
    others[1].join()
