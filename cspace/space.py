"""CSpace: the map of a robot's configurations, and all look-ups in it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import FREE, MIXED, STATE_NAMES, Bools, Floats, Ints, States, Words
from cspace.check import check_count, check_finite, check_positive, check_rng
from cspace.compiling import clock
from cspace.configuration_map import ConfigurationMap
from cspace.engines.slices import slice_rasters
from cspace.errors import ConfigurationError, InputError
from cspace.limits import COMPONENT_STATE_BYTES, check_memory
from cspace.map.backend import MemoryBackend
from cspace.map.batches import (
    Configuration,
    ConfigurationBatch,
    Query,
    as_contiguous,
    as_points,
    evaluate_batch,
    in_spatial_order,
)
from cspace.map.contents import Contents
from cspace.map.derived import Lock, lazy
from cspace.map.exterior import UNKNOWN, Exterior
from cspace.map.periodic import below_half_a_turn, with_wrapped_angles
from cspace.map.storage import (
    Map,
    PackedStates,
    Stack,
    cells_of,
    check_bytes,
    counts_of,
    read_only,
    read_only_of,
    record_of,
)
from cspace.raster import Raster
from cspace.rotations import Rotations
from cspace.shapes import Shape, ShapeLike, as_shape
from cspace.shown import MapExport
from cspace.workspace import Workspace, copy_workspace

if TYPE_CHECKING:
    from cspace.exact.boundaries import Problem
    from cspace.exact.proofs import ExactQueries
    from cspace.map.clearance import Inflation
    from cspace.map.components import Components
    from cspace.map.mip import OccupancyBits, OccupancyPyramid
    from cspace.map.overlaps import Runs, Sums
    from cspace.map.sampling import FreeCells
    from cspace.map.widest import Widest
    from cspace.spectral.overlap import FourierOverlap, OverlapField
    from cspace.update import Change, Update, Updater


class CSpace(ConfigurationMap, MapExport):
    """Certified map of a robot's configurations, in R^2, R^3, SE(2), R^3 x SO(2) or SE(3).

    They are ``(x, y)`` in the plane and ``(x, y, z)`` in space, followed by a yaw where the robot turns about z, or a
    quaternion ``(qx, qy, qz, qw)`` where it turns about any axis.

    :func:`cspace.build` makes it and :func:`cspace.open` reads a saved one. Every look-up takes one configuration,
    shape (size,), and answers with a Python number, or a batch, shape (..., size), and answers with an array of shape
    (...). Look-ups are compiled and may be called from several threads at once. What they derive from the map (labels,
    sums, which blocks of cells are all FREE) is computed at the first call and cached; a copy or a pickle of the map
    leaves it out. Yaw is in radians, and wrapped. Of a quaternion and its negative, which are the same rotation,
    either will do; its norm must be 1 within 1e-6.

    A configuration outside the grid is BLOCKED under ``outside="blocked"`` where the robot is proven to stick out of
    the workspace, FREE under ``outside="free"`` where it is proven to reach no obstacle, and otherwise MIXED. In a
    window of a larger map (:meth:`cspace.TiledCSpace.window`), ``outside`` is "unknown", and all outside is MIXED.

    Axes of continuous joints are periodic: angles may be any, up to 256 radians, and a whole turn more is the same
    configuration. Edges turn these joints the shorter way, as OMPL does, and rows of a path count whole turns, so that
    straight motions join them. Obstacles placed beyond the middle turn come in again, whole turns on. On such a map
    :meth:`clearance` is computed up to half a turn, and :meth:`is_free_around` within as much; :meth:`overlap_count`,
    :meth:`obstacle_distance` and overlap fields are undefined.

    Parameters
    ----------
    contents : Contents
        All that the map is.
    rasters : sequence of (outer, inner) Raster, optional
        The robot's rasters for each slice; computed at need if left out.

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
        if contents.workspace.live:  # another map's, which updates it
            contents = replace(contents, workspace=copy_workspace(contents.workspace))
        self._contents = contents
        # Updates write into the contents' states; all others see these.
        self._seen = read_only_of(contents.states)
        self._slice_of = contents.slice_of
        self._lock = Lock()
        if rasters is not None:
            vars(self)["_rasters"] = list(rasters)

    # ---- what the map is ---------------------------------------------------------------------------------------------

    @property
    def workspace(self) -> Workspace:
        """The obstacles; after an update, as they are now."""
        return self._contents.workspace

    @property
    def _kept(self) -> Contents:
        return self._contents

    @property
    def periodic_axes(self) -> tuple[bool, ...]:
        return self._contents.periodic_axes or (False,) * self.size

    @property
    def outside(self) -> str:
        return self._contents.outside

    @property
    def margin(self) -> float:
        return self._contents.margin

    @property
    def precision(self) -> str:
        """Arithmetic of the engine: "integer" for whole numbers, "float32" or "float64" for transforms."""
        return self._contents.precision

    @property
    def overlap_counts(self) -> NDArray[np.int32] | None:
        """Overlap of each cell, by slice, if it was stored; read-only."""
        counts = self._contents.overlap_counts
        return None if counts is None else read_only(counts).reshape(self._contents.leading(len(counts)))

    @property
    def cell_states(self) -> NDArray[np.uint8]:
        """State of each cell, shape (nx, ny) or (nx, ny, nz); of a robot that turns (rotations, nx, ny(, nz)).

        Read-only. A new array at each call where rotation cells share a slice, or states take two bits.

        Raises
        ------
        InputError
            If it has to be made and does not fit into memory.
        """
        every = self._seen
        if isinstance(every, PackedStates):
            check_bytes(self.grid.size * len(self._slice_of))
            every = read_only(np.asarray(every))
        if len(every) < len(self._slice_of):
            every = read_only(every[self._slice_of])
        return every.reshape(self._contents.leading(len(every)))

    def states_at(self, rotation: ArrayLike = ()) -> NDArray[np.uint8]:
        """State of each cell in the rotation cell of a rotation, shape (nx, ny) or (nx, ny, nz).

        The rotation is given as in a configuration: by nothing, a yaw (radians) or a quaternion.
        """
        part: States = self._seen[int(self._slice_of[self.rotations.cells_of(self.rotations.checked(rotation))])]
        return part

    def count(self) -> tuple[int, int, int]:
        shares = np.bincount(self._slice_of, minlength=len(self._seen))
        free, mixed, blocked = (shares @ counts_of(self._seen)).tolist()
        return free, mixed, blocked

    @property
    def _summary(self) -> str:
        free, mixed, blocked = self.count()
        return f"{free=}, {mixed=}, {blocked=}"

    @property
    def _facts(self) -> dict[str, object]:
        grid, rotations, states, fields = self.grid, self.rotations, self._seen, self._contents.fields
        arrays: list[Any] = [states, *fields.values()] + ([] if self.overlap_counts is None else [self.overlap_counts])
        measure = f"{('area', 'volume')[grid.dim - 2]}_{grid.measure_unit.replace(' ', '_')}"
        filled = "mean_" * bool(rotations.names) + f"free_{measure}"
        free = counts_of(states)[:, FREE][self._slice_of]
        periodic = self._contents.periodic
        mean = float(free @ rotations.volumes / rotations.volumes.sum()) * grid.spacing**grid.dim
        return {
            **({"periodic_axes": periodic.names_among(self.axes)} if periodic else {}),
            **({"slices": len(states)} if rotations.names else {}),
            "workspace": self.workspace.source,
            "cells": dict(zip(STATE_NAMES, self.count(), strict=True)),
            filled: mean,
            "precision": self.precision,
            "overlap_counts": self.overlap_counts is not None,
            **({"overlap_field": True} if fields else {}),
            "memory_bytes": sum(array.nbytes for array in arrays),
        }

    def __reduce__(self) -> tuple[type[CSpace], tuple[Contents]]:
        """A copy or a pickle has the contents of the map, without caches and locks."""
        with self._lock:  # an update waits
            return type(self), (self._contents.copy(),)

    # ---- one configuration -------------------------------------------------------------------------------------------

    @overload
    def overlap_count(self, q: Configuration) -> int: ...  # type: ignore[overload-overlap]
    @overload
    def overlap_count(self, q: ConfigurationBatch) -> Ints: ...
    def overlap_count(self, q: ArrayLike) -> int | Ints:
        """Number of (obstacle cell, robot offset) pairs that coincide at configurations.

        The count is that of the outer rasters: in the grid it is zero exactly where a configuration is FREE, and grows
        with the depth of the collision; times ``spacing**d`` an area or a volume. Cells outside the workspace count
        under ``outside="blocked"``. Nothing needs to be stored: the robot's rows are summed at each configuration.

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
        """Whether the robot is proven to lie wholly inside the obstacles at configurations.

        This is the packing problem: with the obstacles a container's cavity or a sheet of material, True means that
        the robot fits in there, margin included. False means that it is not proven at this resolution.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        with self._lock:  # running counts are right at the end of an update, and not in its midst
            sums = np.asarray(self._sum("inner", q))
        counts = np.array([outer.count for outer, _ in self._rasters])
        inside: Bools = sums == counts[self._slice_of[self.rotations.cells_of(np.asarray(q, dtype=np.float64))]]
        return inside if inside.ndim else bool(inside)

    def obstacle_distance(self, q: ArrayLike, lengths: ArrayLike = 0.0, turns: ArrayLike = 0.0) -> float:
        """Lower bound of the robot's distance from the obstacles, at all configurations or along all pieces of a path.

        Metres between the robot itself, without margin, and the obstacles as they are now: their shapes where the map
        has them, else the outer cells; and, unless the map is open, its border.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians; of pieces of a path their middles.
        lengths, turns : array-like, shape () or (...)
            Metres and radians along each piece. No point of the robot is farther than half of both from where it is in
            the middle.

        Returns
        -------
        float
            Metres; infinite where there is nothing, and zero where a configuration is not proven free.

        Raises
        ------
        InputError
            If what fills a mesh depends on the spacing, or an argument is not as stated.
        """
        from cspace.map.points import classify_few

        self._refuse_periodic("obstacle_distance", "use the space of the arm")
        points = as_points(q, "q", self.size)
        rows, spans = as_contiguous(points.reshape(-1, self.size)), list[Floats]()
        for name, given in (("lengths", lengths), ("turns", turns)):
            along = check_finite(given, name)
            if along.shape not in ((), points.shape[:-1]) or (along < 0.0).any():
                rule, hint = "it must be zero or above", "pass one number, or one for each configuration"
                raise InputError(name, f"is {given!r}", rule, hint, value=given)
            spans.append(np.full(points.shape[:-1], along).ravel())
        states = np.empty(len(rows), dtype=np.uint8)
        if (
            classify_few(self._kernel_map, rows, states) >= 0
        ):  # to look them up together gains little beside the distances
            self._check_configurations(points)  # raises
        left = rows[states != FREE]
        if len(left) and not all(itertools.starmap(self.point_checker(exact=True), left.tolist())):
            return 0.0
        return self._exact.distance(rows, *spans)

    # ---- for callbacks -----------------------------------------------------------------------------------------------

    def point_checker(self, *, exact: bool = False) -> Callable[..., bool]:
        """A quick ``is_free`` of floats, for callbacks that are called a million times.

        Parameters
        ----------
        exact : bool
            As for :meth:`is_free`.

        Returns
        -------
        callable
            ``check(*q) -> bool``, of the size numbers of a configuration, as floats; False where they are none.
        """
        check = self._exact.point_checker(self._point_checker) if exact else self._point_checker
        return with_wrapped_angles(check, self.periodic_axes)

    def edge_checker(self, *, exact: bool = False) -> Callable[..., bool]:
        """A quick ``motion_is_free`` of the floats of two configurations, in one compiled call.

        Parameters
        ----------
        exact : bool
            As for :meth:`motion_is_free`.

        Returns
        -------
        callable
            ``check(*q0, *q1) -> bool``, of the numbers of two configurations, as floats; False where they are none.
        """
        check = self._exact.edge_checker(self._edge_checker) if exact else self._edge_checker
        return with_wrapped_angles(check, self.periodic_axes)

    def clearance_checker(self) -> Callable[..., float]:
        """A quick ``clearance`` of floats.

        Returns
        -------
        callable
            ``check(*q) -> float``, of the size numbers of a configuration; they must be finite floats, and are not
            checked.
        """
        from cspace.map.clearance import checker

        return with_wrapped_angles(checker(self._kernel_map, self._live_marks, self.size), self.periodic_axes)

    # ---- what FREE cells join ----------------------------------------------------------------------------------------

    def reachable_bounds(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """Bounding box of all FREE cells of the grid that chains of FREE cells join to a configuration.

        No path through FREE cells of the grid leaves it, which narrows down where a planner has to look.

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
        with self._lock:  # as for is_connected
            first, last = self._components.box(self._cells_of(self._one_free(q, "q")))
        lower = np.asarray(self.grid.lower)
        return lower + self.grid.spacing * first, lower + self.grid.spacing * (last + 1)

    def find_path(
        self, q0: ArrayLike, q1: ArrayLike, *, straight: bool = True, time_limit: float | None = None
    ) -> Floats:
        """Find a path through FREE cells, proven free all along.

        A path is found whenever FREE cells of the grid join the two configurations. It is deterministic. In the plane,
        and between two configurations of one rotation of a plane map that its slice joins, it is the shortest path
        through FREE cells, to within 1e-5 cells for each corner (Harabor and others, JAIR 2016). Otherwise it follows a
        chain of cells, pulled straight; the robot then turns on the spot, and only if it must.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,)
            FREE configurations in the grid.
        straight : bool
            If False, return the chain of cells without shortening it.
        time_limit : float, optional
            Seconds after which the search gives up, without what is compiled at the first call. None by default.

        Returns
        -------
        ndarray of float64, shape (n, size)
            Waypoints, from q0 to q1, each edge between two proven free, yaw in [-pi, pi); of length 0 where chains of
            FREE cells do not join them, one of them lies on the border of a cell that is not FREE, or none was found in
            time.

        Raises
        ------
        ConfigurationError
            If a configuration is not FREE, or not in the grid.
        InputError
            If a configuration is not one of finite numbers, or the time limit is not above zero.
        """
        return self._in_time(self._free_path, q0, q1, straight, time_limit)

    def _in_time(
        self,
        search: Callable[[ArrayLike, ArrayLike, bool, float], Floats],
        q0: ArrayLike,
        q1: ArrayLike,
        straight: bool,
        time_limit: float | None,
    ) -> Floats:
        """The path that a search finds within seconds; of length 0 where it takes longer."""
        seconds = math.inf if time_limit is None else check_positive(time_limit, "time_limit", "seconds")
        try:
            path = search(q0, q1, straight, seconds)
        except TimeoutError:
            return np.empty((0, self.size))
        periodic = self._contents.periodic
        return periodic.begin_at(path, np.asarray(q0, dtype=np.float64)) if periodic else path

    def _free_path(self, q0: ArrayLike, q1: ArrayLike, straight: bool, seconds: float) -> Floats:
        """:meth:`find_path`; TimeoutError where it takes longer."""
        from cspace.map.paths import in_time, pulled_straight, unwind, waypoints
        from cspace.map.search import GREED, TURN_COST, Graph

        until, dim, neighbors = clock() + seconds, self.grid.dim, self.rotations.neighbors
        endpoints = np.stack([self._one_free(q, name) for q, name in ((q0, "q0"), (q1, "q1"))])
        first, last = map(self._cells_of, endpoints)

        def chain(neighbors: Ints) -> Ints:
            turns = np.full(neighbors.shape, TURN_COST)
            graph = Graph.of(self._seen, self._slice_of, neighbors, turns, self.periodic_axes[:dim])
            return graph.chain(first, last, until, greed=GREED)

        still = not self.rotations.steps(*endpoints)[dim:].any()
        if straight and still and dim == 2 and not any(self.periodic_axes):
            path = self._shortest_in_slice(endpoints, int(self._slice_of[first[0]]), until)
            if len(path):
                return path
        cells = chain(neighbors[:, :0]) if still else np.empty((0, 1 + dim), dtype=np.int64)
        if not len(cells) and (neighbors.size or not still):
            cells, still = chain(neighbors), False
        if not len(cells):
            return np.empty((0, self.size))
        cells = unwind(cells, self.grid.shape, self.periodic_axes[:dim])
        path = waypoints(self.grid, self.rotations, endpoints, cells, self.periodic_axes[:dim])
        if still:  # q1 may have the same rotation in other numbers: a quaternion of the other sign
            path[:, dim:] = endpoints[0][dim:]
        if not self.certify_path(path).all():
            return np.empty((0, self.size))
        check = in_time(below_half_a_turn(self.edge_checker(), self.periodic_axes), until)
        return pulled_straight(path, dim, check, 2.0 * self.grid.spacing) if straight else path

    def _shortest_in_slice(self, endpoints: Floats, number: int, until: float) -> Floats:
        """Return the shortest path in a slice of a plane map, pushed aside so that each edge is certified.

        Its length is 0 if there is none, or if its corners cannot be pushed far enough.
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

    def find_widest_path(
        self, q0: ArrayLike, q1: ArrayLike, *, straight: bool = True, time_limit: float | None = None
    ) -> Floats:
        """A collision-free path of the largest possible clearance, and of those a shortest, by the map's own search.

        Of all chains of FREE cells that join the two, turning on the spot from one rotation cell to the next, it takes
        those whose smallest clearance is the largest. Where start or goal lies nearer to obstacles than that, the path
        leaves it by steepest ascent of the clearance, so that the endpoints do not limit the rest. Between, it takes
        the shortest chain, a radian counting as half a metre; straight edges then shorten it without less clearance. It
        is deterministic.

        Clearance is that of the middles of cells; between them, :meth:`clearance` may be less by half a cell's
        diagonal.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,)
            FREE configurations in the grid.
        straight : bool
            Whether to leave out waypoints that straight edges do not need.
        time_limit : float, optional
            Seconds after which the search gives up, but for what it makes once for a map. None by default.

        Returns
        -------
        ndarray of float64, shape (n, size)
            Waypoints, from q0 to q1, each edge between two proven free, yaw in [-pi, pi); of length 0 where chains of
            FREE cells of the grid do not join them, one of them lies on the border of a cell that is not FREE, or none
            was found in time.

        Raises
        ------
        ConfigurationError
            If a configuration is not FREE, or not in the grid.
        InputError
            If a configuration is not one of finite numbers, the time limit is not above zero, or the search does not
            fit into memory.
        """
        return self._in_time(self._widest_path, q0, q1, straight, time_limit)

    def _widest_path(self, q0: ArrayLike, q1: ArrayLike, straight: bool, seconds: float) -> Floats:
        """:meth:`find_widest_path`; TimeoutError where it takes longer, but for what it makes once for a map."""
        from cspace.map.widest import BYTES, find_widest_path

        endpoints = np.stack([self._one_free(q, name) for q, name in ((q0, "q0"), (q1, "q1"))])
        # Levels cover what is unrolled, half a turn more at either end.
        cells = self.grid.size * self.rotations.count * 2 ** sum(self.periodic_axes)
        needed, fewer = BYTES * cells, self.rotations.fewer
        check_memory(needed, "the map, to find its widest path,", self.grid, fewer=fewer)
        own = self._grid_kernel_map
        with self._lock:
            # Searches that still use the old levels keep them.
            widest = vars(self)["_widest"] = self._widest.renewed(own, self._seen)
        until = clock() + seconds
        both = endpoints, self._cells_of(endpoints)
        join = partial(self._components_of, exterior_open=np.zeros(len(self._seen), dtype=np.bool_))
        path = find_widest_path(widest, own, self.grid, both, join, straight, until)
        return path if len(path) and self.certify_path(path).all() else path[:0]

    # ---- the set of FREE configurations ------------------------------------------------------------------------------

    @overload
    def sample_free(self, n: None = None, rng: np.random.Generator | None = None) -> Floats: ...
    @overload
    def sample_free(self, n: int, rng: np.random.Generator | None = None) -> Floats: ...
    def sample_free(self, n: int | None = None, rng: np.random.Generator | None = None) -> Floats:
        """Configurations drawn uniformly from the FREE cells.

        Parameters
        ----------
        n : int, optional
            How many; one, without a batch axis, if left out.
        rng : numpy.random.Generator, optional
            Source of randomness. By default a new ``numpy.random.default_rng()``, which draws others at each call.

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
        """Middle of the FREE cell nearest to a configuration.

        Parameters
        ----------
        q : array-like, shape (size,)
            Metres and radians; may lie anywhere. Half a metre counts as much as a radian, as in OMPL's SE(2).

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
            wrapped = periodic.canonical(as_points(q, "q", self.size))
            return periodic.canonical(self._unrolled.nearest_free(wrapped))
        point = self._check_configurations(q, "q")
        if point.ndim != 1:
            rule = f"it must be one configuration of {self.size} numbers"
            raise InputError("q", f"has shape {point.shape}", rule, "ask for one at a time", value=q)
        center = nearest(self._seen, self._slice_of, self.rotations, self.grid, point)
        if center is None:
            raise self._nothing_free()
        return center

    def _nothing_free(self) -> ConfigurationError:
        hint = "use a smaller robot, a finer spacing, or unknown='free' where the workspace is a sensor map"
        return ConfigurationError("the map", "has no FREE cell", "nothing can be drawn from it", hint)

    # ---- a workspace that changes ------------------------------------------------------------------------------------

    def update(self, cells: ArrayLike, lower: Sequence[int], *, inner: ArrayLike | None = None) -> Update:
        """Change a box of workspace cells; the map becomes, in place, what a build would give.

        The cost grows with the box around the cells that really differ and with the robot, not with the map. Checkers
        that were handed out before (:meth:`point_checker`, :meth:`edge_checker`, :meth:`clearance_checker`, and those
        of the ``planners`` package) answer for the new workspace from then on.

        The :class:`Workspace` that was passed to the build, and other maps of it, stay as they are: the first update
        copies its cells. Then :attr:`workspace` shows the current ones, which are the obstacles from then on; its
        ``shapes`` are None, and look-ups with ``exact=True`` use the outer cells instead. What :meth:`add_obstacle`
        added stays on top. An overlap field belongs to the obstacles as they were, and is dropped. A map built without
        ``inner`` gets no BLOCKED cells, also after it is saved and opened.

        What look-ups have cached follows the change at their next call, but for the counts of FREE cells for
        :meth:`sample_free` and the geometry for ``exact=True``, which are made again.

        Updates wait for each other, and so do :meth:`is_connected`, :meth:`is_disconnected`, :meth:`reachable_bounds`
        and :meth:`contains_robot`, whose answers depend on many cells, :meth:`save`, :meth:`export`, copies, pickles
        and forks of the process. Any other look-up that another thread makes meanwhile sees each cell as it was or as
        it is going to be. An :meth:`overlap_count` computed meanwhile may be neither the old count nor the new one.

        Parameters
        ----------
        cells : array-like of bool, shape (mx, my) or (mx, my, mz)
            What the cells of the box are from now on: whether they meet an obstacle. 0 and 1 are accepted.
        lower : sequence of int, shape (d,)
            Index of the first cell of the box, which must lie in the grid.
        inner : array-like of bool, the shape of cells, optional
            Whether they lie in obstacles; ``cells`` if left out.

        Returns
        -------
        Update
            What was computed again, and how many cells changed their state.

        Raises
        ------
        InputError
            If an argument is not as stated, or a cell is in ``inner`` and not in ``cells``; nothing is changed then.

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
        """Add a named obstacle, in metres, or move it there, and update this map.

        The map is from then on what a build would give with these obstacles: what the workspace holds otherwise, and
        all that was added. An obstacle replaces the one of the same name, and what that one covered reappears.
        Obstacles may overlap; a cell is in the workspace if it is in any of them. Of one that sticks out of the grid,
        what is in the grid counts; one that lies wholly outside it keeps its name, and changes nothing.

        Look-ups with ``exact=True`` use the obstacle itself, and not its cells. :meth:`update` goes on to change what
        the workspace holds otherwise, below all that was added; from then on exact look-ups use its cells.
        All else is as for :meth:`update`. A move over a longer way than the robot reaches is two changes, new place
        first, so that look-ups from other threads may see the obstacle at both, and never at neither.

        Copies and pickles keep the names. A file keeps the obstacles, as :attr:`workspace` shows them, without names:
        in a map that is opened from it they can no longer be moved.

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
            Of the balls around the points, metres, zero or above.

        Returns
        -------
        Update

        Raises
        ------
        InputError
            If the name is not a string, or empty, or the obstacle is none of these, or points without a radius, or in
            another dimension than the map, or so far from it that rounding could matter; nothing is changed then. A
            :class:`GeometryError` if it is empty, not finite, or a polygon that crosses itself.

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
            rule = "it must be a text that is not empty"
            raise InputError("name", f"is {name!r}", rule, 'pass e.g. "cart"', value=name)
        self._check_whole()
        obstacle = as_shape(shape, radius, "shape")
        if obstacle.dim != self.grid.dim:
            problem, place = f"is in {obstacle.place}", ("the plane", "space")[self.grid.dim - 2]
            raise InputError("shape", problem, f"the map is in {place}", "pass one of as many coordinates", value=shape)
        with self._lock:
            return self._updates.set_obstacle(name, obstacle)

    def remove_obstacle(self, name: str) -> Update:
        """Remove an obstacle that :meth:`add_obstacle` added; what it covered reappears.

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
            placed = self.obstacles
            if name not in placed:
                there = f"there are {', '.join(map(repr, placed))}" if placed else "none was added"
                raise InputError("name", f"is {name!r}", there, "ask space.obstacles for the names", value=name)
            return self._updates.set_obstacle(name, None)

    @property
    def obstacles(self) -> dict[str, Shape]:
        """The obstacles that were added, by name, where they are now; a copy."""
        with self._lock:
            layers = self._contents.layers
            return {} if layers is None else {name: each.shape for name, each in layers.named.items()}

    @lazy
    def _updates(self) -> Updater:
        from cspace.update import Updater

        return Updater(self._contents, self._rasters, self._exterior, self._renew)

    def _check_whole(self) -> None:
        if self.outside == UNKNOWN:
            rule, hint = "what lies around it decides as well", "update that map, and take the part anew"
            raise ConfigurationError("the map", "is a part of a larger one", rule, hint)

    def _renew(self, change: Change) -> None:
        """Bring up to date what was made of the map, after its states and its exterior were changed in place."""
        contents = self._contents
        same = contents.workspace is change.workspace and contents.layers is change.layers
        if not same or contents.fields or contents.prove is not None:
            # The arm of a map of joints is among other obstacles, or none, from now on.
            self._contents = replace(contents, workspace=change.workspace, layers=change.layers, fields={}, prove=None)
        CSpace._outer_sums.refresh(self, change.workspace.outer, change.cells)
        CSpace._inner_sums.refresh(self, change.workspace.inner, change.cells)
        if change.changed:
            CSpace._free_cells.drop(self)
            for part in (CSpace._mip, CSpace._widest, CSpace._inflation, CSpace._components):
                part.refresh(self, change.states)
        unrolled, periodic = CSpace._with_other_turns.cached(self), contents.periodic
        if unrolled is not None:
            dim, workspace = self.grid.dim, change.workspace
            for first, box in periodic.appearances(change.cells[3 - dim : 3], change.cells[6 - dim :]):
                unrolled.update(workspace.outer[box], first.tolist(), inner=workspace.inner[box])
        CSpace._exact.refresh(self, self._problem)

    # ---- a smooth measure of penetration -----------------------------------------------------------------------------

    def with_overlap_field(self, overlap: FourierOverlap) -> CSpace:
        """The same map, carrying the overlap of descriptors and its gradient at the middle of each cell.

        It is saved and exported with the map, and serves :class:`planners.OverlapObjective`. This map stays as it is;
        the new one is a copy, without the field that this one may carry.

        Parameters
        ----------
        overlap : cspace.spectral.FourierOverlap
            Of the robot's balls, in the robot's frame, with those of the obstacles, in the map's.

        Raises
        ------
        InputError
            If the overlap is in the plane and the map is in space, or the other way around, or memory is too small.
        MissingPackageError
            If finufft is not installed.
        """
        from cspace.spectral.overlap import OverlapField

        self._refuse_periodic("overlap_field", "use the space of the arm")
        fields = OverlapField.of(self, overlap).arrays
        with self._lock:  # an update waits
            return CSpace(replace(self._contents.copy(), fields=fields), self._rasters)

    @property
    def overlap_field(self) -> OverlapField | None:
        """The overlap of descriptors that the map carries; None where there is none."""
        from cspace.spectral.overlap import OverlapField

        fields = self._contents.fields
        return OverlapField(self, fields) if fields else None

    # ---- what files and messages are made from -----------------------------------------------------------------------

    def _write(self, write: Callable[[Contents], None], *, exterior: bool = False) -> None:
        """Call ``write`` with the contents of one moment, with the states outside the grid if ``exterior`` is set."""
        with self._lock:
            write(replace(self._contents, exterior=self._exterior) if exterior else self._contents)

    def _inflated(self, limit: float, number: int | None) -> Floats:
        """Return the clearance of each cell's middle, in cells: the largest of all slices, or that of one.

        It is infinite where it is above ``limit``.
        """
        from cspace.map.clearance import clearances_of

        whole, periodic = self._unrolled, self._contents.periodic
        if number is None:
            clearances = whole._inflation.clearances(limit)
        else:
            clearances = clearances_of(whole._seen[number], whole._exterior.table[number], limit)
        return clearances[periodic.middle] if periodic else clearances

    def _flat_state(self) -> States:
        """State of each cell at all rotations together."""
        least = np.array(self._seen[0])
        most = least.copy()
        for number in range(1, len(self._seen)):
            np.minimum(least, self._seen[number], out=least)
            np.maximum(most, self._seen[number], out=most)
        return np.where(least == most, least, MIXED).astype(np.uint8)

    # ---- parts that are cached at the first access -------------------------------------------------------------------

    @lazy
    def _rasters(self) -> list[tuple[Raster, Raster]]:
        return slice_rasters(self.robot, self.grid.spacing, self.margin, self.rotations)

    @lazy
    def _exterior(self) -> Exterior:
        return self._contents.exterior or Exterior.of(self.workspace.outer, self._rasters, self.outside)

    @property
    def _kernel_map(self) -> Map:
        """What compiled functions take of the map, such as those of ``cspace.map.points``; it follows updates.

        Periodic axes are unrolled.
        """
        return self._unrolled._grid_kernel_map

    @lazy
    def _grid_kernel_map(self) -> Map:
        """As :attr:`_kernel_map`, of the cells of the grid alone, without unrolling."""
        grid, rotations = self.grid, self.rotations.compiled(self._slice_of)
        return Map(
            record_of(self._seen),
            cells_of(self._seen),
            rotations,
            grid.lower,
            grid.spacing,
            grid.upper,
            self._exterior.table,
        )

    @property
    def _unrolled(self) -> CSpace:
        """The map with half a turn more at either end of periodic axes; the map itself if it has none."""
        return self._with_other_turns if self._contents.periodic else self

    @lazy
    def _with_other_turns(self) -> CSpace:
        periodic = self._contents.periodic
        return self._unroll(-periodic.padding, self.grid.shape + periodic.padding)

    def _unroll(self, first: Ints, stop: Ints) -> CSpace:
        """Return the cells from ``first`` to before ``stop``, counted on along periodic axes, as a map without any."""
        periodic = self._contents.periodic
        workspace, states = periodic.unroll(self.workspace, np.asarray(self._seen[0]), first, stop)
        return CSpace(Contents(workspace, self.robot, Rotations.of(None), self._slice_of, states[np.newaxis]))

    def _refuse_periodic(self, what: str, hint: str) -> None:
        """Raise InputError if the map has periodic axes, for which ``what`` is undefined."""
        periodic = self._contents.periodic
        if periodic:
            axes = ", ".join(periodic.names_among(self.axes))
            raise InputError(what, "is asked for", f"it is undefined on a map with periodic axes ({axes})", hint)

    @lazy
    def _exact(self) -> ExactQueries:
        from cspace.exact.proofs import ExactQueries

        return ExactQueries(self._problem())

    def _problem(self) -> Problem:
        """What exact look-ups decide."""
        from cspace.exact.boundaries import Problem

        exterior_blocked, prove = self.outside != "free", self._contents.prove
        return Problem(
            self._kernel_map, self.rotations, self._unrolled.workspace, self.robot, self.margin, exterior_blocked, prove
        )

    @lazy
    def _components(self) -> Components:
        needed, fewer = COMPONENT_STATE_BYTES * self._seen.size, self.rotations.fewer
        check_memory(needed, "the map, to join its cells,", self.grid, fewer=fewer)
        return self._components_of(self._seen, ~self._exterior.is_all_blocked(self.grid.shape))

    def _components_of(self, states: Stack, exterior_open: Bools) -> Components:
        """The components of states, and of what surrounds each slice."""
        from cspace.map.components import Components, PeriodicComponents

        of_slices = states, self._slice_of, self.rotations.neighbors, exterior_open
        return PeriodicComponents(*of_slices, self.periodic_axes) if self._contents.periodic else Components(*of_slices)

    def _guess_connectivity(self, cells: Ints) -> tuple[bool, Callable[[], bool]]:
        return self._components.hint(cells)

    @property
    def _live_marks(self) -> OccupancyBits:
        """What compiled functions of the clearance take beside the :attr:`_kernel_map`; it follows updates."""
        return self._marks(cells=True, eager=True)

    def _marks(self, *, cells: bool, eager: bool = False) -> OccupancyBits:
        """What is not FREE, at three scales; see :meth:`cspace.map.mip.OccupancyPyramid.marks`."""
        return self._unrolled._mip.marks(cells, eager)

    @lazy
    def _mip(self) -> OccupancyPyramid:
        from cspace.map.mip import OccupancyPyramid

        return OccupancyPyramid(self._seen, self._lock)

    @lazy
    def _runs(self) -> Runs:
        from cspace.map.overlaps import Runs

        return Runs.of([outer for outer, _ in self._rasters])

    @lazy
    def _outer_sums(self) -> Sums:
        from cspace.map.overlaps import Sums

        return Sums(self.workspace.outer)

    @lazy
    def _inner_sums(self) -> Sums:
        from cspace.map.overlaps import Sums

        return Sums(self.workspace.inner)

    @lazy
    def _free_cells(self) -> FreeCells:
        from cspace.map.sampling import FreeCells

        return FreeCells(self._seen)

    @lazy
    def _widest(self) -> Widest:
        from cspace.map.widest import Widest

        return Widest.of(self._grid_kernel_map, self._seen, self.rotations, self.periodic_axes[: self.grid.dim])

    @lazy
    def _inflation(self) -> Inflation:
        from cspace.map.clearance import Inflation

        return Inflation(self._seen, self._exterior.table, self._lock)

    @lazy
    def _point_checker(self) -> Callable[..., bool]:
        from cspace.map.callbacks import point_checker

        return point_checker(self._kernel_map, self.size)

    @lazy
    def _edge_checker(self) -> Callable[..., bool]:
        from cspace.map.callbacks import edge_checker

        return edge_checker(self._kernel_map, self.size)

    def _cells_of(self, points: Floats) -> Ints:
        periodic = self._contents.periodic
        if not periodic:
            return super()._cells_of(points)
        return np.insert(periodic.cells_in_turn(self._unrolled.grid, points), 0, 0, axis=-1)

    @lazy
    def _backend(self) -> MemoryBackend:
        return MemoryBackend(self._kernel_map, self._contents.periodic, self._lock)

    # ---- kernels and checks ------------------------------------------------------------------------------------------

    def _clearances(self) -> Query:
        from cspace.map.clearance import clearances

        query = self._backend.query(clearances, self._marks(cells=True))
        return in_spatial_order(query, self.grid.lower, self.grid.upper)

    def _blocks(self, number: int) -> Words | None:
        from cspace.map.mip import CELLS_AN_EDGE

        if CSpace._mip.cached(self._unrolled) is None and number * CELLS_AN_EDGE < self._seen.size:
            return None
        return self._marks(cells=False).blocks

    def _sum(self, side: Literal["outer", "inner"], q: ArrayLike) -> int | Ints:
        from cspace.map.overlaps import overlaps

        self._refuse_periodic("overlap_count", "use classify: a point overlaps with no cell, or with one")
        # What is not known may be an obstacle, and may be none.
        exterior_blocked = self.outside != "free" if side == "outer" else self.outside == "blocked"
        workspace = self.workspace
        outer = side == "outer" or workspace.inner is workspace.outer
        sums = self._outer_sums if outer else self._inner_sums
        query = self._backend.query(overlaps, sums.counts, self._runs, int(exterior_blocked))
        return evaluate_batch(q, self.size, query, np.int64, int, angles=self._angles)

    def _one_free(self, q: ArrayLike, name: str) -> Floats:
        """Return one FREE configuration in the grid, its yaw in [-pi, pi)."""
        point = self.rotations.canonical(self._check_configurations(q, name), name)
        if point.ndim != 1 or not self.grid.contains(point[: self.grid.dim]) or not self.is_free(point):
            rule = "it must be one FREE configuration in the grid"
            raise ConfigurationError(name, f"is {q!r}", rule, "ask nearest_free for one", value=q)
        return point
