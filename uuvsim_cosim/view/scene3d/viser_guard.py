"""Access to viser's page: the token of `uuvsim serve`, and no file but those of the page.

viser itself serves every file that its user can read (`GET /../../etc/passwd`) to everybody who
reaches the port, and lets them change the page.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, final
from urllib.parse import parse_qs, urlsplit

from uuvsim_cosim.bridge.access.token import TokenFile, guarded_by_token
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid

__all__ = ["PageGuard"]

_ASKING = (
    "this page requires a token. `uuvsim` prints an address with ?token=… on a terminal; "
    "`uuvsim access token --port {port}` prints the token to the user who serves\n"
)


@final
class PageGuard(Closing):
    """Decides for each request of one page; its token is in a file of its port."""

    def __init__(self) -> None:
        self._keeper = guarded_by_token()
        self.token = str(self._keeper.access.token)
        self._cookie = secrets.token_urlsafe(32)  # what a browser shows in the token's place
        self._attached = False
        self._file: TokenFile | None = None

    @contextmanager
    def attached(self) -> Iterator[None]:
        """Put the guard before the server that viser starts meanwhile.

        viser has no setting for it: it names its own function to `websockets`. Raises InputInvalid
        if it starts its server in another way.
        """
        import websockets.asyncio.server as module

        serve: Any = module.serve

        def guarded(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
            def process(connection: Any, request: Any) -> Any:
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
            raise InputInvalid("viewing: this viser starts its server in an unknown way; "
                               "expected viser 0.2.23")  # fmt: skip

    def write(self, port: int) -> None:
        """Write the token's file, for `uuvsim access token --port`."""
        self._file = TokenFile(self._keeper, port)

    def close(self) -> None:
        """Remove the token's file."""
        if self._file is not None:
            self._file.close()

    def refusal(self, connection: Any, request: Any) -> Any:
        """Return the answer to a request that is not viser's to answer, else None."""
        port = connection.local_address[1]
        asked = urlsplit(request.path)
        if ".." in asked.path.split("/") or "\\" in asked.path or ":" in asked.path:
            return connection.respond(404, "not found\n")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.headers.get("Host"):
            return connection.respond(403, f"a page of {origin} asks\n")
        (shown,) = parse_qs(asked.query).get("token", [None])[:1]
        name = f"uuvsim-{port}"
        if shown is not None and _same(shown, self.token):
            answer = connection.respond(303, "")
            answer.headers["Location"] = asked.path or "/"
            answer.headers["Set-Cookie"] = f"{name}={self._cookie}; HttpOnly; SameSite=Lax; Path=/"
            answer.headers["Cache-Control"] = "no-store"
            answer.headers["Referrer-Policy"] = "no-referrer"
            return answer
        kind, _, bearer = request.headers.get("Authorization", "").partition(" ")
        if kind.lower() == "bearer" and _same(bearer.strip(), self.token):
            return None
        for pair in request.headers.get("Cookie", "").split(";"):
            key, _, value = pair.strip().partition("=")
            if key == name and _same(value, self._cookie):
                return None
        return connection.respond(401, _ASKING.format(port=port))


def _same(shown: str, wanted: str) -> bool:
    return hmac.compare_digest(shown.encode("utf-8", "replace"), wanted.encode())
