"""Frozen files of the format, for ever, and the reader on its page."""

import json
import re

import numpy as np
import pytest

import cspace
from tests.helpers.cpp import SPACES, build_space, draw_queries
from tests.helpers.repository import ROOT

FROZEN = ROOT / "tests" / "record" / "frozen"
"""Maps of version 7, one raw and one compressed, with their answers: never save them anew."""


@pytest.mark.parametrize("name", ["flat", "solid"])
def test_frozen_maps_open_and_give_the_answers_of_their_day(name):
    answers = json.loads((FROZEN / "answers.json").read_text(encoding="utf-8"))[name]
    space = cspace.open(FROZEN / name)
    assert isinstance(space, cspace.CSpace)
    first, last = np.split(np.array(answers["queries"]), 2, axis=1)
    assert space.classify(first).tolist() == answers["states"]
    assert space.motion_is_free(first, last).tolist() == answers["motions"]
    np.testing.assert_allclose(space.clearance(first), answers["clearances"], rtol=1e-12)


def reader_of_the_page():
    """Return the names that the code of docs/reference/format.md defines."""
    page = (ROOT / "docs" / "reference" / "format.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    assert len(blocks) == 1
    assert sum(bool(line) for line in blocks[0].splitlines()) <= 40
    names = {}
    exec(compile(blocks[0], "format.md", "exec"), names)
    return names


@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("name", SPACES)
def test_the_reader_of_the_page_gives_the_states_of_the_map(tmp_path, name, outside):
    space, reader = build_space(name, outside), reader_of_the_page()
    space.save(tmp_path / "map", compress=False, clearance=True)
    about, arrays = reader["read"](tmp_path / "map")
    q = draw_queries(space, 300, np.random.default_rng(2))[:, : space.size]
    q = q[(np.abs(q) < 1e15).all(axis=1)]  # numbers of cells that fit an int64
    states = [reader["state"](about, arrays, row) for row in q]
    np.testing.assert_array_equal(states, space.classify(q))
    assert arrays["distances"].shape == arrays["cell_states"].shape
