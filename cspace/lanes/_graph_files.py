"""Readers of route graphs: Nav2, Open-RMF, LIF and VDA 5050.

A field that changes where a robot drives, or how it stands there, is honoured or refused by name.
A field that is neither that nor known to change nothing is named in a warning.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
import shapely

from cspace.inside import (
    ContentError,
    Fields,
    Ledger,
    StrPath,
    check_point,
    check_suffix,
    decoding,
    read_document,
    warn_user,
)
from cspace.lanes._curves import Leg, clamp_knots, cut_nurbs
from cspace.lanes._headings import HEADINGS, HeadingRule, Lane, parse_heading, reverse_lane

SUFFIXES: Final = (".geojson", ".json", ".yaml", ".yml")
"""Suffixes of route graphs."""

MAX_GAP: Final = 0.01
"""Largest distance, metres, of a drawn line or a trajectory from the nodes that it joins."""

ANY_YAW: Final = math.pi * (1.0 - 1e-6)
"""Deviation of a yaw, radians, from which on it may be any; files round pi."""

METRIC_CRS: Final = ("EPSG::3857", "EPSG:3857")
"""Coordinate systems that Nav2's example graphs name for metres of the map."""

FIELDS: Final = (
    Fields(
        "route graphs of Nav2, `.geojson`",
        honoured="`features`, `properties`, `geometry`; `type`; `id`, `startid`, `endid`; "
        "`coordinates` of nodes",
        refused="`crs` other than metres of the map; `frame` other than `map`",
        warned="edges drawn elsewhere than from node to node; equal `id`; unknown fields",
        harmless="name metadata operations class cost overridable description bbox date_generated",
    ),
    Fields(
        "Open-RMF navigation graphs, `.yaml`",
        honoured="`levels`, `vertices`, `lanes`; `name`; `orientation_constraint`; "
        "`is_bidirectional`; `mutex`",
        refused="several levels without `level=`; other constraints; `crs_name` in degrees",
        warned="other `crs_name`; unknown options",
        harmless="building_name lifts doors fiducials elevation is_holding_point "
        "is_passthrough_point is_parking_spot is_charger is_cleaning_zone dock_name merge_radius "
        "spawn_robot_name spawn_robot_type pickup_dispenser dropoff_ingestor "
        "human_goal_set_name lift_cabin speed_limit undock_name door_name graph_idx "
        "demo_mock_floor_name demo_mock_lift_name",
    ),
    Fields(
        "LIF layouts and VDA 5050 orders, `.json`",
        honoured="`layouts`, `nodes`, `edges`, `stations`; `layoutId`, `nodeId`, `edgeId`, "
        "`stationId`; `nodePosition`, `x`, "
        "`y`, `theta`; `allowedDeviationXY`, `allowedDeviationXy`, `allowedDeviationTheta`; "
        "`orientationType`, "
        "`orientation`, `vehicleOrientation`; `rotationAllowed`, "
        "`reachOrientationBeforeEntering`; `trajectory`, `degree`, "
        "`knotVector`, `controlPoints`, `weight`; ellipses of `a` and `b`; `corridor`, "
        "`leftWidth`, `rightWidth`; "
        "`vehicleTypeNodeProperties`, `vehicleTypeEdgeProperties`, `vehicleTypeId`, "
        "`vehicleTypeIds`; `startNodeId`, `endNodeId`, `sequenceId`; "
        "`interactionNodeIds`; `version`",
        refused="several `mapId`; `origins`; `mobileRobotTypeNodeProperties`, "
        "`mobileRobotTypeEdgeProperties`; "
        "`orientation` of control points; curves that jump",
        warned="`rotationAtStartNodeAllowed`, `rotationAtEndNodeAllowed` of `CW` and `CCW`; "
        "angles beyond a whole turn; unknown fields, such as `loadRestriction`; "
        "`maxHeight`, `minHeight`, `maximumMobileRobotHeight`, `minimumLoadHandlingDeviceHeight`; "
        "fields of `metaInformation` beside LIF's",
        harmless="projectIdentification creator exportTimestamp lifVersion headerId timestamp "
        "manufacturer serialNumber orderId orderDescription orderUpdateId zoneSetId layoutName "
        "layoutVersion layoutLevelId layoutDescription nodeName nodeDescription nodeDescriptor "
        "sequenceId released actions mapDescription stationName stationDescription stationHeight "
        "stationPosition edgeName edgeDescription edgeDescriptor length direction maxSpeed "
        "maximumSpeed maxRotationSpeed maximumRotationSpeed reentryAllowed corridorRefPoint "
        "corridorReferencePoint releaseRequired releaseLossBehavior",
    ),
    Fields(
        "graphs of networkx",
        honoured="`pos`, or `x` and `y`; `yaw`; `heading`",
        refused="`geometry` of edges; `crs` in degrees",
        warned="other `crs`; other attributes",
        harmless="name label id key color colour weight length cost distance osmid highway "
        "street_count ref speed_limit created_with created_date simplified",
    ),
)
"""Fields that change where a robot drives, or how it stands there."""

Stations = Mapping[str, tuple[str, ...]]
"""Nodes of each station."""

GraphContents = dict[str, Any]
"""Attributes of a route graph."""


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
        self.yaw_deviations: dict[str, float] = {}
        self.lanes: list[Lane] = []
        self.mutexes: dict[str, str] = {}

    def add_node(
        self,
        element: Ledger,
        name: Any,
        point: tuple[float, float],
        yaw: float = math.nan,
        deviation: float = 0.0,
        mutex: str = "",
    ) -> None:
        """Add a node, metres, that a robot may miss by ``deviation``."""
        if str(name) in self.indices:
            raise element.fail("is there twice", f"the name {name!r} of a node must differ")
        self.indices[str(name)] = len(self.points)
        self.points.append(point)
        self.yaws.append(yaw)
        self.deviations.append(deviation)
        if mutex:
            self.mutexes[str(name)] = mutex

    def find(self, element: Ledger, name: Any) -> int:
        """Return the node's index that an element names."""
        if str(name) not in self.indices:
            raise element.fail(f"names the node {name!r}", "there is no such node")
        return self.indices[str(name)]

    def add_lane(
        self,
        element: Ledger,
        name: Any,
        ends: list[int],
        heading: HeadingRule | None = None,
        legs: tuple[Leg, ...] = (),
        deviation: float = 0.0,
        mutex: str = "",
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
        lane = Lane(str(name), start, end, heading or self.heading, legs, deviation, mutex)
        self.lanes.append(lane)

    def build(self, stations: Stations | None = None) -> GraphContents:
        """Return what was added."""
        return {
            "names": tuple(self.indices),
            "positions": np.array(self.points, dtype=np.float64).reshape(-1, 2),
            "lanes": tuple(self.lanes),
            "yaws": np.array(self.yaws, dtype=np.float64),
            "stations": stations or {},
            "node_mutexes": self.mutexes,
            "yaw_deviations": self.yaw_deviations,
        }


def read_graph(
    path: StrPath, heading: HeadingRule | None, level: str | None, vehicle: str | None
) -> GraphContents:
    """Read a route graph; see :meth:`cspace.lanes.RouteGraph.open`."""
    check_suffix(path, SUFFIXES, "the suffix selects the format")
    loaded = read_document(path, "route graph")
    with decoding(path, "route graph"):
        found = loaded if isinstance(loaded, Mapping) else {}
        key = next((key for key in _GRAPHS if key in found), "features")
        formats, read_format = _GRAPHS[key]
        document = Ledger(loaded, "the graph", formats)
        if key not in found:
            rule = f"a route graph has one of {', '.join(_GRAPHS)}; LIF is read up to version 1"
            raise document.fail("has no nodes", rule)
        if key == "levels" and "name" in found:
            raise document.fail("is a building", "a navigation graph is needed", document.hint)
        contents = read_format(document, heading, level, vehicle)
    document.close(os.fspath(path))
    return contents


# ---- Nav2 ----------------------------------------------------------------------------------------


def _read_nav2(
    document: Ledger, heading: HeadingRule | None, level: str | None, vehicle: str | None
) -> GraphContents:
    """Read a GeoJSON graph of points and directed lines.

    The route server drives straight from node to node, whatever line is drawn.
    """
    builder = GraphBuilder(heading, "forward")
    document.refuse("type", "FeatureCollection")
    crs = json.dumps(document.get("crs", METRIC_CRS))
    if not any(name in crs for name in METRIC_CRS):
        raise document.fail(
            f"has the crs {crs:.80}", "coordinates must be metres of the map's frame"
        )
    edges: list[tuple[Ledger, list[Any]]] = []
    for feature in document.children("features", "feature"):
        feature.refuse("type", "Feature")
        feature.get("id")
        geometry, properties = feature.child("geometry"), feature.child("properties")
        number, coordinates = properties.need("id"), geometry.entries("coordinates")
        kind = geometry.get("type")
        if kind == "Point":
            properties.where, properties.kind = f"node {number!r}", "Nav2 node"
            properties.refuse("frame", "map", "")
            builder.add_node(properties, number, properties.point(coordinates))
        elif kind in ("LineString", "MultiLineString"):
            properties.where, properties.kind = f"edge {number!r}", "Nav2 edge"
            edges.append((properties, list(_list_places(coordinates))))
        else:
            rule = "nodes are Points, edges are MultiLineStrings"
            raise feature.fail(f"with the id {number!r} is a {kind}", rule)
    known = set(builder.indices)
    repeated, misdrawn = [], []
    for edge, places in edges:
        name, first, last = (edge.need(key) for key in ("id", "startid", "endid"))
        ends = [builder.find(edge, node) for node in (first, last)]
        builder.add_lane(edge, name, ends)
        listed = f"{name} ({first} to {last})"
        repeated += [listed] * (str(name) in known)
        known.add(str(name))
        chord = shapely.LineString([builder.points[node] for node in ends])
        drawn = shapely.MultiPoint([edge.point(place) for place in places])
        misdrawn += [listed] * bool(shapely.hausdorff_distance(chord, drawn) > MAX_GAP)
    _warn_of("edges have the id of an earlier element and are read, as by Nav2", repeated)
    rule = (
        "edges are drawn elsewhere than straight from node to node, as Nav2 drives and is audited"
    )
    _warn_of(rule, misdrawn)
    return builder.build()


def _list_places(coordinates: Any) -> Iterator[Any]:
    """Yield the points of a line, or of several, as files have both under either name."""
    if isinstance(coordinates, list) and all(isinstance(part, list) for part in coordinates):
        for part in coordinates:
            yield from _list_places(part)
    else:
        yield coordinates


def _warn_of(rule: str, names: Sequence[str]) -> None:
    """Warn of elements, and name the first ten."""
    if names:
        listed = ", ".join(names[:10]) + ", ..." * (len(names) > 10)
        warn_user(f"{len(names)} {rule}: {listed}")


# ---- Open-RMF ------------------------------------------------------------------------------------


def _read_rmf(
    document: Ledger, heading: HeadingRule | None, level: str | None, vehicle: str | None
) -> GraphContents:
    """Read one level of an Open-RMF navigation graph."""
    document.crs("crs_name")
    levels = document.child("levels")
    levels.skip()
    name = _choose(document, list(levels.fields), level, "level")
    content = document.inner(levels.fields[name], f"level {name!r}", "level")
    builder = GraphBuilder(heading, "both")
    for number, vertex in enumerate(content.entries("vertices")):
        options = _read_options(content, vertex, "vertex", number)
        builder.add_node(
            options,
            options.get("name") or number,
            options.point(vertex),
            mutex=_read_mutex(options),
        )
    for number, lane in enumerate(content.entries("lanes")):
        options = _read_options(content, lane, "lane", number)
        known = range(len(builder.points))
        ends = lane[:2] if isinstance(lane, list) else []
        if len(ends) < 2 or not all(type(node) is int and node in known for node in ends):
            rule = f"it must be [start, end, options], of vertices 0 to {len(known) - 1}"
            raise options.fail(f"is {lane!r:.60}", rule)
        options.refuse("orientation_constraint", "", "forward", "backward")
        word = options.get("orientation_constraint")
        allowed = HEADINGS[word] if word else None
        builder.add_lane(options, number, ends, allowed, mutex=_read_mutex(options))
        if options.flag("is_bidirectional"):
            builder.lanes.append(reverse_lane(builder.lanes[-1]))
    return builder.build()


def _read_mutex(options: Ledger) -> str:
    """Return the mutex group of a vertex or lane, or ""."""
    value = options.get("mutex", "")
    if isinstance(value, str | int | float) and not isinstance(value, bool):
        return str(value)
    raise options.fail(f"has the mutex {value!r:.60}", "it must be the name of a group")


def _read_options(level: Ledger, entry: Any, kind: str, number: int) -> Ledger:
    """Return the options of an Open-RMF vertex or lane."""
    has_options = isinstance(entry, list) and len(entry) > 2 and entry[2] is not None
    if has_options and not isinstance(entry[2], Mapping):
        problem = f"has the {kind} {number} {entry!r:.60}"
        rule = "the third entry of a navigation graph holds options"
        raise ContentError(problem, rule)
    return level.inner(entry[2] if has_options else {}, f"{kind} {number}", kind)


def _choose(element: Ledger, choices: Collection[str], wanted: str | None, kind: str) -> str:
    """Return the wanted level, layout or type, or the only one."""
    if wanted is None and len(choices) == 1:
        wanted = next(iter(choices))
    if wanted is None or wanted not in choices:
        listed = ", ".join(map(repr, choices))
        rule = f"the choice is {wanted!r}" if wanted else "one of them must be chosen"
        option = "vehicle" if kind == "vehicle" else "level"
        hint = f"pass e.g. {option}={next(iter(choices))!r}" if choices else ""
        raise element.fail(f"has the {kind}s {listed}", rule, hint)
    return wanted


# ---- LIF and VDA 5050 ----------------------------------------------------------------------------


def _read_lif(
    document: Ledger, heading: HeadingRule | None, level: str | None, vehicle: str | None
) -> GraphContents:
    """Read a LIF layout for a type of vehicle."""
    document.child("metaInformation", otherwise={})
    layout, others = _choose_layout(document, level)
    for element in (document, layout):
        element.refuse("origins", [])  # places of other frames
    nodes, edges = _list_parts(layout, "Node"), _list_parts(layout, "Edge")
    rules = [entry for _, entries in (*nodes, *edges) for entry in entries]
    types = {name for entry in rules for name in _types_of(entry) if name}
    if types or vehicle:
        vehicle = _choose(layout, sorted(types), vehicle, "vehicle")
    builder = GraphBuilder(heading, "any")
    maps = set()
    for node, entries in nodes:
        entry = _own_entry(entries, vehicle)
        maps.add(str(node.get("mapId")))
        _add_place(builder, node, entry or node)
    _check_map(layout, maps, None)
    leaving = _list_leaving(layout, others)
    for edge, entries in edges:
        if edge.where in leaving:
            for part in (edge, *entries):
                part.skip()
        else:
            _add_lif_edge(builder, edge, entries, vehicle)
    return builder.build(_read_stations(builder, layout, leaving))


def _list_parts(layout: Ledger, kind: str) -> list[tuple[Ledger, list[Ledger]]]:
    """Return a LIF layout's nodes or edges, each with its rules for types of vehicles."""
    name = kind.lower()
    parts = []
    for part in layout.children(f"{name}s", name, f"{name}Id"):
        part.refuse(f"mobileRobotType{kind}Properties")  # of a draft
        parts.append((part, list(part.children(f"vehicleType{kind}Properties"))))
    return parts


def _add_lif_edge(
    builder: GraphBuilder, edge: Ledger, entries: list[Ledger], vehicle: str | None
) -> None:
    """Add an edge of LIF, if it is for a type of vehicle."""
    entry = _own_entry(entries, vehicle)
    if entries and entry is None:
        edge.skip()
        return
    entry = entry or edge
    turns = []
    for key in ("rotationAtStartNodeAllowed", "rotationAtEndNodeAllowed"):
        entry.refuse(key, "BOTH", "NONE", "CW", "CCW")
        turn = entry.get(key)
        if turn in ("CW", "CCW"):
            warn_user(f"{entry.where} has {key} {turn!r}; turns both ways count as allowed")
        turns.append(turn != "NONE")
    _add_edge(builder, edge, entry, _read_ends(edge), "vehicleOrientation", _may_turn(entry, False))
    builder.lanes[-1] = builder.lanes[-1]._replace(turns=tuple(turns))


def _choose_layout(document: Ledger, level: str | None) -> tuple[Ledger, dict[str, Ledger]]:
    """Return the chosen layout of LIF, or the only one, and the others."""
    layouts = {
        str(layout.get("layoutId", number)): layout
        for number, layout in enumerate(document.children("layouts", "layout"))
    }
    layout = layouts.pop(_choose(document, layouts, level, "layout"))
    layout.where = "the layout"
    for other in layouts.values():
        other.skip()
    return layout, layouts


def _list_leaving(layout: Ledger, others: Mapping[str, Ledger]) -> set[str]:
    """Name a layout's edges and stations at nodes of others, and warn.

    Edges and stations of others at nodes of the layout are warned of, too.
    """
    own = _list_nodes(layout)
    leaving: dict[str, str] = {}
    arriving = []
    for name, other in others.items():
        foreign = _list_nodes(other)
        for where, node in _list_strangers(layout, own, foreign):
            leaving.setdefault(where, f"{where} (node {node!r} of layout {name!r})")
        arriving += [
            f"{where} of layout {name!r} (node {node!r})"
            for where, node in _list_strangers(other, foreign, own)
        ]
    left = [*leaving.values(), *arriving]
    _warn_of("edges or stations join two layouts and are left out", left)
    return set(leaving)


def _list_nodes(layout: Ledger) -> set[str]:
    """Return the names of a layout's nodes."""
    return {str(node.get("nodeId")) for node in _list_mappings(layout, "nodes")}


def _list_mappings(layout: Ledger, key: str) -> list[Mapping[str, Any]]:
    """Return the mappings in a list, without a check of what they hold."""
    return [entry for entry in layout.entries(key) if isinstance(entry, Mapping)]


def _list_strangers(layout: Ledger, own: set[str], foreign: set[str]) -> Iterator[tuple[str, str]]:
    """Yield a layout's edges and stations at foreign nodes, with these."""
    rows = [
        (f"edge {edge.get('edgeId')!r}", [edge.get("startNodeId"), edge.get("endNodeId")])
        for edge in _list_mappings(layout, "edges")
    ]
    for station in _list_mappings(layout, "stations"):
        nodes = station.get("interactionNodeIds")
        where = f"station {station.get('stationId')!r}"
        rows.append((where, nodes if isinstance(nodes, list) else []))
    for where, nodes in rows:
        for node in map(str, nodes):
            if node not in own and node in foreign:
                yield where, node


def _read_stations(builder: GraphBuilder, layout: Ledger, leaving: set[str]) -> Stations:
    """Return the nodes of each station, but those of other layouts."""
    stations = {}
    for station in layout.children("stations", "station", "stationId"):
        if station.where in leaving:
            station.skip()
            continue
        nodes = station.entries("interactionNodeIds")
        for name in nodes:
            builder.find(station, name)
        stations[str(station.need("stationId"))] = tuple(map(str, nodes))
    return stations


def _types_of(entry: Ledger) -> list[str | None]:
    """Return the vehicle types of properties, or None."""
    return [*entry.entries("vehicleTypeIds"), entry.get("vehicleTypeId")]


def _own_entry(entries: list[Ledger], vehicle: str | None) -> Ledger | None:
    """Return the first properties for a type of vehicle."""
    own = next((entry for entry in entries if vehicle in _types_of(entry)), None)
    for entry in entries:
        if entry is not own:
            entry.skip()
    return own


def _check_map(element: Ledger, maps: set[str], level: str | None) -> None:
    """Refuse nodes of several maps, or of an unwanted one."""
    if len(maps) > 1 or (level is not None and maps - {level}):
        rule = "an audit has one map"
        raise element.fail(f"has nodes on the maps {sorted(maps)}", rule)


def _read_order(
    document: Ledger, heading: HeadingRule | None, level: str | None, vehicle: str | None
) -> GraphContents:
    """Read one map of a VDA 5050 order."""
    builder = GraphBuilder(heading, "any")
    maps = set()
    places: dict[str, Any] = {}
    nodes = list(document.children("nodes", "node", "nodeId"))
    for node in nodes:
        place = node.child("nodePosition")
        name = str(node.need("nodeId"))
        if name in places:  # an order may pass a node again
            if places[name] != place.fields:
                raise node.fail("has two positions", "an audit has one for each node")
            place.skip()
            continue
        places[name] = place.fields
        maps.add(str(place.get("mapId")))
        _add_place(builder, node, place)
    _check_map(document, maps, level)
    default = "GLOBAL" if str(document.get("version", "2")).startswith("1") else "TANGENTIAL"
    edges = list(document.children("edges", "edge", "edgeId"))
    has_ends = [
        any(edge.get(end) is not None for end in ("startNodeId", "endNodeId")) for edge in edges
    ]
    numbers = {} if all(has_ends) else _number_nodes(nodes)
    for edge, is_named in zip(edges, has_ends, strict=True):
        ends = _read_ends(edge) if is_named else _find_ends(edge, numbers)
        _add_edge(builder, edge, edge, ends, "orientation", _may_turn(edge, True), default)
    return builder.build()


def _read_ends(edge: Ledger) -> tuple[Any, Any]:
    """Return the names of the nodes that an edge joins."""
    return edge.need("startNodeId"), edge.need("endNodeId")


def _number_nodes(nodes: Sequence[Ledger]) -> dict[int, str]:
    """Return the names of nodes by their numbers in an order."""
    names: dict[int, str] = {}
    for node in nodes:
        number, name = node.count("sequenceId"), str(node.get("nodeId"))
        if names.setdefault(number, name) != name:
            raise node.fail(f"has the sequenceId {number}", f"node {names[number]!r} has it, too")
    return names


def _find_ends(edge: Ledger, names: Mapping[int, str]) -> tuple[str, str]:
    """Return the nodes before and after an edge in an order, as since version 3."""
    number = edge.count("sequenceId")
    if number - 1 in names and number + 1 in names:
        return names[number - 1], names[number + 1]
    rule = f"without startNodeId and endNodeId, nodes must have {number - 1} and {number + 1}"
    raise edge.fail(f"has the sequenceId {number}", rule)


def _may_turn(edge: Ledger, otherwise: bool) -> bool:
    """Return True if a robot may turn on an edge, in the words of any version."""
    if edge.get("rotationAllowed") is not None:
        return edge.flag("rotationAllowed")
    key = "reachOrientationBeforeEntering"  # since VDA 5050 3.0
    return otherwise if edge.get(key) is None else not edge.flag(key)


def _add_place(builder: GraphBuilder, node: Ledger, entry: Ledger) -> None:
    """Add a node of LIF or VDA 5050, with its yaw."""
    place = entry if entry.kind == "nodePosition" else node.child("nodePosition")
    name = str(node.need("nodeId"))
    yaw = math.nan
    width = place.number("allowedDeviationTheta", 0.0, lowest=0.0)
    if entry.get("theta") is not None:
        yaw = entry.angle("theta")
        place.note_angle("allowedDeviationTheta", width)
        if width >= ANY_YAW:
            yaw = math.nan
        elif width:
            builder.yaw_deviations[name] = width
    deviation = place.get("allowedDeviationXY", place.get("allowedDeviationXy", 0.0))
    if isinstance(deviation, Mapping):  # an ellipse
        ellipse = place.inner(deviation, f"{place.where}, allowedDeviationXY", "ellipse")
        deviation = max(ellipse.number("a"), ellipse.number("b"))
        ellipse.get("theta")  # of the ellipse, which becomes a disc
    deviation = place.check_number("allowedDeviationXY", deviation, 0.0)
    point = place.number("x"), place.number("y")
    builder.add_node(node, name, point, yaw, deviation)


def _add_edge(
    builder: GraphBuilder,
    edge: Ledger,
    entry: Ledger,
    names: tuple[Any, Any],
    key: str,
    turning: bool,
    default: str = "TANGENTIAL",
) -> None:
    """Add an edge of LIF or VDA 5050.

    ``entry`` has its orientation, by a ``key``, and its trajectory. A robot that may turn on the
    edge may have any yaw on it.
    """
    ends = [builder.find(edge, name) for name in names]
    entry.refuse("orientationType", "TANGENTIAL", "GLOBAL")
    rule = None
    if entry.get(key) is not None:
        frame = "map" if entry.get("orientationType", default) == "GLOBAL" else "lane"
        rule = HeadingRule(frame, (entry.angle(key),))
        rule = HEADINGS["any"] if turning else rule
    legs: tuple[Leg, ...] = ()
    if entry.get("trajectory") is not None:
        legs = _read_trajectory(entry.child("trajectory"))
    widths = [0.0]
    if entry.get("corridor"):
        corridor = entry.child("corridor")
        widths = [corridor.number(side, 0.0) for side in ("leftWidth", "rightWidth")]
    builder.add_lane(edge, edge.need("edgeId"), ends, rule, legs, max(widths))


def _read_trajectory(trajectory: Ledger) -> tuple[Leg, ...]:
    """Read a NURBS curve as legs."""
    rows = []
    for point in trajectory.children("controlPoints", "control point"):
        point.refuse("orientation")
        rows.append((point.number("x"), point.number("y"), point.number("weight", 1.0)))
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    degree = trajectory.number("degree", 1)
    if degree % 1.0:
        raise trajectory.fail(f"has the degree {degree:g}", "it must be a whole number")
    version = str(trajectory.document.get("version"))
    if version.startswith("3") and trajectory.get("knotVector") is None:
        knots = clamp_knots(int(degree), len(rows))
    else:
        trajectory.need("knotVector")
        words = trajectory.entries("knotVector")
        knots = np.array([trajectory.check_number("knot", word) for word in words])
    try:
        return cut_nurbs(int(degree), knots, table[:, :2], table[:, 2])
    except ValueError as error:
        problem, _, rule = str(error).partition("; ")
        raise trajectory.fail(problem, rule) from error


_GRAPHS: Final = {
    "features": (FIELDS[0], _read_nav2),
    "levels": (FIELDS[1], _read_rmf),
    "layouts": (FIELDS[2], _read_lif),
    "nodes": (FIELDS[2], _read_order),
}
"""Fields and reader of each format, by the field that it alone has."""


# ---- networkx ------------------------------------------------------------------------------------


def read_networkx(graph: Any) -> dict[str, Any]:
    """Return the arguments of :meth:`cspace.lanes.RouteGraph.from_arrays` for a graph."""
    document = Ledger(graph.graph, "the graph", FIELDS[3], "graph")
    document.crs("crs")
    indices = {node: k for k, node in enumerate(graph.nodes)}
    positions = []
    yaws = []
    for name, data in graph.nodes(data=True):
        node = document.inner(data, f"has the node {name!r}, which", "node")
        place = node.get("pos", (node.get("x"), node.get("y")))
        try:
            x, y = check_point(place).tolist()
            yaw = float(node.get("yaw", math.nan))
            if math.isinf(yaw):
                raise ValueError
        except (TypeError, ValueError):
            problem = f"has the node {name!r} at {place!r}"
            rule = "it needs pos=(x, y), or x and y, metres"
            raise ContentError(problem, rule) from None
        positions.append((x, y))
        yaws.append(yaw)
    ends = []
    headings = []
    for first, last, data in graph.edges(data=True):
        edge = document.inner(data, f"has the edge {first!r}, {last!r}, which", "edge")
        edge.refuse("geometry", rule="edges are straight, so that each corner needs a node")
        ends.append((indices[first], indices[last]))
        heading = edge.get("heading", "forward")
        headings.append(parse_heading(heading, f"heading of the edge {first!r}, {last!r}"))
    document.close("graph")
    return {
        "positions": np.array(positions).reshape(-1, 2),
        "edges": np.array(ends, dtype=np.int64).reshape(-1, 2),
        "headings": headings,
        "two_way": not graph.is_directed(),
        "names": [str(node) for node in graph.nodes],
        "yaws": yaws,
    }
