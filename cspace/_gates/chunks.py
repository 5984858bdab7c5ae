"""Chunks of commands that a policy or a sampler makes, proven before they are executed.

A chunk is proven row by row. From each row to the next, the robot may be anywhere in the tube
around the straight motion: each coordinate may differ by the tracking error of the controller.

An arc of a twist lies in such a tube. Its yaw turns evenly. If it has length L and turns by angle
a, its second derivative, by the share of the arc that is done, is at most L a. So its position
differs by at most L a / 8 from even motion along the chord.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from cspace._queries.batches import as_contiguous
from cspace._queries.vehicles import Drive, check_drive
from cspace._rotations.base import TWO_PI, wrap_angles
from cspace._support.arrays import Bools, Floats, Ints, frozen
from cspace._support.check import (
    check_each,
    check_finite,
    check_points,
    check_positive,
    check_rows,
)
from cspace._support.reporting import tell_apart
from cspace._support.units import warn_of_large
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace._interface import ConfigurationSpace

Cause = Literal["collision", "limit", "speed", "jerk", "number"]
"""Why a row is refused: a collision, a limit, a speed, a jerk, or no configuration."""

JerkLimits = ArrayLike | Mapping[str, float]
"""Limits of jerk: one number, or one for each coordinate or number of a twist."""

LIMIT_ROUNDING: Final = 1e-9
"""Rounding of values that are compared with limits, relative to these."""

TWIST_NAMES: Final = ("v", "omega")
"""Names of the numbers of a twist."""

TWIST_UNITS: Final = ("m/s", "rad/s")
"""Units of the numbers of a twist."""

TWISTING_AXES: Final = ("x", "y", "yaw")
"""Axes of the maps of robots that are driven by twists."""

MAX_DT: Final = 10.0
"""Smallest time between rows, seconds, that is probably in milliseconds."""


MAX_PLACE: Final = 1e9
"""Coordinate from which on a row is in no place, metres."""


class RowRefusal(NamedTuple):
    """The first row of a chunk that is not proven, and why.

    Attributes
    ----------
    row : int
        Its index, from 0.
    cause : str
        "collision", "limit", "speed", "jerk", or "number" if the row is no configuration.
    names : tuple of str
        A link and its neighbour, obstacles of a map, or the coordinate that exceeds a limit.
    message : str
        The same in words, with numbers.
    """

    row: int
    cause: Cause
    names: tuple[str, ...]
    message: str


class RowCheck(NamedTuple):
    """Values of rows that may not exceed limits.

    Attributes
    ----------
    cause : str
        As for :class:`RowRefusal`.
    names : sequence of str
        Names of the k values.
    verb : str
        Words between the name and the value in messages.
    values : ndarray of float64, shape (B, n, k)
    limits : ndarray of float64
        Largest values; broadcast against these.
    """

    cause: Cause
    names: Sequence[str]
    verb: str
    values: Floats
    limits: Floats

    @property
    def exceeds(self) -> Bools:
        """Whether values exceed limits or are NaN, shape (B, n, k)."""
        return np.asarray(~(self.values <= self.limits * (1.0 + LIMIT_ROUNDING)))

    def refuse(self, row: int) -> RowRefusal | None:
        """Return why a row of the only chunk is refused, or None."""
        for column in np.flatnonzero(self.exceeds[0, row])[:1].tolist():
            name = self.names[column]
            value = self.values[0, row, column]
            limit = np.broadcast_to(self.limits, self.values.shape)[0, row, column]
            number, most = tell_apart(value, limit)
            message = f"row {row}: {name} {self.verb} {number}, at most {most} is allowed"
            return RowRefusal(row, self.cause, (name,), message)
        return None


@runtime_checkable
class SpeedLimit(Protocol):
    """A largest speed by places, such as :class:`planners.SpeedZones`."""

    def largest_speed(
        self, space: ConfigurationSpace, q: ArrayLike, lengths: ArrayLike, turns: ArrayLike
    ) -> Floats:
        """Return the largest speeds around configurations, shape (...), m/s.

        They hold within half of the lengths and turns, metres and radians.
        """


@runtime_checkable
class LinkLimit(Protocol):
    """A largest speed of a link, such as :class:`planners.ToolSpeed`."""

    link: str
    speed: float  # m/s


class ChunkMotions(NamedTuple):
    """The motions that chunks stand for.

    Attributes
    ----------
    space : ConfigurationSpace
    starts : ndarray of float64, shape (B, size)
    ends : ndarray of float64, shape (B, n * per_row, size)
        End of each tube, which is the start of the next.
    checks : list of RowCheck
        Limits that the rows keep.
    per_row : int
        Number of tubes for each of the n rows.
    sag : float
        Distance between the motions and the straight ones, metres.
    """

    space: ConfigurationSpace
    starts: Floats
    ends: Floats
    checks: list[RowCheck]
    per_row: int = 1
    sag: float = 0.0

    @property
    def keep_limits(self) -> Bools:
        """Whether all rows of chunks keep the limits, shape (B,)."""
        exceed = [check.exceeds.any(axis=(1, 2)) for check in self.checks]
        return np.asarray(~np.logical_or.reduce(exceed))

    def count_proven(self, tracking: Floats) -> Ints:
        """Count each chunk's proven rows, shape (B,).

        ``tracking`` is the error of all coordinates, or of each, metres and radians.
        """
        chunks, tubes, _ = self.ends.shape
        counts = np.full(chunks, tubes)
        for check in self.checks:
            is_refused = np.logical_or.reduce(check.exceeds, axis=2)
            first_refused = np.where(
                is_refused.any(axis=1), is_refused.argmax(axis=1), tubes // self.per_row
            )
            np.minimum(counts, first_refused * self.per_row, out=counts)
        radii = self._find_radii(tracking)[np.newaxis].repeat(chunks, axis=0)
        self.space._count_free_tubes(self.starts, self.ends, radii, counts)
        return counts // self.per_row

    def find_refusal(self, row: int, tracking: Floats) -> RowRefusal:
        """Explain why a row of the only chunk is not proven."""
        last = (row + 1) * self.per_row
        if self.space._find_unusable(self.ends[0, last - 1 : last]) >= 0:
            return RowRefusal(row, "number", (), f"row {row} is no configuration")
        for check in self.checks:
            refusal = check.refuse(row)
            if refusal is not None:
                return refusal
        points = np.concatenate([self.starts, self.ends[0]])
        part = points[row * self.per_row : (row + 1) * self.per_row + 1]
        # Instants of a tube at which the reason is sought that it is not proven.
        shares = np.linspace(0.0, 1.0, 33)[:, np.newaxis, np.newaxis]
        instants = self.space.interpolate(part[:-1], part[1:], shares).swapaxes(0, 1)
        rows = instants.reshape(-1, self.space.size)
        names, text = self.space._explain_tube(rows, self._find_radii(tracking))
        if row == 0:
            with np.errstate(all="ignore"):  # later rows may hold any numbers
                lengths = self.space.distance(points[:-1], points[1:])
            # A change is short, and so are the ways between changes.
            longest = max(np.linalg.norm(points[1]), lengths[1:].max(initial=0.0))
            # Ratio of the way to the first row and the longest way between others, from which on
            # rows may be changes.
            if lengths[0] > 10.0 * longest:
                far = f"it is far from q, by {lengths[0]:.3g}; rows are targets, not changes"
                text = f"{far}; {text}"
        return RowRefusal(row, "collision", names, f"row {row}: {text}")

    def _find_radii(self, tracking: Floats) -> Floats:
        """Return the radius of the tubes along each coordinate, metres and radians."""
        radii = np.full(len(list_steps(self.space)), tracking)
        radii[: self.space.dim] += self.sag
        return radii


@dataclass(frozen=True, eq=False)
class Chunk:
    """A chunk of commands with its proof, as :class:`cspace.Gate` makes it.

    Attributes
    ----------
    rows : ndarray of float64, shape (n, size) or (B, n, size), read-only
        The targets. Those of twists are the poses that they lead to.
    proven : int or ndarray of int64, shape (B,)
        Number of rows, from the first on, that are proven: the whole tube to each is free, and it
        keeps all limits.
    """

    rows: Floats
    proven: int | Ints
    _tubes: ChunkMotions = field(repr=False)
    _tracking: Floats = field(repr=False)  # one for all coordinates, or one for each

    @property
    def is_proven(self) -> bool | Bools:
        """Whether all rows are proven; shape (B,) for a batch."""
        are_proven: Bools = np.equal(self.proven, self.rows.shape[-2])
        return are_proven if self.rows.ndim == 3 else bool(are_proven)

    def __bool__(self) -> bool:
        """Return :attr:`is_proven`; InputError for a batch."""
        self._check_alone()
        return bool(self.is_proven)

    @cached_property
    def refusal(self) -> RowRefusal | None:
        """First row that is not proven, with the reason, or None.

        It is computed at first access, for the obstacles of that moment. InputError for
        a batch.
        """
        self._check_alone()
        return (
            None if self.is_proven else self._tubes.find_refusal(int(self.proven), self._tracking)
        )

    @cached_property
    def max_tracking(self) -> float | Floats:
        """Largest tracking error for which all rows are proven, within 1 %.

        It is a proven lower bound, and NaN if not even the motion without error is proven. Errors
        of several coordinates are scaled together. It is computed at first access, for
        the obstacles of that moment. InputError for a batch.
        """
        self._check_alone()
        largest = float(self._tracking.max())
        shape = self._tracking / largest if largest > 0.0 else np.ones_like(self._tracking)

        def is_proven(error: float) -> bool:
            """Return True if all rows are proven with an error."""
            return int(self._tubes.count_proven(error * shape)[0]) == len(self.rows)

        error = _find_largest(is_proven)
        return error * shape if shape.ndim else error

    def _check_alone(self) -> None:
        """Raise InputError for a batch."""
        if self.rows.ndim == 3:
            raise InputError(
                "chunk",
                f"is a batch of {len(self.rows)}",
                "only a single chunk has a truth, a refusal and a largest tracking error",
            )


def _find_largest(is_proven: Callable[[float], bool]) -> float:
    """Return the largest error that is proven; NaN if zero is not."""
    if not is_proven(0.0):
        return math.nan
    low = 0.0
    # Smallest tracking error above zero that is tried for the largest one, metres and radians.
    high = 1e-3
    # Tracking error from which on no larger one is tried, metres and radians.
    while high < 1e3 and is_proven(high):
        low = high
        high *= 2.0
    # Number of times that the range of the largest tracking error is halved.
    for _ in range(8):
        middle = 0.5 * (low + high)
        if is_proven(middle):
            low = middle
        else:
            high = middle
    return low


def certify_rows(
    space: ConfigurationSpace,
    q: ArrayLike,
    rows: ArrayLike,
    tracking: Floats,
    dt: float | None,
    max_velocity: ArrayLike | None,
    max_jerk: JerkLimits | None,
    places: Sequence[SpeedLimit | LinkLimit],
    before: ArrayLike | None,
) -> Chunk:
    """Prove a chunk of targets; see :meth:`cspace.Gate.check_rows`."""
    starts, targets, is_batch = _check_chunk(space, q, rows, "rows", space.axes)
    warn_of_large(starts, "rad", "q", space._angles)
    warn_of_large(targets, "rad", "rows", space._angles)
    checks = list[RowCheck]()
    with np.errstate(all="ignore"):  # rows may hold any numbers
        firsts = np.concatenate([starts[:, np.newaxis], targets[:, :-1]], axis=1)
        checks += _check_targets(space, firsts, targets)
        if dt is not None:
            seconds = check_dt(dt)
            names = list_steps(space)
            rates = space.steps_between(firsts, targets) / seconds
            speeds = _measure(space, rates)
            limits = check_velocities(space, max_velocity)
            checks.append(RowCheck("speed", names, "changes per second by", speeds, limits))
            middles = space.interpolate(firsts, targets, 0.5) if places else firsts
            if found := [limit for limit in places if isinstance(limit, SpeedLimit)]:
                steps = _split_axes(space, space.steps_between(firsts, targets))
                sizes = [np.linalg.norm(each, axis=-1) for each in steps]
                checks.append(_check_speeds(space, found, middles, sizes, tracking, seconds))
            for limit in places:
                if isinstance(limit, LinkLimit):
                    checks.append(_check_link(space, limit, middles, rates, tracking, seconds))
            if max_jerk is not None:
                limits = check_each(max_jerk, "max_jerk", names)
                driven = _check_before(before, space.axes, is_batch)
                warn_of_large(driven, "rad", "before", space._angles)
                earlier = np.concatenate([driven, starts])
                earlier = space.steps_between(earlier[:-1], earlier[1:]) / seconds
                jerks = _measure(space, _differ_twice(earlier, rates, seconds))
                checks.append(RowCheck("jerk", names, "has a jerk of", jerks, limits))
        elif max_velocity is not None:
            raise make_missing_dt()
    tubes = ChunkMotions(space, starts, targets, checks)
    return _prove(tubes, targets, is_batch, tracking)


def certify_twists(
    space: ConfigurationSpace,
    q: ArrayLike,
    twists: ArrayLike,
    dt: float,
    tracking: Floats,
    max_velocity: ArrayLike | None,
    drive: Drive | None,
    max_jerk: JerkLimits | None,
    places: Sequence[SpeedLimit],
    before: ArrayLike | None,
) -> Chunk:
    """Prove a chunk of twists; see :meth:`cspace.Gate.check_twists`."""
    if space.axes != TWISTING_AXES:
        raise InputError(
            "space",
            f"has the axes {', '.join(space.axes)}",
            "twists move a robot with x, y and yaw",
        )
    starts, commands, is_batch = _check_chunk(space, q, twists, "twists", TWIST_NAMES)
    seconds = check_dt(dt)
    magnitudes = np.abs(commands)
    # Largest speed of a twist that is a usable number, m/s and rad/s.
    checks = [RowCheck("number", TWIST_NAMES, "is", magnitudes, np.array([1e100]))]
    if max_velocity is not None:
        limits = check_each(max_velocity, "max_velocity", TWIST_NAMES)
        checks.append(RowCheck("speed", TWIST_NAMES, "is", magnitudes, limits))
    checks += _list_drive_checks(check_drive(drive), commands)
    if max_jerk is not None:
        limits = check_each(max_jerk, "max_jerk", TWIST_NAMES)
        driven = _check_before(before, TWIST_NAMES, is_batch)
        warn_of_twists(driven, "before")
        with np.errstate(all="ignore"):
            jerks = np.abs(_differ_twice(driven, commands, seconds))
        checks.append(RowCheck("jerk", TWIST_NAMES, "has a jerk of", jerks, limits))
    if places:
        is_number = ~checks[0].exceeds.any(axis=2, keepdims=True)
        halves = np.where(is_number, commands, 0.0) * (0.5 * seconds)
        middles = _roll_out(starts, np.repeat(halves, 2, axis=1))[:, ::2]
        sizes = [magnitudes[..., 0] * seconds, magnitudes[..., 1] * seconds]
        checks.append(_check_speeds(space, places, middles, sizes, tracking, seconds))
    # Cut each twist into arcs that stay near their chords, and turn by at most a radian.
    lengths, angles = np.moveaxis(magnitudes * seconds, -1, 0)
    spacing = 2.0 * space.resolution
    with np.errstate(all="ignore"):
        # An arc and even motion along its chord are at most 1/16 of a cell apart.
        arcs = np.sqrt(lengths * angles / (8.0 / 16.0 * spacing))
        arcs = np.ceil(np.maximum(arcs, angles))[..., np.newaxis]
    # Largest number of arcs that a twist is cut into.
    most_arcs = np.array([64.0])
    checks.append(
        RowCheck("limit", ("twist",), "is cut into arcs, whose number is", arcs, most_arcs)
    )
    is_used = ~np.concatenate([check.exceeds for check in checks], axis=2).any(axis=2)
    # Twists from the first refused one on are never driven.
    is_used = np.logical_and.accumulate(is_used, axis=1)
    per_row = int(max(arcs[is_used].max(initial=1.0), 1.0))
    driven = np.where(is_used[..., np.newaxis], commands, 0.0)
    poses = _roll_out(starts, np.repeat(driven * seconds / per_row, per_row, axis=1))
    sag = float((lengths * angles)[is_used].max(initial=0.0)) / (8.0 * per_row**2)
    # Rounding of a pose, in cells, for each arc that leads to it.
    sag += 2.0**-30 * spacing * poses.shape[1]
    tubes = ChunkMotions(space, starts, poses, checks, per_row, sag)
    return _prove(tubes, poses[:, per_row - 1 :: per_row], is_batch, tracking)


def _split_axes(space: ConfigurationSpace, values: Floats) -> tuple[Floats, Floats]:
    """Return the translations and the rotations in steps or errors of coordinates."""
    return values[..., : space.dim], values[..., space.dim :]


def _check_targets(space: ConfigurationSpace, before: Floats, targets: Floats) -> list[RowCheck]:
    """Check targets, shape (B, n, size), by limits of joints, and steps to them by half a turn."""
    checks = []
    excesses = space._excesses(targets)
    if excesses.any():
        none = np.zeros(space.size)
        checks.append(RowCheck("limit", space.axes, "exceeds its limits by", excesses, none))
    if not np.isinf(space._spans).all():
        turns = np.abs(targets - before)
        checks.append(RowCheck("limit", space.axes, "turns by", turns, space._spans))
    return checks


def _check_speeds(
    space: ConfigurationSpace,
    places: Sequence[SpeedLimit],
    middles: Floats,
    sizes: Sequence[Floats],
    tracking: Floats,
    dt: float,
) -> RowCheck:
    """Limit the speeds of motions by places.

    Their ``sizes`` are metres and radians, shape (B, n) each, around ``middles``, (B, n, size).
    """
    errors = np.full(len(list_steps(space)), tracking)
    lengths, turns = (
        size + 2.0 * float(np.linalg.norm(part))
        for size, part in zip(sizes, _split_axes(space, errors), strict=True)
    )
    # Motions of other rows, such as of far ones, are refused for other reasons.
    usable = np.isfinite(middles).all(axis=-1) & np.isfinite(lengths) & np.isfinite(turns)
    usable &= np.abs(middles).max(axis=-1) < MAX_PLACE
    limits = np.zeros(usable.shape)
    rows = middles[usable], lengths[usable], turns[usable]
    limits[usable] = np.min([limit.largest_speed(space, *rows) for limit in places], axis=0)
    return RowCheck("speed", ("v",), "is", sizes[0][..., np.newaxis] / dt, limits[..., np.newaxis])


def _check_link(
    space: ConfigurationSpace,
    limit: LinkLimit,
    middles: Floats,
    rates: Floats,
    tracking: Floats,
    dt: float,
) -> RowCheck:
    """Limit the speed of a link, at rates of the joints around configurations, (B, n, size)."""
    usable = np.isfinite(middles).all(axis=-1) & np.isfinite(rates).all(axis=-1)
    usable &= np.maximum(np.abs(middles), np.abs(rates)).max(axis=-1) < MAX_PLACE
    speeds = np.full(usable.shape, np.inf)
    sizes = np.abs(rates[usable])
    reaches = 0.5 * dt * sizes + tracking
    # In these seconds, rates that are no lower lead to all places in the tube.
    seconds = np.divide(reaches, sizes, out=np.full(sizes.shape, MAX_DT), where=sizes > 0.0)
    seconds = np.minimum(seconds.min(axis=1), MAX_DT)
    rows = middles[usable], rates[usable], seconds, reaches / seconds[:, np.newaxis]
    speeds[usable] = space._bound_link_speeds(limit.link, *rows)
    values, limits = speeds[..., np.newaxis], np.array([limit.speed])
    return RowCheck("speed", (limit.link,), "moves at up to", values, limits)


def _list_drive_checks(drive: Drive | None, twists: Floats) -> list[RowCheck]:
    """List the limits of a drive that twists (B, n, 2) keep."""
    checks = list[RowCheck]()
    if drive is None:
        return checks
    speeds, rates = np.split(np.abs(twists), 2, axis=-1)
    if not drive.reverse:
        backwards = np.maximum(-twists[..., :1], 0.0)
        checks.append(RowCheck("limit", ("v",), "reverses at", backwards, np.zeros(1)))
    largest = drive._limit_yaw_rates(speeds)
    if largest is not None:
        checks.append(RowCheck("limit", ("omega",), "is", rates, largest))
    if drive.max_lateral_acceleration is not None:
        limit = np.array([drive.max_lateral_acceleration])
        with np.errstate(all="ignore"):  # twists may be any numbers
            sideways = speeds * rates
        checks.append(RowCheck("limit", ("omega",), "accelerates sideways by", sideways, limit))
    return checks


def _roll_out(starts: Floats, arcs: Floats) -> Floats:
    """Return the poses at the ends of arcs, shape (B, n, 3).

    ``arcs``, shape (B, n, 2), are lengths and angles, from ``starts``, shape (B, 3).
    """
    lengths, angles = np.moveaxis(arcs, -1, 0)
    yaws = wrap_angles(starts[:, 2:]) + np.cumsum(angles, axis=1)
    headings = yaws - 0.5 * angles
    chords = lengths * np.sinc(angles / TWO_PI)
    x = starts[:, :1] + np.cumsum(chords * np.cos(headings), axis=1)
    y = starts[:, 1:2] + np.cumsum(chords * np.sin(headings), axis=1)
    return np.stack([x, y, yaws], axis=-1)


def _prove(tubes: ChunkMotions, rows: Floats, is_batch: bool, tracking: Floats) -> Chunk:
    """Prove the rows of chunks (B, n, size); return rows and proof."""
    counts = tubes.count_proven(tracking)
    if is_batch:
        return Chunk(frozen(rows.copy()), counts, tubes, tracking)
    return Chunk(frozen(rows[0].copy()), int(counts[0]), tubes, tracking)


def _check_chunk(
    space: ConfigurationSpace, q: ArrayLike, rows: ArrayLike, name: str, columns: Sequence[str]
) -> tuple[Floats, Floats, bool]:
    """Return starts (B, size) and rows (B, n, len(columns)).

    The third value is True for a batch. ``name`` names the rows. Raises InputError for other
    shapes, or if ``q`` is not finite; rows may hold any numbers.
    """
    array = check_rows(rows, name, columns)
    size = len(columns)
    if array.ndim not in (2, 3) or array.shape[-2] == 0:
        raise InputError(
            name,
            f"has shape {array.shape}",
            f"a chunk has the shape (n, {size}), or (B, n, {size}) in a batch, with n above zero",
        )
    chunks = array if array.ndim == 3 else array[np.newaxis]
    points = check_points(q, "q", space.axes)
    if points.shape not in ((space.size,), (len(chunks), space.size)):
        raise InputError(
            "q",
            f"has shape {points.shape}",
            f"each chunk begins at one configuration of {space.size} numbers",
        )
    if space._find_unusable(as_contiguous(points.reshape(-1, space.size))) >= 0:
        raise InputError(
            "q",
            f"is {q!r}",
            "it must be where the robot is",
        )
    starts = np.repeat(points[np.newaxis], len(chunks), axis=0) if points.ndim == 1 else points
    return as_contiguous(starts), as_contiguous(chunks), array.ndim == 3


def warn_of_twists(twists: Floats, name: str) -> None:
    """Warn of speeds and rates, shape (..., 2), that are larger than their units suggest."""
    for k, unit in enumerate(TWIST_UNITS):
        warn_of_large(twists, unit, name, {k: TWIST_NAMES[k]})


def _check_before(before: ArrayLike | None, names: Sequence[str], is_batch: bool) -> Floats:
    """Return the rows that were driven before a chunk, shape (m, len(names)); by default none."""
    if is_batch:
        raise InputError("max_jerk", "is that of a batch", "jerks are checked of a single chunk")
    if before is None:
        return np.zeros((0, len(names)))
    rows = check_finite(before, "before", names)
    if rows.ndim != 2 or rows.shape[1] != len(names):
        rule = f"it must be rows of {', '.join(names)}, the latest one last"
        raise InputError("before", f"has shape {rows.shape}", rule)
    return rows


def _differ_twice(earlier: Floats, rates: Floats, dt: float) -> Floats:
    """Return the second differences of rates over squared seconds; zero for the first rates.

    ``earlier`` rates of the only chunk have shape (m, k), and the result (1, n, k).
    """
    count = len(rates[0])
    unknown = np.zeros((max(2 - len(earlier), 0), rates.shape[-1]))
    differences = np.diff(np.concatenate([earlier, rates[0]]), 2, axis=0) / dt**2
    return np.asarray(np.concatenate([unknown, differences])[np.newaxis, -count:])


def _measure(space: ConfigurationSpace, steps: Floats) -> Floats:
    """Return sizes of steps, or of their changes, along each coordinate that strays."""
    sizes = np.abs(steps)
    count = len(list_steps(space))
    if sizes.shape[-1] > count:  # rotation vectors
        sizes[..., space.dim] = np.linalg.norm(sizes[..., space.dim :], axis=-1)
    return np.asarray(sizes[..., :count])


def list_steps(space: ConfigurationSpace) -> tuple[str, ...]:
    """Return names of coordinates that stray, one for a quaternion."""
    names = space.rotations.names if space.has_poses else ()
    return (*space.axes[: space.dim], *(("rotation",) if len(names) == 4 else names))


def list_units(space: ConfigurationSpace) -> list[str]:
    """Return the units of coordinates that stray, m or rad."""
    pairs = zip(list_steps(space), space.units, strict=False)  # a quaternion strays as one
    return ["m" if unit == "m" else "rad" for _, unit in pairs]


def check_dt(dt: float) -> float:
    """Return the seconds between rows, which are few."""
    seconds = check_positive(dt, "dt", "seconds")
    if seconds >= MAX_DT:
        rule = f"rows follow each other within {MAX_DT:g} seconds"
        hint = f"pass {seconds / 1000.0:g} for {seconds:g} ms"
        raise InputError("dt", f"is {dt!r}", rule, hint)
    return seconds


def make_missing_dt() -> InputError:
    """Make the error for limits of speeds or jerks without the time between rows."""
    rule = "limits of speeds and jerks count the seconds between rows"
    return InputError("dt", "is missing", rule)


def check_velocities(space: ConfigurationSpace, max_velocity: ArrayLike | None) -> Floats:
    """Return the largest speeds, by default the space's."""
    if max_velocity is not None:
        units = [f"{unit}/s" for unit in list_units(space)]
        defaults = space.max_velocity
        return check_each(max_velocity, "max_velocity", list_steps(space), units, defaults)
    if not space.max_velocity:
        raise InputError(
            "max_velocity",
            "is missing",
            f"it must be one number, or one for each of {', '.join(list_steps(space))}",
        )
    return np.array([space.max_velocity.get(axis, math.inf) for axis in space.axes])
