"""Slow, plain implementations of the definitions, without code of the library."""

import math
from itertools import combinations, product

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

FRACTION_DENOMINATOR = 2**1074
"""Multiplying any float by this gives an integer."""


def units(values):
    """Convert floats to integers exactly, because Python's fractions are slow."""
    parts = (float(value).as_integer_ratio() for value in values)
    return tuple(above * (FRACTION_DENOMINATOR // below) for above, below in parts)


def minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def raster_offsets(raster):
    """Return the set of offsets of a library Raster."""
    return {tuple(cell) for cell in (np.argwhere(raster.cells) + raster.lower).tolist()}


def overlaps_by_shifts(occupied, raster, outside):
    """Return the overlap of each cell with a library Raster, by shifts of the map."""
    pad = np.array(occupied.shape) + 1
    wide = np.pad(occupied, [(n, n) for n in pad], constant_values=outside)
    copies = np.lib.stride_tricks.sliding_window_view(wide.view(np.uint8), occupied.shape)
    # Cells beyond the padding equal the padding.
    shifts = pad + np.clip(np.argwhere(raster.cells) + raster.lower, -pad, pad)
    total = np.zeros(occupied.shape, dtype=np.int64)
    together = 2**12 // max(occupied.size, 1)  # several shifts of a small map at a time
    if together > 1:
        for k in range(0, len(shifts), together):
            total += copies[tuple(shifts[k : k + together].T)].sum(axis=0, dtype=np.int64)
        return total
    for k in range(
        0, len(shifts), 255
    ):  # the most that a byte can count, because bytes are fastest
        partial = np.zeros(occupied.shape, dtype=np.uint8)
        for shift in shifts[k : k + 255]:
            partial += copies[tuple(shift)]
        total += partial
    return total


def collide(engine, occupied, rasters, outside, dtype=np.bool_, **options):
    """Run an engine; return its new arrays."""
    occupied, out = (
        occupied.view(),
        [np.full(occupied.shape, 7 if options.get("add") else 0, dtype) for _ in rasters],
    )
    occupied.setflags(write=False)  # like the cells of a workspace
    engine.write_overlaps(occupied, rasters, out, outside=outside, **options)
    return out


def segment_meets_block(start, end, low, high):
    """Return True if a closed segment meets a closed block.

    Clipping (Liang and Barsky, 1984) in any dimension, exact for fractions and integers because
    nothing is divided.
    """
    first, last = (0, 1), (1, 1)  # parameters along the segment, as (numerator, denominator)
    for p, q, a, b in zip(start, end, low, high, strict=True):
        if p > q:
            p, q, a, b = -p, -q, -b, -a
        if q < a or p > b:
            return False
        if (a - p) * first[1] > first[0] * (q - p):
            first = a - p, q - p
        if (b - p) * last[1] < last[0] * (q - p):
            last = b - p, q - p
    return first[0] * last[1] <= last[0] * first[1]


def edge_lengths(starts, ends):
    """Return the lengths of straight edges, shape (n,)."""
    return np.linalg.norm(np.asarray(ends) - starts, axis=1)


def integrate_along(starts, ends, cost, samples=200):
    """Integrate the cost of a metre along straight edges (n, d), at the middles of their parts."""
    shares = (np.arange(samples) + 0.5) / samples
    points = starts[:, None] + (ends - starts)[:, None] * shares[:, None]
    return edge_lengths(starts, ends) * cost(points).mean(axis=1)


def cheapest_chain(space, points, reach, start, goal, measure=edge_lengths):
    """Return the least cost of a chain of proven edges between points, by Dijkstra.

    Points (n, size) are joined within ``reach``, in metres and radians together. ``measure`` returns
    the costs of edges between two arrays (m, size). The chain leads between the points nearest to
    start and goal.
    """
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    pairs = pairs[np.asarray(space.motion_is_free(*points[pairs.T]))]
    costs = measure(*points[pairs.T])
    graph = coo_array((costs, tuple(pairs.T)), shape=(len(points),) * 2).tocsr()
    first, last = cKDTree(points).query([start, goal])[1]
    return float(dijkstra(graph, directed=False, indices=first)[last])


def turns_between(yaw0, yaw1, turn, slack=0):
    """Return the shorter signed angles between yaws; two angles if equal within ``slack``."""
    ahead = (yaw1 - yaw0) % turn
    return [
        direction for direction in (ahead, ahead - turn) if 2 * abs(direction) <= turn + 2 * slack
    ]


def touched_turned_cells(start, end, spacing, lower, shape, borders, slack=0):
    """Return the cells ``(rotation, x, y(, z))`` that an edge meets.

    The edge ``(x, y(, z), yaw)`` is linear, with the shorter rotation. Rotation cells repeat with
    every turn. Exact for the given floats; ``slack`` widens the cells.
    """
    (h, slack), corner, borders = units((spacing, slack)), units(lower), units(borders)
    whole = borders[-1] - borders[0]
    (*first, yaw0), (*second, yaw1) = units(start), units(end)
    begin = borders[0] + (yaw0 - borders[0]) % whole
    sides = [
        [(c + h * i - slack, c + h * (i + 1) + slack) for i in range(n)]
        for c, n in zip(corner, shape, strict=True)
    ]
    cells = set()
    for turn in turns_between(yaw0, yaw1, whole, slack):
        a, b = (*first, begin), (*second, begin + turn)
        for k, wraps in product(range(len(borders) - 1), (-1, 0, 1)):
            yaws = borders[k] + wraps * whole - slack, borders[k + 1] + wraps * whole + slack
            if yaws[1] < min(a[-1], b[-1]) or yaws[0] > max(a[-1], b[-1]):
                continue
            for cell in product(*map(range, shape)):
                block = (*(side[i] for side, i in zip(sides, cell, strict=True)), yaws)
                if (k, *cell) not in cells and segment_meets_block(a, b, *zip(*block, strict=True)):
                    cells.add((k, *cell))
    return cells


def path_length(path):
    """Return the length of a path, or infinity without one."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) if len(path) else math.inf


def shortest_length(obstacles, start, goal):
    """Return the length of the shortest path around open polygons, by a visibility graph; infinity
    if none exists."""
    parts = shapely.get_parts(obstacles)
    corners = [tuple(start), tuple(goal)]
    for part in parts:
        for ring in (part.exterior, *part.interiors):
            corners += [tuple(corner) for corner in ring.coords[:-1]]
    points = np.unique(np.array(corners[2:]).reshape(-1, 2), axis=0)
    points = np.vstack([start, goal, points])
    pairs = np.array(list(combinations(range(len(points)), 2)))
    inside = shapely.buffer(obstacles, -1e-7, join_style="mitre")
    first, last = pairs[~shapely.intersects(inside, shapely.linestrings(points[pairs]))].T
    lengths = np.linalg.norm(points[first] - points[last], axis=1)
    graph = coo_array((lengths, (first, last)), shape=(len(points),) * 2).tocsr()
    return float(dijkstra(graph, directed=False, indices=0)[1])


# ---- solids --------------------------------------------------------------------------------------


MAX_ORACLE_PAIRS = 400_000
"""Maximum number of pairs of a point and a triangle, or of two boxes, in one array."""


def chunks(count, partners):
    """Split ``count`` items, with ``partners`` each, into slices of bounded size."""
    size = max(1, MAX_ORACLE_PAIRS // max(partners, 1))
    return [slice(first, first + size) for first in range(0, count, size)]


def box_gaps(low, high, other_low, other_high):
    """Return the distances between boxes, zero if they meet."""
    apart = np.maximum(np.maximum(other_low - high, low - other_high), 0.0)
    return np.sqrt((apart * apart).sum(axis=-1))


def distance_to_triangles(points, triangles):
    """Return distances of points (n, 3) from triangles (m, 3, 3)."""
    low, high, distances = triangles.min(axis=1), triangles.max(axis=1), np.empty(len(points))
    for chunk in chunks(len(points), len(triangles)):
        batch = points[chunk]
        bounds = box_gaps(batch[:, None], batch[:, None], low, high)
        minimum = _distance_to_triangle(batch, triangles[bounds.argmin(axis=1)])
        # A triangle whose bounding box is farther cannot be nearer.
        point, triangle = np.nonzero(bounds < minimum[:, None])
        np.minimum.at(minimum, point, _distance_to_triangle(batch[point], triangles[triangle]))
        distances[chunk] = minimum
    return distances


def _distance_to_triangle(points, triangles):
    """Return the distance of each point from its triangle.

    It is the distance from the sides, or from the plane for points above the interior.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    sides = ((a, b), (b, c), (c, a))
    distances = np.min([_distance_to_segment(points, x, y) for x, y in sides], axis=0)
    normal = np.cross(b - a, c - a)
    square = (normal * normal).sum(axis=1)
    above = np.all(
        [(np.cross(y - x, points - x) * normal).sum(axis=1) >= 0.0 for x, y in sides], axis=0
    )
    height = np.abs(((points - a) * normal).sum(axis=1)) / np.sqrt(
        np.where(square > 0.0, square, 1.0)
    )
    return np.where(above & (square > 0.0), np.minimum(distances, height), distances)


def _distance_to_segment(points, start, end):
    along = end - start
    square = (along * along).sum(axis=1)
    t = ((points - start) * along).sum(axis=1) / np.where(square > 0.0, square, 1.0)
    return np.linalg.norm(points - (start + np.clip(t, 0.0, 1.0)[:, None] * along), axis=1)


def winding_numbers(points, triangles):
    """Sum solid angles to winding numbers (van Oosterom and Strackee, 1983)."""
    numbers = np.empty(len(points), dtype=int)
    for chunk in chunks(len(points), len(triangles)):
        a, b, c = np.moveaxis(triangles - points[chunk, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
        above = (a * np.cross(b, c)).sum(-1)
        below = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        numbers[chunk] = np.rint(np.arctan2(above, below).sum(-1) / (2.0 * np.pi))
    return numbers


def winds_around(points, triangles):
    """Return True if the winding number of triangles is not zero."""
    return winding_numbers(points, triangles) != 0
