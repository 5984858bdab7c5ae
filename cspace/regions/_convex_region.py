"""Convex regions of configurations, each proven FREE."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.inside import Bools, Floats, check_points, frozen, show_png, turn_near, warn_of_large
from cspace.regions._growth import HalfSpaces, Polytope, find_deepest, measure_polytope

if TYPE_CHECKING:
    from matplotlib.axes import Axes

YAW: str = "yaw"
"""Name of the axis whose values are wrapped."""


@dataclass(frozen=True, eq=False, repr=False)
class ConvexRegion:
    """A convex polytope of configurations that are all proven FREE.

    A straight motion between two configurations of the region stays in it, so it is free. With a
    yaw, the region is a polytope of positions times an arc of yaws, which the last two rows bound.
    Its yaws are unwrapped: they lie around that of :attr:`center`, and may leave [-pi, pi).
    :meth:`contains` and :meth:`unwrap` add the multiple of 2 pi that brings a yaw within pi of
    ``center[-1]``; do so before you compare ``A @ q <= b``. If the arc is wider than half a turn,
    the shorter way between two yaws may leave it; the motion of unwrapped yaws does not.

    Attributes
    ----------
    A : ndarray of float64, shape (m, size), read-only
        Outward normals of the half-spaces ``A @ q <= b``, each of length 1.
    b : ndarray of float64, shape (m,), read-only
        Offsets, in metres, radians for the yaw; for a map of joints in the joints' units.
    axes : tuple of str
        Names of the coordinates, those of the map.
    """

    A: Floats
    b: Floats
    axes: tuple[str, ...]

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        frozen(self.A)
        frozen(self.b)

    def __repr__(self) -> str:
        """Return center, volume and number of half-spaces."""
        center = ", ".join(f"{value:.6g}" for value in self.center.tolist())
        size = f"volume={self.volume:.3g}, half_spaces={len(self.b)}"
        return f"ConvexRegion(center=({center}), {size})"

    @overload
    def contains(self, q: Sequence[float]) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def contains(self, q: ArrayLike) -> Bools: ...
    def contains(self, q: ArrayLike) -> bool | Bools:
        """Return True if the region contains a configuration.

        Its yaw may be wrapped.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        bool or ndarray of bool, shape (...)

        Raises
        ------
        InputError
            If the last axis is not ``len(axes)`` long, or a value is not finite.

        Warns
        -----
        AngleWarning
            If a yaw is over a turn from zero and the center's, as if it were in degrees.
        """
        points = self.unwrap(q)
        inside = np.asarray((points @ self.A.T <= self.b).all(axis=-1))
        return inside if inside.ndim else bool(inside)

    def unwrap(self, q: ArrayLike) -> Floats:
        """Add whole turns to yaws, to within pi of the center's.

        Parameters
        ----------
        q : array-like, shape (..., size)
            Metres, and radians.

        Returns
        -------
        ndarray of float64, shape (..., size)
        """
        points = check_points(q, "q", self.axes).copy()
        if self._has_yaw:
            yaws = points[..., -1:]
            turns = yaws - self._middle_yaw
            # Unwrapped yaws near the center's may be many turns, and are no degrees.
            nearer = np.where(np.abs(turns) < np.abs(yaws), turns, yaws)
            warn_of_large(nearer, "rad", "q", {0: YAW})
            points[..., -1] = turn_near(points[..., -1], np.asarray(self._middle_yaw), True)
        return points

    @property
    def vertices(self) -> Floats:
        """Corners of the region, shape (n, size).

        With a yaw, they are at both ends of the arc.
        """
        corners = self._positions.vertices
        if not self._has_yaw:
            return corners.copy()
        return np.array([[*corner, yaw] for yaw, corner in product(self._arc, corners)])

    @property
    def volume(self) -> float:
        """Area or volume of the positions, times the radians of yaws."""
        low, high = self._arc
        return self._positions.volume * (high - low if self._has_yaw else 1.0)

    @property
    def center(self) -> Floats:
        """Center of mass, and the middle of the arc, shape (size,)."""
        center = self._positions.center
        return np.append(center, self._middle_yaw) if self._has_yaw else center.copy()

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the region's box.

        Both have shape (size,).
        """
        vertices = self.vertices
        return vertices.min(axis=0), vertices.max(axis=0)

    _repr_png_ = show_png

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the positions of the region.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw into, such as those of :meth:`cspace.CSpace.plot`; by default of a new
            figure. Regions in space need axes in three dimensions.
        **style
            Options of a matplotlib collection, such as ``facecolor``.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        InputError
            If the axes have another dimension.
        """
        return plot_regions([self], ax, style)

    # ---- the two factors: positions and yaws -----------------------------------------------------

    @cached_property
    def _has_yaw(self) -> bool:
        """Whether the last coordinate is a yaw."""
        return self.axes[-1] == YAW

    @cached_property
    def _arc(self) -> tuple[float, float]:
        """Lowest and highest yaw, radians; zeros without a yaw."""
        if not self._has_yaw:
            return 0.0, 0.0
        return -float(self.b[-1]), float(self.b[-2])

    @cached_property
    def _middle_yaw(self) -> float:
        """Middle of the arc of yaws, radians."""
        return 0.5 * sum(self._arc)

    @cached_property
    def _position_half_spaces(self) -> HalfSpaces:
        """Half-spaces of the positions."""
        if not self._has_yaw:
            return HalfSpaces(self.A, self.b)
        return HalfSpaces(self.A[:-2, :-1], self.b[:-2])

    @cached_property
    def _positions(self) -> Polytope:
        """Shape of the polytope of positions."""
        # Lengths relative to the deepest point keep the digits of small regions far away.
        half_spaces = self._position_half_spaces
        deepest, radius = find_deepest(half_spaces)
        shape = None
        if radius > 0.0:
            offsets = (half_spaces.offsets - half_spaces.normals @ deepest) / radius
            shape = measure_polytope(half_spaces._replace(offsets=offsets), np.zeros(len(deepest)))
        if shape is None:  # too thin to measure, so a single point
            dim = len(deepest)
            return Polytope(deepest[np.newaxis], 0.0, deepest, np.zeros((dim, dim)))
        volume = math.prod([radius] * len(deepest), start=shape.volume)
        vertices = deepest + radius * shape.vertices
        return Polytope(vertices, volume, deepest + radius * shape.center, shape.covariance)


def plot_regions(regions: Sequence[ConvexRegion], ax: Axes | None, style: dict[str, Any]) -> Axes:
    """Draw the positions of regions, by default in faint purple; see :meth:`ConvexRegion.plot`."""
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
    from scipy.spatial import ConvexHull

    from cspace.plot import check_axes

    check_axes(ax)
    dim = regions[0]._positions.vertices.shape[1]
    kind = "3d" if dim == 3 else "rectilinear"
    axes: Any = Figure().add_subplot(projection=kind) if ax is None else ax
    if axes.name != kind:
        problem = f"has the projection {axes.name!r} and the region {dim} dimensions"
        raise InputError("ax", problem, f"the projection must be {kind!r}")
    look: dict[str, Any] = {
        "facecolor": "#6a1b9a40",
        "edgecolor": "#6a1b9a",
        "linewidth": 1.0,
    } | style
    if dim == 2:
        # Qhull lists the vertices in the plane around the polygon.
        polygons = [region._positions.vertices for region in regions]
        axes.add_collection(PolyCollection(polygons, **look))
    else:
        for region in regions:
            vertices = region._positions.vertices
            faces = vertices[ConvexHull(vertices).simplices]
            axes.add_collection3d(Poly3DCollection(faces, **look))
    axes.autoscale_view()
    drawn: Axes = axes
    return drawn
