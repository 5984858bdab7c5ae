"""The tool frame of an arm, which users drag to a pose."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from cspace.arms import PoseGoal
from cspace.errors import ConfigurationError
from cspace.inside import Floats, check_known
from cspace.view._blocks import to_quaternion

if TYPE_CHECKING:
    from viser import ViserServer


class ToolFrame:
    """A frame of an arm that users drag to a pose.

    Parameters
    ----------
    space : ArmSpace
    server : viser.ViserServer
    size : float
        Length of the axes that users drag, metres.
    joint_counts : dict of str to int
        Number of joints that move each frame of the arm.
    name : str, optional
        Default: the frame that the most joints move; the last one in a tie. Attached objects are
        skipped.

    Attributes
    ----------
    name : str
        The frame that users drag.
    position_only : bool
        True if the rotation of the frame does not matter, because few joints move it.
    pose : ndarray of float64, shape (4, 4)
        Pose to which users dragged the frame, in the frame of the base.
    is_held : bool
        True during a drag.

    Raises
    ------
    InputError
        If no joint moves a frame of that name.
    """

    def __init__(
        self,
        space: Any,
        server: ViserServer,
        size: float,
        joint_counts: dict[str, int],
        name: str | None = None,
    ) -> None:
        """Choose the frame, and add its axes to the scene."""
        self._space = space
        self.is_held = False
        self.pose = np.eye(4)
        moved = [frame for frame, count in joint_counts.items() if count]
        if name is None:
            candidates = [frame for frame in moved if frame not in space.arm.carriers]
            # The last frame wins a tie.
            name = max(reversed(candidates), key=joint_counts.__getitem__)
        self.name = check_known(name, "frame", moved)
        # Number of joints that a frame needs to reach every nearby pose, a position and a
        # rotation.
        self.position_only = joint_counts[self.name] < 6
        self._gizmo = server.scene.add_transform_controls(
            "/tool",
            scale=size,
            line_width=3.0,
            depth_test=False,
            disable_rotations=self.position_only,
        )

    @property
    def goal(self) -> PoseGoal:
        """The pose that the frame shall reach."""
        goal = PoseGoal(self.name, self.pose)
        if self.position_only:
            metres, _ = goal.tolerance
            goal = PoseGoal(self.name, self.pose, (metres, math.inf))
        return goal

    def follow(self, q: Floats) -> None:
        """Move the gizmo to the frame, except during a drag."""
        if not self.is_held:
            self.move(self._space.arm.pose(q, self.name))

    def move(self, pose: Floats) -> None:
        """Move the gizmo to a pose, shape (4, 4)."""
        self.pose = pose
        self._gizmo.position = pose[:3, 3]
        self._gizmo.wxyz = to_quaternion(pose)

    def on_drag(self, moved: Callable[[ToolFrame], None], released: Callable[[], None]) -> None:
        """Register ``moved`` for drags of the frame, and ``released`` for their end."""

        async def drag(event: Any) -> None:  # async keeps the order of phases
            """Record the pose of the dragged axes, and report it."""
            rotation = Rotation.from_quat(event.target.wxyz, scalar_first=True)
            self.pose = np.eye(4)
            self.pose[:3, :3] = rotation.as_matrix()
            self.pose[:3, 3] = event.target.position
            if event.phase == "end":
                released()
            else:
                moved(self)

        self._gizmo.on_update(drag)

    def solve(self, near: Floats) -> tuple[Floats, str]:
        """Find a configuration, shape (dof,), that brings the frame to :attr:`pose`.

        Among configurations that reach the pose, a FREE one is preferred, then the nearest to
        ``near``. If none reaches it, the one whose frame comes nearest is returned with the reason
        as text; otherwise the text is empty.
        """
        goal = self.goal
        inverse = partial(
            self._space.arm.inverse, goal.frame, goal.pose, tolerance=goal.tolerance, near=near
        )
        # One configuration is found fast, which matters during a drag; most often it is FREE.
        try:
            candidates = np.asarray(inverse(max_solutions=1))
            if not self._space.is_free(candidates[0]):
                candidates = np.asarray(inverse(max_solutions=8))
        except ConfigurationError as error:
            return np.array(error.nearest), str(error)
        first_free = np.argmax(self._space.is_free(candidates))  # 0 if none is free
        return candidates[first_free], ""
