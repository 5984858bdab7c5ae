"""view: a space on a page in the browser."""

from __future__ import annotations

import html
import sys
import threading
from collections.abc import Callable
from functools import partial, singledispatch
from typing import TYPE_CHECKING, Any, TypedDict

from cspace.arms.space import ArmSpace
from cspace.arrays import Floats
from cspace.plot.route import HasAxes, marked, polyline
from cspace.tiles.space import TiledCSpace
from cspace.view.arm_canvas import ArmCanvas
from cspace.view.level_of_detail import CellsInMemory, CellsInStore
from cspace.view.map_canvas import MapCanvas
from cspace.view.server import serve, stop

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from viser import ViserServer

    from cspace.plot.route import HasPath
    from cspace.view.canvas import Canvas
    from cspace.view.planning import PlanLike

    MakeCanvas = Callable[[ViserServer, Floats, dict[str, Floats]], Canvas]


class ViewOptions(TypedDict, total=False):
    """What :meth:`cspace.CSpace.view` takes."""

    path: ArrayLike | HasPath
    start: ArrayLike
    goal: ArrayLike
    host: str
    port: int


class Viewer:
    """A page in the browser that shows a map, or an arm; :meth:`cspace.CSpace.view` opens it.

    In a notebook it shows itself, where ``block=False``. All who open the page see, and move, the same things.

    Parameters
    ----------
    space : ConfigurationSpace
    canvas : callable
        What draws it: is given a server, a path, shape (n, dof), and the start and the goal that there are.
    path, start, goal, host, port
        As for :meth:`cspace.CSpace.view`.

    Attributes
    ----------
    server : viser.ViserServer
        What serves it; a program may add to its scene.
    page : cspace.view.page.Page
        What people do there, for programs: it moves the robot, sets the start and the goal, plans and plays.
    canvas : cspace.view.canvas.Canvas
        What is drawn.
    """

    def __init__(
        self,
        space: HasAxes,
        canvas: MakeCanvas,
        *,
        path: ArrayLike | HasPath | None = None,
        start: ArrayLike | None = None,
        goal: ArrayLike | None = None,
        host: str = "127.0.0.1",
        port: int | None = None,
    ) -> None:
        from cspace.view.page import Page

        points = polyline(space, path)
        marks = marked(space, path, points, start, goal)
        self.server = serve(host, port)
        self._closed = threading.Event()
        try:
            self.canvas = canvas(self.server, points, marks)
            self.page = Page(self.server, space, self.canvas, points)
        except BaseException:
            stop(self.server)
            raise

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    @property
    def plan(self) -> PlanLike | None:
        """What the last search found, a :class:`planners.Plan`; None before there was one."""
        return self.page.plan

    def refresh(self) -> None:
        """Show the space as it is now, after it was updated."""
        self.page.refresh()

    def close(self) -> None:
        """End the page."""
        if not self._closed.is_set():
            self._closed.set()
            self.page.close()
            stop(self.server)

    def wait(self) -> None:
        """Wait until the page is closed, or Ctrl-C is pressed, which closes it."""
        try:
            self._closed.wait()
        except KeyboardInterrupt:
            pass
        finally:
            self.close()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Viewer({self.url}{', closed' if self._closed.is_set() else ''})"

    def _repr_html_(self) -> str:
        """The page itself, for notebooks."""
        if self._closed.is_set():
            return html.escape(repr(self))
        return f'<iframe src="{html.escape(self.url)}" width="100%" height="640" style="border:0"></iframe>'


@singledispatch
def canvas_of(space: Any) -> MakeCanvas:
    """Return what draws a space on a page: a map in memory, unless another kind is registered."""
    return partial(MapCanvas, space, CellsInMemory(space))


@canvas_of.register(TiledCSpace)
def _(space: TiledCSpace) -> MakeCanvas:
    return partial(MapCanvas, space, CellsInStore(space))


@canvas_of.register(ArmSpace)
def _(space: ArmSpace) -> MakeCanvas:
    return partial(ArmCanvas, space)


def opened(space: Any, block: bool, options: ViewOptions) -> Viewer:
    """Open a page of a space; wait until it is closed if ``block`` is set."""
    viewer = Viewer(space, canvas_of(space), **options)
    if block:
        sys.stdout.write(f"{viewer.url}  Ctrl-C ends it\n")
        sys.stdout.flush()
        viewer.wait()
    return viewer
