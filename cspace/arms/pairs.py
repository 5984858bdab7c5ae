"""How often pairs of an arm's links touch, at random configurations: a hint at what was meant, and no proof."""

from __future__ import annotations

from typing import Final

import numpy as np

from cspace.arms.proofs import Scene, are_free
from cspace.arrays import Bools, Floats

LOOKS: Final = 1000
"""Random configurations after which a pair is said to touch never, or always."""

_FEW: Final = 4
"""Configurations in one of which most pairs are apart."""


def random_points(ranges: tuple[Floats, Floats], count: int) -> Floats:
    """Configurations within ranges, uniform, and always the same ones."""
    return np.random.default_rng(0).uniform(*ranges, (count, len(ranges[0])))


def apart(scene: Scene, points: Floats) -> Bools:
    """Whether each pair of a scene is proven apart at configurations, shape (p, n)."""
    proven = [are_free(scene._replace(pairs=pair[np.newaxis]), points, points) for pair in scene.pairs]
    return np.array(proven, dtype=np.bool_).reshape(-1, len(points))


def always_touch(scene: Scene, points: Floats) -> Bools:
    """Whether each pair of a scene is proven apart at none of some configurations, shape (p,)."""
    left = np.asarray(~apart(scene, points[:_FEW]).any(axis=1))
    left[left] = ~apart(scene._replace(pairs=scene.pairs[left]), points[_FEW:]).any(axis=1)
    return left
