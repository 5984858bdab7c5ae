"""How a configuration becomes a state of OMPL and back: all that the planners know about a kind of space."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob

from cspace.errors import InputError
from cspace.rotations import MAX_YAW, TURN
from cspace.space import CSpace

Floats = NDArray[np.float64]
Configuration = tuple[float, ...]
T = TypeVar("T")

TURN_WEIGHT: Final = 0.5
"""Metres that a radian of turn counts as, in OMPL's SE(2) and here in R^3 x SO(2)."""


@dataclass(frozen=True, slots=True)
class StateKind:
    """A kind of states.

    Attributes
    ----------
    axes : tuple of str
        Names of the numbers of a configuration, in their order.
    units : str
        The same in words, for messages.
    dim : int
        How many of them are a position; the others are yaw.
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
        them a million times, so that each is written out.
    """

    axes: tuple[str, ...]
    units: str
    dim: int
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

    def canonical(self, q: Sequence[float], name: str) -> Configuration:
        """A configuration as OMPL's state spaces hold it: yaw in [-pi, pi).

        Raises
        ------
        InputError
            If a yaw is too large to be wrapped exactly.
        """
        yaws = q[self.dim :]
        for yaw in yaws:
            if abs(yaw) > MAX_YAW:
                rule = f"at most {MAX_YAW:.0f} can be wrapped"
                raise InputError(name, f"has a yaw of {yaw:g} rad", rule, "wrap it first", value=tuple(q))
        return (*q[: self.dim], *map(wrap, yaws))

    def steps(self, path: Floats) -> Floats:
        """Differences of the rows of a path, shape (n - 1, dof): of positions, and of yaw along the shorter arc."""
        steps = np.diff(path, axis=0)
        steps[:, self.dim :] -= TURN * np.round(steps[:, self.dim :] / TURN)
        return steps


def wrap(yaw: float) -> float:
    """Yaw in [-pi, pi); unchanged, to the last bit, where it is there already."""
    if -math.pi <= yaw < math.pi:
        return yaw
    turned = (yaw + math.pi) % TURN - math.pi
    return turned if turned < math.pi else -math.pi


def wrapped(yaw: Floats) -> Floats:
    """An array of yaw in [-pi, pi); what is there already is unchanged."""
    turned = (yaw + math.pi) % TURN - math.pi
    turned = np.where(turned >= math.pi, -math.pi, turned)
    return np.where((yaw >= -math.pi) & (yaw < math.pi), yaw, turned)


def check_space(space: object) -> None:
    """Refuse what is no map, as where arguments are swapped.

    Raises
    ------
    InputError
        If it is not a CSpace.
    """
    if not isinstance(space, CSpace):
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


def kind_of(space: CSpace) -> StateKind:
    """The kind of states that a map has."""
    return _KINDS[space.grid.dim, space.dof - space.grid.dim]


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


def _make_r3_so2() -> ob.StateSpace:
    states = ob.CompoundStateSpace()
    states.addSubspace(ob.RealVectorStateSpace(3), 1.0)
    states.addSubspace(ob.SO2StateSpace(), TURN_WEIGHT)
    # OMPL knows no projection of such a space by itself, and KPIECE asks for one.
    states.registerDefaultProjection(ob.SubspaceProjectionEvaluator(states, 0))
    return states


_KINDS: Final[dict[tuple[int, int], StateKind]] = {
    (2, 0): StateKind(
        axes=("x", "y"),
        units="x and y, in metres",
        dim=2,
        make=lambda: ob.RealVectorStateSpace(2),
        positions=_whole,
        read=lambda s: (s[0], s[1]),
        write=_write_vector,
        of_state=lambda ask: lambda s: ask(s[0], s[1]),
        of_states=lambda ask: lambda a, b: ask(a[0], a[1], b[0], b[1]),
    ),
    (2, 1): StateKind(
        axes=("x", "y", "yaw"),
        units="x and y in metres, and yaw in radians",
        dim=2,
        make=lambda: ob.SE2StateSpace(),
        positions=_whole,
        read=lambda s: (s.getX(), s.getY(), s.getYaw()),
        write=_write_se2,
        of_state=lambda ask: lambda s: ask(s.getX(), s.getY(), s.getYaw()),
        of_states=lambda ask: lambda a, b: ask(a.getX(), a.getY(), a.getYaw(), b.getX(), b.getY(), b.getYaw()),
    ),
    (3, 0): StateKind(
        axes=("x", "y", "z"),
        units="x, y and z, in metres",
        dim=3,
        make=lambda: ob.RealVectorStateSpace(3),
        positions=_whole,
        read=lambda s: (s[0], s[1], s[2]),
        write=_write_vector,
        of_state=lambda ask: lambda s: ask(s[0], s[1], s[2]),
        of_states=lambda ask: lambda a, b: ask(a[0], a[1], a[2], b[0], b[1], b[2]),
    ),
    (3, 1): StateKind(
        axes=("x", "y", "z", "yaw"),
        units="x, y and z in metres, and yaw in radians",
        dim=3,
        make=_make_r3_so2,
        positions=lambda states: states.getSubspace(0),
        read=_read_r3_so2,
        write=_write_r3_so2,
        of_state=lambda ask: lambda s: ask(*_read_r3_so2(s)),
        of_states=lambda ask: lambda a, b: ask(*_read_r3_so2(a), *_read_r3_so2(b)),
    ),
}
"""By the length of a position and of what comes after it."""
