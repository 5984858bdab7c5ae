"""The certified map of a robot's configurations, in memory."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace import _outside
from cspace._configuration_map import ConfigurationMap
from cspace._engines import put_layers_first
from cspace._interface import HALF_TURN, LookUp, Space
from cspace._queries.batches import (
    MIN_EDGES_PER_THREAD,
    Configuration,
    as_contiguous,
    evaluate,
    evaluate_rows,
    write_in_threads,
)
from cspace._queries.callbacks import NO_ANSWER
from cspace._raster import Raster
from cspace._record.cells import Map, make_map_record
from cspace._record.contents import Contents, check_heights, rasters_of
from cspace._record.exterior import UNKNOWN, Exterior
from cspace._rotations.base import measure_steps
from cspace._shapes import Shape, ShapeLike, as_shape
from cspace._shapes.layers import Heights
from cspace._support.arrays import (
    BLOCKED,
    FREE,
    Bools,
    Floats,
    Ints,
    States,
    count_states,
    number_parts,
    read_only,
)
from cspace._support.check import (
    check_finite,
    check_known,
    check_points,
    check_rng,
    check_rows,
    check_text,
    names_options,
)
from cspace._support.deadlines import NEVER, Effort
from cspace._support.derived import derived, lazy
from cspace._support.limits import check_memory
from cspace._support.reporting import format_point
from cspace._support.threads import count_cores
from cspace._support.units import warn_of_large
from cspace._workspace import LiveWorkspace, Workspace, copy_workspace
from cspace.errors import ConfigurationError, InputError

if TYPE_CHECKING:
    from pathlib import Path

    from cspace._exact.boundaries import OwnProofs, Problem
    from cspace._exact.proofs import Closest, ExactQueries
    from cspace._obstacles import ObstacleLayers
    from cspace._queries.any_angle import Rectangles
    from cspace._queries.components import Components
    from cspace._queries.distance import DistanceMap
    from cspace._queries.leaving import RobotPart
    from cspace._queries.overlaps import RobotRows
    from cspace._queries.sampling import FreeCells
    from cspace._record.update import Update, Updater


Shared = TypeVar("Shared", bound="CSpace")
"""A kind of map in memory."""


class CSpace(ConfigurationMap):
    """Certified map of a robot's configurations.

    The configurations lie in R^2, R^3, SE(2), R^3 x SO(2) or SE(3). Configurations are ``(x, y)``
    or ``(x, y, z)``, followed by a yaw if the robot rotates about z, or by a quaternion ``(qx, qy,
    qz, qw)`` if it rotates about any axis. Use :func:`cspace.build` to make a map and
    :func:`cspace.open` to read a saved one.

    A query of one configuration, a tuple or list of numbers, returns a Python value; a query of an
    array, shape (..., size), returns an array of shape (...). Queries are compiled and may run in
    several threads at once. Labels, sums and distances are computed at the first call and cached;
    copies and pickles of the map leave them out. Yaw is in radians, and wrapped. A quaternion and
    its negative are the same rotation; the norm must be 1 within 1e-6.

    With ``outside="blocked"``, a configuration outside the grid is BLOCKED if the robot is proven
    to leave the workspace; with ``outside="free"``, it is FREE if the robot is proven to reach no
    obstacle; otherwise it is MIXED. In a window of a larger map
    (:meth:`cspace.TiledCSpace.window`), ``outside`` is "unknown", and all outside is MIXED.

    In a map of joints (:func:`cspace.build_joint_map`), lengths, margins and clearances are in the
    unit of the joints. Only obstacle distances are in metres, because they are the arm's.

    Parameters
    ----------
    contents : Contents
        Grid, robot, rotations, states and workspace.
    rasters : sequence of (outer, inner) Raster, optional
        The robot's rasters for each slice; computed when needed if left out.
    layers : ObstacleLayers, optional
        Named obstacles that the cells of the workspace come from.
    proofs : OwnProofs, optional
        Proofs of MIXED cells by other geometry than that of robot and workspace, until cells
        change.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> occupied = np.zeros((80, 60), dtype=bool)
    >>> occupied[40:42, :45] = True
    >>> space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.2))
    >>> space.is_free([(1.0, 1.0), (4.1, 1.0)]).tolist()
    [True, False]
    >>> space.motion_is_free((1.0, 1.0), (7.0, 1.0))
    False
    >>> space.is_connected((1.0, 1.0), (7.0, 1.0)), space.is_disconnected((1.0, 1.0), (7.0, 1.0))
    (True, False)
    >>> round(space.clearance((2.0, 3.0)), 3)
    1.648
    """

    def __init__(
        self,
        contents: Contents,
        rasters: Sequence[tuple[Raster, Raster]] | None = None,
        layers: ObstacleLayers | None = None,
        proofs: OwnProofs | None = None,
    ) -> None:
        """Make a map of given states.

        Everything else is computed when it is first needed.
        """
        if isinstance(contents.workspace, LiveWorkspace):  # updates of another map write to it
            contents = replace(contents, workspace=copy_workspace(contents.workspace))
        self._contents = contents
        self._layers = layers
        self._own_proofs = proofs
        # Updates write to the states of the contents; everything else uses this read-only view.
        self._states: States = read_only(contents.states)
        self._slice_of = contents.slice_of
        self.lock: AbstractContextManager[Any] = threading.RLock()
        if rasters is not None:
            vars(self)["_rasters"] = list(rasters)

    # ---- description -----------------------------------------------------------------------------

    @property
    def workspace(self) -> Workspace:
        """The obstacles, with all updates so far; in space if the map has a :attr:`floor`."""
        return self._contents.workspace

    @property
    def drawn_workspace(self) -> Workspace:
        """The obstacles as pictures on the grid show them.

        With a :attr:`floor`, they are the cells of :attr:`workspace` at the heights of the robot,
        seen from above.
        """
        return self._contents.ground

    @property
    def _map_contents(self) -> Contents:
        """The contents of the map."""
        return self._contents

    @property
    def exact(self) -> CSpace:
        """The same map, whose MIXED cells the geometry decides.

        Robot and obstacles themselves prove what cells leave undecided: passages little wider than
        the robot, and shorter paths. So answer its :meth:`classify`, :meth:`is_free`,
        :meth:`motion_is_free`, :meth:`certify_path` and checkers, which takes longer, and so
        :func:`planners.plan` plans on it. All else, such as clearances, regions and chunks, is that
        of the cells. It is a view: both follow an update of either.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
        >>> q = (0.55, 0.95)
        >>> space.is_free(q), space.exact.is_free(q)
        (False, True)
        """
        return self._exact_map

    @lazy
    def _exact_map(self) -> ExactCSpace:
        """The map as one that asks the geometry."""
        vars(self)["_cells"] = self
        return _share(self, ExactCSpace)

    @property
    def overlap_counts(self) -> NDArray[np.int32] | None:
        """Overlap count of each cell, by slice.

        The array is read-only. None if the map was built without counts, or its cells changed.
        """
        counts = self._contents.overlap_counts
        if counts is None:
            return None
        return read_only(counts).reshape(self._contents.stack_shape(len(counts)))

    @property
    def cell_states(self) -> NDArray[np.uint8]:
        """State of each cell.

        Its shape is (nx, ny) or (nx, ny, nz), after an axis of rotation cells if the robot rotates.
        The array is read-only. Each access makes a new one if rotation cells share slices.

        Raises
        ------
        InputError
            If a new array does not fit into memory.
        """
        states = self._states
        if len(states) < len(self._slice_of):
            needed = float(len(self._slice_of) * self.grid.size)
            check_memory(needed, "the array of all rotation cells", self.grid)
            states = read_only(states[self._slice_of])
        return states.reshape(self._contents.stack_shape(len(states)))

    def states_at(self, rotation: ArrayLike = ()) -> NDArray[np.uint8]:
        """Return the state of each cell at a rotation.

        The result has shape (nx, ny) or (nx, ny, nz). Give the rotation as in a configuration:
        nothing, a yaw in radians, or a quaternion.
        """
        cell = self.rotations._find_cells(self.rotations.check_rotation(rotation))
        states: States = self._states[int(self._slice_of[cell])]
        return states

    def count(self) -> tuple[int, int, int]:
        """Count the FREE, MIXED and BLOCKED cells over all rotation cells."""
        rotations_per_slice = np.bincount(self._slice_of, minlength=len(self._states))
        free, mixed, blocked = (rotations_per_slice @ count_states(self._states)).tolist()
        return free, mixed, blocked

    @property
    def _summary(self) -> str:
        """Counts of the states, for the repr."""
        free, mixed, blocked = self.count()
        return f"{free=}, {mixed=}, {blocked=}"

    @property
    def _facts(self) -> dict[str, object]:
        """Plain values by name that describe the map."""
        grid = self.grid
        rotations = self.rotations
        states = self._states
        counts = self.overlap_counts
        # The free area or volume; over all rotations, the mean by their share of all rotations.
        free_cells = count_states(states)[self._slice_of, FREE]
        mean_cells = float(free_cells @ rotations._volumes / rotations._volumes.sum())
        quantity = "area" if grid.dim == 2 else "volume"
        free_name = f"free_{quantity}_{grid._measure_unit.replace(' ', '_')}"
        facts: dict[str, object] = {}
        if rotations.names:
            free_name = f"mean_{free_name}"
            facts["slices"] = len(states)
        return {
            **facts,
            **({} if self.floor is None else {"floor_m": self.floor}),
            "workspace": self.workspace.source,
            "cells": self._count_by_name(),
            free_name: mean_cells * grid.spacing**grid.dim,
            "overlap_counts": counts is not None,
            "memory_bytes": states.nbytes + (0 if counts is None else counts.nbytes),
        }

    def __reduce__(self) -> tuple[type[CSpace], tuple[Any, ...]]:
        """Copy or pickle the contents of the map, without caches and locks."""
        with self.lock:  # an update waits
            layers = None if self._layers is None else self._layers.copy()
            return type(self), (self._contents.copy(), None, layers, self._own_proofs)

    # ---- one configuration -----------------------------------------------------------------------

    @overload
    def overlap_count(self, q: Configuration) -> int: ...  # type: ignore[overload-overlap]
    @overload
    def overlap_count(self, q: ArrayLike) -> Ints: ...
    @names_options
    def overlap_count(self, q: ArrayLike) -> int | Ints:
        """Count the cells in which robot and obstacles overlap.

        The cells are those of their outer rasters. In the grid, the count is zero if and only if
        the configuration is FREE, and it grows with the depth of the collision; times
        ``spacing**d`` it is an area or a volume. Cells outside the workspace count if
        ``outside="blocked"``. The robot's rows are summed at each configuration; no stored counts
        are needed.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        int or ndarray of int64, shape (...)
        """
        return self._count_overlaps("outer", q)

    @overload
    def contains_robot(self, q: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def contains_robot(self, q: ArrayLike) -> Bools: ...
    @names_options
    def contains_robot(self, q: ArrayLike) -> bool | Bools:
        """Return True if the robot is proven to lie inside the obstacles.

        Use it for packing: if the obstacles are a cavity or a sheet of material, True means that
        the robot fits there, margin included. False means that this is not proven at this
        resolution.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        bool or ndarray of bool, shape (...)

        Raises
        ------
        InputError
            If an argument is invalid, or the map is one of joints.
        """
        if not self.has_poses:
            rule = "only a rigid robot lies inside obstacles"
            raise InputError("the map", "is one of joints", rule)
        q = check_points(q, "q", self.axes)
        with self.lock:  # the sums are consistent only before and after an update
            sums = np.asarray(self._count_overlaps("inner", q))
        # The robot lies inside if all its cells overlap inner cells.
        rotation_cells = self.rotations._find_cells(q)
        robot_cells = np.array([outer.count for outer, _ in self._rasters])
        is_inside: Bools = sums == robot_cells[self._slice_of[rotation_cells]]
        heights = Heights.of(self.workspace.grid, self.floor)
        if heights is not None:
            is_inside &= heights.contain(self.robot.shape, self.grid.spacing)
        return is_inside if is_inside.ndim else bool(is_inside)

    @names_options
    def obstacle_distance(
        self, q: ArrayLike, lengths: ArrayLike = 0.0, turns: ArrayLike = 0.0
    ) -> float | Floats:
        """Return a lower bound of the distance from obstacles.

        The distance is between the robot without margin and the current obstacles: their shapes if
        the map has them, otherwise the outer cells, and the boundary of the grid unless the outside
        is free.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Configurations, or the centers of pieces of a path; metres, and radians.
        lengths, turns : array-like, shape () or (...)
            Length and rotation of each piece, metres and radians. The bound holds for all
            configurations within half of them from the center.

        Returns
        -------
        float or ndarray of float64, shape (...)
            Metres; infinite without obstacles, and zero if a configuration or a piece is not proven
            free.

        Raises
        ------
        InputError
            If the interior of a mesh depends on the spacing, or an argument is invalid; or for a
            map of joints from a file, or whose cells changed, which has no geometry.
        """
        if not self._has_bodies:
            problem = "is one of joints, without the geometry of its arm"
            rule = "distances from obstacles are those of links, in metres"
            raise InputError("the map", problem, rule)
        points = check_rows(q, "q", self.axes)
        rows = as_contiguous(points.reshape(-1, self.size))
        row_lengths = _broadcast_spans(lengths, "lengths", points.shape[:-1])
        row_turns = _broadcast_spans(turns, "turns", points.shape[:-1])
        warn_of_large(row_turns, "rad", "turns")
        distances = np.zeros(len(rows))
        for k in np.flatnonzero(self.exact.is_free(points)):
            piece = slice(k, k + 1)
            distance = self._exact.distance(rows[piece], row_lengths[piece], row_turns[piece])
            # The center is proven free, margin included. A piece is not, if its bound leaves
            # nothing beyond the margin.
            extends = row_lengths[k] > 0.0 or row_turns[k] > 0.0
            distances[k] = 0.0 if extends and distance <= self._sure_distance else distance
        return distances.reshape(points.shape[:-1]) if points.ndim > 1 else float(distances[0])

    @names_options
    def closest(self, q: ArrayLike) -> Closest:
        """Return the nearest points of robot and obstacles, and the way from these.

        It is of the robot without margin and the obstacles of :meth:`obstacle_distance`.

        Parameters
        ----------
        q : array-like, shape (size,)
            Metres, and radians.

        Returns
        -------
        Closest
            The distance, both points, and the gradient of the distance.

        Raises
        ------
        InputError
            As :meth:`obstacle_distance`; also if there is nothing to touch, or for a map of joints.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> occupied = np.zeros((40, 30), dtype=bool)
        >>> occupied[30:] = True
        >>> workspace = cspace.Workspace.from_array(occupied, 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
        >>> found = space.closest((2.5, 1.45))
        >>> found.points.round(2).tolist(), found.gradient.round(2).tolist()
        ([[2.8, 1.45], [3.0, 1.45]], [-1.0, 0.0])
        """
        from cspace._exact.proofs import BoundaryProofs

        row = self.check_configuration(q, "q")
        proofs = self._exact.current_proofs() if self.has_poses else None
        if not isinstance(proofs, BoundaryProofs):
            rule = "the space of its arm has the closest pair of links"
            raise InputError("the map", "is one of joints", rule)
        distance = float(self.obstacle_distance(row))
        return proofs.find_closest(row, distance)

    def path_obstacle_distance(self, path: ArrayLike) -> float:
        """Return a lower bound of the obstacle distance along a path.

        The motions between its rows are straight. They are split into pieces on which no point of
        the robot moves by more than half a cell, so that each stays within a quarter of a cell of
        its position at the center of the piece.

        Parameters
        ----------
        path : array-like, shape (n, size)
            Metres, and radians.

        Returns
        -------
        float
            As :meth:`obstacle_distance`; NaN if the interior of a mesh depends on the spacing, or a
            map of joints has no geometry.
        """
        if not self._has_bodies:
            return math.nan
        rows = self._check_configurations(path, "path")
        self._check_path(rows)
        starts, ends = (rows[:-1], rows[1:]) if len(rows) > 1 else (rows, rows)
        metres, radians = measure_steps(self.steps_between(starts, ends), self.dim)
        # The translation and the rotation of a piece each move a point by at most a quarter cell.
        longest = 0.25 * self.grid.spacing
        ways = np.maximum(metres, radians * max(self.robot.shape.span, longest))
        counts = np.maximum(np.ceil(ways / longest), 1.0).astype(np.int64)
        # For each piece: its edge, its index on that edge, and its middle as a fraction of the
        # edge.
        edges, numbers = number_parts(counts)
        fractions = (numbers + 0.5) / counts[edges]
        centers = self.interpolate(starts[edges], ends[edges], fractions[:, np.newaxis])
        pieces = (metres / counts)[edges], (radians / counts)[edges]
        try:
            if not evaluate_rows(starts, ends, self.exact._write_motions).all():
                return 0.0
            return max(self._sure_distance, self._exact.distance(centers, *pieces))
        except InputError:
            return math.nan

    @property
    def _sure_distance(self) -> float:
        """Distance from obstacles that each free configuration has, metres."""
        return self.margin if self.floor is None else 0.0

    @property
    def _has_bodies(self) -> bool:
        """Whether robot and obstacles have shapes; a map of joints has a point and its cells."""
        return self.has_poses or self._own_proofs is not None

    # ---- for callbacks ---------------------------------------------------------------------------

    def point_checker(self) -> Callable[..., bool]:
        """Return a fast ``is_free`` of floats, for callbacks.

        Returns
        -------
        callable
            ``check(*q) -> bool``. Takes the coordinates as floats; returns False for NaN or
            infinite input.
        """
        return super().point_checker()

    def edge_checker(self) -> Callable[..., bool]:
        """Return a fast ``motion_is_free`` of floats, for callbacks.

        Returns
        -------
        callable
            ``check(*q0, *q1) -> bool``. Takes the coordinates of both configurations as floats;
            returns False for NaN or infinite input.
        """
        return super().edge_checker()

    # ---- bounds of paths -------------------------------------------------------------------------

    def min_path_length(self, q0: ArrayLike, q1: ArrayLike) -> float:
        """Bound the length of every collision-free path between two configurations from below.

        A point that is BLOCKED at all rotations is on no path, within the grid or outside. The
        bound is that of ``cspace/_queries/lower_bound.py``: in the plane, the length of the
        shortest path among the other points. In space, it is the largest of three such bounds, of
        projections along each axis, extended by the difference along that axis. Rotations count
        nothing.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,)
            Configurations in the grid.

        Returns
        -------
        float
            Metres; infinity if BLOCKED cells separate the two.

        Raises
        ------
        InputError
            If a coordinate is not finite.
        ConfigurationError
            If a configuration is not in the grid.
        """
        from cspace._queries.lower_bound import min_length

        grid = self.grid
        # Positions in cells.
        ends = self._check_in_grid(q0, "q0"), self._check_in_grid(q1, "q1")
        start, goal = ((q[: grid.dim] - grid.lower) / grid.spacing for q in ends)
        return grid.spacing * min_length(self._projections, self._is_open, start, goal)

    # ---- the set of FREE configurations ----------------------------------------------------------

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
            Metres, and radians; yaw in [-pi, pi), as OMPL's bounds require.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        InputError
            If ``n`` is negative or too large for the memory, or ``rng`` is neither None nor a
            Generator.
        """
        from cspace._queries.sampling import sample

        count = self._count_samples(n)
        generator = check_rng(rng)
        free = self._free_cells
        if not free.counts.any():
            raise self._make_nothing_free_error()
        samples = sample(free, self._slice_of, self.rotations, self.grid, count, generator)
        return samples[0] if n is None else samples

    @names_options
    def nearest_free(self, q: ArrayLike) -> Floats:
        """Return the center of the FREE cell nearest to a configuration.

        Parameters
        ----------
        q : array-like, shape (size,)
            Metres and radians, inside the grid or not. A radian counts as half a metre, as in
            OMPL's SE(2).

        Returns
        -------
        ndarray of float64, shape (size,)
            Metres, and radians; yaw in [-pi, pi), as OMPL's bounds require.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        """
        from cspace._queries.sampling import find_nearest

        point = self.check_configuration(q, "q")
        center = find_nearest(self._states, self._slice_of, self.rotations, self.grid, point)
        if center is None:
            raise self._make_nothing_free_error()
        return center

    def _make_nothing_free_error(self) -> ConfigurationError:
        """Make the error for a map without FREE cells."""
        return ConfigurationError("the map", "has no FREE cell", "no configuration can be drawn")

    # ---- updates ---------------------------------------------------------------------------------

    @overload
    def update(self, cells: Workspace | Mapping[str, ShapeLike | None]) -> Update: ...
    @overload
    def update(
        self, cells: ArrayLike, lower: Sequence[int], *, inner: ArrayLike | None = None
    ) -> Update: ...
    def update(
        self,
        cells: ArrayLike | Workspace | Mapping[str, ShapeLike | None],
        lower: Sequence[int] | None = None,
        *,
        inner: ArrayLike | None = None,
    ) -> Update:
        """Move named obstacles, or replace workspace cells.

        The map becomes equal to a new build. The cost grows with the cells that differ, in boxes
        around them, and with the robot, not with the map. Existing checkers (:meth:`point_checker`,
        :meth:`edge_checker`, and those of the ``planners`` package)
        follow the update.

        The first update copies the cells of the workspace, so that the :class:`cspace.Workspace`
        passed to the build, and other maps of it, do not change. :attr:`workspace` then has the
        current cells; after a box, its ``shapes`` are None, and queries of :attr:`exact` use the
        outer cells instead. Named obstacles (:meth:`add_obstacle`) stay on top. Overlap counts are
        dropped, because they belong to the old obstacles. A map built without ``inner`` gets no
        BLOCKED cells, also after it is saved and opened.

        All data that the map derives from its cells, such as components, distances and the geometry
        for :attr:`exact`, are computed anew when next asked for.

        Updates wait for each other, and for :meth:`is_connected`, :meth:`is_disconnected`,
        :meth:`contains_robot`, :meth:`save`, :meth:`export`, copies and pickles. Any other query of
        another thread during an update reads each cell either before or after it; an
        :meth:`overlap_count` may be neither the old nor the new count.

        Parameters
        ----------
        cells : array-like of bool, shape (mx, my) or (mx, my, mz), Workspace or mapping
            New cells of the box: True if they meet an obstacle; 0 and 1 are accepted. A workspace
            has the grid of this map, and also gives its unknown cells and its shapes. A mapping
            from names to shapes adds or moves obstacles as :meth:`add_obstacle` does, and None
            removes one, all in one step, which takes less time than one by one.
        lower : sequence of int, shape (d,)
            Index of the first cell of the box, which must lie in the grid; for a box alone.
        inner : array-like of bool, the shape of cells, optional
            True for cells that lie in obstacles; ``cells`` if left out.

        Returns
        -------
        Update
            The box that was computed again, and the number of states that changed.

        Raises
        ------
        InputError
            If an argument is invalid, or a cell is in ``inner`` but not in ``cells``; nothing
            changes then.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
        >>> space.update(np.ones((4, 4), dtype=bool), (18, 13)).changed
        124
        >>> space.is_free([2.0, 1.5])
        False
        >>> carts = {name: cspace.Robot.disc(0.2, (x, 2.5)) for name, x in [("a", 0.8), ("b", 3.2)]}
        >>> space.update(carts).changed
        172
        """
        from cspace._record.update import Patch

        self._check_not_window()
        if isinstance(cells, Mapping):
            if lower is not None or inner is not None:
                rule = "lower and inner belong to a box of cells"
                raise InputError("lower", "is for names of obstacles", rule)
            return self._set_obstacles(cells)
        if isinstance(cells, Workspace):
            grid = self.workspace.grid
            if cells.grid != grid or lower is not None or inner is not None:
                problem = f"is a workspace of {cells.grid}, and the map has {grid}"
                rule = "the grids must be equal, without lower and inner"
                raise InputError("cells", problem, rule)
            if cells.grid.frame_id not in ("", self.frame_id):
                problem = f"is in the frame {cells.grid.frame_id!r}"
                rule = f"it must be {self.frame_id!r}, the frame of the map"
                raise InputError("cells", problem, rule)
            with self.lock:
                return self._updates.replace(cells)
        if lower is None:
            rule = "it is the index of the first cell of the box"
            raise InputError("lower", "is missing", rule)
        patch = Patch.of(self.workspace.grid, cells, lower, inner)
        with self.lock:
            return self._updates.update(patch)

    @names_options
    def add_obstacle(
        self, name: str, shape: ShapeLike, *, radius: ArrayLike | None = None
    ) -> Update:
        """Add a named obstacle, or move it, and update the map.

        The map becomes equal to a build with the base of the workspace and all named obstacles. An
        obstacle replaces the one of the same name, and the cells that it covered reappear.
        Obstacles may overlap. They are clipped to the grid; one that lies outside keeps its name,
        changes nothing, and raises a UnitWarning.

        Queries of :attr:`exact` use the shape of the obstacle, not its cells. :meth:`update`
        changes the base, below all named obstacles; exact queries then use the cells of the base.
        All else is as for :meth:`update`. A move farther than the robot's size is two changes, the
        new position first, so that other threads may see the obstacle at both positions, but never
        at neither.

        Copies and pickles keep the names. A saved map keeps the obstacles without names, so that
        they can no longer be moved after it is opened.

        Parameters
        ----------
        name : str
        shape : shape, or array-like, shape (n, 2) or (n, 3)
            Metres, in the map's frame. In the plane what :meth:`cspace.Workspace.from_polygons`
            takes, such as a shapely geometry, or three or more corners of a polygon; in space a
            mesh, as :meth:`cspace.Workspace.from_mesh` takes, such as a ``trimesh.Trimesh``; in
            both points with their ``radius``, a decomposition into balls, a robot, or the short
            text of one, such as ``"ellipse:0.5,0.3@2,1"``. The reference point of a robot is then
            the origin of the map. On a :attr:`floor`, shapes of the plane count at all heights.
        radius : array-like, shape () or (n,), optional
            Radius of the balls around points, metres, zero or above.

        Returns
        -------
        Update

        Raises
        ------
        InputError
            If the name is empty or no string, or the obstacle is of another type or dimension, has
            points without a radius, is so far away that rounding could matter, or is in the plane
            and the robot leaves the heights of the workspace; nothing changes then. A
            :class:`cspace.errors.GeometryError` if it is empty, not finite, or a polygon that
            crosses itself.

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
        self._check_not_window()
        return self._set_obstacles({check_text(name, "name"): as_shape(shape, radius, "shape")})

    def _set_obstacles(self, shapes: Mapping[str, ShapeLike | None]) -> Update:
        """Add, move or remove named obstacles in one step."""
        obstacles: dict[str, Shape | None] = {}
        for name, shape in shapes.items():
            check_text(name, "name")
            obstacle = None if shape is None else as_shape(shape, None, "shape")
            if obstacle is not None and self.floor is not None:
                obstacle = self._fill_heights(obstacle, self.floor)
            if obstacle is not None and obstacle.dim != self.robot.dim:
                raise InputError(
                    "shape",
                    f"is in {obstacle.place}",
                    f"it must be in {self.robot.shape.place}, as the robot is",
                )
            obstacles[name] = obstacle
        with self.lock:
            for name in [name for name, obstacle in obstacles.items() if obstacle is None]:
                check_known(name, "name", self.obstacles)
            return self._updates.set_obstacles(obstacles)

    def _fill_heights(self, shape: Shape, floor: float) -> Shape:
        """Return a plane shape at all heights of the workspace; a shape in space unchanged.

        Raises InputError if the robot has other heights, at which it would meet nothing.
        """
        from cspace._shapes.prism import extrude

        grid = self.workspace.grid
        # Beyond ground and ceiling, so that the cells there lie in the prism.
        solid = extrude(shape, grid.lower[2] - grid.spacing, grid.upper[2] + grid.spacing)
        if solid is not shape:
            check_heights("shape", "is in the plane, and", floor, grid, self.robot)
        return solid

    def remove_obstacle(self, name: str) -> Update:
        """Remove a named obstacle; covered cells reappear.

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
        return self._set_obstacles({check_text(name, "name"): None})

    @property
    def obstacles(self) -> dict[str, Shape]:
        """The named obstacles at their current positions; a copy."""
        with self.lock:
            named = {} if self._layers is None else self._layers.named
            return {name: obstacle.shape for name, obstacle in named.items()}

    @lazy
    def _updates(self) -> Updater:
        """Updater that writes to the states when obstacles change."""
        from cspace._record.update import Updater

        return Updater(
            self._contents, self._layers, self._rasters, self._exterior, self._drop_derived
        )

    def _check_not_window(self) -> None:
        """Raise ConfigurationError if the map is a window of a larger one."""
        if self.outside == UNKNOWN:
            raise ConfigurationError(
                "the map",
                "is a window of a larger one",
                "the cells around it matter too",
            )

    def _drop_derived(self, workspace: Workspace, layers: ObstacleLayers | None) -> None:
        """Drop data derived from the cells, after updates.

        The map takes over the updated workspace.
        """
        contents = self._contents
        self._layers = layers
        self._own_proofs = None
        if contents.workspace is not workspace:
            # Overlap counts belong to the obstacles before the update.
            self._contents = replace(contents, workspace=workspace, overlap_counts=None)
        derived.drop(self)
        # Checkers of planners keep references to these two objects, so only their data are dropped.
        for name in ("_distances", "_exact"):
            if name in vars(self):
                vars(self)[name].drop()

    # ---- reasons ---------------------------------------------------------------------------------

    explain = _outside.explain
    removals = _outside.removals

    # ---- for files and messages ------------------------------------------------------------------

    def _distance_arrays(self) -> dict[str, NDArray[Any]]:
        """Return distances of cells as named arrays of a saved map."""
        boxes = self._distances.compute_all().boxes
        return {"distances": self._distances.array(), "distance_boxes": boxes}

    # ---- files and messages ----------------------------------------------------------------------

    @names_options
    def save(
        self,
        path: str | Path,
        *,
        overwrite: bool = False,
        compress: bool = True,
        clearance: bool = False,
    ) -> None:
        """Save as a Zarr folder, complete or not at all.

        :func:`cspace.open`, ``xarray.open_zarr``, any other reader of Zarr version 3, and the C++
        header of :func:`cspace.get_include` open it.

        Parameters
        ----------
        path : path-like
            The name ends in ``.zarr`` or has no suffix.
        overwrite : bool
            True to replace an existing map; other folders are never replaced.
        compress : bool
            True to compress the arrays by zstd; False to write raw bytes, which C++ maps into
            memory.
        clearance : bool
            True to add the distances of cells, four bytes a state, for clearances in C++.

        Raises
        ------
        InputError
            If the name has another suffix.
        FileError
            If the output exists and may not be replaced, or cannot be written.
        """
        from cspace._queries.leaving import describe_floor_parts
        from cspace._record.save import save

        with self.lock:  # an update waits
            contents = replace(self._contents, exterior=self._exterior)
            derived = self._distance_arrays() if clearance else None
            more = describe_floor_parts(contents)
            save(contents, path, overwrite, compress, derived, **more)

    export = _outside.export
    to_occupancy_grid = _outside.to_occupancy_grid
    to_costmap = _outside.to_costmap
    to_xarray = _outside.to_xarray

    # ---- caches ----------------------------------------------------------------------------------

    @lazy
    def _rasters(self) -> list[tuple[Raster, Raster]]:
        """Outer and inner rasters of each slice."""
        return rasters_of(self._contents, self.margin)

    @lazy
    def _exterior(self) -> Exterior:
        """States of the cells outside the grid."""
        return self._contents.exterior or Exterior.of(
            self.workspace.outer, self._rasters, self.outside, self.floor is not None
        )

    @lazy
    def _robot_parts(self) -> list[RobotPart]:
        """Convex parts of the robot, for motions that leave what is near."""
        from cspace._queries.leaving import split_robot

        return split_robot(self._contents)

    @property
    def _spans(self) -> Floats:
        """Largest motion of each coordinate between path rows; see the base class.

        A map stores no kinds of joints. One that goes on beyond both ends of the map may be
        continuous, and what it passes on the shorter way is not in the map.
        """
        if self.has_poses:
            return super()._spans
        first, last = self._exterior.table[0, :-1].reshape(2, -1)
        goes_on = (first < 0) & (last >= self.grid.shape) & (np.array(self.units) == "rad")
        return np.where(goes_on, HALF_TURN, math.inf)

    @lazy
    def _kept_values(self) -> dict[str, Any]:
        """Values that packages beside the core keep with the map."""
        return {}

    @lazy
    def _kernel_map(self) -> Map:
        """Map for compiled functions, which follows updates."""
        return make_map_record(
            self._states,
            self.grid,
            self._exterior.table,
            self.rotations._make_lookups(self._slice_of),
        )

    @derived
    def _edges_asked(self) -> int:
        """Number of edges asked so far in batches, by which blocks become worth their making."""
        return 0

    @derived
    def _blocks(self) -> Map:
        """The map coarsened to blocks of cells, which test many edges faster."""
        from cspace._queries.edges import coarsen_map

        return coarsen_map(self._kernel_map)

    @lazy
    def _exact(self) -> ExactQueries:
        """Queries that geometry decides in MIXED cells."""
        from cspace._exact.proofs import ExactQueries

        return ExactQueries(self._make_problem, lambda: self._own_proofs)

    def _make_problem(self) -> Problem:
        """Return the map and the geometry as inputs of exact queries."""
        from cspace._exact.boundaries import Problem

        exterior_blocked = self.outside != "free"
        return Problem(
            self._kernel_map,
            self.rotations,
            self.workspace,
            self.robot,
            self.margin,
            exterior_blocked,
            self.floor,
        )

    @property
    def tries_exact(self) -> bool:
        """Whether messages try the geometry before they advise it, for about a second."""
        # Largest number of workspace cells for which messages try the hints that they give.
        return self.grid.size <= 2**20

    @derived
    def _components(self) -> Components:
        """Connected components of the map."""
        from cspace._queries.components import Components

        exterior_open = ~self._exterior.is_all_blocked(self.grid.shape)
        return Components(self._states, self._slice_of, self.rotations.neighbors, exterior_open)

    @lazy
    def _distances(self) -> DistanceMap:
        """Distances of cells to those that are not FREE; they follow updates."""
        from cspace._queries.distance import BYTES_PER_CELL, DistanceMap

        # The table, and what is outside the grid, for one slice in each thread.
        threads = min(count_cores(), len(self._states))
        needed = BYTES_PER_CELL * (self._states.size + threads * self.grid.size)
        check_memory(needed, "the map, with the clearance of its cells,", self.grid)
        return DistanceMap(self._states, self._exterior.table, self.lock)

    @lazy
    def _robot_rows(self) -> RobotRows:
        """Rows of the robot's outer raster in each slice, for overlap counts."""
        from cspace._queries.overlaps import RobotRows

        outer = [outer for outer, _ in self._rasters]
        return RobotRows.of(outer if self.floor is None else [each.layers_first for each in outer])

    @derived
    def _outer_sums(self) -> NDArray[np.int32]:
        """Running counts of the outer cells, for overlap counts."""
        return self._sum_cells(self.workspace.outer)

    @derived
    def _inner_sums(self) -> NDArray[np.int32]:
        """Running counts of the inner cells, for overlap counts."""
        return self._sum_cells(self.workspace.inner)

    def _sum_cells(self, cells: Bools) -> NDArray[np.int32]:
        """Return running counts of cells of the workspace."""
        from cspace._queries.overlaps import BYTES_PER_CELL, sum_columns

        check_memory(BYTES_PER_CELL * cells.size, "the map, with sums of its cells,", self.grid)
        return sum_columns(cells if self.floor is None else put_layers_first(cells))

    @derived
    def _free_cells(self) -> FreeCells:
        """FREE cells, for sampling."""
        from cspace._queries.sampling import FreeCells

        return FreeCells(self._states)

    @property
    def _is_open(self) -> bool:
        """Whether the exterior is not BLOCKED at every rotation."""
        return not bool(self._exterior.is_all_blocked(self.grid.shape).all())

    @derived
    def _projections(self) -> list[Rectangles]:
        """Cells of positions that are not BLOCKED at every rotation, for bounds of lengths."""
        from cspace._queries.lower_bound import list_projections

        return list_projections(self._states.min(axis=0) < BLOCKED, self._is_open)

    @derived
    def _rectangles(self) -> Rectangles:
        """Runs of FREE cells of a plane map."""
        from cspace._queries.any_angle import list_rectangles

        return list_rectangles(self._states[0])

    @lazy
    def _look_up_state(self) -> LookUp:
        """Look-up of one configuration's state."""
        from cspace._queries.callbacks import bind_numbers, look_up_state

        return bind_numbers(look_up_state, (self._kernel_map,), self.size)

    @lazy
    def _look_up_flat_cell(self) -> LookUp:
        """Look-up of the flat index of one configuration's cell."""
        from cspace._queries.callbacks import bind_numbers, look_up_flat_cell

        return bind_numbers(look_up_flat_cell, (self._kernel_map,), self.size)

    @lazy
    def _look_up_motion(self) -> LookUp:
        """Look-up of whether one motion is proven free."""
        from cspace._queries.callbacks import MAX_SIZE, bind_numbers, look_up_motion

        fixed = self._kernel_map, self.size
        return bind_numbers(look_up_motion, fixed, 2 * self.size, 2 * MAX_SIZE)

    def _look_up_connection(self, apart: bool) -> LookUp:
        """Return the look-up of whether two configurations are proven connected, or apart."""
        find_cell = self._look_up_flat_cell
        size = self.size

        def look_up(numbers: tuple[float, ...]) -> int:
            """Return 1 if it is proven, else 0."""
            ends = numbers[:size], numbers[size:]
            first, second = map(find_cell, ends)
            if NO_ANSWER in (first, second):
                return NO_ANSWER
            joined = self._components.are_joined(first, second)
            if apart:
                return not (joined or self._components.are_joined(first, second, mixed=True))
            # As for a motion that stays where it is, no cell that is not FREE may touch them.
            return joined and all(self._look_up_motion(q + q) == FREE for q in ends)

        return look_up

    @property
    def _look_up_clearance(self) -> LookUp | None:
        """Look-up of one configuration's clearance; None before distances are computed."""
        return None if self._distances.table is None else self._measure_clearance

    @derived
    def _measure_clearance(self) -> LookUp:
        """Look-up of one configuration's clearance in the table of distances."""
        from cspace._queries.callbacks import bind_numbers
        from cspace._queries.distance import look_up_clearance

        table = self._distances.compute_slices([])
        return bind_numbers(look_up_clearance, (self._kernel_map, table), self.size)

    # ---- queries of rows -------------------------------------------------------------------------

    def _map_lock(self) -> AbstractContextManager[Any]:
        """Return the lock that is held while an update changes the map."""
        return self.lock

    def _find_unusable(self, rows: Floats) -> int:
        """Return the first unusable row's index, or -1.

        A row is a configuration; ``rows`` has shape (n, size).
        """
        return CSpace._write_states(self, rows, np.empty(len(rows), dtype=np.uint8))

    def _write_states(self, rows: Floats, out: States) -> int:
        """Write the states of configurations.

        ``rows`` has shape (n, size), ``out`` (n,). Returns the index of the first unusable row, or
        -1.
        """
        from cspace._queries.points import classify

        return write_in_threads(partial(classify, self._kernel_map), rows, out)

    def _write_motions(self, starts: Floats, ends: Floats, out: Bools) -> int:
        """Write whether motions are free.

        ``starts`` and ``ends`` have shape (n, size), ``out`` (n,). Returns the index of the first
        unusable motion, or -1.
        """
        from cspace._queries import edges

        blocks = self._kernel_map
        if len(starts) >= edges.MIN_EDGES_FOR_BLOCKS:
            self._edges_asked += len(starts)
            if self._edges_asked * edges.CELLS_PER_EDGE >= self._states.size:
                blocks = self._blocks
        write = partial(self._edge_query, self._kernel_map, blocks)
        return write_in_threads(write, starts, ends, out, min_items=MIN_EDGES_PER_THREAD)

    @property
    def _edge_query(self) -> Callable[[Map, Map, Floats, Floats, Bools], int]:
        """Query that writes whether motions are free."""
        from cspace._queries.edges import edges_are_free

        return edges_are_free

    def _count_free_tubes(self, starts: Floats, ends: Floats, radii: Floats, counts: Ints) -> None:
        """Lower counts to the number of tubes that are free, from the first on.

        Arguments are as for the base class.
        """
        from cspace._queries.edges import count_free_tubes

        # In the plane, the map is one layer, and a robot that does not turn has no angle.
        first = 3 - self.dim
        sizes = np.zeros((len(starts), 4))
        sizes[:, first : first + radii.shape[1]] = radii
        count = partial(count_free_tubes, self._kernel_map)
        min_chunks = max(1, MIN_EDGES_PER_THREAD // ends.shape[1])
        write_in_threads(count, sizes, starts, ends, counts, min_items=min_chunks)

    def _find_leaving_seconds(
        self, q: Floats, twist: Floats, seconds: float, tracking: Floats
    ) -> float:
        """Return for how long a twist comes no nearer to anything.

        Arguments are as for the base class.
        """
        from cspace._queries.leaving import find_leaving_seconds

        with self.lock:
            parts = self._robot_parts
            return find_leaving_seconds(self._contents, parts, q, twist, seconds, tracking)

    def _name_obstacles(self, q: Floats, distances: Floats, turn: float) -> tuple[str, ...]:
        """Return obstacles that reach the nearest cells not FREE, or what own proofs name."""
        if self._own_proofs is not None:
            return self._own_proofs.name_nearest(q)
        layers = self._layers
        if layers is None or not layers.named:
            return ()
        cell = self.grid.cell_of(q[: self.dim])
        reach = np.ceil(distances / self.grid.spacing).astype(np.int64) + 1
        first = np.clip(cell - reach, 0, self.grid.shape)
        stop = np.clip(cell + reach + 1, 0, self.grid.shape)
        _, rotation_cells = self.rotations.find_cells_within(q[np.newaxis], np.array([turn]))
        names = set[str]()
        for s in np.unique(self._slice_of[rotation_cells]).tolist():
            taken = np.argwhere(self._states[s][tuple(map(slice, first, stop))] != FREE) + first
            if len(taken):
                nearest = taken[np.abs(taken - cell).max(axis=1).argmin()]
                outer, _ = self._rasters[s]
                offsets = np.argwhere(outer.cells) + outer.lower
                offsets[:, : self.dim] += nearest  # on a floor, layers are those of the scene
                names |= layers.find_names(offsets)
        return tuple(sorted(names))

    def _write_clearances(self, rows: Floats, out: Floats) -> int:
        """Write the clearances of configurations, metres.

        ``rows`` has shape (n, size), ``out`` (n,). Returns the index of the first unusable row, or
        -1.
        """
        from cspace._queries.distance import write_clearances

        # Unless all distances are known, compute those of the slices that contain rows.
        table = self._distances.known
        if table is None:
            bad = self._find_unusable(rows)
            if bad >= 0:
                return bad
            slices = np.unique(self._slice_of[self.rotations._find_cells(rows)])
            table = self._distances.compute_slices(slices.tolist())
        return write_in_threads(partial(write_clearances, self._kernel_map, table), rows, out)

    def _count_overlaps(self, side: Literal["outer", "inner"], q: ArrayLike) -> int | Ints:
        """Count the obstacle cells that the robot overlaps, outer or inner.

        ``q`` are configurations, shape (..., size).
        """
        from cspace._queries.overlaps import count_overlaps

        # An unknown exterior counts as occupied in the outer sum and as free in the inner sum.
        exterior_counts = self.outside == "blocked" or (side == "outer" and self.outside == UNKNOWN)
        has_one_side = self.workspace.inner is self.workspace.outer
        sums = self._outer_sums if side == "outer" or has_one_side else self._inner_sums
        count = partial(
            count_overlaps, self._kernel_map, sums, self._robot_rows, int(exterior_counts)
        )
        write = partial(write_in_threads, count)
        counts: int | Ints = evaluate(q, self.axes, write, np.int64, self._angles)
        return counts

    def _check_in_grid(self, q: ArrayLike, name: str) -> Floats:
        """Return a canonical configuration in the grid, or raise ConfigurationError."""
        values = check_points(q, name, self.axes)
        warn_of_large(values, "rad", name, self._angles)
        point = self.rotations.make_canonical(values, name)
        is_valid = bool(point.ndim == 1 and self.grid.contains(point[: self.grid.dim]))
        if not is_valid:
            lower, upper = format_point(self.grid.lower), format_point(self.grid.upper)
            rule = f"it must be one configuration in the grid, from {lower} to {upper}"
            raise ConfigurationError(name, f"is {q!r}", rule)
        return point


class ExactCSpace(CSpace):
    """A map in memory whose MIXED cells the geometry decides; see :attr:`CSpace.exact`.

    It shares all attributes with the map whose view it is, so that both follow each update. What is
    to hold in whole cells asks :attr:`_cells`.
    """

    @property
    def exact(self) -> ExactCSpace:
        """The map itself."""
        return self

    @lazy
    def _cells(self) -> CSpace:
        """The map whose cells alone answer."""
        return _share(self, CSpace)

    @property
    def _look_up_state(self) -> LookUp:
        """Look-up of one configuration's state."""
        return self._exact.refine(super()._look_up_state, 2)

    @property
    def _look_up_motion(self) -> LookUp:
        """Look-up of whether one motion is proven free."""
        return self._exact.refine(super()._look_up_motion, 1)

    def _write_states(self, rows: Floats, out: States) -> int:
        """Write the states of configurations; see the base class."""
        return write_in_threads(partial(self._exact.write_states, self._kernel_map), rows, out)

    @property
    def _edge_query(self) -> Callable[[Map, Map, Floats, Floats, Bools], int]:
        """Query that writes whether motions are free."""
        return self._exact.write_edges

    def _count_free_tubes(self, starts: Floats, ends: Floats, radii: Floats, counts: Ints) -> None:
        """Lower counts to the number of tubes that are free, from the first on.

        Arguments are as for the base class. The geometry proves the tube of a motion that is free
        for the robot grown by as far as the tube moves any of its points. Maps of joints have no
        such proof, so cells alone decide there.
        """
        asked = counts.copy()
        super()._count_free_tubes(starts, ends, radii, counts)
        for chunk in np.flatnonzero(counts < asked).tolist():
            if self._own_proofs is not None:
                break
            tubes = slice(counts[chunk], asked[chunk])
            firsts = np.concatenate([starts[[chunk]], ends[chunk]])[tubes]
            lasts = ends[chunk, tubes]
            is_free = np.ones(len(lasts), dtype=np.int64)
            same_radii = np.repeat(radii[[chunk]], len(lasts), axis=0)
            super()._count_free_tubes(firsts, lasts[:, np.newaxis], same_radii, is_free)
            rest = np.flatnonzero(is_free == 0)
            proofs = proofs_of(self)
            # The motion itself is proven among the cells, too, of which some are BLOCKED.
            for growth in (0.0, proofs.bound_growth(radii[chunk])):
                rest = rest[proofs.are_free(firsts[rest], lasts[rest], growth)]
            is_free[rest] = 1
            counts[chunk] += np.logical_and.accumulate(is_free).sum()


def proofs_of(space: CSpace) -> Any:
    """Return the proofs by the present geometry, which decide MIXED cells of a map in memory.

    They are :class:`cspace._exact.proofs.BoundaryProofs` of robot and obstacles, unless the map has
    proofs of its own.
    """
    return space._exact.current_proofs()


def kept_values(space: CSpace) -> dict[str, Any]:
    """Return what packages beside the core keep with a map, by names; updates do not drop it."""
    return space._kept_values


def is_labelled(space: Space) -> bool:
    """Return whether ``path_exists`` answers at once: a map in memory first labels its cells."""
    return not isinstance(space, CSpace) or "_components" in vars(space)


def find_crossed_runs(
    space: CSpace,
    start: Floats,
    goal: Floats,
    until: Effort = NEVER,
    may_exist: Callable[[], bool] | None = None,
) -> Ints:
    """Find the runs of FREE cells that a shortest path in the plane crosses.

    A run is a maximal row of FREE cells along y. Of runs of the same rows in successive columns,
    the first and the last one are listed, which may be the same.

    Parameters
    ----------
    space : CSpace
        A map in memory of a robot that does not turn.
    start, goal : ndarray of float64, shape (2,)
        In cells, from the lower corner of the grid.
    until : Effort
        Reading of work and clock at which the search ends with a TimeoutError.
    may_exist : callable, optional
        Returns False if no path exists. It is asked once, if the search takes long.

    Returns
    -------
    ndarray of int64, shape (n, 3)
        Column of each run, its first cell, and the cell after its last one; n is 0 if there is no
        path.
    """
    from cspace._queries.any_angle import find_shortest_way

    rectangles = space._rectangles
    way = find_shortest_way(rectangles, start, goal, until, may_exist)
    columns = (rectangles.column, rectangles.low, rectangles.high)
    return np.stack([column[way.runs] for column in columns], axis=1)


def _share(space: CSpace, kind: type[Shared]) -> Shared:
    """Return a map of another kind with the attributes of a map, which both change."""
    shared = object.__new__(kind)
    shared.__dict__ = vars(space)
    return shared


def _broadcast_spans(values: ArrayLike, name: str, shape: tuple[int, ...]) -> Floats:
    """Broadcast lengths or angles of pieces to a batch of configurations.

    The result has shape (n,). ``shape`` is that of the batch. A single number is for all pieces.
    """
    spans = check_finite(values, name)
    if spans.shape not in ((), shape) or (spans < 0.0).any():
        raise InputError(
            name,
            f"is {values!r}",
            "it must be zero or above",
        )
    return np.full(shape, spans).ravel()
