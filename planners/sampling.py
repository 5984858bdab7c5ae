"""Free states drawn at random."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from ompl import base as ob
from ompl import util as ou

from cspace.map.batches import check_rng
from cspace.space import CSpace
from planners.states import check_information, kind_of

_BATCH: Final = 256
"""Draws made at once; one at a time would spend all the time on the way in and out of numpy."""


class FreeStateSampler(ob.ValidStateSampler):
    """Draws states that are FREE, uniformly over the free area or volume, without trial and error.

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

    def __init__(self, si: ob.SpaceInformation, space: CSpace, rng: np.random.Generator | None = None) -> None:
        check_information(si, space)
        super().__init__(si)
        rng = np.random.default_rng(ou.RNG().getLocalSeed()) if rng is None else check_rng(rng)
        self._kind, self._rotations = kind_of(space), space.rotations
        self._points = _points(space, rng)
        self._numbers = _numbers(rng)
        self._is_free = space.point_checker()
        self._box = tuple(zip(space.grid.lower, space.grid.upper, strict=True))

    def sample(self, state: ob.State) -> bool:
        """Set ``state`` to a FREE configuration.

        Raises
        ------
        ConfigurationError
            If the map has no FREE cell.
        """
        # The map may have been updated since a point was drawn.
        self._kind.write(state, *next(point for point in self._points if self._is_free(*point)))
        return True

    def sampleNear(self, state: ob.State, near: ob.State, distance: float) -> bool:  # noqa: N802 - OMPL's name
        """Set ``state`` to a FREE configuration within ``distance`` of ``near`` along each axis, and in radians.

        Returns
        -------
        bool
            False, and ``state`` as it was, if none was found in ``getNrAttempts`` draws.
        """
        middle, dim = self._kind.read(near), len(self._box)
        rotations, numbers = self._rotations, self._numbers
        box = [
            (max(low, x - distance), min(high, x + distance)) for (low, high), x in zip(self._box, middle, strict=False)
        ]
        if any(low > high for low, high in box):
            return False
        for _ in range(max(1, self.getNrAttempts())):
            place = [min(low + next(numbers) * (high - low), high) for low, high in box]
            place += rotations.near(middle[dim:], min(distance, math.pi), numbers)
            if self._is_free(*place):
                self._kind.write(state, *place)
                return True
        return False


def _points(space: CSpace, rng: np.random.Generator) -> Iterator[list[float]]:
    """FREE configurations without end."""
    while True:
        yield from space.rotations.canonical(space.sample_free(_BATCH, rng)).tolist()


def _numbers(rng: np.random.Generator) -> Iterator[float]:
    """Uniform numbers from [0, 1) without end."""
    while True:
        yield from rng.random(_BATCH).tolist()
