"""Look-ups in the map of a robot that translates in the plane."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from cspace.translating import TranslatingLookups, entry


class PlaneLookups(TranslatingLookups):
    """Look-ups of configurations ``(x, y)``."""

    @property
    def _kernels(self) -> ModuleType:
        from cspace import _kernels

        return _kernels

    @property
    def _walks(self) -> ModuleType:
        return self._kernels

    def point_checker(self) -> Callable[..., bool]:
        """``check(x, y)``: whether a configuration is FREE."""
        # The last row and column stand twice, for points on the grid's upper border.
        rows = self._once("rows", lambda: table_of(self._state))
        lower_x, lower_y, spacing, upper_x, upper_y = self._frame.tolist()
        state_at = self._once("state of", lambda: entry(self._kernels.state_at, self._map, 2))

        def check(x: float, y: float) -> bool:
            if lower_x <= x <= upper_x and lower_y <= y <= upper_y:
                return not rows[int((x - lower_x) / spacing)][int((y - lower_y) / spacing)]
            return not state_at(x, y)

        return check


def table_of(state: NDArray[np.uint8]) -> list[bytes]:
    """The rows of a map, each and all with the last entry twice, for quick look-ups from Python."""
    return [row.tobytes() for row in np.pad(state, ((0, 1), (0, 1)), mode="edge")]
