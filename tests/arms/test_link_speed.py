"""Speeds of links, by differences of poses."""

import numpy as np
import pytest

import cspace
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.strategies import few
from tests.helpers.urdfs import (
    BALL,
    CORNERS,
    RADIUS,
    place_link,
    planar_arm,
    write_crane,
)

STEP = 1e-5


def measure_by_differences(path, arm, q, rate):
    """Return the speeds of points of each link as a function, by differences of poses."""

    def measure(name, points):
        before, after = (
            points @ pose[:3, :3].T + pose[:3, 3]
            for pose in place_link(path, arm, name, q + STEP * np.array([-rate, rate]))
        )
        return np.linalg.norm(after - before, axis=1) / (2.0 * STEP)

    return measure


def list_points(name):
    """Return points of a link of the crane, among which is nearly the fastest."""
    if name == "hand":
        return np.vstack([CORNERS, np.zeros(3)])
    if name == "ball":
        ways = np.random.default_rng(0).normal(size=(4000, 3))
        return BALL + RADIUS * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return np.zeros((1, 3))


@pytest.mark.parametrize("name, gap", [("hand", 1e-6), ("tip", 1e-6), ("ball", 0.06)])
def test_links_are_as_fast_as_their_fastest_points(tmp_path, name, gap):
    path = write_crane(tmp_path)
    arm = cspace.Arm.from_urdf(path)
    rng = np.random.default_rng(1)
    rows, rates = rng.uniform(-1.0, 1.0, (2, 20, arm.dof))
    points = list_points(name)
    for q, rate, speed in zip(rows, rates, arm.link_speed(name, rows, rates), strict=True):
        fastest = measure_by_differences(path, arm, q, rate)(name, points).max()
        # A link of balls counts the farthest point of a ball for each of its corners.
        assert fastest * (1.0 - 1e-6) <= speed <= fastest * (1.0 + gap) + 1e-9
    assert arm.link_speed("base", rows, rates).max() == 0.0


@pytest.mark.parametrize("share", few([1.0, 0.0]))
def test_bounds_hold_for_a_while(tmp_path, share):
    path = write_crane(tmp_path)
    arm = cspace.Arm.from_urdf(path)
    rng = np.random.default_rng(2)
    for name in ("boom", "hand", "tip", "ball"):
        q, rate, gain = rng.uniform(-0.8, 0.8, (3, 10, arm.dof))
        gain *= share
        within = rng.uniform(0.0, 0.5, 10)
        most = np.abs(rate) + within[:, np.newaxis] * np.abs(gain)
        bounds = arm.link_speed(name, q, rate, within, most, np.abs(gain))
        t = np.linspace(-1.0, 1.0, 101)[:, np.newaxis, np.newaxis] * within[:, np.newaxis]
        speeds = arm.link_speed(name, q + t * (rate + 0.5 * t * gain), rate + t * gain)
        assert (speeds <= bounds * (1.0 + 1e-12)).all()
        # They are not much larger for short times.
        short = arm.link_speed(name, q, rate, 1e-6, most, np.abs(gain))
        np.testing.assert_allclose(short, arm.link_speed(name, q, rate), atol=1e-4)


def test_attached_objects_and_bases_count():
    arm = planar_arm()
    box = cspace.Robot.box((0.2, 0.2, 0.2)).shape
    pose = np.eye(4)
    pose[0, 3] = 1.4
    held = arm.attach("box", box, "fore", pose)
    # Both joints turn at 1 rad/s with the arm straight.
    rate = (1.0, 1.0)
    assert held.link_speed("fore", (0, 0), rate) == pytest.approx(np.hypot(3.0, 0.1), rel=1e-12)
    assert held.link_speed("box", (0, 0), rate) == pytest.approx(np.hypot(4.0, 0.2), rel=1e-12)
    assert held.link_speed("upper", (0, 0), rate) == pytest.approx(np.hypot(1.0, 0.05), rel=1e-12)


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning", "ignore:.*without collision geometry")
@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_real_links_are_as_fast_as_their_points(data, name):
    path = data / "arms" / name / f"{name}.urdf"
    arm = cspace.Arm.from_urdf(path, path.with_suffix(".srdf"))
    rng = np.random.default_rng(3)
    for _ in range(10):
        q = rng.uniform(arm.lower, arm.upper)
        rate = rng.uniform(-1.0, 1.0, arm.dof)
        measure = measure_by_differences(path, arm, q, rate)
        for solid in arm.links:
            to_link = np.linalg.inv(arm.placements[solid.name].pose)
            parts = [part.bounds_pair[0].boundary.simplices.reshape(-1, 3) for part in solid.parts]
            points = np.vstack(parts) @ to_link[:3, :3].T + to_link[:3, 3]
            points = np.vstack([points, np.zeros(3)])
            found = arm.link_speed(solid.name, q, rate)
            assert found == pytest.approx(measure(solid.name, points).max(), rel=1e-8, abs=1e-9)


@refusals(
    "call, message",
    (lambda arm: arm.link_speed("four", (0, 0), (0, 0)), "link is 'four'"),
    (lambda arm: arm.link_speed("fore", (0, 0), (0, np.nan)), "velocity"),
    (lambda arm: arm.link_speed("fore", (0, 0, 0), (0, 0)), "q"),
    (lambda arm: arm.link_speed("fore", (0, 0), (0, 0), np.inf), "within"),
    (lambda arm: arm.link_speed("fore", (0, 0), (0, 0), 1.0, (1,)), "max_velocity"),
    (lambda arm: arm.link_speed("fore", (0, 0), (0, 0), 1.0, None, (1, 1, 1)), "max_acceleration"),
    (lambda arm: arm.link_speed("fore", [(0, 0)] * 2, [(0, 0)] * 3), "q has shape (2, 2)"),
)
def test_speeds_of_what_is_no_motion_are_refused(call, message):
    check_refused(lambda: call(planar_arm()), message)
