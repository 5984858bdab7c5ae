"""The edge of the core: rooms outside it take fewer and fewer private names."""

import ast
import re

import pytest

from tests.helpers.repository import ROOT
from tests.lint.test_wings import WINGS

ROOMS = ("planners", *(f"cspace/{wing}" for wing in WINGS))
"""Folders outside the core."""

MOST_NAMES = {
    "planners": 71,
    "cspace/arms": 119,
    "cspace/_cli": 15,
    "cspace/export": 7,
    "cspace/lanes": 7,
    "cspace/plot": 0,
    "cspace/reasons": 11,
    "cspace/regions": 3,
    "cspace/spectral": 6,
    "cspace/_tiles": 21,
    "cspace/view": 30,
}
"""Private names that a room imports from other rooms. These numbers only ever get smaller."""

MOST_ATTRIBUTES = {
    "planners": 25,
    "cspace/arms": 20,
    "cspace/_cli": 2,
    "cspace/export": 4,
    "cspace/lanes": 7,
    "cspace/plot": 11,
    "cspace/reasons": 10,
    "cspace/regions": 15,
    "cspace/spectral": 4,
    "cspace/_tiles": 9,
    "cspace/view": 10,
}
"""Private attributes of others' objects that a room uses. These numbers only ever get smaller."""


def parse_room(room):
    return [ast.parse(file.read_text()) for file in sorted((ROOT / room).rglob("*.py"))]


def find_private_names(room):
    """Return the private names, with their modules, that a room imports from other rooms."""
    own = room.replace("/", ".")
    found = set()
    for tree in parse_room(room):
        for node in ast.walk(tree):
            if not isinstance(node, ast.ImportFrom) or not node.module:
                continue
            module = node.module
            is_ours = module.split(".")[0] in ("cspace", "planners")
            if not is_ours or f"{module}.".startswith(f"{own}."):
                continue
            is_private = re.search(r"\._[a-z]", module) is not None
            names = [alias.name for alias in node.names]
            found |= {(module, name) for name in names if is_private or name.startswith("_")}
    return found


def find_private_attributes(room):
    """Return the private attributes that a room uses, but never sets."""
    attributes = [
        node
        for tree in parse_room(room)
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and re.match(r"_[a-z]", node.attr)
    ]
    own = {node.attr for node in attributes if isinstance(node.ctx, ast.Store)}
    foreign = [node for node in attributes if ast.unparse(node.value) not in ("self", "cls")]
    return {node.attr for node in foreign} - own


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_takes_no_more_private_names_and_attributes_than_before(room):
    names, attributes = find_private_names(room), find_private_attributes(room)
    # After a name less, write the smaller number, so that none comes back.
    assert len(names) == MOST_NAMES[room], sorted(names)
    assert len(attributes) == MOST_ATTRIBUTES[room], sorted(attributes)


@pytest.mark.parametrize("package", ["cspace", "planners"])
def test_no_function_asks_a_space_for_a_method_by_its_name(package):
    for tree in parse_room(package):
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "hasattr":
                assert not ast.unparse(node.args[0]).endswith("space"), ast.unparse(node)
