"""Server of the page: viser on one port of this machine; it requires the token of `uuvsim serve`.

viser itself serves every file that its user can read (`GET /../../etc/passwd`) to everybody who
reaches the port, and lets them change the page.
"""

from __future__ import annotations

import asyncio
import hmac
import os
import secrets
import socket
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from typing import TYPE_CHECKING, Any, final
from urllib.parse import parse_qs, urlsplit
from weakref import WeakKeyDictionary

from uuvsim_cosim.bridge.access.token import TokenFile, guarded_by_token
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from viser import ViserServer
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

    _ProcessRequest = Callable[
        [ServerConnection, Request], Awaitable[Response | None] | Response | None
    ]

__all__ = ["PORT", "PageGuard", "address", "close_server", "entry", "has_screen", "open_server"]

PORT = 8080
TRIED = 20  # ports from PORT on, if none is given
_POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self' ws://{host} wss://{host} data: blob:"
)
_TOKEN_REQUIRED = (
    "this page requires a token. `uuvsim` prints an address with ?token=… on a terminal; "
    "`uuvsim access token --port {port}` prints the token for the server's user\n"
)


@final
class PageGuard(Closing):
    """Accepts or refuses each request to one page; its token is in the file of its port."""

    def __init__(self) -> None:
        self._authorisation = guarded_by_token()
        self.token = str(self._authorisation.access.token)
        self._cookie = secrets.token_urlsafe(32)  # a browser sends it instead of the token
        self._attached = False
        self._file: TokenFile | None = None

    @contextmanager
    def attached(self) -> Iterator[None]:
        """Guard the server that viser starts inside this `with`.

        viser has no option for it, so `websockets.asyncio.server.serve` is replaced meanwhile.
        Raises InputInvalid if viser starts its server in another way.
        """
        import websockets.asyncio.server as module
        from websockets.http11 import Response

        serve: Any = module.serve

        def guarded(
            *arguments: Any, process_request: _ProcessRequest | None = None, **options: Any
        ) -> Any:
            def process(
                connection: ServerConnection, request: Request
            ) -> Awaitable[Response | None] | Response | None:
                refused = self.refusal(connection, request)
                if refused is not None or process_request is None:
                    return refused
                answer = process_request(connection, request)
                if isinstance(answer, Response):
                    # viser's page asks another host for a script; a browser then does not send it.
                    answer.headers["Content-Security-Policy"] = _POLICY.format(
                        host=request.headers.get("Host", "")
                    )
                return answer

            self._attached = True
            return serve(*arguments, process_request=process, **options)

        module.serve = guarded
        try:
            yield
        finally:
            module.serve = serve
        if not self._attached:
            raise InputInvalid("viewing", "this version of viser is not supported", "viser 0.2.23")

    def write(self, port: int) -> None:
        """Write the token's file, for `uuvsim access token --port`."""
        self._file = TokenFile(self._authorisation, port)

    def close(self) -> None:
        """Remove the token's file."""
        if self._file is not None:
            self._file.close()

    def refusal(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the answer to a request that viser must not answer, else None."""
        port = connection.local_address[1]
        url = urlsplit(request.path)
        if ".." in url.path.split("/") or "\\" in url.path or ":" in url.path:
            return connection.respond(404, "not found\n")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.headers.get("Host"):
            return connection.respond(403, f"the request is from a page of {origin}\n")
        (token,) = parse_qs(url.query).get("token", [None])[:1]
        name = f"uuvsim-{port}"
        if token is not None and _same(token, self.token):
            answer = connection.respond(303, "")
            answer.headers["Location"] = url.path or "/"
            answer.headers["Set-Cookie"] = f"{name}={self._cookie}; HttpOnly; SameSite=Lax; Path=/"
            answer.headers["Cache-Control"] = "no-store"
            answer.headers["Referrer-Policy"] = "no-referrer"
            return answer
        scheme, _, bearer = request.headers.get("Authorization", "").partition(" ")
        if scheme.lower() == "bearer" and _same(bearer.strip(), self.token):
            return None
        for pair in request.headers.get("Cookie", "").split(";"):
            key, _, value = pair.strip().partition("=")
            if key == name and _same(value, self._cookie):
                return None
        return connection.respond(401, _TOKEN_REQUIRED.format(port=port))


def _same(given: str, expected: str) -> bool:
    # Takes the same time wherever the two differ, so that nothing of the token can be measured.
    return hmac.compare_digest(given.encode("utf-8", "replace"), expected.encode())


_guards: WeakKeyDictionary[ViserServer, PageGuard] = WeakKeyDictionary()


def open_server(port: int | None, host: str = "127.0.0.1", label: str = "uuvsim") -> ViserServer:
    """Start serving the page on a port, the first free one from 8080 on if none is given.

    The page requires a token (`entry`). Raises InputInvalid if viser is not installed, or the port
    is in use.
    """
    if port is not None and not 0 < port < 65536:
        raise InputInvalid(f"--port {port}: expected 1 to 65535")
    try:
        import viser
    except ImportError:
        raise InputInvalid(
            "viewing needs viser, which is not installed",
            "the extra `view`: pip install 'uuvsim-cosim[view]'",
        ) from None
    free = _free(port, host)
    # viser prints a table when it starts; the command line prints the address instead.
    guard = PageGuard()
    with redirect_stdout(StringIO()), guard.attached():
        server = viser.ViserServer(host=host, port=free, label=label, verbose=False)
    _guards[server] = guard
    try:
        guard.write(server.get_port())
    except BaseException:
        close_server(server)
        raise
    return server


def close_server(server: ViserServer) -> None:
    """Stop serving, free the port, and close the event loop; it takes at most 5 s."""
    if (guard := _guards.pop(server, None)) is not None:
        guard.close()
    loop: asyncio.AbstractEventLoop = server.get_event_loop()
    with redirect_stdout(StringIO()):  # viser prints a message when it stops
        server.stop()
        for _ in range(250):
            if not loop.is_running():
                break
            time.sleep(0.02)
        else:
            return
        waiting = asyncio.all_tasks(loop)
        for task in waiting:  # of viewers that have disconnected
            task.cancel()
        if waiting:
            loop.run_until_complete(asyncio.wait(waiting))
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.close()


def _free(port: int | None, host: str) -> int:
    """Return the port if it can be served, or the first one from PORT on if none is given."""
    reason = ""
    for candidate in [port] if port is not None else range(PORT, PORT + TRIED):
        with socket.socket() as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                trial.bind((host, candidate))
            except socket.gaierror:
                raise InputInvalid(
                    f"--host {host}: no address of this machine", "127.0.0.1, 0.0.0.0, or one"
                ) from None
            except OSError as error:
                reason = str(error.strerror or error)
            else:
                return candidate
    if port is not None:
        raise InputInvalid(
            f"--port {port} at {host}: {reason}",
            f"a free port, or none, to take the first free one from {PORT} on",
        )
    raise InputInvalid(
        f"ports {PORT} to {PORT + TRIED - 1} at {host}", reason, "--port with a free one"
    )


def address(server: ViserServer) -> str:
    """Return the page's address, for a browser on this machine."""
    host = server.get_host()
    shown = "localhost" if host in ("0.0.0.0", "127.0.0.1") else host
    return f"http://{shown}:{server.get_port()}"


def entry(server: ViserServer) -> str:
    """Return the page's address with its token, which a browser exchanges for a cookie."""
    return f"{address(server)}/?token={_guards[server].token}"


def has_screen() -> bool:
    """Return whether a browser can be opened here."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
