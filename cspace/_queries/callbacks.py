"""Look-ups of one configuration, given by its numbers, without arrays or errors."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numba

from cspace._queries.edges import NO_RADII, position_along, tube_is_free
from cspace._queries.points import cell_of, is_usable, position_in_plane, state_at
from cspace._record.cells import Map
from cspace._rotations.lookup import arc_angle_and_error, rotation_along, rotation_cell
from cspace._support.arrays import FREE, MIXED, Floats, Numbers, Row
from cspace._support.compiling import inlined, kernel

MAX_SIZE: Final = 7
"""Largest length of a configuration, in SE(3)."""

NO_ANSWER: Final = -1
"""Answer of look-ups if a coordinate is not finite, a rotation is invalid, or only arrays serve."""


def bind_kernel(kernel: Any, fixed: tuple[Any, ...], *examples: Any) -> Callable[..., Any]:
    """Compile a kernel, and bind it to its first arguments.

    Calls skip numba's dispatch, so that all other arguments must have the types of ``examples``.
    """
    argument_types = tuple(map(numba.typeof, (*fixed, *examples)))
    kernel.compile(argument_types)
    # Unlike the kernel itself, its machine code for these types compares no types at each call.
    compiled = kernel.get_overload(argument_types)
    return partial(compiled, *fixed)


def bind_numbers(
    kernel: Any, fixed: tuple[Any, ...], given: int, total: int = MAX_SIZE
) -> Callable[..., Any]:
    """Bind a kernel to its arguments before a tuple of numbers.

    Calls give a tuple of the last ``given`` numbers, and zeros precede them. So a kernel is
    compiled once for configurations of all sizes.
    """
    look_up = bind_kernel(kernel, fixed, (0.0,) * total)
    padding = (0.0,) * (total - given)
    return lambda numbers: look_up(padding + numbers)


@inlined
def configuration_before(map_: Map, numbers: Numbers, end: int) -> tuple[Row, Numbers]:
    """Return position and rotation of the configuration that ends before ``end``.

    Its coordinates are the last of ``numbers[:end]``.
    """
    rotation = rotation_before(map_.rotations.borders, numbers, end)
    first = end - len(rotation) - map_.dim
    x = numbers[first]
    y = numbers[first + 1]
    if map_.dim == 2:
        return position_in_plane(map_, x, y), rotation
    return (x, y, numbers[first + 2]), rotation


@inlined
def rotation_before(borders: Floats, numbers: Numbers, end: int) -> Numbers:
    """Return the rotation at the end of ``numbers[:end]``."""
    if borders.ndim == 2:  # a quaternion
        return numbers[end - 4], numbers[end - 3], numbers[end - 2], numbers[end - 1]
    if borders.ndim == 1:
        return (numbers[end - 1],)
    return ()


@inlined
def measure_edge(map_: Map, size: int, numbers: Numbers) -> tuple[float, float]:
    """Return the metres and the radians of a straight edge, for compiled callers.

    The last ``2 * size`` of ``numbers`` are its two configurations.
    """
    end = len(numbers)
    p0, r0 = configuration_before(map_, numbers, end - size)
    p1, r1 = configuration_before(map_, numbers, end)
    metres = math.hypot(p1[0] - p0[0], math.hypot(p1[1] - p0[1], p1[2] - p0[2]))
    radians, _ = arc_angle_and_error(r0, r1, 0)
    return metres, radians


@inlined
def configuration_along(
    map_: Map, size: int, numbers: Numbers, share: float
) -> tuple[Row, Numbers]:
    """Return position and rotation at a share of a straight edge, for compiled callers.

    The last ``2 * size`` of ``numbers`` are its two configurations; ``share`` is from 0 to 1.
    """
    end = len(numbers)
    p0, r0 = configuration_before(map_, numbers, end - size)
    p1, r1 = configuration_before(map_, numbers, end)
    return position_along(p0, p1, share), rotation_along(r0, r1, 0, share)


@kernel
def look_up_state(map_: Map, numbers: Numbers) -> int:
    """Return the state of a configuration, or NO_ANSWER."""
    position, rotation = configuration_before(map_, numbers, MAX_SIZE)
    if not is_usable(position, rotation):
        return NO_ANSWER
    return state_at(map_, position, rotation)


@kernel
def look_up_flat_cell(map_: Map, numbers: Numbers) -> int:
    """Return the flat index of a configuration's cell, or -1.

    Flat indices count the cells of all rotation cells. It is -1 outside the grid.
    """
    position, rotation = configuration_before(map_, numbers, MAX_SIZE)
    i, j, k = cell_of(map_, position)
    _, nx, ny, nz = map_.states.shape
    is_inside = 0 <= i < nx and 0 <= j < ny and 0 <= k < nz
    if not (is_inside and is_usable(position, rotation)):
        return NO_ANSWER
    number = rotation_cell(map_.rotations.borders, rotation)
    return int(((number * nx + i) * ny + j) * nz + k)


@kernel
def look_up_motion(map_: Map, size: int, numbers: Numbers) -> int:
    """Return FREE for a motion through FREE cells, else MIXED or NO_ANSWER.

    It is NO_ANSWER if an end is not usable.
    """
    end = 2 * MAX_SIZE
    p0, r0 = configuration_before(map_, numbers, end - size)
    p1, r1 = configuration_before(map_, numbers, end)
    if not (is_usable(p0, r0) and is_usable(p1, r1)):
        return NO_ANSWER
    return FREE if tube_is_free(map_, p0, r0, p1, r1, NO_RADII, 0.0) else MIXED
