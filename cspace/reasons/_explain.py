"""Explain why a path between two configurations exists, or does not."""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from cspace import BLOCKED, FREE, Gate
from cspace.errors import InputError
from cspace.inside import (
    Bools,
    Exterior,
    Floats,
    Ints,
    contents_of,
    map_record,
    rasters_of,
    show_png,
)
from cspace.reasons._margins import (
    copy_with_ends,
    find_cells,
    find_way,
    pad_cells,
    states_of_slices,
)
from cspace.reasons._removals import remove_obstacles
from cspace.reasons._windows import Trial, has_thin_obstacle, refine_way, suggest_finer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace import CSpace

Verdict = Literal[
    "connected",
    "disconnected",
    "undecided",
    "start BLOCKED",
    "start MIXED",
    "goal BLOCKED",
    "goal MIXED",
]
"""What is proven about a path between two configurations."""

BORDER: Final = "the border of the map"
"""Name of the space outside the grid among the obstacles of an explanation."""

SIDEWAYS: Final = "a robot that also moves sideways"
"""The robot that a path exists for, if that of the plan has a drive."""

WAY_OUTSIDE: Final = (
    "A way may lead around outside the map, because the robot does not reach a cell beyond its "
    "reference point on all sides; move its shape so that the origin is in its middle."
)
"""Sentence for robots whose positions outside the map are not proven BLOCKED."""

BARRIER_STYLE: Final[dict[str, Any]] = {
    "color": "#c2002f",
    "linestyle": "none",
    "marker": "s",
    "markersize": 4.0,
    "markeredgecolor": "white",
    "markeredgewidth": 0.4,
    "zorder": 4.5,
    "label": "cells in the way",
}
"""Markers of cells that bar a way."""

BOTTLENECK_STYLE: Final[dict[str, Any]] = {
    "color": "#c2002f",
    "linestyle": "none",
    "marker": "o",
    "markersize": 14.0,
    "fillstyle": "none",
    "zorder": 6.0,
    "label": "narrowest place",
}
"""Marker of the narrowest place of a way."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """The reason why a path between two configurations exists, or does not.

    Attributes
    ----------
    space : CSpace
        A copy of the map, which updates do not change.
    start, goal : tuple of float
        The two configurations, metres and radians.
    verdict : str
        "connected" or "disconnected", both proven; "undecided"; or the state of the start or the
        goal, for example "start BLOCKED".
    barrier : ndarray of int64, shape (n, 1 + d)
        Cells ``(rotation, x, ...)`` that are not FREE. If they were, FREE cells would join start
        and goal. Empty if they are connected.
    obstacles : tuple of str
        Obstacles that the robot may touch in the barrier; if start or goal is not FREE, those that
        it may touch there, or is proven to touch if BLOCKED. They are quoted names of
        :attr:`cspace.CSpace.obstacles`; connected pieces of the workspace by a point of theirs,
        the nearest first; and the border of the map. In a map of joints, the two solids nearest to
        touching, or without the arm's geometry a place of the cells.
    bottleneck : ndarray of float64, shape (size,)
        The narrowest configuration of the widest way between the two; if no way is FREE, of the way
        for which the robot must shrink least.
    margin : tuple of float
        Proven bounds, metres, of the largest margin that leaves a path, as :func:`cspace.build`
        takes it. A path exists for a robot grown by the lower bound, and none exists for a robot
        grown by the upper bound. A negative margin shrinks the robot. The lower bound is minus
        infinity if nothing is proven or nothing would be left of the robot, and the upper bound is
        infinity if nothing is proven. In a map of joints, in their unit: the distance that a path
        keeps from all cells that are not FREE.
    passes_without : tuple of str
        Named obstacles whose removal alone gives a path, proven. At most four are tried.
    trial : Trial
        If undecided, the spacing and the rotations that would decide, and what they decide.
    thickening : float
        If undecided, metres by which lines, points or open surfaces in the way must grow on all
        sides, so that the robot is proven to collide; 0 if cells fit into the obstacles there.
    free_yaws : tuple of ndarray of float64, shape (n, 2)
        Intervals of yaw, radians, at which start and goal are proven free; from the lower to the
        upper bound, which may be above pi. Empty arrays if the robot does not rotate.
    passes_if_turning : bool
        True if a path is proven for a robot that could change between all yaws at which it is
        free, as if turning on the spot never collided.
    moves_sideways : bool
        False for the plan of a drive, whose robot may not follow a path that exists.
    """

    space: CSpace
    start: tuple[float, ...]
    goal: tuple[float, ...]
    verdict: Verdict
    barrier: Ints
    obstacles: tuple[str, ...]
    bottleneck: Floats
    margin: tuple[float, float]
    passes_without: tuple[str, ...]
    trial: Trial | None
    thickening: float
    free_yaws: tuple[Floats, Floats]
    passes_if_turning: bool
    moves_sideways: bool = True

    @cached_property
    def sentences(self) -> list[str]:
        """At most three sentences for a person, the reason first."""
        further = [*self._describe_margin(), *self._describe_changes()]
        return [self._describe_reason(), *further][:3]

    def __str__(self) -> str:
        """Return the sentences."""
        return " ".join(self.sentences)

    def __repr__(self) -> str:
        """Return verdict and sentences."""
        return f"Explanation({self.verdict}: {self})"

    @property
    def _place_text(self) -> str:
        """Text of the bottleneck's position."""
        place = ", ".join(f"{x:.2f}" for x in self.bottleneck[: self.space.dim])
        return f"at ({place})"

    @property
    def _robot_text(self) -> str:
        """Subject of a sentence: the robot for which paths are proven."""
        return "The robot" if self.moves_sideways else SIDEWAYS.capitalize()

    @property
    def _obstacles_text(self) -> str:
        """Text that lists the first obstacles at the barrier."""
        if not self.obstacles:
            return "an obstacle"
        *most, last = self.obstacles
        # Number of obstacles that a sentence names.
        max_named_obstacles = 3
        if len(most) >= max_named_obstacles:
            *most, last = [*most[:max_named_obstacles], "others"]
        return f"{', '.join(most)} and {last}" if most else last

    @property
    def _may_pass_outside(self) -> bool:
        """Whether cells outside are undecided, although all is obstacle."""
        exterior = Exterior(map_record(self.space).exterior)
        is_blocked = exterior.is_all_blocked(self.space.grid.shape)
        return self.space.outside == "blocked" and not is_blocked.all()

    def _describe_reason(self) -> str:
        """Return the sentence of verdict and reason."""
        end, _, state = self.verdict.partition(" ")
        if state:
            proof = "touches" if state == "BLOCKED" else "may touch"
            return f"The {end} lies in a {state} cell: the robot {proof} {self._obstacles_text}."
        if self.verdict == "connected":
            exists = "exists" if self.moves_sideways else f"exists for {SIDEWAYS}"
            return f"A path {exists}; it is narrowest {self._place_text}."
        if self.verdict == "disconnected":
            return f"No path: {self._place_text} the robot does not pass {self._obstacles_text}."
        count = len(self.barrier)
        cells = "1 MIXED cell lies" if count == 1 else f"{count} MIXED cells lie"
        return f"Undecided: {self._place_text} {cells} on the way, beside {self._obstacles_text}."

    def _describe_margin(self) -> list[str]:
        """Return at most one sentence, on the margin of the robot."""
        low, high = self.margin
        if not self.space.has_poses:
            return self._describe_distance()
        around = "all around" if self.space.floor is None else "sideways"
        if low >= 0.0:
            more = "" if math.isinf(high) else f", but not by {high:.3g} m"
            return [f"The robot may grow by {low:.3g} m {around}{more}."]
        if math.isinf(low):
            return ["No shrinking of the robot is known to give a path."]
        less = f", but not by {-high:.3g} m" if high < 0.0 else ""
        return [f"{self._robot_text} passes if it shrinks by {-low:.3g} m {around}{less}."]

    def _describe_distance(self) -> list[str]:
        """Return at most one sentence, on the distance that a path of joints keeps."""
        low, high = self.margin
        unit = self.space.grid.unit
        if low < 0.0:
            return []
        less = "" if math.isinf(high) else f", and none keeps {high:.3g} {unit}"
        return [f"A path keeps {low:.3g} {unit} from all cells that are not FREE{less}."]

    def _describe_changes(self) -> list[str]:
        """Return sentences on changes that give a path, or would decide."""
        sentences = []
        if self.verdict == "undecided" and self.space.has_poses and self._may_pass_outside:
            sentences.append(WAY_OUTSIDE)
        if self.passes_without:
            names = " or ".join(map(repr, self.passes_without))
            sentences.append(f"{self._robot_text} passes without {names}.")
        if self.trial is not None:
            sentences.append(self._describe_trial(self.trial))
        if self.verdict != "connected" and self.passes_if_turning and self.space.rotations.names:
            sentences.append(f"{self._robot_text} would pass if it could turn anywhere.")
        return sentences

    def _describe_trial(self, trial: Trial) -> str:
        """Return a sentence on the finer map and what it decides."""
        turns = f" and {trial.rotations} rotations" if trial.rotations > 1 else ""
        settings = f"a spacing of {trial.spacing:.3g} {self.space.grid.unit}{turns}"
        if trial.decided in ("open", "shut"):
            return f"With {settings}, the way there is proven {trial.decided}."
        guess, change = f"Even {settings} would not decide", "thicken"
        if trial.decided == "untried":
            guess, change = f"Perhaps {settings} would decide", "if not, thicken"
        if not self.thickening:
            return f"{guess}."
        growth = f"{self.thickening:.3g} m on all sides"
        if self.space.workspace.grid.dim == 2:
            growth = f"buffer({self.thickening:.3g})"
        return f"{guess}; {change} the obstacle there: {growth}."

    def plot(self) -> Axes:
        """Draw the map with ends, barrier, and robot at the bottleneck.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from cspace.plot import extend_legend

        space = self.space
        way = self.bottleneck[np.newaxis]
        # Number of characters of a line in a picture's title.
        title = textwrap.fill(self.sentences[0], 64)
        view = "3d" if space.dim == 3 else None
        axes: Axes = space.plot(start=self.start, goal=self.goal, path=way, title=title, view=view)
        handles = axes.plot(*way[:, : space.dim].T, **BOTTLENECK_STYLE)
        if len(self.barrier):
            centers = space.grid.center_of(self.barrier[:, 1:])
            handles += axes.plot(*centers.T, **BARRIER_STYLE)
        extend_legend(axes, handles)
        return axes

    _repr_png_ = show_png


def explain(
    space: CSpace, start: ArrayLike, goal: ArrayLike, *, refine: bool = False
) -> Explanation:
    """Explain why a path between two configurations exists, or does not.

    For maps in the plane and in space, with or without a yaw, and of joints. It takes some
    seconds for a map of ten million cells.

    Parameters
    ----------
    start, goal : array-like, shape (size,)
        Configurations in the grid, FREE or not; metres, and radians.
    refine : bool
        Build finer maps while they are small, which narrow the margins. If the map leaves it
        undecided, they or finer windows around the MIXED cells on the way may decide. Not for
        joints.

    Returns
    -------
    cspace.reasons.Explanation
        ``print`` it for at most three sentences; it has the verdict, the cells and obstacles in
        the way, where the way is narrowest, and by how much the robot may grow or must shrink.

    Raises
    ------
    InputError
        If the map is tiled or of SE(3), or of joints with ``refine``, or a number is not
        finite.
    ConfigurationError
        If start or goal lies outside the grid.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> occupied = np.zeros((80, 60), dtype=bool)
    >>> occupied[40:42, :26] = occupied[40:42, 30:] = True
    >>> space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.3))
    >>> space.explain((1.0, 1.0), (7.0, 1.0)).verdict
    'disconnected'
    """
    space, points = copy_with_ends(space, start, goal)
    if refine and not space.has_poses:
        rule = "finer maps of joints need their arm"
        raise InputError("refine", "is True for a map of joints", rule)
    first, second = points
    verdict = _decide(space, points)
    way = find_way(space, points)
    position = space.grid.center_of(way.bottleneck[1:])  # without the rotation cell
    # Obstacles at the barrier; if the start or goal is not FREE, those at that end instead.
    barrier = way.cells[way.barred]
    near_barrier = find_touched_cells(space, barrier, proven=False)
    touched, pieces = _list_obstacles(space, near_barrier, position)
    # Number of named obstacles that are removed one by one, to see if a path exists without.
    removed_alone = [
        name for name in touched[:4] if remove_obstacles(space, [name]).is_connected(first, second)
    ]
    cells = find_cells(space, points)
    end, _, state = verdict.partition(" ")
    if state:
        number = ("start", "goal").index(end)
        is_blocked = state == "BLOCKED"
        near_end = find_touched_cells(space, cells[[number]], is_blocked)
        touched, pieces = _list_obstacles(space, near_end, points[number], is_blocked)
    trial = None
    thickening = 0.0
    is_decided = verdict != "undecided"
    if not is_decided and has_thin_obstacle(space, near_barrier, position):
        thickening = 2.0 * space.grid.spacing
    if refine:
        way, trial = refine_way(space, points, way, is_decided)
    elif not is_decided:
        trial = suggest_finer(space, way, can_shut=not thickening)
    free_yaws = np.empty((0, 2)), np.empty((0, 2))
    if space.rotations.names:
        free_yaws = space.free_yaws(first[:-1]), space.free_yaws(second[:-1])
    return Explanation(
        space=space,
        start=tuple(first.tolist()),
        goal=tuple(second.tolist()),
        verdict=verdict,
        barrier=barrier,
        obstacles=(*map(repr, touched), *pieces),
        bottleneck=np.concatenate([position, space.rotations.centers[way.bottleneck[0]]]),
        margin=(way.low, way.high),
        passes_without=tuple(removed_alone),
        trial=None if is_decided else trial,
        thickening=thickening,
        free_yaws=free_yaws,
        passes_if_turning=_passes_if_turning(space, cells),
    )


def _decide(space: CSpace, points: Floats) -> Verdict:
    """Return a map's verdict about start and goal, shape (2, size)."""
    for name, point in zip(("start", "goal"), points, strict=True):
        state = int(space.classify(point))
        if state != FREE:
            return f"{name} {'BLOCKED' if state == BLOCKED else 'MIXED'}"  # type: ignore[return-value]
    if space.is_connected(*points):
        return "connected"
    return "disconnected" if space.is_disconnected(*points) else "undecided"


def _list_obstacles(
    space: CSpace,
    touched: Bools,
    position: Floats,
    proven: bool = False,
) -> tuple[list[str], list[str]]:
    """List the obstacles in cells that :func:`find_touched_cells` found.

    Returns the names of named obstacles, then descriptions of other obstacles, the nearest to
    ``position`` first.
    """
    if not space.has_poses:
        refusal = Gate(space).check_rows(position, [position]).chunk.refusal
        if refusal is not None and refusal.names:
            return [], [*map(repr, refusal.names)]
    kind = "the obstacle" if space.has_poses else "the cells"
    in_grid = touched[(slice(1, -1),) * space.dim]
    names = []
    unnamed = (space.workspace.inner if proven else space.workspace.outer).copy()
    for name, shape in space.obstacles.items():
        outer, inner = shape.cells(space.workspace.grid)
        occupied = inner if proven else outer
        if (occupied & in_grid).any():
            names.append(name)
        unnamed &= ~outer
    # Cells without a name form connected pieces, diagonal neighbours included. A piece is described
    # by its touched cell nearest to the position.
    pieces, _ = ndimage.label(unnamed, structure=np.ones((3,) * unnamed.ndim))
    hits = np.argwhere(in_grid & unnamed)
    centers = space.workspace.grid.center_of(hits)
    gaps = np.linalg.norm(centers[:, : space.dim] - position[: space.dim], axis=1)
    order = np.argsort(gaps, kind="stable")
    _, nearest = np.unique(pieces[tuple(hits[order].T)], return_index=True)
    descriptions = []
    for index in np.sort(nearest):
        place = ", ".join(f"{x:.2f}" for x in centers[order[index]])
        descriptions.append(f"{kind} at ({place})")
    reaches_out = np.count_nonzero(touched) > np.count_nonzero(in_grid)
    if reaches_out and space.outside == "blocked":
        descriptions.append(BORDER)
    return names, descriptions


def find_touched_cells(space: CSpace, cells: Ints, proven: bool) -> Bools:
    """Return a mask of workspace cells that a robot may touch.

    With ``proven``, return only cells that it touches from everywhere in a configuration cell.
    ``cells`` has shape (n, 1 + d). The mask has one more cell on each side along the axes of the
    grid, for the space outside: shape (nx + 2, ny + 2, ...).
    """
    touched = pad_cells(np.zeros_like(space.workspace.outer), 1, space.dim, value=False)
    rasters = rasters_of(contents_of(space), space.margin)
    last = np.array(touched.shape) - 1
    for rotation, *position in cells.tolist():
        outer, inner = rasters[space.slice_of[rotation]]
        raster = inner if proven else outer
        offsets = np.argwhere(raster.cells) + raster.lower
        offsets[:, : space.dim] += np.array(position) + 1
        touched[tuple(np.clip(offsets, 0, last).T)] = True
    return touched


def _passes_if_turning(space: CSpace, cells: Ints) -> bool:
    """Return True if cells FREE at any yaw join two cells.

    ``cells`` have shape (2, 1 + d).
    """
    is_free_at_some = (states_of_slices(space) == FREE).any(axis=0)
    pieces, _ = ndimage.label(is_free_at_some)
    start, goal = pieces[tuple(cells[:, 1:].T)]
    return bool(start != 0 and start == goal)
