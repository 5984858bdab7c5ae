"""Handmade maps in every space, and slow, plain oracles for their cells."""

import itertools
from functools import cache
from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st
from scipy import sparse

from cspace import BLOCKED, FREE, MIXED, CSpace, Robot, Workspace, build
from cspace._record.contents import Contents
from cspace._record.exterior import Exterior
from cspace._rotations import Rotations
from cspace._rotations.quaternion import QuaternionRotations
from tests.helpers.strategies import seeds

MAP_KINDS = ("plane", "space", "turning", "turning in space", "turning in space any way")
MIXTURE = (FREE, FREE, MIXED, BLOCKED)


def build_empty(shape, robot, spacing=0.1, **options):
    """Build the map of a workspace without obstacles."""
    return build(Workspace.from_array(np.zeros(shape, dtype=bool), spacing), robot, **options)


class Outside(NamedTuple):
    """State outside the grid: MIXED in a box ``(first cell, last cell)``, else ``state``."""

    box: np.ndarray
    state: int

    @classmethod
    def all_of(cls, state, dim=3):
        return cls(np.repeat([0, -1], dim), state)

    def project(self, dim):
        """Return the exterior of the first ``dim`` axes."""
        return Outside(self.box.reshape(2, -1)[:, :dim].ravel(), self.state)


ALL_FREE = Outside.all_of(FREE)


@cache
def point_robot(dim, turning, spacing):
    """Return a nearly pointlike robot and its rasters at any rotation."""
    away = np.full(dim, 1e-7 if turning else 0.0)
    robot = Robot.disc(1e-6, away) if dim == 2 else Robot.ball(1e-6, away)
    return robot, robot.shape.rasters(spacing, 0.0)


def map_of(
    state, rotations=None, outside="free", spacing=0.25, lower=None, rasters=None, occupied=None
):
    """Build a map of given states for a nearly pointlike robot.

    No slices are shared. ``outside`` is a policy, or an :class:`Outside` that need not belong to a
    robot.
    """
    state = np.asarray(state, dtype=np.uint8)
    dim = state.ndim - (rotations is not None)
    occupied = np.zeros(state.shape[-dim:], dtype=bool) if occupied is None else occupied
    workspace = Workspace.from_array(occupied, spacing, lower)
    robot, pair = point_robot(dim, rotations is not None, spacing)
    policy = outside if isinstance(outside, str) else "free"
    cells = Rotations.of(rotations)
    states = state.reshape(len(cells), *state.shape[-dim:]).copy()
    given = (
        None
        if policy is outside
        else np.array([[*outside.box, outside.state]] * len(cells), dtype=np.int64)
    )
    exterior = None if given is None else Exterior(given)
    slices = np.arange(len(cells))
    made = Contents(workspace, robot, cells, slices, states, outside=policy, exterior=exterior)
    return CSpace(made, [pair] * len(cells) if rasters is None else rasters)


def map_in(workspace, robot, states, rotations=None, **options):
    """Build a map of states, shape (slices, ...) or (...)."""
    cells = Rotations.of(rotations)
    states = states[None] if states.ndim == workspace.grid.dim else states
    return CSpace(
        Contents(workspace, robot, cells, cells._assign_slices(robot.shape), states, **options)
    )


def make_map(states, kind, outside="free", spacing=0.25, rotations=None, lower=None):
    """Build a map of a kind from states, shape (rotations, ...)."""
    if "turning" not in kind:
        return map_of(states[0], None, outside, spacing, lower)
    if "any way" in kind:
        return map_of(
            states, Rotations.quaternions(cells_per_axis(len(states))), outside, spacing, lower
        )
    return map_of(states, len(states) if rotations is None else rotations, outside, spacing, lower)


def full_states(kind, side, state=FREE):
    """Return equal states of a small map of a kind, shape (rotations, ...)."""
    return np.full(
        (4 if "turning" in kind else 1, *(side,) * (3 if "space" in kind else 2)),
        state,
        dtype=np.uint8,
    )


def cells_per_axis(turns):
    """Return the cells along an axis of ``turns`` quaternion cells."""
    return round((turns / 4) ** (1 / 3))


def random_states(rng, kind, max_side=5, mixture=MIXTURE):
    """Draw states of a small map of a kind, shape (rotations, ...)."""
    max_side = max_side if kind == "plane" else max(2, max_side - 1)
    turns = (
        int(rng.choice([4, 32]) if "any way" in kind else rng.integers(1, 6))
        if "turning" in kind
        else 1
    )
    shape = rng.integers(1, min(max_side, 96 // turns) + 1, 3 if "space" in kind else 2)
    return rng.choice(np.array(mixture, dtype=np.uint8), (turns, *shape))


def free_except(*cells, side=4, dim=3):
    """Return states that are FREE, except for MIXED ``cells``."""
    state = np.zeros((side,) * dim, dtype=np.uint8)
    for cell in cells:
        state[cell] = MIXED
    return state


def fill_boxes(shape, *boxes, but=()):
    """Return obstacle cells, True in ``boxes`` except in ``but``."""
    cells = np.zeros(shape, dtype=bool)
    for box in boxes:
        cells[box] = True
    for gap in but:
        cells[gap] = False
    return cells


@st.composite
def states(draw, side=5, mixture=(FREE, FREE, FREE, MIXED, BLOCKED), dims=(2, 3)):
    """Draw arrays of states, shape (nx, ny) or (nx, ny, nz)."""
    shape = draw(st.tuples(*[st.integers(1, side)] * draw(st.sampled_from(dims))))
    return np.random.default_rng(draw(seeds)).choice(np.array(mixture, dtype=np.uint8), shape)


@st.composite
def outsides(draw, dim=3):
    """Draw exteriors with boxes at any position, also empty boxes."""
    first = draw(st.tuples(*[st.integers(-4, 4)] * dim))
    size = draw(st.tuples(*[st.integers(0, 9)] * dim))
    box = np.array([*first, *(low + n - 1 for low, n in zip(first, size, strict=True))])
    return Outside(box, draw(st.sampled_from([FREE, MIXED, BLOCKED])))


def state_of(state, outside, cell):
    """Return the state of a cell, inside the grid or outside."""
    if all(0 <= c < n for c, n in zip(cell, state.shape, strict=True)):
        return int(state[cell])
    ends, dim = outside.box.tolist(), len(cell)
    return (
        MIXED
        if all(a <= c <= b for a, c, b in zip(ends[:dim], cell, ends[dim:], strict=True))
        else outside.state
    )


def cells_around(state, outside):
    """Yield the cells of grid, box and a frame around both."""
    low, high = np.split(outside.box, 2)
    sides = zip(state.shape, low.tolist(), high.tolist(), strict=True)
    return itertools.product(*(range(min(a, 0) - 1, max(b + 1, n) + 1) for n, a, b in sides))


def all_cells(states):
    """Return every cell ``(rotation, ...)``, shape (n, 1 + d)."""
    return np.argwhere(np.ones(states.shape, dtype=bool))


def cell_centers(space, cells):
    """Return the center configurations of cells ``(rotation, ...)``."""
    q = space.grid.center_of(cells[:, 1:])
    return (
        q
        if not space.rotations.names
        else np.column_stack([q, space.rotations.centers[cells[:, 0]]])
    )


def configurations(space, q):
    """Normalise the quaternions of configurations in place."""
    if len(space.rotations.names) == 4:
        q[..., 3:] /= np.linalg.norm(q[..., 3:], axis=-1, keepdims=True)
    return q


@cache
def rotation_neighbors(turns, kind):
    """Return the neighbours of each rotation cell, by small steps."""
    if "any way" not in kind:
        return [{(cell - 1) % turns, (cell + 1) % turns} for cell in range(turns)]
    n, near = cells_per_axis(turns), []
    cells = QuaternionRotations(n)
    for chart, *parts in np.ndindex(4, n, n, n):
        low, high = (cells.borders[np.add(parts, above)] for above in (0, 1))
        quotients = np.tile(low + 0.3 * (high - low), (6, 1))
        quotients[range(6), [0, 1, 2] * 2] = [*(low - 1e-6), *(high + 1e-6)]
        q = np.insert(quotients, chart, 1.0, axis=1)
        near.append(set(cells.cell_of(q / np.linalg.norm(q, axis=1, keepdims=True)).tolist()))
    return near


def half_turns(shape):
    """Return the axes about which half turns are symmetries."""
    turns = (2.0 * np.outer(axis, axis) - np.eye(3) for axis in np.eye(3))
    return tuple(
        k for k, turn in enumerate(turns) if any((turn == each).all() for each in shape.symmetries)
    )


def components(cells, kind=""):
    """Label the components of True cells (rotations, ...); others get -1.

    Cells are connected through sides.
    """
    number = np.arange(cells.size).reshape(cells.shape)
    turns = np.array(
        [
            (turn, near)
            for turn, row in enumerate(rotation_neighbors(len(cells), kind))
            for near in row
        ]
    )
    links = [number[turns.T].reshape(2, -1)]
    for axis in range(1, cells.ndim):
        long = np.moveaxis(number, axis, 0)
        links.append(np.stack([long[:-1].ravel(), long[1:].ravel()]))
    a, b = np.concatenate(links, axis=1)
    both = cells.ravel()[a] & cells.ravel()[b]
    graph = sparse.coo_array((both[both], (a[both], b[both])), shape=(cells.size, cells.size))
    return np.where(
        cells,
        sparse.csgraph.connected_components(graph, directed=False)[1].reshape(cells.shape),
        -1,
    )
