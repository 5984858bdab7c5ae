"""Certified maps of two or three joints of an arm among obstacles.

In the space of its joints an arm is a point, and its obstacles are the cells that are not FREE. So
the map is a :class:`cspace.CSpace` of a point (:class:`cspace._shapes.OriginPoint`) whose workspace
consists of these cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace import BLOCKED, FREE, MIXED, CSpace, Grid, Robot, Rotations, Workspace
from cspace.arms._arm_space import ArmSpace
from cspace.arms._checks import check_mapping, check_names
from cspace.arms._joint_maps.boxes import CellProofs
from cspace.arms._model import Arm
from cspace.arms._snapshots import Snapshot, find_bodies_between
from cspace.errors import ConfigurationError, InputError
from cspace.inside import (
    FARTHEST_CELL,
    Bools,
    Contents,
    Exterior,
    Floats,
    Ints,
    States,
    check_finite,
    check_known,
    check_memory,
    check_positive,
    count_cores,
    map_in_threads,
    names_options,
    warn_of_large,
    warn_user,
)

_BLOCK_CELLS_PER_AXIS: Final = {2: 64, 3: 32}
"""Cells per axis of the blocks that threads start with, by the number of joints."""


_PARTS_PER_CELL: Final = {2: 4, 3: 1}
"""Parts into which each side of a cell is divided at most, by the number of joints; powers of two.
"""


_COUNT_ROUNDING: Final = 1e-9
"""Rounding error of a number of cells; a range that exceeds a whole number by less gets no cell."""


@names_options
def build_joint_map(
    space: ArmSpace,
    spacing: float,
    joints: Sequence[str] | None = None,
    *,
    held_joints: ArrayLike | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> CSpace:
    """Map all positions of two or three joints.

    Each cell is FREE, BLOCKED or MIXED as a whole.

    Parameters
    ----------
    space : ArmSpace
    spacing : float
        Side of the cells: radians, and metres for prismatic joints.
    joints : sequence of str, optional
        The joints of the map, in the order of its axes; by default all joints of the arm.
    held_joints : array-like, shape (arm.dof,), optional
        A configuration of the arm, at which the other joints are held; required if there are
        others.
    limits : mapping of str to (float, float), optional
        The mapped part of a joint's range. The default is the whole range, for continuous joints
        from -pi to pi.
    workers : int, optional
        Threads; by default one for each core that the process may use.
    progress : callable, optional
        Called with (steps done, total steps).

    Returns
    -------
    CSpace
        Its axes are the joints. Its :attr:`cspace.CSpace.exact` asks the geometry of the arm, and
        obstacle distances are the arm's, in metres, until cells are changed; files do not store the
        arm. All other lengths are in the unit of the joints. The robot is a point, and the
        workspace the cells that are not FREE. All beyond a joint's own limits is BLOCKED. All
        beyond the mapped part of a range is MIXED, so that no path crosses its ends, and paths
        around a continuous joint are not excluded. If the ends are not a whole number of cells
        apart, the last cells exceed the upper end, and are never FREE if that is a limit of the
        joint.

    Raises
    ------
    InputError
        If a joint is unknown, there are not two or three joints, ``held_joints`` is missing, limits
        are missing or exceed the joint's, or the map does not fit into memory.
    ConfigurationError
        If links touch that the joints do not move against each other.

    References
    ----------
    T. Lozano-Perez, "Spatial planning: a configuration space approach", 1983.
    """
    # Check all arguments before any work.
    if not issubclass(type(space), ArmSpace):
        problem = f"is a {type(space).__name__}"
        raise InputError("space", problem, "it must be the space of an arm")
    side = check_positive(spacing, "spacing", "rad")
    snapshot = space.snapshot
    arm = snapshot.arm
    names = _check_joints(arm, joints)
    joint_indices = np.array([arm.joints.index(name) for name in names])
    held = _check_held_joints(arm, joint_indices, held_joints)
    parts = check_mapping({} if limits is None else limits, "limits", names)
    intervals = np.array([_find_range(space, name, parts) for name in names])
    joint_limits = np.column_stack([arm.lower, arm.upper])[joint_indices]
    shape = _count_cells(intervals, joint_limits, side)
    units = tuple(arm.units[number] for number in joint_indices.tolist())
    # Memory per cell, bytes: its state, and whether it meets an obstacle or lies in one.
    needed = 3 * math.prod(shape)
    lowest = intervals[:, 0]
    grid = Grid(lowest, side, shape, axes=names, units=units)
    check_memory(needed, "the map", grid)
    moving = _find_moving_pairs(snapshot, joint_indices)
    still_pairs = np.flatnonzero(~moving.any(axis=1))
    _refuse_held_contact(snapshot, names, held, still_pairs)

    inner = snapshot.inner
    proofs = CellProofs(snapshot, inner, snapshot.inner_balls, grid, joint_indices, held)
    states = _classify_cells(proofs, moving, workers or count_cores(), progress)
    # The last cells along an axis may exceed the joint's limit, beyond which nothing is FREE.
    last_ends = np.array(grid.lower) + side * np.array(shape)
    upper_limits = joint_limits[:, 1]
    for axis in np.flatnonzero(last_ends > upper_limits + _COUNT_ROUNDING * side):
        last_cells = np.moveaxis(states, axis, 0)[-1]
        last_cells[last_cells == FREE] = MIXED
    if not (states == FREE).any():
        warn_user(
            f"no cell of the joint map is FREE: {np.count_nonzero(states == MIXED):,} of "
            f"{states.size:,} cells are MIXED at {side:g} rad"
        )
    # In joint space the arm is a point, and its obstacles are the cells that are not FREE.
    workspace = Workspace(grid, states != FREE, states == BLOCKED, source=repr(space))
    rotations = Rotations.of(None)
    robot = Robot.from_spec({"name": arm.name, "kind": "point", "dim": len(names)})
    one_slice = np.zeros(1, dtype=np.int64)
    exterior = _make_exterior(grid, intervals, joint_limits)
    contents = Contents(
        workspace, robot, rotations, one_slice, states[np.newaxis], exterior=exterior
    )
    return CSpace(contents, proofs=JointProofs(proofs, joint_limits))


def _count_cells(intervals: Floats, joint_limits: Floats, side: float) -> tuple[int, ...]:
    """Return numbers of cells along joints' mapped parts.

    ``intervals``, shape (d, 2), are the mapped parts of the ranges ``joint_limits``.
    """
    lowest, highest = intervals.T
    counts = np.ceil((highest - lowest) / side - _COUNT_ROUNDING)
    # Rounding adds no cell, unless the last one would end before the limit of its joint: beyond the
    # grid, all configurations there count as BLOCKED.
    ends_early = lowest + side * counts < highest
    counts += ends_early & (joint_limits[:, 1] <= highest)
    return tuple(np.maximum(counts, 1.0).astype(np.int64).tolist())


def _check_joints(arm: Arm, joints: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of two or three joints, or raise InputError."""
    names = arm.joints if joints is None else tuple(check_names(joints, "joints"))
    taken = *Rotations.of(1).names, *Rotations.quaternions(1).names
    for name in names:
        check_known(name, "joints", arm.joints, "name")
        has_blanks = name.split() != [name]
        if name in taken or has_blanks:
            raise InputError(
                "joints",
                f"name {name!r}",
                f"axis names have no blanks and differ from {', '.join(taken)}",
            )
    if len(names) not in (2, 3) or len(set(names)) < len(names):
        raise InputError(
            "joints",
            f"are {', '.join(names)}",
            "a map has two or three different joints",
        )
    return names


def _classify_cells(
    proofs: CellProofs, moving: Bools, workers: int, progress: Callable[[int, int], None] | None
) -> States:
    """Compute the states of all cells.

    ``moving``, shape (pairs, joints), says which joints move which pairs. Pairs that the same
    joints move are one layer of cells. Along the other joints, one cell of the layer represents
    all.
    """
    shape = proofs.grid.shape
    layers = list[States]()
    tasks = []
    for layer_joints in np.unique(moving[moving.any(axis=1)], axis=0):
        in_layer = (moving == layer_joints).all(axis=1)
        sides = np.where(layer_joints, shape, 1)
        parts = np.where(layer_joints, _PARTS_PER_CELL[len(shape)], 1)
        layer = np.empty(sides, dtype=np.uint8)
        layers.append(layer)
        classify = partial(proofs.select_pairs(in_layer).classify, parts=parts, out=layer)
        tasks += [partial(classify, *block) for block in _cut_blocks(sides)]
    report = None if progress is None else lambda done: progress(done, len(tasks))
    if report is not None:
        report(0)  # the first cells may wait for compiled code
    map_in_threads(lambda task: task(), tasks, workers, report)
    # A cell is FREE if all pairs are, and BLOCKED if one pair is; the states are in that order.
    states = np.zeros(shape, dtype=np.uint8)
    for layer in layers:
        np.maximum(states, layer, out=states)
    return states


def _cut_blocks(sides: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Yield the first cell and the end, shapes (d,), of the blocks of a grid for threads."""
    length = _BLOCK_CELLS_PER_AXIS[len(sides)]
    for number in np.ndindex(*(-(-sides // length)).tolist()):  # rounded up
        start = length * np.array(number)
        yield start, np.minimum(start + length, sides)


def _check_held_joints(arm: Arm, joint_indices: Ints, held_joints: ArrayLike | None) -> Floats:
    """Return a configuration, shape (dof,), with the values of the held joints.

    Its values of the mapped joints, ``joint_indices``, have no meaning. Raises InputError if held
    joints have no value, and ConfigurationError if one exceeds its limits.
    """
    if held_joints is None:
        held_names = np.delete(arm.joints, joint_indices)
        if len(held_names):
            raise InputError(
                "held_joints",
                "is missing",
                f"the map holds {', '.join(held_names)} still",
            )
        return np.zeros(arm.dof)
    held = arm._check_configurations(held_joints, "held_joints").copy()
    if held.ndim != 1:
        raise InputError(
            "held_joints",
            f"has shape {held.shape}",
            "it must be one configuration of the arm",
        )
    # The mapped joints move, so their values here may not fail the check.
    held[joint_indices] = arm._clamp(held)[joint_indices]
    arm._check_limits(held, "held_joints")
    return held


def _find_range(
    space: ArmSpace, name: str, limits: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    """Return a joint's lowest and highest mapped value.

    They are ``limits``, the limits of the joint, or -pi and pi if it is continuous. Raises
    InputError if a part is not within the limits, or the joint has no range.
    """
    number = space.arm.joints.index(name)
    low, high = float(space.arm.lower[number]), float(space.arm.upper[number])
    if name in limits:
        argument = f"limits[{name!r}]"
        given = check_finite(limits[name], argument)
        if given.shape != (2,) or not low <= given[0] < given[1] <= high:
            raise InputError(
                argument,
                f"are {limits[name]}",
                f"they must be two ascending numbers within {low:.12g} and {high:.12g}",
            )
        if number in space._angles:
            warn_of_large(given, "rad", argument)
        return float(given[0]), float(given[1])
    if low == high:
        raise InputError(
            "joints",
            f"name {name!r}, which stays at {low:g}",
            "a map is of what moves",
        )
    if math.isfinite(low):
        return low, high
    # Without limits, half a turn to both sides is the whole range only if a turn repeats the arm.
    if not space.is_periodic[number]:
        raise InputError(
            "limits",
            f"are missing for {name!r}, which is continuous and moves others by another angle",
            "a turn does not restore the arm",
        )
    return -math.pi, math.pi


def _make_exterior(grid: Grid, intervals: Floats, joint_limits: Floats) -> Exterior:
    """Return states outside: MIXED within the reach of the joints, else BLOCKED.

    ``intervals``, shape (d, 2), are the mapped parts of the joints' ranges ``joint_limits``.
    """
    lowest, highest = intervals.T
    lower_limits, upper_limits = joint_limits.T
    # The box of cells within the limits of the joints; it has no end on the side of a cut range.
    first = np.where(lower_limits < lowest, -FARTHEST_CELL, 0)
    last = np.where(upper_limits > highest, FARTHEST_CELL, np.array(grid.shape) - 1)
    return Exterior(np.array([[*first, *last, BLOCKED]], dtype=np.int64))


def _find_moving_pairs(snapshot: Snapshot, joint_indices: Ints) -> Bools:
    """Find which mapped joints move which pairs of solids, shape (pairs, joints)."""
    chain = snapshot.arm.chain
    between = find_bodies_between(snapshot)
    moved_by_joint = [
        between[:, chain.joint_indices == number].any(axis=1) for number in joint_indices
    ]
    return np.stack(moved_by_joint, axis=1)


def _refuse_held_contact(
    snapshot: Snapshot, names: Sequence[str], held: Floats, still_pairs: Ints
) -> None:
    """Raise ConfigurationError if pairs touch that the mapped joints do not move.

    Otherwise all cells would be BLOCKED. ``still_pairs`` are the numbers of these pairs, ``names``
    the mapped joints, and ``held``, shape (dof,), gives the values of the others.
    """
    scene = snapshot.outer.select_pairs(still_pairs)
    q = held[np.newaxis]
    if not snapshot.are_free(q, q, scene)[0]:
        link, other, *_ = snapshot.contact(scene, q)
        raise ConfigurationError(
            "held_joints",
            f"has {link} touch {other!r}, or come nearer than the margin",
            f"{', '.join(names)} do not move them apart",
        )


@dataclass(frozen=True, eq=False)
class JointProofs:
    """Proofs of a map of an arm's joints among obstacles, by the geometry of the arm.

    A map takes them as the ``proofs`` of :class:`cspace.CSpace`.

    Attributes
    ----------
    cells : CellProofs
    intervals : ndarray of float64, shape (d, 2)
        Limits of each joint; infinite for continuous joints.
    """

    cells: CellProofs
    intervals: Floats

    def extend(self, q: Floats) -> Floats:
        """Extend configurations of the map, (n, d), to the arm's, (n, arm.dof)."""
        rows = np.tile(self.cells.held, (len(q), 1))
        rows[:, self.cells.joint_indices] = q
        return rows

    def name_nearest(self, q: Floats) -> tuple[str, str]:
        """Name the two solids nearest to touching at a configuration of the map."""
        snapshot = self.cells.snapshot
        contact = snapshot.contact(snapshot.outer, self.extend(q[np.newaxis]))
        return contact.link, contact.other

    def edge(self, *endpoints: float) -> bool:
        """Return True if the whole edge is proven free."""
        return bool(self.are_free(*np.array(endpoints).reshape(2, 1, -1))[0])

    def are_free(self, q0: Floats, q1: Floats) -> Bools:
        """Return whether edges, shapes (n, d), are proven free."""
        is_free = np.zeros(len(q0), dtype=np.bool_)
        # Nothing is proven beyond the limits.
        lower, upper = self.intervals.T
        starts_within = (lower <= q0) & (q0 <= upper)
        ends_within = (lower <= q1) & (q1 <= upper)
        is_within = (starts_within & ends_within).all(axis=1)
        starts = self.extend(q0[is_within])
        ends = self.extend(q1[is_within])
        is_free[is_within] = self.cells.snapshot.are_free(starts, ends)
        return is_free

    def slack(self, points: Floats, lengths: Floats, angles: Floats) -> float:
        """Return a lower bound of the distance between solids along a joint path, metres.

        From its midpoint, no joint of a piece moves by more than half of its length.
        """
        snapshot = self.cells.snapshot
        distances, _ = snapshot.distances(self.extend(points))
        motions = np.zeros((len(points), snapshot.arm.dof))
        motions[:, self.cells.joint_indices] = 0.5 * lengths[:, np.newaxis]
        displacements = snapshot.bound_displacements(motions).max(axis=1, initial=0.0)
        return max(0.0, float((distances - displacements).min()))
