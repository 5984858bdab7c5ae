"""Files and pictures of balls, and refusals."""

import json

import numpy as np
import pytest
import shapely
import trimesh
import yaml
from matplotlib.figure import Figure

from cspace import Robot
from cspace.errors import FileError, GeometryError, InputError
from cspace.shapes.mesh import Mesh
from cspace.spectral import BallDecomposition, Bounds, decompose
from tests.refusals import refusals
from tests.spectral.test_decompose import RECTANGLE

TRIANGLE = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), "surface")


def draw_balls(dim=2, seed=0, n=20):
    rng = np.random.default_rng(seed)
    centers, radii = rng.normal(size=(n, dim)) * 1e3, rng.random(n) * 10.0 ** rng.integers(-9, 3, n)
    return BallDecomposition(
        centers, radii, "outer", Bounds(0.1, 0.3), Bounds(0.0, 1 / 3), Bounds(1e-17, 2e22)
    )


@pytest.mark.parametrize("suffix", [".json", ".yaml", ".yml", ".JSON"])
@pytest.mark.parametrize("dim", [2, 3])
def test_save_and_open_keep_every_bit(tmp_path, suffix, dim):
    spheres = draw_balls(dim)
    file = spheres.save(tmp_path / f"balls{suffix}")
    back = BallDecomposition.open(file)
    assert back.centers.tobytes() == spheres.centers.tobytes()
    assert back.radii.tobytes() == spheres.radii.tobytes()
    for name in ("kind", "measure", "shape_measure", "hausdorff"):
        assert getattr(back, name) == getattr(spheres, name)


def test_save_replaces_files_only_if_asked(tmp_path):
    file = draw_balls().save(tmp_path / "balls.json")
    before = file.read_bytes()
    with pytest.raises(FileError, match="exists"):
        draw_balls(seed=1).save(file)
    assert file.read_bytes() == before
    draw_balls(seed=1).save(file, overwrite=True)
    assert file.read_bytes() != before
    assert len(list(tmp_path.iterdir())) == 1


@refusals(
    "text, message",
    ("{", "cannot be read"),
    ("[1]", "holds no balls"),
    ('{"format": "other"}', "holds no balls"),
    ('{"format": "cspace-balls", "version": 7}', "version 7"),
    ('{"format": "cspace-balls", "version": 2}', "lacks"),
)
@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_open_refuses_damaged_files(tmp_path, text, message, suffix):
    file = tmp_path / f"balls{suffix}"
    file.write_text(text)
    with pytest.raises(FileError, match=message):
        BallDecomposition.open(file)


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("radii", [10**400]),
        ("centers", [[0, 10**400]]),
        ("measure", [0, 10**400]),
        ("measure", [0, 1, 2]),
        ("measure", [1]),
        ("measure", 3),
        ("measure", "12"),
        ("measure", {"1": 0, "2": 0}),
        ("hausdorff", [0, None]),
        ("hausdorff", [1, 0]),
        ("radii", [1, 2]),
        ("kind", ["inner"]),
        ("centers", {"x": 0}),
        ("centers", [[0, 0], [1]]),
        ("radii", [None]),
    ],
)
def test_open_refuses_invalid_values(tmp_path, key, value, suffix):
    record = {"format": "cspace-balls", "version": 2, "kind": "inner", "measure": [0, 1]}
    record |= {"shape_measure": [0, 1], "hausdorff": [0, 1], "centers": [[0, 0]], "radii": [1]}
    file = tmp_path / f"balls{suffix}"
    dump = json.dumps if suffix == ".json" else yaml.safe_dump
    file.write_text(dump(record))
    assert len(BallDecomposition.open(file)) == 1
    file.write_text(dump(record | {key: value}))
    with pytest.raises(FileError, match="malformed"):
        BallDecomposition.open(file)


def test_save_and_open_refuse_invalid_file_names(tmp_path):
    with pytest.raises(InputError, match=r"\.txt"):
        draw_balls().save(tmp_path / "balls.txt")
    with pytest.raises(FileError, match="does not exist"):
        BallDecomposition.open(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="file name"):
        BallDecomposition.open(3)


@refusals(
    "changes, message",
    ({"radii": [0.0]}, "above zero"),
    ({"kind": "around"}, "kind"),
    ({"centers": [[0, np.nan]]}, "must be finite"),
    ({"measure": Bounds(-1, 1)}, "measure"),
    ({"measure": (0.0, 1.0, 2.0)}, "two numbers"),
    ({"hausdorff": 3.0}, "two numbers"),
)
def test_balls_refuse_invalid_arguments(changes, message):
    values = {"centers": [[0.0, 0.0]], "radii": [1.0], "kind": "inner"}
    values |= {name: Bounds(0, 1) for name in ("measure", "shape_measure", "hausdorff")}
    with pytest.raises(InputError, match=message):
        BallDecomposition(**(values | changes))


@refusals(
    "shape, options, error, message",
    (RECTANGLE, {}, InputError, "number is None and tolerance is None"),
    (RECTANGLE, {"number": 3, "tolerance": 0.1}, InputError, "number is 3 and tolerance is 0.1"),
    (RECTANGLE, {"number": 0}, InputError, "whole number above zero"),
    (RECTANGLE, {"number": 2.5}, InputError, "whole"),
    (RECTANGLE, {"number": True}, InputError, "whole number above zero"),
    (RECTANGLE, {"tolerance": 0.0}, InputError, "tolerance"),
    (RECTANGLE, {"tolerance": np.nan}, InputError, "tolerance"),
    (RECTANGLE, {"tolerance": 1e-7}, InputError, "pass at least about"),
    (RECTANGLE, {"number": 3, "kind": "both"}, InputError, "kind"),
    (shapely.Polygon(), {"number": 3}, GeometryError, "no geometry|empty"),
    ([], {"number": 3}, GeometryError, "no geometry"),
    (shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), {"number": 3}, GeometryError, "not valid"),
    (shapely.LineString([(0, 0), (1, 1)]), {"number": 3}, GeometryError, "no inside"),
    ([(0, 0), (1, 1)], {"number": 3}, InputError, "at least 3"),
    (TRIANGLE, {"number": 3}, GeometryError, "no inside"),
    (Mesh(TRIANGLE.vertices, TRIANGLE.faces, "fill"), {"number": 3}, InputError, "fill"),
    (Robot.disc(1.0).shape, {"number": 3}, InputError, "balls already"),
    (np.array(5.0), {"number": 3}, InputError, "a mesh is needed"),
    (np.ones((3, 3), bool), {"number": 3}, InputError, "Voxels"),
    (shapely.Point(3, 4), {"number": 3, "kind": "outer"}, InputError, "pass a tolerance"),
)
def test_decompose_refuses_invalid_arguments(shape, options, error, message):
    with pytest.raises(error, match=message):
        decompose(shape, **options)


def test_decompose_refuses_to_exceed_the_memory(monkeypatch):
    monkeypatch.setattr("cspace.limits.free_bytes", lambda: 10_000)
    with pytest.raises(InputError, match="memory"):
        decompose(RECTANGLE, number=5)


@refusals("shape, text", (RECTANGLE, "discs"), (trimesh.creation.box(), "balls"))
def test_plot_draws_balls_and_their_shape(shape, text):
    spheres = decompose(shape, number=6)
    ax = spheres.plot()
    assert f"{len(spheres)} inner {text}" in ax.get_title()
    low, high = ax.get_xlim()
    assert low < spheres.shape.outer.bounds[0][0] < spheres.shape.outer.bounds[1][0] < high
    assert len(ax.collections) == 2
    ax.figure.canvas.draw()
    again = spheres.plot(ax, title="mine")
    assert again is ax and ax.get_title() == "mine"
    with pytest.raises(InputError, match="3d"):
        spheres.plot(Figure().add_subplot(projection=None if spheres.dim == 3 else "3d"))
