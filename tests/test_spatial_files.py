"""Files of maps in space: complete, with the obstacles themselves to the last bit."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import trimesh
import xarray
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import cspace
from cspace.shapes import Balls
from cspace.errors import InputError
from cspace.io import store
from cspace.io.reading import open_map, open_slice
from cspace.io.writing import export, save
from cspace.shapes.mesh import Mesh
from maps import SUFFIXES, files, forged, interrupted, rebuilt, refused, same

TABLES = ["vertices", "faces", "centers", "radii"]

ROBOTS = {
    "ball": cspace.Robot.ball(0.17, (0.1, 0.0, -0.05)),
    "balls": cspace.Robot.balls([(0.0, 0.0, 0.0), (0.1, 0.2, 0.3)], [0.1, 0.15]),
    "box": cspace.Robot.box((0.3, 0.2, 0.1)),
    "voxels": cspace.Robot.cells(np.array([[[True, False], [True, True]]]), 0.1, (-0.1, 0.0, 0.03)),
    "mesh": cspace.Robot.mesh(trimesh.creation.icosphere(subdivisions=1, radius=0.2)),
}


def balls(centers: Any, radii: Any) -> Balls:
    return Balls(np.array(centers, dtype=np.float64), np.array(radii, dtype=np.float64))


@st.composite
def shapes(draw: st.DrawFn) -> Any:
    """A mesh or balls, with any content."""
    number = st.floats(-1e6, 1e6)
    rows = draw(st.integers(1, 6))
    points = draw(hnp.arrays(np.float64, (rows, 3), elements=number))
    if draw(st.booleans()):
        return Balls(points, draw(hnp.arrays(np.float64, rows, elements=st.floats(0.0, 9.0))))
    faces = draw(hnp.arrays(np.int64, st.tuples(st.integers(1, 7), st.just(3)), elements=st.integers(0, rows - 1)))
    return Mesh(
        points, faces, solid=draw(st.sampled_from(["auto", "surface", "fill"])), source=draw(st.text(max_size=5))
    )


@st.composite
def spaces(draw: st.DrawFn) -> cspace.CSpace:
    """Maps with any content: the files must carry what is there, not what a build would give."""
    shape = draw(st.tuples(*[st.integers(1, 6)] * 3))
    grid = cspace.Grid(draw(st.tuples(*[st.floats(-100.0, 100.0)] * 3)), draw(st.floats(0.01, 3.0)), shape)
    outer = draw(hnp.arrays(bool, shape))
    inner = draw(st.one_of(st.just(outer), hnp.arrays(bool, shape).map(lambda cells: cells & outer)))
    return cspace.CSpace(
        cspace.Workspace(
            grid=grid,
            outer=outer,
            inner=inner,
            source=draw(st.text(max_size=9)),
            shapes=draw(st.none() | st.lists(shapes(), max_size=4).map(tuple)),
        ),
        ROBOTS[draw(st.sampled_from(sorted(ROBOTS)))],
        draw(hnp.arrays(np.uint8, shape, elements=st.integers(0, 2))),
        outside=draw(st.sampled_from(["blocked", "free"])),
        margin=draw(st.floats(0.0, 2.0)),
        precision=draw(st.sampled_from(["float32", "float64"])),
        overlaps=draw(st.one_of(st.none(), hnp.arrays(np.int32, shape, elements=st.integers(0, 2**31 - 1)))),
    )


@pytest.fixture
def space() -> cspace.CSpace:
    """A map with everything: inner differs from outer, and overlaps and several shapes of both kinds are there."""
    housing = Mesh.of(trimesh.creation.box((0.6, 0.5, 0.4)))
    base = cspace.Workspace.from_mesh(housing, 0.1, (-1.0, -0.9, -0.8, 1.0, 0.9, 0.8))
    more = (balls([(0.5, 0.5, 0.5)], [0.2]), housing, balls([(-0.8, 0.0, 0.1), (0.0, 0.0, 0.7)], [0.0, 0.1]))
    workspace = cspace.Workspace(base.grid, base.outer, base.inner, source=base.source, shapes=(*more, housing))
    return cspace.build(workspace, ROBOTS["box"], overlap=True, margin=0.03)


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(space=spaces())
@settings(max_examples=25)
def test_a_map_comes_back_as_it_was(suffix: str, space: cspace.CSpace) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"map{suffix}"
        save(space, path)
        same(space, open_map(path))
        np.testing.assert_array_equal(open_slice(path), space.state)
        np.testing.assert_array_equal(open_slice(path, 2.0), space.state)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_built_map_comes_back_as_it_was(tmp_path: Path, space: cspace.CSpace, robot: str, suffix: str) -> None:
    built = cspace.build(space.workspace, ROBOTS[robot], outside="free")
    built.save(tmp_path / f"map{suffix}")
    opened = cspace.open(tmp_path / f"map{suffix}")
    same(built, opened)
    again = cspace.build(opened.workspace, opened.robot, outside="free")
    np.testing.assert_array_equal(again.state, built.state)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_map_that_is_read_is_as_exact(tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("fcl", reason="exact look-ups in space need the extra: pip install 'cspace[exact]'")
    cube = Mesh.of(trimesh.creation.icosphere(subdivisions=1, radius=0.4))
    space = cspace.build(cspace.Workspace.from_mesh(cube, 0.1, (-1, -1, -1, 1, 1, 1)), ROBOTS["ball"])
    save(space, tmp_path / f"map{suffix}")
    q = np.random.default_rng(5).uniform(-0.8, 0.8, (300, 3))
    answers = space.is_free(q, exact=True)
    assert answers.sum() > space.is_free(q).sum()
    np.testing.assert_array_equal(open_map(tmp_path / f"map{suffix}").is_free(q, exact=True), answers)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_only_what_is_there_is_stored(tmp_path: Path, suffix: str) -> None:
    """A map that is itself a grid has no shapes; balls need no tables of meshes."""
    grid = cspace.Workspace.from_array(np.eye(4, dtype=bool)[:, :, None], 0.5)
    discs = cspace.Workspace(grid.grid, grid.outer, grid.outer, shapes=(balls([(1.0, 1.0, 0.2)], [0.3]),))
    nothing = cspace.Workspace(grid.grid, grid.outer, grid.outer, shapes=())
    for number, (workspace, stored) in enumerate(
        [(grid, set()), (discs, {"shapes", "centers", "radii"}), (nothing, {"geometry"})]
    ):
        path = tmp_path / f"{number}map{suffix}"
        space = cspace.build(workspace, ROBOTS["ball"])
        save(space, path)
        same(space, open_map(path))
        held = np.load(path).files if suffix == ".npz" else [entry.name for entry in path.iterdir()]
        assert {"shapes", "geometry", *TABLES} & set(held) == stored
        assert "inner" not in held


def test_chunks_are_a_few_megabytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, space: cspace.CSpace) -> None:
    workspace = cspace.Workspace.from_array(np.zeros((300, 140, 260), dtype=bool), 0.1)
    save(
        cspace.CSpace(
            workspace,
            ROBOTS["ball"],
            np.zeros((300, 140, 260), dtype=np.uint8),
            outside="free",
            margin=0.0,
            precision="float32",
        ),
        tmp_path / "large",
    )
    assert zarr.open_array(tmp_path / "large" / "state", mode="r").chunks == (128, 128, 128)
    assert len(list(files(tmp_path / "large" / "state" / "c"))) == 3 * 2 * 3
    monkeypatch.setattr(store, "_CHUNK", {1: 7, 2: 16, 3: 4})
    monkeypatch.setattr(store, "_ROWS", 3)
    save(space, tmp_path / "map")
    assert len(list(files(tmp_path / "map" / "vertices" / "c"))) == 6
    assert len(list(files(tmp_path / "map" / "state" / "c"))) > 50
    same(space, open_map(tmp_path / "map"))


@pytest.mark.parametrize("old", [False, True])
def test_an_interrupted_save_leaves_no_half_map(tmp_path: Path, space: cspace.CSpace, old: bool) -> None:
    earlier = cspace.build(space.workspace, ROBOTS["ball"]) if old else None
    interrupted(tmp_path / "map", space, KeyboardInterrupt, earlier)


# Other software.


def test_a_dataset_is_labelled(space: cspace.CSpace) -> None:
    dataset = space.to_xarray()
    assert dataset.state.dims == dataset.overlap.dims == dataset.outer.dims == dataset.inner.dims == ("x", "y", "z")
    assert set(dataset.coords) == {"x", "y", "z"}
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(dataset[name], space.grid.centers(axis))
        assert dataset[name].attrs["units"] == "m"
    assert dataset.vertices.attrs["units"] == dataset.centers.attrs["units"] == dataset.radii.attrs["units"] == "m"
    assert all(dataset[name].attrs["long_name"] for name in dataset.variables)
    q = np.stack(np.meshgrid(dataset.x, dataset.y, dataset.z, indexing="ij"), axis=-1)
    np.testing.assert_array_equal(dataset.state, space.classify(q))
    assert dataset.vertices.shape == (16, 3)
    assert dataset.faces.shape == (24, 3)
    assert dataset.centers.shape == (3, 3)
    assert dataset.radii.values.tolist() == [0.2, 0.0, 0.1]


def test_a_dataset_does_not_open_the_map_to_change(space: cspace.CSpace) -> None:
    dataset = space.to_xarray()
    for name in ("state", "vertices", "faces", "centers"):
        with pytest.raises(ValueError, match="read-only"):
            dataset[name].values[0, 0] = 0
    dataset.copy(deep=True).vertices[0, 0] = 7.0


def test_a_dataset_survives_zarr_and_netcdf(tmp_path: Path, space: cspace.CSpace) -> None:
    dataset = space.to_xarray()
    same(space, rebuilt(dataset))
    dataset.to_zarr(tmp_path / "set.zarr", zarr_format=3, consolidated=False)
    with xarray.open_zarr(tmp_path / "set.zarr", consolidated=False) as opened:
        assert opened.identical(dataset)
        same(space, rebuilt(opened.load()))
    dataset.to_netcdf(tmp_path / "set.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "set.nc", engine="scipy") as opened:
        same(space, rebuilt(opened.load()))


def test_xarray_opens_the_folder(tmp_path: Path, space: cspace.CSpace) -> None:
    space.save(tmp_path / "map.zarr")
    with xarray.open_zarr(tmp_path / "map.zarr", consolidated=False) as opened:
        assert opened.equals(space.to_xarray())


def test_numpy_reads_an_npz_without_this_library(tmp_path: Path, space: cspace.CSpace) -> None:
    space.export(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz", allow_pickle=False) as held:
        np.testing.assert_array_equal(held["state"], space.state)
        np.testing.assert_array_equal(held["z"], space.grid.centers(2))
        entries = json.loads(held["shapes"].tobytes())
        assert [entry["kind"] for entry in entries] == ["balls", "mesh", "balls", "mesh"]
        np.testing.assert_array_equal(held["vertices"][8:], held["vertices"][:8])
        np.testing.assert_array_equal(held["faces"][12:], held["faces"][:12])


def test_what_a_map_in_space_cannot_be_is_refused(tmp_path: Path, space: cspace.CSpace) -> None:
    for suffix in (".yaml", ".yml"):
        with pytest.raises(InputError, match=r"a ROS map; .*20 x 18 x 16 cells in space.*\.vti, \.ply, \.obj, \.stl"):
            export(space, tmp_path / f"map{suffix}")
    for suffix in SUFFIXES:
        with pytest.raises(InputError, match=r"yaw is 0.5 for .*; leave it out"):
            export(space, tmp_path / f"map{suffix}", yaw=0.5)
    with pytest.raises(InputError, match=r"map.png ends in '.png'; .*use one of .zarr, .npz, .vti, .yaml, .yml, .ply"):
        export(space, tmp_path / "map.png")
    with pytest.raises(InputError, match=r"map.vti ends in '.vti'; .*use one of .zarr, .npz$"):
        save(space, tmp_path / "map.vti")
    assert not list(tmp_path.iterdir())


# What may go wrong with the shapes of a saved map: exact look-ups would then answer for other obstacles.


@pytest.mark.parametrize("name", ["shapes", *TABLES])
def test_every_array_of_the_shapes_is_needed_whole_and_unchanged(
    tmp_path: Path, space: cspace.CSpace, name: str
) -> None:
    path = tmp_path / "map"
    save(space, path)
    for file in files(path / name):
        content = file.read_bytes()
        for keep in (0.0, 0.5, 0.95):
            file.write_bytes(content[: int(len(content) * keep)])
            refused(path)
        file.unlink()
        refused(path)
        file.write_bytes(content)
    stored = zarr.open_array(path / name)
    earlier = np.asarray(stored[...])
    changed = earlier.copy()
    changed.flat[-1] += 1
    stored[...] = changed
    refused(path, f"its array {name!r} differs from its digest")
    stored[...] = earlier
    same(space, open_map(path))
    shutil.rmtree(path / name)
    refused(path, f"its array {name!r} is missing")


@pytest.mark.parametrize("name", ["shapes", *TABLES])
def test_every_member_of_an_npz_is_needed_unchanged(tmp_path: Path, space: cspace.CSpace, name: str) -> None:
    path = tmp_path / "map.npz"
    save(space, path)
    with np.load(path) as held:
        members = {member: held[member] for member in held.files}
    members[name].flat[0] += 1
    np.savez(path, **members)
    refused(path, f"its array {name!r} differs from its digest")
    del members[name]
    np.savez(path, **members)
    refused(path, f"its array {name!r} is missing")


def entry(**changes: Any) -> np.ndarray:
    """The table of one mesh and one ball, with changes of the first."""
    mesh = {"kind": "mesh", "solid": "auto", "source": "", "vertices": 8, "faces": 12}
    content = json.dumps([mesh | changes, {"kind": "balls", "centers": 1, "radii": 1}]).encode()
    return np.frombuffer(content, dtype=np.int8)


def negative() -> np.ndarray:
    """The same, with rows of the balls that add up to one."""
    ball = {"kind": "balls", "centers": -2, "radii": 1}
    return np.frombuffer(
        json.dumps([*json.loads(entry().tobytes())[:1], ball, ball | {"centers": 3}]).encode(), np.int8
    )


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"vertices": None}, "'shapes' tells of no obstacles (KeyError: 'vertices')"),
        ({"radii": None}, "'shapes' tells of no obstacles (KeyError: 'radii')"),
        ({"shapes": np.zeros(3, np.int8)}, "'shapes' tells of no obstacles"),
        ({"shapes": np.full(3, -1, np.int8)}, "'shapes' tells of no obstacles"),
        ({"shapes": np.frombuffer(b"7", np.int8)}, "'shapes' tells of no obstacles"),
        ({"shapes": np.frombuffer(b"[7]", np.int8)}, "'shapes' tells of no obstacles"),
        ({"shapes": np.frombuffer(b"[{}]", np.int8)}, "'shapes' tells of no obstacles"),
        ({"shapes": np.frombuffer(b"[]", np.int8)}, "'vertices' has 8 rows and 'shapes' tells of 0"),
        ({"shapes": entry(kind="cone")}, "'shapes' tells of no obstacles (KeyError: 'cone')"),
        ({"shapes": entry(vertices=9)}, "'vertices' has 8 rows and 'shapes' tells of 9"),
        ({"shapes": entry(faces=11)}, "'faces' has 12 rows and 'shapes' tells of 11"),
        ({"shapes": entry(faces=0)}, "'faces' has 12 rows and 'shapes' tells of 0"),
        ({"shapes": entry(vertices=-8)}, "'shapes' tells of -8 rows in 'vertices'"),
        ({"shapes": negative()}, "'shapes' tells of -2 rows in 'centers'"),
        ({"shapes": entry(vertices="8")}, "'shapes' tells of no obstacles"),
        ({"shapes": entry(vertices=8.0)}, "'shapes' tells of no obstacles"),
        ({"shapes": entry(solid="maybe")}, "its parts make no map: solid is 'maybe'"),
        ({"faces": np.full((12, 3), 8)}, "name vertex 8"),
        ({"faces": np.full((12, 3), -1)}, "name vertex -1"),
        ({"vertices": np.full((8, 3), np.nan)}, "its parts make no map: vertices"),
        ({"centers": np.full((1, 3), np.inf)}, "'centers' and 'radii' make no balls"),
        ({"radii": np.array([-1.0])}, "'centers' and 'radii' make no balls"),
        ({"radii": np.array([np.nan])}, "'centers' and 'radii' make no balls"),
        ({"radii": np.array([1.0, 2.0])}, "'radii' has 2 rows and 'shapes' tells of 1"),
        ({"vertices": np.zeros((8, 2))}, "its array 'vertices' is float64 (8, 2) where float64 (8, 3) is needed"),
        ({"faces": np.zeros((12, 3), np.int32)}, "its array 'faces' is int32 (12, 3) where int64 (12, 3) is needed"),
    ],
)
def test_shapes_that_do_not_agree_are_refused(
    tmp_path: Path, suffix: str, content: dict[str, np.ndarray], words: str
) -> None:
    forged(tmp_path / f"map{suffix}", a_box_and_a_ball(), {}, content)
    refused(tmp_path / f"map{suffix}", words)


def test_tables_with_other_axes_are_refused(tmp_path: Path) -> None:
    for name, table in [
        ("vertices", np.zeros(8)),
        ("faces", np.zeros((12, 3, 1), np.int64)),
        ("radii", np.ones((1, 1))),
    ]:
        forged(tmp_path / f"{name}.npz", a_box_and_a_ball(), {}, {name: table})
        refused(tmp_path / f"{name}.npz", f"its array {name!r} is {table.dtype} {table.shape} where")


def a_box_and_a_ball() -> cspace.CSpace:
    cells = np.zeros((5, 5, 5), dtype=bool)
    workspace = cspace.Workspace(
        cspace.Grid((0.0, 0.0, 0.0), 0.1, cells.shape),
        cells,
        cells,
        shapes=(Mesh.of(trimesh.creation.box((0.1, 0.1, 0.1))), balls([(0.2, 0.2, 0.2)], [0.1])),
    )
    return cspace.build(workspace, ROBOTS["ball"])
