"""NRRD grids, against VTK's reader and known values."""

import gzip
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import cspace
from cspace import Grid, Robot, Workspace
from cspace.errors import CspaceError, FileError, InputError
from cspace.files.formats import read_dimension
from tests.refusals import refusals
from tests.strategies import seeds

TYPES = {
    "signed char": "i1",
    "uchar": "u1",
    "short": "i2",
    "unsigned short": "u2",
    "int": "i4",
    "uint32": "u4",
    "int64_t": "i8",
    "uint64": "u8",
    "float": "f4",
    "double": "f8",
}


def write(
    path: Path, values: NDArray[Any], kind: str, *lines: str, encoding: str = "raw", endian: str = "little"
) -> Path:
    """Write an attached NRRD file from values [x, y(, z)]."""
    head = ["NRRD0004", "# made by hand", f"type: {kind}", f"dimension: {values.ndim}"]
    head += [f"sizes: {' '.join(map(str, values.shape))}", f"encoding: {encoding}", f"endian: {endian}"]
    head += [*lines, "colour:=red", "", ""]
    body = values.astype({"little": "<", "big": ">"}[endian] + TYPES[kind]).tobytes(order="F")
    path.write_bytes("\n".join(head).encode() + (body if encoding == "raw" else gzip.compress(body, mtime=0)))
    return path


@given(
    seeds, st.sampled_from(sorted(TYPES)), st.sampled_from(["raw", "gzip", "gz"]), st.sampled_from(["little", "big"])
)
def test_cells_are_the_values_at_or_above_the_threshold(
    tmp_path_factory: pytest.TempPathFactory, seed: int, kind: str, encoding: str, endian: str
) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 7, int(rng.integers(2, 4))).tolist())
    values = rng.integers(0, 100, shape)
    path = tmp_path_factory.getbasetemp() / f"{seed}.nrrd"
    write(path, values, kind, encoding=encoding, endian=endian)
    workspace = Workspace.from_nrrd(path, 0.1, threshold=40)
    assert (workspace.outer == (values >= 40)).all()
    assert workspace.inner is workspace.outer
    assert workspace.grid == Grid(np.zeros(len(shape)), 0.1, shape)
    assert read_dimension(path) == len(shape)
    path.unlink()


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
def test_values_and_placement_agree_with_vtk(tmp_path: Path, encoding: str) -> None:
    vtk = pytest.importorskip("vtk")
    numpy_support = pytest.importorskip("vtk.util.numpy_support")
    values = np.random.default_rng(0).integers(0, 9, (14, 6, 5))  # VTK reads a short first axis as components
    lines = ("space dimension: 3", "space directions: (0.2,0,0) (0,0.2,0) (0,0,0.2)", "space origin: (1.5,-2,0.25)")
    path = write(tmp_path / "a.nrrd", values, "short", *lines, encoding=encoding)
    reader = vtk.vtkNrrdReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    theirs = numpy_support.vtk_to_numpy(image.GetPointData().GetScalars()).reshape(image.GetDimensions(), order="F")
    workspace = Workspace.open(path, threshold=5)
    assert (workspace.outer == (theirs >= 5)).all()
    assert workspace.grid.spacing == pytest.approx(image.GetSpacing()[0])
    for index in ((0, 0, 0), (13, 5, 4), (1, 2, 0)):
        point = image.GetPoint(int(np.ravel_multi_index(index, image.GetDimensions(), order="F")))
        np.testing.assert_allclose(workspace.grid.center_of(index), point)


@pytest.mark.parametrize(
    ("directions", "units", "order", "flipped"),
    [
        ("(0.5,0,0) (0,0.5,0) (0,0,0.5)", "", (0, 1, 2), ()),
        ("(500,0,0) (0,500,0) (0,0,500)", 'space units: "mm" "mm" "mm"', (0, 1, 2), ()),
        ("(0,50,0) (0,0,-50) (50,0,0)", 'space units: "cm" "cm" "cm"', (2, 0, 1), (2,)),
        ("(-0.5,0,0) (0,-0.5,0) (0,0,0.5)", "", (0, 1, 2), (0, 1)),
        ("(0,0.5000001,0) (0.5,0,0) (0,0,0.5)", "", (1, 0, 2), ()),
    ],
    ids=["straight", "millimetres", "turned", "downward", "rounded"],
)
def test_each_voxel_is_where_the_header_places_it(
    tmp_path: Path, directions: str, units: str, order: tuple[int, ...], flipped: tuple[int, ...]
) -> None:
    values = np.random.default_rng(1).integers(0, 2, (4, 3, 5))
    scale = {"": 1.0, "m": 1e-3, "c": 1e-2}[units.partition('"')[2][:1]]
    origin = np.array([1.0, -2.0, 3.0])
    lines = [f"space origin: ({','.join(str(x / scale) for x in origin)})", f"space directions: {directions}"]
    path = write(tmp_path / "a.nrrd", values, "uchar", "space dimension: 3", *lines, *([units] if units else []))
    workspace = Workspace.open(path)
    steps = scale * np.array([[float(x) for x in vector.strip("()").split(",")] for vector in directions.split(" ")])
    for index in np.ndindex(values.shape):
        cell = workspace.grid.cell_of(origin + np.array(index) @ steps)
        assert workspace.outer[tuple(cell)] == values[index]
    assert workspace.grid.shape == tuple(values.shape[k] for k in order)


def test_arguments_override_the_header(tmp_path: Path) -> None:
    values = np.eye(4, 3)
    path = write(tmp_path / "a.nrrd", values, "double", "spacings: 0.5 0.5", "axis mins: 1 1")
    assert Workspace.open(path, lower=(2, 3)).grid == Grid((2, 3), 0.5, (4, 3))
    assert Workspace.open(path, lower=(2, 3), spacing=0.1).grid == Grid((2, 3), 0.1, (4, 3))
    space = cspace.build(Workspace.open(path, lower=(0, 0)), Robot.disc(0.1))
    assert not space.is_free((0.2, 0.2))


PLAIN = "NRRD0004\ntype: uchar\ndimension: 2\nsizes: 3 2\nencoding: raw\nspacings: 1 1\n"


@refusals(
    "text, body, message",
    ("", b"", "has no empty line"),
    ("NRRD0009\n\n", b"", "begins with 'NRRD0009'"),
    (PLAIN, b"", "has no empty line"),
    (PLAIN + "\n", b"\0" * 5, "holds fewer values than its header declares"),
    (PLAIN + "\n", b"\0" * 7, "holds more values than its header declares"),
    (PLAIN.replace("raw", "gzip") + "\n", gzip.compress(bytes(5), mtime=0), "fewer values"),
    (PLAIN.replace("raw", "gzip") + "\n", gzip.compress(bytes(7), mtime=0), "more values"),
    (PLAIN.replace("raw", "gzip") + "\n", gzip.compress(bytes(6), mtime=0)[:-3], "cannot be read as a grid in NRRD"),
    (PLAIN.replace("raw", "gzip") + "\n", b"not packed", "cannot be read as a grid in NRRD"),
    (PLAIN.replace("raw", "bzip2") + "\n", b"", "has the encoding 'bzip2'; only raw and gzip are read"),
    (PLAIN.replace("uchar", "block") + "\n", b"", "has values of type 'block'"),
    (PLAIN.replace("uchar", "short") + "\n", bytes(12), "says endian ''; it must be little or big"),
    (PLAIN.replace("3 2", "3 -2") + "\n", b"", "says sizes '3 -2'"),
    (PLAIN.replace("3 2", "3 2 1 1").replace(": 2", ": 4") + "\n", b"", "has 4 sizes; a grid has 2 or 3 axes"),
    (PLAIN.replace("dimension: 2", "dimension: 3") + "\n", b"", "says dimension '3' but has 2 sizes"),
    (PLAIN + "data file: other.raw\n\n", b"", "keeps its values in another file"),
    (PLAIN + "byte skip: -1\n\n", bytes(6), "skips data"),
    (PLAIN + "sizes: 3 2\n\n", bytes(6), "says 'sizes' twice"),
    (PLAIN.replace("1 1", "1 nan") + "\n", bytes(6), "says spacings"),
    (PLAIN.replace("1 1", "1 2") + "\n", bytes(6), "cells must be cubes along the axes"),
    (PLAIN.replace("1 1", "0 0") + "\n", bytes(6), "cells must be cubes along the axes"),
    (PLAIN + "space directions: (1,1) (-1,1)\n\n", bytes(6), "cells must be cubes along the axes"),
    (PLAIN + "space directions: (1,0) (1,0)\n\n", bytes(6), "cells must be cubes along the axes"),
    (PLAIN + "space directions: none (1,0)\n\n", bytes(6), "it must be 2 vectors of 2 finite numbers"),
    (PLAIN + 'units: "mm" "s"\n\n', bytes(6), "has the units 'mm', 's'"),
    (PLAIN + "axis mins: 0 0\n\n", bytes(6), "gives its bounds as axis mins or maxs; .* pass lower="),
    (PLAIN + "space origin: (1e300,0)\n\n", bytes(6), "cells from the origin"),
    (PLAIN.replace("uchar", "float") + "endian: big\n\n", np.full(6, np.nan, ">f4").tobytes(), "holds NaN"),
    (PLAIN + "\n", bytes([0, 1, 2, 0, 0, 0]), "threshold is missing for .*, which holds 2; without it"),
    (PLAIN.replace("spacings: 1 1\n", "\n"), bytes(6), "spacing is missing for"),
    (PLAIN.replace("3 2", "99999 99999") + "\n", b"", "declares 99999 x 99999 cells"),
    (
        PLAIN.replace("3 2", "20000 20000").replace("raw", "gzip") + "\n",
        b"",
        "declares 400,000,000 compressed voxels in",
    ),
)
def test_malformed_files_are_refused_in_one_line(tmp_path: Path, text: str, body: bytes, message: str) -> None:
    path = tmp_path / "bad.nrrd"
    path.write_bytes(text.encode() + body)
    with pytest.raises(CspaceError, match=message) as caught:
        Workspace.from_nrrd(path)
    assert "\n" not in str(caught.value) and ("bad.nrrd" in str(caught.value) or "origin" in message)
    assert isinstance(caught.value, FileError | InputError)


@refusals(
    "options, message",
    ({"spacing": -1.0}, "spacing is -1.0"),
    ({"lower": (0, 0, 0)}, "lower has shape"),
    ({"threshold": np.nan}, "threshold is nan"),
    ({"threshold": (1, 2)}, "threshold is .* it must be one number"),
)
def test_unusable_arguments_are_refused(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    path = write(tmp_path / "a.nrrd", np.eye(3), "uchar", "spacings: 1 1")
    with pytest.raises(InputError, match=message):
        Workspace.from_nrrd(path, **options)


BOMB = """
import resource, sys
import cspace
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    cspace.Workspace.from_nrrd(sys.argv[1], threshold=1)
except cspace.CspaceError as error:
    print(error)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


@pytest.mark.parametrize(
    ("sizes", "unpacked"), [("3 2", 2**31), ("16384 16384", 2**28)], ids=["more than declared", "as declared"]
)
def test_files_that_unpack_to_gigabytes_take_little_memory(tmp_path: Path, sizes: str, unpacked: int) -> None:
    head = PLAIN.replace("3 2", sizes).replace("raw", "gzip")
    path = tmp_path / "bomb.nrrd"
    with path.open("wb") as file:
        file.write(f"{head}\n".encode())
        part = gzip.compress(bytes(2**24), mtime=0)
        for _ in range(unpacked // 2**24):
            file.write(part)
    assert path.stat().st_size < 10_000_000
    run = subprocess.run(
        [sys.executable, "-c", BOMB, str(path)], capture_output=True, text=True, check=True, env={**os.environ}
    )
    assert float(run.stdout.split("\n")[-2]) < 900.0  # megabytes
