"""The shape of a vehicle: the parts that its shape.yaml lists, as closed meshes.

    vehicle: remus100
    units: "m, deg"                  # of all numbers; places are from CO, in b (FRD)
    source: "Prestero (2001)"        # of the dimensions, unless a part states another source
    parts:
      - name: hull
        myring: {nose: [0.611, 0, 0], a: 0.191, b: 0.654, c: 0.541, d: 0.191, theta: 25}
      - name: fins
        fin: {at: [-0.64, 0.06, 0], span: [0, 0.1, 0], chord: [0.09, 0.07]}
        around: [0, 90, 180, 270]    # turned copies about x
        beyond_size: true            # not within `size` of parameters.yaml
        source: "invented"

Each kind of part is a function of hull_parts.py, whose arguments are the keys. The mesh is made
when it is first asked for; no mesh is shipped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.parameter_files import (
    is_vehicle,
    line_of,
    read_yaml,
    split_address,
    vehicle_folder,
)
from uuvsim_cosim.models.shapes import hull_parts
from uuvsim_cosim.models.shapes.glb import ColouredShell, glb
from uuvsim_cosim.models.shapes.hull_parts import Shell, enclosed_volume, joined

__all__ = ["MOST_TRIANGLES", "HullShape", "hull_shape", "read_hull_shape"]

MOST_TRIANGLES = 6000  # of one vehicle: pages and components carry them all
KINDS: dict[str, Callable[..., Shell]] = {
    kind: getattr(hull_parts, kind)
    for kind in (
        "box",
        "ellipsoid",
        "fin",
        "myring",
        "plate",
        "propeller",
        "thruster",
        "tube",
        "turned",
    )
}


@dataclass(frozen=True, eq=False)
class HullShape:
    """The parts of a vehicle, each a closed shell in b [m] from CO."""

    vehicle: str
    source: str
    parts: tuple[ColouredShell, ...]
    within: tuple[bool, ...]  # whether the vehicle's `size` includes the part
    sources: tuple[str, ...]  # of each part's dimensions

    @property
    def surface(self) -> Shell:
        """Return the vertices (n, 3) and triangles (m, 3) of all parts."""
        return joined([(p.vertices, p.faces) for p in self.parts])

    @property
    def extent(self) -> NDArray[np.float64]:
        """Return the least and the greatest corner (2, 3) [m] of the parts within `size`."""
        at = np.concatenate([
            p.vertices for p, own in zip(self.parts, self.within, strict=True) if own
        ])  # fmt: skip
        return np.stack([at.min(axis=0), at.max(axis=0)])

    @property
    def volume(self) -> float:
        """Return the volume [m3] within all parts; where parts overlap, it counts once."""
        return enclosed_volume(*self.surface)

    @property
    def invented(self) -> tuple[str, ...]:
        """List the parts whose dimensions no source states."""
        return tuple(
            p.name
            for p, s in zip(self.parts, self.sources, strict=True)
            if s.startswith("invented")
        )

    def glb(self) -> bytes:
        """Return the shape as binary glTF, one node for each part."""
        return glb(self.vehicle, self.parts, f"Dimensions: {self.source}")


def hull_shape(vehicle: str) -> HullShape | None:
    """Return the shape of a vehicle (id or folder); None if its folder has no shape.yaml."""
    id, _ = split_address(vehicle)
    if id.endswith((".yaml", ".yml")) or not is_vehicle(id):
        return None
    file = vehicle_folder(id) / "shape.yaml"
    return read_hull_shape(file) if file.is_file() else None


@shared_until_changed
def read_hull_shape(file: Path) -> HullShape:
    """Read a shape.yaml and make its parts; raises ParameterInvalid with the line of mistakes."""
    made: list[list[Shell]] = []

    def mistakes(data: Any) -> Iterator[tuple[int, str]]:
        for i, entry in enumerate(data["parts"]):
            place = line_of(data, ["parts", i])
            kinds = [k for k in KINDS if k in entry]
            if len(kinds) != 1:
                found = ", ".join(kinds) or "none"
                yield place, f"parts.{i}: {found}; expected one of {', '.join(KINDS)}"
                continue
            given = _plain(entry[kinds[0]])
            if not all(map(isfinite, _numbers(given))):
                yield place, f"parts.{i}.{kinds[0]}: {given}; expected finite numbers"
                continue
            try:
                shell = KINDS[kinds[0]](**given)
            except (TypeError, ValueError, ZeroDivisionError) as error:
                yield place, f"parts.{i}.{kinds[0]}: {error}; expected the dimensions of a solid"
                continue
            if not _volume(shell) > 0:
                yield place, f"parts.{i}.{kinds[0]}: encloses no volume; expected a solid"
                continue
            made.append(_copies(shell, entry))
        total = sum(len(f) for shells in made for _, f in shells)
        if total > MOST_TRIANGLES:
            yield (
                line_of(data, ["parts"]),
                (f"parts: {total:,} triangles; expected at most {MOST_TRIANGLES:,}"),
            )

    data = read_yaml(file, "shape.schema.json", mistakes)
    parts, entries = [], data["parts"]
    for entry, shells in zip(entries, made, strict=True):
        colour = str(entry.get("colour", "#c9d3df"))
        parts.append(ColouredShell(str(entry["name"]), *joined(shells), colour))
    return HullShape(
        str(data["vehicle"]), str(data["source"]), tuple(parts),
        tuple(not entry.get("beyond_size", False) for entry in entries),
        tuple(str(entry.get("source", data["source"])) for entry in entries),
    )  # fmt: skip


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return value if isinstance(value, bool | int | str) else float(value)


def _numbers(value: Any) -> Iterator[float]:
    for v in value.values() if isinstance(value, dict) else value:
        if isinstance(v, dict | list):
            yield from _numbers(v)
        elif not isinstance(v, str):
            yield float(v)


def _volume(shell: Shell) -> float:
    t = shell[0][shell[1]] - shell[0].mean(axis=0)
    return float(np.einsum("ni,ni->", t[:, 0], np.cross(t[:, 1], t[:, 2]))) / 6.0


def _copies(shell: Shell, entry: Any) -> list[Shell]:
    """Return a part and its copies: mirrored at y = 0, at x = 0, turned about x."""
    shells = [shell]
    for axis in (str(a) for a in entry.get("mirror", ())):
        sign = np.where(np.arange(3) == "xyz".index(axis), -1.0, 1.0)
        shells += [(v * sign, f[:, ::-1].copy()) for v, f in shells]
    turns = [np.radians(float(a)) for a in entry.get("around", (0.0,))]
    return [
        (v @ np.array([[1, 0, 0], [0, np.cos(a), np.sin(a)], [0, -np.sin(a), np.cos(a)]]), f)
        for v, f in shells
        for a in turns
    ]
