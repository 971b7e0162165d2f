"""The page's server: viser on one port of this machine, or a sentence that says why not."""

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
TRIED = 20  # ports from PORT on, where none was asked for


def open_server(port: int | None, host: str = "127.0.0.1", label: str = "uuvsim") -> ViserServer:
    """Start serving the page on a port, the first free one from 8080 on if none is given.

    The page requires a token (`entry`). Raises InputInvalid if viser is not installed, or the port
    is taken.
    """
    if port is not None and not 0 < port < 65536:
        raise InputInvalid(f"--port {port}: expected 1 to 65535")
    try:
        import viser
    except ImportError:
        raise InputInvalid(
            "viewing needs viser, which is not installed; expected the extra `view`: "
            "pip install 'uuvsim-cosim[view]'"
        ) from None
    free = _free(port, host)
    # It greets with a table of its own; the command line says where the page is.
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
    """Stop serving, and leave neither its port taken nor its event loop behind (5 s at most)."""
    if (guard := _guards.pop(server, None)) is not None:
        guard.close()
    loop: asyncio.AbstractEventLoop = server.get_event_loop()
    with redirect_stdout(StringIO()):  # it says goodbye as well
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
    """End what waits for viewers who are gone."""
    for task in waiting:
        task.cancel()
    await asyncio.gather(*waiting, return_exceptions=True)


def _free(port: int | None, host: str) -> int:
    asked = [port] if port is not None else list(range(PORT, PORT + TRIED))
    said = ""
    for each in asked:
        said = _why_taken(each, host)
        if not said:
            return each
    if port is not None:
        raise InputInvalid(
            f"--port {port} at {host}: {said}; expected a free port, or none, to take the first "
            f"free one from {PORT} on"
        )
    raise InputInvalid(
        f"ports {PORT} to {PORT + TRIED - 1} at {host}: {said}; expected --port with a free one"
    )


def _why_taken(port: int, host: str) -> str:
    """Say why a port cannot be served; nothing if it can."""
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((host, port))
        except socket.gaierror:
            raise InputInvalid(
                f"--host {host}: no address of this machine; expected 127.0.0.1, 0.0.0.0, or one"
            ) from None
        except OSError as error:
            return str(error.strerror or error)
    return ""


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
