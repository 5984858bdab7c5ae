"""Free states drawn at random."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from ompl import base as ob
from ompl import util as ou

from cspace.sampling import check_rng

if TYPE_CHECKING:
    from cspace.space import CSpace

_BATCH: Final = 256
"""Draws made at once; one at a time would spend all the time on the way in and out of numpy."""


class FreeStateSampler(ob.ValidStateSampler):
    """Draws states that are FREE, uniformly over the free area, without trial and error.

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
        state[0], state[1] = next(self._points)
        return True

    def sampleNear(self, state: Any, near: Any, distance: float) -> bool:  # noqa: N802 - OMPL's name
        """Set ``state`` to a FREE configuration within ``distance`` of ``near`` along each axis.

        Returns
        -------
        bool
            False, and ``state`` as it was, if none was found in ``getNrAttempts`` draws.
        """
        (low_x, low_y), (high_x, high_y) = self._lower, self._upper
        x, y, numbers = near[0], near[1], self._numbers
        left, right = max(low_x, x - distance), min(high_x, x + distance)
        bottom, top = max(low_y, y - distance), min(high_y, y + distance)
        if left > right or bottom > top:
            return False
        for _ in range(max(1, self.getNrAttempts())):
            x = min(left + next(numbers) * (right - left), right)
            y = min(bottom + next(numbers) * (top - bottom), top)
            if self._is_free(x, y):
                state[0], state[1] = x, y
                return True
        return False


def _points(space: CSpace, rng: np.random.Generator) -> Iterator[list[float]]:
    """FREE configurations without end."""
    while True:
        yield from space.sample_free(_BATCH, rng).tolist()


def _numbers(rng: np.random.Generator) -> Iterator[float]:
    """Uniform numbers from [0, 1) without end."""
    while True:
        yield from rng.random(_BATCH).tolist()
