"""Shapes made from their sizes, and the short texts that describe them, such as ``rect:0.9x0.6``."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from numpy.typing import ArrayLike

from cspace.check import check_point, not_negative, positive
from cspace.errors import InputError
from cspace.shapes.balls import Balls
from cspace.shapes.mesh import Mesh
from cspace.shapes.polygon import Polygons
from cspace.shapes.shape import BoundedShape, Pair, Shape, capsule_bounds, cylinder_bounds, ellipse_bounds
from cspace.shapes.voxels import Box


class NamedShape(NamedTuple):
    """A shape, and a short text for people that says what it is."""

    name: str
    shape: Shape


def disc(radius: float, center: ArrayLike = (0.0, 0.0)) -> NamedShape:
    """Make a disc; metres."""
    return NamedShape(f"disc {positive(radius, 'radius'):g} m", Balls.of([check_point(center)], radius))


def ball(radius: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> NamedShape:
    """Make a ball; metres."""
    return NamedShape(f"ball {positive(radius, 'radius'):g} m", Balls.of([check_point(center, dim=3)], radius))


def rectangle(length: float, width: float, center: ArrayLike = (0.0, 0.0)) -> NamedShape:
    """Make a rectangle, ``length`` along x and ``width`` along y; metres."""
    import shapely

    half_length, half_width = positive(length, "length") / 2, positive(width, "width") / 2
    x, y = check_point(center).tolist()
    box = shapely.box(x - half_length, y - half_width, x + half_length, y + half_width)
    return NamedShape(f"rectangle {length:g} m x {width:g} m", Polygons.of(box))


def ellipse(radius_x: float, radius_y: float, center: ArrayLike = (0.0, 0.0)) -> NamedShape:
    """Make an ellipse with semi-axes ``radius_x`` along x and ``radius_y`` along y, between two polygons; metres."""
    radii, middle = (positive(radius_x, "radius_x"), positive(radius_y, "radius_y")), check_point(center)
    outer, inner = (Polygons.of(corners) for corners in ellipse_bounds(radii, middle))
    is_disc = radii[0] == radii[1] and not middle.any()
    return NamedShape(f"ellipse {radius_x:g} m x {radius_y:g} m", BoundedShape(outer, inner, is_round_about_z=is_disc))


def box(extents: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> NamedShape:
    """Make a box along the axes; metres."""
    made = Box.of(extents, center)
    return NamedShape(f"box {' m x '.join(f'{side:g}' for side in made.extents)} m", made)


def cylinder(radius: float, height: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> NamedShape:
    """Make an upright cylinder between two prisms; metres."""
    sizes = positive(radius, "radius"), positive(height, "height")
    return NamedShape(f"cylinder {radius:g} m, {height:g} m high", _moved(cylinder_bounds(*sizes), center))


def capsule(radius: float, length: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> NamedShape:
    """Make an upright capsule, all within ``radius`` of a segment of ``length``, between two polyhedra; metres."""
    sizes = positive(radius, "radius"), positive(length, "length")
    return NamedShape(f"capsule {radius:g} m, {length:g} m long", _moved(capsule_bounds(*sizes), center))


def _moved(sides: Pair, center: ArrayLike) -> BoundedShape:
    """Move a solid of revolution, given by its outer and inner surface, to a center."""
    shift = check_point(center, dim=3)
    outer, inner = (Mesh.of((vertices + shift, faces)) for vertices, faces in sides)
    return BoundedShape(outer, inner, is_round_about_z=not shift[:2].any())


def footprint(corners: str | ArrayLike, padding: float = 0.0) -> NamedShape:
    """Make a polygon from a footprint as Nav2 writes it, ``"[[0.3, 0.2], ...]"``, or from its corners; metres."""
    import numpy as np

    from cspace.files.ros import parse_footprint

    points = parse_footprint(corners)
    polygon = Polygons.of(points + not_negative(padding, "padding") * np.sign(points))
    return NamedShape(f"polygon with {polygon.corners} corners", polygon)


# ---- short texts -----------------------------------------------------------------------------------------------------


class Form(NamedTuple):
    """The short text of a kind of shape: ``KIND:`` and its sizes with a separator between them.

    Attributes
    ----------
    make : callable
        Makes the shape from its sizes and, if it is not at the origin, its center.
    sizes : tuple of str
        What the sizes are called in help texts; each is above zero, in metres.
    separator : str
    """

    make: Callable[..., NamedShape]
    sizes: tuple[str, ...]
    separator: str = "x"

    @property
    def metavar(self) -> str:
        """What follows the colon, for help texts."""
        return self.separator.join(self.sizes)


FORMS: Final = {
    "disc": Form(disc, ("RADIUS",)),
    "rect": Form(rectangle, ("LENGTH", "WIDTH")),
    "ellipse": Form(ellipse, ("RADIUS_X", "RADIUS_Y"), ","),
    "ball": Form(ball, ("RADIUS",)),
    "box": Form(lambda x, y, z, *center: box((x, y, z), *center), ("X", "Y", "Z")),
    "cylinder": Form(cylinder, ("RADIUS", "HEIGHT")),
    "capsule": Form(capsule, ("RADIUS", "LENGTH")),
}
"""Short texts by their kind, the word before the colon."""

FOOTPRINT: Final = "footprint"
"""The kind of a short text that is a polygon, or the projection of another shape."""

SHORT_TEXTS: Final = (*(f"{kind}:{form.metavar}" for kind, form in FORMS.items()), f"{FOOTPRINT}:[[X,Y],...]")
"""All short texts, for help and messages."""


def is_short_text(text: str) -> bool:
    """Return True if a text begins with the kind of a short text and a colon."""
    kind, colon, _ = text.partition(":")
    return bool(colon) and (kind in FORMS or kind == FOOTPRINT)


def parse_short_text(text: str, name: str = "shape") -> NamedShape:
    """Make the shape of a short text such as ``rect:0.9x0.6`` or ``disc:0.3@0.1,0``.

    Parameters
    ----------
    text : str
        One that :func:`is_short_text`.
    name : str
        The caller's argument, for messages.

    Raises InputError or GeometryError if what follows the colon is not as it must be.
    """
    kind, _, rest = text.partition(":")
    if kind == FOOTPRINT and rest.lstrip().startswith("["):
        return footprint(rest)
    if kind == FOOTPRINT and is_short_text(rest):
        solid = parse_short_text(rest, name)
        return NamedShape(f"footprint of {solid.name}", solid.shape.flattened())
    if kind == FOOTPRINT:
        hint = f"write e.g. {FOOTPRINT}:[[0.3,0.2],[-0.3,0.2],[0,-0.2]], or use Robot.open(path).footprint() for a file"
        raise InputError(name, f"is {text!r}", "after the colon must stand corners or a short text", hint, value=text)
    form = FORMS[kind]
    sizes, at, place = rest.partition("@")
    values, center = _numbers(sizes, form.separator), _numbers(place, ",")
    if len(values) != len(form.sizes) or min(values) <= 0.0 or bool(at) != bool(center):
        raise InputError(
            name,
            f"is {text!r}",
            f"after the colon must stand {form.metavar}, each above zero, in metres, and @X,Y or @X,Y,Z where its "
            "middle is not the origin",
            f"write e.g. {kind}:{form.separator.join(['0.3'] * len(form.sizes))}",
            value=text,
        )
    return form.make(*values, *[center] if at else [])


def _numbers(text: str, separator: str) -> list[float]:
    """Return the finite numbers of a text, or none if it holds anything else."""
    try:
        values = [float(word) for word in text.split(separator)]
    except ValueError:
        return []
    return values if all(map(math.isfinite, values)) else []
