"""Updates: a map that follows changes of its workspace without a rebuild."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import BLOCKED, Bools, Ints, frozen, intersect_boxes
from cspace.check import check_cells
from cspace.engines.dilation import ClippedRuns, collide, to_three_axes
from cspace.engines.slices import Correlation, RasterGroups, group_rasters
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.limits import SCRATCH_BYTES
from cspace.map.contents import Contents
from cspace.map.exterior import Exterior
from cspace.map.storage import PackedStates
from cspace.obstacles import CellBox, Obstacle, ObstacleLayers
from cspace.raster import Raster
from cspace.shapes import Shape
from cspace.workspace import Workspace, copy_workspace

_NEVER: Final = 2**62
"""Minimum offset of a raster without cells; its negative is the maximum."""


@dataclass(frozen=True, slots=True)
class Update:
    """Result of :meth:`cspace.CSpace.update`.

    Attributes
    ----------
    occupied : int
        Number of workspace cells that changed.
    lower, upper : tuple of int
        Box of configuration cells that were computed again: its first cell, and the cell after its last one along each
        axis. They are equal if none was.
    changed : int
        Number of configuration cells, over all rotation cells, whose state changed.
    """

    occupied: int
    lower: tuple[int, ...]
    upper: tuple[int, ...]
    changed: int

    @classmethod
    def combine(cls, updates: Sequence[Update], dim: int) -> Update:
        """Combine updates of disjoint sets of workspace cells.

        The box is that around the boxes of all updates, and numbers are added.
        """
        computed = [each for each in updates if each.lower != each.upper]
        nowhere = [cls(0, (0,) * dim, (0,) * dim, 0)]
        lower = np.min([each.lower for each in computed or updates or nowhere], axis=0)
        upper = np.max([each.upper for each in computed or updates or nowhere], axis=0)
        occupied, changed = (sum(getattr(each, name) for each in updates) for name in ("occupied", "changed"))
        return cls(occupied, tuple(lower.tolist()), tuple(upper.tolist()), changed)


@dataclass(frozen=True, slots=True)
class Patch:
    """New cells of a box of the workspace.

    Attributes
    ----------
    lower : tuple of int
        First cell of the box.
    outer, inner : ndarray of bool
        Cells that meet an obstacle, and cells that lie in obstacles; one object if they are equal.
    unknown : ndarray of bool, or False
        Unknown cells.
    """

    lower: tuple[int, ...]
    outer: Bools
    inner: Bools
    unknown: Bools | bool = False

    @property
    def window(self) -> tuple[slice, ...]:
        """The box as slices."""
        return tuple(slice(low, low + size) for low, size in zip(self.lower, self.outer.shape, strict=True))

    @classmethod
    def of(cls, grid: Grid, cells: ArrayLike, lower: Sequence[int], inner: ArrayLike | None) -> Patch:
        """Check and copy the arguments of :meth:`cspace.CSpace.update`.

        Raises InputError if the cells or the position of the box are invalid.
        """
        outer = _copy_cells(cells, "cells")
        first = _check_first_cell(lower, grid.dim)
        if outer.ndim != grid.dim:
            problem = f"has {outer.ndim} axes but the grid has {grid.dim}"
            raise InputError("cells", problem, "they must agree", "pass one entry per cell of a box", value=cells)
        for low, count, size in zip(first, outer.shape, grid.shape, strict=True):
            if low < 0 or low + count > size:
                problem = f"has shape {outer.shape} and lower is {first} on a grid of {grid.shape} cells"
                raise InputError("cells", problem, "the box must lie in the grid", "clip it to the grid", value=cells)
        if inner is None:
            return cls(first, outer, outer)
        within = _copy_cells(inner, "inner")
        if within.shape != outer.shape:
            problem = f"has shape {within.shape} but cells has {outer.shape}"
            raise InputError("inner", problem, "they must be equal", "pass one entry per cell of the box", value=inner)
        if (within > outer).any():
            lost = tuple(np.argwhere(within & ~outer)[0].tolist())
            problem, rule = f"has entry {lost}, which is not in cells", "it must be a subset of cells"
            raise InputError("inner", problem, rule, "add it to cells", value=lost)
        return cls(first, outer, within)


def _copy_cells(values: ArrayLike, name: str) -> Bools:
    """Return a contiguous writable copy of cells.

    It holds only the bytes 0 and 1.
    """
    if type(values) is np.ndarray and values.dtype == np.bool_ and values.size and values.ndim in (2, 3):
        return np.not_equal(values, 0, order="C")  # a view as bool may hold other bytes than 0 and 1
    return np.array(check_cells(values, name))


def _check_first_cell(lower: Sequence[int], dim: int) -> tuple[int, ...]:
    """Return the index of a box's first cell as integers."""
    values: object = lower
    if isinstance(values, np.ndarray):
        values = values.tolist()
    try:
        first = tuple(operator.index(value) for value in values) if isinstance(values, Iterable) else ()
    except TypeError:
        first = ()
    if len(first) != dim:
        rule = f"it must be {dim} integers, the index of the first cell"
        raise InputError("lower", f"is {lower!r}", rule, "convert metres with space.grid.cell_of", value=lower)
    return first


@dataclass(frozen=True, slots=True)
class Change:
    """Changes that an update made to a map.

    A box is the first and the last cell along x, y and z; in the plane x is 0, and y and z are the two axes. It is
    empty if a first number is above the last.

    Attributes
    ----------
    workspace : Workspace
        The workspace after the update.
    layers : ObstacleLayers or None
        Base and named obstacles, if an obstacle was ever added.
    cells : ndarray of int64, shape (6,)
        Box around the workspace cells that changed.
    states : ndarray of int64, shape (slices, 6)
        Box around the states that changed, for each slice.
    changed : int
        Number of states that changed, over all rotation cells.
    """

    workspace: Workspace
    layers: ObstacleLayers | None
    cells: Ints
    states: Ints
    changed: int


class Updater:
    """Update a map in place when cells of its workspace change.

    The state of a cell depends on the workspace cells under the robot's rasters. So the cells of a slice that a changed
    box can reach form a window around it. The engine computes the window from the part of the workspace around it.

    Parameters
    ----------
    contents : Contents
        The map. Updates write into its states and overlaps, and into a copy of its workspace.
    rasters : sequence of (outer, inner) Raster
        The robot's rasters, for each slice.
    exterior : Exterior
        Updates write into its boxes.
    refresh : callable
        Called with each :class:`Change`, to refresh caches of the map; called again if it was interrupted.
    """

    def __init__(
        self,
        contents: Contents,
        rasters: Sequence[tuple[Raster, Raster]],
        exterior: Exterior,
        refresh: Callable[[Change], None],
    ) -> None:
        blocked, counts, shape = contents.proves_blocked, contents.overlap_counts is not None, contents.grid.shape
        self._grid, self._layers = contents.grid, contents.layers
        self._states, self._overlap_counts = contents.states, contents.overlap_counts
        self._rasters, self._exterior, self._refresh_map = rasters, exterior, refresh
        self._sides = group_rasters(rasters, _proves_blocked(contents, rasters) if blocked is None else blocked)
        self._engine = Correlation.create("fft" if counts else "direct", self._sides, contents.outside, None)
        self._reach = _reach(self._sides, shape, contents.outside == "blocked", counts)
        self._size = np.max([outer.cells.shape for outer, _ in rasters], axis=0)
        self._weights = np.bincount(contents.slice_of, minlength=len(contents.states))
        self._nowhere = np.array([*to_three_axes(shape), -1, -1, -1])
        self._workspace = copy_workspace(contents.workspace, live=True)
        self._layer_counts = _layer_counts(self._workspace.outer) if contents.outside == "free" else []

    def update(self, patch: Patch) -> Update:
        """Write a box of known cells into the base, and update the map.

        The *base* is the workspace without named obstacles. Its outer cells meet an obstacle, its inner cells lie in
        obstacles.
        """
        base = self._workspace if self._layers is None else self._layers
        pairs = zip((base.outer, base.inner), (patch.outer, patch.inner), strict=True)
        were_known = base.unknown is None or not base.unknown[patch.window].any()
        if were_known and all((old[patch.window] == new).all() for old, new in pairs):
            # Nothing changes, so the workspace keeps its shapes.
            return Update(0, patch.lower, patch.lower, 0)
        if self._layers is not None:
            # Named obstacles lie over the base, so the map gets the union of both.
            self._layers.write(patch.window, patch.outer, patch.inner)
            first = np.array(patch.lower)
            return self._copy_layers(self._layers, [(first, first + patch.outer.shape)])
        # Without named obstacles, the base is the workspace. Its shapes no longer describe its cells.
        self._set_shapes(None)
        update = self._write(patch)
        if not were_known:
            # Unknown cells became known, which caches must see even if no outer or inner cell changed.
            self._refresh_shapes()
        return update

    def set_obstacle(self, name: str, shape: Shape | None) -> Update:
        """Add, replace or remove a named obstacle, and update the map."""
        obstacle = None if shape is None else Obstacle.of(shape, self._grid)
        if self._layers is None:
            self._layers = _layers_of(self._workspace)
        boxes = self._layers.set_obstacle(name, obstacle)
        if len(boxes) == 2 and not self._are_apart(*boxes):
            (first, stop), (other_first, other_stop) = boxes
            boxes = [(np.minimum(first, other_first), np.maximum(stop, other_stop))]
        return self._copy_layers(self._layers, boxes)

    def _are_apart(self, box: CellBox, other: CellBox) -> bool:
        """Return True if two boxes are best changed separately.

        No configuration can touch both boxes, so that two changes cost less than one.
        """
        return bool((np.maximum(other[0] - box[1], box[0] - other[1]) >= self._size).any())

    def _copy_layers(self, layers: ObstacleLayers, boxes: Sequence[CellBox]) -> Update:
        """Copy boxes of cells from the layers.

        They are copied to the map, with all shapes.
        """
        self._set_shapes(layers.obstacles)
        patches = [Patch(tuple(first.tolist()), *layers.cells(first, stop)) for first, stop in boxes]
        try:
            updates = [self._write(patch) for patch in patches]
        except BaseException:  # Ctrl-C, too
            for patch in patches:
                self._write(patch)
            raise
        finally:
            self._refresh_shapes()
        return Update.combine(updates, len(layers.grid.shape))

    def _set_shapes(self, shapes: tuple[Shape, ...] | None) -> None:
        """Replace the shapes of the workspace."""
        object.__setattr__(self._workspace, "shapes", shapes)

    def _refresh_shapes(self) -> None:
        """Refresh caches of the workspace's shapes.

        Shapes and layers may change even if no cell does.
        """
        _complete(partial(self._refresh, self._nowhere, np.tile(self._nowhere, (len(self._weights), 1)), 0))

    def _refresh(self, cells: Ints, states: Ints, changed: int) -> None:
        """Refresh the caches of the map."""
        self._refresh_map(Change(self._workspace, self._layers, cells, states, changed))

    def _write(self, patch: Patch) -> Update:
        """Write a patch into the workspace, and update the map."""
        old, dim = self._workspace, len(patch.lower)
        differ = old.outer[patch.window] != patch.outer
        if old.inner is not old.outer or patch.inner is not patch.outer:
            differ |= old.inner[patch.window] != patch.inner
        occupied = int(np.count_nonzero(differ))
        if not occupied:
            self._write_cells(patch)  # unknown cells may change
            return Update(0, patch.lower, patch.lower, 0)
        box = self._boxes(differ[np.newaxis], patch.lower)[0]
        # Cell k depends on the cells k + m, where m is an offset of the robot.
        first = np.maximum(box[3 - dim : 3] - self._reach[:, 1], 0)
        stop = np.minimum(box[6 - dim :] - self._reach[:, 0] + 1, self._grid.shape)
        changes: list[tuple[Ints, Ints]] = []
        counts = self._count_layers(patch)
        _complete(partial(self._apply, patch, box, first, stop, counts, changes))
        used = (first < stop).all(axis=1)
        if not used.any():
            return Update(occupied, patch.lower, patch.lower, 0)
        lower, upper = first[used].min(axis=0), stop[used].max(axis=0)
        changed = int(self._weights @ np.concatenate([each for _, each in changes]))
        return Update(occupied, tuple(lower.tolist()), tuple(upper.tolist()), changed)

    def _apply(
        self, patch: Patch, box: Ints, first: Ints, stop: Ints, counts: list[Ints], changes: list[tuple[Ints, Ints]]
    ) -> None:
        """Update states, workspace and caches, in this order.

        A second call completes an interrupted one. Append to ``changes``, for each batch of slices, the boxes around
        the states that changed, and their numbers. If memory runs out in the first batch, the map stays unchanged.
        """
        used, cells = np.asarray((first < stop).all(axis=1)), self._grid.size
        if not isinstance(self._states, PackedStates) and used.any():
            cells = int(np.prod(stop[used].max(axis=0) - first[used].min(axis=0)))
        batch_size = max(1, SCRATCH_BYTES // cells)
        for index, start in enumerate(range(0, len(used), batch_size)):
            batch = slice(start, start + batch_size)
            self._update_slices(patch, batch, first[batch][used[batch]], stop[batch][used[batch]], changes, index)
        self._write_cells(patch)
        if counts:
            self._layer_counts = counts
            used_layers = [np.flatnonzero(each) for each in counts]
            dim, ends = len(counts), np.array([[each[0], each[-1]] if len(each) else [0, -1] for each in used_layers])
            around = Exterior.around(self._grid.shape, ends.T.reshape(2, dim), self._rasters, "free")
            self._exterior.boxes[...] = around.boxes
        boxes, changed = map(np.concatenate, zip(*changes, strict=True))
        self._refresh(box, boxes, int(self._weights @ changed))

    def _update_slices(
        self, patch: Patch, batch: slice, first: Ints, stop: Ints, changes: list[tuple[Ints, Ints]], index: int
    ) -> None:
        """Compute the states of a batch of slices again.

        The window around the boxes from ``first`` to ``stop`` (exclusive) is computed.
        """
        whole, reach = self._states[batch], self._reach[batch]
        if not len(first):
            if index == len(changes):
                changes.append((np.tile(self._nowhere, (len(whole), 1)), np.zeros(len(whole), dtype=np.int64)))
            return
        low, high = first.min(axis=0), stop.max(axis=0)
        begin = np.maximum(low + reach[:, 0].min(axis=0), 0)
        end = np.minimum(high + reach[:, 1].max(axis=0), self._grid.shape)
        outer, inner = self._cells_after(patch, tuple(map(slice, begin.tolist(), end.tolist())))
        sides = [[raster.translate((low - begin).tolist()) for raster in side[batch]] for side in self._sides]
        window = (slice(None), *map(slice, low.tolist(), high.tolist()))
        old = whole[window]
        states = np.empty(old.shape, dtype=np.uint8)
        overlaps = None if self._overlap_counts is None else np.empty(old.shape, dtype=np.int32)
        self._engine.fill(outer, inner, sides, states, overlaps)
        differ = old != states
        changed = np.count_nonzero(differ, axis=tuple(range(1, differ.ndim)))
        if index == len(changes):
            changes.append((self._boxes(differ, low), changed))
        old[...] = states
        if isinstance(self._states, PackedStates):  # slicing them made a copy
            for k in np.flatnonzero(changed).tolist():
                self._states.write(batch.start + k, whole[k])
        if self._overlap_counts is not None and overlaps is not None:
            self._overlap_counts[batch][window] = overlaps

    def _boxes(self, differ: Bools, lower: Sequence[int] | Ints) -> Ints:
        """Return the bounding box of set cells.

        There is one for each window, shape (n, 6), as in :class:`Change`. ``differ`` has shape (n, ...), and each
        window begins at cell ``lower``. A plane has no x, so its x stays 0. A window without set cells gets an empty
        box.
        """
        front, axes = 3 - (differ.ndim - 1), range(1, differ.ndim)
        boxes = np.zeros((len(differ), 6), dtype=np.int64)
        for axis, low in zip(axes, lower, strict=True):
            used = np.asarray(differ.any(axis=tuple(other for other in axes if other != axis)))
            boxes[:, front + axis - 1] = low + used.argmax(axis=1)
            boxes[:, front + axis + 2] = low + used.shape[1] - 1 - used[:, ::-1].argmax(axis=1)
        boxes[~used.any(axis=1)] = self._nowhere
        return boxes

    def _cells_after(self, patch: Patch, window: tuple[slice, ...]) -> tuple[Bools, Bools]:
        """Return a window of the workspace with the patch.

        Inner and outer cells are one array if they are equal.
        """
        here, there = intersect_boxes(window, patch.window)
        outer, inner = self._workspace.outer[window].copy(), self._workspace.inner
        inner = outer if self._are_same(patch) else inner[window].copy()
        inner[here] = patch.inner[there]
        outer[here] = patch.outer[there]
        return outer, inner

    def _are_same(self, patch: Patch) -> bool:
        """Return True if inner and outer cells stay equal.

        They are one array, and the patch does not change that.
        """
        return self._workspace.inner is self._workspace.outer and (
            patch.inner is patch.outer or np.array_equal(patch.inner, patch.outer)
        )

    def _write_cells(self, patch: Patch) -> None:
        """Write a patch into the workspace.

        Inner and outer cells become two arrays when they first differ.
        """
        old, window = self._workspace, patch.window
        if old.inner is old.outer and not self._are_same(patch):
            outer, inner = old.outer.copy(), old.outer.copy()
            outer[window], inner[window] = patch.outer, patch.inner
            parts = frozen(outer), frozen(inner), old.source, old.unknown, old.shapes
            self._workspace = Workspace(old.grid, *parts, live=True)
        else:
            _overwrite(old.outer, window, patch.outer)
            if old.inner is not old.outer:
                _overwrite(old.inner, window, patch.inner)
        if self._workspace.unknown is not None:
            _overwrite(self._workspace.unknown, window, patch.unknown)

    def _count_layers(self, patch: Patch) -> list[Ints]:
        """Count the outer cells in each layer.

        Layers lie along each axis, with the patch. The result is empty if unused.
        """
        if not self._layer_counts:
            return []
        counts = [each.copy() for each in self._layer_counts]
        before, after = (_layer_counts(each) for each in (self._workspace.outer[patch.window], patch.outer))
        for count, part, old, new in zip(counts, patch.window, before, after, strict=True):
            count[part] += new - old
        return counts


def _complete(work: Callable[[], None]) -> None:
    """Call ``work``, and again if it was interrupted.

    It must not stay half done.
    """
    try:
        work()
    except BaseException:  # Ctrl-C, too
        work()
        raise


def _overwrite(array: Bools, window: tuple[slice, ...], values: Bools | bool) -> None:
    """Write to an array that is read-only for users."""
    array.setflags(write=True)
    array[window] = values
    array.setflags(write=False)


def _layers_of(workspace: Workspace) -> ObstacleLayers:
    """Return layers with the workspace as their base, without named obstacles."""
    unknown = None if workspace.unknown is None else workspace.unknown.copy()
    return ObstacleLayers(workspace.grid, workspace.outer.copy(), workspace.inner.copy(), unknown, workspace.shapes)


def _layer_counts(cells: Bools) -> list[Ints]:
    """Count the set cells in each layer along each axis."""
    axes = set(range(cells.ndim))
    return [np.count_nonzero(cells, axis=tuple(axes - {axis})) for axis in sorted(axes)]


def _reach(sides: RasterGroups, shape: Sequence[int], exterior_blocked: bool, counts: bool) -> Ints:
    """Return the range of cells that decide a state.

    It is the minimum and maximum offset, shape (slices, 2, d). Without counts, a robot that touches the blocked
    exterior from everywhere depends on no cell.
    """
    reach = np.empty((len(sides), len(sides[0]), 2, 3), dtype=np.int64)
    reach[:, :, 0], reach[:, :, 1] = _NEVER, -_NEVER
    for number, side in enumerate(sides):
        for row, runs in zip(reach[number], ClippedRuns.of(side, to_three_axes(shape)), strict=True):
            if len(runs.table) and not (runs.clipped and exterior_blocked and not (counts and number == 0)):
                last = runs.table[:, :3].copy()
                last[:, 2] += runs.table[:, 3] - 1
                row[:] = runs.table[:, :3].min(axis=0), last.max(axis=0)
    dim = len(shape)
    return np.stack([reach[:, :, 0].min(axis=0), reach[:, :, 1].max(axis=0)], axis=1)[..., 3 - dim :]


def _proves_blocked(contents: Contents, rasters: Sequence[tuple[Raster, Raster]]) -> bool:
    """Return True if the map has proofs of BLOCKED.

    It is False if the states show that the map was built without ``inner``.
    """
    workspace = contents.workspace
    if any(bool((part == BLOCKED).any()) for part in contents.states):
        return True
    lies_in = np.empty(workspace.inner.shape, dtype=np.bool_)
    for _, inner in rasters:
        collide(workspace.inner, [inner], [lies_in], outside=contents.outside == "blocked")
        if lies_in.any():
            return False
    return True
