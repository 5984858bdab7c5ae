"""Outer maps by our engines and by peers, with a free exterior."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

import cspace
from benchmarks.report import is_here
from cspace import Robot, Workspace
from cspace._engines import METHODS as METHODS
from cspace._raster import Raster
from cspace._support.arrays import Bools, Ints
from cspace._support.compiling import allocating
from cspace._support.threads import count_cores

Call = Callable[[], Bools]


def ours(workspace: Workspace, robot: Robot, method: str) -> Bools:
    """Return the outer map of a robot without rotations, including its rasterization."""
    space = cspace.build(workspace, robot, inner=False, outside="free", method=method)
    return space.cell_states.view(np.bool_)  # FREE is 0 and MIXED 1


def engine_label(method: str) -> str:
    """Return the label of an engine of ours."""
    return f'ours, "{method}"'


def shape_text(cells: NDArray[Any]) -> str:
    """Format the number of cells along each axis."""
    return " x ".join(map(str, cells.shape))


def convolve_map(
    convolve: Callable[..., NDArray[Any]],
    occupied: NDArray[Any],
    kernel: NDArray[Any],
    raster: Raster,
) -> Bools:
    """Compute the map by a convolution of SciPy with the raster's flipped cells."""
    whole = convolve(occupied, kernel, mode="full")
    window = tuple(
        slice(high, high + n) for high, n in zip(raster.upper, occupied.shape, strict=True)
    )
    return np.asarray(whole[window] > 0.5)


# ---- stamping, as in ROS -------------------------------------------------------------------------


@allocating
def _stamp(out: Bools, border: Ints, runs: Ints) -> None:
    """Set the runs ``(x, start y, stop y)`` around every border cell, clipped to the map."""
    nx, ny = out.shape
    for c in range(border.shape[0]):
        x, y = border[c]
        for r in range(runs.shape[0]):
            i = x + runs[r, 0]
            if 0 <= i < nx:
                out[i, max(0, y + runs[r, 1]) : max(0, min(ny, y + runs[r, 2]))] = True


def stamp(occupied: Bools, rasters: Sequence[Raster]) -> list[Bools]:
    """Stamp each raster around the border cells of obstacles, with a thread for each raster.

    A connected robot that meets obstacles meets a border cell or lies inside. Stamps cover the
    first case; a copy of the map, shifted by one offset, covers the second.
    """
    border = border_cells(occupied)

    def one(raster: Raster) -> Bools:
        steps = np.diff(np.pad(raster.cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        (rows, starts), stops = np.nonzero(steps > 0), np.nonzero(steps < 0)[1]
        x, y = raster.lower
        # A configuration k collides if cell k + m is occupied, so the runs contain the offsets -m.
        runs = np.column_stack([-(rows + x), 1 - (stops + y), 1 - (starts + y)])
        offset = (np.argwhere(raster.cells)[raster.count // 2] + raster.lower).tolist()
        target, source = zip(*map(_overlap, occupied.shape, offset), strict=True)
        out = np.zeros_like(occupied)
        out[target] = occupied[source]
        _stamp(out, border, runs)
        return out

    with ThreadPoolExecutor(count_cores()) as pool:
        return list(pool.map(one, rasters))


def border_cells(occupied: Bools) -> Ints:
    """Return occupied cells (n, 2) beside a free cell or on the map's border."""
    wide = np.pad(occupied, 1)
    hidden = wide[:-2, 1:-1] & wide[2:, 1:-1] & wide[1:-1, :-2] & wide[1:-1, 2:]
    return np.argwhere(occupied & ~hidden)


def _overlap(size: int, by: int) -> tuple[slice, slice]:
    """Return the slices of cells k and k + by that both lie in the map."""
    by = min(max(by, -size), size)
    return slice(max(0, -by), size - max(0, by)), slice(max(0, by), size - max(0, -by))


# ---- peers ---------------------------------------------------------------------------------------


class MapPeer(NamedTuple):
    """A method of another library to compute the map.

    Attributes
    ----------
    name : str
    ready : callable
        Takes the map and the robot's raster, makes copies for the peer, and returns the timed call.
    work : callable
        Estimates the work, to which time is proportional, from the map's shape and the raster.
    dims : tuple of int
        Supported dimensions.
    """

    name: str
    ready: Callable[[Bools, Raster], Call]
    work: Callable[[Sequence[int], Raster], float]
    dims: tuple[int, ...] = (2, 3)


def peers(dim: int) -> list[MapPeer]:
    """Return the installed peers for a dimension."""
    return [
        peer
        for peer in PEERS
        if dim in peer.dims and (is_here("cv2") or not peer.name.startswith("cv2"))
    ]


def _convolution(
    name: str, precision: type[np.floating[Any]], occupied: Bools, raster: Raster
) -> Call:
    kernel = np.flip(raster.cells).astype(precision)
    return partial(convolve_map, getattr(signal, name), occupied.astype(precision), kernel, raster)


def _binary_dilation(occupied: Bools, raster: Raster) -> Call:
    # SciPy centers the kernel on shape // 2, which is the center of a disc around the reference
    # point.
    return partial(ndimage.binary_dilation, occupied, np.flip(raster.cells))


def _stamping(occupied: Bools, raster: Raster) -> Call:
    return lambda: stamp(occupied, [raster])[0]


def _dilate(occupied: Bools, raster: Raster) -> Call:
    import cv2

    image, kernel = occupied.astype(np.uint8), raster.cells.astype(np.uint8)
    return lambda: cv2.dilate(image, kernel, anchor=_anchor(raster)).astype(np.bool_)


def _filter(occupied: Bools, raster: Raster) -> Call:
    import cv2

    image, kernel = occupied.astype(np.float32), raster.cells.astype(np.float32)
    options: dict[str, Any] = {"anchor": _anchor(raster), "borderType": cv2.BORDER_CONSTANT}
    return lambda: cv2.filter2D(image, cv2.CV_32F, kernel, **options) > 0.5


def _anchor(raster: Raster) -> tuple[int, int]:
    """Return the reference point for OpenCV (column, row)."""
    return -raster.lower[1], -raster.lower[0]


def _pairs(shape: Sequence[int], raster: Raster) -> float:
    """Count pairs of map cells and robot cells."""
    return math.prod(shape) * float(raster.count)


def _points(shape: Sequence[int], raster: Raster) -> float:
    """Count points of a transform of the whole map, times steps per point."""
    points = float(math.prod(n + r - 1 for n, r in zip(shape, raster.cells.shape, strict=True)))
    return points * math.log2(points + 1.0)


def _cells(shape: Sequence[int], raster: Raster) -> float:
    return float(math.prod(shape))


def _rows(shape: Sequence[int], raster: Raster) -> float:
    """Count pairs of map cells and robot rows."""
    return math.prod(shape) * float(len(raster.cells))


PEERS = (
    MapPeer("fftconvolve float64", partial(_convolution, "fftconvolve", np.float64), _points),
    MapPeer("oaconvolve float32", partial(_convolution, "oaconvolve", np.float32), _cells),
    MapPeer("ndimage.binary_dilation", _binary_dilation, _pairs),
    MapPeer("stamping, compiled", _stamping, _rows, (2,)),
    MapPeer("cv2.dilate", _dilate, _pairs, (2,)),
    MapPeer("cv2.filter2D", _filter, _cells, (2,)),
)
