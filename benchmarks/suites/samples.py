"""Collision checking of one configuration at a time, on a sample of the cells: what the whole map would take."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks.report import Report, is_here
from benchmarks.soak.space_geometry import merged_cells
from benchmarks.timing import Timing, interleave
from cspace import Robot, Workspace
from cspace.arrays import Bools, Floats, Ints

Checker = Callable[[Floats, float], Bools]

SAMPLE = 4000
"""Cells that are asked for the time, and as many again beside cells of another state."""

RUNS = 3


def run(
    report: Report, workspace: Workspace, radius: float, about: Mapping[str, Any], rng: np.random.Generator
) -> None:
    """Time checkers on configurations of a disc or a ball, and hold the map's answers against theirs.

    Parameters
    ----------
    report : Report
    workspace : Workspace
        With cells of side 1 from the origin.
    radius : float
        The robot's, around its reference point.
    about : mapping of str
        What is kept with each time.
    rng : numpy.random.Generator
    """
    robot = Robot.disc(radius) if workspace.grid.dim == 2 else Robot.ball(radius)
    ready = {name: make(merged_cells(_in_space(workspace.outer))) for name, make in _checkers(workspace.grid.dim)}
    if not ready:
        return
    state = cspace.build(workspace, robot, outside="free").state
    anywhere = rng.integers(0, state.shape, (SAMPLE, state.ndim))
    cells = np.concatenate([anywhere, _beside_others(state, rng)])
    q = cells + rng.random(cells.shape)
    expected = state[tuple(cells.T)]
    answers = {name: checker(q, radius) for name, checker in ready.items()}
    sample = q[:SAMPLE]
    timings = interleave({name: partial(checker, sample, radius) for name, checker in ready.items()}, RUNS)
    for name, timing in timings.items():
        whole: Timing = timing.per(SAMPLE / math.prod(state.shape))
        report.timing(f"{name}, extrapolated from {SAMPLE} cells", whole)
        report.mark(**about, way=name, extrapolated_from=SAMPLE)
    for name, hits in answers.items():
        wrong = int(((expected == cspace.FREE) & hits).sum() + ((expected == cspace.BLOCKED) & ~hits).sum())
        counts = f"{(expected == cspace.FREE).sum()} FREE and {(expected == cspace.BLOCKED).sum()} BLOCKED"
        report.check(not wrong, f"{name}: of {counts} cells, {wrong} are not so at a configuration in them")


def _beside_others(state: NDArray[np.uint8], rng: np.random.Generator) -> Ints:
    """Cells whose neighbour along the first axis has another state; none where all are alike."""
    line = rng.integers(0, state.shape[1:], (64, state.ndim - 1))
    columns = np.stack([state[(slice(None), *place)] for place in line])
    number, first = np.nonzero(columns[:, 1:] != columns[:, :-1])
    cells = np.column_stack([first + rng.integers(0, 2, len(first)), line[number]])
    return np.asarray(cells[rng.permutation(len(cells))[:SAMPLE]])


def _in_space(occupied: Bools) -> Bools:
    """Cells with three axes; those of the plane in one layer."""
    return occupied.reshape(occupied.shape + (1,) * (3 - occupied.ndim))


# ---- checkers: boxes of cells, (n, 2, 3), to a function of positions and a radius; trees are made beforehand ---------


def _shapely(boxes: Ints) -> Checker:
    import shapely

    tree = shapely.STRtree(shapely.box(boxes[:, 0, 0], boxes[:, 0, 1], boxes[:, 1, 0], boxes[:, 1, 1]))

    def check(q: Floats, radius: float) -> Bools:
        hit = np.zeros(len(q), dtype=np.bool_)
        hit[tree.query(shapely.points(q), predicate="dwithin", distance=radius)[0]] = True
        return hit

    return check


def _fcl(boxes: Ints) -> Checker:
    import fcl

    tree = fcl.DynamicAABBTreeCollisionManager()
    tree.registerObjects(
        [
            fcl.CollisionObject(fcl.Box(*size), fcl.Transform(middle))
            for size, middle in zip(*_sized(boxes), strict=True)
        ]
    )
    tree.setup()

    def check(q: Floats, radius: float) -> Bools:
        ball, hit = fcl.CollisionObject(fcl.Sphere(radius)), np.empty(len(q), dtype=np.bool_)
        for number, position in enumerate(q):
            ball.setTranslation(position)
            answer = fcl.CollisionData()
            tree.collide(ball, answer, fcl.defaultCollisionCallback)
            hit[number] = answer.result.is_collision
        return hit

    return check


def _coal(boxes: Ints) -> Checker:
    import coal

    tree = coal.DynamicAABBTreeCollisionManager()
    obstacles = [
        coal.CollisionObject(coal.Box(*size), coal.Transform3s(np.eye(3), middle))
        for size, middle in zip(*_sized(boxes), strict=True)
    ]
    for each in obstacles:
        tree.registerObject(each)
    tree.setup()

    return partial(_coal_hits, tree, obstacles)


def _coal_hits(tree: Any, obstacles: list[Any], q: Floats, radius: float) -> Bools:
    """Ask coal; ``kept`` are the tree's objects, which it does not keep alive."""
    import coal

    ball, hit = coal.CollisionObject(coal.Sphere(radius)), np.empty(len(q), dtype=np.bool_)
    for number, position in enumerate(q):
        ball.setTranslation(position)
        ball.computeAABB()
        answer = coal.CollisionCallBackDefault()
        tree.collide(ball, answer)
        hit[number] = answer.data.result.isCollision()
    return hit


def _sized(boxes: Ints) -> tuple[list[Any], list[Any]]:
    """Sides and middles."""
    return list((boxes[:, 1] - boxes[:, 0]).astype(np.float64)), list(boxes.mean(axis=1))


LIBRARIES: dict[str, tuple[str, Callable[[Ints], Checker], tuple[int, ...]]] = {
    "shapely": ("shapely", _shapely, (2,)),
    "FCL": ("fcl", _fcl, (3,)),
    "coal": ("coal", _coal, (3,)),
}
"""Package, checker, and the dimensions that it is asked in."""


def _checkers(dim: int) -> list[tuple[str, Callable[[Ints], Checker]]]:
    return [(name, make) for name, (package, make, dims) in LIBRARIES.items() if dim in dims and is_here(package)]
