"""Pictures of an arm: surfaces of its links and obstacles, and its path."""

from __future__ import annotations

import math
from itertools import chain
from typing import TYPE_CHECKING, Any, Final, TypedDict

import numpy as np

from cspace._files.polygons import join_surfaces, transform_surface
from cspace._shapes.balls import Balls
from cspace._shapes.shape import ExactShape
from cspace._support.arrays import Bools, Floats, Surface
from cspace.plot import _artists as artists
from cspace.plot._route import (
    HasPath,
    check_path,
    collect_marks,
    find_lost_steps,
    interpolate_path,
    simplify_surface,
)
from cspace.plot._surface import SURFACES, Painting, split_steps, split_triangles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

GHOST_COUNT: Final = 5
"""Number of arms drawn along a path, besides the one at its end."""
GHOST_COLOR: Final = "#c3e6da"
"""Colour of the arms along a path."""
VIEW_MARGIN_SHARE: Final = 0.75
"""Margin around an arm in which obstacles are drawn, as a share of the longest side of its box."""
ARM_CAMERA: Final = (30.0, -40.0)
"""Default elevation and azimuth of the camera for an arm, degrees."""


class ArmFigure:
    """The surfaces of an arm and of its obstacles.

    Parameters
    ----------
    space : ArmSpace
    max_balls : float
        Obstacles of more balls of one radius, such as scans, have their centers as vertices, and
        no triangles.

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
        """Make the surfaces of all links and obstacles, and find the tip."""
        arm = space.arm
        self._arm = arm
        self.links = {link.name: _make_link_surface(arm, link) for link in arm.links}
        self.obstacles = {}
        for name, obstacle in space.obstacles.items():
            surface = _make_surface(obstacle.shape.outer, max_balls)
            self.obstacles[name] = transform_surface(surface, obstacle.pose)
        joint_counts = {link.name: count_joints(arm, link.name) for link in arm.links}
        self.moving = [name for name, count in joint_counts.items() if count]
        self.tip = max(joint_counts, key=joint_counts.__getitem__)
        # The mean of the tip's vertices, as homogeneous coordinates.
        self._tip_center = np.append(self.links[self.tip][0].mean(axis=0), 1.0)

    def pose_links(self, q: Floats) -> dict[str, Surface]:
        """Return the surfaces of the links at a configuration, by name."""
        poses = self._arm.poses(q)
        return {name: transform_surface(link, poses[name]) for name, link in self.links.items()}

    def tip_positions(self, points: Floats) -> Floats:
        """Return the positions of the center of the :attr:`tip` at configurations, shape (n, 3)."""
        to_base = self._arm.pose(points, self.tip)[..., :3, :]
        return np.asarray(to_base @ self._tip_center)

    def measure(self, configurations: Floats) -> tuple[Floats, Floats, float]:
        """Measure the box around an arm at configurations, shape (n, dof).

        Returns its lower and upper corner, and the margin in which obstacles are drawn, metres.
        """
        surfaces = chain.from_iterable(self.pose_links(q).values() for q in configurations)
        corners = np.concatenate([vertices for vertices, _ in surfaces])
        low = corners.min(axis=0)
        high = corners.max(axis=0)
        return low, high, VIEW_MARGIN_SHARE * float(np.max(high - low))


def count_joints(arm: Any, frame: str) -> int:
    """Return the number of joints that move a frame of an arm."""
    is_fixed_to_base = arm.placements[frame].body == 0
    if is_fixed_to_base:
        return 0
    branch, *_ = arm._branch_to(frame)
    return len(branch.joints)


def _make_link_surface(arm: Any, link: Any) -> Surface:
    """Make the surface of a link in its own frame."""
    # Parts are posed in the frame of the link's body.
    to_link = np.linalg.inv(arm.placements[link.name].pose)
    parts = [(part.shape.outer.surface, to_link @ part.pose) for part in link.parts]
    return join_surfaces([transform_surface(surface, pose) for surface, pose in parts])


def _make_surface(shape: ExactShape, max_balls: float) -> Surface:
    """Make the surface of a shape, or only centers for many balls of one radius."""
    if isinstance(shape, Balls) and len(shape.radii) > max_balls and not np.ptp(shape.radii):
        no_faces = np.empty((0, 3), dtype=np.int64)
        return shape.centers, no_faces
    return shape.surface


class ArmPlotOptions(TypedDict, total=False):
    """Options of :meth:`cspace.ArmSpace.plot`."""

    q: ArrayLike
    path: ArrayLike | HasPath
    camera: ArrayLike
    ax: Axes
    legend: bool
    title: str


def draw_arm(
    space: Any,
    q: ArrayLike | None = None,
    path: ArrayLike | HasPath | None = None,
    camera: ArrayLike | None = None,
    ax: Axes | None = None,
    legend: bool = True,
    title: str | None = None,
) -> Axes:
    """Draw an arm among obstacles; see :meth:`cspace.ArmSpace.plot`.

    Besides the arm at ``q``, pale ones stand along the path, or at the start of a failed plan.
    """
    points = check_path(space, path)
    marks = collect_marks(space, path, points, None, None)
    if q is None:
        q = marks.get("goal", space.arm._rest)
    main_q = space.arm._check_configuration(q, "q")
    label = "arm along the path"
    ghosts = np.empty((0, len(main_q)))
    if len(points) > 1:
        shares = np.arange(GHOST_COUNT) / GHOST_COUNT
        ghosts = interpolate_path(space.rotations, points, shares)
    elif "start" in marks and not len(points):
        label = "arm at the start"
        ghosts = marks["start"][np.newaxis]
    figure = ArmFigure(space)
    painting = paint_arm(figure, np.vstack([main_q, ghosts]), camera, ax)
    for surface in figure.pose_links(main_q).values():
        painting.add(split_surface(surface, painting.size), artists.ROBOT_FILL_COLOR, "arm")
    for ghost in ghosts:
        links = figure.pose_links(ghost)
        for name in figure.moving:
            painting.add(split_surface(links[name], painting.size), GHOST_COLOR, label)
    draw_tip_path(painting, figure, points, find_lost_steps(space, path))
    painting.show()
    entries = list(painting.handles.values()) if legend else []
    artists.annotate(painting.axes, ax is None, title, space.arm.name, entries)
    axes: Axes = painting.axes
    return axes


def paint_arm(
    figure: ArmFigure, configurations: Floats, camera: Any = None, ax: Any = None
) -> Painting:
    """Paint the obstacles near an arm, with space for it at configurations (n, size)."""
    low, high, margin = figure.measure(configurations)
    # Obstacles far away would make the arm small.
    low_clip, high_clip = low - margin, high + margin
    obstacles = figure.obstacles.values()
    near_surfaces = [_clip_surface(surface, low_clip, high_clip) for surface in obstacles]
    corners = np.concatenate([[low, high], *(vertices for vertices, _ in near_surfaces)])
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    painting = Painting(box, ax, ARM_CAMERA if camera is None else camera)
    label, color = SURFACES["obstacles"]
    for surface in near_surfaces:
        painting.add(split_surface(surface, painting.size), color, label)
    return painting


def draw_tip_path(painting: Painting, figure: ArmFigure, points: Floats, lost: Bools) -> None:
    """Draw the path of the tip of an arm; ``lost`` steps are no longer proven free."""
    if len(points) > 1:
        rows, is_lost = split_steps(points, lost)
        painting.add_path(figure.tip_positions(rows), is_lost)


def split_surface(surface: Surface, size: float) -> Floats:
    """Simplify a surface and split it into small polygons, shape (n, 4, 3)."""
    vertices, faces = simplify_surface(surface)
    return split_triangles(vertices[faces], size)


def _clip_surface(surface: Surface, low: Floats, high: Floats) -> Surface:
    """Return the part of a surface inside the box with corners ``low`` and ``high``."""
    import trimesh

    box = trimesh.creation.box(bounds=[low, high])
    mesh = trimesh.Trimesh(*surface, process=False)
    mesh = mesh.slice_plane(box.facets_origin, -box.facets_normal)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)
