"""A map that carries an overlap field is saved, exported and planned on with it, and opens as it was or not at all."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import xarray
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from typer.testing import CliRunner

import cspace
from cspace import CSpace, InputError, Robot, Workspace, build
from cspace.cli import app
from cspace.errors import FileError
from cspace.io import record, store
from cspace.io.arrays import FIELDS, arrays_of
from cspace.io.reading import open_map, open_slice
from cspace.io.writing import export, save
from cspace.spectral import FourierOverlap, OverlapField
from maps import SUFFIXES, files, forged, interrupted, refused, same, spaces
from test_spatial_files import spaces as solid_spaces
from test_vti import read

OBSTACLE, RADIUS = (1.0, 0.32, 0.5), 0.3
KINDS = ["plane", "turning", "shared", "space"]


def names_of(space: CSpace) -> tuple[str, ...]:
    return FIELDS[: 1 + space.grid.dim]


def shape_of(space: CSpace) -> tuple[int, ...]:
    return space.grid.shape if space.rotations is None else space.stack.shape


def carrying(space: CSpace, fields: Any) -> CSpace:
    """The same map with arrays for a field."""
    return CSpace(
        space.workspace,
        space.robot,
        space.stack[0] if space.rotations is None else space.stack,
        outside=space.outside,
        margin=space.margin,
        precision=space.precision,
        overlaps=space.overlaps,
        rotations=space.rotations,
        fields=fields,
    )


def same_field(a: CSpace, b: CSpace) -> None:
    """Fail unless two maps and the fields that they carry are equal, to the last bit."""
    same(a, b)
    for name, array in a.fields.items():
        assert b.fields[name].dtype == np.float64
        assert not b.fields[name].flags.writeable
        assert b.fields[name].tobytes() == array.tobytes()
        assert b.fields[name].shape == array.shape


def scene(kind: str, **options: Any) -> tuple[CSpace, FourierOverlap]:
    """A ball, below a straight way along x, and a robot of balls that passes it at a distance of 0.14 m."""
    pytest.importorskip("finufft")
    dim = 3 if kind == "space" else 2
    centers, radii = np.array([OBSTACLE[:dim]]), np.array([RADIUS])
    balls = np.zeros((1 if kind in ("plane", "space") else 2, dim))
    balls[1:, 0] = 0.15
    if kind == "shared":
        balls[0, 0] = -0.15
    robot = balls, np.full(len(balls), 0.12)
    workspace = Workspace.from_balls(centers, radii, 0.05, bounds=(*[0.0] * dim, *(2.0, 1.6, 1.0)[:dim]))
    turns = 12 if kind in ("turning", "shared") else None
    overlap = FourierOverlap.of_shapes(robot, (centers, radii), swell=0.2)
    return build(workspace, Robot.balls(*robot), rotations=turns, **options), overlap


@pytest.fixture(scope="module", params=KINDS)
def carried(request: pytest.FixtureRequest) -> CSpace:
    space, overlap = scene(request.param, overlap=True, margin=0.01)
    return space.with_overlap_field(overlap)


# ---- the map -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_the_map_is_the_same_and_the_field_that_of_the_overlap(kind: str) -> None:
    space, overlap = scene(kind)
    clearance = space.clearance(space.nearest_free([0.0] * space.dof))
    made = space.with_overlap_field(overlap)
    same(space, carrying(made, None))
    assert space.overlap_field is None and not space.fields
    field, expected = made.overlap_field, OverlapField.of(space, overlap)
    assert field is not None and field.space is made
    assert list(made.fields) == list(names_of(space))
    assert field.values.max() > 0.0
    for name, array in made.fields.items():
        np.testing.assert_array_equal(array, expected.arrays[name])
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
    assert made._rasters[0][0] is space._rasters[0][0]  # it is not made again
    assert made.clearance(made.nearest_free([0.0] * space.dof)) == clearance
    assert (kind == "shared") == (space.rotations is not None and len(space.stack) < space.rotations.count)


@pytest.mark.parametrize("kind", KINDS)
def test_an_update_lets_the_field_go_and_leaves_other_maps(kind: str) -> None:
    space, overlap = scene(kind)
    made = space.with_overlap_field(overlap)
    assert made.overlap_field is not None
    box, corner = np.ones((3,) * space.grid.dim, bool), (4,) * space.grid.dim
    before = space.state.copy()
    made.update(box, corner)
    assert made.overlap_field is None and not made.fields
    assert (space.state == before).all()
    again = made.with_overlap_field(overlap)  # of a map that has a workspace of its own by now
    after, cells = again.state.copy(), again.workspace.outer.copy()
    made.update(~box, corner)
    assert (again.state == after).all() and (again.workspace.outer == cells).all()
    assert again.overlap_field is not None


def test_another_field_takes_the_place_of_the_first() -> None:
    space, overlap = scene("plane")
    first = space.with_overlap_field(overlap)
    wide = FourierOverlap.of_shapes(([[0.0, 0.0]], 0.12), ([[1.0, 0.32]], 0.3), swell=0.4)
    second = first.with_overlap_field(wide)
    same_field(second, space.with_overlap_field(wide))
    assert first.overlap_field is not None and second.overlap_field is not None
    assert (second.overlap_field.values > first.overlap_field.values).any()
    np.testing.assert_array_equal(first.overlap_field.values, OverlapField.of(space, overlap).values)


def test_a_build_makes_maps_without_a_field(carried: CSpace) -> None:
    """Nothing but the map itself carries it: what is built anew, of the same workspace and robot, has none."""
    again = build(carried.workspace, carried.robot, rotations=carried.rotations and carried.rotations.count)
    assert again.overlap_field is None
    assert not set(FIELDS) & set(again.to_xarray())


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"penetration": (3, 2)}, "the fields are penetration; .* must be penetration, penetration_x, penetration_y"),
        (dict.fromkeys(FIELDS, (3, 2)), "penetration_z; of a map of 2 axes they must be"),
        (dict.fromkeys([*FIELDS[:2], "depth"], (3, 2)), "the fields are penetration, penetration_x, depth"),
        (dict.fromkeys(FIELDS[:3], (2, 3)), r"penetration has shape \(2, 3\) .* the map's shape \(3, 2\)"),
        (dict.fromkeys(FIELDS[:3], (1, 3, 2)), r"penetration has shape \(1, 3, 2\)"),
    ],
)
def test_half_a_field_is_refused(fields: dict[str, tuple[int, ...]], words: str) -> None:
    space = build(Workspace.from_array(np.zeros((3, 2), dtype=bool), 0.1), Robot.disc(0.01))
    arrays = {name: np.zeros(shape) for name, shape in fields.items()}
    for make in (lambda: carrying(space, arrays), lambda: OverlapField(space, arrays)):
        with pytest.raises(InputError, match=words):
            make()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_no_numbers_are_refused(value: float) -> None:
    space = build(Workspace.from_array(np.zeros((3, 2), dtype=bool), 0.1), Robot.disc(0.01))
    arrays = {name: np.zeros((3, 2)) for name in FIELDS[:3]}
    arrays["penetration_y"][2, 1] = value
    with pytest.raises(InputError, match=r"penetration_y\[2, 1\] is (nan|-?inf)"):
        carrying(space, arrays)
    with pytest.raises(InputError, match="type float32"):
        carrying(space, {name: np.zeros((3, 2), np.float32) for name in FIELDS[:3]})


def test_a_field_that_does_not_fit_into_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    space, overlap = scene("plane")
    needed = 3 * 8 * space.grid.size
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: needed)
    with pytest.raises(InputError, match=r"the overlap field has 40 x 32 cells .* must fit; use a spacing of"):
        space.with_overlap_field(overlap)
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 2 * needed)
    space.with_overlap_field(overlap)


# ---- files -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(data=st.data())
@settings(max_examples=12)
def test_any_field_comes_back_as_it_was(suffix: str, data: st.DataObject) -> None:
    space = data.draw(spaces() | solid_spaces())
    numbers = st.floats(allow_nan=False, allow_infinity=False)
    fields = {name: data.draw(hnp.arrays(np.float64, shape_of(space), elements=numbers)) for name in names_of(space)}
    carried = carrying(space, fields)
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"map{suffix}"
        save(carried, path)
        same_field(carried, open_map(path))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_carried_field_comes_back_and_answers_as_before(tmp_path: Path, carried: CSpace, suffix: str) -> None:
    path = tmp_path / f"map{suffix}"
    carried.save(path)
    opened = cspace.open(path)
    same_field(carried, opened)
    old, new = carried.overlap_field, opened.overlap_field
    assert old is not None and new is not None and new.space is opened
    q = np.random.default_rng(0).uniform(-1.0, 3.0, (200, carried.dof))
    np.testing.assert_array_equal(new.at(q), old.at(q))
    assert old.at(q).max() > 0.0
    np.testing.assert_array_equal(open_slice(path, 1.0), carried.slice_at(1.0))


def test_several_chunks_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, carried: CSpace) -> None:
    monkeypatch.setattr(store, "_CHUNK", {1: 7, 2: 16, 3: 9})
    monkeypatch.setattr(store, "_SLICE_CHUNK", 16)
    carried.save(tmp_path / "map")
    assert len(list(files(tmp_path / "map" / "penetration" / "c"))) >= 6
    same_field(carried, open_map(tmp_path / "map"))


def test_numpy_reads_an_npz_without_this_library(tmp_path: Path, carried: CSpace) -> None:
    carried.export(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz", allow_pickle=False) as held:
        for name, array in carried.fields.items():
            np.testing.assert_array_equal(held[name], array)


def test_a_dataset_is_labelled(carried: CSpace) -> None:
    dataset, dim = carried.to_xarray(), carried.grid.dim
    cells = ("x", "y", "z")[:dim]
    for name, array in carried.fields.items():
        found = dataset[name]
        assert found.dims == (cells if carried.rotations is None else ("rotation", *cells))
        np.testing.assert_array_equal(found, array if carried.rotations is None else array[carried.slice_of])
        assert found.dtype == np.float64 and not found.values.flags.writeable
        assert "overlap of the descriptors" in dataset.penetration.attrs["long_name"]
    assert dataset.penetration.attrs["units"] == f"m{dim}"
    assert dataset.penetration_y.attrs["units"] == ("m" if dim == 2 else "m2")
    assert "along x" in dataset.penetration_x.attrs["long_name"]
    # The labels are those of the states: the field at a labelled place is the field there.
    field = carried.overlap_field
    assert field is not None
    at = {"x": 21, "y": 12, **({"z": 9} if dim == 3 else {}), **({"rotation": 4} if carried.rotations else {})}
    place = dataset.penetration.isel(at)
    q = [float(place[axis]) for axis in (*cells, *(["yaw"] if carried.rotations else []))]
    assert field.at(q) == pytest.approx(float(place), abs=1e-12) and float(place) > 0.0


def test_a_dataset_survives_zarr_and_netcdf(tmp_path: Path, carried: CSpace) -> None:
    dataset = carried.to_xarray()
    dataset.to_zarr(tmp_path / "set.zarr", zarr_format=3, consolidated=False)
    with xarray.open_zarr(tmp_path / "set.zarr", consolidated=False) as opened:
        assert opened.identical(dataset)
    dataset.to_netcdf(tmp_path / "set.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "set.nc", engine="scipy") as opened:
        for name in carried.fields:
            np.testing.assert_array_equal(opened[name], dataset[name])
            assert opened[name].attrs == dataset[name].attrs


def test_xarray_opens_the_folder(tmp_path: Path, carried: CSpace) -> None:
    carried.save(tmp_path / "map.zarr")
    with xarray.open_zarr(tmp_path / "map.zarr", consolidated=False) as opened:
        for name, array in carried.fields.items():
            np.testing.assert_array_equal(opened[name], array)
            assert opened[name].attrs == carried.to_xarray()[name].attrs
            assert opened[name].dims[-carried.grid.dim :] == ("x", "y", "z")[: carried.grid.dim]


def test_vtk_finds_the_field(tmp_path: Path, carried: CSpace) -> None:
    turning = carried.rotations is not None
    export(carried, tmp_path / "map.vti", yaw=4.0 if turning else None)
    image, found = read(tmp_path / "map.vti")
    assert list(found) == ["state", "outer", "inner", "overlap", *names_of(carried)]
    assert image.GetCellData().GetScalars().GetName() == "state"
    for name, array in carried.fields.items():
        expected = array[carried.slice_of[carried.rotations.cell_of(4.0)]] if carried.rotations is not None else array
        assert found[name].dtype == np.float64
        np.testing.assert_array_equal(found[name], expected.reshape(found[name].shape))


def test_a_ros_map_knows_of_no_field(tmp_path: Path, carried: CSpace) -> None:
    if carried.grid.dim == 3:
        with pytest.raises(InputError, match="a ROS map"):
            export(carried, tmp_path / "map.yaml")
        for suffix in (".ply", ".obj", ".stl"):
            for number, space in enumerate((carried, carrying(carried, None))):
                export(space, tmp_path / f"{number}{suffix}")
            assert (tmp_path / f"0{suffix}").read_bytes() == (tmp_path / f"1{suffix}").read_bytes()
        return
    yaw = None if carried.rotations is None else 1.0
    for folder, space in (("a", carried), ("b", carrying(carried, None))):
        (tmp_path / folder).mkdir()
        export(space, tmp_path / folder / "map.yaml", yaw=yaw)
    for file in ("map.yaml", "map.pgm"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_a_map_without_a_field_is_stored_as_ever(tmp_path: Path, carried: CSpace) -> None:
    plain = carrying(carried, None)
    assert not set(FIELDS) & set(arrays_of(plain))
    save(plain, tmp_path / "plain")
    save(carried, tmp_path / "carried")
    more = {f"{name}/" for name in names_of(carried)}
    every = {file.relative_to(tmp_path / "carried").as_posix() for file in files(tmp_path / "carried")}
    left = {file for file in every if not file.startswith(tuple(more))}
    assert {file.relative_to(tmp_path / "plain").as_posix() for file in files(tmp_path / "plain")} == left
    for file in left - {"zarr.json"}:
        assert (tmp_path / "plain" / file).read_bytes() == (tmp_path / "carried" / file).read_bytes()
    before, after = (json.loads((tmp_path / name / "zarr.json").read_text()) for name in ("plain", "carried"))
    digests = before["attributes"].pop("digests").split(), after["attributes"].pop("digests").split()
    assert [entry for entry in digests[1] if entry.partition(":")[0] not in FIELDS] == digests[0]
    assert before["attributes"].pop("digest") != after["attributes"].pop("digest")
    assert before == after


def test_the_digest_of_a_map_without_a_field_is_that_of_earlier_versions() -> None:
    space = build(Workspace.from_array(np.eye(9, 7, dtype=bool), 0.25), Robot.disc(0.125), overlap=True)
    sealed = record.seal({**record.metadata_of(space), "library_version": "any"}, arrays_of(space))
    assert sealed["digest"] == "3526d7bc365c09bf81a70ba1047c9560"


@pytest.mark.parametrize("old", [False, True])
def test_an_interrupted_save_leaves_no_half_field(tmp_path: Path, old: bool) -> None:
    space, overlap = scene("plane")
    interrupted(tmp_path / "map", space.with_overlap_field(overlap), KeyboardInterrupt, space if old else None)
    assert open_map(tmp_path / "map").overlap_field is not None
    save(space, tmp_path / "map", overwrite=True)
    assert open_map(tmp_path / "map").overlap_field is None


# ---- what may go wrong with the field of a saved map -------------------------------------------------------------


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    space, overlap = scene("turning")
    path = tmp_path_factory.mktemp("saved") / "map"
    save(space.with_overlap_field(overlap), path)
    save(space.with_overlap_field(overlap), path.with_suffix(".npz"))
    return path


@pytest.mark.parametrize("name", FIELDS[:3])
def test_every_array_is_needed_whole_and_unchanged(tmp_path: Path, saved: Path, name: str) -> None:
    path = Path(shutil.copytree(saved, tmp_path / "map"))
    expected = open_map(path)
    for file in files(path / name):
        content = file.read_bytes()
        for keep in (0.0, 0.5, 0.95):
            file.write_bytes(content[: int(len(content) * keep)])
            refused(path)
        file.unlink()
        refused(path)
        # The states of a yaw are read by themselves, and are as they were.
        np.testing.assert_array_equal(open_slice(path, 1.0), expected.slice_at(1.0))
        file.write_bytes(content)
    stored = zarr.open_array(path / name)
    earlier = np.asarray(stored[...])
    changed = earlier.copy()
    changed[7, 3, 2] = np.nextafter(changed[7, 3, 2], 1.0)
    stored[...] = changed
    refused(path, f"slice 7 of its array {name!r} differs from its digest")
    stored[...] = earlier
    same_field(expected, open_map(path))
    shutil.rmtree(path / name)
    refused(path, f"its array {name!r} is missing")


def test_a_lost_chunk_is_no_overlap_in_other_software_either(tmp_path: Path, saved: Path) -> None:
    path = Path(shutil.copytree(saved, tmp_path / "map"))
    (path / "penetration" / "c" / "2" / "0" / "0").unlink()
    assert (np.asarray(zarr.open_array(path / "penetration", mode="r")[2]) == np.inf).all()


@pytest.mark.parametrize("name", FIELDS[:3])
def test_every_member_of_an_npz_is_needed_unchanged(tmp_path: Path, saved: Path, name: str) -> None:
    path = tmp_path / "map.npz"
    with np.load(saved.with_suffix(".npz")) as held:
        members = {member: held[member] for member in held.files}
    members[name][3, 4, 5] = np.nextafter(members[name][3, 4, 5], 1.0)
    np.savez(path, **members)
    refused(path, f"slice 3 of its array {name!r} differs from its digest")
    with pytest.raises(FileError, match="differs from its digest"):  # an .npz file is read whole
        open_slice(path, 1.0)
    del members[name]
    np.savez(path, **members)
    refused(path, f"its array {name!r} is missing")


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"penetration": None}, "its parts make no map: the fields are penetration_x, penetration_y;"),
        ({"penetration_y": None}, "its parts make no map: the fields are penetration, penetration_x;"),
        ({"penetration_z": np.zeros((3, 2))}, "of a map of 2 axes they must be penetration, penetration_x"),
        ({"penetration": np.full((3, 2), np.nan)}, "its parts make no map: penetration[0, 0] is nan"),
        ({"penetration_x": np.full((3, 2), np.inf)}, "its parts make no map: penetration_x[0, 0] is inf"),
        ({"penetration": np.zeros((3, 2), np.float32)}, "is float32 (3, 2) where float64 (3, 2) is needed"),
        ({"penetration_x": np.zeros((2, 3))}, "its array 'penetration_x' is float64 (2, 3) where float64 (3, 2)"),
    ],
)
def test_fields_that_do_not_agree_are_refused(
    tmp_path: Path, suffix: str, content: dict[str, np.ndarray | None], words: str
) -> None:
    space = build(Workspace.from_array(np.zeros((3, 2), dtype=bool), 0.1), Robot.disc(0.01))
    carried = carrying(space, {name: np.full((3, 2), 0.5) for name in FIELDS[:3]})
    forged(tmp_path / f"map{suffix}", carried, {}, {})
    same_field(carried, open_map(tmp_path / f"map{suffix}"))
    forged(tmp_path / f"other{suffix}", carried, {}, content)
    refused(tmp_path / f"other{suffix}", words)


# ---- the command line --------------------------------------------------------------------------------------------


def document(*arguments: object) -> dict[str, Any]:
    result = CliRunner().invoke(app, [str(argument) for argument in (*arguments, "--json")])
    assert result.exit_code == 0, result.stderr
    found: dict[str, Any] = json.loads(result.stdout)
    return found


def test_the_command_line_tells_of_it(tmp_path: Path, carried: CSpace) -> None:
    carried.save(tmp_path / "map.zarr")
    carrying(carried, None).save(tmp_path / "plain.zarr")
    found, plain = (document("info", tmp_path / name) for name in ("map.zarr", "plain.zarr"))
    assert found.pop("overlap_field") is True and "overlap_field" not in plain
    more = sum(array.nbytes for array in carried.fields.values())
    assert found.pop("memory_bytes") - plain.pop("memory_bytes") == more
    assert found == plain
    told = CliRunner().invoke(app, ["info", str(tmp_path / "map.zarr")]).stdout
    assert any(line.split() == ["overlap", "field", "yes"] for line in told.splitlines())
    document("export", tmp_path / "map.zarr", tmp_path / "map.npz")
    same_field(carried, open_map(tmp_path / "map.npz"))


def test_the_command_line_plans_by_it(tmp_path: Path) -> None:
    space, overlap = scene("plane")
    space.with_overlap_field(overlap).save(tmp_path / "map.zarr")
    space.save(tmp_path / "plain.zarr")
    asked = ["--start", "0.43,0.88", "--goal", "1.57,0.88", "--planner", "RRTstar", "--objective", "overlap"]
    assert document("plan", tmp_path / "map.zarr", *asked, "--seed", 1)["certified"]
    result = CliRunner().invoke(app, ["plan", str(tmp_path / "plain.zarr"), *asked])
    assert result.exit_code == 2 and "carries no overlap field" in result.stderr
