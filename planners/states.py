"""How OMPL's states hold configurations: a list of numbers in the plane, named ones for a robot that turns."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace.space import CSpace


def _read_plane(state: Any) -> tuple[float, ...]:
    return state[0], state[1]


def _read_turning(state: Any) -> tuple[float, ...]:
    return state.getX(), state.getY(), state.getYaw()


def _write_plane(state: Any, q: Any) -> None:
    state[0], state[1] = q


def _write_turning(state: Any, q: Any) -> None:
    x, y, yaw = q
    state.setXY(x, y)
    state.setYaw(yaw)


READ: Final[dict[int, Callable[[Any], tuple[float, ...]]]] = {2: _read_plane, 3: _read_turning}
"""For each dof, what reads a configuration off a state."""

WRITE: Final[dict[int, Callable[[Any, Any], None]]] = {2: _write_plane, 3: _write_turning}
"""For each dof, what sets a state to a configuration."""


def kind_for(asked: type, kinds: dict[int, type], space: CSpace) -> type:
    """Which class to make an object of, so that no callback has to ask what its states are like.

    Parameters
    ----------
    asked : type
        What was called.
    kinds : dict
        The class for each dof; the one for 2 is the public one, and the others derive from it.
    space : CSpace

    Raises
    ------
    InputError
        If a class derived from that of another dof was called.
    """
    if asked is kinds[2]:
        return kinds[space.dof]
    turning = issubclass(asked, kinds[3])
    if turning != (space.dof == 3):
        raise InputError(
            f"{asked.__name__} derives from {kinds[3 if turning else 2].__name__} and the map has {space.dof} degrees "
            f"of freedom; derive it from {kinds[space.dof].__module__}.{kinds[space.dof].__name__}"
        )
    return asked
