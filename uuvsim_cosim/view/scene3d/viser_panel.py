"""Panel of replay and live view: shown parts, followed body, and plots with one unit per axis."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.view.plots.page import MARKS, picture_styles
from uuvsim_cosim.view.plots.plots import Frame, Line, TimePanel
from uuvsim_cosim.view.plots.svg import text
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.scene3d.motion import Motion
from uuvsim_cosim.view.scene3d.scene import Scene3D
from uuvsim_cosim.view.scene3d.viser_scene import ViserScene
from uuvsim_cosim.view.scene3d.viser_sonar import SonarPictures

if TYPE_CHECKING:
    from viser import (
        ClientHandle,
        GuiCheckboxHandle,
        GuiDropdownHandle,
        GuiEvent,
        GuiMarkdownHandle,
        ViserServer,
    )

__all__ = ["Panel"]

Array = NDArray[np.float64]
PARTS = {
    "terrain": "seabed",
    "surface": "water surface",
    "obstacles": "obstacles",
    "path": "planned path",
    "tracks": "tracks",
    "thrust": "thrust",
    "rays": "sensor beams",
    "echoes": "measured points",
}
NOTHING = "nothing"
FIRST = ("hull.eta", "hull.nu", "dvl.altitude", "battery.voltage", "wrench.tau")  # of the choices
SAMPLES = 400  # of a plot
MOST_PLOTS = 3
BESIDE = 0.17 * np.array([-0.51, 0.86, 0.0])  # of the camera's target: the panel covers the right


class Panel:
    """Controls of a server's page, which act on the drawn scene."""

    def __init__(self, server: ViserServer, drawn: ViserScene, low: Array, high: Array) -> None:
        self.server, self.drawn = server, drawn
        self._low, self._high = low, high
        self._followed: Array | None = None
        server.on_client_connect(self.look)  # a new viewer sees the whole scene first
        scene3d = drawn.scene3d
        self.sizes = {body.name: body.size for body in scene3d.bodies}  # m
        with server.gui.add_folder("Camera"):
            names = [NOTHING, *(b.name for b in scene3d.bodies), *(m.name for m in scene3d.markers)]
            self.follow = server.gui.add_dropdown("camera follows", tuple(names))
            home = server.gui.add_button("show the whole scene")

        def show_all(event: GuiEvent) -> None:
            self.follow.value = NOTHING
            if event.client is not None:
                self.look(event.client)

        home.on_click(show_all)
        self._boxes: dict[str, GuiCheckboxHandle] = {}
        self.sonars = SonarPictures(server, scene3d.sonars)
        self._plots: list[tuple[GuiDropdownHandle, GuiMarkdownHandle]] = []

    def add_parts(self) -> None:
        """Add a checkbox for each part that the scene has."""
        with self.server.gui.add_folder("Shown", expand_by_default=False):
            for part, label in PARTS.items():
                if part in self.drawn.parts or part in self.drawn.coming:
                    box = self.server.gui.add_checkbox(label, True)
                    self._boxes[part] = box
                    # Default arguments, so that each callback refers to its own checkbox.
                    box.on_update(
                        lambda _, part=part, box=box: self.drawn.hide(part, not box.value)
                    )

    def add_plots(self, names: Sequence[str]) -> None:
        """Add places for plots, each with the choice of a signal."""
        with self.server.gui.add_folder("Plots"):
            for i in range(min(MOST_PLOTS, len(names))):
                choice = self.server.gui.add_dropdown(
                    f"signal {i + 1}", (NOTHING, *names),
                    initial_value=names[i] if i < 1 else NOTHING,
                )  # fmt: skip
                self._plots.append((choice, self.server.gui.add_markdown("", image_root=Path())))

    def say_notes(self, scene3d: Scene3D) -> None:
        """Show notes on parts that could not be drawn."""
        if scene3d.notes:
            with self.server.gui.add_folder("Not drawn", expand_by_default=False):
                # In backquotes, MDX does not read a note as markup.
                notes = [note.replace("`", "'").replace("\n", " ") for note in scene3d.notes]
                self.server.gui.add_markdown("\n".join(f"- `{note}`" for note in notes))

    def plot(self, traces: Traces, t: float | None = None) -> None:
        """Update the chosen plots, and the pictures of sonars."""
        self.sonars.show(traces, t)
        for choice, place in self._plots:
            name = choice.value
            shown = name in traces.values and len(traces.time) > 1
            text = plot_markdown(traces, name, t) if shown else ""
            if place.content != text:
                place.content = text

    def move_camera(self, motion: Motion, k: int) -> None:
        """Move every camera as far as the followed body has moved."""
        at = motion.positions.get(self.follow.value)
        if at is None or not np.isfinite(at[k]).all():
            self._followed = None
            return
        here, before = at[k], self._followed
        self._followed = here.copy()
        for client in self.server.get_clients().values():
            # A client may disconnect at any moment.
            with suppress(AssertionError, AttributeError, KeyError, RuntimeError):
                camera = client.camera
                with client.atomic():
                    if before is None:
                        size = max(4.0 * self.sizes.get(self.follow.value, 0.5), 1.0)
                        camera.position = here + np.array([-size, -0.7 * size, -0.7 * size])
                    else:
                        camera.position = camera.position + (here - before)
                    camera.look_at = here

    def look(self, client: ClientHandle) -> None:
        """Let one browser see the whole scene."""
        middle = 0.5 * (self._low + self._high)
        away = float(np.linalg.norm(self._high - self._low))
        with suppress(AssertionError, AttributeError, KeyError, RuntimeError), client.atomic():
            seen = middle + away * BESIDE
            client.camera.position = seen + away * np.array([-0.75, -0.45, -0.7])
            client.camera.look_at = seen


def plotted(traces: Traces) -> list[str]:
    """List the signals that can be plotted, those of most interest first."""
    names = [n for n, v in traces.values.items() if v.ndim == 1 or v.shape[1] <= 12]
    first = [n for wanted in FIRST for n in names if n == wanted or n.endswith("." + wanted)]
    return list(dict.fromkeys([*first, *sorted(names)]))


def plot_markdown(traces: Traces, name: str, t: float | None = None) -> str:
    """Return plots of a signal as Markdown, one for each of its units; `t` is marked by a line."""
    picks = np.unique(np.linspace(0, len(traces.time) - 1, SAMPLES).astype(int))
    time = traces.time[picks]
    values = traces.values[name].reshape(len(traces.time), -1)[picks].astype(float)
    frame = Frame(width=360, height=190, top=26)
    style = picture_styles().partition("@media")[0]
    parts = []
    for unit, elements in traces.by_unit(name, len(MARKS)):
        lines = [
            Line(str(i + 1), values[:, i], s, 3) for i, s in zip(elements, MARKS, strict=False)
        ]
        panel = TimePanel(name, unit, lines)
        inside = panel.draw(time, frame)
        if len(lines) > 1:
            for k, line in enumerate(lines):
                x = frame.left + 38.0 * k
                inside += (
                    f'<path class="line {line.style}" d="M{x:.0f} 12h16"/>'
                    f'<path class="marker {line.style}" d="{MARKS[line.style]}" '
                    f'transform="translate({x + 8:.0f} 12)"/>'
                ) + text(x + 20, 16, line.label, "tick")
            inside += panel.marks(time, frame)
        if t is not None and len(time) > 1:
            x = float(frame.time_scale(time)(t))
            bottom = frame.height - frame.bottom
            inside += f'<path d="M{x:.1f} {frame.top:g}V{bottom:g}" stroke="#e5484d"/>'
        svg = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {frame.width:g} '
            f'{frame.height:g}" width="{2 * frame.width:g}" height="{2 * frame.height:g}">'
            f'<style>{style}</style><rect width="100%" height="100%" fill="#fff"/>{inside}</svg>'
        )
        encoded = base64.b64encode(svg.encode()).decode()
        # In backquotes, Markdown does not interpret a name.
        title = " in ".join(f"`{part.replace('`', '')}`" for part in (name, unit or "1"))
        parts.append(f"**{title}**\n\n![plot](data:image/svg+xml;base64,{encoded})")
    return "\n\n".join(parts)
