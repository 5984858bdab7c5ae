"""Imports: without circles, and no wing is loaded with the core."""

import ast
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from graphlib import TopologicalSorter
from typing import NamedTuple

import pytest

import cspace
from cspace.errors import InputError
from tests.helpers.repository import ROOT, SOURCES, name_module
from tests.lint.test_wings import DOCS, WINGS

UPWARD = {
    ("_builder", "_tiles/"),
    ("_configuration_map", "plot/"),
    ("_configuration_map", "regions/"),
    ("_files/", "arms/"),
    ("_interface", "view/"),
    ("_space", "export/"),
    ("_space", "reasons/"),
    ("_workspace", "plot/"),
}
"""Parts of the core that call a wing by the outer door. There only ever get fewer."""

MOST_FILES_IN_A_CIRCLE = 79
"""Files that reach each other by imports, if calls by the outer door count. It only ever falls."""


class Import(NamedTuple):
    """An import of one module by another, anywhere in a file, or the use of a name of a door."""

    module: str
    line: int
    imported: str
    by_outer_door: bool


def walk(node):
    """Yield the nodes of a module, except imports for type checkers."""
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield child
            yield from walk(child)


def read_stub(path):
    """Return the module of each name in a stub."""
    package = ".".join(path.parent.relative_to(ROOT).parts)
    lines = re.findall(r"^from \.(\S*) import (\w+) as", path.read_text("utf-8"), re.MULTILINE)
    return {name: f"{package}.{module}".rstrip(".") for module, name in lines}


DOORS = {
    name_module(path): read_stub(path)
    for package in ("cspace", "planners")
    for path in (ROOT / package).rglob("*.pyi")
}
"""Modules that import each of their names at its first use, from another module."""

OUTER_DOOR = "cspace._outside"
"""The door by which the core calls wings."""


def find_home(module, name):
    """Return the module that holds a name, itself or through doors, or None if it is not ours."""
    home = DOORS.get(module, {}).get(name, module)
    if f"{home}.{name}" in SOURCES:
        return f"{home}.{name}"
    if home != module:
        return find_home(home, name)
    return home if home in SOURCES else None


@cache
def list_imports(module):
    """List the imports of a module, and its uses of names of doors."""
    found = []
    names = {}  # what a name of the file stands for
    nodes = list(walk(ast.parse(SOURCES[module].read_text(encoding="utf-8"))))
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.asname or alias.name: alias.name for alias in node.names}
            found += [(node.lineno, alias.name, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{module} imports by a relative name"
            source = node.module
            names |= {each.asname or each.name: f"{source}.{each.name}" for each in node.names}
            homes = [find_home(source, each.name) for each in node.names]
            found += [(node.lineno, home, source) for home in homes]
    for node in nodes:
        if isinstance(node, ast.Attribute):
            door = names.get(ast.unparse(node.value))
            if door in DOORS:
                found.append((node.lineno, find_home(door, node.attr), door))
    return [
        Import(module, line, home, door == OUTER_DOOR and home != OUTER_DOOR)
        for line, home, door in found
        if home in SOURCES
    ]


def draw_arrows(by_outer_door):
    """Return what each module imports, with or without calls by the outer door.

    A door that is passed is no module of its own.
    """
    return {
        module: {
            each.imported
            for each in list_imports(module)
            if by_outer_door or not each.by_outer_door
        }
        - {module, *DOORS}
        for module in SOURCES
    }


def test_imports_are_acyclic():
    assert len(list(TopologicalSorter(draw_arrows(False)).static_order())) == len(SOURCES)


def test_few_files_reach_each_other_if_the_outer_door_counts():
    arrows = draw_arrows(True)
    reached = {}
    for module in SOURCES:
        reached[module] = set()
        pending = [module]
        while pending:
            new = arrows[pending.pop()] - reached[module]
            reached[module] |= new
            pending += new
    circles = [[each for each in reached[module] if module in reached[each]] for module in SOURCES]
    assert len(max(circles, key=len)) <= MOST_FILES_IN_A_CIRCLE, sorted(max(circles, key=len))


def test_rows_of_the_architecture_import_rows_below_except_by_the_outer_door():
    page = (DOCS / "explanation/architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.+?) \|", page, re.MULTILINE)
    order = {part: row for row, cell in enumerate(rows) for part in re.findall("`(.+?)`", cell)}

    def part_of(module):
        package, *rest = module.split(".")
        names = ["planners"] if package == "planners" else rest[:1] or ["__init__"]
        return next(name for name in (names[0], f"{names[0]}/") if name in order)

    arrows = {
        (part_of(module), part_of(each.imported), each.by_outer_door)
        for module in SOURCES
        for each in list_imports(module)
        if each.imported not in DOORS
    }
    assert {(first, last) for first, last, by_door in arrows if by_door} == UPWARD
    assert not [arrow for arrow in arrows if order[arrow[0]] > order[arrow[1]] and not arrow[2]]


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


def test_each_function_of_the_outer_door_is_used_and_methods_are_documented():
    space = cspace.build(cspace.Workspace.from_array([[False]], 1.0), "disc:0.2")
    used = set()
    for path in CORE_FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "_outside":
                used.add(node.attr)
    assert used == set(DOORS[OUTER_DOOR])
    methods = [name for name in used if hasattr(space, name)]
    assert len(methods) > 8
    for name in methods:
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


@pytest.mark.thorough
def test_threads_ask_for_all_names_at_once():
    run_python("""
import threading, cspace, planners
failed = []
names = [(door, name) for door in (cspace, planners) for name in door.__all__]
together = threading.Barrier(len(names))
def ask(door, name):
    together.wait()
    try:
        getattr(door, name)
    except BaseException as error:
        failed.append((name, repr(error)))
threads = [threading.Thread(target=ask, args=pair) for pair in names]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
assert not failed, failed
""")


DOOR_FILES = {
    "events.py": "from threading import Event\nbegan, asked = Event(), Event()\n",
    "door/__init__.py": """
from cspace._support import attach_stub
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
""",
    "door/__init__.pyi": "from ._one import one as one\nfrom ._two import two as two\n",
    "door/_one.py": "import events\nevents.asked.set()\nimport door.wing\none = 1\n",
    "door/_two.py": "two = 2\n",
    "door/wing.py": "import events\nevents.began.set()\nevents.asked.wait()\nfrom door import two\n",
}
"""A package whose name `one` needs a module that asks the package for its name `two`."""


def test_a_module_that_is_imported_waits_for_no_other_thread(tmp_path):
    (tmp_path / "door").mkdir()
    for name, text in DOOR_FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    run_python(f"""
import faulthandler, importlib, sys, threading
faulthandler.dump_traceback_later(60.0, exit=True)
sys.path.insert(0, {str(tmp_path)!r})
import door, events
other = threading.Thread(target=importlib.import_module, args=("door.wing",), daemon=True)
other.start()
events.began.wait()
assert door.one == 1
other.join()
assert door.wing.two == 2
""")


def test_names_of_subpackages_need_no_import_of_their_own():
    for package in ("arms", "plot", "regions", "spectral", "view"):
        run_python(f"""
import cspace
assert all(hasattr(cspace.{package}, name) for name in cspace.{package}.__all__)
""")


UNUSED_IN_THE_PLANE = {
    *("cspace._shapes.mesh", "cspace._shapes.bodies", "cspace._files.zarr_folders"),
    *("cspace._shapes.prism", "cspace._raster.rounded_segments"),
    *("cspace._queries.distance", "planners._edges.integrals"),
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
