"""Free states drawn at random."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from ompl import base as ob
from ompl import util as ou

from cspace.sampling import check_rng
from planners.states import PLANE, SPACE, TURNING, Kind, class_for
from planners.straight import wrap

if TYPE_CHECKING:
    from cspace.space import CSpace

_BATCH: Final = 256
"""Draws made at once; one at a time would spend all the time on the way in and out of numpy."""


class FreeStateSampler(ob.ValidStateSampler):
    """Draws states that are FREE, uniformly over the free area or volume, without trial and error.

    For a map of a robot in space a :class:`SpatialFreeStateSampler` is made, and for one with rotations a
    :class:`TurningFreeStateSampler`; what shall serve such maps derives from those.

    Parameters
    ----------
    si : ompl.base.SpaceInformation
        Of a :func:`planners.state_space`.
    space : CSpace
    rng : numpy.random.Generator, optional
        Source of randomness. If left out, one seeded by OMPL's seed generator, so that ``ompl.util.RNG.setSeed`` makes
        the draws repeatable.

    Raises
    ------
    InputError
        If ``rng`` is not a Generator.
    """

    def __new__(cls, si: Any, space: CSpace, rng: np.random.Generator | None = None) -> FreeStateSampler:
        made: FreeStateSampler = super().__new__(class_for(cls, _CLASSES, space))
        return made

    def __init__(self, si: Any, space: CSpace, rng: np.random.Generator | None = None) -> None:
        super().__init__(si)
        rng = np.random.default_rng(ou.RNG().getLocalSeed()) if rng is None else check_rng(rng)
        self._points = _points(space, rng)
        self._numbers = _numbers(rng)
        self._is_free = space.point_checker()
        self._lower, self._upper = space.grid.lower, space.grid.upper

    def sample(self, state: Any) -> bool:
        """Set ``state`` to a FREE configuration.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        """
        state[0], state[1] = self._draw()
        return True

    def sampleNear(self, state: Any, near: Any, distance: float) -> bool:  # noqa: N802 - OMPL's name
        """Set ``state`` to a FREE configuration within ``distance`` of ``near`` along each axis.

        Returns
        -------
        bool
            False, and ``state`` as it was, if none was found in ``getNrAttempts`` draws.
        """
        box = self._box([near[axis] for axis in range(len(self._lower))], distance)
        if box is None:
            return False
        for _ in range(max(1, self.getNrAttempts())):
            place = self._place(box)
            if self._is_free(*place):
                for axis, value in enumerate(place):
                    state[axis] = value
                return True
        return False

    def _draw(self) -> list[float]:
        """The next draw that still is FREE: the map may have been updated since it was made."""
        return next(point for point in self._points if self._is_free(*point))

    def _box(self, place: Sequence[float], distance: float) -> list[tuple[float, float]] | None:
        """Least and greatest of each coordinate within ``distance`` of a place and in the map; None for nothing."""
        sides = [
            (max(low, value - distance), min(high, value + distance))
            for low, value, high in zip(self._lower, place, self._upper, strict=True)
        ]
        return None if any(low > high for low, high in sides) else sides

    def _place(self, box: list[tuple[float, float]]) -> list[float]:
        """A place drawn from a box."""
        numbers = self._numbers
        return [min(low + next(numbers) * (high - low), high) for low, high in box]


class SpatialFreeStateSampler(FreeStateSampler):
    """The same for states ``(x, y, z)``."""

    def sample(self, state: Any) -> bool:
        """Set ``state`` to a FREE configuration."""
        state[0], state[1], state[2] = self._draw()
        return True


class TurningFreeStateSampler(FreeStateSampler):
    """The same for states ``(x, y, yaw)``, uniformly over the free volume."""

    def sample(self, state: Any) -> bool:
        """Set ``state`` to a FREE configuration."""
        x, y, yaw = self._draw()
        state.setXY(x, y)
        state.setYaw(wrap(yaw))
        return True

    def sampleNear(self, state: Any, near: Any, distance: float) -> bool:  # noqa: N802 - OMPL's name
        """Set ``state`` to a FREE configuration within ``distance`` along x and y, and as many radians in yaw.

        Returns
        -------
        bool
            False, and ``state`` as it was, if none was found in ``getNrAttempts`` draws.
        """
        box = self._box([near.getX(), near.getY()], distance)
        if box is None:
            return False
        numbers, middle, swing = self._numbers, near.getYaw(), min(distance, math.pi)
        for _ in range(max(1, self.getNrAttempts())):
            x, y = self._place(box)
            yaw = wrap(middle + (2.0 * next(numbers) - 1.0) * swing)
            if self._is_free(x, y, yaw):
                state.setXY(x, y)
                state.setYaw(yaw)
                return True
        return False


_CLASSES: Final[dict[Kind, type]] = {
    PLANE: FreeStateSampler,
    SPACE: SpatialFreeStateSampler,
    TURNING: TurningFreeStateSampler,
}


def _points(space: CSpace, rng: np.random.Generator) -> Iterator[list[float]]:
    """FREE configurations without end."""
    while True:
        yield from space.sample_free(_BATCH, rng).tolist()


def _numbers(rng: np.random.Generator) -> Iterator[float]:
    """Uniform numbers from [0, 1) without end."""
    while True:
        yield from rng.random(_BATCH).tolist()
