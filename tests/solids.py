"""Solids in space as FCL has them, which shares no code with the library: whether they meet, how far they are apart."""

from itertools import product
from pathlib import Path
from typing import Any

import fcl
import numpy as np
import yourdfpy
from scipy.spatial.transform import Rotation

from cspace.arms import Arm

ORIGIN, STILL = np.zeros(3), np.eye(3)


def box(sides: Any, at: Any = ORIGIN, turn: Any = STILL) -> Any:
    """A box around a point, turned."""
    return fcl.CollisionObject(fcl.Box(*np.asarray(sides, float)), fcl.Transform(turn, np.asarray(at, float)))


def ball(radius: float, at: Any = ORIGIN) -> Any:
    return fcl.CollisionObject(fcl.Sphere(radius), fcl.Transform(np.asarray(at, float)))


def surface(vertices: Any, faces: Any) -> Any:
    """The triangles of a mesh."""
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    return fcl.CollisionObject(model)


def meet(one: Any, other: Any) -> bool:
    return bool(fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()) > 0)


def apart(one: Any, others: Any) -> float:
    """The least distance from any of others: zero where they meet, and no end of it where there are none."""
    return float(min((0.0 if meet(one, each) else fcl.distance(one, each) for each in others), default=np.inf))


def within(low: Any, high: Any, sides: Any, at: Any, turn: Any) -> float:
    """How far the corners of a box are within bounds, below zero where one is outside."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * sides @ np.transpose(turn) + at
    return float(np.minimum(corners - low, np.asarray(high) - corners).min())


def turn_of(q: Any) -> Any:
    """The rotation of a configuration in space: of none, a yaw, or a quaternion."""
    return Rotation.from_quat(q[3:]) if len(q) == 7 else Rotation.from_rotvec([0.0, 0.0, q[3] if len(q) > 3 else 0.0])


class ArmOracle:
    """The boxes of an arm's links, placed by yourdfpy, among solids that stay, by name."""

    def __init__(self, path: Path, arm: Arm, still: dict[str, list[Any]], allowed: Any) -> None:
        """``allowed``: the pairs of names that may touch."""
        self._urdf = yourdfpy.URDF.load(str(path), load_meshes=False, build_collision_scene_graph=False)
        self._arm, self._still = arm, still
        self._allowed = {frozenset(pair) for pair in allowed}

    def apart(self, q: Any) -> float:
        """The least distance of any pair that may not touch; zero in collision."""
        values = dict(zip(self._arm.joints, np.asarray(q, float), strict=True))
        self._urdf.update_cfg(np.array([values[name] for name in self._urdf.actuated_joint_names]))
        solids = {each.name: list(self._parts(each.name)) for each in self._arm.links} | self._still
        links = [each.name for each in self._arm.links]
        pairs = [(one, other) for k, one in enumerate(links) for other in [*links[k + 1 :], *self._still]]
        asked = [(one, other) for one, other in pairs if frozenset((one, other)) not in self._allowed]
        return min((apart(part, solids[other]) for one, other in asked for part in solids[one]), default=np.inf)

    def _parts(self, link: str) -> Any:
        for part in self._urdf.link_map[link].collisions:
            pose = self._urdf.get_transform(link) @ part.origin
            yield box(part.geometry.box.size, pose[:3, 3], pose[:3, :3])


def sampled(arm: Arm, rng: np.random.Generator, count: int) -> Any:
    """Configurations of an arm, within a turn where a joint has no end."""
    return rng.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), (count, arm.dof))
