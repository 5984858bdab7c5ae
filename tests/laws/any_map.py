"""Maps of every space in every storage, with the states that they must have."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import cspace
from cspace import Robot, Rotations, Workspace

CAR = Robot.polygon([(-0.2, -0.1), (0.3, -0.1), (0.3, 0.1), (-0.2, 0.1)])
CRATE = Robot.box((0.3, 0.2, 0.1), (0.1, 0.0, 0.0))
MAP_INPUTS: dict[str, tuple[tuple[int, ...], Robot, Any]] = {
    "plane": ((40, 33), Robot.disc(0.25), None),
    "space": ((12, 14, 13), Robot.ball(0.12), None),
    "yaw": ((30, 27), CAR, 8),
    "yaw in space": ((10, 12, 9), CRATE, 6),
    "quaternions": ((9, 8, 7), CRATE, Rotations.quaternions(1)),
}
"""Shape of the workspace, robot and rotation cells in each space."""

ALL_KINDS = [(space, storage) for storage in ("memory", "tiled", "saved") for space in MAP_INPUTS]
"""Kinds of maps: space and storage."""


class AnyMap(NamedTuple):
    """A map of any kind with its expected states.

    Attributes
    ----------
    space : CSpace or TiledCSpace
    memory : CSpace
        The same map in memory, one byte a cell.
    states : ndarray of uint8, shape (rotations, nx, ny(, nz))
        The state of each cell of ``memory``.
    occupied : ndarray of bool, shape (nx, ny(, nz))
        The obstacle cells.
    rebuild : callable
        Build the map of other obstacles in memory.
    """

    space: Any
    memory: cspace.CSpace
    states: NDArray[np.uint8]
    occupied: NDArray[np.bool_]
    rebuild: Callable[[NDArray[np.bool_]], cspace.CSpace]

    def draw(
        self, rng: np.random.Generator, n: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Draw configurations inside cells, with their cells ``(rotation, x, y(, z))``."""
        grid, centers = self.space.grid, self.space.rotations.centers
        cells = np.column_stack([rng.integers(0, size, n) for size in self.states.shape])
        inside = rng.uniform(0.02, 0.98, (n, grid.dim))
        q = np.array(grid.lower) + grid.spacing * (cells[:, 1:] + inside)
        return (np.hstack([q, centers[cells[:, 0]]]) if centers.size else q), cells


def random_obstacles(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.bool_]:
    return rng.random(shape) < (0.02 if len(shape) == 2 else 0.01)


def reopen(space: Any, path: Path) -> Any:
    """Save a map in memory and open the file."""
    space.save(path)
    return cspace.open(path)


def build_map(
    space: str, storage: str, outside: str, seed: int, folder: Path, thin: bool = False
) -> AnyMap:
    """Build a map of a space in memory, tiled, or saved and opened.

    If ``thin``, the obstacles fill only half of the cells that they touch.
    """
    shape, robot, rotations = MAP_INPUTS[space]
    rng = np.random.default_rng(seed)
    lower = rng.uniform(-1.0, 1.0, len(shape))
    filled = np.random.default_rng(seed).random(shape) < 0.5

    def rebuild(occupied: NDArray[np.bool_], **options: Any) -> Any:
        inner = occupied & filled if thin else None
        workspace = Workspace.from_array(occupied, 0.1, lower, inner=inner)
        return cspace.build(workspace, robot, rotations=rotations, outside=outside, **options)

    occupied = random_obstacles(shape, rng)
    plain = rebuild(occupied)
    states = plain.cell_states.reshape(-1, *shape)
    made: Any = plain
    if storage == "tiled":
        made = rebuild(occupied, store=folder / "tiled.zarr", tile=7)
    elif storage == "saved":
        made = reopen(plain, folder / "saved.zarr")
    return AnyMap(made, plain, states, occupied, rebuild)
