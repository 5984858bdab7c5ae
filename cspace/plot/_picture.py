"""plot: a picture of a map, with a path and robots."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict, Unpack

from cspace import CSpace, Workspace
from cspace.errors import InputError
from cspace.inside import ConfigurationMap, check_positive, check_suffix, names_options, replacing
from cspace.plot import _artists as artists
from cspace.plot._sections import draw_plane, draw_sections
from cspace.plot._surface import draw_surface
from cspace.plot.scene import HasPath, WorkspaceView, make_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike


PICTURE_SUFFIXES: Final = (".png", ".pdf", ".svg", ".jpg")
"""Suffixes of the picture formats that can be written."""
VIEWS: Final[dict[int, tuple[str, ...]]] = {2: ("plane",), 3: ("sections", "3d")}
"""Kinds of picture of a map, by its dimension."""
VIEW_OPTIONS: Final = {
    "camera": ("3d",),
    "ax": ("plane", "3d"),
    "center": ("sections",),
}
"""Kinds of picture that take an option, if not all do."""


class PlotOptions(TypedDict, total=False):
    """Options of :meth:`cspace.CSpace.plot`."""

    rotation: ArrayLike
    path: ArrayLike | HasPath | None
    start: ArrayLike
    goal: ArrayLike
    ax: Axes
    legend: bool
    title: str
    view: str
    center: ArrayLike
    camera: ArrayLike


def plot(
    space: ConfigurationMap | Workspace,
    *,
    rotation: ArrayLike | None = None,
    path: ArrayLike | HasPath | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    ax: Axes | None = None,
    legend: bool = True,
    title: str | None = None,
    view: str | None = None,
    center: ArrayLike | None = None,
    camera: ArrayLike | None = None,
) -> Axes:
    """Draw a map, and optionally a path with the robot along it.

    A block of cells smaller than a pixel shows the most important one, so no obstacle vanishes from
    a picture of a large map. The exterior of the grid is hatched.

    - ``"plane"``: a plane map from above.
    - ``"sections"``: a map in space as three sections through a point, seen from above, the front
      and the right. The path is solid, and the robot drawn, where the robot reaches the section;
      elsewhere the path is faint.
    - ``"3d"``: a map in space in three dimensions, cut open above the path, which is drawn over
      everything.

    Parameters
    ----------
    space : CSpace, TiledCSpace or Workspace
        The map. Of a tiled map, an overview is drawn.
    rotation : array-like, shape (k,), optional
        Rotation of the slice to show, as in a configuration (yaw in radians, or quaternion). By
        default, colours show where the robot is free at every rotation, at some, and at none.
    path : array-like, shape (n, size), or Plan, optional
        Configurations joined by straight edges, metres and radians; or an object with a ``path``
        attribute. A certified plan that is no longer proven free, e.g. after
        :meth:`cspace.CSpace.add_obstacle`, is dashed in another colour.
    start, goal : array-like, shape (size,), optional
        Configurations to mark; by default the endpoints of the path.
    ax : matplotlib.axes.Axes, optional
        Axes to draw into; by default of a new figure without a window. ``view="3d"`` needs axes in
        three dimensions; sections always have a new figure.
    legend : bool
        Add a legend beside or below the axes.
    title : str, optional
        Default: the robot, the side of a cell and the rotation. Pass ``""`` for no title.
    view : {"plane", "sections", "3d"}, optional
        Kind of picture; by default ``"plane"`` or ``"sections"``.
    center : array-like, shape (d,), optional
        The intersection of sections, a point of the grid, metres. Default: half the way along the
        path; without a path the start, the goal, or the center of the grid.
    camera : array-like, shape (2,), optional
        For ``view="3d"``: elevation and azimuth of the camera, degrees, as in matplotlib. Faces
        that look away from the camera are not drawn, so choose it here instead of rotating the axes
        later.

    Returns
    -------
    matplotlib.axes.Axes
        Notebooks show the axes as the picture; ``ax.figure`` is the figure. For sections, the axes
        seen from above, and ``ax.figure.axes`` are those across z, y and x.

    Raises
    ------
    InputError
        If the space is no map, the path or a configuration has the wrong shape or is not finite,
        the map has no rotations but one is given, an option does not fit the kind of picture, or
        ``ax`` is not a matplotlib axes.
    """
    artists.check_axes(ax)
    given: object = space
    if not isinstance(given, ConfigurationMap | Workspace):
        rule = "it must be a map or a workspace; the axes of other pictures have a figure to save"
        raise InputError("space", f"is a {type(given).__name__}", rule)
    # A workspace is drawn as a map without a robot, a tiled map as an overview.
    drawn_map: Any = space
    if isinstance(space, Workspace):
        drawn_map = WorkspaceView(space)
    elif isinstance(space, ConfigurationMap) and not isinstance(space, CSpace):
        drawn_map = drawn_map.overview()
    options: dict[str, Any] = {"camera": camera, "ax": ax, "center": center}
    kind = _choose_view(drawn_map, view, options)
    scene = make_scene(
        drawn_map,
        rotation=rotation,
        path=path,
        start=start,
        goal=goal,
        center=center,
    )
    if kind == "plane":
        axes, handles = draw_plane(scene, ax)
    elif kind == "sections":
        axes, handles = draw_sections(scene)
    else:
        painting = draw_surface(scene, ax, camera)
        painting.show()
        axes = painting.axes
        handles = list(painting.handles.values())
    rotation_text = scene.body.describe_rotation(scene.rotation)
    heading = "\n".join(filter(None, [make_title(drawn_map), rotation_text]))
    artists.annotate(axes, ax is None, title, heading, handles if legend else [])
    return axes


def make_title(space: CSpace) -> str:
    """Return the default title: the robot and the side of a cell."""
    return f"{space.robot.name}, cells of {space.grid.spacing:g} {space.grid.unit}"


def _choose_view(space: CSpace, view: str | None, options: Mapping[str, Any]) -> str:
    """Choose the kind of picture, and check the options for it.

    Raises InputError if the map has no such view, or if an option other than None does not fit the
    view.
    """
    views = VIEWS[space.grid.dim]
    kind = views[0] if view is None else view
    if not isinstance(kind, str) or kind not in views:
        axes = ", ".join(space.axes)
        raise InputError(
            "view",
            f"is {view!r}",
            f"it must be {' or '.join(views)}, because configurations are ({axes})",
        )
    for name, value in options.items():
        kinds = VIEW_OPTIONS[name]
        if value is not None and kind not in kinds:
            raise InputError(
                name,
                f"is given with view {kind}",
                f"it needs view {' or '.join(kinds)}",
            )
    return kind


@names_options
def save_plot(
    space: ConfigurationMap,
    file: str | os.PathLike[str],
    overwrite: bool = False,
    *,
    dpi: float = 150.0,
    **options: Unpack[PlotOptions],
) -> Path:
    """Save a picture of a map.

    Parameters
    ----------
    space : CSpace or TiledCSpace
        The map.
    file : path-like
        A name that ends in .png, .pdf, .svg or .jpg.
    overwrite : bool
        Replace an existing file.
    dpi : float
        Pixels per inch, at most 2400; pictures are about eight inches wide.
    **options
        Options of :meth:`cspace.CSpace.plot`; with ``ax``, the figure of these axes is saved.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    InputError
        If the suffix is another one, or for the reasons of :meth:`cspace.CSpace.plot`.
    FileError
        If the file exists and ``overwrite`` is not set, or if it cannot be written.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
    >>> save_plot(space, "map.png", overwrite=True).name
    'map.png'
    """
    return save_figure(lambda: plot(space, **options).figure, file, overwrite=overwrite, dpi=dpi)


@names_options
def save_figure(
    draw: Callable[[], Any], file: str | os.PathLike[str], *, overwrite: bool, dpi: float
) -> Path:
    """Check arguments, then save the figure of ``draw``.

    Raises InputError if the suffix is not in ``PICTURE_SUFFIXES``, or if ``dpi`` is not above
    zero or too large; FileError if the file exists and ``overwrite`` is not set, or if it cannot be
    written.
    """
    check_suffix(file, PICTURE_SUFFIXES, "the suffix says what to write", "file", is_output=True)
    target = Path(file)
    dots = check_positive(dpi, "dpi", "pixels per inch")
    # Letters have pixels, and pictures of eight inches some 20,000 across.
    if not 10.0 <= dots <= 2400.0:
        rule = "it must be from 10 to 2,400 pixels per inch"
        raise InputError("dpi", f"is {dpi!r}", rule)
    with replacing(target, overwrite) as temporary:
        figure: Figure = draw()
        figure.canvas.print_figure(temporary, dpi=dots)
    return target
