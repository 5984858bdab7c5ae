"""Laws of public calls that take a plan, a trajectory, movers or places, over draws of these.

No error but ours comes out of them, and what they answer is replayed by tests/checker, whose watch
tests/conftest.py starts.
"""

import pickle
from contextlib import suppress

import matplotlib.pyplot as plt
import numpy as np
import pytest
from hypothesis import example, given

import planners
from cspace import lanes
from cspace.errors import CspaceError, InputError
from tests.helpers import any_plan
from tests.helpers.drives import WORDS, make_drive
from tests.helpers.motions import sample_evenly
from tests.helpers.placements import turn_between
from tests.helpers.strategies import examples, seeds

LAWS = {}
"""Law of each public call, by its name."""


def law(*names):
    """Register the law of calls."""

    def register(function):
        LAWS.update(dict.fromkeys(names, function))
        return function

    return register


def draw_motion(rng, *kinds):
    """Draw a plan, perhaps of some kinds of maps, and its trajectory."""
    drawn = any_plan.draw_plan(rng, str(rng.choice(kinds)) if kinds else None)
    return drawn, drawn.plan.trajectory(**any_plan.draw_limits(rng, drawn.plan))


@law("planners.plan", "planners.Near", "cspace.Space.find_goals")
def plan_between_places(rng, folder):
    space = any_plan.draw_room(rng)
    word = str(rng.choice(WORDS)) if space.axes == ("x", "y", "yaw") else None
    start, goal, options = any_plan.draw_question(rng, space, make_drive(word, 0.3))
    plan = planners.plan(space, start, goal, **options)
    assert bool(plan) == plan.certified and not (plan and plan.is_disconnected)
    assert not (plan.is_connected and plan.is_disconnected)
    del options["via"]
    again = planners.plan(space, start, goal, previous=plan, **options)
    assert bool(again) == again.certified


@law("planners.Plan.recheck", "planners.Plan.explain", "planners.Plan.corridor")
def ask_a_plan(rng, folder):
    plan = any_plan.draw_plan(rng).plan
    assert plan.recheck().all()
    with suppress(InputError):  # regions are of maps of the plane
        assert plan.corridor().regions
    with suppress(InputError):
        assert str(plan.explain())


@law("planners.Plan.to_path", "planners.Plan.to_csv", "planners.Plan.to_json", "planners.Plan.plot")
def write_a_plan(rng, folder):
    plan = any_plan.draw_plan(rng).plan
    assert len(plan.to_path().poses) == len(plan.path) <= len(plan.to_path(step=0.05).poses) + 2
    plan.to_csv(folder / "plan.csv", overwrite=True)
    plan.to_json(folder / "plan.json", overwrite=True)
    rows = np.loadtxt(folder / "plan.csv", delimiter=",", skiprows=1, ndmin=2)
    np.testing.assert_array_equal(rows[:, : plan.path.shape[1]], plan.path)
    plan.plot()
    plt.close("all")


@law("planners.Plan.trajectory", "planners.Trajectory.recheck", "planners.Trajectory.sample")
def time_a_plan(rng, folder):
    drawn, motion = draw_motion(rng)
    assert motion.certified and motion.recheck(drawn.space).all()
    rows = motion.sample([-1.0, motion.duration + 1.0])[0]
    np.testing.assert_allclose(
        rows[:, : drawn.space.dim], motion.positions[[0, -1], : drawn.space.dim], atol=1e-9
    )
    after = float(rng.uniform(0.0, motion.duration))
    assert motion.recheck(drawn.space, after=after).all()


@law(
    "planners.Trajectory.braked",
    "planners.Trajectory.starts_after",
    "planners.Trajectory.stop_distance",
)
def go_on(rng, folder):
    drawn, motion = draw_motion(rng)
    at = float(rng.uniform(0.0, motion.duration))
    stop = motion.braked(at)
    assert stop.recheck(drawn.space).all() and motion.stop_distance(at) >= 0.0
    for mine, old in zip(stop.sample(0.0)[:2], motion.sample(at)[:2], strict=True):
        np.testing.assert_allclose(mine[: drawn.space.dim], old[: drawn.space.dim], atol=1e-7)
    start = motion.starts_after(at)[-1]
    plan = planners.plan(drawn.space, start, drawn.start, **drawn.options)
    limits = any_plan.draw_limits(np.random.default_rng(0), drawn.plan)
    onward = plan.trajectory(**limits, after=motion, at=at)
    assert onward.certified and onward.recheck(drawn.space).all()


@law(
    "planners.Trajectory.sample_uniform",
    "planners.Trajectory.to_path",
    "planners.Trajectory.to_csv",
)
def write_a_motion(rng, folder):
    drawn, motion = draw_motion(rng)
    uniform = motion.sample_uniform(20.0)
    rows = motion.sample(uniform.times)[0]
    dim = drawn.space.dim
    np.testing.assert_allclose(uniform.positions[:, :dim], rows[:, :dim], atol=1e-9)
    assert len(motion.to_path().poses) == len(motion.times)
    motion.to_csv(folder / "motion.csv", overwrite=True)
    same = pickle.loads(pickle.dumps(motion))
    np.testing.assert_array_equal(same.positions, motion.positions)


@law("planners.Trajectory.to_twists", "planners.Trajectory.steering", "planners.Trajectory.plot")
def show_a_motion(rng, folder):
    _, motion = draw_motion(rng)
    with suppress(InputError):  # for robots that drive
        assert len(motion.to_twists()) == len(motion.times)
    with suppress(InputError):  # for cars
        assert np.isfinite(motion.steering(0.3)).all()
    motion.plot()
    plt.close("all")
    assert (np.diff(motion.via_times) >= 0.0).all()


@law("planners.Trajectory.along", "planners.Trajectory.to_joint_trajectory")
def refuse_poses(rng, folder):
    drawn, motion = draw_motion(rng)
    with pytest.raises(InputError):
        planners.Trajectory.along(drawn.space, drawn.plan.path, max_acceleration=1.0)
    with pytest.raises(InputError):
        motion.to_joint_trajectory()


@law("cspace.lanes.apart", "cspace.lanes.Mover")
def keep_apart(rng, folder):
    drawn, motion = draw_motion(rng, "plane", "yaw", "yaw", "yaw in space")
    robot, others, options = any_plan.draw_movers(rng, drawn.space, motion)
    for other in others:
        with suppress(InputError):  # they touch at the start
            lanes.apart(robot, other, **options)


@law("cspace.lanes.time_around", "cspace.lanes.Timing")
def wait_for_others(rng, folder):
    drawn, motion = draw_motion(rng, "plane", "yaw", "yaw", "yaw in space")
    robot, others, options = any_plan.draw_movers(rng, drawn.space, motion)
    timing = lanes.time_around(robot, others, **options)
    if not timing:
        assert timing.trajectory is None and timing.reason
        return
    timed = timing.trajectory
    assert timed.certified and timed.recheck(drawn.space).all()
    # It keeps the path, its ends, and the limits of the trajectory.
    dim = drawn.space.dim
    way = np.stack([sample_evenly(each, 400)[0] for each in (motion, timed)])[:, :, :dim]
    gaps = np.linalg.norm(way[1, ::20, None] - way[0], axis=2).min(axis=1)
    step = np.linalg.norm(np.diff(way[0], axis=0), axis=1).max()
    assert gaps.max() <= step + 1e-6
    fastest = [
        np.linalg.norm(sample_evenly(each, 400)[1][:, :dim], axis=1).max()
        for each in (motion, timed)
    ]
    assert fastest[1] <= fastest[0] * 1.01 + 1e-9
    turned = [
        turn_between(0.0, each[0] - each[-1])
        for each in (motion.positions[:, dim:], timed.positions[:, dim:])
    ]
    np.testing.assert_allclose(*turned, atol=1e-6)


@pytest.mark.parametrize("name", sorted({each.__name__ for each in LAWS.values()}))
@examples(10)
@given(seed=seeds)
@example(seed=6)
@example(seed=7)
def test_any_draw_gets_an_answer_or_our_error(name, tmp_path_factory, seed):
    call = next(each for each in LAWS.values() if each.__name__ == name)
    rng = np.random.default_rng(seed)
    with suppress(CspaceError):
        call(rng, tmp_path_factory.getbasetemp())
