"""The number of functions that the demo compiles, and the files that compiled code depends on."""

import ast
from pathlib import Path

import cspace
import planners
from benchmarks.first_process import DEMO
from benchmarks.suites.first_use import MAX_DEMO_COMPILATIONS, run_process
from cspace._support.compiling import FILES_WITHOUT_KERNELS
from tests.helpers.repository import ROOT
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


def constants_in(code):
    """Return the constants that a piece of code reads."""
    return {
        node.id
        for node in ast.walk(code)
        if isinstance(node, ast.Name) and node.id.strip("_").isupper()
    }


def definitions_in(tree):
    """Return where each name of a module is imported or assigned."""
    found = dict[str, ast.AST]()
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            found |= {each.asname or each.name: node for each in node.names}
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            found[ast.unparse(node.target)] = node.value
        elif isinstance(node, ast.Assign):
            found |= {name: node.value for target in node.targets for name in constants_in(target)}
    return found


def test_constants_of_kernels_are_in_files_that_the_folder_depends_on():
    # Otherwise a kernel would keep the old value of a constant.
    modules, pending, known = (
        dict[str, ast.Module](),
        list[tuple[str, str]](),
        set(FILES_WITHOUT_KERNELS),
    )
    for file in [
        file
        for package in (cspace, planners)
        for file in Path(package.__file__).parent.rglob("*.py")
    ]:
        name = file.relative_to(ROOT).as_posix()
        modules[name] = ast.parse(file.read_text(encoding="utf-8"))
        for node in ast.walk(modules[name]):
            if KERNELS & decorators_of(node):
                known.add(name)
                pending += [(name, constant) for constant in constants_in(node)]
    seen = set[tuple[str, str]]()
    while pending:
        name, constant = pending.pop()
        place = definitions_in(modules[name]).get(constant)
        if (name, constant) in seen or place is None:
            continue
        seen.add((name, constant))
        assert name in known, f"{constant} of {name} is compiled into a kernel"
        if isinstance(place, ast.ImportFrom):
            source = DOORS.get(place.module, {}).get(constant, place.module)
            path = str(source).replace(".", "/")
            pending += [
                (file, constant)
                for file in (f"{path}.py", f"{path}/__init__.py")
                if file in modules
            ]
        else:
            pending += [(name, each) for each in constants_in(place)]
    assert len(seen) > 100
