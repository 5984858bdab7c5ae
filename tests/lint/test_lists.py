"""Lists in code and documentation: formats, robots, public names, the version."""

import inspect
import re
import runpy
import tomllib
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType

import pytest
import yaml

import cspace
import planners
from cspace import InputError, Robot, Workspace
from cspace._files import point_clouds
from cspace._files.formats import ROBOT_FORMATS, WORKSPACE_FORMATS
from cspace._record.save import MapFolder
from cspace._shapes import primitives
from cspace._shapes.primitives import SHORTHANDS
from tests.fuzz import files as fuzz
from tests.helpers.commands import run
from tests.helpers.repository import ROOT, SOURCES
from tests.laws.test_laws import BATCH_QUERIES

DOCS = ROOT / "docs"
LISTS = runpy.run_path(str(DOCS / "lists.py"))
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


def robot_hint():
    """Return the hint and the rule that list all descriptions of robots."""
    with pytest.raises(InputError) as caught:
        Robot.open("nothing")
    return f"{caught.value.hint}; {caught.value.rule}"


# ---- formats of files ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def families(tmp_path_factory):
    return fuzz.write_families(tmp_path_factory.mktemp("families"))


def test_every_reader_of_points_has_a_format():
    by_points = {
        suffix for suffix, known in WORKSPACE_FORMATS.items() if known.method == "from_points"
    }
    assert by_points | {".npy", ".ply"} == set(point_clouds.CLOUD_READERS)


def test_every_reader_of_a_file_has_a_format():
    readers = {
        name
        for name, method in inspect.getmembers(Workspace, inspect.ismethod)
        if "from_" in name and "path" in inspect.signature(method).parameters
    }
    methods = {known.method for known in WORKSPACE_FORMATS.values()}
    assert readers - {"from_moveit_scene"} <= methods  # scenes are YAML, as ROS maps are


def test_every_format_has_a_family_of_damaged_files(families):
    suffixes = {Path(name).suffix for name in families}
    read = {*WORKSPACE_FORMATS, *ROBOT_FORMATS, *MapFolder.SUFFIXES}
    assert {SAME_CONTENT.get(suffix, suffix) for suffix in read} <= suffixes


def test_the_dimension_of_every_format_matches_its_workspace(families):
    for name, path in families.items():
        opened = fuzz.open_file(path)
        if isinstance(opened, Workspace):
            declared = WORKSPACE_FORMATS[path.suffix].dimension
            assert declared in (None, opened.grid.dim), name


# ---- robots --------------------------------------------------------------------------------------


def test_every_primitive_has_a_shorthand():
    made = {
        name
        for name, function in inspect.getmembers(primitives, inspect.isfunction)
        if not name.startswith("_")
        and inspect.signature(function).return_annotation == "NamedShape"
    }
    texts = {{"rect": "rectangle"}.get(name, name) for name in SHORTHANDS}
    assert made - {"parse_shorthand"} == texts


@pytest.mark.parametrize("name", SHORTHANDS)
def test_every_shorthand_is_parsed_and_listed_in_messages(name):
    kind = SHORTHANDS[name]
    assert kind.example.startswith(f"{name}:")
    assert Robot.parse(kind.example).dim == kind.dimension
    assert f"{name}:{kind.form}" in robot_hint()
    assert f"{name}:{kind.form}" in run("build", "flat.geojson", "--robot", "help").stderr


# ---- queries -------------------------------------------------------------------------------------


def test_every_query_of_batches_obeys_the_laws_and_answers_a_question():
    queries = {
        name
        for name, value in inspect.getmembers(cspace.CSpace, inspect.isfunction)
        if not name.startswith("_")
        and [*inspect.signature(value).parameters][1:2] in (["q"], ["q0"])
        and " | " in str(inspect.signature(value).return_annotation)
        and name != "path_exists"  # planners call it with one pair
    }
    assert queries == set(BATCH_QUERIES)
    page = (DOCS / "howto" / "which_query.md").read_text(encoding="utf-8")
    assert [name for name in queries if f"space.{name}(" not in page] == []
    tests = "".join(
        file.read_text(encoding="utf-8") for file in (ROOT / "tests/queries").glob("*.py")
    )
    assert [name for name in queries if f".{name}(" not in tests] == []


# ---- generated lists -----------------------------------------------------------------------------


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda page: page.stem)
def test_the_lists_of_a_page_are_those_of_the_code(page):
    text = page.read_text(encoding="utf-8")
    assert LISTS["fill"](text) == text, "run python docs/lists.py"


def test_every_list_and_reader_is_on_a_page():
    pages = [page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md")]
    found = {name for text in pages for name in re.findall("<!-- list: (.+?) -->", text)}
    readers = {name for name in found if name.startswith("py")}
    assert found - readers == LISTS["LISTS"].keys()
    shown = [re.search(r" of (\w+): ", name)[1] for name in readers]
    assert sorted(shown) == sorted(file.stem for file in LISTS["READERS"].glob("*.py"))


# ---- the API page --------------------------------------------------------------------------------

PUBLIC_MODULES = (
    *(cspace, cspace.arms, cspace.errors, cspace.lanes, cspace.plot),
    *(cspace.reasons, cspace.regions, cspace.ros, cspace.spectral, cspace.view, planners),
)


def test_modules_without_underscore_are_on_the_api_page():
    public = {name for name in SOURCES if not re.search(r"\b_", name)}
    shown = {module.__name__ for module in PUBLIC_MODULES}
    # The inner door has a page of its own, and others between wings a sentence in "Extending".
    # Methods of maps call exports.
    doors = {"cspace.inside", "planners.inside", "cspace.plot.scene"}
    assert public == shown | doors | {"cspace.export"}


def shown_in_api():
    """Return the objects of the API page by full name."""
    package, shown = "", {}
    for line in (DOCS / "api.md").read_text(encoding="utf-8").splitlines():
        if line.startswith(".. currentmodule:: "):
            package = line.split()[-1]
        elif re.fullmatch(r"   \w[\w.]*", line):
            module, _, name = f"{package}.{line.strip()}".rpartition(".")
            shown[f"{module}.{name}"] = getattr(import_module(module), name)
    return shown


@pytest.mark.parametrize("package", PUBLIC_MODULES, ids=lambda package: package.__name__)
def test_api_page_shows_every_public_name(package):
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


def test_api_page_shows_public_names_only():
    public = {package.__name__: set(package.__all__) for package in PUBLIC_MODULES}
    for full in shown_in_api():
        package, _, name = full.rpartition(".")
        assert not name.startswith("_") and name in public.get(package, {name}), full


def test_api_pages_show_every_public_method_of_a_class():
    # Sphinx lists public methods with docstrings.
    methods = FunctionType, property, classmethod, staticmethod, cached_property
    undocumented = []
    for kind in shown_in_api().values():
        if not inspect.isclass(kind):
            continue
        for base in kind.__mro__:
            if base.__module__.split(".")[0] in ("cspace", "planners"):
                public = {
                    name: value for name, value in vars(base).items() if not name.startswith("_")
                }
                undocumented += [
                    f"{base.__name__}.{name}"
                    for name, value in public.items()
                    if isinstance(value, methods) and not inspect.getdoc(value)
                ]
    assert undocumented == []


# ---- the version ---------------------------------------------------------------------------------


def test_version_is_the_same_in_every_file():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    newest = re.search(
        r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert newest is not None
    assert cspace.__version__ == project["version"] == citation["version"] == newest[1]
    debian = (ROOT / "debian/changelog").read_text(encoding="utf-8")
    assert debian.startswith(f"cspace ({newest[1].replace('rc', '~rc')}) ")
