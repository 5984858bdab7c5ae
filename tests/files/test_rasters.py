"""Arrays with coordinates or named dimensions, as cells of a workspace."""

import numpy as np
import pytest
import zarr
from hypothesis import given
from hypothesis import strategies as st

from cspace import Workspace
from cspace.errors import GeometryError, InputError, UnitWarning
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

xarray = pytest.importorskip("xarray")

X = -2.95 + 0.1 * np.arange(6)
Y = -1.65 - 0.1 * np.arange(4)
"""Centers of cells of 0.1 m: x ascends, and y descends as in a GeoTIFF."""


def make_raster(**changes):
    """Return rows from the top, with one occupied cell at (-2.95, -1.95)."""
    cells = np.zeros((4, 6), dtype=bool)
    cells[-1, 0] = True
    coordinates = {"y": Y, "x": X} | changes
    return xarray.DataArray(cells, dims=("y", "x"), coords=coordinates)


@given(seed=seeds, is_lazy=st.booleans(), dim=st.sampled_from([2, 3]))
def test_every_cell_lies_at_its_coordinates(seed, is_lazy, dim):
    rng = np.random.default_rng(seed)
    spacing = float(rng.choice([0.05, 0.1, 0.25]))
    axes = rng.permutation(list("xyz"[:dim])).tolist()
    shape = rng.integers(1, 6, dim)
    coordinates = {}
    for axis, count in zip(axes, shape, strict=True):
        centers = rng.integers(-50, 50) * spacing + spacing * np.arange(count)
        if rng.random() < 0.5:
            centers = centers[::-1]
        coordinates[axis] = centers.astype(rng.choice(["f4", "f8"]))
    raster = xarray.DataArray(rng.random(shape) < 0.4, dims=axes, coords=coordinates)
    workspace = Workspace.from_array(raster.chunk() if is_lazy else raster, spacing)
    assert workspace.outer.sum() == raster.values.sum()
    for index in np.argwhere(raster.values):
        place = {axis: coordinates[axis][i] for axis, i in zip(axes, index, strict=True)}
        center = [float(place[axis]) for axis in "xyz"[:dim]]
        assert workspace.outer[tuple(workspace.grid.cell_of(center))]


def test_a_lower_corner_that_is_given_counts_before_the_coordinates():
    workspace = Workspace.from_array(make_raster(), 0.1, (1, 2))
    assert workspace.grid.lower == (1.0, 2.0)
    assert np.argwhere(workspace.outer).tolist() == [[0, 0]]
    inner = Workspace.from_array(make_raster(), 0.1, inner=make_raster()).inner
    assert np.argwhere(inner).tolist() == [[0, 0]]


def test_a_raster_without_coordinates_is_indexed_by_x_and_y():
    raster = make_raster().drop_vars(["x", "y"])
    with pytest.raises(InputError, match=r"must be x, y .and z., in this order"):
        Workspace.from_array(raster, 0.1)
    workspace = Workspace.from_array(raster.transpose("x", "y")[:, ::-1], 0.1, (-3.0, -2.0))
    placed = Workspace.from_array(make_raster(), 0.1)
    assert workspace.grid.lower == pytest.approx(placed.grid.lower)
    assert (workspace.outer == placed.outer).all()


@refusals(
    "changes, spacing, message",
    ({"y": [0.0, 0.1, 0.3, 0.4]}, 0.1, "occupied.y has steps from 0.1 to 0.2 m"),
    ({"y": Y[[0, 2, 1, 3]]}, 0.1, "occupied.y has steps from "),
    ({}, 0.05, "they must be the spacing, 0.05 m; pass spacing=0.1"),
    ({"x": ("x", X, {"units": "degrees_east"})}, 0.1, "is in 'degrees_east'"),
    ({"y": [np.nan, *Y[1:]]}, 0.1, "occupied.y[0] is nan"),
)
def test_other_coordinates_are_refused(changes, spacing, message):
    with pytest.raises(InputError) as caught:
        Workspace.from_array(make_raster(**changes), spacing)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "attributes, message",
    [
        ({"standard_name": "longitude"}, "is in 'degrees of longitude'"),
        ({"Units": "cm"}, "is in 'cm'"),
        ({"uom": "km"}, "is in 'km'"),
        ({"axis": "Y"}, "says that it is Y"),
        ({"positive": "Down"}, "is positive downwards"),
        ({"standard_name": "depth"}, "is positive downwards"),
    ],
)
def test_attributes_of_a_coordinate_count(attributes, message):
    raster = make_raster()
    raster["x"].attrs = attributes
    with pytest.raises(InputError, match=message):
        Workspace.from_array(raster, 0.1)


def test_unknown_attributes_of_a_coordinate_are_named():
    raster = make_raster()
    raster["x"].attrs = {"shift": 0.5}
    with pytest.warns(UserWarning, match=r"occupied\.x, attributes: .* not read: shift"):
        Workspace.from_array(raster, 0.1)


def test_a_raster_of_one_band_is_that_of_the_plane():
    raster = make_raster()
    banded = raster.expand_dims(band=[1]).assign_attrs(AREA_OR_POINT="Area")
    expected = Workspace.from_array(raster, 0.1)
    found = Workspace.from_array(banded, 0.1)
    assert found.grid == expected.grid and (found.outer == expected.outer).all()


def test_the_reference_system_of_a_raster_counts():
    system = xarray.DataArray(0, attrs={"crs_wkt": 'GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]]'})
    with pytest.raises(
        GeometryError, match=r"occupied has the coordinate reference system.*ground"
    ):
        Workspace.from_array(make_raster(spatial_ref=system), 0.1)
    with pytest.raises(GeometryError, match=r"\+init=epsg:4326"):
        Workspace.from_array(make_raster().assign_attrs(crs="+init=epsg:4326"), 0.1)
    with pytest.warns(UnitWarning, match="read as metres"):
        Workspace.from_array(make_raster().assign_attrs(crs="EPSG:2056"), 0.1)


@pytest.mark.parametrize("names", [("y", "x"), ("lat", "lon"), ("x", "z")])
def test_dimensions_of_zarr_arrays_are_read(tmp_path, names):
    cells = np.zeros((3, 5), dtype=bool)
    options = {"config": {"write_empty_chunks": True}, "compressors": None}
    array = zarr.create_array(tmp_path / "a.zarr", data=cells, dimension_names=names, **options)
    for source in (tmp_path / "a.zarr", array):
        with pytest.raises(InputError, match="has the dimensions"):
            Workspace.from_array(source, 0.1)
    for good in (("x", "y"), None):
        zarr.create_array(
            tmp_path / "b.zarr", data=cells, dimension_names=good, overwrite=True, **options
        )
        assert Workspace.from_array(tmp_path / "b.zarr", 0.1).grid.shape == (3, 5)


def test_dimensions_of_zarr_arrays_of_version_2_are_read(tmp_path):
    make_raster().transpose("y", "x").to_dataset(name="walls").to_zarr(
        tmp_path / "map.zarr", zarr_format=2, consolidated=False
    )
    with pytest.raises(InputError, match=r"has the dimensions \('y', 'x'\)"):
        Workspace.from_array(zarr.open(tmp_path / "map.zarr")["walls"], 0.1)


TRANSFORM = {"GeoTransform": "7.0 0.1 0.0 2.6 0.0 -0.1"}
ROTATED = {"xc": (("x", "y"), np.full((6, 4), 7.0)), "yc": (("x", "y"), np.full((6, 4), 2.0))}


@pytest.mark.parametrize(
    ("coords", "attrs", "where"),
    [
        ({"spatial_ref": ((), 0, TRANSFORM)}, {}, "spatial_ref"),
        (ROTATED, {}, "xc, yc"),
        ({}, {"transform": (0.1, 0.0, 7.0, 0.0, -0.1, 2.6)}, "transform"),
        ({}, {"crs": "EPSG:32632", "res": (0.1, 0.1)}, "crs, res"),
        ({"x": 0.1 * np.arange(6), "lat": ("y", np.arange(4.0))}, {}, "lat"),
    ],
)
def test_a_place_that_coordinates_do_not_say_is_refused(coords, attrs, where):
    cells = np.zeros((6, 4), dtype=bool)
    array = xarray.DataArray(cells, dims=("x", "y"), coords=coords, attrs=attrs)
    with pytest.raises(InputError, match=f"has its place in {where}; each dimension needs"):
        Workspace.from_array(array, 0.1)
    assert Workspace.from_array(array.values, 0.1, lower=(7, 2)).grid.lower == (7.0, 2.0)


@pytest.mark.parametrize("kind", ["xarray", "zarr"])
def test_attributes_that_nobody_reads_are_named(tmp_path, kind):
    cells, attrs = (
        np.zeros((6, 4), dtype=bool),
        {"title": "floor", "resolution": 0.05, "Units": "mm"},
    )
    array = xarray.DataArray(cells, dims=("x", "y"), attrs=attrs)
    if kind == "zarr":
        array = zarr.create_array(tmp_path / "a.zarr", data=~cells, attributes=attrs)
    with pytest.warns(
        UserWarning, match=r"attributes: these fields are not read: resolution, units$"
    ):
        Workspace.from_array(array, 0.1)


def test_coordinates_of_32_bits_are_named():
    y = (5.4e4 + 0.1 * np.arange(8)).astype("f4")
    array = xarray.DataArray(np.zeros((3, 8), bool), dims=("x", "y"), coords={"x": X[:3], "y": y})
    with pytest.raises(InputError, match=r"occupied.y is float32, which rounds .* up to 0.002"):
        Workspace.from_array(array, 0.1)
    better = 5.4e4 + 0.1 * np.arange(8)
    assert Workspace.from_array(array.assign_coords(y=better), 0.1).grid.shape == (3, 8)


@refusals(
    "change, message",
    (lambda raster: raster.expand_dims(z=[0.05]).assign_coords(z=("z", [0.05], DOWN)), "downwards"),
    (lambda raster: raster.assign_coords(x=("x", X, {"unit": "km"})), "is in 'km'"),
    (lambda raster: raster.assign_coords(x=("x", X, {"scale_factor": 0.01})), "occupied.x has"),
    (lambda raster: raster.astype("u1").assign_attrs(_FillValue=1), "occupied has scale_factor"),
    (lambda raster: raster.astype("u1").assign_attrs(add_offset=-1), "occupied has scale_factor"),
    (lambda raster: raster.to_dataset(name="walls"), "is a Dataset; its labels are not read"),
    (
        lambda raster: raster.to_pandas(),
        "DataFrame.*",
    ),
    (lambda raster: raster.assign_coords(map=MERIDIANS), "system latitude_longitude"),
)
def test_attributes_that_change_the_numbers_are_refused(change, message):
    with pytest.raises((InputError, GeometryError), match=message):
        Workspace.from_array(change(make_raster()), 0.1)


DOWN = {"positive": "down"}
MERIDIANS = xarray.DataArray(0, attrs={"grid_mapping_name": "latitude_longitude"})


def test_inner_cells_must_lie_at_the_coordinates_of_the_outer_ones():
    for occupied in (make_raster(), np.zeros((6, 4), dtype=bool)):
        with pytest.raises(
            InputError, match=r"inner begins at \[-2\.9, -2\.0\] but occupied at.*cover"
        ):
            Workspace.from_array(occupied, 0.1, inner=make_raster(x=X + 0.1))
    cells = make_raster().transpose("x", "y").values[:, ::-1]
    workspace = Workspace.from_array(cells, 0.1, (-3.0, -2.0), inner=make_raster())
    assert (workspace.inner == cells).all()
