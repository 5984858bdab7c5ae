"""Overlap of the links of an arm with obstacles, and its derivatives, for optimizers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from cspace.arms._checks import check_mapping
from cspace.arms._model import Arm
from cspace.errors import InputError
from cspace.inside import REVOLUTE, Floats, compute_poses

if TYPE_CHECKING:
    from cspace.spectral import BallsLike, Bump


class ArmPenetration:
    """Overlap of an arm's balls with fixed balls, with derivatives.

    The overlap is zero if no balls meet, grows with the depth, and is smooth, so that optimizers
    can pull a path out of obstacles. It proves nothing: prove the path with
    :meth:`cspace.ArmSpace.certify_path`. Links are not tested against each other.

    Parameters
    ----------
    arm : Arm
    links : mapping of str to balls
        Balls of each link, in the frame of that name (:attr:`cspace.Arm.frames`), metres: an object
        with ``centers`` and ``radii``, or (centers, radii), for example a result of
        :func:`cspace.spectral.decompose`.
    obstacles : balls
        In the frame of the arm's base, metres.
    bump, tolerance
        As for :class:`cspace.spectral.FourierOverlap`.

    Raises InputError if a value is not as stated. Raises MissingPackageError if finufft is needed,
    for many balls of one radius, and is not installed.
    """

    def __init__(
        self,
        arm: Arm,
        links: Mapping[str, BallsLike],
        obstacles: BallsLike,
        *,
        bump: Bump | None = None,
        tolerance: float = 0.01,
    ) -> None:
        """Put all balls into the frames of bodies; check arguments."""
        from cspace.spectral import BallPenetration, as_balls

        if not links:
            raise InputError("links", "is empty", "there must be one")
        bodies = []
        centers = []
        radii = []
        for name, source in check_mapping(links, "links", arm.placements).items():
            body, pose = arm.placements[name]
            balls = as_balls(source, name, 3)
            bodies.append(np.full(len(balls.radii), body))
            centers.append(balls.centers @ pose[:3, :3].T + pose[:3, 3])
            radii.append(balls.radii)
        obstacle_balls = as_balls(obstacles, "obstacles", 3)
        self.arm = arm
        # The body of each ball, shape (n,), and its center on that body, shape (n, 3).
        self._bodies = np.concatenate(bodies)
        self._centers = np.concatenate(centers)
        self._field = BallPenetration(
            np.concatenate(radii), obstacle_balls, bump=bump, tolerance=tolerance
        )

    def __repr__(self) -> str:
        """Return the arm and its number of balls."""
        return f"ArmPenetration({self.arm!r}, {len(self._bodies):,} balls)"

    def value_and_gradient(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """Compute the overlap at configurations, and its derivatives by the joints.

        ``q``, shape (..., dof), is in radians and metres. The results have shapes (...) and (...,
        dof), in cubic metres, and that per radian or metre. Raises InputError if q is not of finite
        numbers, one for each joint.
        """
        configurations = self.arm._check_configurations(q, "q")
        chain = self.arm.chain
        poses = compute_poses(chain, configurations)
        # Place the balls, shape (..., n, 3).
        ball_poses = poses[..., self._bodies, :, :]
        centers = np.einsum("...kij,kj->...ki", ball_poses[..., :3, :3], self._centers)
        centers += ball_poses[..., :3, 3]
        # The derivative by the center of a ball is a force on it, with a moment about the origin.
        values, forces = self._field.value_and_gradient(centers)
        moments = np.cross(centers, forces)
        gradient = np.zeros(configurations.shape)
        for body in np.flatnonzero(chain.kinds):
            # A joint moves the balls of all bodies that hang on its body.
            is_moved = chain.between[self._bodies, 0, body]
            axis = poses[..., body, :3, :3] @ chain.axes[body]
            force = forces[..., is_moved, :].sum(axis=-2)
            if chain.kinds[body] == REVOLUTE:
                # A joint that turns feels the moment about its axis.
                origin = poses[..., body, :3, 3]
                force = moments[..., is_moved, :].sum(axis=-2) - np.cross(origin, force)
            slope = (axis * force).sum(axis=-1)
            gradient[..., chain.joint_indices[body]] += chain.factors[body] * slope
        return values, gradient
