"""A network in C: its weights in blocks, and the calls of the functions that read them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.network import NETWORKS, Layer, Network

__all__ = ["HEADER", "network_call", "network_data"]

HEADER = '#include "uuv_network.h"\n'
WIDE = 16  # outputs of a block: UUV_WIDE


def network_call(k: int, name: str, a: list[str], forward: bool) -> Iterator[str]:
    """Give the line that calls network `name`, and then each value: ``t{k}.y[j]``.

    `a` are the inputs; of the forward derivative the inputs, the outputs and the seeds.
    """
    n = NETWORKS[name]
    groups = [a[: n.n_in], a[-n.n_in :]] if forward else [a]
    arrays = [f"(const V[]){{{', '.join(x or 'uuv_const(0.0)' for x in g)}}}" for g in groups]
    suffix = "_forward" if forward else ""
    yield f"const {name}_values t{k} = {name}{suffix}({', '.join(arrays)});"
    yield from (f"t{k}.y[{j}]" for j in range(n.n_out))


def network_data(name: str) -> str:
    """Give the weights of a network, and its functions of arrays."""
    return "".join(_text(NETWORKS[name]))


def _text(n: Network) -> Iterator[str]:
    rows = []
    for i, layer in enumerate(n.layers):
        for what, numbers in (("weight", _blocks(layer)), ("bias", _filled(layer.bias))):
            yield f"static const float {n.name}_{what}_{i}[] = {{{_numbers(numbers)}}};\n"
        outs, ins = layer.weight.shape
        kind = f"UUV_{layer.activation.upper()}"
        rows.append(f"{{{ins}, {outs}, {kind}, {n.name}_weight_{i}, {n.name}_bias_{i}}}")
    yield f"static const uuv_layer {n.name}_layers[] = {{{', '.join(rows)}}};\n"
    yield f"typedef struct {{ V y[{n.n_out}]; }} {n.name}_values;\n"
    at = f"{n.name}_layers, {len(n.layers)}"
    for suffix, vectors, arrays in (("", 2, ("x",)), ("_forward", 4, ("x", "seed"))):
        yield f"static inline {n.name}_values {n.name}{suffix}("
        yield f"{', '.join(f'const V *{a}' for a in arrays)}) {{\n"
        yield f"    uuv_neuron room[{vectors * n.widest}];\n    {n.name}_values r;\n"
        yield f"    uuv_network{suffix}({at}, {', '.join(arrays)}, r.y, room, {n.widest});\n"
        yield "    return r;\n}\n"


def _filled(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Add rows of zeros up to whole blocks."""
    missing = -len(rows) % WIDE
    return np.concatenate([rows, np.zeros((missing, *rows.shape[1:]), np.float32)])


def _blocks(layer: Layer) -> NDArray[np.float32]:
    """Give [block][input][output of the block], flat."""
    w = _filled(layer.weight)
    return w.reshape(-1, WIDE, w.shape[1]).transpose(0, 2, 1).ravel()


def _numbers(values: NDArray[np.float32]) -> str:
    texts = (f"{v:.9g}" for v in values.tolist())
    return ", ".join(f"{t}f" if "." in t or "e" in t else f"{t}.0f" for t in texts)
