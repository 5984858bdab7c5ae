"""Spheres: balls that describe a shape, with how well they do."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError, InputError
from cspace.grid import finite
from cspace.spectral.inputs import check_kind, check_solid_balls

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.shapes import Shape

Floats = NDArray[np.float64]
Kind = Literal["inner", "outer"]

KINDS: Final = ("inner", "outer")
FORMAT: Final = "cspace-spheres"
VERSION: Final = 1

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
    method : str
        How they were found.
    measure : Bounds
        Of the area or volume of the union, square or cubic metres.
    shape_measure : Bounds
        Of that of the shape.
    hausdorff : Bounds
        Of the one-sided Hausdorff distance that is not zero, metres: for "inner", the farthest that a point of the
        shape is from the balls; for "outer", the farthest that a point of the balls is from the shape.
    shape : Shape, or None
        The shape, for pictures; it is not written to files.

    Raises
    ------
    InputError
        If there is no ball, arrays do not fit, a value is not finite, a radius is not above zero, or a word or bound
        is not usable.
    """

    centers: Floats = field(repr=False)
    radii: Floats = field(repr=False)
    kind: Kind
    method: str
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

    @property
    def shape_to_balls(self) -> Bounds:
        """Bounds of how far a point of the shape is from the balls, metres; zero for "outer"."""
        return self.hausdorff if self.kind == "inner" else Bounds(0.0, 0.0)

    @property
    def balls_to_shape(self) -> Bounds:
        """Bounds of how far a point of the balls is from the shape, metres; zero for "inner"."""
        return self.hausdorff if self.kind == "outer" else Bounds(0.0, 0.0)

    def plot(self, ax: Axes | None = None, *, shape: Any = None, title: str | None = None) -> Axes:
        """Draw the balls, and the shape with them.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw, in three dimensions for balls in space; by default a new figure, which belongs to no window.
        shape : Shape, or what :func:`cspace.spectral.decompose` takes, optional
            By default the one that the balls were made from, where it is known.
        title : str, optional
            By default number, kind and how well they describe the shape. Pass ``""`` for none.

        Returns
        -------
        matplotlib.axes.Axes
            ``ax.figure`` is the figure.

        Raises
        ------
        InputError
            If axes are of the plane and balls are in space, or the shape has another dimension.
        """
        from cspace.spectral.picture import draw

        return draw(self, ax, shape, title)

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> Path:
        """Write all but the shape to a file, to the last bit.

        Parameters
        ----------
        path : path-like
            Ends in ``.yaml``, ``.yml`` or ``.json``.
        overwrite : bool
            Whether an existing file may be replaced.

        Returns
        -------
        pathlib.Path
            The file.

        Raises
        ------
        InputError
            If the suffix is none of these.
        FileError
            If the file exists and ``overwrite`` is not set, or cannot be written.
        """
        from cspace.io.output import replacing

        dump, _ = _format_of(path)
        record: dict[str, Any] = {"format": FORMAT, "version": VERSION, "kind": self.kind, "method": self.method}
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
        rule, mend = "it must be as Spheres.save writes it", "mend or write it again"
        if not isinstance(record, Mapping) or record.get("format") != FORMAT:
            raise FileError(name, "holds no balls", f"its format must be {FORMAT!r}", "pass a file of Spheres.save")
        if record.get("version") != VERSION:
            version = f"has version {record.get('version')!r}"
            raise FileError(name, version, f"this library reads {VERSION}", "use the library that wrote it")
        try:
            bounds = {key: record[key] for key in _BOUNDS}
            return cls(record["centers"], record["radii"], record["kind"], str(record["method"]), **bounds)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            what = f"lacks {error}" if isinstance(error, KeyError) else f"is malformed: {error}"
            raise FileError(name, what, rule, mend) from error


def _format_of(path: str | os.PathLike[str]) -> tuple[Callable[[Any], str], Callable[[Any, str], Any]]:
    """How records are written, and how they are read from a file."""
    from cspace.io.plain import read_json, read_yaml

    formats: dict[str, tuple[Callable[[Any], str], Callable[[Any, str], Any]]]
    formats = {".yaml": (_to_yaml, read_yaml), ".yml": (_to_yaml, read_yaml), ".json": (_to_json, read_json)}
    try:
        suffix = Path(path).suffix.lower()
    except TypeError as error:
        raise InputError("path", f"is {path!r}", "it must be a file name", "pass a string or a Path") from error
    if suffix not in formats:
        kinds = f"balls go into {', '.join(formats)}"
        raise InputError("path", f"is {os.fspath(path)}, of suffix {suffix!r}", kinds, "name it e.g. balls.json")
    return formats[suffix]


def _to_json(record: Mapping[str, Any]) -> str:
    return json.dumps(record, indent=1) + "\n"


def _to_yaml(record: Mapping[str, Any]) -> str:
    import yaml

    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return str(yaml.dump(record, Dumper=dumper, sort_keys=False, default_flow_style=None, width=120))
