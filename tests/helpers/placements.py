"""Configurations of maps: draws, moves, edges, and exact collisions in the plane."""

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from cspace import MIXED
from tests.helpers.gates import certify_chunk
from tests.helpers.handmade import configurations
from tests.helpers.regions import Flat, cell_boxes, place_polygon, rotations_of

ORACLE_BAND = 1e-6
"""Distance from contact, in metres, within which oracles decide nothing."""


def draw_near_mixed(space, rng, n, share=0.5, around=0.5):
    """Draw configurations in and around the grid, a share of them in MIXED cells."""
    dim = space.grid.dim
    q = rng.uniform(
        np.subtract(space.grid.lower, around), np.add(space.grid.upper, around), (n, dim)
    )
    cells = np.argwhere(space._states == MIXED)
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


def move(space, q, steps, turns):
    """Add steps, shape (n, d), and rotate by rotation vectors, shape (n, 3)."""
    dim, moved = space.grid.dim, q.copy()
    moved[:, :dim] += steps
    if space.size == 7:
        moved[:, dim:] = (rotations_of(q, dim) * Rotation.from_rotvec(turns)).as_quat()
    else:
        moved[:, dim:] += turns[:, 2:][:, : space.size - dim]
    return moved


def sample_edges(space, firsts, lasts, shares):
    """Return configurations (n, shares, size) on edges, and rotations (n,) in radians."""
    dim = space.grid.dim
    firsts, lasts = np.array(firsts), np.array(lasts)  # scipy's rotations need writable arrays
    starts, stops = firsts[:, None, :dim], lasts[:, None, :dim]
    positions = starts + shares[:, None] * (stops - starts)
    # Rounding must not move a point out of the edge's bounding box, which may end at the grid.
    positions = np.clip(positions, np.minimum(starts, stops), np.maximum(starts, stops))
    if space.size == 7:
        one, other = rotations_of(firsts, dim), rotations_of(lasts, dim)
        turns = one.inv() * other
        parts = Rotation.from_rotvec((shares[:, None] * turns.as_rotvec()[:, None]).reshape(-1, 3))
        turned = Rotation.from_quat(np.repeat(firsts[:, dim:], len(shares), axis=0)) * parts
        quaternions = turned.as_quat().reshape(*positions.shape[:2], 4)
        return np.concatenate([positions, quaternions], axis=-1), turns.magnitude()
    turn = turn_between(firsts[:, dim:], lasts[:, dim:])
    turned = firsts[:, None, dim:] + shares[:, None] * turn[:, None]
    return np.concatenate([positions, turned], axis=-1), np.abs(turn).max(axis=-1, initial=0.0)


def is_free_around(space, q, distance, angle=0.0):
    """Return whether a gate lets a robot stay at configurations (n, size), with such errors."""
    q = np.asarray(q, dtype=float)
    tracking = [distance] * space.dim + [angle] * bool(space.rotations.names)
    return certify_chunk(space, q, q[:, np.newaxis], tracking).is_proven


def turn_between(first, second):
    """Return the signed angle between yaws along the shorter arc."""
    return (np.asarray(second) - first + np.pi) % (2 * np.pi) - np.pi


def obstacles_of(space):
    """Unite the closed obstacles, and the exterior if it is blocked."""
    grid, box = space.grid, shapely.box(*space.grid.lower, *space.grid.upper)
    parts = Flat.boxes(cell_boxes(space.workspace.outer, grid.lower, grid.spacing)).polygons
    if space.workspace.shapes is not None:
        shapes = (part for shape in space.workspace.shapes for part in shape.geometries)
        parts = [part.intersection(box) for part in shapes]
    if space.outside == "blocked":
        parts = [*parts, box.buffer(100.0) - box]
    shape = shapely.union_all(parts)
    shapely.prepare(shape)
    return shape


def place_robots(robot, q, grow=0.0):
    """Place a disc or polygon, grown by a distance, at configurations."""
    spec = robot.spec
    if spec["kind"] == "balls":
        return shapely.buffer(shapely.points(q[:, :2]), spec["radii"][0] + grow)
    return place_polygon(robot.geometry.buffer(grow, join_style="mitre"), q)


def collides(space, q, obstacles=None, grow=0.0):
    """Test if a disc or polygon, grown by a distance, meets obstacles, by default its map's."""
    others = obstacles_of(space) if obstacles is None else obstacles
    return shapely.intersects(others, place_robots(space.robot, q, grow))
