"""Updates: a map that follows changes of its workspace without a rebuild."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Bools, Bytes, Ints
from cspace.changes import (
    CHANGED,
    COUNT,
    LOOKED,
    ROW,
    MapArrays,
    Notes,
    Robots,
    extents,
    renew,
)
from cspace.engines.dilation import FOUR, WORD, Runs, collide, in_space
from cspace.errors import InputError
from cspace.grid import Grid, check_cells
from cspace.map.contents import Contents
from cspace.map.exterior import Exterior, reached
from cspace.map.storage import PackedStates
from cspace.obstacles import Box, Obstacle, ObstacleLayers
from cspace.raster import Raster
from cspace.shapes import Shape
from cspace.states import BLOCKED
from cspace.workspace import Workspace, copied

BATCH: Final = 64
"""Slices of states in two bits that are made bytes together."""

_NOWHERE: Final = np.array([1, 1, 1, 0, 0, 0])
_NO_OVERLAPS: Final = np.empty((0, 0, 0, 0), dtype=np.int32)


@dataclass(frozen=True, slots=True)
class Update:
    """What :meth:`cspace.CSpace.update` did.

    Attributes
    ----------
    occupied : int
        Number of workspace cells that differ from what they were.
    lower, upper : tuple of int
        The box of cells of configurations, in any rotation cell, that were computed again: its first cell, and the
        first one after it along each axis. Equal where nothing had to be.
    changed : int
        Number of cells of configurations, over all rotation cells, whose state is another now.
    """

    occupied: int
    lower: tuple[int, ...]
    upper: tuple[int, ...]
    changed: int

    @classmethod
    def of(cls, updates: Sequence[Update], dim: int) -> Update:
        """Several in one, of cells of configurations that none has in common with another."""
        looked = [each for each in updates if each.lower != each.upper]
        nowhere = [cls(0, (0,) * dim, (0,) * dim, 0)]
        lower = np.min([each.lower for each in looked or updates or nowhere], axis=0)
        upper = np.max([each.upper for each in looked or updates or nowhere], axis=0)
        occupied, changed = (sum(getattr(each, name) for each in updates) for name in ("occupied", "changed"))
        return cls(occupied, tuple(lower.tolist()), tuple(upper.tolist()), changed)


@dataclass(frozen=True, slots=True)
class Patch:
    """What a box of workspace cells holds from now on.

    Attributes
    ----------
    lower : tuple of int
        Its first cell.
    outer, inner : ndarray of bool
        Its cells that meet an obstacle, and those that lie in obstacles; the same object where both are the same.
    unknown : ndarray of bool, or False
        Its unknown cells.
    """

    lower: tuple[int, ...]
    outer: Bools
    inner: Bools
    unknown: Bools | bool = False

    @property
    def window(self) -> tuple[slice, ...]:
        """The box."""
        return tuple(slice(low, low + size) for low, size in zip(self.lower, self.outer.shape, strict=True))

    @classmethod
    def of(cls, grid: Grid, cells: ArrayLike, lower: Sequence[int], inner: ArrayLike | None) -> Patch:
        """Check what was passed to an update of a map on a grid; the arrays are copied.

        Raises InputError if the cells or their place are not as :meth:`cspace.CSpace.update` states.
        """
        outer = _cells(cells, "cells")
        first = _first(lower, grid.dim)
        if outer.ndim != grid.dim:
            fault = f"has {outer.ndim} axes on a grid of {grid.dim}"
            mend = "pass one entry for each cell of a box, indexed in the order of the coordinates"
            raise InputError("cells", fault, "both must have as many", mend, value=cells)
        for low, count, size in zip(first, outer.shape, grid.shape, strict=True):
            if low < 0 or low + count > size:
                fault = f"has shape {outer.shape} and lower is {first} on a grid of {grid.shape} cells"
                raise InputError(
                    "cells", fault, "the box must lie in the grid", "cut off what lies outside it", value=cells
                )
        if inner is None:
            return cls(first, outer, outer)
        within = _cells(inner, "inner")
        if within.shape != outer.shape:
            fault = f"has shape {within.shape} and cells {outer.shape}"
            mend = "pass one entry for each cell of the box"
            raise InputError("inner", fault, "both must be the same", mend, value=inner)
        if (within > outer).any():
            lost = tuple(np.argwhere(within & ~outer)[0].tolist())
            rule = "a cell that lies in an obstacle also meets it"
            raise InputError("inner", f"has entry {lost}, which is not in cells", rule, "add it to cells", value=lost)
        return cls(first, outer, within)


def _cells(values: ArrayLike, name: str) -> Bools:
    """A copy in one piece, of zeros and ones, that may be written."""
    if type(values) is np.ndarray and values.dtype == np.bool_ and values.size and values.ndim in (2, 3):
        return np.not_equal(values, 0, order="C")  # a boolean array may hold other bytes than 0 and 1
    return np.array(check_cells(values, name))


def _first(lower: Sequence[int], dim: int) -> tuple[int, ...]:
    values: object = lower
    if isinstance(values, np.ndarray):
        values = values.tolist()
    try:
        first = tuple(operator.index(value) for value in values) if isinstance(values, Iterable) else ()
    except TypeError:
        first = ()
    if len(first) != dim:
        rule = f"it must hold {dim} whole numbers, the index of the box's first cell"
        raise InputError("lower", f"is {lower!r}", rule, "from metres, ask space.grid.cell_of", value=lower)
    return first


@dataclass(frozen=True, slots=True)
class Change:
    """What an update of the workspace did to a map.

    Boxes hold the first and the last cell along x, y and z, six numbers; in the plane x is 0, and y and z stand for the
    two axes. A box is empty where a first number is above the last.

    Attributes
    ----------
    workspace : Workspace
        As it is now.
    layers : ObstacleLayers or None
        What its cells come from, where obstacles were placed.
    cells : ndarray of int64, shape (6,)
        The box around the workspace cells that differ.
    states : ndarray of int64, shape (slices, 6)
        Of each slice, the box around the states that differ.
    changed : int
        Number of states that differ, over all rotation cells.
    """

    workspace: Workspace
    layers: ObstacleLayers | None
    cells: Ints
    states: Ints
    changed: int


class Updater:
    """What changes a map with its workspace, of which it makes a copy.

    Every cell of configurations from which some offset of the robot can fall on a changed cell is decided afresh, by
    the direct engine's dilation of the part of the workspace around. No other cell can change.

    Parameters
    ----------
    contents : Contents
        As they are before the first update; their states and overlaps are written to.
    rasters : sequence of (outer, inner) Raster
        The robot's, for each slice.
    exterior : Exterior
    renew : callable
        Called with each change, to bring up to date what depends on the map; again if it was interrupted.
    """

    def __init__(
        self,
        contents: Contents,
        rasters: Sequence[tuple[Raster, Raster]],
        exterior: Exterior,
        renew: Callable[[Change], None],
    ) -> None:
        walled = contents.outside == "blocked"
        workspace, shape, blocked = contents.workspace, contents.grid.shape, contents.proves_blocked
        self._grid, self._endless, self._flat = contents.grid, contents.endless, (1,) * (3 - len(shape))
        self._rasters, self._exterior, self._renew_map = rasters, exterior, renew
        self._shape = (*self._flat, *shape)
        self._packed, states = None, np.empty((0, *self._shape), dtype=np.uint8)
        if isinstance(contents.states, PackedStates):
            self._packed = contents.states
        else:
            states = contents.states.reshape(-1, *self._shape)
        own = copied(workspace, live=True)
        outer, inner = _writable(own, self._shape)
        self._map = MapArrays(
            states,
            _NO_OVERLAPS if contents.overlaps is None else contents.overlaps.reshape(states.shape),
            outer,
            inner,
            np.empty(0, dtype=np.int64) if walled else _tallies(outer),
            _robots([outer for outer, _ in rasters], self._shape, walled),
            _robots([inner for _, inner in rasters], self._shape, walled),
            np.bincount(contents.slice_of, minlength=len(contents.states)),
            inner is outer,
            _proves_blocked(contents, rasters) if blocked is None else blocked,
            walled,
        )
        self._row = np.array([*self._shape, -1, -1, -1, *self._shape, -1, -1, -1, 0])
        self._spans, self._most = _spans(self._map.far, self._map.near)
        self._workspace, self._layers = own, contents.layers
        self._reach = np.max([outer.cells.shape for outer, _ in rasters], axis=0)

    def update(self, patch: Patch) -> Update:
        """Write a patch into the cells that stay, and bring all that the map holds up to date."""
        stays = self._workspace if self._layers is None else self._layers
        same = zip((stays.outer, stays.inner), (patch.outer, patch.inner), strict=True)
        known = stays.unknown is None or not stays.unknown[patch.window].any()
        if known and all((old[patch.window] == new).all() for old, new in same):
            return Update(0, patch.lower, patch.lower, 0)
        if self._layers is not None:
            self._layers.write(patch.window, patch.outer, patch.inner)
            first = np.array(patch.lower)
            return self._follow_layers(self._layers, [(first, first + patch.outer.shape)])
        self._show(None)
        update = self._write(patch)
        if not known:
            self._renew_shown()
        return update

    def place(self, name: str, shape: Shape | None) -> Update:
        """Place an obstacle of a name, in place of the one that had it, or take that away; nothing else changes."""
        placed = None if shape is None else Obstacle.of(shape, self._grid, self._endless)
        if self._layers is None:
            self._layers = _still(self._workspace)
        boxes = self._layers.put(name, placed)
        if len(boxes) == 2 and not self._are_apart(*boxes):
            (one, two), (three, four) = boxes
            boxes = [(np.minimum(one, three), np.maximum(two, four))]
        return self._follow_layers(self._layers, boxes)

    def _are_apart(self, box: Box, other: Box) -> bool:
        """Whether no configuration can touch both boxes of cells, so that two changes look at less than one."""
        return bool((np.maximum(other[0] - box[1], box[0] - other[1]) >= self._reach).any())

    def _follow_layers(self, layers: ObstacleLayers, boxes: Sequence[Box]) -> Update:
        """Have the map show boxes of cells as the layers have them, one after the other, and all their shapes."""
        self._show(layers.obstacles)
        patches = [Patch(tuple(first.tolist()), *layers.cells(first, stop)) for first, stop in boxes]
        try:
            updates = [self._write(patch) for patch in patches]
        except BaseException:  # Ctrl-C, too
            for patch in patches:
                self._write(patch)
            raise
        finally:
            self._renew_shown()
        return Update.of(updates, len(layers.grid.shape))

    def _show(self, shapes: tuple[Shape, ...] | None) -> None:
        """Have the workspace, which follows all changes, show other shapes."""
        object.__setattr__(self._workspace, "shapes", shapes)

    def _write(self, patch: Patch) -> Update:
        """Write a patch into the workspace, and bring all that the map holds up to date."""
        if self._map.one and patch.inner is not patch.outer:
            self._part(patch)
        if (unknown := self._workspace.unknown) is not None:
            unknown.setflags(write=True)
            unknown[patch.window] = patch.unknown
            unknown.setflags(write=False)
        low = np.array([*(0,) * len(self._flat), *patch.lower], dtype=np.int64)
        outer = patch.outer.view(np.uint8).reshape(*self._flat, *patch.outer.shape)
        inner = patch.inner.view(np.uint8).reshape(outer.shape)
        if self._packed is None:
            notes = self._notes(outer.shape)
            renew(self._map, outer, inner, low, notes)
            changed, renewed = notes.changed, notes.rows
            self._follow(changed, renewed)
        else:
            with ThreadPoolExecutor(1) as pool:  # where no interrupt gets
                work = pool.submit(self._renew_packed, self._packed, outer, inner, low)
                try:
                    wait([work])
                finally:
                    changed, renewed = work.result()
                    self._follow(changed, renewed)
        if not changed[6]:
            return Update(0, patch.lower, patch.lower, 0)
        whole, dim = renewed[-1].tolist(), len(patch.lower)
        first, last = whole[LOOKED + 3 - dim : LOOKED + 3], whole[LOOKED + 6 - dim : LOOKED + 6]
        if first[0] > last[0]:
            return Update(int(changed[6]), patch.lower, patch.lower, 0)
        return Update(int(changed[6]), tuple(first), tuple(n + 1 for n in last), whole[COUNT])

    def _renew_packed(self, packed: PackedStates, outer: Bytes, inner: Bytes, low: Ints) -> tuple[Ints, Ints]:
        """What :func:`cspace.changes.renew` does, with states in two bits: slices become bytes in batches."""
        map_, notes, rows, whole = self._map, self._notes(outer.shape), [], np.zeros((0, ROW), dtype=np.int64)
        renew(map_, outer, inner, low, notes)
        for start in range(0, len(packed) if notes.changed[6] else 0, BATCH):
            stop = min(start + BATCH, len(packed))
            states = packed[start:stop].reshape(-1, *self._shape)
            far, near = map_.far.of(start, stop), map_.near.of(start, stop)
            part = map_._replace(states=states, far=far, near=near, weights=map_.weights[start:stop])
            renewed = self._rows(len(states))
            renew(part, outer[:0], inner[:0], low, notes._replace(rows=renewed))
            for number in np.flatnonzero(renewed[:-1, COUNT]).tolist():
                packed.write(start + number, states[number])
            rows.append(renewed[:-1])
            whole = np.concatenate([whole, renewed[-1:]])
        least, most = whole.min(axis=0, initial=2**62), whole.max(axis=0, initial=-1)
        for first in (LOOKED, CHANGED):
            least[first + 3 : first + 6] = most[first + 3 : first + 6]
        least[COUNT] = whole[:, COUNT].sum()
        return notes.changed, np.concatenate([*rows, least[None]])

    def _notes(self, patch: tuple[int, ...]) -> Notes:
        """Room for what an update by a patch of a shape says of itself, and for what it needs for that."""
        counts = [min(cells, size + span) for cells, size, span in zip(self._shape, patch, self._spans, strict=True)]
        layers, tall, bits = (count + span for count, span in zip(counts, self._spans, strict=True))
        wide = (bits + WORD - 1) // WORD
        return Notes(
            self._row[CHANGED:].copy(),
            self._rows(len(self._map.states)),
            np.empty(6, dtype=np.int64),
            np.empty((*patch[:2], patch[2] + 1) if self._map.overlaps.size else (0, 0, 0), dtype=np.int64),
            np.empty((5, layers * tall * wide + 2 * wide + 3), dtype=np.uint64),
            np.empty((self._most, 1 + 2 * FOUR), dtype=np.uint64),
        )

    def _rows(self, slices: int) -> Ints:
        """Rows of slices, and one of all of them, of which nothing has changed."""
        rows = np.empty((slices + 1, ROW), dtype=np.int64)
        rows[:] = self._row
        return rows

    def _follow(self, changed: Ints, renewed: Ints) -> None:
        """Have all that depends on the map follow the changed cells and the renewed states."""
        if changed[6]:
            self._renew(changed[:6], renewed[:-1, CHANGED : CHANGED + 6], int(renewed[-1, COUNT]))

    def _renew(self, box: Ints, states: Ints, changed: int) -> None:
        """Have all that depends on the map follow the change."""
        change = Change(self._workspace, self._layers, box, states, changed)
        try:
            self._renew_parts(change)
        except BaseException:  # Ctrl-C, too: what was begun has to be done, and may be done again
            self._renew_parts(change)
            raise

    def _renew_shown(self) -> None:
        """The same of what the workspace shows, which may be another where no cell is."""
        self._renew(_NOWHERE, np.tile(_NOWHERE, (len(self._map.weights), 1)), 0)

    def _renew_parts(self, change: Change) -> None:
        if not self._map.walled:
            self._move_border()
        self._renew_map(change)

    def _part(self, patch: Patch) -> None:
        """Give the inner cells an array of their own, where a patch makes them differ from the outer ones."""
        if np.array_equal(patch.outer, patch.inner):
            return
        window, old = patch.window, self._workspace
        outer, inner = old.outer.copy(), old.outer.copy()
        outer[window], inner[window] = patch.outer, patch.inner
        self._workspace = Workspace(old.grid, outer, inner, old.source, old.unknown, old.shapes, live=True)
        views = _writable(self._workspace, self._shape)
        for cells in views:  # the patch itself is still to come
            cells.reshape(old.grid.shape)[window] = old.outer[window]
        self._map = self._map._replace(outer=views[0], inner=views[1], one=False)

    def _move_border(self) -> None:
        """Bring up to date what is known outside the grid, where all outside the workspace is free."""
        dim = 3 - len(self._flat)
        layers = np.empty(6, dtype=np.int64)
        extents(self._map.tallies, np.array(self._shape, dtype=np.int64), layers)
        changed = layers.reshape(2, 3)[:, -dim:]
        obstacles = np.repeat([0, -1], dim) if (changed[0] > changed[1]).any() else changed.ravel()
        self._exterior.boxes[...] = [reached(obstacles, outer) for outer, _ in self._rasters]


def _still(workspace: Workspace) -> ObstacleLayers:
    """A workspace that stays, with nothing placed in it."""
    unknown = None if workspace.unknown is None else workspace.unknown.copy()
    return ObstacleLayers(workspace.grid, workspace.outer.copy(), workspace.inner.copy(), unknown, workspace.shapes)


def _writable(workspace: Workspace, shape: tuple[int, ...]) -> tuple[Bytes, Bytes]:
    """Views of a workspace's outer and inner cells that may be written; they themselves stay read-only."""

    def view(cells: Bools) -> Bytes:
        cells.setflags(write=True)
        written = cells.view(np.uint8).reshape(shape)
        cells.setflags(write=False)
        return written

    outer = view(workspace.outer)
    return outer, outer if workspace.inner is workspace.outer else view(workspace.inner)


def _tallies(outer: Bytes) -> Ints:
    """Numbers of cells in each layer along each axis, one axis after the other."""
    axes = {0, 1, 2}
    return np.concatenate([outer.sum(axis=tuple(axes - {axis}), dtype=np.int64) for axis in axes])


def _robots(rasters: Sequence[Raster], shape: tuple[int, ...], walled: bool) -> Robots:
    """The offsets of rasters, one for each slice, on a map of a shape of three axes."""
    runs = Runs.of(rasters, in_space(shape))
    rows, fours = [each.table[each.news] for each in runs], [each.table for each in runs]
    return Robots(
        np.concatenate(rows),
        np.cumsum([len(part) for part in rows]),
        np.concatenate(fours),
        np.cumsum([len(part) for part in fours]),
        np.array([each.clipped and walled for each in runs]),
    )


def _spans(*robots: Robots) -> tuple[list[int], int]:
    """How far apart offsets of a slice lie along each axis at most, and its number of rows of four."""
    runs = np.concatenate([each.runs for each in robots])
    first, last = runs[:, :3], runs[:, :3].copy()
    last[:, 2] += runs[:, 3] - 1
    fours = [np.diff(each.fours_stops, prepend=0).max() for each in robots]
    return (last.max(axis=0, initial=0) - first.min(axis=0, initial=0)).tolist(), int(max(fours)) // FOUR


def _proves_blocked(contents: Contents, rasters: Sequence[tuple[Raster, Raster]]) -> bool:
    """Whether a map proves BLOCKED: unless it shows that it was built without ``inner``."""
    workspace = contents.workspace
    if any(bool((part == BLOCKED).any()) for part in contents.states):
        return True
    lies_in = np.empty(workspace.inner.shape, dtype=np.bool_)
    for _, inner in rasters:
        collide(workspace.inner, [inner], [lies_in], outside=contents.outside == "blocked")
        if lies_in.any():
            return False
    return True
