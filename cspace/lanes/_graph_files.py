"""Readers of route graphs: Nav2, Open-RMF, LIF and VDA 5050.

A field that changes where a robot drives, or how it stands there, is honoured or refused by name.
A field that is neither that nor known to change nothing is named in a warning.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final

import numpy as np
import yaml

from cspace._files.access import ContentError, check_suffix, decoding, read_text
from cspace._support.arrays import Floats, StrPath
from cspace._support.reporting import warn_user
from cspace.lanes._curves import Leg, cut_nurbs
from cspace.lanes._headings import HEADINGS, HeadingRule, Lane, find_repeated

SUFFIXES: Final = (".geojson", ".json", ".yaml", ".yml")
"""Suffixes of route graphs."""

EDGE_PROPERTIES: Final = "vehicleTypeEdgeProperties"
"""Field of a LIF edge with its rules for each type of vehicle."""

MAX_GAP: Final = 0.01
"""Largest distance, metres, of a drawn line or a trajectory from the nodes that it joins."""

METRIC_CRS: Final = ("EPSG::3857", "EPSG:3857")
"""Coordinate systems that Nav2's example graphs name for metres of the map."""

RMF_LANE_OPTIONS: Final = frozenset(
    (
        *("orientation_constraint", "is_bidirectional", "speed_limit", "dock_name", "undock_name"),
        *("door_name", "mutex", "graph_idx", "demo_mock_floor_name", "demo_mock_lift_name"),
    )
)
"""Options of Open-RMF lanes that are honoured, or do not change where the robot drives."""

KNOWN_FIELDS: Final = {
    "Nav2 node": "id frame name metadata operations class",
    "Nav2 edge": "id startid endid cost overridable metadata operations name class",
    "vertex": "name is_holding_point is_passthrough_point is_parking_spot is_charger "
    "is_cleaning_zone dock_name merge_radius mutex spawn_robot_name spawn_robot_type "
    "pickup_dispenser dropoff_ingestor human_goal_set_name lift_cabin",
    "node": "nodeId nodeName nodeDescription nodeDescriptor nodePosition mapId sequenceId released "
    "actions vehicleTypeNodeProperties",
    "nodePosition": "x y theta allowedDeviationXY allowedDeviationXy allowedDeviationTheta mapId "
    "mapDescription",
    "vehicleTypeNodeProperties": "vehicleTypeId vehicleTypeIds theta actions",
    "edge": "edgeId edgeName edgeDescription edgeDescriptor sequenceId released startNodeId "
    "endNodeId orientation orientationType rotationAllowed trajectory corridor actions length "
    "maxSpeed maximumSpeed maxRotationSpeed vehicleTypeEdgeProperties",
    EDGE_PROPERTIES: "vehicleTypeId vehicleTypeIds vehicleOrientation orientationType "
    "rotationAllowed rotationAtStartNodeAllowed rotationAtEndNodeAllowed maxSpeed "
    "maxRotationSpeed reentryAllowed trajectory corridor actions",
    "trajectory": "degree knotVector controlPoints",
    "control point": "x y weight orientation",
    "corridor": "leftWidth rightWidth corridorRefPoint corridorReferencePoint releaseRequired "
    "releaseLossBehavior",
}
"""Fields of elements that are honoured, refused or change nothing, separated by blanks."""

Stations = Mapping[str, tuple[str, ...]]
"""Nodes of each station."""

GraphContents = tuple[tuple[str, ...], Floats, tuple[Lane, ...], Floats, Stations]
"""Attributes of a route graph, in their order."""

Rule = HeadingRule | None
"""Rule of lanes for which a file does not give one."""


class GraphBuilder:
    """Nodes and lanes of a file, checked one by one.

    Raises ContentError, which names the element, for anything that is damaged or not honoured.
    """

    def __init__(self) -> None:
        """Begin without nodes."""
        self.indices: dict[str, int] = {}
        self.points: list[tuple[float, float]] = []
        self.yaws: list[float] = []
        self.deviations: list[float] = []
        self.lanes: list[Lane] = []
        self.ignored: set[str] = set()

    def check_fields(self, kind: str, element: Mapping[str, Any]) -> None:
        """Remember the fields of an element that audits do not know."""
        unknown = element.keys() - KNOWN_FIELDS[kind].split()
        self.ignored.update(f"{key} ({kind})" for key in unknown)

    def add_node(self, name: Any, x: Any, y: Any, yaw: Any = None, deviation: float = 0.0) -> None:
        """Add a node at a position, metres."""
        where = f"node {name!r}"
        if str(name) in self.indices:
            raise fail(f"has the {where} twice", "names of nodes must differ")
        self.indices[str(name)] = len(self.points)
        self.points.append((read_number(x, where, "x"), read_number(y, where, "y")))
        self.yaws.append(math.nan if yaw is None else read_number(yaw, where, "theta"))
        self.deviations.append(deviation)

    def index_of(self, name: Any, where: str) -> int:
        """Return the index of the node that an element names."""
        if str(name) not in self.indices:
            raise fail(f"{where} names the node {name!r}", "there is no such node")
        return self.indices[str(name)]

    def add_lane(
        self,
        name: Any,
        start: int,
        end: int,
        heading: HeadingRule,
        legs: tuple[Leg, ...] = (),
        deviation: float = 0.0,
    ) -> None:
        """Add a lane; nodes that a robot may miss widen it."""
        allowed = max(deviation, self.deviations[start], self.deviations[end])
        for leg_end, node in ((legs[0].start, start), (legs[-1].end, end)) if legs else ():
            gap = math.dist(leg_end, self.points[node])
            if gap > MAX_GAP:
                rule = "the trajectory must join the nodes of its edge"
                raise fail(f"edge {name!r} ends {gap:.3g} m from a node", rule)
            allowed = max(allowed, gap)
        self.lanes.append(Lane(str(name), start, end, heading, legs, allowed))

    def build(self, stations: Stations | None = None) -> GraphContents:
        """Return what was added, and name the fields that are ignored."""
        if self.ignored:
            names = ", ".join(sorted(self.ignored))
            warn_user(f"route graph: audits ignore the fields {names}")
        positions = np.array(self.points, dtype=np.float64).reshape(-1, 2)
        yaws = np.array(self.yaws, dtype=np.float64)
        return tuple(self.indices), positions, tuple(self.lanes), yaws, stations or {}


def read_graph(
    path: StrPath, heading: Rule, level: str | None, vehicle: str | None
) -> GraphContents:
    """Read a route graph; see :meth:`cspace.lanes.RouteGraph.open`."""
    suffix = check_suffix(path, SUFFIXES, f"a route graph ends in {', '.join(SUFFIXES)}")
    text = read_text(path, "route graph", memory=30.0)
    with decoding(path, "route graph"):
        is_yaml = suffix in (".yaml", ".yml")
        document = yaml.load(text, yaml.CSafeLoader) if is_yaml else json.loads(text)
        if not isinstance(document, Mapping):
            raise fail("is not a mapping", "a route graph has nodes and edges")
        readers: dict[str, Callable[[], GraphContents]] = {
            "features": lambda: _read_nav2(document, heading),
            "levels": lambda: _read_rmf(document, heading, level),
            "layouts": lambda: _read_lif(document, heading, level, vehicle),
            "nodes": lambda: _read_order(document, heading, level),
        }
        for key, read in readers.items():
            if key in document:
                return read()
        raise fail("has no nodes", f"a route graph has one of {', '.join(readers)}")


def fail(problem: str, rule: str) -> ContentError:
    """Return the error for an element of a file."""
    return ContentError(problem, rule, "correct the element")


def read_number(value: Any, where: str, field: str) -> float:
    """Return a finite number of an element."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value):
        raise fail(f"{where} has the {field} {value!r}", "it must be a finite number")
    return float(value)


def read_list(parent: Mapping[str, Any], key: str, where: str) -> list[Any]:
    """Return a list of an element; a missing one is empty."""
    value = parent.get(key)
    if value is None:
        return []
    if not isinstance(value, list):
        raise fail(f"{where} has {key} that are no list", "it must be a list")
    return value


def iterate_elements(parent: Mapping[str, Any], key: str, where: str) -> Iterator[dict[str, Any]]:
    """Yield the mappings in a list of an element."""
    for number, element in enumerate(read_list(parent, key, where)):
        if not isinstance(element, dict):
            raise fail(f"{where} has {key}[{number}] {element!r:.60}", "it must be a mapping")
        yield element


def need(element: Mapping[str, Any], key: str, where: str) -> Any:
    """Return a field that an element must have."""
    if key not in element:
        raise fail(f"{where} has no {key}", "it must have one")
    return element[key]


def refuse(element: Mapping[str, Any], where: str, **allowed: Iterable[Any]) -> None:
    """Refuse fields whose values are not among the allowed ones."""
    for key, values in allowed.items():
        value = element.get(key)
        if value is not None and value not in values:
            raise fail(f"{where} has {key} {value!r:.60}", "audits do not honour it")


# ---- Nav2 ----------------------------------------------------------------------------------------


def _read_nav2(document: Mapping[str, Any], heading: Rule) -> GraphContents:
    """Read a GeoJSON graph: points are nodes, and lines are edges in one direction.

    The route server drives straight from node to node, whatever line is drawn.
    """
    builder = GraphBuilder()
    crs = json.dumps(document.get("crs", ""))
    if document.get("crs") is not None and not any(name in crs for name in METRIC_CRS):
        raise fail(f"has the crs {crs:.80}", "coordinates must be metres of the map's frame")
    edges = []
    for feature in iterate_elements(document, "features", "the graph"):
        kind = (feature.get("geometry") or {}).get("type")
        number = (feature.get("properties") or {}).get("id")
        if number is None:
            raise fail(f"has a {kind} without an id", "every feature needs one")
        if kind == "Point":
            _add_nav2_node(builder, feature)
        elif kind in ("LineString", "MultiLineString"):
            edges.append(feature)
        else:
            rule = "nodes are Points, edges are MultiLineStrings"
            raise fail(f"feature {number!r} is a {kind}", rule)
    numbers = [str(edge["properties"]["id"]) for edge in edges]
    twice = find_repeated([*builder.indices, *numbers])
    if twice is not None:
        raise fail(f"has the id {twice!r} twice", "ids must differ")
    for edge in edges:
        _add_nav2_edge(builder, edge, heading or HEADINGS["forward"])
    return builder.build()


def _add_nav2_node(builder: GraphBuilder, feature: Mapping[str, Any]) -> None:
    """Add a node of Nav2."""
    properties = feature["properties"]
    where = f"node {properties['id']!r}"
    builder.check_fields("Nav2 node", properties)
    refuse(properties, where, frame=("map", ""))
    place = read_list(feature["geometry"], "coordinates", where)
    if len(place) < 2:
        raise fail(f"{where} has the coordinates {place!r}", "x and y are needed")
    builder.add_node(properties["id"], *place[:2])


def _add_nav2_edge(builder: GraphBuilder, feature: Mapping[str, Any], rule: HeadingRule) -> None:
    """Add an edge of Nav2, which knows its nodes by their ids."""
    properties, geometry = feature["properties"], feature["geometry"]
    number = properties["id"]
    where = f"edge {number!r}"
    builder.check_fields("Nav2 edge", properties)
    start, end = (
        builder.index_of(need(properties, key, where), where) for key in ("startid", "endid")
    )
    lines = read_list(geometry, "coordinates", where)
    if geometry["type"] == "LineString":
        lines = [lines]
    drawn = [point for line in lines for point in line]
    _check_drawn(drawn, builder.points[start], builder.points[end], where)
    builder.add_lane(number, start, end, rule)


def _check_drawn(
    drawn: list[Any], start: tuple[float, float], end: tuple[float, float], where: str
) -> None:
    """Refuse a drawn line that leaves the straight edge between two nodes."""
    first, last = np.array(start), np.array(end)
    chord = last - first
    for place in drawn:
        if not isinstance(place, list) or len(place) < 2:
            raise fail(f"{where} has the coordinates {place!r:.60}", "x and y are needed")
        point = np.array([read_number(value, where, "coordinate") for value in place[:2]])
        share = np.clip((point - first) @ chord / max(float(chord @ chord), 1e-300), 0.0, 1.0)
        if np.hypot(*(point - first - share * chord)) > MAX_GAP:
            rule = "Nav2 drives straight from node to node, so that each corner needs a node"
            raise fail(f"{where} is drawn by way of {point.tolist()}", rule)


# ---- Open-RMF ------------------------------------------------------------------------------------


def _read_rmf(document: Mapping[str, Any], heading: Rule, level: str | None) -> GraphContents:
    """Read the vertices and lanes of one level of an Open-RMF navigation graph."""
    levels = document["levels"]
    if not isinstance(levels, Mapping):
        raise fail("has levels that are no mapping", "each level has a name")
    name, content = _choose(dict(levels), level, "level")
    builder = GraphBuilder()
    where = f"level {name!r}"
    for number, vertex in enumerate(read_list(content, "vertices", where)):
        if not isinstance(vertex, list) or len(vertex) < 2:
            raise fail(f"vertex {number} is {vertex!r:.60}", "it must be [x, y, options]")
        options = vertex[2] if len(vertex) > 2 and isinstance(vertex[2], Mapping) else {}
        builder.check_fields("vertex", options)
        builder.add_node(options.get("name") or number, *vertex[:2])
    for number, lane in enumerate(read_list(content, "lanes", where)):
        _add_rmf_lane(builder, number, lane, heading)
    return builder.build()


def _add_rmf_lane(builder: GraphBuilder, number: int, lane: Any, heading: Rule) -> None:
    """Add a lane ``[start, end, options]`` of Open-RMF."""
    label = f"lane {number}"
    if not isinstance(lane, list) or len(lane) < 2:
        raise fail(f"{label} is {lane!r:.60}", "it must be [start, end, options]")
    last = len(builder.points) - 1
    for node in lane[:2]:
        if type(node) is not int or not 0 <= node <= last:
            raise fail(f"{label} names the vertex {node!r}", f"there are 0 to {last}")
    options = lane[2] if len(lane) > 2 and isinstance(lane[2], Mapping) else {}
    unknown = sorted(map(str, options.keys() - RMF_LANE_OPTIONS))
    if unknown:
        raise fail(f"{label} has the option {unknown[0]!r}", "audits do not know it")
    word = options.get("orientation_constraint") or ""
    refuse(options, label, orientation_constraint=("", *_RMF_WORDS))
    rule = HEADINGS[word] if word else heading or HEADINGS["both"]
    builder.add_lane(number, lane[0], lane[1], rule)
    if options.get("is_bidirectional"):
        builder.lanes.append(builder.lanes[-1].reverse())


_RMF_WORDS: Final = ("forward", "backward")
"""Constraints of lanes in Open-RMF."""


def _choose(choices: dict[str, Any], wanted: str | None, kind: str) -> tuple[str, Any]:
    """Return the level or layout that is wanted, or the only one."""
    listed = ", ".join(map(repr, choices))
    if wanted is None and len(choices) == 1:
        wanted = next(iter(choices))
    if wanted not in choices:
        problem = f"has no {kind} {wanted!r}" if wanted else f"has the {kind}s {listed}"
        raise ContentError(problem, f"there are {listed}", "pass level= with one of them")
    if not isinstance(choices[wanted], Mapping):
        raise fail(f"{kind} {wanted!r} is no mapping", "it has nodes and edges")
    return wanted, choices[wanted]


# ---- LIF and VDA 5050 ----------------------------------------------------------------------------


def _read_lif(
    document: Mapping[str, Any], heading: Rule, level: str | None, vehicle: str | None
) -> GraphContents:
    """Read a layout of LIF, for one type of vehicle."""
    layouts = {
        str(layout.get("layoutId", number)): layout
        for number, layout in enumerate(iterate_elements(document, "layouts", "the file"))
    }
    _, layout = _choose(layouts, level, "layout")
    vehicle = _choose_vehicle(layout, vehicle)
    builder = GraphBuilder()
    for node in iterate_elements(layout, "nodes", "the layout"):
        name = need(node, "nodeId", "a node")
        place = need(node, "nodePosition", f"node {name!r}")
        entries = iterate_elements(node, "vehicleTypeNodeProperties", f"node {name!r}")
        own = [entry for entry in entries if vehicle in _types_of(entry)]
        properties = own[0] if own else {}
        builder.check_fields("node", node)
        builder.check_fields("vehicleTypeNodeProperties", properties)
        _add_place(builder, name, place, properties.get("theta"))
    for edge in iterate_elements(layout, "edges", "the layout"):
        where = f"edge {edge.get('edgeId')!r}"
        own = [e for e in iterate_elements(edge, EDGE_PROPERTIES, where) if vehicle in _types_of(e)]
        if not own and edge.get(EDGE_PROPERTIES):
            continue  # not for this type of vehicle
        entry = own[0] if own else {}
        builder.check_fields(EDGE_PROPERTIES, entry)
        for end in ("rotationAtStartNodeAllowed", "rotationAtEndNodeAllowed"):
            refuse(entry, where, **{end: ("BOTH",)})
        turning = bool(entry.get("rotationAllowed", False))
        _add_edge(builder, edge, entry, entry.get("vehicleOrientation"), turning, heading)
    return builder.build(_read_stations(builder, layout))


def _choose_vehicle(layout: Mapping[str, Any], vehicle: str | None) -> str | None:
    """Return the type of vehicle that is wanted, or the only one of a layout."""
    types = {
        name
        for edge in iterate_elements(layout, "edges", "the layout")
        for entry in iterate_elements(edge, EDGE_PROPERTIES, f"edge {edge.get('edgeId')!r}")
        for name in _types_of(entry)
    }
    listed = ", ".join(map(repr, sorted(types)))
    if (vehicle is None and len(types) > 1) or (vehicle is not None and vehicle not in types):
        problem = f"has vehicles of the types {listed}"
        raise ContentError(problem, "lanes are for one of them", "pass vehicle=")
    return vehicle if vehicle is not None or not types else next(iter(types))


def _read_stations(builder: GraphBuilder, layout: Mapping[str, Any]) -> Stations:
    """Return the nodes of each station."""
    stations = {}
    for station in iterate_elements(layout, "stations", "the layout"):
        name = str(need(station, "stationId", "a station"))
        nodes = read_list(station, "interactionNodeIds", f"station {name!r}")
        for node in nodes:
            builder.index_of(node, f"station {name!r}")
        stations[name] = tuple(map(str, nodes))
    return stations


def _types_of(entry: Mapping[str, Any]) -> list[str]:
    """Return the types of vehicle that properties are for."""
    return [*entry.get("vehicleTypeIds", ()), *filter(None, [entry.get("vehicleTypeId")])]


def _read_order(document: Mapping[str, Any], heading: Rule, level: str | None) -> GraphContents:
    """Read the nodes and edges of a VDA 5050 order, one map of it."""
    builder = GraphBuilder()
    maps = set()
    for node in iterate_elements(document, "nodes", "the order"):
        name = need(node, "nodeId", "a node")
        place = need(node, "nodePosition", f"node {name!r}")
        if str(name) in builder.indices:  # an order may pass a node again
            continue
        builder.check_fields("node", node)
        maps.add(place.get("mapId"))
        if level is not None and place.get("mapId") != level:
            rule = "an order is audited on one map"
            raise fail(f"node {name!r} is on the map {place.get('mapId')!r}", rule)
        _add_place(builder, name, place, place.get("theta"))
    if len(maps) > 1:
        raise fail(f"has nodes on the maps {sorted(map(str, maps))}", "a path stays on one map")
    is_first = str(document.get("version", "2")).startswith("1")
    for edge in iterate_elements(document, "edges", "the order"):
        entry = {"orientationType": "GLOBAL"} | edge if is_first else edge
        turning = edge.get("rotationAllowed") is not False
        _add_edge(builder, edge, entry, edge.get("orientation"), turning, heading)
    return builder.build()


def _add_place(builder: GraphBuilder, name: Any, place: Any, yaw: Any) -> None:
    """Add a node of LIF or VDA 5050."""
    where = f"node {name!r}"
    if not isinstance(place, Mapping):
        raise fail(f"{where} has the nodePosition {place!r:.60}", "it must have x and y")
    builder.check_fields("nodePosition", place)
    if yaw is not None:
        refuse(place, where, allowedDeviationTheta=(0, 0.0))
    deviation = place.get("allowedDeviationXY", place.get("allowedDeviationXy"))
    if isinstance(deviation, Mapping):  # an ellipse
        axes = [read_number(need(deviation, key, where), where, key) for key in ("a", "b")]
        deviation = max(axes)
    metres = 0.0 if deviation is None else read_number(deviation, where, "allowedDeviationXY")
    builder.add_node(name, need(place, "x", where), need(place, "y", where), yaw, max(metres, 0.0))


def _add_edge(
    builder: GraphBuilder,
    edge: Mapping[str, Any],
    entry: Mapping[str, Any],
    orientation: Any,
    turning: bool,
    heading: Rule,
) -> None:
    """Add an edge of LIF or VDA 5050.

    ``entry`` has its orientation and trajectory. A robot that may turn on the edge may have any yaw
    on it.
    """
    name = need(edge, "edgeId", "an edge")
    where = f"edge {name!r}"
    builder.check_fields("edge", edge)
    start, end = (
        builder.index_of(need(edge, key, where), where) for key in ("startNodeId", "endNodeId")
    )
    refuse(entry, where, orientationType=("TANGENTIAL", "GLOBAL"))
    rule = heading or HEADINGS["any"]
    if orientation is not None:
        yaw = read_number(orientation, where, "orientation")
        frame = "map" if entry.get("orientationType") == "GLOBAL" else "lane"
        rule = HEADINGS["any"] if turning else HeadingRule(frame, (yaw,))
    legs: tuple[Leg, ...] = ()
    trajectory = entry.get("trajectory")
    if trajectory is not None:
        legs = _read_trajectory(builder, trajectory, where)
    corridor = entry.get("corridor") or {}
    builder.check_fields("corridor", corridor)
    widths = [
        read_number(corridor.get(key, 0.0), where, key) for key in ("leftWidth", "rightWidth")
    ]
    builder.add_lane(name, start, end, rule, legs, max(widths))


def _read_trajectory(builder: GraphBuilder, trajectory: Any, where: str) -> tuple[Leg, ...]:
    """Read a NURBS curve as legs."""
    if not isinstance(trajectory, Mapping):
        raise fail(f"{where} has a trajectory that is no mapping", "it must be a NURBS curve")
    builder.check_fields("trajectory", trajectory)
    rows = []
    for number, point in enumerate(iterate_elements(trajectory, "controlPoints", where)):
        place = f"{where}, control point {number},"
        builder.check_fields("control point", point)
        refuse(point, place, orientation=())
        coordinates = [read_number(need(point, key, place), place, key) for key in ("x", "y")]
        rows.append((*coordinates, read_number(point.get("weight", 1.0), place, "weight")))
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    knots = [
        read_number(knot, where, "knot") for knot in read_list(trajectory, "knotVector", where)
    ]
    degree = trajectory.get("degree", 1)
    if type(degree) is not int:
        degree = int(read_number(degree, where, "degree"))
    try:
        return cut_nurbs(degree, np.array(knots), table[:, :2], table[:, 2])
    except ValueError as error:
        problem, _, rule = str(error).partition("; ")
        raise fail(f"{where} has a trajectory that {problem}", rule) from error
