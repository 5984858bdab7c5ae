"""Methods that draw, view, explain and export.

They alone import packages above their own, when they are called.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from cspace.plot.arms import ArmPlotOptions
    from cspace.plot.picture import PlotOptions, WorkspaceOptions
    from cspace.reasons import Explanation, Removals
    from cspace.record.contents import Contents
    from cspace.view.viewer import Viewer, ViewOptions


class WorkspacePlot:
    """Pictures of a workspace."""

    __slots__ = ()

    def plot(self, **options: Unpack[WorkspaceOptions]) -> Axes:
        """Draw the obstacles; open no window.

        Parameters
        ----------
        **options
            Options of :func:`cspace.plot.plot`: ``view``, ``center``, ``zoom``, ``cut``,
            ``camera``, ``ax``, ``legend`` and ``title``. The title defaults to the source and the
            length of a cell.

        Returns
        -------
        matplotlib.axes.Axes
            Notebooks show the axes as the picture; ``ax.figure`` is the figure.

        Raises
        ------
        InputError
            For the reasons of :func:`cspace.plot.plot`.
        """
        from cspace.plot import plot

        space: Any = self
        return plot(space, **options)


class MapPlot:
    """Pictures of a map."""

    def plot(self, **options: Unpack[PlotOptions]) -> Axes:
        """Draw the map, with the options of :func:`cspace.plot.plot`.

        Of a tiled map, an overview is drawn. No window opens; notebooks show the axes as the
        picture. If a path crosses the seam of continuous joints, the picture extends as far as the
        path.
        """
        from cspace.plot import plot

        space: Any = self
        return plot(space, **options)


class ArmPlot:
    """Pictures of an arm."""

    def plot(self, **options: Unpack[ArmPlotOptions]) -> Axes:
        """Draw the arm, its obstacles and, as pale arms, a path.

        No window opens; notebooks show the axes as the picture.

        Parameters
        ----------
        q : array-like, shape (size,), optional
            Configuration of the arm; by default the end of the path, or zero.
        path : array-like, shape (n, size), or Plan, optional
        camera : array-like, shape (2,), optional
            Elevation and azimuth, degrees.
        ax : matplotlib.axes.Axes, optional
            Axes in three dimensions; by default of a new figure.
        legend : bool
        title : str, optional
            Default: the name of the arm.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        InputError, ConfigurationError
            If a configuration has the wrong shape or is outside the limits, or ``ax`` has two
            dimensions.
        """
        from cspace.plot.arms import draw_arm

        return draw_arm(self, **options)


class SpaceView:
    """A page in the browser that shows a space."""

    def view(self, *, block: bool = True, **options: Unpack[ViewOptions]) -> Viewer:
        """Show the space on a page in the browser, and plan there.

        Needs ``pip install "cspace[view]"``. The page shows the obstacles, the robot, and the
        border of a map's C-obstacle or the closest pair of an arm. On it one sets start and goal,
        or drags an arm's tool to a pose, plans and plays paths, and reads what is proven. It is
        served on this machine alone, unless ``host`` says otherwise.

        Parameters
        ----------
        block : bool
            Print the address and wait for Ctrl-C. Otherwise :meth:`cspace.view.Viewer.close` ends
            the page.
        path : array-like, shape (n, size), or Plan, optional
            A path to show. Trajectories, and plans of arms, are played at true speed.
        start, goal : array-like, shape (size,), optional
            Initial start and goal; by default the endpoints of the path, or FREE configurations far
            apart. An arm with a start alone has no goal until one is set on the page.
        frame : str, optional
            Frame of an arm that users drag, such as ``"tool0"``; by default the frame that the most
            joints move.
        host : str
            Address to serve on, by default "127.0.0.1". Whoever can reach it can plan on the page
            and move it.
        port : int, optional
            Default: the first free port from 8080 on.

        Returns
        -------
        cspace.view.Viewer
            The page, with its ``url``, its ``plan``, ``refresh()`` for a map that was updated, and
            ``close()``.

        Raises
        ------
        InputError
            If the path or a configuration has the wrong shape, no joint moves the frame, the port
            is taken, or this machine lacks the address.
        MissingPackageError
            If viser is not installed.
        """
        from cspace.view.viewer import open_viewer

        return open_viewer(self, block, options)


class MapReasons:
    """Reasons why paths on a map in memory exist, or do not."""

    def explain(self, start: ArrayLike, goal: ArrayLike, *, refine: bool = False) -> Explanation:
        """Explain why a path between two configurations exists, or does not.

        For maps in the plane and in space, with or without a yaw. It takes some seconds for a map
        of ten million cells.

        Parameters
        ----------
        start, goal : array-like, shape (size,)
            Configurations in the grid, FREE or not; metres, and radians.
        refine : bool
            Build finer maps while they are small, which narrow the margins. If the map leaves it
            undecided, they or finer windows around the MIXED cells on the way may decide.

        Returns
        -------
        cspace.reasons.Explanation
            ``print`` it for at most three sentences; it has the verdict, the cells and obstacles in
            the way, where the way is narrowest, and by how much the robot may grow or must shrink.

        Raises
        ------
        InputError
            If the map is tiled or of SE(3), or a number is not finite.
        ConfigurationError
            If start or goal lies outside the grid.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> occupied = np.zeros((80, 60), dtype=bool)
        >>> occupied[40:42, :26] = occupied[40:42, 30:] = True
        >>> space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.3))
        >>> space.explain((1.0, 1.0), (7.0, 1.0)).verdict
        'disconnected'
        """
        from cspace.reasons.explain import explain

        space: Any = self
        return explain(space, start, goal, refine)

    def removals(self, start: ArrayLike, goal: ArrayLike) -> Removals | None:
        """Find the fewest named obstacles whose removal gives a path.

        See :attr:`cspace.CSpace.obstacles`. The map itself does not change.

        Parameters
        ----------
        start, goal : array-like, shape (size,)
            Configurations in the grid; metres, and radians.

        Returns
        -------
        cspace.reasons.Removals or None
            A list of names; a map without them proves that a path exists. It is empty if one exists
            already. No fewer obstacles give one, for up to 12 of them; for more, ``at_least`` is a
            lower bound of their number. None if a path is not proven without all of them either.

        Raises
        ------
        InputError
            As :meth:`explain`, and if there are over 62 named obstacles.
        ConfigurationError
            If start or goal lies outside the grid.

        References
        ----------
        K. Hauser, "The minimum constraint removal problem with three robotics applications", 2014.

        Examples
        --------
        >>> import numpy as np, shapely, cspace
        >>> workspace = cspace.Workspace.from_array(np.zeros((40, 20), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
        >>> _ = space.add_obstacle("crate", shapely.box(2.0, 0.0, 2.2, 1.2))
        >>> _ = space.add_obstacle("shelf", shapely.box(2.0, 1.2, 2.2, 2.0))
        >>> space.removals((0.5, 0.5), (3.5, 0.5))
        ['crate']
        """
        from cspace.reasons.removals import find_removals

        space: Any = self
        return find_removals(space, start, goal)


class MapExport:
    """Files and messages of a map in memory."""

    _contents: Contents
    _write: Callable[..., None]
    _clearances_of_cells: Callable[[int | None], Any]
    _distance_arrays: Callable[[], dict[str, Any]]

    def to_xarray(self) -> xarray.Dataset:
        """Return the map with named dimensions, coordinates and units.

        See :func:`cspace.export.maps.to_xarray`. It needs the extra ``xarray``.
        """
        from cspace.export.maps import to_xarray

        return to_xarray(self._contents)

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
        from cspace.record.save import save

        def write(contents: Contents) -> None:
            derived = self._distance_arrays() if clearance else None
            save(contents, path, overwrite, compress, derived)

        self._write(write, exterior=True)

    def export(
        self, path: str | Path, *, overwrite: bool = False, rotation: ArrayLike | None = None
    ) -> None:
        """Write the map for other programs, in the format of the suffix.

        See :func:`cspace.export.maps.export`. Formats are ``.npz``, netCDF (``.nc``) and ParaView
        (``.vti``). Plane maps also have ROS maps (``.yaml``) and GeoTIFF (``.tif``); maps in space
        also have the border of the FREE cells (``.ply``, ``.obj``, ``.stl``). Formats of one slice
        need its ``rotation`` if the robot rotates; ``.vti`` and ``.nc`` hold one slice or all.
        """
        from cspace.export.maps import export

        self._write(partial(export, path=path, overwrite=overwrite, rotation=rotation))

    def to_occupancy_grid(
        self, msg: Any = None, *, rotation: ArrayLike | None = None, frame_id: str = "map"
    ) -> Any:
        """Return a plane map as a ROS occupancy grid.

        FREE is 0, BLOCKED 100 and MIXED -1 (unknown). :meth:`cspace.Workspace.from_occupancy_grid`
        reads it back: as the cells that are not FREE, or, with ``unknown="free"``, as the BLOCKED
        cells.

        Parameters
        ----------
        msg : object, optional
            A message of ROS 1 or 2 to fill: any object with the fields of
            ``nav_msgs/OccupancyGrid``. Default: a new :class:`cspace.ros.OccupancyGrid`.
        rotation : array-like, shape (k,), optional
            Rotation of the robot. Default: 0 means free, and 100 blocked, at every rotation.
        frame_id : str
            Frame in the header, whose stamp stays as it is.

        Returns
        -------
        object
            The message.

        Raises
        ------
        InputError
            If the map is in space, the message lacks a field, or the map does not have the
            ``rotation``.
        """
        from cspace.export.messages import occupancy_grid_of

        space: Any = self
        return occupancy_grid_of(space, msg, rotation, frame_id)

    def to_costmap(
        self,
        msg: Any = None,
        *,
        inflation_radius: float = 0.55,
        cost_scaling_factor: float = 10.0,
        rotation: ArrayLike | None = None,
        frame_id: str = "map",
    ) -> Any:
        """Return a plane map as a Nav2 costmap.

        It is inflated by the robot itself. 254 is an obstacle, 255 unknown, 253 not proven free for
        the robot. A FREE cell costs ``252 * exp(-cost_scaling_factor * clearance)``, rounded down,
        and 0 if it is farther than ``inflation_radius`` from the obstacles. Its clearance, taken at
        its center, stands for Nav2's distance less the inscribed radius.

        Parameters
        ----------
        msg : object, optional
            A message to fill: any object with the fields of ``nav2_msgs/Costmap``. Default: a new
            :class:`cspace.ros.Costmap`.
        inflation_radius : float
            Metres from the obstacles, zero or above; compared with the clearance plus the radius of
            the robot's inscribed circle, margin included. The defaults of this and of
            ``cost_scaling_factor`` are Nav2's.
        cost_scaling_factor : float
            Per metre, zero or above.
        rotation : array-like, shape (k,), optional
            Rotation of the robot. Default: in each cell, the rotation of the largest clearance;
            this takes some 20 nanoseconds for each cell and slice at the first call, and after an
            update.
        frame_id : str
            Frame in the header, whose stamp stays as it is.

        Returns
        -------
        object
            The message.

        Raises
        ------
        InputError
            If the map is in space, the message lacks a field, or an argument is not usable.
        """
        from cspace.export.messages import costmap_of

        space: Any = self
        clearances = self._clearances_of_cells
        return costmap_of(
            space, clearances, msg, inflation_radius, cost_scaling_factor, rotation, frame_id
        )
