"""The certified map of a robot's configurations, in memory."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import FREE, MIXED, STATE_NAMES, Bools, Floats, Ints, States, Words
from cspace.check import check_count, check_finite, check_flag, check_positive, check_rng
from cspace.compiling import clock
from cspace.configuration_map import ConfigurationMap, Result
from cspace.engines.slices import slice_rasters
from cspace.errors import ConfigurationError, InputError
from cspace.limits import COMPONENT_STATE_BYTES, check_memory
from cspace.map.batches import (
    Configuration,
    ConfigurationBatch,
    Kernel,
    Query,
    as_contiguous,
    as_points,
    evaluate_batch,
    in_spatial_order,
    in_threaded_chunks,
)
from cspace.map.contents import Contents
from cspace.map.derived import Lock, lazy
from cspace.map.exterior import UNKNOWN, Exterior
from cspace.map.periodic import Periodic, below_half_a_turn, with_wrapped_angles
from cspace.map.storage import (
    Map,
    PackedStates,
    Stack,
    cells_of,
    check_bytes,
    count_states,
    kernel_states,
    read_only,
    read_only_of,
)
from cspace.raster import Raster
from cspace.rotations import Rotations
from cspace.rotations.base import shorter
from cspace.shapes import Shape, ShapeLike, as_shape
from cspace.shown import MapExport
from cspace.threads import MIN_ITEMS_PER_THREAD
from cspace.workspace import Workspace, copy_workspace

if TYPE_CHECKING:
    from cspace.exact.boundaries import Problem
    from cspace.exact.proofs import ExactQueries
    from cspace.map.clearance import Inflation
    from cspace.map.components import Components
    from cspace.map.mip import OccupancyBits, OccupancyPyramid
    from cspace.map.overlaps import Runs, Sums
    from cspace.map.sampling import FreeCells
    from cspace.map.search import Costs, Guides, Levels
    from cspace.map.widest import Widest
    from cspace.spectral.overlap import FourierOverlap, OverlapField
    from cspace.update import Change, Update, Updater


@dataclass(frozen=True, slots=True)
class MemoryBackend:
    """Cells in memory, in bytes or in two bits.

    Attributes
    ----------
    map_ : Map
        Record of the map, with periodic axes unrolled; it follows updates.
    periodic : Periodic
        Periodic axes.
    lock : Lock
        Held by an update while it changes cells.
    """

    map_: Map
    periodic: Periodic
    lock: Lock

    def query(self, kernel: Kernel, *arguments: Any, least: int = MIN_ITEMS_PER_THREAD) -> Query:
        """Return a query; see :class:`cspace.configuration_map.Backend`."""
        run = partial(kernel, self.map_, *arguments)
        return in_threaded_chunks(self.periodic.wrap_rows(run) if self.periodic else run, least)

    def at_one_moment(self, work: Callable[[], Result]) -> Result:
        """Run ``work`` under the lock; see :class:`cspace.configuration_map.Backend`."""
        with self.lock:
            return work()


class CSpace(ConfigurationMap, MapExport):
    """Certified map of a robot's configurations.

    The configurations lie in R^2, R^3, SE(2), R^3 x SO(2) or SE(3). Configurations are ``(x, y)`` or ``(x, y, z)``,
    followed by a yaw if the robot rotates about z, or by a quaternion ``(qx, qy, qz, qw)`` if it rotates about any
    axis. Use :func:`cspace.build` to make a map and :func:`cspace.open` to read a saved one.

    A query of one configuration, shape (size,), returns a Python number; a query of a batch, shape (..., size), returns
    an array of shape (...). Queries are compiled and may run in several threads at once. Labels, sums and occupancy
    bits are computed at the first call and cached; copies and pickles of the map leave them out. Yaw is in radians, and
    wrapped. A quaternion and its negative are the same rotation; the norm must be 1 within 1e-6.

    With ``outside="blocked"``, a configuration outside the grid is BLOCKED if the robot is proven to leave the
    workspace; with ``outside="free"``, it is FREE if the robot is proven to reach no obstacle; otherwise it is MIXED.
    In a window of a larger map (:meth:`cspace.TiledCSpace.window`), ``outside`` is "unknown", and all outside is MIXED.

    Axes of continuous joints are periodic: angles up to 256 radians are accepted and wrapped. Motions take the shorter
    arc, as in OMPL, and the rows of a path are unwrapped, so that straight motions join them. Obstacles repeat with a
    period of 2 pi. On such a map, :meth:`clearance` and :meth:`is_free_around` are limited to pi, and
    :meth:`overlap_count`, :meth:`obstacle_distance` and overlap fields are undefined.

    Parameters
    ----------
    contents : Contents
        Grid, robot, rotations, states and workspace.
    rasters : sequence of (outer, inner) Raster, optional
        The robot's rasters for each slice; computed when needed if left out.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> occupied = np.zeros((80, 60), dtype=bool)
    >>> occupied[40:42, :45] = True
    >>> space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.2))
    >>> space.is_free([(1.0, 1.0), (4.1, 1.0)])
    array([ True, False])
    >>> space.motion_is_free((1.0, 1.0), (7.0, 1.0))
    False
    >>> space.is_connected((1.0, 1.0), (7.0, 1.0)), space.is_disconnected((1.0, 1.0), (7.0, 1.0))
    (True, False)
    >>> round(space.clearance((2.0, 3.0)), 3)
    1.7
    """

    def __init__(
        self,
        contents: Contents,
        rasters: Sequence[tuple[Raster, Raster]] | None = None,
    ) -> None:
        if contents.workspace.live:  # updates of another map write to it
            contents = replace(contents, workspace=copy_workspace(contents.workspace))
        self._contents = contents
        # Updates write to the states of the contents; everything else reads this view.
        self._seen = read_only_of(contents.states)
        self._slice_of = contents.slice_of
        self._lock = Lock()
        if rasters is not None:
            vars(self)["_rasters"] = list(rasters)

    # ---- description -------------------------------------------------------------------------------------------------

    @property
    def workspace(self) -> Workspace:
        """The obstacles, with all updates so far."""
        return self._contents.workspace

    @property
    def _kept(self) -> Contents:
        return self._contents

    @property
    def periodic_axes(self) -> tuple[bool, ...]:
        """Whether each coordinate is a continuous joint's angle.

        Such angles have a period of 2 pi.
        """
        return self._contents.periodic_axes or (False,) * self.size

    @property
    def precision(self) -> str:
        """Arithmetic of the engine.

        It is "integer" for whole numbers, "float32" or "float64" for transforms.
        """
        return self._contents.precision

    @property
    def overlap_counts(self) -> NDArray[np.int32] | None:
        """Overlap count of each cell, by slice.

        The array is read-only. None if the map was built without counts.
        """
        counts = self._contents.overlap_counts
        return None if counts is None else read_only(counts).reshape(self._contents.leading(len(counts)))

    @property
    def cell_states(self) -> NDArray[np.uint8]:
        """State of each cell.

        Its shape is (nx, ny) or (nx, ny, nz), after an axis of rotation cells if the robot rotates. The array is
        read-only. Each access makes a new one if rotation cells share slices or states take two bits.

        Raises
        ------
        InputError
            If a new array does not fit into memory.
        """
        every = self._seen
        if isinstance(every, PackedStates):
            check_bytes(self.grid.size * len(self._slice_of))
            every = read_only(np.asarray(every))
        if len(every) < len(self._slice_of):
            every = read_only(every[self._slice_of])
        return every.reshape(self._contents.leading(len(every)))

    def states_at(self, rotation: ArrayLike = ()) -> NDArray[np.uint8]:
        """Return the state of each cell at a rotation.

        The result has shape (nx, ny) or (nx, ny, nz). Give the rotation as in a configuration: nothing, a yaw in
        radians, or a quaternion.
        """
        part: States = self._seen[
            int(self._slice_of[self.rotations._cells_of(self.rotations._check_rotation(rotation))])
        ]
        return part

    def count(self) -> tuple[int, int, int]:
        """Count the FREE, MIXED and BLOCKED cells over all rotation cells."""
        shares = np.bincount(self._slice_of, minlength=len(self._seen))
        free, mixed, blocked = (shares @ count_states(self._seen)).tolist()
        return free, mixed, blocked

    @property
    def _summary(self) -> str:
        """Counts of the states, for the repr."""
        free, mixed, blocked = self.count()
        return f"{free=}, {mixed=}, {blocked=}"

    @property
    def _facts(self) -> dict[str, object]:
        """Plain values by name that describe the map."""
        grid, rotations, states, field = self.grid, self.rotations, self._seen, self._contents.field
        arrays: list[Any] = [states, *(each for each in (field, self.overlap_counts) if each is not None)]
        measure = f"{('area', 'volume')[grid.dim - 2]}_{grid.measure_unit.replace(' ', '_')}"
        filled = "mean_" * bool(rotations.names) + f"free_{measure}"
        free = count_states(states)[:, FREE][self._slice_of]
        periodic = self._contents.periodic
        mean = float(free @ rotations._volumes / rotations._volumes.sum()) * grid.spacing**grid.dim
        return {
            **({"periodic_axes": periodic.names_among(self.axes)} if periodic else {}),
            **({"slices": len(states)} if rotations.names else {}),
            "workspace": self.workspace.source,
            "cells": dict(zip(STATE_NAMES, self.count(), strict=True)),
            filled: mean,
            "precision": self.precision,
            "overlap_counts": self.overlap_counts is not None,
            **({"overlap_field": True} if field is not None else {}),
            "memory_bytes": sum(array.nbytes for array in arrays),
        }

    def __reduce__(self) -> tuple[type[CSpace], tuple[Contents]]:
        """Copy or pickle the contents of the map, without caches and locks."""
        with self._lock:  # an update waits
            return type(self), (self._contents.copy(),)

    # ---- one configuration -------------------------------------------------------------------------------------------

    @overload
    def overlap_count(self, q: Configuration) -> int: ...  # type: ignore[overload-overlap]
    @overload
    def overlap_count(self, q: ConfigurationBatch) -> Ints: ...
    def overlap_count(self, q: ArrayLike) -> int | Ints:
        """Count the cells in which robot and obstacles overlap.

        The cells are those of their outer rasters. In the grid, the count is zero if and only if the configuration is
        FREE, and it grows with the depth of the collision; times ``spacing**d`` it is an area or a volume. Cells
        outside the workspace count if ``outside="blocked"``. The robot's rows are summed at each configuration; no
        stored counts are needed.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        int or ndarray of int64, shape (...)
        """
        return self._sum("outer", q)

    @overload
    def contains_robot(self, q: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def contains_robot(self, q: ConfigurationBatch) -> Bools: ...
    def contains_robot(self, q: ArrayLike) -> bool | Bools:
        """Return True if the robot is proven to lie inside the obstacles.

        Use it for packing: if the obstacles are a cavity or a sheet of material, True means that the robot fits there,
        margin included. False means that this is not proven at this resolution.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        with self._lock:  # the sums are consistent only before and after an update
            sums = np.asarray(self._sum("inner", q))
        counts = np.array([outer.count for outer, _ in self._rasters])
        inside: Bools = sums == counts[self._slice_of[self.rotations._cells_of(np.asarray(q, dtype=np.float64))]]
        return inside if inside.ndim else bool(inside)

    def obstacle_distance(self, q: ArrayLike, lengths: ArrayLike = 0.0, turns: ArrayLike = 0.0) -> float:
        """Return a lower bound of the distance from obstacles.

        It bounds the smallest distance of the robot over all given configurations. The distance is between the robot
        without margin and the current obstacles: their shapes if the map has them, otherwise the outer cells, and the
        boundary of the grid unless the outside is free.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Configurations, or the centers of pieces of a path; metres, and radians.
        lengths, turns : array-like, shape () or (...)
            Length and rotation of each piece, metres and radians. The bound holds for all configurations within half of
            them from the center.

        Returns
        -------
        float
            Metres; infinite without obstacles, and zero if a configuration is not proven free.

        Raises
        ------
        InputError
            If the interior of a mesh depends on the spacing, or an argument is invalid.
        """
        from cspace.map.points import classify_few

        self._refuse_periodic("obstacle_distance", "use the ArmSpace of the arm")
        points = as_points(q, "q", self.size)
        rows, spans = as_contiguous(points.reshape(-1, self.size)), list[Floats]()
        for name, given in (("lengths", lengths), ("turns", turns)):
            along = check_finite(given, name)
            if along.shape not in ((), points.shape[:-1]) or (along < 0.0).any():
                hint = "pass one number, or one per configuration"
                raise InputError(name, f"is {given!r}", "it must be zero or above", hint, value=given)
            spans.append(np.full(points.shape[:-1], along).ravel())
        states = np.empty(len(rows), dtype=np.uint8)
        if classify_few(self._kernel_map, rows, states) >= 0:
            self._check_configurations(points)  # raises
        left = rows[states != FREE]
        if len(left) and not all(itertools.starmap(self.point_checker(exact=True), left.tolist())):
            return 0.0
        return self._exact.distance(rows, *spans)

    # ---- for callbacks -----------------------------------------------------------------------------------------------

    def point_checker(self, *, exact: bool = False) -> Callable[..., bool]:
        """Return a fast ``is_free`` of floats, for callbacks.

        Parameters
        ----------
        exact : bool
            As for :meth:`is_free`.

        Returns
        -------
        callable
            ``check(*q) -> bool``. Takes the coordinates as floats; returns False for NaN or infinite input.
        """
        check = self._exact.point_checker(self._point_checker) if exact else self._point_checker
        return with_wrapped_angles(check, self.periodic_axes)

    def edge_checker(self, *, exact: bool = False) -> Callable[..., bool]:
        """Return a fast ``motion_is_free`` of floats, for callbacks.

        Parameters
        ----------
        exact : bool
            As for :meth:`motion_is_free`.

        Returns
        -------
        callable
            ``check(*q0, *q1) -> bool``. Takes the coordinates of both configurations as floats; returns False for NaN
            or infinite input.
        """
        check = self._exact.edge_checker(self._edge_checker) if exact else self._edge_checker
        return with_wrapped_angles(check, self.periodic_axes)

    def clearance_checker(self) -> Callable[..., float]:
        """Return a fast ``clearance`` of floats, for callbacks.

        Returns
        -------
        callable
            ``check(*q) -> float``. Takes the coordinates as finite floats, without a check.
        """
        from cspace.map.clearance import checker

        return with_wrapped_angles(checker(self._kernel_map, self._live_marks, self.size), self.periodic_axes)

    # ---- paths through FREE cells ------------------------------------------------------------------------------------

    def reachable_bounds(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """Return the bounding box of the reachable FREE cells.

        They are connected to the configuration through FREE cells. No path through FREE cells of the grid leaves the
        box, so that a planner need not sample outside of it.

        Parameters
        ----------
        q : array-like, shape (size,)
            Metres, and radians.

        Returns
        -------
        lower, upper : ndarray of float64, shape (d,)
            Corners in the plane or in space, metres.

        Raises
        ------
        ConfigurationError
            If the configuration is not FREE, or not in the grid.
        """
        with self._lock:  # an update changes the components
            first, last = self._components.box(self._cells_of(self._in_grid(q, "q", free=True)))
        lower = np.asarray(self.grid.lower)
        return lower + self.grid.spacing * first, lower + self.grid.spacing * (last + 1)

    def find_path(
        self,
        q0: ArrayLike,
        q1: ArrayLike,
        *,
        straight: bool = True,
        exact: bool = False,
        time_limit: float | None = None,
    ) -> Floats:
        """Find a path through FREE cells, proven free all along.

        A path is found whenever FREE cells of the grid join the two configurations. It is deterministic. In the plane
        it is the shortest path through FREE cells, to within 1e-5 cells for each corner (Harabor and others, JAIR
        2016). In other spaces it is a short one: it follows a short chain of cells, which a search of coarser copies of
        the map guides (Hart, Nilsson and Raphael 1968), and is then shortened. A radian of rotation counts as half a
        metre.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,)
            FREE configurations in the grid; with ``exact``, free ones.
        straight : bool
            If False, return the chain of cells without shortening it.
        exact : bool
            Whether the path may cross MIXED cells where the geometry itself proves it free. The search decides the
            centers of MIXED cells near its chain and repeats, until geometry proves all edges of a path, or no chain
            left promises a shorter path than the one through FREE cells. On a map with periodic axes, geometry only
            shortens the path through FREE cells.
        time_limit : float, optional
            Seconds after which the search gives up; compiling does not count. No limit by default.

        Returns
        -------
        ndarray of float64, shape (n, size)
            Waypoints from q0 to q1, with each motion between two proven free and yaw in [-pi, pi). Of length 0 if FREE
            cells do not join the two, if one of them is on the boundary of a cell that is not FREE, or if time runs
            out.

        Raises
        ------
        ConfigurationError
            If a configuration is not FREE, or not in the grid; with ``exact``, if the geometry does not prove it free.
        InputError
            If a coordinate is not finite, the time limit is not above zero, or ``exact`` is set for a map without
            geometry.
        """
        check_flag(exact, "exact")
        search = self._exact_path if exact else self._free_path
        return self._in_time(search, q0, q1, straight, time_limit)

    def _in_time(
        self,
        search: Callable[[ArrayLike, ArrayLike, bool, float], Floats],
        q0: ArrayLike,
        q1: ArrayLike,
        straight: bool,
        time_limit: float | None,
    ) -> Floats:
        """Return the path of a search with a time limit.

        Its length is 0 if time runs out.
        """
        seconds = math.inf if time_limit is None else check_positive(time_limit, "time_limit", "seconds")
        try:
            path = search(q0, q1, straight, seconds)
        except TimeoutError:
            return np.empty((0, self.size))
        periodic = self._contents.periodic
        return periodic.begin_at(path, np.asarray(q0, dtype=np.float64)) if periodic else path

    def _free_path(self, q0: ArrayLike, q1: ArrayLike, straight: bool, seconds: float) -> Floats:
        """Find a path as :meth:`find_path`; raise TimeoutError if time runs out."""
        from cspace.map.paths import path_length

        dim = self.grid.dim
        endpoints = np.stack([self._in_grid(q, name, free=True) for q, name in ((q0, "q0"), (q1, "q1"))])
        still = not self.rotations._steps_between(*endpoints)[dim:].any()
        if still:
            endpoints[1, dim:] = endpoints[0, dim:]  # the same rotation may be given in other numbers, e.g. other signs
        if not straight or any(self.periodic_axes):
            return self._path_along_chain(endpoints, straight, seconds)
        if self.edge_checker()(*endpoints[0], *endpoints[1]):
            return endpoints
        until, neighbors, paths = clock() + seconds, self.rotations._neighbors, []
        if dim == 2 and still:
            paths.append(
                self._shortest_in_slice(endpoints, int(self._slice_of[self._cells_of(endpoints[0])[0]]), until)
            )
        if neighbors.size or not paths or not len(paths[0]):
            paths.append(self._path_along_chain(endpoints, straight, until - clock()))
        found = [path for path in paths if len(path)]
        return min(found, key=partial(path_length, rotations=self.rotations), default=endpoints[:0])

    def _exact_path(self, q0: ArrayLike, q1: ArrayLike, straight: bool, seconds: float) -> Floats:
        """Find a path as :meth:`find_path` with ``exact``.

        Raises TimeoutError if time runs out before any is found.
        """
        from cspace.map.paths import in_time, path_length, pulled_straight

        endpoints = np.stack([self._in_grid(q, name, free=True, exact=True) for q, name in ((q0, "q0"), (q1, "q1"))])
        until, rotations, check = clock() + seconds, self.rotations, self.edge_checker(exact=True)
        if straight and check(*endpoints[0], *endpoints[1]):
            return endpoints
        through_free = endpoints[:0]
        if np.all(self.is_free(endpoints)):
            through_free = self._free_path(endpoints[0], endpoints[1], straight, seconds)
        paths = [through_free]
        if not any(self.periodic_axes):
            max_length = path_length(through_free, rotations) if len(through_free) else math.inf
            paths.append(self._path_through_mixed(endpoints, check, max_length, until))
        if straight:
            checked = in_time(below_half_a_turn(check, self.periodic_axes), until)
            paths = [pulled_straight(path, rotations, checked) if len(path) else path for path in paths]
        found = [path for path in paths if len(path)]
        return min(found, key=partial(path_length, rotations=rotations), default=endpoints[:0])

    def _path_through_mixed(
        self, endpoints: Floats, check: Callable[..., bool], max_length: float, until: float
    ) -> Floats:
        """Return the path of :class:`cspace.map.undecided.Undecided`, whose edges pass ``check``."""
        from cspace.map.undecided import UNDECIDED_BYTES_PER_CELL, Undecided

        check_bytes(UNDECIDED_BYTES_PER_CELL * self.grid.size * len(self.rotations))
        # One array for each rotation cell, because geometry decides each on its own.
        states = self.cell_states.reshape(-1, *self.grid.shape)
        search = Undecided(
            self.grid,
            self.rotations,
            states,
            self._turn_costs,
            lambda q: np.asarray(self.is_free(q, exact=True)),
            check,
        )
        return search.find(endpoints, self._cells_of(endpoints), max_length, until)

    def _path_along_chain(
        self,
        endpoints: Floats,
        straight: bool,
        seconds: float,
        levels: Levels | None = None,
        factors: Costs | None = None,
        cost: Callable[..., float] | None = None,
    ) -> Floats:
        """Return a path along a short chain of cells.

        It is shortened if ``straight``. With ``levels`` of clearance, the length of a move is multiplied by the factor
        of its cells' level, and ``cost`` is that of an edge.
        """
        from cspace.map.paths import in_time, pulled_straight, unwind, waypoints
        from cspace.map.search import GREEDY_WEIGHT, MAX_COSTED_CELLS, NO_FACTORS, SHORT_WEIGHT, CellFactors, Graph

        dim, rotations = self.grid.dim, self.rotations
        periodic = self.periodic_axes[:dim]
        by_cell = NO_FACTORS if levels is None or factors is None else CellFactors(levels.reshape(-1), factors)
        guides = [] if any(periodic) else self._guides.all(levels, by_cell.of_level)
        until = clock() + seconds
        graph = Graph.of(self._seen, self._slice_of, rotations._neighbors, self._turn_costs, periodic, by_cell)
        weight = SHORT_WEIGHT if self.grid.size * len(rotations) <= MAX_COSTED_CELLS else GREEDY_WEIGHT
        first, last = self._cells_of(endpoints)
        cells = graph.chain(first, last, until, greed=weight, guides=guides)
        if not len(cells):
            return np.empty((0, self.size))
        cells = unwind(cells, self.grid.shape, periodic)
        path = waypoints(self.grid, rotations, endpoints, cells, periodic)
        if (endpoints[0, dim:] == endpoints[1, dim:]).all() and (cells[:, 0] == cells[0, 0]).all():
            path[:, dim:] = endpoints[0, dim:]  # without turning to the center of the rotation cell
        if not self.certify_path(path).all():
            return np.empty((0, self.size))
        check = in_time(below_half_a_turn(self.edge_checker(), self.periodic_axes), until)
        return pulled_straight(path, rotations, check, cost) if straight else path

    def _cheapest_path(
        self,
        q0: ArrayLike,
        q1: ArrayLike,
        straight: bool,
        seconds: float,
        factor_at: Callable[[Floats], Floats],
        cost: Callable[..., float],
    ) -> Floats:
        """Find a path of low cost, at most that of the path of :meth:`find_path`, as :meth:`_free_path`.

        ``factor_at`` returns the cost of a metre at clearances, shape (n,), in metres; it does not increase. ``cost``
        integrates it along an edge, given by the coordinates of two configurations.
        """
        from cspace.map.paths import edge_costs, in_time, pulled_straight
        from cspace.map.widest import LEVELS_PER_CELL, MAX_LEVEL

        endpoints = np.stack([self._in_grid(q, name, free=True) for q, name in ((q0, "q0"), (q1, "q1"))])
        levels = self._update_clearance_levels().levels
        clearances = np.arange(MAX_LEVEL + 1, dtype=np.float64) * (self.grid.spacing / LEVELS_PER_CELL)
        factors = factor_at(clearances).astype(np.float32)
        until = clock() + seconds
        paths = [self._free_path(endpoints[0], endpoints[1], straight, seconds)]
        if straight and len(paths[0]):
            check = in_time(below_half_a_turn(self.edge_checker(), self.periodic_axes), until)
            paths.append(pulled_straight(paths[0], self.rotations, check, cost))
        with suppress(TimeoutError):
            paths.append(self._path_along_chain(endpoints, straight, until - clock(), levels, factors, cost))
        found = [path for path in paths if len(path)]
        return min(found, key=lambda path: float(edge_costs(path, cost).sum()), default=endpoints[:0])

    def _shortest_in_slice(self, endpoints: Floats, number: int, until: float) -> Floats:
        """Return the shortest path in a slice.

        The slice is one of a plane map. The path is moved away from corners, so that each edge is certified. Its length
        is 0 if there is none, or if its corners cannot be pushed far enough.
        """
        from cspace.map.any_angle import push_from_corners, shortest_path

        grid, shape = self.grid, (self.grid.shape[0], self.grid.shape[1])
        where = cells_of(self._seen), number * grid.size, shape
        start, goal = (endpoints[:, :2] - grid.lower) / grid.spacing
        path = shortest_path(*where, start, goal, until)
        for also in (False, True):
            if len(path):
                points = grid.lower + grid.spacing * push_from_corners(*where, path, also)
                points[[0, -1]] = endpoints[:, :2]
                pushed = np.column_stack([points, np.tile(endpoints[0, 2:], (len(points), 1))])
                if self.certify_path(pushed).all():
                    return pushed
        return np.empty((0, self.size))

    def min_path_length(self, q0: ArrayLike, q1: ArrayLike) -> float:
        """Bound the length of every collision-free path between two configurations from below.

        A point that is BLOCKED at all rotations is on no path, within the grid or outside. In the plane, the bound is
        the length of the shortest path among the other points. In space, it is the largest of three such lengths, of
        projections along each axis, extended by the difference along that axis. Rotations count nothing.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,)
            Configurations in the grid.

        Returns
        -------
        float
            Metres; infinity if BLOCKED cells separate the two. On a map with periodic axes, the straight distance.

        Raises
        ------
        InputError
            If a coordinate is not finite.
        ConfigurationError
            If a configuration is not in the grid.
        """
        from cspace.map.any_angle import min_length
        from cspace.map.search import Coarse

        grid, endpoints = self.grid, np.stack([self._in_grid(q, name) for q, name in ((q0, "q0"), (q1, "q1"))])
        positions = endpoints[:, : grid.dim]
        if any(self.periodic_axes):
            return float(np.linalg.norm(shorter(positions[1] - positions[0], self.periodic_axes)))
        one_group = np.zeros_like(self._slice_of)
        lowest = Coarse(cells_of(self._seen), self._slice_of, grid.shape, one_group, 1).states[0]
        is_open = not self._exterior.is_all_blocked(grid.shape).all()
        return grid.spacing * min_length(lowest, is_open, *((positions - grid.lower) / grid.spacing))

    def find_widest_path(
        self, q0: ArrayLike, q1: ArrayLike, *, straight: bool = True, time_limit: float | None = None
    ) -> Floats:
        """Find a shortest path among those of the largest possible clearance.

        Among all chains of FREE cells that join the two, rotating on the spot between rotation cells, the smallest
        clearance of the chain is the largest possible. If start or goal has less clearance, the path leaves it by
        steepest ascent of clearance, so that the endpoints do not limit the rest. The chain between is a shortest one,
        counting a radian as half a metre, and is then shortened without losing clearance. The path is deterministic.

        Clearance is :meth:`clearance` at the centers of cells, rounded down to a 64th of a cell and limited to 1024
        cells; between centers, it may be less by half a cell's diagonal. Chains stay in the grid, also if the outside
        is free.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,)
            FREE configurations in the grid.
        straight : bool
            If False, return the chain of cells without shortening it.
        time_limit : float, optional
            Seconds after which the search gives up; compiling and arrays that the map caches do not count. No limit by
            default.

        Returns
        -------
        ndarray of float64, shape (n, size)
            Waypoints from q0 to q1, with each motion between two proven free and yaw in [-pi, pi). Of length 0 if FREE
            cells do not join the two, if one of them is on the boundary of a cell that is not FREE, or if time runs
            out.

        Raises
        ------
        ConfigurationError
            If a configuration is not FREE, or not in the grid.
        InputError
            If a coordinate is not finite, the time limit is not above zero, or the search does not fit into memory.
        """
        return self._in_time(self._widest_path, q0, q1, straight, time_limit)

    def _widest_path(self, q0: ArrayLike, q1: ArrayLike, straight: bool, seconds: float) -> Floats:
        """Find a path as :meth:`find_widest_path`; raise TimeoutError if time runs out."""
        from cspace.map.widest import find_widest_path

        endpoints = np.stack([self._in_grid(q, name, free=True) for q, name in ((q0, "q0"), (q1, "q1"))])
        widest, kernel_map = self._update_clearance_levels(), self._grid_kernel_map
        until = clock() + seconds
        both = endpoints, self._cells_of(endpoints)
        join = partial(self._components_of, exterior_open=np.zeros(len(self._seen), dtype=np.bool_))
        path = find_widest_path(widest, kernel_map, self.grid, both, join, straight, until)
        return path if len(path) and self.certify_path(path).all() else path[:0]

    def _update_clearance_levels(self) -> Widest:
        """Return the levels of all cells after the last update; raise InputError if they do not fit into memory."""
        from cspace.map.widest import WIDEST_BYTES_PER_CELL

        # Levels cover the unrolled map: half a period more at either end of a periodic axis.
        cells = self.grid.size * len(self.rotations) * 2 ** sum(self.periodic_axes)
        needed, fewer = WIDEST_BYTES_PER_CELL * cells, self.rotations._argument_for_fewer
        check_memory(needed, "the map, with the clearance of its cells,", self.grid, fewer=fewer)
        with self._lock:
            # A new object, because searches in other threads may still read the old levels.
            widest = vars(self)["_clearance_levels"] = self._clearance_levels.updated(self._grid_kernel_map, self._seen)
        return widest

    # ---- the set of FREE configurations ------------------------------------------------------------------------------

    @overload
    def sample_free(self, n: None = None, rng: np.random.Generator | None = None) -> Floats: ...
    @overload
    def sample_free(self, n: int, rng: np.random.Generator | None = None) -> Floats: ...
    def sample_free(self, n: int | None = None, rng: np.random.Generator | None = None) -> Floats:
        """Draw configurations uniformly from the FREE cells.

        Parameters
        ----------
        n : int, optional
            Number of configurations; if left out, one without a batch axis.
        rng : numpy.random.Generator, optional
            Source of randomness; by default a new ``numpy.random.default_rng()`` at each call.

        Returns
        -------
        ndarray of float64, shape (n, size), or (size,)
            Metres, and radians; yaw, and angles of continuous joints, in [-pi, pi), as OMPL's bounds require.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        InputError
            If ``n`` is negative or ``rng`` is neither None nor a Generator.
        """
        from cspace.map.sampling import sample

        count = 1 if n is None else check_count(n, "n")
        generator = check_rng(rng)
        free = self._free_cells
        if not free.counts.any():
            raise self._nothing_free()
        samples = sample(free, self._slice_of, self.rotations, self.grid, count, generator)
        return samples[0] if n is None else samples

    def nearest_free(self, q: ArrayLike) -> Floats:
        """Return the center of the FREE cell nearest to a configuration.

        Parameters
        ----------
        q : array-like, shape (size,)
            Metres and radians, inside the grid or not. A radian counts as half a metre, as in OMPL's SE(2).

        Returns
        -------
        ndarray of float64, shape (size,)
            Metres, and radians; yaw, and angles of continuous joints, in [-pi, pi), as OMPL's bounds require.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        """
        from cspace.map.sampling import nearest

        periodic = self._contents.periodic
        if periodic:
            wrapped = periodic._make_canonical(as_points(q, "q", self.size))
            return periodic._make_canonical(self._unrolled.nearest_free(wrapped))
        point = self._check_configurations(q, "q")
        if point.ndim != 1:
            rule = f"it must be one configuration, shape ({self.size},)"
            raise InputError("q", f"has shape {point.shape}", rule, "pass one configuration at a time", value=q)
        center = nearest(self._seen, self._slice_of, self.rotations, self.grid, point)
        if center is None:
            raise self._nothing_free()
        return center

    def _nothing_free(self) -> ConfigurationError:
        """Return the error for a map without FREE cells."""
        hint = "use a smaller robot, a finer spacing, or unknown='free' for a sensor map"
        return ConfigurationError("the map", "has no FREE cell", "no configuration can be drawn", hint)

    # ---- updates -----------------------------------------------------------------------------------------------------

    def update(self, cells: ArrayLike, lower: Sequence[int], *, inner: ArrayLike | None = None) -> Update:
        """Replace a box of workspace cells.

        The map becomes equal to a new build. The cost grows with the box around the cells that differ and with the
        robot, not with the map. Existing checkers (:meth:`point_checker`, :meth:`edge_checker`,
        :meth:`clearance_checker`, and those of the ``planners`` package) follow the update.

        The first update copies the cells of the workspace, so that the :class:`Workspace` passed to the build, and
        other maps of it, do not change. :attr:`workspace` then has the current cells; its ``shapes`` are None, and
        queries with ``exact=True`` use the outer cells instead. Named obstacles (:meth:`add_obstacle`) stay on top. An
        overlap field is dropped, because it belongs to the old obstacles. A map built without ``inner`` gets no BLOCKED
        cells, also after it is saved and opened.

        Caches are refreshed at the next query, except for the counts of FREE cells of :meth:`sample_free` and the
        geometry for ``exact=True``, which are computed anew.

        Updates wait for each other, and for :meth:`is_connected`, :meth:`is_disconnected`, :meth:`reachable_bounds`,
        :meth:`contains_robot`, :meth:`save`, :meth:`export`, copies, pickles and forks. Any other query of another
        thread during an update reads each cell either before or after it; an :meth:`overlap_count` may be neither the
        old nor the new count.

        Parameters
        ----------
        cells : array-like of bool, shape (mx, my) or (mx, my, mz)
            New cells of the box: True if they meet an obstacle; 0 and 1 are accepted.
        lower : sequence of int, shape (d,)
            Index of the first cell of the box, which must lie in the grid.
        inner : array-like of bool, the shape of cells, optional
            True for cells that lie in obstacles; ``cells`` if left out.

        Returns
        -------
        Update
            The box that was computed again, and the number of states that changed.

        Raises
        ------
        InputError
            If an argument is invalid, or a cell is in ``inner`` but not in ``cells``; nothing changes then.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
        >>> space.update(np.ones((4, 4), dtype=bool), (18, 13)).changed
        124
        >>> space.is_free([2.0, 1.5])
        False
        """
        from cspace.update import Patch

        self._check_whole()
        patch = Patch.of(self.grid, cells, lower, inner)
        with self._lock:
            return self._updates.update(patch)

    def add_obstacle(self, name: str, shape: ShapeLike, *, radius: ArrayLike | None = None) -> Update:
        """Add a named obstacle, or move it, and update the map.

        The map becomes equal to a build with the base of the workspace and all named obstacles. An obstacle replaces
        the one of the same name, and the cells that it covered reappear. Obstacles may overlap. They are clipped to the
        grid; one that lies outside keeps its name and changes nothing.

        Queries with ``exact=True`` use the shape of the obstacle, not its cells. :meth:`update` changes the base, below
        all named obstacles; exact queries then use the cells of the base. All else is as for :meth:`update`. A move
        farther than the robot's size is two changes, the new position first, so that other threads may see the obstacle
        at both positions, but never at neither.

        Copies and pickles keep the names. A saved map keeps the obstacles without names, so that they can no longer be
        moved after it is opened.

        Parameters
        ----------
        name : str
        shape : shape, or array-like, shape (n, 2) or (n, 3)
            Metres, in the map's frame. In the plane what :meth:`Workspace.from_polygons` takes, such as a shapely
            geometry, or three or more corners of a polygon; in space a mesh, as :meth:`Workspace.from_mesh` takes, such
            as a ``trimesh.Trimesh``; in both points with their ``radius``, a decomposition into balls, a shape of
            ``cspace.shapes``, a robot, or the short text of one, such as ``"ellipse:0.5,0.3@2,1"``. The reference point
            of a robot is then the origin of the map.
        radius : array-like, shape () or (n,), optional
            Radius of the balls around points, metres, zero or above.

        Returns
        -------
        Update

        Raises
        ------
        InputError
            If the name is empty or no string, or the obstacle is of another type or dimension, has points without a
            radius, or is so far away that rounding could matter; nothing changes then. A :class:`GeometryError` if it
            is empty, not finite, or a polygon that crosses itself.

        Examples
        --------
        >>> import numpy as np, shapely, cspace
        >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
        >>> space.add_obstacle("cart", shapely.box(1.8, 1.3, 2.2, 1.7)).changed
        176
        >>> space.add_obstacle("people", [(1.0, 1.0), (3.0, 2.0)], radius=0.25).changed
        262
        >>> space.remove_obstacle("cart").changed
        130
        >>> list(space.obstacles)
        ['people']
        """
        if not isinstance(name, str) or not name:
            raise InputError("name", f"is {name!r}", "it must be a non-empty string", 'pass e.g. "cart"', value=name)
        self._check_whole()
        obstacle = as_shape(shape, radius, "shape")
        if obstacle.dim != self.grid.dim:
            rule = f"it must be in {('the plane', 'space')[self.grid.dim - 2]}, as the map is"
            raise InputError("shape", f"is in {obstacle.place}", rule, "pass another shape", value=shape)
        with self._lock:
            return self._updates.set_obstacle(name, obstacle)

    def remove_obstacle(self, name: str) -> Update:
        """Remove a named obstacle; the cells that it covered reappear.

        Parameters
        ----------
        name : str

        Returns
        -------
        Update

        Raises
        ------
        InputError
            If there is no obstacle of that name.
        """
        with self._lock:
            named = self.obstacles
            if name not in named:
                rule = f"it must be one of {', '.join(map(repr, named))}" if named else "there is no named obstacle"
                raise InputError("name", f"is {name!r}", rule, "see space.obstacles for the names", value=name)
            return self._updates.set_obstacle(name, None)

    @property
    def obstacles(self) -> dict[str, Shape]:
        """The named obstacles at their current positions; a copy."""
        with self._lock:
            layers = self._contents.layers
            return {} if layers is None else {name: each.shape for name, each in layers.named.items()}

    @lazy
    def _updates(self) -> Updater:
        """Updater of the states."""
        from cspace.update import Updater

        return Updater(self._contents, self._rasters, self._exterior, self._refresh)

    def _check_whole(self) -> None:
        """Raise ConfigurationError if the map is a window of a larger one."""
        if self.outside == UNKNOWN:
            rule, hint = "the cells around it matter too", "update the larger map and open the window again"
            raise ConfigurationError("the map", "is a window of a larger one", rule, hint)

    def _refresh(self, change: Change) -> None:
        """Refresh all caches after the states and the exterior changed in place."""
        contents = self._contents
        same = contents.workspace is change.workspace and contents.layers is change.layers
        if not same or contents.field is not None or contents.prove is not None:
            # Overlap fields and the arm of a joint map belong to the obstacles before the update.
            self._contents = replace(contents, workspace=change.workspace, layers=change.layers, field=None, prove=None)
        CSpace._outer_sums.refresh(self, change.workspace.outer, change.cells)
        CSpace._inner_sums.refresh(self, change.workspace.inner, change.cells)
        if change.changed:
            CSpace._free_cells.drop(self)
            for part in (CSpace._mip, CSpace._clearance_levels, CSpace._inflation, CSpace._components, CSpace._guides):
                part.refresh(self, change.states)
        unrolled, periodic = CSpace._with_other_turns.cached(self), contents.periodic
        if unrolled is not None:
            dim, workspace = self.grid.dim, change.workspace
            for first, box in periodic.appearances(change.cells[3 - dim : 3], change.cells[6 - dim :]):
                unrolled.update(workspace.outer[box], first.tolist(), inner=workspace.inner[box])
        CSpace._exact.refresh(self, self._problem)

    # ---- overlap fields ----------------------------------------------------------------------------------------------

    def with_overlap_field(self, overlap: FourierOverlap) -> CSpace:
        """Return a copy of the map with an overlap field.

        The field has the overlap at the center of each cell. It is saved and exported with the map;
        :class:`planners.OverlapObjective` uses it.

        Parameters
        ----------
        overlap : cspace.spectral.FourierOverlap
            Overlap of the robot's balls, in the robot's frame, with the obstacles' balls, in the map's frame.

        Raises
        ------
        InputError
            If the overlap is in the plane and the map is in space, or the other way around, or memory is too small.
        MissingPackageError
            If finufft is needed, for many balls of one radius, and is not installed.
        """
        from cspace.spectral.overlap import OverlapField

        self._refuse_periodic("overlap_field", "use the ArmSpace of the arm")
        values = OverlapField.of(self, overlap).values
        with self._lock:  # an update waits
            return CSpace(replace(self._contents.copy(), field=values), self._rasters)

    @property
    def overlap_field(self) -> OverlapField | None:
        """Overlap field of the map, or None.

        It has the overlap of the robot's balls with the obstacles' at the center of each cell.
        """
        from cspace.spectral.overlap import OverlapField

        values = self._contents.field
        return None if values is None else OverlapField(self, values)

    # ---- for files and messages --------------------------------------------------------------------------------------

    def _write(self, write: Callable[[Contents], None], *, exterior: bool = False) -> None:
        """Call ``write`` with the contents of the map.

        No update runs meanwhile. With ``exterior``, the exterior's states are included.
        """
        with self._lock:
            write(replace(self._contents, exterior=self._exterior) if exterior else self._contents)

    def _inflated(self, limit: float, number: int | None) -> Floats:
        """Return the clearance at each cell's center.

        It is in cells, in one slice or the largest of all slices. Values above ``limit`` become infinite.
        """
        from cspace.map.clearance import slice_clearances

        whole, periodic = self._unrolled, self._contents.periodic
        if number is None:
            clearances = whole._inflation.clearances(limit)
        else:
            clearances = slice_clearances(whole._seen[number], whole._exterior.table[number], limit)
        return clearances[periodic.center_period] if periodic else clearances

    def _flat_state(self) -> States:
        """Return each cell's state over all rotations.

        It is FREE or BLOCKED if all rotations agree, otherwise MIXED.
        """
        lowest = np.array(self._seen[0])
        highest = lowest.copy()
        for index in range(1, len(self._seen)):
            np.minimum(lowest, self._seen[index], out=lowest)
            np.maximum(highest, self._seen[index], out=highest)
        return np.where(lowest == highest, lowest, MIXED).astype(np.uint8)

    # ---- caches ------------------------------------------------------------------------------------------------------

    @lazy
    def _rasters(self) -> list[tuple[Raster, Raster]]:
        return slice_rasters(self.robot, self.grid.spacing, self.margin, self.rotations)

    @lazy
    def _exterior(self) -> Exterior:
        return self._contents.exterior or Exterior.of(self.workspace.outer, self._rasters, self.outside)

    @property
    def _kernel_map(self) -> Map:
        """The map as input of kernels.

        Periodic axes are unrolled. It follows updates.
        """
        return self._unrolled._grid_kernel_map

    @lazy
    def _grid_kernel_map(self) -> Map:
        """The map as input of compiled functions, without unrolling."""
        grid, rotations = self.grid, self.rotations._compile(self._slice_of)
        return Map(
            kernel_states(self._seen),
            cells_of(self._seen),
            rotations,
            grid.lower,
            grid.spacing,
            grid.upper,
            self._exterior.table,
        )

    @property
    def _unrolled(self) -> CSpace:
        """The map with periodic axes unrolled.

        Periodic axes have half a period more at either end; without such axes, it is the map itself.
        """
        return self._with_other_turns if self._contents.periodic else self

    @lazy
    def _with_other_turns(self) -> CSpace:
        periodic = self._contents.periodic
        return self._unroll(-periodic.padding, self.grid.shape + periodic.padding)

    def _unroll(self, first: Ints, stop: Ints) -> CSpace:
        """Return cells [first, stop) without periodic axes.

        Cells are repeated as needed.
        """
        periodic = self._contents.periodic
        workspace, states = periodic.unroll(self.workspace, np.asarray(self._seen[0]), first, stop)
        return CSpace(Contents(workspace, self.robot, Rotations.of(None), self._slice_of, states[np.newaxis]))

    def _refuse_periodic(self, what: str, hint: str) -> None:
        """Raise InputError if the map has periodic axes.

        ``what`` is undefined for them.
        """
        periodic = self._contents.periodic
        if periodic:
            axes = ", ".join(periodic.names_among(self.axes))
            raise InputError(what, f"is undefined on a map with periodic axes ({axes})", hint=hint)

    @lazy
    def _exact(self) -> ExactQueries:
        """Queries with exact geometry."""
        from cspace.exact.proofs import ExactQueries

        return ExactQueries(self._problem())

    def _problem(self) -> Problem:
        """Return the input of exact queries."""
        from cspace.exact.boundaries import Problem

        exterior_blocked, prove = self.outside != "free", self._contents.prove
        return Problem(
            self._kernel_map, self.rotations, self._unrolled.workspace, self.robot, self.margin, exterior_blocked, prove
        )

    @lazy
    def _components(self) -> Components:
        """Connected components of the map."""
        needed, fewer = COMPONENT_STATE_BYTES * self._seen.size, self.rotations._argument_for_fewer
        check_memory(needed, "the map, to join its cells,", self.grid, fewer=fewer)
        return self._components_of(self._seen, ~self._exterior.is_all_blocked(self.grid.shape))

    def _components_of(self, states: Stack, exterior_open: Bools) -> Components:
        """Label the connected components of states.

        Cells are joined through the exterior of open slices too.
        """
        from cspace.map.components import Components, PeriodicComponents

        of_slices = states, self._slice_of, self.rotations._neighbors, exterior_open
        return PeriodicComponents(*of_slices, self.periodic_axes) if self._contents.periodic else Components(*of_slices)

    def _guess_connectivity(self, cells: Ints) -> tuple[bool, Callable[[], bool]]:
        """Guess whether two cells are disconnected; see the base class."""
        return self._components.hint(cells)

    @property
    def _live_marks(self) -> OccupancyBits:
        """Occupancy bits as input of compiled functions of clearance; they follow updates."""
        return self._marks(cells=True, eager=True)

    def _marks(self, *, cells: bool, eager: bool = False) -> OccupancyBits:
        """Return the bits of cells that are not FREE; see :meth:`cspace.map.mip.OccupancyPyramid.marks`."""
        return self._unrolled._mip.marks(cells, eager)

    @lazy
    def _mip(self) -> OccupancyPyramid:
        """Pyramid of cells that are not FREE."""
        from cspace.map.mip import OccupancyPyramid

        return OccupancyPyramid(self._seen, self._lock)

    @lazy
    def _runs(self) -> Runs:
        """Runs of the outer rasters."""
        from cspace.map.overlaps import Runs

        return Runs.of([outer for outer, _ in self._rasters])

    @lazy
    def _outer_sums(self) -> Sums:
        """Sums of the outer cells, for overlap counts."""
        from cspace.map.overlaps import Sums

        return Sums(self.workspace.outer)

    @lazy
    def _inner_sums(self) -> Sums:
        """Sums of the inner cells, for overlap counts."""
        from cspace.map.overlaps import Sums

        return Sums(self.workspace.inner)

    @lazy
    def _free_cells(self) -> FreeCells:
        """FREE cells, for sampling."""
        from cspace.map.sampling import FreeCells

        return FreeCells(self._seen)

    @lazy
    def _turn_costs(self) -> Floats:
        """Cost of rotating to neighboring rotation cells, in cells."""
        from cspace.map.search import turn_costs

        return turn_costs(self.rotations, self.grid.dim, self.grid.spacing)

    @lazy
    def _guides(self) -> Guides:
        """Coarse copies of the map that guide searches."""
        from cspace.map.search import Guides

        return Guides(self._seen, self._slice_of, self.rotations._neighbors, self._turn_costs)

    @lazy
    def _clearance_levels(self) -> Widest:
        """Clearance levels of all cells, and searches for widest paths over them; computed at first access."""
        from cspace.map.widest import Widest

        return Widest.of(self._grid_kernel_map, self._seen, self.rotations, self.periodic_axes[: self.grid.dim])

    @lazy
    def _inflation(self) -> Inflation:
        """Clearances for costmaps."""
        from cspace.map.clearance import Inflation

        return Inflation(self._seen, self._exterior.table, self._lock)

    @lazy
    def _point_checker(self) -> Callable[..., bool]:
        """Fast test of configurations."""
        from cspace.map.callbacks import point_checker

        return point_checker(self._kernel_map, self.size)

    @lazy
    def _edge_checker(self) -> Callable[..., bool]:
        """Fast test of edges."""
        from cspace.map.callbacks import edge_checker

        return edge_checker(self._kernel_map, self.size)

    def _cells_of(self, points: Floats) -> Ints:
        """Return the cells of configurations, wrapped along periodic axes."""
        periodic = self._contents.periodic
        if not periodic:
            return super()._cells_of(points)
        return np.insert(periodic.cells_in_turn(self._unrolled.grid, points), 0, 0, axis=-1)

    @lazy
    def _backend(self) -> MemoryBackend:
        """Backend of the queries."""
        return MemoryBackend(self._kernel_map, self._contents.periodic, self._lock)

    # ---- kernels and checks ------------------------------------------------------------------------------------------

    def _clearances(self) -> Query:
        """Return the query that computes clearances."""
        from cspace.map.clearance import clearances

        query = self._backend.query(clearances, self._marks(cells=True))
        return in_spatial_order(query, self.grid.lower, self.grid.upper)

    def _blocks(self, number: int) -> Words | None:
        """Return the occupancy bits of blocks, if useful.

        They are useful if they pay off for a ``number`` of edges.
        """
        from cspace.map.mip import MAX_CELLS_PER_EDGE

        if CSpace._mip.cached(self._unrolled) is None and number * MAX_CELLS_PER_EDGE < self._seen.size:
            return None
        return self._marks(cells=False).blocks

    def _sum(self, side: Literal["outer", "inner"], q: ArrayLike) -> int | Ints:
        """Count the overlaps of the robot with outer or inner cells."""
        from cspace.map.overlaps import overlaps

        self._refuse_periodic("overlap_count", "use classify()")
        # An unknown exterior counts as occupied in the outer sum and as free in the inner sum.
        exterior_blocked = self.outside != "free" if side == "outer" else self.outside == "blocked"
        workspace = self.workspace
        outer = side == "outer" or workspace.inner is workspace.outer
        sums = self._outer_sums if outer else self._inner_sums
        query = self._backend.query(overlaps, sums.counts, self._runs, int(exterior_blocked))
        return evaluate_batch(q, self.size, query, np.int64, int, angles=self._angles)

    def _in_grid(self, q: ArrayLike, name: str, *, free: bool = False, exact: bool = False) -> Floats:
        """Return one configuration in the grid, its yaw in [-pi, pi).

        With ``free`` it must be FREE, or with ``exact`` proven free by geometry. Raises ConfigurationError otherwise.
        """
        point = self.rotations._make_canonical(self._check_configurations(q, name), name)
        is_inside = point.ndim == 1 and self.grid.contains(point[: self.grid.dim])
        if not is_inside or (free and not self.is_free(point, exact=exact)):
            kind = ("free " if exact else "FREE ") if free else ""
            hint = "ask nearest_free for one" if free else "ask grid.lower and grid.upper"
            raise ConfigurationError(
                name, f"is {q!r}", f"it must be one {kind}configuration in the grid", hint, value=q
            )
        return point
