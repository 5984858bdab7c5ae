"""Names of files, and other files in place of the expected ones."""

import os
import re

import pytest

import cspace
from cspace import CspaceError, FileError, InputError, Robot, Workspace, make_mesh
from cspace._files.access import BROUGHT
from tests.helpers.handmade import build_empty
from tests.helpers.repository import ROOT

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:" + 64 * "0" + "\nsize 12345\n"

READERS = {
    "floor.yaml": Workspace.open,
    "Cells.NPY": lambda path: Workspace.open(path, spacing=0.1),
    "part.stl": make_mesh,
    "cart.geojson": Robot.open,
}
"""Reader of each name."""


@pytest.mark.parametrize("name", READERS)
def test_a_pointer_of_git_lfs_is_refused_with_the_command_that_fetches_the_file(tmp_path, name):
    (tmp_path / name).write_text(POINTER)
    message = rf"{name}: is a git-lfs pointer; .* has not been fetched"
    with pytest.raises(FileError, match=message):
        READERS[name](tmp_path / name)


@pytest.mark.parametrize(
    "name, misspelt, read",
    [
        *((name, name[1] + name[0] + name[2:], read) for name, read in READERS.items()),
        ("floor.yaml", "floor.ymal", Workspace.open),
        ("floor.zarr", "floo.zarr", cspace.open),
    ],
)
def test_the_error_names_the_nearest_file_of_the_folder(tmp_path, name, misspelt, read):
    for file in (name, "other.dat", f".{misspelt}", "notes.md"):
        (tmp_path / file).touch()
    with pytest.raises(CspaceError) as refused:
        read(tmp_path / misspelt)
    assert f"did you mean {name!r}?" in refused.value.hint


def test_a_file_of_another_format_is_refused_with_its_converter(tmp_path):
    with pytest.raises(CspaceError) as refused:
        make_mesh(tmp_path / "part.off")
    assert "did you mean" not in refused.value.hint
    (tmp_path / "part.off").touch()
    with pytest.raises(CspaceError, match="Bring your file"):
        make_mesh(tmp_path / "part.off")


@pytest.mark.parametrize("name", [300 * "x", "a\0b", "\ud800"])
@pytest.mark.parametrize("suffix", ["", ".zarr", ".png", ".stl", ".urdf"])
def test_a_text_that_cannot_be_a_name_is_refused(name, suffix):
    space = build_empty((4, 4), "disc:0.1")
    calls = [
        *(Workspace.open, Robot.open, cspace.open, cspace.Arm.from_urdf, space.save),
        lambda path: cspace.build(space.workspace, "disc:0.1", store=path),
    ]
    for call in calls:
        with pytest.raises(CspaceError):
            call(name + suffix)


WORDS = {
    ".nc": "netCDF",
    ".nii": "NIfTI",
    ".dcm": "DICOM",
    ".xml": "MJCF",
    ".shp": "Shapefile",
    ".gpkg": "GeoPackage",
}
WORDS |= {".fgb": "FlatGeobuf", ".blend": "Blender", ".igs": "IGES", ".stp": "STEP"}
WORDS |= {".usda": "USD", ".usdz": "USD"}
"""Names of formats that their suffixes do not tell."""


PAGE = (ROOT / "docs/howto/bring_your_file.md").read_text(encoding="utf-8")
HEADINGS = re.findall(r"^(?:## |\*\*|\| )(.+)", PAGE, re.MULTILINE)
"""Beginnings of the parts of the page "Bring your file", and rows of its tables."""

LED_TO = {
    "_support/limits.py": ["OFF, and meshes in millimetres"],
    "_support/kinds.py": [
        "A `LaserScan`",
        "a building of Open-RMF",
        "A picture that is already an array, MHA, DXF, LAS, Open3D's `Octree`, MJCF, a URDF that",
        "Rows of 0 and 1 in JSON",
    ],
    "_files/crs.py": ["Shapefile, GeoPackage", *["degrees of longitude and latitude in"] * 3],
    "_files/images.py": ["A GeoTIFF of costs"],
    "_files/point_clouds.py": [*["A map drawn in a text file"] * 2, "PCD of compressed data"],
    "_files/rasters.py": ["A netCDF of costs"],
    "_files/unit_notes.py": ["OFF, and meshes in millimetres"],
    "arms/_reading/urdf.py": ["MJCF, SDF, USD", "`.xacro`"],
}
"""What the page says of each value or file, from whose refusal a module leads to the page."""


def has_heading(words):
    """Return True if a part or row of the page begins with words, or names them first."""
    pattern = rf"(?i)^.{{,60}}(?<!\w){re.escape(words)}"
    return any(re.search(pattern, heading.partition(" | ")[0]) for heading in HEADINGS)


def test_a_hint_leads_to_a_heading_of_the_page():
    found = {}
    for file in (ROOT / "cspace").rglob("*.py"):
        uses = re.findall(r"^(?!from).*\b_?BRING_YOUR_FILE\b(?!: )", file.read_text(), re.MULTILINE)
        if uses and file.name != "access.py":  # whose suffixes are followed below
            found[str(file.relative_to(ROOT / "cspace"))] = len(uses)
    assert found == {name: len(headings) for name, headings in LED_TO.items()}
    headings = {
        each for several in LED_TO.values() for words in several for each in words.split(", ")
    }
    assert [words for words in headings if not has_heading(words)] == []


def test_a_refusal_leads_to_the_page_only_for_formats_that_the_page_names(tmp_path):
    for suffix in BROUGHT.split():
        assert has_heading(WORDS.get(suffix, suffix[1:])), suffix
    for suffix in (".osm", ".vtk", ".vxblx", ".blob", ""):
        with pytest.raises(InputError, match="the suffix selects the format") as refused:
            Workspace.open(tmp_path / f"scene{suffix}", spacing=0.1)
        assert not refused.value.hint


def test_an_output_is_not_taken_for_a_misspelt_input(tmp_path):
    space = build_empty((9, 9), "disc:0.1")
    (tmp_path / "corridr.ply").touch()
    for write in (space.save, space.export):
        with pytest.raises(InputError, match=r"known are \.zarr") as refused:
            write(tmp_path / "corridor.pl")
        assert "did you mean" not in str(refused.value)
    with pytest.raises(InputError, match=r"did you mean 'corridr\.ply'\?"):
        make_mesh(tmp_path / "corridor.pl")


def test_no_file_of_an_unknown_format_is_suggested(tmp_path):
    (tmp_path / "cart.csvx").touch()
    with pytest.raises(InputError) as refused:
        Robot.open(tmp_path / "cart.csv")
    assert "did you mean" not in str(refused.value)


def test_folders_pipes_and_other_objects_are_refused(tmp_path):
    (tmp_path / "folder.obj").mkdir()
    os.mkfifo(tmp_path / "pipe.obj")
    for name in ("folder.obj", "pipe.obj"):
        with pytest.raises(FileError, match="plain file"):
            Workspace.open(tmp_path / name, spacing=0.1)
    for name in (None, 7, "nul\0byte"):
        with pytest.raises(InputError, match=r"path .*name"):
            Workspace.open(name, spacing=0.1)


def test_another_folder_is_written_to_as_advised(tmp_path, monkeypatch):
    for name in ("locked", "other"):
        (tmp_path / name).mkdir()
    # The superuser may write everywhere.
    monkeypatch.setattr(os, "access", lambda path, mode: "locked" not in str(path))
    space = build_empty((4, 4), Robot.disc(0.05))
    with pytest.raises(FileError, match="outputs need a writable folder"):
        space.save(tmp_path / "locked" / "a.zarr")
    space.save(tmp_path / "other" / "a.zarr")


OTHER_FORMATS = "a.las", "a.dxf", "a.SHP", "a.svg", "a.step", "a.sdf", "a.xml", "a.fbx"


@pytest.mark.parametrize("name", OTHER_FORMATS)
def test_the_page_about_other_formats_is_named(tmp_path, name):
    (tmp_path / name).write_text("")
    for reader in (cspace.Workspace.open, cspace.Robot.open):
        options = {"spacing": 0.1} if reader == cspace.Workspace.open else {}
        with pytest.raises(InputError, match=r"suffix .*Bring your file"):
            reader(tmp_path / name, **options)
