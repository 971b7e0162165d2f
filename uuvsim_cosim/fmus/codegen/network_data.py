"""Networks, transformers and fields in C: their arrays, and the functions that read them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.fmus.codegen.camera_data import camera_call, camera_text
from uuvsim_cosim.fmus.codegen.scene_data import contact_text, frame_call, ray_text
from uuvsim_cosim.fmus.codegen.sonar_data import sonar_call, sonar_text
from uuvsim_cosim.models.hull.contact import HullContact, HullPlace
from uuvsim_cosim.models.intrinsics.field import Field
from uuvsim_cosim.models.intrinsics.network import NETWORKS, Layer, Network
from uuvsim_cosim.models.intrinsics.transformer import Transformer
from uuvsim_cosim.models.worlds.camera_image import CameraImage
from uuvsim_cosim.models.worlds.rays import Frame, Rays
from uuvsim_cosim.models.worlds.sonar_image import SonarImage

__all__ = [
    "HEADER",
    "array_text",
    "field_text",
    "layer_text",
    "network_call",
    "network_data",
    "network_of",
    "transformer_text",
]

WIDE = 16  # outputs of a block: UUV_WIDE
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
    if isinstance(n, SonarImage | CameraImage):
        yield sonar_call(k, n, a) if isinstance(n, SonarImage) else camera_call(k, n, a)
        yield from (f"y{k}[{j}]" for j in range(n.n_out))
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
    if isinstance(n, SonarImage):
        return "".join(sonar_text(n))
    if isinstance(n, CameraImage):
        return "".join(camera_text(n))
    if isinstance(n, Transformer):
        return "".join(transformer_text(n))
    assert isinstance(n, Network)
    return "".join(network_text(n))


def network_text(n: Network) -> Iterator[str]:
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
        call = f"uuv_network{suffix}({at}, {', '.join(given)}, r.y, room, {n.widest})"
        yield _array_function(n.name, suffix, given, call, f"{vectors * n.widest}")
    every = n.n_in + sum(len(layer.bias) for layer in n.layers)
    call = f"uuv_network_adjoint({at}, x, seed, r.y, room, {every}, {n.widest})"
    room = f"{every + 2 * n.widest}"
    yield _array_function(n.name, "_adjoint", ["x", "seed"], call, room, "_adjoint")


def _array_function(
    name: str, suffix: str, given: Sequence[str], call: str, room: str = "", struct: str = ""
) -> str:
    """Return a C function of arrays; `call` sets its results ``r.y``, in a work space `room`."""
    arguments = ", ".join(f"const V *{a}" for a in given)
    return (
        f"static inline {name}{struct}_values {name}{suffix}({arguments}) {{\n"
        + (f"    uuv_neuron room[{room}];\n" if room else "")
        + f"    {name}{struct}_values r;\n    {call};\n    return r;\n}}\n"
    )


def layer_text(name: str, layer: Layer, activation: str = "") -> tuple[str, str]:
    """Return the arrays of a layer, and its `uuv_layer` in braces; `activation`: in C."""
    outs, ins = layer.weight.shape
    activation = activation or f"UUV_{layer.activation.upper()}"
    blocks = _filled(layer.weight).reshape(-1, WIDE, ins)
    arrays = array_text(f"{name}_weight", blocks.transpose(0, 2, 1))  # [block][input][output]
    arrays += array_text(f"{name}_bias", _filled(layer.bias))
    return arrays, f"{{{ins}, {outs}, {activation}, {name}_weight, {name}_bias}}"


def array_text(name: str, values: NDArray[np.float32]) -> str:
    """Return an array of float32 in C, with all bits."""
    texts = (f"{v:.9g}" for v in values.ravel().tolist())
    numbers = ", ".join(f"{t}f" if "." in t or "e" in t else f"{t}.0f" for t in texts)
    return f"static const float {name}[] = {{{numbers}}};\n"


def _filled(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Add rows of zeros up to whole blocks."""
    missing = -len(rows) % WIDE
    return np.concatenate([rows, np.zeros((missing, *rows.shape[1:]), np.float32)])


def transformer_text(n: Transformer) -> Iterator[str]:
    """Yield the tensors of a transformer, and its function of its inputs."""
    arrays: list[str] = []

    def layer(name: str, activation: str = "UUV_LINEAR") -> str:
        given = Layer(n.tensors[f"{name}.weight"], n.tensors[f"{name}.bias"])
        text, struct = layer_text(f"{n.name}_{name.replace('.', '_')}", given, activation)
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
    room = f"UUV_TRANSFORMER_ROOM({n.places}, {n.hidden}, {n.widest})"
    call = f"uuv_transform(&{n.name}_tensors, x, r.y, room, {n.widest})"
    yield _array_function(n.name, "", ["x"], call, room)


def field_text(f: Field) -> Iterator[str]:
    """Yield the grids and nodes of a field, and its functions of its inputs."""
    yield '#include "uuv_field.h"\n'
    for i, grid in enumerate(f.axes):
        yield f"static const double {f.name}_grid_{i}[] = {{{', '.join(map(repr, grid))}}};\n"
    yield array_text(f"{f.name}_nodes", f.nodes)
    grids = ", ".join(f"{f.name}_grid_{i}" for i in range(len(f.axes)))
    sizes = ", ".join(str(len(grid)) for grid in f.axes)
    held = ", ".join(str(int(h)) for h in f.held)
    fields = f"{{{grids}}}, {{{sizes}}}, {{{held}}}, {f.n_out}, {f.name}_nodes"
    yield f"static const uuv_field {f.name}_field = {{{fields}}};\n"
    yield f"typedef struct {{ V y[{f.n_out}]; }} {f.name}_values;\n"
    for suffix, given in (("", ["x"]), ("_forward", ["x", "seed"])):
        call = f"uuv_field_at{suffix}(&{f.name}_field, {', '.join(given)}, r.y)"
        yield _array_function(f.name, suffix, given, call)
