"""Refusals of decompositions."""

import numpy as np
import pytest
import shapely

from cspace import Robot
from cspace.errors import GeometryError, InputError
from cspace.shapes.mesh import Mesh
from cspace.spectral import decompose
from tests.helpers.refusals import refusals
from tests.spectral.test_decompose import RECTANGLE

TRIANGLE = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), "surface")


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
