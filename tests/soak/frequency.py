"""Proofs from frequencies, against exact geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
import shapely
import trimesh
from scipy.spatial.transform import Rotation

from benchmarks.report import Report
from cspace.errors import InputError
from cspace.shapes.mesh import Mesh
from cspace.spectral import Bump, FourierOverlap, Verdict, decompose
from cspace.support.arrays import Bools, Bytes, Floats
from tests.soak import plane
from tests.soak.solids import Blocks, SolidSurface, SurfacePair, draw_directions
from tests.soak.space import draw_dented_ball
from tests.soak.tally import Drawn, Rng, Tally, draw_until

Oracle = Callable[[Floats], Bools]

BUMP_EXPONENTS = (1.0, 2.0, 2.0, 3.0, 4.0)
"""Exponents of bumps to draw from."""

BALLS_PER_BODY = {2: (10, 60), 3: (10, 50)}
"""Range of the number of balls per body, by dimension."""

TOLERANCES = {2: (0.01, 0.1), 3: (0.1, 0.5)}
"""Tolerances of the bands, by dimension; low bands decide less, but faster."""

POOL = 16
"""Number of bodies decomposed per dimension and seed.

Pairs are scaled, rotated and translated copies; the balls grow by far more than this rounds.
"""

ROTATIONS_PER_PAIR = 4
"""Rotations tested per pair."""

PLACEMENTS_PER_ROTATION = 500
"""Placements tested per rotation, a third near contact."""

BISECTION_STEPS = 45
"""Bisection steps to find a contact."""

LOG_CONTACT_DISTANCES = (-11.0, -0.7)
"""Range of log10 of the distance from contact, in sizes of the domain."""


@dataclass(frozen=True)
class Body:
    """A polygon or closed mesh, and its balls.

    Outer balls cover the body; inner balls lie in it, and are None if none fits.
    """

    kind: str
    shape: Any
    outer: tuple[Floats, Floats]
    inner: tuple[Floats, Floats] | None

    @classmethod
    def of(cls, kind: str, shape: Any, number: int) -> Body:
        """Decompose a body into ``number`` outer and inner balls."""
        solid = (
            Mesh(shape.reshape(-1, 3), np.arange(len(shape) * 3).reshape(-1, 3))
            if _is_solid(shape)
            else shape
        )
        outer = decompose(solid, kind="outer", number=number)
        try:
            inner = decompose(solid, kind="inner", number=number)
        except InputError:  # no ball fits
            return cls(kind, shape, (outer.centers, outer.radii), None)
        return cls(kind, shape, (outer.centers, outer.radii), (inner.centers, inner.radii))

    def place(self, scale: float, matrix: Floats, away: Floats) -> Body:
        """Scale, rotate and translate the body."""

        def move(points: Floats) -> Floats:
            return np.asarray(scale * points @ matrix.T + away)

        shape = move(self.shape) if _is_solid(self.shape) else shapely.transform(self.shape, move)
        outer = (move(self.outer[0]), scale * self.outer[1])
        inner = (move(self.inner[0]), scale * self.inner[1]) if self.inner is not None else None
        return Body(self.kind, shape, outer, inner)


def _is_solid(shape: Any) -> bool:
    return isinstance(shape, np.ndarray)


@dataclass(frozen=True)
class PairCase(Drawn):
    """A moving body, fixed bodies, and their overlap."""

    a: Body
    b: list[Body]
    overlap: FourierOverlap

    def rotate(self, rng: Rng) -> tuple[Floats, FourierOverlap, Oracle]:
        """Draw a rotation; return it, its overlap and its oracle."""
        if self.overlap.dim == 2:
            yaw = float(rng.uniform(-np.pi, np.pi))
            matrix = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            return np.array([yaw]), self.overlap.rotated(matrix), oracle(self.a, self.b, matrix)
        rotation = Rotation.from_quat(rng.normal(size=4))
        return (
            rotation.as_quat(),
            self.overlap.rotated(rotation),
            oracle(self.a, self.b, rotation.as_matrix()),
        )


def oracle(a: Body, b: list[Body], matrix: Floats) -> Oracle:
    """Return a function that tests translations for collisions."""
    if len(matrix) == 2:
        shape, others = plane.Shape([a.shape]), [body.shape for body in b]
        shapely.prepare(others)
        yaw = np.arctan2(matrix[1, 0], matrix[0, 0])
        return lambda ts: shape.meets(others, np.column_stack([ts, np.full(len(ts), yaw)]), 0.0)
    pair = SurfacePair(
        SolidSurface.of_bodies([a.shape @ matrix.T]),
        SolidSurface.of_bodies([each.shape for each in b]),
    )
    return lambda ts: pair.within(ts, np.zeros(len(ts)))


@cache
def draw_pool_body(seed: int, index: int, dim: int) -> Body:
    """Return a body of the pool, about 1 m across."""
    rng = np.random.default_rng([seed, index, 20 + dim])
    kind = list(BODIES[dim])[index % len(BODIES[dim])]
    return Body.of(kind, BODIES[dim][kind](rng), int(rng.integers(*BALLS_PER_BODY[dim])))


def draw_pair(seed: int, number: int, dim: int) -> PairCase:
    """Draw a pair, reproducibly."""
    rng = np.random.default_rng([seed, number, 30 + dim])
    size = float(10.0 ** rng.uniform(-2.0, 2.0))
    a = draw_pool_body(seed, number % POOL, dim).place(
        size, np.eye(dim), size * rng.choice([0.0, 3.0]) * rng.normal(size=dim)
    )
    corner = size * float(rng.choice([0.0, 30.0])) * rng.normal(size=dim)
    b = [
        draw_pool_body(seed, int(rng.integers(POOL)), dim).place(
            size * float(rng.uniform(0.5, 2.0)),
            draw_rotation_matrix(rng, dim),
            corner + size * rng.uniform(-1.5, 1.5, dim),
        )
        for _ in range(int(rng.integers(1, 4)))
    ]
    bump, tolerance, classes = (
        Bump(float(rng.choice(BUMP_EXPONENTS))),
        float(rng.choice(TOLERANCES[dim])),
        int(rng.integers(1, 9)),
    )
    overlap = compute_overlap(
        a, b, float(rng.uniform(0.3, 1.2)), classes, bump, tolerance, inner=bool(rng.random() < 0.9)
    )
    others = " and ".join(sorted({each.kind for each in b}))
    name = (
        f"{a.kind} of {size:.3g} m among {others}, {bump}, {classes} classes of radii, {overlap.frequencies} "
        f"frequencies, threshold {overlap.threshold:.3g}"
    )
    return PairCase(name, f"draw_pair({seed}, {number}, {dim})", (others, a.kind), a, b, overlap)


def compute_overlap(
    a: Body, b: list[Body], share: float, classes: int, bump: Bump, tolerance: float, inner: bool
) -> FourierOverlap:
    """Return the overlap of bodies of growing balls.

    Balls grow by a share of the smaller median radius.
    """
    sets = [a.outer, _join_sets([each.outer for each in b])]
    if inner and a.inner is not None and all(each.inner is not None for each in b):
        sets += [a.inner, _join_sets([each.inner for each in b if each.inner is not None])]
    swell = share * float(min(np.median(radii) for _, radii in sets[:2]))
    return FourierOverlap.of_shapes(
        *sets, swell=swell, classes=classes, bump=bump, tolerance=tolerance
    )


def _join_sets(sets: list[tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    return np.concatenate([centers for centers, _ in sets]), np.concatenate(
        [radii for _, radii in sets]
    )


def draw_rotation_matrix(rng: Rng, dim: int) -> Floats:
    """Draw a rotation matrix."""
    matrix = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
    matrix[:, 0] *= np.sign(np.linalg.det(matrix))
    return np.asarray(matrix)


# ---- bodies around the origin, up to two metres across -------------------------------------------


def _star(rng: Rng) -> Any:
    corners = int(rng.integers(3, 12))
    turns = 2.0 * np.pi * (np.arange(corners) + rng.uniform(0.0, 0.6, corners)) / corners
    return shapely.Polygon(
        rng.uniform(0.3, 1.0, (corners, 1)) * np.column_stack([np.cos(turns), np.sin(turns)])
    )


def _ring(rng: Rng) -> Any:
    center = shapely.Point(0.0, 0.0)
    hole = center.buffer(float(rng.uniform(0.2, 0.8)), quad_segs=2)
    return center.buffer(1.0, quad_segs=int(rng.integers(2, 6))).difference(hole)


def _rectangle(rng: Rng) -> Any:
    half = rng.uniform(0.1, 1.0, 2)
    return shapely.box(*-half, *half)


def _ell(rng: Rng) -> Any:
    a, b = rng.uniform(0.2, 0.8, 2)
    return shapely.Polygon(
        np.array([(0.0, 0.0), (1.0, 0.0), (1.0, b), (a, b), (a, 1.0), (0.0, 1.0)]) - 0.5
    )


def _hull(rng: Rng) -> Floats:
    points = draw_directions(int(rng.integers(5, 16)), rng) * rng.uniform(0.4, 1.0, 3)
    return np.asarray(trimesh.convex.convex_hull(points).triangles)


def _box(rng: Rng) -> Floats:
    half = rng.uniform(0.1, 1.0, 3)
    return np.asarray(Blocks.boxes(np.array([-half, half])).to_surface().triangles)


def _prism(rng: Rng) -> Floats:
    return np.asarray(
        trimesh.creation.extrude_polygon(_ell(rng), float(rng.uniform(0.2, 1.0))).triangles
    )


BODIES: dict[int, dict[str, Callable[[Rng], Any]]] = {
    2: {"star": _star, "ring": _ring, "rectangle": _rectangle, "L": _ell},
    3: {
        "hull": _hull,
        "dented ball": partial(draw_dented_ball, max_subdivisions=2),
        "box": _box,
        "L": _prism,
    },
}


# ---- checks --------------------------------------------------------------------------------------


def check(report: Report, seed: int, wanted: int) -> None:
    """Check random pairs until enough placements were tested."""
    for dim, where in ((2, "in the plane"), (3, "in space")):

        def check_case(tally: Tally, number: int, dim: int = dim) -> None:
            case, rng = (
                draw_pair(seed, number, dim),
                np.random.default_rng([seed, number, 40 + dim]),
            )
            for _ in range(ROTATIONS_PER_PAIR):
                _check_pose(tally, case, rng)

        title = f"verdicts from frequencies {where}, {ROTATIONS_PER_PAIR} rotations of each pair"
        draw_until(report, title, seed, lambda tally: tally.verdicts.total() >= wanted, check_case)


def _check_pose(tally: Tally, case: PairCase, rng: Rng) -> None:
    """Check verdicts at one rotation."""
    rotation, overlap, collide = case.rotate(rng)
    low, high = overlap.domain
    ts = rng.uniform(low, high, (PLACEMENTS_PER_ROTATION, case.overlap.dim))
    ts[:: PLACEMENTS_PER_ROTATION // 10] += rng.choice([-1.0, 1.0]) * (high - low)
    contacts = _contacts(overlap, collide, ts, rng)
    ts[len(ts) - len(contacts) :] = contacts
    meets = collide(ts)
    _judge(tally, case, rotation, ts, meets, overlap.separated(ts).verdict)


def _judge(
    tally: Tally, case: PairCase, rotation: Floats, ts: Floats, meets: Bools, verdicts: Bytes
) -> None:
    q = np.column_stack([ts, np.broadcast_to(rotation, (len(ts), len(rotation)))])
    for verdict, wrong in ((Verdict.MISS, meets), (Verdict.HIT, ~meets)):
        claimed = verdicts == verdict
        tally.add(verdict.name, case, q[claimed], wrong[claimed])
    for verdict in Verdict:
        claimed = verdicts == verdict
        tally.verdicts["colliding", verdict.name] += int((claimed & meets).sum())
        tally.verdicts["clear", verdict.name] += int((claimed & ~meets).sum())


def _contacts(overlap: FourierOverlap, collide: Oracle, ts: Floats, rng: Rng) -> Floats:
    """Draw placements near contact, a third of ``ts``."""
    touching = ts[collide(ts)]
    if not len(touching):
        return ts[:0]
    low, high = overlap.domain
    size = float(np.linalg.norm(high - low))
    number = len(ts) // 3
    starts = touching[rng.integers(len(touching), size=number // 5)]
    directions = rng.normal(size=starts.shape)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    near, far = np.zeros(len(starts)), np.full(len(starts), 2.0 * size)
    for _ in range(BISECTION_STEPS):
        center = 0.5 * (near + far)
        meets = collide(starts + center[:, None] * directions)
        near, far = np.where(meets, center, near), np.where(meets, far, center)
    picked = rng.integers(len(starts), size=number)
    off = (
        size * rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(*LOG_CONTACT_DISTANCES, number)
    )
    return np.asarray(starts[picked] + (far[picked] + off)[:, None] * directions[picked])
