"""Damaged files of wings, refused quickly: robots, scenes, requests and tiled maps."""

import json

import pytest

from tests.fuzz import files as fuzz
from tests.helpers.hostile import DamagedFiles


@pytest.fixture(scope="module")
def families(tmp_path_factory):
    every = fuzz.write_families(tmp_path_factory.mktemp("families"))
    return {name: every[name] for name in fuzz.OF_WINGS}


class TestFilesOfWings(DamagedFiles):
    """Damaged files of wings."""


def list_places(value):
    """Return the keys that lead to each value within nested tables and lists."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    places = []
    for key, part in items:
        inner = list_places(part) if isinstance(part, dict | list) else []
        places += [[key], *([key, *rest] for rest in inner)]
    return places


@pytest.mark.parametrize("name", ["scene.yaml", "request.yaml"])
def test_every_field_of_a_moveit_message_is_checked(tmp_path, families, name):
    """Write a table with an unknown field in place of each value."""
    content = json.loads(families[name].read_text())
    if name == "scene.yaml":
        content["world"]["collision_objects"][0] |= {"planes": [], "subframe_names": []}
    else:
        content["start_state"]["attached_collision_objects"] = []
        content["path_constraints"] = {}
    path = tmp_path / name
    opened = []
    for *place, last in list_places(content):
        message = json.loads(json.dumps(content))
        parent = message
        for key in place:
            parent = parent[key]
        parent[last] = {"unknown": 1}
        path.write_text(json.dumps(message))
        if fuzz.attempt(path) != "refused":
            opened.append(last)
    assert set(opened) <= {"weight"}
