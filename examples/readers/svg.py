"""Read an SVG drawing, with svgelements.

Strokes and areas are walls, except white and transparent ones. Its y points down. A unit of the
drawing is yours to know: here 1 cm. Text is left out, and embedded pictures are refused.
"""

import math

import numpy as np
import shapely
import svgelements

import cspace
from cspace.errors import FileError


def read_svg(path: str, unit: float = 0.01, spacing: float = 0.1) -> cspace.Workspace:
    """Read walls of a drawing with ``unit`` metres a unit."""
    drawing = svgelements.SVG.parse(path)
    if next(drawing.select(lambda each: isinstance(each, svgelements.Image)), None) is not None:
        raise FileError(path, "holds a picture", "lines and areas are read", "export it as PNG")
    walls = []
    for shape in drawing.elements(lambda each: isinstance(each, svgelements.Shape)):
        rings = []
        for part in abs(svgelements.Path(shape)).as_subpaths():
            curves = [curve.npoint(np.linspace(0, 1, 65)) for curve in svgelements.Path(part)[1:]]
            rings += [np.concatenate(curves)] if curves else []
        strokes = shapely.MultiLineString(rings)
        strokes = strokes.buffer(shape.stroke_width / 2, cap_style="square", join_style="mitre")
        style = shape.values
        if style.get("visibility") in ("hidden", "collapse") or style.get("opacity") == "0":
            continue
        if is_drawn(shape.stroke, style.get("stroke")):
            walls.append(strokes)
        if is_drawn(shape.fill, style.get("fill")):
            walls += fill_rings(rings, style.get("fill-rule") == "evenodd")
    walls = shapely.transform(shapely.union_all(walls), lambda points: points * (unit, -unit))
    # Curves became chords.
    return cspace.Workspace.from_polygons(walls.buffer(0.005), spacing)


def is_drawn(color: svgelements.Color, text: str | None) -> bool:
    """Return True for a colour that is seen on white, and for gradients and patterns."""
    if color.value is None:
        return str(text).startswith("url")
    return color.lightness != 1.0 and color.alpha != 0


def fill_rings(rings: list[np.ndarray], is_even_odd: bool) -> list[shapely.Polygon]:
    """Return the faces that closed curves fill, by the even-odd or the nonzero rule."""
    closed = [np.concatenate([ring, ring[:1]]) for ring in rings]
    lines = shapely.node(shapely.MultiLineString(closed))
    filled = []
    for face in shapely.polygonize([lines]).geoms:
        inside = np.array(face.representative_point().coords[0])
        turns = 0
        for ring in closed:
            angles = np.unwrap(np.arctan2(*(ring - inside).T))
            turns += round((angles[-1] - angles[0]) / math.tau)
        if turns % 2 if is_even_odd else turns:
            filled.append(face)
    return filled


if __name__ == "__main__":
    import sys

    print(read_svg(sys.argv[1]))
