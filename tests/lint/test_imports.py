"""Order of imports: acyclic, and from upper to lower packages only."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from typing import NamedTuple

import pytest

from tests.helpers.repository import SOURCES

ORDER = [
    "cspace cspace.ros",  # the public names
    "cspace.__main__ cspace._cli",
    "cspace.view",
    "planners",
    "cspace.reasons",
    "cspace.plot",
    "cspace.arms",
    "cspace.spectral",
    "cspace._builder cspace._opening",
    "cspace._tiles",
    "cspace.export",
    "cspace._space",
    "cspace._maps",
    "cspace._interface",
    "cspace._exact",
    "cspace._bodies",
    "cspace._queries",
    "cspace._record",
    "cspace._engines",
    "cspace._robot cspace._workspace cspace._obstacles",
    "cspace._shapes",
    "cspace._raster",
    "cspace._rotations",
    "cspace._files",
    "cspace._limits",
    "cspace._grid",
    "cspace._support cspace.errors",
]
"""Rooms from top to bottom: folders or modules; rooms on one line may import each other."""

ROOM_LEVELS = {room: level for level, rooms in enumerate(ORDER) for room in rooms.split()}

UPWARD_METHODS = {
    *("plot", "view", "explain", "removals"),
    *("export", "to_xarray", "to_occupancy_grid", "to_costmap"),
}
"""The methods of classes whose bodies may import upper rooms: one import and one call."""

WINGS = "cspace.arms cspace._cli cspace.export cspace.plot cspace.reasons cspace.spectral cspace._tiles cspace.view"
"""Folders that a plan does not load."""


class Import(NamedTuple):
    """An import statement of one module by another, anywhere in a file."""

    module: str
    line: int
    imported: str


def room(module):
    """Return the folder or module of the order that contains a module."""
    return (
        module.partition(".")[0]
        if module.startswith("planners")
        else ".".join(module.split(".")[:2])
    )


def walk(node):
    """Yield the nodes of a module, except imports for type checkers and upward methods."""
    for child in ast.iter_child_nodes(node):
        is_for_types = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
        is_method = isinstance(node, ast.ClassDef) and isinstance(child, ast.FunctionDef)
        if not is_for_types and not (is_method and child.name in UPWARD_METHODS):
            yield child
            yield from walk(child)


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
                inner = f"{node.module}.{alias.name}"
                imported = inner if inner in SOURCES else str(node.module)
                if imported in SOURCES:
                    yield Import(module, node.lineno, imported)


def test_imports_are_acyclic():
    graph = {module: {other.imported for other in imports(module)} - {module} for module in SOURCES}
    assert len(list(TopologicalSorter(graph).static_order())) == len(SOURCES)


def test_each_package_has_one_position_in_the_order():
    assert {room(module) for module in SOURCES} == ROOM_LEVELS.keys()
    assert len(ROOM_LEVELS) == sum(len(rooms.split()) for rooms in ORDER)


def test_imports_between_packages_point_down():
    upward = [
        found
        for module in SOURCES
        for found in imports(module)
        if ROOM_LEVELS[room(found.imported)] < ROOM_LEVELS[room(module)]
    ]
    assert not upward, "\n".join(
        f"{SOURCES[i.module]}:{i.line} imports {i.imported}" for i in upward
    )


def test_upward_methods_hold_one_import_and_one_statement():
    for module in ("_space", "_maps", "_workspace", "_interface", "arms._space"):
        path = SOURCES[f"cspace.{module}"]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and node.name in UPWARD_METHODS:
                _, *statements = map(type, node.body)  # the first one is the docstring
                assert statements[0] == ast.ImportFrom and len(statements) == 2, node.name


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
    for package in ("arms", "plot", "spectral", "view"):
        run_python(f"""
import cspace
assert all(hasattr(cspace.{package}, name) for name in cspace.{package}.__all__)
""")


@pytest.mark.parametrize("yaw", [False, True])
def test_a_plan_loads_no_wing(yaw):
    run_python(f"""
import sys, numpy as np, cspace, planners
workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
space = cspace.build(workspace, "rect:0.4x0.2", rotations={8 if yaw else None})
assert planners.plan(space, (1, 1{", 0" * yaw}), (3, 2{", 1" * yaw})).certified
wings = {{name for name in sys.modules if name.startswith({tuple(WINGS.split())})}}
assert not wings, wings
""")
