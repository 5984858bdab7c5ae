"""Rigid robots, whose reference point is the origin of their frame."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from numpy.typing import ArrayLike

from cspace._files.access import check_suffix
from cspace._files.crs import warn_of_likely_degrees
from cspace._shapes import (
    Balls,
    Polygons,
    Shape,
    Voxels,
    as_shape,
    primitives,
    shape_from_spec,
)
from cspace._support.arrays import StrPath, Surface
from cspace._support.check import AnswersNames, choose_text, names_options
from cspace._support.limits import BITMAP_CELL_BYTES, PlannedGrid, check_memory
from cspace.errors import InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace._files.meshes import Up
    from cspace._shapes import ShapeLike
    from cspace._shapes.balls import BallSet
    from cspace._shapes.mesh import Mesh, MeshLike, Solid


@dataclass(frozen=True, eq=False, init=False)
class Robot(metaclass=AnswersNames):
    """A rigid robot in the plane or in space.

    Make one with :meth:`polygon`, :meth:`rectangle`, :meth:`disc`, :meth:`ellipse` or
    :meth:`from_footprint` in the plane, :meth:`from_mesh`, :meth:`box`,
    :meth:`ball`, :meth:`cylinder`, :meth:`capsule` or :meth:`from_urdf` in space, and
    :meth:`from_balls`, :meth:`from_bitmap`, :meth:`parse` or :meth:`open` in either. A
    configuration is the position of the reference point, which is the origin of the robot's frame.
    The origin need not lie in the shape.

    Attributes
    ----------
    name : str
        Description for people, such as ``"disc 0.3 m"``.
    shape : Shape
        Shape in the robot's frame.

    Examples
    --------
    >>> import cspace
    >>> cspace.Robot.rectangle(0.7, 0.5)
    Robot(rectangle 0.7 m x 0.5 m, in the plane)
    >>> cspace.Robot.parse("disc:0.3").spec
    {'name': 'disc 0.3 m', 'kind': 'balls', 'centers': [[0.0, 0.0]], 'radii': [0.3]}
    """

    name: str
    shape: Shape

    def __init__(self, name: str, shape: ShapeLike) -> None:
        """Convert the shape; the class is frozen."""
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "shape", as_shape(shape))

    def __repr__(self) -> str:
        """Return name and dimension."""
        return f"Robot({self.name}, in {self.shape.place})"

    @property
    def dim(self) -> int:
        """Dimension: 2 in the plane, 3 in space."""
        return self.shape.dim

    @property
    def spec(self) -> dict[str, object]:
        """Description in plain numbers, strings and lists, for :meth:`from_spec`."""
        return {"name": self.name, **self.shape.spec}

    @classmethod
    @names_options
    def polygon(
        cls, shape: ArrayLike | BaseGeometry | Sequence[BaseGeometry], *, name: str | None = None
    ) -> Robot:
        """Make a robot of polygons.

        They may be convex or not, with or without holes.

        Parameters
        ----------
        shape : shapely Polygon or MultiPolygon, a sequence of these, or array-like of shape (n, 2)
            Metres; an array lists the vertices in order, closed or not. Parts may overlap.

        Raises
        ------
        GeometryError
            If a part is empty, has no area, crosses itself, or is not a polygon.
        InputError
            If a coordinate is NaN or infinite.
        """
        polygons = Polygons.of(shape)
        warn_of_likely_degrees(polygons.bounds, "robot")
        count = len(polygons.geometries)
        parts = f" in {count} parts" if count > 1 else ""
        default = f"polygon with {polygons.corners} corners{parts}"
        return cls(choose_text(name, "name", default), polygons)

    @classmethod
    @names_options
    def rectangle(cls, length: float, width: float, center: ArrayLike = (0.0, 0.0)) -> Robot:
        """Make a rectangle.

        It has ``length`` along x and ``width`` along y, around ``center`` in the robot's frame
        (metres).
        """
        return cls(*primitives.rectangle(length, width, center))

    @classmethod
    @names_options
    def ellipse(cls, radius_x: float, radius_y: float, center: ArrayLike = (0.0, 0.0)) -> Robot:
        """Make an ellipse with semi-axes along x and y.

        FREE is proven for a polygon of 64 corners around the ellipse, which reaches at most 0.13 %
        farther, and BLOCKED for a polygon of 64 corners inside it, so that both hold for the
        ellipse.

        Parameters
        ----------
        radius_x, radius_y : float
            Semi-axes along x and y, metres, above zero.
        center : array-like, shape (2,)
            Center of the ellipse in the robot's frame, metres.

        Raises
        ------
        InputError
            If a size is not above zero, or the center is over 10^9 times as far from the reference
            point.

        Examples
        --------
        >>> import cspace
        >>> cspace.Robot.ellipse(0.5, 0.3)
        Robot(ellipse 0.5 m x 0.3 m, in the plane)
        """
        return cls(*primitives.ellipse(radius_x, radius_y, center))

    @classmethod
    @names_options
    def disc(cls, radius: float, center: ArrayLike = (0.0, 0.0)) -> Robot:
        """Make a disc of ``radius`` around ``center`` in the robot's frame (metres)."""
        return cls(*primitives.disc(radius, center))

    @classmethod
    @names_options
    def ball(cls, radius: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """Make a ball of ``radius`` around ``center`` in the robot's frame (metres)."""
        return cls(*primitives.ball(radius, center))

    @classmethod
    @names_options
    def from_balls(cls, centers: ArrayLike | BallSet, radii: ArrayLike | None = None) -> Robot:
        """Make a union of discs or balls.

        Discs lie in the plane, balls in space.

        Parameters
        ----------
        centers : array-like, shape (n, 2) or (n, 3), or BallDecomposition
            Metres, in the robot's frame. A decomposition has its own radii.
        radii : array-like, shape (n,), or one number
            Metres, above zero.

        Raises
        ------
        InputError
            If there is no ball, shapes of arrays disagree, a value is not finite, or a radius is
            not above zero.
        """
        balls = Balls.of(centers, radii)
        smallest = float(balls.radii.min())
        if smallest <= 0.0:
            problem = f"contains {smallest:g}"
            raise InputError("radii", problem, "each must be above zero")
        count = len(balls.radii)
        name = f"{balls.noun} {smallest:g} m" if count == 1 else f"{count} {balls.noun}s"
        return cls(name, balls)

    @classmethod
    @names_options
    def box(cls, extents: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """Make a box along the axes.

        Parameters
        ----------
        extents : array-like, shape (3,)
            Lengths along x, y and z, metres, above zero.
        center : array-like, shape (3,)
            Center of the box in the robot's frame, metres.
        """
        return cls(*primitives.box(extents, center))

    @classmethod
    @names_options
    def cylinder(cls, radius: float, height: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """Make an upright cylinder around ``center`` (metres).

        FREE is proven for a prism of 64 sides around the cylinder, whose radius is 0.12 % larger,
        and BLOCKED for a prism inside it, so that both hold for the cylinder.
        """
        return cls(*primitives.cylinder(radius, height, center))

    @classmethod
    @names_options
    def capsule(cls, radius: float, length: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """Make an upright capsule around ``center``.

        It is ``length + 2 * radius`` high (metres). It contains all points within ``radius`` of a
        vertical segment; with a length of zero it is a ball. Two polyhedra bound it, as a
        :meth:`cylinder`; the outer one reaches 0.24 % of the radius farther.
        """
        return cls(*primitives.capsule(radius, length, center))

    @classmethod
    @names_options
    def from_mesh(
        cls,
        shape: MeshLike,
        *,
        solid: Solid = "auto",
        up: Up | None = None,
        name: str | None = None,
    ) -> Robot:
        """Make a robot of a triangle mesh.

        Parameters
        ----------
        shape : trimesh.Trimesh, trimesh.Scene, path-like, or (vertices, faces)
            Metres, in the robot's frame; files are ``.stl``, ``.obj``, ``.ply``, ``.glb``,
            ``.gltf`` and ``.dae``. A warning is given if the mesh is farther from its origin than
            its own size.
        solid : {"auto", "surface", "fill"}
            Parts with an interior; see :func:`cspace.make_mesh`. "auto" keeps the
            setting of a mesh from there.
        up : {"x", "y", "z"}, optional
            Axis that points up and becomes z; see :func:`cspace.make_mesh`.

        Raises
        ------
        GeometryError
            If there is no triangle, or the mesh is farther from its origin than a hundred times its
            size, so that the origin can hardly be the reference point.
        InputError
            If a coordinate is NaN or infinite, or ``solid`` is unknown.
        FileError
            If the file cannot be read.
        """
        from cspace._shapes.mesh import make_mesh

        mesh = make_mesh(shape, solid, up)
        mesh.check_origin(warn=True)
        return cls(choose_text(name, "name", f"mesh of {len(mesh.faces)} triangles"), mesh)

    @classmethod
    @names_options
    def from_bitmap(
        cls, occupied: ArrayLike, spacing: float, lower: ArrayLike | None = None
    ) -> Robot:
        """Make a robot of a bitmap.

        The robot is the union of the closed cells that are set. Cell i is ``lower + spacing * (i +
        [0, 1]^d)``.

        Parameters
        ----------
        occupied : array-like of bool, shape (nx, ny) or (nx, ny, nz)
            Indexed ``[x, y]`` or ``[x, y, z]``.
        spacing : float
            Side of a cell of the bitmap, metres; it may differ from the map's.
        lower : array-like, shape (d,), optional
            Lower corner of the first cell in the robot's frame, metres; the origin if left out.

        Raises
        ------
        GeometryError
            If no cell is occupied.
        InputError
            If ``occupied`` is not boolean with two or three axes (0 and 1 are accepted), or another
            value is invalid.
        """
        voxels = Voxels.of(occupied, spacing, lower)
        grid = PlannedGrid(voxels.occupied.shape, voxels.side)
        check_memory(BITMAP_CELL_BYTES * float(voxels.occupied.sum()), "the bitmap", grid)
        cells = " x ".join(map(str, voxels.occupied.shape))
        return cls(f"bitmap {cells} cells of {voxels.side:g} m", voxels)

    @classmethod
    @names_options
    def from_footprint(
        cls, footprint: str | ArrayLike, *, padding: float = 0.0, name: str | None = None
    ) -> Robot:
        """Make a polygon of a Nav2 ``footprint``.

        Parameters
        ----------
        footprint : str or array-like, shape (n, 2)
            Corners in order, metres; as text e.g. ``"[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3,
            0.2]]"``.
        padding : float
            Metres by which the polygon grows along both axes: its Minkowski sum with a square of
            sides ``2 * padding``. It contains the polygon that ``footprint_padding`` makes in Nav2,
            where each coordinate of a corner moves away from zero; a warning says by how much the
            two differ, if they do.

        Raises
        ------
        GeometryError
            If the footprint is no list of points, or the points make no polygon.
        InputError
            If the padding is negative.
        """
        made = primitives.footprint(footprint, padding)
        return cls(choose_text(name, "name", made.name), made.shape)

    @classmethod
    @names_options
    def from_urdf(
        cls,
        path: str | os.PathLike[str],
        link: str | Sequence[str] | None = None,
        *,
        solid: Solid = "auto",
        package_dirs: StrPath | Sequence[StrPath] = (),
        visuals: bool = False,
        spheres: str | os.PathLike[str] | None = None,
    ) -> Robot:
        """Read the collision geometry of a URDF.

        Some links are read, or all links fixed to the root. Boxes and meshes are exact; cylinders
        and spheres are bounded by two polyhedra, as in :meth:`cylinder`.

        A mesh named ``package://PACKAGE/REST`` is the file ``PACKAGE/REST`` in the first of these
        folders that has it:

        1. each of ``package_dirs``;
        2. the folder of the URDF, then those above it, the nearest first;
        3. each of the environment variable ``ROS_PACKAGE_PATH``;
        4. the package of that name, by its ``package.xml``, at any depth below 1 and 3;
        5. ``share`` in each of ``AMENT_PREFIX_PATH``.

        A mesh named ``REST`` or ``file://REST`` is that file, relative to the folder of the URDF.
        If no such file exists, but exactly one ``REST`` in 1 and 2 does, that file is read and a
        warning names it.

        Parameters
        ----------
        path : path-like
            The URDF, or its text.
        link : str or sequence of str, optional
            Links to read, with all joints at zero; the reference point is the origin of the first
            one. If left out, the root and all links fixed to it, in the frame of the root; a
            warning names links with geometry that are left out because they move, such as wheels.
        solid : {"auto", "surface", "fill"}
            Parts with an interior, as for :meth:`from_mesh`. "surface" is only for links whose
            geometry is meshes, because boxes, cylinders and spheres are solid.
        package_dirs : path-like or sequence of path-like, optional
            Folders that hold the folders of ROS packages.
        visuals : bool
            Use the visual geometry of links without collision geometry. By default such a link is
            left out, as by MoveIt, and a warning names it.
        spheres : path-like, optional
            A file with spheres of links, which replace their collision geometry: ``.yaml`` or
            ``.yml`` of cuRobo, ``.json`` of foam, or an SRDF with ``link_sphere_approximation``.
            Links that it does not name keep their geometry.

        Raises
        ------
        FileError
            If a file or a mesh is missing or malformed, or the name of a mesh is ambiguous.
        InputError
            If a folder or link does not exist, the links have no collision geometry, a size is not
            above zero, or ``solid`` is "surface" and a link has a box, a cylinder or a sphere.
        """
        from cspace._files.formats import read_rigid_links

        return cls(*read_rigid_links(path, link, solid, package_dirs, visuals, spheres))

    def footprint(self) -> Robot:
        """Project the robot onto the ground, for maps in the plane.

        FREE is proven for the projection grown by a micrometre and BLOCKED for the projection
        shrunk by a micrometre, which covers rounding. A robot in the plane is returned unchanged.

        Raises
        ------
        GeometryError
            If the projection has no area.
        """
        if self.dim == 2:
            return self
        return Robot(f"footprint of {self.name}", self.shape.project_to_plane())

    @classmethod
    def from_spec(cls, spec: Mapping[str, object]) -> Robot:
        """Make a robot from its :attr:`spec`.

        Raises
        ------
        InputError
            If ``spec`` describes no robot.
        """
        try:
            robot = cls(str(spec["name"]), shape_from_spec(spec))
        except (LookupError, TypeError, ValueError) as error:
            problem = f"is {str(spec)[:80]}"
            rule = f"it must be a value of Robot.spec: {error}"
            raise InputError("spec", problem, rule) from error
        robot.shape.check_origin()
        return robot

    @classmethod
    def parse(cls, text: str) -> Robot:
        """Parse a shorthand; :meth:`open` reads files.

        Parameters
        ----------
        text : str
            A name, a colon and sizes in metres, such as ``disc:0.3``; the page on robots lists all
            names. The center follows if it is not the origin, as in ``rect:4.5x1.9@1.3,0``.
            ``footprint:`` and the text of a robot in space are its projection.

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
        if not isinstance(text, str) or not primitives.is_shorthand(text):
            rule = f"it must be {primitives.SHORTHAND_FORMS}; Robot.open reads files"
            raise InputError("robot", f"is {text!r}", rule)
        return cls(*primitives.parse_shorthand(text, "robot"))

    @classmethod
    @names_options
    def open(
        cls,
        path: str | os.PathLike[str],
        *,
        solid: Solid | None = None,
        up: Up | None = None,
        package_dirs: StrPath | Sequence[StrPath] | None = None,
        visuals: bool | None = None,
    ) -> Robot:
        """Read a robot from a file; :meth:`parse` takes shorthands.

        Parameters
        ----------
        path : path-like
            Polygons, a mesh, a URDF, or the YAML of Nav2's parameters, or of a costmap of ROS 1.
            ``FILE.urdf#LINK,LINK`` selects links, and ``FILE.yaml#COSTMAP`` one of costmaps that
            have different robots. A ``footprint`` is read as by :meth:`from_footprint`; otherwise
            ``robot_radius`` is that of a disc. Both are padded by ``footprint_padding``, 0.01 m by
            default, as in Nav2. The page on files (docs/reference/files.md) has a table of all
            suffixes.
        solid : {"auto", "surface", "fill"}, optional
            Parts of a mesh, or of the meshes of a URDF, with an interior; "auto" if left out.
        up : {"x", "y", "z"}, optional
            For a mesh: axis that points up, as for :meth:`from_mesh`.
        package_dirs : path-like or sequence of path-like, optional
            For a URDF: folders that hold the folders of ROS packages, as for :meth:`from_urdf`.
        visuals : bool, optional
            For a URDF: use visual geometry of links without collision geometry.

        Raises
        ------
        InputError
            If the suffix is none of these, the path is a shorthand, or an option is given for a
            file that does not take it.
        FileError
            If the file cannot be read.
        """
        from cspace._files.formats import ROBOT_FORMATS

        file, part_name = _split_part(path, ROBOT_FORMATS)
        shorthands = primitives.SHORTHAND_FORMS
        rule = f"it must be a file that describes a robot; Robot.parse takes {shorthands}"
        reader = ROBOT_FORMATS[check_suffix(file, ROBOT_FORMATS, rule, "robot")]
        # Options that the format does not take are refused.
        given = {"solid": solid, "up": up, "package_dirs": package_dirs, "visuals": visuals}
        options = {option: value for option, value in given.items() if value is not None}
        for option, value in options.items():
            if option not in reader.options:
                suffixes = [
                    suffix for suffix, form in ROBOT_FORMATS.items() if option in form.options
                ]
                problem = f"is {value!r} for {path}"
                rule = f"it applies to {', '.join(suffixes)}"
                raise InputError(option, problem, rule)
        return _read_robot(reader.method, Path(file), part_name, options)

    @property
    def geometry(self) -> BaseGeometry:
        """Outline of a robot in the plane.

        It is a shapely geometry, in metres, for drawing only. Discs become polygons of 128 corners.
        A shape with an outer and an inner bound, such as an ellipse, is drawn as the outer one.
        """
        return self.shape.outer.outline

    @property
    def surface(self) -> Surface:
        """Surface of a robot in space.

        It has vertices (V, 3) and triangles (F, 3), in metres, for drawing only. Balls get flat
        faces. A shape with an outer and an inner bound, such as a cylinder, is drawn as the outer
        one.
        """
        return self.shape.outer.surface


def _split_part(path: StrPath, suffixes: Collection[str]) -> tuple[StrPath, str]:
    """Split ``FILE.urdf#LINK`` into file and part."""
    file, mark, name = str(path).rpartition("#")
    # A file may have the mark in its own name.
    if not mark or Path(path).suffix.lower() in suffixes:
        return path, ""
    return file, name


def robot_of(source: Robot | ShapeLike) -> Robot:
    """Convert a shape to a robot.

    ``source`` is a shape or anything that describes one. The reference point is the origin.

    Raises CspaceError as :func:`cspace._shapes.as_shape` and the constructor for that shape.
    """
    if isinstance(source, Robot):
        return source
    if isinstance(source, str) and primitives.is_shorthand(source):
        return Robot(*primitives.parse_shorthand(source, "robot"))
    shape = as_shape(source, name="robot")
    if shape.kind == "mesh":
        return Robot.from_mesh(cast("Mesh", shape))
    if isinstance(shape, Polygons):
        return Robot.polygon(shape.geometries)
    if isinstance(shape, Balls):
        return Robot.from_balls(shape.centers, shape.radii)
    return Robot(type(shape).__name__.lower(), shape)


def _read_robot(method: str, path: Path, part: str, options: dict[str, Any]) -> Robot:
    """Read a robot file by a method of :class:`Robot`.

    ``part`` names a robot in a file that holds several, or is empty.
    """
    if method == "polygon":
        from cspace._files.vector import read_shapes

        return Robot.polygon(read_shapes(path), name=f"polygon {path.name}")
    if method == "from_mesh":
        return Robot.from_mesh(path, name=f"mesh {path.name}", **options)
    if method == "nav2":
        from cspace._files.ros_maps import read_nav2

        base = read_nav2(path, part or None)
        if base.corners:
            name = f"footprint of {path.name}"
            return Robot.from_footprint(base.corners, padding=base.padding, name=name)
        return Robot.disc(base.radius + base.padding)
    return Robot.from_urdf(path, part.split(",") if part else None, **options)
