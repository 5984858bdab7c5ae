"""What files need to know of a map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cspace.grid import Grid
from cspace.robot import Robot
from cspace.workspace import Workspace


class SavedMap(Protocol):
    """The part of :class:`cspace.CSpace` that files read, so that they stand below it."""

    outside: str
    margin: float
    precision: str
    workspace: Workspace
    robot: Robot
    rotations: Any
    stack: NDArray[np.uint8]
    slice_of: NDArray[np.int64]
    overlaps: NDArray[np.int32] | None
    fields: Mapping[str, NDArray[np.float64]]

    @property
    def grid(self) -> Grid: ...
