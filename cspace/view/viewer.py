"""A space on a page in the browser, and the server of the page, which answers no page but its own."""

from __future__ import annotations

import errno
import html
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial, singledispatch
from ipaddress import ip_address
from typing import TYPE_CHECKING, Any, Final, TypedDict
from urllib.parse import urlsplit

from cspace.arms.space import ArmSpace
from cspace.arrays import Floats
from cspace.check import whole
from cspace.errors import InputError, optional
from cspace.plot.route import HasAxes, marked, polyline
from cspace.tiles.space import TiledCSpace
from cspace.view.arm_canvas import ArmCanvas
from cspace.view.level_of_detail import CellsInMemory, CellsInStore
from cspace.view.map_canvas import MapCanvas

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from viser import ViserServer

    from cspace.plot.route import HasPath
    from cspace.view.canvas import Canvas
    from planners import Plan

    MakeCanvas = Callable[[ViserServer, Floats, dict[str, Floats]], Canvas]


PORT: Final = 8080
"""The first port that is tried where none is given."""
_TRIED: Final = 100
_TAKEN: Final = (errno.EADDRINUSE, errno.EACCES)
_FOREIGN: Final = 1008
"""Status with which the connection of a foreign page is closed (RFC 6455: policy violation)."""


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
        What draws it: is given a server, a path, shape (n, size), and the start and the goal that there are.
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
    def plan(self) -> Plan | None:
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


def open_viewer(space: Any, block: bool, options: ViewOptions) -> Viewer:
    """Open a page of a space; wait until it is closed if ``block`` is set."""
    viewer = Viewer(space, canvas_of(space), **options)
    if block:
        sys.stdout.write(f"{viewer.url}  Ctrl-C ends it\n")
        sys.stdout.flush()
        viewer.wait()
    return viewer


def serve(host: str, port: int | None) -> ViserServer:
    """Start a server without a page, which prints nothing and refuses pages of other sites.

    Browsers let any page of any site talk to servers on the user's machine, and name the site; viser does not check.

    Raises InputError if the host is none of this machine, or the port is taken, or no port, and MissingPackageError if
    viser is not installed.
    """
    viser = optional("viser", "it serves the page in the browser", "view")
    from websockets.exceptions import ConnectionClosed

    with _quiet():
        server: ViserServer = viser.ViserServer(host, _free_port(host, port), label="cspace", verbose=False)
    sockets = server._websock_server

    async def admit(client: Any) -> None:
        connection: Any = sockets._live_connections[client.client_id]
        headers = connection.request.headers
        if not is_own(headers.get("Origin"), headers.get("Host", ""), host):
            await connection.close(_FOREIGN, "the page is from elsewhere")
            with suppress(ConnectionClosed):
                while True:  # what it sent meanwhile is not heeded
                    await connection.recv()

    sockets.on_client_connect(admit)
    sockets.disconnect_all_clients()  # who came before that comes again
    return server


def stop(server: ViserServer) -> None:
    """End a server."""
    with _quiet():
        server.stop()


@contextmanager
def _quiet() -> Iterator[None]:
    """Have viser print nothing, which it does through rich's console."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def is_own(origin: str | None, asked: str, host: str) -> bool:
    """Return True if a browser's page comes from this server.

    ``origin`` is the site of the page as the browser names it; other programs name none. ``asked`` is the name and port
    by which the server was asked, and ``host`` its address. A server at a loopback address accepts only loopback names,
    because a foreign name may be given that address for a while (DNS rebinding).
    """
    if origin is None:
        return True
    page, server = urlsplit(origin), urlsplit(f"//{asked}")
    return page.netloc == server.netloc and (is_local(server.hostname) or not is_local(host))


def is_local(host: str | None) -> bool:
    """Return True if other machines cannot reach a host."""
    if host == "localhost":
        return True
    try:
        return ip_address(host or "").is_loopback
    except ValueError:
        return False


def _free_port(host: str, port: int | None) -> int:
    """Return the given port, or the first free one from :data:`PORT` on.

    Raises InputError if the host is none of this machine, or the port is taken, or no port.
    """
    free = "pass 0 for any free one, or leave it out"
    wanted = range(PORT, PORT + _TRIED) if port is None else [whole(port, "port", 0, 2**16 - 1, free)]
    addresses = 'pass "127.0.0.1", or "0.0.0.0" for all of its addresses'
    no_host = InputError("host", f"is {host!r}", "it must be an address of this machine", addresses, value=host)
    try:
        kind, _, _, _, _ = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise no_host from error
    for number in wanted:
        with socket.socket(kind, socket.SOCK_STREAM) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                trial.bind((host, number))
            except PermissionError as error:
                raise InputError(
                    "port", f"is {number}", "this user may not serve on it", "choose one from 1024 on", value=port
                ) from error
            except OSError as error:
                if error.errno not in _TAKEN:
                    raise no_host from error
                continue
            return int(trial.getsockname()[1])
    taken = f"{port} is taken" if port is not None else f"from {PORT} to {PORT + _TRIED - 1} are taken"
    raise InputError("port", taken, "another program serves there", "choose another, or 0 for any", value=port)
