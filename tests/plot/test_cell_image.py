"""Images of cells at any zoom."""

from functools import cache
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from cspace import Grid
from cspace.arrays import reduce_blocks
from cspace.plot.cell_image import CellImage
from tests.pictures import rendered


@given(st.data())
def test_coarse_cells_hold_the_largest_class(data: st.DataObject) -> None:
    shape = data.draw(st.tuples(st.integers(1, 23), st.integers(1, 23)))
    classes = data.draw(arrays(np.uint8, shape, elements=st.integers(0, 4)))
    counts = data.draw(st.tuples(*(st.integers(1, n) for n in shape)))
    starts = [np.array([i * n // m for i in range(m)]) for n, m in zip(shape, counts, strict=True)]
    blocks, smallest = reduce_blocks(classes, starts), reduce_blocks(classes, starts, np.minimum)
    assert blocks.shape == counts
    starts = [[*start, n] for start, n in zip(starts, shape, strict=True)]
    for i, j in np.ndindex(blocks.shape):
        block = classes[starts[0][i] : starts[0][i + 1], starts[1][j] : starts[1][j + 1]]
        assert (blocks[i, j], smallest[i, j]) == (block.max(), block.min())


@cache
def make_axes() -> Any:
    """Return axes without text."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(dpi=100)
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0.033, 0.071, 0.9, 0.87))
    ax.set_axis_off()
    return ax


def draw_cells(classes: NDArray[np.uint8], size: tuple[int, int], view: list[float]) -> tuple[Any, NDArray[np.uint8]]:
    """Draw cells; return the axes and their pixels."""
    ax = make_axes()
    ax.figure.set_size_inches(size[0] / 100, size[1] / 100)
    for image in ax.images:
        image.remove()
    colors = np.array([[255, 255, 255], [0, 0, 0]], np.uint8)
    ax.add_image(CellImage(ax, classes, colors, Grid((-3.0, 7.0), 0.5, classes.shape)))
    ax.set_xlim(view[0], view[1])
    ax.set_ylim(view[2], view[3])
    return ax, rendered(ax)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_no_blocked_cell_vanishes(data: st.DataObject) -> None:
    """Look for a dark pixel near each visible cell."""
    shape = data.draw(st.tuples(st.integers(1, 1200), st.integers(1, 1200)))
    corner = st.tuples(st.integers(0, shape[0] - 1), st.integers(0, shape[1] - 1))
    blocked = data.draw(st.lists(corner, min_size=1, max_size=5))
    size = data.draw(st.tuples(st.integers(30, 400), st.integers(30, 400)))
    a, b = data.draw(corner), data.draw(corner)
    classes = np.zeros(shape, np.uint8)
    classes[tuple(np.transpose(blocked))] = 1
    low, high = np.minimum(a, b), np.maximum(a, b) + 1
    # The view may cut cells at its border, which then may be invisible.
    cut = data.draw(st.sampled_from([0.0, 0.1, 0.9]))
    view = [-3.0 + 0.5 * (low[0] - cut), -3.0 + 0.5 * high[0], 7.0 + 0.5 * low[1], 7.0 + 0.5 * (high[1] + cut)]
    ax, image = draw_cells(classes, size, view)
    dark = (image < 128).all(axis=-1)
    for i, j in blocked:
        if (low <= (i, j)).all() and ((i, j) < high).all():
            corners = ax.transData.transform([(-3.0 + 0.5 * i, 7.0 + 0.5 * j), (-2.5 + 0.5 * i, 7.5 + 0.5 * j)])
            (x0, y0), (x1, y1) = np.floor(corners).astype(int)
            # A block is at most about two pixels wide and at most about a pixel off its position.
            near = dark[max(y0 - 3, 0) : y1 + 4, max(x0 - 3, 0) : x1 + 4]
            assert near.any(), (i, j)
    assert not dark.all() or classes[low[0] : high[0], low[1] : high[1]].any()
