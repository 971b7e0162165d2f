"""Trained policy as data: tensors, observed numbers, actions; it acts with NumPy alone.

A file `*.npz` holds the tensors and one JSON text, but no code, so a file from a source that is not
trusted can be read.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, final, get_args

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policies.runner_sequence import Remembering

__all__ = ["Named", "Policy", "SequenceRunner", "begin", "network"]

Array = NDArray[np.float32]
Kind = Literal["tanh", "clip", "grid", "sequence"]
FORMAT = 1  # incremented when older files cannot be read any more


@dataclass(frozen=True)
class Named:
    """One number of an observation or of an action, with its limits in its unit."""

    name: str
    low: float
    high: float
    unit: str = "1"


@dataclass(frozen=True)
class Policy:
    """Trained policy: a map of observations (n, width) to actions (n, width) in [-1, 1].

    A call of the policy returns actions. `observation` and `action` name each number and its
    limits. The layers are the `tensors` "0.weight" (out, in), "0.bias" (out,), "1.weight", …, with
    the `activation` "relu" or "tanh" between them. If there are tensors "shift" and "scale", an
    observation o is first replaced by (o - shift) * scale. `kind` is the function of the last
    layer:

    - "tanh": the mean of a squashed Gaussian;
    - "clip": clipping to [-1, 1];
    - "grid": the row with the greatest value of the tensor "grid" (choices, width);
    - "sequence": the policy is a decision transformer, whose form is in `settings`. It needs a
      history; `acting_in` returns a function that keeps one.

    `task` and `options` make the task on which the policy was trained. `agent` is the agent that it
    is for, "" for all agents. `trained` describes the training. Raises InputInvalid for tensors
    that do not fit each other, the observation or the action, and for tensors with NaN.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.learn import Policy, load_policies
    >>> (policy,) = load_policies("source_sac")
    >>> policy.kind, policy.depth
    ('tanh', 3)
    >>> policy(np.zeros((4, 31))).shape  # four observations
    (4, 2)
    >>> file = policy.with_training(remark="renamed").save("mine.npz")
    >>> Policy.load(file).trained["remark"]
    'renamed'
    """

    kind: Kind
    tensors: Mapping[str, Array]
    observation: tuple[Named, ...]
    action: tuple[Named, ...]
    task: str
    options: Mapping[str, object] = field(default_factory=dict)
    activation: Literal["relu", "tanh"] = "relu"
    agent: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    trained: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse tensors that do not fit each other, or the observation and the action."""
        for what, given, known in (
            ("kind", self.kind, get_args(Kind)),
            ("activation", self.activation, ("relu", "tanh")),
        ):
            if given not in known:
                raise InputInvalid("policy", f"{what} {given!r}", f"one of {', '.join(known)}")
        for name, tensor in self.tensors.items():
            if not np.all(np.isfinite(tensor)):
                raise InputInvalid("policy", f"tensor {name!r} has NaN or infinity", "numbers")
        if self.kind == "sequence":
            return
        width = len(self.observation)
        for i in range(self.depth):
            weight, bias = self.tensors[f"{i}.weight"], self.tensors.get(f"{i}.bias")
            if weight.ndim != 2 or weight.shape[1] != width:
                raise InputInvalid(
                    "policy", f"tensor '{i}.weight' of shape {weight.shape}", f"(…, {width})"
                )
            width = len(weight)
            if bias is None or bias.shape != (width,):
                raise InputInvalid("policy", f"tensor '{i}.bias'", f"one of shape ({width},)")
        wanted = len(self.action)
        if self.kind == "grid":
            grid = self.tensors.get("grid")
            if grid is None or grid.shape != (width, wanted):
                raise InputInvalid("policy", "tensor 'grid'", f"shape ({width}, {wanted})")
        elif width != wanted or not self.depth:
            raise InputInvalid(
                "policy", f"its last layer has {width} outputs", f"{wanted}, one an action"
            )

    @property
    def depth(self) -> int:
        """The number of layers."""
        return sum(name.endswith(".weight") and name[:-7].isdigit() for name in self.tensors)

    def __call__(self, observation: NDArray[np.generic]) -> NDArray[np.float64]:
        """Act without noise; raises InputInvalid for "sequence", which needs a history."""
        if self.kind == "sequence":
            raise InputInvalid("policy", "a transformer acts on a history", "its runner")
        x = np.asarray(observation, np.float32)
        if x.ndim != 2 or x.shape[1] != len(self.observation):
            raise InputInvalid(
                f"policy of {self.task}",
                f"observations of shape {x.shape}",
                f"(n, {len(self.observation)})",
            )
        x = network(self.tensors, x, self.depth, self.activation)
        if self.kind == "grid":
            x = self.tensors["grid"][np.argmax(x, axis=1)]
        elif self.kind == "tanh":
            x = np.tanh(x)
        return np.asarray(np.clip(x, -1.0, 1.0), np.float64)

    def with_training(self, **trained: object) -> Policy:
        """Return the same policy with further entries of `trained`."""
        return replace(self, trained={**self.trained, **trained})

    told = with_training  # its former name

    # ---- files ----------------------------------------------------------------------------

    def save(self, path: str | Path) -> Path:
        """Write the file `path` (.npz), whole or not at all; equal policies give equal bytes."""
        path = Path(path)
        head = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "tensors"}
        for name in ("observation", "action"):
            head[name] = [asdict(one) for one in head[name]]
        text = json.dumps({"uuvsim_policy": FORMAT, **head}, sort_keys=True)
        tensors = {k: np.ascontiguousarray(v, np.float32) for k, v in self.tensors.items()}

        buffer = io.BytesIO()
        np.savez_compressed(buffer, head=np.frombuffer(text.encode(), np.uint8), **tensors)  # type: ignore[arg-type]
        write_whole(path, buffer.getvalue())
        return path

    @classmethod
    def load(cls, path: str | Path) -> Policy:
        """Read the file `path` (.npz).

        Raises InputInvalid for a file that is truncated, is not a policy, or has another format.
        """
        path = Path(path)
        if not path.is_file():
            raise InputInvalid(path, "no such file", "a policy (.npz)")
        try:
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as read:
                tensors = {name: read[name] for name in read.files}
            head = json.loads(bytes(tensors.pop("head")))
            version = head.pop("uuvsim_policy")
        except (ValueError, KeyError, TypeError, OSError, EOFError, zipfile.BadZipFile) as error:
            beside = " (best.npz, beside its checkpoint)" if path.suffix == ".pt" else ""
            raise InputInvalid(
                path,
                f"no policy, or not all of one ({type(error).__name__})",
                f"a whole policy as `uuvsim train` writes it{beside}",
            ) from None
        if version != FORMAT:
            raise InputInvalid(path, f"format {version}", FORMAT)
        for name in ("observation", "action"):
            head[name] = tuple(Named(**one) for one in head[name])
        try:
            return cls(tensors=tensors, **head)
        except (InputInvalid, TypeError) as error:
            raise InputInvalid(f"{path}: {error}") from None


def network(
    tensors: Mapping[str, Array], x: Array, depth: int, activation: str, before: str = ""
) -> Array:
    """Return the last layer (n, out) of a multilayer perceptron for inputs x (n, in), float32."""
    if "shift" in tensors and not before:
        x = (x - tensors["shift"]) * tensors["scale"]
    for i in range(depth):
        x = x @ tensors[f"{before}{i}.weight"].T + tensors[f"{before}{i}.bias"]
        if i + 1 < depth:
            x = np.maximum(x, np.float32(0)) if activation == "relu" else np.tanh(x)
    return np.asarray(x, np.float32)


def names_of(low: Array, high: Array, names: Sequence[str] = ()) -> tuple[Named, ...]:
    """Pair names with limits; by default the names are "o[1]", "o[2]", …."""
    names = names or [f"o[{i + 1}]" for i in range(len(low))]
    return tuple(Named(n, float(a), float(b)) for n, a, b in zip(names, low, high, strict=True))


def begin(policy: object) -> None:
    """Clear the memory of a policy that has one, at the start of episodes."""
    if isinstance(policy, SequenceRunner):
        policy.begin()


@final
class SequenceRunner:
    """Decision transformer with its history, as a function; call `begin` before new episodes.

    The return to go falls by the setting `reward` with each action, since the observations do not
    contain rewards. Raises InputInvalid for a policy that is not a complete decision transformer.
    """

    def __init__(self, policy: Policy) -> None:
        seen, acts = len(policy.observation), len(policy.action)
        try:
            if policy.kind != "sequence":
                raise ValueError(f"kind {policy.kind!r}")
            self._acts = Remembering(policy.tensors, policy.settings)
            if self._acts.widths[1:] != (seen, acts):
                raise ValueError(f"{self._acts.widths[1:]} numbers for {(seen, acts)}")
            if not np.all(np.isfinite(self._acts(np.zeros((1, seen))))):  # its tensors fit
                raise ValueError("an action that is no number")
        except (KeyError, ValueError, TypeError, IndexError, ZeroDivisionError) as error:
            raise InputInvalid(
                f"policy of {policy.task}",
                error,
                "a decision transformer, with its settings and tensors",
            ) from None
        self.policy = policy
        self.begin()

    def begin(self) -> None:
        """Clear the history: the next observations are the first ones of new episodes."""
        self._acts.begin()

    def __call__(self, observation: NDArray[np.generic]) -> NDArray[np.float64]:
        """Return actions (n, width) for observations (n, width), the next ones of the episodes."""
        o = np.asarray(observation, np.float32)
        seen, before = len(self.policy.observation), self._acts.history
        if o.ndim != 2 or o.shape[1] != seen:
            raise InputInvalid(
                f"policy of {self.policy.task}", f"observations of shape {o.shape}", f"(n, {seen})"
            )
        if before and len(before[0]) != len(o):
            raise InputInvalid(
                f"policy of {self.policy.task}",
                f"{len(o)} episodes after {len(before[0])}",
                "as many, or begin()",
            )
        return np.asarray(self._acts(o), np.float64)
