"""animate: a robot along a path; in the plane beside the C-obstacle that changes as it turns."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Floats
from cspace.check import positive
from cspace.errors import InputError
from cspace.files.access import check_suffix, replacing
from cspace.plot import artists
from cspace.plot.arms import MovingArm, along_joints
from cspace.plot.route import HasAxes, HasPath, Look, MapLike, Route, polyline
from cspace.plot.surface import paint_surface, robot_polygons

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike


_LONG = 7.5
"""Length of the longer side of each of the two panels, in inches."""
_DPI = 72.0
_MOST_FRAMES: Final = 1000
_COLORS: Final = 96
"""Colours of the animation; few keep the file small, and the pictures are flat."""
_ALIKE: Final = 24
"""Levels of red, green or blue, out of 255, by which colours are alike."""
_REST: Final = 1200
"""Milliseconds that the last frame stands."""


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
    seconds: float = 6.0,
    rate: float = 10.0,
    title: str | None = None,
    camera: ArrayLike | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Draw a robot that moves along a path into an animated GIF.

    In the plane, one panel shows the robot among the obstacles; the other, on the same axes, its reference point in the
    slice of the map at its rotation. In space, and for an arm, one picture in three dimensions shows the robot among
    the obstacles. The robot's speed is even: a turn counts as the distance that its farthest point moves, and for an
    arm the speed is that in its joints.

    Parameters
    ----------
    space : CSpace or ArmSpace
    path : array-like, shape (n, size), or Plan
        Configurations, joined by straight edges, in metres and radians; or anything whose ``path`` attribute holds
        them.
    file : path-like
        A name that ends in .gif.
    overwrite : bool
        Whether an existing file may be replaced.
    seconds : float
        How long the drive lasts.
    rate : float
        Frames in a second, at most 50.
    title : str, optional
        By default the robot and the side of a cell, or the arm's name. Pass ``""`` for none.
    camera : array-like, shape (2,), optional
        In space: elevation and azimuth in degrees.
    progress : callable, optional
        Called with (frames drawn, frames in all).

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    InputError
        If the suffix is another one, the path is empty, has the wrong shape or is not finite, or a number is out of
        range.
    FileError
        If the file exists and ``overwrite`` is not set, or cannot be written.
    """
    target = Path(file)
    check_suffix(target, (".gif",), "an animation is a GIF", "file")
    points = polyline(space, path)
    if not len(points):
        raise InputError("path", "is empty", "an animation needs a path", "pass one that was found", value=path)
    pause, count = _timing(seconds, rate)
    shares = np.linspace(0.0, 1.0, count if bool((points != points[0]).any()) else 1)
    with replacing(target, overwrite) as temporary:
        draw, along = _scene(space, points, title, camera)
        frames = []
        for number, q in enumerate(along(shares)):
            frames.append(draw(q))
            if progress is not None:
                progress(number + 1, len(shares))
        _write(frames, temporary, pause)
    return target


Draw = Callable[[Floats], NDArray[np.uint8]]
Along = Callable[[Floats], Floats]


def _scene(space: HasAxes, points: Floats, title: str | None, camera: ArrayLike | None) -> tuple[Draw, Along]:
    """Return what draws a configuration as pixels, and what gives configurations at shares of the path's length."""
    arm = getattr(space, "arm", None)
    if arm is not None:
        moving = MovingArm(space, points, Look(title=arm.name if title is None else title, camera=camera))
        return partial(_pixels, moving.axes, moving.move), partial(along_joints, points)
    space = cast("MapLike", space)
    route = Route.of(space, points, None, None)
    if space.grid.dim == 2:
        if camera is not None:
            raise InputError("camera", "is given for a map of the plane", "it is for space", "leave it out")
        return Stage(space, route, title).frame, route.along
    stops = route.along(np.linspace(0.0, 1.0, 64))
    seen = Route(route.points, route.marks, stops, route.figurine)
    painting = paint_surface(space, seen, Look(title=title, camera=camera), moving=True)
    polygons = robot_polygons(route.figurine)

    def move(q: Floats) -> None:
        painting.show(route.figurine.placed(polygons, q))

    return partial(_pixels, painting.axes, move), route.along


def _pixels(axes: Axes, move: Callable[[Floats], None], q: Floats) -> NDArray[np.uint8]:
    """Return the pixels of a picture after a robot has moved, shape (height, width, 3)."""
    canvas: Any = axes.figure.canvas
    axes.figure.set_dpi(_DPI)
    move(q)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _timing(seconds: float, rate: float) -> tuple[int, int]:
    """Milliseconds of a frame, in tens as in every GIF, and the number of frames."""
    lasts, often = positive(seconds, "seconds", "seconds"), positive(rate, "rate", "frames in a second")
    if often > 50.0:
        rule = "it must be at most 50 frames in a second, as viewers play no more"
        raise InputError("rate", f"is {rate!r}", rule, "pass a lower rate", value=rate)
    count = round(lasts * often) + 1
    if count > _MOST_FRAMES:
        problem = f"is {seconds!r}, which at a rate of {often:g} makes {count} frames"
        rule = f"at most {_MOST_FRAMES} keep the file usable"
        raise InputError("seconds", problem, rule, "pass fewer seconds or a lower rate", value=seconds)
    return 10 * max(2, round(100.0 / often)), max(count, 2)


class Stage:
    """The two panels, drawn once; a frame moves what moves."""

    def __init__(self, space: MapLike, route: Route, title: str | None) -> None:
        from matplotlib.patches import PathPatch

        self._space, self._figurine, self._cell = space, route.figurine, -1
        stops = route.along(np.linspace(0.0, 1.0, 64))
        box = Route(route.points, route.marks, stops, route.figurine).box(space)
        stretch = artists.stretches(box)
        self.figure, (world, plane) = _panels(box, space.grid.labels)
        ground = artists.ground_of(space.workspace)
        artists.draw_cells(world, space.grid, ground)
        slices = [self._classes(q) for q in stops]
        self._image = artists.draw_cells(plane, space.grid, slices[0])
        handles = artists.cell_legend([np.unique(part) for part in (ground, *slices)], space, box)
        for ax in (world, plane):
            drawn = artists.draw_route(ax, route, 0.7, robots=False)
            artists.frame(ax, box, stretch)
        self._trail = world.plot([], [], color=artists.ROBOT, linewidth=2.2, zorder=4.5)[0]
        first = route.points[0]
        style: dict[str, Any] = {"facecolor": artists.ROBOT_FILL, "edgecolor": artists.DARK, "zorder": 6}
        self._robot = PathPatch(artists.outline(self._figurine, first), **style)
        world.add_patch(self._robot)
        self._nose = PathPatch(artists.nose(self._figurine, first), facecolor=artists.DARK, linewidth=0.0, zorder=6.1)
        world.add_patch(self._nose)
        self._point = plane.plot([], [], marker="o", markersize=6.0, color=artists.ROBOT, mec="black", zorder=6)[0]
        heads: dict[str, Any] = {"loc": "left", "fontsize": 9}
        world.set_title("workspace", **heads)
        self._head = plane.set_title("C-obstacle", **heads)
        self.figure.suptitle(artists.title(space, stretch, title), fontsize=10)
        artists.legend_below(self.figure, handles + drawn, 8.0)
        self._canvas = self.figure.canvas
        # What moves must not move the panels; and what stands, letters above all, is drawn once.
        self.figure.get_layout_engine().execute(self.figure)
        self.figure.set_layout_engine("none")
        over = [*plane.images, *plane.lines, *plane.spines.values(), self._head]
        under = [*world.lines, *world.patches]
        self._moving = [*sorted(under, key=_layer), *sorted(over, key=_layer)]
        for artist in self._moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(self.figure.bbox)
        self._way: list[Floats] = []

    def frame(self, q: Floats) -> NDArray[np.uint8]:
        """Pixels with the robot at a configuration, shape (height, width, 3)."""
        self._way.append(q)
        self._trail.set_data(*np.transpose(self._way)[:2])
        self._robot.set_path(artists.outline(self._figurine, q))
        self._nose.set_path(artists.nose(self._figurine, q))
        self._point.set_data(q[:1], q[1:2])
        rotations = self._space.rotations
        self._head.set_text(" at ".join(filter(None, ["C-obstacle", rotations.text(np.round(q[2:], 2))])))
        cell = int(rotations.cells_of(q))
        if cell != self._cell:
            self._cell = cell
            self._image.set_classes(self._classes(q))
        self._canvas.restore_region(self._still)
        for artist in self._moving:
            artist.draw(self._canvas.get_renderer())
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _classes(self, q: Floats) -> NDArray[np.uint8]:
        return artists.classes_of(self._space, q[2:])


def _layer(artist: Artist) -> float:
    return artist.get_zorder()


def _panels(box: Floats, labels: Sequence[str]) -> tuple[Any, tuple[Axes, Axes]]:
    """Two panels with the same axes, side by side, or one above the other where they are wide."""
    width, height = artists.drawn_size(box, _LONG)
    wide = width > 1.4 * height
    size = (width + 0.7, 2 * height + 1.5) if wide else (2 * width + 0.9, height + 1.3)
    figure = artists.new_figure(max(size[0], 4.2), size[1], _DPI)
    shape = (2, 1) if wide else (1, 2)
    panels: Any = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False)
    first, second = panels.flat
    first.set_ylabel(labels[1])
    second.set_xlabel(labels[0])
    (second.set_ylabel if wide else first.set_xlabel)(labels[int(wide)])
    return figure, (first, second)


def _palette(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Choose at most 96 of some colours, shape (n, 3), the commonest first.

    Half of them are unlike each other, so that a thin line keeps its colour beside many shades of something else.
    """
    chosen: list[int] = []
    left = np.arange(len(colors))
    while len(left) and len(chosen) < _COLORS // 2:
        chosen.append(int(left[0]))
        left = left[np.abs(colors[left].astype(np.int16) - colors[left[0]]).max(axis=1) > _ALIKE]
    others = [number for number in range(min(len(colors), 2 * _COLORS)) if number not in chosen]
    return colors[[*chosen, *others[: _COLORS - len(chosen)]]]


def _write(frames: list[NDArray[np.uint8]], file: Path, pause: int) -> None:
    """Write frames as a GIF that repeats for ever."""
    from PIL import Image

    # Without dithering, which would flicker and swell the file.
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
        duration=[pause] * (len(images) - 1) + [_REST],
        loop=0,
        optimize=False,
    )
