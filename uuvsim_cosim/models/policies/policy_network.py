"""The network of a policy in equations: an observation becomes actions in [-1, 1].

A policy with a memory is a decision transformer with a history of K actions. Discrete states hold
the history, which is shifted with each action. The return to go starts at the parameter
`return_to_go` and is reduced by the input `reward`, the reward of the last action.
"""

from __future__ import annotations

from typing import cast

import casadi as ca

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.safe_math import saturate
from uuvsim_cosim.models.intrinsics.network import Activation, Layer, network
from uuvsim_cosim.models.intrinsics.transformer import transformer
from uuvsim_cosim.models.policies.policy_file import PolicyFile

__all__ = ["decided"]


def decided(m: Model, sample: Clock, file: PolicyFile, observation: ca.SX, due: Number) -> ca.SX:
    """Return actions (width,) in [-1, 1] of an observation (width,) at a sample that is due.

    A policy of kind "sequence" declares its history in `m`. Its settings: `context` K, `heads`,
    `activation` (gelu or relu), `return_to_go`, `return_scale`, and `reward`, that of an action
    unless something feeds the input. Raises InputInvalid.
    """
    if file.kind != "sequence":
        return _acts(file, observation)
    s, widths = file.settings, (1, len(file.observation), len(file.action))
    try:
        K, heads = int(s["context"]), int(s["heads"])
        wanted, scale = float(s["return_to_go"]), float(s.get("return_scale", 1.0))
        own = {k: v for k, v in file.tensors.items() if k not in ("shift", "scale")}
        network = transformer(own, K, heads, s.get("activation", "gelu"))
    except (KeyError, ValueError) as error:
        raise InputInvalid(file.path, f"{error} in its settings", "numbers") from None
    if (own["embed_observation.weight"].shape[1], len(own["head.bias"])) != widths[1:]:
        raise InputInvalid(
            file.path,
            "a transformer of other widths",
            f"{widths[1]} observed and {widths[2]} acted",
        )
    begin = m.parameter("return_to_go", wanted, unit="1", description="wanted of the whole run")
    reward = m.input("reward", unit="1", start=float(s.get("reward", 0.0)),
                     description="what the last action was worth")  # fmt: skip
    past = m.discrete("past", unit="1", description="actions so far")
    names = ("return_to_go_held", "seen", "done")
    size = [K * w for w in widths]
    history = [m.discrete(n, (0.0,) * k, unit="1") for n, k in zip(names, size, strict=True)]
    last = history[0][-1]
    now = (ca.if_else(past > 0.5, last - reward, begin), _normed(file, observation),
           ca.SX.zeros(widths[2]))  # fmt: skip
    moved = [ca.vertcat(h[w:], x) for h, w, x in zip(history, widths, now, strict=True)]
    rows = []
    for i in range(K):
        part = [h[i * w : (i + 1) * w] for h, w in zip(moved, widths, strict=True)]
        rows += [part[0] / scale, *part[1:]]
    action = ca.tanh(network(ca.vertcat(past, *rows)))
    moved[2] = ca.vertcat(moved[2][: -widths[2]], action)
    for h, new in zip(history, moved, strict=True):
        m.update(sample, h, ca.if_else(due, new, h))
    m.update(sample, past, ca.if_else(due, past + 1.0, past))
    return action


def _normed(file: PolicyFile, observation: ca.SX) -> ca.SX:
    """Shift and scale an observation by the numbers of the file."""
    if "shift" not in file.tensors:
        return observation
    shift, scale = (ca.DM(file.tensors[k].astype(float)) for k in ("shift", "scale"))
    return (observation - shift) * scale


def _acts(file: PolicyFile, observation: ca.SX) -> ca.SX:
    """Return actions (width,) in [-1, 1] of an observation (width,), without noise."""
    y = network(_layers(file))(_normed(file, observation))
    if file.kind == "tanh":
        return ca.tanh(y)
    if file.kind == "clip":
        return saturate(y, 1.0)
    grid = file.tensors["grid"].astype(float)
    best = y[0]
    action: ca.SX = ca.DM(grid[0])
    for i in range(1, len(grid)):
        better = y[i] > best
        best = ca.if_else(better, y[i], best)
        action = ca.if_else(better, ca.DM(grid[i]), action)
    return saturate(action, 1.0)


def _layers(file: PolicyFile) -> list[Layer]:
    if file.kind not in ("tanh", "clip", "grid"):
        raise InputInvalid(file.path, f"a policy of kind {file.kind!r}", "tanh, clip or grid")
    tensors = file.tensors
    depth = sum(name.endswith(".weight") and name[:-7].isdigit() for name in tensors)
    missing = [name for i in range(depth) for name in (f"{i}.bias",) if name not in tensors]
    missing += [n for n in ("grid",) if file.kind == "grid" and n not in tensors]
    if missing or not depth:
        raise InputInvalid(f"{file.path}: no tensor {(missing or ['0.weight'])[0]!r} in it")
    hidden = cast(Activation, file.activation)
    layers = [
        Layer(tensors[f"{i}.weight"], tensors[f"{i}.bias"], hidden if i + 1 < depth else "linear")
        for i in range(depth)
    ]
    width = (
        tensors["grid"].shape if file.kind == "grid" else (len(layers[-1].bias), len(file.action))
    )
    shape = (layers[0].weight.shape[-1], len(layers[-1].bias), len(file.action))
    if shape != (len(file.observation), *width):
        raise InputInvalid(
            file.path,
            f"a network of {shape[0]} inputs and {shape[1]} outputs",
            f"one for {len(file.observation)} observed and {len(file.action)} acted",
        )
    return layers
