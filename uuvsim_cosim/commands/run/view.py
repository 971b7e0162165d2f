"""`uuvsim view` and `--view`: a recording or a running simulation in a browser, in 3-D."""

from __future__ import annotations

import sys
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Self

import typer

from uuvsim_cosim.commands.shared.answer import answer
from uuvsim_cosim.commands.shared.terminal import line, notice, put, tilde
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from viser import ViserServer

    from uuvsim_cosim.orchestrator.master.observer import Observer
    from uuvsim_cosim.view.recorded.traces import Traces
    from uuvsim_cosim.view.scene3d.live import LiveView
    from uuvsim_cosim.view.scene3d.motion import Motion
    from uuvsim_cosim.view.scene3d.scene import Scene3D

__all__ = ["HOST", "PORT", "Watched", "announce", "serve", "view_command"]

PORT = "Port of the page; by default the first free one from 8080 on."
HOST = "Address to listen at; 0.0.0.0: all."


def view_command(
    run: Annotated[
        Path | None,
        typer.Argument(help="Run's folder, .parquet or .mcap; by default the newest run in runs."),
    ] = None,
    port: Annotated[int | None, typer.Option(help=PORT)] = None,
    host: Annotated[str, typer.Option(help=HOST)] = "127.0.0.1",
    open_: Annotated[bool, typer.Option("--open", help="Open it in a browser.")] = False,
) -> None:
    """Replay a run in a browser: vehicles, thrusts, tracks, terrain, rays and plots.

    Ctrl-C ends it.
    """
    from uuvsim_cosim.view.scene3d.scene_of_run import newest_run, placed
    from uuvsim_cosim.view.scene3d.viser_server import close_server, open_server

    found = run if run is not None else newest_run()
    scene3d, motion, traces = placed(found)
    server = open_server(port, host, scene3d.name)
    try:
        serve(server, tilde(found), (scene3d, motion, traces), show=open_)
    finally:
        close_server(server)


def serve(
    server: ViserServer, what: str, recorded: tuple[Scene3D, Motion, Traces], *, show: bool
) -> None:
    """Serve a replay until Ctrl-C, which is its normal end."""
    from uuvsim_cosim.view.scene3d.recording_page import Replay

    scene3d, motion, traces = recorded
    replay = Replay(server, scene3d, motion, traces)
    announce(server, f"{what}, {motion.time[-1] - motion.time[0]:g} s", show=show)
    for note in scene3d.notes:
        line(f"not drawn: {note}")
    answer().write_early()
    try:
        replay.serve()
    except KeyboardInterrupt:
        line()


def announce(server: ViserServer, what: str, *, show: bool) -> None:
    """Print the address of the page, and how to reach it from a machine with a screen."""
    from uuvsim_cosim.view.scene3d.viser_server import address, entry, has_screen

    where, port = address(server), server.get_port()
    put("address", where)
    # Other users may read a log: the token is printed to a terminal only.
    is_terminal = answer().mode == "text" and sys.stdout.isatty()
    line(f"{what}: {entry(server) if is_terminal else where} in a browser; Ctrl-C ends it")
    if not is_terminal:
        line(
            "the page needs a token: add ?token= and the output of `uuvsim access token --port "
            f"{port}`"
        )
    if not has_screen():
        line(
            f"this machine has no screen; from another machine: ssh -L {port}:localhost:{port} "
            "THIS_MACHINE"
        )
    elif show:
        typer.launch(entry(server))
    sys.stdout.flush()


class Watched:
    """The page of a run, if it was `asked` for; an error there does not stop the run."""

    def __init__(self, name: str, port: int | None, asked: bool) -> None:
        self._name = name
        self._server: ViserServer | None = None
        self._live: LiveView | None = None
        self.observers: list[Observer] = []
        if not asked:
            if port is not None:
                raise InputInvalid(f"--port {port}: applies to --view", "--view")
            return
        from uuvsim_cosim.view.scene3d.live import LiveView
        from uuvsim_cosim.view.scene3d.viser_server import open_server

        self._server = open_server(port, label=name)
        self._live = LiveView(self._server, name)
        self.observers = [self._live]

    def __enter__(self) -> Self:
        """Print the address of the page."""
        if self._server is not None:
            announce(self._server, f"{self._name}, live", show=False)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        """Close the page if the run failed; otherwise the replay uses it."""
        if error is not None:
            self.close()

    def replay(self, folder: Path) -> None:
        """Replay the recording on the same page until Ctrl-C; do nothing without a page."""
        if self._server is None:
            return
        from uuvsim_cosim.view.scene3d.scene_of_run import placed

        if self._live is not None and self._live.failure is not None:
            notice(f"the live view stopped: {self._live.failure}")
        try:
            recorded = placed(folder)
            self._server.scene.reset()
            self._server.gui.reset()
            serve(self._server, "replay", recorded, show=False)
        finally:
            self.close()

    def close(self) -> None:
        """End the page; a second call does nothing."""
        from uuvsim_cosim.view.scene3d.viser_server import close_server

        server, self._server = self._server, None
        if server is not None:
            close_server(server)
