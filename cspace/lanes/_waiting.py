"""When a robot drives its path, so that it stays apart from others on timed motions.

The path and the time make up a rectangle, in which a motion along the path is a rising curve (K.
Kant and S. W. Zucker, "Toward efficient trajectory planning: the path-velocity decomposition",
1986). A cell is a piece of the path in a window of time. In its middle, shapes are placed; nothing
moves farther from there than its speed allows. So a cell is FREE if the robots are apart all over
it, BLOCKED if they are too near all over it, and MIXED otherwise. Cells that may be MIXED are
halved.

- A motion through FREE cells is proven by :func:`cspace.lanes.apart`, as any other motion.
- A robot that changes its speed at once drives through cells that are not BLOCKED, as early as
  possible in each window. It bounds the arrival of all motions; if it does not arrive, none does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.inside import (
    Cores,
    Floats,
    check_not_negative,
    names_options,
    tell_apart,
)
from cspace.lanes._apart import (
    ApartSearch,
    Measure,
    Mover,
    Timed,
    check_pair,
    find_duration,
    make_measure,
    read_mover,
)

if TYPE_CHECKING:
    from planners import Trajectory
    from planners.inside import PathPieces

FREE, MIXED = -1, -2
"""States of cells. The state of a BLOCKED cell is the number of the mover that blocks it."""

CELL_SIZES: Final = 0.1, 0.05, 0.025
"""Largest distances, metres, that a point of the robot moves in a piece of the path; the next one
is tried unless the arrival is within :data:`CLOSE` of its lower bound."""

CLOSE: Final = 0.1
"""Seconds by which an arrival may exceed its lower bound before smaller cells are tried."""

TIME_SHARE: Final = 1.0 - 1e-9
"""Share of a least time that is proven. The rest covers rounding."""

MAX_PARTS: Final = 4096
"""Largest number of windows, and of pieces of a path with few segments."""


@dataclass(frozen=True, eq=False)
class Timing:
    """A motion along a path around others; true in conditions if there is one.

    Attributes
    ----------
    trajectory : Trajectory or None
        The motion, which begins at the robot's ``at`` and is proven apart from all others.
    arrival_bound : float
        Seconds from the robot's ``at``, as the trajectory's duration. No motion ahead along the
        path that is nowhere faster than the robot's trajectory, and keeps the margin, ends before;
        infinite if none ends by ``until``.
    reason : str
        Why there is no motion: "impossible: ..." or "not found ..."; otherwise empty.
    """

    trajectory: Trajectory | None
    arrival_bound: float
    reason: str = ""

    def __bool__(self) -> bool:
        """Return True if there is a motion."""
        return self.trajectory is not None

    def _repr_png_(self) -> bytes | None:
        """Show the motion in a notebook, as its picture."""
        return None if self.trajectory is None else self.trajectory._repr_png_()


@names_options
def time_around(
    mover: Mover, others: Sequence[Mover], *, margin: float = 0.0, until: float | None = None
) -> Timing:
    """Find when a robot drives its path, apart from others.

    If the robot's own trajectory is apart from all others, it is the answer. Otherwise the robot
    waits at its start, and waits and slows down on its way. It keeps the path and the limits of its
    trajectory, is nowhere faster, and rests where that rests. It is proven apart from all others
    from its ``at`` until ``until``, also at its end. If no motion is found, this is proven to be
    impossible, or stays undecided.

    Parameters
    ----------
    mover : Mover
        A robot with a trajectory that begins at rest.
    others : sequence of Mover
        Robots on their motions, and things that stand or move, as for :func:`apart`.
    margin : float
        Distance that the robot must keep, metres.
    until : float, optional
        Last instant, seconds; by default the trajectory's duration after all motions have ended. It
        is needed if a thing moves or an error grows.

    Returns
    -------
    Timing

    Raises
    ------
    InputError
        As for :func:`apart`, except that robots may touch at the start; if the robot has no
        trajectory, or one that begins in motion.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.zeros((100, 60), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
    >>> plan = planners.plan(space, (1.0, 3.0), (9.0, 3.0))
    >>> trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=0.5)
    >>> robot = cspace.lanes.Mover(space.robot, trajectory)
    >>> person = cspace.lanes.Mover("disc:0.3", (5.0, -1.0), velocity=(0.0, 0.8), error=0.05)
    >>> timing = cspace.lanes.time_around(robot, [person], margin=0.2, until=60.0)
    >>> 0.0 < timing.trajectory.duration - trajectory.duration < 2.5
    True
    """
    first = read_mover(mover, "mover")
    gap = check_not_negative(margin, "margin")
    trajectory = _check_trajectory(first)
    if isinstance(others, Mover) or not isinstance(others, Sequence):
        raise InputError("others", f"is a {type(others).__name__}", "it must be a list of movers")
    timed = [read_mover(other, f"others[{k}]") for k, other in enumerate(others)]
    for k, other in enumerate(timed):
        check_pair(first, other, ("mover", f"others[{k}]"))
    begin = first.at
    driven = [each for each in timed if each.trajectory is not None]
    is_ending = not any(each.velocity.any() or each.growth for each in (first, *timed))
    duration = find_duration(begin, driven, until, is_ending)
    if until is None:
        duration = max(duration, 0.0) + trajectory.duration
    else:
        # Sums of times round to steps of the clock.
        duration += float(np.spacing(max(abs(begin), abs(begin + duration))))
    # Times count from the first instant, because stamps of clocks have few digits of a second.
    movers = [each._replace(at=each.at - begin) for each in (first, *timed)]
    measures = [make_measure(first.robot.shape, other.robot.shape) for other in timed]
    search = TimingSearch(movers[0], movers[1:], measures, gap, duration, begin)
    return search.run(trajectory)


def _check_trajectory(mover: Timed) -> Trajectory:
    """Return the trajectory of a mover that begins at rest."""
    if mover.trajectory is None:
        raise InputError("mover.motion", "has no times", "it must be a trajectory")
    if mover.trajectory.velocities[0].any():
        raise InputError("mover.motion", "begins in motion", "a robot that waits begins at rest")
    return mover.trajectory


class Advance(NamedTuple):
    """How far along a path a robot gets through cells that are not BLOCKED.

    Attributes
    ----------
    arrival : float
        Lower bound of the arrival at the end, seconds, perhaps infinite.
    piece : int
        The piece that the robot does not leave, or the last one.
    times : ndarray of float64, shape (count,)
        Earliest instants in each window at which it enters that piece.
    """

    arrival: float
    piece: int
    times: Floats


class TimingSearch:
    """The search for a motion of a robot along its path, from 0 on.

    ``shown`` is added to times in reasons.
    """

    def __init__(
        self,
        mover: Timed,
        others: list[Timed],
        measures: list[Measure],
        margin: float,
        duration: float,
        shown: float,
    ) -> None:
        """Remember the motions."""
        self._mover = mover
        self._others = others
        self._measures = measures
        self._margin = margin
        self._duration = duration
        self._shown = shown
        self._best: Trajectory | None = None
        self._latest = duration

    def run(self, trajectory: Trajectory) -> Timing:
        """Halve cells until the arrival is near its bound, or none is possible."""
        from planners.inside import cut_way, drive_around, wait_first

        lever = self._mover.robot.shape.lever
        bound = TIME_SHARE * float(cut_way(trajectory, lever, math.inf, 1).least_times.sum())
        if self._keep(trajectory):
            return Timing(self._best, bound)
        for size in CELL_SIZES:
            way = cut_way(trajectory, lever, size, MAX_PARTS)
            times = self._cut_time(way, size)
            states, borders = self._classify(way, times), times[::2]
            reach = find_reach(states, way.least_times, borders)
            bound = max(bound, reach.arrival)
            if bound == math.inf:
                reason = self._tell_wall(states, reach, way, borders)
                return Timing(None, bound, f"impossible: {reason}")
            delay = find_wait(states, way.passes, borders)
            if delay < math.inf:
                self._keep(wait_first(trajectory, delay))
            # The wait at the start is as good unless others come one after the other.
            latest = self._latest - CLOSE
            is_free = states == FREE
            through = find_reach(np.where(is_free, states, 0), way.least_times, borders).arrival
            if max(bound, through) < latest:
                self._keep(drive_around(trajectory, way, is_free, borders, (through, latest)))
            if self._best and self._latest - bound <= CLOSE:
                break
        reason = f"not found with cells of {100.0 * size:g} cm; none is excluded"
        return Timing(self._best, bound, "" if self._best else reason)

    def _keep(self, trajectory: Trajectory | None) -> bool:
        """Keep a motion that ends earlier if its own speeds prove it apart from all others."""
        from planners.inside import bound_rates

        if trajectory is None or trajectory.duration > self._latest:
            return False
        times, bounds = bound_rates(trajectory, self._mover.robot.shape.lever)
        mover = self._mover._replace(trajectory=trajectory, times=times, bounds=bounds)
        for other, measure in zip(self._others, self._measures, strict=True):
            search = ApartSearch((mover, other), measure, self._margin, self._duration)
            if not search.run(finds_first=False):
                return False
        self._best, self._latest = trajectory, trajectory.duration
        return True

    def _cut_time(self, way: PathPieces, size: float) -> Floats:
        """Return the borders of windows and their middles, seconds, shape (2 count + 1,).

        In a window the fastest robot moves somewhat less far than in the longest piece of the path.
        """
        movers = self._mover, *self._others
        speed = max(float(each.bounds[:2].sum(axis=0).max()) for each in movers)
        count = 1.1 * speed * self._duration / max(float(np.diff(way.travel[::2]).max()), size)
        return np.linspace(0.0, self._duration, 2 * math.ceil(min(max(count, 1.0), MAX_PARTS)) + 1)

    def _classify(self, way: PathPieces, times: Floats) -> NDArray[np.int16]:
        """Return the states of cells, shape (n, count).

        Cells that the robot cannot reach in time stay FREE.
        """
        n, count = len(way.lengths), len(times) // 2
        states = np.full((n, count), FREE, dtype=np.int16)
        reached = np.append(0.0, np.cumsum(way.least_times))
        ours = _pad(way.poses, self._mover)
        for number, (other, measure) in enumerate(zip(self._others, self._measures, strict=True)):
            theirs, _ = other.place(times)
            moved = _bound_travel(other, times)
            errors = self._mover.bound_errors(times) + other.bound_errors(times)
            rounding = other.bound_rounding(times)
            # Rows of cells: first piece and the one after the last, and the same of windows.
            cells = np.array([[0, n, 0, count]])
            while len(cells):
                cells = cells[reached[cells[:, 0]] <= times[2 * cells[:, 3]]]
                (low, high), (begin, end) = 2 * cells[:, :2].T, 2 * cells[:, 2:].T
                place, time = (low + high) // 2, (begin + end) // 2
                along = _bound_from_middle(way.travel, low, place, high)
                aside = _bound_from_middle(moved, begin, time, end)
                poses, others = ours[place], theirs[time]
                far = np.maximum(np.abs(poses).max(axis=1), np.abs(others).max(axis=1))
                slack = Cores.bound_rounding(far) + rounding[end]
                gaps = measure.bound_below(poses, others)
                is_free = gaps - slack - along - aside - errors[end] > self._margin
                # Robots that touch in the middle are too near all over a cell if they move less.
                room = self._margin + errors[begin] - slack - along - aside
                near = np.flatnonzero(gaps <= np.maximum(room, 0.0))
                above, _ = measure.bound_above(poses[near], others[near])
                is_blocked = np.zeros(len(cells), dtype=np.bool_)
                is_blocked[near] = above <= room[near]
                for first, stop, start, last in cells[is_blocked].tolist():
                    states[first:stop, start:last] = number
                is_whole = (high - low == 2) & (end - begin == 2)
                first, _, start, _ = cells[is_whole & ~is_free & ~is_blocked].T
                known = states[first, start]
                states[first, start] = np.where(known < 0, MIXED, known)
                left = ~(is_free | is_blocked | is_whole)
                cells = _halve(cells[left], along[left] >= aside[left])
        return states

    def _tell_wall(
        self, states: NDArray[np.int16], reach: Advance, way: PathPieces, borders: Floats
    ) -> str:
        """Say which mover blocks a path, where and when."""
        first = int(np.argmin(reach.times))
        entered = float(reach.times[first])
        row = states[reach.piece]
        blocked = first + np.flatnonzero(row[first:] >= 0)
        if not len(blocked):
            needed = float(way.least_times[reach.piece :].sum())
            if math.isinf(entered):
                entered, needed = 0.0, float(way.least_times.sum())
            arrival, until = tell_apart(
                self._shown + entered + needed, self._shown + self._duration
            )
            return f"the path takes until {arrival} s at the least, longer than until={until}"
        number = int(row[blocked[0]])
        is_other = row != number
        begin = int(np.flatnonzero(is_other[: blocked[0]]).max(initial=-1)) + 1
        ends = np.flatnonzero(is_other[blocked[0] :])
        stays = f"until {self._shown + borders[blocked[0] + ends[0]]:.1f} s" if len(ends) else "on"
        return (
            f"others[{number}] is in the way at {way.metres[reach.piece]:.1f} m of the path from "
            f"{self._shown + borders[begin]:.1f} s {stays}; the robot gets there at "
            f"{self._shown + entered:.1f} s at the earliest"
        )


def _pad(poses: Floats, mover: Timed) -> Floats:
    """Return poses with a yaw, shape (n, dim + 1)."""
    return np.pad(poses, ((0, 0), (0, len(mover.pose) - poses.shape[1])))


def _bound_travel(mover: Timed, times: Floats) -> Floats:
    """Bound how far any point of a mover moves up to times, metres, (n,)."""
    changes = np.clip(mover.at + mover.times, times[0], times[-1])
    borders = np.unique(np.concatenate([times, changes]))
    rates = mover.bound_rates(0.5 * (borders[1:] + borders[:-1]))[:2].sum(axis=0)
    moved = np.append(0.0, np.cumsum(rates * np.diff(borders)))
    return np.asarray(moved[np.searchsorted(borders, times)])


def _bound_from_middle(
    travel: Floats, first: NDArray[np.int64], middle: NDArray[np.int64], last: NDArray[np.int64]
) -> Floats:
    """Bound how far points are from where they are in the middles of parts."""
    most = np.maximum(travel[middle] - travel[first], travel[last] - travel[middle])
    # Sums of travel round.
    return np.asarray(most + 1e-12 * travel[-1])


def _halve(cells: NDArray[np.int64], along: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Halve cells along the path or, if that is one piece, or otherwise, along time."""
    pieces, windows = cells[:, 1] - cells[:, 0], cells[:, 3] - cells[:, 2]
    by_place = (windows == 1) | (along & (pieces > 1))
    before, after = cells.copy(), cells.copy()
    rows = np.arange(len(cells))
    first = np.where(by_place, 0, 2)
    middles = (cells[rows, first] + cells[rows, first + 1]) // 2
    before[rows, first + 1] = middles
    after[rows, first] = middles
    return np.concatenate([before, after])


def find_reach(states: NDArray[np.int16], least_times: Floats, borders: Floats) -> Advance:
    """Bound the arrival of a robot that may change its speed at once.

    Parameters
    ----------
    states : ndarray of int16, shape (n, count)
    least_times : ndarray of float64, shape (n,)
        Seconds that the robot needs for each piece at the least.
    borders : ndarray of float64, shape (count + 1,)
        Seconds at which windows begin and end.
    """
    begins, ends = borders[:-1], borders[1:]
    windows = np.arange(len(begins))
    enters = np.full(len(begins), math.inf)
    enters[0] = 0.0
    last = len(states) - 1
    # Sums of times round.
    proven = np.maximum(TIME_SHARE * least_times - 4.0 * np.spacing(borders[-1]), 0.0)
    for piece, least in enumerate(proven.tolist()):
        is_blocked = states[piece] >= 0
        # In each window the robot has been on the piece since the first entry after the last
        # BLOCKED window.
        since = np.maximum.accumulate(np.where(is_blocked, windows, -1)) + 1
        later = np.append(np.minimum.accumulate(enters[::-1])[::-1], math.inf)
        done = later[since] + least
        leaves = np.where(is_blocked | (done > ends), math.inf, np.maximum(done, begins))
        if piece == last:  # it stays at the end
            leaves[: since[-1]] = math.inf
        if not (leaves < math.inf).any():
            return Advance(math.inf, piece, enters)
        enters = leaves
    return Advance(float(enters.min()), last, enters)


def find_wait(states: NDArray[np.int16], passes: Floats, borders: Floats) -> float:
    """Return the least wait at the start with which a motion keeps to FREE cells, or infinity.

    ``passes``, shape (2, n + 1), are the seconds at which the motion reaches and leaves the ends of
    pieces without a wait.
    """
    reaches, leaves = passes.copy()
    # The robot rests before and after.
    reaches[0], leaves[-1] = -math.inf, math.inf
    is_taken = np.pad(states != FREE, ((0, 0), (1, 1))).astype(np.int8)
    changes = np.diff(is_taken, axis=1)
    pieces, firsts = np.nonzero(changes == 1)
    _, stops = np.nonzero(changes == -1)
    # A run of windows excludes the waits between two others.
    lows = borders[firsts] - leaves[pieces + 1]
    highs = borders[stops] - reaches[pieces]
    order = np.argsort(lows)
    wait = 0.0
    for low, high in zip(lows[order].tolist(), highs[order].tolist(), strict=True):
        if low >= wait:
            break
        wait = max(wait, high)
    return wait if wait + passes[1, -1] <= borders[-1] else math.inf
