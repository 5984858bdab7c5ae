"""Exact collisions of configurations of plane maps, with shapely."""

import numpy as np
import shapely

from cspace import MIXED
from tests.helpers.handmade import configurations
from tests.soak.plane import Shape, surround_grid, unite_cells

ORACLE_BAND = 1e-6
"""Distance from contact, in metres, within which oracles decide nothing."""


def draw_near_mixed(space, rng, n, share=0.5, around=0.5):
    """Draw configurations in and around the grid, a share of them in MIXED cells."""
    dim = space.grid.dim
    q = rng.uniform(
        np.subtract(space.grid.lower, around), np.add(space.grid.upper, around), (n, dim)
    )
    cells = np.argwhere(space._seen == MIXED)
    if len(cells):
        chosen = cells[rng.integers(len(cells), size=int(share * n)), -dim:]
        q[: len(chosen)] = space.grid.lower + space.grid.spacing * (
            chosen + rng.random(chosen.shape)
        )
    return configurations(
        space, np.column_stack([q, rng.uniform(-9.0, 9.0, (n, space.size - dim))])
    )


def draw_configurations(space, rng, n, far=False):
    """Draw configurations in and around the grid, some on boundaries of cells."""
    low, high, dim = np.asarray(space.grid.lower), np.asarray(space.grid.upper), space.grid.dim
    q = rng.uniform(low - 0.3, high + 0.3, (n, dim))
    snapped = low + space.grid.spacing * np.rint((q - low) / space.grid.spacing)
    q = np.where(rng.random((n, dim)) < 0.3, snapped, q)
    q += np.where(rng.random((n, dim)) < 0.1, rng.uniform(-1e-8, 1e-8, (n, dim)), 0.0)
    q = np.where(rng.random((n, dim)) < 0.05, np.where(rng.random((n, dim)) < 0.5, low, high), q)
    if far:
        q[::97] = rng.choice([-1e300, -1e9, 1e9, 1e300], q[::97].shape)
    if not space.rotations.names:
        return q
    if len(space.rotations.names) == 4:
        return np.column_stack([q, draw_quaternions(space.rotations, rng, n)])
    on_border = rng.choice(np.asarray(space.rotations.borders), n) + 2.0 * np.pi * rng.integers(
        -1, 2, n
    )
    near = on_border + rng.choice([0.0, 1e-12, -1e-12, 1e-6, -1e-6], n)
    return np.column_stack([q, np.where(rng.random(n) < 0.4, near, rng.uniform(-9.0, 9.0, n))])


def draw_quaternions(rotations, rng, n):
    """Draw unit quaternions, many on or near boundaries of cells."""
    borders = np.asarray(rotations.borders)
    quotients = rng.choice(borders, (n, 3)) + rng.choice(
        [0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-6, -1e-6], (n, 3)
    )
    quotients = np.where(
        rng.random((n, 3)) < 0.5, quotients, np.tan(rng.uniform(-np.pi / 4, np.pi / 4, (n, 3)))
    )
    q = rng.permuted(np.column_stack([quotients, np.ones(n)]), axis=1)
    q = np.where(rng.random((n, 1)) < 0.3, rng.normal(size=(n, 4)), q) * rng.choice(
        [-1.0, 1.0], (n, 1)
    )
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def obstacles_of(space):
    """Unite the closed obstacles, and the exterior if it is blocked."""
    box = shapely.box(*space.grid.lower, *space.grid.upper)
    if space.workspace.shapes is None:
        parts = [unite_cells(space.workspace.outer, space.grid)]
    else:
        parts = [
            part.intersection(box) for shape in space.workspace.shapes for part in shape.geometries
        ]
    shape = shapely.union_all(
        [*parts, *([surround_grid(space.grid, 100.0)] if space.outside == "blocked" else [])]
    )
    shapely.prepare(shape)
    return shape


def collides(space, q, obstacles=None):
    """Test if a polygonal robot meets obstacles, by default its map's."""
    robot = Shape([space.robot.geometry], np.empty((0, 2)), np.empty(0))
    return robot.meets([obstacles_of(space)] if obstacles is None else obstacles, q, 0.0)
