"""Pictures of an arm: surfaces of its links and obstacles, and its path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.inside import Floats, transform_surface
from cspace.plot._artists import check_axes
from cspace.plot._surface import Painting, make_polygons, split_surface
from cspace.plot.scene import GHOST_COLOR, ROBOT_FILL_COLOR, ArmFigure, CellClass, HasPath, Route

if TYPE_CHECKING:
    from collections.abc import Iterable

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

GHOST_COUNT: Final = 5
"""Number of arms drawn along a path, besides the one at its end."""


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
    check_axes(ax)
    route = Route(space, path)
    points = route.points
    endpoints = route.endpoints
    if q is None:
        q = endpoints.get("goal", space.arm.configuration())
    main_q = space.check_configuration(q)
    label = "arm at the start"
    ghosts = np.array([q for name, q in endpoints.items() if name == "start" and not len(points)])
    if len(points) > 1:
        label = "arm along the path"
        shares = np.arange(GHOST_COUNT) / GHOST_COUNT
        ghosts = route.interpolate(shares)
    figure = ArmFigure(space.arm)
    painting = paint_scene(space, figure, [main_q, *ghosts], camera, ax)
    for name, link in figure.links.items():
        figure.links[name] = split_surface(link, painting.size)
    arm = figure.pose_links(main_q)
    painting.add(make_polygons(arm.values()), ROBOT_FILL_COLOR, "arm")
    for ghost in ghosts:
        links = figure.pose_links(ghost)
        moving = [links[name] for name in figure.moving]
        painting.add(make_polygons(moving), GHOST_COLOR, label)
    draw_tip_path(painting, figure, route)
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
        if len(near.vertices):
            obstacles.append((np.asarray(near.vertices), np.asarray(near.faces)))
    corners = np.concatenate([box, *(vertices for vertices, _ in obstacles)])
    if camera is None:
        camera = choose_camera(box, [vertices for vertices, _ in obstacles])
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    painting = Painting(box, ax, camera)
    if obstacles:
        solid = CellClass.OBSTACLE
        parts = [split_surface(surface, painting.size) for surface in obstacles]
        painting.add(make_polygons(parts), solid.solid_color, solid.label)
    return painting


def choose_camera(box: Floats, obstacles: list[Floats]) -> tuple[float, float]:
    """Choose elevation and azimuth, degrees, so that the arm is in front of most obstacles.

    ``box``, shape (2, 3), is around the arm; obstacles are their vertices.
    """
    middles = [0.5 * (corners.min(axis=0) + corners.max(axis=0)) for corners in obstacles]
    away = np.sum([box.mean(axis=0) - middle for middle in middles], axis=0)
    if not middles or np.hypot(*away[:2]) < 0.1 * len(middles) * np.ptp(box, axis=0).max():
        return 30.0, -40.0
    # 30 degrees beside the line from the obstacles to the arm, so that depth can be seen.
    return 30.0, float(np.degrees(np.arctan2(away[1], away[0]))) + 30.0


def draw_tip_path(painting: Painting, figure: ArmFigure, route: Route) -> None:
    """Draw the path of the tip of an arm."""
    if len(route.points) > 1:
        painting.draw_path(figure.tip_positions(route.split()), route.is_lost)
