"""The page of a system that runs in a browser: its WebAssembly, scene, plots and controls.

The file needs no network. `live_page.js` has the controls, `system.js` of `kernels.web_assembly`
the system.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import written
from uuvsim_cosim.kernels.web_assembly.events import timeline_events
from uuvsim_cosim.kernels.web_assembly.module import WebAssembly, web_assembly
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.scenarios.scenario import Scenario
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.view.live_page.steered import path_names, steered_parts
from uuvsim_cosim.view.plots.page import MARKS, own_file, page_html
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.plots.track import VESSEL
from uuvsim_cosim.view.scene3d.motion import Motion, quaternions
from uuvsim_cosim.view.scene3d.scene import Body, Scene3D
from uuvsim_cosim.view.scene3d.scene_html import BODIES_MOST, scene_card, scene_data
from uuvsim_cosim.view.scene3d.scene_of_plan import scene3d_of_plan, value_of

__all__ = ["live_page_html", "write_live_page"]

SCRIPTS = (
    *(("kernels.web_assembly", name) for name in ("system.js", "timeline.js")),
    *(
        ("view.live_page", f"live_page{part}.js")
        for part in ("_events", "_waypoints", "_steering", "")
    ),
)


def write_live_page(
    system: System, target: Path, *, plots: Sequence[str] = (), remark: str = "", ended: str = "",
    source: str = "",
) -> Path:  # fmt: skip
    """Write the page of a system and return its path; arguments as of `live_page_html`.

    Raises SystemInvalid, which names every component that is no declaration, and ToolchainError.
    """
    page = live_page_html(system, plots=plots, remark=remark, ended=ended, source=source)
    return written(target, page)


def live_page_html(
    system: System, *, plots: Sequence[str] = (), remark: str = "", ended: str = "",
    seed: int = 0, scenario: Scenario | None = None, source: str = "",
) -> str:  # fmt: skip
    """Return the page of a system as a text; it begins with this seed and this scenario.

    The page plots the outputs in `plots` ("task.return") first. A `remark` on what it computes
    stands in the place of the commands that find a system by its name: such a page has no scenario
    to download, and its seed is fixed. The page pauses when the output `ended` ("task.ended")
    becomes 1. `source` is the text by which `uuvsim run` finds the system, by default its name.
    """
    compiled = web_assembly(system)
    plan = compiled.parts.fused.plan
    scene3d = scene3d_of_plan(plan, system.name)
    data = {
        "table": compiled.table | {"source": source or system.name},
        "module": _packed(compiled.module.read_bytes()),
        "marks": MARKS,
        "stop": compiled.parts.whole.stop_time,
        "movers": _movers(scene3d),
        "plots": list(plots),
        "named": not remark,
        "ended": ended,
        "path": path_names(plan),
        "given": {
            "seed": seed,
            "events": [] if scenario is None else timeline_events(plan, scenario),
        },
        "steered": [asdict(s) for s in steered_parts(plan)],
        "vessel": VESSEL,
        "version": __version__,
    }
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    body = [
        f"<header><h1>{escape(system.name)}</h1><p>{escape(system.description)}</p>"
        '<button id="theme" type="button">light / dark</button></header>',
        _CONTROLS,
        f'<div class="live"><div class="seen">{_scene(plan, scene3d)}</div>{_PARAMETERS}</div>',
        f'<div class="acts">{_WAYPOINTS if data["path"] else ""}{_EVENTS}'
        f"{_STEERING if data['steered'] else ''}</div>",
        _PLOTS,
        _about(compiled, remark),
    ]
    library = own_file("uplot/uPlot.iife.min.js").partition("\n")[2]  # without its address
    licence = own_file("uplot/LICENSE").strip()
    own = "".join(
        files(f"uuvsim_cosim.{package}").joinpath(name).read_text("utf-8")
        for package, name in SCRIPTS
    )
    style = files("uuvsim_cosim.view.live_page").joinpath("live_page.css").read_text("utf-8")
    scripts = (
        f'<script id="data" type="application/json">{text}</script>\n'
        f"<script>/* uPlot 1.6.32\n{licence}\n*/\n{library}</script>\n<script>{own}</script>"
    )
    return page_html(
        system.name, "uuvsim", body, style=own_file("uplot/uPlot.min.css") + style, scripts=scripts
    )


_CONTROLS = (
    '<div class="card drive"><button id="run" type="button">run</button>'
    '<button id="back" type="button" title="one communication step back (,)">◂ step back</button>'
    '<button id="step" type="button" title="one communication step (.)">step ▸</button>'
    '<button id="restart" type="button" title="from time 0 with the present values and active '
    'faults; other events are removed">restart</button>'
    '<button id="replay" type="button" title="from time 0 with the same events at the same times" '
    "hidden>replay all events</button>"
    '<label>speed <select id="speed"><option value="0.25">0.25 x</option>'
    '<option value="1" selected>1 x</option><option value="4">4 x</option>'
    '<option value="16">16 x</option><option value="64">64 x</option>'
    '<option value="Infinity">as fast as possible</option></select></label>'
    '<label>seed <input id="seed" type="number" min="0" step="1"></label>'
    '<span id="time" class="clock"></span><span id="rate" class="clock"></span>'
    '<span class="hash" title="hash of the bits of all outputs at all communication points">'
    'hash <code id="hash"></code></span><p id="notice" role="status"></p></div>'
)
_PARAMETERS = (
    '<div class="card given"><h3>Parameters and inputs</h3>'
    '<input id="filter" type="search" placeholder="find a parameter" aria-label="find a parameter">'
    '<div id="given"></div></div>'
)
_WAYPOINTS = (
    '<div class="card" id="waypoints"><h3>Waypoints, seen from above<span class="keys">click to '
    "add, drag to move</span></h3>"
    '<svg id="plan" role="application" aria-label="plan of the waypoints: north over east"></svg>'
    '<div class="row point head"><span></span><i>N [m]</i><i>E [m]</i><i>D [m]</i><i></i></div>'
    '<div id="points"></div></div>'
)
_EVENTS = (
    '<div class="card" id="events"><h3>Faults and events</h3><div class="form">'
    '<input id="fault-signal" list="signals" type="search" aria-label="output that gets a fault">'
    '<select id="fault-kind" aria-label="kind of fault"><option>bias</option>'
    "<option>override</option><option>scale</option><option>freeze</option><option>delay</option>"
    '<option>drop</option></select><input id="fault-value" type="number" step="any" '
    'placeholder="value" aria-label="value of the fault"><i id="fault-unit"></i>'
    '<label>for <input id="fault-lasts" type="number" min="0" step="any" placeholder="always" '
    'aria-label="duration of the fault in s"> s</label>'
    '<button id="fault-add" type="button">add fault</button></div>'
    '<div id="happens"></div><p id="no-events" class="hint">A fault, and each value that you '
    "change while the system runs, is an event of this run.</p>"
    '<p class="foot"><button id="link" type="button">link with all settings</button> '
    '<button id="download" type="button">download scenario.yaml</button></p></div>'
)
_PADS = (
    ("KeyQ", "↤"), ("KeyW", "▲"), ("KeyE", "↦"), ("KeyR", "up"),
    ("KeyA", "↶"), ("KeyS", "▼"), ("KeyD", "↷"), ("KeyF", "down"),
)  # fmt: skip
_STEERING = (
    '<div class="card" id="steering"><h3>Steer by keyboard or gamepad</h3>'
    '<p class="foot"><button id="take" type="button" aria-pressed="false">take the controls'
    '</button> <label>of <select id="whom"></select></label></p><div id="axes"></div>'
    '<p class="hint"><kbd>W</kbd> <kbd>S</kbd> ahead, astern · <kbd>A</kbd> <kbd>D</kbd> or '
    "<kbd>←</kbd> <kbd>→</kbd> turn · <kbd>Q</kbd> <kbd>E</kbd> sideways · <kbd>↑</kbd> "
    "<kbd>↓</kbd> or <kbd>R</kbd> <kbd>F</kbd> up, down · <kbd>Shift</kbd> slowly. Gamepad: left "
    "stick ahead and sideways, right stick turn and depth.</p>"
    '<div id="pads">'
    + "".join(
        f'<button type="button" data-key="{key}" aria-label="{key[3:]}">{sign}</button>'
        for key, sign in _PADS
    )
    + '</div><p class="hint" id="moves"></p></div>'
)
_PLOTS = (
    '<div class="tools"><label>Plot an output <input id="search" list="signals" type="search" '
    'size="26"></label><datalist id="signals"></datalist><small id="hint" role="status">'
    "</small></div>"
    '<div id="plots" class="grid2"></div>'
)


def _packed(module: bytes) -> str:
    """Return a module, compressed (deflate without a header), as base64."""
    packer = zlib.compressobj(9, wbits=-15)
    return base64.b64encode(packer.compress(module) + packer.flush()).decode("ascii")


def _scene(plan: Plan, scene3d: Scene3D) -> str:
    """Return the card of the scene at the start; empty without bodies."""
    if not scene3d.bodies and not scene3d.markers:
        return '<div class="card"><h3>Scene</h3><p>No component here has a pose.</p></div>'
    components = {c.path: c for c in plan.components}
    positions, attitudes, thrusts = {}, {}, {}
    for body in scene3d.bodies:
        start = value_of(components[body.eta.rpartition(".")[0]], "eta_0")
        eta = np.zeros(6) if start is None or start.shape != (6,) else start
        positions[body.name], attitudes[body.name] = eta[None, :3], quaternions(eta[None, 3:])
        if body.arrows:
            thrusts[body.name] = np.zeros((1, len(body.arrows)))
    for marker in scene3d.markers:
        positions[marker.name] = np.zeros((1, 3))
    scales = dict.fromkeys(thrusts, 1.0)
    motion = Motion(np.zeros(1), positions, attitudes, thrusts, scales)
    return scene_card(scene3d, motion, scene_data(scene3d, motion), live=True)


def _movers(scene3d: Scene3D) -> list[dict[str, Any]]:
    """Return the outputs that move the parts of the scene, in the order of the scene's data."""

    def of_body(body: Body) -> dict[str, Any]:
        arrows = [a.signal for a in body.arrows]
        return {"at": body.eta, "q": body.q, "arrows": arrows, "size": body.size}

    markers = [{"at": m.signal, "q": "", "arrows": [], "size": 0.0} for m in scene3d.markers]
    return [*map(of_body, scene3d.bodies[:BODIES_MOST]), *markers[:BODIES_MOST]]


def _about(compiled: WebAssembly, remark: str) -> str:
    """Return the section on how the page computes."""
    parts = compiled.parts
    tick = parts.whole.tick
    sources: Sequence[str] = parts.fused.sources
    named = ", ".join(f"<code>{escape(source)}</code>" for source in sources)
    text = (
        f"The equations of {len(parts.fused.members)} components ({named}) are compiled into "
        f"WebAssembly of {compiled.module.stat().st_size / 1000:.0f} kB, which this page has. "
        f"A communication step is {float(tick):g} s. The page computes the same bits as the "
        "master, the FMUs and the kernels of uuvsim-cosim"
    )
    name = escape(parts.whole.description.name)
    text += (
        f". {escape(remark)}"
        if remark
        else f", and the hash shows it: <code>uuvsim verify {name}</code> prints the same one "
        "for the same number of steps and the same parameters."
    )
    return (
        f'<details class="card"><summary>How this page computes</summary><p>{text}</p></details>'
        f"<footer>uuvsim-cosim {escape(__version__)}. This file needs no network.</footer>"
    )
