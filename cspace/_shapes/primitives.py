"""Shapes from their sizes, and shorthands for them, such as ``rect:0.9x0.6``."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

from numpy.typing import ArrayLike

from cspace._shapes.balls import Balls
from cspace._shapes.polygon import Polygons
from cspace._shapes.shape import (
    BoundedShape,
    BoundsPair,
    Shape,
    capsule_bounds,
    cylinder_bounds,
    ellipse_bounds,
)
from cspace._shapes.voxels import Box
from cspace._support.arrays import Floats
from cspace._support.check import check_not_negative, check_point, check_positive, parse_finite
from cspace._support.reporting import warn_user
from cspace.errors import InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


class NamedShape(NamedTuple):
    """A shape, and a shorthand that describes it."""

    name: str
    shape: Shape


def disc(radius: float, center: ArrayLike = (0.0, 0.0)) -> NamedShape:
    """Make a disc; metres."""
    name = f"disc {check_positive(radius, 'radius'):g} m"
    return NamedShape(name, Balls.of([check_point(center)], radius))


def ball(radius: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> NamedShape:
    """Make a ball; metres."""
    name = f"ball {check_positive(radius, 'radius'):g} m"
    return NamedShape(name, Balls.of([check_point(center, dim=3)], radius))


def rectangle(length: float, width: float, center: ArrayLike = (0.0, 0.0)) -> NamedShape:
    """Make a rectangle, `length` along x and `width` along y; metres."""
    import shapely

    half_length = check_positive(length, "length") / 2
    half_width = check_positive(width, "width") / 2
    x, y = check_point(center).tolist()
    box = shapely.box(x - half_length, y - half_width, x + half_length, y + half_width)
    return NamedShape(f"rectangle {length:g} m x {width:g} m", Polygons.of(box))


def ellipse(radius_x: float, radius_y: float, center: ArrayLike = (0.0, 0.0)) -> NamedShape:
    """Make an ellipse by semi-axes along x, y; metres.

    It is bounded by two polygons.
    """
    radii = check_positive(radius_x, "radius_x"), check_positive(radius_y, "radius_y")
    center_point = check_point(center)
    outer, inner = ellipse_bounds(radii, center_point)
    is_disc = radii[0] == radii[1] and not center_point.any()
    shape = BoundedShape(Polygons.of(outer), Polygons.of(inner), is_round_about_z=is_disc)
    return NamedShape(f"ellipse {radius_x:g} m x {radius_y:g} m", shape)


def box(extents: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> NamedShape:
    """Make a box along the axes; metres."""
    shape = Box.of(extents, center)
    sides = " m x ".join(f"{side:g}" for side in shape.extents)
    return NamedShape(f"box {sides} m", shape)


def cylinder(radius: float, height: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> NamedShape:
    """Make an upright cylinder, bounded by two prisms; metres."""
    bounds = cylinder_bounds(check_positive(radius, "radius"), check_positive(height, "height"))
    name = f"cylinder {radius:g} m, {height:g} m high"
    return NamedShape(name, _translate(bounds, center))


def capsule(radius: float, length: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> NamedShape:
    """Make an upright capsule, bounded by two polyhedra; metres.

    It holds the points within `radius` of a vertical segment of `length`.
    """
    bounds = capsule_bounds(check_positive(radius, "radius"), check_not_negative(length, "length"))
    name = f"capsule {radius:g} m, {length:g} m long"
    return NamedShape(name, _translate(bounds, center))


def _translate(bounds: BoundsPair, center: ArrayLike) -> BoundedShape:
    """Move the bounds of a solid of revolution to a center."""
    from cspace._shapes.mesh import Mesh

    shift = check_point(center, dim=3)
    outer, inner = (Mesh.convert((vertices + shift, faces)) for vertices, faces in bounds)
    is_on_axis = not shift[:2].any()
    return BoundedShape(outer, inner, is_round_about_z=is_on_axis)


def footprint(corners: str | ArrayLike, padding: float = 0.0) -> NamedShape:
    """Make a polygon from footprint and padding; metres.

    The polygon grows by the padding along both axes. `corners` may be the text of Nav2, ``"[[0.3,
    0.2], ...]"``.
    """
    from cspace._files.ros_maps import parse_footprint

    points = parse_footprint(corners)
    polygon = Polygons.of(points)
    padding = check_not_negative(padding, "padding")
    if padding:
        polygon = Polygons.of(_grow_by_square(points, padding))
    return NamedShape(f"polygon with {polygon.corners} corners", polygon)


def _grow_by_square(points: Floats, padding: float) -> BaseGeometry:
    """Return a polygon's Minkowski sum with a square.

    The corners of the polygon, ``points``, have shape (n, 2); the square has sides 2 padding. It
    contains all points within `padding` of the polygon, and Nav2's padded polygon. A warning says
    by how much Nav2's is smaller.
    """
    import numpy as np
    import shapely

    # The sum is the polygon together with the area that a square sweeps along its sides.
    square = padding * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    ends = np.stack([points, np.roll(points, -1, axis=0)], axis=1)
    corners = (ends[:, :, np.newaxis] + square).reshape(len(points), 8, 2)
    polygon = shapely.Polygon(points)
    swept = shapely.convex_hull(shapely.multipoints(corners))
    # The union has corners within straight sides, up to rounding.
    # Largest part of a padding, or of a padded footprint's area, that counts as rounding.
    max_neglected_share = 1e-9
    grown = shapely.union_all([polygon, *swept]).simplify(max_neglected_share * padding)
    moved = shapely.make_valid(shapely.Polygon(points + padding * np.sign(points)))
    missing = shapely.difference(grown, moved).area
    if missing > max_neglected_share * grown.area:
        lost = shapely.difference(polygon, moved).area
        warn_user(
            f"padding: {padding:g} m all around the footprint are {missing:.3g} m2 more than Nav2 "
            f"pads, and {lost:.3g} m2 of these lie in the footprint; Nav2 moves each coordinate of "
            "a corner away from zero, which need not cover the robot"
        )
    return grown


# ---- shorthands ---------------------------------------------------------------------------------


class Shorthand(NamedTuple):
    """A kind of shorthand: its name, a colon, and its form.

    Attributes
    ----------
    make : callable
        Function that makes the shape from its sizes and, if it is not at the origin, its center. A
        footprint is made from the text after the colon.
    form : str
        Names of the sizes with the separator between them; each is above zero, in metres.
    dimension : int
        2 in the plane, 3 in space.
    summary : str
        Description for tables of the documentation.
    example : str
        A complete shorthand.
    """

    make: Callable[..., NamedShape]
    form: str
    dimension: int
    summary: str
    example: str


SHORTHANDS: Final[dict[str, Shorthand]] = {
    "disc": Shorthand(disc, "RADIUS", 2, "a disc, by its radius", "disc:0.3"),
    "rect": Shorthand(
        rectangle, "LENGTHxWIDTH", 2, "a rectangle, length along x, then width", "rect:0.9x0.6"
    ),
    "ellipse": Shorthand(
        ellipse, "RADIUS_X,RADIUS_Y", 2, "an ellipse, semi-axes along x and y", "ellipse:0.5,0.3"
    ),
    "footprint": Shorthand(
        footprint,
        "[[X,Y],...]",
        2,
        "a polygon, as Nav2 writes it",
        "footprint:[[0.3,0.2],[-0.3,0.2],[0,-0.2]]",
    ),
    "ball": Shorthand(ball, "RADIUS", 3, "a ball, by its radius", "ball:0.3"),
    "box": Shorthand(
        lambda x, y, z, *center: box((x, y, z), *center),
        "XxYxZ",
        3,
        "a box along the axes",
        "box:0.6x0.6x0.2",
    ),
    "cylinder": Shorthand(cylinder, "RADIUSxHEIGHT", 3, "an upright cylinder", "cylinder:0.3x1.2"),
    "capsule": Shorthand(
        capsule,
        "RADIUSxLENGTH",
        3,
        "the points within RADIUS of an upright segment of LENGTH",
        "capsule:0.3x1.2",
    ),
}
"""Kinds of shorthands by name, the word before the colon."""

SHORTHAND_FORMS: Final = ", ".join(f"{name}:{kind.form}" for name, kind in SHORTHANDS.items())
"""Forms of all shorthands, for messages."""


def is_shorthand(text: str) -> bool:
    """Return True if a text begins with a kind of shorthand."""
    name, colon, _ = text.partition(":")
    return bool(colon) and name in SHORTHANDS


def parse_shorthand(text: str, argument: str = "shape") -> NamedShape:
    """Make the shape of a shorthand, such as ``disc:0.3@0.1,0``.

    Parameters
    ----------
    text : str
        A text for which :func:`is_shorthand` is True.
    argument : str
        The caller's argument, for messages.

    Raises InputError or GeometryError if the text after the colon is malformed.
    """
    # A text is NAME:SIZES or NAME:SIZES@CENTER.
    name, _, rest = text.partition(":")
    if name == "footprint":
        return _parse_footprint(text, rest, argument)
    kind = SHORTHANDS[name]
    separator = "," if "," in kind.form else "x"
    sizes_text, at_sign, center_text = rest.partition("@")
    sizes = parse_finite(sizes_text, separator)
    center = parse_finite(center_text, ",")
    count = len(kind.form.split(separator))
    sizes_are_valid = len(sizes) == count and min(sizes) > 0.0
    if not sizes_are_valid or bool(at_sign) != bool(center):
        rule = (
            f"{kind.form} must follow the colon, each above zero, in metres, and @X,Y or @X,Y,Z "
            "for a center"
        )
        raise InputError(argument, f"is {text!r}", rule)
    return kind.make(*sizes, center) if at_sign else kind.make(*sizes)


def _parse_footprint(text: str, rest: str, argument: str) -> NamedShape:
    """Make a footprint from its corners, or by projecting a shape.

    The shape is given by its shorthand.
    """
    if rest.lstrip().startswith("["):
        return footprint(rest)
    if is_shorthand(rest):
        solid = parse_shorthand(rest, argument)
        return NamedShape(f"footprint of {solid.name}", solid.shape.project_to_plane())
    rule = "corners or a shorthand must follow the colon"
    raise InputError(argument, f"is {text!r}", rule)
