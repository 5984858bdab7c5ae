"""Updates: a map that follows changes of its workspace without a rebuild."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace._engines import dilation
from cspace._engines.dilation import ClippedRuns, to_three_axes
from cspace._engines.slices import RasterGroups, fill_states, group_rasters
from cspace._grid import Grid
from cspace._obstacles import CellBox, Obstacle, ObstacleLayers
from cspace._raster import Raster
from cspace._record.contents import Contents
from cspace._record.exterior import Exterior
from cspace._shapes import Shape
from cspace._support.arrays import Bools, Bytes, Ints, frozen, intersect_boxes
from cspace._support.check import check_cells
from cspace._workspace import Workspace, copy_workspace
from cspace.errors import InputError

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
        Box of configuration cells that were computed again: its first cell, and the cell after its
        last one along each axis. They are equal if none was.
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
        nothing = cls(0, (0,) * dim, (0,) * dim, 0)
        with_box = [update for update in updates if update.lower != update.upper]
        boxes = with_box or updates or [nothing]
        lower = np.min([update.lower for update in boxes], axis=0)
        upper = np.max([update.upper for update in boxes], axis=0)
        occupied = sum(update.occupied for update in updates)
        changed = sum(update.changed for update in updates)
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
        return tuple(map(slice, self.lower, np.add(self.lower, self.outer.shape).tolist()))

    @classmethod
    def of(
        cls, grid: Grid, cells: ArrayLike, lower: Sequence[int], inner: ArrayLike | None
    ) -> Patch:
        """Check and copy the arguments of :meth:`cspace.CSpace.update`.

        Raises InputError if the cells or the position of the box are invalid.
        """
        # Check the box first, then the optional inner cells.
        outer = _copy_cells(cells, "cells")
        first = _check_first_cell(lower, grid.dim)
        hint = "pass one entry per cell of the box"
        if outer.ndim != grid.dim:
            problem = f"has {outer.ndim} axes but the grid has {grid.dim}"
            raise InputError("cells", problem, "they must agree", hint)
        stop = np.add(first, outer.shape)
        if min(first) < 0 or (stop > grid.shape).any():
            problem = f"has shape {outer.shape} and lower is {first} on a grid of {grid.shape}"
            rule = "the box must lie in the grid"
            raise InputError("cells", f"{problem} cells", rule, "clip it to the grid")
        if inner is None:
            return cls(first, outer, outer)
        inside = _copy_cells(inner, "inner")
        if inside.shape != outer.shape:
            problem = f"has shape {inside.shape} but cells has {outer.shape}"
            raise InputError("inner", problem, "they must be equal", hint)
        not_outer = np.argwhere(inside & ~outer)
        if len(not_outer):
            entry = tuple(not_outer[0].tolist())
            problem = f"has entry {entry}, which is not in cells"
            rule = "it must be a subset of cells"
            raise InputError("inner", problem, rule, "add it to cells")
        return cls(first, outer, inside)


def _copy_cells(values: ArrayLike, name: str) -> Bools:
    """Return a contiguous writable copy of cells."""
    return np.array(check_cells(values, name), order="C")


def _check_first_cell(lower: Sequence[int], dim: int) -> tuple[int, ...]:
    """Return the index of a box's first cell as integers."""
    try:
        first = tuple(map(operator.index, np.asarray(lower, dtype=object).tolist()))
    except TypeError:
        first = ()
    if len(first) != dim:
        rule = f"it must be {dim} integers, the index of the first cell"
        hint = "convert metres with space.grid.cell_of"
        raise InputError("lower", f"is {lower!r}", rule, hint)
    return first


class Updater:
    """Update a map in place when cells of its workspace change.

    The state of a cell depends on the workspace cells under the robot's rasters. So the cells that
    a changed box can reach form a window around it, in all slices. The engine computes the window
    from the part of the workspace around it. Only then the window, the workspace and the states
    outside the grid are written.

    Parameters
    ----------
    contents : Contents
        The map. Updates write into its states, and into a copy of its workspace.
    layers : ObstacleLayers or None
        Named obstacles that the cells of the workspace come from.
    rasters : sequence of (outer, inner) Raster
        The robot's rasters, for each slice.
    exterior : Exterior
        Updates write into its boxes.
    drop_derived : callable
        Called with the workspace and the layers of obstacles, before the map changes; it drops all
        data of the map that depend on its cells.
    """

    def __init__(
        self,
        contents: Contents,
        layers: ObstacleLayers | None,
        rasters: Sequence[tuple[Raster, Raster]],
        exterior: Exterior,
        drop_derived: Callable[[Workspace, ObstacleLayers | None], None],
    ) -> None:
        """Copy the workspace, and measure how far the robot's rasters reach."""
        self._grid = contents.grid
        self._layers = layers
        self._states = contents.states
        self._outside = contents.outside
        self._rasters = rasters
        self._exterior = exterior
        self._drop_derived = drop_derived
        self._sides = group_rasters(rasters, contents.proves_blocked)
        self._reach = _reach(self._sides, contents.grid.shape, contents.outside == "blocked")
        # Cells of the largest raster along each axis, and number of rotation cells of each slice.
        self._size = np.max([outer.cells.shape for outer, _ in rasters], axis=0)
        self._weights = np.bincount(contents.slice_of, minlength=len(contents.states))
        self._workspace = copy_workspace(contents.workspace, live=True)

    def update(self, patch: Patch) -> Update:
        """Write a box of known cells into the base, and update the map.

        The *base* is the workspace without named obstacles. Its outer cells meet an obstacle, its
        inner cells lie in obstacles.
        """
        base = self._workspace if self._layers is None else self._layers
        window = patch.window
        were_known = base.unknown is None or not base.unknown[window].any()
        is_same_outer = np.array_equal(base.outer[window], patch.outer)
        if were_known and is_same_outer and np.array_equal(base.inner[window], patch.inner):
            # Nothing changes, so the workspace keeps its shapes.
            return Update(0, patch.lower, patch.lower, 0)
        if self._layers is None:
            # Without named obstacles, the base is the workspace. Its shapes no longer describe its
            # cells.
            self._set_shapes(None)
            return self._write_all([patch])
        # Named obstacles lie over the base, so the map gets the union of both.
        self._layers.write(window, patch.outer, patch.inner)
        first = np.array(patch.lower)
        return self._copy_layers(self._layers, [(first, first + patch.outer.shape)])

    def set_obstacle(self, name: str, shape: Shape | None) -> Update:
        """Add, replace or remove a named obstacle, and update the map."""
        obstacle = None if shape is None else Obstacle.of(shape, self._grid)
        if self._layers is None:
            self._layers = _layers_of(self._workspace)
        boxes = self._layers.set_obstacle(name, obstacle)
        # The old and the new place of an obstacle are one box if a robot can touch both.
        if len(boxes) == 2 and not self._are_apart(*boxes):
            firsts, stops = zip(*boxes, strict=True)
            boxes = [(np.min(firsts, axis=0), np.max(stops, axis=0))]
        return self._copy_layers(self._layers, boxes)

    def _are_apart(self, box: CellBox, other: CellBox) -> bool:
        """Return True if no configuration can touch both boxes.

        Two changes then cost less than one.
        """
        first, stop = box
        other_first, other_stop = other
        gaps = np.maximum(other_first - stop, first - other_stop)
        return bool((gaps >= self._size).any())

    def _copy_layers(self, layers: ObstacleLayers, boxes: Sequence[CellBox]) -> Update:
        """Copy boxes of cells from the layers to the map, with all shapes."""
        self._set_shapes(layers.obstacles)
        return self._write_all(
            [Patch(tuple(first.tolist()), *layers.cells(first, stop)) for first, stop in boxes]
        )

    def _set_shapes(self, shapes: tuple[Shape, ...] | None) -> None:
        """Replace the shapes of the workspace."""
        object.__setattr__(self._workspace, "shapes", shapes)

    def _write_all(self, patches: Sequence[Patch]) -> Update:
        """Write patches into the workspace, and update the map.

        If it is interrupted, also by Ctrl-C, all patches are written before the error goes on.
        """
        try:
            updates = [self._write(patch) for patch in patches]
        except BaseException:
            for patch in patches:
                self._write(patch)
            raise
        finally:
            self._drop_derived(self._workspace, self._layers)
        return Update.combine(updates, self._grid.dim)

    def _write(self, patch: Patch) -> Update:
        """Write a patch into the workspace, and update the map."""
        outer_differs = self._workspace.outer[patch.window] != patch.outer
        differs = outer_differs | (self._workspace.inner[patch.window] != patch.inner)
        changed_cells = np.argwhere(differs) + patch.lower
        occupied = len(changed_cells)
        nothing = Update(occupied, patch.lower, patch.lower, 0)
        if not occupied:
            self._write_cells(patch)  # unknown cells may change
            return nothing
        first, stop = self._find_dependent(changed_cells)
        window = (slice(None), *map(slice, first.tolist(), stop.tolist()))
        states = self._states[window]
        if states.size:
            states = self._compute(patch, first, stop)
        differences = (states != self._states[window]).reshape(len(states), -1)
        changed = int(self._weights @ np.count_nonzero(differences, axis=1))
        # From here on the map changes. Each step may be repeated.
        self._drop_derived(self._workspace, self._layers)
        self._states[window] = states
        self._write_cells(patch)
        if self._outside == "free":
            exterior = Exterior.of(self._workspace.outer, self._rasters, "free")
            self._exterior.table[...] = exterior.table
        if not states.size:
            return nothing
        return Update(occupied, tuple(first.tolist()), tuple(stop.tolist()), changed)

    def _find_dependent(self, changed_cells: Ints) -> CellBox:
        """Return the box of map cells that depend on workspace cells, shape (n, d)."""
        lowest_offset, highest_offset = self._reach
        # Cell k depends on the cells k + m, where m is an offset of the robot.
        first = np.maximum(changed_cells.min(axis=0) - highest_offset, 0)
        last = changed_cells.max(axis=0) - lowest_offset
        stop = np.minimum(last + 1, self._grid.shape)
        # The box is empty if no cell of the grid depends on the changes.
        return first, np.maximum(stop, first)

    def _compute(self, patch: Patch, first: Ints, stop: Ints) -> Bytes:
        """Return the states of the cells from ``first`` to ``stop``, with the patch."""
        lowest_offset, highest_offset = self._reach
        begin = np.maximum(first + lowest_offset, 0)
        end = np.minimum(stop + highest_offset, self._grid.shape)
        cells = self._cells_after(patch, tuple(map(slice, begin.tolist(), end.tolist())))
        shift = (first - begin).tolist()
        sides = [[raster.translate(shift) for raster in side] for side in self._sides]
        states = np.empty((len(self._states), *(stop - first).tolist()), dtype=np.uint8)
        fill_states(dilation, self._outside, cells, sides, states)
        return states

    def _cells_after(self, patch: Patch, window: tuple[slice, ...]) -> tuple[Bools, Bools]:
        """Return the outer and inner cells of a window of the workspace with the patch.

        They are one array if they are equal.
        """
        in_window, in_patch = intersect_boxes(window, patch.window)
        outer = self._workspace.outer[window].copy()
        outer[in_window] = patch.outer[in_patch]
        if self._stay_equal(patch):
            return outer, outer
        inner = self._workspace.inner[window].copy()
        inner[in_window] = patch.inner[in_patch]
        return outer, inner

    def _stay_equal(self, patch: Patch) -> bool:
        """Return True if inner and outer cells are one array, also with the patch."""
        if self._workspace.inner is not self._workspace.outer:
            return False
        return patch.inner is patch.outer or np.array_equal(patch.inner, patch.outer)

    def _write_cells(self, patch: Patch) -> None:
        """Write a patch into the workspace.

        Inner and outer cells become two arrays when they first differ.
        """
        old = self._workspace
        window = patch.window
        if old.inner is not old.outer:
            _overwrite(old.outer, window, patch.outer)
            _overwrite(old.inner, window, patch.inner)
        elif self._stay_equal(patch):
            _overwrite(old.outer, window, patch.outer)
        else:
            # One array was both; the patch makes two of it.
            outer = old.outer.copy()
            inner = old.outer.copy()
            outer[window] = patch.outer
            inner[window] = patch.inner
            parts = frozen(outer), frozen(inner), old.source, old.unknown, old.shapes
            self._workspace = Workspace(old.grid, *parts, live=True)
        if self._workspace.unknown is not None:
            _overwrite(self._workspace.unknown, window, patch.unknown)


def _overwrite(array: Bools, window: tuple[slice, ...], values: Bools | bool) -> None:
    """Write to an array that is read-only for users."""
    array.setflags(write=True)
    array[window] = values
    array.setflags(write=False)


def _layers_of(workspace: Workspace) -> ObstacleLayers:
    """Return layers with the workspace as their base, without named obstacles."""
    unknown = None if workspace.unknown is None else workspace.unknown.copy()
    return ObstacleLayers(
        workspace.grid, workspace.outer.copy(), workspace.inner.copy(), unknown, workspace.shapes
    )


def _reach(sides: RasterGroups, shape: Sequence[int], exterior_blocked: bool) -> Ints:
    """Return the minimum and maximum offset of the cells that decide a state, shape (2, d).

    A robot that touches the blocked exterior from everywhere depends on no cell.
    """
    # The box around all runs; it is inverted if there are none.
    low = np.full(3, _NEVER)
    high = np.full(3, -_NEVER)
    for side in sides:
        for runs in ClippedRuns.of(side, to_three_axes(shape)):
            if not len(runs.table) or (runs.clipped and exterior_blocked):
                continue
            # Runs are (x, y, z, length) and lie along the last axis.
            x, y, z, length = runs.table.T
            first = np.stack([x, y, z], axis=1)
            last = np.stack([x, y, z + length - 1], axis=1)
            low = np.minimum(low, first.min(axis=0))
            high = np.maximum(high, last.max(axis=0))
    missing_axes = 3 - len(shape)
    return np.stack([low, high])[:, missing_axes:]
