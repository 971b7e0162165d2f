"""Server of the page: viser on one port of this machine, guarded by a token."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
import time
from contextlib import redirect_stdout
from io import StringIO
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.scene3d.viser_guard import PageGuard

if TYPE_CHECKING:
    from viser import ViserServer

__all__ = ["PORT", "address", "close_server", "entry", "has_screen", "open_server"]

PORT = 8080
_guards: WeakKeyDictionary[ViserServer, PageGuard] = WeakKeyDictionary()
TRIED = 20  # ports from PORT on, if none is given


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
        loop.run_until_complete(_cancelled(asyncio.all_tasks(loop)))
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.close()


async def _cancelled(waiting: set[asyncio.Task[object]]) -> None:
    """Cancel the tasks that wait for viewers that have disconnected."""
    for task in waiting:
        task.cancel()
    await asyncio.gather(*waiting, return_exceptions=True)


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
