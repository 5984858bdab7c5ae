"""CSpace: the map of a robot's configurations, and everything that can be asked of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.questions import Questions
from cspace.states import BLOCKED

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

    from cspace.connectivity import Components
    from cspace.spectral import FourierOverlap, OverlapField
    from cspace.updates import Update

Floats = NDArray[np.float64]


class CSpace(Questions):
    """Certified map of a robot's configurations: ``(x, y)`` or ``(x, y, yaw)`` in the plane, ``(x, y, z)`` in space.

    :func:`cspace.build` makes it and :func:`cspace.open` reads a saved one. Every look-up takes one configuration,
    shape (dof,), and answers with a Python number, or a batch, shape (..., dof), and answers with an array of shape
    (...). Look-ups are compiled and may be called from several threads at once. What they need beyond the map itself
    (distances, labels, sums) is computed at the first call and kept. Yaw is in radians, and wrapped.

    A configuration outside the grid is BLOCKED under ``outside="blocked"`` where the robot is proven to stick out of
    the workspace, FREE under ``outside="free"`` where it is proven to reach no obstacle, and otherwise MIXED.
    """

    # ---- what FREE cells join ----------------------------------------------------------------------------------------

    def path_exists(self, q0: ArrayLike, q1: ArrayLike) -> Any:
        """Whether a collision-free path joins configurations.

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
        from cspace.connectivity import path_exists

        ends = (self._checked(q0, "q0"), self._checked(q1, "q1"))
        return path_exists(self._components, *((self._cells_of(q), np.asarray(self.classify(q))) for q in ends))

    def free_reach(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """The box, along the axes, around all FREE cells of the grid that chains of FREE cells join to a configuration.

        No path through FREE cells of the grid leaves it, which narrows down where a planner has to look.

        Parameters
        ----------
        q : array-like, shape (dof,)
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
        from cspace.connectivity import reach

        point = self._one_free(q, "q")
        first, last = reach(self._components, self._cells_of(point))
        lower = np.asarray(self.grid.lower)
        return lower + self.grid.spacing * first, lower + self.grid.spacing * (last + 1)

    def free_path(self, q0: ArrayLike, q1: ArrayLike, *, straight: bool = True) -> Floats:
        """A collision-free path, proven all along, found by the map itself: from cube to cube of FREE cells.

        There is one wherever :meth:`path_exists` is True for the two, and it is the same every time. It is not the
        shortest. For robots that only translate.

        Parameters
        ----------
        q0, q1 : array-like, shape (d,)
            FREE configurations in the grid, metres.
        straight : bool
            Whether to leave out what the straight edges do not need.

        Returns
        -------
        ndarray of float64, shape (n, d)
            Waypoints, from q0 to q1, each edge between two proven free; of length 0 where chains of FREE cells do not
            join them, or one of them lies on the border of a cell that is not FREE.

        Raises
        ------
        ConfigurationError
            If a configuration is not FREE, or not in the grid.
        InputError
            If the robot turns, or a configuration is not one of finite numbers.
        """
        from cspace.cubes.path import cube_path, pulled_straight

        if self.rotations is not None:
            raise InputError("the robot turns; free_path is for robots that only translate; use planners.plan")
        ends = [self._one_free(q, name) for q, name in ((q0, "q0"), (q1, "q1"))]
        cells = cube_path(self.stack[0], *(self.grid.cell_of(q) for q in ends))
        if not len(cells):
            return np.empty((0, self.dof))
        path = np.vstack([ends[0], self.grid.center_of(cells), ends[1]])
        if not self.motion_is_free(path[:-1], path[1:]).all():
            return np.empty((0, self.dof))
        return pulled_straight(path, self.edge_checker(), 2.0 * self.grid.spacing) if straight else path

    def open_chain(self, q0: ArrayLike, q1: ArrayLike, closed: NDArray[np.bool_] | None = None) -> NDArray[np.int64]:
        """A chain of FREE and MIXED cells between two configurations, with as few MIXED ones as can be.

        Where :meth:`path_exists` is None, this is where a path has to be looked for with ``exact=True``.

        Parameters
        ----------
        q0, q1 : array-like, shape (dof,)
            Metres, and radians; in the grid.
        closed : ndarray of bool, shape (rotations, nx, ny) or (1, nx, ny, nz), optional
            Cells that are left out; one rotation where the robot does not turn.

        Returns
        -------
        ndarray of int64, shape (n, 3) or (n, 4)
            Cells ``(rotation, x, y)`` or ``(0, x, y, z)``, each sharing a side with the next; of length 0 where there
            is no chain, or one of the two is BLOCKED.

        Raises
        ------
        InputError
            If a configuration is not one of the grid, or ``closed`` is not as stated.
        """
        from cspace.connectivity import chain

        ends = [self._cells_of(self._checked(q, name)) for q, name in ((q0, "q0"), (q1, "q1"))]
        shape = self.grid.shape
        if any(end.shape != (1 + len(shape),) or (end[1:] < 0).any() or (end[1:] >= shape).any() for end in ends):
            raise InputError(f"q0 and q1 are {q0!r} and {q1!r}; each must be one configuration in the grid")
        needed = (len(self.slice_of), *shape)
        if closed is not None and (getattr(closed, "shape", None) != needed or closed.dtype != np.bool_):
            raise InputError(
                f"closed is a {type(closed).__name__} of shape {np.shape(closed)}; it must be a boolean array of shape "
                f"{needed}, one entry for each cell; leave it out for none"
            )
        if BLOCKED in (self.classify(q0), self.classify(q1)):
            return np.empty((0, 1 + len(shape)), dtype=np.int64)
        return chain(self.stack, self.slice_of, closed, *ends)

    # ---- the set of FREE configurations ------------------------------------------------------------------------------

    def sample_free(self, n: int | None = None, rng: np.random.Generator | None = None) -> Floats:
        """Configurations drawn uniformly from the FREE cells.

        Parameters
        ----------
        n : int, optional
            How many; one, without a batch axis, if left out.
        rng : numpy.random.Generator
            Source of randomness; required, so that a run can be repeated.

        Returns
        -------
        ndarray of float64, shape (n, dof), or (dof,)
            Metres, and radians.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        InputError
            If ``n`` is negative or ``rng`` is not a Generator.
        """
        from cspace.sampling import check_rng, refuse_empty, sample_cells, sample_stack

        generator = check_rng(rng)
        if n is not None and (not isinstance(n, int | np.integer) or n < 0):
            raise InputError(f"n is {n!r}; it must be a whole number, zero or above, or None for one sample")
        cells = self._free_cells
        refuse_empty(cells)
        count = 1 if n is None else int(n)
        if self.rotations is None:
            samples = sample_cells(cells[0], self.grid, count, generator)
        else:
            samples = sample_stack(cells, self.slice_of, self.rotations, self.grid, count, generator)
        return samples[0] if n is None else samples

    def nearest_free(self, q: ArrayLike) -> Floats:
        """Middle of the FREE cell nearest to a configuration.

        Parameters
        ----------
        q : array-like, shape (dof,)
            Metres and radians; may lie anywhere. Half a metre counts as much as a radian, as in OMPL's SE(2).

        Returns
        -------
        ndarray of float64, shape (dof,)

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        """
        from cspace.sampling import nearest_center, nearest_turned, refuse_empty

        cells = self._free_cells
        refuse_empty(cells)
        point = self._checked(q, "q")
        if self.rotations is None:
            return nearest_center(cells[0], self.grid, point)
        return nearest_turned(cells, self.slice_of, self.rotations, self.grid, point)

    # ---- a workspace that changes ------------------------------------------------------------------------------------

    def update(self, cells: ArrayLike, lower: Sequence[int], *, inner: ArrayLike | None = None) -> Update:
        """Change a box of workspace cells, and with it this map, in place, to what a build would give.

        The cost grows with the box around the cells that really differ and with the robot, not with the map. Checkers
        that were handed out before (:meth:`point_checker`, :meth:`edge_checker`, :meth:`clearance_checker`, and those
        of the ``planners`` package) answer for the new workspace from then on.

        The :class:`Workspace` that was passed to the build, and other maps of it, stay as they are: the first update
        copies its cells, once. Then :attr:`workspace` shows the current ones, which are the obstacles from then on;
        its ``shapes`` are None, and look-ups with ``exact=True`` ask the outer cells instead.

        Kept up to date, if they were asked for before: the state, stored overlaps, running counts for
        :meth:`overlap` and :meth:`contains_robot`, what is known outside the grid, distances for :meth:`clearance`,
        and the blocks of :meth:`path_exists` and :meth:`free_reach`, which are joined anew at the next call. Dropped,
        and made again at the next call: the lists of FREE cells for :meth:`sample_free` and :meth:`nearest_free`, and
        the geometry for ``exact=True``. An overlap field is about the obstacles as they were, and is let go. A map
        built without ``inner`` gets no BLOCKED cells; one from a file, if it has none where there could be one.

        Updates wait for each other. A look-up that another thread makes meanwhile sees each cell as it was or as it is
        going to be.

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
            What was looked at again, and how many cells changed their state.

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
        from cspace.updates.follower import Follower
        from cspace.updates.patch import Patch

        patch = Patch.of(self.grid, cells, lower, inner)
        with self._once.lock:
            return self._once("follower", lambda: Follower(self)).update(patch)

    def clearance_checker(self) -> Callable[..., float]:
        """A quick ``clearance`` of floats.

        Returns
        -------
        callable
            ``check(*q) -> float``, of the dof numbers of a configuration; they must be finite floats, and are not
            checked.
        """
        aims = self._once("clearance checker", lambda: [Questions.clearance_checker(self)])

        def check(*q: float) -> float:
            return aims[0](*q)

        return check

    def _aim_clearance(self) -> None:
        """Have the clearance checkers that were handed out ask the look-ups as they are now."""
        aims = self._once.made("clearance checker")
        if aims is not None:
            aims[0] = Questions.clearance_checker(self)

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
        from cspace.spectral import OverlapField

        return CSpace(
            self.workspace,
            self.robot,
            (self.stack[0] if self.rotations is None else self.stack).copy(),
            outside=self.outside,
            margin=self.margin,
            precision=self.precision,
            rotations=self.rotations,
            overlaps=None if self.overlaps is None else self.overlaps.copy(),
            rasters=self._rasters,
            fields=OverlapField.of(self, overlap).arrays,
            tells_blocked=self.tells_blocked,
        )

    @property
    def overlap_field(self) -> OverlapField | None:
        """The overlap of descriptors that the map carries; None where there is none."""
        from cspace.spectral import OverlapField

        return OverlapField(self, self.fields) if self.fields else None

    # ---- files and pictures ------------------------------------------------------------------------------------------

    def to_xarray(self) -> xarray.Dataset:
        """The map with named dimensions, coordinates and units; see :func:`cspace.io.labelled.to_xarray`."""
        from cspace.io.labelled import to_xarray

        return to_xarray(self)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Save as a Zarr folder, which :func:`cspace.open` reads; see :func:`cspace.io.writing.save`."""
        from cspace.io.writing import save

        save(self, path, overwrite=overwrite)

    def export(self, path: str | Path, *, overwrite: bool = False, yaw: float | None = None) -> None:
        """Write for other programs, by suffix; see :func:`cspace.io.writing.export`.

        ``.npz``; in the plane ``.yaml``, a ROS map; ``.vti`` for ParaView; in space ``.ply``, ``.obj`` and ``.stl``,
        the border of the FREE cells. What holds one slice needs, of a robot that turns, its ``yaw``, in radians.
        """
        from cspace.io.writing import export

        export(self, path, overwrite=overwrite, yaw=yaw)

    def plot(self, **options: Any) -> Axes:
        """Draw the map; see :func:`cspace.plot.plot`. No window is opened."""
        from cspace.plot import plot

        return plot(self, **options)

    @property
    def _components(self) -> Components:
        from cspace.connectivity import components

        return self._once("components", lambda: components(self.stack, self.slice_of, self._rim_is_open()))
