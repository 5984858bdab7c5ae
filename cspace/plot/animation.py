"""animate: a robot moving along a path; in the plane, beside the C-obstacle at its rotation."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Floats
from cspace.check import check_positive
from cspace.errors import InputError
from cspace.files.access import check_suffix, replacing
from cspace.plot import artists
from cspace.plot.arms import MovingArm, interpolate_joints
from cspace.plot.route import HasAxes, HasPath, Look, MapLike, Route, check_path
from cspace.plot.surface import paint_surface, robot_polygons

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike


_PANEL_INCHES = 7.5
"""Longer side of each of the two panels, inches."""
_FRAME_DPI = 72.0
"""Pixels per inch of the frames."""
DEFAULT_SECONDS: Final = 6.0
"""Duration of an animation of a path without times, seconds."""
_MAX_FRAMES: Final = 1000
_PALETTE_COLORS: Final = 96
"""Number of colours in an animation. Few colours keep the file small, and the pictures are flat."""
_SIMILAR_LEVELS: Final = 24
"""Largest difference in red, green and blue, of 255 levels, between similar colours."""
_LAST_FRAME_MS: Final = 1200
"""Duration of the last frame, milliseconds."""


class AnimationOptions(TypedDict, total=False):
    """Options of :func:`animate`."""

    seconds: float
    rate: float
    title: str
    camera: ArrayLike
    progress: Callable[[int, int], None]


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

    In the plane, one panel shows the robot among the obstacles; the other shows its reference point in the slice of the
    map at its rotation. In space, and for an arm, one picture in three dimensions shows the robot among the obstacles.
    A :class:`planners.Trajectory` plays at true speed. Otherwise the speed is constant: of the farthest point of a
    robot that rotates, or in the joints of an arm.

    Parameters
    ----------
    space : CSpace or ArmSpace
    path : array-like, shape (n, size), Plan or Trajectory
        Configurations joined by straight edges, metres and radians; or an object with a ``path`` attribute.
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
        If the suffix is not .gif, the path is empty, has the wrong shape or is not finite, or a number is out of range.
    FileError
        If the file exists and ``overwrite`` is not set, or if it cannot be written.
    """
    target = Path(file)
    check_suffix(target, (".gif",), "an animation is a GIF", "file")
    points = check_path(space, path)
    if not len(points):
        raise InputError("path", "is empty", "an animation needs a path", "pass one that was found", value=path)
    motion: Any = path if hasattr(path, "sample") else None
    if seconds is None:
        seconds = DEFAULT_SECONDS if motion is None or motion.duration == 0.0 else motion.duration
    pause, count = _frame_timing(seconds, rate)
    shares = np.linspace(0.0, 1.0, count if bool((points != points[0]).any()) else 1)
    with replacing(target, overwrite) as temporary:
        draw, interpolate = _make_scene(space, points, title, camera)
        if motion is not None:
            interpolate = lambda shares: motion.sample(shares * motion.duration)[0]  # noqa: E731
        frames = []
        for drawn, q in enumerate(interpolate(shares), start=1):
            frames.append(draw(q))
            if progress is not None:
                progress(drawn, len(shares))
        _write(frames, temporary, pause)
    return target


Draw = Callable[[Floats], NDArray[np.uint8]]
Interpolate = Callable[[Floats], Floats]


def _make_scene(
    space: HasAxes, points: Floats, title: str | None, camera: ArrayLike | None
) -> tuple[Draw, Interpolate]:
    """Return functions that draw a configuration and interpolate the path."""
    arm = getattr(space, "arm", None)
    if arm is not None:
        moving = MovingArm(space, points, Look(title=arm.name if title is None else title, camera=camera))
        return partial(_pixels, moving.axes, moving.move), partial(interpolate_joints, points)
    space = cast("MapLike", space)
    route = Route.of(space, points, None, None)
    if space.grid.dim == 2:
        if camera is not None:
            raise InputError("camera", "is given for a plane map", "it needs a map in space", "omit it")
        return PlaneAnimation(space, route, title).frame, route.interpolate
    stations = route.interpolate(np.linspace(0.0, 1.0, 64))  # all of them must be in view
    framed = Route(route.points, route.marks, stations, route.glyph)
    painting = paint_surface(space, framed, Look(title=title, camera=camera), moving=True)
    polygons = robot_polygons(route.glyph)

    def move(q: Floats) -> None:
        painting.show(route.glyph.transform(polygons, q))

    return partial(_pixels, painting.axes, move), route.interpolate


def _pixels(axes: Axes, move: Callable[[Floats], None], q: Floats) -> NDArray[np.uint8]:
    """Move the robot and return the pixels, shape (height, width, 3)."""
    canvas: Any = axes.figure.canvas
    axes.figure.set_dpi(_FRAME_DPI)
    move(q)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _frame_timing(seconds: float, rate: float) -> tuple[int, int]:
    """Return the milliseconds per frame, and the frame count.

    GIF's steps are 10 ms.
    """
    duration, frequency = (
        check_positive(seconds, "seconds", "seconds"),
        check_positive(rate, "rate", "frames per second"),
    )
    if frequency > 50.0:  # viewers play no more
        raise InputError("rate", f"is {rate!r}", "it must be at most 50 frames per second", "lower it", value=rate)
    count = round(duration * frequency) + 1
    if count > _MAX_FRAMES:
        problem = f"is {seconds!r}, which makes {count} frames at a rate of {frequency:g}"
        raise InputError(
            "seconds", problem, f"at most {_MAX_FRAMES} are possible", "lower it or the rate", value=seconds
        )
    return 10 * max(2, round(100.0 / frequency)), max(count, 2)


class PlaneAnimation:
    """Two panels of a plane animation.

    Each frame redraws only the moving artists.
    """

    def __init__(self, space: MapLike, route: Route, title: str | None) -> None:
        from matplotlib.patches import PathPatch

        self._space, self._glyph, self._cell = space, route.glyph, -1
        stops = route.interpolate(np.linspace(0.0, 1.0, 64))
        box = Route(route.points, route.marks, stops, route.glyph).box(space)
        stretch = artists.axis_stretch(box)
        self.figure, (world, plane) = _panels(box, space.grid.labels)
        ground = artists.classify_ground(space.workspace)
        artists.draw_cells(world, space.grid, ground)
        slices = [self._classes(q) for q in stops]
        self._image = artists.draw_cells(plane, space.grid, slices[0])
        handles = artists.make_cell_legend([np.unique(part) for part in (ground, *slices)], space, box)
        for ax in (world, plane):
            drawn = artists.draw_route(ax, route, 0.7, robots=False)
            artists.frame(ax, box, stretch)
        self._trail = world.plot([], [], color=artists.ROBOT_COLOR, linewidth=2.2, zorder=4.5)[0]
        first = route.points[0]
        style: dict[str, Any] = {
            "facecolor": artists.ROBOT_FILL_COLOR,
            "edgecolor": artists.ROBOT_EDGE_COLOR,
            "zorder": 6,
        }
        self._robot = PathPatch(artists.outline(self._glyph, first), **style)
        world.add_patch(self._robot)
        self._nose = PathPatch(
            artists.nose(self._glyph, first), facecolor=artists.ROBOT_EDGE_COLOR, linewidth=0.0, zorder=6.1
        )
        world.add_patch(self._nose)
        self._point = plane.plot([], [], marker="o", markersize=6.0, color=artists.ROBOT_COLOR, mec="black", zorder=6)[
            0
        ]
        heads: dict[str, Any] = {"loc": "left", "fontsize": 9}
        world.set_title("workspace", **heads)
        self._head = plane.set_title("C-obstacle", **heads)
        self.figure.suptitle(artists.title(space, stretch, title), fontsize=10)
        artists.legend_below(self.figure, handles + drawn, 8.0)
        self._canvas = self.figure.canvas
        # A moving artist must not shift the panels, and fixed artists, above all text, are drawn once.
        self.figure.get_layout_engine().execute(self.figure)
        self.figure.set_layout_engine("none")
        over = [*plane.images, *plane.lines, *plane.spines.values(), self._head]
        under = [*world.lines, *world.patches]
        self._moving = [*sorted(under, key=_layer), *sorted(over, key=_layer)]
        for artist in self._moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self.figure.bbox)
        self._visited: list[Floats] = []

    def frame(self, q: Floats) -> NDArray[np.uint8]:
        """Return the pixels with the robot at a configuration.

        The result has shape (height, width, 3).
        """
        self._visited.append(q)
        self._trail.set_data(*np.transpose(self._visited)[:2])
        self._robot.set_path(artists.outline(self._glyph, q))
        self._nose.set_path(artists.nose(self._glyph, q))
        self._point.set_data(q[:1], q[1:2])
        rotations = self._space.rotations
        self._head.set_text(" at ".join(filter(None, ["C-obstacle", rotations.format_rotation(np.round(q[2:], 2))])))
        cell = int(rotations.find_cells(q))
        if cell != self._cell:
            self._cell = cell
            self._image.set_classes(self._classes(q))
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            artist.draw(self._canvas.get_renderer())
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _classes(self, q: Floats) -> NDArray[np.uint8]:
        return artists.classify_cells(self._space, q[2:])


def _layer(artist: Artist) -> float:
    return artist.get_zorder()


def _panels(box: Floats, labels: Sequence[str]) -> tuple[Any, tuple[Axes, Axes]]:
    """Create a figure with two panels.

    Wide panels are stacked.
    """
    width, height = artists.axes_size(box, _PANEL_INCHES)
    wide = width > 1.4 * height
    size = (width + 0.7, 2 * height + 1.5) if wide else (2 * width + 0.9, height + 1.3)
    figure = artists.new_figure(max(size[0], 4.2), size[1], _FRAME_DPI)
    shape = (2, 1) if wide else (1, 2)
    panels: Any = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False)
    first, second = panels.flat
    first.set_ylabel(labels[1])
    second.set_xlabel(labels[0])
    (second.set_ylabel if wide else first.set_xlabel)(labels[int(wide)])
    return figure, (first, second)


def _palette(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Choose the colors of a palette.

    ``colors``, shape (n, 3), are ordered by frequency, most frequent first. The palette has at most
    :data:`_PALETTE_COLORS`. Its first half holds dissimilar colours, so that a thin line keeps its colour beside many
    shades of another one.
    """
    chosen: list[int] = []
    remaining = np.arange(len(colors))
    while len(remaining) and len(chosen) < _PALETTE_COLORS // 2:
        chosen.append(int(remaining[0]))
        differences = np.abs(colors[remaining].astype(np.int16) - colors[remaining[0]]).max(axis=1)
        remaining = remaining[differences > _SIMILAR_LEVELS]
    others = [index for index in range(min(len(colors), 2 * _PALETTE_COLORS)) if index not in chosen]
    return colors[[*chosen, *others[: _PALETTE_COLORS - len(chosen)]]]


def _write(frames: list[NDArray[np.uint8]], file: Path, pause: int) -> None:
    """Write frames as a GIF that repeats forever; ``pause`` is in milliseconds."""
    from PIL import Image

    # No dithering: it would flicker and enlarge the file.
    pixels = np.concatenate([frame.reshape(-1, 3) for frame in frames[:: max(1, len(frames) // 6)]])
    colors, counts = np.unique(pixels @ np.array([65536, 256, 1], np.uint32), return_counts=True)
    colors = colors[np.argsort(-counts, kind="stable")]
    table = np.stack([colors >> 16, colors >> 8 & 255, colors & 255], axis=-1).astype(np.uint8)
    model = Image.new("P", (1, 1))
    model.putpalette(_palette(table).tobytes())
    images = [Image.fromarray(frame).quantize(palette=model, dither=Image.Dither.NONE) for frame in frames]
    images[0].save(
        file,
        format="GIF",
        save_all=True,
        append_images=images[1:],
        duration=[pause] * (len(images) - 1) + [_LAST_FRAME_MS],
        loop=0,
        optimize=False,
    )
