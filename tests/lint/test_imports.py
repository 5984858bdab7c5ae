"""Imports: without circles, and no wing is loaded with the core."""

import ast
import re
import subprocess
import sys
from collections import Counter
from graphlib import TopologicalSorter
from typing import NamedTuple

import pytest

import cspace
from cspace.errors import InputError
from tests.helpers.repository import ROOT, SOURCES
from tests.lint.test_wings import DOCS, WINGS

UPWARD_METHODS = {"from_urdf", "from_moveit_scene"}
"""Methods of classes that let a wing read a file: one import and one call."""

HANDED_UP = {("_builder", "_tiles/")}
"""Imports of a row above: `build` and `open` hand large maps over."""


class Import(NamedTuple):
    """An import statement of one module by another, anywhere in a file."""

    module: str
    line: int
    imported: str


def walk(node):
    """Yield the nodes of a module, except imports for type checkers and upward methods."""
    for child in ast.iter_child_nodes(node):
        is_for_types = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
        is_method = isinstance(node, ast.ClassDef) and isinstance(child, ast.FunctionDef)
        if not is_for_types and not (is_method and child.name in UPWARD_METHODS):
            yield child
            yield from walk(child)


def read_stub(path):
    """Return the module of each name in a stub of public names."""
    lines = re.findall(r"^from \.(\S+) import (\w+) as", path.read_text("utf-8"), re.MULTILINE)
    return {name: f"{path.parent.name}.{module}" for module, name in lines}


DOORS = {
    "cspace": read_stub(ROOT / "cspace/__init__.pyi"),
    "cspace.inside": read_stub(ROOT / "cspace/inside.pyi"),
    "planners.inside": read_stub(ROOT / "planners/inside.pyi"),
}
"""Modules that import each of their names at its first use, from another module."""


def imports(module):
    """Yield all imports of a module, except those of its upward methods."""
    for node in walk(ast.parse(SOURCES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (
                Import(module, node.lineno, alias.name)
                for alias in node.names
                if alias.name in SOURCES
            )
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{module} imports by a relative name"
            for alias in node.names:
                if alias.name == "__version__":
                    continue
                source = DOORS.get(node.module, {}).get(alias.name, node.module)
                inner = f"{source}.{alias.name}"
                imported = inner if inner in SOURCES else str(source)
                if imported in SOURCES:
                    yield Import(module, node.lineno, imported)


def test_imports_are_acyclic():
    graph = {module: {other.imported for other in imports(module)} - {module} for module in SOURCES}
    assert len(list(TopologicalSorter(graph).static_order())) == len(SOURCES)


def test_a_row_of_the_architecture_imports_only_rows_below_and_the_core():
    page = (DOCS / "explanation/architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.+?) \|", page, re.MULTILINE)
    order = {part: row for row, cell in enumerate(rows) for part in re.findall("`(.+?)`", cell)}

    def part_of(module):
        package, *rest = module.split(".")
        names = ["planners"] if package == "planners" else rest[:1] or ["__init__"]
        return next(name for name in (names[0], f"{names[0]}/") if name in order)

    pairs = {
        (part_of(module), part_of(other.imported))
        for module in SOURCES
        for other in imports(module)
    }
    upward = {pair for pair in pairs if order[pair[0]] > order[pair[1]] and pair[1] != "__init__"}
    assert upward == HANDED_UP


def test_files_and_classes_have_names_of_their_own():
    # Each of the two packages has an inner door.
    paths = [path for name, path in SOURCES.items() if name != "planners.inside"]
    files = [path.stem.lstrip("_") for path in paths if path.stem[:2] != "__"]
    classes = [
        node.name
        for path in SOURCES.values()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    ]
    counts = Counter(files) | Counter(classes)
    assert [name for name, count in counts.items() if count > 1] == []


OUTSIDE = ("planners", *(f"cspace.{wing}" for wing in WINGS))
"""Packages and folders beside the core."""

CORE_FILES = [path for name, path in SOURCES.items() if not name.startswith(OUTSIDE)]
"""Files of the core."""


def test_upward_methods_hold_one_import_and_one_statement():
    methods = [
        node
        for path in CORE_FILES
        for owner in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(owner, ast.ClassDef)
        for node in owner.body
        if isinstance(node, ast.FunctionDef) and node.name in UPWARD_METHODS
    ]
    assert {method.name for method in methods} == UPWARD_METHODS
    for method in methods:
        _, *statements = map(type, method.body)  # the first one is the docstring
        assert statements == [ast.ImportFrom, statements[-1]], method.name


def test_each_function_of_the_outer_door_is_a_method_of_a_class_of_the_core():
    taken = {
        (node.targets[0].id, node.value.attr)
        for path in CORE_FILES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("_outside.")
    }
    assert taken == {(name, name) for name in read_stub(ROOT / "cspace/_outside.pyi")}
    space = cspace.build(cspace.Workspace.from_array([[False]], 1.0), "disc:0.2")
    for _, name in taken:
        method = getattr(space, name)
        assert method.__self__ is space and method.__doc__ == getattr(cspace.CSpace, name).__doc__


def test_a_method_of_a_wing_checks_names_and_truth_values_of_options():
    space = cspace.build(cspace.Workspace.from_array([[False]], 1.0), "disc:0.2")
    with pytest.raises(
        TypeError, match=r"explain\(\) has no option 'refin'; did you mean 'refine'"
    ):
        space.explain((0.05, 0.05), (0.05, 0.05), refin=True)
    with pytest.raises(InputError, match="overwrite is 1; it must be True or False"):
        space.export("map.npz", overwrite=1)


def run_python(code):
    """Run code in a new interpreter."""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_public_names_are_imported_at_their_first_use():
    run_python("""
import sys, cspace
assert "numpy" not in sys.modules, "import cspace is not light"
assert cspace.open is cspace.open and len(cspace.__all__) == len(set(cspace.__all__))
assert all(hasattr(cspace, name) for name in cspace.__all__) and not hasattr(cspace, "nothing")
""")


def test_names_of_subpackages_need_no_import_of_their_own():
    for package in ("arms", "plot", "regions", "spectral", "view"):
        run_python(f"""
import cspace
assert all(hasattr(cspace.{package}, name) for name in cspace.{package}.__all__)
""")


UNUSED_IN_THE_PLANE = {
    *("cspace._shapes.mesh", "cspace._shapes.bodies", "cspace._files.zarr_folders"),
    *("cspace._files.lazy_arrays", "cspace._files.rasters", "cspace._files.plain"),
}
"""Modules that a map of an array in the plane, and a plan there, do not need."""


def test_a_plan_in_the_plane_loads_no_mesh_and_no_reader():
    run_python(f"""
import sys, numpy as np, cspace, planners
workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
assert planners.plan(cspace.build(workspace, "disc:0.2"), (1, 1), (3, 2)).certified
assert not {UNUSED_IN_THE_PLANE} & sys.modules.keys(), {UNUSED_IN_THE_PLANE} & sys.modules.keys()
""")


@pytest.mark.parametrize("yaw", [False, True])
def test_a_plan_loads_no_wing(yaw):
    wings = tuple(f"cspace.{wing}" for wing in WINGS)
    run_python(f"""
import sys, numpy as np, cspace, planners
workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
space = cspace.build(workspace, "rect:0.4x0.2", rotations={8 if yaw else None})
assert planners.plan(space, (1, 1{", 0" * yaw}), (3, 2{", 1" * yaw})).certified
wings = {{name for name in sys.modules if name.startswith({wings})}}
assert not wings, wings
""")
