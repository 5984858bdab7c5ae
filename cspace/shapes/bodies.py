"""Bodies: connected parts of a mesh, and the winding of their triangles."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats, Ints
from cspace.shapes.shape import unique_rows

_VOLUME_ROUNDING: Final = 2.0**-30
"""Maximum volume, relative to the sum of its parts' moduli, whose sign is uncertain from rounding."""


class Body(NamedTuple):
    """Triangles that are connected through shared edges.

    Attributes
    ----------
    faces : ndarray of int64, shape (n,)
        Indices of its triangles.
    turns : ndarray of int64, shape (n,)
        Multiplicity of each triangle: 1, or -1 if reversed, or 0 if it repeats another one. All 0 for an open body.
    closed : bool
        True if the counted triangles cancel along each edge.
    volume : float
        Enclosed volume, cubic metres: negative if the body faces inward, zero if it is open or cancels out.
    """

    faces: Ints
    turns: Ints
    closed: bool
    volume: float


def find_bodies(vertices: Floats, faces: Ints) -> tuple[Body, ...]:
    """Find the bodies of a mesh, ordered by first triangle.

    Bitwise equal vertices count as one. A triangle with two equal corners bounds nothing and belongs to no body.
    Another
    triangle without area belongs to a body only if it closes a gap: between an edge of one triangle and the two halves
    of that edge in other triangles.

    The first pass joins triangles through edges that at most two of them share. What closes that way is a body, even if
    it touches other bodies along edges or something open is attached to it. The second pass joins the rest through all
    edges.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    faces : ndarray of int64, shape (F, 3)
    """
    corners = unique_rows(vertices)[1][faces]
    proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    sides = vertices[faces][:, 1:] - vertices[faces][:, :1]
    flat = proper & (np.cross(sides[:, 0], sides[:, 1]) == 0.0).all(axis=1)
    closed: list[Body] = []
    open_bodies: list[Body] = []
    rest = np.flatnonzero(proper & ~flat)
    for added, max_shared in ((rest[:0], 2), (rest[:0], len(faces)), (np.flatnonzero(flat), len(faces))):
        if not len(rest):
            break
        chosen = np.sort(np.concatenate([rest, added]))
        parts = _split_bodies(vertices[faces[chosen]], corners[chosen], max_shared)
        parts = [body._replace(faces=chosen[body.faces]) for body in parts]
        closed += [body for body in parts if body.closed]
        # Open flat triangles without any area are not worth a body.
        open_bodies = [body for body in parts if not body.closed and not flat[body.faces].all()]
        rest = np.concatenate([rest[:0], *(body.faces for body in open_bodies)])
    bodies = _orient_outward(vertices, faces, closed) + open_bodies
    return tuple(sorted(bodies, key=lambda body: int(body.faces[0])))


def component_labels(first: Ints, second: Ints, count: int) -> Ints:
    """Return the smallest vertex in each vertex's component, shape (count,).

    The pairs (`first[i]`, `second[i]`) are the edges. SciPy's graphs are as quick, but importing them takes 0.2 s and
    20 MB.
    """
    labels = np.arange(count)
    while len(first):
        a, b = labels[first], labels[second]
        apart = a != b
        first, second, a, b = first[apart], second[apart], a[apart], b[apart]
        np.minimum.at(labels, np.maximum(a, b), np.minimum(a, b))
        # Each vertex now points to a smaller one of its component; follow the pointers to the smallest.
        while (labels != (further := labels[labels])).any():
            labels = further
    return labels


def _split_bodies(triangles: Floats, corners: Ints, max_shared: int) -> list[Body]:
    """Group triangles into bodies, and decide how often and in which direction each triangle counts.

    Triangles are joined through edges that at most `max_shared` different triangles share. A triangle may be given
    several times. Its multiplicity is the number of times that it counts, negative if reversed, and 0 in a body that
    stays open. The first rule that closes a body decides its multiplicities:

    1. One of several equal triangles counts, in its own direction.
    2. All triangles count as given, so that a wall given once for each of two adjacent parts cancels.
    3. One of several equal triangles counts, exactly two meet at each edge, and triangles are reversed, from neighbour
       to neighbour, until all directions agree. A surface on which that fails, like Klein's bottle, is open.

    If neither the given directions nor their copies decide which way the body faces, it faces outward.
    """
    edge, direction = _edges(corners)
    first, copies, net = _find_repeated(corners)
    meeting = np.bincount(edge[first].ravel(), minlength=int(edge.max()) + 1)
    body, count = _label_bodies(edge, meeting <= max_shared)
    balanced, manifold = _balance(edge, direction, body, count, first)
    # Rule 1. The given directions decide which way a body faces, unless copies cancel.
    turns, closed, directed = first.astype(np.int64), balanced.copy(), balanced.copy()
    directed[body[np.abs(net) < copies]] = False
    if not first.all():  # rule 2
        every = np.ones(len(first), dtype=np.bool_)
        second = ~closed & _balance(edge, direction, body, count, every)[0]
        # A body whose triangles all cancel encloses nothing.
        second &= np.bincount(body, weights=net != 0, minlength=count) > 0
        turns[second[body]] = 1
        closed |= second
        directed |= second
    # Rule 3.
    astray = manifold & ~closed
    if astray.any():
        members = np.flatnonzero(astray[body] & first)
        turns[members], possible = _orient_alike(edge[members], direction[members], body[members], count)
        closed |= astray & possible
    turns[~closed[body]] = 0
    volume = _volumes(triangles, turns, body, count)
    inward = closed & ~directed & (volume < 0.0)
    turns, volume = np.where(inward[body], -turns, turns), np.where(inward, -volume, volume)
    order = np.argsort(body, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(body, minlength=count))[:-1])
    return [Body(part, turns[part], bool(closed[b]), float(volume[b])) for b, part in enumerate(parts)]


def _orient_outward(vertices: Floats, faces: Ints, bodies: list[Body]) -> list[Body]:
    """Reverse closed bodies that face inward, unless they are cavities.

    A cavity has all of its corners in bodies that face outward. Any other body that faces inward would wrongly cancel
    whatever it overlaps.
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
        center = triangles.reshape(-1, 3).mean(axis=0)
        corners = (triangles[within] - center).reshape(-1, 3)
        out = WindingNumber(triangles[around] - center, turns[around]).evaluate(corners) <= 0
        cavity[np.repeat(owner[within], 3)[out]] = False
    over = inward & ~cavity
    return [body._replace(turns=-body.turns, volume=-body.volume) if over[b] else body for b, body in enumerate(bodies)]


def _volumes(triangles: Floats, turns: Ints, body: Ints, count: int) -> Floats:
    """Return the enclosed volume of each body, shape (count,).

    It is zero within rounding.
    """
    total = np.stack([np.bincount(body, weights=triangles[:, 0, k], minlength=count) for k in range(3)], axis=-1)
    center = total / np.maximum(np.bincount(body, minlength=count), 1)[:, None]
    a, b, c = np.moveaxis(triangles - center[body][:, None], 1, 0)
    # Scale to numbers up to 1, so that products neither overflow nor underflow.
    size = np.zeros(count)
    np.maximum.at(size, body, np.abs(np.stack([a, b, c])).max(axis=(0, 2)))
    size = np.where(size > 0.0, size, 1.0)
    a, b, c = (part / size[body][:, None] for part in (a, b, c))
    parts = np.einsum("ij,ij->i", a, np.cross(b, c)) * turns / 6.0
    volume, moduli = (np.bincount(body, weights=each, minlength=count) for each in (parts, np.abs(parts)))
    return np.where(np.abs(volume) > _VOLUME_ROUNDING * moduli, volume * size**3, 0.0)


def _edges(corners: Ints) -> tuple[Ints, Ints]:
    """Return the edge and direction of each triangle side.

    Directions are 1 or -1; both arrays have shape (n, 3).
    """
    endpoints = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1)
    key = endpoints.min(axis=-1) * (int(corners.max()) + 1) + endpoints.max(axis=-1)
    edge = np.unique(key.ravel(), return_inverse=True)[1].reshape(key.shape)
    return edge, np.where(endpoints[..., 0] < endpoints[..., 1], 1, -1)


def _find_repeated(corners: Ints) -> tuple[Bools, Ints, Ints]:
    """Find triangles on the same three corners.

    For each triangle, return whether it is the first one, the count of such triangles, and the sum of their signs.
    """
    a, b, c = corners.T
    inversions = (a > b).astype(np.int64) + (b > c) + (a > c)
    sign = 1 - 2 * (inversions % 2)
    group = unique_rows(np.sort(corners, axis=1))[1]
    first = np.zeros(len(corners), dtype=np.bool_)
    first[np.unique(group, return_index=True)[1]] = True
    return first, np.bincount(group)[group], np.bincount(group, weights=sign)[group].astype(np.int64)


def _label_bodies(edge: Ints, joining: Bools) -> tuple[Ints, int]:
    """Return the body of each triangle, and their count.

    `joining` marks the edges that join triangles.
    """
    n = len(edge)
    triangle, side = np.nonzero(joining[edge])
    roots, body = np.unique(
        component_labels(triangle, n + edge[triangle, side], n + len(joining))[:n], return_inverse=True
    )
    return body.astype(np.int64), len(roots)


def _balance(edge: Ints, direction: Ints, body: Ints, count: int, chosen: Bools) -> tuple[Bools, Bools]:
    """Test bodies for closedness and for edges shared by exactly two triangles.

    A body is balanced if its chosen triangles cancel along each edge.
    """
    # Bodies can touch along an edge, so each body counts only its own triangles there.
    key = np.repeat(body[chosen], 3) * (int(edge.max()) + 1) + edge[chosen].ravel()
    sides, side = np.unique(key, return_inverse=True)
    owner = sides // (int(edge.max()) + 1)
    balanced = np.bincount(body[chosen], minlength=count) > 0
    manifold = balanced.copy()
    balanced[owner[np.bincount(side, weights=direction[chosen].ravel(), minlength=len(sides)) != 0.0]] = False
    manifold[owner[np.bincount(side, minlength=len(sides)) != 2]] = False
    return balanced, manifold


def _orient_alike(edge: Ints, direction: Ints, body: Ints, count: int) -> tuple[Ints, Bools]:
    """Orient adjacent triangles alike, by signs of 1 or -1.

    Also returns the bodies for which this is possible. Exactly two triangles must meet at each edge.
    """
    n = len(edge)
    order = np.argsort(np.repeat(body, 3) * (int(edge.max()) + 1) + edge.ravel(), kind="stable").reshape(-1, 2)
    one, other = (order // 3).T
    unlike = np.equal(*direction.ravel()[order].T)
    # Each triangle has two nodes, as given and reversed; consistent choices are linked.
    start = np.concatenate([one, n + one])
    stop = np.concatenate([other + n * unlike, other + n * ~unlike])
    label = component_labels(start, stop, 2 * n).reshape(2, n)
    possible = np.ones(count, dtype=np.bool_)
    possible[body[label[0] == label[1]]] = False
    bodies, first = np.unique(body, return_index=True)
    leading = np.zeros(count, dtype=label.dtype)
    leading[bodies] = label[0, first]
    return np.where((label[0] == leading[body]) | ~possible[body], 1, -1), possible
