"""Warnings about angles beyond a whole turn, at the user's line."""

import math
import warnings
from functools import cache

import numpy as np
import pytest

import cspace
import planners
from cspace import AngleWarning, Robot, Workspace

FREE_Q = 1.0, 1.0, 0.5
ANGLE_CALLS = {
    "start": ("start", lambda space, q: planners.plan(space, q, FREE_Q)),
    "is_free": ("q", lambda space, q: space.is_free(np.array(q))),
    "motion_is_free": ("q1", lambda space, q: space.motion_is_free(FREE_Q, q)),
    "is_free of rows": ("q", lambda space, q: space.is_free([FREE_Q] * 3 + [q])),
    "motions": ("q0", lambda space, q: space.motion_is_free([q, FREE_Q], FREE_Q)),
    "certify_path": ("path", lambda space, q: space.certify_path([FREE_Q, q])),
    "clearance of rows": ("q", lambda space, q: space.clearance([FREE_Q, q])),
    "chunk": ("rows", lambda space, q: cspace.Gate(space).check_rows(FREE_Q, [FREE_Q, q])),
    "chunk at": ("q", lambda space, q: cspace.Gate(space).check_rows(q, [FREE_Q])),
    "is_connected": ("q0", lambda space, q: space.is_connected(q, FREE_Q)),
    "min_path_length": ("q1", lambda space, q: space.min_path_length(FREE_Q, q)),
    "states_at": ("rotation", lambda space, q: space.states_at(q[2:])),
}


@cache
def turning():
    workspace = Workspace.from_array(np.eye(30, dtype=bool)[::-1], 0.1)
    return cspace.build(workspace, Robot.rectangle(0.2, 0.1), rotations=12)


def catch_warnings(call):
    """Return the warnings of a call that Python prints by default."""
    with warnings.catch_warnings(record=True, action="default") as caught:
        call()
    return caught


@pytest.mark.parametrize("call", ANGLE_CALLS)
def test_a_yaw_in_degrees_warns_once_and_names_its_argument(call):
    name, query = ANGLE_CALLS[call]

    def repeat():
        for yaw in (90.0, -180.0, 7.0):
            query(turning(), (1.0, 1.0, yaw))

    catch_warnings(repeat)  # compiling at the first call resets Python's registry of warnings
    (warning,) = catch_warnings(repeat)
    assert warning.category is AngleWarning and warning.filename == __file__
    assert str(warning.message) == f"{name}: yaw is beyond a whole turn; it is in rad"


@pytest.mark.parametrize("call", ANGLE_CALLS)
def test_angles_up_to_a_whole_turn_do_not_warn(call):
    for yaw in (2.0 * math.pi, -2.0 * math.pi, 4.0):
        assert not catch_warnings(lambda yaw=yaw: ANGLE_CALLS[call][1](turning(), (1.0, 1.0, yaw)))  # type: ignore[misc]
