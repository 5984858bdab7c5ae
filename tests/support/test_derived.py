"""Parts of a map: computed once, dropped, not copied."""

import copy
import pickle
import threading
import time

import numpy as np
import pytest

import cspace
from cspace.support.derived import derived, lazy


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

    owner, got = Owner(make), []
    threads = [threading.Thread(target=lambda: got.append(owner.part)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert owner.made == 1
    assert len(got) == 8 and all(part is owner.part for part in got)


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


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda space: pickle.loads(pickle.dumps(space))]
)
def test_copies_of_a_map_share_neither_lock_nor_parts(copied):
    space = cspace.build(
        cspace.Workspace.from_array(np.zeros((12, 12), dtype=bool), 0.1), cspace.Robot.disc(0.1)
    )
    q = (0.3, 0.9), (0.8, 0.4)
    assert space.is_connected(*q)
    with space.lock:
        other = copied(space)
        answers = []
        thread = threading.Thread(target=lambda: answers.append(other.is_connected(*q)))
        thread.start()
        thread.join(10.0)
    assert answers == [True]
    assert not {"_components", "_distances"} & vars(copied(space)).keys()
