"""ROS maps, read and written."""

import math
import warnings

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from cspace import Grid, Workspace
from cspace.errors import AngleWarning, FileError
from tests.helpers.messages import write_map
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

PIXELS = np.array([[0, 254, 254], [0, 205, 254]], dtype=np.uint8)
"""Occupied, free and unknown pixels; the first row at the top."""


@pytest.mark.parametrize(
    "turns, lower, cells",
    [
        (1, (-2.0, 2.0), [[1, 0, 0], [1, 1, 0]]),
        (-1, (-1.0, 0.5), [[0, 1, 1], [0, 0, 1]]),
    ],
)
def test_maps_are_read_exactly_at_quarter_turns(tmp_path, turns, lower, cells):
    path = write_map(tmp_path, PIXELS, origin=[-1.0, 2.0, turns * math.pi / 2])
    workspace = Workspace.open(path)
    assert workspace.grid == Grid(lower, 0.5, np.shape(cells))
    assert workspace.outer.tolist() == np.array(cells, dtype=bool).tolist()
    assert workspace.inner is workspace.outer
    assert workspace.unknown is not None
    assert workspace.unknown.sum() == 1
    assert workspace.source == str(path)
    assert Workspace.open(path, unknown="free").outer.sum() == 2


SIX = np.array([0, 89, 90, 204, 206, 255], np.uint8)
"""Occupied if (255 - pixel) / 255 >= 0.65, or pixel <= 89; free if < 0.196, or pixel >= 206."""

OPAQUE = np.array([[0, 0, 0, 255], [255, 255, 255, 255], [0, 0, 0, 254], [255, 255, 255, 0]])

DEEP = np.array([0, 65535 - 12845, 65535 - 12844, 65535], np.uint16)
"""0.196 * 65535 is 12844.86."""


@pytest.mark.parametrize(
    "pixels, changes, cells",
    [
        (SIX, {}, "##??.."),
        ([0, 49, 51, 165, 166, 255], {"negate": 1}, "..??##"),
        (SIX, {"mode": "scale"}, "####.."),
        ([0, 19, 20, 65, 100, 101, 255], {"mode": "raw"}, "..###??"),
        ([0, 255], {"occupied_thresh": 1.0, "free_thresh": 0.0}, "#?"),
        (DEEP, {}, "#?.."),
        (OPAQUE, {"mode": "scale"}, "#.??"),
    ],
)
def test_pixels_become_occupied_unknown_or_free_cells(tmp_path, pixels, changes, cells):
    row = np.asarray(pixels)
    if row.dtype != np.uint16:
        row = row.astype(np.uint8)
    path = write_map(tmp_path, row[np.newaxis], **changes)
    cautious = Workspace.open(path)
    assert cautious.outer[:, 0].tolist() == [cell != "." for cell in cells]
    bold = Workspace.open(path, unknown="free")
    assert bold.outer[:, 0].tolist() == [cell == "#" for cell in cells]


def test_the_image_is_found_from_any_working_folder(tmp_path, monkeypatch):
    (tmp_path / "maps" / "images").mkdir(parents=True)
    path = write_map(tmp_path / "maps", PIXELS, image="images/m.pgm")
    (tmp_path / "maps" / "images" / "m.pgm").write_text("P2\n# made by hand\n2 1\n255\n0 255\n")
    monkeypatch.chdir(tmp_path)
    assert Workspace.open(path.relative_to(tmp_path)).outer.tolist() == [[True], [False]]
    outside = path.with_name("other.yml")
    outside.write_text(path.read_text().replace("images/m.pgm", f"{tmp_path}/maps/../m.pgm"))
    (tmp_path / "m.pgm").write_text("P2\n1 1\n255\n255\n")
    with pytest.warns(UserWarning, match="lies outside the folder"):
        assert not Workspace.open(outside).outer.any()
    outside.write_text(path.read_text().replace("images/m.pgm", "/home/other/maps/m.pgm"))
    (outside.parent / "m.pgm").write_text("P2\n1 1\n255\n255\n")
    with pytest.raises(FileError, match="beside the map is"):
        Workspace.open(outside)


@given(
    pixels=hnp.arrays(
        np.uint8,
        st.tuples(st.integers(1, 6), st.integers(1, 6)),
        elements=st.sampled_from([0, 205, 254]),
    ),
    yaw=st.sampled_from([1.5708, 0.3, -2.0, math.pi / 4, 1e-3]) | st.floats(-4.0, 4.0),
    unknown=st.sampled_from(["occupied", "free"]),
    seed=seeds,
)
def test_rotated_maps_agree_with_shapely(tmp_path_factory, pixels, yaw, unknown, seed):
    path = write_map(tmp_path_factory.getbasetemp(), pixels, origin=[-1.0, 2.0, yaw])
    workspace = Workspace.open(path, unknown=unknown)
    grid = workspace.grid
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    values = pixels[::-1].T
    x, y = 0.5 * np.indices(values.shape)
    squares = shapely.box(x, y, x + 0.5, y + 0.5)
    squares = shapely.transform(squares, lambda points: points @ turn + [-1.0, 2.0])
    is_solid = values < 254 if unknown == "occupied" else values == 0
    points = np.random.default_rng(seed).uniform(grid.lower, grid.upper, size=(400, 2))
    handles = shapely.points(points)
    if unknown == "occupied":  # space outside the image is unknown too
        free = shapely.union_all(squares[~is_solid])
        expected = ~shapely.contains_properly(free, handles)
    else:
        solid = shapely.union_all(squares[is_solid])
        expected = shapely.intersects(solid, handles)
        centers = shapely.points(grid.center_of(np.argwhere(workspace.outer)))
        assert (shapely.distance(centers, solid) <= 0.36).all()  # half a diagonal is 0.354
    cells = tuple(grid.cell_of(points).T)
    assert not (expected & ~workspace.outer[cells]).any()
    assert not (workspace.inner[cells] & ~expected).any()
    # A cell is unknown if the pixel at its center is.
    seen = np.zeros(grid.shape, bool) if workspace.unknown is None else workspace.unknown
    every = np.indices(grid.shape).reshape(2, -1).T
    back = (grid.center_of(every) - [-1.0, 2.0]) @ turn.T / 0.5
    clear = (np.abs(back - np.round(back)) > 1e-9).all(axis=1)
    pixel = np.floor(back[clear]).astype(int)
    padded = np.pad(values == 205, 50, constant_values=True)
    assert (seen.ravel()[clear] == padded[tuple(np.clip(pixel + 50, 0, 99).T)]).all()
    whole = shapely.union_all(squares)
    assert shapely.box(*grid.lower, *grid.upper).buffer(1e-9).covers(whole)


@pytest.mark.parametrize("name", ["depot", "100by100_10"])
def test_real_maps_have_the_cells_of_their_pixels(data, name):
    path = data / "maps" / f"{name}.yaml"
    header = yaml.safe_load(path.read_text())
    shades = np.asarray(Image.open(path.with_name(header["image"])).convert("L")) / 255.0
    occupied = shades if header["negate"] else 1.0 - shades
    unseen = (shades == 205 / 255) & (occupied < header["free_thresh"])
    occupied[unseen] = header["free_thresh"]
    with warnings.catch_warnings(record=True, action="always") as caught:
        workspace = Workspace.open(path)
    assert [f"{unseen.sum():,} cells are of grey 205" in str(w.message) for w in caught] == (
        [True] if unseen.any() else []
    )
    lower = tuple(header["origin"][:2])
    assert workspace.grid == Grid(lower, header["resolution"], occupied.T.shape)
    assert np.array_equal(workspace.outer, (occupied >= header["free_thresh"])[::-1].T)


@pytest.mark.parametrize(
    "pixels, changes",
    [
        (PIXELS, {}),
        (np.dstack([PIXELS] * 3), {}),
        (255 - PIXELS, {"negate": 1}),
        (PIXELS, {"mode": "scale"}),
    ],
    ids=["grey", "colours", "inverted", "scale"],
)
def test_grey_of_unknown_cells_below_the_threshold_is_unknown(tmp_path, pixels, changes):
    path = write_map(tmp_path, pixels, free_thresh=0.25, **changes)
    with pytest.warns(UserWarning, match="1 cells are of grey 205.*unless you pass unknown='free'"):
        workspace = Workspace.open(path)
    assert workspace.outer.sum() == 3
    assert np.argwhere(workspace.unknown).tolist() == [[1, 0]]
    assert Workspace.open(path, unknown="free").outer.sum() == 2


def test_other_greys_and_other_modes_keep_their_threshold(tmp_path):
    for pixels, changes in (
        ([204, 206, 254], {}),
        ([0, 49, 51], {"negate": 1}),
        ([206, 207, 254], {"mode": "scale"}),
        ([0, 1, 24], {"mode": "raw"}),
    ):
        path = write_map(tmp_path, np.array([pixels], np.uint8), free_thresh=0.25, **changes)
        assert not Workspace.open(path).outer.any()


@pytest.mark.parametrize("yaw", [90.0, -180.0, 7.0])
def test_a_yaw_beyond_a_whole_turn_warns_with_the_radians(tmp_path, yaw):
    path = write_map(tmp_path, PIXELS, origin=[-1.0, 2.0, yaw])
    with pytest.warns(AngleWarning, match="beyond a whole turn") as caught:
        Workspace.open(path)
    radians = float(str(caught[0].message).partition("degrees are ")[2].split()[0])
    assert radians == pytest.approx(math.radians(yaw), rel=1e-5)
    path = write_map(tmp_path, PIXELS, origin=[-1.0, 2.0, radians])
    for near in (radians, 2 * math.pi, -6.2831853):
        path = write_map(tmp_path, PIXELS, origin=[-1.0, 2.0, near])
        with warnings.catch_warnings(action="error"):
            Workspace.open(path)


def test_keys_that_are_not_read_warn(tmp_path):
    path = write_map(tmp_path, PIXELS, modes="raw", unknown_thresh=0.5)
    with pytest.warns(UserWarning, match="are not read: modes; did you mean 'mode'.*, unknown_thr"):
        Workspace.open(path)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif"])
def test_an_image_that_viewers_turn_is_refused_in_a_map(tmp_path, suffix):
    path = write_map(tmp_path, PIXELS, image=f"map{suffix}")
    exif = Image.Exif()
    exif[274] = 6
    Image.fromarray(PIXELS).save(tmp_path / f"map{suffix}", exif=exif)
    with pytest.raises(FileError, match="EXIF orientation 6; map servers ignore it"):
        Workspace.open(path)
    Image.fromarray(PIXELS).save(tmp_path / f"map{suffix}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if suffix == ".jpg" else "error")
        assert Workspace.open(path).grid.shape == (3, 2)


def test_transparent_pixels_are_unknown_in_every_mode(tmp_path):
    pixels = np.array([[(10, 10, 10, 255), (10, 10, 10, 0)]], np.uint8)
    path = write_map(tmp_path, pixels, mode="raw")
    workspace = Workspace.open(path)
    assert workspace.outer[:, 0].tolist() == [False, True]
    assert workspace.unknown[:, 0].tolist() == [False, True]


def blur(kind):
    """Return the pixels of a map, and their images as another program may save them.

    The middle of the map is free, with a wall around it that has a door; the rest is unknown.
    """
    pixels = np.full((90, 90), 205, np.uint8)
    pixels[21:70, 21:70] = 0
    pixels[23:68, 23:68] = 254
    pixels[40:48, 21:23] = 254
    image = Image.fromarray(pixels)
    if kind == "scaled":
        return np.repeat(np.repeat(pixels, 2, 0), 2, 1), image.resize((180, 180), Image.BILINEAR)
    return pixels, image


@pytest.mark.parametrize(
    ("name", "kind", "options"),
    [
        ("map.jpg", "", {"quality": 30}),
        ("map.jpg", "", {"quality": 75}),
        ("map.tif", "", {"compression": "jpeg", "quality": 30}),
        ("map.png", "scaled", {}),
    ],
)
@pytest.mark.parametrize("free_thresh", [0.196, 0.25])
def test_greys_that_were_blurred_are_not_free(tmp_path, name, kind, options, free_thresh):
    pixels, image = blur(kind)
    path = write_map(tmp_path, PIXELS, image=name, free_thresh=free_thresh)
    image.save(tmp_path / name, **options)
    with pytest.warns(UserWarning, match="near it|is a JPEG|of grey 205"):
        workspace = Workspace.open(path)
    free = ~workspace.outer
    # Beside a wall, a JPEG lifts a few pixels above any bound.
    assert (free & (pixels[::-1].T == 205)).sum() <= (0 if kind else 10)
    assert free.sum() > 0.8 * (pixels == 254).sum()
    assert not (free & (pixels[::-1].T == 0)).any()  # the walls are not free either
    Image.fromarray(pixels).save(tmp_path / "map.png")
    path = write_map(tmp_path, pixels, free_thresh=0.196)
    assert np.array_equal(Workspace.open(path).outer, pixels[::-1].T != 254)


def test_a_blurred_image_of_a_map_is_recognised_as_an_image(tmp_path):
    pixels, image = blur("")
    for name, options in (("a.jpg", {"quality": 50}), ("a.jpg", {"quality": 90}), ("a.png", {})):
        image.save(tmp_path / name, **options)
        with pytest.warns(UserWarning, match="looks like the image of a ROS map"):
            Workspace.open(tmp_path / name, spacing=0.1)
        workspace = Workspace.open(tmp_path / name, spacing=0.1, threshold=0.9)
        assert (~workspace.outer & (pixels[::-1].T < 254)).sum() <= 10


@refusals(
    "changes, message",
    ({"resolution": "0.05"}, "has the resolution '0.05'; .*"),
    ({"resolution": math.nan}, "has the resolution nan; it must be a finite number"),
    ({"resolution": 0.0}, "has the resolution 0.0; it must be a finite number, at least"),
    ({"resolution": [0.05, 0.05]}, r"has the resolution \[0.05, 0.05\]"),
    ({"origin": [0.0, 0.0]}, r"has the origin \[0.0, 0.0\]; it must be x, y and yaw"),
    ({"origin": {"x": 0, "y": 0}}, "has the origin .*; it must be x, y and yaw"),
    ({"origin": [0.0, 0.0, None]}, r"has the origin\[2\] None"),
    ({"negate": "no"}, "has negate 'no'; it must be 0 or 1: 0 if dark pixels are obstacles"),
    ({"free_thresh": 19.6}, "has the free_thresh 19.6; it must be a finite number, .* at most 1"),
    ({"mode": "Trinary"}, "has mode 'Trinary'; it must be one of trinary, scale, raw"),
    ({"image": "absent.pgm"}, r"absent\.pgm: does not exist; a ROS map's image"),
    ({"image": "map.yaml"}, r"map\.yaml: cannot be read as a ROS map's image"),
    ({"image": ["map.png"]}, r"has the image \['map.png'\]; it must be a file name"),
)
def test_values_of_another_kind_are_named(tmp_path, changes, message):
    with pytest.raises(FileError, match=message):
        Workspace.open(write_map(tmp_path, PIXELS, **changes))


def test_the_line_after_an_echo_is_no_second_document(tmp_path):
    path = write_map(tmp_path, PIXELS)
    text = path.read_text()
    for whole in (f"{text}---\n", f"---\n{text}---\n", f"{text}---\n---\n"):
        path.write_text(whole)
        assert Workspace.open(path).outer.sum() == 3
    path.write_text("---\n---\n")
    with pytest.raises(FileError, match="map is None; it must hold fields"):
        Workspace.open(path)
