"""Robots: rigid shapes whose reference point is the origin of their own frame."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from numpy.typing import ArrayLike

from cspace.arrays import Surface
from cspace.check import check_not_negative, check_positive
from cspace.errors import FileError, InputError
from cspace.grid import check_reach
from cspace.raster import Raster
from cspace.rotations import NO_ROTATION, RotationCell
from cspace.shapes import Balls, BoundedShape, Mesh, Polygons, Shape, Voxels, as_shape, primitives, shape_from_spec
from cspace.shown import NotebookPicture

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.files.urdf import PackageDirs
    from cspace.shapes import ShapeLike
    from cspace.shapes.balls import BallSet
    from cspace.shapes.mesh import MeshLike, Solid


GROWN: Final = "it grows the robot, in metres"
"""What a margin is, for messages."""


@dataclass(frozen=True, eq=False, init=False)
class Robot(NotebookPicture):
    """A rigid robot in the plane or in space.

    Make one with :meth:`polygon`, :meth:`rectangle`, :meth:`disc`, :meth:`ellipse`, :meth:`from_footprint` or
    :meth:`from_nav2` in the plane, :meth:`from_mesh`, :meth:`box`, :meth:`ball`, :meth:`cylinder`, :meth:`capsule` or
    :meth:`from_urdf` in space, and :meth:`from_balls`, :meth:`from_bitmap`, :meth:`parse` or :meth:`open` in either.
    The reference point, whose position is the configuration, is the origin; it may lie anywhere, also outside the
    shape.

    Attributes
    ----------
    name : str
        A short text for people, such as ``"disc 0.3 m"``.
    shape : Shape
        In the robot's frame.

    Examples
    --------
    >>> import cspace
    >>> cspace.Robot.rectangle(0.7, 0.5)
    Robot(rectangle 0.7 m x 0.5 m, in the plane)
    >>> cspace.Robot.parse("disc:0.3").span
    0.3
    """

    name: str
    shape: Shape

    def __init__(self, name: str, shape: ShapeLike) -> None:
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "shape", as_shape(shape))

    def __repr__(self) -> str:
        return f"Robot({self.name}, in {self.shape.place})"

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self.shape.dim

    @property
    def span(self) -> float:
        """Largest absolute value of the numbers that the shape was computed from, metres."""
        return self.shape.span

    @property
    def spec(self) -> dict[str, object]:
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
        return cls(*primitives.rectangle(length, width, center))

    @classmethod
    def ellipse(cls, radius_x: float, radius_y: float, center: ArrayLike = (0.0, 0.0)) -> Robot:
        """An ellipse with semi-axes along x and y.

        It is known by two polygons of 64 corners, one around it, whose corners reach at most 0.13 % farther, and one
        within: FREE is proven for the first and BLOCKED for the second, so that both hold for the ellipse.

        Parameters
        ----------
        radius_x, radius_y : float
            Semi-axes, half the length along x and along y, metres, above zero.
        center : array-like, shape (2,)
            Middle of the ellipse in the robot's frame, metres.

        Raises
        ------
        InputError
            If a size is not above zero, or the center is over 10^9 times as far from the reference point.

        Examples
        --------
        >>> import cspace
        >>> cspace.Robot.ellipse(0.5, 0.3)
        Robot(ellipse 0.5 m x 0.3 m, in the plane)
        """
        return cls(*primitives.ellipse(radius_x, radius_y, center))

    @classmethod
    def disc(cls, radius: float, center: ArrayLike = (0.0, 0.0)) -> Robot:
        """A disc of ``radius`` around ``center`` in the robot's frame (metres)."""
        return cls(*primitives.disc(radius, center))

    @classmethod
    def ball(cls, radius: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """A ball of ``radius`` around ``center`` in the robot's frame (metres)."""
        return cls(*primitives.ball(radius, center))

    @classmethod
    def from_balls(cls, centers: ArrayLike | BallSet, radii: ArrayLike | None = None) -> Robot:
        """A union of discs in the plane, or of balls in space.

        Parameters
        ----------
        centers : array-like, shape (n, 2) or (n, 3), or BallDecomposition
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
            hint = "drop balls that have no volume"
            raise InputError("radii", f"holds {least:g}", "each must be above zero", hint, value=least)
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
        return cls(*primitives.box(extents, center))

    @classmethod
    def cylinder(cls, radius: float, height: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """An upright cylinder, around the direction of z through ``center``, its middle (metres).

        It is bounded by two prisms of 64 sides, one around it, whose radius is 0.12 % larger, and one within: FREE is
        proven for the first and BLOCKED for the second, so that both hold for the cylinder.
        """
        return cls(*primitives.cylinder(radius, height, center))

    @classmethod
    def capsule(cls, radius: float, length: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """An upright capsule, all within ``radius`` of a segment ``length`` long, whose middle is ``center`` (metres).

        It is ``length + 2 * radius`` high. It is bounded by two polyhedra, as a :meth:`cylinder` is; the outer one
        reaches 0.24 % of the radius farther.
        """
        return cls(*primitives.capsule(radius, length, center))

    @classmethod
    def from_mesh(cls, shape: MeshLike, *, solid: Solid = "auto", name: str | None = None) -> Robot:
        """A triangle mesh.

        Parameters
        ----------
        shape : trimesh.Trimesh, trimesh.Scene, cspace.Mesh, path-like, or (vertices, faces)
            Metres, in the robot's frame; files are ``.stl``, ``.obj``, ``.ply``, ``.off``, ``.glb``, ``.gltf`` and
            ``.dae``. A warning names a mesh that lies off its origin by more than its own size.
        solid : {"auto", "surface", "fill"}
            What has an inside; see :class:`cspace.Mesh`, "auto" keeps what a ``cspace.Mesh`` says itself.

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
    def from_bitmap(cls, occupied: ArrayLike, spacing: float, lower: ArrayLike | None = None) -> Robot:
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
            If ``occupied`` is not boolean with two or three axes (0 and 1 are accepted), or another value is not as
            stated.
        """
        voxels = Voxels.of(occupied, spacing, lower)
        return cls(f"bitmap {' x '.join(map(str, voxels.occupied.shape))} cells of {voxels.side:g} m", voxels)

    @classmethod
    def from_footprint(cls, footprint: str | ArrayLike, *, padding: float = 0.0, name: str | None = None) -> Robot:
        """A polygon in the plane, given as Nav2's ``footprint`` is.

        Parameters
        ----------
        footprint : str or array-like, shape (n, 2)
            Corners in order, metres; a text is ``"[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"``.
        padding : float
            Metres by which each coordinate of a corner is moved away from zero, as by ``footprint_padding``.

        Raises
        ------
        GeometryError
            If it is no list of points, or they make no polygon.
        InputError
            If the padding is negative.
        """
        made = primitives.footprint(footprint, padding)
        return cls(name or made.name, made.shape)

    @classmethod
    def from_nav2(cls, path: str | os.PathLike[str], costmap: str | None = None) -> Robot:
        """The robot of a YAML file of Nav2's parameters, or of a ``costmap_common_params.yaml`` of ROS 1.

        A ``footprint`` is the polygon of :meth:`from_footprint`; without one, ``robot_radius`` is that of a disc. Both
        are padded by ``footprint_padding``, 0.01 m where the file does not say, as in Nav2; a disc all around.

        Parameters
        ----------
        path : path-like
        costmap : str, optional
            Whose robot, such as "local_costmap"; needed where the costmaps of the file differ in it.

        Raises
        ------
        FileError
            If the file is missing or malformed, holds no robot, or several, or not of that costmap.
        GeometryError
            If the corners make no polygon.
        """
        from cspace.files.ros import read_nav2

        base = read_nav2(path, costmap)
        if base.corners:
            return cls.from_footprint(base.corners, padding=base.padding, name=f"footprint of {Path(path).name}")
        return cls.disc(base.radius + base.padding)

    @classmethod
    def from_urdf(
        cls,
        path: str | os.PathLike[str],
        link: str | Sequence[str] | None = None,
        *,
        solid: Solid = "auto",
        package_dirs: PackageDirs = (),
    ) -> Robot:
        """The collision geometry of a URDF: of a link, of several, or of all that is fixed to the root.

        Boxes and meshes are taken as they are; cylinders and spheres are bounded by two polyhedra, as :meth:`cylinder`
        is.

        A mesh named ``package://PACKAGE/REST`` is the file ``PACKAGE/REST`` in the first of these folders that has it:

        1. each of ``package_dirs``;
        2. the folder of the URDF, then those above it, the nearest first;
        3. each of the environment variable ``ROS_PACKAGE_PATH``;
        4. ``share`` in each of ``AMENT_PREFIX_PATH``.

        A mesh named ``REST`` or ``file://REST`` is that file, relative to the folder of the URDF. If no such file
        exists, but exactly one ``REST`` in 1 and 2 does, that file is read and a warning names it.

        Parameters
        ----------
        path : path-like
        link : str or sequence of str, optional
            Whose geometry to take, with the joints at zero; its reference point is the origin of the (first) link. If
            left out, that of the root and of the links that fixed joints join to it, in the frame of the root; a
            warning names those that have geometry and are left out because they move, such as wheels.
        solid : {"auto", "surface", "fill"}
            What of the geometry has an inside, as for :meth:`from_mesh`. Boxes, cylinders and spheres are solid, so
            that "surface" is for links of meshes alone.
        package_dirs : path-like or sequence of path-like, optional
            Folders that hold the folders of ROS packages.

        Raises
        ------
        FileError
            If the file or a mesh is missing or malformed, or several files could be meant by the name of a mesh.
        InputError
            If there is no such folder or link, the links have no collision geometry, a size is not above zero, or
            ``solid`` is "surface" and a link has a box, a cylinder or a sphere.
        MissingPackageError
            If yourdfpy is not installed.
        """
        from cspace.shapes.scenes import read_urdf

        surfaces = read_urdf(path, link, package_dirs, solid != "surface")
        outer, *inner = (Mesh(*surface, solid, Path(path).name) for surface in surfaces)
        outer.check_origin()
        names = "" if link is None else f" {link if isinstance(link, str) else ', '.join(link)}"
        return cls(f"{Path(path).name}{names}", BoundedShape(Mesh.of(outer), inner[0]) if inner else Mesh.of(outer))

    def footprint(self) -> Robot:
        """The projection of this robot onto the ground, for maps in the plane.

        What is proven FREE or BLOCKED for it holds for the robot's true projection, which lies between the two sides of
        it: grown by a micrometre, which covers rounding, and shrunk by as much. A robot in the plane is its own.

        Raises
        ------
        GeometryError
            If it has no area, seen from above.
        """
        return Robot(f"footprint of {self.name}", self.shape.project_to_plane()) if self.dim == 3 else self

    @classmethod
    def from_spec(cls, spec: Mapping[str, object]) -> Robot:
        """The robot that :attr:`spec` describes.

        Raises
        ------
        InputError
            If ``spec`` describes no robot.
        """
        try:
            robot = cls(str(spec["name"]), shape_from_spec(spec))
        except (KeyError, TypeError, ValueError) as error:
            rule = f"it must be one that Robot.spec makes: {error}"
            raise InputError("spec", f"is {str(spec)[:80]}", rule, "write it again", value=spec) from error
        robot.shape.check_origin()
        return robot

    @classmethod
    def parse(cls, text: str) -> Robot:
        """Make the robot that a short text describes; :meth:`open` reads files.

        Parameters
        ----------
        text : str
            ``disc:RADIUS``, ``rect:LENGTHxWIDTH``, ``ellipse:RADIUS_X,RADIUS_Y``, ``ball:RADIUS``, ``box:XxYxZ``,
            ``cylinder:RADIUSxHEIGHT``, ``capsule:RADIUSxLENGTH`` (metres), each followed by its center if that is not
            the origin, as in ``rect:4.5x1.9@1.3,0``; ``footprint:[[X,Y],...]``, or ``footprint:`` and the text of a
            robot in space, for its projection.

        Raises
        ------
        InputError
            If the text is none of these, or a size is not above zero.

        Examples
        --------
        >>> import cspace
        >>> cspace.Robot.parse("rect:0.7x0.5")
        Robot(rectangle 0.7 m x 0.5 m, in the plane)
        """
        if not isinstance(text, str) or not primitives.is_short_text(text):
            forms = ", ".join(primitives.SHORT_TEXTS)
            rule = "it must be a short text such as 'ball:0.3' (metres)"
            raise InputError("robot", f"is {text!r}", rule, f"pass {forms}; Robot.open reads files", value=text)
        return cls(*primitives.parse_short_text(text, "robot"))

    @classmethod
    def open(
        cls, path: str | os.PathLike[str], *, solid: Solid | None = None, package_dirs: PackageDirs | None = None
    ) -> Robot:
        """Read a robot from a file; :meth:`parse` takes short texts.

        Parameters
        ----------
        path : path-like
            Polygons: ``.geojson``, ``.json`` or ``.wkt``; a mesh: ``.stl``, ``.obj``, ``.ply``, ``.off``, ``.glb``,
            ``.gltf``, ``.dae``; a robot's description: ``.urdf``, links of it as ``FILE.urdf#LINK,LINK``; or Nav2's
            parameters: ``.yaml``, those of one costmap as ``FILE.yaml#COSTMAP``.
        solid : {"auto", "surface", "fill"}, optional
            For a mesh, or those of a URDF: what has an inside; "auto" if left out.
        package_dirs : path-like or sequence of path-like, optional
            For a URDF: folders that hold the folders of ROS packages, as for :meth:`from_urdf`.

        Raises
        ------
        InputError
            If the suffix is none of these, the path is a short text, or ``solid`` or ``package_dirs`` is given for a
            file that does not take it.
        FileError
            If the file cannot be read.
        """
        try:
            text = os.fspath(path)
        except TypeError as error:
            raise InputError(
                "robot", f"is {path!r}", "it must be a file name", "pass a string or a pathlib.Path", value=path
            ) from error
        files = _files()
        name, mark, part = text.rpartition("#")
        if not mark or Path(text).suffix.lower() in files:
            name, part = text, ""
        suffix = Path(name).suffix.lower()
        if primitives.is_short_text(text) and not Path(name).exists():
            raise InputError("robot", f"is {text!r}", "it must be a file", f"use Robot.parse({text!r})", value=path)
        if suffix not in files:
            forms, known = ", ".join(primitives.SHORT_TEXTS), ", ".join(files)
            if name and Path(name).exists():
                raise FileError(name, f"has the suffix {suffix!r}", f"a robot's are {known}", "convert the file")
            rule, hint = "it must be a file that describes a robot", f"pass {known}; Robot.parse takes {forms}"
            raise InputError("robot", f"is {text!r}", rule, hint, value=path)
        reader, taken = files[suffix]
        given = {"solid": solid, "package_dirs": package_dirs}
        options = {option: value for option, value in given.items() if value is not None}
        for option, value in options.items():
            if option not in taken:
                rule = f"it is for {', '.join(known for known, (_, names) in files.items() if option in names)}"
                raise InputError(option, f"is {value!r} for {text}", rule, "leave it out", value=value)
        return reader(Path(name), *[part] if part else [], **options)

    @property
    def geometry(self) -> BaseGeometry:
        """The shape of a robot in the plane, in its frame, as a shapely geometry in metres, for drawing.

        Discs are drawn as polygons of 128 corners. A shape that is known by an outer and an inner shape, such as a
        :meth:`footprint`, is drawn as the outer one. The rasters never use this.
        """
        return self.shape.outer.outline

    @property
    def surface(self) -> Surface:
        """The shape of a robot in space, in its frame, as vertices (V, 3) and triangles (F, 3), for drawing.

        Balls are drawn with flat faces; a shape that is known by an outer and an inner shape, such as a
        :meth:`cylinder`, is drawn as the outer one. The rasters never use this.
        """
        return self.shape.outer.surface

    @property
    def inscribed_radius(self) -> float:
        """Radius of a circle around the reference point that lies in a robot in the plane, metres; 0 if there is none.

        It is the largest such circle within rounding, with two exceptions, of which a lower bound is given: several
        discs, and a robot that is known by an outer and an inner shape, such as a :meth:`footprint`, whose inner shape
        counts.
        """
        return self.shape.inner.inscribed_radius

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """The discrete robot at a spacing, as two sets of offsets.

        Parameters
        ----------
        spacing : float
            Side of the map's cells, metres.
        margin : float
            Metres by which the robot is grown, on the outer side only.
        rotation : RotationCell
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
        side = check_positive(spacing, "spacing")
        grown = check_not_negative(margin, "margin", GROWN)
        # A corner of the box round the origin is farther away than its sides, and may be turned onto an axis.
        far = (self.span * (1.0 if rotation.matrix is None else math.sqrt(self.dim)) + grown) / side
        hint = "use a larger spacing, or check the robot's units (metres) and origin"
        check_reach(far, "robot", "its reference point", hint)
        return self.shape.rasters(side, grown, rotation)


def robot_of(source: Robot | ShapeLike) -> Robot:
    """Convert a shape, or anything that describes one, to a robot whose reference point is the origin.

    Raises CspaceError as :func:`cspace.shapes.as_shape` and the constructor for that shape.
    """
    if isinstance(source, Robot):
        return source
    if isinstance(source, str) and primitives.is_short_text(source):
        return Robot(*primitives.parse_short_text(source, "robot"))
    shape = as_shape(source, name="robot")
    if isinstance(shape, Mesh):
        return Robot.from_mesh(shape)
    if isinstance(shape, Polygons):
        return Robot.polygon(shape.geometries)
    if isinstance(shape, Balls):
        return Robot.from_balls(shape.centers, shape.radii)
    return Robot(type(shape).__name__.lower(), shape)


def _files() -> dict[str, tuple[Callable[..., Robot], tuple[str, ...]]]:
    """Return, by the suffix of a file, what makes a robot of it, and the names of the options that it takes.

    Its arguments are the path and, if the file holds several robots, the name of one.
    """
    from cspace.files.meshes import MESH_SUFFIXES
    from cspace.files.vector import POLYGON_SUFFIXES, read_shapes

    def mesh(path: Path, *part: str, solid: Solid = "auto") -> Robot:
        return Robot.from_mesh(path, solid=solid, name=f"mesh {path.name}")

    def polygon(path: Path, *part: str) -> Robot:
        return Robot.polygon(read_shapes(path), name=f"polygon {path.name}")

    def urdf(path: Path, *links: str, **options: Any) -> Robot:
        return Robot.from_urdf(path, links[0].split(",") if links else None, **options)

    return {
        **dict.fromkeys(POLYGON_SUFFIXES, (polygon, ())),
        **dict.fromkeys(MESH_SUFFIXES, (mesh, ("solid",))),
        ".urdf": (urdf, ("solid", "package_dirs")),
        **dict.fromkeys((".yaml", ".yml"), (Robot.from_nav2, ())),
    }
