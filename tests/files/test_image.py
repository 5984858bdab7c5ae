"""Images as workspaces."""

import tracemalloc
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from cspace import Grid, Workspace
from cspace.errors import FileError, InputError
from cspace.files.images import read_shades
from tests.helpers.refusals import refusals
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
    workspace = Workspace.from_image(path, 0.1, lower=(2.0, 3.0), threshold=threshold, dark=dark)
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
    shades = read_shades(tmp_path / "map.pgm", "image")
    assert shades.levels[:, 0].tolist() == [0, 65535, 13107]
    large = PIXELS.repeat(16, axis=0).repeat(16, axis=1)
    Image.fromarray(large).save(tmp_path / "map.jpg", quality=95)
    occupied = Workspace.from_image(tmp_path / "map.jpg", 1.0).outer
    assert occupied[::16, ::16].tolist() == [[True, True], [True, False], [False, False]]
    Image.fromarray(PIXELS).convert("P").save(tmp_path / "map.png", transparency=255)
    opaque = read_shades(tmp_path / "map.png", "image").opaque
    assert np.array_equal(opaque, (PIXELS != 255)[::-1].T)


@refusals(
    "options, message",
    ({"threshold": 0.0}, "threshold is 0.0"),
    ({"dark": "black"}, "dark is 'black'"),
)
def test_unusable_options_are_refused(image, options, message):
    with pytest.raises(InputError, match=message):
        Workspace.from_image(image, **({"spacing": 1.0} | options))


@pytest.mark.parametrize(("mode", "pixel"), [("F", 0.5), ("I", 70000)])
def test_pixels_of_an_unknown_kind_are_refused(tmp_path, mode, pixel):
    Image.new(mode, (2, 1), pixel).save(tmp_path / "odd.tif")
    with pytest.raises(FileError, match=f"image mode '{mode}'"):
        Workspace.from_image(tmp_path / "odd.tif", 1.0)


def test_a_chunk_that_claims_gigabytes_takes_little_memory(image):
    content = bytearray(image.read_bytes())
    start = content.index(b"IDAT") - 4
    content[start : start + 4] = (2**31 - 1).to_bytes(4, "big")
    image.write_bytes(content)
    tracemalloc.start()
    try:
        with suppress(FileError):
            Workspace.from_image(image, 0.1)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()
