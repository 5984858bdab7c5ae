"""Slow, plain distances and inside tests of meshes, that share no code with the library."""

import numpy as np
import trimesh


def distance_to_triangles(points, triangles):
    """Exact distances from points (n, 3) to triangles (m, 3, 3), one point at a time."""
    out = np.empty(len(points))
    for n, point in enumerate(points):
        nearest = trimesh.triangles.closest_point(triangles, np.repeat(point[None], len(triangles), axis=0))
        out[n] = np.linalg.norm(nearest - point, axis=1).min()
    return out


def winding_numbers(points, triangles):
    """Winding numbers of closed triangles, by solid angles (van Oosterom and Strackee, 1983)."""
    found = []
    for point in points:
        a, b, c = np.moveaxis(triangles - point, 1, 0)
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        above = np.einsum("ij,ij->i", a, np.cross(b, c))
        below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        found.append(round(np.arctan2(above, below).sum() / (2.0 * np.pi)))
    return np.array(found)


def winds_around(points, triangles):
    """Whether the winding number of triangles is not zero."""
    return winding_numbers(points, triangles) != 0


def sample_surface(triangles, number, rng):
    """Random points on triangles, by area."""
    sides = triangles[:, 1:] - triangles[:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    which = rng.choice(len(triangles), number, p=areas / areas.sum())
    u, v = np.sort(rng.random((2, number)), axis=0)
    weights = np.stack([u, v - u, 1.0 - v], axis=1)
    return np.einsum("nk,nkd->nd", weights, triangles[which])
