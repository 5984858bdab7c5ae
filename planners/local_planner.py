"""The local planner: how two configurations are joined, by a straight edge or along the curve of a car."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob

from cspace.errors import InputError
from cspace.grid import positive
from cspace.space import CSpace
from planners.car_curves import CURVES, CarCurves
from planners.states import Floats, check_space
from planners.straight_edges import Pieces, StraightEdges

CAR_AXES: Final = ("x", "y", "yaw")
EITHER: Final = " or ".join(f"curve={name!r}" for name in CURVES)


class LocalPlanner(Protocol):
    """What a plan has to know of the edges between its configurations."""

    @property
    def space(self) -> CSpace:
        """The map."""

    def states(self) -> ob.StateSpace:
        """OMPL's state space, without bounds."""

    def edge_checker(self) -> Callable[..., bool]:
        """``check`` of the floats of two configurations: whether the edge between them is proven free."""

    def are_free(self, path: Floats) -> bool:
        """Whether every edge of a path is proven free; of a path of one configuration, whether that is."""

    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        """A path in pieces of at most ``step`` metres and ``turn`` radians."""

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        """A path with rows at most a cell and DENSE_TURN apart; and 1 or -1, ahead or back, where the edges tell."""


def check_flag(value: bool, name: str) -> None:
    """Refuse what is neither True nor False.

    Raises
    ------
    InputError
        If it is not.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(name, f"is {value!r}", "it must be True or False", "pass one of them", value=value)


def local_planner(
    space: CSpace, exact: bool = False, curve: str | None = None, turning_radius: float | None = None
) -> LocalPlanner:
    """How configurations of a map are joined.

    Parameters
    ----------
    space : CSpace
    exact : bool
    curve : {"dubins", "reeds-shepp"}, optional
        Straight edges, if left out.
    turning_radius : float, optional
        Metres; for curves, which need it.

    Raises
    ------
    InputError
        If ``space`` is no map; or it is not one of a robot that turns in the plane and a curve is asked for, the
        turning radius is missing, unwanted, or not above zero, the curve is unknown, or ``exact`` is wanted along a
        curve.
    """
    check_space(space)
    check_flag(exact, "exact")
    if curve is None:
        if turning_radius is not None:
            found = f"is {turning_radius!r} and curve is None"
            mend = f"add {EITHER}, or leave the radius out"
            raise InputError("turning_radius", found, "a radius is for curves", mend, value=turning_radius)
        return StraightEdges(space, bool(exact))
    if curve not in CURVES:
        rule = f"it must be {' or '.join(map(repr, CURVES))}, or None for straight edges"
        raise InputError("curve", f"is {curve!r}", rule, "pass one of them", value=curve)
    if space.axes != CAR_AXES:
        found = f"is {curve!r} and the map's configurations are ({', '.join(space.axes)})"
        rule = f"a car turns as it drives in the plane: ({', '.join(CAR_AXES)})"
        raise InputError(
            "curve", found, rule, "build a map of a plane with rotations=72, or leave curve out", value=curve
        )
    if turning_radius is None:
        rule, mend = f"curve={curve!r} needs the radius of its tightest turn", "pass it in metres, e.g. 0.5"
        raise InputError("turning_radius", "is None", rule, mend)
    radius = positive(turning_radius, "turning_radius")
    least, most = 1e-3 * space.grid.spacing, 1e3 * space.grid.spacing
    if not least <= radius <= most:
        rule = f"it must be {least:g} to {most:g} m, so that rounding does not count"
        mend = "for a robot that turns on the spot, leave curve out"
        raise InputError("turning_radius", f"is {radius!r}", rule, mend, value=radius)
    if exact:
        mend = "leave exact out, or build the map with a finer spacing or more rotations"
        raise InputError("exact", f"is True and curve is {curve!r}", "curves are proven by FREE cells alone", mend)
    return CarCurves(space, CURVES.index(curve), radius)
