"""An image of the cells of a grid that shows every class of cell at every zoom.

The module needs matplotlib, so it is imported only for drawing.
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

_MAX_INITIAL_BLOCKS = 1024
"""Maximum number of blocks per axis before the first drawing, which tells the number of pixels."""


class CellImage(AxesImage):
    """Cells of a plane grid, coloured by class.

    If cells are smaller than pixels, the image shows blocks of cells in the colour of their largest class. Each drawing
    chooses the blocks from the view and the pixels of the output, so a large map draws fast and zooming in shows its
    cells. Positions are accurate to two pixels. Add the image with ``ax.add_image``.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    classes : ndarray of uint8, shape (nx, ny)
        Classes of the cells; a larger class is more important to see.
    colors : ndarray of uint8, shape (classes, 3)
        Red, green and blue.
    grid : Grid
    """

    def __init__(self, ax: Axes, classes: NDArray[np.uint8], colors: NDArray[np.uint8], grid: Grid) -> None:
        super().__init__(ax, interpolation="nearest", origin="lower")
        self._classes = classes
        self._colors = colors
        self._grid = grid
        self._shown: list[tuple[int, int, int]] = []
        self._show([(0, n, min(n, _MAX_INITIAL_BLOCKS)) for n in classes.shape], (grid.lower, grid.upper))

    def set_classes(self, classes: NDArray[np.uint8]) -> None:
        """Replace the classes by others of the same shape."""
        self._classes = classes
        self._shown = []
        self.stale = True

    def draw(self, renderer: RendererBase) -> None:
        """Choose the blocks for this output and draw them."""
        # A vector backend draws at 72 dots per inch and magnifies its images.
        magnification = renderer.get_image_magnification()
        spans, lower, upper = [], [], []
        for axis, limits in enumerate((self.axes.get_xlim(), self.axes.get_ylim())):
            pixels = (self.axes.bbox.width, self.axes.bbox.height)[axis] * magnification
            origin, cells, h = self._grid.lower[axis], self._grid.shape[axis], self._grid.spacing
            first = min(max(math.floor((min(limits) - origin) / h), 0), cells - 1)
            stop = min(max(math.ceil((max(limits) - origin) / h), first + 1), cells)
            low, high = origin + h * first, origin + h * stop
            # Pixels covered by the cells in view, less one for each end, which may fall within a pixel.
            covered = (min(high, max(limits)) - max(low, min(limits))) / (max(limits) - min(limits)) * pixels - 2.0
            count = max(1, min(stop - first, math.floor(covered)))
            if count < stop - first:
                # Blocks share the visible extent; otherwise the outermost might be thinner than a pixel.
                low, high = max(low, min(limits)), min(high, max(limits))
            spans.append((first, stop, count))
            lower.append(low)
            upper.append(high)
        self._show(spans, (lower, upper))
        super().draw(renderer)

    def _show(self, spans: list[tuple[int, int, int]], box: tuple[Sequence[float], Sequence[float]]) -> None:
        """Show cells ``first .. stop - 1`` of each axis in ``count`` blocks.

        ``box`` has two corners, metres.
        """
        if self._shown != spans:
            seen = self._classes[tuple(slice(first, stop) for first, stop, _ in spans)]
            # The sides of blocks differ by at most one cell.
            blocks = reduce_blocks(seen, [np.arange(count) * (stop - first) // count for first, stop, count in spans])
            self.set_data(self._colors[blocks.T])
            self._shown = spans
        (x0, y0), (x1, y1) = box
        self.set_extent((x0, x1, y0, y1))
