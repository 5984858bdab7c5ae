"""plot_map: pictures of maps in memory, tiled maps, workspaces and arms."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING, Any

from cspace.arms.space import ArmSpace
from cspace.plot.arms import draw_arm
from cspace.plot.picture import plot
from cspace.plot.route import WorkspaceView
from cspace.tiles.space import TiledCSpace
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@singledispatch
def plot_map(space: Any, **options: Any) -> Axes:
    """Draw a map, with the options of :func:`cspace.plot.plot`."""
    return plot(space, **options)


@plot_map.register(TiledCSpace)
def _(space: TiledCSpace, **options: Any) -> Axes:
    return plot(space.overview(), **options)


@plot_map.register(Workspace)
def _(workspace: Workspace, **options: Any) -> Axes:
    return plot(WorkspaceView(workspace), **options)


plot_map.register(ArmSpace, draw_arm)
