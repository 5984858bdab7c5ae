"""An image of a grid's cells that stays true at every zoom: no class of cell is lost between two pixels.

Imported only when something is drawn, since it needs matplotlib.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.image import AxesImage

from cspace.arrays import reduce_blocks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import RendererBase
    from numpy.typing import NDArray

    from cspace.grid import Grid

_FIRST = 1024
"""Largest number of blocks along an axis before the first drawing tells how many pixels there are."""


class CellImage(AxesImage):
    """Cells of a planar grid, coloured by class; where cells are smaller than pixels, the largest class wins.

    The blocks are chosen afresh at every drawing from the view and the pixels of the output, so a large map draws
    fast, and zooming in shows its cells. Nothing is drawn further than a pixel or two from its place.

    The larger the class of a cell, shape (nx, ny), the more important it is to see. Of each class there are red, green
    and blue, shape (classes, 3). Add the image with ``ax.add_image``.
    """

    def __init__(self, ax: Axes, classes: NDArray[np.uint8], colors: NDArray[np.uint8], grid: Grid) -> None:
        super().__init__(ax, interpolation="nearest", origin="lower")
        self._classes = classes
        self._colors = colors
        self._grid = grid
        self._shown: list[tuple[int, int, int]] = []
        self._show([(0, n, min(n, _FIRST)) for n in classes.shape], (grid.lower, grid.upper))

    def set_classes(self, classes: NDArray[np.uint8]) -> None:
        """Show other classes, of the same shape, from the next drawing on."""
        self._classes = classes
        self._shown = []
        self.stale = True

    def draw(self, renderer: RendererBase) -> None:
        """Choose the blocks for this output, then draw them."""
        # A vector backend draws at 72 dots per inch and magnifies its images.
        magnification = renderer.get_image_magnification()
        spans, lower, upper = [], [], []
        for axis, limits in enumerate((self.axes.get_xlim(), self.axes.get_ylim())):
            pixels = (self.axes.bbox.width, self.axes.bbox.height)[axis] * magnification
            origin, cells, h = self._grid.lower[axis], self._grid.shape[axis], self._grid.spacing
            first = min(max(math.floor((min(limits) - origin) / h), 0), cells - 1)
            stop = min(max(math.ceil((max(limits) - origin) / h), first + 1), cells)
            low, high = origin + h * first, origin + h * stop
            # Pixels that the cells in view cover, less one for each end that falls within a pixel.
            covered = (min(high, max(limits)) - max(low, min(limits))) / (max(limits) - min(limits)) * pixels - 2.0
            count = max(1, min(stop - first, math.floor(covered)))
            if count < stop - first:
                # Blocks share what is in view, or the outermost might show less than a pixel of itself.
                low, high = max(low, min(limits)), min(high, max(limits))
            spans.append((first, stop, count))
            lower.append(low)
            upper.append(high)
        self._show(spans, (lower, upper))
        super().draw(renderer)

    def _show(self, spans: list[tuple[int, int, int]], box: tuple[Sequence[float], Sequence[float]]) -> None:
        """Show, along each axis, cells ``first .. stop - 1`` in ``count`` blocks between two corners in metres."""
        if self._shown != spans:
            seen = self._classes[tuple(slice(first, stop) for first, stop, _ in spans)]
            # Sides of blocks differ by at most one cell.
            blocks = reduce_blocks(seen, [np.arange(count) * (stop - first) // count for first, stop, count in spans])
            self.set_data(self._colors[blocks.T])
            self._shown = spans
        (x0, y0), (x1, y1) = box
        self.set_extent((x0, x1, y0, y1))
