"""Voxel maps, and OctoMaps against OctoMap's library."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import Grid, Workspace
from cspace.errors import FileError, InputError
from cspace.files.images import read_movingai_voxels
from cspace.support.arrays import Bools
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

BINARY = "# Octomap OcTree binary file\n# a comment\nid OcTree\nsize {}\nres 0.1\ndata\n"
FULL = "# Octomap OcTree file\nid OcTree\nsize {}\nres 0.1\ndata\n"
TINY_3DMAP = "voxel 2 3 4\n0 0 0\n1 2 3\n1 0 2\n"


def read_octomap(path: Path, unknown: str = "occupied") -> tuple[Grid, Bools, Bools]:
    """Return grid, occupied cells and unknown cells."""
    result = Workspace.from_octomap(path, unknown)
    return (
        result.grid,
        result.outer,
        np.zeros_like(result.outer) if result.unknown is None else result.unknown,
    )


def test_a_tiny_voxel_map_has_the_expected_cells(tmp_path: Path) -> None:
    (tmp_path / "tiny.3dmap").write_text(TINY_3DMAP)
    blocked = read_movingai_voxels(tmp_path / "tiny.3dmap")
    assert blocked.shape == (2, 3, 4)
    assert np.argwhere(blocked).tolist() == [[0, 0, 0], [1, 0, 2], [1, 2, 3]]


@pytest.mark.parametrize(
    "text",
    [
        TINY_3DMAP.replace("\n", "\r\n"),
        TINY_3DMAP + "\n\n",
        TINY_3DMAP + "1 0 2",
        TINY_3DMAP.replace(" ", "  "),
    ],
)
def test_a_tiny_voxel_map_is_read_in_every_layout(tmp_path: Path, text: str) -> None:
    (tmp_path / "tiny.3dmap").write_bytes(text.encode())
    assert read_movingai_voxels(tmp_path / "tiny.3dmap").sum() == 3


def test_a_voxel_map_may_have_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / "free.3dmap").write_text("voxel 2 3 4")
    assert not read_movingai_voxels(tmp_path / "free.3dmap").any()


@refusals(
    "text, message",
    ("", "line 1 is ''"),
    ("type octile\n", "line 1 is 'type octile'"),
    ("voxel 2 3\n", "line 1 is 'voxel 2 3'"),
    ("voxel 2 3 -4\n", "line 1 is 'voxel 2 3 -4'"),
    ("voxel " + "9" * 5000 + " 3 4\n", "line 1 is 'voxel 999"),
    (TINY_3DMAP + "1 2 " + "9" * 5000 + "\n", "line 5 is '1 2 999"),
    ("voxel 2 0 4\n", "line 1 is 'voxel 2 0 4'"),
    ("voxel 2 3 4.0\n", "line 1 is 'voxel 2 3 4.0'"),
    (TINY_3DMAP + "1 2\n", "line 5 is '1 2'; it must hold 'x y z'"),
    (TINY_3DMAP + "1 2 3 0\n", "line 5 is '1 2 3 0'"),
    (TINY_3DMAP + "1 2.5 3\n", "line 5 is '1 2.5 3'"),
    (TINY_3DMAP + "1 -2 3\n", "line 5 is '1 -2 3'"),
    (TINY_3DMAP + "1 two 3\n", "line 5 is '1 two 3'"),
    (TINY_3DMAP + "\n\n2 0 0\n", "line 7 is '2 0 0'; it must hold a voxel inside 2 x 3 x 4"),
    (TINY_3DMAP + "0 3 0\n", "line 5 is '0 3 0'; it must hold a voxel inside"),
    (TINY_3DMAP + "0 0 4\n0 0 5\n", "line 5 is '0 0 4'; it must hold a voxel inside"),
    (TINY_3DMAP + "99999999999999999999999 0 4\n", "line 5 is '99999999999999999999999 0 4'"),
    ("voxel 2 3 4\n1 2\n1 2\n", "line 2 is '1 2'"),
    ("voxel 2 3 4\n\u0661 2 3\n", "line 2 is"),
)
def test_malformed_voxel_maps_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.3dmap").write_text(text, encoding="utf-8")
    with pytest.raises(FileError) as caught:
        read_movingai_voxels(tmp_path / "bad.3dmap")
    assert message in str(caught.value)


@refusals(
    "read, content, message",
    (
        read_movingai_voxels,
        b"voxel 1000000 1000000 1000000\n",
        r"1000000 x 1000000 x 1000000 cells, 1e\+18 in all; at most",
    ),
    (
        read_octomap,
        FULL.format(1).encode() + struct.pack("<fB", -1.0, 0),
        r"65536 x 65536 x 65536 cells, 2.815e\+14 in all; at most",
    ),
)
def test_maps_larger_than_memory_or_missing_are_refused(tmp_path, read, content, message):
    path = tmp_path / "huge"
    with pytest.raises(FileError, match=r"does not exist; an? (MovingAI|OctoMap)"):
        read(path)
    path.write_bytes(content)
    with pytest.raises(FileError, match=message) as caught:
        read(path)
    assert not any(word in str(caught.value) for word in ("spacing", "bounds"))


@pytest.mark.parametrize(
    ("name", "shape"), [("Simple", (105, 132, 105)), ("Complex", (246, 154, 205))]
)
def test_real_voxel_maps_agree_with_a_plain_reading(
    data: Path, name: str, shape: tuple[int, int, int]
) -> None:
    path = data / "voxels" / f"{name}.3dmap"
    expected = np.zeros(shape, dtype=bool)
    for line in path.read_text().splitlines()[1:]:
        x, y, z = map(int, line.split())
        expected[x, y, z] = True
    assert (read_movingai_voxels(path) == expected).all()


def decode_leaves(tree):
    """Return cell, side and state of each leaf."""
    side = tree.getResolution()
    for leaf in tree.begin_leafs():
        size = round(leaf.getSize() / side)
        low = np.array(leaf.getCoordinate()) / side - size / 2
        yield np.round(low).astype(int), size, tree.isNodeOccupied(leaf)


def agrees(path, tree):
    """Fail unless cells agree with the library."""
    grid, solid, unknown = read_octomap(path)
    free_grid, occupied, _ = read_octomap(path, "free")
    assert grid == free_grid
    assert grid.spacing == tree.getResolution()
    first = np.round(np.array(grid.lower) / grid.spacing).astype(int)
    assert np.allclose(grid.lower, first * grid.spacing, rtol=1e-15)
    expected = np.full(grid.shape, -1)
    for low, size, state in decode_leaves(tree):
        start = low - first
        assert (start >= 0).all()
        assert (start + size <= grid.shape).all()
        expected[tuple(slice(a, a + size) for a in start)] = state
    assert np.allclose(grid.lower, tree.getMetricMin())
    assert np.allclose(grid.upper, tree.getMetricMax())
    assert (solid == (expected != 0)).all()
    assert (occupied == (expected == 1)).all()
    assert (unknown == (expected == -1)).all()
    return expected


def draw_tree(octomap, seed, kind="OcTree"):
    """Draw a tree of coarse and fine leaves."""
    rng = np.random.default_rng(seed)
    side = float(rng.choice([0.05, 0.1, 1.0]))
    tree = getattr(octomap, kind)(side)
    shift = rng.integers(-40, 40, 3)
    for value in (True, False):
        for _ in range(int(rng.integers(0, 3))):
            corner = rng.integers(-2, 2, 3) * 8
            block = np.stack(
                np.meshgrid(*(corner[a] + np.arange(8) for a in range(3))), axis=-1
            ).reshape(-1, 3)
            for point in (block + 0.5) * side:
                tree.updateNode(point, 10.0 if value else -10.0)
        for point in (rng.integers(-15, 15, (int(rng.integers(1, 40)), 3)) + shift + 0.5) * side:
            tree.updateNode(point, value)
    return tree


@settings(max_examples=15)
@given(seeds, st.sampled_from(["OcTree", "ColorOcTree"]))
def test_octomaps_agree_with_the_library(tmp_path_factory, seed, kind):
    octomap = pytest.importorskip("octomap")
    folder = tmp_path_factory.mktemp("trees")
    tree = draw_tree(octomap, seed, kind)
    tree.write(os.fsencode(folder / "tree.ot"))
    agrees(folder / "tree.ot", tree)
    tree.writeBinary(os.fsencode(folder / "tree.bt"))
    again = getattr(octomap, kind)(0.5)
    assert again.readBinary(os.fsencode(folder / "tree.bt"))
    agrees(folder / "tree.bt", again)


def test_coarse_leaves_are_expanded(tmp_path):
    octomap = pytest.importorskip("octomap")
    tree = octomap.OcTree(0.25)
    for index in np.ndindex(8, 8, 8):
        tree.updateNode((np.array(index) + 0.5) * 0.25, 10.0)
    tree.updateNode(np.array([4.1, 0.1, 0.1]), -10.0)
    tree.write(os.fsencode(tmp_path / "block.ot"))
    assert {size for _, size, _ in decode_leaves(tree)} == {8, 1}
    expected = agrees(tmp_path / "block.ot", tree)
    assert (expected[:8, :8, :8] == 1).all()
    assert (expected[8:] == 1).sum() == 0


def test_a_real_octomap_agrees_with_the_library(data):
    octomap = pytest.importorskip("octomap")
    path = data / "voxels" / "geb079.bt"
    grid, solid, _ = read_octomap(path)
    assert grid.shape == (487, 187, 39)
    assert grid.spacing == 0.08
    _, occupied, _ = read_octomap(path, "free")
    assert (occupied <= solid).all()
    assert 0.67 < (solid & ~occupied).mean() < 0.69
    tree = octomap.OcTree(0.1)
    assert tree.readBinary(os.fsencode(path))
    rng = np.random.default_rng(3)
    for cell in rng.integers(0, grid.shape, (3000, 3)):
        node = tree.search(grid.center_of(cell))
        try:
            state = tree.isNodeOccupied(node)
        except octomap.NullPointerException:
            state = None
        assert solid[tuple(cell)] == (state is not False)
        assert occupied[tuple(cell)] == (state is True)


def make_chain(length=16):
    """Return nodes of a tree with one occupied cell."""
    return b"\x03\x00" * (length - 1) + b"\x02\x00"


def test_a_cell_lies_where_its_path_leads(tmp_path):
    (tmp_path / "one.bt").write_bytes(BINARY.format(17).encode() + make_chain())
    grid, occupied, _ = read_octomap(tmp_path / "one.bt")
    assert grid.shape == (1, 1, 1)
    assert grid.lower == pytest.approx((-3276.8,) * 3)
    assert occupied.all()


def test_a_leaf_is_occupied_from_even_odds_on(tmp_path):
    nodes = b"".join(struct.pack("<fB", 0.0, 1) for _ in range(15)) + struct.pack("<fB", 0.0, 7)
    nodes += b"".join(struct.pack("<fB", odds, 0) for odds in (0.0, 1e-3, -1e-3))
    (tmp_path / "odds.ot").write_bytes(FULL.format(19).encode() + nodes)
    _, occupied, _ = read_octomap(tmp_path / "odds.ot", "free")
    assert occupied[:, :, 0].tolist() == [[True, False], [True, False]]


@refusals(
    "content, message",
    (b"", "is empty"),
    (b"hello\n", "begins with 'hello'"),
    (BINARY.format(17).encode()[:60], "no line 'data'"),
    (
        BINARY.replace("OcTree\n", "CountingTree\n").format(17).encode() + make_chain(),
        "'CountingTree'",
    ),
    (BINARY.replace("id OcTree\n", "").format(17).encode() + make_chain(), "type ''"),
    (BINARY.format("many").encode() + make_chain(), "size 'many'"),
    (BINARY.format(-1).encode() + make_chain(), "size '-1'"),
    (BINARY.replace("0.1", "nan").format(17).encode() + make_chain(), "res 'nan'"),
    (BINARY.replace("0.1", "0").format(17).encode() + make_chain(), "res '0'"),
    (BINARY.format(0).encode(), "has no known cell"),
    (BINARY.format(17).encode(), "ends after 0 records"),
    (BINARY.format(17).encode() + make_chain()[:9], "ends after 4 records"),
    (BINARY.format(10).encode() + make_chain(), "holds 17 nodes but its header says 10"),
    (BINARY.format(100).encode() + make_chain(), "holds 17 nodes but its header says 100"),
    (BINARY.format(1000).encode() + b"\xff" * 4000, "an inner node below level 16"),
    (BINARY.format(2).encode() + b"\x03\x00\x00\x00", "an inner node without children"),
    (BINARY.format(1).encode() + b"\xaa\xaa", "holds 9 nodes but its header says 1"),
    (
        FULL.format(3).encode() + struct.pack("<fB", 1.0, 255),
        "ends after 1 records",
    ),
    (FULL.format(3).encode() + struct.pack("<fB", 1.0, 255) * 2 + b"123", "ends after 2 records"),
    (FULL.format(99).encode() + struct.pack("<fB", 1.0, 1) * 99, "an inner node below level 16"),
    (
        FULL.format(2).encode() + struct.pack("<fBfB", 1.0, 1, float("nan"), 0),
        "1 nodes without a value (NaN)",
    ),
)
def test_malformed_octomaps_are_refused(tmp_path, content, message):
    path = tmp_path / "bad.bt"
    path.write_bytes(content)
    with pytest.raises(FileError) as caught:
        read_octomap(path)
    assert message in str(caught.value)


@settings(max_examples=30)
@given(st.binary(max_size=400), st.sampled_from([BINARY, FULL]), st.integers(1, 300))
def test_no_bytes_crash_the_reader(tmp_path_factory, nodes, header, size):
    path = tmp_path_factory.getbasetemp() / "any.bt"
    path.write_bytes(header.format(size).encode() + nodes)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cspace.limits.free_bytes", lambda: 10**7)
        try:
            _, occupied, _ = read_octomap(path)
        except (FileError, InputError):
            return
    assert occupied.ndim == 3


def test_the_unknown_policy_is_one_of_two_words(tmp_path):
    with pytest.raises(InputError, match=r"'maybe'.*'occupied' or 'free'"):
        read_octomap(tmp_path / "any.bt", "maybe")
