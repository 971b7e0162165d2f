"""The network of a policy in equations: an observation becomes actions in [-1, 1]."""

from __future__ import annotations

from typing import cast

import casadi as ca

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.safe_math import saturate
from uuvsim_cosim.models.intrinsics.network import Activation, Layer, network
from uuvsim_cosim.models.policies.policy_file import PolicyFile

__all__ = ["acts", "normed"]


def acts(file: PolicyFile, observation: ca.SX) -> ca.SX:
    """Return actions (width,) in [-1, 1] of an observation (width,), without noise."""
    y = network(_layers(file))(normed(file, observation))
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


def normed(file: PolicyFile, observation: ca.SX) -> ca.SX:
    """Shift and scale an observation as the file says."""
    if "shift" not in file.tensors:
        return observation
    shift, scale = (ca.DM(file.tensors[k].astype(float)) for k in ("shift", "scale"))
    return (observation - shift) * scale


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
