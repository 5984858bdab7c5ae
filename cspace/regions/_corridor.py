"""Corridors: convex regions of FREE configurations along a path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cspace.errors import InputError
from cspace.inside import ANGLE_SLACK, Floats, frozen, show_png
from cspace.regions._convex_region import ConvexRegion, plot_regions
from cspace.regions._free_region import RegionSource, YawArc

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace import Space


@dataclass(frozen=True, eq=False, repr=False)
class Corridor:
    """Convex regions along a path, each overlapping the next.

    Attributes
    ----------
    regions : tuple of ConvexRegion
        Regions in the order of the path.
    path : ndarray of float64, shape (n, size), read-only
        Rows of the path; its yaws are unwrapped. An edge that turns in a narrow place is divided
        into edges of fewer yaws. Between two rows, a car follows its curve, which the regions
        contain as well.
    junctions : ndarray of float64, shape (regions - 1, size), read-only
        Rows in two regions that follow each other. Up to the next one, edges lie in one region.
    """

    regions: tuple[ConvexRegion, ...]
    path: Floats
    junctions: Floats

    def __repr__(self) -> str:
        """Return the numbers of regions and edges."""
        return f"Corridor({len(self.regions)} regions along {len(self.path) - 1} edges)"

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw all regions, as :meth:`ConvexRegion.plot` draws one."""
        return plot_regions(self.regions, ax, style)

    _repr_png_ = show_png


def make_corridor(
    space: Space, rows: Floats, reach: float, margin: float, deviation: float
) -> Corridor:
    """Find regions along a path, each for many edges.

    From the start on, each has as many edges as the search finds.

    Parameters
    ----------
    space : Space
        Map of the path.
    rows : ndarray of float64, shape (n, size)
        Configurations of the path, in canonical form.
    reach, margin : float
        As for :meth:`cspace.CSpace.free_region`, around edges.
    deviation : float
        Largest distance of the driven curve from the edges, metres; zero if edges are driven.

    Raises
    ------
    InputError
        If the space is no map in memory of positions, with or without a yaw; or a region contains
        no edge, because it is not in FREE cells or within the margin of others.
    """
    source = RegionSource.of(space, reach, margin)
    if len(rows) == 1:
        rows = rows[[0, 0]]
    if not deviation:
        _check_edges(source, rows)
    steps = source.space.steps_between(rows[:-1], rows[1:])
    path = np.concatenate([rows[:1], rows[0] + np.cumsum(steps, axis=0)])
    path[:, : source.space.dim] = rows[:, : source.space.dim]
    regions = list[ConvexRegion]()
    starts = list[int]()  # of regions, in the rows of the path
    numbers = list(range(len(rows) - 1))  # of the given edge that each edge is part of
    first = 0
    while first < len(path) - 1:
        found = _find_longest(source, path, first, deviation)
        edge = path[first : first + 2]
        if found is not None:
            region, last = found
            starts.append(first)
            regions.append(region)
            first = last
        elif source.has_yaw and abs(edge[1, -1] - edge[0, -1]) > ANGLE_SLACK:
            # Fewer yaws leave more positions.
            path = np.insert(path, first + 1, edge.mean(axis=0), axis=0)
            numbers.insert(first, numbers[first])
        else:
            raise _make_edge_error(rows[numbers[first] :][:2], source.margin)
    return Corridor(tuple(regions), frozen(path), frozen(path[starts[1:]]))


def _find_longest(
    source: RegionSource, path: Floats, first: int, deviation: float
) -> tuple[ConvexRegion, int] | None:
    """Find a region of many edges, and the row where it ends.

    It begins at the row ``first``.

    Steps double until a region is not found, and are halved from then on. Returns None if there is
    no region of one edge.
    """
    best = None
    last = first
    end = len(path) - 1  # the last row that may be reached
    step = 1
    is_growing = True
    while step and last < end:
        row = min(last + step, end)
        region = _find_region(source, path[first : row + 1], deviation)
        if region is None:
            end = row - 1
            is_growing = False
        else:
            is_inside = _contain_all(region, path[row + 1 :], deviation)
            last = row + int(np.argmin(np.append(is_inside, False)))
            best = region, last
        step = 2 * step if is_growing else min(step // 2, end - last)
    return best


def _find_region(source: RegionSource, rows: Floats, deviation: float) -> ConvexRegion | None:
    """Find a region that contains rows, shape (n, size), or None.

    It grows around their chord.
    """
    arc = None
    if source.has_yaw:
        # Room for the rounding of whoever follows the path.
        spare = 0.5 * ANGLE_SLACK
        arc = YawArc(float(rows[:, -1].min()) - spare, float(rows[:, -1].max()) + spare)
    region = source.grow(rows[[0, -1]], arc)
    if region is None or not _contain_all(region, rows, deviation).all():
        return None
    return region


def _contain_all(region: ConvexRegion, rows: Floats, deviation: float) -> Any:
    """Return whether a region contains each row and all within a deviation."""
    dim = len(region.axes) - int(region._has_yaw)
    room = region.b - deviation * np.linalg.norm(region.A[:, :dim], axis=1)
    return (rows @ region.A.T <= room).all(axis=1)


def _check_edges(source: RegionSource, rows: Floats) -> None:
    """Raise InputError that names the edges which are not in FREE cells."""
    is_free = np.atleast_1d(source.space.motion_is_free(rows[:-1], rows[1:]))
    wrong = np.flatnonzero(~is_free).tolist()
    # Maximum number of edges that a message names.
    max_named_edges = 8
    if wrong:
        names = ", ".join(map(str, wrong[:max_named_edges]))
        more = ", and more" if len(wrong) > max_named_edges else ""
        problem = f"leaves the FREE cells on edges {names}{more}, counted from 0"
        rule = "regions consist of FREE cells, without the geometry"
        raise InputError("plan", problem, rule)


def _make_edge_error(edge: Floats, margin: float) -> InputError:
    """Make the error for an edge, shape (2, size), that no region contains."""
    if margin:
        problem = f"is {margin:g}, and cells that are not FREE are nearer to the path"
        rule = "an edge lies inside a region, which keeps it"
        return InputError("margin", f"{problem} {_describe(edge)}", rule)
    problem = f"is too near to cells that are not FREE {_describe(edge)}"
    return InputError("plan", problem, "an edge lies inside a region")


def _describe(edge: Floats) -> str:
    """Return both ends of an edge as text."""
    first, last = (", ".join(f"{value:.6g}" for value in row) for row in edge.tolist())
    return f"from ({first}) to ({last})"
