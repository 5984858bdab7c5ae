"""Audits of route graphs, and their conflicts."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cspace.errors import InputError
from cspace.inside import ConfigurationMap, names_options

if TYPE_CHECKING:
    from cspace.inside import Floats, StrPath
    from cspace.lanes import Audit, Conflicts, RouteGraph


@names_options
def audit(
    space: ConfigurationMap,
    graph: RouteGraph | StrPath | Any,
    *,
    exact: bool = True,
    max_room: float = 1.0,
) -> Audit:
    """Prove the lanes of a graph free or blocked for a robot.

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
    from cspace.lanes._audit import audit_graph

    lanes = _open_graph(space, graph, "graph")
    return audit_graph(space, lanes, exact, max_room, _find_path)


def _find_path(space: ConfigurationMap, start: Floats, goal: Floats) -> Floats:
    """Return a plan's waypoints, proven by geometry in memory."""
    from planners._plan import plan

    return plan(space, start, goal, exact=space.in_memory).waypoints


@names_options
def conflicts(
    space: ConfigurationMap,
    graph: RouteGraph | StrPath | Any,
    *,
    others: Mapping[str, tuple[ConfigurationMap, RouteGraph | StrPath | Any]] | None = None,
    distance: float = 0.0,
    name: str = "",
) -> Conflicts:
    """Prove which lanes and nodes two robots can use at once.

    Two robots can touch on two elements, lanes with a direction or nodes with their turns, if and
    only if the shapes that they sweep there meet. Each pair is proven apart, or has two poses that
    touch, or is undecided. Robots are as of the map: grown by its margin, and off the lane by what
    the graph allows. Robots of one kind also meet each other. See :class:`cspace.lanes.Conflicts`.

    Parameters
    ----------
    space : CSpace or TiledCSpace
        A map with the axes x, y, or x, y, yaw.
    graph : cspace.lanes.RouteGraph, str, Path or networkx graph
        Lanes, as for :func:`planners.audit`.
    others : mapping of str to tuple, optional
        Map and graph of each other kind of robot, by its name.
    distance : float
        Distance that two robots must keep, metres.
    name : str
        Name of this robot, with which the names of its lanes and nodes then begin.

    Returns
    -------
    cspace.lanes.Conflicts

    Raises
    ------
    InputError
        As for :func:`planners.audit`; or if maps differ in their frame or extent.
    FileError
        If a file is damaged, or asks for something that is not honoured.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> from cspace.lanes import RouteGraph
    >>> workspace = cspace.Workspace.from_array(np.zeros((80, 60), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, "rect:0.6x0.4", rotations=72)
    >>> nodes = [(1, 2), (7, 2), (1, 2.3), (7, 2.3), (1, 4), (7, 4)]
    >>> graph = RouteGraph.from_arrays(nodes, [(0, 1), (2, 3), (4, 5)])
    >>> conflicts = planners.conflicts(space, graph)
    >>> conflicts.between("0: 0 to 1", "1: 2 to 3").verdict
    'touch'
    >>> conflicts.between("0: 0 to 1", "2: 4 to 5").verdict
    'apart'
    """
    from cspace.lanes._conflicts import find_conflicts

    robots = {name: (space, _open_graph(space, graph, "graph"))}
    for key, pair in _check_robots({} if others is None else others, name).items():
        other, lanes = pair
        robots[key] = other, _open_graph(other, lanes, f"others[{key!r}]")
    return find_conflicts(robots, distance)


def _check_robots(others: Any, known: str) -> dict[str, tuple[Any, Any]]:
    """Return other robots by name, or raise InputError."""
    rule = "it must give a map and a graph by a name of each robot"
    if not isinstance(others, Mapping):
        raise InputError("others", f"is a {type(others).__name__}", rule)
    for name, pair in others.items():
        if not (isinstance(name, str) and name) or name == known:
            raise InputError("others", f"has the name {name!r}", rule)
        if not (isinstance(pair, tuple | list) and len(pair) == 2):
            raise InputError(f"others[{name!r}]", f"is a {type(pair).__name__}", rule)
    return dict(others)


def _open_graph(space: Any, graph: Any, name: str) -> RouteGraph:
    """Return a graph from a file or networkx, or raise InputError."""
    from cspace.lanes import RouteGraph

    lanes = graph
    if isinstance(graph, str | os.PathLike):
        lanes = RouteGraph.open(graph)
    elif hasattr(graph, "is_directed"):
        lanes = RouteGraph.from_networkx(graph)
    if not isinstance(lanes, RouteGraph):
        rule = "it must be a RouteGraph, a file or a graph of networkx"
        raise InputError(name, f"is a {type(graph).__name__}", rule)
    if not isinstance(space, ConfigurationMap):
        place = "space" if name == "graph" else name
        raise InputError(place, f"is a {type(space).__name__}", "it must be a map")
    return lanes
