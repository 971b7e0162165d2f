"""`uuvsim analyse`: open a loop of a system; margins, poles, Bode plots and step responses."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uuvsim_cosim.commands.shared.completion import systems
from uuvsim_cosim.commands.shared.options import folder_option, seconds
from uuvsim_cosim.commands.shared.system_options import (
    Force,
    Replacements,
    Values,
    VehicleOfMission,
    changes_of,
    edited_system,
)
from uuvsim_cosim.commands.shared.terminal import (
    file_table,
    line,
    notice,
    number,
    put,
    remark,
    table,
)

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.analysis.opened_loop import OpenedLoop

__all__ = ["analyse_command"]

SLOWEST = 6  # poles in the table


def analyse_command(
    system: Annotated[
        str,
        typer.Argument(autocompletion=systems, help="Name of a system, or a path to .ssd or .ssp."),
    ],
    break_: Annotated[
        str,
        typer.Option(
            "--break",
            help="Signal to open: an output or an input, controller.tau_d or hull.tau[3].",
        ),
    ],
    vehicle: VehicleOfMission = None,
    at: Annotated[
        float,
        typer.Option(
            help="Time in the run at which the system is linearised: seconds, or '2 min'.",
            parser=seconds("--at"),
            metavar="TIME",
        ),
    ] = "20",  # type: ignore[assignment]  # parsed as if it was given
    replace: Replacements = None,
    set_: Values = None,
    force: Force = False,
    out: Annotated[
        Path | None, folder_option("Folder for loops.svg, loops.json and loops.mat.")
    ] = None,
) -> None:
    """Open a loop of a system at a signal, and compute its margins, poles and step responses.

    Each element of the signal is opened alone, with all other loops closed. The exit status is 1 if
    a closed loop is unstable.
    """
    edited = edited_system(system, None, changes_of(set_, replace), None, None, vehicle, force)
    from uuvsim_cosim.orchestrator.analysis.opened_loop import opened_loops

    loops, without = opened_loops(edited, break_, at)
    _show(loops, at)
    put("without_loop", without)
    for why in dict.fromkeys(without.values()):
        names = ", ".join(name for name, reason in without.items() if reason == why)
        remark("note", f"left out: {names}: {why}")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        file_table(_write(loops, f"{edited.name}: loop opened at {break_}, after {at:g} s", out))
    if not all(loop.stable for loop in loops):
        fastest = max(loop.closed_poles.real.max() for loop in loops)
        for text in dict.fromkeys(loop.remark for loop in loops if loop.remark):
            remark("note", text)
        notice(
            f"a closed loop has a pole at {fastest:+.2g} 1/s, so it is unstable and the margins do "
            "not apply; along a curved path (a loiter), a pole that is slower than the path turns "
            "says nothing, see --at"
        )
        raise typer.Exit(1)


def _show(loops: list[OpenedLoop], at: float) -> None:
    first = loops[0]
    put("at", at)
    put("tick", first.tick)
    put("period", first.period)
    remark("assumed", f"linearised after {at:g} s of the run, without noise; --at chooses the time")
    if first.period > 1:
        remark(
            "note",
            f"clocks tick together every {first.period} steps: frequency responses are those of "
            "the fundamental, poles are exact",
        )
    line()
    table(
        ("opened at", "unit", "crossover [rad/s]", "phase margin [°]", "gain margin", "reduction",
         "delay margin [ms]", "min |1 + L|", "closed loop"),
        [
            (loop.signal, loop.unit, number(m.crossover, ".3g"),
             number(math.degrees(m.phase), ".1f"), number(m.gain_up, ".3g"),
             number(m.gain_down, ".3g"), number(1e3 * m.delay, ".0f"), number(m.modulus, ".2f"),
             "stable" if loop.stable else "unstable")
            for loop in loops
            for m in [loop.margins]
        ],
        key="margins",
    )  # fmt: skip
    line()
    line("slowest poles of the closed loops [1/s]")
    width = max(len(loop.signal) for loop in loops)
    for loop in loops:
        line(f"{loop.signal:{width}}  " + ",  ".join(map(_pole, _slowest(loop))))
    put("poles", {o.signal: [[p.real, p.imag] for p in o.closed_poles] for o in loops})


def _slowest(loop: OpenedLoop) -> list[complex]:
    """Return the slowest poles, one of each pair of conjugates."""
    return [complex(p) for p in loop.closed_poles if p.imag >= -1e-12][:SLOWEST]


def _pole(p: complex) -> str:
    return f"{p.real:.3g}" + (f" ± {abs(p.imag):.3g}j" if abs(p.imag) > 1e-9 else "")


def _write(loops: list[OpenedLoop], title: str, out: Path) -> list[Path]:
    """Write the picture, the numbers as JSON, and those of MATLAB."""
    import numpy as np
    from scipy.io import savemat

    from uuvsim_cosim.cache import written
    from uuvsim_cosim.view.plots.loop_plot import write_loop_picture

    picture = write_loop_picture(loops, title, out / "loops.svg")
    found: list[dict[str, Any]] = []
    for loop in loops:
        w = loop.frequencies
        t, y = loop.step()
        found.append(
            {
                "signal": loop.signal,
                "unit": loop.unit,
                "stable": loop.stable,
                "remark": loop.remark,
                "tick": loop.tick,
                "margins": vars(loop.margins),
                "omega": w,
                "L": loop.response(w),
                "open_poles": loop.open_poles,
                "closed_poles": loop.closed_poles,
                "step_time": t,
                "step_closed": y,
                "step_open": loop.step(float(t[-1]), closed=False)[1],
            }
        )
    as_json = json.dumps({"title": title, "loops": found}, default=_plain, indent=1)
    numbers = written(
        out / "loops.json", as_json.replace("NaN", "null").replace("Infinity", "null")
    )
    matlab = out / "loops.mat"
    savemat(matlab, {"loops": np.array(found, dtype=object)}, long_field_names=True)
    return [picture, numbers, matlab]


def _plain(value: Any) -> Any:
    """Return arrays as lists; complex numbers as [real, imaginary]."""
    if value.dtype.kind == "c":
        return [[float(v.real), float(v.imag)] for v in value]
    return value.tolist()
