"""Slow, plain implementations of the definitions, in exact rational arithmetic, that share no code with the library."""

from fractions import Fraction
from itertools import product

import numpy as np

Point = tuple[Fraction, Fraction]
Segment = tuple[Point, Point]


def exact(values):
    return tuple(Fraction(float(value)) for value in values)


def square_distance_to_box(segment, box):
    """Squared distance between a segment and a box ``(x0, y0, x1, y1)``, exactly."""
    if segment_meets_box(segment, box):
        return Fraction(0)
    x0, y0, x1, y1 = box
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    sides = list(zip(corners, corners[1:] + corners[:1], strict=True))
    candidates = [square_distance_to_segment(corner, segment) for corner in corners]
    candidates += [square_distance_to_segment(end, side) for end in segment for side in sides]
    return min(candidates)


def square_distance_to_segment(point, segment):
    (px, py), (qx, qy) = segment
    dx, dy = qx - px, qy - py
    length = dx * dx + dy * dy
    t = Fraction(0) if length == 0 else ((point[0] - px) * dx + (point[1] - py) * dy) / length
    t = min(max(t, Fraction(0)), Fraction(1))
    return (point[0] - px - t * dx) ** 2 + (point[1] - py - t * dy) ** 2


def segment_meets_box(segment, box):
    """Whether a closed segment meets a closed box, by clipping (Liang and Barsky, 1984)."""
    (px, py), (qx, qy) = segment
    x0, y0, x1, y1 = box
    low, high = Fraction(0), Fraction(1)
    for p, d, a, b in ((px, qx - px, x0, x1), (py, qy - py, y0, y1)):
        if d == 0:
            if p < a or p > b:
                return False
            continue
        t0, t1 = sorted(((a - p) / d, (b - p) / d))
        low, high = max(low, t0), min(high, t1)
    return low <= high


def on_border(point, segments):
    return any(square_distance_to_segment(point, segment) == 0 for segment in segments)


def encloses(point, segments):
    """Even-odd parity of a ray to the right."""
    x, y = point
    inside = False
    for (px, py), (qx, qy) in segments:
        if (py <= y) != (qy <= y) and px + (y - py) / (qy - py) * (qx - px) > x:
            inside = not inside
    return inside


def ring_segments(vertices):
    points = [exact(vertex) for vertex in vertices]
    return list(zip(points, points[1:] + points[:1], strict=True))


def polygon_outer_offsets(vertices, spacing, margin, reach):
    """Offsets m with |m| <= reach whose box ``h (m + [-1, 1]^2)`` comes within the margin of a polygon."""
    segments, h, margin = ring_segments(vertices), Fraction(spacing), Fraction(margin)
    found = set()
    for m in product(range(-reach, reach + 1), repeat=2):
        box = (h * (m[0] - 1), h * (m[1] - 1), h * (m[0] + 1), h * (m[1] + 1))
        near = any(square_distance_to_box(segment, box) <= margin * margin for segment in segments)
        if near or encloses((h * m[0], h * m[1]), segments):
            found.add(m)
    return found


def polygon_inner_offsets(vertices, spacing, reach):
    """Offsets m with |m| <= reach whose point ``h m`` lies in a closed polygon."""
    segments, h = ring_segments(vertices), Fraction(spacing)
    points = {m: (h * m[0], h * m[1]) for m in product(range(-reach, reach + 1), repeat=2)}
    return {m for m, point in points.items() if on_border(point, segments) or encloses(point, segments)}


def disc_outer_offsets(center, radius, spacing, margin, reach):
    (cx, cy), h, grown = exact(center), Fraction(spacing), Fraction(radius) + Fraction(margin)
    found = set()
    for m in product(range(-reach, reach + 1), repeat=2):
        dx = max(Fraction(0), h * (m[0] - 1) - cx, cx - h * (m[0] + 1))
        dy = max(Fraction(0), h * (m[1] - 1) - cy, cy - h * (m[1] + 1))
        if dx * dx + dy * dy <= grown * grown:
            found.add(m)
    return found


def disc_inner_offsets(center, radius, spacing, reach):
    (cx, cy), h, r = exact(center), Fraction(spacing), Fraction(radius)
    box = product(range(-reach, reach + 1), repeat=2)
    return {m for m in box if (h * m[0] - cx) ** 2 + (h * m[1] - cy) ** 2 <= r * r}


def raster_offsets(raster):
    """The set of offsets of a library Raster."""
    nx, ny = raster.cells.shape
    low_x, low_y = raster.lower
    return {(low_x + i, low_y + j) for i in range(nx) for j in range(ny) if raster.cells[i, j]}


def overlap(occupied, offsets, outside):
    """``{k: number of offsets m for which k + m is obstacle}``, with obstacle or nothing beyond the map."""
    nx, ny = occupied.shape

    def filled(i, j):
        return bool(occupied[i, j]) if 0 <= i < nx and 0 <= j < ny else outside

    return {(i, j): sum(filled(i + m, j + n) for m, n in offsets) for i, j in product(range(nx), range(ny))}


def overlaps_by_shifts(occupied, raster, outside):
    """Overlap of each cell with a library Raster, by adding up shifted copies of the map."""
    pad = [n + 1 for n in occupied.shape]
    wide = np.pad(occupied, [(n, n) for n in pad], constant_values=outside)
    total = np.zeros(occupied.shape, dtype=np.int64)
    for offset in np.argwhere(raster.cells) + raster.lower:
        # Beyond the pads all is like the pads.
        first = [p + int(np.clip(m, -p, p)) for m, p in zip(offset, pad, strict=True)]
        total += wide[tuple(slice(f, f + n) for f, n in zip(first, occupied.shape, strict=True))]
    return total


def touched_cells(start, end, spacing, lower, shape):
    """Cells of a grid that a closed segment meets, exactly."""
    h, (low_x, low_y) = Fraction(spacing), exact(lower)
    segment = (exact(start), exact(end))
    return {
        (i, j)
        for i, j in product(range(shape[0]), range(shape[1]))
        if segment_meets_box(segment, (low_x + h * i, low_y + h * j, low_x + h * (i + 1), low_y + h * (j + 1)))
    }


def component_of(cells, start):
    """Cells joined to ``start`` through sides, among the True ones."""
    if not cells[start]:
        return set()
    seen, todo = {start}, [start]
    while todo:
        i, j = todo.pop()
        for near in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            inside = 0 <= near[0] < cells.shape[0] and 0 <= near[1] < cells.shape[1]
            if inside and near not in seen and cells[near]:
                seen.add(near)
                todo.append(near)
    return seen


def segment_meets_block(start, end, low, high):
    """Whether a closed segment meets a closed block, in any number of dimensions, by clipping."""
    first, last = Fraction(0), Fraction(1)
    for p, q, a, b in zip(start, end, low, high, strict=True):
        if p == q:
            if p < a or p > b:
                return False
            continue
        t0, t1 = sorted(((a - p) / (q - p), (b - p) / (q - p)))
        first, last = max(first, t0), min(last, t1)
    return first <= last


def turns_between(yaw0, yaw1, turn, slack=0):
    """Signed angles of the shorter way from one yaw to another; both ways where they are equally long, or nearly."""
    ahead = (Fraction(yaw1) - Fraction(yaw0)) % turn
    return [way for way in (ahead, ahead - turn) if abs(way) <= turn / 2 + slack]


def touched_turned_cells(start, end, spacing, lower, shape, borders, slack=0):
    """Cells ``(rotation, x, y(, z))`` that an edge ``(x, y(, z), yaw)`` meets: linear, and yaw the shorter way.

    Rotation cells repeat with every turn. Exact for the numbers as they are; ``slack`` widens the cells.
    """
    h, corner, slack = Fraction(spacing), exact(lower), Fraction(slack)
    borders = [Fraction(border) for border in borders]
    whole = borders[-1] - borders[0]
    (*first, yaw0), (*second, yaw1) = exact(start), exact(end)
    begin = borders[0] + (yaw0 - borders[0]) % whole
    found = set()
    for turn in turns_between(yaw0, yaw1, whole, slack):
        a, b = (*first, begin), (*second, begin + turn)
        for k, wraps in product(range(len(borders) - 1), (-1, 0, 1)):
            low, high = borders[k] + wraps * whole - slack, borders[k + 1] + wraps * whole + slack
            if high < min(a[-1], b[-1]) or low > max(a[-1], b[-1]):
                continue
            for cell in product(*map(range, shape)):
                near = (*(c + h * i - slack for c, i in zip(corner, cell, strict=True)), low)
                far = (*(c + h * (i + 1) + slack for c, i in zip(corner, cell, strict=True)), high)
                if (k, *cell) not in found and segment_meets_block(a, b, near, far):
                    found.add((k, *cell))
    return found
