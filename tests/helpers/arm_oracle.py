"""Collisions of arms by FCL, with poses by yourdfpy."""

from pathlib import Path
from typing import Any

import fcl
import numpy as np
import yourdfpy

from cspace import Robot
from cspace.arms import Arm, PosedShape, build_arm_space
from tests.helpers import urdfs
from tests.helpers.solids import apart, box


class ArmOracle:
    """Boxes of an arm's links, posed by yourdfpy, among fixed solids.

    Pairs of names in ``allowed`` may touch.
    """

    def __init__(self, path: Path, arm: Arm, still: dict[str, list[Any]], allowed: Any) -> None:
        self._urdf = yourdfpy.URDF.load(
            str(path), load_meshes=False, build_collision_scene_graph=False
        )
        self._arm = arm
        parts = [
            (each.name, part)
            for each in arm.links
            for part in self._urdf.link_map[each.name].collisions
        ]
        self._parts = [(link, part.origin, box(part.geometry.box.size)) for link, part in parts]
        placed = [(name, solid) for name, solids in still.items() for solid in solids]
        names, self._solids = zip(
            *placed, *((link, solid) for link, _, solid in self._parts), strict=True
        )
        free = [{name} for name in names] + [set(pair) for pair in allowed]
        pairs = [
            (k, n)
            for n in range(len(placed), len(names))
            for k in range(n)
            if {names[k], names[n]} not in free
        ]
        self._names, self._pairs = names, np.array(pairs).reshape(-1, 2)
        self._reach = np.array([solid.radius for solid in self._solids])[self._pairs].sum(axis=1)

    def apart(self, q: Any, pair: tuple[str, str] | None = None) -> float:
        """Return the minimum distance of pairs that may not touch, or of the pair with two names."""
        values = dict(zip(self._arm.joints, np.asarray(q, float), strict=True))
        self._urdf.update_cfg(np.array([values[name] for name in self._urdf.actuated_joint_names]))
        poses = {
            link: self._urdf.get_transform(link) for link in {link for link, *_ in self._parts}
        }
        for link, origin, solid in self._parts:
            pose = poses[link] @ origin
            solid.setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))
        centers = np.array([solid.getTranslation() for solid in self._solids])[self._pairs]
        gaps = np.linalg.norm(centers[:, 0] - centers[:, 1], axis=1) - self._reach
        least = np.inf
        if pair is not None:
            gaps[[{self._names[k], self._names[n]} != set(pair) for k, n in self._pairs]] = np.inf
        for k in np.argsort(gaps):
            if gaps[k] >= least or least == 0.0:  # all other pairs are farther apart
                break
            one, other = (self._solids[n] for n in self._pairs[k])
            least = min(least, apart(one, [other]))
        return least


def sample_configurations(arm: Arm, rng: np.random.Generator, count: int) -> Any:
    """Draw configurations of an arm, within one turn of joints without limits."""
    return rng.uniform(
        np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), (count, arm.dof)
    )


def draw_scene(folder: Path, seed: int) -> tuple[Any, ArmOracle, np.random.Generator]:
    """Draw an arm among boxes; a tag on its second link may touch one of them."""
    rng = np.random.default_rng(seed)
    path = urdfs.random_arm(folder, seed)
    tag = urdfs.link("tag", ((0.2, 0.1, 0.3), (0.3, 0.0, 0.1)))
    mount = urdfs.joint("mount", "l2", "tag", kind="fixed", limits=None)
    path.write_text(path.read_text().replace("</robot>", f"{tag}{mount}</robot>"))
    arm = Arm.from_urdf(path)
    shapes = {}
    still = {}
    for number in range(4):
        sides = rng.uniform(0.05, 0.4, 3)
        at = rng.choice([-1, 1], 3) * rng.uniform(0.35, 1.0, 3)
        x, y, z = at.tolist()
        pose = urdfs.pose_at(x, y, z, rng.normal(size=3))
        shapes[f"block{number}"] = PosedShape(Robot.box(sides).shape, pose)
        still[f"block{number}"] = [box(sides, at, pose[:3, :3])]
    may_touch: Any = [("l0", name) for name in shapes] + [("tag", "block0"), ("l1", "tag")]
    space = build_arm_space(shapes, arm, allowed_collisions=may_touch)
    return space, ArmOracle(path, arm, still, [*arm.allowed_collisions, *may_touch]), rng


def approach_contact(oracle: ArmOracle, q0: Any, q1: Any) -> tuple[Any, Any]:
    """Return two configurations on both sides of contact, if the ends are on both sides."""
    if (oracle.apart(q0) > 0.0) == (oracle.apart(q1) > 0.0):
        return q0, q1
    free, other = (q0, q1) if oracle.apart(q0) > 0.0 else (q1, q0)
    for _ in range(14):
        middle = 0.5 * (free + other)
        if oracle.apart(middle) > 0.0:
            free = middle
        else:
            other = middle
    return free, other
