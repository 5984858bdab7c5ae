"""Lower bounds of path lengths beside the straight way, exactly."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cspace
from tests.helpers.strategies import examples, exteriors, seeds


@pytest.mark.parametrize("robot, side", [(cspace.Robot.disc(0.1), 40), (cspace.Robot.ball(0.1), 9)])
@examples(30)
@given(seed=seeds, outside=exteriors, reach=st.sampled_from([1e-6, 1e-3, 0.1, 2.0]))
def test_a_bound_never_exceeds_the_straight_way(robot, side, seed, outside, reach):
    """Nor falls short of it where nothing is in the way."""
    rng = np.random.default_rng(seed)
    lower = rng.choice([0.0, 0.3, -7.7, 1e5], robot.dim)
    cells = np.zeros((side,) * robot.dim, dtype=bool)
    workspace = cspace.Workspace.from_array(cells, 0.1, lower=lower)
    space = cspace.build(workspace, robot, outside=outside)
    rows = lower + rng.uniform(0.15, 0.1 * side - 0.15, (20, 2, robot.dim))
    rows[:, 1] = rows[:, 0] + (rows[:, 1] - rows[:, 0]) * min(1.0, reach)
    for start, goal in rows.tolist():
        bound = space.min_path_length(start, goal)
        square = sum((Fraction(b) - Fraction(a)) ** 2 for a, b in zip(start, goal, strict=True))
        assert Fraction(bound) ** 2 <= square
        assert Fraction(bound) ** 2 >= square * Fraction(0.999)
