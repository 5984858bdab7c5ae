"""Bodies of a mesh: its connected parts, and how often each triangle counts in them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cspace.shapes.shape import unique_rows
from cspace.support.arrays import Bools, Floats, Ints

_VOLUME_ROUNDING: Final = 2.0**-30
"""Relative volume below which the sign is uncertain because of rounding.

It is relative to the sum of the absolute volumes of the tetrahedra that are added.
"""


@dataclass(frozen=True, eq=False)
class Body:
    """Triangles of a mesh that are connected through shared edges.

    Attributes
    ----------
    faces : ndarray of int64, shape (n,)
        Indices of its triangles.
    turns : ndarray of int64, shape (n,)
        Multiplicity of each triangle: how often it counts, negative if reversed, 0 if it repeats
        another one. All 0 for an open body.
    closed : bool
        True if the counted triangles cancel along each edge.
    volume : float
        Enclosed volume, cubic metres: negative if the body faces inward, zero if it is open or
        cancels out.
    """

    faces: Ints
    turns: Ints
    closed: bool
    volume: float


def find_bodies(vertices: Floats, faces: Ints) -> tuple[Body, ...]:
    """Find the bodies of a mesh, ordered by first triangle.

    Bitwise equal vertices count as one. A triangle with two equal corners bounds nothing and
    belongs to no body. Another triangle without area belongs to a body only if it closes a gap
    between an edge of one triangle and the two halves of that edge in other triangles.

    The first pass joins triangles through edges that at most two of them share. A part that is
    closed then is a body, even if it touches other bodies along edges or something open is attached
    to it. The second pass joins the other triangles through all edges. The third pass adds the
    triangles without area.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
        Vertex indices.

    Returns
    -------
    tuple of Body
    """
    corners = unique_rows(vertices)[1][faces]
    proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    sides = vertices[faces][:, 1:] - vertices[faces][:, :1]
    has_no_area = proper & (np.cross(sides[:, 0], sides[:, 1]) == 0.0).all(axis=1)
    closed: list[Body] = []
    open_bodies: list[Body] = []
    remaining = np.flatnonzero(proper & ~has_no_area)
    for added, max_shared in (
        (remaining[:0], 2),
        (remaining[:0], len(faces)),
        (np.flatnonzero(has_no_area), len(faces)),
    ):
        if not len(remaining):
            break
        chosen = np.sort(np.concatenate([remaining, added]))
        found = _split_bodies(vertices[faces[chosen]], corners[chosen], max_shared)
        found = [replace(body, faces=chosen[body.faces]) for body in found]
        closed += [body for body in found if body.closed]
        # Open flat triangles without any area are not worth a body.
        open_bodies = [
            body for body in found if not body.closed and not has_no_area[body.faces].all()
        ]
        remaining = np.concatenate([remaining[:0], *(body.faces for body in open_bodies)])
    bodies = _orient_outward(vertices, faces, closed) + open_bodies
    return tuple(sorted(bodies, key=lambda body: int(body.faces[0])))


def component_labels(first: Ints, second: Ints, count: int) -> Ints:
    """Label the connected components of a graph, in the order of their first vertices.

    The graph has `count` vertices, and edges from `first[i]` to `second[i]`. Returns shape
    (count,).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(first), dtype=np.bool_), (first, second)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(labels, dtype=np.int64)


def _split_bodies(triangles: Floats, corners: Ints, max_shared: int) -> list[Body]:
    """Group triangles into bodies, and orient them.

    ``triangles`` has shape (n, 3, 3), metres; ``corners``, shape (n, 3), has vertex indices.
    Triangles are joined through edges that at most `max_shared` different triangles share. A
    triangle may be given several times. Its multiplicity is the number of times that it counts,
    negative if reversed, and 0 in a body that stays open. The first rule that closes a body decides
    its multiplicities:

    1. One of several equal triangles counts, in its own direction.
    2. All triangles count as given, so that a wall given once for each of two adjacent parts
       cancels.
    3. One of several equal triangles counts, exactly two meet at each edge, and triangles are
       reversed, from neighbor to neighbor, until all directions agree. A surface on which that
       fails, like a Klein bottle, is open.

    If neither the given directions nor their copies decide which way the body faces, it faces
    outward.
    """
    # A body is manifold if exactly two of its triangles meet at each edge. `directed` bodies keep
    # the given directions.
    edge, direction = _edges(corners)
    first, copies, net = _find_repeated(corners)
    meeting = np.bincount(edge[first].ravel(), minlength=int(edge.max()) + 1)
    body, count = _label_bodies(edge, meeting <= max_shared)
    balanced, manifold = _balance(edge, direction, body, count, first)
    # Rule 1. The given directions decide which way a body faces, unless copies cancel.
    multiplicity = first.astype(np.int64)
    closed = balanced.copy()
    directed = balanced.copy()
    directed[body[np.abs(net) < copies]] = False
    if not first.all():  # rule 2
        all_triangles = np.ones(len(first), dtype=np.bool_)
        by_rule_2 = ~closed & _balance(edge, direction, body, count, all_triangles)[0]
        # A body whose triangles all cancel encloses nothing.
        by_rule_2 &= np.bincount(body, weights=net != 0, minlength=count) > 0
        multiplicity[by_rule_2[body]] = 1
        closed |= by_rule_2
        directed |= by_rule_2
    # Rule 3.
    by_rule_3 = manifold & ~closed
    if by_rule_3.any():
        members = np.flatnonzero(by_rule_3[body] & first)
        multiplicity[members], possible = _orient_alike(
            edge[members], direction[members], body[members], count
        )
        closed |= by_rule_3 & possible
    multiplicity[~closed[body]] = 0
    # A body whose facing is open to choice faces outward.
    volume = _volumes(triangles, multiplicity, body, count)
    inward = closed & ~directed & (volume < 0.0)
    multiplicity = np.where(inward[body], -multiplicity, multiplicity)
    volume = np.where(inward, -volume, volume)
    by_body = np.argsort(body, kind="stable")
    parts = np.split(by_body, np.cumsum(np.bincount(body, minlength=count))[:-1])
    return [
        Body(part, multiplicity[part], bool(closed[index]), float(volume[index]))
        for index, part in enumerate(parts)
    ]


def _orient_outward(vertices: Floats, faces: Ints, bodies: list[Body]) -> list[Body]:
    """Reverse closed bodies that face inward, except cavities.

    ``vertices`` has shape (V, 3), ``faces`` (F, 3). A cavity has all of its corners in bodies that
    face outward. Any other body that faces inward would wrongly cancel whatever it overlaps.
    """
    volume = np.array([body.volume for body in bodies])
    outward = volume > 0.0
    inward = volume < 0.0
    if not inward.any():
        return bodies
    multiplicity = np.concatenate([body.turns for body in bodies])
    owner = np.repeat(np.arange(len(bodies)), [len(body.faces) for body in bodies])
    triangles = vertices[faces[np.concatenate([body.faces for body in bodies])]]
    is_reversed = inward.copy()
    if outward.any():
        # The winding number of the outward bodies around the corners of an inward body decides.
        from cspace.raster.surfaces import WindingNumber

        around = outward[owner] & (multiplicity != 0)
        within = np.flatnonzero(inward[owner])
        center = triangles.reshape(-1, 3).mean(axis=0)
        corners = (triangles[within] - center).reshape(-1, 3)
        winding = WindingNumber(triangles[around] - center, multiplicity[around])
        is_reversed = np.zeros(len(bodies), dtype=np.bool_)
        is_reversed[np.repeat(owner[within], 3)[winding.evaluate(corners) <= 0]] = True
    return [
        replace(body, turns=-body.turns, volume=-body.volume) if is_reversed[index] else body
        for index, body in enumerate(bodies)
    ]


def _volumes(triangles: Floats, turns: Ints, body: Ints, count: int) -> Floats:
    """Return the enclosed volume of each body.

    The result has shape (count,), in cubic metres. ``triangles`` has shape (n, 3, 3), metres;
    ``turns`` and ``body``, shape (n,), are the multiplicity and the body of each. Volumes whose
    sign rounding leaves uncertain become zero.
    """
    # Sum the signed volumes of the tetrahedra between a point near the body's center and its
    # triangles.
    total = np.stack(
        [np.bincount(body, weights=triangles[:, 0, k], minlength=count) for k in range(3)], axis=-1
    )
    center = total / np.maximum(np.bincount(body, minlength=count), 1)[:, None]
    a, b, c = np.moveaxis(triangles - center[body][:, None], 1, 0)
    parts = np.einsum("ij,ij->i", a, np.cross(b, c)) * turns / 6.0
    volume, moduli = (
        np.bincount(body, weights=each, minlength=count) for each in (parts, np.abs(parts))
    )
    return np.where(np.abs(volume) > _VOLUME_ROUNDING * moduli, volume, 0.0)


def _edges(corners: Ints) -> tuple[Ints, Ints]:
    """Find the edge of each triangle side.

    ``corners``, shape (n, 3), has vertex indices. Returns the edge of each side, and its direction
    along that edge, 1 or -1, each of shape (n, 3). Sides on the same two vertices have the same
    edge.
    """
    endpoints = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1)
    key = endpoints.min(axis=-1) * (int(corners.max()) + 1) + endpoints.max(axis=-1)
    edge = np.unique(key.ravel(), return_inverse=True)[1].reshape(key.shape)
    return edge, np.where(endpoints[..., 0] < endpoints[..., 1], 1, -1)


def _find_repeated(corners: Ints) -> tuple[Bools, Ints, Ints]:
    """Find triangles that have the same three corners.

    ``corners`` has shape (n, 3). Returns three arrays of shape (n,): whether a triangle is the
    first on its corners, the number of triangles on these corners, and the sum of their signs, 1 or
    -1 by direction.
    """
    a, b, c = corners.T
    inversions = (a > b).astype(np.int64) + (b > c) + (a > c)
    sign = 1 - 2 * (inversions % 2)
    group = unique_rows(np.sort(corners, axis=1))[1]
    first = np.zeros(len(corners), dtype=np.bool_)
    first[np.unique(group, return_index=True)[1]] = True
    return (
        first,
        np.bincount(group)[group],
        np.bincount(group, weights=sign)[group].astype(np.int64),
    )


def _label_bodies(edge: Ints, joining: Bools) -> tuple[Ints, int]:
    """Label the body of each triangle, and count the bodies.

    ``edge``, shape (n, 3), has the edges of each triangle. `joining`, shape (edges,), marks the
    edges that join triangles.
    """
    triangle_count = len(edge)
    triangle, side = np.nonzero(joining[edge])
    roots, body = np.unique(
        component_labels(
            triangle, triangle_count + edge[triangle, side], triangle_count + len(joining)
        )[:triangle_count],
        return_inverse=True,
    )
    return body.astype(np.int64), len(roots)


def _balance(
    edge: Ints, direction: Ints, body: Ints, count: int, chosen: Bools
) -> tuple[Bools, Bools]:
    """Test which bodies are closed, and which are manifolds.

    A body is balanced if its chosen triangles cancel along each edge, and a manifold if exactly two
    of them meet at each edge. ``edge`` and ``direction`` have shape (n, 3), ``body`` and `chosen`
    (n,). Returns two arrays of shape (count,).
    """
    # Bodies can touch along an edge, so each body counts only its own triangles there.
    key = np.repeat(body[chosen], 3) * (int(edge.max()) + 1) + edge[chosen].ravel()
    sides, side = np.unique(key, return_inverse=True)
    owner = sides // (int(edge.max()) + 1)
    balanced = np.bincount(body[chosen], minlength=count) > 0
    manifold = balanced.copy()
    balanced[
        owner[np.bincount(side, weights=direction[chosen].ravel(), minlength=len(sides)) != 0.0]
    ] = False
    manifold[owner[np.bincount(side, minlength=len(sides)) != 2]] = False
    return balanced, manifold


def _orient_alike(edge: Ints, direction: Ints, body: Ints, count: int) -> tuple[Ints, Bools]:
    """Orient adjacent triangles alike.

    Returns signs of 1 or -1, shape (n,), that multiply the given directions, and the bodies for
    which such signs exist, shape (count,). Exactly two triangles must meet at each edge. ``edge``
    and ``direction`` have shape (n, 3), ``body`` (n,).
    """
    triangle_count = len(edge)
    order = np.argsort(
        np.repeat(body, 3) * (int(edge.max()) + 1) + edge.ravel(), kind="stable"
    ).reshape(-1, 2)
    triangle_a, triangle_b = (order // 3).T
    disagree = np.equal(*direction.ravel()[order].T)
    # Each triangle has two nodes, as given and reversed; consistent choices are linked.
    start = np.concatenate([triangle_a, triangle_count + triangle_a])
    stop = np.concatenate(
        [triangle_b + triangle_count * disagree, triangle_b + triangle_count * ~disagree]
    )
    labels = component_labels(start, stop, 2 * triangle_count).reshape(2, triangle_count)
    possible = np.ones(count, dtype=np.bool_)
    possible[body[labels[0] == labels[1]]] = False
    bodies, first = np.unique(body, return_index=True)
    leading_label = np.zeros(count, dtype=labels.dtype)
    leading_label[bodies] = labels[0, first]
    return np.where((labels[0] == leading_label[body]) | ~possible[body], 1, -1), possible
