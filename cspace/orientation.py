"""Orientation: how configurations represent a rotation, by no number, a yaw, or a quaternion.

Each representation is a class here: its arithmetic, over arrays of any leading shape, and its text. The rotation cells
of a map are in :mod:`cspace.rotations`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Floats
from cspace.errors import InputError
from cspace.grid import finite

TURN: Final = 2.0 * math.pi

MAX_YAW: Final = 2.0**20
"""Largest yaw, in radians, that is wrapped."""

ROTATION_NAMES: Final = ("yaw", "qx", "qy", "qz", "qw")
"""What the numbers of a rotation are called, and no others of a configuration are."""

NORM_SLACK: Final = 1e-6
"""How far the norm of a quaternion may be from 1."""


class Orientation(ABC):
    """How a configuration, d numbers of a position and then those of a rotation, is moved and turned.

    A *step* is d metres and then a rotation vector, in radians, whose length is the angle: of no numbers, of one in the
    plane and about z, of three in space, about axes that turn with the robot.

    Attributes
    ----------
    names : tuple of str
        The numbers of a rotation.
    """

    names: ClassVar[tuple[str, ...]] = ()

    def canonical(self, q: Floats, name: str = "q") -> Floats:
        """Configurations, shape (..., d + dof), with each yaw in [-pi, pi) and each quaternion of norm 1.

        Numbers that are so already stay as they are, to the last bit.

        Raises InputError if a yaw is too large to be wrapped exactly, or the norm of a quaternion is not 1 within 1e-6.
        """
        place, rotation = self._parts(q)
        return np.concatenate([place, self._canonical(rotation, name)], axis=-1)

    def steps(self, q0: Floats, q1: Floats) -> Floats:
        """The steps that lead from configurations to others, turning the shorter way."""
        (place0, rotation0), (place1, rotation1) = self._parts(q0), self._parts(q1)
        return np.concatenate([place1 - place0, self._between(rotation0, rotation1)], axis=-1)

    def moved(self, q: Floats, steps: Floats) -> Floats:
        """Configurations after steps, or after parts of them: a robot turns evenly along a step."""
        place, rotation = self._parts(q)
        dim = place.shape[-1]
        return np.concatenate([place + steps[..., :dim], self._turned(rotation, steps[..., dim:])], axis=-1)

    def matrices(self, q: Floats) -> Floats:
        """Rotation matrices of configurations, shape (..., d, d)."""
        place, rotation = self._parts(q)
        return self._matrices(rotation, place.shape[-1])

    def checked(self, rotation: ArrayLike, name: str = "rotation") -> Floats:
        """A rotation as its numbers, canonical, shape (dof,).

        Raises InputError if it is not one rotation.
        """
        numbers = np.atleast_1d(finite(rotation, name))
        if numbers.shape != (len(self.names),):
            rule = f"a rotation is given by {', '.join(self.names)}" if self.names else "the robot does not turn"
            raise InputError(name, f"has shape {numbers.shape}", rule, "pass one rotation", value=rotation)
        return self._canonical(numbers, name)

    @abstractmethod
    def text(self, rotation: Floats) -> str:
        """A rotation, shape (dof,), as a text for people."""

    @abstractmethod
    def of_matrix(self, matrix: Floats) -> Floats:
        """The rotation, shape (dof,), that a rotation matrix of space is; of a yaw, that about z alone."""

    def heading(self, q: Floats) -> float | None:
        """The yaw of a configuration, radians; None where its rotation is no yaw."""
        return None

    @abstractmethod
    def near(self, rotation: Sequence[float], angle: float, numbers: Iterator[float]) -> Sequence[float]:
        """A rotation within an angle, made from uniform numbers of [0, 1); plain numbers, as it is made one by one."""

    def _parts(self, q: Floats) -> tuple[Floats, Floats]:
        dim = q.shape[-1] - len(self.names)
        return q[..., :dim], q[..., dim:]

    @abstractmethod
    def _canonical(self, rotation: Floats, name: str) -> Floats: ...
    @abstractmethod
    def _between(self, first: Floats, second: Floats) -> Floats: ...
    @abstractmethod
    def _turned(self, rotation: Floats, by: Floats) -> Floats: ...
    @abstractmethod
    def _matrices(self, rotation: Floats, dim: int) -> Floats: ...


class Unturned(Orientation):
    """No rotation: a robot that only translates."""

    names = ()

    def text(self, rotation: Floats) -> str:
        return ""

    def of_matrix(self, matrix: Floats) -> Floats:
        return np.empty(0)

    def near(self, rotation: Sequence[float], angle: float, numbers: Iterator[float]) -> Sequence[float]:
        return rotation

    def _canonical(self, rotation: Floats, name: str) -> Floats:
        return rotation

    def _between(self, first: Floats, second: Floats) -> Floats:
        return second - first

    def _turned(self, rotation: Floats, by: Floats) -> Floats:
        return rotation

    def _matrices(self, rotation: Floats, dim: int) -> Floats:
        return np.broadcast_to(np.eye(dim), (*rotation.shape[:-1], dim, dim))


class Yaw(Orientation):
    """A yaw: the angle, in radians, about the origin of the plane, or about z."""

    names = ("yaw",)

    def text(self, rotation: Floats) -> str:
        angle = round(180.0 - (180.0 - math.degrees(rotation[0])) % 360.0, 1)
        return f"yaw {angle + 0.0:g}°"  # no minus sign before zero

    def of_matrix(self, matrix: Floats) -> Floats:
        return np.arctan2(matrix[1, :1], matrix[0, :1])

    def heading(self, q: Floats) -> float | None:
        return float(q[-1])

    def near(self, rotation: Sequence[float], angle: float, numbers: Iterator[float]) -> Sequence[float]:
        yaw = rotation[0] + (2.0 * next(numbers) - 1.0) * angle
        turned = (yaw + math.pi) % TURN - math.pi
        return (yaw if -math.pi <= yaw < math.pi else turned if turned < math.pi else -math.pi,)

    def _canonical(self, rotation: Floats, name: str) -> Floats:
        if (np.abs(rotation) > MAX_YAW).any():
            largest = float(np.abs(rotation).max())
            rule = f"at most {MAX_YAW:.0f} can be wrapped exactly"
            raise InputError(name, f"has a yaw of {largest:g} rad", rule, "wrap it first", value=largest)
        return wrapped(rotation)

    def _between(self, first: Floats, second: Floats) -> Floats:
        apart = second - first
        return np.asarray(apart - TURN * np.round(apart / TURN))

    def _turned(self, rotation: Floats, by: Floats) -> Floats:
        return rotation + by

    def _matrices(self, rotation: Floats, dim: int) -> Floats:
        cos, sin = np.cos(rotation[..., 0]), np.sin(rotation[..., 0])
        made = np.zeros((*rotation.shape[:-1], dim, dim)) + np.eye(dim)
        made[..., 0, 0], made[..., 0, 1], made[..., 1, 0], made[..., 1, 1] = cos, -sin, sin, cos
        return made


class Quaternion(Orientation):
    """A unit quaternion, x, y, z, w, either sign of which is the same rotation in space."""

    names = ("qx", "qy", "qz", "qw")

    def text(self, rotation: Floats) -> str:
        by = self._between(np.array([0.0, 0.0, 0.0, 1.0]), rotation)
        angle = float(np.linalg.norm(by))
        axis = ", ".join(f"{x + 0.0:.2g}" for x in np.round(by / max(angle, 1e-9), 2).tolist())
        degrees = f"{round(math.degrees(angle), 1):g}°"
        return f"turned {degrees} about ({axis})" if angle > 1e-9 else "not turned"

    def of_matrix(self, matrix: Floats) -> Floats:
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_matrix(matrix).as_quat())

    def near(self, rotation: Sequence[float], angle: float, numbers: Iterator[float]) -> Sequence[float]:
        by = [(2.0 * next(numbers) - 1.0) * angle / math.sqrt(3.0) for _ in range(3)]
        turned: list[float] = self._turned(np.array(rotation), np.array(by)).tolist()
        return turned

    def _canonical(self, rotation: Floats, name: str) -> Floats:
        norms = np.linalg.norm(rotation, axis=-1, keepdims=True)
        off = np.abs(norms - 1.0)
        if not (off <= NORM_SLACK).all():
            worst = float(norms.reshape(-1)[np.argmax(off)])
            mend = "divide it by its norm; the order is qx, qy, qz, qw"
            raise InputError(name, f"has a quaternion of norm {worst:.9g}", "it must be 1", mend, value=worst)
        return np.where(off <= 4e-16, rotation, rotation / norms)

    def _between(self, first: Floats, second: Floats) -> Floats:
        cosine = (first * second).sum(axis=-1, keepdims=True)
        # Of the difference: nothing but zero where both are the same.
        nearer = np.where(cosine < 0.0, -second, second)
        apart = product_of(first * [-1.0, -1.0, -1.0, 1.0], nearer - first)[..., :3]
        sine = np.linalg.norm(apart, axis=-1, keepdims=True)
        angle = 2.0 * np.arctan2(sine, np.abs(cosine))
        return np.asarray(apart * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0))

    def _turned(self, rotation: Floats, by: Floats) -> Floats:
        half = np.linalg.norm(by, axis=-1, keepdims=True) / 2.0
        turned = product_of(rotation, np.concatenate([by * np.sinc(half / np.pi) / 2.0, np.cos(half)], axis=-1))
        return np.asarray(turned / np.linalg.norm(turned, axis=-1, keepdims=True))

    def _matrices(self, rotation: Floats, dim: int) -> Floats:
        x, y, z, w = np.moveaxis(rotation / np.linalg.norm(rotation, axis=-1, keepdims=True), -1, 0)
        rows = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def wrapped(yaw: Floats) -> Floats:
    """Yaw in [-pi, pi); what is there already is unchanged, to the last bit."""
    turned = (yaw + math.pi) % TURN - math.pi
    turned = np.where(turned >= math.pi, -math.pi, turned)
    return np.where((yaw >= -math.pi) & (yaw < math.pi), yaw, turned)


def shorter(steps: Floats, endless: ArrayLike) -> Floats:
    """Steps, shape (..., dof), without whole turns of the numbers that are angles without an end: the shorter way."""
    return np.where(endless, steps - TURN * np.rint(steps / TURN), steps)


def product_of(first: Floats, second: Floats) -> Floats:
    """Products of quaternions, shapes (..., 4): the second rotation about axes that the first has turned."""
    (x, y, z, w), (a, b, c, d) = np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)
    return np.stack(
        [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ],
        axis=-1,
    )
