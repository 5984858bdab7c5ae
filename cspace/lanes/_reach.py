"""Nodes and connections of a route graph along its proven lanes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from cspace._queries.yaws import join_yaw_cells
from cspace._rotations.base import ANGLE_SLACK
from cspace._support.arrays import BLOCKED, Bools, Floats, Ints
from cspace.lanes._route_graph import RouteGraph
from cspace.lanes._tubes import Tubes, tubes_are_free
from cspace.lanes._verdicts import end_yaws

if TYPE_CHECKING:
    from cspace._configuration_map import ConfigurationMap

YAW_DIGITS: Final = 9
"""Digits after the point of a yaw, radians, at which two lanes meet without a turn."""

Port = tuple[int, float]
"""A node, and the interval of yaws, or the single yaw, between which the robot turns there."""


class NodeCells(NamedTuple):
    """What is known of each node, by rotation cell.

    Attributes
    ----------
    is_free : ndarray of bool, shape (nodes, rotation cells)
        Whether all yaws of a rotation cell are proven free.
    cells : ndarray of int64, shape (nodes, rotation cells, 1 + d)
    """

    is_free: Bools
    cells: Ints


class Reach(NamedTuple):
    """Ports of a route graph and the lanes between them.

    Attributes
    ----------
    ports : list of (int, float)
    graph : sparse array, shape (ports, ports)
    """

    ports: list[Port]
    graph: sparse.csr_array

    def list_parts(self) -> list[list[int]]:
        """List the nodes of each strongly connected part, the largest part first."""
        if not self.ports:
            return []
        count, labels = csgraph.connected_components(self.graph, connection="strong")
        parts: list[set[int]] = [set() for _ in range(count)]
        for (node, _), label in zip(self.ports, labels.tolist(), strict=True):
            parts[label].add(node)
        unique = {tuple(sorted(part)) for part in parts}
        return [list(part) for part in sorted(unique, key=lambda part: (-len(part), part))]

    def reaches(self, pairs: list[tuple[int, int]]) -> list[bool]:
        """Return whether the robot gets from one node to the other, for each pair."""
        ports_of: dict[int, list[int]] = {}
        for k, (node, _) in enumerate(self.ports):
            ports_of.setdefault(node, []).append(k)
        known: dict[int, set[int]] = {}
        for start in {first for first, last in pairs if first != last}:
            known[start] = {start}
            for port in ports_of.get(start, []):
                found = csgraph.breadth_first_order(self.graph, port, return_predecessors=False)
                known[start].update(self.ports[k][0] for k in found.tolist())
        return [first == last or last in known[first] for first, last in pairs]


def prove_nodes(space: ConfigurationMap, positions: Floats, exact: bool) -> NodeCells:
    """Prove at which rotation cells the robot may stand at nodes, shape (n, 2)."""
    if space.rotations.names:
        yaws = space.rotations.centers[:, 0]
        bounds = space.rotations._stored_arrays["yaw_bounds"]
        points = np.column_stack(
            [np.repeat(positions, len(yaws), axis=0), np.tile(yaws, len(positions))]
        )
        turns = np.tile(0.5 * np.ptp(bounds, axis=1) + ANGLE_SLACK, len(positions))
    else:
        points, turns = positions, np.zeros(len(positions))
    is_free = np.array(space.motion_is_free(points, points))
    if exact:
        rest = np.flatnonzero(~is_free & (np.asarray(space.classify(points)) != BLOCKED))
        tubes = Tubes(points[rest], points[rest], np.zeros(len(rest)), turns[rest])
        is_free[rest] = tubes_are_free(space, tubes, exact=True)
    shape = len(positions), len(space.rotations)
    cells = space._cells_of(points)
    return NodeCells(is_free.reshape(shape), cells.reshape(*shape, cells.shape[1]))


def list_free_yaws(space: ConfigurationMap, nodes: NodeCells) -> list[Floats]:
    """Return the intervals of yaw at which the robot may stand at each node, radians.

    Without a yaw, a free node has the interval of all yaws.
    """
    if not space.rotations.names:
        whole = np.array([[-math.pi, math.pi]])
        return [whole if free[0] else whole[:0] for free in nodes.is_free]
    bounds = space.rotations._stored_arrays["yaw_bounds"]
    return [join_yaw_cells(free, bounds) for free in nodes.is_free]


def connect(graph: RouteGraph, is_free: Bools, free_yaws: list[Floats], has_yaw: bool) -> Reach:
    """Connect the ports of nodes by the free lanes."""
    numbers: dict[Port, int] = {}

    def port(node: int, yaw: float) -> int:
        """Return the number of the port of a node in which a yaw lies."""
        key = float(round(math.remainder(yaw, math.tau), YAW_DIGITS)), -1
        for k, (low, high) in enumerate(free_yaws[node].tolist()):
            if not has_yaw or (yaw - low) % math.tau <= high - low:
                key = 0.0, k
        return numbers.setdefault((node, key), len(numbers))  # type: ignore[arg-type]

    first, last = [], []
    for lane, free in zip(graph.lanes, is_free.tolist(), strict=True):
        if not free:
            continue
        # Where all yaws are free, any stands for all.
        for begin, end in end_yaws(graph, lane) or [(0.0, 0.0)]:
            first.append(port(lane.start, begin))
            last.append(port(lane.end, end))
    for node, intervals in enumerate(free_yaws):
        for low in intervals[:, 0].tolist():
            port(node, low)
    size = len(numbers)
    links = sparse.csr_array((np.ones(len(first)), (first, last)), shape=(size, size))
    return Reach(list(numbers), links)


def judge_ways(
    space: ConfigurationMap, nodes: NodeCells, pairs: list[tuple[int, int]]
) -> list[bool | None]:
    """Return whether the map has any way between two nodes, at any yaws.

    True if a way is proven, False if it is proven that there is none, otherwise None.
    """
    if not pairs:
        return []
    components = space._components
    used = np.unique(np.array(pairs))
    cells = nodes.cells[used].reshape(-1, nodes.cells.shape[2])
    shape = nodes.is_free[used].shape
    free, open_ = (components.find(cells, mixed).reshape(shape) for mixed in (False, True))
    free = np.where(nodes.is_free[used], free, -1)
    sets = [[set(row.tolist()) - {-1} for row in labels] for labels in (free, open_)]
    place = {node: k for k, node in enumerate(used.tolist())}
    ways: list[bool | None] = []
    for first, last in pairs:
        a, b = place[first], place[last]
        if sets[0][a] & sets[0][b]:
            ways.append(True)
        else:
            ways.append(None if sets[1][a] & sets[1][b] else False)
    return ways
