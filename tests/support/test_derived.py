"""Parts of a map: computed once, dropped, not copied."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

from cspace._support.derived import derived, lazy


class Owner:
    def __init__(self, make=object):
        self.lock, self.make, self.made = threading.RLock(), make, 0

    @lazy
    def part(self):
        """Part of the owner."""
        self.made += 1
        return self.make()

    @derived
    def other(self):
        """Another part of the owner."""
        return self.make()


def test_one_thread_computes_the_part_for_all():
    def make():
        time.sleep(0.01)
        return object()

    owner = Owner(make)
    with ThreadPoolExecutor(8) as threads:
        parts = list(threads.map(lambda _: owner.part, range(8)))
    assert owner.made == 1
    assert all(part is owner.part for part in parts)


def test_only_derived_parts_are_dropped():
    owner = Owner()
    part, other = owner.part, owner.other
    derived.drop(owner)
    assert owner.part is part
    assert owner.other is not other
    assert Owner.part.__doc__ == "Part of the owner."


def test_all_parts_of_an_owner_share_its_lock():
    first, second = Owner(), Owner()
    threads = [threading.Thread(target=getattr, args=(owner, "other")) for owner in (second, first)]

    def make():
        for thread in threads:
            thread.start()
        threads[0].join(10.0)
        threads[1].join(0.1)
        assert [thread.is_alive() for thread in threads] == [False, True]
        return object()

    first.make = make
    part, first.make = first.part, object
    threads[1].join(10.0)
    assert type(part) is object
