"""No rotation at all: a robot that only translates has one rotation cell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Floats, Ints, Matrix, Numbers
from cspace.compiling import compilable
from cspace.rotations.base import STILL, Rotations, Symmetric, Turn


@dataclass(frozen=True, repr=False)
class OneRotation(Rotations):
    """The one cell of a robot that only translates."""

    slack: ClassVar[float] = 0.0

    @classmethod
    def of_value(cls, value: ArrayLike | None = None) -> OneRotation:
        return cls()

    @classmethod
    def of_coordinates(cls, coordinates: Mapping[str, NDArray[Any]]) -> OneRotation:
        return cls()

    def text(self, rotation: Floats) -> str:
        return ""

    def of_matrix(self, matrix: Floats) -> Floats:
        return np.empty(0)

    def sample_near(self, rotation: Sequence[float], angle: float, numbers: Iterator[float]) -> Sequence[float]:
        return rotation

    def _canonical(self, rotation: Floats, name: str) -> Floats:
        return rotation

    def _between(self, first: Floats, second: Floats) -> Floats:
        return second - first

    def _turned(self, rotation: Floats, by: Floats) -> Floats:
        return rotation

    def _matrices(self, rotation: Floats, dim: int) -> Floats:
        return np.broadcast_to(np.eye(dim), (*rotation.shape[:-1], dim, dim))

    @property
    def count(self) -> int:
        return 1

    @property
    def facts(self) -> dict[str, object]:
        return {}

    @property
    def fixed(self) -> Floats:
        return np.empty(0)

    def describe(self, rotation: Floats | None) -> str:
        return ""

    def cell_of(self, rotation: ArrayLike = ()) -> Ints:
        return np.zeros((), dtype=np.int64)

    def cells_of(self, q: Floats) -> Ints:
        return np.zeros(q.shape[:-1], dtype=np.int64)

    def leading(self, n: int) -> tuple[int, ...]:
        return ()

    def preserve(self, shape: Symmetric) -> bool:
        return True

    def fewer(self, share: float) -> str:
        return ""

    def slices_for(self, shape: Symmetric) -> Ints:
        return np.zeros(1, dtype=np.int64)

    def turns(self, dim: int) -> list[Turn]:
        return [STILL]

    @property
    def centers(self) -> Floats:
        return np.zeros((1, 0))

    @property
    def covering_angles(self) -> Floats:
        return np.zeros(1)

    @property
    def coordinates(self) -> dict[str, Floats]:
        return {}

    @property
    def volumes(self) -> Floats:
        return np.ones(1)

    def draw_cells(self, shares: Ints, n: int, rng: np.random.Generator) -> Ints:
        """Cell 0, without a draw."""
        return np.zeros(n, dtype=np.int64)

    def sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        return np.zeros((len(cells), 0))

    def distances(self, q: Floats) -> Floats:
        return np.zeros((*q.shape[:-1], 1))

    @property
    def neighbors(self) -> Ints:
        return np.zeros((1, 0), dtype=np.int64)

    def compiled(self, slice_of: Ints) -> OneCell:
        return OneCell((0,))


@compilable
class OneCell(NamedTuple):
    """What compiled look-ups get of a robot that only translates."""

    slice_of: tuple[int]

    def zeros(self) -> tuple[()]:
        return ()

    def is_usable(self, q: Numbers) -> bool:
        return np.bool_(True)  # type: ignore[return-value]  # of one type for the compiler from the start

    def slice_at(self, q: Numbers) -> int:
        return 0

    def slices_at(self, numbers: Floats, dof: int, out: Ints) -> None:
        pass

    def slice_among(self, slices: Ints, k: int) -> int:
        return 0

    def first_piece(self, q0: Numbers, q1: Numbers) -> bool:
        return np.bool_(True)  # type: ignore[return-value]  # of one type for the compiler from the start

    def next_piece(self, cursor: bool) -> tuple[bool, int, float, float, bool]:
        return cursor, 0, 0.0, 1.0, False

    def first_around(self, q: Numbers, angle: float) -> bool:
        return True

    def next_around(self, cursor: bool) -> tuple[bool, int, bool]:
        return cursor, 0, False

    def arc_count(self, q0: Numbers, q1: Numbers) -> int:
        return 1

    def turn_of(self, q0: Numbers, q1: Numbers, arc: int) -> tuple[float, float]:
        return 0.0, 0.0

    def turned(self, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
        return q0

    def matrix_of(self, q: Numbers) -> Matrix:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
