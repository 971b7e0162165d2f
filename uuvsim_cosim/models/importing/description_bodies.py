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
from uuvsim_cosim.models.importing.xacro import local, near, place_of
from uuvsim_cosim.models.shapes.mesh import raw_triangles, repaired, solid_of

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["Bodies", "Reader", "bodies_of", "child"]

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
    repaired: list[str] = field(default_factory=list)  # what was changed in meshes that are read

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

    def add_mass(self, m: float, r: Array, inertia: Array) -> None:
        """Add a body of mass m at r with its inertia about its own CG."""
        self.m += m
        self.first = self.first + m * r
        self.second = self.second + inertia + m * (r @ r * np.eye(3) - np.outer(r, r))

    def add_shape(self, volume: float, centre: Array, low: Array, high: Array) -> None:
        """Add a solid of <collision>: its volume [m3], centre and extents [m]."""
        self.volume += volume
        self.moment = self.moment + volume * centre
        self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)


def child(element: _Element, name: str) -> _Element | None:
    """Return the first child of a name, None if there is none."""
    return next((c for c in element if local(c) == name), None)


@dataclass
class Reader:
    """Reads numbers of a description's elements; errors name the line, `problems` collects them."""

    path: Path
    problems: list[str] = field(default_factory=list)

    @contextmanager
    def gathered(self) -> Iterator[None]:
        """Add an error to the problems, so that all are reported at once."""
        try:
            yield
        except InputInvalid as error:
            self.problems.append(str(error))

    def numbers(self, element: _Element, text: str | None, *counts: int) -> Array:
        """Return the numbers of a text, as many as one of `counts`; raises InputInvalid."""
        words = (text or "").replace(",", " ").replace(";", " ").split()
        try:
            found = np.array([float(w) for w in words])
        except ValueError:
            found = np.array([np.nan])
        if len(found) in counts and np.isfinite(found).all():
            return found
        more = ""
        if "$" in (text or ""):
            more = "; expand it first: xacro FILE > out.urdf, and import that"
        wanted = " or ".join(map(str, counts))
        raise InputInvalid(
            place_of(self.path, element),
            f"<{local(element)}>: {' '.join(words)[:60]!r}",
            f"{wanted} number{'s' if counts != (1,) else ''}{more}",
        )

    def number(self, element: _Element, text: str | None = None) -> float:
        """Return the one number of a text, or of the element's own text."""
        return float(self.numbers(element, element.text if text is None else text, 1)[0])

    def value(self, element: _Element, name: str, default: float | None = None) -> float:
        """Return a number that is an attribute (URDF) or a child (SDF)."""
        text, inner = element.get(name), child(element, name)
        if text is None and inner is not None:
            text, element = inner.text, inner
        if text is None and default is not None:
            return default
        return self.number(element, text or "")

    def pose(self, element: _Element) -> tuple[Array, Array]:
        """Return (R, r) of the element's <origin> (URDF) or <pose> (SDF); none is the identity."""
        found = child(element, "origin")
        if found is not None:
            r = self.numbers(found, found.get("xyz", "0 0 0"), 3)
            rpy = self.numbers(found, found.get("rpy", "0 0 0"), 3)
        else:
            found = child(element, "pose")
            if found is None:
                return np.eye(3), np.zeros(3)
            six = self.numbers(found, found.text or "0 0 0 0 0 0", 6)
            r, rpy = six[:3], six[3:] * (pi / 180.0 if found.get("degrees") == "true" else 1.0)
        (cr, sr), (cp, sp), (cy, sy) = ((cos(a), sin(a)) for a in rpy)
        R = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
        return np.array(R), r


def bodies_of(read: Reader, model: _Element) -> Bodies:
    """Add up the links of a <robot> or a <model>; the reader collects the problems."""
    found = Bodies()
    for link, (R, r) in _placed_links(read, model):
        inertial = child(link, "inertial")
        if inertial is not None:
            found.links.append(link.get("name", ""))
            found.add_mass(*_inertial(read, inertial, R, r))
        for collision in link:
            if local(collision) == "collision":
                with read.gathered():
                    _add_collision(read, found, collision, R, r)
    if not found.m > 0 and not read.problems:
        raise InputInvalid(
            read.path,
            "no link has an <inertial> with a mass above 0",
            "one (of a xacro whose includes lie elsewhere, expand it first: xacro FILE > out.urdf)",
        )
    return found


def _placed_links(read: Reader, model: _Element) -> Iterator[tuple[_Element, tuple[Array, Array]]]:
    """Yield each link with its pose (R, r) from the root, all joints at zero."""
    links = [
        e
        for e in model.iter()
        if local(e) == "link"
        and child(e, "hydrodynamic_model") is None
        and ((parent := e.getparent()) is None or local(parent) != "plugin")
    ]
    if local(model) == "model":
        for link in links:
            with read.gathered():
                yield link, read.pose(link)
        return
    joints: dict[str, tuple[str, _Element]] = {}  # above the link of this name
    for joint in model.iter():
        below = child(joint, "child") if local(joint) == "joint" else None
        if below is not None:
            parent = child(joint, "parent")
            name = parent.get("link", "") if parent is not None else ""
            joints[below.get("link", "")] = (name, joint)
    for link in links:
        R, r = np.eye(3), np.zeros(3)
        name, steps = link.get("name", ""), 0
        while name in joints and steps < 100:
            name, joint = joints[name]
            R_j, r_j = np.eye(3), np.zeros(3)
            with read.gathered():
                R_j, r_j = read.pose(joint)
            R, r = R_j @ R, R_j @ r + r_j
            steps += 1
        if steps == 100:
            raise InputInvalid(read.path, f"the joints above link {name!r} go round", "a tree")
        yield link, (R, r)


def _inertial(read: Reader, inertial: _Element, R: Array, r: Array) -> tuple[float, Array, Array]:
    """Return mass, CG and inertia about it of an <inertial>, turned by the link's pose (R, r)."""
    m, I = 0.0, np.zeros((3, 3))  # noqa: E741
    R_i, r_i = np.eye(3), np.zeros(3)
    mass, tensor = child(inertial, "mass"), child(inertial, "inertia")
    with read.gathered():
        if mass is None:
            raise InputInvalid(place_of(read.path, inertial), "<inertial> without <mass>", "one")
        m = read.number(mass, mass.get("value") or None)
        if m < 0:
            raise InputInvalid(place_of(read.path, mass), f"<mass>: {m:g} kg", "more than 0")
    with read.gathered():
        R_i, r_i = read.pose(inertial)
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        if tensor is None:
            break
        name = f"i{'xyz'[i]}{'xyz'[j]}"
        with read.gathered():
            I[i, j] = I[j, i] = read.value(tensor, name, 0.0 if i != j else None)
            if i == j and I[i, i] < 0:
                raise InputInvalid(
                    place_of(read.path, tensor), f"{name} = {I[i, i]:g} kg.m2", "0 or more"
                )
    turned = R @ R_i
    return m, R @ r_i + r, turned @ I @ turned.T


def _add_collision(read: Reader, found: Bodies, collision: _Element, R: Array, r: Array) -> None:
    """Add the solid of a <collision>, turned by the link's pose; note a mesh that is not read."""
    geometry = child(collision, "geometry")
    shapes = ("box", "cylinder", "sphere", "mesh")
    shape = next((c for c in geometry if local(c) in shapes), None) \
        if geometry is not None else None  # fmt: skip
    if shape is None:
        return
    R_c, r_c = read.pose(collision)
    turned, at = R @ R_c, R @ r_c + r
    inner = child(shape, {"box": "size", "mesh": "uri"}.get(local(shape), ""))
    inner_text = inner.text if inner is not None else None
    if local(shape) != "mesh":
        if local(shape) == "box":
            size = read.numbers(shape, shape.get("size", inner_text), 3)
            volume = float(size.prod())
        else:
            d = 2.0 * read.value(shape, "radius")
            length = read.value(shape, "length") if local(shape) == "cylinder" else d
            size = np.array([d, d, length])
            volume = pi / 4 * d * d * length if local(shape) == "cylinder" else pi / 6 * d**3
        half = np.abs(turned) @ size / 2.0
        found.add_shape(volume, at, at - half, at + half)
        return
    name = (shape.get("filename") or inner_text or "").strip()
    scaling = child(shape, "scale")
    text = shape.get("scale") or (scaling.text if scaling is not None else None) or "1 1 1"
    scale = read.numbers(shape, text, 3)
    file = next(near(name, read.path), None)
    if file is None:
        found.unread.append(f"{name}: does not lie near {read.path.name}")
        return
    try:
        triangles = raw_triangles(file) * scale
        outwards = triangles if scale.prod() > 0 else triangles[:, ::-1]
        mesh = repaired(outwards, str(file), turn=True)
        solid = solid_of(mesh)
    except InputInvalid as error:
        found.unread.append(str(error))
        return
    found.repaired += [f"{file.name}: {note}" for note in mesh.notes]
    corners = triangles.reshape(-1, 3) @ turned.T + at
    centre = turned @ solid.centre + at
    found.add_shape(solid.volume, centre, corners.min(axis=0), corners.max(axis=0))
