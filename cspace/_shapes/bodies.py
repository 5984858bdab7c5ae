"""Bodies of a mesh: its connected parts, and how often each triangle counts in them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cspace._shapes.shape import unique_rows
from cspace._support.arrays import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class MeshBody:
    """Triangles of a mesh that are connected through shared edges.

    Attributes
    ----------
    faces : ndarray of int64, shape (n,)
        Indices of its triangles.
    multiplicities : ndarray of int64, shape (n,)
        How often each triangle counts, negative if reversed, 0 if it repeats another one. All 0 for
        an open body.
    closed : bool
        True if the counted triangles cancel along each edge.
    volume : float
        Enclosed volume, cubic metres: negative if the body faces inward, zero if it is open or
        cancels out.
    """

    faces: Ints
    multiplicities: Ints
    closed: bool
    volume: float


def find_bodies(vertices: Floats, faces: Ints) -> tuple[MeshBody, ...]:
    """Find a mesh's bodies, ordered by first triangle.

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
    tuple of MeshBody
    """
    # Equal vertices get one number, so that triangles meet where only coordinates agree.
    _, vertex_numbers = unique_rows(vertices)
    corners = vertex_numbers[faces]
    has_distinct_corners = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    has_no_area = has_distinct_corners & (np.cross(b - a, c - a) == 0.0).all(axis=1)
    closed: list[MeshBody] = []
    open_bodies: list[MeshBody] = []
    remaining = np.flatnonzero(has_distinct_corners & ~has_no_area)
    no_triangles = np.empty(0, dtype=np.int64)
    # The triangles that each pass adds, and how many triangles may share an edge that joins them.
    passes = (
        (no_triangles, 2),
        (no_triangles, len(faces)),
        (np.flatnonzero(has_no_area), len(faces)),
    )
    for added, max_shared in passes:
        if not len(remaining):
            break
        # What is open after one pass is tried again by the next one.
        candidates = np.sort(np.concatenate([remaining, added]))
        open_bodies = []
        triangles = vertices[faces[candidates]]
        for local_body in _split_bodies(triangles, corners[candidates], max_shared):
            body = replace(local_body, faces=candidates[local_body.faces])
            if body.closed:
                closed.append(body)
            elif not has_no_area[body.faces].all():
                # Open parts without any area are not worth a body.
                open_bodies.append(body)
        remaining = np.concatenate([no_triangles, *(body.faces for body in open_bodies)])
    bodies = _orient_outward(vertices, faces, closed) + open_bodies
    return tuple(sorted(bodies, key=lambda body: int(body.faces[0])))


def label_components(first: Ints, second: Ints, count: int) -> Ints:
    """Label the connected components of a graph.

    Labels ascend in the order of the components' first vertices. The graph has `count` vertices,
    and edges from `first[i]` to `second[i]`. Returns shape (count,).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(first), dtype=np.bool_), (first, second)), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    return np.asarray(labels, dtype=np.int64)


def _split_bodies(triangles: Floats, corners: Ints, max_shared: int) -> list[MeshBody]:
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
    # Arrays of triangles, shape (n,): first, copies, net, body and multiplicity. Arrays of bodies,
    # shape (count,): balanced, manifold, closed, and directed if they keep the given directions.
    edge, direction = _number_edges(corners)
    first, copies, net = _find_copies(corners)
    triangles_at_edge = np.bincount(edge[first].ravel(), minlength=int(edge.max()) + 1)
    body, count = _label_bodies(edge, triangles_at_edge <= max_shared)
    balanced, manifold = _test_closed_and_manifold(edge, direction, body, count, first)
    # Rule 1. The given directions decide which way a body faces, unless copies cancel.
    multiplicity = first.astype(np.int64)
    closed = balanced.copy()
    directed = balanced.copy()
    directed[body[np.abs(net) < copies]] = False  # copies that face both ways
    if not first.all():  # rule 2
        all_triangles = np.ones(len(first), dtype=np.bool_)
        balanced_by_all, _ = _test_closed_and_manifold(edge, direction, body, count, all_triangles)
        by_rule_2 = ~closed & balanced_by_all
        # A body whose triangles all cancel encloses nothing.
        by_rule_2 &= np.bincount(body, weights=net != 0, minlength=count) > 0
        multiplicity[by_rule_2[body]] = 1
        closed |= by_rule_2
        directed |= by_rule_2
    # Rule 3.
    by_rule_3 = manifold & ~closed
    if by_rule_3.any():
        members = np.flatnonzero(by_rule_3[body] & first)
        signs, is_orientable = _orient_consistently(
            edge[members], direction[members], body[members], count
        )
        multiplicity[members] = signs
        closed |= by_rule_3 & is_orientable
    multiplicity[~closed[body]] = 0
    # A body whose facing is open to choice faces outward.
    volume = _compute_volumes(triangles, multiplicity, body, count)
    is_reversed = closed & ~directed & (volume < 0.0)
    multiplicity = np.where(is_reversed[body], -multiplicity, multiplicity)
    volume = np.where(is_reversed, -volume, volume)
    # List the triangles of each body.
    by_body = np.argsort(body, kind="stable")
    stops = np.cumsum(np.bincount(body, minlength=count))
    members_of_bodies = np.split(by_body, stops[:-1])
    return [
        MeshBody(members, multiplicity[members], bool(closed[number]), float(volume[number]))
        for number, members in enumerate(members_of_bodies)
    ]


def _orient_outward(vertices: Floats, faces: Ints, bodies: list[MeshBody]) -> list[MeshBody]:
    """Reverse closed bodies that face inward, except cavities.

    ``vertices`` has shape (V, 3), ``faces`` (F, 3). A cavity has all of its corners in bodies that
    face outward. Any other body that faces inward would wrongly cancel whatever it overlaps.
    """
    volume = np.array([body.volume for body in bodies])  # negative if a body faces inward
    outward = volume > 0.0
    inward = volume < 0.0
    if not inward.any():
        return bodies
    multiplicity = np.concatenate([body.multiplicities for body in bodies])
    owner = np.repeat(np.arange(len(bodies)), [len(body.faces) for body in bodies])
    triangles = vertices[faces[np.concatenate([body.faces for body in bodies])]]
    is_reversed = inward.copy()
    if outward.any():
        # The winding number of the outward bodies around the corners of an inward body decides.
        from cspace._raster.surfaces import WindingNumber

        # Masks and indices of triangles: those of outward bodies, and those of inward bodies.
        around = outward[owner] & (multiplicity != 0)
        within = np.flatnonzero(inward[owner])
        center = triangles.reshape(-1, 3).mean(axis=0)
        corners = (triangles[within] - center).reshape(-1, 3)
        winding = WindingNumber(triangles[around] - center, multiplicity[around])
        is_outside = winding.evaluate(corners) <= 0
        owner_of_corners = np.repeat(owner[within], 3)
        is_reversed = np.zeros(len(bodies), dtype=np.bool_)
        is_reversed[owner_of_corners[is_outside]] = True
    oriented = list(bodies)
    for number in np.flatnonzero(is_reversed).tolist():
        body = bodies[number]
        oriented[number] = replace(body, multiplicities=-body.multiplicities, volume=-body.volume)
    return oriented


def _compute_volumes(triangles: Floats, multiplicity: Ints, body: Ints, count: int) -> Floats:
    """Return the enclosed volume of each body.

    The result has shape (count,), in cubic metres. ``triangles`` has shape (n, 3, 3), metres;
    ``multiplicity`` and ``body``, shape (n,), belong to each triangle, as in :class:`MeshBody`.
    Volumes whose sign rounding leaves uncertain become zero.
    """
    # Sum the signed volumes of the tetrahedra between a point near the body's center and its
    # triangles.
    x, y, z = (np.bincount(body, weights=triangles[:, 0, k], minlength=count) for k in range(3))
    triangle_counts = np.maximum(np.bincount(body, minlength=count), 1)
    center = np.stack([x, y, z], axis=-1) / triangle_counts[:, None]
    a, b, c = np.moveaxis(triangles - center[body][:, None], 1, 0)
    tetrahedra = np.einsum("ij,ij->i", a, np.cross(b, c)) * multiplicity / 6.0
    volume = np.bincount(body, weights=tetrahedra, minlength=count)
    moduli = np.bincount(body, weights=np.abs(tetrahedra), minlength=count)
    # Largest rounding of a volume, relative to the sum of its tetrahedra's absolute volumes.
    is_certain = np.abs(volume) > 2.0**-30 * moduli
    return np.where(is_certain, volume, 0.0)


def _number_edges(corners: Ints) -> tuple[Ints, Ints]:
    """Assign a number to each edge of triangles.

    ``corners``, shape (n, 3), has vertex indices. Sides on the same two vertices share an edge.
    Returns the edge of each triangle side, and the direction of the side along it, 1 or -1, each of
    shape (n, 3).
    """
    start = corners
    end = np.roll(corners, -1, axis=1)
    vertex_count = int(corners.max()) + 1
    # One number for a pair of vertices, in either order.
    key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
    _, edge = np.unique(key.ravel(), return_inverse=True)
    return edge.reshape(key.shape), np.where(start < end, 1, -1)


def _find_copies(corners: Ints) -> tuple[Bools, Ints, Ints]:
    """Find the copies of each triangle, on the same three corners.

    ``corners`` has shape (n, 3). Returns three arrays of shape (n,): True for the first of its
    copies, the number of copies, and the sum of their signs, which are 1 or -1 by direction.
    """
    a, b, c = corners.T
    is_odd = (a > b) ^ (b > c) ^ (a > c)  # an odd permutation of the sorted corners
    sign = np.where(is_odd, -1, 1)
    _, group = unique_rows(np.sort(corners, axis=1))
    _, first_of_groups = np.unique(group, return_index=True)
    is_first = np.zeros(len(corners), dtype=np.bool_)
    is_first[first_of_groups] = True
    copies = np.bincount(group)
    net = np.bincount(group, weights=sign).astype(np.int64)
    return is_first, copies[group], net[group]


def _label_bodies(edge: Ints, joining: Bools) -> tuple[Ints, int]:
    """Label each triangle's body, and count bodies.

    ``edge``, shape (n, 3), has the edges of each triangle. `joining`, shape (edges,), marks the
    edges that join triangles.
    """
    triangle_count = len(edge)
    triangle, side = np.nonzero(joining[edge])
    # The graph has a vertex for each triangle, followed by one for each edge.
    edge_vertex = triangle_count + edge[triangle, side]
    labels = label_components(triangle, edge_vertex, triangle_count + len(joining))
    body_labels, body = np.unique(labels[:triangle_count], return_inverse=True)
    return body.astype(np.int64), len(body_labels)


def _test_closed_and_manifold(
    edge: Ints, direction: Ints, body: Ints, count: int, chosen: Bools
) -> tuple[Bools, Bools]:
    """Return which bodies are balanced, and which are manifolds.

    A body is balanced if its chosen triangles cancel along each edge, and a manifold if exactly two
    of them meet at each edge. ``edge`` and ``direction`` have shape (n, 3), ``body`` and `chosen`
    (n,). Returns two arrays of shape (count,).
    """
    # Bodies can touch along an edge, so each body counts only its own triangles there.
    edge_count = int(edge.max()) + 1
    # One number for a pair of body and edge; each triangle has three of them.
    key = np.repeat(body[chosen], 3) * edge_count + edge[chosen].ravel()
    body_edges, body_edge = np.unique(key, return_inverse=True)
    owner = body_edges // edge_count
    balance = np.bincount(body_edge, weights=direction[chosen].ravel(), minlength=len(body_edges))
    sides = np.bincount(body_edge, minlength=len(body_edges))
    # A body without chosen triangles is neither.
    balanced = np.bincount(body[chosen], minlength=count) > 0
    manifold = balanced.copy()
    balanced[owner[balance != 0.0]] = False
    manifold[owner[sides != 2]] = False
    return balanced, manifold


def _orient_consistently(edge: Ints, direction: Ints, body: Ints, count: int) -> tuple[Ints, Bools]:
    """Orient adjacent triangles consistently.

    Returns signs of 1 or -1, shape (n,), that multiply the given directions, and a mask of the
    bodies for which such signs exist, shape (count,). Exactly two triangles must meet at each edge.
    ``edge`` and ``direction`` have shape (n, 3), ``body`` (n,).
    """
    triangle_count = len(edge)
    # One number for a pair of body and edge. Sides are numbered through all triangles.
    key = np.repeat(body, 3) * (int(edge.max()) + 1) + edge.ravel()
    # The two sides at each edge follow each other.
    side_a, side_b = np.argsort(key, kind="stable").reshape(-1, 2).T
    triangle_a = side_a // 3
    triangle_b = side_b // 3
    disagree = direction.ravel()[side_a] == direction.ravel()[side_b]
    # Each triangle has two nodes, as given and reversed; consistent choices are linked.
    reversed_a = triangle_count + triangle_a
    reversed_b = triangle_count + triangle_b
    start = np.concatenate([triangle_a, reversed_a])
    stop = np.concatenate(
        [np.where(disagree, reversed_b, triangle_b), np.where(disagree, triangle_b, reversed_b)]
    )
    labels = label_components(start, stop, 2 * triangle_count)
    given_label = labels[:triangle_count]
    reversed_label = labels[triangle_count:]
    is_orientable = np.ones(count, dtype=np.bool_)
    is_orientable[body[given_label == reversed_label]] = False
    # The first triangle of each body keeps its direction.
    bodies, first = np.unique(body, return_index=True)
    label_of_body = np.zeros(count, dtype=labels.dtype)
    label_of_body[bodies] = given_label[first]
    keeps_direction = (given_label == label_of_body[body]) | ~is_orientable[body]
    return np.where(keeps_direction, 1, -1), is_orientable
