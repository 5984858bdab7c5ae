"""What pictures ask of a map, a workspace and a robot: a few public attributes."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cspace.grid import Grid
from cspace.map.record import Map
from cspace.map.storage import Stack
from cspace.rotations import Rotations
from cspace.shapes.shape import Shape

Floats = NDArray[np.float64]


class RobotLike(Protocol):
    """A robot that can be drawn."""

    @property
    def name(self) -> str: ...
    @property
    def dim(self) -> int: ...
    @property
    def shape(self) -> Shape: ...


class WorkspaceLike(Protocol):
    """A workspace whose cells can be drawn."""

    @property
    def grid(self) -> Grid: ...
    @property
    def outer(self) -> NDArray[np.bool_]: ...


class HasPath(Protocol):
    """A plan, or anything else with a path."""

    @property
    def path(self) -> Floats: ...


class MapLike(Protocol):
    """A map that can be drawn."""

    @property
    def grid(self) -> Grid: ...
    @property
    def axes(self) -> tuple[str, ...]: ...
    @property
    def rotations(self) -> Rotations: ...
    @property
    def robot(self) -> RobotLike: ...
    @property
    def workspace(self) -> WorkspaceLike: ...
    @property
    def _map(self) -> Map: ...
    @property
    def _seen(self) -> Stack: ...
    def slice_at(self, rotation: Floats, /) -> NDArray[np.uint8]: ...
