"""The audit of a route graph: verdicts of lanes and nodes, connections, and their reports."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from cspace import BLOCKED
from cspace.inside import (
    Bools,
    Floats,
    StrPath,
    cells_of,
    check_not_negative,
    names_options,
    show_png,
)
from cspace.lanes._collisions import Hit, find_hits, sample_motions
from cspace.lanes._lane_motions import list_legs, list_motions, list_parts, open_graph
from cspace.lanes._reach import Reach, judge_ways, prove_nodes
from cspace.lanes._reports import (
    MAX_PRINTED_ROWS,
    JunitCase,
    format_table,
    format_value,
    make_features,
    write_csv,
    write_junit,
)
from cspace.lanes._rooms import measure_rooms, prove
from cspace.lanes._route_graph import RouteGraph

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.inside import ConfigurationMap

LaneState: TypeAlias = Literal["free", "blocked", "undecided"]
"""Verdicts about a lane."""

COLORS: Final = {"free": "#1a7f37", "blocked": "#c4161c", "undecided": "#e08a00"}
"""Colors of lanes in pictures, by verdict."""

COLUMNS: Final = (
    *("lane", "start", "end", "verdict", "at", "obstacle"),
    *("left_m", "right_m", "margin_m"),
)
"""Columns of tables, for each lane."""


class LaneVerdict(NamedTuple):
    """Verdict about a lane in one direction.

    Attributes
    ----------
    lane, start, end : str
        Names of the lane and of its nodes.
    verdict : str
        "free": proven all along, at every yaw that its rule allows; "blocked": a configuration that
        the rule allows is proven in collision; otherwise "undecided".
    at : tuple of float or None
        First configuration proven in collision, or the first one that is not proven free.
    obstacle : str
        What the robot touches there.
    left, right : float
        Proven shift of the whole lane to either side, metres, at most ``max_room``.
    margin : float
        Proven growth of the robot with its margin, metres, at most ``max_room``.
    """

    lane: str
    start: str
    end: str
    verdict: LaneState
    at: tuple[float, ...] | None = None
    obstacle: str = ""
    left: float = 0.0
    right: float = 0.0
    margin: float = 0.0

    @property
    def _cells(self) -> dict[str, Any]:
        """Values of the table, by columns."""
        values = dict(zip(COLUMNS, self, strict=True))
        if self.verdict != "free":
            values |= dict.fromkeys(COLUMNS[-3:])
        return values


class NodeVerdict(NamedTuple):
    """Where a robot may stand and turn at a node.

    Attributes
    ----------
    node : str
    position : tuple of float
    free_yaws : ndarray of float64, shape (n, 2)
        Intervals of yaw, radians, that are proven free for turns on the spot.
    """

    node: str
    position: tuple[float, float]
    free_yaws: Floats

    @property
    def turns_around(self) -> bool:
        """Whether the robot may turn all around."""
        return bool(len(self.free_yaws) and np.ptp(self.free_yaws[0]) >= math.tau)


class LostWay(NamedTuple):
    """Two nodes of a lane whose second is no longer reached from the first.

    Attributes
    ----------
    start, end : str
    exists : bool or None
        True if the map has a way beside the lanes, for a robot that also moves sideways; False if
        no way at all is proven, so that redrawing lanes does not help; otherwise None.
    """

    start: str
    end: str
    exists: bool | None


@dataclass(frozen=True, eq=False)
class Audit:
    """The audit of a route graph for one robot.

    Attributes
    ----------
    space : ConfigurationMap
        The map.
    graph : RouteGraph
    lanes : list of LaneVerdict
        One for each lane and direction.
    nodes : list of NodeVerdict
    parts : list of list of str
        Strongly connected parts along the free lanes, the largest first. A node at which the robot
        cannot turn may be in several.
    lost : list of LostWay
        The lanes whose end is no longer reached from their start. Every other node that is reached
        no longer is so because of these, or because the robot does not turn at a node.
    """

    space: ConfigurationMap
    graph: RouteGraph
    lanes: list[LaneVerdict]
    nodes: list[NodeVerdict]
    parts: list[list[str]]
    lost: list[LostWay]

    @property
    def counts(self) -> dict[str, int]:
        """Number of lanes by verdict."""
        counts = Counter(row.verdict for row in self.lanes)
        return {verdict: counts[verdict] for verdict in COLORS}  # type: ignore[index]

    @property
    def _summary(self) -> str:
        """Robot and numbers of lanes by verdict."""
        numbers = ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items())
        return f"{self.space.robot.name}: {numbers}"

    def __repr__(self) -> str:
        """Return the robot and numbers of lanes by verdict."""
        return f"Audit({self._summary})"

    def __str__(self) -> str:
        """Return a table of lanes, failed turns, and what is cut off."""
        order = sorted(self.lanes, key=lambda row: row.verdict == "free")
        lines = [repr(self)]
        lines += format_table(COLUMNS, [list(row._cells.values()) for row in order], "lanes")
        stuck = [row.node for row in self.nodes if not row.turns_around]
        if stuck:
            lines.append(f"no turn all around at: {', '.join(stuck[:MAX_PRINTED_ROWS])}")
        texts = {True: "there is a way beside the lanes", False: "there is no way at all, proven"}
        for start, end, exists in self.lost[:MAX_PRINTED_ROWS]:
            text = "undecided whether there is a way" if exists is None else texts[exists]
            lines.append(f"{start} no longer reaches {end}: {text}")
        return "\n".join(lines)

    def plot(self) -> Axes:
        """Draw the map with lanes in their verdicts' colors.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from cspace.plot import extend_legend

        axes = self.space.plot(title=f"Lanes, {self._summary}")
        for verdict, color in COLORS.items():
            rows = [k for k, row in enumerate(self.lanes) if row.verdict == verdict]
            lines = [line_of(self.graph, k) for k in rows]
            if not lines:
                continue
            # Lanes are separated by gaps, so that one artist draws all.
            gap = np.full((1, 2), math.nan)
            points = np.concatenate([part for line in lines for part in (line, gap)])
            label = f"{len(rows)} {verdict}"
            axes.plot(*points.T, color=color, linewidth=2.0, label=label, zorder=5)
            places = np.array([self.lanes[k].at[:2] for k in rows if self.lanes[k].at])  # type: ignore[index]
            if len(places):
                axes.plot(*places.T, "X", color=color, markeredgecolor="white", ms=9, zorder=7)
        turns = np.array([row.turns_around for row in self.nodes], dtype=np.bool_)
        for chosen, face, text in ((turns, "white", "turns around"), (~turns, "black", "does not")):
            if chosen.any():
                places = self.graph.positions[chosen]
                label = f"node: {text}"
                axes.plot(*places.T, "ok", ms=5, markerfacecolor=face, label=label, zorder=6)
        extend_legend(axes, axes.get_legend_handles_labels()[0])
        return axes

    _repr_png_ = show_png

    @names_options
    def to_geojson(self, path: StrPath | None = None, overwrite: bool = False) -> dict[str, Any]:
        """Return lanes as lines and nodes as points, metres; write them to a path."""
        shapes: list[tuple[dict[str, Any], dict[str, Any]]] = []
        for k, row in enumerate(self.lanes):
            line = {"type": "LineString", "coordinates": line_of(self.graph, k).tolist()}
            shapes.append((line, row._cells))
        for node in self.nodes:
            properties = {
                "node": node.node,
                "turns_around": node.turns_around,
                "free_yaws": node.free_yaws.tolist(),
            }
            shapes.append(({"type": "Point", "coordinates": list(node.position)}, properties))
        return make_features(shapes, path, overwrite)

    @names_options
    def to_csv(self, path: StrPath, overwrite: bool = False) -> None:
        """Write one row for each lane and direction."""
        write_csv(path, overwrite, COLUMNS, (row._cells for row in self.lanes))

    @names_options
    def to_junit(self, path: StrPath, overwrite: bool = False, strict: bool = False) -> None:
        """Write a JUnit report: one test for each lane and direction.

        A blocked lane fails; an undecided one is skipped, or fails if ``strict``.
        """
        failing = ("blocked", "undecided") if strict else ("blocked",)
        cases = []
        for row in self.lanes:
            text = f"{row.verdict} at {format_value(row.at)} {row.obstacle}".rstrip()
            message = text if row.verdict != "free" else ""
            name = f"{row.lane}: {row.start} to {row.end}"
            cases.append(JunitCase(name, message, row.verdict in failing))
        write_junit(path, overwrite, f"lanes for {self.space.robot.name}", "lanes", cases)


class LaneProofs(NamedTuple):
    """Proofs of lanes, by index.

    Attributes
    ----------
    is_free : ndarray of bool, shape (n,)
        Whether a lane is free.
    rooms : ndarray of float64, shape (n, 3)
        Room on the left and on the right, and margin, metres.
    hits : dict of int to Hit
        Of each lane that is not free.
    """

    is_free: Bools
    rooms: Floats
    hits: dict[int, Hit]


@names_options
def audit(
    space: ConfigurationMap,
    graph: RouteGraph | StrPath | Any,
    *,
    max_room: float = 1.0,
) -> Audit:
    """Prove the lanes of a graph free or blocked for a robot.

    Every lane is proven along its whole length, at every yaw that its rule allows; the geometry
    decides what cells do not. See
    :class:`cspace.lanes.Audit`.

    Parameters
    ----------
    space : CSpace or TiledCSpace
        A map with the axes x, y, or x, y, yaw.
    graph : cspace.lanes.RouteGraph, str, Path or networkx graph
        Lanes; a file is read by :meth:`cspace.lanes.RouteGraph.open`, a graph of networkx by
        :meth:`cspace.lanes.RouteGraph.from_networkx`.
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
    >>> import numpy as np, cspace
    >>> from cspace.lanes import RouteGraph
    >>> occupied = np.zeros((80, 60), dtype=bool)
    >>> occupied[40:42, :30] = True
    >>> workspace = cspace.Workspace.from_array(occupied, 0.1)
    >>> space = cspace.build(workspace, "rect:0.6x0.4", rotations=72)
    >>> graph = RouteGraph.from_arrays([(1, 2), (7, 2), (7, 5)], [(0, 1), (1, 2)])
    >>> audit = cspace.lanes.audit(space, graph)
    >>> audit
    Audit(rectangle 0.6 m x 0.4 m: 1 free, 1 blocked, 0 undecided)
    >>> audit.lanes[0].obstacle
    'the obstacle at (4.05, 1.85)'
    """
    room = check_not_negative(max_room, "max_room")
    lanes = open_graph(space, graph, "graph")
    space = cells_of(space)
    proofs = prove_lanes(space, lanes, room)
    nodes = prove_nodes(space, lanes.positions)
    yaws = nodes.list_free()
    reach = Reach(lanes, proofs.is_free, yaws)
    broken = (lanes.lanes[k] for k in np.flatnonzero(~proofs.is_free))
    lost = reach.list_lost(list(dict.fromkeys((lane.start, lane.end) for lane in broken)))
    return Audit(
        space,
        lanes,
        [_describe(space, lanes, proofs, k) for k in range(len(lanes.lanes))],
        [NodeVerdict(*row) for row in zip(lanes.names, lanes._places, yaws, strict=True)],
        [[lanes.names[node] for node in part] for part in reach.list_parts()],
        [
            LostWay(lanes.names[first], lanes.names[last], exists)
            for (first, last), exists in zip(lost, judge_ways(space, nodes, lost), strict=True)
        ],
    )


def prove_lanes(space: ConfigurationMap, graph: RouteGraph, max_room: float) -> LaneProofs:
    """Prove lanes free or blocked, and measure their rooms."""
    count = len(graph.lanes)
    motions = list_motions(space, graph)
    is_straight = np.array([not lane.legs for lane in graph.lanes], dtype=np.bool_)
    is_free, by_cells = np.ones((2, count), dtype=np.bool_)
    proofs = LaneProofs(is_free, np.full((count, 3), max_room), {})
    for part, rows in list_parts(space, motions, max_room):
        chosen = motions.take(rows)
        in_cells = prove(part, chosen, by_geometry=False)
        is_free = in_cells.copy()
        rest = np.isin(chosen.lanes, chosen.lanes[~in_cells])
        samples = sample_motions(part, chosen.take(rest))
        # A lane with a BLOCKED configuration is decided.
        blocked = samples.lanes[samples.states == BLOCKED]
        unsure = np.flatnonzero(~in_cells & ~np.isin(chosen.lanes, blocked))
        is_free[unsure] = prove(part, chosen.take(unsure), by_geometry=True)
        unproven = chosen.take(~is_free)
        # A lane may be undecided though every configuration of it is FREE, at a border of cells.
        hits = {
            lane: Hit(True, math.inf, tuple(point))
            for lane, point in zip(unproven.lanes.tolist(), unproven.starts.tolist(), strict=True)
        }
        samples = samples.take(np.isin(samples.lanes, unproven.lanes))
        hits |= find_hits(space, part, samples)
        for lane, hit in hits.items():
            proofs.hits[lane] = min(hit, proofs.hits.get(lane, hit))
        by_cells[chosen.lanes[~in_cells]] = False
        proofs.is_free[unproven.lanes] = False
        chosen = chosen.take(proofs.is_free[chosen.lanes])
        kinds = by_cells[chosen.lanes], is_straight[chosen.lanes]
        rooms = measure_rooms(part, chosen, *kinds, max_room)
        # The worst motion of a lane bounds the lane.
        np.minimum.at(proofs.rooms, chosen.lanes, rooms)
    return proofs


def _describe(
    space: ConfigurationMap, graph: RouteGraph, proofs: LaneProofs, number: int
) -> LaneVerdict:
    """Return the verdict about a lane."""
    lane = graph.lanes[number]
    ends = lane.name, graph.names[lane.start], graph.names[lane.end]
    if proofs.is_free[number]:
        return LaneVerdict(*ends, "free", None, "", *proofs.rooms[number].tolist())
    hit = proofs.hits[number]
    obstacle = hit.obstacle
    for node in (lane.end, lane.start):
        if space.outside != "free" and not space.grid.contains(graph.positions[node]):
            obstacle = f"node {graph.names[node]} lies outside the map"
    return LaneVerdict(
        *ends, "undecided" if hit.is_open else "blocked", at=hit.point, obstacle=obstacle
    )


def line_of(graph: RouteGraph, number: int) -> Floats:
    """Return the points of a lane, shape (n, 2)."""
    legs = list_legs(graph, graph.lanes[number])
    return np.array([legs[0].start, *(leg.end for leg in legs)])
