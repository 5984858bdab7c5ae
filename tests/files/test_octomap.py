"""OctoMaps, against OctoMap's library."""

import os
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import Workspace
from cspace.errors import FileError
from tests.helpers.mesh_files import BINARY, CHAIN
from tests.helpers.refusals import refusals
from tests.helpers.strategies import examples, seeds

FULL = "# Octomap OcTree file\nid OcTree\nsize {}\nres 0.1\ndata\n"


def iterate_leaves(tree):
    """Yield the first cell, the side and the state of each leaf."""
    spacing = tree.getResolution()
    for leaf in tree.begin_leafs():
        side = round(leaf.getSize() / spacing)
        first = np.array(leaf.getCoordinate()) / spacing - side / 2
        yield np.round(first).astype(int), side, tree.isNodeOccupied(leaf)


def check_agreement(path, tree):
    """Fail unless the cells of a file agree with the library."""
    cautious = Workspace.open(path)
    bold = Workspace.open(path, unknown="free")
    grid = cautious.grid
    assert bold.grid == grid
    assert grid.spacing == tree.getResolution()
    assert np.allclose(grid.lower, tree.getMetricMin())
    assert np.allclose(grid.upper, tree.getMetricMax())
    origin = np.round(np.array(grid.lower) / grid.spacing).astype(int)
    assert np.allclose(grid.lower, origin * grid.spacing, rtol=1e-15)
    states = np.full(grid.shape, -1)
    for first, side, state in iterate_leaves(tree):
        cells = tuple(slice(start, start + side) for start in first - origin)
        assert states[cells].shape == (side, side, side)
        states[cells] = state
    assert (cautious.outer == (states != 0)).all()
    assert (bold.outer == (states == 1)).all()
    if cautious.unknown is None:
        assert (states >= 0).all()
    else:
        assert (cautious.unknown == (states == -1)).all()


def draw_tree(octomap, seed, kind):
    """Draw a tree of coarse and fine leaves."""
    rng = np.random.default_rng(seed)
    side = float(rng.choice([0.05, 0.1, 1.0]))
    tree = getattr(octomap, kind)(side)
    shift = rng.integers(-40, 40, 3)
    for value in (True, False):
        for _ in range(int(rng.integers(0, 3))):
            block = np.indices((8, 8, 8)).reshape(3, -1).T + 8 * rng.integers(-2, 2, 3)
            for point in (block + 0.5) * side:
                tree.updateNode(point, 10.0 if value else -10.0)
        for cell in rng.integers(-15, 15, (int(rng.integers(1, 40)), 3)) + shift:
            tree.updateNode((cell + 0.5) * side, value)
    return tree


@examples(15)
@given(seeds, st.sampled_from(["OcTree", "ColorOcTree"]))
def test_octomaps_agree_with_the_library(tmp_path_factory, seed, kind):
    octomap = pytest.importorskip("octomap")
    folder = tmp_path_factory.mktemp("trees")
    tree = draw_tree(octomap, seed, kind)
    tree.write(os.fsencode(folder / "tree.ot"))
    check_agreement(folder / "tree.ot", tree)
    tree.writeBinary(os.fsencode(folder / "tree.bt"))
    again = getattr(octomap, kind)(0.5)
    assert again.readBinary(os.fsencode(folder / "tree.bt"))
    check_agreement(folder / "tree.bt", again)


def test_a_leaf_is_occupied_from_even_odds_on(tmp_path):
    nodes = [(0.0, 1)] * 15 + [(0.0, 7), (0.0, 0), (1e-3, 0), (-1e-3, 0)]
    content = b"".join(struct.pack("<fB", odds, children) for odds, children in nodes)
    (tmp_path / "odds.ot").write_bytes(FULL.format(19).encode() + content)
    workspace = Workspace.open(tmp_path / "odds.ot", unknown="free")
    assert workspace.outer[:, :, 0].tolist() == [[True, False], [True, False]]
    assert workspace.grid.lower == pytest.approx((-3276.8,) * 3)


def make_binary(nodes, size, old="", new=""):
    """Return a binary OctoMap; replace a text of its header."""
    return BINARY.replace(old, new).format(size).encode() + nodes


@refusals(
    "content, message",
    (
        make_binary(CHAIN, 17, "OcTree\n", "OcTreeStamped\n"),
        "id 'OcTreeStamped'; only OcTree and ColorOcTree are read",
    ),
    (make_binary(CHAIN, 0), "holds 17 nodes but its header says 0; "),  # as octomap-python users do
    (make_binary(CHAIN, -1), "header has the size -1.0; .* at least 0"),
    (make_binary(CHAIN, 17, "res", "resolution"), "header has no res; .*, resolution"),
    (make_binary(CHAIN, 17, "res ", "res 0.2\nres "), "has res twice; .*"),
    (make_binary(CHAIN, 17, "res ", "res nan"), "header has the res 'nan"),
    (make_binary(b"", 0), "has no known cell"),
    (make_binary(CHAIN[:9], 17), "ends after 4 records"),
    (make_binary(b"\xff" * 4000, 1000), "an inner node below level 16"),
    (make_binary(b"\x03\x00\x00\x00", 2), "an inner node without children"),
    (FULL.format(1).encode() + struct.pack("<fB", np.nan, 0), "1 nodes without a value"),
)
def test_malformed_octomaps_are_refused(tmp_path, content, message):
    (tmp_path / "bad.bt").write_bytes(content)
    with pytest.raises(FileError, match=message):
        Workspace.open(tmp_path / "bad.bt")


def test_a_field_of_a_header_that_is_not_read_is_named(tmp_path):
    path = tmp_path / "a.bt"
    path.write_bytes(make_binary(CHAIN, 17, "res", "prob_hit 0.7\nres"))
    with pytest.warns(UserWarning, match="are not read: prob_hit"):
        Workspace.open(path)
    path.write_bytes(make_binary(CHAIN, 17))
    assert Workspace.open(path).outer.any()


@examples(15)
@given(seeds, st.sampled_from(["occupied", "free"]))
def test_bounds_cut_the_same_cells_out_of_an_octomap(tmp_path_factory, seed, unknown):
    octomap = pytest.importorskip("octomap")
    path = tmp_path_factory.getbasetemp() / "tree.bt"
    draw_tree(octomap, seed, "OcTree").writeBinary(os.fsencode(path))
    whole = Workspace.open(path, unknown=unknown)
    side = whole.grid.spacing
    rng = np.random.default_rng(seed)
    first = np.round(np.array(whole.grid.lower) / side).astype(int)
    low = first + rng.integers(-5, 10, 3)
    high = low + rng.integers(1, 25, 3)
    inset = rng.uniform(0.0, 0.9, (2, 3)) * [[1], [-1]] * (high - low > 1)
    cut = Workspace.open(path, unknown=unknown, bounds=(np.array([low, high]) + inset) * side)
    assert cut.grid.lower == pytest.approx(tuple(low * side))
    assert cut.grid.shape == tuple(high - low)
    seen = np.zeros(whole.grid.shape, bool) if whole.unknown is None else whole.unknown
    blind = np.zeros(cut.grid.shape, bool) if cut.unknown is None else cut.unknown
    padded = [
        np.pad(cells, 60, constant_values=value)
        for cells, value in ((whole.outer, unknown == "occupied"), (seen, True))
    ]
    window = tuple(map(slice, low - first + 60, high - first + 60))
    assert (cut.outer == padded[0][window]).all()
    assert (blind == padded[1][window]).all()
