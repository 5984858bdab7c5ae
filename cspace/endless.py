"""EndlessCSpace: a map with continuous joints, which closes in a circle along their axes.

The cells are those of one turn, and the last ones along a circle are neighbours of the first. Look-ups see them
*unrolled*, half a turn more at either end: a configuration is brought into the turn in the middle first, and what is
looked at around it, be it an edge, which goes the shorter way, or what is nearest, is there without a seam. Components
are those of the cells of one turn, joined across the seams.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress, product
from typing import TYPE_CHECKING, Any, Final, Literal, NoReturn

import numpy as np
import scipy  # its parts are read when they are first used
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.limits import check_memory
from cspace.map.batches import Kernel, Query, as_points, in_pieces
from cspace.map.components import Components
from cspace.map.contents import Contents
from cspace.map.derived import Derived
from cspace.rotations import OneRotation, Rotations
from cspace.rotations.base import MAX_JOINT_ANGLE, shorter, wrapped
from cspace.space import CSpace
from cspace.threads import LEAST
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from cspace.exact.boundaries import Problem
    from cspace.map.mip import Marks
    from cspace.map.storage import Map, Stack
    from cspace.spectral import FourierOverlap
    from cspace.update import Change


_BYTES: Final = 3
"""For each cell that is unrolled: its state, and whether it meets an obstacle or lies in one."""

_quiet: Final = np.errstate(invalid="ignore")
"""Numbers that are not finite are refused where they are looked up."""


def map_of(contents: Contents) -> CSpace:
    """The map that some contents are of."""
    return EndlessCSpace(contents) if any(contents.endless) else CSpace(contents)


@dataclass(frozen=True, slots=True)
class Circles(OneRotation):
    """No rotation; but some of the numbers of a configuration are angles, that lead on after a turn."""

    endless: tuple[bool, ...] = ()

    @_quiet
    def canonical(self, q: Floats, name: str = "q") -> Floats:
        """Configurations, shape (..., dof), with each angle in [-pi, pi).

        Raises
        ------
        InputError
            If an angle is too large to be wrapped.
        """
        far = (np.abs(q) > MAX_JOINT_ANGLE) & self.endless
        if far.any():
            fault, rule = f"has an angle of {q[far][0]:g} rad", f"at most {MAX_JOINT_ANGLE:.0f} are wrapped exactly"
            raise InputError(name, fault, rule, "leave out whole turns", value=float(q[far][0]))
        return wrapped(q, self.endless)

    def steps(self, q0: Floats, q1: Floats) -> Floats:
        """What leads from configurations to others, turning the shorter way; half a turn as it is given."""
        return shorter(q1 - q0, self.endless)


class Seam(Components):
    """Components of a map's cells, joined across the seams of the axes that close in a circle."""

    def __init__(
        self, states: Stack, slice_of: Ints, neighbors: Ints, rim_is_open: Bools, endless: Sequence[bool]
    ) -> None:
        super().__init__(states, slice_of, neighbors, rim_is_open)
        sides, shape = [], states.shape[1:]
        for axis in np.flatnonzero(endless).tolist():
            first = np.indices((*shape[:axis], 1, *shape[axis + 1 :])).reshape(len(shape), -1).T
            sides.append((first, first + (shape[axis] - 1) * np.eye(len(shape), dtype=np.int64)[axis]))
        first, last = (np.concatenate(each) for each in zip(*sides, strict=True))
        # Rotation cells are the one that there is.
        self._pairs = np.insert(np.stack([last, first]), 0, 0, axis=2)
        self._met: dict[bool, tuple[Ints, Ints]] = {}

    def renew(self, boxes: Ints) -> None:
        super().renew(boxes)
        self._met.clear()

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        if mixed not in self._met:
            self._met[mixed] = _met(super().of(self._pairs, mixed))
        return _replaced(super().of(cells, mixed), *self._met[mixed])

    def box(self, cell: Ints) -> Ints:
        number = self.of(cell)
        flat = self._pairs.reshape(-1, self._pairs.shape[-1])
        one_each = flat[np.unique(super().of(self._pairs), return_index=True)[1]]
        ours = one_each[self.of(one_each) == number]
        boxes = np.stack([super(Seam, self).box(each) for each in (cell, *ours)])
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def _met(numbers: Ints) -> tuple[Ints, Ints]:
    """Components, shape (2, n), that meet across seams: those that do, ascending, and the lowest one of each class."""
    names, pairs = np.unique(numbers[:, (numbers >= 0).all(axis=0)], return_inverse=True)
    pairs = pairs.reshape(2, -1)
    graph = scipy.sparse.coo_array((np.ones(pairs.shape[1]), pairs), shape=(len(names), len(names)))
    classes = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    return names, names[np.unique(classes, return_index=True)[1]][classes]


def _replaced(numbers: Ints, names: Ints, lowest: Ints) -> Ints:
    """Numbers, those among some names replaced by others."""
    if not len(names):
        return numbers
    place = np.minimum(np.searchsorted(names, numbers), len(names) - 1)
    return np.where(names[place] == numbers, lowest[place], numbers)


class EndlessCSpace(CSpace):
    """Certified map of joints of which some are continuous: a map like any other, without a seam.

    Angles of such joints may be any, up to 256 radians; a whole turn more is the same configuration. Edges turn these
    joints the shorter way, as OMPL does, and rows of a path count whole turns, so that straight motions join them.
    What is placed outside the turn in the middle comes in again, whole turns on.
    ``clearance`` is computed up to half a turn, and ``is_free_around`` within as much. There is no :meth:`overlap`, and
    no overlap field.

    Parameters
    ----------
    contents : Contents
        All that the map is; ``endless`` names the axes.
    """

    def _make_room(self) -> None:
        super()._make_room()
        self._derived_unrolled: Derived[CSpace] = Derived(self._lock)

    @property
    def endless(self) -> tuple[bool, ...]:
        """Which numbers are angles of continuous joints, where a whole turn more is the same configuration."""
        return self._contents.endless

    @property
    def rotations(self) -> Rotations:
        """The one cell of what does not turn; it knows which numbers are angles."""
        return Circles(self.endless)

    @property
    def facts(self) -> dict[str, object]:
        return {
            "endless": list(compress(self.axes, self.endless)),
            **super().facts,
        }

    # ---- unrolled ----------------------------------------------------------------------------------------------------

    @property
    def _padding(self) -> Ints:
        """Cells that are unrolled at either end, along each axis: half a turn, and what edges touch there."""
        return np.where(self.endless, np.array(self.grid.shape) // 2 + 2, 0)

    @property
    def _unrolled(self) -> CSpace:
        return self._derived_unrolled.get(lambda: self._over(-self._padding, self.grid.shape + self._padding))

    def _over(self, first: Ints, stop: Ints) -> CSpace:
        """A map with an end, from a first cell up to the one before another, with each cell as often as it comes by."""
        whole, workspace = self.grid, self.workspace
        lower, shape = np.asarray(whole.lower) + whole.spacing * first, (stop - first).tolist()
        grid = Grid(lower, whole.spacing, shape, whole.axes, whole.units)
        check_memory(_BYTES * grid.size, "the map, unrolled,", grid)

        def taken(cells: NDArray[Any]) -> NDArray[Any]:
            for axis in np.flatnonzero(self.endless).tolist():
                cells = cells.take(np.arange(first[axis], stop[axis]) % whole.shape[axis], axis=axis)
            return cells

        outer = taken(workspace.outer)
        inner = outer if workspace.inner is workspace.outer else taken(workspace.inner)
        part = Workspace(grid, outer, inner, workspace.source)
        states = taken(np.asarray(self._seen[0]))[np.newaxis]
        return CSpace(Contents(part, self.robot, Rotations.of(None), self._slice_of, states))

    def _in_pieces(self, kernel: Kernel, least: int = LEAST) -> Query:
        """The same of configurations, or edges, brought into the turn in the middle."""
        circles = self.rotations

        @_quiet
        def brought(given: Floats, *others_and_out: NDArray[Any]) -> int:
            *others, out = others_and_out
            first, *lasts = map(circles.canonical, (given, *others))
            ends = (
                np.where(self.endless, first + circles.steps(given, q), last)
                for q, last in zip(others, lasts, strict=True)
            )
            return kernel(first, *ends, out)

        return in_pieces(brought, least)

    @property
    def record(self) -> Map:
        return self._unrolled.record

    def _marks(self, *, cells: bool, lasting: bool = False) -> Marks:
        return self._unrolled._marks(cells=cells, lasting=lasting)

    def _inflated(self, limit: float, number: int | None) -> Floats:
        inside = tuple(slice(pad, pad + n) for pad, n in zip(self._padding.tolist(), self.grid.shape, strict=True))
        return self._unrolled._inflated(limit, number)[inside]

    def _problem(self) -> Problem:
        return super()._problem()._replace(workspace=self._unrolled.workspace)

    def nearest_free(self, q: ArrayLike) -> Floats:
        """As :meth:`CSpace.nearest_free`; angles are in [-pi, pi)."""
        brought = self.rotations.canonical(as_points(q, "q", self.dof))
        return self.rotations.canonical(self._unrolled.nearest_free(brought))

    def _cells_of(self, points: Floats) -> Ints:
        """As of other maps; on a border it is the cell that look-ups see, for which the grid, unrolled, rounds."""
        cells = self._unrolled.grid.cell_of(self.rotations.canonical(points)) - self._padding
        return np.insert(np.where(self.endless, cells % self.grid.shape, cells), 0, 0, axis=-1)

    # ---- joined ------------------------------------------------------------------------------------------------------

    def _components_of(self, states: Stack, rim_is_open: Bools) -> Components:
        return Seam(states, self._slice_of, self.rotations.neighbors, rim_is_open, self.endless)

    def _free_path(self, q0: ArrayLike, q1: ArrayLike, straight: bool, seconds: float) -> Floats:
        """As of other maps; it begins at q0, and ends at q1 but for whole turns."""
        return self._begun(super()._free_path(q0, q1, straight, seconds), q0)

    def _widest_path(self, q0: ArrayLike, q1: ArrayLike, straight: bool, seconds: float) -> Floats:
        """As of other maps; it begins at q0, and ends at q1 but for whole turns."""
        return self._begun(super()._widest_path(q0, q1, straight, seconds), q0)

    def _begun(self, path: Floats, q0: ArrayLike) -> Floats:
        """A path as many whole turns on as it takes to begin at a configuration."""
        return path + (np.asarray(q0, dtype=np.float64) - path[:1] - self.rotations.steps(path[:1], np.asarray(q0)))

    # ---- changed -----------------------------------------------------------------------------------------------------

    def _renew(self, change: Change) -> None:
        unrolled, cells = self._derived_unrolled.made, change.cells.reshape(2, 3)[:, 3 - self.dof :]
        if unrolled is not None and (cells[0] <= cells[1]).all():
            shape, padding = np.array(self.grid.shape), self._padding
            most = -(-padding // shape)
            for turns in product(*(range(-n, n + 1) for n in most.tolist())):
                shift = padding + shape * turns
                low, stop = np.maximum(cells[0] + shift, 0), np.minimum(cells[1] + 1 + shift, shape + 2 * padding)
                if (low < stop).all():
                    box = tuple(map(slice, low - shift, stop - shift))
                    outer, inner = change.workspace.outer[box], change.workspace.inner[box]
                    unrolled.update(outer, low.tolist(), inner=inner)
        super()._renew(change)

    # ---- what there is not -------------------------------------------------------------------------------------------

    def _none(self, what: str, mend: str) -> NoReturn:
        circles = ", ".join(compress(self.axes, self.endless))
        raise InputError(what, "is asked for", f"there is none of a map that closes in a circle along {circles}", mend)

    def _sum(self, side: Literal["outer", "inner"], q: ArrayLike) -> int | Ints:
        self._none("overlap", "ask classify: a point overlaps with nothing, or with one cell")

    def obstacle_distance(self, q: ArrayLike, lengths: ArrayLike = 0.0, turns: ArrayLike = 0.0) -> float:
        """There is none: what lies between numbers of joints is no distance of the arm."""
        self._none("the distance", "ask the space of the arm")

    def with_overlap_field(self, overlap: FourierOverlap) -> CSpace:
        """There is none: the arm is a point here."""
        self._none("overlap_field", "ask the space of the arm")
