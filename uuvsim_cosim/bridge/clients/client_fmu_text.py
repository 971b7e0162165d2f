"""C code of a client FMU that depends on its system: requests, ready to be sent, and offsets."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from uuvsim_cosim.bridge.calls.service import SignalInfo
from uuvsim_cosim.bridge.calls.signal_hash import entry, interface_hash
from uuvsim_cosim.bridge.server.signal_names import _unit as unit_of
from uuvsim_cosim.bridge.tcp.framing import PROTOCOL
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.kernels.system_fmu.variables import Exposed
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Layout", "client_text", "layout_of"]


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
