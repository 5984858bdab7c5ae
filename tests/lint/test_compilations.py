"""The number of functions that the demo compiles, and the files that compiled code depends on."""

import ast

from benchmarks.first_process import DEMO
from benchmarks.suites.first_use import MAX_DEMO_COMPILATIONS, run_process
from cspace._support.sources import list_sources
from tests.helpers.repository import ROOT, SOURCES
from tests.lint.test_imports import DOORS


def test_the_demo_compiles_few_functions(tmp_path):
    assert (
        0 < run_process(DEMO, tmp_path, tmp_path / "cache")["compilations"] <= MAX_DEMO_COMPILATIONS
    )


INTERNAL = {"internal", "inlined"}
KERNELS = {"kernel", "allocating", *INTERNAL}
"""Decorators of compiled functions; those of the internal ones have no wrapper for Python."""


def decorators_of(node):
    """Return the decorators of a function."""
    return set(map(ast.unparse, getattr(node, "decorator_list", ())))


def names_in(module, node):
    """Return the functions that a piece of a module reads, each with its module."""
    places = {
        each.asname or each.name: (imported.module, each.name)
        for imported in ast.walk(module)
        if isinstance(imported, ast.ImportFrom)
        for each in imported.names
    }
    names = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
    return {places.get(name, (module.name, name)) for name in names}


def test_python_calls_no_internal_function():
    # Such a call would crash the process.
    folders = ("cspace", "planners", "tests", "benchmarks", "examples", "ros", "docs")
    modules = []
    for file in (file for folder in folders for file in (ROOT / folder).rglob("*.py")):
        module = ast.parse(file.read_text(encoding="utf-8"))
        module.name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        modules.append(module)
    internal = {
        (module.name, node.name)
        for module in modules
        for node in module.body
        if INTERNAL & decorators_of(node)
    }
    assert len(internal) > 100
    for module in modules:
        for node in module.body:
            if not KERNELS & decorators_of(node):
                assert not internal & names_in(module, node), (module.name, ast.unparse(node))


def names_read(code):
    """Return the names that a piece of code reads, also in its hints of types."""
    return {node.id for node in ast.walk(code) if isinstance(node, ast.Name)}


def definitions_in(tree):
    """Return what code of a module may be compiled with: imports, values, fields and functions."""
    found = dict[str, ast.AST]()
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            found |= {each.asname or each.name: node for each in node.names}
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            found[ast.unparse(node.target)] = node.value
        elif isinstance(node, ast.Assign):
            found |= {name: node.value for target in node.targets for name in names_read(target)}
        elif isinstance(node, ast.ClassDef) and "NamedTuple" in map(ast.unparse, node.bases):
            fields = [each for each in node.body if isinstance(each, ast.AnnAssign)]
            found[node.name] = ast.Module(body=fields, type_ignores=[])
        elif isinstance(node, ast.FunctionDef):
            found[node.name] = ast.Module(body=[node.args, *node.body], type_ignores=[])
    return found


def test_constants_and_records_of_kernels_are_in_files_that_the_folder_depends_on():
    # Otherwise a kernel would keep the old value of a constant, or the old places of fields.
    known = set(list_sources())
    trees = {name: ast.parse(file.read_text(encoding="utf-8")) for name, file in SOURCES.items()}
    pending = [
        (module, node.name)
        for module, tree in trees.items()
        for node in tree.body
        if KERNELS & decorators_of(node)
    ]
    seen = set[tuple[str, str]]()
    while pending:
        module, name = pending.pop()
        place = definitions_in(trees[module]).get(name)
        if (module, name) in seen or place is None:
            continue
        seen.add((module, name))
        if isinstance(place, ast.ImportFrom):
            source = DOORS.get(place.module, {}).get(name, place.module)
            pending += [(source, name)] if source in trees else []
        else:
            assert SOURCES[module] in known, f"{name} of {module} is compiled into a kernel"
            pending += [(module, each) for each in names_read(place)]
    assert len(seen) > 900
    assert {("cspace._record.cells", "Map"), ("planners._searches.frontier", "Progress")} < seen
    assert len(known) < len(SOURCES) / 3  # other files change, and no kernel is compiled again


def test_code_of_others_depends_on_the_records_that_it_imports(tmp_path):
    file = tmp_path / "wing.py"
    file.write_text("from planners import (\n    Choices,\n    plan,\n)\n", encoding="utf-8")
    more = set(list_sources([file])) - set(list_sources())
    assert {file, SOURCES["planners._plan"]} <= more
    file.write_text("from planners import plan\n", encoding="utf-8")
    assert set(list_sources([file])) - set(list_sources()) == {file}
