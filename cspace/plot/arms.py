"""Pictures of an arm: surfaces of its links and obstacles, and its path."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import Bools, Floats, Surface
from cspace.files.polygons import join_surfaces, transform_surface
from cspace.plot import artists
from cspace.plot.route import Look, check_path, collect_marks, find_lost_steps
from cspace.plot.surface import SURFACES, Painting, find_lost_stretches, split_into_polygons
from cspace.shapes.balls import Balls
from cspace.shapes.shape import ExactShape

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GHOST_COUNT: Final = 5
"""Number of arms drawn along a path, besides the one at its end."""
GHOST_COLOR: Final = "#c3e6da"
"""Colour of the arms along a path."""
VIEW_MARGIN_SHARE: Final = 0.75
"""Margin around an arm in which obstacles are drawn, as a share of the longest side of the arm's box."""
_CAMERA_OFFSET: Final = math.radians(40.0)
_CAMERA_ELEVATION: Final = 30.0
"""Elevation of the camera, degrees."""
_MAX_EDGE_SHARE: Final = 0.05
"""Longest edge of a triangle, as a share of the picture; matplotlib sorts large triangles wrongly among small ones."""
_MAX_LINK_TRIANGLES: Final = 1000
"""Maximum number of triangles of a moving link before subdivision; an animation draws it many times."""
_FRAMED_CONFIGURATIONS: Final = 24
"""Number of configurations along an animated path that must be in view."""


class ArmFigure:
    """The surfaces of an arm and of its obstacles.

    Parameters
    ----------
    space : ArmSpace
    max_balls : float
        Obstacles of more balls of one radius, such as scans, have their centers as vertices, and no triangles.

    Attributes
    ----------
    links : dict of str to Surface
        Each link in its own frame.
    obstacles : dict of str to Surface
        Obstacles in the frame of the base.
    moving : list of str
        Links moved by a joint.
    tip : str
        The link that the most joints move.
    """

    def __init__(self, space: Any, max_balls: float = math.inf) -> None:
        self._arm = arm = space.arm
        self.links = {}
        for link in arm.links:
            back = np.linalg.inv(arm._frames[link.name].pose)
            self.links[link.name] = join_surfaces(
                [transform_surface(part.shape.outer.surface, back @ part.pose) for part in link.parts]
            )
        self.obstacles = {
            name: transform_surface(_surface(each.shape.outer, max_balls), each.pose)
            for name, each in space.obstacles.items()
        }
        self.moving = [link.name for link in arm.links if link.body]
        depth = [0]
        for parent in arm.chain.parents[1:].tolist():
            depth.append(depth[parent] + 1)
        self.tip = max(arm.links, key=lambda link: depth[link.body]).name
        self._tip_center = np.append(self.links[self.tip][0].mean(axis=0), 1.0)

    def camera_azimuth(self, low: Floats, high: Floats) -> float:
        """Return the azimuth of a camera opposite the obstacles, radians."""
        margin = VIEW_MARGIN_SHARE * float(np.max(high - low))
        near = [points.clip(low - margin, high + margin).mean(axis=0) for points, _ in self.obstacles.values()]
        behind = np.mean(near, axis=0) - (low + high) / 2 if near else np.zeros(3)
        if np.hypot(*behind[:2]) < 0.2 * margin:
            return -_CAMERA_OFFSET
        return math.atan2(-behind[1], -behind[0]) + _CAMERA_OFFSET

    def pose_links(self, q: Floats) -> dict[str, Surface]:
        """Return the surfaces of the links at a configuration, by name."""
        poses = self._arm.poses(q)
        return {name: transform_surface(surface, poses[name]) for name, surface in self.links.items()}

    def tip_positions(self, points: Floats) -> Floats:
        """Return the positions of the center of the :attr:`tip`.

        The result has shape (n, 3).
        """
        return np.asarray(self._arm.pose(points, self.tip)[..., :3, :] @ self._tip_center)


def _surface(shape: ExactShape, max_balls: float) -> Surface:
    """Return the surface of an exact shape; of many balls of one radius, the centers without triangles."""
    if isinstance(shape, Balls) and len(shape.radii) > max_balls and not np.ptp(shape.radii):
        return shape.centers, np.empty((0, 3), dtype=np.int64)
    return shape.surface


def joint_lengths(points: Floats) -> Floats:
    """Return the path length up to each row.

    It is the length in joint space. The result has shape (n,).
    """
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def interpolate_joints(points: Floats, shares: Floats) -> Floats:
    """Interpolate a path at shares, 0 to 1, of its joint-space length.

    The result has shape (n, size).
    """
    lengths = joint_lengths(points)
    return np.stack([np.interp(shares * lengths[-1], lengths, column) for column in points.T], axis=-1)


def draw_arm(
    space: Any,
    q: Any = None,
    path: Any = None,
    camera: Any = None,
    ax: Any = None,
    legend: bool = True,
    title: str | None = None,
) -> Axes:
    """Draw an arm among obstacles; see :meth:`cspace.ArmSpace.plot`."""
    points = check_path(space, path)
    marks = collect_marks(space, path, points, None, None)
    stand = marks.get("goal", np.zeros(space.size).clip(space.arm.lower, space.arm.upper))
    stand = space._check_configurations(stand if q is None else q, "q")
    look = Look(ax=ax, camera=camera, legend=legend, title=title or space.arm.name)
    ghosts = interpolate_joints(points, np.linspace(0.0, 1.0, GHOST_COUNT + 1)[:-1]) if len(points) > 1 else points[:0]
    if marks and not len(points):
        ghosts = marks["start"][np.newaxis]
    painting = _paint(space, points, ghosts, stand, look, find_lost_steps(space, path))[0]
    painting.show()
    axes: Axes = painting.axes
    return axes


class MovingArm:
    """A three-dimensional picture of an arm that moves along a path.

    Parameters
    ----------
    space : ArmSpace
    points : ndarray of float64, shape (n, size)
        The path.
    look : Look

    Attributes
    ----------
    axes : matplotlib.axes.Axes
    """

    def __init__(self, space: Any, points: Floats, look: Look) -> None:
        ghosts = interpolate_joints(points, np.linspace(0.0, 1.0, _FRAMED_CONFIGURATIONS))
        self._painting, longest = _paint(space, points, ghosts, points[-1], look)
        self.axes: Axes = self._painting.axes
        self._arm, figure = space.arm, ArmFigure(space)
        self._links = {
            name: split_into_polygons(figure.links[name], longest, _MAX_LINK_TRIANGLES) for name in figure.moving
        }

    def move(self, q: Floats) -> None:
        """Show the arm at a configuration, shape (size,)."""
        poses = self._arm.poses(q)
        moved = [polygons @ poses[name][:3, :3].T + poses[name][:3, 3] for name, polygons in self._links.items()]
        self._painting.show(np.concatenate(moved))


def _paint(
    space: Any, points: Floats, ghosts: Floats, stand: Floats, look: Look, lost: Bools | None = None
) -> tuple[Painting, float]:
    """Draw an arm, pale arms at ``ghosts``, and its path.

    ``lost`` marks the steps of the path that are no longer proven free. If it is None, the picture is for an animation:
    it has space for the moving links and the pale arms, but omits them.

    Returns
    -------
    painting : Painting
        Not shown yet.
    longest : float
        Longest edge of a triangle, metres.
    """
    moving, lost = lost is None, np.zeros(0, dtype=np.bool_) if lost is None else lost
    figure = ArmFigure(space)
    links = figure.pose_links(stand)
    pale = [placed[name] for placed in map(figure.pose_links, ghosts) for name in figure.moving]
    corners = np.concatenate([vertices for vertices, _ in (*pale, *links.values())])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = VIEW_MARGIN_SHARE * float(np.max(high - low))
    obstacles = [_clip_surface(surface, low - margin, high + margin) for surface in figure.obstacles.values()]
    obstacles = [surface for surface in obstacles if len(surface[1])]
    corners = np.concatenate([corners, *(vertices[faces].reshape(-1, 3) for vertices, faces in obstacles)])
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    painting = Painting(look, (_CAMERA_ELEVATION, math.degrees(figure.camera_azimuth(low, high))), box)
    longest = _MAX_EDGE_SHARE * float(np.ptp(box, axis=0).max())
    for surface in obstacles:
        painting.add(split_into_polygons(surface, longest), SURFACES["obstacles"][1], SURFACES["obstacles"][0])
    fixed = [link for name, link in links.items() if not (moving and name in figure.moving)]
    for link in fixed:
        painting.add(split_into_polygons(link, longest), artists.ROBOT_FILL_COLOR, "arm")
    for link in () if moving else pale:
        painting.add(
            split_into_polygons(link, longest),
            GHOST_COLOR,
            "arm along the path" if len(points) > 1 else "arm at the start",
        )
    if len(points) > 1:
        shares, lengths = np.linspace(0.0, 1.0, 200), joint_lengths(points)
        curve = figure.tip_positions(interpolate_joints(points, shares))
        painting.add_path(
            curve, find_lost_stretches(shares, lengths, lost), f"path of {figure.tip}, dotted behind something"
        )
    artists.annotate(painting.axes, space, look, painting.stretch, "", list(painting.handles.values()))
    return painting, longest


def _clip_surface(surface: Surface, low: Floats, high: Floats) -> Surface:
    """Return the part of a surface inside a box."""
    import trimesh

    mesh = trimesh.Trimesh(*surface, process=False)
    for axis in range(3):
        for sign, end in ((1.0, low), (-1.0, high)):
            mesh = mesh.slice_plane(end, sign * np.eye(3)[axis]) if len(mesh.faces) else mesh
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)
