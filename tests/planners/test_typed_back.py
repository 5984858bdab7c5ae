"""Printed configurations, which a user may type back."""

import pickle
import re

import numpy as np
import pytest

import planners
from cspace import FREE, MIXED
from tests.helpers.handmade import make_map

CONFIGURATION = re.compile(r"\(([-+.e\d]+(?:, [-+.e\d]+)+)\)")


def read_configurations(text):
    """Return the configurations in a text."""
    return [tuple(map(float, numbers.split(", "))) for numbers in CONFIGURATION.findall(text)]


@pytest.mark.parametrize("spacing", [0.01, 0.1])
def test_start_and_goal_of_a_printed_plan_are_taken_when_typed_back(spacing):
    states = np.full((1, 41, 9), FREE, dtype=np.uint8)
    states[0, 20] = MIXED
    space = make_map(states, "plane", "blocked", spacing)
    start = (20.0 * spacing - 1e-6, 4.5 * spacing)
    for goal in ((21.0 * spacing + 1e-7, 4.5 * spacing), (spacing, spacing)):
        plan = planners.plan(space, start, goal)
        first, last = read_configurations(repr(plan))
        assert planners.plan(space, first, last).solved == plan.solved
        without_map = pickle.loads(pickle.dumps(plan))
        assert read_configurations(repr(without_map)) == [tuple(plan.start), tuple(plan.goal)]
