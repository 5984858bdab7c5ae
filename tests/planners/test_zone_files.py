"""Zones of speed from files: GeoJSON, zone sets of VDA 5050, and masks of Nav2.

Oracles: shapely on the plain content of the files, and Nav2's formula for each cell of a mask.
"""

import numpy as np
import pytest
import shapely

import cspace
import planners
from cspace.errors import FileError, UnitWarning
from tests.helpers.handmade import build_empty
from tests.helpers.messages import write_map
from tests.helpers.orders import make_zone, make_zone_set
from tests.helpers.refusals import check_refused, refusals, write

LIMITS = {"max_velocity": 1.0, "max_acceleration": 0.8}
AREAS = [
    shapely.box(2.0, 1.0, 4.0, 5.0) - shapely.box(2.5, 1.5, 3.0, 4.5),
    shapely.MultiPolygon([shapely.box(5.0, 2.0, 6.0, 4.0), shapely.box(8.0, 0.0, 9.0, 3.0)]),
    shapely.Polygon([(3.5, 3.0), (3.5, 4.0), (5.5, 3.5)]),  # clockwise
]
SPEEDS = [0.4, 0.2, 0.6]


def build_hall(robot=None):
    """Return the map of an empty hall of 10 m x 6 m."""
    return build_empty((100, 60), robot or cspace.Robot.disc(0.3))


def make_features(areas=AREAS, speeds=SPEEDS, **members):
    """Return GeoJSON of areas with speeds."""
    features = [
        {
            "type": "Feature",
            "properties": {"name": "z", "top": speed},
            "geometry": shapely.geometry.mapping(area),
        }
        for area, speed in zip(areas, speeds, strict=True)
    ]
    return {"type": "FeatureCollection", "features": features, **members}


@pytest.mark.parametrize("within", ["contour", "point"])
def test_geojson_has_the_speed_of_a_property(tmp_path, within):
    path = write(tmp_path, "zones.geojson", make_features())
    zones = planners.SpeedZones.open(path, speed="top", within=within, frame_id="map")
    assert [speed for _, speed in zones.zones] == SPEEDS
    assert all(mine.equals(area) for (mine, _), area in zip(zones.zones, AREAS, strict=True))
    assert (zones.within, zones.frame_id) == (within, "map")
    # One feature is a document as well.
    single = write(tmp_path, "zone.json", make_features()["features"][0])
    assert planners.SpeedZones.open(single, speed="top").zones == zones.zones[:1]


@pytest.mark.parametrize(
    "name, factor",
    [
        *(("top", 1.0), ("top_m_s", 1.0), ("speed [m/s]", 1.0), ("topMps", 1.0), ("rooms", 1.0)),
        *(("maxspeed_kmh", 1 / 3.6), ("speed [km/h]", 1 / 3.6), ("maxSpeedKMH", 1 / 3.6)),
        *(("kph", 1 / 3.6), ("km per hour", 1 / 3.6), ("speed_m_min", 1 / 60)),
        *(("top_mm_s", 1e-3), ("v (mm/sec)", 1e-3), ("cm_per_s", 1e-2)),
        *(("limit_mph", 0.44704), ("fps", 0.3048), ("v_ft_s", 0.3048), ("miles per hour", 0.44704)),
        *(("speed_knots", 1852 / 3600), ("speed_kn", 1852 / 3600), ("topKts", 1852 / 3600)),
        *(("speed_fpm", 0.3048 / 60), ("feet/minute", 0.3048 / 60), ("kmph", 1 / 3.6)),
        *(("maxspeed:mph", 0.44704), ("speed_kmhr", 1 / 3.6), ("v_mpm", 1 / 60), ("v_ips", 0.0254)),
        *(("speedMetersPerSecond", 1.0), ("speed_kilometres_per_hour", 1 / 3.6), ("known", 1.0)),
        *(("inches_per_second", 0.0254), ("centimeter/sec", 1e-2), ("min_speed", 1.0)),
    ],
)
def test_a_speed_has_the_unit_of_its_property(tmp_path, name, factor):
    document = make_features()
    for feature in document["features"]:
        feature["properties"] = {name: feature["properties"]["top"]}
    path = write(tmp_path, "zones.geojson", document)
    found = [speed for _, speed in planners.SpeedZones.open(path, speed=name).zones]
    assert found == pytest.approx([factor * speed for speed in SPEEDS])


@pytest.mark.parametrize("name", ["speed_percent", "topPct", "speed [%]", "speed_factor", "share"])
def test_a_share_of_a_speed_is_refused(tmp_path, name):
    document = make_features()["features"][0]
    document["properties"] = {name: 50}
    path = write(tmp_path, "zones.geojson", document)
    message = f"speed is {name!r} ... not a share"
    check_refused(lambda: planners.SpeedZones.open(path, speed=name), message)


@pytest.mark.parametrize("name", ["maxspeed", "maxspeed:forward"])
def test_speeds_of_openstreetmap_are_in_kilometres_an_hour(tmp_path, name):
    document = make_features()["features"][0]
    document["properties"] = {name: 5}
    path = write(tmp_path, "zones.geojson", document)
    with pytest.warns(UserWarning, match=f"{name} is taken as km/h, as in OpenStreetMap"):
        ((_, speed),) = planners.SpeedZones.open(path, speed=name).zones
    assert speed == pytest.approx(5 / 3.6)


def test_speed_limits_of_a_zone_set_are_read(tmp_path):
    corners = [area.exterior.coords[:-1] for area in (AREAS[0], AREAS[2])]
    document = make_zone_set(
        make_zone("a", "SPEED_LIMIT", corners[0], maximumSpeed=0.4),
        make_zone("b", "BLOCKED", [(7.0, 5.0), (8.0, 5.0), (8.0, 6.0)]),
        make_zone("c", "SPEED_LIMIT", corners[1], maximumSpeed=0.6),
        make_zone("d", "DIRECTED", corners[1], direction=0.0, directedLimitation="SOFT"),
    )
    path = write(tmp_path, "zones.json", document)
    with pytest.warns(UserWarning, match="of type SPEED_LIMIT are read here, not 1 BLOCKED, 1 DIR"):
        zones = planners.SpeedZones.open(path)
    expected = (shapely.Polygon(corners[0]), 0.4), (shapely.Polygon(corners[1]), 0.6)
    assert zones.within == "contour" and zones.zones == expected


def find_limit(value, unit, base, multiplier):
    """Return the limit that Nav2's speed filter publishes for a cell, and 0 for none."""
    if value in (0, -1):
        return 0.0
    limit = value * multiplier + base
    if limit < 0.0 or (unit == "percent" and limit > 100.0):
        return 0.0
    return limit


@pytest.mark.parametrize(
    "unit, base, multiplier",
    [("percent", 0.0, 1.0), ("percent", 100.0, -1.0), ("percent", -20.0, 2.0), ("m/s", 0.1, 0.015)],
)
def test_each_cell_of_a_mask_has_the_limit_of_nav2(tmp_path, unit, base, multiplier):
    values = np.random.default_rng(7).integers(0, 106, (12, 20), dtype=np.uint8)
    path = write_map(tmp_path, values, mode="raw", origin=[0.0, 0.0, 0.0])
    top = 1.5 if unit == "percent" else None
    given = {"unit": unit, "base": base, "multiplier": multiplier, "max_velocity": top}
    with pytest.warns(UserWarning, match=r"^mask: cells without a limit, as in Nav2, are unknown"):
        zones = planners.SpeedZones.from_mask(path, **given)
    assert zones.within == "point"
    rows, columns = np.indices(values.shape).reshape(2, -1)
    centers = np.column_stack([0.5 * (columns + 0.5), 0.5 * (12 - rows - 0.5)])
    seen = np.where(values <= 100, values.astype(int), -1).ravel().tolist()
    limits = np.array([find_limit(value, unit, base, multiplier) for value in seen])
    expected = np.where(limits > 0.0, limits * (0.015 if top else 1.0), np.inf)
    found = zones.largest_speed(build_hall(), centers)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    # A message says the same.
    msg = cspace.ros.OccupancyGrid()
    msg.header.frame_id = "map"
    msg.info.height, msg.info.width, msg.info.resolution = 12, 20, 0.5
    msg.data.extend(np.reshape(seen, (12, 20))[::-1].ravel().tolist())
    with pytest.warns(UserWarning, match="cells without a limit"):
        same = planners.SpeedZones.from_mask(msg, **given)
    assert same.frame_id == "map" and same.zones == zones.zones


def test_zones_of_a_mask_are_in_its_frame():
    msg = cspace.ros.OccupancyGrid()
    msg.header.frame_id = "odom"
    msg.info.height, msg.info.width, msg.info.resolution = 1, 2, 3.0
    msg.data.extend([50, 0])
    zones = planners.SpeedZones.from_mask(msg, "percent", max_velocity=1.0)
    plan = planners.plan(build_hall(), (0.5, 3.3), (9.5, 3.3))
    check_refused(lambda: plan.trajectory(**LIMITS, speed=zones), "speed has the frame 'odom'")


def test_coordinates_like_degrees_are_warned_of_once(tmp_path):
    areas = [shapely.box(8.54 + x, 47.37, 8.5403 + x, 47.3702) for x in (0.0, 0.01, 0.02)]
    path = write(tmp_path, "zones.geojson", make_features(areas))
    with pytest.warns(UnitWarning) as caught:
        planners.SpeedZones.open(path, speed="top")
    assert len(caught) == 1


def change(index=0, **properties):
    """Return features, one with other properties."""
    document = make_features()
    document["features"][index]["properties"] |= properties
    return document


def replace_properties(properties):
    """Return features, the first one with malformed properties."""
    document = make_features()
    document["features"][0]["properties"] = properties
    return document


def open_zones(path, document, name="zones.geojson", **options):
    """Write and open zones."""
    return planners.SpeedZones.open(write(path, name, document), **options)


@refusals(
    "document, speed, message",
    (make_features(), None, "speed is missing ... property"),
    (make_features(), "Top", "there are name, top; did you mean 'top'?"),
    (change(1, top=0.0), "top", "feature 1, is 0.0; it must be one number above zero, in m/s"),
    (replace_properties(["top"]), "top", "there is none"),
    (replace_properties(None), None, "speed is missing ... feature"),
    (
        make_features(crs={"properties": {"name": "EPSG:4326"}}),
        "top",
        "zones.geojson has the coordinate reference system EPSG:4326 ... ground",
    ),
    (make_features([shapely.LineString([(0, 0), (1, 1)])], [0.4]), "top", "part without area"),
    (make_features([shapely.Polygon([(0, 0), (1, 1), (0, 1), (1, 0)])], [0.4]), "top", "feature 0"),
    (make_features([], []), "top", "holds no geometry"),
    (shapely.geometry.mapping(AREAS[0]), "top", "there is none"),
    (
        {"type": "FeatureCollection", "features": {}},
        "top",
        "zones.geojson has features {} ... list",
    ),
    ([1, 2], "top", "holds a JSON list"),
    (make_zone_set(make_zone("a", "SPEED_LIMIT", maximumSpeed=1.0)), "top", "have maximumSpeed"),
    (make_zone_set(make_zone("a", "SPEED_LIMIT", maximumSpeed=0)), None, "of zone 'a' is 0; it"),
    (make_zone_set(make_zone("a", "SPEED_LIMIT")), None, "zone 'a' has no maximumSpeed"),
    (
        make_zone_set(
            make_zone("a", "SPEED_LIMIT", maximumSpeed=1.0),
            make_zone("b", "SPEED_LIMIT", [(0, 0), (1, 1), (0, 1), (1, 0)], maximumSpeed=1.0),
        ),
        None,
        "zone 'b' is not valid",
    ),
)
def test_zones_without_a_good_speed_are_refused(tmp_path, document, speed, message):
    check_refused(lambda: open_zones(tmp_path, document, speed=speed), message)


def test_files_of_other_kinds_are_refused(tmp_path):
    message = "with suffix '.yaml'; the suffix selects the format, and from_mask reads masks"
    check_refused(lambda: planners.SpeedZones.open(tmp_path / "mask.yaml"), message)
    check_refused(lambda: planners.SpeedZones.open(tmp_path / "a.json"), "does not exist")


@refusals(
    "options, message",
    ({"unit": "mph"}, "unit is 'mph' ... 'percent' or 'm/s'"),
    ({"unit": "percent"}, "max_velocity is missing ... largest"),
    ({"unit": "percent", "max_velocity": 0.0}, "max_velocity is 0.0"),
    ({"unit": "m/s", "max_velocity": 1.0}, "max_velocity is 1.0 ... for per cent"),
    ({"unit": "m/s", "base": np.nan}, "base is nan"),
    ({"unit": "m/s", "multiplier": np.inf}, "multiplier is inf"),
    (
        {"unit": "m/s", "multiplier": -1.0},
        "mask has no cell with a limit ... -60",
    ),
    (
        {"unit": "percent", "max_velocity": 1.0, "multiplier": 2.0},
        "mask has no cell with a limit ... 120",
    ),
)
def test_masks_without_a_good_limit_are_refused(tmp_path, options, message):
    pixels = np.array([[60, 0], [0, 0]], dtype=np.uint8)
    path = write_map(tmp_path, pixels, mode="raw")
    check_refused(lambda: planners.SpeedZones.from_mask(path, **options), message)


def test_a_mask_without_its_image_is_refused(tmp_path):
    path = write_map(tmp_path, np.zeros((2, 2), np.uint8), mode="raw", image="gone.pgm")
    with pytest.raises(FileError, match=r"gone\.pgm: does not exist"):
        planners.SpeedZones.from_mask(path, "m/s")
