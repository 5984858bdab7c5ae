"""The audit of a route graph: verdicts of lanes and nodes, connections, and their reports."""

from __future__ import annotations

import csv
import json
import math
import xml.etree.ElementTree as ElementTree
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from cspace._files.access import replacing
from cspace._support.arrays import Bools, Floats, StrPath
from cspace._support.check import check_flag, check_not_negative
from cspace.errors import InputError
from cspace.lanes._reach import connect, judge_ways, list_free_yaws, prove_nodes
from cspace.lanes._rooms import measure_rooms
from cspace.lanes._route_graph import RouteGraph
from cspace.lanes._verdicts import (
    check_map,
    end_yaws,
    find_collisions,
    find_places,
    has_no_direction,
    legs_of,
    list_motions,
    prove_by_cells,
    prove_by_geometry,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace._configuration_map import ConfigurationMap
    from planners._result import Plan

LaneState: TypeAlias = Literal["free", "blocked", "undecided"]
"""What is proven about a lane."""

COLORS: Final = {"free": "#1a7f37", "blocked": "#c4161c", "undecided": "#e08a00"}
"""Colors of lanes in pictures, by verdict."""

MAX_PRINTED_ROWS: Final = 40
"""Number of lanes that a printed table lists; blocked and undecided ones come first."""

COLUMNS: Final = (
    *("lane", "start", "end", "verdict", "proven_by", "at", "obstacle"),
    *("left_m", "right_m", "margin_m"),
)
"""Columns of tables, for each lane."""


class LaneVerdict(NamedTuple):
    """What is proven about a lane in one direction.

    Attributes
    ----------
    lane, start, end : str
        Names of the lane and of its nodes.
    verdict : str
        "free": proven all along, at every yaw that its rule allows; "blocked": a configuration that
        the rule allows is proven in collision; otherwise "undecided".
    proven_by : str
        "cells" or "geometry", if free.
    at : tuple of float or None
        First configuration proven in collision, or the first one that is not proven free.
    obstacle : str
        What the robot touches there.
    left, right : float
        Metres, at most ``max_room``, by which the whole lane may shift to either side; proven.
    margin : float
        Metres, at most ``max_room``, by which the robot, with its margin, may grow; proven.
    """

    lane: str
    start: str
    end: str
    verdict: LaneState
    proven_by: str = ""
    at: tuple[float, ...] | None = None
    obstacle: str = ""
    left: float = 0.0
    right: float = 0.0
    margin: float = 0.0

    @property
    def cells(self) -> dict[str, Any]:
        """Values of the table, by the names of its columns."""
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
        Intervals of yaw, radians, within each of which the robot may turn on the spot; proven.
    """

    node: str
    position: tuple[float, float]
    free_yaws: Floats

    @property
    def turns_around(self) -> bool:
        """Whether the robot may turn all around."""
        return bool(len(self.free_yaws) and np.ptp(self.free_yaws[0]) >= math.tau)


class LostWay(NamedTuple):
    """Two nodes of a lane, of which the second is no longer reached from the first.

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

    def __repr__(self) -> str:
        """Return the robot and the numbers of lanes by verdict."""
        numbers = ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items())
        return f"Audit({self.space.robot.name}: {numbers})"

    def __str__(self) -> str:
        """Return a table of the lanes, then what does not turn and what is cut off."""
        order = sorted(self.lanes, key=lambda row: row.verdict == "free")
        table = [COLUMNS]
        table += [
            tuple(map(_format, row.cells.values()))  # type: ignore[misc]
            for row in order[:MAX_PRINTED_ROWS]
        ]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = [repr(self)]
        for row in table:
            padded = map(str.ljust, row, widths)
            lines.append("  ".join(padded).rstrip())
        if len(order) > MAX_PRINTED_ROWS:
            lines.append(f"... and {len(order) - MAX_PRINTED_ROWS} more lanes")
        stuck = [row.node for row in self.nodes if not row.turns_around]
        if stuck:
            lines.append(f"no turn all around at: {', '.join(stuck[:MAX_PRINTED_ROWS])}")
        texts = {True: "there is a way beside the lanes", False: "there is no way at all, proven"}
        for start, end, exists in self.lost[:MAX_PRINTED_ROWS]:
            text = "undecided whether there is a way" if exists is None else texts[exists]
            lines.append(f"{start} no longer reaches {end}: {text}")
        return "\n".join(lines)

    def find_way(self, start: str, end: str) -> Plan:
        """Plan a way beside the lanes, from one node to another.

        Its ends have the yaws of a lane between the two, otherwise yaws that are free there.

        Raises
        ------
        InputError
            If the graph has no such node.
        ConfigurationError
            If the robot does not stand free at a node.
        """
        import planners

        ends = [
            _index_of(self.graph, name, word) for name, word in ((start, "start"), (end, "end"))
        ]
        yaws: list[float] = []
        if self.space.rotations.names:
            drawn = [lane for lane in self.graph.lanes if [lane.start, lane.end] == ends]
            ways = end_yaws(self.graph, drawn[0]) if drawn else []
            free = [self.nodes[node].free_yaws for node in ends]
            middles = [float(row[0].mean()) if len(row) else 0.0 for row in free]
            yaws = list(ways[0]) if ways else middles
        points = [(*self.graph.places[node], *yaws[k : k + 1]) for k, node in enumerate(ends)]
        return planners.plan(self.space, *points, exact=self.space.in_memory)

    def plot(self) -> Axes:
        """Draw the map with the lanes in the color of their verdict, and the places on them.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from cspace.plot._artists import add_legend_below

        axes = self.space.plot(title=repr(self))
        for verdict, color in COLORS.items():
            rows = [k for k, row in enumerate(self.lanes) if row.verdict == verdict]
            lines = [_line_of(self.graph, k) for k in rows]
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
        figure: Any = axes.figure
        (legend,) = figure.legends
        legend.remove()
        add_legend_below(figure, [*legend.legend_handles, *axes.get_legend_handles_labels()[0]])
        return axes

    def to_geojson(self) -> dict[str, Any]:
        """Return lanes as lines and nodes as points, in metres of the map's frame."""
        features = []
        for k, row in enumerate(self.lanes):
            geometry = {"type": "LineString", "coordinates": _line_of(self.graph, k).tolist()}
            features.append({"type": "Feature", "geometry": geometry, "properties": row.cells})
        for node in self.nodes:
            properties = {
                "node": node.node,
                "turns_around": node.turns_around,
                "free_yaws": node.free_yaws.tolist(),
            }
            geometry = {"type": "Point", "coordinates": list(node.position)}
            features.append({"type": "Feature", "geometry": geometry, "properties": properties})
        return {"type": "FeatureCollection", "features": features}

    def to_csv(self, path: StrPath, overwrite: bool = False) -> None:
        """Write one row for each lane and direction."""
        with replacing(path, overwrite) as file, file.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, COLUMNS)
            writer.writeheader()
            for row in self.lanes:
                place = " ".join(map(repr, row.at or ()))
                writer.writerow(row.cells | {"at": place})

    def to_junit(self, path: StrPath, overwrite: bool = False, strict: bool = False) -> None:
        """Write a JUnit report: one test for each lane and direction.

        A blocked lane fails; an undecided one is skipped, or fails if ``strict``.
        """
        check_flag(strict, "strict")
        counts = self.counts
        failing = ("blocked", "undecided") if strict else ("blocked",)
        failures = sum(counts[verdict] for verdict in failing)
        suite = ElementTree.Element(
            "testsuite",
            name=_as_xml(f"lanes for {self.space.robot.name}"),
            tests=str(len(self.lanes)),
            failures=str(failures),
            errors="0",
            skipped=str(len(self.lanes) - counts["free"] - failures),
        )
        for row in self.lanes:
            name = _as_xml(f"{row.lane}: {row.start} to {row.end}")
            case = ElementTree.SubElement(suite, "testcase", classname="lanes", name=name)
            if row.verdict != "free":
                tag = "failure" if row.verdict in failing else "skipped"
                text = f"{row.verdict} at {_format(row.at)} {row.obstacle}".rstrip()
                ElementTree.SubElement(case, tag, message=_as_xml(text))
        with replacing(path, overwrite) as file:
            ElementTree.ElementTree(suite).write(file, encoding="utf-8", xml_declaration=True)

    def write_geojson(self, path: StrPath, overwrite: bool = False) -> None:
        """Write :meth:`to_geojson` to a file."""
        with replacing(path, overwrite) as file:
            file.write_text(json.dumps(self.to_geojson(), allow_nan=False))


def audit_graph(space: ConfigurationMap, graph: RouteGraph, exact: bool, max_room: float) -> Audit:
    """Audit a route graph; see :func:`planners.audit`."""
    check_flag(exact, "exact")
    room = check_not_negative(max_room, "max_room")
    check_map(space, graph)
    motions = list_motions(space, graph)
    count = len(graph.lanes)

    def cover(is_free: Bools) -> Bools:
        """Return which lanes have no motion that is not free."""
        return np.asarray(np.bincount(motions.lanes[~is_free], minlength=count) == 0)

    by_cells = prove_by_cells(space, motions)
    is_free = by_cells.copy()
    rest = np.flatnonzero(~cover(is_free)[motions.lanes])
    places = find_places(space, motions.take(rest))
    if exact:
        # A lane with a BLOCKED configuration is decided.
        blocked = np.unique(places.lanes[places.states > 1])
        rows = rest[~is_free[rest] & ~np.isin(motions.lanes[rest], blocked)]
        is_free[rows] = prove_by_geometry(space, motions.take(rows))
    free = cover(is_free)
    places = places.take(~free[places.lanes])
    collisions, obstacles = find_collisions(space, places, exact)
    rooms, margins = _measure_lanes(space, graph, motions, by_cells, free, room)
    first: dict[int, tuple[float, ...]] = {}
    for found in (places.firsts(), collisions):  # collisions replace what is only not FREE
        first |= dict(zip(found.lanes.tolist(), map(tuple, found.points.tolist()), strict=True))
    # A lane may be undecided though every configuration of it is FREE, at a border of cells.
    for k in np.flatnonzero(~free & ~np.isin(np.arange(count), places.lanes)).tolist():
        number = int(np.flatnonzero((motions.lanes == k) & ~is_free)[0])
        first[k] = tuple(motions.tubes.starts[number].tolist())
    proven_by = np.where(cover(by_cells), "cells", "geometry")
    lanes = []
    for k, lane in enumerate(graph.lanes):
        verdict: LaneState = "free" if free[k] else "blocked" if k in obstacles else "undecided"
        lanes.append(
            LaneVerdict(
                lane.name,
                graph.names[lane.start],
                graph.names[lane.end],
                verdict,
                str(proven_by[k]) if free[k] else "",
                None if free[k] else first[k],
                obstacles.get(k, ""),
                float(rooms[k, 0]),
                float(rooms[k, 1]),
                float(margins[k]),
            )
        )
    return _judge_graph(space, graph, lanes, free, exact)


def _measure_lanes(
    space: ConfigurationMap,
    graph: RouteGraph,
    motions: Any,
    by_cells: Bools,
    free: Bools,
    max_room: float,
) -> tuple[Floats, Floats]:
    """Return the rooms of lanes, shape (n, 2), and their margins, shape (n,), metres."""
    rows = np.flatnonzero(free[motions.lanes])
    chosen = motions.take(rows)
    is_line = np.array([not (lane.legs or has_no_direction(graph, lane)) for lane in graph.lanes])
    moves = (chosen.tubes.starts[:, :2] != chosen.tubes.ends[:, :2]).any(axis=1)
    is_simple = is_line[chosen.lanes] & moves if len(rows) else moves
    rooms, margins = measure_rooms(space, chosen, by_cells[rows], is_simple, max_room)
    # The worst motion of a lane bounds the lane.
    of_lanes = np.where(free[:, None], max_room, 0.0) + np.zeros((len(free), 3))
    np.minimum.at(of_lanes, chosen.lanes, np.column_stack([rooms, margins]))
    return of_lanes[:, :2], of_lanes[:, 2]


def _judge_graph(
    space: ConfigurationMap,
    graph: RouteGraph,
    lanes: list[LaneVerdict],
    free: Bools,
    exact: bool,
) -> Audit:
    """Return the audit, with its nodes and what they reach."""
    cells = prove_nodes(space, graph.positions, exact)
    yaws = list_free_yaws(space, cells)
    reach = connect(graph, free, yaws, bool(space.rotations.names))
    parts = [[graph.names[node] for node in part] for part in reach.list_parts()]
    pairs = [(lane.start, lane.end) for k, lane in enumerate(graph.lanes) if not free[k]]
    pairs = list(dict.fromkeys(pairs))
    lost = [pair for pair, found in zip(pairs, reach.reaches(pairs), strict=True) if not found]
    ways = judge_ways(space, cells, lost)
    return Audit(
        space,
        graph,
        lanes,
        [NodeVerdict(*row) for row in zip(graph.names, graph.places, yaws, strict=True)],
        parts,
        [
            LostWay(graph.names[first], graph.names[last], exists)
            for (first, last), exists in zip(lost, ways, strict=True)
        ],
    )


def _index_of(graph: RouteGraph, name: str, argument: str) -> int:
    """Return the index of a node; raise InputError if there is none."""
    if name not in graph.names:
        raise InputError(argument, f"is {name!r}", "it must be the name of a node")
    return graph.names.index(name)


def _line_of(graph: RouteGraph, number: int) -> Floats:
    """Return the points of a lane, shape (n, 2)."""
    legs = legs_of(graph, graph.lanes[number])
    return np.array([legs[0].start, *(leg.end for leg in legs)])


def _format(value: Any) -> str:
    """Format a value for a table."""
    if isinstance(value, tuple):
        return f"({', '.join(f'{number:.3f}' for number in value)})"
    if isinstance(value, float):
        return f"{value:.3f}"
    return "" if value is None else str(value)


def _as_xml(text: str) -> str:
    """Replace characters that XML does not allow."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
