"""Updates: a map that follows changes of its workspace without a rebuild."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace._engines.dilation import ClippedRuns, to_three_axes
from cspace._engines.slices import RasterGroups, fill_states, group_rasters
from cspace._grid import Grid
from cspace._obstacles import CellBox, Obstacle, ObstacleLayers
from cspace._raster import Raster
from cspace._record.contents import Contents
from cspace._record.exterior import Exterior
from cspace._shapes import Shape
from cspace._support.arrays import Bools, Bytes, Floats, Ints, find_box, frozen, intersect_boxes
from cspace._support.check import check_cells, check_real
from cspace._support.limits import UPDATE_CELL_BYTES, WORKSPACE_CELL_BYTES, check_memory
from cspace._support.reporting import warn_user
from cspace._workspace import LiveWorkspace, Workspace, copy_workspace, in_metres
from cspace.errors import InputError, UnitWarning

MAX_BLOCKS: Final = 2**16
"""Approximate number of blocks of cells that are sorted to split changed cells into boxes."""

CELLS_PER_BOX: Final = 50_000
"""Cells whose states take as long to compute as the preparations for a box of cells."""


@dataclass(frozen=True, slots=True)
class Update:
    """Result of :meth:`cspace.CSpace.update`.

    Attributes
    ----------
    occupied : int
        Number of workspace cells that changed.
    lower, upper : tuple of int
        Box of configuration cells that were computed again: its first cell, and the cell after its
        last one along each axis. The two are equal if no cell was computed.
    changed : int
        Number of configuration cells, over all rotation cells, whose state changed.
    """

    occupied: int
    lower: tuple[int, ...]
    upper: tuple[int, ...]
    changed: int


@dataclass(frozen=True, slots=True)
class Patch:
    """New contents of a box of workspace cells.

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
        """Make a patch from the arguments of :meth:`cspace.CSpace.update`.

        Arrays are copied. Raises InputError if the cells or the position of the box are invalid.
        """
        outer = _copy_cells(cells, "cells")
        first = _check_first_cell(lower, grid.axes)
        if outer.ndim != grid.dim:
            problem = f"has {outer.ndim} axes but the grid has {grid.dim}"
            raise InputError("cells", problem, "they must agree")
        stop = np.add(first, outer.shape)
        if min(first) < 0 or (stop > grid.shape).any():
            problem = f"has shape {outer.shape} and lower is {first} on a grid of {grid.shape}"
            rule = "the box must lie in the grid"
            raise InputError("cells", f"{problem} cells", rule)
        if inner is None:
            return cls(first, outer, outer)
        inside = _copy_cells(inner, "inner")
        if inside.shape != outer.shape:
            problem = f"has shape {inside.shape} but cells has {outer.shape}"
            raise InputError("inner", problem, "they must be equal")
        not_outer = np.argwhere(inside & ~outer)
        if len(not_outer):
            entry = tuple(not_outer[0].tolist())
            problem = f"has entry {entry}, which is not in cells"
            rule = "it must be a subset of cells"
            raise InputError("inner", problem, rule)
        return cls(first, outer, inside)


def _copy_cells(values: ArrayLike, name: str) -> Bools:
    """Return a contiguous writable copy of cells."""
    return np.array(check_cells(values, name), order="C")


def _check_first_cell(lower: Sequence[int], axes: Sequence[str]) -> tuple[int, ...]:
    """Return a first cell as integers, or raise InputError."""
    first = check_real(lower, "lower", axes)
    if first.shape != (len(axes),) or first.dtype.kind not in "iu":
        rule = f"it must be {len(axes)} integers, the index of the first cell"
        raise InputError("lower", f"is {first.tolist()}", rule)
    return tuple(first.tolist())


def _combine_updates(updates: Sequence[Update], dim: int) -> Update:
    """Combine updates of disjoint sets of workspace cells.

    The box is that around the boxes of all updates, along ``dim`` axes, and numbers are added.
    """
    nothing = Update(0, (0,) * dim, (0,) * dim, 0)
    # Empty boxes do not extend the combined box.
    with_box = [update for update in updates if update.lower != update.upper]
    boxes = with_box or updates or [nothing]
    lower = np.min([update.lower for update in boxes], axis=0)
    upper = np.max([update.upper for update in boxes], axis=0)
    occupied = sum(update.occupied for update in updates)
    changed = sum(update.changed for update in updates)
    return Update(occupied, tuple(lower[:dim].tolist()), tuple(upper[:dim].tolist()), changed)


class Updater:
    """Update a map in place when cells of its workspace change.

    On a floor, the workspace is in space, and the map is one layer of cells of positions.

    The state of a cell depends on the workspace cells under the robot's rasters, so changed cells
    affect only windows around them, in all slices. The engine computes each window from the part of
    the workspace around it. Only then are all windows, the workspace and the states outside the
    grid written.

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
        """Copy the workspace, and measure the reach of the robot's rasters."""
        self._grid = contents.workspace.grid
        self._layers = layers
        self._on_floor = contents.floor is not None
        self._dim = contents.grid.dim
        # On a floor, the map is one layer of positions.
        self._shape = (*contents.grid.shape, 1)[: self._grid.dim]
        self._states = contents.states.reshape(-1, *self._shape)
        self._outside = contents.outside
        self._rasters = rasters
        self._exterior = exterior
        self._drop_derived = drop_derived
        groups = group_rasters(rasters, contents.proves_blocked)
        is_blocked = contents.outside == "blocked"
        self._offset_range = _measure_offsets(groups, self._grid.shape, is_blocked)
        # Bitmaps begin at the first cell that decides a state, so rasters move to the state.
        shift = -self._offset_range[0]
        self._groups = [[raster.translate(shift) for raster in group] for group in groups]
        # Cells of the largest raster along each axis, and number of rotation cells of each slice.
        self._raster_size = np.max([outer.cells.shape for outer, _ in rasters], axis=0)
        self._weights = np.bincount(contents.slice_of, minlength=len(contents.states))
        check_memory(WORKSPACE_CELL_BYTES * self._grid.size, "the map, to change it,", self._grid)
        self._workspace = copy_workspace(contents.workspace, LiveWorkspace)

    def update(self, patch: Patch) -> Update:
        """Write a box of cells, and update the map.

        The *base* is the workspace without named obstacles.
        """
        self._check_memory(patch.outer.size)
        base = self._workspace if self._layers is None else self._layers
        window = patch.window
        were_known = base.unknown is None or not base.unknown[window].any()
        is_same_outer = np.array_equal(base.outer[window], patch.outer)
        if were_known and is_same_outer and np.array_equal(base.inner[window], patch.inner):
            # Nothing changes, so the workspace keeps its shapes.
            first_cell = patch.lower[: self._dim]
            return Update(0, first_cell, first_cell, 0)
        if self._layers is None:
            # Without named obstacles, the base is the workspace. Its shapes no longer describe its
            # cells.
            self._set_shapes(None)
            return self._write_all([patch])
        # Named obstacles lie over the base, so the map gets the union of both.
        self._layers.write(window, patch.outer, patch.inner)
        first = np.array(patch.lower)
        return self._copy_layers(self._layers, [(first, first + patch.outer.shape)])

    def replace(self, workspace: Workspace) -> Update:
        """Write another workspace, and update the map."""
        self._check_memory(self._grid.size)
        base = self._workspace if self._layers is None else self._layers
        if base.unknown is None or workspace.unknown is None:
            same_unknown = base.unknown is workspace.unknown
        else:
            same_unknown = np.array_equal(base.unknown, workspace.unknown)
        same_cells = np.array_equal(base.outer, workspace.outer) and np.array_equal(
            base.inner, workspace.inner
        )
        first = np.zeros(self._grid.dim, dtype=np.int64)
        if same_cells and same_unknown and base.shapes is workspace.shapes:
            return _combine_updates([], self._dim)
        unknown = None if workspace.unknown is None else frozen(workspace.unknown.copy())
        object.__setattr__(self._workspace, "unknown", unknown)
        if self._layers is None:
            self._set_shapes(workspace.shapes)
            known = False if unknown is None else unknown
            patch = Patch(tuple(first.tolist()), workspace.outer, workspace.inner, known)
            return self._write_all([patch])
        layers = _make_layers(workspace)
        layers.named = self._layers.named
        self._layers = layers
        return self._copy_layers(layers, [(first, np.array(self._grid.shape))])

    def set_obstacles(self, shapes: Mapping[str, Shape | None]) -> Update:
        """Add, replace or remove named obstacles, and update the map once."""
        obstacles = {
            name: None if shape is None else Obstacle.of(shape, self._grid)
            for name, shape in shapes.items()
        }
        corners = " to ".join(map(in_metres, (self._grid.lower, self._grid.upper)))
        for name, obstacle in obstacles.items():
            if obstacle is not None and not obstacle.outer.any():
                warn_user(
                    f"the obstacle {name!r} lies outside the map, from {corners}, and changes "
                    "nothing; units are metres",
                    UnitWarning,
                )
        cells = sum(each.outer.size for each in obstacles.values() if each is not None)
        if self._layers is None:
            self._check_memory(cells + self._grid.size)
            self._layers = _make_layers(self._workspace)
        else:
            self._check_memory(cells)
        boxes: list[CellBox] = []
        for name, obstacle in obstacles.items():
            places = self._layers.set_obstacle(name, obstacle)
            # The old and the new place of an obstacle are one box if a robot can touch both.
            if len(places) == 2 and not self._are_apart(*places):
                firsts, stops = zip(*places, strict=True)
                places = [(np.min(firsts, axis=0), np.max(stops, axis=0))]
            boxes += places
        return self._copy_layers(self._layers, boxes)

    def _check_memory(self, cells: int) -> None:
        """Raise InputError if a change of workspace cells does not fit into memory.

        Nothing has changed by then.
        """
        needed = (UPDATE_CELL_BYTES + 2.0 * len(self._states)) * cells
        check_memory(needed, "the change of the map", self._grid)

    def _are_apart(self, box: CellBox, other: CellBox) -> bool:
        """Return True if no configuration can touch both boxes of cells.

        Two updates then cost less than one of the box around both.
        """
        first, stop = box
        other_first, other_stop = other
        gaps = np.maximum(other_first - stop, first - other_stop)
        return bool((gaps >= self._raster_size).any())

    def _copy_layers(self, layers: ObstacleLayers, boxes: Sequence[CellBox]) -> Update:
        """Copy boxes of cells from layers to workspace; update the map.

        The workspace also gets the shapes of the layers.
        """
        self._set_shapes(layers.obstacles)
        return self._write_all(
            [Patch(tuple(first.tolist()), *layers.cells(first, stop)) for first, stop in boxes]
        )

    def _set_shapes(self, shapes: tuple[Shape, ...] | None) -> None:
        """Replace the shapes of the workspace, a frozen dataclass."""
        object.__setattr__(self._workspace, "shapes", shapes)

    def _write_all(self, patches: Sequence[Patch]) -> Update:
        """Write patches into the workspace, and update the map.

        If an error or Ctrl-C interrupts it, all patches are written before the error is raised, so
        that the map agrees with the obstacles.
        """
        try:
            return self._write(patches)
        except BaseException:
            self._write(patches)
            raise
        finally:
            self._drop_derived(self._workspace, self._layers)

    def _write(self, patches: Sequence[Patch]) -> Update:
        """Write patches into the workspace, and update the map."""
        boxes: list[CellBox] = []
        for patch in patches:
            outer_differs = self._workspace.outer[patch.window] != patch.outer
            differs = outer_differs | (self._workspace.inner[patch.window] != patch.inner)
            if differs.any():
                for changed in split_changes(differs, self._raster_size):
                    first, stop = self._find_dependent(
                        *(corner + patch.lower for corner in changed)
                    )
                    if (first < stop).all():
                        boxes.append((first, stop))
        states = self._compute(patches, boxes)
        # From here on the map changes. Each step may be repeated after an interruption.
        if boxes:
            self._drop_derived(self._workspace, self._layers)
        updates = []
        for (first, stop), new_states in zip(boxes, states, strict=True):
            window = (slice(None), *map(slice, first.tolist(), stop.tolist()))
            differences = (new_states != self._states[window]).reshape(len(new_states), -1)
            count = int(self._weights @ np.count_nonzero(differences, axis=1))
            self._states[window] = new_states
            updates.append(Update(0, tuple(first.tolist()), tuple(stop.tolist()), count))
        updates += [
            Update(self._write_cells(patch), patch.lower, patch.lower, 0) for patch in patches
        ]
        if self._outside == "free" and any(update.occupied for update in updates):
            outer = self._workspace.outer
            exterior = Exterior.of(outer, self._rasters, "free", self._on_floor)
            self._exterior.table[...] = exterior.table
        return _combine_updates(updates, self._dim)

    def _find_dependent(self, changed_first: Ints, changed_stop: Ints) -> CellBox:
        """Find the map's box that changed workspace cells affect."""
        lowest_offset, highest_offset = self._offset_range
        # Cell k depends on the cells k + m, where m is an offset of the robot.
        first = np.maximum(changed_first - highest_offset, 0)
        stop = np.minimum(changed_stop - lowest_offset, self._shape)
        # The box is empty if no cell of the grid depends on the changes.
        return first, np.maximum(stop, first)

    def _compute(self, patches: Sequence[Patch], boxes: Sequence[CellBox]) -> list[Bytes]:
        """Compute the states of boxes of cells after patches."""
        if not boxes:
            return []
        size = np.max([stop - first for first, stop in boxes], axis=0)
        # Cells of boxes that are computed in one pass, so that rasters are prepared once.
        is_small = len(boxes) * math.prod(size.tolist()) <= 2**18
        if len(boxes) > 1 and not (is_small and self._grid.dim == 2):
            return [states for box in boxes for states in self._compute(patches, [box])]
        # Boxes of one size, with all cells that decide them, are layers of one bitmap.
        firsts = [np.minimum(first, self._shape - size) for first, _ in boxes]
        lowest_offset, highest_offset = self._offset_range
        shape = (2, len(boxes), *(size + highest_offset - lowest_offset).tolist())
        cells = np.full(shape, self._outside == "blocked")
        for layer, first in enumerate(firsts):
            begin = first + lowest_offset
            end = first + size + highest_offset
            inside = np.maximum(begin, 0), np.minimum(end, self._grid.shape)
            low, high = (np.subtract(corner, begin).tolist() for corner in inside)
            window = (slice(None), *map(slice, low, high))
            cells[:, layer][window] = self._cells_after(patches, *inside)
        states = np.empty((len(self._states), len(boxes), *size.tolist()), dtype=np.uint8)
        is_plane = self._grid.dim == 2
        outer, inner = cells if is_plane else cells[:, 0]
        results = states if is_plane else states[:, 0]
        if self._on_floor:
            results = results[..., 0]
        fill_states("direct", self._outside, (outer, inner), self._groups, results)
        found = []
        for layer, (first, stop) in enumerate(boxes):
            begin = first - firsts[layer]
            window = (slice(None), *map(slice, begin.tolist(), (begin + stop - first).tolist()))
            found.append(states[:, layer][window])
        return found

    def _cells_after(
        self, patches: Sequence[Patch], first: Ints, stop: Ints
    ) -> tuple[Bools, Bools]:
        """Return a box's outer and inner cells after patches."""
        if self._layers is not None:
            outer, inner, _ = self._layers.cells(first, stop)
            return outer, inner
        # Without named obstacles, there is one patch.
        (patch,) = patches
        window = tuple(map(slice, first.tolist(), stop.tolist()))
        in_window, in_patch = intersect_boxes(window, patch.window)
        outer = self._workspace.outer[window].copy()
        outer[in_window] = patch.outer[in_patch]
        inner = self._workspace.inner[window].copy()
        inner[in_window] = patch.inner[in_patch]
        return outer, inner

    def _stay_equal(self, patch: Patch) -> bool:
        """Return True if a patch keeps inner and outer cells one array."""
        if self._workspace.inner is not self._workspace.outer:
            return False
        return patch.inner is patch.outer or np.array_equal(patch.inner, patch.outer)

    def _write_cells(self, patch: Patch) -> int:
        """Write a patch; return the number of changed cells.

        Its inner and outer cells may be one array, as long as they are equal.
        """
        old = self._workspace
        window = patch.window
        differs = (old.outer[window] != patch.outer) | (old.inner[window] != patch.inner)
        if old.inner is not old.outer:
            _overwrite(old.outer, window, patch.outer)
            _overwrite(old.inner, window, patch.inner)
        elif self._stay_equal(patch):
            _overwrite(old.outer, window, patch.outer)
        else:
            # Inner and outer cells were one array, and become two.
            outer = old.outer.copy()
            inner = old.outer.copy()
            outer[window] = patch.outer
            inner[window] = patch.inner
            parts = frozen(outer), frozen(inner), old.source, old.unknown, old.shapes
            self._workspace = LiveWorkspace(old.grid, *parts)
        if self._workspace.unknown is not None:
            _overwrite(self._workspace.unknown, window, patch.unknown)
        return int(np.count_nonzero(differs))


def split_changes(changed: Bools, raster_size: Ints) -> list[CellBox]:
    """Split changed cells into boxes whose updates cost little in all.

    The cost of a box is the number of its cells, grown by ``raster_size``, and
    :data:`CELLS_PER_BOX`. Boxes are cut in two where that costs least, while it costs less than no
    cut. At least one cell has ``changed``.
    """
    # Sorting blocks of a quarter of the robot is quicker than sorting cells.
    largest = math.ceil((changed.size / MAX_BLOCKS) ** (1.0 / changed.ndim))
    sides = np.maximum(raster_size // 4, largest)
    has_changed = changed
    for axis, side in enumerate(sides.tolist()):
        starts = np.arange(0, changed.shape[axis], side)
        has_changed = np.logical_or.reduceat(has_changed, starts, axis=axis)
    boxes = []
    waiting = [np.argwhere(has_changed)]
    while waiting:
        blocks = waiting.pop()
        parts = _cut_in_two(blocks, raster_size / sides, CELLS_PER_BOX / math.prod(sides.tolist()))
        if parts:
            waiting += parts
            continue
        corner = sides * blocks.min(axis=0)
        window = tuple(map(slice, corner.tolist(), (sides * (blocks.max(axis=0) + 1)).tolist()))
        box = np.array([(side.start, side.stop) for side in find_box(changed[window])])
        boxes.append((corner + box[:, 0], corner + box[:, 1]))
    return boxes


def _cut_in_two(blocks: Ints, margin: Floats, cost_per_box: float) -> list[Ints]:
    """Cut blocks (n, d) in two where it pays most, or [].

    The cost of a set is that of the box around it with a ``margin``, plus ``cost_per_box``; in
    blocks.
    """

    def measure(low: Ints, high: Ints) -> Floats:
        """Return costs of boxes between first and last blocks, shape (m, d)."""
        return np.asarray(np.prod(high - low + 1 + margin, axis=1) + cost_per_box)

    cheapest = float(measure(blocks.min(axis=0)[None], blocks.max(axis=0)[None])[0])
    parts: list[Ints] = []
    for axis in range(blocks.shape[1]):
        ordered = blocks[np.argsort(blocks[:, axis], kind="stable")]
        back = ordered[::-1]
        heads = measure(np.minimum.accumulate(ordered), np.maximum.accumulate(ordered))
        tails = measure(np.minimum.accumulate(back), np.maximum.accumulate(back))[::-1]
        costs = heads[:-1] + tails[1:]
        if costs.size and costs.min() < cheapest:
            cheapest = float(costs.min())
            first_of_tail = int(costs.argmin()) + 1
            parts = [ordered[:first_of_tail], ordered[first_of_tail:]]
    return parts


def _overwrite(array: Bools, window: tuple[slice, ...], values: Bools | bool) -> None:
    """Write values into a window of a read-only array."""
    array.setflags(write=True)
    array[window] = values
    array.setflags(write=False)


def _make_layers(workspace: Workspace) -> ObstacleLayers:
    """Copy a workspace into layers without named obstacles."""
    unknown = None if workspace.unknown is None else workspace.unknown.copy()
    return ObstacleLayers(
        workspace.grid, workspace.outer.copy(), workspace.inner.copy(), unknown, workspace.shapes
    )


def _measure_offsets(groups: RasterGroups, shape: Sequence[int], is_blocked: bool) -> Ints:
    """Return the range of offsets that decide the state of a cell.

    Offsets lead from the cell to workspace cells.

    The result, shape (2, d), has the minimum and the maximum along each axis. ``is_blocked`` says
    whether the space outside the workspace is blocked.
    """
    # The box around all runs of offsets, which is inverted if there are none.
    # Minimum offset of a raster without cells, above all offsets; its negative is the maximum.
    infinity = 2**62
    low = np.full(3, infinity)
    high = np.full(3, -infinity)
    for rasters in groups:
        for runs in ClippedRuns.of(rasters, to_three_axes(shape)):
            # A raster larger than the grid touches a blocked exterior from every cell, so the
            # workspace decides nothing.
            if not len(runs.table) or (runs.clipped and is_blocked):
                continue
            # Runs are (x, y, z, length) and lie along the last axis.
            x, y, z, length = runs.table.T
            first = np.stack([x, y, z], axis=1)
            last = np.stack([x, y, z + length - 1], axis=1)
            low = np.minimum(low, first.min(axis=0))
            high = np.maximum(high, last.max(axis=0))
    missing_axes = 3 - len(shape)
    return np.stack([low, high])[:, missing_axes:]
