"""Meshes to build, write to files and read again."""

import numpy as np
import pytest
import trimesh

from cspace import FileError, GeometryError
from cspace.files.meshes import read_mesh

BOX_CORNERS = np.array(
    [(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0), (0, 0, 4), (4, 0, 4), (4, 4, 4), (0, 4, 4)], float
)
BOX_QUADS = (
    np.array([(4, 3, 2, 1), (5, 6, 7, 8), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8)])
    - 1
)
BOX_MESH = trimesh.Trimesh(
    BOX_CORNERS, np.concatenate([BOX_QUADS[:, :3], BOX_QUADS[:, [0, 2, 3]]]), process=False
)
BOX_SHIFT = np.array([10.0, 0.0, 0.0])
TETRAHEDRON = np.eye(4, 3, -1), np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
"""Vertices and faces."""


def make_box(low, high, inward=False):
    """Return vertices and faces of an axis-aligned box."""
    box = trimesh.creation.box()
    vertices, faces = np.where(box.vertices > 0, high, low).astype(float), np.array(box.faces)
    return vertices, faces[:, ::-1] if inward else faces


def join_meshes(*parts):
    """Join meshes, each given as vertices and faces."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=False)]),
    )


def lines(keyword, rows, ending="\n"):
    return "".join(f"{keyword} {' '.join(map(str, row))}{ending}" for row in rows)


VERTICES = lines("v", BOX_CORNERS)
FACES = lines("f", BOX_QUADS + 1)
SECOND = lines("v", BOX_CORNERS + BOX_SHIFT) + lines("f", BOX_QUADS + 9)


def read(tmp_path, name, content):
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    vertices, faces = read_mesh(file)
    return trimesh.Trimesh(vertices, faces, process=False)


def check_boxes(mesh, count=1):
    """Fail unless ``mesh`` is a row of outward boxes of side 4."""
    assert len(mesh.faces) == 12 * count
    assert mesh.volume == pytest.approx(64.0 * count)
    assert mesh.area == pytest.approx(96.0 * count)
    assert np.allclose(mesh.bounds, [[0, 0, 0], BOX_CORNERS[6] + BOX_SHIFT * (count - 1)])


def check_refused(tmp_path, name, content, message, error=(FileError, GeometryError)):
    with pytest.raises(error, match=message) as caught:
        read(tmp_path, name, content)
    assert name in str(caught.value)
    assert str(caught.value).count(";") >= 2
