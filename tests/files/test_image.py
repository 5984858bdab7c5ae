"""Images as workspaces."""

import tracemalloc
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cspace import Grid, Workspace
from cspace.errors import FileError, InputError
from cspace.files.images import read_shades as read_image_shades
from tests.helpers.refusals import refusals


def read_shades(path, kind):
    """Return the shades of an image, and its opaque pixels."""
    image = read_image_shades(path, kind)
    shade = image.levels / float(image.white_level)
    return shade, np.broadcast_to(image.opaque, shade.shape)


PIXELS = np.array([[0, 255, 255], [0, 100, 200]], dtype=np.uint8)
"""Two rows of three columns, the first row at the top."""


@pytest.fixture
def image(tmp_path: Path) -> Path:
    Image.fromarray(PIXELS).save(tmp_path / "map.png")
    return tmp_path / "map.png"


def test_first_row_is_the_top(image: Path) -> None:
    workspace = Workspace.from_image(image, 0.1, lower=(2.0, 3.0))
    assert workspace.grid == Grid((2.0, 3.0), 0.1, (3, 2))
    assert workspace.outer.tolist() == [[True, True], [True, False], [False, False]]
    assert workspace.inner is workspace.outer
    assert workspace.source == str(image)


def test_dark_free_is_the_complement(image: Path) -> None:
    dark = Workspace.from_image(image, 0.1)
    assert np.array_equal(Workspace.from_image(image, 0.1, dark="free").outer, ~dark.outer)


@pytest.mark.parametrize(
    ("threshold", "count"),
    [(1e-9, 2), (100 / 255, 2), (0.4, 3), (200 / 255, 3), (0.8, 4), (1.0, 4)],
)
def test_cells_darker_than_the_threshold_are_occupied(
    image: Path, threshold: float, count: int
) -> None:
    assert Workspace.from_image(image, 0.1, threshold=threshold).outer.sum() == count


LEVELS = np.array([[0, 1, 300], [65535, 65534, 40000]], dtype=np.uint16)


@pytest.mark.parametrize(
    ("name", "content", "rows"),
    [
        *[
            (f"map.{suffix}", Image.fromarray(PIXELS).convert(mode), PIXELS / 255)
            for suffix in ("png", "pgm", "ppm", "bmp", "tif")
            for mode in ("L", "RGB")
        ],
        ("palette.png", Image.fromarray(PIXELS).convert("P"), PIXELS / 255),
        ("bits.png", Image.fromarray(PIXELS > 128), PIXELS > 128),
        ("deep.pgm", Image.fromarray(LEVELS), LEVELS / 65535),
        ("deep.png", Image.fromarray(LEVELS), LEVELS / 65535),
        (
            "text.pgm",
            "P2\n# comment\n3 2\n255\n0 51 255\n255 102 0\n",
            [[0.0, 0.2, 1.0], [1.0, 0.4, 0.0]],
        ),
        ("text.pgm", "P2\n3 1\n65535\n0 65535 13107\n", [[0.0, 1.0, 0.2]]),
        (
            "mean.png",
            Image.fromarray(np.array([[[255, 0, 0], [255, 255, 0]]], np.uint8)),
            [[1 / 3, 2 / 3]],
        ),
    ],
)
def test_shades_are_read_from_every_format(
    tmp_path: Path, name: str, content: Any, rows: Any
) -> None:
    path = tmp_path / name
    path.write_text(content) if isinstance(content, str) else content.save(path)
    shade, opaque = read_shades(path, "image")
    assert shade == pytest.approx(np.array(rows, dtype=float)[::-1].T, rel=1e-12)
    assert opaque.all()


def test_jpeg_is_read(tmp_path: Path) -> None:
    Image.fromarray(PIXELS.repeat(16, axis=0).repeat(16, axis=1)).save(
        tmp_path / "map.jpg", quality=95
    )
    occupied = Workspace.from_image(tmp_path / "map.jpg", 1.0).outer
    assert occupied[::16, ::16].tolist() == [[True, True], [True, False], [False, False]]


@pytest.mark.parametrize("mode", ["RGBA", "LA"])
@pytest.mark.parametrize("dark", ["occupied", "free"])
def test_transparent_pixels_are_occupied(tmp_path: Path, mode: str, dark: str) -> None:
    picture = Image.fromarray(np.array([[0, 0, 255, 255]], dtype=np.uint8)).convert(mode)
    picture.putalpha(Image.fromarray(np.array([[255, 0, 254, 255]], dtype=np.uint8)))
    picture.save(tmp_path / "map.png")
    occupied = Workspace.from_image(tmp_path / "map.png", 1.0, dark=dark).outer[:, 0]
    assert occupied.tolist() == [dark == "occupied", True, True, dark == "free"]


@pytest.mark.parametrize("mode", ["1", "L", "I;16", "P", "RGB", "RGBA", "LA"])
@pytest.mark.parametrize("size", [(1, 200), (130, 70), (257, 193)], ids=str)
def test_shades_agree_with_pillow(tmp_path: Path, mode: str, size: tuple[int, int]) -> None:
    """Compare with Pillow's values of single pixels."""
    rng, (width, height) = np.random.default_rng(0), size
    grey = rng.integers(0, 256, (height, width), dtype=np.uint8)
    if mode == "I;16":
        Image.fromarray(
            grey.astype(np.uint16) * 257
            - (grey > 0) * rng.integers(0, 256, grey.shape).astype(np.uint16)
        ).save(tmp_path / "map.png")
    else:
        colours = rng.integers(0, 256, (height, width, 4), dtype=np.uint8)
        colours[..., 3] = rng.choice([0, 254, 255], (height, width), p=[0.1, 0.1, 0.8])
        Image.fromarray(colours, "RGBA").convert(mode.replace("P", "RGB")).convert(mode).save(
            tmp_path / "map.png"
        )
    with Image.open(tmp_path / "map.png") as image:
        assert image.mode == mode
        rgba = np.array(image if mode == "I;16" else image.convert("RGBA"), dtype=np.float64)
    shade = rgba / 65535 if mode == "I;16" else rgba[..., :3].sum(axis=2) / 765
    clear = np.zeros(shade.shape, dtype=bool) if mode == "I;16" else rgba[..., 3] < 255
    for dark in ("occupied", "free"):
        expected = ((shade < 0.4) == (dark == "occupied")) | clear
        np.testing.assert_array_equal(
            Workspace.from_image(tmp_path / "map.png", 1.0, threshold=0.4, dark=dark).outer,
            expected[::-1].T,
        )


def test_a_transparent_palette_entry_is_not_opaque(tmp_path: Path) -> None:
    Image.fromarray(PIXELS).convert("P").save(tmp_path / "map.png", transparency=255)
    assert np.array_equal(read_shades(tmp_path / "map.png", "image")[1], (PIXELS != 255)[::-1].T)


@refusals(
    "options, message",
    ({"threshold": 0.0}, "threshold is 0.0"),
    ({"threshold": 1.5}, "threshold is 1.5"),
    ({"threshold": float("nan")}, "threshold is nan"),
    ({"threshold": (0.1, 0.2)}, "threshold is"),
    ({"dark": "black"}, "dark is 'black'"),
    ({"spacing": 0.0}, "spacing is 0.0"),
    ({"spacing": -1.0}, "spacing is -1.0"),
    ({"lower": (1.0,)}, "lower is"),
    ({"lower": (0.0, 0.0, 0.0)}, "shape is"),
)
def test_unusable_options_are_refused(image: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Workspace.from_image(image, **({"spacing": 1.0} | options))


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"not an image",
        b"P5\n3 2\n255\n\x00",
        b"P5\n3 x\n",
        b"P2\n3 2\n255\n0 1 a",
        b"P2\n3 2\n255\n0 1",
    ],
)
def test_damaged_images_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.pgm").write_bytes(content)
    with pytest.raises(FileError, match=r"bad\.pgm: cannot be read as an image"):
        Workspace.from_image(tmp_path / "bad.pgm", 1.0)


def test_pixels_of_an_unknown_kind_are_refused(tmp_path: Path) -> None:
    Image.fromarray(np.array([[0.0, np.nan]], dtype=np.float32)).save(tmp_path / "float.tif")
    with pytest.raises(FileError, match="image mode 'F'"):
        Workspace.from_image(tmp_path / "float.tif", 1.0)
    Image.fromarray(np.array([[0, 70000]], dtype=np.int32)).save(tmp_path / "wide.tif")
    with pytest.raises(FileError, match="image mode 'I'"):
        Workspace.from_image(tmp_path / "wide.tif", 1.0)


@pytest.mark.parametrize("name", ["normal.ppm", "thin.ppm"])
def test_real_mazes_agree_with_a_plain_reading(data: Path, name: str) -> None:
    path = data / "maps" / name
    _, comment, size, depth, body = path.read_bytes().split(b"\n", 4)
    assert (comment[:1], size, depth, len(body)) == (b"#", b"450 450", b"255", 3 * 450 * 450)
    dark = [sum(body[k : k + 3]) / 765 < 0.5 for k in range(0, len(body), 3)]
    workspace = Workspace.from_image(path, 1.0)
    assert workspace.grid.shape == (450, 450)
    assert workspace.outer.sum() == sum(dark)
    assert 0 < sum(dark) < 450 * 450
    for x, y in np.random.default_rng(1).integers(450, size=(500, 2)).tolist():
        assert workspace.outer[x, y] == dark[(449 - y) * 450 + x]


def test_a_chunk_that_claims_gigabytes_takes_little_memory(tmp_path: Path) -> None:
    file = tmp_path / "claims.png"
    Image.fromarray(np.full((8, 8), 255, np.uint8)).save(file)
    data = bytearray(file.read_bytes())
    at = data.index(b"IDAT") - 4
    data[at : at + 4] = (2**31 - 1).to_bytes(4, "big")
    file.write_bytes(data)
    tracemalloc.start()
    try:
        with suppress(FileError):
            Workspace.from_image(file, 0.1)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()
