"""Chunks of joint targets: whole tubes are proven, against FCL."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace.arms import build_arm_space, build_joint_map
from tests.helpers.arm_oracle import approach_contact, draw_scene, sample_configurations
from tests.helpers.gates import certify_chunk, draw_instants
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import planar_arm, posed_box


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    return [draw_scene(tmp_path_factory.mktemp("scene"), seed)[:2] for seed in range(6)]


def make_post(arm, *center):
    """Build the space of a planar arm with a post, which its foot may touch."""
    return build_arm_space(
        {"post": posed_box((0.2,) * 3, *center)}, arm, allowed_collisions=[("foot", "post")]
    )


@given(number=st.integers(0, 5), seed=seeds)
@examples(25)
def test_no_tube_with_a_contact_is_proven_and_proven_tubes_have_none(scenes, number, seed):
    space, oracle = scenes[number]
    rng = np.random.default_rng(seed)
    free, touching = approach_contact(
        oracle, space.sample_free(rng=rng), sample_configurations(space.arm, rng, 1)[0]
    )
    tracking = rng.uniform(0.0, 0.1, space.dof) * rng.choice([0.0, 1.0], space.dof)
    if oracle.apart(touching) == 0.0:
        # A contact lies in the tube of the second row, away from its motion.
        near = touching + (1.0 - 1e-9) * tracking * rng.choice([-1.0, 1.0], space.dof)
        step = 0.05 * rng.normal(size=space.dof)
        rows = [near - 0.5 * step, near + 0.5 * step, near]
        assert certify_chunk(space, near - step, rows, tracking).proven <= 1
    # Rows lead towards the contact.
    rows = free + np.linspace(-0.3, 0.0, 7)[1:, np.newaxis] * (touching - free + 0.2)
    chunk = certify_chunk(space, free, rows, tracking)
    if chunk.proven:
        points = np.vstack([free, rows[: chunk.proven]])
        for q in draw_instants(points, tracking, rng, 60):
            assert oracle.apart(q) > 0.0
    if chunk.refusal is not None and chunk.refusal.cause == "collision":
        points = np.vstack([free, rows])[chunk.proven : chunk.proven + 2]
        instants = draw_instants(points, 1.5 * tracking, rng, 20)
        assert min(oracle.apart(q, chunk.refusal.names) for q in instants) < 0.6
    largest = np.asarray(chunk.max_tracking)
    if not np.isnan(largest).any():
        assert certify_chunk(space, free, rows, largest).is_proven
        instants = draw_instants(np.vstack([free, rows]), largest, rng, 60)
        assert all(oracle.apart(q) > 0.0 for q in instants)
        more = 1.02 * largest + 1e-4
        assert not certify_chunk(space, free, rows, more).is_proven


def test_without_tracking_as_many_rows_are_proven_as_edges(scenes):
    for space, _ in scenes:
        rng = np.random.default_rng(1)
        starts = np.array([space.sample_free(rng=rng) for _ in range(20)])
        steps = rng.normal(0.0, 0.1, (20, 8, space.dof))
        rows = starts[:, np.newaxis] + np.cumsum(steps, axis=1)
        rows = np.clip(rows, space.arm.lower, space.arm.upper)
        paths = np.concatenate([starts[:, np.newaxis], rows], axis=1)
        expected = np.logical_and.accumulate(space.certify_path(paths), axis=1).sum(axis=1)
        assert certify_chunk(space, starts, rows).proven.tolist() == expected.tolist()
        assert 0 < expected.sum() < expected.size * 8


def test_a_refusal_names_the_pair_that_is_near():
    space = make_post(planar_arm(), 1.5, 0.5)
    chunk = certify_chunk(space, (-0.3, 0.0), [(-0.1, 0.0), (0.1, 0.0), (0.3, 0.0)], 0.01)
    assert chunk.proven == 2
    assert chunk.refusal.row == 2
    assert set(chunk.refusal.names) == {"fore", "post"}
    assert chunk.refusal.message == "row 2: fore is not proven apart from post"
    # Elsewhere the largest error follows from the distance.
    free = certify_chunk(space, (-0.3, 0.0), [(-0.2, 0.0)])
    assert 0.1 < free.max_tracking < 0.3


def test_rows_beyond_limits_or_too_fast_are_refused():
    space = make_post(planar_arm(), 0.0, 5.0)
    past = certify_chunk(space, (0.0, 0.0), [(0.0, 2.9), (0.0, 3.1)])
    assert past.proven == 1
    assert past.refusal[:3] == (1, "limit", ("elbow",))
    assert "exceeds its limits by 0.1," in past.refusal.message
    # The robot itself may be beyond a limit, and comes back.
    assert certify_chunk(space, (0.0, 3.05), [(0.0, 2.9)]).is_proven
    # The velocity limits of the URDF are 1 rad/s.
    rows = [(0.09, 0.0), (0.18, 0.0), (0.30, 0.0)]
    assert certify_chunk(space, (0.0, 0.0), rows).is_proven
    fast = certify_chunk(space, (0.0, 0.0), rows, dt=0.1)
    assert fast.proven == 2
    assert fast.refusal[:3] == (2, "speed", ("shoulder",))
    assert math.isnan(fast.max_tracking)
    assert certify_chunk(space, (0.0, 0.0), rows, dt=0.1, max_velocity=1.3).is_proven
    still = certify_chunk(
        space, (0.1, 0.2), [(0.1, 0.2), (0.1, 0.2), (0.2, 0.2)], dt=0.1, max_velocity=0
    )
    assert still.proven == 2


def test_rows_that_are_no_numbers_are_refused():
    space = make_post(planar_arm(), 0.0, 5.0)
    for bad in (math.nan, math.inf, -math.inf, 1e300):
        chunk = certify_chunk(space, (0.0, 0.0), [(0.1, 0.0), (0.1, bad), (0.1, 0.0)], dt=1.0)
        assert chunk.proven == 1
        assert chunk.refusal.cause == ("limit" if bad == 1e300 else "number")


def test_maps_of_continuous_joints_refuse_turns_beyond_half(tmp_path):
    """The shorter way is another motion, even if the map has lost the arm."""
    space = build_arm_space({}, planar_arm(kind="continuous", limits=None))
    joint_map = build_joint_map(space, 0.1)
    joint_map.save(tmp_path / "joints.zarr")
    for each in (space, joint_map, cspace.open(tmp_path / "joints.zarr")):
        assert each.motion_is_free((-2.0, 0.0), (2.0, 0.0))
        passed = cspace.Gate(each).check_rows((-2.0, 0.0), [(2.0, 0.0)])
        assert passed.state == "hold" and passed.chunk.refusal.names == ("shoulder",)
        assert not passed.chunk and passed.commands.tolist() == [[-2.0, 0.0]]
        with pytest.raises(cspace.InputError, match="turns shoulder by 4 rad from row 0 to row 1"):
            each.certify_path([(-2.0, 0.0), (2.0, 0.0)])
        assert each.certify_path([(-2.0, 0.0), (1.0, 0.0)]).all()
        # The elbow has limits, so that it cannot take another way.
        assert cspace.Gate(each).check_rows((1.0, -2.0), [(1.0, 2.0)]).state == "go"


def test_joint_maps_prove_chunks_and_name_pairs():
    space = make_post(planar_arm(), 1.5, 0.5)
    joint_map = build_joint_map(space, 0.1)
    rng = np.random.default_rng(0)
    rows = np.cumsum(rng.normal(0.0, 0.1, (200, 6, 2)), axis=1)
    starts = np.array([joint_map.sample_free(rng=rng) for _ in range(200)])
    batch = starts[:, np.newaxis] + rows
    proven = certify_chunk(joint_map, starts, batch, (0.05, 0.02)).proven
    assert (proven <= certify_chunk(space, starts, batch, (0.05, 0.02)).proven).all()
    assert 0 < proven.sum() < 1200
    chunk = certify_chunk(joint_map, (-0.3, 0.0), [(-0.1, 0.0), (0.1, 0.0), (0.3, 0.0)])
    assert set(chunk.refusal.names) == {"fore", "post"}


def test_a_gate_follows_the_scene():
    space = make_post(planar_arm(), 0.0, 5.0)
    gate = cspace.Gate(space, tracking=0.01, dt=0.2)
    rows = [(-0.1, 0.0), (0.1, 0.0), (0.3, 0.0)]
    assert gate.check_rows((-0.2, 0.0), rows).state == "go"
    space.add_obstacle("post", posed_box((0.2,) * 3, 1.5, 0.5), touch_links="foot")
    shortened = gate.check_rows((-0.2, 0.0), rows)
    assert shortened.state == "shortened"
    assert shortened.commands.tolist() == [[-0.1, 0.0], [0.1, 0.0], [0.1, 0.0]]
    held = gate.check_rows((0.3, 0.0), rows)
    assert held.state == "hold"
    assert held.commands.tolist() == [[0.3, 0.0]] * 3
