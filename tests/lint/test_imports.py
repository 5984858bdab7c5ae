"""Order of imports: acyclic, and from upper to lower packages only."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from typing import NamedTuple

from tests.helpers.repository import SOURCES

ORDER = [
    "cspace",  # the public names
    "cspace.__main__ cspace.cli",
    "cspace.view",
    "planners",
    "cspace.reasons",
    "cspace.plot",
    "cspace.arms",
    "cspace.spectral",
    "cspace.builder cspace.opening",
    "cspace.tiles",
    "cspace.export",
    "cspace.space",
    "cspace.maps",
    "cspace.interface",
    "cspace.exact",
    "cspace.bodies",
    "cspace.queries",
    "cspace.record",
    "cspace.engines",
    "cspace.robot cspace.workspace cspace.obstacles",
    "cspace.methods",
    "cspace.shapes",
    "cspace.raster",
    "cspace.rotations",
    "cspace.files",
    "cspace.limits",
    "cspace.grid",
    "cspace.support cspace.errors",
]
"""Rooms from top to bottom: folders or modules; rooms on one line may import each other."""

ROOM_LEVELS = {room: level for level, rooms in enumerate(ORDER) for room in rooms.split()}

EXCEPTION = "cspace.methods"
"""The only module whose functions import upper rooms: ``plot``, ``view``, ``explain`` and
``export``."""


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


def imports(module):
    """Yield all imports of a module, also for type checkers, except those of the exception."""
    if module == EXCEPTION:
        return
    for node in ast.walk(ast.parse(SOURCES[module].read_text(encoding="utf-8"))):
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


def test_only_methods_of_the_exception_import_upper_packages():
    """Its module level has imports for type checkers only, so that it is light."""
    tree = ast.parse(SOURCES[EXCEPTION].read_text(encoding="utf-8"))
    plain = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    assert not [
        node for node in plain if ast.unparse(node).startswith(("from cspace", "import cspace"))
    ]


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
