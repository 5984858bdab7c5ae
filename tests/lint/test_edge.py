"""The edge of the core: rooms outside it take no private names."""

import ast
import re
from functools import cache

import pytest

from tests.helpers.repository import ROOT
from tests.lint.test_wings import WINGS

ROOMS = ("planners", *(f"cspace/{wing}" for wing in WINGS))
"""Folders outside the core."""

NAMED_TUPLE = {"_asdict", "_fields", "_make", "_replace"}
"""Names of Python's named tuples, which their users are meant to call."""


@cache
def parse_all():
    """Return the syntax tree of each file of the product, by its path."""
    files = (file for package in ("cspace", "planners") for file in (ROOT / package).rglob("*.py"))
    return {str(file.relative_to(ROOT)): ast.parse(file.read_text()) for file in sorted(files)}


def parse_room(room):
    return [tree for path, tree in parse_all().items() if path.startswith(f"{room}/")]


def is_private(name):
    return re.match("_[a-z]", name) is not None and name not in NAMED_TUPLE


def find_private_names(room):
    """Return the private names, with their modules, that a room imports from other rooms."""
    own = f"{room.replace('/', '.')}."
    found = set()
    for tree in parse_room(room):
        for node in ast.walk(tree):
            if not isinstance(node, ast.ImportFrom) or not node.module:
                continue
            module = node.module
            is_ours = module.split(".")[0] in ("cspace", "planners")
            if not is_ours or f"{module}.".startswith(own):
                continue
            is_module_private = re.search(r"\._[a-z]", module) is not None
            names = [alias.name for alias in node.names]
            found |= {(module, name) for name in names if is_module_private or is_private(name)}
    return found


@cache
def find_definitions(tree):
    """Return the private methods and fields that a file defines."""
    found = set()
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.Attribute(attr=name, ctx=ast.Store()):
                found.add(name)
            case ast.AnnAssign(target=ast.Name(id=name)):
                found.add(name)
    return set(filter(is_private, found))


def find_private_attributes(room):
    """Return the private attributes that a room uses, and that others alone define."""
    trees = parse_room(room)
    own = set().union(*map(find_definitions, trees))
    others = [find_definitions(tree) for tree in parse_all().values() if tree not in trees]
    used = {
        node.attr
        for tree in parse_room(room)
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        if ast.unparse(node.value) not in ("self", "cls", "super()")
    }
    return used & set().union(*others) - own


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_takes_no_private_names_and_attributes_of_others(room):
    assert not find_private_names(room)
    assert not find_private_attributes(room)


@pytest.mark.parametrize("package", ["cspace", "planners"])
def test_no_function_asks_a_space_for_a_method_by_its_name(package):
    for tree in parse_room(package):
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "hasattr":
                assert not ast.unparse(node.args[0]).endswith("space"), ast.unparse(node)
