"""Queries of all certified maps, in memory or in tiles."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from contextlib import AbstractContextManager
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike

from cspace import _outside
from cspace._grid import Grid
from cspace._interface import (
    ConfigurationSpace,
    Endpoint,
    LookUp,
    tubes_are_free,
)
from cspace._queries.batches import Configuration, evaluate, evaluate_edges
from cspace._queries.yaws import join_yaw_cells
from cspace._robot import Robot
from cspace._rotations import Rotations
from cspace._rotations.base import ROTATION_UNITS
from cspace._shapes import OriginPoint
from cspace._support.arrays import BLOCKED, FREE, MIXED, STATE_NAMES, Bools, Floats, Ints, read_only
from cspace._support.check import (
    check_finite,
    check_point,
    check_rows,
    names_options,
)
from cspace._support.reporting import format_point
from cspace._support.units import warn_of_large
from cspace.errors import ConfigurationError, EndReason, InputError

if TYPE_CHECKING:
    from cspace._record.contents import Contents


class HasComponents(Protocol):
    """Components of cells that share sides, with their look-up."""

    def find(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the component of each cell.

        Components consist of FREE cells, or of FREE and MIXED cells; -1 outside these.
        """


class ConfigurationMap(ConfigurationSpace):
    """A certified map of a robot's configurations.

    :class:`cspace.CSpace` has its cells in memory, :class:`cspace.TiledCSpace` reads them from a
    store.
    """

    _has_cells: ClassVar[bool] = True

    # ---- what the map is -------------------------------------------------------------------------

    @property
    @abstractmethod
    def _map_contents(self) -> Contents:
        """Contents of the map, shared by all tiles of a tiled map."""

    @property
    def grid(self) -> Grid:
        """Grid of positions of the reference point."""
        return self._map_contents.grid

    @property
    def frame_id(self) -> str:
        """Frame of the map in ROS; "map" if unknown."""
        return self.grid.frame_id or "map"

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self._map_contents.robot

    @property
    def floor(self) -> float | None:
        """Height of the reference point of a robot in space that drives on a floor, metres.

        None for all other maps. See :func:`cspace.build`.
        """
        return self._map_contents.floor

    @cached_property
    def drawn_robot(self) -> Robot:
        """The robot as pictures on the grid show it; its footprint if it drives on a floor."""
        return self.robot if self.floor is None else self.robot.footprint()

    @property
    def rotations(self) -> Rotations:
        """Rotation cells; a single one if the robot does not rotate."""
        return self._map_contents.rotations

    @property
    def slice_of(self) -> Ints:
        """Slice of each rotation cell, shape (rotation cells,); read-only.

        Rotation cells share a slice if a symmetry of the robot maps one to the other.
        """
        return read_only(self._map_contents.slice_of)

    @property
    def slice_rotations(self) -> Floats:
        """One rotation of each slice.

        It has the form that it has in a configuration: shape (slices, k), where k is 0, 1 or 4.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.rectangle(0.4, 0.2), rotations=8)
        >>> space.slice_of.tolist()
        [0, 1, 2, 3, 0, 1, 2, 3]
        >>> len(space.slice_rotations)
        4
        """
        _, first_cells = np.unique(self.slice_of, return_index=True)
        return self.rotations.centers[first_cells]

    @property
    def outside(self) -> str:
        """State of space outside the workspace.

        It is "blocked", "free", or "unknown" around a part of a larger map.
        """
        return self._map_contents.outside

    @property
    def margin(self) -> float:
        """Growth of the robot for FREE, metres."""
        return self._map_contents.margin

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the coordinates: x, y(, z), then yaw or qx, qy, qz, qw."""
        return (*self.grid.axes, *self.rotations.names)

    @cached_property
    def has_poses(self) -> bool:
        """Whether configurations are poses of a rigid body; False for joints of any name."""
        return super().has_poses and not isinstance(self.robot.shape, OriginPoint)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates of a configuration.

        They are "m", "rad", or "1" for a quaternion.
        """
        return (*self.grid.units, *(ROTATION_UNITS[name] for name in self.rotations.names))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the grid."""
        return np.array(self.grid.lower), np.array(self.grid.upper)

    @property
    @abstractmethod
    def exact(self) -> ConfigurationMap:
        """The same map, whose MIXED cells the geometry decides; see :attr:`cspace.CSpace.exact`."""

    @property
    def _cells(self) -> ConfigurationMap:
        """The map whose cells alone answer."""
        return self

    @property
    def resolution(self) -> float:
        """Half a cell."""
        return 0.5 * self.grid.spacing

    @property
    def dof(self) -> int:
        """Degrees of freedom: 2 or 3, plus 1 for yaw, 3 for rotation."""
        return self.size - ("qw" in self.rotations.names)  # a quaternion has norm 1

    @abstractmethod
    def count(self) -> tuple[int, int, int]:
        """Count the FREE, MIXED and BLOCKED cells over all rotation cells."""

    def _count_by_name(self) -> dict[str, int]:
        """Count the cells of each state, by its name."""
        return dict(zip(STATE_NAMES, self.count(), strict=True))

    def __repr__(self) -> str:
        """Return the cells, the robot and a summary of the states."""
        cells = " x ".join(map(str, self.grid.shape))
        turns = f" x {self.rotations}" if self.rotations.names else ""
        size = f"{cells} cells of {self.grid.spacing:g} {self.grid.unit}{turns}"
        return f"{type(self).__name__}({size}, {self.robot.name}: {self._summary})"

    # ---- look-ups --------------------------------------------------------------------------------

    def _check_configurations(self, q: ArrayLike, name: str = "q") -> Floats:
        """Return configurations as an array, shape (..., size).

        Raises InputError if a value is not finite, or a rotation is invalid.
        """
        points = check_rows(q, name, self.axes).astype(np.float64, copy=False)
        evaluate(points, self.axes, self._write_states, np.uint8, self._angles, name)
        return points

    @overload
    def is_connected(self, q0: Configuration, q1: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_connected(self, q0: ArrayLike, q1: ArrayLike) -> Bools: ...
    @names_options
    def is_connected(self, q0: ArrayLike, q1: ArrayLike) -> bool | Bools:
        """Return True if a collision-free path is proven to exist between configurations.

        The proof is a chain of FREE cells, and that no other cell touches the two configurations;
        :func:`planners.plan` with "Grid" finds a path. False proves nothing: see
        :meth:`is_disconnected`.
        Components of cells are computed at the first call and cached; a tiled map caches them in
        its folder.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,) or (..., size)
            Metres, and radians; broadcast against each other.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        joined: bool | Bools = self._test_connections(q0, q1, apart=False)
        return joined

    @overload
    def is_disconnected(self, q0: Configuration, q1: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_disconnected(self, q0: ArrayLike, q1: ArrayLike) -> Bools: ...
    @names_options
    def is_disconnected(self, q0: ArrayLike, q1: ArrayLike) -> bool | Bools:
        """Return True if configurations are proven disconnected.

        No collision-free path between them exists then. The proof is that no chain of FREE and
        MIXED cells joins them. If this and :meth:`is_connected` are both False, the map is too
        coarse to decide; plan on :attr:`exact`, or build with a finer spacing.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,) or (..., size)
            Metres, and radians; broadcast against each other.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        apart: bool | Bools = self._test_connections(q0, q1, apart=True)
        return apart

    def _test_connections(self, q0: ArrayLike, q1: ArrayLike, apart: bool) -> Any:
        """Return whether configurations are proven connected; with ``apart``, disconnected."""
        write = partial(self._write_connections, apart)
        with self._map_lock():
            known = self._ask_one(self._look_up_connection(apart), q0, q1)
            if known is not None:
                return known == 1
            return evaluate_edges(q0, q1, self.axes, write, self._angles)

    def _look_up_connection(self, apart: bool) -> LookUp | None:
        """Return the look-up of whether two configurations are proven connected, or apart."""
        return None

    @property
    def _look_up_clearance(self) -> LookUp | None:
        """Look-up of one configuration's clearance, metres."""
        return None

    def _write_connections(self, apart: bool, starts: Floats, ends: Floats, out: Bools) -> int:
        """Write which pairs are proven connected, or disconnected.

        With ``apart``, the answer is True for disconnected ones. ``starts`` and ``ends`` have shape
        (n, size). Returns the first unusable pair, or -1.
        """
        # The higher state of both ends: only FREE ends have a component of FREE cells.
        highest = np.zeros(len(out), dtype=np.uint8)
        for rows in (starts, ends):
            states = np.empty(len(out), dtype=np.uint8)
            bad = self._write_states(rows, states)
            if bad >= 0:
                return bad
            np.maximum(highest, states, out=highest)
        start_cells = self._cells_of(starts)
        end_cells = self._cells_of(ends)

        def find_joined(candidates: Bools, mixed: bool) -> Bools:
            """Return a mask of the candidate pairs that share a component."""
            if not candidates.any():  # then components need not be computed
                return candidates
            first = self._components.find(start_cells, mixed)
            second = self._components.find(end_cells, mixed)
            return np.asarray(candidates & (first == second) & (first != -1))

        # Pairs that FREE cells join are connected; those that not even MIXED cells join are apart.
        joined = find_joined(np.asarray(highest == FREE), mixed=False)
        if apart:
            joined |= find_joined(np.asarray((highest <= MIXED) & ~joined), mixed=True)
        # A path is proven only between configurations that no cell but FREE ones touches.
        if not apart:
            for rows in (starts, ends):
                touches_only_free = np.empty(int(joined.sum()), dtype=np.bool_)
                self._write_motions(rows[joined], rows[joined], touches_only_free)
                joined[joined] = touches_only_free
        np.not_equal(joined, apart, out=out)
        return -1

    @names_options
    def free_yaws(self, position: ArrayLike) -> Floats:
        """Return intervals of yaw proven free at a position.

        Parameters
        ----------
        position : array-like, shape (2,) or (3,)
            Metres.

        Returns
        -------
        ndarray of float64, shape (n, 2)
            Lower and upper bound of each interval, radians. Lower bounds lie in [-pi, pi) and rise,
            upper bounds are at most a turn larger. A robot that is free at all yaws has the
            interval from -pi to pi.

        Raises
        ------
        InputError
            If the robot does not rotate about z alone, or the position has another shape or is not
            finite.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.zeros((30, 9), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.rectangle(1.2, 0.2), rotations=8)
        >>> np.rad2deg(space.free_yaws((1.55, 0.45))).round(1).tolist()
        [[-22.5, 22.5], [157.5, 202.5]]
        """
        if self.rotations.names != ("yaw",):
            problem = f"has the axes {', '.join(self.axes)}"
            raise InputError("space", problem, "only a robot with a yaw has free yaws")
        point = check_point(position, "position", self.dim)
        yaws = self.rotations.centers
        # Of a center, the geometry proves no more than the center.
        is_free = self._cells.is_free(np.column_stack([np.tile(point, (len(yaws), 1)), yaws]))
        return join_yaw_cells(is_free, self.rotations._stored_arrays["yaw_bounds"])

    @overload
    def clearance(self, q: Configuration) -> float: ...  # type: ignore[overload-overlap]
    @overload
    def clearance(self, q: ArrayLike) -> Floats: ...
    @names_options
    def clearance(self, q: ArrayLike) -> float | Floats:
        """Return a lower bound of the distance to configurations not FREE.

        The distance is in the translation, to the nearest one. The bound is proven. At the center
        of a cell, it is the distance but for rounding. Elsewhere in the grid, it is less than 1.42
        cells below in the plane and 1.74 in space; a few hundredths of a cell on average, a tenth
        where all is near obstacles. Outside the grid, it is at least the distance to the box around
        the grid and all cells that are not FREE. It is zero if the configuration is not FREE, and
        infinite if every configuration at its rotation is FREE.

        The first query at a rotation computes the distances of all cells there, 4 bytes each, and
        so does the first one after an update: some 20 ms for a million cells.

        Clearances in a tiled map are at most the width of the halo of a tile, less two cells,
        because all farther away is unknown there.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        float or ndarray of float64, shape (...)
            Metres; in a map of joints their unit, such as radians.
        """
        metres: float | Floats | None = self._ask_one(self._look_up_clearance, q)
        if metres is None:
            metres = evaluate(q, self.axes, self._write_clearances, np.float64, self._angles)
        return metres

    # ---- for planners ----------------------------------------------------------------------------

    def path_exists(self, q0: ArrayLike, q1: ArrayLike) -> bool | None:
        """Return :meth:`is_connected`, or False if :meth:`is_disconnected`; None if undecided."""
        q0 = self.check_configuration(q0, "q0")
        q1 = self.check_configuration(q1, "q1")
        if self.is_connected(q0, q1):
            return True
        return False if self.is_disconnected(q0, q1) else None

    @property
    def tries_exact(self) -> bool:
        """Whether messages try the geometry before they advise it, for about a second."""
        return False

    def check_configuration(self, q: ArrayLike, name: str = "q") -> Floats:
        """Return one configuration in canonical form; warn if an angle seems to be in degrees.

        Raises InputError if it is not one configuration, or not finite.
        """
        q = self._read_message(q)
        point = super().check_configuration(q, name)
        warn_of_large(check_finite(q, name, self.axes), "rad", name, self._angles)
        return point

    def check_endpoint(self, q: ArrayLike, name: str) -> Endpoint:
        """Return a start or goal in canonical form.

        Raises ConfigurationError unless the configuration lies in the grid and a motion that stays
        there is proven free; the error names the nearest FREE configuration.
        """
        point: Endpoint = tuple(self.check_configuration(q, name).tolist())
        is_inside = bool(self.grid.contains(np.array(point[: self.dim])))
        if is_inside and self.edge_checker()(*point, *point):
            return point
        raise self._make_endpoint_error(point, name, is_inside)

    def _make_endpoint_error(
        self, point: Endpoint, name: str, is_inside: bool
    ) -> ConfigurationError:
        """Make the error for an invalid start or goal.

        ``name`` says which one it is, and ``is_inside`` whether it lies in the grid.
        """
        # Find the reason. Only geometry can distinguish a collision from an undecided cell.
        state = self._cells.classify(point)
        is_exact = self._cells is not self
        is_tried = is_inside and state != BLOCKED and not is_exact and self.tries_exact
        is_proven = is_tried and self.exact.edge_checker()(*point, *point)
        reason: EndReason = "blocked" if state == BLOCKED else "mixed"
        if not is_inside:
            reason = "outside"
            lower, upper = format_point(self.grid.lower), format_point(self.grid.upper)
            problem = f"lies outside the map, which reaches from {lower} to {upper}"
            rule = "a path stays within the map"
        elif state == MIXED and (is_exact or is_tried) and not is_proven:
            problem = "is in collision or too close to decide"
            rule = "it must be proven collision-free, by the map or by the geometry"
        elif state != FREE:
            problem = f"lies in a {STATE_NAMES[state].upper()} cell"
            rule = "it must be FREE, that is proven collision-free"
        else:
            problem = "is FREE but lies on the border of a cell that is not"
            rule = "it must lie inside a FREE cell, because motions touch both cells"
        hint, nearest = _suggest_endpoint(self, point)
        if is_proven:
            hint = f"space.exact proves it free; {hint}"
        problem = f"{_drop_noise(point)} {problem}"
        return ConfigurationError(name, problem, rule, hint, nearest=nearest, reason=reason)

    # ---- pictures, and convex regions ------------------------------------------------------------

    plot = _outside.plot
    _repr_png_ = _outside.show_png
    free_region = _outside.free_region
    free_regions = _outside.free_regions

    # ---- what differs ----------------------------------------------------------------------------

    @abstractmethod
    def nearest_free(self, q: ArrayLike) -> Floats:
        """Return the center of the nearest FREE cell, or raise ConfigurationError."""

    @property
    @abstractmethod
    def _summary(self) -> str:
        """Summary of the states, for the repr."""

    @property
    def facts(self) -> dict[str, object]:
        """Plain values by name that describe the rotation cells and the states."""
        return {**self.rotations._facts, **self._facts}

    @property
    @abstractmethod
    def _facts(self) -> dict[str, object]:
        """Plain values by name that describe the states."""

    @abstractmethod
    def _map_lock(self) -> AbstractContextManager[Any]:
        """Return the lock that is held while an update changes the map."""

    @abstractmethod
    def _write_clearances(self, rows: Floats, out: Floats) -> int:
        """Write the clearances of configurations, metres.

        ``rows`` has shape (n, size), ``out`` (n,). Returns the index of the first unusable row, or
        -1.
        """

    def _write_free(self, rows: Floats, out: Bools) -> int:
        """Write whether configurations are FREE.

        ``rows`` has shape (n, size), ``out`` (n,). Returns the index of the first unusable row, or
        -1.
        """
        states = out.view(np.uint8)  # states and answers are bytes, so they share memory
        bad = self._write_states(rows, states)
        np.equal(states, FREE, out=out)
        return bad

    def _explain_tube(self, rows: Floats, radii: Floats) -> tuple[tuple[str, ...], str]:
        """Return obstacles near a tube's first unproven instant, and a sentence.

        If all instants are proven, the tube fails between them, and the first one stands for it.
        """
        are_free = tubes_are_free(self, rows, rows, np.tile(radii, (len(rows), 1)))
        q = rows[int(are_free.argmin())]
        names = self._name_obstacles(q, radii[: self.dim], float(radii[self.dim :].sum()))
        where = ", ".join(f"{value:.6g}" for value in q.tolist())
        near = f", near {', '.join(names)}" if names else ""
        return names, f"the motion is not proven free at ({where}){near}"

    def _name_obstacles(self, q: Floats, distances: Floats, turn: float) -> tuple[str, ...]:
        """Return names of obstacles that keep configurations from being proven free."""
        return ()

    @property
    @abstractmethod
    def _components(self) -> HasComponents:
        """Connected components of cells that share sides."""

    def _cells_of(self, points: Floats) -> Ints:
        """Return the cells of configurations.

        They are ``(rotation, x, y)`` or ``(rotation, x, y, z)``, and may lie outside the grid.
        """
        cells = self.grid.cell_of(points[..., : self.grid.dim])
        rotations = self.rotations._find_cells(points)[..., np.newaxis]
        return np.concatenate([rotations, cells], axis=-1)


def contents_of(space: ConfigurationMap) -> Contents:
    """Return the contents of a map, without cells if it is tiled; an update changes them."""
    return space._map_contents


def find_components(space: ConfigurationMap, q: Floats, mixed: bool = False) -> Ints:
    """Return the number of the connected component of each configuration's cell, or -1.

    ``q`` has shape (n, size). Components consist of FREE cells, or with ``mixed`` of FREE and
    MIXED cells, that share sides.
    """
    with space._map_lock():  # an update changes the components
        return space._components.find(space._cells_of(q), mixed)


def _drop_noise(q: Iterable[float]) -> Endpoint:
    """Return a configuration as messages show it, with 12 digits."""
    return tuple(float(f"{value:.12g}") for value in q)


def _suggest_endpoint(space: ConfigurationMap, point: Endpoint) -> tuple[str, Endpoint | None]:
    """Return a hint for an invalid endpoint, and the nearest FREE configuration."""
    try:
        nearest = tuple(space.nearest_free(point).tolist())
    except ConfigurationError as error:
        return f"{error.argument} {error.problem}", None
    return f"the nearest is {_drop_noise(nearest)}", nearest
