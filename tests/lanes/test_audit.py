"""Audits of route graphs, against shapely's hulls of the swept shape."""

import copy
import math
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh
from shapely import affinity

import cspace
from cspace.errors import AngleWarning
from cspace.lanes import RouteGraph
from tests.helpers.handmade import build_empty
from tests.helpers.refusals import check_refused, refusals, write
from tests.helpers.strategies import few

ROBOT = [(0.4, 0.2), (-0.3, 0.25), (-0.3, -0.2), (0.4, -0.2)]


def build(occupied, spacing=0.1, rotations=72, **options):
    workspace = cspace.Workspace.from_array(occupied, spacing)
    return cspace.build(workspace, cspace.Robot.polygon(ROBOT), rotations=rotations, **options)


@pytest.fixture(scope="module")
def rooms():
    """Return the map of two rooms of 4 m with a door of 0.8 m."""
    occupied = np.zeros((80, 50), dtype=np.bool_)
    occupied[40:42] = True
    occupied[40:42, 21:29] = False
    occupied[10:13, 30:34] = True
    return build(occupied)


@pytest.mark.parametrize(
    "forbidden, parts",
    [
        ((), [["A", "B", "C"]]),
        (("BC", "Start"), [["A", "B"], ["B", "C"]]),
        (("AB", "End"), [["A", "B"], ["B", "C"]]),
        (("BA", "Start"), [["A", "B"], ["B", "C"]]),
        (("CB", "End"), [["A", "B"], ["B", "C"]]),
        (("AB", "Start"), [["A", "B", "C"]]),
    ],
)
def test_a_turn_that_a_layout_forbids_joins_no_lanes(rooms, tmp_path, forbidden, parts):
    edges = [make_edge("AB"), make_edge("BA", math.pi), make_edge("BC"), make_edge("CB", math.pi)]
    for edge in edges:
        if forbidden and edge["edgeId"] == forbidden[0]:
            edge["vehicleTypeEdgeProperties"][0][f"rotationAt{forbidden[1]}NodeAllowed"] = "NONE"
    found = cspace.lanes.audit(rooms, open_layout(tmp_path, edges))
    assert found.counts["free"] == 4 and found.parts == parts


def test_a_turn_one_way_counts_as_a_turn_with_a_warning(tmp_path):
    edges = [make_edge("AB"), make_edge("BA")]
    edges[0]["vehicleTypeEdgeProperties"][0]["rotationAtEndNodeAllowed"] = "CCW"
    with pytest.warns(UserWarning, match="rotationAtEndNodeAllowed 'CCW'; turns both ways count"):
        assert open_layout(tmp_path, edges).lanes[0].turns == (True, True)


def open_layout(folder, edges):
    """Open a LIF layout of three nodes with edges."""
    places = {"A": (5.0, 1.0), "B": (7.0, 1.0), "C": (7.0, 3.0)}
    nodes = [{"nodeId": k, "nodePosition": {"x": x, "y": y}} for k, (x, y) in places.items()]
    layout = {"layoutId": "L", "nodes": nodes, "edges": edges, "stations": []}
    return RouteGraph.open(write(folder, "lif.json", {"metaInformation": {}, "layouts": [layout]}))


def make_edge(ends, yaw=0.0):
    """Return an edge of LIF that is driven at a yaw from its direction."""
    rule = {"vehicleTypeId": "v", "vehicleOrientation": yaw, "orientationType": "TANGENTIAL"}
    edge = {"edgeId": ends, "startNodeId": ends[0], "endNodeId": ends[1]}
    return edge | {"vehicleTypeEdgeProperties": [rule | {"rotationAllowed": False}]}


def build_on_floor(seed):
    """Return the map of a prism on a floor, and that of its footprint at its heights."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((80, 50, 8)) < 0.002
    occupied[:, :, 5:] |= rng.random((80, 50, 3)) < 0.2  # above the robot
    prism = trimesh.creation.extrude_polygon(shapely.Polygon(ROBOT), 0.3)
    robot = cspace.Robot.from_mesh(prism.apply_translation((0.0, 0.0, 0.1)))
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    space = cspace.build(workspace, robot, rotations=72, floor=0.05)
    return space, build(occupied[:, :, 1:5].any(axis=2))


def test_lanes_on_a_floor_are_those_of_the_footprint_at_the_heights_of_the_robot():
    space, flat = build_on_floor(3)
    rng = np.random.default_rng(0)
    positions = rng.uniform((0.2, 0.2), (7.8, 4.8), (40, 2))
    edges = rng.integers(0, 40, (60, 2))
    graph = RouteGraph.from_arrays(positions, edges[edges[:, 0] != edges[:, 1]])
    audit, expected = (cspace.lanes.audit(each, graph, max_room=0.4) for each in (space, flat))
    assert min(audit.counts["free"], audit.counts["blocked"]) > 5
    for mine, other in zip(audit.lanes, expected.lanes, strict=True):
        verdicts = mine.verdict, other.verdict
        assert verdicts[0] == verdicts[1] or verdicts == ("undecided", "blocked")
        rooms = np.array([(row.left, row.right, row.margin) for row in (mine, other)])
        assert (rooms[0] <= rooms[1] + 1e-6).all() and (rooms[0] >= 0.5 * rooms[1]).all()
    named = [row.obstacle for row in audit.lanes if row.verdict == "blocked"]
    places = [re.findall(r"-?[0-9.]+", text) for text in named if "obstacle at" in text]
    assert places
    for place in np.array(places, dtype=float):
        assert space.workspace.outer[tuple(space.workspace.grid.cell_of(place))]
        assert 0.1 < place[2] < 0.5
    space.update(cspace.Workspace.from_array(np.zeros((80, 50, 8), dtype=bool), 0.1))
    space.add_obstacle("lamp", trimesh.creation.box(bounds=[(2, 0, 0.55), (3, 5, 0.7)]))
    space.add_obstacle("shelf", trimesh.creation.box(bounds=[(3, 0, 0.3), (4, 5, 0.6)]))
    lane = RouteGraph.from_arrays([(1.0, 2.5), (7.0, 2.5)], [(0, 1)])
    (row,) = cspace.lanes.audit(space, lane).lanes
    assert (row.verdict, row.obstacle) == ("blocked", "'shelf'")
    assert 2.6 <= row.at[0] <= 4.3


def test_conflicts_on_a_floor_are_where_footprints_meet():
    space, flat = build_on_floor(3)
    nodes = np.random.default_rng(4).uniform((0.5, 0.5), (7.5, 4.5), (8, 2))
    graph = RouteGraph.from_arrays(nodes, [(0, 1), (2, 3), (4, 5), (6, 7)])
    found, expected = (cspace.lanes.conflicts(each, graph) for each in (space, flat))
    meeting = {(row.first, row.second) for row in expected.pairs}
    assert {(row.first, row.second) for row in found.pairs} == meeting and meeting
    # A robot may pass under another, so that nothing is proven where footprints meet.
    assert {row.verdict for row in found.pairs} == {"undecided"}


def test_a_robot_without_a_yaw_that_is_round_from_above_alone_has_no_lanes():
    base = trimesh.creation.cylinder(0.4, 0.2, sections=24)
    mast = trimesh.creation.box((0.5, 0.1, 0.3))
    mast.apply_translation((0.0, 0.0, 0.2))
    robot = cspace.Robot.from_mesh(trimesh.util.concatenate([base, mast]))
    workspace = cspace.Workspace.from_array(np.zeros((40, 40, 8), dtype=bool), 0.1)
    graph = RouteGraph.from_arrays([(1.0, 1.0), (3.0, 3.0)], [(0, 1)])
    space = cspace.build(workspace, robot, floor=0.2)
    check_refused(lambda: cspace.lanes.audit(space, graph), "turns on the lane")
    round_robot = cspace.Robot.cylinder(0.3, 0.4)
    space = cspace.build(workspace, round_robot, floor=0.3)
    assert cspace.lanes.audit(space, graph).counts["free"] == 1


def test_a_lane_pushed_into_a_wall_by_a_centimetre_is_blocked(rooms):
    for y, verdict in ((0.201, "free"), (0.19, "blocked")):
        graph = RouteGraph.from_arrays([(1, y), (3, y)], [(0, 1)])
        (row,) = cspace.lanes.audit(rooms, graph).lanes
        assert row.verdict == verdict
    assert row.obstacle == "the border of the map"
    assert row.at[:2] == (1, 0.19)


@pytest.mark.parametrize("row", [14, 15, 16, 24, 25, 26])
def test_no_post_is_skipped_beside_a_lane(row):
    # A post of one cell, and a robot smaller than a cell, fit between wide strips.
    occupied = np.zeros((60, 40), dtype=np.bool_)
    occupied[30, row] = True
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), "disc:0.02")
    graph = RouteGraph.from_arrays([(2, 2), (4, 2)], [(0, 1)])
    (lane,) = cspace.lanes.audit(space, graph).lanes
    beside = abs(0.1 * row + 0.05 - 2.0) - 0.05 - 0.02
    room = lane.left if row > 20 else lane.right
    assert beside - 0.2 <= room <= beside
    assert beside - 0.2 <= lane.margin <= beside
    assert max(lane.left, lane.right) == 1.0


@pytest.mark.parametrize("post", [(3.85, 3.0), (3.6, 3.6), (1.0, 1.4), (2.6, 3.4)])
def test_margins_hold_around_the_ends_of_diagonal_lanes(post):
    box = shapely.box(*np.subtract(post, 0.005), *np.add(post, 0.005))
    with pytest.warns(cspace.UnitWarning):  # of a box smaller than a cell
        workspace = cspace.Workspace.from_polygons([box], spacing=0.05, bounds=(-1, -1, 6, 6))
    space = cspace.build(workspace, "disc:0.07")
    graph = RouteGraph.from_arrays([(2, 2), (3, 3)], [(0, 1)])
    (row,) = cspace.lanes.audit(space, graph, max_room=2.0).lanes
    truth = shapely.LineString([(2, 2), (3, 3)]).distance(box) - 0.07
    assert truth - 0.15 <= row.margin <= truth


def test_an_asymmetric_robot_differs_backwards():
    occupied = np.zeros((40, 20), dtype=np.bool_)
    space = build(occupied)
    for heading, verdict in (("forward", "blocked"), ("backward", "free"), ("both", "blocked")):
        graph = RouteGraph.from_arrays([(1, 1), (3.65, 1)], [(0, 1)], heading)
        assert cspace.lanes.audit(space, graph).lanes[0].verdict == verdict


THROUGH_DOOR = [(3.0, 2.5), (5.0, 2.5)]
"""A door of 0.8 m, for a robot 0.7 m long."""

BESIDE_WALL = [(1.0, 0.3), (3.0, 0.3)]


@pytest.mark.parametrize(
    "nodes, heading, yaw, verdict",
    [
        *((THROUGH_DOOR, way, math.nan, "free") for way in ("forward", "backward", "both", 0.0)),
        *((THROUGH_DOOR, way, math.nan, "blocked") for way in ("any", math.radians(45))),
        (BESIDE_WALL, "forward", math.nan, "free"),
        (BESIDE_WALL, "forward", math.pi / 2, "blocked"),
    ],
)
def test_headings_and_yaws_of_nodes_decide_the_yaw(rooms, nodes, heading, yaw, verdict):
    graph = RouteGraph.from_arrays(nodes, [(0, 1)], heading, yaws=(yaw, math.nan))
    assert cspace.lanes.audit(rooms, graph).lanes[0].verdict == verdict


def test_a_node_with_a_range_of_yaws_needs_the_turns_to_both_ends_of_it():
    """The lane has the yaw 0, and the node those from 0.5 to 3.5 rad."""
    space = build_empty((80, 60), cspace.Robot.rectangle(1.0, 0.1, (0.5, 0.0)), rotations=72)
    graph = RouteGraph.from_arrays([(3, 3), (4, 3)], [(0, 1)], yaws=[2.0, math.nan])
    graph = replace(graph, yaw_deviations={"0": 1.5})
    assert cspace.lanes.audit(space, graph).lanes[0].verdict == "free"
    for angle in (0.25, 2.0, 5.0):
        tip = 3.0 + 0.9 * np.array([math.cos(angle), math.sin(angle)])
        space.add_obstacle("post", shapely.Point(tip).buffer(0.05))
        assert cspace.lanes.audit(space, graph).lanes[0].verdict == "blocked"


@pytest.mark.parametrize("turn", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_lanes_join_at_one_yaw_however_it_is_written(turn):
    # A corridor in which the robot fits at one yaw, driven one way ahead and the other in reverse.
    walls = [shapely.box(0, 0, 6, 2.795), shapely.box(0, 3.205, 6, 6)]
    walls = [affinity.rotate(wall, turn, (3, 3), use_radians=True) for wall in walls]
    workspace = cspace.Workspace.from_polygons(walls, spacing=0.1, bounds=(0, 0, 6, 6))
    space = cspace.build(workspace, "rect:0.6x0.4", rotations=24)
    ahead = np.array([math.cos(turn), math.sin(turn)])
    nodes = [3.0 - 2.0 * ahead, (3.0, 3.0), 3.0 + 2.0 * ahead]
    edges, headings = [(0, 1), (1, 0), (1, 2), (2, 1)], ["forward", "backward", turn, turn]
    audit = cspace.lanes.audit(space, RouteGraph.from_arrays(nodes, edges, headings))
    assert audit.counts["free"] == 4
    assert not len(audit.nodes[1].free_yaws)
    assert audit.parts == [["0", "1", "2"]]


def test_lanes_without_length_and_loops_and_borders(rooms):
    nodes = [(2, 1), (0.0, 2.5), (8.0, 2.5), (20.0, 2.5), (2, 1)]
    edges = [(0, 0), (0, 4), (0, 1), (0, 2), (0, 3)]
    audit = cspace.lanes.audit(rooms, RouteGraph.from_arrays(nodes, edges))
    verdicts = [row.verdict for row in audit.lanes]
    assert verdicts == ["free", "free", "blocked", "blocked", "blocked"]
    assert audit.nodes[0].turns_around
    assert not len(audit.nodes[1].free_yaws)
    fixed = RouteGraph.from_arrays(nodes, [(0, 0)], 1.0)
    assert cspace.lanes.audit(rooms, fixed).lanes[0].verdict == "free"
    empty = cspace.lanes.audit(rooms, RouteGraph.from_arrays(np.empty((0, 2)), np.empty((0, 2))))
    assert empty.lanes == empty.parts == []
    assert "0 free" in str(empty)


def test_nodes_turn_around_where_there_is_room(rooms):
    nodes = [(4.1, 2.5), (2, 1), (0.35, 2.5), (1.0, 2.75)]
    audit = cspace.lanes.audit(rooms, RouteGraph.from_arrays(nodes, []))
    assert [row.turns_around for row in audit.nodes] == [False, True, False, False]


def test_named_obstacles_are_named_where_the_robot_meets_them():
    space = build(np.zeros((200, 40), dtype=np.bool_))
    graph = RouteGraph.from_arrays([(1, 2), (19, 2), (1, 3)], [(0, 1), (0, 2)])
    for width in (0.5, 0.04):  # no cell lies in the thin one
        space.add_obstacle("crate", shapely.box(17.03, 1.5, 17.03 + width, 2.5))
        first, second = cspace.lanes.audit(space, graph).lanes
        assert first.obstacle == "'crate'" and 16.6 <= first.at[0] <= 17.9
        assert second.verdict == "free"


def test_polygons_are_exact_obstacles():
    walls = [shapely.box(0, 0, 4, 0.523), shapely.box(0, 1.0, 4, 1.5)]
    bounds = (0, 0, 4, 1.5)
    workspace = cspace.Workspace.from_polygons(walls, spacing=0.1, bounds=bounds)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.5, 0.4), rotations=36)
    for y, verdict in ((0.76, "free"), (0.715, "blocked"), (0.805, "blocked")):
        graph = RouteGraph.from_arrays([(1, y), (3, y)], [(0, 1)])
        (row,) = cspace.lanes.audit(space, graph).lanes
        assert row.verdict == verdict, y


@pytest.mark.filterwarnings("ignore:the robot is")
def test_a_robot_without_an_inside_is_audited():
    wall = shapely.box(2.03, 0, 2.17, 3)
    workspace = cspace.Workspace.from_polygons([wall], spacing=0.1, bounds=(0, 0, 4, 3))
    space = cspace.build(workspace, cspace.Robot.disc(1e-8))
    graph = RouteGraph.from_arrays([(1, 1), (1.5, 1), (2.03, 1)], [(0, 1), (1, 2)])
    verdicts = [row.verdict for row in cspace.lanes.audit(space, graph).lanes]
    assert verdicts == ["free", "undecided"]


@pytest.mark.parametrize("degrees", [30.0, 32.5])
def test_yaws_between_those_of_a_part_are_proven(degrees):
    # The corner is nearest to the wall in the middle of a part of 5 degrees, or between two.
    slope = math.radians(degrees)
    robot = cspace.Robot.rectangle(0.6, 0.6 * math.tan(slope))
    wall = shapely.box(0, 0, 4, 0.5)
    workspace = cspace.Workspace.from_polygons([wall], spacing=0.1, bounds=(0, 0, 4, 2))
    space = cspace.build(workspace, robot, rotations=72)
    reach = 0.3 / math.cos(slope)
    assert reach * math.cos(math.radians(2.5)) < reach - 3e-4
    for gap, is_free in ((0.05, True), (-2e-4, False), (-0.02, False)):
        y = 0.5 + reach + gap
        graph = RouteGraph.from_arrays([(1, y), (3, y)], [(0, 1), (0, 0)], "any")
        lanes = cspace.lanes.audit(space, graph).lanes
        assert [row.verdict == "free" for row in lanes] == [is_free] * 2, gap


def test_a_map_without_a_yaw_is_for_a_round_robot_or_one_that_never_turns():
    disc, bar = (build_empty((40, 30), robot) for robot in ("disc:0.3", "rect:0.6x0.2"))
    nodes, edges = [(1, 1), (3, 2)], [(0, 1)]
    along = RouteGraph.from_arrays(nodes, edges)
    still = RouteGraph.from_arrays(nodes, edges, 0.0, yaws=[0.0, math.nan])
    turned = RouteGraph.from_arrays(nodes, edges, 0.0, yaws=[0.0, 1.5])
    ranged = replace(still, yaw_deviations={"0": 0.1})
    for graph, message in (
        (along, "space has no yaw, but rectangle 0.6 m x 0.2 m turns on the ... needed"),
        (turned, "has the yaw 1.5 at the node '1'"),
        (ranged, "has the yaw -0.1 at the node '0'"),
    ):
        audit = cspace.lanes.audit(disc, graph)
        assert audit.lanes[0].verdict == "free" and audit.nodes[0].turns_around
        check_refused(lambda graph=graph: cspace.lanes.audit(bar, graph), message)
    standing = cspace.lanes.audit(bar, still)
    assert standing.lanes[0].verdict == "free" and not standing.nodes[0].turns_around
    np.testing.assert_array_equal(standing.nodes[0].free_yaws, [[0.0, 0.0]])


def test_tiles_give_the_verdicts_of_memory(tmp_path):
    rng = np.random.default_rng(3)
    occupied = rng.random((120, 90)) < 0.004
    whole = build(occupied, rotations=24)
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    robot = cspace.Robot.polygon(ROBOT)
    tiled = cspace.build(workspace, robot, rotations=24, store=tmp_path / "map.zarr", tile=40)
    positions = rng.uniform((0, 0), (12, 9), (15, 2))
    graph = RouteGraph.from_arrays(positions, rng.integers(0, 15, (25, 2)), two_way=True)
    one, other = cspace.lanes.audit(whole, graph), cspace.lanes.audit(tiled, graph)
    assert [row[3] for row in one.lanes] == [row[3] for row in other.lanes]
    assert one.parts == other.parts
    assert one.lost == other.lost


@pytest.mark.parametrize("far", few([20.0, 1e100, 1e6, 1e15], 2))
@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("tile", few([None, 32]))
def test_a_node_far_outside_is_named_at_once(tmp_path, far, outside, tile):
    options = {"store": tmp_path / "map", "tile": tile} if tile else {}
    space = build_empty((60, 60), "rect:0.6x0.4", rotations=24, outside=outside, **options)
    for node in ((far, 5.0), (-far, far), (3.0, -far)):
        graph = RouteGraph.from_arrays([(1, 1), (5, 5), node], [(0, 1), (1, 2), (2, 0)])
        audit = cspace.lanes.audit(space, graph)
        near, *others = audit.lanes
        assert near.verdict == "free"
        if outside == "blocked":
            assert {row.verdict for row in others} == {"blocked"}
            assert {row.obstacle for row in others} == {"node 2 lies outside the map"}
        else:
            assert "blocked" not in {row.verdict for row in others}


def test_audits_are_pickled_and_copied(rooms):
    graph = RouteGraph.from_arrays([(1, 1), (3, 1), (7, 1)], [(0, 1), (1, 2)])
    audit = cspace.lanes.audit(rooms, graph)
    for twin in (pickle.loads(pickle.dumps(audit)), copy.deepcopy(audit)):
        assert str(twin) == str(audit)


@refusals(
    "arguments, message",
    (([(0, 1)],), "graph is a list ... RouteGraph"),
    ((RouteGraph.from_arrays([(1, 1)], []), "map"), "space is a str ... map"),
    (
        (RouteGraph.from_arrays([(1, 1)], []), build_empty((9, 9, 9), "ball:0.1")),
        "space has the axes x, y, z ... lanes",
    ),
)
def test_wrong_arguments_are_refused(rooms, arguments, message):
    graph, space = (*arguments, rooms)[:2]
    check_refused(lambda: cspace.lanes.audit(space, graph), message)


def test_yaws_in_degrees_are_named_once(rooms):
    with pytest.warns(AngleWarning) as caught:
        graph = RouteGraph.from_arrays([(1.0, 0.3), (3.0, 0.3)], [(0, 1)], 450.0, yaws=(90, 180))
        cspace.lanes.audit(rooms, graph)
    assert [str(each.message).partition(":")[0] for each in caught] == ["headings", "yaws"]
    np.testing.assert_allclose(np.cos(graph.yaws), np.cos([90, 180]), atol=1e-12)
