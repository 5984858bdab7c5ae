"""Pictures of an arm: surfaces of its links and obstacles, and its path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.inside import Floats, Surface, join_surfaces, transform_surface
from cspace.plot import _artists as artists
from cspace.plot._route import (
    HasPath,
    check_path,
    collect_endpoints,
    interpolate_path,
    is_path_lost,
    split_steps,
)
from cspace.plot._surface import Painting, make_polygons, split_surface

if TYPE_CHECKING:
    from collections.abc import Iterable

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

GHOST_COUNT: Final = 5
"""Number of arms drawn along a path, besides the one at its end."""
GHOST_COLOR: Final = "#c3e6da"
"""Colour of the arms along a path."""
ARM_CAMERA: Final = (30.0, -40.0)
"""Default elevation and azimuth of the camera for an arm, degrees."""


class ArmFigure:
    """The surfaces of an arm's links, and the position of its tip.

    Attributes
    ----------
    links : dict of str to Surface
        Each link in its own frame.
    moving : list of str
        Links moved by a joint.
    """

    def __init__(self, arm: Any) -> None:
        """Make all links' surfaces, and find the tip."""
        self._arm = arm
        self.links = {link.name: _make_link_surface(arm, link) for link in arm.links}
        joint_counts = {name: count_joints(arm, name) for name in self.links}
        self.moving = [name for name, count in joint_counts.items() if count]
        # The tip is the center of the link that the most joints move, as homogeneous coordinates.
        self._tip = max(joint_counts, key=joint_counts.__getitem__)
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


def count_joints(arm: Any, frame: str) -> int:
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


def draw_arm(
    space: Any,
    q: ArrayLike | None,
    path: ArrayLike | HasPath | None,
    camera: ArrayLike | None,
    ax: Axes | None,
    legend: bool,
    title: str | None,
) -> Axes:
    """Draw an arm among obstacles; see :meth:`cspace.ArmSpace.plot`.

    Besides the arm at ``q``, pale ones stand along the path, or at the start of a failed plan.
    """
    points, plan = check_path(space, path)
    endpoints = collect_endpoints(space, plan, points, None, None)
    if q is None:
        q = endpoints.get("goal", space.arm.configuration())
    main_q = space.check_configuration(q)
    label = "arm at the start"
    ghosts = np.array([q for name, q in endpoints.items() if name == "start" and not len(points)])
    if len(points) > 1:
        label = "arm along the path"
        shares = np.arange(GHOST_COUNT) / GHOST_COUNT
        ghosts = interpolate_path(space, points, shares)
    figure = ArmFigure(space.arm)
    painting = paint_scene(space, figure, [main_q, *ghosts], camera, ax)
    for name, link in figure.links.items():
        figure.links[name] = split_surface(link, painting.size)
    arm = figure.pose_links(main_q)
    painting.add(make_polygons(arm.values()), artists.ROBOT_FILL_COLOR, "arm")
    for ghost in ghosts:
        links = figure.pose_links(ghost)
        moving = [links[name] for name in figure.moving]
        painting.add(make_polygons(moving), GHOST_COLOR, label)
    draw_tip_path(painting, figure, space, points, is_path_lost(space, plan))
    painting.show()
    painting.annotate(ax is None, title, space.arm.name, legend)
    axes: Axes = painting.axes
    return axes


def paint_scene(
    space: Any,
    figure: ArmFigure,
    configurations: Iterable[Floats],
    camera: Any = None,
    ax: Any = None,
) -> Painting:
    """Paint obstacles near an arm, with space for configurations."""
    import trimesh

    box, clip = figure.measure(configurations)
    # Surfaces are cut along the sides of a box.
    sides = trimesh.creation.box(bounds=clip)
    obstacles = []
    for obstacle in filter(None, space.snapshot.obstacles.values()):
        surface = transform_surface(obstacle.shape.outer.surface, obstacle.pose)
        mesh: Any = trimesh.Trimesh(*surface, process=False)
        near = mesh.slice_plane(sides.facets_origin, -sides.facets_normal)
        obstacles.append((np.asarray(near.vertices), np.asarray(near.faces)))
    corners = np.concatenate([box, *(vertices for vertices, _ in obstacles)])
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    painting = Painting(box, ax, ARM_CAMERA if camera is None else camera)
    label, color = artists.SOLIDS[artists.OBSTACLE]
    if obstacles:
        parts = [split_surface(surface, painting.size) for surface in obstacles]
        painting.add(make_polygons(parts), color, label)
    return painting


def draw_tip_path(
    painting: Painting, figure: ArmFigure, space: Any, points: Floats, is_lost: bool
) -> None:
    """Draw the path of the tip of an arm."""
    if len(points) > 1:
        curve = figure.tip_positions(split_steps(space, points))
        painting.draw_path(curve, is_lost)
