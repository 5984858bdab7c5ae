"""Collisions of arms by FCL, with poses by yourdfpy."""

from pathlib import Path
from typing import Any

import fcl
import numpy as np
import yourdfpy

from cspace.arms import Arm
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
