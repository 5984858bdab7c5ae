"""Maps of space made by hand, and slow, plain implementations of what is asked of them."""

from fractions import Fraction
from itertools import product

import numpy as np
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED
from cspace.outside import Outside
from cspace.spatial.lookups import SpatialLookups
from oracles import exact, segment_meets_block

EMPTY = np.array([0, 0, 0, -1, -1, -1])


def frame_of(shape, spacing=0.25, lower=(0.0, 0.0, 0.0)):
    return np.array([*lower, spacing, *(low + spacing * n for low, n in zip(lower, shape, strict=True))])


def lookups_of(state, outside=None, spacing=0.25, lower=(0.0, 0.0, 0.0)):
    """Look-ups of a map made by hand; beyond the grid all is FREE if nothing else is said."""
    state = np.ascontiguousarray(state, dtype=np.uint8)
    state.setflags(write=False)
    return SpatialLookups(state, frame_of(state.shape, spacing, lower), outside or Outside(EMPTY, FREE))


@st.composite
def states(draw, side=5, mixture=(FREE, FREE, FREE, MIXED, BLOCKED)):
    """Arrays of states, shape (nx, ny, nz), flat ones among them."""
    shape = draw(st.tuples(*[st.integers(1, side)] * 3))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return rng.choice(np.array(mixture, dtype=np.uint8), shape)


@st.composite
def outsides(draw):
    """What may be known of cells outside the grid: boxes that hold, meet or miss it, or are empty."""
    first = draw(st.tuples(*[st.integers(-4, 4)] * 3))
    size = draw(st.tuples(*[st.integers(0, 9)] * 3))
    box = np.array([*first, *(low + n - 1 for low, n in zip(first, size, strict=True))])
    return Outside(box, draw(st.sampled_from([FREE, MIXED, BLOCKED])))


def state_of(state, outside, cell):
    """State of a cell ``(i, j, k)``, in the grid or not."""
    if all(0 <= c < n for c, n in zip(cell, state.shape, strict=True)):
        return int(state[cell])
    low, high = outside.box[:3], outside.box[3:]
    return MIXED if all(a <= c <= b for a, c, b in zip(low, cell, high, strict=True)) else outside.state


def cells_around(state, outside):
    """Cells of the grid, of the box, and of a frame of one cell around them."""
    ranges = []
    for n, low, high in zip(state.shape, outside.box[:3].tolist(), outside.box[3:].tolist(), strict=True):
        ranges.append(range(min(low, 0) - 1, max(high + 1, n) + 1))
    return product(*ranges)


def touches(start, end, cell, spacing, lower, slack=0):
    """Whether a closed segment meets a closed cell widened by ``slack`` metres, exactly."""
    h, corner = Fraction(spacing), exact(lower)
    low = [c + h * i - slack for c, i in zip(corner, cell, strict=True)]
    high = [c + h * (i + 1) + slack for c, i in zip(corner, cell, strict=True)]
    return segment_meets_block(exact(start), exact(end), low, high)


def component_of(cells, start, wraps=False):
    """Cells joined to ``start`` through sides, among the True ones, in any number of dimensions."""
    seen, todo = {start}, [start] if cells[start] else []
    while todo:
        here = todo.pop()
        for near in sides_of(here, cells.shape, wraps):
            if near not in seen and cells[near]:
                seen.add(near)
                todo.append(near)
    return seen if cells[start] else set()


def sides_of(cell, shape, wraps=False):
    """The cells of an array that share a side with one; the first axis may wrap."""
    for axis, way in product(range(len(shape)), (-1, 1)):
        near = list(cell)
        near[axis] += way
        if wraps and axis == 0:
            near[0] %= shape[0]
        if 0 <= near[axis] < shape[axis]:
            yield tuple(near)
