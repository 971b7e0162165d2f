"""`--view`: live view of a run in a browser, and its replay afterwards."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from uuvsim_cosim.commands.run.view import announce, serve
from uuvsim_cosim.commands.shared.terminal import notice
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from viser import ViserServer

    from uuvsim_cosim.orchestrator.master.observer import Observer
    from uuvsim_cosim.view.scene3d.live import LiveView

__all__ = ["Watched"]


class Watched:
    """The page of a run, if it was `asked` for; an error there does not stop the run."""

    def __init__(self, name: str, port: int | None, asked: bool) -> None:
        self._name = name
        self._server: ViserServer | None = None
        self._live: LiveView | None = None
        self.observers: list[Observer] = []
        if not asked:
            if port is not None:
                raise InputInvalid(f"--port {port}: is where --view shows it", "--view")
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
