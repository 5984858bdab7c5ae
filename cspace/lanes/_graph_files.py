"""Readers of route graphs: Nav2, Open-RMF, LIF and VDA 5050.

A field that changes where a robot drives, or how it stands there, is honoured or refused by name.
A field that is neither that nor known to change nothing is named in a warning.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Collection, Iterator, Mapping
from typing import Any, Final

import numpy as np
import shapely
import yaml

from cspace._files.access import ContentError, check_suffix, decoding, read_text
from cspace._files.fields import Fields
from cspace._support.arrays import Floats, StrPath
from cspace._support.reporting import warn_user
from cspace.lanes._curves import Leg, cut_nurbs
from cspace.lanes._headings import HEADINGS, HeadingRule, Lane

SUFFIXES: Final = (".geojson", ".json", ".yaml", ".yml")
"""Suffixes of route graphs."""

EDGE_PROPERTIES: Final = "vehicleTypeEdgeProperties"
"""Field of a LIF edge with its rules for each type of vehicle."""

MAX_GAP: Final = 0.01
"""Largest distance, metres, of a drawn line or a trajectory from the nodes that it joins."""

METRIC_CRS: Final = ("EPSG::3857", "EPSG:3857")
"""Coordinate systems that Nav2's example graphs name for metres of the map."""

KNOWN_FIELDS: Final = {
    "Nav2 node": "id frame name metadata operations class",
    "Nav2 edge": "id startid endid cost overridable metadata operations name class",
    "vertex": "name is_holding_point is_passthrough_point is_parking_spot is_charger "
    "is_cleaning_zone dock_name merge_radius mutex spawn_robot_name spawn_robot_type "
    "pickup_dispenser dropoff_ingestor human_goal_set_name lift_cabin",
    "lane": "orientation_constraint is_bidirectional speed_limit dock_name undock_name door_name "
    "mutex graph_idx demo_mock_floor_name demo_mock_lift_name",
    "node": "nodeId nodeName nodeDescription nodeDescriptor nodePosition mapId sequenceId released "
    "actions vehicleTypeNodeProperties",
    "nodePosition": "x y theta allowedDeviationXY allowedDeviationXy allowedDeviationTheta mapId "
    "mapDescription",
    "vehicleTypeNodeProperties": "vehicleTypeId vehicleTypeIds theta actions",
    "LIF": "metaInformation layouts",
    "layout": "layoutId layoutName layoutVersion layoutLevelId layoutDescription nodes edges "
    "stations",
    "station": "stationId interactionNodeIds stationName stationDescription stationHeight "
    "stationPosition",
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

FIELDS: Final = (
    Fields(
        "route graphs of Nav2, `.geojson`",
        honoured="`id`, `startid`, `endid`; coordinates of nodes",
        refused="`crs` other than metres of the map; `frame` other than `map`; drawn corners",
        warned="unknown fields",
    ),
    Fields(
        "Open-RMF navigation graphs, `.yaml`",
        honoured="`levels`; `orientation_constraint`; `is_bidirectional`",
        refused="several levels without `level=`; other constraints",
        warned="unknown options",
    ),
    Fields(
        "LIF layouts and VDA 5050 orders, `.json`",
        honoured="`theta`; `orientationType`, `orientation`, `vehicleOrientation`; "
        "`rotationAllowed`; `trajectory`; `corridor`; `allowedDeviationXY`; types of vehicles",
        refused="`origins`; `rotationAtStartNodeAllowed`, `rotationAtEndNodeAllowed` other than "
        "`BOTH`; `allowedDeviationTheta` at a node with `theta`; `orientation` of control points",
        warned="unknown fields, such as `loadRestriction`",
    ),
)
"""Fields that change where a robot drives, or how it stands there."""

Stations = Mapping[str, tuple[str, ...]]
"""Nodes of each station."""

GraphContents = tuple[tuple[str, ...], Floats, tuple[Lane, ...], Floats, Stations]
"""Attributes of a route graph, in their order."""


class Element:
    """A mapping of a file, with its name for messages.

    The fields that audits do not know are collected for all elements of a file.
    """

    def __init__(
        self, fields: Any, where: str, kind: str = "", ignored: set[str] | None = None
    ) -> None:
        """Check that it is a mapping; its ``kind`` is one of the known, or none."""
        self.where = where
        self.ignored = set() if ignored is None else ignored
        if not isinstance(fields, Mapping):
            raise self.fail(f"is {fields!r:.60}", "it must be a mapping")
        self.fields = fields
        if kind:
            unknown = fields.keys() - KNOWN_FIELDS[kind].split()
            self.ignored.update(f"{key} ({kind})" for key in unknown)

    def fail(self, problem: str, rule: str, hint: str = "correct the element") -> ContentError:
        """Return an error that names the element."""
        return ContentError(f"{self.where} {problem}", rule, hint)

    def get(self, key: str, otherwise: Any = None) -> Any:
        """Return a field; one that is null is missing."""
        value = self.fields.get(key)
        return otherwise if value is None else value

    def need(self, key: str) -> Any:
        """Return a field that the element must have."""
        value = self.get(key)
        if value is None:
            raise self.fail(f"has no {key}", "it must have one")
        return value

    def number(self, key: str, otherwise: float | None = None) -> float:
        """Return a finite number."""
        value = self.need(key) if otherwise is None else self.get(key, otherwise)
        return self.check_number(key, value)

    def check_number(self, name: str, value: Any) -> float:
        """Return a value if it is a finite number."""
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value):
            raise self.fail(f"has the {name} {value!r:.60}", "it must be a finite number")
        return float(value)

    def point(self, value: Any) -> tuple[float, float]:
        """Return the first two of a list of coordinates."""
        if not isinstance(value, list) or len(value) < 2:
            raise self.fail(f"has the coordinates {value!r:.60}", "x and y are needed")
        return self.check_number("x", value[0]), self.check_number("y", value[1])

    def entries(self, key: str) -> list[Any]:
        """Return a list; a missing one is empty."""
        value = self.get(key, [])
        if not isinstance(value, list):
            raise self.fail(f"has the {key} {value!r:.60}", "it must be a list")
        return value

    def child(self, key: str, kind: str = "") -> Element:
        """Return the mapping in a field."""
        return Element(self.need(key), f"{self.where}, {key}", kind, self.ignored)

    def children(self, key: str, kind: str = "", name: str = "") -> Iterator[Element]:
        """Yield the mappings in a list, by their names if they have any."""
        for number, fields in enumerate(self.entries(key)):
            child = Element(fields, f"{self.where}, {key}[{number}]", kind, self.ignored)
            if name:
                child.where = f"{kind} {child.need(name)!r}"
            yield child

    def refuse(self, key: str, *allowed: Any) -> None:
        """Refuse a field whose value is not among the allowed ones."""
        value = self.get(key)
        if value is not None and value not in allowed:
            raise self.fail(f"has {key} {value!r:.60}", "audits do not honour it")


class GraphBuilder:
    """Nodes and lanes of a file, checked one by one.

    ``heading`` is the rule of lanes for which the file gives none.
    """

    def __init__(self, heading: HeadingRule | None, otherwise: str) -> None:
        """Begin without nodes; ``otherwise`` is the heading of the format."""
        self.heading = heading or HEADINGS[otherwise]
        self.indices: dict[str, int] = {}
        self.points: list[tuple[float, float]] = []
        self.yaws: list[float] = []
        self.deviations: list[float] = []
        self.lanes: list[Lane] = []

    def add_node(
        self,
        element: Element,
        name: Any,
        point: tuple[float, float],
        yaw: float = math.nan,
        deviation: float = 0.0,
    ) -> None:
        """Add a node at a position, metres, that a robot may miss by ``deviation``."""
        if str(name) in self.indices:
            raise element.fail("is there twice", f"the name {name!r} of a node must differ")
        self.indices[str(name)] = len(self.points)
        self.points.append(point)
        self.yaws.append(yaw)
        self.deviations.append(deviation)

    def find(self, element: Element, name: Any) -> int:
        """Return the index of the node that an element names."""
        if str(name) not in self.indices:
            raise element.fail(f"names the node {name!r}", "there is no such node")
        return self.indices[str(name)]

    def add_lane(
        self,
        element: Element,
        name: Any,
        ends: list[int],
        heading: HeadingRule | None = None,
        legs: tuple[Leg, ...] = (),
        deviation: float = 0.0,
    ) -> None:
        """Add a lane; nodes that a robot may miss widen it."""
        gaps = [0.0]
        if legs:
            pairs = zip((legs[0].start, legs[-1].end), ends, strict=True)
            gaps = [math.dist(end, self.points[node]) for end, node in pairs]
        if max(gaps) > MAX_GAP:
            rule = "the trajectory must join the nodes of its edge"
            raise element.fail(f"ends {max(gaps):.3g} m from a node", rule)
        deviation = max(deviation, *gaps, *(self.deviations[node] for node in ends))
        start, end = ends
        lane = Lane(str(name), start, end, heading or self.heading, legs, deviation)
        self.lanes.append(lane)

    def build(self, stations: Stations | None = None) -> GraphContents:
        """Return what was added."""
        positions = np.array(self.points, dtype=np.float64).reshape(-1, 2)
        yaws = np.array(self.yaws, dtype=np.float64)
        return tuple(self.indices), positions, tuple(self.lanes), yaws, stations or {}


def read_graph(
    path: StrPath, heading: HeadingRule | None, level: str | None, vehicle: str | None
) -> GraphContents:
    """Read a route graph; see :meth:`cspace.lanes.RouteGraph.open`."""
    suffix = check_suffix(path, SUFFIXES, f"a route graph ends in {', '.join(SUFFIXES)}")
    text = read_text(path, "route graph", memory=30.0)
    with decoding(path, "route graph"):
        is_yaml = suffix in (".yaml", ".yml")
        loaded = yaml.load(text, yaml.CSafeLoader) if is_yaml else json.loads(text)
        document = Element(loaded, "the graph")
        if "features" in document.fields:
            contents = _read_nav2(document, heading)
        elif "levels" in document.fields:
            contents = _read_rmf(document, heading, level)
        elif "layouts" in document.fields:
            contents = _read_lif(document, heading, level, vehicle)
        elif "nodes" in document.fields:
            contents = _read_order(document, heading, level)
        else:
            rule = "a route graph has one of features, levels, layouts, nodes"
            raise document.fail("has no nodes", rule)
    if document.ignored:
        names = ", ".join(sorted(document.ignored))
        warn_user(f"route graph: audits ignore the fields {names}")
    return contents


# ---- Nav2 ----------------------------------------------------------------------------------------


def _read_nav2(document: Element, heading: HeadingRule | None) -> GraphContents:
    """Read a GeoJSON graph: points are nodes, and lines are edges in one direction.

    The route server drives straight from node to node, whatever line is drawn.
    """
    builder = GraphBuilder(heading, "forward")
    crs = json.dumps(document.get("crs", METRIC_CRS))
    if not any(name in crs for name in METRIC_CRS):
        raise document.fail(
            f"has the crs {crs:.80}", "coordinates must be metres of the map's frame"
        )
    edges: dict[str, tuple[Element, list[Any]]] = {}
    for feature in document.children("features"):
        geometry, properties = feature.child("geometry"), feature.child("properties")
        number, coordinates = properties.need("id"), geometry.entries("coordinates")
        kind = geometry.get("type")
        if kind == "Point":
            where = f"node {number!r}"
            node = Element(properties.fields, where, "Nav2 node", document.ignored)
            node.refuse("frame", "map", "")
            builder.add_node(node, number, node.point(coordinates))
        elif kind in ("LineString", "MultiLineString"):
            where = f"edge {number!r}"
            edge = Element(properties.fields, where, "Nav2 edge", document.ignored)
            if str(number) in edges:
                raise edge.fail("is there twice", "ids must differ")
            edges[str(number)] = edge, [coordinates] if kind == "LineString" else coordinates
        else:
            rule = "nodes are Points, edges are MultiLineStrings"
            raise feature.fail(f"with the id {number!r} is a {kind}", rule)
    for name, (edge, lines) in edges.items():
        _add_nav2_edge(builder, edge, name, lines)
    return builder.build()


def _add_nav2_edge(builder: GraphBuilder, edge: Element, name: str, lines: list[Any]) -> None:
    """Add an edge of Nav2, unless it is drawn with a corner."""
    if name in builder.indices:
        raise edge.fail("has the id of a node", "ids must differ")
    ends = [builder.find(edge, edge.need(key)) for key in ("startid", "endid")]
    chord = shapely.LineString([builder.points[node] for node in ends])
    for place in itertools.chain.from_iterable(lines):
        point = edge.point(place)
        if shapely.distance(chord, shapely.Point(point)) > MAX_GAP:
            rule = "Nav2 drives straight from node to node, so that each corner needs a node"
            raise edge.fail(f"is drawn by way of {list(point)}", rule)
    builder.add_lane(edge, name, ends)


# ---- Open-RMF ------------------------------------------------------------------------------------


def _read_rmf(document: Element, heading: HeadingRule | None, level: str | None) -> GraphContents:
    """Read the vertices and lanes of one level of an Open-RMF navigation graph."""
    levels = document.child("levels")
    name = _choose(document, list(levels.fields), level, "level")
    content = Element(levels.fields[name], f"level {name!r}", ignored=document.ignored)
    builder = GraphBuilder(heading, "both")
    for number, vertex in enumerate(content.entries("vertices")):
        options = _read_options(content, vertex, "vertex", number)
        builder.add_node(options, options.get("name") or number, options.point(vertex))
    for number, lane in enumerate(content.entries("lanes")):
        options = _read_options(content, lane, "lane", number)
        known = range(len(builder.points))
        ends = lane[:2] if isinstance(lane, list) else []
        if len(ends) < 2 or not all(type(node) is int and node in known for node in ends):
            rule = f"it must be [start, end, options], of vertices 0 to {len(known) - 1}"
            raise options.fail(f"is {lane!r:.60}", rule)
        options.refuse("orientation_constraint", "", "forward", "backward")
        word = options.get("orientation_constraint")
        builder.add_lane(options, number, ends, HEADINGS[word] if word else None)
        if options.get("is_bidirectional"):
            builder.lanes.append(builder.lanes[-1].reverse())
    return builder.build()


def _read_options(level: Element, entry: Any, kind: str, number: int) -> Element:
    """Return the options at the end of a vertex or lane of Open-RMF."""
    has_options = isinstance(entry, list) and len(entry) > 2 and entry[2] is not None
    return Element(entry[2] if has_options else {}, f"{kind} {number}", kind, level.ignored)


def _choose(element: Element, choices: Collection[str], wanted: str | None, kind: str) -> str:
    """Return the level, layout or type that is wanted, or the only one."""
    if wanted is None and len(choices) == 1:
        wanted = next(iter(choices))
    if wanted is None or wanted not in choices:
        listed = ", ".join(map(repr, choices))
        rule = f"the choice is {wanted!r}" if wanted else "one of them must be chosen"
        option = "vehicle" if kind == "vehicle" else "level"
        raise element.fail(f"has the {kind}s {listed}", rule, f"pass {option}= with one of them")
    return wanted


# ---- LIF and VDA 5050 ----------------------------------------------------------------------------


def _read_lif(
    document: Element, heading: HeadingRule | None, level: str | None, vehicle: str | None
) -> GraphContents:
    """Read a layout of LIF, for one type of vehicle."""
    document = Element(document.fields, document.where, "LIF", document.ignored)
    layouts = {
        str(layout.get("layoutId", number)): layout
        for number, layout in enumerate(document.children("layouts"))
    }
    fields = layouts[_choose(document, layouts, level, "layout")].fields
    layout = Element(fields, "the layout", "layout", document.ignored)
    for element in (document, layout):
        element.refuse("origins", [])  # places of other frames
    edges = [
        (edge, list(edge.children(EDGE_PROPERTIES)))
        for edge in layout.children("edges", "edge", "edgeId")
    ]
    types = {name for _, entries in edges for entry in entries for name in _types_of(entry) if name}
    if types or vehicle:
        vehicle = _choose(layout, sorted(types), vehicle, "vehicle")
    builder = GraphBuilder(heading, "any")
    for node in layout.children("nodes", "node", "nodeId"):
        entry = _own_entry(node, "vehicleTypeNodeProperties", vehicle)
        _add_place(builder, node, entry or node)
    for edge, entries in edges:
        entry = _own_entry(edge, EDGE_PROPERTIES, vehicle)
        if entries and entry is None:
            continue  # not for this type of vehicle
        entry = entry or edge
        entry.refuse("rotationAtStartNodeAllowed", "BOTH")
        entry.refuse("rotationAtEndNodeAllowed", "BOTH")
        _add_edge(builder, edge, entry, "vehicleOrientation", bool(entry.get("rotationAllowed")))
    return builder.build(_read_stations(builder, layout))


def _read_stations(builder: GraphBuilder, layout: Element) -> Stations:
    """Return the nodes of each station."""
    stations = {}
    for station in layout.children("stations", "station", "stationId"):
        nodes = station.entries("interactionNodeIds")
        for name in nodes:
            builder.find(station, name)
        stations[str(station.need("stationId"))] = tuple(map(str, nodes))
    return stations


def _types_of(entry: Element) -> list[str | None]:
    """Return the types of vehicle that properties are for; None if they do not say."""
    return [*entry.entries("vehicleTypeIds"), entry.get("vehicleTypeId")]


def _own_entry(element: Element, key: str, vehicle: str | None) -> Element | None:
    """Return the first properties for a type of vehicle."""
    for number, entry in enumerate(element.children(key)):
        if vehicle in _types_of(entry):
            where = f"{element.where}, {key}[{number}]"
            return Element(entry.fields, where, key, element.ignored)
    return None


def _read_order(document: Element, heading: HeadingRule | None, level: str | None) -> GraphContents:
    """Read the nodes and edges of a VDA 5050 order, one map of it."""
    builder = GraphBuilder(heading, "any")
    maps = set()
    places: dict[str, Any] = {}
    for node in document.children("nodes", "node", "nodeId"):
        place = node.child("nodePosition")
        name = str(node.need("nodeId"))
        if name in places:  # an order may pass a node again
            if places[name] != place.fields:
                raise node.fail("has two positions", "an audit has one for each node")
            continue
        places[name] = place.fields
        maps.add(str(place.get("mapId")))
        _add_place(builder, node, place)
    if len(maps) > 1 or (level is not None and maps - {level}):
        raise document.fail(
            f"has nodes on the maps {sorted(maps)}", "an order is audited on one map"
        )
    default = "GLOBAL" if str(document.get("version", "2")).startswith("1") else "TANGENTIAL"
    for edge in document.children("edges", "edge", "edgeId"):
        turning = edge.get("rotationAllowed") is not False
        _add_edge(builder, edge, edge, "orientation", turning, default)
    return builder.build()


def _add_place(builder: GraphBuilder, node: Element, entry: Element) -> None:
    """Add a node of LIF or VDA 5050, with the yaw of an entry."""
    place = node.child("nodePosition", "nodePosition")
    yaw = math.nan
    if entry.get("theta") is not None:
        yaw = entry.number("theta")
        place.refuse("allowedDeviationTheta", 0)
    deviation = place.get("allowedDeviationXY", place.get("allowedDeviationXy", 0.0))
    if isinstance(deviation, Mapping):  # an ellipse
        ellipse = Element(deviation, f"{place.where}, allowedDeviationXY")
        deviation = max(ellipse.number("a"), ellipse.number("b"))
    deviation = place.check_number("allowedDeviationXY", deviation)
    point = place.number("x"), place.number("y")
    builder.add_node(node, node.need("nodeId"), point, yaw, max(deviation, 0.0))


def _add_edge(
    builder: GraphBuilder,
    edge: Element,
    entry: Element,
    key: str,
    turning: bool,
    default: str = "TANGENTIAL",
) -> None:
    """Add an edge of LIF or VDA 5050.

    ``entry`` has its orientation, by a ``key``, and its trajectory. A robot that may turn on the
    edge may have any yaw on it.
    """
    ends = [builder.find(edge, edge.need(end)) for end in ("startNodeId", "endNodeId")]
    entry.refuse("orientationType", "TANGENTIAL", "GLOBAL")
    rule = None
    if entry.get(key) is not None:
        frame = "map" if entry.get("orientationType", default) == "GLOBAL" else "lane"
        rule = HeadingRule(frame, (entry.number(key),))
        rule = HEADINGS["any"] if turning else rule
    legs: tuple[Leg, ...] = ()
    if entry.get("trajectory") is not None:
        legs = _read_trajectory(entry.child("trajectory", "trajectory"))
    widths = [0.0]
    if entry.get("corridor"):
        corridor = entry.child("corridor", "corridor")
        widths = [corridor.number(side, 0.0) for side in ("leftWidth", "rightWidth")]
    builder.add_lane(edge, edge.need("edgeId"), ends, rule, legs, max(widths))


def _read_trajectory(trajectory: Element) -> tuple[Leg, ...]:
    """Read a NURBS curve as legs."""
    rows = []
    for point in trajectory.children("controlPoints", "control point"):
        point.refuse("orientation")
        rows.append((point.number("x"), point.number("y"), point.number("weight", 1.0)))
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    knots = [trajectory.check_number("knot", knot) for knot in trajectory.entries("knotVector")]
    degree = int(trajectory.number("degree", 1))
    try:
        return cut_nurbs(degree, np.array(knots), table[:, :2], table[:, 2])
    except ValueError as error:
        problem, _, rule = str(error).partition("; ")
        raise trajectory.fail(problem, rule) from error
