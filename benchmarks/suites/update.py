"""Updates of maps, against new builds."""

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
from cspace._engines import ENGINES

MAP_SIDE, DISC_DIAMETER, BOX_SIDE = 4096, 65, 32
"""Sides of the map and of the box that changes, and diameter of the disc, cells."""

MIN_BUILD_RATIO = 30.0
"""Target: minimum time of a build over that of an update."""

UPDATES_PER_RUN = 200
"""Number of updates in one timed run."""

MOVES = 40
"""Number of moves of one obstacle."""

FLOORS = ("maps/depot.yaml", "maps/willow-full-0.05.yaml", "maps/100by100_10.yaml")
MAX_MOVE_MILLISECONDS = 20.0
"""Target: maximum time of a move on the largest floor with the next is_connected, milliseconds."""


def run(report: Report, seed: int) -> None:
    """Update boxes of maps, and move an obstacle on real floors."""
    rng, quick = np.random.default_rng(seed), report.quick
    for size, dim, robot, name, options in (
        (
            1024 if quick else MAP_SIDE,
            2,
            Robot.disc(DISC_DIAMETER / 2),
            f"disc {DISC_DIAMETER} cells across",
            {},
        ),
        (
            256 if quick else 1024,
            2,
            Robot.rectangle(33.0, 21.0),
            "rectangle 33 x 21 cells, 72 yaws",
            {"rotations": 72},
        ),
        (96 if quick else 256, 3, Robot.ball(10.5), "ball 21 cells across", {}),
    ):
        workspace = Workspace.from_array(inputs.boxes(size, 0.06, rng, dim), 1.0)
        side = BOX_SIDE if dim == 2 else BOX_SIDE // 2
        shape, box = (" x ".join([str(n)] * dim) for n in (size, side))
        report.section(f"{shape} cells, 6 % in boxes, {name}; boxes of {box} cells")
        _compare(
            report, workspace, robot, rng, options, MIN_BUILD_RATIO if size == MAP_SIDE else None
        )
    if inputs.data_folder() is None:
        report.note(inputs.NO_DATA)
        return
    for name in FLOORS[:1] if quick else FLOORS:
        floor = inputs.real_map(name)
        if floor is not None:
            _moves(report, floor, name)


def _moves(report: Report, floor: Workspace, name: str) -> None:
    """Move an obstacle in a real map with 72 yaw cells, by small and large steps.

    Caches are filled first. The next look-up of each kind refreshes or fills caches. The robot is
    asymmetric, so no yaw cells share a slice.
    """
    report.section(
        f"{name}, {' x '.join(map(str, floor.grid.shape))} cells x 72 yaws; trolley of 1.2 m x 0.8 m"
    )
    space = cspace.build(floor, Robot.rectangle(0.9, 0.6, (0.15, 0.0)), rotations=72)
    q = space.sample_free(MOVES + 3, np.random.default_rng(1))
    space.is_connected(q[-1], q[-2])
    space.clearance(q[-3])
    cspace.build(floor, Robot.disc(0.2)).to_costmap()  # compiles
    first = Timing(None)
    first.take(space.to_costmap)
    report.timing("costmap", first)
    trolley, turns = shapely.box(-0.6, -0.4, 0.6, 0.4), list(enumerate(np.arange(MOVES) * 0.08))
    boxes = {
        "steps round a circle": [
            (*(q[0, :2] + 2.0 * np.array([np.cos(a), np.sin(a)])), 9.0 * k) for k, a in turns
        ],
        "leaps across the map": [(*q[k, :2], 9.0 * k) for k in range(MOVES)],
    }
    for way, places in boxes.items():
        timings = {
            name: Timing(None)
            for name in ("place", "is_connected after it", "clearance after that", "costmap")
        }
        move, asked, distance, costs = timings.values()
        for x, y, angle in places:
            moved = affinity.translate(affinity.rotate(trolley, angle, origin=(0, 0)), x, y)
            move.take(lambda moved=moved: space.add_obstacle("trolley", moved))
            asked.take(lambda: space.is_connected(q[-1], q[-2]))
            distance.take(lambda: space.clearance(q[-3]))
            costs.take(space.to_costmap)
        report.timings({f"{way}: {name}": timing for name, timing in timings.items()})
        each = [sum(taken) for taken in zip(move.cpu, asked.cpu, strict=True)]
        most = MAX_MOVE_MILLISECONDS if name == FLOORS[-1] else None
        report.figure(
            f"{way}: place and is_connected, median CPU time",
            1e3 * float(np.median(each)),
            "ms",
            most=most,
        )
    fresh = cspace.build(space.workspace, space.robot, rotations=72)
    report.check(
        bool((space.cell_states == fresh.cell_states).all()), "states equal those of a build"
    )
    answers = [one.is_connected(q[:20], q[20:40]) for one in (space, fresh)]
    report.check(np.array_equal(*answers), "is_connected equals that of a build")
    report.check(
        space.to_costmap().data == fresh.to_costmap().data, "costmap equals that of a build"
    )


def _compare(
    report: Report,
    workspace: Workspace,
    robot: Robot,
    rng: np.random.Generator,
    options: dict[str, Any],
    least: float | None,
) -> None:
    """Compare updates of random boxes with new builds."""
    space = cspace.build(workspace, robot, **options)
    dim, side = space.grid.dim, BOX_SIDE if space.grid.dim == 2 else BOX_SIDE // 2
    updates = UPDATES_PER_RUN if dim == 2 and not options else UPDATES_PER_RUN // 10
    places = rng.integers(0, np.array(space.grid.shape) - side, (updates, dim)).tolist()
    fills, turns = [np.full((side,) * dim, fill) for fill in (False, True)], count()

    def change() -> None:
        phase = next(turns)  # boxes are filled and emptied alternately, so that cells change
        for number, place in enumerate(places):
            space.update(fills[(number + phase) % 2], place)

    def build(method: str = "auto") -> CSpace:
        return cspace.build(space.workspace, space.robot, method=method, **options)

    calls: dict[str, Callable[[], Any]] = {"an update": change, "build": build}
    calls |= {f"build, {engine}": partial(build, engine) for engine in ENGINES}
    timings = interleave(calls, 3 if report.quick else 7)
    each = timings.pop("an update").per(updates)
    report.timing("an update", each)
    for name, timing in timings.items():
        report.timing(name, timing)
        report.ratio(f"{name} / an update", timing, each, least=least if name == "build" else None)
    report.check(
        bool((space.cell_states == build().cell_states).all()), "states equal those of a build"
    )
