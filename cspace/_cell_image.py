"""An image of a grid's cells that stays true at every zoom: no class of cell is lost between two pixels.

Imported only when something is drawn, since it needs matplotlib.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import allow_rasterization
from matplotlib.image import AxesImage

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import RendererBase
    from numpy.typing import NDArray

    from cspace.grid import Grid

_FIRST = 1024
"""Largest number of blocks along an axis before the first drawing tells how many pixels there are."""


def coarsen(classes: NDArray[np.uint8], steps: tuple[int, int]) -> NDArray[np.uint8]:
    """The largest class in each block of cells.

    Parameters
    ----------
    classes : ndarray of uint8, shape (nx, ny)
    steps : tuple of int, length 2
        Cells of a block along x and y; the last blocks may hold fewer.

    Returns
    -------
    ndarray of uint8, shape (ceil(nx / steps[0]), ceil(ny / steps[1]))
    """
    for axis, step in enumerate(steps):
        if step > 1:
            head = classes.shape[axis] // step * step
            whole, rest = np.split(classes, [head], axis=axis)
            shape = (*whole.shape[:axis], head // step, step, *whole.shape[axis + 1 :])
            parts = [whole.reshape(shape).max(axis=axis + 1)]
            if rest.shape[axis]:
                parts.append(rest.max(axis=axis, keepdims=True))
            classes = np.concatenate(parts, axis=axis)
    return classes


class CellImage(AxesImage):
    """Cells of a planar grid, coloured by class; where cells are smaller than pixels, the largest class wins.

    The blocks are chosen afresh at every drawing from the view and the pixels of the output, so a large map draws
    fast, and zooming in shows its cells.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The axes to draw in; add the image with ``ax.add_image``.
    classes : ndarray of uint8, shape (nx, ny)
        Class of each cell; the larger, the more important to see.
    colors : ndarray of uint8, shape (classes, 3)
        Red, green and blue of each class.
    grid : Grid
        Where the cells lie.
    """

    def __init__(self, ax: Axes, classes: NDArray[np.uint8], colors: NDArray[np.uint8], grid: Grid) -> None:
        super().__init__(ax, interpolation="nearest", origin="lower")
        self._classes = classes
        self._colors = colors
        self._grid = grid
        self._shown: tuple[Any, ...] = ()
        nx, ny = classes.shape
        self._show((0, nx), (0, ny), (math.ceil(nx / _FIRST), math.ceil(ny / _FIRST)))

    @allow_rasterization
    def draw(self, renderer: RendererBase) -> None:
        """Choose the blocks for this output, then draw them."""
        # A vector backend draws at 72 dots per inch and magnifies its images.
        magnification = renderer.get_image_magnification()
        spans, steps = [], []
        for axis, (low, high) in enumerate((self.axes.get_xlim(), self.axes.get_ylim())):
            low, high = min(low, high), max(low, high)
            pixels = (self.axes.bbox.width, self.axes.bbox.height)[axis] * magnification
            step = max(1, math.ceil((high - low) / self._grid.spacing / max(pixels - 2.0, 1.0)))
            count = self._grid.shape[axis]
            first = math.floor((low - self._grid.lower[axis]) / self._grid.spacing)
            last = math.ceil((high - self._grid.lower[axis]) / self._grid.spacing)
            # Whole blocks, counted from cell 0, so that they stand still while the view moves.
            first = min(max(first, 0), count - 1) // step * step
            last = min(max(-(-last // step) * step, first + 1), count)
            spans.append((first, last))
            steps.append(step)
        self._show(spans[0], spans[1], (steps[0], steps[1]))
        super().draw(renderer)

    def _show(self, x: tuple[int, int], y: tuple[int, int], steps: tuple[int, int]) -> None:
        """Show cells ``x[0] .. x[1] - 1`` by ``y[0] .. y[1] - 1`` in blocks of ``steps``."""
        if self._shown == (x, y, steps):
            return
        self._shown = (x, y, steps)
        blocks = coarsen(self._classes[x[0] : x[1], y[0] : y[1]], steps)
        self.set_data(self._colors[blocks.T])
        (left, bottom), h = self._grid.lower, self._grid.spacing
        first = (left + h * x[0], bottom + h * y[0])
        self.set_extent(
            (
                first[0],
                first[0] + h * steps[0] * blocks.shape[0],
                first[1],
                first[1] + h * steps[1] * blocks.shape[1],
            )
        )
