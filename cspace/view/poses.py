"""Configurations as a page shows them: metres, angles in degrees, and poses in space."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from cspace.arrays import Floats
from cspace.rotations import Rotations

ANGLES: Final = ("roll", "pitch", "yaw")
"""Turns about x, then y, then z, all of which stay where they are."""


class Poses:
    """The configurations of a map, of which the first numbers are a position in the plane or in space.

    Attributes
    ----------
    angles : tuple of str
        Those of :data:`ANGLES` that the robot can turn by.
    """

    def __init__(self, dim: int, rotations: Rotations) -> None:
        self.dim, self._rotations = dim, rotations
        q = np.zeros(dim + len(rotations.names))
        q[-1] = 1.0
        self.angles = ANGLES[3 - (rotations.steps(q, q).shape[-1] - dim) :]

    def position(self, q: Floats) -> tuple[float, ...]:
        """Metres."""
        return tuple(q[: self.dim].tolist())

    def degrees(self, q: Floats) -> tuple[float, ...]:
        """The :attr:`angles` of a configuration."""
        m = self._matrix(q)
        roll, yaw = math.atan2(m[2, 1], m[2, 2]), math.atan2(m[1, 0], m[0, 0])
        angles = np.degrees([roll, math.asin(-np.clip(m[2, 0], -1.0, 1.0)), yaw])
        return tuple((np.round(angles, 6) + 0.0).tolist()[3 - len(self.angles) :])

    def of(self, position: tuple[float, ...], degrees: tuple[float, ...]) -> Floats:
        """The configuration of a position and :attr:`angles`."""
        angles = np.zeros(3)
        angles[3 - len(degrees) :] = degrees
        matrix = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        return np.array([*position, *self._rotations.of_matrix(matrix)])

    def pose(self, q: Floats) -> tuple[Floats, Floats]:
        """Where the robot stands in space: a position, and a quaternion w, x, y, z."""
        place = np.array([*self.position(q), 0.0][:3])
        return place, Rotation.from_matrix(self._matrix(q)).as_quat()[[3, 0, 1, 2]]

    def of_pose(self, place: Floats, wxyz: Floats) -> Floats:
        """The configuration nearest to a pose in space."""
        matrix = Rotation.from_quat(np.asarray(wxyz)[[1, 2, 3, 0]]).as_matrix()
        return np.array([*np.asarray(place)[: self.dim], *self._rotations.of_matrix(matrix)])

    def _matrix(self, q: Floats) -> Floats:
        matrix = np.eye(3)
        matrix[: self.dim, : self.dim] = self._rotations.matrices(q)
        return matrix
