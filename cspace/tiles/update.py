"""Atomic updates of a stored map."""

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
from cspace.tiles.work import Job, run_tasks
from cspace.update import Patch, Update

if TYPE_CHECKING:
    from distributed import Client


class PatchedSource:
    """Workspace cells of a store, with a patch."""

    def __init__(self, store: Store, patch: Patch) -> None:
        self._store, self._patch, self.same = store, patch, bool(store.metadata["same"])

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """Return the outer and inner cells of a box."""
        outer, inner = self._store.obstacles_in(box)
        in_box, in_patch = intersect_boxes(box, self._patch.window)
        if all(part.start < part.stop for part in in_box):
            outer[in_box] = self._patch.outer[in_patch]
            if inner is not outer:
                inner[in_box] = self._patch.inner[in_patch]
        return outer, inner

    @property
    def stamp(self) -> str:
        """Stamp of the store's workspace."""
        return str(self._store.metadata["stamp"])


def update_store(store: Store, patch: Patch, client: Client | None, reach: Ints) -> Update:
    """Apply a patch to a store atomically.

    Readers see the map before or after it. Raises InputError if the patch has inner cells and the store keeps only
    outer ones, and FileError if the store cannot be read or written. An update that fails leaves the map unchanged.
    """
    if patch.inner is not patch.outer and store.metadata["same"]:
        rule = "its outer and inner cells are the same"
        raise InputError("inner", f"is given for {store.path}", rule, "omit it, or build a new map", value=patch.inner)
    with _lock_store(store):
        store = Store.open(store.path).settled()
        old = store.obstacles_in(patch.window)
        differ = (old[0] != patch.outer) | (old[1] != patch.inner)
        if not differ.any():
            return Update(0, patch.lower, patch.lower, 0)
        changed_cells = np.argwhere(differ)
        start, stop = changed_cells.min(axis=0) + patch.lower, changed_cells.max(axis=0) + patch.lower + 1
        lower, upper = np.maximum(start - reach[1], 0), np.minimum(stop - reach[0], store.grid.shape)
        # Tiles hold workspace cells too, so those with changed cells are rebuilt even if no state there can change.
        box = zip(np.minimum(lower, start).tolist(), np.maximum(upper, stop).tolist(), strict=True)
        tiles = list(store.tiles_in([slice(low, high) for low, high in box]))
        aside = aside_name()
        changed = run_tasks(
            partial(_rebuild_tile, aside=aside), Job(store, PatchedSource(store, patch)), tiles, client, None
        )
        updated = replace(store, metadata={**store.metadata, "aside": aside})
        store.commit(aside, **updated.totals())
    weights = np.bincount(store.slice_of, minlength=store.slices)
    changed_count = int(np.sum(changed, axis=0) @ weights)
    return Update(int(np.count_nonzero(differ)), tuple(lower.tolist()), tuple(upper.tolist()), changed_count)


def _rebuild_tile(job: Job, index: Index, aside: str) -> Ints:
    """Write a new version of a tile.

    It lies beside the old one. Return the number of changed states per slice.
    """
    store = job.store
    updated = replace(store, metadata={**store.metadata, "aside": aside})
    old, new = store.known(index), job.build_tile(index, aside=aside)
    changed = np.zeros(store.slices, dtype=np.int64)
    for layer in range(store.layers):
        numbers = store.numbers(layer)
        if old.digests[layer] != new.digests[layer]:
            parts = (each.states(index, layer, record) for each, record in ((store, old), (updated, new)))
            before, after = (part[: len(numbers)].reshape(len(numbers), -1) for part in parts)
            changed[numbers.start : numbers.stop] = np.count_nonzero(before != after, axis=1)
    return changed


@contextmanager
def _lock_store(store: Store) -> Iterator[None]:
    """Lock a store against updates by other processes."""
    try:
        import fcntl
    except ImportError:  # Windows has no such locks
        yield
        return
    folder = os.open(store.path, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)
