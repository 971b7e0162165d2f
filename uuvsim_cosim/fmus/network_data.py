"""A network in C: its weights in blocks, and the calls of the functions that read them."""

from __future__ import annotations

from collections.abc import Iterator

from uuvsim_cosim.fmus.field_data import field_text
from uuvsim_cosim.fmus.layer_data import layer_text
from uuvsim_cosim.fmus.ray_data import frame_call, ray_text
from uuvsim_cosim.fmus.transformer_data import transformer_text
from uuvsim_cosim.models.field import Field
from uuvsim_cosim.models.network import NETWORKS, Network
from uuvsim_cosim.models.rays import Frame, Rays, Touch
from uuvsim_cosim.models.transformer import Transformer

__all__ = ["HEADER", "network_call", "network_data"]

HEADER = '#include "uuv_network.h"\n'


def network_call(k: int, name: str, a: list[str], forward: bool) -> Iterator[str]:
    """Give the line that calls network `name`, and then each value: ``t{k}.y[j]``.

    `a` are the inputs; of the forward derivative the inputs, the outputs and the seeds.
    """
    n = NETWORKS[name]
    if isinstance(n, Frame):
        yield frame_call(k, n, a)
        yield from (f"t{k}.y[{j}]" for j in range(n.n_out))
        return
    groups = [a[: n.n_in], a[-n.n_in :]] if forward else [a]
    arrays = [f"(const V[]){{{', '.join(x or 'uuv_const(0.0)' for x in g)}}}" for g in groups]
    suffix = "_forward" if forward else ""
    yield f"const {name}_values t{k} = {name}{suffix}({', '.join(arrays)});"
    yield from (f"t{k}.y[{j}]" for j in range(n.n_out))


def network_data(name: str) -> str:
    """Give the weights of a network, and its functions of arrays."""
    n = NETWORKS[name]
    if isinstance(n, Field):
        return "".join(field_text(n))
    if isinstance(n, Rays | Frame | Touch):
        return "".join(ray_text(n))
    return "".join(transformer_text(n) if isinstance(n, Transformer) else _text(n))


def _text(n: Network) -> Iterator[str]:
    rows = []
    for i, layer in enumerate(n.layers):
        arrays, row = layer_text(f"{n.name}_{i}", layer)
        yield arrays
        rows.append(row)
    yield f"static const uuv_layer {n.name}_layers[] = {{{', '.join(rows)}}};\n"
    yield f"typedef struct {{ V y[{n.n_out}]; }} {n.name}_values;\n"
    at = f"{n.name}_layers, {len(n.layers)}"
    for suffix, vectors, given in (("", 2, ["x"]), ("_forward", 4, ["x", "seed"])):
        yield f"static inline {n.name}_values {n.name}{suffix}("
        yield f"{', '.join(f'const V *{a}' for a in given)}) {{\n"
        yield f"    uuv_neuron room[{vectors * n.widest}];\n    {n.name}_values r;\n"
        yield f"    uuv_network{suffix}({at}, {', '.join(given)}, r.y, room, {n.widest});\n"
        yield "    return r;\n}\n"
