"""Spheres: balls that describe a shape, with how well they do."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

from cspace.arrays import Floats, frozen
from cspace.check import check_word, finite
from cspace.errors import FileError, InputError
from cspace.files.access import replacing, suffix_of
from cspace.files.plain import read_json, read_yaml
from cspace.shapes import Balls, ExactShape, Shape
from cspace.spectral.descriptors import check_solid_balls

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Kind = Literal["inner", "outer"]

KINDS: Final = ("inner", "outer")
FORMAT: Final = "cspace-spheres"
VERSION: Final = 2

COLORS: Final = {"inner": "#0072b2", "outer": "#d55e00"}
"""Of balls, from Okabe and Ito (2008)."""

READERS: Final[dict[str, Callable[[Any, str], Any]]] = {".json": read_json, ".yaml": read_yaml, ".yml": read_yaml}
RULE: Final = "balls go into .yaml, .yml or .json"

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

    Raises InputError if there is no ball, arrays do not fit, or a value is not usable.
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
        check_word(self.kind, "kind", KINDS)
        for name in _BOUNDS:
            pair = finite(getattr(self, name), name)
            if pair.shape != (2,) or not 0.0 <= pair[0] <= pair[1]:
                rule = "it must be two numbers, zero or above, the lower one first"
                raise InputError(
                    name, f"is {getattr(self, name)!r}", rule, "pass Bounds(lower, upper)", value=getattr(self, name)
                )
            object.__setattr__(self, name, Bounds(*pair.tolist()))
        object.__setattr__(self, "centers", frozen(centers))
        object.__setattr__(self, "radii", frozen(radii))

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
        """Draw the balls, and their shape where it is known, on axes or else in a new figure that belongs to no window.

        The title gives number, kind and how well they describe the shape, unless one is passed. Raises InputError if
        axes are of the plane and balls are in space, or the other way around.
        """
        from matplotlib.collections import LineCollection, PatchCollection
        from matplotlib.figure import Figure
        from matplotlib.patches import Circle

        solid, color = self.dim == 3, COLORS[self.kind]
        axes: Any = ax or Figure((6.5, 6.5), layout="constrained").add_subplot(projection="3d" if solid else None)
        if solid != hasattr(axes, "get_zlim"):
            where = ("in the plane", "in space")
            mend = "add_subplot(projection='3d') makes axes for balls, and one without a projection for discs"
            raise InputError("ax", f"is {where[not solid]}", f"the balls are {where[solid]}", mend, value=ax)
        if solid:
            shapes: list[tuple[ExactShape, dict[str, Any]]] = [(Balls(self.centers, self.radii), {"color": color})]
            if self.shape is not None:
                shapes.append((self.shape.outer, {"color": (0, 0, 0, 0), "edgecolor": "#26262680", "linewidth": 0.5}))
            for (vertices, faces), style in ((shape.surface, style) for shape, style in shapes):
                axes.plot_trisurf(*vertices.T, triangles=faces, **style)
        else:
            # So many discs lie over each other that their colours must be thin.
            discs = PatchCollection(list(map(Circle, self.centers, self.radii)), facecolor=(color, 0.16), linewidth=0.6)
            discs.set_edgecolor((color, 0.75))
            axes.add_collection(discs)
            if self.shape is not None:
                axes.add_collection(LineCollection(list(self.shape.outer.boundary().simplices), colors="#262626"))
            axes.autoscale_view()
        axes.set(aspect="equal", **{f"{name}label": f"{name} [m]" for name in "xyz"[: self.dim]})
        text = f"{len(self)} {self.kind} {'balls' if solid else 'discs'}, within {self.hausdorff.upper:.3g} m"
        axes.set_title(text if title is None else title, fontsize=10)
        return axes  # type: ignore[no-any-return]

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> Path:
        """Write all but the shape to a file, to the last bit; its name ends in ``.yaml``, ``.yml`` or ``.json``.

        Raises InputError if it ends otherwise, and FileError if the file exists and ``overwrite`` is not set, or cannot
        be written.
        """
        suffix_of(path, READERS, RULE)
        record: dict[str, Any] = {"format": FORMAT, "version": VERSION, "kind": self.kind}
        record |= {name: list(getattr(self, name)) for name in _BOUNDS}
        record |= {"centers": self.centers.tolist(), "radii": self.radii.tolist()}
        with replacing(path, overwrite) as temporary:
            temporary.write_text(json.dumps(record), encoding="utf-8")  # which is YAML as well
        return Path(path)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Spheres:
        """Read what :meth:`save` wrote.

        Raises InputError if the name ends otherwise, and FileError if the file is missing, malformed, or of another
        version.
        """
        load = READERS[suffix_of(path, READERS, RULE)]
        record, name = load(path, "file of balls"), os.fspath(path)
        if not isinstance(record, Mapping) or record.get("format") != FORMAT:
            raise FileError(name, "holds no balls", f"its format must be {FORMAT!r}", "pass a file of Spheres.save")
        if record.get("version") != VERSION:
            version = f"has version {record.get('version')!r}"
            raise FileError(name, version, f"this library reads {VERSION}", "use the library that wrote it")
        try:
            bounds = {key: record[key] for key in _BOUNDS}
            return cls(record["centers"], record["radii"], record["kind"], **bounds)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            what = f"lacks {error}" if isinstance(error, KeyError) else f"is malformed: {error}"
            raise FileError(name, what, "it must be as Spheres.save writes it", "mend or write it again") from error
