"""Lanes: audits of route graphs for a robot's shape, before it drives along them."""

from __future__ import annotations

import os
from typing import Any

from cspace.errors import InputError
from cspace.lanes._audit import Audit, LaneVerdict, LostWay, NodeVerdict, audit_graph
from cspace.lanes._headings import HeadingRule, Lane
from cspace.lanes._route_graph import RouteGraph

__all__ = ["Audit", "HeadingRule", "Lane", "LaneVerdict", "LostWay", "NodeVerdict", "RouteGraph"]


def audit_lanes(space: Any, graph: Any, exact: bool, max_room: float) -> Audit:
    """Audit a route graph, the file of one or a graph of networkx; see :func:`planners.audit`."""
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
    return audit_graph(space, graph, exact, max_room)
