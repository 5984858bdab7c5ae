"""Ball sets, whatever they come from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import finite
from cspace.shapes import check_balls

if TYPE_CHECKING:
    from cspace.spectral.descriptors import Bump

Floats = NDArray[np.float64]

ROUNDING: Final = 2.0**-50
"""Bound, with room to spare, of the relative error of the few operations that turn and shift a coordinate."""


@dataclass(frozen=True, eq=False, slots=True)
class BallSet:
    """Balls in one frame.

    Attributes
    ----------
    centers : ndarray of float64, shape (n, d)
        Metres.
    radii : ndarray of float64, shape (n,)
        Metres, above zero.
    """

    centers: Floats
    radii: Floats

    @classmethod
    def of(cls, source: Any, name: str) -> BallSet:
        """The balls of an object.

        Parameters
        ----------
        source : object with ``centers`` and ``radii``, or a pair of them
            Such as the result of a decomposition, a robot of balls, or arrays of shape (n, d) and (n,).
        name : str
            For the message.

        Raises
        ------
        InputError
            If there is no ball, the shapes do not fit, a value is not finite, or a radius is not above zero.
        """
        if isinstance(source, BallSet):
            return source
        if hasattr(source, "centers") and hasattr(source, "radii"):
            pair = (source.centers, source.radii)
        elif isinstance(source, tuple | list) and len(source) == 2:
            pair = (source[0], source[1])
        else:
            raise InputError(
                f"{name} is a {type(source).__name__}; it must have centers and radii, or be a pair of them; "
                "decompose other shapes into balls first"
            )
        if not finite(pair[0], "centers").size:
            raise InputError(f"{name} holds no ball; there must be at least one; decompose other shapes first")
        centers, radii = check_balls(*pair)
        if (radii <= 0.0).any():
            raise InputError(f"{name} has a radius of {radii.min():g}; each must be above zero; drop empty balls")
        return cls(centers, radii)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return int(self.centers.shape[1])

    @property
    def span(self) -> float:
        """Largest modulus of a coordinate, plus the largest radius: to what the rounding is relative, metres."""
        return float(np.abs(self.centers).max() + self.radii.max())

    @property
    def middle(self) -> Floats:
        """Middle of the box around the centers, shape (d,)."""
        return np.asarray((self.centers.min(axis=0) + self.centers.max(axis=0)) / 2)

    def reach(self, middle: Floats) -> float:
        """Radius of the ball around a point that holds all balls."""
        return float((np.linalg.norm(self.centers - middle, axis=1) + self.radii).max())

    def sides(self, middle: Floats) -> Floats:
        """Half the sides of the box around a point that holds all balls, shape (d,)."""
        return np.asarray((np.abs(self.centers - middle) + self.radii[:, None]).max(axis=0))

    def grown(self, distance: float) -> BallSet:
        """The same with ``distance`` added to every radius, metres."""
        return BallSet(self.centers, self.radii + distance)

    def turned(self, matrix: Floats) -> BallSet:
        """The same with every center turned about the origin."""
        return BallSet(self.centers @ matrix.T, self.radii)

    def rounded(self, number: int, up: bool) -> BallSet:
        """The same with at most ``number`` different radii, each ball grown (``up``) or shrunk to the next of them.

        Each serves about as many balls.
        """
        if len(np.unique(self.radii)) <= number:
            return self
        shares = np.arange(number) / number
        if up:
            steps = np.unique(np.quantile(self.radii, 1.0 - shares, method="higher"))
            return BallSet(self.centers, steps[np.searchsorted(steps, self.radii, side="left")])
        steps = np.unique(np.quantile(self.radii, shares, method="lower"))
        return BallSet(self.centers, steps[np.searchsorted(steps, self.radii, side="right") - 1])


def bump_of(bump: Bump | None, *sources: Any) -> Bump:
    """The bump that was asked for, or else that of the sources that have one, or else the default.

    Raises
    ------
    InputError
        If it is no bump, or none was asked for and those of the sources differ.
    """
    from cspace.spectral.descriptors import Bump

    found = {source.bump for source in sources if isinstance(getattr(source, "bump", None), Bump)}
    if bump is None and len(found) > 1:
        raise InputError(f"the descriptors have different bumps, {found}; both must have the same; pass bump=")
    chosen = (found.pop() if found else Bump()) if bump is None else bump
    if not isinstance(chosen, Bump):
        raise InputError(f"bump is {bump!r}; it must be a Bump; pass e.g. Bump(2.0)")
    return chosen
