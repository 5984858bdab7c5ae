"""Spheres: balls that describe a shape, with how well they do."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import finite
from cspace.shapes import check_balls

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
Kind = Literal["inner", "outer"]

KINDS: Final = ("inner", "outer")


class Bounds(NamedTuple):
    """A number that lies between two."""

    lower: float
    upper: float


@dataclass(frozen=True, slots=True, eq=False)
class Spheres:
    """Balls in space, or discs in the plane, that lie in a shape or cover it.

    Made by :func:`cspace.spectral.spheres.decompose`, or read with :meth:`open`.

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
    shape : shapely geometry, Mesh, or None
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
    shape: Any = field(default=None, repr=False)

    def __post_init__(self) -> None:
        centers, radii = check_balls(self.centers, self.radii)
        if (radii <= 0.0).any():
            raise InputError(f"radii holds {radii.min():g}; each must be above zero; drop balls that have no volume")
        if self.kind not in KINDS:
            raise InputError(
                f"kind is {self.kind!r}; balls lie in a shape or cover it; use one of {', '.join(map(repr, KINDS))}"
            )
        for name in ("measure", "shape_measure", "hausdorff"):
            pair = finite(getattr(self, name), name)
            if pair.shape != (2,):
                raise InputError(
                    f"{name} is {getattr(self, name)!r}; it must be two numbers; pass Bounds(lower, upper)"
                )
            low, high = pair.tolist()
            if not 0.0 <= low <= high:
                raise InputError(f"{name} is ({low}, {high}); bounds are zero or above, the lower one first; mend them")
            object.__setattr__(self, name, Bounds(low, high))
        for array in (centers, radii):
            array.setflags(write=False)
        object.__setattr__(self, "centers", centers)
        object.__setattr__(self, "radii", radii)

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
        """The middle of :attr:`volume_bounds`; in the plane, both are equal but for rounding."""
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
        shape : shapely geometry or Mesh, optional
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
            If axes are of the plane and balls are in space, or the shape is none of these.
        """
        from cspace.spectral.spheres.picture import draw

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
        from cspace.spectral.spheres.files import write_spheres

        return write_spheres(self, path, overwrite)

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
        from cspace.spectral.spheres.files import read_spheres

        return read_spheres(path)
