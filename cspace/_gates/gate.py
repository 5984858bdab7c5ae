"""Gate: the proven part of commands that others make, then rest."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspace._gates.chunks import (
    LIMIT_ROUNDING,
    TWIST_NAMES,
    TWIST_UNITS,
    TWISTING_AXES,
    Chunk,
    JerkLimits,
    LinkLimit,
    SpeedLimit,
    certify_rows,
    certify_twists,
    check_dt,
    check_velocities,
    list_steps,
    list_units,
    make_missing_dt,
    warn_of_twists,
)
from cspace._interface import ConfigurationSpace
from cspace._queries.vehicles import Drive, check_drive
from cspace._support.arrays import Bools, Floats, Ints
from cspace._support.check import (
    check_each,
    check_finite,
    check_points,
    check_positive,
    names_options,
)
from cspace._support.check import check_rows as check_columns
from cspace._support.units import warn_of_large
from cspace.errors import InputError

GateState = Literal["go", "shortened", "hold"]
"""The share of a chunk that may be executed: all, a part, or nothing."""

SHARES: Final = 16
"""Number of shares of a twist that are tried."""

MAX_RAMP: Final = 100000
"""Largest number of commands of braking."""


class GatedCommands(NamedTuple):
    """What a gate lets through.

    Attributes
    ----------
    commands : ndarray of float64, shape (n, size) or (n, 2)
        The proven rows or twists, then rest: the last proven row, or the robot's pose; zeros for
        twists. Those of a batch have one more axis, the first.
    state : str
        "go" if all rows are proven, "shortened" if some are, else "hold".
    chunk : Chunk
        The proof: the number of proven rows, the refusal of the next one, and the largest tracking
        error.
    """

    commands: Floats
    state: GateState
    chunk: Chunk


class SlowedCommand(NamedTuple):
    """The fastest part of a twist that a gate lets through, and how the robot stops after it.

    Attributes
    ----------
    share : float
        Share of the twist, at most 1; 0 if the robot must brake.
    commands : ndarray of float64, shape (n, 2)
        The twist to drive next, then twists that bring the robot to rest.
    chunk : Chunk
        The proof of all commands. Where not even braking is proven, as behind an obstacle that has
        just come, it is not, and has the refusal.
    leaves : bool
        True if the commands are proven to come no nearer to near obstacles, but not by ``chunk``.
    """

    share: float
    commands: Floats
    chunk: Chunk
    leaves: bool = False


class Gate:
    """A gate for commands that others make, such as a policy.

    It lets through the proven part of a chunk, then holds. A controller does not follow commands
    exactly, so each one is proven with the whole tube around the motion that it leads to. A robot
    does not stop at once, so ``tracking`` must cover the way that it needs to stop behind a row, as
    :meth:`stop_distance` says. Or :meth:`slow_down` proves that way, too.

    Parameters
    ----------
    space : CSpace, TiledCSpace or ArmSpace
        Its obstacles may change at any time. On ``space.exact`` the geometry proves tubes that
        leave FREE cells, for the robot grown by how far ``tracking`` moves its points.
    tracking : array-like, shape () or (k,)
        Largest error of the controller: one number for all coordinates, metres and radians, or one
        for each. A quaternion counts as one rotation.
    dt : float, optional
        Seconds between rows, or for which each twist is driven.
    max_velocity : array-like, shape () or (k,), optional
        Largest speed of each coordinate, m/s and rad/s, by default from an arm's URDF; for
        twists the largest speed and yaw rate. Faster ones are refused.
    drive : planners.Car or planners.Differential, optional
        Twists that it cannot drive are refused: tighter than its turning radius, backwards if it
        does not reverse, or with a larger lateral acceleration.
    max_deceleration : array-like, shape (2,), optional
        How fast the robot can brake along its way and in yaw, m/s^2 and rad/s^2.
    max_jerk : array-like or mapping, optional
        Largest jerk, in the forms of ``max_velocity``: third differences of rows, or second ones of
        twists, over ``dt``. They need as many rows before, as :meth:`check_rows` says. What holds
        behind a chunk is not checked, and :meth:`slow_down` brakes with a jump of the acceleration,
        so a gate has ``max_deceleration`` or ``max_jerk``.
    speed : planners.SpeedZones, planners.SlowNear, planners.ToolSpeed, or a list, optional
        Largest speeds by places, or of links of an arm. A row or twist is refused if the tube
        around its motion touches a place where it is too fast, or if a link is too fast in that
        tube at the mean velocities of the joints.

    Raises
    ------
    InputError
        If the space is one of your own, or a limit is not one that rows or twists could have, or
        both ``max_deceleration`` and ``max_jerk`` are passed.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
    >>> gate = cspace.Gate(space, tracking=0.05)
    >>> passed = gate.check_rows((0.5, 1.5), [(0.5, 2.0), (1.0, 2.0), (2.0, 1.0)])
    >>> passed.state, passed.commands.tolist()
    ('shortened', [[0.5, 2.0], [1.0, 2.0], [1.0, 2.0]])
    >>> passed.chunk.refusal.cause
    'collision'
    """

    @names_options
    def __init__(
        self,
        space: ConfigurationSpace,
        *,
        tracking: ArrayLike = 0.0,
        dt: float | None = None,
        max_velocity: ArrayLike | None = None,
        drive: Drive | None = None,
        max_deceleration: ArrayLike | None = None,
        max_jerk: JerkLimits | None = None,
        speed: SpeedLimit | LinkLimit | Sequence[SpeedLimit | LinkLimit] = (),
    ) -> None:
        """Check and keep the limits; InputError for a space of your own."""
        # A proxy of a map may have that map's __class__, and other answers.
        if not issubclass(type(space), ConfigurationSpace):
            raise InputError(
                "space",
                f"is a {type(space).__name__}",
                "a gate proves whole tubes, on a map or for an arm",
            )
        names = list_steps(space)
        self.space = space
        self.tracking = check_each(tracking, "tracking", names, list_units(space))
        self.dt = None if dt is None else check_dt(dt)
        self.max_velocity = max_velocity
        self.drive = check_drive(drive)
        self.max_jerk = max_jerk
        self.speed = self._check_speed_limits(speed)
        per_second = max_velocity, max_jerk, self.speed or None
        if dt is None and any(limit is not None for limit in per_second):
            raise make_missing_dt()
        self.max_velocity = self._check_velocity(max_velocity)
        if max_jerk is not None:
            self._check_jerk(max_jerk, max_deceleration)
        self.max_deceleration = max_deceleration
        if max_deceleration is not None:
            units = [f"{unit}^2" for unit in TWIST_UNITS]
            given = check_each(max_deceleration, "max_deceleration", TWIST_NAMES, units)
            rates = np.broadcast_to(given, len(TWIST_NAMES))
            for name, rate in zip(TWIST_NAMES, rates.tolist(), strict=True):
                check_positive(rate, f"max_deceleration of {name}")
            self.max_deceleration = rates

    def __repr__(self) -> str:
        """Return the space and the limits of the gate."""
        parts = [repr(self.space)]
        for name, value in vars(self).items():
            if name == "speed" and value:
                parts.append(f"speed={list(value)!r}")
            elif name in ("space", "speed") or value is None:
                continue
            else:
                parts.append(f"{name}={np.asarray(value).tolist()!r}")
        return f"Gate({', '.join(parts)})"

    def _check_velocity(self, limits: ArrayLike | None) -> ArrayLike | None:
        """Return limits of velocities; raise InputError if rows of the space lack theirs."""
        if limits is None:
            if self.dt is not None and self.space.axes != TWISTING_AXES:
                check_velocities(self.space, None)
            return None
        if _list_limited(self.space, limits) == TWIST_NAMES:
            limits = check_each(limits, "max_velocity", TWIST_NAMES, TWIST_UNITS)
        else:
            limits = check_velocities(self.space, limits)
        return limits

    def _check_speed_limits(
        self, speed: SpeedLimit | LinkLimit | Sequence[SpeedLimit | LinkLimit]
    ) -> tuple[SpeedLimit | LinkLimit, ...]:
        """Return limits of speed; raise InputError if one is none, or not for the space."""
        limits = tuple(speed) if isinstance(speed, Sequence) else (speed,)
        rows = np.zeros((0, self.space.size))
        for limit in limits:
            given: object = limit
            if isinstance(given, SpeedLimit):
                given.largest_speed(self.space, rows, 0.0, 0.0)
            elif isinstance(given, LinkLimit):
                self.space._bound_link_speeds(given.link, rows, rows, rows[:, 0], rows)
            else:
                rule = "it must be planners.SpeedZones, SlowNear, ToolSpeed, or a list of these"
                raise InputError("speed", f"is {given!r}", rule)
        return limits

    def _check_jerk(self, limits: JerkLimits, max_deceleration: ArrayLike | None) -> None:
        """Raise InputError if limits of jerk are none, or the gate cannot keep them."""
        names = _list_limited(self.space, limits)
        values = np.broadcast_to(check_each(limits, "max_jerk", names), len(names))
        for name, value in zip(names, values.tolist(), strict=True):
            check_positive(value, f"max_jerk of {name}", "metres, radians, seconds")
        if max_deceleration is not None:
            raise InputError(
                "max_jerk",
                f"is {limits!r}, and max_deceleration {max_deceleration!r}",
                "brakes change the acceleration at once",
            )

    def check_rows(
        self, q: ArrayLike, rows: ArrayLike, *, before: ArrayLike | None = None
    ) -> GatedCommands:
        """Let through the proven part of a chunk of targets.

        The robot moves straight from ``q`` to the first row, and from each row to the next,
        as for :meth:`cspace.CSpace.certify_path`.

        Parameters
        ----------
        q : array-like, shape (size,) or (B, size)
            Where the robot is, as measured; it may be beyond a limit of a joint.
        rows : array-like, shape (n, size) or (B, n, size)
            Next targets, metres and radians; or a batch of chunks. Continuous joints count whole
            turns. Rows that are not finite are never proven.
        before : array-like, shape (m, size), optional
            For ``max_jerk``: where the robot was in steps of ``dt`` before it came to ``q``, the
            latest last. Two are enough; without them jerks are checked from the third row on.

        Raises
        ------
        InputError
            If ``q`` is not finite, a shape is wrong, a limit of speed is missing, or a gate with
            ``max_jerk`` gets a batch.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.zeros((60, 40), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
        >>> gate = cspace.Gate(space, dt=0.1, max_velocity=1.0, max_jerk=20.0)
        >>> rows = [(1.0, 2.0), (1.02, 2.0), (1.06, 2.0), (1.16, 2.0)]
        >>> gate.check_rows((1.0, 2.0), rows).chunk.refusal.message
        'row 3: x has a jerk of 40, at most 20 is allowed'
        """
        limits = self.dt, self.max_velocity, self.max_jerk, self.speed
        chunk = certify_rows(self.space, q, rows, self.tracking, *limits, before)
        commands = chunk.rows.copy()
        chunks = commands.reshape(chunk._tubes.ends.shape)  # a view
        for one, start, proven in zip(
            chunks, chunk._tubes.starts, np.ravel(chunk.proven), strict=True
        ):
            one[proven:] = one[proven - 1] if proven else start
        return GatedCommands(commands, _name_state(chunk), chunk)

    def check_twists(
        self, q: ArrayLike, twists: ArrayLike, *, before: ArrayLike | None = None
    ) -> GatedCommands:
        """Let through the proven part of a chunk of twists.

        Each twist drives the robot along an arc for ``dt``. The arcs are proven as such: a tube
        around chords that is wide enough to contain them, with the tracking error in addition.

        Parameters
        ----------
        q : array-like, shape (3,) or (B, 3)
            Pose of the robot: x, y, yaw.
        twists : array-like, shape (n, 2) or (B, n, 2)
            Velocities ahead, m/s, negative in reverse, and yaw rates, rad/s; or a batch of chunks.
        before : array-like, shape (m, 2), optional
            For ``max_jerk``: twists driven up to ``q``, the latest last. Two are enough; without
            them jerks are checked from the third twist on.

        Raises
        ------
        InputError
            If the gate has no ``dt``, or the axes of the map are not x, y, yaw; and as
            :meth:`check_rows`.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.rectangle(0.3, 0.2), rotations=36)
        >>> gate = cspace.Gate(space, dt=0.5)
        >>> chunk = gate.check_twists((0.5, 1.5, 0.0), [(0.5, 0.2)] * 4).chunk
        >>> chunk.proven, chunk.rows[1].round(2).tolist()
        (2, [1.0, 1.55, 0.2])
        """
        asked = check_columns(twists, "twists", TWIST_NAMES)
        warn_of_twists(asked, "twists")
        chunk = self._certify(q, asked, before)
        warn_of_large(chunk._tubes.starts, "rad", "q", self.space._angles)
        is_proven = np.arange(asked.shape[-2]) < np.asarray(chunk.proven)[..., np.newaxis]
        commands = np.where(is_proven[..., np.newaxis], asked, 0.0)
        return GatedCommands(commands, _name_state(chunk), chunk)

    @names_options
    def slow_down(
        self,
        q: ArrayLike,
        twist: ArrayLike,
        *,
        twist_now: ArrayLike = (0.0, 0.0),
        leaving: bool = False,
    ) -> SlowedCommand:
        """Let through the fastest share of a twist with a proven stop.

        The twist is driven for ``dt``, then the robot brakes along the same arc, as quickly as
        ``max_deceleration`` allows. All of that is proven. If no share is, the robot brakes at
        once, on the way that the call before has proven.

        Where something is nearer than the margin, as after a person has stepped up, nothing is
        free, so the robot would stand there for ever. With ``leaving``, it may also drive if
        nothing comes nearer than the margin or than it is, and, straight on, than what is nearest
        beside the same side of the robot: the smallest proven distance never falls. Taken cells
        count as the discs around them, and depths as negative distances. On a floor, the distances
        are those sideways, of each part of the robot from the cells at its heights. A robot that is
        lost does not leave: it has a taken cell deeper inside than half of its own depth.

        Parameters
        ----------
        q : array-like, shape (3,)
            Where the robot is.
        twist : array-like, shape (2,)
            The wanted speed, m/s, and yaw rate, rad/s.
        twist_now : array-like, shape (2,)
            What it drives now: the first command of the call before.
        leaving : bool
            Also let through commands that come no nearer to near obstacles.

        Raises
        ------
        InputError
            If the gate has no ``dt`` or no ``max_deceleration``, or a twist is not two finite
            numbers or needs over 100000 commands to stop; with ``leaving``, if the map is not in
            memory or a part of the robot is neither a disc nor convex; and as :meth:`check_twists`.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.zeros((60, 40), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.2), rotations=8)
        >>> gate = cspace.Gate(space, dt=0.1, max_deceleration=(0.5, 1.0))
        >>> gate.slow_down((1.0, 2.0, 0.0), (1.0, 0.0)).share
        1.0
        >>> gate.slow_down((5.0, 2.0, 0.0), (1.0, 0.0)).share
        0.75
        >>> gate.slow_down((5.78, 2.0, 0.0), (-0.3, 0.0)).share  # it touches the border
        0.0
        >>> gate.slow_down((5.78, 2.0, 0.0), (-0.3, 0.0), leaving=True).share
        1.0
        """
        wanted = _check_twist(twist, "twist")
        now = _check_twist(twist_now, "twist_now")
        most = self._find_steps()
        # A share may not be slower than the brakes can reach.
        shares = np.arange(SHARES, 0, -1) / SHARES
        firsts = shares[:, np.newaxis] * wanted
        reached = ((now - firsts) * np.sign(now) <= most).all(axis=1)
        shares = np.append(shares[reached], 0.0)
        ramps = [self._brake(first) for first in firsts[reached]]
        ramps.append(self._brake(now, "twist_now")[1:])
        rows = max(map(len, ramps))
        chunks = np.zeros((len(ramps), max(rows, 1), 2))
        for padded, ramp in zip(chunks, ramps, strict=True):
            padded[: len(ramp)] = ramp
        batch = self._certify(q, chunks)
        warn_of_large(batch._tubes.starts, "rad", "q", self.space._angles)
        passes = np.array(batch.is_proven)
        leaves = np.zeros_like(passes)
        if leaving:
            lengths = np.array([*map(len, ramps[:-1]), 0])
            leaves = self._find_leaving(q, wanted, now, shares, lengths) & batch._tubes.keep_limits
            passes |= leaves
        # The arcs of one ramp may be cut into fewer pieces than in the batch, so test it again.
        for best in (*np.flatnonzero(passes[:-1]).tolist(), len(ramps) - 1):
            commands = chunks[best, : max(len(ramps[best]), 1)]
            chunk = self._certify(q, commands)
            if chunk or leaves[best]:
                break
        leaves_alone = bool(leaves[best]) and not chunk
        return SlowedCommand(float(shares[best]), commands, chunk, leaves_alone)

    def _find_leaving(
        self, q: ArrayLike, wanted: Floats, now: Floats, shares: Floats, lengths: Ints
    ) -> Bools:
        """Return which ramps come no nearer to near obstacles; the last one brakes at once.

        ``shares`` are those of the first twists, and ``lengths`` the numbers of commands, shape
        (n,) each.
        """
        pose = np.asarray(check_points(q, "q", TWISTING_AXES))
        tracking = np.broadcast_to(self.tracking, len(TWISTING_AXES))
        dt = self._check_dt()
        # A ramp is as long as its first twist for half the time, and half a command more.
        seconds = np.where(lengths > 0, 0.5 * dt * shares * (lengths + 1), 0.0)
        rest = 0.5 * dt * max(len(self._brake(now)) - 1, 0)
        seconds_of = self.space._find_leaving_seconds
        leaves = seconds <= seconds_of(pose, wanted, float(seconds.max()), tracking)
        leaves[-1] = rest <= seconds_of(pose, now, rest, tracking)
        return np.asarray(leaves)

    def stop_distance(self, twist: ArrayLike) -> float:
        """Return the way of one ``dt`` of a twist and braking, metres.

        ``tracking`` must cover it where :meth:`check_rows` or :meth:`check_twists` is asked.

        Raises
        ------
        InputError
            If the gate has no ``dt`` or no ``max_deceleration``, or the twist is not two finite
            numbers or needs over 100000 commands to stop.
        """
        ramp = self._brake(_check_twist(twist, "twist"))
        return float(np.abs(ramp[:, 0]).sum() * (self.dt or 0.0))

    def _brake(self, twist: Floats, name: str = "twist") -> Floats:
        """Return the twists that brake along an arc, the first included."""
        # Rounded down, so that the rest of a ramp never gets longer.
        ratio = float((np.abs(twist) / self._find_steps()).max())
        if not ratio <= MAX_RAMP:
            raise InputError(
                name,
                f"is {twist.tolist()}",
                f"it must come to rest within at most {MAX_RAMP} commands of {self.dt} s",
            )
        steps = math.ceil(ratio * (1.0 - LIMIT_ROUNDING))
        return twist * (1.0 - np.arange(steps) / max(steps, 1))[:, np.newaxis]

    def _find_steps(self) -> Floats:
        """Return a braking twist's largest change in ``dt``."""
        if self.max_deceleration is None:
            raise InputError(
                "max_deceleration",
                "is missing",
                "the robot must be able to stop",
            )
        return np.asarray(self._check_dt() * np.asarray(self.max_deceleration))

    def _certify(self, q: ArrayLike, twists: ArrayLike, before: ArrayLike | None = None) -> Chunk:
        """Prove twists with the limits of the gate."""
        places = [limit for limit in self.speed if isinstance(limit, SpeedLimit)]
        limits = self.max_velocity, self.drive, self.max_jerk, places, before
        return certify_twists(self.space, q, twists, self._check_dt(), self.tracking, *limits)

    def _check_dt(self) -> float:
        """Return the seconds of a twist; InputError if they are missing."""
        if self.dt is None:
            raise InputError(
                "dt",
                "is missing",
                "a twist is driven for some time",
            )
        return self.dt


def _name_state(chunk: Chunk) -> GateState:
    """Return how much of a chunk, or of all of a batch, may be executed."""
    if np.all(chunk.is_proven):
        return "go"
    return "shortened" if np.any(chunk.proven) else "hold"


def _list_limited(space: ConfigurationSpace, limits: JerkLimits) -> tuple[str, ...]:
    """Return the names of limits: the numbers of a twist if they are two, or the coordinates."""
    given: Any = list(limits) if isinstance(limits, Mapping) else limits
    is_twist = space.axes == TWISTING_AXES and np.size(given) == 2
    return TWIST_NAMES if is_twist else list_steps(space)


def _check_twist(twist: ArrayLike, name: str) -> Floats:
    """Return a single twist, shape (2,)."""
    values = check_finite(twist, name, TWIST_NAMES)
    if values.shape != (2,):
        rule = "a twist is a speed, m/s, and a yaw rate, rad/s"
        raise InputError(name, f"has shape {values.shape}", rule)
    warn_of_twists(values, name)
    return values
