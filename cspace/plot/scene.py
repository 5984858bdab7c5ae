"""What pictures on paper and on a page show: cells, robots, arms and paths, in their colours.

Each colour has one meaning everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cspace import BLOCKED, FREE, CSpace, Robot, Rotations
from cspace.errors import InputError
from cspace.inside import (
    ANGLE_SLACK,
    Balls,
    Bools,
    Bytes,
    Contents,
    Floats,
    Ints,
    Surface,
    Voxels,
    cells_of,
    check_finite,
    join_surfaces,
    measure_steps,
    transform_surface,
    warn_of_large,
)

if TYPE_CHECKING:
    from cspace import Space, Workspace


PATH_COLOR: Final = "#6a1b9a"
"""Colour of a path. Purple, even when drawn faint, is not a colour of a map."""
ROBOT_FILL_COLOR: Final = "#3fb795"
"""Fill colour of a robot."""
GHOST_COLOR: Final = "#c3e6da"
"""Colour of the arms along a path."""
LEVELS: Final = 8
"""Number of parts, equally high, of a robot on a floor that have outlines of their own."""
ENDPOINT_COLORS: Final = {"start": "#ffffff", "goal": "#cc79a7"}
"""Colours of start and goal, on paper."""
SOLID_ENDPOINT_COLORS: Final = ENDPOINT_COLORS | {"start": "#b5b5b5"}
"""Colours of start and goal as solids, which white ones on a white floor would hide."""


class HasPath(Protocol):
    """A plan, or another object with a path."""

    @property
    def path(self) -> Floats:
        """Configurations, shape (n, size)."""


class CellClass(IntEnum):
    """Class of a cell, with its label, and its colour on paper and as a solid in the light.

    The most important is last: a pixel that covers many cells shows the largest class. Most hues
    are from Okabe and Ito (2008), safe for the colour-blind; their lightness differs, so that they
    are distinct in grey print. Only unknown cells are brown.
    """

    label: str
    color: str
    solid_color: str

    OPEN = 0, "free", "#ffffff"
    PARTLY = 1, "free at some rotations", "#f3e79b"
    ASSUMED = 2, "unknown, taken as free", "#c8ab78"
    HOLLOW = 3, "obstacle, free for the reference point", "#999999"
    UNDECIDED = 4, "undecided (MIXED)", "#d55e00"
    COLLIDES = 5, "C-obstacle (BLOCKED)", "#a6d3ee"
    UNSEEN = 6, "unknown, taken as obstacle", "#6f5320", "#c9a468"
    OBSTACLE = 7, "obstacle", "#262626", "#7a7a7a"

    def __new__(cls, number: int, label: str, color: str, solid_color: str = "") -> CellClass:
        """Make a class that is a number, too."""
        made = int.__new__(cls, number)
        made._value_ = number
        made.label = label
        made.color = color
        made.solid_color = solid_color or color
        return made


def classify_cells(space: CSpace, rotation: Floats | None, layer: tuple[Any, ...] = ()) -> Bytes:
    """Return each cell's class, by obstacles and states.

    ``rotation`` has shape (k,), or is None for all rotations; ``layer`` is an index into the
    arrays of the grid.
    """
    ground = classify_ground(space.drawn_workspace, layer)
    if not space.robot.shape.shown:
        ground = np.zeros_like(ground)  # a map of joints has no obstacles of its own
    # The lowest and the highest state of each cell over the rotations.
    rotations = space.slice_rotations if rotation is None else [rotation]
    slices = (space.states_at(center)[layer] for center in rotations)
    lowest = highest = next(slices)
    for states in slices:
        lowest = np.minimum(lowest, states)
        highest = np.maximum(highest, states)
    # Obstacles show through, unless the robot is free there.
    # In the order of the states FREE, MIXED and BLOCKED.
    of_states = [CellClass.OPEN, CellClass.UNDECIDED, CellClass.COLLIDES]
    class_of_state = np.array(of_states, dtype=np.uint8)
    classes: Bytes = np.maximum(ground, class_of_state[lowest])
    classes[(ground >= CellClass.UNSEEN) & (lowest == FREE)] = CellClass.HOLLOW
    classes[(classes <= CellClass.ASSUMED) & (highest != FREE)] = CellClass.PARTLY
    return classes


def classify_ground(workspace: Workspace, layer: tuple[Any, ...] = ()) -> Bytes:
    """Return the class of each workspace cell: obstacle, unknown or open."""
    occupied = workspace.outer[layer]
    classes = np.where(occupied, np.uint8(CellClass.OBSTACLE), np.uint8(CellClass.OPEN))
    if workspace.unknown is not None:
        unknown = np.where(occupied, np.uint8(CellClass.UNSEEN), np.uint8(CellClass.ASSUMED))
        classes = np.where(workspace.unknown[layer], unknown, classes)
    return classes


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
        Closed outlines of a robot in the plane, or of the footprint of a robot on a floor.
    levels : list of ndarray of float64, shape (n, 2)
        Closed outlines of the parts of a robot on a floor at its heights.
    surface : Surface or None
        Simplified surface of a robot in space.
    reach : float
        Largest distance of a corner from the reference point, metres.
    size : float
        Diagonal of the box around the robot and its reference point, metres.
    """

    def __init__(self, robot: Robot, rotations: Rotations, solid: Robot | None = None) -> None:
        """Extract the outlines or the surface of a robot, and measure them.

        ``solid`` is the robot in space of a footprint.
        """
        self.dim = robot.dim
        self.rotations = rotations
        self.rings: list[Floats] = []
        self.levels = [] if solid is None else _cut_levels(solid)
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

    def describe_rotation(self, rotation: Floats | None) -> str:
        """Describe the rotation cell that contains a rotation, or else all cells.

        The text is empty if the robot does not turn.
        """
        rotations = self.rotations
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


def _cut_levels(robot: Robot) -> list[Floats]:
    """Return the outlines of a robot in space at some heights, seen from above."""
    bottom, top = (float(corner[2]) for corner in robot.shape.outer.bounds)
    heights = np.linspace(bottom, top, LEVELS + 1).tolist()
    outlines = {}
    for low, high in pairwise(heights):
        part, _ = robot.shape.slab(low, high, 0.01 * (high - low))
        if part is not None:
            outline = shapely.set_precision(part.outline, 1e-4 * (high - low))
            outlines[shapely.normalize(outline).wkb] = part.outline
    return [ring for outline in outlines.values() for ring in extract_rings(outline)]


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


class Route:
    """A path in a space, with its start and goal.

    Parameters
    ----------
    space : ConfigurationSpace
    path : array-like, shape (n, size), or Plan, optional
        Or another object with a ``path`` attribute.
    start, goal : array-like, shape (size,), optional
        By default those of the path.

    Attributes
    ----------
    points : ndarray of float64, shape (n, size)
        The path; n is 0 without a path.
    plan : object or None
        The plan that the path is of.
    endpoints : dict of str to ndarray of float64, shape (size,)
        Start and goal, if given.

    Raises
    ------
    InputError
        If the path, the start or the goal has the wrong shape, or is not finite.
    """

    def __init__(self, space: Space, path: Any = None, start: Any = None, goal: Any = None) -> None:
        """Check the path and both ends."""
        self.space = space
        self.plan: Any = path if hasattr(path, "path") else None
        values = path if self.plan is None else self.plan.path
        points = np.empty(0) if values is None else check_finite(values, "path", space.axes)
        if points.shape == (0,):  # no path, or an empty list
            points = np.empty((0, len(space.axes)))
        self.points = _check_coordinates(points, "path", space.axes, ndim=2)
        self.endpoints: dict[str, Floats] = {}
        for name, q, row in (("start", start, 0), ("goal", goal, -1)):
            if q is None and len(self.points):
                self.endpoints[name] = self.points[row]
                continue
            q = getattr(self.plan, name, None) if q is None else q
            if q is not None:
                self.endpoints[name] = _check_coordinates(q, name, space.axes)

    @cached_property
    def is_lost(self) -> bool:
        """Return True if the path is a certified plan's, but no longer proven free.

        Its edges are checked on the drawn map, or on the plan's own map if their grids differ, as
        for an overview.
        """
        plan = self.plan
        space = self.space
        planned = getattr(plan, "space", None)
        if planned is None or not getattr(plan, "certified", False):
            return False
        same_kind = type(cells_of(space)) is type(cells_of(planned))
        is_same = same_kind and getattr(space, "grid", None) == getattr(planned, "grid", None)
        return not plan.recheck(space if is_same else planned).all()

    def measure_lengths(self, reach: float) -> Floats:
        """Return the length of the path up to each configuration, shape (n,).

        A rotation counts as the distance that a point ``reach`` metres from the reference point
        moves.
        """
        steps = self.space.steps_between(self.points[:-1], self.points[1:])
        lengths, angles = measure_steps(steps, self.space.dim)
        return np.concatenate([[0.0], np.cumsum(lengths + reach * angles)])

    def interpolate(self, shares: Floats, reach: float = 0.0) -> Floats:
        """Return configurations, shape (n, size), at shares, 0 to 1, of the path's length.

        ``reach`` is as for :meth:`measure_lengths`.
        """
        lengths = self.measure_lengths(reach)
        rows = np.arange(len(self.points))
        return self._interpolate_rows(np.interp(shares * lengths[-1], lengths, rows))

    def split(self) -> Floats:
        """Split each edge of the path into 64 pieces; return their ends."""
        if len(self.points) < 2:
            return self.points
        # The stop lies one piece beyond the last row, because arange omits it.
        return self._interpolate_rows(np.arange(0.0, len(self.points) - 1 + 1 / 64, 1 / 64))

    def _interpolate_rows(self, places: Floats) -> Floats:
        """Interpolate the path at fractional indices of its rows.

        Index 1.5 is halfway from row 1 to row 2. The result has shape (n, size).
        """
        before = places.astype(np.int64)
        after = np.minimum(before + 1, len(self.points) - 1)
        shares = (places - before)[:, np.newaxis]
        return self.space.interpolate(self.points[before], self.points[after], shares)


class ArmFigure:
    """The surfaces of an arm's links, and the position of its tip.

    Attributes
    ----------
    links : dict of str to Surface
        Each link in its own frame.
    joint_counts : dict of str to int
        Number of joints that move each frame.
    moving : list of str
        Links moved by a joint.
    """

    def __init__(self, arm: Any) -> None:
        """Make all links' surfaces, and find the tip."""
        self._arm = arm
        self.links = {link.name: _make_link_surface(arm, link) for link in arm.links}
        self.joint_counts = {frame: _count_joints(arm, frame) for frame in arm.frames}
        self.moving = [name for name in self.links if self.joint_counts[name]]
        # The tip is the center of the link that the most joints move, as homogeneous coordinates.
        self._tip = max(self.links, key=self.joint_counts.__getitem__)
        self._tip_center = np.append(self.links[self._tip][0].mean(axis=0), 1.0)

    def pose_links(self, q: Floats) -> dict[str, Surface]:
        """Return the surfaces of the links at a configuration, by name."""
        poses = self._arm.poses(q)
        return {name: transform_surface(link, poses[name]) for name, link in self.links.items()}

    def tip_positions(self, points: Floats) -> Floats:
        """Return the positions of the tip, shape (n, 3), at configurations."""
        return np.asarray(self._arm.pose(points, self._tip)[..., :3, :] @ self._tip_center)

    def measure(self, configurations: Iterable[Floats]) -> tuple[Floats, Floats]:
        """Return the box around an arm at configurations, and a larger box.

        Boxes are lower and upper corners, shape (2, 3). Only obstacles in the larger box are drawn,
        because distant ones would make the arm small. It is wider by 3/4 of the longest side.
        """
        surfaces = [surface for q in configurations for surface in self.pose_links(q).values()]
        corners = np.concatenate([vertices for vertices, _ in surfaces])
        box = np.stack([corners.min(axis=0), corners.max(axis=0)])
        margin = 0.75 * np.max(box[1] - box[0]) * np.array([[-1.0], [1.0]])
        return box, box + margin


def _count_joints(arm: Any, frame: str) -> int:
    """Return the number of joints that move a frame of an arm."""
    # The first body is the base.
    moving_bodies = arm.chain.between[0, arm.placements[frame].body]
    return len(np.unique(arm.chain.joint_indices[moving_bodies]))


def _make_link_surface(arm: Any, link: Any) -> Surface:
    """Make a link's surface in its own frame."""
    # Parts are posed in the frame of the link's body.
    to_link = np.linalg.inv(arm.placements[link.name].pose)
    parts = [(part.shape.outer.surface, to_link @ part.pose) for part in link.parts]
    return join_surfaces([transform_surface(surface, pose) for surface, pose in parts])


def find_faces(
    solid: Bools, axis: int, up: int, *, is_closed: bool = True, is_merged: bool = False
) -> tuple[Ints, Ints]:
    """Return solid cells' faces in one direction, and the first cell of each.

    The direction is down (``up`` 0) or up (1) an axis. Faces have shape (n, 4, 3), in cells; their
    corners are counterclockwise, seen from outside. Unless ``is_closed``, cells at the end of the
    array have no face there. With ``is_merged``, rectangles of cells have one face, and may touch
    inside an edge of others.
    """
    layers = np.moveaxis(solid, axis, 0)
    # Cells behind the end of the array are empty.
    ahead = np.full_like(layers, not is_closed)
    if up:
        ahead[:-1] = layers[1:]
    else:
        ahead[1:] = layers[:-1]
    exposed = layers & ~ahead
    # Boxes one layer thick, with the axis of the normal first.
    low = np.argwhere(exposed)
    high = low + 1
    if is_merged:
        boxes = Voxels(exposed, 1.0, np.zeros(3)).boxes
        low, high = (corners.astype(np.int64) for corners in (boxes.lows, boxes.highs))
    # The columns of x, y and z in the corners, of which the normal is column 0.
    columns = np.insert([1, 2], axis, 0)
    low = low[:, columns]
    high = high[:, columns]
    # Corners of the face of a unit box.
    face = np.insert([(0, 0), (1, 0), (1, 1), (0, 1)], axis, up, axis=1)
    # The other axes turn counterclockwise around +x and +z, but around -y.
    is_clockwise = (up == 1) == (axis == 1)
    if is_clockwise:
        face = np.flip(face, axis=0)
    return np.asarray(low[:, np.newaxis] + (high - low)[:, np.newaxis] * face), low


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
    body : DrawnRobot
    route : Route
        The path, start and goal.
    robots : ndarray of float64, shape (m, size)
        Configurations at which the robot is drawn.
    """

    space: CSpace
    rotation: Floats | None
    box: Floats
    center: Floats
    body: DrawnRobot
    route: Route
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
    """Check the arguments of :meth:`cspace.CSpace.plot` and return what to draw.

    Raises InputError if an argument has the wrong shape or value.
    """
    grid = space.grid
    dim = grid.dim
    drawn_rotation = None if space.rotations.names else np.empty(0)
    if rotation is not None:
        drawn_rotation = space.rotations.check_rotation(rotation)
    route = Route(space, path, start, goal)
    solid = None if space.floor is None else space.robot
    body = DrawnRobot(space.drawn_robot, space.rotations, solid)
    point = _choose_center(space, center, body, route)
    # Robots stand along the path, at the start and at the goal.
    robots = np.vstack([_choose_robots(body, route), *route.endpoints.values()])
    if not space.robot.shape.shown:
        robots = robots[:0]
    # The whole grid, the path and the robots are in view.
    positions = route.points[:, :dim]
    corners = np.concatenate([[grid.lower, grid.upper], positions, *body.extents(robots)])
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    return PictureContent(space, drawn_rotation, box, point, body, route, robots)


def extract_rings(geometry: Any) -> list[Floats]:
    """Return a geometry's rings (n, 2), holes clockwise."""
    polygons = shapely.get_parts(shapely.orient_polygons(geometry))
    rings = [ring for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]
    return [shapely.get_coordinates(ring) for ring in rings]


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
    if "yaw" in axes:
        warn_of_large(points[..., -1], "rad", f"{name}: yaw")
    return points


def _choose_robots(body: DrawnRobot, route: Route) -> Floats:
    """Choose configurations along a path to draw robots at.

    A picture shows about twelve, or fewer if robots would overlap. The endpoints are omitted, but a
    path of one configuration is returned unchanged.
    """
    if len(route.points) < 2:
        return route.points
    *_, length = route.measure_lengths(body.reach)
    spacing = max(length / 12.0, body.size)
    count = math.ceil(length / spacing) if spacing else 0  # 0 for a point that does not move
    shares = np.arange(1, count) / max(count, 1)
    return route.interpolate(shares, body.reach)


def _choose_center(space: CSpace, center: Any, body: DrawnRobot, route: Route) -> Floats:
    """Choose the point (d,) through which sections are cut.

    Default: half the way along the path; without a path the start, the goal, or the center of the
    grid. Raises InputError if ``center`` is not a point of the grid.
    """
    grid = space.grid
    if center is None:
        position = np.add(grid.lower, grid.upper) / 2
        if len(route.points):
            (position,) = route.interpolate(np.array([0.5]), body.reach)
        elif route.endpoints:
            position, *_ = route.endpoints.values()
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
