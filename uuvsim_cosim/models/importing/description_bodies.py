"""The rigid body of a URDF or SDF: all links added up about the root's origin, in FLU.

Joints stand at zero. Rotations are roll, pitch, yaw about fixed axes: R = R_z R_y R_x.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import cos, pi, sin
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.importing.description_file import near, place_of
from uuvsim_cosim.models.importing.xacro_text import local
from uuvsim_cosim.models.shapes.mesh import raw_triangles, repaired, solid_of

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["Bodies", "bodies_of", "child", "gathered", "numbers"]

Array = NDArray[np.float64]


@dataclass
class Bodies:
    """Mass [kg], CG [m], inertia about CG [kg.m2]; volume, its centre and extents of primitives."""

    links: list[str] = field(default_factory=list)
    m: float = 0.0
    first: Array = field(default_factory=lambda: np.zeros(3))
    second: Array = field(default_factory=lambda: np.zeros((3, 3)))  # inertia about the origin
    volume: float = 0.0
    moment: Array = field(default_factory=lambda: np.zeros(3))
    low: Array = field(default_factory=lambda: np.full(3, np.inf))
    high: Array = field(default_factory=lambda: np.full(3, -np.inf))
    unread: list[str] = field(default_factory=list)  # meshes of <collision>, with the cause

    @property
    def shaped(self) -> bool:
        """Return whether the shapes of <collision> are known, all of them."""
        return self.volume > 0 and not self.unread

    @property
    def r_g(self) -> Array:
        """Return the centre of gravity from the origin [m], in FLU."""
        return self.first / self.m

    @property
    def I_g(self) -> Array:
        """Return the inertia about CG [kg.m2], axes FLU."""
        r = self.r_g
        return self.second - self.m * (r @ r * np.eye(3) - np.outer(r, r))

    def add(self, m: float, r: Array, inertia: Array) -> None:
        """Add a body of mass m at r with its inertia about its own CG."""
        self.m += m
        self.first = self.first + m * r
        self.second = self.second + inertia + m * (r @ r * np.eye(3) - np.outer(r, r))


@contextmanager
def gathered(problems: list[str]) -> Iterator[None]:
    """Add a refusal to the others, so that all are told at once."""
    try:
        yield
    except InputInvalid as error:
        problems.append(str(error))


def child(element: _Element, name: str) -> _Element | None:
    """Return the first child of a name, None if there is none."""
    return next((c for c in element if local(c) == name), None)


def numbers(path: Path, element: _Element, text: str | None, count: int | tuple[int, ...]) -> Array:
    """Return the numbers of a text; raises InputInvalid with the line."""
    counts = (count,) if isinstance(count, int) else count
    words = (text or "").replace(",", " ").replace(";", " ").split()
    try:
        found = np.array([float(w) for w in words])
    except ValueError:
        found = np.array([np.nan])
    if len(found) not in counts or not np.isfinite(found).all():
        more = ""
        if "$" in (text or ""):
            more = "; expand it first: xacro FILE > out.urdf, and import that"
        wanted = " or ".join(str(c) for c in counts)
        raise InputInvalid(
            place_of(path, element),
            f"<{local(element)}>: {' '.join(words)[:60]!r}",
            f"{wanted} number{'s' if counts != (1,) else ''}{more}",
        )
    return found


def _rotation(rpy: Array) -> Array:
    (cr, sr), (cp, sp), (cy, sy) = ((cos(a), sin(a)) for a in rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _pose(path: Path, element: _Element | None) -> tuple[Array, Array]:
    """Return (R, r) of URDF's <origin> or SDF's <pose>; none is the identity."""
    if element is None:
        return np.eye(3), np.zeros(3)
    if local(element) == "origin":
        r = numbers(path, element, element.get("xyz", "0 0 0"), 3)
        return _rotation(numbers(path, element, element.get("rpy", "0 0 0"), 3)), r
    six = numbers(path, element, element.text or "0 0 0 0 0 0", 6)
    if element.get("degrees") == "true":
        six[3:] *= pi / 180.0
    return _rotation(six[3:]), six[:3]


def _value(path: Path, element: _Element, name: str, default: float | None = None) -> float:
    """Return a number that stands as an attribute (URDF) or as a child (SDF)."""
    text = element.get(name)
    inner = child(element, name)
    if text is None and inner is not None:
        text, element = inner.text, inner
    if text is None and default is not None:
        return default
    return float(numbers(path, element, text, 1)[0])


def bodies_of(path: Path, model: _Element, problems: list[str]) -> Bodies:
    """Add up the links of a <robot> or a <model>; what is wrong is added to `problems`."""
    found = Bodies()
    for link, (R, r) in _placed_links(path, model, problems):
        inertial = child(link, "inertial")
        if inertial is not None:
            _add_inertial(path, found, link, inertial, R, r, problems)
        for collision in link:
            if local(collision) == "collision":
                with gathered(problems):
                    _add_collision(path, found, collision, R, r)
    if not found.m > 0 and not problems:
        raise InputInvalid(
            path,
            "no link has an <inertial> with a mass above 0",
            (
                "one (of a xacro whose includes lie elsewhere, expand it first: "
                "xacro FILE > out.urdf)"
            ),
        )
    return found


def _placed_links(
    path: Path, model: _Element, problems: list[str]
) -> Iterator[tuple[_Element, tuple[Array, Array]]]:
    links = [
        e
        for e in model.iter()
        if local(e) == "link"
        and child(e, "hydrodynamic_model") is None
        and ((parent := e.getparent()) is None or local(parent) != "plugin")
    ]
    if local(model) == "model":
        for link in links:
            with gathered(problems):
                yield link, _pose(path, child(link, "pose"))
        return
    above: dict[str, tuple[str, _Element | None]] = {}
    for joint in model.iter():
        below = child(joint, "child") if local(joint) == "joint" else None
        if below is not None:
            parent = child(joint, "parent")
            name = parent.get("link", "") if parent is not None else ""
            above[below.get("link", "")] = (name, child(joint, "origin"))
    for link in links:
        R, r = np.eye(3), np.zeros(3)
        name, steps = link.get("name", ""), 0
        while name in above and steps < 100:
            name, origin = above[name]
            R_j, r_j = np.eye(3), np.zeros(3)
            with gathered(problems):
                R_j, r_j = _pose(path, origin)
            R, r = R_j @ R, R_j @ r + r_j
            steps += 1
        if steps == 100:
            raise InputInvalid(path, f"the joints above link {name!r} go round", "a tree")
        yield link, (R, r)


def _add_inertial(
    path: Path,
    found: Bodies,
    link: _Element,
    inertial: _Element,
    R: Array,
    r: Array,
    problems: list[str],
) -> None:
    m, I = 0.0, np.zeros((3, 3))  # noqa: E741
    R_i, r_i = np.eye(3), np.zeros(3)
    mass, tensor = child(inertial, "mass"), child(inertial, "inertia")
    with gathered(problems):
        if mass is None:
            raise InputInvalid(place_of(path, inertial), "<inertial> without <mass>", "one")
        m = float(numbers(path, mass, mass.get("value") or mass.text, 1)[0])
        if m < 0:
            raise InputInvalid(place_of(path, mass), f"<mass>: {m:g} kg", "more than 0")
    with gathered(problems):
        pose = child(inertial, "origin")
        R_i, r_i = _pose(path, pose if pose is not None else child(inertial, "pose"))
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        if tensor is None:
            break
        name = f"i{'xyz'[i]}{'xyz'[j]}"
        with gathered(problems):
            I[i, j] = I[j, i] = _value(path, tensor, name, 0.0 if i != j else None)
            if i == j and I[i, i] < 0:
                raise InputInvalid(
                    place_of(path, tensor), f"{name} = {I[i, i]:g} kg.m2", "0 or more"
                )
    found.links.append(link.get("name", ""))
    turned = R @ R_i
    found.add(m, R @ r_i + r, turned @ I @ turned.T)


def _add_collision(path: Path, found: Bodies, collision: _Element, R: Array, r: Array) -> None:
    geometry = child(collision, "geometry")
    shapes = ("box", "cylinder", "sphere", "mesh")
    shape = next((c for c in geometry if local(c) in shapes), None) \
        if geometry is not None else None  # fmt: skip
    if shape is None:
        return
    pose = child(collision, "origin")
    R_c, r_c = _pose(path, pose if pose is not None else child(collision, "pose"))
    if local(shape) == "mesh":
        _add_mesh(path, found, shape, R @ R_c, R @ r_c + r)
        return
    if local(shape) == "box":
        text = shape.get("size")
        inner = child(shape, "size")
        size = numbers(path, shape, text if text is not None else
                       inner.text if inner is not None else None, 3)  # fmt: skip
        volume = float(size.prod())
    else:
        d = 2.0 * _value(path, shape, "radius")
        length = _value(path, shape, "length") if local(shape) == "cylinder" else d
        size = np.array([d, d, length])
        volume = pi / 4 * d * d * length if local(shape) == "cylinder" else pi / 6 * d**3
    at = R @ r_c + r
    half = np.abs(R @ R_c) @ size / 2.0
    found.volume += volume
    found.moment = found.moment + volume * at
    found.low, found.high = np.minimum(found.low, at - half), np.maximum(found.high, at + half)


def _add_mesh(path: Path, found: Bodies, shape: _Element, R: Array, r: Array) -> None:
    """Add the solid within a mesh that lies near the file; note one that cannot be read."""
    inner = child(shape, "uri")
    name = (shape.get("filename") or (inner.text if inner is not None else "") or "").strip()
    scaling = child(shape, "scale")
    text = shape.get("scale") or (scaling.text if scaling is not None else None) or "1 1 1"
    scale = numbers(path, shape, text, 3)
    file = next(near(name, path), None)
    if file is None:
        found.unread.append(f"{name}: does not lie near {path.name}")
        return
    try:
        triangles = raw_triangles(file) * scale
        solid = solid_of(repaired(triangles if scale.prod() > 0 else triangles[:, ::-1], str(file)))
    except InputInvalid as error:
        found.unread.append(str(error))
        return
    corners = triangles.reshape(-1, 3) @ R.T + r
    found.volume += solid.volume
    found.moment = found.moment + solid.volume * (R @ solid.centre + r)
    found.low = np.minimum(found.low, corners.min(axis=0))
    found.high = np.maximum(found.high, corners.max(axis=0))
