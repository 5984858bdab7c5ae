"""Streams of workspace changes, and checks of updated maps."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

import cspace
from cspace import FREE, Robot, Rotations, Workspace
from tests.helpers.handmade import MAP_KINDS, build_empty
from tests.helpers.placements import is_free_around
from tests.helpers.strategies import seeds

SPACING = 0.5
OBSTACLE = np.ones((4, 4), dtype=bool)


def build_empty_room(outside="blocked", robot=None, rotations=None):
    """Build the map of an empty room of 40 x 30 cells."""
    return build_empty((40, 30), robot or Robot.disc(0.3), outside=outside, rotations=rotations)


@dataclass
class World:
    """A changing workspace, separate from the map that follows it."""

    outer: NDArray[np.bool_]
    inner: NDArray[np.bool_]
    robot: Robot
    options: dict[str, Any]
    rng: np.random.Generator
    lower: tuple[float, ...] = field(init=False)
    turns: Rotations = field(init=False)

    def __post_init__(self):
        self.lower = tuple(self.rng.uniform(-5.0, 5.0, self.outer.ndim).tolist())
        self.turns = Rotations.of(self.options["rotations"])

    def workspace(self):
        return Workspace.from_array(self.outer, SPACING, self.lower, inner=self.inner)

    def build(self):
        return cspace.build(self.workspace(), self.robot, **self.options)

    def patch(self):
        """Draw and apply new cells of a box, often in a corner."""
        rng, shape = self.rng, self.outer.shape
        most = [n if rng.random() < 0.1 else min(n, 8) for n in shape]
        size = [int(rng.integers(1, n + 1)) for n in most]
        lower = [
            int(rng.choice([0, n - s, rng.integers(0, n - s + 1)]))
            for n, s in zip(shape, size, strict=True)
        ]
        cells = rng.random(size) < rng.choice([0.0, 0.2, 1.0])
        inner = cells & (rng.random(size) < 0.6) if rng.random() < 0.3 else None
        window = tuple(slice(low, low + s) for low, s in zip(lower, size, strict=True))
        self.outer[window], self.inner[window] = cells, cells if inner is None else inner
        return cells, lower, inner

    def points(self, n):
        """Draw configurations in and around the grid, and on its upper boundary."""
        grid = cspace.Grid(self.lower, SPACING, self.outer.shape)
        sides = np.array(self.outer.shape) * SPACING
        q = np.array(self.lower) + self.rng.uniform(-0.4, 1.4, (n, len(sides))) * sides
        q = np.where(self.rng.random(q.shape) < 0.1, grid.upper, q)
        return self.configurations(
            np.column_stack([q, self.rng.uniform(-9.0, 9.0, (n, len(self.turns.names)))])
        )

    def near(self, q, share):
        """Return configurations at a ``share`` of the way to random configurations."""
        return self.configurations(q + share * (self.points(len(q)) - q))

    def configurations(self, q):
        """Normalise the quaternions of configurations in place."""
        if len(self.turns.names) == 4:
            q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1, keepdims=True)
        return q


@st.composite
def worlds(draw, kinds=MAP_KINDS):
    """Draw maps of every kind with robots of every size."""
    kind, rng = draw(st.sampled_from(kinds)), np.random.default_rng(draw(seeds))
    dim = 3 if "space" in kind else 2
    most = {"plane": 40, "turning": 24, "space": 14}.get(kind, 8)
    longest = draw(st.sampled_from([1, 6, most]))
    turns = (
        [Rotations.quaternions(1), Rotations.quaternions(2)] if "any way" in kind else [1, 2, 5, 8]
    )
    shape = tuple(int(rng.integers(1, longest + 1)) for _ in range(dim))
    outer = rng.random(shape) < rng.choice([0.0, 0.02, 0.1, 0.5])
    inner = outer & (rng.random(shape) < 0.6) if rng.random() < 0.3 else outer.copy()
    options = {
        "outside": draw(st.sampled_from(["blocked", "free"])),
        "margin": draw(st.sampled_from([0.0, 0.4])),
        "rotations": draw(st.sampled_from(turns)) if "turning" in kind else None,
    }
    size = SPACING * draw(st.sampled_from([0.1, 1.3, 3.0, 1.5 * most]))
    away = rng.uniform(-2.0, 2.0, dim) * rng.choice([0.0, size])
    if dim == 3:
        robots = [Robot.ball(size, away), Robot.box((size, 0.7 * size, 1.5 * size))]
    else:
        wedge = Robot.polygon([(0.0, 0.0), (2.0 * size, 0.0), (0.0, size)])
        robots = [Robot.disc(size, away), Robot.rectangle(2.0 * size, size), wedge]
        robots.append(Robot.rectangle(size, size))
    return World(outer, inner, draw(st.sampled_from(robots)), options, rng)


def check(space, fresh, world):
    """Compare the answers of a map with a fresh build."""
    np.testing.assert_array_equal(space._states, fresh._states)
    assert space.count() == fresh.count()
    np.testing.assert_array_equal(space.workspace.outer, fresh.workspace.outer)
    np.testing.assert_array_equal(space.workspace.inner, fresh.workspace.inner)
    q = world.points(40)
    queries = {
        "classify": (q,),
        "overlap_count": (q,),
        "contains_robot": (q,),
        "clearance": (q,),
        "is_connected": (q[:, None], q[None]),
        "is_disconnected": (q[:, None], q[None]),
        "motion_is_free": (q, world.near(q, 0.2)),
        "certify_path": (q,),
    }
    for name, given in queries.items():
        np.testing.assert_array_equal(
            getattr(space, name)(*given), getattr(fresh, name)(*given), name
        )
    np.testing.assert_array_equal(
        is_free_around(space, q, SPACING, 0.3), is_free_around(fresh, q, SPACING, 0.3)
    )
    one = tuple(q[0].tolist())  # looked up without arrays
    assert space.clearance(one) == fresh.clearance(one)
    if (fresh._states == FREE).any():
        draws = [one.sample_free(9, np.random.default_rng(1)) for one in (space, fresh)]
        np.testing.assert_array_equal(*draws)
        np.testing.assert_array_equal(space.nearest_free(q[0]), fresh.nearest_free(q[0]))


def checkers(space):
    """Return the checkers of points and edges."""
    return space.point_checker(), space.edge_checker()


def check_agreement(ours, theirs, world):
    """Compare the answers of checkers."""
    q = world.points(30)
    for a, b in zip(q.tolist(), world.near(q, 0.1).tolist(), strict=True):
        for given, mine, other in zip(((), b), ours, theirs, strict=True):
            assert mine(*a, *given) == other(*a, *given)
