"""Changes of a workspace that a map follows, against a build of the whole map anew."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Any

import numpy as np
import shapely
from shapely import affinity

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import Timing, interleave
from cspace import CSpace, Robot, Workspace
from cspace.engines import ENGINES

SIZE, ACROSS, BOX = 4096, 65, 32
"""Cells of the map, of the disc, and of the side of the box that changes, for which the target is meant."""

LEAST = 30.0
"""How many times longer a build should take than an update."""

UPDATES = 200
"""Updates of one timed run."""

MOVES = 40
"""Moves of one obstacle."""

FLOORS = ("maps/depot.yaml", "maps/willow-full-0.05.yaml", "maps/100by100_10.yaml")
MOST = 20.0
"""Milliseconds that a move may take on the largest of these floors, with the questions that follow it."""


def run(report: Report, seed: int) -> None:
    """Maps in the plane, with and without what is kept beside the states, turning ones, and maps in space."""
    rng = np.random.default_rng(seed)
    size = 1024 if report.quick else SIZE
    plane = Workspace.from_array(inputs.boxes(size, 0.06, rng), 1.0)
    report.section(f"{size} x {size} cells, 6 % in boxes, disc {ACROSS} cells across; boxes of {BOX} x {BOX} cells")
    _compare(report, plane, Robot.disc(ACROSS / 2), rng, {}, judged=size == SIZE)
    size = 256 if report.quick else 1024
    turning = Workspace.from_array(inputs.boxes(size, 0.06, rng), 1.0)
    report.section(f"{size} x {size} cells x 72 yaws, rectangle 33 x 21 cells; boxes of {BOX} x {BOX} cells")
    _compare(report, turning, Robot.rectangle(33.0, 21.0), rng, {"rotations": 72}, judged=False)
    size = 96 if report.quick else 256
    space = Workspace.from_array(inputs.boxes(size, 0.06, rng, 3), 1.0)
    report.section(f"{size}^3 cells, ball 21 cells across; boxes of 16^3 cells")
    _compare(report, space, Robot.ball(10.5), rng, {}, judged=False)
    if inputs.data_folder() is None:
        report.note(inputs.NO_DATA)
        return
    for name in FLOORS[:1] if report.quick else FLOORS:
        floor = inputs.real_map(name)
        if floor is not None:
            _moves(report, floor, name)


def _moves(report: Report, floor: Workspace, name: str) -> None:
    """An obstacle that moves in a real map with 72 yaw cells, by 0.16 m a step and from end to end.

    Components and distances were asked for before. A move is one call and the first question of each kind after it, so
    that nothing is put off; the robot is not symmetric, and no two yaw cells share a slice. Costmaps are timed apart.
    """
    report.section(f"{name}, {' x '.join(map(str, floor.grid.shape))} cells x 72 yaws; trolley of 1.2 m x 0.8 m")
    space = cspace.build(floor, Robot.rectangle(0.9, 0.6, (0.15, 0.0)), rotations=72)
    q = space.sample_free(MOVES + 3, np.random.default_rng(1))
    space.path_exists(q[-1], q[-2])
    space.clearance(q[-3])
    cspace.build(floor, Robot.disc(0.2)).to_costmap()  # compiles
    first = Timing(None)
    first.take(space.to_costmap)
    report.timing("costmap", first)
    trolley, turns = shapely.box(-0.6, -0.4, 0.6, 0.4), list(enumerate(np.arange(MOVES) * 0.08))
    boxes = {
        "steps round a circle": [(*(q[0, :2] + 2.0 * np.array([np.cos(a), np.sin(a)])), 9.0 * k) for k, a in turns],
        "leaps across the map": [(*q[k, :2], 9.0 * k) for k in range(MOVES)],
    }
    for way, places in boxes.items():
        move, asked, distance, costs = Timing(None), Timing(None), Timing(None), Timing(None)
        for x, y, angle in places:
            moved = affinity.translate(affinity.rotate(trolley, angle, origin=(0, 0)), x, y)
            move.take(lambda moved=moved: space.place("trolley", moved))
            asked.take(lambda: space.path_exists(q[-1], q[-2]))
            distance.take(lambda: space.clearance(q[-3]))
            costs.take(space.to_costmap)
        report.timing(f"{way}: place", move)
        report.timing(f"{way}: path_exists after it", asked)
        report.timing(f"{way}: clearance after that", distance)
        report.timing(f"{way}: costmap after that", costs)
        each = [sum(taken) for taken in zip(move.cpu, asked.cpu, distance.cpu, strict=True)]
        most = MOST if name == FLOORS[-1] else None
        report.figure(f"{way}: all three, CPU time in the median", 1e3 * float(np.median(each)), "ms", most=most)
    fresh = cspace.build(space.workspace, space.robot, rotations=72)
    report.check(bool((space.state == fresh.state).all()), "states equal those of a build")
    answers = [one.path_exists(q[:20], q[20:40]) for one in (space, fresh)]
    report.check(np.array_equal(*answers), "path_exists equals that of a build")
    report.check(space.to_costmap().data == fresh.to_costmap().data, "costmap equals that of a build")


def _compare(
    report: Report, workspace: Workspace, robot: Robot, rng: np.random.Generator, options: dict[str, Any], judged: bool
) -> None:
    runs = 3 if report.quick else 7
    updates = UPDATES if workspace.grid.dim == 2 and not options else UPDATES // 10
    space = cspace.build(workspace, robot, **options)
    change = _changes(space, rng, updates)
    calls: dict[str, Callable[[], Any]] = {f"{updates} updates": change, "build": partial(_build, space, options)}
    for engine in ENGINES:
        calls[f"build, {engine}"] = partial(_build, space, options | {"method": engine})
    timings = interleave(calls, runs)
    each = timings.pop(f"{updates} updates").per(updates)
    report.timing("an update", each)
    for name, timing in timings.items():
        report.timing(name, timing)
        report.ratio(f"{name} / an update", timing, each, least=LEAST if judged and name == "build" else None)
    report.check(
        bool((space.state == cspace.build(space.workspace, robot, **options).state).all()),
        "states equal those of a build",
    )
    _parts(report, space, change, updates, runs, options)


def _parts(
    report: Report, space: CSpace, change: Callable[[], None], updates: int, runs: int, options: dict[str, Any]
) -> None:
    """The same with distances, and then also components, that were asked for before, against a build that is asked."""
    corners = space.grid.center_of([(0,) * space.grid.dim, np.array(space.grid.shape) - 1])
    points = np.random.default_rng(0).uniform(corners[0], corners[1], (500, space.grid.dim))
    turns = np.linspace(-3.0, 3.0, len(points))[:, None]
    q = np.concatenate([points, turns], axis=1)[:, : space.dof]
    asks: dict[str, Callable[[CSpace], Any]] = {
        "clearances": lambda asked: asked.clearance(q),
        "path_exists": lambda asked: asked.path_exists(q[:250], q[250:]),
    }
    for what, ask in asks.items():
        ask(space)

        def update_and_ask(ask: Callable[[CSpace], Any] = ask) -> None:
            _toggle(space)
            ask(space)

        def build_and_ask(ask: Callable[[CSpace], Any] = ask) -> None:
            ask(_build(space, options))

        timings = interleave({"updates": change, "asked": update_and_ask, "anew": build_and_ask}, runs)
        each = timings["updates"].per(updates)
        report.timing(f"an update of a map that was asked for {what}", each)
        report.timing(f"an update and {what} after it", timings["asked"])
        report.ratio(f"a build and {what} / an update and {what}", timings["anew"], timings["asked"])
        fresh = cspace.build(space.workspace, space.robot, **options)
        report.check(np.array_equal(ask(space), ask(fresh)), f"{what} equal those of a build")


def _changes(space: CSpace, rng: np.random.Generator, updates: int) -> Callable[[], None]:
    """A call that fills or empties boxes at random places, each time the other way round, so that cells do change."""
    side = BOX if space.grid.dim == 2 else BOX // 2
    places = rng.integers(0, np.array(space.grid.shape) - side, (updates, space.grid.dim)).tolist()
    fills = [np.full((side,) * space.grid.dim, fill) for fill in (False, True)]
    turn = count()

    def change() -> None:
        way = next(turn)
        for number, place in enumerate(places):
            space.update(fills[(number + way) % 2], place)

    return change


def _toggle(space: CSpace) -> None:
    """Turn the cell in the middle of the map into an obstacle, or free it."""
    place = tuple(n // 2 for n in space.grid.shape)
    space.update(np.full((1,) * space.grid.dim, not space.workspace.outer[place]), place)


def _build(space: CSpace, options: dict[str, Any]) -> CSpace:
    return cspace.build(space.workspace, space.robot, **options)
