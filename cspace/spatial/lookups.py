"""Look-ups in the map of a robot that translates in space."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

from cspace.translating import TranslatingLookups, entry


class SpatialLookups(TranslatingLookups):
    """Look-ups of configurations ``(x, y, z)``."""

    @property
    def _kernels(self) -> ModuleType:
        from cspace.spatial import _kernels

        return _kernels

    @property
    def _walks(self) -> ModuleType:
        from cspace.spatial.walks import _kernels

        return _kernels

    def point_checker(self) -> Callable[..., bool]:
        """``check(x, y, z)``: whether a configuration is FREE."""
        # One compiled call; a table of rows, as the plane has it, is slower here and as large as the map.
        return self._once("point", lambda: entry(self._kernels.point_is_free, self._map, 3))
