"""Maps of every kind made by hand, and slow, plain answers about the sets of their cells."""

import itertools

import numpy as np

from cspace import BLOCKED, FREE, MIXED, CSpace, Robot, Workspace
from cspace.rotations import Rotations

KINDS = ("plane", "space", "turning", "turning in space")
MIXTURE = (FREE, FREE, MIXED, BLOCKED)


def random_states(rng, kind, most=5, mixture=MIXTURE):
    """States of small maps of a kind, shape (rotations, ...)."""
    most = most if kind == "plane" else max(2, most - 1)
    shape = rng.integers(1, most + 1, 3 if "space" in kind else 2)
    turns = int(rng.integers(1, 6)) if "turning" in kind else 1
    return rng.choice(np.array(mixture, dtype=np.uint8), (turns, *shape))


def made(states, kind, outside="free", spacing=0.25, rotations=None):
    """A map of states, shape (rotations, ...), of a robot that is a point to speak of and shares no slices."""
    dim = states.ndim - 1
    away = np.zeros(dim)
    away[0] = 1e-7 if "turning" in kind else 0.0
    return CSpace(
        Workspace.from_array(np.zeros(states.shape[1:], dtype=bool), spacing),
        Robot.disc(1e-6, away) if dim == 2 else Robot.ball(1e-6, away),
        np.array(states if "turning" in kind else states[0], dtype=np.uint8),
        outside=outside,
        margin=0.0,
        precision="float32",
        rotations=Rotations.of(len(states) if rotations is None else rotations) if "turning" in kind else None,
    )


def all_cells(states):
    """Every cell ``(rotation, ...)``, shape (n, 1 + d)."""
    return np.argwhere(np.ones(states.shape, dtype=bool))


def middles(space, cells):
    """The middle configuration of cells ``(rotation, ...)``."""
    q = space.grid.center_of(cells[:, 1:])
    return q if space.rotations is None else np.column_stack([q, space.rotations.representatives[cells[:, 0]]])


def sides_of(cell, shape):
    """The cells of an array that share a side with one; the first axis, of rotations, wraps."""
    for axis, way in itertools.product(range(len(shape)), (-1, 1)):
        near = list(cell)
        near[axis] += way
        if axis == 0:
            near[0] %= shape[0]
        if 0 <= near[axis] < shape[axis]:
            yield tuple(near)


def component_of(cells, start):
    """Cells joined to ``start`` through sides, among the True ones."""
    seen, todo = {start}, [start] if cells[start] else []
    while todo:
        for near in sides_of(todo.pop(), cells.shape):
            if near not in seen and cells[near]:
                seen.add(near)
                todo.append(near)
    return seen if cells[start] else set()
