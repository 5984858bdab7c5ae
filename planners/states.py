"""What OMPL's states are like on a map: in the plane, in space, and for a robot that turns in the plane."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from ompl import base as ob

from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace.space import CSpace


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of states.

    Attributes
    ----------
    axes : tuple of str
        Names of the numbers of a configuration, in their order.
    units : str
        The same in words, for messages.
    states : callable
        Makes OMPL's state space for straight edges, without bounds.
    read : callable
        Reads a configuration off a state.
    write : callable
        Sets a state to a configuration.
    """

    axes: tuple[str, ...]
    units: str
    states: Callable[[], Any]
    read: Callable[[Any], tuple[float, ...]]
    write: Callable[[Any, Any], None]

    def __str__(self) -> str:
        return f"({', '.join(self.axes)})"


def kind_of(space: CSpace) -> Kind:
    """The kind of states that a map has."""
    if space.rotations is not None:
        return TURNING
    return _BY_DIMENSION[space.grid.dim]


def class_for(asked: type, classes: Mapping[Kind, type], space: CSpace) -> type:
    """Which class to make an object of, so that no callback has to ask what its states are like.

    Parameters
    ----------
    asked : type
        What was called.
    classes : mapping
        The class for each kind; the one for the plane is the public one, and the others derive from it.
    space : CSpace

    Raises
    ------
    InputError
        If a class derived from that of another kind was called.
    """
    wanted = kind_of(space)
    if asked is classes[PLANE]:
        return classes[wanted]
    served = next((kind for kind in (SPACE, TURNING) if issubclass(asked, classes[kind])), PLANE)
    if served is not wanted:
        right = classes[wanted]
        raise InputError(
            f"{asked.__name__} derives from {classes[served].__name__}, which is for configurations {served}, and "
            f"those of the map are {wanted}; derive it from {right.__module__}.{right.__name__}"
        )
    return asked


def _read_plane(state: Any) -> tuple[float, ...]:
    return state[0], state[1]


def _read_space(state: Any) -> tuple[float, ...]:
    return state[0], state[1], state[2]


def _read_turning(state: Any) -> tuple[float, ...]:
    return state.getX(), state.getY(), state.getYaw()


def _write_vector(state: Any, q: Any) -> None:
    for axis, value in enumerate(q):
        state[axis] = value


def _write_turning(state: Any, q: Any) -> None:
    x, y, yaw = q
    state.setXY(x, y)
    state.setYaw(yaw)


PLANE: Final = Kind(("x", "y"), "x and y, in metres", lambda: ob.RealVectorStateSpace(2), _read_plane, _write_vector)
SPACE: Final = Kind(
    ("x", "y", "z"), "x, y and z, in metres", lambda: ob.RealVectorStateSpace(3), _read_space, _write_vector
)
TURNING: Final = Kind(
    ("x", "y", "yaw"),
    "x and y in metres, and yaw in radians",
    lambda: ob.SE2StateSpace(),
    _read_turning,
    _write_turning,
)

_BY_DIMENSION: Final = {2: PLANE, 3: SPACE}
