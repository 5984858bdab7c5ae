"""An arm as pictures show it: the surfaces of its links and of the obstacles, and where a path takes it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.plot.route import Floats


class Surface(NamedTuple):
    """Triangles: vertices, shape (V, 3), metres, and indices of their corners, shape (F, 3)."""

    vertices: Floats
    faces: NDArray[np.int64]


class ArmFigure:
    """An arm among obstacles, as surfaces.

    Parameters
    ----------
    space : ArmSpace

    Attributes
    ----------
    links : dict of str to Surface
        Each in its own frame.
    obstacles : dict of str to Surface
        In the frame of the base.
    tip : str
        The link that most joints move.
    """

    def __init__(self, space: Any) -> None:
        self._arm = arm = space.arm
        self.links = {}
        for link in arm.links:
            whole = joined([Surface(part.moved(part.shape.surface[0]), part.shape.surface[1]) for part in link.parts])
            back = np.linalg.inv(arm.frames.get(link.name, np.eye(4)))
            self.links[link.name] = whole._replace(vertices=moved(whole.vertices, back))
        self.obstacles = {
            name: Surface(each.moved(each.shape.surface[0]), each.shape.surface[1])
            for name, each in space.obstacles.items()
        }
        depth = [0]
        for parent in arm.chain.parents[1:].tolist():
            depth.append(depth[parent] + 1)
        self.tip = max(arm.links, key=lambda link: depth[link.body]).name
        self._middle = np.mean(self.links[self.tip].vertices, axis=0)

    def placed(self, q: Floats) -> dict[str, Surface]:
        """The surfaces of the links at a configuration, shape (dof,), by name."""
        poses = self._arm.poses(q)
        return {name: each._replace(vertices=moved(each.vertices, poses[name])) for name, each in self.links.items()}

    def tips(self, points: Floats) -> Floats:
        """Where the middle of the :attr:`tip` is at configurations, shape (n, 3)."""
        return np.stack([moved(self._middle, self._arm.poses(q)[self.tip]) for q in points])


def joined(surfaces: list[Surface]) -> Surface:
    """Surfaces as one."""
    starts = np.cumsum([0, *(len(each.vertices) for each in surfaces)])
    faces = [each.faces + start for each, start in zip(surfaces, starts.tolist(), strict=False)]
    return Surface(np.concatenate([each.vertices for each in surfaces]), np.concatenate(faces))


def moved(points: Floats, pose: Floats) -> Floats:
    """Points, shape (..., 3), where a pose, shape (4, 4), takes them."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def along_joints(points: Floats, shares: Floats) -> Floats:
    """Configurations at shares, from 0 to 1, of the way along a path in the joints, shape (n, dof)."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return np.stack([np.interp(shares * way[-1], way, column) for column in points.T], axis=-1)
