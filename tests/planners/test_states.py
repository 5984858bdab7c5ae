"""Conversions between configurations and OMPL states, in every space."""

import numpy as np
import pytest
from ompl import base as ob

import planners
from planners.states import find_state_kind
from tests.helpers.planning import SPACES, build_room

IN_EVERY_SPACE = pytest.mark.parametrize("name", SPACES)


@IN_EVERY_SPACE
def test_a_state_stores_a_configuration_exactly(name: str) -> None:
    dim, size, kind = (
        build_room(name).grid.dim,
        build_room(name).size,
        find_state_kind(build_room(name)),
    )
    states = kind.make()
    kind.set_bounds(states, np.full(dim, -5.0), np.full(dim, 7.0))
    first, second = states.allocState(), states.allocState()
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = tuple(_normalize(rng.uniform(-3.0, 3.0, (2, size)), dim).reshape(-1).tolist())
        kind.write(first, *q[:size])
        kind.write(second, *q[size:])
        assert kind.read(first) == q[:size] and kind.read(second) == q[size:]
        assert kind.of_state(lambda *numbers: numbers)(first) == q[:size]
        assert kind.of_states(lambda *numbers: numbers)(first, second) == q
        assert states.satisfiesBounds(first)
    kind.write(first, *[8.0] * dim, *q[dim:size])
    assert not states.satisfiesBounds(first)


def _normalize(q: np.ndarray, dim: int) -> np.ndarray:
    """Normalise the quaternions of configurations in SE(3)."""
    if q.shape[-1] - dim == 4:
        q[:, dim:] /= np.linalg.norm(q[:, dim:], axis=1, keepdims=True)
    return q


@IN_EVERY_SPACE
def test_a_radian_counts_as_half_a_metre(name: str) -> None:
    dim, size, kind = (
        build_room(name).grid.dim,
        build_room(name).size,
        find_state_kind(build_room(name)),
    )
    states = kind.make()
    kind.set_bounds(states, np.zeros(dim), np.full(dim, 9.0))
    first, second = states.allocState(), states.allocState()
    still, turned = {
        0: ((), ()),
        1: ((0.0,), (0.4,)),
        4: ((0.0, 0.0, 0.0, 1.0), (0.0, np.sin(0.2), 0.0, np.cos(0.2))),
    }[size - dim]
    kind.write(first, *[1.0] * dim, *still)
    kind.write(second, 4.0, *[1.0] * (dim - 1), *turned)
    assert states.distance(first, second) == pytest.approx(3.0 + 0.5 * (0.4 if turned else 0.0))


def test_each_space_has_its_own_type_of_states() -> None:
    types = {
        "plane": ob.RealVectorStateSpace,
        "turning": ob.SE2StateSpace,
        "space": ob.RealVectorStateSpace,
        "yawing": ob.CompoundStateSpace,
        "floating": ob.SE3StateSpace,
    }
    for name in SPACES:
        assert isinstance(planners.state_space(build_room(name)), types[name])
    assert (
        build_room("turning").size == build_room("space").size
    )  # the size alone does not determine the space
    assert find_state_kind(build_room("turning")) is not find_state_kind(build_room("space"))
