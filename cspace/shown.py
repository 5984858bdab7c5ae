"""Methods that draw, view and export: each hands its object to a room above.

This is the one module that imports from rooms above it; it does so when a method is called.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, Unpack, cast, overload

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

    from cspace.export.messages import CostmapOptions
    from cspace.files.ros import Costmap, OccupancyGrid
    from cspace.plot.arms import ArmPlotOptions
    from cspace.plot.picture import PlotOptions, WorkspaceOptions
    from cspace.space import CSpace
    from cspace.view.viewer import Viewer, ViewOptions
    from cspace.workspace import Workspace

Message = TypeVar("Message")


class NotebookPicture:
    """Something that notebooks show as a small picture."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """Return the repr and a small picture, for notebooks."""
        from cspace.plot import as_html

        return as_html(self, [repr(self)])


class WorkspacePlot(NotebookPicture):
    """Pictures of a workspace."""

    __slots__ = ()

    def plot(self, **options: Unpack[WorkspaceOptions]) -> Axes:
        """Draw the obstacles; no window is opened.

        Parameters
        ----------
        **options
            Of :func:`cspace.plot.plot`: ``view``, ``at``, ``zoom``, ``cut``, ``camera``, ``ax``, ``legend`` and
            ``title``, by default the source and the side of a cell.

        Returns
        -------
        matplotlib.axes.Axes
            The axes, which a notebook shows as the picture; ``ax.figure`` is the figure.

        Raises
        ------
        InputError
            As :func:`cspace.plot.plot`.
        """
        from cspace.plot.picture import plot
        from cspace.plot.route import WorkspaceView

        return plot(WorkspaceView(cast("Workspace", self)), **options)


class MapPlot:
    """Pictures of a map."""

    def plot(self, **options: Unpack[PlotOptions]) -> Axes:
        """Draw the map, or an overview of one in tiles; see :func:`cspace.plot.plot`, which takes the same.

        No window is opened; a notebook shows the axes as the picture. If a path crosses the seam of continuous joints,
        the map is drawn as far as the path goes.
        """
        from cspace.plot.maps import plot_map

        return plot_map(self, **options)


class ArmPlot:
    """Pictures of an arm."""

    def plot(self, **options: Unpack[ArmPlotOptions]) -> Axes:
        """Draw the arm among its obstacles, in three dimensions, and a path as pale arms with the curve of its end.

        No window is opened; a notebook shows the axes as the picture.

        Parameters
        ----------
        q : array-like, shape (dof,), optional
            Where the arm is; by default at the end of the path, or at zero.
        path : array-like, shape (n, dof), or Plan, optional
        camera : array-like, shape (2,), optional
            Elevation and azimuth in degrees.
        ax : matplotlib.axes.Axes, optional
            In three dimensions; by default of a new figure.
        legend : bool
        title : str, optional
            By default the arm's name.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        InputError, ConfigurationError
            If a configuration has the wrong shape or is outside the limits, or ``ax`` has two dimensions.
        """
        from cspace.plot.arms import draw_arm

        return draw_arm(self, **options)


class SpaceView:
    """A space on a page in the browser."""

    def view(self, *, block: bool = True, **options: Unpack[ViewOptions]) -> Viewer:
        """Show the space on a page in the browser, and plan there; needs viser: ``pip install "cspace[view]"``.

        The page shows obstacles and the robot, with the border of the C-obstacle of a map, or the closest pair of an
        arm. Start and goal are set there, paths planned and played, and the page says what is proven. It is served on
        this machine alone, unless ``host`` says otherwise, and its address is printed if ``block`` is set.

        Parameters
        ----------
        block : bool
            Whether to wait until Ctrl-C is pressed. If not, :meth:`cspace.view.Viewer.close` ends the page.
        path : array-like, shape (n, dof), or Plan, optional
            A path to show.
        start, goal : array-like, shape (dof,), optional
            Where the two are at first; by default the endpoints of the path, or FREE configurations far apart.
        host : str
            Address to serve on; by default "127.0.0.1". Who can reach it can plan there, and move the page.
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

        return opened(self, block, options)


class MapExport(NotebookPicture):
    """Files and messages of a map in memory."""

    def to_xarray(self) -> xarray.Dataset:
        """The map with named dimensions, coordinates and units; see :func:`cspace.export.maps.to_xarray`."""
        from cspace.export.maps import to_xarray

        return to_xarray(cast("CSpace", self)._contents)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Save as a Zarr folder, which :func:`cspace.open` reads; see :func:`cspace.store.save`."""
        from cspace.store import save

        cast("CSpace", self)._write(lambda contents: save(contents, path, overwrite=overwrite), exterior=True)

    def export(self, path: str | Path, *, overwrite: bool = False, rotation: ArrayLike | None = None) -> None:
        """Write the map for other programs, in the format of the suffix; see :func:`cspace.export.maps.export`.

        ``.npz``; ``.nc``, netCDF; ``.vti`` for ParaView; in the plane ``.yaml``, a ROS map, and ``.tif``, a GeoTIFF; in
        space ``.ply``, ``.obj`` and ``.stl``, the border of the FREE cells. Formats of one slice need its ``rotation``
        if the robot turns; ``.vti`` and ``.nc`` hold that one or all of them.
        """
        from cspace.export.maps import export

        cast("CSpace", self)._write(lambda contents: export(contents, path, overwrite=overwrite, rotation=rotation))

    @overload
    def to_occupancy_grid(
        self, msg: None = None, *, rotation: ArrayLike | None = None, frame_id: str = "map"
    ) -> OccupancyGrid: ...
    @overload
    def to_occupancy_grid(
        self, msg: Message, *, rotation: ArrayLike | None = None, frame_id: str = "map"
    ) -> Message: ...
    def to_occupancy_grid(
        self, msg: Message | None = None, *, rotation: ArrayLike | None = None, frame_id: str = "map"
    ) -> Message | OccupancyGrid:
        """A map of the plane as an occupancy grid of ROS: FREE is 0, BLOCKED 100 and MIXED -1, which is unknown.

        :meth:`Workspace.from_occupancy_grid` reads it back as the cells that are not FREE, or with ``unknown="free"``
        as those that are BLOCKED.

        Parameters
        ----------
        msg : object, optional
            A message to fill, of ROS 1 or 2: what has the fields of ``nav_msgs/OccupancyGrid``. A new
            :class:`cspace.files.ros.OccupancyGrid` if left out.
        rotation : array-like, shape (k,), optional
            Of a robot that turns: the one to take. If left out, 0 is free, and 100 blocked, at every rotation.
        frame_id : str
            Of the header, whose stamp is left as it is.

        Returns
        -------
        object
            The message.

        Raises
        ------
        InputError
            If the map is one in space, the message lacks a field, or ``rotation`` is none of the map.
        """
        from cspace.export.messages import occupancy_grid_of

        return occupancy_grid_of(cast("CSpace", self), msg, rotation, frame_id)

    @overload
    def to_costmap(self, msg: None = None, **options: Unpack[CostmapOptions]) -> Costmap: ...
    @overload
    def to_costmap(self, msg: Message, **options: Unpack[CostmapOptions]) -> Message: ...
    def to_costmap(
        self,
        msg: Message | None = None,
        *,
        inflation_radius: float = 0.55,
        cost_scaling_factor: float = 10.0,
        rotation: ArrayLike | None = None,
        frame_id: str = "map",
    ) -> Message | Costmap:
        """A map of the plane as a costmap of Nav2, inflated by the robot itself instead of by a circle.

        254 is an obstacle, 255 unknown, 253 not proven free for the robot; a FREE cell costs
        ``252 * exp(-cost_scaling_factor * clearance)``, rounded down, with the clearance of its middle, which stands
        for Nav2's distance less the inscribed radius; and 0 farther from obstacles than ``inflation_radius``.

        Parameters
        ----------
        msg : object, optional
            A message to fill: what has the fields of ``nav2_msgs/Costmap``. A new
            :class:`cspace.files.ros.Costmap` if left out.
        inflation_radius : float
            Metres from the obstacles, zero or above; the clearance and the radius of the robot's inscribed circle,
            margin included, are held against it. The defaults of this and the next are Nav2's.
        cost_scaling_factor : float
            Per metre, zero or above.
        rotation : array-like, shape (k,), optional
            Of a robot that turns: the one to take. If left out, the one of the largest clearance, cell by cell. That
            takes some nanoseconds for each cell and slice at the first call; after an update, only around its changes.
        frame_id : str
            Of the header, whose stamp is left as it is.

        Returns
        -------
        object
            The message.

        Raises
        ------
        InputError
            If the map is one in space, the message lacks a field, or an argument is not usable.
        """
        from cspace.export.messages import costmap_of

        space = cast("CSpace", self)
        return costmap_of(space, msg, inflation_radius, cost_scaling_factor, rotation, frame_id)
