"""Replay of a recording in browsers: pause, speed, scrub; several viewers share it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.scene3d.motion import Motion, extent
from uuvsim_cosim.view.scene3d.scene import Scene3D
from uuvsim_cosim.view.scene3d.viser_panel import Panel, plotted
from uuvsim_cosim.view.scene3d.viser_scene import ViserScene

if TYPE_CHECKING:
    from viser import GuiEvent, ViserServer

__all__ = ["Replay"]

FRAMES = 30.0  # Hz
SLOW = 5.0  # Hz, at which the slider and the plots move on their own
SPEEDS = ("0.125 x", "0.25 x", "0.5 x", "1 x", "2 x", "4 x", "8 x", "16 x", "32 x", "64 x")
IDLE = 0.2  # s between two checks for viewers, while there is none


class Replay:
    """The page of a recording; `serve` keeps it moving until it is interrupted."""

    def __init__(
        self, server: ViserServer, scene3d: Scene3D, motion: Motion, traces: Traces
    ) -> None:
        self.server, self.motion, self.traces = server, motion, traces
        self.start, self.end = float(motion.time[0]), float(motion.time[-1])
        self.t = self.start
        low, high = extent(scene3d, motion)
        self.drawn = ViserScene(server, scene3d, low, high)
        self.drawn.tracks(motion)
        gui = server.gui
        gui.add_markdown(f"### {scene3d.name.replace('_', ' ')}")
        self.clock = gui.add_text("time [s]", "", disabled=True)
        whole = max(self.end - self.start, 1e-9)
        self.slider = gui.add_slider("time since the start [s]", 0.0, whole, whole / 2000.0, 0.0)
        self.playing = gui.add_checkbox("play", True)
        self.speed = gui.add_dropdown("speed", SPEEDS, initial_value="1 x")
        self.again = gui.add_checkbox("repeat", False)
        panel = self.panel = Panel(server, self.drawn, low, high)
        panel.add_parts()
        panel.add_plots(plotted(traces))
        panel.say_notes(scene3d)

        def moved(event: GuiEvent) -> None:
            if event.client is not None:  # a viewer moved it, not the replay
                self.t = self.start + float(self.slider.value)

        def begun(_: GuiEvent) -> None:
            if self.playing.value and self.t >= self.end:
                self.t = self.start

        self.slider.on_update(moved)
        self.playing.on_update(begun)
        self.show()

    @property
    def factor(self) -> float:
        """The seconds of the recording in one of the wall clock."""
        return float(self.speed.value.removesuffix(" x"))

    def advance(self, seconds: float) -> None:
        """Advance the replay by `seconds` of wall time; at the end it stops, or begins again."""
        if not self.playing.value:
            return
        self.t += seconds * self.factor
        if self.t >= self.end:
            if self.again.value and self.end > self.start:
                self.t = self.start + (self.t - self.end) % (self.end - self.start)
            else:
                self.t = self.end
                self.playing.value = False

    def show(self, *, all_: bool = True) -> None:
        """Show the present moment; with `all_` the slider, the clock and the plots too."""
        k = self.motion.moment(self.t)
        with self.server.atomic():
            self.drawn.show(self.motion, k)
            if all_:
                factor = f"x {self.factor:g}"
                self.clock.value = f"{self.t:.2f} of {self.end:.2f}, {factor}"
                self.slider.value = self.t - self.start
                self.panel.plot(self.traces, self.t)
        self.panel.move_camera(self.motion, k)

    def serve(
        self,
        *,
        until: Callable[[], bool] = lambda: False,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Play while there are viewers, until `until` is true or KeyboardInterrupt."""
        last, shown = clock(), -1.0
        while not until():
            if not self.server.get_clients():
                sleep(IDLE)
                last = clock()
                continue
            now = clock()
            self.advance(now - last)
            last = now
            slow = now - shown >= 1.0 / SLOW
            self.show(all_=slow)
            shown = now if slow else shown
            sleep(max(0.0, 1.0 / FRAMES - (clock() - now)))
