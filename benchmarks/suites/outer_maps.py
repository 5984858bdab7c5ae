"""The outer map, by our engines and by peers: where a robot meets obstacles, with everything outside the map free."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks.report import is_here
from benchmarks.suites.stamping import stamp
from cspace import Robot, Workspace
from cspace.arrays import Bools
from cspace.engines import METHODS as METHODS
from cspace.raster import Raster

Call = Callable[[], Bools]


def ours(workspace: Workspace, robot: Robot, method: str) -> Bools:
    """The outer map of a robot that only translates, from its shape on."""
    space = cspace.build(workspace, robot, inner=False, outside="free", method=method)
    return space.state.view(np.bool_)  # FREE is 0 and MIXED 1


def named(method: str) -> str:
    """What one of our engines is called in reports."""
    return f'ours, "{method}"'


def convolved(
    convolve: Callable[..., NDArray[Any]], occupied: NDArray[Any], kernel: NDArray[Any], raster: Raster
) -> Bools:
    """One of SciPy's convolutions.

    Parameters
    ----------
    convolve : callable
        ``scipy.signal.fftconvolve`` or the like.
    occupied : ndarray of float
    kernel : ndarray of float
        The cells of the raster, flipped.
    raster : Raster
    """
    whole = convolve(occupied, kernel, mode="full")
    window = tuple(slice(high, high + n) for high, n in zip(raster.upper, occupied.shape, strict=True))
    return np.asarray(whole[window] > 0.5)


def binary_dilation(occupied: Bools, raster: Raster) -> Bools:
    """SciPy's morphology."""
    from scipy import ndimage

    # Centred by SciPy on shape // 2, which is where a disc around the reference point has its own centre.
    dilated: Bools = ndimage.binary_dilation(occupied, np.flip(raster.cells))
    return dilated


def dilation(occupied: Bools, raster: Raster) -> Call:
    """OpenCV's morphology, in the plane; its copies of the cells are made beforehand."""
    import cv2

    image, kernel = occupied.astype(np.uint8), raster.cells.astype(np.uint8)
    return lambda: cv2.dilate(image, kernel, anchor=_anchor(raster)).astype(np.bool_)


def filtered(occupied: Bools, raster: Raster) -> Call:
    """OpenCV's correlation, in the plane; its copies of the cells are made beforehand."""
    import cv2

    image, kernel = occupied.astype(np.float32), raster.cells.astype(np.float32)
    options: dict[str, Any] = {"anchor": _anchor(raster), "borderType": cv2.BORDER_CONSTANT}
    return lambda: cv2.filter2D(image, cv2.CV_32F, kernel, **options) > 0.5


@dataclass(frozen=True)
class Peer:
    """One peer.

    Attributes
    ----------
    name : str
    ready : callable
        From the map and the robot's raster to the call that is timed; copies that the peer needs are made here.
    work : callable
        From the map's shape and the raster to a number that its time is taken to grow with.
    dims : tuple of int
        Dimensions that it works in.
    """

    name: str
    ready: Callable[[Bools, Raster], Call]
    work: Callable[[Sequence[int], Raster], float]
    dims: tuple[int, ...] = (2, 3)


def peers(dim: int) -> list[Peer]:
    """All that are installed and go with a number of dimensions."""
    every = [*PEERS, *(OPENCV if is_here("cv2") else [])]
    return [way for way in every if dim in way.dims]


def across(cells: NDArray[Any]) -> str:
    """Cells along each axis."""
    return " x ".join(map(str, cells.shape))


def _anchor(raster: Raster) -> tuple[int, int]:
    """The reference point as OpenCV counts it: column, row."""
    return -raster.lower[1], -raster.lower[0]


def _convolution(name: str, precision: type[np.floating[Any]], occupied: Bools, raster: Raster) -> Call:
    from scipy import signal

    kernel = np.flip(raster.cells).astype(precision)
    return partial(convolved, getattr(signal, name), occupied.astype(precision), kernel, raster)


def _dilated(occupied: Bools, raster: Raster) -> Call:
    return partial(binary_dilation, occupied, raster)


def _stamped(occupied: Bools, raster: Raster) -> Call:
    return lambda: stamp(occupied, [raster])[0]


def _pairs(shape: Sequence[int], raster: Raster) -> float:
    """Each cell of the map with each of the robot's."""
    return math.prod(shape) * float(raster.count)


def _points(shape: Sequence[int], raster: Raster) -> float:
    """Points of a transform of the whole map, and the steps of each."""
    points = float(math.prod(n + r - 1 for n, r in zip(shape, raster.cells.shape, strict=True)))
    return points * math.log2(points + 1.0)


def _cells(shape: Sequence[int], raster: Raster) -> float:
    return float(math.prod(shape))


def _rows(shape: Sequence[int], raster: Raster) -> float:
    """Each cell of the map with each row of the robot's."""
    return math.prod(shape) * float(len(raster.cells))


PEERS = (
    Peer("fftconvolve float64", partial(_convolution, "fftconvolve", np.float64), _points),
    Peer("oaconvolve float32", partial(_convolution, "oaconvolve", np.float32), _cells),
    Peer("ndimage.binary_dilation", _dilated, _pairs),
    Peer("stamping, compiled", _stamped, _rows, (2,)),
)

OPENCV = (Peer("cv2.dilate", dilation, _pairs, (2,)), Peer("cv2.filter2D", filtered, _cells, (2,)))
