"""A plan among boxes for each drive, and checks of its motions by differences."""

import dataclasses
import math
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cspace
import planners
from tests.helpers.drives import is_car, make_drive
from tests.helpers.oracles import path_length
from tests.helpers.placements import turn_between

FOOTPRINT = [(-0.4, -0.2), (0.4, -0.2), (0.4, 0.2), (-0.4, 0.2)]
LIMITS = {"max_velocity": 1.2, "max_acceleration": 0.8}
TURNING_LIMITS = {"max_angular_velocity": 1.0, "max_angular_acceleration": 2.0}
SLACK = 1.01
TURNING_RADIUS = 0.5
"""Of the plans of cars, metres."""


def make_limits(rotations, drive="holonomic", **others):
    """Return the hard limits of a robot."""
    turns = rotations and drive not in ("dubins", "reeds-shepp")
    return LIMITS | (TURNING_LIMITS if turns else {}) | others


@cache
def build_plan(seed, drive, rotations):
    """Plan between the two farthest of some free configurations that a path joins."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros((140, 120), dtype=bool)
    for _ in range(14):
        i, j = rng.integers(0, 130), rng.integers(0, 110)
        width, height = rng.integers(3, 20, 2)
        occupied[i : i + width, j : j + height] = True
    workspace = cspace.Workspace.from_array(occupied, 0.05)
    robot = cspace.Robot.polygon(FOOTPRINT) if rotations else cspace.Robot.disc(0.3)
    space = cspace.build(workspace, robot, rotations=rotations)
    free = space.sample_free(200, rng=np.random.default_rng(seed))
    free = free[np.argsort(free[:, 0])]
    options = {"drive": make_drive(drive, TURNING_RADIUS), "time_limit": 0.3}
    for start, goal in zip(free, free[::-1], strict=True):
        try:
            plan = planners.plan(space, start, goal, **options)
        except cspace.ConfigurationError:  # on the border of a cell
            continue
        if plan:
            return plan
    raise AssertionError("no path found")


def replace_rows(plan, rows):
    """Return a plan along rows instead."""
    rows = np.array(rows)
    return dataclasses.replace(plan, path=rows, waypoints=rows)


def sample_evenly(trajectory, count):
    """Return samples of a trajectory at even times from its start to its end."""
    return trajectory.sample(np.linspace(0.0, trajectory.duration, count))


def differentiate(trajectory, t, h=1e-5):
    """Return samples at times, and central differences of positions and velocities."""
    before, now, after = (trajectory.sample(t + step) for step in (-h, 0.0, h))
    steps = after[0] - before[0]
    if "yaw" in trajectory.axes:
        steps[:, -1] = turn_between(0.0, steps[:, -1])
    return now, steps / (2.0 * h), (after[1] - before[1]) / (2.0 * h)


def find_turn_rates(sample, dim):
    """Return angular velocities in the robot's frame, from rows and their derivatives."""
    rows, velocities, _ = sample
    if rows.shape[1] < 7:
        return velocities[:, dim:]
    h = 1e-6
    later = Rotation.from_quat(rows[:, 3:] + h * velocities[:, 3:])
    return (Rotation.from_quat(rows[:, 3:]).inv() * later).as_rotvec() / h


def check_limits(trajectory, slack=SLACK):
    """Check derivatives and limits of a robot's motion, but at jumps of the acceleration."""
    h = 1e-5
    t = np.linspace(2.0 * h, max(trajectory.duration - 2.0 * h, 2.0 * h), 2000)
    (rows, velocities, accelerations), differences, gains = differentiate(trajectory, t, h)
    is_steady = np.abs(gains).max(axis=1) < 1e3  # the curvature of a car may jump
    assert differences[is_steady] == pytest.approx(velocities[is_steady], abs=1e-4)
    by_car = is_car(trajectory._route)
    dim = sum(axis in "xyz" for axis in trajectory.axes)
    # A car's acceleration along its curve and that across have their own limits.
    most = 0.8 * (math.sqrt(2.0) if by_car else 1.0)
    assert np.linalg.norm(velocities[:, :dim], axis=1).max() <= slack * 1.2
    for each in (accelerations, gains):
        assert np.linalg.norm(each[:, :dim], axis=1).max() <= slack * most
    if rows.shape[1] > dim and not by_car:
        before, now, after = (
            find_turn_rates(trajectory.sample(t + step), dim) for step in (-h, 0.0, h)
        )
        assert np.linalg.norm(now, axis=1).max() <= slack * 1.0
        assert np.linalg.norm(after - before, axis=1).max() / (2.0 * h) <= slack * 2.0


def check_goes_on(motion, before, at, space):
    """Check that a motion is proven, and goes on from another one at a time."""
    assert motion.certified and motion.recheck(space).all()
    for old, new in zip(before.sample(at)[:2], motion.sample(0.0)[:2], strict=True):
        np.testing.assert_allclose(new, old, atol=1e-9)


def check_stop(trajectory, at, space):
    """Check that a stop begins as a trajectory goes on, and return it."""
    stop = trajectory.braked(at)
    check_goes_on(stop, trajectory, at, space)
    assert not stop.velocities[-1].any()
    assert trajectory.braked(at).duration == stop.duration <= trajectory.duration - at + 1e-9
    rows = sample_evenly(stop, 900)[0][:, : space.dim]
    assert trajectory.stop_distance(at) == pytest.approx(path_length(rows), abs=1e-3)
    return stop


def pass_near(trajectory, row, size=None):
    """Return the distance of a trajectory from the first numbers of a row, and the speed there."""
    times = np.linspace(0.0, trajectory.duration, 4_000)
    for _ in range(4):
        positions, velocities, _ = trajectory.sample(times)
        steps = (positions - row)[:, :size]
        if "yaw" in trajectory.axes[:size]:
            steps[:, -1] = turn_between(0.0, steps[:, -1])
        gaps = np.linalg.norm(steps, axis=1)
        nearest = int(gaps.argmin())
        step = times[1] - times[0]
        times = np.linspace(times[nearest] - step, times[nearest] + step, 2_000)
    return float(gaps[nearest]), float(np.linalg.norm(velocities[nearest, :2]))
