"""How a configuration becomes a state of OMPL and back: all that the planners know about a kind of space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob

from cspace.configuration_map import ConfigurationMap
from cspace.errors import InputError
from cspace.space import CSpace

Floats = NDArray[np.float64]
Configuration = tuple[float, ...]
T = TypeVar("T")

TURN_WEIGHT: Final = 0.5
"""Metres that a radian of turn counts as: in OMPL's SE(2) and SE(3), and so in R^3 x SO(2)."""


@dataclass(frozen=True, slots=True)
class StateKind:
    """A kind of states.

    Attributes
    ----------
    make : callable
        Makes OMPL's state space for straight edges, without bounds.
    positions : callable
        The part of such a space that the bounds belong to.
    read : callable
        Reads a configuration off a state.
    write : callable
        Sets a state to a configuration, given as its numbers.
    of_state, of_states : callable
        Make a function of one state, or of two, from one of the numbers of one configuration, or of two. OMPL calls
        them a million times, so that the commonest are written out.
    """

    make: Callable[[], ob.StateSpace]
    positions: Callable[[ob.StateSpace], ob.StateSpace]
    read: Callable[[ob.State], Configuration]
    write: Callable[..., None]
    of_state: Callable[[Callable[..., T]], Callable[[ob.State], T]]
    of_states: Callable[[Callable[..., T]], Callable[[ob.State, ob.State], T]]

    def set_bounds(self, states: ob.StateSpace, lower: Sequence[float], upper: Sequence[float]) -> None:
        """Keep the positions of a state space to a box."""
        bounds = ob.RealVectorBounds(len(lower))
        for axis, (low, high) in enumerate(zip(lower, upper, strict=True)):
            bounds.setLow(axis, float(low))
            bounds.setHigh(axis, float(high))
        self.positions(states).setBounds(bounds)


def kind_of(space: CSpace) -> StateKind:
    """The kind of states that a map has."""
    return _KINDS[space.axes]


def check_space(space: object) -> None:
    """Refuse what is no map, as where arguments are swapped.

    Raises
    ------
    InputError
        If it is not a CSpace.
    """
    if not isinstance(space, ConfigurationMap):
        mend = "pass what cspace.build or cspace.open returns, and mind the order of the arguments"
        raise InputError("space", f"is a {type(space).__name__}", "it must be a CSpace", mend, value=space)


def check_information(si: object, space: object) -> None:
    """Refuse what is no space information of OMPL's, or no map.

    Raises
    ------
    InputError
        If one of the two is of another type.
    """
    if not isinstance(si, ob.SpaceInformation):
        rule, mend = "it must be an ompl.base.SpaceInformation", "pass e.g. setup.getSpaceInformation()"
        raise InputError("si", f"is a {type(si).__name__}", rule, mend, value=si)
    check_space(space)


def _whole(states: ob.StateSpace) -> ob.StateSpace:
    return states


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


def _of_r3_so2(ask: Callable[..., T]) -> Callable[[ob.State], T]:
    def answer(state: ob.State) -> T:
        place = state[0]
        return ask(place[0], place[1], place[2], state[1].value)

    return answer


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


def _of_se3(ask: Callable[..., T]) -> Callable[[ob.State], T]:
    def answer(state: ob.State) -> T:
        turn = state.rotation()  # each reading of it makes a new object
        return ask(state.getX(), state.getY(), state.getZ(), turn.x, turn.y, turn.z, turn.w)

    return answer


_KINDS: Final[dict[tuple[str, ...], StateKind]] = {
    ("x", "y"): StateKind(
        make=lambda: ob.RealVectorStateSpace(2),
        positions=_whole,
        read=lambda s: (s[0], s[1]),
        write=_write_vector,
        of_state=lambda ask: lambda s: ask(s[0], s[1]),
        of_states=lambda ask: lambda a, b: ask(a[0], a[1], b[0], b[1]),
    ),
    ("x", "y", "yaw"): StateKind(
        make=lambda: ob.SE2StateSpace(),
        positions=_whole,
        read=lambda s: (s.getX(), s.getY(), s.getYaw()),
        write=_write_se2,
        of_state=lambda ask: lambda s: ask(s.getX(), s.getY(), s.getYaw()),
        of_states=lambda ask: lambda a, b: ask(a.getX(), a.getY(), a.getYaw(), b.getX(), b.getY(), b.getYaw()),
    ),
    ("x", "y", "z"): StateKind(
        make=lambda: ob.RealVectorStateSpace(3),
        positions=_whole,
        read=lambda s: (s[0], s[1], s[2]),
        write=_write_vector,
        of_state=lambda ask: lambda s: ask(s[0], s[1], s[2]),
        of_states=lambda ask: lambda a, b: ask(a[0], a[1], a[2], b[0], b[1], b[2]),
    ),
    ("x", "y", "z", "yaw"): StateKind(
        make=_make_r3_so2,
        positions=lambda states: states.getSubspace(0),
        read=_read_r3_so2,
        write=_write_r3_so2,
        of_state=_of_r3_so2,
        of_states=lambda ask: lambda a, b: ask(*_read_r3_so2(a), *_read_r3_so2(b)),
    ),
    ("x", "y", "z", "qx", "qy", "qz", "qw"): StateKind(
        make=lambda: ob.SE3StateSpace(),
        positions=_whole,
        read=_read_se3,
        write=_write_se3,
        of_state=_of_se3,
        of_states=lambda ask: lambda a, b: ask(*_read_se3(a), *_read_se3(b)),
    ),
}
"""By the names of the numbers of a configuration."""
