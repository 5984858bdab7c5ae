"""ConfigurationMap: what every certified map answers, be it in memory or in a store."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import Grid
from cspace.map.batches import Ask, Many, One, answer, answer_edges, answer_pairs, as_pairs, as_points, in_pieces
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.states import BLOCKED, FREE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.exact.queries import Exact
    from cspace.plot.picture import PlotOptions
    from cspace.plot.route import MapLike
    from cspace.view import Viewer, ViewOptions
    from cspace.view.cells import Cells

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
States = NDArray[np.uint8]
Result = TypeVar("Result")
Leg = tuple[Callable[[], "ConfigurationMap"], Floats, Floats]
"""What opens a part of a map in memory, and two configurations in it."""


_ANSWERS = np.array([None, True, False], dtype=object)


class Joined(Protocol):
    """What chains of cells join."""

    def of(self, cells: Ints) -> tuple[Ints, Ints]:
        """Numbers of the components of FREE cells, and of cells that are not BLOCKED; -1 where there is none."""


class ConfigurationMap(ABC):
    """A certified map of a robot's configurations: what it is of, and the look-ups that all maps have.

    :class:`cspace.CSpace` has all of it in memory, :class:`cspace.TiledCSpace` leaves it in a store. They differ in who
    answers for a batch of configurations, and in what is known of the cells that chains join.
    """

    # ---- what the map is ---------------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def grid(self) -> Grid:
        """Cells of positions of the robot's reference point; the workspace's grid."""

    @property
    @abstractmethod
    def robot(self) -> Robot:
        """The robot."""

    @property
    @abstractmethod
    def rotations(self) -> Rotations:
        """The rotation cells; one of a robot that only translates."""

    @property
    @abstractmethod
    def outside(self) -> str:
        """What lies beyond the workspace, "blocked" or "free"; "unknown" of a part of a larger map."""

    @property
    @abstractmethod
    def margin(self) -> float:
        """Metres by which the robot was grown for FREE."""

    @property
    def dof(self) -> int:
        """How many numbers a configuration has."""
        return len(self.axes)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the numbers in a configuration: x and y, in space z, then yaw or qx, qy, qz and qw."""
        return (*"xyz"[: self.grid.dim], *self.rotations.names)

    @abstractmethod
    def count(self) -> tuple[int, int, int]:
        """Number of FREE, MIXED and BLOCKED cells, over all rotation cells."""

    def __repr__(self) -> str:
        cells = " x ".join(map(str, self.grid.shape))
        turns = f" x {self.rotations}" if self.rotations.names else ""
        size = f"{cells} cells of {self.grid.spacing:g} m{turns}"
        return f"{type(self).__name__}({size}, {self.robot.name}: {self._summary})"

    # ---- look-ups ----------------------------------------------------------------------------------------------------

    @overload
    def classify(self, q: One) -> int: ...  # type: ignore[overload-overlap]
    @overload
    def classify(self, q: Many) -> NDArray[np.uint8]: ...
    def classify(self, q: ArrayLike) -> int | NDArray[np.uint8]:
        """State of configurations.

        Parameters
        ----------
        q : array-like, shape (dof,) or (..., dof)
            Metres, and radians.

        Returns
        -------
        int or ndarray of uint8, shape (...)
            FREE (0), MIXED (1) or BLOCKED (2).

        Raises
        ------
        InputError
            If the last axis is not dof long, or a value is NaN or infinite.
        """
        return answer(q, self.dof, self._classify(), np.uint8, int)

    @overload
    def is_free(self, q: One, *, exact: bool = False) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_free(self, q: Many, *, exact: bool = False) -> Bools: ...
    def is_free(self, q: ArrayLike, *, exact: bool = False) -> bool | Bools:
        """Whether configurations are proven collision-free; as :meth:`classify`, with bool for an answer.

        With ``exact``, the geometry itself decides in MIXED cells; see :mod:`cspace.exact`.
        """
        if exact:
            return answer(q, self.dof, in_pieces(self._exact.points()), np.bool_, bool)
        free: bool | Bools = answer(q, self.dof, self._classify(), np.uint8, int) == FREE
        return free

    @overload
    def motion_is_free(self, q0: One, q1: One, *, exact: bool = False) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def motion_is_free(self, q0: Many, q1: ArrayLike, *, exact: bool = False) -> Bools: ...
    @overload
    def motion_is_free(self, q0: ArrayLike, q1: Many, *, exact: bool = False) -> Bools: ...
    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike, *, exact: bool = False) -> bool | Bools:
        """Whether straight edges are proven collision-free all along.

        True where every closed cell that the edge touches, be it in a corner, is FREE. An edge that lies on the border
        of two cells touches both; so an edge that starts on the border of a cell that is not FREE is not proven.

        Parameters
        ----------
        q0, q1 : array-like, shape (dof,) or (..., dof)
            Ends of the edges, metres and radians; broadcast against each other.
        exact : bool
            Where cells are MIXED, let the geometry itself prove the edge; see :mod:`cspace.exact`.

        Returns
        -------
        bool or ndarray of bool, shape (...)
        """
        return answer_edges(q0, q1, self.dof, lambda number: self._edges(number, exact))

    def certify_path(self, path: ArrayLike, edges: ArrayLike | None = None, *, exact: bool = False) -> Bools:
        """Whether each edge of a path, of paths, or of a roadmap is proven collision-free all along.

        The edges are those of :meth:`motion_is_free`, answered alike: straight, with yaw along the shorter arc, as
        OMPL interpolates. Where there are many, they are proven in threads and with marks of blocks of cells that
        pass over free space in larger steps; the answers are the same.

        Parameters
        ----------
        path : array-like, shape (n, dof) or (..., n, dof)
            Configurations, metres and radians: a path's in turn, those of paths of one length, or a roadmap's vertices.
        edges : array-like of int, shape (m, 2), optional
            Indices, from 0, of the two vertices of each edge; ``path`` must then have shape (n, dof). Left out, each
            configuration is joined to the next.
        exact : bool
            As for :meth:`motion_is_free`.

        Returns
        -------
        ndarray of bool, shape (n - 1,), (..., n - 1) or (m,)
            A path of one configuration has no edges, and nothing is proven of it.

        Raises
        ------
        InputError
            If a configuration is not as for :meth:`motion_is_free`, be it on an edge or not; a path has none; or an
            edge is not a pair of indices of vertices.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
        >>> corners = [(0.5, 1.5), (0.5, 2.5), (1.5, 2.5), (1.5, 0.5)]
        >>> space.certify_path(corners)
        array([ True,  True, False])
        >>> space.certify_path(corners, [(0, 2), (2, 3)])
        array([ True, False])
        """
        points = self._checked(path, "path")
        if edges is not None:
            pairs = as_pairs(edges, points)
            return answer_pairs(np.ascontiguousarray(points), pairs, self._edges(len(pairs), exact))
        if points.ndim < 2 or points.shape[-2] == 0:
            rule = "it must hold at least one configuration in a row"
            raise InputError("path", f"has shape {points.shape}", rule, f"pass an array of shape (n, {self.dof})")
        starts, ends = points[..., :-1, :], points[..., 1:, :]
        return np.asarray(answer_edges(starts, ends, self.dof, lambda number: self._edges(number, exact)))

    @overload
    def path_exists(self, q0: One, q1: One) -> bool | None: ...  # type: ignore[overload-overlap]
    @overload
    def path_exists(self, q0: Many, q1: ArrayLike) -> NDArray[np.object_]: ...
    @overload
    def path_exists(self, q0: ArrayLike, q1: Many) -> NDArray[np.object_]: ...
    def path_exists(self, q0: ArrayLike, q1: ArrayLike) -> bool | NDArray[np.object_] | None:
        """Whether a collision-free path joins configurations.

        Which cells are joined is found out at the first call, and kept; of a map in a store, in its store.

        Parameters
        ----------
        q0, q1 : array-like, shape (dof,) or (..., dof)
            Metres, and radians; broadcast against each other.

        Returns
        -------
        True, False or None, or ndarray of object, shape (...)
            True: a chain of FREE cells joins them. False: no chain of FREE and MIXED cells does, which proves that no
            collision-free path exists. None: undecided at this resolution.
        """
        return self._at_one_moment(lambda: self._path_exists(q0, q1))

    def _path_exists(self, q0: ArrayLike, q1: ArrayLike) -> bool | NDArray[np.object_] | None:
        cells, states = [], []
        for q, name in ((q0, "q0"), (q1, "q1")):
            points = as_points(q, name, self.dof)
            states.append(np.asarray(answer(points, self.dof, self._classify(), np.uint8, int, name)))
            cells.append(self._cells_of(points).reshape(-1, 1 + self.grid.dim))
        free, passable = self._components.of(np.concatenate(cells))
        passable[np.concatenate([each.reshape(-1) for each in states]) == BLOCKED] = -1
        free0, open0 = (each[: len(cells[0])].reshape(states[0].shape) for each in (free, passable))
        free1, open1 = (each[len(cells[0]) :].reshape(states[1].shape) for each in (free, passable))
        joined, apart = (free0 == free1) & (free0 != -1), (open0 != open1) | (open0 == -1)
        answers: NDArray[np.object_] = _ANSWERS[np.where(apart, 2, joined), ...]
        found: bool | NDArray[np.object_] | None = answers if answers.ndim else answers[()]
        return found

    # ---- seen --------------------------------------------------------------------------------------------------------

    def plot(self, **options: Unpack[PlotOptions]) -> Axes:
        """Draw the map, of one in tiles an overview; see :func:`cspace.plot.plot`, which takes the same.

        No window is opened; a notebook shows the axes as the picture.
        """
        from cspace.plot import plot

        return plot(self._drawn(), **options)

    def view(self, *, block: bool = True, **options: Unpack[ViewOptions]) -> Viewer:
        """Show the map on a page in the browser, and plan there; needs viser: ``pip install "cspace[view]"``.

        The page shows obstacles, the border of the C-obstacle and the robot, lets one drag the start and the goal, plan
        and play the path, and says what is proven. It is served on this machine alone, unless ``host`` says otherwise.

        Parameters
        ----------
        block : bool
            Whether to wait until Ctrl-C is pressed. If not, :meth:`cspace.view.Viewer.close` ends the page.
        path : array-like, shape (n, dof), or Plan, optional
            A path to show.
        start, goal : array-like, shape (dof,), optional
            Where the two are at first; by default the ends of the path, or FREE configurations far apart.
        host : str
            Address to serve on; by default "127.0.0.1". Who can reach it can plan on the map, and move the page.
        port : int, optional
            By default the first free one from 8080 on.

        Returns
        -------
        cspace.view.Viewer
            The page: its ``url``, its ``plan``, ``refresh()`` for a map that was updated, ``close()``.

        Raises
        ------
        InputError
            If the path or a configuration has the wrong shape, the port is taken, or the host is none of this machine.
        MissingPackageError
            If viser is not installed.
        """
        from cspace.view.viewer import opened

        return opened(self, self._in_blocks(), block, options)

    # ---- what differs ------------------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def _summary(self) -> str:
        """What the repr ends with."""

    @property
    @abstractmethod
    def _facts(self) -> dict[str, Any]:
        """What there is to say of it beside its grid, for people: plain values by what they are."""

    @abstractmethod
    def _drawn(self) -> MapLike:
        """What is drawn of it."""

    @abstractmethod
    def _classify(self) -> Ask:
        """What tells the states of configurations."""

    @abstractmethod
    def _edges(self, number: int, exact: bool) -> Ask:
        """What tells whether edges are free, of which there are some ``number`` to come."""

    @property
    @abstractmethod
    def _exact(self) -> Exact:
        """What asks the geometry itself."""

    @property
    @abstractmethod
    def _components(self) -> Joined:
        """What chains of cells join."""

    @abstractmethod
    def _legs(self, q0: Floats, q1: Floats) -> list[Leg]:
        """The parts of the map, in memory, that a path from a configuration to another leads through, in turn.

        Each is told with the configurations between which it leads through that part; the last one is the first one of
        the next. None, where the map is in parts and FREE cells do not join the two.
        """

    @abstractmethod
    def _around(self, q: Floats) -> ConfigurationMap:
        """The map, or of one that is not in memory what lies around a configuration."""

    @abstractmethod
    def _at_one_moment(self, work: Callable[[], Result]) -> Result:
        """What some work comes to, all of which sees the map as it is at one moment."""

    @abstractmethod
    def _in_blocks(self) -> Cells:
        """Its cells, to be drawn on a page."""

    # ---- checks ------------------------------------------------------------------------------------------------------

    def _checked(self, q: ArrayLike, name: str) -> Floats:
        """Configurations as float64, all finite and of the right length."""
        points = as_points(q, name, self.dof)
        answer(points, self.dof, self._classify(), np.uint8, int, name)  # raises where one is not finite
        return points

    def _cells_of(self, points: Floats) -> Ints:
        """Cells ``(rotation, x, y)`` or ``(rotation, x, y, z)`` of configurations, in the grid or not."""
        cells = self.grid.cell_of(points[..., : self.grid.dim])
        return np.concatenate([self.rotations.cells_of(points)[..., None], cells], axis=-1)
