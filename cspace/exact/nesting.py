"""Whether one solid lies within another, where their surfaces do not meet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cspace.exact.surfaces import anchors_of
from cspace.exact.sweeps.convex import boxes_of
from cspace.shapes import Balls, Mesh, Shape
from cspace.translating import entry

if TYPE_CHECKING:
    from cspace.exact.surfaces import Surface
    from cspace.workspace import Workspace

Floats = NDArray[np.float64]


class Nesting:
    """A robot that translates, and obstacles, as solids.

    What hangs together and meets no surface of the other side lies in its solid as a whole, or not at all, so that one
    point of it tells.

    Parameters
    ----------
    workspace : Workspace
    obstacles : sequence of Surface
        Of the workspace.
    body : Body
        Of the robot.
    robot : sequence of Surface
        Of the body.
    deep : bool
        Whether obstacles may lie in the robot; not so if it is solid in the proofs already, as balls always are.
    """

    def __init__(
        self, workspace: Workspace, obstacles: Sequence[Surface], body: Shape, robot: Sequence[Surface], deep: bool
    ) -> None:
        from scipy.spatial import cKDTree

        from cspace.exact.sweeps import _kernels

        grid = workspace.grid
        shapes: tuple[Any, ...] = workspace.shapes or ()
        self._meshes = [shape for shape in shapes if not isinstance(shape, Balls) and shape.encloses]
        self._anchors = np.concatenate([anchors_of(surface) for surface in robot])
        frame = np.array([*grid.lower, grid.spacing])
        self._cells = entry(_kernels.cells_of_anchors, (workspace.outer, workspace.inner, frame, self._anchors), 3)
        self._body, self._tree = body, None
        if deep and not isinstance(body, Balls):
            lower, upper = body.bounds
            self._middle, self._reach = 0.5 * (lower + upper), 0.5 * float((upper - lower).max())
            parts = [_middles(workspace)] if workspace.shapes is None else map(anchors_of, obstacles)
            self._points = np.concatenate([np.empty((0, 3)), *parts])
            self._tree = cKDTree(self._points) if len(self._points) else None

    def at(self, q: Sequence[float]) -> bool:
        """Whether a part of the robot at a configuration lies in an obstacle, or one of an obstacle in the robot."""
        found = self._cells(*q)
        if found == 2:
            return True
        place = np.asarray(q)
        if found and any(np.any(mesh.contains(self._anchors + place)) for mesh in self._meshes):
            return True
        if self._tree is None:
            return False
        # A little more than the box round the robot, for rounding.
        near = self._tree.query_ball_point(place + self._middle, 1.001 * self._reach, p=np.inf)
        return bool(near) and _lies_in(self._points[near] - place, self._body)


def _lies_in(points: Floats, body: Shape) -> bool:
    """Whether one of some points lies in a body, given that none is on its surface."""
    if isinstance(body, Mesh):
        return bool(np.any(body.contains(points)))
    boxes = boxes_of(body)[:, None]
    return bool(((boxes[..., :3] <= points) & (points <= boxes[..., 3:])).all(axis=-1).any())


def _middles(workspace: Workspace) -> Floats:
    """Middle of one cell of each part of the outer cells that hangs together, shape (n, 3)."""
    from scipy import ndimage

    cells = np.argwhere(workspace.outer)
    labels = ndimage.label(workspace.outer)[0][workspace.outer]
    return workspace.grid.center_of(cells[np.unique(labels, return_index=True)[1]])
