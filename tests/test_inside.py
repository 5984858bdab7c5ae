"""The inner door of the core: a contract with the packages beside it."""

import re
from collections import defaultdict

import planners.inside
from cspace import inside
from tests.helpers.repository import ROOT
from tests.lint.test_edge import ROOMS

MOST_NAMES = 124
"""Names that one person can know, besides those of the engine."""

MOST_ENGINE_NAMES = 62
"""Names of the engine that keeps bodies apart, for arms, lanes and the frequency domain."""

STUB = (ROOT / "cspace/inside.pyi").read_text(encoding="utf-8")
ENGINE = set(
    re.findall(r"from \.(?:_bodies|_support\.(?:addresses|records))\S* import \w+ as (\w+)", STUB)
)
"""Names of the engine, which arms alone may use, because the core proves with it, too."""


OF_ONE_ROOM = {
    "Components",
    "Mesh",
    "describe_code",
    "find_overlaps",
    "join_yaw_cells",
    "primitives",
    "measure_shapes",
    "read_mesh",
    "robot_of",
    "warn_of_size",
}
"""Names that one room alone uses, and that planners do not; there only ever get fewer."""


def find_users(door):
    """Return the rooms outside the core that import each name of a door."""
    imports = re.compile(rf"from {door} import (\([^)]*\)|.*)")
    users = defaultdict(set)
    for room in ROOMS:
        for file in (ROOT / room).rglob("*.py"):
            for names in imports.findall(file.read_text()):
                for name in re.findall(r"(\w+)(?: as \w+)?", names):
                    users[name].add(room)
    return users


def test_the_door_has_few_names_and_each_can_be_imported():
    names = inside.__all__
    assert len(names) == len(set(names))
    assert len(set(names) - ENGINE) <= MOST_NAMES and len(ENGINE) <= MOST_ENGINE_NAMES
    assert all(getattr(inside, name) is not None for name in names)


def test_each_name_of_the_door_is_used_by_planners_or_two_rooms():
    users = find_users("cspace.inside")
    assert set(users) == set(inside.__all__)
    alone = {name for name, rooms in users.items() if len(rooms) == 1 and "planners" not in rooms}
    assert alone - ENGINE == OF_ONE_ROOM - ENGINE


def test_each_name_of_the_door_is_described():
    page = (ROOT / "docs/reference/inside.md").read_text(encoding="utf-8")
    assert all(f"| `{name}` | " in page for name in inside.__all__)
    assert "| `kernel` | Compile a function" in page


def test_the_door_of_planners_has_few_names_which_another_room_uses():
    page = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
    assert "`planners.inside`" in page
    names = ["PathPieces", "bound_rates", "cut_way", "drive_around", "wait_first"]
    assert sorted(planners.inside.__all__) == names
    for name in planners.inside.__all__:
        assert getattr(planners.inside, name).__doc__ and f"`{name}`" in page
    assert set.union(*find_users("planners.inside").values()) == {"cspace/lanes"}
