"""Compiled distances in the plane, between the border of a placed robot and that of the obstacles.

Both are sets of segments, each grown by a radius. Where no two come together the robot is free, unless one side lies
wholly within the other, which is told by one point of each.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import inner

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Point = tuple[float, float]


class Outline(NamedTuple):
    """The robot in its own frame, in metres.

    Border segments ``(x0, y0, x1, y1)``, each grown by its radius: a disc is a segment without length. One point of
    each connected part of the border. The segments of region k, without discs, end before ``ends[k]``. ``rho`` is the
    largest distance of an end of a segment from the reference point.
    """

    segments: Floats
    radii: Floats
    anchors: Floats
    ends: Ints
    rho: float


class Scene(NamedTuple):
    """The obstacles, in metres.

    Border segments, at most a bin long, sorted by the square bin of side ``side`` that holds their middle; those of bin
    b begin at ``starts[b]``, for ``columns`` times ``rows`` bins from the grid's lower corner; each is grown by its
    radius, the largest of which is ``widest``. Cells that meet and cells that lie in obstacles. Border segments of
    polygon k end before ``ends[k]``, and ``hulls[k]`` is its bounding box. ``walled`` tells whether all beyond the grid
    is obstacle. A distance counts above ``least``, and is searched for up to ``reach`` more.
    """

    lower: tuple[float, ...]
    spacing: float
    upper: tuple[float, ...]
    segments: Floats
    radii: Floats
    widest: float
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


class Placed(NamedTuple):
    """The robot at a place, and all along a vector from there.

    Rows ``(x0, y0, x1, y1, left, low, right, high)`` of its segments at the place, each with the bounding box of what
    it sweeps, radius included; and the bounding box of all.
    """

    rows: Floats
    box: Floats
    x: float
    y: float
    cosine: float
    sine: float
    along: Point


@inner(_nrt=True)  # it makes arrays
def place(outline: Outline, x: float, y: float, yaw: float, along: Point) -> Placed:
    """The robot at a configuration and all along a vector."""
    cosine, sine = math.cos(yaw), math.sin(yaw)
    rows, box = np.empty((outline.segments.shape[0], 8)), np.array([math.inf, math.inf, -math.inf, -math.inf])
    vx, vy = along
    for k in range(outline.segments.shape[0]):
        ax, ay, bx, by = outline.segments[k, 0], outline.segments[k, 1], outline.segments[k, 2], outline.segments[k, 3]
        ax, ay = x + cosine * ax - sine * ay, y + sine * ax + cosine * ay
        bx, by = x + cosine * bx - sine * by, y + sine * bx + cosine * by
        radius = outline.radii[k]
        rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3] = ax, ay, bx, by
        rows[k, 4], rows[k, 5] = min(ax, bx) - radius + min(vx, 0.0), min(ay, by) - radius + min(vy, 0.0)
        rows[k, 6], rows[k, 7] = max(ax, bx) + radius + max(vx, 0.0), max(ay, by) + radius + max(vy, 0.0)
        box[0], box[1] = min(box[0], rows[k, 4]), min(box[1], rows[k, 5])
        box[2], box[3] = max(box[2], rows[k, 6]), max(box[3], rows[k, 7])
    return Placed(rows, box, x, y, cosine, sine, along)


@inner
def gap(scene: Scene, outline: Outline, placed: Placed, least: float, reach: float) -> float:
    """Least distance between the borders of the placed robot, all along its vector, and of the obstacles.

    At most ``least + reach``; a distance of ``least`` or below may be given too large, but never above ``least``.
    """
    best, box, rows = float(least + reach), placed.box, placed.rows
    (left, low), (right, high) = scene.lower, scene.upper
    if scene.walled:
        best = min(best, min(min(box[0] - left, box[1] - low), min(right - box[2], high - box[3])))
        if best <= least:
            return float(best)
    first_x, first_y, last_x, last_y = _bins(scene, box, best + scene.widest)
    if first_y > last_y:
        return float(best)
    for i in range(first_x, last_x + 1):
        # Bins along y follow one another, so that a column of them is one run of segments.
        for e in range(scene.starts[i * scene.rows + first_y], scene.starts[i * scene.rows + last_y + 1]):
            c, d = (scene.segments[e, 0], scene.segments[e, 1]), (scene.segments[e, 2], scene.segments[e, 3])
            low_x, low_y, high_x, high_y = min(c[0], d[0]), min(c[1], d[1]), max(c[0], d[0]), max(c[1], d[1])
            enough = best + scene.radii[e]
            if max(max(low_x - box[2], box[0] - high_x), max(low_y - box[3], box[1] - high_y)) >= enough:
                continue
            for k in range(rows.shape[0]):
                row = rows[k]
                if max(max(low_x - row[6], row[4] - high_x), max(low_y - row[7], row[5] - high_y)) >= enough:
                    continue
                apart = _swept_distance((row[0], row[1]), (row[2], row[3]), placed.along, c, d)
                apart -= outline.radii[k] + scene.radii[e]
                if apart < best:
                    best, enough = apart, apart + scene.radii[e]
                    if best <= least:
                        return float(best)
    return float(best)


@inner
def is_nested(scene: Scene, outline: Outline, placed: Placed) -> bool:
    """Whether the robot or a part of it lies in an obstacle, or one in the robot, of borders that do not meet."""
    cosine, sine, box = placed.cosine, placed.sine, placed.box
    for k in range(outline.anchors.shape[0]):
        ax, ay = outline.anchors[k, 0], outline.anchors[k, 1]
        if _in_obstacle(scene, placed.x + cosine * ax - sine * ay, placed.y + sine * ax + cosine * ay):
            return True
    if not outline.ends.shape[0]:  # an obstacle in a disc is near the disc's middle, which the distance tells
        return False
    first_x, first_y, last_x, last_y = _bins(scene, box, 0.0)
    if first_y > last_y:
        return False
    for i in range(first_x, last_x + 1):
        for e in range(scene.starts[i * scene.rows + first_y], scene.starts[i * scene.rows + last_y + 1]):
            px, py = scene.segments[e, 0], scene.segments[e, 1]
            if not (box[0] <= px <= box[2] and box[1] <= py <= box[3]):
                continue
            first = 0
            for k in range(outline.ends.shape[0]):
                if _encloses(placed.rows, first, outline.ends[k], px, py):
                    return True
                first = outline.ends[k]
    return False


@inner
def segment_distance(a: Point, b: Point, c: Point, d: Point) -> float:
    """Distance between the segments from a to b and from c to d.

    Where rounding hides that they cross, an end of one lies within rounding of the other: the error is a few roundings
    of the coordinates in any case.
    """
    if _is_left(a, b, c) != _is_left(a, b, d) and _is_left(c, d, a) != _is_left(c, d, b):
        return 0.0
    square = min(
        min(_square_to_segment(c, a, b), _square_to_segment(d, a, b)),
        min(_square_to_segment(a, c, d), _square_to_segment(b, c, d)),
    )
    return math.sqrt(square)


@inner
def _swept_distance(a: Point, b: Point, along: Point, c: Point, d: Point) -> float:
    """Distance between a segment from a to b that moves along a vector, and one from c to d that stays."""
    vx, vy = along
    if vx == 0.0 and vy == 0.0:
        return float(segment_distance(a, b, c, d))
    # The moving one sweeps a parallelogram, which the other comes near at a side, or lies in.
    ux, uy, px, py = b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]
    area = ux * vy - uy * vx
    if area != 0.0 and 0.0 <= (px * vy - py * vx) / area <= 1.0 and 0.0 <= (ux * py - uy * px) / area <= 1.0:
        return 0.0
    e, f = (a[0] + vx, a[1] + vy), (b[0] + vx, b[1] + vy)
    ends = min(segment_distance(a, b, c, d), segment_distance(e, f, c, d))
    return float(min(ends, min(segment_distance(a, e, c, d), segment_distance(b, f, c, d))))


@inner
def _square_to_segment(p: Point, a: Point, b: Point) -> float:
    """Squared distance of a point from a segment, which may be a point."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = dx * dx + dy * dy
    t = 0.0
    if length > 0.0:
        t = min(max(((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / length, 0.0), 1.0)
    gap_x, gap_y = p[0] - a[0] - t * dx, p[1] - a[1] - t * dy
    return gap_x * gap_x + gap_y * gap_y


@inner
def _is_left(a: Point, b: Point, p: Point) -> bool:
    """Whether a point lies to the left of a line."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0.0


@inner
def _bins(scene: Scene, box: Floats, grow: float) -> tuple[int, int, int, int]:
    """Bins ``(x first, y first, x last, y last)`` of all segments that come within ``grow`` of a box."""
    wide, (left, low) = grow + 0.51 * scene.side, scene.lower
    first_x = math.floor(min(max((box[0] - wide - left) / scene.side, 0.0), float(scene.columns)))
    first_y = math.floor(min(max((box[1] - wide - low) / scene.side, 0.0), float(scene.rows)))
    last_x = math.floor(min(max((box[2] + wide - left) / scene.side, -1.0), scene.columns - 1.0))
    last_y = math.floor(min(max((box[3] + wide - low) / scene.side, -1.0), scene.rows - 1.0))
    return first_x, first_y, last_x, last_y


@inner
def _in_obstacle(scene: Scene, x: float, y: float) -> bool:
    """Whether a point that is not on an obstacle's border lies in an obstacle."""
    u, v = (x - scene.lower[0]) / scene.spacing, (y - scene.lower[1]) / scene.spacing
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


@inner
def _encloses(segments: Floats, first: int, stop: int, x: float, y: float) -> bool:
    """Even-odd parity of a ray to the right, for a point that is not on the border."""
    inside = False
    for k in range(first, stop):
        ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        if (ay <= y) != (by <= y) and ax + (y - ay) / (by - ay) * (bx - ax) > x:
            inside = not inside
    return inside
