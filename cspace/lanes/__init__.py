"""Lanes: audits of route graphs for a robot's shape, before it drives along them."""

from __future__ import annotations

from cspace.lanes._audit import Audit, LaneVerdict, LostWay, NodeVerdict
from cspace.lanes._conflicts import Conflict, Conflicts, Element, Zones
from cspace.lanes._headings import HeadingRule, Lane
from cspace.lanes._route_graph import RouteGraph

__all__ = [
    "Audit",
    "Conflict",
    "Conflicts",
    "Element",
    "HeadingRule",
    "Lane",
    "LaneVerdict",
    "LostWay",
    "NodeVerdict",
    "RouteGraph",
    "Zones",
]
