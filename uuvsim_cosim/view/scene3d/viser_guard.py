"""Access to viser's page: it requires the token of `uuvsim serve` and serves no other files.

viser itself serves every file that its user can read (`GET /../../etc/passwd`) to everybody who
reaches the port, and lets them change the page.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, final
from urllib.parse import parse_qs, urlsplit

from uuvsim_cosim.bridge.access.token import TokenFile, guarded_by_token
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

    _ProcessRequest = Callable[
        [ServerConnection, Request], Awaitable[Response | None] | Response | None
    ]

__all__ = ["PageGuard"]

_TOKEN_REQUIRED = (
    "this page requires a token. `uuvsim` prints an address with ?token=… on a terminal; "
    "`uuvsim access token --port {port}` prints the token to the user who serves\n"
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
                return process_request(connection, request)

            self._attached = True
            return serve(*arguments, process_request=process, **options)

        module.serve = guarded
        try:
            yield
        finally:
            module.serve = serve
        if not self._attached:
            raise InputInvalid(
                "viewing", "this viser starts its server in an unknown way", "viser 0.2.23"
            )

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
            return connection.respond(403, f"a page of {origin} asks\n")
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
