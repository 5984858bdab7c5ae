"""Damaged files of wings, refused quickly: robots, scenes, requests and tiled maps."""

import json
import subprocess
import sys
from collections import Counter

import pytest

from tests.fuzz import files as fuzz


@pytest.fixture(scope="module")
def families(tmp_path_factory):
    every = fuzz.write_families(tmp_path_factory.mktemp("families"))
    return {name: every[name] for name in fuzz.OF_WINGS}


def test_every_family_opens_and_its_mutants_open_or_are_refused(families):
    outcomes = Counter()
    for name, path in families.items():
        assert fuzz.attempt(path) == "opened", name
        outcomes += fuzz.count_outcomes(7, families, name, 0, 12)
    assert set(outcomes) == {"opened", "refused"}


def test_cut_files_are_refused_if_their_format_says_where_they_end(families):
    assert fuzz.open_cut_files(families, 8) == []


@pytest.mark.thorough
def test_opening_starts_no_process_and_writes_sends_and_imports_nothing(families):
    folder = next(iter(families.values())).parent
    code = [sys.executable, "-c", fuzz.AUDITED, str(folder)]
    done = subprocess.run(code, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


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
