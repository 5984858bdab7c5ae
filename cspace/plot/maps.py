"""plot_map: pictures of maps in memory, tiled maps, workspaces and arms."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from cspace.arms.space import ArmSpace
from cspace.plot.arms import draw_arm
from cspace.plot.picture import plot
from cspace.plot.route import WorkspaceView, check_path
from cspace.tiles.space import TiledCSpace
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@singledispatch
def plot_map(space: Any, **options: Any) -> Axes:
    """Draw a map, with the options of :func:`cspace.plot.plot`.

    The picture shows one period of each periodic axis, or as many as the path crosses.
    """
    if not any(space.periodic_axes):
        return plot(space, **options)
    shape, path = np.array(space.grid.shape), check_path(space, options.get("path"))
    cells = np.concatenate([[0 * shape, shape - 1], space.grid.cell_of(path)])
    start = np.where(space.periodic_axes, cells.min(axis=0), 0)
    stop = np.where(space.periodic_axes, cells.max(axis=0) + 1, shape)
    crosses_seam = (start < 0).any() or (stop > shape).any()
    return plot(space._unroll(start, stop) if crosses_seam else space, **options)


@plot_map.register(TiledCSpace)
def _(space: TiledCSpace, **options: Any) -> Axes:
    return plot(space.overview(), **options)


@plot_map.register(Workspace)
def _(workspace: Workspace, **options: Any) -> Axes:
    return plot(WorkspaceView(workspace), **options)


plot_map.register(ArmSpace, draw_arm)
