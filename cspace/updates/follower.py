"""Follower: a map and its own copy of the workspace, kept up to date as cells change."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cspace.map.exterior import reached
from cspace.map.kept import Change
from cspace.states import BLOCKED, FREE
from cspace.updates import _kernels
from cspace.updates.outcome import Update
from cspace.updates.patch import Patch
from cspace.updates.robots import Robots
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from cspace.space import CSpace

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

_NO_OVERLAPS: Final = np.empty((0, 0, 0, 0), dtype=np.int32)


class Follower:
    """What the updates of one map need, made at the first of them; the map's workspace is copied.

    Every cell of configurations from which some offset of the robot can fall on a changed cell is decided afresh, by
    the direct engine's dilation (:mod:`cspace.bits`) of the part of the workspace around. No other cell can change.

    Parameters
    ----------
    space : CSpace
    """

    def __init__(self, space: CSpace) -> None:
        old, shape = space.workspace, space.grid.shape
        self._space, self._flat = space, (1,) * (3 - len(shape))
        self._shape = (*self._flat, *shape)
        rasters = space._rasters
        self._far = Robots.of([outer for outer, _ in rasters], self._shape)
        self._near = Robots.of([inner for _, inner in rasters], self._shape)
        self._walled = space.outside == "blocked"
        self._fixed = (np.stack([self._far.beyond, self._near.beyond], axis=1) & self._walled).astype(np.uint8)
        self._blocked = _proves_blocked(space) if space.tells_blocked is None else space.tells_blocked
        self._states = space._states.reshape(-1, *self._shape)
        self._overlaps = _NO_OVERLAPS if space._counts is None else space._counts.reshape(self._states.shape)
        self._weights = np.bincount(space.slice_of, minlength=len(self._states))
        self._free = np.array([np.count_nonzero(part == FREE) for part in self._states])
        self._adopt(Workspace(old.grid, old.outer, old.inner, source=old.source, live=True))
        self._tallies = np.empty(0, dtype=np.int64)
        if not self._walled:
            axes = {0, 1, 2}
            self._tallies = np.concatenate(
                [self._outer.sum(axis=tuple(axes - {axis}), dtype=np.int64) for axis in axes]
            )

    def update(self, patch: Patch) -> Update:
        """Write a patch into the workspace, and bring all that the map holds up to date."""
        return self._update(patch)

    def _update(self, patch: Patch) -> Update:
        if self._inner is self._outer and patch.inner is not patch.outer:
            self._part(patch)
        low = np.array([*(0,) * len(self._flat), *patch.lower], dtype=np.int64)
        new_outer = patch.outer.view(np.uint8).reshape(*self._flat, *patch.outer.shape)
        new_inner = patch.inner.view(np.uint8).reshape(new_outer.shape)
        far, near = self._far, self._near
        found, told = _kernels.renew(
            self._states,
            self._overlaps,
            self._outer,
            self._inner,
            self._inner is self._outer,
            new_outer,
            new_inner,
            low,
            self._tallies,
            far.runs,
            far.ends,
            far.fours,
            far.fours_ends,
            near.fours,
            near.fours_ends,
            self._fixed,
            self._weights,
            self._blocked,
            self._walled,
        )
        if not found[6]:
            return Update(0, patch.lower, patch.lower, 0)
        each, whole = told[:-1], told[-1].tolist()
        self._free += each[:, _kernels.COUNTS + 1]
        changed = bool(whole[_kernels.COUNTS])
        try:
            self._keep(found[:6], each, changed)
        except BaseException:  # Ctrl-C, too: what was begun has to be done, and may be done again
            self._keep(found[:6], each, changed, again=True)
            raise
        start, dim = _kernels.LOOKED, len(patch.lower)
        first, last = whole[start + 3 - dim : start + 3], whole[start + 6 - dim : start + 6]
        if first[0] > last[0]:
            return Update(int(found[6]), patch.lower, patch.lower, 0)
        return Update(int(found[6]), tuple(first), tuple(n + 1 for n in last), whole[_kernels.COUNTS])

    def _keep(self, box: Ints, told: Ints, changed: bool, again: bool = False) -> None:
        """Bring up to date what hangs on the cells and, where some have ``changed``, on the states."""
        moved = not self._walled and (self._move_border() or again)
        looked, states, freed = (
            told[:, first : first + 6] for first in (_kernels.LOOKED, _kernels.CHANGED, _kernels.FREED)
        )
        number = int(changed)
        self._space._renew(Change(self.workspace, box, looked, states, freed, self._free.copy(), number, moved))

    def _adopt(self, workspace: Workspace) -> None:
        """Keep a workspace, whose cells belong to this map alone, and write through views of them."""
        self.workspace = workspace
        self._outer = _writable(workspace.outer, self._shape)
        one = workspace.inner is workspace.outer
        self._inner = self._outer if one else _writable(workspace.inner, self._shape)

    def _part(self, patch: Patch) -> None:
        """Give the inner cells an array of their own, where a patch makes them differ from the outer ones."""
        window = tuple(slice(low, low + size) for low, size in zip(patch.lower, patch.outer.shape, strict=True))
        old = self.workspace
        outer, inner = old.outer.copy(), old.outer.copy()
        outer[window], inner[window] = patch.outer, patch.inner
        if np.array_equal(outer[window], inner[window]):
            return
        self._adopt(Workspace(old.grid, outer, inner, source=old.source, live=True))
        for cells in (self._outer, self._inner):  # the patch itself is still to come
            cells.reshape(old.grid.shape)[window] = old.outer[window]

    def _move_border(self) -> bool:
        """What is known outside the grid, where all beyond the workspace is free; whether it is another now."""
        space, dim = self._space, 3 - len(self._flat)
        found = _kernels.extents(self._tallies, np.array(self._shape, dtype=np.int64)).reshape(2, 3)[:, -dim:].ravel()
        if (found.reshape(2, dim)[0] > found.reshape(2, dim)[1]).any():
            found = np.repeat([0, -1], dim)
        boxes = np.array([reached(found, outer) for outer, _ in space._rasters])
        if np.array_equal(boxes, space._exterior.boxes):
            return False
        space._exterior.boxes[...] = boxes
        return True


def _writable(cells: NDArray[np.bool_], shape: tuple[int, ...]) -> Bytes:
    """A view of a workspace's own cells that may be written; they themselves stay read-only."""
    cells.setflags(write=True)
    view = cells.view(np.uint8).reshape(shape)
    cells.setflags(write=False)
    return view


def _proves_blocked(space: CSpace) -> bool:
    """Whether a map tells BLOCKED from MIXED: unless it shows that it was built without ``inner``."""
    from cspace.engines.dilation import collide

    if any(bool((part == BLOCKED).any()) for part in space.stack):
        return True
    walled, inner = space.outside == "blocked", space.workspace.inner
    lies_in = np.empty(inner.shape, dtype=np.bool_)
    for _, near in space._rasters:
        collide(inner, [near], [lies_in], outside=walled)
        if lies_in.any():
            return False
    return True
