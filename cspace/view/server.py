"""The server of a page: an address that is free, and browsers that opened the page there."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from ipaddress import ip_address
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from cspace.check import whole
from cspace.errors import InputError, optional

if TYPE_CHECKING:
    from viser import ViserServer

PORT: Final = 8080
"""The first port that is tried where none is given."""
_TRIED: Final = 100
_TAKEN: Final = (errno.EADDRINUSE, errno.EACCES)
_FOREIGN: Final = 1008
"""Status with which the connection of a foreign page is closed (RFC 6455: policy violation)."""


def serve(host: str, port: int | None) -> ViserServer:
    """A server that has no page yet. It prints nothing, and answers no page but its own.

    Browsers let every page that somebody looks at, from wherever, talk to servers on their own machine, and say which
    page it is; viser does not look.

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
    """Whether a browser's page is the server's own.

    ``origin`` is where the page is from, as browsers say; other programs say nothing. ``asked`` is the name and port by
    which the server was asked, and ``host`` where it serves. At an address of this machine alone it goes by no other
    name, or a name that is given that address for a while would do (DNS rebinding).
    """
    if origin is None:
        return True
    page, server = urlsplit(origin), urlsplit(f"//{asked}")
    return page.netloc == server.netloc and (is_local(server.hostname) or not is_local(host))


def is_local(host: str | None) -> bool:
    """Whether a host is an address that other machines cannot reach."""
    if host == "localhost":
        return True
    try:
        return ip_address(host or "").is_loopback
    except ValueError:
        return False


def _free_port(host: str, port: int | None) -> int:
    """The port to serve on: the one given, or the first free one from :data:`PORT` on.

    Raises InputError if the host is none of this machine, or the port is taken, or no port.
    """
    free = "pass 0 for any free one, or leave it out"
    wanted = range(PORT, PORT + _TRIED) if port is None else [whole(port, "port", 0, 2**16 - 1, free)]
    try:
        kind, _, _, _, _ = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise _no_host(host) from error
    for number in wanted:
        with socket.socket(kind, socket.SOCK_STREAM) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                trial.bind((host, number))
            except PermissionError as error:
                mend = "choose one from 1024 on"
                raise InputError("port", f"is {number}", "this user may not serve on it", mend, value=port) from error
            except OSError as error:
                if error.errno not in _TAKEN:
                    raise _no_host(host) from error
                continue
            return int(trial.getsockname()[1])
    fault = f"{port} is taken" if port is not None else f"from {PORT} to {PORT + _TRIED - 1} are taken"
    raise InputError("port", fault, "another program serves there", "choose another, or 0 for any", value=port)


def _no_host(host: str) -> InputError:
    rule, mend = "it must be an address of this machine", 'pass "127.0.0.1", or "0.0.0.0" for all of its addresses'
    return InputError("host", f"is {host!r}", rule, mend, value=host)
