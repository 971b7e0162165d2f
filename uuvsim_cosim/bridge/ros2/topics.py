"""Topics of a system: which of its signals are which ROS message, by rules or by a YAML file.

The rules look at the outputs of each component: `acc` and `gyro` are a sensor_msgs/msg/Imu, `eta`,
`nu` and `sigma` an estimated nav_msgs/msg/Odometry, and so on. Outputs without a rule become
numbers of std_msgs, in the project's units and frames. Names of frames follow REP 105: `map` is ENU
with its origin at that of NED, `base_link` is FLU at the hull's CO; hulls and sensors below a
nested system carry its name in front.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from uuvsim_cosim.bridge.ros2.conversions import CONVERSIONS, GENERIC
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.modeline import headed
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import line_of, read_yaml

__all__ = ["Topic", "Variable", "read_topics", "topics_of", "topics_text"]


@dataclass(frozen=True)
class Topic:
    """A topic: its name and type, the frame of its header, and its signals by role.

    `child` is the frame that moves in `frame`. At most `rate` messages per second; None: as many as
    there are.
    """

    name: str
    type: str
    signals: Mapping[str, str] = field(default_factory=dict)
    frame: str = ""
    child: str = ""
    rate: float | None = None

    @property
    def component(self) -> str:
        """The component whose samples and parameters count: that of the first signal."""
        return next(iter(self.signals.values())).rpartition(".")[0]


class Variable(NamedTuple):
    """Numbers of a signal: their kind, as NumPy's dtype.kind, and how many (0: a scalar)."""

    kind: str
    size: int


class _Rule(NamedTuple):
    type: str
    suffix: str
    roles: Mapping[str, str]  # role: variable
    frame: str  # map, base or own
    unless: frozenset[str] = frozenset()  # variables of a component to which it does not apply


_RULES = (
    _Rule("nav_msgs/msg/Odometry", "odometry", {"eta": "eta", "nu": "nu", "q": "q"}, "map"),
    _Rule("tf2_msgs/msg/TFMessage", "/tf", {"eta": "eta", "q": "q"}, "map"),
    _Rule("nav_msgs/msg/Odometry", "odometry", {"eta": "eta", "nu": "nu", "sigma": "sigma"}, "map"),
    _Rule("geometry_msgs/msg/PoseStamped", "pose", {"eta": "eta_d"}, "map"),
    _Rule("geometry_msgs/msg/TwistStamped", "twist", {"nu": "nu_d"}, "base"),
    _Rule("sensor_msgs/msg/Imu", "data_raw", {"gyro": "gyro", "acc": "acc"}, "own"),
    _Rule("geometry_msgs/msg/TwistWithCovarianceStamped", "twist", {"velocity": "velocity"}, "base",
          frozenset({"position"})),
    _Rule("geometry_msgs/msg/PoseWithCovarianceStamped", "pose",
          {"position": "position", "sigma": "sigma"}, "map"),
    _Rule("sensor_msgs/msg/FluidPressure", "fluid_pressure", {"pressure": "pressure"}, "own"),
    _Rule("sensor_msgs/msg/MagneticField", "magnetic_field", {"B": "B"}, "own"),
    _Rule("sensor_msgs/msg/Range", "range", {"altitude": "altitude"}, "own",
          frozenset({"velocity", "eta"})),
    _Rule("sensor_msgs/msg/BatteryState", "state",
          {"voltage": "voltage", "state_of_charge": "state_of_charge"}, "own"),
    _Rule("geometry_msgs/msg/WrenchStamped", "wrench", {"tau": "tau"}, "base"),
    _Rule("geometry_msgs/msg/WrenchStamped", "wrench", {"tau": "tau_d"}, "base"),
)  # fmt: skip


def topics_of(variables: Mapping[str, Variable]) -> list[Topic]:
    """Return the topics of signals, by the rules; texts have none."""
    components: dict[str, dict[str, Variable]] = {}
    for name, variable in variables.items():
        path, _, last = name.rpartition(".")
        components.setdefault(path, {})[last] = variable
    topics = []
    for path, outputs in components.items():
        vehicle = path.rpartition(".")[0].replace(".", "/")
        base = f"{vehicle}/base_link".removeprefix("/")
        topic = "/" + path.replace(".", "/")
        frames = {"map": "map", "base": base, "own": f"{topic[1:]}_link"}
        used: set[str] = set()  # by a message with a header, which a sensor's samples make
        for rule in _RULES:
            conversion = CONVERSIONS[rule.type]
            fits = all(
                v in outputs and max(outputs[v].size, 1) == conversion.roles[role]
                for role, v in rule.roles.items()
            )
            if not fits or rule.unless & outputs.keys():
                continue
            moves = rule.type.startswith(("nav_msgs", "tf2_msgs"))
            topics.append(Topic(
                rule.suffix if rule.suffix.startswith("/") else f"{topic}/{rule.suffix}",
                rule.type, {role: f"{path}.{v}" for role, v in rule.roles.items()},
                frames[rule.frame], base if moves else "",
            ))  # fmt: skip
            used |= {*rule.roles.values(), "valid", "t_sample"}
        topics += [
            Topic(f"{topic}/{name}", GENERIC[v.kind, v.size > 0], {"data": f"{path}.{name}"})
            for name, v in outputs.items()
            if name not in used and (v.kind, v.size > 0) in GENERIC
        ]
    return topics


def read_topics(file: Path, variables: Mapping[str, Variable]) -> list[Topic]:
    """Read a file of topics; raises InputInvalid with each mistake and its line."""
    data = read_yaml(file, "topics.schema.json")
    topics: list[Topic] = []
    wrong: list[str] = []
    for i, item in enumerate(data["topics"]):
        signals = {str(role): str(name) for role, name in item["signals"].items()}
        topic = Topic(str(item["topic"]), str(item["type"]), signals, str(item.get("frame", "")),
                      str(item.get("child", "")), item.get("rate"))  # fmt: skip
        types = {t.type for t in topics if t.name == topic.name}
        if types - {topic.type}:
            wrong.append(
                f"{file}:{line_of(data, ['topics', i])}: {topic.name}: type {topic.type}; expected "
                f"{', '.join(types)}, as above, or another topic"
            )
        topics.append(topic)
        wrong += [f"{file}:{line_of(data, ['topics', i])}: {topic.name}: {problem}"
                  for problem in _problems(topic, variables)]  # fmt: skip
    if wrong:
        raise InputInvalid.of(wrong)
    return topics


def _problems(topic: Topic, variables: Mapping[str, Variable]) -> Iterable[str]:
    for name in topic.signals.values():
        if name not in variables:
            yield f"no signal {name!r}; expected {expected_names(name, sorted(variables))}"
            return
    if topic.type in GENERIC.values():
        fitting = [variables[name] for name in topic.signals.values()]
        if list(topic.signals) != ["data"]:
            yield f"signals {', '.join(topic.signals)}; expected data"
        elif GENERIC.get((fitting[0].kind, fitting[0].size > 0)) != topic.type:
            expected = GENERIC.get((fitting[0].kind, fitting[0].size > 0), "another signal")
            yield f"type {topic.type} of {topic.signals['data']}; expected {expected}"
        return
    if topic.type not in CONVERSIONS:
        yield f"type {topic.type}; expected {', '.join((*CONVERSIONS, *GENERIC.values()))}"
        return
    conversion = CONVERSIONS[topic.type]
    needed = conversion.roles.keys() - conversion.optional
    if not needed <= topic.signals.keys() <= conversion.roles.keys():
        yield f"signals {', '.join(topic.signals)}; expected {', '.join(conversion.roles)}"
        return
    for role, name in topic.signals.items():
        if max(variables[name].size, 1) != conversion.roles[role]:
            yield f"{role}: {name} has {variables[name].size} elements; expected " + str(
                conversion.roles[role]
            )


def topics_text(topics: Iterable[Topic]) -> str:
    """Return topics as the YAML text that `read_topics` reads."""
    lines = ["topics:"]
    for topic in topics:
        lines += [f"  - topic: {topic.name}", f"    type: {topic.type}"]
        lines += [f"    {k}: {v}" for k in ("frame", "child") if (v := getattr(topic, k))]
        lines += [] if topic.rate is None else [f"    rate: {topic.rate:g}"]
        pairs = ", ".join(f"{role}: {name}" for role, name in topic.signals.items())
        lines.append(f"    signals: {{{pairs}}}")
    return headed("topics", "\n".join(lines) + "\n")
