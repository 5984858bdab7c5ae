"""Saved maps open equal to the original, or not at all."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import xarray
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from zarr.codecs import ZstdCodec

import cspace
from cspace.errors import FileError, InputError
from cspace.files import zarr_folders
from cspace.limits import raised_limits
from tests.helpers.maps import MAP_BUILDERS, MAP_SUFFIXES, files, refused, same
from tests.helpers.strategies import bitmaps, robots, rotation_cells
from tests.soak.files import reseal


@pytest.fixture(scope="module", params=MAP_BUILDERS)
def space(request: pytest.FixtureRequest) -> cspace.CSpace:
    return MAP_BUILDERS[request.param]()


@pytest.fixture(scope="module")
def few() -> cspace.CSpace:
    """Build a small map, nearly all FREE."""
    workspace = cspace.Workspace.from_polygons(
        "POLYGON ((0 0, 0.05 0, 0 0.05, 0 0))", 0.1, (0, 0, 0.4, 0.3)
    )
    return cspace.build(workspace, cspace.Robot.rectangle(0.2, 0.1), rotations=4, outside="free")


@pytest.fixture(scope="module")
def small(few: cspace.CSpace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Save that map with each suffix."""
    folder = tmp_path_factory.mktemp("small")
    for suffix in MAP_SUFFIXES:
        few.save(folder / f"map{suffix}")
    return folder


def build_pair() -> cspace.CSpace:
    """Build a map of two cells."""
    return cspace.build(cspace.Workspace.from_array([[0, 1]], 0.1), cspace.Robot.disc(0.05))


@st.composite
def draw_maps(draw: st.DrawFn) -> cspace.CSpace:
    """Draw maps of random cells and robots."""
    outer = draw(bitmaps())
    inner = outer & draw(st.sampled_from([True, False]))
    lower = draw(st.tuples(*[st.floats(-100.0, 100.0)] * 2))
    workspace = cspace.Workspace.from_array(outer, draw(st.floats(0.05, 3.0)), lower, inner=inner)
    return cspace.build(
        workspace,
        draw(robots(1.5)),
        rotations=draw(st.none() | rotation_cells(5)),
        outside=draw(st.sampled_from(["blocked", "free"])),
        margin=draw(st.sampled_from([0.0, 0.1])),
        counts=draw(st.booleans()),
    )


# ---- what is saved is what opens -----------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
@given(space=draw_maps(), suffix=st.sampled_from(MAP_SUFFIXES), compress=st.booleans())
@settings(max_examples=15)
def test_a_saved_map_opens_equal(space: cspace.CSpace, suffix: str, compress: bool) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"map{suffix}"
        space.save(path, compress=compress)
        same(space, cspace.open(path))


def test_maps_of_every_kind_open_equal_and_rebuild_equal(
    tmp_path: Path, space: cspace.CSpace, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "map.ZARR"
    space.save(path)
    assert list(tmp_path.iterdir()) == [path]
    with monkeypatch.context() as patch:
        patch.setattr("cspace.space.slice_rasters", None)  # which look-ups of a saved map need not
        opened = cspace.open(str(path))
        same(space, opened)
        np.testing.assert_array_equal(opened._exterior.table, space._exterior.table)
    again = cspace.build(
        opened.workspace,
        opened.robot,
        rotations=opened.rotations,
        margin=opened.margin,
        outside=opened.outside,
    )
    np.testing.assert_array_equal(again.cell_states, space.cell_states)
    q = np.random.default_rng(1).uniform(space.grid.lower, space.grid.upper, (50, space.grid.dim))
    turns = {0: np.zeros((50, 0)), 1: np.linspace(-9, 9, 50)[:, None]}.get(
        len(space.rotations.names), space.rotations.centers
    )
    q = np.hstack([q, np.resize(turns, (50, turns.shape[1]))])
    np.testing.assert_array_equal(opened.is_free(q, exact=True), space.is_free(q, exact=True))


@pytest.mark.parametrize("suffix", MAP_SUFFIXES)
def test_unknown_cells_are_saved(tmp_path: Path, suffix: str) -> None:
    cells = np.eye(9, dtype=bool)
    workspace = cspace.Workspace(
        cspace.Grid((0.0, 0.0), 0.1, (9, 9)), cells, cells, unknown=cells[::-1]
    )
    cspace.build(workspace, cspace.Robot.disc(0.1)).save(tmp_path / f"map{suffix}")
    again = cspace.open(tmp_path / f"map{suffix}").workspace.unknown
    assert again is not None
    np.testing.assert_array_equal(again, cells[::-1])


@pytest.mark.parametrize("inner", [True, False])
def test_updates_of_an_opened_map_agree_with_a_build(tmp_path: Path, inner: bool) -> None:
    """Include a map without BLOCKED cells, which does not reveal whether it was built with `inner`."""
    robot, cells = cspace.Robot.rectangle(0.5, 0.3), np.eye(12, 9, dtype=bool)
    cells[4:9] = True
    empty = cspace.Workspace.from_array(np.zeros_like(cells), 0.1)
    cspace.build(empty, robot, inner=inner, outside="free").save(tmp_path / "map")
    opened = cspace.open(tmp_path / "map")
    opened.update(cells, (0, 0))
    again = cspace.build(
        cspace.Workspace.from_array(cells, 0.1), robot, inner=inner, outside="free"
    )
    assert opened.count() == again.count() and (again.count()[2] > 0) == inner
    np.testing.assert_array_equal(opened.cell_states, again.cell_states)


def test_only_existing_arrays_are_stored(tmp_path: Path) -> None:
    space = MAP_BUILDERS["grid"]()
    for suffix in MAP_SUFFIXES:
        space.save(tmp_path / f"map{suffix}")
        path = tmp_path / f"map{suffix}"
        held = [entry.name for entry in path.iterdir()]
        assert {"cell_states", "outer", "x"} <= set(held)
        assert not set(held) & {"inner", "unknown", "overlap_counts", "shapes", "z", "yaw"}


@pytest.mark.parametrize("most", [1, 50, 1000])
def test_arrays_of_several_chunks_open_equal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, space: cspace.CSpace, most: int
) -> None:
    monkeypatch.setattr(zarr_folders, "WRITTEN_CHUNK_BYTES", most)
    space.save(tmp_path / "map")
    same(space, cspace.open(tmp_path / "map"))
    chunks = list(files(tmp_path / "map" / "cell_states" / "c"))
    assert len(chunks) > 1 or most > 50
    assert (
        max(array.chunks[-1] for _, array in zarr.open_group(tmp_path / "map", mode="r").arrays())
        > 0
    )


# ---- what may go wrong: a lost chunk that reads as FREE is a collision ---------------------------


def change_bytes(file: Path, masks: list[int]) -> Iterator[None]:
    """Change one byte after another temporarily; in place, because rewriting files is slow."""
    with file.open("r+b", buffering=0) as opened:
        for at, (byte, mask) in enumerate(zip(file.read_bytes(), masks, strict=True)):
            for value in (byte ^ mask, byte):
                opened.seek(at)
                opened.write(bytes([value]))
                if value != byte:
                    yield


def test_any_changed_missing_or_extra_byte_is_refused(tmp_path: Path) -> None:
    path, space = tmp_path / "map", build_pair()
    space.save(path)
    for file in files(path):
        content = file.read_bytes()
        step = (
            7 if file.suffix == ".json" else 1
        )  # a digest covers the whole file, and metadata are long
        for _ in change_bytes(
            file, [1 << (at % 8) if at % step == 0 else 0 for at in range(len(content))]
        ):
            refused(path)
        for other in (content[: len(content) // 2], content[:-1], content + b"\n", b""):
            file.write_bytes(other)
            refused(path)
        file.unlink()
        refused(path)
        file.write_bytes(content)
    same(space, cspace.open(path))


def test_lost_and_swapped_chunks_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "map"
    monkeypatch.setattr(zarr_folders, "WRITTEN_CHUNK_BYTES", 12 * 9)  # a chunk for each slice
    MAP_BUILDERS["turning"]().save(path)
    one, two = (path / "cell_states" / "c" / number / "0" / "0" for number in "01")
    contents = one.read_bytes(), two.read_bytes()
    one.write_bytes(contents[1])
    two.write_bytes(contents[0])
    refused(path, "differ from their digest")
    two.unlink()
    refused(path, "is missing")
    # Neither for other software, which reads the fill value.
    assert (np.asarray(zarr.open_array(path / "cell_states", mode="r")[1]) == 255).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "cspace-ap"}, "do not say format"),
        ({"format_version": 5, "library_version": "0.1.0"}, "build it again"),
        ({"format_version": "6"}, "reads only version 6"),
        ({"format_version": 6.0}, "reads only version 6"),
        ({"digest": "0"}, "its digest is none"),
        ({"digest": 7}, "usable map"),
        ({"margin_m": 0.5}, "differ from their digest"),
        ({"shape": [4]}, "usable map"),
        ({"rotations": 0}, "usable map"),
    ],
    ids=str,
)
def test_changed_attributes_are_refused(
    tmp_path: Path, small: Path, change: dict[str, Any], message: str
) -> None:
    path = tmp_path / "map.zarr"
    shutil.copytree(small / "map.zarr", path)
    document = json.loads((path / "zarr.json").read_text())
    document["attributes"] |= change
    (path / "zarr.json").write_text(json.dumps(document, indent=2))
    refused(path, message)


FORGED: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({}, {"cell_states": np.full((2, 4, 3), 3, np.uint8)}, "holds the state 3"),
    ({}, {"cell_states": np.zeros((1, 4, 3), np.uint8)}, "'cell_states' is uint8 (1, 4, 3), not"),
    ({}, {"cell_states": np.zeros((2, 4, 3), np.int8)}, "'cell_states' is int8"),
    ({}, {"cell_states": None}, "is missing"),
    ({}, {"x": np.zeros(4)}, "'x' does not match"),
    ({}, {"slice_of": np.arange(4)}, "'slice_of' does not match"),
    ({}, {"slice_of": np.full(4, 9)}, "'slice_of' does not match"),
    ({}, {"yaw": np.zeros(4)}, "'yaw' does not match"),
    ({}, {"covering_angle": np.zeros(4)}, "'covering_angle' does not match"),
    ({}, {"yaw_bounds": np.zeros((4, 2))}, "its parts make no map"),
    ({}, {"yaw_bounds": np.full((4, 2), np.nan)}, "its parts make no map"),
    ({}, {"exterior": np.tile([0, 0, 3, 2, 2], (2, 1))}, "its exterior has other states"),
    (
        {},
        {"exterior": np.tile([0, 0, 2**62, 2, 0], (2, 1))},
        "its exterior reaches beyond all grids",
    ),
    (
        {},
        {"exterior": np.tile([-(2**63), 0, 3, 2, 0], (2, 1))},
        "its exterior reaches beyond all grids",
    ),
    ({}, {"inner": np.ones((4, 3), bool)}, "not in outer"),
    *[
        (
            {"shapes_bytes": len(text)},
            {"shapes": np.frombuffer(text, np.int8)},
            "'shapes' tells of no obstacles",
        )
        for text in (
            b"\0\0",
            b"\xff\xff",
            b"7",
            b"[7]",
            b"[{}]",
            b'[{"kind": "cone"}]',
            b"[" * 99999,
        )
    ],
    *[
        ({"shapes_bytes": len(text)}, {"shapes": np.frombuffer(text, np.int8)}, "")
        for text in (
            b'[{"kind": "polygon", "wkb": ["AAAA"]}]',
            b'[{"kind": "balls", "centers": [[0, 0]], "radii": [-1]}]',
            b'[{"kind": "balls", "centers": [[0, NaN]], "radii": [1]}]',
            b'[{"kind": "balls", "centers": [[0, 0, 0]], "radii": [1]}]',
            b'[{"kind": "mesh", "vertices": "", "faces": "AAAA", "solid": "auto", "source": ""}]',
        )
    ],
    ({"arrays": "cell_states slice_of x y yaw yaw_bounds covering_angle"}, {}, "lacks ['outer']"),
    ({"arrays": "cell_states outer slice_of x y yaw covering_angle"}, {}, "lacks ['yaw_bounds']"),
    ({"arrays": "cell_states outer slice_of x y"}, {}, "usable map"),
    ({"arrays": "cell_states outer slice_of x y ../outside"}, {}, "has ['../outside']"),
    ({"robot": "{}"}, {}, "its parts make no map"),
    ({"robot": "["}, {}, "its parts make no map"),
    (
        {"robot": '{"kind": "balls", "centers": [[0, 0, 0]], "radii": [1]}'},
        {},
        "its parts make no map",
    ),
    ({"spacing": -1.0}, {}, "its parts make no map"),
    ({"spacing": "wide"}, {}, "its parts make no map"),
    ({"margin_m": -1.0}, {}, "margin_m"),
    ({"margin_m": float("nan")}, {}, "margin_m"),
    ({"outside": "wet"}, {}, "its parts make no map"),
    ({"outside": "blocked"}, {}, "its exterior has other states"),
    ({"units": "m ft"}, {}, "its units are"),
    ({"shape": [4]}, {}, "its parts make no map"),
    ({"shape": ["ab", 3]}, {}, "its parts make no map"),
    ({"slices": 10**12}, {}, "unpacks to"),
    ({"slices": 0}, {}, "would have the shape"),
    ({"rotations": 3}, {}, "not int64 (3,)"),
    ({"compressed": False}, {}, "or has other chunks"),
    ({"shapes_bytes": None}, {}, "its parts make no map"),
    ({"inner": 2}, {}, "its attribute 'inner' is 2, not 0"),
    ({"inner": None}, {}, "its attribute 'inner' is None"),
    ({"workspace_source": ["a"]}, {}, "its attribute 'workspace_source' is ['a']"),
    ({"axes": "x y"}, {}, "its attribute 'axes' is 'x y'"),
]


@pytest.mark.parametrize(("metadata", "content", "message"), FORGED, ids=range(len(FORGED)))
def test_files_that_make_no_map_are_refused_despite_a_valid_digest(
    tmp_path: Path, small: Path, metadata: dict[str, Any], content: dict[str, Any], message: str
) -> None:
    path = tmp_path / "map.zarr"
    shutil.copytree(small / "map.zarr", path)
    for name, array in content.items():
        shutil.rmtree(path / name, ignore_errors=True)
        if array is not None:
            options: dict[str, Any] = {
                "name": name,
                "chunks": array.shape,
                "config": {"write_empty_chunks": True},
            }
            zarr.create_array(str(path), data=array, compressors=ZstdCodec(level=1), **options)
    reseal(path, **metadata)
    refused(path, message)


def test_a_map_that_unpacks_beyond_the_limit_is_refused(small: Path) -> None:
    with raised_limits(max_bytes=20):
        refused(small / "map.zarr", "at most 20 bytes are read")


def test_other_files_and_folders_are_refused(tmp_path: Path) -> None:
    for folder in ("empty", "strange"):
        (tmp_path / folder).mkdir()
    (tmp_path / "strange" / "zarr.json").write_text("[]")
    refused(tmp_path / "empty", "does not exist")
    refused(tmp_path / "strange", "usable map")
    refused(tmp_path / "absent", "does not exist")
    for name in ("map.txt", "map.npz"):
        (tmp_path / name).write_text("hello")
        refused(
            tmp_path / name,
            "is not a saved map",
            "numpy.load" if name == "map.npz" else "cspace.build",
        )
    for wrong in (7, None):
        with pytest.raises(InputError, match="file name"):
            cspace.open(wrong)


# ---- writing: complete, or not there -------------------------------------------------------------


@pytest.mark.parametrize("stop", [KeyboardInterrupt, MemoryError])
@pytest.mark.parametrize("old", [False, True])
def test_an_interrupted_save_leaves_no_half_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop: type[BaseException], old: bool
) -> None:
    path, space, earlier = tmp_path / "map", build_pair(), MAP_BUILDERS["grid"]()
    space.save(path)
    number = len(list(files(path)))
    shutil.rmtree(path)
    if old:
        earlier.save(path)
    write = Path.write_bytes
    for limit in range(number):
        written = 0

        def stub(file: Path, content: bytes, limit: int = limit) -> int:
            nonlocal written
            written += 1
            if written <= limit:
                return write(file, content)
            write(file, content[: len(content) // 2])
            raise stop

        with monkeypatch.context() as patch, pytest.raises(stop):
            patch.setattr(Path, "write_bytes", stub)
            space.save(path, overwrite=True)
        assert list(tmp_path.iterdir()) == ([path] if old else [])
    if old:
        same(earlier, cspace.open(path))
    space.save(path, overwrite=True)
    same(space, cspace.open(path))


def test_an_interrupted_archive_leaves_no_half_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: Path
) -> None:
    def stub(file: Any, **_: object) -> None:
        file.write(b"PK half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", stub)
    with pytest.raises(KeyboardInterrupt):
        cspace.open(small / "map.zarr").export(tmp_path / "map.npz")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", MAP_SUFFIXES)
def test_a_saved_map_is_kept_without_overwrite(tmp_path: Path, small: Path, suffix: str) -> None:
    path, space = tmp_path / f"map{suffix}", cspace.open(small / "map.zarr")
    MAP_BUILDERS["grid"]().save(path)
    with pytest.raises(FileError, match="overwrite=True"):
        space.save(path)
    same(MAP_BUILDERS["grid"](), cspace.open(path))
    space.save(path, overwrite=True)
    same(space, cspace.open(path))


def test_overwriting_removes_nothing_but_a_map(tmp_path: Path, small: Path) -> None:
    path, space = tmp_path / "map", cspace.open(small / "map.zarr")
    space.save(path)
    (path / "cell_states" / "zarr.json").unlink()  # a damaged map is one too
    space.save(path, overwrite=True)
    (path / "notes.txt").write_text("years of work")
    with pytest.raises(FileError, match="holds more than an earlier output"):
        space.save(path, overwrite=True)
    assert (path / "notes.txt").read_text() == "years of work"
    for name in ("map.tiff", "map.npz"):
        with pytest.raises(InputError, match=r"a Zarr folder.*space\.export"):
            space.save(tmp_path / name)


# ---- what other software finds -------------------------------------------------------------------


def test_a_dataset_is_labelled_and_read_only(space: cspace.CSpace) -> None:
    dataset, dim = space.to_xarray(), space.grid.dim
    turns = {} if not space.rotations.names else {"rotation": len(space.rotations)}
    assert dict(dataset.cell_states.sizes) == turns | dict(
        zip("xyz", space.grid.shape, strict=False)
    )
    for axis, name in enumerate("xyz"[:dim]):
        np.testing.assert_array_equal(dataset[name], space.grid.centers(axis))
        assert dataset[name].attrs["units"] == "m"
    assert all(dataset[name].attrs["long_name"] for name in dataset.variables)
    flags = dataset.cell_states.attrs
    assert dict(zip(flags["flag_meanings"].split(), flags["flag_values"], strict=True)) == {
        "free": cspace.FREE,
        "mixed": cspace.MIXED,
        "blocked": cspace.BLOCKED,
    }
    positions = np.stack(
        np.meshgrid(*(dataset[name] for name in "xyz"[:dim]), indexing="ij"), axis=-1
    )
    rotations = {0: np.zeros((1, 0)), 1: dataset.get("yaw"), 4: dataset.get("quaternion")}[
        len(space.rotations.names)
    ]
    every = dataset.cell_states.values.reshape(-1, *space.grid.shape)
    for rotation, states in zip(
        np.reshape(np.asarray(rotations), (len(every), -1)), every, strict=True
    ):
        q = np.concatenate(
            [positions, np.broadcast_to(rotation, (*positions.shape[:-1], len(rotation)))], axis=-1
        )
        np.testing.assert_array_equal(states, space.classify(q))
    with pytest.raises(ValueError):
        dataset.cell_states.values[...] = 0
    dataset.copy(deep=True).cell_states[...] = 0


def test_a_dataset_survives_zarr_and_netcdf(tmp_path: Path, space: cspace.CSpace) -> None:
    dataset = space.to_xarray()
    dataset.to_zarr(tmp_path / "set.zarr", zarr_format=3, consolidated=False)
    with xarray.open_zarr(tmp_path / "set.zarr", consolidated=False, chunks=None) as opened:
        assert opened.identical(dataset)
    dataset.to_netcdf(tmp_path / "set.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "set.nc", engine="scipy") as opened:
        for name in dataset.variables:
            np.testing.assert_array_equal(opened[name], dataset[name])


def test_xarray_opens_the_folder(tmp_path: Path, space: cspace.CSpace) -> None:
    space.save(tmp_path / "map.zarr")
    expected = space.to_xarray()
    with xarray.open_zarr(tmp_path / "map.zarr", consolidated=False, chunks=None) as opened:
        states = (
            opened.cell_states.isel(slice=opened.slice_of)
            if space.rotations.names
            else opened.cell_states.isel(slice=0)
        )
        np.testing.assert_array_equal(states, expected.cell_states)
        assert {key: opened.attrs[key] for key in expected.attrs} == expected.attrs
        assert opened.cell_states.attrs == expected.cell_states.attrs


def test_numpy_reads_an_npz_without_this_library(tmp_path: Path, space: cspace.CSpace) -> None:
    space.export(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz", allow_pickle=False) as held:
        states = held["cell_states"][held["slice_of"]]
        np.testing.assert_array_equal(
            states if space.rotations.names else states[0], space.cell_states
        )
        assert (tuple(held["lower"]), held["spacing"]) == (space.grid.lower, space.grid.spacing)
        assert json.loads(str(held["metadata"])) == space.to_xarray().attrs
        np.testing.assert_array_equal(held["outer"], space.workspace.outer)
