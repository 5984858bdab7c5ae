"""The convex region of FREE configurations around one of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from cspace import BLOCKED, FREE
from cspace.errors import ConfigurationError, InputError
from cspace.inside import (
    ANGLE_SLACK,
    FARTHEST_CELL,
    Bools,
    Floats,
    Ints,
    cells_of,
    check_memory,
    check_not_negative,
    check_positive,
    map_record,
)
from cspace.regions._convex_region import YAW, ConvexRegion
from cspace.regions._growth import HALF_CELL, HalfSpaces, grow_polytope, make_box

if TYPE_CHECKING:
    from cspace import CSpace, Space

ARC_SLACK: Final = 3.0 * ANGLE_SLACK
"""Distance in radians between the ends of an arc and a rotation cell that is not part of it."""

BYTES_PER_CELL: Final = 8
"""Approximate memory per cell within reach, bytes."""


class YawArc(NamedTuple):
    """An arc of yaws.

    Attributes
    ----------
    low, high : float
        Lowest and highest yaw, radians; not wrapped.
    """

    low: float
    high: float


def free_region(
    space: Space,
    q: ArrayLike,
    *,
    reach: float = 5.0,
    margin: float = 0.0,
    yaw_width: float | None = None,
) -> ConvexRegion:
    """Find a convex region around a configuration that is proven FREE.

    Each configuration of the region lies in FREE cells, and so does each straight motion
    between two of them. For maps in memory of positions, with or without a yaw, and of joints.
    A region of a map with a yaw is a polytope of positions times an arc of yaws, at each of
    which all its positions are FREE. Spacing and rotations of the map limit how near the region
    comes to obstacles. See ``cspace.regions`` for the method.

    Parameters
    ----------
    q : array-like, shape (size,)
        A FREE configuration, which the region contains; metres, and radians.
    reach : float
        Half the side of the box around it that the region stays in, metres; for a map of joints
        in the joints' units. The time grows with the number of cells in this box.
    margin : float
        Distance of the region's positions from cells that are not FREE, in the same unit.
    yaw_width : float, optional
        Width of the arc of yaws around that of ``q``, radians. By default, the arc is as wide
        as possible, but so that the positions keep half the volume that they have in the yaw
        cell of ``q``.

    Returns
    -------
    cspace.regions.ConvexRegion

    Raises
    ------
    InputError
        If the space is no such map; a number is not finite or out of range; or the robot is not
        FREE at all yaws of ``yaw_width``.
    ConfigurationError
        If the configuration is not FREE, or lies on the border of a cell that is not FREE or
        within the margin of it.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
    >>> region = space.free_region((0.5, 2.0))
    >>> region.contains([(0.5, 2.0), (1.5, 1.5)]).tolist()
    [True, False]
    >>> round(region.volume, 1), len(region.b)
    (1.7, 10)
    """
    source = RegionSource.of(space, reach, margin)
    point = source.space.check_configuration(q)
    if yaw_width is not None:
        yaw_width = check_positive(yaw_width, "yaw_width", "rad")
        if not source.has_yaw:
            problem = f"is {yaw_width!r} and the axes are ({', '.join(space.axes)})"
            raise InputError("yaw_width", problem, "only a yaw has a width")
    state = int(source.space.classify(point))
    if state != FREE:
        name = "BLOCKED" if state == BLOCKED else "MIXED"
        raise _make_seed_error(source, point, f"lies in a {name} cell")
    region = source.grow_around(point, yaw_width)
    if region is not None:
        return region
    if yaw_width is not None and source.grow_around(point, 2.0 * ARC_SLACK) is not None:
        problem = f"is {yaw_width:g} and the robot is not FREE at ({_format(point)}) all along it"
        raise InputError("yaw_width", problem, "the region holds each yaw of the arc")
    near = f"lies within the margin of {margin:g}" if margin else "lies on the border"
    raise _make_seed_error(source, point, f"is FREE but {near} of a cell that is not")


def _make_seed_error(source: RegionSource, point: Floats, problem: str) -> ConfigurationError:
    """Make the error for a configuration without region."""
    rule = "a region grows around a configuration inside FREE cells"
    return ConfigurationError("q", f"({_format(point)}) {problem}", rule)


def _format(point: Floats) -> str:
    """Return a configuration as text."""
    return ", ".join(f"{value:.6g}" for value in point.tolist())


class RegionSource(NamedTuple):
    """A map that regions are grown in.

    Attributes
    ----------
    space : CSpace
    reach : float
        Half the side of the box around a core that regions stay in, metres.
    margin : float
        Distance of positions from cells that are not FREE, metres.
    """

    space: CSpace
    reach: float
    margin: float

    @classmethod
    def of(cls, space: Space, reach: float, margin: float) -> RegionSource:
        """Check a map and two lengths.

        Raises InputError if the space is no map in memory of positions, with or without a yaw.
        """
        metres = check_positive(reach, "reach")
        distance = check_not_negative(margin, "margin")
        map_record(space)  # only a map in memory has one
        if space.rotations.names not in ((), (YAW,)):
            problem = f"has the axes ({', '.join(space.axes)})"
            rule = "regions consist of cells of a map of positions, or with a yaw"
            raise InputError("space", problem, rule)
        return cls(cast("CSpace", cells_of(space)), metres, distance)

    @property
    def has_yaw(self) -> bool:
        """Whether the robot turns about z."""
        return self.space.axes[-1] == YAW

    def grow_around(self, point: Floats, yaw_width: float | None) -> ConvexRegion | None:
        """Grow a region around a configuration, or return None.

        None means that it is too near to cells that are not FREE.
        """
        core = np.stack([point, point])
        if not self.has_yaw:
            return self.grow(core, None)
        yaw = float(point[-1])
        if yaw_width is not None:
            half = 0.5 * min(yaw_width, math.tau + ARC_SLACK)
            return self.grow(core, YawArc(yaw - half, yaw + half))
        return self._grow_widest(core, yaw)

    def _grow_widest(self, core: Floats, yaw: float) -> ConvexRegion | None:
        """Grow the region of the widest arc.

        Its positions keep half of their volume.

        The arc has as many yaw cells on both sides of that of the yaw; their number is found by
        bisection, as if volumes fell with it.
        """
        # Wider arcs of the same slices have the same positions.
        grown = dict[tuple[int, ...], tuple[HalfSpaces, float] | None]()

        def grow(width: int) -> tuple[HalfSpaces, float] | None:
            """Grow positions with further yaw cells both ways."""
            slices = self.find_slices(self._widen(yaw, width))
            key = tuple(slices.tolist())
            if key not in grown:
                grown[key] = self._grow_positions(core, slices)
            return grown[key]

        best = grow(0)
        if best is None:
            return None
        # Least volume of the positions of a wide arc, as a share of that of the narrowest one.
        least = 0.5 * best[1]
        width = 0
        too_wide = len(self.space.rotations) // 2 + 1
        while too_wide - width > 1:
            wider = (width + too_wide) // 2
            positions = grow(wider)
            if positions is not None and positions[1] >= least:
                best, width = positions, wider
            else:
                too_wide = wider
        return self._assemble(best[0], self._widen(yaw, width), core)

    def _widen(self, yaw: float, width: int) -> YawArc:
        """Return the arc of yaw cells and neighbours.

        There are ``width`` neighbours on both sides.
        """
        first, last = self._find_range(YawArc(yaw, yaw))
        first -= width
        last += width
        if last - first + 1 >= len(self.space.rotations):
            return YawArc(yaw - math.pi - ARC_SLACK, yaw + math.pi + ARC_SLACK)
        return YawArc(self._border(first) + ARC_SLACK, self._border(last + 1) - ARC_SLACK)

    @property
    def borders(self) -> Floats:
        """Borders of the yaw cells, radians, shape (cells + 1,)."""
        return np.asarray(cast("Any", self.space.rotations).borders)

    def _border(self, cell: int) -> float:
        """Return the lower border of a yaw cell, radians.

        Cells are counted on in further turns.
        """
        borders = self.borders
        turns, index = divmod(cell, len(borders) - 1)
        return float(borders[index] + math.tau * turns)

    def _find_range(self, arc: YawArc) -> tuple[int, int]:
        """Return the first and last yaw cell that an arc meets.

        Cells are counted on in further turns.
        """
        borders = self.borders
        cells = list[int]()
        for yaw in (arc.low - 0.5 * ARC_SLACK, arc.high + 0.5 * ARC_SLACK):
            turns = math.floor((yaw - borders[0]) / math.tau)
            cell = int(np.searchsorted(borders, yaw - math.tau * turns, side="right")) - 1
            cells.append((len(borders) - 1) * turns + cell)
        return cells[0], cells[1]

    def find_slices(self, arc: YawArc | None) -> Ints:
        """Return the slices of all yaw cells that an arc meets.

        None means the only slice.
        """
        if arc is None:
            return np.zeros(1, dtype=np.int64)
        first, last = self._find_range(arc)
        count = len(self.space.rotations)
        cells = np.arange(first, min(last + 1, first + count)) % count
        return np.unique(self.space.slice_of[cells])

    def grow(self, core: Floats, arc: YawArc | None) -> ConvexRegion | None:
        """Grow a region around a core of two configurations, shape (2, size).

        Yaws of the core are not wrapped, and lie in the arc. Returns None if it is too near to
        cells that are not FREE at a yaw of the arc.
        """
        positions = self._grow_positions(core, self.find_slices(arc))
        return None if positions is None else self._assemble(positions[0], arc, core)

    def _grow_positions(self, core: Floats, slices: Ints) -> tuple[HalfSpaces, float] | None:
        """Grow the polytope of positions around a core.

        Returns half-spaces in metres, and the volume in cells.

        Returns None if a cell that is not FREE in one of the slices is too near to the core.
        """
        grid = self.space.grid
        places = (core[:, : grid.dim] - grid.lower) / grid.spacing
        low = places.min(axis=0) - self.reach / grid.spacing
        high = places.max(axis=0) + self.reach / grid.spacing
        gap = self.margin / grid.spacing
        is_open = map_record(self.space).exterior[slices, -1] == FREE
        if not is_open.all():
            # All cells beyond the grid are cut off by its sides.
            side = HALF_CELL - 0.5 + gap
            low = np.maximum(low, side)
            high = np.minimum(high, np.array(grid.shape) - side)
        if (places < low).any() or (places > high).any():
            return None
        # Cells beyond the ends of the box count too, as far as the margin reaches.
        origin, is_taken = self._find_taken(slices, low - gap, high + gap, bool(is_open.all()))
        # Cells beyond the mask are FREE.
        cell = np.floor(places[0] - origin).astype(np.int64)
        is_known = bool(((cell >= 0) & (cell < is_taken.shape)).all())
        if is_known and is_taken[tuple(cell)]:
            return None
        cells = find_surface(is_taken) + np.float64(0.5)
        box = make_box(low - origin, high - origin)
        grown = grow_polytope(cells, places - origin, box, gap)
        if grown is None:
            return None
        corner = grid.lower + grid.spacing * origin
        half_spaces, volume = grown
        return half_spaces.place(corner, grid.spacing), volume

    def _find_taken(
        self, slices: Ints, low: Floats, high: Floats, is_open: bool
    ) -> tuple[Floats, Bools]:
        """Find cells around a box that slices block.

        Returns the first cell, shape (d,), and a mask of the cells from there on. They are all
        cells that the closed box meets, except FREE ones far from the grid.
        """
        shape = np.array(self.space.grid.shape)
        first = np.zeros_like(shape)
        stop = shape
        table = map_record(self.space).exterior[slices]
        outside = [row[:-1].reshape(2, -1) for row in table] if is_open else []
        outside = [box for box in outside if (box[0] <= box[1]).all()]
        if is_open:
            first = np.min([first, *(box[0] for box in outside)], axis=0) - 1
            stop = np.max([stop, *(box[1] + 1 for box in outside)], axis=0) + 1
        first = np.clip(np.floor(low), first + 1, FARTHEST_CELL).astype(np.int64) - 1
        stop = np.clip(np.floor(high), -FARTHEST_CELL, stop - 2).astype(np.int64) + 2
        stop = np.maximum(stop, first)
        count = math.prod((stop - first).tolist())
        check_memory(BYTES_PER_CELL * count, "the cells within reach", self.space.grid)
        is_taken = np.zeros(stop - first, dtype=np.bool_)
        for box in outside:
            ends = np.clip([box[0], box[1] + 1], first, stop) - first
            is_taken[tuple(map(slice, *ends))] = True
        in_grid = np.clip([first, stop], 0, shape)
        begin, end = in_grid - first
        states = map_record(self.space).states.reshape(-1, *self.space.grid.shape)
        states = states[(slice(None), *map(slice, *in_grid))][slices]
        is_taken[tuple(map(slice, begin, end))] = (states != FREE).any(axis=0)
        return first.astype(np.float64), is_taken

    def _assemble(
        self, positions: HalfSpaces, arc: YawArc | None, core: Floats
    ) -> ConvexRegion | None:
        """Join positions and yaws to a region, if any.

        None means that rounding leaves an end of the core outside.
        """
        normals, offsets = positions
        if arc is not None:
            normals = np.pad(normals, ((0, 2), (0, 1)))
            normals[-2:, -1] = 1.0, -1.0
            offsets = np.append(offsets, [arc.high, -arc.low])
        region = ConvexRegion(normals, offsets, self.space.axes)
        return region if np.all(region.contains(core)) else None


def find_surface(is_taken: Bools) -> Ints:
    """Return the taken cells that touch another cell, shape (n, d).

    They may touch in a corner alone.

    A convex set with a point in another cell that meets none of these meets no taken cell: on the
    way to a taken cell, it would leave the other cells in a point of such a cell.
    """
    is_near = ~is_taken
    for axis in range(is_near.ndim):
        lines = np.moveaxis(is_near, axis, 0)
        before = lines[:-1].copy()
        lines[:-1] |= lines[1:]
        lines[1:] |= before
    return np.argwhere(is_taken & is_near)
