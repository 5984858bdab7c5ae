"""Readings: how the triangles of a body count, and whether they close it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """How some bodies are read.

    Attributes
    ----------
    turns : ndarray of int64
        For each triangle 1, -1 or 0; see :class:`cspace.raster.solids.inside.bodies.Body`.
    closed, oriented, wound, told, manifold : ndarray of bool
        For each body. ``told``: whether the way in which its triangles were given says which side is its outer one.
    """

    turns: Integers
    closed: Bools
    oriented: Bools
    wound: Bools
    told: Bools
    manifold: Bools


def read(edge: Integers, direction: Integers, body: Integers, number: int, sign: Integers, group: Integers) -> Reading:
    """How bodies are read; each in the first of these ways that closes it.

    1. Each of several equal triangles counts once, and all are turned alike.
    2. Each triangle counts as it was given and as often as it was, and along each edge the directions add up to zero,
       though not all triangles cancel. So parts that share triangles are told apart, whether these are a wall between
       the parts, given once for each side, or one face on which both stand, given twice for the same side.
    3. Each of several equal triangles counts once, and they are not turned alike.
    4. One of an odd number of equal triangles counts, and none of an even number.

    A body that is not turned alike, but has two triangles at each edge, is turned alike by going from each to its
    neighbours; only surfaces that pass through themselves, like Klein's bottle, refuse. Where equal triangles are given
    both ways, as for rendering both sides, a body does not tell its outer side, unless it is read in the second way.

    Parameters
    ----------
    edge, direction : ndarray of int64, shape (n, 3)
        Number of each side of each triangle, and which way the triangle runs along it, 1 or -1.
    body : ndarray of int64, shape (n,)
        Body of each triangle.
    number : int
        How many bodies there are.
    sign, group : ndarray of int64, shape (n,)
        See :func:`equal_triangles`.
    """
    once = first_of_each(group)
    closed, oriented, manifold = _closing(edge, direction, body, number, once)
    turns, told = once.astype(np.int64), oriented.copy()
    if not once.all():
        net, size = np.bincount(group, weights=sign)[group], np.bincount(group)[group]
        told[body[np.abs(net) < size]] = False
        given = _closing(edge, direction, body, number, np.ones(len(group), dtype=np.bool_))[1]
        given &= np.bincount(body, weights=net != 0.0, minlength=number) > 0
        second = given & ~(closed & oriented)
        odd = _odd(group, sign)
        odd_closed, odd_oriented, _ = _closing(edge, direction, body, number, odd)
        fourth = odd_closed & ~closed & ~second
        turns = np.where(second[body], 1, np.where(fourth[body], odd, turns))
        oriented = np.where(second, True, np.where(fourth, odd_oriented, oriented))
        told = np.where(second | fourth, oriented & (second | told), told)
        manifold &= ~second & ~fourth
        closed = closed | second | fourth
    turns[~closed[body]] = 0
    oriented &= closed
    wound = oriented.copy()
    astray = closed & manifold & ~oriented
    if astray.any():
        some = np.flatnonzero(astray[body] & once)
        turns[some], found = _turned_alike(edge[some], direction[some], body[some], number)
        wound |= astray & found
    return Reading(turns, closed, oriented, wound, told & oriented, manifold & closed)


def equal_triangles(corners: Integers) -> tuple[Integers, Integers]:
    """For each triangle the sign of the permutation that sorts its corners, and the number of its set of corners."""
    a, b, c = corners.T
    inversions = (a > b).astype(np.int64) + (b > c) + (a > c)
    sign = 1 - 2 * (inversions % 2)
    ordered = np.sort(corners, axis=1)
    order = np.lexsort(ordered.T)
    new = np.concatenate([[False], (np.diff(ordered[order], axis=0) != 0).any(axis=1)])
    group = np.empty(len(corners), dtype=np.int64)
    group[order] = np.cumsum(new)
    return sign, group


def first_of_each(group: Integers) -> Bools:
    """The first triangle of each group."""
    chosen = np.zeros(len(group), dtype=np.bool_)
    chosen[np.unique(group, return_index=True)[1]] = True
    return chosen


def _odd(group: Integers, sign: Integers) -> Bools:
    """One triangle of each group of odd size, turned as most of the group."""
    majority = np.bincount(group, weights=sign)[group] * sign > 0
    odd = np.flatnonzero((np.bincount(group)[group] % 2 == 1) & majority)
    chosen = np.zeros(len(group), dtype=np.bool_)
    chosen[odd[np.unique(group[odd], return_index=True)[1]]] = True
    return chosen


def _closing(
    edge: Integers, direction: Integers, body: Integers, number: int, chosen: Bools
) -> tuple[Bools, Bools, Bools]:
    """For each body whether the chosen triangles close it, are turned alike, and meet in twos."""
    # Bodies may touch along an edge: each counts its own triangles there.
    key = np.repeat(body[chosen], 3) * (int(edge.max()) + 1) + edge[chosen].ravel()
    sides, side = np.unique(key, return_inverse=True)
    owner = sides // (int(edge.max()) + 1)
    met = np.bincount(side, minlength=len(sides))
    closed = np.bincount(body[chosen], minlength=number) > 0
    oriented, manifold = closed.copy(), closed.copy()
    closed[owner[met % 2 == 1]] = False
    manifold[owner[met != 2]] = False
    oriented[owner[np.bincount(side, weights=direction[chosen].ravel(), minlength=len(sides)) != 0.0]] = False
    return closed, oriented, manifold


def _turned_alike(edge: Integers, direction: Integers, body: Integers, number: int) -> tuple[Integers, Bools]:
    """How triangles that meet in twos must be turned, 1 or -1, to be turned alike; for each body, whether they can."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(edge)
    order = np.argsort(np.repeat(body, 3) * (int(edge.max()) + 1) + edge.ravel(), kind="stable").reshape(-1, 2)
    one, other = (order // 3).T
    unlike = np.equal(*direction.ravel()[order].T)
    # A node for each triangle as it is, and one for it turned over; those that go together are linked.
    start = np.concatenate([one, n + one])
    stop = np.concatenate([other + n * unlike, other + n * ~unlike])
    links = coo_array((np.ones(len(start), dtype=np.int8), (start, stop)), shape=(2 * n, 2 * n))
    label = connected_components(links, directed=False)[1].reshape(2, n)
    possible = np.ones(number, dtype=np.bool_)
    possible[body[label[0] == label[1]]] = False
    bodies, first = np.unique(body, return_index=True)
    leading = np.zeros(number, dtype=label.dtype)
    leading[bodies] = label[0, first]
    return np.where((label[0] == leading[body]) | ~possible[body], 1, -1), possible
