"""Mesh: triangles in space, and what they enclose."""

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

from cspace.arrays import Bools, Floats, Ints, Surface, frozen
from cspace.check import check_points, finite, unmasked
from cspace.errors import GeometryError, InputError, warn_user
from cspace.grid import Grid
from cspace.raster import Raster
from cspace.rotations import NO_ROTATION, RotationCell
from cspace.shapes.bodies import Body, find_bodies
from cspace.shapes.polygon import Polygons
from cspace.shapes.shape import BoundedShape, ExactShape, Pieces, Shape, ordered_rows

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.raster.surfaces import Buckets, SolidSurface, WindingNumber


MOST_OFF: Final = 100.0
"""How many times its own size a robot's mesh may lie off its reference point."""


class TriangleMesh(Protocol):
    """A trimesh.Trimesh, or what looks like one."""

    @property
    def vertices(self) -> ArrayLike: ...

    @property
    def faces(self) -> ArrayLike: ...


class MeshScene(Protocol):
    """A trimesh.Scene, or what looks like one."""

    @property
    def geometry(self) -> Mapping[str, object]: ...


SMALL: Final = 0.25
"""Share of a mesh, seen from above, up to which an index of its triangles pays for a grid."""

Solid = Literal["auto", "surface", "fill"]
MeshLike: TypeAlias = "Mesh | TriangleMesh | MeshScene | str | os.PathLike[str] | tuple[ArrayLike, ArrayLike]"

Chosen: TypeAlias = "Ints | slice"
"""Numbers of some triangles."""

SOLIDS: Final = ("auto", "surface", "fill")
"""What of a mesh is solid: its closed bodies, nothing but the surface, or whatever its raster encloses."""

_LARGEST: Final = 1e100
_SMALLEST: Final = 1e-100
"""The largest coordinate of a mesh lies between these, or is zero."""

_NOUGHT: Final = 1e-200
"""Coordinates below this are taken as zero, because quotients of smaller ones overflow."""

_HAIR: Final = 1e-6
"""By how much what holds a mesh's shadow is larger than that, metres."""


_CRACK: Final = 2.0**-40
"""Width of a hole in a mesh's shadow up to which rounding has opened it, as part of the span."""


class MeshWarning(UserWarning):
    """A mesh has open bodies, and nothing was said about what to do with them, or filling it added nothing."""


@dataclass(frozen=True, eq=False)
class Mesh(ExactShape):
    """Triangles in space, in metres.

    The triangles themselves are always part of the shape. What they enclose is, by ``solid``:

    * ``"auto"``: wherever the winding number of all closed bodies together is not zero.

      A body is a set of triangles that are connected through shared edges. It is closed if its triangles run along each
      edge as often one way as the other. Exact copies of triangles are dropped first, or cancel where they are a wall
      between two parts, and single triangles that are turned over are turned back. What does not close that way (holes,
      Moebius strips, more than two triangles at an edge and no consistent winding) is a surface without an inside, and
      a :class:`MeshWarning` says so.

      Winding numbers add up. Bodies that overlap and all face outward are solid together, also where one is nested in
      another. A body that faces inward, nested in one that faces outward, is a cavity, in which there may be an island,
      and so on. A body that faces inward alone is solid like any other: unless all corners of it lie in bodies that
      face outward, it can be no cavity, and is turned over. Where windings cancel, as in some pockets of a body that
      passes through itself, it is hollow.
    * ``"surface"``: nothing.
    * ``"fill"``: whatever cannot be reached from outside through the cells that the surface does not touch. It depends
      on the spacing: gaps narrower than about a cell are closed. Where a mesh with open bodies encloses no cell at
      all, it is a surface without an inside, and a :class:`MeshWarning` says so when its cells are made.

    Parameters
    ----------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
        Numbers of each triangle's vertices.
    solid : {"auto", "surface", "fill"}
    source : str
        Where the mesh is from, for messages.

    Raises
    ------
    InputError
        If a coordinate is not finite, or ``solid`` is none of the three.
    GeometryError
        If there is no triangle, or one names a vertex that there is not.
    """

    vertices: Floats
    faces: Ints
    solid: Solid = "auto"
    source: str = "mesh"
    _warned: bool = field(default=False, init=False, repr=False)
    dim = 3

    def __post_init__(self) -> None:
        if self.solid not in SOLIDS:
            hint = f"use one of {', '.join(map(repr, SOLIDS))}"
            raise InputError("solid", f"is {self.solid!r}", "it says what of a mesh is solid", hint, value=self.solid)
        unmasked(self.faces, f"faces of {self.source}")
        vertices, faces = _checked_vertices(self.vertices, self.source), np.asarray(self.faces)
        if faces.size == 0:
            hint = "for a cloud of points use Workspace.from_points"
            raise GeometryError(self.source, "has no triangles", "a mesh needs at least one", hint, value=self.faces)
        if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
            raise GeometryError(
                f"faces of {self.source}",
                f"has shape {faces.shape} and dtype {faces.dtype}",
                "it must be (F, 3), of whole numbers",
                "pass three vertex numbers for each triangle",
                value=self.faces,
            )
        low, high = int(faces.min()), int(faces.max())
        if low < 0 or high >= len(vertices):
            rule, hint = f"there are {len(vertices)}, numbered from 0", "pass the vertices that belong to the faces"
            raise GeometryError(
                f"faces of {self.source}", f"name vertex {low if low < 0 else high}", rule, hint, value=self.faces
            )
        faces = np.array(faces, dtype=np.int64, order="C")
        object.__setattr__(self, "vertices", frozen(vertices))
        object.__setattr__(self, "faces", frozen(faces))

    @classmethod
    def of(cls, shape: MeshLike, solid: Solid = "auto") -> Mesh:
        """A mesh from anything that describes one.

        Parameters
        ----------
        shape : Mesh, trimesh.Trimesh, trimesh.Scene, path-like, or pair of array-like
            A file is read; a pair is vertices (V, 3), in metres, and faces
            (F, 3).
        solid : {"auto", "surface", "fill"}
            Under ``"auto"``, a Mesh is taken as it is.

        Raises
        ------
        InputError
            If ``shape`` is something else, a coordinate is not finite, or ``solid`` is none of the three.
        GeometryError
            If there is no triangle.
        FileError
            If a file is missing or cannot be read as a mesh.

        Warns
        -----
        MeshWarning
            If the mesh is read with ``solid="auto"`` and a body is open; once for each Mesh.
        """
        mesh = cls.convert(shape, solid)
        mesh.warn_if_open()
        return mesh

    @classmethod
    def convert(cls, shape: MeshLike, solid: Solid = "auto") -> Mesh:
        """Make a mesh as :meth:`of` does, without a warning."""
        if isinstance(shape, Mesh):
            return shape if solid in ("auto", shape.solid) else cls(shape.vertices, shape.faces, solid, shape.source)
        vertices, faces, source = _arrays_of(shape)
        return cls(vertices, faces, solid, source)

    def warn_if_open(self, option: str = "solid={!r}", fills: bool = True) -> None:
        """Warn, once for a mesh with ``solid="auto"``, of bodies that have no inside.

        ``option`` is the form in which the function that the user called takes ``solid``; ``fills`` says whether it
        takes ``"fill"``.
        """
        if self.solid == "auto" and not self._warned:
            object.__setattr__(self, "_warned", True)
            for message in self._doubts(option, fills):
                warn_user(message, MeshWarning)

    @property
    def triangles(self) -> Floats:
        """Corners of the triangles, in metres, shape (F, 3, 3)."""
        return np.asarray(self.vertices[self.faces])

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        named = np.zeros(len(self.vertices), dtype=np.bool_)
        named[self.faces] = True
        used = self.vertices[named]
        return used.min(axis=0), used.max(axis=0)

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """The parts that are connected through shared edges."""
        return find_bodies(self.vertices, self.faces)

    @property
    def is_watertight(self) -> bool:
        """Whether there are bodies, and all are closed."""
        return bool(self.bodies) and all(body.closed for body in self.bodies)

    @property
    def span(self) -> float:
        return float(np.abs(self.bounds).max())

    @property
    def measure(self) -> float:
        return float(self.volume) if self.is_watertight else float("nan")

    @property
    def _facts(self) -> dict[str, object]:
        closed = sum(body.closed for body in self.bodies)
        return {
            "triangles": len(self.faces),
            "bodies": {"closed": closed, "open": len(self.bodies) - closed},
            "watertight": self.is_watertight,
            **({"volume_m3": float(self.volume)} if self.is_watertight else {}),
        }

    @property
    def encloses(self) -> bool:  # type: ignore[override]
        """Whether the mesh has an inside that does not depend on a spacing: closed bodies, which are solid."""
        return self.solid == "auto" and bool(self._turns.any())

    @cached_property
    def volume(self) -> float:
        """Sum of the volumes of the closed bodies, cubic metres.

        Cavities count negative; where bodies overlap, each counts.
        """
        return sum(body.volume for body in self.bodies)

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        from cspace.raster.surfaces import surface_rasters

        return surface_rasters(self._skin(), spacing, margin, rotation)

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        from cspace.raster.surfaces import surface_cells

        return surface_cells(self._skin(*self._near(grid)), self.bounds, grid)

    def _near(self, grid: Grid) -> tuple[Chosen, Chosen]:
        """The triangles that may meet a grid, and with those above and below it: all, or what an index finds."""
        lower, upper = np.asarray(grid.lower) - grid.spacing, np.asarray(grid.upper) + grid.spacing
        shared = np.maximum(np.minimum(upper, self.bounds[1]) - np.maximum(lower, self.bounds[0]), 0.0)
        whole = self.bounds[1] - self.bounds[0]
        if self.solid == "fill" or shared[0] * shared[1] > SMALL * whole[0] * whole[1]:
            return slice(None), slice(None)
        numbers = self._index.near(lower, upper)
        corners = self.vertices[self.faces[numbers]]
        meets = (corners.min(axis=1) <= upper).all(axis=1) & (corners.max(axis=1) >= lower).all(axis=1)
        return numbers[meets], numbers

    @cached_property
    def _index(self) -> Buckets:
        from cspace.raster.surfaces import Buckets

        return Buckets.of(self.triangles)

    def boundary(self) -> Pieces:
        if self.solid == "fill":
            raise InputError(
                self.source,
                "has solid='fill'",
                "what is filled depends on the spacing, and exact answers need a shape of its own",
                "close the mesh and pass solid='auto', or ask without exact=True",
                value=self.solid,
            )
        return Pieces(self.triangles, np.zeros(len(self.faces)))

    @property
    def surface(self) -> Surface:
        return self.vertices, self.faces

    def flattened(self) -> Shape:
        """Project the mesh: the union of the triangles' shadows, grown and shrunk by a micrometre.

        That covers the rounding of the union.
        """
        import shapely

        corners = self.boundary().simplices[..., :2]
        sides = np.roll(corners, -1, axis=1) - corners
        lengths = np.linalg.norm(sides, axis=-1)
        twice_area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        # Unions and buffers lose triangles that are seen edge-on: their longest sides stand for them.
        is_line = 4.0 * twice_area <= _HAIR * lengths.max(axis=1)
        shadow = _without_cracks(shapely.union_all(shapely.polygons(corners[~is_line])), _CRACK * self.span)
        within = shadow.buffer(-_HAIR, join_style="mitre")
        if within.is_empty:
            raise GeometryError(self.source, "is flat, seen from above", "it must have an area there", "check its axes")
        first = lengths[is_line].argmax(axis=1)[:, None]
        ends = np.take_along_axis(corners[is_line], np.hstack([first, (first + 1) % 3])[..., None], axis=1)
        lines = shapely.linestrings(ends)
        near = shadow.buffer(_HAIR / 2.0, join_style="mitre")
        shapely.prepare(near)
        apart = shapely.buffer(lines[~shapely.covers(near, lines)], _HAIR, cap_style="square")
        around = shapely.union_all([shadow.buffer(_HAIR, join_style="mitre"), *apart])
        return BoundedShape(Polygons.of(around), Polygons.of(within))

    def check_origin(self, warn: bool = False) -> None:
        lower, upper = self.bounds
        size = float(np.linalg.norm(upper - lower))
        far = float(np.linalg.norm(np.maximum(np.maximum(lower, -upper), 0.0)))
        move = f"({', '.join(f'{-x:g}' for x in (lower + upper) / 2)}) m"
        if far > MOST_OFF * size:
            raise GeometryError(
                "mesh",
                f"is {size:g} m across and lies {far:g} m from its origin, which is the robot's reference point",
                f"at most {MOST_OFF:g} times its size is accepted",
                f"move it there first, by {move} for its middle",
            )
        if warn and far > size:
            warn_user(
                f"the robot's mesh is {size:g} m across and lies {far:g} m from its origin, which is its reference "
                "point: a configuration is where that point is; unless this is meant, move the mesh there first, by "
                f"{move} for its middle"
            )

    def is_same(self, matrix: Floats) -> bool:
        # Sums of whole numbers, those of the bits, are the same in any order; few other matrices leave them.
        sums = [(self._corners @ turn.T + 0.0).view(np.int64).sum(axis=0) for turn in (np.eye(3), matrix)]
        return np.array_equal(*sums) and super().is_same(matrix)

    @cached_property
    def _corners(self) -> Floats:
        return ordered_rows(self.triangles.reshape(-1, 3))[0]

    def _features(self, matrix: Floats) -> Floats:
        """The triangles, each from its smallest corner on; see :func:`_merged_faces` for those of closed bodies."""
        corners = (self.vertices @ matrix.T + 0.0)[self.faces]
        if np.linalg.det(matrix) < 0.0:
            corners = corners[:, ::-1]
        points, ranks = ordered_rows(corners.reshape(-1, 3))
        ranks = ranks.reshape(-1, 3)
        if self.solid == "auto" and (self._turns == 1).all():
            return _merged_faces(points, ranks)
        order = (ranks.argmin(axis=1)[:, None] + np.arange(3)) % 3
        return np.take_along_axis(corners, order[..., None], axis=1).reshape(-1, 9)

    def contains(self, points: ArrayLike) -> Bools:
        """Whether points lie in the closed bodies, for points farther from the surface than rounding.

        For ``solid="surface"`` nothing does.

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
        if self.solid == "fill":
            rule = "what is filled depends on the spacing, so that a mesh alone does not decide it"
            raise InputError(
                self.source, "has solid='fill'", rule, "ask its cells, or pass solid='auto'", value=self.solid
            )
        array = check_points(points, "points", self.dim)
        if self.solid == "surface":
            return np.zeros(array.shape[:-1], dtype=np.bool_)
        numbers = self._winding.evaluate((array - self.bounds[0]).reshape(-1, 3))
        return np.asarray(numbers.reshape(array.shape[:-1]) != 0)

    @property
    def spec(self) -> dict[str, object]:
        """The mesh as plain values that JSON can hold, to the last bit."""
        return {
            "kind": "mesh",
            "vertices": _encoded(self.vertices, "<f8"),
            "faces": _encoded(self.faces, "<i8"),
            "solid": self.solid,
            "source": self.source,
        }

    @classmethod
    def from_spec(cls, spec: Mapping[str, object]) -> Mesh:
        """The mesh of :meth:`spec`.

        Raises
        ------
        InputError
            If ``spec`` is not such a record.
        """
        try:
            given: Mapping[str, Any] = spec
            vertices, faces = _decoded(given["vertices"], "<f8"), _decoded(given["faces"], "<i8")
            solid, source = given["solid"], str(given["source"])
        except (KeyError, TypeError, ValueError) as error:
            rule, hint = "a mesh needs vertices, faces, solid and source", "write it again with Mesh.spec"
            raise InputError("spec", f"is damaged: {error!r}", rule, hint, value=spec) from error
        mesh = cls(vertices, faces, solid, source)
        # Whoever wrote the record was warned.
        object.__setattr__(mesh, "_warned", True)
        return mesh

    @cached_property
    def _turns(self) -> Ints:
        """How often each triangle counts as part of what encloses something, shape (F,)."""
        turns = np.zeros(len(self.faces), dtype=np.int64)
        for body in self.bodies:
            if body.closed:
                turns[body.faces] = body.turns
        return turns

    @cached_property
    def _winding(self) -> WindingNumber:
        from cspace.raster.surfaces import WindingNumber

        counted = np.flatnonzero(self._turns)
        return WindingNumber(self.vertices[self.faces[counted]] - self.bounds[0], self._turns[counted])

    @property
    def closed(self) -> tuple[Floats, Ints]:
        """Triangles that enclose something, metres, shape (n, 3, 3), and how often each counts for winding numbers."""
        counted = np.flatnonzero(self._turns)
        return self.vertices[self.faces[counted]], self._turns[counted]

    def _skin(self, near: Chosen = slice(None), columns: Chosen = slice(None)) -> SolidSurface:
        """Some of the triangles, and those of the enclosing ones that may be above or below them."""
        from cspace.raster.surfaces import ClosedSurface, SolidSurface

        shell = ClosedSurface(self.vertices, self.faces[columns], self._turns[columns]) if self.encloses else None
        fill = self._warn_of_nothing if self.solid == "fill" else None
        return SolidSurface(self.vertices, self.faces[near], shell, fill, self.source)

    def _warn_of_nothing(self, spacing: float) -> None:
        """Warn, once, where filling a mesh that is not closed added nothing to its surface."""
        if self._warned or self.is_watertight:
            return
        object.__setattr__(self, "_warned", True)
        message = (
            f"{self.source} is open and encloses no cell of {spacing:g} m, so that filling added none; it was taken as "
            "a surface without an inside; close its gaps, or use cells larger than they are, or ask for its surface "
            "alone"
        )
        warn_user(message, MeshWarning)

    def _doubts(self, option: str, fills: bool) -> Iterator[str]:
        """Yield what there is to warn of if closed bodies are taken as solid."""
        surface, fill = option.format("surface"), option.format("fill")
        open_bodies = [body for body in self.bodies if not body.closed]
        hollow = sum(body.closed and body.volume == 0.0 for body in self.bodies)
        if not self.bodies:
            yield (
                f"no triangle of {self.source} has an area; it was taken as a surface without an inside; pass "
                f"{surface} to say so"
            )
        if open_bodies:
            yield (
                f"{len(open_bodies)} of {len(self.bodies)} bodies of {self.source} are open "
                f"({sum(len(body.faces) for body in open_bodies)} of {len(self.faces)} triangles); they were taken as "
                f"surfaces without an inside; close their gaps, or pass {surface} if no body has an inside"
                + f", or {fill} to fill what the cells enclose"
                * fills
            )
        if hollow:
            yield (
                f"the volumes that {hollow} of {len(self.bodies)} bodies of {self.source} wind round cancel; where "
                "windings do, as where a surface is drawn once for each side, a body is hollow; draw each surface once"
                + f", or pass {fill} to fill what the cells enclose"
                * fills
            )


def _merged_faces(points: Floats, faces: Ints) -> Floats:
    """Rows that identify the surface of closed bodies, whatever the diagonals by which flat faces became triangles.

    Triangles across an axis that lie in one plane and face the same way are identified by the sides that do not cancel
    between them, with how often each counts; others by themselves. Points are in order, and named by faces.
    """
    corners = points[faces]
    level = (corners == corners[:, :1]).all(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    plane = np.where(level.any(axis=1), (1 + level.argmax(axis=1)) * np.sign((level * normal).sum(axis=1)), 0.0)
    # A triangle that is identified by itself has all of its corners in each of its rows.
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
    forth = sides[..., 0] < sides[..., 1]
    third = np.where(plane[:, None] == 0.0, np.roll(faces, -2, axis=1), -1)
    rows = np.column_stack([np.repeat(plane, 3), np.sort(sides, axis=-1).reshape(-1, 2), third.ravel()])
    kinds, kind = ordered_rows(rows)
    counts = np.bincount(kind, weights=np.where(forth, 1.0, -1.0).ravel())
    kinds, counts = kinds[counts != 0.0], counts[counts != 0.0]
    named = kinds[:, 1:].astype(np.int64)
    last = np.where(named[:, 2:] < 0, 0.0, points[named[:, 2]])
    return np.column_stack([kinds[:, 0], counts, points[named[:, 0]], points[named[:, 1]], last])


def _without_cracks(shadow: BaseGeometry, width: float) -> BaseGeometry:
    """Fill holes that are at most ``width`` wide, metres.

    If one of them is real, that changes no proof: no cell of an obstacle fits into it.
    """
    import shapely

    def filled(part: Any) -> BaseGeometry:
        holes = [hole for hole in part.interiors if not shapely.Polygon(hole).buffer(-width / 2.0).is_empty]
        return shapely.Polygon(part.exterior, holes)

    return shapely.MultiPolygon([filled(part) for part in shapely.get_parts(shadow)])


def _arrays_of(shape: Any) -> tuple[Any, Any, str]:
    """Vertices, faces and a name."""
    from cspace.files.meshes import flatten_trimesh, read_mesh

    if isinstance(shape, (str, os.PathLike)):
        return *read_mesh(shape), Path(shape).name
    if isinstance(shape, (tuple, list)) and len(shape) == 2:
        return *shape, "mesh"
    return *flatten_trimesh(shape, "mesh"), "mesh"


def _checked_vertices(values: Any, source: str) -> Floats:
    vertices = finite(values, f"vertices of {source}")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        rule, hint = "it must be (V, 3), in metres", "pass x, y, z for each"
        raise GeometryError(f"vertices of {source}", f"has shape {vertices.shape}", rule, hint, value=values)
    far = float(np.abs(vertices).max(initial=0.0))
    if far > _LARGEST:
        raise GeometryError(
            f"vertices of {source}", f"reach {far:g}", f"at most {_LARGEST:g} is taken", "check the units", value=values
        )
    if 0.0 < far < _SMALLEST:
        rule = f"at least {_SMALLEST:g} is taken"
        raise GeometryError(f"vertices of {source}", f"reach {far:g}", rule, "check the units", value=values)
    return np.array(np.where(np.abs(vertices) < _NOUGHT, 0.0, vertices), dtype=np.float64, order="C")


def _encoded(array: NDArray[Any], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype=dtype).tobytes()).decode("ascii")


def _decoded(text: str, dtype: str) -> NDArray[Any]:
    raw = np.frombuffer(base64.b64decode(text, validate=True), dtype=dtype)
    return raw.reshape(-1, 3)
