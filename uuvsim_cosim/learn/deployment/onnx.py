"""A policy as ONNX: observation (n, width) in, actions (n, width) in [-1, 1] out.

A decision transformer has its memory as values: `history` (n, K, 1 + observed + acted) and `past`
go in, zeros before an episode, and `history_next` and `past_next` come out, for the next call.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policies.policy import Policy

__all__ = ["onnx_model"]

OPSET = 17
Port = tuple[str, int, list[object]]  # name, element type, shape


def onnx_model(policy: Policy, place: Path) -> bytes:
    """Return a policy's model; raises InputInvalid for the file `place` without onnx."""
    try:
        import onnx
    except ModuleNotFoundError:
        raise InputInvalid(
            place, "onnx is missing", "the extra rl, `pip install 'uuvsim-cosim[rl]'`"
        ) from None
    make, number, count = onnx.helper, onnx.TensorProto.FLOAT, onnx.TensorProto.INT64
    graph, properties = _Graph(make), {"task": policy.task}
    takes: list[Port] = [("observation", number, ["n", len(policy.observation)])]
    gives: list[Port] = [("action", number, ["n", len(policy.action)])]
    if policy.kind == "sequence":
        _sequence(graph, policy)
        width = 1 + len(policy.observation) + len(policy.action)
        places = ["n", int(policy.settings["context"]), width]
        for what, kind, shape in (("history", number, places), ("past", count, [])):
            takes.append((what, kind, shape))
            gives.append((f"{what}_next", kind, shape))
        properties["settings"] = json.dumps(dict(policy.settings), sort_keys=True)
    else:
        _perceptron(graph, policy)
    made = make.make_graph(
        graph.nodes,
        "policy",
        [make.make_tensor_value_info(*one) for one in takes],
        [make.make_tensor_value_info(*one) for one in gives],
        [onnx.numpy_helper.from_array(v, k) for k, v in sorted(graph.constants.items())],
    )
    model = make.make_model(
        made, opset_imports=[make.make_opsetid("", OPSET)], producer_name="uuvsim-cosim"
    )
    model.ir_version = 8  # what runtimes of 2022 and later read
    properties |= {"options": json.dumps(dict(policy.options), sort_keys=True),
             "observation": ", ".join(o.name for o in policy.observation),
             "action": ", ".join(a.name for a in policy.action)}  # fmt: skip
    make.set_model_props(model, properties)
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)
    return content


class _Graph:
    """Nodes and constants of a model; a call appends a node and returns the name of its output."""

    def __init__(self, make: Any) -> None:
        self.make, self.nodes = make, list[object]()
        self.constants: dict[str, NDArray[np.generic]] = {}

    def __call__(self, kind: str, *of: object, out: str = "", **attributes: object) -> str:
        """Append a node of names, arrays and whole numbers."""
        name = out or f"x{len(self.nodes)}"
        names = [x if isinstance(x, str) else self.constant(np.asarray(x)) for x in of]
        self.nodes.append(self.make.make_node(kind, names, [name], **attributes))
        return name

    def constant(self, value: object, name: str = "") -> str:
        """Add a constant; return its name."""
        name = name or f"c{len(self.constants)}"
        self.constants[name] = np.array(value, order="C")
        return name

    def tensor(self, policy: Policy, name: str) -> str:
        """Add a tensor of the policy under its name; return the name."""
        return self.constant(np.asarray(policy.tensors[name], np.float32), name)


def _normed(graph: _Graph, policy: Policy) -> str:
    if "shift" not in policy.tensors:
        return "observation"
    shift, scale = (graph.tensor(policy, name) for name in ("shift", "scale"))
    return graph("Mul", graph("Sub", "observation", shift), scale)


def _perceptron(graph: _Graph, policy: Policy) -> None:
    x = _normed(graph, policy)
    for i in range(policy.depth):
        layer = (graph.tensor(policy, f"{i}.{what}") for what in ("weight", "bias"))
        x = graph("Gemm", x, *layer, transB=1)
        if i + 1 < policy.depth:
            x = graph("Relu" if policy.activation == "relu" else "Tanh", x)
    if policy.kind == "grid":
        chosen = graph("ArgMax", x, axis=1, keepdims=0)
        x = graph("Gather", graph.tensor(policy, "grid"), chosen, axis=0)
    elif policy.kind == "tanh":
        x = graph("Tanh", x)
    graph("Clip", x, np.float32(-1), np.float32(1), out="action")


def _sequence(graph: _Graph, policy: Policy) -> None:
    """Write the equations of runner_sequence.py; steps before the episode are masked."""
    s, acted = policy.settings, len(policy.action)
    K, heads = int(s["context"]), int(s["heads"])
    hidden, times = (len(policy.tensors[f"{k}.weight"]) for k in ("norm", "embed_time"))

    def linear(name: str, x: str) -> str:
        weight = graph.constant(policy.tensors[f"{name}.weight"].T, f"{name}.weight")
        return graph("Add", graph("MatMul", x, weight), graph.tensor(policy, f"{name}.bias"))

    def norm(name: str, x: str) -> str:
        given = (graph.tensor(policy, f"{name}.{what}") for what in ("weight", "bias"))
        return graph("LayerNormalization", x, *given, axis=-1, epsilon=1e-5)

    def activated(x: str) -> str:
        if s.get("activation", "gelu") == "relu":
            return graph("Relu", x)
        erf = graph("Erf", graph("Mul", x, np.float32(math.sqrt(0.5))))
        half = graph("Mul", x, np.float32(0.5))
        return graph("Mul", half, graph("Add", erf, np.float32(1)))

    def attention(at: str, x: str) -> str:
        parts = graph("Reshape", linear(f"{at}qkv", x), [0, 0, 3, heads, hidden // heads])
        parts = graph("Transpose", parts, perm=[2, 0, 3, 1, 4])
        q, k, v = (graph("Gather", parts, i, axis=0) for i in range(3))
        score = graph("MatMul", q, graph("Transpose", k, perm=[0, 1, 3, 2]))
        score = graph("Div", score, np.float32(math.sqrt(hidden // heads)))
        weights = graph("Softmax", graph("Where", seen, score, np.float32(-1e30)), axis=-1)
        mixed = graph("Transpose", graph("MatMul", weights, v), perm=[0, 2, 1, 3])
        return linear(f"{at}out", graph("Reshape", mixed, [0, 0, hidden]))

    # The present goes into the last place, and the oldest place is dropped; in float64, as in the
    # runners.
    spent = graph("Mul", graph("Cast", "past", to=11), np.float64(s.get("reward", 0.0)))
    to_go = graph("Sub", np.float64(s["return_to_go"]), spent)
    to_go = graph("Div", to_go, np.float64(s.get("return_scale", 1.0)))
    n = graph("Shape", "observation", end=1)
    R = graph("Expand", graph("Cast", to_go, to=1), graph("Concat", n, [1], axis=0))
    nothing = graph("Expand", np.float32(0), graph("Concat", n, [acted], axis=0))
    o = _normed(graph, policy)
    before = graph("Slice", "history", [1], [K], [1])

    def places(action: str, out: str = "") -> str:
        now = graph("Unsqueeze", graph("Concat", R, o, action, axis=1), [1])
        return graph("Concat", before, now, axis=1, out=out)

    # Three tokens a place, without the last action; places before the episode are masked.
    steps = graph("Add", "past", np.arange(1 - K, 1))
    time = graph("Gather", graph.tensor(policy, "embed_time.weight"),
                 graph("Clip", steps, np.int64(0), np.int64(times - 1)), axis=0)  # fmt: skip
    there = graph("Gather", graph("GreaterOrEqual", steps, 0), np.arange(3 * K - 1) // 3, axis=0)
    seen = graph("And", np.tri(3 * K - 1, dtype=bool), there)
    ends, tokens, at = np.cumsum([0, 1, len(policy.observation), acted]), [], places(nothing)
    for i, name in enumerate(("embed_return", "embed_observation", "embed_action")):
        part = graph("Slice", at, ends[i : i + 1], ends[i + 1 : i + 2], [2])
        tokens.append(graph("Unsqueeze", graph("Add", linear(name, part), time), [2]))
    x = graph("Reshape", graph("Concat", *tokens, axis=2), [0, 3 * K, hidden])
    x = norm("embed_norm", graph("Slice", x, [0], [3 * K - 1], [1]))
    for i in range(sum(name.endswith(".norm_1.weight") for name in policy.tensors)):
        b = f"blocks.{i}."
        x = graph("Add", x, attention(f"{b}attention.", norm(f"{b}norm_1", x)))
        wide = activated(linear(f"{b}wide", norm(f"{b}norm_2", x)))
        x = graph("Add", x, linear(f"{b}narrow", wide))
    last = norm("norm", graph("Gather", x, -1, axis=1))
    places(graph("Tanh", linear("head", last), out="action"), out="history_next")
    graph("Add", "past", 1, out="past_next")
