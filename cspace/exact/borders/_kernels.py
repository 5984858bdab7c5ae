"""Compiled distances between the borders of a placed robot and of the obstacles.

Both are sets of straight pieces. Where no two pieces come together the robot is free, unless one side lies wholly
within the other, which is told by one point of each.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Body(NamedTuple):
    """The robot in its own frame, in metres.

    Border pieces ``(x0, y0, x1, y1)``, each grown by its radius: a disc is a piece without length. One point of each
    connected part of the border. The pieces of region k, without discs, end before ``ends[k]``. ``rho`` is the largest
    distance of an end of a piece from the reference point.
    """

    pieces: Floats
    radii: Floats
    anchors: Floats
    ends: Ints
    rho: float


class Scene(NamedTuple):
    """The obstacles, in metres.

    Border pieces, at most a bin long, sorted by the square bin of side ``side`` that holds their middle; those of bin b
    begin at ``starts[b]``, for ``columns`` times ``rows`` bins from the grid's lower corner. Cells that meet and cells
    that lie in obstacles. Border segments of polygon k end before ``ends[k]``, and ``hulls[k]`` is its bounding box.
    ``walled`` tells whether all beyond the grid is obstacle. A distance counts above ``least``, and is searched for up
    to ``reach`` more.
    """

    pieces: Floats
    starts: Ints
    columns: int
    rows: int
    side: float
    outer: Bools
    inner: Bools
    solids: Floats
    ends: Ints
    hulls: Floats
    walled: bool
    least: float
    reach: float


@njit(cache=True, nogil=True)
def _square_to_segment(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Squared distance of a point from a segment, which may be a point."""
    dx, dy = bx - ax, by - ay
    length = dx * dx + dy * dy
    t = 0.0
    if length > 0.0:
        t = min(max(((px - ax) * dx + (py - ay) * dy) / length, 0.0), 1.0)
    gap_x, gap_y = px - ax - t * dx, py - ay - t * dy
    return gap_x * gap_x + gap_y * gap_y


@njit(cache=True, nogil=True)
def _side(ax: float, ay: float, bx: float, by: float, px: float, py: float) -> bool:
    """Whether a point lies to the left of a line."""
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax) > 0.0


@njit(cache=True, nogil=True)
def segment_distance(ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float) -> float:
    """Distance between two segments.

    Where rounding hides that they cross, an end of one lies within rounding of the other: the error is a few roundings
    of the coordinates in any case.
    """
    if _side(ax, ay, bx, by, cx, cy) != _side(ax, ay, bx, by, dx, dy) and (
        _side(cx, cy, dx, dy, ax, ay) != _side(cx, cy, dx, dy, bx, by)
    ):
        return 0.0
    square = min(
        min(_square_to_segment(cx, cy, ax, ay, bx, by), _square_to_segment(dx, dy, ax, ay, bx, by)),
        min(_square_to_segment(ax, ay, cx, cy, dx, dy), _square_to_segment(bx, by, cx, cy, dx, dy)),
    )
    return math.sqrt(square)


@njit(cache=True, nogil=True)
def swept_distance(
    ax: float, ay: float, bx: float, by: float, vx: float, vy: float, cx: float, cy: float, dx: float, dy: float
) -> float:
    """Distance between a segment that moves by a vector, the first, and one that stays."""
    if vx == 0.0 and vy == 0.0:
        return float(segment_distance(ax, ay, bx, by, cx, cy, dx, dy))
    # The moving one sweeps a parallelogram, which the other comes near at a side, or lies in.
    ux, uy, px, py = bx - ax, by - ay, cx - ax, cy - ay
    area = ux * vy - uy * vx
    if area != 0.0 and 0.0 <= (px * vy - py * vx) / area <= 1.0 and 0.0 <= (ux * py - uy * px) / area <= 1.0:
        return 0.0
    ex, ey, fx, fy = ax + vx, ay + vy, bx + vx, by + vy
    ends = min(segment_distance(ax, ay, bx, by, cx, cy, dx, dy), segment_distance(ex, ey, fx, fy, cx, cy, dx, dy))
    sides = min(segment_distance(ax, ay, ex, ey, cx, cy, dx, dy), segment_distance(bx, by, fx, fy, cx, cy, dx, dy))
    return float(min(ends, sides))


@njit(cache=True, nogil=True)
def place(body: Body, x: float, y: float, yaw: float, vx: float, vy: float, placed: Floats, box: Floats) -> None:
    """Pieces of the robot at a configuration, each with the bounding box of its way along a vector, and that of all."""
    cosine, sine = math.cos(yaw), math.sin(yaw)
    box[:2] = math.inf
    box[2:] = -math.inf
    for k in range(body.pieces.shape[0]):
        ax, ay, bx, by = body.pieces[k, 0], body.pieces[k, 1], body.pieces[k, 2], body.pieces[k, 3]
        ax, ay = x + cosine * ax - sine * ay, y + sine * ax + cosine * ay
        bx, by = x + cosine * bx - sine * by, y + sine * bx + cosine * by
        radius = body.radii[k]
        placed[k, 0], placed[k, 1], placed[k, 2], placed[k, 3] = ax, ay, bx, by
        placed[k, 4], placed[k, 5] = min(ax, bx) - radius + min(vx, 0.0), min(ay, by) - radius + min(vy, 0.0)
        placed[k, 6], placed[k, 7] = max(ax, bx) + radius + max(vx, 0.0), max(ay, by) + radius + max(vy, 0.0)
        box[0], box[1] = min(box[0], placed[k, 4]), min(box[1], placed[k, 5])
        box[2], box[3] = max(box[2], placed[k, 6]), max(box[3], placed[k, 7])


@njit(cache=True, nogil=True)
def _bins(scene: Scene, frame: Floats, box: Floats, grow: float) -> tuple[int, int, int, int]:
    """Bins ``(x first, y first, x last, y last)`` of all pieces that come within ``grow`` of a box."""
    wide = grow + 0.51 * scene.side
    first_x = math.floor(min(max((box[0] - wide - frame[0]) / scene.side, 0.0), float(scene.columns)))
    first_y = math.floor(min(max((box[1] - wide - frame[1]) / scene.side, 0.0), float(scene.rows)))
    last_x = math.floor(min(max((box[2] + wide - frame[0]) / scene.side, -1.0), scene.columns - 1.0))
    last_y = math.floor(min(max((box[3] + wide - frame[1]) / scene.side, -1.0), scene.rows - 1.0))
    return first_x, first_y, last_x, last_y


@njit(cache=True, nogil=True)
def gap(
    scene: Scene, frame: Floats, body: Body, placed: Floats, box: Floats, vx: float, vy: float, least: float
) -> float:
    """Least distance between the borders of the placed robot, all along a vector, and of the obstacles.

    At most ``least + reach``; a distance of ``least`` or below may be given too large, but never above ``least``.
    """
    best = float(least + scene.reach)
    if scene.walled:
        best = min(best, min(min(box[0] - frame[0], box[1] - frame[1]), min(frame[3] - box[2], frame[4] - box[3])))
        if best <= least:
            return float(best)
    first_x, first_y, last_x, last_y = _bins(scene, frame, box, best)
    if first_y > last_y:
        return float(best)
    for i in range(first_x, last_x + 1):
        for e in range(scene.starts[i * scene.rows + first_y], scene.starts[i * scene.rows + last_y + 1]):
            cx, cy, dx, dy = scene.pieces[e, 0], scene.pieces[e, 1], scene.pieces[e, 2], scene.pieces[e, 3]
            low_x, low_y, high_x, high_y = min(cx, dx), min(cy, dy), max(cx, dx), max(cy, dy)
            if max(max(low_x - box[2], box[0] - high_x), max(low_y - box[3], box[1] - high_y)) >= best:
                continue
            for k in range(placed.shape[0]):
                part = placed[k]
                if max(max(low_x - part[6], part[4] - high_x), max(low_y - part[7], part[5] - high_y)) >= best:
                    continue
                apart = swept_distance(part[0], part[1], part[2], part[3], vx, vy, cx, cy, dx, dy)
                if apart - body.radii[k] < best:
                    best = apart - body.radii[k]
                    if best <= least:
                        return float(best)
    return float(best)


@njit(cache=True, nogil=True)
def _encloses(segments: Floats, first: int, stop: int, x: float, y: float) -> bool:
    """Even-odd parity of a ray to the right, for a point that is not on the border."""
    inside = False
    for k in range(first, stop):
        ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        if (ay <= y) != (by <= y) and ax + (y - ay) / (by - ay) * (bx - ax) > x:
            inside = not inside
    return inside


@njit(cache=True, nogil=True)
def _in_obstacle(scene: Scene, frame: Floats, x: float, y: float) -> bool:
    """Whether a point that is not on an obstacle's border lies in an obstacle."""
    u, v = (x - frame[0]) / frame[2], (y - frame[1]) / frame[2]
    nx, ny = scene.outer.shape
    if not (0.0 <= u <= nx and 0.0 <= v <= ny):
        return False
    i, j = min(int(u), nx - 1), min(int(v), ny - 1)
    if not scene.outer[i, j]:
        return False
    if scene.inner[i, j]:
        return True
    first = 0
    for k in range(scene.ends.shape[0]):
        hull = scene.hulls[k]
        if hull[0] <= x <= hull[2] and hull[1] <= y <= hull[3] and _encloses(scene.solids, first, scene.ends[k], x, y):
            return True
        first = scene.ends[k]
    return False


@njit(cache=True, nogil=True)
def is_nested(
    scene: Scene, frame: Floats, body: Body, placed: Floats, box: Floats, x: float, y: float, yaw: float
) -> bool:
    """Whether the robot or a part of it lies in an obstacle, or one in the robot, of borders that do not meet."""
    cosine, sine = math.cos(yaw), math.sin(yaw)
    for k in range(body.anchors.shape[0]):
        ax, ay = body.anchors[k, 0], body.anchors[k, 1]
        if _in_obstacle(scene, frame, x + cosine * ax - sine * ay, y + sine * ax + cosine * ay):
            return True
    if not body.ends.shape[0]:  # an obstacle in a disc is near the disc's middle, which the distance tells
        return False
    first_x, first_y, last_x, last_y = _bins(scene, frame, box, 0.0)
    if first_y > last_y:
        return False
    for i in range(first_x, last_x + 1):
        for e in range(scene.starts[i * scene.rows + first_y], scene.starts[i * scene.rows + last_y + 1]):
            px, py = scene.pieces[e, 0], scene.pieces[e, 1]
            if not (box[0] <= px <= box[2] and box[1] <= py <= box[3]):
                continue
            first = 0
            for k in range(body.ends.shape[0]):
                if _encloses(placed, first, body.ends[k], px, py):
                    return True
                first = body.ends[k]
    return False
