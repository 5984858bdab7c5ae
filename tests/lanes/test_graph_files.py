"""Route graphs of Nav2, Open-RMF, LIF and VDA 5050, and damaged ones."""

import copy
import math
import warnings

import networkx
import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import BSpline

from cspace.errors import AngleWarning, CspaceError, FileError, GeometryError, InputError
from cspace.lanes import RouteGraph
from cspace.lanes._curves import cut_nurbs
from cspace.lanes._lane_motions import list_motions
from tests.helpers.handmade import build_empty
from tests.helpers.orders import EDITIONS, PLACES, make_order
from tests.helpers.refusals import check_refused, refusals, write
from tests.helpers.strategies import few

NAV2 = {
    "type": "FeatureCollection",
    "name": "graph",
    "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}},
    "features": [
        {
            "type": "Feature",
            "properties": {"id": 0, "frame": "map"},
            "geometry": {"type": "Point", "coordinates": [1.0, 2.0]},
        },
        {
            "type": "Feature",
            "properties": {"id": 1},
            "geometry": {"type": "Point", "coordinates": [4.0, 2.0]},
        },
        {
            "type": "Feature",
            "properties": {"id": 2, "startid": 0, "endid": 1, "metadata": {"speed_limit": 50}},
            "geometry": {"type": "MultiLineString", "coordinates": [[[1.0, 2.0], [4.0, 2.0]]]},
        },
    ],
}
RMF = {
    "building_name": "office",
    "levels": {
        "L1": {
            "vertices": [
                [1.0, 2.0, {"name": "dock", "is_charger": True}],
                [4.0, 2.0, {"name": ""}],
            ],
            "lanes": [
                [0, 1, {"orientation_constraint": "forward", "speed_limit": 0.5}],
                [1, 0, {}],
                [0, 1, {"is_bidirectional": True, "orientation_constraint": "backward"}],
            ],
        }
    },
}
ARC = {
    "degree": 2,
    "knotVector": [0, 0, 0, 1, 1, 1],
    "controlPoints": [
        {"x": 1, "y": 0},
        {"x": 1, "y": 1, "weight": math.sqrt(0.5)},
        {"x": 0, "y": 1},
    ],
}
"""A quarter of a circle, exactly."""
LIF = {
    "metaInformation": {"lifVersion": "1.0.0"},
    "layouts": [
        {
            "layoutId": "hall",
            "nodes": [
                {
                    "nodeId": "a",
                    "nodePosition": {"x": 1.0, "y": 0.0},
                    "vehicleTypeNodeProperties": [{"vehicleTypeId": "fork", "theta": 1.5}],
                },
                {"nodeId": "b", "nodePosition": {"x": 0.0, "y": 1.0}},
            ],
            "edges": [
                {
                    "edgeId": "ab",
                    "startNodeId": "a",
                    "endNodeId": "b",
                    "vehicleTypeEdgeProperties": [
                        {
                            "vehicleTypeId": "fork",
                            "vehicleOrientation": math.pi,
                            "orientationType": "TANGENTIAL",
                            "rotationAllowed": False,
                            "trajectory": ARC,
                        }
                    ],
                },
                {
                    "edgeId": "ba",
                    "startNodeId": "b",
                    "endNodeId": "a",
                    "vehicleTypeEdgeProperties": [{"vehicleTypeId": "fork"}],
                },
            ],
            "stations": [{"stationId": "S", "interactionNodeIds": ["a"]}],
        }
    ],
}
ORDER = {
    "version": "2.0.0",
    "nodes": [
        {"nodeId": "a", "nodePosition": {"x": 1.0, "y": 0.0, "mapId": "m", "theta": 0.5}},
        {
            "nodeId": "b",
            "nodePosition": {"x": 0.0, "y": 1.0, "mapId": "m", "allowedDeviationXY": 0.25},
        },
    ],
    "edges": [
        {
            "edgeId": "ab",
            "startNodeId": "a",
            "endNodeId": "b",
            "orientation": 0.3,
            "orientationType": "GLOBAL",
            "rotationAllowed": False,
        },
        {"edgeId": "ba", "startNodeId": "b", "endNodeId": "a", "corridor": {"leftWidth": 0.4}},
    ],
}
FILES = {"nav.geojson": NAV2, "rmf.yaml": RMF, "lif.json": LIF, "order.json": ORDER}


def test_nav2_graphs_are_one_way_and_forward(tmp_path):
    graph = RouteGraph.open(write(tmp_path, "nav.geojson", NAV2))
    (lane,) = graph.lanes
    assert graph.names == ("0", "1") and graph.positions.tolist() == [[1.0, 2.0], [4.0, 2.0]]
    assert (lane.name, lane.start, lane.end, lane.heading.yaws) == ("2", 0, 1, (0.0,))
    back = RouteGraph.open(tmp_path / "nav.geojson", heading="backward")
    assert back.lanes[0].heading.yaws == (math.pi,)


@pytest.mark.parametrize(
    "kind, drawn, is_straight",
    [
        ("MultiLineString", [[[1, 2], [4, 2]]], True),
        ("LineString", [[4, 2], [1, 2]], True),
        ("LineString", [[[1, 2], [3, 2]], [[3, 2], [4, 2]]], True),
        ("MultiLineString", [[1, 2.005], [2, 1.995, 0.0], [4, 2]], True),
        ("MultiLineString", [], True),
        ("MultiLineString", [[[1, 2], [2, 3], [4, 2]]], False),
        ("MultiLineString", [[[1, 2], [7, 2]]], False),
        ("LineString", [[1, 2], [3, 2]], False),
        ("LineString", [[1, 2], [4, 3]], False),
    ],
)
def test_nav2_edges_are_straight_however_drawn(tmp_path, kind, drawn, is_straight):
    document = copy.deepcopy(NAV2)
    document["features"][2]["geometry"] = {"type": kind, "coordinates": drawn}
    file = write(tmp_path, "nav.geojson", document)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (lane,) = RouteGraph.open(file).lanes
    assert (lane.start, lane.end, lane.legs, lane.deviation) == (0, 1, (), 0.0)
    texts = [str(each.message) for each in caught]
    assert texts == [] if is_straight else texts[0].endswith("is audited: 2 (0 to 1)")
    assert all(each.filename == __file__ for each in caught)


def test_nav2_edges_with_one_id_are_all_read_and_named(tmp_path):
    document = copy.deepcopy(NAV2)
    back = copy.deepcopy(document["features"][2])
    back["properties"] |= {"startid": 1, "endid": 0}
    node = copy.deepcopy(back)
    node["properties"]["id"] = 1
    document["features"] += [back, node]
    with pytest.warns(UserWarning, match=r"2 edges have the id .*: 2 \(1 to 0\), 1 \(1 to 0\)$"):
        graph = RouteGraph.open(write(tmp_path, "nav.geojson", document))
    assert [(lane.name, lane.start) for lane in graph.lanes] == [("2", 0), ("2", 1), ("1", 1)]


def test_rmf_graphs_have_constraints(tmp_path):
    graph = RouteGraph.open(write(tmp_path, "rmf.yaml", RMF))
    assert graph.names == ("dock", "1")
    rows = [(lane.start, lane.end, lane.heading.yaws) for lane in graph.lanes]
    back = (math.pi,)
    assert rows == [(0, 1, (0.0,)), (1, 0, (0.0, math.pi)), (0, 1, back), (1, 0, back)]


def test_lif_layouts_have_curves_stations_and_orientations(tmp_path):
    graph = RouteGraph.open(write(tmp_path, "lif.json", LIF))
    first, second = graph.lanes
    assert first.heading == ("lane", (math.pi,))
    assert second.heading == ("any", ())
    assert graph.stations == {"S": ("a",)}
    np.testing.assert_array_equal(graph.yaws, [1.5, math.nan])
    assert first.legs[0].first == pytest.approx(math.pi / 2)
    assert first.legs[-1].last == pytest.approx(math.pi)
    other = copy.deepcopy(LIF)
    other["layouts"][0]["edges"][0]["vehicleTypeEdgeProperties"][0]["rotationAllowed"] = True
    assert RouteGraph.open(write(tmp_path, "b.json", other)).lanes[0].heading.frame == "any"


def test_orders_have_deviations_and_corridors(tmp_path):
    graph = RouteGraph.open(write(tmp_path, "order.json", ORDER))
    first, second = graph.lanes
    assert first.heading == ("map", (0.3,))
    assert (first.deviation, second.deviation) == (0.25, 0.4)
    np.testing.assert_array_equal(graph.yaws, [0.5, math.nan])


@pytest.mark.parametrize("version", EDITIONS)
def test_orders_of_each_edition_are_read(version, tmp_path):
    for is_full in (False, True):
        order = make_order(version, is_full)
        points = [point for edge in order["edges"] for point in _points_of(edge)]
        if any("orientation" in point for point in points):
            with pytest.raises(FileError, match=r"controlPoints\[0\] has orientation 0\.1"):
                RouteGraph.open(write(tmp_path, "order.json", order))
            for point in points:
                del point["orientation"]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            graph = RouteGraph.open(write(tmp_path, "order.json", order))
        assert dict(zip(graph.names, map(tuple, graph.positions.tolist()), strict=True)) == PLACES
        names = [(graph.names[lane.start], graph.names[lane.end]) for lane in graph.lanes]
        assert names == [("a", "b"), ("b", "c"), ("c", "b")]
        heights = ["maximumMobileRobotHeight", "minimumLoadHandlingDeviceHeight"]
        heights = heights if version[0] == "3" else ["maxHeight", "minHeight"]
        texts = [str(each.message).partition("not read: ")[2] for each in caught]
        assert texts == [", ".join(f"{name} (edge)" for name in heights)] * is_full
        if is_full:
            assert graph.yaws.tolist() == [0.5] * 3
            assert graph.yaw_deviations == dict.fromkeys("abc", 0.2)
            width = 0.5 if version[:3] in ("2.1", "3.0") else 0.25
            assert {(lane.heading, lane.deviation) for lane in graph.lanes} == {
                (("map", (0.75,)), width)
            }
            assert [leg.end for lane in graph.lanes for leg in lane.legs] == [
                PLACES[name] for name in "bcb"
            ]


def _points_of(edge):
    """Return the control points of an edge of an order."""
    return edge.get("trajectory", {}).get("controlPoints", [])


@refusals(
    "path, value, text",
    (("nodes", 1, "nodePosition"), None, "node 'b' has no nodePosition"),
    (("edges", 0, "sequenceId"), None, "edge 'e0' has no sequenceId"),
    (("edges", 0, "sequenceId"), 0.5, "edge 'e0' has the sequenceId 0.5"),
    (("edges", 0, "sequenceId"), 2, "edge 'e0' has the sequenceId 2; without startNodeId"),
    (("edges", 2, "sequenceId"), 7, "nodes must have 6 and 8"),
    (("edges", 0, "startNodeId"), "a", "edge 'e0' has no endNodeId"),
    (("nodes", 1, "sequenceId"), 0, "node 'b' has the sequenceId 0; node 'a' has it, too"),
    (("nodes", 1, "sequenceId"), "2", "node 'b' has the sequenceId '2'"),
    (("nodes", 0, "nodePosition", "allowedDeviationTheta"), -0.1, "allowedDeviationTheta -0.1"),
)
def test_orders_without_ends_of_edges_need_their_numbers(path, value, text, tmp_path):
    order = put(make_order("3.0.0", is_full=False), path, value)
    file = write(tmp_path, "order.json", order)
    check_refused(lambda: RouteGraph.open(file), text)


def test_an_order_may_name_the_ends_of_some_edges(tmp_path):
    order = make_order("3.0.0", is_full=False)
    order["edges"][1] |= {"startNodeId": "b", "endNodeId": "c"}
    order["edges"].reverse()
    graph = RouteGraph.open(write(tmp_path, "order.json", order))
    names = [(graph.names[lane.start], graph.names[lane.end]) for lane in graph.lanes]
    assert names == [("c", "b"), ("b", "c"), ("a", "b")]


@pytest.mark.parametrize("change", [{}, {"theta": 2.0}, {"x": 9.0}])
def test_an_order_may_pass_a_node_again_as_it_was(tmp_path, change):
    order = copy.deepcopy(ORDER)
    first = order["nodes"][0]
    order["nodes"].append(first | {"nodePosition": first["nodePosition"] | change})
    file = write(tmp_path, "order.json", order)
    if change:
        with pytest.raises(FileError, match="has two positions; an audit has one for each node"):
            RouteGraph.open(file)
    else:
        assert len(RouteGraph.open(file).names) == 2


def edit(name, path, value):
    """Return a copy of a file's document with another value at a path of keys."""
    return put(copy.deepcopy(FILES[name]), path, value)


def put(document, path, value):
    """Put a value at a path of keys of a document; return the document."""
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return document


NODE = ("features", 0, "properties", "id")
EDGE = ("features", 2, "properties", "endid")
DRAWN = ("features", 2, "geometry", "coordinates")
LANES = ("levels", "L1", "lanes", 0)
LIF_EDGE = ("layouts", 0, "edges", 0)
ENTRY = (*LIF_EDGE, "vehicleTypeEdgeProperties", 0)
POINTS = (*ENTRY, "trajectory", "controlPoints")


JUMP = {
    "degree": 1,
    "knotVector": [0, 0, 1, 1, 2, 2],
    "controlPoints": [{"x": x, "y": y} for x, y in ((1, -1), (1, 0), (1, 1), (0, 1))],
}
"""A curve in two pieces."""
CROOKED = {
    "degree": 3,
    "knotVector": [0, 0, 0, *range(18), 17, 17, 17],
    "controlPoints": [{"x": x, "y": y} for x, y in np.random.default_rng(1).random((20, 2)) * 10],
}
"""A curve that turns more than any lane."""


@refusals(
    "name, path, value, text",
    ("nav.geojson", ("crs",), {"name": "CRS84"}, "has the crs"),
    ("nav.geojson", NODE, None, "features[0].properties has no id"),
    ("nav.geojson", NODE, 1, "node 1 is there twice"),
    ("nav.geojson", ("features", 0, "properties", "frame"), "odom", "node 0 has frame 'odom'"),
    ("nav.geojson", ("features", 0, "geometry", "coordinates"), [1], "node 0 has the coordinates"),
    ("nav.geojson", ("features", 0, "geometry", "coordinates"), ["1", 2], "node 0 has the x '1'"),
    ("nav.geojson", ("features", 0, "geometry", "type"), "Polygon", "with the id 0 is a Polygon"),
    ("nav.geojson", ("features", 0), 3, "features[0]"),
    ("nav.geojson", EDGE, 7, "edge 2 names the node 7"),
    ("nav.geojson", DRAWN, [[3]], "edge 2 has the coordinates"),
    ("nav.geojson", DRAWN, [[[1, 2], 3]], "edge 2 has the x [1, 2]"),
    ("rmf.yaml", ("levels", "L2"), {}, "pass e.g. level='L1'"),
    ("rmf.yaml", ("levels",), [], "levels is []"),
    ("rmf.yaml", ("levels", "L1"), [], "level 'L1' is []"),
    ("rmf.yaml", ("levels", "L1", "vertices", 1), [3], "vertex 1 has the coordinates [3]"),
    ("rmf.yaml", ("levels", "L1", "vertices", 1), ["x", 0], "vertex 1 has the x 'x'"),
    (
        "rmf.yaml",
        ("levels", "L1", "vertices", 1),
        [0, 0, {"name": "dock"}],
        "vertex 1 is there twice",
    ),
    (
        "rmf.yaml",
        ("name",),
        "depot",
        "the graph is a building; a navigation graph is needed; a building of the traffic",
    ),
    ("rmf.yaml", (*LANES, 1), 9, "lane 0 is [0, 9"),
    ("rmf.yaml", LANES, 5, "lane 0 is 5"),
    ("rmf.yaml", (*LANES, 2), {"orientation_constraint": "left"}, "orientation_constraint 'left'"),
    ("rmf.yaml", (*LANES, 2), 5, "has the lane 0 [0, 1, 5]; the third entry"),
    ("lif.json", (*LIF_EDGE, "endNodeId"), "z", "edge 'ab' names the node 'z'"),
    ("lif.json", (*ENTRY, "vehicleOrientation"), "left", "has the vehicleOrientation 'left'"),
    (
        "lif.json",
        (*ENTRY, "orientationType"),
        "LOCAL",
        "edge 'ab'.vehicleTypeEdgeProperties[0] has orientationType",
    ),
    ("lif.json", (*ENTRY, "rotationAtStartNodeAllowed"), "ALL", "rotationAtStartNodeAllowed 'ALL'"),
    ("lif.json", (*LIF_EDGE, "mobileRobotTypeEdgeProperties"), [], "mobileRobotTypeEdgeProperties"),
    ("lif.json", (*ENTRY, "vehicleTypeId"), "tug", "pass e.g. vehicle="),
    (
        "lif.json",
        ("layouts", 0, "nodes", 0, "vehicleTypeNodeProperties", 0, "vehicleTypeId"),
        "Fork",
        "the layout has the vehicles 'Fork', 'fork'; one of them must be chosen",
    ),
    (
        "lif.json",
        (*ENTRY, "trajectory", "knotVector"),
        [0, 1],
        "vehicleTypeEdgeProperties[0].trajectory has 2 knots",
    ),
    ("lif.json", (*ENTRY, "trajectory", "knotVector"), [0, 0, 0, 1, 1, -1], "do not rise"),
    ("lif.json", (*ENTRY, "trajectory", "degree"), 0, "of degree 0"),
    ("lif.json", (*ENTRY, "trajectory", "degree"), 1.5, "has the degree 1.5"),
    ("lif.json", (*ENTRY, "trajectory"), JUMP, "jumps 1 m to (1, 1); its pieces must join"),
    ("lif.json", (*ENTRY, "trajectory"), CROOKED, "is too long or bent at"),
    ("lif.json", (*ENTRY, "trajectory"), ARC | {"degree": 17, "knotVector": [0] * 21}, "degree 17"),
    ("lif.json", (*ENTRY, "trajectory", "knotVector"), None, "trajectory has no knotVector"),
    ("lif.json", ("layouts", 0, "nodes", 0, "mapId"), "upstairs", "on the maps ['None', 'upst"),
    ("lif.json", (*POINTS, 1, "weight"), 0.0, "weight that is not above zero"),
    ("lif.json", (*POINTS, 1, "x"), None, "controlPoints[1] has no x"),
    ("lif.json", (*POINTS, 1, "orientation"), 0.5, "has orientation 0.5"),
    ("lif.json", (*POINTS, 0, "x"), 1.5, "edge 'ab' ends 0.5 m from a node"),
    ("lif.json", (*ENTRY, "trajectory"), 5, "trajectory is 5"),
    ("lif.json", ("layouts", 0, "stations", 0, "interactionNodeIds"), ["z"], "station 'S'"),
    ("lif.json", ("layouts", 0, "nodes", 0, "nodePosition"), 1, "node 'a'.nodePosition is 1"),
    ("lif.json", ("layouts", 0, "origins"), [{"x": 3}], "the layout has origins"),
    ("lif.json", ("origins",), [{"x": 3}], "the graph has origins"),
    ("order.json", ("nodes", 0, "nodePosition", "mapId"), "n", "has nodes on the maps"),
    ("order.json", ("nodes",), None, "edge 'ab' names the node 'a'"),
    ("order.json", ("edges", 0, "startNodeId"), "z", "edge 'ab' names the node 'z'"),
)
def test_damaged_files_name_the_element(name, path, value, text, tmp_path):
    file = write(tmp_path, name, edit(name, path, value))
    check_refused(lambda: RouteGraph.open(file), f"{file} ... {text}")


@pytest.mark.parametrize(
    "name, path, text",
    [
        ("nav.geojson", ("features", 2, "properties", "width"), "width (Nav2 edge)"),
        ("rmf.yaml", ("levels", "L1", "vertices", 0, 2, "yaw"), "yaw (vertex)"),
        ("rmf.yaml", (*LANES, 2, "curvature"), "curvature (lane)"),
        ("lif.json", ("layouts", 0, "layoutFrame"), "layoutFrame (layout)"),
        ("lif.json", ("metaInformation", "units"), "units (metaInformation)"),
        ("lif.json", (*ENTRY, "loadRestriction"), "loadRestriction (vehicleTypeEdgeProperties)"),
        ("lif.json", (*POINTS, 1, "z"), "z (control point)"),
        ("order.json", ("edges", 0, "maxHeight"), "maxHeight (edge)"),
        ("order.json", ("nodes", 0, "nodePosition", "z"), "z (nodePosition)"),
    ],
)
def test_unknown_fields_are_named_once(name, path, text, tmp_path):
    file = write(tmp_path, name, edit(name, path, 1.0))
    with pytest.warns(UserWarning) as caught:
        RouteGraph.open(file)
    (message,) = (str(each.message) for each in caught)
    assert message.partition("; did you mean")[0] == f"{file}: these fields are not read: {text}"
    assert caught[0].filename == __file__


@pytest.mark.parametrize(
    "name, path, value",
    [
        ("lif.json", (*ENTRY, "vehicleOrientation"), 180.0),
        ("lif.json", ("layouts", 0, "nodes", 0, "vehicleTypeNodeProperties", 0, "theta"), -90.0),
        ("order.json", ("edges", 0, "orientation"), 90),
        ("order.json", ("nodes", 0, "nodePosition", "theta"), 7.0),
        ("order.json", ("nodes", 0, "nodePosition", "allowedDeviationTheta"), 15),
    ],
)
def test_angles_in_degrees_are_warned_of_with_their_radians(name, path, value, tmp_path):
    radians = f"{value:g} degrees are {math.radians(value):.6g} rad"
    with pytest.warns(AngleWarning, match=f"{path[-1]}, the first of 1, .*{radians}"):
        RouteGraph.open(write(tmp_path, name, edit(name, path, value)))


def test_fields_of_other_vehicles_and_layouts_are_nobodys_concern(tmp_path):
    layout = copy.deepcopy(LIF)
    entries = layout["layouts"][0]["edges"][0]["vehicleTypeEdgeProperties"]
    entries.append({"vehicleTypeId": "tug", "loadRestriction": 1, "vehicleOrientation": 90.0})
    layout["layouts"].append({"layoutId": "yard", "layoutFrame": 3})
    with warnings.catch_warnings(action="error"):
        RouteGraph.open(write(tmp_path, "a.json", layout), level="hall", vehicle="fork")


def test_edges_and_stations_between_layouts_are_left_out_by_name(tmp_path):
    layout = copy.deepcopy(LIF)
    hall = layout["layouts"][0]
    lift = {"edgeId": "lift", "startNodeId": "b", "endNodeId": "c"}
    hall["edges"].append(lift)
    hall["stations"].append({"stationId": "T", "interactionNodeIds": ["a", "c"]})
    down = {"edgeId": "down", "startNodeId": "c", "endNodeId": "b"}
    inside = {"edgeId": "loop", "startNodeId": "c", "endNodeId": "a"}
    place = {"x": 5.0, "y": 5.0}
    nodes = [{"nodeId": name, "nodePosition": place} for name in ("c", "a")]
    other = {"layoutId": "yard", "nodes": nodes, "edges": [down, inside]}
    layout["layouts"].append(other)
    with pytest.warns(UserWarning) as caught:
        graph = RouteGraph.open(write(tmp_path, "a.json", layout), level="hall")
    (message,) = (str(each.message) for each in caught)
    assert message == (
        "3 edges or stations join two layouts and are left out: edge 'lift' (node 'c' of layout "
        "'yard'), station 'T' (node 'c' of layout 'yard'), edge 'down' of layout 'yard' (node 'b')"
    )
    assert caught[0].filename == __file__
    assert [lane.name for lane in graph.lanes] == ["ab", "ba"]
    assert graph.stations == {"S": ("a",)}
    lift["endNodeId"] = "z"
    layout["layouts"].pop()
    hall["stations"].pop()
    with pytest.raises(FileError, match="edge 'lift' names the node 'z'; there is no such node"):
        RouteGraph.open(write(tmp_path, "b.json", layout))


def test_knots_that_version_3_leaves_out_are_clamped_and_uniform(tmp_path):
    order = edit("order.json", ("version",), "3.0.0")
    points = [{"x": 1, "y": 0}, {"x": 2, "y": 0}, {"x": 2, "y": 1}, {"x": 0, "y": 1}]
    order["edges"][0]["trajectory"] = {"degree": 1, "controlPoints": points}
    legs = RouteGraph.open(write(tmp_path, "a.json", order)).lanes[0].legs
    assert [leg.end for leg in legs] == [(2, 0), (2, 1), (0, 1)]
    for degree in (2, 3):
        order["edges"][0]["trajectory"]["degree"] = degree
        legs = RouteGraph.open(write(tmp_path, "a.json", order)).lanes[0].legs
        knots = [0] * degree + ([0, 0.5, 1] if degree == 2 else [0, 1]) + [1] * degree
        order["edges"][0]["trajectory"]["knotVector"] = knots
        assert legs == RouteGraph.open(write(tmp_path, "a.json", order)).lanes[0].legs
        del order["edges"][0]["trajectory"]["knotVector"]


def test_files_of_no_graph_are_refused(tmp_path):
    nested = "[" * 100 + "]" * 100
    no_graphs = ["[]", "{}", "{", f'{{"nodes": {nested}}}', "a: [", "levels: &a []\nb: *a"]
    for text in no_graphs:
        name = "a.json" if text[0] in "[{" else "a.yaml"
        (tmp_path / name).write_text(text)
        with pytest.raises(FileError):
            RouteGraph.open(tmp_path / name)
    with pytest.raises(InputError, match=r"\.geojson"):
        RouteGraph.open(tmp_path / "a.png")


@pytest.mark.parametrize(
    "wrong, message",
    [
        (
            edit("rmf.yaml", (*LANES, 2), {"is_bidirectional": "false"}),
            "it must be true or false",
        ),
        (
            {"origins": []},
            "a route graph has one of features, levels, layouts, nodes; LIF is read up to version 1",
        ),
        (
            edit("rmf.yaml", ("levels", "L1", "vertices", 0), [1018.2, 431.7, 0, "a", {}]),
            "the third entry of a navigation graph holds options",
        ),
    ],
)
def test_graphs_of_other_formats_are_refused(wrong, message, tmp_path):
    file = write(tmp_path, "rmf.yaml", wrong)
    check_refused(lambda: RouteGraph.open(file), message)


@pytest.mark.parametrize("rounds", few([60, 300]))
@pytest.mark.filterwarnings("ignore:.*these fields are not read")
@pytest.mark.parametrize("name", FILES)
def test_no_damage_gives_another_error(name, tmp_path, rounds):
    rng = np.random.default_rng(0)
    text = write(tmp_path, name, FILES[name]).read_text()
    for _ in range(rounds):
        first, last = np.sort(rng.integers(0, len(text), 2))
        middle = rng.choice(["", "null", "-1", '"x"', "[]", "1e999"])
        (tmp_path / name).write_text(text[:first] + middle + text[min(last, first + 9) :])
        try:
            RouteGraph.open(tmp_path / name)
        except CspaceError as error:
            assert "Error:" not in str(error) or "cannot be read as" in str(error)


def test_a_graph_of_networkx_has_the_same_lanes():
    graph = networkx.Graph()
    graph.add_node("a", pos=(1, 2))
    graph.add_node("b", x=4, y=2, yaw=0.5)
    graph.add_edge("a", "b", heading=0.0)
    found = RouteGraph.from_networkx(graph)
    assert [(lane.start, lane.end, lane.heading.frame) for lane in found.lanes] == [
        (0, 1, "map"),
        (1, 0, "map"),
    ]
    assert len(RouteGraph.from_networkx(graph.to_directed()).lanes) == 2
    with pytest.warns(UserWarning, match=r"not read: oneway \(edge\), theta \(node\)"):
        graph.add_node("a", theta=0.5)
        graph.add_edge("a", "b", oneway=True)
        RouteGraph.from_networkx(graph)
    graph.graph["crs"] = "epsg:4326"
    with pytest.raises(GeometryError, match="epsg:4326"):
        RouteGraph.from_networkx(graph)
    graph.graph.clear()
    graph.edges["a", "b"]["geometry"] = "LINESTRING (1 2, 1 9, 4 2)"
    with pytest.raises(InputError, match="the edge 'a', 'b', which has geometry"):
        RouteGraph.from_networkx(graph)
    graph.add_node("c")
    with pytest.raises(InputError, match="node 'c'"):
        RouteGraph.from_networkx(graph)


@pytest.mark.parametrize("rounds", few([3, 10]))
@pytest.mark.parametrize("degree", few([3, 1, 2, 5]))
def test_legs_contain_a_random_curve_and_its_directions(degree, rounds):
    rng = np.random.default_rng(degree)
    for _ in range(rounds):
        count = degree + int(rng.integers(1, 6))
        points = np.cumsum(rng.uniform(0.1, 1.0, (count, 2)), axis=0) * rng.choice([-1, 1], 2)
        weights = rng.uniform(0.3, 3.0, count)
        inner = np.sort(rng.uniform(0, 1, count - degree - 1))
        knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
        legs = cut_nurbs(degree, knots, points, weights)
        spline = BSpline(knots, np.column_stack([points * weights[:, None], weights]), degree)
        for t in rng.uniform(0, 1, 200):
            *top, bottom = spline(t)
            *rise, drop = spline(t, 1)
            point = np.array(top) / bottom
            tangent = (np.array(rise) - point * drop) / bottom
            angle = math.atan2(tangent[1], tangent[0])
            assert any(contains(leg, point, angle) for leg in legs)


def contains(leg, point, angle):
    """Return True if a leg contains a point of its curve, with its direction."""
    start, end = np.array(leg.start), np.array(leg.end)
    chord = end - start
    share = np.clip((point - start) @ chord / (chord @ chord), 0, 1)
    if np.hypot(*(point - start - share * chord)) > leg.drift + 1e-9:
        return False
    return abs(math.remainder(angle - leg.first, math.tau)) <= leg.spread + 1e-6


def test_the_motions_of_a_curve_are_as_wide_as_it_deviates(tmp_path):
    graph = RouteGraph.open(write(tmp_path, "lif.json", LIF))
    motions = list_motions(build_empty((20, 20), "rect:0.2x0.1", rotations=8), graph)
    legs = graph.lanes[0].legs
    of_legs = (motions.lanes == 0) & ~motions.on_lane
    lever = math.hypot(0.1, 0.05)
    needed = np.array([leg.drift + lever * leg.spread for leg in legs])
    assert min(leg.drift for leg in legs) > 0.0
    assert (needed <= motions.growths[of_legs]).all()
    assert (motions.growths[of_legs] <= needed + 1e-3).all()


def test_a_piece_that_is_one_point_has_no_leg():
    points = np.array([(0, 0), (0, 0), (1, 0.0)])
    (leg,) = cut_nurbs(1, np.array([0, 0, 1, 2, 2.0]), points, np.ones(3))
    assert (leg.start, leg.end, leg.drift < 1e-8) == ((0.0, 0.0), (1.0, 0.0), True)


def test_a_curve_that_turns_back_jumps_there():
    points = np.array([(0, 0), (2, 0), (-1, 0), (1, 0.0)])
    knots = np.array([0, 0, 0, 0, 1, 1, 1, 1.0])
    legs = cut_nurbs(3, knots, points, np.ones(4))
    directions = [leg.first for leg in legs]
    assert {round(abs(angle), 9) for angle in directions} == {0.0, round(math.pi, 9)}
    with pytest.raises(ValueError, match="too sharply"):
        cut_nurbs(3, knots, 1e7 * points, np.ones(4))


# ---- arguments ------------------------------------------------------------------------------------

ENDS = [(1.0, 1.0), (3.0, 2.0)]


YAWS = pd.Series([0.0, 1.0], index=["a", "b"])


@refusals(
    "call, message",
    (lambda: RouteGraph.from_arrays([(0, 0, 0)], []), "last axis"),
    (lambda: RouteGraph.from_arrays([(0, 0)], [(0, 1)]), "edge number 0"),
    (
        lambda: RouteGraph.from_arrays(ENDS, [(0.5, 0)]),
        "edges has shape (1, 2) and type float64 ... whole",
    ),
    (
        lambda: RouteGraph.from_arrays(ENDS, [(0, 1)], "sideways"),
        "headings is 'sideways' ... 'forward'",
    ),
    (lambda: RouteGraph.from_arrays(ENDS, [(0, 1)], [0.0, 0.0]), "headings has 2 entries ... have"),
    (lambda: RouteGraph.from_arrays(ENDS, [(0, 1)], two_way="no"), "two_way is 'no'"),
    (lambda: RouteGraph.from_arrays(ENDS, [(0, 1)], names=[1, "1"]), "names has '1' twice"),
    (lambda: RouteGraph.from_arrays([(0, 0)], [], yaws=[math.inf]), "yaws"),
    (
        lambda: RouteGraph.from_arrays(ENDS, [(0, 1)], yaws=[0.0]),
        "yaws has shape (1,) ... node",
    ),
    (
        lambda: RouteGraph.from_arrays(ENDS, [(0, 1)], yaws=YAWS),
        "yaws has the labels a, b ... effect",
    ),
    (
        lambda: RouteGraph.from_networkx({"a": ["b"]}),
        "graph is a dict",
    ),
    (
        lambda: RouteGraph.from_networkx(networkx.Graph([("a", "b")])),
        "graph has the node 'a' at (None, None) ... pos=",
    ),
)
def test_wrong_arguments_are_refused_in_one_line(call, message):
    check_refused(call, message)


@pytest.mark.parametrize(
    ("version", "rule", "turns"),
    [
        ("2.1.0", {"rotationAllowed": False}, False),
        ("2.1.0", {}, True),
        ("3.0.0", {"reachOrientationBeforeEntering": True}, False),
        ("3.0.0", {"reachOrientationBeforeEntering": False}, True),
        ("3.0.0", {}, True),
    ],
)
def test_the_orientation_on_an_edge_is_read_in_every_version(tmp_path, version, rule, turns):
    edge = {"edgeId": "e", "startNodeId": "a", "endNodeId": "b", "orientation": 0.0} | rule
    order = edit("order.json", ("edges",), [edge]) | {"version": version}
    with warnings.catch_warnings(action="error"):
        (lane,) = RouteGraph.open(write(tmp_path, "order.json", order)).lanes
    assert lane.heading.frame == ("any" if turns else "lane")
