"""Where the camera stands before a map in space, and what is cut away before it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import finite
from cspace.plot.blocks import Solid
from cspace.plot.spatial import AXES, Journey, near_middle
from cspace.plot.view import Floats
from cspace.states import FREE

if TYPE_CHECKING:
    from cspace.space import CSpace

_ELEVATIONS: Final = {42.0: 0.0, 60.0: 0.05}
"""How high the camera may stand, in degrees, and the share of the path that it must bring to light."""
_ASIDE: Final = 28.0
"""Degrees between the direction of the camera and the shorter side of the map."""
_COARSE: Final = 24
"""Cells along an axis among which FREE ones are asked where there is no path."""
_SAMPLES: Final = 65
"""Points that are asked whether they are seen."""
_PRICES: Final = {2: 0.1, 1: 0.2, 0: 0.2}
"""The share of the path that a cut across an axis must bring to light."""


@dataclass(frozen=True)
class Camera:
    """A camera far away, upright.

    Attributes
    ----------
    elevation, azimuth : float
        Degrees, as matplotlib counts them.
    """

    elevation: float
    azimuth: float

    @property
    def towards(self) -> Floats:
        """Direction to the camera, shape (3,), where every axis is drawn to the same scale."""
        rise, turn = math.radians(self.elevation), math.radians(self.azimuth)
        direction = np.array([math.cos(rise) * math.cos(turn), math.cos(rise) * math.sin(turn), math.sin(rise)])
        # What is zero but for rounding is zero.
        return np.asarray(np.round(direction, 12))

    @property
    def screen(self) -> Floats:
        """Directions to the right and up in the picture, shape (2, 3)."""
        rise, turn = math.radians(self.elevation), math.radians(self.azimuth)
        up = [-math.sin(rise) * math.cos(turn), -math.sin(rise) * math.sin(turn), math.cos(rise)]
        return np.array([[-math.sin(turn), math.cos(turn), 0.0], up])


@dataclass(frozen=True)
class Subject:
    """What is drawn.

    Attributes
    ----------
    classes : ndarray of uint8, shape (nx, ny, nz)
        Class of each cell; the larger, the more important to see.
    least : int
        Smallest class that is solid.
    grown : ndarray, shape (2, 3)
        Lower and upper corner of what must be seen around a configuration, metres.
    """

    classes: NDArray[np.uint8]
    least: int
    grown: Floats


class Aim:
    """The camera and the cut that the caller chose, or else those that show most of the path, or of the free space.

    Attributes
    ----------
    camera : Camera
    solid : Solid
        What is drawn, cut open.
    """

    def __init__(
        self,
        space: CSpace,
        subject: Subject,
        way: Journey,
        stretch: Floats,
        camera: Camera | None,
        cut: dict[int, float] | None,
    ) -> None:
        points = way.samples() if len(way.stations) else _free_points(space)
        points = points[np.linspace(0, len(points) - 1, min(_SAMPLES, len(points))).astype(np.int64)]
        best = math.inf
        for at, price in _cameras(space, stretch) if camera is None else ((camera, 0.0),):
            # Metres that are drawn longer count for less on the way to the camera.
            towards = at.towards / stretch
            for planes in _cuts(space, subject, way, towards) if cut is None else (cut,):
                solid = Solid(space.grid, subject.classes, subject.least, towards, planes)
                hidden = float(solid.hides(points).mean()) if len(points) else 0.0
                loss = hidden + price + (sum(_PRICES[axis] for axis in planes) if cut is None else 0.0)
                if loss < best:
                    best, self.camera, self.solid = loss, at, solid


def _cameras(space: CSpace, stretch: Floats) -> Iterator[tuple[Camera, float]]:
    """Cameras from which to choose, and their prices: the longer side of the map lies across the picture."""
    x, y, _ = space.grid.spacing * np.array(space.grid.shape) * stretch
    middle, other = (-90.0, 90.0) if x >= y else (0.0, 180.0)
    for elevation, price in _ELEVATIONS.items():
        for azimuth in (middle + _ASIDE, middle - _ASIDE, other - _ASIDE, other + _ASIDE):
            yield Camera(elevation, azimuth), price


def check_camera(camera: Any) -> Camera | None:
    """The camera that the caller chose.

    Raises
    ------
    InputError
        If it is not two finite numbers, or looks from beyond straight above or below.
    """
    if camera is None:
        return None
    angles = finite(camera, "camera")
    if angles.shape != (2,) or abs(angles[0]) > 90.0:
        raise InputError(
            f"camera is {camera!r}; it must be (elevation, azimuth) in degrees, the elevation from -90 to 90; pass "
            f"e.g. ({min(_ELEVATIONS):g}, -60)"
        )
    return Camera(*angles.tolist())


def check_cut(space: CSpace, cut: Mapping[str, float] | None) -> dict[int, float] | None:
    """The planes that the caller chose, by axis.

    Raises
    ------
    InputError
        If an axis is not x, y or z, or a plane does not run through the grid.
    """
    if cut is None:
        return None
    if not isinstance(cut, Mapping) or not all(axis in tuple(AXES) for axis in cut):
        raise InputError(f"cut is {cut!r}; it must be a mapping from 'x', 'y' or 'z' to metres; pass e.g. {{'z': 1.5}}")
    planes = {}
    for name, place in cut.items():
        axis, value = AXES.index(name), finite(place, f"cut[{name!r}]")
        low, high = space.grid.lower[axis], space.grid.upper[axis]
        if value.ndim or not low <= value <= high:
            raise InputError(
                f"cut[{name!r}] is {place!r}; it must be one number from {low:g} to {high:g}, where the grid is; pass "
                "a plane that runs through it"
            )
        planes[axis] = float(value)
    return planes


def _cuts(space: CSpace, subject: Subject, way: Journey, towards: Floats) -> Iterator[dict[int, float]]:
    """Cuts from which to choose: none, and one beside the path, or through the middle where there is no path."""
    yield {}
    points, grid = np.concatenate([way.points, way.stations]), space.grid
    if not len(points):
        yield {2: float(near_middle(space)[2])}
        return
    for axis in (2, 1, 0):
        above = towards[axis] > 0.0
        plane = (points[:, axis].max() if above else points[:, axis].min()) + subject.grown[int(above), axis]
        if grid.lower[axis] < plane < grid.upper[axis]:
            yield {axis: float(plane)}


def _free_points(space: CSpace) -> Floats:
    """Middles of some FREE cells, shape (n, 3)."""
    step = math.ceil(max(space.grid.shape) / _COARSE)
    return space.grid.center_of(step * np.argwhere(space.stack[0][::step, ::step, ::step] == FREE))
