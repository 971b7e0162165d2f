"""Client FMU: a running co-simulation as one FMU, which is a client of its TCP server."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from uuvsim_cosim.bridge.calls.service import SignalInfo, entry, interface_hash
from uuvsim_cosim.bridge.server.signal_names import _unit as unit_of
from uuvsim_cosim.bridge.tcp.framing import PROTOCOL, TCP_PORT
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
    Exposed,
    Naming,
    description_of,
    exposed,
    placed,
)
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Layout", "build_client_fmu", "client_text", "layout_of"]


@dataclass(frozen=True)
class Layout:
    """The signals of a client in the order of its block, each as the server describes it."""

    inputs: tuple[SignalInfo, ...]
    tunables: tuple[SignalInfo, ...]
    outputs: tuple[SignalInfo, ...]
    sizes: tuple[int, int, int]


def layout_of(plan: Plan, variables: Sequence[Exposed]) -> Layout:
    """Return the layout of a client's variables."""
    infos: dict[str, list[SignalInfo]] = {"input": [], "parameter": [], "output": []}
    sizes = dict.fromkeys(infos, 0)
    for e in variables:
        v = e.own
        info = SignalInfo(e.full_name, v.type, v.shape, unit_of(v), v.causality, False)
        infos[v.causality].append(info)
        sizes[v.causality] += v.size
    return Layout(
        tuple(infos["input"]), tuple(infos["parameter"]), tuple(infos["output"]),
        (sizes["input"], sizes["parameter"], sizes["output"]),
    )  # fmt: skip


def client_text(
    system: str,
    tick: Fraction,
    layout: Layout,
    settings: Sequence[Variable],
    texts: Sequence[Variable],
) -> str:
    """Return the C code after the component's table: constants, requests, and the runtime."""
    n_in, n_tunable, n_out = layout.sizes
    every = (*layout.inputs, *layout.tunables)
    inputs, tunables, outputs = (
        [i.name for i in infos] for infos in (layout.inputs, layout.tunables, layout.outputs)
    )
    places = ", ".join(f"{v.name.upper()} = {v.value_references[0]}" for v in settings)
    first = settings[-1].value_references[0] + 1
    both = [*inputs, *tunables]
    requests = {
        "LAYOUT": {"call": "layout", "inputs": both, "outputs": outputs},
        "STEPS": {"call": "layout", "inputs": inputs, "outputs": outputs},
        "GET_OUTPUTS": {"call": "get", "names": outputs},
        "SET_TUNABLES": {"call": "set", "columns": _columns(tunables)},
    }
    signals = [f"    {{{_c(i.name)}, {_c(_json(entry(i)))}}}," for i in (*every, *layout.outputs)]
    return "\n".join(
        [
            f"enum {{ N_INPUTS = {n_in}, N_TUNABLES = {n_tunable}, N_OUTPUTS = {n_out},",
            f"       TUNABLES = {1 + n_in}, OUTPUTS = {first}, {places},",
            f"       N_SIGNALS = {len(signals)}, PROTOCOL = {PROTOCOL} }};",
            f"static const uint64_t tick_num = {tick.numerator}u, tick_den = {tick.denominator}u;",
            f"static const char SYSTEM_NAME[] = {_c(system)};",
            f"static const char INTERFACE_HASH[] = {_c(interface_hash(every, layout.outputs))};",
            *(f"static const char {k}[] = {_c(_json(v))};" for k, v in requests.items()),
            # It continues the request with the call and the seed.
            f"static const char START_COLUMNS[] = "
            f"{_c(', ' + _json({'columns': _columns(both)})[1:])};",
            f"static const char *const text_start[] = {{{', '.join(_c(v.start) for v in texts)}}};",
            "static const struct { const char *name, *entry; } signals[] = {",
            *(signals or ["    {0, 0},"]),
            "};",
            '#include "uuv_client.h"',
            "",
        ]
    )


def _columns(names: Sequence[str]) -> list[Mapping[str, str]]:
    return [{"name": n} for n in names]


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)


def _c(text: str) -> str:
    """Return a text as a C string, with bytes beyond ASCII in octal."""
    out = []
    for byte in text.encode():
        plain = 32 <= byte < 127 and chr(byte) not in '"\\?'
        out.append(chr(byte) if plain else f"\\{byte:03o}")
    return f'"{"".join(out)}"'


_PAGE = """This is a client of a co-simulation that runs elsewhere: start it there with
`uuvsim serve`. It connects to the parameters host and port at the end of initialization,
and takes control of time (a running co-simulation is paused). Each of its steps makes whole
communication steps there. Parameters and inputs are named as in the system, with _ for a dot."""


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
    numbers = {"port": port, "restart": True, "seed": -1, "lag": 60.0, "timeout": 60.0}
    settings = _parameters(numbers, at)
    outputs = placed([e for e in found if e.own.causality == "output"], at + len(settings))
    last = outputs[-1].shown if outputs else settings[-1]
    texts_at = last.value_references[0] + last.size
    texts = _parameters({"host": host, "user": "", "password": ""}, texts_at)
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


_PARAMETERS: tuple[tuple[str, VariableType, str, str | None, float | None, float | None], ...] = (
    ("port", "Int32", "TCP port that `uuvsim serve` prints", None, 1, 65535),
    (
        "restart", "Boolean", "restart the co-simulation with the values given here at the end of "
        "initialization; false: continue from its present state", None, None, None,
    ),
    ("seed", "Int32", "seed of a restart; -1: that of the server", None, -1, None),
    ("lag", "Float64", "longest time that other lockstep clients wait for this "
    "one", "s", 0.001, 3600),
    ("timeout", "Float64", "longest time that this client waits for an answer", "s", 0.001, 86400),
    (
        "host", "String", "name or address of the machine where `uuvsim serve` runs",
        None, None, None,
    ),
    ("user", "String", "user's name, if the server requires one", None, None, None),
    (
        "password", "String",
        "password; if it is empty, the environment variable UUVSIM_PASSWORD", None, None, None,
    ),
)  # fmt: skip


def _parameters(start: Mapping[str, str | float], at: int) -> list[Variable]:
    """Return the parameters of the connection that have start values, from offset `at` on."""
    rows = [row for row in _PARAMETERS if row[0] in start]
    return [
        Variable(
            name=name, type=type_, causality="parameter", variability="fixed", start=start[name],
            unit=unit, min=low, max=high, description=text, initial="exact",
            value_references=(at + i,),
        )
        for i, (name, type_, text, unit, low, high) in enumerate(rows)
    ]  # fmt: skip
