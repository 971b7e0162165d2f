"""Client FMU: a running co-simulation as one FMU, which is a client of its TCP server."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from uuvsim_cosim.bridge.clients.client_fmu_text import client_text, layout_of
from uuvsim_cosim.bridge.tcp.framing import TCP_PORT
from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.description import Variable, VariableType
from uuvsim_cosim.fmus.export.model_description import FmiVersion, model_identifier
from uuvsim_cosim.fmus.export.system_fmu_file import (
    Whole,
    WholeFmu,
    compiled,
    component_table,
    sources_of,
)
from uuvsim_cosim.kernels.system_fmu.variables import (
    Naming,
    description_of,
    exposed,
    placed,
)
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["build_client_fmu"]

_PAGE = """This is a client of a co-simulation that runs elsewhere: start it there with
`uuvsim serve`. It connects to the parameters host and port when initialization ends, takes the
time over (a co-simulation that streams is paused), and each step makes whole communication steps
there. Parameters and inputs are named as in the system, with _ for a dot."""


def build_client_fmu(
    system: System,
    *,
    fmi: FmiVersion = 2,
    platforms: Sequence[str] = ("host",),
    target: Path | None = None,
    signals: Sequence[str] = (),
    inputs: Sequence[str] = (),
    naming: Naming = "flat",
    host: str = "127.0.0.1",
    port: int = TCP_PORT,
    stop_time: float = 10.0,
) -> Path:
    """Build an .fmu whose steps are those of a served `system`; return its path.

    The FMU's name is the system's with "_client". Its inputs are the unconnected inputs, and
    tunable parameters are tunable. `signals` and `inputs` are patterns of the names of outputs and
    inputs, all by default; other clients in lockstep may set the remaining inputs. `host` and
    `port` are the start values of the parameters of these names. Raises InputInvalid,
    SystemInvalid for names that clash, and ToolchainError.
    """
    if not 0 < port < 65536:
        raise InputInvalid(f"port {port}", "1 to 65535")
    if not host or len(host) > 200:
        raise InputInvalid(f"host {host!r}", "a name or an address")
    plan = flatten(system)
    found = exposed(plan, naming=naming, signals=signals, inputs=inputs, fixed=False)
    # The order in the block: inputs and tunable parameters, settings, outputs.
    before = placed([e for e in found if e.own.causality != "output"], 1)
    at = 1 + sum(e.shown.size for e in before)
    settings = _settings(at, port)
    outputs = placed([e for e in found if e.own.causality == "output"], at + len(settings))
    last = outputs[-1].shown if outputs else settings[-1]
    texts = _texts(host, last.value_references[0] + last.size)
    description = description_of(
        f"{system.name}_client", f"client of {system.name}: {system.description}", plan,
        [*before, *outputs], [*settings, *texts],
    )  # fmt: skip
    identifier = model_identifier(f"{system.name}_client")
    layout = layout_of(plan, [*before, *outputs])
    body = client_text(system.name, plan.tick, layout, settings, texts)
    token = content_hash([body, repr(description), *sources_of()])
    whole = Whole(
        identifier, description, token, plan.tick, stop_time, states=False, needs_tool=True
    )
    main = "\n".join([_HEAD, component_table(whole), body])
    fmu = WholeFmu(
        whole,
        {f"{identifier}.c": main},
        (content("fmus", "whole"), *runtime()),
        " ".join(_PAGE.split()),
        libraries={".dll": ("-lws2_32",)},
        portable=False,
    )
    return compiled(fmu, fmi=fmi, platforms=platforms, target=target)


_HEAD = """/* Generated from a system: do not edit. */
#define UUV_WHOLE
#if !defined(_WIN32)
#define _GNU_SOURCE
#define _DARWIN_C_SOURCE
#endif
#include "shell_hooks.h"
"""


def _settings(at: int, port: int) -> list[Variable]:
    """Return the numeric parameters of the connection, from offset `at` on."""
    rows: Sequence[tuple[str, VariableType, float, str, str | None, float | None, float | None]] = (
        ("port", "Int32", port, "TCP port that `uuvsim serve` names", None, 1, 65535),
        (
            "restart", "Boolean", True, "go back to the start, with the values given here, when "
            "initialization ends; false: go on from where the co-simulation is", None, None, None,
        ),
        ("seed", "Int32", -1, "seed of a restart; -1: that of the server", None, -1, None),
        ("lag", "Float64", 60.0, "how long others in lockstep wait for this one", "s", 0.001, 3600),
        ("timeout", "Float64", 60.0, "how long this one waits for an answer", "s", 0.001, 86400),
    )  # fmt: skip
    return [
        Variable(
            name=name, type=type_, causality="parameter", variability="fixed", start=start,
            unit=unit, min=low, max=high, description=text, initial="exact",
            value_references=(at + i,),
        )
        for i, (name, type_, start, text, unit, low, high) in enumerate(rows)
    ]  # fmt: skip


def _texts(host: str, at: int) -> list[Variable]:
    """Return the text parameters of the connection, which follow the block."""
    rows = (
        ("host", host, "name or address of the machine where `uuvsim serve` runs"),
        ("user", "", "user's name, where the server asks for one"),
        ("password", "", "password; where it is empty, the environment variable UUVSIM_PASSWORD"),
    )
    return [
        Variable(
            name=name, type="String", causality="parameter", variability="fixed", start=start,
            description=text, initial="exact", value_references=(at + i,),
        )
        for i, (name, start, text) in enumerate(rows)
    ]  # fmt: skip
