"""The curves of cars in C++ are Python's, and no pair of poses ends the program."""

import subprocess

import numpy as np
import pytest

from planners._edges.car_curves import MAX_GAP
from planners._edges.cars import CarCurves
from tests.helpers.cpp import SANITIZERS, build_program, why_no_compiler
from tests.helpers.drives import CURVES, drive_pieces, make_drive
from tests.helpers.nav2 import ANSWERS, PACKAGE, list_stubs
from tests.helpers.placements import turn_between

pytestmark = pytest.mark.skipif(bool(why_no_compiler()), reason=why_no_compiler())

QUARTERS = np.pi / 2 * np.arange(-4, 5)
"""Multiples of a quarter turn, up to a whole turn to each side."""


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    target = tmp_path_factory.mktemp("program") / "curves"
    folders = [f"-I{name}" for name in (PACKAGE / "include", *list_stubs("jazzy"))]
    flags = ("-O1", "-D_GLIBCXX_ASSERTIONS", *SANITIZERS, "-fno-sanitize-recover=all", *folders)
    return build_program(target, *flags, source=ANSWERS / "curves.cpp")


def draw_pairs(n, radius, rng):
    """Draw pairs of poses, shape (n, 2, 3): parallel, opposite, in line, equal, or nearly so."""
    q = rng.uniform(-np.pi, np.pi, (n, 2, 3))
    reach = radius * rng.choice([1e-9, 1e-3, 1.0, 4.0, 30.0, 1e4], (n, 1))
    q[:, :, :2] = reach[:, None] * rng.uniform(-1.0, 1.0, (n, 2, 2))
    yaws = q[:, :, 2]
    by_quarters = rng.random((n, 2)) < 0.4
    yaws[by_quarters] = rng.choice(QUARTERS, by_quarters.sum())
    turned = rng.random(n) < 0.6
    yaws[turned, 1] = yaws[turned, 0] + rng.choice(QUARTERS, turned.sum())
    in_line = rng.random(n) < 0.5
    step = (reach * rng.uniform(-1.0, 1.0, (n, 1)))[in_line]
    ahead = np.stack([np.cos(yaws[:, 0]), np.sin(yaws[:, 0])], axis=1)[in_line]
    q[in_line, 1, :2] = q[in_line, 0, :2] + step * ahead
    equal = rng.random(n) < 0.1
    q[equal, 1] = q[equal, 0]
    q[:, 1] += rng.choice([0.0, 1e-16, 1e-12, 1e-9, 1e-6], (n, 3)) * rng.normal(size=(n, 3))
    return q


def find_curves(program, name, radius, pairs, folder):
    """Return the metres and radians of the arcs of C++, shape (n, 5) each."""
    (folder / "pairs").write_bytes(np.ascontiguousarray(pairs, dtype=float).tobytes())
    command = map(str, (program, name, radius, folder / "pairs", folder / "answers"))
    done = subprocess.run(list(command), text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = np.fromfile(folder / "answers").reshape(len(pairs), 2, 5)
    return rows[:, 0], rows[:, 1]


def check_curves(name, radius, pairs, lengths, angles):
    """Drive curves; check that the car can, and that they end at the goal."""
    first, last = pairs[:, 0], pairs[:, 1]
    assert name == "reeds-shepp" or lengths.min() >= 0.0
    turns = np.sign(angles) * np.sign(lengths)
    arcs = turns != 0.0
    np.testing.assert_allclose(np.abs(lengths)[arcs], radius * np.abs(angles)[arcs], rtol=1e-12)
    ends = drive_pieces(first, turns, lengths, radius)
    metres = radius + np.abs(first[:, :2]).max(axis=1) + np.abs(lengths).sum(axis=1)
    away = np.hypot(*(ends - last)[:, :2].T)
    assert np.all(away < 1.1 * MAX_GAP * radius + 2e-12 * metres)
    assert np.abs(turn_between(ends[:, 2], last[:, 2])).max() < 1.1 * MAX_GAP


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("radius", [1e-3, 0.4, 1000.0])
def test_curves_end_at_the_goal_and_are_as_short_as_in_python(program, tmp_path, name, radius):
    pairs = draw_pairs(35_000, radius, np.random.default_rng(0))
    lengths, angles = find_curves(program, name, radius, pairs, tmp_path)
    check_curves(name, radius, pairs, lengths, angles)
    first, last = pairs[:, 0], pairs[:, 1]
    expected = CarCurves(None, make_drive(name, radius)).edge_lengths(first, last)
    found = np.abs(lengths).sum(axis=1)
    # The empty curve joins poses nearer than MAX_GAP, in Python most often.
    turn = np.abs(turn_between(first[:, 2], last[:, 2]))
    gaps = np.maximum(np.hypot(*(last - first)[:, :2].T) / radius, turn)
    assert not found[gaps <= MAX_GAP].any()
    off = np.abs(found - expected) - 1e-12 * expected
    assert off[gaps > MAX_GAP].max() < 1e-9 * radius


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("radius", [1e-12, 1e-9, 1e-6])
def test_a_radius_far_below_the_way_has_curves_too(program, tmp_path, name, radius):
    pairs = draw_pairs(2_000, 1.0, np.random.default_rng(1))
    check_curves(name, radius, pairs, *find_curves(program, name, radius, pairs, tmp_path))


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("number", [np.nan, np.inf, -1e308])
@pytest.mark.parametrize("axis", range(3))
def test_poses_without_a_curve_are_an_error(program, tmp_path, name, number, axis):
    pairs = np.ones((1, 2, 3))
    pairs[0, 1, axis] = number
    with pytest.raises(AssertionError, match="no curve joins two poses"):
        find_curves(program, name, 0.4, pairs, tmp_path)
