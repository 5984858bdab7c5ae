"""The border of the free space is closed, faces outwards and encloses the FREE cells."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import cspace
from cspace.errors import FileError, InputError
from cspace.io.border import WRITERS, free_border, triangles
from cspace.io.border.triangles import writer_of
from cspace.io.writing import export


def bare(state: np.ndarray, lower: tuple[float, ...] = (0.0, 0.0, 0.0), spacing: float = 1.0) -> Any:
    """What :func:`free_border` asks of a map."""
    return SimpleNamespace(grid=cspace.Grid(lower, spacing, state.shape), state=state)


states = hnp.arrays(np.uint8, st.tuples(*[st.integers(1, 5)] * 3), elements=st.integers(0, 2)).filter(
    lambda state: bool((state == cspace.FREE).any())
)


def squares(state: np.ndarray) -> Counter[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Twice the middle and the outward normal of each side of a FREE cell beyond which is none, by brute force."""
    free = {tuple(cell.tolist()) for cell in np.argwhere(state == cspace.FREE)}
    normals = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    return Counter(
        (tuple(2 * i + 1 + n for i, n in zip(cell, normal, strict=True)), normal)
        for cell, normal in product(free, normals)
        if tuple(i + n for i, n in zip(cell, normal, strict=True)) not in free
    )


@given(state=states)
@settings(max_examples=150)
def test_the_border_is_that_of_the_free_cells(state: np.ndarray) -> None:
    vertices, faces = free_border(bare(state))
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    np.testing.assert_array_equal(np.abs(normals).sum(axis=1), 1.0)
    low, high = corners.min(axis=1), corners.max(axis=1)
    np.testing.assert_array_equal(np.sort(high - low, axis=1), np.tile([0.0, 1.0, 1.0], (len(faces), 1)))
    found = Counter(
        (tuple(middle), tuple(normal))
        for middle, normal in zip((low + high).astype(int).tolist(), normals.astype(int).tolist(), strict=True)
    )
    assert found == Counter({square: 2 * count for square, count in squares(state).items()})
    # Two triangles of half a square each fill it only if they differ.
    assert len({tuple(sorted(face)) for face in faces.tolist()}) == len(faces)
    assert len(np.unique(vertices, axis=0)) == len(vertices)
    assert np.array_equal(np.unique(faces), np.arange(len(vertices)))


@given(state=states)
@settings(max_examples=100)
def test_the_border_is_closed(state: np.ndarray) -> None:
    _, faces = free_border(bare(state))
    ways = Counter((face[i], face[i - 2]) for face in faces.tolist() for i in range(3))
    edges = Counter(tuple(sorted(edge)) for edge in ways.elements())
    assert set(edges.values()) <= {2, 4}
    assert all(ways[a, b] == ways[b, a] for a, b in edges)


@given(state=states, spacing=st.sampled_from([0.1, 0.37, 2.0]), shift=st.floats(-50.0, 50.0))
@settings(max_examples=60)
def test_the_border_encloses_the_volume_of_the_free_cells(state: np.ndarray, spacing: float, shift: float) -> None:
    vertices, faces = free_border(bare(state, (shift, -shift, 0.5), spacing))
    volume = Fraction(0)
    for a, b, c in np.vectorize(Fraction, otypes=[object])(vertices - vertices[0])[faces]:
        volume += sum(a[i] * (b[i - 2] * c[i - 1] - b[i - 1] * c[i - 2]) for i in range(3))
    expected = np.count_nonzero(state == cspace.FREE) * spacing**3
    assert float(volume / 6) == pytest.approx(expected, rel=1e-9)
    for axis, n in enumerate(state.shape):
        lines = (shift, -shift, 0.5)[axis] + spacing * np.arange(n + 1)
        assert np.isin(vertices[:, axis], lines).all()


@pytest.fixture(scope="module")
def space() -> cspace.CSpace:
    """A ball among voxels; no two FREE cells touch in an edge only."""
    cells = np.zeros((20, 18, 16), dtype=bool)
    cells[4:9, 5:8, 3:12] = cells[13, 12, 8] = True
    workspace = cspace.Workspace.from_array(cells, 0.1, (-0.7, 3.0, 0.3))
    return cspace.build(workspace, cspace.Robot.ball(0.13), outside="free")


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_mesh_file_reads_back(tmp_path: Path, space: cspace.CSpace, suffix: str) -> None:
    path = tmp_path / f"free{suffix.upper()}"
    space.export(path)
    mesh = trimesh.load_mesh(path)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(space.count()[0] * space.grid.spacing**3, rel=1e-5)
    vertices, faces = free_border(space)
    exact = vertices if suffix != ".stl" else vertices.astype(np.float32).astype(np.float64)
    np.testing.assert_array_equal(np.sort(mesh.triangles, axis=None), np.sort(exact[faces], axis=None))
    normals = np.cross(*np.diff(vertices[faces], axis=1).transpose(1, 0, 2)) / space.grid.spacing**2
    np.testing.assert_allclose(mesh.face_normals, normals, atol=1e-5)


def test_ply_keeps_every_bit_and_shares_vertices(tmp_path: Path, space: cspace.CSpace) -> None:
    space.export(tmp_path / "free.ply")
    mesh = trimesh.load_mesh(tmp_path / "free.ply", process=False)
    vertices, faces = free_border(space)
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.faces, faces)


def test_obj_keeps_every_bit_and_shares_vertices(tmp_path: Path, space: cspace.CSpace) -> None:
    space.export(tmp_path / "free.obj")
    rows = [line.split() for line in (tmp_path / "free.obj").read_text().splitlines()]
    vertices, faces = free_border(space)
    np.testing.assert_array_equal([[float(x) for x in row[1:]] for row in rows if row[0] == "v"], vertices)
    np.testing.assert_array_equal([[int(x) - 1 for x in row[1:]] for row in rows if row[0] == "f"], faces)
    assert len(rows) == len(vertices) + len(faces)


def test_stl_holds_unit_normals(tmp_path: Path) -> None:
    writer = writer_of("free.stl")
    vertices, faces = free_border(bare(np.zeros((2, 3, 1), np.uint8), spacing=1e-30, lower=(1e-30, 0.0, 0.0)))
    with (tmp_path / "free.stl").open("wb") as file:
        writer(file, vertices, faces)
    content = (tmp_path / "free.stl").read_bytes()
    assert len(content) == 84 + 50 * len(faces)
    assert not content.startswith(b"solid")  # which readers would take for an ASCII file
    rows = np.frombuffer(content[84:], np.uint8).reshape(-1, 50)[:, :48].copy().view("<f4").reshape(-1, 4, 3)
    edges = np.diff(vertices[faces] / 1e-30, axis=1)
    np.testing.assert_allclose(rows[:, 0], np.cross(edges[:, 0], edges[:, 1]), atol=1e-6)
    np.testing.assert_array_equal(rows[:, 1:], vertices[faces].astype(np.float32))


@given(far=st.sampled_from([2.0**22 - 6, -(2.0**22) + 6, 1e5]))
@settings(max_examples=5)
def test_far_from_the_origin_an_stl_is_closed_still(far: float) -> None:
    vertices, faces = free_border(bare(np.zeros((5, 4, 3), np.uint8), (far * 0.1, 0.0, -far * 0.1), 0.1))
    single = vertices.astype(np.float32)
    assert len(np.unique(single, axis=0)) == len(vertices)
    assert trimesh.Trimesh(single.astype(float), faces, process=False).is_watertight


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("block", [1, 7, 10**6])
def test_blocks_do_not_show(suffix: str, block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, writer = free_border(bare(np.zeros((2, 2, 3), np.uint8))), writer_of(f"free{suffix}")
    for name, rows in (("a", triangles._BLOCK), ("b", block)):
        monkeypatch.setattr(triangles, "_BLOCK", rows)
        with (tmp_path / name).open("wb") as file:
            writer(file, *mesh)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


# What has no border, or no file that holds it.


def test_a_map_without_free_cells_is_refused(tmp_path: Path) -> None:
    full = cspace.build(cspace.Workspace.from_array(np.ones((3, 3, 3), bool), 0.1), cspace.Robot.ball(0.1))
    with pytest.raises(InputError, match=r"the map has no FREE cell; a border needs at least one; build it with"):
        full.export(tmp_path / "free.stl")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("rotations", [None, 4])
@pytest.mark.parametrize("yaw", [None, 0.5])
def test_a_map_of_the_plane_is_refused(tmp_path: Path, rotations: int | None, yaw: float | None) -> None:
    plane = cspace.build(
        cspace.Workspace.from_array(np.eye(5, 4, dtype=bool), 0.1), cspace.Robot.disc(0.1), rotations=rotations
    )
    with pytest.raises(InputError, match=r"5 x 4 cells in the plane; .* only in space; export a .vti or .yaml"):
        export(plane, tmp_path / "free.ply", yaw=yaw)
    assert not list(tmp_path.iterdir())


def test_a_robot_that_only_translates_takes_no_yaw(tmp_path: Path, space: cspace.CSpace) -> None:
    with pytest.raises(InputError, match=r"yaw is 0.5 for a robot that only translates; .*leave it out"):
        export(space, tmp_path / "free.stl", yaw=0.5)


def test_a_border_that_does_not_fit_into_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 1000)
    with pytest.raises(InputError, match=r"the border of the free space .* needs about .* of which 1 kB are free"):
        free_border(bare(np.zeros((5, 5, 5), np.uint8)))


@pytest.mark.parametrize("spacing", [1e-60, 1e60])
def test_an_stl_refuses_what_single_precision_cannot_hold(tmp_path: Path, spacing: float) -> None:
    mesh = free_border(bare(np.zeros((2, 2, 2), np.uint8), spacing=spacing))
    with (
        (tmp_path / "free").open("wb") as file,
        pytest.raises(InputError, match=r"do not keep apart in single precision.*write .ply or .obj"),
    ):
        writer_of("free.stl")(file, *mesh)


@pytest.mark.parametrize("suffix", WRITERS)
def test_more_triangles_than_a_file_counts_are_refused(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(triangles, "_MOST", 11)
    mesh = free_border(bare(np.zeros((1, 1, 1), np.uint8)))
    with (tmp_path / "free").open("wb") as file, pytest.raises(InputError, match=r"12 triangles; .* at most 11"):
        writer_of(f"free{suffix}")(file, *mesh)


def test_an_earlier_file_is_kept_unless_told_otherwise(tmp_path: Path, space: cspace.CSpace) -> None:
    path = tmp_path / "free.stl"
    path.write_text("years of work")
    with pytest.raises(FileError, match="--overwrite"):
        export(space, path)
    assert path.read_text() == "years of work"
    export(space, path, overwrite=True)
    assert trimesh.load_mesh(path).is_watertight
    assert len(list(tmp_path.iterdir())) == 1


def test_another_suffix_is_refused() -> None:
    with pytest.raises(InputError, match=r"free.glb ends in '.glb'; .*use one of .ply, .obj, .stl"):
        writer_of("free.glb")
