"""A decision transformer in C: its tensors, and the function of an array that reads them."""

from __future__ import annotations

from collections.abc import Iterator

from uuvsim_cosim.fmus.codegen.layer_data import array_text, layer_text
from uuvsim_cosim.models.intrinsics.network import Layer
from uuvsim_cosim.models.intrinsics.transformer import Transformer

__all__ = ["transformer_text"]


def transformer_text(n: Transformer) -> Iterator[str]:
    """Yield the tensors of a transformer, and its function of its inputs."""
    arrays: list[str] = []

    def layer(name: str, kind: str = "UUV_LINEAR") -> str:
        given = Layer(n.tensors[f"{name}.weight"], n.tensors[f"{name}.bias"])
        text, struct = layer_text(f"{n.name}_{name.replace('.', '_')}", given, kind)
        arrays.append(text)
        return struct

    def norm(name: str) -> str:
        own = f"{n.name}_{name.replace('.', '_')}"
        for what, key in (("scale", "weight"), ("shift", "bias")):
            arrays.append(array_text(f"{own}_{what}", n.tensors[f"{name}.{key}"]))
        return f"{{{own}_scale, {own}_shift}}"

    blocks = []
    for i in range(n.blocks):
        at = f"blocks.{i}."
        parts = [norm(f"{at}norm_1"), norm(f"{at}norm_2"), layer(f"{at}attention.qkv"),
                 layer(f"{at}attention.out"), layer(f"{at}wide", f"UUV_{n.activation.upper()}"),
                 layer(f"{at}narrow")]  # fmt: skip
        blocks.append(f"{{{', '.join(parts)}}}")
    table = n.tensors["embed_time.weight"]
    arrays.append(array_text(f"{n.name}_time", table))
    fields = [
        f"{n.places}, {n.observed}, {n.n_out}, {n.hidden}, {n.heads}, {n.blocks}, {len(table)}",
        *(layer(f"embed_{what}") for what in ("return", "observation", "action")),
        layer("head"),
        f"{n.name}_time",
        norm("embed_norm"),
        norm("norm"),
        f"{n.name}_blocks",
    ]
    yield '#include "uuv_transformer.h"\n'
    yield from arrays
    yield f"static const uuv_block {n.name}_blocks[] = {{{', '.join(blocks)}}};\n"
    yield f"static const uuv_transformer {n.name}_tensors = {{{', '.join(fields)}}};\n"
    yield f"typedef struct {{ V y[{n.n_out}]; }} {n.name}_values;\n"
    yield f"static inline {n.name}_values {n.name}(const V *x) {{\n"
    room = f"UUV_TRANSFORMER_ROOM({n.places}, {n.hidden}, {n.widest})"
    yield f"    uuv_neuron room[{room}];\n    {n.name}_values r;\n"
    yield f"    uuv_transform(&{n.name}_tensors, x, r.y, room, {n.widest});\n    return r;\n}}\n"
