"""Live responses on the pages of components: a file of data for each, and the common script.

A file `live/NAME.js` has the WebAssembly of one component, and the stimulus that the page applies.
The compiler's cache keeps the modules, so only a changed component is compiled again.
"""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass
from fractions import Fraction
from importlib.resources import files
from pathlib import Path
from typing import Any

from live_stimuli import Stimulus, stimulus_of

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.fmus.export.experiment import experiment_of
from uuvsim_cosim.kernels.web_assembly.module import web_assembly
from uuvsim_cosim.view.plots.page import own_file

__all__ = ["Live", "live_of", "packed", "script", "style", "system_of"]

FILES = Path(__file__).parent / "live_files"
POINTS = 400  # of a plot
MOST = 8  # elements of a variable that has sliders


@dataclass(frozen=True)
class Live:
    """What a page has: a `file` of data for the script, or the `reason` why there is none."""

    file: str = ""
    text: str = ""  # the stimulus in words
    reason: str = ""


def live_of(name: str) -> Live:
    """Return the live response of a component."""
    stimulus = stimulus_of(name)
    system = system_of(name, stimulus)
    try:
        compiled = web_assembly(system)
    except SystemInvalid as error:
        return Live(reason=f"{error.problems[0].read}; expected {error.problems[0].expected}")
    table = _of_component(compiled.table, name)
    steps = round(stimulus.seconds / float(Fraction(*table["tick"])))
    data = {
        "table": table,
        "module": packed(compiled.module.read_bytes()),
        "steps": steps,
        "at": steps // 10,
        "every": max(1, steps // POINTS),
        "after": dict(stimulus.after),
        "clocks": list(stimulus.clocks),
        "shown": list(stimulus.shown),
        "most": MOST,
    }
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Live(f"uuvsimLive.component({json.dumps(name)},{text});\n", _words(name, stimulus, data))


def system_of(name: str, stimulus: Stimulus) -> uuv.System:
    """Return the system of one component that its page runs."""
    step = stimulus.tick or str(Fraction(str(experiment_of(uuv.declare(name)).step_size)))
    return uuv.System(name, step).add("c", f"model:{name}", start=dict(stimulus.start))


def script() -> str:
    """Return the common script of all pages: uPlot, the system, and the response."""
    library = own_file("uplot/uPlot.iife.min.js").partition("\n")[2]  # without its address
    licence = own_file("uplot/LICENSE").strip()
    system = files("uuvsim_cosim.kernels.web_assembly").joinpath("system.js").read_text("utf-8")
    own = (FILES / "live_response.js").read_text("utf-8")
    return f"/* uPlot 1.6.32\n{licence}\n*/\n{library}\n(function () {{\n{system}{own}}})();\n"


def style() -> str:
    """Return the common styles of all pages."""
    return own_file("uplot/uPlot.min.css") + (FILES / "live.css").read_text("utf-8")


def packed(module: bytes) -> str:
    """Return a module, compressed (deflate without a header), as base64."""
    packer = zlib.compressobj(9, wbits=-15)
    return base64.b64encode(packer.compress(module) + packer.flush()).decode("ascii")


def _of_component(table: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the table of variables with the component's own names."""
    rows = {
        kind: [{**row, "name": row["name"].removeprefix("c.")} for row in table[kind]]
        for kind in ("input", "parameter", "output")
    }
    return {**table, **rows, "name": name}


def _words(name: str, stimulus: Stimulus, data: dict[str, Any]) -> str:
    """Return the stimulus in words, as Markdown."""
    tick = Fraction(*data["table"]["tick"])
    run = f"The run of {stimulus.seconds:g} s has communication steps of {float(tick):g} s"
    if not stimulus.after:
        return f"{run} and starts from the start values; no input changes."
    units = {row["name"]: row["units"] for row in data["table"]["input"]}

    def words(element: str, value: float) -> str:
        whole, _, k = element.rstrip("]").partition("[")
        own = units[whole]
        unit = own[int(k) - 1] if len(own) > 1 else own[0]
        return f"`{element}` to {value:g}" + (f" {unit}" if unit != "1" else "")

    steps = ", ".join(words(e, v) for e, v in stimulus.after.items())
    given = ", ".join(f"`{n}`" for n in stimulus.start if n not in stimulus.clocks)
    text = f"{run}. At {data['at'] * float(tick):g} s, the stimulus sets {steps}."
    if given:
        text += f" From the start, these values differ from the declared ones: {given}."
    if stimulus.clocks:
        clocks = " and ".join(f"`{n}`" for n in stimulus.clocks)
        text += f" The value of {clocks} is the time, so that each sample is a new one."
    return text
