"""Messages about the state of parts: joints of a vehicle, and diagnostics of its sensors.

Roles of joints are ``velocity.<joint>`` [rad/s] or ``position.<joint>`` [rad]; a signal of k
elements makes joints ``<joint>_1`` to ``<joint>_k``. Roles of diagnostics are ``valid.<name>`` (0
is a warning) and ``alarm.<name>`` (1 is an error).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.messages.conversion import ANY, Conversion, Shape, Values

__all__ = ["STATE_CONVERSIONS"]

_OK, _WARN, _ERROR = 0, 1, 2
_WORDS = {
    ("valid", True): (_OK, "valid reading"), ("valid", False): (_WARN, "no valid reading"),
    ("alarm", False): (_OK, "no alarm"), ("alarm", True): (_ERROR, "alarm"),
}  # fmt: skip


def _joined(v: Values, kind: str) -> Array:
    """Return the values (n, joints) of one kind."""
    found = [x.reshape(len(x), -1) for role, x in v.items() if role.startswith(f"{kind}.")]
    return np.concatenate(found, axis=1) if found else np.zeros((1, 0))


def _joints(v: Values, _: object) -> dict[str, Array]:
    return {kind: x for kind in ("position", "velocity") if (x := _joined(v, kind)).size}


def _joint_shape(v: Values, _: object) -> Shape:
    names: dict[str, None] = {}
    for role, x in v.items():
        joint, k = role.partition(".")[2], x[0].size
        names |= dict.fromkeys([joint] if x.ndim == 1 else [f"{joint}_{i + 1}" for i in range(k)])
    lengths = {kind: _joined(v, kind).shape[1] for kind in ("position", "velocity")}
    texts = {f"name.{i}": name for i, name in enumerate(names)}
    return Shape(texts, {**lengths, "name": len(names)})


def _states(v: Values) -> Iterator[tuple[str, Array, int, str]]:
    """Yield the name of each status, its values, and the level and words of its first row."""
    for role, x in v.items():
        kind, _, name = role.partition(".")
        yield name, x, *_WORDS[kind, bool(x[0])]


def _levels(v: Values, _: object) -> dict[str, Array]:
    return {f"status.{i}.level": np.array([s[2]]) for i, s in enumerate(_states(v))}


def _status_shape(v: Values, _: object) -> Shape:
    texts: dict[str, str] = {}
    for i, (name, _values, _level, words) in enumerate(_states(v)):
        texts |= {f"status.{i}.name": name, f"status.{i}.message": words}
    return Shape(texts, {"status": len(v)})


STATE_CONVERSIONS = {
    "sensor_msgs/msg/JointState": Conversion(
        {}, _joints, prefixes={"position": ANY, "velocity": ANY}, shape=_joint_shape
    ),
    "diagnostic_msgs/msg/DiagnosticArray": Conversion(
        {}, _levels, prefixes={"valid": 1, "alarm": 1}, shape=_status_shape, has_states=True
    ),
}
