"""Bodies: the parts of a mesh that hang together, and which of them enclose a volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.raster.solids.inside.readings import equal_triangles, first_of_each, read

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Bools = NDArray[np.bool_]

_NOUGHT: Final = 2.0**-30
"""Volume, over the sum of the volumes that it is made of, up to which its sign says nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Triangles that hang together through shared edges.

    Attributes
    ----------
    faces : ndarray of int64
        Numbers of its triangles.
    turns : ndarray of int64
        How often each counts: 1, or -1 against its own direction; 0 where it is one of several equal ones that count
        once, or a wall between two parts of the body. All 0 where the body is open.
    closed : bool
        Whether an even number of the triangles that count meet at each edge.
    oriented : bool
        Whether those run along each edge as often one way as the other, as they were given.
    wound : bool
        Whether they do so by ``turns``; then there is a winding number, and else a parity.
    facing : int
        1 where the body faces outward (its volume is above zero), -1 where it faces inward, 0 where nobody can tell:
        triangles are not turned alike, or are drawn both ways, or the volume is nought.
    manifold : bool
        Whether exactly two different triangles meet at each edge. Then, unless triangles cross, there are exactly two
        sides, and the outer one is where the winding number is zero.
    """

    faces: Integers
    turns: Integers
    closed: bool
    oriented: bool
    wound: bool
    facing: int
    manifold: bool


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """The closed bodies of a mesh as arrays; see :class:`Body`.

    Attributes
    ----------
    faces, body, turns : ndarray of int64, shape (n,)
        Their triangles, the body of each, and how it counts.
    wound : ndarray of bool
    facing : ndarray of int64
    manifold : ndarray of bool
        One of each for each closed body.
    """

    faces: Integers
    body: Integers
    turns: Integers
    wound: Bools
    facing: Integers
    manifold: Bools

    @classmethod
    def closed(cls, bodies: tuple[Body, ...]) -> Bodies:
        """The closed ones among ``bodies``, numbered in their order."""
        kept = [body for body in bodies if body.closed]
        none = np.empty(0, dtype=np.int64)
        return cls(
            np.concatenate([none, *(body.faces for body in kept)]),
            np.repeat(np.arange(len(kept)), [len(body.faces) for body in kept]).astype(np.int64),
            np.concatenate([none, *(body.turns for body in kept)]),
            np.array([body.wound for body in kept], dtype=np.bool_),
            np.array([body.facing for body in kept], dtype=np.int64),
            np.array([body.manifold for body in kept], dtype=np.bool_),
        )


def find_bodies(vertices: Floats, faces: Integers) -> tuple[Body, ...]:
    """The bodies of a mesh.

    Coincident vertices (equal to the bit) count as one. A triangle with two equal corners bounds nothing and belongs
    to no body. One without area otherwise belongs to one only where it closes a gap: between an edge of one triangle
    and the two halves of it that belong to others.

    Triangles are joined first through edges at which no more than two of them meet: what closes that way is a body,
    also where it touches other bodies along edges, or something open hangs on it. The rest is joined through edges that
    have the same vertex numbers, so that bodies that were put side by side stay apart; and what that does not close,
    through all edges.

    What several triangles on the same three vertices mean, :func:`cspace.raster.solids.inside.readings.read` tells.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    faces : ndarray of int64, shape (F, 3)

    Returns
    -------
    tuple of Body
        Ordered by their first triangles.
    """
    corners = merged(vertices)[faces]
    proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    flat = proper & _without_area(vertices[faces])
    closed: list[Body] = []
    rest = np.flatnonzero(proper & ~flat)
    open_bodies: list[Body] = []
    steps = ((rest[:0], False, 2), (rest[:0], True, len(faces)), (rest[:0], False, len(faces)))
    for added, as_named, most in (*steps, (np.flatnonzero(flat), False, len(faces))):
        if not len(rest):
            break
        some = np.sort(np.concatenate([rest, added]))
        found = _bodies_among(vertices[faces[some]], corners[some], faces[some] if as_named else None, most, some)
        closed += [body for body in found if body.closed]
        # Without a triangle that has an area there is nothing to speak of.
        open_bodies = [body for body in found if not body.closed and not flat[body.faces].all()]
        rest = np.concatenate([rest[:0], *(body.faces for body in open_bodies)])
    return tuple(sorted(closed + open_bodies, key=lambda body: int(body.faces[0])))


def merged(vertices: Floats) -> Integers:
    """A number for each vertex, the same for coincident ones."""
    order = np.lexsort(vertices.T)
    ordered = vertices[order]
    new = np.concatenate([[False], (ordered[1:] != ordered[:-1]).any(axis=1)])
    numbers = np.empty(len(vertices), dtype=np.int64)
    numbers[order] = np.cumsum(new)
    return numbers


def _without_area(triangles: Floats) -> Bools:
    sides = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(sides[:, 0], sides[:, 1])
    return np.asarray((normals == 0.0).all(axis=1))


def _bodies_among(
    triangles: Floats, corners: Integers, names: Integers | None, most: int, chosen: Integers
) -> list[Body]:
    """Bodies that some triangles make, joined through edges at which at most so many different triangles meet.

    Edges join that agree in ``names``, if given, and else in ``corners``; ``chosen`` are the numbers of the triangles.
    """
    edge, direction = _edges(corners)
    sign, group = equal_triangles(corners)
    joint = edge if names is None else _edges(names)[0]
    meeting = np.bincount(joint[first_of_each(group)].ravel(), minlength=int(joint.max()) + 1)
    body, number = _components(joint, meeting <= most)
    reading = read(edge, direction, body, number, sign, group)
    facing = np.where(reading.told, _facing(triangles, body, reading.turns, number), 0)
    order = np.argsort(body, kind="stable")
    stops = np.cumsum(np.bincount(body, minlength=number))
    parts = np.split(order, stops[:-1])
    return [
        Body(
            faces=chosen[part],
            turns=reading.turns[part],
            closed=bool(reading.closed[b]),
            oriented=bool(reading.oriented[b]),
            wound=bool(reading.wound[b]),
            facing=int(facing[b]),
            manifold=bool(reading.manifold[b]),
        )
        for b, part in enumerate(parts)
    ]


def _facing(triangles: Floats, body: Integers, turns: Integers, number: int) -> Integers:
    """Sign of the volume that the triangles of each body enclose, shape (number,); 0 within rounding."""
    total = np.stack([np.bincount(body, weights=triangles[:, 0, k], minlength=number) for k in range(3)], axis=-1)
    middle = total / np.bincount(body, minlength=number)[:, None]
    a, b, c = np.moveaxis(triangles - middle[body][:, None], 1, 0)
    # On numbers up to 1, so that products neither overflow nor vanish.
    size = np.zeros(number)
    np.maximum.at(size, body, np.abs(np.stack([a, b, c])).max(axis=(0, 2)))
    a, b, c = (part / np.where(size > 0.0, size, 1.0)[body][:, None] for part in (a, b, c))
    parts = np.einsum("ij,ij->i", a, np.cross(b, c)) * turns
    volume, doubt = (np.bincount(body, weights=some, minlength=number) for some in (parts, np.abs(parts)))
    return np.where(np.abs(volume) > _NOUGHT * doubt, np.sign(volume), 0.0).astype(np.int64)


def _edges(corners: Integers) -> tuple[Integers, Integers]:
    """Edge number and direction (1 or -1) of each side of each triangle, both of shape (n, 3)."""
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1)
    key = ends.min(axis=-1) * (int(corners.max()) + 1) + ends.max(axis=-1)
    edge = np.unique(key.ravel(), return_inverse=True)[1].reshape(key.shape)
    return edge, np.where(ends[..., 0] < ends[..., 1], 1, -1)


def _components(edge: Integers, joining: Bools) -> tuple[Integers, int]:
    """Number of the body of each triangle, and how many there are, given the edges that join."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(edge)
    triangle, side = np.nonzero(joining[edge])
    size = n + len(joining)
    links = coo_array((np.ones(len(triangle), dtype=np.int8), (triangle, n + edge[triangle, side])), shape=(size, size))
    label = connected_components(links, directed=False)[1][:n]
    # Edges that join nothing have been numbered too.
    kept, body = np.unique(label, return_inverse=True)
    return body.astype(np.int64), len(kept)
