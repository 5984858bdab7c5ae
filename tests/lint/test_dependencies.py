"""Declarations of imported packages in pyproject.toml."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions

import pytest
from packaging.requirements import Requirement

from tests.helpers.repository import ROOT, SOURCES

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
REQUIREMENTS = [text for texts in (PROJECT["dependencies"], *EXTRAS.values()) for text in texts]


def normalize(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def distributions(texts):
    """Return the names of required distributions, extras such as `dask[distributed]` included."""
    requirements = [Requirement(text) for text in texts]
    return {normalize(name) for found in requirements for name in (found.name, *found.extras)}


def walk_runtime(node):
    """Yield all nodes except those under `if TYPE_CHECKING:`."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from walk_runtime(child)


def imported_packages(tree):
    """Return the packages that code imports, except Python's and ours."""
    names = set()
    for node in walk_runtime(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(str(node.module))
    tops = {name.partition(".")[0] for name in names}
    return tops - sys.stdlib_module_names - {"cspace", "planners"}


def optional_packages(tree):
    """Return the extra of each package imported with `import_optional(package, use, extra)`."""
    calls = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "import_optional"
    ]
    return {ast.literal_eval(call.args[0]): ast.literal_eval(call.args[2]) for call in calls}


def test_every_imported_package_is_declared():
    installed, required = packages_distributions(), distributions(PROJECT["dependencies"])
    undeclared = []
    for file in SOURCES.values():
        tree = ast.parse(file.read_text(encoding="utf-8"))
        extras = set(optional_packages(tree).values())
        declared = required | distributions([text for extra in extras for text in EXTRAS[extra]])
        undeclared += [
            f"{file.relative_to(ROOT)} imports {package}"
            for package in imported_packages(tree)
            if declared.isdisjoint(map(normalize, installed.get(package, [package])))
        ]
    assert not undeclared


def test_extras_contain_the_packages_that_code_imports():
    for file in SOURCES.values():
        for package, extra in optional_packages(
            ast.parse(file.read_text(encoding="utf-8"))
        ).items():
            assert normalize(package) in distributions(EXTRAS[extra]), (
                f"{file.name}: {package}, {extra}"
            )


def test_every_required_package_is_imported():
    sources = [file.read_text(encoding="utf-8") for file in SOURCES.values()]
    packages = set().union(*(imported_packages(ast.parse(source)) for source in sources))
    installed = packages_distributions()
    imported = {normalize(name) for package in packages for name in installed[package]}
    assert distributions(PROJECT["dependencies"]) <= imported


@pytest.mark.parametrize(
    "system, python, is_required",
    [
        ("linux", "3.13", True),
        ("darwin", "3.11", True),
        ("linux", "3.14", False),
        ("win32", "3.12", False),
    ],
)
def test_ompl_is_required_where_it_has_wheels(system, python, is_required):
    (ompl,) = (needed for needed in map(Requirement, REQUIREMENTS) if needed.name == "ompl")
    environment = {"sys_platform": system, "python_version": python}
    assert ompl.marker.evaluate(environment) is is_required


@pytest.mark.parametrize("text", REQUIREMENTS)
def test_every_dependency_has_a_lower_and_an_upper_bound(text):
    requirement = Requirement(text)
    operators = {bound.operator for bound in requirement.specifier}
    assert requirement.name == "cspace" or operators == {">=", "<"}


# ---- pinned releases ---------------------------------------------------------------------------

PINS = [
    Requirement(line)
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
]

MACHINES = ["linux aarch64", "linux x86_64", "darwin arm64", "darwin x86_64"]
"""Values of sys_platform and platform_machine, as markers name them."""


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_constraints_pin_every_dependency_within_its_bounds(python, machine):
    system, processor = machine.split()
    environment = {"sys_platform": system, "platform_machine": processor}
    environment |= {"python_version": python, "python_full_version": f"{python}.9"}
    chosen = [pin for pin in PINS if pin.marker is None or pin.marker.evaluate(environment)]
    pins = {normalize(pin.name): str(pin.specifier).removeprefix("==") for pin in chosen}
    assert len(pins) == len(chosen)
    for requirement in map(Requirement, REQUIREMENTS):
        is_needed = requirement.marker is None or requirement.marker.evaluate(environment)
        if is_needed and requirement.name != "cspace":
            assert pins[normalize(requirement.name)] in requirement.specifier, requirement
