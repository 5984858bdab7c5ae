"""Calls of compiled functions by their addresses."""

import pytest

from tests.helpers.scripts import run_script

CALLS = """
import math
from typing import NamedTuple
import numpy as np
from cspace._support.addresses import call, find_address
from cspace.inside import internal, kernel

class Body(NamedTuple):
    corners: object
    inner: tuple

@kernel
def weigh(body, factors):
    if factors[0] < 0.0:
        raise ValueError("negative")
    return body.corners[1, 0] * factors[0] + body.inner[0]

@internal
def weigh_rows(weigh, body, rows, out):
    for k in range(len(rows)):
        out[k] = call(weigh, (body, rows[k]))

@kernel
def weigh_all(weigh, body, rows, out):
    weigh_rows(weigh, body, rows, out)

def make_arguments(order="C"):
    body = Body(np.array([[1.0, 2.0], [3.0, 4.0]]), (0.5, 7))
    rows = np.asarray(np.arange(8.0).reshape(4, 2), order=order)
    return find_address(weigh, body, np.zeros(2)), body, rows, np.empty(4)
"""

RUN_CALLS = """
import cspace, os, threading
cspace.__path__.append(os.getcwd())
{before}
from numba.core import event
from numba.core.errors import TypingError
with event.install_recorder("numba:compile") as recorder:
    from cspace.calls import make_arguments, weigh, weigh_all
    arguments = make_arguments()
    threads = [threading.Thread(target=weigh_all, args=arguments) for _ in range(4)]
    [each.start() for each in threads]
    [each.join() for each in threads]
    weigh_all(*arguments)
_, body, rows, out = arguments
assert out.tolist() == [weigh.py_func(body, row) for row in rows] == [0.5, 6.5, 12.5, 18.5]
print(sum(each.is_start for _, each in recorder.buffer), end=" ")
rows[2] = -1.0
for wrong in (arguments, make_arguments("F")):
    try:
        weigh_all(*wrong)
    except (ValueError, TypingError) as error:
        print(type(error).__name__, end=" ")
"""


@pytest.mark.thorough
def test_calls_by_address_stay_valid_in_other_processes(tmp_path):
    (tmp_path / "calls.py").write_text(CALLS)
    code = RUN_CALLS.format(before="")
    without_cache = RUN_CALLS.format(before="del os.geteuid")
    answers = [run_script(tmp_path, each)[0] for each in (code, code, without_cache, without_cache)]
    # A kernel is compiled once; arrays of another order are refused.
    assert answers == [f"{n} ValueError TypingError" for n in (3, 0, 3, 3)]
