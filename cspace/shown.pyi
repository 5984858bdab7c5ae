# Types of the methods in shown.py, which imports no room above it; so only type checkers import upward, here.

from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, TypeVar, Unpack, overload

import xarray
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

if TYPE_CHECKING:  # otherwise mypy checks some modules before the constants that they import
    from cspace.files.ros import Costmap, OccupancyGrid
    from cspace.plot.picture import PlotOptions, WorkspaceOptions
    from cspace.plot.route import HasPath
    from cspace.view.viewer import Viewer, ViewOptions

Message = TypeVar("Message")

class ArmPlotOptions(TypedDict, total=False):
    q: ArrayLike
    path: ArrayLike | HasPath
    camera: ArrayLike
    ax: Axes
    legend: bool
    title: str

class NotebookPicture:
    def _repr_html_(self) -> str: ...

class WorkspacePlot(NotebookPicture):
    def plot(self, **options: Unpack[WorkspaceOptions]) -> Axes: ...

class MapPlot:
    def plot(self, **options: Unpack[PlotOptions]) -> Axes: ...

class ArmPlot:
    def plot(self, **options: Unpack[ArmPlotOptions]) -> Axes: ...

class SpaceView:
    def view(self, *, block: bool = True, **options: Unpack[ViewOptions]) -> Viewer: ...

class MapExport(NotebookPicture):
    def to_xarray(self) -> xarray.Dataset: ...
    def save(self, path: str | Path, *, overwrite: bool = False, compress: bool = True) -> None: ...
    def export(self, path: str | Path, *, overwrite: bool = False, rotation: ArrayLike | None = None) -> None: ...
    @overload
    def to_occupancy_grid(
        self, msg: None = None, *, rotation: ArrayLike | None = None, frame_id: str = "map"
    ) -> OccupancyGrid: ...
    @overload
    def to_occupancy_grid(
        self, msg: Message, *, rotation: ArrayLike | None = None, frame_id: str = "map"
    ) -> Message: ...
    @overload
    def to_costmap(
        self,
        msg: None = None,
        *,
        inflation_radius: float = 0.55,
        cost_scaling_factor: float = 10.0,
        rotation: ArrayLike | None = None,
        frame_id: str = "map",
    ) -> Costmap: ...
    @overload
    def to_costmap(
        self,
        msg: Message,
        *,
        inflation_radius: float = 0.55,
        cost_scaling_factor: float = 10.0,
        rotation: ArrayLike | None = None,
        frame_id: str = "map",
    ) -> Message: ...
