"""Contents of a picture: a map, a path, start and goal, and robots along the path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cspace import BLOCKED, FREE, CSpace, Robot, Rotations
from cspace.errors import InputError
from cspace.inside import (
    ANGLE_SLACK,
    Balls,
    Contents,
    Floats,
    Surface,
    cells_of,
    check_finite,
    measure_steps,
)

if TYPE_CHECKING:
    from cspace import Space, Workspace


class HasPath(Protocol):
    """A plan, or another object with a path."""

    @property
    def path(self) -> Floats:
        """Configurations, shape (n, size)."""


class WorkspaceView(CSpace):
    """A workspace as the map of a point: BLOCKED in obstacles, FREE elsewhere."""

    def __init__(self, workspace: Workspace) -> None:
        """Make the map; its robot is not drawn, but the title has its name."""
        point = Balls(np.zeros((1, workspace.grid.dim)), np.ones(1))
        robot = Robot(Path(workspace.source).name, point)
        states = np.where(workspace.outer, np.uint8(BLOCKED), np.uint8(FREE))
        slice_of = np.zeros(1, dtype=np.int64)
        super().__init__(
            Contents(workspace, robot, Rotations.of(None), slice_of, states[np.newaxis])
        )


class DrawnRobot:
    """A robot to draw: outlines in the plane, a surface in space.

    Attributes
    ----------
    points : ndarray of float64, shape (n, d)
        Corners and the reference point, in the robot's frame.
    rings : list of ndarray of float64, shape (n, 2)
        Closed outlines of a robot in the plane.
    surface : Surface or None
        Simplified surface of a robot in space.
    reach : float
        Largest distance of a corner from the reference point, metres.
    size : float
        Diagonal of the box around the robot and its reference point, metres.
    """

    def __init__(self, robot: Robot, rotations: Rotations) -> None:
        """Extract the outlines or the surface of a robot, and measure them."""
        self.dim = robot.dim
        self.rotations = rotations
        self.rings: list[Floats] = []
        self.surface: Surface | None = None
        if robot.dim == 2:
            self.rings = extract_rings(robot.shape.outer.outline)
            corners = np.concatenate(self.rings)
        else:
            self.surface = simplify_surface(robot.shape.outer.surface)
            corners, _ = self.surface
        self.points = np.vstack([corners, np.zeros(self.dim)])
        self.reach = float(np.linalg.norm(self.points, axis=1).max())
        self.size = float(np.linalg.norm(np.ptp(self.points, axis=0)))

    def transform(self, points: Floats, q: Floats) -> Floats:
        """Transform points, shape (n, d), from the robot's frame to the map's.

        For configurations of shape (..., size), the result has shape (..., n, d).
        """
        matrices = self.rotations.make_matrices(q[..., self.dim :], self.dim)
        turned = points @ np.swapaxes(matrices, -1, -2)
        return np.asarray(turned + q[..., np.newaxis, : self.dim])

    def extents(self, q: Floats) -> Floats:
        """Return the box around the robot at configurations, shape (..., 2, d).

        Boxes are lower and upper corners, and contain the reference point.
        """
        points = self.transform(self.points, q)
        return np.stack([points.min(axis=-2), points.max(axis=-2)], axis=-2)

    def outlines(self, q: Floats, pair: Sequence[int] = (0, 1)) -> list[Floats]:
        """Return closed outlines, projected on two axes."""
        if self.surface is None:
            return [self.transform(ring, q) for ring in self.rings]
        vertices, faces = self.surface
        corners = self.transform(vertices, q)[:, list(pair)]
        # Triangles with a common edge are grown until they overlap, so that rounding leaves no gap.
        triangles = shapely.buffer(shapely.polygons(corners[faces]), 1e-6 * self.size, quad_segs=1)
        return extract_rings(shapely.union_all(triangles))


def describe_rotation(rotations: Rotations, rotation: Floats | None) -> str:
    """Describe the rotation cell that contains a rotation, or else all cells.

    The text is empty if the robot does not turn.
    """
    if not rotations.names:
        return ""
    angles = np.degrees(2.0 * rotations.covering_angles)
    if rotation is not None:
        width = angles[rotations.cell_of(rotation)].item()
        return f"{_format_rotation(rotation)}, in a rotation cell of {width:.3g}°"
    widths = f"{angles.min():.3g}°"
    if np.ptp(angles) >= 1e-6:
        widths = f"{widths} to {angles.max():.3g}°"
    return f"over all rotations, {len(rotations)} rotation cells of {widths}"


def _format_rotation(rotation: Floats) -> str:
    """Format a yaw in degrees, or a quaternion as an angle and an axis."""
    if len(rotation) == 1:
        degrees = round(math.degrees(rotation[0]), 1)
        wrapped_degrees = round((degrees + 180.0) % 360.0 - 180.0, 1)
        return f"yaw {wrapped_degrees + 0.0:g}°"  # adding zero drops the sign of -0
    vector = Rotation.from_quat(rotation).as_rotvec()
    angle = float(np.linalg.norm(vector))
    if angle <= ANGLE_SLACK:
        return "not turned"
    axis = np.round(vector / angle, 2) + 0.0
    axis_text = ", ".join(f"{x:.2g}" for x in axis.tolist())
    return f"turned {round(math.degrees(angle), 1):g}° about ({axis_text})"


def path_lengths(space: Space, points: Floats, reach: float) -> Floats:
    """Return the length of a path up to each configuration, shape (n,).

    A rotation counts as the distance that a point ``reach`` metres from the reference point moves.
    """
    steps = space.steps_between(points[:-1], points[1:])
    lengths, angles = measure_steps(steps, space.dim)
    return np.concatenate([[0.0], np.cumsum(lengths + reach * angles)])


def interpolate_path(space: Space, points: Floats, shares: Floats, reach: float = 0.0) -> Floats:
    """Interpolate a path at shares, 0 to 1, of its length.

    ``reach`` is as for :func:`path_lengths`. The result has shape (n, size).
    """
    lengths = path_lengths(space, points, reach)
    places = np.interp(shares * lengths[-1], lengths, np.arange(len(points)))
    return interpolate_rows(space, points, places)


def interpolate_rows(space: Space, points: Floats, places: Floats) -> Floats:
    """Interpolate a path at fractional indices of its rows.

    Index 1.5 is halfway from row 1 to row 2. The result has shape (n, size).
    """
    before = places.astype(np.int64)
    after = np.minimum(before + 1, len(points) - 1)
    shares = (places - before)[:, np.newaxis]
    return space.interpolate(points[before], points[after], shares)


def split_steps(space: Space, points: Floats) -> Floats:
    """Split each edge of a path into 64 pieces; return their ends."""
    if len(points) < 2:
        return points
    # The stop lies one piece beyond the last row, because arange omits it.
    places = np.arange(0.0, len(points) - 1 + 1 / 64, 1 / 64)
    return interpolate_rows(space, points, places)


@dataclass(frozen=True)
class PictureContent:
    """A map, a path and robots to draw.

    Attributes
    ----------
    space : CSpace
    rotation : ndarray of float64, shape (k,), or None
        Rotation of the slice; None shows all rotations at once.
    box : ndarray of float64, shape (2, d)
        Corners of the picture, metres.
    center : ndarray of float64, shape (d,)
        Point through which sections are cut.
    body : Body
    points : ndarray of float64, shape (n, size)
        The path; n is 0 without a path.
    is_lost : bool
        True if the path is no longer proven free.
    endpoints : dict of str to ndarray of float64, shape (size,)
        Start and goal, if given.
    robots : ndarray of float64, shape (m, size)
        Configurations at which the robot is drawn.
    """

    space: CSpace
    rotation: Floats | None
    box: Floats
    center: Floats
    body: DrawnRobot
    points: Floats
    is_lost: bool
    endpoints: dict[str, Floats]
    robots: Floats


def make_scene(
    space: CSpace,
    *,
    rotation: ArrayLike | None = None,
    path: ArrayLike | HasPath | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    center: ArrayLike | None = None,
) -> PictureContent:
    """Check the arguments of :func:`cspace.plot.plot` and return what to draw.

    Raises InputError if an argument has the wrong shape or value.
    """
    grid = space.grid
    dim = grid.dim
    drawn_rotation = None if space.rotations.names else np.empty(0)
    if rotation is not None:
        drawn_rotation = space.rotations.check_rotation(rotation)
    points, plan = check_path(space, path)
    endpoints = collect_endpoints(space, plan, points, start, goal)
    body = DrawnRobot(space.robot, space.rotations)
    point = _choose_center(space, center, body, points, endpoints)
    # Robots stand along the path, at the start and at the goal.
    between = _choose_robots(space, body, points)
    robots = np.vstack([between, *endpoints.values()])
    if not space.robot.shape.shown:
        robots = robots[:0]
    # The whole grid, the path and the robots are in view.
    corners = np.concatenate([[grid.lower, grid.upper], points[:, :dim], *body.extents(robots)])
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    is_lost = is_path_lost(space, plan)
    return PictureContent(
        space, drawn_rotation, box, point, body, points, is_lost, endpoints, robots
    )


def extract_rings(geometry: Any) -> list[Floats]:
    """Return a geometry's rings (n, 2), holes clockwise."""
    polygons = shapely.get_parts(shapely.orient_polygons(geometry))
    rings = [ring for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]
    return [shapely.get_coordinates(ring) for ring in rings]


def check_path(space: Space, path: Any) -> tuple[Floats, Any]:
    """Return a path as an array, shape (n, size), and the plan that it is of, or None.

    Raises InputError if it is no path in the space.
    """
    plan = path if hasattr(path, "path") else None
    values = path if plan is None else plan.path
    points = np.empty(0) if values is None else check_finite(values, "path", space.axes)
    if points.shape == (0,):  # no path, or an empty list
        return np.empty((0, len(space.axes))), plan
    return _check_coordinates(points, "path", space.axes, ndim=2), plan


def _check_coordinates(values: Any, name: str, axes: Sequence[str], ndim: int = 1) -> Floats:
    """Return configurations as an array; raise InputError for a wrong shape.

    ``ndim`` is 1 for one configuration, 2 for rows.
    """
    points = check_finite(values, name, axes)
    if points.ndim != ndim or points.shape[-1] != len(axes):
        shape = f"(n, {len(axes)})" if ndim == 2 else f"({len(axes)},)"
        raise InputError(
            name,
            f"has shape {points.shape}",
            f"it must be {shape}: {', '.join(axes)}",
        )
    return points


def is_path_lost(space: Space, plan: Any) -> bool:
    """Return True if a certified plan is no longer proven free.

    Its edges are checked on the drawn map, or on the plan's own map if their grids differ, as for
    an overview.
    """
    planned = getattr(plan, "space", None)
    if planned is None or not getattr(plan, "certified", False):
        return False
    same_kind = type(cells_of(space)) is type(cells_of(planned))
    is_same = same_kind and getattr(space, "grid", None) == getattr(planned, "grid", None)
    return not plan.recheck(space if is_same else planned).all()


def collect_endpoints(
    space: Space, plan: Any, points: Floats, start: Any, goal: Any
) -> dict[str, Floats]:
    """Return start and goal, by default the path's, by name."""
    endpoints = {}
    for name, q, row in (("start", start, 0), ("goal", goal, -1)):
        if q is None:
            q = points[row] if len(points) else getattr(plan, name, None)
        if q is not None:
            endpoints[name] = _check_coordinates(q, name, space.axes)
    return endpoints


def _choose_robots(space: Space, body: DrawnRobot, points: Floats) -> Floats:
    """Choose configurations along a path to draw robots at.

    A picture shows about twelve, or fewer if robots would overlap. The endpoints are omitted, but a
    path of one configuration is returned unchanged.
    """
    if len(points) < 2:
        return points
    *_, length = path_lengths(space, points, body.reach)
    spacing = max(length / 12.0, body.size)
    count = math.ceil(length / spacing) if spacing else 0  # 0 for a point that does not move
    shares = np.arange(1, count) / max(count, 1)
    return interpolate_path(space, points, shares, body.reach)


def _choose_center(
    space: CSpace, center: Any, body: DrawnRobot, points: Floats, endpoints: dict[str, Floats]
) -> Floats:
    """Choose the point (d,) through which sections are cut.

    Default: half the way along the path; without a path the start, the goal, or the center of the
    grid. Raises InputError if ``center`` is not a point of the grid.
    """
    grid = space.grid
    if center is None:
        position = np.add(grid.lower, grid.upper) / 2
        if len(points):
            (position,) = interpolate_path(space, points, np.array([0.5]), body.reach)
        elif endpoints:
            position, *_ = endpoints.values()
        return np.clip(position[: grid.dim], grid.lower, grid.upper)
    point = _check_coordinates(center, "center", space.axes[: grid.dim])
    if not grid.contains(point):
        rule = f"the grid is from {grid.lower} to {grid.upper}"
        raise InputError("center", f"is {point.tolist()}", rule)
    return point


def simplify_surface(surface: Surface) -> Surface:
    """Merge close vertices of a surface with many triangles.

    Source: Rossignac and Borrel (1993).
    """
    vertices, faces = surface
    # Surfaces with more triangles are simplified before they are drawn.
    if len(faces) <= 2000:
        return vertices, faces
    # Vertices nearest to the same node of a lattice, with 20 cells along the longest side, become
    # one vertex. Faces whose corners coincide are removed.
    nodes = np.rint(20.0 * vertices / np.ptp(vertices, axis=0).max())
    _, first, clusters = np.unique(nodes, axis=0, return_index=True, return_inverse=True)
    merged = np.unique(clusters.reshape(-1)[faces], axis=0)
    is_triangle = (merged != np.roll(merged, 1, axis=1)).all(axis=1)
    return vertices[first], merged[is_triangle]
