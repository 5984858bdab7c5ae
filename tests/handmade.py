"""Maps of space made by hand, and slow, plain implementations of what is asked of them."""

from fractions import Fraction
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED
from cspace.map import callbacks
from cspace.map.clearance import Distances
from cspace.map.edges import edges_are_free
from cspace.map.exterior import Exterior
from cspace.map.kept import Lock
from cspace.map.mip import Mip
from cspace.map.overlaps import Runs, overlaps
from cspace.map.points import boxes_are_free, classify
from cspace.map.record import Map
from cspace.rotations import cells_for
from oracles import exact, segment_meets_block

EMPTY = np.array([0, 0, 0, -1, -1, -1])


def frame_of(shape, spacing=0.25, lower=(0.0, 0.0, 0.0)):
    return np.array([*lower, spacing, *(low + spacing * n for low, n in zip(lower, shape, strict=True))])


class Outside(NamedTuple):
    """What is known outside the grid: one state, but for a box in which all is MIXED."""

    box: np.ndarray
    state: int


class Lookups:
    """The compiled look-ups of states made by hand, shape (slices, nx, ny) or (slices, nx, ny, nz)."""

    def __init__(self, states, outside, spacing, lower, rotations=None):
        states = np.ascontiguousarray(states, dtype=np.uint8)
        states.setflags(write=False)
        upper = tuple(low + spacing * n for low, n in zip(lower, states.shape[1:], strict=True))
        table = np.array([[*outside.box, outside.state]] * len(states), dtype=np.int64)
        cells, slices = cells_for(rotations), np.arange(len(states))
        self.dof = len(upper) + cells.dof
        self.map = Map(states, states.reshape(-1), cells.compiled(slices), tuple(lower), spacing, upper, table)

    def classify(self):
        return partial(classify, self.map)

    def edges(self, number=0):
        mip = Mip(self.map.states).flat if number else None
        return partial(edges_are_free, self.map, mip)

    def boxes(self, distance, angle):
        return partial(boxes_are_free, self.map, distance, angle)

    def overlaps(self, counts, rasters, beyond):
        return partial(overlaps, self.map, counts, Runs.of(rasters), beyond)

    def clearances(self):
        return Distances(self.map, Exterior(self.map.exterior), Lock()).kernel

    def clearance_checker(self):
        return Distances(self.map, Exterior(self.map.exterior), Lock()).checker(self.dof)

    def point_checker(self):
        return callbacks.point_checker(self.map, self.dof)

    def edge_checker(self):
        return callbacks.edge_checker(self.map, self.dof)


def lookups_of(state, outside=None, spacing=0.25, lower=None):
    """Look-ups of one slice made by hand; beyond the grid all is FREE if nothing else is said."""
    state = np.asarray(state)
    empty = np.repeat([0, -1], state.ndim)
    return Lookups(state[None], outside or Outside(empty, FREE), spacing, lower or (0.0,) * state.ndim)


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
