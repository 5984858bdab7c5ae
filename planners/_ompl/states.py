"""Conversion between configurations and states of OMPL, for each kind of space."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Final, NamedTuple, TypeVar

import numpy as np
from ompl import base as ob

from cspace import Space
from cspace.errors import InputError
from cspace.inside import METRES_PER_RADIAN, Floats
from planners._edges.local_planner import LocalPlanner
from planners._edges.own_space import check_space

Configuration = tuple[float, ...]
"""Numbers of a configuration."""

Value = TypeVar("Value")


class StateKind(NamedTuple):
    """Functions that convert between configurations and OMPL's states."""

    make: Callable[[], ob.StateSpace]
    """Creates the state space for straight edges, without bounds."""

    read: Callable[[ob.State], Configuration]
    """Reads the numbers of a configuration from a state."""

    write: Callable[..., None]
    """Writes the numbers of a configuration to a state."""

    periodic_axes: tuple[bool, ...] = ()
    """Whether each number is the angle of a continuous joint."""

    def set_bounds(self, states: ob.StateSpace, lower: Floats, upper: Floats) -> None:
        """Set the bounds of positions, or of joints with limits."""
        is_limited = ~np.array(self.periodic_axes[: len(lower)])
        bounds = ob.RealVectorBounds(int(is_limited.sum()))
        for axis, (low, high) in enumerate(zip(lower[is_limited], upper[is_limited], strict=True)):
            bounds.setLow(axis, float(low))
            bounds.setHigh(axis, float(high))
        if is_limited.any():
            # In a compound space, the vector is the first subspace.
            if not hasattr(states, "setBounds"):
                states = states.getSubspace(0)
            states.setBounds(bounds)

    def of_states(self, query: Callable[..., Value]) -> Callable[..., Value]:
        """Make a function of states from a function of numbers."""
        read = self.read
        return lambda *states: query(*itertools.chain.from_iterable(map(read, states)))


def find_state_kind(space: Space) -> StateKind:
    """Return the conversions between configurations and OMPL's states.

    Raises InputError for a pose of a kind that OMPL has no states for.
    """
    if space.has_poses:
        kind = _STATE_KINDS.get(space.axes)
    elif any(space.is_periodic):
        kind = _make_compound_kind(space.is_periodic, 1.0)
    else:
        kind = _make_vector_kind(space.size)
    if kind is None:
        raise InputError(
            "space",
            f"has the axes {' '.join(space.axes)}",
            f"planners take {', '.join(' '.join(axes) for axes in _STATE_KINDS)}, and joints",
        )
    return kind._replace(periodic_axes=space.is_periodic)


def make_states(edges: LocalPlanner) -> ob.StateSpace:
    """Make OMPL's state space of edges, without bounds."""
    if edges.curve_states is None:
        return find_state_kind(edges.space).make()
    reverses, radius = edges.curve_states
    kind = ob.ReedsSheppStateSpace if reverses else ob.DubinsStateSpace
    return kind(radius)


def check_information(si: object, space: Space) -> None:
    """Raise InputError unless ``si`` has the states of ``space``.

    OMPL would read and write states of another size beyond their memory.
    """
    if not isinstance(si, ob.SpaceInformation):
        raise InputError(
            "si",
            f"is a {type(si).__name__}",
            "it must be an ompl.base.SpaceInformation",
        )
    check_space(space)
    given = _list_parts(si.getStateSpace())
    needed = _list_parts(find_state_kind(space).make())
    if given != needed:
        raise InputError(
            "si",
            f"has states of {', '.join(given)}",
            f"the space has {', '.join(needed)}",
        )


def _list_parts(states: ob.StateSpace) -> list[str]:
    """List a state's parts: type and dimension of simple spaces."""
    if states.isCompound():
        parts = map(states.getSubspace, range(states.getSubspaceCount()))
        return [text for part in parts for text in _list_parts(part)]
    kind = {1: "R", 2: "SO2", 3: "SO3"}.get(states.getType(), f"type {states.getType()}")
    return [f"{kind}({states.getDimension()})"]


def _write_vector(state: ob.State, *q: float) -> None:
    """Write numbers to a state that is a vector."""
    for axis, value in enumerate(q):
        state[axis] = value


def _write_se2(state: ob.State, x: float, y: float, yaw: float) -> None:
    """Write a pose to a state of SE(2)."""
    state.setXY(x, y)
    state.setYaw(yaw)


def _write_se3(state: ob.State, x: float, y: float, z: float, *quaternion: float) -> None:
    """Write a pose to a state of SE(3)."""
    state.setXYZ(x, y, z)
    rotation = state.rotation()
    rotation.x, rotation.y, rotation.z, rotation.w = quaternion


def _read_se3(state: ob.State) -> Configuration:
    """Read a pose from a state of SE(3)."""
    q = state.rotation()
    return state.getX(), state.getY(), state.getZ(), q.x, q.y, q.z, q.w


def _make_vector_kind(size: int) -> StateKind:
    """Create the conversions for vectors."""
    axes = range(size)
    return StateKind(
        make=lambda: ob.RealVectorStateSpace(size),
        read=lambda state: tuple(map(state.__getitem__, axes)),
        write=_write_vector,
    )


def _make_compound_kind(periodic_axes: tuple[bool, ...], weight: float) -> StateKind:
    """Create conversions for a vector and a circle per periodic axis."""
    size = len(periodic_axes)
    circles = np.flatnonzero(periodic_axes).tolist()
    limited = np.flatnonzero(~np.array(periodic_axes)).tolist()
    # The joints with limits, if any, share subspace 0; the circles follow.
    axis_of_circle = dict(enumerate(circles, 1 if limited else 0))

    def make() -> ob.StateSpace:
        """Make the state space, without bounds."""
        states = ob.CompoundStateSpace()
        if limited:
            states.addSubspace(ob.RealVectorStateSpace(len(limited)), 1.0)
        for _ in circles:
            states.addSubspace(ob.SO2StateSpace(), weight)
        # OMPL has no default projection of such a space, and KPIECE needs one.
        states.registerDefaultProjection(ob.SubspaceProjectionEvaluator(states, 0))
        return states

    def read(state: ob.State) -> Configuration:
        """Read the numbers of a state."""
        q = [0.0] * size
        if limited:
            vector = state[0]
            for index, axis in enumerate(limited):
                q[axis] = vector[index]
        for subspace, axis in axis_of_circle.items():
            q[axis] = state[subspace].value
        return tuple(q)

    def write(state: ob.State, *q: float) -> None:
        """Write numbers to a state."""
        if limited:
            _write_vector(state[0], *(q[axis] for axis in limited))
        for subspace, axis in axis_of_circle.items():
            state[subspace].value = math.remainder(q[axis], math.tau)

    return StateKind(make, read, write)


_STATE_KINDS: Final[dict[tuple[str, ...], StateKind]] = {
    ("x", "y"): _make_vector_kind(2),
    ("x", "y", "yaw"): StateKind(
        ob.SE2StateSpace, lambda state: (state.getX(), state.getY(), state.getYaw()), _write_se2
    ),
    ("x", "y", "z"): _make_vector_kind(3),
    ("x", "y", "z", "yaw"): _make_compound_kind((False, False, False, True), METRES_PER_RADIAN),
    ("x", "y", "z", "qx", "qy", "qz", "qw"): StateKind(ob.SE3StateSpace, _read_se3, _write_se3),
}
"""Conversions for rigid bodies, by the axes of the space."""
