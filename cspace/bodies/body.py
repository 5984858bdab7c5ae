"""Body: what every kind of body has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cspace.errors import GeometryError
from cspace.raster.raster import Raster

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

Floats = NDArray[np.float64]
Surface = tuple[Floats, NDArray[np.int64]]
"""Vertices, shape (V, 3), metres, and triangles, shape (F, 3), as indices into them."""


class Body(ABC):
    """A rigid, closed, bounded set of points in the plane or in space, in a frame of its own, metres.

    Attributes
    ----------
    dim : int
        2 or 3.
    span : float
        Largest modulus of the numbers that the body was computed from, metres.
    """

    dim: int

    @property
    @abstractmethod
    def span(self) -> float: ...

    @property
    @abstractmethod
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the bounding box, shape (dim,) each."""

    @property
    @abstractmethod
    def measure(self) -> float:
        """Area in the plane, volume in space, for people; NaN where it is not known."""

    @abstractmethod
    def rasters(self, spacing: float, margin: float, yaw: float = 0.0, sweep: float = 0.0) -> tuple[Raster, Raster]:
        """Outer and inner raster, as :meth:`cspace.Robot.rasters` tells; bodies in space do not turn."""

    def is_same_turned(self, turn: Floats) -> bool:
        """Whether a quarter or half turn, a matrix of shape (2, 2), maps the body to itself to the last bit."""
        return False

    @property
    def is_round(self) -> bool:
        """Whether every turn in the plane maps the body to itself."""
        return False

    @property
    def geometry(self) -> BaseGeometry:
        """A shapely geometry of a body in the plane, for drawing."""
        raise GeometryError("the body is in space and has no geometry in the plane; ask for its surface instead")

    @property
    def surface(self) -> Surface:
        """Triangles of a body in space, for drawing."""
        raise GeometryError("the body is in the plane and has no surface in space; ask for its geometry instead")


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The array, not to be written."""
    array.setflags(write=False)
    return array
