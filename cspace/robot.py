"""Robots: rigid shapes whose reference point is the origin of their own frame."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import FileError, GeometryError, InputError
from cspace.grid import MAX_COORDINATE, finite, positive, unmasked
from cspace.raster.raster import Raster
from cspace.shapes import check_point, check_polygons, polygon_name

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Robot:
    """A rigid robot in the plane: a union of regions given by their borders, or a union of discs.

    Make one with :meth:`polygon`, :meth:`rectangle`, :meth:`disc`, :meth:`balls`, :meth:`cells` or :meth:`open`. The
    reference point, whose position is the configuration, is the origin; it may lie anywhere, also outside the shape.

    Attributes
    ----------
    name : str
        A short text for people, such as ``"disc 0.3 m"``.
    definition : str
        JSON of :attr:`spec`.
    outlines : tuple of ndarray, shape (E, 4)
        Border segments ``(x0, y0, x1, y1)`` of each region, metres; empty for discs.
    centers, radii : ndarray, shape (n, 2) and (n,)
        Discs, metres; empty for regions.
    span : float
        Largest modulus of the numbers that the shape was computed from, metres.
    """

    name: str
    definition: str
    outlines: tuple[Floats, ...]
    centers: Floats
    radii: Floats
    span: float

    dim = 2

    @property
    def spec(self) -> dict[str, Any]:
        """Plain numbers, strings and lists from which :meth:`from_spec` makes the same robot again."""
        spec: dict[str, Any] = json.loads(self.definition)
        return spec

    @classmethod
    def _of(
        cls,
        name: str,
        spec: dict[str, Any],
        outlines: Sequence[Floats] = (),
        centers: Floats | None = None,
        radii: Floats | None = None,
        span: float = 0.0,
    ) -> Robot:
        points = np.empty((0, 2)) if centers is None else centers
        sizes = np.empty(0) if radii is None else radii
        reach = [float(np.abs(part).max()) for part in outlines] + (np.abs(points).max(axis=1) + sizes).tolist()
        frozen = tuple(map(_frozen, outlines))
        return cls(
            name,
            json.dumps({"name": name, **spec}, sort_keys=True),
            frozen,
            _frozen(points),
            _frozen(sizes),
            max(span, *reach, 0.0),
        )

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
            outlines=[polygon_outline(part) for part in parts],
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
    def balls(cls, centers: ArrayLike, radii: ArrayLike) -> Robot:
        """A union of discs.

        Parameters
        ----------
        centers : array-like, shape (n, 2)
            Metres, in the robot's frame.
        radii : array-like, shape (n,), or one number
            Metres, above zero.

        Raises
        ------
        InputError
            If there is no disc, the shapes do not fit, a value is not finite, or a radius is not above zero.
        """
        points = finite(centers, "centers")
        if points.ndim != 2 or points.shape[1] != 2 or not len(points):
            raise InputError(
                f"centers has shape {points.shape}; it must be (n, 2) with n at least 1; pass one row for each disc"
            )
        sizes = finite(radii, "radii")
        if sizes.shape not in {(), (len(points),)}:
            raise InputError(
                f"radii has shape {sizes.shape}; it must be one number or ({len(points)},), one for each center"
            )
        sizes = np.broadcast_to(sizes, len(points)).copy()
        if (sizes <= 0).any():
            raise InputError(f"radii holds {sizes.min():g}; each must be above zero; drop discs that have no area")
        single = len(points) == 1
        return cls._of(
            name=f"disc {sizes[0]:g} m" if single else f"{len(points)} discs",
            spec={"kind": "balls", "centers": points.tolist(), "radii": sizes.tolist()},
            centers=points.copy(),
            radii=sizes,
        )

    @classmethod
    def cells(cls, occupied: ArrayLike, spacing: float, lower: ArrayLike = (0.0, 0.0)) -> Robot:
        """A bitmap: the union of the closed cells ``lower + spacing * (i + [0, 1]^2)`` where ``occupied[i]`` is set.

        Parameters
        ----------
        occupied : array-like of bool, shape (nx, ny)
            Indexed ``[x, y]``.
        spacing : float
            Side of a cell of the bitmap, metres; it need not be the map's.
        lower : array-like, shape (2,)
            Lower corner of cell (0, 0) in the robot's frame, metres.

        Raises
        ------
        GeometryError
            If no cell is occupied.
        InputError
            If ``occupied`` is not two-dimensional and boolean, or another value is not as stated.
        """
        from cspace.raster.boundary import boundary_segments

        unmasked(occupied, "occupied")
        bitmap = np.asarray(occupied)
        if bitmap.ndim != 2 or bitmap.dtype != np.bool_:
            raise InputError(
                f"occupied has shape {bitmap.shape} and type {bitmap.dtype}; it must be a two-dimensional boolean "
                "array; compare with a threshold first, e.g. array > 0"
            )
        bitmap = bitmap != 0  # a boolean array may hold other bytes than 0 and 1
        if not bitmap.any():
            raise GeometryError("occupied holds no True cell; a robot must have an area; set the cells it fills")
        side, corner = positive(spacing, "spacing"), check_point(lower, "lower")
        return cls._of(
            name=f"bitmap {bitmap.shape[0]} x {bitmap.shape[1]} cells of {side:g} m",
            spec={
                "kind": "cells",
                "bits": base64.b64encode(np.packbits(bitmap).tobytes()).decode(),
                "shape": list(bitmap.shape),
                "spacing": side,
                "lower": list(corner),
            },
            outlines=[boundary_segments(bitmap, side, corner)],
            span=max(map(abs, corner)) + side * max(bitmap.shape),
        )

    @classmethod
    def from_spec(cls, spec: dict[str, Any]) -> Robot:
        """The robot that :attr:`spec` describes.

        Raises
        ------
        InputError
            If ``spec`` describes no robot.
        """
        try:
            return replace(
                _FROM_SPEC[spec["kind"]](spec), name=str(spec["name"]), definition=json.dumps(spec, sort_keys=True)
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"robot spec {str(spec)[:80]} is not one that Robot.spec makes: {error}") from error

    @classmethod
    def open(cls, source: str | Path) -> Robot:
        """A robot from a short text or a file.

        Parameters
        ----------
        source : str or Path
            ``disc:RADIUS``, ``rect:LENGTHxWIDTH`` (metres), or a file of polygons: GeoJSON (``.geojson``, ``.json``) or
            ``.wkt``.

        Raises
        ------
        InputError
            If the text is none of these.
        FileError
            If the file cannot be read.
        """
        kind, colon, sizes = str(source).partition(":")
        if colon and kind in _SHORT:
            names, make = _SHORT[kind]
            return make(*_numbers(str(source), sizes, names))
        path = Path(source)
        if path.suffix.lower() in {".geojson", ".json", ".wkt"}:
            from cspace.io.vector import read_shapes

            return cls.polygon(read_shapes(path), name=f"polygon {path.name}")
        forms = ", ".join(f"{key}:{'x'.join(name.upper() for name in names)}" for key, (names, _) in _SHORT.items())
        if path.exists():
            raise FileError(f"{path}: suffix {path.suffix!r} is not a robot's; pass {forms}, .geojson, .json or .wkt")
        raise InputError(f"robot is {str(source)!r}; it must be one of {forms} (metres) or a .geojson or .wkt file")

    @property
    def geometry(self) -> BaseGeometry:
        """The shape in the robot's frame, as a shapely geometry in metres, for drawing and display.

        Discs are drawn as polygons of 128 corners; the rasters never use this.
        """
        import shapely

        if len(self.radii):
            return shapely.union_all(shapely.buffer(shapely.points(self.centers), self.radii, quad_segs=32))
        regions = [
            shapely.build_area(shapely.union_all(shapely.linestrings(outline.reshape(-1, 2, 2))))
            for outline in self.outlines
        ]
        return shapely.union_all(regions)

    @property
    def symmetry(self) -> int:
        """How many turns in a circle map the robot to itself: 1, 2 or 4, or 0 for all turns.

        Only turns that map it to itself to the last bit count.
        """
        if len(self.radii) == 1 and not self.centers.any():
            return 0
        for order, turn in ((4, [[0.0, 1.0], [-1.0, 0.0]]), (2, [[-1.0, 0.0], [0.0, -1.0]])):
            if self._features(np.eye(2)) == self._features(np.asarray(turn)):
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
        from cspace.raster.robots import ball_rasters, outline_rasters

        side = positive(spacing, "spacing")
        grown = check_margin(margin)
        far = (self.span + grown) / side
        if not far <= MAX_COORDINATE:
            raise InputError(
                f"the robot reaches {far:.3g} cells from its reference point; at most {MAX_COORDINATE:.0f} keep the "
                "answers proven against rounding; use a larger spacing, or check the robot's units (metres) and origin"
            )
        if len(self.radii):
            return ball_rasters(self.centers, self.radii, side, grown, yaw, sweep)
        return outline_rasters(self.outlines, side, grown, yaw, sweep)

    def _features(self, turn: Floats) -> set[tuple[float, ...]]:
        """What the shape is made of, turned: discs, or border segments without direction."""
        found: set[tuple[float, ...]] = set()
        for (x, y), radius in zip((self.centers @ turn + 0.0).tolist(), self.radii.tolist(), strict=True):
            found.add((x, y, radius))
        for number, outline in enumerate(self.outlines):
            ends = (outline.reshape(-1, 2) @ turn + 0.0).reshape(-1, 2, 2).tolist()
            found.update((*min(first, last), *max(first, last), number) for first, last in ends)
        return found


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


def _frozen(array: Floats) -> Floats:
    array.setflags(write=False)
    return array


def _numbers(source: str, sizes: str, names: tuple[str, ...]) -> list[float]:
    """The numbers of a short text such as ``rect:0.9x0.6``."""
    words = sizes.split("x")
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != len(names) or not all(math.isfinite(value) and value > 0.0 for value in values):
        form = "x".join(name.upper() for name in names)
        raise InputError(
            f"robot is {source!r}; after the colon must stand {form}, each above zero, in metres; "
            f"write e.g. {source.partition(':')[0]}:{'x'.join(['0.3'] * len(names))}"
        )
    return values


def _cells_from_spec(spec: dict[str, Any]) -> Robot:
    shape = tuple(int(n) for n in spec["shape"])
    bits = np.frombuffer(base64.b64decode(spec["bits"], validate=True), dtype=np.uint8)
    bitmap = np.unpackbits(bits, count=math.prod(shape)).astype(np.bool_).reshape(shape)
    return Robot.cells(bitmap, spec["spacing"], spec["lower"])


def _polygon_from_spec(spec: dict[str, Any]) -> Robot:
    import shapely

    return Robot.polygon([shapely.from_wkb(base64.b64decode(text, validate=True)) for text in spec["wkb"]])


_FROM_SPEC: dict[str, Callable[[dict[str, Any]], Robot]] = {
    "balls": lambda spec: Robot.balls(spec["centers"], spec["radii"]),
    "cells": _cells_from_spec,
    "polygon": _polygon_from_spec,
}

_SHORT: dict[str, tuple[tuple[str, ...], Callable[..., Robot]]] = {
    "disc": (("radius",), Robot.disc),
    "rect": (("length", "width"), Robot.rectangle),
}
