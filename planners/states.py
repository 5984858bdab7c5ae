"""How a configuration becomes a state of OMPL and back: all that the planners know about a kind of space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from ompl import base as ob

from cspace.arrays import Floats
from cspace.configuration_space import ConfigurationSpace
from cspace.errors import InputError
from cspace.rotations.base import shorter

Configuration = tuple[float, ...]
T = TypeVar("T")

SAME: Final = 1e-12
"""Radians that whole turns, added or taken, may cost."""

TURN_WEIGHT: Final = 0.5
"""Metres that a radian of turn counts as: in OMPL's SE(2) and SE(3), and so in R^3 x SO(2)."""


@dataclass(frozen=True, slots=True)
class StateKind:
    """A kind of states.

    Attributes
    ----------
    make : callable
        Makes OMPL's state space for straight edges, without bounds.
    set_bounds : callable
        Keeps the positions in such a space, which must be bounded, to a box, given by its lowest and highest numbers.
    read : callable
        Reads a configuration off a state.
    write : callable
        Sets a state to a configuration, given as its numbers.
    of_state, of_states : callable
        Make a function of one state, or of two, from one of the numbers of one configuration, or of two. OMPL calls
        them a million times, so that the commonest are written out.
    endless : tuple of bool
        Which numbers are of continuous joints; empty if none is.
    """

    make: Callable[[], ob.StateSpace]
    set_bounds: Callable[[ob.StateSpace, Sequence[float], Sequence[float]], None]
    read: Callable[[ob.State], Configuration]
    write: Callable[..., None]
    of_state: Callable[[Callable[..., T]], Callable[[ob.State], T]]
    of_states: Callable[[Callable[..., T]], Callable[[ob.State, ob.State], T]]
    periodic_axes: tuple[bool, ...] = ()

    def unwind(self, path: Floats) -> Floats:
        """A path of OMPL's, shape (n, size), as edges join its rows, where whole turns count."""
        if not self.periodic_axes:
            return path
        unwind, steps = path.copy(), np.diff(path, axis=0)
        unwind[1:] += np.cumsum(shorter(steps, self.periodic_axes) - steps, axis=0)
        return unwind

    def same(self, one: Floats, other: Floats) -> bool:
        """Whether configurations are the same, shape (..., size)."""
        if not self.periodic_axes:
            return np.array_equal(one, other)
        return bool((np.abs(shorter(one - other, self.periodic_axes)) <= SAME * np.array(self.periodic_axes)).all())


def kind_of(space: ConfigurationSpace) -> StateKind:
    """The kind of states that a space has."""
    known = None if any(space.periodic_axes) else _KINDS.get(space.axes)
    return known or _joints(space.periodic_axes)


def check_space(space: object) -> None:
    """Refuse, by an InputError, what is no map and no space of an arm, as where arguments are swapped."""
    if not isinstance(space, ConfigurationSpace):
        rule = "it must be a CSpace or an ArmSpace"
        hint = (
            "pass what cspace.build, cspace.open or cspace.build_arm_space returns, and mind the order of the arguments"
        )
        raise InputError("space", f"is a {type(space).__name__}", rule, hint, value=space)


def check_information(si: object, space: object) -> None:
    """Refuse, by an InputError, what is no space information of OMPL's, or no map."""
    if not isinstance(si, ob.SpaceInformation):
        given, hint = type(si).__name__, "pass e.g. setup.getSpaceInformation()"
        raise InputError("si", f"is a {given}", "it must be an ompl.base.SpaceInformation", hint, value=si)
    check_space(space)


def _bound(states: ob.StateSpace, lower: Sequence[float], upper: Sequence[float]) -> None:
    bounds = ob.RealVectorBounds(len(lower))
    for axis, (low, high) in enumerate(zip(lower, upper, strict=True)):
        bounds.setLow(axis, float(low))
        bounds.setHigh(axis, float(high))
    states.setBounds(bounds)


def _write_vector(state: ob.State, *q: float) -> None:
    for axis, value in enumerate(q):
        state[axis] = value


def _write_se2(state: ob.State, x: float, y: float, yaw: float) -> None:
    state.setXY(x, y)
    state.setYaw(yaw)


def _write_r3_so2(state: ob.State, x: float, y: float, z: float, yaw: float) -> None:
    _write_vector(state[0], x, y, z)
    state[1].value = yaw


def _read_r3_so2(state: ob.State) -> Configuration:
    place = state[0]
    return place[0], place[1], place[2], state[1].value


def _make_r3_so2() -> ob.StateSpace:
    states = ob.CompoundStateSpace()
    states.addSubspace(ob.RealVectorStateSpace(3), 1.0)
    states.addSubspace(ob.SO2StateSpace(), TURN_WEIGHT)
    # OMPL knows no projection of such a space by itself, and KPIECE asks for one.
    states.registerDefaultProjection(ob.SubspaceProjectionEvaluator(states, 0))
    return states


def _write_se3(state: ob.State, x: float, y: float, z: float, *quaternion: float) -> None:
    state.setXYZ(x, y, z)
    rotation = state.rotation()
    rotation.x, rotation.y, rotation.z, rotation.w = quaternion


def _read_se3(state: ob.State) -> Configuration:
    rotation = state.rotation()
    return state.getX(), state.getY(), state.getZ(), rotation.x, rotation.y, rotation.z, rotation.w


def _by_reading(
    make: Callable[[], ob.StateSpace],
    set_bounds: Callable[[ob.StateSpace, Sequence[float], Sequence[float]], None],
    read: Callable[[ob.State], Configuration],
    write: Callable[..., None],
    periodic_axes: tuple[bool, ...] = (),
) -> StateKind:
    """Make a kind of states whose queries cost more than reading a state."""
    return StateKind(
        make=make,
        set_bounds=set_bounds,
        read=read,
        write=write,
        of_state=lambda query: lambda s: query(*read(s)),
        of_states=lambda query: lambda a, b: query(*read(a), *read(b)),
        periodic_axes=periodic_axes,
    )


_KINDS: Final[dict[tuple[str, ...], StateKind]] = {
    ("x", "y"): StateKind(
        make=lambda: ob.RealVectorStateSpace(2),
        set_bounds=_bound,
        read=lambda s: (s[0], s[1]),
        write=_write_vector,
        of_state=lambda query: lambda s: query(s[0], s[1]),
        of_states=lambda query: lambda a, b: query(a[0], a[1], b[0], b[1]),
    ),
    ("x", "y", "yaw"): StateKind(
        make=lambda: ob.SE2StateSpace(),
        set_bounds=_bound,
        read=lambda s: (s.getX(), s.getY(), s.getYaw()),
        write=_write_se2,
        of_state=lambda query: lambda s: query(s.getX(), s.getY(), s.getYaw()),
        of_states=lambda query: lambda a, b: query(a.getX(), a.getY(), a.getYaw(), b.getX(), b.getY(), b.getYaw()),
    ),
    ("x", "y", "z"): StateKind(
        make=lambda: ob.RealVectorStateSpace(3),
        set_bounds=_bound,
        read=lambda s: (s[0], s[1], s[2]),
        write=_write_vector,
        of_state=lambda query: lambda s: query(s[0], s[1], s[2]),
        of_states=lambda query: lambda a, b: query(a[0], a[1], a[2], b[0], b[1], b[2]),
    ),
    ("x", "y", "z", "yaw"): _by_reading(
        make=_make_r3_so2,
        set_bounds=lambda states, lower, upper: _bound(states.getSubspace(0), lower, upper),
        read=_read_r3_so2,
        write=_write_r3_so2,
    ),
    ("x", "y", "z", "qx", "qy", "qz", "qw"): _by_reading(
        make=lambda: ob.SE3StateSpace(), set_bounds=_bound, read=_read_se3, write=_write_se3
    ),
}
"""By the names of the numbers of a configuration."""


def _joints(periodic_axes: tuple[bool, ...]) -> StateKind:
    """States of joints, of which some are continuous: a vector, or what is composed of one and of circles.

    All count alike: a radian as much as a metre.
    """
    size, circles = len(periodic_axes), np.flatnonzero(periodic_axes).tolist()
    if not circles:
        numbers = range(size)

        def read_vector(state: ob.State) -> Configuration:
            return tuple([state[k] for k in numbers])

        return _by_reading(lambda: ob.RealVectorStateSpace(size), _bound, read_vector, _write_vector)
    limited = np.flatnonzero(~np.array(periodic_axes)).tolist()
    first = bool(limited)  # the subspace of those that have limits comes first, if there are any

    def make() -> ob.StateSpace:
        states = ob.CompoundStateSpace()
        if limited:
            states.addSubspace(ob.RealVectorStateSpace(len(limited)), 1.0)
        for _ in circles:
            states.addSubspace(ob.SO2StateSpace(), 1.0)
        states.registerDefaultProjection(ob.SubspaceProjectionEvaluator(states, 0))
        return states

    def set_bounds(states: ob.StateSpace, lower: Sequence[float], upper: Sequence[float]) -> None:
        if limited:
            _bound(states.getSubspace(0), [lower[k] for k in limited], [upper[k] for k in limited])

    def read(state: ob.State) -> Configuration:
        q = [0.0] * size
        if limited:
            vector = state[0]
            for n, k in enumerate(limited):
                q[k] = vector[n]
        for n, k in enumerate(circles):
            q[k] = state[first + n].value
        return tuple(q)

    def write(state: ob.State, *q: float) -> None:
        if limited:
            _write_vector(state[0], *(q[k] for k in limited))
        for n, k in enumerate(circles):
            state[first + n].value = q[k]

    return _by_reading(make, set_bounds, read, write, periodic_axes)
