"""A network in C: its weights in blocks, and the calls of the functions that read them."""

from __future__ import annotations

from collections.abc import Iterator

from uuvsim_cosim.fmus.codegen.contact_data import contact_text
from uuvsim_cosim.fmus.codegen.field_data import field_text
from uuvsim_cosim.fmus.codegen.layer_data import layer_text
from uuvsim_cosim.fmus.codegen.ray_data import frame_call, ray_text
from uuvsim_cosim.fmus.codegen.transformer_data import transformer_text
from uuvsim_cosim.models.hull.contact import HullContact, HullPlace
from uuvsim_cosim.models.intrinsics.field import Field
from uuvsim_cosim.models.intrinsics.network import NETWORKS, Network
from uuvsim_cosim.models.intrinsics.transformer import Transformer
from uuvsim_cosim.models.worlds.rays import Frame, Rays

__all__ = ["HEADER", "network_call", "network_data", "network_of"]

HEADER = '#include "uuv_network.h"\n'
FORWARD, ADJOINT = "fwd1_wrap_", "adj1_wrap_"  # CasADi's names of a called function's derivatives


def network_of(called: str) -> str:
    """Return the name of the network of a called function, which may be its derivative."""
    return called.removeprefix(FORWARD).removeprefix(ADJOINT)


def network_call(k: int, called: str, a: list[str]) -> Iterator[str]:
    """Yield the line that calls a network, and then each value: ``t{k}.y[j]``.

    `a` are the inputs. A forward derivative (FORWARD) has inputs, outputs and the seeds of the
    inputs; a reverse one (ADJOINT) has inputs, outputs and the seeds of the outputs.
    """
    name = network_of(called)
    n = NETWORKS[name]
    if isinstance(n, Frame):
        yield frame_call(k, n, a)
        yield from (f"t{k}.y[{j}]" for j in range(n.n_out))
        return
    suffix, groups, count, kind = "", [a], n.n_out, ""
    if called.startswith(FORWARD):
        suffix, groups = "_forward", [a[: n.n_in], a[-n.n_in :]]
    elif called.startswith(ADJOINT):
        suffix, groups, count = "_adjoint", [a[: n.n_in], a[-n.n_out :]], n.n_in
        kind = "_adjoint"
    arrays = [f"(const V[]){{{', '.join(x or 'uuv_const(0.0)' for x in g)}}}" for g in groups]
    yield f"const {name}{kind}_values t{k} = {name}{suffix}({', '.join(arrays)});"
    yield from (f"t{k}.y[{j}]" for j in range(count))


def network_data(name: str) -> str:
    """Return the weights of a network, and its functions of arrays."""
    n = NETWORKS[name]
    if isinstance(n, Field):
        return "".join(field_text(n))
    if isinstance(n, HullContact | HullPlace):
        return "".join(contact_text(n))
    if isinstance(n, Rays | Frame):
        return "".join(ray_text(n))
    if isinstance(n, Transformer):
        return "".join(transformer_text(n))
    assert isinstance(n, Network)
    return "".join(_text(n))


def _text(n: Network) -> Iterator[str]:
    rows = []
    for i, layer in enumerate(n.layers):
        arrays, row = layer_text(f"{n.name}_{i}", layer)
        yield arrays
        rows.append(row)
    yield f"static const uuv_layer {n.name}_layers[] = {{{', '.join(rows)}}};\n"
    yield f"typedef struct {{ V y[{n.n_out}]; }} {n.name}_values;\n"
    yield f"typedef struct {{ V y[{n.n_in}]; }} {n.name}_adjoint_values;\n"
    at = f"{n.name}_layers, {len(n.layers)}"
    for suffix, vectors, given in (("", 2, ["x"]), ("_forward", 4, ["x", "seed"])):
        yield f"static inline {n.name}_values {n.name}{suffix}("
        yield f"{', '.join(f'const V *{a}' for a in given)}) {{\n"
        yield f"    uuv_neuron room[{vectors * n.widest}];\n    {n.name}_values r;\n"
        yield f"    uuv_network{suffix}({at}, {', '.join(given)}, r.y, room, {n.widest});\n"
        yield "    return r;\n}\n"
    every = n.n_in + sum(len(layer.bias) for layer in n.layers)
    yield f"static inline {n.name}_adjoint_values {n.name}_adjoint(const V *x, const V *seed) {{\n"
    yield f"    uuv_neuron room[{every + 2 * n.widest}];\n    {n.name}_adjoint_values r;\n"
    yield f"    uuv_network_adjoint({at}, x, seed, r.y, room, {every}, {n.widest});\n"
    yield "    return r;\n}\n"
