"""Configurations become states of OMPL and back, in every space."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ompl import base as ob

import planners
from planners.states import _KINDS, kind_of, wrap, wrapped
from planning import SPACES, open_map, room

KINDS = list(_KINDS.values())


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: "-".join(kind.axes))
def test_a_state_holds_a_configuration_to_the_last_bit(kind: object) -> None:
    states = kind.make()
    dof = len(kind.axes)
    kind.set_bounds(states, [-5.0] * kind.dim, [7.0] * kind.dim)
    first, second = states.allocState(), states.allocState()
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = tuple(rng.uniform(-3.0, 3.0, 2 * dof).tolist())
        kind.write(first, *q[:dof])
        kind.write(second, *q[dof:])
        assert kind.read(first) == q[:dof] and kind.read(second) == q[dof:]
        assert kind.of_state(lambda *numbers: numbers)(first) == q[:dof]
        assert kind.of_states(lambda *numbers: numbers)(first, second) == q
        assert states.satisfiesBounds(first)
    kind.write(first, *[8.0] * kind.dim, *[0.0] * (dof - kind.dim))
    assert not states.satisfiesBounds(first)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: "-".join(kind.axes))
def test_a_radian_counts_as_half_a_metre(kind: object) -> None:
    states = kind.make()
    kind.set_bounds(states, [0.0] * kind.dim, [9.0] * kind.dim)
    first, second = states.allocState(), states.allocState()
    turns = [0.4] * (len(kind.axes) - kind.dim)
    kind.write(first, *[1.0] * kind.dim, *[0.0] * len(turns))
    kind.write(second, 4.0, *[1.0] * (kind.dim - 1), *turns)
    assert states.distance(first, second) == pytest.approx(3.0 + 0.5 * sum(turns))


def test_each_map_has_states_of_its_own_kind() -> None:
    types = {
        "plane": ob.RealVectorStateSpace,
        "turning": ob.SE2StateSpace,
        "space": ob.RealVectorStateSpace,
        "yawing": ob.CompoundStateSpace,
    }
    for name in SPACES:
        assert len(kind_of(room(name)).axes) == room(name).dof
        assert isinstance(planners.state_space(room(name)), types[name])
    assert room("turning").dof == room("space").dof  # the length of a configuration does not tell the space
    assert kind_of(room("turning")).axes != kind_of(room("space")).axes


def test_steps_turn_along_the_shorter_arc() -> None:
    path = np.array([(0.0, 0.0, 3.0), (1.0, 2.0, -3.0), (1.0, 2.0, 0.0)])
    steps = kind_of(open_map("turning")).steps(path)
    assert steps == pytest.approx(np.array([(1.0, 2.0, 2 * math.pi - 6.0), (0.0, 0.0, 3.0)]))


def test_yaw_is_wrapped_and_left_alone_where_it_is_wrapped_already() -> None:
    angles = np.concatenate([np.linspace(-20.0, 20.0, 997), [-math.pi, math.pi, np.nextafter(math.pi, 0.0)]])
    one_by_one = [wrap(angle) for angle in angles.tolist()]
    assert one_by_one == wrapped(angles).tolist()
    assert all(-math.pi <= angle < math.pi for angle in one_by_one)
    inside = (angles >= -math.pi) & (angles < math.pi)
    assert np.array_equal(wrapped(angles)[inside], angles[inside])
    assert np.cos(one_by_one) == pytest.approx(np.cos(angles)) and np.sin(one_by_one) == pytest.approx(np.sin(angles))
