"""Growth of a convex polytope between cells, with the proof that no cell meets it.

Coordinates are in cells, so that cell k is the closed cube around its center k + 1/2.

*Method.* The *core* is what the polytope must contain: a point or a segment. The cell nearest to it
is cut off by a half-space that touches the cell at its nearest point, and with it go all cells
beyond the same half-space; this repeats until no cell is left. Nearest is measured in a metric: at
first the Euclidean one, then that of the ellipsoid of inertia of the last polytope, around the
segment from the core to its center. The largest polytope is kept. So ellipsoid and half-spaces
alternate as in Deits and Tedrake, and the core stays inside by construction.

*Proof.* A cell is cut off by the half-space ``a q >= o`` if ``a c - r >= o``, where c is its center
and r = |a|_1 (1/2 + 2 SLACK) the support of the cell, grown by 2 SLACK on each side. The comparison
is the one that removes the cell from the list, so each cell given lies beyond a half-space of the
result. Rounding: positions of a map are below 2^22 cells, so ``a c`` is off by less than SLACK / 4,
and :meth:`HalfSpaces.place` together with a user's ``A @ q <= b`` by less than 3/4 SLACK. So at
least SLACK is left between any point of the polytope, as tested in floating point, and any cell.

References
----------
R. Deits and R. Tedrake, "Computing large convex regions of obstacle-free space through semidefinite
programming", 2015; S. Liu and others, "Planning dynamically feasible trajectories for quadrotors
using safe flight corridors in 3-D complex environments", 2017; C. Toumieh and A. Lambert,
"Voxel-grid based convex decomposition of 3D space for safe corridor generation", 2022.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import linprog, lsq_linear
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from cspace.inside import SLACK, Bools, Floats

HALF_CELL: Final = 0.5 + 2.0 * SLACK
"""Half the side of a cell that is cut off, in cells; it includes the allowance for rounding."""

MIN_DEPTH: Final = 1e-3
"""Smallest depth, in cells, of an interior point for Qhull."""


class HalfSpaces(NamedTuple):
    """The half-spaces ``normals @ q <= offsets``, which bound a polytope.

    Attributes
    ----------
    normals : ndarray of float64, shape (m, d)
        Outward normals of length 1.
    offsets : ndarray of float64, shape (m,)
    """

    normals: Floats
    offsets: Floats

    def contain(self, points: Floats) -> Bools:
        """Return whether all half-spaces contain points, shape (n, d)."""
        return np.asarray((points @ self.normals.T <= self.offsets).all(axis=-1))

    def join(self, other: HalfSpaces) -> HalfSpaces:
        """Return these half-spaces, followed by others."""
        return HalfSpaces(*map(np.concatenate, zip(self, other, strict=True)))

    def place(self, corner: Floats, spacing: float) -> HalfSpaces:
        """Convert from cells to metres.

        The origin is at ``corner``, shape (d,).
        """
        return HalfSpaces(self.normals, spacing * self.offsets + self.normals @ corner)


class Polytope(NamedTuple):
    """Shape of a bounded polytope.

    Attributes
    ----------
    vertices : ndarray of float64, shape (n, d)
    volume : float
    center : ndarray of float64, shape (d,)
        Center of mass.
    covariance : ndarray of float64, shape (d, d)
        Second moments about the center, divided by the volume.
    """

    vertices: Floats
    volume: float
    center: Floats
    covariance: Floats


def make_box(low: Floats, high: Floats) -> HalfSpaces:
    """Make the half-spaces of a box with two corners, shape (d,)."""
    directions = np.eye(len(low))
    return HalfSpaces(np.vstack([directions, -directions]), np.concatenate([high, -low]))


def grow_polytope(
    cells: Floats, core: Floats, box: HalfSpaces, gap: float
) -> tuple[HalfSpaces, float] | None:
    """Grow a polytope around a core, between cells.

    Parameters
    ----------
    cells : ndarray of float64, shape (n, d)
        Centers of the cells to cut off.
    core : ndarray of float64, shape (2, d)
        Ends of a segment, equal for a point.
    box : HalfSpaces
        Further bounds, which contain the core.
    gap : float
        Distance to keep from cells, zero or above.

    Returns
    -------
    half_spaces : HalfSpaces
    volume : float
        Zero if the polytope is too thin to measure.

    None if a cell is too near to the core.
    """
    focus = core
    metric: Floats = np.eye(core.shape[1])
    best = None
    # Maximum number of ellipsoids.
    for _ in range(8):
        cuts = cut_cells(cells, core, focus, metric, gap)
        if cuts is None:
            break
        half_spaces = cuts.join(box)
        shape = measure_polytope(half_spaces, core.mean(axis=0))
        if shape is None:
            return best or (half_spaces, 0.0)
        if best is not None and shape.volume <= best[1]:
            break
        best = half_spaces, shape.volume
        inverse = np.linalg.inv(shape.covariance)
        metric = np.asarray(inverse / np.trace(inverse), dtype=np.float64)
        if (core[0] == core[1]).all():
            focus = np.stack([core[0], shape.center])
    return best


def cut_cells(
    cells: Floats, core: Floats, focus: Floats, metric: Floats, gap: float
) -> HalfSpaces | None:
    """Cut off cells by half-spaces that contain a core, nearest first.

    Arguments are as for :func:`grow_polytope`. Near is measured from the segment ``focus``, shape
    (2, d), by squared lengths ``v @ metric @ v``. Returns None if a cell is too near to the core.
    """
    normals = list[Floats]()
    offsets = list[float]()
    distances = measure_distances(cells, focus, metric)
    while len(cells):
        nearest = int(distances.argmin())
        normal = find_normal(cells[nearest], focus, metric)
        if not _contains_core(cells[nearest], normal, core, gap):
            normal = find_separation(cells[nearest], core)
            if not _contains_core(cells[nearest], normal, core, gap):
                return None
        supports = cells @ normal - HALF_CELL * np.abs(normal).sum()
        offset = float(supports[nearest]) - gap
        if (core @ normal).max() > offset:  # by rounding
            return None
        normals.append(normal)
        offsets.append(offset)
        is_left = supports < supports[nearest]
        cells = cells[is_left]
        distances = distances[is_left]
    dim = core.shape[1]
    return HalfSpaces(np.array(normals).reshape(-1, dim), np.array(offsets))


def _contains_core(center: Floats, normal: Floats, core: Floats, gap: float) -> bool:
    """Return True if the half-space before a cell contains a core."""
    offset = center @ normal - HALF_CELL * np.abs(normal).sum() - gap
    return bool(normal.any() and (core @ normal).max() <= offset)


def measure_distances(points: Floats, segment: Floats, metric: Floats) -> Floats:
    """Return squared distances from a segment in a metric, shape (n,)."""
    start, end = segment
    direction = end - start
    steps = points - start
    squared_length = direction @ metric @ direction
    if squared_length > 0.0:
        shares = np.clip(steps @ (metric @ direction) / squared_length, 0.0, 1.0)
        steps = steps - shares[:, np.newaxis] * direction
    return np.asarray(((steps @ metric) * steps).sum(axis=1))


def find_normal(center: Floats, segment: Floats, metric: Floats) -> Floats:
    """Find the unit normal between segment and cell.

    It is the gradient of the distance from the segment at the nearest point of the cell, found by
    descent along one coordinate after another. The gradient is zero along a coordinate in which
    that point is inside its bounds. Returns zeros if the segment meets the cell.
    """
    # Plain floats, because arrays of two or three numbers are ten times slower.
    axes = range(len(center))
    start, end = segment
    direction = end - start
    image = metric @ direction
    squared_length = float(direction @ image)
    low = (center - HALF_CELL).tolist()
    high = (center + HALF_CELL).tolist()
    rows = metric.tolist()
    # Squared distances from the whole line, which one coordinate alone can lower to the least.
    line_rows = rows
    if squared_length > 0.0:
        line_rows = (metric - np.outer(image, image) / squared_length).tolist()
    nearest = center.tolist()
    # Number of times that each coordinate of a cell's nearest point is improved. More sweeps change
    # the direction of a half-space, not its proof.
    for sweep in range(8):
        share = 0.0
        if squared_length > 0.0:
            share = min(max(float(image @ (nearest - start)) / squared_length, 0.0), 1.0)
        origin = (start + share * direction).tolist()
        shape = line_rows if 0.0 < share < 1.0 else rows
        if sweep == 0:
            nearest = [min(max(origin[i], low[i]), high[i]) for i in axes]
        for i in axes:
            # Curvature along a coordinate, as a share of that of the metric, below which it is
            # zero.
            if shape[i][i] > 1e-12 * rows[i][i]:
                slope = sum(shape[i][j] * (nearest[j] - origin[j]) for j in axes)
                nearest[i] = min(max(nearest[i] - slope / shape[i][i], low[i]), high[i])
    step = nearest - start
    if squared_length > 0.0:
        step -= min(max(float(image @ step) / squared_length, 0.0), 1.0) * direction
    at_bound = np.equal(nearest, low) | np.equal(nearest, high)
    gradient = np.where(at_bound, metric @ step, 0.0)
    length = float(np.linalg.norm(gradient))
    return gradient / length if length > 0.0 else np.zeros(len(center))


def find_separation(center: Floats, segment: Floats) -> Floats:
    """Find the unit vector from segment to cell.

    It joins the nearest points of both; it is zero if they meet.

    The two nearest points solve a least-squares problem with bounds, by active sets.
    """
    start, end = segment
    length = float(np.linalg.norm(end - start))
    columns = np.eye(len(center))
    low = center - HALF_CELL
    high = center + HALF_CELL
    if length > 0.0:
        columns = np.column_stack([columns, (start - end) / length])
        low = np.append(low, 0.0)
        high = np.append(high, length)
    # Tolerance of optimality of the nearest points of a segment and a cell, in cells.
    nearest = lsq_linear(columns, start, (low, high), method="bvls", tol=1e-14).x
    step = columns @ nearest - start
    distance = float(np.linalg.norm(step))
    return step / distance if distance > 0.0 else np.zeros(len(center))


def measure_polytope(half_spaces: HalfSpaces, interior: Floats) -> Polytope | None:
    """Measure a bounded polytope; return None if it is too thin.

    ``interior``, shape (d,), is a point of it.
    """
    depth = float((half_spaces.offsets - half_spaces.normals @ interior).min())
    if depth < MIN_DEPTH:
        interior, depth = find_deepest(half_spaces)
    if depth <= 0.0:
        return None
    rows = np.column_stack([half_spaces.normals, -half_spaces.offsets])
    try:
        vertices = HalfspaceIntersection(rows, interior).intersections
        hull = ConvexHull(vertices)
    except QhullError:
        return None
    # The pyramids from a point inside to the simplices of the border.
    edges = vertices[hull.simplices] - interior
    volumes = np.abs(np.linalg.det(edges))
    weights = volumes / volumes.sum()
    dim = len(interior)
    sums = edges.sum(axis=1)
    offset = weights @ sums / (dim + 1)
    squares = np.einsum("n,nki,nkj->ij", weights, edges, edges)
    squares += np.einsum("n,ni,nj->ij", weights, sums, sums)
    covariance = squares / ((dim + 1) * (dim + 2)) - np.outer(offset, offset)
    return Polytope(vertices[hull.vertices], float(hull.volume), interior + offset, covariance)


def find_deepest(half_spaces: HalfSpaces) -> tuple[Floats, float]:
    """Find a polytope's largest ball: center and radius.

    It solves a linear program.

    The radius is negative if the polytope is empty.
    """
    normals, offsets = half_spaces
    count, dim = normals.shape
    cost = np.append(np.zeros(dim), -1.0)
    rows = np.column_stack([normals, np.ones(count)])
    # The solver's tolerances are absolute, so it gets lengths of about 1 around a point nearby.
    near = np.array(np.linalg.lstsq(normals, offsets)[0], dtype=np.float64)
    rest = offsets - normals @ near
    unit = np.abs(rest).max() or 1.0
    solution = linprog(cost, rows, rest / unit, bounds=(None, None)).x
    if solution is None:  # the solver fails, e.g. beyond the range of numbers
        return near, -np.inf
    return near + unit * solution[:dim], float(unit * solution[dim])
