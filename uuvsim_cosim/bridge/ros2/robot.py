"""Vehicles as ROS sees them: the frames of their parts, /tf_static, and URDF texts.

A vehicle is a hull (a component whose output `eta` follows from an input `tau`). Parts beside it
are sensors, by `r_s` and `Theta_s`; thrusters, by `r` and `e` of the component that adds their
forces; and fins, by `r` and `a`. A thruster's frame has x along its positive thrust; a fin's has z
along its hinge. All frames are FLU (frames.py).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, unquote
from xml.sax.saxutils import quoteattr

import numpy as np

from uuvsim_cosim.bridge.ros2.cdr import MessageLayout
from uuvsim_cosim.bridge.ros2.facts import Facts, facts_of
from uuvsim_cosim.bridge.ros2.frames import Array, body, body_quaternion, euler_quaternion
from uuvsim_cosim.bridge.ros2.topic_writer import TRANSFORMS
from uuvsim_cosim.bridge.ros2.topics import Topic
from uuvsim_cosim.models.declaration.library import LIBRARY
from uuvsim_cosim.models.declaration.parameter_files import Size, is_vehicle, vehicle_size
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["STRING", "Part", "Robot", "mounted", "robots_of", "text_message"]

STRING = "std_msgs/msg/String"
_HALF = np.sqrt(0.5)
# Frames of an instrument beside its link, by the fact that it has: quaternion x y z w.
_OWN = (1.0, 0.0, 0.0, 0.0)  # z along the view
_AHEAD = (_HALF, 0.0, _HALF, 0.0)  # z ahead, x up, y to starboard
_AXES = (
    ("@bearings", "sonar", _AHEAD),
    ("@seen", "optical", _OWN),
    ("tilt", "sonar", _OWN),
    ("@fan", "sonar", _OWN),
    ("@fan", "scan", (_HALF, 0.0, -_HALF, 0.0)),  # x along the view, y as its own
)


@dataclass(frozen=True)
class Part:
    """A frame below another one: position (3,) [m] and quaternion x y z w (4,) in that one.

    A fin turns about its z axis within ±`limit` [rad].
    """

    name: str
    above: str
    r: tuple[float, ...]
    q: tuple[float, ...]
    kind: str  # sensor, axes, thruster or fin
    limit: float = 0.0

    @property
    def joint(self) -> str:
        """The name of the joint that holds it: that of a fin is the one in joint states."""
        if self.kind == "fin":
            return self.name.rpartition("/")[2].removesuffix("_link")
        return f"{self.name}_joint"


@dataclass(frozen=True)
class Robot:
    """A vehicle: the prefix of its names, such as ``boat/`` or empty, its size and its parts."""

    prefix: str
    size: Size | None
    parts: tuple[Part, ...]

    @property
    def topic(self) -> str:
        """The topic of its description."""
        return f"/{self.prefix}robot_description"

    @property
    def urdf(self) -> str:
        """The description: hull, sensors and thrusters as fixed links, fins as joints."""
        base = f"{self.prefix}base_link"
        lines = [
            '<?xml version="1.0"?>',
            f"<robot name={quoteattr(self.prefix.strip('/') or 'vehicle')}>",
            '  <material name="hull"><color rgba="0.95 0.75 0.1 1"/></material>',
            '  <material name="part"><color rgba="0.2 0.2 0.25 1"/></material>',
            f"  <link name={quoteattr(base)}>{_hull(self.size)}</link>",
        ]
        for part in self.parts:
            lines += [
                f"  <link name={quoteattr(part.name)}>{_SHAPES[part.kind]}</link>",
                f"  <joint name={quoteattr(part.joint)} "
                f'type="{"revolute" if part.kind == "fin" else "fixed"}">',
                f"    <parent link={quoteattr(part.above)}/>",
                f"    <child link={quoteattr(part.name)}/>",
                f'    <origin xyz="{_row(part.r)}" rpy="{_row(_rpy(part.q))}"/>',
            ]
            if part.kind == "fin":
                # Rates and torques are not limited; URDF demands figures.
                lines += ['    <axis xyz="0 0 1"/>', f'    <limit lower="{-part.limit:.6g}" '
                          f'upper="{part.limit:.6g}" effort="0" velocity="0"/>']  # fmt: skip
            lines.append("  </joint>")
        return "\n".join([*lines, "</robot>", ""])


def robots_of(plan: Plan, facts: Facts | None = None) -> list[Robot]:
    """Return the vehicles of a system, in its order."""
    known = facts_of(plan) if facts is None else facts
    found = []
    for hull in plan.components:
        if _is_hull(hull):
            level = hull.path.rpartition(".")[0]
            prefix = f"{level.replace('.', '/')}/" if level else ""
            beside = [c for c in plan.components if c.path.rpartition(".")[0] == level]
            parts = [p for c in beside for p in _parts(c, known[c.path], prefix, plan)]
            found.append(Robot(prefix, _size(hull), tuple(parts)))
    return found


def mounted(store: Typestore, topics: Iterable[Topic], robots: Iterable[Robot]) -> Array:
    """Return the message of /tf_static with the fixed frames; empty if there is none.

    Axes of an instrument that no topic uses are left out.
    """
    used = {topic.frame for topic in topics}
    parts = [
        part
        for robot in robots
        for part in robot.parts
        if part.kind != "fin" and (part.kind != "axes" or part.name in used)
    ]
    if not parts:
        return np.zeros(0, np.uint8)
    texts: dict[str, str] = {}
    columns: dict[str, Array] = {}
    for i, part in enumerate(parts):
        at = f"transforms.{i}"
        texts |= {f"{at}.header.frame_id": part.above, f"{at}.child_frame_id": part.name}
        columns[f"{at}.transform.translation"] = np.array([part.r])
        columns[f"{at}.transform.rotation"] = np.array([part.q])
    layout = MessageLayout(store, TRANSFORMS, texts, {"transforms": len(parts)})
    return layout.rows(1, columns).ravel()


def text_message(store: Typestore, text: str) -> Array:
    """Return the message of a std_msgs/msg/String."""
    return MessageLayout(store, STRING, {"data": text}, {}).rows(1, {}).ravel()


def _is_hull(c: PlannedComponent) -> bool:
    tau, eta = (c.description.variables.get(name) for name in ("tau", "eta"))
    moved = tau is not None and tau.causality == "input" and tau.shape == (6,)
    return moved and eta is not None and eta.causality == "output" and eta.shape == (6,)


def _size(hull: PlannedComponent) -> Size | None:
    """Return the size that a hull's vehicle states; None if it is not known."""
    if not hull.source.startswith("model:"):
        return None
    name, _, query = hull.source.removeprefix("model:").partition("?")
    id = dict(parse_qsl(query)).get("id", "") if name == "vehicle" else unquote(name)
    id = id.partition("@")[0]
    return vehicle_size(id) if id not in LIBRARY and is_vehicle(id) else None


def _parts(c: PlannedComponent, p: Mapping[str, Array], prefix: str, plan: Plan) -> Iterator[Part]:
    base, name = f"{prefix}base_link", c.path.rpartition(".")[2]
    if p.get("r_s", np.zeros(0)).shape == (3,):
        q = euler_quaternion(p.get("Theta_s", np.zeros(3)).reshape(1, 3))
        link = f"{prefix}{name}_link"
        yield Part(link, base, _flu(p["r_s"]), tuple(body_quaternion(q)[0].tolist()), "sensor")
        for fact, word, axes in _AXES if p.keys() & {"@directions", "@pixels"} else ():
            if fact in p:
                yield Part(f"{prefix}{name}_{word}", link, (0.0,) * 3, axes, "axes")
    r = p.get("r", np.zeros(0))
    if r.ndim == 2 and r.shape[1:] == (3,) and p.get("a", r[:0]).shape == r.shape:
        limits = np.broadcast_to(p.get("delta_max", np.array(np.pi / 2)), len(r))
        for i, (at, hinge, limit) in enumerate(zip(r, p["a"], limits, strict=True), 1):
            turned = _turn_to(2, body(hinge.reshape(1, 3))[0])
            yield Part(f"{prefix}{name}_{i}_link", base, _flu(at), turned, "fin", float(limit))
    e = p.get("e", np.zeros(0))
    adds = {"tau", "thrust"} & {v.name for v in c.description.of("output")}
    if adds and r.size and e.shape == r.shape and r.shape[-1] == 3:
        thrusters = _thrusters(c, plan, len(r.reshape(-1, 3)))
        for at, way, own in zip(r.reshape(-1, 3), e.reshape(-1, 3), thrusters, strict=True):
            turned = _turn_to(0, body(way.reshape(1, 3))[0])
            yield Part(f"{prefix}{own}_link", base, _flu(at), turned, "thruster")


def _thrusters(c: PlannedComponent, plan: Plan, n: int) -> list[str]:
    """Return the names of the n thrusters whose forces a component adds."""
    own = c.path.rpartition(".")[2]
    names = [own] if n == 1 else [f"{own}_{i + 1}" for i in range(n)]
    index = plan.components.index(c)
    for t in plan.transfers:
        if t.target == index and t.target_variable.name == "thrust":
            for j in t.target_elements:
                names[j] = plan.components[t.source].path.rpartition(".")[2]
    return names


def _flu(r: Array) -> tuple[float, ...]:
    return tuple(body(r.reshape(1, 3))[0].tolist())


def _turn_to(axis: int, way: Array) -> tuple[float, ...]:
    """Return the quaternion x y z w of the least turn that takes an axis to a direction."""
    start = np.eye(3)[axis]
    way = way / np.linalg.norm(way)
    if np.dot(start, way) < -1 + 1e-12:  # opposite: half a turn about the next axis
        opposite: list[float] = np.eye(3)[(axis + 1) % 3].tolist()
        return (*opposite, 0.0)
    q = np.array([*np.cross(start, way), 1 + np.dot(start, way)])
    return tuple((q / np.linalg.norm(q)).tolist())


def _rpy(q: tuple[float, ...]) -> tuple[float, ...]:
    """Return roll, pitch, yaw [rad], z-y-x, of a unit quaternion x y z w."""
    x, y, z, w = q
    up, down = np.hypot(w + y, x - z), np.hypot(w - y, x + z)  # sqrt(1 ± sin pitch)
    pitch = 2 * np.arctan2(up, down) - np.pi / 2
    if min(up, down) < 1e-9:  # only the difference, or the sum, of roll and yaw matters
        return (0.0, float(pitch), float(np.sign(-pitch) * 2 * np.arctan2(x, w)))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return (float(roll), float(pitch), float(yaw))


def _hull(size: Size | None) -> str:
    """Return the picture of a hull: URDF has boxes, cylinders and spheres."""
    if size is None:
        return ""
    at, turned = body(np.array([size.at]))[0], ""
    sides = (size.length, size.breadth, size.height)
    shape = f'<box size="{_row(sides)}"/>'
    if size.shape == "ellipsoid" and len(set(sides)) == 1:
        shape = f'<sphere radius="{size.length / 2:.6g}"/>'
    elif size.shape in ("torpedo", "ellipsoid"):
        radius = (size.breadth + size.height) / 4
        shape = f'<cylinder radius="{radius:.6g}" length="{size.length:.6g}"/>'
        turned = f' rpy="0 {np.pi / 2:.9g} 0"'
    return (
        f'\n    <visual>\n      <origin xyz="{_row(at)}"{turned}/>\n'
        f'      <geometry>{shape}</geometry>\n      <material name="hull"/>\n    </visual>\n  '
    )


def _solid(shape: str) -> str:
    return f'<visual><geometry>{shape}</geometry><material name="part"/></visual>'


_SHAPES = {
    "sensor": _solid('<box size="0.04 0.04 0.04"/>'),
    "axes": "",
    "thruster": _solid('<box size="0.08 0.05 0.05"/>'),
    "fin": _solid('<box size="0.08 0.01 0.1"/>'),
}


def _row(values: Iterable[float]) -> str:
    return " ".join(f"{x:.9g}" for x in (float(v) + 0.0 for v in values))
