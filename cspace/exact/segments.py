"""Compiled distances in the plane, between the border of a placed robot and that of the obstacles.

Both are sets of segments, each grown by a radius. Where no two come together the robot is free, unless one side lies
wholly within the other, which one point of each decides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cspace.arrays import Bools, Floats, Ints
from cspace.compiling import inner

Point = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, low, right, high."""


class Outline(NamedTuple):
    """The robot in its own frame, in metres.

    Border segments ``(x0, y0, x1, y1)``, each grown by its radius: a disc is a segment without length. One point of
    each connected part of the border. The segments of region k, without discs, end before ``stops[k]``. ``rho`` is the
    largest distance of an endpoint from the reference point.
    """

    segments: Floats
    radii: Floats
    anchors: Floats
    stops: Ints
    rho: float


class Border(NamedTuple):
    """The border of the obstacles, in metres.

    Its segments, at most a bin long, sorted by the square bin of side ``side`` that holds their middle; those of bin b
    begin at ``starts[b]``, for ``columns`` times ``rows`` bins from the grid's lower corner; each is grown by its
    radius, the largest of which is ``widest``. ``walled`` is whether all outside the grid is obstacle. A distance
    counts above ``least``, and is searched for up to ``reach`` more.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    segments: Floats
    radii: Floats
    widest: float
    starts: Ints
    columns: int
    rows: int
    side: float
    walled: bool
    least: float
    reach: float


class Scene(NamedTuple):
    """The obstacles: their border, cells that meet and cells that lie in them, and polygons that they fill.

    Border segments of polygon k end before ``stops[k]``, and ``hulls[k]`` is its bounding box.
    """

    border: Border
    spacing: float
    outer: Bools
    inner: Bools
    solids: Floats
    stops: Ints
    hulls: Floats


class Placed(NamedTuple):
    """The robot at a place, and all along a vector from there.

    Rows ``(x0, y0, x1, y1, left, low, right, high)`` of its segments at the place, each with the bounding box of what
    it sweeps, radius included; and the bounding box of all.
    """

    rows: Floats
    left: float
    low: float
    right: float
    high: float
    x: float
    y: float
    cosine: float
    sine: float
    along: Point


@inner
def place(outline: Outline, rows: Floats, x: float, y: float, yaw: float, along: Point) -> Placed:
    """The robot at a configuration and all along a vector; ``rows`` is room for its segments."""
    cosine, sine, (vx, vy) = math.cos(yaw), math.sin(yaw), along
    left = low = math.inf
    right = high = -math.inf
    for k in range(len(rows)):
        segment, row, radius = outline.segments[k], rows[k], outline.radii[k]
        for end in range(0, 4, 2):
            u, v = segment[end], segment[end + 1]
            row[end], row[end + 1] = x + cosine * u - sine * v, y + sine * u + cosine * v
        row[4], row[6] = min(row[0], row[2]) - radius + min(vx, 0.0), max(row[0], row[2]) + radius + max(vx, 0.0)
        row[5], row[7] = min(row[1], row[3]) - radius + min(vy, 0.0), max(row[1], row[3]) + radius + max(vy, 0.0)
        left, low = min(left, row[4]), min(low, row[5])
        right, high = max(right, row[6]), max(high, row[7])
    return Placed(rows, left, low, right, high, x, y, cosine, sine, along)


@inner
def gap(border: Border, outline: Outline, placed: Placed, least: float, reach: float) -> float:
    """Least distance between the borders of the placed robot, all along its vector, and of the obstacles.

    At most ``least + reach``; a distance of ``least`` or below may be given too large, but never above ``least``.
    """
    best: float = least + reach
    rows = placed.rows
    if border.walled:
        (left, low), (right, high) = border.lower, border.upper
        best = min(best, min(placed.left - left, placed.low - low))
        best = min(best, min(right - placed.right, high - placed.high))
        if best <= least:
            return best
    first_x, first_y, last_x, last_y = _bins(border, placed, best + border.widest)
    if first_y > last_y:
        return best
    for i in range(first_x, last_x + 1):
        # Bins along y follow one another, so that a column of them is one run of segments.
        for e in range(border.starts[i * border.rows + first_y], border.starts[i * border.rows + last_y + 1]):
            segment, radius = border.segments[e], border.radii[e]
            c, d = (segment[0], segment[1]), (segment[2], segment[3])
            box = min(c[0], d[0]), min(c[1], d[1]), max(c[0], d[0]), max(c[1], d[1])
            enough = best + radius
            if _along_axes(box, (placed.left, placed.low, placed.right, placed.high)) >= enough:
                continue
            for k in range(len(rows)):
                row = rows[k]
                if _along_axes(box, (row[4], row[5], row[6], row[7])) >= enough:
                    continue
                apart = _swept_distance((row[0], row[1]), (row[2], row[3]), placed.along, c, d)
                apart -= outline.radii[k] + radius
                if apart < best:
                    best, enough = apart, apart + radius
                    if best <= least:
                        return best
    return best


@inner
def _along_axes(one: Box, other: Box) -> float:
    """By how much two boxes are apart along an axis, the one where it is most."""
    return max(max(one[0] - other[2], other[0] - one[2]), max(one[1] - other[3], other[1] - one[3]))


@inner
def is_nested(scene: Scene, outline: Outline, placed: Placed) -> bool:
    """Whether the robot or a part of it lies in an obstacle, or one in the robot, of borders that do not meet."""
    cosine, sine, border = placed.cosine, placed.sine, scene.border
    for k in range(outline.anchors.shape[0]):
        ax, ay = outline.anchors[k, 0], outline.anchors[k, 1]
        if _in_obstacle(scene, placed.x + cosine * ax - sine * ay, placed.y + sine * ax + cosine * ay):
            return True
    if not outline.stops.shape[0]:  # an obstacle in a disc is near the disc's middle: the distance decides
        return False
    first_x, first_y, last_x, last_y = _bins(border, placed, 0.0)
    if first_y > last_y:
        return False
    for i in range(first_x, last_x + 1):
        for e in range(border.starts[i * border.rows + first_y], border.starts[i * border.rows + last_y + 1]):
            px, py = border.segments[e, 0], border.segments[e, 1]
            if not (placed.left <= px <= placed.right and placed.low <= py <= placed.high):
                continue
            first = 0
            for k in range(outline.stops.shape[0]):
                if _encloses(placed.rows, first, outline.stops[k], px, py):
                    return True
                first = outline.stops[k]
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
    nearest: float = segment_distance(a, b, c, d)
    if vx == 0.0 and vy == 0.0:
        return nearest
    # The moving one sweeps a parallelogram, which the other comes near at a side, or lies in.
    ux, uy = b[0] - a[0], b[1] - a[1]
    px, py = c[0] - a[0], c[1] - a[1]
    area = ux * vy - uy * vx
    s, t = (px * vy - py * vx) / area, (ux * py - uy * px) / area
    if min(s, t) >= 0.0 and max(s, t) <= 1.0 and area != 0.0:
        return 0.0
    e, f = (a[0] + vx, a[1] + vy), (b[0] + vx, b[1] + vy)
    for p, q in ((e, f), (a, e), (b, f)):
        nearest = min(nearest, segment_distance(p, q, c, d))
    return nearest


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
def _bins(border: Border, placed: Placed, grow: float) -> tuple[int, int, int, int]:
    """Bins ``(x first, y first, x last, y last)`` of all segments that come within ``grow`` of the robot's box."""
    (left, low), wide, columns, rows = border.lower, grow + 0.51 * border.side, border.columns, border.rows
    first_x = _bin(border.side, placed.left - wide - left, 0.0, float(columns))
    first_y = _bin(border.side, placed.low - wide - low, 0.0, float(rows))
    last_x = _bin(border.side, placed.right + wide - left, -1.0, columns - 1.0)
    last_y = _bin(border.side, placed.high + wide - low, -1.0, rows - 1.0)
    return first_x, first_y, last_x, last_y


@inner
def _bin(side: float, place: float, least: float, most: float) -> int:
    """The bin of a place along an axis, within bounds."""
    return math.floor(min(max(place / side, least), most))


@inner
def _in_obstacle(scene: Scene, x: float, y: float) -> bool:
    """Whether a point that is not on an obstacle's border lies in an obstacle."""
    u, v = (x - scene.border.lower[0]) / scene.spacing, (y - scene.border.lower[1]) / scene.spacing
    nx, ny = scene.outer.shape
    if not (0.0 <= u <= nx and 0.0 <= v <= ny):
        return False
    i, j = min(int(u), nx - 1), min(int(v), ny - 1)
    if not scene.outer[i, j]:
        return False
    if scene.inner[i, j]:
        return True
    first = 0
    for k in range(scene.stops.shape[0]):
        hull = scene.hulls[k]
        if hull[0] <= x <= hull[2] and hull[1] <= y <= hull[3] and _encloses(scene.solids, first, scene.stops[k], x, y):
            return True
        first = scene.stops[k]
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
