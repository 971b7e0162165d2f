"""Topics of a system: which of its signals are which ROS message, by rules or by a YAML file.

The rules look at the outputs of each component: `acc` and `gyro` are a sensor_msgs/msg/Imu, `eta`,
`nu` and `sigma` an estimated nav_msgs/msg/Odometry, and so on. Outputs without a rule become
numbers of std_msgs, in the project's units and frames. Names of frames follow REP 105: `map` is ENU
with its origin at that of NED, `base_link` is FLU at the hull's CO; hulls and sensors below a
nested system carry its name in front. Messages that need facts about a component, such as the
directions of its beams, follow only where these are known.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from uuvsim_cosim.bridge.ros2.facts import Facts, is_position_sensor
from uuvsim_cosim.bridge.ros2.messages.conversion import ANY
from uuvsim_cosim.bridge.ros2.messages.conversions import CONVERSIONS, GENERIC
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.modeline import headed
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import line_of, read_yaml
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = [
    "LATCHED",
    "QosProfile",
    "Topic",
    "Variable",
    "omitted_topics",
    "read_topics",
    "topics_of",
    "topics_text",
    "variables_of",
]


class QosProfile(NamedTuple):
    """Quality of service of a publisher, of which the last `depth` messages are kept.

    With `transient_local`, a later subscriber gets them; 0 is the default of rmw_zenoh, 42.
    """

    best_effort: bool = False
    transient_local: bool = False
    depth: int = 0


_DEFAULT = QosProfile()
LATCHED = QosProfile(transient_local=True, depth=1)


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
    qos: QosProfile = _DEFAULT

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
    frame: str  # map, base, or an axis system of its own: link, optical, sonar or scan
    unless: frozenset[str] = frozenset()  # variables of a component to which it does not apply


_RULES = (
    _Rule("nav_msgs/msg/Odometry", "odometry", {"eta": "eta", "nu": "nu", "q": "q"}, "map"),
    _Rule("tf2_msgs/msg/TFMessage", "/tf", {"eta": "eta", "q": "q"}, "map"),
    _Rule("nav_msgs/msg/Odometry", "odometry", {"eta": "eta", "nu": "nu", "sigma": "sigma"}, "map"),
    _Rule("geometry_msgs/msg/PoseStamped", "pose", {"eta": "eta_d"}, "map"),
    _Rule("geometry_msgs/msg/TwistStamped", "twist", {"nu": "nu_d"}, "base"),
    _Rule("sensor_msgs/msg/Imu", "data_raw", {"gyro": "gyro", "acc": "acc"}, "link"),
    _Rule("geometry_msgs/msg/TwistWithCovarianceStamped", "twist", {"velocity": "velocity"}, "base",
          frozenset({"position"})),
    _Rule("geometry_msgs/msg/PoseWithCovarianceStamped", "pose",
          {"position": "position", "sigma": "sigma"}, "map"),
    _Rule("sensor_msgs/msg/FluidPressure", "fluid_pressure", {"pressure": "pressure"}, "link"),
    _Rule("sensor_msgs/msg/MagneticField", "magnetic_field", {"B": "B"}, "link"),
    _Rule("sensor_msgs/msg/Range", "range", {"altitude": "altitude"}, "link",
          frozenset({"velocity", "eta"})),
    _Rule("sensor_msgs/msg/BatteryState", "state",
          {"voltage": "voltage", "state_of_charge": "state_of_charge"}, "link"),
    _Rule("sensor_msgs/msg/NavSatFix", "fix",
          {"position": "position", "sigma": "sigma", "valid": "valid"}, "link"),
    _Rule("marine_acoustic_msgs/msg/Dvl", "ping", {v: v for v in (
        "velocity", "altitude", "range", "beam_velocity", "beam_valid")}, "sonar"),
    _Rule("sensor_msgs/msg/PointCloud2", "points", {"range": "range"}, "link"),
    _Rule("sensor_msgs/msg/PointCloud2", "points", {"range": "image"}, "link"),
    _Rule("sensor_msgs/msg/LaserScan", "scan", {"range": "range"}, "scan"),
    _Rule("marine_acoustic_msgs/msg/SonarRanges", "ranges", {"range": "range"}, "sonar"),
    *(
        _Rule(f"marine_acoustic_msgs/msg/{message}", suffix, {v: v for v in (*roles, *scanning)},
              "sonar", frozenset(() if scanning else ("bearing",)))
        for scanning in ((), ("bearing",))
        for message, suffix, roles in (
            ("ProjectedSonarImage", "projected_image", ("magnitude",)),
            ("RawSonarImage", "raw_image", ("magnitude",)),
            ("SonarDetections", "detections", ("range", "magnitude")),
        )
    ),
    _Rule("sensor_msgs/msg/Image", "image", {"image": "image"}, "optical"),
    _Rule("sensor_msgs/msg/CameraInfo", "camera_info", {"image": "image"}, "optical"),
    _Rule("geometry_msgs/msg/WrenchStamped", "wrench", {"tau": "tau"}, "base"),
    _Rule("geometry_msgs/msg/WrenchStamped", "wrench", {"tau": "tau_d"}, "base"),
)  # fmt: skip


_FACTS = {
    "@directions": "the directions of the beams", "@scale": "the directions of the beams",
    "@fan": "beams in one plane", "@grid": "rows and columns",
    "@seen": "depths, not ranges, or colours",
    "@lens": "a lens without a flat port",
    "@place": "the place of the local frame on Earth",
    "@bearings": "the bearings of a sonar's beams", "@beams": "the directions of a sonar's beams",
    "@ranges": "the ranges of a sonar's bins",
}  # fmt: skip


def topics_of(variables: Mapping[str, Variable], facts: Facts | None = None) -> list[Topic]:
    """Return the topics of signals, by the rules; texts have none.

    Without `facts`, messages that need them become numbers of std_msgs.
    """
    components = _components(variables)
    topics = []
    for path, outputs in components.items():
        vehicle, _, name = path.rpartition(".")
        within = f"{vehicle.replace('.', '/')}/" if vehicle else ""
        base, topic = f"{within}base_link", f"/{within}{name}"
        frames = {"map": "map", "base": base}
        used: set[str] = set()  # by a message with a header, which a sensor's samples make
        for rule in _RULES:
            fits = _fits(rule, outputs)
            if not fits or CONVERSIONS[rule.type].needs - (facts or {}).get(path, {}).keys():
                continue
            moves = rule.type.startswith(("nav_msgs", "tf2_msgs"))
            topics.append(Topic(
                rule.suffix if rule.suffix.startswith("/") else f"{topic}/{rule.suffix}",
                rule.type, {role: f"{path}.{v}" for role, v in rule.roles.items()},
                frames.get(rule.frame, f"{within}{name}_{rule.frame}"), base if moves else "",
            ))  # fmt: skip
            used |= {*rule.roles.values(), "valid", "t_sample"}
        topics += [
            Topic(f"{topic}/{name}", GENERIC[v.kind, v.size > 0], {"data": f"{path}.{name}"})
            for name, v in outputs.items()
            if name not in used and (v.kind, v.size > 0) in GENERIC
        ]
    return [*topics, *_joints(components), *_diagnostics(components)]


def omitted_topics(variables: Mapping[str, Variable], facts: Facts) -> list[str]:
    """Return a sentence for each receiver of positions whose fixes are not published."""
    return [
        f"{path}: no sensor_msgs/msg/NavSatFix, because the place of the local frame is not known; "
        "expected a scene with a place on Earth, or --origin LAT,LON"
        for path, outputs in _components(variables).items()
        if is_position_sensor(outputs) and "@place" not in facts.get(path, {})
    ]


def variables_of(plan: Plan) -> dict[str, Variable]:
    """Return the outputs of a system that are no texts: those that are published."""
    return {
        f"{c.path}.{v.name}": Variable(
            {"F": "f", "B": "b", "U": "u"}.get(v.type[0], "i"), v.size if v.shape else 0
        )
        for c in plan.components
        for v in c.description.of("output")
        if v.type not in ("String", "Binary")
    }


def _components(variables: Mapping[str, Variable]) -> dict[str, dict[str, Variable]]:
    """Return the outputs of each component, by its path."""
    components: dict[str, dict[str, Variable]] = {}
    for name, variable in variables.items():
        path, _, last = name.rpartition(".")
        components.setdefault(path, {})[last] = variable
    return components


def _fits(rule: _Rule, outputs: Mapping[str, Variable]) -> bool:
    conversion = CONVERSIONS[rule.type]
    return not rule.unless & outputs.keys() and all(
        v in outputs and conversion.roles[role] in (ANY, max(outputs[v].size, 1))
        for role, v in rule.roles.items()
    )


def _joints(components: Mapping[str, Mapping[str, Variable]]) -> Iterator[Topic]:
    """Yield the topics of each vehicle's shafts, by their speed, and of its fins."""
    for output, kind, beside, suffix in (
        ("n", "velocity", "thrust", "thruster_states"), ("delta", "position", "tau", "joint_states")
    ):  # fmt: skip
        vehicles: dict[str, dict[str, str]] = {}
        for path, outputs in components.items():
            if output in outputs and beside in outputs and outputs[output].kind == "f":
                vehicle, _, name = path.rpartition(".")
                vehicles.setdefault(vehicle, {})[f"{kind}.{name}"] = f"{path}.{output}"
        for vehicle, signals in vehicles.items():
            within = f"/{vehicle.replace('.', '/')}" if vehicle else ""
            yield Topic(f"{within}/{suffix}", "sensor_msgs/msg/JointState", signals)


def _diagnostics(components: Mapping[str, Mapping[str, Variable]]) -> Iterator[Topic]:
    """Yield the topic of the states of sensors: whether they have a reading, and alarms."""
    signals = {
        f"{kind}.{path.replace('.', '/')}": f"{path}.{output}"
        for path, outputs in components.items()
        for kind, output in (("valid", "valid"), ("alarm", "leak"))
        if output in outputs and outputs[output].kind == "b" and not outputs[output].size
    }
    if signals:
        yield Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", signals, rate=1.0)


def read_topics(
    file: Path, variables: Mapping[str, Variable], facts: Facts | None = None
) -> list[Topic]:
    """Read a file of topics; raises InputInvalid with each mistake and its line.

    With `facts`, a message whose component lacks a fact that it needs is a mistake.
    """
    data = read_yaml(file, "topics.schema.json")
    topics: list[Topic] = []
    wrong: list[str] = []
    for i, item in enumerate(data["topics"]):
        signals = {str(role): str(name) for role, name in item["signals"].items()}
        qos = item.get("qos", {})
        topic = Topic(
            str(item["topic"]), str(item["type"]), signals, str(item.get("frame", "")),
            str(item.get("child", "")), item.get("rate"),
            QosProfile(qos.get("reliability") == "best_effort",
                       qos.get("durability") == "transient_local", int(qos.get("depth", 0))),
        )  # fmt: skip
        if any(t.name == topic.name and t.qos != topic.qos for t in topics):
            wrong.append(
                f"{file}:{line_of(data, ['topics', i])}: {topic.name}: another qos; expected that "
                "of the topic's first entry"
            )
        types = {t.type for t in topics if t.name == topic.name}
        if types - {topic.type}:
            wrong.append(
                f"{file}:{line_of(data, ['topics', i])}: {topic.name}: type {topic.type}; expected "
                f"{', '.join(types)}, as above, or another topic"
            )
        topics.append(topic)
        wrong += [f"{file}:{line_of(data, ['topics', i])}: {topic.name}: {problem}"
                  for problem in _problems(topic, variables, facts)]  # fmt: skip
    if wrong:
        raise InputInvalid.of(wrong)
    return topics


def _problems(
    topic: Topic, variables: Mapping[str, Variable], facts: Facts | None
) -> Iterable[str]:
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
    sizes = {role: conversion.size_of(role) for role in topic.signals}
    if not needed <= topic.signals.keys() or None in sizes.values():
        roles = [*conversion.roles, *(f"{prefix}.NAME" for prefix in conversion.prefixes)]
        yield f"signals {', '.join(topic.signals)}; expected {', '.join(roles)}"
        return
    for role, name in topic.signals.items():
        if sizes[role] not in (ANY, max(variables[name].size, 1)):
            yield f"{role}: {name} has {variables[name].size} elements; expected {sizes[role]}"
    kinds = {role.partition(".")[0] for role in topic.signals} if conversion.prefixes else set()
    if topic.type.endswith("JointState") and len(kinds) > 1:
        yield f"signals of {' and '.join(sorted(kinds))}; expected one kind in each topic entry"
    if facts is None:
        return
    known = facts.get(topic.component, {})
    if lacking := sorted(conversion.needs - known.keys()):
        words = ", ".join(_FACTS.get(name, f"a parameter {name}") for name in lacking)
        yield f"{topic.type} of {topic.component} needs {words}, which is not known"
        return
    scale = known.get("@scale")
    for role, name in topic.signals.items():
        if sizes[role] == ANY and scale is not None:
            size = len(scale) * (len(known["@ranges"]) if role == "magnitude" else 1)
            if variables[name].size != size:
                yield f"{role}: {name} has {variables[name].size} elements; expected {size}"


def topics_text(topics: Iterable[Topic]) -> str:
    """Return topics as the YAML text that `read_topics` reads."""
    lines = ["topics:"]
    for topic in topics:
        lines += [f"  - topic: {topic.name}", f"    type: {topic.type}"]
        lines += [f"    {k}: {v}" for k in ("frame", "child") if (v := getattr(topic, k))]
        lines += [] if topic.rate is None else [f"    rate: {topic.rate:g}"]
        qos = {"reliability: best_effort": topic.qos.best_effort,
               "durability: transient_local": topic.qos.transient_local,
               f"depth: {topic.qos.depth}": topic.qos.depth}  # fmt: skip
        if any(qos.values()):
            lines.append(f"    qos: {{{', '.join(word for word, holds in qos.items() if holds)}}}")
        pairs = ", ".join(f"{role}: {name}" for role, name in topic.signals.items())
        lines.append(f"    signals: {{{pairs}}}")
    return headed("topics", "\n".join(lines) + "\n")
