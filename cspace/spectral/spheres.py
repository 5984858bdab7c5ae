"""Spheres: balls that describe a shape, with how well they do."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError, InputError
from cspace.grid import finite
from cspace.shapes import Balls, Shape
from cspace.spectral.inputs import check_kind, check_solid_balls

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
Kind = Literal["inner", "outer"]

KINDS: Final = ("inner", "outer")
FORMAT: Final = "cspace-spheres"
VERSIONS: Final = (1, 2)
"""That are read; the last one is written. The first also told a method."""

COLORS: Final = {"inner": "#0072b2", "outer": "#d55e00"}
"""Of balls, from Okabe and Ito (2008)."""

_BOUNDS: Final = ("measure", "shape_measure", "hausdorff")


class Bounds(NamedTuple):
    """A number that lies between two."""

    lower: float
    upper: float


@dataclass(frozen=True, slots=True, eq=False)
class Spheres:
    """Balls in space, or discs in the plane, that lie in a shape or cover it.

    Made by :func:`cspace.spectral.decompose`, or read with :meth:`open`.

    Attributes
    ----------
    centers : ndarray, shape (n, d)
        Metres; read-only, the largest ball first.
    radii : ndarray, shape (n,)
        Metres; read-only.
    kind : {"inner", "outer"}
        Whether each ball lies in the shape, or the union covers it.
    measure, shape_measure : Bounds
        Of the area or volume of the union, and of the shape, square or cubic metres.
    hausdorff : Bounds
        Of the one-sided Hausdorff distance that is not zero, metres: for "inner", the farthest that a point of the
        shape is from the balls; for "outer", the farthest that a point of the balls is from the shape.
    shape : Shape, or None
        The shape, for pictures; it is not written to files.

    Raises
    ------
    InputError
        If there is no ball, arrays do not fit, or a value is not usable.
    """

    centers: Floats = field(repr=False)
    radii: Floats = field(repr=False)
    kind: Kind
    measure: Bounds
    shape_measure: Bounds
    hausdorff: Bounds
    shape: Shape | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        centers, radii = check_solid_balls(self.centers, self.radii)
        check_kind(self.kind, "kind", KINDS)
        for name in _BOUNDS:
            pair = finite(getattr(self, name), name)
            if pair.shape != (2,) or not 0.0 <= pair[0] <= pair[1]:
                rule = "it must be two numbers, zero or above, the lower one first"
                raise InputError(name, f"is {getattr(self, name)!r}", rule, "pass Bounds(lower, upper)")
            object.__setattr__(self, name, Bounds(*pair.tolist()))
        for name, array in (("centers", centers), ("radii", radii)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        """Number of balls."""
        return len(self.radii)

    @property
    def dim(self) -> int:
        """Number of axes, 2 or 3."""
        return int(self.centers.shape[1])

    @property
    def volume_bounds(self) -> Bounds:
        """Bounds of the area or volume of the union, over that of the shape; without end if the shape has none."""
        low, high = self.shape_measure
        return Bounds(
            self.measure.lower / high if high > 0.0 else float("inf"),
            self.measure.upper / low if low > 0.0 else float("inf"),
        )

    @property
    def volume_ratio(self) -> float:
        """The middle of :attr:`volume_bounds`; in the plane, these are some 1e-5 apart."""
        return sum(self.volume_bounds) / 2.0

    def plot(self, ax: Axes | None = None, *, title: str | None = None) -> Axes:
        """Draw the balls, and their shape where it is known.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw, in three dimensions for balls in space; by default a new figure, which belongs to no window.
        title : str, optional
            By default number, kind and how well they describe the shape.

        Raises
        ------
        InputError
            If axes are of the plane and balls are in space, or the other way around.
        """
        from matplotlib.figure import Figure

        solid = self.dim == 3
        axes: Any = ax or Figure((6.5, 6.5), layout="constrained").add_subplot(projection="3d" if solid else None)
        if solid != hasattr(axes, "get_zlim"):
            where = ("in the plane", "in space")
            mend = "add_subplot(projection='3d') makes axes for balls, and one without a projection for discs"
            raise InputError("ax", f"is {where[not solid]}", f"the balls are {where[solid]}", mend)
        (_draw_solid if solid else _draw_flat)(self, axes)
        reach = self.radii[:, None]
        corners = np.vstack([self.centers - reach, self.centers + reach, *(self.shape.bounds if self.shape else ())])
        lower, upper = corners.min(axis=0), corners.max(axis=0)
        room = 0.03 * float((upper - lower).max())
        for name, low, high in zip("xyz", lower, upper, strict=False):
            axes.set(**{f"{name}lim": (low - room, high + room), f"{name}label": f"{name} [m]"})
        axes.set_aspect("equal")
        words = f"{len(self)} {self.kind} {'balls' if solid else 'discs'}, within {self.hausdorff.upper:.3g} m"
        axes.set_title(words if title is None else title, fontsize=10)
        return axes  # type: ignore[no-any-return]

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> Path:
        """Write all but the shape to a file, to the last bit.

        Parameters
        ----------
        path : path-like
            Ends in ``.yaml``, ``.yml`` or ``.json``.
        overwrite : bool
            Whether an existing file may be replaced.

        Raises
        ------
        InputError
            If the suffix is none of these.
        FileError
            If the file exists and ``overwrite`` is not set, or cannot be written.
        """
        from cspace.io.output import replacing

        dump, _ = _format_of(path)
        record: dict[str, Any] = {"format": FORMAT, "version": VERSIONS[-1], "kind": self.kind}
        record |= {name: list(getattr(self, name)) for name in _BOUNDS}
        record |= {"centers": self.centers.tolist(), "radii": self.radii.tolist()}
        with replacing(path, overwrite) as temporary:
            temporary.write_text(dump(record), encoding="utf-8")
        return Path(path)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Spheres:
        """Read what :meth:`save` wrote.

        Raises
        ------
        InputError
            If the suffix is not one of those that :meth:`save` takes.
        FileError
            If the file is missing, malformed, or of another version.
        """
        _, load = _format_of(path)
        record, name = load(path, "file of balls"), os.fspath(path)
        if not isinstance(record, Mapping) or record.get("format") != FORMAT:
            raise FileError(name, "holds no balls", f"its format must be {FORMAT!r}", "pass a file of Spheres.save")
        if record.get("version") not in VERSIONS:
            version = f"has version {record.get('version')!r}"
            raise FileError(name, version, f"this library reads {VERSIONS}", "use the library that wrote it")
        try:
            bounds = {key: record[key] for key in _BOUNDS}
            return cls(record["centers"], record["radii"], record["kind"], **bounds)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            what = f"lacks {error}" if isinstance(error, KeyError) else f"is malformed: {error}"
            raise FileError(name, what, "it must be as Spheres.save writes it", "mend or write it again") from error


def _format_of(path: str | os.PathLike[str]) -> tuple[Callable[[Any], str], Callable[[Any, str], Any]]:
    """How records are written, and how they are read from a file."""
    import yaml

    from cspace.io.input import suffix_of
    from cspace.io.plain import read_json, read_yaml

    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    to_yaml: Any = partial(yaml.dump, Dumper=dumper, sort_keys=False, default_flow_style=None, width=120)
    formats: dict[str, tuple[Callable[[Any], str], Callable[[Any, str], Any]]] = {
        ".json": (json.dumps, read_json),
        ".yaml": (to_yaml, read_yaml),
        ".yml": (to_yaml, read_yaml),
    }
    return formats[suffix_of(path, formats, "balls go into .yaml, .yml or .json")]


def _draw_flat(spheres: Spheres, axes: Any) -> None:
    from matplotlib.collections import EllipseCollection, LineCollection
    from matplotlib.colors import to_rgba

    sizes, color = 2.0 * spheres.radii, COLORS[spheres.kind]
    options = {"units": "xy", "offsets": spheres.centers, "offset_transform": axes.transData}
    discs = EllipseCollection(sizes, sizes, np.zeros(len(sizes)), **options)
    # So many discs lie over each other that their colours must be thin.
    discs.set(facecolor=to_rgba(color, 0.16), edgecolor=to_rgba(color, 0.75), linewidth=0.6, zorder=2)
    axes.add_collection(discs)
    if spheres.shape is not None:
        pieces = list(spheres.shape.boundary().simplices)
        axes.add_collection(LineCollection(pieces, colors="#262626", linewidths=1.2, zorder=3))


def _draw_solid(spheres: Spheres, axes: Any) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # type: ignore[import-untyped]

    vertices, faces = Balls(spheres.centers, spheres.radii).surface
    color = COLORS[spheres.kind]
    axes.add_collection3d(Poly3DCollection(vertices[faces], facecolors=color, shade=True, alpha=0.9))
    if spheres.shape is not None:
        vertices, triangles = spheres.shape.surface
        edges = vertices[np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0)]
        axes.add_collection3d(Line3DCollection(edges, colors="#262626", linewidths=0.5, alpha=0.5))
