"""animate: a robot moving along a path."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict

import numpy as np

from cspace.errors import InputError
from cspace.inside import (
    ConfigurationMap,
    ConfigurationSpace,
    Floats,
    check_positive,
    check_suffix,
    names_options,
    replacing,
)
from cspace.plot import _artists as artists
from cspace.plot._arms import draw_tip_path, paint_scene
from cspace.plot._picture import make_title
from cspace.plot._sections import draw_plane, find_cells
from cspace.plot._surface import draw_surface, split_surface
from cspace.plot.scene import (
    ROBOT_FILL_COLOR,
    ArmFigure,
    HasPath,
    Route,
    classify_cells,
    make_scene,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cspace import Space

PAUSE: Final = 100
"""Milliseconds per frame, a multiple of the 10 ms that a GIF counts in."""

Move = Callable[[Floats], object]
"""Function that moves the robot of a figure to a configuration."""


class AnimationOptions(TypedDict, total=False):
    """Options of :func:`animate`."""

    seconds: float
    title: str
    camera: ArrayLike
    progress: Callable[[int, int], None] | None


@names_options
def animate(
    space: Space,
    path: ArrayLike | HasPath,
    file: str | os.PathLike[str],
    overwrite: bool = False,
    *,
    seconds: float | None = None,
    title: str | None = None,
    camera: ArrayLike | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Save an animated GIF of a robot moving along a path.

    In the plane, the robot moves over the slice of the map at its rotation. In space, and for an
    arm, a picture in three dimensions shows the robot among the obstacles. A
    :class:`planners.Trajectory` plays at true speed. Otherwise the speed is constant: of the
    farthest point of a robot that rotates, or in the joints of an arm.

    Parameters
    ----------
    space : CSpace or ArmSpace
    path : array-like, shape (n, size), Plan or Trajectory
        Configurations joined by straight edges, metres and radians; or an object with a ``path``
        attribute.
    file : path-like
        A name that ends in .gif.
    overwrite : bool
        Replace an existing file.
    seconds : float, optional
        Duration of the motion; by default as in the trajectory, and 6 without times.
    title : str, optional
        Default: the robot and the side of a cell, or the name of the arm. Pass ``""`` for no title.
    camera : array-like, shape (2,), optional
        Elevation and azimuth, degrees, for pictures in three dimensions.
    progress : callable, optional
        Called with (frames drawn, total frames).

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    InputError
        If the suffix is not .gif, the path is empty, has the wrong shape or is not finite, or a
        number is out of range.
    FileError
        If the file exists and ``overwrite`` is not set, or if it cannot be written.
    """
    check_suffix(file, (".gif",), "an animation is a GIF", "file", is_output=True)
    target = Path(file)
    if not isinstance(space, ConfigurationSpace):
        raise InputError("space", f"is {space!r}", "only maps and arms are drawn")
    given = Route(space, path)
    route = Route(space, given.points)  # a film shows no proofs
    if not len(route.points):
        raise InputError(
            "path",
            "is empty",
            "an animation needs a path",
        )
    motion = given.plan if hasattr(given.plan, "duration") else None
    if seconds is None:
        seconds = getattr(motion, "duration", 0.0) or 6.0
    count = _count_frames(seconds)
    is_still = (route.points == route.points[0]).all()
    if is_still:
        count = 1
    shares = np.linspace(0.0, 1.0, count)
    with replacing(target, overwrite) as temporary:
        draw = _draw_map if isinstance(space, ConfigurationMap) else _draw_arm
        axes, move, reach = draw(route, title, camera)
        if motion is None:
            rows = route.interpolate(shares, reach)
        else:
            rows, *_ = motion.sample(shares * motion.duration)
        images: list[Any] = []
        for q in rows:
            move(q)
            # All images have the palette of the first one.
            images.append(_render_image(axes.figure, *images[:1]))
            if progress is not None:
                progress(len(images), len(rows))
        # The last image stays for a second more.
        pauses = [PAUSE] * (len(images) - 1) + [PAUSE + 1000]
        images[0].save(temporary, save_all=True, append_images=images[1:], duration=pauses, loop=0)
    return target


def _count_frames(seconds: float) -> int:
    """Return the number of frames of a duration.

    Raises InputError if it is not above zero, or there would be too many frames.
    """
    duration = check_positive(seconds, "seconds", "seconds")
    count = round(1000.0 * duration / PAUSE) + 1
    # Largest number of frames of an animation.
    max_frames = 1000
    if count > max_frames:
        raise InputError(
            "seconds",
            f"is {seconds!r}, which makes {count} frames",
            f"at most {max_frames} are possible",
        )
    return max(count, 2)


def _render_image(figure: Any, palette: Any = None) -> Any:
    """Render a figure as an image of at most 96 colours.

    Few colours keep files small. ``palette`` is an image whose colours are used.
    """
    from PIL import Image

    figure.set_dpi(90.0)
    figure.canvas.draw()
    # The first layout stays, so that nothing but the robot moves.
    figure.set_layout_engine("none")
    pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    image = Image.fromarray(pixels.copy())
    # Dithering would flicker.
    return image.quantize(96, Image.Quantize.MAXCOVERAGE, palette=palette, dither=Image.Dither.NONE)


def _draw_map(route: Route, title: str | None, camera: ArrayLike | None) -> tuple[Any, Move, float]:
    """Draw a map; return axes, mover of the robot, and reach.

    In the plane, the slice of the map at the robot's rotation is drawn.
    """
    space: Any = route.space
    points = route.points
    dim = space.grid.dim
    if dim == 2 and camera is not None:
        raise InputError(
            "camera",
            "is given for a plane map",
            "it needs a map in space",
        )
    # Only the moving robot is drawn, over the slice of its first rotation.
    scene = make_scene(space, path=points)
    body = scene.body
    box = _choose_frame(scene.box, body.extents(points)) if dim == 2 else scene.box
    scene = replace(scene, rotation=points[0, dim:], robots=points[:0], box=box)
    robot = artists.make_patch("robot", ROBOT_FILL_COLOR, artists.ROBOT_EDGE_COLOR)
    if body.surface is not None:
        painting = draw_surface(scene, camera=camera)
        vertices, faces = split_surface(body.surface, body.size)
        painting.handles["robot"] = robot
        painting.annotate(True, title, make_title(space))

        def show(q: Floats) -> None:
            """Draw the robot at a configuration."""
            painting.show([(body.transform(vertices, q), faces)])

        return painting.axes, show, body.reach
    axes, handles = draw_plane(scene, None)
    (image,) = axes.images
    artists.annotate(axes, True, title, make_title(space), [*handles, robot])

    def move(q: Floats) -> None:
        """Draw the robot at a configuration, and the slice of its rotation."""
        for drawn in list(axes.collections):
            drawn.remove()
        artists.draw_robots(axes, body, q[np.newaxis], opacity=1.0)
        classes = classify_cells(space, q[2:], find_cells(space.grid, box))
        image.set_data(artists.merge_cells(axes, classes)[0])

    return axes, move, body.reach


def _choose_frame(whole: Floats, robots: Floats) -> Floats:
    """Return the part of a map to show around a path, or all of it if that is not much more.

    ``robots``, shape (n, 2, 2), are the boxes around the robot along the path.
    """
    near = np.stack([robots[:, 0].min(axis=0), robots[:, 1].max(axis=0)])
    side = np.ptp(near, axis=0).max()
    if 4.0 * side > np.ptp(whole, axis=0).max():
        return whole
    frame: Floats = np.clip(near + 0.5 * side * np.array([[-1.0], [1.0]]), *whole)
    return frame


def _draw_arm(route: Route, title: str | None, camera: ArrayLike | None) -> tuple[Any, Move, float]:
    """Draw an arm; return axes, mover of the arm, and 0.

    The 0 is the reach, which lengths of paths of an arm ignore.
    """
    space: Any = route.space
    figure = ArmFigure(space.arm)
    # The picture has space for the arm along the whole path, at 24 configurations.
    framed = route.interpolate(np.linspace(0.0, 1.0, 24))
    painting = paint_scene(space, figure, framed, camera)
    for name, link in figure.links.items():
        figure.links[name] = split_surface(link, painting.size)
    draw_tip_path(painting, figure, route)
    painting.handles["arm"] = artists.make_patch("arm", ROBOT_FILL_COLOR)
    painting.annotate(True, title, space.arm.name)
    return painting.axes, lambda q: painting.show(figure.pose_links(q).values()), 0.0
