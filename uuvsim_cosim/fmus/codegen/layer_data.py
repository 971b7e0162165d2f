"""A layer in C: its weights in blocks of outputs, as uuv_network.h reads them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.intrinsics.network import Layer

__all__ = ["array_text", "layer_text"]

WIDE = 16  # outputs of a block: UUV_WIDE


def layer_text(name: str, layer: Layer, kind: str = "") -> tuple[str, str]:
    """Return the arrays of a layer, and its `uuv_layer` in braces; `kind`: its activation in C."""
    outs, ins = layer.weight.shape
    kind = kind or f"UUV_{layer.activation.upper()}"
    blocks = _filled(layer.weight).reshape(-1, WIDE, ins)
    arrays = array_text(f"{name}_weight", blocks.transpose(0, 2, 1))  # [block][input][output]
    arrays += array_text(f"{name}_bias", _filled(layer.bias))
    return arrays, f"{{{ins}, {outs}, {kind}, {name}_weight, {name}_bias}}"


def array_text(name: str, values: NDArray[np.float32]) -> str:
    """Return an array of float32 in C, with all bits."""
    texts = (f"{v:.9g}" for v in values.ravel().tolist())
    numbers = ", ".join(f"{t}f" if "." in t or "e" in t else f"{t}.0f" for t in texts)
    return f"static const float {name}[] = {{{numbers}}};\n"


def _filled(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Add rows of zeros up to whole blocks."""
    missing = -len(rows) % WIDE
    return np.concatenate([rows, np.zeros((missing, *rows.shape[1:]), np.float32)])
