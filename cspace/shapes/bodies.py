"""Bodies: the connected parts of a mesh, and how their triangles wind round what they enclose."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats, Ints
from cspace.shapes.shape import ordered_rows

_NOUGHT: Final = 2.0**-30
"""Volume, over the sum of the volumes that it is made of, up to which its sign says nothing."""


class Body(NamedTuple):
    """Triangles that are connected through shared edges.

    Attributes
    ----------
    faces : ndarray of int64, shape (n,)
        Numbers of its triangles.
    turns : ndarray of int64, shape (n,)
        How often each counts: 1, or -1 against its own direction, or 0 where it repeats another one. All 0 where the
        body is open.
    closed : bool
        Whether what counts runs along each edge as often one way as the other.
    volume : float
        That it winds round, cubic metres: below zero where it faces inward, zero where it is open or cancels out.
    """

    faces: Ints
    turns: Ints
    closed: bool
    volume: float


def find_bodies(vertices: Floats, faces: Ints) -> tuple[Body, ...]:
    """The bodies of a mesh, in the order of their first triangles.

    Coincident vertices (equal to the bit) count as one. A triangle with two equal corners bounds nothing and belongs
    to no body. One without area otherwise belongs to one only where it closes a gap: between an edge of one triangle
    and the two halves of it that belong to others.

    Triangles are joined first through edges at which no more than two of them meet: what closes that way is a body,
    also where it touches other bodies along edges, or something open is joined to it. What that does not close is
    joined through all edges.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    faces : ndarray of int64, shape (F, 3)
    """
    corners = ordered_rows(vertices)[1][faces]
    proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    sides = vertices[faces][:, 1:] - vertices[faces][:, :1]
    flat = proper & (np.cross(sides[:, 0], sides[:, 1]) == 0.0).all(axis=1)
    closed: list[Body] = []
    open_bodies: list[Body] = []
    rest = np.flatnonzero(proper & ~flat)
    for added, most in ((rest[:0], 2), (rest[:0], len(faces)), (np.flatnonzero(flat), len(faces))):
        if not len(rest):
            break
        chosen = np.sort(np.concatenate([rest, added]))
        parts = _bodies_among(vertices[faces[chosen]], corners[chosen], most)
        parts = [body._replace(faces=chosen[body.faces]) for body in parts]
        closed += [body for body in parts if body.closed]
        # Without a triangle that has an area there is nothing to speak of.
        open_bodies = [body for body in parts if not body.closed and not flat[body.faces].all()]
        rest = np.concatenate([rest[:0], *(body.faces for body in open_bodies)])
    bodies = _outermost_outward(vertices, faces, closed) + open_bodies
    return tuple(sorted(bodies, key=lambda body: int(body.faces[0])))


def component_labels(first: Ints, second: Ints, number: int) -> Ints:
    """The least of all that each of ``range(number)`` is joined to, by pairs and by way of others; shape (number,).

    SciPy's graphs are as quick, but to import them takes a fifth of a second and 20 MB.
    """
    least = np.arange(number)
    while len(first):
        a, b = least[first], least[second]
        apart = a != b
        first, second, a, b = first[apart], second[apart], a[apart], b[apart]
        np.minimum.at(least, np.maximum(a, b), np.minimum(a, b))
        # Now each points to another one that is less, and so on down to the least.
        while (least != (further := least[least])).any():
            least = further
    return least


def _bodies_among(triangles: Floats, corners: Ints, most: int) -> list[Body]:
    """Bodies that triangles make, joined through edges at which at most so many different ones meet.

    Each is read by the first of these rules that closes it:

    1. of several equal triangles one counts, in its own direction;
    2. all count as they were given, so that a wall given for each of the two parts beside it cancels;
    3. of several equal triangles one counts, exactly two meet at each edge, and some are turned over, from neighbour to
       neighbour, until all directions agree; a surface on which that fails, like Klein's bottle, is open.

    Where neither the directions that were given nor their copies decide which way the body faces, it faces outward.
    """
    edge, direction = _edges(corners)
    first, copies, net = _repeated(corners)
    meeting = np.bincount(edge[first].ravel(), minlength=int(edge.max()) + 1)
    body, number = _joined(edge, meeting <= most)
    alike, manifold = _balance(edge, direction, body, number, first)
    turns, closed, directed = first.astype(np.int64), alike.copy(), alike.copy()
    directed[body[np.abs(net) < copies]] = False
    if not first.all():
        every = np.ones(len(first), dtype=np.bool_)
        second = ~closed & _balance(edge, direction, body, number, every)[0]
        # Where all cancels, nothing is left to enclose anything.
        second &= np.bincount(body, weights=net != 0, minlength=number) > 0
        turns[second[body]] = 1
        closed |= second
        directed |= second
    astray = manifold & ~closed
    if astray.any():
        members = np.flatnonzero(astray[body] & first)
        turns[members], possible = _turned_alike(edge[members], direction[members], body[members], number)
        closed |= astray & possible
    turns[~closed[body]] = 0
    volume = _volumes(triangles, turns, body, number)
    inward = closed & ~directed & (volume < 0.0)
    turns, volume = np.where(inward[body], -turns, turns), np.where(inward, -volume, volume)
    order = np.argsort(body, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(body, minlength=number))[:-1])
    return [Body(part, turns[part], bool(closed[b]), float(volume[b])) for b, part in enumerate(parts)]


def _outermost_outward(vertices: Floats, faces: Ints, bodies: list[Body]) -> list[Body]:
    """Closed bodies, those that face inward turned over unless all of their corners lie in bodies that face outward.

    What is turned over could be no cavity, and would cancel whatever it overlaps.
    """
    volume = np.array([body.volume for body in bodies])
    outward, inward = volume > 0.0, volume < 0.0
    if not inward.any():
        return bodies
    chosen = np.concatenate([body.faces for body in bodies])
    turns = np.concatenate([body.turns for body in bodies])
    owner = np.repeat(np.arange(len(bodies)), [len(body.faces) for body in bodies])
    triangles = vertices[faces[chosen]]
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    lows = np.minimum.reduceat(triangles.min(axis=1), starts)
    highs = np.maximum.reduceat(triangles.max(axis=1), starts)
    low, high = lows[outward], highs[outward]
    cavity = np.zeros(len(bodies), dtype=np.bool_)
    for b in np.flatnonzero(inward).tolist():
        cavity[b] = ((low < lows[b]).all(axis=1) & (highs[b] < high).all(axis=1)).any()
    if cavity.any():
        from cspace.raster.surfaces import WindingNumber

        around, within = outward[owner] & (turns != 0), np.flatnonzero(cavity[owner])
        middle = triangles.reshape(-1, 3).mean(axis=0)
        corners = (triangles[within] - middle).reshape(-1, 3)
        out = WindingNumber(triangles[around] - middle, turns[around]).evaluate(corners) <= 0
        cavity[np.repeat(owner[within], 3)[out]] = False
    over = inward & ~cavity
    return [body._replace(turns=-body.turns, volume=-body.volume) if over[b] else body for b, body in enumerate(bodies)]


def _volumes(triangles: Floats, turns: Ints, body: Ints, number: int) -> Floats:
    """Volume that the triangles of each body wind round, shape (number,); zero within rounding."""
    total = np.stack([np.bincount(body, weights=triangles[:, 0, k], minlength=number) for k in range(3)], axis=-1)
    middle = total / np.maximum(np.bincount(body, minlength=number), 1)[:, None]
    a, b, c = np.moveaxis(triangles - middle[body][:, None], 1, 0)
    # On numbers up to 1, so that products neither overflow nor vanish.
    size = np.zeros(number)
    np.maximum.at(size, body, np.abs(np.stack([a, b, c])).max(axis=(0, 2)))
    size = np.where(size > 0.0, size, 1.0)
    a, b, c = (part / size[body][:, None] for part in (a, b, c))
    parts = np.einsum("ij,ij->i", a, np.cross(b, c)) * turns / 6.0
    volume, moduli = (np.bincount(body, weights=each, minlength=number) for each in (parts, np.abs(parts)))
    return np.where(np.abs(volume) > _NOUGHT * moduli, volume * size**3, 0.0)


def _edges(corners: Ints) -> tuple[Ints, Ints]:
    """Edge number and direction (1 or -1) of each side of each triangle, both of shape (n, 3)."""
    endpoints = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1)
    key = endpoints.min(axis=-1) * (int(corners.max()) + 1) + endpoints.max(axis=-1)
    edge = np.unique(key.ravel(), return_inverse=True)[1].reshape(key.shape)
    return edge, np.where(endpoints[..., 0] < endpoints[..., 1], 1, -1)


def _repeated(corners: Ints) -> tuple[Bools, Ints, Ints]:
    """For each triangle, whether it is the first on its three corners, how many such there are, and their sum."""
    a, b, c = corners.T
    inversions = (a > b).astype(np.int64) + (b > c) + (a > c)
    sign = 1 - 2 * (inversions % 2)
    group = ordered_rows(np.sort(corners, axis=1))[1]
    first = np.zeros(len(corners), dtype=np.bool_)
    first[np.unique(group, return_index=True)[1]] = True
    return first, np.bincount(group)[group], np.bincount(group, weights=sign)[group].astype(np.int64)


def _joined(edge: Ints, joining: Bools) -> tuple[Ints, int]:
    """Number of the body of each triangle, and how many there are, given the edges that join."""
    n = len(edge)
    triangle, side = np.nonzero(joining[edge])
    roots, body = np.unique(
        component_labels(triangle, n + edge[triangle, side], n + len(joining))[:n], return_inverse=True
    )
    return body.astype(np.int64), len(roots)


def _balance(edge: Ints, direction: Ints, body: Ints, number: int, chosen: Bools) -> tuple[Bools, Bools]:
    """For each body, whether the chosen triangles run along each edge as often one way as the other; and in twos."""
    # Bodies may touch along an edge: each counts its own triangles there.
    key = np.repeat(body[chosen], 3) * (int(edge.max()) + 1) + edge[chosen].ravel()
    sides, side = np.unique(key, return_inverse=True)
    owner = sides // (int(edge.max()) + 1)
    balanced = np.bincount(body[chosen], minlength=number) > 0
    manifold = balanced.copy()
    balanced[owner[np.bincount(side, weights=direction[chosen].ravel(), minlength=len(sides)) != 0.0]] = False
    manifold[owner[np.bincount(side, minlength=len(sides)) != 2]] = False
    return balanced, manifold


def _turned_alike(edge: Ints, direction: Ints, body: Ints, number: int) -> tuple[Ints, Bools]:
    """How triangles that meet in twos must be turned, 1 or -1, to be turned alike; for each body, whether they can."""
    n = len(edge)
    order = np.argsort(np.repeat(body, 3) * (int(edge.max()) + 1) + edge.ravel(), kind="stable").reshape(-1, 2)
    one, other = (order // 3).T
    unlike = np.equal(*direction.ravel()[order].T)
    # A node for each triangle as it is, and one for it turned over; those that go together are linked.
    start = np.concatenate([one, n + one])
    stop = np.concatenate([other + n * unlike, other + n * ~unlike])
    label = component_labels(start, stop, 2 * n).reshape(2, n)
    possible = np.ones(number, dtype=np.bool_)
    possible[body[label[0] == label[1]]] = False
    bodies, first = np.unique(body, return_index=True)
    leading = np.zeros(number, dtype=label.dtype)
    leading[bodies] = label[0, first]
    return np.where((label[0] == leading[body]) | ~possible[body], 1, -1), possible
