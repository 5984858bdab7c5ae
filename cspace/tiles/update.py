"""A box of the workspace of a stored map changes: the tiles that it reaches are made anew, and take place at once."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cspace.arrays import Bools, Box, Ints, intersect_boxes
from cspace.errors import InputError
from cspace.store import Index, Store, aside_name
from cspace.tiles.work import Job, run
from cspace.update import Patch, Update

if TYPE_CHECKING:
    from distributed import Client


class Patched:
    """The cells that a store keeps of its workspace, some of which are others from now on."""

    def __init__(self, store: Store, patch: Patch) -> None:
        self._store, self._patch, self.same = store, patch, bool(store.metadata["same"])

    def read(self, box: Box) -> tuple[Bools, Bools]:
        outer, inner = self._store.obstacles_in(box)
        here, there = intersect_boxes(box, self._patch.window)
        if all(part.start < part.stop for part in here):
            outer[here] = self._patch.outer[there]
            if inner is not outer:
                inner[here] = self._patch.inner[there]
        return outer, inner

    @property
    def stamp(self) -> str:
        return str(self._store.metadata["stamp"])


def update_store(store: Store, patch: Patch, client: Client | None, reach: Ints) -> Update:
    """Change a store; it is as before until all is made, and then as after.

    Raises InputError if inner cells are given for a store that keeps outer ones alone, and FileError if the store
    cannot be read or written; it is as before then.
    """
    if patch.inner is not patch.outer and store.metadata["same"]:
        rule = "it was built on obstacles whose outer and inner cells are the same, and keeps one of them"
        raise InputError(
            "inner", f"is given for {store.path}", rule, "leave it out, or build the map anew", value=patch.inner
        )
    with _alone(store):
        store = Store.open(store.path).settled()
        old = store.obstacles_in(patch.window)
        differ = (old[0] != patch.outer) | (old[1] != patch.inner)
        if not differ.any():
            return Update(0, patch.lower, patch.lower, 0)
        used = np.argwhere(differ)
        first, stop = used.min(axis=0) + patch.lower, used.max(axis=0) + patch.lower + 1
        looked = np.maximum(first - reach[1], 0), np.minimum(stop - reach[0], store.grid.shape)
        whole = zip(np.minimum(looked[0], first).tolist(), np.maximum(looked[1], stop).tolist(), strict=True)
        tiles = list(store.tiles_in([slice(low, high) for low, high in whole]))
        aside = aside_name()
        changed = run(partial(_remake, aside=aside), Job(store, Patched(store, patch)), tiles, client, None)
        seen = replace(store, metadata={**store.metadata, "aside": aside})
        store.commit(aside, **seen.totals())
    weights = np.bincount(store.slice_of, minlength=store.slices)
    counts = int(np.sum(changed, axis=0) @ weights)
    return Update(int(np.count_nonzero(differ)), tuple(looked[0].tolist()), tuple(looked[1].tolist()), counts)


def _remake(job: Job, index: Index, aside: str) -> Ints:
    """Make a tile beside the one that is there; how many states of each slice differ."""
    store = job.store
    seen = replace(store, metadata={**store.metadata, "aside": aside})
    old, new = store.known(index), job.make(index, aside=aside)
    changed = np.zeros(store.slices, dtype=np.int64)
    for layer in range(store.layers):
        numbers = store.numbers(layer)
        if old.digests[layer] != new.digests[layer]:
            parts = (each.states(index, layer, record) for each, record in ((store, old), (seen, new)))
            before, after = (part[: len(numbers)].reshape(len(numbers), -1) for part in parts)
            changed[numbers.start : numbers.stop] = np.count_nonzero(before != after, axis=1)
    return changed


@contextmanager
def _alone(store: Store) -> Iterator[None]:
    """Wait for other processes that update the same store."""
    try:
        import fcntl
    except ImportError:  # no such locks on this system
        yield
        return
    folder = os.open(store.path, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)
