"""Maps shared by tests of pictures; no test modifies them."""

import numpy as np
import pytest

from cspace import Robot, Workspace, build
from tests.helpers.pictures import block, yard


@pytest.fixture(scope="package")
def flat():
    return build(block(), Robot.disc(0.32))


@pytest.fixture(scope="package")
def turning():
    """Build a map of a long, off-center robot."""
    return yard(Robot.rectangle(1.2, 0.4, center=(0.3, 0.0)))


@pytest.fixture(scope="package")
def hall():
    """Build a map of 6 m x 4 m x 2.4 m without symmetry.

    It has a floor, a wall with a window at x = 2.8 to 3.2, a block and a pillar.
    """
    occupied = np.zeros((60, 40, 24), bool)
    occupied[..., 0] = True
    occupied[28:32] = True
    occupied[28:32, 6:18, 4:16] = False
    occupied[45:52, 20:30, :14] = True
    occupied[10:16, 22:28] = True
    return build(Workspace.from_array(occupied, 0.1), Robot.box((0.5, 0.4, 0.3)))
