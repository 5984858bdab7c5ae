"""The inner door of the core: a contract with the packages beside it."""

import ast
from collections import defaultdict

from cspace import inside
from tests.helpers.repository import ROOT
from tests.lint.test_edge import ROOMS, parse_room

MOST_NAMES = 120
"""Names that one person can know."""


def find_users():
    """Return the rooms outside the core that import each name of the door."""
    users = defaultdict(set)
    for room in ROOMS:
        for tree in parse_room(room):
            for node in ast.walk(tree):
                if isinstance(node, ast.ImportFrom) and node.module == "cspace.inside":
                    for alias in node.names:
                        users[alias.name].add(room)
    return users


def test_the_door_has_few_names_and_each_can_be_imported():
    names = inside.__all__
    assert len(names) == len(set(names)) <= MOST_NAMES
    assert all(getattr(inside, name) is not None for name in names)


def test_each_name_of_the_door_is_used():
    assert set(find_users()) == set(inside.__all__)


def test_each_name_of_the_door_is_described():
    page = (ROOT / "docs/reference/inside.md").read_text(encoding="utf-8")
    assert all(f"| `{name}` | " in page for name in inside.__all__)
    assert "| `kernel` | Compile a function" in page
