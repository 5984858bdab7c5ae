"""plot_map: the picture of each kind of map, as a map in memory, and of an arm."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from cspace.arms.space import ArmSpace
from cspace.plot.arms import draw_arm
from cspace.plot.picture import plot
from cspace.plot.route import WorkspaceView, polyline
from cspace.tiles.space import TiledCSpace
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@singledispatch
def plot_map(space: Any, **options: Any) -> Axes:
    """Draw a map, with the options of :func:`cspace.plot.plot`.

    Of periodic axes one turn is drawn, or as many as the path crosses.
    """
    if not any(space.periodic_axes):
        return plot(space, **options)
    shape, path = np.array(space.grid.shape), polyline(space, options.get("path"))
    cells = np.concatenate([[0 * shape, shape - 1], space.grid.cell_of(path)])
    first = np.where(space.periodic_axes, cells.min(axis=0), 0)
    last = np.where(space.periodic_axes, cells.max(axis=0), shape - 1)
    crosses = (first < 0).any() or (last >= shape).any()
    return plot(space._unroll(first, last + 1) if crosses else space, **options)


@plot_map.register(TiledCSpace)
def _(space: TiledCSpace, **options: Any) -> Axes:
    return plot(space.overview(), **options)


@plot_map.register(Workspace)
def _(workspace: Workspace, **options: Any) -> Axes:
    return plot(WorkspaceView(workspace), **options)


plot_map.register(ArmSpace, draw_arm)
