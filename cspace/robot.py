"""Robots: rigid shapes whose reference point is the origin of their own frame."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.bodies import Balls, Body, Box, Regions, Solid, Voxels
from cspace.bodies.body import Surface
from cspace.errors import GeometryError, InputError
from cspace.grid import MAX_COORDINATE, finite, positive, unmasked
from cspace.raster.raster import Raster
from cspace.shapes import check_balls, check_origin, check_point, check_polygons, polygon_name, warn_of_origin

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.mesh import Solid as Solidity
    from cspace.spectral import Spheres

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Robot:
    """A rigid robot in the plane or in space.

    Make one with :meth:`polygon`, :meth:`rectangle` or :meth:`disc` in the plane, :meth:`mesh`, :meth:`box` or
    :meth:`ball` in space, and :meth:`balls`, :meth:`cells` or :meth:`open` in either. The reference point, whose
    position is the configuration, is the origin; it may lie anywhere, also outside the shape.

    Attributes
    ----------
    name : str
        A short text for people, such as ``"disc 0.3 m"``.
    definition : str
        JSON of :attr:`spec`.
    body : Body
        The shape, in the robot's frame.
    """

    name: str
    definition: str
    body: Body

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self.body.dim

    @property
    def span(self) -> float:
        """Largest modulus of the numbers that the shape was computed from, metres."""
        return self.body.span

    @property
    def outlines(self) -> tuple[Floats, ...]:
        """Border segments ``(x0, y0, x1, y1)`` of each region of a polygon or bitmap in the plane; otherwise empty."""
        return self.body.outlines if isinstance(self.body, Regions) else ()

    @property
    def centers(self) -> Floats:
        """Middles of balls, shape (n, dim), metres; empty for other bodies."""
        return self.body.centers if isinstance(self.body, Balls) else np.empty((0, self.dim))

    @property
    def radii(self) -> Floats:
        """Radii of balls, shape (n,), metres; empty for other bodies."""
        return self.body.radii if isinstance(self.body, Balls) else np.empty(0)

    @property
    def spec(self) -> dict[str, Any]:
        """Plain numbers, strings and lists from which :meth:`from_spec` makes the same robot again."""
        spec: dict[str, Any] = json.loads(self.definition)
        return spec

    @classmethod
    def _of(cls, name: str, spec: dict[str, Any], body: Body) -> Robot:
        return cls(name, json.dumps({"name": name, **spec}, sort_keys=True), body)

    @classmethod
    def polygon(cls, shape: Any, *, name: str | None = None) -> Robot:
        """A polygon, convex or not, with or without holes, or several of them.

        Parameters
        ----------
        shape : shapely Polygon or MultiPolygon, a sequence of them, or array-like of shape (n, 2)
            Metres; an array holds the vertices in order, closed or not. Parts may overlap.

        Raises
        ------
        GeometryError
            If a part is empty, has no area, crosses itself, or is not a polygon.
        InputError
            If a coordinate is NaN or infinite.
        """
        from cspace.raster.outlines import polygon_outline

        parts = check_polygons(shape)
        return cls._of(
            name=name or polygon_name(parts),
            spec={"kind": "polygon", "wkb": [base64.b64encode(part.wkb).decode() for part in parts]},
            body=Regions([polygon_outline(part) for part in parts]),
        )

    @classmethod
    def rectangle(cls, length: float, width: float, center: ArrayLike = (0.0, 0.0)) -> Robot:
        """A rectangle, ``length`` along x and ``width`` along y around ``center`` in the robot's frame (metres)."""
        import shapely

        half_length, half_width = positive(length, "length") / 2, positive(width, "width") / 2
        x, y = check_point(center)
        box = shapely.box(x - half_length, y - half_width, x + half_length, y + half_width)
        return cls.polygon(box, name=f"rectangle {length:g} m x {width:g} m")

    @classmethod
    def disc(cls, radius: float, center: ArrayLike = (0.0, 0.0)) -> Robot:
        """A disc of ``radius`` around ``center`` in the robot's frame (metres)."""
        return cls.balls([check_point(center)], [positive(radius, "radius")])

    @classmethod
    def ball(cls, radius: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """A ball of ``radius`` around ``center`` in the robot's frame (metres)."""
        return cls.balls([check_point(center, dim=3)], [positive(radius, "radius")])

    @classmethod
    def balls(cls, centers: ArrayLike | Spheres, radii: ArrayLike | None = None) -> Robot:
        """A union of discs in the plane, or of balls in space.

        Parameters
        ----------
        centers : array-like, shape (n, 2) or (n, 3), or Spheres
            Metres, in the robot's frame. A decomposition brings its radii.
        radii : array-like, shape (n,), or one number
            Metres, above zero.

        Raises
        ------
        InputError
            If there is no ball, the shapes do not fit, a value is not finite, or a radius is not above zero.
        """
        points, sizes = check_balls(centers, radii)
        if (sizes <= 0).any():
            raise InputError(f"radii holds {sizes.min():g}; each must be above zero; drop balls that have no volume")
        kind = "disc" if points.shape[1] == 2 else "ball"
        return cls._of(
            name=f"{kind} {sizes[0]:g} m" if len(points) == 1 else f"{len(points)} {kind}s",
            spec={"kind": "balls", "centers": points.tolist(), "radii": sizes.tolist()},
            body=Balls(points, sizes),
        )

    @classmethod
    def box(cls, extents: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """A box along the axes.

        Parameters
        ----------
        extents : array-like, shape (3,)
            Lengths along x, y and z, metres, above zero.
        center : array-like, shape (3,)
            Middle of the box in the robot's frame, metres.
        """
        sides = np.array(check_point(extents, "extents", dim=3))
        for number, side in enumerate(sides.tolist()):
            positive(side, f"extents[{number}], the side along {'xyz'[number]},")
        middle = np.array(check_point(center, dim=3))
        return cls._of(
            name=f"box {' m x '.join(f'{side:g}' for side in sides)} m",
            spec={"kind": "box", "extents": sides.tolist(), "center": middle.tolist()},
            body=Box(middle - sides / 2, middle + sides / 2),
        )

    @classmethod
    def mesh(cls, shape: Any, *, solid: Solidity = "auto", name: str | None = None) -> Robot:
        """A triangle mesh.

        Parameters
        ----------
        shape : trimesh.Trimesh, trimesh.Scene, cspace.mesh.Mesh, path-like, or (vertices, faces)
            Metres, in the robot's frame; files are ``.stl``, ``.obj``, ``.ply``, ``.off``, ``.glb``, ``.gltf`` and
            ``.dae``. A warning tells of a mesh that lies off its origin by more than its own size.
        solid : {"auto", "surface", "fill"}
            What has an inside; see :class:`cspace.mesh.Mesh`, of which "auto" leaves what it says itself.

        Raises
        ------
        GeometryError
            If there is no triangle, or the mesh lies so far from its origin, by more than a hundred times its size,
            that the reference point can hardly be meant.
        InputError
            If a coordinate is NaN or infinite, or ``solid`` is another word.
        FileError
            If the file cannot be read.
        """
        from cspace.mesh import Mesh

        mesh = Mesh.of(shape, solid)
        check_origin(*mesh.bounds)
        warn_of_origin(*mesh.bounds)
        return cls._of(
            name=name or f"mesh of {len(mesh.faces)} triangles",
            spec={"kind": "mesh", **mesh.spec()},
            body=Solid(mesh),
        )

    @classmethod
    def cells(cls, occupied: ArrayLike, spacing: float, lower: ArrayLike | None = None) -> Robot:
        """A bitmap: the union of the closed cells ``lower + spacing * (i + [0, 1]^d)`` where ``occupied[i]`` is set.

        Parameters
        ----------
        occupied : array-like of bool, shape (nx, ny) or (nx, ny, nz)
            Indexed ``[x, y]`` or ``[x, y, z]``.
        spacing : float
            Side of a cell of the bitmap, metres; it need not be the map's.
        lower : array-like, shape (d,), optional
            Lower corner of the first cell in the robot's frame, metres; the origin if left out.

        Raises
        ------
        GeometryError
            If no cell is occupied.
        InputError
            If ``occupied`` is not boolean with two or three axes, or another value is not as stated.
        """
        unmasked(occupied, "occupied")
        bitmap = np.asarray(occupied)
        if bitmap.ndim not in (2, 3) or bitmap.dtype != np.bool_:
            raise InputError(
                f"occupied has shape {bitmap.shape} and type {bitmap.dtype}; it must be a boolean array of two or "
                "three axes; compare with a threshold first, e.g. array > 0"
            )
        bitmap = bitmap != 0  # a boolean array may hold other bytes than 0 and 1
        if not bitmap.any():
            raise GeometryError("occupied holds no True cell; a robot must have an area; set the cells it fills")
        side = positive(spacing, "spacing")
        corner = check_point((0.0,) * bitmap.ndim if lower is None else lower, "lower", dim=bitmap.ndim)
        return cls._of(
            name=f"bitmap {' x '.join(map(str, bitmap.shape))} cells of {side:g} m",
            spec={
                "kind": "cells",
                "bits": base64.b64encode(np.packbits(bitmap).tobytes()).decode(),
                "shape": list(bitmap.shape),
                "spacing": side,
                "lower": list(corner),
            },
            body=_bitmap(bitmap, side, np.array(corner)),
        )

    @classmethod
    def from_spec(cls, spec: dict[str, Any]) -> Robot:
        """The robot that :attr:`spec` describes.

        Raises
        ------
        InputError
            If ``spec`` describes no robot.
        """
        from cspace.specs import robot_from_spec

        return robot_from_spec(spec)

    @classmethod
    def open(cls, source: str | Path, *, solid: Solidity | None = None) -> Robot:
        """A robot from a short text or a file.

        Parameters
        ----------
        source : str or Path
            ``disc:RADIUS``, ``rect:LENGTHxWIDTH``, ``ball:RADIUS``, ``box:XxYxZ`` (metres); a file of polygons:
            ``.geojson``, ``.json`` or ``.wkt``; or a mesh: ``.stl``, ``.obj``, ``.ply``, ``.off``, ``.glb``, ``.gltf``,
            ``.dae``.
        solid : {"auto", "surface", "fill"}, optional
            For a mesh: what has an inside; "auto" if left out.

        Raises
        ------
        InputError
            If the text is none of these, or ``solid`` is given for what is no mesh.
        FileError
            If the file cannot be read.
        """
        from cspace.specs import open_robot

        return open_robot(source, solid)

    @property
    def geometry(self) -> BaseGeometry:
        """The shape in the robot's frame, of a robot in the plane, as a shapely geometry in metres, for drawing.

        Discs are drawn as polygons of 128 corners; the rasters never use this.
        """
        return self.body.geometry

    @property
    def surface(self) -> Surface:
        """The shape in the robot's frame, of a robot in space, as vertices (V, 3) and triangles (F, 3), for drawing.

        Balls are drawn with flat faces; the rasters never use this.
        """
        return self.body.surface

    @property
    def symmetry(self) -> int:
        """How many turns of the plane in a circle map the robot to itself: 1, 2 or 4, or 0 for all turns.

        Only turns that map it to itself to the last bit count.
        """
        if self.body.is_round:
            return 0
        for order, turn in ((4, [[0.0, 1.0], [-1.0, 0.0]]), (2, [[-1.0, 0.0], [0.0, -1.0]])):
            if self.body.is_same_turned(np.asarray(turn)):
                return order
        return 1

    def rasters(
        self, spacing: float, margin: float = 0.0, *, yaw: float = 0.0, sweep: float = 0.0
    ) -> tuple[Raster, Raster]:
        """The discrete robot at a spacing.

        Parameters
        ----------
        spacing : float
            Side of the map's cells, metres.
        margin : float
            Metres by which the robot is grown, on the outer side only.
        yaw : float
            Turn of the robot about its reference point, radians.
        sweep : float
            The rasters hold for all turns within this angle of ``yaw``, radians.

        Returns
        -------
        outer : Raster
            Every offset ``m`` for which the grown robot meets ``spacing * (m + [-1, 1]^2)``.
        inner : Raster
            Only offsets ``m`` for which ``spacing * m`` lies in the robot.

        Raises
        ------
        InputError
            If the spacing is not above zero, the margin is negative, or the robot is absurdly large or far from its
            reference point at that spacing.
        """
        side = positive(spacing, "spacing")
        grown = check_margin(margin)
        far = (self.span + grown) / side
        if not far <= MAX_COORDINATE:
            raise InputError(
                f"the robot reaches {far:.3g} cells from its reference point; at most {MAX_COORDINATE:.0f} keep the "
                "answers proven against rounding; use a larger spacing, or check the robot's units (metres) and origin"
            )
        return self.body.rasters(side, grown, yaw, sweep)


def check_margin(margin: float) -> float:
    """``margin`` as a float, zero or above (metres).

    Raises
    ------
    InputError
        If it is not one number, not finite, or negative.
    """
    value = finite(margin, "margin")
    if value.ndim or value < 0.0:
        raise InputError(f"margin is {margin!r}; it must be one number, zero or above; it grows the robot, in metres")
    return float(value)


def _bitmap(bitmap: NDArray[np.bool_], side: float, corner: Floats) -> Body:
    """The body of a bitmap: in the plane by its outline, in space by its voxels."""
    if bitmap.ndim == 3:
        return Voxels(bitmap, side, corner)
    from cspace.raster.boundary import boundary_segments

    span = float(np.abs(corner).max()) + side * max(bitmap.shape)
    return Regions([boundary_segments(bitmap, side, corner)], span)
