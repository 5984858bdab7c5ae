"""view: a map on a page in the browser."""

from __future__ import annotations

import html
import sys
import threading
from typing import TYPE_CHECKING, Any, Final, TypedDict

import numpy as np

from cspace.errors import ConfigurationError
from cspace.plot.route import Floats, Route
from cspace.view.cells import Cells
from cspace.view.server import serve, stop

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cspace.plot.route import HasPath
    from planners import Plan

_DRAWN: Final = 64
"""Configurations that are drawn to begin with two that are far apart."""


class ViewOptions(TypedDict, total=False):
    """What :meth:`cspace.CSpace.view` takes."""

    path: ArrayLike | HasPath
    start: ArrayLike
    goal: ArrayLike
    host: str
    port: int


class Viewer:
    """A page in the browser that shows a map; :meth:`cspace.CSpace.view` opens it.

    In a notebook it shows itself, where ``block=False``. All who open the page see, and move, the same things.

    Parameters
    ----------
    space : CSpace or TiledCSpace
    cells : Cells
        Its cells, as they are to be drawn.
    path, start, goal, host, port
        As for :meth:`cspace.CSpace.view`.
    """

    def __init__(
        self,
        space: Any,
        cells: Cells,
        *,
        path: ArrayLike | HasPath | None = None,
        start: ArrayLike | None = None,
        goal: ArrayLike | None = None,
        host: str = "127.0.0.1",
        port: int | None = None,
    ) -> None:
        from cspace.view.canvas import Canvas
        from cspace.view.page import Page

        route = Route.of(space, path, start, goal)
        ends = _ends(space, cells) | {name: space.rotations.canonical(q, name) for name, q in route.marks.items()}
        self._server = serve(host, port)
        self._closed = threading.Event()
        try:
            self.canvas = Canvas(self._server, space, cells, np.concatenate([[*ends.values()], route.points]))
            self.page = Page(self._server, space, self.canvas, ends, route.points)
        except BaseException:
            stop(self._server)
            raise

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    @property
    def plan(self) -> Plan | None:
        """What the last search found; None before there was one."""
        return self.page.plan

    def refresh(self) -> None:
        """Show the map as it is now, after it was updated."""
        self.page.refresh()

    def close(self) -> None:
        """End the page."""
        if not self._closed.is_set():
            self._closed.set()
            self.page.close()
            stop(self._server)

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


def opened(space: Any, cells: Cells, block: bool, options: ViewOptions) -> Viewer:
    """A page of a map, which is waited for if ``block`` is set."""
    viewer = Viewer(space, cells, **options)
    if block:
        sys.stdout.write(f"{viewer.url}  Ctrl-C ends it\n")
        sys.stdout.flush()
        viewer.wait()
    return viewer


def _ends(space: Any, cells: Cells) -> dict[str, Floats]:
    """Two FREE configurations far apart; of a map that has none, the middle of its grid."""
    near, upright = cells.near, space.rotations.of_matrix(np.eye(3))
    try:
        drawn = near.sample_free(_DRAWN, np.random.default_rng(0))
    except ConfigurationError:
        drawn = np.array([[*np.add(space.grid.lower, space.grid.upper) / 2, *upright]])
    stood = drawn.copy()
    stood[:, space.grid.dim :] = upright
    free = np.asarray(near.is_free(stood))
    drawn = stood[free] if free.any() else drawn
    places = drawn[:, : space.grid.dim]
    apart = np.linalg.norm(places[:, np.newaxis] - places, axis=-1)
    first, last = np.unravel_index(int(apart.argmax()), apart.shape)
    return {"start": drawn[first], "goal": drawn[last]}
