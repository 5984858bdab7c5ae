"""Robots: rigid shapes whose reference point is the origin of their own frame."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from numpy.typing import ArrayLike

from cspace.errors import FileError, InputError
from cspace.grid import MAX_COORDINATE, finite, positive
from cspace.raster.raster import Raster
from cspace.rotations import STILL, Turn
from cspace.shapes import Balls, Box, Mesh, Polygons, Shape, Voxels, shape_from_spec
from cspace.shapes.shape import Surface, check_point

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.shapes.balls import BallSet
    from cspace.shapes.mesh import MeshLike, Solid


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
    shape : Shape
        In the robot's frame.
    """

    name: str
    shape: Shape

    def __repr__(self) -> str:
        return f"Robot({self.name}, in {self.shape.place})"

    def _repr_html_(self) -> str:
        """The repr and a small picture, for notebooks."""
        from cspace.plot import as_html

        return as_html(self, [repr(self)])

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self.shape.dim

    @property
    def span(self) -> float:
        """Largest modulus of the numbers that the shape was computed from, metres."""
        return self.shape.span

    @property
    def spec(self) -> dict[str, Any]:
        """Plain numbers, strings and lists from which :meth:`from_spec` makes the same robot again."""
        return {"name": self.name, **self.shape.spec}

    @property
    def definition(self) -> str:
        """JSON of :attr:`spec`."""
        return json.dumps(self.spec, sort_keys=True)

    @classmethod
    def polygon(cls, shape: ArrayLike | BaseGeometry | Sequence[BaseGeometry], *, name: str | None = None) -> Robot:
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
        polygons = Polygons.of(shape)
        count = len(polygons.geometries)
        return cls(
            name or f"polygon with {polygons.corners} corners" + (f" in {count} parts" if count > 1 else ""), polygons
        )

    @classmethod
    def rectangle(cls, length: float, width: float, center: ArrayLike = (0.0, 0.0)) -> Robot:
        """A rectangle, ``length`` along x and ``width`` along y around ``center`` in the robot's frame (metres)."""
        import shapely

        half_length, half_width = positive(length, "length") / 2, positive(width, "width") / 2
        x, y = check_point(center).tolist()
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
    def balls(cls, centers: ArrayLike | BallSet, radii: ArrayLike | None = None) -> Robot:
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
        balls = Balls.of(centers, radii)
        least = float(balls.radii.min())
        if least <= 0.0:
            raise InputError(
                "radii", f"holds {least:g}", "each must be above zero", "drop balls that have no volume", value=least
            )
        count = len(balls.radii)
        return cls(f"{balls.noun} {balls.radii[0]:g} m" if count == 1 else f"{count} {balls.noun}s", balls)

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
        box = Box.of(extents, center)
        return cls(f"box {' m x '.join(f'{side:g}' for side in box.extents)} m", box)

    @classmethod
    def mesh(cls, shape: MeshLike, *, solid: Solid = "auto", name: str | None = None) -> Robot:
        """A triangle mesh.

        Parameters
        ----------
        shape : trimesh.Trimesh, trimesh.Scene, cspace.Mesh, path-like, or (vertices, faces)
            Metres, in the robot's frame; files are ``.stl``, ``.obj``, ``.ply``, ``.off``, ``.glb``, ``.gltf`` and
            ``.dae``. A warning tells of a mesh that lies off its origin by more than its own size.
        solid : {"auto", "surface", "fill"}
            What has an inside; see :class:`cspace.Mesh`, of which "auto" leaves what it says itself.

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
        mesh = Mesh.of(shape, solid)
        mesh.check_origin(warn=True)
        return cls(name or f"mesh of {len(mesh.faces)} triangles", mesh)

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
        voxels = Voxels.of(occupied, spacing, lower)
        return cls(f"bitmap {' x '.join(map(str, voxels.occupied.shape))} cells of {voxels.side:g} m", voxels)

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Robot:
        """The robot that :attr:`spec` describes.

        Raises
        ------
        InputError
            If ``spec`` describes no robot.
        """
        try:
            robot = cls(str(spec["name"]), shape_from_spec(spec))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                "spec", f"is {str(spec)[:80]}", f"it must be one that Robot.spec makes: {error}", "write it again"
            ) from error
        robot.shape.check_origin()
        return robot

    @classmethod
    def open(cls, source: str | os.PathLike[str], *, solid: Solid | None = None) -> Robot:
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
        from cspace.io.meshes import SUFFIXES as MESHES
        from cspace.io.vector import SUFFIXES as POLYGONS
        from cspace.io.vector import read_shapes

        try:
            path = Path(source)
        except TypeError as error:
            raise InputError(
                "robot",
                f"is {source!r}",
                "it must be a short text such as 'ball:0.3' (metres), or a file name",
                "pass a string or a pathlib.Path",
            ) from error
        suffix = path.suffix.lower()
        if suffix in MESHES:
            return cls.mesh(path, solid=solid or "auto", name=f"mesh {path.name}")
        if solid is not None:
            raise InputError("solid", f"is {solid!r} for {source}", f"it is for {', '.join(MESHES)}", "leave it out")
        kind, colon, _ = str(source).partition(":")
        if colon and kind in _SHORT:
            return _from_text(str(source))
        if suffix in POLYGONS:
            return cls.polygon(read_shapes(path), name=f"polygon {path.name}")
        forms = ", ".join(f"{kind}:{_form(names)}" for kind, (names, _) in _SHORT.items())
        files = ", ".join((*POLYGONS, *MESHES))
        if path.exists():
            raise FileError(str(path), f"has the suffix {path.suffix!r}", f"a robot's are {files}", f"or pass {forms}")
        raise InputError(
            "robot", f"is {str(source)!r}", "it must be a short text or a file", f"pass {forms} (metres), or {files}"
        )

    @property
    def geometry(self) -> BaseGeometry:
        """The shape of a robot in the plane, in its frame, as a shapely geometry in metres, for drawing.

        Discs are drawn as polygons of 128 corners; the rasters never use this.
        """
        return self.shape.outline

    @property
    def surface(self) -> Surface:
        """The shape of a robot in space, in its frame, as vertices (V, 3) and triangles (F, 3), for drawing.

        Balls are drawn with flat faces; the rasters never use this.
        """
        return self.shape.surface

    @cached_property
    def symmetry(self) -> int:
        """How many turns about the z axis in a circle map the robot to itself: 1, 2 or 4, or 0 for all turns.

        Only turns that map it to itself to the last bit count.
        """
        return self.shape.symmetry

    @cached_property
    def half_turns(self) -> tuple[int, ...]:
        """The axes in space, 0 for x, about which a half turn maps the robot to itself, to the last bit.

        None of a robot in the plane.
        """
        return self.shape.half_turns

    @property
    def is_round(self) -> bool:
        """Whether every rotation about the reference point maps the robot to itself."""
        return self.shape.is_round

    def rasters(self, spacing: float, margin: float = 0.0, turn: Turn = STILL) -> tuple[Raster, Raster]:
        """The discrete robot at a spacing, as :meth:`cspace.shapes.Shape.rasters` tells.

        Parameters
        ----------
        spacing : float
            Side of the map's cells, metres.
        margin : float
            Metres by which the robot is grown, on the outer side only.
        turn : Turn
            The rotations about the reference point for which the rasters are to hold.

        Returns
        -------
        outer : Raster
            Every offset ``m`` for which the grown robot meets ``spacing * (m + [-1, 1]^d)``.
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
        # A corner of the box round the origin is farther away than its sides, and may be turned onto an axis.
        far = (self.span * (1.0 if turn.matrix is None else math.sqrt(self.dim)) + grown) / side
        if not far <= MAX_COORDINATE:
            raise InputError(
                "robot",
                f"reaches {far:.3g} cells from its reference point",
                f"at most {MAX_COORDINATE:.0f} keep the answers proven against rounding",
                "use a larger spacing, or check the robot's units (metres) and origin",
            )
        return self.shape.rasters(side, grown, turn)


def check_margin(margin: float) -> float:
    """``margin`` as a float, zero or above (metres).

    Raises
    ------
    InputError
        If it is not one number, not finite, or negative.
    """
    value = finite(margin, "margin")
    if value.ndim or value < 0.0:
        raise InputError(
            "margin",
            f"is {margin!r}",
            "it must be one number, zero or above",
            "it grows the robot, in metres",
            value=margin,
        )
    return float(value)


_SHORT: Final[dict[str, tuple[tuple[str, ...], Callable[..., Robot]]]] = {
    "disc": (("radius",), Robot.disc),
    "rect": (("length", "width"), Robot.rectangle),
    "ball": (("radius",), Robot.ball),
    "box": (("x", "y", "z"), lambda x, y, z: Robot.box((x, y, z))),
}
"""Short texts: the lengths that follow the colon, and what makes the robot."""


def _from_text(source: str) -> Robot:
    """The robot of a short text such as ``rect:0.9x0.6``."""
    kind, _, sizes = source.partition(":")
    names, make = _SHORT[kind]
    try:
        values = [float(word) for word in sizes.split("x")]
    except ValueError:
        values = []
    if len(values) != len(names) or not all(math.isfinite(value) and value > 0.0 for value in values):
        raise InputError(
            "robot",
            f"is {source!r}",
            f"after the colon must stand {_form(names)}, each above zero, in metres",
            f"write e.g. {kind}:{'x'.join(['0.3'] * len(names))}",
        )
    return make(*values)


def _form(names: Sequence[str]) -> str:
    """How the lengths of a short text are written, as ``LENGTHxWIDTH``."""
    return "x".join(name.upper() for name in names)
