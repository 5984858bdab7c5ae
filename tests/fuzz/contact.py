"""Boxes among boxes, beside borders of cells and near contact, against separating axes.

The oracle is the theorem of separating axes (Gottschalk, 1996) in numpy. The same points are asked
for a robot that is 3 % larger, which must be noticed.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

import cspace
from benchmarks.report import Report
from cspace import BLOCKED, FREE, MIXED, Arm, Robot, Workspace
from cspace._support.arrays import Floats
from cspace.errors import ConfigurationError
from tests.fuzz.tally import Tally, draw_until
from tests.helpers.arm_oracle import sample_configurations
from tests.helpers.placements import turn_between
from tests.helpers.scenes import ROUNDING, Rng
from tests.helpers.urdfs import joint, link, posed_box, write_urdf

LARGER = 1.03
"""Size of the robot that the oracle must notice, in sizes of the robot."""

KINDS: dict[str, tuple[int, tuple[int | None, ...]]] = {
    "plane": (2, (None,)),
    "yaw": (2, (1, 7, 16, 72)),
    "space": (3, (None,)),
    "yaw in space": (3, (1, 5, 16)),
}
"""Dimension of the workspace, and numbers of yaw cells to draw from."""

POINTS = {"plane": 400_000, "yaw": 400_000, "space": 200_000, "yaw in space": 100_000}
"""Configurations a map; further ones, a thirtieth, are near contact."""

ARM_POINTS, ARM_SHARE = 4_000, 100
"""Configurations an arm, and the divisor of the number of checks, because arms are slow."""

EDGES, POINTS_PER_EDGE = 2_000, 40
"""Motions drawn per scene, and points checked of each free one."""

BISECTIONS = 30
"""Halvings between a free and a colliding configuration."""


@dataclass(frozen=True)
class Scene:
    """A space, its separation from obstacles, and a draw of configurations.

    Attributes
    ----------
    gap : callable
        Separation of each configuration (n, size) for a robot of a relative size, metres; at most
        0 if the robot touches.
    limit : float
        Largest value of a joint, radians.
    """

    name: str
    space: Any
    gap: Callable[..., Floats]
    draw: Callable[[int], Floats]
    points: int
    limit: float = np.inf


def check(report: Report, seed: int, points: int) -> None:
    """Check points of random scenes of each kind."""
    for name in (*KINDS, "arms"):
        draw = draw_arm if name == "arms" else partial(draw_map, name)
        wanted = points // (ARM_SHARE if name == "arms" else len(KINDS))

        def enough(tally: Tally, wanted: int = wanted) -> bool:
            return tally.checks["FREE"] + tally.checks["BLOCKED"] >= wanted

        def check_case(tally: Tally, number: int, draw: Any = draw) -> None:
            rng = np.random.default_rng([seed, number, len(draw.__doc__ or ""), 11])
            with suppress(ConfigurationError):  # an obstacle touches a link at every configuration
                scene = draw(rng, f"seed {seed}, case {number}")
                _check_points(tally, scene, rng)
                _check_motions(tally, scene, rng)

        tally = draw_until(report, f"contact, {name}", seed, enough, check_case)
        noticed = tally.open["larger"]
        report.check(noticed > 0, f"a robot 3 % larger: noticed at {noticed} of the FREE points")


def separate(center: Floats, turn: Floats, half: Floats, box: Floats) -> Floats:
    """Return the separation of boxes from one box, along its axes and theirs.

    Boxes have centers (n, d), axes as columns of (n, d, d) and half sides (d,), and ``box`` half
    sides (d,) around 0. A positive value proves them apart; at most 0, they touch.
    """
    size = np.abs(turn)
    own = np.abs(center) - box - size @ half
    moved = np.abs(np.einsum("nij,ni->nj", turn, center))
    theirs = moved - half - np.einsum("nij,i->nj", size, box)
    gap: Floats = np.maximum(own.max(axis=1), theirs.max(axis=1))
    is_tilted = len(half) == 3 and turn[:, 2, 2].min() < 1.0
    for i, j in np.ndindex(3, 3) if is_tilted else ():
        axis = np.cross(np.eye(3)[i], turn[:, :, j])
        length = np.linalg.norm(axis, axis=1)
        reach = np.abs(axis) @ box + np.abs(np.einsum("ni,nij->nj", axis, turn)) @ half
        along = np.abs((axis * center).sum(axis=1)) - reach
        # Nearly parallel axes are those of the faces.
        gap = np.maximum(gap, np.divide(along, length, out=gap.copy(), where=length > 1e-6))
    return gap


# ---- checks --------------------------------------------------------------------------------------


def _check_points(tally: Tally, scene: Scene, rng: Rng) -> None:
    """Check states of configurations beside borders, and of others near contact by geometry."""
    q = scene.draw(scene.points)
    gaps = scene.gap(q)
    _judge(tally, scene, q, gaps, np.asarray(scene.space.classify(q)))
    near = _approach(scene, q, gaps, rng)
    if len(near):
        exact = getattr(scene.space, "exact", scene.space)
        _judge(tally, scene, near, scene.gap(near), np.asarray(exact.classify(near)))


def _judge(tally: Tally, scene: Scene, q: Floats, gaps: Floats, states: Any) -> None:
    free, blocked = states == FREE, states == BLOCKED
    close = np.abs(gaps) <= ROUNDING
    tally.add("FREE", scene.name, q[free], gaps[free] < -ROUNDING, close[free])
    tally.add("BLOCKED", scene.name, q[blocked], gaps[blocked] > ROUNDING, close[blocked])
    if free.any():
        nearest = free & (gaps <= np.quantile(gaps[free], 0.1))
        tally.open["larger"] += int((scene.gap(q[nearest], LARGER) < -ROUNDING).sum())


def _approach(scene: Scene, q: Floats, gaps: Floats, rng: Rng) -> Floats:
    """Return configurations at tiny distances from contact, on both sides."""
    free, others = q[gaps > 0.0], q[gaps <= 0.0]
    n = min(len(free), len(others), scene.points // BISECTIONS)
    free, others = rng.permutation(free)[:n], rng.permutation(others)[:n]
    for _ in range(BISECTIONS if n else 0):
        middle = 0.5 * (free + others)
        is_free = (scene.gap(middle) > 0.0)[:, np.newaxis]
        free, others = np.where(is_free, middle, free), np.where(is_free, others, middle)
    away = rng.normal(size=free.shape)
    return free + away * 10.0 ** rng.uniform(-9.0, -1.0, (n, 1))


def _check_motions(tally: Tally, scene: Scene, rng: Rng) -> None:
    """Check points of motions that are proven free."""
    starts = scene.draw(20 * EDGES)
    starts = starts[np.asarray(scene.space.is_free(starts))][:EDGES]
    goals = starts + rng.normal(size=starts.shape) * rng.choice([0.02, 0.2, 1.0], (len(starts), 1))
    goals = np.clip(goals, -scene.limit, scene.limit)
    inside = np.asarray(scene.space.is_free(goals))
    starts, goals = starts[inside], goals[inside]
    proven = np.asarray(scene.space.motion_is_free(starts, goals))
    steps = goals[proven] - starts[proven]
    if isinstance(scene.space, cspace.CSpace) and scene.space.rotations.names:
        steps[:, -1] = turn_between(0.0, steps[:, -1])
    shares = np.linspace(0.0, 1.0, POINTS_PER_EDGE)[:, np.newaxis, np.newaxis]
    q = (starts[proven] + shares * steps).reshape(-1, starts.shape[1])
    gaps = scene.gap(q)
    tally.add("motion", scene.name, q, gaps < -ROUNDING, np.abs(gaps) <= ROUNDING)


# ---- scenes --------------------------------------------------------------------------------------


def draw_map(kind: str, rng: Rng, name: str) -> Scene:
    """Draw the map of a box among four boxes."""
    dim, counts = KINDS[kind]
    spacing = float(rng.choice([0.1, 1 / 3, rng.uniform(0.02, 1.0)]))
    cells = 60 if dim == 2 else 24
    sides = spacing * rng.uniform(0.5, cells / 4, dim)
    center = rng.choice([0.0, 0.4], dim) * sides
    boxes = spacing * np.sort(rng.uniform(0.15 * cells, 0.85 * cells, (4, 2, dim)), axis=1)
    boxes[:2] = spacing * np.round(boxes[:2] / spacing) + spacing * np.array([[0.0], [1.0]])
    bounds = np.zeros(dim), np.full(dim, spacing * cells)
    rotations = counts[rng.integers(len(counts))]
    if dim == 2:
        polygons = [shapely.box(*low, *high) for low, high in boxes]
        workspace = Workspace.from_polygons(polygons, spacing, np.concatenate(bounds))
        robot = Robot.rectangle(sides[0], sides[1], center)
    else:
        solids = [Robot.box(high - low, 0.5 * (low + high)) for low, high in boxes]
        workspace = Workspace.from_shapes(solids, spacing, np.concatenate(bounds))
        robot = Robot.box(sides, center)
    space = cspace.build(workspace, robot, rotations=rotations, outside="free")

    def gap(q: Floats, factor: float = 1.0) -> Floats:
        yaws = q[:, dim] if rotations else np.zeros(1)
        turn = Rotation.from_rotvec(yaws[:, np.newaxis] * (0.0, 0.0, 1.0)).as_matrix()
        turn = turn[:, :dim, :dim]
        at = q[:, :dim] + turn @ center
        half = 0.5 * factor * sides
        gaps = [
            separate(at - 0.5 * (low + high), turn, half, 0.5 * (high - low)) for low, high in boxes
        ]
        return np.min(gaps, axis=0)

    return Scene(f"{kind}, {name}", space, gap, partial(_draw_at_borders, space, rng), POINTS[kind])


def _draw_at_borders(space: Any, rng: Rng, n: int) -> Floats:
    """Draw configurations in and beside MIXED cells, half of their numbers on borders of cells."""
    grid, rotations = space.grid, space.rotations
    mixed = np.argwhere(space.cell_states == MIXED)
    cells = mixed[rng.integers(len(mixed), size=n)][:, -grid.dim :]
    cells = cells + rng.integers(-2, 3, cells.shape)
    inside = rng.random(cells.shape)
    part = np.where(rng.random(cells.shape) < 0.5, rng.integers(0, 2, cells.shape), inside)
    q = grid.lower + grid.spacing * (cells + part)
    q += rng.integers(-2, 3, q.shape) * np.spacing(np.abs(q).max())
    if not rotations.names:
        return q
    borders = rng.choice(np.asarray(rotations.borders), n) + rng.choice([-1e-12, 0.0, 1e-12], n)
    yaws = np.where(rng.random(n) < 0.5, borders, rng.uniform(-np.pi, np.pi, n))
    return np.column_stack([q, turn_between(0.0, yaws)])


def draw_arm(rng: Rng, name: str) -> Scene:
    """Draw a chain of two to four boxes among three boxes."""
    count = int(rng.integers(2, 5))
    half = rng.uniform(0.03, 0.15, (count, 3))
    half[:, 0] = rng.uniform(0.1, 0.3, count)
    offsets = half * (1.2, 0.0, 0.0)  # the box begins behind the axis of its joint
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    ends = np.vstack([np.zeros(3), 2.4 * offsets[:-1]])
    boxes = [(f"b{k}", rng.uniform(0.1, 0.6, 3), rng.uniform(-0.9, 0.9, 3)) for k in range(3)]
    parts = [link("l0")]
    for k in range(count):
        parts.append(joint(f"j{k}", f"l{k}", f"l{k + 1}", ends[k].tolist(), axes[k].tolist()))
        parts.append(link(f"l{k + 1}", ((2.0 * half[k]).tolist(), offsets[k].tolist())))
    with tempfile.TemporaryDirectory() as folder:
        arm = Arm.from_urdf(write_urdf(Path(folder), *parts))
    space = cspace.build_arm_space({key: posed_box(sides, *at) for key, sides, at in boxes}, arm)
    may_touch = {frozenset(pair) for pair in arm.allowed_collisions}
    pairs = [
        (a, b)
        for a, b in combinations(range(count), 2)
        if frozenset((f"l{a + 1}", f"l{b + 1}")) not in may_touch
    ]

    def gap(q: Floats, factor: float = 1.0) -> Floats:
        turn, at, placed = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3)), []
        for k in range(count):
            at = at + turn @ ends[k]
            turn = turn @ Rotation.from_rotvec(q[:, k, np.newaxis] * axes[k]).as_matrix()
            placed.append((at + turn @ offsets[k], turn))
        gaps = [
            separate(at - away, turn, factor * half[k], 0.5 * sides)
            for k, (at, turn) in enumerate(placed)
            for _, sides, away in boxes
        ]
        for a, b in pairs:
            back = np.swapaxes(placed[b][1], 1, 2)
            center = np.einsum("nij,nj->ni", back, placed[a][0] - placed[b][0])
            turned = back @ placed[a][1]
            gaps.append(separate(center, turned, factor * half[a], factor * half[b]))
        return np.min(gaps, axis=0)

    draw = partial(sample_configurations, arm, rng)
    return Scene(f"arm, {name}", space, gap, draw, ARM_POINTS, limit=3.0)
