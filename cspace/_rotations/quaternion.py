"""Rotation cells of unit quaternions, for all rotations in space."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._rotations.base import (
    COVERING_ANGLE,
    Coordinate,
    HasSymmetries,
    Rotations,
    RotationTable,
)
from cspace._rotations.lookup import NORM_SLACK, OTHER_COMPONENTS, QUOTIENT_SLACK
from cspace._support.arrays import Floats, Ints, frozen
from cspace._support.check import check_count, check_points
from cspace.errors import InputError

MAX_PARTS_PER_AXIS: Final = 64
"""Largest number of parts of an axis, which gives a million cells."""

MAX_ANGLE_TIMES_PARTS: Final = 2.7207
"""Upper bound of the covering angle, radians, times the parts of an axis."""


_CONJUGATE: Final = np.array([-1.0, -1.0, -1.0, 1.0])
"""Signs of the components of the inverse of a unit quaternion."""


_HALF_TURNS: Final = np.array(
    [np.diag(signs) for signs in ((1, -1, -1), (-1, 1, -1), (-1, -1, 1), (1, 1, 1))], float
)
"""Matrices of the half turns about x, y and z, and the identity."""


@dataclass(frozen=True, repr=False)
class QuaternionRotations(Rotations):
    """Cells of quaternions, for SE(3); see :meth:`Rotations.quaternions`.

    The index of a cell is ``((c * n + i) * n + j) * n + k``, with the largest component c and the
    parts i, j and k of the quotients of the others, in the order x, y, z, w. A boundary belongs to
    the cell above it.

    Attributes
    ----------
    n : int
        Parts of an axis.
    """

    n: int
    names = ("qx", "qy", "qz", "qw")
    _limits = "a quaternion (qx, qy, qz, qw) of norm 1"
    _COORDINATES: ClassVar[Mapping[str, Coordinate]] = {
        "quaternion": Coordinate(
            "representative of a rotation cell, as (x, y, z, w)", "1", {"component": 4}
        ),
        "covering_angle": COVERING_ANGLE,
    }

    @classmethod
    def _of_value(cls, value: ArrayLike | None) -> QuaternionRotations:
        """Create cells from an axis's number of parts.

        See :meth:`Rotations.quaternions`.
        """
        return cls(check_count(value, "rotations", 1, MAX_PARTS_PER_AXIS))

    @classmethod
    def _of_stored_arrays(cls, coordinates: Mapping[str, NDArray[Any]]) -> QuaternionRotations:
        """Create cells from their centers, which determine n."""
        cells_per_chart = len(coordinates["quaternion"]) / 4.0  # n^3 for each largest component
        return cls(max(1, round(cells_per_chart ** (1.0 / 3.0))))

    def _canonical_rotation(self, rotation: Floats, name: str) -> Floats:
        """Return quaternions, shape (..., 4), with norm 1.

        Raises InputError if a norm is off by more than NORM_SLACK.
        """
        norms = np.linalg.norm(rotation, axis=-1, keepdims=True)
        errors = np.abs(norms - 1.0)
        if not (errors <= NORM_SLACK).all():
            worst = float(norms.reshape(-1)[np.argmax(errors)])
            problem = f"has a quaternion of norm {worst:.9g}"
            raise InputError(name, problem, "it must be 1")
        # A norm that is off by rounding alone, two units in the last place, counts as 1.
        return np.where(errors <= 4e-16, rotation, rotation / norms)

    def _rotation_between(self, first: Floats, second: Floats) -> Floats:
        """Return the rotation vectors from quaternions to others.

        They have shape (..., 3), radians, about axes fixed to the first.
        """
        cosine = (first * second).sum(axis=-1, keepdims=True)
        # A quaternion and its negative are one rotation. The difference of quaternions makes the
        # result exactly zero for equal rotations.
        nearer = np.where(cosine < 0.0, -second, second)
        difference = multiply(first * _CONJUGATE, nearer - first)[..., :3]
        sine = np.linalg.norm(difference, axis=-1, keepdims=True)
        angle = 2.0 * np.arctan2(sine, np.abs(cosine))
        # The vector has the length of the angle; for tiny angles, twice the sine.
        is_turn = sine > 0.0
        scale = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=is_turn)
        return np.asarray(difference * scale)

    def _rotate(self, rotation: Floats, by: Floats) -> Floats:
        """Rotate quaternions, shape (..., 4), by rotation vectors, shape (..., 3)."""
        half_angle = np.linalg.norm(by, axis=-1, keepdims=True) / 2.0
        # The axis times the sine of half the angle; numpy's sinc(x) is sin(pi x) / (pi x).
        imaginary = by * np.sinc(half_angle / np.pi) / 2.0
        turn = np.concatenate([imaginary, np.cos(half_angle)], axis=-1)
        rotated = multiply(rotation, turn)
        return np.asarray(rotated / np.linalg.norm(rotated, axis=-1, keepdims=True))

    def make_matrices(self, rotation: Floats, dim: int) -> Floats:
        """Convert quaternions to matrices, shape (..., 3, 3)."""
        from scipy.spatial.transform import Rotation

        self._check_dimension(dim)
        matrices = Rotation.from_quat(rotation.reshape(-1, 4)).as_matrix()
        return np.asarray(matrices.reshape(*rotation.shape[:-1], 3, 3))

    def __len__(self) -> int:
        """Return the number of cells."""
        return 4 * self.n**3

    @property
    def borders(self) -> Floats:
        """Boundaries of the quotients, from -1 to 1.

        Their shape is (n + 1,).
        """
        return _compute_cells(self.n).borders

    def cell_of(self, rotation: ArrayLike) -> Ints:
        """Return the cells that contain quaternions.

        Quaternions are (x, y, z, w), shape (..., 4). Their norm is 1; a quaternion and its negative
        lie in one cell.
        """
        q = check_points(rotation, "rotation", self.names)
        self._canonical_rotation(q, "rotation")
        largest = np.abs(q).argmax(axis=-1)  # the first of equals
        # A cell is given by its largest component, and the parts of the quotients of the others.
        others = np.take_along_axis(q, np.asarray(OTHER_COMPONENTS)[largest], axis=-1)
        quotients = others / np.take_along_axis(q, largest[..., None], axis=-1)
        parts = np.searchsorted(self.borders, quotients, side="right") - 1
        parts = np.clip(parts, 0, self.n - 1)
        cells_in_chart = parts @ np.array([self.n**2, self.n, 1])
        return np.asarray(largest * self.n**3 + cells_in_chart, dtype=np.int64)

    def _find_cells(self, q: Floats) -> Ints:
        """Return the cells of configurations."""
        return self.cell_of(q[..., -4:])

    def _check_dimension(self, dim: int) -> None:
        """Raise InputError for maps of the plane."""
        if dim == 2:
            rule = "a robot in the plane turns by its yaw"
            raise InputError("rotations", f"are {self}", rule)

    def _preserves(self, shape: HasSymmetries) -> bool:
        """Return True if a shape is a ball about its reference point."""
        return shape.is_round

    def _assign_slices(self, shape: HasSymmetries) -> Ints:
        """Return the slice of each cell.

        Cells related by a half turn of the robot share a slice. In quaternions, half turns about
        the robot's axes permute and negate components, and so map cells to cells; quarter turns do
        not.
        """
        if shape.is_round:
            return np.zeros(len(self), dtype=np.int64)
        smallest = np.arange(len(self))
        for matrix, change in self._list_image_matrices(shape):
            # Positions stay, so the change is a symmetry of the robot.
            if (matrix == np.eye(3)).all():
                images = self.cell_of(self.centers @ change)
                smallest = np.minimum(smallest, smallest[images])
        return np.unique(smallest, return_inverse=True)[1].astype(np.int64)

    def _find_images(self, shape: HasSymmetries) -> list[tuple[Floats, Ints]]:
        """List the rotations and mirrors that permute the cells.

        They permute and negate quaternion components, and so map cells to cells. For each, the list
        has its matrix and the image of each cell.
        """
        changes = self._list_image_matrices(shape)
        return [(matrix, self.cell_of(self.centers @ change)) for matrix, change in changes]

    def _list_image_matrices(self, shape: HasSymmetries) -> Iterable[tuple[Floats, Floats]]:
        """List the matrices by which each image transforms positions and quaternions.

        The matrices have shapes (3, 3) and (4, 4).
        """
        from scipy.spatial.transform import Rotation

        symmetries = np.array(shape.symmetries)  # shape (n, 3, 3)
        signs = np.linalg.det(symmetries)
        # Rotations come first.
        order = np.argsort(-signs, kind="stable")
        symmetries = symmetries[order]
        # A mirror is a rotation times the point reflection.
        turns = Rotation.from_matrix(symmetries * signs[order, None, None])
        rotations = turns.as_quat()[:, None, None]
        # Let r be a rotation, r* its inverse, and h a half turn. They map a quaternion u to h r* u
        # r, a linear map, whose matrix has the images of the unit quaternions as rows.
        units = np.eye(4)
        half_turns = multiply(units, rotations * _CONJUGATE).swapaxes(1, 2)
        changes = np.round(multiply(multiply(half_turns, units), rotations))
        matrices = _HALF_TURNS @ symmetries[:, None].swapaxes(-1, -2)
        pairs = zip(matrices.reshape(-1, 3, 3), changes.reshape(-1, 4, 4), strict=True)
        # Of equal changes, keep the first, which is a rotation if one of them is.
        distinct: dict[bytes, tuple[Floats, Floats]] = {}
        for matrix, change in pairs:
            distinct.setdefault(change.tobytes(), (matrix, change))
        return distinct.values()

    @property
    def centers(self) -> Floats:
        """Centers of the cells, shape (count, 4).

        The center of a cell is the quaternion with the smallest covering angle.
        """
        return _compute_cells(self.n).centers

    @property
    def covering_angles(self) -> Floats:
        """Angle from each center to its farthest corner.

        It is in radians, shape (count,).
        """
        return _compute_cells(self.n).covering_angles

    @property
    def _stored_arrays(self) -> dict[str, Floats]:
        """Centers and covering angles of the cells.

        They have shapes (count, 4) and (count,), in radians.
        """
        return dict(zip(self._COORDINATES, (self.centers, self.covering_angles), strict=True))

    @property
    def _volumes(self) -> Floats:
        """Haar measure of each cell.

        The measures sum to 1.
        """
        return _compute_cells(self.n).volumes

    def _sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """Draw a quaternion from each cell, by Haar measure.

        ``margin`` is the fraction of a cell's width that is left out at each boundary.
        """
        n = self.n
        borders = self.borders
        charts, *parts_by_axis = np.unravel_index(cells, (4, n, n, n))
        parts = np.stack(parts_by_axis, axis=-1)
        low = borders[parts]
        widths = np.diff(borders)[parts]
        # Quotients u have the density (1 + |u|^2)^-2, which is largest at the point of a cell
        # nearest to zero. Draw by rejection.
        nearest = np.maximum(np.maximum(low, -low - widths), 0.0)
        max_density = (1.0 + (nearest**2).sum(axis=1)) ** -2.0
        quotients = np.empty((len(cells), 3))
        pending = np.arange(len(cells))
        while len(pending):
            fractions = rng.uniform(margin, 1.0 - margin, (len(pending), 3))
            drawn = low[pending] + widths[pending] * fractions
            density = (1.0 + (drawn**2).sum(axis=1)) ** -2.0
            accepted = rng.random(len(pending)) * max_density[pending] <= density
            quotients[pending[accepted]] = drawn[accepted]
            pending = pending[~accepted]
        return _make_quaternions(charts, quotients)

    def _angles_to_centers(self, q: Floats) -> Floats:
        """Return the angles to all centers.

        They are in radians, shape (..., count).
        """
        cosines = np.abs(q[..., -4:] @ self.centers.T)
        return np.asarray(2.0 * np.arccos(np.minimum(cosines, 1.0)))

    @property
    def neighbors(self) -> Ints:
        """Neighbors of each cell along its chart's axes.

        Their shape is (count, 6). They may lie in another chart, in which another component is
        largest.
        """
        # A cell has a chart, which is its largest component, and a part along three axes.
        charts, *parts_by_axis = np.indices((4, self.n, self.n, self.n)).reshape(4, -1)
        parts = np.stack(parts_by_axis, axis=1)
        middles = (self.borders[:-1] + self.borders[1:]) / 2.0
        neighbors = []
        # Distance from a face of a cell to a point of its neighbor, in quotients of components.
        face_step = 1e-6
        for axis in range(3):
            low = self.borders[parts[:, axis]]
            high = self.borders[parts[:, axis] + 1]
            # A point just beyond the middle of the face lies in the neighbor.
            for quotient in (low - face_step, high + face_step):
                beyond = middles[parts]
                beyond[:, axis] = quotient
                neighbors.append(self.cell_of(_make_quaternions(charts, beyond)))
        return np.stack(neighbors, axis=1)

    def _make_lookups(self, slice_of: Ints) -> RotationTable:
        """Return rotation cells in the form of kernels."""
        return RotationTable(self.borders[None].copy(), np.ascontiguousarray(slice_of))

    def __str__(self) -> str:
        """Return the number of rotations in words."""
        return f"{len(self)} rotations in space"


class _CellArrays(NamedTuple):
    """Arrays of the quaternion cells for one n.

    Attributes
    ----------
    borders : ndarray of float64, shape (n + 1,)
        Boundaries of the parts of an axis.
    centers : ndarray of float64, shape (4 n^3, 4)
        Representative quaternions.
    covering_angles : ndarray of float64, shape (4 n^3,)
        Radians.
    volumes : ndarray of float64, shape (4 n^3,)
        Haar measures, whose sum is 1.
    """

    borders: Floats
    centers: Floats
    covering_angles: Floats
    volumes: Floats


@lru_cache(maxsize=4)
def _compute_cells(n: int) -> _CellArrays:
    """Compute the quaternion cells for n parts an axis.

    One chart is computed first, because all charts have the same cells.
    """
    angles = np.pi / 4.0 * np.linspace(-1.0, 1.0, n + 1)
    # The C library's tangent, as in C++; numpy's differs from it in the last bit on some machines.
    borders = np.array([math.tan(angle) for angle in angles.tolist()])
    borders = (borders - borders[::-1]) / 2.0  # symmetric to the last bit
    borders[[0, -1]] = -1.0, 1.0
    parts = np.indices((n, n, n)).reshape(3, -1).T  # of each cell along the axes, shape (n^3, 3)
    # Cells that differ by mirrors and permutations of the axes have centers that differ likewise.
    mirrored = np.minimum(parts, n - 1 - parts)
    order = np.argsort(mirrored, axis=1, kind="stable")
    ascending = np.take_along_axis(mirrored, order, axis=1)
    classes, class_of = np.unique(ascending, axis=0, return_inverse=True)
    class_of = class_of.ravel()
    class_centers, class_angles = _find_smallest_caps(borders[classes[:, None] + _CORNERS])
    # Undo the permutations and the mirrors of the class for each cell.
    quotients = np.empty((n**3, 3))
    np.put_along_axis(quotients, order, class_centers[class_of], axis=1)
    quotients *= np.where(mirrored == parts, 1.0, -1.0)
    charts = np.repeat(np.arange(4), n**3)
    centers = _make_quaternions(charts, np.tile(quotients, (4, 1)))
    covering_angles = np.tile(class_angles[class_of], 4)
    measures = _integrate_measure(classes, n)[class_of]
    volumes = np.tile(measures / (4.0 * measures.sum()), 4)
    arrays = borders, centers, covering_angles, volumes
    return _CellArrays(*map(frozen, arrays))


def _integrate_measure(parts: Ints, n: int) -> Floats:
    """Return the Haar measures of cells, in one unit.

    The cells are given by their parts, shape (m, 3). Gauss-Legendre quadrature over the arc
    tangents of the quotients.
    """
    # Large cells need more nodes along an axis; with these, the error is near rounding.
    nodes, weights = np.polynomial.legendre.leggauss(max(4, 4 + 24 // n))
    angles = np.pi / (2.0 * n) * (parts[..., None] + (nodes + 1.0) / 2.0) - np.pi / 4.0
    squares = np.tan(angles) ** 2
    x, y, z = np.moveaxis(squares, 1, 0)
    density = (1.0 + x[:, :, None, None] + y[:, None, :, None] + z[:, None, None, :]) ** -2.0
    # The quotient tan(a) has the derivative 1 + tan(a)^2.
    by_axis = np.moveaxis(weights * (1.0 + squares), 1, 0)
    return np.asarray(np.einsum("mi,mj,mk,mijk->m", *by_axis, density))


_CORNERS: Final = np.indices((2, 2, 2)).reshape(3, -1).T
"""Corners of the unit cube, shape (8, 3)."""


def _find_smallest_caps(boxes: Floats) -> tuple[Floats, Floats]:
    """Find boxes' smallest spherical caps: center, covering angle.

    The boxes of quotients are given by their corners, shape (m, 8, 3). The center is the rotation
    nearest to all corners. It has the direction of the point nearest to zero in the convex hull of
    the corners on the sphere: of all ``X w`` with ``w >= 0``, those with the least
    ``|X w|^2 + (sum w - 1)^2`` have that direction.
    """
    from scipy.optimize import lsq_linear

    # Corners as unit quaternions whose last component is the largest, shape (m, 8, 4).
    ones = np.ones((*boxes.shape[:2], 1))
    corners = np.concatenate([boxes, ones], axis=2)
    corners /= np.linalg.norm(corners, axis=2, keepdims=True)
    # Least squares: X w is as near to zero as possible, and the sum of w to 1.
    equations = np.concatenate([corners, ones], axis=2)
    target = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    # scipy's nnls misses the least sum on some machines if corners lie symmetrically.
    solutions = [
        lsq_linear(rows.T, target, (0.0, np.inf), method="bvls", tol=1e-15) for rows in equations
    ]
    weights = np.array([solution.x for solution in solutions])
    center = np.einsum("mk,mki->mi", weights, corners)
    center /= np.linalg.norm(center, axis=1, keepdims=True)
    cosines = np.einsum("mki,mi->mk", corners, center).min(axis=1)
    # The angle of a rotation is twice that of its quaternion, which is at most the distance of the
    # quotients.
    angles = 2.0 * np.arccos(cosines) + 4.0 * QUOTIENT_SLACK
    return center[:, :3] / center[:, 3:], angles


def _make_quaternions(charts: Ints, quotients: Floats) -> Floats:
    """Return the unit quaternions that have the given quotients.

    The result has shape (n, 4), and ``quotients`` shape (n, 3). ``charts``, shape (n,), are the
    indices of their largest components.
    """
    quaternions = np.ones((len(charts), 4))
    np.put_along_axis(quaternions, np.asarray(OTHER_COMPONENTS)[charts], quotients, axis=1)
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))


def multiply(first: Floats, second: Floats) -> Floats:
    """Multiply quaternions, shape (..., 4).

    The second rotation is about axes rotated by the first.
    """
    x, y, z, w = np.moveaxis(first, -1, 0)
    a, b, c, d = np.moveaxis(second, -1, 0)
    return np.stack(
        [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ],
        axis=-1,
    )
