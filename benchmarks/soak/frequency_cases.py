"""Random pairs of shapes with their balls, in the plane and in space, each with its exact geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import shapely
import trimesh
from scipy.spatial.transform import Rotation

from benchmarks.soak.plane_geometry import Shape
from benchmarks.soak.space_geometry import Blocks, Skin, directions
from benchmarks.soak.space_pairs import SkinPair
from cspace.arrays import Bools, Floats
from cspace.errors import InputError
from cspace.shapes.mesh import Mesh
from cspace.spectral import Bump, FourierOverlap, decompose

Oracle = Callable[[Floats], Bools]
Rng = np.random.Generator

BUMPS = (1.0, 2.0, 2.0, 3.0, 4.0)
"""Exponents of the bumps that are drawn."""

BALLS = {2: (10, 60), 3: (10, 50)}
"""Balls of a body."""

TOLERANCES = {2: (0.01, 0.1), 3: (0.1, 0.5)}
"""By which the bands are chosen: low bands leave more undecided, and take less time."""

POOL = 16
"""Bodies of each dimension and seed that are decomposed; pairs are of these, stretched, turned and moved, which
rounds by far less than the balls grow."""


@dataclass(frozen=True)
class Body:
    """A polygon or a closed mesh, its triangles (n, 3, 3); and its balls, centers and radii.

    Outer balls cover it, inner ones lie in it; those are None where it has no room for any.
    """

    kind: str
    shape: Any
    outer: tuple[Floats, Floats]
    inner: tuple[Floats, Floats] | None

    @classmethod
    def of(cls, kind: str, shape: Any, number: int) -> Body:
        """The body with so many balls of each kind."""
        solid = Mesh(shape.reshape(-1, 3), np.arange(len(shape) * 3).reshape(-1, 3)) if _is_solid(shape) else shape
        outer = decompose(solid, kind="outer", number=number)
        try:
            inner = decompose(solid, kind="inner", number=number)
        except InputError:  # no room for any
            return cls(kind, shape, (outer.centers, outer.radii), None)
        return cls(kind, shape, (outer.centers, outer.radii), (inner.centers, inner.radii))

    def placed(self, scale: float, matrix: Floats, away: Floats) -> Body:
        """The same, stretched, then turned, then moved."""

        def move(points: Floats) -> Floats:
            return np.asarray(scale * points @ matrix.T + away)

        shape = move(self.shape) if _is_solid(self.shape) else shapely.transform(self.shape, move)
        outer = (move(self.outer[0]), scale * self.outer[1])
        inner = (move(self.inner[0]), scale * self.inner[1]) if self.inner is not None else None
        return Body(self.kind, shape, outer, inner)


def _is_solid(shape: Any) -> bool:
    return isinstance(shape, np.ndarray)


@dataclass(frozen=True)
class PairCase:
    """A body that is placed, some others, which may overlap, and their overlap; and the call that draws it."""

    name: str
    made_by: str
    kind: tuple[str, str]
    a: Body
    b: list[Body]
    overlap: FourierOverlap

    def turned(self, rng: Rng) -> tuple[Floats, FourierOverlap, Oracle]:
        """A random rotation, as a configuration ends with; the overlap there; and whether placements collide."""
        if self.overlap.dim == 2:
            yaw = float(rng.uniform(-np.pi, np.pi))
            matrix = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            return np.array([yaw]), self.overlap.rotated(matrix), oracle(self.a, self.b, matrix)
        rotation = Rotation.from_quat(rng.normal(size=4))
        return rotation.as_quat(), self.overlap.rotated(rotation), oracle(self.a, self.b, rotation.as_matrix())


def oracle(a: Body, b: list[Body], matrix: Floats) -> Oracle:
    """Whether a turned and moved body meets others: by shapely; or by FCL on surfaces, and points of one in the
    other."""
    if len(matrix) == 2:
        shape, others = Shape([a.shape], np.empty((0, 2)), np.empty(0)), [body.shape for body in b]
        for other in others:
            shapely.prepare(other)
        yaw = np.arctan2(matrix[1, 0], matrix[0, 0])
        return lambda ts: shape.meets(others, np.column_stack([ts, np.full(len(ts), yaw)]), 0.0)
    body = np.repeat(np.arange(len(b)), [len(each.shape) for each in b])
    skin = Skin(np.concatenate([each.shape for each in b]), body)
    skins = SkinPair(Skin(a.shape @ matrix.T, np.zeros(len(a.shape), dtype=np.int64)), skin)
    return lambda ts: skins.within(ts, np.zeros(len(ts)))


@cache
def pool_body(seed: int, index: int, dim: int) -> Body:
    """One body of the pool, about a metre across; all kinds take turns."""
    rng = np.random.default_rng([seed, index, 20 + dim])
    kind = list(BODIES[dim])[index % len(BODIES[dim])]
    return Body.of(kind, BODIES[dim][kind](rng), int(rng.integers(*BALLS[dim])))


def draw_pair(seed: int, number: int, dim: int) -> PairCase:
    """The same pair for the same seed, number and dimension."""
    rng = np.random.default_rng([seed, number, 30 + dim])
    size = float(10.0 ** rng.uniform(-2.0, 2.0))
    a = pool_body(seed, number % POOL, dim).placed(
        size, np.eye(dim), size * rng.choice([0.0, 3.0]) * rng.normal(size=dim)
    )
    corner = size * float(rng.choice([0.0, 30.0])) * rng.normal(size=dim)
    b = [
        pool_body(seed, int(rng.integers(POOL)), dim).placed(
            size * float(rng.uniform(0.5, 2.0)), random_turn(rng, dim), corner + size * rng.uniform(-1.5, 1.5, dim)
        )
        for _ in range(int(rng.integers(1, 4)))
    ]
    bump, tolerance, classes = (
        Bump(float(rng.choice(BUMPS))),
        float(rng.choice(TOLERANCES[dim])),
        int(rng.integers(1, 9)),
    )
    overlap = overlap_of(a, b, float(rng.uniform(0.3, 1.2)), classes, bump, tolerance, inner=bool(rng.random() < 0.9))
    others = " and ".join(sorted({each.kind for each in b}))
    name = (
        f"{a.kind} of {size:.3g} m among {others}, {bump}, {classes} classes of radii, {overlap.frequencies} "
        f"frequencies, threshold {overlap.threshold:.3g}"
    )
    return PairCase(name, f"draw_pair({seed}, {number}, {dim})", (others, a.kind), a, b, overlap)


def overlap_of(
    a: Body, b: list[Body], share: float, classes: int, bump: Bump, tolerance: float, inner: bool
) -> FourierOverlap:
    """The overlap of a body and others, whose balls grow by a share of the smaller median radius of the two."""
    sets = [a.outer, _together([each.outer for each in b])]
    if inner and a.inner is not None and all(each.inner is not None for each in b):
        sets += [a.inner, _together([each.inner for each in b if each.inner is not None])]
    swell = share * float(min(np.median(radii) for _, radii in sets[:2]))
    return FourierOverlap.of_shapes(*sets, swell=swell, classes=classes, bump=bump, tolerance=tolerance)


def _together(sets: list[tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    return np.concatenate([centers for centers, _ in sets]), np.concatenate([radii for _, radii in sets])


def random_turn(rng: Rng, dim: int) -> Floats:
    """A random rotation."""
    matrix = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
    matrix[:, 0] *= np.sign(np.linalg.det(matrix))
    return np.asarray(matrix)


# ---- bodies about the origin, up to two metres across ---------------------------------------------------------------


def _star(rng: Rng) -> Any:
    corners = int(rng.integers(3, 12))
    turns = 2.0 * np.pi * (np.arange(corners) + rng.uniform(0.0, 0.6, corners)) / corners
    return shapely.Polygon(rng.uniform(0.3, 1.0, (corners, 1)) * np.column_stack([np.cos(turns), np.sin(turns)]))


def _ring(rng: Rng) -> Any:
    middle = shapely.Point(0.0, 0.0)
    hole = middle.buffer(float(rng.uniform(0.2, 0.8)), quad_segs=2)
    return middle.buffer(1.0, quad_segs=int(rng.integers(2, 6))).difference(hole)


def _rectangle(rng: Rng) -> Any:
    half = rng.uniform(0.1, 1.0, 2)
    return shapely.box(*-half, *half)


def _ell(rng: Rng) -> Any:
    a, b = rng.uniform(0.2, 0.8, 2)
    return shapely.Polygon(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, b), (a, b), (a, 1.0), (0.0, 1.0)]) - 0.5)


def _hull(rng: Rng) -> Floats:
    points = directions(int(rng.integers(5, 16)), rng) * rng.uniform(0.4, 1.0, 3)
    return np.asarray(trimesh.convex.convex_hull(points).triangles)


def _dented(rng: Rng) -> Floats:
    ball = trimesh.creation.icosphere(int(rng.integers(0, 2)), 1.0)
    vertices = np.asarray(ball.vertices) * rng.uniform(0.3, 1.0, (len(ball.vertices), 1))
    return np.asarray(vertices[np.asarray(ball.faces)])


def _box(rng: Rng) -> Floats:
    half = rng.uniform(0.1, 1.0, 3)
    return np.asarray(Blocks.boxes(np.array([-half, half])).skin().triangles)


def _prism(rng: Rng) -> Floats:
    return np.asarray(trimesh.creation.extrude_polygon(_ell(rng), float(rng.uniform(0.2, 1.0))).triangles)


BODIES: dict[int, dict[str, Callable[[Rng], Any]]] = {
    2: {"star": _star, "ring": _ring, "rectangle": _rectangle, "L": _ell},
    3: {"hull": _hull, "dented ball": _dented, "box": _box, "L": _prism},
}
