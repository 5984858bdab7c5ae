"""Periodic axes of a map: angles of continuous joints.

A map holds the cells of one period. Queries see them *unrolled*, with half a period more at either end. A
configuration is first wrapped into the center period, and an edge takes the shorter arc from there, so it touches no
seam. Components of one period are joined across the seams.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import compress, product
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Floats, Ints
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.limits import check_memory
from cspace.map.batches import Kernel
from cspace.rotations import OneRotation
from cspace.rotations.base import MAX_JOINT_ANGLE, TWO_PI, shorter, wrapped
from cspace.workspace import Workspace

Result = TypeVar("Result")

BYTES_PER_UNROLLED_CELL: Final = 3
"""Bytes per unrolled cell: its state, and its outer and inner obstacle bits."""

_quiet: Final = np.errstate(invalid="ignore")
"""Silences warnings about non-finite numbers, which kernels refuse later."""


@dataclass(frozen=True, slots=True)
class Periodic(OneRotation):
    """Periodic axes of a map without rotations.

    Attributes
    ----------
    axes : tuple of bool
        True for each coordinate that is the angle of a continuous joint.
    counts : tuple of int
        Cells of the map along each axis; along a periodic axis they make one period.
    """

    axes: tuple[bool, ...] = ()
    counts: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        """Return True if any axis is periodic."""
        return any(self.axes)

    # ---- configurations ----------------------------------------------------------------------------------------------

    @_quiet
    def _make_canonical(self, q: Floats, name: str = "q") -> Floats:
        """Return configurations with angles in [-pi, pi).

        Raises
        ------
        InputError
            If an angle is too large to be wrapped.
        """
        far = (np.abs(q) > MAX_JOINT_ANGLE) & self.axes
        if far.any():
            problem, rule = f"has an angle of {q[far][0]:g} rad", f"at most {MAX_JOINT_ANGLE:.0f} are wrapped exactly"
            raise InputError(name, problem, rule, "leave out whole turns", value=float(q[far][0]))
        return wrapped(q, self.axes)

    def _steps_between(self, q0: Floats, q1: Floats) -> Floats:
        """Return steps between configurations, along shorter arcs.

        Half a turn keeps its sign.
        """
        return shorter(q1 - q0, self.axes)

    def wrap_rows(self, kernel: Kernel) -> Kernel:
        """Wrap a kernel to get wrapped angles."""

        @_quiet
        def run_wrapped(given: Floats, *others_and_out: NDArray[Any]) -> int:
            *others, out = others_and_out
            first, *lasts = map(self._make_canonical, (given, *others))
            ends = (
                np.where(self.axes, first + self._steps_between(given, q), last)
                for q, last in zip(others, lasts, strict=True)
            )
            return kernel(first, *ends, out)

        return run_wrapped

    def begin_at(self, path: Floats, q0: Floats) -> Floats:
        """Shift a path by whole turns to a start."""
        return path + (q0 - path[:1] - self._steps_between(path[:1], q0))

    def names_among(self, axes: Sequence[str]) -> list[str]:
        """Return the names of the periodic axes."""
        return list(compress(axes, self.axes))

    # ---- cells -------------------------------------------------------------------------------------------------------

    @property
    def padding(self) -> Ints:
        """Cells unrolled at each end of each axis.

        They are half a period, and two more for edges.
        """
        return np.where(self.axes, np.array(self.counts) // 2 + 2, 0)

    @property
    def center_period(self) -> tuple[slice, ...]:
        """Cells of the center period within an unrolled array."""
        return tuple(slice(pad, pad + n) for pad, n in zip(self.padding.tolist(), self.counts, strict=True))

    def cells_in_turn(self, unrolled: Grid, q: Floats) -> Ints:
        """Return cells of configurations, rounded like in queries."""
        cells = unrolled.cell_of(self._make_canonical(q)) - self.padding
        return np.where(self.axes, cells % self.counts, cells)

    def unroll(
        self, workspace: Workspace, states: NDArray[np.uint8], first: Ints, stop: Ints
    ) -> tuple[Workspace, NDArray[np.uint8]]:
        """Unroll workspace and states over cells [first, stop).

        Raises InputError if they do not fit into memory.
        """
        whole = workspace.grid
        lower, shape = np.asarray(whole.lower) + whole.spacing * first, (stop - first).tolist()
        grid = Grid(lower, whole.spacing, shape, whole.axes, whole.units)
        check_memory(BYTES_PER_UNROLLED_CELL * grid.size, "the map, unrolled,", grid)

        def unroll_array(cells: NDArray[Any]) -> NDArray[Any]:
            for axis in np.flatnonzero(self.axes).tolist():
                cells = cells.take(np.arange(first[axis], stop[axis]) % whole.shape[axis], axis=axis)
            return cells

        outer = unroll_array(workspace.outer)
        inner = outer if workspace.inner is workspace.outer else unroll_array(workspace.inner)
        return Workspace(grid, outer, inner, workspace.source), unroll_array(states)

    def appearances(self, low: Ints, high: Ints) -> Iterator[tuple[Ints, tuple[slice, ...]]]:
        """Yield the positions of a box in the unrolled map.

        Each is the first unrolled cell, and the part of the map that appears there.
        """
        counts, padding = np.array(self.counts), self.padding
        if (low > high).any():
            return
        max_periods = -(-padding // counts)
        for periods in product(*(range(-n, n + 1) for n in max_periods.tolist())):
            shift = padding + counts * periods
            first, stop = np.maximum(low + shift, 0), np.minimum(high + 1 + shift, counts + 2 * padding)
            if (first < stop).all():
                yield first, tuple(map(slice, first - shift, stop - shift))


NOT_PERIODIC: Final = Periodic()
"""Stands for a map without periodic axes."""


def with_wrapped_angles(check: Callable[..., Result], periodic_axes: Sequence[bool]) -> Callable[..., Result]:
    """Wrap a function to get angles in [-pi, pi).

    The function takes floats. Angles of the second configuration are within half a turn of the first. Angles that
    look-ups refuse become NaN, where no configuration is free.
    """
    periodic, size = [k for k, turns in enumerate(periodic_axes) if turns], len(periodic_axes)
    if not periodic:
        return check

    # Local names are faster than global ones.
    limit, period, half, remainder = MAX_JOINT_ANGLE, TWO_PI, math.pi, math.remainder

    def wrapped(*numbers: float) -> Result:
        near = list(numbers)
        for k in periodic:
            first = numbers[k] if -limit <= numbers[k] <= limit else math.nan
            here = remainder(first, period)
            near[k] = here = here if here != half else -half
            if len(near) > size:
                angle = numbers[size + k]
                near[size + k] = here + remainder(angle - first, period) if -limit <= angle <= limit else math.nan
        return check(*near)

    return wrapped


def below_half_a_turn(check: Callable[..., bool], periodic_axes: Sequence[bool]) -> Callable[..., bool]:
    """Wrap a check to fail for half turns or more.

    The check takes the shorter arc, which is then another motion.
    """
    periodic, size = [k for k, turns in enumerate(periodic_axes) if turns], len(periodic_axes)
    if not periodic:
        return check
    return lambda *both: all(abs(both[size + k] - both[k]) < 0.499 * TWO_PI for k in periodic) and check(*both)
