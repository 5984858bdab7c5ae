"""Saved maps open equal to the original, or not at all."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray
import zarr
from zarr.codecs import ZstdCodec

import cspace
from cspace._files import zarr_folders
from cspace.errors import FileError, InputError
from tests.fuzz.files import reseal
from tests.helpers.maps import MAP_BUILDERS, MAP_SUFFIXES, files, refused, same
from tests.helpers.placements import draw_configurations
from tests.helpers.refusals import refusals


@pytest.fixture(scope="module", params=["plane", "turning", "symmetric", "solid_free"])
def space(request):
    return MAP_BUILDERS[request.param]()


@pytest.fixture(scope="module")
def few():
    """Build a small map, nearly all FREE."""
    workspace = cspace.Workspace.from_polygons(
        "POLYGON ((0 0, 0.05 0, 0 0.05, 0 0))", 0.1, (0, 0, 0.4, 0.3)
    )
    return cspace.build(workspace, cspace.Robot.rectangle(0.2, 0.1), rotations=4, outside="free")


@pytest.fixture(scope="module")
def small(few, tmp_path_factory):
    """Save that map with each suffix."""
    folder = tmp_path_factory.mktemp("small")
    for suffix in MAP_SUFFIXES:
        few.save(folder / f"map{suffix}")
    return folder


def build_pair():
    """Build a map of two cells."""
    return cspace.build(cspace.Workspace.from_array([[0, 1]], 0.1), cspace.Robot.disc(0.05))


# ---- what is saved is what opens -----------------------------------------------------------------


def test_maps_of_every_kind_open_equal(tmp_path, space, monkeypatch):
    path = tmp_path / "map.ZARR"
    space.save(path)
    assert list(tmp_path.iterdir()) == [path]
    with monkeypatch.context() as patch:
        patch.setattr("cspace._space.rasters_of", None)  # which look-ups of a saved map need not
        opened = cspace.open(str(path))
        same(space, opened)
        np.testing.assert_array_equal(opened._exterior.table, space._exterior.table)
    q = draw_configurations(space, np.random.default_rng(1), 50)
    np.testing.assert_array_equal(opened.exact.is_free(q), space.exact.is_free(q))


@pytest.mark.parametrize("inner", [True, False])
def test_updates_of_an_opened_map_agree_with_a_build(tmp_path, inner):
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


def test_arrays_of_several_chunks_open_equal(tmp_path, monkeypatch, space):
    monkeypatch.setattr(zarr_folders, "WRITTEN_CHUNK_BYTES", 50)
    space.save(tmp_path / "map")
    same(space, cspace.open(tmp_path / "map"))
    assert len(list(files(tmp_path / "map" / "cell_states"))) > 2


# ---- what may go wrong: a lost chunk that reads as FREE is a collision ---------------------------


def change_bytes(file, masks):
    """Change one byte after another temporarily; in place, because rewriting files is slow."""
    with file.open("r+b", buffering=0) as opened:
        for at, (byte, mask) in enumerate(zip(file.read_bytes(), masks, strict=True)):
            for value in (byte ^ mask, byte):
                opened.seek(at)
                opened.write(bytes([value]))
                if value != byte:
                    yield


@pytest.mark.parametrize("every", [9, pytest.param(1, marks=pytest.mark.thorough)])
def test_any_changed_missing_or_extra_byte_is_refused(tmp_path, every):
    path, space = tmp_path / "map", build_pair()
    space.save(path)
    for file in files(path):
        content = file.read_bytes()
        # A digest covers the whole file, and metadata are long.
        step = every * (7 if file.suffix == ".json" else 1)
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


def test_lost_and_swapped_chunks_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "map"
    monkeypatch.setattr(zarr_folders, "WRITTEN_CHUNK_BYTES", 12 * 9)  # a chunk for each slice
    MAP_BUILDERS["turning"]().save(path)
    one, two = (path / "cell_states" / f"c.{number}.0.0" for number in "01")
    contents = one.read_bytes(), two.read_bytes()
    one.write_bytes(contents[1])
    two.write_bytes(contents[0])
    refused(path, "differ from their digest")
    two.unlink()
    refused(path, "is missing")
    # Neither for other software, which reads the fill value.
    assert (np.asarray(zarr.open_array(path / "cell_states", mode="r")[1]) == 255).all()


def shapes_of(text):
    """Return attributes and arrays of a text of obstacles."""
    return {"shapes_bytes": len(text)}, {"shapes": np.frombuffer(text, np.int8)}


@refusals(
    "metadata, content, message",
    ({}, {"cell_states": np.full((2, 4, 3), 3, np.uint8)}, "holds the state 3"),
    ({}, {"cell_states": np.zeros((1, 4, 3), np.uint8)}, "'cell_states' is uint8 (1, 4, 3), not"),
    ({}, {"cell_states": None}, "is missing"),
    ({}, {"x": np.zeros(4)}, "'x' does not match"),
    ({}, {"slice_of": np.arange(4)}, "'slice_of' does not match"),
    ({}, {"covering_angle": np.zeros(4)}, "'covering_angle' does not match"),
    ({}, {"exterior": np.tile([0, 0, 3, 2, 2], (2, 1))}, "its exterior has other states"),
    ({}, {"exterior": np.tile([0, 0, 2**62, 2, 0], (2, 1))}, "exterior reaches beyond all grids"),
    ({}, {"inner": np.ones((4, 3), bool)}, "not in outer"),
    (*shapes_of(b"[" * 99999), "'shapes' tells of no obstacles"),
    (
        *shapes_of(b'[{"kind": "balls", "centers": [[0, NaN]], "radii": [1]}]'),
        "its parts make no map ",
    ),
    (*shapes_of(b'[{"kind": "balls", "centers": [[0, 0, 0]], "radii": [1]}]'), "differ in dim"),
    ({"arrays": "cell_states slice_of x y yaw yaw_bounds covering_angle"}, {}, "lacks ['outer']"),
    ({"arrays": "cell_states outer slice_of x y ../outside"}, {}, "has ['../outside']"),
    ({"robot": "["}, {}, "its parts make no map"),
    ({"spacing": -1.0}, {}, "spacing is -1.0"),
    ({"margin_m": float("nan")}, {}, "margin_m is nan"),
    ({"outside": "blocked"}, {}, "other states than space that is blocked"),
    ({"units": "m ft"}, {}, "its units are"),
    ({"slices": 10**12}, {}, "unpacks to"),
    ({"slices": 0}, {}, "would have the shape"),
    ({"rotations": 3}, {}, "not int64 (3,)"),
    ({"compressed": False}, {}, "or has other chunks"),
    ({"inner": 2}, {}, "its attribute 'inner' is 2, not 0"),
    ({"format": "cspace-ap"}, {}, "do not say format"),
    ({"format_version": 6}, {}, "reads only version"),
)
def test_files_that_make_no_map_are_refused_despite_a_valid_digest(
    tmp_path, small, metadata, content, message
):
    path = tmp_path / "map.zarr"
    shutil.copytree(small / "map.zarr", path)
    for name, array in content.items():
        shutil.rmtree(path / name, ignore_errors=True)
        if array is not None:
            options = {
                "name": name,
                "chunks": array.shape,
                "chunk_key_encoding": {"name": "default", "separator": "."},
                "config": {"write_empty_chunks": True},
            }
            zarr.create_array(str(path), data=array, compressors=ZstdCodec(level=1), **options)
    reseal(path, **metadata)
    refused(path, message.strip())


def test_other_files_and_folders_are_refused(tmp_path):
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
            "numpy.load" if name == "map.npz" else "a Zarr folder",
        )
    for wrong in (7, None):
        with pytest.raises(InputError, match="file name"):
            cspace.open(wrong)
    for name in ("map.tiff", "map.npz"):
        with pytest.raises(InputError, match=r"a Zarr folder.*space\.export"):
            build_pair().save(tmp_path / name)


# ---- writing: complete, or not there -------------------------------------------------------------


@pytest.mark.parametrize("old", [False, True])
def test_an_interrupted_save_leaves_no_half_map(tmp_path, monkeypatch, old):
    path, space, earlier = tmp_path / "map", build_pair(), MAP_BUILDERS["grid"]()
    space.save(path)
    number = len(list(files(path)))
    shutil.rmtree(path)
    if old:
        earlier.save(path)
    write = Path.write_bytes
    for limit in range(number):
        written = 0

        def stub(file, content, limit=limit):
            nonlocal written
            written += 1
            if written <= limit:
                return write(file, content)
            write(file, content[: len(content) // 2])
            raise KeyboardInterrupt

        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(Path, "write_bytes", stub)
            space.save(path, overwrite=True)
        assert list(tmp_path.iterdir()) == ([path] if old else [])
    if old:
        same(earlier, cspace.open(path))
    space.save(path, overwrite=True)
    same(space, cspace.open(path))


@pytest.mark.parametrize(
    "names",
    [
        ["frame0001.png", "frame0002.png"],
        ["x", "y", "geometry"],
        ["1.0/report", "1.1/report"],
        ["zarr.json", "x/zarr.json", "x/c.0"],
        [".cspace-notes"],
    ],
    ids=["film", "tables", "versions", "Zarr", "hidden"],
)
def test_folders_with_names_as_of_maps_are_no_maps(tmp_path, small, names):
    for name in names:
        (tmp_path / "map" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "map" / name).write_text("{}")
    with pytest.raises(FileError, match="holds more than an earlier output"):
        cspace.open(small / "map.zarr").save(tmp_path / "map", overwrite=True)
    assert all((tmp_path / "map" / name).read_text() == "{}" for name in names)


@pytest.mark.parametrize(
    "name", ["notes", "cell_states/notes", "cell_states/c.notes", ".cspace-notes", "frame1.png"]
)
def test_a_map_with_other_files_in_it_is_kept(tmp_path, small, name):
    space = cspace.open(small / "map.zarr")
    space.save(tmp_path / "map")
    (tmp_path / "map" / "cell_states" / "zarr.json").unlink()  # a damaged map is one too
    space.save(tmp_path / "map", overwrite=True)
    for write in (Path.touch, lambda path: path.unlink() or path.mkdir()):
        write(tmp_path / "map" / name)
        with pytest.raises(FileError, match="holds more than an earlier output"):
            space.save(tmp_path / "map", overwrite=True)
        assert (tmp_path / "map" / name).exists()


# ---- what other software finds -------------------------------------------------------------------


def test_xarray_opens_the_folder(tmp_path, space):
    space.save(tmp_path / "map.zarr")
    expected = space.to_xarray()
    with xarray.open_zarr(tmp_path / "map.zarr", consolidated=False, chunks=None) as opened:
        states = (
            opened.cell_states.isel(slice=opened.slice_of)
            if space.rotations.names
            else opened.cell_states.isel(slice=0)
        )
        if "yaw" in states.coords:  # those of a Dataset ascend
            states = states.isel(rotation=np.argsort(states.yaw.values))
            np.testing.assert_array_equal(states.yaw, expected.yaw)
        np.testing.assert_array_equal(states, expected.cell_states)
        assert {key: opened.attrs[key] for key in expected.attrs} == expected.attrs
        assert opened.cell_states.attrs == expected.cell_states.attrs
