"""Lanes: audits of route graphs for a robot's shape, before it drives (experimental).

Words that the modules of this package share:

- *element*: a lane in one direction, or a node with the turns on it.
- *deviation*: the distance by which a robot may stray from its lane.
- *piece*: a part of an element on which the robot drives straight, or turns on the spot.
- *outline*: polygons that contain all that the robot covers on an element.
- *room*: how far a lane may be shifted to a side, or how much its robot may grow.
- *strip*: positions beside a lane, between two distances from it.
"""

from __future__ import annotations

from cspace.lanes._apart import Mover, Separation, apart
from cspace.lanes._audit import Audit, LaneVerdict, LostWay, NodeVerdict, audit
from cspace.lanes._conflicts import Conflict, Conflicts, Element, Zones, conflicts
from cspace.lanes._headings import HeadingRule, Lane
from cspace.lanes._route_graph import RouteGraph
from cspace.lanes._waiting import Timing, time_around

__all__ = [
    "Audit",
    "Conflict",
    "Conflicts",
    "Element",
    "HeadingRule",
    "Lane",
    "LaneVerdict",
    "LostWay",
    "Mover",
    "NodeVerdict",
    "RouteGraph",
    "Separation",
    "Timing",
    "Zones",
    "apart",
    "audit",
    "conflicts",
    "time_around",
]
