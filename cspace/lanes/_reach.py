"""Nodes and connections of a route graph along its proven lanes."""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from cspace import BLOCKED
from cspace.inside import ANGLE_SLACK, Bools, Floats, find_components, join_yaw_cells
from cspace.lanes._lane_motions import (
    SAME_YAW,
    LaneMotions,
    list_legs,
    list_parts,
    list_yaws,
    split_yaws,
)
from cspace.lanes._rooms import prove
from cspace.lanes._route_graph import RouteGraph

if TYPE_CHECKING:
    from cspace.inside import ConfigurationMap


class NodeYaws(NamedTuple):
    """Yaws of nodes, by parts of rotation cells.

    Attributes
    ----------
    parts : ndarray of float64, shape (parts, 2)
        Lower and upper yaws, radians.
    is_free : ndarray of bool, shape (nodes, parts)
        Whether all yaws of a part are proven free.
    points : ndarray of float64, shape (nodes, parts, size)
        Configurations in the middle of the parts.
    """

    parts: Floats
    is_free: Bools
    points: Floats

    def list_free(self) -> list[Floats]:
        """List each node's intervals of free yaws, radians."""
        if not np.ptp(self.parts):  # a robot that never turns
            return [self.parts[free] for free in self.is_free]
        return [join_yaw_cells(free, self.parts) for free in self.is_free]


def prove_nodes(space: ConfigurationMap, positions: Floats) -> NodeYaws:
    """Prove at which yaws the robot may stand, shape (n, 2)."""
    parts = split_yaws(space)
    shape = len(positions), len(parts)
    low, middle, high = (
        np.column_stack([np.repeat(positions, len(parts), axis=0), np.tile(yaws, len(positions))])
        for yaws in (parts[:, 0] - ANGLE_SLACK, parts.mean(axis=1), parts[:, 1] + ANGLE_SLACK)
    )
    points, low, high = (rows[:, : space.size] for rows in (middle, low, high))
    rows = np.arange(len(points))
    none = np.zeros(len(points))
    # Cells prove all yaws of a part in its middle, the geometry on a turn through all of them.
    stands = LaneMotions(points, points, none, none, rows, rows, none == 0.0)
    turns = stands._replace(starts=low, ends=high)
    is_free = none > 0.0
    for part, chosen in list_parts(space, stands, 0.0):
        is_free[chosen] = prove(part, stands.take(chosen), by_geometry=False)
        rest = chosen[~is_free[chosen]]
        rest = rest[np.asarray(part.classify(points[rest])) != BLOCKED]
        is_free[rest] = prove(part, turns.take(rest), by_geometry=True)
    return NodeYaws(parts, is_free.reshape(shape), points.reshape(*shape, space.size))


class Reach:
    """Ports of a route graph, and the free lanes between them.

    A port is a node with an interval of free yaws, in which the robot turns on the spot, or with a
    single yaw.
    """

    def __init__(self, graph: RouteGraph, is_free: Bools, free_yaws: list[Floats]) -> None:
        """Connect the ports by the lanes that are free."""
        self._free_yaws = [intervals.tolist() for intervals in free_yaws]
        self._numbers: dict[tuple[int, int, int], int] = {}
        self._fixed = {
            node
            for lane in graph.lanes
            for node, turns in zip((lane.start, lane.end), lane.turns, strict=True)
            if not turns
        }
        links: list[tuple[int, int]] = []
        for number in np.flatnonzero(is_free).tolist():
            lane = graph.lanes[number]
            legs = list_legs(graph, lane)
            ways = [(way.yaws(legs[0])[0], way.yaws(legs[-1])[1]) for way in list_yaws(graph, lane)]
            # Where all yaws are free, any stands for all.
            for start, end in ways or [(0.0, 0.0)]:
                firsts = self._find_ports(lane.start, start, lane.turns[0])
                links += product(firsts, self._find_ports(lane.end, end, lane.turns[1]))
        for node, intervals in enumerate(self._free_yaws):
            for low, _ in intervals:
                self._find_ports(node, low, True)
        size = len(self._numbers)
        first, last = np.array(links, dtype=np.int64).reshape(-1, 2).T
        self._links = sparse.csr_array((np.ones(len(links)), (first, last)), shape=(size, size))
        self._nodes = [node for node, *_ in self._numbers]

    def _find_ports(self, node: int, yaw: float, turns: bool) -> list[int]:
        """Return the numbers of the ports of a node in which a yaw lies.

        A robot that ``turns`` there is in the interval of the yaw. At a node where some lane
        forbids that, it is at the single yaw, too.
        """
        # Lanes that meet at one yaw, within rounding, need no turn.
        keys = [(node, -1, round(yaw % math.tau / SAME_YAW) % round(math.tau / SAME_YAW))]
        for k, (low, high) in enumerate(self._free_yaws[node]):
            if turns and (yaw - low) % math.tau <= high - low:
                keys = [*(keys if node in self._fixed else []), (node, k, 0)]
        return [self._numbers.setdefault(key, len(self._numbers)) for key in keys]

    def list_parts(self) -> list[list[int]]:
        """List the nodes of each strongly connected part, the largest part first."""
        if not self._nodes:
            return []
        count, labels = csgraph.connected_components(self._links, connection="strong")
        parts: list[set[int]] = [set() for _ in range(count)]
        for node, label in zip(self._nodes, labels.tolist(), strict=True):
            parts[label].add(node)
        joined = {node for part in parts if len(part) > 1 for node in part}
        unique = {tuple(sorted(part)) for part in parts if len(part) > 1 or not part <= joined}
        return [list(part) for part in sorted(unique, key=lambda part: (-len(part), part))]

    def list_lost(self, pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Return pairs of nodes without a way between them."""
        known: dict[int, set[int]] = {first: {first} for first, _ in pairs}
        for port, node in enumerate(self._nodes):
            if node in known:
                found = csgraph.breadth_first_order(self._links, port, return_predecessors=False)
                known[node].update(self._nodes[k] for k in found.tolist())
        return [(first, last) for first, last in pairs if last not in known[first]]


def judge_ways(
    space: ConfigurationMap, nodes: NodeYaws, pairs: list[tuple[int, int]]
) -> list[bool | None]:
    """Return whether any way leads between two nodes.

    True if a way is proven, False if it is proven that there is none, otherwise None.
    """
    if not pairs:
        return []
    used, places = np.unique(np.array(pairs), return_inverse=True)
    points = nodes.points[used]
    shape = points.shape[:2]
    rows = points.reshape(-1, space.size)
    free, passable = (find_components(space, rows, mixed).reshape(shape) for mixed in (False, True))
    free = np.where(nodes.is_free[used], free, -1)
    free_sets, passable_sets = (
        [set(row) - {-1} for row in labels.tolist()] for labels in (free, passable)
    )
    ways: list[bool | None] = []
    for first, last in places.reshape(-1, 2).tolist():
        is_joined = not free_sets[first].isdisjoint(free_sets[last])
        may_join = not passable_sets[first].isdisjoint(passable_sets[last])
        ways.append(True if is_joined else None if may_join else False)
    return ways
