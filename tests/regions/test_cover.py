"""Covers of maps by regions, against counts of cells and linear programs."""

import itertools
import json
from functools import cache

import numpy as np
import pytest
import shapely
from scipy.optimize import linprog

import cspace
from cspace import FREE, Robot, Workspace
from cspace.errors import ConfigurationError, FileError, InputError
from cspace.regions import FreeRegions
from cspace.regions._free_region import RegionSource
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.strategies import few
from tests.regions.test_free_region import build_yard, check_proof


def count_covered(space, regions):
    """Return the share of the centers of FREE cells that lie in a region."""
    free = np.asarray(space.cell_states) == FREE
    if space.axes[-1] != "yaw":
        centers = space.grid.center_of(np.argwhere(free))
        return np.mean(np.any([region.contains(centers) for region in regions], axis=0))
    covered = 0
    for yaw, cells in zip(space.rotations.centers, free, strict=True):
        centers = space.grid.center_of(np.argwhere(cells))
        q = np.column_stack([centers, np.full(len(centers), yaw)])
        covered += np.any([region.contains(q) for region in regions], axis=0).sum()
    return covered / free.sum()


def overlap(first, second):
    """Return whether two regions overlap, by a linear program of positions, and their arcs."""
    dim = first.A.shape[1]
    turns = [0.0]
    if first.axes[-1] == "yaw":
        turns = 2.0 * np.pi * np.arange(-2, 3)
    deepest = []
    for turn in turns:
        rows = np.vstack([first.A, second.A])
        shift = turn * second.A[:, -1] if len(turns) > 1 else 0.0
        offsets = np.concatenate([first.b, second.b + shift])
        constraints = np.column_stack([rows, np.ones(len(rows))])
        cost = np.append(np.zeros(dim), -1.0)
        deepest.append(linprog(cost, constraints, offsets, bounds=(None, None)).x[-1])
    return max(deepest)


@pytest.mark.parametrize(
    "rotations, share", few([(None, 0.8), (12, 0.3), (None, 0.95), (12, 0.7)], 2)
)
def test_regions_cover_the_share_and_overlap_as_the_graph_says(rotations, share):
    space = build_yard(rotations)
    shares = []
    cover = space.free_regions(share, reach=3.0, progress=lambda n, part: shares.append((n, part)))
    assert cover.coverage >= share and cover.coverage == shares[-1][1]
    assert [n for n, _ in shares] == list(range(1, len(cover.regions) + 1))
    assert cover.coverage == pytest.approx(count_covered(space, cover.regions), abs=1e-9)
    for region in cover.regions[:10]:
        check_proof(space, region)
    numbered = list(enumerate(cover.regions))[:25]
    for (i, first), (j, second) in itertools.combinations(numbered, 2):
        depth = overlap(first, second)
        if abs(depth) > 1e-9:
            assert ((i, j) in cover.graph) == (depth > 0.0)
    for (i, j), point in cover.graph.items():
        assert cover.regions[i].contains(point) and cover.regions[j].contains(point)
    assert repr(cover).startswith(f"FreeRegions({len(cover.regions)} regions, ")


def test_a_cover_around_a_configuration_counts_its_component():
    occupied = np.zeros((60, 30), dtype=bool)
    occupied[30] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.2))
    room = space.free_regions(1.0, around=(1.0, 1.0))
    assert len(room.regions) == 1 and room.coverage == 1.0 and not room.graph
    assert room.regions[0].bounds[1][0] < 3.0
    both = space.free_regions(1.0)
    assert len(both.regions) == 2 and not both.graph


@pytest.mark.parametrize("rounds", few([2, 5]))
def test_a_smaller_margin_covers_more_in_the_mean(rounds):
    space = build_yard(None)
    covered = [
        np.mean(
            [
                space.free_regions(1.0, margin=m, max_regions=6, seed=k).coverage
                for k in range(rounds)
            ]
        )
        for m in (0.0, 0.05, 0.15)
    ]
    assert covered[0] > covered[1] > covered[2]


@pytest.mark.parametrize("rounds", few([8, 40]))
@pytest.mark.parametrize("outside, rotations", [("blocked", None), ("free", 5)])
def test_a_cover_tries_only_centers_that_keep_the_margin(outside, rotations, monkeypatch, rounds):
    """Each center that is drawn has a region, so a large margin takes no longer."""
    occupied = np.random.default_rng(3).random((40, 40)) < 0.01
    workspace = Workspace.from_array(occupied, 0.1)
    robot = Robot.rectangle(0.3, 0.2)
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    grown = []
    grow_around = RegionSource.grow_around

    def count(source, point, yaw_width):
        grown.append(grow_around(source, point, yaw_width))
        return grown[-1]

    monkeypatch.setattr(RegionSource, "grow_around", count)
    for margin in (0.05, 0.1, 0.15, 0.25):
        cover = space.free_regions(1.0, margin=margin, max_regions=rounds)
        assert all(grown) and len(grown) == len(cover.regions)
        grown.clear()


def test_limits_end_a_cover_and_the_share_is_told():
    space = build_yard(None)
    few = space.free_regions(1.0, max_regions=3)
    assert len(few.regions) == 3 and 0.2 < few.coverage < 1.0
    assert few.coverage == pytest.approx(count_covered(space, few.regions))
    again = space.free_regions(1.0, max_regions=3)
    assert all(np.array_equal(a.A, b.A) for a, b in zip(few.regions, again.regions, strict=True))
    # Cells within the margin of others are in no region, so the search ends.
    rest = space.free_regions(1.0, margin=0.1)
    assert rest.coverage < 1.0


def test_a_cover_in_space():
    occupied = np.zeros((20, 16, 12), dtype=bool)
    occupied[9:11, :9] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.ball(0.15))
    cover = space.free_regions(0.9)
    assert cover.coverage == pytest.approx(count_covered(space, cover.regions))
    assert len(cover.regions) < 8 and cover.plot().name == "3d"


def test_covers_are_drawn():
    space = build_yard(None)
    cover = space.free_regions(0.5)
    axes = cover.plot(space.plot())
    paths = axes.collections[-1].get_paths()
    areas = [shapely.Polygon(path.vertices).area for path in paths]
    np.testing.assert_allclose(areas, [region.volume for region in cover.regions])


# ---- files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("rotations", [None, 12])
def test_saved_regions_are_opened_to_the_last_bit(rotations, tmp_path):
    space = build_yard(rotations)
    cover = space.free_regions(0.4)
    cover.save(tmp_path / "regions.json")
    opened = FreeRegions.open(tmp_path / "regions.json")
    assert opened.coverage == cover.coverage and opened.graph.keys() == cover.graph.keys()
    for one, other in zip(cover.regions, opened.regions, strict=True):
        assert one.axes == other.axes
        assert np.array_equal(one.A, other.A) and np.array_equal(one.b, other.b)
    for pair, point in cover.graph.items():
        assert np.array_equal(point, opened.graph[pair])
    with pytest.raises(FileError, match="exists"):
        cover.save(tmp_path / "regions.json")
    cover.save(tmp_path / "regions.json", overwrite=True)
    for call in (cover.save, FreeRegions.open):
        with pytest.raises(InputError, match=r"suffix '\.txt'; regions are saved as JSON"):
            call(tmp_path / "regions.txt")


TRIANGLE = {"A": [[1.0, 0.0], [0.0, 1.0], [-0.6, -0.8]], "b": [1.0, 1.0, 1.0]}
"""A region in the plane, as it is saved."""

PRISM = {
    "A": [[*row, 0.0] for row in TRIANGLE["A"]] + [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]],
    "b": [*TRIANGLE["b"], 0.5, 0.5],
}
"""A region with a yaw, as it is saved."""


@cache
def cover_yard():
    """Return regions of a third of a yard."""
    return build_yard(None).free_regions(0.3)


def change_region(record, **change):
    """Return the fields of a file of one region, which differs."""
    axes = ["x", "y", "yaw"][: len(record["A"][0])]
    return {"axes": axes, "regions": [record | change], "pairs": [], "points": []}


def join_regions(point, pairs=([0, 1],)):
    """Return the fields of a file of two regions, the second 0.5 m further along x."""
    second = TRIANGLE | {"b": [1.5, 1.0, 0.7]}
    record = {"axes": ["x", "y"], "regions": [TRIANGLE, second]}
    return record | {"pairs": pairs, "points": [point] * len(pairs)}


@refusals(
    "change, message",
    ({"format": "cspace-map"}, "the format is 'cspace-map'"),
    ({"format": None}, "has no format"),
    ({"version": 2}, "has the unknown field 'version'"),
    ({"coverage": 7.0}, "has the coverage 7.0; it must be a finite number, at least 0, at most 1"),
    ({"coverage": True}, "has the coverage True"),
    ({"axes": ["x", "y", "z", "u"]}, "the axes are ['x', 'y', 'z', 'u']"),
    ({"axes": ["q", "q"]}, "the axes are ['q', 'q']"),
    ({"axes": ["yaw", "x"]}, "the axes are ['yaw', 'x']"),
    ({"axes": ["x", 2]}, "the axes are ['x', 2]"),
    ({"axes": ["", "y"]}, "the axes are ['', 'y']"),
    ({"axes": ["x"]}, "the axes are ['x']"),
    ({"axes": ["x", "y", "z"]}, "cannot reshape"),
    ({"regions": None}, "there are no regions"),
    ({"regions": [], "pairs": [], "points": []}, "there are no regions"),
    (change_region(TRIANGLE, c=1.0), "has the unknown field 'c'"),
    (change_region(TRIANGLE, b=None), "has no b"),
    (change_region(TRIANGLE, A=[[2.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]), "length 1"),
    (change_region(TRIANGLE, A=[[1.0, 0.0], [0.0, 1.0]], b=[1.0, 1.0]), "more than there are axes"),
    (change_region(TRIANGLE, b=[1.0, 1.0]), "cannot reshape"),
    (change_region(TRIANGLE, b=[True, True, True]), "an entry is no number"),
    (change_region(TRIANGLE, b=[1e300, 1e300, 1e300]), "an entry is no number, or not finite"),
    (change_region(TRIANGLE, b=[-1.0, -1.0, -1.0]), "a region is empty or has no end"),
    (change_region(TRIANGLE, A=[[1.0, 0.0]] * 3), "a region is empty or has no end"),
    (change_region(TRIANGLE, A=[[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]]), "is empty or has no end"),
    (change_region(PRISM, A=PRISM["A"][::-1], b=PRISM["b"][::-1]), "do not bound an arc of yaws"),
    (change_region(PRISM, b=[1.0, 1.0, 1.0, 0.5, -0.6]), "do not bound an arc of yaws"),
    (change_region(PRISM, A=[[0.6, 0.0, 0.8], *PRISM["A"][1:]]), "do not bound an arc of yaws"),
    (change_region(PRISM, A=[*PRISM["A"][:4], PRISM["A"][3]]), "do not bound an arc of yaws"),
    ({"pairs": None, "points": None}, "has no pairs"),
    ({"pairs": [], "points": None}, "has no points"),
    (join_regions([0.0, 0.0]) | {"pairs": []}, "argument 2 is longer"),
    (join_regions([0.0, 0.0], [[0, 99]]), "the pair [0, 99] names no two regions"),
    (join_regions([0.0, 0.0], [[1, 0]]), "the pair [1, 0] names no two regions"),
    (join_regions([0.0, 0.0], [[-1, 1]]), "the pair [-1, 1] names no two regions"),
    (join_regions([0.0, 0.0], [[0, 0]]), "the pair [0, 0] names no two regions"),
    (join_regions([0.0, 0.0], [[0, 1], [0, 1]]), "the pair [0, 1] names no two regions, or is"),
    (join_regions([0.0, 0.0], [[0.0, 1.0]]), "must be integers"),
    (join_regions([1.2, 0.0]), "the pair [0, 1] is not in both regions"),
    (join_regions([-1.6, 0.0]), "[0, 1] is not in both regions"),
    ({"points": [[0.0, float("nan")]]}, "not finite"),
)
def test_damaged_files_are_refused(change, message, tmp_path):
    path = tmp_path / "regions.json"
    cover = cover_yard()
    cover.save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(FileError) as caught:
        FreeRegions.open(path)
    assert message in str(caught.value) and str(path) in str(caught.value)

    cover.save(path, overwrite=True)
    FreeRegions.open(path)


@pytest.mark.parametrize(
    "change",
    [
        join_regions([1.0 + 1e-9, 0.0]),
        change_region(TRIANGLE, b=[0.3 - 1e-9, 0.3, -0.42]),
        change_region(PRISM, b=[1.0, 1.0, 1.0, 0.5, -0.5]),
    ],
    ids=["a point on the border", "a region of one point", "an arc of one yaw"],
)
def test_files_with_errors_of_rounding_are_opened(change, tmp_path):
    space = build_yard(None)
    path = tmp_path / "regions.json"
    space.free_regions(0.1).save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    assert len(FreeRegions.open(path).regions) == len(change["regions"])


# ---- refusals ------------------------------------------------------------------------------------


@refusals(
    "options, message",
    ({"share": 0.0}, "share is 0.0"),
    ({"share": "most"}, "share is 'most'"),
    ({"max_regions": 0}, "max_regions is 0"),
    ({"seed": -1}, "seed is -1"),
    ({"time_limit": 0.0}, "time_limit is 0.0"),
    ({"around": (3.0, 9.0)}, "around is (3.0, 9.0)"),
)
def test_arguments_are_refused(options, message):
    space = build_yard(None)
    with pytest.raises(InputError) as caught:
        space.free_regions(**options)
    assert message in str(caught.value)


def test_maps_without_room_are_refused():
    space = build_yard(None)
    check_refused(
        lambda: space.free_regions(1.5),
        "share is 1.5 ... most",
    )
    check_refused(
        lambda: space.free_regions(margin=0.1, time_limit=1e-9),
        "free_regions ended before the first region ... cover",
    )
    widest = space.clearance(space.grid.center_of(np.argwhere(space.cell_states == FREE))).max()
    check_refused(lambda: space.free_regions(margin=5.0), f"the farthest is {widest:.4g} m away")
    with pytest.warns(UserWarning, match="FREE"):
        full = cspace.build(Workspace.from_array(np.ones((9, 9), bool), 0.1), Robot.disc(0.2))
    with pytest.raises(ConfigurationError, match="has no FREE cell"):
        full.free_regions()
