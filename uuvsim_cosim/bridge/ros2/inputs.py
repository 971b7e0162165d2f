"""Inputs of a system from ROS 2: which topic sets which of its inputs, by rules or by a YAML file.

A command moves a vehicle, so it must not outlive its sender: after `timeout` without a message, the
signals of a topic get their fail-safe values. A velocity, a force or a thruster command returns to
its start value. A pose is kept, because holding the last pose is safe.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from uuvsim_cosim.bridge.calls.service import SignalInfo
from uuvsim_cosim.bridge.ros2.messages.readings import COMMANDS
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import line_of, read_yaml

__all__ = ["KEEP", "RATE", "START", "TIMEOUT", "Input", "System", "inputs_of", "read_inputs"]

TIMEOUT = 0.5  # [s] of wall-clock time, as diff_drive_controller of ros2_control has it
RATE = 200.0  # messages per second that are used at most
START, KEEP = "start", "keep"
FailSafe = str | tuple[float, ...]


@dataclass(frozen=True)
class Input:
    """A topic: its name and type, and the signals that it sets, by role.

    A role has one signal, or the scalars of its elements in order. The role `axes` names a
    component that a person pilots. `frame` and `child` are the names of frames that headers may
    have. `fail_safe` has START, KEEP or the signal's values for a role.
    """

    name: str
    type: str
    signals: Mapping[str, tuple[str, ...]]
    frame: str = ""
    child: str = ""
    rate: float = RATE
    timeout: float = TIMEOUT
    fail_safe: Mapping[str, FailSafe] = field(default_factory=dict)

    def after_loss(self, role: str) -> FailSafe:
        """Return the fail-safe of a role: that of the file, else KEEP of a pose, else START."""
        return self.fail_safe.get(role, KEEP if role == "eta" else START)


class System(NamedTuple):
    """What a system lets clients set: its signals, and the components that a person pilots."""

    signals: Mapping[str, SignalInfo]
    pilots: Sequence[str]
    outputs: Sequence[str] = ()  # names of topics that the node publishes


class _Rule(NamedTuple):
    topic: str
    type: str
    roles: Mapping[str, str]  # role: input of a component, of six elements


_RULES = (
    _Rule("cmd_pose", "geometry_msgs/msg/PoseStamped", {"eta": "eta_d"}),
    _Rule("cmd_vel", "geometry_msgs/msg/Twist", {"nu": "nu_d"}),
    _Rule("cmd_odometry", "nav_msgs/msg/Odometry", {"eta": "eta_d", "nu": "nu_d"}),
    _Rule("cmd_wrench", "geometry_msgs/msg/Wrench", {"tau": "tau_d"}),
    _Rule("cmd_wrench", "geometry_msgs/msg/Wrench", {"tau": "tau"}),
)


def inputs_of(system: System) -> list[Input]:
    """Return the topics of a system's open inputs, by the rules.

    `/cmd_vel` pilots a component that a person pilots; `/cmd_thrusters` sets the open inputs `u` of
    a vehicle's thrusters.
    """
    chosen = []
    for path in system.pilots:
        vehicle = _above(path)
        chosen.append(
            Input(f"{vehicle}/cmd_vel", "geometry_msgs/msg/Twist", {"axes": (path,)},
                  _base(vehicle))
        )  # fmt: skip
    open_: dict[str, dict[str, SignalInfo]] = {}
    for name, info in system.signals.items():
        if info.settable and info.causality == "input" and info.type == "Float64":
            path, _, last = name.rpartition(".")
            open_.setdefault(path, {})[last] = info
    for path, inputs in open_.items():
        vehicle = _above(path)
        for rule in _RULES:
            if all(v in inputs and inputs[v].shape == (6,) for v in rule.roles.values()):
                frame = "map" if "eta" in rule.roles else _base(vehicle)
                signals = {role: (f"{path}.{v}",) for role, v in rule.roles.items()}
                chosen.append(Input(f"/{path.replace('.', '/')}/{rule.topic}", rule.type, signals,
                                    frame, _base(vehicle)))  # fmt: skip
    thrusters: dict[str, list[str]] = {}
    for path, inputs in open_.items():
        if path.rpartition(".")[2].startswith("thruster") and inputs.get("u"):
            thrusters.setdefault(_above(path), []).append(f"{path}.u")
    for vehicle, names in thrusters.items():
        chosen.append(Input(f"{vehicle}/cmd_thrusters", "std_msgs/msg/Float64MultiArray",
                            {"data": tuple(names)}))  # fmt: skip
    return [one for one in chosen if one.name not in system.outputs]


def read_inputs(file: Path, system: System) -> list[Input]:
    """Read the inputs of a file of topics; without the section `inputs`, the rules choose.

    Raises InputInvalid with each mistake and its line.
    """
    data = read_yaml(file, "topics.schema.json")
    if "inputs" not in data:
        return inputs_of(system)
    inputs: list[Input] = []
    wrong: list[str] = []
    for i, item in enumerate(data["inputs"]):
        one = _read(item)
        problems = list(_problems(one, system))
        if one.name in {other.name for other in inputs}:
            problems.append("is an input above; expected another topic")
        inputs.append(one)
        at = line_of(data, ["inputs", i])
        wrong += [f"{file}:{at}: {one.name}: {problem}" for problem in problems]
    if wrong:
        raise InputInvalid.of(wrong)
    return inputs


def _read(item: Mapping[str, Any]) -> Input:
    signals = {
        str(role): (str(names),) if isinstance(names, str) else tuple(map(str, names))
        for role, names in item["signals"].items()
    }
    fail_safe = {
        str(role): value if isinstance(value, str) else tuple(map(float, _list(value)))
        for role, value in item.get("fail_safe", {}).items()
    }
    return Input(
        str(item["topic"]), str(item["type"]), signals, str(item.get("frame", "")),
        str(item.get("child", "")), float(item.get("rate", RATE)),
        float(item.get("timeout", TIMEOUT)), fail_safe,
    )  # fmt: skip


def _list(value: Any) -> list[float]:
    return value if isinstance(value, list) else [value]


def _problems(one: Input, system: System) -> Iterator[str]:
    if one.name in system.outputs:
        yield "is a topic that this node publishes; expected another name"
    command = COMMANDS.get(one.type)
    if command is None:
        yield f"type {one.type}; expected one of {', '.join(COMMANDS)}"
        return
    if not one.signals.keys() <= command.keys() or {"nu", "axes"} <= one.signals.keys():
        expected = "nu or axes" if "axes" in command else ", ".join(command)
        yield f"signals {', '.join(one.signals)}; expected {expected}"
        return
    if one.timeout * one.rate < 2.0:
        yield f"timeout {one.timeout:g} s at rate {one.rate:g}; expected two periods or more"
    for role in one.fail_safe.keys() - one.signals.keys():
        yield f"fail_safe of {role}; expected one of {', '.join(one.signals)}"
    for role, names in one.signals.items():
        if role == "axes":
            if unknown := [name for name in names if name not in system.pilots]:
                pilots = ", ".join(system.pilots) or "`--replace pilot=keyboard`, which makes one"
                yield f"axes: {unknown[0]} is no component that a person pilots; expected {pilots}"
            continue
        yield from _of_signals(role, names, command[role][1], one, system)


def _of_signals(
    role: str, names: Sequence[str], expected: int, one: Input, system: System
) -> Iterator[str]:
    size = 0
    for name in names:
        if name not in system.signals:
            settable = sorted(n for n, info in system.signals.items() if info.settable)
            yield f"no signal {name!r}; expected {expected_names(name, settable)}"
            return
        info = system.signals[name]
        if not info.settable:
            yield f"{name} cannot be set; expected an unconnected input or a tunable parameter"
        elif info.type not in ("Float64", "Float32"):
            yield f"{name} has type {info.type}; expected Float64"
        size += _size(info)
    if expected and size != expected:
        yield f"{role}: {', '.join(names)} has {size} elements; expected {expected}"
    value = one.fail_safe.get(role)
    if isinstance(value, tuple) and len(value) != size:
        yield f"fail_safe of {role} has {len(value)} numbers; expected {size}"


def _size(info: SignalInfo) -> int:
    size = 1
    for n in info.shape:
        size *= n
    return size


def _above(path: str) -> str:
    """Return the name of the vehicle that a component is part of, as it begins a topic."""
    vehicle = path.rpartition(".")[0]
    return f"/{vehicle.replace('.', '/')}" if vehicle else ""


def _base(vehicle: str) -> str:
    return f"{vehicle}/base_link".removeprefix("/")
