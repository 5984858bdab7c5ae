"""Ways: how two configurations are joined."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import positive
from planners.curves import CURVES, Curve
from planners.straight import Floats, Pieces, Straight

if TYPE_CHECKING:
    from cspace.space import CSpace


class Way(Protocol):
    """What a plan has to know of the edges between its configurations."""

    @property
    def space(self) -> CSpace:
        """The map."""

    def states(self) -> Any:
        """OMPL's state space, without bounds."""

    def edge_checker(self) -> Callable[..., bool]:
        """``check`` of the floats of two configurations: whether the edge between them is proven free."""

    def are_free(self, path: Floats) -> bool:
        """Whether every edge of a path is proven free; of a path of one configuration, whether that is."""

    def lengths(self, path: Floats) -> Floats:
        """Metres of translation along each edge of a path."""

    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        """A path in pieces of at most ``step`` metres and ``turn`` radians."""

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        """A path with rows at most a cell and DENSE_TURN apart; and 1 or -1, ahead or back, where the way tells."""


_MENDS: Final = {
    2: "build the map with e.g. rotations=72",
    3: "leave the curve out: a robot in space only translates",
}
"""For each dimension, what to do about a curve on a map without rotations."""


def way_of(space: CSpace, exact: bool = False, curve: str | None = None, turning_radius: float | None = None) -> Way:
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
        If the map has no rotations and a curve is asked for, the turning radius is missing, unwanted, or not above
        zero, the curve is unknown, or ``exact`` is wanted along a curve.
    """
    if not isinstance(exact, bool | np.bool_):
        raise InputError(f"exact is {exact!r}; it must be True or False; pass one of them")
    if curve is None:
        if turning_radius is not None:
            raise InputError(
                f"turning_radius is {turning_radius!r} and curve is None; a radius is for curves; "
                f"add curve={CURVES[0]!r} or {CURVES[1]!r}, or leave the radius out"
            )
        return Straight(space, bool(exact))
    if curve not in CURVES:
        raise InputError(f"curve is {curve!r}; it must be {' or '.join(map(repr, CURVES))}, or None for straight edges")
    if space.rotations is None:
        raise InputError(
            f"curve is {curve!r} and the map has no rotations; a car turns as it drives; {_MENDS[space.grid.dim]}"
        )
    if turning_radius is None:
        raise InputError(f"curve is {curve!r} and turning_radius is None; a curve needs one; pass it in metres")
    radius = positive(turning_radius, "turning_radius")
    least = 1e-3 * space.grid.spacing
    most = 1e3 * space.grid.spacing
    if not least <= radius <= most:
        raise InputError(
            f"turning_radius is {radius!r}; it must be {least:g} to {most:g} m, so that rounding does not "
            "count; for a robot that turns on the spot, leave curve out"
        )
    if exact:
        raise InputError(
            f"exact is True and curve is {curve!r}; curves are proven by FREE cells alone; leave exact out, or build "
            "the map with a finer spacing or more rotations"
        )
    return Curve(space, CURVES.index(curve), radius)
