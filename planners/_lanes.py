"""Audits of route graphs."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from cspace._support.check import names_options
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace._configuration_map import ConfigurationMap
    from cspace._support.arrays import Floats, StrPath
    from cspace.lanes import Audit, RouteGraph


@names_options
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
    from cspace.lanes import RouteGraph
    from cspace.lanes._audit import audit_graph
    from planners._plan import plan

    if isinstance(graph, str | os.PathLike):
        graph = RouteGraph.open(graph)
    elif hasattr(graph, "is_directed"):
        graph = RouteGraph.from_networkx(graph)
    elif not isinstance(graph, RouteGraph):
        rule = "it must be a RouteGraph, a file or a graph of networkx"
        hint = "pass RouteGraph.from_arrays(positions, edges)"
        raise InputError("graph", f"is a {type(graph).__name__}", rule, hint)
    if not hasattr(space, "axes"):
        raise InputError("space", f"is a {type(space).__name__}", "it must be a map")

    def find_path(space: ConfigurationMap, start: Floats, goal: Floats) -> Floats:
        """Return the waypoints of a plan, which the geometry proves if the map is in memory."""
        return plan(space, start, goal, exact=space.in_memory).waypoints

    return audit_graph(space, graph, exact, max_room, find_path)
