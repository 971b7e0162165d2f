"""A policy as ONNX: observation (n, width) in, actions (n, width) in [-1, 1] out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policy import Policy

__all__ = ["write_onnx"]

OPSET = 17


def write_onnx(policy: Policy, out: Path) -> list[Path]:
    """Write a policy; raises InputInvalid without onnx, and for a policy of kind "sequence"."""
    if policy.kind == "sequence":
        raise InputInvalid("a policy of kind 'sequence' as .onnx; expected .fmu or .pth")
    try:
        import onnx
    except ModuleNotFoundError:
        raise InputInvalid(
            f"{out}: onnx is missing; expected the extra rl, `pip install 'uuvsim-cosim[rl]'`"
        ) from None
    model = _model(onnx, policy)
    onnx.checker.check_model(model, full_check=True)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(out, model.SerializeToString(deterministic=True))
    except OSError as error:
        raise InputInvalid(
            f"{out}: cannot be written ({error.strerror}); expected a folder that can be written"
        ) from error
    return [out]


def _model(onnx: Any, policy: Policy) -> Any:
    make, tensor = onnx.helper, onnx.numpy_helper.from_array
    constants = {k: np.ascontiguousarray(v, np.float32) for k, v in policy.tensors.items()}
    constants |= {"low": np.full((), -1.0, np.float32), "high": np.full((), 1.0, np.float32)}
    nodes: list[Any] = []
    at = "observation"

    def then(kind: str, *more: str, out: str = "", **attributes: Any) -> None:
        nonlocal at
        name = out or f"x{len(nodes)}"
        nodes.append(make.make_node(kind, [at, *more], [name], **attributes))
        at = name

    if "shift" in policy.tensors:
        then("Sub", "shift")
        then("Mul", "scale")
    for i in range(policy.depth):
        then("Gemm", f"{i}.weight", f"{i}.bias", transB=1)
        if i + 1 < policy.depth:
            then("Relu" if policy.activation == "relu" else "Tanh")
    if policy.kind == "grid":
        then("ArgMax", axis=1, keepdims=0)
        nodes.append(make.make_node("Gather", ["grid", at], ["chosen"], axis=0))
        at = "chosen"
    elif policy.kind == "tanh":
        then("Tanh")
    then("Clip", "low", "high", out="action")
    number = onnx.TensorProto.FLOAT
    used = {name for node in nodes for name in node.input}
    graph = make.make_graph(
        nodes,
        "policy",
        [make.make_tensor_value_info("observation", number, ["n", len(policy.observation)])],
        [make.make_tensor_value_info("action", number, ["n", len(policy.action)])],
        [tensor(np.asarray(v), k) for k, v in sorted(constants.items()) if k in used],
    )
    model = make.make_model(
        graph, opset_imports=[make.make_opsetid("", OPSET)], producer_name="uuvsim-cosim"
    )
    model.ir_version = 8  # what runtimes of 2022 and later read
    told = {"task": policy.task, "options": json.dumps(dict(policy.options), sort_keys=True),
            "observation": ", ".join(o.name for o in policy.observation),
            "action": ", ".join(a.name for a in policy.action)}  # fmt: skip
    make.set_model_props(model, told)
    return model
