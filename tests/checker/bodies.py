"""Motions in space, of rigid bodies and of chains of joints, by distances and bounds of motion."""

import math
from typing import NamedTuple

import fcl
import numpy as np

from .pieces import matrix_of, matrix_of_quaternion
from .verdict import FREE, NOT_SHOWN, TOLERANCE, TOO_MUCH, TOUCHES, Verdict

DEEPEST = 24
"""Times that a piece is halved."""

WORK_OF_DISTANCE = 10


class Body:
    """Triangles, (n, 3, 3), that bound solids or not, and balls, in the frame of a link."""

    def __init__(self, triangles=(), centers=(), radii=(), is_solid=True):
        """Prepare the triangles for distances."""
        self.triangles = np.asarray(triangles, float).reshape(-1, 3, 3)
        self.centers = np.asarray(centers, float).reshape(-1, 3)
        self.radii, self.is_solid = np.asarray(radii, float), is_solid
        self.points = np.concatenate([self.triangles.reshape(-1, 3), self.centers])
        self.grown = np.append(np.zeros(3 * len(self.triangles)), self.radii)
        self.middle = 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))
        away = np.linalg.norm(self.points - self.middle, axis=1)
        self.radius = float((away + self.grown).max())
        self.model = None
        if len(self.triangles):
            mesh, corners = fcl.BVHModel(), self.triangles.reshape(-1, 3)
            mesh.beginModel(len(corners), len(self.triangles))
            mesh.addSubModel(corners, np.arange(len(corners)).reshape(-1, 3))
            mesh.endModel()
            self.model = fcl.CollisionObject(mesh)

    def encloses(self, points):
        """Return which points lie in the solids, by winding numbers, or in the balls."""
        away = np.linalg.norm(points[:, None] - self.centers, axis=2) - self.radii
        inside = (away <= 0.0).any(axis=1)
        if self.is_solid and len(self.triangles):
            a, b, c = np.moveaxis(self.triangles - points[:, None, None], 2, 0)
            x, y, z = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
            above = (a * np.cross(b, c)).sum(-1)
            below = x * y * z + (a * b).sum(-1) * z + (b * c).sum(-1) * x + (c * a).sum(-1) * y
            inside |= np.rint(np.arctan2(above, below).sum(-1) / (2.0 * np.pi)) != 0
        return inside

    def crosses(self, other, pose, other_pose):
        """Return True if a body encloses a point of the other one."""
        to = np.linalg.inv(other_pose) @ pose
        return other.encloses(move(to, self.points)).any() or (
            self.encloses(move(np.linalg.inv(to), other.points)).any()
        )


def move(pose, points):
    """Move points (n, 3) by a pose (4, 4)."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def find_distance(first, second, pose, other):
    """Return the distance of the surfaces of two bodies at poses, zero if they cross."""
    least = np.inf
    if first.model and second.model:
        for body, at in ((first, pose), (second, other)):
            body.model.setTransform(fcl.Transform(at[:3, :3], at[:3, 3]))
        least = max(fcl.distance(first.model, second.model), 0.0)
    to = np.linalg.inv(other) @ pose
    for balls, body, way in ((first, second, to), (second, first, np.linalg.inv(to))):
        if len(balls.radii):
            centers = move(way, balls.centers)
            away = np.linalg.norm(centers[:, None] - body.centers, axis=2) - body.radii
            gaps = away.min(axis=1, initial=np.inf)
            if body.model:
                gaps = np.minimum(gaps, find_distances(centers, body.triangles))
            least = min(least, float((gaps - balls.radii).min()))
    return least


def find_distances(points, triangles):
    """Return the distances of points from triangles, (n,)."""
    p, corners = points[:, None], np.moveaxis(triangles, 1, 0)
    least = np.full((len(points), len(triangles)), np.inf)
    above = np.ones(least.shape, bool)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    size = np.linalg.norm(normal, axis=1)
    for k in range(3):
        a, side = corners[k], corners[(k + 1) % 3] - corners[k]
        share = ((p - a) * side).sum(-1) / np.maximum((side * side).sum(-1), 1e-300)
        away = p - a - np.clip(share, 0.0, 1.0)[..., None] * side
        least = np.minimum(least, np.linalg.norm(away, axis=-1))
        above &= (np.cross(side, p - a) * normal).sum(-1) >= 0.0
    height = abs(((p - corners[0]) * normal).sum(-1)) / np.maximum(size, 1e-300)
    return np.where(above & (size > 0.0), np.minimum(height, least), least).min(axis=1)


class Chain(NamedTuple):
    """Joints, each after its parent; the first one is fixed to the world.

    A joint moves by ``factor * q[index] + offset`` along or about its axis; index -1 is fixed.
    """

    parents: np.ndarray  # (b,)
    frames: np.ndarray  # (b, 4, 4), in the frame of the parent
    axes: np.ndarray  # (b, 3)
    slides: np.ndarray  # (b,), bool
    index: np.ndarray  # (b,)
    factor: np.ndarray  # (b,)
    offset: np.ndarray  # (b,)

    def place(self, q):
        """Return the pose of each joint's link."""
        poses = []
        values = np.append(q, 0.0)[self.index] * self.factor + self.offset
        for k, step in enumerate(values[:, None] * self.axes):
            turned = np.eye(4)
            if self.slides[k]:
                turned[:3, 3] = step
            else:
                turned[:3, :3] = matrix_of(step)
            parent = poses[self.parents[k]] if k else np.eye(4)
            poses.append(parent @ self.frames[k] @ turned)
        return poses

    def list_above(self, link, root=0):
        """List a link and the links above it, below a root."""
        links = []
        while link != root:
            links.append(link)
            link = int(self.parents[link])
        return links

    def bound_travel(self, poses, links, body, steps):
        """Bound how far a body on the first of links moves when their joints do by steps."""
        travel = 0.0
        for link in links:
            index = self.index[link]
            step = abs(self.factor[link]) * steps[index] if index >= 0 else 0.0
            if step and not self.slides[link]:
                middle = move(poses[links[0]], body.middle)
                step *= math.dist(middle, poses[link][:3, 3]) + body.radius + travel
            travel += step
        return travel


def check_chain(pieces, chain, bodies, pairs, budget):
    """Check that pairs of bodies keep more than a distance along pieces of joints.

    Bodies are pairs (link, Body), obstacles those of link 0; pairs are (number, number, distance).
    """
    above = [chain.list_above(link) for link, _ in bodies]
    below = []
    for a, b, _ in pairs:  # what both stand on moves them together
        shared = set(above[a]) & set(above[b])
        below.append([[link for link in above[k] if link not in shared] for k in (a, b)])

    def measure(q, steps):
        poses = chain.place(q)
        for (a, b, distance), sides in zip(pairs, below, strict=True):
            (one, first), (other, second) = bodies[a], bodies[b]
            travel = chain.bound_travel(poses, sides[0], first, steps)
            travel += chain.bound_travel(poses, sides[1], second, steps)
            yield first, second, poses[one], poses[other], distance, travel

    return _check(pieces, measure, budget)


def check_solid(pieces, robot, obstacles, budget, margin=0.0, room=None):
    """Check that a body in space keeps more than a margin from obstacles along pieces.

    Coordinates are x, y, z, and a yaw or a rotation vector; ``room`` is a box to stay in, or None.
    """
    lever = float(np.linalg.norm(robot.middle)) + robot.radius

    def measure(q, steps, spin=(0.0, 0.0, 0.0, 1.0)):
        pose = np.eye(4)
        vector = q[3:] if len(q) == 6 else np.array([0.0, 0.0, q[3:].sum()])
        pose[:3, :3] = matrix_of(vector) @ matrix_of_quaternion(spin)
        pose[:3, 3] = q[:3]
        travel = float(np.linalg.norm(steps[:3]) + lever * np.linalg.norm(steps[3:]))
        for obstacle in obstacles if room is None else (room, *obstacles):
            yield robot, obstacle, pose, np.eye(4), margin, travel

    return _check(pieces, measure, budget)


def _check(pieces, measure, budget):
    """Halve pieces until each distance in the middle exceeds the travel of a half."""
    stack = [(k, 0.0, 1.0, 0) for k in range(len(pieces.start))][::-1]
    while stack:
        k, t0, t1, depth = stack.pop()
        t, half = 0.5 * (t0 + t1), 0.5 * (t1 - t0)
        first, second, third = pieces.rates[k]
        bend = np.maximum(abs(second + t0 * third), abs(second + t1 * third))
        steps = half * (abs(first + t * (second + t * third / 2.0)) + half * bend)
        q = pieces.at(np.array([k]), np.array([t]))[0]
        spin = () if pieces.spin is None else (pieces.spin[k],)
        for body, other, pose, other_pose, distance, travel in measure(q, steps, *spin):
            slack = TOLERANCE * body.radius
            is_room = not isinstance(other, Body)
            if is_room:
                at = move(pose, body.points)
                gap = np.minimum((at - other[0]).min(axis=1), (other[1] - at).min(axis=1))
                gap = float((gap - body.grown).min())
            else:
                middles = move(pose, body.middle), move(other_pose, other.middle)
                gap = math.dist(*middles) - body.radius - other.radius
            if not budget.take(1 if is_room or gap - distance > travel else WORK_OF_DISTANCE):
                return TOO_MUCH
            if not is_room and gap - distance <= travel:
                gap = find_distance(body, other, pose, other_pose)
                # Bodies that are apart at first stay so while their surfaces do not cross.
                if k == depth == 0 and body.crosses(other, pose, other_pose):
                    gap = -np.inf
            if gap < distance - slack or (gap <= 0.0 and not is_room):
                return Verdict(TOUCHES, f"at {q.tolist()}")
            if gap - distance + slack <= travel and travel > slack:
                if depth == DEEPEST:
                    return Verdict(NOT_SHOWN, f"piece {k} grazes an obstacle at {q.tolist()}")
                stack += [(k, t, t1, depth + 1), (k, t0, t, depth + 1)]
                break
    return Verdict(FREE)
