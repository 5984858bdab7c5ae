"""Collisions and distances of solids by FCL, without code of the library."""

from itertools import product
from typing import Any

import fcl
import numpy as np
from scipy.spatial.transform import Rotation

ORIGIN, STILL = np.zeros(3), np.eye(3)


class Solid(fcl.CollisionObject):
    """A solid with the radius of its bounding ball."""

    radius: float


def box(sides: Any, at: Any = ORIGIN, turn: Any = STILL) -> Solid:
    """Make a rotated box around a point."""
    made = Solid(fcl.Box(*np.asarray(sides, float)), fcl.Transform(turn, np.asarray(at, float)))
    made.radius = float(np.linalg.norm(sides)) / 2.0
    return made


def ball(radius: float, at: Any = ORIGIN) -> Solid:
    made = Solid(fcl.Sphere(radius), fcl.Transform(np.asarray(at, float)))
    made.radius = radius
    return made


def surface(vertices: Any, faces: Any) -> Any:
    """Make the surface of a mesh."""
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    return fcl.CollisionObject(model)


def meet(one: Any, other: Any) -> bool:
    return bool(fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()) > 0)


def apart(one: Any, others: Any) -> float:
    """Return the distance to the nearest of others, 0 in collision."""
    return float(
        min(
            (0.0 if meet(one, each) else fcl.distance(one, each) for each in others), default=np.inf
        )
    )


def within(low: Any, high: Any, sides: Any, at: Any, turn: Any) -> float:
    """Return the depth of a box inside bounds; negative outside."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * sides @ np.transpose(turn) + at
    return float(np.minimum(corners - low, np.asarray(high) - corners).min())


def rotation_of(q: Any) -> Any:
    """Return the rotation of a configuration in space."""
    return (
        Rotation.from_quat(q[3:])
        if len(q) == 7
        else Rotation.from_rotvec([0.0, 0.0, q[3] if len(q) > 3 else 0.0])
    )
