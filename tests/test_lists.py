"""Lists in code and documentation: formats, robots, public names, the version."""

import dataclasses
import inspect
import re
import runpy
import sys
import tomllib
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any
from unittest import mock

import pytest
import yaml

import cspace
import cspace.arms
import cspace.plot
import cspace.spectral
import cspace.view
import planners
from cspace import InputError, Robot, Workspace
from cspace.files import points
from cspace.files.formats import ROBOT_FORMATS, WORKSPACE_FORMATS, read_dimension
from cspace.record.save import MAP_SUFFIXES
from tests.helpers.commands import run
from tests.helpers.repository import ROOT
from tests.soak import files as soak

DOCS = ROOT / "docs"
CODE_FOLDERS = ("cspace", "planners", "tests", "benchmarks")
SAME_CONTENT = {
    ".yml": ".yaml",
    ".json": ".geojson",
    ".jpeg": ".jpg",
    ".tiff": ".tif",
    **dict.fromkeys((".ppm", ".pbm", ".pnm"), ".pgm"),
    ".txt": ".xyz",
    "": ".zarr",
}
"""Suffixes whose files are read by the code of another suffix."""


def find_quoted(text: str) -> list[str]:
    """Return texts between single or double backticks."""
    return re.findall(r"`+([^`]+)`+", text)


def read_tables(page: str) -> list[list[str]]:
    """Return the cells of all table rows of a page."""
    lines = (DOCS / page).read_text(encoding="utf-8").splitlines()
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in lines
        if line.startswith("| ")
    ]


def robot_hint() -> str:
    """Return the hint and the rule that list all descriptions of robots."""
    with pytest.raises(InputError) as caught:
        Robot.open("nothing")
    return f"{caught.value.hint}; {caught.value.rule}"


def robot_forms() -> dict[str, str]:
    """Return the form of each short text, such as RADIUS for disc."""
    return dict(re.findall(r"(\w+):(\S+?)(?:, |$)", robot_hint()))


# ---- formats of files ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def families(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    made: dict[str, Path] = soak.write_families(tmp_path_factory.mktemp("families"))
    return made


def test_every_reader_of_points_has_a_format() -> None:
    by_points = {
        suffix for suffix, known in WORKSPACE_FORMATS.items() if known.method == "from_points"
    }
    assert by_points | {".npy", ".ply"} == set(points.CLOUD_READERS)


def test_every_format_is_in_the_docs() -> None:
    documented = {}
    for first, _, dimension, *_ in (
        row
        for row in read_tables("reference/files.md")
        if row[0].startswith("`.") and len(row) == 3
    ):
        documented |= dict.fromkeys(
            find_quoted(first), {"plane": 2, "space": 3, "either": None}[dimension]
        )
    assert documented == {suffix: known.dimension for suffix, known in WORKSPACE_FORMATS.items()}


def test_every_format_has_a_family_of_damaged_files(families: dict[str, Path]) -> None:
    suffixes = {Path(name).suffix for name in families}
    read = {*WORKSPACE_FORMATS, *ROBOT_FORMATS, *MAP_SUFFIXES}
    assert {SAME_CONTENT.get(suffix, suffix) for suffix in read} <= suffixes


def test_the_dimension_of_every_format_matches_its_workspace(families: dict[str, Path]) -> None:
    for name, path in families.items():
        opened: Any = soak.open_file(path)
        if isinstance(opened, Workspace):
            assert read_dimension(path) == opened.grid.dim, name


# ---- robots --------------------------------------------------------------------------------------


def test_every_short_text_of_a_robot_is_documented() -> None:
    forms = robot_forms()
    assert "disc" in forms
    texts = {f"{kind}:{form}" for kind, form in forms.items()}
    assert texts <= set(find_quoted(str(Robot.parse.__doc__)))
    assert texts <= set(find_quoted((DOCS / "reference" / "cli.md").read_text(encoding="utf-8")))
    described = re.sub(r"[^\w:]+", " ", run("map", "--help").output)
    assert [kind for kind in forms if f"{kind}:" not in described] == []
    examples = {
        text
        for row in read_tables("reference/robots.md")
        for text in find_quoted(row[0])
        if text.partition(":")[0] in forms
    }
    assert {text.partition(":")[0] for text in examples} == set(forms)
    for text in examples - {"footprint:[[0.3,0.2],...]", "footprint:robot.urdf"}:
        assert isinstance(Robot.parse(text), Robot)


def test_every_file_of_a_robot_is_documented() -> None:
    page = " ".join(find_quoted((DOCS / "reference" / "robots.md").read_text(encoding="utf-8")))
    assert [suffix for suffix in set(ROBOT_FORMATS) - {".yml"} if suffix not in page] == []


# ---- the features table --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def conf() -> dict[str, Any]:
    """Run the configuration of the documentation without Sphinx."""
    gallery = {
        name: mock.MagicMock(ModuleType) for name in ("sphinx_gallery", "sphinx_gallery.scrapers")
    }
    gallery["sphinx_gallery.sorting"] = mock.MagicMock()
    gallery["sphinx_gallery.scrapers"].figure_rst = None
    with mock.patch.dict(sys.modules, gallery):
        return runpy.run_path(str(DOCS / "conf.py"))


def features() -> list[list[str]]:
    """Return the names in each row of the features tables, except commands."""
    pages = "reference/features.md", "reference/features_planning.md"
    cells = [row[0] for page in pages for row in read_tables(page)]
    return [
        find_quoted(cell)
        for cell in cells
        if cell.startswith("`") and not cell.startswith("`cspace ")
    ]


def test_every_name_of_the_features_table_is_public(conf: dict[str, Any]) -> None:
    for names in features():
        before = ""
        for name in names:
            before = conf["full_name"](name, before)


def test_every_public_function_is_in_the_features_table(conf: dict[str, Any]) -> None:
    # Methods that the API leaves out are not public; records and errors are no features.
    known = {word for names in features() for name in names for word in re.findall(r"\w+", name)}
    classes = [conf["find"](name) for name in {*conf["OBJECTS"].values(), "cspace.TiledCSpace"}]
    missing = []
    for module in (cspace, planners):
        for name in module.__all__:
            value = getattr(module, name)
            is_record = inspect.isclass(value) and (
                dataclasses.is_dataclass(value) or issubclass(value, tuple | Warning | Exception)
            )
            if callable(value) and not is_record and value not in classes and name not in known:
                missing.append(f"{module.__name__}.{name}")
    for kind in classes:
        inside = re.split(", ?", conf["autosummary_context"]["inside"].get(kind.__name__, ""))
        for name, value in inspect.getmembers(kind, callable):
            if (
                not name.startswith("_")
                and not inspect.isclass(value)
                and name not in {*known, *inside}
            ):
                missing.append(f"{kind.__name__}.{name}")
    assert missing == []


# ---- the API page --------------------------------------------------------------------------------

PUBLIC_PACKAGES = (cspace, cspace.arms, cspace.plot, cspace.spectral, cspace.view, planners)


def shown_in_api() -> dict[str, object]:
    """Return the objects of the API page by full name."""
    package, shown = "", {}
    for line in (DOCS / "api.md").read_text(encoding="utf-8").splitlines():
        if line.startswith(".. currentmodule:: "):
            package = line.split()[-1]
        elif re.fullmatch(r"   \w[\w.]*", line):
            module, _, name = f"{package}.{line.strip()}".rpartition(".")
            shown[f"{module}.{name}"] = getattr(import_module(module), name)
    return shown


@pytest.mark.parametrize("package", PUBLIC_PACKAGES, ids=lambda package: package.__name__)
def test_api_page_shows_every_public_name(package: Any) -> None:
    shown = list(shown_in_api().values())
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    missing = [
        name
        for name in package.__all__
        if not isinstance(getattr(package, name), ModuleType)  # the page shows its names
        and not any(getattr(package, name) is value for value in shown)
        and f"`{package.__name__}.{name}`" not in text
    ]
    assert missing == []


def test_api_page_shows_public_names_only() -> None:
    public = {package.__name__: set(package.__all__) for package in PUBLIC_PACKAGES}
    for full in shown_in_api():
        package, _, name = full.rpartition(".")
        assert not name.startswith("_") and name in public.get(package, {name}), full


def test_api_pages_show_every_public_method_of_a_class(conf: dict[str, Any]) -> None:
    # Sphinx lists public methods with docstrings, except those left out by docs/conf.py.
    inside: dict[str, str] = conf["autosummary_context"]["inside"]
    left_out = {f"{kind}.{name}" for kind, names in inside.items() for name in names.split(", ")}
    methods = FunctionType, property, classmethod, staticmethod, cached_property
    undocumented = []
    for kind in shown_in_api().values():
        for base in kind.__mro__ if inspect.isclass(kind) else ():
            if base.__module__.split(".")[0] in ("cspace", "planners"):
                left_out -= {f"{kind.__name__}.{name}" for name in vars(base)}
                public = {
                    name: value for name, value in vars(base).items() if not name.startswith("_")
                }
                undocumented += [
                    f"{base.__name__}.{name}"
                    for name, value in public.items()
                    if isinstance(value, methods) and not inspect.getdoc(value)
                ]
    assert undocumented == []
    assert left_out == set(), "docs/conf.py leaves out methods that do not exist"


# ---- the page for contributors -------------------------------------------------------------------


def test_files_and_names_of_the_extending_page_exist() -> None:
    named = set(find_quoted((DOCS / "extending.md").read_text(encoding="utf-8")))
    files = {name for name in named if re.fullmatch(r"[\w.]+/[\w./]*", name)}
    assert {name for name in files if not (ROOT / name).exists()} == set()
    code = [
        file.read_text(encoding="utf-8")
        for folder in CODE_FOLDERS
        for file in (ROOT / folder).rglob("*.py")
    ]
    words = {word for text in code for word in re.findall(r"\w+", text)}
    names = {
        word
        for name in named
        if re.fullmatch(r"[A-Za-z_]\w*(\.\w+)*", name)
        for word in name.split(".")
    }
    assert names - words == set()


# ---- the version ---------------------------------------------------------------------------------


def test_version_is_the_same_in_every_file() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    newest = re.search(
        r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert newest is not None
    assert cspace.__version__ == project["version"] == citation["version"] == newest[1]
