"""ROS maps, read and written."""

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from cspace import BLOCKED, FREE, MIXED, Grid, Workspace
from cspace.errors import FileError, InputError
from cspace.export.images import write_ros_map
from tests.helpers.refusals import refusals

HEADER: dict[str, Any] = {
    "image": "map.png",
    "resolution": 0.5,
    "origin": [-1.0, 2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def _write(folder: Path, pixels: Any, **changes: Any) -> Path:
    """Write a ROS map; a change to None removes a key."""
    header = {key: value for key, value in (HEADER | changes).items() if value is not None}
    picture = (
        pixels
        if isinstance(pixels, Image.Image)
        else Image.fromarray(np.asarray(pixels, dtype=np.uint8))
    )
    picture.save(folder / "map.png")
    (folder / "map.yaml").write_text(yaml.safe_dump(header))
    return folder / "map.yaml"


def _read_column(path: Path, unknown: str = "occupied") -> list[bool]:
    """Return the cells of one row of pixels."""
    return Workspace.from_ros_map(path, unknown).outer[:, 0].tolist()


@pytest.mark.parametrize(("unknown", "count"), [("occupied", 3), ("free", 2)])
def test_a_tiny_map_is_read(tmp_path: Path, unknown: str, count: int) -> None:
    path = _write(tmp_path, [[0, 254, 254], [0, 205, 254]])
    workspace = Workspace.from_ros_map(path, unknown)
    assert workspace.grid == Grid((-1.0, 2.0), 0.5, (3, 2))
    assert workspace.outer.tolist() == [[True, True], [count == 3, False], [False, False]]
    assert workspace.unknown is not None
    assert workspace.unknown.tolist() == [[False, False], [True, False], [False, False]]
    assert workspace.inner is workspace.outer
    assert workspace.source == str(path)


SIX = [0, 89, 90, 205, 206, 255]
"""Thresholds: occupied if (255 - pixel) / 255 >= 0.65, or pixel <= 89; free if < 0.196, or pixel >=
206."""

OPAQUE = [[0, 0, 0, 255], [255, 255, 255, 255], [0, 0, 0, 254], [255, 255, 255, 0]]


@pytest.mark.parametrize(
    ("pixels", "changes", "cells"),
    [
        (SIX, {"mode": "trinary"}, "##??.."),
        (SIX, {"mode": None}, "##??.."),
        ([0, 49, 50, 165, 166, 255], {"negate": 1}, "..??##"),
        ([0, 255], {"negate": True}, ".#"),
        (SIX, {"mode": "scale"}, "####.."),
        ([0, 19, 20, 65, 100, 101, 255], {"mode": "raw"}, "..###??"),  # occupancy in per cent
        (
            [0, 255],
            {"occupied_thresh": 1.0, "free_thresh": 0.0},
            "#?",
        ),  # a shade at a threshold is not free
        (
            np.array([0, 65535 - 12845, 65535 - 12844, 65535], np.uint16),
            {},
            "#?..",
        ),  # 0.196 * 65535 = 12844.86
        (
            [[255, 255, 108], [255, 255, 105], [0, 0, 255], [0, 255, 20]],
            {},
            ".?#?",
        ),  # means 206, 205, 85, 91.7
        (OPAQUE, {"mode": "trinary"}, "#.??"),
        (OPAQUE, {"mode": "scale"}, "#.??"),
    ],
)
def test_pixels_become_cells(
    tmp_path: Path, pixels: Any, changes: dict[str, Any], cells: str
) -> None:
    """Test occupied, unknown and free pixels."""
    row = np.asarray(pixels, dtype=getattr(pixels, "dtype", np.uint8))[np.newaxis]
    path = _write(tmp_path, Image.fromarray(row), **changes)
    assert Workspace.from_ros_map(path).outer[:, 0].tolist() == [cell != "." for cell in cells]
    assert Workspace.from_ros_map(path, "free").outer[:, 0].tolist() == [
        cell == "#" for cell in cells
    ]


@pytest.mark.parametrize("magic", ["P2", "P5"])
def test_the_image_is_found_from_any_working_folder(
    tmp_path: Path, magic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "maps" / "images").mkdir(parents=True)
    path = _write(tmp_path / "maps", [[0]], image="images/m.pgm", mode=None)
    body = b"0 255\n" if magic == "P2" else bytes([0, 255])
    (tmp_path / "maps" / "images" / "m.pgm").write_bytes(
        f"{magic}\n# made by hand\n2 1\n255\n".encode() + body
    )
    monkeypatch.chdir(tmp_path)
    assert _read_column(path.relative_to(tmp_path)) == [True, False]


def test_an_absolute_image_name_is_followed_with_a_warning(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    path = _write(tmp_path, [[0, 255]], image=str(tmp_path / "map.png")).rename(
        tmp_path / "elsewhere" / "map.yaml"
    )
    with pytest.warns(UserWarning, match="lies outside the folder"):
        assert _read_column(path) == [True, False]


def test_numbers_may_lack_a_dot(tmp_path: Path) -> None:
    path = _write(tmp_path, [[0, 255]])
    path.write_text(path.read_text().replace("0.5", "5e-2").replace("2.0", "2"))
    assert Workspace.from_ros_map(path).grid == Grid((-1.0, 2.0), 0.05, (2, 1))


# The map of test_a_tiny_map_is_read, turned about its lower left corner (-1, 2).
@pytest.mark.parametrize(
    ("turns", "lower", "cells"),
    [
        (1, (-2.0, 2.0), [[1, 0, 0], [1, 1, 0]]),
        (2, (-2.5, 1.0), [[0, 0], [0, 1], [1, 1]]),
        (3, (-1.0, 0.5), [[0, 1, 1], [0, 0, 1]]),
        (-1, (-1.0, 0.5), [[0, 1, 1], [0, 0, 1]]),
        (4, (-1.0, 2.0), [[1, 1], [1, 0], [0, 0]]),
    ],
)
def test_quarter_turns_are_exact(
    tmp_path: Path, turns: int, lower: tuple[float, float], cells: list[Any]
) -> None:
    path = _write(tmp_path, [[0, 254, 254], [0, 205, 254]], origin=[-1.0, 2.0, turns * math.pi / 2])
    workspace = Workspace.from_ros_map(path)
    assert workspace.grid == Grid(lower, 0.5, np.shape(cells))
    assert workspace.outer.tolist() == np.array(cells, dtype=bool).tolist()
    assert workspace.inner is workspace.outer


@given(
    pixels=hnp.arrays(
        np.uint8,
        st.tuples(st.integers(1, 6), st.integers(1, 6)),
        elements=st.sampled_from([0, 205, 254]),
    ),
    yaw=st.sampled_from([1.5708, 0.3, -2.0, math.pi / 4, 1e-3]) | st.floats(-4.0, 4.0),
    unknown=st.sampled_from(["occupied", "free"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_rotated_maps_agree_with_shapely(
    tmp_path_factory: pytest.TempPathFactory,
    pixels: np.ndarray,
    yaw: float,
    unknown: str,
    seed: int,
) -> None:
    path = _write(tmp_path_factory.mktemp("turned"), pixels, origin=[-1.0, 2.0, yaw])
    workspace = Workspace.from_ros_map(path, unknown)
    grid = workspace.grid
    assert grid.spacing == 0.5
    # Rotate every pixel as a square, from the top row down; keep obstacles and free pixels apart.
    height, width = pixels.shape
    squares: dict[bool, list[Any]] = {True: [], False: []}
    for row in range(height):
        for column in range(width):
            square = shapely.box(
                0.5 * column, 0.5 * (height - 1 - row), 0.5 * (column + 1), 0.5 * (height - row)
            )
            solid = pixels[row, column] == 0 or (
                unknown == "occupied" and pixels[row, column] == 205
            )
            squares[bool(solid)].append(square)
    turned = {
        key: shapely.transform(
            shapely.union_all(group),
            lambda xy: (
                xy @ [[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]] + [-1.0, 2.0]
            ),
        )
        for key, group in squares.items()
    }
    points = np.random.default_rng(seed).uniform(grid.lower, grid.upper, size=(400, 2))
    handles = shapely.points(points)
    if unknown == "occupied":
        solid_at = ~shapely.contains_properly(turned[False], handles)
    else:
        solid_at = shapely.intersects(turned[True], handles)
    i, j = grid.cell_of(points).T
    assert not (solid_at & ~workspace.outer[i, j]).any()
    assert not (workspace.inner[i, j] & ~solid_at).any()
    seen = np.zeros(grid.shape, dtype=bool) if workspace.unknown is None else workspace.unknown
    for cell in np.ndindex(grid.shape):
        back = (
            (complex(*grid.center_of(cell)) - (-1 + 2j))
            * complex(math.cos(yaw), -math.sin(yaw))
            / 0.5
        )
        across, up = back.real, back.imag
        if min(abs(across - round(across)), abs(up - round(up))) > 1e-9:
            within = 0.0 <= across < width and 0.0 <= up < height
            assert seen[cell] == (
                not within or pixels[height - 1 - math.floor(up), math.floor(across)] == 205
            )
    everything = shapely.union_all(list(turned.values()))
    assert shapely.box(*grid.lower, *grid.upper).buffer(1e-9).covers(everything)


def test_a_rotated_map_is_tight(tmp_path: Path) -> None:
    pixels = np.full((60, 80), 254, dtype=np.uint8)
    pixels[20:40, 10:50] = 0
    path = _write(tmp_path, pixels, origin=[0.0, 0.0, 0.4])
    solid = Workspace.from_ros_map(path, "free")
    # 20 x 40 cells of 0.5 m: the borders cross at most 3 cells for each cell of their length.
    assert 800 < solid.outer.sum() < 800 + 1.5 * 120
    assert 800 - 1.5 * 120 < solid.inner.sum() < 800
    exterior_blocked = Workspace.from_ros_map(path, "occupied")
    assert exterior_blocked.grid == solid.grid
    assert (exterior_blocked.outer & ~solid.outer).any()
    assert 60 * 80 - 800 - 1.5 * 400 < (~exterior_blocked.outer).sum() < 60 * 80 - 800


def test_a_rotated_map_may_have_no_free_cells(tmp_path: Path) -> None:
    path = _write(tmp_path, [[0, 205]], origin=[0.0, 0.0, 0.4])
    workspace = Workspace.from_ros_map(path)
    assert workspace.outer.all()
    assert workspace.inner.all()
    path = _write(tmp_path, [[254, 205]], origin=[0.0, 0.0, 0.4])
    assert not Workspace.from_ros_map(path, "free").outer.any()


@refusals(
    "changes, message",
    ({"image": None}, "image is missing"),
    ({"image": ""}, "image is ''"),
    ({"image": 7}, "image is 7"),
    ({"image": "absent.pgm"}, r"absent\.pgm: does not exist; a ROS map's image"),
    ({"resolution": None}, "resolution is missing"),
    ({"resolution": 0}, "resolution is 0;"),
    ({"resolution": -0.05}, "resolution is -0.05"),
    ({"resolution": float("nan")}, "resolution is nan"),
    ({"resolution": "fine"}, "resolution is 'fine'"),
    ({"resolution": True}, "resolution is True"),
    ({"resolution": 1e-9}, r"map\.yaml: .*cells from the origin"),
    ({"resolution": 1e308}, r"resolution is 1e\+308"),
    ({"origin": [1.7e308, 0.0, 0.3]}, r"origin\[0\] is 1.7e\+308"),
    ({"origin": None}, "origin is missing"),
    ({"origin": [0.0, 0.0]}, r"origin is \[0.0, 0.0\]"),
    ({"origin": 0.0}, "origin is 0.0"),
    ({"origin": [0.0, 0.0, float("inf")]}, r"origin\[2\] is inf"),
    ({"origin": [0.0, [1], 0.0]}, r"origin\[1\] is \[1\]"),
    ({"negate": None}, "negate is missing"),
    ({"negate": 2}, "negate is 2"),
    ({"negate": "no way"}, "negate is 'no way'"),
    ({"negate": 1, "mode": "raw"}, "negate is 1 in raw mode"),
    ({"mode": "binary"}, "mode is 'binary'.*trinary, scale, raw"),
    ({"mode": ["raw"]}, r"mode is \['raw'\]"),
    ({"occupied_thresh": None}, "occupied_thresh is missing"),
    ({"free_thresh": None}, "free_thresh is missing"),
    ({"occupied_thresh": 1.01}, "occupied_thresh is 1.01"),
    ({"free_thresh": -0.1}, "free_thresh is -0.1"),
    ({"free_thresh": float("nan")}, "free_thresh is nan"),
    ({"free_thresh": 0.7}, "free_thresh is 0.7 and occupied_thresh is 0.65"),
    ({"free_thresh": 0.65}, "free_thresh is 0.65 and occupied_thresh is 0.65"),
)
def test_unusable_headers_are_refused(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(FileError, match=message):
        Workspace.from_ros_map(_write(tmp_path, [[0, 255]], **changes))


@refusals(
    "text, message",
    ("", "holds NoneType"),
    ("just words", "holds str"),
    ("- image\n- resolution", "holds list"),
    ("image: [map.png\nresolution: 1", "as a YAML file"),
    ("{}", "image is missing"),
)
def test_yaml_without_a_table_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(FileError, match=message):
        Workspace.from_ros_map(tmp_path / "map.yaml")


def test_an_image_that_cannot_be_decoded_is_refused(tmp_path: Path) -> None:
    path = _write(tmp_path, [[0]])
    (tmp_path / "map.png").write_bytes(b"\x89PNG nonsense")
    with pytest.raises(FileError, match=r"map\.png: cannot be read as a ROS map's image"):
        Workspace.from_ros_map(path)


def test_unknown_is_one_of_two_words(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown is 'maybe'"):
        Workspace.from_ros_map(_write(tmp_path, [[0]]), "maybe")


STATES = hnp.arrays(
    np.uint8,
    st.tuples(st.integers(1, 7), st.integers(1, 7)),
    elements=st.sampled_from([FREE, MIXED, BLOCKED]),
)


@given(
    state=STATES,
    lower=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    spacing=st.floats(1e-3, 1e3) | st.just(1e-3 / 3.0) | st.just(1.0),
)
def test_written_maps_read_back_identically(
    tmp_path_factory: pytest.TempPathFactory,
    state: np.ndarray,
    lower: tuple[float, float],
    spacing: float,
) -> None:
    path = tmp_path_factory.mktemp("written") / "a map.yaml"
    grid = Grid(lower, spacing, state.shape)
    write_ros_map(state, grid, path)
    cautious, bold = Workspace.from_ros_map(path), Workspace.from_ros_map(path, "free")
    assert cautious.grid == bold.grid == grid
    assert np.array_equal(cautious.outer, state != FREE)
    assert np.array_equal(bold.outer, state == BLOCKED)
    assert sorted(file.name for file in path.parent.iterdir()) == ["a map.pgm", "a map.yaml"]


def test_a_written_map_has_the_expected_bytes(tmp_path: Path) -> None:
    write_ros_map(
        np.array([[0, 1], [2, 0], [0, 0]]), Grid((-1.5, 1e-5), 1e-5, (3, 2)), tmp_path / "map.yaml"
    )
    assert (tmp_path / "map.pgm").read_bytes() == b"P5\n3 2\n255\n" + bytes(
        [205, 254, 254, 254, 0, 254]
    )
    header = yaml.safe_load((tmp_path / "map.yaml").read_text())
    assert header["origin"] == [-1.5, 1e-5, 0.0]
    assert header["resolution"] == 1e-5
    assert header["image"] == "map.pgm"


@pytest.mark.parametrize("existing", ["map.yaml", "map.pgm"])
def test_existing_outputs_are_kept(tmp_path: Path, existing: str) -> None:
    state, grid = np.zeros((2, 2), dtype=np.uint8), Grid((0.0, 0.0), 1.0, (2, 2))
    (tmp_path / existing).write_text("precious")
    with pytest.raises(FileError, match=f"{existing}: exists"):
        write_ros_map(state, grid, tmp_path / "map.yaml")
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [
        (existing, "precious")
    ]
    write_ros_map(state, grid, tmp_path / "map.yaml", overwrite=True)
    assert not Workspace.from_ros_map(tmp_path / "map.yaml").outer.any()


def test_an_interrupted_write_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_text", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_ros_map(
            np.zeros((2, 2), dtype=np.uint8), Grid((0.0, 0.0), 1.0, (2, 2)), tmp_path / "map.yaml"
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("depot", (604, 307)),
        ("tb3_sandbox", (384, 384)),
        ("100by100_10", (2000, 2000)),
        ("TenByTen", (10, 10)),
        ("turtlebot3_world", (384, 384)),
        ("willow-full-0.05", (1165, 945)),
        ("skirk", (431, 602)),
    ],
)
def test_real_maps_agree_with_a_plain_reading(
    data: Path, name: str, shape: tuple[int, int]
) -> None:
    path = data / "maps" / f"{name}.yaml"
    entries = dict(line.split(":", 1) for line in path.read_text().splitlines() if line.strip())
    with Image.open(path.parent / entries["image"].strip()) as image:
        (width, height), levels = image.size, image.convert("L").tobytes()
    assert (width, height) == shape
    assert len(levels) == width * height
    negate, low, high = (
        float(entries[key]) for key in ("negate", "free_thresh", "occupied_thresh")
    )
    kinds = {}
    for level in range(256):
        p = level / 255 if negate else (255 - level) / 255
        kinds[level] = "occupied" if p > high else "free" if p < low else "unknown"
    counts: Counter[str] = Counter()
    for level, count in Counter(levels).items():
        counts[kinds[level]] += count
    x, y, _ = (float(number) for number in entries["origin"].strip(" []").split(","))
    for unknown in ("occupied", "free"):
        workspace = Workspace.from_ros_map(path, unknown)
        assert workspace.grid == Grid((x, y), float(entries["resolution"]), shape)
        solid = {"occupied", "unknown"} if unknown == "occupied" else {"occupied"}
        assert workspace.outer.sum() == sum(counts[kind] for kind in solid)
        assert workspace.inner is workspace.outer
        for i, j in np.random.default_rng(2).integers(shape, size=(500, 2)).tolist():
            assert workspace.outer[i, j] == (kinds[levels[(height - 1 - j) * width + i]] in solid)
