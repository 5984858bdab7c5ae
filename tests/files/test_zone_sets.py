"""Zone sets of VDA 5050 as obstacles."""

import json

import pytest
import shapely

import cspace
from tests.helpers.orders import SQUARE, make_zone, make_zone_set
from tests.helpers.refusals import check_refused, refusals


def test_blocked_zones_are_obstacles(tmp_path):
    corners = [(3.0, 0.0), (4.0, 0.0), (3.0, 3.0)]
    document = make_zone_set(
        make_zone("a", "BLOCKED"),
        make_zone("b", "SPEED_LIMIT", maximumSpeed=0.5),
        make_zone("c", "BLOCKED", corners[::-1]),  # clockwise
        make_zone("d", "RELEASE", releaseLossBehavior="STOP"),
        make_zone("e", "RELEASE", releaseLossBehavior="STOP"),
    )
    path = tmp_path / "zones.json"
    path.write_text(json.dumps(document))
    areas = [shapely.Polygon(SQUARE), shapely.Polygon(corners)]
    expected = cspace.Workspace.from_polygons(areas, 0.1)
    warning = r"only zones of type BLOCKED are read here, not 2 RELEASE, 1 SPEED_LIMIT$"
    for read in (
        lambda: cspace.Workspace.open(path, spacing=0.1),
        lambda: cspace.Workspace.from_polygons(document, 0.1),
    ):
        with pytest.warns(UserWarning, match=warning):
            workspace = read()
        assert (workspace.outer == expected.outer).all()
        assert (workspace.inner == expected.inner).all()


@refusals(
    "document, message",
    (make_zone_set(), "polygons: the zone set has no zone of type BLOCKED ... zones"),
    (
        make_zone_set(make_zone("a", "SPEED_LIMIT", maximumSpeed=1.0)),
        "polygons: the zone set has no zone of type BLOCKED ... SPEED_LIMIT",
    ),
    (make_zone_set(make_zone("a", "BLOCKED", SQUARE[:2])), "zone 'a' has 2 vertices"),
    (make_zone_set(make_zone("a", "RELEASE", SQUARE[:2])), "zone 'a' has 2 vertices; it"),
    (make_zone_set(make_zone("a", None)), "zone 'a' has no zoneType"),
    (
        make_zone_set(make_zone("a", "BLOCKED", [(0, 0), (1, 1), (0, 1), (1, 0)])),
        "zone 'a' is not valid: Self-intersection",
    ),
    (make_zone_set(make_zone("a", "BLOCKED", [(0, 0), ("1", 1), (0, 1)])), "without quotes"),
    (make_zone_set(make_zone("a", ["BLOCKED"])), "polygons, zone 'a' is ['BLOCKED']"),
    (
        make_zone_set(make_zone("a", "BLOCKED"), make_zone("b", "BLOCKD")),
        "polygons, zone 'b' is 'BLOCKD' ... BLOCKED, LINE_GUIDED, RELEASE",
    ),
    (make_zone_set(make_zone("a", "BLOCKED"), make_zone("b", "blocked")), "did you mean 'BLOCKED'"),
    (make_zone_set({"zoneType": "BLOCKED"}), "has no zoneId"),
    ({"zoneSet": []}, "polygons: the zone set.zoneSet is [] ... values"),
    ({"zoneSet": {"zones": {}}}, "polygons: the zone set.zoneSet has the zones {} ... list"),
)
def test_malformed_zone_sets_are_refused(document, message):
    check_refused(lambda: cspace.Workspace.from_polygons(document, 0.1), message)
