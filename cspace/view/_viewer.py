"""A viewer of a space in the browser, and its server, which refuses pages of other sites."""

from __future__ import annotations

import errno
import html
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from ipaddress import ip_address
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from cspace.errors import InputError
from cspace.inside import ConfigurationMap, check_count, import_optional
from cspace.plot.scene import Route
from cspace.view._arm_canvas import ArmCanvas
from cspace.view._map_canvas import MapCanvas

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from viser import ViserServer

    from cspace import Space
    from cspace.plot import HasPath
    from planners import Plan


class Viewer:
    """A page in the browser that shows a map or an arm.

    :meth:`cspace.CSpace.view` opens it. Notebooks show the page if ``block=False``. All users of
    the page share its state.

    Attributes
    ----------
    server : viser.ViserServer
        The server; programs may add to its scene.
    page : cspace.view._page.Page
        The actions of the page: move the robot, set start and goal, drag a tool, plan, play.
    canvas : ArmCanvas or MapCanvas
        The drawing.
    """

    def __init__(
        self, server: ViserServer, space: Space, canvas: ArmCanvas | MapCanvas, route: Route
    ) -> None:
        """Open the page on a server."""
        from cspace.view._page import Page

        self.server = server
        self.canvas = canvas
        self.page = Page(server, space, canvas, route.points, route.plan)
        self._closed = threading.Event()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    @property
    def plan(self) -> Plan | None:
        """Result of the page's last search, or None."""
        return self.page.plan

    def refresh(self) -> None:
        """Redraw the space after an update."""
        self.page.refresh()

    def close(self) -> None:
        """Close the page."""
        if not self._closed.is_set():
            self._closed.set()
            self.page.close()
            stop(self.server)

    def __enter__(self) -> Viewer:
        """Return the viewer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the page."""
        self.close()

    def __repr__(self) -> str:
        """Return the address and whether the page is closed."""
        state = ", closed" if self._closed.is_set() else ""
        return f"Viewer({self.url}{state})"

    def _repr_html_(self) -> str:
        """Return a frame with the page, for notebooks."""
        if self._closed.is_set():
            return html.escape(repr(self))
        look = 'width="100%" height="640" style="border:0"'
        return f'<iframe src="{html.escape(self.url)}" {look}></iframe>'


def view(
    space: Space,
    *,
    block: bool = True,
    path: ArrayLike | HasPath | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    frame: str | None = None,
    host: str = "127.0.0.1",
    port: int | None = None,
) -> Viewer:
    """Show the space on a page in the browser, and plan there.

    Needs the extra ``view``. The page shows the obstacles, the robot, and the
    border of a map's C-obstacle or the closest pair of an arm. On it one sets start and goal,
    or drags an arm's tool to a pose, plans and plays paths, and reads what is proven. It is
    served on this machine alone, unless ``host`` says otherwise.

    Parameters
    ----------
    block : bool
        Print the address and wait for Ctrl-C. Otherwise :meth:`cspace.view.Viewer.close` ends
        the page.
    path : array-like, shape (n, size), or Plan, optional
        A path to show. Trajectories, and plans of arms, are played at true speed.
    start, goal : array-like, shape (size,), optional
        Initial start and goal; by default the endpoints of the path, or FREE configurations far
        apart. An arm with a start alone has no goal until one is set on the page.
    frame : str, optional
        Frame of an arm that users drag, such as ``"tool0"``; by default the frame that the most
        joints move.
    host : str
        Address to serve on. Whoever can reach it can plan on the page and move it.
    port : int, optional
        Default: the first free port from 8080 on.

    Returns
    -------
    cspace.view.Viewer
        The page, with its ``url``, its ``plan``, ``refresh()`` for a map that was updated, and
        ``close()``.

    Raises
    ------
    InputError
        If the path or a configuration has the wrong shape, no joint moves the frame, the port
        is taken, or this machine lacks the address.
    MissingPackageError
        If viser is not installed.
    """
    is_map = isinstance(space, ConfigurationMap)
    if is_map and frame is not None:
        raise InputError("frame", f"is {frame!r}", "a map has no frames")
    route = Route(space, path, start, goal)
    shown = route.points, route.endpoints
    server = serve(host, port)
    try:
        canvas: ArmCanvas | MapCanvas
        if is_map:
            canvas = MapCanvas(space, server, *shown)
        else:
            canvas = ArmCanvas(space, server, *shown, frame)
        viewer = Viewer(server, space, canvas, route)
    except BaseException:
        stop(server)
        raise
    if block:
        print(f"{viewer.url}  Ctrl-C closes it", flush=True)  # noqa: T201
        with viewer, suppress(KeyboardInterrupt):
            viewer._closed.wait()
    return viewer


def serve(host: str, port: int | None) -> ViserServer:
    """Start a server that prints nothing and refuses pages of other sites.

    Browsers let pages of any site connect to servers on the user's machine. They name the site, but
    viser does not check it.

    Raises InputError if this machine lacks the address, or if the port is taken or invalid;
    MissingPackageError if viser is not installed.
    """
    viser = import_optional("viser", "it serves the page in the browser", "view")
    from websockets.exceptions import ConnectionClosed

    free_port = _find_free_port(host, port)
    with _silence_viser():
        server: ViserServer = viser.ViserServer(host, free_port, label="cspace", verbose=False)
    sockets = server._websock_server

    async def admit(client: Any) -> None:
        """Close the connection of a client if another site's page opened it."""
        connection: Any = sockets._live_connections[client.client_id]
        headers = connection.request.headers
        if not is_same_site(headers.get("Origin"), headers.get("Host", ""), host):
            # WebSocket status that closes the connection of another site's page (RFC 6455).
            await connection.close(1008, "the page is of another site")
            with suppress(ConnectionClosed):
                while True:  # discard what it sent meanwhile
                    await connection.recv()

    sockets.on_client_connect(admit)
    sockets.disconnect_all_clients()  # clients that connected before the check connect again
    return server


def stop(server: ViserServer) -> None:
    """Stop a server without messages."""
    with _silence_viser():
        server.stop()


@contextmanager
def _silence_viser() -> Iterator[None]:
    """Silence viser, which prints through rich's console."""
    import rich

    console = rich.get_console()
    before = console.quiet
    console.quiet = True
    try:
        yield
    finally:
        console.quiet = before


def is_same_site(origin: str | None, host_header: str, host: str) -> bool:
    """Return True if this server made a browser's page.

    ``origin`` is the site of the page, as named by the browser; other programs send None.
    ``host_header`` is the name and port in the request, and ``host`` the address of the server. A
    server at a loopback address accepts only loopback names, because a foreign name can temporarily
    resolve to that address (DNS rebinding).
    """
    if origin is None:
        return True
    page = urlsplit(origin)
    server = urlsplit(f"//{host_header}")
    if page.netloc != server.netloc:
        return False
    return is_local(server.hostname) or not is_local(host)


def is_local(host: str | None) -> bool:
    """Return True for a loopback address, unreachable from other machines."""
    if host == "localhost":
        return True
    try:
        return ip_address(host or "").is_loopback
    except ValueError:  # any other name may resolve to any address
        return False


def _find_free_port(host: str, port: int | None) -> int:
    """Return the given port if it is free; any for 0.

    For None, return the default port, from which viser searches for a free one. Raises InputError
    if this machine lacks the address, or if the port is taken or invalid.
    """
    tried_port = 0
    if port is not None:
        tried_port = check_count(port, "port", 0, 2**16 - 1)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # Opening a server for a moment shows whether the port is free.
    try:
        with socket.create_server((host, tried_port), family=family) as trial:
            # Default port; viser takes the next free one.
            return 8080 if port is None else int(trial.getsockname()[1])
    except OSError as error:
        if error.errno in (errno.EADDRINUSE, errno.EACCES):
            raise InputError(
                "port",
                f"is {port}",
                "other programs use it",
            ) from error
        raise InputError(
            "host",
            f"is {host!r}",
            "it must be an address of this machine",
        ) from error
