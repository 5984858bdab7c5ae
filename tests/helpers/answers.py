"""A watch over public calls: tests/checker replays each answer that a test is given."""

import functools
import inspect
import sys
import time
import types
from collections import Counter

import numpy as np

import cspace
import planners
from cspace import lanes
from cspace.inside import robot_of
from tests.checker import apart, bodies, no_path, plane
from tests.checker.verdict import NOT_SHOWN, PROVEN, Budget, Verdict
from tests.helpers import plain
from tests.helpers.plain import LeftOut, need

WORK_OF_ANSWER = 12_000
WORK_OF_TEST = 30_000
"""Counted work of an answer, and of all answers of a test."""

COST_OF_SPACE = 10
"""Work of a distance in space, in that of a piece in the plane."""

MOST_PAIRS = 2
"""Pairs of configurations of one map whose disconnection is replayed."""

GAP = 2e-6
"""Largest gap between a motion in closed form and its rows, metres or radians."""


class Tally:
    """What a test's answers were found to be, and the CPU that it took."""

    def __init__(self):
        """Begin a test."""
        self.start(True)

    def start(self, is_on):
        """Begin a test, whose answers are checked if ``is_on``."""
        self.is_on, self.left, self.seen, self.cpu = is_on, WORK_OF_TEST, Counter(), 0.0
        self.known = set()


tally = Tally()


def checking(call):
    """Decorate a check, which is called after the answer: skip what is too large, and count."""

    @functools.wraps(call)
    def check(*values, **options):
        if not tally.is_on:
            return
        tally.is_on = False  # what the check asks is not checked
        began = time.process_time()
        budget = Budget(min(WORK_OF_ANSWER, tally.left))
        try:
            for name, verdict in call(budget, *values, **options):
                is_refused = not verdict and "more work" not in verdict.text
                tally.seen[
                    f"{name}: {verdict.kind if verdict else 'refused' if is_refused else NOT_SHOWN}"
                ] += 1
                assert not is_refused, (
                    f"the checker refuses this {name}: {verdict.kind}, {verdict.text}"
                )
        except LeftOut as reason:
            tally.seen[f"left: {reason}"] += 1
        finally:
            tally.left -= budget.spent
            tally.cpu += time.process_time() - began
            tally.is_on = True

    return check


# ---- checks --------------------------------------------------------------------------------------


def check_motion(space, motion, budget, exact=False, keep=()):
    """Check that a robot or an arm keeps its margin along pieces."""
    if space.has_poses and space.dim == 2:
        world = plain.world_of(space, exact=exact)
        parts = plain.parts_of(space.robot.shape.outer)
        return plane.check_plane(motion, parts, world, budget, space.margin)
    whole, budget = budget, Budget(budget.left // COST_OF_SPACE)
    verdict = check_in_space(space, motion, budget, exact, keep)
    whole.take(COST_OF_SPACE * budget.spent)
    return verdict


def check_in_space(space, motion, budget, exact, keep):
    """Check the motion of a body or an arm in space."""
    if not space.has_poses:
        need(isinstance(space, cspace.ArmSpace) and not keep, "a map of joints")
        return bodies.check_chain(motion, *plain.arm_of(space), budget)
    world = plain.world_of(space, exact=exact)
    shape = space.robot.shape.outer
    body, solids = plain.body_of(shape), [plain.body_of(each) for each in world.shapes]
    return bodies.check_solid(motion, body, solids, budget, space.margin, world.room)


@checking
def check_plan(budget, plan, space, start, goal, via=(), **_):
    """Check a plan's path, its places, and that there is none where it says so."""
    need(isinstance(space, cspace.CSpace | cspace.ArmSpace), "a space of another kind")
    need(len(plan.path) <= 1500, "a long path")
    need(isinstance(via, tuple | list | np.ndarray), "places in a table")
    if plan.is_disconnected:
        places = [plain.places_of(space, place, "place") for place in (start, *via, goal)]
        yield "no path", check_bars(space, places, budget)
    if not plan:
        return
    if plan.certified:
        motion, gap = plain.pieces_of_plan(plan)
        assert gap <= GAP, f"rows are {gap} m or rad from the motion of the drive"
        yield "path", check_motion(space, motion, budget, plan.exact, plan.keep)
    need(space.has_poses, "the places of an arm")
    rows = [plan.path[row] for row in (0, *plan.via_rows, -1)]
    for place, row in zip((start, *via, goal), rows, strict=True):
        alternatives = plain.places_of(space, place, "place")
        assert no_path.holds(alternatives, row), f"{row.tolist()} is not in {place!r}"


@checking
def check_closest(budget, plan, space, start, goal, via=(), drive=None, **_):
    """Try to refute that nothing of a goal is nearer, or, without a plan, reached at all.

    Only a chain of FREE cells from the start refutes it, because "nearest" speaks of these.
    """
    is_asked = isinstance(goal, planners.Near) and goal.closest and not via
    need(is_asked and (drive is None or plan is None), "another question than the nearest")
    need(space.rotations.names in ((), ("yaw",)), "rotations of other kinds")
    starts = plain.places_of(space, start, "start")
    (wanted,) = plain.places_of(space, goal, "goal")
    need(not any(isinstance(each, planners.Near) for each in (start, goal.configuration)), "Near")
    found = plain.measure_nearest(space, starts, wanted)
    slack = 1e-4 * space.grid.spacing
    if plan is None:
        assert not found < wanted.distance - slack, f"FREE cells lead to {found} m from the goal"
    elif plan:
        claimed = float(np.linalg.norm(plan.path[-1][: space.dim] - wanted.where))
        assert claimed <= found + slack, f"FREE cells lead to {found} m, not {claimed} m"
    yield "nearest", Verdict(PROVEN)


def check_bars(space, places, budget):
    """Check that no path leads through places."""
    borders, barred, offsets = plain.find_bars(space, places)
    return no_path.check_no_path(
        plain.convex_of(space),
        plain.world_of(space, "inner"),
        (space.grid.lower, space.grid.spacing, space.grid.shape),
        borders,
        places,
        barred,
        offsets,
        budget,
        space.outside == "free",
    )


@checking
def check_disconnected(budget, answer, space, q0, q1):
    """Check some pairs that are proven disconnected."""
    if not np.any(answer):
        return
    need(isinstance(space, cspace.CSpace), "a map in tiles")
    ends = np.broadcast_arrays(np.asarray(q0, float), np.asarray(q1, float))
    pairs = zip(*(each.reshape(-1, space.size)[np.ravel(answer)] for each in ends), strict=True)
    for pair in list(pairs)[:MOST_PAIRS]:
        key = id(space), id(space.workspace), len(space.obstacles), space.size
        count = sum(each[0] == key for each in tally.known)
        if count < MOST_PAIRS:
            tally.known.add((key, count))
            yield (
                "no path",
                check_bars(space, [plain.places_of(space, q, "q") for q in pair], budget),
            )


@checking
def check_trajectory(budget, motion, plan):
    """Check the curve of a trajectory of a plan."""
    space = plan.space
    need(isinstance(space, cspace.CSpace | cspace.ArmSpace), "without a map, or in tiles")
    need(len(motion.times) <= 1500, "a long motion")
    if motion.certified and motion.duration:
        pieces, gap = plain.pieces_of_trajectory(motion, space)
        assert gap <= GAP, f"samples are {gap} m or rad from the curve"
        yield "curve", check_motion(space, pieces, budget, plan.exact, plan.keep)


def time_mover(mover, begin):
    """Return a mover as a plain one, in seconds after an instant."""
    shape = robot_of(mover.robot).shape.inner
    need(shape.dim == 2, "movers in space")
    at = float(mover.at) - begin
    if isinstance(mover.motion, planners.Trajectory):
        motion = mover.motion
        t = np.linspace(0.0, motion.duration, 8 * len(motion.times))
        rates = motion.sample(t)[1]
        speeds = np.linalg.norm(rates[:, :2], axis=1), np.abs(rates[:, 2:]).sum(axis=1)

        def bound(t0, t1):
            last = len(t) - 1
            step = max(motion.duration / last, 1e-300)
            first = np.floor((t0 - at) / step).clip(0, last).astype(int)
            ends = np.ceil((t1 - at) / step).clip(0, last).astype(int) + 1
            return [
                1.05 * np.array([s[a:b].max() for a, b in zip(first, ends, strict=True)])
                for s in speeds
            ]

        def place(t):
            return motion.sample(np.maximum(t - at, 0.0))[0]

    else:
        for value in (mover.motion, mover.velocity):
            is_plain = type(value) in (tuple, list, np.ndarray, types.NoneType)
            need(is_plain and np.asarray(value).dtype.names is None, "numbers with labels")
        row = np.asarray(mover.motion, float)
        velocity = np.zeros(2) if mover.velocity is None else np.asarray(mover.velocity, float)

        def bound(t0, t1):
            return np.full(len(t0), np.linalg.norm(velocity)), np.zeros(len(t0))

        def place(t):
            return np.column_stack(
                [row[:2] + (t - at)[:, None] * velocity, np.full(len(t), row[2:].sum())]
            )

    end = at + getattr(mover.motion, "duration", 0.0)
    return apart.Timed(plain.parts_of(shape), place, bound, mover.error, mover.growth, at, end)


def delay(timed, wait):
    """Return a motion that begins later."""
    return timed._replace(
        place=lambda t: timed.place(np.maximum(t - wait, 0.0)),
        bound=lambda t0, t1: timed.bound(t0 - wait, t1 - wait),
    )


@checking
def check_timing(budget, timing, mover, others, margin=0.0, until=None):
    """Check that a timed motion keeps apart; try to refute that it is impossible."""
    begin = float(mover.at)
    robot = time_mover(mover, begin)
    others = [time_mover(each, begin) for each in others]
    took = mover.motion.duration
    last = max([0.0, *(each.end for each in others)])
    end = last + took if until is None else until - begin
    if timing:
        timed = time_mover(
            lanes.Mover(mover.robot, timing.trajectory, begin, None, mover.error, mover.growth),
            begin,
        )
        assert timing.trajectory.duration <= end + 1e-9 * (1.0 + abs(begin)), "it ends too late"
        for other in others:
            yield "timing", apart.check_apart(timed, other, 0.0, end, budget, margin)
    elif timing.reason.startswith("impossible"):
        for wait in np.linspace(0.0, max(end - took, 0.0), 6):
            late = delay(robot, float(wait))
            if took + wait <= end and all(
                apart.check_apart(late, other, 0.0, end, Budget(budget.left // 6), margin)
                for other in others
            ):
                raise AssertionError(
                    f"not impossible: it may wait {wait} s, then drive ({timing.reason})"
                )


@checking
def check_separation(budget, answer, first, second, margin=0.0, **_):
    """Check that two motions that are said to be apart keep the distance that is told."""
    begin, end = answer.interval
    if answer:
        timed = [time_mover(each, begin) for each in (first, second)]
        least = max(margin, (1.0 - 1e-6) * answer.distance)
        yield "separation", apart.check_apart(*timed, 0.0, end - begin, budget, least)


# ---- the watch -----------------------------------------------------------------------------------


def is_asked_by_a_test():
    """Return True if a test has called, because the library asks of maps that it changes, too."""
    return sys._getframe(2).f_globals.get("__name__", "").startswith("tests")


def watch():
    """Let the public calls check their answers."""
    plan, trajectory = planners.plan, planners.Plan.trajectory
    time_around, keep_apart, kind = lanes.time_around, lanes.apart, cspace.CSpace
    disconnected = kind.is_disconnected

    @functools.wraps(plan)
    def plan_and_check(*values, **options):
        try:
            answer = plan(*values, **options)
        except cspace.ConfigurationError as error:
            if "that FREE cells join to" in str(error):
                check_closest(None, *values, **options)
            raise
        if getattr(
            inspect.signature(plan).bind(*values, **options).arguments["goal"], "closest", False
        ):
            check_closest(answer, *values, **options)
        check_plan(answer, *values, **options)
        return answer

    @functools.wraps(trajectory)
    def time_and_check(self, **options):
        answer = trajectory(self, **options)
        check_trajectory(answer, self)
        return answer

    @functools.wraps(time_around)
    def wait_and_check(mover, others, **options):
        answer = time_around(mover, others, **options)
        check_timing(answer, mover, others, **options)
        return answer

    @functools.wraps(keep_apart)
    def keep_apart_and_check(first, second, **options):
        answer = keep_apart(first, second, **options)
        check_separation(answer, first, second, **options)
        return answer

    @functools.wraps(disconnected)
    def ask_and_check(self, q0, q1):
        answer = disconnected(self, q0, q1)
        if is_asked_by_a_test():
            check_disconnected(answer, self, q0, q1)
        return answer

    import planners._plan as home
    from cspace.lanes import _apart, _waiting

    # Warnings point at the first line outside of the library, which is to be the test's.
    inner = {**globals(), "__name__": "planners.watch"}
    code, cells = plan_and_check.__code__, plan_and_check.__closure__
    hidden = types.FunctionType(code, inner, "plan", None, cells)
    home.plan = planners.plan = functools.update_wrapper(hidden, plan_and_check)
    planners.Plan.trajectory = time_and_check
    lanes.time_around = _waiting.time_around = wait_and_check
    lanes.apart = _apart.apart = keep_apart_and_check
    kind.is_disconnected = ask_and_check
