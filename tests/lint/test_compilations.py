"""The number of functions that the demo compiles, and digests of all compiled functions."""

import ast
import importlib

from benchmarks.first_process import DEMO
from benchmarks.suites.first_use import MAX_DEMO_COMPILATIONS, run_process
from cspace._support.digests import digest_function
from tests.helpers.repository import ROOT, SOURCES


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


def test_a_digest_describes_each_function_so_that_its_code_is_kept():
    count = 0
    for name, file in SOURCES.items():
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for node in tree.body:
            if KERNELS & decorators_of(node):
                assert digest_function(getattr(importlib.import_module(name), node.name))
                count += 1
    assert count > 200
