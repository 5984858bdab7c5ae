"""Pairs of triangles of any kind, and their distances in rational arithmetic."""

from fractions import Fraction
from itertools import product

import numpy as np
from hypothesis import strategies as st

from tests.helpers.oracles import cross, dot, minus
from tests.helpers.strategies import seeds


def clamp(above, below):
    """Clamp a quotient to [0, 1]; return numerator and denominator."""
    return (0, 1) if above <= 0 else (1, 1) if above >= below else (above, below)


def squared_segment_distance(p, q, a, b):
    """Return the squared distance of segments with integer coordinates, exactly."""
    v = minus(q, p)
    u = minus(b, a)
    w = minus(p, a)
    vv = dot(v, v)
    uu = dot(u, u)
    uv = dot(u, v)
    vw = dot(v, w)
    uw = dot(u, w)
    area = vv * uu - uv * uv
    s, of_s = clamp(uv * uw - vw * uu, area) if area else (0, 1)
    t, of_t = clamp(uv * s + uw * of_s, uu * of_s) if uu else (0, 1)
    s, of_s = clamp(uv * t - vw * of_t, vv * of_t) if vv else (0, 1)
    gap = [x * of_s * of_t + s * of_t * y - t * of_s * z for x, y, z in zip(w, v, u, strict=True)]
    return Fraction(dot(gap, gap), (of_s * of_t) ** 2)


def is_over_face(p, triangle):
    """Return True if a point lies over a triangle."""
    n = cross(minus(triangle[1], triangle[0]), minus(triangle[2], triangle[0]))
    sides = [(triangle[k], triangle[(k + 1) % 3]) for k in range(3)]
    return any(n) and all(dot(cross(n, minus(b, a)), minus(p, a)) >= 0 for a, b in sides)


def squared_triangle_distance(first, second):
    """Return the squared distance of two triangles, exactly."""
    # Scale to integers, because Python computes faster with them than with fractions.
    unit = max(float(x).as_integer_ratio()[1] for x in np.ravel([first, second]))
    one, two = (
        [[int(Fraction(float(x)) * unit) for x in point] for point in part]
        for part in (first, second)
    )
    best = min(
        squared_segment_distance(one[i], one[(i + 1) % 3], two[j], two[(j + 1) % 3])
        for i, j in product(range(3), repeat=2)
    )
    for points, face in ((one, two), (two, one)):
        n = cross(minus(face[1], face[0]), minus(face[2], face[0]))
        heights = [dot(n, minus(p, face[0])) for p in points]
        for k in range(3):
            if is_over_face(points[k], face):
                best = min(best, Fraction(heights[k] ** 2, dot(n, n)))
            p = points[k]
            q = points[(k + 1) % 3]
            a = heights[k]
            b = heights[(k + 1) % 3]
            if a * b < 0:  # scaled by (a - b), the triangle and the crossing point are integers
                through = [(a - b) * x + a * (y - x) for x, y in zip(p, q, strict=True)]
                if is_over_face(through, [[(a - b) * x for x in corner] for corner in face]):
                    return Fraction(0)
    return best / unit**2


@st.composite
def triangle_pairs(draw):
    """Draw pairs of triangles of any kind.

    They may cross, touch, share a plane, be slivers, have nearly parallel edges, differ in size,
    lie far from the origin, or degenerate to segments and points.
    """
    rng = np.random.default_rng(draw(seeds))
    first, second = rng.uniform(-1, 1, (2, 3, 3))
    kind = draw(
        st.sampled_from(
            ["any", "grid", "plane", "sliver", "parallel", "small", "over", "bare", "through"]
        )
    )
    if kind == "grid":
        first, second = rng.integers(-2, 3, (2, 3, 3)).astype(float)
    elif kind == "plane":
        first[:, 2] = second[:, 2] = rng.uniform(-1, 1)
    elif kind == "sliver":
        first[2] = (
            first[0]
            + rng.uniform(0, 1) * (first[1] - first[0])
            + rng.normal(0, 10.0 ** rng.integers(-17, -5), 3)
        )
    elif kind == "parallel":
        turn = 10.0 ** rng.uniform(-10, -3)
        direction, side = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        lift = np.cross(direction, side) * rng.choice([0.0, 1e-9, 1e-3])
        first[:2] = np.outer([-1, 1], direction)
        second[:2] = np.outer(rng.uniform(-1, 1, 2), direction + turn * side) + lift
        first[2], second[2] = (
            first[0] - np.cross(direction, side),
            second[0] + np.cross(direction, side) + side,
        )
    elif kind == "small":
        second = first.mean(axis=0) + 1e-5 * second
    elif kind == "over":
        second[0] = first.T @ rng.dirichlet(np.ones(3)) + 1e-4 * np.cross(
            first[1] - first[0], first[2] - first[0]
        )
    elif kind == "bare":  # segments and points, some touching
        first[rng.integers(1, 3)] = first[0]
        second[1:] = second[rng.integers(0, 2)]
        second += (
            first.T @ rng.dirichlet(np.ones(3))
            - second[0]
            + rng.choice([0.0, 1e-15, 1e-6]) * rng.normal(size=3)
        )
    elif kind == "through":  # with a common point, or nearly
        second += first.T @ rng.dirichlet(np.full(3, 0.3)) - second.T @ rng.dirichlet(
            np.full(3, 0.3)
        )
        second += rng.choice([0.0, 1e-16, 1e-12]) * rng.normal(size=3)
    shift = rng.uniform(-1, 1, 3) * draw(st.sampled_from([0.0, 1.0, 1e3]))
    return first + shift, second + shift
