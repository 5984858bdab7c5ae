"""Triangle meshes in space, and the solids that they enclose."""

from __future__ import annotations

import base64
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._grid import Grid
from cspace._raster import Raster
from cspace._rotations import NO_ROTATION, RotationCell
from cspace._shapes.bodies import MeshBody, find_bodies
from cspace._shapes.polygon import Polygons
from cspace._shapes.shape import (
    BoundedShape,
    ExactShape,
    RoundedSimplices,
    Shape,
    Slab,
    clip_to_half_space,
    unique_rows,
)
from cspace._support.arrays import AXES, Bools, Floats, Ints, Surface, frozen
from cspace._support.check import (
    MAX_NUMBER,
    check_finite,
    check_points,
    check_unmasked,
    check_word,
)
from cspace._support.reporting import warn_user
from cspace.errors import GeometryError, InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace._files.meshes import Up
    from cspace._raster.surfaces import SolidSurface, WindingNumber


class TriangleMesh(Protocol):
    """A trimesh.Trimesh, or an object like it."""

    @property
    def vertices(self) -> ArrayLike:
        """Vertices, shape (V, 3), metres."""
        ...

    @property
    def faces(self) -> ArrayLike:
        """Vertex indices of the triangles, shape (F, 3)."""
        ...


class MeshScene(Protocol):
    """A trimesh.Scene, or an object like it."""

    @property
    def geometry(self) -> Mapping[str, object]:
        """Geometries by name."""
        ...


Solid = Literal["auto", "surface", "fill"]
MeshLike: TypeAlias = (
    "Mesh | TriangleMesh | MeshScene | str | os.PathLike[str] | tuple[ArrayLike, ArrayLike]"
)

SOLIDS: Final = ("auto", "surface", "fill")
"""Solid parts of a mesh: its closed bodies, only the surface, or all that its raster encloses."""

_CRACK_WIDTH: Final = 2.0**-40
"""Largest width of a hole in a mesh's shadow that counts as rounding, relative to its span."""


class MeshWarning(UserWarning):
    """Bodies of a mesh are open, or filling it added nothing."""


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(ExactShape):
    """Triangles in space, in metres.

    See :func:`make_mesh`.

    Parameters
    ----------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
        Vertex indices of each triangle.
    solid : {"auto", "surface", "fill"}
    source : str
        Origin of the mesh, for messages.

    Raises
    ------
    InputError
        If a coordinate is not finite, or ``solid`` is another word.
    GeometryError
        If there is no triangle, or one names a missing vertex.
    """

    vertices: Floats
    faces: Ints
    solid: Solid = "auto"
    source: str = "mesh"
    _warned: bool = field(default=False, init=False, repr=False)
    kind = "mesh"
    dim = 3

    def __post_init__(self) -> None:
        """Check the arrays, and copy them."""
        check_word(self.solid, "solid", SOLIDS)
        check_unmasked(self.faces, f"faces of {self.source}")
        vertices = _check_vertices(self.vertices, self.source)
        faces = _check_faces(self.faces, len(vertices), self.source)
        object.__setattr__(self, "vertices", frozen(vertices))
        object.__setattr__(self, "faces", frozen(faces))

    @classmethod
    def convert(cls, shape: MeshLike, solid: Solid = "auto", up: Up | None = None) -> Mesh:
        """Make a mesh as :func:`make_mesh` does, without a warning of open bodies."""
        if isinstance(shape, Mesh):
            solid = shape.solid if solid == "auto" else solid
            if solid == shape.solid and up is None:
                return shape
        vertices, faces, source = _read_arrays(shape, up)
        return cls(vertices, faces, solid, source)

    def warn_if_open(self, option: str = "solid={!r}", fills: bool = True) -> None:
        """Warn, once per mesh with ``solid="auto"``, of bodies without an interior.

        `option` is the spelling of ``solid`` in the function that the user called; `fills` is True
        if that function accepts ``"fill"``.
        """
        if self.solid == "auto" and not self._warned:
            object.__setattr__(self, "_warned", True)
            for message in self._open_body_messages(option, fills):
                warn_user(message, MeshWarning)

    @property
    def triangles(self) -> Floats:
        """Corners of triangles, metres, shape (F, 3, 3)."""
        return np.asarray(self.vertices[self.faces])

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the bounding box, shape (3,) each."""
        is_used = np.zeros(len(self.vertices), dtype=np.bool_)
        is_used[self.faces] = True
        used_vertices = self.vertices[is_used]
        return used_vertices.min(axis=0), used_vertices.max(axis=0)

    @cached_property
    def bodies(self) -> tuple[MeshBody, ...]:
        """Bodies: sets of triangles connected through shared edges."""
        return find_bodies(self.vertices, self.faces)

    @property
    def is_watertight(self) -> bool:
        """True if there are bodies and all are closed."""
        return bool(self.bodies) and all(body.closed for body in self.bodies)

    @property
    def span(self) -> float:
        """Largest modulus of a coordinate, metres."""
        return float(np.abs(self.bounds).max())

    @property
    def measure(self) -> float:
        """Volume, cubic metres; NaN for an open mesh."""
        return float(self.volume) if self.is_watertight else float("nan")

    @property
    def facts(self) -> dict[str, object]:
        """Plain values about the mesh, by name, for reports."""
        closed = sum(body.closed for body in self.bodies)
        facts: dict[str, object] = {
            "triangles": len(self.faces),
            "bodies": {"closed": closed, "open": len(self.bodies) - closed},
            "watertight": self.is_watertight,
        }
        if self.is_watertight:
            facts["volume_m3"] = float(self.volume)
        return facts

    @property
    def encloses(self) -> bool:
        """True if closed bodies are solid, at any spacing."""
        return self.solid == "auto" and bool(self.windings.any())

    @cached_property
    def volume(self) -> float:
        """Sum of the closed bodies' volumes, cubic metres.

        Cavities count negative; overlaps count once per body.
        """
        return sum(body.volume for body in self.bodies)

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Compute the outer and inner raster; see ``Shape.rasters``."""
        from cspace._raster.surfaces import surface_rasters

        return surface_rasters(self._solid, spacing, margin, rotation)

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        """Compute the outer and inner cells; see ``Shape.cells``."""
        from cspace._raster.surfaces import surface_cells

        return surface_cells(self._solid, grid)

    def boundary(self) -> RoundedSimplices:
        """Return the triangles.

        Raises InputError if ``solid`` is "fill", because the filled part depends on the spacing.
        """
        self._refuse_fill()
        return RoundedSimplices(self.triangles, np.zeros(len(self.faces)))

    def _refuse_fill(self) -> None:
        """Raise InputError if the inside depends on the spacing."""
        if self.solid == "fill":
            rule = "the filled part depends on the spacing, and exact answers must not"
            raise InputError(self.source, "has solid='fill'", rule)

    @property
    def surface(self) -> Surface:
        """Vertices and triangles."""
        return self.vertices, self.faces

    def project_to_plane(self) -> Shape:
        """Project the mesh onto the xy plane.

        The result is the union of its triangles' shadows, grown and shrunk by a micrometre, or
        more if it reaches far. This covers the rounding of the union.
        """
        outer, shadow = _cast_shadow(self.boundary().simplices[..., :2], self.span)
        inner = shadow.buffer(-_find_margin(self.span), join_style="mitre")
        if inner.is_empty:
            rule = "it must have an area there"
            raise GeometryError(self.source, "is flat, seen from above", rule)
        return BoundedShape(Polygons.of(outer), Polygons.of(inner))

    def slab(self, low: float, high: float, slack: float) -> Slab:
        """Return the part between two heights, seen from above; see ``Shape.slab``.

        The shadow of the triangles there, with the holes that lie in a body, grown and shrunk by a
        margin: where no triangle crosses a vertical line between the heights, one of its points
        decides for all of them.
        """
        import shapely

        outer, _ = self._cast_shadow_between(low - slack, high + slack)
        grown, shadow = self._cast_shadow_between(low + slack, high - slack)
        margin = _find_margin(self.span)
        # Holes stay a margin away from all triangles, so they may grow by less.
        holes = shapely.buffer(self._find_filled_holes(grown, low, high), 0.9 * margin)
        with np.errstate(all="ignore"):  # GEOS tries mitres of sides without length
            inner = shapely.union_all([shadow, *holes]).buffer(-margin, join_style="mitre")
        outer = shapely.union_all([outer, *self._find_filled_holes(outer, low, high)])
        return (
            None if outer.is_empty else Polygons.of(outer),
            None if inner.is_empty else Polygons.of(inner),
        )

    def _cast_shadow_between(self, low: float, high: float) -> tuple[BaseGeometry, BaseGeometry]:
        """Return the grown shadow and the shadow of the triangles between two heights."""
        triangles = self.boundary().simplices
        heights = triangles[..., 2]
        triangles = triangles[(heights.max(axis=1) >= low) & (heights.min(axis=1) <= high)]
        for height, sign in ((low, 1.0), (high, -1.0)):
            triangles = clip_to_half_space(triangles, 2, height, sign, 0.0)
        return _cast_shadow(triangles[..., :2], self.span)

    def _find_filled_holes(
        self, shadow: BaseGeometry, low: float, high: float
    ) -> list[BaseGeometry]:
        """Return the holes of a grown shadow between two heights that lie in a body."""
        import shapely

        parts = shapely.get_parts(shadow)
        holes = [shapely.Polygon(ring) for part in parts for ring in part.interiors]
        if not holes:
            return []
        points = shapely.get_coordinates(shapely.point_on_surface(holes))
        heights = np.full(len(points), 0.5 * (low + high))
        is_filled = self.contains(np.column_stack([points, heights]))
        return [hole for hole, fills in zip(holes, is_filled.tolist(), strict=True) if fills]

    def check_origin(self, warn: bool = False) -> None:
        """Raise GeometryError far from the origin; see ``Shape.check_origin``."""
        lower, upper = self.bounds
        size = float(np.linalg.norm(upper - lower))
        gaps = np.maximum(np.maximum(lower, -upper), 0.0)  # from the origin, along each axis
        distance = float(np.linalg.norm(gaps))
        shift = ", ".join(f"{-x:g}" for x in (lower + upper) / 2)
        hint = f"move its center there first, by ({shift}) m"
        where = f"is {size:g} m across and lies {distance:g} m from its origin, which is"
        # Maximum distance of a robot's mesh from its reference point, relative to the size of the
        # mesh.
        max_origin_offset = 100.0
        if distance > max_origin_offset * size:
            rule = f"at most {max_origin_offset:g} times its size is accepted"
            raise GeometryError("mesh", f"{where} the robot's reference point", rule, hint)
        if warn and distance > size:
            warn_user(f"the robot's mesh {where} its reference point; units are metres; {hint}")

    def transform_features(self, matrix: Floats) -> Floats:
        """Return the transformed triangles, each rotated to begin at its smallest corner."""
        # Adding zero drops the sign of -0, so that equal corners are equal bit for bit.
        corners = (self.vertices @ matrix.T + 0.0)[self.faces]
        is_mirror = np.linalg.det(matrix) < 0.0
        if is_mirror:
            corners = corners[:, ::-1]  # keeps the normals outward
        _, ranks = unique_rows(corners.reshape(-1, 3))
        smallest = ranks.reshape(-1, 3).argmin(axis=1)
        order = (smallest[:, None] + np.arange(3)) % 3  # from the smallest corner around
        return np.take_along_axis(corners, order[..., None], axis=1).reshape(-1, 9)

    def contains(self, points: ArrayLike) -> Bools:
        """Return a mask of points in closed bodies.

        The answer holds for points farther from the surface than rounding. With ``solid="surface"``
        it is all False.

        Parameters
        ----------
        points : array-like, shape (..., 3)
            Metres.

        Returns
        -------
        ndarray of bool, shape (...)

        Raises
        ------
        InputError
            If the last axis is not three long, a value is not finite, or ``solid`` is ``"fill"``.
        """
        self._refuse_fill()
        array = check_points(points, "points", AXES[: self.dim])
        if not self.encloses:
            return np.zeros(array.shape[:-1], dtype=np.bool_)
        lower, upper = self.bounds
        # Only points in the bounding box need their winding number.
        inside = np.asarray(((lower <= array) & (array <= upper)).all(axis=-1))
        if inside.any():
            inside[inside] = self._winding.evaluate(array[inside] - lower) != 0
        return inside

    @property
    def spec(self) -> dict[str, object]:
        """Plain values that JSON can hold, without loss, for :meth:`from_spec`."""
        return {
            "kind": self.kind,
            "vertices": _encode(self.vertices, "<f8"),
            "faces": _encode(self.faces, "<i8"),
            "solid": self.solid,
            "source": self.source,
        }

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Mesh:
        """Make the mesh of a :attr:`spec`."""
        vertices = _decode(spec["vertices"], "<f8")
        faces = _decode(spec["faces"], "<i8")
        mesh = cls(vertices, faces, spec["solid"], str(spec["source"]))
        # The user was warned when the spec was made.
        object.__setattr__(mesh, "_warned", True)
        return mesh

    @cached_property
    def windings(self) -> Ints:
        """Multiplicity of triangles in the enclosing surface, (F,)."""
        windings = np.zeros(len(self.faces), dtype=np.int64)
        for body in self.bodies:
            if body.closed:
                windings[body.faces] = body.multiplicities
        return windings

    @cached_property
    def _winding(self) -> WindingNumber:
        """Winding number of the closed bodies.

        Points are relative to the lower corner of the bounds.
        """
        from cspace._raster.surfaces import WindingNumber

        counted = self.windings != 0
        return WindingNumber(self.triangles[counted] - self.bounds[0], self.windings[counted])

    @property
    def _solid(self) -> SolidSurface:
        """The triangles with their interior, to be rasterised."""
        from cspace._raster.surfaces import SolidSurface

        triangles = self.triangles
        windings = np.zeros(len(self.faces), dtype=np.int64)
        if self.solid == "auto":
            windings = self.windings
        on_empty = self._warn_of_empty_fill if self.solid == "fill" else None
        return SolidSurface(triangles, triangles, windings, on_empty, self.source)

    def _warn_of_empty_fill(self, spacing: float) -> None:
        """Warn once if filling an open mesh added nothing to its surface."""
        if self._warned or self.is_watertight:
            return
        object.__setattr__(self, "_warned", True)
        problem = f"{self.source} is open and encloses no cell of {spacing:g} m"
        result = "so filling added none; it counts as a surface without an inside"
        warn_user(f"{problem}, {result}", MeshWarning)

    def _open_body_messages(self, option: str, fills: bool) -> Iterator[str]:
        """Yield a warning for each kind of body without an interior."""
        surface = option.format("surface")
        or_fill = f", or {option.format('fill')} to fill what the cells enclose" if fills else ""
        open_bodies = [body for body in self.bodies if not body.closed]
        open_triangles = sum(len(body.faces) for body in open_bodies)
        hollow = sum(body.closed and body.volume == 0.0 for body in self.bodies)
        if not self.bodies:
            yield (
                f"no triangle of {self.source} has an area; it counts as a surface without an "
                "inside"
            )
        if open_bodies:
            yield (
                f"{len(open_bodies)} of {len(self.bodies)} bodies of {self.source} are open "
                f"({open_triangles} of {len(self.faces)} triangles); they count as surfaces "
                f"without an inside; pass {surface} to confirm this{or_fill}"
            )
        if hollow:
            yield (
                f"the windings of {hollow} of {len(self.bodies)} bodies of {self.source} cancel, "
                "for example because a surface is drawn once for each side; such a body is hollow"
            )


def make_mesh(shape: MeshLike, solid: Solid = "auto", up: Up | None = None) -> Mesh:
    """Make a mesh with a choice of its solid part, to pass wherever a shape is taken.

    The triangles are always part of the shape. The part that they enclose depends on ``solid``:

    * ``"auto"``: every point where the winding number of all closed bodies together is non-zero.

      A body is a set of triangles that are connected through shared edges. It is closed if its
      triangles run along each edge equally often in both directions. Exact copies of triangles are
      dropped first, or cancel if they are a wall between two parts; single reversed triangles are
      turned back. Any other body (with holes, Moebius strips, more than two triangles at an edge
      and no consistent winding) is a surface without an interior, and a :class:`MeshWarning` says
      so.

      Winding numbers add up. Bodies that overlap and face outward are solid together, also if one
      is nested in another. A body that faces inward, nested in one that faces outward, is a cavity,
      which may contain an island, and so on. A body that faces inward and has a corner outside all
      bodies that face outward cannot be a cavity; it is reversed, and solid. Points where windings
      cancel, as in some pockets of a body that passes through itself, are hollow.
    * ``"surface"``: nothing.
    * ``"fill"``: all cells that cannot be reached from outside through cells that the surface does
      not touch. The result depends on the spacing: gaps narrower than about a cell are closed. If a
      mesh with open bodies encloses no cell at all, it is a surface without an interior, and a
      :class:`MeshWarning` says so when its cells are made.

    Parameters
    ----------
    shape : trimesh.Trimesh, trimesh.Scene, path-like, pair of array-like, or result of this call
        A file is read; a pair is vertices (V, 3), in metres, and faces (F, 3).
    solid : {"auto", "surface", "fill"}
        With ``"auto"``, the result of an earlier call keeps its own.
    up : {"x", "y", "z"}, optional
        Axis that points up; it becomes z. By default axes stay as they are, as in ROS, and a
        warning names a file that calls another axis up, as ``.glb`` and ``.gltf`` do.

    Raises
    ------
    InputError
        If ``shape`` is something else, a coordinate is not finite, or ``solid`` or ``up`` is
        another word.
    GeometryError
        If there is no triangle, or one names a missing vertex.
    FileError
        If a file is missing or cannot be read as a mesh.

    Warns
    -----
    MeshWarning
        If ``solid`` is ``"auto"`` and a body is open; once per mesh.

    Examples
    --------
    >>> import cspace, trimesh
    >>> crate = cspace.make_mesh(trimesh.creation.box((0.6, 0.4, 0.3)))
    >>> cspace.Robot.from_mesh(crate).shape.volume
    0.072
    """
    mesh = Mesh.convert(shape, solid, up)
    mesh.warn_if_open()
    return mesh


def _find_margin(span: float) -> float:
    """Return by how much bounds of shadows are grown and shrunk, metres.

    It is far more than the rounding of coordinates up to ``span``.
    """
    return max(1e-6, 16.0 * _CRACK_WIDTH * span)


def _cast_shadow(corners: Floats, span: float) -> tuple[BaseGeometry, BaseGeometry]:
    """Return the shadow of triangles, grown by a margin, and as it is up to rounding.

    ``corners`` are those of triangles seen from above, shape (n, 3, 2), metres; ``span`` is their
    largest coordinate.
    """
    import shapely

    margin = _find_margin(span)
    sides = np.roll(corners, -1, axis=1) - corners
    longest_side = np.linalg.norm(sides, axis=-1).max(axis=1)
    first_x, first_y = sides[:, 0].T
    second_x, second_y = sides[:, 1].T
    twice_area = np.abs(first_x * second_y - first_y * second_x)
    # Unions and buffers lose triangles seen edge-on, so their sides stand for them. They are at
    # most a quarter of the margin wide.
    is_line = 4.0 * twice_area <= margin * longest_side
    union = shapely.union_all(shapely.polygons(corners[~is_line]))
    shadow = _fill_cracks(union, _CRACK_WIDTH * span)
    lines = shapely.linestrings(corners[is_line][:, [0, 1, 2, 0]])
    # Lines well inside the shadow add nothing.
    with np.errstate(all="ignore"):  # GEOS tries mitres of sides without length
        near_shadow = shadow.buffer(margin / 2.0, join_style="mitre")
        grown_shadow = shadow.buffer(margin, join_style="mitre")
    shapely.prepare(near_shadow)
    lines_beside = lines[~shapely.covers(near_shadow, lines)]
    grown_lines = shapely.buffer(lines_beside, margin)
    return shapely.union_all([grown_shadow, *grown_lines]), shadow


def _fill_cracks(shadow: BaseGeometry, width: float) -> BaseGeometry:
    """Fill holes that are at most `width` wide, metres.

    Filling a real hole changes no proof, because no cell of an obstacle fits into it.
    """
    import shapely

    filled = []
    for polygon in shapely.get_parts(shadow):
        holes = [
            hole
            for hole in polygon.interiors
            if not shapely.Polygon(hole).buffer(-width / 2.0).is_empty
        ]
        filled.append(shapely.Polygon(polygon.exterior, holes))
    return shapely.MultiPolygon(filled)


def _read_arrays(shape: Any, up: Up | None) -> tuple[Any, Any, str]:
    """Return the vertices, faces and name of a mesh.

    Its axis ``up`` becomes z.
    """
    from cspace._files.meshes import flatten_trimesh, read_mesh, turn_upright
    from cspace._files.unit_notes import warn_of_axis

    if isinstance(shape, (str, os.PathLike)):
        surface = read_mesh(shape, up)
        if up is None:
            warn_of_axis(shape)
        return *surface, Path(shape).name
    source = "mesh"
    if isinstance(shape, Mesh):
        vertices, faces, source = shape.vertices, shape.faces, shape.source
    elif isinstance(shape, (tuple, list)) and len(shape) == 2:
        vertices, faces = shape
    else:
        vertices, faces = flatten_trimesh(shape)
    if up is not None:
        vertices = turn_upright(_check_vertices(vertices, source), up)
    return vertices, faces, source


def _check_vertices(values: Any, source: str) -> Floats:
    """Return vertices as an array, shape (V, 3), metres.

    Tiny coordinates become zero. Raises GeometryError if the array has another shape, or its
    largest coordinate is too small or too large.
    """
    vertices = check_finite(values, f"vertices of {source}")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        rule = "it must be (V, 3), in metres"
        raise GeometryError(f"vertices of {source}", f"has shape {vertices.shape}", rule)
    largest = float(np.abs(vertices).max(initial=0.0))
    # Smallest value of a mesh's largest coordinate, metres, unless all coordinates are zero.
    min_mesh_extent = 1e-100
    if largest > 0.0 and not min_mesh_extent <= largest <= MAX_NUMBER:
        problem = f"reach {largest:g}"
        rule = f"they must reach {min_mesh_extent:g} and at most {MAX_NUMBER:g}"
        raise GeometryError(f"vertices of {source}", problem, rule)
    # Smaller coordinates of a mesh are set to zero, because quotients of them overflow.
    is_tiny = np.abs(vertices) < 1e-200
    return np.array(np.where(is_tiny, 0.0, vertices), dtype=np.float64, order="C")


def _check_faces(values: Any, vertices: int, source: str) -> Ints:
    """Return faces as an array, shape (F, 3).

    Raises GeometryError unless they are triples of indices below ``vertices``, the vertex count.
    """
    faces = np.asarray(values)
    if faces.size == 0:
        raise GeometryError(source, "has no triangles", "a mesh needs one")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        problem = f"has shape {faces.shape} and dtype {faces.dtype}"
        rule = "it must be (F, 3), of whole numbers"
        raise GeometryError(f"faces of {source}", problem, rule)
    for vertex in (faces.min(), faces.max()):
        if not 0 <= vertex < vertices:
            problem = f"name vertex {vertex}"
            rule = f"there are {vertices}, counted from 0"
            raise GeometryError(f"faces of {source}", problem, rule)
    return np.array(faces, dtype=np.int64, order="C")


def _encode(array: NDArray[Any], dtype: str) -> str:
    """Encode an array as text, base64 of its bytes."""
    data = np.ascontiguousarray(array, dtype=dtype).tobytes()
    return base64.b64encode(data).decode()


def _decode(text: str, dtype: str) -> NDArray[Any]:
    """Decode an array, shape (n, 3), from the text of :func:`_encode`."""
    data = base64.b64decode(text, validate=True)
    return np.frombuffer(data, dtype=dtype).reshape(-1, 3)
