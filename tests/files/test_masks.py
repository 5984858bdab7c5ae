"""Masks of Nav2's costmap filters, as polygons.

Oracle: the formula of Nav2's map server, cell by cell.
"""

import math

import numpy as np
import pytest
import shapely
from PIL import Image

import cspace
from tests.helpers.messages import as_mapping, make_message, write_map
from tests.helpers.refusals import check_refused, refusals

THRESHOLDS = {"occupied_thresh": 0.93, "free_thresh": 0.07}


def read_shade(level, mode, negate=0, occupied_thresh=0.93, free_thresh=0.07):
    """Return the value of a pixel of 8 bits."""
    if mode == "raw":
        return level if level <= 100 else -1
    p = level / 255 if negate else 1 - level / 255
    if p >= occupied_thresh:
        return 100
    if p <= free_thresh:
        return 0
    if mode != "scale":
        return -1
    return round(100 * (p - free_thresh) / (occupied_thresh - free_thresh))


def list_values(mask, centers):
    """Return the value of a mask at each point, 0 outside its areas."""
    values = np.zeros(len(centers), dtype=int)
    for value, area in mask.areas.items():
        inside = shapely.intersects_xy(area, *centers.T)
        assert not values[inside].any()
        values[inside] = value
    return values


@pytest.mark.parametrize("yaw", [0.0, 0.7])
@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("mode", [None, "trinary", "scale", "raw"])
def test_each_pixel_has_its_value(tmp_path, mode, negate, yaw):
    if mode == "raw" and negate:
        return
    rng = np.random.default_rng(3)
    pixels = rng.integers(0, 256, (17, 23), dtype=np.uint8)
    alpha = np.where(rng.random((17, 23)) < 0.1, 128, 255)
    pixels[:2] = pixels[0, 0]
    rgba = np.dstack([pixels] * 3 + [alpha]).astype(np.uint8)
    origin = [-3.0, 7.0, yaw]
    path = write_map(tmp_path, rgba, mode=mode, negate=negate, origin=origin, **THRESHOLDS)
    mask = cspace.ros.read_mask(path)
    rows, columns = np.indices((17, 23)).reshape(2, -1)
    x, y = 0.5 * (columns + 0.5), 0.5 * (17 - rows - 0.5)
    cos, sin = math.cos(yaw), math.sin(yaw)
    centers = np.column_stack([x * cos - y * sin - 3.0, x * sin + y * cos + 7.0])
    shades = [read_shade(level, mode, negate) for level in pixels.ravel().tolist()]
    expected = np.where(alpha.ravel() < 255, -1, shades)
    np.testing.assert_array_equal(list_values(mask, centers), expected)
    assert mask.areas.keys() == set(expected.tolist()) - {0}
    # Areas are exactly their cells.
    for value, area in mask.areas.items():
        assert area.is_valid
        assert area.area == pytest.approx(0.25 * np.count_nonzero(expected == value))
    assert mask.frame_id == ""


def test_a_message_is_read_in_its_frame():
    values = np.random.default_rng(5).integers(-1, 101, (6, 9))
    msg = as_mapping(make_message(values, float(np.float32(0.05)), (1.0, 2.0)))
    msg["header"] = {"frame_id": "hall"}
    mask = cspace.ros.read_mask(msg)
    y, x = np.indices(values.shape).reshape(2, -1)
    centers = np.column_stack([1.0 + 0.05 * (x + 0.5), 2.0 + 0.05 * (y + 0.5)])
    np.testing.assert_array_equal(list_values(mask, centers), values.ravel())
    assert mask.frame_id == "hall"
    msg["data"][:2] = [101, -128]
    with pytest.warns(UserWarning, match="2 values are beyond -1 to 100 and count as unknown"):
        beyond = cspace.ros.read_mask(msg)
    assert list_values(beyond, centers[:2]).tolist() == [-1, -1]


def test_an_image_that_loses_shades_is_warned_of(tmp_path):
    path = write_map(tmp_path, np.full((8, 8), 90, dtype=np.uint8), mode="scale", image="m.jpg")
    Image.fromarray(np.full((8, 8), 90, dtype=np.uint8)).save(tmp_path / "m.jpg")
    with pytest.warns(UserWarning, match="is a JPEG"):
        cspace.ros.read_mask(path)


@refusals(
    "source, message",
    (lambda path: path.with_name("none.yaml"), "does not exist"),
    (lambda path: write_map(path.parent, np.zeros((2, 2), np.uint8), image="x.png"), "x.png"),
    (lambda path: write_map(path.parent, np.zeros((2, 2), np.uint8), mode="ternary"), "mode"),
    (lambda path: {"info": {}}, "info"),
    (lambda path: 5, "mask is 5 ... fields and values"),
)
def test_masks_that_are_none_are_refused(tmp_path, source, message):
    check_refused(lambda: cspace.ros.read_mask(source(tmp_path / "map.yaml")), message)
