"""Pictures of an arm: the surfaces of its links and of the obstacles, and where a path takes it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import Bools, Floats, Surface
from cspace.files.polygons import join_surfaces, transform_surface
from cspace.plot import artists
from cspace.plot.route import Look, lost_steps, marked, polyline
from cspace.plot.surface import SURFACES, Painting, polygons_of, steps_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GHOSTS: Final = 5
"""Arms that are drawn along a path, besides the one at its end."""
PALE: Final = "#c3e6da"
"""Their colour."""
ROOM: Final = 0.75
"""How far beyond an arm the obstacles are looked at, as part of its longest side."""
_ASIDE: Final = math.radians(40.0)
_RISE: Final = 30.0
"""Degrees above the ground from which one looks."""
_FINE: Final = 0.05
"""Longest side of a triangle that is drawn, as part of the picture: large ones are sorted wrongly among small ones."""


_FACES: Final = 1000
"""Triangles of a moving link, at most, before they are divided: pictures of an animation are many."""
_SEEN: Final = 24
"""Configurations along a path that must lie in view."""


class ArmFigure:
    """An arm among obstacles, as surfaces.

    Attributes
    ----------
    links : dict of str to Surface
        Each in its own frame.
    obstacles : dict of str to Surface
        In the frame of the base.
    moving : list of str
        Links that a joint moves.
    tip : str
        The one that most of them move.
    """

    def __init__(self, space: Any) -> None:
        self._arm = arm = space.arm
        self.links = {}
        for link in arm.links:
            back = np.linalg.inv(arm.frames.get(link.name, np.eye(4)))
            self.links[link.name] = join_surfaces(
                [transform_surface(part.shape.outer.surface, back @ part.pose) for part in link.parts]
            )
        self.obstacles = {
            name: transform_surface(each.shape.outer.surface, each.pose) for name, each in space.obstacles.items()
        }
        self.moving = [link.name for link in arm.links if link.body]
        depth = [0]
        for parent in arm.chain.parents[1:].tolist():
            depth.append(depth[parent] + 1)
        self.tip = max(arm.links, key=lambda link: depth[link.body]).name
        self._middle = np.append(self.links[self.tip][0].mean(axis=0), 1.0)

    def front(self, low: Floats, high: Floats) -> float:
        """From where to look at what lies in a box, radians about z: before the obstacles, and a little aside."""
        room = ROOM * float(np.max(high - low))
        near = [points.clip(low - room, high + room).mean(axis=0) for points, _ in self.obstacles.values()]
        behind = np.mean(near, axis=0) - (low + high) / 2 if near else np.zeros(3)
        if np.hypot(*behind[:2]) < 0.2 * room:
            return -_ASIDE
        return math.atan2(-behind[1], -behind[0]) + _ASIDE

    def placed(self, q: Floats) -> dict[str, Surface]:
        """The surfaces of the links at a configuration, shape (dof,), by name."""
        poses = self._arm.poses(q)
        return {name: transform_surface(surface, poses[name]) for name, surface in self.links.items()}

    def tips(self, points: Floats) -> Floats:
        """Where the middle of the :attr:`tip` is at configurations, shape (n, 3)."""
        return np.stack([self._arm.poses(q)[self.tip][:3] @ self._middle for q in points])


def joint_lengths(points: Floats) -> Floats:
    """Return the length of a path in the joints up to each row, shape (n,)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def along_joints(points: Floats, shares: Floats) -> Floats:
    """Configurations at shares, from 0 to 1, of the length of a path in the joints, shape (n, dof)."""
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
    """Draw an arm among obstacles; as :meth:`cspace.ArmSpace.plot`."""
    points = polyline(space, path)
    marks = marked(space, path, points, None, None)
    stand = marks.get("goal", np.zeros(space.size).clip(space.arm.lower, space.arm.upper))
    stand = space._check_configurations(stand if q is None else q, "q")
    look = Look(ax=ax, camera=camera, legend=legend, title=title or space.arm.name)
    ghosts = along_joints(points, np.linspace(0.0, 1.0, GHOSTS + 1)[:-1]) if len(points) > 1 else points[:0]
    if marks and not len(points):
        ghosts = marks["start"][np.newaxis]
    painting = _paint(space, points, ghosts, stand, look, lost_steps(space, path))[0]
    painting.show()
    axes: Axes = painting.axes
    return axes


class MovingArm:
    """An arm among obstacles along a path, in three dimensions, whose links move.

    ``points``, shape (n, dof), are the path.

    Attributes
    ----------
    axes : matplotlib.axes.Axes
    """

    def __init__(self, space: Any, points: Floats, look: Look) -> None:
        ghosts = along_joints(points, np.linspace(0.0, 1.0, _SEEN))
        self._painting, longest = _paint(space, points, ghosts, points[-1], look)
        self.axes: Axes = self._painting.axes
        self._arm, figure = space.arm, ArmFigure(space)
        self._links = {name: polygons_of(figure.links[name], longest, _FACES) for name in figure.moving}

    def move(self, q: Floats) -> None:
        """Show the arm at a configuration, shape (dof,)."""
        poses = self._arm.poses(q)
        parts = [part @ poses[name][:3, :3].T + poses[name][:3, 3] for name, part in self._links.items()]
        self._painting.show(np.concatenate(parts))


def _paint(
    space: Any, points: Floats, ghosts: Floats, stand: Floats, look: Look, lost: Bools | None = None
) -> tuple[Painting, float]:
    """Draw an arm where it stands, pale arms at its ghosts, and the curve of its path.

    ``lost`` are the steps of the path that are no longer proven free. If it is None, the arm moves: its moving links
    and the pale arms are left out, but the picture has room for them. Return the picture, yet to be shown, and the
    longest side of a triangle, metres.
    """
    moving, lost = lost is None, np.zeros(0, dtype=np.bool_) if lost is None else lost
    figure = ArmFigure(space)
    links = figure.placed(stand)
    pale = [placed[name] for placed in map(figure.placed, ghosts) for name in figure.moving]
    corners = np.concatenate([vertices for vertices, _ in (*pale, *links.values())])
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = ROOM * float(np.max(high - low))
    blocks = [_within(each, low - room, high + room) for each in figure.obstacles.values()]
    blocks = [each for each in blocks if len(each[1])]
    corners = np.concatenate([corners, *(vertices[faces].reshape(-1, 3) for vertices, faces in blocks)])
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    painting = Painting(look, (_RISE, math.degrees(figure.front(low, high))), box)
    longest = _FINE * float(np.ptp(box, axis=0).max())
    for block in blocks:
        painting.add(polygons_of(block, longest), SURFACES["obstacles"][1], SURFACES["obstacles"][0])
    still = [link for name, link in links.items() if not (moving and name in figure.moving)]
    for link in still:
        painting.add(polygons_of(link, longest), artists.ROBOT_FILL, "arm")
    for link in () if moving else pale:
        painting.add(polygons_of(link, longest), PALE, "arm along the path" if len(points) > 1 else "arm at the start")
    if len(points) > 1:
        shares, lengths = np.linspace(0.0, 1.0, 200), joint_lengths(points)
        curve = figure.tips(along_joints(points, shares))
        painting.add_path(curve, steps_at(shares, lengths, lost), f"path of {figure.tip}, dotted behind something")
    artists.annotate(painting.axes, space, look, painting.stretch, "", list(painting.handles.values()))
    return painting, longest


def _within(surface: Surface, low: Floats, high: Floats) -> Surface:
    """The part of a surface in a box, cut off where it leaves it."""
    import trimesh

    mesh = trimesh.Trimesh(*surface, process=False)
    for axis in range(3):
        for sign, end in ((1.0, low), (-1.0, high)):
            mesh = mesh.slice_plane(end, sign * np.eye(3)[axis]) if len(mesh.faces) else mesh
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)
