"""Connections of audited graphs, curves, and the reports of audits."""

import csv
import json
import math
import xml.etree.ElementTree as ElementTree

import networkx
import numpy as np
import pytest
import shapely
from matplotlib import pyplot
from shapely import affinity

import cspace
from cspace.lanes import RouteGraph
from tests.helpers.commands import run
from tests.helpers.handmade import build_empty
from tests.helpers.refusals import write
from tests.helpers.strategies import few
from tests.lanes.test_graph_files import ARC, NAV2


@pytest.fixture(scope="module")
def floor():
    """Return the map of two rooms, one closed, with a slit that the robot does not pass."""
    occupied = np.zeros((80, 50), dtype=np.bool_)
    occupied[40:42] = True
    occupied[40:42, 24:26] = False
    occupied[20, :30] = True
    return cspace.build(cspace.Workspace.from_array(occupied, 0.1), "rect:0.6x0.4", rotations=36)


def oracle_of(audit):
    """Return a graph of networkx with a node for each node and interval of yaws.

    Only for straight lanes driven forward.
    """
    graph = networkx.DiGraph()
    places = audit.graph.positions

    def port(node, yaw):
        for low, high in audit.nodes[node].free_yaws:
            if any(low <= yaw + k * math.tau <= high for k in (-2, -1, 0, 1, 2)):
                return node, float(low)
        return node, ("only", round(math.remainder(yaw, math.tau), 9))

    for node in range(len(places)):
        graph.add_nodes_from((node, float(low)) for low, _ in audit.nodes[node].free_yaws)
    for lane, row in zip(audit.graph.lanes, audit.lanes, strict=True):
        if row.verdict == "free":
            step = places[lane.end] - places[lane.start]
            yaw = math.atan2(step[1], step[0])
            graph.add_edge(port(lane.start, yaw), port(lane.end, yaw))
    return graph


@pytest.mark.parametrize("number", few([30, 1000]))
def test_random_graphs_agree_with_networkx(floor, number):
    rng = np.random.default_rng(0)
    cut = 0
    for _ in range(number):
        count = int(rng.integers(2, 7))
        positions = rng.uniform((0.2, 0.2), (7.8, 4.8), (count, 2))
        edges = rng.integers(0, count, (int(rng.integers(1, 9)), 2))
        edges = edges[edges[:, 0] != edges[:, 1]]
        if not len(edges):
            continue  # a graph without lanes is refused
        audit = cspace.lanes.audit(floor, RouteGraph.from_arrays(positions, edges))
        oracle = oracle_of(audit)
        parts = {
            tuple(sorted({node for node, _ in part}))
            for part in networkx.strongly_connected_components(oracle)
        }
        assert {tuple(sorted(map(int, part))) for part in audit.parts} == parts
        lost = {(int(way.start), int(way.end)) for way in audit.lost}
        for lane, row in zip(audit.graph.lanes, audit.lanes, strict=True):
            ends = lane.start, lane.end
            joined = any(
                networkx.has_path(oracle, a, b)
                for a in oracle
                for b in oracle
                if (a[0], b[0]) == ends
            )
            assert (ends in lost) == (not joined), row
        for way in audit.lost:
            cut += 1
            yaws = floor.rotations.centers[:, 0]
            first, last = (
                np.column_stack([np.tile(positions[int(name)], (len(yaws), 1)), yaws])
                for name in (way.start, way.end)
            )
            pairs = first[:, None], last[None]
            if way.exists is False:
                assert floor.is_disconnected(*pairs).all()
            else:
                assert not floor.is_disconnected(*pairs).all()
                assert floor.is_connected(*pairs).any() == (way.exists is True)
    assert cut > number


def test_a_way_beside_the_lanes_is_found_or_disproven(floor):
    graph = RouteGraph.from_arrays([(1, 1), (3, 1), (6, 1)], [(0, 1), (1, 2)])
    audit = cspace.lanes.audit(floor, graph)
    assert [(way.start, way.end, way.exists) for way in audit.lost] == [
        ("0", "1", True),
        ("1", "2", False),
    ]
    assert "1 no longer reaches 2: there is no way at all, proven" in str(audit)
    assert "0 no longer reaches 1: there is a way beside the lanes" in str(audit)


def open_order(folder, *places, **fields):
    """Open an order of VDA 5050 with an edge between two places, and its fields."""
    nodes = [
        {"nodeId": name, "nodePosition": {"x": x, "y": y}}
        for name, (x, y) in zip("ab", places, strict=True)
    ]
    edge = {"edgeId": "e", "startNodeId": "a", "endNodeId": "b", "orientation": 0.0}
    edge |= {"rotationAllowed": False, **fields}
    return RouteGraph.open(write(folder, "order.json", {"nodes": nodes, "edges": [edge]}))


def open_arc(folder, **fields):
    """Open an order whose edge is a quarter of a circle of 1 m around (1, 1)."""
    points = [{**each, "x": each["x"] + 1, "y": each["y"] + 1} for each in ARC["controlPoints"]]
    return open_order(folder, (2, 1), (1, 2), trajectory={**ARC, "controlPoints": points}, **fields)


@pytest.mark.parametrize("wall", [None, 1.26, 1.24, 1.1])
def test_curves_agree_with_what_the_robot_sweeps(wall, tmp_path):
    # A robot of 0.4 m by 0.2 m: its outer corners reach hypot(1.1, 0.2) = 1.118 m from the center.
    space = build_empty((150, 150), "rect:0.4x0.2", 0.02, rotations=72)
    outer = math.hypot(1.1, 0.2)
    if wall is not None:
        space.add_obstacle(
            "pillar",
            affinity.translate(
                shapely.box(0, 0, 0.1, 0.1),
                *(1 + (outer + wall - 1.25) * math.sqrt(0.5) * np.ones(2)),
            ),
        )
    graph = open_arc(tmp_path)
    (row,) = cspace.lanes.audit(space, graph).lanes
    if wall is None:
        assert row.verdict == "free"
        assert 0.4 < row.margin == row.left == row.right < 1.0
    elif wall > 1.25:  # a centimetre of room
        assert row.verdict == "free"
        assert 0.002 < row.margin <= 0.01
    else:
        assert row.verdict == "blocked" and row.obstacle == "'pillar'"
        # The configuration lies on the circle, along its tangent.
        x, y, yaw = row.at
        assert math.hypot(x - 1, y - 1) == pytest.approx(1.0)
        assert math.cos(yaw - math.atan2(y - 1, x - 1) - math.pi / 2) == pytest.approx(1.0)


def test_a_corridor_widens_what_is_proven(tmp_path):
    space = build_empty((60, 40), "rect:0.6x0.4", rotations=36)
    for width, verdict in ((0.0, "free"), (0.25, "free"), (0.35, "undecided")):
        corridor = {"leftWidth": width, "rightWidth": 0.1}
        graph = open_order(tmp_path, (1, 0.5), (5, 0.5), corridor=corridor)
        assert cspace.lanes.audit(space, graph).lanes[0].verdict == verdict


def test_reports_hold_every_lane(floor, tmp_path):
    graph = RouteGraph.from_arrays(
        [(1, 1), (3, 1), (1, 4), (4.1, 4.8)],
        [(0, 1), (0, 2), (2, 3)],
        edge_names=["a", "b & <c>", "d\x01"],
    )
    audit = cspace.lanes.audit(floor, graph)
    assert audit.counts == {"free": 1, "blocked": 2, "undecided": 0}
    with pytest.raises(OSError, match="exists"):
        for _ in range(2):
            audit.to_csv(tmp_path / "a.csv")
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    assert [row["verdict"] for row in rows] == ["blocked", "free", "blocked"]
    assert tuple(map(float, rows[0]["at"].split())) == audit.lanes[0].at
    assert float(rows[1]["left_m"]) == audit.lanes[1].left
    assert rows[0]["left_m"] == ""
    for strict in (False, True):
        audit.to_junit(tmp_path / "a.xml", overwrite=True, strict=strict)
        suite = ElementTree.parse(tmp_path / "a.xml").getroot()
        assert (suite.get("tests"), suite.get("failures")) == ("3", "2")
        assert suite[1].get("name") == "b & <c>: 0 to 2"
        assert suite[0][0].get("message").endswith(audit.lanes[0].obstacle)
    audit.to_geojson(tmp_path / "a.geojson")
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert len(features) == 7
    assert features[0]["geometry"]["coordinates"] == [[1, 1], [3, 1]]
    assert features[3]["properties"]["turns_around"] is True
    text = str(audit)
    assert text.startswith("Audit(rectangle 0.6 m x 0.4 m: 1 free, 2 blocked, 0 undecided)\nlane")
    axes = audit.plot()
    labels = [text.get_text() for text in axes.figure.legends[0].get_texts()]
    assert {"1 free", "2 blocked", "node: turns around"} <= {*labels}
    pyplot.close(axes.figure)


def test_undecided_lanes_are_skipped_or_fail(floor, tmp_path):
    graph = RouteGraph.from_arrays([(1, 0.2), (1.5, 0.2)], [(0, 1)])  # it touches the wall
    audit = cspace.lanes.audit(floor, graph)
    assert audit.counts["undecided"] == 1
    for strict, tag in ((False, "skipped"), (True, "failure")):
        audit.to_junit(tmp_path / "a.xml", overwrite=True, strict=strict)
        assert ElementTree.parse(tmp_path / "a.xml").getroot()[0][0].tag == tag


# ---- the command line ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write a room with a wall of 0.6 m in the way, and lanes."""
    folder = tmp_path_factory.mktemp("lanes")
    occupied = np.zeros((60, 40), dtype=np.bool_)
    occupied[25, :14] = True
    np.save(folder / "room.npy", occupied)
    write(folder, "nav.geojson", NAV2)
    return folder


def audit(folder, *arguments):
    """Run the command on the room."""
    return run("audit", folder / "room.npy", folder / "nav.geojson", "--spacing=0.1", *arguments)


def test_exit_codes_tell_what_is_blocked(folder):
    slim = "--robot=rect:0.6x0.4"
    assert audit(folder, slim).exit_code == 0
    wide = audit(folder, "--footprint=[[0.4,0.8],[-0.4,0.8],[-0.4,-0.8],[0.4,-0.8]]")
    assert wide.exit_code == 1
    assert "1 blocked" in wide.stdout
    tight = "--robot=rect:0.6x1.2"  # it touches the wall
    assert audit(folder, tight).exit_code == 0
    assert audit(folder, tight, "--strict").exit_code == 2


def test_a_graph_without_lanes_does_not_pass(folder, tmp_path):
    empty = tmp_path / "empty.geojson"
    empty.write_text('{"type": "FeatureCollection", "features": []}')
    result = run("audit", folder / "room.npy", empty, "--spacing=0.1", "--robot=disc:0.2")
    assert result.exit_code == 2 and "empty.geojson has no lanes" in result.stderr


def test_a_saved_map_has_its_robot(folder):
    run("build", folder / "room.npy", "--spacing=0.1", "--robot=disc:0.3", "-o", folder / "m.zarr")
    lanes = folder / "nav.geojson"
    assert run("audit", folder / "m.zarr", lanes, "--heading=90deg").exit_code == 0
    refused = run("audit", folder / "m.zarr", lanes, "--robot=disc:0.2")
    assert refused.exit_code == 2
    assert "a saved map has one" in refused.stderr


@pytest.mark.parametrize(
    "arguments, text",
    [
        ([], "--robot is missing"),
        (["--robot=disc:0.2", "--robot=disc:0.3"], "as in NAME=SPEC"),
        (["--robot=a=disc:0.2", "--robot=a=disc:0.3"], "as in NAME=SPEC"),
        (["--robot=disc:0.2", "--heading=left"], "it must be a number of degrees or radians"),
        (["--robot=disc:0.2", "--output=a.doc"], "it must be one of .csv"),
        (["--robot=disc:0.2", "--level=L1"], ""),
    ],
)
def test_wrong_options_are_refused(arguments, text, folder):
    result = audit(folder, *arguments)
    assert text in result.stderr
    assert result.exit_code == (2 if text else 0)
