"""Proofs from trees of balls, against exact geometry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from benchmarks.report import Report
from cspace._shapes.mesh import Mesh
from cspace._support.arrays import Floats
from cspace.errors import InputError
from cspace.spectral import ContactTest, Verdict, decompose
from tests.fuzz.scenes import Rng, Scale, draw_polygon, draw_solid
from tests.fuzz.tally import Tally, draw_until
from tests.helpers.regions import Body, Flat

SOLIDS = ("boxes", "hull", "stars")
BALLS_PER_BODY = {2: (10, 60), 3: (10, 50)}
"""Range of the number of balls per body, by dimension."""

POOL = 16
"""Number of bodies decomposed per dimension and seed.

Pairs are scaled, rotated and translated copies.
"""

ROTATIONS_PER_PAIR = 4
PLACEMENTS_PER_ROTATION = 500
"""Placements tested per rotation, a third near contact."""

BISECTION_STEPS = 45
"""Bisection steps to find a contact."""

LOG_CONTACT_DISTANCES = (-11.0, -0.7)
"""Range of log10 of the distance from contact, in sizes of the domain."""

Balls = tuple[Floats, Floats]


@dataclass(frozen=True)
class Part:
    """A polygon or the triangles of a mesh, and balls outside and inside of it.

    Inner balls are None if none fits.
    """

    shape: Any
    outer: Balls
    inner: Balls | None

    def place(self, scale: float, matrix: Floats, away: Floats) -> Part:
        """Scale, rotate and translate."""

        def move(points: Floats) -> Floats:
            return scale * points @ matrix.T + away

        flat = len(matrix) == 2
        shape = shapely.transform(self.shape, move) if flat else move(self.shape)
        outer, inner = (
            balls and (move(balls[0]), scale * balls[1]) for balls in (self.outer, self.inner)
        )
        return Part(shape, outer, inner)


@cache
def draw_part(seed: int, index: int, dim: int) -> Part:
    """Return a body of the pool, about 1 m across."""
    rng, metres = np.random.default_rng([seed, index, 20 + dim]), Scale(1.0, 0.0, 0.0)
    if dim == 2:
        shape: Any = draw_polygon(rng, np.zeros(2), 1.0, metres)
        solid = shape
    else:
        shape = draw_solid(rng, SOLIDS[index % 3], 1.0, metres)
        shape = shape - shape.mean(axis=(0, 1))
        solid = Mesh(shape.reshape(-1, 3), np.arange(3 * len(shape)).reshape(-1, 3))
    number = int(rng.integers(*BALLS_PER_BODY[dim]))
    outer = decompose(solid, kind="outer", number=number)
    try:
        inner = decompose(solid, kind="inner", number=number)
    except InputError:  # no ball fits
        return Part(shape, (outer.centers, outer.radii), None)
    return Part(shape, (outer.centers, outer.radii), (inner.centers, inner.radii))


def unite(parts: list[Part]) -> Any:
    """Return the exact region of parts."""
    shapes = [part.shape for part in parts]
    return Body.join(shapes) if isinstance(shapes[0], np.ndarray) else Flat(shapes)


def draw_pair(seed: int, number: int, dim: int) -> tuple[ContactTest, Any, Any]:
    """Draw a contact test, and the exact regions of its moving and its fixed bodies."""
    rng = np.random.default_rng([seed, number, 30 + dim])
    size = float(10.0 ** rng.uniform(-2.0, 2.0))
    away = size * rng.choice([0.0, 3.0]) * rng.normal(size=dim)
    a = draw_part(seed, number % POOL, dim).place(size, np.eye(dim), away)
    corner = size * float(rng.choice([0.0, 30.0])) * rng.normal(size=dim)
    b = [
        draw_part(seed, int(rng.integers(POOL)), dim).place(
            size * float(rng.uniform(0.5, 2.0)),
            Rotation.from_rotvec((rng.normal(size=3)) * (dim == 3)).as_matrix()[:dim, :dim],
            corner + size * rng.uniform(-1.5, 1.5, dim),
        )
        for _ in range(int(rng.integers(1, 4)))
    ]
    inner = bool(rng.random() < 0.9)
    return make_contact_test(a, b, inner), unite([a]), unite(b)


def make_contact_test(a: Part, b: list[Part], inner: bool) -> ContactTest:
    """Return the contact test of bodies."""
    sets = [a.outer, _join([each.outer for each in b])]
    if inner and a.inner is not None and all(each.inner is not None for each in b):
        sets += [a.inner, _join([each.inner for each in b])]
    return ContactTest(*sets)


def _join(balls: list[Any]) -> Balls:
    centers, radii = zip(*balls, strict=True)
    return np.concatenate(centers), np.concatenate(radii)


# ---- checks --------------------------------------------------------------------------------------


def check(report: Report, seed: int, wanted: int) -> None:
    """Check random pairs until enough placements were tested."""
    for dim in (2, 3):

        def check_case(tally: Tally, number: int, dim: int = dim) -> None:
            rng = np.random.default_rng([seed, number, 40 + dim])
            test, a, b = draw_pair(seed, number, dim)
            for _ in range(ROTATIONS_PER_PAIR):
                _check_pose(tally, f"draw_pair({seed}, {number}, {dim})", test, a, b, rng)

        title = f"verdicts from balls in {dim} dimensions"
        draw_until(report, title, seed, lambda tally: tally.checks["placed"] >= wanted, check_case)


def _check_pose(tally: Tally, name: str, test: ContactTest, a: Any, b: Any, rng: Rng) -> None:
    """Check verdicts at one rotation."""
    yaw, dim = float(rng.uniform(-np.pi, np.pi)), test.dim
    vector = yaw * np.array([0.0, 0.0, 1.0]) if dim == 2 else rng.normal(size=3)
    turn = Rotation.from_rotvec(vector)
    rotation = [yaw] if dim == 2 else turn.as_quat()
    rotated = test.rotated(turn.as_matrix()[:2, :2] if dim == 2 else turn)

    def collide(ts: Floats) -> Any:
        q = np.column_stack([ts, np.tile(rotation, (len(ts), 1))])
        return a.within(b, q, np.zeros(len(ts)))

    low, high = find_domain(rotated)
    ts = rng.uniform(low, high, (PLACEMENTS_PER_ROTATION, dim))
    ts[:: PLACEMENTS_PER_ROTATION // 10] += rng.choice([-1.0, 1.0]) * (high - low)
    contacts = _draw_contacts(rotated, collide, ts, rng)
    ts[len(ts) - len(contacts) :] = contacts
    meets, verdicts = collide(ts), rotated.separated(ts)
    name = f"{name} at rotation {rotation}"
    tally.add("placed", name, ts, np.zeros(len(ts), dtype=bool), verdicts == Verdict.UNDECIDED)
    for verdict, wrong in ((Verdict.MISS, meets), (Verdict.HIT, ~meets)):
        claimed = verdicts == verdict
        tally.add(verdict.name, name, ts[claimed], wrong[claimed])


def find_domain(test: ContactTest) -> tuple[Floats, Floats]:
    """Return the lower and upper corner of a box of the placements at which root balls meet."""
    a, b = (tree[0] for tree in test._placed[:2])
    center = (b - a)[: test.dim]
    return center - (a[3] + b[3]), center + (a[3] + b[3])


def _draw_contacts(test: ContactTest, collide: Any, ts: Floats, rng: Rng) -> Floats:
    """Draw placements near contact, a third of ``ts``."""
    touching = ts[collide(ts)]
    if not len(touching):
        return ts[:0]
    low, high = find_domain(test)
    size, number = float(np.linalg.norm(high - low)), len(ts) // 3
    starts = touching[rng.integers(len(touching), size=number // 5)]
    directions = rng.normal(size=starts.shape)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    near, far = np.zeros(len(starts)), np.full(len(starts), 2.0 * size)
    for _ in range(BISECTION_STEPS):
        center = 0.5 * (near + far)
        meets = collide(starts + center[:, None] * directions)
        near, far = np.where(meets, center, near), np.where(meets, far, center)
    picked = rng.integers(len(starts), size=number)
    off = size * 10.0 ** rng.uniform(*LOG_CONTACT_DISTANCES, number)
    off *= rng.choice([-1.0, 1.0], number)
    return starts[picked] + (far[picked] + off)[:, None] * directions[picked]
