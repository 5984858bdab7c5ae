"""Audits of route graphs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cspace._configuration_map import ConfigurationMap
    from cspace._support.arrays import StrPath
    from cspace.lanes import Audit, RouteGraph


def audit(
    space: ConfigurationMap,
    graph: RouteGraph | StrPath | Any,
    *,
    exact: bool = True,
    max_room: float = 1.0,
) -> Audit:
    """Prove the lanes of a route graph free or blocked for the robot of a map.

    Every lane is proven along its whole length, at every yaw that its rule allows. See
    :class:`cspace.lanes.Audit`.

    Parameters
    ----------
    space : CSpace or TiledCSpace
        A map with the axes x, y, or x, y, yaw.
    graph : cspace.lanes.RouteGraph, str, Path or networkx graph
        Lanes; a file is read by :meth:`cspace.lanes.RouteGraph.open`, a graph of networkx by
        :meth:`cspace.lanes.RouteGraph.from_networkx`.
    exact : bool
        Decide by the geometry what cells do not.
    max_room : float
        Metres of room at a lane beyond which nothing is proven, because it takes time.

    Returns
    -------
    cspace.lanes.Audit

    Raises
    ------
    InputError
        If the map has other axes, or a robot without a yaw turns on a lane; or the graph is none.
    FileError
        If a file is damaged, or asks for something that is not honoured.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> from cspace.lanes import RouteGraph
    >>> occupied = np.zeros((80, 60), dtype=bool)
    >>> occupied[40:42, :30] = True
    >>> workspace = cspace.Workspace.from_array(occupied, 0.1)
    >>> space = cspace.build(workspace, "rect:0.6x0.4", rotations=72)
    >>> graph = RouteGraph.from_arrays([(1, 2), (7, 2), (7, 5)], [(0, 1), (1, 2)])
    >>> audit = planners.audit(space, graph)
    >>> audit
    Audit(rectangle 0.6 m x 0.4 m: 1 free, 1 blocked, 0 undecided)
    >>> audit.lanes[0].obstacle
    'the obstacle at (4.05, 1.85)'
    """
    from cspace.lanes import audit_lanes

    return audit_lanes(space, graph, exact, max_room)
