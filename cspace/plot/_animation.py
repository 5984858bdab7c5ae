"""animate: a robot moving along a path."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict

import numpy as np
from numpy.typing import NDArray

from cspace._files.access import check_suffix, replacing
from cspace._support.arrays import Floats
from cspace._support.check import check_positive
from cspace.errors import InputError
from cspace.plot import _artists as artists
from cspace.plot._arms import ArmFigure, draw_tip_path, paint_arm, split_surface
from cspace.plot._picture import title_of
from cspace.plot._route import (
    HasAxes,
    HasPath,
    Scene,
    check_path,
    interpolate_path,
    make_scene,
)
from cspace.plot._sections import draw_plane
from cspace.plot._surface import draw_surface, split_triangles

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

DEFAULT_SECONDS: Final = 6.0
"""Duration of an animation of a path without times, seconds."""
_MAX_FRAMES: Final = 1000
"""Largest number of frames of an animation."""
_FRAME_DPI: Final = 90.0
"""Pixels per inch of the frames."""
_PALETTE_COLORS: Final = 96
"""Number of colours in an animation. Few colours keep the file small, and pictures are flat."""
_LAST_FRAME_MS: Final = 1200
"""Duration of the last frame, milliseconds."""
_FRAMED_CONFIGURATIONS: Final = 24
"""Number of configurations along the path that must be in view."""

Move = Callable[[Floats], object]
"""Function that moves the robot of a figure to a configuration."""


class AnimationOptions(TypedDict, total=False):
    """Options of :func:`animate`."""

    seconds: float
    rate: float
    title: str
    camera: ArrayLike
    progress: Callable[[int, int], None] | None


def animate(
    space: HasAxes,
    path: ArrayLike | HasPath,
    file: str | os.PathLike[str],
    overwrite: bool = False,
    *,
    seconds: float | None = None,
    rate: float = 10.0,
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
    rate : float
        Frames per second, at most 50.
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
    target = Path(file)
    check_suffix(target, (".gif",), "an animation is a GIF", "file", is_output=True)
    points = check_path(space, path)
    if not len(points):
        raise InputError(
            "path",
            "is empty",
            "an animation needs a path",
            "pass one that was found",
        )
    motion: Any = path if hasattr(path, "sample") else None
    if seconds is None:
        duration = 0.0 if motion is None else motion.duration
        seconds = duration or DEFAULT_SECONDS
    pause, count = _plan_frames(seconds, rate)
    # A robot that never moves needs one frame.
    if (points == points[0]).all():
        count = 1
    shares = np.linspace(0.0, 1.0, count)
    with replacing(target, overwrite) as temporary:
        draw = _draw_arm if hasattr(space, "arm") else _draw_map
        axes, move, reach = draw(space, points, title, camera)
        if motion is None:
            rows = interpolate_path(space.rotations, points, shares, reach)
        else:
            rows, *_ = motion.sample(shares * motion.duration)
        figure = axes.figure
        figure.set_dpi(_FRAME_DPI)
        frames = []
        for q in rows:
            move(q)
            figure.canvas.draw()
            # The layout of the first frame stays, so that nothing but the robot moves.
            figure.set_layout_engine("none")
            pixels = np.asarray(figure.canvas.buffer_rgba())
            frames.append(pixels[..., :3].copy())
            if progress is not None:
                progress(len(frames), len(rows))
        _write_gif(frames, temporary, pause)
    return target


def _plan_frames(seconds: float, rate: float) -> tuple[int, int]:
    """Choose the milliseconds per frame, in GIF's steps of 10 ms, and count the frames.

    Raises InputError if a number is out of range, or there would be too many frames.
    """
    duration = check_positive(seconds, "seconds", "seconds")
    frequency = check_positive(rate, "rate", "frames per second")
    if frequency > 50.0:  # viewers play no more
        raise InputError(
            "rate",
            f"is {rate!r}",
            "it must be at most 50 frames per second",
            "lower it",
        )
    count = round(duration * frequency) + 1
    if count > _MAX_FRAMES:
        raise InputError(
            "seconds",
            f"is {seconds!r}, which makes {count} frames at a rate of {frequency:g}",
            f"at most {_MAX_FRAMES} are possible",
            "lower it or the rate",
        )
    return 10 * max(2, round(100.0 / frequency)), max(count, 2)


def _draw_map(
    space: Any, points: Floats, title: str | None, camera: ArrayLike | None
) -> tuple[Any, Move, float]:
    """Draw a map; return its axes, a function that moves the robot, and the robot's reach.

    The robot will move along ``points``, shape (n, size).
    """
    dim = space.grid.dim
    if dim == 2 and camera is not None:
        raise InputError(
            "camera",
            "is given for a plane map",
            "it needs a map in space",
            "omit it",
        )
    # Only the moving robot is drawn, over the slice of its first rotation.
    scene = make_scene(space, path=points)
    no_stations = np.empty((0, points.shape[1]))
    scene = replace(scene, rotation=points[0, dim:], stations=no_stations)
    if dim == 2:
        axes, move, handles = _draw_plane(scene)
    else:
        axes, move, handles = _draw_solid(scene, camera)
    robot = artists.patch("robot", artists.ROBOT_FILL_COLOR, artists.ROBOT_EDGE_COLOR)
    artists.annotate(axes, True, title, title_of(space), [*handles, robot])
    return axes, move, scene.body.reach


def _draw_plane(scene: Scene) -> tuple[Any, Move, list[Any]]:
    """Draw a plane map whose slice follows the robot.

    Returns the axes, a function that moves the robot, and legend entries.
    """
    axes, handles = draw_plane(scene, None)
    (image,) = axes.images
    fixed_count = len(axes.collections)
    side = artists.block_side(axes, scene.space.grid.shape)

    def move(q: Floats) -> None:
        """Draw the robot at a configuration, and the slice of its rotation."""
        for robot in list(axes.collections[fixed_count:]):
            robot.remove()
        artists.draw_robots(axes, scene.body, q[np.newaxis], opacity=1.0, zorder=6.0)
        classes = artists.classify_cells(scene.space, q[2:], scene.window)
        image.set_data(artists.color_blocks(classes, side))

    return axes, move, handles


def _draw_solid(scene: Scene, camera: ArrayLike | None) -> tuple[Any, Move, list[Any]]:
    """Draw a map in space in which the robot moves.

    Returns the axes, a function that moves the robot, and legend entries.
    """
    painting = draw_surface(scene, camera=camera)
    corners = split_triangles(scene.body.triangles, scene.body.size).reshape(-1, 3)

    def move(q: Floats) -> None:
        """Draw the robot at a configuration."""
        polygons = scene.body.transform(corners, q).reshape(-1, 4, 3)
        painting.show(polygons)

    return painting.axes, move, list(painting.handles.values())


def _draw_arm(
    space: Any, points: Floats, title: str | None, camera: ArrayLike | None
) -> tuple[Any, Move, float]:
    """Draw an arm; return axes, a function that moves it, and 0, because joints have no reach."""
    figure = ArmFigure(space)
    # The picture has space for the arm along the whole path.
    shares = np.linspace(0.0, 1.0, _FRAMED_CONFIGURATIONS)
    framed = interpolate_path(space.rotations, points, shares)
    painting = paint_arm(figure, framed, camera)
    links = {name: split_surface(link, painting.size) for name, link in figure.links.items()}
    draw_tip_path(painting, figure, points, np.zeros(0, dtype=np.bool_))
    entries = [*painting.handles.values(), artists.patch("arm", artists.ROBOT_FILL_COLOR)]
    artists.annotate(painting.axes, True, title, space.arm.name, entries)

    def move(q: Floats) -> None:
        """Draw all links at a configuration."""
        poses = space.arm.poses(q)
        moved_links = []
        for name, polygons in links.items():
            rotation = poses[name][:3, :3]
            translation = poses[name][:3, 3]
            moved_links.append(polygons @ rotation.T + translation)
        painting.show(np.concatenate(moved_links))

    return painting.axes, move, 0.0


def _write_gif(frames: list[NDArray[np.uint8]], file: Path, pause: int) -> None:
    """Write frames as a GIF that repeats forever; ``pause`` is in milliseconds."""
    from PIL import Image

    # About six frames give the colours of all.
    step = max(1, len(frames) // 6)
    samples = np.concatenate(frames[::step])
    palette = Image.fromarray(samples).quantize(_PALETTE_COLORS, Image.Quantize.MAXCOVERAGE)
    # No dithering: it would flicker and enlarge the file.
    style: dict[str, Any] = {"palette": palette, "dither": Image.Dither.NONE}
    images = [Image.fromarray(frame).quantize(**style) for frame in frames]
    images[0].save(
        file,
        format="GIF",
        save_all=True,
        append_images=images[1:],
        duration=[pause] * (len(images) - 1) + [_LAST_FRAME_MS],
        loop=0,
    )
