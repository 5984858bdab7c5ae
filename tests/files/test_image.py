"""Images as workspaces."""

import struct
import tracemalloc
import warnings
import zlib
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import cspace
from cspace import Grid, Robot, Workspace
from cspace._files.images import read_shades
from cspace.errors import FileError, UnitWarning
from tests.helpers.strategies import seeds

PIXELS = np.array([[0, 255, 255], [0, 100, 200]], dtype=np.uint8)
"""Two rows of three columns, the first row at the top."""


@pytest.fixture
def image(tmp_path):
    Image.fromarray(PIXELS).save(tmp_path / "map.png")
    return tmp_path / "map.png"


FORMATS = [
    *((mode, suffix) for mode in ("L", "RGB") for suffix in (".png", ".bmp", ".tif")),
    *(("1", ".png"), ("L", ".pgm"), ("RGB", ".ppm"), ("I;16", ".png"), ("I;16", ".pgm")),
    *((mode, ".png") for mode in ("P", "RGBA", "LA")),
]


def draw_image(mode, rng):
    """Draw an image of few pixels; some are not opaque."""
    height, width = rng.integers(1, 20, 2)
    if mode == "I;16":
        return Image.fromarray(rng.integers(0, 2**16, (height, width), dtype=np.uint16))
    colours = rng.integers(0, 256, (height, width, 4), dtype=np.uint8)
    colours[..., 3] = rng.choice([0, 254, 255], (height, width), p=[0.1, 0.1, 0.8])
    picture = Image.fromarray(colours, "RGBA")
    return picture.convert("RGB").convert("P") if mode == "P" else picture.convert(mode)


@given(
    form=st.sampled_from(FORMATS),
    threshold=st.integers(1, 255).map(lambda level: level / 255) | st.floats(1e-9, 1.0),
    dark=st.sampled_from(["occupied", "free"]),
    seed=seeds,
)
def test_cells_agree_with_the_pixels_that_pillow_returns(
    tmp_path_factory,
    form,
    threshold,
    dark,
    seed,
):
    mode, suffix = form
    path = tmp_path_factory.getbasetemp() / f"map{suffix}"
    drawn = draw_image(mode, np.random.default_rng(seed))
    drawn.save(path)
    width, height = drawn.size
    colours = drawn.convert("RGBA")
    workspace = Workspace.open(path, spacing=0.1, lower=(2.0, 3.0), threshold=threshold, dark=dark)
    assert workspace.grid == Grid((2.0, 3.0), 0.1, drawn.size)
    occupied = workspace.outer
    for column, row in np.ndindex(width, height):
        *channels, alpha = colours.getpixel((column, row))
        shade = sum(channels) / 765
        if mode == "I;16":
            shade = drawn.getpixel((column, row)) / 65535
        expected = (shade < threshold) == (dark == "occupied") or alpha < 255
        assert occupied[column, height - 1 - row] == expected


def test_plain_text_jpeg_and_transparent_palettes_are_read(tmp_path):
    (tmp_path / "map.pgm").write_text("P2\n# comment\n3 1\n65535\n0 65535 13107\n")
    shades = read_shades(tmp_path / "map.pgm", "image", 0.1)
    assert shades.levels[:, 0].tolist() == [0, 65535, 13107]
    large = PIXELS.repeat(16, axis=0).repeat(16, axis=1)
    Image.fromarray(large).save(tmp_path / "map.jpg", quality=95)
    occupied = Workspace.open(tmp_path / "map.jpg", spacing=1.0).outer
    assert occupied[::16, ::16].tolist() == [[True, True], [True, False], [False, False]]
    Image.fromarray(PIXELS).convert("P").save(tmp_path / "map.png", transparency=255)
    opaque = read_shades(tmp_path / "map.png", "image", 0.1).opaque
    assert np.array_equal(opaque, (PIXELS != 255)[::-1].T)


@pytest.mark.parametrize("mode, pixel", [("F", 0.5), ("I", 70000)])
def test_pixels_of_an_unknown_kind_are_refused(tmp_path, mode, pixel):
    Image.new(mode, (2, 1), pixel).save(tmp_path / "odd.tif")
    with pytest.raises(FileError, match=f"image mode '{mode}'"):
        Workspace.open(tmp_path / "odd.tif", spacing=1.0)


def test_a_chunk_that_claims_gigabytes_takes_little_memory(image):
    content = bytearray(image.read_bytes())
    start = content.index(b"IDAT") - 4
    content[start : start + 4] = (2**31 - 1).to_bytes(4, "big")
    image.write_bytes(content)
    tracemalloc.start()
    try:
        with suppress(FileError):
            Workspace.open(image, spacing=0.1)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


# Fields that change what pixels mean

WALL = np.full((8, 10), 255)
WALL[2, 3:6] = 0
"""A black wall on white ground, the first row at the top."""


def occupied_cells(path, **options):
    """Return the indices of the occupied cells of an image of 0.1 m pixels."""
    return np.argwhere(Workspace.open(path, spacing=0.1, **options).outer).tolist()


WALL_CELLS = [[3, 5], [4, 5], [5, 5]]


FORMATS_OF_TAGS = {2: "s", 3: "H", 4: "I", 12: "d"}


def write_tiff(path, rows, bits, tags, order="<"):
    """Write a grey TIFF of one strip; further tags are a type and values, by number."""
    height, width = WALL.shape
    tags = {256: (3, width), 257: (3, height), 258: (3, bits), 259: (3, 1), 277: (3, 1)} | tags
    tags |= {278: (3, height), 279: (4, len(rows)), 273: (4, 0)}
    start = 14 + 12 * len(tags)  # of the values that do not fit into their entry
    entries, values_outside = b"", b""
    places = {}
    for number, (kind, *values) in sorted(tags.items()):
        letter = FORMATS_OF_TAGS[kind]
        if kind == 2:
            values = [letter.encode() for letter in values[0] + "\0"]
        value = struct.pack(
            f"{order}{len(values)}{letter}" if kind != 2 else "c" * len(values), *values
        )
        places[number] = len(entries) + 8
        entries += struct.pack(f"{order}HHI", number, kind, len(values))
        if len(value) <= 4:
            entries += value.ljust(4, b"\0")
        else:
            entries += struct.pack(f"{order}I", start + len(values_outside))
            values_outside += value
    strip = struct.pack(f"{order}I", start + len(values_outside))
    entries = entries[: places[273]] + strip + entries[places[273] + 4 :]
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}IH", 8, len(tags))
    path.write_bytes(head + entries + bytes(4) + values_outside + rows)
    return path


def pack_levels(levels, bits, order):
    """Return rows of levels of 1, 4, 8, 12 or 16 bits."""
    if bits == 16:
        return levels.astype(f"{order}u2").tobytes()
    digits = (levels[..., None] >> np.arange(bits)[::-1]) & 1
    return np.packbits(digits.reshape(len(levels), -1), axis=1).tobytes()


@pytest.mark.parametrize("bits", [1, 4, 8, 12, 16])
@pytest.mark.parametrize("photometric", [0, 1], ids=["white-is-zero", "black-is-zero"])
@pytest.mark.parametrize("order", "<>")
def test_grey_tiffs_are_read_in_their_sense_or_refused(tmp_path, bits, photometric, order):
    levels = (WALL > 0) * (2**bits - 1)
    rows = pack_levels(levels if photometric else 2**bits - 1 - levels, bits, order)
    path = write_tiff(tmp_path / "wall.tif", rows, bits, {262: (3, photometric)}, order)
    try:
        assert occupied_cells(path, threshold=0.9) == WALL_CELLS
    except FileError:
        assert bits in (12, 16)
        assert (photometric, order) != (1, "<")


@pytest.mark.parametrize(
    "tag, message",
    [({339: (3, 2)}, "has image mode"), ({42113: (2, "255")}, "has a value for no data")],
    ids=["signed samples", "no data"],
)
def test_pixels_of_a_tiff_that_mean_something_else_are_refused(tmp_path, tag, message):
    rows = pack_levels(WALL, 8, "<")
    path = write_tiff(tmp_path / "wall.tif", rows, 8, {262: (3, 1)} | tag)
    with pytest.raises(FileError, match=message):
        Workspace.open(path, spacing=0.1)


TURNS = {
    2: np.fliplr,
    3: lambda rows: np.rot90(rows, 2),
    4: np.flipud,
    5: np.transpose,
    6: lambda rows: np.rot90(rows, -1),
    7: lambda rows: np.rot90(rows, 2).T,
    8: np.rot90,
}
"""Rows as they are shown, of rows as they are stored, by EXIF orientation."""


@pytest.mark.parametrize("orientation", TURNS)
@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif"])
def test_the_exif_orientation_of_every_format_is_applied(tmp_path, orientation, suffix):
    large = WALL.repeat(8, axis=0).repeat(8, axis=1).astype(np.uint8)
    exif = Image.Exif()
    exif[274] = orientation
    path = tmp_path / f"turned{suffix}"
    Image.fromarray(large).save(path, exif=exif)
    shown = TURNS[orientation](large)
    assert (Workspace.open(path, spacing=0.1).outer == (shown < 128)[::-1].T).all()


@pytest.mark.parametrize("header", ["P5 10 8 {}\n", "P6 10 8 {}\n", "P4\n10 8\n"])
@pytest.mark.parametrize("white", [1, 100, 255, 1000, 65535])
def test_netpbm_of_any_maximum_ends_with_its_last_pixel(tmp_path, header, white):
    channels = 3 if header[1] == "6" else 1
    levels = (WALL // 255 * white).repeat(channels, axis=1)
    rows = pack_levels(levels, 16 if white > 255 else 8, ">")
    if header[1] == "4":
        rows = pack_levels(1 - WALL // 255, 1, ">")
    header = header.format(white).encode()
    path = tmp_path / "wall.pnm"
    path.write_bytes(header + rows)
    assert occupied_cells(path) == WALL_CELLS
    for content in (header[:-1] + b"\r\n" + rows, header + rows + b"\0"):
        path.write_bytes(content)
        with pytest.raises(FileError, match="1 bytes or numbers more"):
            Workspace.open(path, spacing=0.1)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:Use `@`:PendingDeprecationWarning")
def test_the_placement_of_a_geotiff_warns_and_rioxarray_places_it(tmp_path):
    rioxarray = pytest.importorskip("rioxarray")
    tie = (12, 0.0, 0.0, 0.0, 5.0, 7.0, 0.0)
    tags = {262: (3, 1), 33550: (12, 0.1, 0.1, 0.0), 33922: tie}
    path = write_tiff(tmp_path / "geo.tif", pack_levels(WALL, 8, "<"), 8, tags)
    with pytest.warns(UnitWarning, match='not read; the page "Bring your file" says how'):
        workspace = Workspace.open(path, spacing=0.1, lower=(5, 6.2))
    placed = Workspace.from_array(rioxarray.open_rasterio(path)[0] < 128, 0.1)
    assert placed.grid.lower == pytest.approx(workspace.grid.lower)
    assert (placed.outer == workspace.outer).all()


@pytest.mark.parametrize("tag", [{33550: (12, 0.1, 0.1, 0.0)}, {34264: (12, *range(16))}])
def test_the_placement_of_a_geotiff_is_named(tmp_path, tag):
    path = write_tiff(tmp_path / "a.tif", pack_levels(WALL, 8, "<"), 8, {262: (3, 1)} | tag)
    with pytest.warns(UnitWarning, match="the placement of a GeoTIFF is not read"):
        Workspace.open(path, spacing=0.1)


@pytest.mark.parametrize("name", ["map.pgw", "map.pngw", "map.wld"])
def test_a_world_file_is_named(tmp_path, name):
    Image.fromarray(WALL.astype(np.uint8)).save(tmp_path / "map.png")
    (tmp_path / name).write_text("0.1\n0\n0\n-0.1\n5.05\n6.95\n")
    with pytest.warns(UnitWarning, match=f"the placement of {name} is not read"):
        Workspace.open(tmp_path / "map.png", spacing=0.1)


def test_further_pages_and_an_unusual_gamma_warn(tmp_path):
    picture = Image.fromarray(WALL.astype(np.uint8))
    for name in ("pages.tif", "frames.png"):
        picture.save(tmp_path / name, save_all=True, append_images=[picture.rotate(180)])
        with pytest.warns(UserWarning, match="2 pages or frames"):
            assert occupied_cells(tmp_path / name) == WALL_CELLS
    picture.save(tmp_path / "plain.png")
    content = (tmp_path / "plain.png").read_bytes()
    chunk = b"gAMA" + struct.pack(">I", 100_000)
    chunk = struct.pack(">I", 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (tmp_path / "linear.png").write_bytes(content[:33] + chunk + content[33:])
    with pytest.warns(UserWarning, match="its gamma of 1 is not applied"):
        assert occupied_cells(tmp_path / "linear.png") == WALL_CELLS


@pytest.mark.parametrize("mode", ["LA", "RGBA", "PA", "P"])
def test_a_transparent_ground_is_unknown_and_the_warning_says_what_to_do(tmp_path, mode):
    colours = np.zeros((8, 10, 4), np.uint8)
    colours[2, 3:6, 3] = 255
    picture = Image.fromarray(colours)
    options = {}
    if mode == "P":
        picture = Image.fromarray((WALL > 0).astype(np.uint8))
        picture.putpalette([0] * 6)
        options = {"transparency": 1}
    path = tmp_path / ("plan.tif" if mode == "PA" else "plan.png")
    try:
        (picture if mode == "P" else picture.convert(mode)).save(path, **options)
    except OSError:
        pytest.skip("Pillow writes no such file")
    workspace = Workspace.open(path, spacing=0.05)
    assert (workspace.unknown == (WALL > 0)[::-1].T).all()
    with pytest.warns(UserWarning, match="77 of 80 cells are unknown"):
        cspace.build(workspace, Robot.disc(0.02))
    opened = Image.open(path).convert("RGBA")
    white = Image.new("RGBA", opened.size, "white")
    Image.alpha_composite(white, opened).save(tmp_path / "white.png")
    assert occupied_cells(tmp_path / "white.png") == WALL_CELLS


def test_reading_takes_few_bytes_for_each_pixel(tmp_path):
    pixels = np.full((4000, 4000, 3), 255, np.uint8)
    pixels[100:900, 300:400] = 0
    Image.fromarray(pixels).save(tmp_path / "large.png", compress_level=1)
    tracemalloc.start()
    try:
        workspace = Workspace.open(tmp_path / "large.png", spacing=0.05)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert workspace.outer.sum() == 80_000
    assert peak < 5.6 * pixels.size / 3


@pytest.mark.parametrize(
    "content",
    [
        b"P1\n3 1\n# 1\n0 1 0 1",
        b"P2\n3 1\n100\n0 49 100 0",
        b"P3\n1 1\n255\n9 9 9\n# next\nP3 1 1 255 0 0 0",
        b"P5\n3 1\n100\n\x00\x31\xff",
        b"P5\n2 1\n1000\n" + struct.pack(">HH", 0, 1001),
    ],
    ids=["bits", "levels", "colours", "above-white", "above-white-of-16-bits"],
)
def test_numbers_that_a_header_does_not_allow_are_refused(tmp_path, content):
    path = tmp_path / "wall.pgm"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"more than its pixels|its header says that white is"):
        Workspace.open(path, spacing=0.1)


@pytest.mark.parametrize(
    "content, occupied",
    [
        (b"P1\n3 1\n0 1\n# 1 1 1\n0 ", [0, 1, 0]),
        (b"P1\n3 1\n010", [0, 1, 0]),
        (b"P2 # 9 9\n3 1\n100\n0 49 # 7\n100\n", [1, 1, 0]),
        (b"P5\n3 1\n100\n\x00\x31\x64", [1, 1, 0]),
        (b"P5\n3 1\n1000\n" + struct.pack(">HHH", 0, 499, 1000), [1, 1, 0]),
    ],
    ids=["bits", "packed-bits", "levels", "binary", "binary-of-16-bits"],
)
def test_the_maximum_and_comments_of_a_pgm_are_read(tmp_path, content, occupied):
    path = tmp_path / "wall.pgm"
    path.write_bytes(content)
    assert Workspace.open(path, spacing=0.1).outer[:, 0].tolist() == occupied


def test_an_image_with_few_greys_of_unknown_cells_is_read_in_silence(tmp_path):
    path = tmp_path / "map.pgm"
    Image.fromarray(np.array([[0, *[205] * 2, *[255] * 98]], np.uint8)).save(path)
    with warnings.catch_warnings(action="error"):
        assert Workspace.open(path, spacing=0.1).outer.sum() == 1
