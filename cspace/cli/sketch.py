"""A robot drawn in text, for the terminal."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from cspace.arrays import Floats

if TYPE_CHECKING:
    from cspace.robot import Robot

_COLUMNS, _ROWS = 44, 32
"""Most pixels of a drawing; two of them, one upon the other, are a character."""

_BLOCKS: Final = " ▀▄█"
_PLAIN: Final = " '.#"
"""Characters by which of their two pixels are set, the upper one counting 1; for terminals without blocks."""

_FINE: Final = 8
"""Parts of a pixel, each way, that are drawn."""

_LEAST: Final = 0.1
"""Share of them that makes a pixel one of the robot: thin parts, of which a line is drawn, shall be seen."""

_NEAR: Final = 1.5
"""How many times its size a robot may lie from its reference point for that to be drawn."""


def sketch(robot: Robot) -> str:
    """A robot as lines of text: from above, and in space from the side too; its reference point is a +."""
    blocks = _BLOCKS if _shown(_BLOCKS) else _PLAIN
    views = (_outline,) if robot.dim == 2 else (_from_above, _from_the_side)
    return "\n".join(line for view in views for line in _drawn(*view(robot), blocks))


Rings = Sequence[tuple[Floats, int]]
"""Closed lines, shape (n, 2), metres, each with the value of its inside: 1, or 0 for a hole."""


def _outline(robot: Robot) -> tuple[str, Rings]:
    import shapely

    rings = []
    for part in shapely.get_parts(robot.geometry):
        rings += [(np.asarray(part.exterior.coords), 1), *((np.asarray(hole.coords), 0) for hole in part.interiors)]
    return "from above, x to the right and y up", rings


def _from_above(robot: Robot) -> tuple[str, Rings]:
    vertices, faces = robot.surface
    return "from above, x to the right and y up", [(corners, 1) for corners in vertices[faces][..., :2]]


def _from_the_side(robot: Robot) -> tuple[str, Rings]:
    vertices, faces = robot.surface
    return "from the side, x to the right and z up", [(corners, 1) for corners in vertices[faces][..., ::2]]


def _drawn(caption: str, rings: Rings, blocks: str) -> list[str]:
    """The lines of one view."""
    from PIL import Image, ImageDraw

    points = np.concatenate([ring for ring, _ in rings])
    frame = _Frame(points.min(axis=0), points.max(axis=0))
    image = Image.new("1", (_FINE * frame.shape[0], _FINE * frame.shape[1]))
    draw = ImageDraw.Draw(image)
    for ring, fill in rings:
        draw.polygon((_FINE * (ring - frame.lower) / frame.side - 0.5).ravel().tolist(), fill=fill, outline=1)
    fine = np.asarray(image).reshape(frame.shape[1], _FINE, frame.shape[0], _FINE)
    pixels = fine.mean(axis=(1, 3)) > _LEAST
    rows = [[blocks[code] for code in row] for row in (pixels[1::2] + 2 * pixels[::2]).astype(int).tolist()]
    if frame.origin is not None:
        rows[frame.origin[1] // 2][frame.origin[0]] = "+"
    origin = "+ is the reference point" if frame.origin else "the reference point lies far outside"
    lines = ["  " + "".join(row).rstrip() for row in reversed(rows)]
    return ["", *lines, f"  {caption}; a character is {frame.side:.3g} m wide; {origin}"]


class _Frame:
    """Square pixels over a box, and over the reference point where it lies near."""

    def __init__(self, lower: Floats, upper: Floats) -> None:
        size = float((upper - lower).max())
        near = bool((np.maximum(lower, -upper) <= _NEAR * size).all())
        if near:
            lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
        self.side = float(((upper - lower) / (_COLUMNS, _ROWS)).max())
        counts = np.maximum(np.ceil((upper - lower) / self.side - 1e-6), 1).astype(int)
        self.shape: tuple[int, int] = (int(counts[0]), int(counts[1]) + int(counts[1]) % 2)
        self.lower = (lower + upper) / 2.0 - self.side * np.array(self.shape) / 2.0
        at = np.clip(np.floor(-self.lower / self.side).astype(int), 0, np.subtract(self.shape, 1))
        self.origin: tuple[int, int] | None = (int(at[0]), int(at[1])) if near else None


def _shown(text: str) -> bool:
    """Whether the standard output can show a text."""
    try:
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return False
    return True
