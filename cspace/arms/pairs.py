"""How often pairs of an arm's links touch, by random configurations: that tells what was meant, and proves nothing."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.arms.proofs import Scene, ask_motions

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

LOOKS: Final = 1000
"""Random configurations after which a pair is said to touch never, or always."""

_FEW: Final = 4
"""Configurations in one of which most pairs are apart."""


def random_points(lower: Floats, upper: Floats, count: int) -> Floats:
    """Configurations within limits, uniform, and within a turn of joints that have none; always the same ones."""
    ends = np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)
    return np.random.default_rng(0).uniform(*ends, (count, len(lower)))


def apart(scene: Scene, points: Floats) -> Bools:
    """Whether each pair of a scene is proven apart at configurations, shape (p, n)."""
    out = np.empty((len(scene.pairs), len(points)), dtype=np.bool_)
    for k, row in enumerate(out):
        ask_motions(scene._replace(pairs=scene.pairs[k : k + 1]), points, points, row)
    return out


def always_touch(scene: Scene, points: Floats) -> Bools:
    """Whether each pair of a scene is proven apart at none of some configurations, shape (p,)."""
    left = np.asarray(~apart(scene, points[:_FEW]).any(axis=1))
    left[left] = ~apart(scene._replace(pairs=scene.pairs[left]), points[_FEW:]).any(axis=1)
    return left
