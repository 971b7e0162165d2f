"""Live view of a run: an observer keeps rows, another thread draws the newest."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.orchestrator.master.observer import Chunk, Column, seconds
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.view.recorded.traces import Traces, joined
from uuvsim_cosim.view.scene3d.motion import LEAST, REACH, extent, motion_of
from uuvsim_cosim.view.scene3d.scene_of_plan import scene3d_of_plan
from uuvsim_cosim.view.scene3d.viser_panel import Panel, plotted
from uuvsim_cosim.view.scene3d.viser_scene import ViserScene

if TYPE_CHECKING:
    from viser import ViserServer

__all__ = ["History", "LiveView"]

Array = NDArray[np.float64]
FRAMES = 20.0  # Hz
SLOW = 1.0  # Hz, of tracks and plots
KEPT = 2000  # rows; if there are more, every other one is dropped


class History:
    """Rows (time and columns) of a whole run, thinned so that their number stays limited."""

    def __init__(self, most: int = KEPT) -> None:
        self._most = most
        self._rows: list[tuple[float, Array]] = []
        self._gap = 0.0  # s, least between two that are kept

    def add(self, t: float, row: Array) -> None:
        """Keep a row, which the caller must not change later; the newest is always kept."""
        rows = self._rows
        if rows and t < rows[-1][0]:
            rows.clear()  # time went back: the run was reset
            self._gap = 0.0
        if len(rows) > 1 and rows[-1][0] - rows[-2][0] < self._gap:
            rows[-1] = (t, row)
        else:
            rows.append((t, row))
        if len(rows) > self._most:
            del rows[1:-1:2]
            self._gap = 2.0 * (rows[-1][0] - rows[0][0]) / self._most

    def traces(
        self, names: Sequence[str], units: Mapping[str, tuple[str, ...]], *, last: bool = False
    ) -> Traces:
        """Return the kept rows, or the last one only; `units` are those of elements."""
        rows = self._rows[-1:] if last else list(self._rows)
        time_ = np.array([t for t, _ in rows])
        table = np.array([r for _, r in rows]).reshape(len(rows), len(names))
        values = joined(dict(zip(names, table.T, strict=True)))
        return Traces(time_, values, element_units=units)

    def __len__(self) -> int:
        return len(self._rows)


class LiveView:
    """An observer of one run, and the page that shows it; it cannot change anything.

    `observe` copies a row at most 20 times a second: that is the whole cost for the run.
    """

    def __init__(
        self, server: ViserServer, name: str, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self.server, self.name, self._clock = server, name, clock
        self.history = History()
        # Guards `history`: `observe` runs in the simulation's thread, `_draw` in another one.
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self._next = -np.inf
        self._units: dict[str, tuple[str, ...]] = {}
        self._names: list[str] = []
        self._read: list[tuple[NDArray[np.intp], NDArray[np.intp], str]] = []
        self._waiting = server.gui.add_markdown("The first step is being prepared.")
        self.failure: Exception | None = None  # of drawing; the run continues

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Build the page of a plan, and begin to draw."""
        self.scene3d = scene3d_of_plan(plan, self.name)
        numeric = [i for i, c in enumerate(columns) if not c.type.is_blob]
        self._names = [columns[i].name for i in numeric]
        dtypes = [columns[i].type.dtype for i in numeric]
        for dtype in dict.fromkeys(dtypes):
            places = np.array([k for k, d in enumerate(dtypes) if d == dtype], np.intp)
            self._read.append((places, np.array(numeric, np.intp)[places], dtype))
        for i in numeric:
            variable = columns[i].variable
            self._units[f"{columns[i].path}.{variable.name}"] = tuple(
                u or "" for u in variable.units
            )
        self._thread = threading.Thread(target=self._draw, name="uuvsim live view", daemon=True)
        self._thread.start()

    def observe(self, chunk: Chunk) -> None:
        """Keep the newest row, if the last one is old enough."""
        now = self._clock()
        if now < self._next or not len(chunk.ticks):
            return
        self._next = now + 1.0 / FRAMES
        slots = np.ascontiguousarray(chunk.rows[-1])
        row = np.empty(len(self._names))
        for places, columns, dtype in self._read:
            row[places] = slots.view(dtype)[columns]
        with self._lock:
            self.history.add(float(seconds(chunk.ticks[-1:], chunk.tick)[0]), row)

    def end(self) -> None:
        """Stop drawing."""
        self._over.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)

    def _draw(self) -> None:
        try:
            page: _Page | None = None
            while not self._over.wait(1.0 / FRAMES):
                if not self.server.get_clients() or not len(self.history):
                    continue
                with self._lock:
                    newest = self.history.traces(self._names, self._units, last=True)
                    due = page is None or self._clock() - page.last_slow >= 1.0 / SLOW
                    whole = self.history.traces(self._names, self._units) if due else None
                if page is None:
                    self._waiting.remove()
                    page = _Page(self.server, self, newest)
                page.show(newest, whole, self._clock())
        except Exception as error:  # an error of drawing must not stop the run
            self.failure = error


class _Page:
    """Page of a live run."""

    def __init__(self, server: ViserServer, live: LiveView, newest: Traces) -> None:
        self.server, self.scene3d = server, live.scene3d
        self.low, self.high = extent(self.scene3d, motion_of(self.scene3d, newest))
        self.drawn = ViserScene(server, self.scene3d, self.low, self.high)
        server.gui.add_markdown(f"### {live.name.replace('_', ' ')}, live")
        self.clock = server.gui.add_text("time [s]", "", disabled=True)
        self.panel = Panel(server, self.drawn, self.low, self.high)
        self.panel.add_parts()
        self.panel.add_plots(plotted(newest))
        self.panel.say_notes(self.scene3d)
        self.greatest = {b.name: LEAST for b in self.scene3d.bodies}  # N
        self.last_slow = -np.inf
        for client in server.get_clients().values():
            self.panel.look(client)

    def show(self, newest: Traces, whole: Traces | None, now: float) -> None:
        motion = motion_of(self.scene3d, newest)
        scales = {}
        for body in self.scene3d.bodies:
            thrust = motion.thrusts.get(body.name)
            if thrust is not None:
                self.greatest[body.name] = max(self.greatest[body.name], float(abs(thrust).max()))
                scales[body.name] = REACH * body.size / self.greatest[body.name]
        motion = type(motion)(**{**vars(motion), "scales": scales})
        with self.server.atomic():
            self.drawn.show(motion, 0)
            self.clock.value = f"{float(newest.time[0]):.2f}"
            if whole is not None:
                self.last_slow = now
                self.drawn.tracks(motion_of(self.scene3d, whole))
                self.panel.plot(whole)
        self.panel.move_camera(motion, 0)
