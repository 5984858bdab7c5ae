"""Error messages: one line that names the argument."""

import numpy as np
import pytest

import cspace
import planners
from cspace import InputError, Robot, Workspace
from cspace.errors import MAX_PROBLEM_CHARACTERS
from tests.helpers.refusals import refusals

NO_OBSTACLES = np.zeros((40, 30), dtype=bool)
@pytest.fixture(scope="module")
def space():
    return cspace.build(Workspace.from_array(NO_OBSTACLES, 0.1), Robot.disc(0.2))


