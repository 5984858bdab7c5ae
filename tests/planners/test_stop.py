"""Searches that the caller ends."""

import itertools
import math
import signal
import subprocess
import sys
import threading
import time
from functools import partial

import numpy as np
import pytest
from ompl import base as ob

import cspace
import planners
from cspace import InputError, Robot, Workspace
from planners._catalogue import planner_names
from tests.helpers.drives import make_drive
from tests.helpers.strategies import few
from tests.helpers.urdfs import planar_arm

LONG = 600.0
"""Time limit in seconds, far above that of a test."""


def build_maze(rotations=None):
    """Build a map with walls that leave gaps at their ends in turn."""
    cells = np.zeros((150, 150), dtype=bool)
    for number, x in enumerate(range(12, 140, 12)):
        cells[x : x + 2] = True
        gap = slice(1, 10) if number % 2 else slice(140, 149)
        cells[x : x + 2, gap] = False
    robot = Robot.rectangle(0.2, 0.1)
    return cspace.build(Workspace.from_array(cells, 0.05), robot, rotations=rotations)


@pytest.fixture(scope="module")
def flat():
    return build_maze()


@pytest.fixture(scope="module")
def turning():
    return build_maze(8)


DRIVES = ("holonomic", "differential", "dubins", "reeds-shepp")
NAMES = (*planner_names(), "Grid", None)


@pytest.mark.parametrize("calls", [1, 3])
@pytest.mark.parametrize("name", NAMES)
def test_every_planner_ends(flat, name, calls):
    asked = itertools.count(1)
    ends = (0.3, 0.3), (7.3, 7.3)
    plan = planners.plan(
        flat, *ends, planner=name, time_limit=LONG, stop=lambda: next(asked) >= calls
    )
    if not plan:
        assert plan.status.startswith("no path found: stopped after")
        assert next(asked) == calls + 1  # once it is True, it is not asked again
    assert not plan or (plan.certified and calls > 1)


@pytest.mark.parametrize("name", NAMES)
def test_an_exception_or_interrupt_ends_every_planner(flat, name):
    # A process in the background may ignore SIGINT.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def fail():
        raise MemoryError("of the caller")

    def interrupt():
        signal.raise_signal(signal.SIGINT)

    ends = (0.3, 0.3), (7.3, 7.3)
    for error, end in ((MemoryError, fail), (KeyboardInterrupt, interrupt)):
        with pytest.raises(error):
            planners.plan(flat, *ends, planner=name, time_limit=LONG, stop=end)
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler


class Cost(ob.OptimizationObjective):
    """An objective of a user: the length."""

    def stateCost(self, state):  # noqa: N802 - OMPL's name
        return ob.Cost(1.0)

    def motionCost(self, first, second):  # noqa: N802 - OMPL's name
        return ob.Cost(math.dist((first[0], first[1]), (second[0], second[1])))

    def motionCostHeuristic(self, first, second):  # noqa: N802 - OMPL's name
        return self.motionCost(first, second)


CALLBACKS = [
    (planners.StateValidityChecker, "isValid", {"planner": "RRT"}),
    (planners.MotionValidator, "checkMotion", {"planner": "RRTConnect"}),
    (planners.FreeStateSampler, "sampleNear", {"planner": "BKPIECE1"}),
    (Cost, "motionCost", {"planner": "RRTstar", "objective": Cost}),
    (Cost, "motionCostHeuristic", {"planner": "BITstar", "objective": Cost}),
]


@pytest.fixture
def signals():
    """Return a function that sets the handler of SIGTERM, which is the old one after the test."""
    before = signal.getsignal(signal.SIGTERM)
    yield partial(signal.signal, signal.SIGTERM)
    signal.signal(signal.SIGTERM, before)


class HandlerError(Exception):
    """What a user's handler raises."""


def tell(number, frame):
    """Raise an error of a user's handler."""
    raise HandlerError


@pytest.mark.parametrize("kind, name, options", CALLBACKS, ids=lambda each: str(each)[-30:])
def test_a_signal_in_a_callback_of_ompl_is_raised_after_the_search(
    flat, monkeypatch, signals, kind, name, options
):
    ended = []
    calls = itertools.count(1)
    call = getattr(kind, name)

    def call_and_signal(*arguments):
        answer = call(*arguments)
        if next(calls) <= 2:  # also one that comes before the first is told
            signal.raise_signal(signal.SIGTERM)
            ended.append(True)
        return answer

    monkeypatch.setattr(kind, name, call_and_signal)
    signals(tell)
    with pytest.raises(HandlerError):
        planners.plan(flat, (0.3, 0.3), (7.3, 7.3), time_limit=10.0, **options)
    assert ended  # what is raised in a callback may end the process
    assert signal.getsignal(signal.SIGTERM) is tell


def test_a_handler_that_raises_nothing_is_called_and_ends_no_search(flat, signals):
    numbers = []
    signals(lambda number, frame: numbers.append(number))

    def is_stopped():
        signal.raise_signal(signal.SIGTERM)

    assert planners.plan(flat, (0.3, 0.3), (1.0, 7.0), planner="RRTConnect", stop=is_stopped)
    assert numbers and set(numbers) == {signal.SIGTERM}


def test_a_handler_that_is_set_during_a_search_stays(flat, signals):
    ends = (0.3, 0.3), (1.0, 7.0)
    plan = planners.plan(flat, *ends, planner="RRTConnect", stop=lambda: signals(tell) is None)
    assert plan and signal.getsignal(signal.SIGTERM) is tell


def test_searches_go_on_in_other_threads(flat, signals):
    signals(tell)
    began = threading.Event()
    told = []

    def search():
        ends = (0.3, 0.3), (7.3, 7.3)
        options = {"planner": "RRTstar", "time_limit": LONG}
        told.append(planners.plan(flat, *ends, stop=lambda: began.set() or told, **options))

    thread = threading.Thread(target=search)
    thread.start()
    began.wait()
    with pytest.raises(HandlerError):
        signal.raise_signal(signal.SIGTERM)
    assert thread.is_alive()
    told.append("stop")
    thread.join()
    assert len(told) == 2


SEARCH_AS_PYTHON_ENDS = """
import signal, sys, threading
import planners
from tests.helpers.handmade import build_empty
from tests.planners.test_stop import LONG, Cost

begun, main, daemon = threading.Event(), threading.main_thread(), bool(int(sys.argv[1]))

class Telling(Cost):
    def motionCost(self, first, second):
        begun.set()
        if not daemon and not main.is_alive():  # Ctrl-C while Python joins this thread
            signal.pthread_kill(main.ident, signal.SIGINT)
        return super().motionCost(first, second)

def search():
    options = {"planner": "RRTstar", "objective": Telling, "time_limit": LONG}
    planners.plan(space, (0.3, 0.3), (3.3, 3.3), **options)

signal.signal(signal.SIGINT, signal.default_int_handler)
space = build_empty((40, 40), "disc:0.1")
threading.Thread(target=search, daemon=daemon).start()
begun.wait()
"""


@pytest.mark.parametrize("daemon", few([1, 0]))
def test_python_ends_while_ompl_searches_in_another_thread(daemon):
    # Python ends a thread where it next needs the interpreter, which aborts below OMPL.
    command = [sys.executable, "-c", SEARCH_AS_PYTHON_ENDS, str(daemon)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("drive", ["differential", "differential-reverse"])
def test_the_lattice_proves_a_shut_door_soon(drive):
    cells = np.zeros((320, 200), dtype=bool)
    cells[160:168] = True
    ends = (2.0, 2.0, 0.0), (28.0, 2.0, 0.0)
    workspace = Workspace.from_array(cells, 0.1)
    for _ in range(2):  # the first plan may compile
        space = cspace.build(workspace, Robot.rectangle(0.9, 0.6), rotations=72)
        asked = itertools.count(1)
        plan = planners.plan(
            space,
            *ends,
            drive=make_drive(drive),
            time_limit=LONG,
            stop=lambda asked=asked: next(asked) > 1000,
        )
    assert plan.is_disconnected and plan.status == "no path exists: proven"


@pytest.mark.parametrize("drive", DRIVES)
def test_every_drive_ends(turning, drive):
    ends = (0.3, 0.3, 0.0), (7.3, 7.3, 0.0)
    options = {"drive": make_drive(drive, 0.1), "time_limit": LONG}
    plan = planners.plan(turning, *ends, stop=lambda: True, **options)
    assert not plan and "stopped" in plan.status and not plan.hint


SHORT = [*((name, None) for name in NAMES), *((None, drive) for drive in DRIVES)]


@pytest.mark.parametrize("name, drive", SHORT)
def test_a_plan_that_has_hardly_any_time_says_so(flat, turning, name, drive):
    given = {"drive": make_drive(drive, 0.1)} if drive else {"planner": name}
    start, middle, goal = np.array([(0.3, 0.3, 0.0), (0.3, 4.0, 1.6), (7.3, 7.3, 0.0)])
    space = turning if drive else flat
    for vias, limit in itertools.product(([], [middle], [middle, start]), (1e-9, 1e-3, 2e-2)):
        start, goal, *via = (q[: space.size] for q in (start, goal, *vias))
        for each in (space, space.exact):
            plan = planners.plan(each, start, goal, via=via, time_limit=limit, **given)
            assert plan.certified or "no path found within" in plan.status


def test_an_arm_ends():
    space = cspace.build_arm_space({}, planar_arm())
    q = space.sample_free(2, np.random.default_rng(0))
    for name in ("BiRRT", "RRTstar"):
        end = time.monotonic() + 0.05
        plan = planners.plan(
            space, *q, planner=name, time_limit=LONG, stop=lambda end=end: time.monotonic() > end
        )
        assert plan or "stopped" in plan.status


def test_a_path_found_before_is_returned(flat):
    ends = (0.3, 0.3), (0.3, 7.0)
    assert planners.plan(flat, *ends, stop=lambda: True)  # a single edge, before any search
    end = time.monotonic() + 0.3
    plan = planners.plan(
        flat,
        (0.3, 0.3),
        (1.0, 7.0),
        planner="RRTstar",
        time_limit=LONG,
        stop=lambda: time.monotonic() > end,
    )
    assert plan or "stopped" in plan.status


def test_a_stop_belongs_to_one_plan(flat):
    options = {"planner": "RRT", "stop": lambda: True}
    assert not planners.plan(flat, (0.3, 0.3), (7.3, 7.3), **options)
    assert planners.plan(flat, (0.3, 0.3), (7.3, 7.3), time_limit=30.0)
    assert planners.plan(flat, (0.3, 0.3), (7.3, 7.3), time_limit=30.0, stop=lambda: False)


def test_stop_must_be_callable(flat):
    with pytest.raises(InputError, match="stop is True"):
        planners.plan(flat, (0.3, 0.3), (7.3, 7.3), stop=True)
